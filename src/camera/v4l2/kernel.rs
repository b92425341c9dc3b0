//! The kernel's side of a video device: ioctl, poll and mmap on an open file.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::fd::{AsRawFd, BorrowedFd};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::ptr::NonNull;
use std::time::Duration;

/// Argument of an ioctl, whatever its type.
pub(super) type Argument = *mut libc::c_void;

/// How often a call that a signal interrupts is made again.
const INTERRUPTIONS: usize = 16;

/// What the kernel does with an open video device; imitated in tests.
pub(super) trait Kernel: Send + std::fmt::Debug {
    /// One ioctl.
    ///
    /// # Safety
    ///
    /// `argument` must point to the structure that belongs to `request`, and every
    /// pointer in it must be valid for as long as the request lets the kernel use it.
    unsafe fn ioctl(&self, request: libc::c_ulong, argument: Argument) -> io::Result<()>;

    /// Waits until a buffer can be taken, or something is wrong with the stream; false when neither came in time.
    fn wait(&self, timeout: Duration) -> io::Result<bool>;

    /// The file, to map buffers of.
    fn file(&self) -> BorrowedFd<'_>;
}

/// An open device node.
#[derive(Debug)]
pub(super) struct Node(File);

impl Node {
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        // Never blocks in a call: waiting is `wait`'s and has an end.
        let flags = libc::O_NONBLOCK | libc::O_CLOEXEC;
        OpenOptions::new().read(true).write(true).custom_flags(flags).open(path).map(Self)
    }
}

impl Kernel for Node {
    unsafe fn ioctl(&self, request: libc::c_ulong, argument: Argument) -> io::Result<()> {
        let mut tries = 0;
        loop {
            // SAFETY: an open file; the caller answers for the argument.
            if unsafe { libc::ioctl(self.0.as_raw_fd(), request as _, argument) } >= 0 {
                return Ok(());
            }
            let error = io::Error::last_os_error();
            tries += 1;
            if error.kind() != io::ErrorKind::Interrupted || tries > INTERRUPTIONS {
                return Err(error);
            }
        }
    }

    fn wait(&self, timeout: Duration) -> io::Result<bool> {
        let mut poll = libc::pollfd { fd: self.0.as_raw_fd(), events: libc::POLLIN, revents: 0 };
        // Rounded up, so that a short wait is one.
        let milliseconds = i32::try_from(timeout.as_micros().div_ceil(1000)).unwrap_or(i32::MAX);
        // SAFETY: one entry of ours that lives through the call.
        match unsafe { libc::poll(&raw mut poll, 1, milliseconds) } {
            0 => Ok(false),
            count if count > 0 => Ok(true),
            _ => match io::Error::last_os_error() {
                error if error.kind() == io::ErrorKind::Interrupted => Ok(false),
                error => Err(error),
            },
        }
    }

    fn file(&self) -> BorrowedFd<'_> {
        std::os::fd::AsFd::as_fd(&self.0)
    }
}

/// A buffer of the driver, mapped to be read.
#[derive(Debug)]
pub(super) struct Mapping {
    memory: NonNull<u8>,
    bytes: usize,
}

// SAFETY: the mapping is this value's alone, and moves with it.
unsafe impl Send for Mapping {}

impl Mapping {
    pub(super) fn new(kernel: &dyn Kernel, offset: libc::off_t, bytes: usize) -> io::Result<Self> {
        // Drivers may refuse a mapping that cannot be written.
        let access = libc::PROT_READ | libc::PROT_WRITE;
        let file = kernel.file().as_raw_fd();
        // SAFETY: a new mapping of an open file, nowhere in particular.
        let address = unsafe { libc::mmap(std::ptr::null_mut(), bytes, access, libc::MAP_SHARED, file, offset) };
        if address == libc::MAP_FAILED {
            return Err(io::Error::last_os_error());
        }
        let memory = NonNull::new(address.cast()).ok_or_else(|| io::Error::other("mapped at address 0"))?;
        Ok(Self { memory, bytes })
    }

    /// The first bytes of the buffer, which must be out of the driver's hands.
    pub(super) fn bytes(&self, count: usize) -> &[u8] {
        // SAFETY: mapped for at least this many bytes while `self` lives; a buffer that was taken out of the queue
        // is not written to before it is put in again.
        unsafe { std::slice::from_raw_parts(self.memory.as_ptr(), count.min(self.bytes)) }
    }

    /// Its size in bytes.
    pub(super) fn len(&self) -> usize {
        self.bytes
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: mapped by `new`, and nobody borrows from it any more.
        unsafe { libc::munmap(self.memory.as_ptr().cast(), self.bytes) };
    }
}
