//! `[camera]`: where the frames come from.

use super::check::{Bounds, Table, listed};
use super::error::ConfigError;
use super::raw::RawCamera;
use super::text::path_name;
use crate::image::PixelFormat;
use crate::results::named_enum;
use std::collections::BTreeMap;

named_enum! {
    /// Who delivers the frames.
    Source: "source" {
        /// Frames are drawn from a scenario whose truth is known.
        Simulated = 0 "simulated",
        /// Frames are read from a recording.
        Recording = 1 "recording",
        /// A GigE Vision or USB3 Vision camera.
        Genicam = 2 "genicam",
        /// A camera of the Linux kernel.
        V4l2 = 3 "v4l2",
    }
}

impl Source {
    /// Whether it is a camera of glass and silicon: set up by the rig, and live.
    pub fn is_device(self) -> bool {
        matches!(self, Self::Genicam | Self::V4l2)
    }
}

/// The value of a GenICam feature or a V4L2 control.
#[derive(Debug, Clone, PartialEq)]
pub enum FeatureValue {
    /// `true` or `false`, for boolean features; `true` executes a command.
    Bool(bool),
    /// A whole number, for integer features (and float ones: the camera's description decides) and integer controls.
    Integer(i64),
    /// A finite number, for float features.
    Float(f64),
    /// A text, for enumerations, strings and commands.
    Text(String),
}

impl std::fmt::Display for FeatureValue {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Bool(value) => value.fmt(formatter),
            Self::Integer(value) => value.fmt(formatter),
            Self::Float(value) => value.fmt(formatter),
            Self::Text(value) => value.fmt(formatter),
        }
    }
}

/// The imitated line of a simulated camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pulse {
    /// Time from a pulse to the next, s.
    pub period_s: f64,
    /// Frames that each pulse gives.
    pub burst_frames: u32,
}

/// `[camera]`: where the frames come from and what they look like.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// Who delivers the frames; must be given.
    pub source: Source,
    /// Which one: an address, serial number or device name (`genicam`), a device file, or place, serial number or
    /// name of a camera (`v4l2`), or the path of an MCAP file (`recording`; a relative path starts at the working
    /// directory). All three need it, `simulated` has none.
    pub id: Option<String>,
    /// What is simulated (`simulated` only): the name of a built-in scenario or the path of a scenario's TOML
    /// (relative to the working directory). Default `lacrosse`; `None` for other sources.
    pub scenario: Option<String>,
    /// Whether frames come in real time (`simulated` and `recording`), default true. When false they come as fast
    /// as the rig takes them and none is lost; results are the same.
    pub paced: bool,
    /// How many times real time a paced `recording` is played, 0.001 to 1000, default 1.
    pub playback_rate: f64,
    /// Where playing a `recording` begins, 0 to 1000000 s from its first frame, default 0.
    pub from_s: f64,
    /// Where playing a `recording` ends, above `from_s` and at most 1000000 s from its first frame; the frame there is
    /// no longer played. Left out, at its end.
    pub to_s: Option<f64>,
    /// Further recordings of the stream that `id` begins (`recording` only): their frames follow in the order of time.
    pub parts: Vec<String>,
    /// Which of several cameras in a `recording`, by the name of its view; left out, the first.
    pub view: Option<String>,
    /// Added to the stamp of every frame of a `recording`, whole ns, default 0.
    pub shift_ns: i64,
    /// Whether each frame of a `recording` waits for a line on standard input, default false; the end of the input is
    /// the end of the stream. `paced` and `playback_rate` then say nothing.
    pub stepped: bool,
    /// Pixels a row, 16 to 65535 px. `genicam` and `v4l2` need it; a simulated camera takes it from its scenario
    /// when left out, a recording knows its own.
    pub width_px: Option<u32>,
    /// Rows, 16 to 65535 px; needed as `width_px` is.
    pub height_px: Option<u32>,
    /// Left edge of the window read from the sensor (`genicam` only), 0 to 65535 px; left out, the camera's own.
    pub offset_x_px: Option<u32>,
    /// Upper edge of that window, 0 to 65535 px.
    pub offset_y_px: Option<u32>,
    /// Layout of the pixels: `Mono8`, `Mono10`, `Mono12`, `Mono16`. `genicam` and `v4l2`: default `Mono8`;
    /// `simulated`: the scenario's when left out; a recording knows its own.
    pub pixel_format: Option<PixelFormat>,
    /// Frames a second, above 0 and at most 1000000 Hz; needed as `width_px` is. With `trigger_source` it is the
    /// highest rate of triggers expected; a `v4l2` driver that sets no rates delivers at its own, and the key tells
    /// the rig what to expect.
    pub frame_rate_hz: Option<f64>,
    /// Exposure, above 0 and at most 10000000 us, no longer than a frame lasts at `frame_rate_hz`; left out, the
    /// camera's or the scenario's own. `v4l2` has steps of 100 us.
    pub exposure_us: Option<f64>,
    /// Exponent of the camera's tone curve, 0.2 to 5, default 1: its grey levels go as the light to this power, and the
    /// light is measured. Cameras for measuring have none; those made for looking at have 0.45 or so.
    pub gamma: f64,
    /// How much later the camera exposes each row of a frame than the one above it, -1000 to 1000 us and all rows within a
    /// frame's time: the row time of a rolling shutter, by which speeds down the picture are off otherwise. Below 0 where it
    /// rolls upwards, 0 where all rows are exposed at once, which is also what is taken when it is left out.
    pub row_time_us: Option<f64>,
    /// Pixels of the camera that show the same whatever is before them, hot or dead ones: column and row of each, 0 to 65534
    /// and within the picture, at most 10000; `ricochet check` finds them. What is measured is filled in there from the pixels
    /// around, and recordings keep what the camera delivered. Default none.
    pub defective_px: Vec<[u32; 2]>,
    /// Each frame waits for this trigger (`genicam` only), a GenICam name such as `Line1` or `Software`; left out,
    /// the camera runs freely.
    pub trigger_source: Option<String>,
    /// A line to imitate (`simulated` and paced only): each `pulse_period_s`, 0.001 to 3600 s, it gives `pulse_frames`,
    /// 1 to 1000000, default 1, and the camera is silent between. Left out, the camera runs freely.
    pub pulse: Option<Pulse>,
    /// Largest network packet (`genicam` over Ethernet only), 576 to 65535 bytes; left out, as large as network card
    /// and camera allow.
    pub packet_size_bytes: Option<u32>,
    /// Any other feature of the camera by its GenICam name (`genicam`), or `Name[Selector=Word]` for one of several
    /// behind a selector; any control of the driver by its name (`v4l2`), lower-case with `_`. Their order does not matter: what the camera refuses at first is tried again once
    /// the others are set.
    pub features: BTreeMap<String, FeatureValue>,
}

impl Camera {
    /// Whether each frame, or burst of frames, waits for a pulse.
    pub fn is_pulsed(&self) -> bool {
        self.trigger_source.is_some() || self.pulse.is_some()
    }

    /// Width and height of the image where the file gives both, px.
    pub fn image_px(&self) -> Option<(u32, u32)> {
        self.width_px.zip(self.height_px)
    }
}

const SIZE_PX: std::ops::RangeInclusive<i64> = 16..=65_535;
const MOST_PX: u32 = 65_535;
const DEFECTS_MOST: usize = 10_000;
const OFFSET_PX: std::ops::RangeInclusive<i64> = 0..=65_535;
const PLAYBACK_RATE: Bounds = Bounds::closed(0.001, 1000.0, "times real time");
const SPAN_S: f64 = 1.0e6;
const RATE: Bounds = Bounds::above(0.0, 1.0e6, "Hz");
const GAMMA: Bounds = Bounds::closed(0.2, 5.0, "");
const ROW_TIME: Bounds = Bounds::closed(-1000.0, 1000.0, "us");
const EXPOSURE: Bounds = Bounds::above(0.0, 1.0e7, "us");

pub(super) fn camera(table: &Table<'_>, raw: RawCamera) -> Result<Camera, ConfigError> {
    let source = source(table, raw.source.as_deref())?;
    refuse_strangers(table, source, &raw)?;
    let formats = PixelFormat::ALL.map(|format| (format.as_str(), format));
    let camera = Camera {
        source,
        scenario: match source {
            Source::Simulated => table.filled("scenario", raw.scenario)?.or_else(|| Some("lacrosse".into())),
            Source::Recording | Source::Genicam | Source::V4l2 => None,
        },
        id: table.filled("id", raw.id)?,
        paced: raw.paced.unwrap_or(true),
        playback_rate: table.number("playback_rate", raw.playback_rate, PLAYBACK_RATE)?.unwrap_or(1.0),
        from_s: table.number("from_s", raw.from_s, Bounds::closed(0.0, SPAN_S, "s"))?.unwrap_or(0.0),
        to_s: table.number("to_s", raw.to_s, Bounds::above(raw.from_s.unwrap_or(0.0), SPAN_S, "s"))?,
        parts: raw.parts.clone().unwrap_or_default(),
        view: table.filled("view", raw.view.clone())?,
        shift_ns: raw.shift_ns.unwrap_or(0),
        stepped: raw.stepped.unwrap_or(false),
        width_px: table.whole("width_px", raw.width_px, SIZE_PX, "px")?,
        height_px: table.whole("height_px", raw.height_px, SIZE_PX, "px")?,
        offset_x_px: table.whole("offset_x_px", raw.offset_x_px, OFFSET_PX, "px")?,
        offset_y_px: table.whole("offset_y_px", raw.offset_y_px, OFFSET_PX, "px")?,
        pixel_format: table.choice("pixel_format", raw.pixel_format.as_deref(), &formats)?,
        frame_rate_hz: table.number("frame_rate_hz", raw.frame_rate_hz, RATE)?,
        exposure_us: table.number("exposure_us", raw.exposure_us, EXPOSURE)?,
        gamma: table.number("gamma", raw.gamma, GAMMA)?.unwrap_or(1.0),
        row_time_us: table.number("row_time_us", raw.row_time_us, ROW_TIME)?,
        defective_px: defective_px(table, raw.defective_px.as_deref().unwrap_or_default())?,
        trigger_source: table.filled("trigger_source", raw.trigger_source)?,
        pulse: pulse(table, raw.paced, raw.pulse_period_s, raw.pulse_frames)?,
        packet_size_bytes: table.whole("packet_size_bytes", raw.packet_size_bytes, 576..=65_535, "bytes")?,
        features: features(table, raw.features)?,
    };
    refuse_gaps(table, &camera)?;
    refuse_long_exposure(table, &camera)?;
    refuse_slow_rows(table, &camera)?;
    refuse_defects_outside(table, &camera)?;
    Ok(Camera { pixel_format: camera.pixel_format.or(source.is_device().then_some(PixelFormat::Mono8)), ..camera })
}

/// Column and row of each pixel that does not see.
fn defective_px(table: &Table<'_>, raw: &[Vec<i64>]) -> Result<Vec<[u32; 2]>, ConfigError> {
    let place = |at: &i64| u32::try_from(*at).ok().filter(|at| *at < MOST_PX);
    let pixel = |pair: &Vec<i64>| match pair.as_slice() {
        [x, y] => Some([place(x)?, place(y)?]),
        _ => None,
    };
    let pixels: Option<Vec<_>> = raw.iter().map(pixel).collect();
    pixels.filter(|pixels| pixels.len() <= DEFECTS_MOST).ok_or_else(|| {
        let most = MOST_PX - 1;
        table.refuse("defective_px", format!("at most {DEFECTS_MOST} pairs of column and row, each 0 to {most}"))
    })
}

fn pulse(
    table: &Table<'_>,
    paced: Option<bool>,
    period_s: Option<f64>,
    frames: Option<i64>,
) -> Result<Option<Pulse>, ConfigError> {
    let period_s = table.number("pulse_period_s", period_s, Bounds::closed(0.001, 3600.0, "s"))?;
    let frames = table.whole("pulse_frames", frames, 1..=1_000_000, "frames")?;
    match period_s {
        None if frames.is_some() => Err(table.refuse("pulse_period_s", "given with pulse_frames: 0.001 to 3600 s")),
        Some(_) if paced == Some(false) => {
            Err(table.text.out_of_place(&table.key("pulse_period_s"), "paced = false", "paced = true"))
        }
        period_s => Ok(period_s.map(|period_s| Pulse { period_s, burst_frames: frames.unwrap_or(1) })),
    }
}

fn source(table: &Table<'_>, word: Option<&str>) -> Result<Source, ConfigError> {
    let words = listed(Source::ALL.map(Source::as_str).into_iter());
    match word {
        None => Err(table.refuse("source", words)),
        word => table
            .choice("source", word, &Source::ALL.map(|source| (source.as_str(), source)))?
            .ok_or_else(|| table.refuse("source", words)),
    }
}

/// Refuses keys that the chosen source has no use for, rather than ignoring them.
fn refuse_strangers(table: &Table<'_>, source: Source, raw: &RawCamera) -> Result<(), ConfigError> {
    use Source::{Genicam, Recording, Simulated, V4l2};
    let keys: [(&str, bool, &[Source]); 22] = [
        ("id", raw.id.is_some(), &[Recording, Genicam, V4l2]),
        ("scenario", raw.scenario.is_some(), &[Simulated]),
        ("paced", raw.paced.is_some(), &[Simulated, Recording]),
        ("playback_rate", raw.playback_rate.is_some(), &[Recording]),
        ("from_s", raw.from_s.is_some(), &[Recording]),
        ("to_s", raw.to_s.is_some(), &[Recording]),
        ("parts", raw.parts.is_some(), &[Recording]),
        ("view", raw.view.is_some(), &[Recording]),
        ("shift_ns", raw.shift_ns.is_some(), &[Recording]),
        ("stepped", raw.stepped.is_some(), &[Recording]),
        ("width_px", raw.width_px.is_some(), &[Simulated, Genicam, V4l2]),
        ("height_px", raw.height_px.is_some(), &[Simulated, Genicam, V4l2]),
        ("offset_x_px", raw.offset_x_px.is_some(), &[Genicam]),
        ("offset_y_px", raw.offset_y_px.is_some(), &[Genicam]),
        ("pixel_format", raw.pixel_format.is_some(), &[Simulated, Genicam, V4l2]),
        ("frame_rate_hz", raw.frame_rate_hz.is_some(), &[Simulated, Genicam, V4l2]),
        ("exposure_us", raw.exposure_us.is_some(), &[Simulated, Recording, Genicam, V4l2]),
        ("trigger_source", raw.trigger_source.is_some(), &[Genicam]),
        ("pulse_period_s", raw.pulse_period_s.is_some(), &[Simulated]),
        ("pulse_frames", raw.pulse_frames.is_some(), &[Simulated]),
        ("packet_size_bytes", raw.packet_size_bytes.is_some(), &[Genicam]),
        ("features", !raw.features.is_empty(), &[Genicam, V4l2]),
    ];
    match keys.iter().find(|(_, given, sources)| *given && !sources.contains(&source)) {
        None => Ok(()),
        Some((key, _, sources)) => {
            let belongs_to = format!("source = {}", listed(sources.iter().map(|source| source.as_str())));
            Err(table.text.out_of_place(&table.key(key), &format!("source = {:?}", source.as_str()), &belongs_to))
        }
    }
}

fn refuse_gaps(table: &Table<'_>, camera: &Camera) -> Result<(), ConfigError> {
    if camera.id.is_none() && camera.source == Source::Recording {
        return Err(table.refuse("id", "the path of an MCAP file for source = \"recording\""));
    }
    if !camera.source.is_device() {
        return Ok(());
    }
    let needed = |what: &str| format!("{what} for source = {:?}", camera.source.as_str());
    if camera.id.is_none() {
        let genicam = camera.source == Source::Genicam;
        let place = if genicam { "the address, serial number" } else { "the device file, place, serial number" };
        return Err(table.refuse("id", needed(&format!("{place} or name of a camera"))));
    }
    for (key, value) in [("width_px", camera.width_px), ("height_px", camera.height_px)] {
        if value.is_none() {
            return Err(table.refuse(key, needed("16 to 65535 px")));
        }
    }
    if camera.frame_rate_hz.is_none() {
        return Err(table.refuse("frame_rate_hz", needed("above 0 and at most 1000000 Hz")));
    }
    Ok(())
}

fn refuse_long_exposure(table: &Table<'_>, camera: &Camera) -> Result<(), ConfigError> {
    match camera.exposure_us.zip(camera.frame_rate_hz) {
        Some((exposure_us, rate_hz)) if exposure_us > 1.0e6 / rate_hz => Err(table.refuse(
            "exposure_us",
            format!("at most {} us, as long as a frame at {rate_hz} Hz lasts", 1.0e6 / rate_hz),
        )),
        _ => Ok(()),
    }
}

/// A shutter has rolled over all rows before the next frame begins.
fn refuse_slow_rows(table: &Table<'_>, camera: &Camera) -> Result<(), ConfigError> {
    let (Some(row_time_us), Some(rate_hz), Some(rows)) = (camera.row_time_us, camera.frame_rate_hz, camera.height_px)
    else {
        return Ok(());
    };
    let most_us = 1.0e6 / rate_hz / f64::from(rows);
    if row_time_us.abs() <= most_us {
        return Ok(());
    }
    let frame = format!("so that {rows} rows take no longer than a frame at {rate_hz} Hz");
    Err(table.refuse("row_time_us", format!("{:.3} to {most_us:.3} us, {frame}", -most_us)))
}

/// Where the picture's size is known; else the measurement refuses them.
fn refuse_defects_outside(table: &Table<'_>, camera: &Camera) -> Result<(), ConfigError> {
    let Some((width, height)) = camera.image_px() else { return Ok(()) };
    match camera.defective_px.iter().find(|[x, y]| *x >= width || *y >= height) {
        None => Ok(()),
        Some([x, y]) => {
            Err(table.refuse("defective_px", format!("pixels of the image of {width} x {height} px, not [{x}, {y}]")))
        }
    }
}

fn features(
    table: &Table<'_>,
    raw: BTreeMap<String, toml::Value>,
) -> Result<BTreeMap<String, FeatureValue>, ConfigError> {
    let value = |name: &str, raw: toml::Value| match raw {
        toml::Value::Boolean(value) => Ok(FeatureValue::Bool(value)),
        toml::Value::Integer(value) => Ok(FeatureValue::Integer(value)),
        toml::Value::Float(value) if value.is_finite() => Ok(FeatureValue::Float(value)),
        toml::Value::String(value) => Ok(FeatureValue::Text(value)),
        _ => Err(table
            .refuse(&format!("features.{}", path_name(name)), "true or false, a finite number, or a text in quotes")),
    };
    raw.into_iter().map(|(name, raw)| Ok((name.clone(), value(&name, raw)?))).collect()
}
