//! The close fit of an edge: from its fit in an earlier frame, at a predicted position.
//!
//! The estimates are those of [`fit_step_edge`](super::edge_fit::fit_step_edge), which starts from scratch. Here they start
//! from the paints, the blur and the slope of the earlier frame, and need few steps. Where these do not hold, there is no
//! close fit.

use super::clear_levels::{ClearPixels, update_paint};
use super::edge_fit::{Edge, FittedEdge, ObservedPaints, PAINT_TOLERANCE, paint_margin_px};
use super::edge_model::{CoreLevels, CoreSums, EdgeModel, Effort, ProfileFit, Vector};
use super::profiles::{Direction, ExpectedEdge, MIN_DEPTH_PX, MIN_PROFILES};
use crate::image::ImageView;
use crate::numeric::normal;
use multiversion::multiversion;
use nalgebra::SMatrix;

/// The number of levels per profile, from [`LEVELS_BEFORE`] before the edge on.
const LANES: usize = 8;
/// The number of levels before the expected edge.
const LEVELS_BEFORE: f64 = 3.0;
/// The distance of the outermost levels from the expected edge, px.
const SPAN_PX: f64 = 3.0;
/// The residual from which a profile contains something else, as a fraction of the contrast, and the fit of each round.
const ROUNDS: [(f64, Effort); 3] = [(0.12, Effort::Step), (0.06, Effort::Step), (0.05, Effort::Close)];
/// The significance of an increased variance of the levels, in its standard deviations.
const VARIANCE_SIGMAS: f64 = 5.0;
/// The number of sums per lane.
const SUMS: usize = 22;

type Lane = [f64; LANES];

/// The grey levels near the edge at one place along it.
#[derive(Clone, Copy)]
struct CloseProfile {
    /// The coordinate along the edge, from its middle.
    along: f64,
    /// The coordinate of the first level across.
    first: f64,
    levels: [f32; LANES],
}

/// The levels near the edge, with the weight of each profile.
struct CloseLevels {
    profiles: Vec<CloseProfile>,
    weights: Vec<f64>,
}

/// The model and its derivatives at the levels of a profile; zero out of reach.
struct Derivatives {
    residual: Lane,
    by_place: Lane,
    by_blur: Lane,
    by_before: Lane,
    by_behind: Lane,
    is_near: Lane,
}

/// Fits the edge at its expected position from its fit in an earlier frame.
///
/// `None` if it is not there, if its paints or its noise have changed, or if it leaves the allowed range.
pub(super) fn fit_close_edge(image: ImageView<'_>, expected: &ExpectedEdge<'_>, before: &FittedEdge) -> Option<Edge> {
    let mut levels = CloseLevels::read(image, expected, before.slope)?;
    let mut model = EdgeModel {
        at: expected.near,
        slope: before.slope,
        blur: expected.clean.map_or(before.blur_px, |clean| clean.blur_px),
        is_blur_known: expected.clean.is_some(),
        is_shaded: false,
        paints: before.paints.paints,
        moved: [0.0; 2],
    };
    let observed = update_paints(image, expected, &model, &before.paints)?;
    let paints = observed.corrected(expected.clean);
    for (outlier_fraction, effort) in ROUNDS {
        model.paints = paints;
        model.reweigh(&mut levels, outlier_fraction).ok()?;
        model = model.solve(&levels, effort).ok()?;
    }
    let placed = model.place(&levels, 0.0).ok()?;
    let is_same = (model.contrast() / before.contrast_dn - 1.0).abs() <= PAINT_TOLERANCE
        && placed.variance_dn2 <= before.variance_dn2 * max_variance_ratio(levels.count(&model));
    let is_near = levels.reaches(&model, expected.near, before.slope);
    let fitted = FittedEdge { slope: model.slope, blur_px: model.blur, paints: observed, ..*before };
    (is_same && is_near).then(|| Edge::new(&placed, &model, Some(fitted)))
}

/// Returns the ratio of two variances of this many levels that noise does not exceed.
fn max_variance_ratio(count: f64) -> f64 {
    // The variance of n normal numbers has the relative variance 2 / n.
    1.0 + VARIANCE_SIGMAS * (4.0 / count.max(1.0)).sqrt()
}

/// Returns the paints in this frame, from those in an earlier one.
fn update_paints(
    image: ImageView<'_>,
    expected: &ExpectedEdge<'_>,
    model: &EdgeModel,
    before: &ObservedPaints,
) -> Option<ObservedPaints> {
    let margin = paint_margin_px(model);
    let mut observed = *before;
    for side in 0..2 {
        let depth = expected.depth[side] as f64;
        let range = if side == 0 { [-depth, -margin] } else { [margin, depth] };
        let pixels = clear_pixels(expected, model, range)?;
        let outward = before.outward(side);
        observed.paints[side] = update_paint(image, &pixels, &before.paints[side], before.tolerance_dn, outward)?;
    }
    Some(observed)
}

/// Returns the pixels at distances in this range behind the edge, px.
fn clear_pixels(expected: &ExpectedEdge<'_>, model: &EdgeModel, range: [f64; 2]) -> Option<ClearPixels> {
    let [from, to] = expected.along;
    let ends = [from as f64 - expected.middle, to as f64 - 1.0 - expected.middle];
    let [first, last] = expected.room.map(|place| place as f64);
    let across = ends.map(|end| model.at + model.slope * end);
    let start = (across[0].min(across[1]) + range[0]).ceil().max(first);
    let end = (across[0].max(across[1]) + range[1]).floor().min(last);
    if end < start {
        return None;
    }
    let across = [start as usize, end as usize + 1];
    let behind = start - model.at - model.slope * ends[0];
    Some(match expected.direction {
        Direction::Rows => ClearPixels {
            columns: expected.along,
            rows: across,
            along: [ends[0], 1.0, 0.0],
            behind: [behind, -model.slope, 1.0],
            range,
        },
        Direction::Columns => ClearPixels {
            columns: across,
            rows: expected.along,
            along: [ends[0], 0.0, 1.0],
            behind: [behind, 1.0, -model.slope],
            range,
        },
    })
}

impl CloseLevels {
    /// Reads the levels near the expected edge, without profiles that leave the allowed range.
    ///
    /// `None` if at most half of them, or fewer than five, stay in it.
    fn read(image: ImageView<'_>, expected: &ExpectedEdge<'_>, slope: f64) -> Option<Self> {
        let [first, last] = expected.room.map(|place| place as f64);
        let profile_at = |along: usize| {
            let from_middle = along as f64 - expected.middle;
            let edge = expected.near + slope * from_middle;
            let center = edge.round();
            if !(center - MIN_DEPTH_PX >= first && center + MIN_DEPTH_PX <= last) {
                return None;
            }
            let start = edge.floor() - LEVELS_BEFORE;
            let mut levels = [0.0; LANES];
            match expected.direction {
                Direction::Rows => {
                    for (level, y) in levels.iter_mut().zip(start as usize..) {
                        *level = image.at(along, y)?;
                    }
                }
                Direction::Columns => {
                    levels.copy_from_slice(image.row(along).get(start as usize..start as usize + LANES)?);
                }
            }
            Some(CloseProfile { along: from_middle, first: start, levels })
        };
        let all = expected.along[1].saturating_sub(expected.along[0]);
        let profiles: Vec<CloseProfile> = (expected.along[0]..expected.along[1]).filter_map(profile_at).collect();
        let weights = vec![1.0; profiles.len()];
        (2 * profiles.len() > all && profiles.len() >= MIN_PROFILES).then_some(Self { profiles, weights })
    }

    /// Whether all levels that place the edge of the model were read, at `near` px and with this slope.
    fn reaches(&self, model: &EdgeModel, near: f64, slope: f64) -> bool {
        let ends = [self.profiles.first(), self.profiles.last()];
        ends.into_iter().flatten().all(|profile| {
            let moved = model.at - near + (model.slope - slope) * profile.along;
            moved.abs() + model.reach_px() <= SPAN_PX
        })
    }

    /// Returns the weighted number of levels that place the edge.
    fn count(&self, model: &EdgeModel) -> f64 {
        let weights = self.weights.iter().sum::<f64>();
        2.0 * model.reach_px() * weights
    }
}

impl CoreLevels for CloseLevels {
    fn sums(&self, model: &EdgeModel) -> CoreSums {
        sum_profiles(&self.profiles, &self.weights, model)
    }

    fn profile_fits(&self, model: &EdgeModel) -> Vec<ProfileFit> {
        let mut fits = Vec::with_capacity(self.profiles.len());
        fit_profiles(&self.profiles, model, &mut fits);
        fits
    }

    fn weights(&self) -> Vec<f64> {
        self.weights.clone()
    }

    fn set_weights(&mut self, weights: &[f64]) {
        self.weights.copy_from_slice(weights);
    }

    fn highest_dn(&self) -> f64 {
        f64::from(self.profiles.iter().flat_map(|profile| profile.levels).fold(0.0, f32::max))
    }
}

impl Derivatives {
    /// Evaluates the model at the levels of a profile.
    #[inline(always)]
    fn at(profile: &CloseProfile, model: &EdgeModel) -> Self {
        let reach = model.reach_px();
        let [before, after] = model.paints.map(|paint| paint.level_at_edge(profile.along));
        let step = after - before;
        let start = profile.first - model.at - model.slope * profile.along;
        let per_blur = 1.0 / model.blur;
        let (mut p, mut density) = ([0.0_f32; LANES], [0.0_f32; LANES]);
        let mut behind = [0.0; LANES];
        for i in 0..LANES {
            behind[i] = start + i as f64;
        }
        for i in 0..LANES {
            (p[i], density[i]) = normal((behind[i] * per_blur) as f32);
        }
        let zero = [0.0; LANES];
        let mut all =
            Self { residual: zero, by_place: zero, by_blur: zero, by_before: zero, by_behind: zero, is_near: zero };
        for i in 0..LANES {
            let near = if behind[i].abs() <= reach { 1.0 } else { 0.0 };
            let p = f64::from(p[i]);
            let by_place = -step * f64::from(density[i]) * per_blur * near;
            all.residual[i] = (f64::from(profile.levels[i]) - before - step * p) * near;
            all.by_place[i] = by_place;
            all.by_blur[i] = by_place * behind[i] * per_blur;
            all.by_before[i] = (1.0 - p) * near;
            all.by_behind[i] = p * near;
            all.is_near[i] = near;
        }
        all
    }
}

/// Sums the normal equations over all profiles.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn sum_profiles(profiles: &[CloseProfile], weights: &[f64], model: &EdgeModel) -> CoreSums {
    let mut sums = [[0.0; LANES]; SUMS];
    for (profile, weight) in profiles.iter().zip(weights) {
        if *weight <= 0.0 {
            continue;
        }
        let Derivatives { residual, by_place, by_blur, by_before, by_behind, is_near } =
            Derivatives::at(profile, model);
        let along = profile.along;
        for i in 0..LANES {
            let (place, blur) = (weight * by_place[i], weight * by_blur[i]);
            let (before, behind) = (weight * by_before[i], weight * by_behind[i]);
            let slope = along * place;
            let terms = [
                place * by_place[i],
                slope * by_place[i],
                along * slope * by_place[i],
                place * by_blur[i],
                slope * by_blur[i],
                place * by_before[i],
                slope * by_before[i],
                place * by_behind[i],
                slope * by_behind[i],
                blur * by_blur[i],
                blur * by_before[i],
                blur * by_behind[i],
                before * by_before[i],
                before * by_behind[i],
                behind * by_behind[i],
                place * residual[i],
                slope * residual[i],
                blur * residual[i],
                before * residual[i],
                behind * residual[i],
                weight * residual[i] * residual[i],
                weight * is_near[i],
            ];
            for (sum, term) in sums.iter_mut().zip(terms) {
                sum[i] += term;
            }
        }
    }
    let [pp, ps, ss, pb, sb, pl, sl, pr, sr, bb, bl, br, ll, lr, rr, p, s, b, l, r, squares, count] =
        sums.map(|lane| lane.iter().sum::<f64>());
    CoreSums {
        normal: SMatrix::from([
            [pp, ps, pb, pl, pr],
            [ps, ss, sb, sl, sr],
            [pb, sb, bb, bl, br],
            [pl, sl, bl, ll, lr],
            [pr, sr, br, lr, rr],
        ]),
        right: Vector::from([p, s, b, l, r]),
        squares,
        count,
    }
}

/// Appends the fit of each profile.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn fit_profiles(profiles: &[CloseProfile], model: &EdgeModel, fits: &mut Vec<ProfileFit>) {
    for profile in profiles {
        let Derivatives { residual, by_place, .. } = Derivatives::at(profile, model);
        let (mut right, mut squares, mut sizes) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            right[i] = residual[i] * by_place[i];
            squares[i] = by_place[i] * by_place[i];
            sizes[i] = residual[i].abs();
        }
        let (right, information) = (fold(right, |a, b| a + b), fold(squares, |a, b| a + b));
        let residual_dn = fold(sizes, f64::max);
        fits.push(ProfileFit { shift_px: right / information.max(1e-9), information, residual_dn, trust: 1.0 });
    }
}

/// Combines eight values in pairs, which takes three steps instead of seven.
#[inline(always)]
fn fold(lane: Lane, combine: impl Fn(f64, f64) -> f64) -> f64 {
    let [a, b, c, d, e, f, g, h] = lane;
    combine(combine(combine(a, e), combine(c, g)), combine(combine(b, f), combine(d, h)))
}

#[cfg(test)]
mod tests;
