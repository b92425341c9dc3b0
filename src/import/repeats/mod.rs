//! Frames that repeat the one before.
//!
//! Capture programs repeat a frame when they cannot keep up, and converters do so to reach a higher rate. Nothing is
//! known of the moment of a repeat: it is left out, and its number is missing. A repeat is equal to the frame before to
//! the byte, or up to a compression. Real frames are equal only when nothing moves and there is no noise: in such a
//! film a frame repeats only where it interrupts a motion.

mod blends;
mod change;
mod conversion;
mod doubtful;
mod numbers;
mod recent_changes;
mod repeated;

use super::ImportError;
use super::footage::{Findings, Footage, Frames, Stored};
use super::shape::Shape;
use super::timeline::Timeline;
use blends::BlendedFrames;
use change::{Change, Tiles};
use conversion::MotionAfterRepeats;
use doubtful::DoubtfulFrames;
use recent_changes::{RecentChanges, is_noise};
use repeated::RepeatedFrames;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};

/// Maximum length of a standstill that can be one of the film, in a film without noise.
const MAX_STANDSTILL: usize = 16;
/// Maximum size of the frames that wait for the end of a standstill, bytes.
const MAX_HELD_BYTES: u64 = 256 << 20;
impl Footage {
    /// Leaves out frames of the file `path` that repeat the one before.
    pub(super) fn without_repeats(mut self, path: &Path) -> Self {
        let film = RepeatFilter::new(path, self.shape(), self.timeline.clone(), self.findings.clone());
        self.frames = Box::new(film.filter_frames(self.frames));
        self
    }
}

/// The state of a film of which repeats are left out.
struct RepeatFilter {
    path: PathBuf,
    shape: Shape,
    tiles: Tiles,
    timeline: Timeline,
    findings: Findings,
    /// The last three pictures that differ.
    pictures: VecDeque<Vec<u8>>,
    /// Index of the last of them.
    last_index: u64,
    changes: RecentChanges,
    /// The change that led to the last picture, unless that stood still.
    last: Option<Change>,
    /// Frames that may repeat the last picture, with their largest changes.
    held: Vec<(Stored, f64)>,
    ready: VecDeque<Stored>,
    motions: MotionAfterRepeats,
    repeats: RepeatedFrames,
    blends: BlendedFrames,
    doubtful: DoubtfulFrames,
}

impl RepeatFilter {
    /// Starts with a film of the file `path` whose frames have the shape `shape`.
    fn new(path: &Path, shape: Shape, timeline: Timeline, findings: Findings) -> Self {
        Self {
            path: path.to_path_buf(),
            shape,
            tiles: Tiles::new(shape.width_px as usize, shape.height_px as usize, shape.format),
            timeline,
            findings,
            pictures: VecDeque::new(),
            last_index: 0,
            changes: RecentChanges::default(),
            last: None,
            held: Vec::new(),
            ready: VecDeque::new(),
            motions: MotionAfterRepeats::default(),
            repeats: RepeatedFrames::default(),
            blends: BlendedFrames::default(),
            doubtful: DoubtfulFrames::default(),
        }
    }

    /// Returns the frames that repeat no other, each once the frames after it have shown that. Errors are passed on.
    fn filter_frames(mut self, mut frames: Frames) -> impl Iterator<Item = Result<Stored, ImportError>> + Send {
        std::iter::from_fn(move || {
            loop {
                if let Some(frame) = self.ready.pop_front() {
                    return Some(Ok(frame));
                }
                match frames.next() {
                    Some(Ok(frame)) => match self.push_frame(frame) {
                        Ok(()) => {}
                        Err(error) => return Some(Err(error)),
                    },
                    Some(Err(error)) => return Some(Err(error)),
                    None if self.held.is_empty() => return None,
                    None => self.release_held(),
                }
            }
        })
    }

    /// Examines the next stored frame: it differs, may repeat the last picture and is held, or is a copy and left out.
    fn push_frame(&mut self, frame: Stored) -> Result<(), ImportError> {
        let Some(picture) = self.pictures.back() else {
            self.pictures.push_back(frame.pixels.clone());
            self.ready.push_back(frame);
            return Ok(());
        };
        let change = self.tiles.change(picture, &frame.pixels);
        if self.changes.is_copy(&change) {
            self.held.push((frame, change.peak()));
            self.drop_held();
            return Ok(());
        }
        if self.changes.is_standstill(&change) {
            self.held.push((frame, change.peak()));
            let held_bytes = self.held.len() as u64 * self.shape.bytes();
            if self.held.len() > MAX_STANDSTILL || held_bytes > MAX_HELD_BYTES {
                self.release_held();
            }
            return Ok(());
        }
        self.push_changed_frame(frame, change)
    }

    /// Adds a frame that differs from the last picture, and decides on the held frames between.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] for a film that was converted to a higher rate.
    fn push_changed_frame(&mut self, frame: Stored, change: Change) -> Result<(), ImportError> {
        let across = self.change_from(1, &frame);
        if !self.held.is_empty() {
            match self.are_repeats(&change, across.as_ref()) {
                true => self.drop_held(),
                false => self.release_held(),
            }
        }
        let repeats = std::mem::take(&mut self.repeats.run);
        self.motions.push(repeats, change.motion(), across.as_ref().map(Change::motion));
        if let (Some(last), Some(across), 0) = (&self.last, &across, repeats) {
            self.blends.push(last.own_part(&change, across));
            self.blends.warning().into_iter().for_each(|warning| self.findings.set("blends", warning));
            if self.changes.is_last_doubtful(&change, || self.change_from(2, &frame)) {
                self.doubtful.push(self.timeline.slot(self.last_index).number);
                self.findings.set("doubtful", self.doubtful.warning());
            }
        }
        self.changes.push(&change);
        self.last = Some(change);
        self.pictures.push_back(frame.pixels.clone());
        if self.pictures.len() > 3 {
            self.pictures.pop_front();
        }
        let index = frame.index;
        self.last_index = index;
        self.ready.push_back(frame);
        match repeats > 0 && self.motions.are_inserted() {
            true => Err(self.conversion_error(index)),
            false => Ok(()),
        }
    }

    /// Returns the change to a frame from the picture that came `before` pictures before the last; `None` if that is
    /// not kept.
    fn change_from(&self, before: usize, frame: &Stored) -> Option<Change> {
        let picture = self.pictures.iter().rev().nth(before)?;
        Some(self.tiles.change(picture, &frame.pixels))
    }

    /// Whether the held frames are repeats rather than show a standstill. `change` ends their run, and `across` leads
    /// from the picture before the last one to the frame after them.
    fn are_repeats(&self, change: &Change, across: Option<&Change>) -> bool {
        if self.changes.is_empty() {
            // The first change of a film shows whether it has noise.
            return is_noise(change.floor());
        }
        let largest = self.held.iter().map(|(_, peak)| *peak).fold(0.0, f64::max);
        let interrupts = |across: &Change| self.changes.interrupts_motion(largest, change, across);
        self.last.is_some() && across.is_some_and(interrupts)
    }

    /// Returns the error of a film that was converted to a higher rate by repeating frames, with the rate of the
    /// original. `index` is that of the newest frame.
    fn conversion_error(&self, index: u64) -> ImportError {
        let (repeats, number) = (self.repeats.numbers.count, self.timeline.slot(index).number);
        let share = 1.0 - repeats as f64 / (index as f64 + 1.0);
        let rate_hz = (self.timeline.rate_hz * share * 1e3).round() / 1e3;
        ImportError::invalid(
            &self.path,
            format!(
                "{repeats} of the frames up to number {number} repeat the one before, and no time passes in them: the \
                 film was converted to a higher rate. Remove them with ffmpeg -i FILM -vf \
                 mpdecimate=hi=1:lo=1:frac=1,setpts=N/{rate_hz}/TB -r {rate_hz} -c:v ffv1 NEW.avi, or find the \
                 original (about {rate_hz} frames/s)"
            ),
        )
    }

    /// Leaves out the held frames as repeats, and updates the warning of them.
    fn drop_held(&mut self) {
        for (frame, _) in self.held.drain(..) {
            self.repeats.push(self.timeline.slot(frame.index).number);
        }
        self.findings.set("repeats", self.repeats.to_string());
    }

    /// Releases the held frames, because the scene stands still.
    fn release_held(&mut self) {
        self.ready.extend(self.held.drain(..).map(|(frame, _)| frame));
        self.last = None;
    }
}
