//! Gating of balls across blocks: a detection is accepted only where the followed ball can be.

use crate::results::{BodyStep, PointStatus};

/// The minimum radius of the gate around the predicted centre, px.
const GATE_RADIUS_PX: f64 = 1.5;

/// The minimum radius of the gate in standard uncertainties of the two centres.
const GATE_SIGMAS: f64 = 8.0;

/// The same after an ambiguous detection.
const GATE_SIGMAS_AMBIGUOUS: f64 = 3.0;

/// The growth of the gate per frame without a measured motion, px.
const GATE_GROWTH_PX: f64 = 1.0;

/// The growth of the gate per frame without a measured motion, in speeds of the ball: it may rebound.
const GATE_GROWTH_SPEEDS: f64 = 2.0;

/// The growth of the gate per frame after an ambiguous detection, px.
///
/// It is small, because a missing result is better than the result of another ball.
const GATE_GROWTH_AMBIGUOUS_PX: f64 = 0.1;

/// The number of frames without the ball after which it may appear anywhere.
const RESET_AFTER_FRAMES: u32 = 8;

/// The number of rejected detections in a row after which the detected ball is accepted.
const MAX_REJECTED_FRAMES: u32 = 64;

/// The last accepted position of a ball.
#[derive(Debug, Clone, Copy)]
struct Position {
    frame: u64,
    center_px: [f64; 2],
    sigma_px: f64,
    /// The last motion, px/frame.
    motion_px: [f64; 2],
    /// Its standard uncertainty, px/frame.
    sigma_motion_px: f64,
    /// Whether the motion was measured in this frame.
    is_measured: bool,
}

/// A validation gate, which rejects balls that appear where the followed ball cannot be.
///
/// Every block of frames is searched from scratch, so a second ball may be detected instead.
#[derive(Debug, Clone, Default)]
pub struct ValidationGate {
    last: Option<Position>,
    missing: u32,
    rejected: u32,
    rejected_frame: Option<u64>,
    /// Whether another object was detected in its place since the last accepted position.
    is_ambiguous: bool,
}

impl ValidationGate {
    /// Returns the step if the gate accepts it, otherwise an ambiguous step without outline and motion.
    ///
    /// Steps without a circle pass unchanged. Any ball is accepted after eight frames without one, and the detected one
    /// after 63 rejections in a row.
    pub fn gate(&mut self, step: &BodyStep) -> BodyStep {
        let Some(circle) = step.circle() else {
            let is_missing = matches!(step.status, PointStatus::Lost | PointStatus::Occluded | PointStatus::OutOfFrame);
            self.missing += u32::from(is_missing);
            self.is_ambiguous |= step.status == PointStatus::Ambiguous;
            if self.missing >= RESET_AFTER_FRAMES {
                *self = Self { missing: RESET_AFTER_FRAMES, ..Self::default() };
            }
            return *step;
        };
        self.missing = 0;
        let (center_px, sigma_px) = ([circle.x_px, circle.y_px], circle.sigma_center_px);
        let sigmas = if self.is_ambiguous { GATE_SIGMAS_AMBIGUOUS } else { GATE_SIGMAS };
        let found = Found { frame: step.frame, center_px, sigma_px };
        if self.last.is_some_and(|last| !last.admits(found, self.growth_px(&last), sigmas)) {
            self.rejected += 1;
            self.is_ambiguous = true;
            if self.rejected < MAX_REJECTED_FRAMES {
                self.rejected_frame = Some(step.frame);
                return BodyStep { outline: None, motion: None, status: PointStatus::Ambiguous, ..*step };
            }
        }
        (self.rejected, self.is_ambiguous) = (0, false);
        let measured = step.center_motion();
        let motion_px = measured.map(|step| [step.dx_px, step.dy_px]).or(self.last.map(|last| last.motion_px));
        let sigma_motion_px = measured.map_or(0.0, |step| step.sigma_dx_px.hypot(step.sigma_dy_px));
        self.last = Some(Position {
            frame: step.frame,
            center_px,
            sigma_px,
            motion_px: motion_px.unwrap_or_default(),
            sigma_motion_px,
            is_measured: measured.is_some(),
        });
        *step
    }

    /// Returns the growth of the gate per frame without a measured motion, px.
    fn growth_px(&self, last: &Position) -> f64 {
        let speed_px = last.motion_px[0].hypot(last.motion_px[1]);
        if self.is_ambiguous { GATE_GROWTH_AMBIGUOUS_PX } else { GATE_GROWTH_PX + GATE_GROWTH_SPEEDS * speed_px }
    }

    /// Whether the gate rejected the ball detected in `frame`.
    ///
    /// Only the last rejection is stored, so `frame` has to be the newest one that was gated.
    pub fn has_rejected(&self, frame: u64) -> bool {
        self.rejected_frame == Some(frame)
    }
}

/// The centre of a detected ball and its standard uncertainty.
#[derive(Debug, Clone, Copy)]
struct Found {
    frame: u64,
    center_px: [f64; 2],
    sigma_px: f64,
}

impl Position {
    /// Whether the ball can have moved from this position to another.
    ///
    /// `growth_px` is the growth of the gate per frame without a measured motion, `sigmas` its minimum radius in standard
    /// uncertainties.
    fn admits(&self, found: Found, growth_px: f64, sigmas: f64) -> bool {
        let frames = found.frame.saturating_sub(self.frame) as f64;
        let apart: [f64; 2] =
            std::array::from_fn(|k| found.center_px[k] - self.center_px[k] - frames * self.motion_px[k]);
        let unmeasured = if self.is_measured { frames - 1.0 } else { frames };
        let growth_px = unmeasured * growth_px;
        let sigma_px = found.sigma_px.hypot(self.sigma_px).hypot(frames * self.sigma_motion_px);
        apart[0].hypot(apart[1]) <= GATE_RADIUS_PX.max(sigmas * sigma_px) + growth_px
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::{Circle, MotionMethod, RigidStep};

    fn detected(frame: u64, x_px: f64, dx_px: f64) -> BodyStep {
        let circle = Circle {
            x_px,
            y_px: 90.0,
            radius_px: 60.0,
            sigma_center_px: 0.03,
            sigma_radius_px: 0.03,
            visible_fraction: 1.0,
        };
        let step = RigidStep {
            dx_px,
            dy_px: 0.0,
            dtheta_deg: 0.0,
            sigma_dx_px: 0.001,
            sigma_dy_px: 0.001,
            sigma_dtheta_deg: 0.001,
            points: 30,
        };
        BodyStep {
            frame,
            stamp_ns: frame,
            interval_frames: 1,
            outline: Some(circle.into()),
            motion: Some(step),
            method: MotionMethod::WholeBody,
            ..BodyStep::default()
        }
    }

    fn missing(frame: u64) -> BodyStep {
        BodyStep { outline: None, motion: None, status: PointStatus::Lost, ..detected(frame, 0.0, 0.0) }
    }

    /// Counts the accepted steps.
    fn accepted(steps: impl IntoIterator<Item = BodyStep>) -> usize {
        let mut gate = ValidationGate::default();
        steps.into_iter().filter(|step| gate.gate(step).motion.is_some()).count()
    }

    #[test]
    fn a_ball_that_is_thrown_back_within_a_frame_is_accepted() {
        let there = (0..10).map(|k| detected(k, 100.0 + 7.0 * k as f64, if k < 9 { 7.0 } else { -6.0 }));
        let back = (10..20).map(|k| detected(k, 163.0 - 6.0 * (k - 9) as f64, -6.0));
        assert_eq!(accepted(there.chain(back)), 20);
    }

    #[test]
    fn another_ball_is_not_accepted_until_the_first_is_long_gone() {
        let first = |from: u64, to: u64| (from..to).map(|k| detected(k, 100.0 + 0.6 * k as f64, 0.6));
        let second = |from: u64, to: u64| (from..to).map(|k| detected(k, 60.0 + 7.0 * k as f64, 7.0));
        assert_eq!(accepted(first(0, 20).chain(second(20, 30)).chain(first(30, 40))), 30);
        assert_eq!(accepted(first(0, 20).chain((20..30).map(missing)).chain(second(30, 40))), 30);
        assert_eq!(accepted(first(0, 20).chain(second(20, 100))), 20 + 80 - (MAX_REJECTED_FRAMES as usize - 1));
    }

    #[test]
    fn a_ball_that_was_occluded_for_some_frames_may_have_been_hit() {
        let before = (0..10).map(|k| detected(k, 100.0 + 2.0 * k as f64, 2.0));
        let occluded = (10..14).map(missing);
        let after = (14..20).map(|k| detected(k, 110.0 - 2.0 * (k - 14) as f64, -2.0));
        assert_eq!(accepted(before.chain(occluded).chain(after)), 16);
    }
}
