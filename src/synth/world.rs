//! A scenario, ready to be filmed.

use super::blur::{normal_cdf, seen_sigma_px};
use super::draw::{Ball, HalfPlane, Patch};
use super::motion::{Path, Pose, into_surface, tangent};
use super::physics::Collision;
use super::random::{Stream, key};
use super::scenario::{MotionSetup, Scenario, ScenarioError};
use super::sensor::Sensor;
use super::speckle::Pattern;
use super::texture::smooth;
use crate::image::{Image, PixelFormat};
use crate::results::{BodyVelocity, Estimate, Impact, Phase, PointStatus, RigidStep, VelocitySample};
use std::f64::consts::FRAC_PI_2;

/// What each random stream is for.
const SPECKLES: u64 = 1;
const GROUND: u64 = 2;
const OCCLUDER: u64 = 3;
const NOISE: u64 = 4;
/// Motion during the exposure that a single picture still shows well enough, px.
const STILL_PX: f64 = 0.05;
/// Longest stretch of motion during the exposure for a pair of pictures, px.
const PANEL_PX: f64 = 0.5;

/// A film that can be drawn frame by frame, in any order, with the truth behind it.
#[derive(Debug, Clone)]
pub struct World {
    scenario: Scenario,
    format: PixelFormat,
    path: Path,
    ball: Ball,
    sensor: Sensor,
    occluder: Option<HalfPlane>,
    /// Light behind the ball, DN, row-major.
    ground_dn: Vec<f32>,
    /// Ground and occluder without the ball, DN, row-major.
    still_dn: Vec<f32>,
    /// Brightness of the room, row-major.
    room: Vec<f32>,
}

impl World {
    /// Prepares a scenario: solves its physics, strews its speckles, draws what stands still.
    ///
    /// # Errors
    ///
    /// [`ScenarioError`] when the scenario cannot be filmed.
    pub fn new(scenario: &Scenario) -> Result<Self, ScenarioError> {
        scenario.check()?;
        let camera = &scenario.camera;
        let format = match camera.bits {
            10 => PixelFormat::Mono10,
            12 => PixelFormat::Mono12,
            16 => PixelFormat::Mono16,
            _ => PixelFormat::Mono8,
        };
        let sensor = Sensor::new(camera, format);
        let speckles = Stream::new(key(scenario.seed, SPECKLES, 0));
        let sigma_px = seen_sigma_px(camera.blur_px);
        let pattern = Pattern::strew(&scenario.body.pattern, scenario.radius_px(), sigma_px, speckles)?;
        let occluder = half_plane(scenario);
        let ball = Ball::new(scenario, pattern, sensor.full_dn(), occluder);
        let room = room(scenario);
        let ground_dn = ground(scenario, sensor.full_dn(), &room);
        let still_dn = still(scenario, sensor.full_dn(), &room, &ground_dn, occluder);
        let path = Path::new(scenario)?;
        Ok(Self { scenario: scenario.clone(), format, path, ball, sensor, occluder, ground_dn, still_dn, room })
    }

    /// The scenario it was made from.
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// Length of the film.
    pub fn frames(&self) -> u64 {
        self.scenario.camera.frames
    }

    /// Pixel layout.
    pub fn format(&self) -> PixelFormat {
        self.format
    }

    /// Pixels a row.
    pub fn width_px(&self) -> u32 {
        self.scenario.camera.width_px
    }

    /// Rows.
    pub fn height_px(&self) -> u32 {
        self.scenario.camera.height_px
    }

    /// Frames a second.
    pub fn frame_rate_hz(&self) -> f64 {
        self.scenario.camera.frame_rate_hz
    }

    /// Bytes of one frame; rows follow each other without padding.
    pub fn frame_bytes(&self) -> usize {
        self.still_dn.len() * self.format.bytes_per_pixel()
    }

    /// Exposure start of a frame, ns since the Unix epoch.
    pub fn stamp_ns(&self, index: u64) -> u64 {
        self.scenario.camera.start_ns + (index as f64 * 1e9 / self.frame_rate_hz()).round() as u64
    }

    /// Draws a frame into `bytes`: the same bytes for the same scenario and index, always.
    ///
    /// # Panics
    ///
    /// If `bytes` has not [`frame_bytes`](Self::frame_bytes) bytes.
    pub fn render(&self, index: u64, bytes: &mut [u8]) {
        assert_eq!(bytes.len(), self.frame_bytes(), "bytes of a frame");
        let patch = self.patch(index);
        let width = self.width_px() as usize;
        let noise = key(self.scenario.seed, NOISE, index);
        let mut light = vec![0.0; width];
        for (row, bytes) in bytes.chunks_exact_mut(width * self.format.bytes_per_pixel()).enumerate() {
            self.light_row(&patch, row, &mut light);
            self.sensor.expose(noise, row, &mut light, bytes);
        }
    }

    /// Draws a frame without noise, rounding and clipping, DN.
    pub fn render_light(&self, index: u64) -> Image {
        let patch = self.patch(index);
        let mut image = Image::new(self.width_px() as usize, self.height_px() as usize);
        for (row, light) in image.rows_mut().enumerate() {
            self.light_row(&patch, row, light);
        }
        image
    }

    /// The truth of a frame, as a row of the `velocity` table with all uncertainties 0.
    ///
    /// Everything is told of the middle of the exposure, which is the moment the
    /// picture shows; `stamp_ns` is the exposure's start, as a camera reports it.
    /// The last frame has no step.
    pub fn truth(&self, index: u64) -> VelocitySample {
        let pose = self.pose(index);
        let radius_px = self.scenario.radius_px();
        let visible = self.occluder.map_or(1.0, |plane| plane.visible_fraction(pose.center_px, radius_px));
        VelocitySample {
            frame: index,
            body: 0,
            stamp_ns: self.stamp_ns(index),
            center_x_px: Some(pose.center_px[0]),
            center_y_px: Some(pose.center_px[1]),
            radius_px: Some(radius_px),
            step: (index + 1 < self.frames()).then(|| step(&pose, &self.pose(index + 1))),
            velocity: Some(velocity(&pose, tangent(&self.scenario))),
            visible_fraction: Some(visible),
            phase: self.phase(index),
            status: self.status(&pose, visible),
        }
    }

    /// Turned since the first frame, counter-clockwise, deg.
    pub fn angle_deg(&self, index: u64) -> f64 {
        (self.pose(index).angle_rad - self.pose(0).angle_rad).to_degrees()
    }

    /// The truth of the collision, all uncertainties 0; times count from the first frame's stamp.
    pub fn impact(&self) -> Option<Impact> {
        let (MotionSetup::Impact(setup), Path::Impact { collision, .. }) = (&self.scenario.motion, &self.path) else {
            return None;
        };
        let mut impact = impact(collision, setup.contact_start_s, 0.5e-3 * self.scenario.body.diameter_mm);
        impact.origin_ns = self.scenario.camera.start_ns;
        impact.force_law = setup.law.force_law();
        Some(impact)
    }

    /// Middle of a frame's exposure after the first frame's stamp, s.
    fn seen_s(&self, index: u64) -> f64 {
        index as f64 / self.frame_rate_hz() + 0.5e-6 * self.scenario.camera.exposure_us
    }

    fn pose(&self, index: u64) -> Pose {
        self.path.at(self.seen_s(index))
    }

    fn phase(&self, index: u64) -> Phase {
        let Path::Impact { collision, start_s, .. } = &self.path else { return Phase::Unknown };
        let since_s = self.seen_s(index) - start_s;
        match since_s {
            _ if since_s < 0.0 => Phase::Flight,
            _ if since_s < collision.outcome().end_s => Phase::Contact,
            _ => Phase::Rebound,
        }
    }

    fn status(&self, pose: &Pose, visible: f64) -> PointStatus {
        let radius = self.scenario.radius_px();
        let fits = |place: f64, length: u32| place - radius >= -0.5 && place + radius <= f64::from(length) - 0.5;
        let [x, y] = pose.center_px;
        match () {
            () if !(fits(x, self.width_px()) && fits(y, self.height_px())) => PointStatus::OutOfFrame,
            () if visible <= 0.0 => PointStatus::Occluded,
            () => PointStatus::Valid,
        }
    }

    fn patch(&self, index: u64) -> Patch {
        assert!(index < self.frames(), "frame {index} of a film of {}", self.frames());
        self.ball.draw(&self.exposed(index), self.width_px() as usize, self.height_px() as usize)
    }

    /// Poses whose mean picture is the exposure's: two Gauss points for each half pixel of motion.
    fn exposed(&self, index: u64) -> Vec<Pose> {
        let exposure_s = 1e-6 * self.scenario.camera.exposure_us;
        let start_s = index as f64 / self.frame_rate_hz();
        let (open, shut) = (self.path.at(start_s), self.path.at(start_s + exposure_s));
        let shift_px = (shut.center_px[0] - open.center_px[0]).hypot(shut.center_px[1] - open.center_px[1]);
        let moved_px = shift_px + (shut.angle_rad - open.angle_rad).abs() * self.scenario.radius_px();
        if moved_px < STILL_PX {
            return vec![self.pose(index)];
        }
        let panels = (moved_px / PANEL_PX).ceil() as usize;
        let panel_s = exposure_s / panels as f64;
        (0..panels)
            .flat_map(|panel| [-1.0, 1.0].map(|side| panel as f64 + 0.5 + side / 12f64.sqrt()))
            .map(|part| self.path.at(start_s + part * panel_s))
            .collect()
    }

    /// One row: the still picture, and the ball over it.
    fn light_row(&self, patch: &Patch, row: usize, light: &mut [f32]) {
        let start = row * light.len();
        light.copy_from_slice(&self.still_dn[start..start + light.len()]);
        if row < patch.top || row >= patch.top + patch.height {
            return;
        }
        let cells = (row - patch.top) * patch.width..(row - patch.top + 1) * patch.width;
        let place = start + patch.left..start + patch.left + patch.width;
        let ball = patch.share[cells.clone()].iter().zip(&patch.light_dn[cells]);
        let still = self.room[place.clone()].iter().zip(&self.ground_dn[place]);
        for ((light, (share, light_dn)), (room, ground_dn)) in
            light[patch.left..patch.left + patch.width].iter_mut().zip(ball).zip(still)
        {
            *light += light_dn * room - share * ground_dn;
        }
    }
}

fn step(here: &Pose, next: &Pose) -> RigidStep {
    RigidStep {
        dx_px: next.center_px[0] - here.center_px[0],
        dy_px: next.center_px[1] - here.center_px[1],
        dtheta_deg: (next.angle_rad - here.angle_rad).to_degrees(),
        sigma_dx_px: 0.0,
        sigma_dy_px: 0.0,
        sigma_dtheta_deg: 0.0,
        points: 0,
    }
}

fn velocity(pose: &Pose, tangent: [f64; 2]) -> BodyVelocity {
    let [vt_m_s, vn_m_s] = into_surface(pose.velocity_m_s, tangent);
    BodyVelocity {
        vx_m_s: pose.velocity_m_s[0],
        vy_m_s: pose.velocity_m_s[1],
        vn_m_s,
        vt_m_s,
        omega_rad_s: pose.omega_rad_s,
        sigma_v_m_s: 0.0,
        sigma_omega_rad_s: 0.0,
        window_frames: 0,
        order: 0,
    }
}

fn impact(collision: &Collision, start_s: f64, radius_m: f64) -> Impact {
    let (before, outcome) = (collision.at(0.0), collision.outcome());
    let after = outcome.after;
    let exact = |value: f64| Some(Estimate { value, sigma: 0.0 });
    let slide = |motion: &super::physics::Motion| motion.velocity_m_s[0] + motion.omega_rad_s * radius_m;
    let slide_before = slide(&before);
    Impact {
        start_s: exact(start_s),
        deepest_s: exact(start_s + outcome.deepest_s),
        end_s: exact(start_s + outcome.end_s),
        vn_before_m_s: exact(before.velocity_m_s[1]),
        vn_after_m_s: exact(after.velocity_m_s[1]),
        vt_before_m_s: exact(before.velocity_m_s[0]),
        vt_after_m_s: exact(after.velocity_m_s[0]),
        omega_before_rad_s: exact(before.omega_rad_s),
        omega_after_rad_s: exact(after.omega_rad_s),
        restitution: exact(-after.velocity_m_s[1] / before.velocity_m_s[1]),
        restitution_tangential: (slide_before.abs() > 0.0)
            .then(|| Estimate { value: -slide(&after) / slide_before, sigma: 0.0 }),
        impulse_ratio: exact(outcome.impulse_n_s[0] / outcome.impulse_n_s[1]),
        contact_time_s: exact(outcome.end_s),
        compression_max_mm: exact(outcome.compression_max_m * 1e3),
        acceleration_max_m_s2: exact(outcome.acceleration_max_m_s2),
        slip_end_s: outcome.slip_end_s.and_then(|slip_end_s| exact(start_s + slip_end_s)),
        status: PointStatus::Valid,
        ..Impact::unknown(0, 0, 0)
    }
}

/// The occluder's edge, in the picture.
fn half_plane(scenario: &Scenario) -> Option<HalfPlane> {
    let occluder = scenario.occluder.as_ref()?;
    let angle_rad = occluder.normal_deg.map_or(scenario.surface.angle_deg.to_radians() + FRAC_PI_2, f64::to_radians);
    let normal = [angle_rad.cos(), -angle_rad.sin()];
    let touch = |center_px: [f64; 2]| {
        // The ball touches with the point that lies opposite to the surface's normal.
        let tangent = tangent(scenario);
        [center_px[0] + scenario.radius_px() * tangent[1], center_px[1] + scenario.radius_px() * tangent[0]]
    };
    let point_px = match (&occluder.point_px, &scenario.motion) {
        (Some(point_px), _) => *point_px,
        (None, MotionSetup::Impact(impact)) => touch(impact.contact_center_px),
        (None, MotionSetup::Constant { .. }) => return None,
    };
    Some(HalfPlane { point_px, normal })
}

/// Brightness of the room at every pixel.
fn room(scenario: &Scenario) -> Vec<f32> {
    let (width, height) = (scenario.camera.width_px, scenario.camera.height_px);
    let slope = [scenario.light.gradient_x / f64::from(width), scenario.light.gradient_y / f64::from(height)];
    let middle = [0.5 * f64::from(width - 1), 0.5 * f64::from(height - 1)];
    pixels(width, height).map(|(x, y)| (1.0 + slope[0] * (x - middle[0]) + slope[1] * (y - middle[1])) as f32).collect()
}

fn ground(scenario: &Scenario, full_dn: f32, room: &[f32]) -> Vec<f32> {
    let rough = roughness(scenario, scenario.shade.ground_texture, [2.0, 2.0], GROUND);
    let shade = scenario.shade.ground as f32;
    room.iter().zip(rough).map(|(room, rough)| full_dn * room * (shade + rough).max(0.0)).collect()
}

/// Ground and occluder: the picture without the ball.
fn still(scenario: &Scenario, full_dn: f32, room: &[f32], ground_dn: &[f32], occluder: Option<HalfPlane>) -> Vec<f32> {
    let (Some(plane), Some(setup)) = (occluder, &scenario.occluder) else { return ground_dn.to_vec() };
    let sigma_px = seen_sigma_px(scenario.camera.blur_px);
    // A long grain, as wood has.
    let rough = roughness(scenario, setup.texture, [8.0, 1.2], OCCLUDER);
    pixels(scenario.camera.width_px, scenario.camera.height_px)
        .zip(room.iter().zip(rough).zip(ground_dn))
        .map(|((x, y), ((room, rough), ground_dn))| {
            let free = normal_cdf(plane.distance_px(x, y) / sigma_px) as f32;
            free * ground_dn + (1.0 - free) * full_dn * room * (setup.shade as f32 + rough).max(0.0)
        })
        .collect()
}

fn roughness(scenario: &Scenario, share: f64, sigma_px: [f64; 2], purpose: u64) -> Vec<f32> {
    let (width, height) = (scenario.camera.width_px as usize, scenario.camera.height_px as usize);
    if share <= 0.0 {
        return vec![0.0; width * height];
    }
    let values = smooth(width, height, sigma_px, Stream::new(key(scenario.seed, purpose, 0)));
    values.into_iter().map(|value| value * share as f32).collect()
}

/// Every pixel's place, row by row.
fn pixels(width: u32, height: u32) -> impl Iterator<Item = (f64, f64)> {
    (0..height).flat_map(move |y| (0..width).map(move |x| (f64::from(x), f64::from(y))))
}
