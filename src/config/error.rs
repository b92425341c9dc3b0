//! The error of a refused rig file.

use crate::failure::{ExitCode, Fatal};

/// A refused configuration.
///
/// It prints as one line with the file, the line, the key, the value and the allowed range.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConfigError {
    /// The file as it was named.
    pub origin: String,
    /// The line, from 1, where one is to blame.
    pub line: Option<usize>,
    /// The reason.
    pub problem: Box<Problem>,
}

/// The reason why a configuration is refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Problem {
    /// The file cannot be read.
    #[error("{0}")]
    Unreadable(String),
    /// The text is not TOML.
    #[error("not TOML: {0}")]
    Syntax(String),
    /// The key does not exist.
    #[error("unknown key {key}; the nearest known key is {nearest}")]
    UnknownKey {
        /// The key with its table.
        key: String,
        /// The known key with the most similar spelling.
        nearest: String,
    },
    /// The value has the wrong type, is out of range or contradicts another one.
    #[error("{key} = {value}: must be {allowed}")]
    Value {
        /// The key with its table.
        key: String,
        /// The value in the file, shortened to one line.
        value: String,
        /// The range with its unit, or the possible words.
        allowed: String,
    },
    /// A required key is missing.
    #[error("{key} is missing: must be {allowed}")]
    Missing {
        /// The key with its table.
        key: String,
        /// The range with its unit, or the possible words.
        allowed: String,
    },
    /// The key belongs to another setting than the chosen one.
    #[error("{key} = {value}: does not go with {chosen}; it belongs to {owners}")]
    Foreign {
        /// The key with its table.
        key: String,
        /// The value in the file, shortened to one line.
        value: String,
        /// The chosen setting.
        chosen: String,
        /// The settings that the key belongs to.
        owners: String,
    },
}

impl std::error::Error for ConfigError {}

impl std::fmt::Display for ConfigError {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { origin, line, problem } = self;
        match (problem.as_ref(), line) {
            (Problem::Unreadable(_), _) => write!(formatter, "cannot read {origin}: {problem}"),
            (_, Some(line)) => write!(formatter, "{origin}, line {line}: {problem}"),
            (_, None) => write!(formatter, "{origin}: {problem}"),
        }
    }
}

impl Fatal for ConfigError {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Usage
    }
}
