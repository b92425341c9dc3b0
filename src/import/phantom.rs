//! Phantom CINE recordings, uncompressed and grey.
//!
//! Layout: "Cine File Format", Vision Research: a file header, a Windows BITMAPINFOHEADER, the camera's set-up, and a
//! table with the offsets of the images.

use super::footage::{Footage, Shape};
use super::timeline::{Rate, Timeline};
use super::{ImportError, open_file};
use crate::image::PixelFormat;
use std::collections::BTreeMap;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

const FILE_HEADER_BYTES: usize = 44;
const BITMAP_HEADER_BYTES: usize = 40;
/// Offsets in the set-up.
const SETUP_MARK: usize = 140;
const SETUP_FRAME_RATE: usize = 768;
const SETUP_REAL_BITS: usize = 896;
const SETUP_BYTES: usize = 900;
/// Minimum length of the set-up. That of old files ends before the frame rate and the significant bits.
const SETUP_MIN_BYTES: usize = 144;
/// `biCompression` of 10-bit pixels packed without gaps.
const PACKED_10: u32 = 256;
/// Maximum number of images in a file.
const IMAGES: u32 = 1 << 24;

/// An open file and the layout of its images.
struct Cine {
    path: PathBuf,
    file: File,
    file_bytes: u64,
    row_bytes: usize,
    frame_bytes: usize,
    is_bottom_up: bool,
    is_packed: bool,
    /// The 12-bit level of each packed 10-bit code.
    linear: Vec<u16>,
    /// The offset of the table of the images' offsets in the file.
    offsets: u64,
}

pub(super) fn open(path: &Path, fps: Option<f64>) -> Result<Footage, ImportError> {
    let (file, file_bytes) = open_file(path)?;
    let mut cine = Cine {
        path: path.to_path_buf(),
        file,
        file_bytes,
        row_bytes: 0,
        frame_bytes: 0,
        is_bottom_up: true,
        is_packed: false,
        linear: linear_levels(),
        offsets: 0,
    };
    let header = cine.read(0, FILE_HEADER_BYTES)?;
    if header[..2] != *b"CI" {
        return Err(cine.invalid("not a CINE file: the letters CI are missing at byte 0"));
    }
    if u16_at(&header, 4) != 0 {
        return Err(
            cine.invalid(format!("compression {}; only uncompressed grey images are supported", u16_at(&header, 4)))
        );
    }
    let (first_image, count) = (u32_at(&header, 16) as i32, u32_at(&header, 20));
    if count == 0 || count > IMAGES {
        return Err(cine.invalid(format!("{count} images; 1 to {IMAGES} are supported")));
    }
    cine.offsets = u64::from(u32_at(&header, 32));
    let setup = cine.setup(u64::from(u32_at(&header, 28)))?;
    let bitmap = cine.read(u64::from(u32_at(&header, 24)), BITMAP_HEADER_BYTES)?;
    let shape = cine.layout(&bitmap, &setup)?;
    let rate = Rate::known(path, fps, setup_rate(&setup))?;
    // The fraction of the trigger's time has units of 2^-32 s.
    let trigger_ns =
        u64::from(u32_at(&header, 40)) * 1_000_000_000 + ((u64::from(u32_at(&header, 36)) * 1_000_000_000) >> 32);
    let first_ns = (f64::from(first_image) * 1e9 / rate.hz).round() as i64;
    let frames = (0..u64::from(count)).map(move |number| cine.image(number));
    let timeline = Timeline { first_ns: trigger_ns.saturating_add_signed(first_ns), ..Timeline::consecutive(rate) };
    let description = description(&setup, first_image);
    Ok(Footage { description, ..Footage::new(shape, timeline, count.into(), frames) })
}

impl Cine {
    fn invalid(&self, reason: impl Into<String>) -> ImportError {
        ImportError::invalid(&self.path, reason)
    }

    fn read(&self, at: u64, count: usize) -> Result<Vec<u8>, ImportError> {
        if at.checked_add(count as u64).is_none_or(|end| end > self.file_bytes) {
            return Err(self.invalid(format!("the file is cut off: {count} bytes at byte {at} reach beyond its end")));
        }
        let mut bytes = vec![0; count];
        self.file.read_exact_at(&mut bytes, at).map_err(|error| ImportError::io("read", &self.path, error))?;
        Ok(bytes)
    }

    /// Reads the set-up at byte `at`, as long as the file has it, and checks its mark.
    fn setup(&self, at: u64) -> Result<Vec<u8>, ImportError> {
        let mut setup = self.read(at, SETUP_MIN_BYTES)?;
        if setup[SETUP_MARK..SETUP_MARK + 2] != *b"ST" {
            return Err(self.invalid(format!("no set-up at byte {at}")));
        }
        let bytes = usize::from(u16_at(&setup, SETUP_MARK + 2)).min(SETUP_BYTES);
        if bytes > SETUP_MIN_BYTES {
            setup = self.read(at, bytes)?;
        }
        Ok(setup)
    }

    fn layout(&mut self, bitmap: &[u8], setup: &[u8]) -> Result<Shape, ImportError> {
        let (width, height) = (u32_at(bitmap, 4) as i32, u32_at(bitmap, 8) as i32);
        let (bits, compression) = (u16_at(bitmap, 14), u32_at(bitmap, 16));
        self.is_packed = compression == PACKED_10;
        if compression != 0 && !self.is_packed {
            return Err(
                self.invalid(format!("bitmap compression {compression}; only uncompressed images are supported"))
            );
        }
        let real_bits = (setup.len() >= SETUP_REAL_BITS + 4).then(|| u32_at(setup, SETUP_REAL_BITS));
        let format = match (bits, real_bits) {
            _ if self.is_packed => PixelFormat::Mono12,
            (8, _) => PixelFormat::Mono8,
            (16, Some(10)) => PixelFormat::Mono10,
            (16, Some(12)) => PixelFormat::Mono12,
            (16, _) => PixelFormat::Mono16,
            (bits, _) => return Err(self.invalid(format!("{bits} bits per pixel; 8 and 16 are supported"))),
        };
        let shape = Shape::new(&self.path, width.unsigned_abs().into(), height.unsigned_abs().into(), format)?;
        self.frame_bytes = shape.bytes() as usize;
        self.row_bytes = shape.width_px as usize * format.bytes_per_pixel();
        // A negative height puts the first row first, as in every Windows bitmap. Packed images always have it first.
        self.is_bottom_up = height > 0 && !self.is_packed;
        Ok(shape)
    }

    /// Reads the pixels of one image, top row first.
    fn image(&self, number: u64) -> Result<Vec<u8>, ImportError> {
        let offset = self.read(self.offsets + number * 8, 8)?;
        let at = u64::from(u32_at(&offset, 0)) | u64::from(u32_at(&offset, 4)) << 32;
        let annotation_bytes = u32_at(&self.read(at, 4)?, 0);
        if annotation_bytes < 8 {
            return Err(self.invalid(format!("image {number}: an annotation of {annotation_bytes} bytes at byte {at}")));
        }
        let pixels_at = at + u64::from(annotation_bytes);
        let stored = u32_at(&self.read(pixels_at - 4, 4)?, 0) as usize;
        if self.is_packed {
            return self.packed_image(number, pixels_at, stored);
        }
        // Rows of a bitmap are padded to 4 bytes, which the widths of cameras rarely need.
        let padded_row = self.row_bytes.next_multiple_of(4);
        let rows = self.frame_bytes / self.row_bytes;
        let row = match stored {
            _ if stored == self.frame_bytes => self.row_bytes,
            _ if stored == padded_row * rows => padded_row,
            _ => {
                let expected = self.frame_bytes;
                return Err(self.invalid(format!("image {number}: {stored} bytes at byte {at}, expected {expected}")));
            }
        };
        let bytes = self.read(pixels_at, stored)?;
        let packed = |rows: &mut dyn Iterator<Item = &[u8]>| rows.flat_map(|r| &r[..self.row_bytes]).copied().collect();
        Ok(match self.is_bottom_up {
            true => packed(&mut bytes.chunks_exact(row).rev()),
            false => packed(&mut bytes.chunks_exact(row)),
        })
    }

    /// Reads 10-bit pixels stored without gaps as 12-bit levels.
    fn packed_image(&self, number: u64, at: u64, stored: usize) -> Result<Vec<u8>, ImportError> {
        let pixels = self.frame_bytes / 2;
        if !pixels.is_multiple_of(4) || stored != pixels / 4 * 5 {
            return Err(self.invalid(format!("image {number}: {stored} bytes are not {pixels} pixels of 10 bits")));
        }
        let words = super::unpack_high_first(&self.read(at, stored)?, 10);
        let codes = words.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]]));
        Ok(codes.flat_map(|code| self.linear[usize::from(code)].to_le_bytes()).collect())
    }
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

fn setup_rate(setup: &[u8]) -> Option<Rate> {
    match setup.len() >= SETUP_FRAME_RATE + 4 {
        true => Rate::of_header(f64::from(u32_at(setup, SETUP_FRAME_RATE)), "FrameRate"),
        // Old files have only the 16-bit rate at the beginning.
        false => Rate::of_header(f64::from(u16_at(setup, 0)), "FrameRate16"),
    }
}

fn description(setup: &[u8], first_image: i32) -> BTreeMap<String, String> {
    let mut entries = BTreeMap::from([("first_image".to_owned(), first_image.to_string())]);
    if setup.len() >= SETUP_BYTES {
        entries.insert("camera".into(), "Phantom".into());
    }
    entries
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}
