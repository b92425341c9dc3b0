//! The rate at which a film was captured, which cameras with slow motion store next to the rate of playback.

use super::super::{ImportError, open_file};
use std::os::unix::fs::FileExt;
use std::path::Path;

/// Endings of the names of tags that state a rate of capture, without punctuation: `com.android.capture.fps` of phones
/// with Android, `com.arri.camera.SensorFps`, `CaptureFrameRate`.
const TAGS: [&str; 8] = [
    "capturefps",
    "captureframerate",
    "capturerate",
    "recordfps",
    "recordframerate",
    "recordrate",
    "sensorfps",
    "shootingframerate",
];
/// The attribute of Sony's NonRealTimeMeta, an XML text at an end of the file.
const SONY: &str = "captureFps";
/// Length of each end of the file that is searched for it, bytes.
const END_BYTES: u64 = 1 << 20;

/// A rate of capture and the name of the tag that states it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CaptureRate {
    pub(super) hz: f64,
    pub(super) tag: String,
}

impl CaptureRate {
    /// Returns the rates of capture that the tags and the XML text of a file state, in this order; empty if none does.
    pub(super) fn find(path: &Path, tags: &[(String, String)]) -> Result<Vec<Self>, ImportError> {
        let named = tags.iter().filter(|(key, _)| is_capture_tag(key));
        let mut rates: Vec<Self> =
            named.filter_map(|(key, value)| Some(Self { hz: parse_rate_hz(value)?, tag: key.clone() })).collect();
        if let Some(hz) = sony_rate_hz(path)? {
            rates.push(Self { hz, tag: SONY.to_owned() });
        }
        Ok(rates)
    }
}

/// Whether the name of a tag is that of a rate of capture.
fn is_capture_tag(key: &str) -> bool {
    let key: String =
        key.chars().filter(char::is_ascii_alphanumeric).map(|letter| letter.to_ascii_lowercase()).collect();
    TAGS.iter().any(|tag| key.ends_with(tag))
}

/// Parses a rate, Hz: `240`, `239.76 fps`, `119.88p` or `240000/1001`; `None` for other texts and for 0.
fn parse_rate_hz(text: &str) -> Option<f64> {
    let is_number = |letter: char| letter.is_ascii_digit() || matches!(letter, '.' | '/');
    let text = text.trim();
    let number = &text[..text.find(|letter| !is_number(letter)).unwrap_or(text.len())];
    let (over, under) = number.split_once('/').unwrap_or((number, "1"));
    let hz = over.parse::<f64>().ok()? / under.parse::<f64>().ok()?;
    (hz.is_finite() && hz > 0.0).then_some(hz)
}

/// Searches the first and the last [`END_BYTES`] of the file for `captureFps="119.88p"`, and returns the rate, Hz.
fn sony_rate_hz(path: &Path) -> Result<Option<f64>, ImportError> {
    let (file, bytes) = open_file(path)?;
    let key = format!("{SONY}=\"");
    for start in [0, bytes.saturating_sub(END_BYTES)] {
        let mut end = vec![0; END_BYTES.min(bytes - start) as usize];
        file.read_exact_at(&mut end, start).map_err(|error| ImportError::io("read", path, error))?;
        let found = end.windows(key.len()).position(|window| window == key.as_bytes());
        if let Some(at) = found {
            let value = end[at + key.len()..].iter().take(16).take_while(|byte| **byte != b'"');
            return Ok(parse_rate_hz(&value.map(|byte| char::from(*byte)).collect::<String>()));
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tags_of_the_rate_of_capture_are_known_by_their_names() {
        for key in ["com.android.capture.fps", "com.arri.camera.SensorFps", "CaptureFrameRate", "capture_rate"] {
            assert!(is_capture_tag(key), "{key}");
        }
        for key in ["com.apple.quicktime.model", "encoder", "fps", "timecode"] {
            assert!(!is_capture_tag(key), "{key}");
        }
    }

    #[test]
    fn rates_are_read_with_their_units() {
        assert_eq!(parse_rate_hz("240.000000"), Some(240.0));
        assert_eq!(parse_rate_hz(" 960 fps"), Some(960.0));
        assert_eq!(parse_rate_hz("119.88p"), Some(119.88));
        assert_eq!(parse_rate_hz("120000/1001"), Some(120_000.0 / 1001.0));
        assert_eq!(parse_rate_hz("0"), None);
        assert_eq!(parse_rate_hz("fast"), None);
        assert_eq!(parse_rate_hz("1/0"), None);
    }
}
