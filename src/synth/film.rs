//! A film rendered from a scenario.

use super::background::{Background, ExposedObjects};
use super::ground_truth::{body_velocity, frame_status, phase_at, rigid_step, true_impact};
use super::scenario::{MotionSetup, Scenario, ScenarioError, Shape};
use super::sensor::Sensor;
use super::trajectory::{Pose, Trajectory, surface_tangent};
use crate::image::{Image, PixelFormat};
use crate::numeric::{Stream, key, scramble};
use crate::results::{Impact, PointStatus, VelocitySample};
use crate::synth::render::SpeckledSphere;
use crate::synth::render::total_sigma_px;
use crate::synth::render::{Ball, HalfPlane, Moment, Patch, Surface};
use crate::synth::render::{DiscOutline, Occluder, visible_fraction};
use crate::synth::render::{Pattern, SpeckleRegion};
use crate::synth::render::{RegularPaint, Rod};
use std::ops::Range;

/// The purposes of the random streams.
const SPECKLES: u64 = 1;
const NOISE: u64 = 4;
/// The maximum motion during the exposure that is rendered as one moment, px.
const MAX_SINGLE_PX: f64 = 0.05;
/// The maximum motion during the exposure per pair of moments, px.
const MAX_PANEL_PX: f64 = 0.5;
/// The number of iterations for the row that shows a moving centre.
const READOUT_ITERATIONS: usize = 8;

/// A film that is rendered frame by frame, in any order, with its ground truth.
#[derive(Debug, Clone)]
pub struct SimulatedFilm {
    scenario: Scenario,
    format: PixelFormat,
    /// One ball or two, from the back to the front.
    bodies: Vec<FilmedBody>,
    sensor: Sensor,
    background: Background,
    /// The index of this film of the same ball; each has its own noise.
    take: u64,
}

/// The drawing of a body.
#[derive(Debug, Clone)]
enum BodyDrawing {
    Ball(Box<Ball>),
    Rod(Box<Rod>),
}

impl BodyDrawing {
    /// Places the paint of a body and prepares its shapes and light.
    ///
    /// `number` selects the random stream of its speckles, `full_dn` is the maximum grey level.
    ///
    /// # Errors
    ///
    /// Returns [`ScenarioError`] if the pattern does not fit the body.
    fn new(scenario: &Scenario, number: u64, full_dn: f32) -> Result<Self, ScenarioError> {
        let speckles = Stream::new(key(scenario.seed, SPECKLES, number));
        let sigma_px = total_sigma_px(scenario.camera.blur_px);
        let (pattern, radius_px) = (&scenario.body.pattern, scenario.radius_px());
        let scatter = |region: SpeckleRegion| Pattern::scatter(pattern, region, sigma_px, speckles.clone());
        let ball = |surface: Surface| Self::Ball(Box::new(Ball::new(scenario, surface, full_dn)));
        let regular = RegularPaint::new(pattern, scenario.body.shape, radius_px, sigma_px, speckles.clone());
        if let Some(paint) = regular.filter(|_| scenario.body.rod.is_none()) {
            return Ok(ball(Surface::Regular(paint)));
        }
        Ok(match (&scenario.body.rod, scenario.body.shape) {
            (Some(rod), _) => {
                Self::Rod(Box::new(Rod::new(scenario, rod, scatter(Rod::speckle_region(scenario, rod))?, full_dn)))
            }
            (None, Shape::Disc | Shape::Plane) => ball(Surface::Flat(scatter(SpeckleRegion::Disc(radius_px))?)),
            (None, Shape::Sphere) => {
                ball(Surface::Sphere(SpeckledSphere::scatter(pattern, radius_px, sigma_px, speckles)?))
            }
        })
    }

    /// Draws the body into some rows of an image of this width: the mean over the moments. `zoom` magnifies balls only.
    fn draw(&self, moments: &[Moment], zoom: f64, width: usize, rows: Range<usize>) -> Patch {
        match self {
            Self::Ball(ball) if zoom.total_cmp(&1.0).is_ne() => ball.zoomed(zoom).draw(moments, width, rows),
            Self::Ball(ball) => ball.draw(moments, width, rows),
            Self::Rod(rod) => rod.draw(moments, width, rows),
        }
    }
}

/// A body with its trajectory and its drawing.
#[derive(Debug, Clone)]
struct FilmedBody {
    /// The scenario of this body alone.
    scenario: Scenario,
    trajectory: Trajectory,
    drawing: BodyDrawing,
}

impl FilmedBody {
    /// Prepares the drawing of a scenario's body and solves its motion; see [`BodyDrawing::new`].
    ///
    /// # Errors
    ///
    /// Returns [`ScenarioError`] if the pattern does not fit the body, or the ball does not bounce exactly once.
    fn new(scenario: Scenario, number: u64, full_dn: f32) -> Result<Self, ScenarioError> {
        let (trajectory, drawing) = (Trajectory::new(&scenario)?, BodyDrawing::new(&scenario, number, full_dn)?);
        Ok(Self { scenario, trajectory, drawing })
    }

    /// Returns the magnification of the body at `time_s` after the first stamp, relative to the scenario's `mm_per_px`.
    ///
    /// It is 1 at first contact, or in the middle of the first exposure if there is no contact. It exceeds 1 where the
    /// body is nearer to the camera: the image of a pinhole camera is inversely proportional to the distance, which
    /// decreases by `nearer_per_s` of its reference value per second.
    fn magnification(&self, time_s: f64) -> f64 {
        let reference_s = match &self.scenario.motion {
            MotionSetup::Impact(impact) => impact.contact_start_s,
            MotionSetup::Constant { .. } | MotionSetup::Piecewise { .. } => 0.5e-6 * self.scenario.camera.exposure_us,
        };
        1.0 / (1.0 - self.scenario.scale.nearer_per_s * (time_s - reference_s))
    }

    /// Returns the pose in the image at `time_s` after the first stamp, magnified about the image centre.
    fn pose(&self, time_s: f64) -> Pose {
        let (pose, zoom, camera) = (self.trajectory.pose_at(time_s), self.magnification(time_s), &self.scenario.camera);
        let middle_px = [camera.width_px, camera.height_px].map(|length| 0.5 * f64::from(length - 1));
        let magnified = |axis: usize| middle_px[axis] + zoom * (pose.center_px[axis] - middle_px[axis]);
        // At a constant distance the pose stays bit-identical.
        let is_even = zoom.total_cmp(&1.0).is_eq();
        if is_even { pose } else { Pose { center_px: [magnified(0), magnified(1)], ..pose } }
    }

    /// Returns an upper bound of the path of the body's fastest point during an exposure from `start_s` on, px.
    fn path_length_px(&self, start_s: f64, exposure_s: f64) -> f64 {
        let (open, shut) = (self.pose(start_s), self.pose(start_s + exposure_s));
        let shift_px = (shut.center_px[0] - open.center_px[0]).hypot(shut.center_px[1] - open.center_px[1]);
        let rotated_px = (shut.angle_rad - open.angle_rad).abs() * self.scenario.radius_px();
        shift_px + rotated_px + self.trajectory.tilt_rad_s(start_s) * exposure_s * self.scenario.radius_px()
    }

    /// Returns the radius in the image at `time_s`, px.
    fn radius_px(&self, time_s: f64) -> f64 {
        self.magnification(time_s) * self.scenario.radius_px()
    }

    fn is_ball(&self) -> bool {
        matches!(self.drawing, BodyDrawing::Ball(_))
    }

    /// Returns the outline of the ball at `time_s` after the first stamp.
    fn outline(&self, time_s: f64) -> DiscOutline {
        DiscOutline { center_px: self.pose(time_s).center_px, radius_px: self.radius_px(time_s) }
    }
}

impl SimulatedFilm {
    /// Prepares a scenario: solves its physics, places its speckles, renders the static image.
    ///
    /// # Errors
    ///
    /// Returns [`ScenarioError`] if the scenario cannot be rendered.
    pub fn new(scenario: &Scenario) -> Result<Self, ScenarioError> {
        scenario.check()?;
        let camera = &scenario.camera;
        let format = match camera.bits {
            10 => PixelFormat::Mono10,
            12 => PixelFormat::Mono12,
            16 => PixelFormat::Mono16,
            _ => PixelFormat::Mono8,
        };
        let sensor = Sensor::new(camera, format, scenario.seed);
        let mut bodies = vec![FilmedBody::new(scenario.clone(), 0, sensor.full_dn())?];
        if let Some(other) = &scenario.other {
            let other = FilmedBody::new(scenario.second_ball_alone(other), 1, sensor.full_dn());
            bodies.push(other.map_err(|error| ScenarioError::Other(Box::new(error)))?);
        }
        let background = Background::new(scenario, sensor.full_dn());
        Ok(Self { scenario: scenario.clone(), format, bodies, sensor, background, take: 0 })
    }

    /// Films the same ball again, with the same camera and light, but another motion and other noise.
    ///
    /// A second ball keeps its motion. This is much faster than a new film, since the speckles and their blur are kept.
    /// Equal takes have equal noise; take 0 has that of the first film.
    ///
    /// # Errors
    ///
    /// Returns [`ScenarioError`] if the scenario cannot be rendered with this motion.
    pub fn retake(&self, motion: MotionSetup, take: u64) -> Result<Self, ScenarioError> {
        let scenario = Scenario { motion, ..self.scenario.clone() };
        scenario.check()?;
        let mut bodies = self.bodies.clone();
        (bodies[0].trajectory, bodies[0].scenario) = (Trajectory::new(&scenario)?, scenario.clone());
        // An edge that is placed by the motion moves with it.
        let background = if scenario.occluder.is_some() {
            Background::new(&scenario, self.sensor.full_dn())
        } else {
            self.background.clone()
        };
        Ok(Self { scenario, bodies, background, take, ..self.clone() })
    }

    /// The scenario of the film.
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// The number of frames.
    pub fn frames(&self) -> u64 {
        self.scenario.camera.frames
    }

    /// The pixel layout.
    pub fn format(&self) -> PixelFormat {
        self.format
    }

    /// The number of pixels per row.
    pub fn width_px(&self) -> u32 {
        self.scenario.camera.width_px
    }

    /// The number of rows.
    pub fn height_px(&self) -> u32 {
        self.scenario.camera.height_px
    }

    /// The number of frames per second.
    pub fn frame_rate_hz(&self) -> f64 {
        self.scenario.camera.frame_rate_hz
    }

    /// The number of bytes of one frame; rows follow each other without padding.
    pub fn frame_bytes(&self) -> usize {
        self.background.pixel_count() * self.format.bytes_per_pixel()
    }

    /// The exposure start of a frame, ns since the Unix epoch.
    pub fn stamp_ns(&self, index: u64) -> u64 {
        self.scenario.camera.start_ns + (index as f64 * 1e9 / self.frame_rate_hz()).round() as u64
    }

    /// Renders a frame into `bytes`: always the same bytes for the same scenario and index.
    ///
    /// # Panics
    ///
    /// If the length of `bytes` is not [`frame_bytes`](Self::frame_bytes), or the film has no such frame.
    pub fn render(&self, index: u64, bytes: &mut [u8]) {
        assert_eq!(bytes.len(), self.frame_bytes(), "bytes of a frame");
        // The first take keeps the noise that films had before takes were introduced.
        let noise = key(self.scenario.seed.wrapping_add(scramble(self.take)), NOISE, index);
        let row_bytes = self.width_px() as usize * self.format.bytes_per_pixel();
        self.render_rows(index, |row, light| {
            self.sensor.expose(noise, row, light, &mut bytes[row * row_bytes..(row + 1) * row_bytes]);
        });
    }

    /// Renders a frame without noise, fixed pattern, tone curve, rounding and clipping, DN.
    ///
    /// # Panics
    ///
    /// If the film has no such frame.
    pub fn render_light(&self, index: u64) -> Image {
        let (width, height) = (self.width_px() as usize, self.height_px() as usize);
        let mut image = Image::new(width, height);
        let pixels = image.data_mut();
        self.render_rows(index, |row, light| pixels[row * width..(row + 1) * width].copy_from_slice(light));
        image
    }

    /// Renders the light of a frame and passes each row, DN, with its index to `write_row`.
    ///
    /// # Panics
    ///
    /// If the film has no such frame.
    fn render_rows(&self, index: u64, mut write_row: impl FnMut(usize, &mut [f32])) {
        assert!(index < self.frames(), "frame {index} of a film of {}", self.frames());
        let height = self.height_px() as usize;
        let is_global = self.scenario.camera.row_time_us.total_cmp(&0.0).is_eq();
        // With a rolling shutter each row has its own time.
        for first in (0..height).step_by(if is_global { height } else { 1 }) {
            let rows = first..if is_global { height } else { first + 1 };
            self.render_simultaneous_rows(
                self.exposure_start_s(index) + self.row_delay_s(first as f64),
                rows,
                &mut write_row,
            );
        }
    }

    /// Renders the rows whose exposure starts at `start_s` and passes each to `write_row`.
    fn render_simultaneous_rows(
        &self,
        start_s: f64,
        rows: Range<usize>,
        write_row: &mut impl FnMut(usize, &mut [f32]),
    ) {
        let width = self.width_px() as usize;
        let times = self.exposure_times(start_s);
        let draw = |(body, filmed): (usize, &FilmedBody)| {
            let moments: Vec<Moment> = times.iter().map(|time_s| self.moment_at(body, *time_s)).collect();
            filmed.drawing.draw(&moments, filmed.magnification(start_s + 0.5 * self.exposure_s()), width, rows.clone())
        };
        let patches: Vec<Patch> = self.bodies.iter().enumerate().map(draw).collect();
        let occluders: Vec<Option<HalfPlane>> =
            times.iter().map(|time_s| self.background.occluder_at(*time_s)).collect();
        let middle_s = start_s + 0.5 * self.exposure_s();
        let balls: Vec<DiscOutline> =
            self.bodies.iter().filter(|filmed| filmed.is_ball()).map(|filmed| filmed.outline(middle_s)).collect();
        let exposed = ExposedObjects { occluders: &occluders, patches: &patches, balls: &balls };
        let lamp = self.background.lamp_brightness(start_s, self.exposure_s());
        let mut light = vec![0.0; width];
        for row in rows {
            self.background.render_row(&exposed, row, &mut light);
            light.iter_mut().for_each(|light| *light *= lamp);
            write_row(row, &mut light);
        }
    }

    /// Returns the ground truth of the first body in a frame, as a row of the `velocity` table with zero uncertainties.
    ///
    /// All values belong to the middle of the exposure, which is the moment that the image shows (with a rolling
    /// shutter, that of the row of the body's centre). `stamp_ns` is the exposure's start, as a camera reports it.
    /// The last frame has no step.
    pub fn truth(&self, index: u64) -> VelocitySample {
        self.body_truth(0, index)
    }

    /// Returns the ground truth of every body in a frame; see [`truth`](Self::truth).
    pub fn truths(&self, index: u64) -> Vec<VelocitySample> {
        (0..self.bodies.len()).map(|body| self.body_truth(body, index)).collect()
    }

    /// Returns the ground truth of one body in a frame; see [`truth`](Self::truth).
    fn body_truth(&self, body: usize, index: u64) -> VelocitySample {
        let filmed = &self.bodies[body];
        let FilmedBody { scenario, trajectory, .. } = filmed;
        let shown_s = self.center_time_s(filmed, index);
        let (pose, radius_px) = (filmed.pose(shown_s), filmed.radius_px(shown_s));
        let visible = self.visible_fraction(body, shown_s);
        let next = (index + 1 < self.frames()).then(|| filmed.pose(self.center_time_s(filmed, index + 1)));
        VelocitySample {
            frame: index,
            body: body as u32,
            stamp_ns: self.stamp_ns(index),
            center_x_px: Some(pose.center_px[0]),
            center_y_px: Some(pose.center_px[1]),
            radius_px: scenario.body.rod.is_none().then_some(radius_px),
            motion: next.map(|next| rigid_step(&pose, &next).into()),
            rotation_status: PointStatus::Valid,
            velocity: Some(body_velocity(&pose, surface_tangent(scenario))),
            visible_fraction: Some(visible),
            phase: phase_at(trajectory, shown_s),
            status: frame_status(scenario, &pose, visible),
        }
    }

    /// Returns the visible fraction of the area of a body at `time_s`, 0 to 1; 1 for a rod.
    fn visible_fraction(&self, body: usize, time_s: f64) -> f64 {
        let filmed = &self.bodies[body];
        if filmed.scenario.body.rod.is_some() {
            // The mark of a rod lies above the surface, which occludes the end of the rod.
            return 1.0;
        }
        let Moment { pose, occluder, front } = self.moment_at(body, time_s);
        match (occluder, front) {
            (plane, Some(front)) => {
                let occluders: Vec<Occluder> =
                    plane.map(Occluder::Edge).into_iter().chain([Occluder::Ball(front)]).collect();
                visible_fraction(&filmed.outline(time_s), &occluders)
            }
            (Some(plane), None) => plane.visible_fraction(pose.center_px, filmed.radius_px(time_s)),
            (None, None) => 1.0,
        }
    }

    /// Returns the rotation of the first body since the first frame, counter-clockwise, deg.
    pub fn angle_deg(&self, index: u64) -> f64 {
        let filmed = &self.bodies[0];
        let angle = |index: u64| filmed.trajectory.pose_at(self.center_time_s(filmed, index)).angle_rad;
        (angle(index) - angle(0)).to_degrees()
    }

    /// Returns the ground truth of the first body's collision, with zero uncertainties; times count from the first
    /// stamp.
    pub fn impact(&self) -> Option<Impact> {
        self.body_impact(0)
    }

    /// Returns the ground truth of every body's collision; see [`impact`](Self::impact).
    pub fn impacts(&self) -> Vec<Impact> {
        (0..self.bodies.len()).filter_map(|body| self.body_impact(body)).collect()
    }

    /// Returns the ground truth of the collision of one body; `None` for a motion without a collision.
    fn body_impact(&self, body: usize) -> Option<Impact> {
        let FilmedBody { scenario, trajectory, .. } = &self.bodies[body];
        let (MotionSetup::Impact(setup), Trajectory::Impact { collision, .. }) = (&scenario.motion, trajectory) else {
            return None;
        };
        let mut impact = true_impact(collision, setup, 0.5e-3 * scenario.body.diameter_mm);
        impact.body = body as u32;
        impact.origin_ns = scenario.camera.start_ns;
        impact.force_law = setup.law.force_law();
        Some(impact)
    }

    /// Returns the time at which a frame shows the centre of a body, s after the first stamp: the middle of the
    /// exposure of its row.
    fn center_time_s(&self, filmed: &FilmedBody, index: u64) -> f64 {
        let middle_s = self.exposure_start_s(index) + 0.5 * self.exposure_s();
        // The row that shows it is read while it moves on. The iteration converges by the ratio of its speed to the
        // readout's.
        (0..READOUT_ITERATIONS)
            .fold(middle_s, |time_s, _| middle_s + self.row_delay_s(filmed.pose(time_s).center_px[1]))
    }

    /// Returns the delay of a row's exposure relative to the frame's stamp, s.
    ///
    /// A shutter that rolls upwards begins with the last row.
    fn row_delay_s(&self, row_px: f64) -> f64 {
        let camera = &self.scenario.camera;
        let first_px = if camera.row_time_us < 0.0 { f64::from(camera.height_px - 1) } else { 0.0 };
        1e-6 * camera.row_time_us * (row_px - first_px)
    }

    /// Returns the start of a frame's exposure after the first frame's stamp, s.
    fn exposure_start_s(&self, index: u64) -> f64 {
        index as f64 / self.frame_rate_hz()
    }

    fn exposure_s(&self) -> f64 {
        1e-6 * self.scenario.camera.exposure_us
    }

    /// Returns the pose of the body with index `body` and its occluders at `time_s` after the first stamp.
    fn moment_at(&self, body: usize, time_s: f64) -> Moment {
        let front = self.bodies.get(body + 1).map(|filmed| filmed.outline(time_s));
        Moment { pose: self.bodies[body].pose(time_s), occluder: self.background.occluder_at(time_s), front }
    }

    /// Returns times (s after the first stamp) whose mean image is that of the exposure.
    ///
    /// Two Gauss points per half pixel of motion; the middle of the exposure if almost nothing moves.
    fn exposure_times(&self, start_s: f64) -> Vec<f64> {
        let exposure_s = self.exposure_s();
        let moved_px = self.bodies.iter().map(|filmed| filmed.path_length_px(start_s, exposure_s)).fold(0.0, f64::max)
            + self.background.occluder_px_s().abs() * exposure_s;
        if moved_px < MAX_SINGLE_PX {
            return vec![start_s + 0.5 * exposure_s];
        }
        let panels = (moved_px / MAX_PANEL_PX).ceil() as usize;
        let panel_s = exposure_s / panels as f64;
        (0..panels)
            .flat_map(|panel| [-1.0, 1.0].map(|side| panel as f64 + 0.5 + side / 12f64.sqrt()))
            .map(|part| start_s + part * panel_s)
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(vx_px_frame: f64, start_px: [f64; 2]) -> MotionSetup {
        MotionSetup::Constant { vx_px_frame, vy_px_frame: 0.0, omega_deg_frame: 1.0, start_px }
    }

    fn world() -> SimulatedFilm {
        let mut scenario = Scenario::translation(0.0, 0.0, 0.0);
        (scenario.camera.width_px, scenario.camera.height_px) = (150, 150);
        scenario.motion = motion(0.0, [74.2, 74.6]);
        SimulatedFilm::new(&scenario).unwrap()
    }

    fn frame(world: &SimulatedFilm, index: u64) -> Vec<u8> {
        let mut bytes = vec![0; world.frame_bytes()];
        world.render(index, &mut bytes);
        bytes
    }

    #[test]
    fn a_retake_equals_a_new_film_but_for_its_noise() {
        let first = world();
        let moved = motion(0.7, [73.1, 75.4]);
        let own = SimulatedFilm::new(&Scenario { motion: moved.clone(), ..first.scenario().clone() }).unwrap();
        let retake = first.retake(moved.clone(), 0).unwrap();
        assert_eq!(frame(&retake, 2), frame(&own, 2), "take 0 has the first film's noise");
        let other = first.retake(moved.clone(), 1).unwrap();
        assert_eq!(other.render_light(2), own.render_light(2));
        assert_eq!(other.truth(2), own.truth(2));
        assert_ne!(frame(&other, 2), frame(&own, 2));
        assert_ne!(frame(&other, 2), frame(&first.retake(moved, 2).unwrap(), 2));
    }

    #[test]
    fn a_retake_is_checked_as_a_scenario_is() {
        let error = world().retake(motion(f64::NAN, [74.0; 2]), 1).unwrap_err().to_string();
        assert!(error.starts_with("motion.vx_px_frame = NaN is out of range"), "{error}");
    }
}
