//! The first directory of a TIFF file, before the decoder reads it.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use tiff::TiffError;

/// Checks that the values of the first directory fit into the file, and returns to its start.
///
/// The decoder takes limits only after it has read that directory. A count that is not checked here would allocate up
/// to 256 MiB for a file of a few bytes.
pub(super) fn check(reader: &mut BufReader<File>, file_bytes: u64) -> Result<(), TiffError> {
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

/// Fills `into` from byte `at` of the file on, as far as the file goes; returns the number of bytes read.
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

/// Returns to the start of the file.
fn rewind(reader: &mut BufReader<File>) -> Result<(), TiffError> {
    Ok(reader.rewind()?)
}
