//! `ricochet replay`: frame by frame, with shifted times, several recordings together, recordings of several files.

use crate::pipeline::drift;
use crate::pipeline_faults::{analysis, drifting, film, tables, write};
use crate::support::{Rig, frames, ricochet, succeed};
use ricochet::image::FrameMeta;
use ricochet::recording::{Recording, files_of};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Stdio;

type Film = Vec<(FrameMeta, Vec<u8>)>;

/// Records a drift and returns the rig file, the frames and the recording.
fn filmed(rig: &Rig) -> (PathBuf, Film, PathBuf) {
    let config = drifting(rig, "", "[workers]\nblock_frames = 8");
    let frames = film(rig);
    let path = rig.path("whole.mcap");
    write(&path, &config, &frames);
    (config, frames, path)
}

fn analysed(rig: &Rig, film: &Path) -> [String; 4] {
    let (code, tables) = analysis(rig, film, "1");
    assert_eq!(code, Some(0));
    tables
}

/// Replays with these lines on standard input and returns the recordings and the standard error.
fn stepped(rig: &Rig, files: &[&Path], shots: &str, lines: &str) -> (Vec<PathBuf>, String) {
    let mut command = ricochet(["replay", "--step", "--workers", "2", "-o", rig.path(shots).to_str().unwrap()]);
    command.args(["--rig", &rig.name]).args(files);
    let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    child.stdin.take().unwrap().write_all(lines.as_bytes()).unwrap();
    let output = child.wait_with_output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    let printed = String::from_utf8(output.stdout).unwrap();
    (printed.lines().map(PathBuf::from).collect(), stderr)
}

#[test]
fn each_line_plays_a_frame_and_the_end_of_input_ends_the_replay() {
    let rig = Rig::new();
    let (config, film, path) = filmed(&rig);
    let part = rig.path("part.mcap");
    write(&part, &config, &film[..22]);
    let wanted = analysed(&rig, &part);
    for (shots, lines) in [("end", "\n3\nfoo\n\n17\n"), ("q", "22\nq\n\n\n")] {
        let (recordings, stderr) = stepped(&rig, &[&path], shots, lines);
        assert_eq!(recordings.len(), 1, "{stderr}");
        assert_eq!(frames(&recordings[0]), film[..22]);
        assert!(tables(&recordings[0]) == wanted, "{shots}");
        assert!(stderr.contains(&format!("{}: frame 0 at 0.000000 s; Enter plays it", rig.name)), "{stderr}");
        assert!(stderr.contains("frame 22 at 0.022000 s"), "{stderr}");
        assert_eq!(
            stderr.contains("\"foo\": expected Enter, a number of at least 1, or q"),
            shots == "end",
            "{stderr}"
        );
    }
    let (recordings, _) = stepped(&rig, &[&path], "all", "1000\n");
    assert!(tables(&recordings[0]) == analysed(&rig, &path));
}

/// The table without its stamps.
fn without_stamps(table: &str) -> String {
    let mut reader = csv::Reader::from_reader(table.as_bytes());
    let stamps: Vec<bool> = reader.headers().unwrap().iter().map(|name| name == "stamp_ns").collect();
    let cells = |row: csv::StringRecord| {
        row.iter().zip(&stamps).filter(|(_, s)| !**s).map(|(c, _)| c.to_owned() + ",").collect::<String>()
    };
    reader.records().map(|row| cells(row.unwrap()) + "\n").collect()
}

#[test]
fn shifted_times_change_the_stamps_and_nothing_else() {
    const BEGIN_NS: u64 = 1_900_000_000_123_456_789;
    let rig = Rig::new();
    let (_, film, path) = filmed(&rig);
    let wanted = analysed(&rig, &path).map(|table| without_stamps(&table));
    let replay = |shots: &str, shift: &str| {
        let (path, shots) = (path.to_str().unwrap(), rig.path(shots));
        let arguments = ["replay", path, "--rate", "max", shift, "--rig", &rig.name, "-o", shots.to_str().unwrap()];
        PathBuf::from(succeed(arguments).trim())
    };
    let recording = replay("then", &format!("--shift-times={BEGIN_NS}"));
    let stamps = frames(&recording).into_iter().map(|(meta, _)| meta.stamp_ns - BEGIN_NS);
    assert!(stamps.eq(film.iter().map(|(meta, _)| meta.stamp_ns - film[0].0.stamp_ns)));
    assert!(tables(&recording).map(|table| without_stamps(&table)) == wanted);
    let recording = replay("now", "--shift-times");
    let now_ns = std::time::UNIX_EPOCH.elapsed().unwrap().as_nanos() as u64;
    let ago_ns = now_ns - frames(&recording)[0].0.stamp_ns;
    assert!(ago_ns < 300_000_000_000, "{ago_ns} ns ago");
    assert!(tables(&recording).map(|table| without_stamps(&table)) == wanted);
}

#[test]
fn two_cameras_are_replayed_on_two_rigs_in_the_order_of_time() {
    let (rig, other) = (Rig::new(), Rig::new());
    let (_, film, path) = filmed(&rig);
    other.file("drift.toml", &drift(40, 1000.0));
    let config = drifting(&other, "", "[workers]\nblock_frames = 4");
    // The second film starts 5.4 periods later and has the same sequence numbers and epochs.
    let late = |(meta, bytes): &(FrameMeta, Vec<u8>)| {
        (FrameMeta { stamp_ns: meta.stamp_ns + 5_400_000, ..*meta }, bytes.clone())
    };
    let later: Film = film.iter().map(late).collect();
    let second = other.path("second.mcap");
    write(&second, &config, &later);
    let wanted = [analysed(&rig, &path), analysed(&other, &second)];
    let (recordings, stderr) = stepped(&rig, &[&second, &path], "step", &"\n".repeat(80));
    assert_eq!(recordings.len(), 2, "{stderr}");
    let names = [rig.name.clone(), format!("{}-2", rig.name)];
    let mut order: Vec<(u64, String)> = [(&film, &names[0]), (&later, &names[1])]
        .into_iter()
        .flat_map(|(film, name)| {
            film.iter().map(move |(meta, _)| (meta.stamp_ns, format!("{name}: frame {} ", meta.sequence)))
        })
        .collect();
    order.sort();
    let asked = stderr.split("ends: ").filter(|text| text.contains("frame"));
    assert!(asked.zip(&order).all(|(text, (_, wanted))| text.starts_with(wanted.as_str())), "{stderr}");
    assert_eq!(stderr.matches("Enter plays it").count(), 80, "{stderr}");
    assert!(recordings.iter().zip(&wanted).all(|(recording, wanted)| tables(recording) == *wanted));

    for rate in ["max", "0.5"] {
        let shots = rig.path(&format!("shots-{rate}"));
        let mut command = ricochet(["replay", "--rate", rate, "--rig", &rig.name, "-o", shots.to_str().unwrap()]);
        let output = command.args([&path, &second]).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let printed = String::from_utf8(output.stdout).unwrap();
        assert!(printed.lines().zip(&wanted).all(|(path, wanted)| tables(Path::new(path)) == *wanted), "{rate}");
        assert_eq!(printed.lines().count(), 2);
    }
    // A time span selects frames 10 to 19 of one film and 5 to 14 of the other.
    let shots = rig.path("part");
    let mut command = ricochet(["replay", "--rate", "max", "--rig", &rig.name, "-o", shots.to_str().unwrap()]);
    let output = command.args(["--from", "0.01", "--to", "0.02"]).args([&path, &second]).output().unwrap();
    let printed = String::from_utf8(output.stdout).unwrap();
    let played = printed.lines().map(|path| frames(Path::new(path)).iter().map(|(meta, _)| meta.sequence).collect());
    assert_eq!(played.collect::<Vec<Vec<u64>>>(), [(10..20).collect::<Vec<_>>(), (5..15).collect()]);
}

#[test]
fn files_of_one_stream_are_replayed_as_one_in_any_order() {
    let rig = Rig::new();
    let (config, film, path) = filmed(&rig);
    let [first, second] = ["first.mcap", "second.mcap"].map(|name| rig.path(name));
    write(&first, &config, &film[..13]);
    write(&second, &config, &film[13..]);
    let shots = rig.path("shots");
    let mut command = ricochet(["replay", "--rate", "max", "--rig", &rig.name, "-o", shots.to_str().unwrap()]);
    let output = command.args([&second, &first]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let printed = String::from_utf8(output.stdout).unwrap();
    assert!(tables(Path::new(printed.trim())) == analysed(&rig, &path));
}

#[test]
fn a_recording_of_several_files_is_measured_like_one_file() {
    let rig = Rig::new();
    let scenario = rig.file("drift.toml", &drift(130, 1000.0));
    let camera =
        format!("source = \"simulated\"\nscenario = \"{}\"\npaced = false\nexposure_us = 20", scenario.display());
    let rest = "split_bytes = 1048576\n[scale]\nmm_per_px = 0.5\n[workers]\nblock_frames = 8";
    let printed = succeed(["run".as_ref(), rig.config(&camera, rest).as_os_str()]);
    let first = PathBuf::from(printed.trim());
    let files = files_of(&first);
    assert!(files.len() >= 3 && rig.recordings() == files, "{files:?}");
    assert!(files.iter().all(|path| path.metadata().unwrap().len() <= 1 << 20));
    let whole = rig.path("one.mcap");
    let all = frames(&first);
    assert!(all.iter().map(|(meta, _)| meta.sequence).eq(0..130));
    write(&whole, &rig.path("rig.toml"), &all);
    let wanted = analysed(&rig, &whole);
    assert!(tables(&first) == wanted, "live");
    assert!(analysed(&rig, &first) == wanted, "by the first file");
    let results = rig.path("all.mcap");
    succeed(
        ["analyze".as_ref(), "-o".as_ref(), results.as_os_str()]
            .into_iter()
            .chain(files.iter().map(|file| file.as_os_str())),
    );
    assert!(tables(&results) == wanted, "by all files");
    let replay = ["replay", first.to_str().unwrap(), "--rate", "max", "--rig", &rig.name, "-o"];
    let again = rig.path("again");
    let printed = succeed(replay.into_iter().chain([again.to_str().unwrap()]));
    assert!(tables(Path::new(printed.trim())) == wanted, "replayed");
    assert_eq!(Recording::open(Path::new(printed.trim())).unwrap().frame_count(), 130);
}
