//! The scale, given or from the ball's own size.

use std::collections::VecDeque;

use super::{MetresPerPixel, Scale};
use crate::numeric::median;
use crate::results::{Circle, Estimate};

/// The maximum number of outlines kept; every second one is then dropped.
const MAX_OUTLINES: usize = 512;
/// The number of radii that show how they scatter, and the minimum number.
const SCATTERED: usize = 48;
const MIN_SCATTERED: usize = 8;
/// The minimum ratio of their variance to that of noise, which they exceed by chance in places.
const MIN_EXCESS: f64 = 2.0;
/// The visible fraction from which an outline counts as unoccluded.
const UNOCCLUDED_FRACTION: f64 = 0.95;
/// The difference between measured and expected radius that an inaccurate scale explains, as a fraction.
const RADIUS_TOLERANCE: f64 = 0.01;
/// The same that noise explains, sigmas.
const RADIUS_SIGMAS: f64 = 1.0;

/// A robust running radius of a ball: the median over the outlines so far, of the unoccluded ones if there are any.
#[derive(Debug, Clone)]
pub struct RunningRadius {
    whole: RunningMedian,
    any: RunningMedian,
    /// The latest radii with their sigmas, px, however much of the outline was seen.
    latest: VecDeque<(f64, f64)>,
}

/// The running medians of radii and of their sigmas, over at most [`MAX_OUTLINES`] evenly spread outlines.
#[derive(Debug, Clone)]
struct RunningMedian {
    /// In order of arrival: (radius, its sigma).
    kept: Vec<(f64, f64)>,
    stride: u64,
    seen: u64,
    median: Option<Estimate>,
}

impl RunningMedian {
    fn new() -> Self {
        Self { kept: Vec::new(), stride: 1, seen: 0, median: None }
    }

    /// Adds the next radius, px, or skips it once the list is thinned out.
    fn push(&mut self, radius: f64, sigma: f64) {
        let is_sampled = self.seen.is_multiple_of(self.stride);
        self.seen += 1;
        if !is_sampled {
            return;
        }
        if self.kept.len() == MAX_OUTLINES {
            self.kept = self.kept.iter().step_by(2).copied().collect();
            self.stride *= 2;
        }
        self.kept.push((radius, sigma));
        let (mut radii, mut sigmas): (Vec<f64>, Vec<f64>) = self.kept.iter().copied().unzip();
        let estimate = median(&mut radii).zip(median(&mut sigmas));
        self.median = estimate.map(|(value, sigma)| Estimate { value, sigma });
    }
}

/// Returns the scatter of radii about a line beyond their sigmas, px; 0 for fewer than [`MIN_SCATTERED`] radii.
fn excess_scatter(radii: &VecDeque<(f64, f64)>) -> f64 {
    let count = radii.len() as f64;
    if radii.len() < MIN_SCATTERED {
        return 0.0;
    }
    let place = |k: usize| k as f64 - 0.5 * (count - 1.0);
    let mean = radii.iter().map(|(radius, _)| radius).sum::<f64>() / count;
    let products = radii.iter().enumerate().map(|(k, (radius, _))| place(k) * (radius - mean));
    let slope = products.sum::<f64>() * 12.0 / (count * (count * count - 1.0));
    let off = |(k, (radius, _)): (usize, &(f64, f64))| (radius - mean - slope * place(k)).powi(2);
    let found = radii.iter().enumerate().map(off).sum::<f64>() / (count - 2.0);
    let noise = radii.iter().map(|(_, sigma)| sigma.powi(2)).sum::<f64>() / count;
    if found > MIN_EXCESS * noise { (found - noise).sqrt() } else { 0.0 }
}

impl RunningRadius {
    /// Creates an estimate without any outline.
    pub fn new() -> Self {
        Self { whole: RunningMedian::new(), any: RunningMedian::new(), latest: VecDeque::new() }
    }

    /// Adds the next outline; one without a positive radius is ignored.
    pub fn push(&mut self, circle: &Circle) {
        if !(circle.radius_px > 0.0 && circle.radius_px.is_finite() && circle.sigma_radius_px.is_finite()) {
            return;
        }
        let list = if circle.visible_fraction >= UNOCCLUDED_FRACTION { &mut self.whole } else { &mut self.any };
        list.push(circle.radius_px, circle.sigma_radius_px.abs());
        if self.latest.len() == SCATTERED {
            self.latest.pop_front();
        }
        self.latest.push_back((circle.radius_px, circle.sigma_radius_px.abs()));
    }

    /// Returns the radius, px; `None` before the first outline.
    ///
    /// Its sigma is a single outline's, because the errors of outlines of one film are mostly common.
    pub fn radius_px(&self) -> Option<Estimate> {
        self.whole.median.or(self.any.median)
    }

    /// Returns the difference from the expected radius if noise and an inaccurate scale do not explain it, px; else 0.
    pub fn misfit_px(&self, expected_px: f64) -> f64 {
        let Some(radius) = self.radius_px() else { return 0.0 };
        // The centre of a part of a rim is as wrong as its radius, that of a whole rim is not.
        let tolerance = if self.whole.median.is_some() { RADIUS_TOLERANCE } else { 0.0 };
        let allowed_px = tolerance * expected_px + RADIUS_SIGMAS * radius.sigma;
        Some((radius.value - expected_px).abs()).filter(|misfit_px| *misfit_px > allowed_px).unwrap_or(0.0)
    }

    /// Returns the scatter of the radius about a steady change beyond the sigmas of the outlines, px.
    ///
    /// Light at the rim that shifts a part of an outline changes its radius by about as much as its centre.
    pub fn scatter_px(&self) -> f64 {
        excess_scatter(&self.latest)
    }

    /// Returns the scale, m/px; `None` while it depends on a radius that is not measured yet.
    pub fn metres_per_px(&self, scale: Scale) -> Option<MetresPerPixel> {
        match scale {
            Scale::MmPerPx(mm) => Some(Estimate { value: mm * 1e-3, sigma: 0.0 }),
            Scale::Unknown => None,
            Scale::BallDiameterMm(mm) => self.radius_px().map(|radius| {
                let value = mm * 1e-3 / (2.0 * radius.value);
                Estimate { value, sigma: value * radius.sigma / radius.value }
            }),
        }
    }
}

impl Default for RunningRadius {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn circle(radius_px: f64, visible_fraction: f64) -> Circle {
        Circle { x_px: 0.0, y_px: 0.0, radius_px, sigma_center_px: 0.02, sigma_radius_px: 0.05, visible_fraction }
    }

    #[test]
    fn outliers_and_hidden_outlines_do_not_move_the_scale() {
        let mut radius = RunningRadius::new();
        assert!(radius.metres_per_px(Scale::BallDiameterMm(60.0)).is_none());
        for i in 0..2000 {
            let r = if i % 7 == 3 { 55.0 } else { 60.0 };
            radius.push(&circle(r, if i % 5 == 2 { 0.5 } else { 1.0 }));
        }
        let scale = radius.metres_per_px(Scale::BallDiameterMm(60.0)).unwrap();
        assert!((scale.value - 0.5e-3).abs() < 1e-15);
        assert!((scale.sigma / scale.value - 0.05 / 60.0).abs() < 1e-12);
    }

    #[test]
    fn hidden_outlines_serve_until_a_whole_one_comes() {
        let mut radius = RunningRadius::new();
        radius.push(&circle(58.0, 0.5));
        assert_eq!(radius.radius_px().unwrap().value.to_bits(), 58.0_f64.to_bits());
        radius.push(&circle(60.0, 1.0));
        assert_eq!(radius.radius_px().unwrap().value.to_bits(), 60.0_f64.to_bits());
    }

    #[test]
    fn a_wrong_radius_of_a_part_of_a_rim_counts_in_full() {
        let misfit = |radius_px: f64, visible_fraction: f64| {
            let mut radius = RunningRadius::new();
            radius.push(&circle(radius_px, visible_fraction));
            radius.misfit_px(60.0)
        };
        assert!((misfit(59.5, 0.3) - 0.5).abs() < 1e-12);
        assert!(misfit(59.5, 1.0).abs() < 1e-12, "the scale may be inaccurate");
        assert!((misfit(59.0, 1.0) - 1.0).abs() < 1e-12);
        assert!(misfit(59.96, 0.3).abs() < 1e-12, "noise");
    }

    #[test]
    fn radii_that_jump_by_more_than_their_sigmas_scatter() {
        let scatter_px = |radius_px: &dyn Fn(u32) -> f64| {
            let mut radius = RunningRadius::new();
            (0..40).for_each(|k| radius.push(&circle(radius_px(k), 0.4)));
            radius.scatter_px()
        };
        // Light masks the rim in some frames.
        let jumps = scatter_px(&|k| if (9..28).contains(&k) { 59.5 } else { 60.0 });
        assert!((0.2..0.3).contains(&jumps), "{jumps}");
        assert!(scatter_px(&|k| 60.0 + 0.1 * f64::from(k)) <= 0.0, "the ball comes nearer");
        assert!(scatter_px(&|k| 60.0 + 0.04 * f64::from(k % 2)) <= 0.0, "noise");
    }
}
