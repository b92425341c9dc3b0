//! The outline of a ball of known size whose contrast to the ground is faint, or changes its sign along the rim.
//!
//! Along each piece of the rim, the difference from the background rises from zero to a contrast of its own. All pieces
//! share one circle, so that each weighs by its contrast, and one without contrast does not weigh at all.

use nalgebra::{DMatrix, DVector};

use super::changed_disc::{ChangedDisc, Disc, MIN_SIGMA_PX, WantedRadius, change_gain, most_changed};
use super::foreground::ChangedPart;
use super::visible_fraction::fraction_in_image;
use crate::image::ImageView;
use crate::numeric::{SIGMA_PER_MEDIAN, median};
use crate::results::Circle;

/// The length of a piece of the rim, px, and the limits of their number.
const PIECE_PX: f64 = 4.7;
const PIECES: [usize; 2] = [8, 24];
/// The width of the fitted ring inside and outside the circle, px. Further inside, highlights and marks differ from the rim.
const RING_PX: [f64; 2] = [1.6, 2.5];
/// The steepness of the rim, per px: half of `1 + tanh(RIM_SLOPE d)` at a distance d inside the circle.
const RIM_SLOPE: f64 = 2.0;
/// The maximum difference from the background that is fitted, in medians of its absolute value inside the ball.
const MAX_DIFFERENCE: f32 = 1.3;
/// The fraction of the radius within which that median is taken.
const CORE: f64 = 0.75;
/// The prior information about a contrast, and about its change with the depth, relative to that of a pixel.
const CONTRAST_INFORMATION: f64 = 0.05;
const SLOPE_INFORMATION: f64 = 5.0;
/// The number of Gauss-Newton steps, and their maximum length, px.
const STEPS: usize = 12;
const MAX_STEP_PX: f64 = 0.5;
/// The information that damps a step, px^-2.
const DAMPING: f64 = 1.0;
/// The residual from which a pixel weighs less, in standard deviations.
const HUBER_SIGMAS: f64 = 2.5;
/// The minimum fraction of pieces with contrast, and that contrast in its standard deviations.
const MIN_VISIBLE: f64 = 0.5;
const MIN_CONTRAST_SIGMAS: f64 = 4.0;
/// The distance outside the circle from which nothing may have changed, px, and the fraction of pixels that may have.
const CLEARANCE_PX: f64 = 1.2;
const MAX_CHANGED_OUTSIDE: f64 = 0.12;
/// The difference that counts as a change, in standard deviations of the noise.
const CHANGE_SIGMAS: f64 = 4.0;
/// The maximum scatter of the residuals, in standard deviations of the noise.
const MAX_SCATTER: f64 = 2.5;
/// The number of neighbouring pixels that share their errors.
const DEPENDENT_PIXELS: f64 = 2.0;
/// The number of sectors that are left out in turn.
const SECTORS: usize = 6;
/// The maximum uncertainty of the centre: in px, and in radii.
const MAX_SIGMA_PX: f64 = 1.0;
const MAX_SIGMA_RADII: f64 = 0.12;
/// The maximum distance between the disc that covers what has changed and the circle: in px, and in radii.
const MAX_APART_PX: f64 = 1.2;
const MAX_APART_RADII: f64 = 0.1;

/// A pixel near the rim.
#[derive(Debug, Clone, Copy)]
struct RimPixel {
    x: f64,
    y: f64,
    /// The difference from the background, DN.
    difference: f64,
    /// The two pieces of the rim next to it, and the weight of the second.
    pieces: [usize; 2],
    fraction: f64,
}

/// The fit of a circle and of the contrasts along its rim to the pixels near it.
#[derive(Debug)]
struct RimFit {
    disc: Disc,
    /// The contrast of each piece, DN, then its change with the depth, DN/px.
    contrasts: DVector<f64>,
    /// The standard deviation of the residuals, DN.
    scatter_dn: f64,
    /// The normal matrix of the last step: x, y, radius and the contrasts.
    normal: DMatrix<f64>,
}

/// The pixels around a circle that are fitted.
#[derive(Debug)]
struct Ring {
    pixels: Vec<RimPixel>,
    pieces: usize,
}

impl Ring {
    /// Collects the pixels around a circle, as far as a fit may move it.
    fn around(difference: ImageView<'_>, disc: Disc, max_dn: f64) -> Self {
        let pieces = ((std::f64::consts::TAU * disc.radius / PIECE_PX) as usize).clamp(PIECES[0], PIECES[1]);
        let reach = disc.radius + RING_PX[1] + max_apart_px(disc) + 1.0;
        let range = |center: f64, side: usize| {
            let last = ((center + reach).ceil().max(0.0) as usize).min(side.saturating_sub(1));
            (center - reach).floor().max(0.0) as usize..=last
        };
        let mut pixels = Vec::new();
        for (x, y) in
            range(disc.y, difference.height()).flat_map(|y| range(disc.x, difference.width()).map(move |x| (x, y)))
        {
            let Some(level) = difference.at(x, y) else { continue };
            let (x, y) = (x as f64, y as f64);
            let turn = (y - disc.y).atan2(x - disc.x) / std::f64::consts::TAU;
            let place = turn.rem_euclid(1.0) * pieces as f64;
            let first = place as usize % pieces;
            pixels.push(RimPixel {
                x,
                y,
                difference: f64::from(level).clamp(-max_dn, max_dn),
                pieces: [first, (first + 1) % pieces],
                fraction: place.fract(),
            });
        }
        Self { pixels, pieces }
    }

    /// Fits a circle near `start`. `left_out` is a sector whose pixels are ignored.
    fn fit(&self, start: Disc, noise_dn: f64, wanted: WantedRadius, left_out: Option<usize>) -> Option<RimFit> {
        let count = 3 + 2 * self.pieces;
        let mut fit = RimFit {
            disc: start,
            contrasts: DVector::zeros(2 * self.pieces),
            scatter_dn: f64::INFINITY,
            normal: DMatrix::zeros(count, count),
        };
        for _ in 0..STEPS {
            let right = self.sum_equations(&mut fit, noise_dn, left_out)?;
            let right = fit.add_prior(right, wanted);
            fit.advance(&right)?;
        }
        let is_finite = fit.disc.x.is_finite() && fit.disc.y.is_finite() && fit.disc.radius.is_finite();
        is_finite.then_some(fit)
    }

    /// Sums the normal equations of all used pixels; returns their right side. `None` without a pixel.
    fn sum_equations(&self, fit: &mut RimFit, noise_dn: f64, left_out: Option<usize>) -> Option<DVector<f64>> {
        let sector = |pixel: &RimPixel| pixel.pieces[0] * SECTORS / self.pieces;
        let used = self.pixels.iter().filter(|pixel| left_out.is_none_or(|left_out| sector(pixel) != left_out));
        let mut right = DVector::zeros(3 + 2 * self.pieces);
        let mut sizes = Vec::with_capacity(self.pixels.len());
        fit.normal.fill(0.0);
        for pixel in used {
            let Some((residual, slots)) = fit.linearize(pixel, self.pieces) else { continue };
            sizes.push(residual.abs());
            let weight = (HUBER_SIGMAS * fit.scatter_dn / residual.abs().max(1e-9)).min(1.0);
            for (row, a) in slots {
                right[row] += weight * a * residual;
                slots.iter().for_each(|(column, b)| fit.normal[(row, *column)] += weight * a * b);
            }
        }
        fit.scatter_dn = (SIGMA_PER_MEDIAN * median(&mut sizes)?).max(noise_dn);
        Some(right)
    }

    /// Returns the fraction of the pixels just outside a circle that have changed.
    fn changed_outside(&self, disc: Disc, noise_dn: f64) -> f64 {
        let is_outside = |pixel: &&RimPixel| {
            let outside = -disc.depth(pixel.x, pixel.y);
            (CLEARANCE_PX..RING_PX[1]).contains(&outside)
        };
        let outside: Vec<&RimPixel> = self.pixels.iter().filter(is_outside).collect();
        let changed = outside.iter().filter(|pixel| pixel.difference.abs() > CHANGE_SIGMAS * noise_dn).count();
        changed as f64 / outside.len().max(1) as f64
    }
}

impl RimFit {
    /// Adds what is known beforehand to the normal equations with this right side: the radius, and small contrasts.
    fn add_prior(&mut self, mut right: DVector<f64>, wanted: WantedRadius) -> DVector<f64> {
        let radius = self.scatter_dn.powi(2) * wanted.information();
        self.normal[(2, 2)] += radius;
        right[2] += radius * (wanted.expected.unwrap_or(self.disc.radius) - self.disc.radius);
        for index in 0..self.contrasts.len() {
            let known = if 2 * index < self.contrasts.len() { CONTRAST_INFORMATION } else { SLOPE_INFORMATION };
            self.normal[(3 + index, 3 + index)] += known;
            right[3 + index] -= known * self.contrasts[index];
        }
        right
    }

    /// Moves the circle and the contrasts by a damped step; `None` if the pixels do not determine it.
    fn advance(&mut self, right: &DVector<f64>) -> Option<()> {
        let mut damped = self.normal.clone();
        (0..3).for_each(|index| damped[(index, index)] += self.scatter_dn.powi(2) * DAMPING);
        let step = damped.cholesky()?.solve(right);
        let moved = [0, 1, 2].map(|index| step[index].clamp(-MAX_STEP_PX, MAX_STEP_PX));
        self.disc.x += moved[0];
        self.disc.y += moved[1];
        self.disc.radius += moved[2];
        self.contrasts += step.rows(3, self.contrasts.len());
        Some(())
    }

    /// Returns the residual of a pixel, DN, and the derivatives of its model by the parameters that it depends on.
    ///
    /// `None` outside the ring.
    fn linearize(&self, pixel: &RimPixel, pieces: usize) -> Option<(f64, [(usize, f64); 7])> {
        let depth = self.disc.depth(pixel.x, pixel.y);
        if !(-RING_PX[1]..RING_PX[0]).contains(&depth) {
            return None;
        }
        let distance = (self.disc.radius - depth).max(1e-9);
        let tanh = (RIM_SLOPE * depth).tanh();
        let (coverage, rise) = (0.5 + 0.5 * tanh, 0.5 * RIM_SLOPE * (1.0 - tanh * tanh));
        let [first, second] = pixel.pieces;
        let between = |offset: usize| {
            (1.0 - pixel.fraction) * self.contrasts[offset + first] + pixel.fraction * self.contrasts[offset + second]
        };
        let (inside, slope) = (depth.max(0.0), between(pieces));
        let contrast = between(0) + slope * inside;
        let by_depth = rise * contrast + if depth > 0.0 { coverage * slope } else { 0.0 };
        let slots = [
            (0, by_depth * (pixel.x - self.disc.x) / distance),
            (1, by_depth * (pixel.y - self.disc.y) / distance),
            (2, by_depth),
            (3 + first, coverage * (1.0 - pixel.fraction)),
            (3 + second, coverage * pixel.fraction),
            (3 + pieces + first, coverage * inside * (1.0 - pixel.fraction)),
            (3 + pieces + second, coverage * inside * pixel.fraction),
        ];
        Some((pixel.difference - coverage * contrast, slots))
    }

    /// Returns the standard uncertainties of x, y and the radius by the scatter of the pixels.
    fn sigmas(&self) -> Option<[f64; 3]> {
        let covariance = self.normal.clone().cholesky()?.inverse() * (DEPENDENT_PIXELS * self.scatter_dn.powi(2));
        Some([0, 1, 2].map(|index| covariance[(index, index)].max(0.0).sqrt()))
    }

    /// Returns the fraction of the pieces of the rim that have contrast.
    fn visible_pieces(&self, pieces: usize) -> f64 {
        let pixels = RING_PX[0] * std::f64::consts::TAU * self.disc.radius / pieces as f64;
        let limit = MIN_CONTRAST_SIGMAS * self.scatter_dn / pixels.sqrt();
        self.contrasts.iter().take(pieces).filter(|contrast| contrast.abs() > limit).count() as f64 / pieces as f64
    }
}

/// Returns the maximum distance of the circle from the disc that covers what has changed, px.
fn max_apart_px(disc: Disc) -> f64 {
    MAX_APART_PX.max(MAX_APART_RADII * disc.radius)
}

/// Fits the outline of a ball of expected size to a changed part of faint contrast.
///
/// `difference` and `sizes` are the difference from the background and its absolute value, DN. `None` without an expected
/// radius, or if the contrast along the rim does not determine a circle.
pub(super) fn fit_faint_rim(
    difference: ImageView<'_>,
    sizes: ImageView<'_>,
    part: ChangedPart,
    wanted: WantedRadius,
) -> Option<ChangedDisc> {
    let (x, y) = (f64::from(part.circle.x), f64::from(part.circle.y));
    let start = most_changed(sizes, Disc { x, y, radius: wanted.expected? }, part.noise_dn);
    let ring = Ring::around(difference, start, f64::from(max_difference_dn(sizes, start)?));
    let noise_dn = f64::from(part.noise_dn);
    let fit = ring.fit(start, noise_dn, wanted, None)?;
    let disc = fit.disc;
    if (disc.x - start.x).hypot(disc.y - start.y) > max_apart_px(start)
        || !wanted.allows(&disc)
        || fit.scatter_dn > MAX_SCATTER * noise_dn
        || fit.visible_pieces(ring.pieces) < MIN_VISIBLE
        || ring.changed_outside(disc, noise_dn) > MAX_CHANGED_OUTSIDE
    {
        return None;
    }
    let sigma = uncertainty(&ring, &fit, noise_dn, wanted)?;
    let sigma_center_px = sigma[0].max(sigma[1]).max(MIN_SIGMA_PX);
    let circle = Circle {
        x_px: disc.x,
        y_px: disc.y,
        radius_px: disc.radius,
        sigma_center_px,
        sigma_radius_px: sigma[2].max(MIN_SIGMA_PX),
        visible_fraction: fraction_in_image(disc.x, disc.y, disc.radius, sizes.width(), sizes.height()).clamp(0.0, 1.0),
    };
    (sigma_center_px <= MAX_SIGMA_PX.min(MAX_SIGMA_RADII * disc.radius))
        .then(|| ChangedDisc { circle, gain: change_gain(sizes, disc, part.noise_dn) })
}

/// Returns the maximum difference that is fitted, DN: a highlight must not outweigh the rim next to it.
fn max_difference_dn(sizes: ImageView<'_>, disc: Disc) -> Option<f32> {
    let reach = CORE * disc.radius;
    let side = |center: f64| (center - reach).ceil().max(0.0) as usize..=(center + reach).max(0.0) as usize;
    let is_inside = |x: usize, y: usize| (x as f64 - disc.x).hypot(y as f64 - disc.y) < reach;
    let points = side(disc.y).flat_map(|y| side(disc.x).map(move |x| (x, y)));
    let mut levels: Vec<f64> =
        points.filter(|(x, y)| is_inside(*x, *y)).filter_map(|(x, y)| sizes.at(x, y)).map(f64::from).collect();
    median(&mut levels).map(|level| MAX_DIFFERENCE * level as f32)
}

/// Returns the standard uncertainties of x, y and the radius: by the scatter, or by leaving out one sector at a time if
/// that is larger.
fn uncertainty(ring: &Ring, fit: &RimFit, noise_dn: f64, wanted: WantedRadius) -> Option<[f64; 3]> {
    let mut sums = [0.0; 3];
    for sector in 0..SECTORS {
        let without = ring.fit(fit.disc, noise_dn, wanted, Some(sector))?.disc;
        let moved = [without.x - fit.disc.x, without.y - fit.disc.y, without.radius - fit.disc.radius];
        sums.iter_mut().zip(moved).for_each(|(sum, moved)| *sum += moved * moved);
    }
    // The jackknife (B. Efron, The Jackknife, the Bootstrap and Other Resampling Plans, SIAM 1982, section 3).
    let factor = (SECTORS - 1) as f64 / SECTORS as f64;
    let scatter = fit.sigmas()?;
    Some(std::array::from_fn(|index| scatter[index].max((factor * sums[index]).sqrt())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ball::foreground::Foreground;
    use crate::ball::texture_disc::RadiusRange;
    use crate::image::{Image, PixelRect};
    use crate::numeric::Xorshift;

    /// The difference of a ball that is brighter than the ground on top and darker below, with a highlight and noise.
    fn difference(truth: Disc, contrast_dn: f64, seed: usize) -> Image {
        let mut random = Xorshift::default();
        (0..97 * seed).for_each(|_| {
            random.below(2);
        });
        let mut image = Image::new(96, 80);
        for (y, row) in image.rows_mut().enumerate() {
            for (x, level) in row.iter_mut().enumerate() {
                let (dx, dy) = (x as f64 - truth.x, y as f64 - truth.y);
                let coverage = (0.5 + truth.depth(x as f64, y as f64)).clamp(0.0, 1.0);
                let contrast = contrast_dn * ((0.5 * dx - dy) / truth.radius).clamp(-1.0, 1.0);
                let highlight = if (dx + 1.5).hypot(dy + 2.0) < 1.2 { 150.0 } else { 0.0 };
                let noise = (0..12).map(|_| random.below(1000) as f64 / 1000.0).sum::<f64>() - 6.0;
                *level = (coverage * (contrast + highlight) + 2.5 * noise) as f32;
            }
        }
        image
    }

    #[test]
    fn a_faint_rim_of_both_signs_is_found_within_its_uncertainty() {
        let (mut worst, mut largest, mut found) = (0.0_f64, 0.0_f64, 0);
        for case in 0..40_u32 {
            let shift = 0.13 * f64::from(case);
            let truth = Disc { x: 40.3 + shift, y: 37.8 - 0.7 * shift, radius: 6.0 + 0.2 * f64::from(case) };
            let image = difference(truth, 20.0, case as usize);
            let radii = RadiusRange { low: 5.0, high: 20.0 };
            let mut foreground = Foreground::default();
            let parts = foreground.search(image.view(), PixelRect::whole(96, 80), radii);
            let sizes = ImageView::new(foreground.sizes(), 96, 80).unwrap();
            let wanted = WantedRadius { range: radii, expected: Some(1.01 * truth.radius) };
            let Some(part) = parts.first() else { continue };
            let Some(disc) = fit_faint_rim(image.view(), sizes, *part, wanted) else { continue };
            let error = (disc.circle.x_px - truth.x).hypot(disc.circle.y_px - truth.y);
            (worst, largest) = (worst.max(error / disc.circle.sigma_center_px), largest.max(error));
            found += 1;
        }
        eprintln!("{found} of 40 found, largest error {largest} px, {worst} sigmas");
        assert!(found >= 34 && worst < 4.0 && largest < 0.7, "{found} found, {worst} sigmas, {largest} px");
    }

    #[test]
    fn a_soft_shadow_has_no_rim() {
        let mut image = Image::new(96, 80);
        for (y, row) in image.rows_mut().enumerate() {
            for (x, level) in row.iter_mut().enumerate() {
                let (dx, dy) = (x as f32 - 48.0, y as f32 - 40.0);
                *level = -60.0 * (-(dx * dx + dy * dy) / 50.0).exp();
            }
        }
        let radii = RadiusRange { low: 5.0, high: 20.0 };
        let mut foreground = Foreground::default();
        let parts = foreground.search(image.view(), PixelRect::whole(96, 80), radii);
        let sizes = ImageView::new(foreground.sizes(), 96, 80).unwrap();
        assert_eq!(parts.len(), 1);
        for expected in [6.0, 8.0, 10.0, 12.0] {
            let wanted = WantedRadius { range: radii, expected: Some(expected) };
            assert!(fit_faint_rim(image.view(), sizes, parts[0], wanted).is_none(), "{expected}");
        }
    }
}
