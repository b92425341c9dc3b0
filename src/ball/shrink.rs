//! Reduced, smoothed and cleaned copies of a picture for the coarse search.

use crate::image::ImageView;

/// A small grey picture that keeps its memory.
#[derive(Debug, Clone, Default)]
pub(super) struct Grey {
    pub data: Vec<f32>,
    pub width: usize,
    pub height: usize,
}

impl Grey {
    pub fn reshape(&mut self, width: usize, height: usize) {
        self.data.resize(width * height, 0.0);
        (self.width, self.height) = (width, height);
    }

    /// Copies a region of `image`.
    pub fn take(&mut self, image: ImageView<'_>, x0: usize, y0: usize, width: usize, height: usize) {
        self.reshape(width, height);
        for (y, row) in self.data.chunks_exact_mut(width.max(1)).enumerate() {
            row.copy_from_slice(&image.row(y0 + y)[x0..x0 + width]);
        }
    }

    /// Takes a region of `image` at half its size, each pixel the mean of four.
    pub fn halve_view(&mut self, image: ImageView<'_>, x0: usize, y0: usize, width: usize, height: usize) {
        self.reshape(width / 2, height / 2);
        for (y, row) in self.data.chunks_exact_mut((width / 2).max(1)).enumerate() {
            let upper = &image.row(y0 + 2 * y)[x0..x0 + width];
            let lower = &image.row(y0 + 2 * y + 1)[x0..x0 + width];
            halve_rows(upper, lower, row);
        }
    }
}

/// Halves `fine` into `coarse`, each pixel the mean of four.
pub(super) fn halve(fine: &Grey, coarse: &mut Grey) {
    coarse.reshape(fine.width / 2, fine.height / 2);
    for (y, row) in coarse.data.chunks_exact_mut((fine.width / 2).max(1)).enumerate() {
        let start = 2 * y * fine.width;
        let (upper, lower) = fine.data[start..start + 2 * fine.width].split_at(fine.width);
        halve_rows(upper, lower, row);
    }
}

fn halve_rows(upper: &[f32], lower: &[f32], out: &mut [f32]) {
    for ((pixel, a), b) in out.iter_mut().zip(upper.chunks_exact(2)).zip(lower.chunks_exact(2)) {
        *pixel = 0.25 * (a[0] + a[1] + b[0] + b[1]);
    }
}

/// Blurs by one pixel (binomial of order 4 along both axes); the border repeats.
#[multiversion::multiversion(targets("x86_64+avx2+fma"))]
pub(super) fn blur(from: &Grey, spare: &mut Grey, to: &mut Grey) {
    let (width, height) = (from.width, from.height);
    spare.reshape(width, height);
    to.reshape(width, height);
    if width < 5 || height < 5 {
        to.data.copy_from_slice(&from.data);
        return;
    }
    for (row, out) in from.data.chunks_exact(width).zip(spare.data.chunks_exact_mut(width)) {
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
            &spare.data[y..y + width]
        };
        let (a, b, c, d, e) = (row(0), row(1), row(2), row(3), row(4));
        for x in 0..width {
            out[x] = (a[x] + e[x] + 4.0 * (b[x] + d[x]) + 6.0 * c[x]) * (1.0 / 16.0);
        }
    }
}

/// Grey closing with a disc of radius 2: paints out dark marks up to 5 px wide,
/// leaves straight and gently curved edges where they are.
pub(super) fn close_dark(from: &Grey, spare: &mut Grey, to: &mut Grey) {
    disc_filter(from, spare, larger);
    disc_filter(spare, to, smaller);
}

/// Grey opening with a disc of radius 2: paints out bright marks.
pub(super) fn open_bright(from: &Grey, spare: &mut Grey, to: &mut Grey) {
    disc_filter(from, spare, smaller);
    disc_filter(spare, to, larger);
}

// Unlike `f32::max` these are one instruction each; grey levels are never NaN.
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// `pick` over a 5 x 5 square without its corners; the border repeats.
fn disc_filter(from: &Grey, to: &mut Grey, pick: impl Fn(f32, f32) -> f32 + Copy) {
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
            let beside = |x: usize| pick(pick(a[x], e[x]), pick(pick(b[x], c[x]), d[x]));
            let outer = |x: usize| pick(pick(b[x], c[x]), d[x]);
            out[x] = pick(pick(tall, pick(beside(x - 1), beside(x + 1))), pick(outer(x - 2), outer(x + 2)));
        }
        let middle = out[2];
        out[..2].fill(middle);
        let middle = out[width - 3];
        out[width - 2..].fill(middle);
    }
}
