//! Frame pairs of a study: two files, or a rendered pattern with known displacements.

use crate::failure::Failure;
use std::path::Path;

use crate::command::field::{Size, grid_points, read_pair};
use crate::console::UsageError;
use crate::dic::grid;
use crate::dic::{CorrelationParams, GridPoint};
use crate::image::{Frame, Image};
use crate::synth::{MotionSetup, Scenario, SimulatedFilm};

/// Displacements of the rendered pattern, px, one per pair of frames.
///
/// All lie at least 0.01 px off the grids of the study's spline points. On such a grid the highest grid point would
/// look perfect.
pub(super) const DRAWN_PX: [[f64; 2]; 5] = [[0.02, -0.31], [0.22, 0.69], [0.56, -0.89], [0.78, -1.22], [1.44, 1.7]];

/// Side of the rendered frames, px.
const SIDE_PX: u32 = 192;

/// Diameter of the rendered ball, px.
const DIAMETER_PX: f64 = 150.0;

/// Centre of the rendered ball in the first frame, off the pixel grid.
const CENTER_PX: [f64; 2] = [95.63, 95.29];

/// Two images to measure instead of the rendered pattern.
#[derive(Debug, Clone, Copy)]
pub(super) struct Files<'a> {
    pub(super) reference: &'a Path,
    pub(super) target: &'a Path,
    /// A rectangle of the reference to evaluate: x, y, width, height.
    pub(super) roi_px: Option<[u32; 4]>,
}

/// Two frames of the same size.
#[derive(Debug)]
pub(super) struct Pair {
    pub(super) reference: Image,
    pub(super) target: Image,
    /// The rendered displacement, which is uniform.
    pub(super) truth_px: Option<[f64; 2]>,
}

/// The input of a study: the same subsets on every pair.
#[derive(Debug)]
pub(super) struct Subject {
    pub(super) pairs: Vec<Pair>,
    pub(super) points: Vec<GridPoint>,
}

impl Subject {
    /// Returns the size of the frames.
    pub(super) fn size(&self) -> Size {
        self.pairs.first().map_or(Size { width: 0, height: 0 }, |pair| Size::from_view(pair.reference.view()))
    }
}

/// Reads a pair of files and places subsets on it, in the region if one is given. The truth is unknown.
///
/// # Errors
///
/// When a file cannot be read, the sizes differ, or the region exceeds the image.
pub(super) fn read(files: &Files<'_>, params: &CorrelationParams) -> Result<Subject, Failure> {
    let (reference, target) = read_pair(files.reference, files.target)?;
    let points = grid_points(files.reference, Size::from_view(reference.view()), files.roi_px, params)?;
    Ok(Subject { pairs: vec![Pair { reference, target, truth_px: None }], points })
}

/// Renders a speckled ball without interpolation and with 2 grey levels of noise, one pair per displacement, px.
///
/// # Errors
///
/// When the subsets are too large for the ball.
pub(super) fn render(displacements_px: &[[f64; 2]], params: &CorrelationParams) -> Result<Subject, Failure> {
    let ([x, y], side) = (CENTER_PX, SIDE_PX as usize);
    let points = grid::disc(x, y, 0.5 * DIAMETER_PX, params.step_px, params.subset_size_px, side, side);
    if points.is_empty() {
        return Err(UsageError(format!(
            "--subset {}: too large for the rendered ball of {DIAMETER_PX} px, at most 105",
            params.subset_size_px
        ))
        .into());
    }
    let pairs = displacements_px.iter().map(|displacement_px| render_pair(*displacement_px));
    Ok(Subject { pairs: pairs.collect::<Result<_, Failure>>()?, points })
}

/// Renders the ball before and after a displacement, px.
///
/// # Errors
///
/// When the displacement is out of range.
fn render_pair(displacement_px: [f64; 2]) -> Result<Pair, Failure> {
    let [u, v] = displacement_px;
    let mut scenario = Scenario::translation(u, v, 0.0);
    (scenario.camera.width_px, scenario.camera.height_px, scenario.camera.frames) = (SIDE_PX, SIDE_PX, 2);
    scenario.body.diameter_mm = DIAMETER_PX * scenario.scale.mm_per_px;
    scenario.motion =
        MotionSetup::Constant { vx_px_frame: u, vy_px_frame: v, omega_deg_frame: 0.0, start_px: CENTER_PX };
    let film = SimulatedFilm::new(&scenario)?;
    let mut bytes = vec![0; film.frame_bytes()];
    let mut frame = |index: u64| -> Result<Image, Failure> {
        film.render(index, &mut bytes);
        let mut image = Image::default();
        Frame { meta: crate::camera::simulated::meta(&film, index), bytes: &bytes }.unpack(&mut image)?;
        Ok(image)
    };
    Ok(Pair { reference: frame(0)?, target: frame(1)?, truth_px: Some(displacement_px) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::convergence::SPLINE_POINTS;

    #[test]
    fn no_drawn_displacement_is_near_a_grid_of_spline_points() {
        for component in DRAWN_PX.iter().flatten() {
            for points in SPLINE_POINTS {
                let fine = component * f64::from(points + 1);
                let apart_px = (fine - fine.round()).abs() / f64::from(points + 1);
                assert!(apart_px > 0.0099, "{component} px is {apart_px} px off the grid of {points} points");
            }
        }
    }

    #[test]
    fn drawn_pairs_share_their_subsets_and_differ_by_noise_and_shift() {
        let params = CorrelationParams { step_px: 20, ..CorrelationParams::default() };
        let subject = render(&[[0.0, 0.0]], &params).unwrap();
        let (a, b) = (subject.pairs[0].reference.view(), subject.pairs[0].target.view());
        let differences = a.data().iter().zip(b.data()).map(|(a, b)| f64::from(a - b).powi(2));
        let rms = (differences.sum::<f64>() / a.data().len() as f64).sqrt();
        // Two rounded frames with 2 grey levels of noise each.
        assert!((rms - 2.86).abs() < 0.1, "{rms}");
        assert!(subject.points.len() >= 20, "{}", subject.points.len());
        assert!(render(&[[0.0, 0.0]], &CorrelationParams { subset_size_px: 107, ..params }).is_err());
    }
}
