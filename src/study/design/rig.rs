//! The rig of a prediction: its configuration and scenario.

use crate::camera::{StreamFormat, simulated};
use crate::config::{BodyKind, Config, Scale, Source};
use crate::console::UsageError;
use crate::failure::Failure;
use crate::image::PixelFormat;
use crate::process;
use crate::results::FrameCoding;
use crate::synth::{MotionSetup, PartSetup, Scenario, SimulatedFilm};

/// Maximum motion during the exposure, as a fraction of the radius.
const BLUR_SHARE: f64 = 0.25;

/// A configuration and the scenario it films.
#[derive(Debug, Clone)]
pub(super) struct Rig {
    pub(super) config: Config,
    pub(super) scenario: Scenario,
}

impl Rig {
    /// Combines a configuration with its own scenario, or with `scenario` as seen by the rig's camera. `noise_dn`
    /// replaces the noise of the scenario.
    ///
    /// # Errors
    ///
    /// When nothing can be predicted: the rig has several bodies, replays a recording, or has no scenario or scale; and
    /// the errors of [`Self::check`].
    pub(super) fn new(mut config: Config, scenario: Option<&str>, noise_dn: Option<f64>) -> Result<Self, Failure> {
        let origin = config.origin.clone();
        let refuse = |why: &str| UsageError(format!("{origin}: {why}"));
        if config.bodies.len() != 1 {
            return Err(refuse(&format!(
                "only rigs with one body can be predicted, this one has {}",
                config.bodies.len()
            ))
            .into());
        }
        let mut scenario = match config.camera.source {
            Some(Source::Recording) => {
                return Err(
                    refuse("source = \"recording\" cannot be predicted: measure it with `ricochet analyze`").into()
                );
            }
            Some(Source::Simulated) => {
                if let Some(name) = scenario {
                    config.camera.scenario = Some(name.to_owned());
                }
                match process::truth_world(&config).map_err(|error| UsageError(error.to_string()))? {
                    Some(film) => film.scenario().clone(),
                    None => return Err(refuse("no scenario to predict: set camera.scenario").into()),
                }
            }
            Some(Source::Genicam | Source::V4l2) | None => {
                let name = scenario.unwrap_or("lacrosse");
                let film = simulated::load_scenario(name).map_err(|error| UsageError(error.to_string()))?;
                adapt_to_camera(&config, film).map_err(|why| refuse(&why))?
            }
        };
        if let Some(noise_dn) = noise_dn {
            scenario.camera.noise_dn = noise_dn;
        }
        let rig = Self { config, scenario };
        rig.check()?;
        Ok(rig)
    }

    /// Returns the film of the scenario.
    ///
    /// # Errors
    ///
    /// When the scenario cannot be rendered.
    pub(super) fn film(&self) -> Result<SimulatedFilm, Failure> {
        SimulatedFilm::new(&self.scenario)
            .map_err(|error| UsageError(format!("{}: {error}", self.config.origin)).into())
    }

    /// Returns the format of the camera's frames; 8 bits unless the scenario has 10, 12 or 16.
    pub(super) fn format(&self) -> StreamFormat {
        let camera = &self.scenario.camera;
        let format = match camera.bits {
            10 => PixelFormat::Mono10,
            12 => PixelFormat::Mono12,
            16 => PixelFormat::Mono16,
            _ => PixelFormat::Mono8,
        };
        StreamFormat {
            width_px: camera.width_px,
            height_px: camera.height_px,
            format,
            frame_rate_hz: camera.frame_rate_hz,
            exposure_us: camera.exposure_us,
            coding: FrameCoding::default(),
        }
    }

    /// Returns an upper bound of the speed of the body's fastest point in the image, px/s: translation plus rim.
    pub(super) fn speed_px_s(&self) -> f64 {
        let Scenario { camera, scale, motion, .. } = &self.scenario;
        match motion {
            MotionSetup::Constant { vx_px_frame, vy_px_frame, omega_deg_frame, .. } => {
                let rim = omega_deg_frame.to_radians().abs() * self.scenario.radius_px();
                (vx_px_frame.hypot(*vy_px_frame) + rim) * camera.frame_rate_hz
            }
            MotionSetup::Piecewise { parts, .. } => {
                let speed = |part: &PartSetup| {
                    let [about_x, about_y] = part.tilt_deg_frame;
                    let spin = [about_x, about_y, part.omega_deg_frame].map(f64::to_radians);
                    let rim = spin.iter().map(|part| part * part).sum::<f64>().sqrt() * self.scenario.radius_px();
                    (part.vx_px_frame.hypot(part.vy_px_frame) + rim) * camera.frame_rate_hz
                };
                parts.iter().map(speed).fold(0.0, f64::max)
            }
            MotionSetup::Impact(impact) => {
                let rim = impact.omega_rad_s.abs() * self.scenario.radius_px();
                impact.vn_m_s.hypot(impact.vt_m_s) * 1e3 / scale.mm_per_px + rim
            }
        }
    }

    /// Checks that the body can be filmed and tracked.
    ///
    /// # Errors
    ///
    /// [`UsageError`] with the values in conflict, if
    /// - the scenario is invalid;
    /// - the body moves more than [`BLUR_SHARE`] of its radius during the exposure;
    /// - it moves more than `correlation.search_px` from a reference to its target;
    /// - it is a patch, or a ball in the rig and a rod in the scenario, or the reverse.
    pub(super) fn check(&self) -> Result<(), Failure> {
        let Self { config, scenario } = self;
        let refuse = |why: String| Err(UsageError(format!("{}: {why}", config.origin)).into());
        if let Err(error) = scenario.check() {
            return refuse(error.to_string());
        }
        let (camera, radius_px) = (&scenario.camera, scenario.radius_px());
        let (blur_px, max_blur_px) = (self.speed_px_s() * 1e-6 * camera.exposure_us, BLUR_SHARE * radius_px);
        if blur_px > max_blur_px {
            return refuse(format!(
                "the body moves {blur_px:.1} px while the shutter is open for {} us, more than a quarter of its \
                 radius: expose for at most {:.0} us",
                camera.exposure_us,
                camera.exposure_us * max_blur_px / blur_px
            ));
        }
        let (step_px, search_px) = (self.speed_px_s() / camera.frame_rate_hz, config.correlation.search_px);
        let step_px = step_px * f64::from(config.intervals_frames[0]);
        if step_px > f64::from(search_px) {
            return refuse(format!(
                "the body moves {step_px:.1} px from frame to frame, and correlation.search_px = {search_px}: \
                 increase search_px, or film at {:.0} Hz",
                (camera.frame_rate_hz * step_px / f64::from(search_px)).ceil()
            ));
        }
        if config.bodies[0].kind == BodyKind::Patch {
            return refuse("the body is a patch; only balls and rods can be predicted".into());
        }
        let is_rod = config.bodies[0].kind == BodyKind::Rod;
        match is_rod == scenario.body.rod.is_some() {
            true => Ok(()),
            false if is_rod => refuse(format!("the rig tracks a rod, but scenario {:?} films a ball", scenario.name)),
            false => refuse(format!("the rig tracks a ball, but scenario {:?} films a rod", scenario.name)),
        }
    }
}

/// Converts a scenario to the view of this rig's camera: its size, rate, exposure, bit depth and scale.
///
/// # Errors
///
/// The reason, when the scale of the rig is unknown.
fn adapt_to_camera(config: &Config, mut scenario: Scenario) -> Result<Scenario, String> {
    let Some(Scale::MmPerPx(mm_per_px)) = config.scale else {
        return Err("scale.mm_per_px is needed to predict the size of the body in the image".into());
    };
    let (camera, was) = (&config.camera, scenario.camera.clone());
    let setup = &mut scenario.camera;
    (setup.width_px, setup.height_px) = camera.image_px().unwrap_or((was.width_px, was.height_px));
    setup.frame_rate_hz = camera.frame_rate_hz.unwrap_or(was.frame_rate_hz);
    setup.exposure_us = camera.exposure_us.unwrap_or(was.exposure_us);
    setup.bits = camera.pixel_format.map_or(was.bits, PixelFormat::bits);
    // Grey levels of another bit depth.
    setup.noise_dn = was.noise_dn * 2f64.powi(setup.bits as i32 - was.bits as i32);
    setup.frames = (was.frames as f64 * setup.frame_rate_hz / was.frame_rate_hz).round().max(2.0) as u64;
    let middle_px = [setup.width_px, setup.height_px].map(|length| 0.5 * f64::from(length));
    scenario.body.diameter_mm = config.bodies[0].diameter_mm.unwrap_or(scenario.body.diameter_mm);
    scenario.surface.angle_deg = config.surface.angle_deg;
    let finer = scenario.scale.mm_per_px / mm_per_px;
    scenario.scale.mm_per_px = mm_per_px;
    let half = 0.5 * (scenario.camera.frames - 1) as f64;
    scenario.rescale_motion(finer, was.frame_rate_hz / scenario.camera.frame_rate_hz);
    match &mut scenario.motion {
        MotionSetup::Constant { vx_px_frame, vy_px_frame, start_px, .. } => {
            *start_px = [middle_px[0] - half * *vx_px_frame, middle_px[1] - half * *vy_px_frame];
        }
        // The path belongs to the scenario; only its start is adapted.
        MotionSetup::Piecewise { start_px, .. } => *start_px = middle_px,
        MotionSetup::Impact(impact) => {
            impact.contact_center_px = middle_px;
            let (sin, cos) = config.velocity.gravity_angle_deg.to_radians().sin_cos();
            impact.gravity_m_s2 = [cos, sin].map(|part| config.velocity.gravity_m_s2 * part);
        }
    }
    Ok(scenario)
}
