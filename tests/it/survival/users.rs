//! Several users on one computer: none can see, stop or falsify the rig of another. Needs the administrator, who can be any.

use super::{armed, number, pid, record_a_drop, running};
use crate::support::{Background, Rig, complaints, kill, process, ricochet, run, status, wait_until};
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::Path;
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
