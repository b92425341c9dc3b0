//! The pixels of an MRAW file: stored bits to grey frames.

use super::header::{self, Header};
use crate::image::PixelFormat;
use crate::import::shape::Shape;
use crate::import::{ImportError, grey, levels, unpack_msb_first};
use std::path::Path;

/// The relative difference of the mean levels of the four places of a 2 x 2 square that shows a mosaic of colours.
const MIN_MOSAIC_DIFFERENCE: f64 = 0.05;
/// The relative difference of the steps between neighbouring samples that shows colours next to each other.
const MIN_INTERLEAVED_DIFFERENCE: f64 = 0.1;

/// The meaning of the stored samples.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Samples {
    Grey,
    /// The levels of the sensor: grey, or under a mosaic of colours.
    Raw,
    Mosaic,
    /// Red, green and blue of each pixel.
    Colors,
    /// The red image, the green one and the blue one.
    Planes,
}

/// The layout of the frames.
pub(super) struct Layout {
    /// Shape of a grey frame.
    pub(super) shape: Shape,
    /// Significant bits of a grey level.
    pub(super) bits: u32,
    /// Size of a stored frame, bytes.
    pub(super) stored_bytes: u64,
    /// Bits of a stored sample.
    stored_bits: u32,
    /// Whether the significant bits are at the upper end of a stored word.
    is_upper: bool,
    samples: Samples,
}

impl Layout {
    /// Reads the layout of the frames from the header.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] for a layout that cannot be measured.
    pub(super) fn new(path: &Path, header: &Header, warnings: &mut Vec<String>) -> Result<Self, ImportError> {
        Self::parse(path, header, warnings)?.map_err(|reason| ImportError::invalid(path, reason))
    }

    /// Reads the layout; the inner error is the reason why it cannot be measured.
    fn parse(path: &Path, header: &Header, warnings: &mut Vec<String>) -> Result<Result<Self, String>, ImportError> {
        let entries = || -> Result<_, String> {
            let kind = header.text(header::COLOR_TYPE)?;
            let samples = match kind.to_ascii_lowercase().as_str() {
                "mono" | "monochrome" => Samples::Grey,
                "raw" => Samples::Raw,
                "color" | "colour" | "rgb" => Samples::Colors,
                other if other.contains("bayer") => Samples::Mosaic,
                _ => return Err(format!("colour type {kind:?}; Mono, Raw, Bayer and Color are supported")),
            };
            let pixel_bits: u32 = header.number(header::STORED_BITS)?;
            let significant_bits: u32 = header.number(header::SIGNIFICANT_BITS)?;
            let side = header.text(header::SIDE)?.to_ascii_lowercase();
            let size: [u64; 2] = [header.number(header::WIDTH)?, header.number(header::HEIGHT)?];
            Ok((samples, pixel_bits, significant_bits, side != "lower", size))
        };
        let (samples, pixel_bits, significant_bits, is_upper, [width_px, height_px]) = match entries() {
            Ok(entries) => entries,
            Err(reason) => return Ok(Err(reason)),
        };
        let stored_bits = if samples == Samples::Colors { pixel_bits / 3 } else { pixel_bits };
        let format = match (stored_bits, significant_bits) {
            (8, _) => PixelFormat::Mono8,
            (10, _) | (16, 10) => PixelFormat::Mono10,
            (12, _) | (16, 12) => PixelFormat::Mono12,
            (16, _) => PixelFormat::Mono16,
            _ => {
                let reason =
                    format!("{pixel_bits} bits per pixel; 8, 10, 12 and 16 are supported, or 24 and 48 in colour");
                return Ok(Err(reason));
            }
        };
        if significant_bits > stored_bits {
            warnings.push(format!("{stored_bits} of {significant_bits} bits of the camera are stored"));
        }
        let shape = Shape::new(path, width_px, height_px, format)?;
        let all_bits = width_px * height_px * u64::from(pixel_bits);
        if all_bits % 8 != 0 {
            return Ok(Err(format!("a frame of {all_bits} bits does not end at a byte")));
        }
        let bits = significant_bits.clamp(8, stored_bits);
        Ok(Ok(Self { shape, bits, stored_bytes: all_bits / 8, stored_bits, is_upper, samples }))
    }

    /// Decides by the first frame what the header leaves open: the end of the words with the significant bits, a
    /// mosaic, and planes of colours. Adds warnings of what it decides and of what contradicts the header.
    pub(super) fn check(&mut self, stored: &[u8], warnings: &mut Vec<String>) {
        if self.stored_bits == 16 && self.bits < 16 && !self.is_upper {
            let highest = stored.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).max().unwrap_or(0);
            let is_higher = u32::from(highest) >> self.bits > 0;
            if is_higher && levels::unused_low_bits(stored) == 16 - self.bits {
                warnings.push(format!("the {} bits lie at the upper end, though the header says Lower", self.bits));
                self.is_upper = true;
            } else if is_higher {
                let bits = self.bits;
                warnings
                    .push(format!("the header says {bits} bits, but a level of {highest} is stored: all 16 are used"));
                (self.bits, self.shape.format) = (16, PixelFormat::Mono16);
            }
        }
        match self.samples {
            Samples::Raw if self.is_mosaic(&self.unpacked(stored.to_vec())) => {
                warnings.push("the colour type is Raw: the first frame shows a mosaic of colours".into());
                self.samples = Samples::Mosaic;
            }
            Samples::Raw => {
                warnings.push("the colour type is Raw: the first frame shows no mosaic, it is measured as grey".into());
                self.samples = Samples::Grey;
            }
            Samples::Colors if !self.is_interleaved(&self.unpacked(stored.to_vec())) => self.samples = Samples::Planes,
            _ => {}
        }
    }

    /// Returns the rule that makes grey levels of the stored ones; empty for a grey film.
    pub(super) fn grey_rule(&self) -> &'static str {
        match self.samples {
            Samples::Grey | Samples::Raw => "",
            Samples::Mosaic => grey::MOSAIC,
            Samples::Colors | Samples::Planes => grey::LUMA,
        }
    }

    /// Converts a stored frame to packed grey levels.
    pub(super) fn grey_frame(&self, stored: Vec<u8>) -> Vec<u8> {
        let samples = self.unpacked(stored);
        match self.samples {
            Samples::Grey | Samples::Raw => samples,
            Samples::Mosaic => grey::mosaic_brightness(self.shape, &samples),
            Samples::Colors => grey::luma(self.shape.format, &samples),
            Samples::Planes => grey::luma_of_planes(self.shape.format, &samples),
        }
    }

    /// Unpacks samples to whole little-endian bytes with the significant bits at the lower end.
    fn unpacked(&self, stored: Vec<u8>) -> Vec<u8> {
        match self.stored_bits {
            8 => stored,
            16 if self.is_upper && self.bits < 16 => {
                let shift = 16 - self.bits;
                let words = stored.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]]) >> shift);
                words.flat_map(u16::to_le_bytes).collect()
            }
            16 => stored,
            bits => unpack_msb_first(&stored, bits),
        }
    }

    /// Whether the four places of a 2 x 2 square differ in their mean level by more than [`MIN_MOSAIC_DIFFERENCE`]. A
    /// grey sensor has no such pattern.
    fn is_mosaic(&self, samples: &[u8]) -> bool {
        let (width, bytes) = (self.shape.width_px as usize, self.shape.format.bytes_per_pixel());
        let mut sums = [0.0_f64; 4];
        let mut counts = [0.0_f64; 4];
        for (at, sample) in samples.chunks_exact(bytes).enumerate() {
            let place = 2 * (at / width % 2) + at % width % 2;
            sums[place] += sample_level(sample);
            counts[place] += 1.0;
        }
        let means = [0, 1, 2, 3].map(|place| sums[place] / counts[place].max(1.0));
        let (min, max) = (means.iter().copied().fold(f64::MAX, f64::min), means.iter().copied().fold(0.0, f64::max));
        max - min > MIN_MOSAIC_DIFFERENCE * max
    }

    /// Whether the sums of the absolute steps between neighbouring samples, by their place in a period of three, differ
    /// by more than [`MIN_INTERLEAVED_DIFFERENCE`]. Those of one plane do not.
    fn is_interleaved(&self, samples: &[u8]) -> bool {
        let levels: Vec<f64> = samples.chunks_exact(self.shape.format.bytes_per_pixel()).map(sample_level).collect();
        let mut sums = [0.0_f64; 3];
        levels.windows(2).enumerate().for_each(|(at, pair)| sums[at % 3] += (pair[1] - pair[0]).abs());
        let (min, max) = (sums.iter().copied().fold(f64::MAX, f64::min), sums.iter().copied().fold(0.0, f64::max));
        max - min > MIN_INTERLEAVED_DIFFERENCE * max
    }
}

/// Reads the level of a sample of one byte, or of two in little-endian order, DN.
fn sample_level(sample: &[u8]) -> f64 {
    match *sample {
        [low] => low.into(),
        _ => u16::from_le_bytes([sample[0], sample[1]]).into(),
    }
}
