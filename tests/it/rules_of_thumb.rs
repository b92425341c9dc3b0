//! The rules of thumb of the guides (`docs/rate.md`, `docs/speckles.md`, `docs/scale.md`), each measured.

use crate::measured_world::rows_of;
use crate::support::Rig;
use ricochet::config::Config;
use ricochet::process::truth_world;
use ricochet::results::Impact;
use ricochet::study::design::predict;
use ricochet::synth::{MotionSetup, PatternSetup, Scenario};

/// A film of the lacrosse ball.
#[derive(Clone, Copy)]
struct Film {
    frame_rate_hz: f64,
    /// The number of frames in each flight.
    flight_frames: f64,
    exposure_us: f64,
    /// The diameter of the ball in the image, px.
    ball_px: f64,
}

const DIAMETER_MM: f64 = 63.25;
const README: Film = Film { frame_rate_hz: 10_000.0, flight_frames: 14.0, exposure_us: 20.0, ball_px: 123.0 };

impl Film {
    fn mm_per_px(self) -> f64 {
        DIAMETER_MM / self.ball_px
    }

    fn scenario(self) -> Scenario {
        let mut scenario = Scenario::built_in("lacrosse").unwrap();
        let MotionSetup::Impact(impact) = &mut scenario.motion else { panic!("an impact") };
        // Off the times of frames.
        impact.contact_start_s = (self.flight_frames + 0.37) / self.frame_rate_hz;
        let fall_px = 1.8e3 * impact.contact_start_s / self.mm_per_px();
        let (width_px, height_px) = (1.3 * self.ball_px + 0.8 * fall_px, 1.5 * self.ball_px + 1.1 * fall_px);
        impact.contact_center_px = [0.5 * width_px + 0.3, height_px - 0.7 * self.ball_px + 0.6];
        let contact_s = 4.4e-3;
        let camera = &mut scenario.camera;
        camera.frames = ((contact_s * self.frame_rate_hz).ceil() + 2.0 * self.flight_frames) as u64;
        (camera.width_px, camera.height_px) = (width_px as u32, height_px as u32);
        (camera.frame_rate_hz, camera.exposure_us) = (self.frame_rate_hz, self.exposure_us);
        scenario.scale.mm_per_px = self.mm_per_px();
        scenario
    }
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
fn collision(film: Film) -> (Impact, Impact) {
    let place = Rig::new();
    let config = rig(&place, &film.scenario(), &format!("mm_per_px = {}", film.mm_per_px()));
    let world = truth_world(&config).unwrap().unwrap();
    let measured = rows_of(&world, &config.text).impacts.pop().expect("a collision");
    (measured, world.impact().unwrap())
}

#[test]
fn ten_frames_in_each_flight_give_the_restitution_even_with_2_px_of_motion_in_each() {
    // The ball falls at 1.78 m/s, 3.5 px per ms, and 578 us are 2 px. The last two are films of a phone.
    let films = [(1000.0, 20.0, 123.0), (1000.0, 578.0, 123.0), (500.0, 578.0, 123.0), (240.0, 500.0, 100.0)];
    for (frame_rate_hz, exposure_us, ball_px) in films.into_iter().chain([(240.0, 500.0, 60.0)]) {
        let (measured, truth) = collision(Film { frame_rate_hz, flight_frames: 10.0, exposure_us, ball_px });
        let (found, true_value) = (measured.restitution.unwrap(), truth.restitution.unwrap().value);
        let gravity = measured.gravity_m_s2.unwrap();
        println!(
            "{frame_rate_hz} Hz, {exposure_us} us, {ball_px} px: {:.4} +- {:.4}, true {true_value:.4}, gravity {:.2} +- {:.2}",
            found.value, found.sigma, gravity.value, gravity.sigma
        );
        assert!(found.sigma < 0.01 && (found.value - true_value).abs() < 5.0 * found.sigma);
        assert!(frame_rate_hz > 240.0 || (9.6..10.0).contains(&gravity.value));
    }
}

#[test]
fn ten_frames_during_contact_give_its_duration() {
    let (measured, truth) = collision(Film { frame_rate_hz: 10.0 / 4.4266e-3, flight_frames: 20.0, ..README });
    let (found, true_s) = (measured.contact_time_s.unwrap(), truth.contact_time_s.unwrap().value);
    println!("{:.4e} +- {:.1e} s, true {true_s:.4e}", found.value, found.sigma);
    assert!(found.sigma < 0.01 * true_s && (found.value - true_s).abs() < 5.0 * found.sigma);
}

#[test]
fn the_measured_radius_gives_the_scale_to_a_thousandth() {
    let place = Rig::new();
    let config = rig(&place, &README.scenario(), "ball_diameter_mm = 63.25");
    let world = truth_world(&config).unwrap().unwrap();
    let rows = rows_of(&world, &config.text);
    let radii: Vec<f64> = rows.tracks.iter().filter_map(|row| row.radius_px).collect();
    let mean = radii.iter().sum::<f64>() / radii.len() as f64;
    let off = 2.0 * mean / README.ball_px - 1.0;
    println!("{} radii, {mean:.3} px, {:.3} %", radii.len(), 100.0 * off);
    assert!(radii.len() > 20 && off.abs() < 1e-3);
}

/// The predicted scatter of the normal speed and of the spin in flight, for speckles of this diameter and coverage.
fn scatter(diameter_px: f64, coverage: f64) -> [f64; 2] {
    let place = Rig::new();
    let mut scenario = README.scenario();
    let area_px2 = std::f64::consts::FRAC_PI_4 * diameter_px.powi(2);
    let (area_min_px2, area_max_px2) = (0.8 * area_px2, 1.2 * area_px2);
    scenario.body.pattern = PatternSetup { area_min_px2, area_max_px2, coverage, ..scenario.body.pattern };
    let expected = predict(&rig(&place, &scenario, &format!("mm_per_px = {}", README.mm_per_px()))).unwrap();
    let sigma = |name: &str| expected.iter().find(|found| found.name == name).unwrap().sigma;
    [sigma("flight.vn_m_s"), sigma("flight.omega_rad_s")]
}

#[test]
fn speckles_of_3_to_5_px_over_half_of_the_ball_have_the_smallest_scatter() {
    let best = scatter(4.0, 0.5);
    let spin = |diameter_px: f64, coverage: f64| {
        let scatter = scatter(diameter_px, coverage);
        let ratio = [0, 1].map(|k| scatter[k] / best[k]);
        println!("{diameter_px} px, {coverage}: speed {:.2}, spin {:.2} times that at 4 px, 0.5", ratio[0], ratio[1]);
        ratio[1]
    };
    // Smaller speckles are blurred by the lens, and larger ones have fewer edges.
    assert!(spin(3.0, 0.5) < 1.15 && spin(5.0, 0.5) < 1.15);
    assert!(spin(2.0, 0.5) > 1.3 && spin(10.0, 0.5) > 1.1);
    assert!(spin(4.0, 0.3) < 1.15 && spin(4.0, 0.1) > 1.4);
}
