//! The residual of a match: reference minus gain-matched target.

use multiversion::multiversion;

use super::icgn::{MIN_VARIANCE, Refiner};
use crate::dic::geometry::{SubsetMask, Warp};
use crate::dic::subset::{Sums, plane_row};
use crate::numeric::{LANES, Lanes, Vector, vectorized};

impl Refiner<'_> {
    /// Computes the residual of the match with this warp, DN, packed like the subset.
    ///
    /// Empty if the warped subset leaves the image or the target has no contrast.
    pub(in crate::dic) fn residual(&self, warp: &Warp, out: &mut Vec<Lanes>) {
        match self.sample_target(warp, out) {
            Ok(sums) => self.convert_to_residual(self, sums, out),
            Err(_) => out.clear(),
        }
    }

    /// Computes the residual of `whole`, of which this is a part, from the [samples](Self::sample_target) of `whole`.
    /// Gain, mean and illumination are those of the part. Empty if there are no samples.
    pub(in crate::dic) fn residual_from(&self, whole: &Refiner<'_>, samples: &[Lanes], out: &mut Vec<Lanes>) {
        out.clear();
        out.extend_from_slice(samples);
        if samples.is_empty() {
            return;
        }
        // The samples of the whole include those of the part, minus another mean.
        self.convert_to_residual(whole, part_sums(samples, self.window), out);
    }

    /// Converts samples of `whole` to its residual as [`Self::subtract`] does; empty if the target has no contrast.
    fn convert_to_residual(&self, whole: &Refiner<'_>, sums: Sums, out: &mut Vec<Lanes>) {
        let pixels = self.window.pixels as f64;
        let contrast = self.without_illumination(&sums, sums.levels / pixels).1;
        if contrast.is_nan() || contrast <= MIN_VARIANCE * pixels {
            // A target without contrast matches nothing, and nothing shows that it occludes the body.
            out.clear();
            return;
        }
        self.subtract(whole, sums, out);
    }

    /// Converts samples of `whole` to its residual. Gain, mean and illumination are those of this part, which `sums`
    /// belong to.
    pub(in crate::dic) fn subtract(&self, whole: &Refiner<'_>, sums: Sums, out: &mut [Lanes]) {
        let mean = sums.levels / self.window.pixels as f64;
        let (slopes, energy) = self.without_illumination(&sums, mean);
        let gain = (self.subset.energy / energy).sqrt();
        // The mean of each reference is subtracted from its levels.
        let apart = f64::from(whole.subset.mean - self.subset.mean) / gain;
        let (middle, slopes) = self.subset.light.as_ref().map_or(([0.0; 2], [0.0; 2]), |light| {
            (light.centroid, std::array::from_fn(|axis| slopes[axis] - light.slopes[axis] / gain))
        });
        for block in &whole.window.blocks {
            let rows = block.start..block.start + block.rows;
            let mean = Lanes::splat((mean + apart) as f32) + plane_row(slopes, middle, block.dx, block.dy);
            let fit = BlockFit { mean, slope: slopes[1] as f32, gain: gain as f32 };
            subtract(&whole.subset.levels[rows.clone()], &whole.window.mask[rows.clone()], &fit, &mut out[rows]);
        }
    }
}

/// The fit of the target to the reference on eight columns.
struct BlockFit {
    /// The mean, with the illumination plane, in the first row.
    mean: Lanes,
    /// The slope of the mean from row to row.
    slope: f32,
    gain: f32,
}

vectorized! {
    /// Computes levels - gain (samples - mean) on the mask, in place of the samples in `out`.
    fn subtract(levels: &[Lanes], mask: &[Lanes], fit: &BlockFit, out: &mut [Lanes]) = subtract_with
}

/// Implements [`subtract`] on vectors of type `V`.
#[inline(always)]
fn subtract_with<V: Vector>(levels: &[Lanes], mask: &[Lanes], fit: &BlockFit, out: &mut [Lanes]) {
    let (first, slope, gain) = (V::from_lanes(&fit.mean), V::splat(fit.slope), V::splat(fit.gain));
    for (row, ((level, mask), out)) in levels.iter().zip(mask).zip(out).enumerate() {
        let mean = first.plus_product(slope, V::splat(row as f32));
        let value = V::from_lanes(out).sub(mean.mul(V::from_lanes(mask)));
        *out = V::from_lanes(level).sub(value.mul(gain)).to_lanes();
    }
}

/// Returns the sums of samples on the mask of a window. Those that need gradients or the reference are left at zero.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn part_sums(samples: &[Lanes], window: &SubsetMask) -> Sums {
    let mut sums = Sums::default();
    for block in &window.blocks {
        let rows = block.start..block.start + block.rows;
        // In double precision, because the contrast is a small difference of the two sums.
        let (mut levels, mut down, mut energy) = ([0.0_f64; LANES], [0.0_f64; LANES], [0.0_f64; LANES]);
        for (dy, (value, mask)) in (block.dy..).zip(samples[rows.clone()].iter().zip(&window.mask[rows])) {
            let dy = f64::from(dy);
            for lane in 0..LANES {
                let value = f64::from(value.0[lane] * mask.0[lane]);
                levels[lane] += value;
                down[lane] += value * dy;
                energy[lane] += value * value;
            }
        }
        for lane in 0..LANES {
            sums.levels += levels[lane];
            sums.first_moments[0] += levels[lane] * f64::from(block.dx + lane as i32);
            sums.first_moments[1] += down[lane];
            sums.energy += energy[lane];
        }
    }
    sums
}
