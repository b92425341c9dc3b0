//! The memory of the ring: checks that it fits, and touches its pages before the first frame.
#![expect(unsafe_code, reason = "madvise acts on memory of the bus library")]

use super::BusError;
use rustix::mm::{Advice, madvise};
use std::ffi::c_void;

/// Checks that `/dev/shm` has `needed_bytes` free.
pub(super) fn require(needed_bytes: u64) -> Result<(), BusError> {
    let Ok(stat) = rustix::fs::statvfs("/dev/shm") else { return Ok(()) };
    let free_bytes = stat.f_bavail * stat.f_frsize;
    if free_bytes < needed_bytes {
        return Err(BusError::Memory { needed_bytes, free_bytes });
    }
    Ok(())
}

/// Makes every page of the mapping that holds `address` present and writable.
///
/// A kernel before 5.14 does not know the request. That is no error; the pages are then mapped one by one.
pub(super) fn populate(address: usize) -> Result<(), BusError> {
    let Some((start, end)) = mapping(address) else { return Ok(()) };
    let bytes = end - start;
    // SAFETY: the range is one whole mapping of this process; populating changes no content.
    let touched = unsafe { madvise(start as *mut c_void, bytes, Advice::LinuxPopulateWrite) };
    match touched {
        Err(rustix::io::Errno::FAULT) => Err(BusError::Memory { needed_bytes: bytes as u64, free_bytes: 0 }),
        _ => Ok(()),
    }
}

/// Returns the first and the one-past-last address of the mapping that holds `address`.
fn mapping(address: usize) -> Option<(usize, usize)> {
    let maps = std::fs::read_to_string("/proc/self/maps").ok()?;
    maps.lines().find_map(|line| {
        let (start, end) = line.split_whitespace().next()?.split_once('-')?;
        let range = (usize::from_str_radix(start, 16).ok()?, usize::from_str_radix(end, 16).ok()?);
        (range.0 <= address && address < range.1).then_some(range)
    })
}
