//! An open video device: each ioctl as a typed call.

use super::kernel::{Kernel, Mapping, Node, open_failure};
use super::modes::{FrameSize, MAX_LIST, Rates, Sizes};
use super::sys;
use crate::camera::CameraError;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The type of all our buffers.
const CAPTURE: u32 = sys::V4L2_BUF_TYPE_VIDEO_CAPTURE;

/// An open V4L2 camera.
#[derive(Debug)]
pub struct Device {
    pub(super) kernel: Box<dyn Kernel>,
    /// Its id in messages.
    pub(super) id: String,
    /// Its device file.
    pub(super) path: PathBuf,
}

/// The identity and capabilities of a device.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Capability {
    /// Driver name.
    pub driver: String,
    /// Camera name.
    pub card: String,
    /// Bus address.
    pub bus: String,
    /// `V4L2_CAP_...` of this node.
    pub flags: u32,
}

/// The memory of a buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Memory {
    /// In the driver's memory, mapped.
    Mapped,
    /// In our memory.
    User,
}

impl Memory {
    /// Returns the kernel's `V4L2_MEMORY_...`.
    fn code(self) -> u32 {
        match self {
            Self::Mapped => sys::V4L2_MEMORY_MMAP,
            Self::User => sys::V4L2_MEMORY_USERPTR,
        }
    }
}

impl Device {
    /// Opens a node and checks that it is a camera with streaming support.
    ///
    /// # Errors
    ///
    /// [`CameraError::NotFound`] with the reason if it is not, or cannot be opened.
    pub(super) fn open(path: &Path) -> Result<Self, CameraError> {
        let id = path.display().to_string();
        let not_found = |reason: String| CameraError::NotFound { id: id.clone(), reason };
        let node = Node::open(path).map_err(|error| not_found(open_failure(&error)))?;
        let device = Self { kernel: Box::new(node), id: id.clone(), path: path.into() };
        let capability = device.capability().map_err(|error| not_found(format!("no video device: {error}")))?;
        match capability.refusal() {
            None => Ok(device),
            Some(reason) => Err(not_found(reason)),
        }
    }

    /// Performs one ioctl.
    ///
    /// # Panics
    ///
    /// If the argument has another size than that in the request code.
    ///
    /// # Safety
    ///
    /// Pointers in `argument` must be valid for as long as the request lets the kernel use them.
    pub(super) unsafe fn call<T>(&self, request: libc::c_ulong, argument: &mut T) -> io::Result<()> {
        // A request code contains the size of its structure.
        assert_eq!((request >> 16) & 0x3fff, size_of::<T>() as libc::c_ulong, "another structure than the request's");
        // SAFETY: the structure belongs to the request; the caller guarantees the pointers in it.
        unsafe { self.kernel.ioctl(request, std::ptr::from_mut(argument).cast()) }
    }

    /// Returns driver, card, bus and capability flags of the device (`VIDIOC_QUERYCAP`).
    pub fn capability(&self) -> io::Result<Capability> {
        let mut raw = sys::v4l2_capability::default();
        // SAFETY: no pointers.
        unsafe { self.call(sys::REQUEST_QUERYCAP, &mut raw) }?;
        let flags = if raw.capabilities & sys::V4L2_CAP_DEVICE_CAPS == 0 { raw.capabilities } else { raw.device_caps };
        Ok(Capability { driver: text(&raw.driver), card: text(&raw.card), bus: text(&raw.bus_info), flags })
    }

    /// Returns the four-character code and the description of every pixel format, in the driver's order.
    pub(super) fn formats(&self) -> Vec<(u32, String)> {
        let format = |index| {
            let mut raw = sys::v4l2_fmtdesc { index, type_: CAPTURE, ..Default::default() };
            // SAFETY: no pointers.
            unsafe { self.call(sys::REQUEST_ENUM_FMT, &mut raw) }.ok()?;
            Some((raw.pixelformat, text(&raw.description)))
        };
        (0..MAX_LIST).map_while(format).collect()
    }

    /// Returns the frame sizes that the driver lists for a pixel format (four-character code).
    pub(super) fn sizes(&self, pixel_format: u32) -> Sizes {
        let size = |index| {
            let mut raw = sys::v4l2_frmsizeenum { index, pixel_format, ..Default::default() };
            // SAFETY: no pointers.
            unsafe { self.call(sys::REQUEST_ENUM_FRAMESIZES, &mut raw) }.ok()?;
            Some(raw)
        };
        Sizes::from_list((0..MAX_LIST).map_while(size))
    }

    /// Returns the frame rates that the driver lists for a pixel format (four-character code) and size.
    pub(super) fn rates(&self, pixel_format: u32, size: FrameSize) -> Rates {
        let (width, height) = (size.width_px, size.height_px);
        let interval = |index| {
            let mut raw = sys::v4l2_frmivalenum { index, pixel_format, width, height, ..Default::default() };
            // SAFETY: no pointers.
            unsafe { self.call(sys::REQUEST_ENUM_FRAMEINTERVALS, &mut raw) }.ok()?;
            Some(raw)
        };
        Rates::from_list((0..MAX_LIST).map_while(interval))
    }

    /// Returns the present pixel format and size (`VIDIOC_G_FMT`).
    pub(super) fn format(&self) -> io::Result<sys::v4l2_pix_format> {
        let mut raw = sys::v4l2_format { type_: CAPTURE, ..Default::default() };
        // SAFETY: no pointers; for this type of buffer the kernel fills in `pix`.
        unsafe {
            self.call(sys::REQUEST_G_FMT, &mut raw)?;
            Ok(raw.fmt.pix)
        }
    }

    /// Requests a format; returns the format that the driver chose.
    pub(super) fn set_format(&self, pix: sys::v4l2_pix_format) -> io::Result<sys::v4l2_pix_format> {
        let mut raw = sys::v4l2_format { type_: CAPTURE, ..Default::default() };
        raw.fmt.pix = pix;
        // SAFETY: as in `format`.
        unsafe {
            self.call(sys::REQUEST_S_FMT, &mut raw)?;
            Ok(raw.fmt.pix)
        }
    }

    /// Returns the frame interval, s; `None` if the driver does not report one.
    pub(super) fn interval(&self) -> Option<sys::v4l2_fract> {
        let mut raw = sys::v4l2_streamparm { type_: CAPTURE, ..Default::default() };
        // SAFETY: no pointers.
        unsafe { self.call(sys::REQUEST_G_PARM, &mut raw) }.ok()?;
        interval_of(&raw)
    }

    /// Requests a frame interval, s; returns the interval that the driver chose, `None` if it does not report one.
    pub(super) fn set_interval(&self, interval: sys::v4l2_fract) -> io::Result<Option<sys::v4l2_fract>> {
        let mut raw = sys::v4l2_streamparm { type_: CAPTURE, ..Default::default() };
        raw.parm.capture.timeperframe = interval;
        // SAFETY: no pointers.
        unsafe { self.call(sys::REQUEST_S_PARM, &mut raw) }?;
        Ok(interval_of(&raw))
    }

    /// Requests a number of buffers (0 frees all); returns the number that the driver allocated.
    pub(super) fn request_buffers(&self, memory: Memory, count: u32) -> io::Result<u32> {
        let mut raw = sys::v4l2_requestbuffers { count, type_: CAPTURE, memory: memory.code(), ..Default::default() };
        // SAFETY: no pointers.
        unsafe { self.call(sys::REQUEST_REQBUFS, &mut raw) }?;
        Ok(raw.count)
    }

    /// Maps the driver's buffer of this index, from 0.
    pub(super) fn map(&self, index: u32) -> io::Result<Mapping> {
        let mut raw = buffer_argument(Memory::Mapped, index);
        // SAFETY: no pointers; the kernel fills in the offset for mapped buffers.
        let offset = unsafe {
            self.call(sys::REQUEST_QUERYBUF, &mut raw)?;
            raw.m.offset
        };
        Mapping::new(self.kernel.as_ref(), offset.into(), raw.length as usize)
    }

    /// Queues the mapped buffer of this index, to be filled.
    pub(super) fn enqueue_mapped(&self, index: u32) -> io::Result<()> {
        // SAFETY: no pointers.
        unsafe { self.call(sys::REQUEST_QBUF, &mut buffer_argument(Memory::Mapped, index)) }
    }

    /// Queues `bytes` bytes of our memory as the buffer of this index, to be filled.
    ///
    /// # Safety
    ///
    /// The memory must stay valid, and nobody else may touch it, until the buffer comes out or the device is closed.
    pub(super) unsafe fn enqueue_user(&self, index: u32, memory: *mut u8, bytes: u32) -> io::Result<()> {
        let mut raw = sys::v4l2_buffer { length: bytes, ..buffer_argument(Memory::User, index) };
        raw.m.userptr = memory as libc::c_ulong;
        // SAFETY: the caller guarantees the memory.
        unsafe { self.call(sys::REQUEST_QBUF, &mut raw) }
    }

    /// Dequeues a filled buffer; fails with `WouldBlock` if there is none.
    pub(super) fn dequeue(&self, memory: Memory) -> io::Result<sys::v4l2_buffer> {
        let mut raw = buffer_argument(memory, 0);
        // SAFETY: no pointers.
        unsafe { self.call(sys::REQUEST_DQBUF, &mut raw) }?;
        Ok(raw)
    }

    /// Starts the stream.
    pub(super) fn stream_on(&self) -> io::Result<()> {
        // SAFETY: the argument is an integer.
        unsafe { self.call(sys::REQUEST_STREAMON, &mut CAPTURE.cast_signed()) }
    }

    /// Stops the stream; the driver then holds no buffer.
    pub(super) fn stream_off(&self) -> io::Result<()> {
        // SAFETY: as in `stream_on`.
        unsafe { self.call(sys::REQUEST_STREAMOFF, &mut CAPTURE.cast_signed()) }
    }

    /// Waits until a buffer is ready or the stream has failed; returns `false` at the timeout or after a signal.
    pub(super) fn wait(&self, timeout: Duration) -> io::Result<bool> {
        self.kernel.wait(timeout)
    }
}

impl Capability {
    /// Returns the reason why the device cannot be used as a camera, if there is one.
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

/// Returns the argument of an ioctl on one capture buffer.
fn buffer_argument(memory: Memory, index: u32) -> sys::v4l2_buffer {
    sys::v4l2_buffer { index, type_: CAPTURE, memory: memory.code(), ..Default::default() }
}

/// Returns the frame interval in stream parameters, s; `None` if the driver does not support one.
fn interval_of(raw: &sys::v4l2_streamparm) -> Option<sys::v4l2_fract> {
    // SAFETY: for this buffer type the kernel fills in `capture`.
    let capture = unsafe { raw.parm.capture };
    let interval = capture.timeperframe;
    let is_known = capture.capability & sys::V4L2_CAP_TIMEPERFRAME != 0;
    (is_known && interval.numerator > 0 && interval.denominator > 0).then_some(interval)
}

/// Reads a text, which ends with a zero byte or with the field, from a field of fixed size, without outer spaces.
pub(super) fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).trim().to_owned()
}
