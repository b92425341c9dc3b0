//! Photron recordings: a CIH or CIHX header next to an MRAW file of pixels.

mod header;
mod pixels;

use super::footage::Footage;
use super::rate::Rate;
use super::timeline::Timeline;
use super::{ImportError, RateSource, extension, open_file};
use header::Header;
use pixels::Layout;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// Opens a recording, given its header or its pixels.
pub(super) fn open(path: &Path, fps: Option<f64>) -> Result<Footage, ImportError> {
    let header_path = find_header(path)?;
    let header = Header::read(&header_path)?;
    let invalid = |reason: String| ImportError::invalid(&header_path, reason);
    let pixels_path = find_pixels(path, &header)?;
    let mut warnings = Vec::new();
    let mut layout = Layout::new(&header_path, &header, &mut warnings)?;
    let stored_bytes = layout.stored_bytes;
    let (file, file_bytes) = open_file(&pixels_path)?;
    let announced: u64 = header.number(header::FRAMES).map_err(invalid)?;
    let count = announced.min(file_bytes / stored_bytes);
    if count == 0 {
        let reason = format!("{file_bytes} bytes are less than a frame of {stored_bytes}");
        return Err(ImportError::invalid(&pixels_path, reason));
    }
    if file_bytes / stored_bytes != announced {
        let there = file_bytes / stored_bytes;
        warnings.push(format!("the header announces {announced} frames, the file has {there}"));
    }
    let rate = saved_rate(&header, announced, &mut warnings).map_err(invalid)?;
    let timeline = Timeline::consecutive(Rate::known(&header_path, fps, rate)?);
    let read = move |number: u64| {
        let mut stored = vec![0; stored_bytes as usize];
        let read = file.read_exact_at(&mut stored, number * stored_bytes);
        read.map(|()| stored).map_err(|error| ImportError::io("read", &pixels_path, error))
    };
    layout.check(&read(0)?, &mut warnings);
    let (shape, bits, grey_rule) = (layout.shape, layout.bits, layout.grey_rule());
    let frames = (0..count).map(move |number| Ok(layout.grey_frame(read(number)?)));
    let description = header.description();
    let mut footage = Footage { description, warnings, ..Footage::new(shape, timeline, count, frames) };
    (footage.provenance.bits, footage.provenance.grey_rule) = (bits, grey_rule.to_owned());
    Ok(footage)
}

/// Returns the rate of the saved frames, which is that of the recording divided by the step at which frames were saved.
///
/// `frames` is the number of saved frames. A step with which they reach beyond the recorded frames is that of the
/// player. It is reported and not used. `None` if the header states no usable rate.
///
/// # Errors
///
/// The reason if the header has no record rate.
fn saved_rate(header: &Header, frames: u64, warnings: &mut Vec<String>) -> Result<Option<Rate>, String> {
    let recorded_hz: f64 = header.number(header::RECORD_RATE)?;
    let step: u64 = header.number(header::SAVE_STEP).unwrap_or(1);
    let Some(recorded) = Rate::from_header(recorded_hz, "record rate") else { return Ok(None) };
    if step < 2 {
        return Ok(Some(recorded));
    }
    let reach = frames.saturating_sub(1).saturating_mul(step).saturating_add(1);
    let in_recording: Option<u64> = header.number(header::RECORDED_FRAMES).ok();
    if in_recording.is_some_and(|all| reach > all) {
        warnings.push(format!(
            "the header has a frame step of {step}, but {frames} frames at that step are more than the {} recorded: the \
             record rate of {recorded_hz} frames/s is used",
            in_recording.unwrap_or_default()
        ));
        return Ok(Some(recorded));
    }
    let hz = recorded_hz / step as f64;
    warnings
        .push(format!("one of {step} frames was saved: {hz} frames/s, from a record rate of {recorded_hz} frames/s"));
    Ok(Some(Rate { hz, source: RateSource::Header("record rate and frame step".into()) }))
}

/// Finds the header of a recording, given either of its files.
///
/// # Errors
///
/// [`ImportError::Invalid`] if there is none next to the pixels.
fn find_header(path: &Path) -> Result<PathBuf, ImportError> {
    match extension(path).as_str() {
        "mraw" => first_existing(path, &["cihx", "CIHX", "cih", "CIH", "Cih"])
            .ok_or_else(|| ImportError::invalid(path, "the .cihx or .cih header next to it is missing")),
        _ => Ok(path.to_path_buf()),
    }
}

/// Finds the pixels of a recording, given either of its files.
///
/// # Errors
///
/// [`ImportError::Invalid`] if there are none next to the header, with the format of the images if it is another.
fn find_pixels(path: &Path, header: &Header) -> Result<PathBuf, ImportError> {
    if extension(path) == "mraw" {
        return Ok(path.to_path_buf());
    }
    first_existing(path, &["mraw", "MRAW", "Mraw", "MRaw"]).ok_or_else(|| {
        let format = header.text(header::FILE_FORMAT).unwrap_or("MRaw");
        ImportError::invalid(
            path,
            match format.eq_ignore_ascii_case("mraw") {
                true => "the .mraw file next to it is missing".to_owned(),
                false => format!("the images are saved as {format}; pass these files with --fps"),
            },
        )
    })
}

/// Returns the first file that exists among those with the name of `path` and one of these endings.
fn first_existing(path: &Path, endings: &[&str]) -> Option<PathBuf> {
    endings.iter().map(|ending| path.with_extension(ending)).find(|candidate| candidate.exists())
}
