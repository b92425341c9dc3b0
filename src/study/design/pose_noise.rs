//! The scatter of a pose, estimated from rendered frames of the rig.

use super::films::{ball_region, measure_steps};
use super::reference_renewal::PoseVariance;
use super::rig::Rig;
use super::{reference_renewal, subset_noise};
use crate::console::UsageError;
use crate::dic::{Correlator, Point, RigidBody};
use crate::failure::Failure;
use crate::image::Image;
use crate::process::analysis_params;
use crate::results::{BodyStep, MotionMethod, PointStatus};
use crate::synth::SimulatedFilm;
use std::ops::Range;

/// Number of frames that are rendered and measured to see how the body is tracked.
const MEASURED_FRAMES: u64 = 3;

/// Length of a block: the reference is updated at least this often, frames.
const BLOCK_FRAMES: u64 = 16;

/// Minimum visible fraction of a body that counts as fully visible.
const MIN_VISIBLE: f64 = 0.97;

/// The uncertainty of a pose.
#[derive(Debug, Clone)]
pub(super) struct PoseNoise {
    /// Scatter of a pose: x px, y px, angle deg.
    pub(super) pose: [f64; 3],
    /// Random-walk error added by an update of the reference in whole-body matching, in the same units.
    pub(super) renewal: [f64; 3],
    /// Random-walk error of a step over subsets, relative to the assumed one: x, y and angle.
    pub(super) walk: [f64; 3],
    /// Reported sigma of a pose over its actual scatter.
    pub(super) reported_ratio: [f64; 3],
    /// Reduction of the variance of a pose by interpolation half-way between pixels, per axis.
    pub(super) smoothing: f64,
    /// Noise of the body's pixels, weighted by their gradients, DN.
    pub(super) pixel_dn: f64,
    /// A measured step of the body.
    pub(super) step: BodyStep,
    /// Offset of the measured centre from the truth, px.
    pub(super) center_offset_px: [f64; 2],
}

/// Maximum of the reduction.
const MAX_SMOOTHING: f64 = 0.4;

impl PoseNoise {
    /// Returns the scatter (sigma; px, px, deg) of a pose of a body that has moved by `moved_px` since its reference
    /// was taken.
    pub(super) fn pose_at(&self, moved_px: [f64; 2]) -> [f64; 3] {
        let remaining = (1.0 - self.smoothing * subpixel_phase(moved_px)).sqrt();
        self.pose.map(|sigma| remaining * sigma)
    }

    /// Estimates the noise of a rig. Whole-body matching uses the noise bound of the pattern, subsets use the
    /// observed scatter of steps.
    ///
    /// # Errors
    ///
    /// When the body cannot be tracked in the rendered frames.
    pub(super) fn estimate(rig: &Rig, film: &SimulatedFilm) -> Result<Self, Failure> {
        let origin = &rig.config.origin;
        let longest = u64::from(rig.config.intervals_frames[0]);
        let is_visible = |index: &u64| {
            let truth = film.truth(*index);
            truth.status == PointStatus::Valid && truth.visible_fraction.is_none_or(|share| share >= MIN_VISIBLE)
        };
        let count = MEASURED_FRAMES + longest;
        let first = (0..film.frames())
            .find(|index| index + count <= film.frames() && is_visible(index) && is_visible(&(index + count - 1)));
        let Some(first) = first else {
            return Err(UsageError(format!("{origin}: the body is never fully visible for {count} frames")).into());
        };
        let steps = measure_shortest_steps(rig, film, first..first + count)?;
        let found: Vec<&BodyStep> = steps.iter().filter(|step| step.motion.is_some()).collect();
        let Some(step) = found.first().map(|step| **step) else {
            let status = steps.first().map_or(PointStatus::Lost, |step| step.status);
            let why = format!("{origin}: cannot track the body in the rendered frames: {}", status.as_str());
            return Err(UsageError(why).into());
        };
        let truth = film.truth(step.frame);
        let center_px = [truth.center_x_px.unwrap_or_default(), truth.center_y_px.unwrap_or_default()];
        let noise_free = film.render_light(first);
        let pixel_dn = pixel_noise_dn(rig, &noise_free, center_px);
        let mut smoothing = 0.0;
        let (pose, renewal, walk, reported_ratio) = match step.method {
            MotionMethod::WholeBody => {
                let bound = noise_bound(rig, &noise_free, center_px, pixel_dn)?;
                let last =
                    (first..first + BLOCK_FRAMES).take_while(|index| *index < film.frames() && is_visible(index));
                let last = last.last().unwrap_or(first);
                let matched = reference_renewal::observe_matches(rig, film, first..=last)?;
                smoothing = fit_smoothing(&matched.poses, &bound);
                (bound, matched.renewal, [1.0; 3], [1.0; 3])
            }
            MotionMethod::Subsets | MotionMethod::Outlines => {
                let (reported, noise) = (reported_sigmas(&found), subset_noise::observe_steps(rig, film, first)?);
                let ratio = |k: usize| if noise.pose[k] > 0.0 { reported[k] / noise.pose[k] } else { 1.0 };
                (noise.pose, [0.0; 3], noise.walk, [0, 1, 2].map(ratio))
            }
        };
        let center_offset_px =
            step.center_px().map_or([0.0; 2], |place| [place[0] - center_px[0], place[1] - center_px[1]]);
        Ok(Self { pose, renewal, walk, reported_ratio, smoothing, pixel_dn, step, center_offset_px })
    }
}

/// Measures a few frames as the rig does and returns the steps over the shortest interval.
///
/// # Errors
///
/// When the settings cannot be used.
fn measure_shortest_steps(rig: &Rig, film: &SimulatedFilm, frames: Range<u64>) -> Result<Vec<BodyStep>, Failure> {
    let (params, _) = analysis_params(&rig.config, &rig.format());
    let mut rows = measure_steps(&params, film, frames)?;
    rows.retain(|step| step.interval_frames == rig.config.intervals_frames[0]);
    Ok(rows)
}

/// Returns the lower bound of the scatter (sigma) of a whole-body pose for this texture, px, px and deg.
///
/// `noise_free` is a frame without noise, DN. Half of a match's variance belongs to the other frame.
///
/// # Errors
///
/// When the body cannot be matched.
fn noise_bound(rig: &Rig, noise_free: &Image, center_px: [f64; 2], pixel_dn: f64) -> Result<[f64; 3], Failure> {
    let [x_px, y_px] = center_px;
    let correlator = Correlator::new(&rig.config.correlation(), noise_free.view().width(), noise_free.view().height())?;
    let body =
        RigidBody::new(&correlator.prepare(noise_free.view()), &ball_region(rig, center_px)).map_err(|status| {
            UsageError(format!("{}: cannot match the whole body: {}", rig.config.origin, status.as_str()))
        })?;
    Ok(body.expected_sigma(Point { x_px, y_px }, pixel_dn).map(|sigma| sigma * std::f64::consts::FRAC_1_SQRT_2))
}

/// Fits the reduction of the variance of a pose by interpolation half-way between pixels, by least squares: 0 to 0.4.
///
/// `poses` holds variances and motions since the reference, and `bound` the scatter without interpolation. The
/// variances relative to the squared bound are averaged over the three coordinates. 0 without motion off whole pixels.
fn fit_smoothing(poses: &[PoseVariance], bound: &[f64; 3]) -> f64 {
    let (mut squares, mut products) = (0.0, 0.0);
    for PoseVariance { variance, motion_px } in poses {
        let ratios = variance.iter().zip(bound).map(|(variance, bound)| variance / bound.powi(2));
        let reduction = 1.0 - ratios.sum::<f64>() / 3.0;
        let phase = subpixel_phase(*motion_px);
        (squares, products) = (squares + phase * phase, products + reduction * phase);
    }
    if squares > 0.0 { (products / squares).clamp(0.0, MAX_SMOOTHING) } else { 0.0 }
}

/// Returns the distance of a displacement from whole pixels as a phase without a unit: sin^2(pi u) + sin^2(pi v).
///
/// It is 0 where both components are whole and 2 where both are half-way.
fn subpixel_phase(displacement_px: [f64; 2]) -> f64 {
    displacement_px.iter().map(|part| (std::f64::consts::PI * part).sin().powi(2)).sum()
}

/// Returns the root mean square of the sigmas that subset fits report, per pose: px, px and deg.
///
/// A step has the noise of two poses.
fn reported_sigmas(steps: &[&BodyStep]) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for (step, frames) in steps.iter().filter_map(|step| Some((step.motion?, f64::from(step.interval_frames)))) {
        for (sum, sigma) in sums.iter_mut().zip([step.sigma_dx_px, step.sigma_dy_px, step.sigma_dtheta_deg]) {
            *sum += (frames * sigma).powi(2) / 2.0;
        }
    }
    sums.map(|sum| (sum / steps.len().max(1) as f64).sqrt())
}

/// Returns the noise of the body's pixels, DN, weighted by their squared gradients.
fn pixel_noise_dn(rig: &Rig, noise_free: &Image, center_px: [f64; 2]) -> f64 {
    let [x_px, y_px] = center_px;
    let (view, radius_px) = (noise_free.view(), rig.scenario.radius_px());
    let (mut weights, mut sum) = (0.0, 0.0);
    for y in 1..view.height() - 1 {
        for x in 1..view.width() - 1 {
            if (x as f64 - x_px).hypot(y as f64 - y_px) > radius_px {
                continue;
            }
            let at = |dx: usize, dy: usize| f64::from(view.row(y + dy - 1)[x + dx - 1]);
            let weight = (at(2, 1) - at(0, 1)).powi(2) + (at(1, 2) - at(1, 0)).powi(2);
            weights += weight;
            sum += weight * rig.scenario.camera.noise_variance_dn2(at(1, 1));
        }
    }
    if weights > 0.0 { (sum / weights).sqrt() } else { rig.scenario.camera.noise_variance_dn2(0.0).sqrt() }
}
