//! The position of the ball in the image at any time.

use super::orientation::Orientation;
use super::physics::{Collision, CollisionSetup};
use super::scenario::{ImpactSetup, MotionSetup, PartSetup, RingingSetup, Scenario, ScenarioError};

/// The pose of a ball at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pose {
    /// The centre, px (y down).
    pub(crate) center_px: [f64; 2],
    /// The rotation, counter-clockwise on the screen, rad.
    pub(crate) angle_rad: f64,
    /// The orientation in space, for a sphere; equal to `angle_rad` if the rotation is in the image plane.
    pub(crate) orientation: Orientation,
    /// The velocity (x right, y up), m/s.
    pub(crate) velocity_m_s: [f64; 2],
    /// The spin, counter-clockwise, rad/s.
    pub(crate) omega_rad_s: f64,
}

/// The trajectory of the ball.
#[derive(Debug, Clone)]
pub(crate) enum Trajectory {
    /// Constant velocity and spin.
    Uniform { start_px: [f64; 2], start_s: f64, px_s: [f64; 2], rad_s: f64, m_per_px: f64 },
    /// Segments of constant velocity and spin, each starting where the previous one ends.
    Piecewise { segments: Vec<Segment>, m_per_px: f64 },
    /// One collision.
    Impact {
        collision: Box<Collision>,
        start_s: f64,
        center_px: [f64; 2],
        /// The unit vector along the surface, x right and y up.
        tangent: [f64; 2],
        ringing: Option<RingingSetup>,
        m_per_px: f64,
    },
}

/// A segment of constant velocity and spin.
#[derive(Debug, Clone)]
pub(crate) struct Segment {
    start_s: f64,
    center_px: [f64; 2],
    angle_rad: f64,
    orientation: Orientation,
    px_s: [f64; 2],
    /// About x, y (up) and z (towards the camera).
    rad_s: [f64; 3],
}

impl Segment {
    /// Returns the pose at a time after the first stamp, s.
    fn pose_at(&self, time_s: f64, m_per_px: f64) -> Pose {
        let since_s = time_s - self.start_s;
        let turned = Orientation::from_rotation_vector(self.rad_s.map(|rad_s| rad_s * since_s));
        Pose {
            center_px: [self.center_px[0] + self.px_s[0] * since_s, self.center_px[1] + self.px_s[1] * since_s],
            angle_rad: self.angle_rad + self.rad_s[2] * since_s,
            orientation: turned.after(&self.orientation),
            velocity_m_s: [self.px_s[0] * m_per_px, -self.px_s[1] * m_per_px],
            omega_rad_s: self.rad_s[2],
        }
    }
}

/// Returns the segment at a time after the first stamp, s.
///
/// The first one extends backwards, because the shutter opens half an exposure earlier.
fn segment_at(segments: &[Segment], time_s: f64) -> &Segment {
    let count = segments.partition_point(|segment| segment.start_s <= time_s);
    &segments[count.max(1) - 1]
}

/// Places each segment at the end of the previous one, from `start_px` at `start_s` after the first stamp.
fn chain_segments(start_px: [f64; 2], start_s: f64, rate_hz: f64, parts: &[PartSetup]) -> Vec<Segment> {
    let mut segments: Vec<Segment> = Vec::new();
    let mut next = Segment {
        start_s,
        center_px: start_px,
        angle_rad: 0.0,
        orientation: Orientation::in_plane(0.0),
        px_s: [0.0; 2],
        rad_s: [0.0; 3],
    };
    for part in parts {
        let [about_x, about_y] = part.tilt_deg_frame;
        let segment = Segment {
            px_s: [part.vx_px_frame * rate_hz, part.vy_px_frame * rate_hz],
            rad_s: [about_x, about_y, part.omega_deg_frame].map(|deg| deg.to_radians() * rate_hz),
            ..next
        };
        let end_s = segment.start_s + part.frames / rate_hz;
        let Pose { center_px, angle_rad, orientation, .. } = segment.pose_at(end_s, 1.0);
        next = Segment { start_s: end_s, center_px, angle_rad, orientation, ..segment };
        segments.push(segment);
    }
    segments
}

impl Trajectory {
    /// Solves the motion of a scenario.
    ///
    /// # Errors
    ///
    /// Returns [`ScenarioError`] if the ball does not bounce, or touches the surface again during the film.
    pub(crate) fn new(scenario: &Scenario) -> Result<Self, ScenarioError> {
        let m_per_px = scenario.scale.mm_per_px * 1e-3;
        let rate_hz = scenario.camera.frame_rate_hz;
        match &scenario.motion {
            MotionSetup::Constant { vx_px_frame, vy_px_frame, omega_deg_frame, start_px } => Ok(Self::Uniform {
                start_px: *start_px,
                // The start is the position in the first image, i.e. in the middle of its exposure.
                start_s: 0.5e-6 * scenario.camera.exposure_us,
                px_s: [vx_px_frame * rate_hz, vy_px_frame * rate_hz],
                rad_s: omega_deg_frame.to_radians() * rate_hz,
                m_per_px,
            }),
            MotionSetup::Piecewise { start_px, parts } => Ok(Self::Piecewise {
                segments: chain_segments(*start_px, 0.5e-6 * scenario.camera.exposure_us, rate_hz, parts),
                m_per_px,
            }),
            MotionSetup::Impact(impact) => {
                let tangent = surface_tangent(scenario);
                let collision = Collision::solve(collision_setup(scenario, impact, tangent))?;
                let film_s = scenario.camera.frames as f64 / rate_hz;
                let again_s = collision.second_contact_s().map(|after_s| impact.contact_start_s + after_s);
                if let Some(again_s) = again_s.filter(|again_s| *again_s < film_s) {
                    return Err(ScenarioError::TouchesAgain { frames: scenario.camera.frames, film_s, again_s });
                }
                Ok(Self::Impact {
                    collision: Box::new(collision),
                    start_s: impact.contact_start_s,
                    center_px: impact.contact_center_px,
                    tangent,
                    ringing: impact.ringing.clone(),
                    m_per_px,
                })
            }
        }
    }

    /// Returns the rate of rotation about axes in the image plane, rad/s, at `time_s` after the first stamp.
    pub(crate) fn tilt_rad_s(&self, time_s: f64) -> f64 {
        match self {
            Self::Piecewise { segments, .. } => {
                let [about_x, about_y, _] = segment_at(segments, time_s).rad_s;
                about_x.hypot(about_y)
            }
            Self::Uniform { .. } | Self::Impact { .. } => 0.0,
        }
    }

    /// Returns the pose at `time_s` after the first frame's stamp.
    pub(crate) fn pose_at(&self, time_s: f64) -> Pose {
        match self {
            Self::Uniform { start_px, start_s, px_s, rad_s, m_per_px } => {
                let since_s = time_s - start_s;
                Pose {
                    center_px: [start_px[0] + px_s[0] * since_s, start_px[1] + px_s[1] * since_s],
                    angle_rad: rad_s * since_s,
                    orientation: Orientation::in_plane(rad_s * since_s),
                    velocity_m_s: [px_s[0] * m_per_px, -px_s[1] * m_per_px],
                    omega_rad_s: *rad_s,
                }
            }
            Self::Piecewise { segments, m_per_px } => segment_at(segments, time_s).pose_at(time_s, *m_per_px),
            Self::Impact { collision, start_s, center_px, tangent, ringing, m_per_px } => {
                let mut motion = collision.motion_at(time_s - start_s);
                if let Some(ringing) = ringing {
                    let (shift_m, speed_m_s) = ringing_motion(ringing, time_s - start_s);
                    motion.position_m[1] += shift_m;
                    motion.velocity_m_s[1] += speed_m_s;
                }
                let shift_m = from_surface(motion.position_m, *tangent);
                Pose {
                    center_px: [center_px[0] + shift_m[0] / m_per_px, center_px[1] - shift_m[1] / m_per_px],
                    angle_rad: motion.angle_rad,
                    orientation: Orientation::in_plane(motion.angle_rad),
                    velocity_m_s: from_surface(motion.velocity_m_s, *tangent),
                    omega_rad_s: motion.omega_rad_s,
                }
            }
        }
    }
}

/// Returns displacement (m) and velocity (m/s) of a ringing mark, along the surface normal, at `time_s` after first
/// contact; 0 before it.
///
/// The velocity is a decaying sine, v exp(-t / tau) sin(2 pi f t), and the displacement its integral.
fn ringing_motion(ringing: &RingingSetup, time_s: f64) -> (f64, f64) {
    if time_s <= 0.0 {
        return (0.0, 0.0);
    }
    let (decay, angular) = (1.0 / ringing.decay_s, std::f64::consts::TAU * ringing.frequency_hz);
    let (sin, cos) = (angular * time_s).sin_cos();
    let amplitude = ringing.speed_m_s * (-decay * time_s).exp();
    let shift =
        (ringing.speed_m_s * angular - amplitude * (decay * sin + angular * cos)) / (decay * decay + angular * angular);
    (shift, amplitude * sin)
}

/// Returns the unit tangent of the surface, x right and y up.
pub(crate) fn surface_tangent(scenario: &Scenario) -> [f64; 2] {
    let (sin, cos) = scenario.surface.angle_deg.to_radians().sin_cos();
    [cos, sin]
}

/// Converts a vector from surface axes (tangent, normal) to x right and y up.
fn from_surface(value: [f64; 2], tangent: [f64; 2]) -> [f64; 2] {
    let [t, n] = value;
    [t * tangent[0] - n * tangent[1], t * tangent[1] + n * tangent[0]]
}

/// Converts a vector from x right and y up to surface axes (tangent, normal).
pub(crate) fn into_surface(value: [f64; 2], tangent: [f64; 2]) -> [f64; 2] {
    let [x, y] = value;
    [x * tangent[0] + y * tangent[1], y * tangent[0] - x * tangent[1]]
}

/// Returns the collision in surface axes (tangent, normal). `tangent` is that of the surface, x right and y up.
fn collision_setup(scenario: &Scenario, impact: &ImpactSetup, tangent: [f64; 2]) -> CollisionSetup {
    CollisionSetup {
        mass_kg: impact.mass_kg,
        radius_m: 0.5e-3 * scenario.body.diameter_mm,
        inertia_factor: impact.inertia_factor,
        law: impact.law,
        friction: impact.friction,
        velocity_m_s: [impact.vt_m_s, impact.vn_m_s],
        omega_rad_s: impact.omega_rad_s,
        gravity_m_s2: into_surface(impact.gravity_m_s2, tangent),
    }
}
