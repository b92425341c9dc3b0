//! Sub-pixel refinement: inverse-compositional Gauss-Newton (IC-GN).
//!
//! Minimises the zero-mean normalised sum of squared differences between the
//! reference subset and the warped target. The warp is updated by the inverse
//! of a step on the *reference* side, so the Hessian is computed once a subset.
//! The gradient is of fourth order: the spline's own derivative would weight
//! the frequencies in which interpolation errs and doubles the bias.
//! B. Pan, K. Li, W. Tong, Exp. Mech. 53 (2013) 1277,
//! <https://doi.org/10.1007/s11340-013-9717-6>.

use super::Shape;
use super::lanes::Lanes;
use super::plane::Plane;
use super::sample::sample_lanes;
use super::subset::{Subset, project};
use super::warp::Warp;
use super::window::{Block, Window};

/// A step this short ends the iteration, px.
const TOLERANCE_PX: f64 = 0.002;

/// Iterations after which a subset is given up; sound ones take 3 to 6.
const MOST_ITERATIONS: u32 = 25;

/// Why a subset was not found in the target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Lost {
    /// The iteration led out of the image.
    OutOfFrame,
    /// The iteration did not settle.
    NotConverged,
}

/// Where a subset was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Match {
    /// The warp from reference to target.
    pub(super) warp: Warp,
    /// Zero-mean normalised cross-correlation there.
    pub(super) zncc: f64,
    /// Iterations taken.
    pub(super) iterations: u32,
}

/// What one pass over the warped target yields.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    levels: f64,
    energy: f64,
    product: f64,
    jacobian: [f64; 6],
}

/// One reference subset being looked for in one target.
#[derive(Clone, Copy)]
pub(super) struct Refiner<'a> {
    pub(super) subset: &'a Subset,
    pub(super) window: &'a Window,
    pub(super) shape: Shape,
    /// Spline coefficients of the target.
    pub(super) target: &'a Plane,
    /// Centre of the subset in the reference, px.
    pub(super) at: (u32, u32),
}

impl Refiner<'_> {
    /// Finds the subset in the target, from `start` on.
    pub(super) fn refine(&self, start: Warp) -> Result<Match, Lost> {
        let mut warp = start;
        let half = f64::from(self.window.half);
        for iterations in 1..=MOST_ITERATIONS {
            let (step, zncc) = self.step(&warp)?;
            let length = step.length(half);
            if length.is_nan() || length >= half {
                return Err(Lost::NotConverged);
            }
            warp = warp.after_inverse(&step).ok_or(Lost::NotConverged)?;
            if length < TOLERANCE_PX {
                return Ok(Match { warp, zncc, iterations });
            }
        }
        Err(Lost::NotConverged)
    }

    /// The step that the reference should take towards the target at `warp`, and the ZNCC there.
    fn step(&self, warp: &Warp) -> Result<(Warp, f64), Lost> {
        let subset = self.subset;
        let sums = self.pass(warp)?;
        let pixels = self.window.pixels as f64;
        let mean = sums.levels / pixels;
        let energy = sums.energy - sums.levels * mean;
        if energy.is_nan() || energy <= 1e-3 * pixels {
            return Err(Lost::NotConverged);
        }
        let zncc = (sums.product / (subset.energy * energy).sqrt()).clamp(-1.0, 1.0);
        let gain = (subset.energy / energy).sqrt();
        let affine: [f64; 6] = std::array::from_fn(|k| {
            gain * (sums.jacobian[k] - mean * subset.jacobian_sum[k]) - subset.jacobian_levels[k]
        });
        let (right, count) = project(self.shape, &affine);
        let mut step = [0.0; 6];
        for (step, line) in step.iter_mut().zip(&subset.inverse).take(count) {
            *step = line.iter().zip(&right).take(count).map(|(a, b)| a * b).sum();
        }
        Ok((Warp::from_step(self.shape, &step), zncc))
    }

    /// Whether the warped subset lies wholly in the target.
    pub(super) fn inside(&self, warp: &Warp) -> bool {
        let (reach_x, reach_y) = self.window.reach(warp);
        let (x, y) = (f64::from(self.at.0) + warp.u, f64::from(self.at.1) + warp.v);
        let (right, bottom) = (self.target.width() as f64 - 1.0, self.target.height() as f64 - 1.0);
        // Written so that NaN is outside.
        x - reach_x >= 0.0 && x + reach_x <= right && y - reach_y >= 0.0 && y + reach_y <= bottom
    }

    /// Samples the warped target once and sums it against the reference.
    fn pass(&self, warp: &Warp) -> Result<Sums, Lost> {
        if !self.inside(warp) {
            return Err(Lost::OutOfFrame);
        }
        let mut sums = Sums::default();
        for block in &self.window.blocks {
            self.add_block(&mut sums, warp, block);
        }
        Ok(sums)
    }

    /// Eight target pixels of one row of a block.
    #[inline(always)]
    fn sample(&self, warp: &Warp, dx: i32, dy: i32) -> Lanes {
        let (x, y) = warp.apply(f64::from(dx), f64::from(dy));
        sample_lanes(self.target, (f64::from(self.at.0) + x, f64::from(self.at.1) + y), warp.ux, warp.vx)
    }

    /// Adds one block of columns.
    #[inline(always)]
    fn add_block(&self, sums: &mut Sums, warp: &Warp, block: &Block) {
        let subset = self.subset;
        let zero = Lanes::splat(0.0);
        let (mut levels, mut energy, mut product) = (zero, zero, zero);
        let (mut plain, mut with_dy) = ([zero; 2], [zero; 2]);
        let mean = Lanes::splat(subset.mean);
        for row in 0..block.rows {
            let (packed, dy) = (block.start + row, block.dy + row as i32);
            let value = (self.sample(warp, block.dx, dy) - mean) * self.window.mask[packed];
            levels += value;
            energy += value * value;
            product += value * subset.levels[packed];
            let dy = Lanes::splat(dy as f32);
            for (half, gradient) in [&subset.gradient_x, &subset.gradient_y].into_iter().enumerate() {
                let term = value * gradient[packed];
                plain[half] += term;
                with_dy[half] += term * dy;
            }
        }
        sums.levels += levels.sum();
        sums.energy += energy.sum();
        sums.product += product.sum();
        for half in 0..2 {
            sums.jacobian[3 * half] += plain[half].sum();
            sums.jacobian[3 * half + 1] += plain[half].moment(f64::from(block.dx));
            sums.jacobian[3 * half + 2] += with_dy[half].sum();
        }
    }

    /// The difference reference less gain-matched target, packed like the subset;
    /// empty when the warped subset leaves the image.
    pub(super) fn residual(&self, warp: &Warp, out: &mut Vec<Lanes>) {
        out.clear();
        let Ok(sums) = self.pass(warp) else { return };
        let subset = self.subset;
        let mean = sums.levels / self.window.pixels as f64;
        let gain = (subset.energy / (sums.energy - sums.levels * mean)).sqrt();
        let mean = Lanes::splat(subset.mean + mean as f32);
        for block in &self.window.blocks {
            for row in 0..block.rows {
                let packed = block.start + row;
                let value = (self.sample(warp, block.dx, block.dy + row as i32) - mean) * self.window.mask[packed];
                out.push(subset.levels[packed] - value * Lanes::splat(gain as f32));
            }
        }
    }
}
