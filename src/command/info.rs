//! `ricochet info`: the contents of a recording and any damage.

use crate::image::FrameMeta;
use crate::process::{Matcher, Matching};
use crate::recording::{Recording, RecordingError};
use crate::report;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::PathBuf;

/// The maximum number of gaps listed one by one; all gaps are counted.
const MAX_LISTED_GAPS: usize = 100;

/// The options of `ricochet info`.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct InfoOptions {
    /// The recording.
    pub file: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// The contents of a recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Info {
    /// The file; the first one of a split recording.
    pub file: PathBuf,
    /// The files that continue it.
    pub later_files: Vec<PathBuf>,
    /// The size of all files together.
    pub bytes: u64,
    /// The program that wrote it.
    pub library: String,
    /// The place and reason where it stops being readable.
    pub truncated: Option<String>,
    /// The damaged parts.
    pub damage: Vec<String>,
    /// The date of the first frame, or the one that the imported file stated; `None` if neither is known.
    pub date: Option<String>,
    /// The frames, if any can be read.
    pub frames: Option<FramesInfo>,
    /// The reason why no frame, or not every frame, can be read.
    pub frames_error: Option<String>,
    /// The further cameras.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub cameras: Vec<CameraInfo>,
    /// The topics.
    pub topics: Vec<TopicInfo>,
    /// Names of the bodies.
    pub bodies: Vec<String>,
    /// The metadata records.
    pub metadata: BTreeMap<String, BTreeMap<String, String>>,
    /// Names and sizes of the attachments, bytes.
    pub attachments: BTreeMap<String, u64>,
}

/// A further camera of the recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CameraInfo {
    /// The name of the camera.
    pub name: String,
    /// The frames, if any can be read.
    pub frames: Option<FramesInfo>,
    /// The reason why no frame, or not every frame, can be read.
    pub frames_error: Option<String>,
    /// Names of the measured bodies.
    pub bodies: Vec<String>,
    /// The time offset of its frames against those of the first camera.
    pub matching: MatchingInfo,
}

/// The time offset of a camera's frames against those of the first camera.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MatchingInfo {
    /// Number of frames within half a period of a frame of the first camera.
    pub matched: u64,
    /// Mean delay against the first camera, ns.
    pub mean_ns: f64,
    /// Scatter of the delay (1 sigma), ns.
    pub scatter_ns: f64,
    /// Maximum absolute delay, ns.
    pub worst_ns: u64,
    /// The same as text.
    #[serde(skip)]
    words: String,
}

/// A topic and its number of messages.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct TopicInfo {
    /// The name of the topic.
    pub topic: String,
    /// The name of the schema.
    pub schema: String,
    /// The encoding of the messages.
    pub encoding: String,
    /// The number of messages.
    pub messages: u64,
}

/// The frames of a recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FramesInfo {
    /// Number of readable frames.
    pub count: u64,
    /// Width, pixels.
    pub width_px: u32,
    /// Height, pixels.
    pub height_px: u32,
    /// Pixel layout.
    pub pixel_format: &'static str,
    /// Frame rate including lost frames.
    pub frame_rate_hz: Option<f64>,
    /// First and last sequence number.
    pub sequence: [u64; 2],
    /// First and last exposure start, ns since the Unix epoch.
    pub stamp_ns: [u64; 2],
    /// Time from the first to the last frame.
    pub duration_s: f64,
    /// Number of times the camera was reopened.
    pub reopened: u64,
    /// Number of missing sequence numbers; `None` if the file records none.
    pub lost: Option<u64>,
    /// Number of gaps.
    pub gap_count: u64,
    /// The first gaps.
    pub gaps: Vec<Gap>,
}

/// A gap in the sequence numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Gap {
    /// Sequence number of the last frame before the gap.
    pub after: u64,
    /// Number of missing frames.
    pub lost: u64,
}

/// Prints the contents of a recording and returns them.
///
/// # Errors
///
/// [`RecordingError`] when the recording cannot be opened or standard output is closed.
pub fn run(options: &InfoOptions) -> Result<Info, RecordingError> {
    let info = inspect(&Recording::open(&options.file)?)?;
    let mut text = match options.json {
        true => serde_json::to_string_pretty(&info).unwrap_or_default(),
        false => info_text(&info),
    };
    text.push('\n');
    let written = io::stdout().lock().write_all(text.as_bytes());
    written.map_err(|source| RecordingError::Io { action: "print", path: options.file.clone(), source })?;
    Ok(info)
}

/// Reads the whole recording, checks every CRC, and returns the contents with the damage that was found.
///
/// # Errors
///
/// [`RecordingError::Io`] when a file cannot be read.
pub fn inspect(recording: &Recording) -> Result<Info, RecordingError> {
    let FramesRead { info: frames, error: frames_error, stamps_ns } = read_frames(recording)?;
    let half_period_ns = frames.as_ref().and_then(|frames| Some((0.5e9 / frames.frame_rate_hz?) as u64)).unwrap_or(0);
    let camera = |name| inspect_camera(recording, name, &stamps_ns, half_period_ns);
    let topics = recording.topics().into_iter();
    // Results without frames have it in their metadata.
    let stated_ns = || recording.metadata().get("first_stamp_ns").and_then(|text| text.parse().ok());
    let first_ns = stamps_ns.first().copied().or_else(stated_ns).unwrap_or_default();
    Ok(Info {
        file: recording.path().to_path_buf(),
        later_files: recording.files().skip(1).map(Into::into).collect(),
        bytes: recording.bytes(),
        library: recording.library().into(),
        truncated: recording.truncated().map(Into::into),
        damage: recording.verify()?,
        date: report::date(first_ns, recording.metadata()),
        frames,
        frames_error,
        cameras: recording.views().into_iter().map(camera).collect::<Result<_, _>>()?,
        topics: topics
            .map(|t| TopicInfo { topic: t.topic, schema: t.schema, encoding: t.encoding, messages: t.messages })
            .collect(),
        bodies: recording.bodies().to_vec(),
        metadata: recording.metadata_records().iter().cloned().collect(),
        attachments: recording.attachments().into_iter().map(|a| (a.name, a.bytes)).collect(),
    })
}

/// Reads the frames of a further camera, and matches their times with those of the first camera, `firsts`, ns.
///
/// Frames match if they are at most `half_period_ns` apart, half the period of the first camera.
fn inspect_camera(
    recording: &Recording,
    name: String,
    firsts: &[u64],
    half_period_ns: u64,
) -> Result<CameraInfo, RecordingError> {
    let view = recording.view(&name)?;
    let FramesRead { info: frames, error: frames_error, stamps_ns: others } = read_frames(&view)?;
    let mut matcher = Matcher::new(half_period_ns);
    let (mut firsts, mut others) = (firsts.iter().peekable(), others.iter().peekable());
    while firsts.peek().is_some() || others.peek().is_some() {
        // In time order, so that few stamps wait for their counterpart.
        let is_first = others.peek().is_none_or(|other| firsts.peek().is_some_and(|first| first <= other));
        match if is_first { firsts.next() } else { others.next() } {
            Some(stamp_ns) if is_first => matcher.add_main(*stamp_ns),
            Some(stamp_ns) => matcher.add_other(*stamp_ns),
            None => {}
        }
    }
    let matching = matcher.finish();
    let words = matching.to_string();
    let Matching { matched, mean_ns, scatter_ns, worst_ns, .. } = matching;
    let matching = MatchingInfo { matched, mean_ns, scatter_ns, worst_ns, words };
    Ok(CameraInfo { name, frames, frames_error, bodies: view.bodies().to_vec(), matching })
}

/// The readable frames of a camera.
struct FramesRead {
    /// `None` if no frame can be read.
    info: Option<FramesInfo>,
    /// The reason why frames are missing.
    error: Option<String>,
    stamps_ns: Vec<u64>,
}

/// Reads all frames of a camera. Frames that cannot be read are left out, with the first reason.
///
/// # Errors
///
/// [`RecordingError::Io`] when the file itself cannot be read.
fn read_frames(recording: &Recording) -> Result<FramesRead, RecordingError> {
    let frames = match recording.frames() {
        Ok(frames) => frames,
        Err(error @ RecordingError::Invalid { .. }) => {
            return Ok(FramesRead { info: None, error: Some(error.to_string()), stamps_ns: Vec::new() });
        }
        Err(error) => return Err(error),
    };
    let mut info: Option<FramesInfo> = None;
    let mut problem = None;
    let mut epoch = 0;
    let mut stamps_ns = Vec::new();
    let mut pace = Pace::default();
    for frame in frames {
        let meta = match frame {
            Ok((meta, _)) => meta,
            Err(error @ RecordingError::Io { .. }) => return Err(error),
            Err(error) => {
                problem.get_or_insert(error.to_string());
                continue;
            }
        };
        let info = info.get_or_insert_with(|| {
            epoch = meta.epoch;
            FramesInfo::from_first(&meta, recording.is_ours().then_some(0))
        });
        // Numbers also continue after the camera was opened again.
        info.count_gap(meta.sequence);
        if info.count > 0 && epoch == meta.epoch {
            pace.add(meta.sequence.saturating_sub(info.sequence[1]), meta.stamp_ns.saturating_sub(info.stamp_ns[1]));
        }
        info.reopened += u64::from(std::mem::replace(&mut epoch, meta.epoch) != meta.epoch);
        info.count += 1;
        stamps_ns.push(meta.stamp_ns);
        info.sequence[1] = meta.sequence;
        info.stamp_ns[1] = meta.stamp_ns;
    }
    if let Some(info) = &mut info {
        info.duration_s = info.stamp_ns[1].saturating_sub(info.stamp_ns[0]) as f64 / 1e9;
        // The camera filmed at a rate of its own between the times that it was opened.
        info.frame_rate_hz = recording.frame_rate_hz().ok().flatten().or_else(|| pace.rate_hz());
    }
    Ok(FramesRead { info, error: problem, stamps_ns })
}

/// The frames and the time for which a camera filmed without being opened again.
#[derive(Debug, Default)]
struct Pace {
    frames: u64,
    ns: u64,
}

impl Pace {
    /// Adds the distance of a frame from the one before; none if its number or its stamp does not rise.
    fn add(&mut self, frames: u64, ns: u64) {
        if frames > 0 && ns > 0 {
            (self.frames, self.ns) = (self.frames.saturating_add(frames), self.ns.saturating_add(ns));
        }
    }

    /// Returns the mean rate; `None` without two frames in a row.
    fn rate_hz(&self) -> Option<f64> {
        (self.frames > 0).then(|| self.frames as f64 * 1e9 / self.ns as f64)
    }
}

impl FramesInfo {
    /// Returns the information about no frame yet, with the layout, number and time of the first one. `lost` is 0, or
    /// `None` where the frames have no numbers.
    fn from_first(meta: &FrameMeta, lost: Option<u64>) -> Self {
        Self {
            count: 0,
            width_px: meta.width_px,
            height_px: meta.height_px,
            pixel_format: meta.format.as_str(),
            frame_rate_hz: None,
            sequence: [meta.sequence; 2],
            stamp_ns: [meta.stamp_ns; 2],
            duration_s: 0.0,
            reopened: 0,
            lost,
            gap_count: 0,
            gaps: Vec::new(),
        }
    }

    /// Counts the frames that are missing before this sequence number. Files whose frames have no numbers have no gaps.
    fn count_gap(&mut self, sequence: u64) {
        let after = self.sequence[1];
        let missing = sequence.saturating_sub(after).saturating_sub(1);
        if let Some(lost) = self.lost.as_mut().filter(|_| missing > 0) {
            *lost = lost.saturating_add(missing);
            self.gap_count += 1;
            if self.gaps.len() < MAX_LISTED_GAPS {
                self.gaps.push(Gap { after, lost: missing });
            }
        }
    }
}

/// Formats the contents as text, one line per item. Control characters become `?`.
fn info_text(info: &Info) -> String {
    let mut text = String::new();
    let mut line = |name: &str, value: String| {
        // Names come from the file, and a terminal interprets control characters.
        let value: String = value.chars().map(|c| if c.is_control() { '?' } else { c }).collect();
        let _ = writeln!(text, "{name:<14}{value}");
    };
    line("file", info.file.display().to_string());
    for file in &info.later_files {
        line("goes on in", file.display().to_string());
    }
    line("size", format!("{} bytes", info.bytes));
    line("written by", info.library.clone());
    line("complete", info.truncated.clone().map_or("yes".into(), |reason| format!("NO, {reason}")));
    for damage in &info.damage {
        line("damage", damage.clone());
    }
    line("filmed", info.date.clone().unwrap_or_else(|| "date unknown".into()));
    match (&info.frames, &info.frames_error) {
        (Some(frames), _) => write_frame_lines(frames, &mut line),
        (None, reason) => line("frames", format!("none: {}", reason.clone().unwrap_or_default())),
    }
    if let (Some(_), Some(problem)) = (&info.frames, &info.frames_error) {
        line("unreadable", problem.clone());
    }
    for camera in &info.cameras {
        line("camera", camera.name.clone());
        match (&camera.frames, &camera.frames_error) {
            (Some(frames), _) => write_frame_lines(frames, &mut line),
            (None, reason) => line("frames", format!("none: {}", reason.clone().unwrap_or_default())),
        }
        line("matching", camera.matching.words.clone());
        if !camera.bodies.is_empty() {
            line("bodies", camera.bodies.join(", "));
        }
    }
    for topic in &info.topics {
        line("topic", format!("{:<22}{:>9}  {} ({})", topic.topic, topic.messages, topic.schema, topic.encoding));
    }
    if !info.bodies.is_empty() {
        line("bodies", info.bodies.join(", "));
    }
    for (name, entries) in &info.metadata {
        for (key, value) in entries {
            line("metadata", format!("{name}: {key} = {value}"));
        }
    }
    for (name, bytes) in &info.attachments {
        line("attached", format!("{name} ({bytes} bytes)"));
    }
    text.trim_end().to_owned()
}

/// Writes size, rate, numbers, times and losses of the frames, one line each.
fn write_frame_lines(frames: &FramesInfo, line: &mut impl FnMut(&str, String)) {
    let rate = frames.frame_rate_hz.map_or("rate unknown".into(), |rate| format!("{rate:.3} frames/s"));
    let (width, height) = (frames.width_px, frames.height_px);
    line("frames", format!("{} of {width}x{height} {}, {rate}", frames.count, frames.pixel_format));
    line("sequence", format!("{} to {}", frames.sequence[0], frames.sequence[1]));
    line("time", format!("{:.6} s from {} ns", frames.duration_s, frames.stamp_ns[0]));
    if frames.reopened > 0 {
        line("reopened", format!("{} times", frames.reopened));
    }
    match frames.lost {
        None => line("lost", "not known: its frames carry no numbers".into()),
        Some(lost) => line("lost", format!("{lost} frames in {} gaps", frames.gap_count)),
    }
    for gap in &frames.gaps {
        line("gap", format!("{} frames after {}", gap.lost, gap.after));
    }
}
