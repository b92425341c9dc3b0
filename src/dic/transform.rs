//! Two-dimensional fast Fourier transform of small squares.
//!
//! General libraries transform one line after the other and spend most of their
//! time on transposes and single numbers for sizes like 32. Here every butterfly
//! works on whole rows, so all columns are transformed side by side in full
//! registers; the other dimension follows after one transpose.
//! Self-sorting decimation in frequency (T. G. Stockham, AFIPS Proc. 28 (1966) 229,
//! <https://doi.org/10.1145/1464182.1464209>) with radices 4, 2, 3 and 5.

use multiversion::multiversion;

/// A plane of complex numbers, real and imaginary parts apart.
#[derive(Debug, Clone, Default)]
pub(super) struct Complex {
    pub(super) re: Vec<f32>,
    pub(super) im: Vec<f32>,
}

impl Complex {
    /// Zeros.
    pub(super) fn new(count: usize) -> Self {
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
    /// Butterflies with different factors.
    groups: usize,
    /// Rows that share a factor.
    span: usize,
    /// cos and sin for each group and each output but the first.
    factors: Vec<(f32, f32)>,
}

/// Plan of a transform of `size` x `size` numbers.
#[derive(Debug, Clone)]
pub(super) struct Transform {
    size: usize,
    stages: Vec<Stage>,
    spare: Complex,
}

impl Transform {
    /// Plans transforms of a size made of the factors 2, 3 and 5.
    pub(super) fn new(size: usize) -> Self {
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
            stages.push(Stage { radix, groups, span, factors });
            rest = groups;
            span *= radix;
        }
        Self { size, stages, spare: Complex::new(size * size) }
    }

    /// Rows and columns.
    pub(super) fn size(&self) -> usize {
        self.size
    }

    /// Transforms `data`; the result is transposed.
    pub(super) fn forward(&mut self, data: &mut Complex) {
        transform_columns(&self.stages, self.size, data, &mut self.spare);
        transpose(&data.re, &mut self.spare.re, self.size);
        transpose(&data.im, &mut self.spare.im, self.size);
        std::mem::swap(data, &mut self.spare);
        transform_columns(&self.stages, self.size, data, &mut self.spare);
    }

    /// Undoes [`Self::forward`], transpose included; the result is `size` squared times too large.
    pub(super) fn inverse(&mut self, data: &mut Complex) {
        // With real and imaginary part swapped, the forward transform is the inverse one.
        data.swap_parts();
        self.forward(data);
        data.swap_parts();
    }
}

/// The next size that is fast to transform: no prime factor above 5, at least 8.
pub(super) fn fast_size(least: usize) -> usize {
    let smooth = |size: usize| {
        let mut rest = size;
        for factor in [2, 3, 5] {
            while rest.is_multiple_of(factor) {
                rest /= factor;
            }
        }
        rest == 1
    };
    (least.max(8)..).find(|size| smooth(*size)).unwrap_or(least)
}

/// Transforms every column.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn transform_columns(stages: &[Stage], width: usize, data: &mut Complex, spare: &mut Complex) {
    for stage in stages {
        let length = stage.span * width;
        for group in 0..stage.groups {
            let from = |k: usize| (group + stage.groups * k) * length..(group + stage.groups * k + 1) * length;
            let to = stage.radix * group * length..stage.radix * (group + 1) * length;
            let (re, im) = (&mut spare.re[to.clone()], &mut spare.im[to]);
            let factors = &stage.factors[group * (stage.radix - 1)..(group + 1) * (stage.radix - 1)];
            match stage.radix {
                4 => {
                    let re_in = [&data.re[from(0)], &data.re[from(1)], &data.re[from(2)], &data.re[from(3)]];
                    let im_in = [&data.im[from(0)], &data.im[from(1)], &data.im[from(2)], &data.im[from(3)]];
                    butterfly_4(re_in, im_in, re, im, factors);
                }
                2 => {
                    let re_in = [&data.re[from(0)], &data.re[from(1)]];
                    let im_in = [&data.im[from(0)], &data.im[from(1)]];
                    butterfly_2(re_in, im_in, re, im, factors);
                }
                radix => {
                    let inputs = (0..radix).map(|k| (&data.re[from(k)], &data.im[from(k)]));
                    butterfly_any(inputs, re, im, factors);
                }
            }
        }
        std::mem::swap(data, spare);
    }
}

/// Radix 4.
#[inline(always)]
fn butterfly_4(re: [&[f32]; 4], im: [&[f32]; 4], re_out: &mut [f32], im_out: &mut [f32], factors: &[(f32, f32)]) {
    let length = re[0].len();
    let (re_0, re_out) = re_out.split_at_mut(length);
    let (re_1, re_out) = re_out.split_at_mut(length);
    let (re_2, re_3) = re_out.split_at_mut(length);
    let (im_0, im_out) = im_out.split_at_mut(length);
    let (im_1, im_out) = im_out.split_at_mut(length);
    let (im_2, im_3) = im_out.split_at_mut(length);
    let [x0, x1, x2, x3] = re.map(|part| &part[..length]);
    let [y0, y1, y2, y3] = im.map(|part| &part[..length]);
    let (im_0, im_1) = (&mut im_0[..length], &mut im_1[..length]);
    let (im_2, im_3) = (&mut im_2[..length], &mut im_3[..length]);
    let (re_2, re_3) = (&mut re_2[..length], &mut re_3[..length]);
    let [(c1, s1), (c2, s2), (c3, s3)] = [factors[0], factors[1], factors[2]];
    for i in 0..length {
        let (ar, ai) = (x0[i] + x2[i], y0[i] + y2[i]);
        let (br, bi) = (x0[i] - x2[i], y0[i] - y2[i]);
        let (cr, ci) = (x1[i] + x3[i], y1[i] + y3[i]);
        // (x1 - x3) times -i.
        let (dr, di) = (y1[i] - y3[i], x3[i] - x1[i]);
        re_0[i] = ar + cr;
        im_0[i] = ai + ci;
        let (er, ei) = (br + dr, bi + di);
        re_1[i] = er * c1 - ei * s1;
        im_1[i] = er * s1 + ei * c1;
        let (er, ei) = (ar - cr, ai - ci);
        re_2[i] = er * c2 - ei * s2;
        im_2[i] = er * s2 + ei * c2;
        let (er, ei) = (br - dr, bi - di);
        re_3[i] = er * c3 - ei * s3;
        im_3[i] = er * s3 + ei * c3;
    }
}

/// Radix 2.
#[inline(always)]
fn butterfly_2(re: [&[f32]; 2], im: [&[f32]; 2], re_out: &mut [f32], im_out: &mut [f32], factors: &[(f32, f32)]) {
    let length = re[0].len();
    let (re_0, re_1) = re_out.split_at_mut(length);
    let (im_0, im_1) = im_out.split_at_mut(length);
    let ([x0, x1], [y0, y1]) = (re.map(|part| &part[..length]), im.map(|part| &part[..length]));
    let (re_1, im_0, im_1) = (&mut re_1[..length], &mut im_0[..length], &mut im_1[..length]);
    let (c, s) = factors[0];
    for i in 0..length {
        re_0[i] = x0[i] + x1[i];
        im_0[i] = y0[i] + y1[i];
        let (er, ei) = (x0[i] - x1[i], y0[i] - y1[i]);
        re_1[i] = er * c - ei * s;
        im_1[i] = er * s + ei * c;
    }
}

/// Any radix, as the plain sum: for 3 and 5.
#[inline(always)]
fn butterfly_any<'a>(
    inputs: impl ExactSizeIterator<Item = (&'a [f32], &'a [f32])> + Clone,
    re_out: &mut [f32],
    im_out: &mut [f32],
    factors: &[(f32, f32)],
) {
    let radix = inputs.len();
    let length = re_out.len() / radix;
    let outputs = re_out.chunks_exact_mut(length).zip(im_out.chunks_exact_mut(length));
    for (output, (re_out, im_out)) in outputs.enumerate() {
        re_out.fill(0.0);
        im_out.fill(0.0);
        let (factor_re, factor_im) = if output == 0 { (1.0, 0.0) } else { factors[output - 1] };
        for (k, (re, im)) in inputs.clone().enumerate() {
            let angle = -std::f64::consts::TAU * ((k * output) % radix) as f64 / radix as f64;
            let (cos, sin) = (angle.cos() as f32, angle.sin() as f32);
            let (c, s) = (cos * factor_re - sin * factor_im, cos * factor_im + sin * factor_re);
            for ((re_out, im_out), (re, im)) in re_out.iter_mut().zip(&mut *im_out).zip(re.iter().zip(im)) {
                *re_out += re * c - im * s;
                *im_out += re * s + im * c;
            }
        }
    }
}

/// Rows to columns, in blocks of 8 x 8 where they fit.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn transpose(from: &[f32], to: &mut [f32], size: usize) {
    for block_y in (0..size).step_by(8) {
        let rows = 8.min(size - block_y);
        for x in 0..size {
            let target = &mut to[x * size + block_y..x * size + block_y + rows];
            for (row, value) in target.iter_mut().enumerate() {
                *value = from[(block_y + row) * size + x];
            }
        }
    }
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
                        let (re, im) = (f64::from(data.re[y * size + x]), f64::from(data.im[y * size + x]));
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
        let mut sequence = crate::dic::speckle::Sequence::new(size as u64);
        let mut data = Complex::new(size * size);
        data.re.iter_mut().chain(&mut data.im).for_each(|value| *value = sequence.normal() as f32);
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
                let error = (f64::from(data.re[k]) - re).abs().max((f64::from(data.im[k]) - im).abs());
                assert!(error < 1e-5 * (size * size) as f64, "size {size}, {k}: {error}");
            }
        }
    }

    #[test]
    fn the_inverse_gives_the_data_back() {
        for size in [20, 32, 45, 64] {
            let original = noise(size);
            let (mut data, mut transform) = (original.clone(), Transform::new(size));
            transform.forward(&mut data);
            transform.inverse(&mut data);
            let scale = 1.0 / (size * size) as f32;
            for (found, expected) in data.re.iter().zip(&original.re).chain(data.im.iter().zip(&original.im)) {
                assert!((found * scale - expected).abs() < 1e-5, "size {size}");
            }
        }
    }

    #[test]
    fn fast_sizes_have_no_large_factor() {
        assert_eq!([1, 63, 64, 65, 67, 97].map(fast_size), [8, 64, 64, 72, 72, 100]);
    }
}
