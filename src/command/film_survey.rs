//! The survey of a film: what moves in it, read in a few passes so that only some frames are in memory.

use super::result_film::{self, OpenedFilm};
use crate::console::{UsageError, progress};
use crate::failure::Failure;
use crate::image::{Frame, FrameMeta, Image};
use crate::import::Order;
use crate::survey::{ExaminedFrame, Follower, Identified, Movement, Mover, Path, Sampler, identify, needed_frames};
use indicatif::ProgressBar;
use std::collections::BTreeSet;
use std::path::PathBuf;

/// A film on disk.
#[derive(Debug, Clone)]
pub(super) struct FilmFiles {
    /// A recording, the parts of one stream, footage, or the images of a sequence.
    pub(super) inputs: Vec<PathBuf>,
    /// The camera, by the name of its view.
    pub(super) camera: Option<String>,
    /// The rate that the user gave, Hz.
    pub(super) fps: Option<f64>,
    /// The order of the images of a sequence.
    pub(super) order: Order,
}

/// A film and what moves in it.
#[derive(Debug)]
pub(super) struct Surveyed {
    pub(super) size_px: [usize; 2],
    pub(super) count: u64,
    /// Frames per second.
    pub(super) frame_rate_hz: f64,
    /// The source of that number.
    pub(super) rate_source: String,
    /// `None` for fewer than three frames.
    pub(super) movement: Option<Movement>,
    pub(super) bodies: Vec<SurveyedBody>,
}

/// Something that moves.
#[derive(Debug)]
pub(super) struct SurveyedBody {
    pub(super) mover: Mover,
    pub(super) kind: Identified,
    /// The motion of a ball.
    pub(super) path: Option<Path>,
}

impl FilmFiles {
    /// Opens the film at its first frame.
    pub(super) fn open(&self) -> Result<OpenedFilm, Failure> {
        result_film::open(&self.inputs, self.camera.as_deref(), self.fps, self.order)
    }

    /// Passes the frames to `visitor`, each with its number from 0, until it returns [`Visit::Stop`].
    ///
    /// # Errors
    ///
    /// When the film cannot be read, or `visitor` fails.
    pub(super) fn visit(
        &self,
        mut visitor: impl FnMut(u64, FrameMeta, &[u8]) -> Result<Visit, Failure>,
    ) -> Result<(), Failure> {
        for (index, frame) in (0..).zip(self.open()?.frames) {
            let (meta, bytes) = frame?;
            if visitor(index, meta, &bytes)? == Visit::Stop {
                break;
            }
        }
        Ok(())
    }

    /// Returns the frame of this number, from 0: its header and its pixels as they are stored.
    ///
    /// # Errors
    ///
    /// When the film is shorter or cannot be read.
    pub(super) fn frame(&self, number: u64) -> Result<(FrameMeta, Vec<u8>), Failure> {
        let mut found = None;
        self.visit(|index, meta, bytes| {
            if index < number {
                return Ok(Visit::Continue);
            }
            found = Some((meta, bytes.to_vec()));
            Ok(Visit::Stop)
        })?;
        found.ok_or_else(|| UsageError(format!("the film has no frame {number}")).into())
    }
}

/// Whether more frames are wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Visit {
    Continue,
    Stop,
}

/// Surveys a film.
///
/// # Errors
///
/// When the film cannot be read, has no frame, or its frames differ in size.
pub(super) fn survey(film: &FilmFiles) -> Result<Surveyed, Failure> {
    let opened = film.open()?;
    let OpenedFilm { frame_rate_hz, rate_source, count: announced, warnings, .. } = opened;
    warnings.iter().for_each(|warning| log::warn!("{warning}"));
    drop(opened.frames);
    let bar = progress::bar(3 * announced, "survey");
    let SampledFilm { size_px, sampler, count } = sample_frames(film, announced, &bar)?;
    let movement = sampler.detect_movement();
    let kinds = match &movement {
        Some(movement) => identify_all(film, movement, size_px, &bar)?,
        None => Vec::new(),
    };
    let movers = movement.iter().flat_map(|movement| movement.movers.iter().cloned());
    let bodies = movers.zip(kinds).map(|(mover, kind)| SurveyedBody { mover, kind, path: None });
    let mut bodies = bodies.fold(Vec::new(), add_or_join);
    follow_all(film, &mut bodies, size_px, &bar)?;
    bar.finish_and_clear();
    Ok(Surveyed { size_px, count, frame_rate_hz, rate_source, movement, bodies })
}

/// Adds a body, or joins it with the same ball seen elsewhere at other times: where it is slow, and where it is fast.
fn add_or_join(mut bodies: Vec<SurveyedBody>, body: SurveyedBody) -> Vec<SurveyedBody> {
    let is_apart = |other: &SurveyedBody| {
        let times = |body: &SurveyedBody| body.mover.appearances.iter().map(|a| a.index).collect::<BTreeSet<_>>();
        times(other).is_disjoint(&times(&body))
    };
    let same = bodies.iter().position(|other| other.kind.is_same_ball(&body.kind) && is_apart(other));
    match same {
        Some(place) => bodies[place].mover = bodies[place].mover.merged_with(&body.mover),
        None => bodies.push(body),
    }
    bodies
}

/// A film whose frames were sampled.
struct SampledFilm {
    size_px: [usize; 2],
    sampler: Sampler,
    /// The number of frames.
    count: u64,
}

/// Reads all frames of the film, and samples some of them.
///
/// `announced` is the number of frames in the file's header, by which the samples are spread.
///
/// # Errors
///
/// When the film cannot be read, has no frame, or its frames differ in size.
fn sample_frames(film: &FilmFiles, announced: u64, bar: &ProgressBar) -> Result<SampledFilm, Failure> {
    let mut sampled: Option<([usize; 2], Sampler)> = None;
    let (mut image, mut count) = (Image::default(), 0);
    film.visit(|index, meta, bytes| {
        bar.inc(1);
        count = index + 1;
        let size_px = [meta.width_px as usize, meta.height_px as usize];
        let (expected, sampler) =
            sampled.get_or_insert_with(|| (size_px, Sampler::new(size_px[0], size_px[1], announced)));
        if *expected != size_px {
            return Err(UsageError(format!("frame {index} has another size than the first one")).into());
        }
        if sampler.takes(index) {
            Frame { meta, bytes }.unpack(&mut image)?;
            sampler.push(index, image.view());
        }
        Ok(Visit::Continue)
    })?;
    let (size_px, sampler) = sampled.ok_or_else(|| UsageError("cannot survey a film of 0 frames".into()))?;
    Ok(SampledFilm { size_px, sampler, count })
}

/// Identifies the movers in the frames that show them best.
fn identify_all(
    film: &FilmFiles,
    movement: &Movement,
    size_px: [usize; 2],
    bar: &ProgressBar,
) -> Result<Vec<Identified>, Failure> {
    let needed = needed_frames(movement);
    let mut examinations = identify(movement, size_px);
    let mut image = Image::default();
    film.visit(|index, meta, bytes| {
        bar.inc(1);
        if needed.binary_search(&index).is_ok() {
            Frame { meta, bytes }.unpack(&mut image)?;
            let frame = ExaminedFrame { index, image: image.view() };
            examinations.iter_mut().for_each(|examination| examination.push(frame));
        }
        Ok(if needed.last().is_some_and(|last| index < *last) { Visit::Continue } else { Visit::Stop })
    })?;
    Ok(examinations.into_iter().map(crate::survey::Examination::finish).collect())
}

/// Follows every ball through all frames. One that is followed in fewer frames than it was found in becomes unknown.
fn follow_all(
    film: &FilmFiles,
    bodies: &mut [SurveyedBody],
    size_px: [usize; 2],
    bar: &ProgressBar,
) -> Result<(), Failure> {
    let mut followers = Vec::new();
    for (place, body) in bodies.iter().enumerate() {
        if let Some(radius_px) = body.kind.ball_radius_px() {
            let follower = Follower::new(&body.mover, radius_px, size_px);
            followers.push((place, follower.map_err(|error| UsageError(error.to_string()))?));
        }
    }
    if followers.is_empty() {
        return Ok(());
    }
    let (mut image, mut first_ns) = (Image::default(), None);
    film.visit(|index, meta, bytes| {
        bar.inc(1);
        let t_s = meta.stamp_ns.saturating_sub(*first_ns.get_or_insert(meta.stamp_ns)) as f64 * 1e-9;
        Frame { meta, bytes }.unpack(&mut image)?;
        let frame = ExaminedFrame { index, image: image.view() };
        followers.iter_mut().for_each(|(_, follower)| follower.push(frame, t_s));
        Ok(Visit::Continue)
    })?;
    for (place, follower) in followers {
        let (body, track) = (&mut bodies[place], follower.finish());
        // Circles that cannot be followed were none of a ball.
        if track.len() < body.kind.found_frames() {
            body.kind = Identified::Unknown;
        } else {
            body.path = Some(Path::from_track(track));
        }
    }
    Ok(())
}
