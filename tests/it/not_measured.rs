//! `analyze` says for each body in how many frames it was measured, and why not in the others.

use crate::support::{Rig, run, succeed};
use serde_json::Value;
use std::path::PathBuf;
use std::process::Output;

/// A film of a ball of radius 36 px and this rig file.
fn film_and_rig(rig: &Rig, rig_file: &str) -> [PathBuf; 2] {
    let (scenario, film) = (rig.file("drift.toml", &crate::pipeline::drift(24, 1000.0)), rig.path("film.mcap"));
    succeed(["simulate".as_ref(), scenario.as_os_str(), "-o".as_ref(), film.as_os_str()]);
    [film, rig.file("described.toml", rig_file)]
}

fn analyze(rig: &Rig, [film, config]: &[PathBuf; 2], more: &[&str]) -> Output {
    let output = rig.path("results.mcap");
    let _ = std::fs::remove_file(&output);
    let mut words = vec!["analyze", film.to_str().unwrap(), "--config", config.to_str().unwrap(), "-o"];
    words.push(output.to_str().unwrap());
    run(words.into_iter().chain(more.iter().copied()))
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

#[test]
fn a_film_in_which_nothing_can_be_measured_ends_with_7_and_one_line_with_reason_and_key() {
    let rig = Rig::new();
    let inputs = film_and_rig(&rig, "[scale]\nmm_per_px = 0.5\n[[body]]\nmin_radius_px = 7\nmax_radius_px = 9\n");
    let output = analyze(&rig, &inputs, &[]);
    assert_eq!(output.status.code(), Some(7), "{output:?}");
    assert_eq!(
        stderr(&output),
        "ball: 0 of 24 frames measured; most frequent reason: no outline of a ball was found (24 frames), first at \
         frame 0; set body.min_radius_px (now 7) or body.max_radius_px (now 9) or body.roi_px (now the whole image)\n"
    );
    let output = analyze(&rig, &inputs, &["--json"]);
    assert_eq!((output.status.code(), stderr(&output).as_str()), (Some(7), ""));
    let printed: Value = serde_json::from_slice(&output.stdout).unwrap();
    let body = &printed["bodies"][0];
    assert_eq!((&body["body"], &body["frames"], &body["measured"]), (&"ball".into(), &24.into(), &0.into()));
    assert_eq!(
        (&body["status"], &body["first_frame"], &body["reason_frames"]),
        (&"lost".into(), &0.into(), &24.into())
    );
    assert_eq!(body["keys"], serde_json::json!(["body.min_radius_px", "body.max_radius_px", "body.roi_px"]));
}

#[test]
fn one_body_that_is_measured_is_enough_for_success_and_each_has_its_line() {
    let rig = Rig::new();
    let other = "[[body]]\nname = \"none\"\nmin_radius_px = 6\nmax_radius_px = 8\n";
    let inputs = film_and_rig(&rig, &format!("[[body]]\nname = \"ball\"\n{other}"));
    let output = analyze(&rig, &inputs, &[]);
    let lines = stderr(&output);
    assert_eq!(output.status.code(), Some(0), "{lines}");
    let lines: Vec<&str> = lines.lines().collect();
    assert_eq!((lines.len(), lines[0]), (2, "ball: 24 of 24 frames measured"));
    assert!(lines[1].starts_with("none: 0 of 24 frames measured; most frequent reason: "), "{}", lines[1]);
}

#[test]
fn a_rig_file_of_five_lines_measures_a_film_and_does_not_run() {
    let rig = Rig::new();
    let five = "[scale]\nball_diameter_mm = 36\n[[body]]\nmin_radius_px = 25\nmass_kg = 0.1\n";
    let inputs = film_and_rig(&rig, five);
    let output = analyze(&rig, &inputs, &[]);
    assert_eq!((output.status.code(), stderr(&output).as_str()), (Some(0), "ball: 24 of 24 frames measured\n"));
    let refused = run(["run", inputs[1].to_str().unwrap()]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(stderr(&refused).contains("camera.source is missing: must be \"simulated\""), "{}", stderr(&refused));
}
