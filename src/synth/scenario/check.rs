//! The ranges of all values of a scenario.

use super::{ImpactSetup, Layout, LightSetup, MotionSetup, OccluderSetup, PartSetup, Scenario, ScenarioError, Shape};
use crate::synth::physics::NormalLaw;

/// The maximum diameter of a plane, px: twice the diagonal of the largest image.
const MAX_PLANE_PX: f64 = 24_000.0;

impl Scenario {
    /// Checks every value against its range.
    ///
    /// # Errors
    ///
    /// Returns [`ScenarioError`] for the first value that is out of range.
    pub fn check(&self) -> Result<(), ScenarioError> {
        self.check_camera()?;
        self.check_scale()?;
        check_range("surface.angle_deg", self.surface.angle_deg, -360.0, 360.0)?;
        self.check_body()?;
        self.check_light()?;
        self.check_motion()?;
        let Some(other) = &self.other else { return Ok(()) };
        if self.body.rod.is_some() || other.body.rod.is_some() {
            return Err(ScenarioError::Misplaced { key: "other", why: "a rod is filmed alone" });
        }
        let single = self.second_ball_alone(other);
        let checked = single.check_body().and_then(|()| single.check_light()).and_then(|()| single.check_motion());
        checked.map_err(|error| ScenarioError::Other(Box::new(error)))
    }

    /// Checks the scale, and that only a single flat body approaches the camera.
    ///
    /// # Errors
    ///
    /// Returns [`ScenarioError`] for the first value that is out of range or does not fit the rest.
    fn check_scale(&self) -> Result<(), ScenarioError> {
        let (scale, key) = (&self.scale, "scale.nearer_per_s");
        check_range("scale.mm_per_px", scale.mm_per_px, 1e-6, 1e3)?;
        check_range(key, scale.nearer_per_s, -1e3, 1e3)?;
        let is_flat = self.body.shape != Shape::Sphere && self.body.rod.is_none() && self.other.is_none();
        if scale.nearer_per_s.abs() > 0.0 && !is_flat {
            return Err(ScenarioError::Misplaced { key, why: "spheres, rods and pairs of balls keep their distance" });
        }
        // From half to one and a half times the distance, because the whole film uses speckles of one size.
        let film_s = self.camera.frames as f64 / self.camera.frame_rate_hz;
        check_range("scale.nearer_per_s x length of the film", scale.nearer_per_s * film_s, -0.5, 0.5)
    }

    /// Checks the motion, and that it suits the body and the occluder.
    ///
    /// # Errors
    ///
    /// Returns [`ScenarioError`] for the first value that is out of range or does not fit the rest.
    fn check_motion(&self) -> Result<(), ScenarioError> {
        let check_occluder_position = || match &self.occluder {
            Some(occluder) if occluder.point_px.is_none() => Err(ScenarioError::OccluderPlace),
            _ => Ok(()),
        };
        match &self.motion {
            MotionSetup::Constant { vx_px_frame, vy_px_frame, omega_deg_frame, start_px } => {
                check_range("motion.vx_px_frame", *vx_px_frame, -1e4, 1e4)?;
                check_range("motion.vy_px_frame", *vy_px_frame, -1e4, 1e4)?;
                check_range("motion.omega_deg_frame", *omega_deg_frame, -180.0, 180.0)?;
                check_position("motion.start_px", *start_px)?;
                check_occluder_position()
            }
            MotionSetup::Piecewise { start_px, parts } => {
                check_position("motion.start_px", *start_px)?;
                check_range("motion.parts (number)", parts.len() as f64, 1.0, 1000.0)?;
                parts.iter().try_for_each(PartSetup::check)?;
                let tilts = parts.iter().any(|part| part.tilt_deg_frame.iter().any(|tilt| tilt.abs() > 0.0));
                if tilts && self.body.shape != Shape::Sphere {
                    let why = "it takes body.shape = \"sphere\", a disc faces the camera";
                    return Err(ScenarioError::Misplaced { key: "motion.parts.tilt_deg_frame", why });
                }
                check_occluder_position()
            }
            MotionSetup::Impact(_) if self.body.shape == Shape::Plane => {
                let why = "a plane strikes nothing: \"constant\" or \"piecewise\"";
                Err(ScenarioError::Misplaced { key: "motion.kind", why })
            }
            MotionSetup::Impact(impact) => impact.check(),
        }
    }

    /// Checks the camera, and that all stamps fit 64 bits.
    ///
    /// # Errors
    ///
    /// Returns [`ScenarioError`] for the first value that is out of range or does not fit the rest.
    fn check_camera(&self) -> Result<(), ScenarioError> {
        let camera = &self.camera;
        check_range("camera.width_px", f64::from(camera.width_px), 16.0, 8192.0)?;
        check_range("camera.height_px", f64::from(camera.height_px), 16.0, 8192.0)?;
        check_range("camera.frame_rate_hz", camera.frame_rate_hz, 1e-3, 1e7)?;
        check_range("camera.exposure_us", camera.exposure_us, 0.0, 1e6 / camera.frame_rate_hz)?;
        let row_us = 1e6 / camera.frame_rate_hz / f64::from(camera.height_px);
        check_range("camera.row_time_us", camera.row_time_us, -row_us.min(1000.0), row_us.min(1000.0))?;
        check_range("camera.frames", camera.frames as f64, 1.0, 1e8)?;
        if ![8, 10, 12, 16].contains(&camera.bits) {
            return Err(out_of_range("camera.bits", camera.bits, "8, 10, 12 or 16"));
        }
        check_range("camera.noise_dn", camera.noise_dn, 0.0, 0.25 * 2f64.powi(camera.bits as i32))?;
        check_range("camera.shot_share", camera.shot_share, 0.0, 1.0)?;
        check_range("camera.gain_spread", camera.gain_spread, 0.0, 0.1)?;
        check_range("camera.offset_spread_dn", camera.offset_spread_dn, 0.0, 2f64.powi(camera.bits as i32 - 4))?;
        check_range("camera.stuck_share", camera.stuck_share, 0.0, 0.1)?;
        check_range("camera.blur_px", camera.blur_px, 0.3, 5.0)?;
        check_range("camera.gamma", camera.gamma, 0.2, 1.0)?;
        // The last stamp, at 1e8 frames of 1000 s, must still fit 64 bits.
        check_range("camera.start_ns", camera.start_ns as f64, 0.0, 9e18)?;
        check_range("camera.frames / camera.frame_rate_hz", camera.frames as f64 / camera.frame_rate_hz, 0.0, 9e9)
    }

    /// Checks size, paint, felt and rod of the body.
    ///
    /// # Errors
    ///
    /// Returns [`ScenarioError`] for the first value that is out of range or does not fit the rest.
    fn check_body(&self) -> Result<(), ScenarioError> {
        let diameter_mm = self.body.diameter_mm;
        let (mm_per_px, camera) = (self.scale.mm_per_px, &self.camera);
        if diameter_mm.is_nan() || diameter_mm < 8.0 * mm_per_px {
            let range = format!("at least 8 px, {} mm at this scale", 8.0 * mm_per_px);
            return Err(out_of_range("body.diameter_mm", diameter_mm, range));
        }
        let (width_px, height_px) = (camera.width_px, camera.height_px);
        let diameter_px = 2.0 * self.radius_px();
        if self.body.shape == Shape::Plane {
            check_range("body.diameter_mm / scale.mm_per_px", diameter_px, 8.0, MAX_PLANE_PX)?;
        } else if diameter_px > f64::from(width_px.min(height_px)) {
            return Err(ScenarioError::BallTooLarge { diameter_mm, mm_per_px, diameter_px, width_px, height_px });
        }
        let pattern = &self.body.pattern;
        self.check_rod()?;
        let largest = self.speckled_px2() / 20.0;
        check_range("body.pattern.area_min_px2", pattern.area_min_px2, 0.5, largest)?;
        check_range("body.pattern.area_max_px2", pattern.area_max_px2, pattern.area_min_px2, largest)?;
        check_range("body.pattern.coverage", pattern.coverage, 0.0, 0.6)?;
        check_range("body.pattern.lines", f64::from(pattern.lines), 0.0, 20.0)?;
        check_range("body.pattern.line_width_px", pattern.line_width_px, 0.5, 10.0)?;
        check_range("body.pattern.repeats", f64::from(pattern.repeats), 1.0, 64.0)?;
        if pattern.lines > 0 && self.body.shape == Shape::Sphere {
            let range = "0 with body.shape = \"sphere\", on which nothing is straight";
            return Err(out_of_range("body.pattern.lines", pattern.lines, range));
        }
        if pattern.lines > 0 && pattern.layout != Layout::Random {
            return Err(out_of_range("body.pattern.lines", pattern.lines, "0 with a regular body.pattern.layout"));
        }
        if pattern.layout == Layout::Football && self.body.shape != Shape::Sphere {
            let why = "\"football\" takes body.shape = \"sphere\"";
            return Err(ScenarioError::Misplaced { key: "body.pattern.layout", why });
        }
        self.check_fuzz()
    }

    /// Checks the felt of a ball and that the body can have felt.
    ///
    /// # Errors
    ///
    /// Returns [`ScenarioError`] for the first value that is out of range or does not fit the rest.
    fn check_fuzz(&self) -> Result<(), ScenarioError> {
        let (fuzz_px, key) = (self.body.fuzz_px, "body.fuzz_px");
        check_range(key, fuzz_px, 0.0, (0.125 * self.radius_px()).min(4.0))?;
        let why = match () {
            () if fuzz_px <= 0.0 => return Ok(()),
            () if self.body.shape == Shape::Plane => "a plane has no rim",
            () if self.other.is_some() => "two balls have sharp rims",
            () => return Ok(()),
        };
        Err(ScenarioError::Misplaced { key, why })
    }

    /// Returns the area of the disc or patch that carries the speckles, px^2.
    fn speckled_px2(&self) -> f64 {
        let radius = self.radius_px();
        let disc = std::f64::consts::PI * radius * radius;
        self.body.rod.as_ref().map_or(disc, |rod| 2.0 * radius * (rod.patch_px[1] - rod.patch_px[0]))
    }

    /// Checks a rod and the settings that a rod does not support; without a rod, that nothing needs one.
    ///
    /// # Errors
    ///
    /// Returns [`ScenarioError`] for the first value that is out of range or does not fit the rest.
    fn check_rod(&self) -> Result<(), ScenarioError> {
        let Some(rod) = &self.body.rod else {
            let ringing = matches!(&self.motion, MotionSetup::Impact(impact) if impact.ringing.is_some());
            return if ringing { Err(ScenarioError::RodOnly("motion.ringing needs one")) } else { Ok(()) };
        };
        check_range("body.rod.tape_px", rod.tape_px[0], 1.0, 8192.0)?;
        check_range("body.rod.tape_px", rod.tape_px[1], rod.tape_px[0] + 1.0, 8192.0)?;
        check_range("body.rod.patch_px", rod.patch_px[0], rod.tape_px[1] + 1.0, 8192.0)?;
        check_range("body.rod.patch_px", rod.patch_px[1], rod.patch_px[0] + 4.0, 8192.0)?;
        check_range("body.rod.shade", rod.shade, 0.0, 1.0)?;
        let (turns, slides) = match &self.motion {
            MotionSetup::Constant { omega_deg_frame, .. } => (omega_deg_frame.abs() > 0.0, false),
            MotionSetup::Piecewise { parts, .. } => (parts.iter().any(|part| part.omega_deg_frame.abs() > 0.0), false),
            MotionSetup::Impact(impact) => (impact.omega_rad_s.abs() > 0.0, impact.friction.is_some()),
        };
        let edge = self.occluder.as_ref();
        for (wrong, why) in [
            (self.body.shape != Shape::Disc, "body.shape must be left out"),
            (turns, "its spin must be 0"),
            (slides, "motion.friction must be left out"),
            (self.surface.angle_deg.abs() > 0.0, "surface.angle_deg must be 0"),
            (self.body.pattern.lines > 0, "body.pattern.lines must be 0"),
            (self.body.pattern.layout != Layout::Random, "body.pattern.layout must be left out"),
            (self.body.fuzz_px > 0.0, "body.fuzz_px must be 0"),
            (self.light.bounce > 0.0, "light.bounce must be 0"),
            (edge.is_some_and(|edge| edge.shadow > 0.0), "occluder.shadow must be 0"),
            (self.light.side > 0.0 || self.light.limb > 0.0, "light.side and light.limb must be 0"),
            (edge.is_some_and(|edge| edge.normal_deg.is_some()), "occluder.normal_deg must be left out"),
        ] {
            if wrong {
                return Err(ScenarioError::RodOnly(why));
            }
        }
        Ok(())
    }

    /// Checks the settings of a flat that the camera sees from above.
    ///
    /// # Errors
    ///
    /// Returns [`ScenarioError`] for the first value that is out of range or does not fit the rest.
    fn check_flat(&self, flat: &OccluderSetup) -> Result<(), ScenarioError> {
        check_range("occluder.behind_px", flat.behind_px, 0.0, 8192.0)?;
        check_range("occluder.shadow", flat.shadow, 0.0, 1.0)?;
        check_range("occluder.mirror", flat.mirror, 0.0, 0.9)?;
        let is_lit = flat.shadow > 0.0 || flat.mirror > 0.0;
        let is_rolling = self.camera.row_time_us.abs() > 0.0;
        for (wrong, key, why) in [
            (flat.speed_px_frame.abs() > 0.0 && is_lit, "occluder.shadow", "a moving edge shows nothing of the body"),
            (flat.speed_px_frame.abs() > 0.0 && flat.behind_px > 0.0, "occluder.behind_px", "the edge moves"),
            (self.body.shape == Shape::Plane && is_lit, "occluder.shadow", "a plane stands on nothing"),
            (flat.mirror > 0.0 && is_rolling, "occluder.mirror", "camera.row_time_us must be 0"),
        ] {
            if wrong {
                return Err(ScenarioError::Misplaced { key, why });
            }
        }
        Ok(())
    }

    /// Checks grey levels, light and occluder.
    ///
    /// # Errors
    ///
    /// Returns [`ScenarioError`] for the first value that is out of range or does not fit the rest.
    fn check_light(&self) -> Result<(), ScenarioError> {
        check_range("shade.ball", self.shade.ball, 0.0, 1.0)?;
        check_range("shade.speckle", self.shade.speckle, 0.0, 1.0)?;
        check_range("shade.ground", self.shade.ground, 0.0, 1.0)?;
        check_range("shade.ground_texture", self.shade.ground_texture, 0.0, 0.2)?;
        check_range("light.gradient_x", self.light.gradient_x, -0.9, 0.9)?;
        check_range("light.gradient_y", self.light.gradient_y, -0.9, 0.9)?;
        check_range("light.side", self.light.side, 0.0, 0.9)?;
        check_range("light.side_angle_deg", self.light.side_angle_deg, -360.0, 360.0)?;
        check_range("light.limb", self.light.limb, 0.0, 0.9)?;
        self.light.check_lamp()?;
        if self.light.is_directed() && self.body.shape == Shape::Plane {
            let why = "a plane is not round: light.bounce and light.highlight must be 0 as well";
            return Err(ScenarioError::Misplaced { key: "light.lamp", why });
        }
        check_range("light.vignette", self.light.vignette, 0.0, 0.9)?;
        check_range("light.flicker", self.light.flicker, 0.0, 0.9)?;
        check_range("light.flicker_hz", self.light.flicker_hz, 0.0, 1e6)?;
        let Some(occluder) = &self.occluder else { return Ok(()) };
        check_range("occluder.shade", occluder.shade, 0.0, 1.0)?;
        check_range(
            "occluder.texture",
            occluder.texture,
            0.0,
            if occluder.speed_px_frame.abs() > 0.0 { 0.0 } else { 0.2 },
        )?;
        check_range("occluder.speed_px_frame", occluder.speed_px_frame, -1e4, 1e4)?;
        check_range("occluder.normal_deg", occluder.normal_deg.unwrap_or(0.0), -360.0, 360.0)?;
        self.check_flat(occluder)?;
        check_position("occluder.point_px", occluder.point_px.unwrap_or_default())
    }
}

impl LightSetup {
    /// Checks the lamp and its reflection.
    ///
    /// # Errors
    ///
    /// Returns [`ScenarioError`] for the first value that is out of range or does not fit the rest.
    fn check_lamp(&self) -> Result<(), ScenarioError> {
        check_range("light.lamp_elevation_deg", self.lamp_elevation_deg, 0.0, 90.0)?;
        check_range("light.lamp", self.lamp, 0.0, 1.0)?;
        check_range("light.bounce", self.bounce, 0.0, 0.9)?;
        check_range("light.highlight", self.highlight, 0.0, 10.0)?;
        check_range("light.highlight_deg", self.highlight_deg, 1.0, 45.0)
    }
}

impl PartSetup {
    /// Checks length, velocity and spin of a segment.
    ///
    /// # Errors
    ///
    /// Returns [`ScenarioError`] for the first value that is out of range or does not fit the rest.
    fn check(&self) -> Result<(), ScenarioError> {
        check_range("motion.parts.frames", self.frames, 1e-6, 1e8)?;
        check_range("motion.parts.vx_px_frame", self.vx_px_frame, -1e4, 1e4)?;
        check_range("motion.parts.vy_px_frame", self.vy_px_frame, -1e4, 1e4)?;
        check_range("motion.parts.omega_deg_frame", self.omega_deg_frame, -180.0, 180.0)?;
        check_range("motion.parts.tilt_deg_frame", self.tilt_deg_frame[0], -180.0, 180.0)?;
        check_range("motion.parts.tilt_deg_frame", self.tilt_deg_frame[1], -180.0, 180.0)
    }
}

impl ImpactSetup {
    /// Checks the values of a collision: its place and motion, the ball, the law, the ringing and the friction.
    ///
    /// # Errors
    ///
    /// Returns [`ScenarioError`] for the first value that is out of range or does not fit the rest.
    fn check(&self) -> Result<(), ScenarioError> {
        check_range("motion.contact_start_s", self.contact_start_s, 0.0, 1e3)?;
        check_position("motion.contact_center_px", self.contact_center_px)?;
        check_range("motion.vn_m_s", self.vn_m_s, -1e3, -1e-3)?;
        check_range("motion.vt_m_s", self.vt_m_s, -1e3, 1e3)?;
        check_range("motion.omega_rad_s", self.omega_rad_s, -1e5, 1e5)?;
        check_range("motion.gravity_m_s2", self.gravity_m_s2[0], -100.0, 100.0)?;
        check_range("motion.gravity_m_s2", self.gravity_m_s2[1], -100.0, 100.0)?;
        check_range("motion.mass_kg", self.mass_kg, 1e-6, 1e3)?;
        check_range("motion.inertia_factor", self.inertia_factor, 0.1, 1.0)?;
        match self.law {
            NormalLaw::KelvinVoigt { stiffness_n_m, damping_n_s_m } => {
                check_range("motion.law.stiffness_n_m", stiffness_n_m, 1.0, 1e10)?;
                check_range("motion.law.damping_n_s_m", damping_n_s_m, 0.0, 1e6)?;
            }
            NormalLaw::HuntCrossley { stiffness_n_m15, damping_s_m } => {
                check_range("motion.law.stiffness_n_m15", stiffness_n_m15, 1.0, 1e12)?;
                check_range("motion.law.damping_s_m", damping_s_m, 0.0, 1e3)?;
            }
        }
        if let Some(ringing) = &self.ringing {
            check_range("motion.ringing.speed_m_s", ringing.speed_m_s, -1e3, 1e3)?;
            check_range("motion.ringing.frequency_hz", ringing.frequency_hz, 1.0, 1e7)?;
            check_range("motion.ringing.decay_s", ringing.decay_s, 1e-6, 1e3)?;
        }
        let Some(friction) = self.friction else { return Ok(()) };
        check_range("motion.friction.stiffness_n_m", friction.stiffness_n_m, 1.0, 1e8)?;
        // A patch that relaxes faster could not be integrated in steps of 0.05 us.
        let min = 1e-6 * friction.stiffness_n_m;
        check_range("motion.friction.damping_n_s_m", friction.damping_n_s_m, min, 1e4)?;
        check_range("motion.friction.coefficient", friction.coefficient, 0.0, 10.0)
    }
}

/// The keys that hold whole numbers, with their ranges.
const INTEGERS: [(&str, i64, i64); 9] = [
    ("seed", 0, i64::MAX),
    ("camera.width_px", 16, 8192),
    ("camera.height_px", 16, 8192),
    ("camera.frames", 1, 100_000_000),
    ("camera.start_ns", 0, 9_000_000_000_000_000_000),
    ("body.pattern.lines", 0, 20),
    ("other.body.pattern.lines", 0, 20),
    ("body.pattern.repeats", 1, 64),
    ("other.body.pattern.repeats", 1, 64),
];

/// Rejects whole numbers out of range before deserialization does, which would not state key and range.
///
/// # Errors
///
/// Returns [`ScenarioError::OutOfRange`] for the first of [`INTEGERS`] that is out of range.
pub(super) fn check_integers(scenario: &toml::Table) -> Result<(), ScenarioError> {
    for (key, low, high) in INTEGERS {
        let mut words = key.split('.');
        let first = words.next().and_then(|word| scenario.get(word));
        let value = words.fold(first, |value, word| value.and_then(|value| value.get(word)));
        if let Some(value) = value.and_then(toml::Value::as_integer).filter(|value| !(low..=high).contains(value)) {
            return Err(out_of_range(key, value, format!("{low} to {high}")));
        }
    }
    Ok(())
}

/// Returns the error for a value out of its range.
fn out_of_range(key: &'static str, value: impl ToString, range: impl Into<String>) -> ScenarioError {
    ScenarioError::OutOfRange { key, value: value.to_string(), range: range.into() }
}

/// Checks that a value lies in its range, both ends included. A NaN lies in no range.
///
/// # Errors
///
/// Returns [`ScenarioError::OutOfRange`].
fn check_range(key: &'static str, value: f64, low: f64, high: f64) -> Result<(), ScenarioError> {
    if (low..=high).contains(&value) { Ok(()) } else { Err(out_of_range(key, value, format!("{low} to {high}"))) }
}

/// Checks that both coordinates of a position lie within 100,000 px of the centre of the first pixel.
///
/// # Errors
///
/// Returns [`ScenarioError::OutOfRange`] with `key`.
fn check_position(key: &'static str, place_px: [f64; 2]) -> Result<(), ScenarioError> {
    check_range(key, place_px[0], -1e5, 1e5)?;
    check_range(key, place_px[1], -1e5, 1e5)
}
