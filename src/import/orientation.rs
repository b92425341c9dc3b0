//! Mirrored and turned images.

use super::shape::Shape;
use std::fmt;

/// The symmetry that takes a stored image to the displayed one: first a transposition, then mirrorings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Orientation {
    /// Whether rows and columns are exchanged.
    is_transposed: bool,
    /// Whether left and right are exchanged afterwards.
    is_mirrored: bool,
    /// Whether top and bottom are exchanged afterwards.
    is_flipped: bool,
}

impl Orientation {
    /// The image as it is stored.
    pub const AS_STORED: Self = Self { is_transposed: false, is_mirrored: false, is_flipped: false };
    /// Left and right exchanged.
    pub const MIRRORED: Self = Self { is_mirrored: true, ..Self::AS_STORED };
    /// Top and bottom exchanged.
    pub const FLIPPED: Self = Self { is_flipped: true, ..Self::AS_STORED };
    /// Turned by half a turn.
    pub const TURNED_180: Self = Self { is_mirrored: true, is_flipped: true, ..Self::AS_STORED };
    /// Turned by a quarter, clockwise on the screen.
    pub const TURNED_90_CW: Self = Self { is_transposed: true, is_mirrored: true, is_flipped: false };
    /// Turned by a quarter, counter-clockwise on the screen.
    pub const TURNED_90_CCW: Self = Self { is_transposed: true, is_mirrored: false, is_flipped: true };

    /// Returns the orientation of a TIFF or Exif tag 274, 1 to 8 (TIFF 6.0, section 8); `None` for other values.
    pub(super) fn from_tag(tag: u16) -> Option<Self> {
        Some(match tag {
            1 => Self::AS_STORED,
            2 => Self::MIRRORED,
            3 => Self::TURNED_180,
            4 => Self::FLIPPED,
            5 => Self { is_transposed: true, ..Self::AS_STORED },
            6 => Self::TURNED_90_CW,
            7 => Self { is_transposed: true, is_mirrored: true, is_flipped: true },
            8 => Self::TURNED_90_CCW,
            _ => return None,
        })
    }

    /// Returns the symmetry that is this one, followed by `next`.
    pub(super) fn then(self, next: Self) -> Self {
        // A transposition exchanges the axes that were mirrored before it.
        let (mirrored, flipped) = match next.is_transposed {
            true => (self.is_flipped, self.is_mirrored),
            false => (self.is_mirrored, self.is_flipped),
        };
        Self {
            is_transposed: self.is_transposed != next.is_transposed,
            is_mirrored: mirrored != next.is_mirrored,
            is_flipped: flipped != next.is_flipped,
        }
    }

    /// Returns the aspect of a displayed pixel, width over height, from that of a stored one.
    pub(super) fn aspect(self, stored: f64) -> f64 {
        if self.is_transposed { stored.recip() } else { stored }
    }

    /// Returns the orientation that displays the rows of a stored image along `right` and its columns along `down`.
    ///
    /// Both are (x, y) with y down, of any length; `None` if they are not along two different axes of the display.
    pub(super) fn from_axes(right: [i64; 2], down: [i64; 2]) -> Option<Self> {
        match [right[0] != 0, right[1] != 0, down[0] != 0, down[1] != 0] {
            [true, false, false, true] => {
                Some(Self { is_transposed: false, is_mirrored: right[0] < 0, is_flipped: down[1] < 0 })
            }
            [false, true, true, false] => {
                Some(Self { is_transposed: true, is_mirrored: down[0] < 0, is_flipped: right[1] < 0 })
            }
            _ => None,
        }
    }

    /// Returns the shape of the displayed image.
    pub(super) fn shape(self, stored: Shape) -> Shape {
        match self.is_transposed {
            true => Shape { width_px: stored.height_px, height_px: stored.width_px, ..stored },
            false => stored,
        }
    }

    /// Turns and mirrors packed pixels of the shape `stored`, whose rows have no padding.
    ///
    /// # Panics
    ///
    /// If there are fewer pixels than the shape has.
    pub(super) fn apply(self, stored: Shape, pixels: Vec<u8>) -> Vec<u8> {
        if self == Self::AS_STORED {
            return pixels;
        }
        let bytes = stored.format.bytes_per_pixel();
        let (stored_width, shown) = (stored.width_px as usize, self.shape(stored));
        let (width, height) = (shown.width_px as usize, shown.height_px as usize);
        let mut turned = Vec::with_capacity(pixels.len());
        for row in 0..height {
            let y = if self.is_flipped { height - 1 - row } else { row };
            for column in 0..width {
                let x = if self.is_mirrored { width - 1 - column } else { column };
                let offset = bytes * if self.is_transposed { x * stored_width + y } else { y * stored_width + x };
                turned.extend_from_slice(&pixels[offset..offset + bytes]);
            }
        }
        turned
    }
}

impl fmt::Display for Orientation {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match (self.is_transposed, self.is_mirrored, self.is_flipped) {
            (false, false, false) => "as stored",
            (false, true, false) => "mirrored",
            (false, false, true) => "flipped upside down",
            (false, true, true) => "turned by 180 deg",
            (true, false, false) => "transposed",
            (true, true, false) => "turned by 90 deg clockwise",
            (true, false, true) => "turned by 90 deg counter-clockwise",
            (true, true, true) => "transposed along the other diagonal",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::PixelFormat;

    /// The image `1 2 3 / 4 5 6`, in the eight orientations of the tag.
    #[test]
    fn the_tag_turns_the_image() {
        let stored = Shape { width_px: 3, height_px: 2, format: PixelFormat::Mono8 };
        let shown = |tag| Orientation::from_tag(tag).unwrap().apply(stored, vec![1, 2, 3, 4, 5, 6]);
        assert_eq!(shown(1), [1, 2, 3, 4, 5, 6]);
        assert_eq!(shown(2), [3, 2, 1, 6, 5, 4]);
        assert_eq!(shown(3), [6, 5, 4, 3, 2, 1]);
        assert_eq!(shown(4), [4, 5, 6, 1, 2, 3]);
        assert_eq!(shown(5), [1, 4, 2, 5, 3, 6]);
        assert_eq!(shown(6), [4, 1, 5, 2, 6, 3]);
        assert_eq!(shown(7), [6, 3, 5, 2, 4, 1]);
        assert_eq!(shown(8), [3, 6, 2, 5, 1, 4]);
        assert_eq!(Orientation::from_tag(9), None);
    }

    /// Two symmetries in a row are the one that [`Orientation::then`] returns.
    #[test]
    fn symmetries_combine() {
        let stored = Shape { width_px: 3, height_px: 2, format: PixelFormat::Mono8 };
        let all: Vec<Orientation> = (1..=8).map(|tag| Orientation::from_tag(tag).unwrap()).collect();
        for first in &all {
            for next in &all {
                let turned = next.apply(first.shape(stored), first.apply(stored, vec![1, 2, 3, 4, 5, 6]));
                let both = first.then(*next);
                assert_eq!(both.apply(stored, vec![1, 2, 3, 4, 5, 6]), turned, "{first}, then {next}");
                assert_eq!(both.shape(stored), next.shape(first.shape(stored)));
            }
        }
    }

    /// Words of two bytes keep their order.
    #[test]
    fn words_stay_whole() {
        let stored = Shape { width_px: 2, height_px: 1, format: PixelFormat::Mono16 };
        assert_eq!(Orientation::MIRRORED.apply(stored, vec![1, 2, 3, 4]), [3, 4, 1, 2]);
    }
}
