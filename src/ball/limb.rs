//! How much a ball darkens towards its limb, and what that does to its outline.
//!
//! A sphere that darkens towards its limb looks smaller on dark ground and larger on bright ground: within the blur of
//! the lens its brightness falls to the rim like a root, which a step takes for a part of the edge. Along the rim alone
//! this cannot be told from blur, but over the whole disc the brightness of the bare ball between its marks shows it.

use nalgebra::{Matrix4, Vector4};

use super::rank::nth_smallest;
use super::rim::{LANES, Lane, Outline};
use crate::image::ImageView;
use crate::results::Estimate;

/// Cells around the centre.
pub(super) const SECTORS: usize = 8;
/// Rings of cells, in radii.
const RINGS: [[f64; 2]; 6] = [[0.15, 0.40], [0.42, 0.60], [0.61, 0.72], [0.73, 0.82], [0.83, 0.89], [0.90, 0.95]];
const BLOCKS: usize = RINGS.len() * SECTORS / LANES;
/// Pixels looked at in each cell.
const SAMPLES: usize = 16;
/// The highest and the lowest level of a cell are read at this rank.
const RANK: usize = 3;
/// Rounds of reweighting.
const ROUNDS: usize = 3;
/// Residuals beyond this many robust standard deviations count nothing (Tukey).
const TUKEY: f32 = 4.0;
/// Standard deviations in a median of sizes.
const FROM_MEDIAN: f32 = 1.4826;
/// Cells nearer to the rim than this tell of the ground, too: within so many blurs, and a pixel's half, px.
const CLEAR_OF_BLUR: f64 = 2.0;
const CLEAR_PX: f64 = 0.5;
/// Fewest cells.
const LEAST_CELLS: f64 = 12.0;
/// Whole grey levels tell no more of a cell than this, grey levels.
const LEAST_SCATTER: f64 = 0.5;
/// Levels lower than this tell nothing, grey levels.
const LEAST_LEVEL: f64 = 8.0;
/// Light that differs by more from the middle to the rim makes cells uneven, share.
const UNEVEN: f32 = 0.05;
/// And where it is less than this share of the middle's it tells nothing.
const DARKEST: f32 = 0.05;
/// A darkening known as well as this needs no second look.
const CLEAR: f64 = 0.03;
/// What is not known of the darkening where it cannot be seen, of balls between flat and darkened by 30 %.
const UNSEEN: f64 = 0.17;
/// Other shades than the model's are taken for a darkening of about this.
const UNLIKE: f64 = 0.01;
/// The model of the shift is right to this share.
const SHIFT_SHARE: f64 = 0.1;
/// The shift of an edge for a contrast as large as the ball's brightness, px^(1/2), and with the blur, px^(-1/2):
/// simulated spheres with radii of 25 to 90 px, blurred by 0.5 to 1.4 px and darkened by 10 to 30 %, agree within 5 %.
const SHIFT: [f64; 2] = [0.328, 0.886];
/// And count the darkening over the blur for this share of what it is at the rim.
const OVER_BLUR: f64 = 0.91;
/// Depth inside the rim, px, at which the inside's brightness is read by the steps there.
const READ_PX: f64 = 1.5;
/// Rims whose contrast the darkening takes away to less than this share of what is seen have no known shift.
const LEAST_CONTRAST: f64 = 0.3;

/// The pixels of the cells of a block.
type Pixels = [Lane; SAMPLES];

/// A step along the rim, on average.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    /// Grey level inside.
    pub inside: f64,
    /// Inside minus outside, grey levels.
    pub contrast: f64,
    /// Blur, px.
    pub blur_px: f64,
}

/// Where a ball's surface may be read.
#[derive(Debug, Clone, Copy)]
pub(super) struct InSight {
    /// The sectors that show it.
    pub sectors: [bool; SECTORS],
    /// Blur of its rim, px.
    pub blur_px: f64,
}

/// How bright bare ball is: `middle + x X + y Y - limb (1 - depth)`, grey levels.
#[derive(Debug, Clone, Copy)]
struct Light {
    x: f32,
    y: f32,
    limb: f32,
    middle: f32,
}

impl Light {
    #[inline(always)]
    fn at(&self, [x, y, shallow]: &[Lane; 3]) -> Lane {
        // Never quite dark: grey levels are divided by it.
        let least = DARKEST * self.middle;
        std::array::from_fn(|i| (self.middle + self.x * x[i] + self.y * y[i] - self.limb * shallow[i]).max(least))
    }
}

/// Where the cells are, in radii, and scratch.
#[derive(Debug)]
pub(super) struct Limb {
    /// Of the samples x, y and 1 - depth.
    samples: [Vec<[Lane; 3]>; BLOCKS],
    /// Means over each cell of the same.
    means: [[Lane; 3]; BLOCKS],
    residual: [Lane; BLOCKS],
    sorted: Vec<f32>,
}

impl Default for Limb {
    fn default() -> Self {
        let mut limb = Self {
            samples: std::array::from_fn(|_| vec![[[0.0; LANES]; 3]; SAMPLES]),
            means: [[[0.0; LANES]; 3]; BLOCKS],
            residual: [[0.0; LANES]; BLOCKS],
            sorted: Vec::new(),
        };
        for cell in 0..BLOCKS * LANES {
            let (block, lane) = (cell / LANES, cell % LANES);
            let [inner, outer] = RINGS[cell / SECTORS];
            for sample in 0..SAMPLES {
                // Even in angle; an odd number that shares no factor with theirs spreads them in depth.
                let along = (sample as f64 + 0.5) / SAMPLES as f64;
                let across = ((sample * 7 % SAMPLES) as f64 + 0.5) / SAMPLES as f64;
                let angle = ((cell % SECTORS) as f64 + along) * std::f64::consts::TAU / SECTORS as f64;
                let reach = inner + (outer - inner) * across;
                let (x, y) = (reach * angle.cos(), reach * angle.sin());
                for (k, of) in [x, y, 1.0 - (1.0 - reach * reach).sqrt()].into_iter().enumerate() {
                    limb.samples[block][sample][k][lane] = of as f32;
                    limb.means[block][k][lane] += (of / SAMPLES as f64) as f32;
                }
            }
        }
        limb
    }
}

impl Limb {
    /// The share of its light that a ball lacks at the limb: 0 when it is evenly bright, 1 when it is dark there.
    ///
    /// The brightness of bare ball is `A (1 + b x + c y - limb (1 - depth))`, depth being that of the sphere towards
    /// the camera: exact for an even light from any side on a matt sphere (Lambert). It is read between the marks: at
    /// high rank in every cell, or where the marks are brighter than the ball, at low. `sight` tells where that may be.
    /// `None` where too little of the ball is seen.
    pub fn darkening(&mut self, image: ImageView<'_>, outline: &Outline, sight: InSight) -> Option<Estimate> {
        let grey: [_; BLOCKS] = std::array::from_fn(|block| self.gather(image, outline, block));
        let clear = 1.0 - (CLEAR_OF_BLUR * sight.blur_px + CLEAR_PX) / outline.radius;
        let cells = usable(&grey, sight.sectors, RINGS.map(|[_, outer]| outer <= clear));
        let flat = Light { x: 0.0, y: 0.0, limb: 0.0, middle: 1.0 };
        let (light, first) = self.look(&grey, cells, flat)?;
        let is_uneven = light.x.hypot(light.y) > UNEVEN * light.middle;
        // Across an uneven cell the highest is where the light is: once more with that taken out.
        if is_uneven { self.look(&grey, cells, light).map(|(_, second)| second) } else { Some(first) }
    }

    /// What the cells tell when each pixel counts as it would in the middle of its cell, in such a light.
    fn look(&mut self, grey: &[Pixels; BLOCKS], cells: [Lane; BLOCKS], light: Light) -> Option<(Light, Estimate)> {
        let levels: [[Lane; 2]; BLOCKS] =
            std::array::from_fn(|block| rank(&grey[block], &self.samples[block], &self.means[block], light));
        let high = self.fit(&levels.map(|[high, _]| high), cells);
        if high.is_some_and(|(_, high)| high.sigma < CLEAR) {
            return high;
        }
        let low = self.fit(&levels.map(|[_, low]| low), cells);
        [high, low].into_iter().flatten().min_by(|a, b| a.1.sigma.total_cmp(&b.1.sigma))
    }

    /// The grey levels of the samples of a block; not numbers outside of the image.
    fn gather(&self, image: ImageView<'_>, outline: &Outline, block: usize) -> Pixels {
        let circle = [outline.x as f32 + 0.5, outline.y as f32 + 0.5, outline.radius as f32];
        let places = places(&self.samples[block], circle, image.width(), image.height());
        places.map(|places| places.map(|at| image.data().get(at as usize).copied().unwrap_or(f32::NAN)))
    }

    /// Reweighted least squares through the levels of all cells.
    fn fit(&mut self, levels: &[Lane; BLOCKS], cells: [Lane; BLOCKS]) -> Option<(Light, Estimate)> {
        let mut weights = cells;
        for _ in 0..ROUNDS {
            let (answer, _) = self.solve(levels, &weights)?;
            self.leave(levels, answer);
            let scale = self.scale(&cells)?;
            for (block, weight) in weights.iter_mut().enumerate() {
                for (lane, weight) in weight.iter_mut().enumerate() {
                    let z = self.residual[block][lane] / (TUKEY * scale);
                    *weight = cells[block][lane] * (1.0 - z * z).max(0.0).powi(2);
                }
            }
        }
        let (answer, normal) = self.solve(levels, &weights)?;
        self.leave(levels, answer);
        let each = || weights.iter().flatten().zip(self.residual.iter().flatten());
        let count: f64 = each().map(|(weight, _)| f64::from(*weight)).sum();
        let left: f64 = each().map(|(weight, residual)| f64::from(weight * residual * residual)).sum();
        if count < LEAST_CELLS || answer[3] < LEAST_LEVEL {
            return None;
        }
        let scatter = (left / (count - 4.0)).sqrt().max(LEAST_SCATTER);
        let covariance = normal.try_inverse()?;
        let limb = -answer[2] / answer[3];
        // Of the quotient, both with their covariance.
        let variance = covariance[(2, 2)] + limb * (2.0 * covariance[(2, 3)] + limb * covariance[(3, 3)]);
        let [x, y, of_depth, middle]: [f32; 4] = answer.cast().into();
        let light = Light { x, y, limb: -of_depth, middle };
        Some((light, Estimate { value: limb, sigma: (scatter * variance.max(0.0).sqrt() / answer[3]).hypot(UNLIKE) }))
    }

    /// Level = a x + b y + c (1 - depth) + d: a to d, and the normal matrix.
    fn solve(&self, levels: &[Lane; BLOCKS], weights: &[Lane; BLOCKS]) -> Option<(Vector4<f64>, Matrix4<f64>)> {
        let mut sums = [[0.0_f32; LANES]; 14];
        for ((level, weight), means) in levels.iter().zip(weights).zip(&self.means) {
            for i in 0..LANES {
                // Cells that are left out may hold no number.
                let (w, v) = (weight[i], if weight[i] > 0.0 { level[i] } else { 0.0 });
                let row = [means[0][i], means[1][i], means[2][i], 1.0];
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

    fn leave(&mut self, levels: &[Lane; BLOCKS], answer: Vector4<f64>) {
        let [a, b, c, d]: [f32; 4] = answer.cast().into();
        for ((residual, level), [x, y, z]) in self.residual.iter_mut().zip(levels).zip(&self.means) {
            for i in 0..LANES {
                let left = level[i] - (a * x[i] + b * y[i] + c * z[i] + d);
                residual[i] = if left.is_finite() { left } else { 0.0 };
            }
        }
    }

    /// Robust standard deviation of the residuals, grey levels.
    fn scale(&mut self, cells: &[Lane; BLOCKS]) -> Option<f32> {
        let each = self.residual.iter().flatten().zip(cells.iter().flatten());
        self.sorted.clear();
        self.sorted.extend(each.filter(|(_, cell)| **cell > 0.0).map(|(residual, _)| residual.abs()));
        let middle = self.sorted.len() / 2;
        (!self.sorted.is_empty()).then(|| (FROM_MEDIAN * nth_smallest(&mut self.sorted, middle)).max(1e-3))
    }
}

/// Where in the image's data the samples lie; -1, which as a place is beyond all data, outside of it.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn places(samples: &[[Lane; 3]], [x, y, radius]: [f32; 3], width: usize, height: usize) -> [[i32; LANES]; SAMPLES] {
    let (right, bottom, row) = (width as f32, height as f32, width as i32);
    let mut places = [[-1; LANES]; SAMPLES];
    for (places, [dx, dy, _]) in places.iter_mut().zip(samples) {
        for i in 0..LANES {
            let (x, y) = (x + radius * dx[i], y + radius * dy[i]);
            // All four are looked at: branches would stop the lanes.
            let is_inside = (x >= 0.0) & (x < right) & (y >= 0.0) & (y < bottom);
            let at = (y as i32).wrapping_mul(row).wrapping_add(x as i32);
            places[i] = if is_inside { at } else { -1 };
        }
    }
    places
}

/// 1 for the cells that tell something, 0 for those out of sight, in the blur of the rim, across the border of the image,
/// or clipped.
///
/// Where the brightest pixels of a cell are all as bright as any on the ball, they may be as bright as a pixel can be:
/// a clipped ball looks flat.
fn usable(grey: &[Pixels; BLOCKS], is_seen: [bool; SECTORS], is_clear: [bool; RINGS.len()]) -> [Lane; BLOCKS] {
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
        // A sum with one in it that is no number is none.
        let is_usable = |i: usize| {
            let is_open = is_seen[i % SECTORS] && is_clear[(block * LANES + i) / SECTORS];
            is_open && sum[i].is_finite() && clipped[i] < RANK as f32
        };
        std::array::from_fn(|i| if is_usable(i) { 1.0 } else { 0.0 })
    })
}

/// The third highest and the third lowest of the pixels of each cell, each as it would be in the middle of its cell.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn rank(grey: &Pixels, samples: &[[Lane; 3]], middle: &[Lane; 3], light: Light) -> [Lane; 2] {
    let mut high = [[f32::NEG_INFINITY; LANES]; RANK];
    let mut low = [[f32::INFINITY; LANES]; RANK];
    let middles = light.at(middle);
    for (grey, sample) in grey.iter().zip(samples) {
        let here = light.at(sample);
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

/// By how much the edge of a disc lies farther out than steps across its rim tell.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shift {
    /// Of the radius, px; the uncertainty holds that of the darkening.
    pub rim: Estimate,
    /// What the darkening has of it, px.
    told: Estimate,
    /// By which share of that it changes for each grey level that the inside is brighter.
    by_level: f64,
}

impl Shift {
    /// Where the inside is brighter by so many grey levels at one side, and darker at the other: of the centre towards the
    /// brighter one, px. What the next power would add is in the uncertainty.
    pub fn center(&self, brighter: f64) -> Estimate {
        let share = self.by_level * brighter;
        Estimate {
            value: self.told.value * share,
            sigma: (self.told.sigma * share).hypot(self.told.value * share * share),
        }
    }
}

/// Gaussian blur pulls the edge of a disc in by blur^2 / (2 radius), besides what the darkening does.
pub(super) fn shift_px(darkening: Option<Estimate>, radius_px: f64, step: Step) -> Shift {
    let bend_px = step.blur_px.powi(2) / (2.0 * radius_px);
    let seen = darkening.map_or(Estimate { value: 0.0, sigma: UNSEEN }, |seen| {
        let share = UNSEEN.powi(2) / (UNSEEN.powi(2) + seen.sigma.powi(2));
        Estimate { value: share * seen.value, sigma: share.sqrt() * seen.sigma }
    });
    let limb = seen.value.clamp(0.0, 1.0);
    let bare = step.inside / (1.0 - limb * (1.0 - (2.0 * READ_PX / radius_px).sqrt().min(1.0)));
    let outside = step.inside - step.contrast;
    // What is left of the contrast at the rim.
    let left = (bare * (1.0 - OVER_BLUR * limb) - outside) / step.contrast;
    let pull_px =
        (SHIFT[0] + SHIFT[1] * step.blur_px) / radius_px.sqrt() * bare / (step.contrast * left.max(LEAST_CONTRAST));
    let told_px = if left >= LEAST_CONTRAST { pull_px * limb } else { 0.0 };
    let doubt_px = if left >= LEAST_CONTRAST { SHIFT_SHARE * told_px } else { pull_px * limb };
    let told = Estimate { value: told_px, sigma: (pull_px * seen.sigma).hypot(doubt_px) };
    let by_level = -outside / (step.inside.max(1.0) * step.contrast * left.max(LEAST_CONTRAST));
    Shift { rim: Estimate { value: bend_px + told_px, ..told }, told, by_level }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 140;
    const OUTLINE: Outline = Outline { x: 70.3, y: 68.9, radius: 57.2 };

    /// A ball that darkens by `limb`, lit from the right, with marks on 30 % of it that let `through` of its light out.
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

    fn told(image: &[f32], width: usize, is_seen: [bool; SECTORS]) -> Option<Estimate> {
        let view = ImageView::new(image, width, image.len() / width).unwrap();
        Limb::default().darkening(view, &OUTLINE, InSight { sectors: is_seen, blur_px: 0.7 })
    }

    #[test]
    fn the_darkening_is_told_between_dark_and_bright_marks() {
        for through in [0.3, 1.6] {
            for limb in [0.0, 0.15, 0.3, 0.8] {
                let found = told(&ball(limb, through), SIDE, [true; SECTORS]).unwrap();
                assert!((found.value - limb).abs() < 0.02 && found.sigma < 0.03, "{through}, {limb}: {found:?}");
            }
        }
    }

    #[test]
    fn a_clipped_ball_is_not_taken_for_a_flat_one() {
        for exposure in [1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.2, 2.5] {
            let clipped: Vec<f32> = ball(0.3, 0.3).iter().map(|grey| (exposure * grey).min(255.0)).collect();
            let found = told(&clipped, SIDE, [true; SECTORS]);
            assert!(found.is_none_or(|found| (found.value - 0.3).abs() < 2.0 * found.sigma), "{exposure}: {found:?}");
        }
    }

    #[test]
    fn what_hides_the_ball_is_left_out() {
        let mut image = ball(0.2, 0.3);
        image[..SIDE * SIDE / 3].fill(240.0);
        let seen = std::array::from_fn(|sector| sector < SECTORS / 2);
        let found = told(&image, SIDE, seen).unwrap();
        assert!((found.value - 0.2).abs() < 0.04, "{found:?}");
        assert!(told(&image, SIDE, [false; SECTORS]).is_none());
    }

    #[test]
    fn a_ball_across_the_border_of_the_image_is_told_by_what_is_inside() {
        let width = 90;
        let cut: Vec<f32> = ball(0.2, 0.3).chunks(SIDE).flat_map(|row| row[..width].to_vec()).collect();
        let found = told(&cut, width, [true; SECTORS]).unwrap();
        assert!((found.value - 0.2).abs() < 0.04, "{found:?}");
    }

    #[test]
    fn without_a_look_at_the_ball_the_shift_is_as_unsure_as_balls_differ() {
        let step = Step { inside: 150.0, contrast: 110.0, blur_px: 0.8 };
        let (blind, seen) = (shift_px(None, 57.0, step).rim, |limb| Some(Estimate { value: limb, sigma: 0.01 }));
        let flat = shift_px(seen(0.0), 57.0, step).rim;
        let dark = shift_px(seen(0.3), 57.0, step).rim;
        assert!((blind.value - flat.value).abs() < 1e-12 && blind.sigma > 10.0 * flat.sigma);
        assert!(dark.value > flat.value + 0.04 && dark.value < flat.value + 0.15, "{dark:?}");
        // Brighter ground than ball: the same pull, inwards.
        let darker = shift_px(seen(0.3), 57.0, Step { contrast: -110.0, ..step }).rim;
        assert!(darker.value < flat.value, "{darker:?}");
        assert!(shift_px(seen(0.3), 57.0, Step { contrast: 30.0, ..step }).rim.sigma > dark.sigma);
    }
}
