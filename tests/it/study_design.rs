//! `ricochet study design`: its predictions against films of the same rig.

use crate::measured_world::rows_of;
use crate::support::{Rig, run, succeed};
use ricochet::config::{BodyKind, Config};
use ricochet::process::truth_world;
use ricochet::study::design::{Expected, predict, spread};
use ricochet::synth::{LightSetup, MotionSetup, PatternSetup, Scenario};
use ricochet::track::TrackerRows;
use serde_json::Value;

/// The scatter over films of the rig, each drawn with its own noise and measured like any film.
fn measured_scatter(config: &Config, films: u64) -> Vec<Expected> {
    let world = truth_world(config).unwrap().unwrap();
    let motion: MotionSetup = world.scenario().motion.clone();
    let measure = |take| rows_of(&world.retake(motion.clone(), take).unwrap(), &config.text);
    let films: Vec<TrackerRows> = std::thread::scope(|scope| {
        let half = |first| scope.spawn(move || (first..films).step_by(2).map(measure).collect::<Vec<_>>());
        let halves = [half(0), half(1)];
        halves.into_iter().flat_map(|half| half.join().unwrap()).collect()
    });
    let truth: Vec<_> = (0..world.frames()).map(|index| world.truth(index)).collect();
    let kind = if world.scenario().body.rod.is_some() { BodyKind::Rod } else { BodyKind::Ball };
    spread(&truth, world.impact().as_ref(), &films, kind)
}

/// The predicted scatter over the measured one, by name.
fn ratios(config: &Config, films: u64) -> Vec<(String, f64)> {
    let predicted = predict(config).unwrap();
    let measured_scatter = measured_scatter(config, films);
    let ratio = |expected: &Expected| {
        let found = measured_scatter.iter().find(|found| found.name == expected.name)?;
        let ratio = expected.sigma / found.sigma;
        eprintln!(
            "{:24} predicted {:.3e} shown {:.3e} {} ratio {ratio:.3}; mean error predicted {:.3e} shown {:.3e}",
            expected.name, expected.sigma, found.sigma, expected.unit, expected.offset, found.offset
        );
        Some((expected.name.clone(), ratio))
    };
    predicted.iter().filter_map(ratio).collect()
}

/// A rig that records this scenario.
fn rig(place: &Rig, scenario: &Scenario, more: &str) -> Config {
    let path = place.path("scenario.toml");
    std::fs::write(&path, toml::to_string(scenario).unwrap()).unwrap();
    let text = format!(
        "[rig]\nname = \"design\"\n[camera]\nsource = \"simulated\"\nscenario = {:?}\npaced = false\n\
         [scale]\nmm_per_px = {}\n[surface]\nangle_deg = {}\n[[body]]\nname = \"ball\"\nkind = \"ball\"\n\
         diameter_mm = {}\n{more}",
        path.to_str().unwrap(),
        scenario.scale.mm_per_px,
        scenario.surface.angle_deg,
        scenario.body.diameter_mm
    );
    Config::parse(&text, "rig.toml").unwrap()
}

/// Checks that the scatter of these numbers is within 20 % of the prediction, plus the error of a scatter over so many
/// films, 1 in sqrt(2 films).
fn check_numbers(config: &Config, films: u64, names: &[&str]) {
    let ratios = ratios(config, films);
    for name in names {
        let ratio = ratios.iter().find(|(known, _)| known == name).unwrap_or_else(|| panic!("no {name}")).1;
        assert!((1.0 / 1.2..1.0 / 0.8).contains(&ratio), "{name}: {ratio}");
    }
}

/// Checks every predicted number, `count` of them, against 240 films.
fn check_every_number(config: &Config, count: usize) {
    let ratios = ratios(config, 240);
    assert_eq!(ratios.len(), count, "{ratios:?}");
    for (name, ratio) in ratios {
        assert!((1.0 / 1.2..1.0 / 0.8).contains(&ratio), "{name}: {ratio}");
    }
}

/// A small ball of 80 px with few speckles and much noise, 12 bits, that flies past, measured with a wide velocity
/// window.
fn passing() -> Scenario {
    let mut scenario = Scenario::translation(0.0, 0.0, 0.0);
    let camera = &mut scenario.camera;
    (camera.width_px, camera.height_px, camera.frames, camera.frame_rate_hz) = (176, 144, 64, 2000.0);
    (camera.bits, camera.noise_dn, camera.shot_share, camera.exposure_us) = (12, 90.0, 0.3, 60.0);
    scenario.body.diameter_mm = 40.0;
    scenario.body.pattern = PatternSetup::paper("b-I").unwrap();
    scenario.motion =
        MotionSetup::Constant { vx_px_frame: 0.77, vy_px_frame: -0.13, omega_deg_frame: 0.37, start_px: [62.3, 77.6] };
    scenario
}

/// A ball of 100 px with fine speckles and little noise that strikes a flat, at velocities off every grid.
fn striking() -> Scenario {
    let mut scenario = Scenario::built_in("lacrosse").unwrap();
    (scenario.camera.width_px, scenario.camera.height_px, scenario.camera.frames) = (176, 160, 88);
    scenario.camera.noise_dn = 3.0;
    scenario.scale.mm_per_px = 0.6325;
    scenario.body.pattern = PatternSetup::paper("a-III").unwrap();
    scenario.light = LightSetup::default();
    let MotionSetup::Impact(impact) = &mut scenario.motion else { panic!("an impact") };
    (impact.contact_center_px, impact.vn_m_s, impact.vt_m_s) = ([86.3, 86.6], -1.73, 0.41);
    scenario
}

#[test]
fn scatter_of_a_passing_ball_is_predicted_within_20_percent() {
    let place = Rig::new();
    let config = rig(&place, &passing(), "[velocity]\nwindow_frames = 15\ngravity_m_s2 = 0\n");
    check_numbers(&config, 60, &["motion.vn_m_s", "motion.vt_m_s", "motion.omega_rad_s"]);
}

#[test]
fn scatter_of_an_impact_is_predicted_within_20_percent() {
    let place = Rig::new();
    let config = rig(&place, &striking(), "[velocity]\ngravity_angle_deg = -71\n");
    let names = [
        "flight.vn_m_s",
        "flight.vt_m_s",
        "flight.omega_rad_s",
        "contact.vn_m_s",
        "contact.omega_rad_s",
        "rebound.vn_m_s",
        "rebound.omega_rad_s",
        "start_s",
        "end_s",
        "restitution",
    ];
    check_numbers(&config, 60, &names);
}

#[test]
fn scatter_of_a_ball_measured_by_its_field_is_predicted_within_20_percent() {
    let place = Rig::new();
    let more = "[rotation]\nmethod = \"field\"\n[velocity]\nwindow_frames = 15\ngravity_m_s2 = 0\n";
    let config = rig(&place, &passing(), more);
    check_numbers(&config, 60, &["motion.vn_m_s", "motion.vt_m_s", "motion.omega_rad_s"]);
}

#[test]
#[ignore = "takes minutes"]
fn scatter_of_every_number_of_a_rod_impact_is_predicted_within_20_percent() {
    let text = include_str!("../../config/rod.toml");
    let config = Config::parse(text, "rod.toml").unwrap();
    check_every_number(&config, 22);
}

#[test]
#[ignore = "takes minutes"]
fn scatter_of_every_number_of_a_ball_impact_is_predicted_within_20_percent() {
    let place = Rig::new();
    let config = rig(&place, &striking(), "[velocity]\ngravity_angle_deg = -71\n");
    check_every_number(&config, 27);
}

fn design(config: &Config, place: &Rig, more: &[&str]) -> Value {
    let path = place.path("rig.toml");
    std::fs::write(&path, &config.text).unwrap();
    let line = ["study", "design", "--json", "--config", path.to_str().unwrap()];
    serde_json::from_str(&succeed(line.iter().chain(more))).unwrap()
}

fn sigma(report: &Value, name: &str) -> f64 {
    let rows = report["expected"].as_array().unwrap();
    rows.iter().find(|row| row["name"] == name).unwrap()["sigma"].as_f64().unwrap()
}

#[test]
fn twice_the_noise_doubles_the_scatter_and_changes_are_listed_best_first() {
    let place = Rig::new();
    let mut scenario = passing();
    // Far more noise costs more than its proportion, because the error of a renewed reference grows with the square of
    // the noise.
    (scenario.camera.frames, scenario.camera.noise_dn) = (24, 30.0);
    let config = rig(&place, &scenario, "[velocity]\nwindow_frames = 9\n");
    let tables = place.path("made/tables");
    let (plain, noisy) = (
        design(&config, &place, &["-o", tables.to_str().unwrap()]),
        design(&config, &place, &["--noise-dn", "60", "--no-advice"]),
    );
    for name in ["motion.vn_m_s", "motion.omega_rad_s"] {
        let ratio = sigma(&noisy, name) / sigma(&plain, name);
        assert!((1.9..2.1).contains(&ratio), "{name}: {ratio}");
    }
    let advice = plain["advice"].as_array().unwrap();
    let left: Vec<f64> = advice.iter().map(|advice| advice["mean_share"].as_f64().unwrap()).collect();
    assert!(left.is_sorted() && left.len() >= 8, "{left:?}");
    let change = |word: &str| {
        let of = |advice: &&Value| advice["change"].as_str().unwrap().contains(word);
        advice.iter().find(of).unwrap()["mean_share"].as_f64().unwrap()
    };
    assert!((change("half the noise") - 0.5).abs() < 0.05, "{}", change("half the noise"));
    assert!(change("contrast") < 0.95);
    assert_eq!(noisy["advice"].as_array().unwrap().len(), 0);
    // The tables hold the printed values.
    let rows =
        |name: &str| csv::Reader::from_path(tables.join(name)).unwrap().into_records().map(Result::unwrap).collect();
    let (numbers, changes): (Vec<csv::StringRecord>, Vec<csv::StringRecord>) =
        (rows("design.csv"), rows("design_advice.csv"));
    assert_eq!((numbers.len(), changes.len()), (plain["expected"].as_array().unwrap().len(), advice.len()));
    for (row, expected) in numbers.iter().zip(plain["expected"].as_array().unwrap()) {
        assert_eq!((&row[0], row[3].parse().ok()), (expected["name"].as_str().unwrap(), expected["sigma"].as_f64()));
    }
    assert_eq!(&changes[0][0], advice[0]["change"].as_str().unwrap());
}

#[test]
fn rigs_that_cannot_record_or_follow_are_refused_in_one_line() {
    let place = Rig::new();
    let refused = |config: &Config, edit: &dyn Fn(String) -> String, more: &[&str]| {
        let path = place.path("rig.toml");
        std::fs::write(&path, edit(config.text.clone())).unwrap();
        let line = ["study", "design", "--no-advice", "--config", path.to_str().unwrap()];
        let output = run(line.iter().chain(more));
        let report = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success() && output.stdout.is_empty(), "{report}");
        assert_eq!(report.trim().lines().count(), 1, "{report}");
        report
    };
    let plain = rig(&place, &passing(), "");
    let genicam = "[camera]\nsource = \"genicam\"\nid = \"a\"\nwidth_px = 100\nheight_px = 100\nframe_rate_hz = 1000\n";
    let large = refused(&plain, &|_| format!("{genicam}[scale]\nmm_per_px = 0.2\n[[body]]\ndiameter_mm = 40\n"), &[]);
    assert!(large.contains("larger than the picture of 100 x 100 px"), "{large}");
    let bare = refused(&plain, &|_| genicam.to_owned(), &[]);
    assert!(bare.contains("scale.mm_per_px is needed"), "{bare}");
    let long = refused(&plain, &|text| text.replace("paced", "exposure_us = 600\npaced"), &[]);
    assert!(long.contains("camera.exposure_us = 600 is out of range"), "{long}");
    let slow = format!("{}[scale]\nmm_per_px = 1\n[[body]]\ndiameter_mm = 40\n", genicam.replace("1000", "100"));
    let far = refused(&plain, &|_| slow.clone(), &[]);
    assert!(far.contains("px from frame to frame"), "{far}");
    let blurred = slow.replace("frame_rate_hz = 100", "frame_rate_hz = 100\nexposure_us = 9000");
    let blur = refused(&plain, &|_| blurred.clone(), &[]);
    assert!(blur.contains("more than a quarter of its radius: expose for at most"), "{blur}");
    let filmed = refused(&plain, &|_| "[camera]\nsource = \"recording\"\nid = \"a.mcap\"\n".into(), &[]);
    assert!(filmed.contains("`ricochet analyze`"), "{filmed}");
    let rod = refused(&plain, &|text| text, &["--scenario", "rod"]);
    assert!(rod.contains("scenario \"rod\" films a rod"), "{rod}");
    let body = "[[body]]\nkind = \"patch\"\npolygon_px = [[80, 96], [123, 50], [166, 96]]\n";
    let drawn = |text: String| format!("{}{body}", text.split("[[body]]").next().unwrap());
    let patch = refused(&plain, &drawn, &[]);
    assert!(patch.contains("is a patch"), "{patch}");
    let noise = refused(&plain, &|text| text, &["--noise-dn=-1"]);
    assert!(noise.contains("--noise-dn"), "{noise}");
}
