//! Sequences of still images: PNG, TIFF, BMP and PGM, 8 and 16 bit, or the pages of one TIFF file.

use super::footage::Footage;
use super::pages::Stack;
use super::still::Still;
use super::timeline::{Rate, Timeline};
use super::{ImportError, extension, memory_limit_bytes, open_file};
use image::{ImageReader, Limits};
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// Maximum number of gaps listed one by one.
const GAPS_MAX: usize = 10;

/// The images of a sequence, each with the file it is in.
type Stills = Box<dyn Iterator<Item = (PathBuf, Result<Still, ImportError>)> + Send>;

pub(super) fn open(inputs: &[PathBuf], fps: Option<f64>) -> Result<Footage, ImportError> {
    let first_path = inputs.first().ok_or(ImportError::Nothing)?;
    let rate = Rate::known(first_path, fps, None)?;
    let mut warnings = Vec::new();
    let (timeline, count, mut stills): (Timeline, u64, Stills) = match (stack(first_path)?, inputs) {
        (Some(stack), [path]) if stack.pages() > 1 => {
            let path = path.clone();
            (Timeline::consecutive(rate), stack.pages(), Box::new(stack.map(move |still| (path.clone(), still))))
        }
        _ => {
            let inputs = in_numeric_order(inputs, &mut warnings);
            let numbers = sequence_numbers(&inputs, &mut warnings);
            let timeline = Timeline::numbered(rate, numbers);
            let read = |path: PathBuf| (path.clone(), read(&path));
            (timeline, inputs.len() as u64, Box::new(inputs.into_iter().map(read)))
        }
    };
    let (first_path, first) = stills.next().ok_or(ImportError::Nothing)?;
    let first = first?;
    let shape = first.shape;
    let frames = std::iter::once((first_path, Ok(first))).chain(stills).map(move |(path, still)| {
        let still = still?;
        if still.shape != shape {
            let reason = format!("the image is {}, but the first one is {shape}", still.shape);
            return Err(ImportError::invalid(&path, reason));
        }
        Ok(still.bytes)
    });
    Ok(Footage { warnings, ..Footage::new(shape, timeline, count, frames) })
}

/// Sorts images by the numbers in their names where a shell listed numbers of unequal length: 1, 10, 2.
///
/// Any other order is kept.
fn in_numeric_order(inputs: &[PathBuf], warnings: &mut Vec<String>) -> Vec<PathBuf> {
    let given = inputs.to_vec();
    let Some(named) = numbers_in_names(inputs) else { return given };
    let is_listed = inputs.windows(2).all(|pair| pair[0].as_os_str() < pair[1].as_os_str());
    if !is_listed || named.is_sorted() {
        return given;
    }
    warnings.push("the images are taken in the order of the numbers in their names, 2 before 10".into());
    let mut numbered: Vec<(u64, PathBuf)> = named.into_iter().zip(given).collect();
    numbered.sort();
    numbered.into_iter().map(|(_, path)| path).collect()
}

/// Returns the sequence number of each image, with missing images counted where the names show them.
///
/// Names that differ in nothing but one rising number form a numbered sequence. Its smallest step is one frame, so a
/// sequence of every fifth image is complete too.
fn sequence_numbers(inputs: &[PathBuf], warnings: &mut Vec<String>) -> Vec<u64> {
    let plain = (0..inputs.len() as u64).collect();
    let Some(named) = numbers_in_names(inputs) else { return plain };
    let steps: Option<Vec<u64>> = named.windows(2).map(|w| w[1].checked_sub(w[0]).filter(|step| *step > 0)).collect();
    let Some(step) = steps.as_ref().and_then(|steps| steps.iter().min()) else { return plain };
    if named.iter().any(|number| (number - named[0]) % step != 0) {
        warnings.push("the numbers in the file names have no common step; every image counts as the next".into());
        return plain;
    }
    let numbers: Vec<u64> = named.iter().map(|number| (number - named[0]) / step).collect();
    let missing = numbers.windows(2).map(|w| w[1] - w[0] - 1);
    let gaps: Vec<(u64, &PathBuf)> = missing.zip(inputs).filter(|(missing, _)| *missing > 0).collect();
    let gap = |(missing, path): &(u64, &PathBuf)| format!("{missing} images are missing after {}", path.display());
    warnings.extend(gaps.iter().take(GAPS_MAX).map(gap));
    if gaps.len() > GAPS_MAX {
        let missing: u64 = gaps.iter().map(|(missing, _)| missing).sum();
        warnings.push(format!("{missing} images are missing in {} places", gaps.len()));
    }
    numbers
}

/// Returns the last number in each name; `None` unless the names differ in nothing else.
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

/// Opens a TIFF file; `None` for any other file.
fn stack(path: &Path) -> Result<Option<Stack>, ImportError> {
    match extension(path).as_str() {
        "tif" | "tiff" => Stack::open(path),
        _ => Ok(None),
    }
}

/// Reads a file that holds one image.
fn read(path: &Path) -> Result<Still, ImportError> {
    if let Some(mut stack) = stack(path)? {
        let reason = "the file has more than one page; pass it alone, as a whole sequence";
        return match stack.pages() {
            1 => stack.next().ok_or_else(|| ImportError::invalid(path, "no page"))?,
            _ => Err(ImportError::invalid(path, reason)),
        };
    }
    let (file, file_bytes) = open_file(path)?;
    let reader = ImageReader::new(BufReader::new(file)).with_guessed_format();
    let mut reader = reader.map_err(|error| ImportError::io("read", path, error))?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(memory_limit_bytes(file_bytes));
    reader.limits(limits);
    let picture = reader.decode().map_err(|error| ImportError::invalid(path, error.to_string()))?;
    Still::new(path, Some(picture))
}
