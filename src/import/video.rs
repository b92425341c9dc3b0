//! Films of any kind, decoded by an installed ffmpeg.

use super::footage::{Footage, Pixels};
use super::rate::Rate;
use super::shape::Shape;
use super::timeline::Timeline;
use super::{ImportError, RateSource, memory_limit_bytes, open_file};
use crate::image::PixelFormat;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::io::{self, ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};

/// Maximum length of the output of ffprobe, and of the messages of ffmpeg.
const OUTPUT_BYTES: u64 = 64 << 10;

pub(super) fn open(path: &Path, fps: Option<f64>) -> Result<Footage, ImportError> {
    let (_, file_bytes) = open_file(path)?;
    let stream = Stream::probe(path)?;
    let (width_px, height_px) = (stream.number("width", path)?, stream.number("height", path)?);
    let pixels = stream.entry("pix_fmt");
    let format = if stream.bits() > 8 { PixelFormat::Mono16 } else { PixelFormat::Mono8 };
    let shape = Shape::new(path, width_px, height_px, format)?;
    let bytes = shape.bytes();
    if bytes > memory_limit_bytes(file_bytes) {
        return Err(ImportError::invalid(path, format!("frames of {bytes} bytes in a file of {file_bytes}")));
    }
    let of_file = stream.rate_hz().map(|hz| Rate { hz, source: RateSource::Playback });
    let rate = Rate::known(path, fps, of_file)?;
    let mut warnings = Vec::new();
    if fps.is_none() {
        warnings.push(format!(
            "the file plays at {} frames/s; if it was filmed at another rate, pass that as --fps",
            rate.hz
        ));
    }
    if !pixels.starts_with("gray") {
        warnings.push(format!("the pixels are {pixels}, not grey; ffmpeg converts them to brightness"));
    }
    let decoder = Decoder::start(path, format, bytes)?;
    let count = stream.number("nb_read_packets", path)?;
    let description = BTreeMap::from([("codec".to_owned(), stream.entry("codec_name").to_owned())]);
    Ok(Footage { description, warnings, ..Footage::new(shape, Timeline::consecutive(rate), count, decoder) })
}

/// The properties of the first video stream of a file, as ffprobe prints them.
struct Stream(BTreeMap<String, String>);

impl Stream {
    fn probe(path: &Path) -> Result<Self, ImportError> {
        let mut arguments: Vec<OsString> = "-v error -protocol_whitelist file -select_streams v:0 -count_packets \
            -show_entries stream=codec_name,pix_fmt,width,height,avg_frame_rate,nb_read_packets -of \
            default=noprint_wrappers=1"
            .split_whitespace()
            .map(OsString::from)
            .collect();
        arguments.push(address(path));
        let mut ffprobe = spawn("ffprobe", &arguments, path)?;
        let mut output = String::new();
        let read = ffprobe.stdout.take().map_or(Ok(0), |pipe| pipe.take(OUTPUT_BYTES).read_to_string(&mut output));
        let failure = wait(ffprobe, path)?;
        read.map_err(|error| ImportError::io("read", path, error))?;
        let entries: BTreeMap<String, String> = output
            .lines()
            .filter_map(|line| line.trim().split_once('='))
            .map(|(key, value)| (key.to_owned(), value.to_owned()))
            .collect();
        if let Some(reason) = failure {
            return Err(ImportError::invalid(path, reason));
        }
        match entries.contains_key("width") {
            true => Ok(Self(entries)),
            false => Err(ImportError::invalid(path, "the file has no video stream")),
        }
    }

    fn entry(&self, key: &str) -> &str {
        self.0.get(key).map_or("", String::as_str)
    }

    fn number(&self, key: &str, path: &Path) -> Result<u64, ImportError> {
        let text = self.entry(key);
        let number = text.parse::<u32>();
        let number = number.map_err(|_| ImportError::invalid(path, format!("{key} is {text:?}, not a number")))?;
        Ok(number.into())
    }

    /// Returns the bits of a pixel's brightness from the name of ffmpeg's layout: `gray12le`, `yuv420p10le`.
    fn bits(&self) -> u32 {
        let name = self.entry("pix_fmt").trim_end_matches("le").trim_end_matches("be");
        let digits = name.len() - name.trim_end_matches(|letter: char| letter.is_ascii_digit()).len();
        name[name.len() - digits..].parse().ok().filter(|bits| (9..=16).contains(bits)).unwrap_or(8)
    }

    /// Returns the mean frame rate; `r_frame_rate` is only ffmpeg's guess at a usual one.
    fn rate_hz(&self) -> Option<f64> {
        let (frames, seconds) = self.entry("avg_frame_rate").split_once('/')?;
        let rate_hz = frames.parse::<f64>().ok()? / seconds.parse::<f64>().ok()?;
        (rate_hz.is_finite() && rate_hz > 0.0).then_some(rate_hz)
    }
}

/// The frames decoded by ffmpeg, one in memory at a time.
struct Decoder {
    path: PathBuf,
    ffmpeg: Option<(Child, ChildStdout)>,
    frame_bytes: u64,
    number: u64,
}

impl Decoder {
    fn start(path: &Path, format: PixelFormat, frame_bytes: u64) -> Result<Self, ImportError> {
        let mut arguments: Vec<OsString> = "-nostdin -v error -xerror -protocol_whitelist file,pipe -noautorotate -i"
            .split_whitespace()
            .map(OsString::from)
            .collect();
        arguments.push(address(path));
        // Every frame as it is stored: none is repeated or dropped to keep a rate.
        arguments
            .extend("-map 0:v:0 -fps_mode passthrough -f rawvideo -pix_fmt".split_whitespace().map(OsString::from));
        arguments
            .extend([if format == PixelFormat::Mono8 { "gray" } else { "gray16le" }, "pipe:1"].map(OsString::from));
        let mut ffmpeg = spawn("ffmpeg", &arguments, path)?;
        let pipe = ffmpeg.stdout.take();
        Ok(Self { path: path.to_path_buf(), ffmpeg: pipe.map(|pipe| (ffmpeg, pipe)), frame_bytes, number: 0 })
    }

    /// Reads the next frame; `None` at the end.
    fn read(&mut self) -> Result<Option<Vec<u8>>, ImportError> {
        let Some((_, pipe)) = &mut self.ffmpeg else { return Ok(None) };
        let mut pixels = Vec::new();
        let read = pipe.take(self.frame_bytes).read_to_end(&mut pixels);
        read.map_err(|error| ImportError::io("read", &self.path, error))?;
        if pixels.len() as u64 == self.frame_bytes {
            return Ok(Some(pixels));
        }
        let Some((ffmpeg, pipe)) = self.ffmpeg.take() else { return Ok(None) };
        drop(pipe);
        match wait(ffmpeg, &self.path)? {
            Some(reason) => Err(ImportError::invalid(&self.path, format!("frame {}: {reason}", self.number))),
            None if !pixels.is_empty() => {
                let reason = format!("frame {}: {} bytes of {}", self.number, pixels.len(), self.frame_bytes);
                Err(ImportError::invalid(&self.path, reason))
            }
            None => Ok(None),
        }
    }
}

impl Iterator for Decoder {
    type Item = Pixels;

    fn next(&mut self) -> Option<Self::Item> {
        let frame = self.read().transpose()?;
        self.number += 1;
        Some(frame)
    }
}

impl Drop for Decoder {
    /// Stops ffmpeg before its last frame.
    fn drop(&mut self) {
        if let Some((mut ffmpeg, _)) = self.ffmpeg.take() {
            let _ = ffmpeg.kill();
            let _ = ffmpeg.wait();
        }
    }
}

fn spawn(program: &str, arguments: &[OsString], path: &Path) -> Result<Child, ImportError> {
    let spawned = Command::new(program)
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn();
    spawned.map_err(|error| match error.kind() {
        ErrorKind::NotFound => ImportError::invalid(
            path,
            format!("needs the program {program}, which is not installed (Debian, Ubuntu: apt install ffmpeg)"),
        ),
        _ => ImportError::io("start ffmpeg for", path, error),
    })
}

/// Waits for a program and returns the reason when it failed.
fn wait(mut program: Child, path: &Path) -> Result<Option<String>, ImportError> {
    let mut messages = Vec::new();
    if let Some(mut pipe) = program.stderr.take() {
        let _ = (&mut pipe).take(OUTPUT_BYTES).read_to_end(&mut messages);
        let _ = io::copy(&mut pipe, &mut io::sink());
    }
    let status = program.wait().map_err(|error| ImportError::io("read", path, error))?;
    let messages = String::from_utf8_lossy(&messages);
    let line = messages.lines().map(str::trim).rfind(|line| !line.is_empty()).unwrap_or("ffmpeg gave no reason");
    Ok((!status.success()).then(|| line.to_owned()))
}

/// Returns the address of a file, which keeps ffmpeg from reading its name as an option or a protocol.
fn address(path: &Path) -> OsString {
    let mut address = OsString::from("file:");
    address.push(path);
    address
}
