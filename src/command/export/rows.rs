//! The rows of every table, one function a table.

use super::ExportError;
use super::sink::{Cell, Column, Kind, Sink, named};
use crate::command::rod;
use crate::config::{BodyKind, Config};
use crate::recording::{EventRow, Recording, RecordingError};
use crate::report::last_revisions;
use crate::results::{Estimate, FieldPoint, Impact, PairField, PointStatus, TrackSample, VelocitySample};

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
pub(super) struct Origin {
    frame: u64,
    stamp_ns: u64,
}

impl Origin {
    /// The first frame; in a recording without frames what its metadata say
    /// (`first_frame`, `first_stamp_ns`), else the first row's.
    pub(super) fn of(recording: &Recording, first_row: Option<(u64, u64)>) -> Result<Self, RecordingError> {
        if recording.frame_count() > 0 {
            let first = recording.first_frame()?;
            return Ok(Self { frame: first.sequence, stamp_ns: first.stamp_ns });
        }
        let entry = |key| recording.metadata().get(key)?.parse().ok();
        let told = entry("first_frame").zip(entry("first_stamp_ns"));
        let (frame, stamp_ns) = told.or(first_row).unwrap_or((0, 0));
        Ok(Self { frame, stamp_ns })
    }

    pub(super) fn frame(self, sequence: u64) -> i128 {
        i128::from(sequence) - i128::from(self.frame)
    }

    fn seconds(self, stamp_ns: u64) -> f64 {
        (i128::from(stamp_ns) - i128::from(self.stamp_ns)) as f64 / 1e9
    }
}

/// The shape of one of the tables: the names of its columns and what is in them.
macro_rules! columns {
    ($name:ident, $($column:literal $kind:ident),+ $(,)?) => {
        const $name: &[(&str, Kind)] = &[$(($column, Kind::$kind)),+];
    };
}

columns!(
    VELOCITY,
    "frame" Integer,
    "body" Text,
    "stamp_ns" Stamp,
    "t_s" Double,
    "center_x_px" Double,
    "center_y_px" Double,
    "radius_px" Double,
    "dx_px" Double,
    "dy_px" Double,
    "dtheta_deg" Double,
    "sigma_dx_px" Double,
    "sigma_dy_px" Double,
    "sigma_dtheta_deg" Double,
    "vx_m_s" Double,
    "vy_m_s" Double,
    "vn_m_s" Double,
    "vt_m_s" Double,
    "omega_rad_s" Double,
    "sigma_v_m_s" Double,
    "sigma_omega_rad_s" Double,
    "visible_fraction" Double,
    "phase" Text,
    "status" Text,
);

fn velocity(recording: &Recording, mut rows: Vec<VelocitySample>, table: &mut dyn Sink) -> Result<(), ExportError> {
    rows.sort_by_key(|row| (row.frame, row.body));
    let origin = Origin::of(recording, rows.first().map(|row| (row.frame, row.stamp_ns)))?;
    table.header(&named(VELOCITY))?;
    for row in &rows {
        let (step, velocity) = (row.step, row.velocity);
        table.row(vec![
            Cell::Integer(origin.frame(row.frame)),
            Cell::Text(recording.body_name(row.body)),
            Cell::Stamp(row.stamp_ns),
            Cell::Double(Some(origin.seconds(row.stamp_ns))),
            Cell::Double(row.center_x_px),
            Cell::Double(row.center_y_px),
            Cell::Double(row.radius_px),
            Cell::Double(step.map(|s| s.dx_px)),
            Cell::Double(step.map(|s| s.dy_px)),
            Cell::Double(step.map(|s| s.dtheta_deg)),
            Cell::Double(step.map(|s| s.sigma_dx_px)),
            Cell::Double(step.map(|s| s.sigma_dy_px)),
            Cell::Double(step.map(|s| s.sigma_dtheta_deg)),
            Cell::Double(velocity.map(|v| v.vx_m_s)),
            Cell::Double(velocity.map(|v| v.vy_m_s)),
            Cell::Double(velocity.map(|v| v.vn_m_s)),
            Cell::Double(velocity.map(|v| v.vt_m_s)),
            Cell::Double(velocity.map(|v| v.omega_rad_s)),
            Cell::Double(velocity.map(|v| v.sigma_v_m_s)),
            Cell::Double(velocity.map(|v| v.sigma_omega_rad_s)),
            Cell::Double(row.visible_fraction),
            Cell::Text(row.phase.word().into()),
            Cell::Text(row.status.word().into()),
        ])?;
    }
    Ok(())
}

columns!(
    TRACK,
    "frame" Integer,
    "body" Text,
    "t_s" Double,
    "center_x_px" Double,
    "center_y_px" Double,
    "angle_deg" Double,
    "radius_px" Double,
    "sigma_center_px" Double,
    "sigma_angle_deg" Double,
    "visible_fraction" Double,
    "status" Text,
);

/// How many of the columns of `track` say which row it is: frame, body and time.
const PLACE_COLUMNS: usize = 3;

fn track(recording: &Recording, table: &mut dyn Sink) -> Result<(), ExportError> {
    let mut rows: Vec<TrackSample> = recording.tracks()?.collect::<Result<_, _>>()?;
    rows.sort_by_key(|row| (row.frame, row.body));
    let origin = Origin::of(recording, rows.first().map(|row| (row.frame, row.stamp_ns)))?;
    let has_rods = has_rods(recording) || rows.iter().any(|row| row.rod.is_some());
    let (place, rest) = TRACK.split_at(PLACE_COLUMNS);
    let columns = [named(place), if has_rods { rod_columns() } else { Vec::new() }, named(rest)];
    table.header(&columns.concat())?;
    for row in &rows {
        let mut cells = vec![
            Cell::Integer(origin.frame(row.frame)),
            Cell::Text(recording.body_name(row.body)),
            Cell::Double(Some(origin.seconds(row.stamp_ns))),
        ];
        if has_rods {
            cells.extend(rod::numbers(row.rod.as_ref()).into_iter().map(|(_, number)| Cell::Double(number)));
            let word = |status: Option<PointStatus>| status.map_or("", PointStatus::word);
            cells.extend(rod::statuses(row.rod.as_ref()).into_iter().map(|(_, s)| Cell::Text(word(s).into())));
        }
        cells.extend([
            Cell::Double(row.center_x_px),
            Cell::Double(row.center_y_px),
            Cell::Double(row.angle_deg),
            Cell::Double(row.radius_px),
            Cell::Double(row.sigma_center_px),
            Cell::Double(row.sigma_angle_deg),
            Cell::Double(row.visible_fraction),
            Cell::Text(row.status.word().into()),
        ]);
        table.row(cells)?;
    }
    Ok(())
}

/// Whether the rig follows rods, which have columns of their own, seen or not.
fn has_rods(recording: &Recording) -> bool {
    let config = recording.config_toml().and_then(|text| Config::parse(text, "config.toml").ok());
    config.is_some_and(|config| config.bodies.iter().any(|body| body.kind == BodyKind::Rod))
}

fn rod_columns() -> Vec<Column> {
    let numbers = rod::numbers(None).into_iter().map(|(name, _)| Column { name: name.into(), kind: Kind::Double });
    let statuses = rod::statuses(None).into_iter().map(|(name, _)| Column { name: name.into(), kind: Kind::Text });
    numbers.chain(statuses).collect()
}

columns!(
    FIELD,
    "frame" Integer,
    "x_px" Single,
    "y_px" Single,
    "u_px" Single,
    "v_px" Single,
    "sigma_u_px" Single,
    "sigma_v_px" Single,
    "zncc" Single,
    "peak_ratio" Single,
    "status" Text,
);

/// Fields are many: one frame's are in memory at a time.
fn field(recording: &Recording, table: &mut dyn Sink) -> Result<(), ExportError> {
    let mut fields = recording.fields()?.peekable();
    let first_row = fields.peek().and_then(|field| field.as_ref().ok()).map(|field| (field.frame, field.stamp_ns));
    let origin = Origin::of(recording, first_row)?;
    table.header(&named(FIELD))?;
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
        let frame = origin.frame(field.frame);
        for point in &field.points {
            table.row(field_cells(frame, point))?;
        }
    }
    Ok(())
}

fn field_cells(frame: i128, point: &FieldPoint) -> Vec<Cell> {
    let displacement = point.displacement;
    vec![
        Cell::Integer(frame),
        Cell::Single(Some(point.x_px)),
        Cell::Single(Some(point.y_px)),
        Cell::Single(displacement.map(|d| d.u_px)),
        Cell::Single(displacement.map(|d| d.v_px)),
        Cell::Single(displacement.map(|d| d.sigma_u_px)),
        Cell::Single(displacement.map(|d| d.sigma_v_px)),
        Cell::Single(point.zncc),
        Cell::Single(point.peak_ratio),
        Cell::Text(point.status.word().into()),
    ]
}

fn impact(recording: &Recording, rows: Vec<Impact>, table: &mut dyn Sink) -> Result<(), ExportError> {
    let rows = last_revisions(rows);
    let origin = Origin::of(recording, rows.first().map(|row| (0, row.origin_ns)))?;
    table.header(&impact_columns())?;
    for row in &rows {
        let shift_s = origin.seconds(row.origin_ns);
        let numbers = row.numbers().map(|(name, number)| (name, number.map(|n| shifted(name, n, shift_s))));
        let (first, later) = numbers.split_at(FIRST_NUMBERS);
        let mut cells = vec![Cell::Text(recording.body_name(row.body))];
        for (name, number) in first {
            if *name == "slip_end_s" {
                cells.push(Cell::Text(row.force_law.word().into()));
            }
            cells.push(Cell::Double(number.map(|n| n.value)));
        }
        cells.push(Cell::Text(row.status.word().into()));
        cells.extend(first.iter().map(|(_, number)| Cell::Double(number.map(|n| n.sigma))));
        for (_, number) in later {
            cells.extend([Cell::Double(number.map(|n| n.value)), Cell::Double(number.map(|n| n.sigma))]);
        }
        cells.push(Cell::Double(row.force_law_probability));
        table.row(cells)?;
    }
    Ok(())
}

/// Numbers before `status`, their sigmas behind it. Numbers added since stand last, so that no column moves.
const FIRST_NUMBERS: usize = 16;

fn impact_columns() -> Vec<Column> {
    let names = Impact::unknown(0, 0, 0).numbers().map(|(name, _)| name);
    let (first, later) = names.split_at(FIRST_NUMBERS);
    let double = |name: String| Column { name, kind: Kind::Double };
    let mut columns = named(&[("body", Kind::Text)]);
    for name in first {
        if *name == "slip_end_s" {
            columns.push(Column { name: "force_law".into(), kind: Kind::Text });
        }
        columns.push(double((*name).into()));
    }
    columns.push(Column { name: "status".into(), kind: Kind::Text });
    columns.extend(first.iter().map(|name| double(format!("sigma_{name}"))));
    columns.extend(later.iter().flat_map(|name| [double((*name).into()), double(format!("sigma_{name}"))]));
    columns.push(double("force_law_probability".into()));
    columns
}

/// Moments count from the recording's first frame; durations stay as they are.
fn shifted(name: &str, number: Estimate, shift_s: f64) -> Estimate {
    Estimate { value: if Impact::is_moment(name) { number.value + shift_s } else { number.value }, sigma: number.sigma }
}

fn events(recording: &Recording, table: &mut dyn Sink) -> Result<(), ExportError> {
    let rows: Vec<EventRow> = recording.events()?.collect::<Result<_, _>>()?;
    let origin = Origin::of(recording, rows.first().map(|row| (0, row.stamp_ns)))?;
    table.header(&named(EVENTS))?;
    for row in rows {
        let t_s = Cell::Double(Some(origin.seconds(row.stamp_ns)));
        table.row(vec![Cell::Stamp(row.stamp_ns), t_s, Cell::Text(row.kind), Cell::Text(row.text)])?;
    }
    Ok(())
}

columns!(EVENTS, "stamp_ns" Stamp, "t_s" Double, "kind" Text, "text" Text);
