//! The `velocity` topic.

use super::Number;
use crate::results::{BodyVelocity, Phase, PointStatus, RigidStep, VelocitySample};
use iceoryx2::prelude::ZeroCopySend;

/// One row of the `velocity` table: one body in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
#[type_name("ricochet.Velocity.v1")]
#[repr(C)]
pub struct VelocityMessage {
    /// Which start of the acquire process the frame belongs to.
    pub run_id: u64,
    /// Sequence number of the frame.
    pub sequence: u64,
    /// Exposure start, ns since the Unix epoch.
    pub stamp_ns: u64,
    /// Index of the body in the rig's configuration.
    pub body: u32,
    /// Number of the `PointStatus`.
    pub status: u32,
    /// Number of the `Phase`.
    pub phase: u32,
    /// Subsets the unsmoothed step rests on.
    pub points: u32,
    /// Frames the local fit spanned.
    pub window_frames: u32,
    /// Order of the polynomial fitted to the positions.
    pub order: u32,
    /// Centre, px.
    pub center_x_px: Number,
    /// Centre, px (down).
    pub center_y_px: Number,
    /// Radius, px.
    pub radius_px: Number,
    /// Unsmoothed motion of the centre to the next frame along x, px.
    pub dx_px: Number,
    /// Along y (down), px.
    pub dy_px: Number,
    /// Unsmoothed rotation to the next frame, counter-clockwise on the screen, deg.
    pub dtheta_deg: Number,
    /// Standard uncertainty of `dx_px`.
    pub sigma_dx_px: Number,
    /// Standard uncertainty of `dy_px`.
    pub sigma_dy_px: Number,
    /// Standard uncertainty of `dtheta_deg`.
    pub sigma_dtheta_deg: Number,
    /// Smoothed velocity along x, m/s.
    pub vx_m_s: Number,
    /// Along y (up), m/s.
    pub vy_m_s: Number,
    /// Along the surface's outward normal, m/s.
    pub vn_m_s: Number,
    /// Along the surface's tangent, m/s.
    pub vt_m_s: Number,
    /// Spin, counter-clockwise positive, rad/s.
    pub omega_rad_s: Number,
    /// Standard uncertainty of each velocity component, m/s.
    pub sigma_v_m_s: Number,
    /// Standard uncertainty of the spin, rad/s.
    pub sigma_omega_rad_s: Number,
    /// Share of the body that is not hidden.
    pub visible_fraction: Number,
}

impl VelocityMessage {
    /// The message of a sample of this run.
    pub fn new(sample: &VelocitySample, run_id: u64) -> Self {
        let step = sample.step;
        let velocity = sample.velocity;
        let of_step = |number: fn(&RigidStep) -> f64| Number::from(step.as_ref().map(number));
        let of_velocity = |number: fn(&BodyVelocity) -> f64| Number::from(velocity.as_ref().map(number));
        Self {
            run_id,
            sequence: sample.frame,
            stamp_ns: sample.stamp_ns,
            body: sample.body,
            status: sample.status as u32,
            phase: sample.phase as u32,
            points: step.map_or(0, |step| step.points),
            window_frames: velocity.map_or(0, |velocity| velocity.window_frames),
            order: velocity.map_or(0, |velocity| velocity.order),
            center_x_px: sample.center_x_px.into(),
            center_y_px: sample.center_y_px.into(),
            radius_px: sample.radius_px.into(),
            dx_px: of_step(|step| step.dx_px),
            dy_px: of_step(|step| step.dy_px),
            dtheta_deg: of_step(|step| step.dtheta_deg),
            sigma_dx_px: of_step(|step| step.sigma_dx_px),
            sigma_dy_px: of_step(|step| step.sigma_dy_px),
            sigma_dtheta_deg: of_step(|step| step.sigma_dtheta_deg),
            vx_m_s: of_velocity(|velocity| velocity.vx_m_s),
            vy_m_s: of_velocity(|velocity| velocity.vy_m_s),
            vn_m_s: of_velocity(|velocity| velocity.vn_m_s),
            vt_m_s: of_velocity(|velocity| velocity.vt_m_s),
            omega_rad_s: of_velocity(|velocity| velocity.omega_rad_s),
            sigma_v_m_s: of_velocity(|velocity| velocity.sigma_v_m_s),
            sigma_omega_rad_s: of_velocity(|velocity| velocity.sigma_omega_rad_s),
            visible_fraction: sample.visible_fraction.into(),
        }
    }

    /// The sample it tells; `None` when a number in it is not one of ours.
    pub fn sample(&self) -> Option<VelocitySample> {
        Some(VelocitySample {
            frame: self.sequence,
            body: self.body,
            stamp_ns: self.stamp_ns,
            center_x_px: self.center_x_px.into(),
            center_y_px: self.center_y_px.into(),
            radius_px: self.radius_px.into(),
            step: self.step(),
            velocity: self.velocity(),
            visible_fraction: self.visible_fraction.into(),
            phase: Phase::from_number(self.phase)?,
            status: PointStatus::from_number(self.status)?,
        })
    }

    fn step(&self) -> Option<RigidStep> {
        Some(RigidStep {
            dx_px: Option::from(self.dx_px)?,
            dy_px: Option::from(self.dy_px)?,
            dtheta_deg: Option::from(self.dtheta_deg)?,
            sigma_dx_px: Option::from(self.sigma_dx_px)?,
            sigma_dy_px: Option::from(self.sigma_dy_px)?,
            sigma_dtheta_deg: Option::from(self.sigma_dtheta_deg)?,
            points: self.points,
        })
    }

    fn velocity(&self) -> Option<BodyVelocity> {
        Some(BodyVelocity {
            vx_m_s: Option::from(self.vx_m_s)?,
            vy_m_s: Option::from(self.vy_m_s)?,
            vn_m_s: Option::from(self.vn_m_s)?,
            vt_m_s: Option::from(self.vt_m_s)?,
            omega_rad_s: Option::from(self.omega_rad_s)?,
            sigma_v_m_s: Option::from(self.sigma_v_m_s)?,
            sigma_omega_rad_s: Option::from(self.sigma_omega_rad_s)?,
            window_frames: self.window_frames,
            order: self.order,
        })
    }
}
