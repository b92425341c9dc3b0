//! Errors of a recording.

use crate::failure::{ExitCode, Fatal};
use std::path::{Path, PathBuf};

/// The reason why a recording cannot be written or read.
///
/// # Examples
///
/// ```
/// use ricochet::recording::{Recording, RecordingError};
///
/// let error = Recording::open("no-such-file.mcap".as_ref()).unwrap_err();
/// assert!(matches!(error, RecordingError::Io { action: "open", .. }));
/// // A file that is no recording.
/// let error = Recording::open("Cargo.lock".as_ref()).unwrap_err();
/// assert!(matches!(error, RecordingError::Invalid { .. }));
/// ```
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The operating system returned an error.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// The action that failed: "open", "write", "sync", "rename".
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// The file has another format, or is damaged.
    #[error("cannot read {}: {reason}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// The problem, with byte offset or expected and actual values.
        reason: String,
    },
    /// The data do not fit a recording, or the file would overwrite another.
    #[error("cannot write {}: {reason}", path.display())]
    Refused {
        /// The file.
        path: PathBuf,
        /// The problem.
        reason: String,
    },
}

impl Fatal for RecordingError {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Recording
    }
}

impl RecordingError {
    /// Returns the error of the system in an action on a file.
    pub(crate) fn io(action: &'static str, path: &Path, source: std::io::Error) -> Self {
        Self::Io { action, path: path.to_path_buf(), source }
    }

    /// Returns the error of a file with another format, or with damage.
    pub(crate) fn invalid(path: &Path, reason: impl Into<String>) -> Self {
        Self::Invalid { path: path.to_path_buf(), reason: reason.into() }
    }

    /// Returns the error of a file that must not be written.
    pub(crate) fn refused(path: &Path, reason: impl Into<String>) -> Self {
        Self::Refused { path: path.to_path_buf(), reason: reason.into() }
    }
}
