//! What is filmed, and with which camera.

mod check;
mod error;

pub use error::ScenarioError;

use super::physics::{Friction, NormalLaw};
use serde::{Deserialize, Serialize};

/// A simulated film. Every number is checked by [`Scenario::check`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Its name.
    pub name: String,
    /// Seed of everything random: speckles, textures, noise.
    #[serde(default)]
    pub seed: u64,
    /// The camera.
    pub camera: CameraSetup,
    /// The scale.
    pub scale: ScaleSetup,
    /// The struck surface.
    #[serde(default)]
    pub surface: SurfaceSetup,
    /// The ball.
    pub body: BodySetup,
    /// Grey levels.
    #[serde(default)]
    pub shade: ShadeSetup,
    /// The lamp.
    #[serde(default)]
    pub light: LightSetup,
    /// Something in front of the ball: the struck flat, a racket.
    #[serde(default)]
    pub occluder: Option<OccluderSetup>,
    /// How the ball moves.
    pub motion: MotionSetup,
    /// A second ball in front of the first, behind the occluder; left out, there is none.
    #[serde(default)]
    pub other: Option<OtherSetup>,
}

/// A second ball, as large as it likes and with a motion of its own; nothing else knows of it.
///
/// Where both meet in the picture it hides the first. Each moves as its own motion
/// says: that two bounce off each other is written into both motions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OtherSetup {
    /// The ball.
    pub body: BodySetup,
    /// Its grey levels; those of the ground are the scenario's.
    #[serde(default)]
    pub shade: ShadeSetup,
    /// How it moves.
    pub motion: MotionSetup,
}

/// The camera of a scenario.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraSetup {
    /// Pixels a row, 16 to 8192.
    pub width_px: u32,
    /// Rows, 16 to 8192.
    pub height_px: u32,
    /// Frames a second, 0.001 to 10 million.
    pub frame_rate_hz: f64,
    /// Time the shutter is open, us; at most the time between two frames. The picture shows the mean over it.
    #[serde(default)]
    pub exposure_us: f64,
    /// How much later the shutter opens for each row than for the one above it, us: a rolling shutter; -1000 to 1000, and all
    /// rows within a frame's time; below 0 where it rolls upwards. 0 is a global one.
    #[serde(default)]
    pub row_time_us: f64,
    /// Length of the film, 1 to 100 million.
    pub frames: u64,
    /// Significant bits: 8, 10, 12 or 16.
    #[serde(default = "eight")]
    pub bits: u32,
    /// Standard deviation of the noise at half of full scale, DN; 0 to a quarter of full scale.
    #[serde(default)]
    pub noise_dn: f64,
    /// Share of the noise's variance that grows with the light (shot noise), 0 to 1; the rest is read noise.
    #[serde(default)]
    pub shot_share: f64,
    /// Spread of the pixels' gain, standard deviation as a share, 0 to 0.1.
    #[serde(default)]
    pub gain_spread: f64,
    /// Spread of the pixels' offset, standard deviation, DN; 0 to a sixteenth of full scale.
    #[serde(default)]
    pub offset_spread_dn: f64,
    /// Share of the pixels that show full scale, every second of them nothing, whatever is before them; 0 to 0.1.
    #[serde(default)]
    pub stuck_share: f64,
    /// Blur of the lens, standard deviation, 0.3 to 5 px.
    #[serde(default = "lens_blur")]
    pub blur_px: f64,
    /// Stamp of the first frame (exposure start), ns since the Unix epoch.
    #[serde(default = "start")]
    pub start_ns: u64,
}

/// Length of a pixel in the plane of the ball's centre.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScaleSetup {
    /// Scale, 1e-6 to 1000 mm/px: of a body that comes nearer at first touch, or in the first frame where nothing touches.
    pub mm_per_px: f64,
    /// Share of its distance from the camera by which the body comes nearer in a second, -1000 to 1000: it and its way in
    /// the picture grow about the picture's middle. Flat balls only.
    #[serde(default)]
    pub nearer_per_s: f64,
}

/// The struck surface.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfaceSetup {
    /// Tangent, turned counter-clockwise from x by this angle, -360 to 360 deg; the normal is 90 deg further.
    pub angle_deg: f64,
}

/// The ball, or the rod.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodySetup {
    /// Diameter, mm; at least 8 px and no larger than the picture.
    pub diameter_mm: f64,
    /// Where a ball carries its speckles, `disc` when left out.
    #[serde(default)]
    pub shape: Shape,
    /// The speckles: over the ball, or on the rod's patch.
    pub pattern: PatternSetup,
    /// Makes it an upright rod of this diameter; left out, it is a ball.
    #[serde(default)]
    pub rod: Option<RodSetup>,
}

/// What a ball's speckles are painted on. Its outline, its light and its motion in the picture are the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shape {
    /// A flat disc that faces the camera: every speckle is round, as in pictures moved by a video generator.
    #[default]
    Disc,
    /// A sphere, seen from far away: speckles are narrower towards the rim, and a spin about an axis in the
    /// picture's plane ([`PartSetup::tilt_deg_frame`]) carries them over the rim.
    Sphere,
    /// A flat that faces the camera, a disc which may be larger than the picture: with its rim outside, the whole
    /// picture is speckled.
    Plane,
}

/// A dark upright rod that reaches out of the picture, with two bright tapes around it.
///
/// Heights are above its lower end. The middle of the upper tape is the point
/// that moves as the motion says.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RodSetup {
    /// Lower and upper edge of the clean tape, px.
    pub tape_px: [f64; 2],
    /// Lower and upper edge of the speckled tape, px; above the clean one.
    pub patch_px: [f64; 2],
    /// Grey level of the rod as a share of full scale, 0 to 1; the tapes have the ball's.
    pub shade: f64,
}

/// Ringing of a struck rod, added to the motion of its mark.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RingingSetup {
    /// Speed at first touch, m/s.
    pub speed_m_s: f64,
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Time in which it falls to 1/e, s.
    pub decay_s: f64,
}

/// Round speckles and straight lines, strewn so that none overlap.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PatternSetup {
    /// Smallest speckle, at least 0.5 px^2.
    pub area_min_px2: f64,
    /// Largest speckle, at most a twentieth of the ball.
    pub area_max_px2: f64,
    /// Share of the ball that is covered, 0 to 0.6.
    pub coverage: f64,
    /// Straight lines of random direction, 0 to 20.
    #[serde(default)]
    pub lines: u32,
    /// Their width, 0.5 to 10 px.
    #[serde(default = "line_width")]
    pub line_width_px: f64,
}

/// Grey levels as shares of full scale, 0 to 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShadeSetup {
    /// The ball between its speckles.
    pub ball: f64,
    /// The speckles.
    pub speckle: f64,
    /// Behind the ball.
    pub ground: f64,
    /// Roughness of the ground, standard deviation as a share of full scale, 0 to 0.2.
    #[serde(default)]
    pub ground_texture: f64,
}

/// A lamp fixed in the room; all shares 0 to 0.9 in size.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LightSetup {
    /// Change of brightness from the left edge of the picture to the right, as a share.
    pub gradient_x: f64,
    /// Change of brightness from the top edge of the picture to the bottom, as a share.
    pub gradient_y: f64,
    /// The ball's side towards the lamp is brighter by this share, the other darker; it moves with the ball and does not turn.
    pub side: f64,
    /// Where the lamp stands, counter-clockwise from x, deg.
    pub side_angle_deg: f64,
    /// The ball's rim is darker than its middle by this share.
    pub limb: f64,
    /// The picture's corners are darker than its middle by this share (lens).
    pub vignette: f64,
    /// The lamp's brightness swings by this share up and down.
    pub flicker: f64,
    /// How often it swings, 0 to 1 million Hz: 100 or 120 on the mains.
    pub flicker_hz: f64,
}

/// A half-plane in front of the ball.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OccluderSetup {
    /// Grey level as a share of full scale, 0 to 1.
    pub shade: f64,
    /// Roughness, standard deviation as a share of full scale, 0 to 0.2; 0 where the edge moves.
    #[serde(default)]
    pub texture: f64,
    /// A point of its edge in the first frame; left out, the edge is where the ball first touches.
    #[serde(default)]
    pub point_px: Option<[f64; 2]>,
    /// Outward normal of its edge, counter-clockwise from x, deg; left out, the surface's.
    #[serde(default)]
    pub normal_deg: Option<f64>,
    /// Speed of the edge along its normal, px/frame; one that moves has no texture.
    #[serde(default)]
    pub speed_px_frame: f64,
}

/// How the ball moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum MotionSetup {
    /// Constant velocity and spin.
    Constant {
        /// Along x, px/frame.
        vx_px_frame: f64,
        /// Along y (**down**), px/frame.
        vy_px_frame: f64,
        /// Spin, counter-clockwise, deg/frame.
        omega_deg_frame: f64,
        /// Centre in the first frame.
        start_px: [f64; 2],
    },
    /// Stretches of constant velocity and spin, one after the other; place and angle do not jump between them.
    Piecewise {
        /// Centre in the first frame.
        start_px: [f64; 2],
        /// 1 to 1000 stretches.
        parts: Vec<PartSetup>,
    },
    /// One collision with the surface.
    Impact(ImpactSetup),
}

/// A stretch of constant velocity and spin.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartSetup {
    /// How long it lasts, in frames and their fractions, above 0; the last one goes on to the end of the film.
    pub frames: f64,
    /// Along x, px/frame.
    pub vx_px_frame: f64,
    /// Along y (**down**), px/frame.
    pub vy_px_frame: f64,
    /// Spin, counter-clockwise, deg/frame.
    #[serde(default)]
    pub omega_deg_frame: f64,
    /// Spin about the axes x and y (**up**) of the picture, deg/frame: the side that faces the camera goes down with the
    /// first and to the right with the second. Spheres only.
    #[serde(default)]
    pub tilt_deg_frame: [f64; 2],
}

/// A collision.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImpactSetup {
    /// First touch after the first frame's stamp, s.
    pub contact_start_s: f64,
    /// Centre at first touch.
    pub contact_center_px: [f64; 2],
    /// Velocity at first touch along the normal, negative, m/s.
    pub vn_m_s: f64,
    /// Velocity at first touch along the tangent, m/s.
    pub vt_m_s: f64,
    /// Spin at first touch, counter-clockwise, rad/s.
    #[serde(default)]
    pub omega_rad_s: f64,
    /// Gravity in the picture (x right, y **up**), m/s^2.
    #[serde(default)]
    pub gravity_m_s2: [f64; 2],
    /// Mass, kg.
    pub mass_kg: f64,
    /// Moment of inertia over m R^2, 0.1 to 1.
    pub inertia_factor: f64,
    /// Normal contact.
    pub law: NormalLaw,
    /// Tangential contact; left out, the surface is frictionless.
    #[serde(default)]
    pub friction: Option<Friction>,
    /// Ringing from first touch on, along the normal; rods only.
    #[serde(default)]
    pub ringing: Option<RingingSetup>,
}

impl CameraSetup {
    /// Variance of a pixel that sees `light_dn`, DN^2: read and shot noise, the pixels' own gain and offset, and
    /// rounding to whole levels.
    pub fn noise_variance_dn2(&self, light_dn: f64) -> f64 {
        let half_dn = 0.5 * (2f64.powi(self.bits as i32) - 1.0);
        let noise = self.noise_dn * self.noise_dn * (1.0 - self.shot_share + self.shot_share * light_dn / half_dn);
        noise + (self.gain_spread * light_dn).powi(2) + self.offset_spread_dn.powi(2) + 1.0 / 12.0
    }
}

impl MotionSetup {
    fn rescale(&mut self, length: f64, time: f64) {
        match self {
            Self::Constant { vx_px_frame, vy_px_frame, omega_deg_frame, start_px } => {
                [vx_px_frame, vy_px_frame].into_iter().for_each(|speed| *speed *= length * time);
                *omega_deg_frame *= time;
                start_px.iter_mut().for_each(|at| *at *= length);
            }
            Self::Piecewise { start_px, parts } => {
                start_px.iter_mut().for_each(|at| *at *= length);
                for part in parts {
                    part.frames /= time;
                    [&mut part.vx_px_frame, &mut part.vy_px_frame]
                        .into_iter()
                        .for_each(|speed| *speed *= length * time);
                    let [about_x, about_y] = &mut part.tilt_deg_frame;
                    [about_x, about_y, &mut part.omega_deg_frame].into_iter().for_each(|spin| *spin *= time);
                }
            }
            Self::Impact(impact) => impact.contact_center_px.iter_mut().for_each(|at| *at *= length),
        }
    }
}

impl Default for ShadeSetup {
    fn default() -> Self {
        Self { ball: 0.75, speckle: 0.2, ground: 0.12, ground_texture: 0.0 }
    }
}

fn eight() -> u32 {
    8
}

fn line_width() -> f64 {
    2.0
}

fn lens_blur() -> f64 {
    0.7
}

fn start() -> u64 {
    1_700_000_000_000_000_000
}

impl Scenario {
    /// Reads a scenario from TOML and checks it.
    ///
    /// # Errors
    ///
    /// [`ScenarioError`] with the key, its value and what is allowed.
    pub fn from_toml(text: &str) -> Result<Self, ScenarioError> {
        let syntax = |error: toml::de::Error| ScenarioError::Syntax(error.to_string().trim_end().to_owned());
        // First, so that a number too small or too large for its type is told with its key and its range.
        check::whole_numbers(&toml::from_str(text).map_err(syntax)?)?;
        let scenario: Self = toml::from_str(text).map_err(syntax)?;
        scenario.check()?;
        Ok(scenario)
    }

    /// Radius of the ball, or half the width of the rod, in the picture, px.
    pub fn radius_px(&self) -> f64 {
        0.5 * self.body.diameter_mm / self.scale.mm_per_px
    }

    /// Makes every length in the picture `length` times and every frame `time` times as long; balls and pictures keep
    /// their sizes.
    pub(crate) fn rescale_motion(&mut self, length: f64, time: f64) {
        self.motion.rescale(length, time);
        if let Some(other) = &mut self.other {
            other.motion.rescale(length, time);
        }
    }

    /// The second ball as the only one of a film with the same camera, lamp and surface, and without an occluder.
    pub(crate) fn alone(&self, other: &OtherSetup) -> Self {
        Self {
            body: other.body.clone(),
            shade: ShadeSetup {
                ground: self.shade.ground,
                ground_texture: self.shade.ground_texture,
                ..other.shade.clone()
            },
            motion: other.motion.clone(),
            occluder: None,
            other: None,
            ..self.clone()
        }
    }
}
