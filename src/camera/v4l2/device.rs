//! An open video device: each ioctl as a call with types.

use super::find;
use super::kernel::{Kernel, Mapping, Node};
use super::offer::{LIST_MAX, Rates, Sizes};
use super::sys;
use crate::camera::CameraError;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

const CAPTURE: u32 = sys::V4L2_BUF_TYPE_VIDEO_CAPTURE;

/// An open camera of the kernel.
#[derive(Debug)]
pub struct Device {
    pub(super) kernel: Box<dyn Kernel>,
    /// What a person calls it.
    pub(super) id: String,
    /// Its device file.
    pub(super) path: PathBuf,
}

/// What a device is.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Capability {
    /// Name of the driver.
    pub driver: String,
    /// Name of the camera.
    pub card: String,
    /// Where it is plugged in.
    pub bus: String,
    /// `V4L2_CAP_...` of this node.
    pub flags: u32,
}

/// Where the pixels of a buffer come to lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Memory {
    /// The driver's own, mapped.
    Mapped,
    /// Ours.
    User,
}

impl Memory {
    fn word(self) -> u32 {
        match self {
            Self::Mapped => sys::V4L2_MEMORY_MMAP,
            Self::User => sys::V4L2_MEMORY_USERPTR,
        }
    }
}

impl Device {
    /// Opens a node and checks that it is a camera which streams.
    pub(super) fn open(path: &Path) -> Result<Self, CameraError> {
        let id = path.display().to_string();
        let not_found = |reason: String| CameraError::NotFound { id: id.clone(), reason };
        let node = Node::open(path).map_err(|error| not_found(find::words(&error)))?;
        let device = Self { kernel: Box::new(node), id: id.clone(), path: path.into() };
        let capability = device.capability().map_err(|error| not_found(format!("no video device: {error}")))?;
        match capability.refusal() {
            None => Ok(device),
            Some(reason) => Err(not_found(reason)),
        }
    }

    /// One ioctl.
    ///
    /// # Safety
    ///
    /// Pointers in `argument` must be valid for as long as the request lets the kernel use them.
    pub(super) unsafe fn call<T>(&self, request: libc::c_ulong, argument: &mut T) -> io::Result<()> {
        // The number of a request holds the size of its structure.
        assert_eq!((request >> 16) & 0x3fff, size_of::<T>() as libc::c_ulong, "another structure than the request's");
        // SAFETY: the structure is the request's; the caller answers for the pointers in it.
        unsafe { self.kernel.ioctl(request, std::ptr::from_mut(argument).cast()) }
    }

    /// What it is.
    pub fn capability(&self) -> io::Result<Capability> {
        let mut raw = sys::v4l2_capability::default();
        // SAFETY: no pointers.
        unsafe { self.call(sys::REQUEST_QUERYCAP, &mut raw) }?;
        let flags = if raw.capabilities & sys::V4L2_CAP_DEVICE_CAPS == 0 { raw.capabilities } else { raw.device_caps };
        Ok(Capability { driver: text(&raw.driver), card: text(&raw.card), bus: text(&raw.bus_info), flags })
    }

    /// Codes and descriptions of its pixel formats.
    pub(super) fn formats(&self) -> Vec<(u32, String)> {
        let format = |index| {
            let mut raw = sys::v4l2_fmtdesc { index, type_: CAPTURE, ..Default::default() };
            // SAFETY: no pointers.
            unsafe { self.call(sys::REQUEST_ENUM_FMT, &mut raw) }.ok()?;
            Some((raw.pixelformat, text(&raw.description)))
        };
        (0..LIST_MAX).map_while(format).collect()
    }

    /// Sizes of its pictures in this format.
    pub(super) fn sizes(&self, pixel_format: u32) -> Sizes {
        let size = |index| {
            let mut raw = sys::v4l2_frmsizeenum { index, pixel_format, ..Default::default() };
            // SAFETY: no pointers.
            unsafe { self.call(sys::REQUEST_ENUM_FRAMESIZES, &mut raw) }.ok()?;
            Some(raw)
        };
        Sizes::from_list((0..LIST_MAX).map_while(size))
    }

    /// Rates in this format and size.
    pub(super) fn rates(&self, pixel_format: u32, (width, height): (u32, u32)) -> Rates {
        let interval = |index| {
            let mut raw = sys::v4l2_frmivalenum { index, pixel_format, width, height, ..Default::default() };
            // SAFETY: no pointers.
            unsafe { self.call(sys::REQUEST_ENUM_FRAMEINTERVALS, &mut raw) }.ok()?;
            Some(raw)
        };
        Rates::from_list((0..LIST_MAX).map_while(interval))
    }

    /// The format it has now.
    pub(super) fn format(&self) -> io::Result<sys::v4l2_pix_format> {
        let mut raw = sys::v4l2_format { type_: CAPTURE, ..Default::default() };
        // SAFETY: no pointers; for this type of buffer the kernel fills in `pix`.
        unsafe {
            self.call(sys::REQUEST_G_FMT, &mut raw)?;
            Ok(raw.fmt.pix)
        }
    }

    /// Asks for a format; answers with what the driver made of it.
    pub(super) fn set_format(&self, pix: sys::v4l2_pix_format) -> io::Result<sys::v4l2_pix_format> {
        let mut raw = sys::v4l2_format { type_: CAPTURE, ..Default::default() };
        raw.fmt.pix = pix;
        // SAFETY: as in `format`.
        unsafe {
            self.call(sys::REQUEST_S_FMT, &mut raw)?;
            Ok(raw.fmt.pix)
        }
    }

    /// Seconds a frame as a fraction; none where the driver does not know or cannot set it.
    pub(super) fn interval(&self) -> Option<(u32, u32)> {
        let mut raw = sys::v4l2_streamparm { type_: CAPTURE, ..Default::default() };
        // SAFETY: no pointers.
        unsafe { self.call(sys::REQUEST_G_PARM, &mut raw) }.ok()?;
        interval_of(&raw)
    }

    /// Asks for an interval; answers with what the driver made of it.
    pub(super) fn set_interval(&self, (numerator, denominator): (u32, u32)) -> io::Result<Option<(u32, u32)>> {
        let mut raw = sys::v4l2_streamparm { type_: CAPTURE, ..Default::default() };
        raw.parm.capture.timeperframe = sys::v4l2_fract { numerator, denominator };
        // SAFETY: no pointers.
        unsafe { self.call(sys::REQUEST_S_PARM, &mut raw) }?;
        Ok(interval_of(&raw))
    }

    /// Makes the driver have this many buffers (0 frees all); answers with how many it has.
    pub(super) fn request_buffers(&self, memory: Memory, count: u32) -> io::Result<u32> {
        let mut raw = sys::v4l2_requestbuffers { count, type_: CAPTURE, memory: memory.word(), ..Default::default() };
        // SAFETY: no pointers.
        unsafe { self.call(sys::REQUEST_REQBUFS, &mut raw) }?;
        Ok(raw.count)
    }

    /// Maps one of the driver's buffers.
    pub(super) fn map(&self, index: u32) -> io::Result<Mapping> {
        let mut raw = buffer(Memory::Mapped, index);
        // SAFETY: no pointers; the offset is what the kernel fills in for mapped buffers.
        let offset = unsafe {
            self.call(sys::REQUEST_QUERYBUF, &mut raw)?;
            raw.m.offset
        };
        Mapping::new(self.kernel.as_ref(), libc::off_t::from(offset), raw.length as usize)
    }

    /// Gives a mapped buffer to the driver.
    pub(super) fn enqueue_mapped(&self, index: u32) -> io::Result<()> {
        // SAFETY: no pointers.
        unsafe { self.call(sys::REQUEST_QBUF, &mut buffer(Memory::Mapped, index)) }
    }

    /// Gives memory of ours to the driver.
    ///
    /// # Safety
    ///
    /// The memory must stay valid, and nobody else may touch it, until the buffer comes out or the device is closed.
    pub(super) unsafe fn enqueue_user(&self, index: u32, memory: *mut u8, bytes: u32) -> io::Result<()> {
        let mut raw = sys::v4l2_buffer { length: bytes, ..buffer(Memory::User, index) };
        raw.m.userptr = memory as libc::c_ulong;
        // SAFETY: the caller answers for the memory.
        unsafe { self.call(sys::REQUEST_QBUF, &mut raw) }
    }

    /// Takes a filled buffer, if there is one: `WouldBlock` otherwise.
    pub(super) fn dequeue(&self, memory: Memory) -> io::Result<sys::v4l2_buffer> {
        let mut raw = buffer(memory, 0);
        // SAFETY: no pointers.
        unsafe { self.call(sys::REQUEST_DQBUF, &mut raw) }?;
        Ok(raw)
    }

    /// Starts the stream.
    pub(super) fn stream_on(&self) -> io::Result<()> {
        // SAFETY: the argument is a number.
        unsafe { self.call(sys::REQUEST_STREAMON, &mut CAPTURE.cast_signed()) }
    }

    /// Stops the stream; the driver then holds no buffer.
    pub(super) fn stream_off(&self) -> io::Result<()> {
        // SAFETY: as in `stream_on`.
        unsafe { self.call(sys::REQUEST_STREAMOFF, &mut CAPTURE.cast_signed()) }
    }

    /// Waits for a buffer.
    pub(super) fn wait(&self, timeout: Duration) -> io::Result<bool> {
        self.kernel.wait(timeout)
    }
}

impl Capability {
    /// Why it is no camera for us, if it is none.
    pub(super) fn refusal(&self) -> Option<String> {
        let has = |flag| self.flags & flag != 0;
        if !has(sys::V4L2_CAP_VIDEO_CAPTURE) {
            let planes = has(sys::V4L2_CAP_VIDEO_CAPTURE_MPLANE);
            let reason = if planes { "it delivers pictures in several planes only" } else { "it takes no pictures" };
            return Some(format!("{} ({}): {reason}", self.card, self.driver));
        }
        (!has(sys::V4L2_CAP_STREAMING)).then(|| format!("{} ({}): it does not stream", self.card, self.driver))
    }
}

fn buffer(memory: Memory, index: u32) -> sys::v4l2_buffer {
    sys::v4l2_buffer { index, type_: CAPTURE, memory: memory.word(), ..Default::default() }
}

fn interval_of(raw: &sys::v4l2_streamparm) -> Option<(u32, u32)> {
    // SAFETY: for this type of buffer the kernel fills in `capture`.
    let capture = unsafe { raw.parm.capture };
    let sys::v4l2_fract { numerator, denominator } = capture.timeperframe;
    (capture.capability & sys::V4L2_CAP_TIMEPERFRAME != 0 && numerator > 0 && denominator > 0)
        .then_some((numerator, denominator))
}

/// Text in a field of fixed size.
pub(super) fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).trim().to_owned()
}
