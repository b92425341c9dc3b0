//! Where the grey levels lie in a driver's buffer.

use super::sys;
use crate::image::PixelFormat;

/// How one of the kernel's pixel formats holds grey levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Layout {
    /// The kernel's code.
    pub fourcc: u32,
    /// What becomes of it.
    pub format: PixelFormat,
    /// Where the first pixel's grey level begins in a row.
    first_bytes: usize,
    /// From one grey level to the next.
    step_bytes: usize,
}

const fn layout(fourcc: u32, format: PixelFormat, first_bytes: usize, step_bytes: usize) -> Layout {
    Layout { fourcc, format, first_bytes, step_bytes }
}

/// Every format that is read, the better ones first: grey ones need no copy.
pub(super) const LAYOUTS: [Layout; 6] = [
    layout(sys::FOURCC_GREY, PixelFormat::Mono8, 0, 1),
    layout(sys::FOURCC_Y10, PixelFormat::Mono10, 0, 2),
    layout(sys::FOURCC_Y12, PixelFormat::Mono12, 0, 2),
    layout(sys::FOURCC_Y16, PixelFormat::Mono16, 0, 2),
    layout(sys::FOURCC_YUYV, PixelFormat::Mono8, 0, 2),
    layout(sys::FOURCC_UYVY, PixelFormat::Mono8, 1, 2),
];

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
        self.layout.step_bytes == self.layout.format.bytes_per_pixel()
            && self.stride_bytes as usize == self.row_bytes()
            && self.image_bytes as usize == self.slot_bytes()
    }

    /// Bytes a whole frame has in the driver's buffer; padding behind its last row may be left out.
    pub fn whole_bytes(&self) -> usize {
        let row = self.width_px as usize * self.layout.step_bytes;
        self.stride_bytes as usize * (self.height_px as usize - 1) + row
    }

    /// Takes the grey levels out of a driver's buffer of at least [`whole_bytes`](Self::whole_bytes).
    pub fn copy(&self, from: &[u8], to: &mut [u8]) {
        let Layout { first_bytes, step_bytes, format, .. } = self.layout;
        let rows = from.chunks(self.stride_bytes as usize).zip(to.chunks_exact_mut(self.row_bytes()));
        for (from, to) in rows.take(self.height_px as usize) {
            if step_bytes == format.bytes_per_pixel() {
                to.copy_from_slice(&from[..to.len()]);
            } else {
                to.iter_mut().zip(from[first_bytes..].iter().step_by(step_bytes)).for_each(|(to, from)| *to = *from);
            }
        }
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
        shape.copy(from, &mut to);
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
    fn only_grey_without_padding_is_plain() {
        assert!(shape(sys::FOURCC_GREY, 4).is_plain());
        assert!(shape(sys::FOURCC_Y12, 8).is_plain());
        assert!(!shape(sys::FOURCC_Y12, 10).is_plain());
        assert!(!shape(sys::FOURCC_YUYV, 8).is_plain());
    }

    #[test]
    fn codes_are_told_by_their_letters() {
        assert_eq!(LAYOUTS.map(|layout| word(layout.fourcc)), ["GREY", "Y10", "Y12", "Y16", "YUYV", "UYVY"]);
    }
}
