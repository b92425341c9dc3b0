//! The description of a simulated film: the filmed objects and the camera.

mod built_in;
mod check;
mod error;
mod light;
mod pattern;

pub use error::ScenarioError;
pub use light::{LightSetup, ShadeSetup};
pub use pattern::{Layout, PatternSetup};

use super::physics::{Friction, NormalLaw};
use serde::{Deserialize, Serialize};

/// A simulated film. Every value is checked by [`Scenario::check`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// The name.
    pub name: String,
    /// The seed of all random parts: speckles, textures, noise.
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
    /// The grey levels.
    #[serde(default)]
    pub shade: ShadeSetup,
    /// The illumination.
    #[serde(default)]
    pub light: LightSetup,
    /// An object in front of the ball: the struck surface, a racket.
    #[serde(default)]
    pub occluder: Option<OccluderSetup>,
    /// The motion of the ball.
    pub motion: MotionSetup,
    /// A second ball in front of the first, behind the occluder; optional.
    #[serde(default)]
    pub other: Option<OtherSetup>,
}

/// A second ball of any size with its own motion, independent of the first.
///
/// If both overlap in the image, it occludes the first. Each follows its own motion; a collision of both has to be
/// described in both motions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OtherSetup {
    /// The ball.
    pub body: BodySetup,
    /// Its grey levels; those of the ground are the scenario's.
    #[serde(default)]
    pub shade: ShadeSetup,
    /// Its motion.
    pub motion: MotionSetup,
}

/// The camera of a scenario.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraSetup {
    /// Pixels per row, 16 to 8192.
    pub width_px: u32,
    /// Rows, 16 to 8192.
    pub height_px: u32,
    /// Frames per second, 0.001 to 10 million.
    pub frame_rate_hz: f64,
    /// Exposure time, us; at most the time between two frames. The image shows the mean over it.
    #[serde(default)]
    pub exposure_us: f64,
    /// Delay of the exposure of each row after the row above, us, -1000 to 1000, for a rolling shutter; negative if
    /// it rolls upwards. All rows must fit into a frame's time. 0 is a global shutter.
    #[serde(default)]
    pub row_time_us: f64,
    /// Length of the film, 1 to 100 million frames.
    pub frames: u64,
    /// Significant bits: 8, 10, 12 or 16.
    #[serde(default = "default_bits")]
    pub bits: u32,
    /// Standard deviation of the noise at half of full scale, DN; 0 to a quarter of full scale.
    #[serde(default)]
    pub noise_dn: f64,
    /// Fraction of the noise variance that grows with the light (shot noise), 0 to 1; the rest is read noise.
    #[serde(default)]
    pub shot_share: f64,
    /// Relative standard deviation of the pixels' gain, 0 to 0.1.
    #[serde(default)]
    pub gain_spread: f64,
    /// Standard deviation of the pixels' offset, DN; 0 to a sixteenth of full scale.
    #[serde(default)]
    pub offset_spread_dn: f64,
    /// Fraction of stuck pixels, alternately at full scale and at zero, 0 to 0.1.
    #[serde(default)]
    pub stuck_share: f64,
    /// Blur of the lens, standard deviation, 0.3 to 5 px.
    #[serde(default = "default_blur_px")]
    pub blur_px: f64,
    /// Exponent of the tone curve, 0.2 to 1: the grey level is the light, with its noise, to this power. Black and full
    /// scale stay.
    #[serde(default = "default_gamma")]
    pub gamma: f64,
    /// Stamp of the first frame (exposure start), ns since the Unix epoch.
    #[serde(default = "default_start_ns")]
    pub start_ns: u64,
}

/// The scale in the plane of the ball's centre.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScaleSetup {
    /// Scale, 1e-6 to 1000 mm/px; of an approaching body at first contact, or in the first frame without a contact.
    pub mm_per_px: f64,
    /// Relative approach of the body to the camera per second, -1000 to 1000. The body and its trajectory are
    /// magnified about the image centre. Flat balls only.
    #[serde(default)]
    pub nearer_per_s: f64,
}

/// The struck surface.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfaceSetup {
    /// Tangent, counter-clockwise from x, -360 to 360 deg; the normal is 90 deg further.
    pub angle_deg: f64,
}

/// The ball, or the rod.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodySetup {
    /// Diameter, mm; at least 8 px and at most the size of the image.
    pub diameter_mm: f64,
    /// Surface that carries the speckles of a ball, default `disc`.
    #[serde(default)]
    pub shape: Shape,
    /// Speckles on the ball, or on the patch of the rod.
    pub pattern: PatternSetup,
    /// Felt on a ball: standard deviation of the ends of its hairs about the rim, 0 to 4 px and at most an eighth of the
    /// radius. They turn with the ball and move neither its centre nor its mean radius.
    #[serde(default)]
    pub fuzz_px: f64,
    /// If present, the body is an upright rod of this diameter.
    #[serde(default)]
    pub rod: Option<RodSetup>,
}

/// The surface that carries the speckles of a ball. Outline, shading and motion in the image do not depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shape {
    /// A flat disc that faces the camera: every speckle is round, as in images moved by a video generator.
    #[default]
    Disc,
    /// A sphere in parallel projection. Speckles are narrower towards the rim, and a spin about an axis in the image
    /// plane ([`PartSetup::tilt_deg_frame`]) moves them over the rim.
    Sphere,
    /// A flat disc that faces the camera and may be larger than the image. If its rim lies outside, the whole image is
    /// speckled.
    Plane,
}

/// A dark upright rod that extends beyond the image, with two bright tapes around it.
///
/// Heights are above its lower end. The motion is that of the middle of the upper tape.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RodSetup {
    /// Lower and upper edge of the clean tape, px.
    pub tape_px: [f64; 2],
    /// Lower and upper edge of the speckled tape, px; above the clean one.
    pub patch_px: [f64; 2],
    /// Grey level of the rod as a fraction of full scale, 0 to 1; the tapes have that of the ball.
    pub shade: f64,
}

/// The ringing of a struck rod, added to the motion of its mark.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RingingSetup {
    /// Amplitude of the speed at first contact, m/s. The speed is a sine that decays from it, and 0 at that moment.
    pub speed_m_s: f64,
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Time in which the amplitude decays to 1/e, s.
    pub decay_s: f64,
}

/// A half-plane in front of the ball.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OccluderSetup {
    /// Grey level as a fraction of full scale, 0 to 1.
    pub shade: f64,
    /// Texture, standard deviation as a fraction of full scale, 0 to 0.2; 0 for a moving edge.
    #[serde(default)]
    pub texture: f64,
    /// A point of its edge in the first frame; default: the point of first contact.
    #[serde(default)]
    pub point_px: Option<[f64; 2]>,
    /// Outward normal of its edge, counter-clockwise from x, deg; default: that of the surface.
    #[serde(default)]
    pub normal_deg: Option<f64>,
    /// Speed of the edge along its normal, px/frame; a moving edge has no texture.
    #[serde(default)]
    pub speed_px_frame: f64,
    /// The flat behind the ball, as the camera sees it from slightly above: its height over the edge, 0 to 8192 px. At 0
    /// the flat is seen from the side.
    #[serde(default)]
    pub behind_px: f64,
    /// Relative darkening where a ball blocks all light, 0 to 1: the light of the lamp in a cast shadow, that from all
    /// sides around the contact.
    #[serde(default)]
    pub shadow: f64,
    /// Share of the light that a glossy flat reflects like a mirror, 0 to 0.9: the image of the body upside down.
    #[serde(default)]
    pub mirror: f64,
}

/// The motion of the ball.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum MotionSetup {
    /// Constant velocity and spin.
    Constant {
        /// Velocity along x, px/frame.
        vx_px_frame: f64,
        /// Velocity along y (**down**), px/frame.
        vy_px_frame: f64,
        /// Spin, counter-clockwise, deg/frame.
        omega_deg_frame: f64,
        /// Centre in the first frame.
        start_px: [f64; 2],
    },
    /// Consecutive segments of constant velocity and spin; position and angle are continuous.
    Piecewise {
        /// Centre in the first frame.
        start_px: [f64; 2],
        /// 1 to 1000 segments.
        parts: Vec<PartSetup>,
    },
    /// One collision with the surface.
    Impact(ImpactSetup),
}

/// A segment of constant velocity and spin.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartSetup {
    /// Length in frames, above 0, fractions allowed; the last segment continues to the end of the film.
    pub frames: f64,
    /// Velocity along x, px/frame.
    pub vx_px_frame: f64,
    /// Velocity along y (**down**), px/frame.
    pub vy_px_frame: f64,
    /// Spin, counter-clockwise, deg/frame.
    #[serde(default)]
    pub omega_deg_frame: f64,
    /// Spin about the image axes x and y (**up**), deg/frame. The side that faces the camera moves down with the
    /// first and to the right with the second. Spheres only.
    #[serde(default)]
    pub tilt_deg_frame: [f64; 2],
}

/// A collision.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImpactSetup {
    /// Time of first contact after the first frame's stamp, s.
    pub contact_start_s: f64,
    /// Centre at first contact.
    pub contact_center_px: [f64; 2],
    /// Velocity at first contact along the normal, negative, m/s.
    pub vn_m_s: f64,
    /// Velocity at first contact along the tangent, m/s.
    pub vt_m_s: f64,
    /// Spin at first contact, counter-clockwise, rad/s.
    #[serde(default)]
    pub omega_rad_s: f64,
    /// Gravity in the image (x right, y **up**), m/s^2.
    #[serde(default)]
    pub gravity_m_s2: [f64; 2],
    /// Mass, kg.
    pub mass_kg: f64,
    /// Moment of inertia over m R^2, 0.1 to 1.
    pub inertia_factor: f64,
    /// Law of normal contact.
    pub law: NormalLaw,
    /// Law of tangential contact; without it the surface is frictionless.
    #[serde(default)]
    pub friction: Option<Friction>,
    /// Ringing from first contact on, along the normal; rods only.
    #[serde(default)]
    pub ringing: Option<RingingSetup>,
}

impl CameraSetup {
    /// Returns the variance of a pixel at `light_dn`, DN^2, before the tone curve: read and shot noise, gain and offset of
    /// the pixels, and rounding.
    pub fn noise_variance_dn2(&self, light_dn: f64) -> f64 {
        let half_dn = 0.5 * (2f64.powi(self.bits as i32) - 1.0);
        let noise = self.noise_dn * self.noise_dn * (1.0 - self.shot_share + self.shot_share * light_dn / half_dn);
        noise + (self.gain_spread * light_dn).powi(2) + self.offset_spread_dn.powi(2) + 1.0 / 12.0
    }
}

impl MotionSetup {
    /// Multiplies all lengths of the motion by `length` and the duration of a frame by `time`, both dimensionless.
    ///
    /// A collision is described in metres and seconds, so only its place in the image changes.
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

fn default_bits() -> u32 {
    8
}

fn default_blur_px() -> f64 {
    0.7
}

fn default_gamma() -> f64 {
    1.0
}

/// Returns a stamp in November 2023, so that simulated stamps look like real ones.
fn default_start_ns() -> u64 {
    1_700_000_000_000_000_000
}

impl Scenario {
    /// Reads a scenario from TOML and checks it.
    ///
    /// # Errors
    ///
    /// Returns [`ScenarioError`] with the key, its value and the allowed range.
    pub fn from_toml(text: &str) -> Result<Self, ScenarioError> {
        let syntax = |error: toml::de::Error| ScenarioError::Syntax(error.to_string().trim_end().to_owned());
        // Checked first, so that an integer out of the range of its type is reported with its key and range.
        check::check_integers(&toml::from_str(text).map_err(syntax)?)?;
        let scenario: Self = toml::from_str(text).map_err(syntax)?;
        scenario.check()?;
        Ok(scenario)
    }

    /// Returns the radius of the ball, or half the width of the rod, in the image, px.
    pub fn radius_px(&self) -> f64 {
        0.5 * self.body.diameter_mm / self.scale.mm_per_px
    }

    /// Multiplies all lengths of motion in the image by `length` and the duration of a frame by `time`; balls and
    /// images keep their sizes, and collisions their metres and seconds.
    pub(crate) fn rescale_motion(&mut self, length: f64, time: f64) {
        self.motion.rescale(length, time);
        if let Some(other) = &mut self.other {
            other.motion.rescale(length, time);
        }
    }

    /// Returns the scenario of the second ball alone, with the same camera, lamp and surface, and without an
    /// occluder.
    pub(crate) fn second_ball_alone(&self, other: &OtherSetup) -> Self {
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
