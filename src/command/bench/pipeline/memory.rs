//! The bandwidth of the memory, as one core sees it.

use super::super::rate_per_s;
use std::time::Duration;

/// The memory that is copied from, and to, bytes: more than the caches hold.
const POOL_BYTES: usize = 256 << 20;
/// The time that is copied for.
const DURATION: Duration = Duration::from_millis(200);

/// Returns the bytes that one core copies per second, in pieces of this size, from and to memory that no cache holds.
pub(super) fn copied_bytes_per_s(piece_bytes: u64) -> f64 {
    let piece = usize::try_from(piece_bytes).unwrap_or(POOL_BYTES).clamp(1, POOL_BYTES);
    // Not zero, for which the system would map one page again and again.
    let (from, mut to) = (vec![1_u8; POOL_BYTES], vec![2_u8; POOL_BYTES]);
    let mut place = 0;
    let bytes_per_s = rate_per_s(DURATION, || {
        to[place..place + piece].copy_from_slice(&from[place..place + piece]);
        place = if place + 2 * piece <= POOL_BYTES { place + piece } else { 0 };
        piece
    });
    std::hint::black_box(&to);
    bytes_per_s
}
