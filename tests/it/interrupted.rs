//! Ctrl-C and the termination signal: each command, at five moments of its work.

use crate::phone_film::has_ffmpeg;
use crate::support::{Background, Rig, ricochet, run, succeed};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The time that a command may take to end: a second, and another for a machine that does other things too.
const LIMIT: Duration = Duration::from_secs(2);
/// The time that a rig may take: its processes start, or finish their frames, on a busy machine.
const RIG_LIMIT: Duration = Duration::from_secs(5);
/// The moments, as parts of the time that the command takes, and their signals: Ctrl-C and termination.
const MOMENTS: [(f64, i32); 5] = [(0.02, 2), (0.2, 15), (0.4, 2), (0.6, 15), (0.8, 2)];

/// A command that is interrupted.
struct Row {
    /// Its arguments. `OUT` is a new folder, `FRAMES` are the images of a film.
    line: &'static str,
    /// About the time that it takes, ms; the moments are spread over it.
    takes_ms: u64,
    end: End,
    /// The files that it may leave: those that the same command resumes from.
    leaves: &'static [&'static str],
}

/// The end of an interrupted command.
#[derive(PartialEq)]
enum End {
    /// A signal ends it, and nothing is left.
    AtOnce,
    /// It closes its camera, and ends with code 130.
    Closed,
    /// It ends its rig with code 0; every recording that it leaves is complete.
    Rig,
}

const fn row(line: &'static str, takes_ms: u64) -> Row {
    Row { line, takes_ms, end: End::AtOnce, leaves: &[] }
}

/// Commands that work on files.
const FILES: &[Row] = &[
    row("simulate lacrosse -o OUT/a.mcap", 200),
    row("import film.mp4 --fps 10000 -o OUT/a.mcap", 400),
    row("import frames --fps 10000 -o OUT/a.mcap", 100),
    row("analyze film.mcap -o OUT/a.mcap", 100),
    row("analyze film.mp4 --fps 10000 --config rig.toml -o OUT/a.mcap", 400),
    Row { leaves: &[".shard-1-of-1"], ..row("analyze film.mcap --shard 1/1 -o OUT", 100) },
    row("setup film.mp4 --fps 10000 --diameter-mm 63.25 -o OUT/rig.toml", 1500),
    row("diagnose film.mcap --config rig.toml -o OUT/page.html", 300),
    row("export results.mcap --topic field -o OUT/a.csv", 30),
    row("export results.mcap --film film.mcap --topic field --format png -o OUT", 500),
    row("export results.mcap --film film.mcap --topic field --format mp4 -o OUT/a.mp4", 1000),
    row("export film.mcap --topic results --format mcap -o OUT/a.mcap", 50),
    row("report results.mcap --film film.mcap -o OUT/a.html", 30),
    row("merge results.mcap --topic velocity -o OUT/a.csv", 20),
    row("recover cut.mcap -o OUT/a.mcap", 30),
    row("field FRAMES -o OUT --picture OUT", 1000),
];

/// Commands that compute, or examine the machine.
const COMPUTATIONS: &[Row] = &[
    row("bench windows", 1000),
    row("bench record --directory OUT", 700),
    row("study convergence -o OUT", 1000),
    row("study design --config rig.toml -o OUT", 1000),
    Row { leaves: &["rotation_films.csv", "rotation_settings.json"], ..row("study rotation -o OUT", 1000) },
    row("doctor rig.toml", 200),
    row("cameras", 1000),
];

/// Commands that run a camera or a rig.
const RIGS: &[Row] = &[
    Row { end: End::Closed, ..row("check rig.toml -o OUT/check.html", 400) },
    Row { end: End::Closed, ..row("demo lacrosse -o OUT", 900) },
    Row { end: End::Rig, ..row("run rig.toml", 900) },
    Row { end: End::Rig, ..row("replay film.mcap --loop -o OUT", 1500) },
    Row { end: End::Rig, ..row("serve rig.toml", 500) },
    Row { end: End::Rig, ..row("acquire rig.toml", 500) },
    Row { end: End::Rig, ..row("record rig.toml", 500) },
];

/// The files in a folder and its sub-folders.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    entries.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect()
}

/// The processes whose environment has this entry.
fn processes_with(entry: &str) -> Vec<String> {
    let processes = std::fs::read_dir("/proc").unwrap().flatten();
    let has_entry = |folder: &PathBuf| {
        let environment = std::fs::read(folder.join("environ")).unwrap_or_default();
        environment.split(|byte| *byte == 0).any(|line| line == entry.as_bytes())
    };
    let command = |folder: PathBuf| std::fs::read_to_string(folder.join("comm")).unwrap_or_default();
    processes.map(|process| process.path()).filter(has_entry).map(command).collect()
}

/// The folders of the rigs' shared memory in a runtime folder.
fn domains(runtime: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(runtime).into_iter().flatten().flatten();
    let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
    names.filter(|name| name != "rigs").collect()
}

/// A folder with a film in every form that the commands read.
pub fn inputs() -> Rig {
    let rig = Rig::new();
    let folder = rig.path("");
    let here = |line: &str| {
        let output = ricochet(line.split(' ')).current_dir(&folder).output().unwrap();
        assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
    };
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/lacrosse.toml");
    let text = std::fs::read_to_string(config).unwrap();
    rig.file("rig.toml", &text.replace("name = \"lacrosse\"", &format!("name = \"{}\"", rig.name)));
    here("simulate lacrosse -o film.mcap");
    here("analyze film.mcap -o results.mcap");
    here("export film.mcap --topic frames --format png -o frames");
    here("export film.mcap --topic frames --format mp4 -o film.mp4");
    let whole = std::fs::read(rig.path("film.mcap")).unwrap();
    std::fs::write(rig.path("cut.mcap"), &whole[..whole.len() - 100_000]).unwrap();
    rig
}

/// Interrupts a command at one moment; returns what is wrong with its end.
fn interrupt(inputs: &Rig, row: &Row, moment: (f64, i32)) -> Option<String> {
    let (share, signal) = moment;
    let out = tempfile::tempdir().unwrap();
    // Its path must be short.
    let private = std::fs::Permissions::from_mode(0o700);
    let runtime = tempfile::Builder::new().prefix("r").permissions(private).tempdir_in("/tmp").unwrap();
    let mut frames = files(&inputs.path("frames"));
    frames.sort();
    let frames = frames.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(" ");
    let line = row.line.replace("OUT", out.path().to_str().unwrap()).replace("FRAMES", &frames);
    let mut command = ricochet(line.split(' '));
    command.current_dir(inputs.path("")).env("RICOCHET_RUNTIME_DIR", runtime.path());
    let mut running = Background::start(command);
    // A moment of the command's work, not a wait for it.
    std::thread::sleep(Duration::from_secs_f64(share * row.takes_ms as f64 * 1e-3));
    let memory = domains(runtime.path());
    if running.0.try_wait().unwrap().is_some() {
        return None;
    }
    running.signal(signal);
    let sent = Instant::now();
    let (code, _, stderr) = running.end();
    let took = sent.elapsed();
    // It may have finished just before the signal came.
    let has_finished = code == Some(0) || row.end == End::AtOnce && code.is_some();
    let may_stay = |path: &PathBuf| {
        let is_resumed = row.leaves.iter().any(|name| path.ends_with(name));
        is_resumed || has_finished || is_complete(path)
    };
    let said = stderr.contains("ricochet: interrupted; ");
    // In its first millisecond it has nothing to say yet.
    let died = code.is_none() && (said || stderr.is_empty());
    let ends_well = match row.end {
        End::AtOnce => died,
        End::Closed => died || code == Some(130) && said,
        End::Rig => died && took < Duration::from_millis(50),
    };
    let mut left: Vec<PathBuf> = files(out.path()).into_iter().filter(|path| !may_stay(path)).collect();
    if !left.is_empty() {
        left.retain(|path| !is_as_uninterrupted(inputs, row, &frames, (out.path(), path)));
    }
    let mark = format!("RICOCHET_RUNTIME_DIR={}", runtime.path().display());
    // A killed program takes a moment to end.
    while !processes_with(&mark).is_empty() && sent.elapsed() < 2 * RIG_LIMIT {
        std::thread::sleep(Duration::from_millis(5));
    }
    let alive = processes_with(&mark);
    let limit = if row.end == End::AtOnce { LIMIT } else { RIG_LIMIT };
    let wrong = [
        (took > limit).then(|| format!("took {took:?}")),
        (!ends_well && !has_finished).then(|| format!("ended with {code:?}: {stderr}")),
        (!left.is_empty()).then(|| format!("left {left:?}")),
        (!alive.is_empty()).then(|| format!("{alive:?} live on")),
        memory.iter().any(|domain| is_in_memory(domain)).then(|| "left shared memory".to_owned()),
    ];
    let wrong: Vec<String> = wrong.into_iter().flatten().collect();
    (!wrong.is_empty()).then(|| format!("{} at {share}: {}", row.line, wrong.join("; ")))
}

/// Whether a file is a complete recording, or a drawing of one.
fn is_complete(path: &Path) -> bool {
    let ending = path.extension().unwrap_or_default();
    ending == "svg" || ending == "mcap" && run(["info".as_ref(), path.as_os_str()]).status.success()
}

/// Whether a file in `out` is what the same command writes without an interruption, which then came too late.
fn is_as_uninterrupted(inputs: &Rig, row: &Row, frames: &str, left: (&Path, &Path)) -> bool {
    let (out, path) = left;
    let whole = tempfile::tempdir().unwrap();
    let line = row.line.replace("OUT", whole.path().to_str().unwrap()).replace("FRAMES", frames);
    ricochet(line.split(' ')).current_dir(inputs.path("")).output().unwrap();
    let length = |path: &Path| std::fs::metadata(path).map(|about| about.len()).ok();
    let same = path.strip_prefix(out).ok().map(|name| whole.path().join(name));
    // All files of the command are there, and this one has its length.
    files(out).len() == files(whole.path()).len() && same.is_some_and(|same| length(&same) == length(path))
}

/// Whether shared memory of this domain exists.
fn is_in_memory(domain: &str) -> bool {
    let mut entries = std::fs::read_dir("/dev/shm").unwrap().flatten();
    entries.any(|entry| entry.file_name().to_string_lossy().starts_with(domain))
}

/// Interrupts each command at each moment.
fn check(rows: &[Row]) {
    if !has_ffmpeg() {
        return;
    }
    let inputs = inputs();
    let at_all = |row| MOMENTS.into_iter().filter_map(|moment| interrupt(&inputs, row, moment)).collect::<Vec<_>>();
    let failed: Vec<String> = rows.iter().flat_map(at_all).collect();
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

#[test]
fn a_command_on_files_ends_at_once_at_a_signal_and_leaves_nothing_unfinished() {
    check(FILES);
}

#[test]
fn a_computation_ends_at_once_at_a_signal_and_leaves_nothing_unfinished() {
    check(COMPUTATIONS);
}

#[test]
fn a_rig_ends_in_order_at_a_signal_whatever_it_does() {
    check(RIGS);
}

#[test]
fn an_interrupted_program_ends_by_the_signal_so_that_a_script_ends_too() {
    use std::os::unix::process::ExitStatusExt;
    let mut study = Background::start(ricochet(["bench", "windows"]));
    std::thread::sleep(Duration::from_millis(300));
    study.signal(2);
    let status = study.0.wait().unwrap();
    assert_eq!(status.signal(), Some(2), "{status}");
    assert!(succeed(["--help"]).contains("130"), "the table of exit codes has it");
}
