//! Displacement fields: a header for the body and its step, and a slice of points.

use super::{Number, RodMessage};
use crate::results::{
    BodyStep, Circle, Displacement, Estimate, FieldPoint, PairField, PointStatus, RigidStep, field_row,
};
use iceoryx2::prelude::ZeroCopySend;

/// One body in one frame, its outline and its motion to the next frame.
#[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
#[type_name("ricochet.FieldHeader.v7")]
#[repr(C)]
pub struct FieldHeader {
    /// Which start of the acquire process the frames belong to.
    pub run_id: u64,
    /// Sequence number of the reference frame.
    pub sequence: u64,
    /// Sequence number of the target frame; equal to `sequence` when there is no field.
    pub target_sequence: u64,
    /// Exposure start of the reference frame, ns since the Unix epoch.
    pub stamp_ns: u64,
    /// Index of the body in the rig's configuration.
    pub body: u32,
    /// The interval the motion was measured over, frames.
    pub interval_frames: u32,
    /// Number of the body's `PointStatus`.
    pub status: u32,
    /// Subsets the step rests on.
    pub points: u32,
    /// Index of the worker that measured it.
    pub worker: u32,
    /// When the circle below was measured: 1, or 2 where the share in sight is not its rim's; 3 and 4 where it was carried
    /// by its motion.
    pub circle_known: u32,
    /// When the step below was measured: 1 from subsets, 2 as a match of the whole body with a kept reference.
    pub step_known: u32,
    /// How long the frame was exposed, ns; 0 when that is not known.
    pub exposure_ns: u32,
    /// Centre, px.
    pub center_x_px: f64,
    /// Centre, px (down).
    pub center_y_px: f64,
    /// Radius, px.
    pub radius_px: f64,
    /// Standard uncertainty of each centre coordinate, px.
    pub sigma_center_px: f64,
    /// Standard uncertainty of the radius, px.
    pub sigma_radius_px: f64,
    /// Share of the disc that is not hidden.
    pub visible_fraction: f64,
    /// The same by the rim alone.
    pub rim_fraction: f64,
    /// Motion of the centre along x, px/frame.
    pub dx_px: f64,
    /// Motion of the centre along y (down), px/frame.
    pub dy_px: f64,
    /// Rotation, counter-clockwise on the screen, deg/frame.
    pub dtheta_deg: f64,
    /// Standard uncertainty of `dx_px`.
    pub sigma_dx_px: f64,
    /// Standard uncertainty of `dy_px`.
    pub sigma_dy_px: f64,
    /// Standard uncertainty of `dtheta_deg`.
    pub sigma_dtheta_deg: f64,
    /// By which share the sensor's pattern makes short steps shorter, as this frame shows it.
    pub fixed_fraction: Number,
    /// By which share a frame the body grows in the picture ...
    pub growth_fraction: Number,
    /// ... and its standard uncertainty.
    pub sigma_growth_fraction: f64,
    /// By how much a frame a ball's centre moves beside what the step says along x, px, ...
    pub drift_x_px: Number,
    /// ... along y ...
    pub drift_y_px: Number,
    /// ... and the standard uncertainty of both.
    pub sigma_drift_px: f64,
    /// By how much a frame it turns beside that, deg, ...
    pub drift_deg: Number,
    /// ... and its standard uncertainty.
    pub sigma_drift_deg: f64,
    /// The rod, where the body is one.
    pub rod: RodMessage,
}

impl FieldHeader {
    /// The header of a measured step and its field.
    pub fn new(step: &BodyStep, field: Option<&PairField>, run_id: u64, worker: u32) -> Self {
        let mut header = Self {
            run_id,
            sequence: step.frame,
            target_sequence: field.map_or(step.frame, |field| field.target_frame),
            stamp_ns: step.stamp_ns,
            body: step.body,
            interval_frames: step.interval_frames,
            status: step.status as u32,
            worker,
            fixed_fraction: step.fixed_fraction.into(),
            growth_fraction: step.growth_fraction.map(|growth| growth.value).into(),
            sigma_growth_fraction: step.growth_fraction.map_or(0.0, |growth| growth.sigma),
            drift_x_px: step.drift.map(|drift| drift[0].value).into(),
            drift_y_px: step.drift.map(|drift| drift[1].value).into(),
            sigma_drift_px: step.drift.map_or(0.0, |drift| drift[0].sigma),
            drift_deg: step.drift.map(|drift| drift[2].value).into(),
            sigma_drift_deg: step.drift.map_or(0.0, |drift| drift[2].sigma),
            rod: step.rod.into(),
            ..Self::default()
        };
        if let Some(circle) = step.circle {
            header.circle_known = 1 + u32::from(step.rim_fraction.is_some()) + 2 * u32::from(step.is_carried);
            header.rim_fraction = step.rim_fraction.unwrap_or(circle.visible_fraction);
            header.center_x_px = circle.x_px;
            header.center_y_px = circle.y_px;
            header.radius_px = circle.radius_px;
            header.sigma_center_px = circle.sigma_center_px;
            header.sigma_radius_px = circle.sigma_radius_px;
            header.visible_fraction = circle.visible_fraction;
        }
        if let Some(motion) = step.step {
            header.step_known = 1 + u32::from(step.is_whole);
            header.dx_px = motion.dx_px;
            header.dy_px = motion.dy_px;
            header.dtheta_deg = motion.dtheta_deg;
            header.sigma_dx_px = motion.sigma_dx_px;
            header.sigma_dy_px = motion.sigma_dy_px;
            header.sigma_dtheta_deg = motion.sigma_dtheta_deg;
            header.points = motion.points;
        }
        header
    }

    /// The step it tells; `None` when the status is not one of ours.
    pub fn step(&self) -> Option<BodyStep> {
        let circle = matches!(self.circle_known, 1..=4).then_some(Circle {
            x_px: self.center_x_px,
            y_px: self.center_y_px,
            radius_px: self.radius_px,
            sigma_center_px: self.sigma_center_px,
            sigma_radius_px: self.sigma_radius_px,
            visible_fraction: self.visible_fraction,
        });
        let step = matches!(self.step_known, 1 | 2).then_some(RigidStep {
            dx_px: self.dx_px,
            dy_px: self.dy_px,
            dtheta_deg: self.dtheta_deg,
            sigma_dx_px: self.sigma_dx_px,
            sigma_dy_px: self.sigma_dy_px,
            sigma_dtheta_deg: self.sigma_dtheta_deg,
            points: self.points,
        });
        Some(BodyStep {
            is_carried: self.circle_known > 2,
            is_whole: self.step_known == 2,
            fixed_fraction: self.fixed_fraction.into(),
            growth_fraction: Option::<f64>::from(self.growth_fraction)
                .map(|value| Estimate { value, sigma: self.sigma_growth_fraction }),
            drift: self.drift(),
            rim_fraction: matches!(self.circle_known, 2 | 4).then_some(self.rim_fraction),
            frame: self.sequence,
            stamp_ns: self.stamp_ns,
            body: self.body,
            interval_frames: self.interval_frames,
            circle,
            rod: self.rod.into(),
            step,
            status: PointStatus::from_number(self.status)?,
        })
    }

    fn drift(&self) -> Option<[Estimate; 3]> {
        let (x, y): (Option<f64>, Option<f64>) = (self.drift_x_px.into(), self.drift_y_px.into());
        let (place, turn) = (self.sigma_drift_px, self.sigma_drift_deg);
        let along = |value: Option<f64>, sigma: f64| value.map(|value| Estimate { value, sigma });
        Some([along(x, place)?, along(y, place)?, along(self.drift_deg.into(), turn)?])
    }

    /// The field it heads; `None` when there is none.
    pub fn field(&self, points: &[FieldPointMessage]) -> Option<PairField> {
        (self.target_sequence != self.sequence).then(|| PairField {
            frame: self.sequence,
            target_frame: self.target_sequence,
            stamp_ns: self.stamp_ns,
            body: self.body,
            points: points.iter().map(FieldPoint::from).collect(),
        })
    }
}

/// The value of a number that is missing.
const MISSING: f32 = -2.0;

/// Returns the number unless it is [`MISSING`].
fn present(number: f32) -> Option<f32> {
    (number > MISSING).then_some(number)
}

/// Derives the message of a subset from the columns of the row.
macro_rules! field_message {
    (
        position { $($(#[$position_doc:meta])* $position:ident = $position_tag:tt,)* }
        displacement { $($(#[$part_doc:meta])* $part:ident = $part_tag:tt,)* }
        sigmas { $($(#[$sigma_doc:meta])* $sigma:ident = $sigma_tag:tt,)* }
        scores { $($(#[$score_doc:meta])* $score:ident = $score_tag:tt,)* }
        status = $status_tag:tt,
    ) => {
        /// One subset of a field. Displacements hold only where their uncertainties are not missing; missing numbers are -2.
        #[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
        #[type_name("ricochet.FieldPoint.v1")]
        #[repr(C)]
        pub struct FieldPointMessage {
            $($(#[$position_doc])* pub $position: f32,)*
            $($(#[$part_doc])* pub $part: f32,)*
            $($(#[$sigma_doc])* pub $sigma: f32,)*
            $($(#[$score_doc])* pub $score: f32,)*
            /// The number of the `PointStatus`.
            pub status: u32,
        }

        impl From<&FieldPoint> for FieldPointMessage {
            fn from(point: &FieldPoint) -> Self {
                Self {
                    $($position: point.$position,)*
                    $($part: point.displacement.map_or(0.0, |displacement| displacement.$part),)*
                    $($sigma: point.displacement.map_or(MISSING, |displacement| displacement.$sigma),)*
                    $($score: point.$score.unwrap_or(MISSING),)*
                    status: point.status as u32,
                }
            }
        }

        impl From<&FieldPointMessage> for FieldPoint {
            fn from(message: &FieldPointMessage) -> Self {
                let displacement = || {
                    Some(Displacement {
                        $($part: message.$part,)*
                        $($sigma: present(message.$sigma)?,)*
                    })
                };
                Self {
                    $($position: message.$position,)*
                    displacement: displacement(),
                    $($score: present(message.$score),)*
                    status: PointStatus::from_number(message.status).unwrap_or(PointStatus::Lost),
                }
            }
        }
    };
}

field_row!(field_message);

const _: () = assert!(size_of::<Number>() == 16 && size_of::<FieldPointMessage>() == 36);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_that_a_step_tells_crosses_the_border() {
        let circle = Circle {
            x_px: 1.0,
            y_px: 2.0,
            radius_px: 3.0,
            sigma_center_px: 0.1,
            sigma_radius_px: 0.2,
            visible_fraction: 0.7,
        };
        let motion = RigidStep { dx_px: 4.0, dy_px: 5.0, dtheta_deg: 6.0, points: 7, ..RigidStep::STILL };
        let step = BodyStep {
            is_carried: false,
            is_whole: true,
            rim_fraction: Some(0.9),
            fixed_fraction: Some(-2.5e-4),
            growth_fraction: Some(Estimate { value: 3e-5, sigma: 4e-6 }),
            drift: Some([(0.11, 0.01), (-0.07, 0.01), (0.02, 0.003)].map(|(value, sigma)| Estimate { value, sigma })),
            frame: 8,
            stamp_ns: 9,
            body: 10,
            interval_frames: 11,
            circle: Some(circle),
            rod: None,
            step: Some(motion),
            status: PointStatus::Occluded,
        };
        let carried = BodyStep { is_carried: true, ..step };
        for step in
            [step, BodyStep { is_whole: false, ..step }, step.without_motion(), carried, carried.without_motion()]
        {
            assert_eq!(FieldHeader::new(&step, None, 12, 13).step(), Some(step));
        }
    }
}
