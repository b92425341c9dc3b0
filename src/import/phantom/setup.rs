//! The camera's set-up in a CINE file.
//!
//! Fields were appended over the years, so that old files end before the later ones.

use super::times::Profile;
use super::{Cine, u16_at, u32_at};
use crate::import::rate::Rate;
use crate::import::{ImportError, Orientation};
use std::collections::BTreeMap;

/// The offset of the mark `ST` and of the length after it.
const MARK: usize = 140;
/// Minimum length of the set-up.
const MIN_BYTES: usize = 144;
/// Offsets of its fields.
const FRAME_RATE_16: usize = 0;
const SERIAL: usize = 743;
const FLIP_H: usize = 756;
const FLIP_V: usize = 760;
const FRAME_RATE: usize = 768;
const COLOR_FILTER: usize = 808;
const ROTATE: usize = 884;
const REAL_BITS: usize = 896;
const PROFILE_STEPS: usize = 1048;
const PROFILE_IMAGES: usize = 1052;
const PROFILE_RATES: usize = 1116;
const DECIMATION: usize = 1556;
const SHUTTER_NS: usize = 1568;
const ENABLE_CROP: usize = 6868;
const CROP_RECT: usize = 6872;
const ENABLE_RESAMPLE: usize = 6888;
const CAMERA_MODEL: usize = 10128;
const CAMERA_MODEL_BYTES: usize = 256;
const FRAME_RATE_F64: usize = 10400;
/// The 16-bit rate when the rate does not fit.
const FRAME_RATE_16_FULL: u16 = u16::MAX;
/// Maximum number of steps of a rate profile.
const MAX_PROFILE_STEPS: u32 = 16;

/// The set-up, as long as the file has it.
pub(super) struct Setup(Vec<u8>);

impl Setup {
    /// Reads the set-up at byte `at` and checks its mark.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] when the mark is missing or the file ends before.
    pub(super) fn read(cine: &Cine, at: u64) -> Result<Self, ImportError> {
        let head = cine.read(at, MIN_BYTES)?;
        if head[MARK..MARK + 2] != *b"ST" {
            return Err(cine.invalid(format!("no set-up at byte {at}")));
        }
        match usize::from(u16_at(&head, MARK + 2)) {
            bytes if bytes > MIN_BYTES => Ok(Self(cine.read(at, bytes)?)),
            _ => Ok(Self(head)),
        }
    }

    /// Returns the length of the set-up, bytes.
    pub(super) fn bytes(&self) -> u64 {
        self.0.len() as u64
    }

    /// Reads the field at byte `at` of the set-up; `None` in a set-up that ends before it.
    fn u32(&self, at: usize) -> Option<u32> {
        (self.0.len() >= at + 4).then(|| u32_at(&self.0, at))
    }

    /// Whether the field at byte `at` of the set-up is present and not 0.
    fn is_set(&self, at: usize) -> bool {
        self.u32(at).is_some_and(|value| value != 0)
    }

    /// Returns the significant bits of a grey level, as stored or before a conversion to 8 bits; `None` in an old file.
    pub(super) fn real_bits(&self) -> Option<u32> {
        self.u32(REAL_BITS)
    }

    /// Returns the colour filter of the sensor; 0 for none.
    pub(super) fn color_filter(&self) -> u32 {
        self.u32(COLOR_FILTER).unwrap_or(0)
    }

    /// Returns the frame rate from the most exact field that the file has; `None` where no field states one. Fields
    /// that contradict each other give a warning.
    pub(super) fn rate(&self, warnings: &mut Vec<String>) -> Option<Rate> {
        let whole = match self.u32(FRAME_RATE) {
            Some(hz) => Rate::from_header(f64::from(hz), "FrameRate"),
            // Old files have only the 16-bit rate at the beginning.
            None if u16_at(&self.0, FRAME_RATE_16) == FRAME_RATE_16_FULL => None,
            None => Rate::from_header(f64::from(u16_at(&self.0, FRAME_RATE_16)), "FrameRate16"),
        };
        let bytes = self.0.get(FRAME_RATE_F64..FRAME_RATE_F64 + 8).and_then(|bytes| bytes.try_into().ok());
        let exact = bytes.and_then(|bytes| Rate::from_header(f64::from_le_bytes(bytes), "dFrameRate"));
        match (exact, whole) {
            // The whole number is the exact rate, rounded or cut off.
            (Some(exact), Some(whole)) if (exact.hz - whole.hz).abs() > 1.0 => {
                warnings.push(format!("dFrameRate says {} frames/s, but FrameRate {}", exact.hz, whole.hz));
                Some(exact)
            }
            (exact, whole) => exact.or(whole),
        }
    }

    /// Returns the rate profile; `None` when no rate changes within the images of the file, or the changes are out of
    /// order.
    pub(super) fn profile(&self, first_image: i32, count: u32) -> Option<Profile> {
        let count_of_steps = self.u32(PROFILE_STEPS)?.min(MAX_PROFILE_STEPS) as usize;
        let step = |index: usize| {
            let image = self.u32(PROFILE_IMAGES + 4 * index)? as i32;
            Some((i64::from(image), self.u32(PROFILE_RATES + 4 * index).filter(|rate| *rate > 0)?))
        };
        let steps: Vec<(i64, u32)> = (0..count_of_steps).map_while(step).collect();
        let (first, last) = (i64::from(first_image), i64::from(first_image) + i64::from(count) - 1);
        let is_inside = steps.iter().any(|(image, _)| (first + 1..=last).contains(image));
        (is_inside && steps.is_sorted()).then_some(Profile(steps))
    }

    /// Returns the transformation that Phantom software shows the stored images with: flips, then a rotation by
    /// quarters.
    pub(super) fn orientation(&self) -> Orientation {
        let flip = |at: usize, flip: Orientation| if self.is_set(at) { flip } else { Orientation::AS_STORED };
        let flipped = flip(FLIP_H, Orientation::MIRRORED).then(flip(FLIP_V, Orientation::FLIPPED));
        flipped.then(self.rotation().unwrap_or(Orientation::AS_STORED))
    }

    /// Returns the rotation, where +90 degrees are counter-clockwise; `None` for an angle that is no multiple of 90
    /// degrees within one turn.
    fn rotation(&self) -> Option<Orientation> {
        match self.u32(ROTATE).unwrap_or(0) as i32 {
            0 => Some(Orientation::AS_STORED),
            90 | -270 => Some(Orientation::TURNED_90_CCW),
            -90 | 270 => Some(Orientation::TURNED_90_CW),
            180 | -180 => Some(Orientation::TURNED_180),
            _ => None,
        }
    }

    /// Returns warnings of the settings that are not applied, of the order of flip and rotation, and of images that the
    /// camera left out.
    pub(super) fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.rotation().is_none() {
            let angle = self.u32(ROTATE).unwrap_or(0) as i32;
            warnings.push(format!("the file asks for a rotation by {angle} deg, which is not applied"));
        }
        let is_quarter = matches!(self.rotation(), Some(turn) if turn == Orientation::TURNED_90_CCW || turn == Orientation::TURNED_90_CW);
        if is_quarter && self.is_set(FLIP_H) != self.is_set(FLIP_V) {
            warnings.push("the file asks for a flip and a rotation; the flip is applied first".into());
        }
        if self.is_set(ENABLE_CROP) {
            let edge = |index: usize| self.u32(CROP_RECT + 4 * index).unwrap_or(0) as i32;
            warnings.push(format!(
                "the file asks for a crop to x {} to {}, y {} to {}; the whole image is measured",
                edge(0),
                edge(2),
                edge(1),
                edge(3)
            ));
        }
        if let Some(decimation) = self.u32(DECIMATION).filter(|decimation| *decimation > 1) {
            warnings.push(format!("the camera sent one of {decimation} images (Decimation)"));
        }
        if self.is_set(ENABLE_RESAMPLE) {
            warnings.push("the file asks for resampled images; they are measured as stored".into());
        }
        warnings
    }

    /// Returns the properties of the recording: first image, counted from the trigger, camera, serial number and
    /// exposure, where they are known.
    pub(super) fn description(&self, first_image: i32) -> BTreeMap<String, String> {
        let mut entries = BTreeMap::from([("first_image".to_owned(), first_image.to_string())]);
        if self.u32(REAL_BITS).is_some() {
            entries.insert("camera".into(), self.camera_model());
        }
        if let Some(serial) = self.u32(SERIAL).filter(|serial| *serial > 0) {
            entries.insert("serial".into(), serial.to_string());
        }
        if let Some(shutter_ns) = self.u32(SHUTTER_NS).filter(|shutter_ns| *shutter_ns > 0) {
            entries.insert("exposure_us".into(), (f64::from(shutter_ns) * 1e-3).to_string());
        }
        entries
    }

    /// Returns the name of the camera; `Phantom` where it is no text.
    fn camera_model(&self) -> String {
        let text = self.0.get(CAMERA_MODEL..CAMERA_MODEL + CAMERA_MODEL_BYTES).unwrap_or_default();
        let text = text.split(|byte| *byte == 0).next().unwrap_or_default();
        let is_text = !text.is_empty() && text.iter().all(|byte| (b' '..=b'~').contains(byte));
        if is_text { String::from_utf8_lossy(text).trim().to_owned() } else { "Phantom".to_owned() }
    }
}
