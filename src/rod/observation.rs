//! A detected rod, with the data to follow it.

use crate::results::{Estimate, PointStatus, ROD_EDGES, Rod, RodEdge};

/// The margin of columns to the sides, px.
pub(super) const INSET_PX: f64 = 3.0;
/// The margin of the rod around the speckled tape that is correlated with it, px.
pub(super) const MARGIN_PX: f64 = 3.0;

/// A detected rod, with the data to detect it again.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RodObservation {
    /// The measured rod.
    pub rod: Rod,
    /// The upper and the lower end of the speckled tape, relative to `rod.y_px`, px.
    pub(super) span_px: [f64; 2],
    /// The position of each edge relative to `rod.y_px`, px, as certain as the best frame so far.
    pub(super) offsets_px: [Estimate; ROD_EDGES],
    /// Whether each edge contributes to the mean `rod.y_px`.
    pub(super) anchors: [bool; ROD_EDGES],
    /// 1 if it gets lighter downwards, -1 if it gets darker, 0 beyond the number of edges.
    pub(super) signs: [f64; ROD_EDGES],
    /// The same of the left and of the right side, to the right.
    pub(super) side_signs: [f64; 2],
}

/// The edges of a speckled tape relative to the point (`x_px`, `y_px`) of its rod, px, before the tilt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TapeBounds {
    /// The left side.
    pub left_px: f64,
    /// The upper end.
    pub top_px: f64,
    /// The right side.
    pub right_px: f64,
    /// The lower end.
    pub bottom_px: f64,
}

impl TapeBounds {
    /// Returns the tape in the image, px, if its rod is upright.
    pub fn upright(&self, rod: &Rod) -> Self {
        let (x, y) = (rod.x_px.value, rod.y_px.value);
        Self {
            left_px: x + self.left_px,
            top_px: y + self.top_px,
            right_px: x + self.right_px,
            bottom_px: y + self.bottom_px,
        }
    }

    /// Returns the corners in the image, px, clockwise on the screen for an upright rod.
    pub fn corners_px(&self, rod: &Rod) -> [[f64; 2]; 4] {
        let (x, y) = (rod.x_px.value, rod.y_px.value);
        let (sin, cos) = rod.tilt_deg.value.to_radians().sin_cos();
        let Self { left_px: left, top_px: top, right_px: right, bottom_px: bottom } = *self;
        [[left, top], [right, top], [right, bottom], [left, bottom]]
            .map(|[dx, dy]| [x + dx * cos + dy * sin, y - dx * sin + dy * cos])
    }
}

impl RodObservation {
    /// Returns the rod moved by some px, with the uncertainties of its positions increased by `sigma_px`.
    ///
    /// Width and tilt stay.
    pub fn moved(&self, dx_px: f64, dy_px: f64, sigma_px: f64) -> Self {
        let mut moved = *self;
        let by = |estimate: Estimate, shift: f64| Estimate {
            value: estimate.value + shift,
            sigma: estimate.sigma.hypot(sigma_px),
        };
        moved.rod.x_px = by(self.rod.x_px, dx_px);
        moved.rod.y_px = by(self.rod.y_px, dy_px);
        for edge in moved.rod.edges.iter_mut().flatten() {
            edge.y_px = edge.y_px.map(|y| by(y, dy_px));
        }
        moved
    }

    /// Returns the same position without any edge.
    pub fn without_edges(mut self) -> Self {
        for edge in self.rod.edges.iter_mut().flatten() {
            *edge = RodEdge { y_px: None, status: PointStatus::Lost };
        }
        self
    }

    /// Returns the correlated region: the speckled tape between the sides, with a margin of the rod above and below.
    pub fn tape_bounds(&self) -> TapeBounds {
        let half = (self.rod.half_width_px.value - INSET_PX + 1.0).max(0.0);
        let [top, bottom] = self.span_px;
        TapeBounds { left_px: -half, top_px: top - MARGIN_PX, right_px: half, bottom_px: bottom + MARGIN_PX }
    }
}
