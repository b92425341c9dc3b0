//! The whole measurement against known truth, at speeds off every 1/n grid.

use crate::film::{level_rig, rows_of};
use ricochet::ball::BallParams;
use ricochet::dic::CorrelationParams;
use ricochet::image::Frame;
use ricochet::measure::{MeasureParams, Measurer, Share};
use ricochet::motion::Rotation;
use ricochet::results::{AlarmKind, Impact, RigidStep};
use ricochet::synth::{Scenario, World};
use std::collections::BTreeMap;

const FRAMES: u64 = 16;

/// Every step of a simulated ball and its truth.
fn measure(scenario: &Scenario) -> Vec<(RigidStep, RigidStep)> {
    let world = World::new(scenario).unwrap();
    let (width, height) = (world.width_px() as usize, world.height_px() as usize);
    let params = MeasureParams {
        correlation: CorrelationParams::default(),
        intervals_frames: vec![1],
        rotation: Rotation::Rigid,
        bodies: vec![BallParams::new(50.0, 70.0).into()],
        block_frames: 16,
    };
    let mut measurer = Measurer::new(&params, Share::ALL, width, height).unwrap();
    let (mut measured, mut bytes) = (Vec::new(), vec![0; world.frame_bytes()]);
    for index in 0..world.frames() {
        world.render(index, &mut bytes);
        let meta = ricochet::camera::simulated::meta(&world, index);
        measurer.push(&Frame { meta, bytes: &bytes }, &mut measured).unwrap();
    }
    let truth = |frame: u64| world.truth(frame).step;
    measured.iter().filter_map(|row| Some((row.step.step?, truth(row.step.frame)?))).collect()
}

fn scenario(vx_px: f64, vy_px: f64, omega_deg: f64) -> Scenario {
    let mut scenario = Scenario::translation(vx_px, vy_px, omega_deg);
    scenario.camera.frames = FRAMES;
    scenario.camera.width_px = 256;
    scenario.camera.height_px = 256;
    if let ricochet::synth::MotionSetup::Constant { start_px, .. } = &mut scenario.motion {
        *start_px = [110.3, 112.7];
    }
    scenario
}

/// Mean and root mean square of errors, and of errors over their sigmas.
fn judge(errors: &[(f64, f64)]) -> [f64; 4] {
    let count = errors.len() as f64;
    let mean = errors.iter().map(|(error, _)| error).sum::<f64>() / count;
    let rms = (errors.iter().map(|(error, _)| error * error).sum::<f64>() / count).sqrt();
    let largest = errors.iter().map(|(error, _)| error.abs()).fold(0.0, f64::max);
    let pulls = (errors.iter().map(|(error, sigma)| (error / sigma).powi(2)).sum::<f64>() / count).sqrt();
    [mean, rms, largest, pulls]
}

#[test]
fn a_ball_moves_by_what_was_drawn_to_five_thousandths_of_a_pixel() {
    for speed in [0.13, 0.37, 0.77, 1.23, 1.9] {
        let steps = measure(&scenario(speed, -0.31 * speed, 0.0));
        assert_eq!(steps.len() as u64, FRAMES - 1, "every frame but the last");
        let x: Vec<_> = steps.iter().map(|(step, truth)| (step.dx_px - truth.dx_px, step.sigma_dx_px)).collect();
        let y: Vec<_> = steps.iter().map(|(step, truth)| (step.dy_px - truth.dy_px, step.sigma_dy_px)).collect();
        for (axis, errors) in [("x", x), ("y", y)] {
            let [mean, rms, largest, pulls] = judge(&errors);
            println!("{speed} px/frame, {axis}: bias {mean:.5}, rms {rms:.5}, max {largest:.5} px, pulls {pulls:.2}");
            assert!(mean.abs() <= 0.005 && rms <= 0.005, "{speed} px/frame along {axis}: {mean}, {rms}");
        }
    }
}

#[test]
fn a_ball_turns_by_what_was_drawn_to_two_hundredths_of_a_degree() {
    for spin in [0.35, 1.7] {
        let steps = measure(&scenario(0.37, 0.13, spin));
        assert_eq!(steps.len() as u64, FRAMES - 1);
        let errors: Vec<_> =
            steps.iter().map(|(step, truth)| (step.dtheta_deg - truth.dtheta_deg, step.sigma_dtheta_deg)).collect();
        let [mean, rms, largest, pulls] = judge(&errors);
        println!("{spin} deg/frame: bias {mean:.5}, rms {rms:.5}, max {largest:.5} deg, pulls {pulls:.2}");
        assert!(mean.abs() <= 0.02 && rms <= 0.02, "{spin} deg/frame: {mean}, {rms}");
        assert!((0.5..1.6).contains(&pulls), "uncertainties are off by {pulls}");
    }
}

#[test]
fn the_velocity_of_a_ball_that_turns_is_as_sure_as_it_says() {
    // What its centre leaves unsure is most of it: a point beside the centre goes round.
    for spin in [0.0, 0.3, 2.1] {
        let mut pulls = [0.0; 2];
        for seed in 0..8 {
            let (sin, cos) = (1.3 * f64::from(seed)).sin_cos();
            let mut film = scenario(0.63 * cos, 0.63 * sin, spin);
            (film.seed, film.camera.frames) = (20 + seed as u64, 32);
            let world = World::new(&film).unwrap();
            let row = rows_of(&world, &level_rig(film.scale.mm_per_px)).velocities[16];
            let (found, truth) = (row.velocity.unwrap(), world.truth(16).velocity.unwrap());
            for (pull, apart) in pulls.iter_mut().zip([found.vx_m_s - truth.vx_m_s, found.vy_m_s - truth.vy_m_s]) {
                *pull += (apart / found.sigma_v_m_s).powi(2) / 8.0;
            }
        }
        let pulls = pulls.map(f64::sqrt);
        println!("{spin} deg/frame: velocities are off by {:.2} and {:.2} of their sigmas", pulls[0], pulls[1]);
        assert!(pulls.iter().all(|pull| (0.4..1.5).contains(pull)), "{spin}: {pulls:?}");
    }
}

/// A simulated drop, from frames to its impact, and the truth.
fn drop_of(seed: u64, intervals: &str, rotation: &str) -> (Impact, Impact) {
    let text = include_str!("../../config/lacrosse.toml");
    let text = format!("{text}\n[rotation]\nmethod = \"{rotation}\"\n");
    let text = text.replace("[correlation]", &format!("[correlation]\ninterval_frames = {intervals}"));
    let scenario = Scenario { seed, ..Scenario::built_in("lacrosse").unwrap() };
    let world = World::new(&scenario).unwrap();
    let rows = rows_of(&world, &text);
    (*rows.impacts.last().unwrap(), world.impact().unwrap())
}

/// Measures some drops; gives the root mean square error of each number.
fn judge_impacts(intervals: &str, rotation: &str) -> BTreeMap<&'static str, f64> {
    let drops: Vec<(Impact, Impact)> = (0..12).map(|seed| drop_of(4000 + seed, intervals, rotation)).collect();
    let mut errors_of = BTreeMap::new();
    for (index, (name, _)) in drops[0].1.numbers().iter().enumerate() {
        let errors: Vec<(f64, f64)> = drops
            .iter()
            .filter_map(|(measured, truth)| {
                let (measured, truth) = (measured.numbers()[index].1?, truth.numbers()[index].1?);
                Some((measured.value - truth.value, measured.sigma))
            })
            .collect();
        if errors.is_empty() {
            continue;
        }
        let [mean, rms, largest, pulls] = judge(&errors);
        println!("{name}: bias {mean:.2e}, rms {rms:.2e}, max {largest:.2e}, pulls {pulls:.2}");
        assert_eq!(errors.len(), drops.len(), "{name} is missing in some");
        assert!((0.3..1.5).contains(&pulls), "{name}: errors are {pulls} of their uncertainties");
        errors_of.insert(*name, rms);
    }
    errors_of
}

#[test]
fn uncertainties_of_an_impact_are_neither_too_small_nor_much_too_large() {
    judge_impacts("1", "rigid");
}

#[test]
fn a_longer_interval_beside_the_shortest_makes_long_fits_surer() {
    let (one, both) = (judge_impacts("1", "field"), judge_impacts("[1, 5]", "field"));
    // Flights of many frames and the whole of a contact; short flights are as sure as their frames.
    for name in ["deepest_s", "vn_after_m_s", "omega_after_rad_s", "acceleration_max_m_s2"] {
        assert!(both[name] < 0.8 * one[name], "{name}: {} and {}", both[name], one[name]);
    }
}

#[test]
fn a_collision_is_told_while_it_lasts() {
    let text = include_str!("../../config/lacrosse.toml");
    let (mut began, mut turned, mut told) = (0.0_f64, 0.0_f64, 0.0_f64);
    for seed in 0..8 {
        let world = World::new(&Scenario { seed: 5000 + seed, ..Scenario::built_in("lacrosse").unwrap() }).unwrap();
        let truth = world.impact().unwrap();
        let frames = |at_s: Option<ricochet::results::Estimate>| at_s.unwrap().value * world.frame_rate_hz();
        let rows = rows_of(&world, text);
        let alarm = |kind| rows.alarms.iter().find(|alarm| alarm.kind == kind).unwrap();
        assert_eq!(rows.alarms.len(), 2, "{:?}", rows.alarms);
        // A step is known when the frame after it has come.
        let after = |frame: u64, at: f64| (frame + 1) as f64 - at;
        let (start, turn) = (alarm(AlarmKind::Began), alarm(AlarmKind::Turned));
        began = began.max(after(start.frame, frames(truth.start_s)));
        turned = turned.max(after(turn.frame, frames(truth.deepest_s)));
        told = told.max((turn.at_s.value * world.frame_rate_hz() - frames(truth.deepest_s)).abs());
    }
    println!("contact told {began:.1} frames after its start, the turn {turned:.1} after it and off by {told:.3}");
    assert!(began <= 10.0 && turned <= 15.0 && told < 0.5);
}
