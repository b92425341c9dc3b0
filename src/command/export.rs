//! `ricochet export`: the tables of a recording.

use crate::recording::{EventRow, Recording, RecordingError};
use crate::results::{Estimate, FieldPoint, Impact, PairField, TrackSample, VelocitySample};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// File formats tables can be exported as.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Format {
    /// Comma-separated values, one header line.
    #[default]
    Csv,
}

impl Format {
    /// The format of this name.
    ///
    /// # Errors
    ///
    /// [`ExportError::Usage`] listing the formats there are.
    pub fn from_word(word: &str) -> Result<Self, ExportError> {
        match word {
            "csv" => Ok(Self::Csv),
            other => Err(ExportError::Usage(format!("--format {other}: not one of csv"))),
        }
    }
}

/// What to export, and where to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExportOptions {
    /// The recording.
    pub file: PathBuf,
    /// Which table: one of [`TABLES`].
    pub topic: String,
    /// As what.
    pub format: Format,
    /// Where to; standard output when there is none.
    pub output: Option<PathBuf>,
}

/// The tables a recording can hold.
pub const TABLES: [&str; 7] = ["velocity", "field", "track", "impact", "truth", "truth_impact", "events"];

/// Why a table could not be exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The options are wrong.
    #[error("{0}")]
    Usage(String),
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The table cannot be written.
    #[error("write {to}: {source}")]
    Write {
        /// Where to.
        to: String,
        /// The system's answer.
        source: io::Error,
    },
}

/// What was exported.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exported {
    /// Rows of the table.
    pub rows: u64,
    /// Why the recording ends too early, when it does: rows are missing then.
    pub truncated: Option<String>,
}

/// Exports one table.
///
/// # Errors
///
/// [`ExportError`] naming the option or the file.
pub fn run(options: &ExportOptions) -> Result<Exported, ExportError> {
    if !TABLES.contains(&options.topic.as_str()) {
        return Err(ExportError::Usage(format!("--topic {}: not one of {}", options.topic, TABLES.join(", "))));
    }
    let recording = Recording::open(&options.file)?;
    let rows = match &options.output {
        None => write_table(&recording, &options.topic, io::stdout().lock(), "standard output"),
        Some(path) => {
            if is_same_file(path, &options.file) {
                return Err(ExportError::Usage(format!("--output {}: is the recording itself", path.display())));
            }
            let to = path.display().to_string();
            let file = File::create(path).map_err(|source| ExportError::Write { to: to.clone(), source })?;
            write_table(&recording, &options.topic, BufWriter::new(file), &to)
        }
    }?;
    Ok(Exported { rows, truncated: recording.truncated().map(str::to_owned) })
}

/// Whether both paths lead to one file that exists.
pub(super) fn is_same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// Writes one of [`TABLES`] as CSV; returns its rows. `to` names the target in errors.
///
/// # Errors
///
/// [`ExportError`] as [`run`].
pub fn write_table(recording: &Recording, topic: &str, to: impl Write, name: &str) -> Result<u64, ExportError> {
    let mut table = Table { csv: csv::Writer::from_writer(to), name: name.into(), rows: 0 };
    match topic {
        "velocity" => velocity(recording, recording.velocities()?.collect::<Result<_, _>>()?, &mut table)?,
        "truth" => velocity(recording, recording.truth()?.collect::<Result<_, _>>()?, &mut table)?,
        "track" => track(recording, &mut table)?,
        "impact" => impact(recording, recording.impacts()?.collect::<Result<_, _>>()?, &mut table)?,
        "truth_impact" => impact(recording, recording.truth_impacts()?.collect::<Result<_, _>>()?, &mut table)?,
        "field" => field(recording, &mut table)?,
        _ => events(recording, &mut table)?,
    }
    table.csv.flush().map_err(|source| ExportError::Write { to: table.name, source })?;
    Ok(table.rows)
}

struct Table<W: Write> {
    csv: csv::Writer<W>,
    name: String,
    rows: u64,
}

impl<W: Write> Table<W> {
    fn header(&mut self, columns: &[&str]) -> Result<(), ExportError> {
        self.record(columns.iter().copied())
    }

    fn row(&mut self, cells: &[String]) -> Result<(), ExportError> {
        self.rows += 1;
        self.record(cells)
    }

    fn record<T: AsRef<[u8]>>(&mut self, cells: impl IntoIterator<Item = T>) -> Result<(), ExportError> {
        let written = self.csv.write_record(cells);
        written.map_err(|error| ExportError::Write { to: self.name.clone(), source: error.into() })
    }
}

/// The recording's first frame, from which tables count frames and seconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Origin {
    frame: u64,
    stamp_ns: u64,
}

impl Origin {
    /// The first frame; in a recording without frames what its metadata say
    /// (`first_frame`, `first_stamp_ns`), else the first row's.
    fn of(recording: &Recording, first_row: Option<(u64, u64)>) -> Result<Self, RecordingError> {
        if recording.frame_count() > 0 {
            let first = recording.first_frame()?;
            return Ok(Self { frame: first.sequence, stamp_ns: first.stamp_ns });
        }
        let entry = |key| recording.metadata().get(key)?.parse().ok();
        let told = entry("first_frame").zip(entry("first_stamp_ns"));
        let (frame, stamp_ns) = told.or(first_row).unwrap_or((0, 0));
        Ok(Self { frame, stamp_ns })
    }

    fn frame(self, sequence: u64) -> String {
        (i128::from(sequence) - i128::from(self.frame)).to_string()
    }

    fn seconds(self, stamp_ns: u64) -> f64 {
        (i128::from(stamp_ns) - i128::from(self.stamp_ns)) as f64 / 1e9
    }
}

/// A number as the shortest text that reads back as the same number; nothing for one that is missing.
fn cell(number: Option<f64>) -> String {
    number.filter(|number| number.is_finite()).map(|number| number.to_string()).unwrap_or_default()
}

fn cell_f32(number: Option<f32>) -> String {
    number.filter(|number| number.is_finite()).map(|number| number.to_string()).unwrap_or_default()
}

const VELOCITY: [&str; 23] = [
    "frame",
    "body",
    "stamp_ns",
    "t_s",
    "center_x_px",
    "center_y_px",
    "radius_px",
    "dx_px",
    "dy_px",
    "dtheta_deg",
    "sigma_dx_px",
    "sigma_dy_px",
    "sigma_dtheta_deg",
    "vx_m_s",
    "vy_m_s",
    "vn_m_s",
    "vt_m_s",
    "omega_rad_s",
    "sigma_v_m_s",
    "sigma_omega_rad_s",
    "visible_fraction",
    "phase",
    "status",
];

fn velocity<W: Write>(
    recording: &Recording,
    mut rows: Vec<VelocitySample>,
    table: &mut Table<W>,
) -> Result<(), ExportError> {
    rows.sort_by_key(|row| (row.frame, row.body));
    let origin = Origin::of(recording, rows.first().map(|row| (row.frame, row.stamp_ns)))?;
    table.header(&VELOCITY)?;
    for row in &rows {
        let (step, velocity) = (row.step, row.velocity);
        table.row(&[
            origin.frame(row.frame),
            recording.body_name(row.body),
            row.stamp_ns.to_string(),
            cell(Some(origin.seconds(row.stamp_ns))),
            cell(row.center_x_px),
            cell(row.center_y_px),
            cell(row.radius_px),
            cell(step.map(|s| s.dx_px)),
            cell(step.map(|s| s.dy_px)),
            cell(step.map(|s| s.dtheta_deg)),
            cell(step.map(|s| s.sigma_dx_px)),
            cell(step.map(|s| s.sigma_dy_px)),
            cell(step.map(|s| s.sigma_dtheta_deg)),
            cell(velocity.map(|v| v.vx_m_s)),
            cell(velocity.map(|v| v.vy_m_s)),
            cell(velocity.map(|v| v.vn_m_s)),
            cell(velocity.map(|v| v.vt_m_s)),
            cell(velocity.map(|v| v.omega_rad_s)),
            cell(velocity.map(|v| v.sigma_v_m_s)),
            cell(velocity.map(|v| v.sigma_omega_rad_s)),
            cell(row.visible_fraction),
            row.phase.word().into(),
            row.status.word().into(),
        ])?;
    }
    Ok(())
}

const TRACK: [&str; 11] = [
    "frame",
    "body",
    "t_s",
    "center_x_px",
    "center_y_px",
    "angle_deg",
    "radius_px",
    "sigma_center_px",
    "sigma_angle_deg",
    "visible_fraction",
    "status",
];

fn track<W: Write>(recording: &Recording, table: &mut Table<W>) -> Result<(), ExportError> {
    let mut rows: Vec<TrackSample> = recording.tracks()?.collect::<Result<_, _>>()?;
    rows.sort_by_key(|row| (row.frame, row.body));
    let origin = Origin::of(recording, rows.first().map(|row| (row.frame, row.stamp_ns)))?;
    table.header(&TRACK)?;
    for row in &rows {
        table.row(&[
            origin.frame(row.frame),
            recording.body_name(row.body),
            cell(Some(origin.seconds(row.stamp_ns))),
            cell(row.center_x_px),
            cell(row.center_y_px),
            cell(row.angle_deg),
            cell(row.radius_px),
            cell(row.sigma_center_px),
            cell(row.sigma_angle_deg),
            cell(row.visible_fraction),
            row.status.word().into(),
        ])?;
    }
    Ok(())
}

const FIELD: [&str; 10] =
    ["frame", "x_px", "y_px", "u_px", "v_px", "sigma_u_px", "sigma_v_px", "zncc", "peak_ratio", "status"];

/// Fields are many: one frame's are in memory at a time.
fn field<W: Write>(recording: &Recording, table: &mut Table<W>) -> Result<(), ExportError> {
    let mut fields = recording.fields()?.peekable();
    let first_row = fields.peek().and_then(|field| field.as_ref().ok()).map(|field| (field.frame, field.stamp_ns));
    let origin = Origin::of(recording, first_row)?;
    table.header(&FIELD)?;
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

fn write_fields<W: Write>(
    origin: Origin,
    fields: &mut Vec<PairField>,
    table: &mut Table<W>,
) -> Result<(), ExportError> {
    fields.sort_by_key(|field| (field.frame, field.body, field.target_frame));
    for field in fields.drain(..) {
        let frame = origin.frame(field.frame);
        for point in &field.points {
            table.row(&field_cells(&frame, point))?;
        }
    }
    Ok(())
}

fn field_cells(frame: &str, point: &FieldPoint) -> [String; FIELD.len()] {
    let displacement = point.displacement;
    [
        frame.into(),
        cell_f32(Some(point.x_px)),
        cell_f32(Some(point.y_px)),
        cell_f32(displacement.map(|d| d.u_px)),
        cell_f32(displacement.map(|d| d.v_px)),
        cell_f32(displacement.map(|d| d.sigma_u_px)),
        cell_f32(displacement.map(|d| d.sigma_v_px)),
        cell_f32(point.zncc),
        cell_f32(point.peak_ratio),
        point.status.word().into(),
    ]
}

fn impact<W: Write>(recording: &Recording, rows: Vec<Impact>, table: &mut Table<W>) -> Result<(), ExportError> {
    let mut last: BTreeMap<(u32, u32), Impact> = BTreeMap::new();
    for row in rows {
        let held = last.entry((row.body, row.number)).or_insert(row);
        if row.revision >= held.revision {
            *held = row;
        }
    }
    let origin = Origin::of(recording, last.values().next().map(|row| (0, row.origin_ns)))?;
    table.record(impact_columns())?;
    for row in last.values() {
        let shift_s = origin.seconds(row.origin_ns);
        let numbers = row.numbers().map(|(name, number)| (name, number.map(|n| shifted(name, n, shift_s))));
        let mut cells = vec![recording.body_name(row.body)];
        for (name, number) in numbers {
            if name == "slip_end_s" {
                cells.push(row.force_law.word().into());
            }
            cells.push(cell(number.map(|n| n.value)));
        }
        cells.push(row.status.word().into());
        cells.extend(numbers.map(|(_, number)| cell(number.map(|n| n.sigma))));
        table.row(&cells)?;
    }
    Ok(())
}

fn impact_columns() -> Vec<String> {
    let names = Impact::unknown(0, 0, 0).numbers().map(|(name, _)| name);
    let mut columns = vec!["body".to_owned()];
    for name in names {
        if name == "slip_end_s" {
            columns.push("force_law".into());
        }
        columns.push(name.into());
    }
    columns.push("status".into());
    columns.extend(names.map(|name| format!("sigma_{name}")));
    columns
}

/// Moments count from the recording's first frame; durations stay as they are.
fn shifted(name: &str, number: Estimate, shift_s: f64) -> Estimate {
    let is_moment = matches!(name, "start_s" | "deepest_s" | "end_s" | "slip_end_s");
    Estimate { value: if is_moment { number.value + shift_s } else { number.value }, sigma: number.sigma }
}

fn events<W: Write>(recording: &Recording, table: &mut Table<W>) -> Result<(), ExportError> {
    let rows: Vec<EventRow> = recording.events()?.collect::<Result<_, _>>()?;
    let origin = Origin::of(recording, rows.first().map(|row| (0, row.stamp_ns)))?;
    table.header(&["stamp_ns", "t_s", "kind", "text"])?;
    for row in &rows {
        let t_s = cell(Some(origin.seconds(row.stamp_ns)));
        table.row(&[row.stamp_ns.to_string(), t_s, row.kind.clone(), row.text.clone()])?;
    }
    Ok(())
}
