//! Where the grey levels lie in a driver's buffer.

use super::{jpeg, sys};
use crate::image::PixelFormat;

/// How one of the kernel's pixel formats holds grey levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Layout {
    /// The kernel's code.
    pub fourcc: u32,
    /// What becomes of it.
    pub format: PixelFormat,
    packing: Packing,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Packing {
    /// Grey levels row by row; what colour there is lies behind all of them.
    Plane,
    /// Bytes of grey and of colour in turn, the first grey one at this place.
    Pairs(usize),
    /// A JPEG file.
    Jpeg,
}

const fn layout(fourcc: u32, format: PixelFormat, packing: Packing) -> Layout {
    Layout { fourcc, format, packing }
}

/// Every format that is read, the better ones first: grey ones need no copy, and compressed ones have lost something.
pub(super) const LAYOUTS: [Layout; 9] = [
    layout(sys::FOURCC_GREY, PixelFormat::Mono8, Packing::Plane),
    layout(sys::FOURCC_Y10, PixelFormat::Mono10, Packing::Plane),
    layout(sys::FOURCC_Y12, PixelFormat::Mono12, Packing::Plane),
    layout(sys::FOURCC_Y16, PixelFormat::Mono16, Packing::Plane),
    layout(sys::FOURCC_NV12, PixelFormat::Mono8, Packing::Plane),
    layout(sys::FOURCC_YUYV, PixelFormat::Mono8, Packing::Pairs(0)),
    layout(sys::FOURCC_UYVY, PixelFormat::Mono8, Packing::Pairs(1)),
    layout(sys::FOURCC_MJPG, PixelFormat::Mono8, Packing::Jpeg),
    layout(sys::FOURCC_JPEG, PixelFormat::Mono8, Packing::Jpeg),
];

impl Layout {
    /// Whether pictures are compressed, and not as the sensor saw them.
    pub fn is_compressed(&self) -> bool {
        self.packing == Packing::Jpeg
    }
}

/// The frames of one stream in the driver's buffers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Shape {
    pub layout: Layout,
    pub width_px: u32,
    pub height_px: u32,
    /// From one row to the next in the driver's buffer.
    pub stride_bytes: u32,
    /// Size the driver's buffer must have.
    pub image_bytes: u32,
}

impl Shape {
    /// Bytes of a row in the ring.
    fn row_bytes(&self) -> usize {
        self.width_px as usize * self.layout.format.bytes_per_pixel()
    }

    /// Bytes of a frame in the ring.
    pub fn slot_bytes(&self) -> usize {
        self.row_bytes() * self.height_px as usize
    }

    /// Whether a driver's buffer is byte for byte what the ring wants.
    pub fn is_plain(&self) -> bool {
        self.layout.packing == Packing::Plane
            && self.stride_bytes as usize == self.row_bytes()
            && self.image_bytes as usize == self.slot_bytes()
    }

    /// Bytes a whole frame has in the driver's buffer at least; padding and colour behind its last row may be left out.
    pub fn whole_bytes(&self) -> usize {
        let row = match self.layout.packing {
            Packing::Plane => self.row_bytes(),
            Packing::Pairs(_) => 2 * self.row_bytes(),
            Packing::Jpeg => return jpeg::LEAST_BYTES,
        };
        self.stride_bytes as usize * (self.height_px as usize - 1) + row
    }

    /// Takes the grey levels out of a driver's buffer of at least [`whole_bytes`](Self::whole_bytes).
    ///
    /// # Errors
    ///
    /// What is wrong with a compressed picture.
    pub fn copy(&self, from: &[u8], to: &mut [u8]) -> Result<(), String> {
        let to = &mut to[..self.slot_bytes()];
        if self.layout.packing == Packing::Jpeg {
            return jpeg::luma(from, (self.width_px as usize, self.height_px as usize), to);
        }
        let rows = from.chunks(self.stride_bytes as usize).zip(to.chunks_exact_mut(self.row_bytes()));
        for (from, to) in rows {
            if let Packing::Pairs(first) = self.layout.packing {
                to.iter_mut().zip(from[first..].iter().step_by(2)).for_each(|(to, from)| *to = *from);
            } else {
                to.copy_from_slice(&from[..to.len()]);
            }
        }
        Ok(())
    }
}

/// The four letters of a format's code.
pub(super) fn word(fourcc: u32) -> String {
    let letters = fourcc.to_le_bytes().map(|byte| if byte.is_ascii_graphic() { char::from(byte) } else { ' ' });
    letters.iter().collect::<String>().trim_end().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape(fourcc: u32, stride_bytes: u32) -> Shape {
        let layout = LAYOUTS.into_iter().find(|layout| layout.fourcc == fourcc).unwrap();
        Shape { layout, width_px: 4, height_px: 2, stride_bytes, image_bytes: stride_bytes * 2 }
    }

    fn taken(shape: &Shape, from: &[u8]) -> Vec<u8> {
        let mut to = vec![0; shape.slot_bytes()];
        shape.copy(from, &mut to).unwrap();
        to
    }

    #[test]
    fn padding_at_the_end_of_rows_is_left_behind() {
        let shape = shape(sys::FOURCC_GREY, 6);
        assert!(!shape.is_plain());
        assert_eq!(taken(&shape, &[1, 2, 3, 4, 99, 99, 5, 6, 7, 8, 99, 99]), [1, 2, 3, 4, 5, 6, 7, 8]);
        // The padding of the last row may be missing.
        assert_eq!(shape.whole_bytes(), 10);
        assert_eq!(taken(&shape, &[1, 2, 3, 4, 99, 99, 5, 6, 7, 8]), [1, 2, 3, 4, 5, 6, 7, 8]);
    }

    #[test]
    fn luma_is_taken_out_of_both_orders_of_packed_colour() {
        let yuyv: Vec<u8> = (0..16).collect();
        assert_eq!(taken(&shape(sys::FOURCC_YUYV, 8), &yuyv), [0, 2, 4, 6, 8, 10, 12, 14]);
        assert_eq!(taken(&shape(sys::FOURCC_UYVY, 8), &yuyv), [1, 3, 5, 7, 9, 11, 13, 15]);
    }

    #[test]
    fn colour_behind_the_grey_plane_is_left_behind() {
        let shape = Shape { image_bytes: 12, ..shape(sys::FOURCC_NV12, 4) };
        assert!(!shape.is_plain());
        assert_eq!(taken(&shape, &[1, 2, 3, 4, 5, 6, 7, 8, 99, 99, 99, 99]), [1, 2, 3, 4, 5, 6, 7, 8]);
    }

    #[test]
    fn only_grey_without_padding_is_plain() {
        assert!(shape(sys::FOURCC_GREY, 4).is_plain());
        assert!(shape(sys::FOURCC_Y12, 8).is_plain());
        assert!(!shape(sys::FOURCC_Y12, 10).is_plain());
        assert!(!shape(sys::FOURCC_YUYV, 8).is_plain());
    }

    #[test]
    fn codes_are_told_by_their_letters() {
        let words = ["GREY", "Y10", "Y12", "Y16", "NV12", "YUYV", "UYVY", "MJPG", "JPEG"];
        assert_eq!(LAYOUTS.map(|layout| word(layout.fourcc)), words);
    }
}
