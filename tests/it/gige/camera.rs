//! The camera: it answers on its own loopback address and sends the packets that a test asks for.

use super::control::{
    ACQUISITION, CAPABILITY, CHUNK_FRAME_ID, CHUNK_MODE, CHUNK_STAMP, Control, DESCRIPTION, FORMAT, HEARTBEAT, HEIGHT,
    PACKET_SIZE, STREAM_ADDRESS, STREAM_PORT, URL, WIDTH,
};
use super::packets::{IMAGE, IMAGE_WITH_CHUNKS, Packet, Picture, Wire};
use crate::fake_gige::aravis_or_leave_out;
use crate::support::camera_settings;
use ricochet::config;
use ricochet::image::PixelFormat;
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::sync::atomic::{AtomicBool, AtomicU16, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

pub const WIDTH_PX: u32 = 128;
pub const HEIGHT_PX: u32 = 64;
pub const FRAME_BYTES: usize = (WIDTH_PX * HEIGHT_PX) as usize;
/// 16 packets of payload per frame, with block ids of both lengths.
pub const PACKET_BYTES: u32 = 564;
/// The delay of the stamp in the chunks against that in the header.
pub const CHUNK_LATER_NS: u64 = 250;

const GVCP_PORT: u16 = 3956;
const CHUNK_IDS: [u32; 3] = [1, 0xa5a5_0001, 0xa5a5_0002];

/// A running camera, unplugged when dropped.
pub struct Gige {
    address: Ipv4Addr,
    control: Arc<Mutex<Control>>,
    stream: UdpSocket,
    is_gone: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Gige {
    /// Plugs in a camera, or returns `None` if Aravis is not installed.
    pub fn plug_in() -> Option<Self> {
        Self::described_by(include_bytes!("camera.xml"))
    }

    /// Plugs in a camera with this description.
    pub fn described_by(description: &[u8]) -> Option<Self> {
        aravis_or_leave_out()?;
        let socket = free_place();
        let address = *place(&socket).ip();
        let stream = UdpSocket::bind((address, 0)).unwrap();
        let control = Arc::new(Mutex::new(Control::new(registers(address, description))));
        let is_gone = Arc::new(AtomicBool::new(false));
        let thread = {
            let (control, is_gone) = (Arc::clone(&control), Arc::clone(&is_gone));
            let stream = stream.try_clone().unwrap();
            std::thread::spawn(move || listen(&socket, &stream, &control, &is_gone))
        };
        Some(Self { address, control, stream, is_gone, thread: Some(thread) })
    }

    /// The value for `id`.
    pub fn id(&self) -> String {
        self.address.to_string()
    }

    /// The address on which it receives commands.
    pub fn port(&self) -> SocketAddrV4 {
        SocketAddrV4::new(self.address, GVCP_PORT)
    }

    /// Settings that it accepts.
    pub fn settings(&self) -> config::Camera {
        config::Camera {
            id: Some(self.id()),
            width_px: Some(WIDTH_PX),
            height_px: Some(HEIGHT_PX),
            pixel_format: Some(PixelFormat::Mono8),
            packet_size_bytes: Some(PACKET_BYTES),
            ..camera_settings()
        }
    }

    /// Its registers and its behaviour.
    pub fn control(&self) -> MutexGuard<'_, Control> {
        self.control.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The present format of its packets.
    pub fn wire(&self) -> Wire {
        self.control().wire()
    }

    /// Bytes of the pixels of one frame.
    pub fn picture_bytes(&self) -> usize {
        let control = self.control();
        let [width, height, format] = [WIDTH, HEIGHT, FORMAT].map(|register| control.register(register) as usize);
        width * height * (format >> 16 & 0xff) / 8
    }

    /// Frame `index` with the present settings, under this block id.
    pub fn picture(&self, id: u64, index: u64) -> Picture {
        let mut payload = vec![0; self.picture_bytes()];
        let control = self.control();
        let (width, height, format) = (control.register(WIDTH), control.register(HEIGHT), control.register(FORMAT));
        crate::genicam::draw(index, &mut payload);
        let mut kind = IMAGE;
        if control.register(CHUNK_MODE) == 1 {
            kind = IMAGE_WITH_CHUNKS;
            let tag = |payload: &mut Vec<u8>, id: u32, bytes: usize| {
                payload.extend(id.to_be_bytes());
                payload.extend((bytes as u32).to_be_bytes());
            };
            let bytes = payload.len();
            tag(&mut payload, CHUNK_IDS[0], bytes);
            for (register, id, value) in
                [(CHUNK_FRAME_ID, CHUNK_IDS[1], index), (CHUNK_STAMP, CHUNK_IDS[2], stamp_ns(index) + CHUNK_LATER_NS)]
            {
                if control.register(register) == 1 {
                    payload.extend(value.to_be_bytes());
                    tag(&mut payload, id, 8);
                }
            }
        }
        Picture { id, stamp_ns: stamp_ns(index), kind, format, width, height, payload }
    }

    /// Cuts a frame into packets, which are kept to be sent again.
    pub fn cut(&self, picture: &Picture) -> Vec<Packet> {
        const REMEMBERED: usize = 64;
        let mut control = self.control();
        let packets = control.wire().cut(picture);
        control.sent.insert(picture.id, packets.clone());
        if control.sent.len() > REMEMBERED {
            control.sent.pop_first();
        }
        packets
    }

    /// The packets of frame `index` under this block id.
    pub fn frame(&self, id: u64, index: u64) -> Vec<Packet> {
        self.cut(&self.picture(id, index))
    }

    /// Whether acquisition was started.
    pub fn is_started(&self) -> bool {
        self.control().register(ACQUISITION) == 1
    }

    /// Sends packets on the stream and waits for the time of one frame.
    pub fn send<'a>(&self, packets: impl IntoIterator<Item = &'a Packet>) {
        self.send_from(&self.stream, packets);
        std::thread::sleep(Duration::from_micros(500));
    }

    /// Sends packets to the receiver of the stream from another socket.
    pub fn send_from<'a>(&self, socket: &UdpSocket, packets: impl IntoIterator<Item = &'a Packet>) {
        let control = self.control();
        let to = Ipv4Addr::from_bits(control.register(STREAM_ADDRESS));
        let port = (control.register(STREAM_PORT) & 0xffff) as u16;
        drop(control);
        for packet in packets {
            socket.send_to(packet, (to, port)).unwrap();
        }
    }
}

impl Drop for Gige {
    fn drop(&mut self) {
        self.is_gone.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The camera's clock at this frame: 1 ms per frame, from a minute after power-up.
pub fn stamp_ns(index: u64) -> u64 {
    60_000_000_000 + index * 1_000_000
}

fn place(socket: &UdpSocket) -> SocketAddrV4 {
    match socket.local_addr().unwrap() {
        std::net::SocketAddr::V4(place) => place,
        other => panic!("{other}"),
    }
}

/// A socket on the camera's port of an unused loopback address.
fn free_place() -> UdpSocket {
    static NEXT: AtomicU16 = AtomicU16::new(1);
    // Test processes that run at the same time start at different addresses.
    let process = std::process::id() % 223;
    for _ in 0..2000 {
        let [high, low] = NEXT.fetch_add(1, Ordering::Relaxed).to_be_bytes();
        let address = Ipv4Addr::new(127, 1 + process as u8, high, low);
        if let Ok(socket) = UdpSocket::bind((address, GVCP_PORT)) {
            return socket;
        }
    }
    panic!("no free loopback address");
}

fn listen(socket: &UdpSocket, stream: &UdpSocket, control: &Mutex<Control>, is_gone: &AtomicBool) {
    socket.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
    let mut request = [0; 2048];
    while !is_gone.load(Ordering::Acquire) {
        let heard = socket.recv_from(&mut request);
        let mut control = control.lock().unwrap_or_else(PoisonError::into_inner);
        control.check_heartbeat();
        let Ok((size, from)) = heard else { continue };
        let reply = control.execute(&request[..size], from);
        let to = Ipv4Addr::from_bits(control.register(STREAM_ADDRESS));
        let port = (control.register(STREAM_PORT) & 0xffff) as u16;
        drop(control);
        for answer in &reply.answers {
            let _ = socket.send_to(answer, from);
        }
        for packet in &reply.packets {
            let _ = stream.send_to(packet, (to, port));
        }
    }
}

/// The camera's memory at power-up.
fn registers(address: Ipv4Addr, description: &[u8]) -> Vec<u8> {
    let mut memory = vec![0; DESCRIPTION];
    let mut text = |at: usize, text: &str| memory[at..][..text.len()].copy_from_slice(text.as_bytes());
    text(0x48, "Ricochet");
    text(0x68, "Liar");
    text(0xd8, "L1");
    text(URL, &format!("Local:camera.xml;{DESCRIPTION:x};{:x}", description.len()));
    memory.extend(description);
    // Memory is read in 4-byte words.
    memory.extend([0; 3]);
    let mut control = Control::new(memory);
    for (register, value) in [
        (0x0, 2 << 16),
        // Big-endian, UTF-8.
        (0x4, 0x8000_0001),
        (0x24, address.to_bits()),
        (0x600, 1),
        (0x904, 1),
        // Memory writes, packet resend and pending acknowledge are supported.
        (CAPABILITY, 0x26),
        (HEARTBEAT, 3000),
        // 1 GHz.
        (0x940, 1_000_000_000),
        (PACKET_SIZE, 1500),
        (WIDTH, 64),
        (HEIGHT, 64),
        (FORMAT, PixelFormat::Mono8 as u32),
    ] {
        control.set(register, value);
    }
    control.memory
}
