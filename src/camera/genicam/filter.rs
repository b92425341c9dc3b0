//! What may reach the library's receiving thread: a filter in the kernel, on the stream's socket.
//!
//! Aravis 0.8 trusts what a packet says of itself: one shorter than its header makes it copy past every end, and a
//! packet number beyond the frame writes there. Any computer in the network can send such a packet to the socket. So
//! the kernel drops what is not from the camera, too short, too long, or numbered beyond the frame, and every kind of
//! content that is not an image.
//!
//! Packets as in GigE Vision: 8 bytes of header with ids of 16 bits, 20 with ids of 64 bits, then the content.

use std::io;
use std::net::Ipv4Addr;
use std::os::fd::RawFd;

/// What the frames of one stream look like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// The camera.
    pub camera: Ipv4Addr,
    /// Most bytes of one frame.
    pub payload_bytes: u32,
    /// Bytes of one packet, headers of IP and UDP included.
    pub packet_bytes: u32,
}

/// Headers of IP and UDP.
const NETWORK_BYTES: u32 = 28;
/// The filter sees a packet from its UDP header on.
const UDP_BYTES: u32 = 8;
/// Headers of the stream protocol with ids of 16 and of 64 bits.
const HEADERS_BYTES: [u32; 2] = [8, 20];
/// Contents after the header: the beginning of every leader, and the whole of an image's.
const LEADER_BYTES: u32 = 12;
const IMAGE_LEADER_BYTES: u32 = 36;

/// Contents of a packet.
const LEADER: u32 = 1;
const TRAILER: u32 = 2;
const PAYLOAD: u32 = 3;
/// Payloads of a leader: two with the picture's size in them, one with a list of parts that is read without bounds.
const IMAGE: u32 = 1;
const EXTENDED_CHUNKS: u32 = 5;
const MULTIPART: u32 = 10;

/// Operations of the kernel's packet filter (Linux, `Documentation/networking/filter.rst`).
mod operation {
    pub const LOAD_WORD: u16 = 0x20;
    pub const LOAD_HALF: u16 = 0x28;
    pub const LOAD_BYTE: u16 = 0x30;
    pub const LOAD_LENGTH: u16 = 0x80;
    pub const AND: u16 = 0x54;
    pub const EQUAL: u16 = 0x15;
    pub const ABOVE: u16 = 0x25;
    pub const AT_LEAST: u16 = 0x35;
    pub const ANY_BIT: u16 = 0x45;
    pub const RETURN: u16 = 0x06;
    /// Address of the IP header, whatever the filter begins with.
    pub const NETWORK: u32 = 0xfff0_0000;
}
use operation::{ABOVE, AND, ANY_BIT, AT_LEAST, EQUAL, LOAD_BYTE, LOAD_HALF, LOAD_LENGTH, LOAD_WORD, NETWORK, RETURN};

/// Where a test goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Then {
    Next,
    Over(u8),
    Take,
    Drop,
}

#[derive(Debug, Clone, Copy)]
struct Step {
    operation: u16,
    value: u32,
    yes: Then,
    no: Then,
}

fn act(operation: u16, value: u32) -> Step {
    Step { operation, value, yes: Then::Next, no: Then::Next }
}

fn test(operation: u16, value: u32, yes: Then, no: Then) -> Step {
    Step { operation, value, yes, no }
}

impl Shape {
    /// Packets of a frame, leader and trailer included, with headers of this many bytes.
    fn packets(&self, header_bytes: u32) -> u32 {
        let room = self.packet_bytes.saturating_sub(NETWORK_BYTES + header_bytes).max(1);
        self.payload_bytes.div_ceil(room) + 2
    }

    fn steps(&self) -> Vec<Step> {
        let [short, long] = HEADERS_BYTES;
        let short_steps = self.steps_with_header(short);
        let over = u8::try_from(short_steps.len()).unwrap_or(u8::MAX);
        let mut steps = vec![
            act(LOAD_WORD, NETWORK + 12),
            test(EQUAL, self.camera.to_bits(), Then::Next, Then::Drop),
            act(LOAD_LENGTH, 0),
            test(AT_LEAST, UDP_BYTES + short, Then::Next, Then::Drop),
            // The highest bit of the content's byte tells how long the ids are.
            act(LOAD_BYTE, UDP_BYTES + 4),
            test(ANY_BIT, 0x80, Then::Over(over), Then::Next),
        ];
        steps.extend(short_steps);
        steps.extend(self.steps_with_header(long));
        steps
    }

    fn steps_with_header(&self, header_bytes: u32) -> Vec<Step> {
        use Then::{Drop, Next, Over, Take};
        let is_long = header_bytes == HEADERS_BYTES[1];
        let last = self.packets(header_bytes) - 1;
        let content = UDP_BYTES + header_bytes;
        let most = UDP_BYTES + self.packet_bytes.saturating_sub(NETWORK_BYTES);
        // The number of a packet: the lower 24 bits after the content's byte, or 32 bits at the header's end.
        let number = |mut steps: Vec<Step>| {
            steps.push(act(LOAD_WORD, if is_long { content - 4 } else { UDP_BYTES + 4 }));
            if !is_long {
                steps.push(act(AND, 0x00ff_ffff));
            }
            steps
        };
        let mut leader = number(Vec::new());
        leader.push(test(EQUAL, 0, Next, Drop));
        if is_long {
            // Here a leader may tell how many parts it lists.
            leader.extend([act(LOAD_WORD, UDP_BYTES + 4), act(AND, 0x00ff_ffff), test(EQUAL, 0, Next, Drop)]);
        }
        leader.extend([
            act(LOAD_HALF, UDP_BYTES),
            test(ANY_BIT, 0x8000, Take, Next),
            act(LOAD_LENGTH, 0),
            test(AT_LEAST, content + LEADER_BYTES, Next, Drop),
            act(LOAD_HALF, content + 2),
            act(AND, 0x3fff),
            test(EQUAL, MULTIPART, Drop, Next),
            test(EQUAL, IMAGE, Over(1), Next),
            test(EQUAL, EXTENDED_CHUNKS, Next, Take),
            act(LOAD_LENGTH, 0),
            test(AT_LEAST, content + IMAGE_LEADER_BYTES, Take, Drop),
        ]);
        let mut trailer = number(Vec::new());
        trailer.extend([test(AT_LEAST, 2, Next, Drop), test(ABOVE, last, Drop, Take)]);
        let mut payload = number(Vec::new());
        payload.extend([
            test(EQUAL, 0, Drop, Next),
            test(ABOVE, last - 1, Drop, Next),
            act(LOAD_HALF, UDP_BYTES),
            test(ANY_BIT, 0x8000, Take, Next),
            act(LOAD_LENGTH, 0),
            test(ABOVE, content, Next, Drop),
            test(ABOVE, most, Drop, Take),
        ]);
        let over = |steps: usize| Over(u8::try_from(steps).unwrap_or(u8::MAX));
        let mut steps = vec![
            act(LOAD_LENGTH, 0),
            test(AT_LEAST, content, Next, Drop),
            act(LOAD_BYTE, UDP_BYTES + 4),
            act(AND, 0x7f),
            test(EQUAL, LEADER, over(2), Next),
            test(EQUAL, TRAILER, over(1 + leader.len()), Next),
            test(EQUAL, PAYLOAD, over(leader.len() + trailer.len()), Drop),
        ];
        steps.extend(leader);
        steps.extend(trailer);
        steps.extend(payload);
        steps
    }

    /// The steps as the kernel wants them, with the two ends behind them.
    fn program(&self) -> Vec<libc::sock_filter> {
        let steps = self.steps();
        let count = steps.len();
        let place = |from: usize, then: Then| {
            let over = match then {
                Then::Next => 0,
                Then::Over(steps) => usize::from(steps),
                Then::Take => count - from - 1,
                Then::Drop => count - from,
            };
            // Both halves together have less than 100 steps.
            u8::try_from(over).unwrap_or(u8::MAX)
        };
        let code = |(from, step): (usize, &Step)| libc::sock_filter {
            code: step.operation,
            jt: place(from, step.yes),
            jf: place(from, step.no),
            k: step.value,
        };
        let end = |bytes| libc::sock_filter { code: RETURN, jt: 0, jf: 0, k: bytes };
        let mut program: Vec<_> = steps.iter().enumerate().map(code).collect();
        program.extend([end(u32::MAX), end(0)]);
        program
    }

    /// Puts the filter on a UDP socket.
    ///
    /// # Errors
    ///
    /// When the system refuses it.
    pub fn guard(&self, descriptor: RawFd) -> io::Result<()> {
        let mut program = self.program();
        let length = u16::try_from(program.len()).map_err(|_| io::Error::from(io::ErrorKind::InvalidInput))?;
        let filter = libc::sock_fprog { len: length, filter: program.as_mut_ptr() };
        let size = size_of::<libc::sock_fprog>() as libc::socklen_t;
        // SAFETY: the kernel copies the program, which lives through the call and is as long as it says.
        let result = unsafe {
            libc::setsockopt(descriptor, libc::SOL_SOCKET, libc::SO_ATTACH_FILTER, (&raw const filter).cast(), size)
        };
        if result == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
    }
}

#[cfg(test)]
#[path = "filter/tests.rs"]
mod tests;
