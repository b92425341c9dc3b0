//! TIFF files with several pages.

use super::{frames, refusal};
use ricochet::image::PixelFormat;
use ricochet::import;
use std::fs;

/// Variants of a TIFF file: byte order, and 64-bit offsets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    Little,
    Big,
    LittleLong,
    BigLong,
}

pub const KINDS: [Kind; 4] = [Kind::Little, Kind::Big, Kind::LittleLong, Kind::BigLong];

/// A page: width, height, 8-bit levels.
pub type Page = (u32, u32, Vec<u8>);

pub fn page_of(width: u32, height: u32, k: u32) -> Page {
    (width, height, (0..width * height).map(|at| (at * 7 + k * 31) as u8).collect())
}

/// A file of uncompressed pages, each directory in front of its pixels.
pub fn tiff(kind: Kind, pages: &[Page]) -> Vec<u8> {
    let is_little = matches!(kind, Kind::Little | Kind::LittleLong);
    let is_long = matches!(kind, Kind::LittleLong | Kind::BigLong);
    let number = |value: u64, bytes: usize| -> Vec<u8> {
        if is_little { value.to_le_bytes()[..bytes].to_vec() } else { value.to_be_bytes()[8 - bytes..].to_vec() }
    };
    let wide = if is_long { 8 } else { 4 };
    let mut file = if is_little { b"II".to_vec() } else { b"MM".to_vec() };
    file.extend(number(if is_long { 43 } else { 42 }, 2));
    if is_long {
        file.extend([number(8, 2), number(0, 2)].concat());
    }
    file.extend(number(if is_long { 16 } else { 8 }, wide));
    for (index, (width, height, pixels)) in pages.iter().enumerate() {
        let count_bytes = if is_long { 8 } else { 2 };
        let pixels_at = file.len() + count_bytes + 8 * (4 + 2 * wide) + wide;
        let end = (pixels_at + pixels.len()).next_multiple_of(2);
        let entries = [
            (256, *width as usize),
            (257, *height as usize),
            (258, 8),
            (259, 1),
            (262, 1),
            (273, pixels_at),
            (278, *height as usize),
            (279, pixels.len()),
        ];
        file.extend(number(entries.len() as u64, count_bytes));
        for (tag, value) in entries {
            // Type LONG, 4 bytes, at the start of the field.
            let mut field = number(value as u64, 4);
            field.resize(wide, 0);
            file.extend([number(tag, 2), number(4, 2), number(1, wide), field].concat());
        }
        file.extend(number(if index + 1 < pages.len() { end as u64 } else { 0 }, wide));
        file.extend(pixels);
        file.resize(end, 0);
    }
    file
}

#[test]
fn the_pages_of_a_tiff_file_are_a_sequence() {
    let folder = tempfile::tempdir().unwrap();
    let path = [folder.path().join("stack.tif")];
    let pages: Vec<Page> = (0..5).map(|k| page_of(9, 7, k)).collect();
    for kind in KINDS {
        fs::write(&path[0], tiff(kind, &pages)).unwrap();
        let read = frames(&path, Some(2000.0));
        assert_eq!(read.len(), 5, "{kind:?}");
        for (k, (meta, pixels)) in read.iter().enumerate() {
            assert_eq!((meta.width_px, meta.height_px, meta.format), (9, 7, PixelFormat::Mono8));
            assert_eq!((meta.sequence, meta.stamp_ns), (k as u64, k as u64 * 500_000));
            assert_eq!(pixels, &pages[k].2, "{kind:?}, page {k}");
        }
        fs::write(&path[0], tiff(kind, &pages[..1])).unwrap();
        assert_eq!(frames(&path, Some(1.0))[0].1, pages[0].2, "one page is a still");
    }
    assert!(refusal(&path, None).contains("--fps"));
}

#[test]
fn page_offsets_that_loop_or_leave_the_file_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = [folder.path().join("stack.tif")];
    for kind in KINDS {
        let whole = tiff(kind, &[page_of(4, 4, 0), page_of(4, 4, 1)]);
        for length in 0..whole.len() {
            fs::write(&path[0], &whole[..length]).unwrap();
            let line = match import::open(&path, Some(1.0)) {
                // Truncated behind the first page's directory, the file may still hold its pixels.
                Ok(footage) => footage.filter_map(Result::err).map(|error| error.to_string()).collect(),
                Err(error) => error.to_string(),
            };
            assert!(line.contains("stack.tif") && !line.contains('\n'), "{kind:?} cut at {length}: {line}");
        }
    }
    // The first directory has 8 entries from byte 8 on, followed by the offset of the next one.
    let mut looped = tiff(Kind::Little, &[page_of(4, 4, 0), page_of(4, 4, 1)]);
    looped[8 + 2 + 8 * 12..][..4].copy_from_slice(&8_u32.to_le_bytes());
    fs::write(&path[0], &looped).unwrap();
    assert!(refusal(&path, Some(1.0)).contains("cycle"));
    // The value count of the last entry.
    let mut large = tiff(Kind::Little, &[page_of(4, 4, 0)]);
    large[8 + 2 + 7 * 12 + 4..][..4].copy_from_slice(&(1_u32 << 23).to_le_bytes());
    fs::write(&path[0], &large).unwrap();
    assert!(refusal(&path, Some(1.0)).contains("page 0: "));
}
