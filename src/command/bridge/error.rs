//! The errors of the bridge and of those who read from it.

use crate::failure::{ExitCode, Fatal};
use std::fmt::Display;

/// Zenoh cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("cannot {action} by Zenoh at {place}: {reason}")]
pub(super) struct BridgeError {
    action: &'static str,
    /// An endpoint or the path of a file.
    place: String,
    reason: String,
}

impl BridgeError {
    /// Wraps an error of Zenoh, whose type is not that of a standard error.
    pub(super) fn new<E: Display + ?Sized>(action: &'static str, place: &str, reason: &E) -> Self {
        let reason = reason.to_string();
        // The rest is the place in the source of Zenoh.
        let reason = reason.split(" at /").next().unwrap_or_default().trim_end_matches('.').to_owned();
        Self { action, place: place.into(), reason }
    }
}

impl Fatal for BridgeError {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Bus
    }
}

/// The rig of another host refused a request, or an error occurred there.
#[derive(Debug, thiserror::Error)]
#[error("{text}")]
pub(super) struct RemoteError {
    pub(super) text: String,
    pub(super) code: i32,
}

impl Fatal for RemoteError {
    fn exit_code(&self) -> ExitCode {
        ExitCode::from_number(self.code)
    }
}
