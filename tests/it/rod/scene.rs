//! A tilted rod drawn from its formula: black, with two light tapes.

use ricochet::image::Image;

/// An image of a rod, and so its truth.
#[derive(Clone, Copy)]
pub struct Scene {
    pub width: usize,
    pub height: usize,
    /// The middle of the rod at the middle of the upper tape.
    pub center: [f64; 2],
    pub half_width: f64,
    /// Counter-clockwise on the screen.
    pub tilt_deg: f64,
    /// Edges of both tapes, from the centre downwards.
    pub edges: [f64; 4],
    pub blur: f64,
    pub noise: f64,
    /// Grey levels of background, rod and tapes.
    pub shades: [f64; 3],
    pub seed: u64,
}

pub const SCENE: Scene = Scene {
    width: 70,
    height: 150,
    center: [34.3, 50.6],
    half_width: 15.2,
    tilt_deg: 0.0,
    edges: [-22.0, 23.0, 45.5, 66.0],
    blur: 0.76,
    noise: 2.0,
    shades: [60.0, 20.0, 180.0],
    seed: 1,
};

/// Nearly normal noise: sums of twelve uniform numbers.
fn normal(state: &mut u64) -> f64 {
    let mut even = || {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..12).map(|_| even()).sum::<f64>() - 6.0
}

/// The integral of the normal density, by its series (error under 1e-9 up to 5).
fn integral(x: f64) -> f64 {
    if x.abs() > 5.0 {
        return if x > 0.0 { 1.0 } else { 0.0 };
    }
    let (mut term, mut sum) = (x, x);
    for k in 1..80 {
        term *= x * x / (2.0 * f64::from(k) + 1.0);
        sum += term;
    }
    0.5 + sum * (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt()
}

impl Scene {
    pub fn draw(&self) -> Image {
        let mut image = Image::new(self.width, self.height);
        let (sin, cos) = self.tilt_deg.to_radians().sin_cos();
        let mut state = self.seed;
        let [ground, rod, tape] = self.shades;
        for y in 0..self.height {
            for x in 0..self.width {
                let (dx, dy) = (x as f64 - self.center[0], y as f64 - self.center[1]);
                // From the image to the upright rod.
                let (across, along) = (dx * cos - dy * sin, dx * sin + dy * cos);
                let step = |distance: f64| integral(distance / self.blur);
                let inside = step(across + self.half_width) - step(across - self.half_width);
                let [a, b, c, d] = self.edges.map(|edge| step(along - edge));
                let dots = self.dots(across, along);
                let painted = rod + (tape - rod) * (a - b + c - d) - (tape - 30.0) * dots;
                let level = ground + inside * (painted - ground) + self.noise * normal(&mut state);
                image.data_mut()[y * self.width + x] = level as f32;
            }
        }
        image
    }

    /// Dark dots in the middle of the upper tape, well clear of its edges.
    fn dots(&self, across: f64, along: f64) -> f64 {
        let is_clear = along > self.edges[0] + 9.0 && along < self.edges[1] - 9.0 && across.abs() < 9.0;
        if is_clear { (0.5 + 0.5 * (1.3 * across + 0.4 * along).sin() * (0.9 * along).cos()).powi(3) } else { 0.0 }
    }

    /// The points where the edges cross the middle of the rod.
    pub fn edges_px(&self) -> [f64; 4] {
        let cos = self.tilt_deg.to_radians().cos();
        self.edges.map(|edge| self.center[1] + edge * cos)
    }
}
