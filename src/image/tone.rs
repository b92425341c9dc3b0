//! A camera's tone curve, taken out of its grey levels.

use super::{Image, PixelFormat};
use std::sync::Arc;

/// The light behind each grey level of a camera whose grey levels go as a power of it.
///
/// `grey / full = (light / full)^gamma`, so that black and full scale stay what they are (IEC 61966-2-1 for displays, which
/// cameras made for them imitate).
#[derive(Debug, Clone, PartialEq)]
pub struct Tone {
    light: Arc<[f32]>,
}

impl Tone {
    /// The curve of a camera with this exponent; `None` for 1, where grey levels are light.
    pub fn new(gamma: f64, format: PixelFormat) -> Option<Self> {
        let levels = 1_u32 << format.bits();
        let full = f64::from(levels - 1);
        let light = |grey: u32| (full * (f64::from(grey) / full).powf(1.0 / gamma)) as f32;
        (gamma.total_cmp(&1.0).is_ne()).then(|| Self { light: (0..levels).map(light).collect() })
    }

    /// Puts light in the place of grey levels: left, top, right and bottom of them, px, the last two outside.
    pub fn straighten(&self, image: &mut Image, [left, top, right, bottom]: [u32; 4]) {
        let [left, top, right, bottom] = [left, top, right, bottom].map(|edge| edge as usize);
        for row in image.rows_mut().take(bottom).skip(top) {
            let right = right.min(row.len());
            row[left.min(right)..right].iter_mut().for_each(|grey| *grey = self.light(*grey));
        }
    }

    fn light(&self, grey: f32) -> f32 {
        // Words may hold more than their significant bits: such levels are beyond full scale.
        self.light.get(grey as usize).or(self.light.last()).copied().unwrap_or(grey)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn black_and_white_stay_and_what_is_between_is_what_the_camera_saw() {
        for (format, full) in [(PixelFormat::Mono8, 255.0_f32), (PixelFormat::Mono12, 4095.0)] {
            let tone = Tone::new(0.45, format).unwrap();
            assert_eq!((tone.light(0.0), tone.light(full), tone.light(full + 9.0)), (0.0, full, full));
            for light in [0.05_f64, 0.2, 0.7] {
                let grey = (f64::from(full) * light.powf(0.45)).round() as f32;
                assert!((f64::from(tone.light(grey) / full) - light).abs() < 2.0 / f64::from(full), "{light}");
            }
        }
        assert_eq!(Tone::new(1.0, PixelFormat::Mono8), None);
    }

    #[test]
    fn only_what_is_asked_for_is_changed() {
        let mut image = Image::new(4, 3);
        image.rows_mut().for_each(|row| row.fill(100.0));
        Tone::new(0.5, PixelFormat::Mono8).unwrap().straighten(&mut image, [1, 1, 3, 9]);
        let inside = 100.0_f32 * 100.0 / 255.0;
        for (k, grey) in image.view().data().iter().enumerate() {
            let is_asked = (1..3).contains(&(k % 4)) && k / 4 >= 1;
            assert!((grey - if is_asked { inside } else { 100.0 }).abs() < 1e-4, "{k}: {grey}");
        }
    }
}
