//! Frames as PNG images, with the results drawn over them.

use super::{ExportError, ExportOptions};
use crate::command::result_film::Frames;
use crate::console::write_file;
use crate::image::{Frame, FrameMeta, Image, encode_png};
use crate::interrupt;
use crate::plot::{ArrowScale, Canvas, Color};
use crate::recording::{Recording, RecordingError, to_png_with_bit_depth};
use crate::results::segments;
use crate::results::{PairField, TrackSample};
use image::RgbImage;
use std::collections::BTreeMap;
use std::io;
use std::path::Path;

/// The colour of outlines.
const OUTLINE: Color = [53, 224, 111];
/// The colour of displacements.
const ARROW: Color = [255, 210, 31];

/// Writes an image per frame into a directory and returns their number.
///
/// `frames` are written as they are: grey levels in 8 or 16 bits, none enlarged or stretched. Results are drawn over
/// enlarged images in colour.
pub(super) fn write_all(options: &ExportOptions, directory: &Path) -> Result<u64, ExportError> {
    let to = directory.display().to_string();
    let failed = |source| ExportError::Write { to: to.clone(), source };
    let recording = options.open_recording()?;
    let frames = options.open_frames(&recording)?;
    std::fs::create_dir_all(directory).map_err(failed)?;
    // The pictures are complete only together.
    let mut unfinished = Vec::new();
    let (mut count, mut first) = (0, None);
    let mut write = |sequence: u64, png: io::Result<Vec<u8>>| {
        let png = png.map_err(failed)?;
        let number = sequence.saturating_sub(*first.get_or_insert(sequence));
        let path = directory.join(format!("{}_{number:06}.png", options.topic));
        unfinished.extend((!path.exists()).then(|| interrupt::note(&path)));
        write_file(&path, png, options.overwrite).map_err(ExportError::Output)?;
        count += 1;
        Ok(())
    };
    if options.topic == "frames" {
        for frame in frames {
            let (meta, bytes) = frame?;
            write(meta.sequence, encode_recorded(meta, &bytes))?;
        }
    } else {
        draw_frames(&recording, frames, &options.topic, |sequence, picture| {
            write(sequence, picture.and_then(|p| encode_png(&p).map_err(io::Error::other)))
        })?;
    }
    Ok(count)
}

/// Encodes a frame as a grey PNG of 8 bits, or of 16 with the levels that the camera delivered.
fn encode_recorded(meta: FrameMeta, bytes: &[u8]) -> io::Result<Vec<u8>> {
    let mut image = Image::default();
    Frame { meta, bytes }.unpack(&mut image).map_err(io::Error::other)?;
    to_png_with_bit_depth(&image, meta.format.bits()).ok_or_else(|| io::Error::other("the frame is no image"))
}

/// Returns the error for a frame that the results were not measured in.
fn other_film_error(recording: &Recording, sequence: u64) -> ExportError {
    let reason = format!("frame {sequence} has another stamp than in the film: this is another film");
    RecordingError::Invalid { path: recording.path().to_path_buf(), reason }.into()
}

/// Draws frames in order, with the content of one of [`PICTURES`](super::PICTURES), and hands them to `write` with
/// their sequence numbers.
///
/// It ends with the first frame that cannot be unpacked, whose error `write` gets.
///
/// # Errors
///
/// [`ExportError`] when a file cannot be read, the film is not that of the results, or `write` fails.
pub(super) fn draw_frames(
    recording: &Recording,
    frames: Frames,
    topic: &str,
    mut write: impl FnMut(u64, io::Result<RgbImage>) -> Result<(), ExportError>,
) -> Result<(), ExportError> {
    let mut tracks: BTreeMap<u64, Vec<TrackSample>> = BTreeMap::new();
    if topic != "frames" {
        for sample in recording.tracks()? {
            let sample = sample?;
            tracks.entry(sample.frame).or_default().push(sample);
        }
    }
    let (gain, interval) = if topic == "field" { arrow_gain(recording)? } else { (1.0, 0) };
    let mut fields = recording.fields()?.peekable();
    for frame in frames {
        let (meta, bytes) = frame?;
        // Grey over the full range, so that the brightness is the same in all images.
        let mut canvas = match grey_levels(meta, &bytes) {
            Ok(levels) => Canvas::from_levels(&levels, meta.width_px),
            Err(error) => return write(meta.sequence, Err(error)),
        };
        for sample in tracks.get(&meta.sequence).into_iter().flatten() {
            if sample.stamp_ns != meta.stamp_ns {
                return Err(other_film_error(recording, meta.sequence));
            }
            draw_outline(&mut canvas, sample);
        }
        // Fields and frames are both ordered by time, so only the fields of this frame are held.
        while topic == "field"
            && fields.peek().is_some_and(|f| f.as_ref().map_or(true, |f| f.stamp_ns <= meta.stamp_ns))
        {
            let Some(field) = fields.next().transpose()? else { break };
            if field.frame == meta.sequence && field.target_frame.saturating_sub(field.frame) == interval {
                draw_arrows(&mut canvas, &field, gain);
            }
        }
        write(meta.sequence, Ok(canvas.into_picture()))?;
    }
    Ok(())
}

/// Returns the gain of the arrows over the shortest interval, and that interval, frames.
///
/// The gain is the same in all frames. It makes the longest displacement twice the smallest distance of two subsets; 1
/// if nothing moves.
fn arrow_gain(recording: &Recording) -> Result<(f32, u64), RecordingError> {
    let (mut scale, mut interval) = (ArrowScale::default(), u64::MAX);
    for field in recording.fields()? {
        let field = field?;
        let frames = field.target_frame.saturating_sub(field.frame);
        if frames > interval {
            continue;
        }
        if frames < interval {
            (scale, interval) = (ArrowScale::default(), frames);
        }
        scale.add(&field.points);
    }
    Ok((scale.gain(2.0) as f32, interval))
}

/// Returns the pixels of a frame as 8-bit grey levels over the full range of its format, without padding.
pub(in crate::command) fn grey_levels(meta: FrameMeta, bytes: &[u8]) -> io::Result<Vec<u8>> {
    let mut image = Image::default();
    Frame { meta, bytes }.unpack(&mut image).map_err(io::Error::other)?;
    let view = image.view();
    let white = ((1_u32 << meta.format.bits()) - 1) as f32;
    let places = (0..meta.height_px as usize).flat_map(|y| (0..meta.width_px as usize).map(move |x| (x, y)));
    let levels = places.map(|(x, y)| view.at(x, y).unwrap_or(0.0));
    Ok(levels.map(|level| (255.0 * level / white).round().min(255.0) as u8).collect())
}

/// Draws the outline of a body.
fn draw_outline(canvas: &mut Canvas, sample: &TrackSample) {
    for [from, to] in sample.rod.iter().flat_map(segments) {
        canvas.draw_line(from.map(|at| at as f32), to.map(|at| at as f32), OUTLINE);
    }
    let (Some(x), Some(y), Some(radius)) = (sample.center_x_px, sample.center_y_px, sample.radius_px) else { return };
    let center = [x as f32, y as f32];
    canvas.circle(center, radius as f32, OUTLINE);
    canvas.cross(center, 3.0, OUTLINE);
}

/// Draws the displacements as arrows, `gain` times as long as they are.
fn draw_arrows(canvas: &mut Canvas, field: &PairField, gain: f32) {
    for point in &field.points {
        let Some(motion) = point.displacement else { continue };
        let from = [point.x_px, point.y_px];
        let to = [from[0] + gain * motion.u_px, from[1] + gain * motion.v_px];
        canvas.draw_line(from, to, ARROW);
        let (u, v) = (0.25 * (from[0] - to[0]), 0.25 * (from[1] - to[1]));
        for sign in [1.0, -1.0] {
            canvas.draw_line(to, [to[0] + u - sign * 0.6 * v, to[1] + v + sign * 0.6 * u], ARROW);
        }
    }
}
