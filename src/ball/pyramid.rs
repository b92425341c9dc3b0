//! The image pyramid: reduced, smoothed and filtered copies of an image for the coarse search.

use crate::image::{ImageView, PixelRect};

/// A grey image that reuses its memory.
#[derive(Debug, Clone, Default)]
pub(super) struct GreyImage {
    pub data: Vec<f32>,
    pub width: usize,
    pub height: usize,
}

impl GreyImage {
    /// Sets the size and keeps the memory; the pixels are not defined afterwards.
    pub fn reshape(&mut self, width: usize, height: usize) {
        self.data.resize(width * height, 0.0);
        (self.width, self.height) = (width, height);
    }

    /// Returns a view of the image; `None` if it is empty.
    pub fn view(&self) -> Option<ImageView<'_>> {
        ImageView::new(&self.data, self.width, self.height).ok()
    }

    /// Copies a region of `image`.
    pub fn copy_region(&mut self, image: ImageView<'_>, region: PixelRect) {
        let (columns, rows) = (region.columns(), region.rows());
        self.reshape(columns.len(), rows.len());
        for (row, y) in self.data.chunks_exact_mut(columns.len().max(1)).zip(rows) {
            row.copy_from_slice(&image.row(y)[columns.clone()]);
        }
    }

    /// Copies a region of `image` at half its size; each pixel is the mean of four.
    pub fn copy_halved(&mut self, image: ImageView<'_>, region: PixelRect) {
        let (columns, rows) = (region.columns(), region.rows());
        let width = columns.len() / 2;
        self.reshape(width, rows.len() / 2);
        for (row, y) in self.data.chunks_exact_mut(width.max(1)).zip(rows.step_by(2)) {
            let upper = &image.row(y)[columns.clone()];
            let lower = &image.row(y + 1)[columns.clone()];
            for ((pixel, a), b) in row.iter_mut().zip(upper.chunks_exact(2)).zip(lower.chunks_exact(2)) {
                *pixel = 0.25 * (a[0] + a[1] + b[0] + b[1]);
            }
        }
    }
}

/// Blurs by one pixel (binomial of order 4 along both axes); the border repeats.
#[multiversion::multiversion(targets("x86_64+avx2+fma"))]
pub(super) fn blur(from: &GreyImage, scratch: &mut GreyImage, to: &mut GreyImage) {
    let (width, height) = (from.width, from.height);
    scratch.reshape(width, height);
    to.reshape(width, height);
    if width < 5 || height < 5 {
        to.data.copy_from_slice(&from.data);
        return;
    }
    for (row, out) in from.data.chunks_exact(width).zip(scratch.data.chunks_exact_mut(width)) {
        for (w, pixel) in row.windows(5).zip(&mut out[2..width - 2]) {
            *pixel = (w[0] + w[4] + 4.0 * (w[1] + w[3]) + 6.0 * w[2]) * (1.0 / 16.0);
        }
        let middle = out[2];
        out[..2].fill(middle);
        let middle = out[width - 3];
        out[width - 2..].fill(middle);
    }
    for (y, out) in to.data.chunks_exact_mut(width).enumerate() {
        let row = |dy: usize| {
            let y = (y + dy).saturating_sub(2).min(height - 1) * width;
            &scratch.data[y..y + width]
        };
        let (a, b, c, d, e) = (row(0), row(1), row(2), row(3), row(4));
        for x in 0..width {
            out[x] = (a[x] + e[x] + 4.0 * (b[x] + d[x]) + 6.0 * c[x]) * (1.0 / 16.0);
        }
    }
}

/// Closes an image (greyscale morphology) with a disc of radius 2 px.
///
/// This removes dark marks up to 4 px wide and keeps straight and gently curved edges.
pub(super) fn remove_dark_marks(from: &GreyImage, scratch: &mut GreyImage, to: &mut GreyImage) {
    disc_filter(from, scratch, larger);
    disc_filter(scratch, to, smaller);
}

/// Opens an image (greyscale morphology) with a disc of radius 2 px.
///
/// This removes bright marks up to 4 px wide and keeps straight and gently curved edges.
pub(super) fn remove_bright_marks(from: &GreyImage, scratch: &mut GreyImage, to: &mut GreyImage) {
    disc_filter(from, scratch, smaller);
    disc_filter(scratch, to, larger);
}

// Unlike `f32::max` these compile to one instruction each; grey levels are never NaN.
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Applies `pick` (a minimum or a maximum) over a 5 x 5 square without its corners; the border repeats.
///
/// An image with a side shorter than 5 px is copied.
fn disc_filter(from: &GreyImage, to: &mut GreyImage, pick: impl Fn(f32, f32) -> f32 + Copy) {
    let (width, height) = (from.width, from.height);
    to.reshape(width, height);
    if width < 5 || height < 5 {
        to.data.copy_from_slice(&from.data);
        return;
    }
    for (y, out) in to.data.chunks_exact_mut(width).enumerate() {
        let row = |dy: usize| {
            let y = (y + dy).saturating_sub(2).min(height - 1) * width;
            &from.data[y..y + width]
        };
        let (a, b, c, d, e) = (row(0), row(1), row(2), row(3), row(4));
        for x in 2..width - 2 {
            let near = pick(pick(b[x], c[x]), d[x]);
            let tall = pick(near, pick(a[x], e[x]));
            let column = |x: usize| pick(pick(a[x], e[x]), pick(pick(b[x], c[x]), d[x]));
            let outer = |x: usize| pick(pick(b[x], c[x]), d[x]);
            out[x] = pick(pick(tall, pick(column(x - 1), column(x + 1))), pick(outer(x - 2), outer(x + 2)));
        }
        let middle = out[2];
        out[..2].fill(middle);
        let middle = out[width - 3];
        out[width - 2..].fill(middle);
    }
}
