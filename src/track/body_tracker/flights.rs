//! The comparison of a collision with the flights around it.

use super::BodyTracker;
use crate::motion::{KnownMotion, Pose, Regime, physical, smooth};
use crate::results::{BodyVelocity, Estimate, Impact};

/// The frames between a contact and the flights that its velocities are compared with.
const NEXT_FRAMES: f64 = 1.0;
/// The difference between two speeds that is always allowed, as a fraction.
const SAME_SPEED: f64 = 0.015;
/// The difference that noise explains, sigmas.
const SAME_SPEED_SIGMAS: f64 = 3.0;

impl BodyTracker {
    /// Whether the velocities of an impact differ from those of the frames before and after it.
    ///
    /// They do if a component differs by more than 1.5 % of the speed and by more than three standard uncertainties.
    /// The frames take more of the motion out of the image plane into account.
    pub(super) fn contradicts_flights(&self, impact: &Impact) -> bool {
        let period_s = self.params.frame_period_ns * 1e-9;
        let before = impact.start_s.and_then(|start| {
            let end = self.nodes.partition_point(|n| n.time_frames < start.value / period_s - NEXT_FRAMES);
            self.nodes[..end].last()
        });
        let after = impact.end_s.and_then(|end| {
            let first = self.nodes.partition_point(|n| n.time_frames <= end.value / period_s + NEXT_FRAMES);
            self.nodes.get(first)
        });
        let differs = |node: Option<&Pose>, normal: Option<Estimate>, tangential: Option<Estimate>| {
            let velocity = node.and_then(|node| self.velocity_at(node));
            let (Some(velocity), Some(normal), Some(tangential)) = (velocity, normal, tangential) else { return false };
            let tolerance_m_s = SAME_SPEED * normal.value.hypot(tangential.value);
            [(velocity.vn_m_s, normal), (velocity.vt_m_s, tangential)].iter().any(|(local, found)| {
                let sigma = velocity.sigma_v_m_s.hypot(found.sigma);
                (local - found.value).abs() > tolerance_m_s.max(SAME_SPEED_SIGMAS * sigma)
            })
        };
        differs(before, impact.vn_before_m_s, impact.vt_before_m_s)
            || differs(after, impact.vn_after_m_s, impact.vt_after_m_s)
    }

    /// Returns the velocity fitted around a node, with its systematic errors; `None` without a scale or enough nodes.
    fn velocity_at(&self, node: &Pose) -> Option<BodyVelocity> {
        let regime = self.detector.as_ref().map_or(Regime::Unknown, |detector| detector.regime(node.frame));
        let here = self.outline_drift.local_drift(node, regime);
        let known = KnownMotion { nodes: &self.nodes, to_frame: self.newest_frame, gravity: self.gravity() };
        let rates = self.correct_out_of_plane(smooth(known, node.frame, regime, &self.params)?, regime, node, &here);
        Some(physical(&self.with_systematic_errors(rates), self.radius.metres_per_px(self.params.scale)?, &self.params))
    }
}
