//! The correlator: plans once, then measures one displacement field per call.

use super::predicted::PredictedUpdate;
use super::subset_match::{Searches, SubsetMatch, SubsetMatcher};
use crate::dic::GridPoint;
use crate::dic::error::CorrelationError;
use crate::dic::field::MedianTest;
use crate::dic::geometry::{Region, Shape, SubsetMask, Warp};
use crate::dic::image::PreparedFrame;
use crate::dic::params::{CorrelationParams, Method};
use crate::dic::search::{IntegerSearch, UpsampledSearch};
use crate::dic::subset::{ReferenceSubset, Unusable};
use crate::dic::uncertainty::{GradientGain, Lags, NoisePool, POOLED, count_pairs};
use crate::image::ImageView;
use crate::numeric::Lanes;
use crate::results::{Displacement, FieldPoint, PointStatus};

/// The minimum ZNCC at which a start from a neighbour or from the previous frame is accepted.
const TRUSTED_ZNCC: f64 = 0.9;

/// The minimum fraction of its pixels that a subset must keep inside the region.
const MIN_INSIDE_FRACTION: f64 = 0.5;

/// The width of the border whose pixels are left out of a subset that extends over the image's edge, px.
///
/// Gradients are one-sided there, and a subset that moves slightly outwards still has its other pixels in the image.
const EDGE_PX: f64 = 3.0;

/// The initial guess of each subset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Start {
    /// Anywhere within `search_px`, by FFT cross-correlation.
    Search,
    /// From the result of the neighbour to the left if there is one, else as [`Self::Search`].
    ///
    /// For smooth fields: several times faster, with the same results. Points found this way have no peak ratio.
    Neighbor,
    /// Near a known rigid motion. Subsets not found there are searched for.
    Motion {
        /// The x coordinate of the point whose displacement is given, px.
        x_px: f64,
        /// The y coordinate of the point whose displacement is given, px.
        y_px: f64,
        /// The displacement of that point along x, px.
        u_px: f64,
        /// The displacement of that point along y, px.
        v_px: f64,
        /// The rotation, counter-clockwise on the screen, deg.
        angle_deg: f64,
    },
}

/// Measures displacement fields, planned for one image size and set of parameters.
///
/// [`Correlator::new`] allocates all memory. A field depends only on the arguments of [`Correlator::correlate`] and on
/// the region, never on earlier calls.
pub struct Correlator {
    params: CorrelationParams,
    width_px: usize,
    height_px: usize,
    window: SubsetMask,
    /// Memory for a window clipped by the region.
    cut: SubsetMask,
    region: Option<Region>,
    searches: Searches,
    subset: ReferenceSubset,
    solutions: Vec<SubsetMatch>,
    residual: Vec<Lanes>,
    predicted: PredictedUpdate,
    /// The pixel pairs of the whole window at each lag.
    pairs: Lags,
    pool: NoisePool,
    pooled: Vec<usize>,
    median_test: MedianTest,
}

/// A reference frame with its subsets, kept for matching against many frames.
///
/// Created by [`Correlator::keep`]. Renew it when the body has rotated by about 3 deg or the ZNCC drops.
#[derive(Debug, Clone)]
pub struct KeptReference {
    frame: PreparedFrame,
    points: Vec<GridPoint>,
    /// Each subset, with its part of the window where the region or the edge clips it.
    subsets: Vec<Result<(ReferenceSubset, Option<SubsetMask>), PointStatus>>,
}

impl KeptReference {
    /// The centres of its subsets.
    pub fn points(&self) -> &[GridPoint] {
        &self.points
    }
}

impl Correlator {
    /// Plans correlations of images of the given size.
    ///
    /// # Errors
    ///
    /// [`CorrelationError`] naming the parameter that is out of range, or if the image has no room for one subset.
    pub fn new(params: &CorrelationParams, width_px: usize, height_px: usize) -> Result<Self, CorrelationError> {
        params.check()?;
        let size = params.subset_size_px;
        if width_px < size as usize || height_px < size as usize {
            return Err(CorrelationError::SubsetLargerThanImage { subset_size_px: size, width_px, height_px });
        }
        let window = SubsetMask::new(params.window, size);
        let points = params.spline_points as usize;
        Ok(Self {
            searches: Searches {
                pixel: IntegerSearch::new(size as usize, params.search_px as usize),
                fine: (params.method == Method::SplineFft).then(|| UpsampledSearch::new(&window, points)),
                peak_fit: true,
            },
            cut: window.clone(),
            region: None,
            predicted: PredictedUpdate::default(),
            pairs: count_pairs(&window),
            window,
            params: params.clone(),
            width_px,
            height_px,
            subset: ReferenceSubset::default(),
            solutions: Vec::new(),
            residual: Vec::new(),
            pool: NoisePool::default(),
            pooled: Vec::new(),
            median_test: MedianTest::default(),
        })
    }

    /// Disables the peak fit of `spline-fft`: the result is the highest grid point.
    ///
    /// For studies of the peak fit, not for measurements.
    pub fn without_peak_fit(mut self) -> Self {
        self.searches.peak_fit = false;
        self
    }

    /// Restricts correlation to reference pixels inside `region`; `None` uses all.
    ///
    /// Subsets that extend over the edge of the region or of the image are clipped there. A subset with less than half
    /// of its pixels left is out of frame. The correlation-peak methods need whole subsets, so any clipped subset is
    /// out of frame with them.
    pub fn set_region(&mut self, region: Option<Region>) {
        self.region = region;
    }

    /// The parameters it was planned with.
    pub fn params(&self) -> &CorrelationParams {
        &self.params
    }

    /// Prepares a frame in new memory.
    ///
    /// # Panics
    ///
    /// If the size of the image differs from the plan.
    pub fn prepare(&self, image: ImageView<'_>) -> PreparedFrame {
        let mut prepared = PreparedFrame::default();
        self.prepare_into(image, &mut prepared);
        prepared
    }

    /// Prepares a frame, reusing memory; allocates only the first time.
    ///
    /// # Panics
    ///
    /// If the size of the image differs from the plan.
    pub fn prepare_into(&self, image: ImageView<'_>, prepared: &mut PreparedFrame) {
        assert_eq!(
            (image.width(), image.height()),
            (self.width_px, self.height_px),
            "the frame size differs from the plan"
        );
        prepared.fill(image, self.params.interpolation);
    }

    /// Prepares a part of a frame: x, y, width and height, clipped to the frame. See [`Self::prepare_into`].
    ///
    /// Everything beyond the edge of the part is out of frame, so leave room for the search range.
    ///
    /// # Panics
    ///
    /// If the size of the image differs from the plan.
    pub fn prepare_part_into(&self, image: ImageView<'_>, part: [u32; 4], prepared: &mut PreparedFrame) {
        assert_eq!(
            (image.width(), image.height()),
            (self.width_px, self.height_px),
            "the frame size differs from the plan"
        );
        prepared.fill_part(image, part, self.params.interpolation);
    }

    /// Measures the displacement of each subset from `reference` to `target`.
    ///
    /// `field` is cleared first and then holds one point per grid point, in the same order. A feature at x in the
    /// reference is at x + u in the target.
    ///
    /// # Panics
    ///
    /// If the size of a frame differs from the plan.
    ///
    /// # Cost
    ///
    /// No allocation once `field` and the internal memory have grown to the number of points.
    pub fn correlate(
        &mut self,
        reference: &PreparedFrame,
        target: &PreparedFrame,
        points: &[GridPoint],
        start: Start,
        field: &mut Vec<FieldPoint>,
    ) {
        self.check_size(reference);
        self.check_size(target);
        self.solutions.clear();
        self.searches.pixel.is_used = false;
        let mut predicted = std::mem::take(&mut self.predicted);
        let starts = points.iter().map(|point| self.predicted_start(*point, start));
        predicted.resample((reference, target), points, &self.window, starts);
        let (mut subset, mut cut) = (std::mem::take(&mut self.subset), std::mem::take(&mut self.cut));
        for (index, point) in points.iter().enumerate() {
            let whole = matcher(&self.params, &self.window, &subset, (reference, target), *point);
            let solution = match predicted.solve(&whole, index) {
                Some(solution) => solution,
                None => match self.extract(reference, *point, &mut subset, &mut cut) {
                    Err(status) => SubsetMatch::failed(status),
                    Ok(is_cut) => {
                        let window = if is_cut { &cut } else { &self.window };
                        let (guess, min_zncc) = self.guess(points, index, start);
                        let matcher = matcher(&self.params, window, &subset, (reference, target), *point);
                        matcher.solve(&mut self.searches, guess, min_zncc)
                    }
                },
            };
            self.solutions.push(solution);
        }
        let pooled = self.choose_pooled();
        for index in pooled.iter().copied() {
            let pair = (reference, target);
            if predicted.found(index) {
                let matcher = matcher(&self.params, &self.window, &subset, pair, points[index]);
                predicted.pool(&matcher, index, &self.pairs, &mut self.pool);
                self.pool.add_gradient_gain(GradientGain::within(reference, &self.window, matcher.at));
            } else if let Ok(is_cut) = self.extract(reference, points[index], &mut subset, &mut cut) {
                let window = if is_cut { &cut } else { &self.window };
                let matcher = matcher(&self.params, window, &subset, pair, points[index]);
                pool_residual(&matcher, &self.solutions[index], &mut self.residual, &mut self.pool);
            }
        }
        self.predicted = predicted;
        (self.subset, self.cut, self.pooled) = (subset, cut, pooled);
        self.fill(points, field);
        self.median_test.mark(points, self.params.step_px, field);
    }

    /// Whether any subset of the last [`Self::correlate`] was searched for because it was not found at its start.
    pub fn has_searched(&self) -> bool {
        self.searches.pixel.is_used
    }

    /// Keeps a frame and its subsets for matching against many frames.
    ///
    /// # Panics
    ///
    /// If the size of the frame differs from the plan.
    pub fn keep(&mut self, reference: PreparedFrame, points: &[GridPoint]) -> KeptReference {
        self.check_size(&reference);
        let keep_one = |point: &GridPoint| {
            let (mut subset, mut cut) = (ReferenceSubset::default(), self.window.clone());
            let is_cut = self.extract(&reference, *point, &mut subset, &mut cut)?;
            Ok((subset, is_cut.then_some(cut)))
        };
        let subsets = points.iter().map(keep_one).collect();
        KeptReference { points: points.to_vec(), subsets, frame: reference }
    }

    /// Measures the displacements from a kept reference. See [`Self::correlate`].
    ///
    /// The correlator must have the parameters that the reference was kept with.
    ///
    /// # Panics
    ///
    /// If the size of the frame differs from the plan.
    pub fn correlate_kept(
        &mut self,
        kept: &KeptReference,
        target: &PreparedFrame,
        start: Start,
        field: &mut Vec<FieldPoint>,
    ) {
        self.solve_kept(kept, target, |correlator, index| correlator.guess(&kept.points, index, start));
        self.fill(&kept.points, field);
        self.median_test.mark(&kept.points, self.params.step_px, field);
    }

    /// Measures the displacements from a kept reference, with one start per subset and without the outlier test.
    pub(in crate::dic) fn correlate_from(
        &mut self,
        kept: &KeptReference,
        target: &PreparedFrame,
        starts: &[Option<Warp>],
        field: &mut Vec<FieldPoint>,
    ) {
        self.solve_kept(kept, target, |_, index| (starts[index], TRUSTED_ZNCC));
        self.fill(&kept.points, field);
    }

    /// Returns the warps of the last field, `None` for invalid points.
    pub(in crate::dic) fn warps(&self) -> impl Iterator<Item = Option<Warp>> {
        let valid = |solution: &&SubsetMatch| solution.status == PointStatus::Valid;
        self.solutions.iter().map(move |solution| Some(solution).filter(valid)?.found.map(|found| found.warp))
    }

    fn solve_kept(
        &mut self,
        kept: &KeptReference,
        target: &PreparedFrame,
        guess: impl Fn(&Self, usize) -> (Option<Warp>, f64),
    ) {
        self.check_size(&kept.frame);
        self.check_size(target);
        self.solutions.clear();
        let pair = (&kept.frame, target);
        for (index, (point, subset)) in kept.points.iter().zip(&kept.subsets).enumerate() {
            let solution = match subset {
                Err(status) => SubsetMatch::failed(*status),
                Ok((subset, cut)) => {
                    let window = cut.as_ref().unwrap_or(&self.window);
                    let (guess, min_zncc) = guess(self, index);
                    matcher(&self.params, window, subset, pair, *point).solve(&mut self.searches, guess, min_zncc)
                }
            };
            self.solutions.push(solution);
        }
        let pooled = self.choose_pooled();
        for index in pooled.iter().copied() {
            if let Ok((subset, cut)) = &kept.subsets[index] {
                let window = cut.as_ref().unwrap_or(&self.window);
                let matcher = matcher(&self.params, window, subset, pair, kept.points[index]);
                pool_residual(&matcher, &self.solutions[index], &mut self.residual, &mut self.pool);
            }
        }
        self.pooled = pooled;
    }

    /// Returns the initial warp of a known motion, for an unclipped subset whose shape can rotate.
    fn predicted_start(&self, point: GridPoint, start: Start) -> Option<Warp> {
        let shape = self.params.refined_shape();
        let is_free = self.window.extent.fits((point.x as isize, point.y as isize), (self.width_px, self.height_px))
            && self.region.as_ref().is_none_or(|region| region.holds(self.window.around(point)));
        let turns = self.params.method == Method::IcGn && matches!(shape, Shape::Affine | Shape::Rigid);
        start.warp(point, shape).filter(|_| is_free && turns)
    }

    fn check_size(&self, frame: &PreparedFrame) {
        assert_eq!(
            (frame.width(), frame.height()),
            (self.width_px, self.height_px),
            "the frame size differs from the plan"
        );
    }

    /// Extracts the subset at a point of the reference and returns whether the region or the edge clips it.
    fn extract(
        &self,
        reference: &PreparedFrame,
        point: GridPoint,
        subset: &mut ReferenceSubset,
        cut: &mut SubsetMask,
    ) -> Result<bool, PointStatus> {
        let (width, height) = (self.width_px, self.height_px);
        let whole = self.window.extent.fits((point.x as isize, point.y as isize), (width, height));
        let belongs = |dx: i32, dy: i32| {
            let (x, y) = (f64::from(point.x) + f64::from(dx), f64::from(point.y) + f64::from(dy));
            let inner = |at: f64, extent: usize| at >= EDGE_PX && at <= extent as f64 - 1.0 - EDGE_PX;
            (whole || (inner(x, width) && inner(y, height)))
                && self.region.as_ref().is_none_or(|region| region.contains(x, y))
        };
        let is_inside = whole && self.region.as_ref().is_none_or(|region| region.holds(self.window.around(point)));
        let is_cut = !is_inside && self.window.clip(belongs, cut);
        let share = cut.pixels as f64 / self.window.pixels as f64;
        if is_cut && (share < MIN_INSIDE_FRACTION || self.params.method != Method::IcGn) {
            return Err(PointStatus::OutOfFrame);
        }
        let window = if is_cut { &*cut } else { &self.window };
        match subset.fill(reference, window, self.params.refined_shape(), (point.x, point.y)) {
            Ok(()) => Ok(is_cut),
            Err(Unusable::OutOfFrame) => Err(PointStatus::OutOfFrame),
            Err(Unusable::LowContrast) => Err(PointStatus::LowContrast),
        }
    }

    /// Returns the initial warp and the minimum ZNCC of its result.
    fn guess(&self, points: &[GridPoint], index: usize, start: Start) -> (Option<Warp>, f64) {
        if start != Start::Neighbor {
            return (start.warp(points[index], self.params.refined_shape()), 0.0);
        }
        let Some(before) = index.checked_sub(1) else { return (None, 0.0) };
        let (point, neighbor, solution) = (points[index], points[before], self.solutions[before]);
        let found = solution.found.filter(|_| solution.status == PointStatus::Valid && point.y == neighbor.y);
        let predicted = found.map(|found| {
            let (dx, warp) = (f64::from(point.x) - f64::from(neighbor.x), found.warp);
            Warp { u: warp.u + warp.ux * dx, v: warp.v + warp.vx * dx, ..warp }
        });
        (predicted, TRUSTED_ZNCC)
    }

    /// Selects valid matches spread over the field, in memory that goes back to `pooled`.
    fn choose_pooled(&mut self) -> Vec<usize> {
        let mut pooled = std::mem::take(&mut self.pooled);
        let valid = |index: &usize| self.solutions[*index].status == PointStatus::Valid;
        let count = (0..self.solutions.len()).filter(valid).count();
        pooled.clear();
        pooled.extend((0..self.solutions.len()).filter(valid).step_by(count.div_ceil(POOLED).max(1)));
        self.pool.clear();
        pooled
    }

    /// Writes the solutions as field points.
    fn fill(&mut self, points: &[GridPoint], field: &mut Vec<FieldPoint>) {
        let (factor, gain) = (self.pool.factor(), self.pool.gradient_gain());
        field.clear();
        field.extend(points.iter().zip(&self.solutions).map(|(point, solution)| {
            let (variance_u, variance_v) = factor.variances(solution.residual, solution.inverse);
            let valid = solution.found.filter(|_| solution.status == PointStatus::Valid);
            FieldPoint {
                x_px: point.x as f32,
                y_px: point.y as f32,
                displacement: valid.map(|found| Displacement {
                    u_px: found.warp.u as f32,
                    v_px: found.warp.v as f32,
                    sigma_u_px: (gain * gain * variance_u + solution.peak_variance.0).sqrt() as f32,
                    sigma_v_px: (gain * gain * variance_v + solution.peak_variance.1).sqrt() as f32,
                }),
                zncc: solution.found.map(|found| found.zncc as f32),
                peak_ratio: solution.peak_ratio.map(|ratio| ratio as f32),
                status: solution.status,
            }
        }));
    }
}

/// Returns the matcher of one subset of a pair of frames.
fn matcher<'a>(
    params: &'a CorrelationParams,
    window: &'a SubsetMask,
    subset: &'a ReferenceSubset,
    (reference, target): (&'a PreparedFrame, &'a PreparedFrame),
    point: GridPoint,
) -> SubsetMatcher<'a> {
    SubsetMatcher { params, window, subset, reference, target, at: (point.x, point.y) }
}

/// Adds the autocorrelation of the residual of one match.
fn pool_residual(matcher: &SubsetMatcher<'_>, solution: &SubsetMatch, residual: &mut Vec<Lanes>, pool: &mut NoisePool) {
    let Some(found) = solution.found else { return };
    match matcher.params.refined_shape() {
        Shape::Quadratic => matcher.refiner().quadratic_residual(&found, residual),
        _ => matcher.refiner().residual(&found.warp, residual),
    }
    if !residual.is_empty() {
        pool.add(matcher.subset, matcher.window, residual);
        pool.add_gradient_gain(GradientGain::within(matcher.reference, matcher.window, matcher.at));
    }
}

impl Start {
    /// Returns the initial warp if one is known.
    fn warp(&self, point: GridPoint, shape: Shape) -> Option<Warp> {
        let Self::Motion { x_px, y_px, u_px, v_px, angle_deg } = *self else { return None };
        let turn = Warp::rigid(u_px, v_px, angle_deg.to_radians());
        let (dx, dy) = (f64::from(point.x) - x_px, f64::from(point.y) - y_px);
        let (x, y) = turn.apply(dx, dy);
        let (u, v) = (x - dx, y - dy);
        Some(if shape == Shape::Translation { Warp::shift(u, v) } else { Warp { u, v, ..turn } })
    }
}
