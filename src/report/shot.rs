//! The content of a recording that its page shows, read in one pass over the frames.

use super::picture::{self, Crop};
use crate::image::{FrameMeta, FrameRuns};
use crate::recording::{EventRow, Recording, RecordingError};
use crate::results::{Impact, PairField, TrackSample, VelocitySample};
use std::collections::BTreeMap;
use std::path::Path;

/// Maximum number of collisions with pictures. The numbers of all are shown.
const MAX_PICTURED_IMPACTS: usize = 4;

/// Half the side of a picture, in radii of the body.
const CROP_RADII: f64 = 1.35;

/// The moments of a collision with a picture: column and title.
const MOMENTS: [(&str, &str); 3] = [("start_s", "Contact starts"), ("deepest_s", "Deepest"), ("end_s", "Contact ends")];

/// A recording, reduced to the content of its page.
#[derive(Debug)]
pub struct Shot {
    pub(super) name: String,
    pub(super) metadata: BTreeMap<String, String>,
    pub(super) config_toml: Option<String>,
    pub(super) library: String,
    pub(super) truncated: Option<String>,
    pub(super) bodies: Vec<(u32, String)>,
    pub(super) frames: FilmSummary,
    /// The origin of `t_s`, ns since the Unix epoch.
    pub(super) origin_ns: u64,
    pub(super) velocities: Vec<VelocitySample>,
    pub(super) truth: Vec<VelocitySample>,
    /// Rows of the first body that show a rod, by frame.
    pub(super) rods: Vec<TrackSample>,
    pub(super) impacts: Vec<Impact>,
    pub(super) truth_impacts: Vec<Impact>,
    pub(super) events: Vec<EventRow>,
    /// Field points of each status.
    pub(super) field_statuses: BTreeMap<&'static str, u64>,
    pub(super) snapshots: Vec<Snapshot>,
    /// The measured frames of each body.
    pub(super) measured: Vec<MeasuredBody>,
}

/// The frames in which a body was measured, in one line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MeasuredBody {
    /// The number of frames, and why it was not measured in the others.
    pub line: String,
    /// Whether the body was measured in every frame.
    pub is_complete: bool,
}

/// The frames of a recording, counted.
#[derive(Debug, Clone, Default)]
pub(super) struct FilmSummary {
    pub(super) count: u64,
    pub(super) shape: Option<FrameMeta>,
    pub(super) rate_hz: Option<f64>,
    pub(super) runs: FrameRuns,
    pub(super) lost: u64,
    pub(super) gaps: u64,
    /// The number of frames that could not be read, and the first reason. The unreadable rest of a file counts as one.
    pub(super) unreadable: u64,
    pub(super) problem: Option<String>,
}

/// A body at one moment of a collision.
#[derive(Debug)]
pub(super) struct Snapshot {
    /// The collision: body and number.
    pub(super) impact: (u32, u32),
    pub(super) title: &'static str,
    /// The moment, ns since the Unix epoch.
    pub(super) moment_ns: u64,
    /// The row of the frame nearest to it.
    pub(super) row: VelocitySample,
    /// The body's displacements from this frame on.
    pub(super) field: Option<PairField>,
    pub(super) picture: Option<(Crop, Vec<u8>)>,
}

impl Shot {
    /// Reads a recording.
    ///
    /// # Errors
    ///
    /// [`RecordingError`] when the system fails or a row does not decode. Damaged frames are counted instead.
    pub fn read(recording: &Recording) -> Result<Self, RecordingError> {
        let has_frames = recording.frame_count() > 0;
        let frames = has_frames.then(|| recording.frames()).transpose()?;
        Self::read_with(recording, recording.path(), frames.into_iter().flatten())
    }

    /// Reads results, with the frames of the `film` that they were measured in, in order. `path` names it in errors.
    ///
    /// # Errors
    ///
    /// The errors of [`read`](Self::read), and [`RecordingError::Invalid`] when a pictured frame of the film has
    /// another stamp than in the results.
    pub fn read_with(
        recording: &Recording,
        path: &Path,
        film: impl Iterator<Item = Result<(FrameMeta, Vec<u8>), RecordingError>>,
    ) -> Result<Self, RecordingError> {
        let mut velocities = recording.velocities()?.collect::<Result<Vec<_>, _>>()?;
        velocities.sort_by_key(|row| (row.body, row.frame));
        let mut truth = recording.truth()?.collect::<Result<Vec<_>, _>>()?;
        truth.sort_by_key(|row| (row.body, row.frame));
        let mut rods = recording.tracks()?.collect::<Result<Vec<_>, _>>()?;
        rods.retain(|row| row.body == 0 && row.rod.is_some());
        rods.sort_by_key(|row| row.frame);
        let impacts = last_revisions(recording.impacts()?.collect::<Result<_, _>>()?);
        let mut bodies: Vec<u32> =
            velocities.iter().map(|row| row.body).chain(impacts.iter().map(|i| i.body)).collect();
        bodies.sort_unstable();
        bodies.dedup();
        let mut shot = Self {
            name: recording.path().file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
            metadata: recording.metadata().clone(),
            config_toml: recording.config_toml().map(str::to_owned),
            library: recording.library().to_owned(),
            truncated: recording.truncated().map(str::to_owned),
            bodies: bodies.into_iter().map(|body| (body, recording.body_name(body))).collect(),
            frames: FilmSummary::default(),
            origin_ns: 0,
            snapshots: select_snapshots(&impacts, &velocities),
            measured: Vec::new(),
            velocities,
            truth,
            rods,
            impacts,
            truth_impacts: last_revisions(recording.truth_impacts()?.collect::<Result<_, _>>()?),
            events: recording.events()?.collect::<Result<_, _>>()?,
            field_statuses: BTreeMap::new(),
        };
        shot.read_fields(recording)?;
        shot.read_frames(path, film)?;
        shot.frames.rate_hz = shot.entry("frame_rate_hz").or(recording.frame_rate_hz().ok().flatten());
        shot.origin_ns = shot.first_stamp_ns();
        Ok(shot)
    }

    /// Counts the statuses of all points, and keeps the fields of the snapshots.
    ///
    /// One more field at a time is in memory.
    ///
    /// # Errors
    ///
    /// [`RecordingError`] when the system fails or a row does not decode.
    fn read_fields(&mut self, recording: &Recording) -> Result<(), RecordingError> {
        for field in recording.fields()? {
            let field = field?;
            for point in &field.points {
                *self.field_statuses.entry(point.status.as_str()).or_default() += 1;
            }
            let shown = |s: &&mut Snapshot| s.field.is_none() && (s.row.frame, s.row.body) == (field.frame, field.body);
            for snapshot in self.snapshots.iter_mut().filter(shown) {
                snapshot.field = Some(field.clone());
            }
        }
        Ok(())
    }

    /// Counts the frames and cuts out the pictures of the snapshots.
    ///
    /// # Errors
    ///
    /// [`RecordingError`] when the system fails, or a frame has another stamp than its row. Damaged frames are counted.
    fn read_frames(
        &mut self,
        path: &Path,
        film: impl Iterator<Item = Result<(FrameMeta, Vec<u8>), RecordingError>>,
    ) -> Result<(), RecordingError> {
        let mut last: Option<FrameMeta> = None;
        for frame in film {
            let (meta, bytes) = match frame {
                Ok(frame) => frame,
                Err(error @ RecordingError::Io { .. }) => return Err(error),
                Err(error) => {
                    self.frames.unreadable += 1;
                    self.frames.problem.get_or_insert(error.to_string());
                    continue;
                }
            };
            let missing = last.map_or(0, |last| meta.sequence.saturating_sub(last.sequence).saturating_sub(1));
            self.frames.count += 1;
            self.frames.runs.push(meta.sequence);
            self.frames.lost += missing;
            self.frames.gaps += u64::from(missing > 0);
            self.frames.shape.get_or_insert(meta);
            last = Some(meta);
            for snapshot in self.snapshots.iter_mut().filter(|s| s.row.frame == meta.sequence && s.picture.is_none()) {
                if snapshot.row.stamp_ns != meta.stamp_ns {
                    let reason =
                        format!("frame {} has another stamp than in the results: this is another film", meta.sequence);
                    return Err(RecordingError::Invalid { path: path.to_path_buf(), reason });
                }
                let center = snapshot.row.center_x_px.zip(snapshot.row.center_y_px).map(|(x, y)| [x, y]);
                let crop = Crop::about(center, snapshot.row.radius_px.unwrap_or(0.0) * CROP_RADII, &meta);
                snapshot.picture = picture::encode_png(meta, &bytes, crop).map(|png| (crop, png));
            }
        }
        Ok(())
    }

    /// Sets the measured frames of each body, which the page shows.
    pub fn set_measured(&mut self, measured: Vec<MeasuredBody>) {
        self.measured = measured;
    }

    /// Returns the velocity rows, by body and frame.
    pub fn velocities(&self) -> &[VelocitySample] {
        &self.velocities
    }

    /// Whether the film lacks the frame `sequence`; false for results without frames.
    pub fn is_missing(&self, sequence: u64) -> bool {
        self.frames.count > 0 && !self.frames.runs.contains(sequence)
    }

    /// Returns the width and the height of the image, px, if there are frames.
    pub fn size_px(&self) -> Option<[u32; 2]> {
        self.frames.shape.map(|meta| [meta.width_px, meta.height_px])
    }

    /// Returns the sequence number of the first frame, from which frames are counted.
    ///
    /// Without frames it is that of the metadata, or else of the first velocity row, or else 0.
    pub fn first_frame(&self) -> u64 {
        let first_row = || self.velocities.iter().map(|row| row.frame).min();
        let recorded = || self.entry("first_frame");
        let first = self.frames.shape.map(|meta| meta.sequence).or_else(recorded).or_else(first_row);
        first.unwrap_or(0)
    }

    /// Parses an entry of the metadata; `None` when it is missing or does not parse.
    fn entry<T: std::str::FromStr>(&self, key: &str) -> Option<T> {
        self.metadata.get(key)?.parse().ok()
    }

    /// Returns the stamp of the first frame, ns since the Unix epoch. Without frames it is that of the metadata, or
    /// else of the first row.
    fn first_stamp_ns(&self) -> u64 {
        let first_row = || self.velocities.iter().map(|row| row.stamp_ns).min();
        let recorded = || self.entry("first_stamp_ns");
        self.frames.shape.map(|meta| meta.stamp_ns).or_else(recorded).or_else(first_row).unwrap_or(0)
    }

    /// Converts a stamp to seconds from the first frame.
    pub(super) fn seconds(&self, stamp_ns: u64) -> f64 {
        (i128::from(stamp_ns) - i128::from(self.origin_ns)) as f64 / 1e9
    }

    /// Converts a sequence number to the frame number of the tables, counted from the first frame.
    pub(super) fn frame(&self, sequence: u64) -> i128 {
        i128::from(sequence) - i128::from(self.first_frame())
    }

    /// Returns the offset from the own times of a collision to those of the page, s.
    pub(super) fn shift_s(&self, impact: &Impact) -> f64 {
        self.seconds(impact.origin_ns)
    }

    /// Returns the true values of a collision, where the recording has them.
    pub(super) fn truth_of(&self, impact: &Impact) -> Option<&Impact> {
        self.truth_impacts.iter().find(|truth| (truth.body, truth.number) == (impact.body, impact.number))
    }

    /// Returns the name of a body; its index where the recording does not name it.
    pub(super) fn body_name(&self, body: u32) -> String {
        self.bodies.iter().find(|(index, _)| *index == body).map_or_else(|| body.to_string(), |(_, name)| name.clone())
    }
}

/// Returns the highest revision of each collision, whatever their order, sorted by body and number.
pub fn last_revisions(revisions: Vec<Impact>) -> Vec<Impact> {
    let mut last: BTreeMap<(u32, u32), Impact> = BTreeMap::new();
    for impact in revisions {
        let latest = last.entry((impact.body, impact.number)).or_insert(impact);
        if impact.revision >= latest.revision {
            *latest = impact;
        }
    }
    last.into_values().collect()
}

/// Selects the velocity row nearest in time to each moment of the first [`MAX_PICTURED_IMPACTS`] impacts.
///
/// Field and picture are still missing.
fn select_snapshots(impacts: &[Impact], rows: &[VelocitySample]) -> Vec<Snapshot> {
    let mut snapshots = Vec::new();
    for impact in impacts.iter().take(MAX_PICTURED_IMPACTS) {
        for (column, title) in MOMENTS {
            let Some(moment) = impact.get(column) else { continue };
            if !(moment.value.is_finite() && moment.value >= 0.0) {
                continue;
            }
            let moment_ns = impact.origin_ns.saturating_add((moment.value * 1e9) as u64);
            let of_body = rows.iter().filter(|row| row.body == impact.body);
            let Some(row) = of_body.min_by_key(|row| row.stamp_ns.abs_diff(moment_ns)) else { continue };
            let impact = (impact.body, impact.number);
            snapshots.push(Snapshot { impact, title, moment_ns, row: *row, field: None, picture: None });
        }
    }
    snapshots
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_highest_revision_holds_in_whatever_order_they_come() {
        let impact = |number, revision| Impact { revision, ..Impact::unknown(0, number, 0) };
        let last = last_revisions(vec![impact(1, 0), impact(0, 2), impact(0, 0), impact(0, 1)]);
        let kept: Vec<_> = last.iter().map(|impact| (impact.number, impact.revision)).collect();
        assert_eq!(kept, [(0, 2), (1, 0)]);
    }
}
