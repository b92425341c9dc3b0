//! `[trigger]`: what starts a shot, how much of the stream belongs to it, and what else it sets off.

use super::body::{Body, BodyKind, with};
use super::check::{Bounds, Table, listed};
use super::error::ConfigError;
use super::raw::RawTrigger;
use crate::motion::Scale;
use crate::results::named_enum;

named_enum! {
    /// What starts a shot.
    TriggerMode: "mode" {
        /// Nothing: with a `[record]` table the whole stream becomes one recording.
        Off = 0 "off",
        /// The command `ricochet trigger`, or a program that asks for it.
        Software = 1 "software",
        /// The camera's own line: it sends nothing until a pulse comes, and a shot is what it sends until it is silent.
        Hardware = 2 "hardware",
        /// Something moves in the picture.
        Motion = 3 "motion",
        /// A body comes into `roi_px`, or into sight.
        Enter = 4 "enter",
        /// A body's speed rises above `speed_m_s`.
        Speed = 5 "speed",
        /// The gap between a ball, or a rod's end, and the surface's edge becomes smaller than `gap_mm`.
        Gap = 6 "gap",
        /// A ball, or a rod's end, is about to touch the surface's edge.
        PredictedContact = 7 "predicted-contact",
    }
}

impl TriggerMode {
    /// Whether it is decided from what was measured of the bodies.
    pub fn is_measured(self) -> bool {
        matches!(self, Self::Enter | Self::Speed | Self::Gap | Self::PredictedContact)
    }
}

/// `[trigger]`: what starts a shot, how much of the stream belongs to it, and what else it sets off.
///
/// With mode `off` the other values are checked and otherwise unused. A shot may
/// be asked for with `ricochet trigger` in every other mode but `hardware`.
#[derive(Debug, Clone, PartialEq)]
pub struct Trigger {
    /// Default `off`.
    pub mode: TriggerMode,
    /// Mean absolute change of the grey level from a frame to the next, over `roi_px`, that counts as motion: above
    /// 0 and at most 65535 DN, default 5 (noise of standard deviation s alone changes the level by 1.13 s). For
    /// mode `motion`.
    pub threshold_dn: f64,
    /// Region watched, `[x, y, width, height]` in px, inside the image; left out, the whole image. Mode `motion`: where
    /// grey levels are compared. Mode `enter`: where the body's centre must come.
    pub roi_px: Option<[u32; 4]>,
    /// The body that may start a shot; left out, every one. For the modes `enter`, `speed`, `gap` and
    /// `predicted-contact`.
    pub body: Option<String>,
    /// Speed that a body must exceed, above 0 and at most 100000 m/s; needed by mode `speed`, which needs a `[scale]`.
    pub speed_m_s: Option<f64>,
    /// Gap between the ball's rim, or the rod's end, and `surface.edge`, 0 to 100000 mm; needed by mode `gap`, which needs
    /// a `[scale]`.
    pub gap_mm: Option<f64>,
    /// How long before the contact it is told at most, 0 to 10 s, default 0.01. It is told later when the contact's
    /// moment cannot be known to half a frame that early, and at the contact when it cannot be known before. For mode
    /// `predicted-contact`, which needs a `[scale]`.
    pub lead_s: f64,
    /// Silence of the camera that ends a shot, 0.01 to 3600 s, default 0.2; the next frame begins another. For mode
    /// `hardware`.
    pub silence_s: f64,
    /// Time kept from before the trigger, 0 to 60 s, default 0.05; the ring of frames must hold it. Not for mode
    /// `hardware`.
    pub pre_s: f64,
    /// Time kept from the trigger on, above 0 and at most 3600 s, default 0.1. Not for mode `hardware`.
    pub post_s: f64,
    /// Least time from a trigger to the next, 0 to 86400 s, default 0; what meets the condition sooner is passed over.
    /// `ricochet trigger` does not wait for it.
    pub quiet_s: f64,
    /// Whether the rig arms itself again after a shot, default true; otherwise it waits for `ricochet arm`.
    pub rearm: bool,
    /// Program to run at each trigger and its arguments, 1 to 64 texts; no shell is involved.
    pub command: Vec<String>,
    /// Address of a web service that is told of each trigger by a POST, `http://host[:port][/path]`.
    pub url: Option<String>,
    /// Another rig on this machine that is triggered too, by its name.
    pub other_rig: Option<String>,
}

/// What a trigger goes together with in the rest of the file.
pub(super) struct Surroundings<'a> {
    pub image_px: Option<(u32, u32)>,
    pub bodies: &'a [Body],
    pub scale: Option<Scale>,
    pub has_edge: bool,
    /// Whether the camera waits for pulses.
    pub is_pulsed: bool,
    pub rig: &'a str,
}

const COMMAND_TEXTS_MAX: usize = 64;
const LEAD_S: f64 = 0.01;
const SILENCE_S: f64 = 0.2;
/// Every mode that keeps what lies around a moment.
const AROUND: [TriggerMode; 6] = [
    TriggerMode::Software,
    TriggerMode::Motion,
    TriggerMode::Enter,
    TriggerMode::Speed,
    TriggerMode::Gap,
    TriggerMode::PredictedContact,
];

pub(super) fn trigger(table: &Table<'_>, raw: RawTrigger, around: &Surroundings<'_>) -> Result<Trigger, ConfigError> {
    let mode = table
        .choice("mode", raw.mode.as_deref(), &TriggerMode::ALL.map(|mode| (mode.as_str(), mode)))?
        .unwrap_or(TriggerMode::Off);
    refuse_strangers(table, mode, &raw)?;
    let trigger = Trigger {
        mode,
        threshold_dn: table
            .number("threshold_dn", raw.threshold_dn, Bounds::above(0.0, 65_535.0, "DN"))?
            .unwrap_or(5.0),
        roi_px: table.region("roi_px", raw.roi_px.as_deref(), around.image_px)?,
        body: table.filled("body", raw.body)?,
        speed_m_s: table.number("speed_m_s", raw.speed_m_s, Bounds::above(0.0, 1.0e5, "m/s"))?,
        gap_mm: table.number("gap_mm", raw.gap_mm, Bounds::closed(0.0, 1.0e5, "mm"))?,
        lead_s: table.number("lead_s", raw.lead_s, Bounds::closed(0.0, 10.0, "s"))?.unwrap_or(LEAD_S),
        silence_s: table.number("silence_s", raw.silence_s, Bounds::closed(0.01, 3600.0, "s"))?.unwrap_or(SILENCE_S),
        pre_s: table.number("pre_s", raw.pre_s, Bounds::closed(0.0, 60.0, "s"))?.unwrap_or(0.05),
        post_s: table.number("post_s", raw.post_s, Bounds::above(0.0, 3600.0, "s"))?.unwrap_or(0.1),
        quiet_s: table.number("quiet_s", raw.quiet_s, Bounds::closed(0.0, 86_400.0, "s"))?.unwrap_or(0.0),
        rearm: raw.rearm.unwrap_or(true),
        command: command(table, raw.command)?,
        url: url(table, raw.url)?,
        other_rig: table.filled("other_rig", raw.other_rig)?,
    };
    if trigger.other_rig.as_deref() == Some(around.rig) {
        return Err(table.refuse("other_rig", "the name of another rig than this one"));
    }
    refuse_gaps(table, &trigger, around)?;
    Ok(trigger)
}

/// Refuses thresholds of another mode, rather than ignoring them.
fn refuse_strangers(table: &Table<'_>, mode: TriggerMode, raw: &RawTrigger) -> Result<(), ConfigError> {
    use TriggerMode::{Enter, Gap, Hardware, Off, PredictedContact, Speed};
    let keys: [(&str, bool, &[TriggerMode]); 7] = [
        ("body", raw.body.is_some(), &[Enter, Speed, Gap, PredictedContact]),
        ("speed_m_s", raw.speed_m_s.is_some(), &[Speed]),
        ("gap_mm", raw.gap_mm.is_some(), &[Gap]),
        ("lead_s", raw.lead_s.is_some(), &[PredictedContact]),
        ("silence_s", raw.silence_s.is_some(), &[Hardware]),
        ("pre_s", raw.pre_s.is_some(), &AROUND),
        ("post_s", raw.post_s.is_some(), &AROUND),
    ];
    match keys.iter().find(|(_, given, modes)| *given && mode != Off && !modes.contains(&mode)) {
        None => Ok(()),
        Some((key, _, modes)) => {
            let belongs_to = format!("mode = {}", listed(modes.iter().map(|mode| mode.as_str())));
            Err(table.text.out_of_place(&table.key(key), &format!("mode = {:?}", mode.as_str()), &belongs_to))
        }
    }
}

/// Refuses a mode without what it is decided from.
fn refuse_gaps(table: &Table<'_>, trigger: &Trigger, around: &Surroundings<'_>) -> Result<(), ConfigError> {
    use TriggerMode::{Gap, Hardware, PredictedContact, Speed};
    let mode = trigger.mode;
    let watched = |body: &&Body| trigger.body.as_ref().is_none_or(|name| *name == body.name);
    if trigger.body.is_some() && !around.bodies.iter().any(|body| watched(&body)) {
        let names = listed(around.bodies.iter().map(|body| body.name.as_str()));
        return Err(table.refuse("body", format!("the name of a body: {names}")));
    }
    let needed = |what: &str| format!("{what} for mode = {:?}", mode.as_str());
    if mode == Hardware && !around.is_pulsed {
        let what = "the line that the camera waits for (of a simulated one, camera.pulse_period_s)";
        return Err(table.text.refuse("camera.trigger_source", needed(what)));
    }
    if matches!(mode, Speed | Gap | PredictedContact) && around.scale.is_none() {
        return Err(table.text.refuse("scale.mm_per_px", needed("given, or ball_diameter_mm in its place,")));
    }
    if mode == Speed && trigger.speed_m_s.is_none() {
        return Err(table.refuse("speed_m_s", needed("above 0 and at most 100000 m/s")));
    }
    if mode == Gap && trigger.gap_mm.is_none() {
        return Err(table.refuse("gap_mm", needed("0 to 100000 mm")));
    }
    if !matches!(mode, Gap | PredictedContact) {
        return Ok(());
    }
    if !around.has_edge {
        return Err(table.text.refuse("surface.edge", needed("two points of the edge, [[x, y], [x, y]] in px,")));
    }
    // A patch does not tell how far the body around it reaches.
    if around.bodies.iter().filter(watched).all(|body| body.kind == BodyKind::Patch) {
        return Err(table.text.out_of_place(&table.key("mode"), with(BodyKind::Patch), with(BodyKind::Ball)));
    }
    let mut rods = (0..).zip(around.bodies).filter(|(_, body)| watched(body) && body.kind == BodyKind::Rod);
    match rods.next() {
        // Nor do its tapes where a rod's end is.
        Some((index, _)) if !around.bodies.iter().any(|body| watched(&body) && body.has_rim()) => {
            let key = format!("body[{index}].end_mm");
            Err(table.text.refuse(&key, needed("0 to 10000 mm from its lowest edge to its end")))
        }
        Some((_, rod)) if rod.end_mm.is_some() && !matches!(around.scale, Some(Scale::MmPerPx(_))) => {
            Err(table.text.refuse("scale.mm_per_px", needed("given, for the end of a rod,")))
        }
        _ => Ok(()),
    }
}

fn command(table: &Table<'_>, texts: Option<Vec<String>>) -> Result<Vec<String>, ConfigError> {
    let Some(texts) = texts else { return Ok(Vec::new()) };
    let sound = (1..=COMMAND_TEXTS_MAX).contains(&texts.len())
        && texts.first().is_some_and(|program| !program.trim().is_empty())
        && texts.iter().all(|text| !text.contains('\0'));
    if sound { Ok(texts) } else { Err(table.refuse("command", "a program and its arguments, 1 to 64 texts")) }
}

fn url(table: &Table<'_>, url: Option<String>) -> Result<Option<String>, ConfigError> {
    let plain = |url: &str| url.bytes().all(|byte| byte.is_ascii_graphic());
    let has_host = |rest: &str| !rest.is_empty() && !rest.starts_with(['/', ':', '?', '#']) && !rest.contains('@');
    match url {
        Some(url)
            if !(plain(&url)
                && ["http://", "https://"].iter().any(|scheme| url.strip_prefix(scheme).is_some_and(has_host))) =>
        {
            Err(table.refuse("url", "http[s]://host[:port][/path]"))
        }
        url => Ok(url),
    }
}
