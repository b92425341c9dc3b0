//! TIFF files of one or several pages: each page is a frame.

use super::still::Still;
use super::{ImportError, memory_limit_bytes, open_file};
use image::{DynamicImage, ImageBuffer};
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::{ColorType, TiffError, TiffFormatError};

/// Maximum number of pages.
const PAGES_MAX: u64 = 1 << 20;

/// The pages of a TIFF file, read one after the other.
pub(super) struct Stack {
    path: PathBuf,
    decoder: Decoder<BufReader<File>>,
    pages: u64,
    /// Maximum number of pixels of a page.
    pixels_max: u64,
    /// The number of the next page.
    next: u64,
}

impl Stack {
    /// Opens a file; `None` when it is no TIFF.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] when the file ends within the directory of a page, or its directories form a cycle.
    pub(super) fn open(path: &Path) -> Result<Option<Self>, ImportError> {
        let (file, file_bytes) = open_file(path)?;
        let mut pages = 0;
        let decoder = match Self::walk(file, file_bytes, &mut pages) {
            Err(TiffError::FormatError(
                TiffFormatError::TiffSignatureNotFound | TiffFormatError::TiffSignatureInvalid,
            )) => return Ok(None),
            walked => walked.map_err(|error| invalid(path, pages, &error))?,
        };
        let pixels_max = memory_limit_bytes(file_bytes) / 2;
        Ok(Some(Self { path: path.to_path_buf(), decoder, pages, pixels_max, next: 0 }))
    }

    /// Counts the pages and returns to the first.
    fn walk(file: File, file_bytes: u64, pages: &mut u64) -> Result<Decoder<BufReader<File>>, TiffError> {
        // The decoded page and its compressed strips are in memory at the same time.
        let bytes = memory_limit_bytes(file_bytes) as usize / 2;
        let mut limits = Limits::default();
        (limits.decoding_buffer_size, limits.intermediate_buffer_size) = (bytes, bytes);
        limits.ifd_value_size = limits.ifd_value_size.min(file_bytes as usize);
        let mut reader = BufReader::new(file);
        check_first_directory(&mut reader, file_bytes)?;
        let mut decoder = Decoder::new(reader)?.with_limits(limits);
        *pages = 1;
        while decoder.more_images() {
            decoder.next_image()?;
            *pages += 1;
            if *pages > PAGES_MAX {
                return Err(TiffError::LimitsExceeded);
            }
        }
        decoder.seek_to_image(0)?;
        Ok(decoder)
    }

    /// The number of pages.
    pub(super) fn pages(&self) -> u64 {
        self.pages
    }

    /// Decodes the next page.
    fn decode(&mut self) -> Result<Option<DynamicImage>, TiffError> {
        if self.next > 0 {
            self.decoder.next_image()?;
        }
        let (width, height) = self.decoder.dimensions()?;
        // A page of one bit per pixel grows to a byte per pixel.
        if u64::from(width) * u64::from(height) > self.pixels_max {
            return Err(TiffError::LimitsExceeded);
        }
        Ok(match (self.decoder.colortype()?, self.decoder.read_image()?) {
            (ColorType::Gray(1), DecodingResult::U8(bits)) => {
                let row = |row: &[u8]| (0..width as usize).map(|x| 255 * (row[x / 8] >> (7 - x % 8) & 1)).collect();
                let levels = bits.chunks_exact(width.div_ceil(8) as usize).flat_map::<Vec<u8>, _>(row).collect();
                ImageBuffer::from_raw(width, height, levels).map(DynamicImage::ImageLuma8)
            }
            (ColorType::Gray(8), DecodingResult::U8(levels)) => {
                ImageBuffer::from_raw(width, height, levels).map(DynamicImage::ImageLuma8)
            }
            (ColorType::Gray(16), DecodingResult::U16(levels)) => {
                ImageBuffer::from_raw(width, height, levels).map(DynamicImage::ImageLuma16)
            }
            (ColorType::RGB(8), DecodingResult::U8(levels)) => {
                ImageBuffer::from_raw(width, height, levels).map(DynamicImage::ImageRgb8)
            }
            _ => None,
        })
    }
}

impl Iterator for Stack {
    type Item = Result<Still, ImportError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.next == self.pages {
            return None;
        }
        let decoded = self.decode().map_err(|error| invalid(&self.path, self.next, &error));
        self.next += 1;
        Some(decoded.and_then(|picture| Still::new(&self.path, picture)))
    }
}

/// Checks that the values of the first directory fit into the file, and returns to its start.
///
/// The decoder takes limits only after it has read that directory. A count that is not checked here would allocate up
/// to 256 MiB for a file of a few bytes.
fn check_first_directory(reader: &mut BufReader<File>, file_bytes: u64) -> Result<(), TiffError> {
    let mut head = [0; 16];
    let length = read_at(reader, 0, &mut head)?;
    let is_big_endian = head.starts_with(b"MM");
    let number = |bytes: &[u8]| {
        let fold = |value: u64, byte: &u8| value << 8 | u64::from(*byte);
        if is_big_endian { bytes.iter().fold(0, fold) } else { bytes.iter().rev().fold(0, fold) }
    };
    let is_tiff = length >= 8 && (is_big_endian || head.starts_with(b"II"));
    // Bytes of a directory's length, of an entry, and of its count; the place of the first directory.
    let (count_bytes, entry_bytes, value_bytes, at) = match number(&head[2..4]) {
        42 if is_tiff => (2, 12, 4, number(&head[4..8])),
        43 if is_tiff => (8, 20, 8, number(&head[8..16])),
        _ => return rewind(reader),
    };
    let mut count = [0; 8];
    read_at(reader, at, &mut count[..count_bytes])?;
    let mut entry = [0; 20];
    for index in 0..number(&count[..count_bytes]).min(file_bytes / entry_bytes as u64) {
        let entry_at = at.saturating_add(count_bytes as u64 + index * entry_bytes as u64);
        if read_at(reader, entry_at, &mut entry[..entry_bytes])? == entry_bytes
            && number(&entry[4..4 + value_bytes]) > file_bytes
        {
            return Err(TiffError::LimitsExceeded);
        }
    }
    rewind(reader)
}

/// Reads at a place of the file, as far as the file goes; returns the number of bytes.
fn read_at(reader: &mut BufReader<File>, at: u64, into: &mut [u8]) -> Result<usize, TiffError> {
    reader.seek(SeekFrom::Start(at))?;
    let mut length = 0;
    while length < into.len() {
        match reader.read(&mut into[length..])? {
            0 => break,
            read => length += read,
        }
    }
    Ok(length)
}

fn rewind(reader: &mut BufReader<File>) -> Result<(), TiffError> {
    Ok(reader.rewind()?)
}

/// The error for a page, which is counted from 0.
fn invalid(path: &Path, page: u64, error: &TiffError) -> ImportError {
    ImportError::invalid(path, format!("page {page}: {error}"))
}
