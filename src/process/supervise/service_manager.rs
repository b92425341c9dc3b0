//! Notices to the service manager, as `sd_notify(3)` defines them: ready, alive, status, stopping.

use crate::process::clock::PeriodicTimer;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::time::Duration;

/// The variable with the address of the service manager.
pub(super) const ADDRESS: &str = "NOTIFY_SOCKET";
/// Interval of the notices.
const PERIOD: Duration = Duration::from_secs(1);

/// The connection to the service manager; without one, nothing is sent.
#[derive(Debug)]
pub(super) struct ServiceManager {
    socket: Option<(UnixDatagram, SocketAddr)>,
    timer: PeriodicTimer,
    is_ready: bool,
}

impl ServiceManager {
    /// Connects to the service manager that started this program, if one did.
    pub(super) fn connect() -> Self {
        Self::connect_to(std::env::var(ADDRESS).ok().as_deref())
    }

    /// Connects to the service manager at this address: the path of a socket, or `@` and an abstract name.
    fn connect_to(address: Option<&str>) -> Self {
        let address = address.and_then(|address| match address.strip_prefix('@') {
            Some(name) => SocketAddr::from_abstract_name(name).ok(),
            None => SocketAddr::from_pathname(address).ok(),
        });
        // A manager that does not read must not stop the rig.
        let unblocked = |socket: UnixDatagram| socket.set_nonblocking(true).map(|()| socket).ok();
        let socket = UnixDatagram::unbound().ok().and_then(unblocked).zip(address);
        Self { socket, timer: PeriodicTimer::new(PERIOD), is_ready: false }
    }

    /// Reports once per second that this program is alive, with its state in words, and once that it is ready.
    pub(super) fn report(&mut self, is_ready: bool, status: impl FnOnce() -> String) {
        if self.socket.is_none() || !self.timer.restart_if_due() {
            return;
        }
        let ready = if is_ready && !std::mem::replace(&mut self.is_ready, is_ready) { "READY=1\n" } else { "" };
        self.send(&format!("{ready}WATCHDOG=1\nSTATUS={}\n", status()));
    }

    /// Reports that the rig stops.
    pub(super) fn report_stopping(&self) {
        self.send("STOPPING=1\n");
    }

    /// Sends a notice, lines of `KEY=VALUE`. Errors are ignored.
    fn send(&self, notice: &str) {
        if let Some((socket, address)) = &self.socket {
            let _ = socket.send_to_addr(notice.as_bytes(), address);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_service_manager_hears_of_start_life_and_stop() {
        let path = std::env::temp_dir().join(format!("ricochet-notify-{}", std::process::id()));
        let manager = UnixDatagram::bind(&path).unwrap();
        let mut service = ServiceManager::connect_to(path.to_str());
        let heard = || {
            let mut bytes = [0; 200];
            let length = manager.recv(&mut bytes).unwrap();
            String::from_utf8_lossy(&bytes[..length]).into_owned()
        };
        service.report(false, || "preparing".into());
        assert_eq!(heard(), "WATCHDOG=1\nSTATUS=preparing\n");
        service.timer = PeriodicTimer::new(Duration::ZERO);
        service.report(true, || "500 frames per second".into());
        assert_eq!(heard(), "READY=1\nWATCHDOG=1\nSTATUS=500 frames per second\n");
        service.report(true, || "500 frames per second".into());
        assert_eq!(heard(), "WATCHDOG=1\nSTATUS=500 frames per second\n");
        service.report_stopping();
        assert_eq!(heard(), "STOPPING=1\n");
        std::fs::remove_file(&path).unwrap();
        ServiceManager::connect_to(None).report_stopping();
    }
}
