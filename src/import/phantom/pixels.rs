//! The pixels of a CINE file: stored rows to grey frames, top row first.

use super::setup::Setup;
use super::{Cine, u16_at, u32_at};
use crate::image::PixelFormat;
use crate::import::footage::Pixels;
use crate::import::shape::Shape;
use crate::import::{ImportError, grey, unpack_msb_first};

/// `biCompression` of pixels packed without gaps with 10 bits on the curve of the camera.
const PACKED: u32 = 256;
/// `biCompression` of pixels packed without gaps with 12 linear bits.
const PACKED_LINEAR: u32 = 1024;

/// The storage of a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Storage {
    /// Whole bytes per pixel, in rows of a Windows bitmap.
    Rows,
    /// Blue, green and red of whole bytes.
    Colors,
    /// 10 or 12 bits per pixel without gaps, top row first.
    Packed,
}

/// The layout of the images.
pub(super) struct Layout {
    /// Shape of a grey frame.
    pub(super) shape: Shape,
    /// Significant bits of a grey level.
    pub(super) bits: u32,
    /// Width of a pixel over its height.
    pub(super) pixel_aspect: f64,
    storage: Storage,
    is_bottom_up: bool,
    /// Whether the pixels lie under the colours of a mosaic.
    is_mosaic: bool,
    /// The 12-bit level of each packed 10-bit code.
    linear: Vec<u16>,
}

impl Layout {
    /// Reads the layout from the header of the bitmaps and the set-up.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] for compressed images, unknown depths, and colour filters that are no Bayer mosaic.
    pub(super) fn new(cine: &Cine, bitmap: &[u8], setup: &Setup) -> Result<Self, ImportError> {
        let (width, height) = (u32_at(bitmap, 4) as i32, u32_at(bitmap, 8) as i32);
        let (stored_bits, compression) = (u16_at(bitmap, 14), u32_at(bitmap, 16));
        let storage = match (compression, stored_bits) {
            (PACKED | PACKED_LINEAR, _) => Storage::Packed,
            (0, 24 | 48) => Storage::Colors,
            (0, 8 | 16) => Storage::Rows,
            (0, bits) => return Err(cine.invalid(format!("{bits} bits per pixel; 8, 16, 24 and 48 are supported"))),
            (other, _) => {
                let cure = "save it as an uncompressed or packed .cine";
                return Err(cine.invalid(format!("bitmap compression {other} is not supported: {cure}")));
            }
        };
        let real_bits = setup.real_bits().unwrap_or(16);
        let (format, bits) = match (storage, stored_bits, real_bits) {
            (Storage::Packed, ..) => (PixelFormat::Mono12, 12),
            (_, 8 | 24, _) => (PixelFormat::Mono8, 8),
            (Storage::Rows, _, 10) => (PixelFormat::Mono10, 10),
            (Storage::Rows, _, 12) => (PixelFormat::Mono12, 12),
            (_, _, bits) => (PixelFormat::Mono16, bits.clamp(8, 16)),
        };
        let shape = Shape::new(&cine.path, width.unsigned_abs().into(), height.unsigned_abs().into(), format)?;
        let is_packed = storage == Storage::Packed;
        Ok(Self {
            shape,
            bits,
            pixel_aspect: pixel_aspect(bitmap),
            storage,
            // A negative height puts the first row first, as in every Windows bitmap. Packed images always have it
            // first.
            is_bottom_up: height > 0 && !is_packed,
            is_mosaic: is_mosaic(cine, setup.color_filter(), storage)?,
            linear: if is_packed { linear_levels() } else { Vec::new() },
        })
    }

    /// Returns the rule that makes grey levels of the stored ones; empty for a grey film.
    pub(super) fn grey_rule(&self) -> &'static str {
        match self.storage {
            Storage::Colors => grey::LUMA,
            _ if self.is_mosaic => grey::MOSAIC,
            _ => "",
        }
    }

    /// Checks on the first image that no level exceeds the significant bits. Otherwise all 16 bits count, with a
    /// warning.
    pub(super) fn check_levels(&mut self, cine: &Cine, warnings: &mut Vec<String>) -> Result<(), ImportError> {
        if self.shape.format.bytes_per_pixel() == 1 || self.bits == 16 {
            return Ok(());
        }
        let highest = self.read_image(cine, 0)?.chunks_exact(2).map(|pair| u16_at(pair, 0)).max().unwrap_or(0);
        if u32::from(highest) >> self.bits > 0 {
            let bits = self.bits;
            warnings
                .push(format!("RealBPP says {bits} bits, but a level of {highest} is stored: all 16 bits are used"));
            (self.bits, self.shape.format) = (16, PixelFormat::Mono16);
        }
        Ok(())
    }

    /// Reads the grey levels of one image, top row first; `number` is counted from 0. Colours become their luma, a
    /// mosaic its brightness.
    pub(super) fn read_image(&self, cine: &Cine, number: u64) -> Pixels {
        let stored = cine.stored_image(number)?;
        let grey = match self.storage {
            Storage::Packed => self.unpack(cine, number, &stored)?,
            Storage::Rows => self.unpadded_rows(cine, number, &stored, 1)?,
            Storage::Colors => {
                let mut colors = self.unpadded_rows(cine, number, &stored, 3)?;
                let bytes = 3 * self.shape.format.bytes_per_pixel();
                // Blue is stored first.
                match bytes {
                    3 => colors.chunks_exact_mut(3).for_each(<[u8]>::reverse),
                    _ => colors.chunks_exact_mut(6).for_each(|pixel| {
                        pixel.swap(0, 4);
                        pixel.swap(1, 5);
                    }),
                }
                grey::luma(self.shape.format, &colors)
            }
        };
        Ok(if self.is_mosaic { grey::mosaic_brightness(self.shape, &grey) } else { grey })
    }

    /// Returns the stored rows of one image without their padding, top row first. A pixel has `channels` samples.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] when the size of the image is neither that with nor that without padding.
    fn unpadded_rows(&self, cine: &Cine, number: u64, stored: &[u8], channels: usize) -> Pixels {
        let (width, rows) = (self.shape.width_px as usize, self.shape.height_px as usize);
        let row_bytes = width * channels * self.shape.format.bytes_per_pixel();
        // Rows of a bitmap are padded to 4 bytes, which the widths of cameras rarely need.
        let padded_bytes = row_bytes.next_multiple_of(4);
        let row = match stored.len() {
            length if length == row_bytes * rows => row_bytes,
            length if length == padded_bytes * rows => padded_bytes,
            length => {
                let expected = row_bytes * rows;
                return Err(cine.invalid(format!("image {number}: {length} bytes are stored, expected {expected}")));
            }
        };
        let packed = |rows: &mut dyn Iterator<Item = &[u8]>| rows.flat_map(|r| &r[..row_bytes]).copied().collect();
        Ok(match self.is_bottom_up {
            true => packed(&mut stored.chunks_exact(row).rev()),
            false => packed(&mut stored.chunks_exact(row)),
        })
    }

    /// Unpacks pixels without gaps to linear 12-bit levels. The size of an image shows whether they have 10 or 12 bits.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] when it is the size of neither.
    fn unpack(&self, cine: &Cine, number: u64, stored: &[u8]) -> Pixels {
        let pixels = self.shape.width_px as usize * self.shape.height_px as usize;
        if pixels.is_multiple_of(4) && stored.len() == pixels / 4 * 5 {
            let words = unpack_msb_first(stored, 10);
            let codes = words.chunks_exact(2).map(|pair| u16_at(pair, 0));
            return Ok(codes.flat_map(|code| self.linear[usize::from(code)].to_le_bytes()).collect());
        }
        if pixels.is_multiple_of(2) && stored.len() == pixels / 2 * 3 {
            return Ok(unpack_msb_first(stored, 12));
        }
        Err(cine.invalid(format!("image {number}: {} bytes are not {pixels} pixels of 10 or 12 bits", stored.len())))
    }
}

/// Whether the pixels lie under a Bayer mosaic.
///
/// # Errors
///
/// [`ImportError::Invalid`] for any other colour filter.
fn is_mosaic(cine: &Cine, color_filter: u32, storage: Storage) -> Result<bool, ImportError> {
    match color_filter {
        _ if storage == Storage::Colors => Ok(false),
        0 => Ok(false),
        // Arrangements of red, green, green and blue in squares of 2 x 2 pixels.
        1..=4 => Ok(true),
        other => Err(cine.invalid(format!(
            "colour filter {other:#x}; only grey sensors and Bayer mosaics are supported: save it in grey"
        ))),
    }
}

/// Returns the width of a pixel over its height, from the resolutions in pixels per metre; 1 when they are not stated.
fn pixel_aspect(bitmap: &[u8]) -> f64 {
    let (x, y) = (u32_at(bitmap, 24) as i32, u32_at(bitmap, 28) as i32);
    if x > 0 && y > 0 { f64::from(y) / f64::from(x) } else { 1.0 }
}

/// Computes the 12-bit level of each 10-bit code of a packed image.
///
/// Packed images are coded like video with the curve of ITU-R BT.709-6 (section 1.2): black 64, white 4064, a line near
/// black and a power of 1 / 0.45 above. The constants are a least-squares fit to the levels of the Phantom software. No
/// code differs from them by more than 2 of 4095.
fn linear_levels() -> Vec<u16> {
    let level = |code: u16| {
        let code = f64::from(code);
        match code {
            _ if code < 153.0 => 0.938 * code + 4.38,
            _ if code < 1015.0 => {
                63.7084 + 4071.0901 * (((code - 63.881_06) / 958.301_88 + 0.099) / 1.099).powf(1.0 / 0.45)
            }
            _ => 4095.0,
        }
    };
    (0..1024).map(|code| level(code).round() as u16).collect()
}
