//! What a match leaves: reference less gain-matched target.

use multiversion::multiversion;

use super::lanes::{LANES, Lanes};
use super::light;
use super::refine::{LEAST_ENERGY, Refiner, Sums};
use super::vector::{Vector, vectorized};
use super::warp::Warp;
use super::window::Window;

impl Refiner<'_> {
    /// The difference reference less gain-matched target, packed like the subset;
    /// empty when the warped subset leaves the image.
    pub(super) fn residual(&self, warp: &Warp, out: &mut Vec<Lanes>) {
        match self.sampled(warp, out) {
            Ok(sums) => self.leave(self, sums, out),
            Err(_) => out.clear(),
        }
    }

    /// As [`Self::residual`], of `whole`, of which this is a part, by what was [sampled](Self::sampled) of it; gain, mean
    /// and light are those of the part. Empty where nothing was sampled.
    pub(super) fn residual_from(&self, whole: &Refiner<'_>, samples: &[Lanes], out: &mut Vec<Lanes>) {
        out.clear();
        out.extend_from_slice(samples);
        if samples.is_empty() {
            return;
        }
        // The samples of the whole hold those of the part, at another mean.
        self.leave(whole, part_sums(samples, self.window), out);
    }

    /// Turns samples of `whole` into what is left, if they have any contrast.
    fn leave(&self, whole: &Refiner<'_>, sums: Sums, out: &mut Vec<Lanes>) {
        let pixels = self.window.pixels as f64;
        let contrast = self.lit(&sums, sums.levels / pixels).1;
        if contrast.is_nan() || contrast <= LEAST_ENERGY * pixels {
            // What has no contrast is like nothing, and nothing says that it hides the body.
            out.clear();
            return;
        }
        self.subtract(whole, sums, out);
    }

    /// Turns samples of `whole` into its difference to the gain-matched target; gain, mean and light are those of this
    /// part, over which `sums` are.
    pub(super) fn subtract(&self, whole: &Refiner<'_>, sums: Sums, out: &mut [Lanes]) {
        let mean = sums.levels / self.window.pixels as f64;
        let (slopes, energy) = self.lit(&sums, mean);
        let gain = (self.subset.energy / energy).sqrt();
        // The means of both references are off their levels.
        let apart = f64::from(whole.subset.mean - self.subset.mean) / gain;
        let even = (Lanes::splat((mean + apart) as f32), Lanes::splat(gain as f32));
        let Some(light) = &self.subset.light else {
            subtract(&whole.subset.levels, &whole.window.mask, even, out);
            return;
        };
        let beside: [f64; 2] = std::array::from_fn(|axis| slopes[axis] - light.slopes[axis] / gain);
        for block in &whole.window.blocks {
            let rows = block.start..block.start + block.rows;
            let plane =
                Tilted { first: light::row(beside, light.middle, (block.dx, block.dy)), down: beside[1] as f32 };
            let layers = (&whole.subset.levels[rows.clone()], &whole.window.mask[rows.clone()]);
            subtract_tilted(layers, even, plane, &mut out[rows]);
        }
    }
}

vectorized! {
    /// Levels less gain (samples - mean), on the mask, in the place of the samples.
    fn subtract(levels: &[Lanes], mask: &[Lanes], mean_and_gain: (Lanes, Lanes), out: &mut [Lanes]) = subtract_with
}

#[inline(always)]
fn subtract_with<V: Vector>(levels: &[Lanes], mask: &[Lanes], (mean, gain): (Lanes, Lanes), out: &mut [Lanes]) {
    let (mean, gain) = (V::from_lanes(&mean), V::from_lanes(&gain));
    for ((level, mask), out) in levels.iter().zip(mask).zip(out) {
        let value = V::from_lanes(out).sub(mean.mul(V::from_lanes(mask)));
        *out = V::from_lanes(level).sub(value.mul(gain)).to_lanes();
    }
}

/// A plane on eight columns: in their first row, and how much it rises from row to row.
#[derive(Clone, Copy)]
struct Tilted {
    first: Lanes,
    down: f32,
}

vectorized! {
    /// As [`subtract`] of a block, with a plane beside the mean.
    fn subtract_tilted(layers: (&[Lanes], &[Lanes]), mean_and_gain: (Lanes, Lanes), plane: Tilted, out: &mut [Lanes]) =
        subtract_tilted_with
}

#[inline(always)]
fn subtract_tilted_with<V: Vector>(
    (levels, mask): (&[Lanes], &[Lanes]),
    (mean, gain): (Lanes, Lanes),
    plane: Tilted,
    out: &mut [Lanes],
) {
    let (gain, first, down) = (V::from_lanes(&gain), V::from_lanes(&(mean + plane.first)), V::splat(plane.down));
    for (row, ((level, mask), out)) in levels.iter().zip(mask).zip(out).enumerate() {
        let mean = first.plus_product(down, V::splat(row as f32));
        let value = V::from_lanes(out).sub(mean.mul(V::from_lanes(mask)));
        *out = V::from_lanes(level).sub(value.mul(gain)).to_lanes();
    }
}

/// Sums of samples on the mask of a window, without those that need its gradients.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn part_sums(samples: &[Lanes], window: &Window) -> Sums {
    let mut sums = Sums::default();
    for block in &window.blocks {
        let rows = block.start..block.start + block.rows;
        // In double precision: whether there is any contrast is told by the difference of the two.
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
            sums.places[0] += levels[lane] * f64::from(block.dx + lane as i32);
            sums.places[1] += down[lane];
            sums.energy += energy[lane];
        }
    }
    sums
}
