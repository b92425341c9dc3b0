//! Velocities as UDP datagrams of a fixed layout, for controllers.
//!
//! A datagram is sent and forgotten, so that a receiver that is absent, stalled or slow costs nothing.

use super::outlets::Outlets;
use crate::failure::{ExitCode, Fatal};
use crate::message::{VelocityDatagram, VelocityMessage};
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::sync::Arc;

/// The address for datagrams cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("cannot send datagrams to {address}: {reason}; set [serve] udp to another address, or to \"off\"")]
pub(super) struct DatagramAddressError {
    address: SocketAddr,
    reason: std::io::Error,
}

impl Fatal for DatagramAddressError {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Usage
    }
}

/// The sender of the datagrams.
#[derive(Debug)]
pub(super) struct Datagrams {
    socket: UdpSocket,
    address: SocketAddr,
    /// The number of the next datagram.
    number: u64,
    outlets: Arc<Outlets>,
}

impl Datagrams {
    /// Opens a socket for datagrams to this address, which may be a broadcast address or a multicast group.
    ///
    /// # Errors
    ///
    /// [`DatagramAddressError`] if the system has no such socket.
    pub(super) fn open(address: SocketAddr, outlets: Arc<Outlets>) -> Result<Self, DatagramAddressError> {
        let open = || {
            let any = match address {
                SocketAddr::V4(_) => SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0)),
                SocketAddr::V6(_) => SocketAddr::from((Ipv6Addr::UNSPECIFIED, 0)),
            };
            // It is not connected, since a connected socket would refuse to send after the receiver was absent once.
            let socket = UdpSocket::bind(any)?;
            socket.set_nonblocking(true)?;
            if address.is_ipv4() {
                socket.set_broadcast(true)?;
            }
            Ok(socket)
        };
        match open() {
            Ok(socket) => Ok(Self { socket, address, number: 0, outlets }),
            Err(reason) => Err(DatagramAddressError { address, reason }),
        }
    }

    /// Sends a velocity. One that the system does not take is counted, and leaves a gap in the numbers.
    pub(super) fn send(&mut self, message: &VelocityMessage) {
        let datagram = VelocityDatagram::new(message, self.number);
        self.number += 1;
        match self.socket.send_to(&datagram.bytes(), self.address) {
            Ok(_) => self.outlets.add_datagram(),
            Err(error) => {
                if self.outlets.add_unsent() == 0 {
                    log::warn!("cannot send datagrams to {}: {error}; their number is in the status", self.address);
                }
            }
        }
    }
}
