//! Files that are read.

use std::fs::{self, File};
use std::io;
use std::path::Path;

/// Opens a file for reading.
///
/// # Errors
///
/// When it cannot be opened, is empty, or is no file: a folder, a pipe, which would wait for its writer, or an address.
pub fn open(path: &Path) -> io::Result<File> {
    if path.to_str().is_some_and(|text| text.contains("://")) {
        return Err(io::Error::other("it is an address; download the film, and name that file"));
    }
    let found = fs::metadata(path)?;
    if found.is_dir() {
        return Err(io::Error::other("it is a folder; name the file in it"));
    }
    if !found.is_file() {
        return Err(io::Error::other("it is a pipe or a device; save the data as a file first"));
    }
    if found.len() == 0 {
        return Err(io::Error::other("the file is empty"));
    }
    if path.extension().is_some_and(|ending| ending == "toml") {
        return Err(io::Error::other("it is a rig file, not a film; pass it with --config"));
    }
    File::open(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_film_is_refused_with_what_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let [empty, rig, film] = ["empty.mp4", "rig.toml", "film.mp4"].map(|name| folder.path().join(name));
        fs::write(&empty, "").unwrap();
        fs::write(&rig, "[rig]").unwrap();
        fs::write(&film, "film").unwrap();
        let reason = |path: &Path| open(path).unwrap_err().to_string();
        assert!(reason(&empty).contains("empty") && reason(&rig).contains("--config"));
        assert!(reason(folder.path()).contains("folder") && reason(Path::new("/dev/null")).contains("device"));
        assert!(reason(Path::new("https://example.com/a.mp4")).contains("download"));
        assert!(open(&film).is_ok());
    }
}
