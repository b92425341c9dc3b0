//! Scenarios that are always at hand.

use super::physics::{Friction, NormalLaw};
use super::scenario::{
    BodySetup, CameraSetup, ImpactSetup, LightSetup, MotionSetup, OccluderSetup, PatternSetup, ScaleSetup, Scenario,
    ShadeSetup, SurfaceSetup,
};

/// Standard gravity, m/s^2.
const GRAVITY_M_S2: f64 = 9.806_65;

impl Scenario {
    /// Names of the built-in scenarios.
    pub const BUILT_IN: [&'static str; 1] = ["lacrosse"];

    /// The built-in scenario of this name.
    pub fn built_in(name: &str) -> Option<Self> {
        match name {
            "lacrosse" => Some(lacrosse()),
            _ => None,
        }
    }

    /// A ball of 120 px in 512 x 512 pixels that moves evenly, for accuracy tests.
    ///
    /// `vx_px_frame` right, `vy_px_frame` **down**, `omega_deg_frame`
    /// counter-clockwise; 10 frames, noise 2 grey levels, even light. The
    /// middle frame has the ball in the middle of the picture.
    pub fn translation(vx_px_frame: f64, vy_px_frame: f64, omega_deg_frame: f64) -> Self {
        let frames = 10;
        let half = 0.5 * (frames - 1) as f64;
        // An odd fraction of a pixel, so that no frame sits on the pixel grid.
        let start_px = [255.63 - half * vx_px_frame, 255.29 - half * vy_px_frame];
        Self {
            name: "translation".to_owned(),
            seed: 1,
            camera: CameraSetup { width_px: 512, height_px: 512, exposure_us: 0.0, shot_share: 0.0, ..film(frames) },
            scale: ScaleSetup { mm_per_px: 0.5 },
            surface: SurfaceSetup::default(),
            body: BodySetup { diameter_mm: 60.0, pattern: fine_mixed() },
            shade: ShadeSetup::default(),
            light: LightSetup::default(),
            occluder: None,
            motion: MotionSetup::Constant { vx_px_frame, vy_px_frame, omega_deg_frame, start_px },
        }
    }
}

/// Speckles of 2 to 40 px^2, the pattern of the lacrosse experiment.
fn fine_mixed() -> PatternSetup {
    PatternSetup { area_min_px2: 2.0, area_max_px2: 40.0, coverage: 0.45 }
}

fn film(frames: u64) -> CameraSetup {
    CameraSetup {
        width_px: 256,
        height_px: 192,
        frame_rate_hz: 10_000.0,
        exposure_us: 20.0,
        frames,
        bits: 8,
        noise_dn: 2.0,
        shot_share: 0.5,
        blur_px: 0.7,
        start_ns: 1_700_000_000_000_000_000,
    }
}

/// A lacrosse ball dropped 165 mm on a flat tilted by 19 deg, filmed by a camera tilted as much.
fn lacrosse() -> Scenario {
    let tilt = 19f64.to_radians();
    Scenario {
        name: "lacrosse".to_owned(),
        seed: 1,
        camera: film(100),
        scale: ScaleSetup { mm_per_px: 0.5142 },
        surface: SurfaceSetup { angle_deg: 0.0 },
        body: BodySetup { diameter_mm: 63.25, pattern: fine_mixed() },
        shade: ShadeSetup { ball: 0.75, speckle: 0.2, ground: 0.12, ground_texture: 0.008 },
        light: LightSetup { gradient_x: 0.06, gradient_y: -0.04, side: 0.08, side_angle_deg: 60.0, limb: 0.0 },
        occluder: Some(OccluderSetup { shade: 0.38, texture: 0.03, point_px: None, normal_deg: None }),
        motion: MotionSetup::Impact(ImpactSetup {
            contact_start_s: 1.4e-3,
            contact_center_px: [124.3, 100.6],
            vn_m_s: -1.69,
            vt_m_s: 0.57,
            omega_rad_s: 0.0,
            // The ball falls along gravity, to the right of the picture's downward axis.
            gravity_m_s2: [GRAVITY_M_S2 * tilt.sin(), -GRAVITY_M_S2 * tilt.cos()],
            mass_kg: 0.145_66,
            inertia_factor: 0.4,
            law: NormalLaw::KelvinVoigt { stiffness_n_m: 6.772e4, damping_n_s_m: 14.87 },
            friction: Some(Friction { stiffness_n_m: 1e5, damping_n_s_m: 20.0, coefficient: 0.070 }),
        }),
    }
}
