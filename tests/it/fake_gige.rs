//! A GigE Vision camera in the test's own process: real packets on 127.0.0.1, pixels from the test.
#![expect(unsafe_code, reason = "the imitated camera is part of a C library")]
#![expect(clippy::disallowed_methods, reason = "waiting for a port has a deadline")]

use ricochet::camera::genicam::{library, sys};
use std::ffi::{CString, c_void};
use std::io::Write;
use std::ptr;
use std::sync::atomic::{AtomicPtr, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tempfile::NamedTempFile;

/// The address of the camera, for `id`.
pub const ADDRESS: &str = "127.0.0.1";

/// The trigger source that is wired up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wiring {
    /// The command `TriggerSoftware`.
    Software,
    /// The input `Line1`, pulled by [`FakeGige::pulse`].
    Line1,
}

type Source = Box<dyn Fn(u64, &mut [u8]) + Send + Sync>;

/// Data that the camera's thread reaches through a pointer.
struct Shared {
    source: Source,
    /// Frames drawn so far.
    sent: Arc<AtomicU64>,
    /// The number of frames after which the camera stops by itself.
    limit: u64,
    camera: AtomicPtr<sys::ArvFakeCamera>,
}

/// A running camera. Dropping it unplugs it.
pub struct FakeGige {
    aravis: &'static sys::Aravis,
    /// Null while unplugged.
    gige: *mut sys::ArvGvFakeCamera,
    shared: *mut Shared,
    sent: Arc<AtomicU64>,
    description: NamedTempFile,
    address: &'static str,
    _port: Option<MutexGuard<'static, ()>>,
}

impl FakeGige {
    /// Plugs in a camera that sends frames 0 to `limit - 1`, each drawn by `source(index, pixels)`.
    ///
    /// Returns `None` with a line on stderr if Aravis is not installed, and panics then with RICOCHET_REQUIRE_ARAVIS=1.
    /// Rate, size and trigger are set by the program that opens the camera. It sends nothing before acquisition starts.
    /// One camera runs at a time, and the next one waits for its end.
    pub fn plug_in(
        wiring: Wiring,
        limit: u64,
        source: impl Fn(u64, &mut [u8]) + Send + Sync + 'static,
    ) -> Option<Self> {
        static PORT: Mutex<()> = Mutex::new(());
        let aravis = aravis_or_leave_out()?;
        let port = PORT.lock().unwrap_or_else(PoisonError::into_inner);
        Some(Self::at(aravis, ADDRESS, wiring, limit, source, Some(port)))
    }

    /// Plugs in a camera like [`plug_in`](Self::plug_in), at another address.
    pub fn plug_in_at(
        address: &'static str,
        limit: u64,
        source: impl Fn(u64, &mut [u8]) + Send + Sync + 'static,
    ) -> Option<Self> {
        Some(Self::at(aravis_or_leave_out()?, address, Wiring::Software, limit, source, None))
    }

    fn at(
        aravis: &'static sys::Aravis,
        address: &'static str,
        wiring: Wiring,
        limit: u64,
        source: impl Fn(u64, &mut [u8]) + Send + Sync + 'static,
        port: Option<MutexGuard<'static, ()>>,
    ) -> Self {
        let (line1, software) = if wiring == Wiring::Line1 { ("1", "2") } else { ("2", "1") };
        let text = include_str!("fake_camera.xml")
            .replace("<Value>LINE1</Value>", &format!("<Value>{line1}</Value>"))
            .replace("<Value>SOFTWARE</Value>", &format!("<Value>{software}</Value>"));
        let mut description = NamedTempFile::new().unwrap();
        description.write_all(text.as_bytes()).unwrap();
        let sent = Arc::new(AtomicU64::new(0));
        let camera = AtomicPtr::new(ptr::null_mut());
        let shared =
            Box::into_raw(Box::new(Shared { source: Box::new(source), sent: Arc::clone(&sent), limit, camera }));
        let mut gige = Self { aravis, gige: ptr::null_mut(), shared, sent, description, address, _port: port };
        gige.plug_back();
        gige
    }

    /// Takes the camera off the network without notice.
    pub fn unplug(&mut self) {
        // SAFETY: the last reference joins the camera's thread.
        unsafe { self.aravis.g_object_unref(self.gige.cast()) };
        self.gige = ptr::null_mut();
    }

    /// Plugs the camera in again. Its frame numbers continue.
    pub fn plug_back(&mut self) {
        let path = CString::new(self.description.path().to_str().unwrap()).unwrap();
        self.gige = start(self.aravis, self.address, &path);
        let camera = self.camera();
        // SAFETY: `shared` is freed in drop, after the camera's thread has ended.
        unsafe {
            (*self.shared).camera.store(camera, Ordering::Release);
            self.aravis.arv_fake_camera_set_fill_pattern(camera, Some(draw), self.shared.cast());
            self.aravis.arv_fake_camera_set_trigger_frequency(camera, 1000.0);
        }
    }

    fn camera(&self) -> *mut sys::ArvFakeCamera {
        assert!(!self.gige.is_null(), "the camera is unplugged");
        // SAFETY: the camera runs, and its inner one lives as long.
        unsafe { self.aravis.arv_gv_fake_camera_get_fake_camera(self.gige) }
    }

    /// The number of frames drawn so far, sent or being sent.
    pub fn sent(&self) -> u64 {
        self.sent.load(Ordering::Acquire)
    }

    /// Sends a rising edge on Line1, or the software trigger, as wired.
    pub fn pulse(&self) {
        self.write(sys::ARV_FAKE_CAMERA_REGISTER_TRIGGER_SOFTWARE, 1);
    }

    /// Drops this share of packets, 0 to 1.
    pub fn lose(&self, share: f64) {
        /// `G_TYPE_DOUBLE`: fundamental type 15, shifted by 2.
        const DOUBLE: sys::GType = 15 << 2;
        // SAFETY: a zeroed GValue is an unset one; the property is a double.
        unsafe {
            let mut holder: sys::GValue = std::mem::zeroed();
            self.aravis.g_value_init(&raw mut holder, DOUBLE);
            self.aravis.g_value_set_double(&raw mut holder, share);
            self.aravis.g_object_set_property(self.gige.cast(), c"gvsp-lost-ratio".as_ptr(), &raw const holder);
        }
    }

    /// Reads a register of the camera.
    pub fn register(&self, address: u32) -> u32 {
        let mut value = 0;
        // SAFETY: the camera runs, and the value is ours to write to.
        let read = unsafe { self.aravis.arv_fake_camera_read_register(self.camera(), address, &raw mut value) };
        assert!(read != 0, "register {address:#x}");
        value
    }

    /// Writes a register without the client's knowledge.
    pub fn write(&self, address: u32, value: u32) {
        // SAFETY: the camera runs.
        assert!(unsafe { self.aravis.arv_fake_camera_write_register(self.camera(), address, value) } != 0);
    }
}

impl Drop for FakeGige {
    fn drop(&mut self) {
        if !self.gige.is_null() {
            self.unplug();
        }
        // SAFETY: made by Box::into_raw, and the camera's thread, which used it, has ended.
        drop(unsafe { Box::from_raw(self.shared) });
    }
}

/// Aravis if it is installed, or a message that the test was left out.
pub fn aravis_or_leave_out() -> Option<&'static sys::Aravis> {
    match library() {
        Ok(aravis) => Some(aravis),
        Err(error) if std::env::var("RICOCHET_REQUIRE_ARAVIS").is_ok_and(|value| value == "1") => panic!("{error}"),
        Err(error) => {
            eprintln!("left out: {error}");
            None
        }
    }
}

/// Starts the camera, after waiting for the port if another process has a camera on it.
fn start(aravis: &'static sys::Aravis, at: &str, description: &CString) -> *mut sys::ArvGvFakeCamera {
    let address = CString::new(at).unwrap();
    let deadline = Instant::now() + Duration::from_secs(60);
    loop {
        // SAFETY: terminated strings, and the reference is ours.
        unsafe {
            let gige = aravis.arv_gv_fake_camera_new_full(address.as_ptr(), c"R1".as_ptr(), description.as_ptr());
            if aravis.arv_gv_fake_camera_is_running(gige) != 0 {
                return gige;
            }
            aravis.g_object_unref(gige.cast());
        }
        assert!(Instant::now() < deadline, "UDP port 3956 of {at} stays taken");
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// Called by the library on the camera's thread for each frame.
unsafe extern "C" fn draw(buffer: *mut sys::ArvBuffer, data: *mut c_void, _exposure: u32, _gain: u32, format: u32) {
    let aravis = library().unwrap();
    // SAFETY: `plug_in` passed this in and frees it only after this thread has ended. The library's buffer is as large
    // as the frame that it describes, and nobody reads it meanwhile.
    unsafe {
        let shared = &*data.cast::<Shared>();
        let width = aravis.arv_buffer_get_image_width(buffer) as usize;
        let height = aravis.arv_buffer_get_image_height(buffer) as usize;
        let bytes = width * height * ((format >> 16) & 0xff) as usize / 8;
        let pixels = aravis.arv_buffer_get_data(buffer, std::ptr::null_mut()).cast_mut().cast::<u8>();
        let index = shared.sent.load(Ordering::Acquire);
        (shared.source)(index, std::slice::from_raw_parts_mut(pixels, bytes));
        if index + 1 >= shared.limit {
            let camera = shared.camera.load(Ordering::Acquire);
            aravis.arv_fake_camera_write_register(camera, sys::ARV_FAKE_CAMERA_REGISTER_ACQUISITION, 0);
        }
        shared.sent.store(index + 1, Ordering::Release);
    }
}
