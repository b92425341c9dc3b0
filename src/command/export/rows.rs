//! The rows of every table.

use super::ExportError;
use super::sink::Sink;
use crate::command::rod;
use crate::config::{BodyKind, Config};
use crate::console::progress::Bar;
use crate::recording::{EventRow, Recording, RecordingError};
use crate::report::last_revisions;
use crate::results::{
    Cell, Column, FieldPoint, Heading, Impact, Kind, PairField, PointStatus, Rod, Sample, TrackSample, VelocitySample,
};

/// Returns the number of steps of the progress of a table: each message is read and then written.
pub(super) fn progress_steps(recording: &Recording, topic: &str) -> u64 {
    let topics = recording.topics();
    2 * topics
        .iter()
        .filter(|found| found.topic.strip_prefix('/') == Some(topic))
        .map(|found| found.messages)
        .sum::<u64>()
}

/// Sends the header and the rows of one of [`TABLES`](super::TABLES) to a sink, and the number of [`progress_steps`] to
/// a bar. Any other topic counts as the events.
pub(super) fn send_table(
    recording: &Recording,
    topic: &str,
    table: &mut dyn Sink,
    bar: &Bar,
) -> Result<(), ExportError> {
    match topic {
        "velocity" => send_velocities(recording, read_rows(recording.velocities()?, bar)?, table, bar),
        "truth" => send_velocities(recording, read_rows(recording.truth()?, bar)?, table, bar),
        "track" => send_tracks(recording, table, bar),
        "impact" => send_impacts(recording, read_rows(recording.impacts()?, bar)?, table),
        "truth_impact" => send_impacts(recording, read_rows(recording.truth_impacts()?, bar)?, table),
        "field" => send_fields(recording, table, bar),
        _ => send_events(recording, table),
    }
}

/// Reads all rows of a topic.
fn read_rows<T>(rows: impl Iterator<Item = Result<T, RecordingError>>, bar: &Bar) -> Result<Vec<T>, RecordingError> {
    rows.inspect(|_| bar.inc(1)).collect()
}

/// The recording's first frame, from which tables count frames and seconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Origin {
    frame: u64,
    stamp_ns: u64,
}

impl Origin {
    /// Returns the first frame. A recording without frames has it in its metadata (`first_frame`, `first_stamp_ns`);
    /// if these are missing too, it is that of the first row.
    fn from_recording(recording: &Recording, first_row: Option<Self>) -> Result<Self, RecordingError> {
        if recording.frame_count() > 0 {
            let first = recording.first_frame()?;
            return Ok(Self { frame: first.sequence, stamp_ns: first.stamp_ns });
        }
        let entry = |key| recording.metadata().get(key)?.parse().ok();
        let recorded = entry("first_frame").zip(entry("first_stamp_ns"));
        let recorded = recorded.map(|(frame, stamp_ns)| Self { frame, stamp_ns });
        Ok(recorded.or(first_row).unwrap_or(Self { frame: 0, stamp_ns: 0 }))
    }

    /// Returns the first frame of a recording, with the first of these rows as a fallback.
    fn from_samples<R: Sample>(recording: &Recording, rows: &[R]) -> Result<Self, RecordingError> {
        Self::from_recording(recording, rows.first().map(|row| Self { frame: row.frame(), stamp_ns: row.stamp_ns() }))
    }

    /// Returns the number of a frame, counted from the first.
    fn frame_cell(self, sequence: u64) -> Cell {
        Cell::Integer(i128::from(sequence) - i128::from(self.frame))
    }

    /// Converts a stamp, ns since the Unix epoch, to seconds from the first frame; negative before it.
    fn seconds(self, stamp_ns: u64) -> f64 {
        (i128::from(stamp_ns) - i128::from(self.stamp_ns)) as f64 / 1e9
    }

    /// Returns a time in seconds from the first frame.
    fn time_cell(self, stamp_ns: u64) -> Cell {
        Cell::Double(Some(self.seconds(stamp_ns)))
    }
}

const FRAME: Heading = Heading { name: "frame", kind: Kind::Integer };
const BODY: Heading = Heading { name: "body", kind: Kind::Text };
const STAMP: Heading = Heading { name: "stamp_ns", kind: Kind::Stamp };
const TIME: Heading = Heading { name: "t_s", kind: Kind::Double };

/// Returns the heading of a column with text.
fn text_heading(name: &'static str) -> Heading {
    Heading { name, kind: Kind::Text }
}

/// Returns the heading of a column with numbers.
fn double_heading(name: &'static str) -> Heading {
    Heading { name, kind: Kind::Double }
}

/// Sends the headings: those given, then those of the columns.
fn send_header<R>(first: &[Heading], columns: &[Column<R>], table: &mut dyn Sink) -> Result<(), ExportError> {
    table.write_header(&first.iter().copied().chain(columns.iter().map(|column| column.heading)).collect::<Vec<_>>())
}

/// Sends a row: the cells given, then those of the columns.
fn send_row<R>(first: Vec<Cell>, row: &R, columns: &[Column<R>], table: &mut dyn Sink) -> Result<(), ExportError> {
    table.write_row(first.into_iter().chain(columns.iter().map(|column| (column.cell)(row))).collect())
}

/// Sends velocity rows, by frame and body.
fn send_velocities(
    recording: &Recording,
    mut rows: Vec<VelocitySample>,
    table: &mut dyn Sink,
    bar: &Bar,
) -> Result<(), ExportError> {
    rows.sort_by_key(|row| (row.frame, row.body));
    let origin = Origin::from_samples(recording, &rows)?;
    send_header(&[FRAME, BODY, STAMP, TIME], VelocitySample::COLUMNS, table)?;
    for row in &rows {
        let place = vec![
            origin.frame_cell(row.frame),
            Cell::Text(recording.body_name(row.body)),
            Cell::Stamp(row.stamp_ns),
            origin.time_cell(row.stamp_ns),
        ];
        send_row(place, row, VelocitySample::COLUMNS, table)?;
        bar.inc(1);
    }
    Ok(())
}

/// Sends track rows, by frame and body; with the columns of rods if the rig follows any.
fn send_tracks(recording: &Recording, table: &mut dyn Sink, bar: &Bar) -> Result<(), ExportError> {
    let mut rows: Vec<TrackSample> = read_rows(recording.tracks()?, bar)?;
    rows.sort_by_key(|row| (row.frame, row.body));
    let origin = Origin::from_samples(recording, &rows)?;
    let has_rods = has_rods(recording) || rows.iter().any(|row| row.rod.is_some());
    let rod_headings = if has_rods { rod_headings() } else { Vec::new() };
    send_header(&[&[FRAME, BODY, TIME], &rod_headings[..]].concat(), TrackSample::COLUMNS, table)?;
    for row in &rows {
        let mut place = vec![
            origin.frame_cell(row.frame),
            Cell::Text(recording.body_name(row.body)),
            origin.time_cell(row.stamp_ns),
        ];
        if has_rods {
            place.extend(rod_cells(row.rod.as_ref()));
        }
        send_row(place, row, TrackSample::COLUMNS, table)?;
        bar.inc(1);
    }
    Ok(())
}

/// Whether the rig follows rods, which have columns of their own, seen or not.
fn has_rods(recording: &Recording) -> bool {
    let config = recording.config_toml().and_then(|text| Config::parse(text, "config.toml").ok());
    config.is_some_and(|config| config.bodies.iter().any(|body| body.kind == BodyKind::Rod))
}

/// Returns the headings of the columns of a rod.
fn rod_headings() -> Vec<Heading> {
    let numbers = rod::number_cells(None).into_iter().map(|(name, _)| double_heading(name));
    numbers.chain(rod::status_cells(None).into_iter().map(|(name, _)| text_heading(name))).collect()
}

/// Returns the cells of the columns of a rod; empty without one.
fn rod_cells(rod: Option<&Rod>) -> impl Iterator<Item = Cell> {
    let status = |status: Option<PointStatus>| Cell::Text(status.map_or("", PointStatus::as_str).into());
    let numbers = rod::number_cells(rod).into_iter().map(|(_, number)| Cell::Double(number));
    numbers.chain(rod::status_cells(rod).into_iter().map(move |(_, of_edge)| status(of_edge)))
}

/// Sends the fields with those of one frame in memory at a time.
fn send_fields(recording: &Recording, table: &mut dyn Sink, bar: &Bar) -> Result<(), ExportError> {
    let mut fields = recording.fields()?.peekable();
    let first = fields.peek().and_then(|field| field.as_ref().ok());
    let first = first.map(|field| Origin { frame: field.frame, stamp_ns: field.stamp_ns });
    let origin = Origin::from_recording(recording, first)?;
    send_header(&[FRAME], FieldPoint::COLUMNS, table)?;
    let mut frame: Vec<PairField> = Vec::new();
    for field in fields {
        let field = field?;
        bar.inc(2);
        if frame.first().is_some_and(|first| first.stamp_ns != field.stamp_ns) {
            send_frame_fields(origin, &mut frame, table)?;
        }
        frame.push(field);
    }
    send_frame_fields(origin, &mut frame, table)
}

/// Sends the fields of one frame, by body, those over the shortest interval only, and clears them.
fn send_frame_fields(origin: Origin, fields: &mut Vec<PairField>, table: &mut dyn Sink) -> Result<(), ExportError> {
    fields.sort_by_key(|field| (field.frame, field.body, field.target_frame));
    // The table has no column for the interval: it holds the shortest one.
    fields.dedup_by_key(|field| (field.frame, field.body));
    for field in fields.drain(..) {
        for point in &field.points {
            send_row(vec![origin.frame_cell(field.frame)], point, FieldPoint::COLUMNS, table)?;
        }
    }
    Ok(())
}

/// Sends the last revision of each impact. Moments count from the recording's first frame.
fn send_impacts(recording: &Recording, rows: Vec<Impact>, table: &mut dyn Sink) -> Result<(), ExportError> {
    let rows = last_revisions(rows);
    let first = rows.first().map(|row| Origin { frame: 0, stamp_ns: row.origin_ns });
    let (origin, columns) = (Origin::from_recording(recording, first)?, Impact::table());
    send_header(&[BODY], &columns, table)?;
    for row in rows {
        let body = Cell::Text(recording.body_name(row.body));
        send_row(vec![body], &row.shifted(origin.seconds(row.origin_ns)), &columns, table)?;
    }
    Ok(())
}

/// Sends the events in the order of the recording.
fn send_events(recording: &Recording, table: &mut dyn Sink) -> Result<(), ExportError> {
    let rows: Vec<EventRow> = recording.events()?.collect::<Result<_, _>>()?;
    let first = rows.first().map(|row| Origin { frame: 0, stamp_ns: row.stamp_ns });
    let origin = Origin::from_recording(recording, first)?;
    table.write_header(&[STAMP, TIME, text_heading("kind"), text_heading("text")])?;
    for row in rows {
        let time = origin.time_cell(row.stamp_ns);
        table.write_row(vec![Cell::Stamp(row.stamp_ns), time, Cell::Text(row.kind), Cell::Text(row.text)])?;
    }
    Ok(())
}
