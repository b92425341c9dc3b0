//! How much a pose scatters, from the pictures that the rig is going to take.

use super::rig::Rig;
use super::{renewal, subsets};
use crate::camera::simulated;
use crate::command::UsageError;
use crate::dic::{Correlator, Region, RigidBody};
use crate::image::{Frame, Image};
use crate::measure::{MeasureParams, Measured, Measurer, Share, whole_region};
use crate::process::analysis_params;
use crate::results::{BodyStep, Circle, PointStatus};
use crate::synth::World;
use std::ops::Range;

/// Pictures that are drawn and measured to see how the body is followed.
const PICTURES: u64 = 3;

/// Frames that a reference is renewed within.
const RENEWED_FRAMES: u64 = 16;

/// Share of a body in sight from which on it counts as unhidden.
const WHOLE: f64 = 0.97;

/// What the pictures leave uncertain.
#[derive(Debug, Clone)]
pub(super) struct Noise {
    /// Of a pose of the whole body: x px, y px, angle deg.
    pub(super) pose: [f64; 3],
    /// What the renewal of a reference leaves for good, in the same units, when the whole body is matched.
    pub(super) renewal: [f64; 3],
    /// How much more than assumed a step over subsets leaves for good, where it is not: x, y and angle.
    pub(super) walk: [f64; 3],
    /// The sigma that a match states of a pose, over what it scatters by.
    pub(super) stated: [f64; 3],
    /// How much interpolation takes of the variance of a pose half-way between whole pixels, along each axis.
    pub(super) smoothing: f64,
    /// Noise of a pixel of the body, where its grey levels change, DN.
    pub(super) pixel_dn: f64,
    /// How the body was seen in the frame `seen`.
    pub(super) step: BodyStep,
    /// How far from the truth, px.
    pub(super) off_px: [f64; 2],
}

/// No more of it is taken.
const MOST_SMOOTHED: f64 = 0.4;

impl Noise {
    /// Scatter of a pose of a body that has moved so far from where its reference was taken, px.
    pub(super) fn pose_at(&self, moved_px: [f64; 2]) -> [f64; 3] {
        let left = (1.0 - self.smoothing * between_pixels(moved_px)).sqrt();
        self.pose.map(|sigma| left * sigma)
    }

    /// Of a rig, by the noise bound of its pattern where all pixels are matched at once, and by what steps over subsets
    /// are seen to scatter where they are not.
    ///
    /// # Errors
    ///
    /// One line when the body cannot be followed in the pictures.
    pub(super) fn of(rig: &Rig, world: &World) -> anyhow::Result<Self> {
        let origin = &rig.config.origin;
        let longest = u64::from(rig.config.intervals_frames[0]);
        let is_seen = |index: &u64| {
            let truth = world.truth(*index);
            truth.status == PointStatus::Valid && truth.visible_fraction.is_none_or(|share| share >= WHOLE)
        };
        let pictures = PICTURES + longest;
        let first = (0..world.frames())
            .find(|index| index + pictures <= world.frames() && is_seen(index) && is_seen(&(index + pictures - 1)));
        let Some(first) = first else {
            return Err(
                UsageError(format!("{origin}: the body is never whole in the picture for {pictures} frames")).into()
            );
        };
        let steps = measured(rig, world, first..first + pictures)?;
        let told: Vec<&BodyStep> = steps.iter().filter(|step| step.step.is_some()).collect();
        let Some(step) = told.first().map(|step| **step) else {
            let status = steps.first().map_or(PointStatus::Lost, |step| step.status);
            let why = format!("{origin}: the body cannot be followed in the pictures foreseen: {}", status.word());
            return Err(UsageError(why).into());
        };
        let truth = world.truth(step.frame);
        let center_px = [truth.center_x_px.unwrap_or_default(), truth.center_y_px.unwrap_or_default()];
        let light = world.render_light(first);
        let pixel_dn = pixel_noise_dn(rig, &light, center_px);
        let mut smoothing = 0.0;
        let (pose, renewal, walk, stated) = match step.is_whole {
            true => {
                let bound = bound(rig, &light, center_px, pixel_dn)?;
                let last =
                    (first..first + RENEWED_FRAMES).take_while(|index| *index < world.frames() && is_seen(index));
                let last = last.last().unwrap_or(first);
                let matched = renewal::matched(rig, world, (first, last))?;
                smoothing = smoothed(&matched.poses, &bound);
                (bound, matched.renewal, [1.0; 3], [1.0; 3])
            }
            false => {
                let (stated, seen) = (stated(&told), subsets::stepped(rig, world, first)?);
                let over = |k: usize| if seen.pose[k] > 0.0 { stated[k] / seen.pose[k] } else { 1.0 };
                (seen.pose, [0.0; 3], seen.walk, [0, 1, 2].map(over))
            }
        };
        let place = step.circle.map(|c| [c.x_px, c.y_px]).or(step.rod.map(|rod| [rod.x_px.value, rod.y_px.value]));
        let off_px = place.map_or([0.0; 2], |place| [place[0] - center_px[0], place[1] - center_px[1]]);
        Ok(Self { pose, renewal, walk, stated, smoothing, pixel_dn, step, off_px })
    }
}

/// Steps of a few frames over the shortest interval, as the rig measures them.
fn measured(rig: &Rig, world: &World, frames: Range<u64>) -> anyhow::Result<Vec<BodyStep>> {
    let (params, _) = analysis_params(&rig.config, &rig.format());
    let mut rows = steps(&params, world, frames)?;
    rows.retain(|step| step.interval_frames == rig.config.intervals_frames[0]);
    Ok(rows)
}

/// Every step of a few frames of a film.
///
/// # Errors
///
/// When the settings cannot be measured with.
pub(super) fn steps(params: &MeasureParams, film: &World, frames: Range<u64>) -> anyhow::Result<Vec<BodyStep>> {
    let (width, height) = (film.width_px() as usize, film.height_px() as usize);
    let mut measurer = Measurer::new(params, Share::ALL, width, height)?;
    let (mut rows, mut bytes): (Vec<Measured>, _) = (Vec::new(), vec![0; film.frame_bytes()]);
    for index in frames {
        film.render(index, &mut bytes);
        measurer.push(&Frame { meta: simulated::meta(film, index), bytes: &bytes }, &mut rows)?;
    }
    measurer.finish(&mut rows);
    Ok(rows.into_iter().map(|row| row.step).collect())
}

/// The least scatter that the texture of the ball allows; half of a match's variance is the other frame's.
fn bound(rig: &Rig, light: &Image, [x_px, y_px]: [f64; 2], pixel_dn: f64) -> anyhow::Result<[f64; 3]> {
    let correlator = Correlator::new(&rig.config.correlation(), light.view().width(), light.view().height())?;
    let body = RigidBody::new(&correlator.prepare(light.view()), &pixels_of(rig, [x_px, y_px])).map_err(|status| {
        UsageError(format!("{}: the body cannot be matched as a whole: {}", rig.config.origin, status.word()))
    })?;
    Ok(body.expected_sigma((x_px, y_px), pixel_dn).map(|sigma| sigma * std::f64::consts::FRAC_1_SQRT_2))
}

/// How much interpolation takes of the variance of a pose half-way between whole pixels, along each axis; by least
/// squares.
fn smoothed(poses: &[([f64; 3], [f64; 2])], bound: &[f64; 3]) -> f64 {
    let (mut squares, mut products) = (0.0, 0.0);
    for (variances, moved) in poses {
        let missing = 1.0 - variances.iter().zip(bound).map(|(seen, bound)| seen / bound.powi(2)).sum::<f64>() / 3.0;
        let between = between_pixels(*moved);
        (squares, products) = (squares + between * between, products + missing * between);
    }
    if squares > 0.0 { (products / squares).clamp(0.0, MOST_SMOOTHED) } else { 0.0 }
}

/// How far between whole pixels a displacement leads: 0 where both of its parts are whole, 2 where both are half-way.
fn between_pixels(moved: [f64; 2]) -> f64 {
    moved.iter().map(|part| (std::f64::consts::PI * part).sin().powi(2)).sum()
}

/// The pixels that the rig matches a ball by.
pub(super) fn pixels_of(rig: &Rig, [x_px, y_px]: [f64; 2]) -> Region {
    let radius_px = rig.scenario.radius_px();
    let (sigma_center_px, sigma_radius_px, visible_fraction) = (0.0, 0.0, 1.0);
    whole_region(&Circle { x_px, y_px, radius_px, sigma_center_px, sigma_radius_px, visible_fraction })
}

/// What fits to subsets state, root mean square; a step has the noise of two poses.
fn stated(steps: &[&BodyStep]) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for (step, frames) in steps.iter().filter_map(|step| Some((step.step?, f64::from(step.interval_frames)))) {
        for (sum, sigma) in sums.iter_mut().zip([step.sigma_dx_px, step.sigma_dy_px, step.sigma_dtheta_deg]) {
            *sum += (frames * sigma).powi(2) / 2.0;
        }
    }
    sums.map(|sum| (sum / steps.len().max(1) as f64).sqrt())
}

/// Noise of the body's pixels, each counted by how much it tells of the motion.
fn pixel_noise_dn(rig: &Rig, light: &Image, [x_px, y_px]: [f64; 2]) -> f64 {
    let (view, radius_px) = (light.view(), rig.scenario.radius_px());
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
