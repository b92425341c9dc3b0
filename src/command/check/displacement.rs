//! The noise floor: displacements that the rig measures in static frames.

use super::grab::{Grabbed, now};
use crate::config::Config;
use crate::failure::Failure;
use crate::image::Frame;
use crate::measure::{Measured, Measurer, Share};
use crate::process::{analysis_params, reference_picture};
use crate::results::{PairField, PointStatus, RigidStep};
use crate::track::{OrderedTracker, TrackerParams};

/// A body is static if its mean motion is below this many standard errors, or below `STILL_PX` and `STILL_DEG`.
const STILL_SIGMAS: f64 = 5.0;
/// The negligible motion, px per frame.
const STILL_PX: f64 = 0.01;
/// The negligible rotation, deg per frame.
const STILL_DEG: f64 = 0.01;

/// Minimum number of displacements for a scatter.
const MIN_POINTS: usize = 30;

/// The displacements measured in a static scene.
pub(super) struct NoiseFloor {
    /// Every measurement.
    pub(super) measured: Vec<Measured>,
    /// Scatter of the subset displacements per axis, px; `None` if the body moves or too few subsets were measured.
    pub(super) subset_px: Option<f64>,
    /// Scatter of the body motion per axis, px and deg; `None` if the body moves.
    pub(super) body_px: Option<f64>,
    pub(super) body_deg: Option<f64>,
    /// Mean motion per frame of a moving body, px and deg.
    pub(super) motion: Option<(f64, f64)>,
    /// Fraction of the frames in which a body was found.
    pub(super) found_fraction: f64,
    /// Fraction of the subsets that are valid.
    pub(super) valid_fraction: f64,
    /// Processor time per frame of a worker, s.
    measure_s: f64,
    /// Processor time per frame of the other processes, s: the copy into the ring and the tracker.
    overhead_s: f64,
}

impl NoiseFloor {
    /// Returns the frame rate that `workers` workers sustain on `processors` processors, which the other processes need
    /// as well, Hz.
    pub(super) fn capacity_hz(&self, workers: usize, processors: usize) -> f64 {
        let measured_hz = workers as f64 / self.measure_s;
        measured_hz.min(processors as f64 / (self.measure_s + self.overhead_s))
    }

    /// Returns the fields of the first frame pair, one per body.
    pub(super) fn first_fields(&self) -> Vec<&PairField> {
        let first = self.measured.iter().filter_map(|measured| measured.field.as_ref()).map(|field| field.frame).min();
        let fields = self.measured.iter().filter_map(|measured| measured.field.as_ref());
        fields.filter(|field| Some(field.frame) == first).collect()
    }
}

/// Measures the kept frames with the rig's own configuration, and evaluates the steps over the shortest interval.
///
/// # Errors
///
/// When the frames cannot be measured.
pub(super) fn measure_noise_floor(config: &Config, grabbed: &Grabbed) -> Result<NoiseFloor, Failure> {
    let format = grabbed.format;
    let (params, tracker_params) = analysis_params(config, &format);
    let shortest = params.intervals_frames[0];
    let mut measurer = Measurer::new(&params, Share::ALL, format.width_px as usize, format.height_px as usize)?;
    let first = grabbed.frames.first();
    let picture =
        first.and_then(|(meta, bytes)| reference_picture::from_first_frame(&Frame { meta: *meta, bytes }, config));
    picture.iter().try_for_each(|picture| measurer.set_reference(picture))?;
    let mut measured = Vec::new();
    let began = now();
    for (meta, bytes) in &grabbed.frames {
        measurer.push(&Frame { meta: *meta, bytes }, &mut measured)?;
    }
    measurer.finish(&mut measured);
    let frames = grabbed.frames.len().max(1) as f64;
    let measure_s = began.elapsed().as_secs_f64().max(1e-9) / frames;
    let overhead_s = overhead_s(grabbed, &measured, &tracker_params) / frames;
    measured.retain(|measured| measured.step.interval_frames == shortest);
    let detected = measured.iter().filter(|measured| measured.step.outline.is_some()).count();
    let points = || measured.iter().filter_map(|measured| measured.field.as_ref()).flat_map(|field| &field.points);
    let valid = points().filter(|point| point.status == PointStatus::Valid).count();
    let steps: Vec<[f64; 3]> = measured
        .iter()
        .filter_map(|measured| {
            measured.step.motion.filter(RigidStep::has_rotation).map(|step| [step.dx_px, step.dy_px, step.dtheta_deg])
        })
        .collect();
    let motion = significant_motion(&steps);
    let still = motion.is_none();
    let spreads = standard_deviations(&steps);
    let body = |axes: &[usize]| {
        let squares = axes.iter().map(|axis| spreads.map(|spreads| spreads[*axis].powi(2))).sum::<Option<f64>>();
        squares.filter(|_| still).map(|squares| (squares / axes.len() as f64).sqrt())
    };
    Ok(NoiseFloor {
        subset_px: subset_scatter_px(&measured).filter(|_| still),
        body_px: body(&[0, 1]),
        body_deg: body(&[2]),
        motion,
        found_fraction: detected as f64 / measured.len().max(1) as f64,
        valid_fraction: valid as f64 / points().count().max(1) as f64,
        measure_s,
        overhead_s,
        measured,
    })
}

/// Returns the time that the processes around the workers take for all frames, s: the copy of each frame, and the
/// tracker's work on their steps.
fn overhead_s(grabbed: &Grabbed, measured: &[Measured], params: &TrackerParams) -> f64 {
    let began = now();
    let mut slot = vec![0; grabbed.format.slot_bytes()];
    for (_, bytes) in &grabbed.frames {
        let bytes = &bytes[..bytes.len().min(slot.len())];
        std::hint::black_box(&mut slot)[..bytes.len()].copy_from_slice(bytes);
    }
    let frames = grabbed.frames.len() as u64;
    let mut tracker = OrderedTracker::new(params, 0, frames);
    for measured in measured {
        std::hint::black_box(tracker.push(measured.step));
    }
    std::hint::black_box(tracker.finish(frames));
    began.elapsed().as_secs_f64()
}

/// Returns the mean of each component: dx and dy in px, rotation in deg; NaN without steps.
fn means(steps: &[[f64; 3]]) -> [f64; 3] {
    std::array::from_fn(|axis| steps.iter().map(|step| step[axis]).sum::<f64>() / steps.len() as f64)
}

/// Returns the sample standard deviation of each component; `None` for fewer than two steps.
fn standard_deviations(steps: &[[f64; 3]]) -> Option<[f64; 3]> {
    let means = means(steps);
    let squares = |axis: usize| steps.iter().map(|step| (step[axis] - means[axis]).powi(2)).sum::<f64>();
    (steps.len() >= 2).then(|| std::array::from_fn(|axis| (squares(axis) / (steps.len() as f64 - 1.0)).sqrt()))
}

/// Returns the magnitudes of the mean displacement, px, and the mean rotation, deg, per frame; `None` if the body is
/// static or there are fewer than two steps.
///
/// It moves if one component exceeds both [`STILL_PX`] or [`STILL_DEG`] and [`STILL_SIGMAS`] standard errors of its
/// mean.
fn significant_motion(steps: &[[f64; 3]]) -> Option<(f64, f64)> {
    let (means, spreads) = (means(steps), standard_deviations(steps)?);
    let clear = |axis: usize, still: f64| {
        means[axis].abs() > still && means[axis].abs() > STILL_SIGMAS * spreads[axis] / (steps.len() as f64).sqrt()
    };
    (clear(0, STILL_PX) || clear(1, STILL_PX) || clear(2, STILL_DEG))
        .then(|| (means[0].hypot(means[1]), means[2].abs()))
}

/// Returns the sample standard deviation of the subset displacements over all frames, root mean square over both axes,
/// px.
///
/// `None` for fewer than [`MIN_POINTS`] valid displacements.
fn subset_scatter_px(measured: &[Measured]) -> Option<f64> {
    let fields = measured.iter().filter_map(|measured| measured.field.as_ref());
    let valid = fields.flat_map(|field| &field.points).filter(|point| point.status == PointStatus::Valid);
    let moved: Vec<[f64; 2]> = valid
        .filter_map(|point| point.displacement.map(|moved| [f64::from(moved.u_px), f64::from(moved.v_px)]))
        .collect();
    if moved.len() < MIN_POINTS {
        return None;
    }
    let count = moved.len() as f64;
    let variance = |axis: usize| {
        let mean = moved.iter().map(|moved| moved[axis]).sum::<f64>() / count;
        moved.iter().map(|moved| (moved[axis] - mean).powi(2)).sum::<f64>() / (count - 1.0)
    };
    Some((0.5 * (variance(0) + variance(1))).sqrt())
}
