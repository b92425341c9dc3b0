//! Claims, which give each role of a rig to one process at a time.

use super::BusError;
use std::io::ErrorKind;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener};
use std::time::Duration;

const PAUSE: Duration = Duration::from_millis(10);

/// A role that is taken until this is dropped or the process ends, however it ends.
///
/// It is an address in the system's table of local sockets. That needs no file, so nothing remains of a process that was
/// killed. Nobody ever connects to it.
#[derive(Debug)]
pub(super) struct Claim {
    _address: UnixListener,
}

impl Claim {
    /// Takes a role. Waits at most `patience` for the process that has it.
    pub(super) fn take(rig: &str, role: &str, patience: Duration) -> Result<Self, BusError> {
        let fail = |error: std::io::Error| BusError::new("take the role", &format!("ricochet/{rig}/{role}"), error);
        let address = SocketAddr::from_abstract_name(format!("ricochet/{rig}/{role}")).map_err(fail)?;
        let tries = patience.as_millis() / PAUSE.as_millis();
        for _ in 0..tries {
            match UnixListener::bind_addr(&address) {
                Err(error) if error.kind() == ErrorKind::AddrInUse => std::thread::sleep(PAUSE),
                answer => return answer.map(|listener| Self { _address: listener }).map_err(fail),
            }
        }
        match UnixListener::bind_addr(&address) {
            Err(error) if error.kind() == ErrorKind::AddrInUse => {
                Err(BusError::Taken { rig: rig.to_owned(), role: role.to_owned() })
            }
            answer => answer.map(|listener| Self { _address: listener }).map_err(fail),
        }
    }
}

/// Whether any process of this rig has a role.
pub(super) fn any(rig: &str) -> bool {
    let name = format!(" @ricochet/{rig}/");
    // Without the table nothing is known, so the rig counts as alive.
    std::fs::read_to_string("/proc/net/unix").map_or(true, |table| table.contains(&name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_role_is_taken_once_and_free_again_when_it_is_given_up() {
        let rig = format!("claim-{}", std::process::id());
        let first = Claim::take(&rig, "track", Duration::ZERO).unwrap();
        let refused = Claim::take(&rig, "track", Duration::from_millis(30)).unwrap_err();
        assert!(matches!(refused, BusError::Taken { .. }), "{refused}");
        Claim::take(&rig, "record", Duration::ZERO).unwrap();
        assert!(any(&rig));
        drop(first);
        Claim::take(&rig, "track", Duration::ZERO).unwrap();
        assert!(!any(&rig));
    }
}
