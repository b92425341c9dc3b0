//! The recordings in the repository, and every rig file that needs no camera.

use crate::support::{NO_PAGE, Rig, csv, ricochet, succeed};
use ricochet::config::{Config, Source};
use ricochet::recording::Recording;
use std::path::{Path, PathBuf};
use std::process::Command;

fn root(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

/// The cells of the table in `recordings/README.md`, one row per file.
fn table() -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(root("recordings/README.md")).unwrap();
    let rows = text.lines().filter(|line| line.starts_with("| `"));
    rows.map(|row| row.trim_matches('|').split('|').map(|cell| cell.trim().replace('`', "")).collect()).collect()
}

#[test]
fn every_recording_matches_its_row_of_the_table() {
    let rows = table();
    let mut listed: Vec<String> = rows.iter().map(|row| row[0].clone()).collect();
    listed.sort();
    let entries = std::fs::read_dir(root("recordings")).unwrap();
    let mut kept: Vec<String> = entries
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name != "README.md")
        .collect();
    kept.sort();
    assert_eq!(kept, listed);
    for row in rows {
        let path = root("recordings").join(&row[0]);
        let output = Command::new("sha256sum").arg(&path).output().unwrap();
        let sum = String::from_utf8(output.stdout).unwrap();
        assert_eq!(sum.split_whitespace().next(), Some(row[5].as_str()), "{}", row[0]);
        let recording = Recording::open(&path).unwrap();
        assert_eq!(recording.truncated(), None);
        assert_eq!(recording.frame_count().to_string(), row[2], "{}", row[0]);
        assert_eq!(recording.metadata()["frame_rate_hz"], row[3]);
        assert_eq!(recording.metadata()["rig"], row[1]);
        assert!(!recording.metadata().contains_key("host"), "the recording names the machine it was made on");
    }
}

/// The `name value` pairs of the truth in the table.
fn truth(row: &[String]) -> Vec<(String, f64)> {
    let pair = |text: &str| {
        let (name, value) = text.trim().split_once(' ').unwrap();
        (name.to_owned(), value.parse().unwrap())
    };
    row[4].split(',').map(pair).collect()
}

fn number(table: &str, column: &str) -> f64 {
    let mut reader = csv::Reader::from_reader(table.as_bytes());
    let at = reader.headers().unwrap().iter().position(|name| name == column).unwrap();
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 1, "one impact: {table}");
    rows[0][at].parse().unwrap()
}

#[test]
fn the_recorded_shot_is_replayed_and_analysed_to_its_truth() {
    let rig = Rig::new();
    let row = table().into_iter().find(|row| row[0] == "lacrosse.mcap").unwrap();
    let film = root("recordings").join(&row[0]);
    let results = rig.path("results.mcap");
    succeed(["analyze".as_ref(), film.as_os_str(), "-o".as_ref(), results.as_os_str()]);
    let replay = ["replay".as_ref(), film.as_os_str(), "--rate".as_ref(), "max".as_ref()];
    let shots = rig.path("shots");
    let into = ["-o".as_ref(), shots.as_os_str(), "--rig".as_ref(), rig.name.as_ref()];
    let printed = succeed(replay.into_iter().chain(into));
    for topic in ["velocity", "field", "impact"] {
        assert_eq!(csv(Path::new(printed.trim()), topic), csv(&results, topic), "{topic}");
    }
    let (measured, known) = (csv(&results, "impact"), csv(&film, "truth_impact"));
    let values = truth(&row);
    assert!(values.len() >= 5, "{values:?}");
    for (name, value) in values {
        let (truth, measured) = (number(&known, &name), number(&measured, &name));
        println!("{name}: measured {measured}, true {truth}");
        // The table is truncated to six digits.
        assert!(
            (truth - value).abs() <= 1e-6 * value.abs().max(1.0),
            "{name} in the table: {value}, in the file: {truth}"
        );
        let allowed = if name.ends_with("_s") && !name.ends_with("m_s") && !name.ends_with("rad_s") {
            1e-4
        } else if name.contains("omega") {
            0.05 * truth.abs()
        } else {
            0.01 * truth.abs()
        };
        assert!((measured - truth).abs() <= allowed, "{name}: {measured}, true {truth}");
    }
}

#[test]
fn every_rig_file_that_needs_no_camera_runs() {
    let mut ran = 0;
    for entry in std::fs::read_dir(root("config")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|ending| ending != "toml") {
            continue;
        }
        let config = Config::load(&path).unwrap();
        if !matches!(config.camera.source, Some(Source::Simulated | Source::Recording)) {
            println!("{}: needs a camera, was only read", path.display());
            continue;
        }
        let rig = Rig::new();
        // Unchanged except for the name and the page, which another rig of this machine may have.
        let text = std::fs::read_to_string(&path).unwrap();
        let renamed = text.replacen(&format!("name = {:?}", config.rig.name), &format!("name = {:?}", rig.name), 1);
        assert_ne!(renamed, text);
        let copy = rig.file("rig.toml", &format!("{renamed}\n{NO_PAGE}"));
        let home = copy.parent().unwrap();
        if let Some(film) = &config.camera.id {
            let film = home.join(film);
            std::fs::create_dir_all(film.parent().unwrap()).unwrap();
            std::fs::copy(root("recordings/lacrosse.mcap"), film).unwrap();
        }
        let output = ricochet(["run".as_ref(), copy.as_os_str()]).current_dir(home).output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        // A message on the free space of this machine is not about the file.
        let (shots, other): (Vec<&str>, Vec<&str>) =
            stderr.lines().filter(|line| !line.contains("bytes are free in")).partition(|line| {
                ["filming: rig ", "ready: rig ", "shot ", "stopped: rig "].iter().any(|start| line.starts_with(start))
            });
        assert_eq!((output.status.code(), other), (Some(0), vec![]), "{}", path.display());
        let printed = String::from_utf8(output.stdout).unwrap();
        let recordings: Vec<&str> = printed.lines().collect();
        assert_eq!(recordings.len(), usize::from(config.record.is_some()), "{}", path.display());
        for recording in recordings {
            assert!(shots.iter().any(|line| line.starts_with("shot ") && line.contains(recording)), "{shots:?}");
            let velocity = csv(&home.join(recording), "velocity");
            assert!(velocity.lines().filter(|row| row.ends_with(",valid")).count() > 50, "{velocity}");
        }
        ran += 1;
    }
    assert!(ran >= 2, "{ran} rig files ran");
}
