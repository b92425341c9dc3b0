//! Interpolation: the quintic B-spline prefilter and a six-tap kernel on its
//! coefficients.
//!
//! The kernel is not the B-spline itself. Its weights are degree-5 polynomials
//! of the fraction `t`, fitted so that prefilter and kernel together come as
//! close as possible to a pure shift `exp(i w t)` for the frequencies speckle
//! consists of: least squares of the error over `t` in 0..1 and `w` in 0..pi,
//! weighted by `exp(-(w / 0.8)^2) + 1e-4`, with the sum of the weights held at
//! one. It leaves a quarter of the quintic B-spline's bias at the same cost.
//! The prefilter follows M. Unser, A. Aldroubi, M. Eden, IEEE Trans. Signal
//! Process. 41 (1993) 834, <https://doi.org/10.1109/78.193221>.

use super::plane::{MARGIN, Plane, mirror};
use super::vector::Vector;

/// Poles of the quintic B-spline's prefilter.
const POLES: [f64; 2] = [-0.430_575_347_099_973_8, -0.043_096_288_203_264_65];

/// Reach of the prefilter's impulse response that still matters (0.43^15 = 3e-6), px.
const REACH: usize = 14;

/// Even part of the weights of taps 1, 2, 3 (mirrored: 0, -1, -2), by powers of (t - 1/2)^2.
#[expect(clippy::excessive_precision, reason = "the digits of the fit; rounding them would hide where they come from")]
const EVEN: [[f32; 3]; 3] = [
    [4.398_384_2e-1, -2.389_174e-1, 5.168_988_8e-2],
    [5.800_446_4e-2, 2.384_522e-1, -8.206_977e-2],
    [2.157_120_3e-3, 4.651_872_9e-4, 3.037_988_2e-2],
];

/// Odd part, by powers of (t - 1/2)^2, to be multiplied by t - 1/2.
#[expect(clippy::excessive_precision, reason = "the digits of the fit; rounding them would hide where they come from")]
const ODD: [[f32; 3]; 3] = [
    [3.957_628_9e-1, -2.678_602_2e-1, 7.267_808_5e-2],
    [1.982_516_8e-1, 4.939_555_5e-2, -3.634_419_5e-2],
    [1.872_997e-3, 2.399_093_3e-2, 7.423_789_7e-3],
];

/// Weights of the taps at -2, -1, 0, 1, 2, 3 px for a position `t` (0 to 1) after tap 0.
#[inline(always)]
pub(super) fn weights(t: f32) -> [f32; 6] {
    let s = t - 0.5;
    let square = s * s;
    let mut weights = [0.0; 6];
    for pair in 0..3 {
        let even = EVEN[pair][0] + square * (EVEN[pair][1] + square * EVEN[pair][2]);
        let odd = s * (ODD[pair][0] + square * (ODD[pair][1] + square * ODD[pair][2]));
        weights[3 + pair] = even + odd;
        weights[2 - pair] = even - odd;
    }
    weights
}

/// [`weights`] for eight positions.
#[inline(always)]
pub(super) fn lane_weights<V: Vector>(t: V) -> [V; 6] {
    let s = t.sub(V::splat(0.5));
    let square = s.mul(s);
    let part = |c: &[f32; 3]| {
        let inner = V::splat(c[1]).add(square.mul(V::splat(c[2])));
        V::splat(c[0]).add(square.mul(inner))
    };
    let even = [part(&EVEN[0]), part(&EVEN[1]), part(&EVEN[2])];
    let odd = [s.mul(part(&ODD[0])), s.mul(part(&ODD[1])), s.mul(part(&ODD[2]))];
    [
        even[2].sub(odd[2]),
        even[1].sub(odd[1]),
        even[0].sub(odd[0]),
        even[0].add(odd[0]),
        even[1].add(odd[1]),
        even[2].add(odd[2]),
    ]
}

/// The prefilter's impulse response at distances 0 to [`REACH`].
fn impulse_response() -> [f32; REACH + 1] {
    // Partial fractions of 120 / (z^2 + 26 z + 66 + 26 / z + 1 / z^2).
    let [a, b] = POLES;
    let gain = 120.0 * a * b;
    let part = |p: f64, q: f64| gain / ((1.0 - p * p) * (1.0 - p * q) * (1.0 - q / p));
    let (weight_a, weight_b) = (part(a, b), part(b, a));
    std::array::from_fn(|k| (weight_a * a.powi(k as i32) + weight_b * b.powi(k as i32)) as f32)
}

/// Turns the grey levels of `plane` into quintic-spline coefficients, margin included.
///
/// Mirrored at the edges. `scratch` is resized as needed.
pub(super) fn prefilter(plane: &mut Plane, scratch: &mut Vec<f32>) {
    filter_rows(plane, scratch);
    filter_columns(plane);
    plane.mirror_margin();
}

/// Along the rows by convolution: a recursion would go one pixel at a time.
fn filter_rows(plane: &mut Plane, scratch: &mut Vec<f32>) {
    let response = impulse_response();
    let width = plane.width();
    scratch.resize(width + 2 * REACH, 0.0);
    for y in 0..plane.height() {
        let row = plane.row_mut(y);
        scratch[REACH..REACH + width].copy_from_slice(row);
        for k in 1..=REACH {
            scratch[REACH - k] = row[mirror(-(k as isize), width)];
            scratch[REACH + width - 1 + k] = row[mirror((width - 1 + k) as isize, width)];
        }
        row.iter_mut().zip(&scratch[REACH..]).for_each(|(out, value)| *out = response[0] * value);
        for (k, weight) in response.iter().enumerate().skip(1) {
            let (left, right) = (&scratch[REACH - k..], &scratch[REACH + k..]);
            for (out, (l, r)) in row.iter_mut().zip(left.iter().zip(right)) {
                *out += weight * (l + r);
            }
        }
    }
}

/// Down the columns by recursion, all columns side by side.
fn filter_columns(plane: &mut Plane) {
    let height = plane.height();
    if height < 2 {
        return;
    }
    for pole in POLES {
        start_causal(plane, pole);
        for y in 1..height {
            plane.add_row(y, y - 1, pole as f32);
        }
        start_anticausal(plane, pole);
        for y in (0..height - 1).rev() {
            let negative = -(pole as f32);
            plane.row_mut(y).iter_mut().for_each(|value| *value *= negative);
            plane.add_row(y, y + 1, pole as f32);
        }
        let gain = ((1.0 - pole) * (1.0 - 1.0 / pole)) as f32;
        for y in 0..height {
            plane.row_mut(y).iter_mut().for_each(|value| *value *= gain);
        }
    }
}

/// First causal value of a mirrored column: the sum of its tail.
fn start_causal(plane: &mut Plane, pole: f64) {
    let height = plane.height();
    let tail = || (1..=REACH).map(|k| (mirror(k as isize, height), pole.powi(k as i32)));
    let own: f64 = tail().filter(|(source, _)| *source == 0).map(|(_, factor)| factor).sum();
    plane.row_mut(0).iter_mut().for_each(|value| *value *= 1.0 + own as f32);
    for (source, factor) in tail().filter(|(source, _)| *source != 0) {
        plane.add_row(0, source, factor as f32);
    }
}

/// Last anticausal value of a mirrored column.
fn start_anticausal(plane: &mut Plane, pole: f64) {
    let last = plane.height() - 1;
    plane.add_row(last, last - 1, pole as f32);
    let factor = (pole / (pole * pole - 1.0)) as f32;
    plane.row_mut(last).iter_mut().for_each(|value| *value *= factor);
}

/// The value at (x, y) px, which lies in the image or a few pixels off it.
#[inline(always)]
pub(super) fn sample_inside(coefficients: &Plane, x: f64, y: f64) -> f32 {
    let (cell_x, cell_y) = (x.floor(), y.floor());
    let (weights_x, weights_y) = (weights((x - cell_x) as f32), weights((y - cell_y) as f32));
    let first = coefficients.index(cell_x as isize - 2, cell_y as isize - 2);
    let (data, stride) = (coefficients.data(), coefficients.stride());
    let mut sum = 0.0;
    for (row, weight) in weights_y.iter().enumerate() {
        let taps = &data[first + row * stride..first + row * stride + 6];
        sum += weight * taps.iter().zip(&weights_x).map(|(c, w)| c * w).sum::<f32>();
    }
    sum
}

const _: () = assert!(MARGIN >= 12, "the six taps, one cell of widening and eight lanes need room");

#[cfg(test)]
mod tests {
    use super::*;

    fn noise_plane(width: usize, height: usize) -> Plane {
        let mut plane = Plane::default();
        plane.reshape(width, height);
        let mut state = 12_345_u32;
        for y in 0..height {
            for value in plane.row_mut(y) {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                *value = (state >> 24) as f32 - 128.0;
            }
        }
        plane
    }

    /// The quintic B-spline at whole pixels is 1, 26, 66, 26, 1 over 120.
    #[test]
    fn coefficients_weighted_with_the_b_spline_give_the_pixels_back_at_every_size() {
        for (width, height) in [(1, 1), (2, 3), (3, 2), (5, 40), (64, 33)] {
            let original = noise_plane(width, height);
            let mut filtered = original.clone();
            prefilter(&mut filtered, &mut vec![f32::NAN; 7]);
            let weights = [1.0, 26.0, 66.0, 26.0, 1.0];
            for y in 0..height {
                for x in 0..width {
                    let mut sum = 0.0;
                    for (j, wy) in weights.iter().enumerate() {
                        for (i, wx) in weights.iter().enumerate() {
                            let index = filtered.index(x as isize + i as isize - 2, y as isize + j as isize - 2);
                            sum += wx * wy / 14_400.0 * filtered.data()[index];
                        }
                    }
                    let error = (sum - original.row(y)[x]).abs();
                    assert!(error < 0.02, "{width} x {height} at {x}, {y}: off by {error}");
                }
            }
        }
    }

    #[test]
    fn the_weights_sum_to_one_and_mirror() {
        for step in 0..=100 {
            let t = step as f32 / 100.0;
            let (forward, mut backward) = (weights(t), weights(1.0 - t));
            backward.reverse();
            let sum: f32 = forward.iter().sum();
            assert!((sum - 1.0).abs() < 1e-6, "{t}: {sum}");
            assert!(forward.iter().zip(&backward).all(|(a, b)| (a - b).abs() < 1e-6), "{t}");
        }
    }

    /// Prefilter and kernel together delay a wave by exactly `t`: that is what keeps the bias small.
    #[test]
    fn waves_longer_than_six_pixels_are_shifted_to_within_0_0003_px() {
        for step in 0..=20 {
            let t = f64::from(step) / 20.0;
            let weights = weights(t as f32);
            for frequency in [0.2_f64, 0.5, 0.8, 1.0] {
                let (re, im) = weights.iter().enumerate().fold((0.0, 0.0), |(re, im), (tap, weight)| {
                    let phase = frequency * (tap as f64 - 2.0);
                    (re + f64::from(*weight) * phase.cos(), im + f64::from(*weight) * phase.sin())
                });
                let shift = im.atan2(re) / frequency;
                assert!((shift - t).abs() < 3e-4, "t {t}, {frequency} rad/px: {shift}");
            }
        }
    }
}
