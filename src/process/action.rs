//! Actions of a trigger besides the recording: a program, a web request, a trigger of another rig.
//!
//! Each runs on a thread of its own with a timeout. The loop that starts it never waits for it.

use super::clock::{Timeout, now};
use super::frame_stamp::FrameStamp;
use crate::bus::Bus;
use crate::config::Config;
use crate::message::{Command as Request, ReplyCode};
use rustix::process::{Pid, Signal, kill_process, kill_process_group};
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;
use ureq::Agent;

/// Maximum duration of a program.
const PROGRAM_TIMEOUT: Duration = Duration::from_secs(30);
/// Maximum duration of a web request (name look-up included) or of another rig's reply.
const REPLY_TIMEOUT: Duration = Duration::from_secs(5);
/// Interval of polling a running program.
const POLL_PERIOD: Duration = Duration::from_millis(2);
/// Time at the end of a loop for the actions that still run.
const END_TIMEOUT: Duration = Duration::from_secs(5);
/// Maximum time of killing a program and what it has started. A process that waits for a device cannot be killed.
const KILL_TIMEOUT: Duration = Duration::from_secs(1);
/// Environment variable of a program and of all that it starts. Its value is different for each action.
const MARK: &str = "RICOCHET_ACTION";
/// Maximum number of concurrent actions; further ones are not started.
const MAX_RUNNING: usize = 16;

/// The trigger behind an action.
#[derive(Debug, Clone)]
pub(super) struct TriggerCause {
    pub(super) frame: FrameStamp,
    /// The condition that was met, in words.
    pub(super) text: String,
}

/// The outcome of an action.
#[derive(Debug)]
pub(super) struct ActionOutcome {
    pub(super) cause: TriggerCause,
    pub(super) text: String,
    pub(super) failed: bool,
}

/// One configured action.
#[derive(Debug, Clone)]
enum Action {
    /// Runs a program with its arguments.
    Run(Vec<String>),
    /// Posts the trigger to this address.
    Post(String),
    /// Triggers the rig of this name.
    Trigger(String),
}

/// The actions of a rig.
#[derive(Debug)]
pub(super) struct Actions {
    rig: String,
    actions: Vec<Action>,
    outcomes: (Sender<ActionOutcome>, Receiver<ActionOutcome>),
    /// Number of actions whose outcome was not taken yet.
    running: usize,
}

impl Actions {
    pub(super) fn new(config: &Config) -> Self {
        let trigger = &config.trigger;
        let run = (!trigger.command.is_empty()).then(|| Action::Run(trigger.command.clone()));
        let post = trigger.url.clone().map(Action::Post);
        let other = trigger.other_rig.clone().map(Action::Trigger);
        let actions = run.into_iter().chain(post).chain(other).collect();
        Self { rig: config.rig.name.clone(), actions, outcomes: channel(), running: 0 }
    }

    /// Starts every action. One that cannot be started has failed, which its outcome states.
    pub(super) fn start(&mut self, cause: &TriggerCause) {
        for action in &self.actions {
            let sender = self.outcomes.0.clone();
            let refuse = |reason: String| {
                let text = format!("{}: {reason}", action.name());
                let _ = sender.send(ActionOutcome { cause: cause.clone(), text, failed: true });
            };
            self.running += 1;
            if self.running > MAX_RUNNING {
                refuse(format!("not started, {MAX_RUNNING} others still run"));
                continue;
            }
            let (action, rig, cause, sender) = (action.clone(), self.rig.clone(), cause.clone(), sender.clone());
            let work = move || {
                let begin = now();
                let result = action.perform(&rig, &cause);
                let ms = begin.elapsed().as_millis();
                let failed = result.is_err();
                let (Ok(text) | Err(text)) = result;
                let text = format!("{}: {text} after {ms} ms", action.name());
                let _ = sender.send(ActionOutcome { cause, text, failed });
            };
            if let Err(error) = std::thread::Builder::new().name("action".into()).spawn(work) {
                refuse(format!("cannot start a thread: {error}"));
            }
        }
    }

    /// Returns the outcome of the next action that has ended, if there is one.
    pub(super) fn next_outcome(&mut self) -> Option<ActionOutcome> {
        let outcome = self.outcomes.1.try_recv().ok()?;
        self.running -= 1;
        Some(outcome)
    }

    /// Waits at most [`END_TIMEOUT`] for the actions that still run, and returns their outcomes.
    pub(super) fn wait_for_all(&mut self) -> Vec<ActionOutcome> {
        let (timeout, mut outcomes) = (Timeout::new(END_TIMEOUT), Vec::new());
        while self.running > 0 && !timeout.has_expired() {
            outcomes.extend(self.next_outcome());
            std::thread::sleep(POLL_PERIOD);
        }
        outcomes
    }
}

impl Action {
    /// Returns the kind of the action and its target (the program, the address or the rig), for messages.
    fn name(&self) -> String {
        match self {
            Self::Run(command) => format!("command {}", command[0]),
            Self::Post(url) => format!("url {url}"),
            Self::Trigger(rig) => format!("rig {rig}"),
        }
    }

    /// Performs the action to its end and returns its outcome as text, for the event.
    ///
    /// # Errors
    ///
    /// The outcome as text, if the action failed.
    fn perform(&self, rig: &str, cause: &TriggerCause) -> Result<String, String> {
        match self {
            Self::Run(command) => run_program(command, rig, cause, PROGRAM_TIMEOUT),
            Self::Post(url) => post_to_url(url, rig, cause),
            Self::Trigger(other) => trigger_rig(other),
        }
    }
}

/// Runs a program to its end, with the trigger in its environment. After `limit` it is killed, with all that it has
/// started.
///
/// # Errors
///
/// The outcome, unless the program ends with 0.
fn run_program(command: &[String], rig: &str, cause: &TriggerCause, limit: Duration) -> Result<String, String> {
    let mark = next_mark();
    let mut child = Command::new(&command[0])
        .args(&command[1..])
        .env("RICOCHET_RIG", rig)
        .env("RICOCHET_FRAME", cause.frame.sequence.to_string())
        .env("RICOCHET_STAMP_NS", cause.frame.stamp_ns.to_string())
        .env("RICOCHET_CAUSE", &cause.text)
        .env(MARK, &mark)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .process_group(0)
        .spawn()
        .map_err(|error| error.to_string())?;
    let timeout = Timeout::new(limit);
    loop {
        match child.try_wait() {
            Ok(Some(status)) if status.success() => return Ok("ended with 0".into()),
            Ok(Some(status)) => return Err(format!("ended with {status}")),
            Err(error) => return Err(error.to_string()),
            Ok(None) if timeout.has_expired() => {
                kill_all(&mut child, &mark);
                return Err("killed".into());
            }
            Ok(None) => std::thread::sleep(POLL_PERIOD),
        }
    }
}

/// Returns a value of [`MARK`] that no other action on this computer has.
fn next_mark() -> String {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    format!("{}.{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed))
}

/// Kills a program and all that it has started: its process group, and then whatever has its mark, since a process can
/// leave its group, its session and its parent. Gives up after [`KILL_TIMEOUT`].
fn kill_all(child: &mut Child, mark: &str) {
    let _ = kill_process_group(Pid::from_child(child), Signal::KILL);
    let _ = child.wait();
    let timeout = Timeout::new(KILL_TIMEOUT);
    // A process that forks while the list is made is found in the next one.
    let mut found = processes_with_mark(mark);
    while !found.is_empty() && !timeout.has_expired() {
        for pid in found {
            // It may have ended by itself.
            let _ = kill_process(pid, Signal::KILL);
        }
        std::thread::sleep(POLL_PERIOD);
        found = processes_with_mark(mark);
    }
}

/// Returns the processes whose environment holds this mark.
fn processes_with_mark(mark: &str) -> Vec<Pid> {
    let variable = format!("{MARK}={mark}");
    let Ok(entries) = std::fs::read_dir("/proc") else { return Vec::new() };
    let pids = entries.flatten().filter_map(|entry| entry.file_name().to_str()?.parse::<i32>().ok());
    // That of a process which has ended, or of another user, cannot be read.
    let environment = |pid: i32| std::fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
    let is_marked = |pid: &i32| environment(*pid).split(|byte| *byte == 0).any(|text| text == variable.as_bytes());
    pids.filter(is_marked).filter_map(Pid::from_raw).collect()
}

/// Posts the trigger to a web service as JSON and returns the status of the response as text.
///
/// # Errors
///
/// The reason as text, if there is no response within [`REPLY_TIMEOUT`] or its status is not 2xx.
fn post_to_url(url: &str, rig: &str, cause: &TriggerCause) -> Result<String, String> {
    let body = serde_json::json!({
        "rig": rig, "frame": cause.frame.sequence, "stamp_ns": cause.frame.stamp_ns, "cause": cause.text,
    });
    // No proxy: it would come from environment variables.
    let config = Agent::config_builder().timeout_global(Some(REPLY_TIMEOUT)).max_redirects(0).proxy(None);
    let agent: Agent = config.http_status_as_error(false).build().into();
    let request = agent.post(url).header("Content-Type", "application/json");
    let status = request.send(body.to_string()).map_err(|error| error.to_string())?.status();
    let text = format!("answered {}", status.as_u16());
    if status.is_success() { Ok(text) } else { Err(text) }
}

/// Triggers another rig.
///
/// # Errors
///
/// The reason, unless its recorder accepts.
fn trigger_rig(other: &str) -> Result<String, String> {
    let failure = |error: crate::bus::BusError| error.to_string();
    let bus = Bus::join(other, "action").map_err(failure)?;
    let reply = bus.control_client().map_err(failure)?.ask(Request::Trigger, REPLY_TIMEOUT).map_err(failure)?;
    match reply.map(|reply| ReplyCode::from_number(reply.code).unwrap_or(ReplyCode::Unknown)) {
        Some(ReplyCode::Accepted) => Ok("triggered".into()),
        Some(code) => Err(code.as_str().to_owned()),
        None => Err("no answer".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_that_runs_too_long_ends_with_all_that_it_has_started() {
        let folder = std::env::temp_dir().join(format!("ricochet-action-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let note = folder.join("pid");
        // One in its group, one in a session of its own, and one that has no parent any more.
        let script = format!(
            "echo > {0}; sleep 600 & echo $! >> {0}; setsid sh -c 'echo $$ >> {0}; exec sleep 600' & \
             (setsid sh -c 'echo $$ >> {0}; exec sleep 600' &) & wait",
            note.display()
        );
        let command = ["/bin/sh".to_owned(), "-c".into(), script];
        let cause = TriggerCause { frame: FrameStamp::default(), text: String::new() };
        let outcome = run_program(&command, "rig", &cause, Duration::from_millis(500));
        assert_eq!(outcome, Err("killed".to_owned()));
        let text = std::fs::read_to_string(&note).unwrap();
        let started: Vec<&str> = text.split_whitespace().collect();
        assert_eq!(started.len(), 3, "{started:?}");
        let state = |pid: &str| std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        let timeout = Timeout::new(Duration::from_secs(10));
        while !started.iter().all(|pid| state(pid).is_empty() || state(pid).contains(") Z ")) {
            assert!(!timeout.has_expired(), "{:?}", started.iter().map(|pid| state(pid)).collect::<Vec<_>>());
            std::thread::sleep(POLL_PERIOD);
        }
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
