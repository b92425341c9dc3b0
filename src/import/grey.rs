//! Grey levels of colour images: one rule for every format.

use super::shape::Shape;
use crate::image::PixelFormat;

/// The rule for red, green and blue per pixel.
pub(super) const LUMA: &str = "colour by ITU-R BT.601 (0.299 R + 0.587 G + 0.114 B)";
/// The rule for the mosaic of a colour sensor.
pub(super) const MOSAIC: &str = "a Bayer mosaic by a 3x3 binomial filter (R/4 + G/2 + B/4)";

/// Computes the luma of packed pixels of red, green and blue, 8 or 16 bit little-endian, by ITU-R BT.601 (section 2.5).
pub(super) fn luma(format: PixelFormat, colors: &[u8]) -> Vec<u8> {
    let weigh = |red: u32, green: u32, blue: u32| (299 * red + 587 * green + 114 * blue + 500) / 1000;
    match format.bytes_per_pixel() {
        1 => colors.chunks_exact(3).map(|p| weigh(p[0].into(), p[1].into(), p[2].into()) as u8).collect(),
        _ => {
            let word = |pixel: &[u8], at: usize| u32::from(u16::from_le_bytes([pixel[at], pixel[at + 1]]));
            let luma = colors.chunks_exact(6).map(|p| weigh(word(p, 0), word(p, 2), word(p, 4)) as u16);
            luma.flat_map(u16::to_le_bytes).collect()
        }
    }
}

/// Computes the luma of three packed images that follow each other, red, green and blue, as [`luma`] does.
pub(super) fn luma_of_planes(format: PixelFormat, planes: &[u8]) -> Vec<u8> {
    let (bytes, plane_bytes) = (format.bytes_per_pixel(), planes.len() / 3);
    let mut colors = Vec::with_capacity(planes.len());
    for at in (0..plane_bytes).step_by(bytes) {
        (0..3).for_each(|plane| colors.extend_from_slice(&planes[plane * plane_bytes + at..][..bytes]));
    }
    luma(format, &colors)
}

/// Computes the brightness of a Bayer mosaic with the binomial kernel `1 2 1 / 2 4 2 / 1 2 1`.
///
/// Every pixel then holds a quarter of red, half of green and a quarter of blue, in whatever order the filters lie: the
/// kernel removes exactly the frequencies at which a mosaic modulates colour, and shifts nothing. The image is mirrored
/// at its edges, which continues the mosaic.
pub(super) fn mosaic_brightness(shape: Shape, pixels: &[u8]) -> Vec<u8> {
    let (width, height) = (shape.width_px as usize, shape.height_px as usize);
    let bytes = shape.format.bytes_per_pixel();
    let level = |x: usize, y: usize| -> u32 {
        let at = bytes * (y * width + x);
        if bytes == 1 { pixels[at].into() } else { u16::from_le_bytes([pixels[at], pixels[at + 1]]).into() }
    };
    let across = |x: usize, y: usize| {
        let (left, right) = neighbours(x, width);
        level(left, y) + 2 * level(x, y) + level(right, y)
    };
    let mut grey = Vec::with_capacity(pixels.len());
    for y in 0..height {
        let (above, below) = neighbours(y, height);
        for x in 0..width {
            let sum = across(x, above) + 2 * across(x, y) + across(x, below);
            grey.extend_from_slice(&((sum + 8) / 16).to_le_bytes()[..bytes]);
        }
    }
    grey
}

/// Returns the indices before and after that of a pixel, mirrored at the ends of a row or column of `length` pixels, at
/// least 1.
fn neighbours(pixel: usize, length: usize) -> (usize, usize) {
    let last = length - 1;
    let before = pixel.checked_sub(1).unwrap_or(1.min(last));
    let after = if pixel < last { pixel + 1 } else { last.saturating_sub(1) };
    (before, after)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A uniform colour gives the same level at each of the four places of the mosaic.
    #[test]
    fn a_mosaic_of_one_color_is_even() {
        let shape = Shape { width_px: 5, height_px: 4, format: PixelFormat::Mono8 };
        let mosaic: Vec<u8> = (0..20).map(|at| [[40, 100], [100, 200]][at / 5 % 2][at % 5 % 2]).collect();
        assert_eq!(mosaic_brightness(shape, &mosaic), [110; 20]);
        let wide = Shape { format: PixelFormat::Mono16, ..shape };
        let words: Vec<u8> = mosaic.iter().flat_map(|level| (16 * u16::from(*level)).to_le_bytes()).collect();
        assert_eq!(mosaic_brightness(wide, &words), 1760_u16.to_le_bytes().repeat(20));
    }

    #[test]
    fn luma_of_grey_is_the_same_grey() {
        assert_eq!(luma(PixelFormat::Mono8, &[7, 7, 7, 255, 255, 255, 255, 0, 0]), [7, 255, 76]);
        let words: Vec<u8> = [65_535_u16; 3].iter().flat_map(|level| level.to_le_bytes()).collect();
        assert_eq!(luma(PixelFormat::Mono16, &words), 65_535_u16.to_le_bytes());
    }
}
