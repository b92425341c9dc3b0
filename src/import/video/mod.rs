//! Films of any kind, decoded by an installed ffmpeg.
//!
//! The packets of the file give each frame its time, and the decoder confirms it frame by frame: a frame that cannot be
//! decoded is a gap and moves no other.

mod capture;
mod decoder;
mod decoding;
mod levels;
mod program;
mod rate;
mod stored_times;
mod stream;
mod times;

use super::footage::{Findings, Footage};
use super::shape::Shape;
use super::{ImportError, Orientation, memory_limit_bytes, open_file};
use decoder::{Decoder, INTERLACED};
use decoding::Decoding;
use levels::Levels;
use std::collections::BTreeMap;
use std::path::Path;
use stream::Stream;
use times::Ticks;

/// Opens a film through ffprobe and ffmpeg.
pub(super) fn open(path: &Path, fps: Option<f64>) -> Result<Footage, ImportError> {
    let (_, file_bytes) = open_file(path)?;
    let stream = Stream::probe(path)?;
    if matches!(stream.text("field_order"), "tt" | "bb" | "tb" | "bt") {
        return Err(ImportError::invalid(path, INTERLACED));
    }
    let mut warnings = Vec::new();
    stored_times::check_stored_times(path, &stream, file_bytes, &mut warnings)?;
    let ticks = Ticks::read(path, &stream, file_bytes)?;
    let timeline = rate::timeline(path, &stream, &ticks, fps, &mut warnings)?;
    let levels = Levels::from_stream(&stream);
    if !levels.rule.is_empty() {
        warnings.push(format!("the pixels are {}, not grey; ffmpeg converts them to brightness", levels.layout));
    }
    let orientation = stream.orientation().unwrap_or_else(|degrees| {
        warnings.push(format!("players turn the picture by {degrees} degrees; it is measured as stored"));
        Orientation::AS_STORED
    });
    let [width_px, height_px] = stream.size_px();
    let stored = Shape::new(path, width_px, height_px, levels.format)?;
    if stored.bytes() > memory_limit_bytes(file_bytes) {
        return Err(ImportError::invalid(
            path,
            format!("frames of {} bytes in a file of {file_bytes}", stored.bytes()),
        ));
    }
    let output = format!("-f rawvideo -pix_fmt {} pipe:1", levels.grey_layout());
    let decoding = Decoding::start(path, stream.input_options(), ticks.tick, &levels.filters(), &output)?;
    let (count, findings) = (ticks.times.len() as u64, Findings::default());
    let decoder = Decoder::new(decoding, ticks, stored, findings.clone());
    let mut footage = Footage::from_stored(stored, timeline, count, Box::new(decoder));
    footage.provenance.bits = levels.bits;
    footage.provenance.grey_rule = levels.rule;
    let footage = Footage { description: description(&stream), warnings, findings, ..footage };
    Ok(footage.with_bits_of_first(path)?.with_square_pixels(stream.pixel_aspect()).oriented(orientation))
}

/// Returns the properties of the film that are worth keeping: codec, pixel layout, tone curve, date.
fn description(stream: &Stream) -> BTreeMap<String, String> {
    let entries = [("codec", "codec_name"), ("pixel_layout", "pix_fmt"), ("tone_curve", "color_transfer")];
    let known = entries.into_iter().map(|(name, key)| (name.to_owned(), stream.text(key).to_owned()));
    let known = known.filter(|(_, value)| !value.is_empty());
    known.chain(stream.date().map(|date| ("date".to_owned(), date))).collect()
}
