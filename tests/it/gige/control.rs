//! The control side of the camera (GigE Vision, GVCP): registers, control privilege, requests to resend.

use super::packets::{Packet, UNAVAILABLE, Wire};
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::time::{Duration, Instant};

/// Bootstrap registers.
pub const URL: usize = 0x200;
pub const CAPABILITY: u32 = 0x934;
pub const HEARTBEAT: u32 = 0x938;
pub const PRIVILEGE: u32 = 0xa00;
pub const STREAM_PORT: u32 = 0xd00;
pub const PACKET_SIZE: u32 = 0xd04;
pub const STREAM_ADDRESS: u32 = 0xd18;

/// Registers of this camera, as in `camera.xml`.
pub const WIDTH: u32 = 0xe000;
pub const HEIGHT: u32 = 0xe004;
pub const FORMAT: u32 = 0xe008;
pub const ACQUISITION: u32 = 0xe00c;
pub const CHUNK_MODE: u32 = 0xe010;
pub const CHUNK_FRAME_ID: u32 = 0xe018;
pub const CHUNK_STAMP: u32 = 0xe01c;
pub const EXTENDED_IDS: u32 = 0xe030;
/// The address of the description.
pub const DESCRIPTION: usize = 0x1_0000;

/// Commands. The code of an acknowledge is the next number.
const DISCOVER: u16 = 0x02;
const RESEND: u16 = 0x40;
const READ_REGISTERS: u16 = 0x80;
const WRITE_REGISTERS: u16 = 0x82;
const READ_MEMORY: u16 = 0x84;
const WRITE_MEMORY: u16 = 0x86;
const PENDING: u16 = 0x89;
const KEY: u8 = 0x42;

/// Reasons to refuse a command.
const NOT_IMPLEMENTED: u8 = 0x01;
const INVALID_PARAMETER: u8 = 0x02;
const INVALID_ADDRESS: u8 = 0x03;
const ACCESS_DENIED: u8 = 0x06;

/// The camera's response to a request to resend packets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resend {
    /// Sends them.
    Answer,
    /// Reports that the packets are no longer available.
    Refuse,
    /// Does not answer.
    Silence,
}

/// Changes an answer before it is sent.
pub type Disguise = Box<dyn FnMut(&mut Vec<u8>) + Send>;

/// The camera's registers and behaviour.
pub struct Control {
    pub memory: Vec<u8>,
    pub resend: Resend,
    /// Frames sent, kept to be sent again.
    pub sent: BTreeMap<u64, Vec<Packet>>,
    /// The number of packets requested again.
    pub asked: u64,
    /// The time announced by a pending acknowledge before each write is answered, ms.
    pub put_off_ms: Option<u16>,
    pub disguise: Option<Disguise>,
    owner: Option<SocketAddr>,
    heard: Instant,
}

/// The answer to a command.
#[derive(Debug, Default)]
pub struct Reply {
    /// On the control channel.
    pub answers: Vec<Vec<u8>>,
    /// On the stream.
    pub packets: Vec<Packet>,
}

fn word(bytes: &[u8]) -> u32 {
    u32::from_be_bytes(bytes[..4].try_into().unwrap())
}

impl Control {
    pub fn new(memory: Vec<u8>) -> Self {
        let (sent, asked, put_off_ms, disguise) = (BTreeMap::new(), 0, None, None);
        Self { memory, resend: Resend::Answer, sent, asked, put_off_ms, disguise, owner: None, heard: Instant::now() }
    }

    pub fn register(&self, address: u32) -> u32 {
        word(&self.memory[address as usize..])
    }

    pub fn set(&mut self, address: u32, value: u32) {
        self.memory[address as usize..][..4].copy_from_slice(&value.to_be_bytes());
        if address == PRIVILEGE && value == 0 {
            self.owner = None;
        }
    }

    pub fn wire(&self) -> Wire {
        let packet_bytes = (self.register(PACKET_SIZE) & 0xffff) as usize;
        Wire { is_extended: self.register(EXTENDED_IDS) == 1, packet_bytes }
    }

    /// Takes control from a program whose heartbeat is overdue.
    pub fn check_heartbeat(&mut self) {
        let patience = Duration::from_millis(u64::from(self.register(HEARTBEAT)));
        if self.owner.is_some() && self.heard.elapsed() > patience {
            self.set(PRIVILEGE, 0);
            self.set(ACQUISITION, 0);
        }
    }

    /// Executes a command.
    pub fn execute(&mut self, request: &[u8], from: SocketAddr) -> Reply {
        if request.len() < 8 || request[0] != KEY {
            return Reply::default();
        }
        let half = |at: usize| u16::from_be_bytes([request[at], request[at + 1]]);
        let (command, size, number) = (half(2), usize::from(half(4)), half(6));
        let Some(body) = request.get(8..8 + size) else { return Reply::default() };
        if Some(from) == self.owner {
            self.heard = Instant::now();
        }
        if command == RESEND {
            return Reply { answers: Vec::new(), packets: self.send_again(body, request[1] & 0x10 != 0) };
        }
        let mut answers = Vec::new();
        if let Some(ms) = self.put_off_ms.filter(|_| command == WRITE_REGISTERS) {
            answers.push(acknowledge(PENDING, number, &[0, 0, (ms >> 8) as u8, ms as u8]));
        }
        let mut answer = match self.result(command, body, from) {
            Ok(body) => acknowledge(command + 1, number, &body),
            Err(reason) => [vec![0x80, reason], acknowledge(command + 1, number, &[])[2..].to_vec()].concat(),
        };
        if let Some(disguise) = &mut self.disguise {
            disguise(&mut answer);
        }
        answers.push(answer);
        Reply { answers, packets: Vec::new() }
    }

    fn result(&mut self, command: u16, body: &[u8], from: SocketAddr) -> Result<Vec<u8>, u8> {
        match command {
            DISCOVER => Ok(self.memory[..0xf8].to_vec()),
            READ_REGISTERS => {
                let values = body.chunks_exact(4).map(|address| self.part(word(address) as usize, 4));
                Ok(values.collect::<Result<Vec<_>, _>>()?.concat())
            }
            WRITE_REGISTERS => {
                for pair in body.chunks_exact(8) {
                    self.write(word(pair), &pair[4..], from)?;
                }
                Ok(vec![0, 0, 0, (body.len() / 8) as u8])
            }
            READ_MEMORY if body.len() == 8 => {
                let data = self.part(word(body) as usize, word(&body[4..]) as usize & 0xffff)?;
                Ok([&body[..4], data].concat())
            }
            WRITE_MEMORY if body.len() > 4 => {
                self.write(word(body), &body[4..], from)?;
                Ok(vec![0, 0, 0, 1])
            }
            READ_MEMORY | WRITE_MEMORY => Err(INVALID_PARAMETER),
            _ => Err(NOT_IMPLEMENTED),
        }
    }

    fn part(&self, address: usize, bytes: usize) -> Result<&[u8], u8> {
        self.memory.get(address..address + bytes).ok_or(INVALID_ADDRESS)
    }

    fn write(&mut self, address: u32, data: &[u8], from: SocketAddr) -> Result<(), u8> {
        self.part(address as usize, data.len())?;
        if self.owner.is_some_and(|owner| owner != from) || (self.owner.is_none() && address != PRIVILEGE) {
            return Err(ACCESS_DENIED);
        }
        self.memory[address as usize..][..data.len()].copy_from_slice(data);
        if address == PRIVILEGE {
            (self.owner, self.heard) = (Some(from).filter(|_| word(data) != 0), Instant::now());
        }
        Ok(())
    }

    /// The requested packets of a frame, marked as sent again.
    fn send_again(&mut self, body: &[u8], is_extended: bool) -> Vec<Packet> {
        let mask = if is_extended { u32::MAX } else { 0x00ff_ffff };
        if body.len() < if is_extended { 20 } else { 12 } {
            return Vec::new();
        }
        let (first, last) = (word(&body[4..]) & mask, word(&body[8..]) & mask);
        let id = if is_extended {
            u64::from_be_bytes(body[12..20].try_into().unwrap())
        } else {
            u64::from(word(body) & 0xffff)
        };
        self.asked += u64::from(last.saturating_sub(first)) + 1;
        let wire = self.wire();
        let Some(sent) = self.sent.get(&id) else { return Vec::new() };
        let wanted = sent.iter().filter(|packet| (first..=last).contains(&wire.number(packet)));
        match self.resend {
            Resend::Answer => wanted.map(|packet| wire.again(packet)).collect(),
            Resend::Refuse => {
                wanted.map(|packet| wire.packet(UNAVAILABLE, id, packet[4] & 0x7f, wire.number(packet), &[])).collect()
            }
            Resend::Silence => Vec::new(),
        }
    }
}

fn acknowledge(command: u16, number: u16, body: &[u8]) -> Vec<u8> {
    let mut answer = vec![0, 0];
    for half in [command, body.len() as u16, number] {
        answer.extend(half.to_be_bytes());
    }
    answer.extend(body);
    answer
}
