//! What of a still picture is the sensor's own.

use super::region::{Region, Stack, quantile};

/// Fourth differences, taken along x and y: they leave nothing of light that bends no more than cubic, and little of what
/// a lens can show.
const FOURTH: [f64; 5] = [1.0, -4.0, 6.0, -4.0, 1.0];
/// By how much they are larger than what pixels differ by: the sum of their squares along either, once for both.
const GAIN: f64 = 70.0;
/// Pixels around one that are looked at.
const REACH: usize = 2;
/// Share of the places that are looked at, the flattest: rendered speckles through lenses that blur by 0.5 to 1 px leave
/// 0.3 DN at most there.
const FLAT_SHARE: f64 = 0.03;
/// Fewest places.
const LEAST_PLACES: usize = 1000;
/// Standard deviations in a median of sizes.
const FROM_MEDIAN: f64 = 1.4826;

/// What the sensor adds to every picture alike.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fixed {
    /// Standard deviation of the pixels' own differences from one another, DN.
    pub(super) dn: f64,
    /// Root mean square of the slope of the grey level along x and y, DN/px.
    pub(super) slope_dn_px: f64,
}

impl Fixed {
    /// By which share at most steps over subsets come out too short while they are shorter than a pixel: where light is
    /// flattest it is often brightest, and gains differ by more there.
    ///
    /// The pattern does not move. In the least squares of a match it speaks for no step by its own slope squared, about its
    /// spread, as the speckles do for theirs by their slope.
    pub(super) fn short(&self) -> f64 {
        (self.dn / self.slope_dn_px).powi(2)
    }
}

/// Standard deviation of the pixels' own differences from one another, which stay, DN; `None` of a scene that moves or
/// of which too little is seen.
///
/// Neighbouring pixels differ by it where what the lens shows does not: it is read where the light is flattest.
pub(super) fn fixed_dn(stack: &Stack, region: &Region, noise_dn: Option<f64>, full_dn: f64) -> Option<f64> {
    let data = stack.mean.view().data();
    let seen = |at: usize| region.mask[at] && f64::from(stack.highest[at]) < full_dn && stack.lowest[at] > 0.0;
    let whole = |at: usize| around(at, region.width).all(seen);
    let rows = REACH..region.height.saturating_sub(REACH);
    let places = rows.flat_map(|y| (REACH..region.width.saturating_sub(REACH)).map(move |x| y * region.width + x));
    let told: Vec<[f32; 2]> = places.filter(|at| whole(*at)).map(|at| tell(data, at, region.width)).collect();
    if told.len() < LEAST_PLACES {
        return None;
    }
    let flat = quantile(&mut told.iter().map(|[bend, _]| *bend).collect::<Vec<_>>(), FLAT_SHARE) as f32;
    let mut sizes: Vec<f32> = told.iter().filter(|[bend, _]| *bend <= flat).map(|[_, size]| *size).collect();
    let spread_dn = FROM_MEDIAN * quantile(&mut sizes, 0.5) / GAIN;
    Some((spread_dn.powi(2) - noise_dn?.powi(2) / stack.frames as f64).max(0.0).sqrt())
}

fn around(at: usize, width: usize) -> impl Iterator<Item = usize> {
    let first = at - REACH * width - REACH;
    (0..=2 * REACH).flat_map(move |y| (0..=2 * REACH).map(move |x| first + y * width + x))
}

/// How uneven and bent the light is about a pixel, and the size of the fourth differences there.
fn tell(data: &[f32], at: usize, width: usize) -> [f32; 2] {
    let (mut terms, mut fourth) = ([0.0_f64; 5], 0.0);
    for (k, near) in around(at, width).enumerate() {
        let (column, row) = (k % FOURTH.len(), k / FOURTH.len());
        let (x, y) = (column as f64 - REACH as f64, row as f64 - REACH as f64);
        let level = f64::from(data[near]);
        // Legendre's polynomials over five points, each over the root of the sum of its squares.
        let bent = |x: f64| (x * x - 2.0) / 70.0_f64.sqrt();
        let shapes = [x / 50.0_f64.sqrt(), y / 50.0_f64.sqrt(), bent(x), bent(y), x * y / 10.0];
        terms.iter_mut().zip(shapes).for_each(|(term, shape)| *term += shape * level);
        fourth += FOURTH[column] * FOURTH[row] * level;
    }
    [terms.iter().map(|term| term * term).sum::<f64>() as f32, fourth.abs() as f32]
}
