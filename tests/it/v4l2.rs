//! Real V4L2 cameras: a virtual machine boots the distribution's kernel with its virtual cameras and runs the tests of
//! `inside` in it.

mod drivers;
mod inside;
mod rig;
#[path = "../../src/camera/v4l2/jpeg/sample.rs"]
mod sample;

use std::path::{Path, PathBuf};
use std::process::Command;

/// The modules with the tests for the virtual machine.
const INSIDE: [&str; 2] = ["v4l2::inside::", "v4l2::rig::"];

/// Checks that `tests/vm/prepare.sh` has prepared the machine, or returns what is missing.
fn machine() -> Result<(), String> {
    let cache = std::env::var_os("XDG_CACHE_HOME").map(PathBuf::from).or_else(|| {
        let home = PathBuf::from(std::env::var_os("HOME")?);
        Some(home.join(".cache"))
    });
    for program in ["qemu-system-x86_64", "busybox", "cpio", "ldd", "strip"] {
        let found = std::env::var_os("PATH")
            .is_some_and(|path| std::env::split_paths(&path).any(|folder| folder.join(program).exists()));
        if !found {
            return Err(format!("no {program}"));
        }
    }
    let complete = cache.unwrap_or_default().join("ricochet-vm/current/complete");
    if complete.exists() { Ok(()) } else { Err("tests/vm/prepare.sh was not run".into()) }
}

/// The number of tests for the virtual machine.
fn tests_inside() -> usize {
    let list =
        Command::new(std::env::current_exe().unwrap()).args(INSIDE).args(["--ignored", "--list"]).output().unwrap();
    let count = String::from_utf8_lossy(&list.stdout).lines().filter(|line| line.ends_with(": test")).count();
    assert!(count > 5, "{count}");
    count
}

#[test]
fn v4l2_cameras_pass_their_tests_in_a_virtual_machine() {
    if let Err(reason) = machine() {
        assert!(
            std::env::var("RICOCHET_REQUIRE_VM").map_or(true, |value| value != "1"),
            "the virtual machine: {reason}"
        );
        println!("left out: the virtual machine needs qemu and what tests/vm/prepare.sh lays out ({reason})");
        return;
    }
    let boot = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/vm/boot.sh");
    let started = std::time::Instant::now();
    let output = Command::new(boot)
        .args(["--with", env!("CARGO_BIN_EXE_ricochet")])
        .arg(std::env::current_exe().unwrap())
        .args(INSIDE)
        .args(["--ignored", "--test-threads=1", "--nocapture"])
        .output()
        .unwrap();
    let console = String::from_utf8_lossy(&output.stdout);
    let errors = String::from_utf8_lossy(&output.stderr);
    println!("{console}{errors}in {:.1} s", started.elapsed().as_secs_f64());
    assert!(console.lines().any(|line| line.trim() == "RESULT 0"), "the machine reported no success");
    let passed = format!("test result: ok. {} passed", tests_inside());
    assert!(console.contains(&passed), "not all of its tests ran");
}

#[test]
fn the_bindings_equal_the_output_of_bindgen() {
    let room = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/camera/v4l2");
    let committed = std::fs::read_to_string(room.join("sys.rs")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let fresh = folder.path().join("sys.rs");
    let made = Command::new(room.join("generate.sh")).arg(&fresh).output().unwrap();
    let fresh = std::fs::read_to_string(fresh).unwrap_or_default();
    if !made.status.success() || fresh.lines().next() != committed.lines().next() {
        println!("left out: bindgen or the header are missing or of another version, {:?}", fresh.lines().next());
        return;
    }
    assert!(fresh == committed, "sys.rs differs: run generate.sh");
}
