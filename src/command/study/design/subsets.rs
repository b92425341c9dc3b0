//! The white noise of a pose that steps over subsets lead to, and how much they leave for good.
//!
//! Short steps and a long one between the same two frames have the noise of the same two poses: what they differ by is
//! what each of them left, and what a step scatters by beyond that is the noise of its two poses. Both depend on how
//! finely the pattern is sampled, so they are seen on films of this very rig.

use super::noise::steps;
use super::rig::Rig;
use crate::motion::subset_walk;
use crate::process::analysis_params;
use crate::results::BodyStep;
use crate::synth::World;

/// How often the film is drawn; with as many long steps one after the other, the ratio is known to 7 %.
const TAKES: u64 = 16;
const LONG_STEPS: u64 = 6;

/// What a long step spans where the rig has one interval only, short ones.
const LONG: u32 = 8;

/// What steps were seen to do, of each x px, y px and angle deg.
#[derive(Debug, Clone)]
pub(super) struct Stepped {
    /// White noise of a pose.
    pub(super) pose: [f64; 3],
    /// How much more than assumed a step leaves for good.
    pub(super) walk: [f64; 3],
}

/// Sees how steps from `first` on scatter.
///
/// # Errors
///
/// When a film cannot be drawn or its settings cannot be measured with.
pub(super) fn stepped(rig: &Rig, world: &World, first: u64) -> anyhow::Result<Stepped> {
    let intervals = &rig.config.intervals_frames;
    let short = intervals[0];
    let long = intervals.get(1).copied().unwrap_or(short * LONG);
    let (mut params, _) = analysis_params(&rig.config, &rig.format());
    params.intervals_frames = vec![short, long];
    let count = (world.frames() - 1 - first).min(LONG_STEPS * u64::from(long)) / u64::from(long);
    let frames = first..first + count * u64::from(long) + 1;
    let mut takes = Vec::new();
    for take in 1..=TAKES {
        takes.push(steps(&params, &world.retake(rig.scenario.motion.clone(), take)?, frames.clone())?);
    }
    let shares = |from: u64, interval: u32| {
        let pose = |frame: u64| {
            let truth = world.truth(frame);
            [truth.center_x_px.unwrap_or_default(), truth.center_y_px.unwrap_or_default(), world.angle_deg(frame)]
        };
        let (here, there) = (pose(from), pose(from + u64::from(interval)));
        subset_walk([0, 1, 2].map(|k| there[k] - here[k]))
    };
    let mut parts = [Parts::default(); 3];
    for start in (0..count).map(|at| first + at * u64::from(long)) {
        let shorts: Vec<u64> = (start..start + u64::from(long)).step_by(short as usize).collect();
        let closures: Vec<_> = takes.iter().filter_map(|rows| closure(rows, start, short, long)).collect();
        let whole = shares(start, long);
        for (k, parts) in parts.iter_mut().enumerate() {
            let each: f64 = shorts.iter().map(|from| shares(*from, short)[k].powi(2)).sum();
            parts.close(&closures, k, each + whole[k].powi(2));
            for from in &shorts {
                let moved: Vec<_> = takes.iter().filter_map(|rows| moved(rows, *from, short)).collect();
                parts.step(&moved, k, shares(*from, short)[k].powi(2));
            }
        }
    }
    let told = parts.map(|parts| parts.told());
    Ok(Stepped { pose: told.map(|[pose, _]| pose), walk: told.map(|[_, walk]| walk) })
}

/// Sums of variances, and of the squared shares that they are expected to leave.
#[derive(Debug, Clone, Copy, Default)]
struct Parts {
    closed: f64,
    closed_shares: f64,
    stepped: f64,
    stepped_shares: f64,
    steps: f64,
}

impl Parts {
    fn close(&mut self, off: &[[f64; 3]], k: usize, shares: f64) {
        if let Some(variance) = variance(off.iter().map(|off| off[k])) {
            (self.closed, self.closed_shares) = (self.closed + variance, self.closed_shares + shares);
        }
    }

    fn step(&mut self, moved: &[[f64; 3]], k: usize, shares: f64) {
        if let Some(variance) = variance(moved.iter().map(|moved| moved[k])) {
            (self.stepped, self.stepped_shares) = (self.stepped + variance, self.stepped_shares + shares);
            self.steps += 1.0;
        }
    }

    /// White noise of a pose, and how much of it is left for each share that is expected to be.
    fn told(&self) -> [f64; 2] {
        let left = if self.closed_shares > 0.0 { self.closed / self.closed_shares } else { 0.0 };
        let pose = 0.5 * (self.stepped - left * self.stepped_shares) / self.steps.max(1.0);
        if pose > 0.0 { [pose.sqrt(), (left / pose).sqrt()] } else { [0.0, 1.0] }
    }
}

/// The sum of the short steps less the long one; `None` where one is missing.
fn closure(rows: &[BodyStep], start: u64, short: u32, long: u32) -> Option<[f64; 3]> {
    let mut sum = moved(rows, start, long)?.map(|whole| -whole);
    for from in (start..start + u64::from(long)).step_by(short as usize) {
        let step = moved(rows, from, short)?;
        sum = [0, 1, 2].map(|k| sum[k] + step[k]);
    }
    Some(sum)
}

/// What a step over this interval moved by.
fn moved(rows: &[BodyStep], from: u64, interval: u32) -> Option<[f64; 3]> {
    let row = rows.iter().find(|row| row.frame == from && row.interval_frames == interval)?;
    let step = row.step?;
    Some([step.dx_px, step.dy_px, step.dtheta_deg].map(|mean| mean * f64::from(interval)))
}

/// About the mean: what is the same in all takes is no noise.
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
    fn what_a_step_leaves_is_told_from_the_noise_of_its_poses() {
        const STEPS: usize = 8;
        let (share, mut stream) = (0.3_f64, Stream::new(5));
        for (pose, left) in [(1.0, 0.0), (0.5, 1.0), (2.0, 0.6)] {
            let (mut steps, mut closures) = (vec![Vec::new(); STEPS], Vec::new());
            for _ in 0..4000 {
                let poses: [f64; STEPS + 1] = std::array::from_fn(|_| pose * stream.normal());
                let mut sum = poses[0] - poses[STEPS] + left * share * stream.normal();
                for (k, steps) in steps.iter_mut().enumerate() {
                    let step = poses[k + 1] - poses[k] + left * share * stream.normal();
                    steps.push([step; 3]);
                    sum += step;
                }
                closures.push([sum; 3]);
            }
            let mut parts = Parts::default();
            parts.close(&closures, 0, (STEPS + 1) as f64 * share.powi(2));
            steps.iter().for_each(|steps| parts.step(steps, 0, share.powi(2)));
            let [white, walk] = parts.told();
            assert!((white / pose - 1.0).abs() < 0.03, "{pose}: {white}");
            assert!((walk - left / pose).abs() < 0.04, "{pose}, {left}: {walk}");
        }
    }
}
