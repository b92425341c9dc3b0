//! The stream of a camera: slots go in, filled slots come out.
//!
//! The library writes packets into the slots' memory from its own thread. If a camera sends chunk data behind each
//! image, for which a slot has no room, packets go to memory of the stream instead, and the image is copied.

use super::buffer_times::BufferTimes;
use super::chunks::{ChunkValues, Chunks};
use super::device::Device;
use super::handle::{Library, Object, c_text, checked, text};
use super::packet_filter::StreamShape;
use super::socket;
use super::sys::{self, ArvBuffer, ArvStream, ArvStreamCallbackType, gpointer, guint64};
use crate::camera::feature_setting::IntegerRange;
use crate::camera::{Slot, realtime_priority};
use std::net::Ipv4Addr;
use std::ptr::{self, NonNull};
use std::sync::{Arc, Once};
use std::time::{Duration, Instant};

/// Maximum default packet size: larger packets gain nothing, and a lost one loses more.
const MAX_PACKET_BYTES: u32 = 16_000;

/// Size of the socket buffer in frames, within limits in bytes. It absorbs delays of the receiving thread.
const SOCKET_FRAMES: usize = 32;
const MIN_SOCKET_BYTES: usize = 4 << 20;
const MAX_SOCKET_BYTES: usize = 64 << 20;

/// A buffer that came out of the stream.
#[derive(Debug)]
pub struct ReceivedBuffer {
    /// The slot that was queued.
    pub slot: Slot,
    /// Whether the buffer holds a complete frame.
    pub status: sys::ArvBufferStatus,
    /// Payload type.
    pub payload: sys::ArvBufferPayloadType,
    /// Frame id; 0 if the frame's first packet was lost.
    pub id: u64,
    /// The camera's timestamp, ns.
    pub device_ns: u64,
    /// Host time at which the first packet arrived, ns since the Unix epoch.
    pub arrival_ns: u64,
    /// Bytes received.
    pub received_bytes: usize,
    /// Width, height and pixel format in the frame's header, if it has them.
    pub image: Option<(i32, i32, u32)>,
    /// The chunk values of a complete frame, if the camera sends any.
    pub chunks: Option<Result<ChunkValues, String>>,
    /// When its last packet arrived; `None` if just now.
    pub completed: Option<Instant>,
}

/// The library's counters since the stream began.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StreamStatistics {
    /// Complete frames.
    pub completed: u64,
    /// Incomplete frames.
    pub failed: u64,
    /// Packets without a free slot.
    pub packets_without_slot: u64,
    /// Packets whose resend was requested.
    pub resend_requests: u64,
    /// Packets that arrived after a resend request.
    pub resent_packets: u64,
}

/// A camera's stream and the slots in it.
#[derive(Debug)]
pub struct Stream {
    // Dropped before the slots: dropping the last reference ends the library's thread and frees its buffers.
    stream: Option<Object<ArvStream>>,
    lent: Vec<Lent>,
    aravis: Library,
    sizes: Sizes,
    chunks: Option<Chunks>,
    times: Arc<BufferTimes>,
    /// Unused memory for payloads.
    spare: Vec<Box<[u8]>>,
}

/// A slot that the library holds.
#[derive(Debug)]
struct Lent {
    buffer: NonNull<ArvBuffer>,
    slot: Slot,
    /// Memory for the payload, if it does not go into the slot.
    payload: Option<Box<[u8]>>,
}

/// The sizes of each frame.
#[derive(Debug, Clone, Copy)]
pub struct Sizes {
    /// Image size, bytes.
    pub image_bytes: usize,
    /// Image and chunk data, bytes.
    pub payload_bytes: usize,
}

// SAFETY: buffers are accessed through their addresses only here, and the library's queues lock themselves.
unsafe impl Send for Stream {}

impl Stream {
    /// Creates the stream of a camera whose settings are final: packet size, socket, receiving thread.
    ///
    /// `packet_size_bytes` is that of a GigE Vision camera; `None` for the largest that fits. `chunks` reads the chunk
    /// data if the camera sends any.
    ///
    /// # Errors
    ///
    /// The library's message, or that the camera keeps another packet size.
    pub fn new(
        device: &Device,
        packet_size_bytes: Option<u32>,
        sizes: Sizes,
        chunks: Option<Chunks>,
    ) -> Result<Self, String> {
        let aravis = device.aravis;
        let packet_bytes = match device.is_gige() {
            true => Some(prepare_link(device, packet_size_bytes)?),
            false => None,
        };
        let camera = device.camera.as_ptr();
        let times = Arc::new(BufferTimes::default());
        let data = Arc::into_raw(Arc::clone(&times)).cast_mut().cast();
        // SAFETY: an open camera; the callback may run on any thread, and its data lives until the library releases
        // it.
        let stream = checked(aravis, |error| unsafe {
            aravis.arv_camera_create_stream_full(camera, Some(on_stream), data, Some(release_times), error)
        })?;
        // SAFETY: the library made it for us.
        let stream = unsafe { Object::owned(aravis, stream) }.ok_or("the camera offers no stream")?;
        if let Some(packet_bytes) = packet_bytes {
            prepare_socket(device, &stream, sizes.payload_bytes, packet_bytes);
        }
        Ok(Self { stream: Some(stream), lent: Vec::new(), aravis, sizes, chunks, times, spare: Vec::new() })
    }

    /// Returns the stream for calls of the library; null after [`abandon`](Self::abandon).
    fn as_ptr(&self) -> *mut ArvStream {
        self.stream.as_ref().map_or(ptr::null_mut(), Object::as_ptr)
    }

    /// Lends a slot to the library until it comes out of [`pop`](Self::pop).
    ///
    /// # Panics
    ///
    /// If the slot is smaller than a frame, or the library returns no buffer for it.
    pub fn push(&mut self, slot: Slot) {
        let Sizes { image_bytes, payload_bytes } = self.sizes;
        assert!(slot.len() >= image_bytes, "slot of {} bytes for {image_bytes}", slot.len());
        let mut payload =
            self.chunks.is_some().then(|| self.spare.pop().unwrap_or_else(|| vec![0; payload_bytes].into()));
        let memory = payload.as_mut().map_or(slot.as_ptr(), |payload| payload.as_mut_ptr());
        // A new buffer each time: a used one would carry its old frame id into an incomplete frame.
        // SAFETY: the memory is exclusively ours and kept in `lent` for as long as the library has the buffer.
        let buffer = unsafe { self.aravis.arv_buffer_new_full(payload_bytes, memory.cast(), ptr::null_mut(), None) };
        // The library ends the process itself where memory is short. A slot that is skipped would never come back.
        let Some(buffer) = NonNull::new(buffer) else { panic!("the library returned no buffer for a slot") };
        self.lent.push(Lent { buffer, slot, payload });
        // SAFETY: the stream takes over the reference.
        unsafe { self.aravis.arv_stream_push_buffer(self.as_ptr(), buffer.as_ptr()) };
    }

    /// Waits at most `timeout` for a buffer, complete or not, to come out; `None` if there is none.
    ///
    /// If the payload went to memory of the stream, a valid image is copied into the slot.
    pub fn pop(&mut self, timeout: Duration) -> Option<ReceivedBuffer> {
        let timeout_us = u64::try_from(timeout.as_micros()).unwrap_or(u64::MAX);
        // SAFETY: a live stream; the reference to the returned buffer is ours.
        let buffer = NonNull::new(unsafe { self.aravis.arv_stream_timeout_pop_buffer(self.as_ptr(), timeout_us) })?;
        let completed = self.times.take();
        let index = self.lent.iter().position(|lent| lent.buffer == buffer)?;
        let Lent { slot, payload, .. } = self.lent.swap_remove(index);
        let mut received = ReceivedBuffer { completed, ..self.read_header(buffer.as_ptr(), slot) };
        if let Some(payload) = payload {
            self.unpack(buffer.as_ptr(), &mut received, &payload);
            self.spare.push(payload);
        }
        // SAFETY: popping gave us the reference; the memory stays with the slot or is spare.
        unsafe { self.aravis.g_object_unref(buffer.as_ptr().cast()) };
        Some(received)
    }

    /// Reads the chunks of a complete frame, and copies its image into the slot if they are consistent.
    ///
    /// An incomplete frame stays without chunk values.
    fn unpack(&self, buffer: *mut ArvBuffer, received: &mut ReceivedBuffer, payload: &[u8]) {
        let Some(chunks) = self.chunks.as_ref().filter(|_| received.status == sys::ARV_BUFFER_STATUS_SUCCESS) else {
            return;
        };
        let payload = &payload[..received.received_bytes.min(payload.len())];
        let image_bytes = self.sizes.image_bytes;
        // SAFETY: a filled buffer out of the stream, which nobody else accesses.
        let values = unsafe { chunks.read(buffer, payload, image_bytes, received.device_ns) };
        if values.is_ok() {
            received.slot.bytes_mut()[..image_bytes].copy_from_slice(&payload[..image_bytes]);
        }
        received.chunks = Some(values);
    }

    /// Reads status, times and image properties of a buffer, without its chunks and completion time.
    ///
    /// An incomplete frame gets 0 bytes received and no image properties.
    fn read_header(&self, buffer: *mut ArvBuffer, slot: Slot) -> ReceivedBuffer {
        let aravis = self.aravis;
        let mut received_bytes = 0;
        // SAFETY: a buffer out of the stream, which nobody else accesses.
        unsafe {
            let payload = aravis.arv_buffer_get_payload_type(buffer);
            let status = aravis.arv_buffer_get_status(buffer);
            let is_complete = status == sys::ARV_BUFFER_STATUS_SUCCESS;
            let has_image = matches!(
                payload,
                sys::ARV_BUFFER_PAYLOAD_TYPE_IMAGE | sys::ARV_BUFFER_PAYLOAD_TYPE_EXTENDED_CHUNK_DATA
            );
            if is_complete {
                aravis.arv_buffer_get_data(buffer, &raw mut received_bytes);
            }
            ReceivedBuffer {
                slot,
                status,
                payload,
                id: aravis.arv_buffer_get_frame_id(buffer),
                device_ns: aravis.arv_buffer_get_timestamp(buffer),
                arrival_ns: aravis.arv_buffer_get_system_timestamp(buffer),
                received_bytes,
                image: (is_complete && has_image).then(|| {
                    (
                        aravis.arv_buffer_get_image_width(buffer),
                        aravis.arv_buffer_get_image_height(buffer),
                        aravis.arv_buffer_get_image_pixel_format(buffer),
                    )
                }),
                chunks: None,
                completed: None,
            }
        }
    }

    /// Ends the stream of a camera that is gone, without waiting for it.
    ///
    /// On dropping a stream and its device, the library writes to the camera and waits seconds for the answers. The
    /// slots are free when this method returns, and a separate thread waits for the answers.
    pub fn abandon(&mut self) {
        let Some(stream) = self.stream.take() else { return };
        // SAFETY: a live stream. The first call joins the receiving thread and frees all buffers, so that
        // nobody writes to the slots any more. The second is needed because dropping a stream stops its thread.
        unsafe {
            self.aravis.arv_stream_stop_thread(stream.as_ptr(), 1);
            self.aravis.arv_stream_start_thread(stream.as_ptr());
        }
        self.lent.clear();
        std::thread::spawn(move || drop(stream));
    }

    /// Returns the library's counters.
    pub fn statistics(&self) -> StreamStatistics {
        let mut counts = StreamStatistics::default();
        // SAFETY: a live stream, integers of ours to write to, and terminated names.
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
        // Ours is the only reference, so this joins the receiving thread and frees every buffer. Only then may
        // the slots be dropped.
        self.stream = None;
        self.lent.clear();
    }
}

/// Sets ordinary UDP sockets and the packet size, before the stream is created; returns the packet size, bytes.
///
/// `wanted_bytes` is the requested size, including the IP and UDP headers. The default (`None`) is the largest that the
/// route, the camera and [`MAX_PACKET_BYTES`] allow.
///
/// # Errors
///
/// The library's message, or the reason, if the camera does not keep the requested packet size.
fn prepare_link(device: &Device, wanted_bytes: Option<u32>) -> Result<u32, String> {
    let aravis = device.aravis;
    // The library prefers raw packet sockets if it has the capability. They receive nothing on a loopback device that
    // answers from another address, and the packet filter does not cover them. SAFETY: an open GigE Vision camera and a
    // constant of the library.
    unsafe {
        aravis
            .arv_camera_gv_set_stream_options(device.camera.as_ptr(), sys::ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
    }
    let bytes = match wanted_bytes {
        Some(bytes) => bytes,
        None => {
            let mtu =
                ipv4_address(device, aravis.arv_gv_device_get_device_address).and_then(socket::mtu_to).unwrap_or(1500);
            let range =
                device.integer_range("GevSCPSPacketSize").unwrap_or(IntegerRange { min: 0, max: i64::MAX, step: 1 });
            let max = i64::from(mtu.min(MAX_PACKET_BYTES)).min(range.max);
            u32::try_from(max - max.rem_euclid(range.step.max(1).cast_signed())).unwrap_or(1500)
        }
    };
    let size = i32::try_from(bytes).map_err(|_| format!("packets of {bytes} bytes are too large"))?;
    // SAFETY: an open GigE Vision camera.
    checked(aravis, |error| unsafe { aravis.arv_camera_gv_set_packet_size(device.camera.as_ptr(), size, error) })?;
    let kept = device.call(aravis.arv_camera_gv_get_packet_size)?;
    if kept != bytes && wanted_bytes.is_some() {
        return Err(format!("packets of {bytes} bytes: the camera keeps {kept}"));
    }
    log::info!("packet size: {kept} bytes");
    Ok(kept)
}

/// Returns an IPv4 address of a GigE Vision device through a getter of the library; `None` if it has none.
///
/// The getter selects the device's own address, or that of the network interface that reaches it.
fn ipv4_address(
    device: &Device,
    getter: unsafe extern "C" fn(*mut sys::ArvGvDevice) -> *mut sys::GSocketAddress,
) -> Option<Ipv4Addr> {
    let aravis = device.aravis;
    // SAFETY: an open GigE Vision device; addresses are borrowed from it, the string is ours to free.
    unsafe {
        let address = getter(device.as_ptr().cast());
        let address = aravis.g_inet_socket_address_get_address(address.cast());
        let string = aravis.g_inet_address_to_string(address);
        let address = text(string);
        super::handle::free(aravis, string);
        address?.parse().ok()
    }
}

/// Attaches the packet filter to the stream's socket and enlarges its buffer before the first packet arrives.
///
/// `payload_bytes` is the size of a frame, `packet_bytes` that of a packet with IP and UDP headers. The library would
/// size the buffer after the first packet, and smaller. Failures are logged, since frames can be received without
/// either.
fn prepare_socket(device: &Device, stream: &Object<ArvStream>, payload_bytes: usize, packet_bytes: u32) {
    let aravis = device.aravis;
    // FIXED without a size: the library leaves the socket as we set it.
    set_int_property(aravis, stream, "socket-buffer", sys::ARV_GV_STREAM_SOCKET_BUFFER_FIXED.cast_signed());
    let wanted = (payload_bytes * SOCKET_FRAMES).clamp(MIN_SOCKET_BYTES, MAX_SOCKET_BYTES);
    // SAFETY: a live GigE Vision stream.
    let port = unsafe { aravis.arv_gv_stream_get_port(stream.as_ptr().cast()) };
    let socket = match socket::find_udp(ipv4_address(device, aravis.arv_gv_device_get_interface_address), port) {
        Ok(socket) => socket,
        Err(error) => return log::warn!("cannot find the stream's socket to enlarge it, frames may be lost: {error}"),
    };
    if let Some(camera) = ipv4_address(device, aravis.arv_gv_device_get_device_address) {
        let payload_bytes = u32::try_from(payload_bytes).unwrap_or(u32::MAX);
        if let Err(error) = (StreamShape { camera, payload_bytes, packet_bytes }).attach(&socket) {
            log::warn!("cannot filter the stream's packets, any computer may send some: {error}");
        }
    }
    match socket::set_receive_buffer(&socket, wanted) {
        Ok(bytes) if bytes < wanted => log::warn!(
            "the stream's socket buffer holds {bytes} bytes instead of {wanted}, frames may be lost; \
                         raise the limit by sysctl net.core.rmem_max={wanted}"
        ),
        Ok(bytes) => log::info!("socket buffer of the stream: {bytes} bytes"),
        Err(error) => log::warn!("cannot enlarge the stream's socket buffer, frames may be lost: {error}"),
    }
}

/// Sets an integer or enumeration property of a stream through GObject.
fn set_int_property(aravis: Library, stream: &Object<ArvStream>, name: &str, value: i32) {
    /// `G_TYPE_INT`: fundamental type 6, shifted by 2.
    const INT: sys::GType = 6 << 2;
    let Ok(name) = c_text(name) else { return };
    // SAFETY: a zeroed GValue is unset; it is initialised as an int, which enumerations accept, and unset again.
    unsafe {
        let mut holder: sys::GValue = std::mem::zeroed();
        aravis.g_value_init(&raw mut holder, INT);
        aravis.g_value_set_int(&raw mut holder, value);
        aravis.g_object_set_property(stream.as_ptr().cast(), name.as_ptr(), &raw const holder);
        aravis.g_value_unset(&raw mut holder);
    }
}

/// Records when buffers are completed, and gives the receiving thread its priority when it starts.
///
/// The library calls it on that thread; `data` is the stream's [`BufferTimes`].
unsafe extern "C" fn on_stream(data: gpointer, kind: ArvStreamCallbackType, _buffer: *mut ArvBuffer) {
    static WARNED: Once = Once::new();
    if kind == sys::ARV_STREAM_CALLBACK_TYPE_BUFFER_DONE {
        // SAFETY: the data of the stream, until `release_times`.
        unsafe { &*data.cast::<BufferTimes>() }.add();
    }
    if kind != sys::ARV_STREAM_CALLBACK_TYPE_INIT {
        return;
    }
    if let Err(error) = realtime_priority::raise(realtime_priority::RECEIVING) {
        WARNED.call_once(|| log::warn!("the receiving thread has no real-time priority: {error}"));
    }
}

/// Releases the library's reference to the times. The library calls it once it no longer calls `on_stream`.
unsafe extern "C" fn release_times(data: gpointer) {
    // SAFETY: from `Arc::into_raw`, released once.
    drop(unsafe { Arc::from_raw(data.cast::<BufferTimes>().cast_const()) });
}

/// Returns the reason why a buffer holds no complete frame.
pub fn failure_reason(status: sys::ArvBufferStatus) -> &'static str {
    match status {
        sys::ARV_BUFFER_STATUS_TIMEOUT => "packets still missing at the timeout",
        sys::ARV_BUFFER_STATUS_MISSING_PACKETS => "packets missing",
        sys::ARV_BUFFER_STATUS_WRONG_PACKET_ID => "a packet with a wrong number",
        sys::ARV_BUFFER_STATUS_SIZE_MISMATCH => "more data than a frame holds",
        sys::ARV_BUFFER_STATUS_ABORTED => "aborted by the end of the stream",
        _ => "not filled",
    }
}
