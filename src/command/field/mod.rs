//! `ricochet field`: the displacement field between two still images, or of a series of images.

mod roi;
mod series;
mod start;
mod stills;
mod table;

use std::io::BufWriter;
use std::path::{Path, PathBuf};

use crate::console::{Outcome, Overwrite, WriteError, check_no_input, write_file};
use crate::dic::{CorrelationParams, Correlator, Region};
use crate::failure::Failure;
use crate::image::{ImageView, encode_png};
use crate::results::{FieldPoint, PointStatus};

pub use crate::plot::Quantity;
pub use roi::{Corners, Roi};
pub use start::Begin;
pub(crate) use stills::{Size, grid_points, read_pair};
use table::Layout;

/// The options of `ricochet field`.
#[derive(Debug, Clone)]
pub struct FieldOptions {
    /// The reference image.
    pub reference: PathBuf,
    /// The target image.
    pub target: PathBuf,
    /// Further targets. With any, all targets form a series in this order, and `output` and `picture` are directories
    /// that get one file per target.
    pub later: Vec<PathBuf>,
    /// The correlation settings.
    pub params: CorrelationParams,
    /// A rectangle of the reference to evaluate: x, y, width, height.
    pub roi_px: Option<[u32; 4]>,
    /// A polygon with holes to evaluate instead of `roi_px`.
    pub region: Option<Region>,
    /// Also use subsets that are cut by an edge.
    pub partial: bool,
    /// The table to write; standard output when absent.
    pub output: Option<PathBuf>,
    /// Write JSON lines instead of CSV.
    pub json: bool,
    /// A PNG of the reference with the vectors or a colour map over it.
    pub picture: Option<PathBuf>,
    /// The quantity of the colour map; vectors when absent.
    pub map: Option<Quantity>,
    /// The initial guess.
    pub begin: Begin,
    /// Whether an output that exists is replaced.
    pub overwrite: Overwrite,
}

/// Measures the field, or those of a series, and writes tables, pictures and one summary line per field.
///
/// # Errors
///
/// When an option is invalid, a file cannot be read or written, or the image sizes differ.
pub fn run(options: &FieldOptions) -> Result<Outcome, Failure> {
    if !options.later.is_empty() {
        return series::run(options);
    }
    measure_pair(options)?;
    Ok(Outcome::Clean)
}

/// Measures the field of two images, and writes its table, picture and summary.
fn measure_pair(options: &FieldOptions) -> Result<(), Failure> {
    for path in [&options.output, &options.picture].into_iter().flatten() {
        check_no_input(path, [&options.reference, &options.target])?;
        options.overwrite.check(path)?;
    }
    let (reference, target) = read_pair(&options.reference, &options.target)?;
    let (a, b) = (reference.view(), target.view());
    let (field, start) = correlate_pair(options, a, b)?;
    let layout = Layout { json: options.json, named: false };
    match &options.output {
        Some(path) => layout.write_file(path, &field, options.overwrite)?,
        None => {
            let mut out = BufWriter::new(std::io::stdout().lock());
            let written =
                layout.write_header(&mut out).and_then(|()| layout.write_rows(&field, &options.target, &mut out));
            written.map_err(standard_output_error)?;
        }
    }
    let legend = match &options.picture {
        Some(path) => save_picture(options, a, &field, path)?,
        None => None,
    };
    let notes: Vec<String> = [Some(summarize_field(&field)), start, legend].into_iter().flatten().collect();
    eprintln!("{}", notes.join("; "));
    Ok(())
}

/// Returns the error of a write to standard output.
fn standard_output_error(reason: impl std::fmt::Display) -> WriteError {
    WriteError::new("standard output", reason)
}

/// Draws the vectors or the colour map over the reference and writes them as PNG; returns the legend of the map.
fn save_picture(
    options: &FieldOptions,
    reference: ImageView<'_>,
    field: &[FieldPoint],
    path: &Path,
) -> Result<Option<String>, Failure> {
    let step_px = options.params.step_px;
    let (drawn, legend) = match options.map {
        None => (crate::plot::draw_vectors(reference, field, step_px), None),
        Some(quantity) => {
            let map = crate::plot::draw_map(reference, field, quantity, step_px);
            (map.picture, Some(map.legend))
        }
    };
    let png = encode_png(&drawn).map_err(|error| WriteError::new(path, error))?;
    write_file(path, png, options.overwrite)?;
    Ok(legend)
}

impl FieldOptions {
    /// Returns the region that subsets are cut to: the polygon, or the rectangle if subsets may be partial. `None` if
    /// none is cut.
    fn cut_region(&self) -> Option<Region> {
        let rectangle = |roi: [u32; 4]| start::Rectangle::from(roi.map(f64::from)).region();
        self.region.clone().or_else(|| self.roi_px.filter(|_| self.partial).map(rectangle))
    }
}

/// Correlates two images over the region of interest; returns the field and a description of the initial guess, if
/// searched.
///
/// # Errors
///
/// When an option is invalid, no subset fits, or the initial guess is not found.
fn correlate_pair(
    options: &FieldOptions,
    reference: ImageView<'_>,
    target: ImageView<'_>,
) -> Result<(Vec<FieldPoint>, Option<String>), Failure> {
    start::check(options)?;
    let (width, height) = (reference.width(), reference.height());
    let mut correlator = Correlator::new(&options.params, width, height)?;
    let points = stills::field_points(options, Size { width, height })?;
    correlator.set_region(options.cut_region());
    let (reference, target) = (correlator.prepare(reference), correlator.prepare(target));
    let mut field = Vec::with_capacity(points.len());
    let found = start::find_start(options, &reference, &target)?;
    correlator.correlate(&reference, &target, &points, found.start, &mut field);
    Ok((field, found.note))
}

/// Summarises a field in one line: counts by status, and the means of the displacement and of its standard uncertainty,
/// px.
fn summarize_field(field: &[FieldPoint]) -> String {
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
            line += &format!(", {count} {}", status.as_str());
        }
    }
    line
}
