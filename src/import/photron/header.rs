//! The header of a Photron recording: XML in a CIHX file, lines of `name : value` in a CIH file.

use crate::import::ImportError;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::str::FromStr;

/// Maximum length of a header. Headers have a few kB.
const MAX_HEADER_BYTES: u64 = 4 << 20;
/// Maximum length of a value that is printed.
const MAX_VALUE_CHARACTERS: usize = 40;

/// The text of a header.
pub(super) struct Header {
    text: String,
}

/// A property: its place in a CIHX header, and its names in a CIH header, in lower-case letters and digits only.
#[derive(Debug, Clone, Copy)]
pub(super) struct Key {
    path: &'static [&'static str],
    names: &'static [&'static str],
}

pub(super) const COLOR_TYPE: Key = Key { path: &["imageDataInfo", "colorInfo", "type"], names: &["colortype"] };
pub(super) const WIDTH: Key = Key { path: &["imageDataInfo", "resolution", "width"], names: &["imagewidth"] };
pub(super) const HEIGHT: Key = Key { path: &["imageDataInfo", "resolution", "height"], names: &["imageheight"] };
pub(super) const FRAMES: Key = Key { path: &["frameInfo", "totalFrame"], names: &["totalframe"] };
pub(super) const RECORDED_FRAMES: Key = Key { path: &["frameInfo", "recordedFrame"], names: &["originaltotalframe"] };
pub(super) const STORED_BITS: Key = Key { path: &["imageDataInfo", "colorInfo", "bit"], names: &["colorbit"] };
pub(super) const SIGNIFICANT_BITS: Key =
    Key { path: &["imageDataInfo", "effectiveBit", "depth"], names: &["effectivebitdepth"] };
pub(super) const SIDE: Key = Key { path: &["imageDataInfo", "effectiveBit", "side"], names: &["effectivebitside"] };
pub(super) const RECORD_RATE: Key = Key { path: &["recordInfo", "recordRate"], names: &["recordrate"] };
pub(super) const SAVE_STEP: Key =
    Key { path: &["frameInfo", "skipFrame"], names: &["savestep", "skipframe", "framestep", "saveskip"] };
pub(super) const FILE_FORMAT: Key = Key { path: &["imageFileInfo", "fileFormat"], names: &["fileformat"] };
const CAMERA: Key = Key { path: &["deviceInfo", "deviceName"], names: &["cameratype"] };
const DATE: Key = Key { path: &["fileInfo", "date"], names: &["date"] };
const TIME: Key = Key { path: &["fileInfo", "time"], names: &["time"] };
const START_FRAME: Key = Key { path: &["frameInfo", "startFrame"], names: &["startframe"] };
const EXPOSURE_NS: Key = Key { path: &["recordInfo", "shutterSpeedNsec"], names: &["shutterspeednsec"] };
const SHUTTER_S: Key = Key { path: &[], names: &["shutterspeed"] };

impl Header {
    /// Reads a header of any usual encoding: keys and numbers are the same letters in UTF-8 and in Shift JIS.
    pub(super) fn read(path: &Path) -> Result<Self, ImportError> {
        let io = |error| ImportError::io("open", path, error);
        let bytes = fs::metadata(path).map_err(io)?.len();
        if bytes > MAX_HEADER_BYTES {
            let reason = format!("{bytes} bytes are too many for a header; at most {MAX_HEADER_BYTES} are read");
            return Err(ImportError::invalid(path, reason));
        }
        let bytes = fs::read(path).map_err(io)?;
        let words = || bytes[2..].chunks_exact(2);
        let text = match bytes.get(..2) {
            Some([0xff, 0xfe]) => decode_utf16(words().map(|pair| u16::from_le_bytes([pair[0], pair[1]]))),
            Some([0xfe, 0xff]) => decode_utf16(words().map(|pair| u16::from_be_bytes([pair[0], pair[1]]))),
            _ => String::from_utf8_lossy(&bytes).into_owned(),
        };
        Ok(Self { text: text.trim_start_matches('\u{feff}').to_owned() })
    }

    /// Returns the value of a property as text, from the XML or from the lines of the header.
    ///
    /// # Errors
    ///
    /// Returns the reason if the header has no such property.
    pub(super) fn text(&self, key: Key) -> Result<&str, String> {
        // A short binary part precedes the XML.
        if let Some(start) = self.text.find("<cih>").or_else(|| self.text.find("<cih ")) {
            return element_text(&self.text[start..], key.path).ok_or_else(|| format!("no <{}>", key.path.join("><")));
        }
        let mut lines = self.text.lines().filter_map(|line| line.split_once(':'));
        let line = lines.find(|(name, _)| key.names.contains(&plain_name(name).as_str()));
        line.map(|(_, value)| value.trim()).ok_or_else(|| format!("no {:?}", key.names[0]))
    }

    /// Returns a property as a number. A unit may follow it.
    ///
    /// # Errors
    ///
    /// The reason if the header has no such property, or it is no number.
    pub(super) fn number<T: FromStr>(&self, key: Key) -> Result<T, String> {
        let text = self.text(key)?;
        let number: String = text.chars().take_while(|letter| letter.is_ascii_digit() || *letter == '.').collect();
        let value: String = text.chars().take(MAX_VALUE_CHARACTERS).collect();
        number.parse().map_err(|_| format!("{} is {value:?}, not a number", key.names[0]))
    }

    /// Returns the properties of the recording: camera, date, first frame and exposure, where they are known.
    pub(super) fn description(&self) -> BTreeMap<String, String> {
        let text = |key: Key| self.text(key).ok().filter(|text| !text.is_empty()).map(str::to_owned);
        let exposure_us = self.number::<f64>(EXPOSURE_NS).ok().map(|exposure_ns| exposure_ns * 1e-3).or_else(|| {
            let (one, per_s) = self.text(SHUTTER_S).ok()?.split_once('/')?;
            Some(1e6 * one.trim().parse::<f64>().ok()? / per_s.trim().parse::<f64>().ok()?)
        });
        let entries = [
            ("camera", text(CAMERA)),
            ("date", self.date()),
            ("start_frame", text(START_FRAME)),
            ("exposure_us", exposure_us.filter(|us| us.is_finite()).map(|us| format!("{us:.3}"))),
        ];
        entries.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?))).collect()
    }

    /// Returns the date, and the time of day where it is known, as in ISO 8601.
    fn date(&self) -> Option<String> {
        let date = self.text(DATE).ok()?;
        let parts: Option<Vec<u32>> = date.split(['/', '-', '.']).map(|part| part.trim().parse().ok()).collect();
        let [year, month, day] = parts?.try_into().ok()?;
        let time = self.text(TIME).ok().filter(|time| time.contains(':')).map(|time| format!("T{time}"));
        Some(format!("{year:04}-{month:02}-{day:02}{}", time.unwrap_or_default()))
    }
}

/// Decodes UTF-16. Unpaired surrogates become the replacement character.
fn decode_utf16(words: impl Iterator<Item = u16>) -> String {
    char::decode_utf16(words).map(|letter| letter.unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
}

/// Returns the letters and digits of a name, without its unit in brackets: `recordrate` for `Record Rate(fps)`.
fn plain_name(name: &str) -> String {
    let name = name.split('(').next().unwrap_or_default();
    name.chars().filter(char::is_ascii_alphanumeric).map(|letter| letter.to_ascii_lowercase()).collect()
}

/// Returns the text inside nested elements, the outermost first in `path`; `None` if one is missing or the path empty.
/// The elements read here have no attributes.
fn element_text<'a>(xml: &'a str, path: &[&str]) -> Option<&'a str> {
    if path.is_empty() {
        return None;
    }
    path.iter().try_fold(xml, |inside, name| {
        let start = inside.find(&format!("<{name}>"))? + name.len() + 2;
        let length = inside[start..].find(&format!("</{name}>"))?;
        Some(inside[start..start + length].trim())
    })
}
