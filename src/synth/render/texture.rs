//! Smooth random textures of the static background.

use crate::numeric::Stream;

/// Returns noise of mean 0 and standard deviation 1, smoothed by a Gaussian of `sigma_px` along x and y, row-major.
///
/// The texture wraps around at the edges of the image.
pub(crate) fn smooth_noise(width: usize, height: usize, sigma_px: [f64; 2], mut stream: Stream) -> Vec<f32> {
    let white: Vec<f64> = (0..width * height).map(|_| stream.normal()).collect();
    let along = gaussian_weights(sigma_px[0]);
    let down = gaussian_weights(sigma_px[1]);
    let rows: Vec<f64> = (0..width * height)
        .map(|index| {
            let (row, column) = (index / width, index % width);
            weighted_sum_at(&along, column, width, |place| white[row * width + place])
        })
        .collect();
    let smoothed: Vec<f64> = (0..width * height)
        .map(|index| {
            let (row, column) = (index / width, index % width);
            weighted_sum_at(&down, row, height, |place| rows[place * width + column])
        })
        .collect();
    let power = |weights: &[f64]| weights.iter().map(|weight| weight * weight).sum::<f64>();
    let scale = 1.0 / (power(&along) * power(&down)).sqrt();
    smoothed.into_iter().map(|value| (value * scale) as f32).collect()
}

/// Returns the weights of a Gaussian out to 3 standard deviations, with sum 1.
fn gaussian_weights(sigma_px: f64) -> Vec<f64> {
    let reach = (3.0 * sigma_px).ceil() as i32;
    let weights: Vec<f64> = (-reach..=reach).map(|step| (-0.5 * (f64::from(step) / sigma_px).powi(2)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    weights.into_iter().map(|weight| weight / sum).collect()
}

/// Returns the sum of the values around index `middle`, with the middle one of the `weights` on it. The row of `length`
/// values wraps around.
fn weighted_sum_at(weights: &[f64], middle: usize, length: usize, value: impl Fn(usize) -> f64) -> f64 {
    let start = middle + length * (1 + weights.len() / length) - weights.len() / 2;
    weights.iter().enumerate().map(|(step, weight)| weight * value((start + step) % length)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_texture_has_mean_0_and_standard_deviation_1() {
        let values = smooth_noise(200, 150, [2.0, 1.5], Stream::new(3));
        let count = values.len() as f64;
        let mean = values.iter().copied().map(f64::from).sum::<f64>() / count;
        let power = values.iter().map(|value| f64::from(*value).powi(2)).sum::<f64>() / count;
        assert!(mean.abs() < 0.1, "{mean}");
        assert!((power.sqrt() - 1.0).abs() < 0.1, "{power}");
    }
}
