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
    ///
    /// Left, top, right and bottom relative to the point (`x_px`, `y_px`) of the rod, px, before the tilt.
    pub fn tape_px(&self) -> [f64; 4] {
        let half = (self.rod.half_width_px.value - INSET_PX + 1.0).max(0.0);
        [-half, self.span_px[0] - MARGIN_PX, half, self.span_px[1] + MARGIN_PX]
    }
}
