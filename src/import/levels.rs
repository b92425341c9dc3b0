//! The bits that grey levels use in 16-bit words.

use crate::image::PixelFormat;

/// Minimum number of different levels that show which bits are in use.
const MIN_LEVELS: usize = 32;
/// Minimum number of bits that a camera uses.
const MIN_BITS: u32 = 8;

/// Counts the bits at the lower end of little-endian 16-bit words that no pixel uses. Returns 0 for an image of fewer
/// than [`MIN_LEVELS`] levels, or if fewer than [`MIN_BITS`] bits would be left.
pub(super) fn unused_low_bits(pixels: &[u8]) -> u32 {
    let words = || pixels.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]]));
    let unused_bits = words().fold(0, |used, word| used | word).trailing_zeros();
    let mut levels: Vec<u16> = words().collect();
    levels.sort_unstable();
    levels.dedup();
    if unused_bits <= 16 - MIN_BITS && levels.len() >= MIN_LEVELS { unused_bits } else { 0 }
}

/// Returns the pixel format of 16-bit words with this number of significant bits: `Mono16` for all but 10 and 12.
pub(super) fn format_of_bits(bits: u32) -> PixelFormat {
    match bits {
        10 => PixelFormat::Mono10,
        12 => PixelFormat::Mono12,
        _ => PixelFormat::Mono16,
    }
}

/// Moves levels of little-endian 16-bit words down by this number of bits; `None` when a pixel uses one of these bits.
pub(super) fn shifted_down(pixels: Vec<u8>, unused_bits: u32) -> Option<Vec<u8>> {
    let words = || pixels.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]]));
    let is_empty = words().all(|word| word >> unused_bits << unused_bits == word);
    is_empty.then(|| words().flat_map(|word| (word >> unused_bits).to_le_bytes()).collect())
}
