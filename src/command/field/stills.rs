//! Reading of still images and the grid of subsets on them.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use super::{FieldError, FieldOptions};
use crate::dic::grid;
use crate::dic::{CorrelationParams, GridPoint};
use crate::image::Image;

/// Reads two images of the same size.
///
/// # Errors
///
/// [`FieldError`] naming the file that cannot be read, or both sizes.
pub(crate) fn read_pair(reference: &Path, target: &Path) -> Result<(Image, Image), FieldError> {
    let (a, b) = (read_still(reference)?, read_still(target)?);
    let size = |image: &Image| (image.view().width(), image.view().height());
    check_size((reference, size(&a)), (target, size(&b)))?;
    Ok((a, b))
}

/// Checks that the target has the size of the reference.
///
/// # Errors
///
/// [`FieldError::Usage`] with both sizes.
pub(crate) fn check_size(
    (reference, before): (&Path, (usize, usize)),
    (target, after): (&Path, (usize, usize)),
) -> Result<(), FieldError> {
    if before == after {
        return Ok(());
    }
    Err(FieldError::Usage(format!(
        "{} is {} x {} px but {} is {} x {} px: both images need the same size",
        reference.display(),
        before.0,
        before.1,
        target.display(),
        after.0,
        after.1
    )))
}

/// Reads width and height of an image from its header, px.
///
/// # Errors
///
/// [`FieldError::Read`] naming the file.
pub(crate) fn size_px(path: &Path) -> Result<(usize, usize), FieldError> {
    let (width, height) = open(path)?.into_dimensions().map_err(|error| unreadable(path, &error))?;
    Ok((width as usize, height as usize))
}

/// Returns the subset centres of an image or a region of it, at least one.
///
/// # Errors
///
/// [`FieldError::Usage`] when the region exceeds the image or has no room for a subset.
pub(crate) fn points(
    name: &Path,
    (width, height): (usize, usize),
    roi_px: Option<[u32; 4]>,
    params: &CorrelationParams,
) -> Result<Vec<GridPoint>, FieldError> {
    let roi = checked_roi(name, (width, height), roi_px)?;
    let points = grid::rectangle(roi, params.step_px, params.subset_size_px);
    if points.is_empty() {
        let ([_, _, width, height], subset_px) = (roi, params.subset_size_px);
        return Err(FieldError::Usage(format!(
            "{}: {width} x {height} px are too small for a subset of {subset_px} px",
            name.display()
        )));
    }
    Ok(points)
}

/// Returns the given rectangle, or the whole image.
fn checked_roi(name: &Path, (width, height): (usize, usize), roi_px: Option<[u32; 4]>) -> Result<[u32; 4], FieldError> {
    let name = name.display();
    let roi = roi_px.unwrap_or([0, 0, width as u32, height as u32]);
    let inside = |start: u32, extent: u32, size: usize| u64::from(start) + u64::from(extent) <= size as u64;
    if !(inside(roi[0], roi[2], width) && inside(roi[1], roi[3], height)) {
        return Err(FieldError::Usage(format!("--roi {roi:?}: exceeds {name} of {width} x {height} px")));
    }
    Ok(roi)
}

/// Returns the subset centres of the polygon, the rectangle or the whole image.
///
/// # Errors
///
/// Like [`points`], and when no subset centre lies in the polygon.
pub(crate) fn points_of(options: &FieldOptions, (width, height): (usize, usize)) -> Result<Vec<GridPoint>, FieldError> {
    let (name, params) = (&options.reference, &options.params);
    let all = |roi_px| {
        let whole = points(name, (width, height), roi_px, params)?;
        if !options.partial {
            return Ok(whole);
        }
        Ok(grid::partial(checked_roi(name, (width, height), roi_px)?, params.step_px, params.subset_size_px))
    };
    let Some(region) = &options.region else { return all(options.roi_px) };
    let mut found = all(None)?;
    found.retain(|point| region.contains(f64::from(point.x), f64::from(point.y)));
    if found.is_empty() {
        return Err(FieldError::Usage(format!("--polygon: no subset centre of {} lies inside", name.display())));
    }
    Ok(found)
}

/// Reads a BMP, PNG, TIFF or PGM image of 8 or 16 bit; converts colours to luma with a note on standard error.
pub(crate) fn read_still(path: &Path) -> Result<Image, FieldError> {
    let picture = open(path)?.decode().map_err(|error| unreadable(path, &error))?;
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
    Image::from_vec(data, width, height).map_err(|error| FieldError::read(path, error))
}

fn open(path: &Path) -> Result<image::ImageReader<BufReader<File>>, FieldError> {
    let refuse = |error: std::io::Error| FieldError::read(path, error);
    image::ImageReader::open(path).map_err(refuse)?.with_guessed_format().map_err(refuse)
}

fn unreadable(path: &Path, error: &image::ImageError) -> FieldError {
    FieldError::read(path, format!("not a readable BMP, PNG, TIFF or PGM image: {error}"))
}
