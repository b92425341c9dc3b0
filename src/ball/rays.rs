//! Circles ranked by their rim: the picture is unwrapped around a guess, and a
//! circle is drawn through steps of one sign by random sampling.
//!
//! Fischler & Bolles, *Random sample consensus*, Commun. ACM 24 (1981) 381,
//! <https://doi.org/10.1145/358669.358692>.

use nalgebra::{Matrix3, Vector3};

use super::Polarity;
use crate::image::ImageView;

/// Fewest rays, for the smallest balls.
const LEAST_RAYS: usize = 40;
/// Rim between two rays, px.
const RAY_STEP_PX: f32 = 3.0;
/// Steps remembered of each ray.
const STEPS: usize = 3;
/// A radius no ray ever has: "no step here".
const NOWHERE: f32 = 1.0e6;
/// Rays are padded to a multiple of this, for vector instructions.
const LANES: usize = 8;

/// A circle with how much of its rim was seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Guess {
    pub x: f32,
    pub y: f32,
    pub radius: f32,
    /// Mean over the rays of `1 - (distance to the nearest step / tolerance)^2`, 0 to 1.
    pub support: f32,
    pub polarity: Polarity,
}

/// How a circle is looked for around a guess.
#[derive(Debug, Clone, Copy)]
pub(super) struct Look {
    /// Length of the rays inwards and outwards, px.
    pub reach_px: f32,
    /// Distance from the circle at which a step stops counting, px.
    pub tolerance_px: f32,
    /// Circles tried for either sign.
    pub draws: usize,
    /// Most rays.
    pub rays: usize,
}

/// Scratch of the search.
#[derive(Debug, Default)]
pub(super) struct Rays {
    rays: usize,
    inside: usize,
    cos: Vec<f32>,
    sin: Vec<f32>,
    /// For either sign, [`STEPS`] lists of the radius of a step on every ray.
    steps: [[Vec<f32>; STEPS]; 2],
    /// For either sign, the (ray, radius) of all steps.
    pool: [Vec<(u32, f32)>; 2],
    profile: Vec<f32>,
    random: u64,
}

/// A circle relative to the middle of the rays.
#[derive(Debug, Clone, Copy, Default)]
struct Offset {
    dx: f32,
    dy: f32,
    radius: f32,
}

impl Rays {
    /// The best circle of either sign around (`x`, `y`, `radius`).
    pub fn look(&mut self, image: ImageView<'_>, near: (f32, f32, f32), look: Look) -> Option<Guess> {
        let best = [Polarity::Brighter, Polarity::Darker];
        self.unwrap(image, near, look);
        best.into_iter()
            .filter_map(|polarity| self.circle(near, polarity, look))
            .reduce(|a, b| if b.support > a.support { b } else { a })
    }

    /// The best circle of the guess's sign around it.
    pub fn look_again(&mut self, image: ImageView<'_>, guess: &Guess, look: Look) -> Option<Guess> {
        let near = (guess.x, guess.y, guess.radius);
        self.unwrap(image, near, look);
        self.circle(near, guess.polarity, look)
    }

    /// Finds the strongest steps along rays through the rim.
    fn unwrap(&mut self, image: ImageView<'_>, (x, y, radius): (f32, f32, f32), look: Look) {
        let rays = ((std::f32::consts::TAU * radius / RAY_STEP_PX) as usize).clamp(LEAST_RAYS, look.rays);
        self.plan(rays);
        self.inside = 0;
        let reach = look.reach_px.min(radius - 2.0).max(1.0);
        let (low, samples) = (radius - reach - 1.0, (2.0 * reach + 3.0) as usize);
        for ray in 0..rays {
            let (cos, sin) = (self.cos[ray], self.sin[ray]);
            let whole = [low, low + samples as f32 - 1.0].iter().all(|r| within(image, x + r * cos, y + r * sin));
            if !whole {
                continue;
            }
            self.inside += 1;
            self.profile.clear();
            sample_line(image, (x + low * cos, y + low * sin), (cos, sin), samples, &mut self.profile);
            self.pick_steps(ray, low);
        }
    }

    /// Directions of the rays; forgets all steps.
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
        // The same picture must give the same circle.
        self.random = 0x9e37_79b9_7f4a_7c15;
    }

    /// Remembers the strongest local maxima of the radial difference along `profile`.
    fn pick_steps(&mut self, ray: usize, low: f32) {
        let mut strongest = [(0.0_f32, 0.0_f32, 0_usize); STEPS];
        let mut before = 0.0_f32;
        let mut here = 0.0_f32;
        let p = &self.profile;
        for k in 1..p.len() {
            // One sample late: `here` is the difference at k - 1, judged between its two neighbours.
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

    fn circle(&mut self, near: (f32, f32, f32), polarity: Polarity, look: Look) -> Option<Guess> {
        // Outwards, a ball brighter than its ground has a step down.
        let sign = match polarity {
            Polarity::Brighter => 0,
            Polarity::Darker => 1,
        };
        if self.pool[sign].len() < 8 || 3 * self.inside < self.rays {
            return None;
        }
        let mut best = (0.0_f32, Offset::default());
        let mut tried = 0;
        // Most draws are refused for free, because no circle near the guess passes through the three steps.
        for _ in 0..look.draws * 8 {
            let Some(offset) = self.draw(sign, near.2, look.reach_px) else { continue };
            let support = self.support(sign, offset, look.tolerance_px);
            if support > best.0 {
                best = (support, offset);
            }
            tried += 1;
            if tried == look.draws {
                break;
            }
        }
        for _ in 0..3 {
            let Some(offset) = self.improve(sign, best.1, look.tolerance_px) else { break };
            let support = self.support(sign, offset, look.tolerance_px);
            if support <= best.0 {
                break;
            }
            best = (support, offset);
        }
        let (support, offset) = best;
        (support > 0.0).then_some(Guess {
            x: near.0 + offset.dx,
            y: near.1 + offset.dy,
            radius: offset.radius,
            support,
            polarity,
        })
    }

    /// A circle through three steps of one sign, when it is near the guess.
    fn draw(&mut self, sign: usize, radius: f32, reach: f32) -> Option<Offset> {
        let mut points = [(0.0_f32, 0.0_f32); 3];
        let mut rays = [0_u32; 3];
        for i in 0..3 {
            let n = self.pool[sign].len() as u64;
            let at = (self.next_random() % n) as usize;
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

    /// Mean agreement of the rays with a circle.
    fn support(&self, sign: usize, offset: Offset, tolerance: f32) -> f32 {
        let sum = votes(&self.steps[sign], &self.cos, &self.sin, offset, 1.0 / tolerance);
        // Rays that leave the image count half: a ball may do so, but few rays agree by chance more easily.
        sum / (0.5 * (self.inside + self.rays) as f32)
    }

    /// Least squares through the steps that agree with a circle.
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

    /// xorshift64* (Vigna, <https://doi.org/10.1145/2845077>).
    fn next_random(&mut self) -> u64 {
        let mut x = self.random;
        x ^= x >> 12;
        x ^= x << 25;
        x ^= x >> 27;
        self.random = x;
        x.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33
    }
}

/// Sum over the rays of `1 - (distance of the circle to the nearest step * scale)^2`, where positive.
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

pub(super) fn within(image: ImageView<'_>, x: f32, y: f32) -> bool {
    x >= 0.0 && y >= 0.0 && x < (image.width() - 1) as f32 && y < (image.height() - 1) as f32
}

/// Bilinear grey levels at `count` points from `from` on, `step` apart, all [`within`] the image.
fn sample_line(image: ImageView<'_>, from: (f32, f32), step: (f32, f32), count: usize, out: &mut Vec<f32>) {
    // 16 bits after the point: stepping in whole numbers is cheaper than rounding every coordinate.
    const ONE: f32 = 65536.0;
    let (mut x, mut y) = ((from.0 * ONE) as i32, (from.1 * ONE) as i32);
    let (dx, dy) = ((step.0 * ONE) as i32, (step.1 * ONE) as i32);
    let (data, width) = (image.data(), image.width());
    for _ in 0..count {
        let (fx, fy) = ((x & 0xffff) as f32 * (1.0 / ONE), (y & 0xffff) as f32 * (1.0 / ONE));
        let i = (y >> 16) as usize * width + (x >> 16) as usize;
        // The last point may be rounded onto the border, a whole pixel outside of which there is none.
        let Some(&[a, b]) = data.get(i..i + 2) else { return };
        let Some(&[c, d]) = data.get(i + width..i + width + 2) else { return };
        let (upper, lower) = (a + fx * (b - a), c + fx * (d - c));
        out.push(upper + fy * (lower - upper));
        x += dx;
        y += dy;
    }
}
