//! The rows of every table.

use super::ExportError;
use super::sink::Sink;
use crate::command::rod;
use crate::config::{BodyKind, Config};
use crate::recording::{EventRow, Recording, RecordingError};
use crate::report::last_revisions;
use crate::results::{
    Cell, Column, FieldPoint, Heading, Impact, Kind, PairField, PointStatus, Rod, Sample, TrackSample, VelocitySample,
};

/// Sends the rows of one of the tables to a sink.
pub(super) fn send(recording: &Recording, topic: &str, table: &mut dyn Sink) -> Result<(), ExportError> {
    match topic {
        "velocity" => velocity(recording, recording.velocities()?.collect::<Result<_, _>>()?, table),
        "truth" => velocity(recording, recording.truth()?.collect::<Result<_, _>>()?, table),
        "track" => track(recording, table),
        "impact" => impact(recording, recording.impacts()?.collect::<Result<_, _>>()?, table),
        "truth_impact" => impact(recording, recording.truth_impacts()?.collect::<Result<_, _>>()?, table),
        "field" => field(recording, table),
        _ => events(recording, table),
    }
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
    fn of(recording: &Recording, first_row: Option<Self>) -> Result<Self, RecordingError> {
        if recording.frame_count() > 0 {
            let first = recording.first_frame()?;
            return Ok(Self { frame: first.sequence, stamp_ns: first.stamp_ns });
        }
        let entry = |key| recording.metadata().get(key)?.parse().ok();
        let recorded = entry("first_frame").zip(entry("first_stamp_ns"));
        let recorded = recorded.map(|(frame, stamp_ns)| Self { frame, stamp_ns });
        Ok(recorded.or(first_row).unwrap_or(Self { frame: 0, stamp_ns: 0 }))
    }

    fn of_samples<R: Sample>(recording: &Recording, rows: &[R]) -> Result<Self, RecordingError> {
        Self::of(recording, rows.first().map(|row| Self { frame: row.frame(), stamp_ns: row.stamp_ns() }))
    }

    fn frame(self, sequence: u64) -> Cell {
        Cell::Integer(i128::from(sequence) - i128::from(self.frame))
    }

    fn seconds(self, stamp_ns: u64) -> f64 {
        (i128::from(stamp_ns) - i128::from(self.stamp_ns)) as f64 / 1e9
    }

    fn time(self, stamp_ns: u64) -> Cell {
        Cell::Double(Some(self.seconds(stamp_ns)))
    }
}

const FRAME: Heading = Heading { name: "frame", kind: Kind::Integer };
const BODY: Heading = Heading { name: "body", kind: Kind::Text };
const STAMP: Heading = Heading { name: "stamp_ns", kind: Kind::Stamp };
const TIME: Heading = Heading { name: "t_s", kind: Kind::Double };

fn text(name: &'static str) -> Heading {
    Heading { name, kind: Kind::Text }
}

fn double(name: &'static str) -> Heading {
    Heading { name, kind: Kind::Double }
}

/// Writes the headings: those given, then those of the columns.
fn header<R>(first: &[Heading], columns: &[Column<R>], table: &mut dyn Sink) -> Result<(), ExportError> {
    table.header(&first.iter().copied().chain(columns.iter().map(|column| column.heading)).collect::<Vec<_>>())
}

/// Writes a row: the cells given, then those of the columns.
fn write<R>(first: Vec<Cell>, row: &R, columns: &[Column<R>], table: &mut dyn Sink) -> Result<(), ExportError> {
    table.row(first.into_iter().chain(columns.iter().map(|column| (column.cell)(row))).collect())
}

fn velocity(recording: &Recording, mut rows: Vec<VelocitySample>, table: &mut dyn Sink) -> Result<(), ExportError> {
    rows.sort_by_key(|row| (row.frame, row.body));
    let origin = Origin::of_samples(recording, &rows)?;
    header(&[FRAME, BODY, STAMP, TIME], VelocitySample::COLUMNS, table)?;
    for row in &rows {
        let place = vec![
            origin.frame(row.frame),
            Cell::Text(recording.body_name(row.body)),
            Cell::Stamp(row.stamp_ns),
            origin.time(row.stamp_ns),
        ];
        write(place, row, VelocitySample::COLUMNS, table)?;
    }
    Ok(())
}

fn track(recording: &Recording, table: &mut dyn Sink) -> Result<(), ExportError> {
    let mut rows: Vec<TrackSample> = recording.tracks()?.collect::<Result<_, _>>()?;
    rows.sort_by_key(|row| (row.frame, row.body));
    let origin = Origin::of_samples(recording, &rows)?;
    let has_rods = has_rods(recording) || rows.iter().any(|row| row.rod.is_some());
    let rod_headings = if has_rods { rod_headings() } else { Vec::new() };
    header(&[&[FRAME, BODY, TIME], &rod_headings[..]].concat(), TrackSample::COLUMNS, table)?;
    for row in &rows {
        let mut place =
            vec![origin.frame(row.frame), Cell::Text(recording.body_name(row.body)), origin.time(row.stamp_ns)];
        if has_rods {
            place.extend(rod_cells(row.rod.as_ref()));
        }
        write(place, row, TrackSample::COLUMNS, table)?;
    }
    Ok(())
}

/// Whether the rig follows rods, which have columns of their own, seen or not.
fn has_rods(recording: &Recording) -> bool {
    let config = recording.config_toml().and_then(|text| Config::parse(text, "config.toml").ok());
    config.is_some_and(|config| config.bodies.iter().any(|body| body.kind == BodyKind::Rod))
}

fn rod_headings() -> Vec<Heading> {
    let numbers = rod::numbers(None).into_iter().map(|(name, _)| double(name));
    numbers.chain(rod::statuses(None).into_iter().map(|(name, _)| text(name))).collect()
}

fn rod_cells(rod: Option<&Rod>) -> impl Iterator<Item = Cell> {
    let status = |status: Option<PointStatus>| Cell::Text(status.map_or("", PointStatus::as_str).into());
    let numbers = rod::numbers(rod).into_iter().map(|(_, number)| Cell::Double(number));
    numbers.chain(rod::statuses(rod).into_iter().map(move |(_, of_edge)| status(of_edge)))
}

/// Fields are many: one frame's are in memory at a time.
fn field(recording: &Recording, table: &mut dyn Sink) -> Result<(), ExportError> {
    let mut fields = recording.fields()?.peekable();
    let first = fields.peek().and_then(|field| field.as_ref().ok());
    let first = first.map(|field| Origin { frame: field.frame, stamp_ns: field.stamp_ns });
    let origin = Origin::of(recording, first)?;
    header(&[FRAME], FieldPoint::COLUMNS, table)?;
    let mut frame: Vec<PairField> = Vec::new();
    for field in fields {
        let field = field?;
        if frame.first().is_some_and(|first| first.stamp_ns != field.stamp_ns) {
            write_fields(origin, &mut frame, table)?;
        }
        frame.push(field);
    }
    write_fields(origin, &mut frame, table)
}

fn write_fields(origin: Origin, fields: &mut Vec<PairField>, table: &mut dyn Sink) -> Result<(), ExportError> {
    fields.sort_by_key(|field| (field.frame, field.body, field.target_frame));
    // The table has no column for the interval: it holds the shortest one.
    fields.dedup_by_key(|field| (field.frame, field.body));
    for field in fields.drain(..) {
        for point in &field.points {
            write(vec![origin.frame(field.frame)], point, FieldPoint::COLUMNS, table)?;
        }
    }
    Ok(())
}

/// Moments count from the recording's first frame.
fn impact(recording: &Recording, rows: Vec<Impact>, table: &mut dyn Sink) -> Result<(), ExportError> {
    let rows = last_revisions(rows);
    let first = rows.first().map(|row| Origin { frame: 0, stamp_ns: row.origin_ns });
    let (origin, columns) = (Origin::of(recording, first)?, Impact::table());
    header(&[BODY], &columns, table)?;
    for row in rows {
        let body = Cell::Text(recording.body_name(row.body));
        write(vec![body], &row.shifted(origin.seconds(row.origin_ns)), &columns, table)?;
    }
    Ok(())
}

fn events(recording: &Recording, table: &mut dyn Sink) -> Result<(), ExportError> {
    let rows: Vec<EventRow> = recording.events()?.collect::<Result<_, _>>()?;
    let first = rows.first().map(|row| Origin { frame: 0, stamp_ns: row.stamp_ns });
    let origin = Origin::of(recording, first)?;
    table.header(&[STAMP, TIME, text("kind"), text("text")])?;
    for row in rows {
        let time = origin.time(row.stamp_ns);
        table.row(vec![Cell::Stamp(row.stamp_ns), time, Cell::Text(row.kind), Cell::Text(row.text)])?;
    }
    Ok(())
}
