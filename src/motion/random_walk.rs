//! What steps leave for good.

use std::f64::consts::PI;

/// How far a pose follows the step that led to it over a longer interval, from where shorter steps led: 0 to 1.
///
/// 0 drifts as the shorter steps alone, 1 lets neighbouring frames drift apart; from 0.3 to 0.85 velocities are
/// about equally sure.
pub(super) const TRUST_IN_LONGER: f64 = 0.5;

/// What the renewal of a kept reference leaves, as a share of the white noise of a pose.
///
/// The noise of the new reference's frame was interpolated before and is taken as it is from then on. Seen on rendered
/// balls of 70 px at 0 to 1.3 deg/frame, 8 to 63 renewals each: 0.13 to 0.17, alike for the place and the angle.
const RENEWAL: f64 = 0.15;

/// What a step measured over subsets of its own leaves, whatever it spans: x and y, and the angle.
///
/// Grids are laid anew on every frame, by an outline that is less sure than the motion. Seen on rendered balls of 70 and
/// 120 px, 3 patterns, noise of 2 and 4 grey levels, and on a rod's tape.
const SUBSETS_STILL: [f64; 3] = [0.11, 0.11, 0.16];

/// What is added in quadrature where target pixels lie half-way between those of the reference.
///
/// Gradients times noise are not sampled finely enough: their sum depends on where the pixels lie on the body, by
/// 2 sin(pi f) for a step of f pixels.
const SUBSETS_MOVED: [f64; 3] = [0.17, 0.17, 0.29];

/// Rotation that mixes all places between pixels, deg.
const MIXED_DEG: f64 = 0.35;

/// When a kept reference is renewed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Renewal {
    /// Blocks of so many frames have references of their own.
    pub block_frames: u32,
    /// And are turned no further than this, deg.
    pub stale_deg: f64,
}

/// Noise of steps that the next step does not take back, as shares of the white noise of a pose.
///
/// Poses are sums of steps, and what a step leaves stays in all later ones. Over a long flight it makes up most of the
/// velocity's uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Walk {
    /// How much longer intervals leave of it.
    temper: f64,
    /// Of the reference that whole bodies are matched with; without, it is never renewed.
    renewal: Option<Renewal>,
}

/// Where in a stream a body's kept reference was taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Kept {
    block: u64,
    angle_deg: f64,
}

impl Walk {
    /// Of steps measured over one interval or several at once, the shortest first.
    ///
    /// Sums of steps drift, and each longer interval ties a pose to one further back. With trust g in a step over n
    /// times as many frames, errors of the pose follow E(i) = (1 - g) (E(i-1) + a(i)) + g (E(i-n) + b(i)), whose part
    /// that never fades moves by [(1 - g) a + g b] / [1 - g + g n] a frame; a and b are alike, whatever the interval.
    /// Poses against a kept reference drift less whatever the intervals.
    pub fn of(intervals_frames: &[u32], renewal: Option<Renewal>) -> Self {
        let shortest = intervals_frames.first().map_or(1.0, |interval| f64::from((*interval).max(1)));
        let g = TRUST_IN_LONGER;
        let mut variance = 1.0;
        for interval in intervals_frames.iter().skip(1) {
            let n = f64::from(*interval) / shortest;
            variance = ((1.0 - g).powi(2) * variance + g * g) / (1.0 - g + g * n).powi(2);
        }
        Self { temper: f64::sqrt(variance), renewal }
    }

    /// Of a step over subsets of its own: x, y and angle; `moved` is what it spans, px, px and deg.
    pub fn subsets(&self, moved: [f64; 3]) -> [f64; 3] {
        subset_walk(moved).map(|share| share * self.temper)
    }

    /// Of a step of the whole body from a frame in which it is turned by `angle_deg`; follows the reference.
    pub(super) fn whole(&self, frame: u64, angle_deg: f64, kept: &mut Option<Kept>) -> [f64; 3] {
        let Some(Renewal { block_frames, stale_deg }) = self.renewal else { return [0.0; 3] };
        let block = frame / u64::from(block_frames.max(1));
        let holds = |kept: &Kept| kept.block == block && (angle_deg - kept.angle_deg).abs() <= stale_deg;
        if kept.as_ref().is_some_and(holds) {
            return [0.0; 3];
        }
        *kept = Some(Kept { block, angle_deg });
        [RENEWAL; 3]
    }
}

/// What one step over subsets leaves for good, as shares of a pose's white noise: x, y and angle.
pub fn subset_walk([dx_px, dy_px, angle_deg]: [f64; 3]) -> [f64; 3] {
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
        let walk = Walk::of(&[1], Some(Renewal { block_frames: 8, stale_deg: 3.0 }));
        let mut kept = None;
        let renewed = |(frame, angle_deg): (u64, f64)| walk.whole(frame, angle_deg, &mut kept)[0] > 0.0;
        let turning = (0..16).map(|frame| (frame, 0.8 * frame as f64));
        let frames: Vec<u64> =
            (0..16).zip(turning.map(renewed)).filter(|(_, renewed)| *renewed).map(|(f, _)| f).collect();
        assert_eq!(frames, [0, 4, 8, 12]);
        assert!(Walk::of(&[1], None).whole(3, 0.0, &mut None)[0] <= 0.0, "a patch's is never renewed");
    }
}
