//! Built-in scenarios.

use super::{
    BodySetup, CameraSetup, ImpactSetup, LightSetup, MotionSetup, OccluderSetup, OtherSetup, PartSetup, PatternSetup,
    RingingSetup, RodSetup, ScaleSetup, Scenario, ShadeSetup, Shape, SurfaceSetup,
};
use crate::synth::physics::{Friction, NormalLaw};

/// Standard gravity, m/s^2.
const GRAVITY_M_S2: f64 = 9.806_65;

impl Scenario {
    /// The names of the built-in experiments; [`PatternSetup::PAPER`] lists those of the patterns.
    pub const BUILT_IN: [&'static str; 9] =
        ["lacrosse", "lacrosse-sphere", "tennis", "tennis-physical", "rod", "rod-ringing", "pair", "passing", "plane"];

    /// Returns the built-in scenario of this name.
    ///
    /// - `lacrosse`: the lacrosse ball of the paper on a surface tilted by 19 deg.
    /// - `lacrosse-sphere`: the same with its speckles on a sphere.
    /// - `tennis`: the tennis ball of the paper on a racket at 45 deg, with the reported spin of 5 rad/s, which needs
    ///   very little friction.
    /// - `tennis-physical`: the same with the friction of strings.
    /// - `rod`: the steel rod of the paper dropped on a printed surface, with two tapes around it.
    /// - `rod-ringing`: the same with longitudinal vibrations.
    /// - `pair`: two balls that collide in the air and lose some of their speed.
    /// - `passing`: a small ball that passes in front of a larger one, both spheres. The larger one rotates faster and
    ///   about another axis from the middle of the film on.
    /// - `plane`: a speckled plane that fills the image, drifts and rotates.
    /// - `pattern-a-I` to `pattern-f-II`: a uniform motion off every grid, with a pattern of the paper's speckle study.
    pub fn built_in(name: &str) -> Option<Self> {
        match name {
            "lacrosse" => Some(lacrosse()),
            "lacrosse-sphere" => {
                let flat = lacrosse();
                let body = BodySetup { shape: Shape::Sphere, ..flat.body };
                Some(Self { name: name.to_owned(), body, ..flat })
            }
            "pair" => Some(pair()),
            "passing" => Some(passing()),
            "plane" => Some(plane()),
            "tennis" => Some(tennis(name, 0.016)),
            "tennis-physical" => Some(tennis(name, 0.3)),
            "rod" => Some(rod(name, None)),
            "rod-ringing" => Some(rod(name, Some(ringing()))),
            _ => {
                let pattern = PatternSetup::paper(name.strip_prefix("pattern-")?)?;
                let uniform = Self::translation(0.37, 0.13, 0.35);
                Some(Self { name: name.to_owned(), body: BodySetup { pattern, ..uniform.body }, ..uniform })
            }
        }
    }

    /// Returns a ball of 120 px in 512 x 512 pixels that moves uniformly, for accuracy tests.
    ///
    /// `vx_px_frame` right, `vy_px_frame` **down**, `omega_deg_frame` counter-clockwise; 10 frames, noise 2 grey
    /// levels, uniform light. In the middle frame the ball is in the centre of the image.
    pub fn translation(vx_px_frame: f64, vy_px_frame: f64, omega_deg_frame: f64) -> Self {
        let frames = 10;
        let half = 0.5 * (frames - 1) as f64;
        // An odd fraction of a pixel, so that no frame lies on the pixel grid.
        let start_px = [255.63 - half * vx_px_frame, 255.29 - half * vy_px_frame];
        Self {
            name: "translation".to_owned(),
            seed: 1,
            camera: CameraSetup { width_px: 512, height_px: 512, exposure_us: 0.0, shot_share: 0.0, ..film(frames) },
            scale: ScaleSetup { mm_per_px: 0.5, nearer_per_s: 0.0 },
            surface: SurfaceSetup::default(),
            body: BodySetup { diameter_mm: 60.0, shape: Shape::Disc, pattern: fine_mixed(), rod: None },
            shade: ShadeSetup::default(),
            light: LightSetup::default(),
            occluder: None,
            motion: MotionSetup::Constant { vx_px_frame, vy_px_frame, omega_deg_frame, start_px },
            other: None,
        }
    }
}

impl PatternSetup {
    /// The names of the 16 patterns of the speckle study.
    pub const PAPER: [&'static str; 16] = [
        "a-I", "a-II", "a-III", "b-I", "b-II", "b-III", "c-I", "c-II", "c-III", "d-I", "d-II", "d-III", "e-I", "e-II",
        "f-I", "f-II",
    ];

    /// Returns a pattern of the speckle study: its speckle areas, density and lines (section 3 and Fig. 2 of the
    /// paper).
    ///
    /// The density of e-II is not given there; 45 % is assumed. The irregular speckles of e and f are round here.
    pub fn paper(name: &str) -> Option<Self> {
        let round = |area_px2: f64, coverage: f64| (area_px2, area_px2, coverage, 0);
        let (area_min_px2, area_max_px2, coverage, lines) = match name {
            "a-I" => round(4.0, 0.09),
            "a-II" => round(4.0, 0.17),
            "a-III" => round(4.0, 0.24),
            "b-I" => round(10.0, 0.13),
            "b-II" => round(10.0, 0.19),
            "b-III" => round(10.0, 0.31),
            "c-I" => round(20.0, 0.14),
            "c-II" => round(20.0, 0.18),
            "c-III" => round(20.0, 0.27),
            "d-I" => round(250.0, 0.22),
            "d-II" => round(250.0, 0.30),
            "d-III" => round(250.0, 0.43),
            "e-I" => (4.0, 80.0, 0.54, 0),
            "e-II" => (2.0, 40.0, 0.45, 0),
            "f-I" => (4.0, 20.0, 0.27, 4),
            "f-II" => (4.0, 80.0, 0.52, 4),
            _ => return None,
        };
        Some(Self { area_min_px2, area_max_px2, coverage, lines, line_width_px: 2.0 })
    }
}

/// Returns speckles of 2 to 40 px^2, the pattern of the lacrosse experiment.
fn fine_mixed() -> PatternSetup {
    PatternSetup { area_min_px2: 2.0, area_max_px2: 40.0, coverage: 0.45, lines: 0, line_width_px: 2.0 }
}

fn film(frames: u64) -> CameraSetup {
    CameraSetup {
        width_px: 256,
        height_px: 192,
        frame_rate_hz: 10_000.0,
        exposure_us: 20.0,
        row_time_us: 0.0,
        frames,
        bits: 8,
        noise_dn: 2.0,
        shot_share: 0.5,
        gain_spread: 0.0,
        offset_spread_dn: 0.0,
        stuck_share: 0.0,
        blur_px: 0.7,
        start_ns: 1_700_000_000_000_000_000,
    }
}

/// Returns a lacrosse ball dropped 165 mm on a surface tilted by 19 deg, filmed by a camera tilted as much.
fn lacrosse() -> Scenario {
    let tilt = 19f64.to_radians();
    Scenario {
        name: "lacrosse".to_owned(),
        seed: 1,
        camera: film(100),
        scale: ScaleSetup { mm_per_px: 0.5142, nearer_per_s: 0.0 },
        surface: SurfaceSetup { angle_deg: 0.0 },
        body: BodySetup { diameter_mm: 63.25, shape: Shape::Disc, pattern: fine_mixed(), rod: None },
        shade: ShadeSetup { ball: 0.75, speckle: 0.2, ground: 0.12, ground_texture: 0.008 },
        light: LightSetup {
            gradient_x: 0.06,
            gradient_y: -0.04,
            side: 0.08,
            side_angle_deg: 60.0,
            ..LightSetup::default()
        },
        occluder: Some(OccluderSetup {
            shade: 0.38,
            texture: 0.03,
            point_px: None,
            normal_deg: None,
            speed_px_frame: 0.0,
        }),
        motion: MotionSetup::Impact(ImpactSetup {
            contact_start_s: 1.4e-3,
            contact_center_px: [124.3, 100.6],
            vn_m_s: -1.69,
            vt_m_s: 0.57,
            omega_rad_s: 0.0,
            // The ball falls along gravity, which points to the right of the downward image axis.
            gravity_m_s2: [GRAVITY_M_S2 * tilt.sin(), -GRAVITY_M_S2 * tilt.cos()],
            mass_kg: 0.145_66,
            inertia_factor: 0.4,
            law: NormalLaw::KelvinVoigt { stiffness_n_m: 6.772e4, damping_n_s_m: 14.87 },
            friction: Some(Friction { stiffness_n_m: 1e5, damping_n_s_m: 20.0, coefficient: 0.070 }),
            ringing: None,
        }),
        other: None,
    }
}

/// Returns a tennis ball dropped 1.04 m on a racket held at 45 deg, filmed upright.
fn tennis(name: &str, coefficient: f64) -> Scenario {
    let film = CameraSetup { width_px: 256, height_px: 256, ..film(150) };
    let pattern = PatternSetup { area_min_px2: 4.0, area_max_px2: 20.0, coverage: 0.27, lines: 4, line_width_px: 2.0 };
    Scenario {
        name: name.to_owned(),
        seed: 2,
        camera: film,
        scale: ScaleSetup { mm_per_px: 0.5877, nearer_per_s: 0.0 },
        // The racket slopes down to the right: a ball from above continues along the tangent.
        surface: SurfaceSetup { angle_deg: -45.0 },
        body: BodySetup { diameter_mm: 67.0, shape: Shape::Disc, pattern, rod: None },
        shade: ShadeSetup { ball: 0.65, speckle: 0.15, ground: 0.1, ground_texture: 0.008 },
        light: LightSetup { gradient_x: -0.05, side: 0.1, side_angle_deg: 100.0, ..LightSetup::default() },
        occluder: Some(OccluderSetup {
            shade: 0.3,
            texture: 0.05,
            point_px: None,
            normal_deg: None,
            speed_px_frame: 0.0,
        }),
        motion: MotionSetup::Impact(ImpactSetup {
            contact_start_s: 4e-3,
            contact_center_px: [92.4, 122.7],
            vn_m_s: -3.2,
            vt_m_s: 3.2,
            omega_rad_s: 0.0,
            gravity_m_s2: [0.0, -GRAVITY_M_S2],
            mass_kg: 0.0567,
            inertia_factor: 0.55,
            law: NormalLaw::KelvinVoigt { stiffness_n_m: 1.042e4, damping_n_s_m: 3.615 },
            friction: Some(Friction { stiffness_n_m: 2e4, damping_n_s_m: 100.0, coefficient }),
            ringing: None,
        }),
        other: None,
    }
}

/// Returns the longitudinal vibration of a free steel rod 0.304 m long: c / 2 L.
fn ringing() -> RingingSetup {
    RingingSetup { speed_m_s: 0.05, frequency_hz: 8500.0, decay_s: 2e-3 }
}

/// Returns a steel rod of 9 mm dropped 59.9 mm on a printed surface, filmed at 40 000 frames per second.
fn rod(name: &str, ringing: Option<RingingSetup>) -> Scenario {
    let film = CameraSetup { width_px: 64, height_px: 160, frame_rate_hz: 40_000.0, exposure_us: 10.0, ..film(240) };
    let pattern = PatternSetup { area_min_px2: 4.0, area_max_px2: 20.0, coverage: 0.35, lines: 0, line_width_px: 2.0 };
    let tapes = RodSetup { tape_px: [20.0, 40.0], patch_px: [60.0, 110.0], shade: 0.08 };
    Scenario {
        name: name.to_owned(),
        seed: 3,
        camera: film,
        scale: ScaleSetup { mm_per_px: 0.3, nearer_per_s: 0.0 },
        surface: SurfaceSetup { angle_deg: 0.0 },
        body: BodySetup { diameter_mm: 9.0, shape: Shape::Disc, pattern, rod: Some(tapes) },
        shade: ShadeSetup { ball: 0.7, speckle: 0.15, ground: 0.25, ground_texture: 0.01 },
        light: LightSetup::default(),
        occluder: Some(OccluderSetup {
            shade: 0.45,
            texture: 0.02,
            point_px: None,
            normal_deg: None,
            speed_px_frame: 0.0,
        }),
        motion: MotionSetup::Impact(ImpactSetup {
            contact_start_s: 2.475e-3,
            contact_center_px: [31.4, 56.3],
            vn_m_s: -1.084,
            vt_m_s: 0.0,
            omega_rad_s: 0.0,
            gravity_m_s2: [0.0, -GRAVITY_M_S2],
            mass_kg: 0.255,
            inertia_factor: 0.5,
            law: NormalLaw::KelvinVoigt { stiffness_n_m: 1.063e6, damping_n_s_m: 166.0 },
            friction: None,
            ringing,
        }),
        other: None,
    }
}

/// Returns a segment of motion in the image plane.
fn segment(frames: f64, velocity_px_frame: [f64; 2], omega_deg_frame: f64) -> PartSetup {
    let [vx_px_frame, vy_px_frame] = velocity_px_frame;
    PartSetup { frames, vx_px_frame, vy_px_frame, omega_deg_frame, tilt_deg_frame: [0.0; 2] }
}

/// Returns two equal balls of 63 px without friction; their collision ends between two frames.
fn pair() -> Scenario {
    const RESTITUTION: f64 = 0.8;
    let (before, after) = (40.37, 80.0);
    let body = BodySetup { diameter_mm: 63.25, shape: Shape::Disc, pattern: fine_mixed(), rod: None };
    // The centres at the collision, 63.25 px apart, and the line from the first to the second.
    let (sin, cos) = 20f64.to_radians().sin_cos();
    let (line, struck_px) = ([cos, -sin], [96.3, 100.2]);
    let other_px = [struck_px[0] + 63.25 * line[0], struck_px[1] + 63.25 * line[1]];
    let (first, second): ([f64; 2], [f64; 2]) = ([0.93, 0.11], [-0.81, -0.06]);
    let closing = (first[0] - second[0]) * line[0] + (first[1] - second[1]) * line[1];
    // Equal masses share the impulse.
    let kick = 0.5 * (1.0 + RESTITUTION) * closing;
    let kicked = |speed: [f64; 2], kick: f64| [speed[0] + kick * line[0], speed[1] + kick * line[1]];
    let motion = |place: [f64; 2], speed: [f64; 2], after: [f64; 2], spin: f64| MotionSetup::Piecewise {
        start_px: [place[0] - before * speed[0], place[1] - before * speed[1]],
        parts: vec![segment(before, speed, spin), segment(60.0, after, spin)],
    };
    Scenario {
        name: "pair".to_owned(),
        seed: 4,
        camera: film((before + after) as u64),
        scale: ScaleSetup { mm_per_px: 1.0, nearer_per_s: 0.0 },
        surface: SurfaceSetup::default(),
        body: body.clone(),
        shade: ShadeSetup::default(),
        light: LightSetup { side: 0.1, side_angle_deg: 60.0, ..LightSetup::default() },
        occluder: None,
        motion: motion(struck_px, first, kicked(first, -kick), 0.31),
        other: Some(OtherSetup {
            body,
            shade: ShadeSetup { ball: 0.65, ..ShadeSetup::default() },
            motion: motion(other_px, second, kicked(second, kick), -0.23),
        }),
    }
}

/// Returns a speckled plane that fills the image, drifts and rotates.
fn plane() -> Scenario {
    let uniform = Scenario::translation(0.37, -0.23, 0.11);
    let camera = CameraSetup { width_px: 256, height_px: 192, frames: 40, ..uniform.camera };
    let body = BodySetup { diameter_mm: 190.0, shape: Shape::Plane, ..uniform.body };
    let motion = MotionSetup::Constant {
        vx_px_frame: 0.37,
        vy_px_frame: -0.23,
        omega_deg_frame: 0.11,
        start_px: [120.6, 100.3],
    };
    Scenario { name: "plane".to_owned(), camera, body, motion, ..uniform }
}

/// Returns a ball of 44 px in front of a darker one of 76 px, so that the front outline has one sign all around.
fn passing() -> Scenario {
    let pattern = PatternSetup { area_min_px2: 4.0, area_max_px2: 20.0, coverage: 0.27, lines: 0, line_width_px: 2.0 };
    let ball = |diameter_mm: f64| BodySetup { diameter_mm, shape: Shape::Sphere, pattern: pattern.clone(), rod: None };
    let tilted = PartSetup { tilt_deg_frame: [0.0, 0.4], ..segment(70.0, [0.07, -0.05], 0.63) };
    Scenario {
        name: "passing".to_owned(),
        seed: 5,
        camera: film(140),
        scale: ScaleSetup { mm_per_px: 1.0, nearer_per_s: 0.0 },
        surface: SurfaceSetup::default(),
        body: ball(76.0),
        shade: ShadeSetup { ball: 0.4, speckle: 0.12, ground: 0.05, ground_texture: 0.0 },
        light: LightSetup { side: 0.1, side_angle_deg: 60.0, ..LightSetup::default() },
        occluder: None,
        motion: MotionSetup::Piecewise {
            start_px: [128.3, 84.6],
            parts: vec![segment(70.0, [0.07, -0.05], 0.27), tilted],
        },
        other: Some(OtherSetup {
            body: ball(44.0),
            shade: ShadeSetup { ball: 0.8, ..ShadeSetup::default() },
            motion: MotionSetup::Piecewise {
                start_px: [30.4, 118.2],
                parts: vec![segment(140.0, [1.37, -0.04], -0.8)],
            },
        }),
    }
}
