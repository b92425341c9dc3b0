//! The rig file, into which shapes are drawn.

use crate::config::{Config, DrawingError, Shape};
use std::fs::{self, File};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// The rig file that the rig was started with.
#[derive(Debug)]
pub(super) struct RigFile {
    path: PathBuf,
    /// The name of the file in messages.
    name: String,
    /// Shapes are written one at a time.
    writing: Mutex<()>,
}

/// A shape that is not written, or a file that is not read.
#[derive(Debug, thiserror::Error)]
pub(super) enum RigFileError {
    /// The file is not the one that the shape was drawn for.
    #[error("{name} has changed since the shape was drawn, so nothing is written; look at it and draw again")]
    Changed { name: String },
    /// The shape does not fit the rig.
    #[error(transparent)]
    Drawing(#[from] DrawingError),
    /// The file cannot be read or written.
    #[error("cannot use {name}: {reason}")]
    Io { name: String, reason: io::Error },
}

/// The shapes of a rig file.
#[derive(Debug)]
pub(super) struct Drawn {
    pub(super) shapes: Vec<Shape>,
    /// A text that is another one for another content of the file.
    pub(super) revision: String,
}

/// A shape that was written.
#[derive(Debug)]
pub(super) struct Written {
    /// The name of the file.
    pub(super) file: String,
    /// The value that the shape is.
    pub(super) path: String,
    /// The revision of the file now.
    pub(super) revision: String,
}

impl RigFile {
    /// Finds the file that describes a rig; `None` if there is none, or it describes another rig by now.
    ///
    /// Rigs from recordings and demonstrations have the name of a file, but not its content.
    pub(super) fn find(config: &Config) -> Option<Self> {
        let loaded = Config::load(&config.origin).ok().filter(|loaded| loaded.text == config.text)?;
        let path = fs::canonicalize(&loaded.origin).ok().filter(|path| path.is_file())?;
        Some(Self { path, name: loaded.origin, writing: Mutex::default() })
    }

    /// Reads the shapes of the file as it is now.
    ///
    /// # Errors
    ///
    /// [`RigFileError`] when the file cannot be read or is refused.
    pub(super) fn shapes(&self) -> Result<Drawn, RigFileError> {
        let revision = revision_of(&self.read()?);
        let config = Config::load(&self.name).map_err(DrawingError::from)?;
        Ok(Drawn { shapes: config.shapes(), revision })
    }

    /// Writes a shape to the file, if the file has this revision and passes the checks with the shape.
    ///
    /// # Errors
    ///
    /// [`RigFileError`]. The file is then as it was.
    pub(super) fn write_shape(
        &self,
        revision: &str,
        shape: &Shape,
        frame_px: Option<(u32, u32)>,
    ) -> Result<Written, RigFileError> {
        let _turn = self.writing.lock().unwrap_or_else(PoisonError::into_inner);
        let text = self.read()?;
        if revision_of(&text) != revision {
            return Err(RigFileError::Changed { name: self.name.clone() });
        }
        let (changed, _) = Config::with_shape(&text, &self.name, shape, frame_px)?;
        let replaced = replace_file(&self.path, &text, &changed).map_err(|reason| self.io_error(reason))?;
        if !replaced {
            return Err(RigFileError::Changed { name: self.name.clone() });
        }
        Ok(Written { file: self.name.clone(), path: shape.key.path(), revision: revision_of(&changed) })
    }

    /// Reads the text of the file.
    fn read(&self) -> Result<String, RigFileError> {
        fs::read_to_string(&self.path).map_err(|reason| self.io_error(reason))
    }

    /// Returns the error for a failure of the file system.
    fn io_error(&self, reason: io::Error) -> RigFileError {
        RigFileError::Io { name: self.name.clone(), reason }
    }
}

/// Returns a text that is another one for another content.
fn revision_of(text: &str) -> String {
    let mut hasher = DefaultHasher::new();
    text.hash(&mut hasher);
    format!("{:016x}", hasher.finish())
}

/// Replaces the content of a file at once: a reader finds the old or the new one, also after a power cut. Returns
/// whether the file was still the `old` one; otherwise it stays as it is.
fn replace_file(path: &Path, old: &str, new: &str) -> io::Result<bool> {
    let temporary = path.with_extension(format!("{}.part", std::process::id()));
    let replaced = write_copy(&temporary, path, new).and_then(|()| {
        let is_same = fs::read_to_string(path)? == old;
        if is_same {
            fs::rename(&temporary, path)?;
        }
        Ok(is_same)
    });
    if !matches!(replaced, Ok(true)) {
        // It may not exist.
        let _ = fs::remove_file(&temporary);
    } else if let Some(folder) = path.parent() {
        // The file is replaced, and at worst a power cut undoes that.
        let _ = File::open(folder).and_then(|folder| folder.sync_all());
    }
    replaced
}

/// Writes a new file with the permissions of another one, to the disk.
fn write_copy(copy: &Path, original: &Path, text: &str) -> io::Result<()> {
    let permissions = fs::metadata(original)?.permissions();
    let mut file = File::create_new(copy)?;
    file.set_permissions(permissions)?;
    file.write_all(text.as_bytes())?;
    file.sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::ShapeKey;
    use std::os::unix::fs::PermissionsExt;

    const FILE: &str =
        "[camera]\nsource = \"simulated\"\n[surface]\n# the plate\nedge = [[0, 90], [99, 90]] # measured\n";

    fn edge(y_px: f64) -> Shape {
        Shape { key: ShapeKey::Edge, points_px: vec![[0.0, y_px], [99.0, y_px]] }
    }

    /// A folder with a rig file, and that file.
    fn rig_file() -> (tempfile::TempDir, PathBuf, RigFile) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.toml");
        fs::write(&path, FILE).unwrap();
        let file = RigFile::find(&Config::load(&path).unwrap()).unwrap();
        (folder, path, file)
    }

    #[test]
    fn a_shape_is_written_once_for_each_revision_with_the_permissions_of_the_file() {
        let (folder, path, file) = rig_file();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
        let drawn = file.shapes().unwrap();
        assert!(drawn.shapes.contains(&edge(90.0)));
        let written = file.write_shape(&drawn.revision, &edge(80.0), Some((100, 100))).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        assert_eq!(text, FILE.replace("[[0, 90], [99, 90]]", "[[0.0, 80.0], [99.0, 80.0]]"));
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o640);
        assert!(matches!(file.write_shape(&drawn.revision, &edge(70.0), None), Err(RigFileError::Changed { .. })));
        file.write_shape(&written.revision, &edge(70.0), None).unwrap();
        let names: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(names, ["rig.toml"]);
    }

    #[test]
    fn a_refused_shape_leaves_the_file_as_it_was() {
        let (_folder, path, file) = rig_file();
        let revision = file.shapes().unwrap().revision;
        assert!(matches!(file.write_shape(&revision, &edge(100.0), Some((100, 100))), Err(RigFileError::Drawing(_))));
        let steep = Shape { key: ShapeKey::Edge, points_px: vec![[5.0, 5.0], [5.0, 5.2]] };
        assert!(matches!(file.write_shape(&revision, &steep, None), Err(RigFileError::Drawing(_))));
        assert_eq!(fs::read_to_string(&path).unwrap(), FILE);
        assert!(!replace_file(&path, "another text", "new").unwrap());
        assert_eq!(fs::read_to_string(&path).unwrap(), FILE);
    }

    #[test]
    fn a_rig_that_its_file_does_not_describe_has_no_rig_file() {
        let (_folder, path, _) = rig_file();
        let config = Config::load(&path).unwrap();
        assert!(RigFile::find(&config.with(&[("rig.name", "other".into())]).unwrap()).is_none());
        assert!(RigFile::find(&Config::parse(FILE, "demo").unwrap()).is_none());
    }
}
