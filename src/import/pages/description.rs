//! The description of a TIFF file, in which microscopy programs state what the directories do not.
//!
//! ImageJ writes lines of `key=value`; OME-XML is an XML document ("OME-TIFF specification", Open Microscopy
//! Environment); the Python package tifffile writes a JSON object.

use crate::import::RateSource;
use crate::import::rate::Rate;
use crate::import::timeline::FrameTimes;

/// The resolution of times that are written as decimal numbers, ns.
const RESOLUTION_NS: f64 = 1.0;

/// The statements of the description about the images of the file.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Description {
    /// Number of images.
    pub(super) images: Option<u64>,
    /// Frame rate.
    pub(super) rate: Option<Rate>,
    /// Time of each image.
    pub(super) times: Option<FrameTimes>,
    /// Numbers of colours and of layers, 1 each for a film.
    channels: u64,
    layers: u64,
}

impl Description {
    /// Reads the description of any of the three programs; that of another program states nothing.
    pub(super) fn parse(text: &str) -> Self {
        match text.trim_start() {
            text if text.starts_with("ImageJ=") => Self::parse_image_j(text),
            text if text.contains("<Pixels ") => Self::parse_ome(text),
            text if text.starts_with('{') && text.contains("\"truncated\": true") => {
                Self { images: image_count(text), ..Self::default() }
            }
            _ => Self::default(),
        }
    }

    /// Checks that the images are frames of one film.
    ///
    /// # Errors
    ///
    /// The reason when they are channels or layers.
    pub(super) fn check(&self) -> Result<(), String> {
        match (self.channels, self.layers) {
            (2.., _) => Err(format!("images of {} channels; save one of them as a stack", self.channels)),
            (_, 2..) => Err(format!("a stack of {} layers at each time; save one of them", self.layers)),
            _ => Ok(()),
        }
    }

    /// Reads lines of `key=value` as ImageJ writes them.
    fn parse_image_j(text: &str) -> Self {
        let value = |key: &str| text.lines().find_map(|line| line.trim().strip_prefix(key)?.strip_prefix('='));
        let number = |key: &str| value(key).and_then(|value| value.trim().parse::<u64>().ok());
        let real = |key: &str| value(key).and_then(|value| value.trim().parse::<f64>().ok());
        let unit_s = value("tunit").map_or(Some(1.0), unit_seconds);
        let interval_s = real("finterval").zip(unit_s).map(|(interval, unit_s)| interval * unit_s);
        let rate = interval_s.and_then(|interval_s| Rate::from_header(interval_s.recip(), "finterval"));
        // The speed of the animation, which need not be that of the camera.
        let playback = real("fps").and_then(|fps| Rate::from_header(fps, "fps"));
        let playback = playback.map(|rate| Rate { source: RateSource::Playback, ..rate });
        // A stack is often declared as layers when it is a film.
        let layers = if number("frames").unwrap_or(1) > 1 { number("slices").unwrap_or(1) } else { 1 };
        Self {
            images: number("images"),
            rate: rate.or(playback),
            times: None,
            channels: number("channels").unwrap_or(1),
            layers,
        }
    }

    /// Reads the first `Pixels` element of OME-XML, and the times of all planes if each has one and there are several.
    fn parse_ome(text: &str) -> Self {
        let Some(pixels) = opening_tags(text, "Pixels").next() else { return Self::default() };
        let number = |name: &str| attribute(pixels, name).and_then(|value| value.parse::<u64>().ok());
        let interval = attribute(pixels, "TimeIncrement").and_then(|value| value.parse::<f64>().ok());
        let unit_s = attribute(pixels, "TimeIncrementUnit").map_or(Some(1.0), unit_seconds);
        let rate = interval
            .zip(unit_s)
            .and_then(|(interval, unit_s)| Rate::from_header((interval * unit_s).recip(), "TimeIncrement"));
        let delta_ns = |plane: &str| {
            let delta: f64 = attribute(plane, "DeltaT")?.parse().ok()?;
            let unit_s = attribute(plane, "DeltaTUnit").map_or(Some(1.0), unit_seconds)?;
            Some((delta * unit_s * 1e9).round() as i64)
        };
        let times_ns: Option<Vec<i64>> = opening_tags(text, "Plane").map(delta_ns).collect();
        let times_ns = times_ns.filter(|times| times.len() > 1);
        let (times, layers) = (number("SizeT").unwrap_or(1), number("SizeZ").unwrap_or(1));
        Self {
            images: None,
            rate,
            times: times_ns.map(|times_ns| FrameTimes { times_ns, resolution_ns: RESOLUTION_NS }),
            channels: number("SizeC").unwrap_or(1),
            layers: if times > 1 { layers } else { 1 },
        }
    }
}

/// Returns the tags of an XML document that open an element of this name with attributes, without their closing `>`.
fn opening_tags<'a>(xml: &'a str, name: &str) -> impl Iterator<Item = &'a str> {
    let opening = format!("<{name} ");
    xml.match_indices(&opening)
        .map(|(at, _)| xml[at..].split('>').next().unwrap_or_default())
        .collect::<Vec<_>>()
        .into_iter()
}

/// Returns the value of an attribute in a tag; `None` without such an attribute.
fn attribute<'a>(tag: &'a str, name: &str) -> Option<&'a str> {
    let (_, rest) = tag.split_once(&format!(" {name}=\""))?;
    rest.split_once('"').map(|(value, _)| value)
}

/// Returns the duration of a unit of time, s; `None` for an unknown one.
fn unit_seconds(unit: &str) -> Option<f64> {
    Some(match unit.trim() {
        "s" | "sec" | "second" | "seconds" => 1.0,
        "ms" | "msec" | "millisecond" | "milliseconds" => 1e-3,
        "us" | "µs" | "\u{3bc}s" | "\\u00B5s" | "usec" | "microsecond" | "microseconds" => 1e-6,
        "ns" | "nsec" | "nanosecond" | "nanoseconds" => 1e-9,
        "min" | "minute" | "minutes" => 60.0,
        _ => return None,
    })
}

/// Returns the number of images in `"shape": [images, height, width]`; `None` for any other number of axes.
fn image_count(json: &str) -> Option<u64> {
    let (_, rest) = json.split_once("\"shape\":")?;
    let (axes, _) = rest.trim_start().strip_prefix('[')?.split_once(']')?;
    let axes: Option<Vec<u64>> = axes.split(',').map(|axis| axis.trim().parse().ok()).collect();
    match axes?.as_slice() {
        [images, _, _] => Some(*images),
        _ => None,
    }
}
