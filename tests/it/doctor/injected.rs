//! Misconfigurations of the real machine, each in namespaces of its own: `doctor` finds each as a user without rights, and
//! the command that it prints, run as it is by the administrator, mends it.

use crate::support::Rig;
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::fs::PermissionsExt;
use std::process::{Child, Command, Stdio};

/// A misconfiguration.
struct Fault {
    /// The finding.
    name: &'static str,
    /// The line of a shell that makes it. `shots` is the folder of the recordings.
    breaks: &'static str,
    state: &'static str,
    /// A part of what is found.
    says: &'static str,
}

const fn bad(name: &'static str, breaks: &'static str, says: &'static str) -> Fault {
    Fault { name, breaks, state: "bad", says }
}

const fn advice(name: &'static str, breaks: &'static str, says: &'static str) -> Fault {
    Fault { name, breaks, state: "advice", says }
}

const FAULTS: &[Fault] = &[
    bad("shared memory", "mount -t tmpfs -o size=16M tmpfs /dev/shm", "16 MiB free"),
    bad("shared memory", "head -c 900M /dev/zero > /dev/shm/left", "MiB free"),
    bad("open files", "ulimit -S -n 256", "at most 256"),
    bad("recordings", "rmdir shots", "is not a folder"),
    bad("recordings", "chmod 555 shots", "Permission denied"),
    bad("recordings", "chown root shots; chmod 755 shots", "Permission denied"),
    bad(
        "recordings",
        "mount -t tmpfs tmpfs shots; chmod 777 shots; mount -o remount,ro shots",
        "Read-only file system",
    ),
    bad("private folder", "chmod 755 run", "others can enter it (mode 755"),
    bad("private folder", "chown root run", "it belongs to user 0"),
    bad("private folder", "rmdir run; touch run", "it is no folder"),
    bad("private folder", "export RICOCHET_RUNTIME_DIR=$PWD/a-folder-with-a-far-too-long-name", "longer than 35 bytes"),
    advice("real time", "ulimit -r 0", "is refused"),
    advice("processors", "taskset -pc 0 $$ > pinned", "1 usable"),
    advice("packets", "ip link set dev camera mtu 1500", "camera 1500"),
    advice("receive buffer", "mount --bind small /proc/sys/net/core/rmem_max", "at most 212992 bytes"),
    advice("ffmpeg", "export PATH=$PWD/tools", "no ffmpeg, no ffprobe"),
    bad("video devices", "mknod -m 600 /dev/video7 c 81 7", "no permission for /dev/video7"),
];

/// A well-configured machine: shared memory, an interface of a camera, and a folder of recordings, all private.
const MACHINE: &str = "set -e
mount -t tmpfs -o size=1G tmpfs dev
mkdir dev/shm
for device in null zero; do touch dev/$device; mount --bind /dev/$device dev/$device; done
mount --rbind dev /dev
mount -t tmpfs -o size=1G tmpfs /dev/shm
mount -t sysfs sysfs /sys
mount --bind large /proc/sys/net/core/rmem_max
ip link add camera type veth peer name other
ip link set camera mtu 9000 up
ip link set other mtu 9000 up
ulimit -n 1024
ulimit -r 50 2> said || true
chown 65534 shots run
chmod 700 shots run
export RICOCHET_RUNTIME_DIR=$PWD/run
set +e";

/// The program as a user without rights.
const DOCTOR: &str =
    "setpriv --reuid=65534 --regid=65534 --clear-groups ./ricochet doctor --json --directory \"$PWD/shots\"";

/// A shell of the administrator in namespaces of its own.
struct Shell {
    process: Child,
    answers: BufReader<std::process::ChildStdout>,
}

impl Shell {
    fn start(rig: &Rig) -> Self {
        let mut command = Command::new("unshare");
        command.args(["--mount", "--net", "sh"]).current_dir(rig.path(""));
        let mut process = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let answers = BufReader::new(process.stdout.take().unwrap());
        let mut shell = Self { process, answers };
        shell.run(MACHINE);
        shell
    }

    fn run(&mut self, line: &str) {
        writeln!(self.process.stdin.as_mut().unwrap(), "{line}").unwrap();
    }

    /// Returns the finding of this name.
    fn examine(&mut self, name: &str) -> Value {
        self.run(&format!("{DOCTOR} < /dev/null 2> said; echo"));
        let mut answer = String::new();
        while answer.trim().is_empty() {
            assert!(self.answers.read_line(&mut answer).unwrap() > 0, "{name}: the shell has ended");
        }
        let report: Value = serde_json::from_str(&answer).unwrap_or_else(|error| panic!("{error}: {answer}"));
        let findings = report["findings"].as_array().unwrap();
        findings.iter().find(|finding| finding["name"] == name).cloned().unwrap_or(Value::Null)
    }
}

impl Drop for Shell {
    fn drop(&mut self) {
        drop(self.process.stdin.take());
        let _ = self.process.wait();
    }
}

/// A folder with the program, which another user may enter.
fn workplace() -> Rig {
    let rig = Rig::new();
    std::fs::set_permissions(rig.path(""), PermissionsExt::from_mode(0o755)).unwrap();
    std::fs::copy(env!("CARGO_BIN_EXE_ricochet"), rig.path("ricochet")).unwrap();
    for folder in ["dev", "shots", "run", "tools"] {
        std::fs::create_dir(rig.path(folder)).unwrap();
    }
    // The path has neither ffmpeg nor ffprobe, but what the lines here need.
    for tool in ["setpriv", "rm", "chmod", "chown"] {
        let found = ["/usr/bin", "/bin"].into_iter().map(|folder| format!("{folder}/{tool}"));
        let found = found.into_iter().find(|path| std::path::Path::new(path).exists()).unwrap();
        std::os::unix::fs::symlink(found, rig.path("tools").join(tool)).unwrap();
    }
    rig.file("small", "212992\n");
    rig.file("large", "33554432\n");
    rig
}

/// Injects a fault; returns what is wrong with what `doctor` says of it, or with its command.
fn inject(fault: &Fault) -> Option<String> {
    let rig = workplace();
    let mut shell = Shell::start(&rig);
    let sound = shell.examine(fault.name);
    // Without a camera there is nothing to find.
    let is_sound = sound["state"] == "good" || fault.name == "video devices" && sound.is_null();
    shell.run(fault.breaks);
    let broken = shell.examine(fault.name);
    let found = broken["found"].as_str().unwrap_or_default().to_owned();
    let is_found = broken["state"] == fault.state && found.contains(fault.says);
    let fix = broken["fix"].as_str().unwrap_or("false").to_owned();
    shell.run(&format!("{{ {fix}; }} > mended"));
    let mended = shell.examine(fault.name);
    println!("{:16} {:60} {fix}", fault.name, fault.breaks);
    let is_mended = mended["state"] == "good";
    (!is_sound || !is_found || !is_mended).then(|| format!("{}: {sound}, then {broken}, then {mended}", fault.breaks))
}

/// Whether a misconfiguration can be made here: in namespaces of its own, as the administrator.
fn can_inject() -> bool {
    let trial = "mount -t tmpfs tmpfs /mnt && cd /mnt && mknod node c 81 7 && ip link add camera type veth peer name other && taskset -p $$ \
                 && setpriv --reuid=65534 --regid=65534 --clear-groups true";
    let trial = Command::new("unshare").args(["--mount", "--net", "sh", "-c", trial]).output();
    trial.is_ok_and(|output| output.status.success())
}

#[test]
fn each_misconfiguration_of_the_machine_is_found_and_mended() {
    if !can_inject() {
        eprintln!("left out: only an administrator with mount, ip, taskset and setpriv can misconfigure a machine");
        return;
    }
    let several = std::thread::available_parallelism().unwrap().get() > 1;
    let may_raise = Command::new("sh").args(["-c", "ulimit -r 50"]).output().unwrap().status.success();
    let has_ffmpeg = std::path::Path::new("/usr/bin/ffmpeg").exists();
    let possible = |fault: &&Fault| {
        let reason = match fault.name {
            "processors" if !several => "this machine has one processor",
            "real time" if !may_raise => "the administrator may not raise the limit of real-time priority here",
            "ffmpeg" if !has_ffmpeg => "ffmpeg is not installed",
            _ => return true,
        };
        eprintln!("left out: {}: {reason}", fault.breaks);
        false
    };
    let faults: Vec<&Fault> = FAULTS.iter().filter(possible).collect();
    let wrong: Vec<String> = faults.iter().filter_map(|fault| inject(fault)).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(faults.len() >= 10, "{} faults", faults.len());
}
