//! Programs and libraries that are opened when they are needed.

use super::Finding;
use crate::camera::genicam;
use std::path::{Path, PathBuf};

/// The folders in which systems install programs.
const FOLDERS: [&str; 3] = ["/usr/local/bin", "/usr/bin", "/bin"];

/// Examines the library Aravis and the program ffmpeg.
pub(super) fn examine() -> Vec<Finding> {
    vec![examine_aravis(), examine_ffmpeg()]
}

/// Examines whether the library for GenICam cameras opens.
fn examine_aravis() -> Finding {
    match genicam::library() {
        Ok(_) => Finding::good("Aravis", "GigE Vision and USB3 Vision cameras can be used"),
        Err(error) => Finding::advice(
            "Aravis",
            format!("{error}; only GigE Vision and USB3 Vision cameras need it"),
            "apt-get install libaravis-0.8-0",
        ),
    }
}

/// Examines whether ffmpeg and ffprobe are among the programs.
fn examine_ffmpeg() -> Finding {
    let paths = std::env::var_os("PATH").unwrap_or_default();
    let is_missing = |name: &&str| !std::env::split_paths(&paths).any(|folder: PathBuf| folder.join(name).is_file());
    let missing: Vec<&str> = ["ffmpeg", "ffprobe"].into_iter().filter(is_missing).collect();
    if missing.is_empty() {
        return Finding::good("ffmpeg", "films can be read and written");
    }
    let found = format!("no {}; films of AVI, MP4 and the like need it", missing.join(", no "));
    let has_all = |folder: &&&str| missing.iter().all(|name| Path::new(folder).join(name).is_file());
    let fix = match FOLDERS.iter().find(has_all) {
        Some(folder) => format!("export PATH=\"$PATH:{folder}\""),
        None => "apt-get install ffmpeg".to_owned(),
    };
    Finding::advice("ffmpeg", found, fix)
}
