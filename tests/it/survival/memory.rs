//! A full shared memory. Needs a memory of its own, which only the administrator can mount.

use super::{armed, number, pid, record_a_drop, running};
use crate::support::{Background, Rig, kill, run, status, wait_until};
use std::process::Command;

/// Runs this test alone in a program with a small `/dev/shm` of its own; returns whether it is that program.
fn has_own_memory(test: &str) -> bool {
    if std::env::var_os("RICOCHET_OWN_MEMORY").is_some() {
        return true;
    }
    let script = "mount -t tmpfs -o size=256m tmpfs /dev/shm || exit 77; exec \"$0\" --exact --nocapture \"$1\"";
    let program = std::env::current_exe().unwrap();
    let test = format!("survival::memory::{test}");
    let private = std::os::unix::fs::PermissionsExt::from_mode(0o700);
    let runtime = tempfile::Builder::new().permissions(private).tempdir().unwrap();
    let output = Command::new("unshare")
        .args(["--mount", "sh", "-c", script])
        .arg(program)
        .arg(&test)
        .env("RICOCHET_OWN_MEMORY", "1")
        .env("RICOCHET_RUNTIME_DIR", runtime.path())
        .output();
    match output {
        Ok(output) if output.status.code() == Some(77) || output.status.code() == Some(1) => {
            eprintln!("left out: no /dev/shm can be mounted: {}", String::from_utf8_lossy(&output.stderr));
        }
        Ok(output) => {
            let printed = String::from_utf8_lossy(&output.stdout);
            assert!(
                output.status.success() && printed.contains("1 passed"),
                "{printed}{}",
                String::from_utf8_lossy(&output.stderr)
            );
        }
        Err(error) => eprintln!("left out: unshare: {error}"),
    }
    false
}

/// Fills the memory up to some bytes.
fn fill(free_bytes: u64) {
    let free = || {
        let output = Command::new("df").args(["--output=avail", "-B1", "/dev/shm"]).output().unwrap();
        String::from_utf8(output.stdout).unwrap().lines().nth(1).unwrap().trim().parse::<u64>().unwrap()
    };
    // A rig may take some of it in between.
    wait_until("the memory is filled", || {
        let size = free().saturating_sub(free_bytes).to_string();
        let filled = Command::new("fallocate").args(["-l", &size, "/dev/shm/ballast"]).output().unwrap();
        filled.status.success().then_some(())
    });
}

#[test]
fn a_rig_that_does_not_fit_into_shared_memory_says_so_at_the_start() {
    if !has_own_memory("a_rig_that_does_not_fit_into_shared_memory_says_so_at_the_start") {
        return;
    }
    let rig = Rig::new();
    let config = armed(&rig);
    for free in [0, 20 << 20, 40 << 20] {
        fill(free);
        let output = run(["run".as_ref(), config.as_os_str()]);
        std::fs::remove_file("/dev/shm/ballast").unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(4), "{free} free: {stderr}");
        assert!(stderr.contains("shared memory is full: /dev/shm has") && stderr.contains("bytes free"), "{stderr}");
        assert!(!stderr.contains("SIGBUS"), "{stderr}");
    }
}

#[test]
fn a_rig_outlives_a_memory_that_others_fill_and_a_process_that_dies_meanwhile() {
    if !has_own_memory("a_rig_outlives_a_memory_that_others_fill_and_a_process_that_dies_meanwhile") {
        return;
    }
    let rig = Rig::new();
    let config = armed(&rig);
    let service: Background = super::start(&config);
    let before = super::running(&rig, 40);
    fill(0);
    let tracker = pid(&before, "track");
    kill(tracker, 9);
    // No command joins a memory that is full.
    let refused = run(["status", "--rig", rig.name.as_str()]);
    assert_eq!(refused.status.code(), Some(4));
    std::thread::sleep(std::time::Duration::from_secs(2));
    std::fs::remove_file("/dev/shm/ballast").unwrap();
    let after = wait_until("the tracker is back", || {
        let status = status(&rig.name)?;
        (pid(&status, "track") != tracker && number(&status, "track", "given") > 0).then_some(status)
    });
    for role in ["acquire", "correlate", "record"] {
        assert_eq!(pid(&after, role), pid(&before, role), "{role} was not restarted");
    }
    record_a_drop(&rig);
    service.signal(2);
    let (code, _, stderr) = service.end();
    assert_eq!(code, Some(6), "{stderr}");
}

/// The memory of the process of a role that is locked, kB.
fn locked_kb(rig: &Rig, role: &str) -> u64 {
    let text = std::fs::read_to_string(format!("/proc/{}/status", pid(&running(rig, 40), role))).unwrap();
    let line = text.lines().find_map(|line| line.strip_prefix("VmLck:")).unwrap();
    line.trim().trim_end_matches(" kB").parse().unwrap()
}

#[test]
fn a_rig_without_a_limit_locks_its_memory() {
    for limit in ["unlimited", "1024"] {
        let rig = Rig::new();
        let config = armed(&rig);
        let mut command = Command::new("sh");
        command.args(["-c", &format!("ulimit -l {limit} || exit 77; exec \"$0\" run \"$1\"")]);
        let mut service = Background::start({
            command.arg(env!("CARGO_BIN_EXE_ricochet")).arg(&config);
            command
        });
        std::thread::sleep(std::time::Duration::from_millis(200));
        if service.0.try_wait().unwrap().is_some_and(|status| status.code() == Some(77)) {
            eprintln!("left out: only the administrator can raise the limit on locked memory");
            return;
        }
        for role in ["acquire", "correlate", "track", "record"] {
            assert_eq!(locked_kb(&rig, role) > 0, limit == "unlimited", "{role}, {limit}");
        }
        service.signal(2);
        assert_eq!(service.end().0, Some(0));
    }
}
