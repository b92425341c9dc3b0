//! Errors of an import.

use crate::failure::{ExitCode, Fatal};
use std::path::{Path, PathBuf};

/// The reason why a file cannot be imported.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// No file was given.
    #[error("nothing to import: no file given")]
    Nothing,
    /// The operating system returned an error.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// The action that failed.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// The file has another format, or is damaged.
    #[error("cannot import {}: {reason}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// The problem, with expected and actual values.
        reason: String,
    },
    /// The frame rate is unknown or not a rate.
    #[error("unknown frame rate: {reason}")]
    FrameRate {
        /// The problem.
        reason: String,
    },
}

impl Fatal for ImportError {
    fn exit_code(&self) -> ExitCode {
        match self {
            Self::FrameRate { .. } | Self::Nothing => ExitCode::Usage,
            _ => ExitCode::Recording,
        }
    }
}

impl ImportError {
    /// Returns the error of a file with another format, or with damage.
    pub(super) fn invalid(path: &Path, reason: impl Into<String>) -> Self {
        Self::Invalid { path: path.to_path_buf(), reason: reason.into() }
    }

    /// Returns the error of the system in an action on a file.
    pub(super) fn io(action: &'static str, path: &Path, source: std::io::Error) -> Self {
        Self::Io { action, path: path.to_path_buf(), source }
    }
}
