//! The camera sensor: noise, quantization, packing.

use super::scenario::CameraSetup;
use crate::image::PixelFormat;
use crate::numeric::normal_cdf;
use crate::numeric::{GOLDEN_GAMMA, Stream, key, scramble};

/// The number of noise values; 12 random bits choose one.
const QUANTILES: usize = 4096;
/// The number of pixels that share one random number.
const LANES: usize = 4;

/// Converts light (DN, not rounded) to bytes.
#[derive(Debug, Clone)]
pub(crate) struct Sensor {
    format: PixelFormat,
    full_dn: f32,
    read_variance_dn2: f32,
    /// The variance per DN of light.
    shot_variance_dn: f32,
    /// Equally likely values of the standard normal distribution.
    quantiles: Vec<f32>,
    /// Gain and offset (DN) of every pixel, row-major; `None` if all are equal.
    fixed: Option<Vec<(f32, f32)>>,
    /// The exponent of the tone curve; `None` if grey levels are proportional to the light.
    gamma: Option<f32>,
}

impl Sensor {
    /// Prepares the noise and the fixed pattern of a sensor. `seed` selects its fixed pattern.
    pub(crate) fn new(camera: &CameraSetup, format: PixelFormat, seed: u64) -> Self {
        let full_dn = f64::from((1u32 << format.bits()) - 1);
        let variance = camera.noise_dn * camera.noise_dn;
        Self {
            format,
            full_dn: full_dn as f32,
            read_variance_dn2: (variance * (1.0 - camera.shot_share)) as f32,
            shot_variance_dn: (variance * camera.shot_share / (0.5 * full_dn)) as f32,
            quantiles: normal_quantiles(),
            fixed: fixed_pattern(camera, full_dn as f32, seed),
            gamma: (camera.gamma < 1.0).then_some(camera.gamma as f32),
        }
    }

    /// The maximum grey level, DN.
    pub(crate) fn full_dn(&self) -> f32 {
        self.full_dn
    }

    /// Converts one row of light (DN) to pixels: fixed pattern, noise, tone curve, clipping, rounding, in this order.
    ///
    /// The noise is a function of `key`, `row` and the column. `light_dn` is overwritten.
    ///
    /// # Panics
    ///
    /// If `bytes` and the row differ in length.
    pub(crate) fn expose(&self, key: u64, row: usize, light_dn: &mut [f32], bytes: &mut [u8]) {
        assert_eq!(bytes.len(), light_dn.len() * self.format.bytes_per_pixel(), "row and bytes differ in length");
        if let Some(fixed) = &self.fixed {
            let pixels = &fixed[row * light_dn.len()..];
            light_dn.iter_mut().zip(pixels).for_each(|(light, (gain, offset_dn))| *light = *light * gain + offset_dn);
        }
        if self.read_variance_dn2 + self.shot_variance_dn > 0.0 {
            self.add_noise(key, row, light_dn);
        }
        if let Some(gamma) = self.gamma {
            let tone = |light: f32| self.full_dn * (light.clamp(0.0, self.full_dn) / self.full_dn).powf(gamma);
            light_dn.iter_mut().for_each(|light| *light = tone(*light));
        }
        let level = |light: f32| light.clamp(0.0, self.full_dn) + 0.5;
        match self.format {
            PixelFormat::Mono8 => {
                bytes.iter_mut().zip(light_dn).for_each(|(byte, light)| *byte = level(*light) as u8);
            }
            PixelFormat::Mono10 | PixelFormat::Mono12 | PixelFormat::Mono16 => {
                bytes.chunks_exact_mut(2).zip(light_dn).for_each(|(pair, light)| {
                    pair.copy_from_slice(&(level(*light) as u16).to_le_bytes());
                });
            }
        }
    }

    /// Adds read and shot noise to a row, DN. Four pixels share one random number of 64 bits.
    fn add_noise(&self, key: u64, row: usize, light_dn: &mut [f32]) {
        let blocks = light_dn.len().div_ceil(LANES) as u64;
        let mut count = key.wrapping_add((row as u64 * blocks).wrapping_mul(GOLDEN_GAMMA));
        for block in light_dn.chunks_mut(LANES) {
            count = count.wrapping_add(GOLDEN_GAMMA);
            let bits = scramble(count);
            for (lane, light) in block.iter_mut().enumerate() {
                let place = (bits >> (16 * lane + 4)) as usize % QUANTILES;
                let variance = self.read_variance_dn2 + self.shot_variance_dn * light.max(0.0);
                *light += self.quantiles[place] * variance.sqrt();
            }
        }
    }
}

/// Returns gain and offset (DN) of every pixel, row-major, the same in every frame; `None` if all pixels are equal.
fn fixed_pattern(camera: &CameraSetup, full_dn: f32, seed: u64) -> Option<Vec<(f32, f32)>> {
    const PURPOSE: u64 = 5;
    if camera.gain_spread <= 0.0 && camera.offset_spread_dn <= 0.0 && camera.stuck_share <= 0.0 {
        return None;
    }
    let mut stream = Stream::new(key(seed, PURPOSE, 0));
    let pixels = camera.width_px as usize * camera.height_px as usize;
    let pixel = |stream: &mut Stream| {
        let gain = 1.0 + camera.gain_spread * stream.normal();
        (gain as f32, (camera.offset_spread_dn * stream.normal()) as f32)
    };
    let mut fixed: Vec<_> = (0..pixels).map(|_| pixel(&mut stream)).collect();
    add_stuck_pixels(&mut fixed, camera.stuck_share, full_dn, seed);
    Some(fixed)
}

/// Makes random pixels stuck, each with probability `share`, alternately at full scale and at zero.
fn add_stuck_pixels(fixed: &mut [(f32, f32)], share: f64, full_dn: f32, seed: u64) {
    const PURPOSE: u64 = 6;
    let mut stream = Stream::new(key(seed, PURPOSE, 0));
    // Beyond the range of the noise.
    let ends = [3.0 * full_dn, -3.0 * full_dn];
    let stuck = fixed.iter_mut().filter(|_| stream.uniform() < share);
    stuck.zip(ends.into_iter().cycle()).for_each(|(pixel, end_dn)| *pixel = (0.0, end_dn));
}

/// Returns the medians of [`QUANTILES`] equally likely slices of the standard normal distribution, smallest first,
/// scaled to a standard deviation of exactly 1.
fn normal_quantiles() -> Vec<f32> {
    let values: Vec<f64> = (0..QUANTILES)
        .map(|index| {
            let wanted = (index as f64 + 0.5) / QUANTILES as f64;
            let (mut low, mut high) = (-6.0, 6.0);
            for _ in 0..40 {
                let middle = 0.5 * (low + high);
                if normal_cdf(middle) < wanted { low = middle } else { high = middle }
            }
            0.5 * (low + high)
        })
        .collect();
    let power = values.iter().map(|value| value * value).sum::<f64>() / QUANTILES as f64;
    values.into_iter().map(|value| (value / power.sqrt()) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::Scenario;

    fn sensor(noise_dn: f64, shot_share: f64, format: PixelFormat) -> Sensor {
        let camera = Scenario::translation(0.0, 0.0, 0.0).camera;
        Sensor::new(&CameraSetup { noise_dn, shot_share, bits: format.bits(), ..camera }, format, 1)
    }

    fn noise_of(sensor: &Sensor, light_dn: f32, key: u64) -> Vec<f64> {
        let mut noise = Vec::new();
        for row in 0..300 {
            let mut light = vec![light_dn; 301];
            sensor.add_noise(key, row, &mut light);
            noise.extend(light.iter().map(|value| f64::from(value - light_dn)));
        }
        noise
    }

    fn deviation(values: &[f64]) -> f64 {
        (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
    }

    #[test]
    fn noise_has_the_configured_deviation_and_no_mean() {
        let noise = noise_of(&sensor(2.0, 0.0, PixelFormat::Mono8), 100.0, 11);
        let mean = noise.iter().sum::<f64>() / noise.len() as f64;
        // 90 300 samples: the mean scatters by 0.0067, the deviation by 0.0047.
        assert!(mean.abs() < 0.025, "{mean}");
        assert!((deviation(&noise) - 2.0).abs() < 0.02, "{}", deviation(&noise));
        let beyond = noise.iter().filter(|value| value.abs() > 3.92).count() as f64 / noise.len() as f64;
        assert!((beyond - 0.05).abs() < 0.004, "normal tails: {beyond}");
    }

    #[test]
    fn shot_noise_grows_with_the_root_of_the_light() {
        let sensor = sensor(2.0, 1.0, PixelFormat::Mono8);
        let (dark, bright) = (noise_of(&sensor, 50.0, 1), noise_of(&sensor, 200.0, 2));
        assert!((deviation(&bright) / deviation(&dark) - 2.0).abs() < 0.03);
        assert!((deviation(&noise_of(&sensor, 127.5, 3)) - 2.0).abs() < 0.02);
    }

    #[test]
    fn neighbours_frames_and_rows_are_unrelated() {
        let sensor = sensor(1.0, 0.0, PixelFormat::Mono8);
        let (here, there) = (noise_of(&sensor, 100.0, 5), noise_of(&sensor, 100.0, 6));
        let related = |left: &[f64], right: &[f64]| {
            left.iter().zip(right).map(|(left, right)| left * right).sum::<f64>() / left.len() as f64
        };
        for shift in [1, 2, 4, 301] {
            assert!(related(&here[shift..], &here).abs() < 0.015, "shift {shift}");
        }
        assert!(related(&here, &there).abs() < 0.015);
    }

    #[test]
    fn the_fixed_pattern_stays_and_has_the_configured_spread() {
        let camera = CameraSetup {
            noise_dn: 0.0,
            gain_spread: 0.02,
            offset_spread_dn: 1.5,
            ..Scenario::translation(0.0, 0.0, 0.0).camera
        };
        let sensor = Sensor::new(&camera, PixelFormat::Mono8, 1);
        let fixed = sensor.fixed.as_ref().unwrap();
        let gains: Vec<f64> = fixed.iter().map(|(gain, _)| f64::from(*gain) - 1.0).collect();
        let offsets: Vec<f64> = fixed.iter().map(|(_, offset)| f64::from(*offset)).collect();
        assert!((deviation(&gains) / 0.02 - 1.0).abs() < 0.01 && (deviation(&offsets) / 1.5 - 1.0).abs() < 0.01);
        let (mut one, mut other) = (vec![0; 512], vec![0; 512]);
        sensor.expose(1, 7, &mut [100.0; 512], &mut one);
        sensor.expose(2, 7, &mut [100.0; 512], &mut other);
        assert!(one == other && one.iter().any(|pixel| *pixel != 100));
    }

    #[test]
    fn light_is_rounded_half_up_and_clipped() {
        let sensor = sensor(0.0, 0.0, PixelFormat::Mono8);
        let mut bytes = [0; 5];
        sensor.expose(0, 0, &mut [-3.0, 0.49, 0.5, 254.5, 300.0], &mut bytes);
        assert_eq!(bytes, [0, 0, 1, 255, 255]);
    }

    #[test]
    fn a_tone_curve_lifts_the_dark_with_its_noise_and_keeps_both_ends() {
        let camera = CameraSetup { gamma: 0.5, noise_dn: 1.0, ..Scenario::translation(0.0, 0.0, 0.0).camera };
        let exposed = |light_dn: f32, noise_dn: f64| {
            let mut bytes = vec![0; 4096];
            let sensor = Sensor::new(&CameraSetup { noise_dn, ..camera.clone() }, PixelFormat::Mono8, 1);
            sensor.expose(7, 0, &mut [light_dn; 4096], &mut bytes);
            bytes.into_iter().map(f64::from).collect::<Vec<_>>()
        };
        let levels = [0.0, 63.75, 255.0].map(|light_dn| exposed(light_dn, 0.0)[0] as u8);
        assert_eq!(levels, [0, 128, 255]);
        let spread = |light_dn: f32| {
            let levels = exposed(light_dn, 1.0);
            let mean = levels.iter().sum::<f64>() / 4096.0;
            deviation(&levels.iter().map(|level| level - mean).collect::<Vec<_>>())
        };
        // The slope of the square root at 1/16 is 2, at 9/16 it is 2/3; rounding adds 1/12 to the variance.
        for (light_dn, slope) in [(255.0 / 16.0, 2.0_f64), (9.0 * 255.0 / 16.0, 2.0 / 3.0)] {
            assert!((spread(light_dn) / slope.hypot(12_f64.sqrt().recip()) - 1.0).abs() < 0.05, "{}", spread(light_dn));
        }
    }

    #[test]
    fn deep_formats_are_little_endian_words() {
        let sensor = sensor(0.0, 0.0, PixelFormat::Mono12);
        let mut bytes = [0; 4];
        sensor.expose(0, 0, &mut [258.0, 5000.0], &mut bytes);
        assert_eq!(bytes, [2, 1, 0xff, 0x0f]);
    }
}
