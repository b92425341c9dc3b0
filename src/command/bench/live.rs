//! `ricochet bench live`: what a frame of a film takes on one core, and its parts.

use std::io::Write;
use std::time::Duration;

use serde_json::json;

use super::rate;
use crate::ball::{BallFinder, BallParams};
use crate::camera::simulated;
use crate::dic::{CorrelationParams, Correlator, GridPoint, Prepared, Region, RigidBody, Shape, Start, grid};
use crate::image::{Frame, FrameMeta, Image};
use crate::measure::{BodyParams, MeasureParams, Measured, Measurer, Share};
use crate::motion::Rotation;
use crate::results::Circle;
use crate::synth::{Scenario, World};

/// Motion of the ball, px, px and deg a frame.
const MOTION: (f64, f64, f64) = (0.37, -0.21, 0.13);

/// From one subset centre to the next, px: 60 subsets of 31 x 31 px on a ball of 120 px.
const STEP_PX: u32 = 9;

/// What `ricochet bench live` was asked to do.
#[derive(Debug, Clone)]
pub struct LiveOptions {
    /// Machine-readable output.
    pub json: bool,
    /// How long each part is measured, s.
    pub seconds: f64,
}

/// Measures the frames of a simulated film of 512 x 512 px with one ball of 120 px.
///
/// # Errors
///
/// When the result cannot be written.
pub fn live(options: &LiveOptions) -> anyhow::Result<()> {
    let duration = Duration::from_secs_f64(options.seconds.clamp(0.01, 60.0));
    let film = Film::new()?;
    let mut rows = Vec::new();
    for (name, rotation) in
        [("a frame, whole ball and subsets", Rotation::Rigid), ("a frame, subsets alone", Rotation::Field)]
    {
        rows.push((name, film.frame_us(rotation, duration)?));
    }
    let (subsets, parts) = film.parts_us(duration)?;
    rows.extend(parts);
    let mut out = std::io::stdout().lock();
    if options.json {
        let rows: Vec<_> = rows.iter().map(|(name, us)| json!({ "part": name, "us": us })).collect();
        writeln!(out, "{}", serde_json::to_string_pretty(&json!({ "subsets": subsets, "live": rows }))?)?;
        return Ok(());
    }
    writeln!(out, "{:48} {:>10}", format!("512 x 512 px, ball of 120 px, {subsets} subsets"), "us")?;
    for (name, us) in rows {
        writeln!(out, "{name:48} {us:>10.1}")?;
    }
    Ok(())
}

/// A film in memory.
struct Film {
    frames: Vec<(FrameMeta, Vec<u8>)>,
    ball: BallParams,
}

impl Film {
    fn new() -> anyhow::Result<Self> {
        let mut scenario = Scenario::translation(MOTION.0, MOTION.1, MOTION.2);
        scenario.camera.frames = 64;
        let world = World::new(&scenario)?;
        let drawn = (0..world.frames()).map(|index| {
            let mut bytes = vec![0; world.frame_bytes()];
            world.render(index, &mut bytes);
            (simulated::meta(&world, index), bytes)
        });
        Ok(Self { frames: drawn.collect(), ball: BallParams::new(50.0, 70.0) })
    }

    /// Microseconds of everything that a worker does with a frame.
    fn frame_us(&self, rotation: Rotation, duration: Duration) -> anyhow::Result<f64> {
        let params = MeasureParams {
            correlation: CorrelationParams { step_px: STEP_PX, ..CorrelationParams::default() },
            intervals_frames: vec![1],
            rotation,
            bodies: vec![BodyParams::Ball(self.ball.clone())],
            block_frames: 16,
        };
        let mut measurer = Measurer::new(&params, Share::ALL, 512, 512)?;
        let mut failed = None;
        let mut measured: Vec<Measured> = Vec::new();
        let frames = rate(duration, || {
            measurer.reset();
            for (meta, bytes) in &self.frames {
                measured.clear();
                failed = measurer.push(&Frame { meta: *meta, bytes }, &mut measured).err().or(failed.take());
            }
            self.frames.len()
        });
        match failed {
            Some(error) => Err(error.into()),
            None => Ok(1e6 / frames),
        }
    }

    /// How many subsets there are, and microseconds of each part of a frame.
    fn parts_us(&self, duration: Duration) -> anyhow::Result<(usize, Vec<(&'static str, f64)>)> {
        let (mut first, mut second) = (Image::new(512, 512), Image::new(512, 512));
        for (image, (meta, bytes)) in [(&mut first, &self.frames[20]), (&mut second, &self.frames[21])] {
            Frame { meta: *meta, bytes }.unpack(image)?;
        }
        let mut finder = BallFinder::new(&self.ball, 512, 512)?;
        let circle = finder.find(first.view()).ok_or_else(|| anyhow::anyhow!("the ball of the film is not found"))?;
        let cold = rate(duration, || usize::from(finder.find(second.view()).is_some()));
        let follow = rate(duration, || usize::from(finder.follow(second.view(), &circle).is_some()));
        let mut pair = Pair::new(&circle, (&first, &second), Shape::Affine)?;
        let subsets = pair.points.len();
        let part = pair.part(&circle);
        let ready = rate(duration, || {
            pair.correlator.prepare_part_into(second.view(), part, &mut pair.target);
            1
        });
        let affine = rate(duration, || pair.subsets());
        let whole = rate(duration, || usize::from(pair.whole(&circle)));
        let mut pair = Pair::new(&circle, (&first, &second), Shape::Translation)?;
        let kept = pair.correlator.keep(pair.reference.clone(), &pair.points);
        let mut field = Vec::new();
        let translation = rate(duration, || {
            pair.correlator.correlate_kept(&kept, &pair.target, pair.near, &mut field);
            1
        });
        let rows = [
            ("find the circle anywhere", cold),
            ("follow the circle", follow),
            ("make the ball's part of a frame ready", ready),
            ("match the whole ball, mask included", whole),
            ("subsets: affine, a new reference", affine),
            ("subsets: translation, a kept reference", translation),
        ];
        Ok((subsets, rows.map(|(name, rate)| (name, 1e6 / rate)).to_vec()))
    }
}

/// Two frames made ready where the ball is.
struct Pair {
    correlator: Correlator,
    reference: Prepared,
    target: Prepared,
    points: Vec<GridPoint>,
    near: Start,
    body: RigidBody,
}

impl Pair {
    fn new(circle: &Circle, (first, second): (&Image, &Image), shape: Shape) -> anyhow::Result<Self> {
        let params = CorrelationParams { step_px: STEP_PX, shape, ..CorrelationParams::default() };
        let correlator = Correlator::new(&params, 512, 512)?;
        let (x_px, y_px) = (circle.x_px, circle.y_px);
        let radius_px = 0.96 * circle.radius_px;
        let points = grid::disc(x_px, y_px, radius_px, STEP_PX, params.subset_size_px, 512, 512);
        let (mut reference, mut target) = (Prepared::default(), Prepared::default());
        let part = part_around(circle);
        correlator.prepare_part_into(first.view(), part, &mut reference);
        correlator.prepare_part_into(second.view(), part, &mut target);
        let body = RigidBody::new(&reference, &Region::Disc { x_px, y_px, radius_px })
            .map_err(|status| anyhow::anyhow!("ball of the film: {}", status.word()))?;
        let near = Start::Motion { x_px, y_px, u_px: MOTION.0, v_px: MOTION.1, angle_deg: MOTION.2 };
        Ok(Self { correlator, reference, target, points, near, body })
    }

    fn part(&self, circle: &Circle) -> [u32; 4] {
        part_around(circle)
    }

    /// All subsets against a reference that is new.
    fn subsets(&mut self) -> usize {
        let mut field = Vec::new();
        self.correlator.correlate(&self.reference, &self.target, &self.points, self.near, &mut field);
        1
    }

    /// The whole ball, from a start about as far off as a prediction is.
    fn whole(&mut self, circle: &Circle) -> bool {
        let near = (MOTION.0 - 0.02, MOTION.1 + 0.03, MOTION.2 + 0.05);
        self.body.find_visible(&self.target, (circle.x_px, circle.y_px), near).is_ok()
    }
}

/// The part of a frame that holds a ball and 16 px around it.
fn part_around(circle: &Circle) -> [u32; 4] {
    let reach = circle.radius_px + 22.0;
    let side = (2.0 * reach).ceil() as u32 + 1;
    [(circle.x_px - reach).floor() as u32, (circle.y_px - reach).floor() as u32, side, side]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_of_a_frame_takes_its_time() {
        let film = Film::new().unwrap();
        assert!(film.frame_us(Rotation::Rigid, Duration::from_millis(1)).unwrap() > 0.0);
        let (subsets, parts) = film.parts_us(Duration::from_millis(1)).unwrap();
        assert!((55..75).contains(&subsets), "{subsets}");
        assert!(parts.iter().all(|(_, us)| us.is_finite() && *us > 0.0), "{parts:?}");
    }
}
