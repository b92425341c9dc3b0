//! Whether the ring fits, and touching its pages before the first frame.
#![expect(unsafe_code, reason = "statvfs and madvise are system calls")]

use super::BusError;

/// Refuses when `/dev/shm` has fewer than `needed_bytes` free.
pub(super) fn require(needed_bytes: u64) -> Result<(), BusError> {
    // SAFETY: all-zero is a valid statvfs, and the path is a NUL-terminated string.
    let (status, stat) = unsafe {
        let mut stat: libc::statvfs = std::mem::zeroed();
        (libc::statvfs(c"/dev/shm".as_ptr(), &raw mut stat), stat)
    };
    let free_bytes = stat.f_bavail * stat.f_frsize;
    if status == 0 && free_bytes < needed_bytes {
        return Err(BusError::Memory { needed_bytes, free_bytes });
    }
    Ok(())
}

/// Makes every page of the mapping that holds `address` present and writable.
///
/// A kernel without this request (before 5.14) is no error: the pages then come one by one.
pub(super) fn populate(address: usize) -> Result<(), BusError> {
    let Some((start, end)) = mapping(address) else { return Ok(()) };
    let bytes = end - start;
    // SAFETY: the range is one whole mapping of this process; populating changes no content.
    let status = unsafe { libc::madvise(start as *mut libc::c_void, bytes, libc::MADV_POPULATE_WRITE) };
    if status != 0 && std::io::Error::last_os_error().raw_os_error() == Some(libc::EFAULT) {
        return Err(BusError::Memory { needed_bytes: bytes as u64, free_bytes: 0 });
    }
    Ok(())
}

/// First and one-past-last address of the mapping that holds `address`.
fn mapping(address: usize) -> Option<(usize, usize)> {
    let maps = std::fs::read_to_string("/proc/self/maps").ok()?;
    maps.lines().find_map(|line| {
        let (start, end) = line.split_whitespace().next()?.split_once('-')?;
        let range = (usize::from_str_radix(start, 16).ok()?, usize::from_str_radix(end, 16).ok()?);
        (range.0 <= address && address < range.1).then_some(range)
    })
}
