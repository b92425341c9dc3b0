//! Which pixels of a body look alike in two frames, and which are hidden by something.
//!
//! An occluder is no tail of the residuals but a good part of them, so weights
//! pixel by pixel follow it. What its neighbourhood says of a pixel is clear:
//! first the local ZNCC, which gain and offset cannot mislead, then the local
//! residual, which is sharper.

use multiversion::multiversion;

use super::lanes::{LANES, Lanes};
use super::window::Window;

/// Half the side of the neighbourhood whose ZNCC is taken, px.
const ZNCC_REACH: usize = 5;

/// Local ZNCC above which a pixel looks alike.
const ALIKE_ZNCC: f32 = 0.85;

/// Half the side of the neighbourhood whose residual is taken, px.
const RESIDUAL_REACH: usize = 3;

/// Times the noise that the local residual of a pixel in sight may have.
const ALIKE_RESIDUAL: f32 = 2.5;

/// Times the noise that a pixel in sight may differ by itself.
const OWN_RESIDUAL: f32 = 3.0;

/// Times its median says that the root mean square of an even residual may be.
const MOST_UNEVEN: f32 = 1.3;

/// Empty columns and rows around, so that neighbourhoods need no test.
const PAD: usize = ZNCC_REACH;

/// Memory for maps of one body.
#[derive(Debug, Clone, Default)]
pub(super) struct Likeness {
    stride: usize,
    mask: Vec<f32>,
    reference: Vec<f32>,
    residual: Vec<f32>,
    product: Vec<f32>,
    columns: Vec<f32>,
    /// Pixels, and sums of f, g, f f, g g and f g.
    sums: [Vec<f32>; 6],
    sorted: Vec<f32>,
}

impl Likeness {
    /// Loads a reference, where it is needed, and its residual, both packed like the window's mask.
    pub(super) fn load(&mut self, window: &Window, reference: &[Lanes], residual: &[Lanes]) {
        let (width, height) = window.extent.sides();
        // Whole blocks: their lanes may reach over the rectangle to both sides.
        self.stride = width + 2 * PAD + 2 * LANES;
        let len = self.stride * (height + 2 * PAD);
        for (plane, packed) in
            [(&mut self.mask, &window.mask[..]), (&mut self.reference, reference), (&mut self.residual, residual)]
        {
            plane.clear();
            plane.resize(len, 0.0);
            for (first, row) in places(window, self.stride).zip(packed) {
                plane[first..first + LANES].copy_from_slice(&row.0);
            }
        }
    }

    /// 1 where the neighbourhood's ZNCC says that it is the same thing, else 0.
    pub(super) fn by_zncc(&mut self, window: &Window, kept: &mut Vec<Lanes>) {
        let Self { mask, reference, residual, product, columns, sums, .. } = self;
        let stride = self.stride;
        // The target, at the reference's gain: the reference less the residual.
        let pairs: [fn(f32, f32) -> f32; 5] =
            [|f, _| f, |f, r| f - r, |f, _| f * f, |f, r| (f - r) * (f - r), |f, r| f * (f - r)];
        box_sums(mask, stride, ZNCC_REACH, columns, &mut sums[0]);
        for (pair, sum) in pairs.into_iter().zip(&mut sums[1..]) {
            product.clear();
            product.extend(reference.iter().zip(residual.iter()).map(|(f, r)| pair(*f, *r)));
            box_sums(product, stride, ZNCC_REACH, columns, sum);
        }
        let [count, f, g, ff, gg, fg] = sums;
        let alike = |at: usize| {
            let n = count[at].max(1.0);
            let (both, own, other) =
                (fg[at] - f[at] * g[at] / n, ff[at] - f[at] * f[at] / n, gg[at] - g[at] * g[at] / n);
            both > 0.0 && both * both > ALIKE_ZNCC * ALIKE_ZNCC * own * other
        };
        pick(window, stride, alike, kept);
    }

    /// 1 where the neighbourhood's residual is no more than noise, else 0.
    pub(super) fn by_residual(&mut self, window: &Window, noise: f32, kept: &mut Vec<Lanes>) {
        let Self { mask, residual, product, columns, sums, .. } = self;
        let stride = self.stride;
        product.clear();
        product.extend(residual.iter().map(|r| r * r));
        let [count, square, ..] = sums;
        box_sums(mask, stride, RESIDUAL_REACH, columns, count);
        box_sums(product, stride, RESIDUAL_REACH, columns, square);
        let most = (ALIKE_RESIDUAL * noise).powi(2);
        pick(window, stride, |at| square[at] < most * count[at].max(1.0), kept);
    }

    /// Pixels in sight, those next to an occluder too, whose neighbourhoods see it.
    ///
    /// A pixel within reach of one that is kept counts when its own residual is no more than noise.
    pub(super) fn in_sight(&mut self, window: &Window, noise: f32, kept: &[Lanes]) -> usize {
        let Self { residual, product, columns, sums, .. } = self;
        let stride = self.stride;
        product.clear();
        product.resize(residual.len(), 0.0);
        for (first, row) in places(window, stride).zip(kept) {
            product[first..first + LANES].copy_from_slice(&row.0);
        }
        let near = &mut sums[0];
        box_sums(product, stride, RESIDUAL_REACH, columns, near);
        let seen = |at: usize| product[at] > 0.5 || (near[at] > 0.5 && residual[at].abs() < OWN_RESIDUAL * noise);
        let lanes = |(first, mask): (usize, &Lanes)| {
            (0..LANES).filter(|lane| mask.0[*lane] > 0.5 && seen(first + lane)).count()
        };
        places(window, stride).zip(&window.mask).map(lanes).sum()
    }

    /// Standard deviation of the residual where `kept` is 1, from its median: a few strange pixels do not matter.
    pub(super) fn noise(&mut self, window: &Window, kept: &[Lanes]) -> Option<f32> {
        self.sorted.clear();
        for (first, row) in places(window, self.stride).zip(kept) {
            let lanes = row.0.iter().zip(&self.residual[first..first + LANES]);
            self.sorted.extend(lanes.filter(|(kept, _)| **kept > 0.5).map(|(_, residual)| residual.abs()));
        }
        let middle = self.sorted.len() / 2;
        let median =
            *(!self.sorted.is_empty()).then(|| self.sorted.select_nth_unstable_by(middle, f32::total_cmp).1)?;
        Some(1.4826 * median)
    }

    /// Whether the residual where `kept` is 1 is that of noise alone: of one strength all over.
    ///
    /// Where half of a body is hidden, the median is no longer that of what is in sight, and hides the rest.
    pub(super) fn is_even(&self, window: &Window, noise: f32, kept: &[Lanes]) -> bool {
        let (mut square, mut count) = (0.0_f64, 0.0_f64);
        for (first, row) in places(window, self.stride).zip(kept) {
            for (kept, residual) in row.0.iter().zip(&self.residual[first..first + LANES]) {
                square += f64::from(kept * residual * residual);
                count += f64::from(*kept);
            }
        }
        square <= count * f64::from(MOST_UNEVEN * noise).powi(2)
    }
}

/// Index of the first of each row of eight.
fn places(window: &Window, stride: usize) -> impl Iterator<Item = usize> {
    let (left, top) = (window.extent.left - (PAD + LANES) as i32, window.extent.top - PAD as i32);
    window.blocks.iter().flat_map(move |block| {
        let (x, y) = ((block.dx - left) as usize, (block.dy - top) as usize);
        (0..block.rows).map(move |row| (y + row) * stride + x)
    })
}

/// The mask of what is alike, packed like the window's.
fn pick(window: &Window, stride: usize, alike: impl Fn(usize) -> bool, kept: &mut Vec<Lanes>) {
    kept.clear();
    kept.extend(places(window, stride).zip(&window.mask).map(|(first, mask)| {
        let lane = |lane: usize| if mask.0[lane] > 0.5 && alike(first + lane) { 1.0 } else { 0.0 };
        Lanes(std::array::from_fn(lane))
    }));
}

/// The sum of the square of side 2 `reach` + 1 around every value; nonsense within `reach` rows of the ends.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn box_sums(values: &[f32], stride: usize, reach: usize, columns: &mut Vec<f32>, out: &mut Vec<f32>) {
    for plane in [&mut *columns, &mut *out] {
        plane.clear();
        plane.resize(values.len(), 0.0);
    }
    let inner = reach * stride..values.len().saturating_sub(reach * stride).max(reach * stride);
    for shift in 0..=2 * reach {
        let from = &values[shift * stride..][..inner.len()];
        columns[inner.clone()].iter_mut().zip(from).for_each(|(sum, value)| *sum += value);
    }
    let inner = reach..values.len() - reach;
    for shift in 0..=2 * reach {
        let from = &columns[shift..][..inner.len()];
        out[inner.clone()].iter_mut().zip(from).for_each(|(sum, value)| *sum += value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dic::WindowShape;

    fn packed(window: &Window, value: impl Fn(i32, i32) -> f32) -> Vec<Lanes> {
        let row = |block: &super::super::window::Block, row: usize| {
            let dy = block.dy + row as i32;
            Lanes(std::array::from_fn(|lane| {
                let dx = block.dx + lane as i32;
                if window.holds(dx, dy) { value(dx, dy) } else { 0.0 }
            }))
        };
        window.blocks.iter().flat_map(|block| (0..block.rows).map(move |index| row(block, index))).collect()
    }

    fn speckle(dx: i32, dy: i32) -> f32 {
        let mut state = (dx as u32).wrapping_mul(0x9E37_79B1) ^ (dy as u32).wrapping_mul(0x85EB_CA77);
        for _ in 0..3 {
            state = (state ^ (state >> 15)).wrapping_mul(0x2C1B_3C6D);
        }
        (state >> 24) as f32 - 128.0
    }

    /// The slow twin: each neighbourhood summed afresh.
    #[test]
    fn local_residuals_equal_those_summed_one_by_one_with_dirty_memory() {
        let window = Window::new(WindowShape::Circle, 31);
        let residual = packed(&window, |dx, dy| 0.05 * speckle(dx, dy) + if dx > 6 { 20.0 } else { 0.0 });
        let mut likeness = Likeness::default();
        let mut kept = Vec::new();
        for dirty in [false, true] {
            if dirty {
                likeness.sums.iter_mut().for_each(|plane| plane.fill(f32::NAN));
                likeness.columns.fill(f32::NAN);
            }
            likeness.load(&window, &packed(&window, speckle), &residual);
            likeness.by_residual(&window, 4.0, &mut kept);
            let expected = packed(&window, |dx, dy| {
                let (mut square, mut count) = (0.0, 0.0);
                for (x, y) in (-3..=3).flat_map(|y| (-3..=3).map(move |x| (dx + x, dy + y))) {
                    if window.holds(x, y) {
                        square += (0.05 * speckle(x, y) + if x > 6 { 20.0 } else { 0.0 }).powi(2);
                        count += 1.0;
                    }
                }
                if square < 100.0 * count { 1.0 } else { 0.0 }
            });
            assert_eq!(kept, expected);
        }
    }

    #[test]
    fn what_is_replaced_is_told_from_what_is_only_lit_otherwise() {
        let window = Window::new(WindowShape::Circle, 61);
        let target = |dx: i32, dy: i32| if dx > 8 { speckle(dx + 900, dy) } else { 1.3 * speckle(dx, dy) + 20.0 };
        let residual = packed(&window, |dx, dy| speckle(dx, dy) - target(dx, dy));
        let (mut likeness, mut kept) = (Likeness::default(), Vec::new());
        likeness.load(&window, &packed(&window, speckle), &residual);
        likeness.by_zncc(&window, &mut kept);
        let wrong = kept.iter().zip(packed(&window, |dx, _| if dx > 8 { 0.0 } else { 1.0 }));
        let wrong: usize =
            wrong.map(|(a, b)| a.0.iter().zip(&b.0).filter(|(a, b)| (*a - *b).abs() > 0.5).count()).sum();
        // Only along the edge, where neighbourhoods see both.
        assert!(wrong < 5 * 61, "{wrong} of {}", window.pixels);
    }
}
