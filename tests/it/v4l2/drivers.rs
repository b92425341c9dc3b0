//! The driver side of the virtual cameras in the virtual machine.
#![expect(unsafe_code, reason = "drivers are spoken to through structures of C")]

use ricochet::camera::v4l2::sys;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::os::fd::AsRawFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// The kernel's test camera.
pub const VIVID: &str = "/dev/video0";
/// The camera that shows the frames a program writes to it.
pub const LOOPBACK: &str = "/dev/video10";

/// The time between two frames of the loop-back camera.
const PERIOD: Duration = Duration::from_millis(4);

/// Faults that vivid can inject (error injection in its documentation).
#[derive(Debug, Clone, Copy)]
pub enum Fault {
    DropPercent = 0x00f0_f040,
    Disconnect = 0x00f0_f041,
    DamageBuffer = 0x00f0_f042,
    FatalStreamError = 0x00f0_f046,
    WrapSequence = 0x00f0_f026,
}

fn open(path: &str) -> File {
    OpenOptions::new().read(true).write(true).open(path).unwrap()
}

fn call<T>(file: &File, request: libc::c_ulong, argument: &mut T) {
    assert_eq!((request >> 16) & 0x3fff, size_of::<T>() as libc::c_ulong);
    // SAFETY: the structure has the size of the request's, and pointers in it live through the call.
    let result = unsafe { libc::ioctl(file.as_raw_fd(), request as _, std::ptr::from_mut(argument)) };
    assert!(result >= 0, "ioctl {request:#x}: {}", std::io::Error::last_os_error());
}

/// Injects a fault into vivid while another program streams.
pub fn inject(fault: Fault, value: i32) {
    let mut one = sys::v4l2_ext_control { id: fault as u32, ..Default::default() };
    one.__bindgen_anon_1.value = value;
    let mut list = sys::v4l2_ext_controls { count: 1, controls: &raw mut one, ..Default::default() };
    call(&open(VIVID), sys::REQUEST_S_EXT_CTRLS, &mut list);
}

/// A program that writes numbered frames to the loop-back camera until it is dropped.
pub struct Writer {
    stop: Arc<AtomicBool>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Writer {
    /// Sets format and size, and returns once the first frame is written: only then can the camera be read.
    ///
    /// `draw(number)` returns the bytes of a frame, at most `frame_bytes`.
    pub fn start(
        (width, height): (u32, u32),
        fourcc: u32,
        frame_bytes: u32,
        draw: impl Fn(u64) -> Vec<u8> + Send + 'static,
    ) -> Self {
        let mut file = open(LOOPBACK);
        let mut format = sys::v4l2_format { type_: sys::V4L2_BUF_TYPE_VIDEO_OUTPUT, ..Default::default() };
        format.fmt.pix = sys::v4l2_pix_format {
            width,
            height,
            pixelformat: fourcc,
            field: sys::V4L2_FIELD_NONE,
            bytesperline: frame_bytes / height,
            sizeimage: frame_bytes,
            ..Default::default()
        };
        call(&file, sys::REQUEST_S_FMT, &mut format);
        // SAFETY: the kernel filled in `pix`.
        let kept = unsafe { format.fmt.pix };
        assert_eq!(
            (kept.width, kept.height, kept.pixelformat),
            (width, height, fourcc),
            "the driver keeps another format"
        );
        let mut write = move |number| {
            let frame = draw(number);
            assert!(frame.len() <= frame_bytes as usize);
            assert_eq!(file.write(&frame).unwrap(), frame.len());
        };
        write(0);
        let stop = Arc::new(AtomicBool::new(false));
        let stop_requested = Arc::clone(&stop);
        let thread = std::thread::spawn(move || {
            let mut number = 0;
            while !stop_requested.load(Ordering::Relaxed) {
                number += 1;
                write(number);
                std::thread::sleep(PERIOD);
            }
        });
        Self { stop, thread: Some(thread) }
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
