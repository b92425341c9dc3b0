//! Frames as a video, encoded by an installed ffmpeg.

use super::picture::{draw_frames, grey_levels};
use super::{ExportError, ExportOptions, Format};
use crate::interrupt::{self, Unfinished};
use std::ffi::OsString;
use std::io::{self, ErrorKind, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::thread::JoinHandle;

/// The number of bytes kept of the messages of ffmpeg.
const MESSAGE_BYTES: u64 = 64 << 10;

/// Writes the frames as a video to a path and returns their number. No other file is written.
///
/// # Errors
///
/// [`ExportError`] when a file cannot be read, the frames differ in size, or ffmpeg is missing or fails.
pub(super) fn write(options: &ExportOptions, to: &Path) -> Result<u64, ExportError> {
    let recording = options.open_recording()?;
    let frames = options.open_frames(&recording)?;
    let failed = |source| ExportError::Write { to: to.display().to_string(), source };
    let mut video: Option<Video> = None;
    let mut count = 0;
    let mut take = |[width, height]: [u32; 2], kind: &'static str, pixels: &[u8]| {
        let video = match &mut video {
            Some(video) => video,
            none => none.insert(Video::start(options, to, [width, height], kind)?),
        };
        if video.size != [width, height] {
            return Err(failed(io::Error::other(format!("frame {count} has another size than the first one"))));
        }
        count += 1;
        video.push(pixels).map_err(failed)
    };
    if options.topic == "frames" {
        for frame in frames {
            let (meta, bytes) = frame?;
            let levels = grey_levels(meta, &bytes).map_err(failed)?;
            take([meta.width_px, meta.height_px], "gray", &levels)?;
        }
    } else {
        draw_frames(&recording, frames, &options.topic, |_, picture| {
            let picture = picture.map_err(failed)?;
            take([picture.width(), picture.height()], "rgb24", picture.as_raw())
        })?;
    }
    video.map_or(Ok(()), Video::finish).map_err(failed)?;
    Ok(count)
}

/// A video that is being encoded.
struct Video {
    size: [u32; 2],
    ffmpeg: Child,
    /// The input of ffmpeg; `None` once it exited.
    frames: Option<ChildStdin>,
    messages: JoinHandle<String>,
    _unfinished: Unfinished,
}

impl Video {
    /// Starts ffmpeg for frames of this size and pixel layout.
    ///
    /// # Errors
    ///
    /// [`ExportError`] when ffmpeg is not installed or does not start.
    fn start(options: &ExportOptions, to: &Path, size: [u32; 2], kind: &str) -> Result<Self, ExportError> {
        let word = options.format.as_str();
        let mut command = Command::new("ffmpeg");
        command.args(arguments(options, size, kind)).arg(file_url(to));
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        let (mut ffmpeg, unfinished) = interrupt::program(|| command.spawn()).map_err(|error| match error.kind() {
            ErrorKind::NotFound => {
                let reason = "needs the program ffmpeg, which is not installed (Debian, Ubuntu: apt install ffmpeg)";
                ExportError::Usage(format!("--format {word}: {reason}"))
            }
            _ => ExportError::Write { to: "ffmpeg".into(), source: error },
        })?;
        let mut stderr = ffmpeg.stderr.take();
        let messages = std::thread::spawn(move || {
            let mut text = Vec::new();
            if let Some(pipe) = &mut stderr {
                let _ = pipe.take(MESSAGE_BYTES).read_to_end(&mut text);
                let _ = io::copy(pipe, &mut io::sink());
            }
            String::from_utf8_lossy(&text).into_owned()
        });
        Ok(Self { size, frames: ffmpeg.stdin.take(), ffmpeg, messages, _unfinished: unfinished })
    }

    /// Writes the pixels of the next frame to ffmpeg; nothing once it has exited.
    fn push(&mut self, pixels: &[u8]) -> io::Result<()> {
        let Some(frames) = &mut self.frames else { return Ok(()) };
        match frames.write_all(pixels) {
            // It exited; its messages give the reason at the end.
            Err(error) if error.kind() == ErrorKind::BrokenPipe => self.frames = None,
            written => written?,
        }
        Ok(())
    }

    /// Closes the input of ffmpeg, and waits for its end.
    ///
    /// # Errors
    ///
    /// The last message of ffmpeg when it failed.
    fn finish(mut self) -> io::Result<()> {
        let is_complete = self.frames.take().is_some();
        let status = self.ffmpeg.wait()?;
        let messages = self.messages.join().unwrap_or_default();
        if status.success() && is_complete {
            return Ok(());
        }
        let line = messages.lines().map(str::trim).rfind(|line| !line.is_empty()).unwrap_or("it gave no reason");
        Err(io::Error::other(format!("ffmpeg ended with {status}: {line}")))
    }
}

/// Returns the arguments that encode raw frames from standard input as a video for common players.
fn arguments(options: &ExportOptions, [width, height]: [u32; 2], kind: &str) -> Vec<OsString> {
    let (size, rate) = (format!("{width}x{height}"), options.playback_hz.to_string());
    let mut words: Vec<&str> = "-nostdin -hide_banner -loglevel error -f rawvideo -pixel_format".split(' ').collect();
    words.extend([kind, "-video_size", &size, "-framerate", &rate, "-i", "pipe:0"]);
    match (options.format, kind) {
        // A GIF has 256 colours, as many as there are grey levels.
        (Format::Gif, "gray") => words.extend(["-pix_fmt", "gray", "-f", "gif"]),
        (Format::Gif, _) => {
            words.extend(["-filter_complex", "split[a][b];[a]palettegen[p];[b][p]paletteuse=dither=none", "-f", "gif"]);
        }
        // Players need 4:2:0, which halves both dimensions of the colour planes.
        _ => words.extend([
            "-vf",
            "pad=ceil(iw/2)*2:ceil(ih/2)*2",
            "-pix_fmt",
            "yuv420p",
            "-c:v",
            "libx264",
            "-crf",
            "12",
            "-movflags",
            "+faststart",
            "-f",
            "mp4",
        ]),
    }
    words.push("-y");
    words.into_iter().map(OsString::from).collect()
}

/// Returns the URL of a file, which keeps ffmpeg from reading its name as an option or a protocol.
fn file_url(path: &Path) -> OsString {
    let mut url = OsString::from("file:");
    url.push(path);
    url
}
