//! The facts of a recording that the strip of shots shows.

use crate::recording::{Recording, RecordingError};
use crate::report::{date, last_revisions};
use crate::results::Impact;
use std::path::Path;

/// The first collision of a recording, or the reason why there is none.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ShotFacts {
    pub(super) impact: Option<Impact>,
    /// The reason why there is no collision.
    pub(super) reason: Option<String>,
    /// The stamp of the first frame, ns since the Unix epoch; 0 when it is unknown.
    pub(super) stamp_ns: u64,
    /// The same as date and time of day.
    pub(super) time: String,
}

impl ShotFacts {
    /// Reads a recording. If it cannot be read, the error is the reason.
    pub(super) fn read(path: &Path) -> Self {
        Self::try_read(path).unwrap_or_else(|error| Self {
            impact: None,
            reason: Some(error.to_string()),
            stamp_ns: 0,
            time: String::new(),
        })
    }

    /// Reads the first collision, in its last revision, and the time of a recording: that of its first frame, or
    /// without frames the one in the metadata.
    fn try_read(path: &Path) -> Result<Self, RecordingError> {
        let recording = Recording::open(path)?;
        let impacts = last_revisions(recording.impacts()?.collect::<Result<Vec<_>, _>>()?);
        let stamp_ns = match recording.frame_count() {
            0 => recording.metadata().get("first_stamp_ns").and_then(|text| text.parse().ok()).unwrap_or(0),
            _ => recording.first_frame()?.stamp_ns,
        };
        let reason = impacts.is_empty().then(|| "no collision was found in this shot".to_owned());
        Ok(Self {
            impact: impacts.first().copied(),
            reason,
            stamp_ns,
            time: date(stamp_ns, recording.metadata()).unwrap_or_default(),
        })
    }
}
