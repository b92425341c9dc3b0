//! Films of any kind, through an installed ffmpeg.

use super::{Footage, ImportError, Numbered, Stamps, frame_bytes, frame_rate};
use crate::image::PixelFormat;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};

/// Longest answer of ffprobe.
const ANSWER_BYTES: u64 = 64 << 10;
/// A frame may take twice the file's size and this much more: what decodes to more than that is no film of an impact.
const SPARE_BYTES: u64 = 64 << 20;

pub(super) fn open(path: &Path, fps: Option<f64>) -> Result<Footage, ImportError> {
    let file = File::open(path).map_err(|error| ImportError::io("open", path, error))?;
    let file_bytes = file.metadata().map_err(|error| ImportError::io("open", path, error))?.len();
    let about = Stream::look(path)?;
    let (width_px, height_px) = (about.whole("width", path)?, about.whole("height", path)?);
    let kind = about.word("pix_fmt");
    let format = if about.bits() > 8 { PixelFormat::Mono16 } else { PixelFormat::Mono8 };
    let bytes = frame_bytes(path, width_px, height_px, format)?;
    if bytes > file_bytes.saturating_mul(2).saturating_add(SPARE_BYTES) {
        return Err(ImportError::invalid(path, format!("frames of {bytes} bytes in a file of {file_bytes}")));
    }
    let told = about.rate_hz();
    let frame_rate_hz = frame_rate(path, fps, told)?;
    let mut warnings = Vec::new();
    if fps.is_none() {
        warnings.push(format!(
            "the file plays at {frame_rate_hz} frames/s; if it was filmed at another rate, give that with --fps"
        ));
    }
    if !kind.starts_with("gray") {
        warnings.push(format!("its pixels are {kind}, not grey: the brightness that ffmpeg makes of them is measured"));
    }
    let decoder = Decoder::start(path, format, bytes)?;
    let count = about.whole("nb_read_packets", path)?;
    let mut description = BTreeMap::new();
    description.insert("codec".to_owned(), about.word("codec_name").to_owned());
    Ok(Footage {
        width_px: width_px as u32,
        height_px: height_px as u32,
        format,
        frame_rate_hz,
        count,
        description,
        warnings,
        frames: Box::new(decoder),
        stamps: Stamps { first_ns: 0, frame_rate_hz },
    })
}

/// What ffprobe tells of the first film in a file.
struct Stream(BTreeMap<String, String>);

impl Stream {
    fn look(path: &Path) -> Result<Self, ImportError> {
        let mut words: Vec<OsString> = "-v error -protocol_whitelist file -select_streams v:0 -count_packets \
            -show_entries stream=codec_name,pix_fmt,width,height,avg_frame_rate,nb_read_packets -of \
            default=noprint_wrappers=1"
            .split_whitespace()
            .map(OsString::from)
            .collect();
        words.push(address(path));
        let mut ffprobe = spawn("ffprobe", &words, path)?;
        let mut answer = String::new();
        let read = ffprobe.stdout.take().map_or(Ok(0), |pipe| pipe.take(ANSWER_BYTES).read_to_string(&mut answer));
        let told = end(ffprobe, path)?;
        read.map_err(|error| ImportError::io("read", path, error))?;
        let entries: BTreeMap<String, String> = answer
            .lines()
            .filter_map(|line| line.trim().split_once('='))
            .map(|(key, value)| (key.to_owned(), value.to_owned()))
            .collect();
        if let Some(reason) = told {
            return Err(ImportError::invalid(path, reason));
        }
        match entries.contains_key("width") {
            true => Ok(Self(entries)),
            false => Err(ImportError::invalid(path, "holds no film")),
        }
    }

    fn word(&self, key: &str) -> &str {
        self.0.get(key).map_or("", String::as_str)
    }

    fn whole(&self, key: &str, path: &Path) -> Result<u64, ImportError> {
        let word = self.word(key);
        let number = word.parse::<u32>().map_err(|_| ImportError::invalid(path, format!("{key} is {word:?}")))?;
        Ok(number.into())
    }

    /// Bits of a pixel's brightness, as the names of ffmpeg's layouts tell them: `gray12le`, `yuv420p10le`.
    fn bits(&self) -> u32 {
        let name = self.word("pix_fmt").trim_end_matches("le").trim_end_matches("be");
        let digits = name.len() - name.trim_end_matches(|letter: char| letter.is_ascii_digit()).len();
        name[name.len() - digits..].parse().ok().filter(|bits| (9..=16).contains(bits)).unwrap_or(8)
    }

    /// The rate of the file; `r_frame_rate` is but a guess at a usual one.
    fn rate_hz(&self) -> Option<f64> {
        let (frames, seconds) = self.word("avg_frame_rate").split_once('/')?;
        let rate_hz = frames.parse::<f64>().ok()? / seconds.parse::<f64>().ok()?;
        (rate_hz.is_finite() && rate_hz > 0.0).then_some(rate_hz)
    }
}

/// The frames that ffmpeg decodes, one in memory at a time.
struct Decoder {
    path: PathBuf,
    ffmpeg: Option<(Child, ChildStdout)>,
    frame_bytes: u64,
    number: u64,
}

impl Decoder {
    fn start(path: &Path, format: PixelFormat, frame_bytes: u64) -> Result<Self, ImportError> {
        let mut words: Vec<OsString> = "-nostdin -v error -xerror -protocol_whitelist file,pipe -noautorotate -i"
            .split_whitespace()
            .map(OsString::from)
            .collect();
        words.push(address(path));
        // Every frame as it is stored, none repeated or left out to keep a rate.
        words.extend("-map 0:v:0 -fps_mode passthrough -f rawvideo -pix_fmt".split_whitespace().map(OsString::from));
        words.extend([if format == PixelFormat::Mono8 { "gray" } else { "gray16le" }, "pipe:1"].map(OsString::from));
        let mut ffmpeg = spawn("ffmpeg", &words, path)?;
        let pipe = ffmpeg.stdout.take();
        Ok(Self { path: path.to_path_buf(), ffmpeg: pipe.map(|pipe| (ffmpeg, pipe)), frame_bytes, number: 0 })
    }

    /// The next frame; `None` at the end.
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
        let told = end(ffmpeg, &self.path)?;
        match told {
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
    type Item = Result<Numbered, ImportError>;

    fn next(&mut self) -> Option<Self::Item> {
        let frame = self.read().transpose()?;
        let number = self.number;
        self.number += 1;
        Some(frame.map(|pixels| (number, pixels)))
    }
}

impl Drop for Decoder {
    /// Ends a decoder whose frames nobody wants any more.
    fn drop(&mut self) {
        if let Some((mut ffmpeg, _)) = self.ffmpeg.take() {
            let _ = ffmpeg.kill();
            let _ = ffmpeg.wait();
        }
    }
}

fn spawn(program: &str, words: &[OsString], path: &Path) -> Result<Child, ImportError> {
    let spawned =
        Command::new(program).args(words).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    spawned.map_err(|error| match error.kind() {
        ErrorKind::NotFound => ImportError::invalid(
            path,
            format!("needs the program {program}, which is not installed (Debian, Ubuntu: apt install ffmpeg)"),
        ),
        _ => ImportError::io("start ffmpeg for", path, error),
    })
}

/// Waits for the program; why it failed, if it did.
fn end(mut program: Child, path: &Path) -> Result<Option<String>, ImportError> {
    let mut told = Vec::new();
    if let Some(mut pipe) = program.stderr.take() {
        let _ = (&mut pipe).take(ANSWER_BYTES).read_to_end(&mut told);
        let _ = io::copy(&mut pipe, &mut io::sink());
    }
    let status = program.wait().map_err(|error| ImportError::io("read", path, error))?;
    let told = String::from_utf8_lossy(&told);
    let line = told.lines().map(str::trim).rfind(|line| !line.is_empty()).unwrap_or("ffmpeg did not say why");
    Ok((!status.success()).then(|| line.to_owned()))
}

/// The file, whatever its name looks like.
fn address(path: &Path) -> OsString {
    let mut address = OsString::from("file:");
    address.push(path);
    address
}
