//! The Python package and the C header: generated from the messages, and used against a running rig.

use crate::support::{Background, Rig, csv, is_required, ricochet, succeed};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The Python interpreter with the packages that listening needs, or `None` where it may be missing.
fn python() -> Option<Command> {
    let found = Command::new("python3").args(["-c", "import iceoryx2, numpy"]).output();
    if !found.is_ok_and(|output| output.status.success()) {
        assert!(!is_required("PYTHON"), "python3 with iceoryx2 and numpy is required but not installed");
        eprintln!("left out: python3 with iceoryx2 and numpy is not installed");
        return None;
    }
    let mut command = Command::new("python3");
    command.env("PYTHONPATH", root().join("python/src")).stdout(Stdio::piped()).stderr(Stdio::piped());
    Some(command)
}

#[test]
fn the_declarations_are_those_of_the_program() {
    for (language, file) in [("python", "python/src/ricochet/_messages.py"), ("c", "include/ricochet.h")] {
        let kept = std::fs::read_to_string(root().join(file)).unwrap();
        assert_eq!(kept, succeed(["bindings", language]), "run: ricochet bindings {language} > {file}");
    }
}

#[test]
fn python_and_c_have_the_sizes_of_the_messages() {
    if let Some(mut python) = python() {
        let script = "import ctypes, ricochet._messages as m\n\
                      kinds = [k for k in vars(m).values() if isinstance(k, type) and issubclass(k, ctypes.Structure)]\n\
                      assert len(kinds) > 10\n\
                      for k in kinds: assert ctypes.sizeof(k) == k.SIZE_BYTES, k";
        let output = python.args(["-c", script]).output().unwrap();
        assert!(output.status.success(), "{output:?}");
    }
    let Ok(compiled) = Command::new("cc")
        .args(["-std=c11", "-Wall", "-Werror", "-fsyntax-only"])
        .arg(root().join("include/ricochet.h"))
        .output()
    else {
        return;
    };
    assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
}

/// A rig that films the built-in scenario and waits for its readers.
fn rig_file(rig: &Rig) -> PathBuf {
    let camera = "source = \"simulated\"\npaced = false\nexposure_us = 20";
    rig.config(camera, "[scale]\nmm_per_px = 0.5142\n[workers]\ncount = 1")
}

fn lines(script: &str, rig: &Rig, config: &Path) -> Option<Vec<Value>> {
    let mut command = python()?;
    command.args(["-c", script, &rig.name]);
    let listener = Background::start(command);
    let (code, _, stderr) = Background::start(ricochet(["run".as_ref(), config.as_os_str()])).end();
    assert_eq!(code, Some(0), "{stderr}");
    let (code, printed, stderr) = listener.end();
    assert_eq!(code, Some(0), "{stderr}");
    Some(printed.lines().map(|line| serde_json::from_str(line).unwrap()).collect())
}

#[test]
fn every_velocity_arrives_with_the_columns_of_the_table() {
    let rig = Rig::new();
    let config = rig_file(&rig);
    let script = "import json, sys, ricochet\n\
                  for row in ricochet.listen('velocity', rig=sys.argv[1], wait_s=60): print(json.dumps(row))";
    let Some(rows) = lines(script, &rig, &config) else { return };
    let table = csv(&rig.recordings()[0], "velocity");
    let mut reader = csv::Reader::from_reader(table.as_bytes());
    let header = reader.headers().unwrap().clone();
    let records: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), records.len(), "a row is missing");
    for (row, record) in rows.iter().zip(&records) {
        for (name, cell) in header.iter().zip(record).filter(|(name, _)| !["body", "t_s"].contains(name)) {
            let is_equal = match &row[name] {
                Value::Null => cell.is_empty(),
                Value::String(word) => word == cell,
                number => cell.parse::<f64>().ok() == number.as_f64(),
            };
            assert!(is_equal, "{name}: {} and {cell:?}", row[name]);
        }
    }
}

#[test]
fn frames_are_arrays_and_impacts_have_uncertainties() {
    let rig = Rig::new();
    let config = rig_file(&rig);
    let script = "import json, sys, ricochet\n\
                  for frame in ricochet.frames(rig=sys.argv[1], wait_s=60):\n    \
                  print(json.dumps([frame.pixels.shape, float(frame.pixels.mean()), int(frame.pixels.max())]))";
    let Some(frames) = lines(script, &rig, &config) else { return };
    assert!(!frames.is_empty());
    assert!(frames.iter().all(|frame| frame[0] == serde_json::json!([192, 256]) && frame[2].as_u64().unwrap() > 50));

    let rig = Rig::new();
    let config = rig_file(&rig);
    let script = "import json, sys, ricochet\n\
                  for row in ricochet.listen('impact', rig=sys.argv[1], wait_s=60): print(json.dumps(row))";
    let Some(impacts) = lines(script, &rig, &config) else { return };
    let last = impacts.last().unwrap();
    assert!((last["restitution"].as_f64().unwrap() - 0.7977).abs() < 1e-3, "{last}");
    assert!(last["sigma_restitution"].as_f64().unwrap() < 1e-3, "{last}");
}

#[test]
fn a_wrong_name_gets_one_clear_line_within_a_second() {
    let Some(mut python) = python() else { return };
    let script = "import ricochet, sys, time\n\
                  start = time.monotonic()\n\
                  for topic, rig in (('velocity', 'no-such-rig'), ('speed', 'no-such-rig')):\n    \
                  try: next(ricochet.listen(topic, rig=rig))\n    \
                  except ricochet.RigError as error: print(error)\n\
                  assert time.monotonic() - start < 1";
    let output = python.args(["-c", script]).output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let printed = String::from_utf8(output.stdout).unwrap();
    let lines: Vec<&str> = printed.lines().collect();
    assert!(lines[0].starts_with("no rig named 'no-such-rig' of this user runs"), "{printed}");
    assert!(lines[1].starts_with("no topic 'speed'; topics: velocity"), "{printed}");
}
