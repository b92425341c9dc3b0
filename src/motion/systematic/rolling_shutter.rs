//! The correction for cameras that expose the rows of a frame one after another.

use crate::motion::{Form, PixelRates, Pose, Shutter};
use crate::results::{BodyStep, Circle, Estimate, Impact, Outline, OutlineShape, RigidStep, Rod};

/// The weight of the measured position of a ball against its propagated one in the estimate of its row.
const ROW_FILTER_WEIGHT: f64 = 0.1;
/// The uncertainty of a speed at the frame between two steps, as a share of the change from one to the next.
const SPEED_CHANGE_SHARE: f64 = 0.3;
/// The uncertainty of the centre of an occluded ball, per occluded fraction and stretch of the outline. A circle fitted
/// to half of an ellipse with unit elongation is off by 1.1.
const OCCLUDED_CENTER_ERROR: f64 = 2.2;
/// The centre error of a circle that follows a part of an elongated outline, per unit of elongation.
const PARTIAL_FIT_ERROR: f64 = 0.4;
/// The radius error of an elongated outline, per square of the elongation.
const RADIUS_ERROR: f64 = 0.2;
/// The centre error of a ball struck while its rows are exposed, as a share of its radius' rows.
const STRUCK_ERROR: f64 = 0.1;
/// The weighted mean square of the lateral offset of a ball's subsets, in radii, and its uncertainty.
const LATERAL_MEAN_SQUARE: f64 = 0.2;
const LATERAL_MEAN_SQUARE_SIGMA: f64 = 0.04;
/// The share of the same that subsets attribute to a rotation out of the plane.
const FRONT_SHARE: f64 = 0.6;
/// Half a subset, px; the share of a disc beyond a chord over its height in radii to the power of 1.5; and the
/// additional error of a rotation from its strain.
const SUBSET_PX: f64 = 16.0;
const CAP_AREA_FACTOR: f64 = 0.6;
const STRAIN_ROTATION_FACTOR: f64 = 2.0;
/// The lateral offset of half a ball from the centre, in radii.
const HALF_BALL_OFFSET: f64 = 0.4;
/// The offset of a whole ball's effective row from its centre, in radii, since its pattern is uneven.
const EFFECTIVE_ROW_OFFSET: f64 = 0.02;
/// The minimum time between two images of a body, frame periods. A body that moves up as fast as the rows are read is not
/// imaged again.
const MIN_IMAGE_INTERVAL: f64 = 0.1;
/// The minimum height of a distorted ball, relative to its own.
const MIN_HEIGHT: f64 = 0.1;

/// The distortion of a body's image by the row timing, as a share of its size.
#[derive(Debug, Clone, Copy)]
struct Distortion {
    /// Along x, per height.
    shear: f64,
    /// Along y.
    elongation: f64,
}

impl Distortion {
    fn length(self) -> f64 {
        self.shear.hypot(self.elongation)
    }
}

/// Returns the fraction of a ball without subsets, 0 to 1: the larger of the occluded part and the part too near the
/// image border.
fn untracked_fraction(shutter: &Shutter, circle: &Circle) -> f64 {
    let beyond_px =
        |at: f64, last: f64| (circle.radius_px + SUBSET_PX - at).max(at + circle.radius_px + SUBSET_PX - last);
    let beyond_px = shutter.last_px.map_or(0.0, |[x, y]| beyond_px(circle.x_px, x).max(beyond_px(circle.y_px, y)));
    let share = CAP_AREA_FACTOR * (beyond_px.max(0.0) / circle.radius_px.max(1.0)).powf(1.5);
    (1.0 - circle.visible_fraction).max(share).min(1.0)
}

/// The effect of the row timing on one body.
///
/// A body is imaged at the moment its own row is exposed. One that moves by u rows per frame is imaged 1 + u T frame
/// periods later in the next frame, where T is the row time in frame periods. Within a frame its lower rows are later,
/// so it is elongated by u T, and sheared by its lateral motion per frame times T. On a rotating body, points that move
/// down are followed for longer than points that move up, so it seems to sink.
#[derive(Debug, Clone)]
pub struct RollingShutter {
    shutter: Shutter,
    form: Form,
    /// The row of its centre.
    row_px: Option<f64>,
    /// The frame of its last row.
    frame: u64,
    /// Its displacement in the newest frame and the one before, px.
    moved_px: Option<[[f64; 2]; 2]>,
    /// Whether the newest frame has a step.
    has_motion: bool,
    /// Its radius, px, and the share of it that is not followed.
    radius_px: f64,
    unfollowed_fraction: f64,
    /// The maximum offset of its effective row from its centre since a contact began, px.
    row_offset_px: f64,
    /// Its apparent angle at the start, rad.
    first_rad: Option<f64>,
}

impl RollingShutter {
    /// Creates the correction for this shutter and kind of body.
    pub fn new(shutter: Shutter, form: Form) -> Self {
        Self {
            shutter,
            form,
            row_px: None,
            frame: 0,
            moved_px: None,
            has_motion: false,
            radius_px: 0.0,
            unfollowed_fraction: 0.0,
            row_offset_px: 0.0,
            first_rad: None,
        }
    }

    /// Adds the next step in frame order, in the recorded image. Returns the delay of the exposure of its centre after
    /// the stamp, frame periods.
    pub fn push(&mut self, step: &BodyStep) -> f64 {
        self.row_px = self.predicted_row(step);
        self.frame = step.frame;
        if let Some(circle) = step.circle() {
            (self.radius_px, self.unfollowed_fraction) = (circle.radius_px, untracked_fraction(&self.shutter, &circle));
        }
        // The occluded part lies to one side of the rest.
        let row_offset_px =
            |circle: Circle| circle.radius_px * EFFECTIVE_ROW_OFFSET.hypot(1.0 - circle.visible_fraction);
        self.row_offset_px = self.row_offset_px.max(step.circle().map_or(0.0, row_offset_px));
        let moved_px = step.center_motion().map(|step| [step.dx_px, step.dy_px]);
        let moved_px = moved_px.filter(|moved| moved.iter().all(|px| px.is_finite()));
        let before_px = self.moved_px.map(|[newest, _]| newest);
        // A body that was lost may have been struck meanwhile.
        let before_px = if self.has_motion { before_px } else { moved_px.or(before_px) };
        self.moved_px = moved_px.or(before_px).map(|newest| [newest, before_px.unwrap_or(newest)]);
        self.has_motion = moved_px.is_some();
        let first_px = self.shutter.first_row_px;
        self.shutter.row_time_frames * (self.row_px.unwrap_or(first_px) - first_px)
    }

    /// Returns the row of the body's centre in the frame of a step, px, by its motion and its detected centre; `None`
    /// if both are unknown.
    ///
    /// All steps of a rod are those of one of its points, so its detected centre is not used.
    fn predicted_row(&self, step: &BodyStep) -> Option<f64> {
        let ahead_px =
            self.moved_px.map_or(0.0, |[newest, _]| step.frame.saturating_sub(self.frame) as f64 * newest[1]);
        let led_px = self.row_px.map(|row_px| row_px + ahead_px);
        let seen_px = step.center_px().map(|[_, y_px]| y_px);
        match (led_px, seen_px.filter(|row_px| row_px.is_finite())) {
            (Some(led_px), Some(_)) if self.has_motion && step.rod().is_some() => Some(led_px),
            (Some(led_px), Some(seen_px)) if self.has_motion => Some(led_px + ROW_FILTER_WEIGHT * (seen_px - led_px)),
            (led_px, seen_px) => seen_px.or(led_px),
        }
    }

    /// Returns the distortion of the body's image: its displacement per frame times the row time.
    fn distortion(&self) -> Distortion {
        self.distortion_by(|newest, before| 0.5 * (newest + before))
    }

    /// Returns the change of the distortion over the last frame.
    fn distortion_change(&self) -> Distortion {
        self.distortion_by(|newest, before| newest - before)
    }

    /// Returns the distortion by a mean or a difference of the two newest displacements, px.
    fn distortion_by(&self, px: fn(f64, f64) -> f64) -> Distortion {
        let [newest, before] = self.moved_px.unwrap_or_default();
        let [shear, elongation] = [0, 1].map(|axis| self.shutter.row_time_frames * px(newest[axis], before[axis]));
        Distortion { shear, elongation }
    }

    /// Returns the time between the exposures of the body in its two latest images, frame periods, at least 0.1.
    pub fn image_interval_periods(&self) -> f64 {
        (1.0 + self.distortion().elongation).max(MIN_IMAGE_INTERVAL)
    }

    /// Returns the newest frame's node without the apparent rotation since the first, which the shear of the image
    /// causes.
    #[must_use]
    pub fn without_shear(&mut self, node: Pose) -> Pose {
        if !self.is_rolling() {
            return node;
        }
        let shear_rad = 0.5 * self.distortion().shear;
        let [x, y, angle_deg] = node.pose;
        let first_rad = *self.first_rad.get_or_insert(shear_rad);
        Pose { pose: [x, y, angle_deg - (shear_rad - first_rad).to_degrees()], ..node }
    }

    /// Records the start of a contact: the offset of the effective row counts from here on.
    pub fn begin_contact(&mut self) {
        self.row_offset_px = 0.0;
    }

    /// Adds the error of the row timing to the uncertainties of the times and spins of an impact.
    ///
    /// `period_s` is the frame period, s.
    #[must_use]
    pub fn widen_times(&self, impact: Impact, period_s: f64) -> Impact {
        if !self.is_rolling() {
            return impact;
        }
        let row_sigma_s = self.shutter.row_time_frames * self.row_offset_px * period_s;
        let widened = |at: Option<Estimate>| at.map(|at| Estimate { sigma: at.sigma.hypot(row_sigma_s), ..at });
        let spin = |spin: Option<Estimate>| {
            spin.map(|spin| Estimate {
                sigma: spin.sigma.hypot(self.rotation_error(spin.value * period_s) / period_s),
                ..spin
            })
        };
        Impact {
            start_s: widened(impact.start_s),
            deepest_s: widened(impact.deepest_s),
            end_s: widened(impact.end_s),
            slip_end_s: widened(impact.slip_end_s),
            force_start_s: widened(impact.force_start_s),
            force_end_s: widened(impact.force_end_s),
            omega_before_rad_s: spin(impact.omega_before_rad_s),
            omega_after_rad_s: spin(impact.omega_after_rad_s),
            ..impact
        }
    }

    /// Adds the error of the row timing to the uncertainty of the rotation rate. The other rates stay the same.
    ///
    /// The side of a rotating body that moves down is followed for longer than the side that moves up. An uneven
    /// pattern weights one side more, and turns with the body. An occluded part adds the error of the strained image.
    #[must_use]
    pub fn widen_rates(&self, rates: PixelRates) -> PixelRates {
        if !self.is_rolling() {
            return rates;
        }
        let turn_rad = rates.theta.value.to_radians();
        let error_deg = self.rotation_error(turn_rad).hypot(self.strain_error(turn_rad)).to_degrees();
        let theta = Estimate { sigma: rates.theta.sigma.hypot(error_deg), ..rates.theta };
        PixelRates { theta, ..rates }
    }

    /// Returns the possible error of a rotation by `turn_rad` per frame period, rad.
    fn rotation_error(&self, turn_rad: f64) -> f64 {
        self.shutter.row_time_frames * EFFECTIVE_ROW_OFFSET * self.radius_px * turn_rad * turn_rad
    }

    /// Returns the additional error where a part is occluded, rad: a rotating stretched image is strained, and the
    /// visible rest alone rotates by that.
    fn strain_error(&self, turn_rad: f64) -> f64 {
        STRAIN_ROTATION_FACTOR * self.unfollowed_fraction * self.distortion().length() * turn_rad
    }

    /// Whether rows are exposed one after another.
    pub fn is_rolling(&self) -> bool {
        self.shutter.row_time_frames.total_cmp(&0.0).is_ne()
    }

    /// Returns the last step as a global shutter would image it.
    ///
    /// Its motion remains that between the moments of two frames, and its rotation remains the image's: see
    /// [`Self::without_shear`].
    pub fn as_global_shutter(&self, step: &BodyStep) -> BodyStep {
        if !self.is_rolling() || self.moved_px.is_none() {
            return *step;
        }
        let (distortion, change) = (self.distortion(), self.distortion_change());
        let longer = 0.5 * change.elongation;
        let growth = |grown: Estimate| Estimate { value: grown.value - longer, sigma: grown.sigma.hypot(longer) };
        let straight = BodyStep {
            outline: step.outline.map(|outline| Outline {
                shape: match outline.shape {
                    // The outline of a patch stays as it was drawn.
                    shape @ OutlineShape::Circle(_) if self.form == Form::Patch => shape,
                    OutlineShape::Circle(circle) => OutlineShape::Circle(undistort_circle(circle, distortion, change)),
                    OutlineShape::Rod(rod) => OutlineShape::Rod(self.undistort_rod(rod, distortion, change)),
                },
                ..outline
            }),
            growth_fraction: step.growth_fraction.map(growth),
            ..*step
        };
        match step.circle() {
            Some(circle) => self.without_sinking(straight, &circle, distortion, change),
            None => straight,
        }
    }

    /// Removes the apparent sinking of a rotating ball or patch from its step, and widens its sigmas.
    ///
    /// `change` is that of the distortion over the last frame.
    fn without_sinking(&self, step: BodyStep, circle: &Circle, distortion: Distortion, change: Distortion) -> BodyStep {
        let Some(seen) = step.motion else { return step };
        let (radius_px, unfollowed_fraction) = (circle.radius_px, self.unfollowed_fraction);
        let interval = f64::from(step.interval_frames.max(1));
        let turn = seen.dtheta_deg.to_radians();
        let sinks_px = self.shutter.row_time_frames * radius_px * radius_px * turn * (interval * turn).sin() / interval;
        let lopsided =
            unfollowed_fraction * HALF_BALL_OFFSET * radius_px * change.length().hypot(distortion.length() * turn);
        let sigma_px = ((LATERAL_MEAN_SQUARE_SIGMA + unfollowed_fraction * LATERAL_MEAN_SQUARE) * sinks_px)
            .hypot(lopsided)
            .hypot(effective_center_shift_px(radius_px, change, self));
        let sigma_deg = (0.5 * change.length()).hypot(self.strain_error(turn)).to_degrees();
        let straight = RigidStep {
            dy_px: seen.dy_px - LATERAL_MEAN_SQUARE * sinks_px,
            sigma_dx_px: seen.sigma_dx_px.hypot(sigma_px),
            sigma_dy_px: seen.sigma_dy_px.hypot(sigma_px),
            sigma_dtheta_deg: seen.sigma_dtheta_deg.hypot(sigma_deg),
            ..seen
        };
        let drift = step.drift.map(|[x, y, turn]| {
            let y = Estimate {
                value: y.value - FRONT_SHARE * sinks_px,
                sigma: y.sigma.hypot(0.25 * FRONT_SHARE * sinks_px),
            };
            [x, y, turn]
        });
        BodyStep { motion: Some(straight), drift, ..step }
    }

    /// Returns a rod as it was when its centre was exposed. See [`Self::without_sinking`].
    fn undistort_rod(&self, rod: Rod, distortion: Distortion, change: Distortion) -> Rod {
        let longer = self.image_interval_periods();
        let (middle_px, stretch_sigma) = (rod.y_px.value, SPEED_CHANGE_SHARE * change.length());
        let mut edges = rod.edges;
        for place in edges.iter_mut().flatten().filter_map(|edge| edge.y_px.as_mut()) {
            let below_px = (place.value - middle_px) / longer;
            *place = Estimate { value: middle_px + below_px, sigma: place.sigma.hypot(stretch_sigma * below_px) };
        }
        let slope = rod.tilt_deg.value.to_radians().tan() * longer - distortion.shear;
        let tilt_deg =
            Estimate { value: slope.atan().to_degrees(), sigma: rod.tilt_deg.sigma.hypot(stretch_sigma.to_degrees()) };
        Rod { tilt_deg, edges, ..rod }
    }
}

/// Returns the distance between a ball's effective centre and its own while its speed changes within a frame, px.
fn effective_center_shift_px(radius_px: f64, change: Distortion, rolling: &RollingShutter) -> f64 {
    STRUCK_ERROR * radius_px * change.length() * (rolling.shutter.row_time_frames * radius_px).abs()
}

/// Returns the circle whose distorted image was detected as `circle`.
fn undistort_circle(circle: Circle, distortion: Distortion, change: Distortion) -> Circle {
    let radius_px = circle.radius_px / (1.0 + 0.5 * distortion.elongation).max(MIN_HEIGHT);
    let parts_px = PARTIAL_FIT_ERROR.hypot(OCCLUDED_CENTER_ERROR * (1.0 - circle.visible_fraction))
        * distortion.length()
        * radius_px;
    let struck_px = STRUCK_ERROR * change.length() * radius_px;
    let radius_error = RADIUS_ERROR * distortion.length().powi(2) + 0.5 * SPEED_CHANGE_SHARE * change.length();
    Circle {
        radius_px,
        sigma_center_px: circle.sigma_center_px.hypot(parts_px).hypot(struck_px),
        sigma_radius_px: circle.sigma_radius_px.hypot(parts_px).hypot(radius_error * radius_px),
        ..circle
    }
}

#[cfg(test)]
mod tests;
