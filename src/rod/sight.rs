//! A rod as it was seen, to be seen again.

use super::finder::{INSET_PX, MARGIN_PX};
use crate::results::{Estimate, PointStatus, ROD_EDGES, Rod, RodEdge};

/// A rod as seen, with what is needed to see it again.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// What was measured.
    pub rod: Rod,
    /// Upper and lower end of the speckled tape, from `rod.y_px`, px.
    pub(super) span_px: [f64; 2],
    /// Each edge's place from `rod.y_px`, px.
    pub(super) offsets_px: [f64; ROD_EDGES],
    /// Whose mean `rod.y_px` is.
    pub(super) anchors: [bool; ROD_EDGES],
    /// 1 where it gets lighter downwards, -1 where it gets darker, 0 beyond the number of edges.
    pub(super) signs: [f64; ROD_EDGES],
    /// The same of the left and of the right side, to the right.
    pub(super) side_signs: [f64; 2],
}

impl Sight {
    /// The same rod moved by so many px, its uncertainties `sigma_px` wider.
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

    /// The same place with no edge in sight.
    pub fn unseen(mut self) -> Self {
        for edge in self.rod.edges.iter_mut().flatten() {
            *edge = RodEdge { y_px: None, status: PointStatus::Lost };
        }
        self
    }

    /// What is to be correlated: the speckled tape between the sides, with a little of the rod above and below.
    ///
    /// Left, top, right and bottom from the point (`x_px`, `y_px`) of the rod, px, before it is tilted.
    pub fn tape_px(&self) -> [f64; 4] {
        let half = (self.rod.half_width_px.value - INSET_PX + 1.0).max(0.0);
        [-half, self.span_px[0] - MARGIN_PX, half, self.span_px[1] + MARGIN_PX]
    }
}
