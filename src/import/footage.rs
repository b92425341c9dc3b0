//! The frames of a file, with the number and the time of each.

use super::shape::Shape;
use super::{ImportError, Orientation, Provenance, RateSource, levels, square, timeline::Timeline};
use crate::image::{FrameMeta, PixelFormat};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Frames of a file, or of a sequence of files.
pub struct Footage {
    /// Pixels per row.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Pixel layout.
    pub format: PixelFormat,
    /// Nominal rate of the scene, frames per second.
    pub frame_rate_hz: f64,
    /// Number of stored frames.
    pub count: u64,
    /// The sources of rate, times, orientation and grey levels.
    pub provenance: Provenance,
    /// Properties that the file states: camera, exposure, ...
    pub description: BTreeMap<String, String>,
    /// Warnings for the user: missing frames, contradicting settings.
    pub warnings: Vec<String>,
    /// Warnings that only the frames give; complete after the last.
    pub findings: Findings,
    pub(super) timeline: Timeline,
    pub(super) frames: Frames,
}

/// The packed little-endian pixels of the next stored frame.
pub(super) type Pixels = Result<Vec<u8>, ImportError>;

/// Stored frames in order.
pub(super) type Frames = Box<dyn Iterator<Item = Result<Stored, ImportError>> + Send>;

/// A frame with its index among the stored ones.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Stored {
    pub(super) index: u64,
    /// Packed little-endian pixels.
    pub(super) pixels: Vec<u8>,
}

/// Warnings that are found while frames are read: one for each subject, which grows with the frames.
#[derive(Debug, Clone, Default)]
pub struct Findings(Arc<Mutex<BTreeMap<&'static str, String>>>);

impl Findings {
    /// Returns the warnings so far.
    pub fn warnings(&self) -> Vec<String> {
        self.entries().values().cloned().collect()
    }

    /// Replaces the warning of a subject, or adds it.
    pub(super) fn set(&self, subject: &'static str, warning: String) {
        self.entries().insert(subject, warning);
    }

    /// Locks the warnings by subject. A poisoned lock is used as it is, since every change is complete.
    fn entries(&self) -> MutexGuard<'_, BTreeMap<&'static str, String>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Footage {
    /// Returns footage of `count` frames with their times. Properties, warnings and the rest of the provenance are
    /// added later.
    pub(super) fn new(
        shape: Shape,
        timeline: Timeline,
        count: u64,
        frames: impl Iterator<Item = Pixels> + Send + 'static,
    ) -> Self {
        let stored = (0..).zip(frames).map(|(index, pixels)| Ok(Stored { index, pixels: pixels? }));
        Self::from_stored(shape, timeline, count, Box::new(stored))
    }

    /// Returns footage of frames of which some of the `count` stored ones may be left out, as [`new`](Self::new) does.
    pub(super) fn from_stored(shape: Shape, timeline: Timeline, count: u64, frames: Frames) -> Self {
        let Shape { width_px, height_px, format } = shape;
        let provenance = Provenance::new(timeline.source.clone(), timeline.gaps(), format);
        let frame_rate_hz = timeline.rate_hz;
        let (description, warnings, findings) = (BTreeMap::new(), Vec::new(), Findings::default());
        Self {
            width_px,
            height_px,
            format,
            frame_rate_hz,
            count,
            provenance,
            description,
            warnings,
            findings,
            timeline,
            frames,
        }
    }

    /// Returns size and pixel layout of the frames.
    pub(super) fn shape(&self) -> Shape {
        Shape { width_px: self.width_px, height_px: self.height_px, format: self.format }
    }

    /// Replaces every frame by `change` of it, which has the shape `shape`.
    pub(super) fn changed(self, shape: Shape, change: impl Fn(Vec<u8>) -> Vec<u8> + Send + 'static) -> Self {
        let changed = move |frame: Stored| Stored { pixels: change(frame.pixels), ..frame };
        let frames = Box::new(self.frames.map(move |frame| frame.map(&changed)));
        let Shape { width_px, height_px, format } = shape;
        Self { width_px, height_px, format, frames, ..self }
    }

    /// Turns and mirrors every frame from the stored to the displayed image, and records the orientation.
    pub(super) fn oriented(mut self, orientation: Orientation) -> Self {
        self.provenance.orientation = orientation;
        let stored = self.shape();
        match orientation == Orientation::AS_STORED {
            true => self,
            false => self.changed(orientation.shape(stored), move |pixels| orientation.apply(stored, pixels)),
        }
    }

    /// Moves grey levels in the upper bits of 16-bit words to the lower end, so that the highest one is full scale.
    ///
    /// The first frame decides how many bits are in use. Frames of other formats, or of fewer significant bits, stay as
    /// they are.
    ///
    /// # Errors
    ///
    /// The error of the first frame. A later frame that uses more bits is an error with the name of `path` in its
    /// place.
    pub(super) fn with_bits_of_first(mut self, path: &Path) -> Result<Self, ImportError> {
        if self.format != PixelFormat::Mono16 || self.provenance.bits != 16 {
            return Ok(self);
        }
        let Some(first) = self.frames.next() else { return Ok(self) };
        let first = first?;
        let unused_bits = levels::unused_low_bits(&first.pixels);
        let frames = std::iter::once(Ok(first)).chain(self.frames);
        if unused_bits == 0 {
            self.frames = Box::new(frames);
            return Ok(self);
        }
        let bits = 16 - unused_bits;
        self.warnings.push(format!("the lower {unused_bits} of 16 bits are empty: levels of {bits} bits are measured"));
        (self.format, self.provenance.bits) = (levels::format_of_bits(bits), bits);
        let path = path.to_path_buf();
        self.frames = Box::new(frames.map(move |frame| {
            let Stored { index, pixels } = frame?;
            let pixels = levels::shifted_down(pixels, unused_bits).map(|pixels| Stored { index, pixels });
            pixels.ok_or_else(|| {
                let reason = format!("a frame uses the lower {unused_bits} bits, which are empty in the first one");
                ImportError::invalid(&path, reason)
            })
        }));
        Ok(self)
    }

    /// Resamples frames whose pixels are `aspect` times as wide as high to square pixels. An aspect that no pixel has
    /// gives a warning, and the frames stay as they are.
    pub(super) fn with_square_pixels(mut self, aspect: f64) -> Self {
        let stored = self.shape();
        let Some(shape) = square::square_shape(stored, aspect) else {
            if !square::ASPECT_RANGE.contains(&aspect) {
                self.warnings.push(format!("pixels of {aspect} : 1 are no shape of a pixel; square ones are assumed"));
            }
            return self;
        };
        self.provenance.pixel_aspect = aspect;
        self.changed(shape, move |pixels| square::resample(stored, shape, pixels))
    }

    /// Describes in one line what is known about the film: rate and its source, frames, gaps, orientation, pixel shape,
    /// grey levels.
    pub fn summary(&self) -> String {
        let frames = if self.count == 1 { "frame" } else { "frames" };
        let size = format!("{}x{}", self.width_px, self.height_px);
        format!("{} {frames} of {size}, {:.6} frames/s {}", self.count, Rate(self.frame_rate_hz), self.provenance)
    }
}

/// A rate in frames per second that is printed without trailing zeros.
struct Rate(f64);

impl std::fmt::Display for Rate {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let places = formatter.precision().unwrap_or(6);
        let text = format!("{:.places$}", self.0);
        formatter.write_str(text.trim_end_matches('0').trim_end_matches('.'))
    }
}

impl std::fmt::Debug for Footage {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("Footage")
            .field("width_px", &self.width_px)
            .field("height_px", &self.height_px)
            .field("format", &self.format)
            .field("frame_rate_hz", &self.frame_rate_hz)
            .field("count", &self.count)
            .field("provenance", &self.provenance)
            .finish_non_exhaustive()
    }
}

impl Iterator for Footage {
    type Item = Result<(FrameMeta, Vec<u8>), ImportError>;

    fn next(&mut self) -> Option<Self::Item> {
        let stored = match self.frames.next()? {
            Ok(stored) => stored,
            Err(error) => return Some(Err(error)),
        };
        let slot = self.timeline.slot(stored.index);
        let meta = FrameMeta {
            sequence: slot.number,
            stamp_ns: slot.stamp_ns,
            width_px: self.width_px,
            height_px: self.height_px,
            stride_bytes: self.width_px * self.format.bytes_per_pixel() as u32,
            format: self.format,
            ..FrameMeta::default()
        };
        Some(Ok((meta, stored.pixels)))
    }
}

impl Footage {
    /// Whether the rate is that of playback, which a film in slow motion does not share with the scene.
    pub fn is_rate_of_playback(&self) -> bool {
        self.provenance.rate == RateSource::Playback
    }
}
