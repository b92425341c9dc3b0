//! A packet filter in the kernel, on the stream's socket, that protects the library's receiving thread.
//!
//! Aravis 0.8 trusts the packet headers. A packet shorter than its header makes it copy past every end, and a packet
//! number beyond the frame makes it write there. Any computer in the network can send such a packet to the socket. So
//! the kernel drops packets that are not from the camera, too short, too long, or numbered beyond the frame, and all
//! content that is not an image.
//!
//! GigE Vision packets have 8 header bytes with 16-bit ids and 20 with 64-bit ids, followed by the content.

use std::io;
use std::net::Ipv4Addr;
use std::os::fd::AsRawFd;

/// The properties of a stream's packets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StreamShape {
    /// Address of the camera.
    pub camera: Ipv4Addr,
    /// Maximum payload of one frame, bytes.
    pub payload_bytes: u32,
    /// Size of one packet, bytes, including the IP and UDP headers.
    pub packet_bytes: u32,
}

/// IP and UDP headers.
const NETWORK_BYTES: u32 = 28;
/// The UDP header, where the filter's view of a packet begins.
const UDP_BYTES: u32 = 8;
/// Headers of the stream protocol with 16-bit and with 64-bit ids.
const HEADERS_BYTES: [u32; 2] = [8, 20];
/// Minimum content of every leader, and the content of an image leader.
const LEADER_BYTES: u32 = 12;
const IMAGE_LEADER_BYTES: u32 = 36;

/// Content types of a packet.
const LEADER: u32 = 1;
const TRAILER: u32 = 2;
const PAYLOAD: u32 = 3;
/// Payload types of a leader: two with the image size, and one with a list of parts that Aravis reads without bounds.
const IMAGE: u32 = 1;
const EXTENDED_CHUNKS: u32 = 5;
const MULTIPART: u32 = 10;

/// Operations of the kernel's packet filter (Linux, `Documentation/networking/filter.rst`).
mod operation {
    /// `BPF_LD | BPF_W | BPF_ABS`: loads the big-endian 32-bit word at an offset.
    pub const LOAD_WORD: u16 = 0x20;
    /// `BPF_LD | BPF_H | BPF_ABS`: loads 16 bits.
    pub const LOAD_HALF: u16 = 0x28;
    /// `BPF_LD | BPF_B | BPF_ABS`: loads 8 bits.
    pub const LOAD_BYTE: u16 = 0x30;
    /// `BPF_LD | BPF_LEN`: loads the length of the packet.
    pub const LOAD_LENGTH: u16 = 0x80;
    /// `BPF_ALU | BPF_AND`: masks the loaded value.
    pub const AND: u16 = 0x54;
    /// `BPF_JMP | BPF_JEQ`.
    pub const EQUAL: u16 = 0x15;
    /// `BPF_JMP | BPF_JGT`.
    pub const ABOVE: u16 = 0x25;
    /// `BPF_JMP | BPF_JGE`.
    pub const AT_LEAST: u16 = 0x35;
    /// `BPF_JMP | BPF_JSET`.
    pub const ANY_BIT: u16 = 0x45;
    /// `BPF_RET`: accepts as many bytes of the packet as its value.
    pub const RETURN: u16 = 0x06;
    /// `SKF_NET_OFF`: the offset of the IP header.
    pub const NETWORK: u32 = 0xfff0_0000;
}
use operation::{ABOVE, AND, ANY_BIT, AT_LEAST, EQUAL, LOAD_BYTE, LOAD_HALF, LOAD_LENGTH, LOAD_WORD, NETWORK, RETURN};

/// The jump target of a test.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Target {
    /// The next instruction.
    Next,
    /// The instruction after this many others.
    Skip(u8),
    /// The end of the program that accepts the packet.
    Accept,
    /// The end of the program that drops the packet.
    Drop,
}

/// One instruction, with jump targets that do not depend on its place in the program.
#[derive(Debug, Clone, Copy)]
struct Instruction {
    operation: u16,
    value: u32,
    if_true: Target,
    if_false: Target,
}

/// Returns an instruction that loads the value to be tested, or masks it, and goes on with the next one.
fn load(operation: u16, value: u32) -> Instruction {
    Instruction { operation, value, if_true: Target::Next, if_false: Target::Next }
}

/// Returns an instruction that compares the loaded value with `value` and jumps.
fn test(operation: u16, value: u32, if_true: Target, if_false: Target) -> Instruction {
    Instruction { operation, value, if_true, if_false }
}

impl StreamShape {
    /// Returns the number of packets of a frame, including leader and trailer, with stream headers of this size.
    fn packet_count(&self, header_bytes: u32) -> u32 {
        let room = self.packet_bytes.saturating_sub(NETWORK_BYTES + header_bytes).max(1);
        self.payload_bytes.div_ceil(room) + 2
    }

    /// Returns the program of the filter without its ends: the checks common to all packets, then those for short and
    /// those for long headers.
    fn instructions(&self) -> Vec<Instruction> {
        let [short, long] = HEADERS_BYTES;
        let short_instructions = self.instructions_with_header(short);
        let skip = u8::try_from(short_instructions.len()).unwrap_or(u8::MAX);
        let mut instructions = vec![
            load(LOAD_WORD, NETWORK + 12),
            test(EQUAL, self.camera.to_bits(), Target::Next, Target::Drop),
            load(LOAD_LENGTH, 0),
            test(AT_LEAST, UDP_BYTES + short, Target::Next, Target::Drop),
            // The highest bit of the content byte selects 64-bit ids.
            load(LOAD_BYTE, UDP_BYTES + 4),
            test(ANY_BIT, 0x80, Target::Skip(skip), Target::Next),
        ];
        instructions.extend(short_instructions);
        instructions.extend(self.instructions_with_header(long));
        instructions
    }

    /// Returns the checks of packets with headers of this size, one of [`HEADERS_BYTES`].
    ///
    /// Leader, trailer and payload each have their own checks of packet number and length; the leader's payload type is
    /// checked too. Packets that report an error skip the checks of their content, and other content is dropped.
    fn instructions_with_header(&self, header_bytes: u32) -> Vec<Instruction> {
        use Target::{Accept, Drop, Next, Skip};
        let is_long = header_bytes == HEADERS_BYTES[1];
        let last = self.packet_count(header_bytes) - 1;
        let content = UDP_BYTES + header_bytes;
        let max = UDP_BYTES + self.packet_bytes.saturating_sub(NETWORK_BYTES);
        // The packet number: the lower 24 bits after the content byte, or the last 32 bits of the header.
        let number = |mut instructions: Vec<Instruction>| {
            instructions.push(load(LOAD_WORD, if is_long { content - 4 } else { UDP_BYTES + 4 }));
            if !is_long {
                instructions.push(load(AND, 0x00ff_ffff));
            }
            instructions
        };
        let mut leader = number(Vec::new());
        leader.push(test(EQUAL, 0, Next, Drop));
        if is_long {
            // With long ids these bits give the number of parts; only 0 is accepted.
            leader.extend([load(LOAD_WORD, UDP_BYTES + 4), load(AND, 0x00ff_ffff), test(EQUAL, 0, Next, Drop)]);
        }
        leader.extend([
            load(LOAD_HALF, UDP_BYTES),
            test(ANY_BIT, 0x8000, Accept, Next),
            load(LOAD_LENGTH, 0),
            test(AT_LEAST, content + LEADER_BYTES, Next, Drop),
            load(LOAD_HALF, content + 2),
            load(AND, 0x3fff),
            test(EQUAL, MULTIPART, Drop, Next),
            test(EQUAL, IMAGE, Skip(1), Next),
            test(EQUAL, EXTENDED_CHUNKS, Next, Accept),
            load(LOAD_LENGTH, 0),
            test(AT_LEAST, content + IMAGE_LEADER_BYTES, Accept, Drop),
        ]);
        let mut trailer = number(Vec::new());
        trailer.extend([test(AT_LEAST, 2, Next, Drop), test(ABOVE, last, Drop, Accept)]);
        let mut payload = number(Vec::new());
        payload.extend([
            test(EQUAL, 0, Drop, Next),
            test(ABOVE, last - 1, Drop, Next),
            load(LOAD_HALF, UDP_BYTES),
            test(ANY_BIT, 0x8000, Accept, Next),
            load(LOAD_LENGTH, 0),
            test(ABOVE, content, Next, Drop),
            test(ABOVE, max, Drop, Accept),
        ]);
        let skip = |instructions: usize| Skip(u8::try_from(instructions).unwrap_or(u8::MAX));
        let mut instructions = vec![
            load(LOAD_LENGTH, 0),
            test(AT_LEAST, content, Next, Drop),
            load(LOAD_BYTE, UDP_BYTES + 4),
            load(AND, 0x7f),
            test(EQUAL, LEADER, skip(2), Next),
            test(EQUAL, TRAILER, skip(1 + leader.len()), Next),
            test(EQUAL, PAYLOAD, skip(leader.len() + trailer.len()), Drop),
        ];
        instructions.extend(leader);
        instructions.extend(trailer);
        instructions.extend(payload);
        instructions
    }

    /// Returns the program in the kernel's format, with the accept and drop instructions at the end.
    fn program(&self) -> Vec<libc::sock_filter> {
        let instructions = self.instructions();
        let count = instructions.len();
        let jump = |from: usize, target: Target| {
            let skip = match target {
                Target::Next => 0,
                Target::Skip(instructions) => usize::from(instructions),
                Target::Accept => count - from - 1,
                Target::Drop => count - from,
            };
            // Both halves together have fewer than 100 instructions.
            u8::try_from(skip).unwrap_or(u8::MAX)
        };
        let code = |(from, instruction): (usize, &Instruction)| libc::sock_filter {
            code: instruction.operation,
            jt: jump(from, instruction.if_true),
            jf: jump(from, instruction.if_false),
            k: instruction.value,
        };
        let end = |bytes| libc::sock_filter { code: RETURN, jt: 0, jf: 0, k: bytes };
        let mut program: Vec<_> = instructions.iter().enumerate().map(code).collect();
        program.extend([end(u32::MAX), end(0)]);
        program
    }

    /// Attaches the filter to a UDP socket.
    ///
    /// # Errors
    ///
    /// If the kernel refuses it.
    pub fn attach(&self, socket: &impl AsRawFd) -> io::Result<()> {
        let mut program = self.program();
        let length = u16::try_from(program.len()).map_err(|_| io::Error::from(io::ErrorKind::InvalidInput))?;
        let filter = libc::sock_fprog { len: length, filter: program.as_mut_ptr() };
        let size = size_of::<libc::sock_fprog>() as libc::socklen_t;
        // SAFETY: the kernel copies the program, which lives through the call and has the stated length.
        let result = unsafe {
            libc::setsockopt(
                socket.as_raw_fd(),
                libc::SOL_SOCKET,
                libc::SO_ATTACH_FILTER,
                (&raw const filter).cast(),
                size,
            )
        };
        if result == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
    }
}

#[cfg(test)]
#[path = "packet_filter/tests.rs"]
mod tests;
