//! The stream of a camera: slots go in, filled ones come out.
//!
//! The library writes packets straight into the slots' memory, from its own thread. Only where a camera sends
//! something behind each picture, for which a slot has no room, they go to memory of the stream, and the picture is
//! copied.

use super::chunks::{Chunks, Told};
use super::completion::Completions;
use super::device::Device;
use super::filter::Shape;
use super::handle::{Library, Object, c_text, checked, text};
use super::settings::GenicamSettings;
use super::socket;
use super::sys::{self, ArvBuffer, ArvStream, ArvStreamCallbackType, gpointer, guint64};
use crate::camera::{Slot, priority};
use std::net::Ipv4Addr;
use std::ptr::{self, NonNull};
use std::sync::{Arc, Once};
use std::time::{Duration, Instant};

/// Largest packet chosen by ourselves: larger ones gain nothing and lose more at once.
const MAX_PACKET_BYTES: u32 = 16_000;

/// Socket memory asked for, in frames and bytes: what the receiving thread may be late by.
const SOCKET_FRAMES: usize = 32;
const MIN_SOCKET_BYTES: usize = 4 << 20;
const MAX_SOCKET_BYTES: usize = 64 << 20;

/// What became of one buffer.
#[derive(Debug)]
pub struct Arrival {
    /// The memory given in.
    pub slot: Slot,
    /// Whether it holds a whole frame.
    pub status: sys::ArvBufferStatus,
    /// What the payload is.
    pub payload: sys::ArvBufferPayloadType,
    /// Id on the wire; 0 when the frame's first packet never came.
    pub id: u64,
    /// The camera's stamp, ns.
    pub device_ns: u64,
    /// Host time when the first packet came, ns since the Unix epoch.
    pub arrival_ns: u64,
    /// Bytes received.
    pub received_bytes: usize,
    /// Width, height and pixel format in the frame's own header, when it has one.
    pub image: Option<(i32, i32, u32)>,
    /// What the camera told behind the picture, of a whole frame of a camera that does.
    pub told: Option<Result<Told, String>>,
    /// When its last packet had come; nothing when that was just now.
    pub completed: Option<Instant>,
}

/// Counts of the library, since the stream began.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StreamStatistics {
    /// Frames received whole.
    pub completed: u64,
    /// Frames begun and not completed.
    pub failed: u64,
    /// Packets that found no slot to go to.
    pub packets_without_slot: u64,
    /// Packets asked for again.
    pub resend_requests: u64,
    /// Packets that came after being asked for again.
    pub resent_packets: u64,
}

/// A camera's stream and the slots in it.
#[derive(Debug)]
pub struct Stream {
    // Dropped before the slots: the last reference ends the library's thread and frees its buffers.
    stream: Option<Object<ArvStream>>,
    lent: Vec<Lent>,
    aravis: Library,
    sizes: Sizes,
    chunks: Option<Chunks>,
    completions: Arc<Completions>,
    /// Memory for payloads that no buffer uses.
    spare: Vec<Box<[u8]>>,
}

/// A slot in the library's hands.
#[derive(Debug)]
struct Lent {
    buffer: NonNull<ArvBuffer>,
    slot: Slot,
    /// Where the payload goes when not into the slot.
    payload: Option<Box<[u8]>>,
}

/// How much comes with each frame.
#[derive(Debug, Clone, Copy)]
pub struct Sizes {
    /// Pixels.
    pub image_bytes: usize,
    /// Pixels and chunks.
    pub payload_bytes: usize,
}

// SAFETY: buffers are reached through their addresses only here, and the library's queues lock themselves.
unsafe impl Send for Stream {}

impl Stream {
    /// Makes the stream of a camera whose settings are final: packet size, socket, receiving thread.
    ///
    /// # Errors
    ///
    /// The library's words.
    pub fn new(
        device: &Device,
        settings: &GenicamSettings,
        sizes: Sizes,
        chunks: Option<Chunks>,
    ) -> Result<Self, String> {
        let aravis = device.aravis;
        let packet_bytes = match device.is_gige() {
            true => Some(prepare_link(device, settings.packet_size_bytes)?),
            false => None,
        };
        let camera = device.camera.as_ptr();
        let completions = Arc::new(Completions::default());
        let data = Arc::into_raw(Arc::clone(&completions)).cast_mut().cast();
        // SAFETY: an open camera; the callback may run on any thread, and its data lives until the library lets it go.
        let stream = checked(aravis, |error| unsafe {
            aravis.arv_camera_create_stream_full(camera, Some(on_stream), data, Some(let_go), error)
        })?;
        // SAFETY: the library made it for us.
        let stream = unsafe { Object::owned(aravis, stream) }.ok_or("the camera offers no stream")?;
        if let Some(packet_bytes) = packet_bytes {
            prepare_socket(device, &stream, sizes.payload_bytes, packet_bytes);
        }
        Ok(Self { stream: Some(stream), lent: Vec::new(), aravis, sizes, chunks, completions, spare: Vec::new() })
    }

    fn as_ptr(&self) -> *mut ArvStream {
        self.stream.as_ref().map_or(ptr::null_mut(), Object::as_ptr)
    }

    /// Lends a slot to the library until it comes out of [`pop`](Self::pop).
    ///
    /// # Panics
    ///
    /// When the slot is smaller than a frame.
    pub fn push(&mut self, slot: Slot) {
        let Sizes { image_bytes, payload_bytes } = self.sizes;
        assert!(slot.len() >= image_bytes, "slot of {} bytes for {image_bytes}", slot.len());
        let mut payload =
            self.chunks.is_some().then(|| self.spare.pop().unwrap_or_else(|| vec![0; payload_bytes].into()));
        let memory = payload.as_mut().map_or(slot.as_ptr(), |payload| payload.as_mut_ptr());
        // A new buffer each time: a used one would carry the old frame's id into a torn frame.
        // SAFETY: the memory is exclusively ours and kept in `lent` for as long as the library has the buffer.
        let buffer = unsafe { self.aravis.arv_buffer_new_full(payload_bytes, memory.cast(), ptr::null_mut(), None) };
        let Some(buffer) = NonNull::new(buffer) else { return };
        self.lent.push(Lent { buffer, slot, payload });
        // SAFETY: the stream takes the reference over.
        unsafe { self.aravis.arv_stream_push_buffer(self.as_ptr(), buffer.as_ptr()) };
    }

    /// Waits for a buffer to come out, at most `timeout`.
    pub fn pop(&mut self, timeout: Duration) -> Option<Arrival> {
        let timeout_us = u64::try_from(timeout.as_micros()).unwrap_or(u64::MAX);
        // SAFETY: a live stream; the reference of what comes out is ours.
        let buffer = NonNull::new(unsafe { self.aravis.arv_stream_timeout_pop_buffer(self.as_ptr(), timeout_us) })?;
        let completed = self.completions.take();
        let place = self.lent.iter().position(|lent| lent.buffer == buffer)?;
        let Lent { slot, payload, .. } = self.lent.swap_remove(place);
        let mut arrival = Arrival { completed, ..self.describe(buffer.as_ptr(), slot) };
        if let Some(payload) = payload {
            self.take_apart(buffer.as_ptr(), &mut arrival, &payload);
            self.spare.push(payload);
        }
        // SAFETY: popping gave us the reference; the memory stays with the slot, or is spare.
        unsafe { self.aravis.g_object_unref(buffer.as_ptr().cast()) };
        Some(arrival)
    }

    /// Reads the chunks of a whole frame and moves its picture into the slot.
    fn take_apart(&self, buffer: *mut ArvBuffer, arrival: &mut Arrival, payload: &[u8]) {
        let Some(chunks) = self.chunks.as_ref().filter(|_| arrival.status == sys::ARV_BUFFER_STATUS_SUCCESS) else {
            return;
        };
        let payload = &payload[..arrival.received_bytes.min(payload.len())];
        let image_bytes = self.sizes.image_bytes;
        // SAFETY: a buffer out of the stream, filled, which nobody else touches.
        let told = unsafe { chunks.read(buffer, payload, image_bytes, arrival.device_ns) };
        if told.is_ok() {
            arrival.slot.bytes_mut()[..image_bytes].copy_from_slice(&payload[..image_bytes]);
        }
        arrival.told = Some(told);
    }

    fn describe(&self, buffer: *mut ArvBuffer, slot: Slot) -> Arrival {
        let aravis = self.aravis;
        let mut received_bytes = 0;
        // SAFETY: a buffer out of the stream, which nobody else touches.
        unsafe {
            let payload = aravis.arv_buffer_get_payload_type(buffer);
            let status = aravis.arv_buffer_get_status(buffer);
            let whole = status == sys::ARV_BUFFER_STATUS_SUCCESS;
            let has_image = matches!(
                payload,
                sys::ARV_BUFFER_PAYLOAD_TYPE_IMAGE | sys::ARV_BUFFER_PAYLOAD_TYPE_EXTENDED_CHUNK_DATA
            );
            if whole {
                aravis.arv_buffer_get_data(buffer, &raw mut received_bytes);
            }
            Arrival {
                slot,
                status,
                payload,
                id: aravis.arv_buffer_get_frame_id(buffer),
                device_ns: aravis.arv_buffer_get_timestamp(buffer),
                arrival_ns: aravis.arv_buffer_get_system_timestamp(buffer),
                received_bytes,
                image: (whole && has_image).then(|| {
                    (
                        aravis.arv_buffer_get_image_width(buffer),
                        aravis.arv_buffer_get_image_height(buffer),
                        aravis.arv_buffer_get_image_pixel_format(buffer),
                    )
                }),
                told: None,
                completed: None,
            }
        }
    }

    /// Ends the stream of a camera that is gone, without waiting for it.
    ///
    /// The library writes goodbyes to the camera when a stream and its device go, and waits seconds for the
    /// answers. Slots are free when this returns; the goodbyes wait on a thread of their own.
    pub fn abandon(&mut self) {
        let Some(stream) = self.stream.take() else { return };
        // SAFETY: a live stream. The first call joins the receiving thread and frees all buffers, so that nobody
        // writes to the slots any more; the second is there because the end of a stream wants a thread to stop.
        unsafe {
            self.aravis.arv_stream_stop_thread(stream.as_ptr(), 1);
            self.aravis.arv_stream_start_thread(stream.as_ptr());
        }
        self.lent.clear();
        std::thread::spawn(move || drop(stream));
    }

    /// The library's counts.
    pub fn statistics(&self) -> StreamStatistics {
        let mut counts = StreamStatistics::default();
        // SAFETY: a live stream, numbers of ours to write to, and terminated names.
        unsafe {
            self.aravis.arv_stream_get_statistics(
                self.as_ptr(),
                &raw mut counts.completed,
                &raw mut counts.failed,
                &raw mut counts.packets_without_slot,
            );
            let info = |name: &std::ffi::CStr| -> guint64 {
                self.aravis.arv_stream_get_info_uint64_by_name(self.as_ptr(), name.as_ptr())
            };
            counts.resend_requests = info(c"n_resend_requests");
            counts.resent_packets = info(c"n_resent_packets");
        }
        counts
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        // Ours is the only reference, so this joins the receiving thread and frees every buffer: only then are
        // the slots nobody's, and may be dropped.
        self.stream = None;
        self.lent.clear();
    }
}

/// Packet size and way of receiving, before the stream is made; answers with the size.
fn prepare_link(device: &Device, wanted_bytes: Option<u32>) -> Result<u32, String> {
    let aravis = device.aravis;
    let address = interface_address(device);
    // Raw packet sockets, which the library prefers where it may, see nothing of a loopback device that answers from
    // another address; and nothing guards them.
    // SAFETY: an open GigE Vision camera and a constant of the library.
    unsafe {
        aravis
            .arv_camera_gv_set_stream_options(device.camera.as_ptr(), sys::ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
    }
    let bytes = match wanted_bytes {
        Some(bytes) => bytes,
        None => {
            let mtu = address.and_then(socket::mtu_of).unwrap_or(1500);
            let (_, camera_max, step) = device.integer_range("GevSCPSPacketSize").unwrap_or((0, i64::MAX, 1));
            let most = i64::from(mtu.min(MAX_PACKET_BYTES)).min(camera_max);
            u32::try_from(most - most.rem_euclid(step)).unwrap_or(1500)
        }
    };
    let size = i32::try_from(bytes).map_err(|_| format!("packets of {bytes} bytes"))?;
    // SAFETY: an open GigE Vision camera.
    checked(aravis, |error| unsafe { aravis.arv_camera_gv_set_packet_size(device.camera.as_ptr(), size, error) })?;
    let kept = device.ask(aravis.arv_camera_gv_get_packet_size)?;
    if kept != bytes && wanted_bytes.is_some() {
        return Err(format!("packets of {bytes} bytes: the camera keeps {kept}"));
    }
    log::info!("packets of {kept} bytes");
    Ok(kept)
}

/// Our own address on the way to the camera.
fn interface_address(device: &Device) -> Option<Ipv4Addr> {
    address(device, device.aravis.arv_gv_device_get_interface_address)
}

/// The camera's.
fn device_address(device: &Device) -> Option<Ipv4Addr> {
    address(device, device.aravis.arv_gv_device_get_device_address)
}

fn address(
    device: &Device,
    function: unsafe extern "C" fn(*mut sys::ArvGvDevice) -> *mut sys::GSocketAddress,
) -> Option<Ipv4Addr> {
    let aravis = device.aravis;
    // SAFETY: an open GigE Vision device; addresses are borrowed from it, the string is ours to free.
    unsafe {
        let address = function(device.as_ptr().cast());
        let address = aravis.g_inet_socket_address_get_address(address.cast());
        let string = aravis.g_inet_address_to_string(address);
        let address = text(string);
        super::handle::free(aravis, string);
        address?.parse().ok()
    }
}

/// Guards the socket, and sizes it now: the library would do it after the first packet, and smaller.
fn prepare_socket(device: &Device, stream: &Object<ArvStream>, payload_bytes: usize, packet_bytes: u32) {
    let aravis = device.aravis;
    // FIXED with no size given: the library leaves the socket as we make it.
    set_int_property(aravis, stream, "socket-buffer", sys::ARV_GV_STREAM_SOCKET_BUFFER_FIXED.cast_signed());
    let wanted = (payload_bytes * SOCKET_FRAMES).clamp(MIN_SOCKET_BYTES, MAX_SOCKET_BYTES);
    // SAFETY: a live GigE Vision stream.
    let port = unsafe { aravis.arv_gv_stream_get_port(stream.as_ptr().cast()) };
    let descriptor = match socket::find_udp(interface_address(device), port) {
        Ok(descriptor) => descriptor,
        Err(error) => return log::warn!("the stream's socket keeps its size, frames may be lost: {error}"),
    };
    if let Some(camera) = device_address(device) {
        let shape = Shape { camera, payload_bytes: u32::try_from(payload_bytes).unwrap_or(u32::MAX), packet_bytes };
        if let Err(error) = shape.guard(descriptor) {
            log::warn!("the stream's socket takes packets from everywhere: {error}");
        }
    }
    match socket::grow_receive_buffer(descriptor, wanted) {
        Ok(bytes) if bytes < wanted => log::warn!(
            "the stream's socket holds {bytes} bytes of the {wanted} wanted: frames may be lost; \
             sysctl net.core.rmem_max={wanted} raises the limit"
        ),
        Ok(bytes) => log::info!("the stream's socket holds {bytes} bytes"),
        Err(error) => log::warn!("the stream's socket keeps its size, frames may be lost: {error}"),
    }
}

fn set_int_property(aravis: Library, stream: &Object<ArvStream>, name: &str, value: i32) {
    /// `G_TYPE_INT`: fundamental type 6, shifted by 2.
    const INT: sys::GType = 6 << 2;
    let Ok(name) = c_text(name) else { return };
    // SAFETY: a zeroed GValue is an unset one; it is initialised as an int, which enumerations accept, and unset again.
    unsafe {
        let mut holder: sys::GValue = std::mem::zeroed();
        aravis.g_value_init(&raw mut holder, INT);
        aravis.g_value_set_int(&raw mut holder, value);
        aravis.g_object_set_property(stream.as_ptr().cast(), name.as_ptr(), &raw const holder);
        aravis.g_value_unset(&raw mut holder);
    }
}

/// Called by the library on its receiving thread.
unsafe extern "C" fn on_stream(data: gpointer, kind: ArvStreamCallbackType, _buffer: *mut ArvBuffer) {
    static TOLD: Once = Once::new();
    if kind == sys::ARV_STREAM_CALLBACK_TYPE_BUFFER_DONE {
        // SAFETY: what the stream was made with, until `let_go`.
        unsafe { &*data.cast::<Completions>() }.add();
    }
    if kind != sys::ARV_STREAM_CALLBACK_TYPE_INIT {
        return;
    }
    if let Err(error) = priority::raise(priority::RECEIVING) {
        TOLD.call_once(|| log::warn!("the receiving thread has no real-time priority: {error}"));
    }
}

/// Called by the library when it calls `on_stream` no more.
unsafe extern "C" fn let_go(data: gpointer) {
    // SAFETY: out of `Arc::into_raw`, given back once.
    drop(unsafe { Arc::from_raw(data.cast::<Completions>().cast_const()) });
}

/// Why a buffer holds no whole frame.
pub fn cause(status: sys::ArvBufferStatus) -> &'static str {
    match status {
        sys::ARV_BUFFER_STATUS_TIMEOUT => "packets still missing after the wait",
        sys::ARV_BUFFER_STATUS_MISSING_PACKETS => "packets missing",
        sys::ARV_BUFFER_STATUS_WRONG_PACKET_ID => "a packet with a wrong number",
        sys::ARV_BUFFER_STATUS_SIZE_MISMATCH => "more data than a frame has",
        sys::ARV_BUFFER_STATUS_ABORTED => "cut off by the end of the stream",
        _ => "not filled",
    }
}
