//! Evidence of a body in a frame: the search of the rig file, and one without its limits.

use super::choice::Choice;
use crate::ball::{BallFinder, BallParams};
use crate::command::film_survey::{Surveyed, SurveyedBody};
use crate::config::Config;
use crate::failure::Failure;
use crate::image::{Correction, FrameMeta, Image};
use crate::measure::BodyParams;
use crate::process::analysis_params;
use crate::results::{Circle, PairField, PointStatus, TrackSample};
use crate::rod::RodFinder;
use crate::survey::Identified;

/// The radius of the smallest ball whose outline can be measured, px.
const MIN_RADIUS_PX: f64 = 6.0;
/// The largest radius of a search without limits, relative to the smaller side of the image.
const MAX_RADIUS_SHARE: f64 = 0.45;

/// The evidence of a body in one frame.
#[derive(Debug)]
pub(super) struct Evidence {
    /// The number of the frame in the film, from 0.
    pub(super) index: u64,
    pub(super) time_ms: f64,
    pub(super) choice: Choice,
    /// Grey levels of 0 to 255.
    pub(super) levels: Vec<u8>,
    /// The reduced pixels that differ from the background.
    pub(super) is_moving: Option<Vec<bool>>,
    pub(super) track: Option<TrackSample>,
    pub(super) field: Option<PairField>,
    pub(super) searched: Searched,
}

/// The outlines found in one frame.
#[derive(Debug, Clone, Default)]
pub(super) struct Searched {
    /// The outline of a ball within the limits of the rig file.
    pub(super) inside: Option<Circle>,
    /// An outline found without these limits.
    pub(super) outside: Option<Circle>,
    /// The status of the search of a rod.
    pub(super) rod: Option<PointStatus>,
    /// The share of the pixels of the ball that are white, 0 to 1.
    pub(super) white_fraction: Option<f64>,
}

impl Evidence {
    /// Returns the circle to show: the measured one, else one that was found within the limits, else one outside.
    pub(super) fn circle(&self) -> Option<Circle> {
        self.measured_circle().or(self.searched.inside).or(self.searched.outside)
    }

    /// Returns the circle of the track row; `None` without a row or a circle in it.
    pub(super) fn measured_circle(&self) -> Option<Circle> {
        let track = self.track?;
        Some(Circle {
            x_px: track.center_x_px?,
            y_px: track.center_y_px?,
            radius_px: track.radius_px?,
            sigma_center_px: track.sigma_center_px.unwrap_or(0.0),
            sigma_radius_px: 0.0,
            visible_fraction: track.visible_fraction.unwrap_or(1.0),
        })
    }

    /// Counts the subsets: all of them, and those of each status, the most frequent first; `None` without a field.
    pub(super) fn count_subsets(&self) -> Option<(usize, Vec<(PointStatus, usize)>)> {
        let points = &self.field.as_ref()?.points;
        let count = |status: PointStatus| points.iter().filter(|point| point.status == status).count();
        let mut counts: Vec<_> = PointStatus::ALL.into_iter().map(|status| (status, count(status))).collect();
        counts.retain(|(_, count)| *count > 0);
        counts.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        Some((points.len(), counts))
    }
}

/// Searches a body in single frames.
pub(super) struct Examiner<'s> {
    correction: Correction,
    inside: Option<BallFinder>,
    outside: Option<BallFinder>,
    rod: Option<RodFinder>,
    surveyed: &'s Surveyed,
}

impl<'s> Examiner<'s> {
    /// Plans the search of one body: within the limits of the rig file, and for a ball without them as well.
    ///
    /// # Errors
    ///
    /// When the finder does not take the limits or the size of the image.
    ///
    /// # Panics
    ///
    /// If there is no body of this index.
    pub(super) fn new(config: &Config, body: usize, surveyed: &'s Surveyed) -> Result<Self, Failure> {
        let [width, height] = surveyed.size_px;
        let format = crate::camera::StreamFormat {
            width_px: width as u32,
            height_px: height as u32,
            format: crate::image::PixelFormat::default(),
            frame_rate_hz: surveyed.frame_rate_hz.max(1.0),
            exposure_us: 0.0,
            coding: crate::results::FrameCoding::default(),
        };
        let (params, _) = analysis_params(config, &format);
        let widest = MAX_RADIUS_SHARE * width.min(height) as f64;
        let any = BallParams::new(MIN_RADIUS_PX, widest.max(MIN_RADIUS_PX + 1.0));
        let (inside, outside, rod) = match &params.bodies[body] {
            BodyParams::Ball(ball) => {
                (Some(BallFinder::new(ball, width, height)?), BallFinder::new(&any, width, height).ok(), None)
            }
            BodyParams::Rod(rod) => (None, None, Some(RodFinder::new(rod, width, height)?)),
            BodyParams::Patch(_) => (None, None, None),
        };
        Ok(Self { correction: params.correction(width, height)?, inside, outside, rod, surveyed })
    }

    /// Searches the body in a frame, whose `image` it corrects. `index` is the number of the frame in the film.
    ///
    /// A ball is searched without limits only if none is found within them. Then it counts only where something moves.
    pub(super) fn search(&mut self, image: &mut Image, index: u64, meta: FrameMeta) -> Searched {
        let white_dn = ((1_u32 << meta.format.bits()) - 1) as f32;
        let is_white: Vec<bool> = image.view().data().iter().map(|level| *level >= white_dn).collect();
        self.correction.correct(image);
        let inside = self.inside.as_mut().and_then(|finder| finder.find(image.view()));
        let followed = |body: &SurveyedBody| {
            let track = &body.path.as_ref()?.track;
            Some(track.iter().find(|point| point.index == index)?.circle)
        };
        // A circle that moves is the body; any other circle belongs to the background.
        let moving = || self.surveyed.bodies.iter().find_map(followed);
        let outside = match (inside, self.outside.as_mut()) {
            (None, Some(finder)) => {
                moving().or_else(|| finder.find(image.view()).filter(|c| self.surveyed.is_moving_at(c)))
            }
            _ => None,
        };
        let white_fraction = inside.map(|circle| fraction_in(&circle, &is_white, meta.width_px as usize));
        let rod = self.rod.as_mut().map(|finder| finder.find(image.view()).err().unwrap_or_default());
        Searched { inside, outside, rod, white_fraction }
    }
}

impl Surveyed {
    /// Whether the centre of a circle lies in a region that something sweeps in the film.
    fn is_moving_at(&self, circle: &Circle) -> bool {
        let (x, y) = (circle.x_px, circle.y_px);
        self.bodies.iter().any(|body| {
            let [left, top, width, height] = body.mover.bounds_px.map(f64::from);
            (left..left + width).contains(&x) && (top..top + height).contains(&y)
        })
    }
}

/// Returns the share of the pixels of a disc that are marked.
fn fraction_in(circle: &Circle, marked: &[bool], width: usize) -> f64 {
    let (mut inside, mut total) = (0_u32, 0_u32);
    for (at, is_marked) in marked.iter().enumerate() {
        let (x, y) = ((at % width) as f64 - circle.x_px, (at / width) as f64 - circle.y_px);
        if x.hypot(y) < circle.radius_px {
            total += 1;
            inside += u32::from(*is_marked);
        }
    }
    f64::from(inside) / f64::from(total.max(1))
}

/// Returns one line about each thing that moves, after a line if nothing, or most of the image, moves.
pub(super) fn mover_lines(surveyed: &Surveyed) -> Vec<String> {
    let Some(movement) = &surveyed.movement else { return vec!["fewer than three frames: nothing can move".into()] };
    let mut lines = Vec::new();
    if movement.is_everywhere {
        let share = 100.0 * movement.swept_fraction;
        lines.push(format!("{share:.0} % of the image moves: the camera was not held still, or the light changed"));
    } else if surveyed.bodies.is_empty() {
        lines.push("nothing moves in this film".into());
    }
    lines.extend(surveyed.bodies.iter().map(|body| {
        let [x, y, width, height] = body.mover.bounds_px;
        let frames = body.path.as_ref().map_or(0, |path| path.track.len());
        let what = match &body.kind {
            Identified::Ball { radius_px, .. } => {
                format!("a ball of radius {radius_px:.1} px, followed in {frames} frames")
            }
            Identified::Rod { half_width_px, .. } => format!("a rod {:.1} px wide", 2.0 * half_width_px),
            Identified::Patch { .. } | Identified::Unknown => "something without a circular outline".into(),
            Identified::TooSmall { radius_px } => {
                format!("something of about {radius_px:.0} px radius; an outline needs at least {MIN_RADIUS_PX} px")
            }
        };
        format!("in [{x}, {y}, {width}, {height}]: {what}")
    }));
    lines
}
