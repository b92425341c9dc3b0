//! The random walk of integrated steps.

use std::f64::consts::PI;

/// The weight of a step over a longer interval against the shorter steps that lead to the same pose, 0 to 1.
///
/// With 0, poses drift like the shorter steps alone; with 1, neighbouring frames drift apart. From 0.3 to 0.85
/// velocities are about equally precise.
pub(super) const LONG_STEP_WEIGHT: f64 = 0.5;

/// The random walk from one renewal of a kept reference, as a share of a pose's white noise.
///
/// The noise of the new reference's frame was interpolated before, and is not from then on. On rendered balls of 70 px
/// at 0 to 1.3 deg/frame with 8 to 63 renewals it was 0.13 to 0.17, alike for position and angle.
const RENEWAL: f64 = 0.15;

/// The random walk from a step over subsets, at any displacement: x, y and the angle.
///
/// Grids are placed again in every frame, by an outline that is less precise than the motion. Measured on rendered
/// balls of 70 and 120 px with 3 patterns and noise of 2 and 4 grey levels, and on a rod's tape.
const SUBSETS_STILL: [f64; 3] = [0.11, 0.11, 0.16];

/// The part added in quadrature where target pixels lie half-way between those of the reference.
///
/// The product of gradient and noise is undersampled: its sum depends on the position of the pixels on the body, like 2
/// sin(pi f) for a step of f pixels.
const SUBSETS_MOVED: [f64; 3] = [0.17, 0.17, 0.29];

/// The rotation from which all sub-pixel positions occur, deg.
const MIXED_DEG: f64 = 0.35;

/// The rule by which a kept reference is renewed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Renewal {
    /// Frames of a block; each block has its own reference.
    pub block_frames: u32,
    /// The maximum rotation of a reference, deg.
    pub stale_deg: f64,
}

/// The noise of steps that the next step does not cancel, as shares of a pose's white noise.
///
/// Poses are sums of steps, and this part stays in all later ones. Over a long flight it dominates the velocity's
/// uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RandomWalk {
    /// The factor by which longer intervals reduce it.
    long_interval_factor: f64,
    /// The renewal of the whole-body reference; `None` where it is never renewed.
    renewal: Option<Renewal>,
}

/// The frame and rotation at which a body's kept reference was taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KeptReference {
    block: u64,
    angle_deg: f64,
}

impl RandomWalk {
    /// Computes the random walk of steps over one interval or several, the shortest first.
    ///
    /// Sums of steps drift, and each longer interval ties a pose to an earlier one. With weight g of a step over n
    /// times as many frames, errors of the pose follow E(i) = (1 - g) (E(i-1) + a(i)) + g (E(i-n) + b(i)). The
    /// permanent part moves by [(1 - g) a + g b] / [1 - g + g n] per frame; a and b are of the same size for any
    /// interval. Poses relative to a kept reference drift less for any interval.
    pub fn new(intervals_frames: &[u32], renewal: Option<Renewal>) -> Self {
        let shortest = intervals_frames.first().map_or(1.0, |interval| f64::from((*interval).max(1)));
        let g = LONG_STEP_WEIGHT;
        let mut variance = 1.0;
        for interval in intervals_frames.iter().skip(1) {
            let n = f64::from(*interval) / shortest;
            variance = ((1.0 - g).powi(2) * variance + g * g) / (1.0 - g + g * n).powi(2);
        }
        Self { long_interval_factor: f64::sqrt(variance), renewal }
    }

    /// Returns the random walk of a step over subsets by `moved` (px, px, deg): x, y and angle, as shares of a pose's
    /// white noise.
    pub fn subset_step(&self, moved: [f64; 3]) -> [f64; 3] {
        subset_walk(moved).map(|share| share * self.long_interval_factor)
    }

    /// Returns the random walk of a whole-body step from a frame rotated by `angle_deg`: x, y and angle, as shares of a
    /// pose's white noise.
    ///
    /// It is zero unless the reference is renewed in this frame. `kept` is the newest reference, and is updated.
    pub(super) fn whole_body_step(&self, frame: u64, angle_deg: f64, kept: &mut Option<KeptReference>) -> [f64; 3] {
        let Some(Renewal { block_frames, stale_deg }) = self.renewal else { return [0.0; 3] };
        let block = frame / u64::from(block_frames.max(1));
        let holds = |kept: &KeptReference| kept.block == block && (angle_deg - kept.angle_deg).abs() <= stale_deg;
        if kept.as_ref().is_some_and(holds) {
            return [0.0; 3];
        }
        *kept = Some(KeptReference { block, angle_deg });
        [RENEWAL; 3]
    }
}

/// Returns the random walk of one step over subsets as shares of a pose's white noise: x, y and angle.
///
/// `moved` is the displacement, px, px and deg.
pub fn subset_walk(moved: [f64; 3]) -> [f64; 3] {
    let [dx_px, dy_px, angle_deg] = moved;
    let between = (PI * dx_px).sin().powi(2) + (PI * dy_px).sin().powi(2) + (angle_deg / MIXED_DEG).powi(2);
    let between = between.min(1.0).sqrt();
    std::array::from_fn(|k| SUBSETS_STILL[k].hypot(SUBSETS_MOVED[k] * between))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_by_whole_pixels_leaves_least_and_one_half_way_most() {
        let [still, whole, half, turned] =
            [[0.0; 3], [3.0, -1.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, 1.0]].map(|moved| subset_walk(moved)[0]);
        assert!((still - whole).abs() < 1e-9 && (half - turned).abs() < 1e-9 && half > 1.5 * still);
    }

    #[test]
    fn a_kept_reference_leaves_something_only_where_it_is_renewed() {
        let walk = RandomWalk::new(&[1], Some(Renewal { block_frames: 8, stale_deg: 3.0 }));
        let mut kept = None;
        let renewed = |(frame, angle_deg): (u64, f64)| walk.whole_body_step(frame, angle_deg, &mut kept)[0] > 0.0;
        let turning = (0..16).map(|frame| (frame, 0.8 * frame as f64));
        let frames: Vec<u64> =
            (0..16).zip(turning.map(renewed)).filter(|(_, renewed)| *renewed).map(|(f, _)| f).collect();
        assert_eq!(frames, [0, 4, 8, 12]);
        assert!(RandomWalk::new(&[1], None).whole_body_step(3, 0.0, &mut None)[0] <= 0.0, "a patch's is never renewed");
    }
}
