//! Phantom CINE recordings.
//!
//! Layout: "Cine File Format", Vision Research: a file header, a Windows BITMAPINFOHEADER, the camera's set-up, tagged
//! blocks of values per image, and a table with the offsets of the images.

mod pixels;
mod setup;
mod times;

use super::footage::{Footage, Pixels};
use super::rate::Rate;
use super::timeline::{FrameTimes, Timeline};
use super::{ImportError, open_file};
use pixels::Layout;
use setup::Setup;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// The size of the file header, bytes.
const FILE_HEADER_BYTES: usize = 44;
/// The size of the BITMAPINFOHEADER, bytes.
const BITMAP_HEADER_BYTES: usize = 40;
/// `Compression` of the file header for colour images whose mosaic is stored as it is.
const MOSAIC: u16 = 2;
/// Bytes of the table of offsets that are read at a time.
const TABLE_BYTES: u64 = 1 << 20;
/// Maximum number of images in a file.
const MAX_IMAGES: u32 = 1 << 24;

/// An open file.
struct Cine {
    path: PathBuf,
    file: File,
    file_bytes: u64,
    /// The number of the first image, counted from the trigger.
    first_image: i32,
    count: u32,
    /// The offset of the table of the images' offsets in the file.
    offsets: u64,
    /// Time of the trigger, ns since the Unix epoch.
    trigger_ns: u64,
}

/// Opens a recording: uncompressed or packed, grey, Bayer or colour.
pub(super) fn open(path: &Path, fps: Option<f64>) -> Result<Footage, ImportError> {
    let (file, file_bytes) = open_file(path)?;
    let mut cine = Cine {
        path: path.to_path_buf(),
        file,
        file_bytes,
        first_image: 0,
        count: 0,
        offsets: FILE_HEADER_BYTES as u64,
        trigger_ns: 0,
    };
    let header = cine.read_header()?;
    let setup_at = u64::from(u32_at(&header, 28));
    let setup = Setup::read(&cine, setup_at)?;
    let bitmap = cine.read(u64::from(u32_at(&header, 24)), BITMAP_HEADER_BYTES)?;
    let mut layout = Layout::new(&cine, &bitmap, &setup)?;
    let mut warnings = setup.warnings();
    let blocks = times::Blocks::read(&cine, setup_at + setup.bytes());
    let timeline = cine.timeline(&setup, &blocks, fps, &mut warnings)?;
    let mut description = setup.description(cine.first_image);
    blocks.describe(&mut description);
    cine.check_offsets()?;
    layout.check_levels(&cine, &mut warnings)?;
    let (shape, count) = (layout.shape, u64::from(cine.count));
    let (bits, grey_rule, aspect) = (layout.bits, layout.grey_rule(), layout.pixel_aspect);
    let frames = (0..count).map(move |number| layout.read_image(&cine, number));
    let mut footage = Footage { description, warnings, ..Footage::new(shape, timeline, count, frames) };
    (footage.provenance.bits, footage.provenance.grey_rule) = (bits, grey_rule.to_owned());
    Ok(footage.oriented(setup.orientation()).with_square_pixels(setup.orientation().aspect(aspect)))
}

impl Cine {
    /// Reads the file header, takes the number of images, their offsets and the trigger from it, and returns it.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] for a file that is no CINE, is compressed, or has no images or too many.
    fn read_header(&mut self) -> Result<Vec<u8>, ImportError> {
        let header = self.read(0, FILE_HEADER_BYTES)?;
        if header[..2] != *b"CI" {
            return Err(self.invalid("not a CINE file: the letters CI are missing at byte 0"));
        }
        if !matches!(u16_at(&header, 4), 0 | MOSAIC) {
            return Err(self.invalid(format!(
                "compression {}; only uncompressed images are supported: save it as an uncompressed .cine",
                u16_at(&header, 4)
            )));
        }
        (self.first_image, self.count) = (u32_at(&header, 16) as i32, u32_at(&header, 20));
        if self.count == 0 || self.count > MAX_IMAGES {
            return Err(self.invalid(format!("{} images; 1 to {MAX_IMAGES} are supported", self.count)));
        }
        self.offsets = u64::from(u32_at(&header, 32));
        self.trigger_ns = times::ns_of(u32_at(&header, 40), u32_at(&header, 36));
        Ok(header)
    }

    /// Numbers and times the images: by their own times, else by the rate profile, else at the rate of the set-up.
    /// `fps`, the rate of the user, overrides that rate.
    ///
    /// # Errors
    ///
    /// [`ImportError::FrameRate`] when nothing states a rate.
    fn timeline(
        &self,
        setup: &Setup,
        blocks: &times::Blocks,
        fps: Option<f64>,
        warnings: &mut Vec<String>,
    ) -> Result<Timeline, ImportError> {
        let rate = setup.rate(warnings);
        let profile = setup.profile(self.first_image, self.count);
        let times_ns = match (&blocks.times_ns, &profile) {
            (Some(times_ns), _) => Some(times_ns.clone()),
            (None, Some(profile)) => rate.as_ref().map(|rate| self.times_of(profile, rate)),
            (None, None) => None,
        };
        let first_ns = times_ns.as_ref().and_then(|times| times.first().copied());
        let times = times_ns.map(|times_ns| FrameTimes { times_ns, resolution_ns: times::RESOLUTION_NS });
        let timed = times.as_ref().and_then(|times| match profile {
            Some(profile) => {
                warnings.push(profile.to_string());
                times.irregular(fps)
            }
            None => times.timeline(rate.clone(), fps),
        });
        if let Some((timeline, contradictions)) = timed {
            warnings.extend(contradictions);
            return Ok(timeline.starting_at(first_ns.unwrap_or_default()));
        }
        if self.count > 1 && blocks.times_ns.is_some() {
            warnings.push("the times of the images do not rise; the rate of the header is used".into());
        }
        let rate = Rate::known(&self.path, fps, rate)?;
        let first_ns = first_ns.unwrap_or_else(|| {
            self.trigger_ns.saturating_add_signed((f64::from(self.first_image) * 1e9 / rate.hz).round() as i64) as i64
        });
        Ok(Timeline::consecutive(rate).starting_at(first_ns))
    }

    /// Computes the times of the images from a rate profile, ns since the Unix epoch. `rate` holds before its first
    /// change.
    fn times_of(&self, profile: &times::Profile, rate: &Rate) -> Vec<i64> {
        let numbers = (0..self.count).map(|index| i64::from(self.first_image) + i64::from(index));
        numbers
            .map(|number| (self.trigger_ns as i64).saturating_add(profile.since_trigger_ns(number, rate.hz) as i64))
            .collect()
    }

    /// Returns the error that this file is damaged or not supported, for this reason.
    fn invalid(&self, reason: impl Into<String>) -> ImportError {
        ImportError::invalid(&self.path, reason)
    }

    /// Reads `count` bytes from byte `at` of the file on.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] when they reach beyond its end.
    fn read(&self, at: u64, count: usize) -> Result<Vec<u8>, ImportError> {
        if at.checked_add(count as u64).is_none_or(|end| end > self.file_bytes) {
            return Err(self.invalid(format!("the file is cut off: {count} bytes at byte {at} reach beyond its end")));
        }
        let mut bytes = vec![0; count];
        self.file.read_exact_at(&mut bytes, at).map_err(|error| ImportError::io("read", &self.path, error))?;
        Ok(bytes)
    }

    /// Checks that no two images begin at the same byte, so that a small file cannot stand for a long film.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] if two do, or the table of offsets is cut off.
    fn check_offsets(&self) -> Result<(), ImportError> {
        let (mut at, end) = (self.offsets, self.offsets.saturating_add(u64::from(self.count) * 8));
        let mut offsets = Vec::new();
        while at < end {
            let bytes = self.read(at, (end - at).min(TABLE_BYTES) as usize)?;
            at += bytes.len() as u64;
            offsets.extend(
                (offsets.len() as u32..).zip(bytes.chunks_exact(8)).map(|(number, entry)| (offset_at(entry), number)),
            );
        }
        offsets.sort_unstable();
        let same = offsets.windows(2).find(|pair| pair[1].0 == pair[0].0);
        same.map_or(Ok(()), |pair| {
            let (first, second, place) = (pair[0].1, pair[1].1, pair[0].0);
            Err(self.invalid(format!("images {first} and {second} begin at the same byte, {place}")))
        })
    }

    /// Reads the stored bytes of an image, `number` counted from 0. An annotation precedes them.
    fn stored_image(&self, number: u64) -> Pixels {
        let offset = self.read(self.offsets.saturating_add(number * 8), 8)?;
        let at = offset_at(&offset);
        let annotation_bytes = u32_at(&self.read(at, 4)?, 0);
        if annotation_bytes < 8 {
            return Err(self.invalid(format!("image {number}: an annotation of {annotation_bytes} bytes at byte {at}")));
        }
        let pixels_at = at + u64::from(annotation_bytes);
        let stored = u32_at(&self.read(pixels_at - 4, 4)?, 0) as usize;
        self.read(pixels_at, stored)
    }
}

/// Returns an entry of the table of offsets, 64 bits.
fn offset_at(entry: &[u8]) -> u64 {
    u64::from(u32_at(entry, 0)) | u64::from(u32_at(entry, 4)) << 32
}

/// Reads the little-endian number of 16 bits at byte `at`.
///
/// # Panics
///
/// When it reaches beyond the bytes.
fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

/// Reads the little-endian number of 32 bits at byte `at`.
///
/// # Panics
///
/// When it reaches beyond the bytes.
fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}
