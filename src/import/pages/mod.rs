//! TIFF files of one or several pages: each page is a frame.

mod description;
mod first_directory;
mod page;

use super::rate::Rate;
use super::shape::Shape;
use super::still::{DisplayInfo, Still};
use super::timeline::FrameTimes;
use super::{ImportError, date, memory_limit_bytes, open_file};
use description::Description;
use page::Page;
use std::fs::File;
use std::io::BufReader;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use tiff::decoder::{Decoder, Limits};
use tiff::tags::Tag;
use tiff::{TiffError, TiffFormatError};

/// Maximum number of pages.
const MAX_PAGES: u64 = 1 << 20;

/// The pages of a TIFF file, read one after the other.
pub(super) struct Stack {
    path: PathBuf,
    decoder: Decoder<BufReader<File>>,
    description: Description,
    /// Number of directories.
    directories: u64,
    /// The images behind the one of the first directory, which have none of their own.
    contiguous: Option<ContiguousImages>,
    /// Maximum size of a decoded page, bytes.
    max_bytes: u64,
    /// The number of the next page.
    next: u64,
}

/// Images that follow the first one without gaps.
struct ContiguousImages {
    file: File,
    page: Page,
    display: DisplayInfo,
    /// Offset of the first image, bytes.
    start: u64,
    count: u64,
}

impl Stack {
    /// Opens a file and counts its pages; `None` when it is no TIFF.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] when the file ends within the directory of a page, its directories form a cycle, or
    /// more images are announced than are there, or when its images are channels or layers.
    pub(super) fn open(path: &Path) -> Result<Option<Self>, ImportError> {
        let (file, file_bytes) = open_file(path)?;
        let mut directories = 0;
        let mut decoder = match Self::count_pages(file, file_bytes, &mut directories) {
            Err(TiffError::FormatError(
                TiffFormatError::TiffSignatureNotFound | TiffFormatError::TiffSignatureInvalid,
            )) => return Ok(None),
            counted => counted.map_err(|error| page_error(path, directories, &error))?,
        };
        let max_bytes = memory_limit_bytes(file_bytes) / 2;
        let text = decoder.find_tag(Tag::ImageDescription).ok().flatten().and_then(|tag| tag.into_string().ok());
        let description = Description::parse(&text.unwrap_or_default());
        description.check().map_err(|reason| ImportError::invalid(path, reason))?;
        let path = path.to_path_buf();
        let mut stack = Self { path, decoder, description, directories, contiguous: None, max_bytes, next: 0 };
        if directories == 1 {
            stack.contiguous = stack.find_contiguous_images(file_bytes)?;
        }
        Ok(Some(stack))
    }

    /// Counts the pages and returns a decoder at the first. `pages` is right up to the page of an error.
    fn count_pages(file: File, file_bytes: u64, pages: &mut u64) -> Result<Decoder<BufReader<File>>, TiffError> {
        // The decoded page and its compressed strips are in memory at the same time.
        let bytes = memory_limit_bytes(file_bytes) as usize / 2;
        let mut limits = Limits::default();
        (limits.decoding_buffer_size, limits.intermediate_buffer_size) = (bytes, bytes);
        limits.ifd_value_size = limits.ifd_value_size.min(file_bytes as usize);
        let mut reader = BufReader::new(file);
        first_directory::check(&mut reader, file_bytes)?;
        let mut decoder = Decoder::new(reader)?.with_limits(limits);
        *pages = 1;
        while decoder.more_images() {
            decoder.next_image()?;
            *pages += 1;
            if *pages > MAX_PAGES {
                return Err(TiffError::LimitsExceeded);
            }
        }
        decoder.seek_to_image(0)?;
        Ok(decoder)
    }

    /// Finds the images that a program announces in the only directory and writes behind its image, without directories
    /// of their own. `None` when no more than one is announced.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] when they are not stored uncompressed in one piece, or the file has fewer than two.
    fn find_contiguous_images(&mut self, file_bytes: u64) -> Result<Option<ContiguousImages>, ImportError> {
        let Some(announced) = self.description.images.filter(|images| *images > 1) else { return Ok(None) };
        let refused = |there: u64| {
            let cure = "save it again with a directory for each image";
            ImportError::invalid(&self.path, format!("{announced} images are announced, {there} can be read: {cure}"))
        };
        let raw = Page::raw(&mut self.decoder).map_err(|error| page_error(&self.path, 0, &error))?;
        let Some((page, start)) = raw.filter(|(page, _)| page.bytes() > 0) else { return Err(refused(1)) };
        let display = page.display_info(&mut self.decoder, &self.path)?;
        let there = file_bytes.saturating_sub(start) / page.bytes();
        if there < 2 {
            return Err(refused(there));
        }
        let (file, _) = open_file(&self.path)?;
        Ok(Some(ContiguousImages { file, page, display, start, count: announced.min(there) }))
    }

    /// Returns the number of pages.
    pub(super) fn pages(&self) -> u64 {
        self.contiguous.as_ref().map_or(self.directories, |contiguous| contiguous.count)
    }

    /// Reports pages that are announced but missing.
    pub(super) fn warnings(&self) -> Vec<String> {
        let pages = self.pages();
        let missing = self.description.images.filter(|announced| *announced != pages && pages > 1);
        missing.map(|announced| format!("{announced} images are announced, the file has {pages}")).into_iter().collect()
    }

    /// Returns the rate that the description states, that of playback if it states no other.
    pub(super) fn rate(&self) -> Option<Rate> {
        self.description.rate.clone()
    }

    /// Returns the times that the description states, if it has one for each page.
    pub(super) fn times(&self) -> Option<FrameTimes> {
        let times = self.description.times.as_ref()?;
        (times.times_ns.len() as u64 == self.pages()).then(|| times.clone())
    }

    /// Returns the date and time of the current page, the first before any other is decoded, in ISO 8601 and without a
    /// time zone, as the file states it. `None` where it states none.
    pub(super) fn date(&mut self) -> Option<String> {
        let text = self.decoder.find_tag(Tag::DateTime).ok()??.into_string().ok()?;
        date::from_exif_text(&text)
    }

    /// Decodes the next page to a grey image as it is displayed.
    fn decode(&mut self) -> Result<Still, ImportError> {
        if let Some(contiguous) = &self.contiguous {
            let mut stored = vec![0; contiguous.page.bytes() as usize];
            let read =
                contiguous.file.read_exact_at(&mut stored, contiguous.start + self.next * contiguous.page.bytes());
            read.map_err(|error| ImportError::io("read", &self.path, error))?;
            let page = &contiguous.page;
            let grey = page.grey(page.to_native_byte_order(stored)).map_err(|why| self.refused(why))?;
            return Still::new(&self.path, page.shape(&self.path)?, grey, contiguous.display.clone());
        }
        if self.next > 0 {
            self.decoder.next_image().map_err(|error| page_error(&self.path, self.next, &error))?;
        }
        let page = Page::new(&mut self.decoder).map_err(|error| page_error(&self.path, self.next, &error))?;
        let page = page.map_err(|why| self.refused(why))?;
        let shape: Shape = page.shape(&self.path)?;
        // A page of one bit per pixel grows to a byte per pixel.
        if page.decoded_bytes() > self.max_bytes {
            return Err(page_error(&self.path, self.next, &TiffError::LimitsExceeded));
        }
        let display = page.display_info(&mut self.decoder, &self.path)?;
        let decoded = page.decode(&mut self.decoder).map_err(|error| page_error(&self.path, self.next, &error))?;
        let grey = page.grey(decoded).map_err(|why| self.refused(why))?;
        Still::new(&self.path, shape, grey, display)
    }

    /// Returns the error that the next page is refused, for the reason `why`.
    fn refused(&self, why: String) -> ImportError {
        ImportError::invalid(&self.path, format!("page {}: {why}", self.next))
    }
}

impl Iterator for Stack {
    type Item = Result<Still, ImportError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.next == self.pages() {
            return None;
        }
        let decoded = self.decode();
        self.next += 1;
        Some(decoded)
    }
}

/// Returns the import error of a decoder's error at a page, which is counted from 0.
fn page_error(path: &Path, page: u64, error: &TiffError) -> ImportError {
    ImportError::invalid(path, format!("page {page}: {error}"))
}
