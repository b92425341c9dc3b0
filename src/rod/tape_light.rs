//! The light on a tape: its grey level without speckles at each pixel.

use crate::image::ImageView;
use nalgebra::{SMatrix, SVector};

/// The distances of levels from the light that are kept in each round, as fractions of the light.
///
/// Speckles are darker. Light that varies along the tape is reached from its brightest part.
const KEPT_FRACTIONS: [f64; 8] = [0.45, 0.35, 0.25, 0.2, 0.15, 0.12, 0.1, 0.1];
/// The minimum number of levels per unknown.
const MIN_LEVELS: usize = 6;
/// The reach of the light beyond the tape, as a fraction of its half height.
const REACH: f64 = 1.15;

type Vector = SVector<f64, 9>;

/// The light on a tape: three parts across (constant, along the tilt of the surface, towards the camera), each a
/// parabola along the rod.
#[derive(Debug, Clone, Copy)]
pub(super) struct TapeLight {
    shape: TapeShape,
    coefficients: Vector,
}

/// The place of a tape.
#[derive(Debug, Clone, Copy)]
pub(super) struct TapeShape {
    /// The middle column of the rod at the middle row, px.
    pub(super) middle_px: [f64; 2],
    pub(super) half_width_px: f64,
    pub(super) half_height_px: f64,
    /// Columns per row.
    pub(super) tilt: f64,
}

impl TapeShape {
    /// Returns the terms of the light at a pixel.
    fn terms(&self, x: f64, y: f64) -> Vector {
        let down = y - self.middle_px[1];
        let s = ((x - self.middle_px[0] - self.tilt * down) / self.half_width_px).clamp(-1.0, 1.0);
        let across = [1.0, s, (1.0 - s * s).sqrt()];
        let t = (down / self.half_height_px).clamp(-REACH, REACH);
        let along = [1.0, t, t * t];
        Vector::from_fn(|k, _| across[k % 3] * along[k / 3])
    }
}

impl TapeLight {
    /// Fits the light to the levels within `columns` and `rows`, first and one past the last, from that across the tape.
    ///
    /// `None` if too few levels agree.
    pub(super) fn fit(
        image: ImageView<'_>,
        shape: TapeShape,
        columns: [usize; 2],
        rows: [usize; 2],
        across_dn: [f64; 3],
    ) -> Option<Self> {
        let mut light = Self { shape, coefficients: Vector::zeros() };
        light.coefficients.fixed_rows_mut::<3>(0).copy_from_slice(&across_dn);
        for fraction in KEPT_FRACTIONS {
            let (mut normal, mut right, mut kept) = (SMatrix::<f64, 9, 9>::zeros(), Vector::zeros(), 0);
            for y in rows[0]..rows[1] {
                let row = image.row(y);
                for (x, level) in row.iter().enumerate().take(columns[1]).skip(columns[0]) {
                    let (level, terms) = (f64::from(*level), shape.terms(x as f64, y as f64));
                    let expected = terms.dot(&light.coefficients);
                    if (level - expected).abs() <= fraction * expected.max(0.0) {
                        normal += terms * terms.transpose();
                        right += terms * level;
                        kept += 1;
                    }
                }
            }
            if kept < MIN_LEVELS * right.len() {
                return None;
            }
            light.coefficients = normal.cholesky()?.solve(&right);
        }
        Some(light)
    }

    /// Returns the light at a pixel, DN.
    pub(super) fn level_at(&self, x: f64, y: f64) -> f64 {
        self.shape.terms(x, y).dot(&self.coefficients)
    }
}
