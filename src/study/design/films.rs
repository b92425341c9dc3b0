//! Films of a rig, rendered and measured.

use super::rig::Rig;
use crate::camera::simulated;
use crate::dic::Region;
use crate::failure::Failure;
use crate::image::Frame;
use crate::measure::{MeasureParams, Measured, Measurer, Share, matched_region};
use crate::results::{BodyStep, Circle};
use crate::synth::SimulatedFilm;
use std::ops::Range;

/// Renders a few frames of a film, measures them and returns every step between them.
///
/// # Errors
///
/// When the settings cannot be used.
pub(super) fn measure_steps(
    params: &MeasureParams,
    film: &SimulatedFilm,
    frames: Range<u64>,
) -> Result<Vec<BodyStep>, Failure> {
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

/// Returns the region of a ball centred at a position that whole-body matching uses.
pub(super) fn ball_region(rig: &Rig, center_px: [f64; 2]) -> Region {
    let [x_px, y_px] = center_px;
    let radius_px = rig.scenario.radius_px();
    let (sigma_center_px, sigma_radius_px, visible_fraction) = (0.0, 0.0, 1.0);
    matched_region(&Circle { x_px, y_px, radius_px, sigma_center_px, sigma_radius_px, visible_fraction })
}
