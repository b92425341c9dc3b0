//! Smooth light that stays in the room while a body moves, removed from the match of the whole body.
//!
//! The light on a curved body is no plane. It stays in place, so it holds a turning pattern back, the more so the fewer
//! marks the pattern has. The residual of a match then contains a smooth field. It is estimated together with the
//! motion: the match uses only what is orthogonal to all polynomials of low order. Gauss-Newton steps are linear in the
//! residual, so one step after the match suffices.

use multiversion::multiversion;

use super::visibility::sum_of_squares;
use crate::dic::geometry::{Shape, SubsetMask, Warp};
use crate::dic::subset::ReferenceSubset;
use crate::numeric::{LANES, Lanes, invert};

/// The order of the field. Shading that falls off towards the rim has little beyond it.
const ORDER: usize = 4;
/// The number of monomials x^i y^j of at most this order.
const TERMS: usize = (ORDER + 1) * (ORDER + 2) / 2;
/// The number of powers of one coordinate in products of two monomials.
const POWERS: usize = 2 * ORDER + 1;
/// The excess of the field's chi-square over its expectation from which it is light and not noise, standard deviations.
const SIGNIFICANT: f64 = 6.0;

/// The sums of values times x^i y^j, indexed by j and i.
type Moments = [[f64; POWERS]; POWERS];

/// The exponents of the terms: x and y.
const EXPONENTS: [[usize; 2]; TERMS] = {
    let (mut exponents, mut at, mut order) = ([[0; 2]; TERMS], 0, 0);
    while order <= ORDER {
        let mut y = 0;
        while y <= order {
            exponents[at] = [order - y, y];
            (at, y) = (at + 1, y + 1);
        }
        order += 1;
    }
    exponents
};

/// Smooth fields on the pixels of a body, and their confusion with its motion.
#[derive(Debug, Clone)]
pub(in crate::dic) struct LightField {
    /// The unit of the coordinates, px.
    unit_px: f64,
    /// The inverse of the sums of products of two terms.
    gram_inverse: [[f64; TERMS]; TERMS],
    /// The sums of the derivatives by u, v and the angle times each term.
    confusion: [[f64; TERMS]; 3],
    /// The inverse Hessian of the motion that is orthogonal to all terms.
    inverse: [[f64; 3]; 3],
}

/// The change of a match that removing the light makes.
#[derive(Debug, Clone, Copy)]
pub(in crate::dic) struct LightCorrection {
    pub(in crate::dic) step: Warp,
    /// The inverse Hessian of the motion without the light.
    pub(in crate::dic) inverse: [[f64; 3]; 3],
}

impl LightCorrection {
    /// Returns the rotation of a correction, counter-clockwise on the screen, deg; 0 without one.
    pub(in crate::dic) fn rotation_deg(correction: Option<&Self>) -> f64 {
        correction.map_or(0.0, |light| light.step.uy.atan2(1.0 + light.step.ux).to_degrees())
    }
}

impl LightField {
    /// Computes the sums of a rigid body over the pixels of `window`; `None` if these do not determine both the field
    /// and the motion.
    pub(in crate::dic) fn new(subset: &ReferenceSubset, window: &SubsetMask) -> Option<Self> {
        let unit_px = f64::from(window.half.max(1));
        let mask = polynomial_moments::<POWERS>(&window.mask, window, unit_px);
        let gram: [[f64; TERMS]; TERMS] = std::array::from_fn(|a| {
            std::array::from_fn(|b| mask[EXPONENTS[a][1] + EXPONENTS[b][1]][EXPONENTS[a][0] + EXPONENTS[b][0]])
        });
        let gram_inverse = invert(&gram, TERMS)?;
        let [along_x, along_y] = [&subset.gradient_x, &subset.gradient_y]
            .map(|gradient| polynomial_moments::<{ ORDER + 2 }>(gradient, window, unit_px));
        let confusion: [[f64; TERMS]; 3] = std::array::from_fn(|parameter| {
            EXPONENTS.map(|[i, j]| match parameter {
                0 => along_x[j][i],
                1 => along_y[j][i],
                // The derivative by the angle is gx y - gy x.
                _ => unit_px * (along_x[j + 1][i] - along_y[j][i + 1]),
            })
        });
        let mut hessian = [[0.0; 3]; 3];
        let products = gradient_products(subset, window);
        for (row, line) in hessian.iter_mut().enumerate() {
            let projected: [f64; TERMS] =
                std::array::from_fn(|b| (0..TERMS).map(|a| confusion[row][a] * gram_inverse[a][b]).sum());
            for (column, value) in line.iter_mut().enumerate() {
                let shared: f64 = projected.iter().zip(&confusion[column]).map(|(a, b)| a * b).sum();
                *value = products[row][column] - shared;
            }
        }
        Some(Self { unit_px, gram_inverse, confusion, inverse: invert(&hessian, 3)? })
    }

    /// Returns the correction of a match with this residual, DN; `None` if the residual holds no significant light.
    ///
    /// The field is significant if its chi^2 exceeds the expectation by more than [`SIGNIFICANT`] standard deviations.
    pub(in crate::dic) fn correction(&self, window: &SubsetMask, residual: &[Lanes]) -> Option<LightCorrection> {
        let sums = polynomial_moments::<{ ORDER + 1 }>(residual, window, self.unit_px);
        let sums: [f64; TERMS] = EXPONENTS.map(|[i, j]| sums[j][i]);
        let field = self.gram_inverse.map(|line| line.iter().zip(&sums).map(|(a, b)| a * b).sum::<f64>());
        let energy: f64 = field.iter().zip(&sums).map(|(a, b)| a * b).sum();
        let noise = (sum_of_squares(residual) - energy) / (window.pixels as f64 - TERMS as f64 - 3.0).max(1.0);
        let terms = TERMS as f64;
        let is_light = energy > noise * (terms + SIGNIFICANT * (2.0 * terms).sqrt());
        if !is_light {
            return None;
        }
        let pull = self.confusion.map(|line| line.iter().zip(&field).map(|(a, b)| a * b).sum::<f64>());
        let mut step = [0.0; 6];
        for (step, line) in step.iter_mut().zip(&self.inverse) {
            *step = line.iter().zip(&pull).map(|(a, b)| a * b).sum();
        }
        Some(LightCorrection { step: Warp::from_step(Shape::Rigid, &step), inverse: self.inverse })
    }
}

/// Returns the sum of J J^T of a rigid match: products of the derivatives by u, v (px) and the angle (rad).
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn gradient_products(subset: &ReferenceSubset, window: &SubsetMask) -> [[f64; 3]; 3] {
    let mut sums = [[0.0_f64; 3]; 3];
    for block in &window.blocks {
        let rows = block.start..block.start + block.rows;
        let mut lanes = [[0.0_f32; LANES]; 6];
        for (dy, (gx, gy)) in (block.dy..).zip(subset.gradient_x[rows.clone()].iter().zip(&subset.gradient_y[rows])) {
            for lane in 0..LANES {
                let (x, y) = (gx.0[lane], gy.0[lane]);
                let turn = x * dy as f32 - y * (block.dx + lane as i32) as f32;
                for (sum, term) in lanes.iter_mut().zip([x * x, x * y, y * y, x * turn, y * turn, turn * turn]) {
                    sum[lane] += term;
                }
            }
        }
        let [xx, xy, yy, xt, yt, tt] = lanes.map(|sum| sum.iter().map(|value| f64::from(*value)).sum::<f64>());
        for (line, terms) in sums.iter_mut().zip([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]]) {
            line.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
        }
    }
    sums
}

/// Returns the moments of packed values: the sums of value times x^i y^j for i + j below `P`. x and y are measured from
/// the centre, in units of `unit_px`.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn polynomial_moments<const P: usize>(values: &[Lanes], window: &SubsetMask, unit_px: f64) -> Moments {
    let mut sums = [[0.0; POWERS]; POWERS];
    for block in &window.blocks {
        let mut lanes = [[0.0_f32; LANES]; P];
        for (dy, row) in (block.dy..).zip(&values[block.start..block.start + block.rows]) {
            let y = (f64::from(dy) / unit_px) as f32;
            let mut value = row.0;
            for sum in &mut lanes {
                for lane in 0..LANES {
                    sum[lane] += value[lane];
                    value[lane] *= y;
                }
            }
        }
        for (j, (line, lanes)) in sums.iter_mut().zip(&lanes).enumerate() {
            for (lane, value) in lanes.iter().enumerate() {
                let x = f64::from(block.dx + lane as i32) / unit_px;
                let mut term = f64::from(*value);
                for sum in line.iter_mut().take(P - j) {
                    *sum += term;
                    term *= x;
                }
            }
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use crate::dic::tests::{Speckle, prepared, record};
    use crate::dic::{PlanarMotion, Point, Region, RigidBody};
    use crate::image::Image;

    /// An image under a lamp that is no plane: a bowl with a slanted rim, DN.
    fn lit(image: &Image, depth: f32) -> Image {
        let mut image = image.clone();
        for (y, row) in image.rows_mut().enumerate() {
            for (x, level) in row.iter_mut().enumerate() {
                let (x, y) = ((x as f32 - 70.0) / 50.0, (y as f32 - 66.0) / 50.0);
                *level += depth * (x * y + 0.5 * x * x * x - 0.4 * y * y);
            }
        }
        image
    }

    #[test]
    fn light_that_stays_does_not_hold_a_turning_body_back() {
        let speckle = Speckle::standard(43, 140.0);
        let moved = speckle.moved(|x, y| {
            let (dx, dy) = (x - 70.0, y - 66.0);
            let (sin, cos) = 2.0_f64.to_radians().sin_cos();
            (dx * cos + dy * sin - dx + 0.37, dy * cos - dx * sin - dy - 0.21)
        });
        let (first, second) = (record(&speckle.draw(140, 132), 1.0, 1), record(&moved.draw(140, 132), 1.0, 2));
        let region = Region::Disc { x_px: 70.0, y_px: 66.0, radius_px: 50.0 };
        let find = |depth: f32| {
            let mut body = RigidBody::new(&prepared(&lit(&first, depth)), &region).unwrap();
            let near = PlanarMotion { u_px: 0.37, v_px: -0.21, angle_deg: 2.0 };
            body.find(&prepared(&lit(&second, depth)), Point::new(70.0, 66.0), near).unwrap()
        };
        let (even, uneven) = (find(0.0), find(30.0));
        assert!(even.light_deg.abs() <= 0.0, "no light is found where there is none");
        let off = uneven.motion.angle_deg - even.motion.angle_deg;
        assert!(off.abs() < 0.2 * uneven.light_deg.abs(), "{off} deg left of {} deg", uneven.light_deg);
    }
}
