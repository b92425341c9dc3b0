//! Eight pixels of the warped target at a time.

use super::lanes::{LANES, Lanes};
use super::plane::Plane;
use super::spline::{sample_inside, weights};

/// The target at (x + lane (1 + ux), y + lane vx) for the eight lanes.
///
/// Neighbouring pixels of a mildly deformed subset read neighbouring cells: each
/// lane lies in the cell next to its left neighbour's, or one further along x or
/// y. So one contiguous load per tap serves all lanes; lanes one cell further
/// get their weights shifted by one tap. Stronger deformation (8 degrees and
/// more) is sampled lane by lane.
#[inline(always)]
pub(super) fn sample_lanes(coefficients: &Plane, (x, y): (f64, f64), ux: f64, vx: f64) -> Lanes {
    let last = (LANES - 1) as f64;
    if (last * ux).abs() >= 1.0 || (last * vx).abs() >= 1.0 {
        return Lanes(std::array::from_fn(|lane| {
            sample_inside(coefficients, x + lane as f64 * (1.0 + ux), y + lane as f64 * vx)
        }));
    }
    let (cell_x, cell_y) = (x.min(x + last * ux).floor(), y.min(y + last * vx).floor());
    let (start_x, start_y) = ((x - cell_x) as f32, (y - cell_y) as f32);
    let (drift_x, drift_y) = (ux as f32, vx as f32);
    let along_x = Lanes(std::array::from_fn(|lane| start_x + lane as f32 * drift_x));
    let along_y = Lanes(std::array::from_fn(|lane| start_y + lane as f32 * drift_y));
    let taps = Taps { coefficients, first: coefficients.index(cell_x as isize - 2, cell_y as isize - 2) };
    let wide_x = along_x.0[0].max(along_x.0[LANES - 1]) >= 1.0;
    let wide_y = along_y.0[0].max(along_y.0[LANES - 1]) >= 1.0;
    match (wide_x, wide_y) {
        (false, false) => taps.sum(&plain(along_x), &plain(along_y)),
        (false, true) => taps.sum(&plain(along_x), &widened(along_y)),
        (true, false) => taps.sum(&widened(along_x), &plain(along_y)),
        (true, true) => taps.sum(&widened(along_x), &widened(along_y)),
    }
}

/// Where the taps of a block of lanes begin.
struct Taps<'a> {
    coefficients: &'a Plane,
    first: usize,
}

impl Taps<'_> {
    /// Sum of the taps with the weights of each lane.
    #[inline(always)]
    fn sum<const X: usize, const Y: usize>(&self, weights_x: &[Lanes; X], weights_y: &[Lanes; Y]) -> Lanes {
        let (data, stride) = (self.coefficients.data(), self.coefficients.stride());
        let mut total = Lanes::splat(0.0);
        for (row, weight) in weights_y.iter().enumerate() {
            let taps = &data[self.first + row * stride..self.first + row * stride + 2 * LANES];
            let mut sum = weights_x[0] * Lanes::load(taps);
            for (column, weight) in weights_x.iter().enumerate().skip(1) {
                sum += *weight * Lanes::load(&taps[column..]);
            }
            total += *weight * sum;
        }
        total
    }
}

/// Weights of the six taps when all lanes lie in the first cell.
#[inline(always)]
fn plain(fraction: Lanes) -> [Lanes; 6] {
    let mut taps = [Lanes::splat(0.0); 6];
    for lane in 0..LANES {
        let weights = weights(fraction.0[lane]);
        for tap in 0..6 {
            taps[tap].0[lane] = weights[tap];
        }
    }
    taps
}

/// Weights of seven taps when some lanes lie in the second cell.
#[inline(always)]
fn widened(fraction: Lanes) -> [Lanes; 7] {
    let second = fraction.at_least_one();
    let six = plain(fraction - second);
    let none = Lanes::splat(0.0);
    std::array::from_fn(|tap| {
        let low = if tap < 6 { six[tap] } else { none };
        let high = if tap > 0 { six[tap - 1] } else { none };
        second.select(high, low)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dic::spline::prefilter;

    #[test]
    fn eight_at_a_time_equals_one_at_a_time_at_any_deformation() {
        let mut plane = Plane::default();
        plane.reshape(60, 50);
        for y in 0..50 {
            for (x, value) in plane.row_mut(y).iter_mut().enumerate() {
                *value =
                    100.0 * ((x * x) as f32 * 0.02 + y as f32).sin() + 80.0 * (x as f32 * 1.1 - y as f32 * 0.4).cos();
            }
        }
        prefilter(&mut plane, &mut Vec::new());
        for case in 0..400 {
            let (ux, vx) = (f64::from(case % 20 - 10) * 0.017, f64::from(case / 20 - 10) * 0.016);
            let at = (20.0 + f64::from(case) * 0.013, 22.0 - f64::from(case) * 0.017);
            let found = sample_lanes(&plane, at, ux, vx);
            for lane in 0..LANES {
                let offset = lane as f64;
                let expected = sample_inside(&plane, at.0 + offset * (1.0 + ux), at.1 + offset * vx);
                assert!((found.0[lane] - expected).abs() < 2e-3, "{ux} {vx} {at:?} lane {lane}");
            }
        }
    }
}
