//! The frames of a film, decoded by ffmpeg, each with the time that it was decoded with.

use super::super::ImportError;
use super::super::footage::{Findings, Stored};
use super::super::shape::Shape;
use super::program::{Program, address, read_line};
use super::stream::Ratio;
use super::times::Ticks;
use std::ffi::OsString;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{ChildStderr, ChildStdout};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

/// Number of frames whose descriptions may wait to be read.
const WAITING: usize = 64;
/// Beginning of the lines of ffmpeg's filter `showinfo`.
const SHOWINFO: &str = "[Parsed_showinfo_";

/// A decoded frame, as ffmpeg's filter `showinfo` describes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Decoded {
    /// Time, ticks.
    pub(super) time: i64,
    pub(super) width_px: u64,
    pub(super) height_px: u64,
    /// Whether the frame consists of two fields of different times.
    pub(super) is_interlaced: bool,
}

impl Decoded {
    /// Reads a line of `showinfo`: `n: 0 pts: 64 pts_time:0.004 ... s:64x48 i:P iskey:1`. Other lines have no frame.
    fn parse(line: &str) -> Option<Self> {
        let (_, line) = line.strip_prefix(SHOWINFO)?.split_once("[info] n:")?;
        let entry = |key: &str| {
            let (_, rest) = line.split_once(key)?;
            rest.split_whitespace().next()
        };
        let (width, height) = entry(" s:")?.split_once('x')?;
        Some(Self {
            time: entry(" pts:")?.parse().ok()?,
            width_px: width.parse().ok()?,
            height_px: height.parse().ok()?,
            is_interlaced: matches!(entry(" i:")?, "T" | "B"),
        })
    }
}

/// A running ffmpeg that describes each frame before it writes its pixels.
pub(super) struct Decoding {
    ffmpeg: Program,
    frames: Receiver<Decoded>,
    /// The last error, after the last frame.
    error: Receiver<String>,
    path: PathBuf,
}

impl Decoding {
    /// Starts to decode `path`; `filters` follow after the description, `output` are the last arguments.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] without ffmpeg.
    pub(super) fn start(path: &Path, tick: Ratio, filters: &str, output: &str) -> Result<Self, ImportError> {
        let mut arguments = vec![address(path)];
        // Every frame as it is stored: none is repeated or dropped to keep a rate.
        let describe = format!("settb=tb={}/{},showinfo=checksum=0", tick.over, tick.under);
        arguments.extend("-map 0:V:0 -fps_mode passthrough -vf".split_whitespace().map(OsString::from));
        arguments.push(format!("{describe}{filters}").into());
        arguments.extend(output.split_whitespace().map(OsString::from));
        let options = "-nostdin -hide_banner -nostats -loglevel repeat+level+info -xerror \
            -protocol_whitelist file,pipe -noautorotate -copyts -i";
        let mut ffmpeg = Program::start("ffmpeg", options, &arguments, path)?;
        let (described, frames) = sync_channel(WAITING);
        let (failed, error) = sync_channel(1);
        if let Some(pipe) = ffmpeg.stderr() {
            std::thread::spawn(move || watch(pipe, &described, &failed));
        }
        Ok(Self { ffmpeg, frames, error, path: path.to_path_buf() })
    }

    /// Decodes a film for the times of its frames, ticks.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] when the film cannot be decoded, or has more frames than bytes.
    pub(super) fn times(path: &Path, tick: Ratio, file_bytes: u64) -> Result<Vec<i64>, ImportError> {
        let mut decoding = Self::start(path, tick, "", "-f null -")?;
        let mut times = Vec::new();
        while let Some(frame) = decoding.next_frame()? {
            times.push(frame.time);
            if times.len() as u64 > file_bytes {
                return Err(ImportError::invalid(path, "the file has more frames than bytes"));
            }
        }
        Ok(times)
    }

    /// Waits for the description of the next frame; `None` after the last.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] when ffmpeg hangs or fails.
    pub(super) fn next_frame(&mut self) -> Result<Option<Decoded>, ImportError> {
        if let Some(frame) = self.ffmpeg.receive(&self.frames)? {
            return Ok(Some(frame));
        }
        let reason = self.ffmpeg.receive(&self.error)?;
        match self.ffmpeg.has_succeeded()? {
            true => Ok(None),
            false => {
                Err(ImportError::invalid(&self.path, reason.unwrap_or_else(|| "ffmpeg gave no reason".to_owned())))
            }
        }
    }
}

/// Sends the descriptions of frames on, and at the end the last error.
fn watch(pipe: ChildStderr, frames: &SyncSender<Decoded>, failed: &SyncSender<String>) {
    let mut pipe = BufReader::new(pipe);
    let mut error = None;
    let mut is_wanted = true;
    while let Some(line) = read_line(&mut pipe) {
        if let Some(frame) = Decoded::parse(&line).filter(|_| is_wanted) {
            is_wanted = frames.send(frame).is_ok();
        }
        let message = ["[error]", "[fatal]"].into_iter().find_map(|level| line.split_once(level));
        if let Some((_, message)) = message {
            error = Some(message.trim().to_owned()).filter(|message| !message.is_empty()).or(error);
        }
    }
    if let Some(error) = error {
        let _ = failed.send(error);
    }
}

/// The pixels of a film with the index of each frame among those that the file lists.
pub(super) struct Decoder {
    decoding: Decoding,
    pixels: Receiver<io::Result<Vec<u8>>>,
    ticks: Ticks,
    shape: Shape,
    next: usize,
    decoded: usize,
    is_over: bool,
    findings: Findings,
}

impl Decoder {
    /// Reads frames of `shape` from a decoding that writes grey levels.
    pub(super) fn new(mut decoding: Decoding, ticks: Ticks, shape: Shape, findings: Findings) -> Self {
        // One frame is read while the one before is used.
        let (sender, pixels) = sync_channel(0);
        if let Some(pipe) = decoding.ffmpeg.stdout() {
            std::thread::spawn(move || read_frames(pipe, shape.bytes(), &sender));
        }
        Self { decoding, pixels, ticks, shape, next: 0, decoded: 0, is_over: false, findings }
    }

    /// Reads the next frame; `None` after the last.
    fn read(&mut self) -> Result<Option<Stored>, ImportError> {
        let Some(frame) = self.decoding.next_frame()? else {
            self.report_missing();
            return Ok(None);
        };
        let index = self.index(frame)?;
        let bytes = match self.decoding.ffmpeg.receive(&self.pixels)? {
            Some(pixels) => {
                let pixels = pixels.map_err(|error| ImportError::io("read", &self.decoding.path, error))?;
                if pixels.len() as u64 == self.shape.bytes() {
                    self.next = index + 1;
                    self.decoded += 1;
                    return Ok(Some(Stored { index: index as u64, pixels }));
                }
                pixels.len()
            }
            None => 0,
        };
        // The reason why ffmpeg ended early is better than the number of bytes.
        while self.decoding.next_frame()?.is_some() {}
        Err(self.invalid(format!("{bytes} bytes of {}", self.shape.bytes())))
    }

    /// Returns the index of a frame by its time, so that a frame that ffmpeg leaves out moves no other.
    fn index(&self, frame: Decoded) -> Result<usize, ImportError> {
        let [width, height] = [self.shape.width_px, self.shape.height_px].map(u64::from);
        if [frame.width_px, frame.height_px] != [width, height] {
            return Err(self.invalid(format!(
                "the size changes from {width}x{height} to {}x{} pixels; cut the film there with ffmpeg -ss and -to",
                frame.width_px, frame.height_px
            )));
        }
        if frame.is_interlaced {
            return Err(self.invalid(INTERLACED.to_owned()));
        }
        self.ticks.index(frame.time, self.next).ok_or_else(|| {
            let tick = self.ticks.tick;
            self.invalid(format!(
                "it was decoded with the time {} in units of {}/{} s, which no packet of the file has; \
                 store the film again with ffmpeg -i FILM -fps_mode passthrough -c:v ffv1 NEW.mkv",
                frame.time, tick.over, tick.under
            ))
        })
    }

    /// Reports frames that the file lists and that were not decoded.
    fn report_missing(&self) {
        let listed = self.ticks.times.len();
        if self.decoded < listed {
            let missing = listed - self.decoded;
            self.findings.set("decoded", format!("{missing} of {listed} frames that the file lists were not decoded"));
        }
    }

    fn invalid(&self, reason: String) -> ImportError {
        ImportError::invalid(&self.decoding.path, format!("frame {}: {reason}", self.next))
    }
}

/// The reason why a film of fields is refused, with the cure.
pub(super) const INTERLACED: &str = "each frame holds two fields of different times; take them apart with \
    ffmpeg -i FILM -vf bwdif=mode=send_field -c:v ffv1 NEW.mkv, or, if the frames are progressive, mark them so with \
    ffmpeg -i FILM -vf setfield=prog -fps_mode passthrough -c:v ffv1 NEW.mkv";

/// Sends the frames of a pipe on; the last may be incomplete.
fn read_frames(mut pipe: ChildStdout, frame_bytes: u64, frames: &SyncSender<io::Result<Vec<u8>>>) {
    loop {
        let mut pixels = Vec::new();
        let read = pipe.by_ref().take(frame_bytes).read_to_end(&mut pixels);
        let is_whole = matches!(read, Ok(bytes) if bytes as u64 == frame_bytes);
        if frames.send(read.map(|_| pixels)).is_err() || !is_whole {
            return;
        }
    }
}

impl Iterator for Decoder {
    type Item = Result<Stored, ImportError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.is_over {
            return None;
        }
        let frame = self.read().transpose();
        self.is_over = !matches!(frame, Some(Ok(_)));
        frame
    }
}
