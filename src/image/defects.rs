//! Defective pixels of a sensor, filled in from their neighbours.

use super::{Image, PixelRect};
use std::sync::Arc;

/// The distance of the farthest neighbour that fills in a pixel.
pub const REACH_PX: u32 = 2;

/// A neighbour: columns to the right, rows down, weight.
type Tap = (i8, i8, f32);

/// The interpolations of a pixel, best first: a cubic or a straight line through its neighbours along one axis or both.
/// Each tap also applies to the opposite neighbour.
const FILLINGS: [&[Tap]; 6] = [
    &[(1, 0, 1.0 / 3.0), (0, 1, 1.0 / 3.0), (2, 0, -1.0 / 12.0), (0, 2, -1.0 / 12.0)],
    &[(1, 0, 2.0 / 3.0), (2, 0, -1.0 / 6.0)],
    &[(0, 1, 2.0 / 3.0), (0, 2, -1.0 / 6.0)],
    &[(1, 0, 0.25), (0, 1, 0.25)],
    &[(1, 0, 0.5)],
    &[(0, 1, 0.5)],
];

/// Hot, dead or stuck pixels, each with the neighbours that fill it in.
#[derive(Debug, Clone, PartialEq)]
pub struct Defects {
    /// The defective pixels, sorted by row, then column.
    pixels: Arc<[Filled]>,
}

/// A defective pixel and the neighbours that fill it in.
#[derive(Debug, Clone, PartialEq)]
struct Filled {
    x: u32,
    y: u32,
    taps: Vec<Tap>,
}

/// Why a pixel cannot be filled in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum DefectError {
    /// It lies outside the image.
    #[error("[{x}, {y}] is outside the image of {width_px} x {height_px} px")]
    Outside {
        /// The column.
        x: u32,
        /// The row.
        y: u32,
        /// The width of the image.
        width_px: usize,
        /// The height of the image.
        height_px: usize,
    },
    /// All of its neighbours are defective as well.
    #[error("every pixel within {REACH_PX} px of [{x}, {y}] is defective")]
    Alone {
        /// The column.
        x: u32,
        /// The row.
        y: u32,
    },
}

impl crate::failure::Fatal for DefectError {}

impl Defects {
    /// Plans how to fill in these pixels, given by column and row, in images of this size; `None` if there are none.
    ///
    /// # Errors
    ///
    /// [`DefectError`] when a pixel is outside the image or has no sound neighbour.
    pub fn new(pixels: &[[u32; 2]], width_px: usize, height_px: usize) -> Result<Option<Self>, DefectError> {
        let mut places: Vec<(u32, u32)> = pixels.iter().map(|[x, y]| (*y, *x)).collect();
        places.sort_unstable();
        places.dedup();
        if let Some((y, x)) = places.iter().find(|(y, x)| *x as usize >= width_px || *y as usize >= height_px) {
            return Err(DefectError::Outside { x: *x, y: *y, width_px, height_px });
        }
        let filled = |&(y, x): &(u32, u32)| {
            let is_sound = |dx: i8, dy: i8| {
                let (x, y) = (i64::from(x) + i64::from(dx), i64::from(y) + i64::from(dy));
                let is_inside = (0..width_px as i64).contains(&x) && (0..height_px as i64).contains(&y);
                is_inside && places.binary_search(&(y as u32, x as u32)).is_err()
            };
            interpolation_taps(is_sound).map(|taps| Filled { x, y, taps }).ok_or(DefectError::Alone { x, y })
        };
        let pixels = places.iter().map(filled).collect::<Result<Arc<_>, _>>()?;
        Ok((!pixels.is_empty()).then_some(Self { pixels }))
    }

    /// Fills in the defective pixels within a part, clamped to the range of their neighbours.
    ///
    /// Reads up to 2 px around the part. `image` must have the size that the pixels were planned for.
    pub fn fill(&self, image: &mut Image, part: PixelRect) {
        let width = image.view().width();
        let levels = image.data_mut();
        let first = self.pixels.partition_point(|pixel| pixel.y < part.top);
        for pixel in self.pixels[first..].iter().take_while(|pixel| pixel.y < part.bottom) {
            if !(part.left..part.right).contains(&pixel.x) {
                continue;
            }
            let at = pixel.y as usize * width + pixel.x as usize;
            let near = |(dx, dy, weight): &Tap| {
                let place = at as isize + isize::from(*dy) * width as isize + isize::from(*dx);
                (levels[place as usize], *weight)
            };
            let (mut value, mut lowest, mut highest) = (0.0, f32::INFINITY, f32::NEG_INFINITY);
            for (level, weight) in pixel.taps.iter().map(near) {
                (value, lowest, highest) = (value + level * weight, level.min(lowest), level.max(highest));
            }
            // A value above full scale would conceal that the neighbours are saturated.
            levels[at] = value.clamp(lowest, highest);
        }
    }
}

/// Returns the taps of the first of [`FILLINGS`] whose neighbours are all sound, or equal taps on the sound neighbours.
///
/// Equal taps use the neighbours within 1 px, or within 2 px if all of these are defective. `is_sound` receives the
/// offset of a neighbour: columns to the right, rows down. `None` without a sound neighbour within 2 px.
fn interpolation_taps(is_sound: impl Fn(i8, i8) -> bool) -> Option<Vec<Tap>> {
    let sound = |&(dx, dy, _): &Tap| is_sound(dx, dy);
    let symmetric_taps = |interpolation_taps: &[Tap]| -> Vec<Tap> {
        interpolation_taps.iter().flat_map(|&(dx, dy, w)| [(dx, dy, w), (-dx, -dy, w)]).collect()
    };
    let whole = FILLINGS
        .iter()
        .map(|interpolation_taps| symmetric_taps(interpolation_taps))
        .find(|interpolation_taps| interpolation_taps.iter().all(sound));
    whole.or_else(|| {
        (1..=REACH_PX as i8).find_map(|reach| {
            let places = (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy, 1.0)));
            let near: Vec<Tap> = places.filter(sound).collect();
            let weight = 1.0 / near.len() as f32;
            (!near.is_empty()).then(|| near.into_iter().map(|(dx, dy, _)| (dx, dy, weight)).collect())
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 12;

    /// A curved distribution of light, with these pixels at full scale.
    fn picture(stuck: &[[u32; 2]]) -> Image {
        let mut image = Image::new(SIZE, SIZE);
        for (k, level) in image.data_mut().iter_mut().enumerate() {
            *level = light((k % SIZE) as f32, (k / SIZE) as f32);
        }
        for [x, y] in stuck {
            image.data_mut()[*y as usize * SIZE + *x as usize] = 255.0;
        }
        image
    }

    fn light(x: f32, y: f32) -> f32 {
        60.0 + 4.0 * x - 2.0 * y + 0.3 * x * x - 0.02 * x * x * x + 0.2 * y * y
    }

    fn worst(stuck: &[[u32; 2]]) -> f32 {
        let mut image = picture(stuck);
        let defects = Defects::new(stuck, SIZE, SIZE).unwrap().unwrap();
        defects.fill(&mut image, PixelRect::whole(SIZE as u32, SIZE as u32));
        let off = |(k, level): (usize, &f32)| (level - light((k % SIZE) as f32, (k / SIZE) as f32)).abs();
        image.view().data().iter().enumerate().map(off).fold(0.0, f32::max)
    }

    #[test]
    fn curved_light_is_filled_in_as_it_was() {
        assert!(worst(&[[5, 6]]) < 1e-3 && worst(&[[2, 6], [8, 3]]) < 1e-3);
        // Next to another one, or at the edge, along the other axis.
        assert!(worst(&[[5, 6], [6, 6]]) < 1e-3 && worst(&[[0, 6]]) < 1e-3 && worst(&[[4, 11]]) < 1e-3);
        // In a corner, and in clusters, about as bright as the neighbours.
        assert!(worst(&[[0, 0]]) < 6.0);
        let cluster: Vec<[u32; 2]> = (4..7).flat_map(|y| (4..7).map(move |x| [x, y])).collect();
        assert!(worst(&cluster) < 6.0, "{}", worst(&cluster));
    }

    #[test]
    fn only_the_requested_part_is_filled_in() {
        let stuck = [[3, 3], [9, 3], [3, 9]];
        let mut image = picture(&stuck);
        Defects::new(&stuck, SIZE, SIZE)
            .unwrap()
            .unwrap()
            .fill(&mut image, PixelRect { left: 2, top: 2, right: 8, bottom: 8 });
        assert!(image.view().at(3, 3).unwrap() < 200.0);
        assert!(image.view().at(9, 3).unwrap() > 254.0 && image.view().at(3, 9).unwrap() > 254.0);
    }

    #[test]
    fn nothing_is_filled_in_beyond_full_scale() {
        let mut image = Image::new(SIZE, SIZE);
        for (k, level) in image.data_mut().iter_mut().enumerate() {
            let away = (k % SIZE).abs_diff(6) + (k / SIZE).abs_diff(6);
            *level = if away < 2 { 255.0 } else { 40.0 };
        }
        Defects::new(&[[6, 6]], SIZE, SIZE)
            .unwrap()
            .unwrap()
            .fill(&mut image, PixelRect::whole(SIZE as u32, SIZE as u32));
        assert!((image.view().at(6, 6).unwrap() - 255.0).abs() < 1e-3);
    }

    #[test]
    fn pixels_that_cannot_be_filled_in_are_refused() {
        assert_eq!(Defects::new(&[], SIZE, SIZE), Ok(None));
        let error = Defects::new(&[[12, 3]], SIZE, SIZE).unwrap_err();
        assert_eq!(error.to_string(), "[12, 3] is outside the image of 12 x 12 px");
        let cluster: Vec<[u32; 2]> = (3..8).flat_map(|y| (3..8).map(move |x| [x, y])).collect();
        let error = Defects::new(&cluster, SIZE, SIZE).unwrap_err();
        assert_eq!(error.to_string(), "every pixel within 2 px of [5, 5] is defective");
    }
}
