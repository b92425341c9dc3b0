//! `ricochet listen`: prints a live topic.

use super::{json_cells, rod};
use crate::bus::{Bus, BusError, Subscriber, Topic};
use crate::console::{Outcome, UsageError, print_line};
use crate::failure::Failure;
use crate::message::{
    Event, EventKind, FieldHeader, ImpactMessage, Role, StatusMessage, TrackMessage, VelocityMessage,
};
use crate::process::Stop;
use crate::results::{FieldPoint, Impact, PairField, PointStatus, Sample, TrackSample, VelocitySample};
use serde_json::{Map, Value, json};
use std::time::Duration;

/// The pause between two looks for messages.
const PAUSE: Duration = Duration::from_millis(1);
/// The topics that can be printed.
const TOPICS: &str = "field, track, velocity, impact, status, events";

/// The options of `listen`.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub struct ListenOptions {
    /// Topic: field, track, velocity, impact, status or events.
    pub topic: String,
    /// Name of the rig.
    #[arg(long, default_value = "rig")]
    pub rig: String,
    /// Print one JSON object per line.
    #[arg(long)]
    pub json: bool,
    /// Stop after this many lines.
    #[arg(long)]
    pub count: Option<u64>,
    /// Wait at most this long for a rig that is not running yet, s.
    #[arg(long = "wait", default_value_t = 0.0, value_name = "SECONDS")]
    pub wait_s: f64,
    /// The rig of another host.
    #[cfg(feature = "zenoh")]
    #[command(flatten)]
    pub remote: super::via::RemoteOptions,
}

/// Prints messages as they arrive, until the rig's stream ends, `count` is reached or a stop is requested.
///
/// # Errors
///
/// [`UsageError`] when there is no such topic, [`BusError::NoRig`] when there is no such rig.
pub fn run(options: &ListenOptions, stop: &Stop) -> Result<Outcome, Failure> {
    if !TOPICS.split(", ").any(|topic| topic == options.topic) {
        return Err(UsageError(format!("topic {:?} is not one of {TOPICS}", options.topic)).into());
    }
    let bus = Bus::join(&options.rig, "listen")?;
    wait_for_rig(&bus, options, stop)?;
    let mut printer = Printer::new(options);
    let mut follow =
        |next_rows: &mut dyn FnMut() -> Result<Option<Rows>, BusError>| follow(&bus, &mut printer, stop, next_rows);
    match options.topic.as_str() {
        "track" => follow(&mut rows_of(bus.listen()?, track_row)),
        "velocity" => follow(&mut rows_of(bus.listen()?, velocity_row)),
        "impact" => follow(&mut rows_of(bus.listen()?, impact_row)),
        "status" => follow(&mut rows_of(bus.listen()?, status_row)),
        "events" => follow(&mut rows_of(bus.listen()?, event_row)),
        _ => {
            let fields = bus.listen_field()?;
            follow(&mut || Ok(fields.take()?.map(|(header, field)| field_rows(&header, field))))
        }
    }
}

/// Waits up to `wait_s` until the rig has its topics, or a stop is requested.
///
/// # Errors
///
/// [`BusError::NoRig`] when there is still no such rig.
fn wait_for_rig(bus: &Bus, options: &ListenOptions, stop: &Stop) -> Result<(), BusError> {
    let mut tries = (options.wait_s.max(0.0) * 1000.0 / 20.0) as u64;
    loop {
        match bus.listen::<Event>() {
            Err(BusError::NoRig { .. }) if tries > 0 && !stop.requested() => {
                tries -= 1;
                std::thread::sleep(Duration::from_millis(20));
            }
            Err(error) => return Err(error),
            Ok(_) => return Ok(()),
        }
    }
}

/// Detects the end of the stream of a rig.
struct Watch<'a> {
    bus: &'a Bus,
    events: Subscriber<Event>,
    /// The number of calls until the next check of the processes.
    calls_left: u32,
}

impl<'a> Watch<'a> {
    /// The number of calls between checks of the processes, about half a second.
    const CALLS: u32 = 400;

    /// Starts to listen for the events of the rig.
    fn new(bus: &'a Bus) -> Result<Self, BusError> {
        Ok(Self { bus, events: bus.listen()?, calls_left: Self::CALLS })
    }

    /// Takes all events that have arrived and returns whether the stream has ended.
    ///
    /// # Errors
    ///
    /// [`BusError::Died`] when no process is left that could announce the end.
    fn detect_end(&mut self) -> Result<bool, BusError> {
        self.calls_left -= 1;
        let is_check = self.calls_left == 0;
        self.calls_left = if is_check { Self::CALLS } else { self.calls_left };
        let is_dead = is_check && !self.bus.is_alive();
        let mut over = false;
        while let Some(event) = self.events.take()? {
            over = match event.kind() {
                Some(EventKind::Tracked) => true,
                Some(EventKind::Prepared) => false,
                _ => over,
            };
        }
        if is_dead && !over {
            return Err(BusError::Died { rig: self.bus.rig().to_owned() });
        }
        Ok(over)
    }
}

/// The rows of one message.
type Rows = Vec<Map<String, Value>>;

/// Returns a function that takes the next message of a topic and returns its rows; `None` while there is none.
///
/// A message with an unknown number in place of a name has no row.
fn rows_of<T: Topic>(
    topic: Subscriber<T>,
    row: fn(&T) -> Option<Map<String, Value>>,
) -> impl FnMut() -> Result<Option<Rows>, BusError> {
    move || Ok(topic.take()?.map(|message| row(&message).into_iter().collect()))
}

/// Prints the rows of a topic until its stream ends, enough rows are printed, or a stop is requested.
fn follow(
    bus: &Bus,
    printer: &mut Printer,
    stop: &Stop,
    next_rows: &mut dyn FnMut() -> Result<Option<Rows>, BusError>,
) -> Result<Outcome, Failure> {
    let mut watch = Watch::new(bus)?;
    while !stop.requested() {
        // Checked before the topic is read for the last time, so that no message before the end is missed.
        let over = watch.detect_end()?;
        while let Some(rows) = next_rows()? {
            if !rows.iter().all(|row| printer.print(row)) {
                return Ok(Outcome::Clean);
            }
        }
        if over {
            break;
        }
        std::thread::sleep(PAUSE);
    }
    Ok(Outcome::Clean)
}

/// Prints rows as CSV or as one JSON object per line.
pub(super) struct Printer {
    json: bool,
    /// The number of rows still to print; `None` without a limit.
    left: Option<u64>,
    /// The columns of the last CSV header that was printed.
    columns: Vec<String>,
}

impl Printer {
    /// Creates a printer that has printed nothing.
    pub(super) fn new(options: &ListenOptions) -> Self {
        Self { json: options.json, left: options.count, columns: Vec::new() }
    }

    /// Prints a row and returns whether more are wanted.
    ///
    /// The CSV header has the columns of the first row. A row with others, as of a rod after a ball, prints a header
    /// again; a column that a row lacks is empty.
    pub(super) fn print(&mut self, row: &Map<String, Value>) -> bool {
        if self.left == Some(0) {
            return false;
        }
        if self.json {
            print_line(&Value::Object(row.clone()).to_string());
        } else {
            if self.add_columns(row) {
                print_line(&self.columns.join(","));
            }
            let cells = self.columns.iter().map(|column| row.get(column).map_or_else(String::new, csv_cell));
            print_line(&cells.collect::<Vec<_>>().join(","));
        }
        self.left = self.left.map(|left| left - 1);
        self.left != Some(0)
    }

    /// Takes over the columns of a row unless all of them are known, and returns whether it did.
    fn add_columns(&mut self, row: &Map<String, Value>) -> bool {
        let is_new = row.keys().any(|column| !self.columns.contains(column));
        if is_new {
            self.columns = row.keys().cloned().collect();
        }
        is_new
    }
}

/// Formats a value as a cell of a CSV line (RFC 4180); empty for null.
fn csv_cell(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) if text.contains([',', '"', '\n', '\r']) => format!("\"{}\"", text.replace('"', "\"\"")),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

/// Returns a row of named cells in their order.
fn row_from_cells(cells: impl IntoIterator<Item = (&'static str, Value)>) -> Map<String, Value> {
    cells.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

/// Returns the cells of frame, body and time that a row starts with.
fn frame_cells<R: Sample>(row: &R) -> impl Iterator<Item = (&'static str, Value)> {
    [("frame", json!(row.frame())), ("body", json!(row.body())), ("stamp_ns", json!(row.stamp_ns()))].into_iter()
}

/// Returns the row of a track message, with the columns of a rod if the body is one.
pub(super) fn track_row(message: &TrackMessage) -> Option<Map<String, Value>> {
    let sample = message.sample()?;
    let of_rod = sample.rod.as_ref().map(|of_rod| {
        let numbers = rod::number_cells(Some(of_rod)).into_iter().map(|(name, number)| (name, json!(number)));
        let statuses = rod::status_cells(Some(of_rod)).into_iter();
        numbers.chain(statuses.map(|(name, status)| (name, json!(status.map(PointStatus::as_str)))))
    });
    Some(row_from_cells(
        frame_cells(&sample).chain(of_rod.into_iter().flatten()).chain(json_cells(&sample, TrackSample::COLUMNS)),
    ))
}

/// Returns the row of a velocity message.
pub(super) fn velocity_row(message: &VelocityMessage) -> Option<Map<String, Value>> {
    let sample = message.sample()?;
    Some(row_from_cells(frame_cells(&sample).chain(json_cells(&sample, VelocitySample::COLUMNS))))
}

/// Returns the row of an impact message, each number next to its uncertainty.
pub(super) fn impact_row(message: &ImpactMessage) -> Option<Map<String, Value>> {
    let impact = message.impact()?;
    let place = [
        ("body", json!(impact.body)),
        ("number", json!(impact.number)),
        ("revision", json!(impact.revision)),
        ("origin_ns", json!(impact.origin_ns)),
    ];
    Some(row_from_cells(place.into_iter().chain(json_cells(&impact, &Impact::json_columns()))))
}

/// Returns the row of a status message.
pub(super) fn status_row(message: &StatusMessage) -> Option<Map<String, Value>> {
    Some(row_from_cells([
        ("process", json!(Role::from_number(message.role).map(Role::as_str))),
        ("index", json!(message.index)),
        ("pid", json!(message.pid)),
        ("sequence", json!(message.sequence)),
        ("taken", json!(message.taken)),
        ("given", json!(message.given)),
        ("lost", json!(message.lost)),
        ("dropped", json!(message.dropped)),
        ("restarts", json!(message.restarts)),
        ("rate_hz", json!(message.rate_hz)),
        ("latency_s", json!(message.latency_s)),
        ("row_latency_median_s", json!(message.row_latency_median_s)),
        ("row_latency_p99_s", json!(message.row_latency_p99_s)),
        ("row_latency_p999_s", json!(message.row_latency_p999_s)),
        ("row_latency_max_s", json!(message.row_latency_max_s)),
        ("row_latency_deviation_s", json!(message.row_latency_deviation_s)),
    ]))
}

/// Returns the row of an event.
pub(super) fn event_row(message: &Event) -> Option<Map<String, Value>> {
    Some(row_from_cells([
        ("stamp_ns", json!(message.stamp_ns)),
        ("frame", json!(message.sequence)),
        ("kind", json!(message.kind().map(EventKind::as_str))),
        ("text", json!(message.text())),
    ]))
}

/// Returns a row per subset of a field; none for a message without one.
fn field_rows(header: &FieldHeader, field: Option<PairField>) -> Rows {
    let row = |point| {
        row_from_cells([("frame", json!(header.sequence))].into_iter().chain(json_cells(point, FieldPoint::COLUMNS)))
    };
    field.iter().flat_map(|field| &field.points).map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_with_other_columns_needs_a_header() {
        let mut printer = Printer { json: false, left: None, columns: Vec::new() };
        let row = |names: &[&'static str]| row_from_cells(names.iter().map(|name| (*name, json!(1))));
        assert!(printer.add_columns(&row(&["frame", "x_px"])));
        assert!(printer.add_columns(&row(&["frame", "length_px", "x_px"])));
        // A lost rod has no length: its cell is empty.
        assert!(!printer.add_columns(&row(&["frame", "x_px"])));
        assert_eq!(printer.columns, ["frame", "length_px", "x_px"]);
    }

    #[test]
    fn texts_with_separators_are_quoted() {
        assert_eq!(csv_cell(&json!("ball 1")), "ball 1");
        assert_eq!(csv_cell(&json!("ball, \"red\"")), "\"ball, \"\"red\"\"\"");
        assert_eq!(csv_cell(&Value::Null) + &csv_cell(&json!(1.5)), "1.5");
    }
}
