use super::*;
use std::net::UdpSocket;
use std::time::Duration;

const PAYLOAD_BYTES: u32 = 1000;
/// 200 bytes of content with short ids, 188 with long ones.
const PACKET_BYTES: u32 = 28 + 8 + 200;

/// Returns a filtered socket, and one that the camera sends from.
fn socket_pair() -> (UdpSocket, UdpSocket) {
    let receiver = UdpSocket::bind("127.0.0.1:0").unwrap();
    receiver.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    let shape =
        StreamShape { camera: Ipv4Addr::new(127, 0, 0, 9), payload_bytes: PAYLOAD_BYTES, packet_bytes: PACKET_BYTES };
    shape.attach(&receiver).unwrap();
    (receiver, UdpSocket::bind("127.0.0.9:0").unwrap())
}

/// Returns a packet that the filter accepts, to mark the end of the packets before it.
fn mark() -> Vec<u8> {
    let mut mark = short(0, 1, 0, &[0; 36]);
    mark[8 + 3] = 1;
    mark
}

/// Returns a packet with 16-bit ids: status, content type, packet number, and the content behind the header.
fn short(status: u16, content: u8, packet_number: u32, data: &[u8]) -> Vec<u8> {
    let mut packet = [status.to_be_bytes(), 7_u16.to_be_bytes()].concat();
    packet.extend((u32::from(content) << 24 | packet_number).to_be_bytes());
    packet.extend(data);
    packet
}

/// Returns a packet with 64-bit ids: status, content type, packet number, and the content behind the header.
fn long(status: u16, content: u8, packet_number: u32, data: &[u8]) -> Vec<u8> {
    let mut packet = [status.to_be_bytes(), [0, 0]].concat();
    packet.extend((u32::from(content | 0x80) << 24).to_be_bytes());
    packet.extend(7_u64.to_be_bytes());
    packet.extend(packet_number.to_be_bytes());
    packet.extend(data);
    packet
}

/// Returns the content of a leader with this payload type, padded with zeros to `bytes`.
fn leader(payload_type: u16, bytes: usize) -> Vec<u8> {
    let mut leader = vec![0; bytes];
    leader[2..4].copy_from_slice(&payload_type.to_be_bytes());
    leader
}

/// Returns for each packet whether it passes the filter.
fn through(packets: &[Vec<u8>]) -> Vec<bool> {
    let (receiver, camera) = socket_pair();
    let to = receiver.local_addr().unwrap();
    let mut buffer = [0; 2048];
    let came = |packet: &Vec<u8>| {
        camera.send_to(packet, to).unwrap();
        camera.send_to(&mark(), to).unwrap();
        let size = receiver.recv(&mut buffer).unwrap();
        let is_through = buffer[..size] == packet[..];
        if is_through {
            receiver.recv(&mut buffer).unwrap();
        }
        assert_eq!(buffer[..mark().len()], mark()[..]);
        is_through
    };
    packets.iter().map(came).collect()
}

#[test]
fn every_packet_of_a_frame_comes_through_with_ids_of_both_lengths() {
    let mut packets = vec![short(0, 1, 0, &leader(1, 36)), short(0, 2, 6, &[0; 8])];
    packets.extend((1..=5).map(|number| short(0, 3, number, &[1; 200])));
    packets.extend([long(0, 1, 0, &leader(0x4001, 36)), long(0, 2, 7, &[0; 8]), long(0, 3, 6, &[1; 60])]);
    packets.extend((1..=5).map(|number| long(0, 3, number, &[1; 188])));
    // Sent again; refused to be sent again; a short last one; the leader of something else, which says so.
    packets.extend([short(0x100, 3, 2, &[1; 200]), short(0x800c, 3, 2, &[]), long(0x800c, 3, 2, &[])]);
    packets.extend([short(0, 3, 5, &[1; 1]), short(0, 1, 0, &leader(6, 36)), short(0, 1, 0, &leader(4, 12))]);
    let refused: Vec<_> = through(&packets).iter().enumerate().filter(|(_, came)| !**came).map(|(at, _)| at).collect();
    assert_eq!(refused, [0; 0]);
}

#[test]
fn packets_that_lie_about_themselves_are_dropped() {
    let whole = short(0, 3, 1, &[1; 200]);
    let mut packets: Vec<_> = (0..=8).map(|bytes| whole[..bytes].to_vec()).collect();
    let whole = long(0, 3, 1, &[1; 188]);
    packets.extend((9..=20).map(|bytes| whole[..bytes].to_vec()));
    packets.extend([
        short(0, 3, 1, &[1; 201]),
        long(0, 3, 1, &[1; 189]),
        short(0, 3, 0, &[1; 200]),
        short(0, 3, 6, &[1; 200]),
        short(0, 3, 0x00ff_ffff, &[1; 200]),
        long(0, 3, 0, &[1; 188]),
        long(0, 3, 7, &[1; 188]),
        long(0, 3, u32::MAX, &[1; 188]),
        short(0, 2, 7, &[0; 8]),
        short(0, 2, 0, &[0; 8]),
        long(0, 2, 8, &[0; 8]),
        long(0, 2, u32::MAX, &[0; 8]),
        short(0, 1, 1, &leader(1, 36)),
        short(0, 1, 0, &leader(1, 35)),
        short(0, 1, 0, &leader(4, 11)),
        short(0, 1, 0, &leader(10, 60)),
        long(0, 1, 0, &leader(5, 35)),
        short(0x800c, 3, 99, &[]),
    ]);
    packets.extend([0, 4, 5, 6, 7, 8, 0x7f].map(|content| short(0, content, 1, &[1; 200])));
    let mut parts = long(0, 1, 0, &leader(1, 36));
    parts[7] = 9;
    packets.push(parts);
    let let_in: Vec<_> = through(&packets).iter().enumerate().filter(|(_, came)| **came).map(|(at, _)| at).collect();
    assert_eq!(let_in, [0; 0]);
}

#[test]
fn packets_from_elsewhere_are_dropped() {
    let (receiver, camera) = socket_pair();
    let to = receiver.local_addr().unwrap();
    UdpSocket::bind("127.0.0.8:0").unwrap().send_to(&mark(), to).unwrap();
    let mut second = mark();
    second[2] = 9;
    camera.send_to(&second, to).unwrap();
    let mut buffer = [0; 2048];
    let size = receiver.recv(&mut buffer).unwrap();
    assert_eq!(buffer[..size], second[..]);
}
