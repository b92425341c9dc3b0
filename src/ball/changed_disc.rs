//! The outline of a ball in its difference from the background: a circle through the outermost changes along rays.
//!
//! Across the rim the difference rises from zero to the contrast of the ball, whatever its sign. Where the blur is
//! symmetric, the rim lies at half of that height, so the contrast may differ from ray to ray, or be missing.

use nalgebra::{Matrix3, Vector3};

use super::foreground::ChangedPart;
use super::ransac::RoughCircle;
use super::texture_disc::RadiusRange;
use super::visible_fraction::fraction_in_image;
use crate::image::ImageView;
use crate::numeric::{SIGMA_PER_MEDIAN, Xorshift, median};
use crate::results::Circle;

/// The distance of two rays along the rim, px, and the limits of their number.
const RAY_STEP_PX: f64 = 1.5;
const RAYS: [usize; 2] = [24, 120];
/// The distance of two samples of a ray, px.
const SAMPLE_PX: f64 = 0.5;
/// The maximum error of the first radius: in px, and as a fraction.
const REACH: [f64; 2] = [4.0, 0.35];
/// The height of a rise, in standard deviations of the noise.
const MIN_RISE_SIGMAS: f32 = 4.0;
/// The distance inside the first rise in which the contrast is read, samples.
const CONTRAST_SAMPLES: usize = 4;
/// The maximum distance of a supporting ray from the circle: in px, and as a fraction of the radius.
const TOLERANCE: [f64; 2] = [0.7, 0.02];
/// The number of circles tried through three rays.
const RANSAC_TRIALS: usize = 200;
/// The rounds in which the rays start at the centre that was found before.
const ROUNDS: usize = 3;
/// The minimum fraction of rays that support a circle of unknown, and of expected radius.
const MIN_SUPPORT: [f64; 2] = [0.6, 0.4];
/// The maximum fraction of rays with a change outside the circle: a shadow that touches the ball, or a larger body.
const MAX_OUTSIDE: f64 = 0.12;
/// The relative error of an expected radius, and the deviation that is allowed.
const RADIUS_ERROR: f64 = 0.03;
const MAX_RADIUS_DEVIATION: f64 = 0.08;
/// The number of neighbouring rays that share their errors.
const DEPENDENT_RAYS: f64 = 2.0;
/// The maximum distance between the disc that covers what has changed and the circle through the rim: in px, and in radii.
const MAX_APART_PX: f64 = 1.2;
const MAX_APART_RADII: f64 = 0.04;
/// The log-likelihood of a changed pixel, relative to noise: `CHANGE_SLOPE z^2 - CHANGE_OFFSET` of a difference of z
/// standard deviations, at most `MAX_CHANGE_GAIN`. Changed pixels have a standard deviation of three times the noise.
const CHANGE_SLOPE: f64 = 0.45;
const CHANGE_OFFSET: f64 = 1.15;
const MAX_CHANGE_GAIN: f64 = 4.0;
/// The minimum scatter of a ray, px: half the contrast is read from few samples.
const MIN_SCATTER_PX: f64 = 0.15;
/// The maximum scatter of the supporting rays, px: robust standard deviation.
const MAX_SCATTER_PX: f64 = 0.5;
/// The number of sectors that are left out in turn, to see how far each of them moves the circle.
const SECTORS: usize = 6;
/// The minimum uncertainty, px. Shading near the rim shifts all rays alike.
pub(super) const MIN_SIGMA_PX: f64 = 0.05;

/// The change along a ray.
#[derive(Debug, Clone, Copy)]
struct RimPoint {
    ray: usize,
    x: f64,
    y: f64,
}

/// A circle, px.
#[derive(Debug, Clone, Copy)]
pub(super) struct Disc {
    pub x: f64,
    pub y: f64,
    pub radius: f64,
}

impl Disc {
    /// Returns the distance of a place inside the circle, px; negative outside.
    pub(super) fn depth(&self, x: f64, y: f64) -> f64 {
        self.radius - (x - self.x).hypot(y - self.y)
    }

    /// Returns the distance of a point outside the circle, px; negative inside.
    fn distance(&self, point: &RimPoint) -> f64 {
        (point.x - self.x).hypot(point.y - self.y) - self.radius
    }

    /// Returns the maximum distance of a supporting point, px.
    fn tolerance_px(&self) -> f64 {
        TOLERANCE[0].max(TOLERANCE[1] * self.radius)
    }
}

/// A circle and the log-likelihood that what it covers has changed, relative to noise.
#[derive(Debug, Clone, Copy)]
pub(super) struct ChangedDisc {
    pub circle: Circle,
    pub gain: f64,
}

/// The radius of the ball to be found, px.
#[derive(Debug, Clone, Copy)]
pub(super) struct WantedRadius {
    /// The allowed range.
    pub range: RadiusRange,
    /// The radius that the scale and the diameter of the ball predict, if they are known.
    pub expected: Option<f64>,
}

impl WantedRadius {
    /// Whether a circle has an allowed radius.
    pub(super) fn allows(&self, disc: &Disc) -> bool {
        let is_expected = |expected: f64| (disc.radius / expected - 1.0).abs() <= MAX_RADIUS_DEVIATION;
        let range = self.range.low - 1.0..=self.range.high + 1.0;
        range.contains(&disc.radius) && self.expected.is_none_or(is_expected)
    }

    /// Returns the inverse variance of the radius that is known beforehand, px^-2; 0 without an expectation.
    pub(super) fn information(&self) -> f64 {
        self.expected.map_or(0.0, |expected| (RADIUS_ERROR * expected).powi(-2))
    }
}

/// Fits the outline of a ball to a changed part.
///
/// `sizes` are the absolute differences from the background, DN. `None` if no circle with an allowed radius has the
/// support of enough rays.
pub(super) fn fit_disc(sizes: ImageView<'_>, part: ChangedPart, wanted: WantedRadius) -> Option<ChangedDisc> {
    let RoughCircle { x, y, radius } = part.circle;
    let mut disc = Disc { x: x.into(), y: y.into(), radius: wanted.expected.unwrap_or(radius.into()) };
    let mut points = Vec::new();
    let mut rays = 0;
    if wanted.expected.is_some() {
        disc = most_changed(sizes, disc, part.noise_dn);
    }
    let occupied = disc;
    for _ in 0..ROUNDS {
        rays = find_rim(sizes, disc, part.noise_dn, &mut points);
        let first = if wanted.expected.is_some() { disc } else { ransac_circle(&points, wanted)? };
        disc = refine(first, &points, wanted)?;
    }
    let apart_px = (disc.x - occupied.x).hypot(disc.y - occupied.y);
    if wanted.expected.is_some() && apart_px > MAX_APART_PX.max(MAX_APART_RADII * disc.radius) {
        return None;
    }
    let is_outside = |point: &&RimPoint| disc.distance(point) > disc.tolerance_px();
    let outside = points.iter().filter(is_outside).count() as f64;
    points.retain(|point| disc.distance(point).abs() < disc.tolerance_px());
    let support = points.len() as f64 / rays.max(1) as f64;
    let mut distances: Vec<f64> = points.iter().map(|point| disc.distance(point).abs()).collect();
    let scatter_px = SIGMA_PER_MEDIAN * median(&mut distances)?;
    let min_support = MIN_SUPPORT[usize::from(wanted.expected.is_some())];
    if outside > MAX_OUTSIDE * rays as f64
        || support < min_support
        || scatter_px > MAX_SCATTER_PX
        || !wanted.allows(&disc)
    {
        return None;
    }
    let sigma = uncertainty(disc, &points, rays, wanted)?;
    let visible_fraction = fraction_in_image(disc.x, disc.y, disc.radius, sizes.width(), sizes.height());
    let circle = Circle {
        x_px: disc.x,
        y_px: disc.y,
        radius_px: disc.radius,
        sigma_center_px: sigma[0].max(sigma[1]).max(MIN_SIGMA_PX),
        sigma_radius_px: sigma[2].max(MIN_SIGMA_PX),
        visible_fraction: visible_fraction.clamp(0.0, 1.0),
    };
    Some(ChangedDisc { circle, gain: change_gain(sizes, disc, part.noise_dn) })
}

/// Finds the outermost change along each ray from the centre of a circle; returns the number of rays inside the image.
fn find_rim(sizes: ImageView<'_>, disc: Disc, noise_dn: f32, points: &mut Vec<RimPoint>) -> usize {
    points.clear();
    let reach = REACH[0].max(REACH[1] * disc.radius);
    let rays = ((std::f64::consts::TAU * disc.radius / RAY_STEP_PX) as usize).clamp(RAYS[0], RAYS[1]);
    let (outer, samples) = (disc.radius + reach, ((2.0 * reach).min(disc.radius + reach) / SAMPLE_PX) as usize);
    let mut profile = Vec::with_capacity(samples);
    let mut inside = 0;
    for ray in 0..rays {
        let (sin, cos) = ((ray as f64 + 0.5) * std::f64::consts::TAU / rays as f64).sin_cos();
        let radius = |sample: f64| outer - SAMPLE_PX * sample;
        profile.clear();
        profile.extend((0..samples).map_while(|k| {
            let r = radius(k as f64);
            sizes.interpolate(disc.x + r * cos, disc.y + r * sin)
        }));
        if profile.len() < samples {
            continue;
        }
        inside += 1;
        if let Some(sample) = outermost_rise(&profile, MIN_RISE_SIGMAS * noise_dn) {
            let r = radius(sample);
            points.push(RimPoint { ray, x: disc.x + r * cos, y: disc.y + r * sin });
        }
    }
    inside
}

/// Returns the sample, with its fraction, at which a profile first rises through half of its next maximum.
///
/// Two successive samples must exceed `limit`. `None` without any.
fn outermost_rise(profile: &[f32], limit: f32) -> Option<f64> {
    let first = profile.windows(2).position(|pair| pair[0] > limit && pair[1] > limit)?;
    let end = (first + 1 + CONTRAST_SAMPLES).min(profile.len());
    let (top, height) = (first..end).map(|k| (k, profile[k])).max_by(|a, b| a.1.total_cmp(&b.1))?;
    let below = (0..top).rev().find(|k| profile[*k] < 0.5 * height)?;
    let (low, high) = (profile[below], profile[below + 1]);
    Some(below as f64 + f64::from((0.5 * height - low) / (high - low)))
}

/// Returns the place of a disc of known radius at which it covers most of what has changed.
pub(super) fn most_changed(sizes: ImageView<'_>, near: Disc, noise_dn: f32) -> Disc {
    let reach = REACH[0].max(REACH[1] * near.radius);
    let mut best = (f64::NEG_INFINITY, near);
    let mut step = (near.radius / 6.0).max(1.0);
    let mut range = (reach / step).ceil() as i32;
    while step > 0.2 {
        let middle = best.1;
        for (row, column) in (-range..=range).flat_map(|row| (-range..=range).map(move |column| (row, column))) {
            let disc = Disc { x: middle.x + step * f64::from(column), y: middle.y + step * f64::from(row), ..middle };
            let gain = change_gain(sizes, disc, noise_dn);
            if gain > best.0 {
                best = (gain, disc);
            }
        }
        (step, range) = (0.5 * step, 1);
    }
    best.1
}

/// Returns the log-likelihood that what a disc covers has changed, relative to noise.
pub(super) fn change_gain(sizes: ImageView<'_>, disc: Disc, noise_dn: f32) -> f64 {
    let range = |center: f64, side: usize| {
        let first = (center - disc.radius - 1.0).floor().max(0.0) as usize;
        first..((center + disc.radius + 2.0).ceil().max(0.0) as usize).min(side)
    };
    let columns = range(disc.x, sizes.width());
    let mut gain = 0.0;
    for y in range(disc.y, sizes.height()) {
        let row = &sizes.row(y)[columns.clone().start.min(columns.end)..columns.end];
        for (x, size) in columns.clone().zip(row) {
            let outside = (x as f64 - disc.x).hypot(y as f64 - disc.y) - disc.radius;
            let coverage = (0.5 - outside).clamp(0.0, 1.0);
            let z = f64::from(size / noise_dn);
            gain += coverage * (CHANGE_SLOPE * z * z - CHANGE_OFFSET).min(MAX_CHANGE_GAIN);
        }
    }
    gain
}

/// Fits a circle to the points by RANSAC: the circle through three random points with the highest score.
///
/// A point scores 1 on the circle, falling to 0 at its tolerance. `None` with too few points, or if no circle has an allowed
/// radius.
fn ransac_circle(points: &[RimPoint], wanted: WantedRadius) -> Option<Disc> {
    if points.len() < 6 {
        return None;
    }
    // A constant seed: the same image gives the same circle.
    let mut random = Xorshift::default();
    let mut best: Option<(f64, Disc)> = None;
    for _ in 0..RANSAC_TRIALS {
        let drawn = std::array::from_fn(|_| points[random.below(points.len())]);
        let Some(disc) = through_three(drawn).filter(|disc| wanted.allows(disc)) else { continue };
        let tolerance = disc.tolerance_px();
        let weight = |point: &RimPoint| (1.0 - (disc.distance(point) / tolerance).powi(2)).max(0.0);
        let score: f64 = points.iter().map(weight).sum();
        if best.is_none_or(|(highest, _)| score > highest) {
            best = Some((score, disc));
        }
    }
    best.map(|(_, disc)| disc)
}

/// Returns the circle through three points; `None` if they lie nearly on a line.
fn through_three([a, b, c]: [RimPoint; 3]) -> Option<Disc> {
    let (bx, by, cx, cy) = (b.x - a.x, b.y - a.y, c.x - a.x, c.y - a.y);
    let determinant = 2.0 * (bx * cy - by * cx);
    let (b2, c2) = (bx * bx + by * by, cx * cx + cy * cy);
    let (ux, uy) = ((cy * b2 - by * c2) / determinant, (bx * c2 - cx * b2) / determinant);
    (determinant.abs() > 1.0).then(|| Disc { x: a.x + ux, y: a.y + uy, radius: ux.hypot(uy) })
}

/// Returns the sum of the products of the derivatives of a distance by x, y and the radius, and those with the distances,
/// both with biweights of the distances.
fn normal_equations(disc: Disc, points: &[RimPoint]) -> (Matrix3<f64>, Vector3<f64>) {
    let scale = 2.0 * disc.tolerance_px();
    let (mut normal, mut right) = (Matrix3::<f64>::zeros(), Vector3::<f64>::zeros());
    for point in points {
        let distance = disc.distance(point);
        if distance.abs() < scale {
            let weight = (1.0 - (distance / scale).powi(2)).powi(2);
            let length = (point.x - disc.x).hypot(point.y - disc.y).max(1e-9);
            let row = Vector3::new((point.x - disc.x) / length, (point.y - disc.y) / length, 1.0);
            normal += weight * row * row.transpose();
            right += weight * distance * row;
        }
    }
    (normal, right)
}

/// Refines a circle by least squares with biweights of the distances, and the radius that is known beforehand.
fn refine(mut disc: Disc, points: &[RimPoint], wanted: WantedRadius) -> Option<Disc> {
    let weight = wanted.information() * DEPENDENT_RAYS * MIN_SCATTER_PX.powi(2);
    for _ in 0..6 {
        let (mut normal, mut right) = normal_equations(disc, points);
        normal[(2, 2)] += weight;
        right[2] += weight * (wanted.expected.unwrap_or(disc.radius) - disc.radius);
        let step = normal.try_inverse()? * right;
        disc = Disc { x: disc.x + step[0], y: disc.y + step[1], radius: disc.radius + step[2] };
    }
    (disc.x.is_finite() && disc.y.is_finite() && disc.radius.is_finite()).then_some(disc)
}

/// Returns the standard uncertainties of x, y and the radius.
///
/// The larger of two: by least squares from the scatter of the points, and by leaving out one sector of the rays at a
/// time, which shows errors that neighbouring rays share.
fn uncertainty(disc: Disc, points: &[RimPoint], rays: usize, wanted: WantedRadius) -> Option<[f64; 3]> {
    let mut sums = [0.0; 3];
    for sector in 0..SECTORS {
        let others: Vec<RimPoint> =
            points.iter().filter(|point| point.ray * SECTORS / rays.max(1) != sector).copied().collect();
        let without = refine(disc, &others, wanted)?;
        let moved = [without.x - disc.x, without.y - disc.y, without.radius - disc.radius];
        sums.iter_mut().zip(moved).for_each(|(sum, moved)| *sum += moved * moved);
    }
    let squares: f64 = points.iter().map(|point| disc.distance(point).powi(2)).sum();
    let variance = (squares / (points.len() as f64 - 3.0).max(1.0)).max(MIN_SCATTER_PX.powi(2)) * DEPENDENT_RAYS;
    let (mut information, _) = normal_equations(disc, points);
    information /= variance;
    information[(2, 2)] += wanted.information();
    let covariance = information.try_inverse()?;
    // The jackknife (B. Efron, The Jackknife, the Bootstrap and Other Resampling Plans, SIAM 1982, section 3).
    let factor = (SECTORS - 1) as f64 / SECTORS as f64;
    Some(std::array::from_fn(|k| (factor * sums[k]).max(covariance[(k, k)]).max(0.0).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ball::foreground::Foreground;
    use crate::image::{Image, PixelRect};

    /// The difference of a shaded disc from its background: bright on one side, dark on the other, with noise.
    fn difference(truth: Disc, noise_dn: f32, seed: usize) -> Image {
        let mut random = Xorshift::default();
        (0..97 * seed).for_each(|_| {
            random.below(2);
        });
        let mut image = Image::new(96, 80);
        for (y, row) in image.rows_mut().enumerate() {
            for (x, level) in row.iter_mut().enumerate() {
                let (dx, dy) = (x as f64 - truth.x, y as f64 - truth.y);
                let coverage = (truth.radius + 0.5 - dx.hypot(dy)).clamp(0.0, 1.0) as f32;
                let contrast = if dx > 0.2 * dy { 40.0 } else { -30.0 };
                let noise: f32 = (0..12).map(|_| random.below(1000) as f32 / 1000.0).sum::<f32>() - 6.0;
                *level = coverage * contrast + noise_dn * noise;
            }
        }
        image
    }

    #[test]
    fn a_ball_of_either_sign_is_found_within_its_uncertainty() {
        let (mut worst, mut largest) = (0.0_f64, 0.0_f64);
        for case in 0..40_u32 {
            let shift = 0.13 * f64::from(case);
            let truth = Disc { x: 40.3 + shift, y: 37.8 - 0.7 * shift, radius: 6.0 + 0.2 * f64::from(case) };
            let image = difference(truth, 2.0, case as usize);
            let radii = RadiusRange { low: 5.0, high: 20.0 };
            let mut foreground = Foreground::default();
            let parts = foreground.search(image.view(), PixelRect::whole(96, 80), radii);
            let sizes = ImageView::new(foreground.sizes(), 96, 80).unwrap();
            let wanted = WantedRadius { range: radii, expected: (case % 2 == 0).then_some(1.02 * truth.radius) };
            let found = fit_disc(sizes, parts[0], wanted).unwrap().circle;
            let error = (found.x_px - truth.x).hypot(found.y_px - truth.y);
            (worst, largest) = (worst.max(error / found.sigma_center_px), largest.max(error));
            assert!((found.radius_px - truth.radius).abs() < 0.3, "{found:?} {truth:?}");
        }
        eprintln!("largest error {largest} px, {worst} sigmas");
        assert!(worst < 4.5 && largest < 0.25, "{worst} sigmas, {largest} px");
    }

    #[test]
    fn a_bar_is_no_ball() {
        let mut image = Image::new(96, 80);
        for row in image.rows_mut().skip(30).take(9) {
            row[20..52].fill(60.0);
        }
        let radii = RadiusRange { low: 6.0, high: 16.0 };
        let mut foreground = Foreground::default();
        let parts = foreground.search(image.view(), PixelRect::whole(96, 80), radii);
        assert_eq!(parts.len(), 1);
        let sizes = ImageView::new(foreground.sizes(), 96, 80).unwrap();
        for expected in [None, Some(8.0), Some(12.0)] {
            assert!(fit_disc(sizes, parts[0], WantedRadius { range: radii, expected }).is_none(), "{expected:?}");
        }
    }
}
