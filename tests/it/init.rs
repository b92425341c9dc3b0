//! `ricochet init`: answers become a rig file that is accepted.

use crate::support::{Rig, ricochet};
use ricochet::config::{BodyKind, Config, Source};
use std::io::Write;
use std::process::{Output, Stdio};

/// Answers the questions with these lines.
fn answered(rig: &Rig, options: &[&str], lines: &str) -> Output {
    let mut command = ricochet(["init", "-o"]);
    command.arg(rig.path("rig.toml")).args(options);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    // The program may refuse before it has read all answers.
    let _ = child.stdin.take().unwrap().write_all(lines.as_bytes());
    child.wait_with_output().unwrap()
}

fn written(rig: &Rig) -> (String, Config) {
    let path = rig.path("rig.toml");
    (std::fs::read_to_string(&path).unwrap(), Config::load(&path).unwrap())
}

#[test]
fn five_answers_make_a_rig() {
    let rig = Rig::new();
    let output = answered(&rig, &["--camera", "simulated"], "ball\n63,25\n-3.5\nshots\n");
    assert!(output.status.success(), "{output:?}");
    let (text, config) = written(&rig);
    assert_eq!(config.camera.source, Some(Source::Simulated));
    assert_eq!(config.surface.angle_deg, -3.5);
    assert!(text.contains("ball_diameter_mm = 63.25"), "a decimal comma is understood:\n{text}");
    assert!(text.contains("# The true diameter of the ball."), "{text}");
}

#[test]
fn a_wrong_answer_is_asked_again_with_its_range() {
    let rig = Rig::new();
    let output = answered(&rig, &["--camera", "simulated", "--directory", "-"], "cube\nball\n-4\n40\n\n");
    assert!(output.status.success(), "{output:?}");
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("must be ball, rod or patch"), "{said}");
    assert!(said.contains("-4: must be above 0 and at most 10000 mm"), "{said}");
    assert!(written(&rig).1.record.is_none());
}

#[test]
fn each_kind_of_camera_and_body_is_accepted() {
    for (camera, source) in
        [("/dev/video7", Source::V4l2), ("10.0.0.9", Source::Genicam), ("simulated", Source::Simulated)]
    {
        for (body, kind) in [("ball", BodyKind::Ball), ("rod", BodyKind::Rod), ("patch", BodyKind::Patch)] {
            let rig = Rig::new();
            let options = ["--camera", camera, "--body", body, "--size", "800x600", "--fps", "1000", "--defaults"];
            let output = answered(&rig, &options, "");
            assert!(output.status.success(), "{camera} {body}: {output:?}");
            let config = written(&rig).1;
            assert_eq!((config.camera.source, config.bodies[0].kind), (Some(source), kind));
        }
    }
}

#[test]
fn a_file_is_kept_and_an_early_end_writes_none() {
    let rig = Rig::new();
    let output = answered(&rig, &["--camera", "simulated"], "ball\n");
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8(output.stderr).unwrap().contains("standard input ended before the answer"));
    assert!(!rig.path("rig.toml").exists());
    rig.file("rig.toml", "mine");
    assert_eq!(answered(&rig, &["--defaults"], "").status.code(), Some(2));
    assert_eq!(std::fs::read_to_string(rig.path("rig.toml")).unwrap(), "mine");
    assert!(answered(&rig, &["--defaults", "--force"], "").status.success());
}
