//! Wrong input: one clear line, the right exit code, never a panic.

use crate::recording::foreign::{Shape, file, image};
use crate::support::{Rig, csv, ricochet, run, succeed};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Returns the one line on standard error of a program that must end with this exit code.
fn line(output: &Output, code: i32) -> String {
    let printed = String::from_utf8(output.stderr.clone()).unwrap();
    // The summary of `analyze` is a result.
    let message: Vec<&str> = printed.lines().filter(|line| !line.contains(" frames measured")).collect();
    let message = message.join("\n");
    assert_eq!(output.status.code(), Some(code), "{printed}");
    assert_eq!(message.lines().count(), 1, "not one line:\n{message}");
    for noise in ["panicked", "backtrace", "RUST_"] {
        assert!(!message.contains(noise), "{message}");
    }
    message.strip_prefix("ricochet: ").unwrap_or_else(|| panic!("{message}")).trim_end().to_owned()
}

fn refused<S: AsRef<std::ffi::OsStr>>(code: i32, arguments: impl IntoIterator<Item = S>) -> String {
    line(&run(arguments), code)
}

/// A small recording, because the lacrosse scenario takes longer to draw than to refuse.
fn film(rig: &Rig) -> PathBuf {
    let scenario = rig.file("drift.toml", &crate::pipeline::drift(40, 1000.0));
    let path = rig.path("film.mcap");
    succeed(["simulate".as_ref(), scenario.as_os_str(), "-o".as_ref(), path.as_os_str()]);
    path
}

fn foreign(rig: &Rig, name: &str, images: &[Shape]) -> PathBuf {
    let path = rig.path(name);
    std::fs::write(&path, file(mcap::WriteOptions::new(), images)).unwrap();
    path
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

const NO_FILE: &str = "No such file or directory (os error 2)";

#[test]
fn a_missing_recording_is_named_once_and_exits_with_5() {
    for command in ["info", "analyze", "replay"] {
        assert_eq!(refused(5, [command, "missing.mcap"]), format!("cannot open missing.mcap: {NO_FILE}"), "{command}");
    }
    let message = refused(5, ["export", "missing.mcap", "--topic", "velocity"]);
    assert_eq!(message, format!("cannot open missing.mcap: {NO_FILE}"));
    let rig = Rig::new();
    let config = rig.config("source = \"recording\"\nid = \"missing.mcap\"", "");
    assert_eq!(refused(5, ["run", text(&config)]), format!("cannot open missing.mcap: {NO_FILE}"));
}

#[test]
fn a_file_that_is_not_mcap_is_refused_at_its_byte() {
    let rig = Rig::new();
    let path = rig.file("notes.mcap", "nothing of the kind\n");
    for command in ["info", "analyze", "replay"] {
        let message = refused(5, [command, text(&path)]);
        assert_eq!(
            message,
            format!("cannot read {}: not an MCAP file: the magic bytes are missing at byte 0", path.display())
        );
    }
}

#[test]
fn a_truncated_recording_is_measured_up_to_the_cut() {
    let rig = Rig::new();
    let whole = film(&rig);
    let bytes = std::fs::read(&whole).unwrap();
    // The cut may fall between an image and its index.
    for share in [40, 61, 77, 90] {
        let cut = rig.path(&format!("cut-{share}.mcap"));
        std::fs::write(&cut, &bytes[..bytes.len() * share / 100]).unwrap();
        let results = rig.path(&format!("results-{share}.mcap"));
        let output = run(["analyze", text(&cut), "-o", text(&results)]);
        let message = line(&output, 6);
        assert!(message.starts_with("finished, but data were lost: 1; ") && message.contains(text(&cut)), "{message}");
        assert!(message.contains("byte"), "no offset: {message}");
        let rows = csv(&results, "velocity").lines().count() - 1;
        assert!(rows > 40 * share / 100 - 8 && rows < 40, "{rows} rows of {share} %");
        // `export` reports the loss as well.
        let message = line(
            &run(["export", text(&cut), "--topic", "truth", "-o", text(&rig.path(&format!("truth-{share}.csv")))]),
            6,
        );
        assert!(message.contains(text(&cut)), "{message}");
        let shots = rig.path(&format!("shots-{share}"));
        let name = format!("{}-{share}", rig.name);
        let output = run(["replay", text(&cut), "--rate", "max", "--rig", &name, "-o", text(&shots)]);
        line(&output, 6);
        let replayed = String::from_utf8(output.stdout).unwrap();
        assert_eq!(csv(Path::new(replayed.trim()), "velocity"), csv(&results, "velocity"));
    }
}

#[test]
fn a_recording_without_images_is_refused_with_its_topics() {
    let rig = Rig::new();
    let empty = foreign(&rig, "empty.mcap", &[]);
    let config = rig.config("source = \"simulated\"", "");
    let message = refused(5, ["analyze", text(&empty), "--config", text(&config)]);
    assert_eq!(message, format!("cannot read {}: it has no frames", empty.display()));
    let other = rig.path("other.mcap");
    let mut writer = mcap::Writer::new(std::io::BufWriter::new(std::fs::File::create(&other).unwrap())).unwrap();
    let channel = writer.add_channel(0, "/imu", "json", &std::collections::BTreeMap::new()).unwrap();
    let header = mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time: 1, publish_time: 1 };
    writer.write_to_known_channel(&header, b"{}").unwrap();
    writer.finish().unwrap();
    drop(writer);
    for message in [
        refused(5, ["analyze", text(&other), "--config", text(&config)]),
        refused(5, ["replay", text(&other), "--config", text(&config)]),
    ] {
        assert!(message.contains("no image topic") && message.contains("it has /imu"), "{message}");
    }
}

#[test]
fn an_image_with_too_few_bytes_is_refused_with_its_sizes() {
    let rig = Rig::new();
    let config = rig.config("source = \"simulated\"", "[scale]\nmm_per_px = 0.5");
    let short = foreign(&rig, "short.mcap", &[image("mono8", 64, 48, 64, 3071); 3]);
    let message = refused(5, ["analyze", text(&short), "--config", text(&config)]);
    assert!(message.contains("frame 0: 3071 bytes are not 64x48 mono8 with step 64"), "{message}");
    let changes = foreign(
        &rig,
        "changes.mcap",
        &[image("mono8", 64, 48, 64, 3072), image("mono8", 64, 48, 64, 3072), image("mono8", 48, 64, 48, 3072)],
    );
    let message = refused(2, ["analyze", text(&changes), "--config", text(&config), "-o", text(&rig.path("a.mcap"))]);
    assert_eq!(message, "frame 2 is 48 x 64 px in a stream of 64 x 48");
    assert!(!rig.path("a.mcap.part").exists(), "part of the results is left behind");
}

#[test]
fn a_recording_of_another_program_needs_a_configuration() {
    let rig = Rig::new();
    let path = foreign(&rig, "foreign.mcap", &[image("mono8", 64, 48, 64, 3072); 3]);
    let wanted = format!("{}: no config.toml is attached; pass a rig file with --config", path.display());
    assert_eq!(refused(2, ["analyze", text(&path)]), wanted);
    assert_eq!(refused(2, ["replay", text(&path)]), wanted);
    let config = rig.config("source = \"simulated\"", "");
    let one = foreign(&rig, "one.mcap", &[image("mono8", 64, 48, 64, 3072)]);
    let message = refused(2, ["analyze", text(&one), "--config", text(&config)]);
    assert_eq!(message, format!("{}: the frame rate is unknown; pass it with --fps", one.display()));
    let message = refused(5, ["replay", text(&one), "--config", text(&config)]);
    assert!(message.contains(text(&one)) && message.contains("no frame rate"), "{message}");
    assert_eq!(refused(2, ["analyze", text(&one), "--fps", "0"]), "--fps 0e0: must be above 0 and at most 1e9");
}

#[test]
fn a_wrong_rig_file_is_refused_with_file_line_key_value_and_range() {
    let rig = Rig::new();
    for (name, content, wanted) in [
        ("broken.toml", "[camera", "line 1: not TOML: unclosed table, expected `]`"),
        ("key.toml", "[camera]\nsource = \"simulated\"\nspeed = 1\n", "line 3: unknown key camera.speed; "),
        (
            "range.toml",
            "[camera]\nsource = \"simulated\"\nframe_rate_hz = -1\n",
            "line 3: camera.frame_rate_hz = -1: must be above 0 and at most 1000000 Hz",
        ),
        (
            "scenario.toml",
            "[camera]\nsource = \"simulated\"\nscenario = \"golf\"\n",
            "camera.scenario = \"golf\": scenario \"golf\" is not built in (lacrosse, ",
        ),
    ] {
        let path = rig.file(name, content);
        for command in ["run", "acquire", "correlate", "track"] {
            let message = refused(2, [command, text(&path)]);
            assert!(message.starts_with(text(&path)) && message.contains(wanted), "{command} {name}: {message}");
        }
    }
    let message = refused(2, ["run", "missing.toml"]);
    assert_eq!(message, format!("cannot read missing.toml: {NO_FILE}"));
}

#[test]
fn an_unknown_scenario_or_experiment_lists_the_known_ones() {
    let rig = Rig::new();
    let message = refused(2, ["simulate", "golf", "-o", text(&rig.path("golf.mcap"))]);
    assert!(message.contains("\"golf\"") && message.contains("lacrosse"), "{message}");
    let message = refused(2, ["demo", "golf"]);
    assert!(message.contains("\"golf\"") && message.contains("lacrosse"), "{message}");
    let scenario = rig.file("bad.toml", "name = 7\n[camera\n");
    let message = refused(2, ["simulate", text(&scenario), "-o", text(&rig.path("bad.mcap"))]);
    assert!(message.contains(text(&scenario)), "the file is not named: {message}");
}

/// A camera that does not exist, because the network of RFC 5737 is never routed.
const NO_CAMERA: &str = "source = \"genicam\"\nid = \"192.0.2.7\"\nwidth_px = 64\nheight_px = 64\nframe_rate_hz = 100";

#[test]
fn a_camera_that_does_not_answer_exits_with_3() {
    if crate::fake_gige::aravis_or_leave_out().is_none() {
        return;
    }
    let rig = Rig::new();
    let config = rig.config(NO_CAMERA, "");
    for command in ["run", "acquire"] {
        let message = refused(3, [command, text(&config)]);
        assert!(
            message.starts_with("cannot open camera \"192.0.2.7\": no GigE Vision camera answers"),
            "{command}: {message}"
        );
    }
}

#[test]
fn without_aravis_the_missing_package_is_named() {
    let rig = Rig::new();
    let config = rig.config(NO_CAMERA, "");
    rig.file("libaravis-0.8.so.0", "");
    let folder = config.parent().unwrap();
    for arguments in [["run", text(&config)], ["acquire", text(&config)], ["cameras", "--json"]] {
        let message = line(&ricochet(arguments).env("LD_LIBRARY_PATH", folder).output().unwrap(), 3);
        assert!(message.starts_with("cannot load libaravis-0.8.so.0: "), "{message}");
        assert!(message.ends_with("install the package libaravis-0.8-0"), "{message}");
    }
}

#[test]
fn a_role_that_the_rig_does_not_have_is_refused() {
    let rig = Rig::new();
    let config = rig.config("source = \"simulated\"", "[workers]\ncount = 2");
    let message = refused(2, ["correlate", text(&config), "--worker", "2"]);
    assert_eq!(message, "--worker 2: the rig has 2 workers, allowed are 0 to 1");
    let bare = rig.file("bare.toml", "[camera]\nsource = \"simulated\"\n");
    let message = refused(2, ["record", text(&bare)]);
    assert_eq!(message, format!("{}: nothing to record: add a [record] table", bare.display()));
}

#[test]
fn an_unknown_topic_or_format_lists_the_known_ones() {
    let rig = Rig::new();
    let path = film(&rig);
    let message = refused(2, ["export", text(&path), "--topic", "speed"]);
    assert_eq!(message, "--topic speed: not one of velocity, field, track, impact, truth, truth_impact, events");
    let message = refused(2, ["export", text(&path), "--topic", "truth", "--format", "xls"]);
    assert!(
        message.contains("unknown format \"xls\": not one of csv, parquet, npz, png, mp4, gif, mcap, ros2"),
        "{message}"
    );
    let message = refused(2, ["listen", "speed"]);
    assert_eq!(message, "topic \"speed\" is not one of field, track, velocity, impact, status, events");
}

#[test]
fn no_recording_is_ever_overwritten() {
    let rig = Rig::new();
    let path = film(&rig);
    let before = std::fs::read(&path).unwrap();
    let taken = text(&path);
    let scenario = rig.path("drift.toml");
    for (code, arguments) in [
        (2, ["simulate", text(&scenario), "-o", taken].as_slice()),
        (2, &["analyze", taken, "-o", taken]),
        (5, &["recover", taken, "-o", taken]),
        (2, &["export", taken, "--topic", "truth", "-o", taken]),
        (2, &["field", taken, "other.bmp", "-o", taken]),
    ] {
        let message = refused(code, arguments);
        assert!(message.contains(taken), "{message}");
        assert!(std::fs::read(&path).unwrap() == before, "{arguments:?} changed the file");
    }
}

#[test]
fn an_unwritable_directory_is_named_before_anything_starts() {
    let rig = Rig::new();
    let scenario = rig.file("drift.toml", &crate::pipeline::drift(40, 1000.0));
    // A file in place of a directory stops root too.
    let blocked = rig.file("blocked", "").join("shots");
    let config = rig.file(
        "blocked.toml",
        &format!("[camera]\nsource = \"simulated\"\n[record]\ndirectory = \"{}\"\n", blocked.display()),
    );
    let message = refused(5, ["run", text(&config)]);
    assert_eq!(message, format!("cannot create {}: Not a directory (os error 20)", blocked.display()));
    let message = refused(5, ["record", text(&config)]);
    assert_eq!(message, format!("cannot create {}: Not a directory (os error 20)", blocked.display()));
    let output = blocked.join("film.mcap");
    let message = refused(5, ["simulate", text(&scenario), "-o", text(&output)]);
    assert!(message.starts_with(&format!("cannot create {}", output.display())), "{message}");
}

/// Writes an image in the simplest format.
fn image_file(rig: &Rig, name: &str, width: usize, height: usize) -> PathBuf {
    let path = rig.path(name);
    let mut bytes = format!("P5 {width} {height} 255\n").into_bytes();
    bytes.extend((0..width * height).map(|index| (index * 37 % 251) as u8));
    std::fs::write(&path, bytes).unwrap();
    path
}

#[test]
fn images_that_do_not_match_are_refused_with_their_sizes() {
    let rig = Rig::new();
    let (small, large) = (image_file(&rig, "small.pgm", 40, 30), image_file(&rig, "large.pgm", 80, 60));
    let message = refused(2, ["field", text(&small), text(&large)]);
    assert_eq!(
        message,
        format!(
            "{} is 40 x 30 px but {} is 80 x 60 px: both images need the same size",
            small.display(),
            large.display()
        )
    );
    let message = refused(2, ["field", text(&small), text(&small), "--subset", "61"]);
    assert!(message.contains("61") && message.contains("40 x 30"), "{message}");
    let message = refused(2, ["field", text(&small), text(&small), "--subset", "20"]);
    assert!(message.contains("subset") && message.contains("20") && message.contains("odd"), "{message}");
    let message = refused(2, ["field", text(&large), text(&large), "--roi", "70,0,20,20"]);
    assert!(message.contains("--roi [70, 0, 20, 20]") && message.contains("80 x 60"), "{message}");
    let notes = rig.file("notes.bmp", "no picture");
    let message = refused(5, ["field", text(&notes), text(&small)]);
    assert!(message.starts_with(&format!("cannot read {}: ", notes.display())), "{message}");
    let message = refused(5, ["field", "missing.bmp", text(&small)]);
    assert_eq!(message, format!("cannot read missing.bmp: {NO_FILE}"));
}

#[test]
fn a_file_that_is_no_footage_is_refused_with_its_name() {
    let rig = Rig::new();
    let config = rig.config("source = \"simulated\"", "");
    let notes = rig.file("notes.tif", "no picture");
    let output = rig.path("film.mcap");
    let message = refused(5, ["import", text(&notes), "--fps", "100", "-o", text(&output)]);
    assert!(message.contains(text(&notes)), "{message}");
    let message = refused(5, ["analyze", text(&notes), "--fps", "100", "--config", text(&config)]);
    assert!(message.contains(text(&notes)), "{message}");
    let message = refused(2, ["import", text(&image_file(&rig, "a.pgm", 40, 30)), "-o", text(&output)]);
    assert!(message.contains("frame rate"), "{message}");
}

#[test]
fn a_request_to_a_rig_that_does_not_run_is_refused() {
    for arguments in [
        ["listen", "velocity", "--rig", "nobody"].as_slice(),
        &["status", "--rig", "nobody"],
        &["trigger", "--rig", "nobody"],
        &["arm", "--rig", "nobody"],
        &["disarm", "--rig", "nobody"],
    ] {
        let message = refused(4, arguments);
        assert!(message.starts_with("no rig named \"nobody\" is running"), "{message}");
    }
}

#[test]
fn a_wrong_option_is_reported_in_one_line() {
    for (arguments, wanted) in [
        (["replay", "film.mcap", "--rate", "0"].as_slice(), "\"0\" is neither `max` nor a number from 0.001 to 1000"),
        (&["analyze", "film.mcap", "--workers", "65"], "65 is not in 1..=64"),
        (&["info"], "<FILE>"),
        (&["field", "a.bmp", "b.bmp", "--roi", "1,2,3"], "expected four whole numbers of pixels: x,y,width,height"),
        (&["inspect"], "unrecognized subcommand 'inspect'"),
    ] {
        let message = refused(2, arguments);
        assert!(message.contains(wanted) && message.ends_with("--help`"), "{message}");
    }
}

/// The commands that the program's own help lists.
pub fn commands() -> Vec<String> {
    let help = succeed(["--help"]);
    let listed = help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    listed.filter_map(|line| line.split_whitespace().next().map(str::to_owned)).filter(|name| name != "help").collect()
}

#[test]
fn the_help_of_every_command_has_an_example_of_it() {
    let commands = commands();
    assert!(commands.len() >= 20, "{commands:?}");
    for command in commands {
        let help = succeed([command.as_str(), "--help"]);
        let example = help.lines().find_map(|line| line.strip_prefix("Example: ")).unwrap_or_else(|| panic!("{help}"));
        assert!(example.starts_with(&format!("ricochet {command}")), "{example}");
    }
}

#[test]
fn a_closed_standard_output_does_not_panic() {
    let rig = Rig::new();
    let path = film(&rig);
    let program = env!("CARGO_BIN_EXE_ricochet");
    let script = format!("{program} export {} --topic truth | head -n 1; exit ${{PIPESTATUS[0]}}", path.display());
    let output = Command::new("bash").args(["-c", &script]).output().unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(!message.contains("panicked"), "{message}");
}

#[test]
fn an_impossible_part_of_a_recording_is_refused() {
    let rig = Rig::new();
    let film = film(&rig);
    for command in ["replay", "analyze"] {
        let message = refused(2, [command, text(&film), "--from", "0.3", "--to", "0.2"]);
        assert_eq!(message, "--to 0.2: must be greater than --from, 0.3 s");
        let message = refused(2, [command, text(&film), "--from", "nan"]);
        assert_eq!(message, "--from NaN: must be 0 to 1000000 s");
    }
    let message = refused(2, ["replay", text(&film), "--from", "1000"]);
    assert!(message.starts_with("--from 1000: beyond the last frame at "), "{message}");
    refused(2, ["analyze", text(&film), "--from", "1000"]);
    refused(2, ["replay", text(&film), "--loop=0"]);
}
