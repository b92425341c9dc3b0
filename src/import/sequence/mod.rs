//! Sequences of still images: PNG, TIFF, JPEG, BMP and PGM, 8 and 16 bit, or the pages of one TIFF file.

mod names;
mod order;
mod times;

mod density;
mod list;

pub(super) use list::{is_collection, is_image};

use super::footage::Footage;
use super::pages::Stack;
use super::rate::Rate;
use super::still::{DisplayInfo, Still};
use super::timeline::{FrameTimes, Timeline};
use super::{ImportError, Orientation, RateSource, date, extension, memory_limit_bytes, open_file};
use image::{DynamicImage, ImageDecoder, ImageReader, Limits};
use list::Listed;
use order::Sequence;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// The order of the images of a sequence.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Order {
    /// The order of their numbers, or else the given one.
    #[default]
    Forward,
    /// The other way round.
    Reversed,
}

/// The images of a sequence, each with the file it is in.
type Stills = Box<dyn Iterator<Item = (PathBuf, Result<Still, ImportError>)> + Send>;

/// Opens images, one per file or the pages of one file.
pub(super) fn open(inputs: &[PathBuf], fps: Option<f64>, order: Order) -> Result<Footage, ImportError> {
    let listed = Listed::expand(inputs)?;
    let first_path = listed.paths.first().ok_or(ImportError::Nothing)?.clone();
    let stack = open_stack(&first_path)?.filter(|stack| stack.pages() > 1 && listed.paths.len() == 1);
    let footage = match stack {
        Some(stack) if order == Order::Forward => footage_of_stack(&first_path, stack, fps)?,
        Some(_) => return Err(ImportError::invalid(&first_path, "pages cannot be reversed; pass single images")),
        None => footage_of_files(listed, fps, order)?,
    };
    footage.with_bits_of_first(&first_path)
}

/// Opens the pages of one file.
fn footage_of_stack(path: &Path, mut stack: Stack, fps: Option<f64>) -> Result<Footage, ImportError> {
    let mut warnings = stack.warnings();
    let (count, rate, date) = (stack.pages(), stack.rate(), stack.date());
    let timeline = match stack.times().and_then(|times| times.timeline(rate.clone(), fps)) {
        Some((timeline, contradictions)) => {
            warnings.extend(contradictions);
            timeline
        }
        None => Timeline::consecutive(Rate::known(path, fps, rate)?),
    };
    if timeline.source == RateSource::Playback {
        let hz = timeline.rate_hz;
        warnings.push(format!("the file plays at {hz} frames/s; if it was filmed at another rate, pass that as --fps"));
    }
    let path = path.to_path_buf();
    let footage =
        footage_of_stills(timeline, count, Box::new(stack.map(move |still| (path.clone(), still))), warnings)?;
    Ok(with_date(footage, date))
}

/// Opens one file per image.
fn footage_of_files(listed: Listed, fps: Option<f64>, order: Order) -> Result<Footage, ImportError> {
    let mut sequence = Sequence::arrange(listed)?;
    if order == Order::Reversed {
        sequence.reverse();
    }
    let Sequence { paths, numbers, times, mut warnings } = sequence;
    let first_path = paths.first().ok_or(ImportError::Nothing)?.clone();
    let timeline = match times.as_ref().map(|times| timeline_from_names(times, &first_path, fps)) {
        Some(timed) => {
            let (timeline, contradictions) = timed?;
            warnings.extend(contradictions);
            timeline
        }
        None => Timeline::numbered(Rate::known(&first_path, fps, None)?, numbers),
    };
    let date = date_of(&first_path)?;
    let count = paths.len() as u64;
    let stills = paths.into_iter().map(|path| (path.clone(), read_still(&path)));
    Ok(with_date(footage_of_stills(timeline, count, Box::new(stills), warnings)?, date))
}

/// Times images by the times in their names; returns warnings as well. `fps` is the rate of the user, at which the
/// images follow each other if their times are too coarse.
///
/// # Errors
///
/// [`ImportError::FrameRate`] when the times are too coarse, or there is one image, and the user gives no rate.
fn timeline_from_names(
    times: &FrameTimes,
    path: &Path,
    fps: Option<f64>,
) -> Result<(Timeline, Vec<String>), ImportError> {
    if let [only] = times.times_ns.as_slice() {
        let rate = Rate::known(path, fps, None)?;
        return Ok((Timeline::consecutive(rate).starting_at(*only), Vec::new()));
    }
    let start = times.times_ns.first().copied().unwrap_or_default();
    match (times.timeline(None, fps), fps) {
        (Some((timeline, warnings)), _) => Ok((timeline.starting_at(start), warnings)),
        (None, Some(hz)) => {
            let rate = Rate { hz, source: RateSource::Option };
            let warning = "the times in the file names are too coarse for this rate; each image follows the one before";
            Ok((Timeline::consecutive(rate).starting_at(start), vec![warning.into()]))
        }
        (None, None) => {
            let reason = "the times in the file names are too coarse to time the images; pass --fps";
            Err(ImportError::FrameRate { reason: reason.into() })
        }
    }
}

/// Returns footage of `count` images of one size; the first one stands for the orientation and the grey levels of all.
/// An image of another size is an error in its place.
fn footage_of_stills(
    timeline: Timeline,
    count: u64,
    mut stills: Stills,
    warnings: Vec<String>,
) -> Result<Footage, ImportError> {
    let (first_path, first) = stills.next().ok_or(ImportError::Nothing)?;
    let first = first?;
    let (shape, display) = (first.shape, first.display.clone());
    let frames = std::iter::once((first_path, Ok(first))).chain(stills).map(move |(path, still)| {
        let still = still?;
        if still.shape != shape {
            let reason = format!("the image is {}, but the first one is {shape}", still.shape);
            return Err(ImportError::invalid(&path, reason));
        }
        Ok(still.bytes)
    });
    let mut footage = Footage { warnings, ..Footage::new(shape, timeline, count, frames) };
    let DisplayInfo { orientation, pixel_aspect, bits, grey_rule, is_lossy } = display;
    footage.provenance.orientation = orientation;
    (footage.provenance.pixel_aspect, footage.provenance.bits) = (pixel_aspect, bits);
    footage.provenance.grey_rule = grey_rule.unwrap_or_default().to_owned();
    if is_lossy {
        footage.warnings.push("JPEG is lossy: its compression adds errors to the grey levels".into());
    }
    Ok(footage)
}

/// Adds the date of the first image to the properties.
fn with_date(mut footage: Footage, date: Option<String>) -> Footage {
    footage.description.extend(date.map(|date| ("date".to_owned(), date)));
    footage
}

/// Returns the date that a TIFF file or the Exif block of another image states; `None` without one.
fn date_of(path: &Path) -> Result<Option<String>, ImportError> {
    if let Some(mut stack) = open_stack(path)? {
        return Ok(stack.date());
    }
    let (file, file_bytes) = open_file(path)?;
    let reader = ImageReader::new(BufReader::new(file)).with_guessed_format();
    let mut reader = reader.map_err(|error| ImportError::io("read", path, error))?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(memory_limit_bytes(file_bytes));
    reader.limits(limits);
    // An image that cannot be decoded is refused where it is read.
    let exif = reader.into_decoder().ok().and_then(|mut decoder| decoder.exif_metadata().ok().flatten());
    Ok(exif.and_then(|block| date::from_exif(&block)))
}

/// Opens a TIFF file; `None` for any other file.
fn open_stack(path: &Path) -> Result<Option<Stack>, ImportError> {
    match extension(path).as_str() {
        "tif" | "tiff" => Stack::open(path),
        _ => Ok(None),
    }
}

/// Reads a file that holds one image, as it is displayed.
///
/// # Errors
///
/// [`ImportError::Invalid`] for a file of several pages, or an image that does not decode within its memory.
fn read_still(path: &Path) -> Result<Still, ImportError> {
    if let Some(mut stack) = open_stack(path)? {
        let reason = "the file has more than one page; pass it alone, as a whole sequence";
        return match stack.pages() {
            1 => stack.next().ok_or_else(|| ImportError::invalid(path, "no page"))?,
            _ => Err(ImportError::invalid(path, reason)),
        };
    }
    let (file, file_bytes) = open_file(path)?;
    let pixel_aspect = density::pixel_aspect(&file);
    let reader = ImageReader::new(BufReader::new(file)).with_guessed_format();
    let mut reader = reader.map_err(|error| ImportError::io("read", path, error))?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(memory_limit_bytes(file_bytes));
    reader.limits(limits);
    let is_lossy = reader.format() == Some(image::ImageFormat::Jpeg);
    let invalid = |error: image::ImageError| ImportError::invalid(path, error.to_string());
    let mut decoder = reader.into_decoder().map_err(invalid)?;
    let tag = decoder.orientation().map_err(invalid)?.to_exif();
    let orientation = Orientation::from_tag(tag.into()).unwrap_or_default();
    let bytes = decoder.total_bytes();
    if bytes > memory_limit_bytes(file_bytes) {
        return Err(ImportError::invalid(path, format!("an image of {bytes} bytes in a file of {file_bytes}")));
    }
    let picture = DynamicImage::from_decoder(decoder).map_err(invalid)?;
    Still::from_picture(path, picture, DisplayInfo { orientation, pixel_aspect, is_lossy, ..DisplayInfo::default() })
}
