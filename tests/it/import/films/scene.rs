//! A speckled ball that moves and turns, drawn at any moment.

use std::path::{Path, PathBuf};

/// Number of speckles of the ball.
const SPECKLES: u32 = 260;
/// Standard deviation of a speckle, pixels.
const SPECKLE_PX: f64 = 1.3;

/// A ball, its motion per frame, and the noise of the camera.
#[derive(Debug, Clone, Copy)]
pub struct Ball {
    pub radius_px: f64,
    /// Centre in frame 0, pixels, y down.
    pub start_px: [f64; 2],
    /// Motion, pixels per frame.
    pub step_px: [f64; 2],
    /// Rotation, counter-clockwise on the screen, degrees per frame.
    pub step_deg: f64,
    /// Largest noise of a pixel, DN.
    pub noise: u32,
}

impl Default for Ball {
    fn default() -> Self {
        Self { radius_px: 30.0, start_px: [42.0, 48.0], step_px: [0.8, 0.3], step_deg: 0.5, noise: 3 }
    }
}

impl Ball {
    pub const SIZE: [u32; 2] = [144, 112];

    /// Draws the picture at a time, frames. `number` is the seed of its noise.
    pub fn picture(&self, time: f64, number: u32) -> Vec<u8> {
        let [width, height] = Self::SIZE;
        let levels = self.speckles(time);
        let noise =
            |at: u32| f64::from(hash(number.wrapping_mul(65_537) ^ at) % (2 * self.noise + 1)) - f64::from(self.noise);
        let center = [0, 1].map(|axis| self.start_px[axis] + self.step_px[axis] * time);
        let level = |x: u32, y: u32| {
            let at = y * width + x;
            let [dx, dy] = [f64::from(x) - center[0], f64::from(y) - center[1]];
            let covered = (self.radius_px + 0.5 - dx.hypot(dy)).clamp(0.0, 1.0);
            let ball = (150.0 - 110.0 * levels[at as usize].min(1.0)).max(20.0);
            (30.0 + covered * (ball - 30.0) + noise(at)).round().clamp(0.0, 255.0) as u8
        };
        (0..height).flat_map(|y| (0..width).map(move |x| [x, y])).map(|[x, y]| level(x, y)).collect()
    }

    /// The darkness of the speckles at each pixel.
    fn speckles(&self, time: f64) -> Vec<f64> {
        let [width, height] = Self::SIZE;
        let mut levels = vec![0.0; (width * height) as usize];
        let angle = (self.step_deg * time).to_radians();
        for speckle in 0..SPECKLES {
            let place = |axis: u32| f64::from(hash(speckle * 2 + axis) % 20_000) / 10_000.0 - 1.0;
            let [u, v] = [place(0) * self.radius_px, place(1) * self.radius_px];
            // Counter-clockwise on the screen, y down.
            let x = self.start_px[0] + self.step_px[0] * time + u * angle.cos() + v * angle.sin();
            let y = self.start_px[1] + self.step_px[1] * time - u * angle.sin() + v * angle.cos();
            for row in (y - 5.0).max(0.0) as u32..((y + 6.0).max(0.0) as u32).min(height) {
                for column in (x - 5.0).max(0.0) as u32..((x + 6.0).max(0.0) as u32).min(width) {
                    let square = (f64::from(column) - x).powi(2) + (f64::from(row) - y).powi(2);
                    levels[(row * width + column) as usize] += (-square / (2.0 * SPECKLE_PX * SPECKLE_PX)).exp();
                }
            }
        }
        levels
    }
}

/// A number that looks random.
fn hash(seed: u32) -> u32 {
    let mixed = (seed ^ 0x9E37_79B9).wrapping_mul(0x85EB_CA6B);
    let mixed = (mixed ^ (mixed >> 13)).wrapping_mul(0xC2B2_AE35);
    mixed ^ (mixed >> 16)
}

/// Writes pictures of [`Ball::SIZE`] as a NumPy stack.
pub fn stack(folder: &Path, pictures: impl Iterator<Item = Vec<u8>>) -> PathBuf {
    let pictures: Vec<Vec<u8>> = pictures.collect();
    let shape = format!("({}, {}, {})", pictures.len(), Ball::SIZE[1], Ball::SIZE[0]);
    let path = folder.join("stack.npy");
    std::fs::write(&path, super::super::npy("|u1", "False", &shape, &pictures.concat())).unwrap();
    path
}
