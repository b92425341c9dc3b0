//! Balls that look like a still ground: found by their difference from it, or refused.

use crate::measured_world::rows_of;
use ricochet::results::PointStatus;
use ricochet::synth::{MotionSetup, PatternSetup, Scenario, SimulatedFilm};

/// The scale.
const MM_PER_PX: f64 = 0.5;

/// A plain ball and the ground that it looks like.
struct Look {
    radius_px: f64,
    /// Grey level of the ball, and the share of its light that a lamp from the side gives.
    ball: f64,
    lamp: f64,
    /// Standard deviation of the ground's texture; its light changes by `gradient` along x and y.
    texture: f64,
    gradient: [f64; 2],
    /// Noise of a pixel, DN.
    noise_dn: f64,
}

/// A shaded ball before a mottled ground.
const MOTTLED: Look = Look { radius_px: 9.0, ball: 0.42, lamp: 0.8, texture: 0.15, gradient: [0.0; 2], noise_dn: 2.0 };
/// Small balls whose rim hardly differs from the ground: before a smooth one, in uneven light, and before a texture.
const FAINT: [Look; 3] = [
    Look { radius_px: 6.5, ball: 0.44, lamp: 0.3, texture: 0.02, gradient: [0.0; 2], noise_dn: 2.5 },
    Look { radius_px: 8.0, ball: 0.44, lamp: 0.25, texture: 0.03, gradient: [-0.2, 0.3], noise_dn: 2.5 },
    Look { radius_px: 7.0, ball: 0.42, lamp: 0.3, texture: 0.06, gradient: [0.0; 2], noise_dn: 4.0 },
];

/// A plain ball as bright as the ground, which moves by `v_px_frame`.
fn film(seed: u64, v_px_frame: [f64; 2], look: &Look) -> SimulatedFilm {
    let mut scenario = Scenario::translation(0.0, 0.0, 0.0);
    scenario.seed = seed;
    (scenario.camera.width_px, scenario.camera.height_px, scenario.camera.frames) = (220, 180, 48);
    scenario.camera.noise_dn = look.noise_dn;
    (scenario.scale.mm_per_px, scenario.body.diameter_mm) = (MM_PER_PX, 2.0 * look.radius_px * MM_PER_PX);
    scenario.body.pattern = PatternSetup { coverage: 0.0, area_max_px2: 6.0, ..scenario.body.pattern };
    (scenario.shade.ball, scenario.shade.ground, scenario.shade.ground_texture) = (look.ball, 0.4, look.texture);
    let light = &mut scenario.light;
    (light.lamp, light.side_angle_deg, light.highlight) = (look.lamp, 120.0, 0.5);
    [light.gradient_x, light.gradient_y] = look.gradient;
    let [vx_px_frame, vy_px_frame] = v_px_frame;
    let start_px = [30.3, 40.7];
    scenario.motion = MotionSetup::Constant { vx_px_frame, vy_px_frame, omega_deg_frame: 0.0, start_px };
    SimulatedFilm::new(&scenario).unwrap()
}

fn rig(look: &Look) -> String {
    format!(
        "[rig]\nname = \"ground\"\n[camera]\nsource = \"recording\"\nid = \"film.mcap\"\n[scale]\nmm_per_px = {MM_PER_PX}\n\
         [[body]]\nname = \"ball\"\nkind = \"ball\"\ndiameter_mm = {}\n[velocity]\ngravity_m_s2 = 0\n",
        2.0 * look.radius_px * MM_PER_PX
    )
}

/// The number of frames with a valid position, the largest error in sigmas, and the rms error in px.
struct Summary {
    valid: usize,
    worst: f64,
    rms_px: f64,
}

fn measure(seed: u64, v_px_frame: [f64; 2], look: &Look) -> Summary {
    let world = film(seed, v_px_frame, look);
    let rows = rows_of(&world, &rig(look));
    let (mut valid, mut worst, mut squares) = (0_usize, 0.0_f64, 0.0);
    for (row, track) in rows.velocities.iter().zip(&rows.tracks) {
        let truth = world.truth(row.frame);
        let places = [track.center_x_px.zip(truth.center_x_px), track.center_y_px.zip(truth.center_y_px)];
        let (Some(sigma), [Some(x), Some(y)], PointStatus::Valid) = (track.sigma_center_px, places, track.status)
        else {
            continue;
        };
        let error = (x.0 - x.1).abs().max((y.0 - y.1).abs());
        (valid, worst, squares) = (valid + 1, worst.max(error / sigma), squares + error * error);
    }
    Summary { valid, worst, rms_px: (squares / valid.max(1) as f64).sqrt() }
}

#[test]
fn a_ball_like_its_ground_is_found_by_its_motion() {
    for (seed, v) in [(1, [3.1, 1.7]), (2, [2.3, 2.6]), (3, [3.6, 0.9])] {
        let Summary { valid, worst, rms_px } = measure(seed, v, &MOTTLED);
        println!("seed {seed}: {valid} of 48 positions, {rms_px:.3} px rms, {worst:.1} sigma at most");
        assert!(valid >= 30 && worst < 5.0 && rms_px < 0.4, "seed {seed}: {valid}, {worst}, {rms_px}");
    }
}

#[test]
fn a_ball_with_a_faint_rim_is_found_by_its_motion() {
    for (look, min_valid) in FAINT.iter().zip([30, 5, 3]) {
        for (seed, v) in [(1, [3.1, 1.7]), (2, [2.3, 2.6]), (3, [3.6, 0.9])] {
            let Summary { valid, worst, rms_px } = measure(seed, v, look);
            println!("seed {seed}: {valid} of 48 positions, {rms_px:.3} px rms, {worst:.1} sigma at most");
            assert!(valid >= min_valid && worst < 5.0 && rms_px < 0.6, "seed {seed}: {valid}, {worst}, {rms_px}");
        }
    }
}

#[test]
fn a_ball_that_stays_in_its_place_is_not_taken_for_its_own_shadow() {
    // Within a block it moves by less than its diameter, so it is a part of every background.
    for (seed, v) in [(4, [0.0, 0.0]), (5, [0.4, 0.2]), (6, [0.9, -0.3])] {
        let Summary { valid, worst, .. } = measure(seed, v, &MOTTLED);
        println!("seed {seed}: {valid} of 48 positions, {worst:.1} sigma at most");
        assert!(valid == 0 || worst < 5.0, "seed {seed}: {valid}, {worst}");
    }
}
