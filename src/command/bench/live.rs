//! `ricochet bench live`: the time per frame of a film on one core, and its parts.

use std::io::Write;
use std::time::Duration;

use serde_json::json;

use super::{BenchOptions, rate_per_s, time_call};
use crate::ball::{BallFinder, BallParams, Presence};
use crate::camera::simulated;
use crate::config::DEFAULT_BLOCK_FRAMES;
use crate::dic::grid;
use crate::dic::{
    CorrelationParams, Correlator, GridPoint, PlanarMotion, Point, PreparedFrame, Region, RigidBody, Shape, Start,
    rigid_fit_near,
};
use crate::failure::Failure;
use crate::image::{Frame, FrameMeta, Image};
use crate::measure::{BodyParams, MeasureParams, Measured, Measurer, OUTLINE_INTERVAL_FRAMES, Share};
use crate::motion::Rotation;
use crate::numeric::quantile;
use crate::results::{Circle, FieldPoint};
use crate::synth::{Scenario, SimulatedFilm};

/// Motion of the ball per frame, px, px and deg.
const MOTION: PlanarMotion = PlanarMotion { u_px: 0.37, v_px: -0.21, angle_deg: 0.13 };

/// Grid step, px: 60 subsets of 31 x 31 px on a ball of 120 px.
const STEP_PX: u32 = 9;

/// The margin that is prepared around a predicted ball, px.
const PREDICTED_PX: f64 = 8.0;
/// The margin that is prepared around a searched ball, px.
const SEARCHED_PX: f64 = 22.0;

/// Measures the frames of a simulated film of 512 x 512 px with one ball of 120 px.
///
/// # Errors
///
/// When the ball cannot be measured or the result cannot be printed.
pub(super) fn run(options: &BenchOptions) -> Result<(), Failure> {
    let duration = options.duration();
    let film = Film::new()?;
    let whole = film.time_frame_us(Rotation::Rigid, duration)?;
    let alone = film.time_frame_us(Rotation::Field, duration)?;
    let (subsets, parts) = film.time_parts_us(duration)?;
    let mut rows = vec![("frame, whole ball and subsets", whole.all)];
    let rest = whole.all - parts.per_frame.iter().map(|(_, us)| us).sum::<f64>();
    rows.extend(parts.per_frame);
    rows.push(("  other", rest));
    rows.push(("frame in which the ball is tracked", whole.following));
    rows.push(("frame in which the ball is searched, 1 in 32", whole.finding));
    rows.push(("frame, subsets only", alone.all));
    rows.extend(parts.other);
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

/// Frames at the start of a block in which the ball, and then its motion, is searched for.
const FINDING_FRAMES: u64 = 2;

/// Mean time per frame, us, over the medians of repeats, which outliers do not affect.
struct FrameTimes {
    all: f64,
    /// Frames in which the ball is predicted from previous frames.
    following: f64,
    /// The first frames of a block.
    finding: f64,
}

/// Times of parts, us.
struct PartTimes {
    /// The parts of a frame with whole-body match and subsets.
    per_frame: Vec<(&'static str, f64)>,
    other: Vec<(&'static str, f64)>,
}

/// A film in memory.
struct Film {
    frames: Vec<(FrameMeta, Vec<u8>)>,
    ball: BallParams,
}

impl Film {
    /// Draws a film of a moving ball of 120 px.
    fn new() -> Result<Self, Failure> {
        let mut scenario = Scenario::translation(MOTION.u_px, MOTION.v_px, MOTION.angle_deg);
        scenario.camera.frames = 64;
        let film = SimulatedFilm::new(&scenario)?;
        let drawn = (0..film.frames()).map(|index| {
            let mut bytes = vec![0; film.frame_bytes()];
            film.render(index, &mut bytes);
            (simulated::meta(&film, index), bytes)
        });
        Ok(Self { frames: drawn.collect(), ball: BallParams::new(50.0, 70.0) })
    }

    /// Measures the time a worker needs per frame, us, by repeating the film for `duration`. Each frame counts with its
    /// median.
    fn time_frame_us(&self, rotation: Rotation, duration: Duration) -> Result<FrameTimes, Failure> {
        let params = MeasureParams {
            correlation: CorrelationParams { step_px: STEP_PX, ..CorrelationParams::default() },
            intervals_frames: vec![1],
            rotation,
            bodies: vec![BodyParams::Ball(self.ball.clone())],
            tone: None,
            defective_px: Vec::new(),
            block_frames: DEFAULT_BLOCK_FRAMES,
        };
        let mut measurer = Measurer::new(&params, Share::ALL, 512, 512)?;
        let mut failed = None;
        let mut measured: Vec<Measured> = Vec::new();
        let mut seconds = vec![Vec::new(); self.frames.len()];
        rate_per_s(duration, || {
            measurer.reset();
            for ((meta, bytes), seconds) in self.frames.iter().zip(&mut seconds) {
                measured.clear();
                let (result, spent) = time_call(|| measurer.push(&Frame { meta: *meta, bytes }, &mut measured));
                failed = result.err().or(failed.take());
                seconds.push(spent);
            }
            self.frames.len()
        });
        if let Some(error) = failed {
            return Err(error.into());
        }
        let is_finding = |frame: usize| frame as u64 % u64::from(DEFAULT_BLOCK_FRAMES) < FINDING_FRAMES;
        let us: Vec<f64> = seconds.iter_mut().map(|seconds| 1e6 * quantile(seconds, 0.5).unwrap_or(f64::NAN)).collect();
        let mean = |of: &dyn Fn(usize) -> bool| {
            let of = || us.iter().enumerate().filter(|(frame, _)| of(*frame));
            of().map(|(_, us)| us).sum::<f64>() / of().count() as f64
        };
        Ok(FrameTimes {
            all: mean(&|_| true),
            following: mean(&|frame| !is_finding(frame)),
            finding: mean(&is_finding),
        })
    }

    /// Measures the durations of the parts of a frame, us, each over `duration`; also returns the number of subsets.
    ///
    /// # Errors
    ///
    /// When the ball is not found in the film, or cannot be matched.
    fn time_parts_us(&self, duration: Duration) -> Result<(usize, PartTimes), Failure> {
        let (mut first, mut second) = (Image::new(512, 512), Image::new(512, 512));
        for (image, (meta, bytes)) in [(&mut first, &self.frames[20]), (&mut second, &self.frames[21])] {
            Frame { meta: *meta, bytes }.unpack(image)?;
        }
        let mut finder = BallFinder::new(&self.ball, 512, 512)?;
        let circle = finder.find(first.view()).ok_or_else(|| Failure::internal("cannot find the ball of the film"))?;
        let moved = Circle { x_px: circle.x_px + MOTION.u_px, y_px: circle.y_px + MOTION.v_px, ..circle };
        let cold = rate_per_s(duration, || usize::from(finder.find(second.view()).is_some()));
        // The whole-body match has confirmed the ball.
        let follow = rate_per_s(duration, || {
            usize::from(finder.follow_closely(second.view(), &moved, Presence::Certain).is_some())
        });
        let images = (&first, &second);
        let mut pair = Pair::new(&circle, images, Shape::Affine, PREDICTED_PX)?;
        let mut anywhere = Pair::new(&circle, images, Shape::Affine, SEARCHED_PX)?;
        let mut still = Pair::new(&circle, images, Shape::Translation, SEARCHED_PX)?;
        let subsets = pair.points.len();
        let part = part_around(&circle, PREDICTED_PX);
        let (meta, bytes) = &self.frames[21];
        let unpack = rate_per_s(duration, || {
            usize::from(Frame { meta: *meta, bytes }.unpack_part(part.into(), &mut second).is_ok())
        });
        let ready = rate_per_s(duration, || {
            pair.correlator.prepare_part_into(second.view(), part, &mut pair.target);
            1
        });
        let predicted = rate_per_s(duration, || pair.correlate_subsets(pair.near));
        let fit = rate_per_s(duration, || pair.fit_motion(&circle));
        let neighbor = rate_per_s(duration, || anywhere.correlate_subsets(Start::Neighbor));
        let whole = rate_per_s(duration, || usize::from(pair.match_ball(&circle)));
        let kept = still.correlator.keep_reference(still.reference.clone(), &still.points);
        let mut field = Vec::new();
        let translation = rate_per_s(duration, || {
            still.correlator.correlate_kept(&kept, &still.target, still.near, &mut field);
            1
        });
        let per_frame = [
            ("  unpack the region of the ball", unpack),
            ("  prepare it", ready),
            ("  match the whole ball, with its mask", whole),
            ("  subsets: affine, from the ball's motion", predicted),
            ("  fit their rigid motion", fit),
            ("  track the circle, once in 4 frames", OUTLINE_INTERVAL_FRAMES as f64 * follow),
            ("  search the circle anywhere, once in 64 frames", f64::from(DEFAULT_BLOCK_FRAMES) * cold),
        ];
        let other =
            [("subsets: affine, from neighbours", neighbor), ("subsets: translation, kept reference", translation)];
        let us = |(name, rate): (&'static str, f64)| (name, 1e6 / rate);
        Ok((subsets, PartTimes { per_frame: per_frame.map(us).to_vec(), other: other.map(us).to_vec() }))
    }
}

/// Two prepared frames around the ball.
struct Pair {
    correlator: Correlator,
    reference: PreparedFrame,
    target: PreparedFrame,
    points: Vec<GridPoint>,
    near: Start,
    body: RigidBody,
    field: Vec<FieldPoint>,
}

impl Pair {
    /// Prepares two frames and the ball in them, with a margin of `margin_px` around it.
    fn new(circle: &Circle, (first, second): (&Image, &Image), shape: Shape, margin_px: f64) -> Result<Self, Failure> {
        let params = CorrelationParams { step_px: STEP_PX, shape, ..CorrelationParams::default() };
        let correlator = Correlator::new(&params, 512, 512)?;
        let (x_px, y_px) = (circle.x_px, circle.y_px);
        let radius_px = 0.96 * circle.radius_px;
        let points = grid::disc(x_px, y_px, radius_px, STEP_PX, params.subset_size_px, 512, 512);
        let (mut reference, mut target) = (PreparedFrame::default(), PreparedFrame::default());
        let part = part_around(circle, margin_px);
        correlator.prepare_part_into(first.view(), part, &mut reference);
        correlator.prepare_part_into(second.view(), part, &mut target);
        let body = RigidBody::new(&reference, &Region::Disc { x_px, y_px, radius_px })
            .map_err(|status| Failure::internal(format!("cannot match the ball of the film: {}", status.as_str())))?;
        let PlanarMotion { u_px, v_px, angle_deg } = MOTION;
        let near = Start::Motion { x_px, y_px, u_px, v_px, angle_deg };
        Ok(Self { correlator, reference, target, points, near, body, field: Vec::new() })
    }

    /// Correlates all subsets with a new reference; returns 1, a field.
    fn correlate_subsets(&mut self, start: Start) -> usize {
        self.correlator.correlate(&self.reference, &self.target, &self.points, start, &mut self.field);
        1
    }

    /// Fits the rigid motion of the last field; returns the number of motions found.
    fn fit_motion(&mut self, circle: &Circle) -> usize {
        let subset_px = self.correlator.params().subset_size_px;
        let motion = rigid_fit_near(&mut self.field, Point::new(circle.x_px, circle.y_px), subset_px, Some(MOTION));
        usize::from(motion.is_some())
    }

    /// Matches the whole ball, from a start as far off as a typical prediction; returns whether it was found.
    fn match_ball(&mut self, circle: &Circle) -> bool {
        let PlanarMotion { u_px, v_px, angle_deg } = MOTION;
        let near = PlanarMotion { u_px: u_px - 0.004, v_px: v_px + 0.003, angle_deg: angle_deg + 0.006 };
        self.body.find_visible(&self.target, Point::new(circle.x_px, circle.y_px), near).is_ok()
    }
}

/// Returns the part of a frame (x, y, width, height) that holds a ball and a margin, px.
fn part_around(circle: &Circle, margin_px: f64) -> [u32; 4] {
    let reach = circle.radius_px + margin_px;
    let side = (2.0 * reach).ceil() as u32 + 1;
    [(circle.x_px - reach).floor() as u32, (circle.y_px - reach).floor() as u32, side, side]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_of_a_frame_takes_time() {
        let film = Film::new().unwrap();
        let frame = film.time_frame_us(Rotation::Rigid, Duration::from_millis(1)).unwrap();
        assert!([frame.all, frame.following, frame.finding].iter().all(|us| us.is_finite() && *us > 0.0));
        let (subsets, parts) = film.time_parts_us(Duration::from_millis(1)).unwrap();
        assert!((55..75).contains(&subsets), "{subsets}");
        let mut rows = parts.per_frame.iter().chain(&parts.other);
        assert!(rows.all(|(_, us)| us.is_finite() && *us > 0.0), "{:?} {:?}", parts.per_frame, parts.other);
    }
}
