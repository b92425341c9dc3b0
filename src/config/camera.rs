//! `[camera]`: the source of the frames.

use super::check::{Bounds, OwnedKey, Setting, Table, quoted};
use super::error::ConfigError;
use super::raw::RawCamera;
use super::text::path_name;
use crate::image::PixelFormat;
use crate::results::named_enum;
use std::collections::BTreeMap;

named_enum! {
    /// The source of the frames.
    Source: "source" {
        /// A scenario with known truth is drawn.
        Simulated = 0 "simulated",
        /// A recording is played.
        Recording = 1 "recording",
        /// A GigE Vision or USB3 Vision camera.
        Genicam = 2 "genicam",
        /// A camera of the Linux kernel.
        V4l2 = 3 "v4l2",
    }
}

impl Source {
    const SETTING: Setting<Self> = Setting { key: "source", name: Self::as_str };

    /// Whether it is a physical camera, which the rig sets up and which films live.
    pub fn is_device(self) -> bool {
        matches!(self, Self::Genicam | Self::V4l2)
    }
}

/// The value of a GenICam feature or a V4L2 control.
#[derive(Debug, Clone, PartialEq)]
pub enum FeatureValue {
    /// `true` or `false`, for boolean features; `true` executes a command.
    Bool(bool),
    /// A whole number, for integer features and controls, and for float features if the camera describes them so.
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

/// The simulated trigger line of a simulated camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pulse {
    /// The time between pulses, s.
    pub period_s: f64,
    /// The number of frames per pulse.
    pub burst_frames: u32,
}

/// `[camera]`: the source of the frames and their properties.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// The source. A rig that runs requires it. `None`: the file describes films that are measured offline, and has at most
    /// the keys `exposure_us`, `gamma`, `row_time_us` and `defective_px`.
    pub source: Option<Source>,
    /// The camera or file. `genicam`: an address, serial number or device name. `v4l2`: a device file, or the place, serial
    /// number or name of a camera. `recording`: the path of an MCAP file; a relative path starts at the working directory.
    /// Required by these three; `simulated` has none.
    pub id: Option<String>,
    /// The simulation (`simulated` only): the name of a built-in scenario, or the path of a scenario file relative to the
    /// working directory. Default `lacrosse`; `None` for other sources.
    pub scenario: Option<String>,
    /// Whether frames come in real time (`simulated` and `recording`), default true. If false, they come as fast as the rig
    /// measures and none is lost. The results are the same.
    pub paced: bool,
    /// Whether the whole film is drawn before the start, and then played forwards and backwards in turn until the rig is
    /// stopped (`simulated` and paced only), default false. Timestamps are those of the present, and there is no truth.
    pub endless: bool,
    /// The speed of a paced `recording` as a multiple of real time, 0.001 to 1000, default 1.
    pub playback_rate: f64,
    /// The start of playing a `recording`, 0 to 1000000 s from its first frame, default 0.
    pub from_s: f64,
    /// The end of playing a `recording`, above `from_s` and at most 1000000 s from its first frame. The frame at this time
    /// is not played. Default: the end of the recording.
    pub to_s: Option<f64>,
    /// The further recordings of the stream that `id` begins (`recording` only). Their frames follow in order of time.
    pub parts: Vec<String>,
    /// The camera within a `recording`, by the name of its view. Default: the first.
    pub view: Option<String>,
    /// A time added to the timestamp of every frame of a `recording`, whole ns, default 0.
    pub shift_ns: i64,
    /// Whether each frame of a `recording` waits for a line on standard input, default false. The stream ends with the
    /// input. `paced` and `playback_rate` are then unused.
    pub stepped: bool,
    /// The number of pixels per row, 16 to 65535 px. Required by `genicam` and `v4l2`. Default for `simulated`: that of
    /// the scenario. A recording has its own.
    pub width_px: Option<u32>,
    /// The number of rows, 16 to 65535 px; required like `width_px`.
    pub height_px: Option<u32>,
    /// The left edge of the window read from the sensor (`genicam` only), 0 to 65535 px. Default: the camera's own.
    pub offset_x_px: Option<u32>,
    /// The upper edge of that window, 0 to 65535 px.
    pub offset_y_px: Option<u32>,
    /// The pixel layout: `Mono8`, `Mono10`, `Mono12`, `Mono16`. Default `Mono8` for `genicam` and `v4l2`, and the
    /// scenario's for `simulated`. A recording has its own.
    pub pixel_format: Option<PixelFormat>,
    /// The frames per second, above 0 and at most 1000000 Hz; required like `width_px`. With `trigger_source` it is the
    /// maximum expected rate of triggers. A `v4l2` driver that cannot set a rate delivers at its own, and this is the rate
    /// that the rig expects.
    pub frame_rate_hz: Option<f64>,
    /// The exposure time, above 0 and at most 10000000 us, and at most the duration of a frame at `frame_rate_hz`. Default:
    /// that of the camera or scenario. `v4l2` has steps of 100 us.
    pub exposure_us: Option<f64>,
    /// The exponent of the camera's tone curve, 0.2 to 5, default 1. Its grey levels are the light to this power, and the
    /// light is measured. Machine-vision cameras have no tone curve; those made for viewing have about 0.45.
    pub gamma: f64,
    /// The row time of a rolling shutter: the delay of each row to the one above it, -1000 to 1000 us, with all rows within
    /// the duration of a frame. Without the correction, vertical speeds are wrong by it. Below 0 if the shutter rolls
    /// upwards. Default: 0, all rows at once.
    pub row_time_us: Option<f64>,
    /// The hot and dead pixels, by column and row, 0 to 65534 and within the image, at most 10000. `ricochet check` finds
    /// them. For measuring they are filled in from their neighbours. Recordings keep what the camera delivered. Default
    /// none.
    pub defective_px: Vec<[u32; 2]>,
    /// The trigger that each frame waits for (`genicam` only), a GenICam name such as `Line1` or `Software`. Default: the
    /// camera runs freely.
    pub trigger_source: Option<String>,
    /// A simulated trigger line (`simulated` and paced only). Every `pulse_period_s`, 0.001 to 3600 s, it gives
    /// `pulse_frames` frames, 1 to 1000000, default 1. Default: the camera runs freely.
    pub pulse: Option<Pulse>,
    /// The maximum network packet (`genicam` over Ethernet only), 576 to 65535 bytes. Default: as large as network card and
    /// camera allow.
    pub packet_size_bytes: Option<u32>,
    /// Any other feature of the camera. `genicam`: by its GenICam name, or `Name[Selector=Word]` behind a selector.
    /// `v4l2`: any control of the driver by its name, in lower case with `_`. The order does not matter: a feature that the
    /// camera refuses at first is tried again after the others.
    pub features: BTreeMap<String, FeatureValue>,
}

impl Camera {
    /// Whether the timestamps are those of the present, so that their age is a latency.
    pub fn has_present_stamps(&self) -> bool {
        self.is_device() || self.endless
    }

    /// Whether frames come whether or not they are read; otherwise the source waits for its readers.
    pub fn films_live(&self) -> bool {
        self.is_device() || (self.paced && !self.stepped)
    }

    /// Whether each frame, or burst of frames, waits for a pulse.
    pub fn is_pulsed(&self) -> bool {
        self.trigger_source.is_some() || self.pulse.is_some()
    }

    /// Whether it is a physical camera, which the rig sets up and which films live.
    pub fn is_device(&self) -> bool {
        self.source.is_some_and(Source::is_device)
    }

    /// Returns width and height of the image if the file gives both, px.
    pub fn image_px(&self) -> Option<(u32, u32)> {
        self.width_px.zip(self.height_px)
    }
}

const SIZE_PX: std::ops::RangeInclusive<i64> = 16..=65_535;
const MAX_DEFECT_PX: u32 = 65_534;
/// The maximum number of defective pixels.
const MAX_DEFECTS: usize = 10_000;
const OFFSET_PX: std::ops::RangeInclusive<i64> = 0..=65_535;
const PLAYBACK_RATE: Bounds = Bounds::closed(0.001, 1000.0, "times real time");
/// The maximum time from the first frame of a recording, s.
const SPAN_S: f64 = 1.0e6;
const RATE: Bounds = Bounds::above(0.0, 1.0e6, "Hz");
const GAMMA: Bounds = Bounds::closed(0.2, 5.0, "");
const ROW_TIME: Bounds = Bounds::closed(-1000.0, 1000.0, "us");
const EXPOSURE: Bounds = Bounds::above(0.0, 1.0e7, "us");

/// Checks the camera of a rig or a view, and fills in the defaults.
pub(super) fn check_camera(table: &Table<'_>, raw: RawCamera) -> Result<Camera, ConfigError> {
    let source = table.named("source", raw.source.as_deref())?;
    refuse_foreign_keys(table, source, &raw)?;
    let scenario = table.single_line("scenario", raw.scenario)?.unwrap_or_else(|| "lacrosse".into());
    let camera = Camera {
        source,
        scenario: (source == Some(Source::Simulated)).then_some(scenario),
        id: table.single_line("id", raw.id)?,
        paced: raw.paced.unwrap_or(true),
        endless: raw.endless.unwrap_or(false),
        playback_rate: table.number("playback_rate", raw.playback_rate, PLAYBACK_RATE)?.unwrap_or(1.0),
        from_s: table.number("from_s", raw.from_s, Bounds::closed(0.0, SPAN_S, "s"))?.unwrap_or(0.0),
        to_s: table.number("to_s", raw.to_s, Bounds::above(raw.from_s.unwrap_or(0.0), SPAN_S, "s"))?,
        parts: raw.parts.clone().unwrap_or_default(),
        view: table.single_line("view", raw.view.clone())?,
        shift_ns: raw.shift_ns.unwrap_or(0),
        stepped: raw.stepped.unwrap_or(false),
        width_px: table.integer("width_px", raw.width_px, SIZE_PX, "px")?,
        height_px: table.integer("height_px", raw.height_px, SIZE_PX, "px")?,
        offset_x_px: table.integer("offset_x_px", raw.offset_x_px, OFFSET_PX, "px")?,
        offset_y_px: table.integer("offset_y_px", raw.offset_y_px, OFFSET_PX, "px")?,
        pixel_format: table.named("pixel_format", raw.pixel_format.as_deref())?,
        frame_rate_hz: table.number("frame_rate_hz", raw.frame_rate_hz, RATE)?,
        exposure_us: table.number("exposure_us", raw.exposure_us, EXPOSURE)?,
        gamma: table.number("gamma", raw.gamma, GAMMA)?.unwrap_or(1.0),
        row_time_us: table.number("row_time_us", raw.row_time_us, ROW_TIME)?,
        defective_px: check_defective_px(table, raw.defective_px.as_deref().unwrap_or_default())?,
        trigger_source: table.single_line("trigger_source", raw.trigger_source)?,
        pulse: check_pulse(table, raw.paced, raw.pulse_period_s, raw.pulse_frames)?,
        packet_size_bytes: table.integer("packet_size_bytes", raw.packet_size_bytes, 576..=65_535, "bytes")?,
        features: check_features(table, raw.features)?,
    };
    check_required_keys(table, &camera)?;
    check_endless(table, &camera)?;
    check_exposure(table, &camera)?;
    check_row_time(table, &camera)?;
    check_defects(table, &camera)?;
    let pixel_format = camera.pixel_format.or(camera.is_device().then_some(PixelFormat::Mono8));
    Ok(Camera { pixel_format, ..camera })
}

/// Checks the column and row of each defective pixel.
fn check_defective_px(table: &Table<'_>, raw: &[Vec<i64>]) -> Result<Vec<[u32; 2]>, ConfigError> {
    let place = |at: &i64| u32::try_from(*at).ok().filter(|at| *at <= MAX_DEFECT_PX);
    let pixel = |pair: &Vec<i64>| match pair.as_slice() {
        [x, y] => Some([place(x)?, place(y)?]),
        _ => None,
    };
    let pixels: Option<Vec<_>> = raw.iter().map(pixel).collect();
    pixels.filter(|pixels| pixels.len() <= MAX_DEFECTS).ok_or_else(|| {
        let allowed = format!("at most {MAX_DEFECTS} pairs of column and row, each 0 to {MAX_DEFECT_PX}");
        table.refuse("defective_px", allowed)
    })
}

/// Checks the simulated trigger line, which needs a paced camera.
fn check_pulse(
    table: &Table<'_>,
    paced: Option<bool>,
    period_s: Option<f64>,
    frames: Option<i64>,
) -> Result<Option<Pulse>, ConfigError> {
    let period_s = table.number("pulse_period_s", period_s, Bounds::closed(0.001, 3600.0, "s"))?;
    let frames = table.integer("pulse_frames", frames, 1..=1_000_000, "frames")?;
    match period_s {
        None if frames.is_some() => Err(table.refuse("pulse_period_s", "given with pulse_frames: 0.001 to 3600 s")),
        Some(_) if paced == Some(false) => {
            Err(table.foreign_key_error("pulse_period_s", "paced = false", "paced = true"))
        }
        period_s => Ok(period_s.map(|period_s| Pulse { period_s, burst_frames: frames.unwrap_or(1) })),
    }
}

/// Checks that an endless film is paced, and plays without pauses.
fn check_endless(table: &Table<'_>, camera: &Camera) -> Result<(), ConfigError> {
    match camera.endless {
        true if !camera.paced => Err(table.foreign_key_error("endless", "paced = false", "paced = true")),
        true if camera.pulse.is_some() => {
            Err(table.foreign_key_error("endless", "pulse_period_s", "a camera that runs freely"))
        }
        _ => Ok(()),
    }
}

/// Returns the names of the sources, as an error lists them.
pub(super) fn source_names() -> String {
    quoted(Source::ALL.map(Source::as_str).into_iter())
}

/// Refuses keys that the chosen source does not use, instead of ignoring them. Without a source it refuses those that
/// describe how frames are taken.
fn refuse_foreign_keys(table: &Table<'_>, source: Option<Source>, raw: &RawCamera) -> Result<(), ConfigError> {
    use Source::{Genicam, Recording, Simulated, V4l2};
    let keys: [OwnedKey<'_, Source>; 23] = [
        ("id", raw.id.is_some(), &[Recording, Genicam, V4l2]),
        ("scenario", raw.scenario.is_some(), &[Simulated]),
        ("paced", raw.paced.is_some(), &[Simulated, Recording]),
        ("endless", raw.endless.is_some(), &[Simulated]),
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
        ("features", raw.features.as_ref().is_some_and(|features| !features.is_empty()), &[Genicam, V4l2]),
    ];
    if let Some(source) = source {
        return table.check_owners(Source::SETTING, source, &keys);
    }
    // These keys say how frames are taken, not what they show.
    match keys.iter().find(|(key, is_given, _)| *is_given && *key != "exposure_us") {
        None => Ok(()),
        Some((key, ..)) => Err(table.refuse("source", format!("{} with camera.{key}", source_names()))),
    }
}

/// Checks that the keys that the source requires are given.
fn check_required_keys(table: &Table<'_>, camera: &Camera) -> Result<(), ConfigError> {
    let Some(source) = camera.source else { return Ok(()) };
    let id = match source {
        Source::Simulated => return Ok(()),
        Source::Recording => "the path of an MCAP file",
        Source::Genicam => "the address, serial number or name of a camera",
        Source::V4l2 => "the device file, place, serial number or name of a camera",
    };
    let is_device = source.is_device();
    let required = [
        ("id", camera.id.is_none(), id),
        ("width_px", is_device && camera.width_px.is_none(), "16 to 65535 px"),
        ("height_px", is_device && camera.height_px.is_none(), "16 to 65535 px"),
        ("frame_rate_hz", is_device && camera.frame_rate_hz.is_none(), "above 0 and at most 1000000 Hz"),
    ];
    match required.iter().find(|(_, is_missing, _)| *is_missing) {
        None => Ok(()),
        Some((key, _, allowed)) => {
            Err(table.refuse(key, format!("{allowed} for {}", Source::SETTING.assignment(&[source]))))
        }
    }
}

/// Checks that the exposure fits into the duration of a frame.
fn check_exposure(table: &Table<'_>, camera: &Camera) -> Result<(), ConfigError> {
    match camera.exposure_us.zip(camera.frame_rate_hz) {
        Some((exposure_us, rate_hz)) if exposure_us > 1.0e6 / rate_hz => Err(table
            .refuse("exposure_us", format!("at most {} us, the duration of a frame at {rate_hz} Hz", 1.0e6 / rate_hz))),
        _ => Ok(()),
    }
}

/// Checks that a rolling shutter has passed over all rows before the next frame begins.
fn check_row_time(table: &Table<'_>, camera: &Camera) -> Result<(), ConfigError> {
    let (Some(row_time_us), Some(rate_hz), Some(rows)) = (camera.row_time_us, camera.frame_rate_hz, camera.height_px)
    else {
        return Ok(());
    };
    let max_us = 1.0e6 / rate_hz / f64::from(rows);
    if row_time_us.abs() <= max_us {
        return Ok(());
    }
    let frame = format!("so that {rows} rows take at most the duration of a frame at {rate_hz} Hz");
    Err(table.refuse("row_time_us", format!("{:.3} to {max_us:.3} us, {frame}", -max_us)))
}

/// Checks that defective pixels are within the image, if its size is known. Otherwise the measurement checks it.
fn check_defects(table: &Table<'_>, camera: &Camera) -> Result<(), ConfigError> {
    let Some((width, height)) = camera.image_px() else { return Ok(()) };
    match camera.defective_px.iter().find(|[x, y]| *x >= width || *y >= height) {
        None => Ok(()),
        Some([x, y]) => {
            Err(table.refuse("defective_px", format!("pixels of the image of {width} x {height} px, not [{x}, {y}]")))
        }
    }
}

/// Checks that each feature is a boolean, a finite number or a text.
fn check_features(
    table: &Table<'_>,
    raw: Option<BTreeMap<String, toml::Value>>,
) -> Result<BTreeMap<String, FeatureValue>, ConfigError> {
    let value = |name: &str, raw: toml::Value| match raw {
        toml::Value::Boolean(value) => Ok(FeatureValue::Bool(value)),
        toml::Value::Integer(value) => Ok(FeatureValue::Integer(value)),
        toml::Value::Float(value) if value.is_finite() => Ok(FeatureValue::Float(value)),
        toml::Value::String(value) => Ok(FeatureValue::Text(value)),
        _ => {
            let key = format!("features.{}", path_name(name));
            Err(table.refuse(&key, "true or false, a finite number, or a text in quotes"))
        }
    };
    raw.unwrap_or_default().into_iter().map(|(name, raw)| Ok((name.clone(), value(&name, raw)?))).collect()
}
