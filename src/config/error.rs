//! What is wrong with a rig file, in one line.

use crate::failure::{ExitCode, Fatal};

/// Why a configuration was refused.
///
/// Every variant prints as one line that names the file, the key, the value and
/// what is allowed in its place.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read at all.
    #[error("read configuration {origin}: {reason}")]
    Unreadable {
        /// The file as it was named.
        origin: String,
        /// The system's answer.
        reason: String,
    },
    /// The text is not TOML.
    #[error("{origin}, line {line}: not TOML: {reason}")]
    Syntax {
        /// The file as it was named.
        origin: String,
        /// Line the parser stopped in, from 1.
        line: usize,
        /// The parser's words.
        reason: String,
    },
    /// A key that means nothing here.
    #[error("{origin}, line {line}: unknown key {key}; the nearest known key is {nearest}")]
    UnknownKey {
        /// The file as it was named.
        origin: String,
        /// Line of the key, from 1.
        line: usize,
        /// Path of the key, as `table.key`.
        key: String,
        /// Path of the known key that is spelled most like it.
        nearest: String,
    },
    /// A value of the wrong type, out of its range, or at odds with another one.
    #[error("{origin}, line {line}: {key} = {value}: must be {allowed}")]
    Value {
        /// The file as it was named.
        origin: String,
        /// Line of the value, from 1.
        line: usize,
        /// Path of the key.
        key: String,
        /// The value as it stands in the file, shortened to one line.
        value: String,
        /// The range with its unit, or the words there are.
        allowed: String,
    },
    /// A key without which the rest makes no sense.
    #[error("{origin}: {key} is missing: must be {allowed}")]
    Missing {
        /// The file as it was named.
        origin: String,
        /// Path of the key.
        key: String,
        /// The range with its unit, or the words there are.
        allowed: String,
    },
    /// A key that belongs to another setting than the one chosen.
    #[error("{origin}, line {line}: {key} = {value}: does not go with {settings}")]
    OutOfPlace {
        /// The file as it was named.
        origin: String,
        /// Line of the key, from 1.
        line: usize,
        /// Path of the key.
        key: String,
        /// The value as it stands in the file, shortened to one line.
        value: String,
        /// The setting it was met with, and the ones it belongs to.
        settings: String,
    },
    /// A setting of the file format that this version of the program cannot do.
    #[error("{origin}, line {line}: {what} is not offered by this version; {instead}")]
    NotOffered {
        /// The file as it was named.
        origin: String,
        /// Line of the key, from 1.
        line: usize,
        /// The setting, as `table.key = value` or `table [table]`.
        what: String,
        /// What to write instead.
        instead: String,
    },
}

impl Fatal for ConfigError {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Usage
    }
}
