//! Failures of processes and commands, and the exit code that each error carries.

use std::error::Error;
use std::fmt;

/// The exit code of the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum ExitCode {
    /// An internal error.
    Internal = 1,
    /// Wrong usage or configuration.
    Usage = 2,
    /// A camera cannot be used.
    Camera = 3,
    /// The shared memory cannot be used.
    Bus = 4,
    /// A recording cannot be read or written.
    Recording = 5,
    /// Finished, but data were lost.
    DataLost = 6,
    /// Finished, but no body was measured in any frame, whatever was lost.
    NothingMeasured = 7,
    /// Interrupted before it was finished.
    Interrupted = 130,
}

impl ExitCode {
    /// Returns the code with this number, which a child process ended with; internal for any other number.
    pub fn from_number(number: i32) -> Self {
        let codes = [Self::Usage, Self::Camera, Self::Bus, Self::Recording, Self::DataLost, Self::NothingMeasured];
        codes.into_iter().find(|code| *code as i32 == number).unwrap_or(Self::Internal)
    }
}

impl From<ExitCode> for std::process::ExitCode {
    fn from(code: ExitCode) -> Self {
        Self::from(code as u8)
    }
}

/// An error that can end the program.
pub trait Fatal: Error + Send + Sync + 'static {
    /// Returns the exit code of the program.
    fn exit_code(&self) -> ExitCode {
        ExitCode::Internal
    }

    /// Whether another process has already printed the error.
    fn is_reported(&self) -> bool {
        false
    }
}

impl Fatal for std::io::Error {}

impl Fatal for std::string::FromUtf8Error {}

/// The error of a process or command.
#[derive(Debug)]
pub struct Failure {
    error: Box<dyn Error + Send + Sync>,
    exit_code: ExitCode,
    is_reported: bool,
}

impl Failure {
    /// Creates an internal failure with this message.
    pub fn internal(message: impl Into<String>) -> Self {
        Self { error: message.into().into(), exit_code: ExitCode::Internal, is_reported: false }
    }

    /// Returns the exit code of the program.
    pub fn exit_code(&self) -> ExitCode {
        self.exit_code
    }

    /// Whether another process has already printed the error.
    pub fn is_reported(&self) -> bool {
        self.is_reported
    }

    /// Whether the failure is this kind of error.
    pub fn is<E: Error + 'static>(&self) -> bool {
        self.error.is::<E>()
    }

    /// Whether the reader of the output, such as `head`, has closed it because it has enough.
    pub fn is_closed_output(&self) -> bool {
        let mut next: Option<&(dyn Error + 'static)> = Some(self.error.as_ref());
        while let Some(cause) = next {
            if cause
                .downcast_ref::<std::io::Error>()
                .is_some_and(|error| error.kind() == std::io::ErrorKind::BrokenPipe)
            {
                return true;
            }
            next = cause.source();
        }
        false
    }
}

impl<E: Fatal> From<E> for Failure {
    fn from(error: E) -> Self {
        Self { exit_code: error.exit_code(), is_reported: error.is_reported(), error: error.into() }
    }
}

impl fmt::Display for Failure {
    /// Writes the error and its causes in one line, without a cause that the line already ends with.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut line = String::new();
        let mut next: Option<&(dyn Error + 'static)> = Some(self.error.as_ref());
        while let Some(cause) = next {
            let mut text = cause.to_string();
            if text.contains('\n') {
                text = text.split_whitespace().collect::<Vec<_>>().join(" ");
            }
            if !line.ends_with(&text) {
                line += if line.is_empty() { "" } else { ": " };
                line += &text;
            }
            next = cause.source();
        }
        formatter.write_str(&line)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io;

    #[derive(Debug, thiserror::Error)]
    #[error("cannot open\n  the file")]
    struct Unreadable(#[source] io::Error);

    impl Fatal for Unreadable {
        fn exit_code(&self) -> ExitCode {
            ExitCode::Recording
        }
    }

    #[test]
    fn a_failure_carries_the_exit_code_of_its_error_and_shows_every_cause_once_in_one_line() {
        let failure = Failure::from(Unreadable(io::Error::other("disk error")));
        assert_eq!(failure.exit_code(), ExitCode::Recording);
        assert_eq!(failure.to_string(), "cannot open the file: disk error");
    }

    #[test]
    fn the_number_of_a_child_process_is_its_exit_code() {
        use ExitCode::{Camera, DataLost, Internal, NothingMeasured, Usage};
        for code in [Internal, Usage, Camera, DataLost, NothingMeasured] {
            assert_eq!(ExitCode::from_number(code as i32), code);
        }
        assert_eq!(ExitCode::from_number(101), ExitCode::Internal);
    }
}
