//! The fixed-pattern noise of the sensor, estimated from static frames.

use super::region::{Region, Stack, quantile};
use crate::numeric::SIGMA_PER_MEDIAN;

/// Coefficients of the fourth difference along x and y. It cancels illumination up to cubic order and leaves little
/// of what a lens can image.
const FOURTH: [f64; 5] = [1.0, -4.0, 6.0, -4.0, 1.0];
/// Sum of the squared coefficients along one axis: the gain of the 2-D filter on pixel noise.
const GAIN: f64 = 70.0;
/// Half width of the filter, px.
const REACH: usize = 2;
/// Fraction of the positions that are used, the flattest. Rendered speckles with a lens blur of 0.5 to 1 px leave at
/// most 0.3 DN there.
const FLAT_SHARE: f64 = 0.03;
/// Minimum number of positions.
const MIN_PLACES: usize = 1000;

/// The fixed pattern that the sensor adds to every frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct FixedPattern {
    /// Standard deviation of the pixel-to-pixel differences, DN.
    pub(super) dn: f64,
    /// Root mean square of the image gradient along x and y, DN/px.
    pub(super) slope_dn_px: f64,
}

impl FixedPattern {
    /// Returns the maximum relative underestimate of subpixel displacements of subsets (no unit).
    ///
    /// The flattest parts are often the brightest, where gains differ by more, so this is an upper bound.
    ///
    /// The pattern does not move. In the least squares of a match it pulls towards zero displacement, in the ratio of
    /// its squared gradient, about its variance, to that of the speckles.
    pub(super) fn underestimate_fraction(&self) -> f64 {
        (self.dn / self.slope_dn_px).powi(2)
    }
}

/// Estimates the standard deviation of the constant pixel-to-pixel differences, DN. Returns `None` if the scene moves
/// or too little of it is visible.
///
/// `noise_dn` is the standard deviation of the temporal noise, `None` for a moving scene, and `full_dn` full scale, DN.
/// It is estimated where the image is flattest, so that neighbouring pixels differ by the sensor and not by the scene.
pub(super) fn fixed_pattern_dn(stack: &Stack, region: &Region, noise_dn: Option<f64>, full_dn: f64) -> Option<f64> {
    let data = stack.mean.view().data();
    let seen = |at: usize| region.mask[at] && f64::from(stack.highest[at]) < full_dn && stack.lowest[at] > 0.0;
    let whole = |at: usize| window_indices(at, region.width).all(seen);
    let rows = REACH..region.height.saturating_sub(REACH);
    let places = rows.flat_map(|y| (REACH..region.width.saturating_sub(REACH)).map(move |x| y * region.width + x));
    let residuals: Vec<[f32; 2]> =
        places.filter(|at| whole(*at)).map(|at| unevenness_and_residual(data, at, region.width)).collect();
    if residuals.len() < MIN_PLACES {
        return None;
    }
    let flat = quantile(&mut residuals.iter().map(|[bend, _]| *bend).collect::<Vec<_>>(), FLAT_SHARE) as f32;
    let mut sizes: Vec<f32> = residuals.iter().filter(|[bend, _]| *bend <= flat).map(|[_, size]| *size).collect();
    let spread_dn = SIGMA_PER_MEDIAN * quantile(&mut sizes, 0.5) / GAIN;
    Some((spread_dn.powi(2) - noise_dn?.powi(2) / stack.frames as f64).max(0.0).sqrt())
}

/// Returns the indices of the 5 x 5 pixels around `center`, which is at least [`REACH`] from the edge, row by row.
fn window_indices(center: usize, width: usize) -> impl Iterator<Item = usize> {
    let first = center - REACH * width - REACH;
    (0..=2 * REACH).flat_map(move |y| (0..=2 * REACH).map(move |x| first + y * width + x))
}

/// Returns the unevenness of the 5 x 5 pixels around the pixel `at`, and the magnitude of their fourth difference, DN.
///
/// The unevenness is the sum of the squared coefficients of their slopes, curvatures and twist, DN^2. The fourth
/// difference is [`GAIN`] times as large as the noise of a pixel.
fn unevenness_and_residual(data: &[f32], at: usize, width: usize) -> [f32; 2] {
    let (mut terms, mut fourth) = ([0.0_f64; 5], 0.0);
    for (k, near) in window_indices(at, width).enumerate() {
        let (column, row) = (k % FOURTH.len(), k / FOURTH.len());
        let (x, y) = (column as f64 - REACH as f64, row as f64 - REACH as f64);
        let level = f64::from(data[near]);
        // Legendre polynomials over five points, each normalised by the root of its sum of squares.
        let bent = |x: f64| (x * x - 2.0) / 70.0_f64.sqrt();
        let shapes = [x / 50.0_f64.sqrt(), y / 50.0_f64.sqrt(), bent(x), bent(y), x * y / 10.0];
        terms.iter_mut().zip(shapes).for_each(|(term, shape)| *term += shape * level);
        fourth += FOURTH[column] * FOURTH[row] * level;
    }
    [terms.iter().map(|term| term * term).sum::<f64>() as f32, fourth.abs() as f32]
}
