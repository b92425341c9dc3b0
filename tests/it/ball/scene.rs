//! Balls drawn from their formula, with three samples per pixel and axis, blurred like by a lens.

/// Samples per pixel along each axis. Odd, so that one of them is the centre of the pixel.
const FINE: usize = 3;

/// SplitMix64: the same numbers everywhere.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub fn normal(&mut self) -> f64 {
        let (a, b) = (self.uniform(1e-12, 1.0), self.uniform(0.0, std::f64::consts::TAU));
        (-2.0 * a.ln()).sqrt() * b.cos()
    }
}

/// An occluder in front of the ball.
#[derive(Debug, Clone, Copy)]
pub struct Occluder {
    /// Direction from the ball's centre to the occluder, rad.
    pub angle: f64,
    /// The occluded share of the ball's diameter; 0 touches the rim.
    pub hidden: f64,
    pub grey: f64,
    /// 1 / radius of the edge, positive when it bulges towards the ball.
    pub curvature: f64,
    pub texture: f64,
}

/// The surface that carries the speckle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Surface {
    /// A disc: marks are as wide at the rim as in the middle.
    Flat,
    /// A sphere: marks become narrow towards the rim.
    Sphere,
}

/// An image with or without a ball, and so its truth.
#[derive(Debug, Clone)]
pub struct Scene {
    pub width: usize,
    pub height: usize,
    pub x: f64,
    pub y: f64,
    pub radius: f64,
    pub blur: f64,
    /// The grey level of the ball, or `None` without a ball.
    pub ball: Option<f64>,
    pub ground: f64,
    /// The share of the ball covered by dark speckle, the areas of marks in px^2, and their transmission.
    pub cover: f64,
    pub areas: (f64, f64),
    pub transmission: f64,
    pub surface: Surface,
    /// Background texture: rms and correlation length.
    pub texture: f64,
    pub correlation: f64,
    pub gradient: f64,
    pub side_light: f64,
    /// The direction of the side light, rad; random by the seed if `None`.
    pub side_light_rad: Option<f64>,
    pub limb: f64,
    pub occluder: Option<Occluder>,
    pub noise: f64,
    pub seed: u64,
}

impl Scene {
    /// A plain ball in the middle of a 256 x 256 image.
    pub fn plain(ball: f64, ground: f64) -> Self {
        Self {
            width: 256,
            height: 256,
            x: 127.3,
            y: 129.6,
            radius: 57.2,
            blur: 0.7,
            ball: Some(ball),
            ground,
            cover: 0.0,
            areas: (4.0, 80.0),
            transmission: 0.3,
            surface: Surface::Flat,
            texture: 0.0,
            correlation: 2.0,
            gradient: 0.0,
            side_light: 0.0,
            side_light_rad: None,
            limb: 0.0,
            occluder: None,
            noise: 2.0,
            seed: 1,
        }
    }

    /// A ball with all disturbances: speckle, light, texture behind, an occluder in front.
    pub fn hard(seed: u64, bright: bool, hidden: f64) -> Self {
        let mut r = Random(seed.wrapping_mul(0x1234_5678_9abc_def1) ^ 0x5151);
        let (ball, ground) = if bright {
            (r.uniform(150.0, 215.0), r.uniform(20.0, 95.0))
        } else {
            (r.uniform(100.0, 140.0), r.uniform(185.0, 225.0))
        };
        let occluder = (hidden > 0.0).then(|| Occluder {
            angle: r.uniform(0.0, std::f64::consts::TAU),
            hidden,
            grey: [25.0, 110.0, 210.0][(r.next() % 3) as usize],
            curvature: [0.0, 1.0 / 120.0, -1.0 / 120.0, 1.0 / 300.0, -1.0 / 300.0][(r.next() % 5) as usize],
            texture: r.uniform(0.0, 10.0),
        });
        Self {
            x: 128.0 + r.uniform(-30.0, 30.0),
            y: 128.0 + r.uniform(-30.0, 30.0),
            radius: if r.next().is_multiple_of(2) { 57.0 } else { 61.5 } + r.uniform(-1.0, 1.0),
            blur: r.uniform(0.5, 1.0),
            cover: r.uniform(0.2, 0.5),
            transmission: r.uniform(0.15, 0.5),
            texture: r.uniform(3.0, 15.0),
            correlation: r.uniform(1.5, 5.0),
            gradient: r.uniform(-0.1, 0.1),
            side_light: r.uniform(0.0, 0.3),
            limb: r.uniform(0.0, 0.3),
            occluder,
            seed,
            ..Self::plain(ball, ground)
        }
    }

    /// The image in whole grey levels 0 to 255.
    pub fn render(&self) -> Vec<f32> {
        let mut r = Random(self.seed ^ 0x00c0_ffee);
        let (w, h) = (self.width * FINE, self.height * FINE);
        let ground = texture(&mut r, self.width, self.height, self.texture, self.correlation);
        let front = texture(&mut r, self.width, self.height, self.occluder.map_or(0.0, |o| o.texture), 2.5);
        let speckle = match self.surface {
            Surface::Flat => self.speckle(&mut r),
            Surface::Sphere => self.speckle_of_sphere(&mut r),
        };
        let drawn = r.uniform(0.0, std::f64::consts::TAU);
        let light = self.side_light_rad.unwrap_or(drawn);
        let mut fine = vec![0.0_f32; w * h];
        for (j, row) in fine.chunks_exact_mut(w).enumerate() {
            for (i, value) in row.iter_mut().enumerate() {
                let (px, py) = (place(i), place(j));
                let slope = self.gradient * (px - self.x);
                let mut grey = self.ground + slope + sample(&ground, self.width, self.height, px, py);
                let (dx, dy) = (px - self.x, py - self.y);
                let distance = dx.hypot(dy);
                let cover = ((self.radius - distance) * FINE as f64 + 0.5).clamp(0.0, 1.0);
                if let (Some(ball), true) = (self.ball, cover > 0.0) {
                    let depth = (1.0 - (distance / self.radius).powi(2)).max(0.0).sqrt();
                    let side = 1.0 + self.side_light * (dx * light.cos() + dy * light.sin()) / self.radius;
                    let dark = f64::from(speckle[j * w + i]);
                    let paint = 1.0 - dark * (1.0 - self.transmission);
                    let inside = ball * paint * side * (1.0 - self.limb * (1.0 - depth));
                    grey += cover * (inside - grey);
                }
                if let Some(o) = self.occluder {
                    let cover = (self.behind(&o, dx, dy) * FINE as f64 + 0.5).clamp(0.0, 1.0);
                    let front = o.grey + sample(&front, self.width, self.height, px, py);
                    grey += cover * (front - grey);
                }
                *value = grey as f32;
            }
        }
        blur(&mut fine, w, h, self.blur * FINE as f64);
        let mut image = Vec::with_capacity(self.width * self.height);
        for y in 0..self.height {
            for x in 0..self.width {
                let grey = f64::from(fine[(y * FINE + FINE / 2) * w + x * FINE + FINE / 2]);
                image.push((grey + self.noise * r.normal()).round().clamp(0.0, 255.0) as f32);
            }
        }
        image
    }

    /// The share of the ball's disc that is in the image and in front of the occluder.
    pub fn visible(&self) -> f64 {
        let (mut all, mut seen) = (0, 0);
        let reach = (2.0 * self.radius).ceil() as i32;
        for j in -reach..=reach {
            for i in -reach..=reach {
                let (dx, dy) = (0.5 * f64::from(i), 0.5 * f64::from(j));
                if dx.hypot(dy) < self.radius {
                    all += 1;
                    let hidden = self.occluder.is_some_and(|o| self.behind(&o, dx, dy) > 0.0);
                    let (x, y) = (self.x + dx + 0.5, self.y + dy + 0.5);
                    let inside = x > 0.0 && y > 0.0 && x < self.width as f64 && y < self.height as f64;
                    seen += i32::from(inside && !hidden);
                }
            }
        }
        f64::from(seen) / f64::from(all)
    }

    /// The distance of a point behind the edge of the occluder, px.
    fn behind(&self, o: &Occluder, dx: f64, dy: f64) -> f64 {
        let (nx, ny) = (o.angle.cos(), o.angle.sin());
        let edge = self.radius * (1.0 - 2.0 * o.hidden);
        if o.curvature == 0.0 {
            return dx * nx + dy * ny - edge;
        }
        let radius = 1.0 / o.curvature;
        let middle = edge + radius;
        let distance = (dx - nx * middle).hypot(dy - ny * middle);
        radius.signum() * (radius.abs() - distance)
    }

    /// Dark speckle, 0 to 1, on the fine grid: caps of a sphere that overlap and cross its limb.
    fn speckle_of_sphere(&self, r: &mut Random) -> Vec<f32> {
        let (w, h) = (self.width * FINE, self.height * FINE);
        let mut mask = vec![0.0_f32; w * h];
        // The same density as on a flat ball, over the visible hemisphere.
        let wanted = -(1.0 - self.cover).ln() * std::f64::consts::TAU * self.radius.powi(2);
        let mut laid = 0.0;
        while laid < wanted {
            let (height, turn) = (r.uniform(-0.2, 1.0), r.uniform(0.0, std::f64::consts::TAU));
            let size = (r.uniform(self.areas.0, self.areas.1) / std::f64::consts::PI).sqrt();
            if height > 0.0 {
                laid += std::f64::consts::PI * size * size;
            }
            let out = (1.0 - height * height).sqrt();
            let middle = [out * turn.cos(), out * turn.sin(), height];
            let span = |at: f64, c: f64, limit: usize| {
                let (low, high) = (at + c * self.radius - size - 1.0, at + c * self.radius + size + 2.0);
                let whole = |edge: f64| ((edge * FINE as f64).max(0.0) as usize).min(limit);
                whole(low)..whole(high)
            };
            for j in span(self.y, middle[1], h) {
                for i in span(self.x, middle[0], w) {
                    let (x, y) = ((place(i) - self.x) / self.radius, (place(j) - self.y) / self.radius);
                    let depth = (1.0 - x * x - y * y).max(0.0).sqrt();
                    let chord = (x - middle[0]).hypot(y - middle[1]).hypot(depth - middle[2]);
                    let cover = ((size - self.radius * chord) * FINE as f64 + 0.5).clamp(0.0, 1.0) as f32;
                    mask[j * w + i] = mask[j * w + i].max(cover);
                }
            }
        }
        mask
    }

    /// Dark speckle, 0 to 1, on the fine grid: discs that overlap and cross the rim.
    fn speckle(&self, r: &mut Random) -> Vec<f32> {
        let (w, h) = (self.width * FINE, self.height * FINE);
        let mut mask = vec![0.0_f32; w * h];
        let wanted = self.cover * std::f64::consts::PI * self.radius.powi(2);
        // Random discs overlap: a cover of c takes an area of -ln(1 - c).
        let wanted = if self.cover > 0.0 { -(1.0 - self.cover).ln() / self.cover * wanted } else { 0.0 };
        let mut laid = 0.0;
        while laid < wanted {
            let (dx, dy) = (r.uniform(-1.1, 1.1) * self.radius, r.uniform(-1.1, 1.1) * self.radius);
            let size = (r.uniform(self.areas.0, self.areas.1) / std::f64::consts::PI).sqrt();
            if dx.hypot(dy) > self.radius + size {
                continue;
            }
            if dx.hypot(dy) < self.radius {
                laid += std::f64::consts::PI * size * size;
            }
            let (cx, cy) = (self.x + dx, self.y + dy);
            let span = |c: f64, limit: usize| {
                let low = ((c - size - 1.0) * FINE as f64).max(0.0) as usize;
                low.min(limit)..(((c + size + 2.0) * FINE as f64).max(0.0) as usize).min(limit)
            };
            for j in span(cy, h) {
                for i in span(cx, w) {
                    let distance = (place(i) - cx).hypot(place(j) - cy);
                    let cover = ((size - distance) * FINE as f64 + 0.5).clamp(0.0, 1.0) as f32;
                    mask[j * w + i] = mask[j * w + i].max(cover);
                }
            }
        }
        mask
    }
}

/// The pixel coordinate of a fine sample.
fn place(i: usize) -> f64 {
    (i as f64 - (FINE / 2) as f64) / FINE as f64
}

fn texture(r: &mut Random, w: usize, h: usize, rms: f64, correlation: f64) -> Vec<f32> {
    let mut data: Vec<f32> = (0..w * h).map(|_| r.normal() as f32).collect();
    if rms <= 0.0 {
        data.fill(0.0);
        return data;
    }
    blur(&mut data, w, h, correlation);
    let power = data.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>() / data.len() as f64;
    let scale = (rms / power.sqrt().max(1e-9)) as f32;
    data.iter_mut().for_each(|v| *v *= scale);
    data
}

fn sample(data: &[f32], w: usize, h: usize, x: f64, y: f64) -> f64 {
    let (x, y) = (x.clamp(0.0, w as f64 - 1.001), y.clamp(0.0, h as f64 - 1.001));
    let (i, j) = (x as usize, y as usize);
    let (fx, fy) = (x - i as f64, y - j as f64);
    let at = |i: usize, j: usize| f64::from(data[j.min(h - 1) * w + i.min(w - 1)]);
    let (a, b) = (at(i, j) * (1.0 - fx) + at(i + 1, j) * fx, at(i, j + 1) * (1.0 - fx) + at(i + 1, j + 1) * fx);
    a * (1.0 - fy) + b * fy
}

/// Gaussian blur, the border repeated.
pub fn blur(data: &mut [f32], w: usize, h: usize, sigma: f64) {
    let reach = (4.0 * sigma).ceil() as usize;
    let taps: Vec<f32> =
        (0..=2 * reach).map(|k| (-0.5 * ((k as f64 - reach as f64) / sigma).powi(2)).exp() as f32).collect();
    let total: f32 = taps.iter().sum();
    let taps: Vec<f32> = taps.iter().map(|t| t / total).collect();
    let mut padded = vec![0.0_f32; w + 2 * reach];
    for row in data.chunks_exact_mut(w) {
        padded[..reach].fill(row[0]);
        padded[reach..reach + w].copy_from_slice(row);
        padded[reach + w..].fill(row[w - 1]);
        row.fill(0.0);
        for (k, tap) in taps.iter().enumerate() {
            row.iter_mut().zip(&padded[k..]).for_each(|(out, v)| *out += tap * v);
        }
    }
    let source = data.to_vec();
    for (y, row) in data.chunks_exact_mut(w).enumerate() {
        row.fill(0.0);
        for (k, tap) in taps.iter().enumerate() {
            let from = (y + k).saturating_sub(reach).min(h - 1) * w;
            row.iter_mut().zip(&source[from..from + w]).for_each(|(out, v)| *out += tap * v);
        }
    }
}
