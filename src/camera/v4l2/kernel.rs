//! The system calls on a video device: ioctl, poll and mmap on an open file.

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags, open};
use rustix::io::Errno;
use rustix::ioctl::{Ioctl, IoctlOutput, Opcode, ioctl};
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use std::ffi::c_void;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::Path;
use std::ptr::{self, NonNull};
use std::time::Duration;

/// Argument of an ioctl, of any type.
pub(super) type Argument = *mut c_void;

/// Maximum number of retries of a call that a signal interrupts.
const MAX_RETRIES: usize = 16;

/// The system calls on an open video device; simulated in tests.
pub(super) trait Kernel: Send + std::fmt::Debug {
    /// Performs one ioctl.
    ///
    /// # Safety
    ///
    /// `argument` must point to the structure that belongs to `request`, and every pointer in it must be valid for as
    /// long as the request lets the kernel use it.
    unsafe fn ioctl(&self, request: libc::c_ulong, argument: Argument) -> io::Result<()>;

    /// Waits until a buffer is ready or the stream has failed; returns `false` at the timeout or after a signal.
    fn wait(&self, timeout: Duration) -> io::Result<bool>;

    /// Returns the file, to map buffers of it.
    fn file(&self) -> BorrowedFd<'_>;
}

/// An open device node.
#[derive(Debug)]
pub(super) struct Node(OwnedFd);

impl Node {
    /// Opens a device file for reading and writing, without blocking.
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        // Non-blocking: only `wait` waits, with a timeout.
        let flags = OFlags::RDWR | OFlags::NONBLOCK | OFlags::CLOEXEC;
        Ok(Self(open(path, flags, Mode::empty())?))
    }
}

/// Returns the reason why a device cannot be opened, with its cure if the permission is missing.
pub(super) fn open_failure(error: &io::Error) -> String {
    match error.raw_os_error() {
        Some(libc::EACCES) => format!("{error}; add the user to the file's group, usually `video`"),
        Some(libc::EBUSY) => "another program uses it".into(),
        _ => error.to_string(),
    }
}

/// One ioctl that may change its argument.
struct Request {
    opcode: Opcode,
    argument: Argument,
}

// SAFETY: the opcode and the argument belong together, which the caller of `Kernel::ioctl` guarantees.
unsafe impl Ioctl for Request {
    type Output = ();

    const IS_MUTATING: bool = true;

    fn opcode(&self) -> Opcode {
        self.opcode
    }

    fn as_ptr(&mut self) -> *mut c_void {
        self.argument
    }

    unsafe fn output_from_ptr(_output: IoctlOutput, _argument: *mut c_void) -> rustix::io::Result<()> {
        Ok(())
    }
}

impl Kernel for Node {
    unsafe fn ioctl(&self, request: libc::c_ulong, argument: Argument) -> io::Result<()> {
        // Request codes have 32 bits.
        let opcode = request as Opcode;
        // SAFETY: an open file; the caller guarantees the argument.
        let call = || unsafe { ioctl(&self.0, Request { opcode, argument }) };
        let mut result = call();
        for _ in 0..MAX_RETRIES {
            if result != Err(Errno::INTR) {
                break;
            }
            result = call();
        }
        Ok(result?)
    }

    fn wait(&self, timeout: Duration) -> io::Result<bool> {
        let timeout = Timespec::try_from(timeout).unwrap_or(Timespec { tv_sec: i64::MAX, tv_nsec: 0 });
        match poll(&mut [PollFd::new(&self.0, PollFlags::IN)], Some(&timeout)) {
            Ok(count) => Ok(count > 0),
            Err(Errno::INTR) => Ok(false),
            Err(error) => Err(error.into()),
        }
    }

    fn file(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

/// A buffer of the driver, mapped for reading.
#[derive(Debug)]
pub(super) struct Mapping {
    memory: NonNull<u8>,
    bytes: usize,
}

// SAFETY: the mapping belongs to this value alone, and moves with it.
unsafe impl Send for Mapping {}

impl Mapping {
    /// Maps the buffer of `bytes` bytes at the offset that the driver gives it in its device file.
    pub(super) fn new(kernel: &dyn Kernel, offset: u64, bytes: usize) -> io::Result<Self> {
        // Drivers may refuse a mapping that is not writable.
        let access = ProtFlags::READ | ProtFlags::WRITE;
        // SAFETY: a new mapping of an open file, at an address that the kernel chooses.
        let address = unsafe { mmap(ptr::null_mut(), bytes, access, MapFlags::SHARED, kernel.file(), offset) }?;
        let memory = NonNull::new(address.cast()).ok_or_else(|| io::Error::other("mapped at address 0"))?;
        Ok(Self { memory, bytes })
    }

    /// Returns the first `count` bytes of the buffer, or all if it has fewer; the driver must not hold it.
    pub(super) fn bytes(&self, count: usize) -> &[u8] {
        // SAFETY: mapped for at least this many bytes while `self` lives; a dequeued buffer is not written to before
        // it is queued again.
        unsafe { std::slice::from_raw_parts(self.memory.as_ptr(), count.min(self.bytes)) }
    }

    /// Returns the size in bytes.
    pub(super) fn len(&self) -> usize {
        self.bytes
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: mapped by `new`, and no borrow is left. Unmapping own memory does not fail.
        let _ = unsafe { munmap(self.memory.as_ptr().cast(), self.bytes) };
    }
}
