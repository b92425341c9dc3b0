//! The bridges of a rig that follow each other, and the rows that a bridge which died took along.

use serde_json::{Map, Value};

/// The rows that a reader takes from bridges `S` that follow each other.
///
/// Zenoh numbers the rows of each bridge from 0, so it does not notice what no bridge published.
#[derive(Debug)]
pub(super) struct Succession<S> {
    bridge: Option<S>,
    /// The newest frame of any row, for topics with frames.
    newest_frame: Option<u64>,
}

impl<S: PartialEq> Succession<S> {
    /// Begins before the first row.
    pub(super) fn new() -> Self {
        Self { bridge: None, newest_frame: None }
    }

    /// Adds a row of a bridge. If another bridge published the row before, returns the number of frames between them,
    /// which is 0 for topics without frames.
    pub(super) fn add(&mut self, bridge: S, row: &Map<String, Value>) -> Option<u64> {
        let frame = row.get("frame").and_then(Value::as_u64);
        let between = frame.zip(self.newest_frame).map_or(0, |(frame, newest)| frame.saturating_sub(newest + 1));
        self.newest_frame = self.newest_frame.max(frame);
        let is_successor = self.bridge.as_ref().is_some_and(|before| *before != bridge);
        self.bridge = Some(bridge);
        is_successor.then_some(between)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn frames_between_two_bridges_are_counted_once() {
        let mut succession = Succession::new();
        let mut add = |bridge: u32, row: Value| succession.add(bridge, row.as_object().unwrap());
        assert_eq!(add(1, json!({ "frame": 7, "body": 0 })), None);
        // Within a bridge Zenoh counts.
        assert_eq!(add(1, json!({ "frame": 9, "body": 0 })), None);
        assert_eq!(add(2, json!({ "frame": 15, "body": 0 })), Some(5));
        assert_eq!(add(2, json!({ "frame": 16, "body": 0 })), None);
        // The next one begins with the newest rows of the rig.
        assert_eq!(add(3, json!({ "frame": 14, "body": 0 })), Some(0));
    }
}
