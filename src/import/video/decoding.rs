//! A running ffmpeg, which describes each frame that it decodes.

use super::super::ImportError;
use super::program::{Program, file_url, read_line};
use super::stream::Ratio;
use std::ffi::OsString;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::process::{ChildStderr, ChildStdout};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

/// Number of frames whose descriptions may wait to be read.
const MAX_WAITING_FRAMES: usize = 64;
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
    /// Parses a line of `showinfo`: `n: 0 pts: 64 pts_time:0.004 ... s:64x48 i:P iskey:1`; `None` for other lines.
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
    pub(super) path: PathBuf,
}

impl Decoding {
    /// Starts to decode `path`, opened with the options `input`, with times in units of `tick`. `filters` follow after
    /// the description, `output` are the last arguments.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] without ffmpeg.
    pub(super) fn start(
        path: &Path,
        input: &str,
        tick: Ratio,
        filters: &str,
        output: &str,
    ) -> Result<Self, ImportError> {
        let mut arguments = vec![file_url(path)];
        // Every frame as it is stored: none is repeated or dropped to keep a rate.
        let describe = format!("settb=tb={}/{},showinfo=checksum=0", tick.over, tick.under);
        arguments.extend("-map 0:V:0 -fps_mode passthrough -vf".split_whitespace().map(OsString::from));
        arguments.push(format!("{describe}{filters}").into());
        arguments.extend(output.split_whitespace().map(OsString::from));
        let options = format!(
            "-nostdin -hide_banner -nostats -loglevel repeat+level+info -xerror -protocol_whitelist file,pipe \
             -noautorotate -copyts {input} -i"
        );
        let mut ffmpeg = Program::start("ffmpeg", &options, &arguments, path)?;
        let (described, frames) = sync_channel(MAX_WAITING_FRAMES);
        let (failed, error) = sync_channel(1);
        if let Some(pipe) = ffmpeg.stderr() {
            std::thread::spawn(move || read_messages(pipe, &described, &failed));
        }
        Ok(Self { ffmpeg, frames, error, path: path.to_path_buf() })
    }

    /// Decodes a film and returns the times of its frames, ticks, in the order of decoding.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] when the film cannot be decoded, or has more frames than bytes.
    pub(super) fn read_times(path: &Path, input: &str, tick: Ratio, file_bytes: u64) -> Result<Vec<i64>, ImportError> {
        let mut decoding = Self::start(path, input, tick, "", "-f null -")?;
        let mut times = Vec::new();
        while let Some(frame) = decoding.next_frame()? {
            times.push(frame.time);
            if times.len() as u64 > file_bytes {
                return Err(ImportError::invalid(path, "the file has more frames than bytes"));
            }
        }
        Ok(times)
    }

    /// Takes the pipe of the pixels; `None` if it was taken.
    pub(super) fn pixels(&mut self) -> Option<ChildStdout> {
        self.ffmpeg.stdout()
    }

    /// Waits for what a thread reads from [`Self::pixels`]; `None` at its end.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] when ffmpeg hangs.
    pub(super) fn receive<T>(&self, from: &Receiver<T>) -> Result<Option<T>, ImportError> {
        self.ffmpeg.receive(from)
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

/// Reads the messages of ffmpeg: sends the descriptions of frames on, and at the end the last error.
fn read_messages(pipe: ChildStderr, frames: &SyncSender<Decoded>, failed: &SyncSender<String>) {
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
