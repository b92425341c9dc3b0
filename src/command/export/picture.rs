//! Frames as PNG images, with the results drawn over them.

use super::{ExportError, ExportOptions};
use crate::image::{Frame, FrameMeta, Image};
use crate::recording::{Recording, RecordingError};
use crate::results::segments;
use crate::results::{PairField, TrackSample};
use image::{Rgb, RgbImage};
use std::collections::BTreeMap;
use std::io;
use std::path::Path;

/// The width to which small frames are enlarged, by a whole number, px.
const WIDTH_PX: u32 = 640;
const OUTLINE: Rgb<u8> = Rgb([53, 224, 111]);
const ARROW: Rgb<u8> = Rgb([255, 210, 31]);

/// Writes an image per frame into a directory and returns their number.
pub(super) fn write_all(options: &ExportOptions, directory: &Path) -> Result<u64, ExportError> {
    let to = directory.display().to_string();
    let failed = |source| ExportError::Write { to: to.clone(), source };
    let recording = options.recording()?;
    let first = recording.first_frame()?;
    std::fs::create_dir_all(directory).map_err(failed)?;
    let mut count = 0;
    draw(&recording, &options.topic, |sequence, picture| {
        let picture = picture.map_err(failed)?;
        let number = sequence.saturating_sub(first.sequence);
        let path = directory.join(format!("{}_{number:06}.png", options.topic));
        picture.save(&path).map_err(|error| failed(io::Error::other(error)))?;
        count += 1;
        Ok(())
    })?;
    Ok(count)
}

/// Draws all frames in order, with the content of one of [`PICTURES`](super::PICTURES).
pub(super) fn draw(
    recording: &Recording,
    topic: &str,
    mut take: impl FnMut(u64, io::Result<RgbImage>) -> Result<(), ExportError>,
) -> Result<(), ExportError> {
    let mut tracks: BTreeMap<u64, Vec<TrackSample>> = BTreeMap::new();
    if topic != "frames" {
        for sample in recording.tracks()? {
            let sample = sample?;
            tracks.entry(sample.frame).or_default().push(sample);
        }
    }
    let (gain, interval) = if topic == "field" { gain(recording)? } else { (1.0, 0) };
    let mut fields = recording.fields()?.peekable();
    for frame in recording.frames()? {
        let (meta, bytes) = frame?;
        let mut canvas = match Canvas::of(meta, &bytes) {
            Ok(canvas) => canvas,
            Err(error) => return take(meta.sequence, Err(error)),
        };
        tracks.get(&meta.sequence).into_iter().flatten().for_each(|sample| canvas.outline(sample));
        // Fields and frames are both ordered by time, so only the fields of this frame are held.
        while topic == "field"
            && fields.peek().is_some_and(|f| f.as_ref().map_or(true, |f| f.stamp_ns <= meta.stamp_ns))
        {
            let Some(field) = fields.next().transpose()? else { break };
            if field.frame == meta.sequence && field.target_frame.saturating_sub(field.frame) == interval {
                canvas.arrows(&field, gain);
            }
        }
        take(meta.sequence, Ok(canvas.picture))?;
    }
    Ok(())
}

/// Returns the magnification of displacements over the shortest interval, and that interval, frames. The magnification is
/// the same in all frames; the longest displacement spans about the distance of two subsets.
fn gain(recording: &Recording) -> Result<(f32, u64), RecordingError> {
    let (mut longest, mut step, mut interval) = (0.0_f32, f32::INFINITY, u64::MAX);
    for field in recording.fields()? {
        let field = field?;
        let frames = field.target_frame.saturating_sub(field.frame);
        if frames > interval {
            continue;
        }
        if frames < interval {
            (longest, interval) = (0.0, frames);
        }
        let points = field.points;
        longest = points.iter().filter_map(|p| p.displacement).map(|d| d.u_px.hypot(d.v_px)).fold(longest, f32::max);
        let apart = points.windows(2).map(|pair| (pair[0].x_px - pair[1].x_px).hypot(pair[0].y_px - pair[1].y_px));
        step = apart.filter(|apart| *apart > 0.0).fold(step, f32::min);
    }
    Ok((if longest > 0.0 && step.is_finite() { 2.0 * step / longest } else { 1.0 }, interval))
}

/// Returns the pixels of a frame as 8-bit grey levels over the full range of its format, without padding.
pub(super) fn grey_levels(meta: FrameMeta, bytes: &[u8]) -> io::Result<Vec<u8>> {
    let mut image = Image::default();
    Frame { meta, bytes }.unpack(&mut image).map_err(io::Error::other)?;
    let view = image.view();
    let white = ((1_u32 << meta.format.bits()) - 1) as f32;
    let places = (0..meta.height_px as usize).flat_map(|y| (0..meta.width_px as usize).map(move |x| (x, y)));
    let levels = places.map(|(x, y)| view.at(x, y).unwrap_or(0.0));
    Ok(levels.map(|level| (255.0 * level / white).round().min(255.0) as u8).collect())
}

struct Canvas {
    picture: RgbImage,
    scale: f32,
}

impl Canvas {
    /// Draws the frame in grey over its full range, so that the brightness is the same in all images.
    fn of(meta: FrameMeta, bytes: &[u8]) -> Result<Self, io::Error> {
        let scale = WIDTH_PX.div_ceil(meta.width_px.max(1)).clamp(1, 4);
        let levels = grey_levels(meta, bytes)?;
        let picture = RgbImage::from_fn(meta.width_px * scale, meta.height_px * scale, |x, y| {
            Rgb([levels[(y / scale * meta.width_px + x / scale) as usize]; 3])
        });
        Ok(Self { picture, scale: scale as f32 })
    }

    fn dot(&mut self, x: f32, y: f32, color: Rgb<u8>) {
        // The centre of pixel (0, 0) is (0, 0).
        let (x, y) = (((x + 0.5) * self.scale).floor(), ((y + 0.5) * self.scale).floor());
        if x >= 0.0 && y >= 0.0 && x < self.picture.width() as f32 && y < self.picture.height() as f32 {
            self.picture.put_pixel(x as u32, y as u32, color);
        }
    }

    fn line(&mut self, from: [f32; 2], to: [f32; 2], color: Rgb<u8>) {
        let steps = ((to[0] - from[0]).hypot(to[1] - from[1]) * self.scale).ceil().clamp(1.0, 10_000.0);
        for k in 0..=steps as u32 {
            let along = k as f32 / steps;
            self.dot(from[0] + along * (to[0] - from[0]), from[1] + along * (to[1] - from[1]), color);
        }
    }

    fn outline(&mut self, sample: &TrackSample) {
        for [from, to] in sample.rod.iter().flat_map(segments) {
            self.line(from.map(|at| at as f32), to.map(|at| at as f32), OUTLINE);
        }
        let (Some(x), Some(y), Some(radius)) = (sample.center_x_px, sample.center_y_px, sample.radius_px) else {
            return;
        };
        let (x, y, radius) = (x as f32, y as f32, radius as f32);
        let steps = (8.0 * radius * self.scale).clamp(16.0, 100_000.0) as u32;
        for k in 0..steps {
            let (sin, cos) = (std::f32::consts::TAU * k as f32 / steps as f32).sin_cos();
            self.dot(x + radius * cos, y + radius * sin, OUTLINE);
        }
        self.line([x - 3.0, y], [x + 3.0, y], OUTLINE);
        self.line([x, y - 3.0], [x, y + 3.0], OUTLINE);
    }

    fn arrows(&mut self, field: &PairField, gain: f32) {
        for point in &field.points {
            let Some(motion) = point.displacement else { continue };
            let from = [point.x_px, point.y_px];
            let to = [from[0] + gain * motion.u_px, from[1] + gain * motion.v_px];
            self.line(from, to, ARROW);
            let (u, v) = (0.25 * (from[0] - to[0]), 0.25 * (from[1] - to[1]));
            for sign in [1.0, -1.0] {
                self.line(to, [to[0] + u - sign * 0.6 * v, to[1] + v + sign * 0.6 * u], ARROW);
            }
        }
    }
}
