//! `ricochet arm`, `disarm` and `trigger`.

use crate::bus::{Bus, BusError, Subscriber};
use crate::console::{Outcome, UsageError, print_line};
use crate::failure::Failure;
use crate::message::{Command, Event, EventKind, Reply, ReplyCode, Role};
use crate::process::Stop;
use serde_json::{Value, json};
use std::time::Duration;

/// The maximum wait for the reply of the rig.
const PATIENCE: Duration = Duration::from_secs(2);
const PAUSE: Duration = Duration::from_millis(20);

/// The options of the commands that talk to a running rig.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct RigOptions {
    /// Name of the rig.
    #[arg(long, default_value = "rig")]
    pub rig: String,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
    /// The rig of another host.
    #[cfg(feature = "zenoh")]
    #[command(flatten)]
    pub remote: super::via::RemoteOptions,
}

/// The options of `ricochet trigger`.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct TriggerOptions {
    /// The rig and the output.
    #[command(flatten)]
    pub rig: RigOptions,
    /// Wait for the recording, and print its path.
    #[arg(long)]
    pub wait: bool,
}

/// The event that a command waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Waiting {
    /// The reply of the rig.
    No,
    /// The recording of the shot that it has triggered.
    ForRecording,
}

/// Sends a request to a running rig and prints the reply.
///
/// # Errors
///
/// When no such rig runs, nobody replies, or the rig refuses.
pub fn run(options: &RigOptions, command: Command, stop: &Stop) -> Result<Outcome, Failure> {
    report(options, &execute(&options.rig, command, Waiting::No, stop)?)
}

/// Triggers a recording, and waits for it if that is wanted.
///
/// # Errors
///
/// When no such rig runs, nobody replies, the rig refuses, or it ends without a recording.
pub fn trigger(options: &TriggerOptions, stop: &Stop) -> Result<Outcome, Failure> {
    let waiting = if options.wait { Waiting::ForRecording } else { Waiting::No };
    report(&options.rig, &execute(&options.rig.rig, Command::Trigger, waiting, stop)?)
}

/// Sends a command to a rig of this host and returns the reply as JSON.
///
/// # Errors
///
/// When no such rig runs, nobody replies, or the rig ends without a recording that is waited for.
pub(super) fn execute(rig: &str, command: Command, waiting: Waiting, stop: &Stop) -> Result<Value, Failure> {
    let bus = Bus::join(rig, "control")?;
    if waiting == Waiting::No {
        return Ok(as_json(&ask(&bus, command)?, None));
    }
    let events = bus.listen::<Event>()?;
    // Those of earlier shots.
    while events.take()?.is_some() {}
    let reply = ask(&bus, command)?;
    let recording = match ReplyCode::from_number(reply.code) {
        Some(ReplyCode::Accepted) => Some(wait_for_recording(&bus, &events, reply.sequence, stop)?),
        _ => None,
    };
    Ok(as_json(&reply, recording))
}

/// Sends a command to a rig and returns its reply.
///
/// # Errors
///
/// Returns a failure if no rig answers in time.
fn ask(bus: &Bus, command: Command) -> Result<Reply, Failure> {
    let reply = bus.control_client()?.ask(command, PATIENCE)?;
    Ok(reply.ok_or_else(|| no_answer_error(bus))?)
}

/// Waits until the rig has completed a recording that goes on after frame `newest`, the last one written before, and returns
/// its path. The recording of the shot before ends with that frame, although its event may come now.
///
/// # Errors
///
/// When the rig dies, or a stop ends the wait.
fn wait_for_recording(bus: &Bus, events: &Subscriber<Event>, newest: u64, stop: &Stop) -> Result<String, Failure> {
    while !stop.requested() {
        while let Some(event) = events.take()? {
            if event.kind() == Some(EventKind::Recorded) && event.sequence > newest + 1 {
                return Ok(event.text());
            }
        }
        if !bus.is_alive() {
            return Err(BusError::Died { rig: bus.rig().to_owned() }.into());
        }
        std::thread::sleep(PAUSE);
    }
    Err(UsageError("stopped; the rig goes on with the recording".into()).into())
}

/// Returns a reply as JSON, with the recording of the shot if it was waited for.
fn as_json(reply: &Reply, recording: Option<String>) -> Value {
    let code = ReplyCode::from_number(reply.code).unwrap_or(ReplyCode::Unknown);
    let mut answer = json!({
        "accepted": code == ReplyCode::Accepted, "answer": code.as_str(), "armed": reply.armed == 1,
        "recordings": reply.recordings, "sequence": reply.sequence,
    });
    if let Some(path) = recording {
        answer["recording"] = path.into();
    }
    answer
}

/// Prints the reply of a rig as JSON, or the recording of a shot.
///
/// # Errors
///
/// [`UsageError`] when the rig did not accept the command.
pub(super) fn report(options: &RigOptions, answer: &Value) -> Result<Outcome, Failure> {
    let text = |name: &str| answer[name].as_str();
    if options.json {
        print_line(&answer.to_string());
    } else if let Some(path) = text("recording") {
        print_line(path);
    }
    if answer["accepted"] != true {
        return Err(UsageError(format!("rig {:?}: {}", options.rig, text("answer").unwrap_or("no reply"))).into());
    }
    Ok(Outcome::Clean)
}

/// Returns the error of a rig that does not reply, or does not run.
fn no_answer_error(bus: &Bus) -> BusError {
    let rig = bus.rig().to_owned();
    match bus.roles().iter().find(|role| role.name == Role::Record.as_str()) {
        Some(role) => BusError::Silent { rig, pid: role.pid },
        None => BusError::NoRig { service: format!("ricochet/{rig}/control"), rig },
    }
}
