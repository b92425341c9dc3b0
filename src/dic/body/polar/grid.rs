//! The radii and angles at which a ring is sampled.

use std::f64::consts::TAU;

use crate::numeric::fast_size;

/// The minimum number of radii of a ring.
pub(super) const MIN_ROWS: usize = 4;
/// The minimum number of samples of a row, by four.
const MIN_SAMPLES: usize = 8;
/// The maximum number of rows that a pattern is examined on.
const EXAMINED_ROWS: usize = 16;

/// The radii and angles of a ring.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    pub inner_px: f64,
    pub rows: usize,
    /// The distance of the rows, px.
    spacing_px: f64,
    /// The samples per row; even.
    pub columns: usize,
}

impl Grid {
    /// Plans rows 1 px apart between two radii, with samples 0.5 px apart on the outer one; `None` if there is no room.
    pub fn new(inner_px: f64, outer_px: f64) -> Option<Self> {
        let sound = inner_px >= 1.0 && outer_px <= 1e4 && outer_px - inner_px >= MIN_ROWS as f64;
        sound.then(|| {
            let samples = fast_size((0.5 * TAU * outer_px).ceil() as usize);
            Self { inner_px, rows: (outer_px - inner_px) as usize, spacing_px: 1.0, columns: 2 * samples }
        })
    }

    /// Returns a grid with fewer rows between the same radii, and half as many samples per row.
    pub fn coarse(self) -> Self {
        let rows = self.rows.min(EXAMINED_ROWS);
        let columns = 2 * fast_size((self.columns / 4).max(MIN_SAMPLES));
        Self { rows, spacing_px: self.spacing_px * self.rows as f64 / rows as f64, columns, ..self }
    }

    /// Returns the number of harmonics of a row.
    pub fn harmonics(&self) -> usize {
        self.columns / 2 + 1
    }

    /// Returns the radius of a row, px.
    pub fn radius(&self, row: usize) -> f64 {
        self.inner_px + (row as f64 + 0.5) * self.spacing_px
    }

    /// Returns the spacing of the samples of a row, px: the weight of each.
    pub fn weight(&self, row: usize) -> f64 {
        TAU * self.radius(row) / self.columns as f64
    }

    /// Returns the indices of the samples of a row.
    pub fn span(&self, row: usize) -> std::ops::Range<usize> {
        row * self.columns..(row + 1) * self.columns
    }
}
