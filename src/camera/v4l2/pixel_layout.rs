//! The pixel layout of a driver's buffers, and extraction of the grey levels.

use super::modes::FrameSize;
use super::{jpeg, sys};
use crate::image::PixelFormat;

/// A pixel format of the kernel that holds grey levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Layout {
    /// Four-character code.
    pub fourcc: u32,
    /// Pixel format in the ring.
    pub format: PixelFormat,
    packing: Packing,
}

/// The arrangement of the grey levels in a buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Packing {
    /// Grey levels row by row; colour, if any, lies behind all of them.
    Plane,
    /// Grey and colour bytes alternate; the first grey byte has this index.
    Pairs(usize),
    /// A JPEG file.
    Jpeg,
}

/// Returns the layout of a pixel format of the kernel, by its four-character code.
const fn layout(fourcc: u32, format: PixelFormat, packing: Packing) -> Layout {
    Layout { fourcc, format, packing }
}

/// All supported formats, the better ones first: grey formats need no copy, and compressed ones are lossy.
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
    /// Whether images are compressed.
    pub fn is_compressed(&self) -> bool {
        self.packing == Packing::Jpeg
    }
}

/// The layout of a stream's frames in the driver's buffers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct BufferLayout {
    /// The pixel format.
    pub layout: Layout,
    /// The size of the image.
    pub size: FrameSize,
    /// Distance between rows in the driver's buffer, bytes.
    pub stride_bytes: u32,
    /// Size of the driver's buffer, bytes.
    pub image_bytes: u32,
}

impl BufferLayout {
    /// Returns the size of a row in the ring, bytes.
    fn row_bytes(&self) -> usize {
        self.size.width_px as usize * self.layout.format.bytes_per_pixel()
    }

    /// Returns the size of a frame in the ring, bytes.
    pub fn slot_bytes(&self) -> usize {
        self.row_bytes() * self.size.height_px as usize
    }

    /// Whether the driver's buffer has exactly the layout of the ring.
    pub fn matches_ring(&self) -> bool {
        self.layout.packing == Packing::Plane
            && self.stride_bytes as usize == self.row_bytes()
            && self.image_bytes as usize == self.slot_bytes()
    }

    /// Returns the minimum size of a complete frame in the driver's buffer, bytes; the height must not be 0.
    ///
    /// Padding and colour behind the last row may be missing. A compressed frame has at least its two markers.
    pub fn min_bytes(&self) -> usize {
        let row = match self.layout.packing {
            Packing::Plane => self.row_bytes(),
            Packing::Pairs(_) => 2 * self.row_bytes(),
            Packing::Jpeg => return jpeg::MIN_BYTES,
        };
        self.stride_bytes as usize * (self.size.height_px as usize - 1) + row
    }

    /// Extracts the grey levels from a driver's buffer of at least [`min_bytes`](Self::min_bytes) into a slot of at
    /// least [`slot_bytes`](Self::slot_bytes), without row padding.
    ///
    /// # Errors
    ///
    /// The defect of a compressed image.
    ///
    /// # Panics
    ///
    /// If the slot is smaller than that, or a plane of grey levels ends within a row.
    pub fn extract_grey(&self, from: &[u8], to: &mut [u8]) -> Result<(), String> {
        let to = &mut to[..self.slot_bytes()];
        if self.layout.packing == Packing::Jpeg {
            return jpeg::decode_luma(from, self.size, to);
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

/// Returns a four-character code as text; characters that cannot be printed become spaces.
pub(super) fn fourcc_text(fourcc: u32) -> String {
    let letters = fourcc.to_le_bytes().map(|byte| if byte.is_ascii_graphic() { char::from(byte) } else { ' ' });
    letters.iter().collect::<String>().trim_end().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn buffer(fourcc: u32, stride_bytes: u32) -> BufferLayout {
        let layout = LAYOUTS.into_iter().find(|layout| layout.fourcc == fourcc).unwrap();
        let size = FrameSize { width_px: 4, height_px: 2 };
        BufferLayout { layout, size, stride_bytes, image_bytes: stride_bytes * 2 }
    }

    fn copied(buffer: &BufferLayout, from: &[u8]) -> Vec<u8> {
        let mut to = vec![0; buffer.slot_bytes()];
        buffer.extract_grey(from, &mut to).unwrap();
        to
    }

    #[test]
    fn padding_at_the_end_of_rows_is_left_out() {
        let buffer = buffer(sys::FOURCC_GREY, 6);
        assert!(!buffer.matches_ring());
        assert_eq!(copied(&buffer, &[1, 2, 3, 4, 99, 99, 5, 6, 7, 8, 99, 99]), [1, 2, 3, 4, 5, 6, 7, 8]);
        // The padding of the last row may be missing.
        assert_eq!(buffer.min_bytes(), 10);
        assert_eq!(copied(&buffer, &[1, 2, 3, 4, 99, 99, 5, 6, 7, 8]), [1, 2, 3, 4, 5, 6, 7, 8]);
    }

    #[test]
    fn luma_is_extracted_from_both_orders_of_packed_colour() {
        let yuyv: Vec<u8> = (0..16).collect();
        assert_eq!(copied(&buffer(sys::FOURCC_YUYV, 8), &yuyv), [0, 2, 4, 6, 8, 10, 12, 14]);
        assert_eq!(copied(&buffer(sys::FOURCC_UYVY, 8), &yuyv), [1, 3, 5, 7, 9, 11, 13, 15]);
    }

    #[test]
    fn colour_behind_the_grey_plane_is_left_out() {
        let buffer = BufferLayout { image_bytes: 12, ..buffer(sys::FOURCC_NV12, 4) };
        assert!(!buffer.matches_ring());
        assert_eq!(copied(&buffer, &[1, 2, 3, 4, 5, 6, 7, 8, 99, 99, 99, 99]), [1, 2, 3, 4, 5, 6, 7, 8]);
    }

    #[test]
    fn only_grey_without_padding_matches_the_ring() {
        assert!(buffer(sys::FOURCC_GREY, 4).matches_ring());
        assert!(buffer(sys::FOURCC_Y12, 8).matches_ring());
        assert!(!buffer(sys::FOURCC_Y12, 10).matches_ring());
        assert!(!buffer(sys::FOURCC_YUYV, 8).matches_ring());
    }

    #[test]
    fn codes_are_shown_as_text() {
        let texts = ["GREY", "Y10", "Y12", "Y16", "NV12", "YUYV", "UYVY", "MJPG", "JPEG"];
        assert_eq!(LAYOUTS.map(|layout| fourcc_text(layout.fourcc)), texts);
    }
}
