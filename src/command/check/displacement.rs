//! What the rig's own measurement makes of still frames.

use super::grab::{Grabbed, now};
use crate::config::Config;
use crate::image::Frame;
use crate::measure::{Measured, Measurer, Share};
use crate::process::{analysis_params, reference};
use crate::results::{PairField, PointStatus};

/// A body stands still when its mean motion stays under so many standard errors, or under `STILL_PX`.
const STILL_SIGMAS: f64 = 5.0;
/// Motion that is still called none, px and deg a frame.
const STILL_PX: f64 = 0.01;
const STILL_DEG: f64 = 0.01;

/// Fewest displacements a scatter is taken from.
const FEWEST_POINTS: usize = 30;

/// Displacements of what should not move.
pub(super) struct Floor {
    /// Every measurement.
    pub(super) measured: Vec<Measured>,
    /// Scatter of the subsets' displacements, per axis, px; `None` when the body moves or next to nothing was measured.
    pub(super) subset_px: Option<f64>,
    /// Scatter of the body's own motion, per axis, px and deg.
    pub(super) body_px: Option<f64>,
    pub(super) body_deg: Option<f64>,
    /// Mean motion a frame of a body that moves, px and deg.
    pub(super) moves: Option<(f64, f64)>,
    /// Share of the frames in which a body was found.
    pub(super) found: f64,
    /// Share of the subsets that were measured.
    pub(super) valid: f64,
    /// Frames a second that one worker measures.
    pub(super) rate_hz: f64,
}

impl Floor {
    /// The fields of the first pair, one a body.
    pub(super) fn first_fields(&self) -> Vec<&PairField> {
        let first = self.measured.iter().filter_map(|measured| measured.field.as_ref()).map(|field| field.frame).min();
        let fields = self.measured.iter().filter_map(|measured| measured.field.as_ref());
        fields.filter(|field| Some(field.frame) == first).collect()
    }
}

/// Measures the kept frames as the rig would.
pub(super) fn floor(config: &Config, grabbed: &Grabbed) -> anyhow::Result<Floor> {
    let format = grabbed.format;
    let (params, _) = analysis_params(config, &format);
    let shortest = params.intervals_frames[0];
    let mut measurer = Measurer::new(&params, Share::ALL, format.width_px as usize, format.height_px as usize)?;
    let first = grabbed.frames.first();
    let picture = first.and_then(|(meta, bytes)| reference::of_first_frame(&Frame { meta: *meta, bytes }, config));
    picture.iter().try_for_each(|picture| measurer.set_reference(picture))?;
    let mut measured = Vec::new();
    let began = now();
    for (meta, bytes) in &grabbed.frames {
        measurer.push(&Frame { meta: *meta, bytes }, &mut measured)?;
    }
    measurer.finish(&mut measured);
    let rate_hz = grabbed.frames.len() as f64 / began.elapsed().as_secs_f64().max(1e-9);
    measured.retain(|measured| measured.step.interval_frames == shortest);
    let seen = measured.iter().filter(|measured| measured.step.circle.is_some() || measured.step.rod.is_some()).count();
    let points = || measured.iter().filter_map(|measured| measured.field.as_ref()).flat_map(|field| &field.points);
    let valid = points().filter(|point| point.status == PointStatus::Valid).count();
    let steps: Vec<[f64; 3]> = measured
        .iter()
        .filter_map(|measured| measured.step.step.map(|step| [step.dx_px, step.dy_px, step.dtheta_deg]))
        .collect();
    let moves = motion(&steps);
    let still = moves.is_none();
    let spreads = spreads(&steps);
    let body = |axes: &[usize]| {
        let squares = axes.iter().map(|axis| spreads.map(|spreads| spreads[*axis].powi(2))).sum::<Option<f64>>();
        squares.filter(|_| still).map(|squares| (squares / axes.len() as f64).sqrt())
    };
    Ok(Floor {
        subset_px: subsets(&measured).filter(|_| still),
        body_px: body(&[0, 1]),
        body_deg: body(&[2]),
        moves,
        found: seen as f64 / measured.len().max(1) as f64,
        valid: valid as f64 / points().count().max(1) as f64,
        rate_hz,
        measured,
    })
}

fn means(steps: &[[f64; 3]]) -> [f64; 3] {
    std::array::from_fn(|axis| steps.iter().map(|step| step[axis]).sum::<f64>() / steps.len() as f64)
}

fn spreads(steps: &[[f64; 3]]) -> Option<[f64; 3]> {
    let (means, least) = (means(steps), 2.0);
    let squares = |axis: usize| steps.iter().map(|step| (step[axis] - means[axis]).powi(2)).sum::<f64>();
    (steps.len() as f64 >= least)
        .then(|| std::array::from_fn(|axis| (squares(axis) / (steps.len() as f64 - 1.0)).sqrt()))
}

/// Mean motion a frame, px and deg, when it is one.
fn motion(steps: &[[f64; 3]]) -> Option<(f64, f64)> {
    let (means, spreads) = (means(steps), spreads(steps)?);
    let clear = |axis: usize, still: f64| {
        means[axis].abs() > still && means[axis].abs() > STILL_SIGMAS * spreads[axis] / (steps.len() as f64).sqrt()
    };
    (clear(0, STILL_PX) || clear(1, STILL_PX) || clear(2, STILL_DEG))
        .then(|| (means[0].hypot(means[1]), means[2].abs()))
}

/// Scatter of the subsets' displacements over all frames, root mean square over both axes.
fn subsets(measured: &[Measured]) -> Option<f64> {
    let fields = measured.iter().filter_map(|measured| measured.field.as_ref());
    let valid = fields.flat_map(|field| &field.points).filter(|point| point.status == PointStatus::Valid);
    let moved: Vec<[f64; 2]> = valid
        .filter_map(|point| point.displacement.map(|moved| [f64::from(moved.u_px), f64::from(moved.v_px)]))
        .collect();
    if moved.len() < FEWEST_POINTS {
        return None;
    }
    let count = moved.len() as f64;
    let variance = |axis: usize| {
        let mean = moved.iter().map(|moved| moved[axis]).sum::<f64>() / count;
        moved.iter().map(|moved| (moved[axis] - mean).powi(2)).sum::<f64>() / (count - 1.0)
    };
    Some((0.5 * (variance(0) + variance(1))).sqrt())
}
