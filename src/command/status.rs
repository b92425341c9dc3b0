//! `ricochet status`: the state of a running rig.

use crate::bus::{Bus, BusError, TakenRole};
use crate::console::{Outcome, UsageError, print_line, table};
use crate::failure::Failure;
use crate::message::{Role, StatusMessage};
use std::collections::BTreeMap;
use std::time::Duration;

/// Listening time; every process publishes its status five times per second.
const LISTEN: Duration = Duration::from_millis(600);
/// The pause between two looks for messages.
const PAUSE: Duration = Duration::from_millis(20);

/// The options of `ricochet status`.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct StatusOptions {
    /// Name of the rig [default: every rig that runs].
    #[arg(long)]
    pub rig: Option<String>,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
    /// The rig of another host, which `--rig` names.
    #[cfg(feature = "zenoh")]
    #[command(flatten)]
    pub remote: super::via::RemoteOptions,
}

/// The state of a rig's processes.
struct RigStatus {
    rig: String,
    /// The newest status of each process, by role and index.
    processes: BTreeMap<(u32, u32), StatusMessage>,
    /// The processes that sent none.
    silent: Vec<TakenRole>,
}

/// Prints the latest status of every process of a rig, or of all rigs that run.
///
/// # Errors
///
/// When no such rig runs.
pub fn run(options: &StatusOptions) -> Result<Outcome, Failure> {
    let rigs = match &options.rig {
        Some(rig) => vec![rig.clone()],
        None => Bus::running_rigs(),
    };
    let mut shown = 0;
    for rig in &rigs {
        let status = match (RigStatus::collect(rig)?, &options.rig) {
            (Some(status), _) => status,
            // It has ended since the list was made.
            (None, None) => continue,
            (None, Some(_)) => {
                let service = format!("ricochet/{rig}/status");
                return Err(BusError::NoRig { rig: rig.clone(), service }.into());
            }
        };
        if options.json {
            print_line(&status.json());
        } else {
            if options.rig.is_none() {
                print_line(&format!("{}rig {rig}", if shown > 0 { "\n" } else { "" }));
            }
            print_line(&status.table());
        }
        shown += 1;
    }
    if shown == 0 {
        return Err(UsageError("no rig of this user runs on this computer; `ricochet run` starts one".into()).into());
    }
    Ok(Outcome::Clean)
}

/// Returns the state of a rig as JSON and as a table.
///
/// # Errors
///
/// [`BusError::NoRig`] when no such rig runs.
#[cfg(feature = "zenoh")]
pub(super) fn describe(rig: &str) -> Result<(String, String), Failure> {
    let none = || BusError::NoRig { rig: rig.to_owned(), service: format!("ricochet/{rig}/status") };
    let status = RigStatus::collect(rig)?.ok_or_else(none)?;
    Ok((status.json(), status.table()))
}

impl RigStatus {
    /// Listens to the rig for as long as each process takes to report; `None` where no process is alive.
    fn collect(rig: &str) -> Result<Option<Self>, Failure> {
        let bus = Bus::join(rig, "status")?;
        let topic = match bus.listen::<StatusMessage>() {
            Err(BusError::NoRig { .. }) => return Ok(None),
            topic => topic?,
        };
        let mut processes = BTreeMap::new();
        for _ in 0..LISTEN.as_millis() / PAUSE.as_millis() {
            while let Some(status) = topic.take()? {
                processes.insert((status.role, status.index), status);
            }
            std::thread::sleep(PAUSE);
        }
        let has_sent = |role: &TakenRole| processes.values().any(|status| is_from(status, role));
        let silent: Vec<_> = bus.roles().into_iter().filter(|role| !has_sent(role)).collect();
        let is_alive = !processes.is_empty() || !silent.is_empty();
        Ok(is_alive.then(|| Self { rig: rig.to_owned(), processes, silent }))
    }

    /// Returns the status as JSON.
    fn json(&self) -> String {
        let all: Vec<_> = self.processes.values().map(status_as_json).collect();
        let silent: Vec<_> =
            self.silent.iter().map(|role| serde_json::json!({ "process": role.name, "pid": role.pid })).collect();
        serde_json::json!({ "rig": self.rig, "processes": all, "silent": silent }).to_string()
    }

    /// Returns the status as a table.
    fn table(&self) -> String {
        let header =
            ["process", "pid", "frame", "rate/s", "taken", "given", "lost", "dropped", "queue", "latency", "restarts"];
        let mut rows = vec![header.map(str::to_owned).to_vec()];
        rows.extend(self.processes.values().map(status_as_row));
        rows.extend(self.silent.iter().map(|role| vec![format!("{} (no heartbeat)", role.name), role.pid.to_string()]));
        table(&rows)
    }
}

/// Whether a process that has this role sent the status.
fn is_from(status: &StatusMessage, role: &TakenRole) -> bool {
    let is_role = Role::from_number(status.role).is_some_and(|found| role.name.starts_with(found.as_str()));
    is_role && (status.pid == role.pid || role.pid == 0)
}

/// Returns the name of a process: its role, with its index or state.
fn process_name(status: &StatusMessage) -> String {
    match Role::from_number(status.role) {
        Some(Role::Correlate) if status.measured_every() > 1 => {
            format!("correlate {} (1 block of {})", status.index, status.measured_every())
        }
        Some(Role::Correlate) => format!("correlate {}", status.index),
        Some(Role::Record) if status.is_disk_full() => "record (disk full)".into(),
        Some(Role::Record) if status.is_armed() => "record (armed)".into(),
        Some(role) => role.as_str().into(),
        None => "?".into(),
    }
}

/// Returns the cells of a status for the printed table.
fn status_as_row(status: &StatusMessage) -> Vec<String> {
    let latency = if status.latency_s > 0.0 { format!("{:.1} ms", 1e3 * status.latency_s) } else { "-".into() };
    vec![
        process_name(status),
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

/// Returns a status as JSON.
fn status_as_json(status: &StatusMessage) -> serde_json::Value {
    serde_json::json!({
        "process": Role::from_number(status.role).map_or("?", Role::as_str),
        "index": status.index, "pid": status.pid, "state": status.state, "run_id": status.run_id,
        "sequence": status.sequence, "stamp_ns": status.stamp_ns, "rate_hz": status.rate_hz, "taken": status.taken,
        "given": status.given, "lost": status.lost, "dropped": status.dropped, "waiting": status.waiting,
        "capacity": status.capacity, "latency_s": status.latency_s, "restarts": status.restarts,
        "row_latency_median_s": status.row_latency_median_s, "row_latency_p99_s": status.row_latency_p99_s,
        "row_latency_p999_s": status.row_latency_p999_s, "row_latency_max_s": status.row_latency_max_s,
        "row_latency_deviation_s": status.row_latency_deviation_s,
    })
}
