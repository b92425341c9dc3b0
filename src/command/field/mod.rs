//! `ricochet field`: the displacement field between two still images, or of a series of images.

pub(crate) mod folder;
mod roi;
mod series;
mod start;
pub(crate) mod stills;
mod table;

use std::io::BufWriter;
use std::path::{Path, PathBuf};

use super::export::is_same_file;
use crate::console::Outcome;
use crate::dic::{CorrelationError, CorrelationParams, Correlator, Region};
use crate::failure::{ExitCode, Fatal};
use crate::image::ImageView;
use crate::process::Stop;
use crate::results::{FieldPoint, PointStatus};

pub use crate::plot::Quantity;
pub use roi::{Corners, Roi};
pub use start::Begin;
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
}

/// The reason why a field could not be measured.
#[derive(Debug, thiserror::Error)]
pub enum FieldError {
    /// The options or images are inconsistent.
    #[error("{0}")]
    Usage(String),
    /// An image cannot be read.
    #[error("cannot read {}: {reason}", path.display())]
    Read {
        /// The path of the image.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
    /// The table or the picture cannot be written.
    #[error("cannot write {to}: {reason}")]
    Write {
        /// The path or stream.
        to: String,
        /// The reason.
        reason: String,
    },
    /// A setting is out of range.
    #[error(transparent)]
    Correlation(#[from] CorrelationError),
}

impl Fatal for FieldError {
    fn exit_code(&self) -> ExitCode {
        if matches!(self, Self::Usage(_) | Self::Correlation(_)) { ExitCode::Usage } else { ExitCode::Recording }
    }
}

impl FieldError {
    fn read(path: &Path, reason: impl std::fmt::Display) -> Self {
        Self::Read { path: path.to_owned(), reason: reason.to_string() }
    }

    pub(crate) fn write(to: &Path, reason: impl std::fmt::Display) -> Self {
        Self::Write { to: to.display().to_string(), reason: reason.to_string() }
    }
}

/// Measures the field, or those of a series, and writes tables, pictures and one summary line per field.
///
/// # Errors
///
/// [`FieldError`] naming the file, the option or both image sizes.
pub fn run(options: &FieldOptions, stop: &Stop) -> Result<Outcome, FieldError> {
    if !options.later.is_empty() {
        return series::run(options, stop);
    }
    pair(options)?;
    Ok(Outcome::Clean)
}

/// Measures the field of two images.
fn pair(options: &FieldOptions) -> Result<(), FieldError> {
    let inputs = [&options.reference, &options.target];
    let outputs = [&options.output, &options.picture].into_iter().flatten();
    if let Some(path) = outputs.into_iter().find(|path| inputs.iter().any(|input| is_same_file(path, input))) {
        return Err(FieldError::Usage(format!(
            "{}: cannot write: it would overwrite one of the images",
            path.display()
        )));
    }
    let (reference, target) = stills::read_pair(&options.reference, &options.target)?;
    let (a, b) = (reference.view(), target.view());
    let (field, start) = measure(options, a, b)?;
    let layout = Layout { json: options.json, named: false };
    match &options.output {
        Some(path) => layout.write_file(path, &field)?,
        None => {
            let mut out = BufWriter::new(std::io::stdout().lock());
            let written = layout.head(&mut out).and_then(|()| layout.rows(&field, &options.target, &mut out));
            written.map_err(to_standard_output)?;
        }
    }
    let legend = match &options.picture {
        Some(path) => save_picture(options, a, &field, path)?,
        None => None,
    };
    let notes: Vec<String> = [Some(summary(&field)), start, legend].into_iter().flatten().collect();
    eprintln!("{}", notes.join("; "));
    Ok(())
}

fn to_standard_output(reason: impl std::fmt::Display) -> FieldError {
    FieldError::write(Path::new("standard output"), reason)
}

/// Draws the vectors or the colour map; returns the legend of the map.
fn save_picture(
    options: &FieldOptions,
    reference: ImageView<'_>,
    field: &[FieldPoint],
    path: &Path,
) -> Result<Option<String>, FieldError> {
    let step_px = options.params.step_px;
    let (drawn, legend) = match options.map {
        None => (crate::plot::draw_vectors(reference, field, step_px), None),
        Some(quantity) => {
            let map = crate::plot::draw_map(reference, field, quantity, step_px);
            (map.picture, Some(map.legend))
        }
    };
    drawn.save(path).map_err(|error| FieldError::write(path, error))?;
    Ok(legend)
}

impl FieldOptions {
    /// Returns the region that subsets are cut to.
    fn cut(&self) -> Option<Region> {
        let rectangle = |[x, y, width, height]: [u32; 4]| {
            let (left, top) = (f64::from(x) - 0.5, f64::from(y) - 0.5);
            let (right, bottom) = (left + f64::from(width), top + f64::from(height));
            Region::Polygon {
                outline_px: vec![[left, top], [right, top], [right, bottom], [left, bottom]],
                holes_px: Vec::new(),
            }
        };
        self.region.clone().or_else(|| self.roi_px.filter(|_| self.partial).map(rectangle))
    }
}

/// Correlates two images over the region of interest; returns the field and a description of the initial guess, if
/// searched.
fn measure(
    options: &FieldOptions,
    reference: ImageView<'_>,
    target: ImageView<'_>,
) -> Result<(Vec<FieldPoint>, Option<String>), FieldError> {
    start::check(options)?;
    let (width, height) = (reference.width(), reference.height());
    let mut correlator = Correlator::new(&options.params, width, height)?;
    let points = stills::points_of(options, (width, height))?;
    correlator.set_region(options.cut());
    let (reference, target) = (correlator.prepare(reference), correlator.prepare(target));
    let mut field = Vec::with_capacity(points.len());
    let found = start::find(options, &reference, &target)?;
    correlator.correlate(&reference, &target, &points, found.start, &mut field);
    Ok((field, found.note))
}

/// Summarises a field in one line: counts, mean displacement and uncertainty.
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
            line += &format!(", {count} {}", status.as_str());
        }
    }
    line
}
