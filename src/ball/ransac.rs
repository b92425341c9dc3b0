//! Ranking of circles by their rim: RANSAC through steps of one sign along rays around a candidate.
//!
//! Fischler & Bolles, *Random sample consensus*, Commun. ACM 24 (1981) 381,
//! <https://doi.org/10.1145/358669.358692>.

use nalgebra::{Matrix3, Vector3};

use super::Polarity;
use super::annulus::{BAND_PX, INNER_BAND_PX};
use crate::image::ImageView;
use crate::numeric::Xorshift;

/// The minimum number of rays, for the smallest balls.
const MIN_RAYS: usize = 40;
/// The distance of two rays along the rim, px.
const RAY_STEP_PX: f32 = 3.0;
/// The number of steps kept of each ray.
const STEPS: usize = 3;
/// A radius beyond all rays, which stands for no step.
const NOWHERE: f32 = 1.0e6;
/// The number of rays processed at a time by vector instructions.
const LANES: usize = 8;

/// A circle with its support along the rim.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Candidate {
    pub x: f32,
    pub y: f32,
    pub radius: f32,
    /// The mean over the rays of `1 - (distance to the nearest step / tolerance)^2`, 0 to 1.
    pub support: f32,
    pub polarity: Polarity,
}

impl Candidate {
    /// Creates a candidate that is tried whatever its support.
    pub fn at(circle: RoughCircle, polarity: Polarity) -> Self {
        let RoughCircle { x, y, radius } = circle;
        Self { x, y, radius, support: 1.0, polarity }
    }
}

/// A circle known to some pixels, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RoughCircle {
    pub x: f32,
    pub y: f32,
    pub radius: f32,
}

/// The parameters of a search around a circle.
#[derive(Debug, Clone, Copy)]
pub(super) struct RansacParams {
    /// The length of the rays inwards and outwards, px.
    pub reach_px: f32,
    /// The maximum distance of a supporting step from the circle, px.
    pub tolerance_px: f32,
    /// The number of circles tried for either sign.
    pub draws: usize,
    /// The maximum number of rays.
    pub rays: usize,
}

/// The search with its scratch memory.
#[derive(Debug, Default)]
pub(super) struct Ransac {
    rays: usize,
    inside: usize,
    cos: Vec<f32>,
    sin: Vec<f32>,
    /// For either sign, [`STEPS`] lists of the radius of a step on every ray.
    steps: [[Vec<f32>; STEPS]; 2],
    /// For either sign, the (ray, radius) of all steps.
    pool: [Vec<(u32, f32)>; 2],
    profile: Vec<f32>,
    random: Xorshift,
}

/// A circle relative to the centre of the rays.
#[derive(Debug, Clone, Copy, Default)]
struct Offset {
    dx: f32,
    dy: f32,
    radius: f32,
}

impl Ransac {
    /// Returns the best circle of either sign around another one.
    pub fn search(&mut self, image: ImageView<'_>, near: RoughCircle, params: RansacParams) -> Option<Candidate> {
        let best = [Polarity::Brighter, Polarity::Darker];
        self.find_steps(image, near, params);
        best.into_iter()
            .filter_map(|polarity| self.fit_by_ransac(near, polarity, params))
            .reduce(|a, b| if b.support > a.support { b } else { a })
    }

    /// Returns the best circle of the candidate's sign around it.
    pub fn search_again(
        &mut self,
        image: ImageView<'_>,
        candidate: &Candidate,
        params: RansacParams,
    ) -> Option<Candidate> {
        let near = RoughCircle { x: candidate.x, y: candidate.y, radius: candidate.radius };
        self.find_steps(image, near, params);
        self.fit_by_ransac(near, candidate.polarity, params)
    }

    /// Finds the strongest steps along rays through the rim, and counts the rays inside the image.
    fn find_steps(&mut self, image: ImageView<'_>, near: RoughCircle, params: RansacParams) {
        let RoughCircle { x, y, radius } = near;
        let rays = ((std::f32::consts::TAU * radius / RAY_STEP_PX) as usize).clamp(MIN_RAYS, params.rays);
        self.plan(rays);
        self.inside = 0;
        let reach = params.reach_px.min(radius - 2.0).max(1.0);
        let (low, samples) = (radius - reach - 1.0, (2.0 * reach + 3.0) as usize);
        for ray in 0..rays {
            let (cos, sin) = (self.cos[ray], self.sin[ray]);
            let is_inside =
                [low, low + samples as f32 - 1.0].iter().all(|r| can_interpolate(image, x + r * cos, y + r * sin));
            if !is_inside {
                continue;
            }
            self.inside += 1;
            self.profile.clear();
            let line = Ray { x: x + low * cos, y: y + low * sin, dx: cos, dy: sin };
            sample_line(image, line, samples, &mut self.profile);
            self.pick_steps(ray, low);
        }
    }

    /// Plans the directions of the rays and discards all steps.
    fn plan(&mut self, rays: usize) {
        let padded = rays.next_multiple_of(LANES);
        if self.rays != rays {
            self.rays = rays;
            let angle = |i: usize| (i as f32 + 0.5) * std::f32::consts::TAU / rays as f32;
            self.cos = (0..padded).map(|i| angle(i).cos()).collect();
            self.sin = (0..padded).map(|i| angle(i).sin()).collect();
        }
        for list in self.steps.iter_mut().flatten() {
            list.clear();
            list.resize(padded, NOWHERE);
        }
        self.pool.iter_mut().for_each(Vec::clear);
        // A constant seed: the same image gives the same circle.
        self.random = Xorshift::default();
    }

    /// Stores the strongest local maxima of the radial difference along `profile`.
    fn pick_steps(&mut self, ray: usize, low: f32) {
        let mut strongest = [(0.0_f32, 0.0_f32, 0_usize); STEPS];
        let mut before = 0.0_f32;
        let mut here = 0.0_f32;
        let p = &self.profile;
        for k in 1..p.len() {
            // One sample late: `here` is the difference at k - 1, compared with its two neighbours.
            let after = if k + 1 < p.len() { p[k + 1] - p[k - 1] } else { 0.0 };
            let size = here.abs();
            if k >= 2 && size > before.abs() && size >= after.abs() && size > strongest[STEPS - 1].0 {
                let (left, right) = (before * here.signum(), after * here.signum());
                let bend = left + right - 2.0 * size;
                let shift = if bend < 0.0 { (0.5 * (left - right) / bend).clamp(-0.5, 0.5) } else { 0.0 };
                let sign = usize::from(here > 0.0);
                let at = strongest.iter().position(|s| size > s.0).unwrap_or(STEPS - 1);
                strongest[at..].rotate_right(1);
                strongest[at] = (size, low + (k - 1) as f32 + shift, sign);
            }
            (before, here) = (here, after);
        }
        for (slot, (size, radius, sign)) in strongest.into_iter().enumerate() {
            if size > 0.0 {
                self.steps[sign][slot][ray] = radius;
                self.pool[sign].push((ray as u32, radius));
            }
        }
    }

    /// Fits a circle of one polarity by RANSAC near a candidate, and refines the best one by least squares.
    ///
    /// `None` if too few rays have a step, or too few lie in the image.
    fn fit_by_ransac(&mut self, near: RoughCircle, polarity: Polarity, params: RansacParams) -> Option<Candidate> {
        // Outwards, the rim of a brighter ball is a step down.
        let sign = match polarity {
            Polarity::Brighter => 0,
            Polarity::Darker => 1,
        };
        if self.pool[sign].len() < 8 || 3 * self.inside < self.rays {
            return None;
        }
        let mut best = (0.0_f32, Offset::default());
        let mut tried = 0;
        // Most draws are refused at no cost, because the circle through the three steps is far from the candidate.
        for _ in 0..params.draws * 8 {
            let Some(offset) = self.random_circle(sign, near.radius, params.reach_px) else { continue };
            let support = self.support(sign, offset, params.tolerance_px);
            if support > best.0 {
                best = (support, offset);
            }
            tried += 1;
            if tried == params.draws {
                break;
            }
        }
        for _ in 0..3 {
            let Some(offset) = self.improve(sign, best.1, params.tolerance_px) else { break };
            let support = self.support(sign, offset, params.tolerance_px);
            if support <= best.0 {
                break;
            }
            best = (support, offset);
        }
        let (support, offset) = best;
        (support > 0.0).then_some(Candidate {
            x: near.x + offset.dx,
            y: near.y + offset.dy,
            radius: offset.radius,
            support,
            polarity,
        })
    }

    /// Returns the circle through three random steps of one sign; `None` if it is far from the candidate.
    fn random_circle(&mut self, sign: usize, radius: f32, reach: f32) -> Option<Offset> {
        let mut points = [(0.0_f32, 0.0_f32); 3];
        let mut rays = [0_u32; 3];
        for i in 0..3 {
            let at = self.random.below(self.pool[sign].len());
            let (ray, r) = self.pool[sign][at];
            rays[i] = ray;
            points[i] = (r * self.cos[ray as usize], r * self.sin[ray as usize]);
        }
        if rays[0] == rays[1] || rays[0] == rays[2] || rays[1] == rays[2] {
            return None;
        }
        let [a, b, c] = points;
        let (bx, by, cx, cy) = (b.0 - a.0, b.1 - a.1, c.0 - a.0, c.1 - a.1);
        let determinant = 2.0 * (bx * cy - by * cx);
        if determinant.abs() < radius {
            return None;
        }
        let (b2, c2) = (bx * bx + by * by, cx * cx + cy * cy);
        let (ux, uy) = ((cy * b2 - by * c2) / determinant, (bx * c2 - cx * b2) / determinant);
        let offset = Offset { dx: a.0 + ux, dy: a.1 + uy, radius: (ux * ux + uy * uy).sqrt() };
        let near = offset.dx.abs().max(offset.dy.abs()) < reach && (offset.radius - radius).abs() < reach;
        near.then_some(offset)
    }

    /// Returns the mean support of a circle by the rays.
    fn support(&self, sign: usize, offset: Offset, tolerance: f32) -> f32 {
        let sum = votes(&self.steps[sign], &self.cos, &self.sin, offset, 1.0 / tolerance);
        // Ransac outside the image count half: a ball may cross the border, but few rays agree by chance more easily.
        sum / (0.5 * (self.inside + self.rays) as f32)
    }

    /// Fits the steps that support a circle by least squares.
    fn improve(&self, sign: usize, offset: Offset, tolerance: f32) -> Option<Offset> {
        let mut normal = Matrix3::<f32>::zeros();
        let mut right = Vector3::<f32>::zeros();
        for ray in 0..self.rays {
            let (cos, sin) = (self.cos[ray], self.sin[ray]);
            let across = offset.dx * sin - offset.dy * cos;
            let rim = offset.dx * cos + offset.dy * sin + offset.radius - 0.5 / offset.radius * across * across;
            let nearest = self.steps[sign]
                .iter()
                .map(|list| list[ray] - rim)
                .reduce(|a, b| if b.abs() < a.abs() { b } else { a });
            let Some(error) = nearest.filter(|e| e.abs() < tolerance) else { continue };
            let row = Vector3::new(cos, sin, 1.0);
            normal += row * row.transpose();
            right += row * error;
        }
        let step = normal.cholesky()?.solve(&right);
        Some(Offset { dx: offset.dx + step[0], dy: offset.dy + step[1], radius: offset.radius + step[2] })
    }
}

/// Sums `1 - (distance of the circle to the nearest step * scale)^2` over the rays, where positive.
#[multiversion::multiversion(targets("x86_64+avx2+fma"))]
fn votes(steps: &[Vec<f32>; STEPS], cos: &[f32], sin: &[f32], offset: Offset, scale: f32) -> f32 {
    let bend = 0.5 / offset.radius;
    let mut sums = [0.0_f32; LANES];
    let [first, second, third] = steps;
    let mut lists = first.chunks_exact(LANES).zip(second.chunks_exact(LANES)).zip(third.chunks_exact(LANES));
    for (cos, sin) in cos.chunks_exact(LANES).zip(sin.chunks_exact(LANES)) {
        let Some(((a, b), c)) = lists.next() else { break };
        for lane in 0..LANES {
            let across = offset.dx * sin[lane] - offset.dy * cos[lane];
            let rim = offset.dx * cos[lane] + offset.dy * sin[lane] + offset.radius - bend * across * across;
            let (a, b, c) = ((a[lane] - rim).abs(), (b[lane] - rim).abs(), (c[lane] - rim).abs());
            let ab = if a < b { a } else { b };
            let near = if ab < c { ab } else { c } * scale;
            let vote = 1.0 - near * near;
            sums[lane] += if vote > 0.0 { vote } else { 0.0 };
        }
    }
    sums.iter().sum()
}

/// Whether the grey level at a position, px, can be interpolated bilinearly: all four pixels around it lie in the image.
pub(super) fn can_interpolate(image: ImageView<'_>, x_px: f32, y_px: f32) -> bool {
    x_px >= 0.0 && y_px >= 0.0 && x_px < (image.width() - 1) as f32 && y_px < (image.height() - 1) as f32
}

/// The first sample on a ray, and the step to the next, px.
pub(super) struct Ray {
    pub x: f32,
    pub y: f32,
    pub dx: f32,
    pub dy: f32,
}

/// Samples grey levels bilinearly at `count` points of a ray, which all [can be interpolated](can_interpolate).
pub(super) fn sample_line(image: ImageView<'_>, ray: Ray, count: usize, out: &mut Vec<f32>) {
    // Fixed point with 16 fractional bits: stepping in integers is cheaper than rounding every coordinate.
    const ONE: f32 = 65536.0;
    let (mut x, mut y) = ((ray.x * ONE) as i32, (ray.y * ONE) as i32);
    let (dx, dy) = ((ray.dx * ONE) as i32, (ray.dy * ONE) as i32);
    let (data, width) = (image.data(), image.width());
    for _ in 0..count {
        let (fx, fy) = ((x & 0xffff) as f32 * (1.0 / ONE), (y & 0xffff) as f32 * (1.0 / ONE));
        let i = (y >> 16) as usize * width + (x >> 16) as usize;
        // The last point may be rounded onto the border, beyond which there is no pixel.
        let Some(&[a, b]) = data.get(i..i + 2) else { return };
        let Some(&[c, d]) = data.get(i + width..i + width + 2) else { return };
        let (upper, lower) = (a + fx * (b - a), c + fx * (d - c));
        out.push(upper + fy * (lower - upper));
        x += dx;
        y += dy;
    }
}

/// Returns the polarity of a circle's rim; `None` if hardly any of the rim lies in the image.
pub(super) fn rim_polarity(image: ImageView<'_>, circle: RoughCircle) -> Option<Polarity> {
    let RoughCircle { x, y, radius } = circle;
    const DIRECTIONS: usize = 48;
    let (mut difference, mut count) = (0.0, 0);
    for k in 0..DIRECTIONS {
        let (sin, cos) = (k as f32 * std::f32::consts::TAU / DIRECTIONS as f32).sin_cos();
        let level = |reach: f32| {
            let (x, y) = ((x + reach * cos).round(), (y + reach * sin).round());
            if x < 0.0 || y < 0.0 { None } else { image.at(x as usize, y as usize) }
        };
        if let (Some(inside), Some(outside)) = (level(radius - INNER_BAND_PX as f32), level(radius + BAND_PX as f32)) {
            difference += inside - outside;
            count += 1;
        }
    }
    let sign = if difference > 0.0 { Polarity::Brighter } else { Polarity::Darker };
    (4 * count > DIRECTIONS).then_some(sign)
}
