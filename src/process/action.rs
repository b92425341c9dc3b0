//! What a trigger sets off besides a shot: a program, a web service, another rig.
//!
//! Each runs on a thread of its own and is given up after a while; the loop that
//! fired it never waits for it.

use super::clock::{Patience, now};
use crate::bus::Bus;
use crate::config::Config;
use crate::message::{Command as Request, ReplyCode};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::process::{Command, Stdio};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

/// How long a program may run.
const PROGRAM: Duration = Duration::from_secs(30);
/// How long a web service, or another rig, may take to answer.
const ANSWER: Duration = Duration::from_secs(5);
/// How often a running program is looked at.
const LOOK: Duration = Duration::from_millis(2);
/// How long the end of a loop waits for what still runs.
const END: Duration = Duration::from_secs(5);
/// Actions under way at once; what would be more is not begun.
const MOST: usize = 16;
/// Longest first line of an answer, bytes.
const LINE_BYTES: u64 = 4096;

/// The trigger that sets off an action.
#[derive(Debug, Clone)]
pub(super) struct Cause {
    pub(super) frame: u64,
    pub(super) stamp_ns: u64,
    pub(super) text: String,
}

/// How an action ended.
#[derive(Debug)]
pub(super) struct Ended {
    pub(super) cause: Cause,
    pub(super) text: String,
    pub(super) failed: bool,
}

#[derive(Debug, Clone)]
enum Action {
    Run(Vec<String>),
    Post(String),
    Trigger(String),
}

/// The actions of a rig.
#[derive(Debug)]
pub(super) struct Actions {
    rig: String,
    actions: Vec<Action>,
    ended: (Sender<Ended>, Receiver<Ended>),
    running: usize,
}

impl Actions {
    pub(super) fn new(config: &Config) -> Self {
        let trigger = &config.trigger;
        let run = (!trigger.command.is_empty()).then(|| Action::Run(trigger.command.clone()));
        let post = trigger.url.clone().map(Action::Post);
        let other = trigger.other_rig.clone().map(Action::Trigger);
        let actions = run.into_iter().chain(post).chain(other).collect();
        Self { rig: config.rig.name.clone(), actions, ended: channel(), running: 0 }
    }

    /// Begins every action.
    pub(super) fn fire(&mut self, cause: &Cause) {
        for action in &self.actions {
            let (action, rig, cause, sender) = (action.clone(), self.rig.clone(), cause.clone(), self.ended.0.clone());
            let refused = |reason: String| Ended { cause: cause.clone(), text: reason, failed: true };
            if self.running >= MOST {
                let _ = sender.send(refused(format!("{}: not begun, {MOST} others still run", action.name())));
                self.running += 1;
                continue;
            }
            self.running += 1;
            let (name, told, its) = (action.name(), sender.clone(), cause.clone());
            let work = move || {
                let began = now();
                let outcome = action.perform(&rig, &its);
                let ms = began.elapsed().as_millis();
                let (text, failed) = match outcome {
                    Ok(how) => (format!("{}: {how} after {ms} ms", action.name()), false),
                    Err(why) => (format!("{}: {why} after {ms} ms", action.name()), true),
                };
                let _ = told.send(Ended { cause: its, text, failed });
            };
            if let Err(error) = std::thread::Builder::new().name("action".into()).spawn(work) {
                let _ = sender.send(refused(format!("{name}: no thread: {error}")));
            }
        }
    }

    /// An action that has ended since, if there is one.
    pub(super) fn ended(&mut self) -> Option<Ended> {
        let ended = self.ended.1.try_recv().ok()?;
        self.running -= 1;
        Some(ended)
    }

    /// Waits a while for what still runs, at the end of a loop.
    pub(super) fn last(&mut self) -> Vec<Ended> {
        let (patience, mut all) = (Patience::new(END), Vec::new());
        while self.running > 0 && !patience.is_over() {
            all.extend(self.ended());
            std::thread::sleep(LOOK);
        }
        all
    }
}

impl Action {
    fn name(&self) -> String {
        match self {
            Self::Run(texts) => format!("command {}", texts[0]),
            Self::Post(url) => format!("url {url}"),
            Self::Trigger(rig) => format!("rig {rig}"),
        }
    }

    fn perform(&self, rig: &str, cause: &Cause) -> Result<String, String> {
        match self {
            Self::Run(texts) => run(texts, rig, cause),
            Self::Post(url) => post(url, rig, cause),
            Self::Trigger(other) => trigger(other),
        }
    }
}

/// Runs a program to its end; it learns of the trigger from its environment.
fn run(texts: &[String], rig: &str, cause: &Cause) -> Result<String, String> {
    let mut child = Command::new(&texts[0])
        .args(&texts[1..])
        .env("RICOCHET_RIG", rig)
        .env("RICOCHET_FRAME", cause.frame.to_string())
        .env("RICOCHET_STAMP_NS", cause.stamp_ns.to_string())
        .env("RICOCHET_CAUSE", &cause.text)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .map_err(|error| error.to_string())?;
    let patience = Patience::new(PROGRAM);
    loop {
        match child.try_wait() {
            Ok(Some(status)) if status.success() => return Ok("ended with 0".into()),
            Ok(Some(status)) => return Err(format!("ended with {status}")),
            Err(error) => return Err(error.to_string()),
            Ok(None) if patience.is_over() => {
                let _ = child.kill();
                let _ = child.wait();
                return Err("killed".into());
            }
            Ok(None) => std::thread::sleep(LOOK),
        }
    }
}

/// Tells a web service in JSON; its answer must be a 2xx.
fn post(url: &str, rig: &str, cause: &Cause) -> Result<String, String> {
    let rest = url.strip_prefix("http://").unwrap_or(url);
    let at = rest.find(['/', '?']).unwrap_or(rest.len());
    let (host, path) = rest.split_at(at);
    let path = if path.starts_with('/') { path.to_owned() } else { format!("/{path}") };
    let has_port = host.rsplit_once(':').is_some_and(|(_, port)| port.bytes().all(|byte| byte.is_ascii_digit()));
    let address = if has_port { host.to_owned() } else { format!("{host}:80") };
    let told = serde_json::json!({
        "rig": rig, "frame": cause.frame, "stamp_ns": cause.stamp_ns, "cause": cause.text,
    })
    .to_string();
    let words = |error: std::io::Error| error.to_string();
    let socket = address.to_socket_addrs().map_err(words)?.next().ok_or("no address of this name")?;
    let mut stream = TcpStream::connect_timeout(&socket, ANSWER).map_err(words)?;
    stream.set_read_timeout(Some(ANSWER)).map_err(words)?;
    stream.set_write_timeout(Some(ANSWER)).map_err(words)?;
    let request = format!(
        "POST {path} HTTP/1.1\r\nHost: {host}\r\nContent-Type: application/json\r\nContent-Length: {}\r\n\
         Connection: close\r\n\r\n{told}",
        told.len()
    );
    stream.write_all(request.as_bytes()).map_err(words)?;
    let mut line = String::new();
    BufReader::new(stream.take(LINE_BYTES)).read_line(&mut line).map_err(words)?;
    let answer = line.trim_end();
    let code = answer.strip_prefix("HTTP/1.").and_then(|rest| rest.split(' ').nth(1));
    match code {
        Some(code) if code.len() == 3 && code.starts_with('2') => Ok(format!("answered {code}")),
        _ => Err(format!("answered {answer:?}")),
    }
}

/// Triggers another rig.
fn trigger(other: &str) -> Result<String, String> {
    let words = |error: crate::bus::BusError| error.to_string();
    let bus = Bus::join(other, "action").map_err(words)?;
    let reply = bus.control_client().map_err(words)?.ask(Request::Trigger, ANSWER).map_err(words)?;
    match reply.map(|reply| ReplyCode::from_number(reply.code).unwrap_or(ReplyCode::Unknown)) {
        Some(ReplyCode::Accepted) => Ok("triggered".into()),
        Some(code) => Err(code.sentence().to_owned()),
        None => Err("no answer".into()),
    }
}
