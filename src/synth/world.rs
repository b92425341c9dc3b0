//! A scenario, ready to be filmed.

use super::blur::seen_sigma_px;
use super::cover::{Cover, Round, visible_fraction};
use super::draw::{Ball, Coat, HalfPlane, Moment, Patch};
use super::motion::{Path, Pose, tangent};
use super::rod::Rod;
use super::scenario::{MotionSetup, Scenario, ScenarioError, Shape};
use super::scene::Scene;
use super::sensor::Sensor;
use super::speckle::{Field, Pattern};
use super::sphere::Globe;
use super::truth::{impact, phase, status, step, velocity};
use crate::image::{Image, PixelFormat};
use crate::numeric::{Stream, key, scramble};
use crate::results::{Impact, VelocitySample};
use std::ops::Range;

/// What each random stream is for.
const SPECKLES: u64 = 1;
const NOISE: u64 = 4;
/// Motion during the exposure that a single picture still shows well enough, px.
const STILL_PX: f64 = 0.05;
/// Longest stretch of motion during the exposure for a pair of pictures, px.
const PANEL_PX: f64 = 0.5;
/// Rounds in which the row is sought that shows a moving centre.
const READ_ROUNDS: usize = 8;

/// A film that can be drawn frame by frame, in any order, with the truth behind it.
#[derive(Debug, Clone)]
pub struct World {
    scenario: Scenario,
    format: PixelFormat,
    /// From the back to the front: one, or two balls.
    actors: Vec<Actor>,
    sensor: Sensor,
    scene: Scene,
    /// Which film of the same ball it is: each has noise of its own.
    take: u64,
}

/// What is filmed.
#[derive(Debug, Clone)]
enum Body {
    Ball(Box<Ball>),
    Rod(Box<Rod>),
}

impl Body {
    fn new(scenario: &Scenario, number: u64, full_dn: f32) -> Result<Self, ScenarioError> {
        let speckles = Stream::new(key(scenario.seed, SPECKLES, number));
        let sigma_px = seen_sigma_px(scenario.camera.blur_px);
        let (pattern, radius_px) = (&scenario.body.pattern, scenario.radius_px());
        let strew = |field: Field| Pattern::strew(pattern, field, sigma_px, speckles.clone());
        let ball = |coat: Coat| Self::Ball(Box::new(Ball::new(scenario, coat, full_dn)));
        Ok(match (&scenario.body.rod, scenario.body.shape) {
            (Some(rod), _) => Self::Rod(Box::new(Rod::new(scenario, rod, strew(Rod::field(scenario, rod))?, full_dn))),
            (None, Shape::Disc | Shape::Plane) => ball(Coat::Flat(strew(Field::Disc(radius_px))?)),
            (None, Shape::Sphere) => ball(Coat::Round(Globe::strew(pattern, radius_px, sigma_px, speckles)?)),
        })
    }

    /// Draws some rows of it in a picture of another scale by `zoom`.
    fn draw(&self, moments: &[Moment], zoom: f64, width: usize, rows: Range<usize>) -> Patch {
        match self {
            Self::Ball(ball) if zoom.total_cmp(&1.0).is_ne() => ball.zoomed(zoom).draw(moments, width, rows),
            Self::Ball(ball) => ball.draw(moments, width, rows),
            Self::Rod(rod) => rod.draw(moments, width, rows),
        }
    }
}

/// A body and its way.
#[derive(Debug, Clone)]
struct Actor {
    /// The scenario as if it were alone.
    scenario: Scenario,
    path: Path,
    body: Body,
}

impl Actor {
    fn new(scenario: Scenario, number: u64, full_dn: f32) -> Result<Self, ScenarioError> {
        let (path, body) = (Path::new(&scenario)?, Body::new(&scenario, number, full_dn)?);
        Ok(Self { scenario, path, body })
    }

    /// How much larger it is in the picture than the scale says, for how much nearer it has come.
    fn zoom(&self, time_s: f64) -> f64 {
        let even_s = match &self.scenario.motion {
            MotionSetup::Impact(impact) => impact.contact_start_s,
            MotionSetup::Constant { .. } | MotionSetup::Piecewise { .. } => 0.5e-6 * self.scenario.camera.exposure_us,
        };
        1.0 / (1.0 - self.scenario.scale.nearer_per_s * (time_s - even_s))
    }

    /// Where it is in the picture.
    fn pose(&self, time_s: f64) -> Pose {
        let (pose, zoom, camera) = (self.path.at(time_s), self.zoom(time_s), &self.scenario.camera);
        let middle_px = [camera.width_px, camera.height_px].map(|length| 0.5 * f64::from(length - 1));
        let place = |axis: usize| middle_px[axis] + zoom * (pose.center_px[axis] - middle_px[axis]);
        // Bodies that keep their distance lie where they lay, to the bit.
        let is_even = zoom.total_cmp(&1.0).is_eq();
        if is_even { pose } else { Pose { center_px: [place(0), place(1)], ..pose } }
    }

    /// Way of its fastest point while the shutter is open, px.
    fn moved_px(&self, start_s: f64, exposure_s: f64) -> f64 {
        let (open, shut) = (self.pose(start_s), self.pose(start_s + exposure_s));
        let shift_px = (shut.center_px[0] - open.center_px[0]).hypot(shut.center_px[1] - open.center_px[1]);
        let turned_px = (shut.angle_rad - open.angle_rad).abs() * self.scenario.radius_px();
        shift_px + turned_px + self.path.tilt_rad_s(start_s) * exposure_s * self.scenario.radius_px()
    }

    /// Its radius in the picture, px.
    fn radius_px(&self, time_s: f64) -> f64 {
        self.zoom(time_s) * self.scenario.radius_px()
    }

    fn round(&self, time_s: f64) -> Round {
        Round { center_px: self.pose(time_s).center_px, radius_px: self.radius_px(time_s) }
    }
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
        let sensor = Sensor::new(camera, format, scenario.seed);
        let mut actors = vec![Actor::new(scenario.clone(), 0, sensor.full_dn())?];
        if let Some(other) = &scenario.other {
            let other = Actor::new(scenario.alone(other), 1, sensor.full_dn());
            actors.push(other.map_err(|error| ScenarioError::Other(Box::new(error)))?);
        }
        let scene = Scene::new(scenario, sensor.full_dn());
        Ok(Self { scenario: scenario.clone(), format, actors, sensor, scene, take: 0 })
    }

    /// Films the same ball once more, with the same camera in the same light: another motion and other noise.
    /// A second ball moves as it did.
    ///
    /// Far quicker than a world of its own: nothing is strewn or blurred anew. Equal takes have equal noise;
    /// take 0 has that of the first film.
    ///
    /// # Errors
    ///
    /// [`ScenarioError`] when the scenario cannot be filmed with this motion.
    pub fn retake(&self, motion: MotionSetup, take: u64) -> Result<Self, ScenarioError> {
        let scenario = Scenario { motion, ..self.scenario.clone() };
        scenario.check()?;
        let mut actors = self.actors.clone();
        (actors[0].path, actors[0].scenario) = (Path::new(&scenario)?, scenario.clone());
        // An edge that the motion places is where this motion has it.
        let scene =
            if scenario.occluder.is_some() { Scene::new(&scenario, self.sensor.full_dn()) } else { self.scene.clone() };
        Ok(Self { scenario, actors, scene, take, ..self.clone() })
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
        self.scene.pixels() * self.format.bytes_per_pixel()
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
        // The first take has the noise that every film of this scenario had before there were takes.
        let noise = key(self.scenario.seed.wrapping_add(scramble(self.take)), NOISE, index);
        let row_bytes = self.width_px() as usize * self.format.bytes_per_pixel();
        self.draw(index, |row, light| {
            self.sensor.expose(noise, row, light, &mut bytes[row * row_bytes..(row + 1) * row_bytes]);
        });
    }

    /// Draws a frame without noise, fixed pattern, rounding and clipping, DN.
    pub fn render_light(&self, index: u64) -> Image {
        let (width, height) = (self.width_px() as usize, self.height_px() as usize);
        let mut image = Image::new(width, height);
        let pixels = image.data_mut();
        self.draw(index, |row, light| pixels[row * width..(row + 1) * width].copy_from_slice(light));
        image
    }

    /// Draws a frame's light and hands it out row by row.
    fn draw(&self, index: u64, mut take: impl FnMut(usize, &mut [f32])) {
        assert!(index < self.frames(), "frame {index} of a film of {}", self.frames());
        let height = self.height_px() as usize;
        let is_global = self.scenario.camera.row_time_us.total_cmp(&0.0).is_eq();
        // A rolling shutter shows each row at a time of its own.
        for first in (0..height).step_by(if is_global { height } else { 1 }) {
            let rows = first..if is_global { height } else { first + 1 };
            self.draw_rows(self.opens_s(index) + self.read_s(first as f64), rows, &mut take);
        }
    }

    /// The same of rows that were exposed at once.
    fn draw_rows(&self, start_s: f64, rows: Range<usize>, take: &mut impl FnMut(usize, &mut [f32])) {
        let width = self.width_px() as usize;
        let times = self.exposed(start_s);
        let draw = |(number, actor): (usize, &Actor)| {
            let moments: Vec<Moment> = times.iter().map(|time_s| self.moment(number, *time_s)).collect();
            actor.body.draw(&moments, actor.zoom(start_s + 0.5 * self.exposure_s()), width, rows.clone())
        };
        let patches: Vec<Patch> = self.actors.iter().enumerate().map(draw).collect();
        let occluders: Vec<Option<HalfPlane>> = times.iter().map(|time_s| self.scene.occluder_at(*time_s)).collect();
        let lamp = self.scene.lamp(start_s, self.exposure_s());
        let mut light = vec![0.0; width];
        for row in rows {
            self.scene.row(&occluders, &patches, row, &mut light);
            light.iter_mut().for_each(|light| *light *= lamp);
            take(row, &mut light);
        }
    }

    /// The truth of a frame about the first body, as a row of the `velocity` table with all uncertainties 0.
    ///
    /// Everything is told of the middle of the exposure, which is the moment the
    /// picture shows, where the shutter rolls the body's centre; `stamp_ns` is the
    /// exposure's start, as a camera reports it. The last frame has no step.
    pub fn truth(&self, index: u64) -> VelocitySample {
        self.truth_of(0, index)
    }

    /// The truth of a frame about every body, as [`truth`](Self::truth).
    pub fn truths(&self, index: u64) -> Vec<VelocitySample> {
        (0..self.actors.len()).map(|number| self.truth_of(number, index)).collect()
    }

    fn truth_of(&self, number: usize, index: u64) -> VelocitySample {
        let actor = &self.actors[number];
        let Actor { scenario, path, .. } = actor;
        let seen_s = self.seen_s(actor, index);
        let (pose, radius_px) = (actor.pose(seen_s), actor.radius_px(seen_s));
        let visible = self.visible_fraction(number, seen_s);
        let next = (index + 1 < self.frames()).then(|| actor.pose(self.seen_s(actor, index + 1)));
        VelocitySample {
            frame: index,
            body: number as u32,
            stamp_ns: self.stamp_ns(index),
            center_x_px: Some(pose.center_px[0]),
            center_y_px: Some(pose.center_px[1]),
            radius_px: scenario.body.rod.is_none().then_some(radius_px),
            step: next.map(|next| step(&pose, &next)),
            velocity: Some(velocity(&pose, tangent(scenario))),
            visible_fraction: Some(visible),
            phase: phase(path, seen_s),
            status: status(scenario, &pose, visible),
        }
    }

    /// Share of a body's outline that nothing hides.
    fn visible_fraction(&self, number: usize, time_s: f64) -> f64 {
        let actor = &self.actors[number];
        if actor.scenario.body.rod.is_some() {
            // A rod's mark is above the flat, which covers the rod's end.
            return 1.0;
        }
        let Moment { pose, occluder, front } = self.moment(number, time_s);
        match (occluder, front) {
            (plane, Some(front)) => {
                let covers: Vec<Cover> = plane.map(Cover::Edge).into_iter().chain([Cover::Ball(front)]).collect();
                visible_fraction(&actor.round(time_s), &covers)
            }
            (Some(plane), None) => plane.visible_fraction(pose.center_px, actor.radius_px(time_s)),
            (None, None) => 1.0,
        }
    }

    /// Turned since the first frame, counter-clockwise, deg: the first body.
    pub fn angle_deg(&self, index: u64) -> f64 {
        let actor = &self.actors[0];
        let angle = |index: u64| actor.path.at(self.seen_s(actor, index)).angle_rad;
        (angle(index) - angle(0)).to_degrees()
    }

    /// The truth of the first body's collision, all uncertainties 0; times count from the first frame's stamp.
    pub fn impact(&self) -> Option<Impact> {
        self.impact_of(0)
    }

    /// The truth of every body's collision, as [`impact`](Self::impact).
    pub fn impacts(&self) -> Vec<Impact> {
        (0..self.actors.len()).filter_map(|number| self.impact_of(number)).collect()
    }

    fn impact_of(&self, number: usize) -> Option<Impact> {
        let Actor { scenario, path, .. } = &self.actors[number];
        let (MotionSetup::Impact(setup), Path::Impact { collision, .. }) = (&scenario.motion, path) else {
            return None;
        };
        let mut impact = impact(collision, setup, 0.5e-3 * scenario.body.diameter_mm);
        impact.body = number as u32;
        impact.origin_ns = scenario.camera.start_ns;
        impact.force_law = setup.law.force_law();
        Some(impact)
    }

    /// When a frame shows a body's centre: the middle of its exposure after the first frame's stamp, s.
    fn seen_s(&self, actor: &Actor, index: u64) -> f64 {
        let middle_s = self.opens_s(index) + 0.5 * self.exposure_s();
        // The row that shows it is read while it moves on: each round is as much nearer as rows are read faster than that.
        (0..READ_ROUNDS).fold(middle_s, |time_s, _| middle_s + self.read_s(actor.pose(time_s).center_px[1]))
    }

    /// How much later than the frame's stamp the shutter opens for a row, s.
    ///
    /// A shutter that rolls upwards begins with the last row.
    fn read_s(&self, row_px: f64) -> f64 {
        let camera = &self.scenario.camera;
        let first_px = if camera.row_time_us < 0.0 { f64::from(camera.height_px - 1) } else { 0.0 };
        1e-6 * camera.row_time_us * (row_px - first_px)
    }

    /// Start of a frame's exposure after the first frame's stamp, s.
    fn opens_s(&self, index: u64) -> f64 {
        index as f64 / self.frame_rate_hz()
    }

    fn exposure_s(&self) -> f64 {
        1e-6 * self.scenario.camera.exposure_us
    }

    fn moment(&self, number: usize, time_s: f64) -> Moment {
        let front = self.actors.get(number + 1).map(|actor| actor.round(time_s));
        Moment { pose: self.actors[number].pose(time_s), occluder: self.scene.occluder_at(time_s), front }
    }

    /// Times whose mean picture is the exposure's: two Gauss points for each half pixel of motion.
    fn exposed(&self, start_s: f64) -> Vec<f64> {
        let exposure_s = self.exposure_s();
        let moved_px = self.actors.iter().map(|actor| actor.moved_px(start_s, exposure_s)).fold(0.0, f64::max)
            + self.scene.occluder_px_s().abs() * exposure_s;
        if moved_px < STILL_PX {
            return vec![start_s + 0.5 * exposure_s];
        }
        let panels = (moved_px / PANEL_PX).ceil() as usize;
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

    fn world() -> World {
        let mut scenario = Scenario::translation(0.0, 0.0, 0.0);
        (scenario.camera.width_px, scenario.camera.height_px) = (150, 150);
        scenario.motion = motion(0.0, [74.2, 74.6]);
        World::new(&scenario).unwrap()
    }

    fn frame(world: &World, index: u64) -> Vec<u8> {
        let mut bytes = vec![0; world.frame_bytes()];
        world.render(index, &mut bytes);
        bytes
    }

    #[test]
    fn a_retake_is_the_film_that_a_world_of_its_own_draws_with_noise_of_its_own() {
        let first = world();
        let moved = motion(0.7, [73.1, 75.4]);
        let own = World::new(&Scenario { motion: moved.clone(), ..first.scenario().clone() }).unwrap();
        let again = first.retake(moved.clone(), 0).unwrap();
        assert_eq!(frame(&again, 2), frame(&own, 2), "take 0 has the first film's noise");
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
