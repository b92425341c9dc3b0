//! Sequences of still images: PNG, TIFF, BMP and PGM, 8 and 16 bit.

use super::{Footage, ImportError, Stamps, extension, frame_bytes, frame_rate};
use crate::image::{PixelFormat, grey_pixels};
use image::{ImageReader, Limits};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Gaps told one by one; the rest is counted.
const GAPS: usize = 10;

pub(super) fn open(inputs: &[PathBuf], fps: Option<f64>) -> Result<Footage, ImportError> {
    let first = inputs.first().ok_or(ImportError::Nothing)?;
    let frame_rate_hz = frame_rate(first, fps, None)?;
    let (size, format, _) = read(first)?;
    let (numbers, warnings) = numbers(inputs);
    let files = inputs.to_vec();
    let frames = files.into_iter().zip(numbers).map(move |(path, number)| {
        let (this_size, this_format, bytes) = read(&path)?;
        if (this_size, this_format) != (size, format) {
            let reason = format!("{this_size:?} {}, the first image {size:?} {}", this_format.word(), format.word());
            return Err(ImportError::invalid(&path, reason));
        }
        Ok((number, bytes))
    });
    Ok(Footage {
        width_px: size.0,
        height_px: size.1,
        format,
        frame_rate_hz,
        count: inputs.len() as u64,
        description: BTreeMap::new(),
        warnings,
        frames: Box::new(frames),
        stamps: Stamps { first_ns: 0, frame_rate_hz },
    })
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
    let mut file = BufReader::new(File::open(path).map_err(|error| ImportError::io("open", path, error))?);
    if matches!(extension(path).as_str(), "tif" | "tiff") && has_more_pages(&mut file).unwrap_or(false) {
        return Err(ImportError::invalid(path, "more than one page; give one image a file"));
    }
    file.rewind().map_err(|error| ImportError::io("read", path, error))?;
    let mut reader = ImageReader::new(file).with_guessed_format().map_err(|e| ImportError::io("read", path, e))?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(super::FRAME_BYTES);
    reader.limits(limits);
    let image = reader.decode().map_err(|error| ImportError::invalid(path, error.to_string()))?;
    let size = (image.width(), image.height());
    let grey = grey_pixels(image);
    let (format, bytes) = grey.ok_or_else(|| ImportError::invalid(path, "not a grey image of 8 or 16 bit"))?;
    frame_bytes(path, size.0.into(), size.1.into(), format)?;
    Ok((size, format, bytes))
}

/// Whether a TIFF file's first page is followed by another (TIFF 6.0, section 2).
fn has_more_pages(file: &mut (impl Read + Seek)) -> Option<bool> {
    let mut header = [0; 8];
    file.read_exact(&mut header).ok()?;
    let is_little = header[..2] == *b"II";
    let u32_of = |bytes: [u8; 4]| if is_little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) };
    let directory = u32_of([header[4], header[5], header[6], header[7]]);
    let mut count = [0; 2];
    file.seek(SeekFrom::Start(directory.into())).ok()?;
    file.read_exact(&mut count).ok()?;
    let entries = if is_little { u16::from_le_bytes(count) } else { u16::from_be_bytes(count) };
    let mut next = [0; 4];
    file.seek(SeekFrom::Current(i64::from(entries) * 12)).ok()?;
    file.read_exact(&mut next).ok()?;
    Some(u32_of(next) != 0)
}
