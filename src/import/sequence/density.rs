//! The shape of a pixel, as PNG and JPEG files state it.
//!
//! "Portable Network Graphics (PNG) Specification", section 11.3.4.3 (pHYs); "JPEG File Interchange Format", version
//! 1.02.

use std::fs::File;
use std::os::unix::fs::FileExt;

/// Length of the beginning of a file that is searched, bytes.
const HEAD_BYTES: usize = 4096;
/// The first bytes of a PNG file.
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";
/// The first bytes of a JPEG file with a JFIF segment.
const JFIF: &[u8] = b"\xff\xd8\xff\xe0";

/// Returns the width of a pixel over its height; 1 when the beginning of the file does not state it.
pub(super) fn pixel_aspect(file: &File) -> f64 {
    let mut head = vec![0; HEAD_BYTES];
    let length = file.read_at(&mut head, 0).unwrap_or(0);
    head.truncate(length);
    let densities = if head.starts_with(PNG) { png_density(&head) } else { jpeg_density(&head) };
    // The more pixels per length, the shorter a pixel.
    densities.filter(|[x, y]| *x > 0 && *y > 0).map_or(1.0, |[x, y]| f64::from(y) / f64::from(x))
}

/// Returns the pixels per length along x and y from the chunk `pHYs`; `None` without one before the image data.
fn png_density(head: &[u8]) -> Option<[u32; 2]> {
    let mut at = PNG.len();
    loop {
        let (bytes, kind) = (u32_at(head, at)? as usize, head.get(at + 4..at + 8)?);
        match kind {
            b"pHYs" => return Some([u32_at(head, at + 8)?, u32_at(head, at + 12)?]),
            b"IDAT" => return None,
            _ => at = at.checked_add(bytes)?.checked_add(12)?,
        }
    }
}

/// Returns the pixels per length along x and y from the JFIF segment, or two numbers in their ratio if it states no
/// unit. `None` without such a segment.
fn jpeg_density(head: &[u8]) -> Option<[u32; 2]> {
    let is_jfif = head.starts_with(JFIF) && head.get(6..11)? == b"JFIF\0";
    let u16_at = |at: usize| Some(u32::from(*head.get(at)?) << 8 | u32::from(*head.get(at + 1)?));
    if is_jfif { Some([u16_at(14)?, u16_at(16)?]) } else { None }
}

/// Reads the big-endian number of 32 bits at byte `at`; `None` beyond the end.
fn u32_at(head: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_be_bytes(head.get(at..at.checked_add(4)?)?.try_into().ok()?))
}
