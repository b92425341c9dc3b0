//! Levels at scattered positions, eight at a time.

use super::interpolation::InterpolatedImage;
use crate::dic::geometry::Point;
use crate::numeric::{LANES, Lanes, Vector, vectorized};

/// The number of taps along each axis.
const TAPS: usize = 6;

vectorized! {
    /// Evaluates an image at positions anywhere in it, px, and writes the levels to `out`, DN.
    ///
    /// Equal to [`InterpolatedImage::value_at`] but for rounding.
    ///
    /// # Panics
    ///
    /// If the taps of a position reach beyond the memory of the image and its margin.
    pub(in crate::dic) fn sample_points(target: &InterpolatedImage, points: &[Point], out: &mut [f32]) = sample_points_with
}

/// Implements [`sample_points`] on vectors of type `V`.
#[inline(always)]
fn sample_points_with<V: Vector>(target: &InterpolatedImage, points: &[Point], out: &mut [f32]) {
    for (points, out) in points.chunks(LANES).zip(out.chunks_mut(LANES)) {
        let mut group = [points[0]; LANES];
        group[..points.len()].copy_from_slice(points);
        out.copy_from_slice(&sample_group::<V>(target, &group).0[..points.len()]);
    }
}

/// Evaluates the image at eight positions, px.
#[inline(always)]
fn sample_group<V: Vector>(target: &InterpolatedImage, points: &[Point; LANES]) -> Lanes {
    let (mut first_taps, mut along_x, mut along_y) = ([0; LANES], Lanes::splat(0.0), Lanes::splat(0.0));
    for (lane, point) in points.iter().enumerate() {
        let (cell_x, cell_y) = (point.x_px.floor(), point.y_px.floor());
        first_taps[lane] = target.first_tap::<TAPS>(cell_x as isize, cell_y as isize);
        along_x.0[lane] = (point.x_px - cell_x) as f32;
        along_y.0[lane] = (point.y_px - cell_y) as f32;
    }
    let weights_y = target.lane_weights::<V, TAPS>(V::from_lanes(&along_y));
    // From a vector of eight positions per tap to one of eight taps per position; the last two taps have no weight.
    let mut by_tap = [V::splat(0.0); LANES];
    by_tap[..TAPS].copy_from_slice(&target.lane_weights::<V, TAPS>(V::from_lanes(&along_x)));
    let weights_x = V::transpose(by_tap);
    let mut products = [V::splat(0.0); LANES];
    let mut rows = [Lanes::splat(0.0); TAPS];
    for (row, weight) in rows.iter_mut().zip(weights_y) {
        *row = weight.to_lanes();
    }
    for lane in 0..LANES {
        let (taps, stride) = target.taps_from(first_taps[lane]);
        let mut column = V::splat(0.0);
        for (row, weights) in rows.iter().enumerate() {
            column = column.plus_product(V::splat(weights.0[lane]), V::load(&taps[row * stride..]));
        }
        products[lane] = column.mul(weights_x[lane]);
    }
    V::sums(&products)
}

#[cfg(test)]
mod tests {
    use super::super::interpolation::Interpolation;
    use super::super::padded_image::PaddedImage;
    use super::*;

    #[test]
    fn eight_at_a_time_equals_one_at_a_time_for_any_number_of_positions() {
        let mut plane = PaddedImage::default();
        plane.reshape(40, 30);
        for y in 0..30 {
            for (x, value) in plane.row_mut(y).iter_mut().enumerate() {
                *value = 50.0 * (x as f32 * 0.9).sin() + 30.0 * (y as f32 * 0.7 + x as f32 * 0.2).cos();
            }
        }
        plane.mirror_margin();
        for interpolation in [Interpolation::Optimised, Interpolation::Bicubic] {
            let image = InterpolatedImage::new(&plane, interpolation);
            for count in [1, 7, 8, 19] {
                let place = |k: usize| Point::new((k * 37 % 390) as f64 * 0.1, (k * 53 % 290) as f64 * 0.1);
                let points: Vec<Point> = (0..count).map(place).collect();
                let mut found = vec![0.0; count];
                sample_points(&image, &points, &mut found);
                for (point, found) in points.iter().zip(&found) {
                    let expected = image.value_at(point.x_px, point.y_px);
                    assert!((found - expected).abs() < 1e-4, "{point:?}: {found}, not {expected}");
                }
            }
        }
    }
}
