//! `[scale]`, `[surface]`, `[rotation]`, `[velocity]`: from pixels to physics.

use super::body::DIAMETER;
use super::check::{Bounds, Table};
use super::error::ConfigError;
use super::raw::{RawRotation, RawScale, RawSurface, RawVelocity};
use crate::motion::Scale;

/// `[surface]`: what the bodies strike.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// Direction of its tangent in the picture, counter-clockwise from x, -180 to 180 deg, default 0 (level, and the
    /// body above it). The outward normal is a quarter turn further counter-clockwise.
    pub angle_deg: f64,
    /// Two points of its edge in the picture, px (y down), each coordinate -65536 to 65536; must run along
    /// `angle_deg`, in either direction, to within 10 deg. Left out: where the surface is follows from the motion.
    pub edge_px: Option<[[f64; 2]; 2]>,
}

/// How the spin is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RotationMethod {
    /// Least squares over every valid vector of the displacement field.
    Field,
    /// Correlation of a ring around the ball's centre.
    Ring,
    /// Correlation of the whole visible disc.
    Rigid,
}

/// `[rotation]`: how the spin is found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rotation {
    /// Default `field`.
    pub method: RotationMethod,
    /// Inner radius of the ring, 0 to 32768 px, less than `ring_outer_px`; for method `ring`.
    pub ring_inner_px: Option<f64>,
    /// Outer radius of the ring, above 0 and at most 32768 px; for method `ring`.
    pub ring_outer_px: Option<f64>,
}

/// `[velocity]`: how positions become velocities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Velocity {
    /// Frames the local fit spans, odd, 3 to 1001 frames and more than `order`; left out, the fit chooses.
    pub window_frames: Option<u32>,
    /// Order of the polynomial fitted to the positions, 1 to 4, default 2.
    pub order: u32,
    /// Strength of gravity, 0 to 100 m/s^2, default 9.80665; 0 switches it off.
    pub gravity_m_s2: f64,
    /// Direction in which things fall, counter-clockwise from x with y up, -180 to 180 deg, default -90 (a level
    /// camera). A camera tilted by t counter-clockwise sees things fall at -90 - t.
    pub gravity_angle_deg: f64,
}

/// Edge and angle of a surface may differ by this much, deg.
const EDGE_TOLERANCE_DEG: f64 = 10.0;
const MM_PER_PX: Bounds = Bounds::closed(1.0e-6, 1.0e3, "mm/px");
const ANGLE: Bounds = Bounds::closed(-180.0, 180.0, "deg");
const ORDER_DEFAULT: u32 = 2;

pub(super) fn scale(table: &Table<'_>, raw: &RawScale) -> Result<Option<Scale>, ConfigError> {
    let mm_per_px = table.number("mm_per_px", raw.mm_per_px, MM_PER_PX)?;
    let diameter_mm = table.number("ball_diameter_mm", raw.ball_diameter_mm, DIAMETER)?;
    match (mm_per_px, diameter_mm) {
        (Some(_), Some(_)) => Err(table.refuse("ball_diameter_mm", "left out, because mm_per_px is given too")),
        (Some(mm_per_px), None) => Ok(Some(Scale::MmPerPx(mm_per_px))),
        (None, diameter_mm) => Ok(diameter_mm.map(Scale::BallDiameterMm)),
    }
}

pub(super) fn surface(table: &Table<'_>, raw: &RawSurface) -> Result<Surface, ConfigError> {
    let angle_deg = table.number("angle_deg", raw.angle_deg, ANGLE)?.unwrap_or(0.0);
    let Some(points) = &raw.edge else { return Ok(Surface { angle_deg, edge_px: None }) };
    let refusal = || table.refuse("edge", "two different points [[x, y], [x, y]], each number -65536 to 65536 px");
    let [from, to]: [Vec<f64>; 2] = points.clone().try_into().map_err(|_| refusal())?;
    let from: [f64; 2] = from.try_into().map_err(|_| refusal())?;
    let to: [f64; 2] = to.try_into().map_err(|_| refusal())?;
    let outside = |value: &f64| !(-65_536.0..=65_536.0).contains(value);
    let (along_px, up_px) = (to[0] - from[0], from[1] - to[1]);
    if from.iter().chain(&to).any(outside) || along_px.hypot(up_px) < 1.0e-6 {
        return Err(refusal());
    }
    let off_deg = (up_px.atan2(along_px).to_degrees() - angle_deg).rem_euclid(180.0);
    if off_deg.min(180.0 - off_deg) > EDGE_TOLERANCE_DEG {
        return Err(table.refuse("edge", format!("within {EDGE_TOLERANCE_DEG} deg of angle_deg = {angle_deg} deg")));
    }
    Ok(Surface { angle_deg, edge_px: Some([from, to]) })
}

pub(super) fn rotation(table: &Table<'_>, raw: &RawRotation) -> Result<Rotation, ConfigError> {
    let words = [("field", RotationMethod::Field), ("ring", RotationMethod::Ring), ("rigid", RotationMethod::Rigid)];
    let rotation = Rotation {
        method: table.word("method", raw.method.as_deref(), &words)?.unwrap_or(RotationMethod::Field),
        ring_inner_px: table.number("ring_inner_px", raw.ring_inner_px, Bounds::closed(0.0, 32_768.0, "px"))?,
        ring_outer_px: table.number("ring_outer_px", raw.ring_outer_px, Bounds::above(0.0, 32_768.0, "px"))?,
    };
    match rotation.ring_inner_px.zip(rotation.ring_outer_px) {
        Some((inner_px, outer_px)) if inner_px >= outer_px => {
            Err(table.refuse("ring_inner_px", format!("less than ring_outer_px = {outer_px} px")))
        }
        _ => Ok(rotation),
    }
}

pub(super) fn velocity(table: &Table<'_>, raw: &RawVelocity) -> Result<Velocity, ConfigError> {
    let gravity = Bounds::closed(0.0, 100.0, "m/s^2");
    let velocity = Velocity {
        window_frames: table.whole("window_frames", raw.window_frames, 3..=1001, "frames, odd")?,
        order: table.whole("order", raw.order, 1..=4, "")?.unwrap_or(ORDER_DEFAULT),
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
