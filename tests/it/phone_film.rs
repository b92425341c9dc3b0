//! A film as a phone takes it, from the file to the numbers and the page in three commands.

use crate::support::{Rig, frames, is_required, run, succeed};
use serde_json::Value;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

/// A speckled ball of 60 px that falls on a level floor and bounces once, filmed with 240 frames/s in 720p.
const DROP: &str = r#"
name = "phone"
seed = 5
[camera]
width_px = 1280
height_px = 720
frame_rate_hz = 240.0
exposure_us = 800.0
frames = 58
bits = 8
noise_dn = 2.0
blur_px = 0.9
[scale]
mm_per_px = 1.0542
[surface]
angle_deg = 0.0
[body]
diameter_mm = 63.25
shape = "sphere"
[body.pattern]
area_min_px2 = 8.0
area_max_px2 = 40.0
coverage = 0.3
[shade]
ball = 0.75
speckle = 0.15
ground = 0.15
ground_texture = 0.03
[light]
side = 0.15
side_angle_deg = 60.0
vignette = 0.15
[occluder]
shade = 0.35
[motion]
kind = "impact"
contact_start_s = 0.1191
contact_center_px = [655.3, 487.6]
vn_m_s = -1.6
vt_m_s = 0.3
omega_rad_s = 3.0
gravity_m_s2 = [0.0, -9.80665]
mass_kg = 0.14566
inertia_factor = 0.4
[motion.law]
kind = "kelvin-voigt"
stiffness_n_m = 2.0e5
damping_n_s_m = 25.0
[motion.friction]
stiffness_n_m = 1e5
damping_n_s_m = 20.0
coefficient = 0.1
"#;

/// Whether ffmpeg with H.264 is installed, which `RICOCHET_REQUIRE_FFMPEG` demands.
pub fn has_ffmpeg() -> bool {
    let listed = Command::new("ffmpeg").args(["-v", "error", "-encoders"]).output();
    let has = listed.is_ok_and(|listed| String::from_utf8_lossy(&listed.stdout).contains("libx264"));
    assert!(has || !is_required("FFMPEG"), "ffmpeg with libx264 is required but not installed");
    if !has {
        eprintln!("left out: ffmpeg with libx264 is not installed");
    }
    has
}

/// Encodes frames as a phone does: H.264 in colour that plays at 30 frames/s.
fn encode(recording: &Path, to: &Path) {
    let frames = frames(recording);
    let size = format!("{}x{}", frames[0].0.width_px, frames[0].0.height_px);
    let mut ffmpeg = Command::new("ffmpeg")
        .args(["-v", "error", "-f", "rawvideo", "-pixel_format", "gray", "-video_size", &size, "-framerate", "30"])
        .args(["-i", "pipe:0", "-c:v", "libx264", "-crf", "20", "-pix_fmt", "yuv420p", "-threads", "1"])
        .arg(to)
        .stdin(Stdio::piped())
        .spawn()
        .unwrap();
    let mut pipe = ffmpeg.stdin.take().unwrap();
    frames.iter().for_each(|(_, bytes)| pipe.write_all(bytes).unwrap());
    drop(pipe);
    assert!(ffmpeg.wait().unwrap().success());
}

/// Draws the film and returns the true restitution.
fn film(rig: &Rig) -> f64 {
    let (scenario, drawn) = (rig.file("phone.toml", DROP), rig.path("drawn.mcap"));
    succeed(["simulate".as_ref(), scenario.as_os_str(), "-o".as_ref(), drawn.as_os_str()]);
    encode(&drawn, &rig.path("phone.mp4"));
    let table = crate::support::csv(&drawn, "truth_impact");
    let (names, row) = table.split_once('\n').unwrap();
    let column = names.split(',').position(|name| name == "restitution").unwrap();
    row.lines().next().unwrap().split(',').nth(column).unwrap().parse().unwrap()
}

fn word(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn a_phone_film_becomes_a_number_and_a_page_in_three_commands() {
    if !has_ffmpeg() {
        return;
    }
    let rig = Rig::new();
    let restitution = film(&rig);
    let [film, config, results, page] =
        ["phone.mp4", "rig.toml", "results.mcap", "page.html"].map(|name| rig.path(name));
    let began = std::time::Instant::now();
    let proposed =
        succeed(["setup", word(&film), "--fps", "240", "--diameter-mm", "63.25", "-o", word(&config), "--json"]);
    let proposed: Value = serde_json::from_str(&proposed).unwrap();
    println!("{proposed}");
    let text = std::fs::read_to_string(&config).unwrap();
    println!("{text}");
    for line in ["ball_diameter_mm = 63.25", "angle_deg = 0\n", "kind = \"ball\"", "m/s^2 downwards, as it should be"] {
        assert!(text.contains(line), "{line}");
    }
    assert!(text.parse::<toml_edit::DocumentMut>().is_ok());
    assert_eq!(proposed["warnings"], serde_json::json!([]));
    let measured =
        succeed(["analyze", word(&film), "--fps", "240", "--config", word(&config), "-o", word(&results), "--json"]);
    let measured: Value = serde_json::from_str(&measured).unwrap();
    let impact = &measured["impacts"][0];
    let found = impact["restitution"].as_f64().unwrap();
    println!(
        "restitution {found:.4} +- {:.4}, true {restitution:.4}; {}",
        impact["sigma_restitution"].as_f64().unwrap(),
        measured["bodies"][0]["line"]
    );
    assert!((found - restitution).abs() < 0.01, "{found} for {restitution}");
    succeed(["report", word(&results), "--film", word(&film), "-o", word(&page)]);
    assert!(std::fs::read_to_string(page).unwrap().contains("Restitution"));
    println!("three commands and no question, {:.1} s", began.elapsed().as_secs_f64());
}

/// The least step that an encoder hides, px.
const HIDDEN_PX: f64 = 0.1;

#[test]
fn steps_of_a_compressed_film_are_no_more_certain_than_its_encoder_leaves_them() {
    if !has_ffmpeg() {
        return;
    }
    let rig = Rig::new();
    film(&rig);
    let [film, config, imported] = ["phone.mp4", "rig.toml", "imported.mcap"].map(|name| rig.path(name));
    succeed(["setup", word(&film), "--fps", "240", "--diameter-mm", "63.25", "-o", word(&config)]);
    succeed(["import", word(&film), "--fps", "240", "-o", word(&imported)]);
    let measure = |film: &Path, name: &str, more: &[&str]| {
        let results = rig.path(name);
        succeed([&["analyze", word(film), "--config", word(&config), "-o", word(&results)], more].concat());
        crate::support::csv(&results, "velocity")
    };
    let table = measure(&film, "of-film.mcap", &["--fps", "240"]);
    assert_eq!(table, measure(&imported, "of-recording.mcap", &[]), "the recording keeps the codec");
    let raw = measure(&rig.path("drawn.mcap"), "of-drawn.mcap", &[]);
    let sigmas = |table: &str| -> Vec<f64> {
        let mut reader = csv::Reader::from_reader(table.as_bytes());
        let column = reader.headers().unwrap().iter().position(|name| name == "sigma_dx_px").unwrap();
        reader.records().filter_map(|row| row.unwrap()[column].parse().ok()).collect()
    };
    let (film, raw) = (sigmas(&table), sigmas(&raw));
    assert!(film.len() > 40 && film.iter().all(|sigma| *sigma >= HIDDEN_PX), "{film:?}");
    assert!(raw.len() > 40 && raw.iter().any(|sigma| *sigma < 0.2 * HIDDEN_PX), "{raw:?}");
}

#[test]
fn a_film_that_plays_slower_than_it_was_taken_is_warned_of_by_its_gravity() {
    if !has_ffmpeg() {
        return;
    }
    let rig = Rig::new();
    film(&rig);
    let (film, config) = (rig.path("phone.mp4"), rig.path("rig.toml"));
    let output = run(["setup", word(&film), "--diameter-mm", "63.25", "-o", word(&config)]);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{stderr}");
    let needed = stderr.split("the film was taken at about ").nth(1).unwrap().split(' ').next().unwrap();
    let needed: f64 = needed.parse().unwrap();
    assert!((needed - 240.0).abs() < 12.0, "{stderr}");
}

#[test]
fn what_is_missing_is_named_and_nothing_is_overwritten() {
    let rig = Rig::new();
    let (scenario, film) = (rig.file("drift.toml", &crate::pipeline::drift(30, 1000.0)), rig.path("film.mcap"));
    succeed(["simulate".as_ref(), scenario.as_os_str(), "-o".as_ref(), film.as_os_str()]);
    let config = rig.path("rig.toml");
    let output = run(["setup", word(&film), "-o", word(&config)]);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("written without a scale: pass --diameter-mm"), "{stderr}");
    let text = std::fs::read_to_string(&config).unwrap();
    assert!(text.contains("# ball_diameter_mm = ") && rig.path("rig.png").exists(), "{text}");
    let again = run(["setup", word(&film), "--diameter-mm", "36", "-o", word(&config)]);
    let stderr = String::from_utf8(again.stderr).unwrap();
    assert!(
        again.status.code() == Some(2) && stderr.contains("already exists") && stderr.contains("--force"),
        "{stderr}"
    );
    assert_eq!(std::fs::read_to_string(&config).unwrap(), text);
    let printed = succeed(["setup", word(&film), "--diameter-mm", "36", "-o", word(&config), "--force"]);
    // The scenario has 0.5 mm per pixel.
    let scale = printed.lines().find(|line| line.starts_with("scale")).unwrap();
    let mm_per_px: f64 = scale.split_whitespace().nth(1).unwrap().parse().unwrap();
    assert!((mm_per_px - 0.5).abs() < 0.005, "{printed}");
}

#[test]
fn a_film_in_which_nothing_moves_gets_no_rig_file() {
    let rig = Rig::new();
    let still = crate::pipeline::drift(30, 1000.0).replace("vx_px_frame = 0.5333333333333333", "vx_px_frame = 0.0");
    let (scenario, film) = (rig.file("still.toml", &still), rig.path("film.mcap"));
    succeed(["simulate".as_ref(), scenario.as_os_str(), "-o".as_ref(), film.as_os_str()]);
    let config = rig.path("rig.toml");
    let output = run(["setup", word(&film), "--diameter-mm", "36", "-o", word(&config)]);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!((output.status.code(), config.exists()), (Some(7), false), "{stderr}");
    assert!(stderr.contains("nothing moves in this film"), "{stderr}");
}

#[test]
fn a_film_has_the_date_that_it_states_or_none() {
    if !has_ffmpeg() {
        return;
    }
    let rig = Rig::new();
    film(&rig);
    let plain = rig.path("phone.mp4");
    for (name, date) in [("dated", "2024-05-01T12:00:00"), ("unset", "1970-01-01T00:00:00")] {
        let [film, config, results, page] =
            ["mp4", "toml", "mcap", "html"].map(|ending| rig.path(&format!("{name}.{ending}")));
        let tag = format!("creation_time={date}Z");
        let copied = Command::new("ffmpeg")
            .args(["-v", "error", "-i", word(&plain), "-c", "copy", "-metadata", &tag, word(&film)])
            .status()
            .unwrap();
        assert!(copied.success());
        succeed(["setup", word(&film), "--fps", "240", "--diameter-mm", "63.25", "-o", word(&config)]);
        succeed(["analyze", word(&film), "--fps", "240", "--config", word(&config), "-o", word(&results)]);
        succeed(["report", word(&results), "--film", word(&film), "-o", word(&page)]);
        let (info, page) = (succeed(["info", word(&results)]), std::fs::read_to_string(page).unwrap());
        let is_dated = name == "dated";
        assert_eq!(info.contains("2024-05-01 12:00:00"), is_dated, "{info}");
        assert_eq!(info.contains("date unknown"), !is_dated, "{info}");
        assert_eq!(page.contains("2024-05-01 12:00:00"), is_dated);
        assert!(!info.contains("1970") && !page.contains("1970"), "{info}");
    }
}
