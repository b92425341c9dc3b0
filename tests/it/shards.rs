//! `analyze --shard` and `merge`: many films by several processes give the table of one process.

use crate::support::{Rig, ricochet, succeed};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

const FILMS: usize = 32;
const CONFIG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/config/lacrosse.toml");

/// Makes a list of films.
fn list(rig: &Rig) -> PathBuf {
    let film = rig.path("film.mcap");
    succeed(["simulate".as_ref(), "lacrosse".as_ref(), "-o".as_ref(), film.as_os_str()]);
    let names: Vec<PathBuf> = (0..FILMS).map(|k| rig.path(&format!("drop-{k:02}.mcap"))).collect();
    names.iter().for_each(|name| std::fs::hard_link(&film, name).unwrap());
    let lines: Vec<String> = names.iter().map(|name| name.display().to_string()).collect();
    rig.file("films.txt", &format!("# drops\n{}\n", lines.join("\n")))
}

fn analyze(list: &Path, folder: &Path, shard: &str) -> Command {
    let mut command = ricochet(["analyze"]);
    command
        .arg(list)
        .args(["--config", CONFIG, "--to", "0.0015", "--workers", "1", "--shard", shard, "-o"])
        .arg(folder);
    command.stdout(Stdio::null()).stderr(Stdio::piped());
    command
}

fn merged(folder: &Path, topic: &str) -> Vec<u8> {
    let output = ricochet(["merge"]).arg(folder).args(["--topic", topic]).output().unwrap();
    assert!(output.status.success(), "{output:?}");
    output.stdout
}

fn is_well(output: &Output) {
    assert!(output.status.success(), "{output:?}");
}

#[test]
fn four_processes_of_which_one_is_killed_give_the_table_of_one() {
    let rig = Rig::new();
    let list = list(&rig);
    let (single, shared) = (rig.path("single"), rig.path("shared"));
    is_well(&analyze(&list, &single, "1/1").output().unwrap());
    let mut shares: Vec<_> = (1..=4).map(|k| analyze(&list, &shared, &format!("{k}/4")).spawn().unwrap()).collect();
    // The second share dies when it has measured a film and is in the middle of another.
    crate::support::wait_until("a film of the second share", || (shared.join("drop-01.mcap").exists()).then_some(()));
    shares[1].kill().unwrap();
    for (k, share) in shares.into_iter().enumerate() {
        let output = share.wait_with_output().unwrap();
        assert_eq!(output.status.success(), k != 1, "share {}: {output:?}", k + 1);
    }
    is_well(&analyze(&list, &shared, "2/4").output().unwrap());
    for topic in ["velocity", "track"] {
        let (one, four) = (merged(&single, topic), merged(&shared, topic));
        assert!(one.starts_with(b"recording,"), "{topic}");
        assert!(String::from_utf8_lossy(&one).lines().count() > 10 * FILMS, "{topic}");
        assert!(one == four, "{topic}: the tables differ");
    }
}

#[test]
fn complete_results_are_skipped_and_others_are_not_mixed_with_them() {
    let rig = Rig::new();
    let film = rig.path("film.mcap");
    succeed(["simulate".as_ref(), "lacrosse".as_ref(), "-o".as_ref(), film.as_os_str()]);
    let folder = rig.path("results");
    is_well(&analyze(&film, &folder, "1/1").output().unwrap());
    let made = folder.join("film.mcap").metadata().unwrap().modified().unwrap();
    is_well(&analyze(&film, &folder, "1/1").output().unwrap());
    assert_eq!(folder.join("film.mcap").metadata().unwrap().modified().unwrap(), made, "measured again");
    let other = analyze(&film, &folder, "1/1").args(["--from", "0.0005"]).output().unwrap();
    assert_eq!(other.status.code(), Some(2), "{other:?}");
    assert!(String::from_utf8_lossy(&other.stderr).contains("of other settings"), "{other:?}");
}

#[test]
fn one_bad_film_does_not_keep_the_others_from_being_measured() {
    let rig = Rig::new();
    let film = rig.path("film.mcap");
    succeed(["simulate".as_ref(), "lacrosse".as_ref(), "-o".as_ref(), film.as_os_str()]);
    let bad = rig.file("bad.mcap", "not a recording");
    let list = rig.file("list.txt", &format!("{}\n{}\n", bad.display(), film.display()));
    let folder = rig.path("results");
    let output = analyze(&list, &folder, "1/1").output().unwrap();
    assert_eq!(output.status.code(), Some(5), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("1 of 2 films could not be measured"), "{output:?}");
    assert!(folder.join("film.mcap").exists());
    for (shard, reason) in [("0/4", "K/N"), ("5/4", "K/N"), ("x", "K/N")] {
        let output = analyze(&list, &folder, shard).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{shard}");
        assert!(String::from_utf8_lossy(&output.stderr).contains(reason), "{output:?}");
    }
}

#[test]
fn a_table_never_replaces_a_recording_that_it_is_made_from() {
    let rig = Rig::new();
    let film = rig.path("film.mcap");
    succeed(["simulate".as_ref(), "lacrosse".as_ref(), "-o".as_ref(), film.as_os_str()]);
    let before = std::fs::metadata(&film).unwrap().len();
    let output = ricochet(["merge", "--force"]).arg(&film).arg("-o").arg(&film).output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("overwrite an input"), "{output:?}");
    assert_eq!(std::fs::metadata(&film).unwrap().len(), before);
}
