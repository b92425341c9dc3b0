//! Blurred edges in closed form: sharp shapes seen through a lens and square pixels.
//!
//! The lens is a Gaussian of standard deviation `blur_px`, the pixel a square of side 1. Together they are close to one
//! Gaussian whose variance is the sum of both (that of the square is 1/12).

use crate::numeric::{QuadratureNode, gauss_legendre, normal_cdf};
use std::f64::consts::{PI, TAU};

/// Returns the standard deviation of lens and pixel together, px.
pub(crate) fn total_sigma_px(blur_px: f64) -> f64 {
    (blur_px * blur_px + 1.0 / 12.0).sqrt()
}

/// The distance from an edge beyond which its blur is neglected, in standard deviations.
pub(crate) const REACH_SIGMA: f64 = 4.2;

/// Returns the probability that two standard normal numbers with this correlation stay below `a` and `b`.
///
/// It equals the blurred overlap of two half-planes whose inward normals enclose an angle with this cosine. R. L.
/// Plackett, Biometrika 41 (1954) 351, <https://doi.org/10.1093/biomet/41.3-4.351>. `rule` has the nodes and weights of
/// an integration from -1 to 1.
pub(crate) fn bivariate_cdf(a: f64, b: f64, correlation: f64, rule: &[QuadratureNode]) -> f64 {
    let half = 0.5 * correlation.clamp(-1.0, 1.0).asin();
    let sum: f64 = rule
        .iter()
        .map(|QuadratureNode { at, weight }| {
            let (sin, cos) = (half * (1.0 + at)).sin_cos();
            weight * (-(a * a + b * b - 2.0 * a * b * sin) / (2.0 * cos * cos).max(1e-12)).exp()
        })
        .sum();
    (normal_cdf(a) * normal_cdf(b) + half * sum / TAU).clamp(0.0, 1.0)
}

/// The coverage of a pixel by a blurred disc, tabulated over the squared distance from its centre.
///
/// It depends on the distance alone, so a disc drawn from the table moves and rotates rigidly, however coarse the
/// table.
#[derive(Debug, Clone)]
pub(crate) struct BlurredDisc {
    first_px2: f32,
    steps_per_px2: f32,
    last: f32,
    values: Vec<f32>,
    reach_px: f64,
}

impl BlurredDisc {
    /// Tabulates a disc of this radius with this blur.
    pub(crate) fn new(radius_px: f64, sigma_px: f64) -> Self {
        let rule = gauss_legendre::<24>();
        let reach_px = radius_px + REACH_SIGMA * sigma_px;
        let full_px = (radius_px - (REACH_SIGMA + 1.0) * sigma_px).max(0.0);
        let first = full_px * full_px;
        let step = 0.025 * radius_px.max(1.0);
        let count = ((reach_px * reach_px - first) / step).ceil() as usize + 2;
        let mut values: Vec<f32> = (0..count)
            .map(|index| disc_coverage((first + step * index as f64).sqrt(), radius_px, sigma_px, &rule) as f32)
            .collect();
        values.extend([0.0, 0.0]);
        Self {
            first_px2: first as f32,
            steps_per_px2: (1.0 / step) as f32,
            last: (values.len() - 2) as f32,
            values,
            reach_px,
        }
    }

    /// The distance beyond which the disc is neglected, px.
    pub(crate) fn reach_px(&self) -> f64 {
        self.reach_px
    }

    /// Returns the coverage at a squared distance from the centre, 0 to 1.
    #[inline]
    pub(crate) fn coverage_at(&self, distance_px2: f32) -> f32 {
        let place = ((distance_px2 - self.first_px2) * self.steps_per_px2).clamp(0.0, self.last);
        let index = place as usize;
        let part = place - index as f32;
        let left = self.values[index];
        left + part * (self.values[index + 1] - left)
    }
}

/// Returns the coverage of a pixel by a blurred disc, 0 to 1: the error-function profiles of its chords, summed across.
fn disc_coverage(distance_px: f64, radius_px: f64, sigma_px: f64, rule: &[QuadratureNode]) -> f64 {
    let chord_coverage = |half_chord: f64| {
        normal_cdf((half_chord - distance_px) / sigma_px) - normal_cdf((-half_chord - distance_px) / sigma_px)
    };
    let density = |y: f64| (-0.5 * (y / sigma_px).powi(2)).exp() / (sigma_px * TAU.sqrt());
    let reach = 6.0 * sigma_px;
    let half: f64 = if radius_px > reach {
        rule.iter()
            .map(|QuadratureNode { at: node, weight }| {
                let y = 0.5 * reach * (1.0 + node);
                0.5 * reach * weight * density(y) * chord_coverage((radius_px * radius_px - y * y).sqrt())
            })
            .sum()
    } else {
        rule.iter()
            .map(|QuadratureNode { at: node, weight }| {
                let (sin, cos) = (0.25 * PI * (1.0 + node)).sin_cos();
                0.25 * PI * weight * radius_px * cos * density(radius_px * sin) * chord_coverage(radius_px * cos)
            })
            .sum()
    };
    (2.0 * half).clamp(0.0, 1.0)
}

/// The coverage of a pixel by a blurred disc that is cut by the rim of a much larger disc at a right angle.
///
/// Tabulated over the outward distance and the distance along the rim from the small disc's centre.
#[derive(Debug, Clone)]
pub(crate) struct CutDisc {
    reach_px: f64,
    columns: usize,
    values: Vec<f32>,
}

/// The grid of a [`CutDisc`], px.
const CUT_STEP_PX: f64 = 0.125;

impl CutDisc {
    /// Tabulates a disc of `radius_px` across the rim of a disc of `rim_px`, with this blur.
    pub(crate) fn new(radius_px: f64, rim_px: f64, sigma_px: f64) -> Self {
        let rule = gauss_legendre::<16>();
        let reach_px = radius_px + REACH_SIGMA * sigma_px;
        let columns = (reach_px / CUT_STEP_PX).ceil() as usize + 2;
        let values = (0..2 * columns * columns)
            .map(|index| {
                let outward = (index / columns) as f64 * CUT_STEP_PX - reach_px;
                let along = (index % columns) as f64 * CUT_STEP_PX;
                cut_coverage([outward, along], radius_px, rim_px, sigma_px, &rule) as f32
            })
            .collect();
        Self { reach_px, columns, values }
    }

    /// The distance beyond which the disc is neglected, px.
    pub(crate) fn reach_px(&self) -> f64 {
        self.reach_px
    }

    /// Returns the coverage at a position within the reach along either axis, 0 to 1.
    #[inline]
    pub(crate) fn coverage_at(&self, outward_px: f32, along_px: f32) -> f32 {
        const STEPS_PER_PX: f32 = (1.0 / CUT_STEP_PX) as f32;
        let row = ((outward_px + self.reach_px as f32) * STEPS_PER_PX).clamp(0.0, (2 * self.columns - 2) as f32);
        let column = (along_px.abs() * STEPS_PER_PX).min((self.columns - 2) as f32);
        let (down, right) = (row.fract(), column.fract());
        let cell = row as usize * self.columns + column as usize;
        let across = |cell: usize| self.values[cell] + right * (self.values[cell + 1] - self.values[cell]);
        let (here, below) = (across(cell), across(cell + self.columns));
        here + down * (below - here)
    }
}

/// Returns the coverage of a pixel by a blurred disc that a rim cuts, 0 to 1.
///
/// The profiles of its outward chords are summed along the rim. `place_px` is outward and along the rim, from the
/// centre of the disc.
fn cut_coverage(place_px: [f64; 2], radius_px: f64, rim_px: f64, sigma_px: f64, rule: &[QuadratureNode]) -> f64 {
    let [outward, along] = place_px;
    let center = rim_px.hypot(radius_px);
    // The circles intersect here and the chords vanish.
    let widest = radius_px * (1.0 - (radius_px / center).powi(2)).sqrt();
    let angle = |along: f64| (along.clamp(-widest, widest) / radius_px).asin();
    let (low, high) = (angle(along - 6.0 * sigma_px), angle(along + 6.0 * sigma_px));
    rule.iter()
        .map(|QuadratureNode { at: node, weight }| {
            let (sin, cos) = (low + 0.5 * (high - low) * (1.0 + node)).sin_cos();
            let chord_position = radius_px * sin;
            let inner = -radius_px * cos;
            let outer = (rim_px * rim_px - chord_position * chord_position).sqrt() - center;
            let density = (-0.5 * ((along - chord_position) / sigma_px).powi(2)).exp() / (sigma_px * TAU.sqrt());
            let chord = normal_cdf((outer - outward) / sigma_px) - normal_cdf((inner - outward) / sigma_px);
            0.5 * (high - low) * weight * radius_px * cos * density * chord.max(0.0)
        })
        .sum::<f64>()
        .clamp(0.0, 1.0)
}

/// A small disc that is cut by a straight edge, and perhaps by the rim of a large disc.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EdgedDisc {
    /// The radius, px.
    pub(crate) radius_px: f64,
    /// The edge along its outward normal from the disc's centre; the part outside is kept.
    pub(crate) edge_px: f64,
    /// The centre of the large disc relative to the small one: along the edge's outward normal and across it.
    pub(crate) rim_center_px: [f64; 2],
    /// The radius of the large disc; the part inside is kept.
    pub(crate) rim_px: f64,
}

impl EdgedDisc {
    /// Returns the blurred coverage at a position along the outward normal of the edge and across it, 0 to 1.
    pub(crate) fn coverage(&self, place_px: [f64; 2], sigma_px: f64, rule: &[QuadratureNode]) -> f64 {
        let [outward, across] = place_px;
        let radius = self.radius_px;
        let angle = |outward: f64| (outward.clamp(self.edge_px.max(-radius), radius) / radius).asin();
        let (low, high) = (angle(outward - 6.0 * sigma_px), angle(outward + 6.0 * sigma_px));
        let [rim_outward, rim_across] = self.rim_center_px;
        rule.iter()
            .map(|QuadratureNode { at: node, weight }| {
                let (sin, cos) = (low + 0.5 * (high - low) * (1.0 + node)).sin_cos();
                let chord_position = radius * sin;
                let density = (-0.5 * ((outward - chord_position) / sigma_px).powi(2)).exp() / (sigma_px * TAU.sqrt());
                let rim = (self.rim_px * self.rim_px - (chord_position - rim_outward).powi(2)).max(0.0).sqrt();
                let left = (-radius * cos).max(rim_across - rim);
                let right = (radius * cos).min(rim_across + rim);
                let chord = normal_cdf((right - across) / sigma_px) - normal_cdf((left - across) / sigma_px);
                0.5 * (high - low) * weight * radius * cos * density * chord.max(0.0)
            })
            .sum::<f64>()
            .clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_normal_integral_meets_tabulated_values() {
        for (x, expected) in [(0.0, 0.5), (1.0, 0.841_344_746), (-1.96, 0.024_997_895), (3.0, 0.998_650_102)] {
            assert!((normal_cdf(x) - expected).abs() < 1.5e-7, "{x}");
        }
    }

    #[test]
    fn gauss_legendre_integrates_polynomials_exactly() {
        let rule = gauss_legendre::<12>();
        let integral: f64 = rule.iter().map(|QuadratureNode { at, weight }| weight * at.powi(22)).sum();
        assert!((integral - 2.0 / 23.0).abs() < 1e-13);
    }

    #[test]
    fn overlapping_half_planes_are_exact_in_the_known_cases() {
        let rule = gauss_legendre::<16>();
        for (a, b) in [(0.3, -0.8), (1.5, 1.4), (-0.5, 0.5), (2.0, -2.0)] {
            let (p, q) = (normal_cdf(a), normal_cdf(b));
            assert!((bivariate_cdf(a, b, 0.0, &rule) - p * q).abs() < 1e-9);
            assert!((bivariate_cdf(a, b, 1.0, &rule) - p.min(q)).abs() < 1e-3, "{a} {b}");
            assert!((bivariate_cdf(a, b, -1.0, &rule) - (p + q - 1.0).max(0.0)).abs() < 1e-3, "{a} {b}");
        }
        let at_zero = 0.25 + 0.5f64.asin() / TAU;
        assert!((bivariate_cdf(0.0, 0.0, 0.5, &rule) - at_zero).abs() < 1e-7);
    }

    #[test]
    fn a_blurred_disc_keeps_its_light() {
        for (radius, sigma) in [(0.8, 0.76), (3.6, 0.76), (8.9, 0.5), (61.5, 0.76)] {
            let disc = BlurredDisc::new(radius, sigma);
            let step = 0.01;
            let count = (disc.reach_px() / step) as usize;
            let light: f64 = (0..count)
                .map(|index| {
                    let distance = (index as f64 + 0.5) * step;
                    TAU * distance * step * f64::from(disc.coverage_at((distance * distance) as f32))
                })
                .sum();
            let area = PI * radius * radius;
            assert!((light / area - 1.0).abs() < 3e-4, "radius {radius}: {light} of {area}");
        }
    }

    #[test]
    fn a_blurred_disc_meets_brute_force_summation() {
        let (radius, sigma) = (1.3, 0.7);
        let disc = BlurredDisc::new(radius, sigma);
        for distance in [0.0, 0.5, 1.3, 2.4] {
            let step = 0.02;
            let mut sum = 0.0;
            for row in -80..80 {
                for column in -80..80 {
                    let (x, y) = ((f64::from(column) + 0.5) * step, (f64::from(row) + 0.5) * step);
                    if x * x + y * y < radius * radius {
                        let far = (x - distance).powi(2) + y * y;
                        sum += step * step * (-far / (2.0 * sigma * sigma)).exp() / (TAU * sigma * sigma);
                    }
                }
            }
            let coverage = f64::from(disc.coverage_at((distance * distance) as f32));
            assert!((coverage - sum).abs() < 1e-3, "{distance}: {coverage} {sum}");
        }
    }
}
