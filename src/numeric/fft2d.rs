//! Two-dimensional fast Fourier transform of small squares.
//!
//! Every butterfly works on whole rows, so all columns are transformed side by side in full registers. The other
//! dimension follows after one transpose. Self-sorting decimation in frequency (T. G. Stockham, AFIPS Proc. 28 (1966)
//! 229, <https://doi.org/10.1145/1464182.1464209>) with radices 4, 2, 3 and 5.

use super::lanes::LANES;
use super::vector::{Vector, vectorized};

/// A plane of complex numbers with separate real and imaginary parts.
#[derive(Debug, Clone, Default)]
pub struct Complex {
    /// Real parts.
    pub re: Vec<f32>,
    /// Imaginary parts.
    pub im: Vec<f32>,
}

/// Eight numbers in memory.
type Eight = [f32; LANES];

impl Complex {
    /// Allocates zeros.
    pub fn new(count: usize) -> Self {
        Self { re: vec![0.0; count], im: vec![0.0; count] }
    }

    fn swap_parts(&mut self) {
        std::mem::swap(&mut self.re, &mut self.im);
    }
}

/// One step of the transform: butterflies of one radix.
#[derive(Debug, Clone)]
struct Stage {
    radix: usize,
    /// The number of butterflies with different factors.
    groups: usize,
    /// The number of rows that share a factor.
    span: usize,
    /// cos and sin for each group and each output but the first.
    factors: Vec<(f32, f32)>,
    /// cos and sin for each group, output and input; for radices other than 2 and 4.
    turns: Vec<(f32, f32)>,
}

/// The plan of a transform of `size` x `size` numbers, in rows of `stride`.
#[derive(Debug, Clone)]
pub struct Transform {
    size: usize,
    stride: usize,
    stages: Vec<Stage>,
    spare: Complex,
}

impl Transform {
    /// Plans transforms of a size made of the factors 2, 3 and 5.
    pub fn new(size: usize) -> Self {
        let (mut rest, mut span, mut stages) = (size, 1, Vec::new());
        while rest > 1 {
            let radix = [4, 2, 3, 5].into_iter().find(|radix| rest.is_multiple_of(*radix)).unwrap_or(rest);
            let groups = rest / radix;
            let angle = |k: usize| -std::f64::consts::TAU * k as f64 / rest as f64;
            let factor = |group: usize, output: usize| {
                let (sin, cos) = angle(group * output).sin_cos();
                (cos as f32, sin as f32)
            };
            let factors = (0..groups).flat_map(|group| (1..radix).map(move |output| factor(group, output))).collect();
            let turn = |k: usize| {
                let (group, output, input) = (k / (radix * radix), k / radix % radix, k % radix);
                let (sin, cos) = (angle(group * output) + angle(groups * (input * output % radix))).sin_cos();
                (cos as f32, sin as f32)
            };
            let turns = if radix == 2 || radix == 4 { 0 } else { groups * radix * radix };
            stages.push(Stage { radix, groups, span, factors, turns: (0..turns).map(turn).collect() });
            rest = groups;
            span *= radix;
        }
        let stride = size.next_multiple_of(LANES);
        Self { size, stride, stages, spare: Complex::new(size.next_multiple_of(LANES) * stride) }
    }

    /// The number of rows and columns.
    pub fn size(&self) -> usize {
        self.size
    }

    /// The row stride; values past [`Self::size`] must be zero.
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Allocates memory of the right size.
    pub fn memory(&self) -> Complex {
        self.spare.clone()
    }

    /// Transforms `data`; the result is transposed.
    pub fn forward(&mut self, data: &mut Complex) {
        transform_columns(&self.stages, self.stride, data, &mut self.spare);
        transpose(&data.re, &mut self.spare.re, self.stride, self.size);
        transpose(&data.im, &mut self.spare.im, self.stride, self.size);
        std::mem::swap(data, &mut self.spare);
        transform_columns(&self.stages, self.stride, data, &mut self.spare);
    }

    /// Inverts [`Self::forward`], including the transpose, without the factor 1 / `size` squared.
    pub fn inverse(&mut self, data: &mut Complex) {
        // With real and imaginary part swapped, the forward transform is the inverse.
        data.swap_parts();
        self.forward(data);
        data.swap_parts();
    }
}

/// Returns the next size that is fast to transform: no prime factor above 5, at min 8.
pub fn fast_size(min: usize) -> usize {
    let smooth = |size: usize| {
        let mut rest = size;
        for factor in [2, 3, 5] {
            while rest.is_multiple_of(factor) {
                rest /= factor;
            }
        }
        rest == 1
    };
    (min.max(8)..).find(|size| smooth(*size)).unwrap_or(min)
}

vectorized! {
    /// Transforms every column.
    fn transform_columns(stages: &[Stage], stride: usize, data: &mut Complex, spare: &mut Complex) = columns_with
}

#[inline(always)]
fn columns_with<V: Vector>(stages: &[Stage], stride: usize, data: &mut Complex, spare: &mut Complex) {
    for stage in stages {
        let length = stage.span * stride / LANES;
        let (re, im) = (data.re.as_chunks().0, data.im.as_chunks().0);
        let (re_out, im_out) = (spare.re.as_chunks_mut().0, spare.im.as_chunks_mut().0);
        for group in 0..stage.groups {
            let inputs = (&re[group * length..], &im[group * length..]);
            let to = stage.radix * group * length..stage.radix * (group + 1) * length;
            let outputs = (&mut re_out[to.clone()], &mut im_out[to]);
            let factors = &stage.factors[group * (stage.radix - 1)..(group + 1) * (stage.radix - 1)];
            let step = stage.groups * length;
            match stage.radix {
                4 => butterfly_4::<V>(inputs, step, outputs, length, factors),
                2 => butterfly_2::<V>(inputs, step, outputs, length, factors),
                3 => butterfly_any::<V, 3>(inputs, step, outputs, length, &stage.turns[group * 9..]),
                radix => butterfly_any::<V, 5>(inputs, step, outputs, length, &stage.turns[group * radix * radix..]),
            }
        }
        std::mem::swap(data, spare);
    }
}

/// Eight complex numbers.
#[derive(Clone, Copy)]
struct Point<V>(V, V);

impl<V: Vector> Point<V> {
    #[inline(always)]
    fn load(re: &Eight, im: &Eight) -> Self {
        Self(V::from_eight(re), V::from_eight(im))
    }

    #[inline(always)]
    fn store(self, re: &mut Eight, im: &mut Eight) {
        *re = self.0.to_lanes().0;
        *im = self.1.to_lanes().0;
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(self.0.add(other.0), self.1.add(other.1))
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(self.0.sub(other.0), self.1.sub(other.1))
    }

    /// Multiplies by cos + i sin.
    #[inline(always)]
    fn turn(self, (cos, sin): (f32, f32)) -> Self {
        let (cos, sin) = (V::splat(cos), V::splat(sin));
        Self(self.0.mul(cos).sub(self.1.mul(sin)), self.0.mul(sin).add(self.1.mul(cos)))
    }
}

/// Radix 4: inputs `step` apart, outputs `length` apart.
#[inline(always)]
fn butterfly_4<V: Vector>(
    (re, im): (&[Eight], &[Eight]),
    step: usize,
    (re_out, im_out): (&mut [Eight], &mut [Eight]),
    length: usize,
    factors: &[(f32, f32)],
) {
    let [x0, x1, x2, x3] = [0, 1, 2, 3].map(|k| &re[k * step..k * step + length]);
    let [y0, y1, y2, y3] = [0, 1, 2, 3].map(|k| &im[k * step..k * step + length]);
    let (re_0, rest) = re_out.split_at_mut(length);
    let (re_1, rest) = rest.split_at_mut(length);
    let (re_2, re_3) = rest.split_at_mut(length);
    let (im_0, rest) = im_out.split_at_mut(length);
    let (im_1, rest) = rest.split_at_mut(length);
    let (im_2, im_3) = rest.split_at_mut(length);
    let (re_3, im_3) = (&mut re_3[..length], &mut im_3[..length]);
    let [f1, f2, f3] = [factors[0], factors[1], factors[2]];
    for i in 0..length {
        let (p0, p1) = (Point::<V>::load(&x0[i], &y0[i]), Point::<V>::load(&x1[i], &y1[i]));
        let (p2, p3) = (Point::<V>::load(&x2[i], &y2[i]), Point::<V>::load(&x3[i], &y3[i]));
        let (a, b, c, d) = (p0.add(p2), p0.sub(p2), p1.add(p3), p1.sub(p3));
        // d times -i.
        let d = Point(d.1, V::splat(0.0).sub(d.0));
        a.add(c).store(&mut re_0[i], &mut im_0[i]);
        b.add(d).turn(f1).store(&mut re_1[i], &mut im_1[i]);
        a.sub(c).turn(f2).store(&mut re_2[i], &mut im_2[i]);
        b.sub(d).turn(f3).store(&mut re_3[i], &mut im_3[i]);
    }
}

/// Radix 2.
#[inline(always)]
fn butterfly_2<V: Vector>(
    (re, im): (&[Eight], &[Eight]),
    step: usize,
    (re_out, im_out): (&mut [Eight], &mut [Eight]),
    length: usize,
    factors: &[(f32, f32)],
) {
    let [x0, x1] = [0, 1].map(|k| &re[k * step..k * step + length]);
    let [y0, y1] = [0, 1].map(|k| &im[k * step..k * step + length]);
    let (re_0, re_1) = re_out.split_at_mut(length);
    let (im_0, im_1) = im_out.split_at_mut(length);
    let (re_1, im_1) = (&mut re_1[..length], &mut im_1[..length]);
    for i in 0..length {
        let (a, b) = (Point::<V>::load(&x0[i], &y0[i]), Point::<V>::load(&x1[i], &y1[i]));
        a.add(b).store(&mut re_0[i], &mut im_0[i]);
        a.sub(b).turn(factors[0]).store(&mut re_1[i], &mut im_1[i]);
    }
}

/// Radix 3 or 5, as the plain sum.
#[inline(always)]
fn butterfly_any<V: Vector, const RADIX: usize>(
    (re, im): (&[Eight], &[Eight]),
    step: usize,
    (re_out, im_out): (&mut [Eight], &mut [Eight]),
    length: usize,
    turns: &[(f32, f32)],
) {
    for i in 0..length {
        let mut inputs = [Point(V::splat(0.0), V::splat(0.0)); RADIX];
        for (k, input) in inputs.iter_mut().enumerate() {
            *input = Point::load(&re[k * step + i], &im[k * step + i]);
        }
        for output in 0..RADIX {
            let mut sum = inputs[0].turn(turns[output * RADIX]);
            for (input, turn) in inputs.iter().zip(&turns[output * RADIX..]).skip(1) {
                sum = sum.add(input.turn(*turn));
            }
            sum.store(&mut re_out[output * length + i], &mut im_out[output * length + i]);
        }
    }
}

vectorized! {
    /// Transposes in blocks of 8 x 8 and clears the padding columns.
    fn transpose(from: &[f32], to: &mut [f32], stride: usize, size: usize) = transpose_with
}

#[inline(always)]
fn transpose_with<V: Vector>(from: &[f32], to: &mut [f32], stride: usize, size: usize) {
    let zero = V::splat(0.0);
    for block_y in (0..size).step_by(LANES) {
        let rows = LANES.min(size - block_y);
        for block_x in (0..size).step_by(LANES) {
            let mut block = [zero; LANES];
            for (row, line) in block.iter_mut().enumerate().take(rows) {
                *line = V::load(&from[(block_y + row) * stride + block_x..]);
            }
            let turned = V::transpose(block);
            for (column, line) in turned.into_iter().enumerate().take(size - block_x) {
                line.store(&mut to[(block_x + column) * stride + block_y..]);
            }
        }
    }
}

/// Returns a size for a window that fills whole registers: at most two pixels less than the window, or more than it.
pub fn register_size(window: usize) -> usize {
    let whole = |size: &usize| size.is_multiple_of(LANES) && fast_size(*size) == *size;
    (window.saturating_sub(2).max(LANES)..).find(whole).unwrap_or(window)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The plain double sum.
    fn slow(data: &Complex, size: usize) -> Vec<(f64, f64)> {
        let mut out = Vec::new();
        for kx in 0..size {
            for ky in 0..size {
                let mut sum = (0.0, 0.0);
                for y in 0..size {
                    for x in 0..size {
                        let angle = -std::f64::consts::TAU * ((kx * x + ky * y) % size) as f64 / size as f64;
                        let (sin, cos) = angle.sin_cos();
                        let stride = size.next_multiple_of(LANES);
                        let (re, im) = (f64::from(data.re[y * stride + x]), f64::from(data.im[y * stride + x]));
                        sum.0 += re * cos - im * sin;
                        sum.1 += re * sin + im * cos;
                    }
                }
                out.push(sum);
            }
        }
        out
    }

    fn noise(size: usize) -> Complex {
        let mut sequence = crate::numeric::Stream::new(size as u64);
        let transform = Transform::new(size);
        let mut data = transform.memory();
        for y in 0..size {
            for k in y * transform.stride()..y * transform.stride() + size {
                (data.re[k], data.im[k]) = (sequence.normal() as f32, sequence.normal() as f32);
            }
        }
        data
    }

    #[test]
    fn the_fast_transform_equals_the_double_sum_at_every_mix_of_factors_with_dirty_memory() {
        for size in [8, 9, 10, 12, 15, 16, 24, 25, 32, 36] {
            let mut data = noise(size);
            let expected = slow(&data, size);
            let mut transform = Transform::new(size);
            transform.spare.re.fill(f32::NAN);
            transform.spare.im.fill(f32::NAN);
            transform.forward(&mut data);
            for (k, (re, im)) in expected.into_iter().enumerate() {
                let k = k / size * transform.stride() + k % size;
                let error = (f64::from(data.re[k]) - re).abs().max((f64::from(data.im[k]) - im).abs());
                assert!(error < 1e-5 * (size * size) as f64, "size {size}, {k}: {error}");
            }
        }
    }

    #[test]
    fn the_inverse_restores_the_data() {
        for size in [20, 32, 45, 64] {
            let original = noise(size);
            let (mut data, mut transform) = (original.clone(), Transform::new(size));
            transform.forward(&mut data);
            transform.inverse(&mut data);
            let scale = 1.0 / (size * size) as f32;
            for k in (0..size * transform.stride()).filter(|k| k % transform.stride() < size) {
                assert!((data.re[k] * scale - original.re[k]).abs() < 1e-5, "size {size}");
                assert!((data.im[k] * scale - original.im[k]).abs() < 1e-5, "size {size}");
            }
        }
    }

    #[test]
    fn fast_sizes_have_no_large_factor() {
        assert_eq!([1, 63, 64, 65, 67, 97].map(fast_size), [8, 64, 64, 72, 72, 100]);
        assert_eq!([9, 21, 31, 33, 35, 41, 51].map(register_size), [8, 24, 32, 32, 40, 40, 64]);
    }
}
