//! The rules of thumb of the guides (`docs/rate.md`, `docs/speckles.md`, `docs/scale.md`), each measured.

use crate::measured_world::rows_of;
use crate::support::Rig;
use ricochet::config::Config;
use ricochet::process::truth_world;
use ricochet::results::Impact;
use ricochet::study::design::predict;
use ricochet::synth::{MotionSetup, PatternSetup, Scenario};

/// The lacrosse ball in a higher image, with so many frames per second and in each flight.
fn drop(frame_rate_hz: f64, flight_frames: f64, exposure_us: f64) -> Scenario {
    let mut scenario = Scenario::built_in("lacrosse").unwrap();
    let MotionSetup::Impact(impact) = &mut scenario.motion else { panic!("an impact") };
    // Off the times of frames.
    impact.contact_start_s = (flight_frames + 0.37) / frame_rate_hz;
    impact.contact_center_px = [124.3, 220.6];
    let contact_s = 4.4e-3;
    let camera = &mut scenario.camera;
    camera.frames = ((contact_s * frame_rate_hz).ceil() + 2.0 * flight_frames) as u64;
    (camera.width_px, camera.height_px) = (256, 320);
    (camera.frame_rate_hz, camera.exposure_us) = (frame_rate_hz, exposure_us);
    scenario
}

/// A rig for a scenario.
fn rig(place: &Rig, scenario: &Scenario, scale: &str) -> Config {
    let path = place.path("scenario.toml");
    std::fs::write(&path, toml::to_string(scenario).unwrap()).unwrap();
    let text = format!(
        "[rig]\nname = \"rule\"\n[camera]\nsource = \"simulated\"\nscenario = {path:?}\npaced = false\n[scale]\n{scale}\n\
         [surface]\nangle_deg = 0\n[[body]]\nname = \"ball\"\nkind = \"ball\"\ndiameter_mm = 63.25\n\
         [velocity]\ngravity_angle_deg = -71\n"
    );
    Config::parse(&text, "rig.toml").unwrap()
}

/// The measured collision and the true one.
fn collision(scenario: &Scenario) -> (Impact, Impact) {
    let place = Rig::new();
    let config = rig(&place, scenario, "mm_per_px = 0.5142");
    let world = truth_world(&config).unwrap().unwrap();
    let measured = rows_of(&world, &config.text).impacts.pop().expect("a collision");
    (measured, world.impact().unwrap())
}

#[test]
fn ten_frames_in_each_flight_give_the_restitution_even_with_2_px_of_motion_in_each() {
    // The ball falls at 1.78 m/s, 3.5 px per ms.
    for (frame_rate_hz, exposure_us) in [(1000.0, 20.0), (1000.0, 578.0), (500.0, 578.0)] {
        let (measured, truth) = collision(&drop(frame_rate_hz, 10.0, exposure_us));
        let (found, true_value) = (measured.restitution.unwrap(), truth.restitution.unwrap().value);
        println!("{frame_rate_hz} Hz, {exposure_us} us: {:.4} +- {:.4}, true {true_value:.4}", found.value, found.sigma);
        assert!(found.sigma < 0.01 && (found.value - true_value).abs() < 5.0 * found.sigma);
    }
}

#[test]
fn ten_frames_during_contact_give_its_duration() {
    let (measured, truth) = collision(&drop(10.0 / 4.4266e-3, 20.0, 20.0));
    let (found, true_s) = (measured.contact_time_s.unwrap(), truth.contact_time_s.unwrap().value);
    println!("{:.4e} +- {:.1e} s, true {true_s:.4e}", found.value, found.sigma);
    assert!(found.sigma < 0.01 * true_s && (found.value - true_s).abs() < 5.0 * found.sigma);
}

#[test]
fn the_measured_radius_gives_the_scale_to_a_thousandth() {
    let place = Rig::new();
    let config = rig(&place, &drop(10_000.0, 14.0, 20.0), "ball_diameter_mm = 63.25");
    let world = truth_world(&config).unwrap().unwrap();
    let rows = rows_of(&world, &config.text);
    let radii: Vec<f64> = rows.tracks.iter().filter_map(|row| row.radius_px).collect();
    let mean = radii.iter().sum::<f64>() / radii.len() as f64;
    let off = 2.0 * mean * 0.5142 / 63.25 - 1.0;
    println!("{} radii, {mean:.3} px, {:.3} %", radii.len(), 100.0 * off);
    assert!(radii.len() > 20 && off.abs() < 1e-3);
}

/// The predicted scatter of the normal speed and of the spin in flight, for speckles of this diameter and coverage.
fn scatter(diameter_px: f64, coverage: f64) -> [f64; 2] {
    let place = Rig::new();
    let mut scenario = drop(10_000.0, 14.0, 20.0);
    let area_px2 = std::f64::consts::FRAC_PI_4 * diameter_px.powi(2);
    let (area_min_px2, area_max_px2) = (0.8 * area_px2, 1.2 * area_px2);
    scenario.body.pattern = PatternSetup { area_min_px2, area_max_px2, coverage, ..scenario.body.pattern };
    let expected = predict(&rig(&place, &scenario, "mm_per_px = 0.5142")).unwrap();
    let sigma = |name: &str| expected.iter().find(|found| found.name == name).unwrap().sigma;
    [sigma("flight.vn_m_s"), sigma("flight.omega_rad_s")]
}

#[test]
fn speckles_of_3_to_5_px_and_half_covered_have_a_small_scatter() {
    let best = scatter(4.0, 0.5);
    for (diameter_px, coverage) in [(2.0, 0.5), (3.0, 0.5), (5.0, 0.5), (10.0, 0.5), (4.0, 0.1), (4.0, 0.3)] {
        let ratio = [0, 1].map(|k| scatter(diameter_px, coverage)[k] / best[k]);
        println!("{diameter_px} px, {coverage}: {ratio:.2?} of the scatter at 4 px, half covered");
    }
}
