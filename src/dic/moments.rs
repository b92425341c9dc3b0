//! All sums that a step of the refinement needs, in one pass over a reference and a target that lies pixel on pixel.

use super::lanes::{LANES, Lanes};
use super::plane::Plane;
use super::refine::Sums;
use super::vector::{Vector, vectorized};
use super::window::{Block, Window};

/// Sums over the pixels of a window; f is the reference's grey level, g the target's, J the Jacobian of the affine
/// warp, (gx, gx dx, gx dy, gy, gy dx, gy dy).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Moments {
    /// Sum of f.
    pub(super) reference: f64,
    /// Sum of g.
    pub(super) target: f64,
    /// Sums of f f, g g and f g.
    pub(super) products: [f64; 3],
    /// Sums of J, J f and J g.
    pub(super) jacobian: [[f64; 6]; 3],
    /// Sums of gx gx, gx gy, gy gy; each times 1, dx, dy, dx^2, dx dy, dy^2.
    pub(super) second: [[f64; 6]; 3],
}

/// Planes of one shape whose pixels lie on each other.
#[derive(Clone, Copy)]
pub(super) struct Layers<'a> {
    pub(super) reference: &'a Plane,
    pub(super) gradient_x: &'a Plane,
    pub(super) gradient_y: &'a Plane,
    pub(super) target: &'a Plane,
}

vectorized! {
    /// The sums over `window` about `at`, which must lie in the planes; what the planes hold off the mask must be finite.
    fn moments(layers: Layers<'_>, window: &Window, at: (i32, i32), out: &mut Moments) = moments_with
}

impl Moments {
    /// The sums over `window` about `at`, which must lie in the planes; what these hold off the mask must be finite.
    pub(super) fn of(layers: Layers<'_>, window: &Window, at: (i32, i32)) -> Self {
        let mut out = Self::default();
        moments(layers, window, at, &mut out);
        out
    }

    /// The sums over a target whose pixels have the mean of the reference taken off.
    pub(super) fn sums(&self, pixels: usize) -> Sums {
        let (pixels, mean) = (pixels as f64, self.reference / pixels as f64);
        let [_, squares, product] = self.products;
        Sums {
            levels: self.target - pixels * mean,
            energy: squares - 2.0 * mean * self.target + pixels * mean * mean,
            product: product - mean * self.target,
            jacobian: std::array::from_fn(|k| self.jacobian[2][k] - mean * self.jacobian[0][k]),
        }
    }
}

/// Vectors that are summed up at the end.
pub(super) const SUMS: usize = 48;

/// Sums down a column: of f, g, f f, g g and f g; twice each, the second a running sum, of gx, gy, gx f, gy f, gx g and
/// gy g; and three each of gx gx, gx gy and gy gy. What is summed twice is weighted with the number of rows left.
pub(super) const DOWN: usize = 5 + 2 * 6 + 3 * 3;

#[inline(always)]
fn moments_with<V: Vector>(layers: Layers<'_>, window: &Window, at: (i32, i32), out: &mut Moments) {
    let mut folded = [V::splat(0.0); SUMS];
    for block in &window.blocks {
        let mask = &window.mask[block.start..block.start + block.rows];
        let first = layers.reference.index((at.0 + block.dx) as isize, (at.1 + block.dy) as isize);
        let sums = down(layers, first, block.rows, |row| V::from_lanes(&mask[row]));
        fold(&sums, block, &mut folded);
    }
    total(&folded, out);
}

/// Sums down eight columns from the pixel with index `first` on.
#[inline(always)]
pub(super) fn down<V: Vector>(layers: Layers<'_>, first: usize, rows: usize, mask: impl Fn(usize) -> V) -> [V; DOWN] {
    let stride = layers.reference.stride();
    let planes = [layers.reference, layers.gradient_x, layers.gradient_y, layers.target];
    let [reference, gradient_x, gradient_y, target] = planes.map(|plane| &plane.data()[first..]);
    let mut sums = [V::splat(0.0); DOWN];
    for row in 0..rows {
        let (here, mask) = (row * stride, mask(row));
        let f = V::load(&reference[here..]).mul(mask);
        let (gx, gy) = (V::load(&gradient_x[here..]).mul(mask), V::load(&gradient_y[here..]).mul(mask));
        let g = V::load(&target[here..]).mul(mask);
        sums[0] = sums[0].add(f);
        sums[1] = sums[1].add(g);
        for (sum, (a, b)) in sums[2..5].iter_mut().zip([(f, f), (g, g), (f, g)]) {
            *sum = sum.plus_product(a, b);
        }
        for (k, (gradient, at)) in [(gx, 5), (gy, 7)].into_iter().enumerate() {
            sums[at] = sums[at].add(gradient);
            sums[at + 1] = sums[at + 1].add(sums[at]);
            for (level, at) in [(f, 9 + 2 * k), (g, 13 + 2 * k)] {
                sums[at] = sums[at].plus_product(gradient, level);
                sums[at + 1] = sums[at + 1].add(sums[at]);
            }
        }
        for (k, (a, b)) in [(gx, gx), (gx, gy), (gy, gy)].into_iter().enumerate() {
            let at = 17 + 3 * k;
            sums[at] = sums[at].plus_product(a, b);
            sums[at + 1] = sums[at + 1].add(sums[at]);
            sums[at + 2] = sums[at + 2].add(sums[at + 1]);
        }
    }
    sums
}

/// Adds the sums down a block of columns.
#[inline(always)]
pub(super) fn fold<V: Vector>(sums: &[V; DOWN], block: &Block, folded: &mut [V; SUMS]) {
    for (folded, sum) in folded.iter_mut().zip(&sums[..5]) {
        *folded = folded.add(*sum);
    }
    let x = V::splat(block.dx as f32).add(V::from_lanes(&Lanes::INDEX));
    // The row after the last one: rows left are counted up to it.
    let end = V::splat((block.dy + block.rows as i32) as f32);
    for k in 0..6 {
        let (sum, running) = (sums[5 + 2 * k], sums[6 + 2 * k]);
        let place = 5 + 6 * (k / 2) + 3 * (k % 2);
        folded[place] = folded[place].add(sum);
        folded[place + 1] = folded[place + 1].add(sum.mul(x));
        folded[place + 2] = folded[place + 2].add(sum.mul(end).sub(running));
    }
    for k in 0..3 {
        let (sum, running, again) = (sums[17 + 3 * k], sums[18 + 3 * k], sums[19 + 3 * k]);
        let place = 23 + 6 * k;
        let (by_x, by_y) = (sum.mul(x), sum.mul(end).sub(running));
        // Squares of the rows left, from the triangular numbers.
        let squares = again.add(again).sub(running);
        let by_yy = end.mul(end.mul(sum).sub(running.add(running))).add(squares);
        let powers = [sum, by_x, by_y, by_x.mul(x), by_y.mul(x), by_yy];
        for (n, power) in powers.into_iter().enumerate() {
            folded[place + n] = folded[place + n].add(power);
        }
    }
}

/// Adds up what was folded.
#[inline(always)]
pub(super) fn total<V: Vector>(folded: &[V; SUMS], out: &mut Moments) {
    let mut sums = [0.0; SUMS];
    for (folded, sums) in folded.chunks_exact(LANES).zip(sums.chunks_exact_mut(LANES)) {
        let mut group = [V::splat(0.0); LANES];
        group.copy_from_slice(folded);
        let [a, b, c, d, e, f, g, h] = V::transpose(group);
        let total = a.add(b).add(c.add(d)).add(e.add(f).add(g.add(h))).to_lanes();
        for (sum, value) in sums.iter_mut().zip(total.0) {
            *sum = f64::from(value);
        }
    }
    (out.reference, out.target) = (sums[0], sums[1]);
    out.products.copy_from_slice(&sums[2..5]);
    for (k, list) in out.jacobian.iter_mut().chain(&mut out.second).enumerate() {
        list.copy_from_slice(&sums[5 + 6 * k..][..6]);
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::dic::WindowShape;
    use crate::dic::vector::Portable;

    pub(in crate::dic) fn plane(seed: u32) -> Plane {
        let mut plane = Plane::default();
        plane.reshape(60, 50);
        let mut state = seed;
        for y in 0..50 {
            for value in plane.row_mut(y) {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                *value = (state >> 24) as f32 - 128.0;
            }
        }
        plane
    }

    /// The slow twin, pixel by pixel in double precision.
    fn slow(planes: &[Plane; 4], window: &Window, at: (i32, i32)) -> Moments {
        let mut out = Moments::default();
        for (dx, dy) in (-20..=20).flat_map(|dy| (-20..=20).map(move |dx| (dx, dy))) {
            if !window.holds(dx, dy) {
                continue;
            }
            let value = |k: usize| f64::from(planes[k].row((at.1 + dy) as usize)[(at.0 + dx) as usize]);
            let (f, gx, gy, g, x, y) = (value(0), value(1), value(2), value(3), f64::from(dx), f64::from(dy));
            out.reference += f;
            out.target += g;
            for (sum, value) in out.products.iter_mut().zip([f * f, g * g, f * g]) {
                *sum += value;
            }
            for (sums, factor) in out.jacobian.iter_mut().zip([1.0, f, g]) {
                for (sum, value) in sums.iter_mut().zip([gx, gx * x, gx * y, gy, gy * x, gy * y]) {
                    *sum += factor * value;
                }
            }
            for (sums, product) in out.second.iter_mut().zip([gx * gx, gx * gy, gy * gy]) {
                for (sum, power) in sums.iter_mut().zip([1.0, x, y, x * x, x * y, y * y]) {
                    *sum += product * power;
                }
            }
        }
        out
    }

    fn all(m: &Moments) -> Vec<f64> {
        let lists = m.jacobian.iter().chain(&m.second).flatten();
        [m.reference, m.target].iter().chain(&m.products).chain(lists).copied().collect()
    }

    #[test]
    fn sums_are_those_of_the_slow_twin_and_equal_on_every_machine() {
        let planes = [plane(1), plane(2), plane(3), plane(4)];
        let [reference, gradient_x, gradient_y, target] = &planes;
        let layers = Layers { reference, gradient_x, gradient_y, target };
        for (shape, size) in [(WindowShape::Square, 31), (WindowShape::Circle, 29), (WindowShape::Ring, 21)] {
            let window = Window::new(shape, size);
            let at = (30, 24);
            let found = Moments::of(layers, &window, at);
            let mut plain = Moments::default();
            moments_with::<Portable>(layers, &window, at, &mut plain);
            assert_eq!(all(&found), all(&plain));
            for (found, expected) in all(&found).iter().zip(all(&slow(&planes, &window, at))) {
                // Random signs: sums are far smaller than what was added up, up to 128^2 15^2 a pixel.
                assert!((found - expected).abs() < 1e-6 * expected.abs() + 60.0, "{found} {expected}");
            }
        }
    }
}
