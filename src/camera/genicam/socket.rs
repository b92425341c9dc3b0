//! The socket that a stream arrives on: large enough before the first packet.

use std::fs;
use std::io;
use std::mem;
use std::net::Ipv4Addr;
use std::os::fd::RawFd;

/// The receive buffer of our own UDP socket bound to `port`, grown to hold `wanted_bytes`.
///
/// Aravis sizes its socket only when the first packet has come, too late for the
/// rest of that frame, and keeps the descriptor to itself; but it is one of ours.
///
/// # Errors
///
/// When no such socket is open, or the system refuses.
pub fn grow_receive_buffer(port: u16, wanted_bytes: usize) -> io::Result<usize> {
    let descriptor = find_udp(port)?
        .ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, format!("no UDP socket on port {port}")))?;
    let size = i32::try_from(wanted_bytes).unwrap_or(i32::MAX);
    // The first needs a capability and knows no bound; the second is cut to net.core.rmem_max.
    if set_option(descriptor, libc::SO_RCVBUFFORCE, size).is_err() {
        set_option(descriptor, libc::SO_RCVBUF, size)?;
    }
    // The kernel doubles the number for its own book-keeping and answers with that.
    Ok(usize::try_from(option(descriptor, libc::SO_RCVBUF)?).unwrap_or(0) / 2)
}

fn find_udp(port: u16) -> io::Result<Option<RawFd>> {
    for entry in fs::read_dir("/proc/self/fd")? {
        let name = entry?.file_name();
        let Some(descriptor) = name.to_str().and_then(|name| name.parse::<RawFd>().ok()) else { continue };
        let is_udp = option(descriptor, libc::SO_TYPE).is_ok_and(|kind| kind == libc::SOCK_DGRAM);
        if is_udp && local_port(descriptor) == Some(port) {
            return Ok(Some(descriptor));
        }
    }
    Ok(None)
}

fn local_port(descriptor: RawFd) -> Option<u16> {
    // SAFETY: all zeroes is a valid sockaddr_in.
    let mut address: libc::sockaddr_in = unsafe { mem::zeroed() };
    let mut size = mem::size_of::<libc::sockaddr_in>() as libc::socklen_t;
    // SAFETY: address and size are ours; longer addresses are cut to the size.
    let result = unsafe { libc::getsockname(descriptor, (&raw mut address).cast(), &raw mut size) };
    let is_ipv4 = libc::c_int::from(address.sin_family) == libc::AF_INET;
    (result == 0 && is_ipv4).then(|| u16::from_be(address.sin_port))
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

    #[test]
    fn a_socket_of_ours_is_found_by_its_port_and_grows() {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let port = socket.local_addr().unwrap().port();
        let small = grow_receive_buffer(port, 20_000).unwrap();
        let large = grow_receive_buffer(port, 150_000).unwrap();
        assert!(small >= 20_000 && large >= 150_000 && large > small, "{small}, {large}");
    }

    #[test]
    fn a_port_nobody_has_is_said() {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let port = socket.local_addr().unwrap().port();
        drop(socket);
        assert_eq!(grow_receive_buffer(port, 1).unwrap_err().kind(), io::ErrorKind::NotFound);
    }

    #[test]
    fn the_loopback_device_has_an_mtu() {
        assert!(mtu_of(Ipv4Addr::LOCALHOST).unwrap() >= 1500);
        assert_eq!(mtu_of(Ipv4Addr::new(203, 0, 113, 1)), None);
    }
}
