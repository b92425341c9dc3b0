//! `[scale]`, `[surface]`, `[rotation]`, `[velocity]`: from pixels to physical quantities.

use super::body::{Body, DIAMETER};
use super::check::{Bounds, Table};
use super::error::ConfigError;
use super::raw::{RawRotation, RawScale, RawSurface, RawVelocity};
use super::text::Text;
use crate::motion::{DEFAULT_LAG_FRAMES, Rectifier, RingLimits, Rotation, Scale};

/// `[surface]`: the surface that bodies strike.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// The direction of its tangent in the image, counter-clockwise from x, -180 to 180 deg. The outward normal is a quarter
    /// turn further counter-clockwise. Default: the direction of `edge` from its first point to its second, else 0
    /// (level, with the body above).
    pub angle_deg: f64,
    /// Two points of the edge that bodies touch, `[[x, y], [x, y]]` in px, -65535 to 65535, at least 1 px apart, within
    /// 2 deg of `angle_deg`. Triggers on the gap or a predicted contact need it. A contact counts only between the points.
    pub edge: Option<[[f64; 2]; 2]>,
    /// The index of the body that is the surface, from its name in `body`; `None` for a fixed surface.
    pub body: Option<u32>,
}

/// `[velocity]`: the fit of velocities to positions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Velocity {
    /// The number of frames of the local fit, odd, 3 to 1001 frames and more than `order`. Default: chosen by the fit.
    pub window_frames: Option<u32>,
    /// The number of later frames that a velocity waits for and is fitted to, 0 to 2. Default: 20, or half of
    /// `window_frames` if that is more.
    pub lag_frames: u32,
    /// The order of the polynomial fitted to the positions, 1 to 4, default 2.
    pub order: u32,
    /// The acceleration of gravity, 0 to 100 m/s^2, default 9.80665; 0 switches it off.
    pub gravity_m_s2: f64,
    /// The direction of gravity, counter-clockwise from x with y up, -180 to 180 deg, default -90 (a level camera). For a
    /// camera tilted by t counter-clockwise it is -90 - t.
    pub gravity_angle_deg: f64,
}

const MM_PER_PX: Bounds = Bounds::closed(1.0e-6, 1.0e3, "mm/px");
const ANGLE: Bounds = Bounds::closed(-180.0, 180.0, "deg");
/// The maximum angle between the edge and a given `angle_deg`, deg.
const EDGE_ANGLE_MAX_DEG: f64 = 2.0;
const RING: Bounds = Bounds::closed(1.0, 32_768.0, "px");
/// The minimum width of a ring, px.
const MIN_RING_PX: f64 = 4.0;
const ORDER_DEFAULT: u32 = 2;
/// The default lag of velocities without a window of that length, frames.
const LAG_DEFAULT: u32 = DEFAULT_LAG_FRAMES as u32;

/// Checks the scale. A calibrated plane has its own, so a second one is refused.
pub(super) fn check_scale(
    table: &Table<'_>,
    raw: &RawScale,
    calibration: Option<&Rectifier>,
) -> Result<Option<Scale>, ConfigError> {
    let mm_per_px = table.number("mm_per_px", raw.mm_per_px, MM_PER_PX)?;
    let diameter_mm = table.number("ball_diameter_mm", raw.ball_diameter_mm, DIAMETER)?;
    if let Some(plane) = calibration.and_then(Rectifier::mm_per_px) {
        let given = [("mm_per_px", mm_per_px), ("ball_diameter_mm", diameter_mm)];
        return match given.iter().find(|(_, given)| given.is_some()) {
            Some((key, _)) => Err(table.refuse(key, "left out, because calibration.homography_mm gives the scale")),
            None => Ok(Some(Scale::MmPerPx(plane))),
        };
    }
    match (mm_per_px, diameter_mm) {
        (Some(_), Some(_)) => Err(table.refuse("ball_diameter_mm", "left out, because mm_per_px is given")),
        (Some(mm_per_px), None) => Ok(Some(Scale::MmPerPx(mm_per_px))),
        (None, diameter_mm) => Ok(diameter_mm.map(Scale::BallDiameterMm)),
    }
}

/// Checks the surface, and that its edge agrees with its angle. Without an angle it has that of the edge. A surface that is
/// a body needs another one that strikes it.
pub(super) fn check_surface(table: &Table<'_>, raw: &RawSurface, bodies: &[Body]) -> Result<Surface, ConfigError> {
    let angle_deg = table.number("angle_deg", raw.angle_deg, ANGLE)?;
    let named = |name: &String| bodies.iter().position(|body| body.name == *name).filter(|_| bodies.len() > 1);
    let body = match raw.body.as_ref().map(named) {
        Some(None) => return Err(table.refuse("body", "the name of a [[body]] that others strike")),
        found => found.flatten().and_then(|index| u32::try_from(index).ok()),
    };
    let Some(edge) = &raw.edge else { return Ok(Surface { angle_deg: angle_deg.unwrap_or(0.0), edge: None, body }) };
    let refusal = || table.refuse("edge", "two points [[x, y], [x, y]] in px, -65535 to 65535, at least 1 px apart");
    let point = |point: &Vec<f64>| <[f64; 2]>::try_from(point.as_slice()).map_err(|_| refusal());
    let points = edge.iter().map(point).collect::<Result<Vec<_>, _>>()?;
    let [first, second] = <[[f64; 2]; 2]>::try_from(points).map_err(|_| refusal())?;
    let along = [second[0] - first[0], second[1] - first[1]];
    let is_within = first.iter().chain(&second).all(|x| x.abs() <= 65_535.0);
    if !is_within || along[0].hypot(along[1]) < 1.0 {
        return Err(refusal());
    }
    // The image's y points down.
    let edge_deg = (-along[1]).atan2(along[0]).to_degrees();
    let apart_deg = |angle_deg: f64| (angle_deg - edge_deg + 90.0).rem_euclid(180.0) - 90.0;
    match angle_deg {
        Some(angle_deg) if apart_deg(angle_deg).abs() > EDGE_ANGLE_MAX_DEG => {
            let allowed = format!(
                "within {EDGE_ANGLE_MAX_DEG} deg of surface.angle_deg = {angle_deg}, but is at {edge_deg:.1} deg"
            );
            Err(table.refuse("edge", allowed))
        }
        angle_deg => Ok(Surface { angle_deg: angle_deg.unwrap_or(edge_deg), edge: Some([first, second]), body }),
    }
}

/// Refuses an edge outside the range of the calibration.
pub(super) fn check_edge(
    file: &Text<'_>,
    surface: &Surface,
    calibration: Option<&Rectifier>,
) -> Result<(), ConfigError> {
    let (Some(edge), Some(calibration)) = (surface.edge, calibration) else { return Ok(()) };
    if edge.iter().all(|end| calibration.rectify_point(*end).is_some()) {
        return Ok(());
    }
    Err(file.refuse("surface.edge", "two points within the range of the calibration"))
}

/// Checks the method for motion and spin, and that the limits of a ring, px, are given for a ring only and far enough
/// apart.
pub(super) fn check_rotation(table: &Table<'_>, raw: &RawRotation) -> Result<Rotation, ConfigError> {
    let ring = RingLimits {
        inner_px: table.number("ring_inner_px", raw.ring_inner_px, RING)?,
        outer_px: table.number("ring_outer_px", raw.ring_outer_px, RING)?,
    };
    let words = [
        ("rigid", Rotation::Rigid),
        ("field", Rotation::Field),
        ("center", Rotation::Center),
        ("ring", Rotation::Ring(ring)),
    ];
    let method = table.choice("method", raw.method.as_deref(), &words)?.unwrap_or_default();
    let given = [("ring_inner_px", ring.inner_px), ("ring_outer_px", ring.outer_px)];
    let is_ring = matches!(method, Rotation::Ring(_));
    if !is_ring && let Some((key, _)) = given.iter().find(|(_, px)| px.is_some()) {
        let chosen = words.iter().find(|(_, other)| *other == method).map_or("", |(word, _)| word);
        return Err(table.foreign_key_error(key, format!("method = {chosen:?}"), "method = \"ring\""));
    }
    match ring.inner_px.zip(ring.outer_px) {
        Some((inner_px, outer_px)) if outer_px - inner_px < MIN_RING_PX => {
            Err(table
                .refuse("ring_outer_px", format!("at least {MIN_RING_PX} px more than ring_inner_px = {inner_px}")))
        }
        _ => Ok(method),
    }
}

/// Checks the fit of velocities. The window has more frames than the order of the polynomial.
pub(super) fn check_velocity(table: &Table<'_>, raw: &RawVelocity) -> Result<Velocity, ConfigError> {
    let gravity = Bounds::closed(0.0, 100.0, "m/s^2");
    let window_frames: Option<u32> = table.integer("window_frames", raw.window_frames, 3..=1001, "frames, odd")?;
    let lag_frames = table.integer("lag_frames", raw.lag_frames, 0..=2, "frames")?;
    let velocity = Velocity {
        window_frames,
        lag_frames: lag_frames.unwrap_or((window_frames.unwrap_or(0) / 2).max(LAG_DEFAULT)),
        order: table.integer("order", raw.order, 1..=4, "")?.unwrap_or(ORDER_DEFAULT),
        gravity_m_s2: table.number("gravity_m_s2", raw.gravity_m_s2, gravity)?.unwrap_or(9.806_65),
        gravity_angle_deg: table.number("gravity_angle_deg", raw.gravity_angle_deg, ANGLE)?.unwrap_or(-90.0),
    };
    match velocity.window_frames {
        Some(frames) if frames % 2 == 0 => Err(table.refuse("window_frames", "odd, 3 to 1001 frames")),
        Some(frames) if frames <= velocity.order => {
            Err(table.refuse("window_frames", format!("more than order = {}", velocity.order)))
        }
        _ => Ok(velocity),
    }
}
