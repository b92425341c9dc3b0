//! The white noise of a pose from steps over subsets, and their permanent error.
//!
//! Short steps and one long step between the same two frames share the noise of the same two poses. Their difference
//! is the permanent error of the steps, and the remaining scatter of a step is the noise of its two poses. Both
//! depend on how finely the pattern is sampled, so they are observed on films of this rig.

use super::films::measure_steps;
use super::rig::Rig;
use crate::failure::Failure;
use crate::motion::subset_walk;
use crate::process::analysis_params;
use crate::results::BodyStep;
use crate::synth::SimulatedFilm;

/// Number of renderings and of consecutive long steps: the ratio is known to 7 %.
const RENDERINGS: u64 = 16;
const LONG_STEPS: u64 = 6;

/// Length of a long step in short ones, if the rig has only one interval.
const LONG_STEP_LENGTH: u32 = 8;

/// The observed errors of steps in x px, y px and angle deg.
#[derive(Debug, Clone)]
pub(super) struct StepNoise {
    /// White noise of a pose.
    pub(super) pose: [f64; 3],
    /// Permanent error of a step relative to the assumed one.
    pub(super) walk: [f64; 3],
}

/// Observes the white noise of poses and the permanent error of steps from frame `first` on.
///
/// # Errors
///
/// When a film cannot be rendered or the settings cannot be used.
pub(super) fn observe_steps(rig: &Rig, film: &SimulatedFilm, first: u64) -> Result<StepNoise, Failure> {
    let intervals = &rig.config.intervals_frames;
    let short = intervals[0];
    let long = intervals.get(1).copied().unwrap_or(short * LONG_STEP_LENGTH);
    let (mut params, _) = analysis_params(&rig.config, &rig.format());
    params.intervals_frames = vec![short, long];
    let count = (film.frames() - 1 - first).min(LONG_STEPS * u64::from(long)) / u64::from(long);
    let frames = first..first + count * u64::from(long) + 1;
    let mut renderings = Vec::new();
    for number in 1..=RENDERINGS {
        renderings.push(measure_steps(&params, &film.retake(rig.scenario.motion.clone(), number)?, frames.clone())?);
    }
    let shares = |from: u64, interval: u32| {
        let pose = |frame: u64| {
            let truth = film.truth(frame);
            [truth.center_x_px.unwrap_or_default(), truth.center_y_px.unwrap_or_default(), film.angle_deg(frame)]
        };
        let (here, there) = (pose(from), pose(from + u64::from(interval)));
        subset_walk([0, 1, 2].map(|k| there[k] - here[k]))
    };
    let mut parts = [VarianceSums::default(); 3];
    for start in (0..count).map(|at| first + at * u64::from(long)) {
        let shorts: Vec<u64> = (start..start + u64::from(long)).step_by(short as usize).collect();
        let closure_errors: Vec<_> =
            renderings.iter().filter_map(|rows| closure_error(rows, start, short, long)).collect();
        let whole = shares(start, long);
        for (k, parts) in parts.iter_mut().enumerate() {
            let each: f64 = shorts.iter().map(|from| shares(*from, short)[k].powi(2)).sum();
            parts.add_closure_errors(&closure_errors, k, each + whole[k].powi(2));
            for from in &shorts {
                let moved: Vec<_> = renderings.iter().filter_map(|rows| step_motion(rows, *from, short)).collect();
                parts.add_steps(&moved, k, shares(*from, short)[k].powi(2));
            }
        }
    }
    let estimates = parts.map(|parts| parts.estimate());
    Ok(StepNoise { pose: estimates.map(|[pose, _]| pose), walk: estimates.map(|[_, walk]| walk) })
}

/// Sums of variances over renderings and of the squared errors that they are expected to have.
#[derive(Debug, Clone, Copy, Default)]
struct VarianceSums {
    closure_variance: f64,
    closure_shares: f64,
    step_variance: f64,
    step_shares: f64,
    steps: f64,
}

impl VarianceSums {
    /// Adds the variance of coordinate `k` over the `closure_errors` of all renderings; `shares` is its squared
    /// expected error.
    fn add_closure_errors(&mut self, closure_errors: &[[f64; 3]], k: usize, shares: f64) {
        if let Some(variance) = variance(closure_errors.iter().map(|error| error[k])) {
            (self.closure_variance, self.closure_shares) =
                (self.closure_variance + variance, self.closure_shares + shares);
        }
    }

    /// Adds the variance of coordinate `k` over one step of all renderings; `shares` is its squared expected error.
    fn add_steps(&mut self, moved: &[[f64; 3]], k: usize, shares: f64) {
        if let Some(variance) = variance(moved.iter().map(|moved| moved[k])) {
            (self.step_variance, self.step_shares) = (self.step_variance + variance, self.step_shares + shares);
            self.steps += 1.0;
        }
    }

    /// Returns the white noise of a pose (sigma), and the permanent error of a step relative to that noise and to the
    /// expected error; 0 and 1 if there is no white noise.
    fn estimate(&self) -> [f64; 2] {
        let permanent = if self.closure_shares > 0.0 { self.closure_variance / self.closure_shares } else { 0.0 };
        let pose = 0.5 * (self.step_variance - permanent * self.step_shares) / self.steps.max(1.0);
        if pose > 0.0 { [pose.sqrt(), (permanent / pose).sqrt()] } else { [0.0, 1.0] }
    }
}

/// Returns the sum of the short steps from frame `start` minus the long one, px, px and deg; `None` if one is missing.
///
/// `short` and `long` are their intervals, frames.
fn closure_error(rows: &[BodyStep], start: u64, short: u32, long: u32) -> Option<[f64; 3]> {
    let mut sum = step_motion(rows, start, long)?.map(|whole| -whole);
    for from in (start..start + u64::from(long)).step_by(short as usize) {
        let step = step_motion(rows, from, short)?;
        sum = [0, 1, 2].map(|k| sum[k] + step[k]);
    }
    Some(sum)
}

/// Returns the motion (px, px, deg) of the step from a frame over this interval; `None` if it is missing.
fn step_motion(rows: &[BodyStep], from: u64, interval: u32) -> Option<[f64; 3]> {
    let row = rows.iter().find(|row| row.frame == from && row.interval_frames == interval)?;
    let step = row.motion?;
    Some([step.dx_px, step.dy_px, step.dtheta_deg].map(|mean| mean * f64::from(interval)))
}

/// Returns the sample variance of values; `None` for fewer than three.
fn variance(values: impl Iterator<Item = f64> + Clone) -> Option<f64> {
    let (count, sum) = values.clone().fold((0.0, 0.0), |(count, sum), value| (count + 1.0, sum + value));
    let mean = sum / count;
    (count > 2.0).then(|| values.map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::Stream;

    #[test]
    fn the_permanent_error_of_a_step_is_separated_from_the_noise_of_its_poses() {
        const STEPS: usize = 8;
        let (share, mut stream) = (0.3_f64, Stream::new(5));
        for (pose, left) in [(1.0, 0.0), (0.5, 1.0), (2.0, 0.6)] {
            let (mut steps, mut closure_errors) = (vec![Vec::new(); STEPS], Vec::new());
            for _ in 0..4000 {
                let poses: [f64; STEPS + 1] = std::array::from_fn(|_| pose * stream.normal());
                let mut sum = poses[0] - poses[STEPS] + left * share * stream.normal();
                for (k, steps) in steps.iter_mut().enumerate() {
                    let step = poses[k + 1] - poses[k] + left * share * stream.normal();
                    steps.push([step; 3]);
                    sum += step;
                }
                closure_errors.push([sum; 3]);
            }
            let mut parts = VarianceSums::default();
            parts.add_closure_errors(&closure_errors, 0, (STEPS + 1) as f64 * share.powi(2));
            steps.iter().for_each(|steps| parts.add_steps(steps, 0, share.powi(2)));
            let [white, walk] = parts.estimate();
            assert!((white / pose - 1.0).abs() < 0.03, "{pose}: {white}");
            assert!((walk - left / pose).abs() < 0.04, "{pose}, {left}: {walk}");
        }
    }
}
