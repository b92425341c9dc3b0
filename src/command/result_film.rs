//! The frames that results were measured in: in the same recording, or in a film apart from it.

use super::frame_source::{GIVEN_ORDER, GIVEN_RATE, REVERSED, restamp};
use crate::console::{UsageError, progress};
use crate::failure::Failure;
use crate::image::FrameMeta;
use crate::import::{self, Order};
use crate::recording::{Recording, RecordingError};
use std::path::{Path, PathBuf};

/// Frames in order, each with its header.
pub(super) type Frames = Box<dyn Iterator<Item = Result<(FrameMeta, Vec<u8>), RecordingError>>>;

/// Opens the frames of results: those of `film`, else those of the recording itself. A bar with this label shows how many
/// were taken.
///
/// The film gets the same stamps as when it was measured.
///
/// # Errors
///
/// When a file cannot be opened, or when there are no frames and no film.
pub(super) fn open_frames(
    results: &Recording,
    film: &[PathBuf],
    camera: Option<&str>,
    label: &'static str,
) -> Result<Frames, Failure> {
    if film.is_empty() {
        if results.frame_count() == 0 {
            let path = results.path().display();
            let reason = "it has no frames; pass the film that it was measured in with --film";
            return Err(UsageError(format!("{path}: {reason}")).into());
        }
        return Ok(Box::new(progress::bar(results.frame_count(), label).wrap_iter(results.frames()?)));
    }
    let fps = results.metadata().get(GIVEN_RATE).and_then(|text| text.parse().ok());
    let is_reversed = results.metadata().get(GIVEN_ORDER).is_some_and(|order| order == REVERSED);
    let order = if is_reversed { Order::Reversed } else { Order::Forward };
    let opened = open(film, camera, fps, order)?;
    Ok(Box::new(progress::bar(opened.count, label).wrap_iter(opened.frames)))
}

/// A film opened for its frames.
pub(super) struct OpenedFilm {
    /// The frames.
    pub(super) frames: Frames,
    /// The number of frames, as the file announces it.
    pub(super) count: u64,
    /// Frames per second; 0 if unknown.
    pub(super) frame_rate_hz: f64,
    /// The source of the frame rate.
    pub(super) rate_source: String,
    /// Warnings for the user.
    pub(super) warnings: Vec<String>,
}

/// Opens the frames of recordings of one stream, or of footage; `fps` replaces the rate of the file, Hz.
///
/// # Errors
///
/// When a file cannot be opened.
pub(super) fn open(
    film: &[PathBuf],
    camera: Option<&str>,
    fps: Option<f64>,
    order: Order,
) -> Result<OpenedFilm, Failure> {
    let first = film.first().map_or(Path::new(""), PathBuf::as_path);
    if import::is_importable(first) {
        let path = first.to_path_buf();
        let footage = import::open_in_order(film, fps, order)?;
        let damaged = move |error: import::ImportError| RecordingError::invalid(&path, error.to_string());
        let (count, frame_rate_hz, warnings) = (footage.count, footage.frame_rate_hz, footage.warnings.clone());
        let rate_source = footage.provenance.rate.to_string();
        let frames = Box::new(footage.map(move |frame| frame.map_err(&damaged)));
        return Ok(OpenedFilm { frames, count, frame_rate_hz, rate_source, warnings });
    }
    let film = Recording::open_all(film)?.into_iter().map(|recording| recording.select_view(camera));
    let film = film.collect::<Result<Vec<_>, _>>()?;
    let Some(film) = Recording::joined(film) else { return Err(UsageError("--film: no file".into()).into()) };
    let (first, frames) = (film.first_frame()?, film.frames()?);
    let recorded = film.metadata().get("frame_rate_hz").and_then(|text| text.parse().ok());
    let frame_rate_hz = fps.or(recorded).or(film.frame_rate_hz()?).unwrap_or(0.0);
    let count = film.frame_count();
    let rate_source = if fps.is_some() { "by --fps" } else { "recorded in the file" }.to_owned();
    let frames = Box::new(frames.map(move |frame| {
        let (meta, bytes) = frame?;
        Ok((fps.map_or(meta, |fps| restamp(meta, &first, fps)), bytes))
    }));
    Ok(OpenedFilm { frames, count, frame_rate_hz, rate_source, warnings: Vec::new() })
}
