//! The sides of a round rod under light that changes across it.
//!
//! Light on a matt cylinder depends on the direction of its surface: a lamp lights it by Lambert's cosine law, and other
//! light comes from all sides. A dark side that fades into the ground has no step, but the light ends there.

use crate::image::ImageView;
use crate::numeric::{normal_cdf, quantile};
use crate::results::Estimate;
use nalgebra::{SMatrix, SVector};

/// The quantile of the levels of a column at the paint of a tape; speckles are darker.
const PAINT_QUANTILE: f64 = 0.7;
/// The width of the ground next to the rod that is fitted, and its minimum, px.
const GROUND_PX: f64 = 8.0;
const MIN_GROUND_PX: f64 = 3.0;
/// The ratio of the limits of the width from which it is not known before.
const MAX_RANGE_RATIO: f64 = 4.0;
/// The blurs that are tried, standard deviations, px.
const BLURS_PX: [f64; 3] = [0.5, 0.8, 1.2];
/// The range inwards in which a side is searched, px.
const INWARD_PX: f64 = 2.0;
/// The step of the search and that at which it has converged, px.
const SEARCH_STEP_PX: f64 = 1.0;
/// The maximum distance of a side of one tape from the search over all, px: for the step and for the tilt.
const MAX_REFINEMENT_PX: f64 = 2.0;
const CONVERGED_PX: f64 = 0.004;
/// The number of neighbouring columns whose residuals are alike: what the model lacks is smooth.
const ALIKE_COLUMNS: f64 = 3.0;
/// The change of a side for the curvature of the sum of squares, px.
const CURVATURE_STEP_PX: f64 = 0.1;
/// The number of parameters of a profile: two grounds, two parts of the light, two sides, the direction of the lamp.
const PARAMETERS: f64 = 7.0;
/// The directions of the lamp that are tried, from the camera towards the right side, rad; and the first step of their
/// refinement.
const LAMPS_RAD: [f64; 9] = [-1.4, -1.05, -0.7, -0.35, 0.0, 0.35, 0.7, 1.05, 1.4];
const LAMP_STEP_RAD: f64 = 0.2;
/// The number of columns next to a side that are not examined for shading, px, and the number that are averaged.
const RIM_PX: f64 = 3.0;
const AVERAGED: usize = 3;

type Vector = SVector<f64, 4>;

/// The parameters of a profile that are not linear.
#[derive(Debug, Clone, Copy)]
struct Shape {
    /// The left and the right side, px.
    sides: [f64; 2],
    /// The direction of the lamp from the camera towards the right side, rad.
    lamp: f64,
    /// The standard deviation of the blur, px.
    blur: f64,
}

/// The paint of a tape, in grey levels per column.
pub(super) struct TapeProfile {
    /// The column of the first level, px.
    first: f64,
    /// The middle row of the tape, px.
    pub(super) row: f64,
    levels: Vec<f64>,
}

/// The columns that may be read for a profile.
#[derive(Debug, Clone, Copy)]
pub(super) struct Room {
    /// The first and the last column.
    pub(super) columns: [usize; 2],
    /// The reach of the search beyond the sides, px.
    pub(super) outward_px: f64,
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
    /// `tilt` is in columns per row, `room` the columns that may be read. `None` if there is no room for the
    /// ground.
    pub(super) fn read(image: ImageView<'_>, rows: [usize; 2], sides: [f64; 2], tilt: f64, room: Room) -> Option<Self> {
        let row = 0.5 * (rows[0] + rows[1]) as f64 - 0.5;
        let reach = GROUND_PX + room.outward_px;
        let lean = (0.5 * tilt * (rows[1] - rows[0]) as f64).abs().ceil();
        let first = (sides[0] - reach).floor().max(room.columns[0] as f64 + lean);
        let last = (sides[1] + reach).ceil().min(room.columns[1] as f64 - lean);
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

    /// Whether there is enough ground next to both sides, px.
    fn has_ground(&self, sides: [f64; 2]) -> bool {
        let last = self.first + self.levels.len() as f64 - 1.0;
        sides[0] - self.first >= MIN_GROUND_PX && last - sides[1] >= MIN_GROUND_PX
    }

    /// Returns the smallest sum of squared residuals of all lamps with these sides, DN^2, and the shape.
    fn best_lamp(&self, sides: [f64; 2]) -> Option<(f64, Shape)> {
        let shapes = LAMPS_RAD.map(|lamp| Shape { sides, lamp, blur: BLURS_PX[1] });
        let squares = shapes.into_iter().filter_map(|shape| Some((self.squares(&shape)?, shape)));
        squares.min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Refines both sides from a shape near them; `None` if they are not determined.
    fn fit_sides(&self, start: Shape, width_px: [f64; 2]) -> Option<TapeSides> {
        let refined = BLURS_PX.iter().filter_map(|blur| self.refine(Shape { blur: *blur, ..start }, width_px));
        let (squares, shape) = refined.min_by(|a, b| a.0.total_cmp(&b.0))?;
        self.with_uncertainty(&shape, squares)
    }

    /// Refines sides and lamp by a pattern search; returns the sum of squares, DN^2, and the shape.
    fn refine(&self, start: Shape, width_px: [f64; 2]) -> Option<(f64, Shape)> {
        const MOVES: [[f64; 3]; 10] = [
            [1.0, 0.0, 0.0],
            [-1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, -1.0, 0.0],
            [0.0, 0.0, 1.0],
            [0.0, 0.0, -1.0],
            [1.0, 1.0, 0.0],
            [-1.0, -1.0, 0.0],
            [1.0, -1.0, 0.0],
            [-1.0, 1.0, 0.0],
        ];
        let (mut best, mut shape) = (self.squares(&start)?, start);
        let mut step = 0.5;
        while step * SEARCH_STEP_PX > CONVERGED_PX {
            let px = step * SEARCH_STEP_PX;
            let tried = MOVES.map(|[left, right, turn]| Shape {
                sides: [shape.sides[0] + px * left, shape.sides[1] + px * right],
                lamp: shape.lamp + step * LAMP_STEP_RAD * turn,
                ..shape
            });
            let is_near = |shape: &Shape| {
                let moved = (0..2).map(|k| (shape.sides[k] - start.sides[k]).abs()).fold(0.0, f64::max);
                let width = shape.sides[1] - shape.sides[0];
                moved <= MAX_REFINEMENT_PX && (width_px[0]..=width_px[1]).contains(&width)
            };
            let near = tried.into_iter().filter(is_near);
            let better = near.filter_map(|shape| Some((self.squares(&shape)?, shape)));
            match better.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|(squares, _)| *squares < best) {
                Some(found) => (best, shape) = found,
                None => step *= 0.5,
            }
        }
        Some((best, shape))
    }

    /// Returns the sum of squared residuals with the best ground and light, DN^2; `None` if these are not determined.
    fn squares(&self, shape: &Shape) -> Option<f64> {
        let (mut normal, mut right, mut total) = (SMatrix::<f64, 4, 4>::zeros(), Vector::zeros(), 0.0);
        for (level, x) in self.levels.iter().zip(0_u32..) {
            let row = shape.basis(self.first + f64::from(x));
            normal += row * row.transpose();
            right += row * *level;
            total += level * level;
        }
        // Without a part that the lamp lights, the normal matrix is singular.
        normal[(3, 3)] += 1e-9;
        let solved = normal.cholesky()?.solve(&right);
        (solved[3] >= 0.0).then(|| total - solved.dot(&right))
    }

    /// Returns the sides with the uncertainties from the curvature of the sum of squares.
    fn with_uncertainty(&self, shape: &Shape, squares: f64) -> Option<TapeSides> {
        let (h, sides) = (CURVATURE_STEP_PX, shape.sides);
        // The lamp follows the sides.
        let lamps = [-1.0, 0.0, 1.0].map(|turn| shape.lamp + turn * LAMP_STEP_RAD * h);
        let at = |a: f64, b: f64| {
            let moved = [sides[0] + a * h, sides[1] + b * h];
            let squares = lamps.iter().filter_map(|lamp| self.squares(&Shape { sides: moved, lamp: *lamp, ..*shape }));
            squares.min_by(f64::total_cmp)
        };
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

/// Fits the sides at each tape near those given, px, with a distance within `width_px`.
///
/// The search moves the sides of all tapes together, since one tape alone may fit better somewhere else. It reaches
/// `outward_px` to the outside.
pub(super) fn fit_tapes(
    tapes: &[TapeProfile],
    near: &[[f64; 2]],
    width_px: [f64; 2],
    outward_px: f64,
) -> Option<Vec<TapeSides>> {
    let count = ((outward_px + INWARD_PX) / SEARCH_STEP_PX).floor() as u32;
    let outward = || (0..=count).map(|k| outward_px - f64::from(k) * SEARCH_STEP_PX);
    let pairs = outward().flat_map(|left| outward().map(move |right| [left, right]));
    let tried: Vec<Vec<(f64, Shape)>> = pairs
        .filter_map(|[left, right]| {
            let best = |(tape, [from, to]): (&TapeProfile, &[f64; 2])| {
                let sides = [from - left, to + right];
                let is_allowed = (width_px[0]..=width_px[1]).contains(&(sides[1] - sides[0]));
                tape.best_lamp(sides).filter(|_| is_allowed && tape.has_ground(sides))
            };
            tapes.iter().zip(near).map(best).collect()
        })
        .collect();
    // The negative logarithm of the likelihood, if the misfit of each tape is not known before, and of the width.
    let misfit = |shapes: &Vec<(f64, Shape)>| {
        let of_tape = |(tape, (squares, _)): (&TapeProfile, &(f64, Shape))| {
            0.5 * tape.levels.len() as f64 / ALIKE_COLUMNS * squares.max(1e-9).ln()
        };
        let width = shapes.first().map_or(0.0, |(_, shape)| width_misfit(shape.sides[1] - shape.sides[0], width_px));
        tapes.iter().zip(shapes).map(of_tape).sum::<f64>() + width
    };
    let start = tried.iter().min_by(|a, b| misfit(a).total_cmp(&misfit(b)))?;
    tapes.iter().zip(start).map(|(tape, (_, shape))| tape.fit_sides(*shape, width_px)).collect()
}

/// Returns the negative logarithm of the likelihood of a width within `range`, px.
///
/// The range is that of a diameter and a scale, three standard deviations to either side. Any width is equally likely
/// without them.
fn width_misfit(width_px: f64, [min, max]: [f64; 2]) -> f64 {
    if max / min > MAX_RANGE_RATIO {
        return 0.0;
    }
    let (expected, sigma) = ((min * max).sqrt().ln(), (max / min).ln() / 6.0);
    0.5 * ((width_px.ln() - expected) / sigma).powi(2)
}

impl Shape {
    /// Returns the blurred parts of a column `x`, px: the ground on the left and on the right, the light from all sides
    /// and that of the lamp.
    fn basis(&self, x: f64) -> Vector {
        const NODES: [f64; 7] = [-2.4, -1.6, -0.8, 0.0, 0.8, 1.6, 2.4];
        let [left, right] = self.sides;
        let (before, behind) = (1.0 - normal_cdf((x - left) / self.blur), normal_cdf((x - right) / self.blur));
        let (middle, half) = (0.5 * (left + right), 0.5 * (right - left));
        let inside = 1.0 - before - behind;
        let (sin, cos) = self.lamp.sin_cos();
        // The light at both sides, and a line between them, is blurred with the sides. What is left is continuous.
        let [at_left, at_right] = [-sin, sin].map(|light| light.max(0.0));
        let line = |s: f64| 0.5 * (at_left + at_right + s * (at_right - at_left));
        let (mut rest, mut weight) = (0.0, 0.0);
        for node in NODES {
            let w = (-0.5 * node * node).exp();
            let s = (x + self.blur * node - middle) / half;
            if s.abs() < 1.0 {
                rest += w * ((s * sin + (1.0 - s * s).sqrt() * cos).max(0.0) - line(s));
            }
            weight += w;
        }
        let s = ((x - middle) / half).clamp(-1.0, 1.0);
        Vector::from([before, behind, inside, inside * line(s) + rest / weight])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cylinder between columns 20.3 and 50.1 with a lamp from the left.
    fn lit(lamp: f64) -> TapeProfile {
        let shape = Shape { sides: [20.3, 50.1], lamp, blur: 0.7 };
        let level = |x: f64| shape.basis(x).dot(&Vector::from([10.0, 12.0, 11.0, 120.0]));
        TapeProfile { first: 5.0, row: 0.0, levels: (5..65).map(|x| level(f64::from(x))).collect() }
    }

    #[test]
    fn a_side_that_fades_into_the_ground_is_found() {
        for lamp in [-0.2, -0.5] {
            let profile = lit(lamp);
            assert!(profile.evenness([20.3, 50.1]) < 0.7);
            // A threshold places the dark side 4 px too far inside.
            let found = fit_tapes(&[profile], &[[20.0, 46.0]], [24.0, 38.0], 8.0).unwrap();
            let [left, right] = found[0].sides_px;
            assert!((left.value - 20.3).abs() < 0.05 && (right.value - 50.1).abs() < 0.2, "{found:?}");
        }
    }
}
