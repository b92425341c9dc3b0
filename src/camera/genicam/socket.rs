//! The UDP socket of a stream: its descriptor, its receive buffer and its packet size.

use rustix::net::{SocketType, getsockname, sockopt};
use std::fs;
use std::io;
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd, RawFd};

/// Finds this process's UDP socket on a local port, and returns a duplicate of its descriptor.
///
/// With a local address, only a socket bound to it counts. Aravis does not expose the descriptor of its stream.
///
/// # Errors
///
/// If no such socket is open.
pub fn find_udp(address: Option<Ipv4Addr>, port: u16) -> io::Result<OwnedFd> {
    for entry in fs::read_dir("/proc/self/fd")? {
        let name = entry?.file_name();
        let Some(descriptor) = name.to_str().and_then(|name| name.parse::<RawFd>().ok()) else { continue };
        // SAFETY: the descriptor was just listed as open. Should another thread close it meanwhile, the calls below
        // fail or examine a descriptor that took its number; they change nothing.
        let socket = unsafe { BorrowedFd::borrow_raw(descriptor) };
        let is_udp = sockopt::socket_type(socket) == Ok(SocketType::DGRAM);
        let is_bound =
            |local: SocketAddrV4| local.port() == port && address.is_none_or(|address| address == *local.ip());
        // Only the socket found is duplicated: closing a duplicate of a file would release its locks.
        if is_udp && getsockname(socket).is_ok_and(|local| local.try_into().is_ok_and(is_bound)) {
            return socket.try_clone_to_owned();
        }
    }
    Err(io::Error::new(io::ErrorKind::NotFound, format!("no UDP socket on port {port}")))
}

/// Requests a receive buffer of `wanted_bytes` for a socket, and returns the size granted, bytes.
///
/// Aravis sizes its socket only after the first packet, too late for the rest of that frame.
///
/// # Errors
///
/// If the kernel refuses.
pub fn set_receive_buffer(socket: impl AsFd, wanted_bytes: usize) -> io::Result<usize> {
    // The first call needs a capability and has no limit; the second is limited by net.core.rmem_max.
    if sockopt::set_socket_recv_buffer_size_force(&socket, wanted_bytes).is_err() {
        sockopt::set_socket_recv_buffer_size(&socket, wanted_bytes)?;
    }
    // The kernel doubles the size for its own book-keeping and returns that.
    Ok(sockopt::socket_recv_buffer_size(&socket)? / 2)
}

/// Returns the maximum packet size (MTU) of the route to an address, bytes; `None` if there is no route.
pub fn mtu_to(address: Ipv4Addr) -> Option<u32> {
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).ok()?;
    // Connecting a UDP socket sends nothing, so the port does not matter.
    socket.connect((address, 9)).ok()?;
    sockopt::ip_mtu(&socket).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_socket_of_ours_is_found_by_its_address_and_grows() {
        let socket = UdpSocket::bind("127.0.0.7:0").unwrap();
        let port = socket.local_addr().unwrap().port();
        let found = find_udp(Some(Ipv4Addr::new(127, 0, 0, 7)), port).unwrap();
        let small = set_receive_buffer(&found, 20_000).unwrap();
        let large = set_receive_buffer(&found, 150_000).unwrap();
        assert!(small >= 20_000 && large >= 150_000 && large > small, "{small}, {large}");
        assert_eq!(sockopt::socket_recv_buffer_size(&socket).unwrap() / 2, large, "it is the same socket");
    }

    #[test]
    fn a_port_nobody_has_at_this_address_is_reported() {
        let socket = UdpSocket::bind("127.0.0.7:0").unwrap();
        let port = socket.local_addr().unwrap().port();
        let other = find_udp(Some(Ipv4Addr::new(127, 0, 0, 6)), port);
        assert_eq!(other.unwrap_err().kind(), io::ErrorKind::NotFound);
        drop(socket);
    }

    #[test]
    fn the_route_over_the_loopback_device_has_an_mtu() {
        assert!(mtu_to(Ipv4Addr::LOCALHOST).unwrap() >= 1500);
    }
}
