//! The scatter of whole-body matches, and the permanent error of a reference update.
//!
//! A pose measured by way of a second reference differs slightly from a direct one. The noise of the frame between
//! them is interpolated once as a target and used as is as a reference. The effect depends on how finely the pattern
//! is sampled, so it is observed on rendered frames of this rig with independent noise.

use super::films::ball_region;
use super::rig::Rig;
use crate::camera::simulated;
use crate::dic::{Correlator, PlanarMotion, Point, PreparedFrame, RigidBody};
use crate::failure::Failure;
use crate::image::{Frame, Image};
use crate::synth::SimulatedFilm;
use std::ops::RangeInclusive;

/// Number of renderings: the error of an update is known to 15 %, the scatter of a pose to 4 %.
const RENDERINGS: u64 = 24;

/// Number of last frames that are compared.
const LAST_FRAMES: u64 = 4;

/// Frames in which the reference is updated, in sixteenths of the interval. They differ in how far the body is from
/// whole pixels.
const RENEWED_AT: [u64; 3] = [5, 8, 11];

/// The observed errors of whole-body matches in x px, y px and angle deg.
#[derive(Debug, Clone)]
pub(super) struct MatchNoise {
    /// Scatter of the permanent error of an update.
    pub(super) renewal: [f64; 3],
    /// Variance of the pose in each of several frames.
    pub(super) poses: Vec<PoseVariance>,
}

/// The variance of a pose in one frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct PoseVariance {
    /// In px^2, px^2 and deg^2.
    pub(super) variance: [f64; 3],
    /// Motion of the body since the first frame, px.
    pub(super) motion_px: [f64; 2],
}

/// The matches of one rendering, in x px, y px and angle deg.
struct RenderingMatches {
    /// Path through each updated reference minus the direct match, for each of the last frames.
    closure_errors: Vec<Vec<[f64; 3]>>,
    /// Direct match from the first frame to each other frame.
    direct: Vec<[f64; 3]>,
}

/// Variance shared by all frames of a rendering, and of each frame alone.
struct VarianceParts {
    shared: f64,
    own: Vec<f64>,
}

/// Observes the scatter of poses over an interval of frames, and the permanent error of an update between them.
///
/// Both paths from the first to a last frame differ by the error of the update, which all later frames share, and by
/// the interpolation of the last frame, which is its own noise. Several last frames separate the two. Interpolation
/// reduces the noise of a pose, the more so the finer the pattern.
///
/// # Errors
///
/// When a film cannot be rendered or the settings cannot be used.
pub(super) fn observe_matches(
    rig: &Rig,
    film: &SimulatedFilm,
    interval: RangeInclusive<u64>,
) -> Result<MatchNoise, Failure> {
    let (first, last) = interval.into_inner();
    let (width, height) = (film.width_px() as usize, film.height_px() as usize);
    let correlator = Correlator::new(&rig.config.correlation(), width, height)?;
    let mut renewed = RENEWED_AT.map(|at| first + (at * (last - first) / 16).max(1)).to_vec();
    renewed.dedup();
    renewed.retain(|at| *at < last);
    let lasts = (last + 1).saturating_sub(LAST_FRAMES).max(renewed.last().unwrap_or(&first) + 1)..=last;
    let frames: Vec<u64> = [first].into_iter().chain(renewed.iter().copied()).chain(lasts).collect();
    let (mut closure_errors, mut direct) = (vec![Vec::new(); renewed.len()], Vec::new());
    for number in 1..=RENDERINGS {
        let rendering = film.retake(rig.scenario.motion.clone(), number)?;
        let prepared = frames
            .iter()
            .map(|index| render_prepared(&rendering, &correlator, *index))
            .collect::<Result<Vec<_>, _>>()?;
        if let Some(matches) = match_frames(rig, &rendering, &frames, &prepared, renewed.len()) {
            closure_errors.iter_mut().zip(matches.closure_errors).for_each(|(all, own)| all.push(own));
            direct.push(matches.direct);
        }
    }
    let own = [0, 1, 2].map(|k| separate_variances(&direct, k).own);
    let center_px = |frame: u64| {
        let truth = film.truth(frame);
        [truth.center_x_px, truth.center_y_px].map(Option::unwrap_or_default)
    };
    let motion_px = |frame: u64| [0, 1].map(|k| center_px(frame)[k] - center_px(first)[k]);
    let pose =
        |at: usize| PoseVariance { variance: own.each_ref().map(|own| own[at]), motion_px: motion_px(frames[at + 1]) };
    let poses = (0..own[0].len()).map(pose).collect();
    let shared_variance =
        |k: usize| closure_errors.iter().map(|errors| separate_variances(errors, k).shared).sum::<f64>();
    let mean_variance = |k: usize| shared_variance(k) / closure_errors.len().max(1) as f64;
    Ok(MatchNoise { renewal: [0, 1, 2].map(|k| mean_variance(k).sqrt()), poses })
}

/// Separates the variance of coordinate `k` over renderings into a part shared by all frames and a part of each frame.
///
/// `errors` has a list by frame for each rendering. The parts are the components of a two-way analysis of variance. A
/// single frame has the shared part alone, and fewer than two renderings give zero.
fn separate_variances(errors: &[Vec<[f64; 3]>], k: usize) -> VarianceParts {
    let (count, frames) = (errors.len(), errors.first().map_or(0, Vec::len));
    if count < 2 || frames == 0 {
        return VarianceParts { shared: 0.0, own: Vec::new() };
    }
    let mean = |frame: usize| errors.iter().map(|rendering| rendering[frame][k]).sum::<f64>() / count as f64;
    let means: Vec<f64> = (0..frames).map(mean).collect();
    let (mut between, mut within) = (0.0, vec![0.0; frames]);
    for rendering in errors {
        let deviation = |frame: usize| rendering[frame][k] - means[frame];
        let shared = (0..frames).map(deviation).sum::<f64>() / frames as f64;
        between += shared * shared;
        within.iter_mut().enumerate().for_each(|(frame, sum)| *sum += (deviation(frame) - shared).powi(2));
    }
    let free = (count - 1) as f64;
    if frames == 1 {
        return VarianceParts { shared: between / free, own: Vec::new() };
    }
    let own: Vec<f64> = within.iter().map(|sum| sum * frames as f64 / (free * (frames - 1) as f64)).collect();
    let mean = own.iter().sum::<f64>() / frames as f64;
    VarianceParts { shared: (between / free - mean / frames as f64).max(0.0), own }
}

/// Renders a frame of a film and prepares it for correlation.
///
/// # Errors
///
/// When the rendered bytes are not a frame.
fn render_prepared(film: &SimulatedFilm, correlator: &Correlator, index: u64) -> Result<PreparedFrame, Failure> {
    let (mut bytes, mut image) = (vec![0; film.frame_bytes()], Image::default());
    film.render(index, &mut bytes);
    Frame { meta: simulated::meta(film, index), bytes: &bytes }.unpack(&mut image)?;
    Ok(correlator.prepare(image.view()))
}

/// Matches every frame with the first, and the last frames with each of the `renewed` updated references; `None` if a
/// match fails.
///
/// `frames` are the indices of the `prepared` frames: the first frame, the updated references, and the last frames.
fn match_frames(
    rig: &Rig,
    film: &SimulatedFilm,
    frames: &[u64],
    prepared: &[PreparedFrame],
    renewed: usize,
) -> Option<RenderingMatches> {
    let pose = |index: &u64| {
        let truth = film.truth(*index);
        Some([truth.center_x_px?, truth.center_y_px?, film.angle_deg(*index)])
    };
    let poses = frames.iter().map(pose).collect::<Option<Vec<_>>>()?;
    let body = |at: usize| RigidBody::new(&prepared[at], &ball_region(rig, [poses[at][0], poses[at][1]])).ok();
    let step = |body: &mut RigidBody, from: usize, to: usize| {
        let [x, y, _] = poses[from];
        let [u_px, v_px, angle_deg] = std::array::from_fn(|k| poses[to][k] - poses[from][k]);
        let near = PlanarMotion { u_px, v_px, angle_deg };
        let motion = body.find(&prepared[to], Point::new(x, y), near).ok()?.motion;
        Some([motion.u_px, motion.v_px, motion.angle_deg])
    };
    let mut first = body(0)?;
    let direct = (1..frames.len()).map(|to| step(&mut first, 0, to)).collect::<Option<Vec<_>>>()?;
    let errors_through = |at: usize| {
        let mut second = body(at)?;
        let closure_error = |to: usize| {
            let last_leg = step(&mut second, at, to)?;
            Some(std::array::from_fn(|k| direct[at - 1][k] + last_leg[k] - direct[to - 1][k]))
        };
        (renewed + 1..frames.len()).map(closure_error).collect::<Option<Vec<_>>>()
    };
    let closure_errors = (1..=renewed).map(errors_through).collect::<Option<Vec<_>>>()?;
    Some(RenderingMatches { closure_errors, direct })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_noise_of_the_last_frames_is_not_mistaken_for_a_lasting_error() {
        let mut stream = crate::numeric::Stream::new(7);
        let take = |stream: &mut crate::numeric::Stream, shared: f64, own: f64| {
            let lasting = shared * stream.normal();
            (0..4).map(|last| [lasting + own * stream.normal() + f64::from(last), 0.0, 0.0]).collect::<Vec<_>>()
        };
        for (shared, own) in [(0.3, 0.5), (0.5, 0.0), (0.0, 0.5)] {
            let takes: Vec<_> = (0..4000).map(|_| take(&mut stream, shared, own)).collect();
            let [first, second] = [0, 1].map(|k| separate_variances(&takes, k));
            assert!((first.shared - shared * shared).abs() < 0.01, "{shared}, {own}: {}", first.shared);
            assert!(first.own.iter().all(|seen| (seen - own * own).abs() < 0.03), "{shared}, {own}: {:?}", first.own);
            assert_eq!((second.shared.to_bits(), second.own), (0, vec![0.0; 4]));
        }
    }
}
