//! Illumination gradients across a body, removed from reference and target alike.
//!
//! The light stays in place while the body moves. Its gradient would hold a rotating pattern back, and bias one that
//! moves to where the gradient differs, by more than the noise over many frames. A plane is therefore fitted to the
//! grey levels of each image and removed together with mean and gain. The match uses only what is orthogonal to 1, x
//! and y.

use crate::dic::geometry::SubsetMask;
use crate::numeric::{LANES, Lanes, Vector, vectorized};

/// The minimum ratio of the determinant to the product of the second moments. Below, the pixels lie nearly on a line.
const MIN_DETERMINANT: f64 = 1e-3;

/// The plane fitted to the levels of a reference's pixels, and its contribution to sums over them.
///
/// J is the Jacobian of the affine warp, (gx, gx dx, gx dy, gy, gy dx, gy dy).
#[derive(Debug, Clone, Copy)]
pub(in crate::dic) struct IlluminationPlane {
    /// The centroid of the pixels relative to the centre, px.
    pub(in crate::dic) centroid: [f64; 2],
    /// The second moments about the centroid, and the inverse.
    second: [[f64; 2]; 2],
    inverse: [[f64; 2]; 2],
    /// The sums of J times x and y about the centroid.
    jacobian: [[f64; 6]; 2],
    /// The slopes of the plane, DN/px.
    pub(in crate::dic) slopes: [f64; 2],
}

impl IlluminationPlane {
    /// Fits the plane to the levels of a subset by least squares; `None` if its pixels do not span a plane.
    ///
    /// `levels` and the gradients along x and y are packed like the mask, 0 off it.
    pub(in crate::dic) fn fit(levels: &[Lanes], gradients: [&[Lanes]; 2], window: &SubsetMask) -> Option<Self> {
        let [count, x, y, xx, xy, yy] = moments(&window.mask, window);
        let centroid = [x / count, y / count];
        let (xx, xy, yy) = (xx - centroid[0] * x, xy - centroid[0] * y, yy - centroid[1] * y);
        let determinant = xx * yy - xy * xy;
        if determinant.is_nan() || determinant <= MIN_DETERMINANT * xx * yy {
            return None;
        }
        let second = [[xx, xy], [xy, yy]];
        let inverse = [[yy, -xy], [-xy, xx]].map(|row| row.map(|moment| moment / determinant));
        let mut jacobian = [[0.0; 6]; 2];
        for (half, gradient) in gradients.into_iter().enumerate() {
            let [sum, x, y, xx, xy, yy] = moments(gradient, window);
            for (axis, sums) in [[x, xx, xy], [y, xy, yy]].into_iter().enumerate() {
                for (k, (with, without)) in sums.into_iter().zip([sum, x, y]).enumerate() {
                    jacobian[axis][3 * half + k] = with - centroid[axis] * without;
                }
            }
        }
        let mut light = Self { centroid, second, inverse, jacobian, slopes: [0.0; 2] };
        let [sum, x, y, ..] = moments(levels, window);
        light.slopes = light.fit_slopes(sum, [x, y]);
        Some(light)
    }

    /// Returns the slopes of the plane fitted to levels, DN/px, from their sum and their sums times x and y.
    pub(in crate::dic) fn fit_slopes(&self, sum: f64, first_moments: [f64; 2]) -> [f64; 2] {
        let about: [f64; 2] = std::array::from_fn(|axis| first_moments[axis] - self.centroid[axis] * sum);
        self.inverse.map(|row| row[0] * about[0] + row[1] * about[1])
    }

    /// Returns the sum over the pixels of the reference's plane times the plane of these slopes, DN^2.
    pub(in crate::dic) fn product_with_reference(&self, slopes: [f64; 2]) -> f64 {
        let across = |slopes: [f64; 2]| self.second.map(|row| row[0] * slopes[0] + row[1] * slopes[1]);
        across(slopes).iter().zip(self.slopes).map(|(sum, slope)| sum * slope).sum()
    }

    /// Returns the sum of squares over the pixels of the plane of these slopes, DN^2.
    pub(in crate::dic) fn energy(&self, slopes: [f64; 2]) -> f64 {
        self.second.iter().zip(slopes).map(|(row, slope)| slope * (row[0] * slopes[0] + row[1] * slopes[1])).sum()
    }

    /// Returns the sum over the pixels of component `k` (0 to 5) of J times the plane of these slopes (DN/px).
    pub(in crate::dic) fn jacobian_product(&self, slopes: [f64; 2], k: usize) -> f64 {
        slopes[0] * self.jacobian[0][k] + slopes[1] * self.jacobian[1][k]
    }

    /// Removes mean and plane of each component of J from the sum of J J^T over `pixels` pixels.
    pub(in crate::dic) fn remove_from_hessian(
        &self,
        jacobian_sum: &[f64; 6],
        pixels: usize,
        hessian: &mut [[f64; 6]; 6],
    ) {
        for (k, line) in hessian.iter_mut().enumerate() {
            let own = [self.jacobian[0][k], self.jacobian[1][k]];
            let slopes = self.inverse.map(|row| row[0] * own[0] + row[1] * own[1]);
            for (j, value) in line.iter_mut().enumerate() {
                *value -= jacobian_sum[k] * jacobian_sum[j] / pixels as f64 + self.jacobian_product(slopes, j);
            }
        }
    }
}

/// Returns the sums of packed values times 1, x, y, x^2, x y and y^2, with offsets from the centre in px.
fn moments(values: &[Lanes], window: &SubsetMask) -> [f64; 6] {
    let mut out = [0.0; 6];
    for block in &window.blocks {
        let [plain, down, twice] = sum_powers(&values[block.start..block.start + block.rows], block.dy);
        let (plain, down) = (plain.moments(f64::from(block.dx)), down.moments(f64::from(block.dx)));
        for (sum, part) in out.iter_mut().zip([plain[0], plain[1], down[0], plain[2], down[1], twice.sum()]) {
            *sum += part;
        }
    }
    out
}

/// Adds `value`, `value` dy and `value` dy^2 to three sums.
#[inline(always)]
pub(in crate::dic) fn add_powers<V: Vector>(sums: &mut [V; 3], value: V, dy: V) {
    let lever = value.mul(dy);
    sums[0] = sums[0].add(value);
    sums[1] = sums[1].add(lever);
    sums[2] = sums[2].add(lever.mul(dy));
}

vectorized! {
    /// Returns the sums of the rows of a block, times 1, dy and dy^2, lane by lane. `dy` is the offset of the first
    /// row.
    fn sum_powers(values: &[Lanes], dy: i32) -> [Lanes; 3] = sum_powers_with
}

/// Implements [`sum_powers`] on vectors of type `V`.
#[inline(always)]
fn sum_powers_with<V: Vector>(values: &[Lanes], dy: i32) -> [Lanes; 3] {
    let mut sums = [V::splat(0.0); 3];
    for (dy, value) in (dy..).zip(values) {
        add_powers(&mut sums, V::from_lanes(value), V::splat(dy as f32));
    }
    sums.map(V::to_lanes)
}

/// Returns the values of a plane at the eight columns of a block in row `dy`, DN. `dx` is the offset of the first
/// column, and the plane is zero at the point `about`, px from the centre.
pub(in crate::dic) fn plane_row(slopes: [f64; 2], about: [f64; 2], dx: i32, dy: i32) -> Lanes {
    let first = slopes[0] * (f64::from(dx) - about[0]) + slopes[1] * (f64::from(dy) - about[1]);
    Lanes(std::array::from_fn::<f32, LANES, _>(|lane| (first + slopes[0] * lane as f64) as f32))
}

#[cfg(test)]
mod tests {
    use crate::dic::tests::{Speckle, prepared, record};
    use crate::dic::{PlanarMotion, Point, Region, RigidBody};
    use crate::image::Image;

    /// An image with an illumination gradient, DN/px.
    fn lit(image: &Image, slopes: [f32; 2]) -> Image {
        let mut image = image.clone();
        for (y, row) in image.rows_mut().enumerate() {
            for (x, level) in row.iter_mut().enumerate() {
                *level += slopes[0] * (x as f32 - 70.0) + slopes[1] * (y as f32 - 66.0);
            }
        }
        image
    }

    #[test]
    fn a_body_is_found_where_it_is_in_any_light() {
        let speckle = Speckle::standard(41, 140.0);
        let moved = speckle.moved(|x, y| {
            let (dx, dy) = (x - 70.0, y - 66.0);
            let (sin, cos) = 0.6_f64.to_radians().sin_cos();
            (dx * cos + dy * sin - dx + 0.37, dy * cos - dx * sin - dy - 0.21)
        });
        let (first, second) = (record(&speckle.draw(140, 132), 1.0, 1), record(&moved.draw(140, 132), 1.0, 2));
        for region in [
            Region::Disc { x_px: 70.0, y_px: 66.0, radius_px: 50.0 },
            Region::Polygon { outline_px: vec![[30.0, 30.0], [110.0, 38.0], [96.0, 104.0]], holes_px: vec![] },
        ] {
            let find = |slopes: [[f32; 2]; 2]| {
                let mut body = RigidBody::new(&prepared(&lit(&first, slopes[0])), &region).unwrap();
                let target = prepared(&lit(&second, slopes[1]));
                let near = PlanarMotion { u_px: 0.37, v_px: -0.21, angle_deg: 0.6 };
                let motion = body.find_visible(&target, Point::new(70.0, 66.0), near).unwrap();
                assert!(motion.visible_fraction > 0.99 && motion.zncc > 0.98, "{motion:?}");
                motion.motion
            };
            let even = find([[0.0; 2]; 2]);
            for slopes in [[[0.3, -0.2], [0.3, -0.2]], [[0.0, 0.4], [-0.3, 0.1]], [[0.5, 0.5], [0.0, 0.0]]] {
                let found = find(slopes);
                let off = [found.u_px - even.u_px, found.v_px - even.v_px, found.angle_deg - even.angle_deg];
                assert!(off.iter().all(|off| off.abs() < 2e-5), "{slopes:?}: {off:?}");
                assert!((found.sigma_u_px / even.sigma_u_px - 1.0).abs() < 0.01, "{slopes:?}: {found:?} {even:?}");
            }
        }
    }
}
