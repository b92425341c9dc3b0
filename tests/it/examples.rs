//! The examples print the numbers of a recording and of a running rig.

use crate::support::{Background, Rig, ricochet, succeed};
use ricochet::recording::Recording;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The program of an example, built together with the tests by `cargo test`.
fn example(name: &str) -> Command {
    let tests = std::env::current_exe().unwrap();
    let built = tests.parent().and_then(Path::parent).unwrap().join("examples").join(name);
    assert!(built.exists(), "{} does not exist: run cargo test --release once", built.display());
    Command::new(built)
}

fn script(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("examples").join(name)
}

/// Python with the modules of a script, or a message that the test was left out.
fn python(script_name: &str, modules: &str) -> Option<Command> {
    let importable = Command::new("python3").args(["-c", &format!("import {modules}")]).output();
    if !importable.is_ok_and(|output| output.status.success()) {
        let required = crate::support::is_required("PYTHON");
        assert!(!required, "python3 with the modules {modules} is required but not installed");
        eprintln!("left out: {script_name}: python3 with the modules {modules} is not installed");
        return None;
    }
    let mut command = Command::new("python3");
    command.arg(script(script_name));
    Some(command)
}

/// Frame number, normal and tangential velocity, spin.
type Row = (u64, [u64; 3]);

/// The rows printed by an example, numbers bit by bit.
fn rows(printed: &str) -> Vec<Row> {
    let row = |line: &str| {
        let words: Vec<&str> = line.split(' ').collect();
        assert_eq!(words.len(), 4, "{line}");
        let bits = |k: usize| words[k].parse::<f64>().unwrap().to_bits();
        (words[0].parse().unwrap(), [bits(1), bits(2), bits(3)])
    };
    printed.lines().map(row).collect()
}

/// The rows of a recording.
fn recorded(path: &Path) -> Vec<Row> {
    let samples = Recording::open(path).unwrap().velocities().unwrap().map(Result::unwrap);
    samples
        .filter_map(|s| Some((s.frame, s.velocity?)))
        .map(|(frame, v)| (frame, [v.vn_m_s, v.vt_m_s, v.omega_rad_s.unwrap()].map(f64::to_bits)))
        .collect()
}

fn printed_by(mut command: Command, argument: &Path) -> Vec<Row> {
    let output = command.arg(argument).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    rows(std::str::from_utf8(&output.stdout).unwrap())
}

#[test]
fn the_reading_examples_print_every_velocity_of_a_recording() {
    let rig = Rig::new();
    let (film, measured) = (rig.path("film.mcap"), rig.path("measured.mcap"));
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/lacrosse.toml");
    succeed(["simulate".as_ref(), "lacrosse".as_ref(), "-o".as_ref(), film.as_os_str()]);
    let arguments = ["analyze".as_ref(), film.as_os_str(), "--config".as_ref(), config.as_os_str()];
    succeed(arguments.into_iter().chain(["-o".as_ref(), measured.as_os_str()]));
    let expected = recorded(&measured);
    assert!(expected.len() >= 90, "only {} velocities", expected.len());
    assert_eq!(printed_by(example("read_recording"), &measured), expected);
    if let Some(python) = python("read_recording.py", "mcap, mcap_protobuf") {
        assert_eq!(printed_by(python, &measured), expected);
    }
}

#[test]
fn the_listening_examples_print_every_velocity_of_the_rig() {
    let rig = Rig::new();
    let camera = "source = \"simulated\"\npaced = false\nexposure_us = 20";
    let config = rig.config(camera, "[scale]\nmm_per_px = 0.5142\n[workers]\ncount = 1");
    let listeners = [Some(example("listen")), python("listen.py", "iceoryx2")];
    let listeners: Vec<Background> = (listeners.into_iter().flatten())
        .map(|mut command| {
            command.arg(&rig.name);
            Background::start(command)
        })
        .collect();
    let (code, _, stderr) = Background::start(ricochet(["run".as_ref(), config.as_os_str()])).end();
    assert_eq!(code, Some(0), "{stderr}");
    let received: Vec<Vec<Row>> = listeners
        .into_iter()
        .map(|listener| {
            let (code, printed, stderr) = listener.end();
            assert_eq!(code, Some(0), "{stderr}");
            rows(&printed)
        })
        .collect();
    let expected = recorded(&rig.recordings()[0]);
    assert!(expected.len() >= 90, "only {} velocities", expected.len());
    let expected_frames: Vec<u64> = expected.iter().map(|(frame, _)| *frame).collect();
    for received in received {
        let frames: Vec<u64> = received.iter().map(|(frame, _)| *frame).collect();
        assert_eq!(frames, expected_frames, "a frame is missing");
        assert!(received == expected, "the numbers differ");
    }
}

/// Checks that a page shows what was drawn, but for some pixels of lines, which follow the last digit of a number.
///
/// After a change that is meant, `RICOCHET_WRITE_GOLDEN=1` copies it.
fn check_picture(drawn: &Path, name: &str) {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join(name);
    if std::env::var_os("RICOCHET_WRITE_GOLDEN").is_some_and(|value| value == "1") {
        std::fs::copy(drawn, &page).unwrap();
    }
    let [drawn, shown] = [drawn, &page].map(|path| image::open(path).unwrap().into_rgb8());
    assert_eq!(drawn.dimensions(), shown.dimensions(), "{name}");
    let differing = drawn.pixels().zip(shown.pixels()).filter(|(drawn, shown)| drawn != shown).count();
    let share = differing as f64 / f64::from(drawn.width() * drawn.height());
    assert!(share < 0.005, "{name}: {:.2} % of the pixels differ", 100.0 * share);
}

/// Six films with their reports, from rod to a plain steel ball.
#[test]
fn the_gallery_is_made_by_one_command() {
    let rig = Rig::new();
    let folder = rig.path("gallery");
    let mut gallery = Command::new(script("gallery.sh"));
    let output = gallery.arg(&folder).env("RICOCHET", env!("CARGO_BIN_EXE_ricochet")).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let restitution = |name: &str| {
        let page = std::fs::read_to_string(folder.join(format!("{name}.html"))).unwrap();
        assert!(page.contains("<svg"), "{name}: a page with curves");
        let recording = Recording::open(&folder.join(format!("{name}.mcap"))).unwrap();
        let impacts = recording.impacts().unwrap().map(Result::unwrap);
        let found: Vec<f64> = impacts.filter_map(|impact| Some(impact.restitution?.value)).collect();
        found.first().copied()
    };
    for name in ["rod", "tennis", "lacrosse", "patch", "steel"] {
        let found = restitution(name);
        assert!(found.is_some_and(|found| (0.4..1.0).contains(&found)), "{name}: {found:?}");
    }
    restitution("pair");
    for name in ["rod", "tennis", "lacrosse", "pair", "patch", "steel"] {
        check_picture(&folder.join(format!("{name}.png")), &format!("docs/gallery/{name}.png"));
    }
    for name in ["impact-field.svg", "impact-velocity.svg"] {
        let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs").join(name);
        assert!(std::fs::read(folder.join(name)).unwrap() == std::fs::read(page).unwrap(), "{name} of the README");
    }
    // A second gallery in the same folder would mix with the first.
    assert!(!Command::new(script("gallery.sh")).arg(&folder).output().unwrap().status.success());
}
