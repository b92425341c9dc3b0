//! Grey levels, sharpness and speckles of a static image.

use super::region::{Region, Stack, quantile};
use crate::numeric::otsu;

/// Shift, relative to its diameter, at which a disc overlaps itself by one half.
const HALF_OVERLAP: f64 = 0.404;
/// Quantile of the gradient that selects edges.
const STEEP_SHARE: f64 = 0.98;
/// Half width of the window for the height of an edge, px.
const SIDE_PX: usize = 3;
/// Range of the blur estimate, standard deviation, px.
const BLUR_PX: [f64; 2] = [0.3, 5.0];

/// Grey levels within a region.
#[derive(Debug, Clone, Copy)]
pub(super) struct Levels {
    /// The 1 % and 99 % quantiles, DN.
    pub(super) low_dn: f64,
    pub(super) high_dn: f64,
    /// Fraction of pixels at the maximum level in some frame.
    pub(super) saturated: f64,
    /// Fraction of pixels at 0 in some frame.
    pub(super) black: f64,
    /// Root mean square of the temporal noise, DN; `None` for a moving scene.
    pub(super) noise_dn: Option<f64>,
}

/// Measures range, clipping and temporal noise of the grey levels; `full_dn` is full scale, DN.
pub(super) fn measure_levels(stack: &Stack, region: &Region, full_dn: f64) -> Levels {
    let mut means: Vec<f32> = region.values(stack.mean.view().data()).collect();
    let count = means.len().max(1) as f64;
    let share =
        |data: &[f32], is: &dyn Fn(f32) -> bool| region.values(data).filter(|value| is(*value)).count() as f64 / count;
    let squares: Vec<f64> = if stack.noise.is_empty() {
        Vec::new()
    } else {
        // Clipped pixels have lost their noise.
        let clipped = |at: usize| f64::from(stack.highest[at]) >= full_dn || stack.lowest[at] <= 0.0;
        let inside = (0..region.mask.len()).filter(|at| region.mask[*at] && !clipped(*at));
        inside.map(|at| f64::from(stack.noise[at]).powi(2)).collect()
    };
    Levels {
        low_dn: quantile(&mut means, 0.01),
        high_dn: quantile(&mut means, 0.99),
        saturated: share(&stack.highest, &|value| f64::from(value) >= full_dn),
        black: share(&stack.lowest, &|value| value <= 0.0),
        noise_dn: (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()),
    }
}

/// Returns the root mean square of the image gradient along x and y, DN/px.
///
/// The part that noise of the standard deviation `noise_dn` in each frame adds to it is subtracted.
pub(super) fn slope_dn_px(stack: &Stack, region: &Region, noise_dn: f64) -> f64 {
    let data = stack.mean.view().data();
    let (mut sum, mut count) = (0.0, 0.0);
    for at in region.inner_pixels() {
        let (x, y) = central_differences(data, at, region.width);
        sum += (x * x + y * y) / 2.0;
        count += 1.0;
    }
    // The remaining noise of the mean image adds to the gradient.
    let of_noise = noise_dn * noise_dn / stack.frames as f64 / 2.0;
    (sum / f64::max(count, 1.0) - of_noise).max(0.0).sqrt()
}

/// Returns the image gradient along x and y by central differences, DN/px. `at` is the index of a pixel inside the
/// border.
fn central_differences(data: &[f32], at: usize, width: usize) -> (f64, f64) {
    let half = |after: f32, before: f32| 0.5 * f64::from(after - before);
    (half(data[at + 1], data[at - 1]), half(data[at + width], data[at - width]))
}

/// Returns the blur of the sharpest edges as the standard deviation of a Gaussian, px; `None` without edges.
///
/// Uses the slope at the centre of a blurred step, relative to its height.
pub(super) fn edge_blur_px(stack: &Stack, region: &Region) -> Option<f64> {
    let data = stack.mean.view().data();
    let steep: Vec<(usize, f64)> = region
        .inner_pixels()
        .map(|at| {
            let (x, y) = central_differences(data, at, region.width);
            (at, x.hypot(y))
        })
        .collect();
    let mut all: Vec<f32> = steep.iter().map(|(_, slope)| *slope as f32).collect();
    let min_slope = quantile(&mut all, STEEP_SHARE);
    let mut blurs: Vec<f32> = steep
        .iter()
        .filter(|(_, slope)| *slope >= min_slope && *slope > 0.0)
        .map(|(at, slope)| blur_of_step_px(slope / edge_height_dn(data, *at, region)) as f32)
        .collect();
    (!blurs.is_empty()).then(|| quantile(&mut blurs, 0.5))
}

/// Returns the range of the grey levels within [`SIDE_PX`] of the pixel `at` on an edge, DN; above 0.
fn edge_height_dn(data: &[f32], at: usize, region: &Region) -> f64 {
    let (x, y) = (at % region.width, at / region.width);
    let columns = x.saturating_sub(SIDE_PX)..(x + SIDE_PX + 1).min(region.width);
    let rows = y.saturating_sub(SIDE_PX)..(y + SIDE_PX + 1).min(region.height);
    let near = || rows.clone().flat_map(|y| &data[y * region.width..][columns.clone()]);
    let (low, high) = near().fold((f32::INFINITY, 0.0_f32), |(low, high), v| (low.min(*v), high.max(*v)));
    f64::from(high - low).max(f64::MIN_POSITIVE)
}

/// Returns the standard deviation of the Gaussian that blurs a unit step to this slope in central differences, px,
/// within [`BLUR_PX`].
///
/// Solves `erf(1 / (sigma sqrt 2)) / 2 = slope` for sigma by bisection.
fn blur_of_step_px(relative_slope: f64) -> f64 {
    let [mut low, mut high] = BLUR_PX;
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if 0.5 * libm::erf(1.0 / (middle * std::f64::consts::SQRT_2)) > relative_slope {
            low = middle
        } else {
            high = middle
        }
    }
    0.5 * (low + high)
}

/// Speckles within a region.
#[derive(Debug, Clone, Copy)]
pub(super) struct Speckles {
    /// Diameter of discs with the same autocorrelation width, px; `None` without a pattern.
    pub(super) size_px: Option<f64>,
    /// Fraction of the area covered by the rarer of dark and bright.
    pub(super) coverage: f64,
}

/// Measures size and density of the speckles from the autocorrelation up to `reach_px`.
///
/// The size follows from the lag at which the autocorrelation falls to one half, interpolated linearly. Its mean beyond
/// half of `reach_px` counts as 0, and noise of the standard deviation `noise_dn` is taken out of its peak.
pub(super) fn measure_speckles(stack: &Stack, region: &Region, noise_dn: f64, reach_px: usize) -> Speckles {
    let data = stack.mean.view().data();
    let values: Vec<f32> = region.values(data).collect();
    let middle = speckle_threshold_dn(&values);
    let bright = values.iter().filter(|value| **value > middle).count() as f64 / values.len().max(1) as f64;
    let mean = values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len().max(1) as f64;
    let covariances: Vec<f64> = (0..=reach_px).map(|lag| covariance(data, region, mean, lag)).collect();
    let floor_from = reach_px / 2;
    let floor = covariances[floor_from..].iter().sum::<f64>() / (covariances.len() - floor_from) as f64;
    let whole = covariances[0] - noise_dn * noise_dn / stack.frames as f64 - floor;
    let above_half = |lag: usize| (covariances[lag] - floor) / whole - 0.5;
    let crossing = (1..=floor_from).find(|lag| above_half(*lag) <= 0.0).filter(|_| whole > 0.0);
    let size = crossing.map(|lag| {
        let before = if lag == 1 { 0.5 } else { above_half(lag - 1) };
        (lag as f64 - 1.0 + before / (before - above_half(lag))) / HALF_OVERLAP
    });
    Speckles { size_px: size, coverage: bright.min(1.0 - bright) }
}

/// Computes the autocovariance of the grey levels at a lag of whole pixels, pooled over x and y, DN^2.
fn covariance(data: &[f32], region: &Region, mean: f64, lag: usize) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for y in 0..region.height {
        for x in 0..region.width {
            let at = y * region.width + x;
            if !region.mask[at] {
                continue;
            }
            let own = f64::from(data[at]) - mean;
            for (fits, other) in
                [(x + lag < region.width, at + lag), (y + lag < region.height, at + lag * region.width)]
            {
                if fits && region.mask[other] {
                    sum += own * (f64::from(data[other]) - mean);
                    count += 1.0;
                }
            }
        }
    }
    sum / f64::max(count, 1.0)
}

/// Returns the threshold between dark and bright by Otsu's method over 256 steps of the range of the values, DN.
fn speckle_threshold_dn(values: &[f32]) -> f32 {
    let (low, high) = values.iter().fold((f32::INFINITY, 0.0_f32), |(low, high), v| (low.min(*v), high.max(*v)));
    if high <= low {
        return high;
    }
    let mut counts = [0_u32; 256];
    values.iter().for_each(|value| counts[(255.0 * (value - low) / (high - low)) as usize] += 1);
    low + (high - low) * otsu(&counts) as f32 / 256.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blur_is_read_from_the_slope_of_its_step() {
        for blur in [0.5, 1.0, 2.5] {
            let share = 0.5 * libm::erf(1.0 / (blur * std::f64::consts::SQRT_2));
            assert!((blur_of_step_px(share) - blur).abs() < 1e-3, "{blur}");
        }
    }

    #[test]
    fn dark_and_bright_are_parted_between_them() {
        let values: Vec<f32> = (0..100).map(|k| if k % 4 == 0 { 20.0 } else { 200.0 }).collect();
        let middle = speckle_threshold_dn(&values);
        assert!((20.0..200.0).contains(&middle), "{middle}");
    }
}
