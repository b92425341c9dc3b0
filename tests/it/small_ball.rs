//! Balls of a few pixels, which have no outline: found as points, by what changes.

use crate::import::npy;
use crate::phone_film::has_ffmpeg;
use crate::support::{csv, succeed};
use ricochet::numeric::Stream;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

const SIZE: [usize; 2] = [200, 150];
const RATE_HZ: f64 = 120.0;
const MM_PER_PX: f64 = 4.0;
const GRAVITY_M_S2: f64 = 9.81;
/// The motion blur, as a fraction of the frame period.
const EXPOSURE: f64 = 0.5;
const FRAMES: usize = 40;
/// The displacement of the shadow of the ball on the wall, px.
const SHADOW_PX: [f64; 2] = [14.0, 9.0];

/// A ball that is thrown before a wall.
#[derive(Clone, Copy)]
struct Throw {
    radius_px: f64,
    ball_dn: f64,
    wall_dn: f64,
    /// The share of the light that its shadow takes away.
    shadow: f64,
    /// The velocity in the first frame, px per frame, down positive.
    first_px: [f64; 2],
}

impl Throw {
    /// Returns the place of the ball at a time in frames.
    fn place(&self, time: f64) -> [f64; 2] {
        let fall_px = 0.5 * GRAVITY_M_S2 * 1e3 / MM_PER_PX * (time / RATE_HZ).powi(2);
        [15.3 + self.first_px[0] * time, 100.2 + self.first_px[1] * time + fall_px]
    }

    /// Returns the velocity along x and up at a time in frames, m/s.
    fn velocity(&self, time: f64) -> [f64; 2] {
        let [vx, vy] = self.first_px.map(|px| px * MM_PER_PX * 1e-3 * RATE_HZ);
        [vx, -vy - GRAVITY_M_S2 * time / RATE_HZ]
    }

    /// Returns the grey levels of a frame. Its ball covers 16 places along its path.
    fn draw(&self, frame: usize, noise: &mut Stream) -> Vec<u8> {
        let places: Vec<[f64; 2]> =
            (0..16).map(|k| self.place(frame as f64 + EXPOSURE * (f64::from(k) + 0.5) / 16.0)).collect();
        let covered = |x: f64, y: f64, offset: [f64; 2]| {
            let share = |[px, py]: &[f64; 2]| {
                (self.radius_px + 0.5 - (x - px - offset[0]).hypot(y - py - offset[1])).clamp(0.0, 1.0)
            };
            places.iter().map(share).sum::<f64>() / 16.0
        };
        let level = |at: usize, noise: &mut Stream| {
            let [x, y] = [(at % SIZE[0]) as f64, (at / SIZE[0]) as f64];
            let wall = self.wall_dn * (1.0 + 0.12 * (x / 5.0).sin() * (y / 7.0).cos());
            let wall = wall * (1.0 - self.shadow * covered(x, y, SHADOW_PX));
            let ball = covered(x, y, [0.0; 2]);
            (ball * self.ball_dn + (1.0 - ball) * wall + 1.5 * noise.normal()).round().clamp(0.0, 255.0) as u8
        };
        (0..SIZE[0] * SIZE[1]).map(|at| level(at, noise)).collect()
    }

    /// Measures a film of the throw; returns its results.
    fn measure(&self, rig: &str, folder: &Path) -> PathBuf {
        let mut noise = Stream::new(11);
        let pixels: Vec<u8> = (0..FRAMES).flat_map(|frame| self.draw(frame, &mut noise)).collect();
        let [film, config, results] = ["throw.npy", "rig.toml", "throw.mcap"].map(|name| folder.join(name));
        let shape = format!("({FRAMES}, {}, {})", SIZE[1], SIZE[0]);
        std::fs::write(&film, npy("|u1", "False", &shape, &pixels)).unwrap();
        let exposure_us = 1e6 * EXPOSURE / RATE_HZ;
        let head = "[camera]\nsource = \"recording\"\nid = \"x.mcap\"\n";
        std::fs::write(&config, format!("{head}exposure_us = {exposure_us}\n{rig}")).unwrap();
        let _ = std::fs::remove_file(&results);
        let [film, config, results_path] = [&film, &config, &results].map(|path| path.to_str().unwrap());
        succeed(["analyze", film, "--fps", "120", "--config", config, "-o", results_path]);
        results
    }
}

type Row = HashMap<String, String>;

/// Returns the rows of a topic by the names of their columns.
fn rows(results: &Path, topic: &str) -> Vec<Row> {
    let table = csv(results, topic);
    let mut lines = table.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
    let names = lines.next().unwrap();
    lines.map(|row| names.iter().cloned().zip(row).collect()).collect()
}

const THROWS: [Throw; 4] = [
    Throw { radius_px: 5.2, ball_dn: 225.0, wall_dn: 60.0, shadow: 0.0, first_px: [4.13, -4.37] },
    Throw { radius_px: 4.0, ball_dn: 30.0, wall_dn: 150.0, shadow: 0.15, first_px: [3.71, -3.9] },
    Throw { radius_px: 3.1, ball_dn: 210.0, wall_dn: 90.0, shadow: 0.2, first_px: [2.57, -4.61] },
    Throw { radius_px: 2.4, ball_dn: 240.0, wall_dn: 40.0, shadow: 0.0, first_px: [4.33, -3.53] },
];

/// Requires rows in most frames, and positions and velocities within five standard uncertainties.
fn check(throw: &Throw, rows: &[Row], positions: &[Row]) {
    let number = |row: &Row, name: &str| row[name].parse::<f64>().ok();
    let (mut worst, mut measured) = (0.0_f64, 0);
    for (row, position) in rows.iter().zip(positions) {
        assert!(row["omega_rad_s"].is_empty() && row["dtheta_deg"].is_empty(), "a point has no spin: {row:?}");
        let frame = number(row, "frame").unwrap();
        let (at_px, velocity) = (throw.place(frame + 0.5 * EXPOSURE), throw.velocity(frame + 0.5 * EXPOSURE));
        let Some(x_px) = number(row, "center_x_px") else { continue };
        let (y_px, sigma_px) = (number(row, "center_y_px").unwrap(), number(position, "sigma_center_px").unwrap());
        assert!(row["status"] != "valid" || sigma_px < 0.25 * throw.radius_px, "frame {frame}: {sigma_px} px");
        let mut errors = vec![(x_px - at_px[0]) / sigma_px, (y_px - at_px[1]) / sigma_px];
        if let (Some(vx), Some(vy)) = (number(row, "vx_m_s"), number(row, "vy_m_s")) {
            let sigma = number(row, "sigma_v_m_s").unwrap();
            errors.extend([(vx - velocity[0]) / sigma, (vy - velocity[1]) / sigma]);
            assert!(row["status"] != "valid" || sigma < 0.1, "frame {frame}: {sigma} m/s");
            measured += usize::from(row["status"] == "valid");
        }
        worst = errors.iter().fold(worst, |worst, error| worst.max(error.abs()));
    }
    println!("radius {} px: {measured} of {FRAMES} frames, worst error {worst} sigmas", throw.radius_px);
    assert!(measured * 10 >= 8 * FRAMES && worst < 5.0, "{measured} of {FRAMES} frames, {worst} sigmas");
}

#[test]
fn a_thrown_ball_of_a_few_pixels_is_followed_as_a_point() {
    let folder = tempfile::tempdir().unwrap();
    for throw in THROWS {
        let diameter_mm = 2.0 * throw.radius_px * MM_PER_PX;
        let size_known = format!("diameter_mm = {diameter_mm}\n");
        for size in [&*size_known, "min_radius_px = 2\nmax_radius_px = 12\n"] {
            let rig = format!("[scale]\nmm_per_px = 4.0\n[[body]]\nname = \"ball\"\nkind = \"ball\"\n{size}");
            let results = throw.measure(&rig, folder.path());
            let [velocities, positions] = ["velocity", "track"].map(|topic| rows(&results, topic));
            check(&throw, &velocities, &positions);
        }
    }
}

/// The public film of a white ball of about 10 px across, thrown before a dark wall, interlaced, with a hand that moves.
#[test]
fn a_filmed_toss_is_a_parabola() {
    let folder = std::env::var_os("RICOCHET_REAL_DATA").map(PathBuf::from);
    let film = folder.map(|folder| folder.join("field/real-ball-toss-all-lost/toss.mkv")).filter(|path| path.exists());
    let Some(film) = film.filter(|_| has_ffmpeg()) else {
        eprintln!("left out: no folder of real recordings, or no ffmpeg");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let [rig, results] = ["rig.toml", "toss.mcap"].map(|name| folder.path().join(name));
    let text =
        "[scale]\nmm_per_px = 2.3\n[[body]]\nname = \"ball\"\nkind = \"ball\"\nmin_radius_px = 3\nmax_radius_px = 15\n";
    std::fs::write(&rig, text).unwrap();
    let [film, rig, path] = [&film, &rig, &results].map(|path| path.to_str().unwrap());
    succeed(["analyze", film, "--fps", "30", "--config", rig, "-o", path]);
    let place = |row: &Row| {
        let [frame, x_px, y_px] = ["frame", "center_x_px", "center_y_px"].map(|name| row[name].parse::<f64>().ok());
        Some([frame?, x_px?, y_px?])
    };
    let places: Vec<[f64; 3]> = rows(&results, "velocity").iter().filter_map(place).collect();
    assert!(places.len() >= 10, "{places:?}");
    // Newton's divided differences over all places, as far apart as possible.
    let (first, middle, last) = (places[0], places[places.len() / 2], places[places.len() - 1]);
    let slope = |a: [f64; 3], b: [f64; 3], axis: usize| (b[axis] - a[axis]) / (b[0] - a[0]);
    let bend = |axis: usize| 2.0 * (slope(middle, last, axis) - slope(first, middle, axis)) / (last[0] - first[0]);
    println!("{} places, accelerations {} and {} px", places.len(), bend(1), bend(2));
    // 9.8 m/s^2 by the ruler in the picture is about 4.5 px per frame and frame.
    assert!(bend(1).abs() < 0.1 && (4.2..4.7).contains(&bend(2)), "{} and {} px", bend(1), bend(2));
    let fall = |frame: f64, axis: usize| {
        first[axis] + (frame - first[0]) * (slope(first, middle, axis) + 0.5 * bend(axis) * (frame - middle[0]))
    };
    for place in &places {
        let off_px = (place[1] - fall(place[0], 1)).hypot(place[2] - fall(place[0], 2));
        assert!(off_px < 1.2, "frame {}: {off_px} px", place[0]);
    }
}
