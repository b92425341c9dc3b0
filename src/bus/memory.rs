//! The memory of the ring: checks that it fits, and touches its pages before the first frame.
#![expect(unsafe_code, reason = "madvise acts on memory of the bus library")]

use super::BusError;
use rustix::fs::FallocateFlags;
use rustix::io::Errno;
use rustix::mm::{Advice, MlockAllFlags, madvise, mlockall};
use rustix::process::{Resource, getrlimit};
use std::ffi::c_void;
use std::fs::OpenOptions;
use std::os::unix::fs::MetadataExt;
use std::path::PathBuf;

/// The memory that a process needs to join a rig: its publishers and connections, bytes.
pub(super) const JOIN_BYTES: u64 = 10 << 20;

/// The unit in which memory is mapped, bytes.
const PAGE_BYTES: usize = 4096;

/// Returns the free bytes of `/dev/shm`; `u64::MAX` if they are unknown.
pub fn free_bytes() -> u64 {
    rustix::fs::statvfs("/dev/shm").map_or(u64::MAX, |stat| stat.f_bavail * stat.f_frsize)
}

/// Checks that `/dev/shm` has room for frames of `ring_bytes` and for `processes` further processes to join.
///
/// # Errors
///
/// [`BusError::Memory`] if it has less room.
pub fn check_room(ring_bytes: u64, processes: usize) -> Result<(), BusError> {
    require(ring_bytes + processes as u64 * JOIN_BYTES)
}

/// Checks that `/dev/shm` has `needed_bytes` free.
///
/// # Errors
///
/// [`BusError::Memory`] if fewer bytes are free.
pub(super) fn require(needed_bytes: u64) -> Result<(), BusError> {
    let free_bytes = free_bytes();
    if free_bytes < needed_bytes { Err(BusError::Memory { needed_bytes, free_bytes }) } else { Ok(()) }
}

/// Reserves the memory of the small files among `paths`, so that using them cannot fail later.
///
/// Files above [`JOIN_BYTES`] are left out: the pool of frames, which its writer touches, and that of fields, whose
/// writer checks for room at each use.
///
/// # Errors
///
/// [`BusError::Memory`] if there is not enough for a file.
pub(super) fn reserve(paths: &[PathBuf]) -> Result<(), BusError> {
    for path in paths {
        // It may have been removed since.
        let Ok(file) = OpenOptions::new().write(true).open(path) else { continue };
        let Ok(found) = file.metadata() else { continue };
        let is_reserved = found.blocks() * 512 >= found.len();
        if is_reserved || found.len() > JOIN_BYTES {
            continue;
        }
        if let Err(Errno::NOSPC) = rustix::fs::fallocate(&file, FallocateFlags::empty(), 0, found.len()) {
            return Err(BusError::Memory { needed_bytes: found.len(), free_bytes: free_bytes() });
        }
    }
    Ok(())
}

/// Makes every page of the mapping that holds `address` present and writable.
///
/// A kernel before 5.14 does not know the request. That is no error; the pages are then mapped one by one. Nor is an
/// address without a mapping.
///
/// # Errors
///
/// [`BusError::Memory`] if there is no memory left for them.
pub(super) fn populate(address: usize) -> Result<(), BusError> {
    let Some((start, end)) = mapping_of(address) else { return Ok(()) };
    let bytes = end - start;
    // SAFETY: the range is one whole mapping of this process; populating changes no content.
    let touched = unsafe { madvise(start as *mut c_void, bytes, Advice::LinuxPopulateWrite) };
    match touched {
        Err(Errno::FAULT) => Err(BusError::Memory { needed_bytes: bytes as u64, free_bytes: free_bytes() }),
        _ => Ok(()),
    }
}

/// Makes the first `bytes` of each of `count` places present and writable, which begin every `stride` bytes from `first` on.
///
/// Places beyond the mapping that holds `first` are left out. Nothing is done if less than four times as much memory is
/// free: the pages are then mapped when they are used.
pub(super) fn populate_heads(first: usize, stride: usize, count: usize, bytes: usize) {
    let Some((_, end)) = mapping_of(first).filter(|_| require(4 * (count * bytes) as u64).is_ok()) else { return };
    for start in (first..end).step_by(stride.max(1)).take(count) {
        let page = start & !(PAGE_BYTES - 1);
        let until = (start + bytes).next_multiple_of(PAGE_BYTES).min(end);
        // SAFETY: the range lies in one mapping of this process; populating changes no content.
        let _ = unsafe { madvise(page as *mut c_void, until - page, Advice::LinuxPopulateWrite) };
    }
}

/// Keeps the memory of this process from being swapped to disk, if nothing limits how much it may lock
/// (`RLIMIT_MEMLOCK`): under a limit, an allocation beyond it would fail later. Pages are locked when they are first used.
pub fn lock_if_unlimited() {
    if getrlimit(Resource::Memlock).current.is_some() {
        return;
    }
    if let Err(error) = mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT) {
        log::debug!("memory is not locked: {error}");
    }
}

/// Returns the first and the one-past-last address of the mapping that holds `address`; `None` if there is none.
fn mapping_of(address: usize) -> Option<(usize, usize)> {
    let maps = std::fs::read_to_string("/proc/self/maps").ok()?;
    maps.lines().find_map(|line| {
        let (start, end) = line.split_whitespace().next()?.split_once('-')?;
        let range = (usize::from_str_radix(start, 16).ok()?, usize::from_str_radix(end, 16).ok()?);
        (range.0 <= address && address < range.1).then_some(range)
    })
}
