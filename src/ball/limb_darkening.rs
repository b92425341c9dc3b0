//! Limb darkening of a ball and its effect on the outline.
//!
//! A sphere that darkens towards its limb looks smaller on a dark background and larger on a bright one. Within the
//! blur of the lens its brightness falls to the rim like a square root, which the fitted step takes for a part of the
//! edge. The rim alone does not separate this from blur. Over the whole disc, the brightness of the bare ball between
//! its marks shows it.

use nalgebra::{Matrix4, Vector4};

use super::annulus::{LANES, Lane, Outline};
use super::ransac::RoughCircle;
use crate::image::ImageView;
use crate::numeric::{SIGMA_PER_MEDIAN, nth_smallest};
use crate::results::Estimate;

/// The number of sectors of cells around the centre.
pub(super) const SECTORS: usize = 8;
/// The inner and outer radii of the rings of cells, in radii of the ball.
const RINGS: [[f64; 2]; 6] = [[0.15, 0.40], [0.42, 0.60], [0.61, 0.72], [0.73, 0.82], [0.83, 0.89], [0.90, 0.95]];
const BLOCKS: usize = RINGS.len() * SECTORS / LANES;
/// The number of sampled pixels per cell.
const SAMPLES: usize = 16;
/// The rank of the highest and of the lowest level of a cell.
const RANK: usize = 3;
/// The number of rounds of reweighting.
const ROUNDS: usize = 3;
/// The residual of zero weight in robust standard deviations (Tukey's biweight).
const TUKEY: f32 = 4.0;
/// The margin of the cells to the rim, where they mix with the background: in blurs, and half a pixel, px.
const BLUR_MARGIN: f64 = 2.0;
const PIXEL_MARGIN_PX: f64 = 0.5;
/// The minimum number of cells.
const MIN_CELLS: f64 = 12.0;
/// The minimum standard deviation of a cell, because of whole grey levels, grey levels.
const MIN_SCATTER_DN: f64 = 0.5;
/// The minimum level of the ball, grey levels.
const MIN_LEVEL_DN: f64 = 8.0;
/// The side light, relative to the centre, from which cells are levelled in a second pass.
const MAX_SIDE_LIGHT: f32 = 0.05;
/// The minimum light relative to the centre.
const MIN_LIGHT_FRACTION: f32 = 0.05;
/// The uncertainty of the darkening from which the other marks are not tried.
const GOOD_SIGMA: f64 = 0.03;
/// The prior uncertainty of the darkening, for balls between flat and darkened by 30 %.
const PRIOR_SIGMA: f64 = 0.17;
/// The uncertainty of the darkening because of shading that differs from the model.
const MODEL_SIGMA: f64 = 0.01;
/// The relative uncertainty of the shift model.
const SHIFT_MODEL_ERROR: f64 = 0.1;
/// The shift of an edge, px^(1/2), and its slope with the blur, px^(-1/2), for a contrast equal to the brightness.
///
/// Simulated spheres with radii of 25 to 90 px, blurs of 0.5 to 1.4 px and darkenings of 10 to 30 % agree within 5 %.
const SHIFT_COEFFICIENTS: [f64; 2] = [0.328, 0.886];
/// The mean darkening over the blur, as a fraction of that at the rim.
const BLURRED_DARKENING: f64 = 0.91;
/// The depth inside the rim to which the fitted inside level belongs, px.
const INSIDE_DEPTH_PX: f64 = 1.5;
/// The minimum contrast at the rim, as a fraction of the fitted contrast, for which the shift is known.
const MIN_CONTRAST_FRACTION: f64 = 0.3;

/// The pixels of the cells of a block.
type Pixels = [Lane; SAMPLES];

/// Points on a ball, in radii from its centre: one of each cell of a block.
#[derive(Debug, Clone, Copy, Default)]
struct Points {
    x: Lane,
    y: Lane,
    /// 1 - depth, where the depth is that of the sphere towards the camera.
    shallow: Lane,
}

impl Points {
    /// Adds a point (x, y, 1 - depth) to the point of one cell.
    fn add(&mut self, lane: usize, point: [f32; 3]) {
        let [x, y, shallow] = point;
        self.x[lane] += x;
        self.y[lane] += y;
        self.shallow[lane] += shallow;
    }
}

/// The mean step along the rim.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    /// The grey level inside.
    pub inside: f64,
    /// The grey level inside minus that outside.
    pub contrast: f64,
    /// The blur, px.
    pub blur_px: f64,
}

/// The parts of a ball whose surface is visible.
#[derive(Debug, Clone, Copy)]
pub(super) struct VisibleRim {
    /// The visible sectors.
    pub sectors: [bool; SECTORS],
    /// The blur of its rim, px.
    pub blur_px: f64,
}

/// The brightness of the bare ball: `middle + x X + y Y - limb (1 - depth)`, grey levels.
#[derive(Debug, Clone, Copy)]
struct Light {
    x: f32,
    y: f32,
    limb: f32,
    middle: f32,
}

impl Light {
    /// Returns the brightness at one point of each cell, grey levels.
    #[inline(always)]
    fn levels_at(&self, points: &Points) -> Lane {
        // Never zero, since grey levels are divided by it.
        let min_level = MIN_LIGHT_FRACTION * self.middle;
        std::array::from_fn(|i| {
            (self.middle + self.x * points.x[i] + self.y * points.y[i] - self.limb * points.shallow[i]).max(min_level)
        })
    }
}

/// The cells, in radii of the ball, with scratch memory.
#[derive(Debug)]
pub(super) struct LimbDarkening {
    samples: [Vec<Points>; BLOCKS],
    /// The means of the samples of each cell.
    means: [Points; BLOCKS],
    residual: [Lane; BLOCKS],
    sorted: Vec<f32>,
}

impl Default for LimbDarkening {
    fn default() -> Self {
        let mut cells = Self {
            samples: std::array::from_fn(|_| vec![Points::default(); SAMPLES]),
            means: [Points::default(); BLOCKS],
            residual: [[0.0; LANES]; BLOCKS],
            sorted: Vec::new(),
        };
        for cell in 0..BLOCKS * LANES {
            let (block, lane) = (cell / LANES, cell % LANES);
            let [inner, outer] = RINGS[cell / SECTORS];
            for sample in 0..SAMPLES {
                // Equidistant in angle; an odd factor coprime to their number spreads them in radius.
                let along = (sample as f64 + 0.5) / SAMPLES as f64;
                let across = ((sample * 7 % SAMPLES) as f64 + 0.5) / SAMPLES as f64;
                let angle = ((cell % SECTORS) as f64 + along) * std::f64::consts::TAU / SECTORS as f64;
                let reach = inner + (outer - inner) * across;
                let (x, y) = (reach * angle.cos(), reach * angle.sin());
                let shallow = 1.0 - (1.0 - reach * reach).sqrt();
                cells.samples[block][sample].add(lane, [x, y, shallow].map(|value| value as f32));
                cells.means[block].add(lane, [x, y, shallow].map(|value| (value / SAMPLES as f64) as f32));
            }
        }
        cells
    }
}

impl LimbDarkening {
    /// Estimates the limb darkening: 0 for an evenly bright ball, 1 for a dark limb.
    ///
    /// The brightness of the bare ball is `A (1 + b x + c y - limb (1 - depth))`, where `depth` is that of the sphere
    /// towards the camera. This is exact for a uniform light from any side on a matt sphere (Lambert). It is read
    /// between the marks, at a high rank in every cell, or at a low one if the marks are brighter than the ball.
    /// `visible` limits the cells. Returns `None` if too little of the ball is visible.
    pub fn darkening(&mut self, image: ImageView<'_>, outline: &Outline, visible: VisibleRim) -> Option<Estimate> {
        let grey: [_; BLOCKS] = std::array::from_fn(|block| self.sample_levels(image, outline, block));
        let limit = 1.0 - (BLUR_MARGIN * visible.blur_px + PIXEL_MARGIN_PX) / outline.radius;
        let cells = usable_cells(&grey, visible.sectors, RINGS.map(|[_, outer]| outer <= limit));
        let flat = Light { x: 0.0, y: 0.0, limb: 0.0, middle: 1.0 };
        let (light, first) = self.estimate_under_light(&grey, cells, flat)?;
        let is_uneven = light.x.hypot(light.y) > MAX_SIDE_LIGHT * light.middle;
        // In an uneven cell the highest pixel is where the light is, so a second pass divides by the light.
        if is_uneven { self.estimate_under_light(&grey, cells, light).map(|(_, second)| second) } else { Some(first) }
    }

    /// Estimates the light and the darkening after each pixel is scaled to the middle of its cell under `light`.
    ///
    /// The more certain estimate of dark and bright marks is returned.
    fn estimate_under_light(
        &mut self,
        grey: &[Pixels; BLOCKS],
        cells: [Lane; BLOCKS],
        light: Light,
    ) -> Option<(Light, Estimate)> {
        let levels: [[Lane; 2]; BLOCKS] =
            std::array::from_fn(|block| extreme_levels(&grey[block], &self.samples[block], &self.means[block], light));
        let high = self.fit_light(&levels.map(|[high, _]| high), cells);
        if high.is_some_and(|(_, high)| high.sigma < GOOD_SIGMA) {
            return high;
        }
        let low = self.fit_light(&levels.map(|[_, low]| low), cells);
        [high, low].into_iter().flatten().min_by(|a, b| a.1.sigma.total_cmp(&b.1.sigma))
    }

    /// Returns the grey levels of the samples of a block; NaN outside the image.
    fn sample_levels(&self, image: ImageView<'_>, outline: &Outline, block: usize) -> Pixels {
        let circle =
            RoughCircle { x: outline.x as f32 + 0.5, y: outline.y as f32 + 0.5, radius: outline.radius as f32 };
        let places = sample_indices(&self.samples[block], circle, image.width(), image.height());
        places.map(|places| places.map(|at| image.data().get(at as usize).copied().unwrap_or(f32::NAN)))
    }

    /// Fits the light to the levels of all cells by reweighted least squares, and the darkening that it contains.
    ///
    /// `None` if too few cells agree or the ball is too dark.
    fn fit_light(&mut self, levels: &[Lane; BLOCKS], cells: [Lane; BLOCKS]) -> Option<(Light, Estimate)> {
        let mut weights = cells;
        for _ in 0..ROUNDS {
            let (answer, _) = self.solve(levels, &weights)?;
            self.update_residuals(levels, answer);
            let scale = self.residual_scale(&cells)?;
            for (block, weight) in weights.iter_mut().enumerate() {
                for (lane, weight) in weight.iter_mut().enumerate() {
                    let z = self.residual[block][lane] / (TUKEY * scale);
                    *weight = cells[block][lane] * (1.0 - z * z).max(0.0).powi(2);
                }
            }
        }
        let (answer, normal) = self.solve(levels, &weights)?;
        self.update_residuals(levels, answer);
        let each = || weights.iter().flatten().zip(self.residual.iter().flatten());
        let count: f64 = each().map(|(weight, _)| f64::from(*weight)).sum();
        let residual_sum: f64 = each().map(|(weight, residual)| f64::from(weight * residual * residual)).sum();
        if count < MIN_CELLS || answer[3] < MIN_LEVEL_DN {
            return None;
        }
        let scatter = (residual_sum / (count - 4.0)).sqrt().max(MIN_SCATTER_DN);
        let covariance = normal.try_inverse()?;
        let limb = -answer[2] / answer[3];
        // The variance of the quotient of two correlated values.
        let variance = covariance[(2, 2)] + limb * (2.0 * covariance[(2, 3)] + limb * covariance[(3, 3)]);
        let [x, y, depth_slope, middle]: [f32; 4] = answer.cast().into();
        let light = Light { x, y, limb: -depth_slope, middle };
        Some((
            light,
            Estimate { value: limb, sigma: (scatter * variance.max(0.0).sqrt() / answer[3]).hypot(MODEL_SIGMA) },
        ))
    }

    /// Fits level = a x + b y + c (1 - depth) + d by weighted least squares.
    ///
    /// Returns (a, b, c, d) and the normal matrix; `None` if that is not positive definite.
    fn solve(&self, levels: &[Lane; BLOCKS], weights: &[Lane; BLOCKS]) -> Option<(Vector4<f64>, Matrix4<f64>)> {
        let mut sums = [[0.0_f32; LANES]; 14];
        for ((level, weight), means) in levels.iter().zip(weights).zip(&self.means) {
            for i in 0..LANES {
                // Excluded cells may hold NaN.
                let (w, v) = (weight[i], if weight[i] > 0.0 { level[i] } else { 0.0 });
                let row = [means.x[i], means.y[i], means.shallow[i], 1.0];
                let mut at = 0;
                for a in 0..4 {
                    for b in a..4 {
                        sums[at][i] += w * row[a] * row[b];
                        at += 1;
                    }
                    sums[10 + a][i] += w * row[a] * v;
                }
            }
        }
        let sum = sums.map(|lanes| lanes.iter().map(|v| f64::from(*v)).sum::<f64>());
        let [xx, xy, xz, x, yy, yz, y, zz, z, one, right @ ..] = sum;
        let normal = Matrix4::new(xx, xy, xz, x, xy, yy, yz, y, xz, yz, zz, z, x, y, z, one);
        Some((normal.cholesky()?.solve(&Vector4::from(right)), normal))
    }

    /// Computes the residuals of the levels from a fit (a, b, c, d), grey levels; 0 for excluded cells without a
    /// level.
    fn update_residuals(&mut self, levels: &[Lane; BLOCKS], answer: Vector4<f64>) {
        let [a, b, c, d]: [f32; 4] = answer.cast().into();
        for ((residual, level), means) in self.residual.iter_mut().zip(levels).zip(&self.means) {
            for i in 0..LANES {
                let difference = level[i] - (a * means.x[i] + b * means.y[i] + c * means.shallow[i] + d);
                residual[i] = if difference.is_finite() { difference } else { 0.0 };
            }
        }
    }

    /// Returns the robust standard deviation of the residuals, grey levels; `None` without cells.
    fn residual_scale(&mut self, cells: &[Lane; BLOCKS]) -> Option<f32> {
        let each = self.residual.iter().flatten().zip(cells.iter().flatten());
        self.sorted.clear();
        self.sorted.extend(each.filter(|(_, cell)| **cell > 0.0).map(|(residual, _)| residual.abs()));
        let middle = self.sorted.len() / 2;
        (!self.sorted.is_empty()).then(|| (SIGMA_PER_MEDIAN as f32 * nth_smallest(&mut self.sorted, middle)).max(1e-3))
    }
}

/// Returns the indices of the samples in the data of the image; -1 outside the image, which no index matches.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn sample_indices(samples: &[Points], circle: RoughCircle, width: usize, height: usize) -> [[i32; LANES]; SAMPLES] {
    let (right, bottom, row) = (width as f32, height as f32, width as i32);
    let mut places = [[-1; LANES]; SAMPLES];
    for (places, Points { x: dx, y: dy, .. }) in places.iter_mut().zip(samples) {
        for i in 0..LANES {
            let (x, y) = (circle.x + circle.radius * dx[i], circle.y + circle.radius * dy[i]);
            // `&` evaluates all four: branches would prevent vectorization.
            let is_inside = (x >= 0.0) & (x < right) & (y >= 0.0) & (y < bottom);
            let at = (y as i32).wrapping_mul(row).wrapping_add(x as i32);
            places[i] = if is_inside { at } else { -1 };
        }
    }
    places
}

/// Returns 1 for usable cells, 0 for cells that are occluded, blurred by the rim, across the border or clipped.
///
/// If the brightest pixels of a cell equal the brightest on the ball, they may be saturated. A clipped ball looks flat.
fn usable_cells(grey: &[Pixels; BLOCKS], is_visible: [bool; SECTORS], is_clear: [bool; RINGS.len()]) -> [Lane; BLOCKS] {
    let brightest = grey.iter().flatten().flatten().copied().fold(f32::NEG_INFINITY, f32::max);
    std::array::from_fn(|block| {
        let pixels = &grey[block];
        let (mut clipped, mut sum) = ([0.0_f32; LANES], [0.0_f32; LANES]);
        for grey in pixels {
            for i in 0..LANES {
                clipped[i] += if grey[i] >= brightest { 1.0 } else { 0.0 };
                sum[i] += grey[i];
            }
        }
        // A NaN among the summands makes the sum NaN.
        let is_usable = |i: usize| {
            let is_included = is_visible[i % SECTORS] && is_clear[(block * LANES + i) / SECTORS];
            is_included && sum[i].is_finite() && clipped[i] < RANK as f32
        };
        std::array::from_fn(|i| if is_usable(i) { 1.0 } else { 0.0 })
    })
}

/// Returns the third highest and the third lowest pixel of each cell, each scaled to the middle of its cell.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn extreme_levels(grey: &Pixels, samples: &[Points], middle: &Points, light: Light) -> [Lane; 2] {
    let mut high = [[f32::NEG_INFINITY; LANES]; RANK];
    let mut low = [[f32::INFINITY; LANES]; RANK];
    let middles = light.levels_at(middle);
    for (grey, sample) in grey.iter().zip(samples) {
        let here = light.levels_at(sample);
        for i in 0..LANES {
            let level = grey[i] * middles[i] / here[i];
            let (mut top, mut bottom) = (level, level);
            for rank in 0..RANK {
                let (above, below) = (high[rank][i], low[rank][i]);
                (high[rank][i], top) = if top > above { (top, above) } else { (above, top) };
                (low[rank][i], bottom) = if bottom < below { (bottom, below) } else { (below, bottom) };
            }
        }
    }
    [high[RANK - 1], low[RANK - 1]]
}

/// The distance by which the edge of a disc lies outside the steps fitted to its rim.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shift {
    /// The correction of the radius, px; its uncertainty includes that of the darkening.
    pub rim: Estimate,
    /// The part of it caused by the darkening, px.
    darkening: Estimate,
    /// The relative change of that part per grey level of brightness inside.
    by_level: f64,
}

impl Shift {
    /// Returns the correction of the centre towards the brighter side, px, for a side light in grey levels.
    ///
    /// The uncertainty includes the neglected second-order term in the amplitude.
    pub fn center_correction(&self, brighter: f64) -> Estimate {
        let share = self.by_level * brighter;
        Estimate {
            value: self.darkening.value * share,
            sigma: (self.darkening.sigma * share).hypot(self.darkening.value * share * share),
        }
    }
}

/// Computes the shift of the edge by limb darkening and by blur, px.
///
/// Blur pulls the edge of a disc in by blur^2 / (2 radius). The darkening is combined with its prior.
pub(super) fn edge_shift(darkening: Option<Estimate>, radius_px: f64, step: Step) -> Shift {
    let bend_px = step.blur_px.powi(2) / (2.0 * radius_px);
    let posterior = darkening.map_or(Estimate { value: 0.0, sigma: PRIOR_SIGMA }, |measured| {
        let share = PRIOR_SIGMA.powi(2) / (PRIOR_SIGMA.powi(2) + measured.sigma.powi(2));
        Estimate { value: share * measured.value, sigma: share.sqrt() * measured.sigma }
    });
    let limb = posterior.value.clamp(0.0, 1.0);
    let bare = step.inside / (1.0 - limb * (1.0 - (2.0 * INSIDE_DEPTH_PX / radius_px).sqrt().min(1.0)));
    let outside = step.inside - step.contrast;
    // The fraction of the contrast left at the rim.
    let contrast_fraction = (bare * (1.0 - BLURRED_DARKENING * limb) - outside) / step.contrast;
    let pull_px = (SHIFT_COEFFICIENTS[0] + SHIFT_COEFFICIENTS[1] * step.blur_px) / radius_px.sqrt() * bare
        / (step.contrast * contrast_fraction.max(MIN_CONTRAST_FRACTION));
    let darkening_px = if contrast_fraction >= MIN_CONTRAST_FRACTION { pull_px * limb } else { 0.0 };
    let model_error_px =
        if contrast_fraction >= MIN_CONTRAST_FRACTION { SHIFT_MODEL_ERROR * darkening_px } else { pull_px * limb };
    let darkening_shift = Estimate { value: darkening_px, sigma: (pull_px * posterior.sigma).hypot(model_error_px) };
    let by_level = -outside / (step.inside.max(1.0) * step.contrast * contrast_fraction.max(MIN_CONTRAST_FRACTION));
    Shift { rim: Estimate { value: bend_px + darkening_px, ..darkening_shift }, darkening: darkening_shift, by_level }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 140;
    const OUTLINE: Outline = Outline { x: 70.3, y: 68.9, radius: 57.2 };

    /// Draws a ball that darkens by `limb`, lit from the right, with marks on 30 % of it of brightness `through`.
    fn ball(limb: f64, through: f64) -> Vec<f32> {
        let mut image = vec![0.0; SIDE * SIDE];
        for y in 0..SIDE {
            for x in 0..SIDE {
                let (dx, dy) = ((x as f64 - OUTLINE.x) / OUTLINE.radius, (y as f64 - OUTLINE.y) / OUTLINE.radius);
                let depth = (1.0 - dx * dx - dy * dy).max(0.0).sqrt();
                let is_mark = (x / 4 * 7919 + y / 4 * 104_729 + x * y / 16) % 10 < 3;
                let light = 1.0 + 0.2 * dx - limb * (1.0 - depth);
                let grey = 150.0 * light * if is_mark { through } else { 1.0 };
                image[y * SIDE + x] = grey.round() as f32;
            }
        }
        image
    }

    fn darkening(image: &[f32], width: usize, is_visible: [bool; SECTORS]) -> Option<Estimate> {
        let view = ImageView::new(image, width, image.len() / width).unwrap();
        LimbDarkening::default().darkening(view, &OUTLINE, VisibleRim { sectors: is_visible, blur_px: 0.7 })
    }

    #[test]
    fn the_darkening_is_measured_between_dark_and_bright_marks() {
        for through in [0.3, 1.6] {
            for limb in [0.0, 0.15, 0.3, 0.8] {
                let found = darkening(&ball(limb, through), SIDE, [true; SECTORS]).unwrap();
                assert!((found.value - limb).abs() < 0.02 && found.sigma < 0.03, "{through}, {limb}: {found:?}");
            }
        }
    }

    #[test]
    fn a_clipped_ball_is_not_taken_for_a_flat_one() {
        for exposure in [1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.2, 2.5] {
            let clipped: Vec<f32> = ball(0.3, 0.3).iter().map(|grey| (exposure * grey).min(255.0)).collect();
            let found = darkening(&clipped, SIDE, [true; SECTORS]);
            assert!(found.is_none_or(|found| (found.value - 0.3).abs() < 2.0 * found.sigma), "{exposure}: {found:?}");
        }
    }

    #[test]
    fn an_occluder_is_left_out() {
        let mut image = ball(0.2, 0.3);
        image[..SIDE * SIDE / 3].fill(240.0);
        let seen = std::array::from_fn(|sector| sector < SECTORS / 2);
        let found = darkening(&image, SIDE, seen).unwrap();
        assert!((found.value - 0.2).abs() < 0.04, "{found:?}");
        assert!(darkening(&image, SIDE, [false; SECTORS]).is_none());
    }

    #[test]
    fn a_ball_across_the_image_border_is_measured_by_what_is_inside() {
        let width = 90;
        let cut: Vec<f32> = ball(0.2, 0.3).chunks(SIDE).flat_map(|row| row[..width].to_vec()).collect();
        let found = darkening(&cut, width, [true; SECTORS]).unwrap();
        assert!((found.value - 0.2).abs() < 0.04, "{found:?}");
    }

    #[test]
    fn without_a_visible_surface_the_shift_is_as_uncertain_as_balls_differ() {
        let step = Step { inside: 150.0, contrast: 110.0, blur_px: 0.8 };
        let (blind, seen) = (edge_shift(None, 57.0, step).rim, |limb| Some(Estimate { value: limb, sigma: 0.01 }));
        let flat = edge_shift(seen(0.0), 57.0, step).rim;
        let dark = edge_shift(seen(0.3), 57.0, step).rim;
        assert!((blind.value - flat.value).abs() < 1e-12 && blind.sigma > 10.0 * flat.sigma);
        assert!(dark.value > flat.value + 0.04 && dark.value < flat.value + 0.15, "{dark:?}");
        // On a background brighter than the ball the same pull acts inwards.
        let darker = edge_shift(seen(0.3), 57.0, Step { contrast: -110.0, ..step }).rim;
        assert!(darker.value < flat.value, "{darker:?}");
        assert!(edge_shift(seen(0.3), 57.0, Step { contrast: 30.0, ..step }).rim.sigma > dark.sigma);
    }
}
