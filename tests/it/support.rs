//! A rig for tests: its own name and directory, the real program, clean-up.

use ricochet::recording::Recording;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// The longest wait of a failing test.
const PATIENCE: Duration = Duration::from_secs(90);

/// The table of a rig file that turns the page off.
pub const NO_PAGE: &str = "[serve]\nhttp = \"off\"\n";

static RIGS: AtomicU32 = AtomicU32::new(0);

/// A rig with its own name and directory.
pub struct Rig {
    pub name: String,
    directory: TempDir,
}

impl Rig {
    pub fn new() -> Self {
        let name = format!("t{}-{}", std::process::id(), RIGS.fetch_add(1, Ordering::Relaxed));
        Self { name, directory: TempDir::new().unwrap() }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    /// Writes a file and returns its path.
    pub fn file(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    /// Writes a rig file whose recordings go to the directory `shots`. It has no page unless `rest` gives it one, since
    /// many rigs run at a time.
    pub fn config(&self, camera: &str, rest: &str) -> PathBuf {
        let (name, shots) = (&self.name, self.path("shots"));
        let page = if rest.contains("[serve]") { "" } else { NO_PAGE };
        let text = format!(
            "[rig]\nname = \"{name}\"\n[camera]\n{camera}\n[record]\ndirectory = \"{}\"\n{rest}\n{page}",
            shots.display()
        );
        self.file("rig.toml", &text)
    }

    /// The recordings made so far, sorted by name.
    pub fn recordings(&self) -> Vec<PathBuf> {
        let Ok(entries) = std::fs::read_dir(self.path("shots")) else { return Vec::new() };
        let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
        paths.retain(|path| path.extension().is_some_and(|extension| extension == "mcap"));
        paths.sort();
        paths
    }
}

/// Settings that leave a camera as it is, to be completed.
pub fn camera_settings() -> ricochet::config::Camera {
    ricochet::config::Config::parse("[camera]\nsource = \"simulated\"\n", "rig.toml").unwrap().camera
}

/// The program with these arguments.
pub fn ricochet<S: AsRef<std::ffi::OsStr>>(arguments: impl IntoIterator<Item = S>) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ricochet"));
    command.args(arguments).stdin(Stdio::null());
    command
}

/// Runs the program to its end.
pub fn run<S: AsRef<std::ffi::OsStr>>(arguments: impl IntoIterator<Item = S>) -> Output {
    ricochet(arguments).output().unwrap()
}

/// Runs the program, which must succeed, and returns its standard output.
pub fn succeed<S: AsRef<std::ffi::OsStr>>(arguments: impl IntoIterator<Item = S>) -> String {
    let output = run(arguments);
    assert!(output.status.success(), "{}: {}", output.status, String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// Exports a topic of a recording as CSV.
pub fn csv(recording: &Path, topic: &str) -> String {
    succeed(["export".as_ref(), recording.as_os_str(), "--topic".as_ref(), topic.as_ref()])
}

/// Waits until a condition returns something, or fails after [`PATIENCE`].
pub fn wait_until<T>(what: &str, mut condition: impl FnMut() -> Option<T>) -> T {
    let started = Instant::now();
    loop {
        if let Some(value) = condition() {
            return value;
        }
        assert!(started.elapsed() < PATIENCE, "timed out waiting until {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// A program in the background, killed at the end of the test if it still runs.
pub struct Background(pub Child);

impl Background {
    pub fn start(mut command: Command) -> Self {
        Self(command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap())
    }

    pub fn signal(&self, signal: i32) {
        kill(self.0.id(), signal);
    }

    /// Waits for the end of the program and returns exit code, standard output and standard error.
    pub fn end(mut self) -> (Option<i32>, String, String) {
        let read = |pipe: &mut dyn Read| {
            let mut text = String::new();
            pipe.read_to_string(&mut text).unwrap();
            text
        };
        let (mut stdout, mut stderr) = (self.0.stdout.take().unwrap(), self.0.stderr.take().unwrap());
        let complaints = std::thread::spawn(move || {
            let mut text = String::new();
            stderr.read_to_string(&mut text).unwrap();
            text
        });
        let printed = read(&mut stdout);
        let status = wait_until("the program ends", || self.0.try_wait().unwrap());
        (status.code(), printed, complaints.join().unwrap())
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// `ricochet listen` in the background. Its samples are read all the time, so that it never waits for its reader.
pub struct Listener {
    program: Background,
    /// The number of samples that were read.
    read: Arc<AtomicUsize>,
    samples: std::thread::JoinHandle<Vec<(Instant, serde_json::Value)>>,
}

impl Listener {
    /// Listens to a topic from the start of the rig on.
    pub fn start(topic: &str, rig: &str) -> Self {
        Self::run(ricochet(["listen", topic, "--rig", rig, "--json", "--wait", "60"]))
    }

    /// Reads the rows that a command prints as JSON.
    pub fn run(command: Command) -> Self {
        let mut program = Background::start(command);
        let lines = BufReader::new(program.0.stdout.take().unwrap()).lines();
        let read = Arc::new(AtomicUsize::new(0));
        let count = Arc::clone(&read);
        let stamped = move |line: std::io::Result<String>| {
            count.fetch_add(1, Ordering::Relaxed);
            (Instant::now(), serde_json::from_str(&line.unwrap()).unwrap())
        };
        Self { program, read, samples: std::thread::spawn(move || lines.map(stamped).collect()) }
    }

    /// The number of samples so far.
    #[cfg_attr(not(feature = "zenoh"), expect(dead_code, reason = "tests of the bridge wait for rows"))]
    pub fn rows(&self) -> usize {
        self.read.load(Ordering::Relaxed)
    }

    /// Waits for the end of the stream and returns every sample with the time of its arrival.
    pub fn end(self) -> Vec<(Instant, serde_json::Value)> {
        self.end_with_code().0
    }

    /// Waits for the end of the stream and returns every sample with the time of its arrival, and the exit code.
    pub fn end_with_code(self) -> (Vec<(Instant, serde_json::Value)>, Option<i32>) {
        let (samples, code, _) = self.end_with_complaints();
        (samples, code)
    }

    /// The same, and its standard error.
    pub fn end_with_complaints(mut self) -> (Vec<(Instant, serde_json::Value)>, Option<i32>, String) {
        let status = wait_until("the listener ends", || self.program.0.try_wait().unwrap());
        let mut complaints = String::new();
        self.program.0.stderr.take().unwrap().read_to_string(&mut complaints).unwrap();
        (self.samples.join().unwrap(), status.code(), complaints)
    }
}

/// Sends a signal to a process of a rig.
pub fn kill(pid: u32, signal: i32) {
    send_signal(pid, signal).unwrap_or_else(|error| panic!("signal {signal} to {pid}: {error}"));
}

/// Sends a signal to a process, which may have ended.
pub fn send_signal(pid: u32, signal: i32) -> rustix::io::Result<()> {
    let pid = rustix::process::Pid::from_raw(pid.try_into().unwrap()).unwrap();
    rustix::process::kill_process(pid, rustix::process::Signal::from_named_raw(signal).unwrap())
}

/// `ricochet status --json`, once the rig answers.
pub fn status(rig: &str) -> Option<serde_json::Value> {
    let output = run(["status", "--rig", rig, "--json"]);
    output.status.success().then(|| serde_json::from_slice(&output.stdout).unwrap())
}

/// The entry of one process in a status.
pub fn process<'a>(status: &'a serde_json::Value, name: &str, index: u64) -> Option<&'a serde_json::Value> {
    let processes = status["processes"].as_array().unwrap();
    processes.iter().find(|process| process["process"] == name && process["index"] == index)
}

/// The frames of a recording.
pub fn frames(path: &Path) -> Vec<(ricochet::image::FrameMeta, Vec<u8>)> {
    Recording::open(path).unwrap().frames().unwrap().map(Result::unwrap).collect()
}

/// Runs a Python script with the packages that read recordings, or reports that the test was left out without them.
pub fn python(script: &str, arguments: &[&Path]) -> Option<String> {
    let importable = Command::new("python3").args(["-c", "import mcap, mcap_protobuf, mcap_ros2, numpy"]).output();
    if !importable.is_ok_and(|output| output.status.success()) {
        let required = is_required("PYTHON");
        assert!(
            !required,
            "python3 with mcap, mcap-protobuf-support, mcap-ros2-support and numpy is required but not installed"
        );
        eprintln!("left out: python3 with mcap, mcap-protobuf-support, mcap-ros2-support and numpy is not installed");
        return None;
    }
    let output = Command::new("python3").arg("-c").arg(script).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(String::from_utf8(output.stdout).unwrap())
}

/// The lines of a rig's standard error but those about its state and its shots.
pub fn complaints(stderr: &str) -> Vec<&str> {
    const USUAL: [&str; 6] = ["page: ", "filming: ", "ready: ", "disarmed: ", "shot ", "stopped: "];
    stderr.lines().filter(|line| !USUAL.iter().any(|usual| line.starts_with(usual))).collect()
}

/// Whether `RICOCHET_REQUIRE_name` makes a test fail when what it needs is missing.
pub fn is_required(name: &str) -> bool {
    std::env::var_os(format!("RICOCHET_REQUIRE_{name}")).is_some_and(|value| value == "1")
}
