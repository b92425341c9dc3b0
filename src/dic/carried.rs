//! Subsets whose motion is known beforehand: one look at the target for all of them.
//!
//! Where a body's motion was just measured as a whole, what is left to find for a subset is some hundredths of
//! a pixel, and one step of the refinement finds it. Subsets overlap several times over and all begin from the
//! same motion, so the target is interpolated once, as it would look had it not moved, and the sums of every
//! subset are taken off that picture. A subset that turns out to be farther off is refined as any other.
//!
//! Gradients of fourth order read a few per cent low, so a step is that much too long; further steps would take it
//! back. By how much the texture itself says: its gradients of eighth order read right.

use super::GridPoint;
use super::lanes::{LANES, Lanes};
use super::matcher::{Matcher, Solution};
use super::moments::{Layers, Moments};
use super::plane::Plane;
use super::prepared::Prepared;
use super::refine::Match;
use super::sample::sample_lanes;
use super::sigma::{Lags, Part, Pool};
use super::spline::Splined;
use super::subset::Subset;
use super::vector::{Vector, vectorized};
use super::warp::Warp;
use super::window::Window;

/// A first step this short leaves less than a thousandth of a pixel, px.
const NEAR_PX: f64 = 0.03;

/// Largest gradient of a motion for which the target is drawn; what turns more is refined subset by subset.
const GENTLE: f64 = 0.12;

/// Gradients of fourth order read no less than this of those of eighth, in a texture that can be followed.
const LEAST_SHARE: f64 = 0.75;

/// From one row to the next of those whose gradients say how long a step should be.
const ROW_STEP: usize = 3;

/// The target of one pair, carried back by a motion.
#[derive(Default)]
pub(super) struct Carried {
    /// In the reference's place.
    plane: Plane,
    /// First and last column that subsets need of each row of the reference; the first is larger where there are none.
    spans: Vec<(i32, i32)>,
    /// By subset: the warp to begin with, where the target is drawn for it.
    starts: Vec<Option<Warp>>,
    /// By subset: how it fits, where it was found by one look.
    fits: Vec<Option<Fit>>,
    subset: Subset,
    /// Where each row of a window lies in the planes.
    places: Vec<usize>,
    /// The part of a step that is right.
    share: f64,
}

/// Mean levels of the reference and of the target in a subset, and the target's gain.
#[derive(Debug, Clone, Copy)]
struct Fit {
    means: (f32, f32),
    gain: f32,
}

impl Carried {
    /// Draws the target where the subsets should be that `starts` has warps for, all of one motion of rigid bodies.
    pub(super) fn draw(
        &mut self,
        (reference, target): (&Prepared, &Prepared),
        points: &[GridPoint],
        window: &Window,
        starts: impl Iterator<Item = Option<Warp>>,
    ) {
        let (width, height) = (reference.levels.width(), reference.levels.height());
        let holds = |at: (i32, i32)| window.extent.fits((at.0 as isize, at.1 as isize), (width, height));
        self.starts.clear();
        self.starts.extend(points.iter().zip(starts).map(|(point, warp)| {
            let (at, to) = (reference.local((point.x, point.y)), target.local((point.x, point.y)));
            let is_sane = |warp: &Warp| warp.is_within(GENTLE) && window.stays(warp, to, (target.splined.width(), target.splined.height()));
            warp.filter(|warp| is_sane(warp) && holds(at) && !saturated(reference, window, at))
        }));
        self.fits.clear();
        self.fits.resize(points.len(), None);
        self.plane.reshape(width, height);
        self.spans.clear();
        self.spans.resize(height, (i32::MAX, i32::MIN));
        let mut corner = None;
        for (point, warp) in points.iter().zip(&self.starts) {
            let Some(warp) = warp else { continue };
            let (x, y) = reference.local((point.x, point.y));
            let extent = window.extent;
            for (left, right) in &mut self.spans[(y + extent.top) as usize..=(y + extent.bottom) as usize] {
                (*left, *right) = ((*left).min(x + extent.left), (*right).max(x + extent.right));
            }
            // Where the first pixel of the reference's part goes.
            let (from_x, from_y) = target.local((point.x, point.y));
            let (dx, dy) = warp.apply(-f64::from(x), -f64::from(y));
            corner.get_or_insert(((f64::from(from_x) + dx, f64::from(from_y) + dy), *warp));
        }
        if let Some((corner, warp)) = corner {
            draw_rows(&target.splined, &self.spans, (corner, &warp), &mut self.plane);
            self.share = share(reference, &self.spans);
        }
    }

    /// The subset, if it is where the motion says: as if refined to the end.
    pub(super) fn solve(&mut self, matcher: &Matcher<'_>, index: usize) -> Option<Solution> {
        let warp = (*self.starts.get(index)?)?;
        let (reference, window) = (matcher.reference, matcher.window);
        let layers = Layers {
            reference: &reference.levels,
            gradient_x: &reference.gradient_x,
            gradient_y: &reference.gradient_y,
            target: &self.plane,
        };
        let moments = Moments::of(layers, window, reference.local(matcher.at));
        self.subset.take(&moments, window.pixels, matcher.params.refined_shape()).ok()?;
        let matcher = Matcher { subset: &self.subset, ..*matcher };
        let (step, zncc, gained) = matcher.refiner().step_of(moments.sums(window.pixels)).ok()?;
        let is_near = step.length(f64::from(window.half)) <= NEAR_PX;
        let found = Match {
            warp: warp.after_inverse(&step.scaled(self.share))?,
            second: [[0.0; 3]; 2],
            zncc: (zncc + gained).min(1.0),
            iterations: 1,
        };
        if !is_near || found.zncc < matcher.params.min_zncc {
            return None;
        }
        let pixels = window.pixels as f64;
        let means = ((moments.reference / pixels) as f32, (moments.target / pixels) as f32);
        let energy = moments.products[1] - moments.target * moments.target / pixels;
        self.fits[index] = Some(Fit { means, gain: (self.subset.energy / energy).sqrt() as f32 });
        Some(matcher.judge(found, None))
    }

    /// Whether the subset was found by one look.
    pub(super) fn found(&self, index: usize) -> bool {
        self.fits.get(index).is_some_and(Option::is_some)
    }

    /// Adds how the residual of a subset found by one look correlates from pixel to pixel.
    pub(super) fn pool(&mut self, matcher: &Matcher<'_>, index: usize, pairs: &Lags, pool: &mut Pool) {
        let Some(Fit { means, gain }) = self.fits[index] else { return };
        let (reference, window) = (matcher.reference, matcher.window);
        let (x, y) = reference.local(matcher.at);
        let stride = reference.levels.stride();
        self.places.clear();
        for block in &window.blocks {
            let first = reference.levels.index((x + block.dx) as isize, (y + block.dy) as isize);
            self.places.extend((0..block.rows).map(|row| first + row * stride));
        }
        let masked = |values: &[f32], row: usize| load(values, self.places[row]) * window.mask[row];
        pool.add_pairs(pairs);
        pool.add_part(Part::GradientX, window, |row| masked(reference.gradient_x.data(), row));
        pool.add_part(Part::GradientY, window, |row| masked(reference.gradient_y.data(), row));
        let (mean, target_mean, gain) = (Lanes::splat(means.0), Lanes::splat(means.1), Lanes::splat(gain));
        let (levels, target) = (reference.levels.data(), self.plane.data());
        pool.add_part(Part::Residual, window, |row| {
            let (level, value) = (load(levels, self.places[row]), load(target, self.places[row]));
            ((level - mean) - gain * (value - target_mean)) * window.mask[row]
        });
    }
}

/// Eight neighbouring values.
fn load(values: &[f32], first: usize) -> Lanes {
    let mut lanes = Lanes::splat(0.0);
    lanes.0.copy_from_slice(&values[first..first + LANES]);
    lanes
}

/// Whether a subset may be saturated; which of them are is told when it is taken out.
fn saturated(reference: &Prepared, window: &Window, (x, y): (i32, i32)) -> bool {
    if !reference.saturation.is_finite() {
        return false;
    }
    let limit = reference.saturation - 0.5;
    let extent = window.extent;
    let (left, right) = ((x + extent.left) as usize, (x + extent.right) as usize);
    let count = |row: i32| reference.levels.row(row as usize)[left..=right].iter().filter(|v| **v >= limit).count();
    let over: usize = (y + extent.top..=y + extent.bottom).map(count).sum();
    2 * over > window.pixels
}

/// The part of a step that is right: gradients of fourth order over those of eighth.
fn share(reference: &Prepared, spans: &[(i32, i32)]) -> f64 {
    let mut sums = [0.0; 2];
    for (y, (left, right)) in spans.iter().enumerate().step_by(ROW_STEP).filter(|(_, span)| span.0 <= span.1) {
        let first = reference.levels.index(*left as isize, y as isize);
        let row = add_gradients(reference, first, (right - left + 1) as usize);
        sums = [sums[0] + row[0], sums[1] + row[1]];
    }
    let share = sums[0] / sums[1];
    // Without texture there is no share; nothing is found there anyway.
    if (LEAST_SHARE..=1.0).contains(&share) { share } else { 1.0 }
}

vectorized! {
    /// Sums of squares of the gradients of a row, and of their products with gradients of eighth order.
    fn add_gradients(reference: &Prepared, first: usize, count: usize) -> [f64; 2] = add_gradients_with
}

#[inline(always)]
fn add_gradients_with<V: Vector>(reference: &Prepared, first: usize, count: usize) -> [f64; 2] {
    // B. Fornberg, Math. Comput. 51 (1988) 699, <https://doi.org/10.1090/S0025-5718-1988-0935077-0>, table 1.
    const EIGHTH: [f32; 4] = [4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0];
    let (levels, stride) = (reference.levels.data(), reference.levels.stride());
    let mut sums = [V::splat(0.0); 2];
    // Whole vectors only: a few pixels at the end of a row do not matter.
    for x in (first..first + count / LANES * LANES).step_by(LANES) {
        for (gradient, step) in [(&reference.gradient_x, 1), (&reference.gradient_y, stride)] {
            let mut eighth = V::splat(0.0);
            for (k, weight) in (1..).zip(EIGHTH) {
                let difference = V::load(&levels[x + k * step..]).sub(V::load(&levels[x - k * step..]));
                eighth = eighth.add(difference.mul(V::splat(weight)));
            }
            let fourth = V::load(&gradient.data()[x..]);
            sums = [sums[0].add(fourth.mul(fourth)), sums[1].add(fourth.mul(eighth))];
        }
    }
    [sums[0].to_lanes().sum(), sums[1].to_lanes().sum()]
}

vectorized! {
    /// Draws the rows of a target that a warp, the same everywhere, carries to `corner` and on.
    fn draw_rows(target: &Splined, spans: &[(i32, i32)], motion: ((f64, f64), &Warp), out: &mut Plane) = draw_rows_with
}

#[inline(always)]
fn draw_rows_with<V: Vector>(
    target: &Splined,
    spans: &[(i32, i32)],
    (corner, warp): ((f64, f64), &Warp),
    out: &mut Plane,
) {
    for (y, (left, right)) in spans.iter().enumerate().filter(|(_, span)| span.0 <= span.1) {
        let first = out.index(*left as isize, y as isize);
        let row = &mut out.data_mut()[first..];
        for x in (0..=right - left).step_by(LANES) {
            let (dx, dy) = (f64::from(left + x), y as f64);
            let place = (corner.0 + dx + warp.ux * dx + warp.uy * dy, corner.1 + dy + warp.vx * dx + warp.vy * dy);
            let values = match target.tap_count() {
                4 => sample_lanes::<V, 4, 5>(target, place, warp.ux, warp.vx),
                _ => sample_lanes::<V, 6, 7>(target, place, warp.ux, warp.vx),
            };
            values.store(&mut row[x as usize..]);
        }
    }
}
