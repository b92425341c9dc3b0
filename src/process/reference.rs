//! The picture that patches were drawn in: the stream's first.
//!
//! Every process of a rig needs it, also one that was started again long after. So whoever sees the stream's first frame
//! keeps it in a file under the rig's name; a recording carries it as an attachment, since its own first frame is another.

use crate::camera::CameraError;
use crate::config::{self, BodyKind, Config};
use crate::image::{Frame, Image};
use crate::recording::{Recording, RecordingError, from_png, to_png};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Name of the attachment.
const NAME: &str = "reference.png";

/// Whether anything is measured against that picture.
fn is_needed(config: &Config) -> bool {
    config.bodies.iter().any(|body| body.kind == BodyKind::Patch)
}

fn path(rig: &str) -> PathBuf {
    std::env::temp_dir().join(format!("ricochet-{rig}-{NAME}"))
}

/// Begins a stream of its own: the picture of an earlier one goes, that of a recording takes its place.
///
/// # Errors
///
/// When the recording cannot be read.
pub(super) fn begin(config: &Config) -> Result<(), CameraError> {
    forget(config);
    if !is_needed(config) || config.camera.source != config::Source::Recording {
        return Ok(());
    }
    let camera = &config.camera;
    let recording = Recording::open(Path::new(camera.id.as_deref().unwrap_or_default()))?;
    let recording = recording.of_camera(camera.view.as_deref())?;
    if let Some(picture) = of_recording(&recording, config)? {
        keep(config, &picture);
    }
    Ok(())
}

/// Forgets the picture.
pub(super) fn forget(config: &Config) {
    let _ = std::fs::remove_file(path(&config.rig.name));
}

/// The picture kept for this rig; one that was kept by somebody before it is not replaced.
fn keep(config: &Config, picture: &Image) {
    let (path, Some(png)) = (path(&config.rig.name), to_png(picture)) else { return };
    let part = path.with_extension(format!("{}.part", std::process::id()));
    let written = std::fs::File::create(&part).and_then(|mut file| file.write_all(&png));
    // A link is made only where there is none, so that all processes use one picture.
    let kept = written.and_then(|()| std::fs::hard_link(&part, &path));
    let _ = std::fs::remove_file(&part);
    if let Err(error) = kept.or_else(|error| if path.exists() { Ok(()) } else { Err(error) }) {
        log::warn!("{}: {error}; a process that is started again will not know the patches", path.display());
    }
}

/// The picture as a PNG, where it is known already.
pub(super) fn kept(config: &Config) -> Option<Vec<u8>> {
    if is_needed(config) { std::fs::read(path(&config.rig.name)).ok() } else { None }
}

/// The picture, taken from `frame` where that is the stream's first and none is kept.
pub(super) fn obtain(config: &Config, frame: &Frame<'_>, is_first: bool) -> Option<Image> {
    if let Some(picture) = kept(config).and_then(|png| from_png(&png)) {
        return Some(picture);
    }
    let picture = is_first.then(|| unpacked(frame)).flatten()?;
    keep(config, &picture);
    // Somebody else may have been first.
    kept(config).and_then(|png| from_png(&png)).or(Some(picture))
}

/// The picture as it is attached to a recording.
pub fn attachment(picture: &Image) -> Option<(String, String, Vec<u8>)> {
    to_png(picture).map(attached)
}

/// The same where it is a file already.
pub(super) fn attached(png: Vec<u8>) -> (String, String, Vec<u8>) {
    (NAME.to_owned(), "image/png".to_owned(), png)
}

/// The picture, where `frame` is the film's first.
pub fn of_first_frame(frame: &Frame<'_>, config: &Config) -> Option<Image> {
    if is_needed(config) { unpacked(frame) } else { None }
}

fn unpacked(frame: &Frame<'_>) -> Option<Image> {
    let mut picture = Image::new(frame.meta.width_px as usize, frame.meta.height_px as usize);
    frame.unpack(&mut picture).ok().map(|()| picture)
}

/// The picture that the patches of `config` were drawn in, as far as a recording tells: the one attached, where the
/// attached rig has the same patches, else its own first. `None` where there are no patches.
///
/// # Errors
///
/// When the recording cannot be read.
pub fn of_recording(recording: &Recording, config: &Config) -> Result<Option<Image>, RecordingError> {
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
        let reason = format!("its attachment {NAME} is no grey picture");
        return picture.map(Some).ok_or(RecordingError::Invalid { path, reason });
    }
    let Some(first) = recording.frames()?.next() else { return Ok(None) };
    let (meta, bytes) = first?;
    Ok(unpacked(&Frame { meta, bytes: &bytes }))
}
