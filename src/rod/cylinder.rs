//! The sides of a round rod under light that changes across it.
//!
//! Light on a cylinder depends on the direction of its surface. Its first order is a constant, a part along the tilt of
//! the surface and a part towards the camera (R. Ramamoorthi, P. Hanrahan, J. Opt. Soc. Am. A 18 (2001) 2448,
//! <https://doi.org/10.1364/JOSAA.18.002448>). A dark side that fades into the ground has no step, but these parts end
//! there.

use crate::image::ImageView;
use crate::numeric::{normal_cdf, quantile};
use crate::results::Estimate;
use nalgebra::{SMatrix, SVector};

/// The quantile of the levels of a column at the paint of a tape; speckles are darker.
const PAINT_QUANTILE: f64 = 0.7;
/// The width of the ground next to the rod that is fitted, and its minimum, px.
const GROUND_PX: f64 = 8.0;
const MIN_GROUND_PX: f64 = 3.0;
/// The blurs that are tried, standard deviations, px.
const BLURS_PX: [f64; 3] = [0.5, 0.8, 1.2];
/// The range inwards in which a side is searched, px, and that outwards, as a fraction of the width and at least in px.
///
/// A threshold places a side that fades into the ground too far inside.
const INWARD_PX: f64 = 2.0;
const OUTWARD_FRACTION: f64 = 0.35;
const OUTWARD_PX: f64 = 2.0;
/// The step of the search and that at which it has converged, px.
const SEARCH_STEP_PX: f64 = 1.0;
const CONVERGED_PX: f64 = 0.004;
/// The number of neighbouring columns whose residuals are alike: what the model lacks is smooth.
const ALIKE_COLUMNS: f64 = 3.0;
/// The change of a side for the curvature of the sum of squares, px.
const CURVATURE_STEP_PX: f64 = 0.1;
/// The number of parameters of a profile: two grounds, three parts of the light, two sides.
const PARAMETERS: f64 = 7.0;
/// The number of columns next to a side that are not examined for shading, px, and the number that are averaged.
const RIM_PX: f64 = 3.0;
const AVERAGED: usize = 3;

type Vector = SVector<f64, 5>;

/// The paint of a tape, in grey levels per column.
pub(super) struct TapeProfile {
    /// The column of the first level, px.
    first: f64,
    /// The middle row of the tape, px.
    pub(super) row: f64,
    levels: Vec<f64>,
}

/// The sides of a rod at a tape.
#[derive(Debug, Clone, Copy)]
pub(super) struct TapeSides {
    /// The middle row of the tape, px.
    pub(super) row: f64,
    /// The left and the right side, px.
    pub(super) sides_px: [Estimate; 2],
    /// The standard uncertainty of the middle between them, px.
    pub(super) middle_sigma_px: f64,
}

impl TapeProfile {
    /// Reads the paint between two `rows` around a rod between two `sides` at the middle row, all px.
    ///
    /// `tilt` is in columns per row, `room` the first and the last column that may be read. `None` if there is no room
    /// for the ground.
    pub(super) fn read(
        image: ImageView<'_>,
        rows: [usize; 2],
        sides: [f64; 2],
        tilt: f64,
        room: [usize; 2],
    ) -> Option<Self> {
        let row = 0.5 * (rows[0] + rows[1]) as f64 - 0.5;
        let reach = GROUND_PX + OUTWARD_PX.max(OUTWARD_FRACTION * (sides[1] - sides[0]));
        let lean = (0.5 * tilt * (rows[1] - rows[0]) as f64).abs().ceil();
        let first = (sides[0] - reach).floor().max(room[0] as f64 + lean);
        let last = (sides[1] + reach).ceil().min(room[1] as f64 - lean);
        if sides[0] - first < MIN_GROUND_PX || last - sides[1] < MIN_GROUND_PX {
            return None;
        }
        let mut column = Vec::with_capacity(rows[1] - rows[0]);
        let mut paint = |x: f64| {
            column.clear();
            let at = |y: usize| image.at((x + tilt * (y as f64 - row)).round() as usize, y);
            column.extend((rows[0]..rows[1]).filter_map(at));
            quantile(&mut column, PAINT_QUANTILE).map(f64::from)
        };
        let levels = (0..=(last - first) as usize).map(|k| paint(first + k as f64)).collect::<Option<_>>()?;
        Some(Self { first, row, levels })
    }

    /// Returns the ratio of the darkest to the brightest light between two `sides`, px; 1 for even light.
    pub(super) fn evenness(&self, sides: [f64; 2]) -> f64 {
        let index = |x: f64| (x - self.first).max(0.0) as usize;
        let [from, to] = [index((sides[0] + RIM_PX).ceil()), index((sides[1] - RIM_PX).floor()) + 1];
        let inside = self.levels.get(from..to.min(self.levels.len())).unwrap_or_default();
        let mean = |levels: &[f64]| levels.iter().sum::<f64>() / AVERAGED as f64;
        let (low, high) = inside
            .windows(AVERAGED)
            .map(mean)
            .fold((f64::INFINITY, 0.0_f64), |(low, high), level| (low.min(level), high.max(level)));
        if low.is_finite() { low / high.max(1e-9) } else { 1.0 }
    }

    /// Fits both sides near those given, px, with a distance within `width_px`; `None` if they are not determined.
    pub(super) fn fit_sides(&self, near: [f64; 2], width_px: [f64; 2]) -> Option<TapeSides> {
        let last = self.first + self.levels.len() as f64 - 1.0;
        let outward = OUTWARD_PX.max(OUTWARD_FRACTION * (near[1] - near[0]));
        let left = [(near[0] - outward).max(self.first + MIN_GROUND_PX), near[0] + INWARD_PX];
        let right = [near[1] - INWARD_PX, (near[1] + outward).min(last - MIN_GROUND_PX)];
        let places = |range: [f64; 2]| {
            let count = ((range[1] - range[0]) / SEARCH_STEP_PX).floor().max(0.0) as usize;
            (0..=count).map(move |k| range[0] + k as f64 * SEARCH_STEP_PX)
        };
        let allowed = |[a, b]: [f64; 2]| (width_px[0]..=width_px[1]).contains(&(b - a));
        let pairs = places(left).flat_map(|a| places(right).map(move |b| [a, b])).filter(|pair| allowed(*pair));
        let coarse = pairs.filter_map(|pair| Some((self.squares(pair, BLURS_PX[1])?, pair)));
        let (_, start) = coarse.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let refined = BLURS_PX.iter().filter_map(|blur| Some((self.refine(start, *blur)?, *blur)));
        let ((squares, sides), blur) = refined.min_by(|a, b| a.0.0.total_cmp(&b.0.0))?;
        self.with_uncertainty(sides, blur, squares)
    }

    /// Refines both sides by a pattern search; returns the sum of squares, DN^2, and the sides, px.
    fn refine(&self, start: [f64; 2], blur: f64) -> Option<(f64, [f64; 2])> {
        const MOVES: [[f64; 2]; 8] =
            [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]];
        let (mut best, mut sides) = (self.squares(start, blur)?, start);
        let mut step = 0.5 * SEARCH_STEP_PX;
        while step > CONVERGED_PX {
            let tried = MOVES.map(|by| [sides[0] + step * by[0], sides[1] + step * by[1]]);
            let better = tried.into_iter().filter_map(|sides| Some((self.squares(sides, blur)?, sides)));
            match better.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|(squares, _)| *squares < best) {
                Some(found) => (best, sides) = found,
                None => step *= 0.5,
            }
        }
        Some((best, sides))
    }

    /// Returns the sum of squared residuals with the best ground and light, DN^2; `None` if these are not determined.
    fn squares(&self, sides: [f64; 2], blur: f64) -> Option<f64> {
        let (mut normal, mut right, mut total) = (SMatrix::<f64, 5, 5>::zeros(), Vector::zeros(), 0.0);
        for (level, x) in self.levels.iter().zip(0_u32..) {
            let row = basis(self.first + f64::from(x), sides, blur);
            normal += row * row.transpose();
            right += row * *level;
            total += level * level;
        }
        let solved = normal.cholesky()?.solve(&right);
        Some(total - solved.dot(&right))
    }

    /// Returns the sides with the uncertainties from the curvature of the sum of squares.
    fn with_uncertainty(&self, sides: [f64; 2], blur: f64, squares: f64) -> Option<TapeSides> {
        let h = CURVATURE_STEP_PX;
        let at = |a: f64, b: f64| self.squares([sides[0] + a * h, sides[1] + b * h], blur);
        let along = |a: f64, b: f64| Some((at(a, b)? + at(-a, -b)? - 2.0 * squares) / (h * h));
        let (left, right, both) = (along(1.0, 0.0)?, along(0.0, 1.0)?, along(1.0, 1.0)?);
        // Half of the second derivatives of the sum of squares is the normal matrix.
        let normal = [0.5 * left, 0.25 * (both - left - right), 0.5 * right];
        let determinant = normal[0] * normal[2] - normal[1] * normal[1];
        if !(normal[0] > 0.0 && normal[2] > 0.0 && determinant > 0.0) {
            return None;
        }
        let variance = ALIKE_COLUMNS * squares / (self.levels.len() as f64 - PARAMETERS).max(1.0);
        let covariance = [normal[2], -normal[1], normal[0]].map(|part| variance * part / determinant);
        let side = |value: f64, variance: f64| Estimate { value, sigma: variance.sqrt() };
        Some(TapeSides {
            row: self.row,
            sides_px: [side(sides[0], covariance[0]), side(sides[1], covariance[2])],
            middle_sigma_px: (0.25 * (covariance[0] + covariance[2] + 2.0 * covariance[1])).max(0.0).sqrt(),
        })
    }
}

/// Returns the blurred parts of a column `x` between or next to two `sides`, px: the ground on the left and on the
/// right, and the light that is constant, along the tilt of the surface and towards the camera.
fn basis(x: f64, sides: [f64; 2], blur: f64) -> Vector {
    const NODES: [f64; 7] = [-2.4, -1.6, -0.8, 0.0, 0.8, 1.6, 2.4];
    let (left, right) = (1.0 - normal_cdf((x - sides[0]) / blur), normal_cdf((x - sides[1]) / blur));
    let (middle, half) = (0.5 * (sides[0] + sides[1]), 0.5 * (sides[1] - sides[0]));
    let inside = 1.0 - left - right;
    let (mut facing, mut weight) = (0.0, 0.0);
    for node in NODES {
        let w = (-0.5 * node * node).exp();
        let s = (x + blur * node - middle) / half;
        facing += w * (1.0 - s * s).max(0.0).sqrt();
        weight += w;
    }
    let s = ((x - middle) / half).clamp(-1.0, 1.0);
    Vector::from([left, right, inside, inside * s, facing / weight])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Light on a cylinder between columns 20.3 and 50.1, with the lamp on the left, of which `rest` comes from all sides.
    fn lit(rest: f64) -> TapeProfile {
        let sides = [20.3, 50.1];
        let level = |x: f64| basis(x, sides, 0.7).dot(&Vector::from([10.0, 12.0, 10.0 + 150.0 * rest, -70.0, 70.0]));
        TapeProfile { first: 5.0, row: 0.0, levels: (5..65).map(|x| level(f64::from(x))).collect() }
    }

    #[test]
    fn a_side_that_fades_into_the_ground_is_found() {
        let profile = lit(0.5);
        assert!(profile.evenness([20.3, 50.1]) < 0.7);
        // A threshold places the dark side 4 px too far inside.
        let found = profile.fit_sides([20.0, 46.0], [24.0, 38.0]).unwrap();
        let [left, right] = found.sides_px;
        assert!((left.value - 20.3).abs() < 0.05 && (right.value - 50.1).abs() < 0.1, "{found:?}");
    }
}
