//! Reading of still images and the grid of subsets on them.

use std::fmt;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use super::FieldOptions;
use crate::console::UsageError;
use crate::dic::grid;
use crate::dic::{CorrelationParams, GridPoint};
use crate::failure::{ExitCode, Failure, Fatal};
use crate::image::{Image, ImageView};

/// An image that cannot be read.
#[derive(Debug, thiserror::Error)]
#[error("cannot read {}: {reason}", path.display())]
struct ReadError {
    path: PathBuf,
    reason: String,
}

impl ReadError {
    fn new(path: &Path, reason: impl fmt::Display) -> Self {
        Self { path: path.to_owned(), reason: reason.to_string() }
    }
}

impl Fatal for ReadError {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Recording
    }
}

/// Width and height of an image, px.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Size {
    pub(crate) width: usize,
    pub(crate) height: usize,
}

impl Size {
    /// Returns the size of a view.
    pub(crate) fn from_view(image: ImageView<'_>) -> Self {
        Self { width: image.width(), height: image.height() }
    }
}

impl fmt::Display for Size {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} x {} px", self.width, self.height)
    }
}

/// The file of an image and its size.
pub(super) struct Still<'a> {
    pub(super) path: &'a Path,
    pub(super) size: Size,
}

impl Still<'_> {
    /// Checks that a target has the size of this reference.
    ///
    /// # Errors
    ///
    /// [`UsageError`] with both sizes.
    pub(super) fn check_size(&self, target: &Still<'_>) -> Result<(), UsageError> {
        if self.size == target.size {
            return Ok(());
        }
        Err(UsageError(format!(
            "{} is {} but {} is {}: both images need the same size",
            self.path.display(),
            self.size,
            target.path.display(),
            target.size
        )))
    }
}

/// Reads two images of the same size.
///
/// # Errors
///
/// When a file cannot be read, or the sizes differ.
pub(crate) fn read_pair(reference: &Path, target: &Path) -> Result<(Image, Image), Failure> {
    let (a, b) = (read_still(reference)?, read_still(target)?);
    let still = |path, image: &Image| Still { path, size: Size::from_view(image.view()) };
    still(reference, &a).check_size(&still(target, &b))?;
    Ok((a, b))
}

/// Reads the size of an image from its header.
///
/// # Errors
///
/// When the file cannot be read.
pub(super) fn read_size(path: &Path) -> Result<Size, Failure> {
    let (width, height) = open_image(path)?.into_dimensions().map_err(|error| read_error(path, &error))?;
    Ok(Size { width: width as usize, height: height as usize })
}

/// Returns the subset centres of an image or a region of it, at least one. `name` is the image in errors.
///
/// # Errors
///
/// [`UsageError`] when the region exceeds the image or has no room for a subset.
pub(crate) fn grid_points(
    name: &Path,
    size: Size,
    roi_px: Option<[u32; 4]>,
    params: &CorrelationParams,
) -> Result<Vec<GridPoint>, UsageError> {
    let roi = check_roi(name, size, roi_px)?;
    let points = grid::rectangle(roi, params.step_px, params.subset_size_px);
    if points.is_empty() {
        let ([_, _, width, height], subset_px) = (roi, params.subset_size_px);
        return Err(UsageError(format!(
            "{}: {width} x {height} px are too small for a subset of {subset_px} px",
            name.display()
        )));
    }
    Ok(points)
}

/// Checks that the rectangle (x, y, width, height, px) lies in the image, and returns it; the whole image without one.
///
/// # Errors
///
/// [`UsageError`] naming the image `name` if the rectangle exceeds it.
fn check_roi(name: &Path, size: Size, roi_px: Option<[u32; 4]>) -> Result<[u32; 4], UsageError> {
    let roi = roi_px.unwrap_or([0, 0, size.width as u32, size.height as u32]);
    let inside = |start: u32, extent: u32, size: usize| u64::from(start) + u64::from(extent) <= size as u64;
    if !(inside(roi[0], roi[2], size.width) && inside(roi[1], roi[3], size.height)) {
        return Err(UsageError(format!("--roi {roi:?}: exceeds {} of {size}", name.display())));
    }
    Ok(roi)
}

/// Returns the subset centres of the polygon, the rectangle or the whole image, with cut subsets if the options allow
/// them.
///
/// # Errors
///
/// Like [`grid_points`], and when no subset centre lies in the polygon.
pub(super) fn field_points(options: &FieldOptions, size: Size) -> Result<Vec<GridPoint>, UsageError> {
    let (name, params) = (&options.reference, &options.params);
    let all = |roi_px| {
        let whole = grid_points(name, size, roi_px, params)?;
        if !options.partial {
            return Ok(whole);
        }
        Ok(grid::partial(check_roi(name, size, roi_px)?, params.step_px, params.subset_size_px))
    };
    let Some(region) = &options.region else { return all(options.roi_px) };
    let mut found = all(None)?;
    found.retain(|point| region.contains(f64::from(point.x), f64::from(point.y)));
    if found.is_empty() {
        return Err(UsageError(format!("--polygon: no subset centre of {} lies inside", name.display())));
    }
    Ok(found)
}

/// Reads a BMP, PNG, TIFF or PGM image as grey levels of 8 or 16 bits; converts colours to luma with a note on standard
/// error.
///
/// # Errors
///
/// When the file cannot be read or decoded.
pub(crate) fn read_still(path: &Path) -> Result<Image, Failure> {
    let picture = open_image(path)?.decode().map_err(|error| read_error(path, &error))?;
    let color = picture.color();
    // Grey images with a palette are decoded as colour images with equal channels.
    if color.has_color() && picture.to_rgb16().pixels().any(|p| p.0[0] != p.0[1] || p.0[1] != p.0[2]) {
        eprintln!("{}: converted to grey (ITU-R BT.709 luma)", path.display());
    }
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let data: Vec<f32> = if color.bytes_per_pixel() > color.channel_count() {
        picture.to_luma16().into_raw().into_iter().map(f32::from).collect()
    } else {
        picture.to_luma8().into_raw().into_iter().map(f32::from).collect()
    };
    Ok(Image::from_vec(data, width, height).map_err(|error| ReadError::new(path, error))?)
}

/// Opens an image, whose format follows from its content.
///
/// # Errors
///
/// Returns [`ReadError`] if the file cannot be opened or read.
fn open_image(path: &Path) -> Result<image::ImageReader<BufReader<File>>, ReadError> {
    let refuse = |error: std::io::Error| ReadError::new(path, error);
    image::ImageReader::open(path).map_err(refuse)?.with_guessed_format().map_err(refuse)
}

/// Returns the error of an image that cannot be decoded.
fn read_error(path: &Path, error: &image::ImageError) -> ReadError {
    ReadError::new(path, format!("not a readable BMP, PNG, TIFF or PGM image: {error}"))
}
