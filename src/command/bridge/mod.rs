//! `ricochet bridge`: the topics and the control of a rig for other hosts, by Zenoh.
//!
//! Keys are `ricochet/RIG/velocity`, `track`, `impact`, `status` and `events`, with the rows of `ricochet listen --json`, and
//! `ricochet/RIG/preview`, small JPEG pictures. Frames stay on their host. Each topic is published with sequence numbers and a
//! cache, so a reader fetches what it missed while a link or router was away, and counts what no cache has any more. A late
//! reader gets the cached rows of impacts, events and status, and the newest velocity.

mod error;
mod overflow;
mod preview;
mod publish;
mod remote;
mod session;
mod succession;

pub use remote::{command, listen, status, trigger};

use super::control::{Waiting, execute};
use super::rig::load;
use super::status::describe;
use crate::config::Config;
use crate::console::{Outcome, UsageError, print_line};
use crate::failure::Failure;
use crate::message::Command;
use crate::process::Stop;
use error::BridgeError;
use serde_json::{Value, json};
use session::{CONTROL, Side, key, open};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::Duration;
use zenoh::Wait;
use zenoh::query::Query;

/// The maximum number of requests at a time. A trigger that waits for its recording may last.
const MAX_REQUESTS: usize = 16;
/// Interval of looking for a request to stop.
const PAUSE: Duration = Duration::from_millis(50);

/// The options of `ricochet bridge`.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct BridgeOptions {
    /// Rig file.
    pub config: PathBuf,
}

/// Publishes the topics of a rig and answers requests until a stop is requested. The rig may start and end meanwhile.
///
/// # Errors
///
/// [`UsageError`] when the rig file has no bridge, [`BridgeError`] when Zenoh cannot listen.
pub fn run(options: &BridgeOptions, stop: &Stop) -> Result<Outcome, Failure> {
    let config = load(&options.config, None)?;
    let Some(place) = &config.bridge.zenoh else {
        let origin = &config.origin;
        return Err(
            UsageError(format!("{origin}: no bridge: bridge.zenoh = \"tcp/127.0.0.1:7447\" sets one up")).into()
        );
    };
    let rig = config.rig.name.as_str();
    let session = open(place, Side::Rig)?;
    let fail = |source: zenoh::Error| BridgeError::new("publish", place, &source);
    let requests = Arc::new(AtomicUsize::new(0));
    let desk = Desk { config: config.clone(), stop: stop.clone(), requests };
    let _control =
        session.declare_queryable(key(rig, CONTROL)).callback(move |query| desk.answer(query)).wait().map_err(fail)?;
    let overwritten = Arc::new(AtomicU64::new(0));
    let topics = publish::start(&session, rig, stop, &overwritten).map_err(fail)?;
    let preview = preview::start(&session, rig, stop).map_err(fail)?;
    // Declared last: a reader that sees it finds everything else.
    let _presence = session.liveliness().declare_token(key(rig, "bridge")).wait().map_err(fail)?;
    print_line(&format!("zenoh: {place}, ricochet/{rig}/velocity and others"));
    while !stop.requested() {
        std::thread::sleep(PAUSE);
    }
    for thread in topics.into_iter().chain([preview]) {
        thread.join().map_err(|_| Failure::internal("a topic of the bridge ended"))?;
    }
    session.close().wait().map_err(fail)?;
    let count = overwritten.load(Ordering::Relaxed);
    let cause = "frames whose rows the bridge was too slow to publish".to_owned();
    Ok(if count == 0 { Outcome::Clean } else { Outcome::Lost { count, cause: Some(cause) } })
}

/// The requests of other hosts.
#[derive(Clone)]
struct Desk {
    config: Config,
    stop: Stop,
    /// The number of requests that are being answered.
    requests: Arc<AtomicUsize>,
}

impl Desk {
    /// Answers a request on a thread of its own: `command` is `status`, `arm`, `disarm` or `trigger`, perhaps with `wait`.
    fn answer(&self, query: Query) {
        if self.requests.fetch_add(1, Ordering::Relaxed) >= MAX_REQUESTS {
            self.requests.fetch_sub(1, Ordering::Relaxed);
            reply(&query, Err(UsageError(format!("the bridge is answering {MAX_REQUESTS} requests")).into()));
            return;
        }
        let desk = self.clone();
        std::thread::spawn(move || {
            reply(&query, desk.result(&query));
            desk.requests.fetch_sub(1, Ordering::Relaxed);
        });
    }

    /// Returns the reply to a request.
    fn result(&self, query: &Query) -> Result<Value, Failure> {
        let rig = &self.config.rig.name;
        let command = match query.parameters().get("command") {
            Some("status") => return describe(rig).map(|(json, table)| json!({ "json": json, "table": table })),
            Some("arm") => Command::Arm,
            Some("disarm") => Command::Disarm,
            Some("trigger") => Command::Trigger,
            _ => return Err(UsageError("the request is not one of status, arm, disarm, trigger".into()).into()),
        };
        if !self.config.bridge.control {
            let text = format!("rig {rig:?} takes no commands of other hosts: bridge.control is false in its rig file");
            return Err(UsageError(text).into());
        }
        let waiting = if query.parameters().contains_key("wait") { Waiting::ForRecording } else { Waiting::No };
        execute(rig, command, waiting, &self.stop)
    }
}

/// Sends a reply, or an error with its exit code.
fn reply(query: &Query, result: Result<Value, Failure>) {
    let sent = match result {
        Ok(answer) => query.reply(query.key_expr(), answer.to_string()).wait(),
        Err(failure) => {
            let error = json!({ "error": failure.to_string(), "exit_code": failure.exit_code() as i32 });
            query.reply_err(error.to_string()).wait()
        }
    };
    if let Err(error) = sent {
        log::warn!("a request of another host was not answered: {error}");
    }
}
