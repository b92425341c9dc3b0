//! How much steps over subsets leave for good, compared with what is assumed of them.
//!
//! Short steps and a long one between the same two frames have the noise of the same two poses: what they differ by is
//! what each of them left. It depends on how finely the pattern is sampled, so it is seen on films of this very rig.

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

/// Found over assumed, of x, y and angle; `pose` is the white noise of a pose.
///
/// # Errors
///
/// When a film cannot be drawn or its settings cannot be measured with.
pub(super) fn ratio(rig: &Rig, world: &World, first: u64, pose: [f64; 3]) -> anyhow::Result<[f64; 3]> {
    let intervals = &rig.config.intervals_frames;
    let short = intervals[0];
    let long = intervals.get(1).copied().unwrap_or(short * LONG);
    let (mut params, _) = analysis_params(&rig.config, &rig.format());
    params.intervals_frames = vec![short, long];
    let count = (world.frames() - 1 - first).min(LONG_STEPS * u64::from(long)) / u64::from(long);
    let frames = first..first + count * u64::from(long) + 1;
    let starts: Vec<u64> = (0..count).map(|k| first + k * u64::from(long)).collect();
    let mut takes = Vec::new();
    for take in 1..=TAKES {
        let film = world.retake(rig.scenario.motion.clone(), take)?;
        let rows = steps(&params, &film, frames.clone())?;
        takes.push(starts.iter().map(|start| closure(&rows, *start, short, long)).collect::<Vec<_>>());
    }
    let assumed = |start: u64| {
        let left = |from: u64, frames: u32| {
            let pose = |frame: u64| {
                let truth = world.truth(frame);
                [truth.center_x_px.unwrap_or_default(), truth.center_y_px.unwrap_or_default(), world.angle_deg(frame)]
            };
            let (here, there) = (pose(from), pose(from + u64::from(frames)));
            subset_walk([0, 1, 2].map(|k| there[k] - here[k]))
        };
        let shorts = (start..start + u64::from(long)).step_by(short as usize).map(|from| left(from, short));
        let all: Vec<[f64; 3]> = shorts.chain([left(start, long)]).collect();
        [0, 1, 2].map(|k| all.iter().map(|share| (share[k] * pose[k]).powi(2)).sum::<f64>())
    };
    Ok([0, 1, 2].map(|k| {
        let (mut found, mut expected) = (0.0, 0.0);
        for (at, start) in starts.iter().enumerate() {
            let off: Vec<f64> = takes.iter().filter_map(|take| Some(take[at]?[k])).collect();
            if let Some(variance) = variance(&off) {
                found += variance;
                expected += assumed(*start)[k];
            }
        }
        if expected > 0.0 { f64::sqrt(found / expected) } else { 1.0 }
    }))
}

/// The sum of the short steps less the long one; `None` where one is missing.
fn closure(rows: &[BodyStep], start: u64, short: u32, long: u32) -> Option<[f64; 3]> {
    let moved = |from: u64, interval: u32| {
        let row = rows.iter().find(|row| row.frame == from && row.interval_frames == interval)?;
        let step = row.step?;
        Some([step.dx_px, step.dy_px, step.dtheta_deg].map(|mean| mean * f64::from(interval)))
    };
    let mut sum = moved(start, long)?.map(|whole| -whole);
    for from in (start..start + u64::from(long)).step_by(short as usize) {
        let step = moved(from, short)?;
        sum = [0, 1, 2].map(|k| sum[k] + step[k]);
    }
    Some(sum)
}

/// About the mean: what is the same in all takes is no noise.
fn variance(values: &[f64]) -> Option<f64> {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    (values.len() > 2).then(|| values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0))
}
