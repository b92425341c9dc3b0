//! What the sensor's fixed pattern and interpolation may take from speeds or add to them.

use std::f64::consts::PI;

use crate::motion::random_walk::{Renewal, TRUST_IN_LONGER};

/// Most intervals at once.
const MOST_INTERVALS: usize = 4;
/// Fewest frames whose word is taken.
const LEAST_SEEN: u32 = 3;
/// The slope of [`along`] at zero: 2 (8 / 12 + 1 / 24).
const ALONG_SLOPE: f64 = 17.0 / 12.0;
/// From here on, px, what is left of it swings about zero, below [`SWINGS`] over the square of the way (seen on rendered
/// speckles: 0.12 at 1.6 px, -0.04 at 2.2).
const SWINGS_PX: f64 = 1.2;
const SWINGS: f64 = 0.3;

/// What interpolation leaves in each step that carries all pixels to the same place between others, px: seen on 400 rendered
/// rods that fall by 1.44 px in 16 frames.
const INTERPOLATED_PX: f64 = 5e-5;
/// Where rotation moves pixels apart by more than this, px, they lie at all places between others.
const MIXED_PX: f64 = 0.5;

/// Running mean of the share by which steps of far less than a pixel come out short.
#[derive(Debug, Clone, Copy, Default)]
pub struct RunningShare {
    seen: u32,
    mean: f64,
    /// Sum of the squares of what they are off by.
    squares: f64,
}

impl RunningShare {
    /// Takes what one more frame shows.
    pub fn push(&mut self, share: f64) {
        if !share.is_finite() {
            return;
        }
        self.seen = self.seen.saturating_add(1);
        let off = share - self.mean;
        self.mean += off / f64::from(self.seen);
        self.squares += off * (share - self.mean);
    }

    /// The share, as far as it is larger than chance alone would make it; 0 at first.
    pub fn told(&self) -> f64 {
        if self.seen < LEAST_SEEN {
            return 0.0;
        }
        let seen = f64::from(self.seen);
        (self.mean - (self.squares / (seen * (seen - 1.0))).sqrt()).max(0.0)
    }
}

/// Over how many frames motion is measured, and how much each of them has to say.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Spans {
    /// Frames and weight, of steps over subsets.
    intervals: [(f64, f64); MOST_INTERVALS],
    /// Frames over which a reference of the whole body is kept; `None` where it is kept for good.
    kept_frames: Option<f64>,
}

impl Spans {
    /// Of steps over these intervals, the shortest first, and of whole bodies whose references are renewed like this.
    ///
    /// With trust g in steps over n times as many frames, poses move on by [(1 - g) a + g n b] / [1 - g + g n] where the
    /// shorter steps say a and the longer ones b.
    pub fn of(intervals_frames: &[u32], renewal: Option<Renewal>) -> Self {
        let mut intervals = [(0.0, 0.0); MOST_INTERVALS];
        let shortest = intervals_frames.first().map_or(1.0, |interval| f64::from((*interval).max(1)));
        let g = TRUST_IN_LONGER;
        for (place, interval) in intervals_frames.iter().take(MOST_INTERVALS).enumerate() {
            let n = f64::from(*interval) / shortest;
            let longer = if place == 0 { 1.0 } else { g * n / (1.0 - g + g * n) };
            intervals[..place].iter_mut().for_each(|(_, weight)| *weight *= 1.0 - longer);
            intervals[place] = (f64::from(*interval), longer);
        }
        Self { intervals, kept_frames: renewal.map(|renewal| f64::from(renewal.block_frames)) }
    }

    /// How much of the share is left in speeds along x and y, px/frame.
    fn left(&self, [x_px, y_px]: [f64; 2], is_whole: bool) -> f64 {
        let alike = |frames: f64| alike([frames * x_px, frames * y_px]);
        match (is_whole, self.kept_frames) {
            (true, Some(frames)) => alike(frames),
            // It was drawn elsewhere.
            (true, None) => 0.0,
            (false, _) => self.intervals.iter().map(|(frames, weight)| weight * alike(*frames)).sum(),
        }
    }

    /// What interpolation leaves of steps over subsets, as a share of a speed, px/frame, of a body whose points its rotation
    /// moves by `turned_px`.
    fn interpolated(&self, speed_px: f64, turned_px: f64) -> f64 {
        let steps = self.intervals.iter().filter(|(frames, _)| *frames > 0.0 && frames * turned_px < MIXED_PX);
        // It is nothing for no motion, and like a sine of the way.
        steps.map(|(frames, weight)| weight * INTERPOLATED_PX * (2.0 * PI).min(1.0 / (frames * speed_px))).sum()
    }
}

/// By which share speeds may be off.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Shortening {
    /// That of steps of far less than a pixel.
    pub share: f64,
    /// Over how many frames speeds were measured.
    pub spans: Spans,
    /// Whether they are matches of the whole body with a kept reference.
    pub is_whole: bool,
    /// Radius of a body that turns, px.
    pub radius_px: f64,
}

impl Shortening {
    /// By which they may be short at these rates along x and y, px/frame, and of the angle, deg/frame: 0 to `share`.
    pub fn of(&self, rates: [f64; 3]) -> f64 {
        let turned_px = self.turned_px(rates);
        let [x_px, y_px, _] = rates;
        self.share * self.spans.left([x_px.hypot(turned_px), y_px.hypot(turned_px)], self.is_whole)
    }

    /// By which interpolation may have them off, either way.
    pub fn interpolated(&self, rates: [f64; 3]) -> f64 {
        if self.is_whole { 0.0 } else { self.spans.interpolated(rates[0].hypot(rates[1]), self.turned_px(rates)) }
    }

    /// By so much along either axis its rotation moves a point of a disc, root mean square, px/frame.
    fn turned_px(&self, [_, _, angle_deg]: [f64; 3]) -> f64 {
        0.5 * angle_deg.to_radians().abs() * self.radius_px
    }
}

/// How much of what speaks for no motion reaches a step of (x, y) px, as a share of that of the shortest: 0 to 1.
///
/// Along each axis it is what [`along`] says, less the likeness of what is interpolated across. From where that swings
/// about zero, what it stays below.
fn alike([x_px, y_px]: [f64; 2]) -> f64 {
    let square = x_px * x_px + y_px * y_px;
    if square < 1e-12 {
        return 1.0;
    }
    let spoken = (x_px * along(x_px) * sinc(y_px) + y_px * along(y_px) * sinc(x_px)) / (ALONG_SLOPE * square);
    if square < SWINGS_PX * SWINGS_PX { spoken } else { spoken.max(SWINGS / square) }.clamp(0.0, 1.0)
}

/// White noise of pixels, its slope by fourth-order differences, times itself `x_px` further, interpolated between.
fn along(x_px: f64) -> f64 {
    let odd = |n: f64| sinc(x_px - n) - sinc(x_px + n);
    (8.0 * odd(1.0) - odd(2.0)) / 12.0
}

fn sinc(x: f64) -> f64 {
    let x = PI * x;
    if x.abs() < 1e-6 { 1.0 } else { x.sin() / x }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_one_frame_shows_is_averaged_and_chance_is_left_out() {
        let mut none = RunningShare::default();
        [1e-3, 1e-3].into_iter().for_each(|share| none.push(share));
        assert!(none.told() <= 0.0, "two are too few");
        none.push(-2e-3);
        assert!(none.told() <= 0.0, "{}", none.told());
        let mut some = RunningShare::default();
        (0..100).for_each(|k| some.push(if k % 2 == 0 { 2e-3 } else { 4e-3 }));
        assert!((some.told() - 2.9e-3).abs() < 2e-6, "{}", some.told());
    }

    #[test]
    fn longer_intervals_and_faster_bodies_leave_less_of_it() {
        let shortening = |intervals: &[u32], is_whole: bool| Shortening {
            share: 1.0,
            spans: Spans::of(intervals, Some(Renewal { block_frames: 16, stale_deg: 3.0 })),
            is_whole,
            radius_px: 50.0,
        };
        let of = |intervals: &[u32], x_px: f64| shortening(intervals, false).of([x_px, 0.0, 0.0]);
        assert!((of(&[1], 0.0) - 1.0).abs() < 1e-12);
        assert!((of(&[1, 16], 0.0) - 1.0).abs() < 1e-12 && (of(&[1, 2, 4, 8], 0.0) - 1.0).abs() < 1e-12);
        assert!(of(&[1], 0.086) > 0.97 && (0.7..0.8).contains(&of(&[1, 8], 0.086)));
        assert!(of(&[1, 16], 0.086) < 0.3 && of(&[1], 3.0) < 0.04);
        // As seen on rendered speckles that move along a row, and along a diagonal.
        let seen = [(0.2, 1.06, 0.86), (0.4, 0.94, 0.72), (0.8, 0.69, 0.37), (1.2, 0.37, 0.06), (1.6, 0.12, -0.07)];
        for (px, row, diagonal) in seen {
            let half_px = px * std::f64::consts::FRAC_1_SQRT_2;
            let off = [alike([px, 0.0]) - row, alike([half_px, half_px]) - diagonal];
            assert!((-0.1..0.2).contains(&off[0]) && (-0.05..0.2).contains(&off[1]), "{px} px: {off:?}");
        }
        // Interpolation leaves less of longer steps, and nothing that rotation averages.
        let slow = shortening(&[1, 16], false);
        assert!(slow.interpolated([0.0; 3]) < 4e-4);
        let [px, turned] = [[0.0, 0.09, 0.0], [0.0, 0.09, 2.0]].map(|rates| 0.09 * slow.interpolated(rates));
        assert!((4e-6..7e-6).contains(&px) && turned <= 0.0, "{px} {turned}");
        assert!(shortening(&[1], true).interpolated([0.0, 0.09, 0.0]) <= 0.0);
        // A kept reference sees all the way since it was taken, and rotation moves pixels as well.
        assert!(shortening(&[1], true).of([0.2, 0.0, 0.0]) < 0.04);
        assert!(shortening(&[1], false).of([0.0, 0.0, 3.0]) < 0.2);
    }
}
