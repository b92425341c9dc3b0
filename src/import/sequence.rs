//! Sequences of still images: PNG, TIFF, BMP and PGM, 8 and 16 bit; also as the pages of one TIFF file.

use super::pages::{self, Page};
use super::{Footage, ImportError, Stamps, extension, frame_bytes, frame_rate};
use crate::image::{PixelFormat, grey_pixels};
use image::{ImageFormat, ImageReader, Limits};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Seek};
use std::path::{Path, PathBuf};

/// Gaps told one by one; the rest is counted.
const GAPS: usize = 10;
/// A decoded image may take twice the file's size and this much more.
const SPARE_BYTES: u64 = 64 << 20;

pub(super) fn open(inputs: &[PathBuf], fps: Option<f64>) -> Result<Footage, ImportError> {
    let (inputs, told) = by_number(inputs);
    let inputs = &inputs[..];
    let first = inputs.first().ok_or(ImportError::Nothing)?;
    let frame_rate_hz = frame_rate(first, fps, None)?;
    let places: Vec<(PathBuf, Option<u64>)> = match (directories(first)?, inputs) {
        (pages, [file]) if pages.len() > 1 => pages.into_iter().map(|at| (file.clone(), Some(at))).collect(),
        _ => inputs.iter().map(|path| (path.clone(), None)).collect(),
    };
    let (numbers, warnings) =
        if places.len() == inputs.len() { numbers(inputs) } else { ((0..places.len() as u64).collect(), Vec::new()) };
    let warnings = told.into_iter().chain(warnings).collect();
    let count = places.len() as u64;
    let still = |(path, place): &(PathBuf, Option<u64>)| match place {
        Some(directory) => page(path, *directory),
        None => read(path),
    };
    let first = places.first().ok_or(ImportError::Nothing)?;
    let (size, format, _) = still(first)?;
    let frames = places.into_iter().zip(numbers).map(move |(place, number)| {
        let (this_size, this_format, bytes) = still(&place)?;
        if (this_size, this_format) != (size, format) {
            let reason = format!("{this_size:?} {}, the first image {size:?} {}", this_format.word(), format.word());
            return Err(ImportError::invalid(&place.0, reason));
        }
        Ok((number, bytes))
    });
    Ok(Footage {
        width_px: size.0,
        height_px: size.1,
        format,
        frame_rate_hz,
        count,
        description: BTreeMap::new(),
        warnings,
        frames: Box::new(frames),
        stamps: Stamps { first_ns: 0, frame_rate_hz },
    })
}

/// The images in the order they were given, unless that is how a shell lists numbers of unequal length: 1, 10, 2.
fn by_number(inputs: &[PathBuf]) -> (Vec<PathBuf>, Option<String>) {
    let given = inputs.to_vec();
    let Some(named) = numbers_in_names(inputs) else { return (given, None) };
    let is_listed = inputs.windows(2).all(|pair| pair[0].as_os_str() < pair[1].as_os_str());
    if !is_listed || named.is_sorted() {
        return (given, None);
    }
    let mut numbered: Vec<(u64, PathBuf)> = named.into_iter().zip(given).collect();
    numbered.sort();
    let sorted = numbered.into_iter().map(|(_, path)| path).collect();
    (sorted, Some("the images are taken in the order of the numbers in their names, 2 before 10".into()))
}

/// Sequence numbers, from the numbers in the names where these tell of missing images.
///
/// Names that differ in nothing but one rising number make a numbered sequence;
/// its smallest step is one frame, so every fifth image is complete too.
fn numbers(inputs: &[PathBuf]) -> (Vec<u64>, Vec<String>) {
    let plain = (0..inputs.len() as u64).collect();
    let Some(named) = numbers_in_names(inputs) else { return (plain, Vec::new()) };
    let steps: Option<Vec<u64>> = named.windows(2).map(|w| w[1].checked_sub(w[0]).filter(|step| *step > 0)).collect();
    let Some(step) = steps.as_ref().and_then(|steps| steps.iter().min()) else { return (plain, Vec::new()) };
    let numbers: Vec<u64> = named.iter().map(|number| (number - named[0]) / step).collect();
    if named.iter().any(|number| (number - named[0]) % step != 0) {
        return (
            plain,
            vec!["the numbers in the file names have no common step; every image counts as the next".into()],
        );
    }
    let gaps: Vec<_> = numbers.windows(2).zip(inputs).filter(|(w, _)| w[1] - w[0] > 1).collect();
    let lost: u64 = gaps.iter().map(|(w, _)| w[1] - w[0] - 1).sum();
    let mut warnings: Vec<String> = (gaps.iter().take(GAPS))
        .map(|(w, path)| format!("{} images are missing after {}", w[1] - w[0] - 1, path.display()))
        .collect();
    if gaps.len() > GAPS {
        warnings.push(format!("{lost} images are missing in {} places", gaps.len()));
    }
    (numbers, warnings)
}

/// The last number in each name, when nothing else differs between them.
fn numbers_in_names(inputs: &[PathBuf]) -> Option<Vec<u64>> {
    let mut frame = None;
    inputs
        .iter()
        .map(|path| {
            let name = path.file_name()?.to_str()?;
            let end = name.rfind(|c: char| c.is_ascii_digit())? + 1;
            let start = name[..end].rfind(|c: char| !c.is_ascii_digit()).map_or(0, |at| at + 1);
            let around = (name[..start].to_owned(), name[end..].to_owned());
            (*frame.get_or_insert_with(|| around.clone()) == around).then_some(())?;
            name[start..end].parse().ok()
        })
        .collect()
}

/// A grey image: width and height, layout, packed little-endian pixels.
type Still = ((u32, u32), PixelFormat, Vec<u8>);

fn read(path: &Path) -> Result<Still, ImportError> {
    match directories(path)?[..] {
        [] => {
            let (file, file_bytes) = open_file(path)?;
            let reader = ImageReader::new(BufReader::new(file)).with_guessed_format();
            decode(path, file_bytes, reader.map_err(|error| ImportError::io("read", path, error))?)
        }
        [directory] => page(path, directory),
        _ => Err(ImportError::invalid(path, "more than one page; such a file is a whole sequence, give it alone")),
    }
}

fn open_file(path: &Path) -> Result<(File, u64), ImportError> {
    let file = File::open(path).map_err(|error| ImportError::io("open", path, error))?;
    let bytes = file.metadata().map_err(|error| ImportError::io("open", path, error))?.len();
    Ok((file, bytes))
}

/// Where the pages of a TIFF file begin; empty for other files.
fn directories(path: &Path) -> Result<Vec<u64>, ImportError> {
    if !matches!(extension(path).as_str(), "tif" | "tiff") {
        return Ok(Vec::new());
    }
    let mut file = BufReader::new(open_file(path)?.0);
    pages::directories(&mut file).map_err(|error| ImportError::invalid(path, format!("its pages: {error}")))
}

fn page(path: &Path, directory: u64) -> Result<Still, ImportError> {
    let (file, file_bytes) = open_file(path)?;
    let page = Page::new(file, directory).map_err(|error| ImportError::io("read", path, error))?;
    decode(path, file_bytes, ImageReader::with_format(BufReader::new(page), ImageFormat::Tiff))
}

fn decode(path: &Path, file_bytes: u64, mut reader: ImageReader<impl BufRead + Seek>) -> Result<Still, ImportError> {
    let mut limits = Limits::default();
    limits.max_alloc = Some(file_bytes.saturating_mul(2).saturating_add(SPARE_BYTES).min(super::FRAME_BYTES));
    reader.limits(limits);
    let image = reader.decode().map_err(|error| ImportError::invalid(path, error.to_string()))?;
    let size = (image.width(), image.height());
    let grey = grey_pixels(image);
    let (format, bytes) = grey.ok_or_else(|| ImportError::invalid(path, "not a grey image of 8 or 16 bit"))?;
    frame_bytes(path, size.0.into(), size.1.into(), format)?;
    Ok((size, format, bytes))
}
