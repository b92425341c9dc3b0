//! The files that the fuzz targets start from, and those that once made one fail.
//!
//! `RICOCHET_WRITE_CORPUS=1` writes the first kind again.

use crate::import;
use crate::recording::{damage, mutation};
use ricochet::config::Config;
use ricochet::recording::Recording;
use std::path::{Path, PathBuf};

/// The kinds of files of the target `import`, in the order of its first byte.
const ENDINGS: [&str; 8] = ["cine", "tif", "npy", "npz", "cihx", "png", "jpg", "bmp"];

fn folder(target: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(target)
}

fn files(target: &str) -> Vec<PathBuf> {
    let mut files: Vec<_> = std::fs::read_dir(folder(target)).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

fn write_if_requested(target: &str, contents: impl IntoIterator<Item = Vec<u8>>) {
    if std::env::var_os("RICOCHET_WRITE_CORPUS").is_none() {
        return;
    }
    std::fs::create_dir_all(folder(target)).unwrap();
    for (k, content) in contents.into_iter().enumerate() {
        std::fs::write(folder(target).join(format!("seed-{k:02}")), content).unwrap();
    }
}

#[test]
fn every_recording_of_the_corpus_is_read_or_refused() {
    let temporary = tempfile::tempdir().unwrap();
    write_if_requested("recording", mutation::recordings(temporary.path()).into_iter().map(|(_, bytes)| bytes));
    let files = files("recording");
    let read = files.iter().filter_map(|path| Recording::open(path).ok());
    let frames: usize = read.map(|recording| damage::read_all(&recording).len()).sum();
    assert!(files.len() >= 7 && frames >= files.len(), "{frames} frames in {} files", files.len());
}

#[test]
fn every_film_of_the_corpus_is_read_or_refused() {
    let kind = |ending: &str| ENDINGS.iter().position(|known| Some(*known) == ending.strip_prefix('.'));
    let seed = |(ending, bytes): (&str, Vec<u8>)| Some([vec![kind(ending)? as u8], bytes].concat());
    write_if_requested("import", import::seeds().into_iter().filter_map(seed));
    let temporary = tempfile::tempdir().unwrap();
    let mut frames = 0;
    let files = files("import");
    for file in &files {
        let bytes = std::fs::read(file).unwrap();
        let (first, content) = bytes.split_first().unwrap();
        let path = temporary.path().join(format!("film.{}", ENDINGS[usize::from(*first) % ENDINGS.len()]));
        std::fs::write(&path, content).unwrap();
        let footage = ricochet::import::open(std::slice::from_ref(&path), Some(100.0));
        frames += footage.map_or(0, |footage| footage.take(64).filter(Result::is_ok).count());
        std::fs::remove_file(path).unwrap();
    }
    assert!(files.len() >= 16 && frames >= files.len(), "{frames} frames in {} files", files.len());
}

#[test]
fn every_rig_file_of_the_corpus_is_read_or_refused() {
    let examples = std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("config")).unwrap();
    let mut examples: Vec<_> = examples.map(|entry| entry.unwrap().path()).collect();
    examples.retain(|path| path.extension().is_some_and(|ending| ending == "toml"));
    examples.sort();
    write_if_requested("rig_file", examples.iter().map(|path| std::fs::read(path).unwrap()));
    let texts = files("rig_file").into_iter().map(|path| String::from_utf8(std::fs::read(path).unwrap()).unwrap());
    let read = texts.filter(|text| match Config::parse(text, "rig.toml") {
        Ok(_) => true,
        Err(error) => {
            assert!(error.to_string().contains("rig.toml"), "{error}");
            false
        }
    });
    assert!(read.count() >= 6);
}
