//! Films of an independent ray tracer with truth: measured right, or refused.
//!
//! `RICOCHET_REAL_DATA` names the folder that holds them in `photo`.

use crate::support::ricochet;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The rows of a table by column.
type Row = BTreeMap<String, String>;

/// A film and the shares of its rows that must be measured, 0 to 1.
struct Film {
    name: &'static str,
    fps: u32,
    positions: f64,
    rotations: Rotations,
    /// The reported point relative to the centre of the truth, px.
    ///
    /// A rod is reported at the middle of its speckled tape, the truth is the middle of the whole rod.
    point_px: [f64; 2],
}

/// The rotations that a film shows.
enum Rotations {
    /// Nothing on the body turns visibly: a number is wrong.
    Unseen,
    /// At least this share must be measured.
    Share(f64),
}

const fn film(name: &'static str, fps: u32, positions: f64, rotations: Rotations) -> Film {
    Film { name, fps, positions, rotations, point_px: [0.0; 2] }
}

/// The rod, which leans by 0.6 deg; the place of its tape is that of its edges in the first frame.
const ROD: Film = Film { point_px: [-0.54, -51.99], ..film("rod_glare", 10_000, 0.9, Rotations::Share(0.0)) };

/// The shares that are reached. The films that are left out are not measured yet.
const MEASURED: [Film; 16] = [
    film("bead", 4000, 0.9, Rotations::Unseen),
    film("plain_spin", 1000, 0.95, Rotations::Unseen),
    film("basketball", 1000, 0.9, Rotations::Share(0.8)),
    film("box_corner", 2000, 0.9, Rotations::Share(0.8)),
    film("box_corner_noisy", 2000, 0.9, Rotations::Share(0.8)),
    film("futsal", 1000, 0.9, Rotations::Share(0.8)),
    film("futsal_noisy", 1000, 0.8, Rotations::Share(0.8)),
    film("lacrosse_gloss", 5000, 0.9, Rotations::Share(0.8)),
    film("lacrosse_matte", 5000, 0.9, Rotations::Share(0.8)),
    film("lacrosse_matte_noisy", 10_000, 0.9, Rotations::Share(0.8)),
    film("near_camera", 2000, 0.9, Rotations::Share(0.8)),
    film("paddle", 2000, 0.9, Rotations::Share(0.8)),
    film("pen_marks", 1000, 0.9, Rotations::Share(0.8)),
    film("pen_flat", 1000, 0.9, Rotations::Share(0.8)),
    ROD,
    film("steel_backlit", 2000, 0.95, Rotations::Unseen),
];

/// All films, with the shares that are the aim.
const ALL: [Film; 16] = [
    film("basketball", 1000, 0.9, Rotations::Share(0.8)),
    film("bead", 4000, 0.9, Rotations::Unseen),
    film("box_corner", 2000, 0.9, Rotations::Share(0.8)),
    film("box_corner_noisy", 2000, 0.9, Rotations::Share(0.8)),
    film("futsal", 1000, 0.9, Rotations::Share(0.8)),
    film("futsal_noisy", 1000, 0.8, Rotations::Share(0.8)),
    film("lacrosse_gloss", 5000, 0.9, Rotations::Share(0.8)),
    film("lacrosse_matte", 5000, 0.9, Rotations::Share(0.8)),
    film("lacrosse_matte_noisy", 10_000, 0.7, Rotations::Share(0.8)),
    film("near_camera", 2000, 0.9, Rotations::Share(0.8)),
    film("paddle", 2000, 0.9, Rotations::Share(0.8)),
    film("pen_flat", 1000, 0.9, Rotations::Share(0.8)),
    film("pen_marks", 1000, 0.9, Rotations::Share(0.8)),
    film("plain_spin", 1000, 0.95, Rotations::Unseen),
    ROD,
    film("steel_backlit", 2000, 0.95, Rotations::Unseen),
];

/// An error counts as silent beyond this many of its own standard uncertainties, and beyond the limit of its number.
const MAX_SIGMAS: f64 = 5.0;
const MAX_STEP_PX: f64 = 0.02;
const MAX_CENTER_PX: f64 = 0.2;
const MAX_STEP_DEG: f64 = 0.02;
const MAX_SPIN_FRACTION: f64 = 0.01;

/// A number of a collision is wrong beyond this many of its standard uncertainties and this part of the truth; a time,
/// beyond this many frames.
const MAX_IMPACT_SIGMAS: f64 = 4.0;
const MAX_IMPACT_FRACTION: f64 = 0.01;
const MAX_IMPACT_FRAMES: f64 = 2.0;

/// The numbers of a collision, and its times.
const IMPACT_NUMBERS: [&str; 8] = [
    "vn_before_m_s",
    "vn_after_m_s",
    "vt_before_m_s",
    "vt_after_m_s",
    "omega_before_rad_s",
    "omega_after_rad_s",
    "restitution",
    "compression_max_mm",
];
const IMPACT_TIMES: [&str; 4] = ["start_s", "deepest_s", "end_s", "contact_time_s"];

fn folder() -> Option<PathBuf> {
    let folder = std::env::var_os("RICOCHET_REAL_DATA").map(|data| PathBuf::from(data).join("photo"));
    if folder.is_none() {
        println!("left out: RICOCHET_REAL_DATA names no directory of real recordings");
    }
    folder
}

fn table(text: &str) -> Vec<Row> {
    let mut lines = text.lines().map(|line| line.split(',').map(str::to_string).collect::<Vec<_>>());
    let names = lines.next().unwrap();
    lines.map(|cells| names.iter().cloned().zip(cells).collect()).collect()
}

fn number(row: &Row, name: &str) -> Option<f64> {
    row[name].parse().ok()
}

/// The rows of a film's results and of its truth.
struct Rows {
    velocities: Vec<Row>,
    tracks: Vec<Row>,
    impacts: Vec<Row>,
    truth: Vec<Row>,
    true_impacts: Vec<Row>,
}

fn measured(folder: &Path, film: &Film) -> Rows {
    let (scratch, at) = (tempfile::tempdir().unwrap(), folder.join(film.name));
    let results = scratch.path().join("results.mcap");
    let (fps, input, rig) = (film.fps.to_string(), at.join("film.tif"), at.join("rig.toml"));
    let analyzed = ricochet(["analyze", input.to_str().unwrap(), "--config", rig.to_str().unwrap(), "--fps", &fps])
        .args(["-o", results.to_str().unwrap()])
        .output()
        .unwrap();
    println!("{}: {}", film.name, String::from_utf8_lossy(&analyzed.stderr));
    let topic = |topic: &str| {
        let exported = ricochet(["export", results.to_str().unwrap(), "--topic", topic]).output().unwrap();
        table(&String::from_utf8(exported.stdout).unwrap())
    };
    let truth = |name: &str| table(&std::fs::read_to_string(at.join(name)).unwrap());
    Rows {
        velocities: topic("velocity"),
        tracks: topic("track"),
        impacts: topic("impact"),
        truth: truth("truth.csv"),
        true_impacts: truth("truth_impact.csv"),
    }
}

/// Returns the wrong numbers of the valid collisions of a film.
fn impact_faults(film: &Film, rows: &Rows) -> Vec<String> {
    let mut faults = Vec::new();
    for found in rows.impacts.iter().filter(|row| row["status"] == "valid") {
        let [truth] = rows.true_impacts.as_slice() else {
            faults.push(format!("{}: a collision that never was: {found:?}", film.name));
            continue;
        };
        let numbers = IMPACT_NUMBERS.map(|name| (name, MAX_IMPACT_FRACTION * number(truth, name).unwrap_or(0.0).abs()));
        let times = IMPACT_TIMES.map(|name| (name, MAX_IMPACT_FRAMES / f64::from(film.fps)));
        for (name, limit) in numbers.into_iter().chain(times) {
            let Some((value, exact)) = number(found, name).zip(number(truth, name)) else { continue };
            let sigma = number(found, &format!("sigma_{name}")).unwrap();
            let off = (value - exact).abs();
            if off > MAX_IMPACT_SIGMAS * sigma && off > limit {
                faults.push(format!("{}: {name} is {value}, truth {exact}, sigma {sigma}", film.name));
            }
        }
    }
    let valid = rows.impacts.iter().filter(|row| row["status"] == "valid").count();
    println!("{}: {valid} of {} collisions measured", film.name, rows.true_impacts.len());
    faults
}

/// Returns the contradictions between a film's results and the aim.
fn faults(folder: &Path, film: &Film) -> Vec<String> {
    let rows = measured(folder, film);
    let mut faults = impact_faults(film, &rows);
    let Rows { velocities, tracks, truth, .. } = rows;
    let (mut positions, mut rotations) = (0, 0);
    for (frame, (row, track)) in velocities.iter().zip(&tracks).enumerate() {
        let here = &truth[frame];
        let is_valid = row["status"] == "valid";
        positions += usize::from(is_valid && number(track, "center_x_px").is_some());
        rotations += usize::from(number(row, "dtheta_deg").is_some());
        let mut compare = |table: &Row, names: [&str; 2], exact: f64, limit: f64| {
            let Some((found, sigma)) = number(table, names[0]).zip(number(table, names[1])) else { return };
            let off = (found - exact).abs();
            if is_valid && off > MAX_SIGMAS * sigma && off > limit {
                faults.push(format!(
                    "{} frame {frame}: {} is {found}, truth {exact}, sigma {sigma}",
                    film.name, names[0]
                ));
            }
        };
        let exact = |name: &str| number(here, name).unwrap();
        for (center, offset) in ["center_x_px", "center_y_px"].into_iter().zip(film.point_px) {
            compare(track, [center, "sigma_center_px"], exact(center) + offset, MAX_CENTER_PX);
        }
        let Some(next) = truth.get(frame + 1) else { continue };
        let step = |name: &str| number(next, name).unwrap() - number(here, name).unwrap();
        compare(row, ["dx_px", "sigma_dx_px"], step("center_x_px"), MAX_STEP_PX);
        compare(row, ["dy_px", "sigma_dy_px"], step("center_y_px"), MAX_STEP_PX);
        let turned = step("angle_deg");
        compare(row, ["dtheta_deg", "sigma_dtheta_deg"], turned, MAX_STEP_DEG.max(MAX_SPIN_FRACTION * turned.abs()));
    }
    let share = |count: usize| count as f64 / truth.len() as f64;
    let (positions, rotations) = (share(positions), share(rotations));
    println!("{}: positions {positions:.2}, rotations {rotations:.2}, {} wrong", film.name, faults.len());
    if positions < film.positions {
        faults.push(format!("{}: {positions:.2} of the positions measured", film.name));
    }
    match film.rotations {
        Rotations::Unseen if rotations > 0.0 => faults.push(format!("{}: a rotation that cannot be seen", film.name)),
        Rotations::Share(min) if rotations < min => {
            faults.push(format!("{}: {rotations:.2} of the rotations", film.name))
        }
        _ => {}
    }
    faults
}

#[test]
fn rendered_films_are_measured_or_refused() {
    let Some(folder) = folder() else { return };
    let faults: Vec<String> = MEASURED.iter().flat_map(|film| faults(&folder, film)).collect();
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
#[ignore = "the aim, which is not reached for every film"]
fn every_rendered_film_is_measured_and_nothing_is_wrong() {
    let Some(folder) = folder() else { return };
    let faults: Vec<String> = ALL.iter().flat_map(|film| faults(&folder, film)).collect();
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}
