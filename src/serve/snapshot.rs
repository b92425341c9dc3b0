//! The state of the rig as the page and programs read it.

use super::control::Control;
use super::numbers::{impact_json, status_reason};
use super::rig_state::{PageState, RigState};
use super::shots::Shots;
use crate::config::Config;
use crate::message::{Role, StatusMessage};
use axum::body::Bytes;
use serde_json::{Value, json};
use tokio::sync::watch;

/// The state of the rig as text, the same for all clients.
#[derive(Debug, Clone)]
pub(super) struct StateText {
    /// A server-sent event.
    pub(super) event: Bytes,
}

/// The start and the end of a server-sent event.
const EVENT: [&str; 2] = ["data: ", "\n\n"];

/// The state of the rig, whenever it is published.
pub(super) type States = watch::Sender<StateText>;

impl StateText {
    /// Puts a JSON object into an event.
    pub(super) fn new(json: &str) -> Self {
        Self { event: [EVENT[0], json, EVENT[1]].concat().into() }
    }

    /// Returns the JSON object alone.
    pub(super) fn json(&self) -> Bytes {
        self.event.slice(EVENT[0].len()..self.event.len() - EVENT[1].len())
    }
}

/// Returns the state of the rig as a JSON object.
pub(super) fn snapshot(config: &Config, rig: &PageState, shots: &Shots, control: &Control, now_s: f64) -> Value {
    let explained = rig.state(now_s);
    let saved = rig.shot.and_then(|shot| shot.saved).map(|saved| saved.number);
    json!({
        "rig": config.rig.name,
        "version": env!("CARGO_PKG_VERSION"),
        "state": explained.state.as_str(),
        "detail": explained.detail,
        "shot": saved,
        "percent": (explained.state == RigState::Filling).then(|| (100.0 * rig.ring_fraction()).floor()),
        "armed": rig.is_armed,
        "actions": rig.actions(),
        "trigger": config.trigger.mode.as_str(),
        "holder": control.holder(),
        "bars": bars_json(config, rig, shots),
        "last": last_shot_json(config, rig, saved),
        "shots_revision": shots.revision(),
        "processes": rig.statuses.values().map(process_json).collect::<Vec<_>>(),
    })
}

/// Returns the reserves of the rig, which the page shows as bars: ring, disk, lost frames, lag and rate.
fn bars_json(config: &Config, rig: &PageState, shots: &Shots) -> Value {
    let statuses_of = |role: Role| rig.statuses.values().filter(move |status| status.role == role as u32);
    let lost = |status: &StatusMessage| status.lost + status.dropped;
    let slowest = statuses_of(Role::Correlate).max_by_key(|status| status.waiting);
    let free_bytes = shots.directory().and_then(|directory| {
        let about = rustix::fs::statvfs(directory).ok()?;
        Some(about.f_bavail.saturating_mul(about.f_frsize))
    });
    let shot_bytes = shots.newest_bytes().filter(|bytes| *bytes > 0);
    json!({
        "ring_fraction": rig.ring_fraction(),
        "ring_s": (config.pre_trigger_frames(1e6) > 0).then_some(config.trigger.pre_s),
        "disk_bytes": free_bytes,
        "disk_shots": free_bytes.zip(shot_bytes).map(|(free, shot)| free / shot),
        "lost_camera": statuses_of(Role::Acquire).map(lost).sum::<u64>(),
        "lost_measured": statuses_of(Role::Correlate).chain(statuses_of(Role::Track)).map(lost).sum::<u64>(),
        "lost_recorded": statuses_of(Role::Record).map(lost).sum::<u64>(),
        "lag_frames": slowest.map(|status| status.waiting),
        "lag_capacity_frames": slowest.map(|status| status.capacity),
        "measured_every": statuses_of(Role::Correlate).map(|status| status.measured_every()).max(),
        "rate_hz": rig.camera_status().map(|status| status.rate_hz),
        "frames": rig.camera_status().map(|status| status.taken),
    })
}

/// Returns the numbers of the last collision, or the reason why there are none. `saved` is the number of the last shot.
fn last_shot_json(config: &Config, rig: &PageState, saved: Option<u32>) -> Value {
    let Some(impact) = rig.last_impact() else {
        let reason = match rig.shot {
            Some(shot) if shot.saved.is_none() => "the shot is being measured",
            Some(_) => "no collision was found in this shot",
            None if config.workers.count == 0 => "this rig films and records, but does not measure",
            None => "no collision yet",
        };
        return json!({ "shot": saved, "reason": reason, "numbers": [] });
    };
    let body = config.bodies.get(impact.body as usize).map(|body| body.name.as_str());
    json!({
        "shot": saved, "body": body, "number": impact.number, "revision": impact.revision,
        "status": impact.status.as_str(), "reason": status_reason(impact.status), "numbers": impact_json(impact),
    })
}

/// Returns the report of a process as JSON.
fn process_json(status: &StatusMessage) -> Value {
    json!({
        "process": Role::from_number(status.role).map_or("?", Role::as_str), "index": status.index,
        "pid": status.pid, "sequence": status.sequence, "stamp_ns": status.stamp_ns, "rate_hz": status.rate_hz,
        "taken": status.taken, "given": status.given, "lost": status.lost, "dropped": status.dropped,
        "waiting": status.waiting, "capacity": status.capacity, "latency_s": status.latency_s,
        "restarts": status.restarts,
    })
}
