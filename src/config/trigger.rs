//! `[trigger]`: the start of a shot, its length, and further actions.

use super::body::{Body, BodyKind};
use super::check::{Bounds, OwnedKey, Setting, Table, quoted};
use super::error::ConfigError;
use super::raw::RawTrigger;
use crate::motion::Scale;
use crate::results::named_enum;

named_enum! {
    /// The condition that starts a shot.
    TriggerMode: "mode" {
        /// None. With a `[record]` table the whole stream becomes one recording.
        Off = 0 "off",
        /// The command `ricochet trigger`, or a request of another program.
        Software = 1 "software",
        /// The camera's own line. It sends nothing before a pulse, and a shot is what it sends until it falls silent.
        Hardware = 2 "hardware",
        /// Grey levels change.
        Motion = 3 "motion",
        /// A body enters `roi_px`, or the image.
        Enter = 4 "enter",
        /// A body exceeds `speed_m_s`.
        Speed = 5 "speed",
        /// The gap between a ball, or a rod's end, and the surface's edge falls below `gap_mm`.
        Gap = 6 "gap",
        /// A ball, or a rod's end, is about to touch the surface's edge.
        PredictedContact = 7 "predicted-contact",
    }
}

impl TriggerMode {
    const SETTING: Setting<Self> = Setting { key: "mode", name: Self::as_str };

    /// Whether the decision depends on measured motion.
    pub fn is_measured(self) -> bool {
        matches!(self, Self::Enter | Self::Speed | Self::Gap | Self::PredictedContact)
    }
}

/// `[trigger]`: the start of a shot, its length, and further actions.
///
/// With mode `off` the other values are checked and otherwise unused. `ricochet trigger` starts a shot in every other mode
/// but `hardware`.
#[derive(Debug, Clone, PartialEq)]
pub struct Trigger {
    /// The mode, default `off`.
    pub mode: TriggerMode,
    /// The mean absolute change of the grey levels in `roi_px` from one frame to the next that counts as motion, above 0
    /// and at most 65535 DN, default 5. Noise of standard deviation s alone gives 1.13 s. For mode `motion`.
    pub threshold_dn: f64,
    /// The watched region, `[x, y, width, height]` in px, inside the image. Default: the whole image. Mode `motion`
    /// compares its grey levels. Mode `enter` waits for a body's centre in it.
    pub roi_px: Option<[u32; 4]>,
    /// The body that may start a shot. Default: every body. For the modes `enter`, `speed`, `gap` and `predicted-contact`.
    pub body: Option<String>,
    /// The speed to exceed, above 0 and at most 100000 m/s. Required by mode `speed`, which needs a `[scale]`.
    pub speed_m_s: Option<f64>,
    /// The gap between the ball's rim, or the rod's end, and `surface.edge`, 0 to 100000 mm. Required by mode `gap`, which
    /// needs a `[scale]`.
    pub gap_mm: Option<f64>,
    /// The maximum time from the prediction to the contact, 0 to 10 s, default 0.01. The prediction comes later if the
    /// moment of contact is not known to half a frame that early, and at the contact if it cannot be known before. For mode
    /// `predicted-contact`, which needs a `[scale]`.
    pub lead_s: f64,
    /// The silence of the camera that ends a shot, 0.01 to 3600 s, default 0.2. The next frame begins another shot. For
    /// mode `hardware`.
    pub silence_s: f64,
    /// The time recorded before the trigger, 0 to 60 s, default 0.05. The ring of frames must hold it. Not for mode
    /// `hardware`.
    pub pre_s: f64,
    /// The time recorded from the trigger on, above 0 and at most 3600 s, default 0.1. Not for mode `hardware`.
    pub post_s: f64,
    /// The minimum time between triggers, 0 to 86400 s, default 0. Earlier ones are ignored, except `ricochet trigger`.
    pub quiet_s: f64,
    /// Whether the rig arms itself again after a shot, default true. Otherwise it waits for `ricochet arm`.
    pub rearm: bool,
    /// The program to run at each trigger, with its arguments, 1 to 64 texts. No shell is involved.
    pub command: Vec<String>,
    /// The address of a web service that receives a POST at each trigger, `http[s]://host[:port][/path]`.
    pub url: Option<String>,
    /// The name of another rig on this machine to trigger as well.
    pub other_rig: Option<String>,
}

/// The settings of the rest of the file that a trigger depends on.
pub(super) struct TriggerContext<'a> {
    pub image_px: Option<(u32, u32)>,
    pub bodies: &'a [Body],
    pub scale: Option<Scale>,
    pub has_edge: bool,
    /// Whether the camera waits for pulses.
    pub is_pulsed: bool,
    pub rig: &'a str,
}

const MAX_COMMAND_TEXTS: usize = 64;
const LEAD_S: f64 = 0.01;
const SILENCE_S: f64 = 0.2;
/// The modes that record the frames around a moment.
const TIMED: [TriggerMode; 6] = [
    TriggerMode::Software,
    TriggerMode::Motion,
    TriggerMode::Enter,
    TriggerMode::Speed,
    TriggerMode::Gap,
    TriggerMode::PredictedContact,
];

/// Checks the trigger with the other settings of the file that its mode needs, and fills in the defaults.
pub(super) fn check_trigger(
    table: &Table<'_>,
    raw: RawTrigger,
    context: &TriggerContext<'_>,
) -> Result<Trigger, ConfigError> {
    let mode = table.named("mode", raw.mode.as_deref())?.unwrap_or(TriggerMode::Off);
    check_owners(table, mode, &raw)?;
    let trigger = Trigger {
        mode,
        threshold_dn: table
            .number("threshold_dn", raw.threshold_dn, Bounds::above(0.0, 65_535.0, "DN"))?
            .unwrap_or(5.0),
        roi_px: table.region("roi_px", raw.roi_px.as_deref(), context.image_px)?,
        body: table.single_line("body", raw.body)?,
        speed_m_s: table.number("speed_m_s", raw.speed_m_s, Bounds::above(0.0, 1.0e5, "m/s"))?,
        gap_mm: table.number("gap_mm", raw.gap_mm, Bounds::closed(0.0, 1.0e5, "mm"))?,
        lead_s: table.number("lead_s", raw.lead_s, Bounds::closed(0.0, 10.0, "s"))?.unwrap_or(LEAD_S),
        silence_s: table.number("silence_s", raw.silence_s, Bounds::closed(0.01, 3600.0, "s"))?.unwrap_or(SILENCE_S),
        pre_s: table.number("pre_s", raw.pre_s, Bounds::closed(0.0, 60.0, "s"))?.unwrap_or(0.05),
        post_s: table.number("post_s", raw.post_s, Bounds::above(0.0, 3600.0, "s"))?.unwrap_or(0.1),
        quiet_s: table.number("quiet_s", raw.quiet_s, Bounds::closed(0.0, 86_400.0, "s"))?.unwrap_or(0.0),
        rearm: raw.rearm.unwrap_or(true),
        command: check_command(table, raw.command)?,
        url: check_url(table, raw.url)?,
        other_rig: table.single_line("other_rig", raw.other_rig)?,
    };
    if trigger.other_rig.as_deref() == Some(context.rig) {
        return Err(table.refuse("other_rig", "the name of another rig than this one"));
    }
    check_required(table, &trigger, context)?;
    Ok(trigger)
}

/// Refuses keys of another mode, instead of ignoring them. Mode `off` accepts all of them.
fn check_owners(table: &Table<'_>, mode: TriggerMode, raw: &RawTrigger) -> Result<(), ConfigError> {
    use TriggerMode::{Enter, Gap, Hardware, PredictedContact, Speed};
    let keys: [OwnedKey<'_, TriggerMode>; 7] = [
        ("body", raw.body.is_some(), &[Enter, Speed, Gap, PredictedContact]),
        ("speed_m_s", raw.speed_m_s.is_some(), &[Speed]),
        ("gap_mm", raw.gap_mm.is_some(), &[Gap]),
        ("lead_s", raw.lead_s.is_some(), &[PredictedContact]),
        ("silence_s", raw.silence_s.is_some(), &[Hardware]),
        ("pre_s", raw.pre_s.is_some(), &TIMED),
        ("post_s", raw.post_s.is_some(), &TIMED),
    ];
    if mode == TriggerMode::Off { Ok(()) } else { table.check_owners(TriggerMode::SETTING, mode, &keys) }
}

/// Refuses an unknown body, and a mode without the settings of the file that it requires.
fn check_required(table: &Table<'_>, trigger: &Trigger, context: &TriggerContext<'_>) -> Result<(), ConfigError> {
    use TriggerMode::{Gap, Hardware, PredictedContact, Speed};
    let mode = trigger.mode;
    let watched = |body: &&Body| trigger.body.as_ref().is_none_or(|name| *name == body.name);
    if trigger.body.is_some() && !context.bodies.iter().any(|body| watched(&body)) {
        let names = quoted(context.bodies.iter().map(|body| body.name.as_str()));
        return Err(table.refuse("body", format!("the name of a body: {names}")));
    }
    let needed = |what: &str| format!("{what} for mode = {:?}", mode.as_str());
    if mode == Hardware && !context.is_pulsed {
        let what = "the line that the camera waits for (camera.pulse_period_s for a simulated one)";
        return Err(table.text.refuse("camera.trigger_source", needed(what)));
    }
    if matches!(mode, Speed | Gap | PredictedContact) && context.scale.is_none() {
        return Err(table.text.refuse("scale.mm_per_px", needed("given, or ball_diameter_mm instead,")));
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
    if !context.has_edge {
        return Err(table.text.refuse("surface.edge", needed("two points of the edge, [[x, y], [x, y]] in px,")));
    }
    // The extent of the body around a patch is unknown.
    if context.bodies.iter().filter(watched).all(|body| body.kind == BodyKind::Patch) {
        return Err(table.foreign_key_error("mode", BodyKind::Patch.assignment(), BodyKind::Ball.assignment()));
    }
    let mut rods = (0..).zip(context.bodies).filter(|(_, body)| watched(body) && body.kind == BodyKind::Rod);
    // The end of a rod does not follow from its tapes.
    if let Some((index, _)) = rods.clone().next()
        && !context.bodies.iter().any(|body| watched(&body) && body.has_known_extent())
    {
        let key = format!("body[{index}].end_mm");
        return Err(table.text.refuse(&key, needed("0 to 10000 mm from its lowest edge to its end")));
    }
    if rods.any(|(_, rod)| rod.end_mm.is_some()) && !matches!(context.scale, Some(Scale::MmPerPx(_))) {
        return Err(table.text.refuse("scale.mm_per_px", needed("given, for the end of a rod,")));
    }
    Ok(())
}

/// Checks the program and its arguments: 1 to [`MAX_COMMAND_TEXTS`] texts without NUL, the first not blank; empty
/// without any.
fn check_command(table: &Table<'_>, texts: Option<Vec<String>>) -> Result<Vec<String>, ConfigError> {
    let Some(texts) = texts else { return Ok(Vec::new()) };
    let is_valid = (1..=MAX_COMMAND_TEXTS).contains(&texts.len())
        && texts.first().is_some_and(|program| !program.trim().is_empty())
        && texts.iter().all(|text| !text.contains('\0'));
    if is_valid { Ok(texts) } else { Err(table.refuse("command", "a program and its arguments, 1 to 64 texts")) }
}

/// Checks that an address is one of HTTP or HTTPS with a host and without a user name.
fn check_url(table: &Table<'_>, url: Option<String>) -> Result<Option<String>, ConfigError> {
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
