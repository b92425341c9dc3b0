//! An image with a mirrored margin, so that reads near the edge need no bounds test.

use crate::dic::geometry::Size;

/// The number of extra columns and rows on each side, px: room for six taps, eight lanes and rounding.
pub(in crate::dic) const MARGIN: usize = 16;

/// A width x height plane of `f32` inside a margin of [`MARGIN`] on each side.
#[derive(Debug, Clone, Default, PartialEq)]
pub(in crate::dic) struct PaddedImage {
    data: Vec<f32>,
    width: usize,
    height: usize,
}

impl PaddedImage {
    /// Resizes the plane; its content is unspecified afterwards.
    pub(in crate::dic) fn reshape(&mut self, width: usize, height: usize) {
        self.width = width;
        self.height = height;
        self.data.resize(self.stride() * (height + 2 * MARGIN), 0.0);
    }

    /// The number of values, with margins, that its memory holds.
    pub(in crate::dic) fn reserved_px(&self) -> usize {
        self.data.capacity()
    }

    /// The number of values from one row to the next.
    pub(in crate::dic) fn stride(&self) -> usize {
        self.width + 2 * MARGIN
    }

    /// The width without the margin.
    pub(in crate::dic) fn width(&self) -> usize {
        self.width
    }

    /// The height without the margin.
    pub(in crate::dic) fn height(&self) -> usize {
        self.height
    }

    /// All values, margin included, row-major.
    pub(in crate::dic) fn data(&self) -> &[f32] {
        &self.data
    }

    /// The size without the margin.
    pub(in crate::dic) fn size(&self) -> Size {
        Size { width: self.width, height: self.height }
    }

    /// Returns the index of (x, y) in [`Self::data`]; both may be negative within the margin.
    pub(in crate::dic) fn index(&self, x: isize, y: isize) -> usize {
        let margin = MARGIN as isize;
        (y + margin) as usize * self.stride() + (x + margin) as usize
    }

    /// Returns the pixels of one row without the margin.
    pub(in crate::dic) fn row(&self, y: usize) -> &[f32] {
        let start = self.index(0, y as isize);
        &self.data[start..start + self.width]
    }

    /// Returns the pixels of one row without the margin.
    pub(in crate::dic) fn row_mut(&mut self, y: usize) -> &mut [f32] {
        let start = self.index(0, y as isize);
        let width = self.width;
        &mut self.data[start..start + width]
    }

    /// Returns one row with its margin.
    pub(in crate::dic) fn padded_row_mut(&mut self, y: usize) -> &mut [f32] {
        let stride = self.stride();
        let start = (y + MARGIN) * stride;
        &mut self.data[start..start + stride]
    }

    /// All values, margin included, row-major.
    pub(in crate::dic) fn data_mut(&mut self) -> &mut [f32] {
        &mut self.data
    }

    /// Fills the margin with the mirrored interior (whole-sample symmetric).
    pub(in crate::dic) fn mirror_margin(&mut self) {
        let (width, height, stride) = (self.width, self.height, self.stride());
        for y in 0..height {
            mirror_row(self.padded_row_mut(y), width);
        }
        for k in 1..=MARGIN {
            let above = (MARGIN + reflect_index(-(k as isize), height)) * stride;
            self.data.copy_within(above..above + stride, (MARGIN - k) * stride);
            let below = (MARGIN + reflect_index((height - 1 + k) as isize, height)) * stride;
            self.data.copy_within(below..below + stride, (MARGIN + height - 1 + k) * stride);
        }
    }
}

/// Fills the margin on both sides of one padded row with its mirrored `width` inner values.
pub(in crate::dic) fn mirror_row(row: &mut [f32], width: usize) {
    if width <= MARGIN {
        for k in 0..MARGIN {
            row[k] = row[MARGIN + reflect_index(k as isize - MARGIN as isize, width)];
            row[MARGIN + width + k] = row[MARGIN + reflect_index((width + k) as isize, width)];
        }
        return;
    }
    let (before, inner) = row.split_at_mut(MARGIN);
    copy_mirrored(&inner[1..], before);
    let (inner, after) = inner.split_at_mut(width);
    copy_mirrored(&inner[width - 1 - MARGIN..], after);
}

/// Copies the first [`MARGIN`] values of `from` to the start of `to` in reverse order.
fn copy_mirrored(from: &[f32], to: &mut [f32]) {
    let mut mirrored = [0.0; MARGIN];
    mirrored.copy_from_slice(&from[..MARGIN]);
    mirrored.reverse();
    to[..MARGIN].copy_from_slice(&mirrored);
}

/// Reflects an index about the first and the last sample until it lies in `0..size`; 0 for a size of 0 or 1.
pub(in crate::dic) fn reflect_index(index: isize, size: usize) -> usize {
    let period = 2 * (size as isize - 1);
    if period <= 0 {
        return 0;
    }
    let folded = index.rem_euclid(period);
    folded.min(period - folded) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mirrored_indices_reflect_about_the_outer_samples() {
        let found: Vec<usize> = (-4..9).map(|i| reflect_index(i, 4)).collect();
        assert_eq!(found, [2, 3, 2, 1, 0, 1, 2, 3, 2, 1, 0, 1, 2]);
        assert_eq!(reflect_index(-7, 1), 0);
    }

    #[test]
    fn the_margin_repeats_the_mirrored_interior_even_of_a_tiny_plane() {
        let mut plane = PaddedImage::default();
        plane.reshape(2, 1);
        plane.row_mut(0).copy_from_slice(&[3.0, 5.0]);
        plane.mirror_margin();
        assert_eq!(&plane.data()[plane.index(-3, 0)..plane.index(4, 0)], &[5.0, 3.0, 5.0, 3.0, 5.0, 3.0, 5.0]);
        assert_eq!(plane.data()[plane.index(1, 9)..][..1], [5.0]);
    }
}
