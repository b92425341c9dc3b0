//! Simulated impacts with known truth.
//!
//! Independent integration in SI units (Runge-Kutta, 400 steps per frame) that shares nothing with the measured code.

use ricochet::motion::{Form, Intervals, MotionParams, RandomWalk, Scale, Shutter, View};
use ricochet::results::{BodyStep, Circle, Estimate, Outline, RigidStep};

/// The uncertainty of the motion of a ball's centre relative to its front, px per rad of uncertainty of its rotation,
/// for a fully visible ball of some 60 px radius.
const LEVER_PX: f64 = 300.0;

/// Gaussian noise with a constant seed.
pub struct Noise(u64);

impl Noise {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xD1B5_4A32_D192_ED03)
    }

    pub fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub fn gauss(&mut self) -> f64 {
        let radius = (-2.0 * self.uniform().max(1e-300).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

/// A contact law in SI units.
#[derive(Clone, Copy)]
pub enum Law {
    /// Stiffness N/m, damping N s/m.
    KelvinVoigt(f64, f64),
    /// Stiffness N/m^1.5, damping s/m.
    HuntCrossley(f64, f64),
    /// Hunt-Crossley with a rippled stiffness, which no fitted law contains.
    RippledHuntCrossley(f64, f64, Ripple),
    /// Kelvin-Voigt with a rippled stiffness.
    RippledKelvinVoigt(f64, f64, Ripple),
}

/// A stiffness that varies by a quarter.
#[derive(Clone, Copy)]
pub struct Ripple {
    /// m.
    pub stroke: f64,
    /// Number of periods over the stroke.
    pub periods: f64,
    /// The phase at the beginning, periods.
    pub phase: f64,
}

impl Ripple {
    /// One period over the stroke, with the mean stiffness at the beginning.
    pub fn over(stroke: f64) -> Self {
        Self { stroke, periods: 1.0, phase: 0.0 }
    }

    fn at(&self, depth: f64) -> f64 {
        1.0 + 0.25 * (std::f64::consts::TAU * (self.periods * depth / self.stroke + self.phase)).sin()
    }
}

/// One of the three experiments.
#[derive(Clone, Copy)]
pub struct Experiment {
    pub name: &'static str,
    pub mass_kg: f64,
    pub law: Law,
    pub mm_per_px: f64,
    pub frame_rate_hz: f64,
    pub vn_m_s: f64,
    pub vt_m_s: f64,
    pub omega_rad_s: f64,
    pub radius_m: f64,
    /// Moment of inertia over m R^2.
    pub inertia: f64,
    /// Friction: spring N/m, dashpot N s/m, coefficient.
    pub friction: (f64, f64, f64),
    pub before_frames: usize,
    pub after_frames: usize,
    pub sigma_px: f64,
    pub sigma_deg: f64,
    pub surface_angle_deg: f64,
}

pub fn lacrosse(hunt_crossley: bool) -> Experiment {
    Experiment {
        name: "lacrosse",
        mass_kg: 0.14566,
        law: if hunt_crossley { Law::HuntCrossley(1.743e6, 0.2224) } else { Law::KelvinVoigt(6.772e4, 14.87) },
        mm_per_px: 0.5142,
        frame_rate_hz: 10_000.0,
        vn_m_s: -1.69,
        vt_m_s: 0.57,
        omega_rad_s: 0.0,
        radius_m: 0.031_625,
        inertia: 0.4,
        friction: (1e5, 20.0, 0.07),
        before_frames: 14,
        after_frames: 22,
        sigma_px: 0.0011,
        sigma_deg: 0.0017,
        surface_angle_deg: 0.0,
    }
}

pub fn tennis(hunt_crossley: bool) -> Experiment {
    Experiment {
        name: "tennis",
        mass_kg: 0.0567,
        law: if hunt_crossley { Law::HuntCrossley(1.35e5, 0.113) } else { Law::KelvinVoigt(1.042e4, 3.615) },
        mm_per_px: 0.5877,
        vn_m_s: -3.2,
        vt_m_s: 3.2,
        radius_m: 0.0335,
        inertia: 0.55,
        friction: (1e5, 20.0, 0.3),
        before_frames: 40,
        after_frames: 30,
        sigma_px: 0.0015,
        ..lacrosse(hunt_crossley)
    }
    .named("tennis")
}

pub fn rod(hunt_crossley: bool) -> Experiment {
    Experiment {
        mass_kg: 0.255,
        law: if hunt_crossley { Law::HuntCrossley(7.40e7, 0.783) } else { Law::KelvinVoigt(1.063e6, 166.0) },
        mm_per_px: 0.3,
        frame_rate_hz: 40_000.0,
        vn_m_s: -1.084,
        vt_m_s: 0.0,
        friction: (1e5, 20.0, 0.0),
        before_frames: 99,
        after_frames: 60,
        sigma_px: 0.0034,
        ..lacrosse(hunt_crossley)
    }
    .named("rod")
}

/// The true values of one impact.
#[derive(Clone)]
pub struct Truth {
    pub experiment: Experiment,
    /// Poses at the frames: normal m, tangential m, angle rad.
    pub poses: Vec<[f64; 3]>,
    /// Rates at the frames.
    pub rates: Vec<[f64; 3]>,
    /// Contact start, deepest, end in frames, and when the contact point stops slipping.
    pub start: f64,
    pub deepest: f64,
    pub end: f64,
    pub slip_end: Option<f64>,
    pub before: [f64; 3],
    pub after: [f64; 3],
    pub depth_mm: f64,
    pub acceleration: f64,
    /// Frames at which the force passes 2 % of its peak, rising and falling.
    pub faint: [f64; 2],
    /// Time and force of every substep of the first contact.
    pub forces: Vec<[f64; 2]>,
    /// Start frame, end frame and restitution of every contact.
    pub bounces: Vec<[f64; 3]>,
}

const SUBSTEPS: usize = 400;

impl Experiment {
    fn named(self, name: &'static str) -> Self {
        Self { name, ..self }
    }

    fn force(&self, depth: f64, speed: f64) -> f64 {
        let depth = depth.max(0.0);
        match self.law {
            Law::KelvinVoigt(k, c) => k * depth + c * speed,
            Law::HuntCrossley(k, c) => k * depth.powf(1.5) * (1.0 + c * speed),
            Law::RippledHuntCrossley(k, c, ripple) => k * depth.powf(1.5) * ripple.at(depth) * (1.0 + c * speed),
            Law::RippledKelvinVoigt(k, c, ripple) => k * depth * ripple.at(depth) + c * speed,
        }
    }

    /// Forces per mass on (depth, speed, tangential, vt, angle, omega, slip) and the tangential force.
    fn derivative(&self, s: &[f64; 7]) -> [f64; 7] {
        let normal = self.force(s[0], s[1]).max(0.0);
        let (spring, dash, limit) = self.friction;
        let slip = s[3] + s[5] * self.radius_m;
        let friction = (-(spring * s[6] + dash * slip)).clamp(-limit * normal, limit * normal);
        let tangential = friction / self.mass_kg;
        let turn = friction * self.radius_m / (self.inertia * self.mass_kg * self.radius_m.powi(2));
        let free = (-(spring * s[6] + dash * slip)).abs() <= limit * normal;
        let stretch = if free { slip } else { 0.0 };
        [s[1], 9.81 - normal / self.mass_kg, s[3], tangential, s[5], turn, stretch]
    }

    fn step(&self, s: &[f64; 7], h: f64) -> [f64; 7] {
        let add = |k: &[f64; 7], f: f64| std::array::from_fn(|i| s[i] + f * k[i]);
        let k1 = self.derivative(s);
        let k2 = self.derivative(&add(&k1, 0.5 * h));
        let k3 = self.derivative(&add(&k2, 0.5 * h));
        let k4 = self.derivative(&add(&k3, h));
        let mut out = std::array::from_fn(|i| s[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
        // A sliding patch drags its spring along at the friction limit.
        let normal = self.force(out[0], out[1]).max(0.0);
        let (spring, dash, limit) = self.friction;
        let slip = out[3] + out[5] * self.radius_m;
        let pull = spring * out[6] + dash * slip;
        if pull.abs() > limit * normal {
            out[6] = (limit * normal * pull.signum() - dash * slip) / spring;
        }
        out
    }

    /// Simulates one impact that starts `phase` (0 to 1) of a frame after frame `before_frames`.
    pub fn simulate(&self, phase: f64) -> Truth {
        let period = 1.0 / self.frame_rate_hz;
        let h = period / SUBSTEPS as f64;
        let start = self.before_frames as f64 + phase;
        let mut truth = Truth {
            experiment: *self,
            poses: Vec::new(),
            rates: Vec::new(),
            start,
            deepest: 0.0,
            end: 0.0,
            slip_end: None,
            before: [self.vn_m_s, self.vt_m_s, self.omega_rad_s],
            after: [0.0; 3],
            depth_mm: 0.0,
            acceleration: 0.0,
            faint: [0.0; 2],
            forces: vec![[start, self.force(0.0, -self.vn_m_s)]],
            bounces: Vec::new(),
        };
        for frame in 0..=self.before_frames {
            let t = (frame as f64 - start) * period;
            truth.poses.push([self.vn_m_s * t - 0.5 * 9.81 * t * t, self.vt_m_s * t, self.omega_rad_s * t]);
            truth.rates.push([self.vn_m_s - 9.81 * t, self.vt_m_s, self.omega_rad_s]);
        }
        let mut s = [0.0, -self.vn_m_s, 0.0, self.vt_m_s, 0.0, self.omega_rad_s, 0.0];
        let mut steps = 0_usize;
        let mut next_frame = self.before_frames + 1;
        let last_frame = |end: f64| end.ceil() as usize + self.after_frames;
        let mut over = false;
        let mut touch = (start, -self.vn_m_s);
        loop {
            let time = start + steps as f64 / SUBSTEPS as f64;
            if truth.end > 0.0 && next_frame > last_frame(truth.end) {
                truth.faint = faint(&truth.forces);
                return truth;
            }
            let n = if over { self.fly(&s, h) } else { self.step(&s, h) };
            // Frames within this substep, by the cubic through both ends.
            let gap = (next_frame as f64 - time) * period;
            if gap <= h {
                let at = if over { self.fly(&s, gap) } else { self.step(&s, gap) };
                truth.poses.push([-at[0], at[2], at[4]]);
                truth.rates.push([-at[1], at[3], at[5]]);
                next_frame += 1;
            }
            if !over {
                self.note(&mut truth, &s, &n, time);
                over = n[1] < 0.0 && (self.force(n[0], n[1]) <= 0.0 || n[0] <= 0.0);
                if over {
                    let end = time + 1.0 / SUBSTEPS as f64;
                    if truth.bounces.is_empty() {
                        (truth.end, truth.after) = (end, [-n[1], n[3], n[5]]);
                    }
                    truth.bounces.push([touch.0, end, -n[1] / touch.1]);
                }
            } else if s[0] < 0.0 && n[0] >= 0.0 {
                (over, touch) = (false, (time, n[1]));
            }
            s = n;
            steps += 1;
        }
    }

    fn note(&self, truth: &mut Truth, s: &[f64; 7], n: &[f64; 7], time: f64) {
        if truth.bounces.is_empty() && s[1] > 0.0 && n[1] <= 0.0 {
            truth.deepest = time + s[1] / (s[1] - n[1]) / SUBSTEPS as f64;
            truth.depth_mm = s[0].max(n[0]) * 1e3;
        }
        let (a, b) = (s[3] + s[5] * self.radius_m, n[3] + n[5] * self.radius_m);
        if truth.slip_end.is_none() && a > 0.0 && b <= 0.0 {
            truth.slip_end = Some(time + a / (a - b) / SUBSTEPS as f64);
        }
        if truth.bounces.is_empty() {
            truth.forces.push([time + 1.0 / SUBSTEPS as f64, self.force(n[0], n[1])]);
        }
        truth.acceleration = truth.acceleration.max(self.force(n[0], n[1]) / self.mass_kg - 9.81);
    }

    fn fly(&self, s: &[f64; 7], h: f64) -> [f64; 7] {
        let depth = s[0] + s[1] * h + 0.5 * 9.81 * h * h;
        [depth, s[1] + 9.81 * h, s[2] + s[3] * h, s[3], s[4] + s[5] * h, s[5], s[6]]
    }

    pub fn params(&self) -> MotionParams {
        MotionParams {
            scale: Scale::MmPerPx(self.mm_per_px),
            rectifier: None,
            view: View::default(),
            radius_px: None,
            surface_angle_deg: self.surface_angle_deg,
            gravity_m_s2: 9.81,
            // Gravity stays opposite to the surface normal, so that a tilt of the surface tilts the whole experiment.
            gravity_angle_deg: self.surface_angle_deg - 90.0,
            window_frames: None,
            lag_frames: 20,
            order: 2,
            mass_kg: Some(self.mass_kg),
            form: Form::Ball,
            interval_frames: 1,
            walk: RandomWalk::default(),
            spans: Intervals::default(),
            exposure_ns: 0.0,
            coding: ricochet::results::FrameCoding::default(),
            shutter: Shutter::default(),
            frame_period_ns: 1e9 / self.frame_rate_hz,
        }
    }
}

/// The first and the last time at 2 % of the peak force.
fn faint(forces: &[[f64; 2]]) -> [f64; 2] {
    let limit = 0.02 * forces.iter().map(|[_, force]| *force).fold(0.0, f64::max);
    let strong = |at: &[f64; 2]| at[1] >= limit;
    let ends = [forces.iter().find(|at| strong(at)), forces.iter().rfind(|at| strong(at))];
    ends.map(|at| at.unwrap()[0])
}

impl Truth {
    /// Poses in image axes (px, px down, deg).
    pub fn image_poses(&self) -> Vec<[f64; 3]> {
        let px = 1e3 / self.experiment.mm_per_px;
        let (sin, cos) = self.experiment.surface_angle_deg.to_radians().sin_cos();
        let image = |p: &[f64; 3]| {
            let (x, y_up) = (p[1] * cos - p[0] * sin, p[1] * sin + p[0] * cos);
            [200.0 + x * px, 200.0 - y_up * px, p[2].to_degrees()]
        };
        self.poses.iter().map(image).collect()
    }

    /// Steps over `n` frames with white noise on the poses.
    pub fn steps(&self, n: usize, noise: &mut Noise) -> Vec<BodyStep> {
        let e = &self.experiment;
        steps(
            &self.image_poses(),
            n,
            1e9 / e.frame_rate_hz,
            (e.sigma_px, e.sigma_deg, e.radius_m * 1e3 / e.mm_per_px),
            noise,
        )
    }
}

/// Steps between poses with white noise on each, and an outline in each frame.
pub fn steps(
    poses: &[[f64; 3]],
    n: usize,
    period_ns: f64,
    (sigma_px, sigma_deg, radius_px): (f64, f64, f64),
    noise: &mut Noise,
) -> Vec<BodyStep> {
    let noisy: Vec<[f64; 3]> = poses
        .iter()
        .map(|p| [p[0] + sigma_px * noise.gauss(), p[1] + sigma_px * noise.gauss(), p[2] + sigma_deg * noise.gauss()])
        .collect();
    let per = n as f64;
    let root2 = std::f64::consts::SQRT_2;
    let step = |i: usize| {
        let (a, b) = (noisy.get(i)?, noisy.get(i + n)?);
        Some(RigidStep {
            dx_px: (b[0] - a[0]) / per,
            dy_px: (b[1] - a[1]) / per,
            dtheta_deg: (b[2] - a[2]) / per,
            sigma_dx_px: root2 * sigma_px / per,
            sigma_dy_px: root2 * sigma_px / per,
            sigma_dtheta_deg: root2 * sigma_deg / per,
            points: 64,
        })
    };
    // There is no rotation about another axis, and subsets detect one some hundred times less precisely than one in the
    // image plane.
    let uncertain = [LEVER_PX * sigma_deg.to_radians(), LEVER_PX * sigma_deg.to_radians(), sigma_deg];
    let off: Vec<[f64; 3]> = poses.iter().map(|_| uncertain.map(|sigma| sigma * noise.gauss())).collect();
    let beside = |i: usize, k: usize| {
        let value = (off[(i + n).min(off.len() - 1)][k] - off[i][k]) / per;
        Estimate { value, sigma: root2 * uncertain[k] / per }
    };
    (0..poses.len())
        .map(|i| BodyStep {
            drift: step(i).map(|_| std::array::from_fn(|k| beside(i, k))),
            frame: i as u64,
            stamp_ns: 1_700_000_000_000_000_000 + (i as f64 * period_ns).round() as u64,
            interval_frames: n as u32,
            outline: Some(Outline::from(Circle {
                x_px: poses[i][0] + 0.02 * noise.gauss(),
                y_px: poses[i][1] + 0.02 * noise.gauss(),
                radius_px,
                sigma_center_px: 0.02,
                sigma_radius_px: 0.02,
                visible_fraction: 1.0,
            })),
            motion: step(i),
            ..BodyStep::default()
        })
        .collect()
}
