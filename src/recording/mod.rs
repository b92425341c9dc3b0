//! Recordings: the only room that names MCAP.

mod error;

pub use error::RecordingError;
