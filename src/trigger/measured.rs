//! Triggers on what was measured: a body enters, is fast, is near the surface, or is about to touch it.

use super::flight::{Fit, Flight, center_px};
use crate::motion::{Axes, MotionParams, Rolling, Scale, gravity_px};
use crate::results::BodyStep;

/// A body was not seen in so many frames in a row: it is gone, and the next sight of it is a new one.
const GONE_FRAMES: u32 = 3;
/// A body is inside (or outside) its region when it was so in so many frames in a row.
const SURE_FRAMES: u32 = 3;
/// Frames a speed is taken from.
const SPEED_FRAMES: usize = 8;
/// Frames of flight a contact is predicted from, at most.
const FLIGHT_FRAMES: usize = 40;
/// Frames that a speed or a gap rests on at least.
const FEWEST_FRAMES: usize = 4;
/// Frames that a prediction rests on at least.
const PREDICTION_FRAMES: usize = 6;
/// A contact is told ahead once its moment is known to this standard uncertainty, frames.
const SURE_OF_CONTACT_FRAMES: f64 = 0.5;
/// A contact that began longer ago was not predicted, frames.
const LATE_FRAMES: f64 = 3.0;
/// A body comes nearer when its speed exceeds so many sigmas ...
const APPROACH_SIGMAS: f64 = 5.0;
/// ... and it has come so much nearer while it was looked at, px.
const APPROACH_PX: f64 = 0.5;
/// Share of its threshold that a speed must fall to before it can cross it again, and a gap's inverse share.
const AGAIN_SHARE: f64 = 0.9;

/// What starts a shot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Condition {
    /// The body's centre comes into this region (x, y, width, height in px; `None`: into sight).
    Enter {
        /// The region.
        roi_px: Option<[u32; 4]>,
    },
    /// Its speed rises above this, m/s.
    Speed {
        /// The speed.
        speed_m_s: f64,
    },
    /// The gap between it and the surface becomes smaller than this, mm.
    Gap {
        /// The gap.
        gap_mm: f64,
    },
    /// It will touch the surface within this time, s.
    Contact {
        /// How long ahead it is told at most.
        lead_s: f64,
    },
}

/// How one body is watched.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyWatch {
    /// What results call it.
    pub name: String,
    /// What its motion is computed with.
    pub motion: MotionParams,
    /// Whether it may start a shot.
    pub is_watched: bool,
    /// How far the end of a rod lies below its lowest edge, px; of the gap and the contact of a rod.
    pub end_px: Option<f64>,
}

/// A condition was met.
#[derive(Debug, Clone, PartialEq)]
pub struct Decision {
    /// Index of the body.
    pub body: u32,
    /// The frame it belongs to: of a predicted contact, the frame that will show it.
    pub frame: u64,
    /// That frame's stamp, ns since the Unix epoch; of one to come, as the nominal rate has it.
    pub stamp_ns: u64,
    /// The newest frame it was decided from.
    pub newest_frame: u64,
    /// That frame's stamp, ns since the Unix epoch.
    pub newest_stamp_ns: u64,
    /// What was met, in words.
    pub what: String,
}

/// A trigger on measured motion: steps in frame order in, decisions out.
///
/// Every condition fires once: a body that entered must leave, one that was fast
/// must slow down, one that was near must move away, and one that touched must
/// part from the surface, or be out of sight, before it can fire again.
#[derive(Debug, Clone)]
pub struct MeasuredTrigger {
    condition: Condition,
    /// Ends of the surface's edge, px, and its unit normal away from the surface.
    edge: Option<([[f64; 2]; 2], [f64; 2])>,
    bodies: Vec<Body>,
}

#[derive(Debug, Clone)]
struct Body {
    watch: BodyWatch,
    flight: Flight,
    rolling: Rolling,
    absent_frames: u32,
    /// Whether it is inside, once that is known.
    inside: Option<bool>,
    /// What the newest frame says of that, and how many in a row did.
    newest_inside: (bool, u32),
    /// Whether it may fire.
    ready: bool,
}

impl MeasuredTrigger {
    /// Watches these bodies; `edge_px` are two points of the surface's edge, image axes.
    pub fn new(condition: Condition, bodies: Vec<BodyWatch>, edge_px: Option<[[f64; 2]; 2]>) -> Self {
        let back_frames = if matches!(condition, Condition::Speed { .. }) { SPEED_FRAMES } else { FLIGHT_FRAMES };
        let angle_deg = bodies.first().map_or(0.0, |body| body.motion.surface_angle_deg);
        let rectifier = bodies.first().and_then(|body| body.motion.rectifier.clone());
        let place = |end: [f64; 2]| rectifier.as_ref().and_then(|rectifier| rectifier.place(end)).unwrap_or(end);
        let edge_px = edge_px.map(|ends| ends.map(place));
        // A body that is near the surface when it is first seen has not come near it.
        let ready = !matches!(condition, Condition::Gap { .. });
        let body = |watch: BodyWatch| Body {
            flight: Flight::new(back_frames, watch.end_px),
            rolling: Rolling::new(watch.motion.shutter, watch.motion.form),
            watch,
            absent_frames: 0,
            inside: None,
            newest_inside: (false, 0),
            ready,
        };
        let bodies = bodies.into_iter().map(body).collect();
        Self { condition, edge: edge_px.map(|ends| (ends, outward(ends, angle_deg))), bodies }
    }

    /// Takes the next step, in frame order; of several intervals only the shortest counts.
    pub fn push(&mut self, step: &BodyStep) -> Option<Decision> {
        let (condition, edge) = (self.condition, self.edge);
        let body = self.bodies.get_mut(step.body as usize)?;
        if !body.watch.is_watched || step.interval_frames != body.watch.motion.interval_frames {
            return None;
        }
        if let Condition::Enter { roi_px } = condition {
            return body.enter(step, roi_px);
        }
        body.rolling.push(step);
        let step = &body.watch.motion.rectified(&body.rolling.straightened(step));
        let scale = body.metres_per_px(step);
        let gravity = scale.map_or([0.0; 2], |scale| gravity_px(&body.watch.motion, scale));
        if !body.flight.push(step, gravity) {
            body.absent_frames += 1;
            if body.absent_frames == GONE_FRAMES {
                body.flight.reset();
                body.ready = !matches!(condition, Condition::Gap { .. });
            }
            return None;
        }
        body.absent_frames = 0;
        let fit = body.flight.fit(gravity).filter(|fit| fit.frames >= FEWEST_FRAMES && !body.flight.is_off())?;
        match condition {
            Condition::Enter { .. } => None,
            Condition::Speed { speed_m_s } => body.speed(step, &fit, scale?, speed_m_s),
            Condition::Gap { gap_mm } => body.gap(step, &Near::new(&fit, edge?), 1e-3 * gap_mm / scale?, gap_mm),
            Condition::Contact { lead_s } => {
                let lead = lead_s * 1e9 / body.watch.motion.frame_period_ns;
                body.contact(step, &fit, &Near::new(&fit, edge?), gravity, lead)
            }
        }
    }
}

/// Unit vector across the edge, to the side that the surface's normal points to.
fn outward(ends: [[f64; 2]; 2], angle_deg: f64) -> [f64; 2] {
    let along = [ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]];
    let length = along[0].hypot(along[1]);
    let across = [-along[1] / length, along[0] / length];
    let side = Axes::new(angle_deg).surface(across[0], across[1]).normal;
    if side < 0.0 { across.map(|x| -x) } else { across }
}

/// A body and the surface's edge; px, frames.
struct Near {
    /// From the surface to the body's rim.
    gap: f64,
    /// Its rate; negative when the body comes nearer.
    rate: f64,
    normal: [f64; 2],
    /// Place along the edge from its first end, as a share of its length, and its rate.
    along: [f64; 2],
}

impl Near {
    fn new(fit: &Fit, (ends, normal): ([[f64; 2]; 2], [f64; 2])) -> Self {
        let dot = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
        let edge = [ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]];
        let from = [fit.at_px[0] - ends[0][0], fit.at_px[1] - ends[0][1]];
        let length2 = dot(edge, edge);
        Self {
            gap: dot(from, normal) - fit.radius_px,
            rate: dot(fit.rate_px, normal),
            normal,
            along: [dot(from, edge) / length2, dot(fit.rate_px, edge) / length2],
        }
    }

    /// Whether the body is over the edge, not beside it, so many frames from now.
    fn is_over_after(&self, frames: f64) -> bool {
        (0.0..=1.0).contains(&(self.along[0] + frames * self.along[1]))
    }

    /// Frames from now to the first touch, and the speed then; `None` when there will be none.
    fn touch(&self, gravity_px: [f64; 2]) -> Option<(f64, f64)> {
        let pull = self.normal[0] * gravity_px[0] + self.normal[1] * gravity_px[1];
        if self.gap <= 0.0 {
            return (self.rate < 0.0).then(|| (self.gap / -self.rate, -self.rate));
        }
        let square = self.rate * self.rate - 2.0 * pull * self.gap;
        if square < 0.0 {
            return None;
        }
        let frames = 2.0 * self.gap / (square.sqrt() - self.rate);
        let speed = -(self.rate + pull * frames);
        (frames.is_finite() && frames >= 0.0 && speed > 0.0).then_some((frames, speed))
    }
}

impl Body {
    /// From the scale given, or from the outline where the ball's diameter is.
    fn metres_per_px(&self, step: &BodyStep) -> Option<f64> {
        match self.watch.motion.scale {
            Scale::MmPerPx(mm) => Some(1e-3 * mm),
            Scale::BallDiameterMm(mm) => {
                let radius_px = step.circle.map(|circle| circle.radius_px).or_else(|| self.flight.radius_px())?;
                (radius_px > 0.0).then(|| 0.5e-3 * mm / radius_px)
            }
            Scale::Unknown => None,
        }
    }

    fn decision(&self, step: &BodyStep, ahead_frames: f64, what: &str) -> Decision {
        let whole = ahead_frames.round();
        let period_ns = self.watch.motion.frame_period_ns;
        let moved = |from: u64, by: f64| (i128::from(from) + by.round() as i128).clamp(0, i128::from(u64::MAX)) as u64;
        Decision {
            body: step.body,
            frame: moved(step.frame, whole),
            stamp_ns: moved(step.stamp_ns, whole * period_ns),
            newest_frame: step.frame,
            newest_stamp_ns: step.stamp_ns,
            what: format!("{}: {what}", self.watch.name),
        }
    }

    fn enter(&mut self, step: &BodyStep, roi_px: Option<[u32; 4]>) -> Option<Decision> {
        let is_in = |at_px: [f64; 2]| {
            roi_px.is_none_or(|[x, y, width, height]| {
                let within =
                    |at: f64, start: u32, size: u32| at >= f64::from(start) && at < f64::from(start) + f64::from(size);
                within(at_px[0], x, width) && within(at_px[1], y, height)
            })
        };
        let inside = center_px(step).is_some_and(is_in);
        let (before, frames) = self.newest_inside;
        let frames = if before == inside { frames.saturating_add(1) } else { 1 };
        self.newest_inside = (inside, frames);
        if frames < SURE_FRAMES {
            return None;
        }
        // One that is there from the start has not come in.
        let entered = self.inside.replace(inside) == Some(false) && inside;
        entered.then(|| self.decision(step, -f64::from(SURE_FRAMES - 1), "entered"))
    }

    fn speed(&mut self, step: &BodyStep, fit: &Fit, metres_per_px: f64, speed_m_s: f64) -> Option<Decision> {
        let per_frame = metres_per_px * 1e9 / self.watch.motion.frame_period_ns / self.rolling.periods();
        let speed = fit.rate_px[0].hypot(fit.rate_px[1]) * per_frame;
        let sigma = fit.sigma_rate_px * per_frame;
        if speed < AGAIN_SHARE * speed_m_s {
            self.ready = true;
        }
        if !self.ready || speed - 3.0 * sigma <= speed_m_s {
            return None;
        }
        self.ready = false;
        Some(self.decision(step, 0.0, &format!("{speed:.3} +- {sigma:.3} m/s, above {speed_m_s} m/s")))
    }

    fn gap(&mut self, step: &BodyStep, near: &Near, gap_px: f64, gap_mm: f64) -> Option<Decision> {
        if near.gap > gap_px / AGAIN_SHARE + APPROACH_PX {
            self.ready = true;
        }
        if !self.ready || near.gap >= gap_px || !near.is_over_after(0.0) {
            return None;
        }
        self.ready = false;
        let found_mm = gap_mm * near.gap / gap_px;
        Some(self.decision(step, 0.0, &format!("gap of {found_mm:.3} mm, below {gap_mm} mm")))
    }

    fn contact(&mut self, step: &BodyStep, fit: &Fit, near: &Near, gravity: [f64; 2], lead: f64) -> Option<Decision> {
        let is_clear =
            near.rate.abs() > APPROACH_SIGMAS * fit.sigma_rate_px && near.rate.abs() * fit.frames as f64 > APPROACH_PX;
        if near.rate > 0.0 && is_clear {
            self.ready = true;
        }
        if !self.ready || near.rate > 0.0 || !is_clear {
            return None;
        }
        let (ahead, speed) = near.touch(gravity).filter(|(ahead, _)| *ahead >= -LATE_FRAMES)?;
        let sigma = fit.sigma_after(ahead) / speed;
        let is_sure = fit.frames >= PREDICTION_FRAMES && sigma <= SURE_OF_CONTACT_FRAMES && ahead <= lead;
        // What could not be told ahead is told when it is there.
        if !(is_sure || ahead <= 0.5) || !near.is_over_after(ahead) {
            return None;
        }
        self.ready = false;
        let at = step.frame as f64 + ahead;
        let when = if ahead > 0.0 { format!("{ahead:.1} frames ahead") } else { format!("{:.1} frames late", -ahead) };
        Some(self.decision(step, ahead, &format!("contact at frame {at:.1} +- {sigma:.1}, told {when}")))
    }
}
