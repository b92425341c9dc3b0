//! TIFF files of several pages: each page is a frame.
//!
//! Layout: TIFF 6.0, section 2; with 64-bit offsets, the BigTIFF design.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};

/// Most pages looked for.
const PAGES: usize = 1 << 20;
/// Longest header: that of BigTIFF.
const HEADER_BYTES: usize = 16;

/// How the numbers of a file are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Layout {
    is_little: bool,
    /// Whether offsets have 64 bits.
    is_big: bool,
}

impl Layout {
    fn of(header: &[u8; HEADER_BYTES]) -> Option<Self> {
        let is_little = match &header[..2] {
            b"II" => true,
            b"MM" => false,
            _ => return None,
        };
        let layout = Self { is_little, is_big: false };
        match layout.number(&header[2..4]) {
            42 => Some(layout),
            43 => Some(Self { is_big: true, ..layout }),
            _ => None,
        }
    }

    fn number(self, bytes: &[u8]) -> u64 {
        let add = |sum: u64, byte: &u8| sum << 8 | u64::from(*byte);
        if self.is_little { bytes.iter().rev().fold(0, add) } else { bytes.iter().fold(0, add) }
    }

    /// Bytes of an entry's values, by their type (TIFF 6.0, section 2) and count.
    fn value_bytes(self, entry: &[u8]) -> u64 {
        let each = match self.number(&entry[2..4]) {
            3 | 8 => 2,
            4 | 9 | 11 | 13 => 4,
            5 | 10 | 12 | 16..=18 => 8,
            _ => 1,
        };
        self.number(&entry[4..if self.is_big { 12 } else { 8 }]).saturating_mul(each)
    }

    /// Where the header has the offset of the first page.
    fn first(self) -> std::ops::Range<usize> {
        if self.is_big { 8..16 } else { 4..8 }
    }
}

/// Where the directories of the pages lie; empty for a file that is no TIFF.
///
/// # Errors
///
/// When the file ends within its directories, they lead back to one before, or name more values than the file can hold.
pub(super) fn directories(file: &mut (impl Read + Seek)) -> io::Result<Vec<u64>> {
    let mut header = [0; HEADER_BYTES];
    let end = file.seek(SeekFrom::End(0))?;
    file.rewind()?;
    file.read_exact(&mut header[..end.min(HEADER_BYTES as u64) as usize])?;
    let Some(layout) = Layout::of(&header) else { return Ok(Vec::new()) };
    let (count_bytes, entry_bytes, offset_bytes) = if layout.is_big { (8, 20, 8) } else { (2, 12, 4) };
    let mut pages = Vec::new();
    let mut seen = BTreeSet::new();
    let mut at = layout.number(&header[layout.first()]);
    let mut left = end;
    while at != 0 {
        if !seen.insert(at) || pages.len() == PAGES {
            return Err(io::Error::other(format!("they lead back to byte {at}, or are more than {PAGES}")));
        }
        pages.push(at);
        let mut number = [0; 8];
        file.seek(SeekFrom::Start(at))?;
        file.read_exact(&mut number[..count_bytes])?;
        let bytes = layout.number(&number[..count_bytes]).checked_mul(entry_bytes);
        // Directories that do not overlap cannot be larger than the file.
        let bytes = bytes.filter(|bytes| *bytes <= left).ok_or(io::ErrorKind::UnexpectedEof)?;
        left -= bytes;
        let mut entries = vec![0; bytes as usize];
        file.read_exact(&mut entries)?;
        if let Some(entry) = entries.chunks(entry_bytes as usize).find(|entry| layout.value_bytes(entry) > end) {
            let tag = layout.number(&entry[..2]);
            return Err(io::Error::other(format!("more values in tag {tag} at byte {at} than the file can hold")));
        }
        file.read_exact(&mut number[..offset_bytes])?;
        at = layout.number(&number[..offset_bytes]);
    }
    Ok(pages)
}

/// A file as if one of its pages were the first: every offset in it counts from the beginning of the file.
#[derive(Debug)]
pub(super) struct Page {
    file: File,
    header: [u8; HEADER_BYTES],
    at: u64,
}

impl Page {
    /// The page whose directory lies at this byte of a TIFF file.
    pub(super) fn new(mut file: File, directory: u64) -> io::Result<Self> {
        let mut header = [0; HEADER_BYTES];
        file.rewind()?;
        file.read_exact(&mut header)?;
        file.rewind()?;
        let layout = Layout::of(&header).ok_or(io::ErrorKind::InvalidData)?;
        let place = layout.first();
        let bytes = if layout.is_little { directory.to_le_bytes() } else { directory.to_be_bytes() };
        let start = if layout.is_little { 0 } else { 8 - place.len() };
        header[place.clone()].copy_from_slice(&bytes[start..start + place.len()]);
        Ok(Self { file, header, at: 0 })
    }
}

impl Read for Page {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.file.read(buffer)?;
        if let Some(rest) = self.header.get(usize::try_from(self.at).unwrap_or(usize::MAX)..) {
            let inside = rest.len().min(count);
            buffer[..inside].copy_from_slice(&rest[..inside]);
        }
        self.at += count as u64;
        Ok(count)
    }
}

impl Seek for Page {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.at = self.file.seek(to)?;
        Ok(self.at)
    }
}
