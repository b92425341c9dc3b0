//! Errors of speeds from the sensor's fixed pattern and from interpolation.

use std::f64::consts::PI;

use crate::motion::random_walk::{LONG_STEP_WEIGHT, Renewal};

/// The maximum number of intervals.
const MAX_INTERVALS: usize = 4;
/// The minimum number of frames of an estimate.
const MIN_SAMPLES: u32 = 3;
/// The slope of [`slope_correlation`] at zero: 2 (8 / 12 + 1 / 24).
const BIAS_SLOPE: f64 = 17.0 / 12.0;
/// The minimum displacement at which the bias oscillates about zero, px.
const MIN_OSCILLATION_PX: f64 = 1.2;
/// The maximum of these oscillations, times the square of the displacement, px^2.
///
/// On rendered speckles they were 0.12 at 1.6 px and -0.04 at 2.2 px.
const MAX_OSCILLATION: f64 = 0.3;

/// The interpolation error of a step that moves all pixels to the same sub-pixel position, px. Measured on 400 rendered
/// rods that fall by 1.44 px in 16 frames.
const INTERPOLATION_PX: f64 = 5e-5;
/// The relative displacement by rotation from which pixels lie at all sub-pixel positions, px.
const MIXED_PX: f64 = 0.5;

/// A running mean of the share by which sub-pixel steps are underestimated.
#[derive(Debug, Clone, Copy, Default)]
pub struct RunningBias {
    count: u32,
    mean: f64,
    /// The sum of the squared uncertainties.
    squares: f64,
}

impl RunningBias {
    /// Includes the share estimated in one more frame; one that is not finite is ignored.
    pub fn push(&mut self, share: f64) {
        if !share.is_finite() {
            return;
        }
        self.count = self.count.saturating_add(1);
        let deviation = share - self.mean;
        self.mean += deviation / f64::from(self.count);
        self.squares += deviation * (share - self.mean);
    }

    /// Returns the significant part of the share; 0 at first.
    pub fn significant(&self) -> f64 {
        if self.count < MIN_SAMPLES {
            return 0.0;
        }
        let count = f64::from(self.count);
        (self.mean - (self.squares / (count * (count - 1.0))).sqrt()).max(0.0)
    }
}

/// The intervals over which motion is measured, with their weights.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Intervals {
    /// Interval in frames and weight of each step over subsets.
    intervals: [(f64, f64); MAX_INTERVALS],
    /// Frames for which a whole-body reference is kept; `None` where it is never renewed.
    kept_frames: Option<f64>,
}

impl Intervals {
    /// Creates the weights for steps over these intervals, the shortest first, and for whole-body references renewed by
    /// this rule.
    ///
    /// With weight g of steps over n times as many frames, poses move by [(1 - g) a + g n b] / [1 - g + g n] for
    /// shorter steps a and longer steps b.
    pub fn new(intervals_frames: &[u32], renewal: Option<Renewal>) -> Self {
        let mut intervals = [(0.0, 0.0); MAX_INTERVALS];
        let shortest = intervals_frames.first().map_or(1.0, |interval| f64::from((*interval).max(1)));
        let g = LONG_STEP_WEIGHT;
        for (place, interval) in intervals_frames.iter().take(MAX_INTERVALS).enumerate() {
            let n = f64::from(*interval) / shortest;
            let longer = if place == 0 { 1.0 } else { g * n / (1.0 - g + g * n) };
            intervals[..place].iter_mut().for_each(|(_, weight)| *weight *= 1.0 - longer);
            intervals[place] = (f64::from(*interval), longer);
        }
        Self { intervals, kept_frames: renewal.map(|renewal| f64::from(renewal.block_frames)) }
    }

    /// Returns the fraction of the fixed-pattern bias of short steps that remains in whole-body matches at this speed
    /// along x and y, px/frame: 0 to 1.
    fn remaining_whole_body_bias(&self, speed_px: [f64; 2]) -> f64 {
        // A reference that is never renewed was drawn at another position.
        self.kept_frames.map_or(0.0, |frames| relative_bias(frames * speed_px[0], frames * speed_px[1]))
    }

    /// Returns the fraction of the fixed-pattern bias of short steps that remains in steps over subsets at this speed
    /// along x and y, px/frame: 0 to 1.
    fn remaining_subset_bias(&self, speed_px: [f64; 2]) -> f64 {
        self.intervals
            .iter()
            .map(|(frames, weight)| weight * relative_bias(frames * speed_px[0], frames * speed_px[1]))
            .sum()
    }

    /// Returns the interpolation error of steps over subsets, as a fraction of the speed `speed_px`, px/frame.
    ///
    /// The rotation moves the points of the body by `turned_px` per frame. It vanishes where that mixes all sub-pixel
    /// positions.
    fn interpolation_error(&self, speed_px: f64, turned_px: f64) -> f64 {
        let steps = self.intervals.iter().filter(|(frames, _)| *frames > 0.0 && frames * turned_px < MIXED_PX);
        // It vanishes at rest and is periodic in the displacement.
        steps.map(|(frames, weight)| weight * INTERPOLATION_PX * (2.0 * PI).min(1.0 / (frames * speed_px))).sum()
    }
}

/// The speed of a body along two perpendicular axes, and its rotation.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PlanarRates {
    /// Along the first axis, px/frame.
    pub first_px: f64,
    /// Along the second axis, px/frame.
    pub second_px: f64,
    /// The rotation, deg/frame.
    pub angle_deg: f64,
}

/// The possible relative error of speeds.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SpeedBias {
    /// The underestimate of sub-pixel steps, as a share.
    pub share: f64,
    /// The intervals over which speeds were measured.
    pub spans: Intervals,
    /// Whether the speeds are whole-body matches with a kept reference.
    pub is_whole: bool,
    /// Radius of a rotating body, px.
    pub radius_px: f64,
}

impl SpeedBias {
    /// Returns the possible underestimate of speeds, as a fraction 0 to `share`.
    pub fn underestimate(&self, rates: PlanarRates) -> f64 {
        let turned_px = self.turned_px(rates.angle_deg);
        let speed_px = [rates.first_px.hypot(turned_px), rates.second_px.hypot(turned_px)];
        let remaining = if self.is_whole {
            self.spans.remaining_whole_body_bias(speed_px)
        } else {
            self.spans.remaining_subset_bias(speed_px)
        };
        self.share * remaining
    }

    /// Returns the interpolation error of either sign, as a fraction of the speed.
    pub fn interpolation_error(&self, rates: PlanarRates) -> f64 {
        if self.is_whole {
            0.0
        } else {
            self.spans.interpolation_error(rates.first_px.hypot(rates.second_px), self.turned_px(rates.angle_deg))
        }
    }

    /// Returns the root mean square displacement along either axis that the rotation causes on a disc, px/frame.
    fn turned_px(&self, angle_deg: f64) -> f64 {
        0.5 * angle_deg.to_radians().abs() * self.radius_px
    }
}

/// Returns the bias towards zero of a step of (x, y) px, as a share of that of the shortest step: 0 to 1.
///
/// Along each axis it follows [`slope_correlation`], reduced by the correlation of what is interpolated across. Beyond
/// the first zero it is replaced by its bound.
fn relative_bias(x_px: f64, y_px: f64) -> f64 {
    let square = x_px * x_px + y_px * y_px;
    if square < 1e-12 {
        return 1.0;
    }
    let bias = (x_px * slope_correlation(x_px) * sinc(y_px) + y_px * slope_correlation(y_px) * sinc(x_px))
        / (BIAS_SLOPE * square);
    let is_oscillating = square >= MIN_OSCILLATION_PX * MIN_OSCILLATION_PX;
    if is_oscillating { bias.max(MAX_OSCILLATION / square) } else { bias }.clamp(0.0, 1.0)
}

/// Returns the correlation of white pixel noise, whose slope is taken by fourth-order differences, with itself
/// interpolated `x_px` further.
fn slope_correlation(x_px: f64) -> f64 {
    let odd = |n: f64| sinc(x_px - n) - sinc(x_px + n);
    (8.0 * odd(1.0) - odd(2.0)) / 12.0
}

/// Returns the normalised sinc function, sin(pi x) / (pi x).
fn sinc(x: f64) -> f64 {
    let x = PI * x;
    if x.abs() < 1e-6 { 1.0 } else { x.sin() / x }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_one_frame_shows_is_averaged_and_chance_is_left_out() {
        let mut none = RunningBias::default();
        [1e-3, 1e-3].into_iter().for_each(|share| none.push(share));
        assert!(none.significant() <= 0.0, "two are too few");
        none.push(-2e-3);
        assert!(none.significant() <= 0.0, "{}", none.significant());
        let mut some = RunningBias::default();
        (0..100).for_each(|k| some.push(if k % 2 == 0 { 2e-3 } else { 4e-3 }));
        assert!((some.significant() - 2.9e-3).abs() < 2e-6, "{}", some.significant());
    }

    #[test]
    fn longer_intervals_and_faster_bodies_leave_less_of_it() {
        let speed_bias = |intervals: &[u32], is_whole: bool| SpeedBias {
            share: 1.0,
            spans: Intervals::new(intervals, Some(Renewal { block_frames: 16, stale_deg: 3.0 })),
            is_whole,
            radius_px: 50.0,
        };
        let of = |intervals: &[u32], x_px: f64| {
            speed_bias(intervals, false).underestimate(PlanarRates { first_px: x_px, ..PlanarRates::default() })
        };
        assert!((of(&[1], 0.0) - 1.0).abs() < 1e-12);
        assert!((of(&[1, 16], 0.0) - 1.0).abs() < 1e-12 && (of(&[1, 2, 4, 8], 0.0) - 1.0).abs() < 1e-12);
        assert!(of(&[1], 0.086) > 0.97 && (0.7..0.8).contains(&of(&[1, 8], 0.086)));
        assert!(of(&[1, 16], 0.086) < 0.3 && of(&[1], 3.0) < 0.04);
        // Measured on rendered speckles that move along a row, and along a diagonal.
        let seen = [(0.2, 1.06, 0.86), (0.4, 0.94, 0.72), (0.8, 0.69, 0.37), (1.2, 0.37, 0.06), (1.6, 0.12, -0.07)];
        for (px, row, diagonal) in seen {
            let half_px = px * std::f64::consts::FRAC_1_SQRT_2;
            let off = [relative_bias(px, 0.0) - row, relative_bias(half_px, half_px) - diagonal];
            assert!((-0.1..0.2).contains(&off[0]) && (-0.05..0.2).contains(&off[1]), "{px} px: {off:?}");
        }
        // Interpolation affects longer steps less, and rotation averages it out.
        let slow = speed_bias(&[1, 16], false);
        assert!(slow.interpolation_error(PlanarRates::default()) < 4e-4);
        let falling = PlanarRates { second_px: 0.09, ..PlanarRates::default() };
        let [px, turned] =
            [0.0, 2.0].map(|angle_deg| 0.09 * slow.interpolation_error(PlanarRates { angle_deg, ..falling }));
        assert!((4e-6..7e-6).contains(&px) && turned <= 0.0, "{px} {turned}");
        assert!(speed_bias(&[1], true).interpolation_error(falling) <= 0.0);
        // A kept reference sees the whole displacement since it was taken, and rotation moves pixels as well.
        assert!(speed_bias(&[1], true).underestimate(PlanarRates { first_px: 0.2, ..PlanarRates::default() }) < 0.04);
        assert!(speed_bias(&[1], false).underestimate(PlanarRates { angle_deg: 3.0, ..PlanarRates::default() }) < 0.2);
    }
}
