//! The time from a contact to its published numbers, by the clock.

use crate::support::{Listener, Rig, ricochet};
use std::time::Instant;

/// Films for each number of workers.
const FILMS: usize = 7;

/// Writes the rig file of a film.
type Film = fn(&Rig) -> String;

/// A soft ball at a frame rate that two processors keep up with: contact lasts 20 ms of 80, 40 of 160 frames.
const SOFT: &str = r#"
name = "soft"
seed = 5
[camera]
width_px = 256
height_px = 256
frame_rate_hz = 2000.0
exposure_us = 100.0
frames = 160
noise_dn = 2.0
[scale]
mm_per_px = 0.6
[surface]
angle_deg = 0.0
[body]
diameter_mm = 60.0
[body.pattern]
area_min_px2 = 4.0
area_max_px2 = 20.0
coverage = 0.4
[shade]
ball = 0.75
speckle = 0.2
ground = 0.12
[occluder]
shade = 0.4
[motion]
kind = "impact"
contact_start_s = 25e-3
contact_center_px = [128.3, 170.6]
vn_m_s = -1.5
vt_m_s = 0.4
omega_rad_s = 5.0
gravity_m_s2 = [0.0, -9.81]
mass_kg = 0.14
inertia_factor = 0.4
[motion.law]
kind = "kelvin-voigt"
stiffness_n_m = 3.4e3
damping_n_s_m = 3.0
"#;

/// The rig of the lacrosse ball in real time: 10 000 frames per second are far more than two processors can measure.
fn lacrosse(rig: &Rig) -> String {
    include_str!("../../config/lacrosse.toml")
        .replace("name = \"lacrosse\"", &format!("name = \"{}\"", rig.name))
        .replace("paced = false", "paced = true")
        .replace("\"shots\"", &format!("\"{}\"", rig.path("shots").display()))
}

fn soft(rig: &Rig) -> String {
    let scenario = rig.file("soft.toml", SOFT);
    lacrosse(rig)
        .replace("scenario = \"lacrosse\"", &format!("scenario = \"{}\"", scenario.display()))
        .replace("exposure_us = 20", "exposure_us = 100")
        .replace("frame_rate_hz = 10000", "frame_rate_hz = 2000")
        .replace("mm_per_px = 0.5142", "mm_per_px = 0.6")
        .replace("diameter_mm = 63.25", "diameter_mm = 60")
        .replace("gravity_angle_deg = -71", "gravity_angle_deg = -90")
}

/// Milliseconds from the end of a contact to the first and to the last time that its numbers are published.
fn latency_ms(film: Film, workers: u32) -> [f64; 2] {
    let rig = Rig::new();
    let config = rig.file("rig.toml", &film(&rig).replace("[workers]", &format!("[workers]\ncount = {workers}")));
    let (events, impacts) = (Listener::start("events", &rig.name), Listener::start("impact", &rig.name));
    let ended = ricochet(["run".as_ref(), config.as_os_str()]).output().unwrap();
    assert_eq!(ended.status.code(), Some(0), "{}", String::from_utf8_lossy(&ended.stderr));
    let (events, impacts) = (events.end(), impacts.end());
    let started = events.iter().find(|(_, event)| event["kind"] == "started").unwrap().0;
    let after = |(came, impact): &(Instant, serde_json::Value)| {
        1e3 * ((*came - started).as_secs_f64() - impact["end_s"].as_f64().unwrap())
    };
    assert!(impacts.iter().all(|(_, impact)| impact["status"] == "valid"), "{impacts:?}");
    let latencies: Vec<f64> = impacts.iter().map(after).collect();
    println!("    after {latencies:.0?} ms");
    [latencies[0], latencies[latencies.len() - 1]]
}

#[test]
#[ignore = "a measurement, to be run alone: cargo test --release --test it result_latency -- --ignored --nocapture"]
fn time_from_the_end_of_a_contact_to_its_numbers_is_printed() {
    let films: [(&str, Film); 2] = [("2000 frames/s", soft), ("10 000 frames/s", lacrosse)];
    for ((name, film), workers) in films.into_iter().flat_map(|film| [1, 2].map(|workers| (film, workers))) {
        let latencies: Vec<[f64; 2]> = (0..FILMS).map(|_| latency_ms(film, workers)).collect();
        for (k, which) in ["first", "last"].into_iter().enumerate() {
            let mut latencies: Vec<f64> = latencies.iter().map(|latency| latency[k]).collect();
            latencies.sort_by(f64::total_cmp);
            let (min, middle, max) = (latencies[0], latencies[FILMS / 2], latencies[FILMS - 1]);
            println!(
                "{name}, {workers} workers: {which} {middle:.0} ms after the end of contact ({min:.0} to {max:.0})"
            );
        }
    }
}
