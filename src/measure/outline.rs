//! The kinds of bodies: the finder of each and the outline that it detects.

use super::MeasureError;
use super::bounding_box::BoundingBox;
use super::params::{BodyParams, ImageSize};
use super::patch_finder::{PatchFinder, PatchPose};
use crate::ball::{BallFinder, Presence};
use crate::dic::{CorrelationParams, GridPoint, Method, Region, grid};
use crate::image::ImageView;
use crate::results::{BodyStep, Circle, Estimate, OutlineOrigin, OutlineShape, PointStatus, RigidStep, Rod};
use crate::rod::{RodFinder, RodObservation};

/// The margin of the subsets to the rim, as a fraction of the radius.
///
/// At the rim the outline is blurred and the shading falls off.
pub(super) const RIM_CLEARANCE: f64 = 0.04;

/// The width of the zone inside the rim that is affected by the blur of the edge, px.
const EDGE_MARGIN_PX: f64 = 4.0;

/// The uncertainty of the displacement of a ball that is not seen, as a fraction of it.
///
/// A ball that rebounds at once is off by twice its displacement.
const STRUCK_FRACTION: f64 = 0.5;

/// The minimum number of subsets on the tape of a rod, twice that of a motion, if it has room for them.
const MIN_ROD_POINTS: u32 = 6;

/// The maximum time for which a ball is predicted by its outlines, frames.
const MAX_UNSEEN_FRAMES: u64 = 8;

/// The detected outline of a body in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "one per body and frame, copied about as often; a box saves nothing")]
pub(super) enum Outline {
    Ball(Circle),
    Rod(RodObservation),
    Patch(PatchPose),
}

/// The range of a search near a predicted outline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SearchRange {
    Close,
    Wide,
}

/// The finder of one body.
#[derive(Debug)]
pub(super) enum Finder {
    Ball(Box<BallFinder>),
    Rod(RodFinder),
    Patch(Box<PatchFinder>),
}

impl Finder {
    /// Creates the finder of a body for frames of this size.
    ///
    /// # Errors
    ///
    /// Returns an error if a parameter of the ball or the rod is out of its range.
    pub(super) fn new(body: &BodyParams, width_px: usize, height_px: usize) -> Result<Self, MeasureError> {
        Ok(match body {
            BodyParams::Ball(ball) => Self::Ball(Box::new(BallFinder::new(ball, width_px, height_px)?)),
            BodyParams::Rod(rod) => Self::Rod(RodFinder::new(rod, width_px, height_px)?),
            BodyParams::Patch(patch) => Self::Patch(Box::new(PatchFinder::new(patch))),
        })
    }

    /// Finds a ball or a rod from scratch.
    ///
    /// # Errors
    ///
    /// The reason why it was not found; always [`PointStatus::Lost`] for a patch.
    pub(super) fn find(&mut self, image: ImageView<'_>) -> Result<Outline, PointStatus> {
        match self {
            Self::Ball(finder) => finder.find(image).map(Outline::Ball).ok_or(PointStatus::Lost),
            Self::Rod(finder) => finder.find(image).map(Outline::Rod),
            // Found by its pixels, not by an outline.
            Self::Patch(_) => Err(PointStatus::Lost),
        }
    }

    /// Finds a ball by its difference from the background, DN; other bodies give `None`.
    pub(super) fn find_changed(&mut self, difference: ImageView<'_>) -> Option<Circle> {
        match self {
            Self::Ball(finder) => finder.find_changed(difference),
            Self::Rod(_) | Self::Patch(_) => None,
        }
    }

    /// Discards what was found in the blocks before this one.
    pub(super) fn forget_before(&mut self, block: u64) {
        if let Self::Patch(finder) = self {
            finder.forget_before(block);
        }
    }

    /// Returns the box to unpack for a search near the predicted position.
    ///
    /// `None` stands for the full frame.
    pub(super) fn search_box(&self, near: &Outline, range: SearchRange) -> Option<BoundingBox> {
        match (self, near) {
            (Self::Ball(_), Outline::Ball(near)) => {
                let mut search = BoundingBox::default();
                let range_px = match range {
                    SearchRange::Close => BallFinder::CLOSE_RANGE_PX,
                    SearchRange::Wide => BallFinder::FOLLOW_RANGE_PX,
                };
                search.include(near, range_px);
                Some(search)
            }
            _ => None,
        }
    }

    /// Searches a ball at its predicted position; other bodies give `None`.
    pub(super) fn follow_closely(
        &mut self,
        image: ImageView<'_>,
        near: &Outline,
        presence: Presence,
    ) -> Option<Outline> {
        match (self, near) {
            (Self::Ball(finder), Outline::Ball(near)) => {
                finder.follow_closely(image, near, presence).map(Outline::Ball)
            }
            _ => None,
        }
    }

    /// Searches a ball or a rod near its predicted position, or from scratch if `near` is that of another kind.
    ///
    /// # Errors
    ///
    /// The reason why it was not found; always [`PointStatus::Lost`] for a patch.
    pub(super) fn follow(&mut self, image: ImageView<'_>, near: &Outline) -> Result<Outline, PointStatus> {
        match (self, near) {
            (Self::Ball(finder), Outline::Ball(near)) => {
                finder.search_near(image, near).map(Outline::Ball).ok_or(PointStatus::Lost)
            }
            (Self::Rod(finder), Outline::Rod(near)) => finder.follow(image, near).map(Outline::Rod),
            (finder, _) => finder.find(image),
        }
    }

    /// Returns the centres of the subsets on the body.
    pub(super) fn grid_points(&self, outline: &Outline, params: &CorrelationParams, size: ImageSize) -> Vec<GridPoint> {
        match (self, outline) {
            (Self::Patch(finder), Outline::Patch(pose)) => patch_points(&finder.region_at(pose), params, size),
            _ => outline.grid_points(params, size),
        }
    }

    /// Returns the pixels that may be correlated; `None` if subsets are not restricted.
    pub(super) fn correlated_region(&self, outline: &Outline, params: &CorrelationParams) -> Option<Region> {
        match (self, outline) {
            (Self::Patch(finder), Outline::Patch(pose)) if params.method == Method::IcGn => {
                Some(finder.region_at(pose))
            }
            _ => outline.correlated_region(params),
        }
    }
}

impl Outline {
    /// Returns the point whose motion is reported, px.
    pub(super) fn center_px(&self) -> (f64, f64) {
        match self {
            Self::Ball(circle) => (circle.x_px, circle.y_px),
            Self::Rod(observation) => (observation.rod.x_px.value, observation.rod.y_px.value),
            Self::Patch(pose) => pose.center_px(),
        }
    }

    /// Returns the rotation of a patch since its reference image, deg.
    pub(super) fn angle_deg(&self) -> Option<Estimate> {
        match self {
            Self::Patch(pose) => Some(pose.angle_deg()),
            Self::Ball(_) | Self::Rod(_) => None,
        }
    }

    /// Returns the outline predicted `frames` frames later by a motion per frame, and whether there was a motion.
    pub(super) fn predicted(&self, step: Option<&RigidStep>, frames: f64) -> (Self, bool) {
        let Some(step) = step else { return (*self, false) };
        let sigma_px = frames * step.sigma_dx_px.max(step.sigma_dy_px);
        let (dx_px, dy_px) = (frames * step.dx_px, frames * step.dy_px);
        let moved = match self {
            Self::Ball(circle) => Self::Ball(Circle {
                x_px: circle.x_px + dx_px,
                y_px: circle.y_px + dy_px,
                sigma_center_px: circle.sigma_center_px.hypot(sigma_px),
                ..*circle
            }),
            Self::Rod(observation) => Self::Rod(observation.moved(dx_px, dy_px, sigma_px)),
            Self::Patch(pose) => Self::Patch(pose.predicted(step, frames)),
        };
        (moved, true)
    }

    /// Widens a predicted ball, which may have struck something in the `unseen_frames` since it was detected.
    ///
    /// `step` is its motion per frame. `None` after more than eight frames, and for other bodies.
    pub(super) fn coasted(&self, step: &RigidStep, unseen_frames: u64) -> Option<Self> {
        let Self::Ball(circle) = self else { return None };
        let sigma_px = STRUCK_FRACTION * unseen_frames as f64 * step.dx_px.hypot(step.dy_px);
        let outline = Self::Ball(Circle { sigma_center_px: circle.sigma_center_px.hypot(sigma_px), ..*circle });
        (unseen_frames <= MAX_UNSEEN_FRAMES).then_some(outline)
    }

    /// Returns the outline without the values that only a detection gives.
    pub(super) fn without_detection(self) -> Self {
        match self {
            Self::Ball(_) | Self::Patch(_) => self,
            Self::Rod(observation) => Self::Rod(observation.without_edges()),
        }
    }

    /// Returns a circle around all matched pixels, for subsets of this size.
    pub(super) fn enclosing_circle(&self, subset_px: u32) -> Circle {
        match self {
            Self::Ball(circle) => *circle,
            Self::Patch(pose) => pose.enclosing_circle(),
            Self::Rod(observation) => {
                let tape = observation.tape_bounds();
                let half = 0.5 * f64::from(subset_px);
                // A subset wider than the tape reaches over it.
                let reach = |from: f64, to: f64| from.abs().max(to.abs()).max(0.5 * (from + to).abs() + half);
                let radius_px = reach(tape.left_px, tape.right_px).hypot(reach(tape.top_px, tape.bottom_px));
                Circle { radius_px, ..rod_circle(&observation.rod) }
            }
        }
    }

    /// Returns rectangles (x, y, width, height, px) of pixels that certainly show the body.
    ///
    /// A patch has none, since it is never matched over a short interval.
    pub(super) fn interior_rectangles(&self) -> Vec<[u32; 4]> {
        match self {
            Self::Ball(circle) => {
                let radius_px = circle.radius_px * (1.0 - RIM_CLEARANCE) - EDGE_MARGIN_PX;
                let rows = (circle.y_px - radius_px).ceil().max(0.0) as u32..=(circle.y_px + radius_px).max(0.0) as u32;
                let row = |y: u32| {
                    let half = (radius_px.powi(2) - (f64::from(y) - circle.y_px).powi(2)).max(0.0).sqrt();
                    let left = (circle.x_px - half).ceil().max(0.0) as u32;
                    [left, y, ((circle.x_px + half).max(0.0) as u32).saturating_sub(left), 1]
                };
                rows.map(row).collect()
            }
            Self::Rod(observation) => {
                let tape = observation.tape_bounds().upright(&observation.rod);
                let [left, top, right, bottom] =
                    [tape.left_px, tape.top_px, tape.right_px, tape.bottom_px].map(|at| at.max(0.0) as u32);
                vec![[left, top, right.saturating_sub(left), bottom.saturating_sub(top)]]
            }
            Self::Patch(_) => Vec::new(),
        }
    }

    /// Returns the centres of the subsets on a ball or a rod; none for a patch, whose polygon its finder has.
    fn grid_points(&self, params: &CorrelationParams, size: ImageSize) -> Vec<GridPoint> {
        match self {
            Self::Ball(circle) => {
                let radius_px = circle.radius_px * (1.0 - RIM_CLEARANCE);
                let (step_px, subset_px) = (params.step_px, params.subset_size_px);
                grid::disc(circle.x_px, circle.y_px, radius_px, step_px, subset_px, size.width, size.height)
            }
            Self::Rod(observation) => rod_points(observation, params, size),
            Self::Patch(_) => Vec::new(),
        }
    }

    /// Returns the pixels that may be correlated; `None` if subsets are not restricted.
    fn correlated_region(&self, params: &CorrelationParams) -> Option<Region> {
        match self {
            // The correlation-peak methods support whole subsets only.
            Self::Rod(observation) if params.method == Method::IcGn => {
                let outline_px = observation.tape_bounds().corners_px(&observation.rod).to_vec();
                Some(Region::Polygon { outline_px, holes_px: Vec::new() })
            }
            Self::Ball(_) | Self::Rod(_) | Self::Patch(_) => None,
        }
    }

    /// Returns the outline as it is written into the row of its frame.
    pub(super) fn to_result(self, origin: OutlineOrigin) -> crate::results::Outline {
        let shape = match self {
            Self::Ball(circle) => OutlineShape::Circle(circle),
            Self::Rod(observation) => OutlineShape::Rod(observation.rod),
            Self::Patch(pose) => OutlineShape::Circle(pose.circle()),
        };
        crate::results::Outline::new(shape, origin)
    }
}

/// Returns the subset centres on the tape: whole subsets if it has room for them, otherwise along its middle.
///
/// If there are too few at the step of the grid, the rows are closer.
fn rod_points(observation: &RodObservation, params: &CorrelationParams, size: ImageSize) -> Vec<GridPoint> {
    let half = f64::from(params.subset_size_px / 2);
    let tape = observation.tape_bounds().upright(&observation.rod);
    let along = |from: f64, to: f64, min_count: u32, limit: usize| -> Vec<u32> {
        let (first, last) = ((from + half).ceil(), (to - half).floor());
        let (first, last) =
            if first <= last { (first, last) } else { ((0.5 * (from + to)).round(), (0.5 * (from + to)).round()) };
        let closest = ((last - first) / (f64::from(min_count) - 1.0)).floor().max(1.0);
        let step = f64::from(params.step_px).min(closest);
        let steps = ((last - first) / step).floor().max(0.0);
        // The grid is centred on the tape.
        let start = (first + 0.5 * (last - first - steps * step)).round();
        let places = (0..=steps as u32).map(|index| start + f64::from(index) * step);
        let fits = |place: &f64| place - half >= 0.0 && place + half <= limit as f64 - 1.0;
        places.filter(fits).map(|place| place as u32).collect()
    };
    let columns = along(tape.left_px, tape.right_px, 1, size.width);
    let rows = along(tape.top_px, tape.bottom_px, MIN_ROD_POINTS.div_ceil(columns.len().max(1) as u32), size.height);
    rows.into_iter().flat_map(|y| columns.iter().map(move |x| GridPoint { x: *x, y })).collect()
}

/// Returns the subset centres within a polygon, on a grid about its middle.
fn patch_points(region: &Region, params: &CorrelationParams, size: ImageSize) -> Vec<GridPoint> {
    let Some([left, top, right, bottom]) = region.bounds_px() else { return Vec::new() };
    let (half, step) = (f64::from(params.subset_size_px / 2), f64::from(params.step_px));
    let places = |low: f64, high: f64, limit: usize| -> Vec<u32> {
        let middle = (0.5 * (low + high)).round();
        let reach = ((high - low) / (2.0 * step)).floor().clamp(0.0, 4096.0) as i32;
        let fits = |place: &f64| place - half >= 0.0 && place + half <= limit as f64 - 1.0;
        (-reach..=reach).map(|k| middle + f64::from(k) * step).filter(fits).map(|place| place as u32).collect()
    };
    let (columns, rows) = (places(left, right, size.width), places(top, bottom, size.height));
    let points = rows.into_iter().flat_map(|y| columns.iter().map(move |x| GridPoint { x: *x, y }));
    points.filter(|point| region.contains(f64::from(point.x), f64::from(point.y))).collect()
}

/// Returns the circle that touches both sides of a rod.
fn rod_circle(rod: &Rod) -> Circle {
    Circle {
        x_px: rod.x_px.value,
        y_px: rod.y_px.value,
        radius_px: rod.half_width_px.value,
        sigma_center_px: rod.x_px.sigma.hypot(rod.y_px.sigma) * std::f64::consts::FRAC_1_SQRT_2,
        sigma_radius_px: rod.half_width_px.sigma,
        visible_fraction: 1.0,
    }
}

/// Returns the circle of a ball or a patch, or the one that touches the sides of a rod, measured or predicted; `None`
/// without an outline.
pub(crate) fn body_circle(step: &BodyStep) -> Option<Circle> {
    step.circle().or_else(|| step.rod().as_ref().map(rod_circle))
}
