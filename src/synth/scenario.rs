//! What is filmed, and with which camera.

use super::physics::{Friction, NormalLaw, PhysicsError};
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
    /// Scale, 1e-6 to 1000 mm/px.
    pub mm_per_px: f64,
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
    /// The speckles: over the ball, or on the rod's patch.
    pub pattern: PatternSetup,
    /// Makes it an upright rod of this diameter; left out, it is a ball.
    #[serde(default)]
    pub rod: Option<RodSetup>,
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
    /// One collision with the surface.
    Impact(ImpactSetup),
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

/// Why a scenario cannot be filmed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ScenarioError {
    /// Not TOML, or not the keys of a scenario.
    #[error("read scenario: {0}")]
    Syntax(String),
    /// A number is out of range.
    #[error("{key} = {value} is out of range: allowed is {range}")]
    OutOfRange {
        /// Name of the key, with its tables.
        key: &'static str,
        /// What was given.
        value: String,
        /// What is allowed.
        range: String,
    },
    /// The ball does not fit.
    #[error(
        "body.diameter_mm = {diameter_mm} is a ball of {diameter_px:.1} px at scale.mm_per_px = {mm_per_px}: \
         larger than the picture of {width_px} x {height_px} px"
    )]
    BallTooLarge {
        /// The key's value.
        diameter_mm: f64,
        /// The scale.
        mm_per_px: f64,
        /// In the picture.
        diameter_px: f64,
        /// The picture.
        width_px: u32,
        /// The picture.
        height_px: u32,
    },
    /// Speckles of these sizes cannot be packed so densely.
    #[error("body.pattern.coverage = {wanted} cannot be reached with speckles that do not overlap: {reached:.3} was")]
    TooDense {
        /// The key's value.
        wanted: f64,
        /// Where packing stopped.
        reached: f64,
    },
    /// So many lines cannot keep clear of each other.
    #[error("body.pattern.lines = {wanted} do not fit on the ball without crossing: {reached} did")]
    TooManyLines {
        /// The key's value.
        wanted: u32,
        /// How many found a place.
        reached: usize,
    },
    /// The ball would come back before the film ends.
    #[error(
        "camera.frames = {frames} lasts {film_s:.4} s, but the ball touches again at {again_s:.4} s: one collision a film"
    )]
    TouchesAgain {
        /// The key's value.
        frames: u64,
        /// Length of the film.
        film_s: f64,
        /// Second touch.
        again_s: f64,
    },
    /// A rod that does something only a ball can do.
    #[error("body.rod stands upright and does not turn: {0}")]
    RodOnly(&'static str),
    /// An edge that nothing places.
    #[error("occluder.point_px is missing: only motion.kind = \"impact\" has a point of first touch to take its place")]
    OccluderPlace,
    /// No bounce.
    #[error("motion: {0}")]
    Physics(#[from] PhysicsError),
}

impl Scenario {
    /// Reads a scenario from TOML and checks it.
    ///
    /// # Errors
    ///
    /// [`ScenarioError`] with the key, its value and what is allowed.
    pub fn from_toml(text: &str) -> Result<Self, ScenarioError> {
        let scenario: Self =
            toml::from_str(text).map_err(|error| ScenarioError::Syntax(error.to_string().trim_end().to_owned()))?;
        scenario.check()?;
        Ok(scenario)
    }

    /// Radius of the ball, or half the width of the rod, in the picture, px.
    pub fn radius_px(&self) -> f64 {
        0.5 * self.body.diameter_mm / self.scale.mm_per_px
    }

    /// Checks every number against its range.
    ///
    /// # Errors
    ///
    /// [`ScenarioError`] for the first number that is out of range.
    pub fn check(&self) -> Result<(), ScenarioError> {
        self.check_camera()?;
        within("scale.mm_per_px", self.scale.mm_per_px, 1e-6, 1e3)?;
        within("surface.angle_deg", self.surface.angle_deg, -360.0, 360.0)?;
        self.check_body()?;
        self.check_light()?;
        match &self.motion {
            MotionSetup::Constant { vx_px_frame, vy_px_frame, omega_deg_frame, start_px } => {
                within("motion.vx_px_frame", *vx_px_frame, -1e4, 1e4)?;
                within("motion.vy_px_frame", *vy_px_frame, -1e4, 1e4)?;
                within("motion.omega_deg_frame", *omega_deg_frame, -180.0, 180.0)?;
                place("motion.start_px", *start_px)?;
                if self.occluder.as_ref().is_some_and(|occluder| occluder.point_px.is_none()) {
                    return Err(ScenarioError::OccluderPlace);
                }
            }
            MotionSetup::Impact(impact) => impact.check()?,
        }
        Ok(())
    }

    fn check_camera(&self) -> Result<(), ScenarioError> {
        let camera = &self.camera;
        within("camera.width_px", f64::from(camera.width_px), 16.0, 8192.0)?;
        within("camera.height_px", f64::from(camera.height_px), 16.0, 8192.0)?;
        within("camera.frame_rate_hz", camera.frame_rate_hz, 1e-3, 1e7)?;
        within("camera.exposure_us", camera.exposure_us, 0.0, 1e6 / camera.frame_rate_hz)?;
        within("camera.frames", camera.frames as f64, 1.0, 1e8)?;
        if ![8, 10, 12, 16].contains(&camera.bits) {
            return Err(out_of_range("camera.bits", camera.bits, "8, 10, 12 or 16"));
        }
        within("camera.noise_dn", camera.noise_dn, 0.0, 0.25 * 2f64.powi(camera.bits as i32))?;
        within("camera.shot_share", camera.shot_share, 0.0, 1.0)?;
        within("camera.gain_spread", camera.gain_spread, 0.0, 0.1)?;
        within("camera.offset_spread_dn", camera.offset_spread_dn, 0.0, 2f64.powi(camera.bits as i32 - 4))?;
        within("camera.blur_px", camera.blur_px, 0.3, 5.0)?;
        // The last stamp, at 1e8 frames of 1000 s, must still fit 64 bits.
        within("camera.start_ns", camera.start_ns as f64, 0.0, 9e18)?;
        within("camera.frames / camera.frame_rate_hz", camera.frames as f64 / camera.frame_rate_hz, 0.0, 9e9)
    }

    fn check_body(&self) -> Result<(), ScenarioError> {
        let diameter_mm = self.body.diameter_mm;
        let (mm_per_px, camera) = (self.scale.mm_per_px, &self.camera);
        if diameter_mm.is_nan() || diameter_mm < 8.0 * mm_per_px {
            let range = format!("at least 8 px, {} mm at this scale", 8.0 * mm_per_px);
            return Err(out_of_range("body.diameter_mm", diameter_mm, range));
        }
        let (width_px, height_px) = (camera.width_px, camera.height_px);
        let diameter_px = 2.0 * self.radius_px();
        if diameter_px > f64::from(width_px.min(height_px)) {
            return Err(ScenarioError::BallTooLarge { diameter_mm, mm_per_px, diameter_px, width_px, height_px });
        }
        let pattern = &self.body.pattern;
        self.check_rod()?;
        let largest = self.speckled_px2() / 20.0;
        within("body.pattern.area_min_px2", pattern.area_min_px2, 0.5, largest)?;
        within("body.pattern.area_max_px2", pattern.area_max_px2, pattern.area_min_px2, largest)?;
        within("body.pattern.coverage", pattern.coverage, 0.0, 0.6)?;
        within("body.pattern.lines", f64::from(pattern.lines), 0.0, 20.0)?;
        within("body.pattern.line_width_px", pattern.line_width_px, 0.5, 10.0)
    }

    /// Area of the disc or patch that carries the speckles.
    fn speckled_px2(&self) -> f64 {
        let radius = self.radius_px();
        let disc = std::f64::consts::PI * radius * radius;
        self.body.rod.as_ref().map_or(disc, |rod| 2.0 * radius * (rod.patch_px[1] - rod.patch_px[0]))
    }

    fn check_rod(&self) -> Result<(), ScenarioError> {
        let Some(rod) = &self.body.rod else {
            let ringing = matches!(&self.motion, MotionSetup::Impact(impact) if impact.ringing.is_some());
            return if ringing { Err(ScenarioError::RodOnly("motion.ringing needs one")) } else { Ok(()) };
        };
        within("body.rod.tape_px", rod.tape_px[0], 1.0, 8192.0)?;
        within("body.rod.tape_px", rod.tape_px[1], rod.tape_px[0] + 1.0, 8192.0)?;
        within("body.rod.patch_px", rod.patch_px[0], rod.tape_px[1] + 1.0, 8192.0)?;
        within("body.rod.patch_px", rod.patch_px[1], rod.patch_px[0] + 4.0, 8192.0)?;
        within("body.rod.shade", rod.shade, 0.0, 1.0)?;
        let (turns, slides) = match &self.motion {
            MotionSetup::Constant { omega_deg_frame, .. } => (omega_deg_frame.abs() > 0.0, false),
            MotionSetup::Impact(impact) => (impact.omega_rad_s.abs() > 0.0, impact.friction.is_some()),
        };
        let edge = self.occluder.as_ref();
        for (wrong, why) in [
            (turns, "its spin must be 0"),
            (slides, "motion.friction must be left out"),
            (self.surface.angle_deg.abs() > 0.0, "surface.angle_deg must be 0"),
            (self.body.pattern.lines > 0, "body.pattern.lines must be 0"),
            (self.light.side > 0.0 || self.light.limb > 0.0, "light.side and light.limb must be 0"),
            (edge.is_some_and(|edge| edge.normal_deg.is_some()), "occluder.normal_deg must be left out"),
        ] {
            if wrong {
                return Err(ScenarioError::RodOnly(why));
            }
        }
        Ok(())
    }

    fn check_light(&self) -> Result<(), ScenarioError> {
        within("shade.ball", self.shade.ball, 0.0, 1.0)?;
        within("shade.speckle", self.shade.speckle, 0.0, 1.0)?;
        within("shade.ground", self.shade.ground, 0.0, 1.0)?;
        within("shade.ground_texture", self.shade.ground_texture, 0.0, 0.2)?;
        within("light.gradient_x", self.light.gradient_x, -0.9, 0.9)?;
        within("light.gradient_y", self.light.gradient_y, -0.9, 0.9)?;
        within("light.side", self.light.side, 0.0, 0.9)?;
        within("light.side_angle_deg", self.light.side_angle_deg, -360.0, 360.0)?;
        within("light.limb", self.light.limb, 0.0, 0.9)?;
        within("light.vignette", self.light.vignette, 0.0, 0.9)?;
        within("light.flicker", self.light.flicker, 0.0, 0.9)?;
        within("light.flicker_hz", self.light.flicker_hz, 0.0, 1e6)?;
        let Some(occluder) = &self.occluder else { return Ok(()) };
        within("occluder.shade", occluder.shade, 0.0, 1.0)?;
        within("occluder.texture", occluder.texture, 0.0, if occluder.speed_px_frame.abs() > 0.0 { 0.0 } else { 0.2 })?;
        within("occluder.speed_px_frame", occluder.speed_px_frame, -1e4, 1e4)?;
        within("occluder.normal_deg", occluder.normal_deg.unwrap_or(0.0), -360.0, 360.0)?;
        place("occluder.point_px", occluder.point_px.unwrap_or_default())
    }
}

impl ImpactSetup {
    fn check(&self) -> Result<(), ScenarioError> {
        within("motion.contact_start_s", self.contact_start_s, 0.0, 1e3)?;
        place("motion.contact_center_px", self.contact_center_px)?;
        within("motion.vn_m_s", self.vn_m_s, -1e3, -1e-3)?;
        within("motion.vt_m_s", self.vt_m_s, -1e3, 1e3)?;
        within("motion.omega_rad_s", self.omega_rad_s, -1e5, 1e5)?;
        within("motion.gravity_m_s2", self.gravity_m_s2[0], -100.0, 100.0)?;
        within("motion.gravity_m_s2", self.gravity_m_s2[1], -100.0, 100.0)?;
        within("motion.mass_kg", self.mass_kg, 1e-6, 1e3)?;
        within("motion.inertia_factor", self.inertia_factor, 0.1, 1.0)?;
        match self.law {
            NormalLaw::KelvinVoigt { stiffness_n_m, damping_n_s_m } => {
                within("motion.law.stiffness_n_m", stiffness_n_m, 1.0, 1e10)?;
                within("motion.law.damping_n_s_m", damping_n_s_m, 0.0, 1e6)?;
            }
            NormalLaw::HuntCrossley { stiffness_n_m15, damping_s_m } => {
                within("motion.law.stiffness_n_m15", stiffness_n_m15, 1.0, 1e12)?;
                within("motion.law.damping_s_m", damping_s_m, 0.0, 1e3)?;
            }
        }
        if let Some(ringing) = &self.ringing {
            within("motion.ringing.speed_m_s", ringing.speed_m_s, -1e3, 1e3)?;
            within("motion.ringing.frequency_hz", ringing.frequency_hz, 1.0, 1e7)?;
            within("motion.ringing.decay_s", ringing.decay_s, 1e-6, 1e3)?;
        }
        let Some(friction) = self.friction else { return Ok(()) };
        within("motion.friction.stiffness_n_m", friction.stiffness_n_m, 1.0, 1e8)?;
        // A patch that relaxes faster than this could not be followed in steps of 0.05 us.
        let least = 1e-6 * friction.stiffness_n_m;
        within("motion.friction.damping_n_s_m", friction.damping_n_s_m, least, 1e4)?;
        within("motion.friction.coefficient", friction.coefficient, 0.0, 10.0)
    }
}

fn out_of_range(key: &'static str, value: impl ToString, range: impl Into<String>) -> ScenarioError {
    ScenarioError::OutOfRange { key, value: value.to_string(), range: range.into() }
}

fn within(key: &'static str, value: f64, low: f64, high: f64) -> Result<(), ScenarioError> {
    // A NaN lies in no range.
    if (low..=high).contains(&value) { Ok(()) } else { Err(out_of_range(key, value, format!("{low} to {high}"))) }
}

fn place(key: &'static str, place_px: [f64; 2]) -> Result<(), ScenarioError> {
    within(key, place_px[0], -1e5, 1e5)?;
    within(key, place_px[1], -1e5, 1e5)
}
