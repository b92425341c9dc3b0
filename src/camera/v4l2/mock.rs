//! A simulated kernel for unit tests: it answers ioctls from memory, and its buffers lie in a file that can be mapped.

use super::device::Device;
use super::kernel::{Argument, Kernel};
use super::sys;
use crate::config::{Camera, Config};
use std::collections::VecDeque;
use std::fs::File;
use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::fs::FileExt;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

/// Size of one mapped buffer in the file: a page, so that each can be mapped separately.
const BUFFER_ROOM: u32 = 4096;

/// Returns settings that leave everything as it is.
pub fn settings() -> Camera {
    Config::parse("[camera]\nsource = \"simulated\"\n", "rig.toml").unwrap().camera
}

/// A control of the simulated driver.
#[derive(Debug, Clone)]
pub struct MockControl {
    pub id: u32,
    pub name: &'static str,
    pub kind: u32,
    pub range: (i64, i64, u64),
    pub words: &'static [&'static str],
    pub value: i32,
    /// Control and value that make this one inactive.
    pub ruled_by: Option<(u32, i32)>,
}

/// The state of the simulated driver.
#[derive(Debug, Default)]
pub struct State {
    pub fourcc: u32,
    pub size: (u32, u32),
    pub padding_bytes: u32,
    pub interval: (u32, u32),
    /// Format, (width, height) and rate, Hz, of each mode; empty for a driver that lists none and has a single one.
    pub modes: Vec<(u32, (u32, u32), u32)>,
    /// Timestamp of the frames, s on the kernel's monotonic clock.
    pub stamp_s: i64,
    /// Whether user memory is accepted: on request, and for the first buffer.
    pub takes_user: (bool, bool),
    /// Error of every call.
    pub broken: Option<i32>,
    /// Error of queueing buffers.
    pub refuses_buffers: Option<i32>,
    pub controls: Vec<MockControl>,
    pub streaming: bool,
    pub memory: u32,
    /// Queued buffers: index, address and size of the user memory.
    pub owned: VecDeque<(u32, u64, u32)>,
    ready: VecDeque<Filled>,
    pub buffers: u32,
}

/// A buffer that the simulated driver has filled.
#[derive(Debug)]
struct Filled {
    index: u32,
    sequence: u32,
    flags: u32,
    bytes: u32,
    stamp_s: i64,
}

impl Filled {
    /// Returns the buffer as the kernel returns it.
    fn as_buffer(&self) -> sys::v4l2_buffer {
        let Self { index, sequence, flags, bytes: bytesused, stamp_s } = *self;
        let timestamp = sys::timeval { tv_sec: stamp_s, tv_usec: i64::from(sequence) * 10 };
        sys::v4l2_buffer { index, sequence, flags, bytesused, timestamp, ..Default::default() }
    }
}

/// The simulated driver of a camera with 4 x 2 grey pixels.
#[derive(Debug, Clone)]
pub struct Mock {
    state: Arc<Mutex<State>>,
    file: Arc<File>,
}

impl Mock {
    pub fn new() -> Self {
        let state = State {
            fourcc: sys::FOURCC_GREY,
            size: (4, 2),
            interval: (1, 100),
            takes_user: (true, true),
            // Later than the start of any machine that runs this test.
            stamp_s: 4_000_000_000,
            ..State::default()
        };
        Self { state: Arc::new(Mutex::new(state)), file: Arc::new(tempfile::tempfile().unwrap()) }
    }

    pub fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap()
    }

    pub fn device(&self) -> Device {
        Device { kernel: Box::new(self.clone()), id: "mock".into(), path: std::path::PathBuf::new() }
    }

    /// Fills the oldest queued buffer with an image of this byte, with these sequence number and further flags.
    ///
    /// Returns `false` if no buffer is queued.
    pub fn fill(&self, sequence: u32, byte: u8, flags: u32) -> bool {
        let bytes = self.state().image_bytes();
        self.fill_part(sequence, byte, flags, bytes)
    }

    /// Fills the oldest queued buffer like [`fill`](Self::fill), but with this number of bytes.
    ///
    /// # Panics
    ///
    /// If they exceed the user memory.
    pub fn fill_part(&self, sequence: u32, byte: u8, flags: u32, bytes: u32) -> bool {
        let mut state = self.state();
        let Some((index, address, room)) = state.owned.pop_front() else { return false };
        let pixels = vec![byte; bytes as usize];
        if state.memory == sys::V4L2_MEMORY_USERPTR {
            assert!(bytes <= room, "written beyond the user memory");
            // SAFETY: the test keeps its memory until the buffer comes back.
            unsafe { std::ptr::copy_nonoverlapping(pixels.as_ptr(), address as *mut u8, pixels.len()) };
        } else {
            self.file.write_all_at(&pixels, u64::from(index * BUFFER_ROOM)).unwrap();
        }
        let stamp_s = state.stamp_s;
        let flags = flags | sys::V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | sys::V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
        state.ready.push_back(Filled { index, sequence, flags, bytes, stamp_s });
        true
    }
}

/// Returns the structure behind the argument of an ioctl.
///
/// # Safety
///
/// `argument` must point to a `T` that nothing else uses.
unsafe fn as_mut<'a, T>(argument: Argument) -> &'a mut T {
    // SAFETY: promised by the caller.
    unsafe { &mut *argument.cast() }
}

/// Returns the error of an index behind the end of a list.
fn list_end_error() -> io::Error {
    io::Error::from_raw_os_error(libc::EINVAL)
}

fn refuse(code: i32) -> io::Result<()> {
    Err(io::Error::from_raw_os_error(code))
}

impl Kernel for Mock {
    unsafe fn ioctl(&self, request: libc::c_ulong, argument: Argument) -> io::Result<()> {
        let mut state = self.state();
        if let Some(code) = state.broken {
            return refuse(code);
        }
        // SAFETY: the caller promised the structure of this request.
        unsafe {
            match request {
                sys::REQUEST_REQBUFS => state.request_buffers(as_mut(argument), &self.file),
                sys::REQUEST_QUERYBUF => {
                    let raw: &mut sys::v4l2_buffer = as_mut(argument);
                    (raw.m.offset, raw.length) = (raw.index * BUFFER_ROOM, state.image_bytes());
                    Ok(())
                }
                sys::REQUEST_QBUF => state.enqueue(as_mut(argument)),
                sys::REQUEST_DQBUF => match state.ready.pop_front() {
                    Some(filled) => {
                        *as_mut(argument) = filled.as_buffer();
                        Ok(())
                    }
                    None => refuse(libc::EAGAIN),
                },
                sys::REQUEST_STREAMON => {
                    state.streaming = true;
                    Ok(())
                }
                sys::REQUEST_STREAMOFF => {
                    (state.streaming, state.owned, state.ready) = (false, VecDeque::new(), VecDeque::new());
                    Ok(())
                }
                sys::REQUEST_ENUM_FMT => {
                    let raw: &mut sys::v4l2_fmtdesc = as_mut(argument);
                    let place = raw.index as usize;
                    state.formats().get(place).map(|fourcc| raw.pixelformat = *fourcc).ok_or_else(list_end_error)
                }
                sys::REQUEST_ENUM_FRAMESIZES => {
                    let raw: &mut sys::v4l2_frmsizeenum = as_mut(argument);
                    let sizes = state.sizes(raw.pixel_format);
                    let (width, height) = *sizes.get(raw.index as usize).ok_or_else(list_end_error)?;
                    raw.type_ = sys::V4L2_FRMSIZE_TYPE_DISCRETE;
                    raw.__bindgen_anon_1.discrete = sys::v4l2_frmsize_discrete { width, height };
                    Ok(())
                }
                sys::REQUEST_ENUM_FRAMEINTERVALS => {
                    let raw: &mut sys::v4l2_frmivalenum = as_mut(argument);
                    let rates = state.rates(raw.pixel_format, (raw.width, raw.height));
                    let denominator = *rates.get(raw.index as usize).ok_or_else(list_end_error)?;
                    raw.type_ = sys::V4L2_FRMIVAL_TYPE_DISCRETE;
                    raw.__bindgen_anon_1.discrete = sys::v4l2_fract { numerator: 1, denominator };
                    Ok(())
                }
                sys::REQUEST_G_FMT | sys::REQUEST_S_FMT => {
                    let raw: &mut sys::v4l2_format = as_mut(argument);
                    if request == sys::REQUEST_S_FMT {
                        state.choose_mode(&raw.fmt.pix);
                    }
                    raw.fmt.pix = state.format();
                    Ok(())
                }
                sys::REQUEST_G_PARM | sys::REQUEST_S_PARM => {
                    state.exchange_interval(request == sys::REQUEST_S_PARM, as_mut(argument));
                    Ok(())
                }
                _ => state.control_call(request, argument),
            }
        }
    }

    fn wait(&self, _timeout: Duration) -> io::Result<bool> {
        let state = self.state();
        Ok(state.broken.is_some() || !state.ready.is_empty())
    }

    fn file(&self) -> BorrowedFd<'_> {
        self.file.as_fd()
    }
}

impl State {
    pub fn image_bytes(&self) -> u32 {
        self.stride_bytes() * self.size.1
    }

    /// Returns the pixel formats (fourcc) of the modes.
    fn formats(&self) -> Vec<u32> {
        let mut formats: Vec<u32> = self.modes.iter().map(|(fourcc, ..)| *fourcc).collect();
        formats.dedup();
        if formats.is_empty() { vec![self.fourcc] } else { formats }
    }

    /// Returns the sizes (width, height) of the modes with this pixel format.
    fn sizes(&self, wanted: u32) -> Vec<(u32, u32)> {
        let mut sizes: Vec<_> =
            self.modes.iter().filter(|(fourcc, ..)| *fourcc == wanted).map(|(_, size, _)| *size).collect();
        sizes.dedup();
        sizes
    }

    /// Returns the frame rates, Hz, of the modes with this pixel format and size (width, height).
    fn rates(&self, wanted: u32, wanted_size: (u32, u32)) -> Vec<u32> {
        let modes = self.modes.iter().filter(|(fourcc, size, _)| (*fourcc, *size) == (wanted, wanted_size));
        modes.map(|(.., rate)| *rate).collect()
    }

    /// Writes the present frame interval to `raw`; if `is_set`, first sets that in `raw` if a mode has its rate.
    fn exchange_interval(&mut self, is_set: bool, raw: &mut sys::v4l2_streamparm) {
        // SAFETY: plain numbers, filled in by the caller.
        let wanted = unsafe { raw.parm.capture.timeperframe };
        let has = wanted.numerator == 1 && self.rates(self.fourcc, self.size).contains(&wanted.denominator);
        if is_set && has {
            self.interval = (1, wanted.denominator);
        }
        let (numerator, denominator) = self.interval;
        let timeperframe = sys::v4l2_fract { numerator, denominator };
        raw.parm.capture =
            sys::v4l2_captureparm { capability: sys::V4L2_CAP_TIMEPERFRAME, timeperframe, ..Default::default() };
    }

    /// Sets the requested mode; for a format without this size its first mode, as drivers do.
    fn choose_mode(&mut self, pix: &sys::v4l2_pix_format) {
        let wanted = (pix.pixelformat, (pix.width, pix.height));
        let of_format = |(fourcc, ..): &&(u32, (u32, u32), u32)| *fourcc == wanted.0;
        let exact = self.modes.iter().find(|(fourcc, size, _)| (*fourcc, *size) == wanted);
        if let Some((fourcc, size, rate)) = exact.or_else(|| self.modes.iter().find(of_format)) {
            (self.fourcc, self.size, self.interval) = (*fourcc, *size, (1, *rate));
        }
    }

    fn stride_bytes(&self) -> u32 {
        let pixel = if self.fourcc == sys::FOURCC_GREY { 1 } else { 2 };
        self.size.0 * pixel + self.padding_bytes
    }

    /// Returns the current format and size.
    fn format(&self) -> sys::v4l2_pix_format {
        sys::v4l2_pix_format {
            width: self.size.0,
            height: self.size.1,
            pixelformat: self.fourcc,
            field: sys::V4L2_FIELD_NONE,
            bytesperline: self.stride_bytes(),
            sizeimage: self.image_bytes(),
            ..Default::default()
        }
    }

    /// Allocates at most eight of the requested buffers, or refuses user memory.
    fn request_buffers(&mut self, raw: &mut sys::v4l2_requestbuffers, file: &File) -> io::Result<()> {
        if raw.memory == sys::V4L2_MEMORY_USERPTR && !self.takes_user.0 {
            return refuse(libc::EINVAL);
        }
        (self.memory, self.buffers) = (raw.memory, raw.count.min(8));
        raw.count = self.buffers;
        self.owned.clear();
        file.set_len(u64::from(self.buffers * BUFFER_ROOM))
    }

    /// Queues a buffer, or refuses it as the kernel does.
    fn enqueue(&mut self, raw: &sys::v4l2_buffer) -> io::Result<()> {
        if let Some(code) = self.refuses_buffers {
            return refuse(code);
        }
        let is_owned = self.owned.iter().any(|(index, ..)| *index == raw.index)
            || self.ready.iter().any(|buffer| buffer.index == raw.index);
        // Like the kernel for a buffer that is already queued.
        if raw.index >= self.buffers || raw.memory != self.memory || is_owned {
            return refuse(libc::EINVAL);
        }
        // SAFETY: `memory` says which member was filled in; both are numbers.
        let address = unsafe { raw.m.userptr };
        if raw.memory == sys::V4L2_MEMORY_USERPTR && (!self.takes_user.1 || raw.length < self.image_bytes()) {
            return refuse(libc::EINVAL);
        }
        self.owned.push_back((raw.index, address, raw.length));
        Ok(())
    }

    /// Returns the flags of a control: inactive while the control that rules it has the ruling value.
    fn flags_of(&self, control: &MockControl) -> u32 {
        let ruled = control
            .ruled_by
            .is_some_and(|(id, value)| self.controls.iter().any(|other| other.id == id && other.value == value));
        if ruled { sys::V4L2_CTRL_FLAG_INACTIVE } else { 0 }
    }

    /// Answers an ioctl on controls: the next one in the list, a menu entry, or a value read or set.
    ///
    /// # Safety
    ///
    /// `argument` must point to the structure of the request.
    unsafe fn control_call(&mut self, request: libc::c_ulong, argument: Argument) -> io::Result<()> {
        match request {
            sys::REQUEST_QUERY_EXT_CTRL => {
                // SAFETY: promised by the caller.
                let raw: &mut sys::v4l2_query_ext_ctrl = unsafe { as_mut(argument) };
                let after = raw.id & !sys::V4L2_CTRL_FLAG_NEXT_CTRL;
                let Some(control) = self.controls.iter().find(|control| control.id > after) else {
                    return refuse(libc::EINVAL);
                };
                (raw.id, raw.type_, raw.flags) = (control.id, control.kind, self.flags_of(control));
                (raw.minimum, raw.maximum, raw.step) = control.range;
                for (to, from) in raw.name.iter_mut().zip(control.name.bytes()) {
                    *to = from.cast_signed();
                }
                Ok(())
            }
            sys::REQUEST_QUERYMENU => {
                // SAFETY: promised by the caller.
                let raw: &mut sys::v4l2_querymenu = unsafe { as_mut(argument) };
                let (id, index) = (raw.id, raw.index as usize);
                let control = self.controls.iter().find(|control| control.id == id);
                let Some(word) = control.and_then(|control| control.words.get(index)).filter(|word| !word.is_empty())
                else {
                    return refuse(libc::EINVAL);
                };
                let mut name = [0; 32];
                name[..word.len()].copy_from_slice(word.as_bytes());
                raw.__bindgen_anon_1.name = name;
                Ok(())
            }
            sys::REQUEST_G_EXT_CTRLS | sys::REQUEST_S_EXT_CTRLS => {
                // SAFETY: promised by the caller, who lists one control.
                let one = unsafe { &mut *as_mut::<sys::v4l2_ext_controls>(argument).controls };
                let id = one.id;
                let Some(control) = self.controls.iter_mut().find(|control| control.id == id) else {
                    return refuse(libc::EINVAL);
                };
                if request == sys::REQUEST_S_EXT_CTRLS {
                    // SAFETY: plain numbers all.
                    control.value = unsafe { one.__bindgen_anon_1.value };
                }
                one.__bindgen_anon_1.value = control.value;
                Ok(())
            }
            _ => refuse(libc::ENOTTY),
        }
    }
}
