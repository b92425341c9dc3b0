//! Network interfaces of cameras.

use super::Finding;
use super::host::Host;

/// The file with the maximum receive buffer of a socket, bytes.
const RECEIVE_BUFFER: &str = "/proc/sys/net/core/rmem_max";
/// The number of bytes that a camera of 10 Gbit/s sends while the receiver sleeps for 20 ms.
const RECEIVE_BYTES: u64 = 25_000_000;
/// The folder of the network interfaces.
const INTERFACES: &str = "/sys/class/net";
/// Packets of this size, bytes, need a seventh of the interrupts of the usual 1500.
const JUMBO_BYTES: u64 = 9000;
/// The type of Ethernet interfaces in the kernel.
const ETHERNET: u64 = 1;

/// Examines the receive buffer and the packet sizes.
pub(super) fn examine(host: &Host) -> Vec<Finding> {
    examine_receive_buffer(host).into_iter().chain(examine_packets(host)).collect()
}

/// Examines the maximum receive buffer of a socket; `None` where the kernel does not state it.
fn examine_receive_buffer(host: &Host) -> Option<Finding> {
    let bytes = host.number(RECEIVE_BUFFER)?;
    let found = format!("at most {bytes} bytes");
    Some(match bytes {
        bytes if bytes >= RECEIVE_BYTES => Finding::good("receive buffer", found),
        _ => {
            let found = format!("{found}; a 10 Gbit/s camera fills {RECEIVE_BYTES} in 20 ms");
            Finding::advice("receive buffer", found, host.write_command(RECEIVE_BUFFER, &RECEIVE_BYTES.to_string()))
        }
    })
}

/// Examines the packet sizes of the Ethernet interfaces that are up; `None` without any.
fn examine_packets(host: &Host) -> Option<Finding> {
    let mut sizes: Vec<(String, u64)> = Vec::new();
    for name in host.names(INTERFACES) {
        let of = |file: &str| format!("{INTERFACES}/{name}/{file}");
        let is_up = host.read(&of("operstate")).is_some_and(|state| state == "up");
        let is_bridge = host.path(&of("bridge")).exists();
        if is_up && !is_bridge && host.number(&of("type")) == Some(ETHERNET) {
            sizes.extend(host.number(&of("mtu")).map(|bytes| (name.clone(), bytes)));
        }
    }
    let small: Vec<&(String, u64)> = sizes.iter().filter(|(_, bytes)| *bytes < JUMBO_BYTES).collect();
    let shown = |sizes: &mut dyn Iterator<Item = &(String, u64)>| {
        sizes.map(|(name, bytes)| format!("{name} {bytes}")).collect::<Vec<_>>().join(", ")
    };
    Some(match small.first() {
        None if sizes.is_empty() => return None,
        None => Finding::good("packets", shown(&mut sizes.iter())),
        Some(_) => {
            let found =
                format!("{}; a GigE camera's interface should have {JUMBO_BYTES}", shown(&mut small.iter().copied()));
            let fixes: Vec<String> =
                small.iter().map(|(name, _)| format!("ip link set dev {name} mtu {JUMBO_BYTES}")).collect();
            Finding::advice("packets", found, fixes.join("; "))
        }
    })
}
