//! The commands that reach the rig of another host: its topics, its state and its control.

use super::super::control::{RigOptions, TriggerOptions, report};
use super::super::listen::{ListenOptions, Printer};
use super::super::status::StatusOptions;
use super::error::{BridgeError, RemoteError};
use super::publish::OTHER_ROWS;
use super::session::{CONTROL, Side, key, open};
use super::succession::Succession;
use crate::bus::Topic;
use crate::console::{Outcome, UsageError, print_line, print_note};
use crate::failure::{ExitCode, Failure};
use crate::message::{Command, Event, EventKind, TrackMessage, VelocityMessage};
use crate::process::Stop;
use serde_json::{Map, Value};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;
use zenoh::sample::Sample;
use zenoh::session::EntityGlobalId;
use zenoh::{Session, Wait};
use zenoh_ext::{AdvancedSubscriberBuilderExt, HistoryConfig, RecoveryConfig};

/// The topics that a bridge publishes as rows.
const TOPICS: [&str; 5] = ["velocity", "track", "impact", "status", "events"];
/// The maximum wait for the reply to a request. A recording may take as long as its shot.
const PATIENCE: Duration = Duration::from_secs(600);
/// Interval of looking for a request to stop.
const PAUSE: Duration = Duration::from_millis(100);
/// The number of looks without a row after the end of the stream, within which rows that were missed are fetched.
const LAST_LOOKS: u32 = 10;

/// Sends a request to the rig of another host and returns its reply.
///
/// # Errors
///
/// [`BridgeError`] when the host is not reached, [`UsageError`] when no such rig is there, and the error of the rig.
fn ask(via: &str, rig: &str, request: &str) -> Result<Value, Failure> {
    let session = open(via, Side::Remote)?;
    require_bridge(&session, via, rig, 0)?;
    let fail = |source: &dyn std::fmt::Display| BridgeError::new("ask", via, source);
    let selector = format!("{}?command={request}", key(rig, CONTROL));
    let replies = session.get(&selector).timeout(PATIENCE).wait().map_err(|error| fail(&error))?;
    let reply = replies.recv().map_err(|_| fail(&"no reply"))?;
    match reply.result() {
        Ok(sample) => serde_json::from_slice(&sample.payload().to_bytes()).map_err(|error| fail(&error).into()),
        Err(refusal) => Err(remote_error(&refusal.payload().to_bytes()).into()),
    }
}

/// Sends a command to the rig of another host and prints the reply.
///
/// # Errors
///
/// [`BridgeError`] when the host is not reached, [`UsageError`] when no such rig is there or it refuses.
pub fn command(options: &RigOptions, command: Command, via: &str) -> Result<Outcome, Failure> {
    report(options, &ask(via, &options.rig, command.as_str())?)
}

/// Triggers a recording at another host, and waits for it if that is wanted.
///
/// # Errors
///
/// Those of [`command`], or when the rig ends without a recording.
pub fn trigger(options: &TriggerOptions, via: &str) -> Result<Outcome, Failure> {
    let wait = if options.wait { ";wait" } else { "" };
    report(&options.rig, &ask(via, &options.rig.rig, &format!("{}{wait}", Command::Trigger.as_str()))?)
}

/// Prints the state of the rig of another host.
///
/// # Errors
///
/// Those of [`command`].
pub fn status(options: &StatusOptions, via: &str) -> Result<Outcome, Failure> {
    let reply = ask(via, options.rig.as_deref().unwrap_or("rig"), "status")?;
    print_line(reply[if options.json { "json" } else { "table" }].as_str().unwrap_or_default());
    Ok(Outcome::Clean)
}

/// Prints a topic of the rig of another host until its stream ends, `count` is reached or a stop is requested.
///
/// Rows that were missed while the link was away are fetched. Those that no cache has any more are counted and reported.
///
/// # Errors
///
/// [`UsageError`] when there is no such topic or rig, [`BridgeError`] when the host is not reached.
pub fn listen(options: &ListenOptions, via: &str, stop: &Stop) -> Result<Outcome, Failure> {
    let (rig, topic) = (options.rig.as_str(), options.topic.as_str());
    if !TOPICS.contains(&topic) {
        return Err(UsageError(format!("topic {topic:?} is not one of {} of another host", TOPICS.join(", "))).into());
    }
    let session = open(via, Side::Remote)?;
    require_bridge(&session, via, rig, (options.wait_s.max(0.0) * 1000.0 / PAUSE.as_millis() as f64) as u64)?;
    let fail = |error: zenoh::Error| BridgeError::new("listen", via, &error);
    let is_over = watch_end(&session, rig).map_err(fail)?;
    let (sender, rows) = channel();
    let of_frames = [VelocityMessage::NAME, TrackMessage::NAME].contains(&topic);
    let late_rows = if of_frames { 1 } else { OTHER_ROWS };
    let subscriber = session
        .declare_subscriber(key(rig, topic))
        .callback(move |sample: Sample| {
            let bridge = sample.source_info().map(|info| *info.source_id());
            drop(sender.send(RemoteRow { bridge, text: sample.payload().to_bytes().into_owned() }));
        })
        // Without the detection of late publishers: it takes a bridge whose router is back for one, fetches the newest
        // rows alone, and gives up those before.
        .history(HistoryConfig::default().max_samples(late_rows))
        .recovery(RecoveryConfig::default().heartbeat())
        .wait()
        .map_err(fail)?;
    let lost = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&lost);
    let _misses = subscriber
        .sample_miss_listener()
        .callback(move |miss| {
            count.fetch_add(u64::from(miss.nb()), Ordering::Relaxed);
            print_note(&format!("ricochet: {} rows were lost on the way", miss.nb()));
        })
        .wait()
        .map_err(fail)?;
    let bridges = print_rows(Printer::new(options), &rows, &is_over, stop);
    let count = lost.load(Ordering::Relaxed) + bridges.frames_between;
    let mut cause = format!("rows of {topic} on the way from {via}");
    if bridges.restarts > 0 {
        cause += &format!(
            "; the bridge was started again {} times, and rows of {} frames came while there was none",
            bridges.restarts, bridges.frames_between
        );
    }
    Ok(match count {
        0 if bridges.restarts == 0 => Outcome::Clean,
        _ => Outcome::Lost { count, cause: Some(cause) },
    })
}

/// A row of a topic and the bridge that published it.
struct RemoteRow {
    bridge: Option<EntityGlobalId>,
    text: Vec<u8>,
}

/// The bridges that a reader has lost.
#[derive(Debug, Default)]
struct LostBridges {
    /// The number of bridges that took the place of another one.
    restarts: u64,
    /// The number of frames whose rows no bridge published.
    frames_between: u64,
}

/// Prints rows until the stream is over, enough are printed or a stop is requested. Returns the bridges that were lost.
fn print_rows(mut printer: Printer, rows: &Receiver<RemoteRow>, is_over: &AtomicBool, stop: &Stop) -> LostBridges {
    let mut lost = LostBridges::default();
    let mut succession = Succession::new();
    let mut looks = 0;
    while !stop.requested() && looks < LAST_LOOKS {
        match rows.recv_timeout(PAUSE) {
            Ok(RemoteRow { bridge, text }) => {
                looks = 0;
                let Ok(row) = serde_json::from_slice::<Map<String, Value>>(&text) else { continue };
                if let Some(frames) = bridge.and_then(|bridge| succession.add(bridge, &row)) {
                    lost.restarts += 1;
                    lost.frames_between += frames;
                    print_note(&format!("ricochet: the bridge was started again; rows of {frames} frames are lost"));
                }
                if !printer.print(&row) {
                    break;
                }
            }
            Err(RecvTimeoutError::Timeout) => looks += u32::from(is_over.load(Ordering::Relaxed)),
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    lost
}

/// Returns a flag that is set when the stream of the rig ends, also if that happens while the link is away.
fn watch_end(session: &Session, rig: &str) -> zenoh::Result<Arc<AtomicBool>> {
    let is_over = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&is_over);
    let is_first = AtomicBool::new(true);
    let note = move |sample: Sample| {
        // The newest event before this reader came, which is about an earlier stream if it is the end of one.
        if is_first.swap(false, Ordering::Relaxed) {
            return;
        }
        let row: Value = serde_json::from_slice(&sample.payload().to_bytes()).unwrap_or_default();
        match row["kind"].as_str() {
            Some(kind) if kind == EventKind::Tracked.as_str() => flag.store(true, Ordering::Relaxed),
            Some(kind) if kind == EventKind::Prepared.as_str() => flag.store(false, Ordering::Relaxed),
            _ => {}
        }
    };
    session
        .declare_subscriber(key(rig, Event::NAME))
        .callback(note)
        .history(HistoryConfig::default().max_samples(1))
        .recovery(RecoveryConfig::default().heartbeat())
        .background()
        .wait()?;
    Ok(is_over)
}

/// Waits until a bridge of the rig is there, for `tries` more looks at most.
///
/// # Errors
///
/// [`UsageError`] when there is none, [`BridgeError`] when the session fails.
fn require_bridge(session: &Session, via: &str, rig: &str, tries: u64) -> Result<(), Failure> {
    for left in (0..=tries).rev() {
        let tokens = session.liveliness().get(key(rig, "bridge")).wait();
        let tokens = tokens.map_err(|error| BridgeError::new("connect", via, &error))?;
        if tokens.recv().is_ok() {
            return Ok(());
        }
        if left > 0 {
            std::thread::sleep(PAUSE);
        }
    }
    let text = format!("no bridge of rig {rig:?} at {via}; `ricochet bridge` on its host starts one");
    Err(UsageError(text).into())
}

/// Reads the error of a rig.
fn remote_error(payload: &[u8]) -> RemoteError {
    let error: Value = serde_json::from_slice(payload).unwrap_or_default();
    RemoteError {
        text: error["error"].as_str().unwrap_or("the rig refused without a reason").to_owned(),
        code: error["exit_code"].as_i64().and_then(|code| i32::try_from(code).ok()).unwrap_or(ExitCode::Bus as i32),
    }
}
