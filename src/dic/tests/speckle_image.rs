//! Test images: speckle discs with soft rims, rendered analytically.
//!
//! There is no interpolation: a displaced image is drawn from displaced centres, and each pixel is integrated by 3 x 3
//! Gauss points.

use crate::dic::image::{Interpolation, PreparedFrame};
use crate::image::Image;

/// One disc: centre and radius, px.
#[derive(Debug, Clone, Copy)]
pub(in crate::dic) struct Disc {
    pub(in crate::dic) x: f64,
    pub(in crate::dic) y: f64,
    pub(in crate::dic) radius: f64,
}

/// A pattern of discs.
#[derive(Debug, Clone)]
pub(in crate::dic) struct Speckle {
    pub(in crate::dic) discs: Vec<Disc>,
    /// The standard deviation of the Gaussian that softens the rim, px.
    pub(in crate::dic) edge: f64,
    pub(in crate::dic) contrast: f64,
}

/// A pseudo-random sequence of numbers in 0..1.
#[derive(Debug, Clone)]
pub(in crate::dic) struct Sequence(u64);

impl Sequence {
    /// Starts the sequence of a seed. Different seeds share nothing, because the seed is scrambled rather than added to
    /// the counter.
    pub(in crate::dic) fn new(seed: u64) -> Self {
        Self(scramble(scramble(seed) ^ 0xD1B5_4A32_D192_ED03))
    }

    pub(in crate::dic) fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        (scramble(self.0) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Returns a standard normal number (Box and Muller).
    pub(in crate::dic) fn normal(&mut self) -> f64 {
        let (a, b) = (1.0 - self.uniform(), self.uniform());
        (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    }
}

/// The finalizer of SplitMix64.
fn scramble(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

impl Speckle {
    /// Places discs of radius `low..high`, px, over a `side` x `side` image and 30 px around it. Their areas add up to
    /// half of that area.
    pub(in crate::dic) fn new(seed: u64, side: f64, (low, high): (f64, f64), edge: f64) -> Self {
        let mut sequence = Sequence::new(seed);
        let (margin, mean) = (30.0, 0.5 * (low + high));
        let area = (side + 2.0 * margin).powi(2);
        let count = (0.5 * area / (std::f64::consts::PI * mean * mean)) as usize;
        let mut place = || sequence.uniform() * (side + 2.0 * margin) - margin;
        let centers: Vec<(f64, f64)> = (0..count).map(|_| (place(), place())).collect();
        let discs =
            centers.into_iter().map(|(x, y)| Disc { x, y, radius: low + (high - low) * sequence.uniform() }).collect();
        Self { discs, edge, contrast: 200.0 }
    }

    /// The standard pattern: discs 3 to 6 px across.
    pub(in crate::dic) fn standard(seed: u64, side: f64) -> Self {
        Self::new(seed, side, (1.5, 2.9), 0.6)
    }

    /// Returns the pattern with each disc displaced by `motion` of its centre (x, y), px.
    pub(in crate::dic) fn moved(&self, motion: impl Fn(f64, f64) -> (f64, f64)) -> Self {
        let discs = self.discs.iter().map(|disc| {
            let (u, v) = motion(disc.x, disc.y);
            Disc { x: disc.x + u, y: disc.y + v, radius: disc.radius }
        });
        Self { discs: discs.collect(), ..*self }
    }

    /// Renders the pattern without noise and rounding: discs that are `contrast` darker than their ground of 218 DN.
    pub(in crate::dic) fn draw(&self, width: usize, height: usize) -> Image {
        let mut clear = vec![1.0_f64; width * height * 9];
        let nodes = [-0.387_298_334_620_741_7, 0.0, 0.387_298_334_620_741_7];
        for disc in &self.discs {
            let reach = disc.radius + 3.0 * self.edge + 1.0;
            let range = |center: f64, size: usize| {
                let low = (center - reach).ceil().max(0.0) as usize;
                let high = (center + reach).floor().min(size as f64 - 1.0);
                low..if high < 0.0 { 0 } else { high as usize + 1 }
            };
            for y in range(disc.y, height) {
                for x in range(disc.x, width) {
                    for k in 0..9 {
                        let (dx, dy) = (x as f64 + nodes[k % 3] - disc.x, y as f64 + nodes[k / 3] - disc.y);
                        let cover =
                            0.5 * libm::erfc((dx.hypot(dy) - disc.radius) / (self.edge * std::f64::consts::SQRT_2));
                        clear[(y * width + x) * 9 + k] *= 1.0 - cover;
                    }
                }
            }
        }
        let weights = [5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0];
        let level = |k: usize| {
            let light: f64 = (0..9).map(|i| weights[i % 3] * weights[i / 3] * clear[9 * k + i]).sum();
            (218.0 - self.contrast * (1.0 - light)) as f32
        };
        Image::from_vec((0..width * height).map(level).collect(), width, height).unwrap()
    }
}

/// Returns an image with Gaussian noise of the standard deviation `sigma`, DN, rounded to 8 bit.
pub(in crate::dic) fn record(clean: &Image, sigma: f64, seed: u64) -> Image {
    let mut sequence = Sequence::new(seed);
    let level = |value: &f32| (f64::from(*value) + sigma * sequence.normal()).round().clamp(0.0, 255.0) as f32;
    let view = clean.view();
    Image::from_vec(view.data().iter().map(level).collect(), view.width(), view.height()).unwrap()
}

/// Returns an image prepared with [`Interpolation::Optimised`].
pub(in crate::dic) fn prepared(image: &Image) -> PreparedFrame {
    let mut prepared = PreparedFrame::default();
    prepared.fill(image.view(), Interpolation::Optimised);
    prepared
}
