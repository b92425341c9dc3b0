//! `ricochet field`: the displacement field between two still images.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use super::export::is_same_file;
use crate::dic::{CorrelationError, CorrelationParams, Correlator, Start, grid};
use crate::image::{Image, ImageView};
use crate::results::{FieldPoint, PointStatus};

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
    /// A PNG of the reference with the vectors over it.
    pub picture: Option<PathBuf>,
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

    fn write(to: &Path, reason: impl std::fmt::Display) -> Self {
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
    let reference = read_still(&options.reference)?;
    let target = read_still(&options.target)?;
    let (a, b) = (reference.view(), target.view());
    if (a.width(), a.height()) != (b.width(), b.height()) {
        return Err(FieldError::Usage(format!(
            "{} is {} x {} px, {} is {} x {} px: both images need one size",
            options.reference.display(),
            a.width(),
            a.height(),
            options.target.display(),
            b.width(),
            b.height()
        )));
    }
    let field = measure(options, a, b)?;
    match &options.output {
        Some(path) => {
            let file = File::create(path).map_err(|error| FieldError::write(path, error))?;
            let written = write_table(&field, options.json, BufWriter::new(file));
            written.map_err(|error| FieldError::write(path, error))?;
        }
        None => write_table(&field, options.json, BufWriter::new(std::io::stdout().lock()))
            .map_err(|error| FieldError::write(Path::new("standard output"), error))?,
    }
    if let Some(path) = &options.picture {
        draw(a, &field, options.params.step_px).save(path).map_err(|error| FieldError::write(path, error))?;
    }
    eprintln!("{}", summary(&field));
    Ok(())
}

/// Correlates the two images over the region asked for.
fn measure(
    options: &FieldOptions,
    reference: ImageView<'_>,
    target: ImageView<'_>,
) -> Result<Vec<FieldPoint>, FieldError> {
    let (width, height) = (reference.width(), reference.height());
    let mut correlator = Correlator::new(&options.params, width, height)?;
    let roi = options.roi_px.unwrap_or([0, 0, width as u32, height as u32]);
    let inside = |start: u32, extent: u32, size: usize| u64::from(start) + u64::from(extent) <= size as u64;
    if !(inside(roi[0], roi[2], width) && inside(roi[1], roi[3], height)) {
        let name = options.reference.display();
        return Err(FieldError::Usage(format!("--roi {roi:?}: not within {name} of {width} x {height} px")));
    }
    let points = grid::rectangle(roi, options.params.step_px, options.params.subset_size_px);
    if points.is_empty() {
        let (name, subset_px) = (options.reference.display(), options.params.subset_size_px);
        let [_, _, width, height] = roi;
        return Err(FieldError::Usage(format!(
            "{name}: {width} x {height} px have no room for a subset of {subset_px} px"
        )));
    }
    let (reference, target) = (correlator.prepare(reference), correlator.prepare(target));
    let mut field = Vec::with_capacity(points.len());
    correlator.correlate(&reference, &target, &points, Start::Neighbor, &mut field);
    Ok(field)
}

/// Reads a BMP, PNG, TIFF or PGM image of 8 or 16 bit; colours become luma, and that is said.
fn read_still(path: &Path) -> Result<Image, FieldError> {
    let refuse = |error: std::io::Error| FieldError::read(path, error);
    let reader = image::ImageReader::open(path).map_err(refuse)?.with_guessed_format().map_err(refuse)?;
    let picture = reader.decode().map_err(|error| {
        FieldError::read(path, format!("not a BMP, PNG, TIFF or PGM image that can be read: {error}"))
    })?;
    let color = picture.color();
    // Grey images with a palette are decoded as colours; those with equal channels are none.
    if color.has_color() && picture.to_rgb16().pixels().any(|p| p.0[0] != p.0[1] || p.0[1] != p.0[2]) {
        eprintln!("{}: colours turned into grey (ITU-R BT.709 luma)", path.display());
    }
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let data: Vec<f32> = if color.bytes_per_pixel() > color.channel_count() {
        picture.to_luma16().into_raw().into_iter().map(f32::from).collect()
    } else {
        picture.to_luma8().into_raw().into_iter().map(f32::from).collect()
    };
    Image::from_vec(data, width, height).map_err(|error| FieldError::read(path, error))
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

/// The reference in grey with an arrow for each vector, enlarged so that the longest spans one step.
fn draw(image: ImageView<'_>, field: &[FieldPoint], step_px: u32) -> image::RgbImage {
    let high = image.data().iter().fold(1.0_f32, |high, level| high.max(*level));
    let mut picture = image::RgbImage::from_fn(image.width() as u32, image.height() as u32, |x, y| {
        let level = image.at(x as usize, y as usize).unwrap_or(0.0);
        image::Rgb([(255.0 * level / high) as u8; 3])
    });
    let longest = field.iter().filter_map(|p| p.displacement).map(|d| d.u_px.hypot(d.v_px)).fold(0.0, f32::max);
    let gain = if longest > 0.0 { step_px as f32 / longest } else { 0.0 };
    for point in field {
        let (color, end) = match point.displacement {
            Some(d) => ([255, 60, 40], (point.x_px + gain * d.u_px, point.y_px + gain * d.v_px)),
            None => ([40, 120, 255], (point.x_px, point.y_px)),
        };
        line(&mut picture, (point.x_px, point.y_px), end, color);
    }
    picture
}

/// A straight line with a dot at its beginning.
fn line(picture: &mut image::RgbImage, from: (f32, f32), to: (f32, f32), color: [u8; 3]) {
    let steps = (to.0 - from.0).abs().max((to.1 - from.1).abs()).ceil().max(1.0) as i32;
    let mut dot = |x: f32, y: f32| {
        let (x, y) = (x.round(), y.round());
        if x >= 0.0 && y >= 0.0 && x < picture.width() as f32 && y < picture.height() as f32 {
            picture.put_pixel(x as u32, y as u32, image::Rgb(color));
        }
    };
    for k in 0..=steps {
        let along = k as f32 / steps as f32;
        dot(from.0 + along * (to.0 - from.0), from.1 + along * (to.1 - from.1));
    }
    for (dx, dy) in [(-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)] {
        dot(from.0 + dx, from.1 + dy);
    }
}
