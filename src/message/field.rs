//! The `field` topic: a header with the step of a body, and a slice of subsets.

use super::layout::described;
use super::{Number, RodMessage};
use crate::image::FrameMeta;
use crate::results::{
    BodyStep, Circle, Displacement, Estimate, FieldPoint, MotionMethod, Outline, OutlineOrigin, OutlineShape,
    PairField, PointStatus, RigidStep, field_row,
};
use iceoryx2::prelude::ZeroCopySend;

described! {
    "ricochet.FieldHeader.v9"
    /// One body in one frame, with its outline and its motion to the target frame.
    ///
    /// # Examples
    ///
    /// ```no_run
    /// use ricochet::bus::Bus;
    /// use ricochet::results::PointStatus;
    ///
    /// let bus = Bus::join("lacrosse", "example")?;
    /// let fields = bus.listen_field()?;
    /// while let Some((header, field)) = fields.take()? {
    ///     match field {
    ///         Some(field) => println!("frame {}: {} subsets", header.sequence, field.points.len()),
    ///         None if header.skipped_frames == 1 => println!("frame {}: left out", header.sequence),
    ///         None => println!("frame {}: {:?}", header.sequence, PointStatus::from_number(header.status)),
    ///     }
    /// }
    /// # Ok::<(), ricochet::bus::BusError>(())
    /// ```
    #[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
    #[repr(C)]
    pub struct FieldHeader {
        /// The start of the acquire process that the frames belong to.
        pub run_id: u64,
        /// The sequence number of the reference frame.
        pub sequence: u64,
        /// The sequence number of the target frame; equal to `sequence` when there is no field.
        pub target_sequence: u64,
        /// The start of the reference frame's exposure, ns since the Unix epoch.
        pub stamp_ns: u64,
        /// The index of the body in the rig's configuration.
        pub body: u32,
        /// The interval that the motion is measured over, frames.
        pub interval_frames: u32,
        /// The number of the body's `PointStatus`.
        pub status: u32,
        /// The number of subsets that the motion rests on.
        pub points: u32,
        /// The index of the worker that measured it.
        pub worker: u32,
        /// The kind of the outline below: 0 for none, else 1 + 2 x the number of its `OutlineOrigin`, and 1 more where the visible
        /// share is not that of its rim.
        pub outline: u32,
        /// The number of the `MotionMethod` of the motion below; 0 for none.
        pub method: u32,
        /// The exposure time of the frame, ns; 0 when it is unknown.
        pub exposure_ns: u32,
        /// The number of the `PointStatus` of the rotation below.
        pub rotation_status: u32,
        /// 1 for a frame that was left out because the worker was too slow; then only frame, stamp and worker have a meaning.
        pub skipped_frames: u32,
        /// The centre of the circle along x, px. The circle has no meaning when there is a rod.
        pub center_x_px: f64,
        /// The centre of the circle along y (down), px.
        pub center_y_px: f64,
        /// The radius of the circle, px.
        pub radius_px: f64,
        /// The standard uncertainty of each centre coordinate, px.
        pub sigma_center_px: f64,
        /// The standard uncertainty of the radius, px.
        pub sigma_radius_px: f64,
        /// The visible share of the disc.
        pub visible_fraction: f64,
        /// The visible share of the rim.
        pub rim_fraction: f64,
        /// The motion of the centre along x, px/frame.
        pub dx_px: f64,
        /// The motion of the centre along y (down), px/frame.
        pub dy_px: f64,
        /// The rotation, counter-clockwise on the screen, deg/frame.
        pub dtheta_deg: f64,
        /// The standard uncertainty of `dx_px`.
        pub sigma_dx_px: f64,
        /// The standard uncertainty of `dy_px`.
        pub sigma_dy_px: f64,
        /// The standard uncertainty of `dtheta_deg`.
        pub sigma_dtheta_deg: f64,
        /// The share by which short steps are underestimated because of the sensor's fixed pattern.
        pub fixed_fraction: Number,
        /// The share by which light may have held back the rotation.
        pub light_fraction: Number,
        /// The distance from the centre of the point that light or stripes may hold in place while the body turns, px.
        pub pull_px: Number,
        /// The relative growth of the image of the body per frame.
        pub growth_fraction: Number,
        /// The standard uncertainty of `growth_fraction`.
        pub sigma_growth_fraction: f64,
        /// The motion of a ball's centre relative to the motion above along x, px/frame.
        pub drift_x_px: Number,
        /// The same along y (down), px/frame.
        pub drift_y_px: Number,
        /// The standard uncertainty of both, px/frame.
        pub sigma_drift_px: f64,
        /// The rotation of a ball relative to the motion above, deg/frame.
        pub drift_deg: Number,
        /// The standard uncertainty of `drift_deg`, deg/frame.
        pub sigma_drift_deg: f64,
        /// The rotation of a patch since the image that it was drawn in, deg.
        pub angle_deg: Number,
        /// The standard uncertainty of `angle_deg`, deg.
        pub sigma_angle_deg: f64,
        /// The rod, if the body is one.
        pub rod: RodMessage,
    }
}

impl FieldHeader {
    /// Creates the header of a measured step and its field, `None` if it has none.
    ///
    /// `run_id` is the start of the acquire process, `worker` the index of the worker, from 0.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn new(step: &BodyStep, field: Option<&PairField>, run_id: u64, worker: u32) -> Self {
        let mut header = Self {
            run_id,
            sequence: step.frame,
            target_sequence: field.map_or(step.frame, |field| field.target_frame),
            stamp_ns: step.stamp_ns,
            body: step.body,
            interval_frames: step.interval_frames,
            status: step.status as u32,
            rotation_status: step.rotation_status as u32,
            worker,
            fixed_fraction: step.fixed_fraction.into(),
            light_fraction: step.light_fraction.into(),
            pull_px: step.pull_px.into(),
            growth_fraction: step.growth_fraction.map(|growth| growth.value).into(),
            sigma_growth_fraction: step.growth_fraction.map_or(0.0, |growth| growth.sigma),
            drift_x_px: step.drift.map(|drift| drift[0].value).into(),
            drift_y_px: step.drift.map(|drift| drift[1].value).into(),
            sigma_drift_px: step.drift.map_or(0.0, |drift| drift[0].sigma),
            drift_deg: step.drift.map(|drift| drift[2].value).into(),
            sigma_drift_deg: step.drift.map_or(0.0, |drift| drift[2].sigma),
            angle_deg: step.angle_deg.map(|angle| angle.value).into(),
            sigma_angle_deg: step.angle_deg.map_or(0.0, |angle| angle.sigma),
            rod: step.rod().into(),
            ..Self::default()
        };
        if let Some(outline) = step.outline {
            header.outline = 1 + 2 * outline.origin as u32 + u32::from(outline.rim_fraction.is_some());
        }
        if let Some(circle) = step.circle() {
            let rim_fraction = step.outline.and_then(|outline| outline.rim_fraction);
            header.rim_fraction = rim_fraction.unwrap_or(circle.visible_fraction);
            header.center_x_px = circle.x_px;
            header.center_y_px = circle.y_px;
            header.radius_px = circle.radius_px;
            header.sigma_center_px = circle.sigma_center_px;
            header.sigma_radius_px = circle.sigma_radius_px;
            header.visible_fraction = circle.visible_fraction;
        }
        if let Some(motion) = step.motion {
            header.method = step.method as u32;
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

    /// Creates the header of a frame that was left out by worker `worker`, from 0, because it was too slow.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn skipped(meta: &FrameMeta, run_id: u64, worker: u32) -> Self {
        Self {
            run_id,
            sequence: meta.sequence,
            target_sequence: meta.sequence,
            stamp_ns: meta.stamp_ns,
            status: PointStatus::Lost as u32,
            worker,
            skipped_frames: 1,
            ..Self::default()
        }
    }

    /// Returns the step; `None` when the number of one of its statuses, of the origin or of the method is unknown.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn step(&self) -> Option<BodyStep> {
        let outline = match self.outline.checked_sub(1) {
            Some(kind) => Some(Outline {
                shape: Option::from(self.rod).map_or(OutlineShape::Circle(self.circle()), OutlineShape::Rod),
                origin: OutlineOrigin::from_number(kind / 2)?,
                rim_fraction: (kind % 2 == 1).then_some(self.rim_fraction),
            }),
            None => None,
        };
        let (motion, method) = match self.method {
            0 => (None, MotionMethod::default()),
            method => (Some(self.motion()), MotionMethod::from_number(method)?),
        };
        let growth: Option<f64> = self.growth_fraction.into();
        let angle: Option<f64> = self.angle_deg.into();
        Some(BodyStep {
            frame: self.sequence,
            stamp_ns: self.stamp_ns,
            body: self.body,
            interval_frames: self.interval_frames,
            outline,
            angle_deg: angle.map(|value| Estimate { value, sigma: self.sigma_angle_deg }),
            motion,
            method,
            fixed_fraction: self.fixed_fraction.into(),
            light_fraction: self.light_fraction.into(),
            pull_px: self.pull_px.into(),
            growth_fraction: growth.map(|value| Estimate { value, sigma: self.sigma_growth_fraction }),
            drift: self.drift(),
            rotation_status: PointStatus::from_number(self.rotation_status)?,
            status: PointStatus::from_number(self.status)?,
        })
    }

    /// Returns the circle of the outline; it has no meaning when there is a rod or no outline.
    fn circle(&self) -> Circle {
        Circle {
            x_px: self.center_x_px,
            y_px: self.center_y_px,
            radius_px: self.radius_px,
            sigma_center_px: self.sigma_center_px,
            sigma_radius_px: self.sigma_radius_px,
            visible_fraction: self.visible_fraction,
        }
    }

    /// Returns the motion; it has no meaning when `method` is 0.
    fn motion(&self) -> RigidStep {
        RigidStep {
            dx_px: self.dx_px,
            dy_px: self.dy_px,
            dtheta_deg: self.dtheta_deg,
            sigma_dx_px: self.sigma_dx_px,
            sigma_dy_px: self.sigma_dy_px,
            sigma_dtheta_deg: self.sigma_dtheta_deg,
            points: self.points,
        }
    }

    /// Returns the drift of a ball's centre and rotation relative to the motion: x and y (down) in px/frame, deg/frame.
    /// `None` when any of them is missing.
    fn drift(&self) -> Option<[Estimate; 3]> {
        let estimate = |number: Number, sigma| Option::<f64>::from(number).map(|value| Estimate { value, sigma });
        let (sigma_px, sigma_deg) = (self.sigma_drift_px, self.sigma_drift_deg);
        Some([
            estimate(self.drift_x_px, sigma_px)?,
            estimate(self.drift_y_px, sigma_px)?,
            estimate(self.drift_deg, sigma_deg)?,
        ])
    }

    /// Returns the field of this header with these points, the payload of the message.
    ///
    /// `None` when the step has no field.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
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

/// Returns a number as stored in a message; `None` when it is [`MISSING`], below it or NaN.
fn stored_number(stored: f32) -> Option<f32> {
    (stored > MISSING).then_some(stored)
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
        described! {
            "ricochet.FieldPoint.v1"
            /// One subset of a field. Displacements hold only where their uncertainties are not missing; missing numbers are -2.
            #[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
            #[repr(C)]
            pub struct FieldPointMessage {
                $($(#[$position_doc])* pub $position: f32,)*
                $($(#[$part_doc])* pub $part: f32,)*
                $($(#[$sigma_doc])* pub $sigma: f32,)*
                $($(#[$score_doc])* pub $score: f32,)*
                /// The number of the `PointStatus`.
                pub status: u32,
            }
        }

        impl From<&FieldPoint> for FieldPointMessage {
            /// Returns the message of a subset. Without a displacement, it holds 0 with uncertainties that are missing.
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
            /// Returns the subset of a message: lost if the number of its status is unknown.
            fn from(message: &FieldPointMessage) -> Self {
                let displacement = || {
                    Some(Displacement {
                        $($part: message.$part,)*
                        $($sigma: stored_number(message.$sigma)?,)*
                    })
                };
                Self {
                    $($position: message.$position,)*
                    displacement: displacement(),
                    $($score: stored_number(message.$score),)*
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
    use crate::results::{ROD_EDGES, Rod};

    #[test]
    fn a_step_survives_the_bus() {
        let circle = Circle {
            x_px: 1.0,
            y_px: 2.0,
            radius_px: 3.0,
            sigma_center_px: 0.1,
            sigma_radius_px: 0.2,
            visible_fraction: 0.7,
        };
        let estimate = Estimate { value: 5.5, sigma: 0.5 };
        let rod = Rod {
            x_px: estimate,
            y_px: estimate,
            half_width_px: estimate,
            tilt_deg: estimate,
            edges: [None; ROD_EDGES],
        };
        let motion = RigidStep { dx_px: 4.0, dy_px: 5.0, dtheta_deg: 6.0, points: 7, ..RigidStep::STILL };
        let shape = OutlineShape::Circle(circle);
        let step = BodyStep {
            frame: 8,
            stamp_ns: 9,
            body: 10,
            interval_frames: 11,
            outline: Some(Outline { rim_fraction: Some(0.9), ..Outline::new(shape, OutlineOrigin::Detected) }),
            angle_deg: Some(Estimate { value: 12.0, sigma: 0.01 }),
            motion: Some(motion),
            method: MotionMethod::WholeBody,
            fixed_fraction: Some(-2.5e-4),
            light_fraction: Some(3e-3),
            pull_px: Some(0.4),
            growth_fraction: Some(Estimate { value: 3e-5, sigma: 4e-6 }),
            drift: Some([(0.11, 0.01), (-0.07, 0.01), (0.02, 0.003)].map(|(value, sigma)| Estimate { value, sigma })),
            rotation_status: PointStatus::LowContrast,
            status: PointStatus::Occluded,
        };
        let origins = OutlineOrigin::ALL.map(|origin| Some(Outline::new(shape, origin)));
        let outlines = [step.outline, None].into_iter().chain(origins).map(|outline| BodyStep { outline, ..step });
        let rod = BodyStep { outline: Some(rod.into()), method: MotionMethod::Subsets, ..step };
        for step in outlines.chain([rod, step.without_motion()]) {
            assert_eq!(FieldHeader::new(&step, None, 12, 13).step(), Some(step));
        }
    }
}
