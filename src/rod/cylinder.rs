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
/// The first blur and its range: standard deviations, px.
const BLUR_PX: f64 = 0.8;
const BLUR_RANGE_PX: std::ops::RangeInclusive<f64> = 0.3..=2.0;
/// The range inwards in which a side is searched, px.
const INWARD_PX: f64 = 2.0;
/// The step of the search, px.
const SEARCH_STEP_PX: f64 = 1.0;
/// The maximum distance of a side of one tape from the search over all, px: for the step, the tried lamps and the tilt.
const MAX_REFINEMENT_PX: f64 = 4.0;
/// The step that ends the refinement, px.
const CONVERGED_PX: f64 = 0.004;
/// The number of neighbouring columns whose residuals are alike: what the model lacks is smooth.
const ALIKE_COLUMNS: f64 = 3.0;
/// The change of a parameter for its derivative: px, rad.
const DIFFERENCE: f64 = 1e-5;
/// The damping of the first iteration, its factor from one to the next, and its maximum; the maximum of the iterations.
const FIRST_DAMPING: f64 = 1e-3;
const DAMPING_FACTOR: f64 = 4.0;
const MAX_DAMPING: f64 = 1e8;
const MAX_ITERATIONS: usize = 60;
/// The starts of the refinement of each side, relative to the search over all tapes, px.
const STARTS_PX: [f64; 3] = [-1.5, 0.0, 1.5];
/// The weight below which a fit is left out.
const MIN_WEIGHT: f64 = 1e-6;
/// The number of parameters of a profile: two sides, lamp, blur, two grounds, two parts of the light.
const PARAMETERS: usize = 8;
/// The directions of the lamp that are tried, from the camera towards the right side, rad.
const LAMPS_RAD: [f64; 9] = [-1.4, -1.05, -0.7, -0.35, 0.0, 0.35, 0.7, 1.05, 1.4];
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

/// The normal equations of a profile.
struct NormalEquations {
    normal: SMatrix<f64, PARAMETERS, PARAMETERS>,
    right: SVector<f64, PARAMETERS>,
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
        // The first column of each row, half a column to the right.
        let starts: Vec<f64> = (rows[0]..rows[1]).map(|y| first + tilt * (y as f64 - row) + 0.5).collect();
        let mut paint = |k: usize| {
            column.clear();
            let at = |(y, start): (usize, &f64)| image.at((start + k as f64) as usize, y);
            column.extend((rows[0]..rows[1]).zip(&starts).filter_map(at));
            quantile(&mut column, PAINT_QUANTILE).map(f64::from)
        };
        let levels = (0..=(last - first) as usize).map(&mut paint).collect::<Option<_>>()?;
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
        let shapes = LAMPS_RAD.map(|lamp| Shape { sides, lamp, blur: BLUR_PX });
        let squares = shapes.into_iter().filter_map(|shape| Some((self.squares(&shape)?, shape)));
        squares.min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Refines sides, lamp and blur from a shape near them; `None` if they are not determined, or end at a limit.
    ///
    /// A side in the dark may fit at several places. The refinement therefore starts from several, and the uncertainty
    /// includes those that fit about as well.
    fn fit_sides(&self, start: Shape, width_px: [f64; 2]) -> Option<TapeSides> {
        let [left, right] = start.sides;
        let starts = STARTS_PX.into_iter().flat_map(|a| STARTS_PX.map(|b| [left + a, right + b]));
        let lamps = |sides: [f64; 2]| [start.lamp, -start.lamp, 0.0].map(|lamp| Shape { sides, lamp, ..start });
        let refined = starts.flat_map(lamps).filter_map(|shape| self.refine(shape, width_px));
        let fits: Vec<(f64, Shape)> = refined.filter(|(_, shape)| is_near(shape, &start)).collect();
        let best = fits.iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
        self.combine(best, &fits, width_px)
    }

    /// Refines a shape by Levenberg and Marquardt's method; returns the sum of squares, DN^2, and the shape.
    fn refine(&self, start: Shape, width_px: [f64; 2]) -> Option<(f64, Shape)> {
        let (mut squares, mut shape, mut damping) = (self.squares(&start)?, start, FIRST_DAMPING);
        for _ in 0..MAX_ITERATIONS {
            let equations = self.equations(&shape)?;
            let mut damped = equations.normal;
            (0..PARAMETERS).for_each(|k| damped[(k, k)] *= 1.0 + damping);
            let Some(step) = damped.cholesky().map(|factor| factor.solve(&equations.right)) else { break };
            let moved = Shape {
                sides: [shape.sides[0] + step[0], shape.sides[1] + step[1]],
                lamp: shape.lamp + step[2],
                blur: shape.blur + step[3],
            };
            let width = width_px[0]..=width_px[1];
            let is_allowed = BLUR_RANGE_PX.contains(&moved.blur) && width.contains(&(moved.sides[1] - moved.sides[0]));
            match self.squares(&moved).filter(|tried| is_allowed && *tried < squares) {
                Some(fewer) => {
                    (squares, shape, damping) = (fewer, moved, damping / DAMPING_FACTOR);
                    if step[0].abs().max(step[1].abs()) < CONVERGED_PX {
                        break;
                    }
                }
                None if damping > MAX_DAMPING => break,
                None => damping *= DAMPING_FACTOR,
            }
        }
        Some((squares, shape))
    }

    /// Returns the sides of the best of several fits, with the uncertainties of the mixture of all of them.
    ///
    /// Each fit weighs by its likelihood and that of its width.
    fn combine(&self, best: &(f64, Shape), fits: &[(f64, Shape)], width_px: [f64; 2]) -> Option<TapeSides> {
        let variance = ALIKE_COLUMNS * best.0 / (self.levels.len() as f64 - PARAMETERS as f64).max(1.0);
        let misfit = |(squares, shape): &(f64, Shape)| {
            0.5 * squares / variance.max(f64::MIN_POSITIVE) + width_misfit(shape.sides[1] - shape.sides[0], width_px)
        };
        let (least, center) = (misfit(best), best.1.sides);
        let (mut sums, mut total) = ([0.0; 3], 0.0);
        for fit in fits {
            let weight = (least - misfit(fit)).min(0.0).exp();
            let Some(covariance) = self.covariance(&fit.1, variance).filter(|_| weight > MIN_WEIGHT) else { continue };
            let [dx, dy] = [fit.1.sides[0] - center[0], fit.1.sides[1] - center[1]];
            let terms = [covariance[0] + dx * dx, covariance[1] + dx * dy, covariance[2] + dy * dy];
            sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += weight * term);
            total += weight;
        }
        if total.is_nan() || total <= 0.0 {
            return None;
        }
        let covariance = sums.map(|sum: f64| sum / total);
        let side = |value: f64, variance: f64| Estimate { value, sigma: variance.max(0.0).sqrt() };
        Some(TapeSides {
            row: self.row,
            sides_px: [side(center[0], covariance[0]), side(center[1], covariance[2])],
            middle_sigma_px: (0.25 * (covariance[0] + covariance[2] + 2.0 * covariance[1])).max(0.0).sqrt(),
        })
    }

    /// Returns the normal equations of all parameters: those of the shape, then the grounds and the light.
    fn equations(&self, shape: &Shape) -> Option<NormalEquations> {
        let linear = self.linear_fit(shape)?.0;
        let Shape { sides: [left, right], lamp, blur } = *shape;
        let h = DIFFERENCE;
        let changed = [
            Shape { sides: [left + h, right], ..*shape },
            Shape { sides: [left, right + h], ..*shape },
            Shape { lamp: lamp + h, ..*shape },
            Shape { blur: blur + h, ..*shape },
        ];
        let mut equations = NormalEquations { normal: SMatrix::zeros(), right: SVector::zeros() };
        for (level, x) in self.levels.iter().zip(0_u32..) {
            let x = self.first + f64::from(x);
            let basis = shape.basis(x);
            let value = basis.dot(&linear);
            let slopes = changed.map(|changed| (changed.basis(x).dot(&linear) - value) / h);
            let row = SVector::<f64, PARAMETERS>::from_fn(|k, _| if k < 4 { slopes[k] } else { basis[k - 4] });
            equations.normal += row * row.transpose();
            equations.right += row * (level - value);
        }
        Some(equations)
    }

    /// Returns the best ground and light of a shape, and the sum of squared residuals, DN^2; `None` if they are not
    /// determined.
    fn linear_fit(&self, shape: &Shape) -> Option<(Vector, f64)> {
        let (mut normal, mut right) = (SMatrix::<f64, 4, 4>::zeros(), Vector::zeros());
        let rows: Vec<Vector> = (0..self.levels.len()).map(|k| shape.basis(self.first + k as f64)).collect();
        for (level, row) in self.levels.iter().zip(&rows) {
            normal += row * row.transpose();
            right += row * *level;
        }
        // Without a part that the lamp lights, the normal matrix is singular.
        normal[(3, 3)] += 1e-9;
        let solved = normal.cholesky()?.solve(&right);
        let squares = self.levels.iter().zip(&rows).map(|(level, row)| (level - row.dot(&solved)).powi(2)).sum();
        (solved[3] >= 0.0).then_some((solved, squares))
    }

    /// Returns the sum of squared residuals with the best ground and light, DN^2; `None` if these are not determined.
    fn squares(&self, shape: &Shape) -> Option<f64> {
        self.linear_fit(shape).map(|(_, squares)| squares)
    }

    /// Returns the variance of the left side, the covariance of both and the variance of the right one, px^2, for
    /// residuals of this variance, DN^2.
    fn covariance(&self, shape: &Shape, variance: f64) -> Option<[f64; 3]> {
        let inverse = self.equations(shape)?.normal.try_inverse()?;
        Some([inverse[(0, 0)], inverse[(0, 1)], inverse[(1, 1)]].map(|part| variance * part))
    }
}

/// Whether both sides of a shape lie near those of the start.
fn is_near(shape: &Shape, start: &Shape) -> bool {
    (0..2).all(|k| (shape.sides[k] - start.sides[k]).abs() <= MAX_REFINEMENT_PX)
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
    use crate::numeric::Xorshift;

    /// A cylinder between columns 20.3 and 50.1 with a lamp from the left.
    fn lit(lamp: f64) -> TapeProfile {
        let shape = Shape { sides: [20.3, 50.1], lamp, blur: 0.7 };
        let level = |x: f64| shape.basis(x).dot(&Vector::from([10.0, 12.0, 11.0, 120.0]));
        TapeProfile { first: 5.0, row: 0.0, levels: (5..65).map(|x| level(f64::from(x))).collect() }
    }

    #[test]
    fn a_side_that_fades_into_the_ground_is_found() {
        for lamp in [-0.2, -0.35, -0.5, -0.8] {
            let profile = lit(lamp);
            assert!(profile.evenness([20.3, 50.1]) < 0.7);
            // A threshold places the dark side 4 px too far inside.
            let found = fit_tapes(&[profile], &[[20.0, 46.0]], [24.0, 38.0], 8.0).unwrap();
            let [left, right] = found[0].sides_px;
            assert!((left.value - 20.3).abs() < 0.01 && (right.value - 50.1).abs() < 0.01, "{found:?}");
        }
    }

    #[test]
    fn the_sides_of_a_noisy_profile_lie_within_their_uncertainty() {
        let mut random = Xorshift::default();
        let (mut squares, mut count, mut worst) = (0.0, 0.0, 0.0_f64);
        for case in 0..60 {
            let mut profile = lit([-0.5, -0.2, 0.1, 0.4][case % 4]);
            for level in &mut profile.levels {
                // The sum of twelve uniform numbers has a standard deviation of 1.
                *level += (0..12).map(|_| random.below(1000) as f64 / 1000.0).sum::<f64>() - 6.0;
            }
            let Some(found) = fit_tapes(&[profile], &[[20.0, 48.0]], [24.0, 38.0], 8.0) else { continue };
            for (side, truth) in found[0].sides_px.iter().zip([20.3, 50.1]) {
                let pull = (side.value - truth) / side.sigma;
                (squares, count, worst) = (squares + pull * pull, count + 1.0, worst.max(pull.abs()));
            }
        }
        let rms: f64 = (squares / count).sqrt();
        eprintln!("{count} sides, pulls {rms:.2} rms, {worst:.1} at most");
        assert!(count > 90.0 && (0.3..1.2).contains(&rms) && worst < 5.0, "{count}: {rms}, {worst}");
    }
}
