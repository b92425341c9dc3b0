//! `ricochet listen`: prints a live topic.

use super::rod;
use crate::bus::{Bus, BusError, Subscriber, Topic};
use crate::console::{Outcome, UsageError, say};
use crate::message::{
    Event, EventKind, FieldHeader, ImpactMessage, Number, Role, StatusMessage, TrackMessage, VelocityMessage,
};
use crate::process::Stop;
use crate::results::{ForceLaw, Impact, PairField, Phase, PointStatus};
use serde_json::{Map, Value, json};
use std::time::Duration;

const PAUSE: Duration = Duration::from_millis(1);
const TOPICS: &str = "field, track, velocity, impact, status, events";

/// What to listen to.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub struct ListenOptions {
    /// Topic: field, track, velocity, impact, status or events.
    pub topic: String,
    /// Name of the rig.
    #[arg(long, default_value = "rig")]
    pub rig: String,
    /// Print one JSON object per line.
    #[arg(long)]
    pub json: bool,
    /// Stop after this many lines.
    #[arg(long)]
    pub count: Option<u64>,
    /// Wait at most this long for a rig that is not running yet, s.
    #[arg(long = "wait", default_value_t = 0.0, value_name = "SECONDS")]
    pub wait_s: f64,
}

/// Prints messages as they come, until the rig's stream is over, `count` is reached or it is stopped.
///
/// # Errors
///
/// When there is no such topic or no such rig.
pub fn run(options: &ListenOptions, stop: &Stop) -> anyhow::Result<Outcome> {
    if !TOPICS.split(", ").any(|topic| topic == options.topic) {
        return Err(UsageError(format!("topic {:?} is not one of {TOPICS}", options.topic)).into());
    }
    let bus = Bus::join(&options.rig, "listen")?;
    wait_for_rig(&bus, options, stop)?;
    let mut printer = Printer { json: options.json, left: options.count, header_told: false };
    let watch = Watch::new(&bus)?;
    match options.topic.as_str() {
        "track" => follow(&bus.listen::<TrackMessage>()?, watch, track, &mut printer, stop),
        "velocity" => follow(&bus.listen::<VelocityMessage>()?, watch, velocity, &mut printer, stop),
        "impact" => follow(&bus.listen::<ImpactMessage>()?, watch, impact, &mut printer, stop),
        "status" => follow(&bus.listen::<StatusMessage>()?, watch, status, &mut printer, stop),
        "events" => follow(&bus.listen::<Event>()?, watch, event, &mut printer, stop),
        _ => follow_field(&bus, watch, &mut printer, stop),
    }
}

fn wait_for_rig(bus: &Bus, options: &ListenOptions, stop: &Stop) -> Result<(), BusError> {
    let mut tries = (options.wait_s.max(0.0) * 1000.0 / 20.0) as u64;
    loop {
        match bus.listen::<Event>() {
            Err(BusError::NoRig { .. }) if tries > 0 && !stop.requested() => {
                tries -= 1;
                std::thread::sleep(Duration::from_millis(20));
            }
            Err(error) => return Err(error),
            Ok(_) => return Ok(()),
        }
    }
}

/// Sees when a rig has told everything it will tell.
struct Watch<'a> {
    bus: &'a Bus,
    events: Subscriber<Event>,
    /// Looks until the processes of the rig are looked for again.
    looks: u32,
}

impl<'a> Watch<'a> {
    /// Looks between two checks of the processes; about half a second.
    const LOOKS: u32 = 400;

    fn new(bus: &'a Bus) -> Result<Self, BusError> {
        Ok(Self { bus, events: bus.listen()?, looks: Self::LOOKS })
    }

    /// Whether the end was told; an error when nobody is left to tell it.
    fn is_over(&mut self) -> Result<bool, BusError> {
        self.looks -= 1;
        let is_dead = self.looks == 0 && !self.bus.is_alive();
        self.looks = if self.looks == 0 { Self::LOOKS } else { self.looks };
        let mut over = false;
        while let Some(event) = self.events.take()? {
            over = match event.kind() {
                Some(EventKind::Tracked) => true,
                Some(EventKind::Prepared) => false,
                _ => over,
            };
        }
        if is_dead && !over {
            return Err(BusError::Died { rig: self.bus.rig().to_owned() });
        }
        Ok(over)
    }
}

fn follow<T: Topic>(
    topic: &Subscriber<T>,
    mut watch: Watch<'_>,
    row: fn(&T) -> Map<String, Value>,
    printer: &mut Printer,
    stop: &Stop,
) -> anyhow::Result<Outcome> {
    while !stop.requested() {
        // Asked before the last look at the topic, so that nothing told before the end is missed.
        let over = watch.is_over()?;
        while let Some(message) = topic.take()? {
            if !printer.print(&row(&message)) {
                return Ok(Outcome::Clean);
            }
        }
        if over {
            break;
        }
        std::thread::sleep(PAUSE);
    }
    Ok(Outcome::Clean)
}

fn follow_field(bus: &Bus, mut watch: Watch<'_>, printer: &mut Printer, stop: &Stop) -> anyhow::Result<Outcome> {
    let topic = bus.listen_field()?;
    while !stop.requested() {
        let over = watch.is_over()?;
        while let Some((header, field)) = topic.take()? {
            for row in field_rows(&header, field.as_ref()) {
                if !printer.print(&row) {
                    return Ok(Outcome::Clean);
                }
            }
        }
        if over {
            break;
        }
        std::thread::sleep(PAUSE);
    }
    Ok(Outcome::Clean)
}

struct Printer {
    json: bool,
    left: Option<u64>,
    header_told: bool,
}

impl Printer {
    /// Prints a row; `false` when that was enough.
    fn print(&mut self, row: &Map<String, Value>) -> bool {
        if self.left == Some(0) {
            return false;
        }
        if self.json {
            say(&Value::Object(row.clone()).to_string());
        } else {
            if !self.header_told {
                say(&row.keys().cloned().collect::<Vec<_>>().join(","));
                self.header_told = true;
            }
            say(&row.values().map(cell).collect::<Vec<_>>().join(","));
        }
        self.left = self.left.map(|left| left - 1);
        self.left != Some(0)
    }
}

fn cell(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

fn row(cells: impl IntoIterator<Item = (&'static str, Value)>) -> Map<String, Value> {
    cells.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

fn number(number: Number) -> Value {
    json!(Option::<f64>::from(number))
}

fn status_word(status: u32) -> Value {
    json!(PointStatus::from_number(status).map(PointStatus::word))
}

fn track(message: &TrackMessage) -> Map<String, Value> {
    let place =
        [("frame", json!(message.sequence)), ("body", json!(message.body)), ("stamp_ns", json!(message.stamp_ns))];
    let rest = [
        ("center_x_px", number(message.center_x_px)),
        ("center_y_px", number(message.center_y_px)),
        ("angle_deg", number(message.angle_deg)),
        ("radius_px", number(message.radius_px)),
        ("sigma_center_px", number(message.sigma_center_px)),
        ("sigma_angle_deg", number(message.sigma_angle_deg)),
        ("visible_fraction", number(message.visible_fraction)),
        ("status", status_word(message.status)),
    ];
    let of_rod = message.rod.rod().map(|told| {
        let numbers = rod::numbers(Some(&told)).into_iter().map(|(name, number)| (name, json!(number)));
        let statuses = rod::statuses(Some(&told)).into_iter();
        numbers.chain(statuses.map(|(name, status)| (name, json!(status.map(PointStatus::word)))))
    });
    row(place.into_iter().chain(of_rod.into_iter().flatten()).chain(rest))
}

fn velocity(message: &VelocityMessage) -> Map<String, Value> {
    row([
        ("frame", json!(message.sequence)),
        ("body", json!(message.body)),
        ("stamp_ns", json!(message.stamp_ns)),
        ("center_x_px", number(message.center_x_px)),
        ("center_y_px", number(message.center_y_px)),
        ("radius_px", number(message.radius_px)),
        ("dx_px", number(message.dx_px)),
        ("dy_px", number(message.dy_px)),
        ("dtheta_deg", number(message.dtheta_deg)),
        ("sigma_dx_px", number(message.sigma_dx_px)),
        ("sigma_dy_px", number(message.sigma_dy_px)),
        ("sigma_dtheta_deg", number(message.sigma_dtheta_deg)),
        ("vx_m_s", number(message.vx_m_s)),
        ("vy_m_s", number(message.vy_m_s)),
        ("vn_m_s", number(message.vn_m_s)),
        ("vt_m_s", number(message.vt_m_s)),
        ("omega_rad_s", number(message.omega_rad_s)),
        ("sigma_v_m_s", number(message.sigma_v_m_s)),
        ("sigma_omega_rad_s", number(message.sigma_omega_rad_s)),
        ("visible_fraction", number(message.visible_fraction)),
        ("phase", json!(Phase::from_number(message.phase).map(Phase::word))),
        ("status", status_word(message.status)),
    ])
}

fn impact(message: &ImpactMessage) -> Map<String, Value> {
    let names = Impact::unknown(0, 0, 0).numbers().map(|(name, _)| name);
    let mut cells = row([
        ("body", json!(message.body)),
        ("number", json!(message.number)),
        ("revision", json!(message.revision)),
        ("origin_ns", json!(message.origin_ns)),
    ]);
    for (name, estimate) in names.iter().zip(&message.numbers) {
        let known = estimate.known == 1;
        cells.insert((*name).to_owned(), json!(known.then_some(estimate.value)));
        cells.insert(format!("sigma_{name}"), json!(known.then_some(estimate.sigma)));
    }
    cells.insert("force_law".into(), json!(ForceLaw::from_number(message.force_law).map(ForceLaw::word)));
    let probability = f64::from(message.force_law_probability);
    cells.insert("force_law_probability".into(), json!((probability > 0.0).then_some(probability)));
    cells.insert("status".into(), status_word(message.status));
    cells
}

fn status(message: &StatusMessage) -> Map<String, Value> {
    row([
        ("process", json!(Role::from_number(message.role).map(Role::word))),
        ("index", json!(message.index)),
        ("pid", json!(message.pid)),
        ("sequence", json!(message.sequence)),
        ("taken", json!(message.taken)),
        ("given", json!(message.given)),
        ("lost", json!(message.lost)),
        ("dropped", json!(message.dropped)),
        ("restarts", json!(message.restarts)),
        ("rate_hz", json!(message.rate_hz)),
        ("latency_s", json!(message.latency_s)),
    ])
}

fn event(message: &Event) -> Map<String, Value> {
    row([
        ("stamp_ns", json!(message.stamp_ns)),
        ("frame", json!(message.sequence)),
        ("kind", json!(message.kind().map(EventKind::word))),
        ("text", json!(message.text())),
    ])
}

fn field_rows(header: &FieldHeader, field: Option<&PairField>) -> Vec<Map<String, Value>> {
    let points = field.map_or(&[][..], |field| &field.points);
    let point_row = |point: &crate::results::FieldPoint| {
        let motion = point.displacement;
        row([
            ("frame", json!(header.sequence)),
            ("x_px", json!(point.x_px)),
            ("y_px", json!(point.y_px)),
            ("u_px", json!(motion.map(|motion| motion.u_px))),
            ("v_px", json!(motion.map(|motion| motion.v_px))),
            ("sigma_u_px", json!(motion.map(|motion| motion.sigma_u_px))),
            ("sigma_v_px", json!(motion.map(|motion| motion.sigma_v_px))),
            ("zncc", json!(point.zncc)),
            ("peak_ratio", json!(point.peak_ratio)),
            ("status", json!(point.status.word())),
        ])
    };
    points.iter().map(point_row).collect()
}
