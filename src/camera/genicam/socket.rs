//! The socket that a stream arrives on: found, and large enough before the first packet.

use std::fs;
use std::io;
use std::mem;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::os::fd::RawFd;

/// Our own UDP socket bound to this port, at this address if one is given.
///
/// Aravis keeps the descriptor of its stream to itself; but it is one of ours.
///
/// # Errors
///
/// When no such socket is open.
pub fn find_udp(address: Option<Ipv4Addr>, port: u16) -> io::Result<RawFd> {
    for entry in fs::read_dir("/proc/self/fd")? {
        let name = entry?.file_name();
        let Some(descriptor) = name.to_str().and_then(|name| name.parse::<RawFd>().ok()) else { continue };
        let is_udp = option(descriptor, libc::SO_TYPE).is_ok_and(|kind| kind == libc::SOCK_DGRAM);
        let is_bound =
            |place: SocketAddrV4| place.port() == port && address.is_none_or(|address| address == *place.ip());
        if is_udp && local_address(descriptor).is_some_and(is_bound) {
            return Ok(descriptor);
        }
    }
    Err(io::Error::new(io::ErrorKind::NotFound, format!("no UDP socket on port {port}")))
}

/// Grows the receive buffer of a socket to hold `wanted_bytes`; answers with what it holds.
///
/// Aravis sizes its socket only when the first packet has come, too late for the
/// rest of that frame.
///
/// # Errors
///
/// When the system refuses.
pub fn grow_receive_buffer(descriptor: RawFd, wanted_bytes: usize) -> io::Result<usize> {
    let size = i32::try_from(wanted_bytes).unwrap_or(i32::MAX);
    // The first needs a capability and knows no bound; the second is cut to net.core.rmem_max.
    if set_option(descriptor, libc::SO_RCVBUFFORCE, size).is_err() {
        set_option(descriptor, libc::SO_RCVBUF, size)?;
    }
    // The kernel doubles the number for its own book-keeping and answers with that.
    Ok(usize::try_from(option(descriptor, libc::SO_RCVBUF)?).unwrap_or(0) / 2)
}

fn local_address(descriptor: RawFd) -> Option<SocketAddrV4> {
    // SAFETY: all zeroes is a valid sockaddr_in.
    let mut address: libc::sockaddr_in = unsafe { mem::zeroed() };
    let mut size = mem::size_of::<libc::sockaddr_in>() as libc::socklen_t;
    // SAFETY: address and size are ours; longer addresses are cut to the size.
    let result = unsafe { libc::getsockname(descriptor, (&raw mut address).cast(), &raw mut size) };
    let is_ipv4 = libc::c_int::from(address.sin_family) == libc::AF_INET;
    let place = SocketAddrV4::new(u32::from_be(address.sin_addr.s_addr).into(), u16::from_be(address.sin_port));
    (result == 0 && is_ipv4).then_some(place)
}

fn option(descriptor: RawFd, name: libc::c_int) -> io::Result<libc::c_int> {
    let mut value: libc::c_int = 0;
    let mut size = mem::size_of::<libc::c_int>() as libc::socklen_t;
    // SAFETY: value and size are ours to write to.
    let result =
        unsafe { libc::getsockopt(descriptor, libc::SOL_SOCKET, name, (&raw mut value).cast(), &raw mut size) };
    if result == 0 { Ok(value) } else { Err(io::Error::last_os_error()) }
}

fn set_option(descriptor: RawFd, name: libc::c_int, value: libc::c_int) -> io::Result<()> {
    let size = mem::size_of::<libc::c_int>() as libc::socklen_t;
    // SAFETY: value lives through the call.
    let result = unsafe { libc::setsockopt(descriptor, libc::SOL_SOCKET, name, (&raw const value).cast(), size) };
    if result == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

/// Largest packet of the network card that has this address, bytes.
pub fn mtu_of(address: Ipv4Addr) -> Option<u32> {
    let mut list: *mut libc::ifaddrs = std::ptr::null_mut();
    // SAFETY: the list is ours to write to.
    if unsafe { libc::getifaddrs(&raw mut list) } != 0 {
        return None;
    }
    let mut found = None;
    let mut entry = list;
    while !entry.is_null() && found.is_none() {
        // SAFETY: entries of the list are valid until it is freed; addresses of the family AF_INET are sockaddr_in.
        unsafe {
            let socket_address = (*entry).ifa_addr;
            if !socket_address.is_null() && libc::c_int::from((*socket_address).sa_family) == libc::AF_INET {
                let ipv4 = socket_address.cast::<libc::sockaddr_in>().read_unaligned();
                if Ipv4Addr::from(u32::from_be(ipv4.sin_addr.s_addr)) == address {
                    found = super::handle::text((*entry).ifa_name);
                }
            }
            entry = (*entry).ifa_next;
        }
    }
    // SAFETY: getifaddrs made the list, and nothing of it is kept.
    unsafe { libc::freeifaddrs(list) };
    fs::read_to_string(format!("/sys/class/net/{}/mtu", found?)).ok()?.trim().parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::UdpSocket;
    use std::os::fd::AsRawFd;

    #[test]
    fn a_socket_of_ours_is_found_by_its_place_and_grows() {
        let socket = UdpSocket::bind("127.0.0.7:0").unwrap();
        let port = socket.local_addr().unwrap().port();
        let descriptor = find_udp(Some(Ipv4Addr::new(127, 0, 0, 7)), port).unwrap();
        assert_eq!(descriptor, socket.as_raw_fd());
        let small = grow_receive_buffer(descriptor, 20_000).unwrap();
        let large = grow_receive_buffer(descriptor, 150_000).unwrap();
        assert!(small >= 20_000 && large >= 150_000 && large > small, "{small}, {large}");
    }

    #[test]
    fn a_port_nobody_has_at_this_address_is_said() {
        let socket = UdpSocket::bind("127.0.0.7:0").unwrap();
        let port = socket.local_addr().unwrap().port();
        let other = find_udp(Some(Ipv4Addr::new(127, 0, 0, 6)), port);
        assert_eq!(other.unwrap_err().kind(), io::ErrorKind::NotFound);
        drop(socket);
    }

    #[test]
    fn the_loopback_device_has_an_mtu() {
        assert!(mtu_of(Ipv4Addr::LOCALHOST).unwrap() >= 1500);
        assert_eq!(mtu_of(Ipv4Addr::new(203, 0, 113, 1)), None);
    }
}
