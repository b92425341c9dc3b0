//! The events of the rig as messages of a log.

use super::{IDLE, stamp_of};
use crate::serve::feed::Feed;
use foxglove::Channel;
use foxglove::messages::{Log, Timestamp, log::Level};
use serde_json::Value;
use tokio::time::{sleep, timeout};

/// The kinds of events after which results are missing.
const ERRORS: [&str; 3] = ["lost", "restarted", "hung"];
/// The kinds of events that may lead to a loss.
const WARNINGS: [&str; 3] = ["camera", "storage", "behind"];

/// Sends the events to the log while anybody watches it, until the topic ends.
pub(super) async fn send_log(log: Channel<Log>, feed: Feed) {
    loop {
        if !log.has_sinks() {
            sleep(IDLE).await;
            continue;
        }
        let mut follower = feed.follow();
        while log.has_sinks() {
            match timeout(IDLE, follower.next()).await {
                Err(_) => {}
                Ok(None) => return,
                Ok(Some(delivery)) => {
                    delivery.batch.rows.iter().filter_map(|row| entry(row)).for_each(|entry| log.log(&entry))
                }
            }
        }
    }
}

/// Returns the message of an event; `None` for a row that is no event.
fn entry(row: &str) -> Option<Log> {
    let event: Value = serde_json::from_str(row).ok()?;
    let (kind, text) = (event["kind"].as_str()?, event["text"].as_str()?);
    let level = match kind {
        kind if ERRORS.contains(&kind) => Level::Error,
        kind if WARNINGS.contains(&kind) => Level::Warning,
        _ => Level::Info,
    };
    let stamp_ns = stamp_of(row)?;
    let seconds = u32::try_from(stamp_ns / 1_000_000_000).ok()?;
    let separator = if text.is_empty() { "" } else { ": " };
    Some(Log {
        timestamp: Some(Timestamp::new(seconds, (stamp_ns % 1_000_000_000) as u32)),
        level: level as i32,
        message: format!("{kind}{separator}{text}"),
        name: "ricochet".into(),
        ..Log::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loss_is_an_error_and_a_trigger_is_none() {
        let row = |kind, text| format!("{{\"frame\":7,\"stamp_ns\":2500000000,\"kind\":{kind:?},\"text\":{text:?}}}");
        let found = entry(&row("lost", "12 frames")).unwrap();
        assert_eq!((found.level, found.message.as_str()), (Level::Error as i32, "lost: 12 frames"));
        assert_eq!(found.timestamp, Some(Timestamp::new(2, 500_000_000)));
        let found = entry(&row("triggered", "")).unwrap();
        assert_eq!((found.level, found.message.as_str()), (Level::Info as i32, "triggered"));
        assert_eq!(entry("{}"), None);
    }
}
