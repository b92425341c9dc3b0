//! The boundary of a textured ball: a circle through the outermost steps of brightness, whatever their sign.
//!
//! Where the background lies between the marks and the paint of a ball, or one side of it lies in the shade, no sign
//! prevails along its rim. Inside the ball there are steps everywhere. Outside there are hardly any as high.

use nalgebra::{Matrix3, Vector3};

use super::annulus::maximum;
use super::pyramid::GreyImage;
use super::ransac::{Ray, RoughCircle, can_interpolate, sample_line};
use super::texture_disc::{MIN_SIDE_PX, RadiusRange, log_levels};
use super::visible_fraction::{RimBin, fraction_in_image, unoccluded_fraction};
use crate::image::{ImageView, PixelRect, is_saturated};
use crate::numeric::{Xorshift, nth_smallest};
use crate::results::Circle;

/// The distance of two rays along the rim, px, and the limits of their number.
const RAY_STEP_PX: f64 = 2.5;
const RAYS: [usize; 2] = [40, 120];
/// The minimum heights of a step, as fractions of the median over the rays of the highest step.
///
/// The texture of the background decides which one separates it from the ball.
const MIN_STEPS: [f32; 4] = [0.2, 0.28, 0.4, 0.55];
/// The number of steps of each ray that may be the rim, from outside.
const OUTERMOST: usize = 2;
/// The maximum distance of a supporting step from the circle, px.
const TOLERANCE_PX: f64 = 0.7;
/// The distance outside the circle from which a step contradicts it, px.
const OUTSIDE_PX: f64 = 1.0;
/// The weight of contradicting rays, relative to supporting ones.
const OUTSIDE_WEIGHT: f64 = 0.5;
/// The number of circles tried for each height, and of draws for them.
const CIRCLES: usize = 500;
const DRAWS: usize = 4000;
/// The rounds of least squares.
const ROUNDS: usize = 6;
/// The number of sectors that are left out in turn, to see how far each of them moves the circle.
const SECTORS: usize = 6;
/// The minimum score of a ball with [`RAYS`] at most. Elsewhere in images, circles reach 0.06.
const MIN_SCORE: f64 = 0.13;
/// The number of independent rays, as a fraction of all: marks span neighbouring rays.
const INDEPENDENT_RAYS: f64 = 0.5;
const MIN_SIGMA_PX: f64 = 0.05;
/// The distance inside the rim from which a step is texture, px, its minimum height relative to the median of the
/// highest, and the minimum fraction of rays with such a step on a textured ball.
const INNER_PX: f64 = 2.0;
const INNER_HEIGHT: f32 = 0.5;
const MIN_TEXTURED: f64 = 0.3;
/// The longest part of the rim without support, as a fraction of all, of a textured ball and of a plain one.
const MAX_GAP: f64 = 0.2;
const MAX_GAP_PLAIN: f64 = 0.1;
/// The maximum fraction of clipped pixels, which show no texture.
const MAX_CLIPPED: f64 = 0.1;
/// The uncertainty of the radius because the outermost step lies about a blur outside the rim, px.
const RADIUS_BIAS_PX: f64 = 0.15;
/// The minimum step of a rim without texture: the brightness doubles. Shading alone makes lower ones inside a ball.
const MIN_PLAIN_STEP: f32 = std::f32::consts::LN_2;

/// A boundary and its score, at most 1.
#[derive(Debug, Clone, Copy)]
pub(super) struct Found {
    pub circle: Circle,
    pub score: f64,
}

/// The search with its scratch memory.
#[derive(Debug, Default)]
pub(super) struct Boundary {
    scratch: [GreyImage; 2],
    levels: GreyImage,
    cos: Vec<f64>,
    sin: Vec<f64>,
    profile: Vec<f32>,
    /// The steps of all rays, each from outside to inside, and the start of every ray's.
    steps: Vec<RadialStep>,
    starts: Vec<usize>,
    highest: Vec<f32>,
    /// The radii of the outermost steps of every ray that are high enough; infinite for none.
    outermost: Vec<[f64; OUTERMOST]>,
    pool: Vec<(usize, f64)>,
    tried: Vec<(f64, Offset)>,
    random: Xorshift,
}

/// A step of brightness along a ray.
#[derive(Debug, Clone, Copy)]
struct RadialStep {
    radius: f64,
    height: f32,
}

/// A circle relative to the centre of the rays, px.
#[derive(Debug, Clone, Copy, Default)]
struct Offset {
    dx: f64,
    dy: f64,
    radius: f64,
}

impl Offset {
    fn minus(self, other: Self) -> [f64; 3] {
        [self.dx - other.dx, self.dy - other.dy, self.radius - other.radius]
    }
}

impl Boundary {
    /// Finds the boundary near a circle, with a radius in this range and a centre off by at most `reach_px`.
    ///
    /// Returns `None` if no circle stands out.
    pub fn find(
        &mut self,
        image: ImageView<'_>,
        near: RoughCircle,
        radii: RadiusRange,
        reach_px: f64,
    ) -> Option<Found> {
        let (x, y) = (f64::from(near.x), f64::from(near.y));
        let outer = radii.high + reach_px + 3.0;
        let region = region([x, y], outer + 2.0, [image.width(), image.height()])?;
        log_levels(image, region, &mut self.scratch, &mut self.levels);
        if clipped_fraction(&self.scratch[0].data) > MAX_CLIPPED {
            return None;
        }
        let at = [x - f64::from(region.left), y - f64::from(region.top)];
        self.find_steps(at, (radii.low - reach_px).max(2.0), outer);
        let texture = self.texture()?;
        let (best, height) = self.best_circle(texture, radii, reach_px)?;
        self.select(height);
        let circle = self.improve(best, None)?;
        if !self.surrounds(circle, texture, height) {
            return None;
        }
        let score = self.score(circle);
        let rays = self.cos.len() as f64;
        if score < MIN_SCORE * (RAYS[1] as f64 / rays).sqrt() || !(radii.low..=radii.high).contains(&circle.radius) {
            return None;
        }
        let sigma = self.uncertainty(circle, score)?;
        let (x_px, y_px, radius_px) = (x + circle.dx, y + circle.dy, circle.radius);
        let in_image = fraction_in_image(x_px, y_px, radius_px, image.width(), image.height());
        let found = Circle {
            x_px,
            y_px,
            radius_px,
            sigma_center_px: sigma[0].max(sigma[1]).max(MIN_SIGMA_PX),
            sigma_radius_px: sigma[2].hypot(RADIUS_BIAS_PX),
            visible_fraction: (self.unoccluded_fraction(circle) + in_image - 1.0).clamp(0.0, 1.0),
        };
        Some(Found { circle: found, score })
    }

    /// Finds all steps along rays from the centre, between two radii.
    fn find_steps(&mut self, [x, y]: [f64; 2], low: f64, high: f64) {
        let Some(view) = self.levels.view() else { return };
        let rays = ((std::f64::consts::TAU * high / RAY_STEP_PX) as usize).clamp(RAYS[0], RAYS[1]);
        let angle = |ray: usize| (ray as f64 + 0.5) * std::f64::consts::TAU / rays as f64;
        self.cos = (0..rays).map(|ray| angle(ray).cos()).collect();
        self.sin = (0..rays).map(|ray| angle(ray).sin()).collect();
        self.steps.clear();
        self.starts.clear();
        self.highest.clear();
        let samples = (high - low) as usize + 1;
        for ray in 0..rays {
            self.starts.push(self.steps.len());
            let (cos, sin) = (self.cos[ray], self.sin[ray]);
            let is_inside =
                [low, high].iter().all(|r| can_interpolate(view, (x + r * cos) as f32, (y + r * sin) as f32));
            if !is_inside {
                continue;
            }
            let from = Ray { x: (x + low * cos) as f32, y: (y + low * sin) as f32, dx: cos as f32, dy: sin as f32 };
            self.profile.clear();
            sample_line(view, from, samples, &mut self.profile);
            let highest = push_steps(&self.profile, low, &mut self.steps);
            self.highest.push(highest);
        }
        self.starts.push(self.steps.len());
    }

    /// Returns the median over the rays of the highest step; `None` if less than half of the rim lies in the image.
    fn texture(&mut self) -> Option<f32> {
        let middle = self.highest.len() / 2;
        (2 * self.highest.len() >= self.cos.len()).then(|| nth_smallest(&mut self.highest, middle))
    }

    /// Whether steps support a circle all around.
    ///
    /// Without texture inside, the rim is all there is. It must then be about as strong everywhere, because where the
    /// light fades, the steps lie inside the ball.
    fn surrounds(&mut self, circle: Offset, texture: f32, height: f32) -> bool {
        let rays = self.outermost.len();
        let is_inner = |ray: &usize| {
            let rim = self.rim(circle, *ray);
            let steps = &self.steps[self.starts[*ray]..self.starts[*ray + 1]];
            steps.iter().any(|step| step.radius < rim - INNER_PX && step.height > INNER_HEIGHT * texture)
        };
        let is_textured = (0..rays).filter(is_inner).count() as f64 >= MIN_TEXTURED * rays as f64;
        if is_textured || texture < MIN_PLAIN_STEP {
            return is_textured && self.max_gap(circle) <= MAX_GAP;
        }
        self.select(height.max(INNER_HEIGHT * texture));
        let gap = self.max_gap(circle);
        self.select(height);
        gap <= MAX_GAP_PLAIN
    }

    /// Returns the longest part of the rim without support, as a fraction of all.
    fn max_gap(&self, circle: Offset) -> f64 {
        let rays = self.outermost.len();
        let (mut gap, mut longest) = (0_usize, 0_usize);
        for ray in (0..rays).chain(0..rays) {
            let rim = self.rim(circle, ray);
            let is_supported = self.outermost[ray].iter().any(|step| (step - rim).abs() < TOLERANCE_PX);
            gap = if is_supported { 0 } else { gap + 1 };
            longest = longest.max(gap);
        }
        longest as f64 / rays.max(1) as f64
    }

    /// Returns the best circle and the height of the steps that it rests on.
    fn best_circle(&mut self, texture: f32, radii: RadiusRange, reach_px: f64) -> Option<(Offset, f32)> {
        let mut best: Option<(f64, Offset, f32)> = None;
        self.tried.clear();
        for fraction in MIN_STEPS {
            let height = fraction * texture;
            self.select(height);
            let first = self.tried.len();
            self.try_circles(radii, reach_px);
            for (score, circle) in &self.tried[first..] {
                if best.is_none_or(|(highest, ..)| *score > highest) {
                    best = Some((*score, *circle, height));
                }
            }
        }
        best.map(|(_, circle, height)| (circle, height))
    }

    /// Selects the outermost steps of every ray that are at least this high.
    fn select(&mut self, height: f32) {
        self.outermost.clear();
        self.pool.clear();
        for ray in 0..self.cos.len() {
            let mut outermost = [f64::INFINITY; OUTERMOST];
            let steps = &self.steps[self.starts[ray]..self.starts[ray + 1]];
            for (slot, step) in outermost.iter_mut().zip(steps.iter().filter(|step| step.height > height)) {
                *slot = step.radius;
                self.pool.push((ray, step.radius));
            }
            self.outermost.push(outermost);
        }
    }

    /// Scores circles through three selected steps each.
    fn try_circles(&mut self, radii: RadiusRange, reach_px: f64) {
        // A constant seed: the same image gives the same circle.
        self.random = Xorshift::default();
        let enough = self.tried.len() + CIRCLES;
        if self.pool.len() < 10 {
            return;
        }
        for _ in 0..DRAWS {
            let Some(circle) = self.draw(radii, reach_px) else { continue };
            let score = self.score(circle);
            self.tried.push((score, circle));
            if self.tried.len() == enough {
                return;
            }
        }
    }

    /// Draws a circle through three steps; `None` if it is out of range.
    fn draw(&mut self, radii: RadiusRange, reach_px: f64) -> Option<Offset> {
        let mut points = [[0.0; 2]; 3];
        let mut rays = [0; 3];
        for k in 0..3 {
            let at = self.random.below(self.pool.len());
            let (ray, radius) = self.pool[at];
            rays[k] = ray;
            points[k] = [radius * self.cos[ray], radius * self.sin[ray]];
        }
        if rays[0] == rays[1] || rays[0] == rays[2] || rays[1] == rays[2] {
            return None;
        }
        let [a, b, c] = points;
        let (bx, by, cx, cy) = (b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]);
        let determinant = 2.0 * (bx * cy - by * cx);
        if determinant.abs() < radii.low {
            return None;
        }
        let (b2, c2) = (bx * bx + by * by, cx * cx + cy * cy);
        let (ux, uy) = ((cy * b2 - by * c2) / determinant, (bx * c2 - cx * b2) / determinant);
        let circle = Offset { dx: a[0] + ux, dy: a[1] + uy, radius: ux.hypot(uy) };
        let is_near = circle.dx.abs().max(circle.dy.abs()) < reach_px;
        (is_near && (radii.low..=radii.high).contains(&circle.radius)).then_some(circle)
    }

    /// Returns the radius of a circle along a ray.
    fn rim(&self, circle: Offset, ray: usize) -> f64 {
        let (cos, sin) = (self.cos[ray], self.sin[ray]);
        let across = circle.dx * sin - circle.dy * cos;
        circle.dx * cos + circle.dy * sin + circle.radius - 0.5 / circle.radius * across * across
    }

    /// Returns the support of a circle by the rays, less the weight of those that contradict it: at most 1.
    fn score(&self, circle: Offset) -> f64 {
        let mut sum = 0.0;
        for (ray, steps) in self.outermost.iter().enumerate() {
            let rim = self.rim(circle, ray);
            let nearest = steps.iter().map(|step| (step - rim).abs()).fold(f64::INFINITY, f64::min);
            sum += (1.0 - (nearest / TOLERANCE_PX).powi(2)).max(0.0);
            if steps[0].is_finite() && steps[0] > rim + OUTSIDE_PX {
                sum -= OUTSIDE_WEIGHT;
            }
        }
        sum / self.outermost.len().max(1) as f64
    }

    /// Returns the part of a circle's disc that nothing covers: steps of an occluder lie outside the rim.
    fn unoccluded_fraction(&self, circle: Offset) -> f64 {
        let bin = |(ray, steps): (usize, &[f64; OUTERMOST])| {
            let rim = self.rim(circle, ray);
            if steps.iter().any(|step| (step - rim).abs() < TOLERANCE_PX) {
                RimBin::Visible
            } else if steps[0].is_finite() && steps[0] > rim + OUTSIDE_PX {
                RimBin::Missing
            } else {
                RimBin::Outside
            }
        };
        let bins: Vec<RimBin> = self.outermost.iter().enumerate().map(bin).collect();
        unoccluded_fraction(&bins)
    }

    /// Fits the steps near a circle, without one of the sectors; `None` if they do not determine it.
    fn improve(&self, start: Offset, without: Option<usize>) -> Option<Offset> {
        let mut circle = start;
        let rays = self.outermost.len();
        for _ in 0..ROUNDS {
            let (mut normal, mut right) = (Matrix3::<f64>::zeros(), Vector3::<f64>::zeros());
            let mut used = 0;
            for (ray, steps) in self.outermost.iter().enumerate() {
                if without.is_some_and(|sector| ray * SECTORS / rays == sector) {
                    continue;
                }
                let rim = self.rim(circle, ray);
                let errors = steps.iter().map(|step| step - rim);
                let Some(error) = errors.min_by(|a, b| a.abs().total_cmp(&b.abs())) else { continue };
                if error.abs() >= TOLERANCE_PX {
                    continue;
                }
                let weight = (1.0 - (error / TOLERANCE_PX).powi(2)).powi(2);
                let row = Vector3::new(self.cos[ray], self.sin[ray], 1.0);
                normal += weight * row * row.transpose();
                right += weight * error * row;
                used += 1;
            }
            if used < 8 {
                return None;
            }
            let change = normal.cholesky()?.solve(&right);
            circle = Offset { dx: circle.dx + change[0], dy: circle.dy + change[1], radius: circle.radius + change[2] };
        }
        (circle.radius.is_finite() && circle.radius > 0.0).then_some(circle)
    }

    /// Returns the uncertainty of x, y and radius, px: that of the other circles, and that of the sectors.
    ///
    /// The first is the spread of all circles about the best, each with its likelihood. The second is the jackknife
    /// over sectors (B. Efron, C. Stein, Ann. Stat. 9 (1981) 586, <https://doi.org/10.1214/aos/1176345462>), since
    /// shadows and marks move whole sectors alike.
    fn uncertainty(&self, circle: Offset, score: f64) -> Option<[f64; 3]> {
        let independent = INDEPENDENT_RAYS * self.cos.len() as f64;
        let (mut spread, mut total) = ([0.0; 3], f64::MIN_POSITIVE);
        for (other_score, other) in &self.tried {
            let weight = ((other_score - score).min(0.0) * independent).exp();
            total += weight;
            for (sum, apart) in spread.iter_mut().zip(other.minus(circle)) {
                *sum += weight * apart * apart;
            }
        }
        let left_out: Option<Vec<Offset>> = (0..SECTORS).map(|sector| self.improve(circle, Some(sector))).collect();
        let left_out: Vec<[f64; 3]> = left_out?.iter().map(|other| other.minus(circle)).collect();
        let count = SECTORS as f64;
        Some(std::array::from_fn(|k| {
            let mean = left_out.iter().map(|other| other[k]).sum::<f64>() / count;
            let squares: f64 = left_out.iter().map(|other| (other[k] - mean).powi(2)).sum();
            ((count - 1.0) / count * squares + spread[k] / total).sqrt()
        }))
    }
}

/// Appends the local maxima of the difference along `profile`, the outermost first; returns the highest.
fn push_steps(profile: &[f32], low: f64, steps: &mut Vec<RadialStep>) -> f32 {
    let difference = |k: usize| profile[k + 1] - profile[k - 1];
    let mut highest = 0.0_f32;
    for k in (2..profile.len().saturating_sub(2)).rev() {
        let here = difference(k);
        let height = here.abs();
        highest = highest.max(height);
        let [inner, outer] = [difference(k - 1), difference(k + 1)];
        if height > inner.abs() && height >= outer.abs() {
            let [inner, outer] = [inner, outer].map(|near| near * here.signum());
            let bend = inner + outer - 2.0 * height;
            let shift = if bend < 0.0 { (0.5 * (inner - outer) / bend).clamp(-0.5, 0.5) } else { 0.0 };
            steps.push(RadialStep { radius: low + k as f64 + f64::from(shift), height });
        }
    }
    highest
}

/// Returns the fraction of pixels that are clipped.
fn clipped_fraction(levels: &[f32]) -> f64 {
    let highest = maximum(levels);
    if !is_saturated(highest) {
        return 0.0;
    }
    levels.iter().filter(|level| **level > highest - 0.5).count() as f64 / levels.len().max(1) as f64
}

/// Returns the part of an image within `reach` of a point; `None` if it is too small.
fn region(at: [f64; 2], reach: f64, size: [usize; 2]) -> Option<PixelRect> {
    let [left, top] = at.map(|at| (at - reach).floor().max(0.0) as u32);
    let end = |at: f64, size: usize| ((at + reach).ceil().max(0.0) as u32 + 1).min(size as u32);
    let region = PixelRect { left, top, right: end(at[0], size[0]), bottom: end(at[1], size[1]) };
    (region.columns().len() >= MIN_SIDE_PX && region.rows().len() >= MIN_SIDE_PX).then_some(region)
}
