//! TIFF files of one or several pages: each page is a frame.

use super::still::Still;
use super::{ImportError, memory_limit_bytes, open_file};
use image::{DynamicImage, ImageBuffer};
use std::fs::File;
use std::io::BufReader;
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
        Ok(Some(Self { path: path.to_path_buf(), decoder, pages, next: 0 }))
    }

    /// Counts the pages and returns to the first.
    fn walk(file: File, file_bytes: u64, pages: &mut u64) -> Result<Decoder<BufReader<File>>, TiffError> {
        let bytes = memory_limit_bytes(file_bytes) as usize;
        let mut limits = Limits::default();
        (limits.decoding_buffer_size, limits.intermediate_buffer_size) = (bytes, bytes);
        let mut decoder = Decoder::new(BufReader::new(file))?.with_limits(limits);
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

/// The error for a page, which is counted from 0.
fn invalid(path: &Path, page: u64, error: &TiffError) -> ImportError {
    ImportError::invalid(path, format!("page {page}: {error}"))
}
