//! Output files and directories of a command.

use super::UsageError;
use crate::failure::{ExitCode, Failure, Fatal};
use std::fmt::Display;
use std::path::Path;

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

/// Writes a file, replacing an existing one.
///
/// # Errors
///
/// [`WriteError`] naming the file.
pub fn write_file(path: &Path, bytes: impl AsRef<[u8]>) -> Result<(), WriteError> {
    std::fs::write(path, bytes).map_err(|error| WriteError::new(path, error))
}

/// Creates the directory of an option if it is missing.
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

/// Checks that an output does not exist yet.
///
/// # Errors
///
/// [`UsageError`] naming the file.
pub fn check_absent(path: &Path) -> Result<(), UsageError> {
    match path.exists() {
        true => Err(UsageError(format!("{}: cannot write: the file already exists", path.display()))),
        false => Ok(()),
    }
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
