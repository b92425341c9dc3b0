//! What the renewal of a reference leaves for good.
//!
//! A pose by way of a second reference is not quite that of the first: the noise of the frame between them was
//! interpolated once and is taken as it is the other time. How much that comes to depends on how finely the pattern is
//! sampled, so it is seen on a few pictures of this very rig, drawn several times.

use super::noise::pixels_of;
use super::rig::Rig;
use crate::camera::simulated;
use crate::dic::{Correlator, Prepared, RigidBody};
use crate::image::{Frame, Image};
use crate::synth::World;

/// How often the pictures are drawn: the scatter is known to 15 %.
const TAKES: u64 = 24;

/// Last frames that are compared.
const LAST: u64 = 4;

/// Scatter of what a renewal in the middle of `first` to `last` leaves: x px, y px, angle deg.
///
/// Both ways from the first frame to a last one differ by what the renewal leaves in all later frames, and by how that
/// last frame is interpolated, which is no more than its own noise: several last frames tell one from the other.
///
/// # Errors
///
/// When a film cannot be drawn or its settings cannot be measured with.
pub(super) fn walk(rig: &Rig, world: &World, (first, last): (u64, u64)) -> anyhow::Result<[f64; 3]> {
    let (width, height) = (world.width_px() as usize, world.height_px() as usize);
    let correlator = Correlator::new(&rig.config.correlation(), width, height)?;
    let middle = first.midpoint(last);
    let lasts = (last + 1).saturating_sub(LAST).max(middle + 1)..=last;
    let frames: Vec<u64> = [first, middle].into_iter().chain(lasts).collect();
    let mut takes = Vec::new();
    for take in 1..=TAKES {
        let film = world.retake(rig.scenario.motion.clone(), take)?;
        let pictures = frames.iter().map(|index| picture(&film, &correlator, *index)).collect::<Result<Vec<_>, _>>()?;
        takes.extend(closures(rig, &film, &frames, &pictures));
    }
    Ok([0, 1, 2].map(|k| lasting(&takes, k).sqrt()))
}

/// Variance of the part that all last frames of a take share.
fn lasting(takes: &[Vec<[f64; 3]>], k: usize) -> f64 {
    let (count, lasts) = (takes.len(), takes.first().map_or(0, Vec::len));
    if count < 2 || lasts == 0 {
        return 0.0;
    }
    // What is the same in all takes is no noise.
    let mean = |last: usize| takes.iter().map(|take| take[last][k]).sum::<f64>() / count as f64;
    let means: Vec<f64> = (0..lasts).map(mean).collect();
    let (mut between, mut within) = (0.0, 0.0);
    for take in takes {
        let off = |last: usize| take[last][k] - means[last];
        let shared = (0..lasts).map(off).sum::<f64>() / lasts as f64;
        between += shared * shared;
        within += (0..lasts).map(|last| (off(last) - shared).powi(2)).sum::<f64>();
    }
    let free = (count - 1) as f64;
    let own = if lasts > 1 { within / (free * (lasts - 1) as f64) } else { 0.0 };
    (between / free - own / lasts as f64).max(0.0)
}

fn picture(film: &World, correlator: &Correlator, index: u64) -> anyhow::Result<Prepared> {
    let (mut bytes, mut image) = (vec![0; film.frame_bytes()], Image::default());
    film.render(index, &mut bytes);
    Frame { meta: simulated::meta(film, index), bytes: &bytes }.unpack(&mut image)?;
    Ok(correlator.prepare(image.view()))
}

/// By way of the second frame less straight on, to each frame after it; `None` where a match fails.
fn closures(rig: &Rig, film: &World, frames: &[u64], pictures: &[Prepared]) -> Option<Vec<[f64; 3]>> {
    let pose = |index: &u64| {
        let truth = film.truth(*index);
        Some([truth.center_x_px?, truth.center_y_px?, film.angle_deg(*index)])
    };
    let poses = frames.iter().map(pose).collect::<Option<Vec<_>>>()?;
    let body = |at: usize| RigidBody::new(&pictures[at], &pixels_of(rig, [poses[at][0], poses[at][1]])).ok();
    let step = |body: &mut RigidBody, from: usize, to: usize| {
        let [x, y, _] = poses[from];
        let near: [f64; 3] = std::array::from_fn(|k| poses[to][k] - poses[from][k]);
        let motion = body.find(&pictures[to], (x, y), (near[0], near[1], near[2])).ok()?.motion;
        Some([motion.u_px, motion.v_px, motion.angle_deg])
    };
    let (mut first, mut second) = (body(0)?, body(1)?);
    let between = step(&mut first, 0, 1)?;
    let close = |to: usize| {
        let (by_way, straight) = (step(&mut second, 1, to)?, step(&mut first, 0, to)?);
        Some(std::array::from_fn(|k| between[k] + by_way[k] - straight[k]))
    };
    (2..frames.len()).map(close).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_differs_from_last_frame_to_last_frame_is_not_taken_for_what_lasts() {
        let mut stream = crate::synth::Stream::new(7);
        let take = |stream: &mut crate::synth::Stream, shared: f64, own: f64| {
            let lasting = shared * stream.normal();
            (0..4).map(|last| [lasting + own * stream.normal() + f64::from(last), 0.0, 0.0]).collect::<Vec<_>>()
        };
        for (shared, own) in [(0.3, 0.5), (0.5, 0.0), (0.0, 0.5)] {
            let takes: Vec<_> = (0..4000).map(|_| take(&mut stream, shared, own)).collect();
            assert!((lasting(&takes, 0) - shared * shared).abs() < 0.01, "{shared}, {own}: {}", lasting(&takes, 0));
            assert_eq!(lasting(&takes, 1).to_bits(), 0);
        }
    }
}
