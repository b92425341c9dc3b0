//! `ricochet arm`, `disarm` and `trigger`.

use crate::bus::{Bus, BusError, Subscriber};
use crate::console::{Outcome, UsageError, print_line};
use crate::failure::Failure;
use crate::message::{Command, Event, EventKind, Reply, ReplyCode, Role};
use crate::process::Stop;
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

/// Sends a request to a running rig and prints the reply.
///
/// # Errors
///
/// When no such rig runs, nobody replies, or the rig refuses.
pub fn run(options: &RigOptions, command: Command) -> Result<Outcome, Failure> {
    let reply = ask(&Bus::join(&options.rig, "control")?, command)?;
    report(options, &reply, None)
}

/// Triggers a recording, and waits for it if that is wanted.
///
/// # Errors
///
/// When no such rig runs, nobody replies, the rig refuses, or it ends without a recording.
pub fn trigger(options: &TriggerOptions, stop: &Stop) -> Result<Outcome, Failure> {
    if !options.wait {
        return run(&options.rig, Command::Trigger);
    }
    let bus = Bus::join(&options.rig.rig, "control")?;
    let events = bus.listen::<Event>()?;
    // Those of earlier shots.
    while events.take()?.is_some() {}
    let reply = ask(&bus, Command::Trigger)?;
    let recording = match ReplyCode::from_number(reply.code) {
        Some(ReplyCode::Accepted) => Some(wait_for_recording(&bus, &events, reply.sequence, stop)?),
        _ => None,
    };
    report(&options.rig, &reply, recording.as_deref())
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

/// Prints the reply of a rig as JSON, or the recording of a shot.
///
/// # Errors
///
/// [`UsageError`] when the rig did not accept the command.
fn report(options: &RigOptions, reply: &Reply, recording: Option<&str>) -> Result<Outcome, Failure> {
    let rig = &options.rig;
    let code = ReplyCode::from_number(reply.code).unwrap_or(ReplyCode::Unknown);
    if options.json {
        let mut answer = serde_json::json!({
            "accepted": code == ReplyCode::Accepted, "answer": code.as_str(), "armed": reply.armed == 1,
            "recordings": reply.recordings, "sequence": reply.sequence,
        });
        if let Some(path) = recording {
            answer["recording"] = path.into();
        }
        print_line(&answer.to_string());
    } else if let Some(path) = recording {
        print_line(path);
    }
    if code != ReplyCode::Accepted {
        return Err(UsageError(format!("rig {rig:?}: {}", code.as_str())).into());
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
