//! Texts for users, compared word by word.
//!
//! After an intended change, `RICOCHET_WRITE_GOLDEN=1 cargo test --release golden` rewrites the files of
//! `tests/golden/`. The diff then shows what changed. The texts hold no versions, paths or times.

use crate::support::{ricochet, succeed};
use std::path::{Path, PathBuf};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden")
}

/// Compares a text with its file, or writes the file.
fn is_golden(name: &str, text: &str) {
    let path = folder().join(name);
    if std::env::var_os("RICOCHET_WRITE_GOLDEN").is_some_and(|value| value == "1") {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{name}: {error}"));
    assert_eq!(text, kept, "{name} differs; see the head of tests/it/golden.rs");
}

#[test]
fn golden_help_of_every_command() {
    let commands = crate::cli::commands();
    is_golden("help/ricochet.txt", &succeed(["--help"]));
    for command in &commands {
        is_golden(&format!("help/{command}.txt"), &succeed([command.as_str(), "--help"]));
    }
    let kept = std::fs::read_dir(folder().join("help")).unwrap();
    let mut kept: Vec<String> =
        kept.map(|entry| entry.unwrap().path().file_stem().unwrap().to_str().unwrap().to_owned()).collect();
    kept.retain(|name| name != "ricochet");
    kept.sort();
    let mut listed = commands;
    listed.sort();
    assert_eq!(kept, listed, "a file for each command and no other");
}

#[test]
fn golden_info_of_the_recorded_shot() {
    let recordings = Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings");
    let output = ricochet(["info", "lacrosse.mcap"]).current_dir(recordings).output().unwrap();
    assert!(output.status.success());
    let text = String::from_utf8(output.stdout).unwrap();
    // The versions of this program and of its library belong to the file and not to this text.
    let lines = text.lines().map(|line| match line.split_once(" = ") {
        Some((name, _)) if name.ends_with(": version") => format!("{name} = (version)\n"),
        _ if line.starts_with("written by") => "written by    (library)\n".to_owned(),
        _ => format!("{line}\n"),
    });
    is_golden("info-lacrosse.txt", &lines.collect::<String>());
}
