//! Forty things that a newcomer tries: each ends soon, says what to do, loses nothing and leaves nothing.
//!
//! A row is one trial. Its line runs in a shell, in a folder with `film.mcap`, `film.mp4`, `results.mcap`, `cut.mcap`,
//! `rig.toml` and the images in `frames`. Trials that other tests make are in [`ELSEWHERE`].

use crate::interrupted::inputs;
use crate::phone_film::has_ffmpeg;
use crate::support::Rig;
use std::collections::BTreeMap;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

/// The time that a trial may take, s; all end much sooner on a machine that does nothing else.
const LIMIT_S: f64 = 15.0;

/// A trial.
struct Row {
    tries: &'static str,
    line: &'static str,
    code: i32,
    /// A part of what is printed.
    says: &'static str,
    /// The files that it makes.
    makes: &'static [&'static str],
}

const fn refused(tries: &'static str, line: &'static str, code: i32, says: &'static str) -> Row {
    Row { tries, line, code, says, makes: &[] }
}

const fn done(tries: &'static str, line: &'static str, says: &'static str, makes: &'static [&'static str]) -> Row {
    Row { tries, line, code: 0, says, makes }
}

/// The program as another user, who may not write here.
macro_rules! as_nobody {
    ($line:literal) => {
        concat!("setpriv --reuid=65534 --regid=65534 --clear-groups ./ricochet ", $line)
    };
}

const ROWS: &[Row] = &[
    refused("nothing", "ricochet", 2, "Exit codes:"),
    done("help", "ricochet --help | head -1", "Measures an impact", &[]),
    refused("a film without a command", "ricochet film.mcap", 2, "a command is missing: `ricochet analyze film.mcap`"),
    refused("a rig file without a command", "ricochet rig.toml", 2, "`ricochet run rig.toml`"),
    refused("a wrong spelling", "ricochet analyse film.mcap", 2, "'analyze'"),
    refused("a command without a film", "ricochet analyze", 2, "were not provided"),
    refused("a film that is not there", "ricochet analyze drop.mp4 --config rig.toml", 5, "drop.mp4: No such file"),
    refused("a rig file as a film", "ricochet analyze rig.toml", 5, "it is a rig file, not a film"),
    refused("a film as a rig file", "ricochet run film.mcap", 2, "not a text file"),
    refused("a rig file to replay", "ricochet replay rig.toml", 5, "it is a rig file, not a film"),
    refused("an empty recording", ": > e.mcap; ricochet info e.mcap; c=$?; rm e.mcap; exit $c", 5, "the file is empty"),
    refused(
        "an empty film",
        ": > e.mp4; ricochet analyze e.mp4 --config rig.toml; c=$?; rm e.mp4; exit $c",
        5,
        "the file is empty",
    ),
    refused("a text file", "ricochet info /etc/hosts", 5, "not an MCAP file"),
    refused("a folder", "ricochet info .", 5, "it is a folder"),
    refused("an address", "ricochet analyze https://example.com/a.mp4 --config rig.toml", 5, "download the film"),
    refused("an address as a recording", "ricochet info https://example.com/a.mcap", 5, "download the film"),
    refused(
        "a pipe",
        "mkfifo p.mcap; ricochet analyze p.mcap; c=$?; rm p.mcap; exit $c",
        5,
        "it is a pipe or a device",
    ),
    refused(
        "a pipe as a film",
        "mkfifo p.mp4; ricochet import p.mp4 --fps 9 -o a.mcap; c=$?; rm p.mp4; exit $c",
        5,
        "it is a pipe or a device",
    ),
    refused("a device", "ricochet info /dev/zero", 5, "it is a pipe or a device"),
    refused("a phone film without a rig file", "ricochet analyze film.mp4", 2, "pass a rig file with --config"),
    refused("images without a rate", "ricochet import frames -o a.mcap", 2, "pass --fps"),
    refused("a decimal comma", "ricochet setup film.mp4 --diameter-mm 63,25 -o a.toml", 2, "decimals follow a point"),
    refused(
        "a decimal comma in a file",
        "printf '[scale]\\nmm_per_px = 0,5\\n' > c.toml; ricochet config check c.toml; c=$?; rm c.toml; exit $c",
        2,
        "line 2: not TOML: unexpected key or value, expected newline, `#`; decimals follow a point",
    ),
    refused("a negative rate", "ricochet import film.mp4 --fps -240 -o a.mcap", 2, "must be above 0"),
    refused("a negative diameter", "ricochet setup film.mp4 --diameter-mm -3 -o a.toml", 2, "must be above 0"),
    refused("a huge rate", "ricochet analyze film.mp4 --fps 1e300 --config rig.toml", 2, "at most 1e9"),
    refused("no rate", "ricochet analyze film.mcap --fps 0", 2, "must be above 0"),
    refused("more workers than there are", "ricochet analyze film.mcap --workers 99999999999", 2, "1..=64"),
    refused("a part behind the end", "ricochet analyze film.mcap --from 5", 2, "--from and --to are seconds"),
    refused("a folder that is not there", "ricochet analyze film.mcap -o no/a.mcap", 5, "its folder does not exist"),
    refused("a table in such a folder", "ricochet report film.mcap -o no/a.html", 5, "its folder does not exist"),
    refused("to overwrite its film", "ricochet analyze film.mcap -o film.mcap", 2, "already exists"),
    refused(
        "to overwrite a page",
        "touch p.html; ricochet report film.mcap -o p.html; c=$?; rm p.html; exit $c",
        2,
        "--force",
    ),
    refused(
        "a table as a spreadsheet",
        "ricochet export results.mcap --topic track -o a.xlsx",
        2,
        "writes no .xlsx file",
    ),
    refused("an unknown topic", "ricochet export results.mcap --topic speed", 2, "not one of velocity"),
    done("to export before it measures", "ricochet export frames.mcap --topic impact", "has no impact", &[]),
    refused("to measure results", "ricochet analyze results.mcap", 5, "no image topic"),
    refused("to trigger no rig", "ricochet trigger --rig nobody", 4, "start it with `ricochet run`"),
    refused("to ask about no rig", "ricochet status", 2, "`ricochet run` starts one"),
    refused("questions without a terminal", "ricochet init -o a.toml < /dev/null", 2, "pass --defaults"),
    done(
        "the first line",
        "ricochet export results.mcap --topic velocity | head -1; exit ${PIPESTATUS[0]}",
        "frame,",
        &[],
    ),
    refused("a full disk for a table", "ricochet export results.mcap --topic track > /dev/full", 5, "No space left"),
    refused(
        "a disk that is full",
        "ricochet simulate lacrosse -o small/a.mcap; c=$?; rm small/*; exit $c",
        5,
        "No space left",
    ),
    done(
        "spaces and umlauts",
        "mkdir 'Größe 1'; cp film.mcap 'Größe 1/ä ö.mcap'; ricochet analyze 'Größe 1/ä ö.mcap'; c=$?; \
         ls 'Größe 1'; rm -r 'Größe 1'; exit $c",
        "ä ö.results-1.mcap",
        &[],
    ),
    done("another locale", "LC_ALL=de_DE.UTF-8 ricochet export results.mcap --topic impact", ",0.7977", &[]),
    refused(
        "a second instance",
        "printf '[rig]\\nname = \"slow\"\\n[camera]\\nsource = \"recording\"\\nid = \"film.mcap\"\\nplayback_rate = 1e-3\\n[scale]\\n\
         mm_per_px = 0.5142\\n[[body]]\\nname = \"ball\"\\ndiameter_mm = 63.25\\n' > slow.toml; \
         ricochet run slow.toml > said 2>&1 & p=$!; until ricochet status > listed 2>&1; do sleep .05; done; \
         timeout 10 ricochet run slow.toml; c=$?; kill $p; wait $p; rm -rf slow.toml said listed shots; exit $c",
        4,
        "has a process `ricochet run` already; stop it",
    ),
    refused(
        "a place that cannot be written",
        "mount -t tmpfs -o ro tmpfs small; ricochet analyze film.mcap -o small/a.mcap",
        5,
        "Read-only file system",
    ),
    done(
        "a home that cannot be written",
        "mount -t tmpfs -o ro tmpfs small; HOME=$PWD/small ricochet analyze film.mcap -o a.mcap",
        "100 of 100",
        &["a.mcap"],
    ),
    refused("a part before the beginning", "ricochet analyze film.mcap --from -1", 2, "--from"),
    refused("an empty folder to merge", "mkdir e; ricochet merge e; c=$?; rmdir e; exit $c", 2, "holds no recording"),
    done("no home", "HOME=/nowhere ricochet analyze film.mcap -o a.mcap", "100 of 100", &["a.mcap"]),
    done("no file descriptors", "ricochet info film.mcap <&-", "complete      yes", &[]),
    refused("a place that is not his", as_nobody!("analyze film.mcap -o a.mcap"), 5, "Permission denied"),
    refused(
        "a film that is not his",
        concat!("cp film.mcap n.mcap; chmod 0 n.mcap; ", as_nobody!("info n.mcap"), "; c=$?; rm n.mcap; exit $c"),
        5,
        "Permission denied",
    ),
    refused(
        "the folder of another user",
        "mkdir -m 755 other; RICOCHET_RUNTIME_DIR=$PWD/other ricochet run rig.toml; c=$?; rm -r other; exit $c",
        4,
        "only you can enter",
    ),
];

/// Trials of other tests.
const ELSEWHERE: &[(&str, &str)] = &[
    ("Ctrl-C at any moment", "a_command_on_files_ends_at_once_at_a_signal_and_leaves_nothing_unfinished"),
    ("Ctrl-C of a rig", "a_rig_ends_in_order_at_a_signal_whatever_it_does"),
    ("kill -9 of a rig", "a_rig_that_is_started_right_after_its_supervisor_was_killed_records_the_next_drop"),
    ("leftover shared memory", "a_supervisor_killed_while_it_starts_leaves_no_process"),
    ("a second user", "two_users_run_a_rig_of_the_same_name_at_the_same_time"),
    ("too little shared memory", "a_rig_that_does_not_fit_into_shared_memory_says_so_at_the_start"),
    ("a disk that fills during a shot", "a_shot_on_a_full_disk_keeps_what_fits_and_the_next_is_complete"),
    ("a film of which nothing moves", "a_film_in_which_nothing_moves_gets_no_rig_file"),
    ("a recording that was cut off", "a_truncated_recording_is_measured_up_to_the_cut"),
    ("a wrong rig file", "a_wrong_rig_file_is_refused_with_file_line_key_value_and_range"),
];

/// The files below a folder, with their sizes.
fn listing(folder: &Path) -> BTreeMap<PathBuf, u64> {
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        match entry.path() {
            path if path.is_dir() => found.extend(listing(&path)),
            path => drop(found.insert(path, entry.metadata().map_or(0, |about| about.len()))),
        }
    }
    found
}

/// The inputs of all commands, and what only these trials need.
fn workplace() -> Rig {
    let rig = inputs();
    let folder = rig.path("");
    std::os::unix::fs::symlink(env!("CARGO_BIN_EXE_ricochet"), rig.path("bin")).unwrap();
    // Another user may not enter the folder of the build.
    std::fs::copy(env!("CARGO_BIN_EXE_ricochet"), rig.path("ricochet")).unwrap();
    std::fs::set_permissions(&folder, PermissionsExt::from_mode(0o755)).unwrap();
    let line = ["import", "frames", "--fps", "10000", "-o", "frames.mcap"];
    let made = Command::new(rig.path("ricochet")).args(line).current_dir(&folder).output().unwrap();
    assert!(made.status.success(), "{made:?}");
    std::fs::create_dir(rig.path("small")).unwrap();
    rig
}

/// Whether this test may mount a file system and become another user.
fn is_administrator() -> bool {
    let trial = "mount -t tmpfs -o size=1M tmpfs /mnt && setpriv --reuid=65534 --regid=65534 --clear-groups true";
    Command::new("unshare").args(["-m", "sh", "-c", trial]).output().is_ok_and(|output| output.status.success())
}

/// Makes a trial and returns its line for the table, and what is wrong with it.
fn attempt(rig: &Rig, row: &Row) -> (String, Option<String>) {
    let folder = rig.path("");
    let runtime = tempfile::Builder::new().prefix("r").tempdir_in("/tmp").unwrap();
    std::fs::set_permissions(runtime.path(), PermissionsExt::from_mode(0o700)).unwrap();
    let before = listing(&folder);
    // A small disk of its own, which ends with the trial.
    let script = format!("mount -t tmpfs -o size=100k tmpfs small; {}", row.line);
    let path = format!("{}:{}", folder.display(), std::env::var("PATH").unwrap());
    let began = Instant::now();
    let output = Command::new("timeout")
        .args(["-k", "1", &LIMIT_S.to_string(), "unshare", "-m", "bash", "-c", &script])
        .current_dir(&folder)
        .env("PATH", path)
        .env("RICOCHET_RUNTIME_DIR", runtime.path())
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let took_s = began.elapsed().as_secs_f64();
    let printed = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
    let last = printed.lines().rfind(|line| !line.is_empty()).unwrap_or_default().to_owned();
    let code = output.status.code();
    let mut after = listing(&folder);
    let made: Vec<&str> = row.makes.iter().copied().filter(|name| after.remove(&rig.path(name)).is_some()).collect();
    for name in &made {
        std::fs::remove_file(rig.path(name)).unwrap();
    }
    let is_right = code == Some(row.code) && printed.contains(row.says) && after == before && made == row.makes;
    let is_calm = !printed.contains("panicked");
    let about: String = last.replace(&folder.display().to_string(), "").chars().take(90).collect();
    let line = format!("{:32} {:>4} {took_s:5.2} s  {about}", row.tries, code.unwrap_or(-1));
    let left: Vec<_> = after.keys().filter(|path| !before.contains_key(*path)).collect();
    let wrong = format!("{}: {code:?}, left {left:?}: {printed}", row.line);
    (line, (!is_right || !is_calm).then_some(wrong))
}

#[test]
fn what_a_newcomer_tries_ends_sensibly() {
    if !has_ffmpeg() {
        return;
    }
    if !is_administrator() {
        eprintln!("left out: only the administrator can mount a small disk and become another user");
        return;
    }
    let rig = workplace();
    let (lines, wrong): (Vec<_>, Vec<_>) = ROWS.iter().map(|row| attempt(&rig, row)).unzip();
    println!("{:32} code   time  says\n{}", "tries", lines.join("\n"));
    let wrong: Vec<String> = wrong.into_iter().flatten().collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(ROWS.len() + ELSEWHERE.len() >= 40);
}

#[test]
fn the_trials_of_other_tests_exist() {
    let listed = Command::new(std::env::current_exe().unwrap()).arg("--list").output().unwrap();
    let listed = String::from_utf8(listed.stdout).unwrap();
    for (trial, test) in ELSEWHERE {
        assert!(listed.contains(test), "{trial}: no test {test}");
    }
}

#[test]
fn progress_of_long_work_fits_forty_columns() {
    if !has_ffmpeg() {
        return;
    }
    let rig = inputs();
    for line in [
        "simulate tennis -o a.mcap",
        "recover cut.mcap -o b.mcap",
        "export results.mcap --topic field -o a.csv",
        "export results.mcap --topic track --format parquet -o a.parquet",
        "export results.mcap --topic velocity --format npz -o a.npz",
        "merge results.mcap results.mcap --topic velocity -o b.csv",
    ] {
        let line = format!("stty cols 40 rows 20; {} {line}", env!("CARGO_BIN_EXE_ricochet"));
        let mut terminal = Command::new("script");
        terminal.args(["-qec", &line, "/dev/null"]).stdin(Stdio::null()).current_dir(rig.path(""));
        let Ok(output) = terminal.output() else {
            eprintln!("left out: script is not installed");
            return;
        };
        let drawn = String::from_utf8_lossy(&output.stdout).into_owned();
        let plain = without_escapes(&drawn);
        let bars: Vec<&str> = plain.split(['\r', '\n']).filter(|line| line.contains("left")).collect();
        assert!(!bars.is_empty(), "{line}: {drawn:?}");
        for bar in bars {
            assert!(bar.chars().count() <= 40 && bar.contains('%'), "{line}: {bar:?}");
        }
    }
}

/// Removes what moves the cursor and sets colours.
fn without_escapes(text: &str) -> String {
    let mut plain = String::new();
    let mut letters = text.chars();
    while let Some(letter) = letters.next() {
        match letter {
            '\u{1b}' => drop(letters.by_ref().find(char::is_ascii_alphabetic)),
            letter => plain.push(letter),
        }
    }
    plain
}
