//! Rows of results as protobuf messages and back; every number survives to the last bit.

mod field;
mod impact;
mod rod;
mod sample;

pub(super) use field::Field;
pub(super) use impact::Impact;
pub(super) use sample::{Track, Velocity};

use super::schema::proto;
use crate::results::UnknownName;
use std::collections::BTreeMap;

/// An event: a trigger, a change of state, a loss.
///
/// # Examples
///
/// ```no_run
/// use ricochet::recording::Recording;
///
/// for event in Recording::open("shot.mcap".as_ref())?.events()? {
///     let event = event?;
///     println!("{} ns: {} {}", event.stamp_ns, event.kind, event.text);
/// }
/// # Ok::<(), ricochet::recording::RecordingError>(())
/// ```
pub type EventRow = proto::Event;

/// The state of a process of the rig.
///
/// # Examples
///
/// ```no_run
/// use ricochet::recording::Recording;
///
/// for status in Recording::open("shot.mcap".as_ref())?.statuses()? {
///     let status = status?;
///     for (name, reading) in &status.readings {
///         let reading = reading.map_or("-".into(), |reading| reading.to_string());
///         println!("{}: {name} = {reading}", status.process);
///     }
/// }
/// # Ok::<(), ricochet::recording::RecordingError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct StatusRow {
    /// The time, ns since the Unix epoch.
    pub stamp_ns: u64,
    /// The process: `acquire`, `correlate`, ...
    pub process: String,
    /// Its state in one word.
    pub state: String,
    /// Its numbers, with the unit in each name; `None` where there is none yet.
    pub readings: BTreeMap<String, Option<f64>>,
}

/// A row that a recording can hold.
pub(super) trait Row: Sized {
    /// Its message.
    type Message: prost::Message + Default;

    /// Returns the row as a message.
    fn to_message(&self) -> Self::Message;

    /// Returns the row in a message.
    ///
    /// # Errors
    ///
    /// The reason when the message has an unknown name or number, or parts that do not fit together.
    fn from_message(message: Self::Message) -> Result<Self, String>;
}

/// Returns the reason why a row with an unknown name does not decode.
fn unknown_name(name: UnknownName) -> String {
    name.to_string()
}

impl Row for EventRow {
    type Message = Self;

    fn to_message(&self) -> Self {
        self.clone()
    }

    fn from_message(message: Self) -> Result<Self, String> {
        Ok(message)
    }
}

impl Row for StatusRow {
    type Message = proto::Status;

    fn to_message(&self) -> proto::Status {
        let readings =
            self.readings.iter().map(|(name, value)| proto::Reading { name: name.clone(), value: *value }).collect();
        proto::Status { stamp_ns: self.stamp_ns, process: self.process.clone(), state: self.state.clone(), readings }
    }

    fn from_message(message: proto::Status) -> Result<Self, String> {
        let readings = message.readings.into_iter().map(|reading| (reading.name, reading.value)).collect();
        Ok(Self { stamp_ns: message.stamp_ns, process: message.process, state: message.state, readings })
    }
}
