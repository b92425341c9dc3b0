//! Output files and directories of a command.

use super::UsageError;
use crate::failure::{ExitCode, Failure, Fatal};
use crate::interrupt::{self, Unfinished};
use std::ffi::OsString;
use std::fmt::Display;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// An output that cannot be written.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("cannot write {to}: {reason}")]
pub struct WriteError {
    to: String,
    reason: String,
}

impl WriteError {
    /// Returns the error for a path, or for a stream by its name.
    pub fn new(to: impl AsRef<Path>, reason: impl Display) -> Self {
        Self { to: to.as_ref().display().to_string(), reason: reason.to_string() }
    }
}

impl Fatal for WriteError {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Recording
    }
}

/// The rule for outputs that exist.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::Args)]
pub struct Overwrite {
    /// Replace an output that exists.
    #[arg(short = 'y', long)]
    pub force: bool,
}

impl Overwrite {
    /// Refuses outputs that exist.
    pub const REFUSED: Self = Self { force: false };
    /// Replaces outputs that exist.
    pub const ALLOWED: Self = Self { force: true };

    /// Checks, before long work, that an output can be written.
    ///
    /// # Errors
    ///
    /// [`UsageError`] when it exists and is not to be replaced, or is a link or a directory, which are never replaced.
    pub fn check(self, path: &Path) -> Result<(), UsageError> {
        let refused = |reason: &str| Err(UsageError(format!("{}: cannot write: {reason}", path.display())));
        match path.symlink_metadata() {
            Err(_) => Ok(()),
            Ok(found) if found.is_symlink() => refused("it is a symbolic link; name the file itself"),
            Ok(found) if found.is_dir() => refused("it is a directory"),
            // A device or a pipe keeps nothing that could be lost.
            Ok(found) if !found.is_file() || self.force => Ok(()),
            Ok(_) => refused("the file already exists; choose another name, or pass --force to replace it"),
        }
    }
}

/// An output that has its name only once it is complete.
///
/// The bytes go to a new file next to it, `.NAME.part-PID`, which is removed if the work ends before
/// [`finish`](Self::finish).
#[derive(Debug)]
pub struct OutputFile {
    path: PathBuf,
    overwrite: Overwrite,
    /// The new file; the output itself where it is a device or a pipe.
    part: PathBuf,
    file: File,
    /// The note that removes the new file at a signal; `None` for a device or a pipe.
    _unfinished: Option<Unfinished>,
}

impl OutputFile {
    /// Creates the new file. A device or a pipe is opened itself.
    ///
    /// # Errors
    ///
    /// [`UsageError`] as [`Overwrite::check`]; [`WriteError`] when the directory takes no file.
    pub fn create(path: &Path, overwrite: Overwrite) -> Result<Self, Failure> {
        overwrite.check(path)?;
        let failed = |error: io::Error| match error.kind() {
            io::ErrorKind::NotFound => WriteError::new(path, "its folder does not exist; create it first"),
            _ => WriteError::new(path, error),
        };
        let is_special = path.symlink_metadata().is_ok_and(|found| !found.is_file());
        if is_special {
            let file = File::options().write(true).open(path).map_err(failed)?;
            return Ok(Self { file, path: path.to_owned(), overwrite, part: path.to_owned(), _unfinished: None });
        }
        let part = part_path(path).map_err(failed)?;
        let create = || File::options().write(true).create_new(true).open(&part);
        let (file, unfinished) = interrupt::file(&part, create).map_err(failed)?;
        Ok(Self { file, path: path.to_owned(), overwrite, part, _unfinished: Some(unfinished) })
    }

    /// Returns the path of the new file, for a program that writes it by name.
    pub fn part(&self) -> &Path {
        &self.part
    }

    /// Renames the complete file to its final name. A device or a pipe has it already.
    ///
    /// # Errors
    ///
    /// When another file has taken the name meanwhile, or the file cannot be renamed.
    pub fn finish(self) -> Result<(), Failure> {
        if self.part == self.path {
            return Ok(());
        }
        self.overwrite.check(&self.path)?;
        let failed = |error| WriteError::new(&self.path, error);
        Ok(std::fs::rename(&self.part, &self.path).map_err(failed)?)
    }
}

impl Write for OutputFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Drop for OutputFile {
    /// Removes an unfinished file. A finished one has another name by now.
    fn drop(&mut self) {
        if self.part != self.path {
            let _ = std::fs::remove_file(&self.part);
        }
    }
}

/// Returns the name of the new file next to `path`; the same for all outputs of this name in this process.
///
/// # Errors
///
/// When the path ends in no file name.
fn part_path(path: &Path) -> io::Result<PathBuf> {
    let name = path.file_name().ok_or_else(|| io::Error::other("the path names no file"))?;
    let mut part = OsString::from(".");
    part.push(name);
    part.push(format!(".part-{}", std::process::id()));
    Ok(path.with_file_name(part))
}

/// Writes a file as a whole: either all of it has the name afterwards, or nothing was changed.
///
/// # Errors
///
/// Errors of [`OutputFile::create`]; [`WriteError`] when there is no space.
pub fn write_file(path: &Path, bytes: impl AsRef<[u8]>, overwrite: Overwrite) -> Result<(), Failure> {
    let mut output = OutputFile::create(path, overwrite)?;
    output.write_all(bytes.as_ref()).map_err(|error| WriteError::new(path, error))?;
    output.finish()
}

/// Creates the directory of an option, and those above it, where they are missing. `option` names it in errors.
///
/// # Errors
///
/// When a file has this name, or the directory cannot be created.
pub fn create_directory(option: &str, path: &Path) -> Result<(), Failure> {
    if path.exists() && !path.is_dir() {
        return Err(UsageError(format!("{option} {}: is a file, expected a directory", path.display())).into());
    }
    Ok(std::fs::create_dir_all(path).map_err(|error| WriteError::new(path, error))?)
}

/// Checks that an output is none of the inputs.
///
/// # Errors
///
/// [`UsageError`] naming the file.
pub fn check_no_input<P: AsRef<Path>>(path: &Path, inputs: impl IntoIterator<Item = P>) -> Result<(), UsageError> {
    match inputs.into_iter().any(|input| is_same_file(path, input.as_ref())) {
        true => Err(UsageError(format!("{}: cannot write: it would overwrite an input", path.display()))),
        false => Ok(()),
    }
}

/// Whether both paths lead to the same existing file.
fn is_same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(directory: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(directory).unwrap();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn an_output_appears_whole_or_not_at_all() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.csv");
        let mut output = OutputFile::create(&path, Overwrite::REFUSED).unwrap();
        output.write_all(b"half").unwrap();
        assert!(!path.exists());
        drop(output);
        assert!(names(directory.path()).is_empty(), "nothing is left");
        write_file(&path, "whole", Overwrite::REFUSED).unwrap();
        assert_eq!(names(directory.path()), ["a.csv"]);
    }

    #[test]
    fn a_file_is_replaced_only_on_request_and_a_link_never() {
        let directory = tempfile::tempdir().unwrap();
        let [path, link] = ["a.csv", "b.csv"].map(|name| directory.path().join(name));
        write_file(&path, "old", Overwrite::REFUSED).unwrap();
        let refused = write_file(&path, "new", Overwrite::REFUSED).unwrap_err();
        assert!(refused.to_string().contains("--force"), "{refused}");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");
        write_file(&path, "new", Overwrite::ALLOWED).unwrap();
        std::os::unix::fs::symlink(&path, &link).unwrap();
        let refused = write_file(&link, "evil", Overwrite::ALLOWED).unwrap_err();
        assert!(refused.to_string().contains("symbolic link"), "{refused}");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "new");
    }

    #[test]
    fn a_device_takes_bytes_without_a_name() {
        write_file(Path::new("/dev/null"), "x", Overwrite::REFUSED).unwrap();
    }
}
