//! The ground truth of a simulated film.

use super::physics::{Collision, Motion};
use super::scenario::{ImpactSetup, Scenario, Shape};
use super::trajectory::{Pose, Trajectory, into_surface};
use crate::results::{BodyVelocity, Estimate, Impact, Phase, PointStatus, RigidStep};

/// Returns the phase of a collision at a time after the first frame's stamp, s; unknown for a motion without a collision.
///
/// Contact lasts from the first touch until the force returns to zero.
pub(super) fn phase_at(trajectory: &Trajectory, time_s: f64) -> Phase {
    let Trajectory::Impact { collision, start_s, .. } = trajectory else { return Phase::Unknown };
    let since_s = time_s - start_s;
    match since_s {
        _ if since_s < 0.0 => Phase::Flight,
        _ if since_s < collision.outcome().end_s => Phase::Contact,
        _ => Phase::Rebound,
    }
}

/// Returns `OutOfFrame` unless the body lies fully inside the image, `Occluded` if no part of it is visible, and
/// `Valid` otherwise.
///
/// A plane may be larger than the image. `visible` is the visible fraction of the body.
pub(super) fn frame_status(scenario: &Scenario, pose: &Pose, visible: f64) -> PointStatus {
    let half_width = scenario.radius_px();
    let half_height = scenario.body.rod.as_ref().map_or(half_width, |rod| 0.5 * (rod.patch_px[1] - rod.patch_px[0]));
    let fits = |center: f64, half: f64, length: u32| center - half >= -0.5 && center + half <= f64::from(length) - 0.5;
    let [x, y] = pose.center_px;
    match () {
        () if scenario.body.shape != Shape::Plane
            && !(fits(x, half_width, scenario.camera.width_px) && fits(y, half_height, scenario.camera.height_px)) =>
        {
            PointStatus::OutOfFrame
        }
        () if visible <= 0.0 => PointStatus::Occluded,
        () => PointStatus::Valid,
    }
}

/// Returns the rigid motion from one pose to the next (px, y down; deg), without uncertainties.
pub(super) fn rigid_step(here: &Pose, next: &Pose) -> RigidStep {
    RigidStep {
        dx_px: next.center_px[0] - here.center_px[0],
        dy_px: next.center_px[1] - here.center_px[1],
        dtheta_deg: (next.angle_rad - here.angle_rad).to_degrees(),
        ..RigidStep::STILL
    }
}

/// Returns the velocity of a pose in image and surface axes, with zero uncertainties. `tangent` is that of the
/// surface.
pub(super) fn body_velocity(pose: &Pose, tangent: [f64; 2]) -> BodyVelocity {
    let [vt_m_s, vn_m_s] = into_surface(pose.velocity_m_s, tangent);
    BodyVelocity {
        vx_m_s: pose.velocity_m_s[0],
        vy_m_s: pose.velocity_m_s[1],
        vn_m_s,
        vt_m_s,
        omega_rad_s: Some(pose.omega_rad_s),
        sigma_v_m_s: 0.0,
        sigma_omega_rad_s: Some(0.0),
        window_frames: 0,
        order: 0,
    }
}

/// Returns the exact results of a collision, with zero uncertainties; times count from the first stamp.
///
/// The tangential restitution is missing if the contact point does not slide at first. The caller sets body, origin and
/// force law.
pub(super) fn true_impact(collision: &Collision, setup: &ImpactSetup, radius_m: f64) -> Impact {
    let (start_s, mass_kg) = (setup.contact_start_s, setup.mass_kg);
    let (before, outcome) = (collision.motion_at(0.0), collision.outcome());
    let after = outcome.after;
    let exact = |value: f64| Some(Estimate { value, sigma: 0.0 });
    let speed2 = |motion: &Motion| motion.velocity_m_s.iter().map(|v| v * v).sum::<f64>();
    let contact_speed = |motion: &Motion| motion.velocity_m_s[0] + motion.omega_rad_s * radius_m;
    let contact_speed_before = contact_speed(&before);
    Impact {
        start_s: exact(start_s),
        deepest_s: exact(start_s + outcome.deepest_s),
        end_s: exact(start_s + outcome.end_s),
        vn_before_m_s: exact(before.velocity_m_s[1]),
        vn_after_m_s: exact(after.velocity_m_s[1]),
        vt_before_m_s: exact(before.velocity_m_s[0]),
        vt_after_m_s: exact(after.velocity_m_s[0]),
        omega_before_rad_s: exact(before.omega_rad_s),
        omega_after_rad_s: exact(after.omega_rad_s),
        restitution: exact(-after.velocity_m_s[1] / before.velocity_m_s[1]),
        restitution_tangential: (contact_speed_before.abs() > 0.0)
            .then(|| Estimate { value: -contact_speed(&after) / contact_speed_before, sigma: 0.0 }),
        impulse_ratio: exact(outcome.impulse_n_s[0] / outcome.impulse_n_s[1]),
        contact_time_s: exact(outcome.end_s),
        compression_max_mm: exact(outcome.compression_max_m * 1e3),
        acceleration_max_m_s2: exact(outcome.acceleration_max_m_s2),
        slip_end_s: outcome.slip_end_s.and_then(|slip_end_s| exact(start_s + slip_end_s)),
        force_start_s: exact(start_s + outcome.force_times_s[0]),
        force_end_s: exact(start_s + outcome.force_times_s[1]),
        force_max_n: exact(outcome.force_max_n),
        energy_lost_j: exact(0.5 * mass_kg * (speed2(&before) - speed2(&after))),
        status: PointStatus::Valid,
        ..Impact::unknown(0, 0, 0)
    }
}
