//! Reduced images spread over a film.

use crate::image::ImageView;

/// The maximum side of a reduced image, px.
const MAX_SIDE_PX: usize = 480;
/// The maximum number of samples. An odd number of them has a median that is one of them.
const MAX_SAMPLES: u64 = 49;

/// An image averaged over squares of `factor` pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct ReducedImage {
    /// The mean grey levels, DN, row-major.
    pub levels_dn: Vec<f32>,
    /// The number of columns.
    pub width: usize,
    /// The number of rows.
    pub height: usize,
}

impl ReducedImage {
    /// Interpolates the grey level bilinearly at x, y, reduced pixels, DN; `None` outside.
    pub(super) fn interpolate(&self, [x, y]: [f64; 2]) -> Option<f64> {
        ImageView::new(&self.levels_dn, self.width, self.height).ok()?.interpolate(x, y).map(f64::from)
    }
}

/// A sampled frame.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SampledFrame {
    /// The number of the frame in the film, from 0.
    pub(super) index: u64,
    pub(super) image: ReducedImage,
}

/// Takes reduced images spread evenly over a film, among them the first one.
#[derive(Debug, Clone)]
pub struct Sampler {
    size_px: [usize; 2],
    factor: usize,
    interval_frames: u64,
    pub(super) frames: Vec<SampledFrame>,
}

impl Sampler {
    /// Plans the sampling of a film of about `count` frames of this width and height, px.
    ///
    /// At most 49 images of 480 px are kept, or twice as many if the film is longer than announced.
    pub fn new(width_px: usize, height_px: usize, count: u64) -> Self {
        Self {
            size_px: [width_px, height_px],
            factor: width_px.max(height_px).div_ceil(MAX_SIDE_PX).max(1),
            interval_frames: count.div_ceil(MAX_SAMPLES).max(1),
            frames: Vec::new(),
        }
    }

    /// Whether the frame of this number in the film, from 0, is sampled.
    pub fn takes(&self, index: u64) -> bool {
        // A film may have more frames than announced.
        index.is_multiple_of(self.interval_frames) && (self.frames.len() as u64) < 2 * MAX_SAMPLES
    }

    /// Adds the frame of this number in the film, from 0, reduced.
    ///
    /// # Panics
    ///
    /// If the size of `image` differs from the planned size.
    pub fn push(&mut self, index: u64, image: ImageView<'_>) {
        assert_eq!([image.width(), image.height()], self.size_px, "the sampler was planned for another image size");
        self.frames.push(SampledFrame { index, image: reduce_image(image, self.factor) });
    }

    /// Returns the number of pixels that one of a reduced image averages, along each side.
    pub fn factor(&self) -> usize {
        self.factor
    }

    /// Returns width and height of the frames, px.
    pub(super) fn size_px(&self) -> [usize; 2] {
        self.size_px
    }
}

/// Averages squares of `factor` x `factor` pixels; an incomplete square at the right or lower edge is left out.
pub(super) fn reduce_image(image: ImageView<'_>, factor: usize) -> ReducedImage {
    let (width, height) = ((image.width() / factor).max(1), (image.height() / factor).max(1));
    let mut levels_dn = vec![0.0; width * height];
    let (columns, rows) = (factor.min(image.width()), factor.min(image.height()));
    for (row, out) in levels_dn.chunks_exact_mut(width).enumerate() {
        for y in row * factor..row * factor + rows {
            let line = image.row(y);
            for (column, out) in out.iter_mut().enumerate() {
                *out += line[column * factor..column * factor + columns].iter().sum::<f32>();
            }
        }
    }
    let share = 1.0 / (columns * rows) as f32;
    levels_dn.iter_mut().for_each(|level| *level *= share);
    ReducedImage { levels_dn, width, height }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_are_averaged_and_the_rest_is_left_out() {
        let data: Vec<f32> = (0..35).map(|k| k as f32).collect();
        let image = reduce_image(ImageView::new(&data, 7, 5).unwrap(), 2);
        assert_eq!((image.width, image.height), (3, 2));
        assert_eq!(image.levels_dn, [4.0, 6.0, 8.0, 18.0, 20.0, 22.0]);
    }

    #[test]
    fn a_long_film_is_sampled_from_end_to_end_and_a_short_one_whole() {
        let taken = |count: u64| {
            let sampler = Sampler::new(64, 64, count);
            (0..count).filter(|index| sampler.takes(*index)).collect::<Vec<_>>()
        };
        assert_eq!(taken(5), [0, 1, 2, 3, 4]);
        let long = taken(10_000);
        assert!(long.len() <= 49 && long[0] == 0 && long[long.len() - 1] > 9_700, "{long:?}");
    }
}
