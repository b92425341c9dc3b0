//! Several users on one computer: none can see, stop or falsify the rig of another. Needs the administrator, who can be any.

use super::{armed, number, pid, record_a_drop, running};
use crate::support::{Background, Rig, complaints, kill, process, ricochet, run, status, wait_until};
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Another user: nobody.
const OTHER: u32 = 65534;

/// The program as another user; `None` without the right to become one.
fn as_other(arguments: &[&str]) -> Option<Command> {
    let user = Command::new("id").arg("-u").output().ok()?;
    if user.stdout != b"0\n" {
        eprintln!("left out: only the administrator can become another user");
        return None;
    }
    let mut command = Command::new("setpriv");
    let identity = [format!("--reuid={OTHER}"), format!("--regid={OTHER}"), "--clear-groups".into()];
    command.args(identity).args(arguments).env_remove("XDG_RUNTIME_DIR").stdin(std::process::Stdio::null());
    Some(command)
}

fn copy_for_all(program: &Path, target: &Path) {
    std::fs::copy(program, target).unwrap();
    std::fs::set_permissions(target, PermissionsExt::from_mode(0o755)).unwrap();
}

fn output(arguments: &[&str]) -> Option<Output> {
    as_other(arguments).map(|mut command| command.output().unwrap())
}

#[test]
fn two_users_run_a_rig_of_the_same_name_at_the_same_time() {
    let rig = Rig::new();
    let Some(mut theirs) = as_other(&[]) else { return };
    let folder = rig.path("theirs");
    std::fs::create_dir(&folder).unwrap();
    let open = |path: &Path, mode| std::fs::set_permissions(path, PermissionsExt::from_mode(mode)).unwrap();
    [folder.parent().unwrap(), &folder].iter().for_each(|path| open(path, 0o777));
    let program = rig.path("ricochet");
    copy_for_all(Path::new(env!("CARGO_BIN_EXE_ricochet")), &program);
    let config = armed(&rig);
    let text = std::fs::read_to_string(&config).unwrap().replace("/shots", "/theirs/shots");
    let their_config = rig.file("theirs.toml", &text);
    let ours = super::start(&config);
    theirs.arg(&program).arg("run").arg(&their_config);
    let theirs = Background::start(theirs);
    running(&rig, 40);
    let theirs_status = wait_until("the rig of the other user measures", || {
        let output = output(&[program.to_str().unwrap(), "status", "--rig", &rig.name, "--json"])?;
        let status =
            output.status.success().then(|| serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap())?;
        (number(&status, "track", "sequence") > 40).then_some(status)
    });
    let our_status = status(&rig.name).unwrap();
    assert_ne!(pid(&our_status, "run"), pid(&theirs_status, "run"));
    record_a_drop(&rig);
    let triggered = output(&[program.to_str().unwrap(), "trigger", "--rig", &rig.name]).unwrap();
    assert!(triggered.status.success(), "{}", String::from_utf8_lossy(&triggered.stderr));
    wait_until("their drop is recorded", || {
        let mut entries = std::fs::read_dir(folder.join("shots")).ok()?.flatten();
        entries.any(|entry| entry.path().extension().is_some_and(|name| name == "mcap")).then_some(())
    });
    assert_eq!(rig.recordings().len(), 1, "their trigger is not ours");
    theirs.signal(2);
    ours.signal(2);
    for (name, service) in [("theirs", theirs), ("ours", ours)] {
        let (code, _, stderr) = service.end();
        assert_eq!((code, complaints(&stderr)), (Some(0), vec![]), "{name}");
    }
}

#[test]
fn nothing_of_a_rig_can_be_opened_by_another_user() {
    let rig = Rig::new();
    let config = armed(&rig);
    let service = super::start(&config);
    let before = running(&rig, 40);
    let acquire = pid(&before, "acquire");
    let maps = std::fs::read_to_string(format!("/proc/{acquire}/maps")).unwrap();
    let mut shared: Vec<&str> = maps.lines().filter_map(|line| line.split_whitespace().nth(5)).collect();
    shared.retain(|path| path.starts_with("/dev/shm/"));
    shared.dedup();
    assert!(shared.len() > 5, "{shared:?}");
    let prefix = shared[0].split('_').next().unwrap();
    let entries = std::fs::read_dir("/dev/shm").unwrap().flatten();
    let own: Vec<_> =
        entries.map(|entry| entry.path()).filter(|path| path.to_str().unwrap().starts_with(prefix)).collect();
    assert!(own.len() >= shared.len());
    for path in &own {
        // Files of readers come and go.
        let Ok(found) = path.metadata() else { continue };
        assert_eq!(found.mode() & 0o077, 0, "{path:?} is open to others");
    }
    // No name that a process of the rig takes can be known before.
    let table = std::fs::read_to_string("/proc/net/unix").unwrap();
    assert!(!table.contains("@ricochet"), "no address that anyone can take");
    service.signal(2);
    assert_eq!(service.end().0, Some(0));
    assert!(own.iter().all(|path| !path.exists()), "something is left in shared memory");
}

#[test]
fn a_runtime_folder_of_another_user_is_refused() {
    let rig = Rig::new();
    let config = armed(&rig);
    let folder = rig.path("runtime");
    std::fs::create_dir(&folder).unwrap();
    std::fs::set_permissions(&folder, PermissionsExt::from_mode(0o777)).unwrap();
    let started = |path: &Path| {
        let output = ricochet(["run".as_ref(), config.as_os_str()]).env("RICOCHET_RUNTIME_DIR", path).output().unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    let (code, stderr) = started(&folder);
    assert_eq!(code, Some(4), "{stderr}");
    assert!(stderr.contains("others can enter it (mode 777, must be 700)"), "{stderr}");
    let link = rig.path("link");
    std::os::unix::fs::symlink(&folder, &link).unwrap();
    assert!(started(&link).1.contains("it is no folder"));
    if std::os::unix::fs::chown(&folder, Some(OTHER), None).is_ok() {
        let (code, stderr) = started(&folder);
        assert_eq!(code, Some(4), "{stderr}");
        assert!(stderr.contains(&format!("it belongs to user {OTHER}, not to user")), "{stderr}");
    }
}

#[test]
fn a_configuration_of_the_bus_library_in_the_working_directory_changes_nothing() {
    let rig = Rig::new();
    let config = armed(&rig);
    std::fs::create_dir(rig.path("config")).unwrap();
    rig.file("config/iceoryx2.toml", "[global]\nroot-path = \"/nowhere\"\nprefix = \"other_\"\n");
    let mut command = ricochet(["run".as_ref(), config.as_os_str()]);
    command.current_dir(rig.path(""));
    let service = Background::start(command);
    let found = running(&rig, 40);
    let inside = ricochet(["status", "--rig", &rig.name, "--json"]).current_dir(rig.path("")).output().unwrap();
    let inside: serde_json::Value = serde_json::from_slice(&inside.stdout).unwrap();
    assert_eq!(process(&inside, "run", 0).unwrap()["pid"], process(&found, "run", 0).unwrap()["pid"]);
    service.signal(2);
    assert_eq!(service.end().0, Some(0));
}

#[test]
fn a_role_cannot_be_taken_from_outside() {
    let rig = Rig::new();
    let config = armed(&rig);
    let service = super::start(&config);
    let before = running(&rig, 40);
    let second = run(["record".as_ref(), config.as_os_str()]);
    assert_eq!(second.status.code(), Some(4), "{}", String::from_utf8_lossy(&second.stderr));
    kill(pid(&before, "record"), 9);
    wait_until("the successor takes the role", || {
        (pid(&status(&rig.name)?, "record") != pid(&before, "record")).then_some(())
    });
    record_a_drop(&rig);
    service.signal(2);
    assert_eq!(service.end().0, Some(6));
}

/// The files of a folder and all folders in it.
fn files_below(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    entries.flat_map(|path| if path.is_dir() { files_below(&path) } else { vec![path] }).collect()
}

#[test]
fn the_reference_picture_of_a_patch_is_out_of_reach_for_others() {
    let rig = Rig::new();
    if as_other(&[]).is_none() {
        return;
    }
    let scenario = rig.file("long.toml", &crate::pipeline::drift(60_000, 100.0));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", scenario.display());
    let patch = "[[body]]\nname = \"p\"\nkind = \"patch\"\npolygon_px = [[40, 50], [80, 50], [80, 84], [40, 84]]\n";
    let trigger = "[trigger]\nmode = \"software\"\npre_s = 0.3\npost_s = 0.4\nrearm = true";
    let config = rig.config(&camera, &format!("{patch}[scale]\nmm_per_px = 0.5\n[workers]\ncount = 2\n{trigger}"));
    let runtime = rig.path("runtime");
    std::fs::create_dir(&runtime).unwrap();
    std::fs::set_permissions(&runtime, PermissionsExt::from_mode(0o700)).unwrap();
    let on_rig = |arguments: &[&str]| {
        let mut command = ricochet(arguments);
        command.env("RICOCHET_RUNTIME_DIR", &runtime);
        command
    };
    let service = Background::start(on_rig(&["run", config.to_str().unwrap()]));
    let picture = wait_until("the picture is kept", || {
        files_below(&runtime).into_iter().find(|path| path.to_string_lossy().ends_with("reference.png"))
    });
    let before = std::fs::read(&picture).unwrap();
    let path = picture.to_str().unwrap();
    for attack in [
        format!("cat {path} > /dev/null"),
        format!("echo forged > {path}"),
        format!("rm -f {path} && mkfifo {path}"),
        format!("ln -sf /etc/passwd {path}"),
    ] {
        let output = output(&["sh", "-c", &format!("({attack}) 2>&1")]).unwrap();
        assert!(!output.status.success(), "{attack}");
        assert!(String::from_utf8_lossy(&output.stdout).contains("Permission denied"), "{attack}");
    }
    // Names that could be guessed hold nothing.
    let guessed = std::fs::read_dir(std::env::temp_dir()).unwrap().flatten();
    let of_rig = |entry: &std::fs::DirEntry| entry.file_name().to_string_lossy().contains("reference.png");
    assert_eq!(guessed.filter(of_rig).count(), 0);
    // A process that starts later measures against the picture that was kept.
    let status = || {
        let output = on_rig(&["status", "--rig", &rig.name, "--json"]).output().unwrap();
        output.status.success().then(|| serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap())
    };
    let worker = wait_until("a worker measures", || {
        let status = status()?;
        (number(&status, "track", "sequence") > 40).then(|| pid(&status, "correlate"))
    });
    kill(worker, 9);
    wait_until("its successor measures", || {
        let status = status()?;
        (pid(&status, "correlate") != worker && number(&status, "correlate", "given") > 20).then_some(())
    });
    assert_eq!(std::fs::read(&picture).unwrap(), before);
    service.signal(2);
    assert_eq!(service.end().0, Some(6));
    assert!(!picture.exists(), "the picture outlives its rig");
}
