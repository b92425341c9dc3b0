//! Pixels of a sensor that do not see, filled in from those around them.

use super::Image;
use std::sync::Arc;

/// Pixels around one that is filled in which may be needed for it.
pub const REACH_PX: u32 = 2;

/// A neighbour: columns right, rows down, and its weight.
type Tap = (i8, i8, f32);

/// What fills a pixel, the best first: the straight line, or the cubic, through its neighbours along one axis or both. Taps of
/// the same weights lie on the other side as well.
const FILLINGS: [&[Tap]; 6] = [
    &[(1, 0, 1.0 / 3.0), (0, 1, 1.0 / 3.0), (2, 0, -1.0 / 12.0), (0, 2, -1.0 / 12.0)],
    &[(1, 0, 2.0 / 3.0), (2, 0, -1.0 / 6.0)],
    &[(0, 1, 2.0 / 3.0), (0, 2, -1.0 / 6.0)],
    &[(1, 0, 0.25), (0, 1, 0.25)],
    &[(1, 0, 0.5)],
    &[(0, 1, 0.5)],
];

/// Pixels that show the same whatever is before them: hot, dead or stuck ones.
#[derive(Debug, Clone, PartialEq)]
pub struct Defects {
    /// By row, then column.
    pixels: Arc<[Filled]>,
}

#[derive(Debug, Clone, PartialEq)]
struct Filled {
    x: u32,
    y: u32,
    taps: Vec<Tap>,
}

/// Why a pixel cannot be filled in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum DefectError {
    /// It is none of the picture's.
    #[error("[{x}, {y}] is not in a picture of {width_px} x {height_px} px")]
    Outside {
        /// Its column.
        x: u32,
        /// Its row.
        y: u32,
        /// Pixels a row.
        width_px: usize,
        /// Rows.
        height_px: usize,
    },
    /// All around it are defective as well.
    #[error("no pixel within {REACH_PX} px of [{x}, {y}] is sound")]
    Alone {
        /// Its column.
        x: u32,
        /// Its row.
        y: u32,
    },
}

impl crate::failure::Fatal for DefectError {}

impl Defects {
    /// Pixels by column and row, in pictures of this size; `None` when there are none.
    ///
    /// # Errors
    ///
    /// When one of them is outside of the picture, or has no sound pixel near.
    pub fn new(pixels: &[[u32; 2]], width_px: usize, height_px: usize) -> Result<Option<Self>, DefectError> {
        let mut places: Vec<(u32, u32)> = pixels.iter().map(|[x, y]| (*y, *x)).collect();
        places.sort_unstable();
        places.dedup();
        if let Some((y, x)) = places.iter().find(|(y, x)| *x as usize >= width_px || *y as usize >= height_px) {
            return Err(DefectError::Outside { x: *x, y: *y, width_px, height_px });
        }
        let is_sound = |(x, y): (i64, i64)| {
            let within = (0..width_px as i64).contains(&x) && (0..height_px as i64).contains(&y);
            within && places.binary_search(&(y as u32, x as u32)).is_err()
        };
        let filled = |&(y, x): &(u32, u32)| {
            taps_for((i64::from(x), i64::from(y)), is_sound)
                .map(|taps| Filled { x, y, taps })
                .ok_or(DefectError::Alone { x, y })
        };
        let pixels = places.iter().map(filled).collect::<Result<Arc<_>, _>>()?;
        Ok((!pixels.is_empty()).then_some(Self { pixels }))
    }

    /// Fills them in within left, top, right and bottom, px, the last two outside. Up to [`REACH_PX`] around are read.
    pub fn fill(&self, image: &mut Image, [left, top, right, bottom]: [u32; 4]) {
        let width = image.view().width();
        let levels = image.data_mut();
        let first = self.pixels.partition_point(|pixel| pixel.y < top);
        for pixel in self.pixels[first..].iter().take_while(|pixel| pixel.y < bottom) {
            if !(left..right).contains(&pixel.x) {
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
            // Never beyond them: above full scale it would hide that they are saturated.
            levels[at] = value.clamp(lowest, highest);
        }
    }
}

/// What fills the pixel there: the first of [`FILLINGS`] of which all are sound, or the mean of those that are.
fn taps_for((x, y): (i64, i64), is_sound: impl Fn((i64, i64)) -> bool) -> Option<Vec<Tap>> {
    let sound = |tap: &Tap| is_sound((x + i64::from(tap.0), y + i64::from(tap.1)));
    let both =
        |taps: &[Tap]| -> Vec<Tap> { taps.iter().flat_map(|&(dx, dy, w)| [(dx, dy, w), (-dx, -dy, w)]).collect() };
    let whole = FILLINGS.iter().map(|taps| both(taps)).find(|taps| taps.iter().all(sound));
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

    /// Light that bends, with these pixels at full scale.
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
        defects.fill(&mut image, [0, 0, SIZE as u32, SIZE as u32]);
        let off = |(k, level): (usize, &f32)| (level - light((k % SIZE) as f32, (k / SIZE) as f32)).abs();
        image.view().data().iter().enumerate().map(off).fold(0.0, f32::max)
    }

    #[test]
    fn light_that_bends_is_filled_in_as_it_was() {
        assert!(worst(&[[5, 6]]) < 1e-3 && worst(&[[2, 6], [8, 3]]) < 1e-3);
        // Beside another one, or at the edge, along the other axis.
        assert!(worst(&[[5, 6], [6, 6]]) < 1e-3 && worst(&[[0, 6]]) < 1e-3 && worst(&[[4, 11]]) < 1e-3);
        // In a corner, and in clusters, about as bright as what is near.
        assert!(worst(&[[0, 0]]) < 6.0);
        let cluster: Vec<[u32; 2]> = (4..7).flat_map(|y| (4..7).map(move |x| [x, y])).collect();
        assert!(worst(&cluster) < 6.0, "{}", worst(&cluster));
    }

    #[test]
    fn only_what_is_asked_for_is_filled_in() {
        let stuck = [[3, 3], [9, 3], [3, 9]];
        let mut image = picture(&stuck);
        Defects::new(&stuck, SIZE, SIZE).unwrap().unwrap().fill(&mut image, [2, 2, 8, 8]);
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
        Defects::new(&[[6, 6]], SIZE, SIZE).unwrap().unwrap().fill(&mut image, [0, 0, SIZE as u32, SIZE as u32]);
        assert!((image.view().at(6, 6).unwrap() - 255.0).abs() < 1e-3);
    }

    #[test]
    fn what_cannot_be_filled_in_is_refused() {
        assert_eq!(Defects::new(&[], SIZE, SIZE), Ok(None));
        let error = Defects::new(&[[12, 3]], SIZE, SIZE).unwrap_err();
        assert_eq!(error.to_string(), "[12, 3] is not in a picture of 12 x 12 px");
        let cluster: Vec<[u32; 2]> = (3..8).flat_map(|y| (3..8).map(move |x| [x, y])).collect();
        let error = Defects::new(&cluster, SIZE, SIZE).unwrap_err();
        assert_eq!(error.to_string(), "no pixel within 2 px of [5, 5] is sound");
    }
}
