//! `ricochet field`: the displacement field between two still images.

mod digits;
pub(super) mod folder;
mod map;
mod picture;
mod start;
pub(super) mod stills;

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use super::export::is_same_file;
use crate::dic::{CorrelationError, CorrelationParams, Correlator};
use crate::image::ImageView;
use crate::results::{FieldPoint, PointStatus};

pub use map::Quantity;
pub use start::Begin;

/// What `ricochet field` was asked to do.
#[derive(Debug, Clone)]
pub struct FieldOptions {
    /// The image before.
    pub reference: PathBuf,
    /// The image after.
    pub target: PathBuf,
    /// How to correlate.
    pub params: CorrelationParams,
    /// Only this part of the reference: x, y, width, height.
    pub roi_px: Option<[u32; 4]>,
    /// The table; standard output when there is none.
    pub output: Option<PathBuf>,
    /// Rows as JSON lines instead of CSV.
    pub json: bool,
    /// A PNG of the reference with the vectors, or a map, over it.
    pub picture: Option<PathBuf>,
    /// What the picture shows in colours, in place of the vectors.
    pub map: Option<Quantity>,
    /// Where the search for the subsets begins.
    pub begin: Begin,
}

/// Why no field could be measured.
#[derive(Debug, thiserror::Error)]
pub enum FieldError {
    /// The options or the images do not go together.
    #[error("{0}")]
    Usage(String),
    /// An image cannot be read.
    #[error("read {}: {reason}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The table or the picture cannot be written.
    #[error("write {to}: {reason}")]
    Write {
        /// Where to.
        to: String,
        /// The system's answer.
        reason: String,
    },
    /// A setting is out of range.
    #[error(transparent)]
    Correlation(#[from] CorrelationError),
}

impl FieldError {
    fn read(path: &Path, reason: impl std::fmt::Display) -> Self {
        Self::Read { path: path.to_owned(), reason: reason.to_string() }
    }

    pub(in crate::command) fn write(to: &Path, reason: impl std::fmt::Display) -> Self {
        Self::Write { to: to.display().to_string(), reason: reason.to_string() }
    }
}

/// Columns of the table.
const COLUMNS: [&str; 9] = ["x_px", "y_px", "u_px", "v_px", "sigma_u_px", "sigma_v_px", "zncc", "peak_ratio", "status"];

/// Measures the field and writes the table, the picture and one line of summary.
///
/// # Errors
///
/// One line naming the file, the key or both sizes.
pub fn run(options: &FieldOptions) -> Result<(), FieldError> {
    let inputs = [&options.reference, &options.target];
    let outputs = [&options.output, &options.picture].into_iter().flatten();
    if let Some(path) = outputs.into_iter().find(|path| inputs.iter().any(|input| is_same_file(path, input))) {
        return Err(FieldError::Usage(format!("{}: is one of the images, and would be overwritten", path.display())));
    }
    let (reference, target) = stills::read_pair(&options.reference, &options.target)?;
    let (a, b) = (reference.view(), target.view());
    let (field, start) = measure(options, a, b)?;
    match &options.output {
        Some(path) => {
            let file = File::create(path).map_err(|error| FieldError::write(path, error))?;
            let written = write_table(&field, options.json, BufWriter::new(file));
            written.map_err(|error| FieldError::write(path, error))?;
        }
        None => write_table(&field, options.json, BufWriter::new(std::io::stdout().lock()))
            .map_err(|error| FieldError::write(Path::new("standard output"), error))?,
    }
    let legend = match &options.picture {
        Some(path) => save_picture(options, a, &field, path)?,
        None => None,
    };
    let told: Vec<String> = [Some(summary(&field)), start, legend].into_iter().flatten().collect();
    eprintln!("{}", told.join("; "));
    Ok(())
}

/// Draws the vectors or the map; gives the map's legend.
fn save_picture(
    options: &FieldOptions,
    reference: ImageView<'_>,
    field: &[FieldPoint],
    path: &Path,
) -> Result<Option<String>, FieldError> {
    let step_px = options.params.step_px;
    let (drawn, legend) = match options.map {
        None => (picture::arrows(reference, field, step_px), None),
        Some(quantity) => {
            let map = map::map(reference, field, quantity, step_px);
            (map.picture, Some(map.legend))
        }
    };
    drawn.save(path).map_err(|error| FieldError::write(path, error))?;
    Ok(legend)
}

/// Correlates the two images over the region asked for; gives the start as well, where one was looked for.
fn measure(
    options: &FieldOptions,
    reference: ImageView<'_>,
    target: ImageView<'_>,
) -> Result<(Vec<FieldPoint>, Option<String>), FieldError> {
    start::check(options)?;
    let (width, height) = (reference.width(), reference.height());
    let mut correlator = Correlator::new(&options.params, width, height)?;
    let points = stills::points(&options.reference, (width, height), options.roi_px, &options.params)?;
    let (reference, target) = (correlator.prepare(reference), correlator.prepare(target));
    let mut field = Vec::with_capacity(points.len());
    let found = start::find(options, &reference, &target)?;
    correlator.correlate(&reference, &target, &points, found.start, &mut field);
    Ok((field, found.told))
}

/// One line: how many vectors, how large, how sure.
fn summary(field: &[FieldPoint]) -> String {
    let valid: Vec<_> = field.iter().filter_map(|point| point.displacement).collect();
    let mut line = format!("{} of {} subsets valid", valid.len(), field.len());
    if !valid.is_empty() {
        let mean = |value: fn(&crate::results::Displacement) -> f32| {
            valid.iter().map(|d| f64::from(value(d))).sum::<f64>() / valid.len() as f64
        };
        line += &format!(
            ", mean u {:.4} px, v {:.4} px, sigma {:.4} px",
            mean(|d| d.u_px),
            mean(|d| d.v_px),
            mean(|d| 0.5 * (d.sigma_u_px + d.sigma_v_px))
        );
    }
    for status in PointStatus::ALL.into_iter().skip(1) {
        let count = field.iter().filter(|point| point.status == status).count();
        if count > 0 {
            line += &format!(", {count} {}", status.word());
        }
    }
    line
}

/// The values of one row; missing ones are `None`.
fn row(point: &FieldPoint) -> [Option<f32>; 8] {
    let displacement = point.displacement;
    [
        Some(point.x_px),
        Some(point.y_px),
        displacement.map(|d| d.u_px),
        displacement.map(|d| d.v_px),
        displacement.map(|d| d.sigma_u_px),
        displacement.map(|d| d.sigma_v_px),
        point.zncc,
        point.peak_ratio,
    ]
}

/// Writes the table: CSV with empty cells, or JSON lines with nulls, where a number is missing.
fn write_table(field: &[FieldPoint], json: bool, mut out: impl Write) -> anyhow::Result<()> {
    if json {
        for point in field {
            let mut object = serde_json::Map::new();
            for (name, value) in COLUMNS.into_iter().zip(row(point)) {
                object.insert(name.to_owned(), serde_json::json!(value));
            }
            object.insert("status".to_owned(), serde_json::json!(point.status.word()));
            writeln!(out, "{}", serde_json::Value::Object(object))?;
        }
    } else {
        let mut table = csv::Writer::from_writer(&mut out);
        table.write_record(COLUMNS)?;
        for point in field {
            let cells = row(point).map(|value| value.map_or(String::new(), |value| value.to_string()));
            table.write_record(cells.iter().map(String::as_str).chain([point.status.word()]))?;
        }
        table.flush()?;
    }
    out.flush()?;
    Ok(())
}
