//! Triggers on measured motion: a body enters, is fast, is near the surface, or is about to touch it.

use super::flight::{Fit, Flight, center_px};
use crate::motion::{Axes, MotionParams, RollingShutter, Scale, gravity_px};
use crate::results::BodyStep;

/// The number of consecutive frames without a body after which it is gone and may appear as a new one.
const GONE_FRAMES: u32 = 3;
/// The number of consecutive frames inside (or outside) the region that decide that a body is there.
const CONFIRMED_FRAMES: u32 = 3;
/// The maximum number of frames that a speed is fitted to.
const SPEED_FRAMES: usize = 8;
/// The maximum number of frames of flight that a contact is predicted from.
const FLIGHT_FRAMES: usize = 40;
/// The minimum number of frames that a speed or a gap rests on.
const MIN_FRAMES: usize = 4;
/// The minimum number of frames that a prediction rests on.
const MIN_PREDICTION_FRAMES: usize = 6;
/// The maximum standard uncertainty of the time of a predicted contact, frames.
const MAX_CONTACT_SIGMA_FRAMES: f64 = 0.5;
/// The maximum age of a contact that still counts, frames.
const MAX_LATE_FRAMES: f64 = 3.0;
/// The distance of a speed from its limit at which it is certainly above it, sigmas.
const LIMIT_SIGMAS: f64 = 3.0;
/// The minimum speed of an approach, sigmas ...
const MIN_APPROACH_SIGMAS: f64 = 5.0;
/// ... and its minimum distance during the fit, px.
const MIN_APPROACH_PX: f64 = 0.5;
/// The hysteresis: the share of its threshold that a speed must fall below before it can cross it again, and the
/// inverse share for a gap.
const REARM_SHARE: f64 = 0.9;

/// The condition that starts a shot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Condition {
    /// The body's centre enters this region (x, y, width, height in px), or becomes visible at all (`None`).
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
        /// The maximum time ahead.
        lead_s: f64,
    },
}

/// One body and the way it is watched.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyWatch {
    /// Its name in the results.
    pub name: String,
    /// The parameters of its motion.
    pub motion: MotionParams,
    /// Whether the body may start a shot.
    pub is_watched: bool,
    /// The distance of a rod's end below its lowest edge, px; needed for the gap and the contact of a rod.
    pub end_px: Option<f64>,
}

/// A condition that was met.
#[derive(Debug, Clone, PartialEq)]
pub struct Decision {
    /// The index of the body.
    pub body: u32,
    /// The frame it belongs to. For a predicted contact this is the frame that will show it.
    pub frame: u64,
    /// The stamp of that frame, ns since the Unix epoch; computed from the nominal rate for a frame to come.
    pub stamp_ns: u64,
    /// The newest frame that the decision rests on.
    pub newest_frame: u64,
    /// The stamp of that frame, ns since the Unix epoch.
    pub newest_stamp_ns: u64,
    /// The condition, in words.
    pub what: String,
}

/// A trigger on measured motion. It takes steps in frame order and returns decisions.
///
/// Every condition fires once. Before it can fire again, a body that entered must leave, one that was fast must slow
/// down, one that was near must move away, and one that touched must leave the surface or disappear.
#[derive(Debug, Clone)]
pub struct MeasuredTrigger {
    condition: Condition,
    edge: Option<Edge>,
    bodies: Vec<Body>,
}

/// One body and the state of its trigger.
#[derive(Debug, Clone)]
struct Body {
    watch: BodyWatch,
    flight: Flight,
    rolling: RollingShutter,
    /// The number of consecutive frames in which it was not visible.
    absent_frames: u32,
    /// Whether the body is inside the region, once that is confirmed.
    inside: Option<bool>,
    /// Whether the body is inside in the newest frame.
    newest_inside: bool,
    /// The number of consecutive frames in which it is so.
    newest_frames: u32,
    /// Whether the trigger may fire.
    is_ready: bool,
}

impl MeasuredTrigger {
    /// Creates a trigger for these bodies; `edge_px` are two points of the surface's edge, px, image axes.
    ///
    /// Without an edge, conditions on the gap and the contact never fire. Angle and calibration of the edge are those
    /// of the first body.
    pub fn new(condition: Condition, bodies: Vec<BodyWatch>, edge_px: Option<[[f64; 2]; 2]>) -> Self {
        let max_frames = if matches!(condition, Condition::Speed { .. }) { SPEED_FRAMES } else { FLIGHT_FRAMES };
        let angle_deg = bodies.first().map_or(0.0, |body| body.motion.surface_angle_deg);
        let rectifier = bodies.first().and_then(|body| body.motion.rectifier.clone());
        let rectified =
            |end: [f64; 2]| rectifier.as_ref().and_then(|rectifier| rectifier.rectify_point(end)).unwrap_or(end);
        let edge = edge_px.map(|ends| Edge::new(ends.map(rectified), angle_deg));
        // A body that is near the surface when it first appears has not approached it.
        let is_ready = !matches!(condition, Condition::Gap { .. });
        let body = |watch: BodyWatch| Body {
            flight: Flight::new(max_frames, watch.end_px),
            rolling: RollingShutter::new(watch.motion.shutter, watch.motion.form),
            watch,
            absent_frames: 0,
            inside: None,
            newest_inside: false,
            newest_frames: 0,
            is_ready,
        };
        let bodies = bodies.into_iter().map(body).collect();
        Self { condition, edge, bodies }
    }

    /// Takes the next step in frame order. Returns a decision if the body meets the condition in it.
    ///
    /// Steps of unknown and unwatched bodies are ignored. If several intervals are measured, only the steps of the
    /// shortest count.
    pub fn push(&mut self, step: &BodyStep) -> Option<Decision> {
        let (condition, edge) = (self.condition, self.edge);
        let body = self.bodies.get_mut(step.body as usize)?;
        if !body.watch.is_watched || step.interval_frames != body.watch.motion.interval_frames {
            return None;
        }
        if let Condition::Enter { roi_px } = condition {
            return body.check_enter(step, roi_px);
        }
        body.rolling.push(step);
        let step = &body.watch.motion.rectified(&body.rolling.as_global_shutter(step));
        let scale = body.metres_per_px(step);
        let gravity = scale.map_or([0.0; 2], |scale| gravity_px(&body.watch.motion, scale));
        if !body.flight.add_step(step, gravity) {
            body.absent_frames += 1;
            if body.absent_frames == GONE_FRAMES {
                body.flight.reset();
                body.is_ready = !matches!(condition, Condition::Gap { .. });
            }
            return None;
        }
        body.absent_frames = 0;
        let fit =
            body.flight.fit(gravity).filter(|fit| fit.frames >= MIN_FRAMES && !body.flight.ends_with_outlier())?;
        match condition {
            Condition::Enter { .. } => None,
            Condition::Speed { speed_m_s } => body.check_speed(step, &fit, scale?, speed_m_s),
            Condition::Gap { gap_mm } => {
                body.check_gap(step, &Approach::new(&fit, edge?), 1e-3 * gap_mm / scale?, gap_mm)
            }
            Condition::Contact { lead_s } => {
                let lead_frames = lead_s * 1e9 / body.watch.motion.frame_period_ns;
                body.check_contact(step, &fit, &Approach::new(&fit, edge?), gravity, lead_frames)
            }
        }
    }
}

/// The surface's edge, image axes, px.
#[derive(Debug, Clone, Copy)]
struct Edge {
    /// Two points of the edge.
    ends: [[f64; 2]; 2],
    /// The unit vector across the edge, to the side that the surface's normal points to.
    normal: [f64; 2],
}

impl Edge {
    /// Creates the edge between two points, px; `angle_deg` is the configured angle of the surface, whose normal
    /// decides the side.
    fn new(ends: [[f64; 2]; 2], angle_deg: f64) -> Self {
        let along = [ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]];
        let length = along[0].hypot(along[1]);
        let across = [-along[1] / length, along[0] / length];
        let side = Axes::new(angle_deg).surface(across[0], across[1]).normal;
        Self { ends, normal: if side < 0.0 { across.map(|x| -x) } else { across } }
    }
}

/// The position of a body relative to the surface's edge; px, frames.
struct Approach {
    /// The distance from the surface to the body's rim, px.
    gap_px: f64,
    /// Its rate, px/frame; negative during an approach.
    gap_rate_px: f64,
    /// The normal of the edge, towards the side of the body.
    normal: [f64; 2],
    /// The position along the edge from its first end, as a share of its length.
    along: f64,
    /// Its rate, per frame.
    along_rate: f64,
}

impl Approach {
    /// Computes the position and the velocity of a fitted flight relative to the edge.
    fn new(fit: &Fit, Edge { ends, normal }: Edge) -> Self {
        let dot = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
        let edge = [ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]];
        let from_end = [fit.at_px[0] - ends[0][0], fit.at_px[1] - ends[0][1]];
        let squared_length = dot(edge, edge);
        Self {
            gap_px: dot(from_end, normal) - fit.radius_px,
            gap_rate_px: dot(fit.rate_px, normal),
            normal,
            along: dot(from_end, edge) / squared_length,
            along_rate: dot(fit.rate_px, edge) / squared_length,
        }
    }

    /// Whether the centre lies between the ends of the edge, measured along it, this many frames later.
    fn is_over_after(&self, frames: f64) -> bool {
        (0.0..=1.0).contains(&(self.along + frames * self.along_rate))
    }

    /// Predicts the contact: the number of frames until it (negative for the past), and the normal speed then,
    /// px/frame. `None` when there will be none.
    ///
    /// `gravity_px` is the acceleration of gravity, px/frame², image axes. With its component g along the normal, the
    /// contact is the first root of
    ///
    /// ```text
    /// gap + rate t + g t² / 2 = 0, t = 2 gap / (sqrt(rate² - 2 g gap) - rate)
    /// ```
    ///
    /// which also holds for g = 0. A body that has reached the edge is traced back at its present rate, without gravity.
    fn predict_contact(&self, gravity_px: [f64; 2]) -> Option<(f64, f64)> {
        let (gap, rate) = (self.gap_px, self.gap_rate_px);
        let normal_gravity = self.normal[0] * gravity_px[0] + self.normal[1] * gravity_px[1];
        if gap <= 0.0 {
            return (rate < 0.0).then(|| (gap / -rate, -rate));
        }
        let discriminant = rate * rate - 2.0 * normal_gravity * gap;
        if discriminant < 0.0 {
            return None;
        }
        let frames = 2.0 * gap / (discriminant.sqrt() - rate);
        let speed = -(rate + normal_gravity * frames);
        (frames.is_finite() && frames >= 0.0 && speed > 0.0).then_some((frames, speed))
    }
}

impl Body {
    /// Returns the scale, m/px: as configured, or from the radius if the ball's diameter is configured.
    ///
    /// The radius is that of this step, or the last one that was measured. `None` if the scale, or every radius, is
    /// unknown.
    fn metres_per_px(&self, step: &BodyStep) -> Option<f64> {
        match self.watch.motion.scale {
            Scale::MmPerPx(mm) => Some(1e-3 * mm),
            Scale::BallDiameterMm(mm) => {
                let radius_px = step.circle().map(|circle| circle.radius_px).or_else(|| self.flight.radius_px())?;
                (radius_px > 0.0).then(|| 0.5e-3 * mm / radius_px)
            }
            Scale::Unknown => None,
        }
    }

    /// Returns the decision for the frame that is `ahead_frames`, rounded, after this step, or before it if negative.
    ///
    /// The stamp of that frame is computed from the nominal rate. `what` is the condition in words, without the body's
    /// name.
    fn decision(&self, step: &BodyStep, ahead_frames: f64, what: &str) -> Decision {
        let whole_frames = ahead_frames.round();
        let period_ns = self.watch.motion.frame_period_ns;
        let shifted =
            |from: u64, by: f64| (i128::from(from) + by.round() as i128).clamp(0, i128::from(u64::MAX)) as u64;
        Decision {
            body: step.body,
            frame: shifted(step.frame, whole_frames),
            stamp_ns: shifted(step.stamp_ns, whole_frames * period_ns),
            newest_frame: step.frame,
            newest_stamp_ns: step.stamp_ns,
            what: format!("{}: {what}", self.watch.name),
        }
    }

    /// Returns the decision that the body entered the region, or became visible if that is `None`, after
    /// [`CONFIRMED_FRAMES`] frames inside; else `None`.
    ///
    /// The decision belongs to the first of these frames. A body must have been outside for as many frames before.
    fn check_enter(&mut self, step: &BodyStep, roi_px: Option<[u32; 4]>) -> Option<Decision> {
        let is_in = |at_px: [f64; 2]| {
            roi_px.is_none_or(|[x, y, width, height]| {
                let within =
                    |at: f64, start: u32, size: u32| at >= f64::from(start) && at < f64::from(start) + f64::from(size);
                within(at_px[0], x, width) && within(at_px[1], y, height)
            })
        };
        let inside = center_px(step).is_some_and(is_in);
        let previous = std::mem::replace(&mut self.newest_inside, inside);
        self.newest_frames = if previous == inside { self.newest_frames.saturating_add(1) } else { 1 };
        if self.newest_frames < CONFIRMED_FRAMES {
            return None;
        }
        // A body that is inside from the start has not entered.
        let entered = self.inside.replace(inside) == Some(false) && inside;
        entered.then(|| self.decision(step, -f64::from(CONFIRMED_FRAMES - 1), "entered"))
    }

    /// Returns the decision that the speed is above the limit `speed_m_s`, by more than [`LIMIT_SIGMAS`]; else `None`.
    ///
    /// It comes once, until the speed has fallen below [`REARM_SHARE`] of the limit.
    fn check_speed(&mut self, step: &BodyStep, fit: &Fit, metres_per_px: f64, speed_m_s: f64) -> Option<Decision> {
        let per_frame = metres_per_px * 1e9 / self.watch.motion.frame_period_ns / self.rolling.image_interval_periods();
        let speed = fit.rate_px[0].hypot(fit.rate_px[1]) * per_frame;
        let sigma = fit.sigma_rate_px * per_frame;
        if speed < REARM_SHARE * speed_m_s {
            self.is_ready = true;
        }
        if !self.is_ready || speed - LIMIT_SIGMAS * sigma <= speed_m_s {
            return None;
        }
        self.is_ready = false;
        Some(self.decision(step, 0.0, &format!("{speed:.3} +- {sigma:.3} m/s, above {speed_m_s} m/s")))
    }

    /// Returns the decision that the gap is below the limit, given both in px and in mm, and the body is above the
    /// edge; else `None`.
    ///
    /// It comes once, until the gap has clearly exceeded the limit again.
    fn check_gap(&mut self, step: &BodyStep, approach: &Approach, limit_px: f64, gap_mm: f64) -> Option<Decision> {
        if approach.gap_px > limit_px / REARM_SHARE + MIN_APPROACH_PX {
            self.is_ready = true;
        }
        if !self.is_ready || approach.gap_px >= limit_px || !approach.is_over_after(0.0) {
            return None;
        }
        self.is_ready = false;
        let found_mm = gap_mm * approach.gap_px / limit_px;
        Some(self.decision(step, 0.0, &format!("gap of {found_mm:.3} mm, below {gap_mm} mm")))
    }

    /// Returns the decision that the contact comes within `lead_frames`, or that it has happened; else `None`.
    ///
    /// `gravity_px` is in px/frame², image axes. A contact to come must be certain to [`MAX_CONTACT_SIGMA_FRAMES`]. One
    /// that is at most half a frame ahead counts in any case. The decision comes once, until the body has moved away
    /// from the surface.
    fn check_contact(
        &mut self,
        step: &BodyStep,
        fit: &Fit,
        approach: &Approach,
        gravity_px: [f64; 2],
        lead_frames: f64,
    ) -> Option<Decision> {
        let rate = approach.gap_rate_px;
        let is_significant =
            rate.abs() > MIN_APPROACH_SIGMAS * fit.sigma_rate_px && rate.abs() * fit.frames as f64 > MIN_APPROACH_PX;
        if rate > 0.0 && is_significant {
            self.is_ready = true;
        }
        if !self.is_ready || rate > 0.0 || !is_significant {
            return None;
        }
        let contact = approach.predict_contact(gravity_px);
        let (ahead, speed) = contact.filter(|(ahead, _)| *ahead >= -MAX_LATE_FRAMES)?;
        let sigma = fit.sigma_after(ahead) / speed;
        let is_certain =
            fit.frames >= MIN_PREDICTION_FRAMES && sigma <= MAX_CONTACT_SIGMA_FRAMES && ahead <= lead_frames;
        // A contact that could not be predicted is reported when it happens.
        if !(is_certain || ahead <= 0.5) || !approach.is_over_after(ahead) {
            return None;
        }
        self.is_ready = false;
        let at = step.frame as f64 + ahead;
        let when = if ahead > 0.0 {
            format!("predicted {ahead:.1} frames ahead")
        } else {
            format!("detected {:.1} frames late", -ahead)
        };
        Some(self.decision(step, ahead, &format!("contact at frame {at:.1} +- {sigma:.1}, {when}")))
    }
}
