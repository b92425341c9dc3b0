//! The Debian package: built from the tested program, installed into a root of its own, and removed without a trace.

use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

fn succeed(command: &mut Command) -> String {
    let output = command.output().unwrap();
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{command:?}: {printed}{}", String::from_utf8_lossy(&output.stderr));
    printed
}

fn dpkg(root: &Path) -> Command {
    let mut command = Command::new("dpkg");
    // The root has no shell and no libraries, so scripts run outside and depend on `DPKG_ROOT`.
    command.arg("--root").arg(root).args(["--force-depends", "--force-script-chrootless", "--force-not-root"]);
    command
}

/// Every file and folder below a root, but those of dpkg itself.
fn content(root: &Path) -> Vec<String> {
    let listed = succeed(Command::new("find").arg(root).args(["-mindepth", "1", "-not", "-path", "*/var*"]));
    let mut lines: Vec<String> = listed.lines().map(str::to_owned).collect();
    lines.sort();
    lines
}

fn is_debian() -> bool {
    Command::new("dpkg").arg("--version").output().is_ok()
}

#[test]
fn the_package_installs_runs_and_leaves_nothing() {
    if !is_debian() {
        return;
    }
    let folder = TempDir::new().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("packaging/debian.sh");
    succeed(Command::new(script).arg(env!("CARGO_BIN_EXE_ricochet")).arg(folder.path()));
    let package: PathBuf =
        std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path()).find(|p| p.is_file()).unwrap();
    let root = folder.path().join("root");
    std::fs::create_dir_all(root.join("var/lib/dpkg/info")).unwrap();
    std::fs::create_dir_all(root.join("var/lib/dpkg/updates")).unwrap();
    std::fs::write(root.join("var/lib/dpkg/status"), "").unwrap();
    let before = content(&root);
    succeed(dpkg(&root).arg("--install").arg(&package));
    let program = root.join("usr/bin/ricochet");
    assert!(succeed(Command::new(&program).arg("--version")).starts_with("ricochet "));
    let size = program.metadata().unwrap().len();
    assert!(size < 40 << 20, "{size} bytes, stripped");
    for file in [
        "usr/share/man/man1/ricochet.1.gz",
        "usr/share/man/man1/ricochet-analyze.1.gz",
        "usr/share/bash-completion/completions/ricochet",
        "lib/systemd/system/ricochet@.service",
        "lib/udev/rules.d/70-ricochet.rules",
        "usr/lib/sysctl.d/50-ricochet.conf",
        "usr/share/doc/ricochet/examples/lacrosse.toml",
    ] {
        assert!(root.join(file).exists(), "{file} is not installed");
    }
    let unit = std::fs::read_to_string(root.join("lib/systemd/system/ricochet@.service")).unwrap();
    assert!(unit.contains("ExecStart=/usr/bin/ricochet run"), "{unit}");
    succeed(dpkg(&root).args(["--purge", "ricochet"]));
    assert_eq!(content(&root), before);
}
