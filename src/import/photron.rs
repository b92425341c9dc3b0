//! Photron recordings: a CIH or CIHX header next to an MRAW file of pixels.

use super::{Footage, ImportError, extension, frame_bytes, frame_rate, open_file};
use crate::image::PixelFormat;
use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

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
    let header = parse(&text).map_err(|reason| ImportError::invalid(&header_path, reason))?;
    let format = format(&header).map_err(|reason| ImportError::invalid(&header_path, reason))?;
    frame_bytes(&header_path, header.width_px, header.height_px, format)?;
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
    let frame_rate_hz = frame_rate(&header_path, fps, Some(header.frame_rate_hz))?;
    let frames = (0..count).map(move |number| {
        let mut stored = vec![0; stored_bytes as usize];
        file.read_exact_at(&mut stored, number * stored_bytes)
            .map_err(|error| ImportError::io("read", &pixels_path, error))?;
        Ok((number, unpack(&header, stored)))
    });
    Ok(Footage {
        width_px: header.width_px as u32,
        height_px: header.height_px as u32,
        format,
        frame_rate_hz,
        count,
        description: description(&text),
        warnings,
        first_ns: 0,
        frames: Box::new(frames),
    })
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

fn parse(text: &str) -> Result<Header, String> {
    match text.find("<cih>") {
        Some(start) => parse_xml(&text[start..]),
        None => parse_lines(text),
    }
}

/// Parses a CIHX header: XML after a short binary part.
fn parse_xml(xml: &str) -> Result<Header, String> {
    let word = |path: &[&str]| element(xml, path).ok_or_else(|| format!("no <{}>", path.join("><")));
    let whole = |path: &[&str]| {
        let word = word(path)?;
        word.parse::<u64>().map_err(|_| format!("<{}> is {word:?}, not a whole number", path.join("><")))
    };
    let kind = word(&["imageDataInfo", "colorInfo", "type"])?;
    if kind != "Mono" {
        return Err(format!("colour type {kind:?}; only Mono is supported"));
    }
    let rate = word(&["recordInfo", "recordRate"])?;
    Ok(Header {
        width_px: whole(&["imageDataInfo", "resolution", "width"])?,
        height_px: whole(&["imageDataInfo", "resolution", "height"])?,
        frames: whole(&["frameInfo", "totalFrame"])?,
        stored_bits: whole(&["imageDataInfo", "colorInfo", "bit"])?,
        significant_bits: whole(&["imageDataInfo", "effectiveBit", "depth"])?,
        is_upper: word(&["imageDataInfo", "effectiveBit", "side"])? != "Lower",
        frame_rate_hz: rate.parse().map_err(|_| format!("record rate {rate:?}"))?,
        skip_frames: whole(&["frameInfo", "skipFrame"]).unwrap_or(1),
    })
}

/// Returns the text inside nested elements. The elements read here have no attributes.
fn element<'a>(xml: &'a str, path: &[&str]) -> Option<&'a str> {
    path.iter().try_fold(xml, |inside, name| {
        let start = inside.find(&format!("<{name}>"))? + name.len() + 2;
        let length = inside[start..].find(&format!("</{name}>"))?;
        Some(inside[start..start + length].trim())
    })
}

/// Parses a CIH header: lines of `name : value`.
fn parse_lines(text: &str) -> Result<Header, String> {
    let word = |name: &str| {
        let mut pairs = text.lines().filter_map(|line| line.split_once(':'));
        pairs.find(|(key, _)| key.trim() == name).map(|(_, value)| value.trim()).ok_or_else(|| format!("no {name:?}"))
    };
    let whole = |name: &str| {
        let word = word(name)?;
        word.parse::<u64>().map_err(|_| format!("{name} is {word:?}, not a whole number"))
    };
    let kind = word("Color Type")?;
    if kind != "Mono" {
        return Err(format!("colour type {kind:?}; only Mono is supported"));
    }
    let rate = word("Record Rate(fps)")?;
    Ok(Header {
        width_px: whole("Image Width")?,
        height_px: whole("Image Height")?,
        frames: whole("Total Frame")?,
        stored_bits: whole("Color Bit")?,
        significant_bits: whole("EffectiveBit Depth")?,
        is_upper: word("EffectiveBit Side")? != "Lower",
        frame_rate_hz: rate.parse().map_err(|_| format!("record rate {rate:?}"))?,
        skip_frames: 1,
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
