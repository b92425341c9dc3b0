//! Measures simulated films with a rig file, without processes.

use ricochet::camera::StreamFormat;
use ricochet::config::Config;
use ricochet::image::Frame;
use ricochet::measure::{Measurer, Share};
use ricochet::motion::Rectifier;
use ricochet::results::FrameCoding;
use ricochet::synth::SimulatedFilm;
use ricochet::track::{Tracker, TrackerRows};

/// Measures the frames of a world.
pub fn rows_of(world: &SimulatedFilm, rig: &str) -> TrackerRows {
    let picture = |index| {
        let mut bytes = vec![0; world.frame_bytes()];
        world.render(index, &mut bytes);
        bytes
    };
    rows_of_pictures((0..world.frames()).map(picture), world, rig)
}

/// Measures other images with the format and times of a world's camera.
pub fn rows_of_pictures(pictures: impl Iterator<Item = Vec<u8>>, world: &SimulatedFilm, rig: &str) -> TrackerRows {
    rows_of_film(pictures, world, rig, FrameCoding::Independent)
}

/// Measures the frames of a film of this coding with the format and times of a world's camera.
pub fn rows_of_film(
    pictures: impl Iterator<Item = Vec<u8>>,
    world: &SimulatedFilm,
    rig: &str,
    coding: FrameCoding,
) -> TrackerRows {
    let config = Config::parse(rig, "film.toml").unwrap();
    let format = StreamFormat { coding, ..ricochet::camera::simulated::stream_format(world) };
    let (measure, track) = ricochet::process::analysis_params(&config, &format);
    let (width, height) = (world.width_px() as usize, world.height_px() as usize);
    let mut measurer = Measurer::new(&measure, Share::ALL, width, height).unwrap();
    let mut measured = Vec::new();
    for (index, bytes) in (0..).zip(pictures) {
        let meta = ricochet::camera::simulated::meta(world, index);
        if let Some(picture) = (index == 0)
            .then(|| ricochet::process::reference_picture::from_first_frame(&Frame { meta, bytes: &bytes }, &config))
            .flatten()
        {
            measurer.set_reference(&picture).unwrap();
        }
        measurer.push(&Frame { meta, bytes: &bytes }, &mut measured).unwrap();
    }
    measurer.finish(&mut measured);
    let (mut tracker, mut rows) = (Tracker::new(&track), TrackerRows::default());
    measured.iter().for_each(|row| tracker.push(&row.step, &mut rows));
    tracker.finish(&mut rows);
    rows
}

/// A rig file for simulated balls of 50 to 70 px radius, without a surface.
pub fn level_rig(mm_per_px: f64) -> String {
    let rig = format!("[rig]\nname = \"level\"\n[camera]\nsource = \"simulated\"\n[scale]\nmm_per_px = {mm_per_px}\n");
    rig + "[[body]]\nname = \"ball\"\nkind = \"ball\"\nmin_radius_px = 50\nmax_radius_px = 70\n"
}

/// The weights of four samples around a position between the middle two (Keys' cubic).
fn weights(t: f64) -> [f64; 4] {
    let near = |d: f64| (1.5 * d - 2.5) * d * d + 1.0;
    let far = |d: f64| ((-0.5 * d + 2.5) * d - 4.0) * d + 2.0;
    [far(1.0 + t), near(t), near(1.0 - t), far(2.0 - t)]
}

/// The image that shows at every pixel what another shows at its rectified position.
pub fn through(rectifier: &Rectifier, picture: &[u8], [width, height]: [usize; 2]) -> Vec<u8> {
    let level = |x: i64, y: i64| f64::from(picture[y as usize * width + x as usize]);
    let at = |k: usize| {
        let [x, y] = rectifier.rectify_point([(k % width) as f64, (k / width) as f64])?;
        let (cell_x, cell_y) = (x.floor(), y.floor());
        let inside = |cell: f64, side: usize| cell >= 1.0 && cell + 2.0 < side as f64;
        if !(inside(cell_x, width) && inside(cell_y, height)) {
            return None;
        }
        let (along, down) = (weights(x - cell_x), weights(y - cell_y));
        let row = |j: usize| {
            (0..4).map(|i| along[i] * level(cell_x as i64 - 1 + i as i64, cell_y as i64 - 1 + j as i64)).sum::<f64>()
        };
        Some((0..4).map(|j| down[j] * row(j)).sum::<f64>().round().clamp(0.0, 255.0) as u8)
    };
    (0..width * height).map(|k| at(k).unwrap_or(40)).collect()
}
