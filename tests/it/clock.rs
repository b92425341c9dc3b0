//! A system clock that is set while a rig runs.

use crate::pipeline::drift;
use crate::support::{Background, Rig, frames, process, ricochet, status, succeed, wait_until};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Overrides the C library: the clock is shifted by the seconds in a file.
const SHIM: &str = r#"
#define _GNU_SOURCE
#include <stdio.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

int clock_gettime(clockid_t id, struct timespec *now) {
    int status = syscall(SYS_clock_gettime, id, now);
    const char *path = getenv("TEST_CLOCK_OFFSET");
    FILE *file = path && id == CLOCK_REALTIME ? fopen(path, "r") : NULL;
    long offset = 0;
    if (file) {
        if (fscanf(file, "%ld", &offset) == 1) now->tv_sec += offset;
        fclose(file);
    }
    return status;
}
"#;

/// Compiles the library, or returns `None` and prints a line without a C compiler.
fn shim(rig: &Rig) -> Option<PathBuf> {
    let (source, library) = (rig.file("shim.c", SHIM), rig.path("shim.so"));
    let built = Command::new("cc").args(["-shared", "-fPIC", "-o"]).arg(&library).arg(&source).status();
    if built.is_ok_and(|status| status.success()) {
        return Some(library);
    }
    eprintln!("left out: there is no C compiler");
    None
}

/// The output of `date` with the library, s since the epoch.
fn seconds(library: &Path, offset: &Path) -> i64 {
    let mut date = Command::new("date");
    let output = date.arg("+%s").env("LD_PRELOAD", library).env("TEST_CLOCK_OFFSET", offset).output().unwrap();
    String::from_utf8(output.stdout).unwrap().trim().parse().unwrap()
}

#[test]
fn a_clock_that_is_set_back_and_forth_costs_neither_frames_nor_shots() {
    let rig = Rig::new();
    let Some(library) = shim(&rig) else { return };
    let offset = rig.file("offset", "0");
    let scenario = rig.file("long.toml", &drift(20_000, 120.0));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", scenario.display());
    let rest = "[scale]\nmm_per_px = 0.5\n[workers]\ncount = 1\n\
                [trigger]\nmode = \"software\"\npre_s = 0.2\npost_s = 0.3";
    let config = rig.config(&camera, rest);
    let mut command = ricochet(["run".as_ref(), config.as_os_str()]);
    command.env("LD_PRELOAD", &library).env("TEST_CLOCK_OFFSET", &offset);
    let service = Background::start(command);
    let measured =
        |status: &serde_json::Value| process(status, "track", 0).map_or(0, |p| p["sequence"].as_u64().unwrap());
    let wait = |what: &str, from: u64| wait_until(what, || status(&rig.name).filter(|status| measured(status) > from));
    let before = seconds(&library, &offset);
    wait("it measures", 60);
    for (shot, step) in ["0", "-3600", "86400", "-40000000"].into_iter().enumerate() {
        rig.file("offset", step);
        let shift_s = seconds(&library, &offset) - before;
        assert!((shift_s - step.parse::<i64>().unwrap()).abs() < 600, "the clock is shifted by {shift_s} s for {step}");
        let now = measured(&wait("it answers", 0));
        wait("the rig still measures", now + 30);
        succeed(["trigger", "--rig", rig.name.as_str()]);
        wait_until("the shot is written", || (rig.recordings().len() == shot + 1).then_some(()));
        wait_until("it is armed again", || {
            let report = status(&rig.name)?;
            (process(&report, "record", 0)?["state"].as_u64() == Some(1)).then_some(())
        });
    }
    let after = wait("it answers", 0);
    for name in ["acquire", "correlate", "track", "record"] {
        let report = process(&after, name, 0).unwrap();
        assert_eq!((report["lost"].as_u64(), report["dropped"].as_u64()), (Some(0), Some(0)), "{name}: {after}");
    }
    assert_eq!(process(&after, "run", 0).unwrap()["restarts"].as_u64(), Some(0), "{after}");
    service.signal(2);
    let (code, _, stderr) = service.end();
    assert_eq!(code, Some(0), "nothing was lost: {stderr}");
    for path in rig.recordings() {
        let metas: Vec<_> = frames(&path).into_iter().map(|(meta, _)| meta).collect();
        assert!(metas.len() >= 36, "{} frames", metas.len());
        for pair in metas.windows(2) {
            assert_eq!(pair[1].sequence, pair[0].sequence + 1);
            let apart_ns = pair[1].stamp_ns.abs_diff(pair[0].stamp_ns);
            assert!((8_000_000..9_000_000).contains(&apart_ns), "{apart_ns} ns between frames at 120 Hz");
        }
    }
}
