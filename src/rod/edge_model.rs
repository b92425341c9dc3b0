//! The model of an edge, a step blurred by a Gaussian, and its sums over the levels near it.

use super::level_grid::{Block, EdgeLine, LANES, Lane, LevelGrid, sum_lanes};
use super::paint_levels::Paint;
use crate::numeric::normal;
use multiversion::multiversion;
use nalgebra::{SMatrix, SVector};

/// The reach of the levels that place the edge: in px, and in standard deviations of the blur.
const CORE_PX: f64 = 2.0;
const CORE_SIGMAS: f64 = 2.2;
/// The relative weight that fixes a known parameter.
const FIXED_WEIGHT: f64 = 1e9;

pub(super) type Vector = SVector<f64, 5>;
pub(super) type Matrix = SMatrix<f64, 5, 5>;

/// The iterated parameters: position, slope, blur and both paints.
#[derive(Clone, Copy)]
pub(super) struct EdgeModel {
    /// The position at the middle, px.
    pub(super) at: f64,
    pub(super) slope: f64,
    pub(super) blur: f64,
    pub(super) is_blur_known: bool,
    /// Whether the light varies along the edge, so that the profiles were scaled.
    pub(super) is_shaded: bool,
    pub(super) paints: [Paint; 2],
    /// The change of the paints by the levels near the edge, DN.
    pub(super) moved: [f64; 2],
}

/// The sums over the levels of each profile that place the edge: products of the derivatives by place, blur and the levels
/// before and behind the edge, and of these with the residual.
#[derive(Clone, Copy, Default)]
struct LaneSums {
    place_place: Lane,
    place_blur: Lane,
    place_before: Lane,
    place_behind: Lane,
    blur_blur: Lane,
    blur_before: Lane,
    blur_behind: Lane,
    before_before: Lane,
    before_behind: Lane,
    behind_behind: Lane,
    place: Lane,
    blur: Lane,
    before: Lane,
    behind: Lane,
    squares: Lane,
    count: Lane,
    /// The largest residual, DN.
    worst: Lane,
}

/// The weighted sums over all profiles. Those by the slope are those by the place, times the position along the edge.
#[derive(Clone, Copy, Default)]
struct WeightedSums {
    place_place: Lane,
    place_slope: Lane,
    slope_slope: Lane,
    place_blur: Lane,
    slope_blur: Lane,
    place_before: Lane,
    slope_before: Lane,
    place_behind: Lane,
    slope_behind: Lane,
    blur_blur: Lane,
    blur_before: Lane,
    blur_behind: Lane,
    before_before: Lane,
    before_behind: Lane,
    behind_behind: Lane,
    place: Lane,
    slope: Lane,
    blur: Lane,
    before: Lane,
    behind: Lane,
    squares: Lane,
    count: Lane,
}

/// The model at the levels from some row of a grid on.
#[derive(Clone, Copy)]
struct RowModel {
    /// The position of the edge at the middle from the first summed row, px.
    at: f64,
    slope: f64,
    /// The first summed row.
    first: f32,
    reach: f32,
    per_blur: f32,
    /// The coefficients of the level before the edge, and of the step to that behind it: 1, along and along squared.
    before: [f64; 3],
    step: [f64; 3],
}

/// The fit of one profile alone.
#[derive(Debug, Clone, Copy)]
pub(super) struct ProfileFit {
    /// The distance of the edge behind the common one, px, by one Gauss-Newton step.
    pub(super) shift_px: f64,
    /// The inverse of its variance, for residuals of 1 DN.
    pub(super) information: f64,
    /// The largest residual, DN.
    pub(super) worst_dn: f64,
}

/// The normal equations at a model. The unknowns are position, slope, blur, and the levels before and behind the edge,
/// which their paint constrains.
pub(super) struct NormalEquations {
    pub(super) normal: Matrix,
    pub(super) right: Vector,
    /// The weighted sum of squared residuals, DN^2, and the weighted number of levels.
    pub(super) squares: f64,
    pub(super) count: f64,
}

/// The sums of all profiles at a model.
pub(super) struct CoreSums<'a> {
    pub(super) grid: &'a LevelGrid,
    blocks: Vec<LaneSums>,
}

impl EdgeModel {
    /// Returns the level behind the edge minus that before it, at its middle, DN.
    pub(super) fn contrast(&self) -> f64 {
        self.paints[1].level_at_edge(0.0) - self.paints[0].level_at_edge(0.0)
    }

    /// Returns the noise of a level near the edge, DN: the larger one of both sides.
    pub(super) fn noise(&self) -> f64 {
        self.paints[0].noise.max(self.paints[1].noise)
    }

    /// Returns the middle of the step.
    pub(super) fn line(&self) -> EdgeLine {
        EdgeLine { at: self.at, slope: self.slope }
    }

    /// Returns the weight of the paint of a side (0 before, 1 behind) relative to one level near the edge: the ratio of
    /// their variances.
    pub(super) fn paint_weight(&self, side: usize) -> f64 {
        (self.noise() / self.paints[side].sigma).powi(2)
    }

    /// Sums the levels of each profile that place the edge: those near it.
    pub(super) fn sums<'a>(&self, grid: &'a LevelGrid) -> CoreSums<'a> {
        let reach = CORE_PX.max(CORE_SIGMAS * self.blur);
        let [before, behind] = self.paints.map(|Paint { coefficients: [c, b, a, _], .. }| [c, b, a]);
        let row = |across: f64| (across - grid.first as f64).clamp(0.0, grid.rows as f64 - 1.0) as usize;
        let mut blocks = vec![LaneSums::default(); grid.blocks.len()];
        for ((index, block), sums) in grid.blocks.iter().enumerate().zip(&mut blocks) {
            let [low, high] = block.ends.map(|along| self.at + self.slope * along);
            let [from, to] = [row((low.min(high) - reach).ceil()), row((low.max(high) + reach).floor())];
            let model = RowModel {
                at: self.at - (grid.first + from) as f64,
                slope: self.slope,
                first: from as f32,
                reach: reach as f32,
                per_blur: (1.0 / self.blur) as f32,
                before,
                step: std::array::from_fn(|k| behind[k] - before[k]),
            };
            sum_block(&grid.rows_of(index)[from..=to], block, model, sums);
        }
        CoreSums { grid, blocks }
    }
}

impl CoreSums<'_> {
    /// Returns the fit of each profile alone.
    pub(super) fn profile_fits(&self) -> Vec<ProfileFit> {
        let fit = |index: usize| {
            let (block, lane) = (&self.blocks[index / LANES], index % LANES);
            let information = f64::from(block.place_place[lane]);
            ProfileFit {
                shift_px: f64::from(block.place[lane]) / information.max(1e-9),
                information,
                worst_dn: f64::from(block.worst[lane]),
            }
        };
        (0..self.grid.profiles.len()).map(fit).collect()
    }

    /// Returns the number of profiles without a residual above a limit, DN.
    pub(super) fn count_within(&self, limit_dn: f64) -> usize {
        self.profile_fits().iter().filter(|fit| fit.worst_dn <= limit_dn).count()
    }

    /// Returns the normal equations for these weights of the profiles, with the constraints of a model.
    pub(super) fn normal_equations(&self, weights: &[f64], model: &EdgeModel) -> NormalEquations {
        let mut sums = WeightedSums::default();
        for ((sums_of, block), weights) in self.blocks.iter().zip(&self.grid.blocks).zip(weights.chunks(LANES)) {
            let mut weight = [0.0; LANES];
            weight.iter_mut().zip(weights).for_each(|(lane, weight)| *lane = *weight as f32);
            add_block(&mut sums, sums_of, &block.along, &weight);
        }
        sums.normal_equations(model)
    }
}

impl WeightedSums {
    /// Returns the normal equations with the constraints of a model.
    fn normal_equations(&self, model: &EdgeModel) -> NormalEquations {
        let rows: [[&Lane; 5]; 5] = [
            [&self.place_place, &self.place_slope, &self.place_blur, &self.place_before, &self.place_behind],
            [&self.place_slope, &self.slope_slope, &self.slope_blur, &self.slope_before, &self.slope_behind],
            [&self.place_blur, &self.slope_blur, &self.blur_blur, &self.blur_before, &self.blur_behind],
            [&self.place_before, &self.slope_before, &self.blur_before, &self.before_before, &self.before_behind],
            [&self.place_behind, &self.slope_behind, &self.blur_behind, &self.before_behind, &self.behind_behind],
        ];
        let total = |lane: &Lane| f64::from(sum_lanes(lane));
        let mut normal = SMatrix::from(rows.map(|row| row.map(total)));
        for side in 0..2 {
            normal[(3 + side, 3 + side)] += model.paint_weight(side);
        }
        if model.is_blur_known {
            normal[(2, 2)] += FIXED_WEIGHT * normal[(0, 0)];
        }
        let right = Vector::from([&self.place, &self.slope, &self.blur, &self.before, &self.behind].map(total));
        NormalEquations { normal, right, squares: total(&self.squares), count: total(&self.count) }
    }
}

/// Sums over the rows of a block.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn sum_block(rows: &[Lane], block: &Block, model: RowModel, sums: &mut LaneSums) {
    let RowModel { at, slope, first, reach, per_blur, before: [c, b, a], step: [step_c, step_b, step_a] } = model;
    let (mut start, mut before, mut step) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        let along = block.along[i];
        start[i] = -(at + slope * along) as f32;
        before[i] = (c + along * (b + along * a)) as f32;
        step[i] = (step_c + along * (step_b + along * step_a)) as f32;
    }
    let (from, to) = (&block.from, &block.to);
    for (index, levels) in rows.iter().enumerate() {
        let row = index as f32;
        // One loop with all sums, which becomes vector instructions.
        for i in 0..LANES {
            let behind_px = start[i] + row;
            let is_near = (behind_px.abs() <= reach) & (first + row >= from[i]) & (first + row <= to[i]);
            let near = if is_near { 1.0 } else { 0.0 };
            let t = behind_px * per_blur;
            let (p, density) = normal(t);
            let place = -step[i] * density * per_blur * near;
            let blur = place * t;
            let (ahead, behind) = ((1.0 - p) * near, p * near);
            let residual = (levels[i] - before[i] - step[i] * p) * near;
            sums.place_place[i] += place * place;
            sums.place_blur[i] += place * blur;
            sums.place_before[i] += place * ahead;
            sums.place_behind[i] += place * behind;
            sums.blur_blur[i] += blur * blur;
            sums.blur_before[i] += blur * ahead;
            sums.blur_behind[i] += blur * behind;
            sums.before_before[i] += ahead * ahead;
            sums.before_behind[i] += ahead * behind;
            sums.behind_behind[i] += behind * behind;
            sums.place[i] += place * residual;
            sums.blur[i] += blur * residual;
            sums.before[i] += ahead * residual;
            sums.behind[i] += behind * residual;
            sums.squares[i] += residual * residual;
            sums.count[i] += near;
            let size = residual.abs();
            sums.worst[i] = if size > sums.worst[i] { size } else { sums.worst[i] };
        }
    }
}

/// Adds the weighted sums of the profiles of a block.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn add_block(sums: &mut WeightedSums, block: &LaneSums, along: &[f64; LANES], weight: &Lane) {
    for i in 0..LANES {
        let (w, x) = (weight[i], along[i] as f32);
        let (place_place, place_blur) = (w * block.place_place[i], w * block.place_blur[i]);
        let (place_before, place_behind) = (w * block.place_before[i], w * block.place_behind[i]);
        let place = w * block.place[i];
        sums.place_place[i] += place_place;
        sums.place_slope[i] += x * place_place;
        sums.slope_slope[i] += x * x * place_place;
        sums.place_blur[i] += place_blur;
        sums.slope_blur[i] += x * place_blur;
        sums.place_before[i] += place_before;
        sums.slope_before[i] += x * place_before;
        sums.place_behind[i] += place_behind;
        sums.slope_behind[i] += x * place_behind;
        sums.blur_blur[i] += w * block.blur_blur[i];
        sums.blur_before[i] += w * block.blur_before[i];
        sums.blur_behind[i] += w * block.blur_behind[i];
        sums.before_before[i] += w * block.before_before[i];
        sums.before_behind[i] += w * block.before_behind[i];
        sums.behind_behind[i] += w * block.behind_behind[i];
        sums.place[i] += place;
        sums.slope[i] += x * place;
        sums.blur[i] += w * block.blur[i];
        sums.before[i] += w * block.before[i];
        sums.behind[i] += w * block.behind[i];
        sums.squares[i] += w * block.squares[i];
        sums.count[i] += w * block.count[i];
    }
}
