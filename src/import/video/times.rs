//! The times of the frames of a film, in the order in which they are shown.

use super::super::ImportError;
use super::super::timeline::FrameTimes;
use super::decoding::Decoding;
use super::program::{Program, file_url, spawn_line_reader, spawn_text_reader};
use super::stream::{Ratio, Stream};
use std::path::Path;

/// Times of frames in ticks of the stream's clock.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Ticks {
    /// The time of each frame, rising or equal.
    pub(super) times: Vec<i64>,
    /// Length of a tick, s.
    pub(super) tick: Ratio,
    /// Whether the clock counts frames, so that times are exact.
    counts_frames: bool,
}

impl Ticks {
    /// Reads the times from the packets of the file, without decoding them.
    ///
    /// If a packet has no time, or may hold no visible frame, the film is decoded once for the times of its frames.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] when the file has more packets than bytes, or ffprobe hangs.
    pub(super) fn read(path: &Path, stream: &Stream, file_bytes: u64) -> Result<Self, ImportError> {
        let tick = stream.ratio("time_base").unwrap_or(Ratio { over: 1, under: 1_000_000_000 });
        // VP8 stores its alternative reference frames, which are never shown, as packets with times of their own.
        let packets = match stream.text("codec_name") {
            "vp8" => None,
            _ => packet_times(path, stream.input_options(), file_bytes)?,
        };
        let mut times = match packets {
            Some(times) => times,
            None => Decoding::read_times(path, stream.input_options(), tick, file_bytes)?,
        };
        times.sort_unstable();
        let rate = stream.ratio("avg_frame_rate");
        let counts_frames =
            rate.is_some_and(|rate| rate.over.checked_mul(tick.over) == rate.under.checked_mul(tick.under));
        Ok(Self { times, tick, counts_frames })
    }

    /// Returns the times since the first frame, ns, with their resolution: a tick, or 1 ns if the clock counts frames.
    pub(super) fn frame_times(&self) -> FrameTimes {
        let tick_ns = self.tick.value() * 1e9;
        let first = self.times.first().copied().unwrap_or_default();
        let since_ns = |time: &i64| (time.saturating_sub(first) as f64 * tick_ns).round() as i64;
        let resolution_ns = if self.counts_frames { 1.0 } else { tick_ns };
        FrameTimes { times_ns: self.times.iter().map(since_ns).collect(), resolution_ns }
    }

    /// Returns the first index, not before `from`, of a frame with this time, ticks; `None` without one.
    pub(super) fn index(&self, time: i64, from: usize) -> Option<usize> {
        let rest = self.times.get(from..)?;
        let at = from + rest.partition_point(|known| *known < time);
        (self.times.get(at) == Some(&time)).then_some(at)
    }
}

/// Returns the time of each packet that gives a picture, ticks, in the order of the file; `None` when one has no time.
/// `input` are the options of ffprobe for the file.
///
/// # Errors
///
/// [`ImportError::Invalid`] when there are more packets than bytes, or ffprobe hangs or is missing.
fn packet_times(path: &Path, input: &str, file_bytes: u64) -> Result<Option<Vec<i64>>, ImportError> {
    let options = format!(
        "-v error -protocol_whitelist file -select_streams V:0 -show_entries packet=pts,size,flags \
         -of compact=print_section=0 {input}"
    );
    let mut ffprobe = Program::start("ffprobe", &options, &[file_url(path)], path)?;
    let _messages = ffprobe.stderr().map(|pipe| spawn_text_reader(pipe, 0));
    let Some(output) = ffprobe.stdout().map(spawn_line_reader) else { return Ok(None) };
    let mut times = Vec::new();
    while let Some(line) = ffprobe.receive(&output)? {
        let entry = |key: &str| line.split('|').find_map(|entry| entry.strip_prefix(key)?.strip_prefix('='));
        let Some(time) = entry("pts") else { continue };
        // An empty packet repeats the picture before: the camera lost this frame. An edit list discards others.
        if entry("size") == Some("0") || entry("flags").is_some_and(|flags| flags.contains('D')) {
            continue;
        }
        let Ok(time) = time.parse() else { return Ok(None) };
        times.push(time);
        if times.len() as u64 > file_bytes {
            return Err(ImportError::invalid(path, "the file lists more frames than it has bytes"));
        }
    }
    Ok(Some(times))
}
