//! The thread that takes pictures of the live frames while somebody watches.

use super::clock::now;
use super::picture::{LIVE_SIDE_PX, Picture, PictureEncoder};
use super::rows::json_cells;
use super::topics::{Link, Run, follow_rig};
use crate::bus::{Bus, BusError, FieldSubscriber, FrameSubscriber, Subscriber};
use crate::config::{Config, Scale};
use crate::image::Frame;
use crate::message::{TrackMessage, VelocityMessage};
use crate::results::{FieldPoint, PairField, PointStatus, TrackSample, VelocitySample, segments};
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch::Sender;

/// The period of the pictures.
const PERIOD: Duration = Duration::from_millis(50);
/// A picture takes at most this share of a processor, 1 to it; otherwise pictures come less often.
const MAX_SHARE: u32 = 16;
/// Time that a picture waits for the positions of the bodies in it. A worker that is behind publishes a block late.
const MAX_WAIT: Duration = Duration::from_millis(250);
/// Interval of polling for frames and positions.
const PAUSE: Duration = Duration::from_millis(5);
/// Interval of asking whether somebody watches.
const IDLE: Duration = Duration::from_millis(100);
/// The maximum number of displacements of a body in the drawing.
const MAX_VECTORS: usize = 64;
/// The maximum number of occluded subsets in the drawing.
const MAX_OCCLUDED: usize = 256;
/// The maximum number of positions that are kept, those of the newest frames.
const MAX_ROWS: usize = 8192;
/// The age up to which a velocity is one of now, ns.
const MAX_AGE_NS: u64 = 500_000_000;

/// The pictures that the page shows; the number of its receivers is the number of viewers.
pub(super) type Pictures = Sender<Option<Arc<Picture>>>;

/// Publishes pictures of each run of the rig while somebody watches, until a stop is requested.
pub(super) fn run(config: &Config, pictures: &Pictures, link: &Link) {
    let mut encoder = PictureEncoder::new(LIVE_SIDE_PX);
    follow_rig(&config.rig.name, link, |run| {
        while run.is_up() {
            if pictures.receiver_count() == 0 {
                std::thread::sleep(IDLE);
                continue;
            }
            publish_while_watched(&View::open(&run.bus, config)?, &mut encoder, pictures, run)?;
        }
        Ok(())
    });
}

/// The live topics behind the picture. They are read only while somebody watches.
struct View<'a> {
    config: &'a Config,
    frames: FrameSubscriber,
    tracks: Subscriber<TrackMessage>,
    velocities: Subscriber<VelocityMessage>,
    fields: FieldSubscriber,
}

/// The newest rows of the live topics.
#[derive(Debug, Default)]
struct Newest {
    /// The positions in the newest frames.
    tracks: VecDeque<TrackSample>,
    /// The newest velocity of each body, by its index.
    velocities: BTreeMap<u32, VelocitySample>,
}

/// The measurements in one frame.
#[derive(Debug, Default)]
struct Measured {
    /// The positions of the bodies.
    tracks: Vec<TrackSample>,
    fields: Vec<PairField>,
}

impl<'a> View<'a> {
    /// Opens the topics of a running rig.
    fn open(bus: &Bus, config: &'a Config) -> Result<Self, BusError> {
        Ok(Self {
            config,
            frames: bus.listen_newest_frame()?,
            tracks: bus.listen()?,
            velocities: bus.listen()?,
            fields: bus.listen_field()?,
        })
    }
}

/// Publishes pictures as long as the run lasts and somebody watches, one per [`PERIOD`] or less often if they take too
/// long.
fn publish_while_watched(
    view: &View<'_>,
    encoder: &mut PictureEncoder,
    pictures: &Pictures,
    run: &Run<'_>,
) -> Result<(), BusError> {
    let mut newest = Newest::default();
    while run.is_up() && pictures.receiver_count() > 0 {
        let begin = now();
        let Some(Taken { picture, spent }) = take_picture(view, encoder, &mut newest)? else {
            std::thread::sleep(PAUSE);
            continue;
        };
        pictures.send_replace(Some(Arc::new(picture)));
        let period = PERIOD.max(spent * MAX_SHARE);
        std::thread::sleep(period.saturating_sub(begin.elapsed()));
    }
    Ok(())
}

/// A picture and the time that it took to encode.
struct Taken {
    picture: Picture,
    spent: Duration,
}

/// Takes a picture of the newest frame, with the positions of the bodies in it if they are measured in time. `None` if
/// no new frame has come, or it cannot be encoded. `newest` keeps rows from call to call.
fn take_picture(view: &View<'_>, encoder: &mut PictureEncoder, newest: &mut Newest) -> Result<Option<Taken>, BusError> {
    let Some(sample) = view.frames.take()? else { return Ok(None) };
    let begin = now();
    let Some(meta) = sample.header().meta() else { return Ok(None) };
    let Some(encoded) = encoder.encode(&Frame { meta, bytes: sample.bytes() }) else { return Ok(None) };
    // The slot goes back to the ring before the wait.
    drop(sample);
    let spent = begin.elapsed();
    let measured = await_measured(view, newest, meta.sequence)?;
    while let Some(message) = view.velocities.take()? {
        newest.velocities.extend(message.sample().map(|row| (row.body, row)));
    }
    let is_now = |row: &&VelocitySample| row.stamp_ns.saturating_add(MAX_AGE_NS) >= meta.stamp_ns;
    let found = &measured.tracks;
    let occluded = measured.fields.iter().flat_map(occluded_subsets).take(MAX_OCCLUDED);
    let header = json!({
        "frame": meta.sequence, "stamp_ns": meta.stamp_ns, "width_px": meta.width_px, "height_px": meta.height_px,
        "scale": encoded.scale, "saturated_fraction": encoded.saturated_fraction, "sharpness": encoded.sharpness,
        "mm_per_px": mm_per_px(view.config, found), "surface_deg": view.config.surface.angle_deg,
        "bodies": found.iter().map(|row| body_json(view.config, row)).collect::<Vec<_>>(),
        "vectors": measured.fields.iter().flat_map(vectors).collect::<Vec<_>>(),
        "step_px": view.config.correlation.step_px, "occluded": occluded.collect::<Vec<_>>(),
        "now": newest.velocities.values().filter(is_now).filter_map(|row| now_json(view.config, row)).collect::<Vec<_>>(),
    });
    let is_wanted = view.config.serve.foxglove.is_some();
    let fields = measured.fields.iter().filter(|_| is_wanted);
    let fields = fields.map(|field| Value::Object(field_json(view.config, field))).collect();
    Ok(Some(Taken { picture: Picture::new(header, &encoded.jpeg, fields), spent }))
}

/// Waits for the positions and fields of the bodies in a frame, at most [`MAX_WAIT`].
fn await_measured(view: &View<'_>, newest: &mut Newest, frame: u64) -> Result<Measured, BusError> {
    let count = if view.config.workers.count > 0 { view.config.bodies.len() } else { 0 };
    let (begin, mut measured) = (now(), Measured::default());
    while measured.tracks.len() < count && begin.elapsed() < MAX_WAIT {
        // The field of a body comes before its position.
        while let Some((_, field)) = view.fields.take_of(frame)? {
            measured.fields.extend(field);
        }
        let rows = &mut newest.tracks;
        while let Some(message) = view.tracks.take()? {
            rows.extend(message.sample());
            rows.drain(..rows.len().saturating_sub(MAX_ROWS));
        }
        measured.tracks = rows.iter().filter(|row| row.frame == frame).copied().collect();
        // A row of a later frame shows that none of this one will come.
        if measured.tracks.len() < count && rows.back().is_some_and(|row| row.frame > frame) {
            break;
        }
        std::thread::sleep(PAUSE);
    }
    Ok(measured)
}

/// Describes the uncertainty that a velocity of a body has now, and how much of the body is visible. `None` if its
/// velocity is unknown.
fn now_json(config: &Config, row: &VelocitySample) -> Option<Value> {
    let velocity = row.velocity.as_ref()?;
    let name = config.bodies.get(row.body as usize).map_or("", |body| body.name.as_str());
    Some(json!({
        "name": name, "sigma_v_m_s": velocity.sigma_v_m_s, "sigma_omega_rad_s": velocity.sigma_omega_rad_s,
        "visible_fraction": row.visible_fraction,
    }))
}

/// Returns the centres of the subsets of a field that something covers, px.
fn occluded_subsets(field: &PairField) -> impl Iterator<Item = [f32; 2]> {
    let occluded = field.points.iter().filter(|point| point.status == PointStatus::Occluded);
    occluded.map(|point| [point.x_px, point.y_px])
}

/// Returns some of the valid displacements of a field for the drawing, each as the position and the displacement, px.
fn vectors(field: &PairField) -> impl Iterator<Item = [f32; 4]> {
    let valid = field.points.iter().filter(|point| point.status == PointStatus::Valid);
    let step = valid.clone().count().div_ceil(MAX_VECTORS).max(1);
    let vector = |point: &FieldPoint| {
        let displacement = point.displacement?;
        Some([point.x_px, point.y_px, displacement.u_px, displacement.v_px])
    };
    valid.step_by(step).filter_map(vector)
}

/// Describes a field: its frames, its body, and a row for each subset.
fn field_json(config: &Config, field: &PairField) -> Map<String, Value> {
    let name = config.bodies.get(field.body as usize).map_or("", |body| body.name.as_str());
    let point = |point| json_cells(point, FieldPoint::COLUMNS).map(|(name, cell)| (name.to_owned(), cell));
    let points = field.points.iter().map(|row| point(row).collect::<Map<_, _>>());
    let cells = [
        ("frame", json!(field.frame)),
        ("target_frame", json!(field.target_frame)),
        ("stamp_ns", json!(field.stamp_ns)),
        ("body", json!(name)),
        ("points", points.collect()),
    ];
    cells.into_iter().map(|(name, cell)| (name.to_owned(), cell)).collect()
}

/// Returns a field of one subset, which shows the names and types of its columns.
pub(super) fn field_example() -> Map<String, Value> {
    let point = FieldPoint {
        x_px: 0.0,
        y_px: 0.0,
        displacement: None,
        zncc: None,
        peak_ratio: None,
        status: PointStatus::Valid,
    };
    let cells = json_cells(&point, FieldPoint::COLUMNS).map(|(name, cell)| (name.to_owned(), cell));
    let counts = ["frame", "target_frame", "stamp_ns"].map(|name| (name.to_owned(), json!(0)));
    let texts = [("body".to_owned(), json!("")), ("points".to_owned(), json!([cells.collect::<Map<_, _>>()]))];
    counts.into_iter().chain(texts).collect()
}

/// Returns the scale of the frame, mm/px: as configured, or from the diameter of a ball and its measured radius. `None`
/// if it is unknown.
fn mm_per_px(config: &Config, rows: &[TrackSample]) -> Option<f64> {
    match config.scale? {
        Scale::MmPerPx(mm_per_px) => Some(mm_per_px),
        Scale::BallDiameterMm(diameter_mm) => {
            rows.iter().find_map(|row| row.radius_px).map(|radius_px| 0.5 * diameter_mm / radius_px)
        }
        Scale::Unknown => None,
    }
}

/// Describes a body for the drawing: its circle, or the lines of a rod, in px of the frame.
fn body_json(config: &Config, row: &TrackSample) -> Value {
    let name = config.bodies.get(row.body as usize).map_or("", |body| body.name.as_str());
    json!({
        "name": name, "status": row.status.as_str(), "x_px": row.center_x_px, "y_px": row.center_y_px,
        "radius_px": row.radius_px, "lines_px": row.rod.as_ref().map(segments),
    })
}
