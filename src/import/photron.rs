//! Photron recordings: a CIH or CIHX header next to an MRAW file of pixels.

use super::footage::{Footage, Shape};
use super::timeline::{Rate, Timeline};
use super::{ImportError, extension, open_file};
use crate::image::PixelFormat;
use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Maximum length of a header. Headers have a few kB.
const HEADER_BYTES: u64 = 4 << 20;

/// The content of the header.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Header {
    width_px: u64,
    height_px: u64,
    frames: u64,
    stored_bits: u64,
    significant_bits: u64,
    /// Whether the significant bits are at the upper end of a stored word.
    is_upper: bool,
    frame_rate_hz: f64,
    skip_frames: u64,
}

pub(super) fn open(path: &Path, fps: Option<f64>) -> Result<Footage, ImportError> {
    let (header_path, pixels_path) = pair(path)?;
    let text = header_text(&header_path)?;
    let header = Header::parse(&text).map_err(|reason| ImportError::invalid(&header_path, reason))?;
    let format = format(&header).map_err(|reason| ImportError::invalid(&header_path, reason))?;
    let shape = Shape::new(&header_path, header.width_px, header.height_px, format)?;
    let stored_bits = header.width_px * header.height_px * header.stored_bits;
    if stored_bits % 8 != 0 {
        return Err(ImportError::invalid(
            &header_path,
            format!("a frame of {stored_bits} bits does not end at a byte"),
        ));
    }
    let stored_bytes = stored_bits / 8;

    let (file, file_bytes) = open_file(&pixels_path)?;
    let count = header.frames.min(file_bytes / stored_bytes);
    if count == 0 {
        return Err(ImportError::invalid(
            &pixels_path,
            format!("{file_bytes} bytes are less than a frame of {stored_bytes}"),
        ));
    }
    let mut warnings = Vec::new();
    if count < header.frames {
        warnings.push(format!("the header announces {} frames, the file has {count}", header.frames));
    }
    if header.skip_frames > 1 && fps.is_none() {
        warnings.push(format!(
            "the header has skipFrame {}: the frames may be further apart than its record rate",
            header.skip_frames
        ));
    }
    let rate = Rate::known(&header_path, fps, Rate::of_header(header.frame_rate_hz, "record rate"))?;
    let frames = (0..count).map(move |number| {
        let mut stored = vec![0; stored_bytes as usize];
        file.read_exact_at(&mut stored, number * stored_bytes)
            .map_err(|error| ImportError::io("read", &pixels_path, error))?;
        Ok(unpack(&header, stored))
    });
    let description = description(&text);
    Ok(Footage { description, warnings, ..Footage::new(shape, Timeline::consecutive(rate), count, frames) })
}

/// Finds the header and the pixels, given either of them.
fn pair(path: &Path) -> Result<(PathBuf, PathBuf), ImportError> {
    let find = |endings: &[&str], missing: &str| {
        let found = endings.iter().map(|ending| path.with_extension(ending)).find(|candidate| candidate.exists());
        found.ok_or_else(|| ImportError::invalid(path, missing))
    };
    match extension(path).as_str() {
        "mraw" => {
            let header = find(&["cihx", "CIHX", "cih", "CIH"], "the .cihx or .cih header next to it is missing")?;
            Ok((header, path.to_path_buf()))
        }
        _ => Ok((path.to_path_buf(), find(&["mraw", "MRAW", "Mraw"], "the .mraw file next to it is missing")?)),
    }
}

fn header_text(path: &Path) -> Result<String, ImportError> {
    let io = |error| ImportError::io("open", path, error);
    let bytes = fs::metadata(path).map_err(io)?.len();
    if bytes > HEADER_BYTES {
        return Err(ImportError::invalid(
            path,
            format!("{bytes} bytes are too many for a header; at most {HEADER_BYTES} are read"),
        ));
    }
    Ok(String::from_utf8_lossy(&fs::read(path).map_err(io)?).into_owned())
}

/// The name of a property in a CIHX header (XML) and in a CIH header (lines of `name : value`).
struct Key {
    path: &'static [&'static str],
    name: &'static str,
}

impl Key {
    const fn new(path: &'static [&'static str], name: &'static str) -> Self {
        Self { path, name }
    }

    /// Returns the text of the property in the header.
    fn text<'a>(&self, header: &'a str) -> Result<&'a str, String> {
        // A short binary part precedes the XML.
        if let Some(start) = header.find("<cih>") {
            return element(&header[start..], self.path).ok_or_else(|| format!("no <{}>", self.path.join("><")));
        }
        let mut lines = header.lines().filter_map(|line| line.split_once(':'));
        let line = lines.find(|(name, _)| name.trim() == self.name);
        line.map(|(_, value)| value.trim()).ok_or_else(|| format!("no {:?}", self.name))
    }

    /// Returns the property as a number.
    fn number<T: FromStr>(&self, header: &str) -> Result<T, String> {
        let text = self.text(header)?;
        text.parse().map_err(|_| format!("{} is {text:?}, not a number", self.name))
    }
}

const COLOR_TYPE: Key = Key::new(&["imageDataInfo", "colorInfo", "type"], "Color Type");
const WIDTH: Key = Key::new(&["imageDataInfo", "resolution", "width"], "Image Width");
const HEIGHT: Key = Key::new(&["imageDataInfo", "resolution", "height"], "Image Height");
const FRAMES: Key = Key::new(&["frameInfo", "totalFrame"], "Total Frame");
const STORED_BITS: Key = Key::new(&["imageDataInfo", "colorInfo", "bit"], "Color Bit");
const SIGNIFICANT_BITS: Key = Key::new(&["imageDataInfo", "effectiveBit", "depth"], "EffectiveBit Depth");
const SIDE: Key = Key::new(&["imageDataInfo", "effectiveBit", "side"], "EffectiveBit Side");
const RECORD_RATE: Key = Key::new(&["recordInfo", "recordRate"], "Record Rate(fps)");
const SKIP_FRAMES: Key = Key::new(&["frameInfo", "skipFrame"], "skipFrame");

impl Header {
    fn parse(text: &str) -> Result<Self, String> {
        let kind = COLOR_TYPE.text(text)?;
        if kind != "Mono" {
            return Err(format!("colour type {kind:?}; only Mono is supported"));
        }
        Ok(Self {
            width_px: WIDTH.number(text)?,
            height_px: HEIGHT.number(text)?,
            frames: FRAMES.number(text)?,
            stored_bits: STORED_BITS.number(text)?,
            significant_bits: SIGNIFICANT_BITS.number(text)?,
            is_upper: SIDE.text(text)? != "Lower",
            frame_rate_hz: RECORD_RATE.number(text)?,
            skip_frames: SKIP_FRAMES.number(text).unwrap_or(1),
        })
    }
}

/// Returns the text inside nested elements. The elements read here have no attributes.
fn element<'a>(xml: &'a str, path: &[&str]) -> Option<&'a str> {
    path.iter().try_fold(xml, |inside, name| {
        let start = inside.find(&format!("<{name}>"))? + name.len() + 2;
        let length = inside[start..].find(&format!("</{name}>"))?;
        Some(inside[start..start + length].trim())
    })
}

fn format(header: &Header) -> Result<PixelFormat, String> {
    if header.significant_bits > header.stored_bits {
        return Err(format!("{} significant bits in {}", header.significant_bits, header.stored_bits));
    }
    match (header.stored_bits, header.significant_bits) {
        (8, 8) => Ok(PixelFormat::Mono8),
        (10, _) | (16, 10) => Ok(PixelFormat::Mono10),
        (12, _) | (16, 12) => Ok(PixelFormat::Mono12),
        (16, _) => Ok(PixelFormat::Mono16),
        (stored, significant) => {
            Err(format!("{stored} bits per pixel, {significant} significant; 8, 10, 12 and 16 are supported"))
        }
    }
}

/// Unpacks pixels to whole little-endian bytes with the significant bits at the lower end.
fn unpack(header: &Header, stored: Vec<u8>) -> Vec<u8> {
    match header.stored_bits {
        8 => stored,
        16 if header.is_upper && header.significant_bits < 16 => {
            let shift = 16 - header.significant_bits;
            let words = stored.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]]) >> shift);
            words.flat_map(u16::to_le_bytes).collect()
        }
        16 => stored,
        bits => super::unpack_high_first(&stored, bits as u32),
    }
}

fn description(text: &str) -> BTreeMap<String, String> {
    let entries = [
        ("camera", element(text, &["deviceInfo", "deviceName"])),
        ("date", element(text, &["fileInfo", "date"])),
        ("exposure_ns", element(text, &["recordInfo", "shutterSpeedNsec"])),
    ];
    entries.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?.to_owned()))).collect()
}
