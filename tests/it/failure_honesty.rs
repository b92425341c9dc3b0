//! Difficult films: results are right or flagged, never silently wrong.

use crate::measured_world::{level_rig, rows_of_pictures};
use ricochet::results::VelocitySample;
use ricochet::synth::{MotionSetup, Scenario, SimulatedFilm};
use ricochet::track::TrackerRows;

/// One frame of a film: its pixels, the position of the ball and its motion.
struct Shot {
    bytes: Vec<u8>,
    truth: VelocitySample,
}

/// The frames of a world from `from` on.
fn shots(world: &SimulatedFilm) -> Vec<Shot> {
    let shot = |index| {
        let mut bytes = vec![0; world.frame_bytes()];
        world.render(index, &mut bytes);
        Shot { bytes, truth: world.truth(index) }
    };
    (0..world.frames()).map(shot).collect()
}

fn moving(seed: u64, frames: u64, start_px: [f64; 2], (vx, vy, spin): (f64, f64, f64)) -> Scenario {
    let mut scenario = Scenario::translation(vx, vy, spin);
    scenario.seed = seed;
    (scenario.camera.frames, scenario.camera.width_px, scenario.camera.height_px) = (frames, 256, 256);
    scenario.shade.ground_texture = 0.03;
    scenario.motion = MotionSetup::Constant { vx_px_frame: vx, vy_px_frame: vy, omega_deg_frame: spin, start_px };
    scenario
}

/// Measures the film with a rig.
fn measure(film: &[Shot], like: &Scenario, rig: &str) -> TrackerRows {
    rows_of_pictures(film.iter().map(|shot| shot.bytes.clone()), &SimulatedFilm::new(like).unwrap(), rig)
}

/// The rows of a film compared with the truth.
#[derive(Debug, Default)]
struct Verdict {
    /// Rows with a velocity.
    measured: usize,
    /// Rows with an error of more than [`MAX_SIGMAS`].
    wrong: Vec<String>,
}

/// The largest accepted error in sigmas.
const MAX_SIGMAS: f64 = 6.0;

fn judge(film: &[Shot], rows: &TrackerRows) -> Verdict {
    let mut verdict = Verdict::default();
    for ((shot, row), track) in film.iter().zip(&rows.velocities).zip(&rows.tracks) {
        let truth = &shot.truth;
        let mut check = |name: &str, found: Option<f64>, truth: Option<f64>, sigma: Option<f64>| {
            let Some(((found, truth), sigma)) = found.zip(truth).zip(sigma) else { return };
            if (found - truth).abs() > MAX_SIGMAS * sigma {
                let line = format!("frame {}: {name} is {found:.5}, truth {truth:.5}, sigma {sigma:.5}", row.frame);
                verdict.wrong.push(line);
            }
        };
        check("x", track.center_x_px, truth.center_x_px, track.sigma_center_px);
        check("y", track.center_y_px, truth.center_y_px, track.sigma_center_px);
        if let Some((step, true_step)) = row.motion.zip(truth.motion) {
            check("dx", Some(step.dx_px), Some(true_step.dx_px), Some(step.sigma_dx_px));
            check("dy", Some(step.dy_px), Some(true_step.dy_px), Some(step.sigma_dy_px));
            check("turn", step.dtheta_deg, true_step.dtheta_deg, step.sigma_dtheta_deg);
        }
        if let Some((v, t)) = row.velocity.zip(truth.velocity) {
            check("vx", Some(v.vx_m_s), Some(t.vx_m_s), Some(v.sigma_v_m_s));
            check("vy", Some(v.vy_m_s), Some(t.vy_m_s), Some(v.sigma_v_m_s));
            check("omega", v.omega_rad_s, t.omega_rad_s, v.sigma_omega_rad_s);
        }
        verdict.measured += usize::from(row.velocity.is_some());
    }
    for line in &verdict.wrong {
        println!("{line}");
    }
    println!("{} of {} frames measured, {} numbers wrong", verdict.measured, film.len(), verdict.wrong.len());
    verdict
}

#[test]
fn a_ball_that_leaves_and_returns_is_reported_only_while_visible() {
    let out = moving(5, 64, [150.3, 120.7], (3.37, 0.41, 0.9));
    let back = moving(5, 64, [330.3, 140.7], (-3.37, -0.41, -0.9));
    let mut film = shots(&SimulatedFilm::new(&out).unwrap());
    film.extend(shots(&SimulatedFilm::new(&back).unwrap()));
    let rows = measure(&film, &out, &level_rig(out.scale.mm_per_px));
    let verdict = judge(&film, &rows);
    assert!(verdict.wrong.is_empty());
}

#[test]
fn a_ball_blurred_by_a_long_exposure_is_measured_right() {
    for (speed, spin) in [(2.9, 0.4), (4.1, 0.9)] {
        let mut blurred = moving(6, 28, [74.3, 110.7], (speed, 0.3, spin));
        blurred.camera.exposure_us = 0.9e6 / blurred.camera.frame_rate_hz;
        let film = shots(&SimulatedFilm::new(&blurred).unwrap());
        let verdict = judge(&film, &measure(&film, &blurred, &level_rig(blurred.scale.mm_per_px)));
        assert!(verdict.wrong.is_empty() && verdict.measured > 24);
    }
}

#[test]
fn a_flickering_lamp_does_not_bias_results() {
    for (share, hz) in [(0.1, 100.0), (0.4, 1200.0)] {
        let mut flickering = moving(7, 48, [100.3, 110.7], (1.13, 0.37, 0.6));
        (flickering.light.flicker, flickering.light.flicker_hz) = (share, hz);
        let film = shots(&SimulatedFilm::new(&flickering).unwrap());
        let verdict = judge(&film, &measure(&film, &flickering, &level_rig(flickering.scale.mm_per_px)));
        assert!(verdict.wrong.is_empty() && verdict.measured > 40);
    }
}

/// The truth of a frame without a ball.
fn nothing(like: &VelocitySample) -> VelocitySample {
    VelocitySample { center_x_px: None, center_y_px: None, radius_px: None, motion: None, velocity: None, ..*like }
}

#[test]
fn a_ball_that_is_dropped_three_times_in_one_film_has_three_impacts() {
    let drop = Scenario { seed: 31, ..Scenario::built_in("lacrosse").unwrap() };
    let world = SimulatedFilm::new(&drop).unwrap();
    let truth = world.impact().unwrap().restitution.unwrap().value;
    let mut film = Vec::new();
    for round in 0..3 {
        film.extend(shots(&world));
        if round < 2 {
            let gone = Shot { bytes: vec![30; world.frame_bytes()], truth: nothing(&world.truth(0)) };
            film.extend((0..40).map(|_| Shot { bytes: gone.bytes.clone(), truth: gone.truth }));
        }
    }
    let rows = measure(&film, &drop, include_str!("../../config/lacrosse.toml"));
    for number in 0..3 {
        let of_impact = rows.impacts.iter().filter(|impact| impact.number == number);
        let last = of_impact.max_by_key(|impact| impact.revision).unwrap().restitution.unwrap();
        println!("restitution {:.5} +- {:.5}, truth {truth:.5}", last.value, last.sigma);
        assert!((last.value - truth).abs() < 0.001);
    }
    assert!(rows.impacts.iter().all(|impact| impact.number < 3));
    assert!(judge(&film, &rows).wrong.is_empty());
}

/// Draws the ball of a second film in front of the frames of the first.
fn draw_in_front(film: &mut [Shot], other: &Scenario) {
    let (radius, width) = (other.radius_px() + 0.5, other.camera.width_px as usize);
    for (shot, second) in film.iter_mut().zip(shots(&SimulatedFilm::new(other).unwrap())) {
        let (x, y) = (second.truth.center_x_px.unwrap(), second.truth.center_y_px.unwrap());
        for (place, (byte, over)) in shot.bytes.iter_mut().zip(&second.bytes).enumerate() {
            let (column, row) = ((place % width) as f64, (place / width) as f64);
            if (column - x).hypot(row - y) < radius {
                *byte = *over;
            }
        }
    }
}

#[test]
fn a_second_ball_that_passes_is_not_taken_for_the_first() {
    // The last one creeps over the first, hardly faster than it.
    let passing =
        [([-80.3, 90.7], (7.3, 1.1, 0.9)), ([300.3, 60.7], (-4.7, 0.3, -1.3)), ([-32.3, 152.7], (1.93, -0.21, 0.9))];
    for (start_px, motion) in passing {
        let like = moving(8, 80, [90.3, 150.7], (0.63, -0.21, 0.5));
        let mut film = shots(&SimulatedFilm::new(&like).unwrap());
        draw_in_front(&mut film, &moving(9, 80, start_px, motion));
        let verdict = judge(&film, &measure(&film, &like, &level_rig(like.scale.mm_per_px)));
        assert!(verdict.wrong.is_empty() && verdict.measured > 24);
    }
}

#[test]
fn a_ball_in_two_frames_alone_is_lost_and_one_whose_texture_was_matched_is_measured() {
    let like = moving(6, 24, [130.3, 120.7], (0.83, -0.41, 0.9));
    for (shown, found) in [(10..11, 0), (10..12, 0), (10..13, 3)] {
        let mut film = shots(&SimulatedFilm::new(&like).unwrap());
        let is_away = |(index, _): &(usize, &mut Shot)| !shown.contains(index);
        film.iter_mut().enumerate().filter(is_away).for_each(|(_, shot)| shot.bytes.fill(60));
        let rows = measure(&film, &like, &level_rig(like.scale.mm_per_px));
        let placed: Vec<u64> =
            rows.tracks.iter().filter(|track| track.center_x_px.is_some()).map(|track| track.frame).collect();
        assert_eq!(placed.len(), found, "shown in {shown:?}, found in {placed:?}");
        assert!(judge(&film, &rows).wrong.is_empty());
    }
}
