//! The kind of a mover: a ball, a rod, or a patch.

use super::movement::{Appearance, Movement, Mover};
use crate::ball::{BallFinder, BallParams};
use crate::image::ImageView;
use crate::numeric::median;
use crate::results::{Circle, ROD_EDGES};
use crate::rod::{RodFinder, RodParams};

/// The number of frames in which a kind of body is searched.
const EXAMINED_FRAMES: usize = 16;
/// The radius of the smallest ball whose outline can be measured, px.
pub(super) const MIN_RADIUS_PX: f64 = 6.0;
/// The share of the examined frames that have to show the body. A ball that is as bright as its background is found in
/// few of them, and then followed in most.
const MIN_SHARE: f64 = 0.25;
/// The minimum number of these frames.
const MIN_FRAMES: usize = 3;
/// The maximum difference of a radius from that of the ball, as a fraction.
pub(super) const RADIUS_TOLERANCE: f64 = 0.12;
/// The margin of the searched region to what differs from the background, as a fraction of its larger side.
const MARGIN_FRACTION: f64 = 0.4;
/// The margin of the searched region, px.
const MARGIN_PX: f64 = 10.0;
/// The minimum motion of a ball from frame to frame of the examined ones, or over all of them, px.
const MIN_MOTION_PX: f64 = 1.5;

/// The kind of a mover, with its place in the examined frames.
#[derive(Debug, Clone, PartialEq)]
pub enum Identified {
    /// A ball: the median radius, and the circles that agree with it, each with the number of its frame.
    Ball {
        /// The median radius, px.
        radius_px: f64,
        /// The circles.
        circles: Vec<(u64, Circle)>,
    },
    /// A rod: the median of half its width.
    Rod {
        /// Half of the width, px.
        half_width_px: f64,
        /// The number of tape edges.
        edges: u32,
    },
    /// Something without a circular outline, with the corners of its hull in the first frame.
    Patch {
        /// The corners, px.
        polygon_px: Vec<[f64; 2]>,
    },
    /// Something without a circular outline that is not visible in the first frame.
    Unknown,
    /// Something too small for an outline: the radius of a disc of its area.
    TooSmall {
        /// The radius, px.
        radius_px: f64,
    },
}

/// A full frame of the film.
#[derive(Debug, Clone, Copy)]
pub struct ExaminedFrame<'a> {
    /// The number of the frame in the film, from 0.
    pub index: u64,
    /// The grey levels, DN.
    pub image: ImageView<'a>,
}

/// Returns the numbers of the frames in which the movers are examined, rising: those that show most of each, spread
/// over the film.
pub fn needed_frames(movement: &Movement) -> Vec<u64> {
    let mut needed: Vec<u64> =
        movement.movers.iter().flat_map(examined_appearances).map(|appearance| appearance.index).collect();
    needed.sort_unstable();
    needed.dedup();
    needed
}

/// Returns at most [`EXAMINED_FRAMES`] of the appearances of a mover that show most of it, in the order of the film.
///
/// These are spread evenly over the ones whose area is not in the lowest quarter.
fn examined_appearances(mover: &Mover) -> Vec<&Appearance> {
    let mut areas: Vec<f64> = mover.appearances.iter().map(|appearance| appearance.area_px2).collect();
    areas.sort_by(f64::total_cmp);
    // A quarter of the appearances may show the mover enter or leave.
    let enough = areas.get(areas.len() / 4).copied().unwrap_or(0.0);
    let clear: Vec<&Appearance> = mover.appearances.iter().filter(|a| a.area_px2 >= enough).collect();
    let interval = clear.len().div_ceil(EXAMINED_FRAMES).max(1);
    clear.into_iter().step_by(interval).collect()
}

/// Collects what is found in the examined frames of one mover.
#[derive(Debug)]
pub struct Examination<'m> {
    mover: &'m Mover,
    size_px: [usize; 2],
    examined: Vec<&'m Appearance>,
    circles: Vec<(u64, Circle)>,
    rods: Vec<f64>,
}

/// Begins an examination of each mover, in frames of this width and height, px. [`needed_frames`] lists the frames to
/// push.
pub fn identify(movement: &Movement, size_px: [usize; 2]) -> Vec<Examination<'_>> {
    let examination = |mover| {
        let examined = examined_appearances(mover);
        Examination { mover, size_px, examined, circles: Vec::new(), rods: Vec::new() }
    };
    movement.movers.iter().map(examination).collect()
}

impl Examination<'_> {
    /// Searches a ball and a rod in a frame, and keeps what it finds. A frame in which this mover is not examined is
    /// ignored.
    pub fn push(&mut self, frame: ExaminedFrame<'_>) {
        let Some(appearance) = self.examined.iter().find(|appearance| appearance.index == frame.index) else { return };
        let roi_px = with_margin(appearance.bounds_px, self.size_px);
        let longer_px = f64::from(appearance.bounds_px[2].max(appearance.bounds_px[3]));
        let radii = BallParams {
            roi_px: Some(roi_px),
            ..BallParams::new((0.12 * longer_px).max(MIN_RADIUS_PX), (0.75 * longer_px).max(MIN_RADIUS_PX + 4.0))
        };
        let [width, height] = self.size_px;
        if let Ok(mut finder) = BallFinder::new(&radii, width, height)
            && let Some(circle) = finder.find(frame.image)
        {
            self.circles.push((frame.index, circle));
        }
        // A rod fills the height of what moves, and its tapes lie anywhere on it.
        let rod = RodParams { roi_px: Some(roi_px), ..RodParams::new(ROD_EDGES as u32) };
        if let Ok(finder) = RodFinder::new(&rod, width, height)
            && let Ok(found) = finder.find(frame.image)
        {
            self.rods.push(found.rod.half_width_px.value);
        }
    }

    /// Returns the kind of the mover: a ball or a rod if it was found in enough frames, else a patch if it is visible
    /// in the first frame.
    ///
    /// A ball needs circles of about one radius whose centres move. Enough is a quarter of the examined frames, and at
    /// least three.
    pub fn finish(self) -> Identified {
        let needed = ((MIN_SHARE * self.examined.len() as f64).ceil() as usize).max(MIN_FRAMES);
        let circles = self.agreeing_circles();
        if circles.len() >= needed && have_moved(&circles) {
            let mut radii: Vec<f64> = circles.iter().map(|(_, circle)| circle.radius_px).collect();
            return Identified::Ball { radius_px: median(&mut radii).unwrap_or(0.0), circles };
        }
        let mut rods = self.rods;
        if let Some(half_width_px) = median(&mut rods).filter(|_| rods.len() >= needed) {
            return Identified::Rod { half_width_px, edges: ROD_EDGES as u32 };
        }
        let largest = self.mover.appearances.iter().max_by(|a, b| a.area_px2.total_cmp(&b.area_px2));
        let radius_px = largest.map_or(0.0, |largest| (largest.area_px2 / std::f64::consts::PI).sqrt());
        if radius_px < MIN_RADIUS_PX {
            return Identified::TooSmall { radius_px };
        }
        match self.mover.appearances.first().filter(|first| first.index == 0 && first.hull_px.len() >= 3) {
            Some(first) => Identified::Patch { polygon_px: first.hull_px.clone() },
            None => Identified::Unknown,
        }
    }

    /// Returns the largest group of circles whose radii differ from that of one of them by less than
    /// [`RADIUS_TOLERANCE`].
    fn agreeing_circles(&self) -> Vec<(u64, Circle)> {
        let near = |radius_px: f64| {
            let agrees =
                move |(_, circle): &&(u64, Circle)| (circle.radius_px / radius_px - 1.0).abs() < RADIUS_TOLERANCE;
            self.circles.iter().filter(agrees).copied().collect::<Vec<_>>()
        };
        let groups = self.circles.iter().map(|(_, circle)| near(circle.radius_px));
        groups.max_by_key(Vec::len).unwrap_or_default()
    }
}

/// Whether the centres of the circles extend over more than [`MIN_MOTION_PX`], unlike those of a circle of the
/// background.
fn have_moved(circles: &[(u64, Circle)]) -> bool {
    let span = |coordinate: fn(&Circle) -> f64| {
        let values = || circles.iter().map(|(_, circle)| coordinate(circle));
        values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)
    };
    span(|circle| circle.x_px).hypot(span(|circle| circle.y_px)) > MIN_MOTION_PX
}

/// Returns a region (x, y, width, height, px) with a margin on each side, clipped to an image of `size_px`.
///
/// The margin is [`MARGIN_FRACTION`] of the larger side, at least [`MARGIN_PX`].
pub(super) fn with_margin(region_px: [u32; 4], size_px: [usize; 2]) -> [u32; 4] {
    let [x, y, width, height] = region_px;
    let margin_px = (MARGIN_FRACTION * f64::from(width.max(height))).max(MARGIN_PX) as u32;
    let (left, top) = (x.saturating_sub(margin_px), y.saturating_sub(margin_px));
    let right = (x + width + margin_px).min(size_px[0] as u32);
    let bottom = (y + height + margin_px).min(size_px[1] as u32);
    [left, top, right - left, bottom - top]
}
