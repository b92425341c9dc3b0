//! The light on a tape next to an edge: its grey level without speckles at each pixel.

use crate::image::ImageView;
use crate::numeric::quantile;
use nalgebra::{SMatrix, SVector};

/// The quantile of the levels of a column at the paint; speckles are darker.
const PAINT_QUANTILE: f64 = 0.7;
/// The distances of levels from the light that are kept in each round, as fractions of the light.
const KEPT_FRACTIONS: [f64; 8] = [0.45, 0.35, 0.25, 0.2, 0.15, 0.12, 0.1, 0.1];
/// The minimum number of levels per unknown.
const MIN_LEVELS: usize = 6;

type Vector = SVector<f64, 6>;

/// The light on a tape: three parts across (constant, along the tilt of the surface, towards the camera), each linear
/// along the rod.
///
/// Over the few rows next to an edge a line follows the light of a near lamp within 1 %.
#[derive(Debug, Clone, Copy)]
pub(super) struct TapeLight {
    place: TapePlace,
    coefficients: Vector,
}

/// The place of a tape next to an edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct TapePlace {
    /// The middle of the rod in the examined rows, px.
    pub(super) middle_px: [f64; 2],
    pub(super) half_width_px: f64,
    /// Columns per row.
    pub(super) tilt: f64,
    /// The examined columns and rows, first and one past the last.
    pub(super) columns: [usize; 2],
    pub(super) rows: [usize; 2],
}

impl TapePlace {
    /// Returns the terms of the light at a pixel.
    fn terms(&self, x: f64, y: f64) -> Vector {
        let down = y - self.middle_px[1];
        let s = ((x - self.middle_px[0] - self.tilt * down) / self.half_width_px).clamp(-1.0, 1.0);
        let c = (1.0 - s * s).sqrt();
        // In units of the examined rows, so that all terms are of one size.
        let t = down / (self.rows[1] - self.rows[0]).max(1) as f64;
        Vector::from([1.0, s, c, t, t * s, t * c])
    }
}

impl TapeLight {
    /// Fits the light to the levels that agree, speckles left out.
    ///
    /// `None` if too few levels agree.
    pub(super) fn fit(image: ImageView<'_>, place: TapePlace) -> Option<Self> {
        let mut light = Self { place, coefficients: Self::across(image, &place)? };
        for fraction in KEPT_FRACTIONS {
            let (mut normal, mut right, mut kept) = (SMatrix::<f64, 6, 6>::zeros(), Vector::zeros(), 0);
            for y in place.rows[0]..place.rows[1] {
                let row = image.row(y);
                for (x, level) in row.iter().enumerate().take(place.columns[1]).skip(place.columns[0]) {
                    let (level, terms) = (f64::from(*level), place.terms(x as f64, y as f64));
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
        self.place.terms(x, y).dot(&self.coefficients)
    }

    /// Fits the light across the tape to the paint of each column.
    fn across(image: ImageView<'_>, place: &TapePlace) -> Option<Vector> {
        let (mut normal, mut right) = (SMatrix::<f64, 3, 3>::zeros(), SVector::<f64, 3>::zeros());
        for x in place.columns[0]..place.columns[1] {
            let mut column: Vec<f32> = (place.rows[0]..place.rows[1]).filter_map(|y| image.at(x, y)).collect();
            let paint = f64::from(quantile(&mut column, PAINT_QUANTILE)?);
            let terms = place.terms(x as f64, place.middle_px[1]).fixed_rows::<3>(0).into_owned();
            normal += terms * terms.transpose();
            right += terms * paint;
        }
        let across = normal.cholesky()?.solve(&right);
        Some(Vector::from([across[0], across[1], across[2], 0.0, 0.0, 0.0]))
    }
}
