//! `ricochet arm`, `disarm` and `trigger`.

use crate::bus::{Bus, BusError};
use crate::console::{Outcome, UsageError, print_line};
use crate::failure::Failure;
use crate::message::{Command, ReplyCode, Role};
use std::time::Duration;

const PATIENCE: Duration = Duration::from_secs(2);

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

/// Sends a request to a running rig and prints the reply.
///
/// # Errors
///
/// When no such rig runs, nobody replies, or the rig refuses.
pub fn run(options: &RigOptions, command: Command) -> Result<Outcome, Failure> {
    let rig = &options.rig;
    let bus = Bus::join(rig, "control")?;
    let reply = bus.control_client()?.ask(command, PATIENCE)?;
    let Some(reply) = reply else { return Err(no_answer(&bus).into()) };
    let code = ReplyCode::from_number(reply.code).unwrap_or(ReplyCode::Unknown);
    if options.json {
        let answer = serde_json::json!({
            "accepted": code == ReplyCode::Accepted, "answer": code.as_str(), "armed": reply.armed == 1,
            "recordings": reply.recordings, "sequence": reply.sequence,
        });
        print_line(&answer.to_string());
    }
    if code != ReplyCode::Accepted {
        return Err(UsageError(format!("rig {rig:?}: {}", code.as_str())).into());
    }
    Ok(Outcome::Clean)
}

/// Returns the reason why nobody replies.
fn no_answer(bus: &Bus) -> BusError {
    let rig = bus.rig().to_owned();
    match bus.roles().iter().find(|role| role.name == Role::Record.as_str()) {
        Some(role) => BusError::Silent { rig, pid: role.pid },
        None => BusError::NoRig { service: format!("ricochet/{rig}/control"), rig },
    }
}
