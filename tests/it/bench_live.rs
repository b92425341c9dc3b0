//! `ricochet bench live --rate`: the processes of a rig at the rate of a camera.

use crate::support::{Background, ricochet, wait_until};
use serde_json::Value;
use std::path::Path;
use std::process::Command;
use tempfile::TempDir;

/// A small rig, in a runtime folder of its own, so that no other test's rig of this name is in the way.
fn bench(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = ricochet(["bench", "live", "--subsets", "16", "--ring", "600"]);
    if !arguments.contains(&"--size") {
        command.args(["--size", "256x192"]);
    }
    command.args(arguments).env("RICOCHET_RUNTIME_DIR", folder.join("r")).env("TMPDIR", folder.join("t"));
    std::fs::create_dir_all(folder.join("t")).unwrap();
    command
}

fn number(value: &Value, key: &str) -> f64 {
    value[key].as_f64().unwrap_or_else(|| panic!("{key} in {value}"))
}

#[test]
fn every_frame_of_a_slow_camera_has_a_row_and_the_figures_agree() {
    let folder = TempDir::new().unwrap();
    let output =
        bench(folder.path(), &["--rate", "100", "--seconds", "1", "--workers", "2", "--json"]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let printed: Value = serde_json::from_slice(&output.stdout).unwrap();
    let [trial] = printed["live"].as_array().unwrap().as_slice() else { panic!("{printed}") };
    let (frames, rows) = (number(trial, "frames"), number(trial, "rows"));
    assert!(frames >= 100.0 && (frames - rows).abs() < 0.5, "{frames} frames, {rows} rows");
    assert_eq!((number(trial, "lost"), number(trial, "not_measured")), (0.0, 0.0), "{trial}");
    assert_eq!(trial["keeps_up"].as_bool(), Some(trial["shortfalls"].as_array().unwrap().is_empty()));
    assert!(number(trial, "ring_frames") >= 512.0 && number(trial, "subsets") > 8.0, "{trial}");
    let latency = &trial["latency_s"];
    let ordered = ["median", "p99", "p999"].map(|key| number(latency, key));
    assert!(ordered[0] > 0.0 && ordered.is_sorted(), "{latency}");
    // A quantile is the upper edge of its bin, at most 1 us or 0.2 % above the latency.
    assert!(ordered[2] <= 1.003 * number(latency, "max") + 2e-6 && number(latency, "deviation") > 0.0, "{latency}");
    let processes = trial["processes"].as_array().unwrap();
    let names: Vec<&str> = processes.iter().map(|process| process["process"].as_str().unwrap()).collect();
    assert_eq!(names, ["acquire", "correlate", "correlate", "track", "record", "run"]);
    let sum = |key: &str| processes.iter().filter_map(|process| process[key].as_f64()).sum::<f64>();
    assert!((sum("cpu_us_per_frame") - number(trial, "cpu_us_per_frame")).abs() < 1e-6, "{trial}");
    assert!((number(&processes[1], "out") + number(&processes[2], "out") - frames).abs() < 0.5, "{trial}");
    for process in processes {
        assert!(number(process, "cpu_s") > 0.0 && number(process, "measured_s") > 0.0, "{process}");
        assert!(number(process, "peak_bytes") >= number(process, "private_bytes"), "{process}");
    }
}

#[test]
fn a_rod_is_measured_in_every_frame_and_the_memory_is_compared() {
    let folder = TempDir::new().unwrap();
    let options = ["--body", "rod", "--rate", "20", "--seconds", "1", "--size", "128x160", "--json"];
    let output = bench(folder.path(), &options).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let printed: Value = serde_json::from_slice(&output.stdout).unwrap();
    let trial = &printed["live"][0];
    assert_eq!((&trial["body"], &trial["keeps_up"]), (&"rod".into(), &true.into()), "{trial}");
    assert!((number(trial, "frame_bytes_per_s") - 128.0 * 160.0 * 20.0).abs() < 1.0);
    assert!(number(trial, "memcpy_bytes_per_s") > 1e8, "{trial}");
}

#[test]
fn an_interrupt_ends_it_and_leaves_nothing_behind() {
    let folder = TempDir::new().unwrap();
    let running = Background::start(bench(folder.path(), &["--rate", "200", "--seconds", "600"]));
    let domain = wait_until("the rig runs", || {
        let entries = std::fs::read_dir(folder.path().join("r")).ok()?;
        entries.flatten().map(|entry| entry.file_name().into_string().unwrap()).find(|name| name != "rigs")
    });
    let memory = || {
        let entries = std::fs::read_dir("/dev/shm").unwrap();
        entries.flatten().filter(|entry| entry.file_name().into_string().unwrap().starts_with(&domain)).count()
    };
    let members = || {
        let lines = std::fs::read_dir("/proc").unwrap().flatten().map(|entry| entry.path().join("cmdline"));
        lines.filter_map(|path| std::fs::read_to_string(path).ok()).filter(|line| line.contains(&domain)).count()
    };
    wait_until("its processes run", || (members() == 5 && memory() > 0).then_some(()));
    running.signal(2);
    let (code, printed, complaints) = running.end();
    assert_eq!((code, printed.as_str()), (Some(130), ""), "{complaints}");
    assert!(complaints.contains("interrupted; nothing unfinished is left"), "{complaints}");
    assert_eq!((members(), memory()), (0, 0));
    assert!(!folder.path().join("r").join(&domain).exists());
    assert_eq!(std::fs::read_dir(folder.path().join("t")).unwrap().count(), 0);
}

#[test]
fn options_of_the_rig_are_refused_without_a_rate_and_out_of_range() {
    for (arguments, reason) in [
        (&["live", "--subsets", "16"][..], "--rate"),
        (&["windows", "--rate", "100"], "for `bench live` only"),
        (&["live", "--rate", "0"], "neither `max` nor a number from 10 to 500000"),
        (&["live", "--rate", "100", "--size", "8"], "each from 64 to 4096 px"),
        (&["live", "--rate", "100", "--seconds", "0"], "from 0.1 to 3600"),
        (&["live", "--rate", "100", "--body", "rod", "--size", "128"], "a rod needs at least 64x160 px"),
    ] {
        let output = ricochet(["bench"]).args(arguments).output().unwrap();
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {text}");
        assert!(text.contains(reason), "{arguments:?}: {text}");
    }
}
