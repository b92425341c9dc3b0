//! Packets of a stream (GigE Vision, GVSP), as a camera makes them.

/// One packet, beginning with its status.
pub type Packet = Vec<u8>;

/// Content types of a packet.
pub const LEADER: u8 = 1;
pub const TRAILER: u8 = 2;
pub const PAYLOAD: u8 = 3;

/// Payload types of a leader.
pub const IMAGE: u16 = 0x0001;
pub const IMAGE_WITH_CHUNKS: u16 = 0x4001;

/// The status of a packet that was sent again, and of one that is no longer available.
pub const RESENT: u16 = 0x0100;
pub const UNAVAILABLE: u16 = 0x800c;

/// Headers of IP and UDP, which count in the size of a packet.
const NETWORK_BYTES: usize = 28;

/// A frame to be cut into packets.
#[derive(Debug, Clone)]
pub struct Picture {
    pub id: u64,
    pub stamp_ns: u64,
    pub kind: u16,
    pub format: u32,
    pub width: u32,
    pub height: u32,
    pub payload: Vec<u8>,
}

/// The format of packets.
#[derive(Debug, Clone, Copy)]
pub struct Wire {
    /// Whether block ids have 64 bits.
    pub is_extended: bool,
    /// The size of a packet with all headers.
    pub packet_bytes: usize,
}

impl Wire {
    /// A packet with this header and content.
    pub fn packet(self, status: u16, id: u64, content: u8, number: u32, data: &[u8]) -> Packet {
        let mut packet = status.to_be_bytes().to_vec();
        if self.is_extended {
            packet.extend([0, 0]);
            packet.extend((u32::from(content | 0x80) << 24).to_be_bytes());
            packet.extend(id.to_be_bytes());
            packet.extend(number.to_be_bytes());
        } else {
            packet.extend((id as u16).to_be_bytes());
            packet.extend((u32::from(content) << 24 | number).to_be_bytes());
        }
        packet.extend(data);
        packet
    }

    /// The size of a header.
    pub fn header_bytes(self) -> usize {
        if self.is_extended { 20 } else { 8 }
    }

    /// The payload of each packet but the last, bytes.
    pub fn room(self) -> usize {
        self.packet_bytes - NETWORK_BYTES - self.header_bytes()
    }

    /// Cuts an image into leader, payload and trailer.
    pub fn cut(self, picture: &Picture) -> Vec<Packet> {
        let mut leader = [0_u16.to_be_bytes(), picture.kind.to_be_bytes()].concat();
        leader.extend(picture.stamp_ns.to_be_bytes());
        for word in [picture.format, picture.width, picture.height, 0, 0, 0] {
            leader.extend(word.to_be_bytes());
        }
        let mut trailer = [0_u16.to_be_bytes(), picture.kind.to_be_bytes()].concat();
        trailer.extend(picture.height.to_be_bytes());
        let mut packets = vec![self.packet(0, picture.id, LEADER, 0, &leader)];
        for data in picture.payload.chunks(self.room()) {
            packets.push(self.packet(0, picture.id, PAYLOAD, packets.len() as u32, data));
        }
        packets.push(self.packet(0, picture.id, TRAILER, packets.len() as u32, &trailer));
        packets
    }

    /// The number of a packet in its frame.
    pub fn number(self, packet: &[u8]) -> u32 {
        if self.is_extended {
            u32::from_be_bytes(packet[16..20].try_into().unwrap())
        } else {
            u32::from_be_bytes(packet[4..8].try_into().unwrap()) & 0x00ff_ffff
        }
    }

    /// The same packet, marked as sent again.
    pub fn again(self, packet: &[u8]) -> Packet {
        let mut packet = packet.to_vec();
        packet[..2].copy_from_slice(&RESENT.to_be_bytes());
        packet
    }
}
