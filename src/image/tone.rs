//! The tone curve of a camera, removed from its grey levels.

use super::{Image, PixelFormat, PixelRect};
use std::sync::Arc;

/// The light behind each grey level of a camera with a power-law tone curve.
///
/// `grey / full = (light / full)^gamma`, so that black and full scale stay as they are. Cameras made for viewing
/// imitate the curve of displays (IEC 61966-2-1).
#[derive(Debug, Clone, PartialEq)]
pub struct Tone {
    light: Arc<[f32]>,
}

impl Tone {
    /// Tabulates the inverse curve of a camera with this exponent (no unit, positive) for every grey level of `format`.
    ///
    /// `None` for an exponent of 1, where grey levels are proportional to the light.
    pub fn new(gamma: f64, format: PixelFormat) -> Option<Self> {
        let levels = 1_u32 << format.bits();
        let full = f64::from(levels - 1);
        let light = |grey: u32| (full * (f64::from(grey) / full).powf(1.0 / gamma)) as f32;
        (gamma.total_cmp(&1.0).is_ne()).then(|| Self { light: (0..levels).map(light).collect() })
    }

    /// Replaces the grey levels of a part, clipped to the image, by the light behind them, DN.
    pub fn linearize(&self, image: &mut Image, part: PixelRect) {
        for row in image.rows_mut().take(part.bottom as usize).skip(part.top as usize) {
            let right = (part.right as usize).min(row.len());
            row[(part.left as usize).min(right)..right].iter_mut().for_each(|grey| *grey = self.light(*grey));
        }
    }

    /// Returns the linear level behind a grey level, DN; beyond full scale, that of full scale.
    ///
    /// Grey levels are truncated to integers.
    fn light(&self, grey: f32) -> f32 {
        // A 16-bit word can exceed the significant bits; such a level is beyond full scale.
        self.light.get(grey as usize).or(self.light.last()).copied().unwrap_or(grey)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn black_and_white_stay_and_levels_between_become_the_light() {
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
    fn only_the_requested_part_changes() {
        let mut image = Image::new(4, 3);
        image.rows_mut().for_each(|row| row.fill(100.0));
        let part = PixelRect { left: 1, top: 1, right: 3, bottom: 9 };
        Tone::new(0.5, PixelFormat::Mono8).unwrap().linearize(&mut image, part);
        let inside = 100.0_f32 * 100.0 / 255.0;
        for (k, grey) in image.view().data().iter().enumerate() {
            let is_inside = (1..3).contains(&(k % 4)) && k / 4 >= 1;
            assert!((grey - if is_inside { inside } else { 100.0 }).abs() < 1e-4, "{k}: {grey}");
        }
    }
}
