//! The velocity of a rod with the paper's settings, drawn next to the measured one.

use crate::console::progress;
use crate::dic::grid;
use crate::dic::{CorrelationParams, Correlator, Method, PreparedFrame, Start};
use crate::failure::Failure;
use crate::image::{Frame, Image};
use crate::recording::Recording;
use crate::report::Comparison;
use crate::results::PointStatus;
use crate::rod::{RodFinder, RodObservation, RodParams};

/// Spline points between two pixels, as in the paper.
const SPLINE_POINTS: u32 = 5;

/// Frame intervals and their labels: the extremes of those the paper tried on its rod.
const INTERVALS: [(usize, &str); 2] = [(5, "5th next"), (15, "15th next")];

/// The subset size, px: three subsets fit on the tape of the simulated rod.
const WINDOW_PX: u32 = 25;
/// The grid step, px.
const STEP_PX: u32 = 12;

/// Search range, px: the simulated rod moves by 1.4 px in 15 frames.
const SEARCH_PX: u32 = 4;

/// The setup of a rod experiment.
#[derive(Debug)]
pub(super) struct Setup<'a> {
    /// The search parameters of the rod.
    pub(super) rod: &'a RodParams,
    /// The scale, mm per pixel.
    pub(super) mm_per_px: f64,
    /// The surface's tangent, counter-clockwise from x, deg.
    pub(super) surface_angle_deg: f64,
}

/// A frame, its time stamp, and the tape that subsets may lie on.
struct Still {
    stamp_ns: u64,
    image: Image,
    /// Left, top, width and height, px.
    tape_px: Option<[u32; 4]>,
}

/// Computes the normal velocity in a recording as in section 4.1 of the paper, once per interval.
///
/// Subsets on the speckled tape are interpolated with 5 spline points between pixels. The highest grid point of their
/// correlation is taken without a fit, and the mean over the subsets without smoothing over time. A velocity belongs
/// to the midpoint between its two frames.
///
/// # Errors
///
/// When the recording cannot be read, or no rod is found in any frame.
pub(super) fn measure_velocities(recording: &Recording, setup: &Setup<'_>) -> Result<Vec<Comparison>, Failure> {
    let mut film = Vec::new();
    let mut finder = None;
    for frame in recording.frames()? {
        let (meta, bytes) = frame?;
        let mut image = Image::default();
        Frame { meta, bytes: &bytes }.unpack(&mut image)?;
        let (width, height) = (image.view().width(), image.view().height());
        let finder = match &finder {
            Some(finder) => finder,
            None => finder.insert(RodFinder::new(setup.rod, width, height)?),
        };
        let tape_px = finder.find(image.view()).ok().map(|observation| tape_bounds_px(&observation));
        film.push(Still { stamp_ns: meta.stamp_ns, image, tape_px });
    }
    if film.iter().all(|still| still.tape_px.is_none()) {
        return Err(Failure::internal(format!("{}: cannot find the rod in any frame", recording.path().display())));
    }
    let bar = progress::bar((INTERVALS.len() * film.len()) as u64, "compare");
    let curves = INTERVALS.map(|(interval, label)| {
        let points = measure_normal_velocities(&film, SPLINE_POINTS, interval, setup, || bar.inc(1))?;
        Ok(Comparison { label, points })
    });
    bar.finish_and_clear();
    curves.into_iter().collect()
}

/// Returns the bounding box of the speckled tape in whole pixels: left, top, width and height.
fn tape_bounds_px(observation: &RodObservation) -> [u32; 4] {
    let tape = observation.tape_bounds().upright(&observation.rod);
    let whole = |place: f64| place.round().max(0.0) as u32;
    let (left, top) = (whole(tape.left_px), whole(tape.top_px));
    [left, top, whole(tape.right_px + 1.0).saturating_sub(left), whole(tape.bottom_px + 1.0).saturating_sub(top)]
}

/// Computes the velocity along the surface's outward normal, m/s, of each pair of frames `interval` frames apart, as
/// the paper does.
///
/// Each value comes with the time midway between its two frames, ns. Pairs without a tape or a valid subset are left
/// out. `on_pair` is called before each pair.
fn measure_normal_velocities(
    film: &[Still],
    spline_points: u32,
    interval: usize,
    setup: &Setup<'_>,
    on_pair: impl Fn(),
) -> Result<Vec<(u64, f64)>, Failure> {
    let Some(first) = film.first() else { return Ok(Vec::new()) };
    let params = CorrelationParams {
        method: Method::SplineFft,
        spline_points,
        subset_size_px: WINDOW_PX,
        step_px: STEP_PX,
        search_px: SEARCH_PX,
        ..CorrelationParams::default()
    };
    let (width, height) = (first.image.view().width(), first.image.view().height());
    let mut correlator = Correlator::new(&params, width, height)?.without_peak_fit();
    let (mut reference, mut target) = (PreparedFrame::default(), PreparedFrame::default());
    let (sin, cos) = setup.surface_angle_deg.to_radians().sin_cos();
    let (mut field, mut curve) = (Vec::new(), Vec::new());
    for (before, after) in film.iter().zip(film.iter().skip(interval)) {
        on_pair();
        let Some(tape_px) = before.tape_px else { continue };
        let points = grid::rectangle(tape_px, STEP_PX, WINDOW_PX);
        correlator.prepare_into(before.image.view(), &mut reference);
        correlator.prepare_into(after.image.view(), &mut target);
        correlator.correlate(&reference, &target, &points, Start::Search, &mut field);
        let moves = field.iter().filter(|point| point.status == PointStatus::Valid).filter_map(|p| p.displacement);
        // The image's y points down.
        let normal: Vec<f64> = moves.map(|d| -f64::from(d.v_px) * cos - f64::from(d.u_px) * sin).collect();
        let span_ns = after.stamp_ns.saturating_sub(before.stamp_ns);
        if !normal.is_empty() && span_ns > 0 {
            let mean_px = normal.iter().sum::<f64>() / normal.len() as f64;
            curve.push((before.stamp_ns + span_ns / 2, 1e6 * setup.mm_per_px * mean_px / span_ns as f64));
        }
    }
    Ok(curve)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::simulated;
    use crate::synth::{Scenario, SimulatedFilm};

    /// The paper's rod as simulated.
    fn film() -> (SimulatedFilm, Vec<Still>, RodParams) {
        let world = SimulatedFilm::new(&Scenario::built_in("rod").unwrap()).unwrap();
        let rod = RodParams::new(4);
        let mut bytes = vec![0; world.frame_bytes()];
        let stills = (0..world.frames()).map(|index| {
            world.render(index, &mut bytes);
            let (meta, mut image) = (simulated::meta(&world, index), Image::default());
            Frame { meta, bytes: &bytes }.unpack(&mut image).unwrap();
            let finder = RodFinder::new(&rod, image.view().width(), image.view().height()).unwrap();
            let tape_px = finder.find(image.view()).ok().map(|observation| tape_bounds_px(&observation));
            Still { stamp_ns: meta.stamp_ns, image, tape_px }
        });
        let stills = stills.collect();
        (world, stills, rod)
    }

    /// The paper saw the velocity stay at zero for a while and blamed its camera; the true velocity does not.
    #[test]
    fn the_papers_settings_keep_the_velocity_at_zero_for_a_while() {
        let (world, film, rod) = film();
        let setup = Setup { rod: &rod, mm_per_px: 0.3, surface_angle_deg: 0.0 };
        let first_ns = film[0].stamp_ns;
        let true_at = |stamp_ns: u64| {
            // Linear interpolation between two frames.
            let place = (stamp_ns - first_ns) as f64 / 25_000.0;
            let velocity = |index: f64| world.truth(index as u64).velocity.unwrap().vn_m_s;
            velocity(place.floor()) + place.fract() * (velocity(place.ceil()) - velocity(place.floor()))
        };
        // Spline points, frame interval, minimum number of zero velocities, and minimum of the maximum true speed at
        // those times: half a step of the grid.
        for (points, interval, least, fast_m_s) in [(5, 1, 100, 0.9), (5, 5, 8, 0.18), (10, 5, 5, 0.1), (5, 15, 1, 0.0)]
        {
            let curve = measure_normal_velocities(&film, points, interval, &setup, || {}).unwrap();
            assert!(curve.len() + interval == film.len(), "{} of {}", curve.len(), film.len());
            let still: Vec<f64> = curve.iter().filter(|(_, v)| v.abs() < 1e-9).map(|(at, _)| true_at(*at)).collect();
            let fastest = still.iter().fold(0.0_f64, |fastest, v| fastest.max(v.abs()));
            let still = still.len();
            eprintln!(
                "{points} points, {interval} frames: {still} velocities are 0, the rod moves at up to {fastest:.3} m/s"
            );
            assert!(still >= least && fastest > fast_m_s, "{still} are 0, up to {fastest} m/s");
        }
    }
}
