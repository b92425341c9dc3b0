//! Draws random scenes with their rig files.

use ricochet::config::BodyKind;
use ricochet::numeric::{Stream, key};
use ricochet::synth::physics::{Friction, NormalLaw};
use ricochet::synth::{
    ImpactSetup, Layout, MotionSetup, OccluderSetup, PatternSetup, RodSetup, Scenario, Shape, SimulatedFilm,
};
use std::f64::consts::PI;

/// The purpose of the random stream of the scenes.
const SCENES: u64 = 90;
const MM_PER_PX: f64 = 0.5;
const RATE_HZ: f64 = 1000.0;
/// The speed of 1 px per frame, m/s.
const M_S_PER_PX: f64 = 1e-3 * MM_PER_PX * RATE_HZ;
const GRAVITY_M_S2: f64 = 9.80665;

/// A scene, with the rig file that a user would write for it.
pub struct Scene {
    pub seed: u64,
    pub kind: BodyKind,
    /// The properties that the table lists.
    pub tags: Vec<&'static str>,
    pub scenario: Scenario,
    pub rig: String,
    /// The quality of an H.264 film, if the frames are compressed.
    pub crf: Option<u32>,
    /// The radius of a patch, px; 0 for others.
    pub patch_radius_px: f64,
}

impl Scene {
    /// Draws the scene of a seed. What cannot be drawn, such as speckles that do not fit, is drawn again.
    pub fn draw(seed: u64) -> Self {
        let attempts = (0..).map(|attempt| Drawing::new(seed, attempt).scene());
        attempts.into_iter().find(|scene| SimulatedFilm::new(&scene.scenario).is_ok()).unwrap()
    }
}

/// A scene that is being drawn.
struct Drawing {
    seed: u64,
    stream: Stream,
    scenario: Scenario,
    tags: Vec<&'static str>,
    patch_radius_px: f64,
}

impl Drawing {
    fn new(seed: u64, attempt: u64) -> Self {
        let mut scenario = Scenario::translation(0.0, 0.0, 0.0);
        (scenario.seed, scenario.scale.mm_per_px, scenario.camera.frame_rate_hz) = (seed, MM_PER_PX, RATE_HZ);
        Self { seed, stream: Stream::new(key(seed, SCENES, attempt)), scenario, tags: Vec::new(), patch_radius_px: 0.0 }
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.stream.between(low, high)
    }

    fn chance(&mut self, share: f64) -> bool {
        self.stream.uniform() < share
    }

    fn count(&mut self, low: u32, high: u32) -> u32 {
        self.between(f64::from(low), f64::from(high) + 1.0) as u32
    }

    fn side(&mut self) -> f64 {
        if self.chance(0.5) { 1.0 } else { -1.0 }
    }

    fn tag(&mut self, tag: &'static str) {
        self.tags.push(tag);
    }

    fn scene(mut self) -> Scene {
        let kind = match self.stream.uniform() {
            part if part < 0.74 => BodyKind::Ball,
            part if part < 0.87 => BodyKind::Patch,
            _ => BodyKind::Rod,
        };
        self.tag(kind.as_str());
        self.camera();
        let body = match kind {
            BodyKind::Ball => self.ball(),
            BodyKind::Patch => self.patch(),
            BodyKind::Rod => self.rod(),
        };
        let gamma = self.gamma();
        let crf = (self.scenario.camera.bits == 8 && self.chance(0.2)).then(|| self.count(16, 28));
        self.tag(if crf.is_some() { "H.264" } else { "raw frames" });
        let surface = if self.scenario.occluder.is_some() { "[surface]\nangle_deg = 0\n" } else { "" };
        let falls = matches!(self.scenario.motion, MotionSetup::Impact(_));
        let gravity = if falls { format!("[velocity]\ngravity_m_s2 = {GRAVITY_M_S2}\n") } else { String::new() };
        let rig = format!(
            "[camera]\nsource = \"simulated\"\n{gamma}[scale]\nmm_per_px = {MM_PER_PX}\n{surface}{gravity}[[body]]\n{body}\n"
        );
        Scene {
            seed: self.seed,
            kind,
            tags: self.tags,
            scenario: self.scenario,
            rig,
            crf,
            patch_radius_px: self.patch_radius_px,
        }
    }

    fn camera(&mut self) {
        let size = [0; 2].map(|_| self.between(160.0, 216.0) as u32 / 2 * 2);
        let (frames, bits) = (self.count(40, 48), if self.chance(0.8) { 8 } else { 12 });
        let (noise, shot_share) = (self.between(0.5, 4.0), self.between(0.0, 1.0));
        let (blur_px, exposure) = (self.between(0.5, 1.4), self.between(0.0, 0.5));
        let camera = &mut self.scenario.camera;
        ([camera.width_px, camera.height_px], camera.frames, camera.bits) = (size, u64::from(frames), bits);
        (camera.noise_dn, camera.shot_share) = (noise * 2f64.powi(bits as i32 - 8), shot_share);
        (camera.blur_px, camera.exposure_us) = (blur_px, exposure * 1e6 / RATE_HZ);
    }

    /// Draws the tone curve. Half of those who have one write it into the rig file.
    fn gamma(&mut self) -> String {
        if self.chance(0.75) {
            return String::new();
        }
        let gamma = (100.0 * self.between(0.45, 0.85)).round() / 100.0;
        self.scenario.camera.gamma = gamma;
        let is_known = self.chance(0.5);
        self.tag(if is_known { "gamma, in the rig file" } else { "gamma, unknown" });
        if is_known { format!("gamma = {gamma}\n") } else { String::new() }
    }

    fn ball(&mut self) -> String {
        let radius_px = 12.0 * (36.0_f64 / 12.0).powf(self.stream.uniform());
        self.tag(if radius_px < 20.0 { "radius below 20 px" } else { "radius from 20 px" });
        self.scenario.body.diameter_mm = 2.0 * radius_px * MM_PER_PX;
        self.scenario.body.shape = if self.chance(0.75) { Shape::Sphere } else { Shape::Disc };
        self.texture(radius_px);
        self.shades();
        self.room_light();
        self.body_light();
        if self.chance(0.15) {
            self.scenario.body.fuzz_px = self.between(0.3, 1.5).min(0.12 * radius_px);
            self.tag("fuzzy rim");
        }
        if self.chance(0.4) {
            self.impact(radius_px);
        } else {
            self.flight(radius_px);
        }
        format!("name = \"ball\"\nkind = \"ball\"\ndiameter_mm = {:.3}", 2.0 * radius_px * MM_PER_PX)
    }

    fn texture(&mut self, radius_px: f64) {
        let area = PI * radius_px * radius_px;
        let part = self.stream.uniform();
        let is_sphere = self.scenario.body.shape == Shape::Sphere;
        let random = PatternSetup { coverage: 0.0, ..PatternSetup::default() };
        let (tag, pattern) = match part {
            _ if part < 0.3 => {
                let area_max_px2 = self.between(6.0, 30.0).min(0.045 * area);
                let coverage = self.between(0.25, 0.45);
                ("speckled", PatternSetup { area_min_px2: 2.0, area_max_px2, coverage, ..random })
            }
            _ if part < 0.45 => {
                let area_max_px2 = self.between(0.012, 0.03) * area;
                let coverage = self.between(0.04, 0.1);
                ("few marks", PatternSetup { area_min_px2: 0.6 * area_max_px2, area_max_px2, coverage, ..random })
            }
            _ if part < 0.65 => ("plain", random),
            _ if part < 0.7 && !is_sphere => {
                let lines = self.count(2, 4);
                ("seams", PatternSetup { lines, line_width_px: self.between(1.5, 3.0), ..random })
            }
            _ => {
                let (layout, tag) = match self.stream.uniform() {
                    part if part < 0.25 => (Layout::Stripes, "stripes"),
                    part if part < 0.5 => (Layout::Sectors, "sectors"),
                    part if part < 0.75 || !is_sphere => (Layout::Dots, "dots"),
                    _ => (Layout::Football, "football"),
                };
                let (coverage, area_max_px2) = (self.between(0.2, 0.5), self.between(0.008, 0.03) * area);
                let repeats = self.count(3, (radius_px / 3.0).min(10.0) as u32);
                (tag, PatternSetup { layout, coverage, area_min_px2: 2.0, area_max_px2, repeats, ..random })
            }
        };
        self.scenario.body.pattern = pattern;
        self.tag(tag);
    }

    /// Draws a bright ball on dark ground, a dark one on bright ground, or one that hardly differs.
    fn shades(&mut self) {
        let (bright, dark) = (self.between(0.45, 0.85), self.between(0.04, 0.25));
        let is_bright = self.chance(0.7);
        let (ball, mut ground) = if is_bright { (bright, dark) } else { (dark, bright) };
        if self.chance(0.12) {
            ground = (ball + self.side() * self.between(0.02, 0.1)).clamp(0.02, 0.9);
            self.tag("ground as bright as the ball");
        }
        let speckle = if is_bright { self.between(0.04, 0.25) } else { self.between(0.4, 0.8) };
        let ground_texture = if self.chance(0.5) { self.between(0.0, 0.04) } else { 0.0 };
        let shade = &mut self.scenario.shade;
        (shade.ball, shade.ground, shade.speckle, shade.ground_texture) = (ball, ground, speckle, ground_texture);
    }

    fn room_light(&mut self) {
        let [x, y] = [0; 2].map(|_| self.between(-0.2, 0.2));
        (self.scenario.light.gradient_x, self.scenario.light.gradient_y) = (x, y);
        self.scenario.light.vignette = self.between(0.0, 0.25);
        if self.chance(0.15) {
            (self.scenario.light.flicker, self.scenario.light.flicker_hz) = (self.between(0.0, 0.05), 100.0);
            self.tag("flicker");
        }
    }

    fn body_light(&mut self) {
        let light = &mut self.scenario.light;
        light.side_angle_deg = self.stream.between(10.0, 170.0);
        light.lamp_elevation_deg = self.stream.between(5.0, 85.0);
        if self.chance(0.6) {
            (self.scenario.light.lamp, self.scenario.light.bounce) = (self.between(0.3, 0.9), self.between(0.0, 0.3));
            self.tag("lamp from one side");
        } else {
            self.tag("even light");
        }
        if self.chance(0.35) {
            self.scenario.light.highlight = 0.15 * 20_f64.powf(self.stream.uniform());
            self.scenario.light.highlight_deg = self.between(2.0, 10.0);
            self.tag("highlight");
        }
    }

    /// Draws the flat: from the side or from above, with shadow and mirror image.
    fn flat(&mut self) -> OccluderSetup {
        let mut flat = OccluderSetup { shade: self.between(0.1, 0.7), ..OccluderSetup::default() };
        if self.chance(0.5) {
            flat.texture = self.between(0.0, 0.03);
        }
        if self.chance(0.6) {
            flat.behind_px = if self.scenario.body.rod.is_some() { 6.0 } else { self.between(3.0, 25.0) };
        }
        if self.scenario.body.rod.is_none() && self.chance(0.6) {
            flat.shadow = self.between(0.3, 1.0);
            self.tag("shadow");
        }
        if self.chance(0.4) {
            flat.mirror = self.between(0.05, 0.5);
            self.tag("mirror image");
        }
        flat
    }

    fn spin(&mut self) -> f64 {
        let most = if self.chance(0.3) { 1.0 } else { 10.0 };
        self.between(-most, most)
    }

    fn middle_px(&mut self) -> [f64; 2] {
        let camera = &self.scenario.camera;
        let [width, height] = [camera.width_px, camera.height_px].map(f64::from);
        [0.5 * width + self.between(-8.0, 8.0), 0.5 * height + self.between(-8.0, 8.0)]
    }

    fn flight(&mut self, radius_px: f64) {
        self.tag("flight");
        let most = 120.0 / self.scenario.camera.frames as f64;
        let (vx, vy) = (self.between(-most, most), self.between(-most, most));
        let omega_deg_frame = self.spin();
        let [x, y] = self.middle_px();
        let half = 0.5 * self.scenario.camera.frames as f64;
        let start_px = [x - half * vx, y - half * vy];
        if self.chance(0.35) {
            let below_px = start_px[1].max(y + half * vy) + radius_px + self.between(2.0, 30.0);
            let point_px = Some([x, below_px]);
            self.scenario.occluder = Some(OccluderSetup { point_px, normal_deg: Some(90.0), ..self.flat() });
        }
        self.scenario.motion = MotionSetup::Constant { vx_px_frame: vx, vy_px_frame: vy, omega_deg_frame, start_px };
    }

    /// Draws a collision with a level flat in the middle of the film.
    fn impact(&mut self, radius_px: f64) {
        self.tag("impact");
        let [x, y] = self.middle_px();
        let (vn, vt) = (self.between(0.6, 2.4), self.between(-1.5, 1.5));
        // Compressions of at most an eighth of the radius.
        let contact_frames = self.between(1.5, 8.0).min(0.12 * radius_px * PI / vn);
        let (mass_kg, damping) = (0.05, self.between(0.02, 0.15));
        let stiffness_n_m = mass_kg * (PI * RATE_HZ / contact_frames).powi(2);
        let coefficient = self.between(0.05, 0.5);
        let omega_rad_s = self.spin().to_radians() * RATE_HZ;
        let at = self.between(0.4, 0.6) * self.scenario.camera.frames as f64;
        self.scenario.motion = MotionSetup::Impact(ImpactSetup {
            contact_start_s: at / RATE_HZ,
            contact_center_px: [x, y + 20.0],
            vn_m_s: -vn * M_S_PER_PX,
            vt_m_s: vt * M_S_PER_PX,
            omega_rad_s,
            gravity_m_s2: [0.0, -GRAVITY_M_S2],
            mass_kg,
            inertia_factor: 0.4,
            law: NormalLaw::KelvinVoigt {
                stiffness_n_m,
                damping_n_s_m: 2.0 * damping * (stiffness_n_m * mass_kg).sqrt(),
            },
            friction: Some(Friction { stiffness_n_m, damping_n_s_m: 2.0, coefficient }),
            ringing: None,
        });
        self.scenario.occluder = Some(self.flat());
    }

    /// Draws a painted board that fills the image, and a patch of it.
    fn patch(&mut self) -> String {
        let radius_px = self.between(16.0, 36.0);
        self.patch_radius_px = radius_px;
        self.scenario.body.shape = Shape::Plane;
        self.scenario.body.diameter_mm = 400.0 * MM_PER_PX;
        let random = PatternSetup { area_min_px2: 3.0, ..PatternSetup::default() };
        let (tag, pattern) = match self.stream.uniform() {
            part if part < 0.6 => {
                let area_max_px2 = self.between(8.0, 60.0);
                ("speckled", PatternSetup { area_max_px2, coverage: self.between(0.2, 0.45), ..random })
            }
            part if part < 0.75 => {
                let area_max_px2 = self.between(20.0, 60.0);
                ("few marks", PatternSetup { area_max_px2, coverage: self.between(0.02, 0.08), ..random })
            }
            part if part < 0.88 => {
                let (repeats, coverage) = (self.count(14, 40), self.between(0.25, 0.5));
                ("stripes", PatternSetup { layout: Layout::Stripes, repeats, coverage, ..random })
            }
            _ => {
                let (repeats, coverage) = (self.count(4, 12), self.between(0.25, 0.5));
                ("sectors", PatternSetup { layout: Layout::Sectors, repeats, coverage, ..random })
            }
        };
        self.scenario.body.pattern = pattern;
        self.tag(tag);
        // A regular pattern on a board takes long to draw at many moments.
        self.scenario.camera.exposure_us *= if tag == "stripes" || tag == "sectors" { 0.1 } else { 1.0 };
        self.shades();
        self.room_light();
        let most = 80.0 / self.scenario.camera.frames as f64;
        let (vx, vy, omega_deg_frame) = (self.between(-most, most), self.between(-most, most), self.spin());
        let [x, y] = self.middle_px();
        let half = 0.5 * self.scenario.camera.frames as f64;
        let camera = &self.scenario.camera;
        let inside = |at: f64, length: u32| at.clamp(radius_px + 2.0, f64::from(length) - radius_px - 3.0);
        let start_px = [inside(x - half * vx, camera.width_px), inside(y - half * vy, camera.height_px)];
        self.scenario.motion = MotionSetup::Constant { vx_px_frame: vx, vy_px_frame: vy, omega_deg_frame, start_px };
        let corner = |k: u32| {
            let (sin, cos) = (f64::from(k) * 45.0 + 10.0).to_radians().sin_cos();
            format!("[{:.2}, {:.2}]", start_px[0] + radius_px * cos, start_px[1] + radius_px * sin)
        };
        let corners: Vec<String> = (0..8).map(corner).collect();
        let (corners, [x, y]) = (corners.join(", "), start_px);
        format!("name = \"patch\"\nkind = \"patch\"\npolygon_px = [{corners}]\ncenter_px = [{x:.6}, {y:.6}]")
    }

    /// Draws an upright rod with two tapes that falls on a flat.
    fn rod(&mut self) -> String {
        let half_px = self.between(9.0, 16.0);
        self.scenario.body.diameter_mm = 2.0 * half_px * MM_PER_PX;
        (self.scenario.camera.width_px, self.scenario.camera.height_px) = (80, 200);
        let rod = RodSetup { tape_px: [20.0, 40.0], patch_px: [60.0, 110.0], shade: self.between(0.03, 0.15) };
        self.scenario.body.rod = Some(rod);
        let (area_max_px2, coverage) = (self.between(8.0, 24.0), self.between(0.2, 0.35));
        self.scenario.body.pattern =
            PatternSetup { area_min_px2: 3.0, area_max_px2, coverage, ..PatternSetup::default() };
        self.tag("speckled");
        let shade = &mut self.scenario.shade;
        (shade.ball, shade.speckle) = (self.stream.between(0.5, 0.8), self.stream.between(0.05, 0.2));
        (shade.ground, shade.ground_texture) = (self.stream.between(0.15, 0.35), self.stream.between(0.0, 0.02));
        self.room_light();
        self.body_light();
        self.scenario.light.bounce = 0.0;
        let mark_px = [40.0 + self.between(-6.0, 6.0), 75.3 + self.between(-4.0, 4.0)];
        let contact_frames = self.between(2.0, 10.0);
        let (mass_kg, damping) = (0.2, self.between(0.02, 0.2));
        let stiffness_n_m = mass_kg * (PI * RATE_HZ / contact_frames).powi(2);
        let at = self.between(0.4, 0.6) * self.scenario.camera.frames as f64;
        self.scenario.motion = MotionSetup::Impact(ImpactSetup {
            contact_start_s: at / RATE_HZ,
            contact_center_px: mark_px,
            vn_m_s: -self.between(0.1, 1.2) * M_S_PER_PX,
            vt_m_s: 0.0,
            omega_rad_s: 0.0,
            gravity_m_s2: [0.0, -GRAVITY_M_S2],
            mass_kg,
            inertia_factor: 0.5,
            law: NormalLaw::KelvinVoigt {
                stiffness_n_m,
                damping_n_s_m: 2.0 * damping * (stiffness_n_m * mass_kg).sqrt(),
            },
            friction: None,
            ringing: None,
        });
        self.scenario.occluder = Some(self.flat());
        let height = (mark_px[1] + 85.0) as u32;
        let diameter_mm = self.scenario.body.diameter_mm;
        format!(
            "name = \"rod\"\nkind = \"rod\"\ndiameter_mm = {diameter_mm:.3}\nedges = 4\nroi_px = [0, 0, 80, {}]",
            height - 8
        )
    }
}
