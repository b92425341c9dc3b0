//! The properties of a film, as ffprobe states them.

use super::super::{ImportError, Orientation, date};
use super::program::{Program, file_url, spawn_text_reader};
use serde_json::Value;
use std::path::Path;
use std::sync::mpsc::Receiver;

/// Maximum length of the properties, bytes.
const MAX_OUTPUT_BYTES: u64 = 1 << 20;
/// Maximum length of the messages of ffprobe, bytes.
const MAX_MESSAGE_BYTES: u64 = 64 << 10;

/// The tags that state when a film was made, that of the scene before that of the file.
const DATE_TAGS: [&str; 4] = ["com.apple.quicktime.creationdate", "DateTimeOriginal", "creation_time", "date"];

/// The first video stream of a file that is no cover picture, and the tags of the file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Stream {
    /// The stream as JSON.
    stream: Value,
    /// The format of the file, as ffprobe names it.
    pub(super) container: String,
    /// Tags of the file, then of the stream: key and text.
    pub(super) tags: Vec<(String, String)>,
}

impl Stream {
    /// Reads the properties through ffprobe.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] without ffprobe, or when the file has no video stream.
    pub(super) fn probe(path: &Path) -> Result<Self, ImportError> {
        let stream = Self::probe_with(path, "")?;
        match stream.input_options() {
            "" => Ok(stream),
            options => Self::probe_with(path, options),
        }
    }

    /// Reads the properties of a file that is opened with the options `input`.
    fn probe_with(path: &Path, input: &str) -> Result<Self, ImportError> {
        let options = format!(
            "-v error -protocol_whitelist file -select_streams V:0 -show_streams -show_format -of json {input}"
        );
        let mut ffprobe = Program::start("ffprobe", &options, &[file_url(path)], path)?;
        let messages = ffprobe.stderr().map(|pipe| spawn_text_reader(pipe, MAX_MESSAGE_BYTES));
        let output = ffprobe.stdout().map(|pipe| spawn_text_reader(pipe, MAX_OUTPUT_BYTES));
        let read = |from: Option<Receiver<String>>| match from {
            Some(from) => Ok(ffprobe.receive(&from)?.unwrap_or_default()),
            None => Ok(String::new()),
        };
        let (output, messages) = (read(output)?, read(messages)?);
        let value: Value = serde_json::from_str(&output).unwrap_or_default();
        let stream = value["streams"][0].clone();
        if stream["width"].is_u64() {
            let tags = [&value["format"]["tags"], &stream["tags"]].into_iter().flat_map(texts).collect();
            let container = value["format"]["format_name"].as_str().unwrap_or_default().to_owned();
            return Ok(Self { stream, container, tags });
        }
        let last = messages.lines().map(str::trim).rfind(|line| !line.is_empty());
        Err(ImportError::invalid(path, last.unwrap_or("the file has no video stream")))
    }

    /// Returns the date on which the film was made, in ISO 8601, as the file states it; `None` if it does not, or its
    /// clock was never set.
    pub(super) fn date(&self) -> Option<String> {
        let named = |name: &str| self.tags.iter().find(|(key, _)| key.eq_ignore_ascii_case(name));
        let found = DATE_TAGS.iter().filter_map(|name| named(name));
        found.map(|(_, text)| text).find_map(|text| date::from_iso_text(text))
    }

    /// Returns the options of ffmpeg and ffprobe under which they keep the times that the file stores.
    ///
    /// Without them, ffmpeg plays a frame of a GIF that lasts 10 ms for 100 ms, like a browser.
    pub(super) fn input_options(&self) -> &'static str {
        if self.container == "gif" { "-min_delay 1" } else { "" }
    }

    /// Returns a property that is a text; empty when it is missing.
    pub(super) fn text(&self, key: &str) -> &str {
        self.stream[key].as_str().unwrap_or_default()
    }

    /// Returns a property that is a ratio: `30000/1001`, `16:15`; `None` when it is missing or not positive.
    pub(super) fn ratio(&self, key: &str) -> Option<Ratio> {
        Ratio::parse(self.text(key))
    }

    /// Returns width and height, pixels; 0 for one that is missing.
    pub(super) fn size_px(&self) -> [u64; 2] {
        ["width", "height"].map(|key| self.stream[key].as_u64().unwrap_or_default())
    }

    /// Returns the width of a stored pixel over its height; 1 when it is unknown.
    pub(super) fn pixel_aspect(&self) -> f64 {
        self.ratio("sample_aspect_ratio").map_or(1.0, Ratio::value)
    }

    /// Returns the orientation that the display matrix of the stream states; as stored without one.
    ///
    /// # Errors
    ///
    /// The stated angle, degrees, if the matrix is malformed or rotates by no multiple of 90 degrees; NaN without one.
    pub(super) fn orientation(&self) -> Result<Orientation, f64> {
        let data = self.stream["side_data_list"].as_array();
        let matrix = data.into_iter().flatten().find(|data| data["displaymatrix"].is_string());
        let Some(matrix) = matrix else { return Ok(Orientation::AS_STORED) };
        let text = matrix["displaymatrix"].as_str().unwrap_or_default();
        let rows = text.lines().filter_map(|line| line.split_once(':')).map(|(_, row)| row);
        let numbers: Vec<i64> =
            rows.flat_map(|row| row.split_whitespace().filter_map(|number| number.parse().ok())).collect();
        let degrees = matrix["rotation"].as_f64().unwrap_or(f64::NAN);
        match numbers[..] {
            [right_x, right_y, _, down_x, down_y, ..] => {
                Orientation::from_axes([right_x, right_y], [down_x, down_y]).ok_or(degrees)
            }
            _ => Err(degrees),
        }
    }
}

/// Returns the entries of a JSON object that are texts.
fn texts(object: &Value) -> Vec<(String, String)> {
    let entries = object.as_object().into_iter().flatten();
    entries.filter_map(|(key, value)| Some((key.clone(), value.as_str()?.to_owned()))).collect()
}

/// A ratio of two positive whole numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Ratio {
    pub(super) over: u64,
    pub(super) under: u64,
}

impl Ratio {
    /// Reads `30000/1001` or `16:15`; `None` for no ratio of two positive numbers.
    pub(super) fn parse(text: &str) -> Option<Self> {
        let (over, under) = text.split_once(['/', ':'])?;
        let (over, under) = (over.parse().ok()?, under.parse().ok()?);
        (over > 0 && under > 0).then_some(Self { over, under })
    }

    /// Returns the ratio as a number.
    pub(super) fn value(self) -> f64 {
        self.over as f64 / self.under as f64
    }
}
