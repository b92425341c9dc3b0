//! `ricochet status`: the state of a running rig.

use super::control::RigOptions;
use crate::bus::{Bus, BusError, TakenRole};
use crate::console::{Outcome, print_line, table};
use crate::failure::Failure;
use crate::message::{Role, StatusMessage};
use std::collections::BTreeMap;
use std::time::Duration;

/// Listening time; every process publishes its status five times per second.
const LISTEN: Duration = Duration::from_millis(600);
const PAUSE: Duration = Duration::from_millis(20);

/// Prints the latest status of every process of the rig.
///
/// # Errors
///
/// When no such rig runs.
pub fn run(options: &RigOptions) -> Result<Outcome, Failure> {
    let rig = &options.rig;
    let bus = Bus::join(rig, "status")?;
    let topic = bus.listen::<StatusMessage>()?;
    let mut newest: BTreeMap<(u32, u32), StatusMessage> = BTreeMap::new();
    for _ in 0..LISTEN.as_millis() / PAUSE.as_millis() {
        while let Some(status) = topic.take()? {
            newest.insert((status.role, status.index), status);
        }
        std::thread::sleep(PAUSE);
    }
    let silent: Vec<_> =
        bus.roles().into_iter().filter(|role| !newest.values().any(|status| is_of(status, role))).collect();
    if newest.is_empty() && silent.is_empty() {
        return Err(BusError::NoRig { rig: rig.clone(), service: format!("ricochet/{rig}/status") }.into());
    }
    if options.json {
        let all: Vec<_> = newest.values().map(as_json).collect();
        let silent: Vec<_> =
            silent.iter().map(|role| serde_json::json!({ "process": role.name, "pid": role.pid })).collect();
        print_line(&serde_json::json!({ "rig": rig, "processes": all, "silent": silent }).to_string());
    } else {
        let header =
            ["process", "pid", "frame", "rate/s", "taken", "given", "lost", "dropped", "queue", "latency", "restarts"];
        let mut rows = vec![header.map(str::to_owned).to_vec()];
        rows.extend(newest.values().map(as_row));
        rows.extend(silent.iter().map(|role| vec![format!("{} (no heartbeat)", role.name), role.pid.to_string()]));
        print_line(&table(&rows));
    }
    Ok(Outcome::Clean)
}

/// Whether a process that has this role sent the status.
fn is_of(status: &StatusMessage, role: &TakenRole) -> bool {
    let is_role = Role::from_number(status.role).is_some_and(|found| role.name.starts_with(found.as_str()));
    is_role && (status.pid == role.pid || role.pid == 0)
}

fn name(status: &StatusMessage) -> String {
    match Role::from_number(status.role) {
        Some(Role::Correlate) => format!("correlate {}", status.index),
        Some(Role::Record) if status.state & 2 != 0 => "record (disk full)".into(),
        Some(Role::Record) if status.state & 1 != 0 => "record (armed)".into(),
        Some(role) => role.as_str().into(),
        None => "?".into(),
    }
}

fn as_row(status: &StatusMessage) -> Vec<String> {
    let latency = if status.latency_s > 0.0 { format!("{:.1} ms", 1e3 * status.latency_s) } else { "-".into() };
    vec![
        name(status),
        status.pid.to_string(),
        status.sequence.to_string(),
        format!("{:.0}", status.rate_hz),
        status.taken.to_string(),
        status.given.to_string(),
        status.lost.to_string(),
        status.dropped.to_string(),
        format!("{}/{}", status.waiting, status.capacity),
        latency,
        status.restarts.to_string(),
    ]
}

fn as_json(status: &StatusMessage) -> serde_json::Value {
    serde_json::json!({
        "process": Role::from_number(status.role).map_or("?", Role::as_str),
        "index": status.index, "pid": status.pid, "state": status.state, "run_id": status.run_id,
        "sequence": status.sequence, "stamp_ns": status.stamp_ns, "rate_hz": status.rate_hz, "taken": status.taken,
        "given": status.given, "lost": status.lost, "dropped": status.dropped, "waiting": status.waiting,
        "capacity": status.capacity, "latency_s": status.latency_s, "restarts": status.restarts,
    })
}
