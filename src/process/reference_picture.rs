//! The reference picture of patches: the stream's first frame.
//!
//! Every process of a rig needs it, including one that is restarted much later. So the process that sees the first
//! frame keeps it in a private file of the rig. A recording carries it as an attachment, since its own first frame
//! differs.

use crate::bus::Bus;
use crate::camera::CameraError;
use crate::config::{self, BodyKind, Config};
use crate::image::{Frame, Image};
use crate::recording::{Recording, RecordingError, from_png, to_png};
use std::io::Write;
use std::path::Path;

/// Name of the attachment.
const NAME: &str = "reference.png";

/// Whether anything is measured against the reference picture.
fn is_needed(config: &Config) -> bool {
    config.bodies.iter().any(|body| body.kind == BodyKind::Patch)
}

/// Starts a new stream: removes the previous picture, and stores that of a recording which is replayed.
///
/// # Errors
///
/// If the recording cannot be read.
pub(super) fn begin_stream(config: &Config, bus: &Bus) -> Result<(), CameraError> {
    let path = bus.private_file(NAME);
    let _ = std::fs::remove_file(&path);
    if !is_needed(config) || config.camera.source != Some(config::Source::Recording) {
        return Ok(());
    }
    let camera = &config.camera;
    let recording = Recording::open(Path::new(camera.id.as_deref().unwrap_or_default()))?;
    let recording = recording.select_view(camera.view.as_deref())?;
    if let Some(picture) = from_recording(&recording, config)? {
        store(&path, &picture);
    }
    Ok(())
}

/// Stores the picture for this rig, unless another process already did. A failure is logged.
fn store(path: &Path, picture: &Image) {
    let Some(png) = to_png(picture) else { return };
    let part = path.with_extension(format!("{}.part", std::process::id()));
    let written = std::fs::File::create(&part).and_then(|mut file| file.write_all(&png));
    // A hard link never replaces a file, so all processes use the same picture.
    let kept = written.and_then(|()| std::fs::hard_link(&part, path));
    let _ = std::fs::remove_file(&part);
    if let Err(error) = kept.or_else(|error| if path.exists() { Ok(()) } else { Err(error) }) {
        log::warn!("cannot keep {}: {error}; a restarted process will not find the patches", path.display());
    }
}

/// Returns the stored picture as a PNG file; `None` if none is stored or needed.
pub(super) fn stored_png(config: &Config, bus: &Bus) -> Option<Vec<u8>> {
    if is_needed(config) { std::fs::read(bus.private_file(NAME)).ok() } else { None }
}

/// Returns the stored picture; without one, the stream's first frame, which is then stored. `None` without either, or
/// if no patches are measured and `first` is `None`.
pub(super) fn obtain(config: &Config, bus: &Bus, first: Option<&Frame<'_>>) -> Option<Image> {
    if let Some(picture) = stored_png(config, bus).and_then(|png| from_png(&png)) {
        return Some(picture);
    }
    let picture = first.and_then(unpack)?;
    store(&bus.private_file(NAME), &picture);
    // Another process may have been faster.
    stored_png(config, bus).and_then(|png| from_png(&png)).or(Some(picture))
}

/// Returns the picture as an attachment of a recording: name, media type and content. `None` if it cannot be encoded.
pub fn attachment(picture: &Image) -> Option<(String, String, Vec<u8>)> {
    to_png(picture).map(png_attachment)
}

/// Returns a PNG file as an attachment of a recording: name, media type and content.
pub(super) fn png_attachment(png: Vec<u8>) -> (String, String, Vec<u8>) {
    (NAME.to_owned(), "image/png".to_owned(), png)
}

/// Returns the picture from a film's first frame; `None` if no patches are measured or its bytes are incomplete.
pub fn from_first_frame(frame: &Frame<'_>, config: &Config) -> Option<Image> {
    if is_needed(config) { unpack(frame) } else { None }
}

/// Returns the grey levels of a frame; `None` if its bytes are incomplete.
fn unpack(frame: &Frame<'_>) -> Option<Image> {
    let mut picture = Image::new(frame.meta.width_px as usize, frame.meta.height_px as usize);
    frame.unpack(&mut picture).ok().map(|()| picture)
}

/// Returns the reference picture of a recording; `None` if `config` has no patches, or the first frame is needed but
/// missing or incomplete.
///
/// It is the attached picture if the attached rig file has the same patches as `config`, and otherwise the first
/// frame.
///
/// # Errors
///
/// If the recording cannot be read, or its attached picture is no grey-level PNG.
pub fn from_recording(recording: &Recording, config: &Config) -> Result<Option<Image>, RecordingError> {
    if !is_needed(config) {
        return Ok(None);
    }
    let attached = recording.config_toml().and_then(|text| Config::parse(text, "config.toml").ok());
    let patches = |config: &Config| -> Vec<_> { config.bodies.iter().filter_map(|body| body.patch.clone()).collect() };
    if attached.is_some_and(|attached| patches(&attached) == patches(config))
        && recording.attachments().iter().any(|attachment| attachment.name == NAME)
    {
        let path = recording.path().to_owned();
        let picture = from_png(&recording.attachment(NAME)?);
        let reason = format!("its attachment {NAME} is not a grey-level image");
        return picture.map(Some).ok_or(RecordingError::Invalid { path, reason });
    }
    let Some(first) = recording.frames()?.next() else { return Ok(None) };
    let (meta, bytes) = first?;
    Ok(unpack(&Frame { meta, bytes: &bytes }))
}
