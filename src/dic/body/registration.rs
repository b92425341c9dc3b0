//! Residuals of registration and interpolation, which are larger at sharp edges than elsewhere.

use multiversion::multiversion;

use super::median_residual::nth_smallest;
use super::visibility::NOISE_SAMPLE_PIXELS;
use crate::numeric::{LANES, Lanes, SIGMA_PER_MEDIAN};

/// The maximum residual per gradient that counts as an error of registration or interpolation, px.
///
/// Sharp print is registered to a few hundredths of a pixel. A larger residual means that something else is there.
const MAX_REGISTRATION_PX: f32 = 0.12;

/// The fraction of pixels with the smallest, and with the largest gradients, that are compared.
const GRADIENT_FRACTION: f64 = 0.3;

/// The minimum number of pixels of each kind that are compared.
const MIN_COMPARED: usize = 20;

/// The factor that exceeds the rounding of [`nth_smallest`].
const ROUNDED_UP: f32 = 1.0005;

/// A sample of the pixels of a body, with infinities at pixels that do not count.
#[derive(Debug, Clone, Default)]
pub(super) struct RegistrationSample {
    /// The squares of the gradients, (DN/px)^2.
    squares: Vec<Lanes>,
    /// The absolute residuals, DN.
    sizes: Vec<Lanes>,
    /// The absolute residuals of one kind of pixel, DN.
    chosen: Vec<Lanes>,
    /// The last limits of the squares of small and large gradients, and the last median residuals of both kinds, which
    /// only speed up the search for the next.
    last_limits: [f32; 2],
    last_medians: [f32; 2],
}

impl RegistrationSample {
    /// Copies the residual of a body to `out` with its errors of registration and interpolation scaled down to the
    /// noise.
    ///
    /// These errors are proportional to the gradient, so a residual is uneven where sharp print stands next to smooth
    /// paper. Their size is estimated from the pixels with the largest gradients among those where `kept` is 1,
    /// relative to those with the smallest. With fewer than [`MIN_COMPARED`] of each, `out` is a plain copy.
    /// `gradients` are those along x and y, DN/px; `min_noise` is the lower limit of the noise, DN.
    pub(super) fn flatten(
        &mut self,
        gradients: [&[Lanes]; 2],
        residual: &[Lanes],
        kept: &[Lanes],
        min_noise: f32,
        out: &mut Vec<Lanes>,
    ) {
        out.clear();
        out.extend_from_slice(residual);
        let squared_ratio = self.squared_ratio(gradients, residual, kept, min_noise);
        if squared_ratio > 0.0 {
            scale_down(out, gradients, squared_ratio);
        }
    }

    /// Returns the square of the error of registration relative to the noise, px^2/DN^2.
    fn squared_ratio(&mut self, gradients: [&[Lanes]; 2], residual: &[Lanes], kept: &[Lanes], min_noise: f32) -> f32 {
        let pixels = self.draw(gradients, residual, kept);
        let count = (GRADIENT_FRACTION * pixels as f64) as usize;
        if count < MIN_COMPARED {
            return 0.0;
        }
        for (limit, rank) in self.last_limits.iter_mut().zip([count, pixels - count]) {
            *limit = nth_smallest(&self.squares, rank, *limit);
        }
        let [smooth_limit, sharp_limit] = self.last_limits;
        // The limits are rounded down; equal gradients, such as those of even paper, count together.
        let smooth_limit = smooth_limit * ROUNDED_UP;
        let noise = self.sigma(0, |square| square <= smooth_limit).max(min_noise);
        let sharp = self.sigma(1, |square| square >= sharp_limit && square < f32::INFINITY);
        let excess = (sharp * sharp - noise * noise).max(0.0) / self.mean_square(sharp_limit).max(f32::MIN_POSITIVE);
        excess.min(MAX_REGISTRATION_PX.powi(2)) / (noise * noise)
    }

    /// Draws the sample from the pixels where `kept` is 1, and returns their number.
    fn draw(&mut self, [along_x, along_y]: [&[Lanes]; 2], residual: &[Lanes], kept: &[Lanes]) -> usize {
        self.squares.clear();
        self.sizes.clear();
        let mut pixels = 0.0;
        let step = (residual.len() * LANES / NOISE_SAMPLE_PIXELS).max(1);
        for row in (0..residual.len()).step_by(step) {
            let (x, y, kept) = (&along_x[row], &along_y[row], &kept[row]);
            let counted = |lane: usize, value: f32| if kept.0[lane] > 0.5 { value } else { f32::INFINITY };
            self.squares
                .push(Lanes(std::array::from_fn(|lane| counted(lane, x.0[lane] * x.0[lane] + y.0[lane] * y.0[lane]))));
            self.sizes.push(Lanes(std::array::from_fn(|lane| counted(lane, residual[row].0[lane].abs()))));
            pixels += kept.sum();
        }
        pixels as usize
    }

    /// Returns the standard deviation of the residuals of the pixels of a kind, whose squared gradients are `chosen`, DN;
    /// 0 without such a pixel.
    fn sigma(&mut self, kind: usize, chosen: impl Fn(f32) -> bool) -> f32 {
        self.chosen.clear();
        let mut pixels = 0;
        for (squares, sizes) in self.squares.iter().zip(&self.sizes) {
            self.chosen.push(Lanes(std::array::from_fn(|lane| {
                let is_chosen = chosen(squares.0[lane]);
                pixels += usize::from(is_chosen);
                if is_chosen { sizes.0[lane] } else { f32::INFINITY }
            })));
        }
        if pixels == 0 {
            return 0.0;
        }
        let median = &mut self.last_medians[kind];
        *median = nth_smallest(&self.chosen, pixels / 2, *median);
        SIGMA_PER_MEDIAN as f32 * *median
    }

    /// Returns the mean of the squared gradients from `limit` up, (DN/px)^2; 0 without one.
    fn mean_square(&self, limit: f32) -> f32 {
        let (mut sum, mut pixels) = (0.0, 0.0);
        for square in self.squares.iter().flat_map(|row| row.0) {
            let is_chosen = square >= limit && square < f32::INFINITY;
            sum += if is_chosen { square } else { 0.0 };
            pixels += if is_chosen { 1.0 } else { 0.0 };
        }
        if pixels > 0.0 { sum / pixels } else { 0.0 }
    }
}

/// Divides each residual by the standard deviation that its gradient explains, relative to the noise.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn scale_down(residual: &mut [Lanes], gradients: [&[Lanes]; 2], squared_ratio: f32) {
    let [along_x, along_y] = gradients;
    for (residual, (x, y)) in residual.iter_mut().zip(along_x.iter().zip(along_y)) {
        for lane in 0..LANES {
            let square = x.0[lane] * x.0[lane] + y.0[lane] * y.0[lane];
            residual.0[lane] /= (1.0 + squared_ratio * square).sqrt();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::Stream;

    /// Whether the pixels of a row stand at sharp print.
    fn is_sharp(row: usize) -> bool {
        row % 32 < 16
    }

    /// The residual of a body: noise of 2 DN, and an error of registration where the gradient is large.
    fn uneven(registration_px: f32) -> ([Vec<Lanes>; 2], Vec<Lanes>) {
        let mut random = Stream::new(7);
        let mut noise = || random.normal() as f32;
        let (mut along_x, mut residual) = (Vec::new(), Vec::new());
        for row in 0..512 {
            let gradient = if is_sharp(row) { 60.0 } else { 0.5 };
            along_x.push(Lanes::splat(gradient));
            residual.push(Lanes(std::array::from_fn(|_| 2.0 * noise() + registration_px * gradient * noise())));
        }
        let along_y = vec![Lanes::splat(0.0); along_x.len()];
        ([along_x, along_y], residual)
    }

    fn rms(rows: &[Lanes], of_sharp: bool) -> f32 {
        let chosen = (0..rows.len()).filter(|row| is_sharp(*row) == of_sharp);
        let values: Vec<f32> = chosen.flat_map(|row| rows[row].0).collect();
        (values.iter().map(|value| value * value).sum::<f32>() / values.len() as f32).sqrt()
    }

    fn flattened(registration_px: f32) -> Vec<Lanes> {
        let ([x, y], residual) = uneven(registration_px);
        let (kept, mut out) = (vec![Lanes::splat(1.0); residual.len()], Vec::new());
        RegistrationSample::default().flatten([&x, &y], &residual, &kept, 0.45, &mut out);
        out
    }

    #[test]
    fn errors_of_registration_are_scaled_down_to_the_noise() {
        for registration_px in [0.0, 0.03, 0.1] {
            let out = flattened(registration_px);
            let (sharp, smooth) = (rms(&out, true), rms(&out, false));
            assert!((sharp / smooth - 1.0).abs() < 0.1, "{registration_px} px: {sharp} and {smooth} DN");
        }
    }

    #[test]
    fn a_larger_residual_is_no_error_of_registration() {
        let out = flattened(0.5);
        assert!(rms(&out, true) > 3.0 * rms(&out, false));
    }

    #[test]
    fn pixels_that_are_not_kept_do_not_count() {
        let ([x, y], mut residual) = uneven(0.0);
        let mut kept = vec![Lanes::splat(1.0); residual.len()];
        for row in (0..residual.len()).step_by(4) {
            (residual[row], kept[row]) = (Lanes::splat(90.0), Lanes::splat(0.0));
        }
        let mut out = Vec::new();
        RegistrationSample::default().flatten([&x, &y], &residual, &kept, 0.45, &mut out);
        assert!(out[0].0[0] > 80.0, "{}", out[0].0[0]);
    }
}
