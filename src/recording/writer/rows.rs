//! The rows of a recording, held back until they fill chunks of their own.

use super::RecordingWriter;
use crate::recording::rows::{EventRow, Row, StatusRow};
use crate::recording::schema::Topic;
use crate::recording::{Annotations, RecordingError};
use crate::results::{Impact, PairField, TrackSample, VelocitySample};

impl RecordingWriter {
    /// Adds a displacement field to those held back, and writes them if they are due.
    ///
    /// # Errors
    ///
    /// [`RecordingError::Io`] when the disk is full or gone. The methods below have the same errors.
    pub fn write_field(&mut self, field: &PairField) -> Result<(), RecordingError> {
        self.fields.push(self.camera, Topic::Field, field.stamp_ns, &field.to_message());
        self.write_due_batches(field.stamp_ns)
    }

    /// Writes a tracked position. Errors as [`write_field`](Self::write_field).
    pub fn write_track(&mut self, sample: &TrackSample) -> Result<(), RecordingError> {
        self.push_row(Topic::Track, sample.stamp_ns, sample)
    }

    /// Writes a velocity. Errors as [`write_field`](Self::write_field).
    ///
    /// # Examples
    ///
    /// ```
    /// use ricochet::recording::{Recording, RecordingInfo, RecordingWriter, WriterOptions};
    /// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
    /// # let folder = tempfile::tempdir()?;
    /// # let path = folder.path().join("shot.mcap");
    ///
    /// // Rows without frames are a recording too.
    /// let mut writer = RecordingWriter::create(&path, &RecordingInfo::default(), &WriterOptions::default())?;
    /// for sample in recording.truth()? {
    ///     writer.write_velocity(&sample?)?;
    /// }
    /// for impact in recording.truth_impacts()? {
    ///     writer.write_impact(&impact?)?;
    /// }
    /// # for track in recording.tracks()? {
    /// #     writer.write_track(&track?)?;
    /// # }
    /// # for field in recording.fields()? {
    /// #     writer.write_field(&field?)?;
    /// # }
    /// writer.finish()?;
    /// assert_eq!(Recording::open(&path)?.velocities()?.count(), 100);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn write_velocity(&mut self, sample: &VelocitySample) -> Result<(), RecordingError> {
        self.push_row(Topic::Velocity, sample.stamp_ns, sample)
    }

    /// Writes a true velocity of a simulated shot. Errors as [`write_field`](Self::write_field).
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn write_truth(&mut self, sample: &VelocitySample) -> Result<(), RecordingError> {
        self.push_row(Topic::Truth, sample.stamp_ns, sample)
    }

    /// Writes a collision, logged at its start. Errors as [`write_field`](Self::write_field).
    pub fn write_impact(&mut self, impact: &Impact) -> Result<(), RecordingError> {
        self.push_row(Topic::Impact, impact_time_ns(impact), impact)
    }

    /// Writes a true collision of a simulated shot. Errors as [`write_field`](Self::write_field).
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn write_truth_impact(&mut self, impact: &Impact) -> Result<(), RecordingError> {
        self.push_row(Topic::TruthImpact, impact_time_ns(impact), impact)
    }

    /// Writes an event. Errors as [`write_field`](Self::write_field).
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn write_event(&mut self, event: &EventRow) -> Result<(), RecordingError> {
        // Events belong to the whole rig.
        self.rows.push(0, Topic::Events, event.stamp_ns, &event.to_message());
        self.write_due_batches(event.stamp_ns)
    }

    /// Writes the status of a process. Errors as [`write_field`](Self::write_field).
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn write_status(&mut self, status: &StatusRow) -> Result<(), RecordingError> {
        self.push_row(Topic::Status, status.stamp_ns, status)
    }

    /// Writes the annotations of the frame with this stamp. Errors as [`write_field`](Self::write_field).
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn write_annotations(&mut self, stamp_ns: u64, annotations: &Annotations) -> Result<(), RecordingError> {
        self.fields.push(self.camera, Topic::Annotations, stamp_ns, &annotations.to_message(stamp_ns));
        self.write_due_batches(stamp_ns)
    }

    /// Adds a row of the selected camera to those held back, and writes them if they are due.
    fn push_row<R: Row>(&mut self, topic: Topic, log_time_ns: u64, row: &R) -> Result<(), RecordingError> {
        self.rows.push(self.camera, topic, log_time_ns, &row.to_message());
        self.write_due_batches(log_time_ns)
    }
}

/// Returns the log time of a collision, ns since the Unix epoch: its start, or the origin of its times while the start
/// is unknown or before the origin.
fn impact_time_ns(impact: &Impact) -> u64 {
    let start_ns = impact.start_s.map_or(0.0, |start| (start.value * 1e9).max(0.0));
    impact.origin_ns.saturating_add(start_ns as u64)
}
