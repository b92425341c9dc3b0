//! The correlator: plans once, then measures one displacement field per call.

use super::predicted::PredictedUpdate;
use super::subset_match::{Guess, Searches, SubsetMatch, SubsetMatcher};
use crate::dic::error::CorrelationError;
use crate::dic::field::MedianTest;
use crate::dic::geometry::{GridPoint, Pixel, PlanarMotion, Point, Region, Shape, Size, SubsetMask, Warp};
use crate::dic::image::PreparedFrame;
use crate::dic::params::{CorrelationParams, Method};
use crate::dic::search::{IntegerSearch, PeakFit, UpsampledSearch};
use crate::dic::subset::{ReferenceSubset, Unusable};
use crate::dic::uncertainty::{Lags, NoisePool, POOLED, count_pairs};
use crate::image::ImageView;
use crate::numeric::Lanes;
use crate::results::{Displacement, FieldPoint, PointStatus};

/// The minimum ZNCC at which a start from a neighbour or from the previous frame is accepted.
const TRUSTED_ZNCC: f64 = 0.9;

/// The minimum fraction of the pixels for which the region has room that a subset must keep.
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
    region: Option<Region>,
    searches: Searches,
    extracted: ExtractedSubset,
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
/// Created by [`Correlator::keep_reference`]. Renew it when the body has rotated by about 3 deg or the ZNCC drops.
#[derive(Debug, Clone)]
pub struct KeptReference {
    frame: PreparedFrame,
    points: Vec<GridPoint>,
    subsets: Vec<Result<ExtractedSubset, PointStatus>>,
}

/// A subset of a reference.
#[derive(Debug, Clone, Default)]
struct ExtractedSubset {
    subset: ReferenceSubset,
    /// The part of the window inside the region and the image, if these clip it.
    clipped: SubsetMask,
    is_clipped: bool,
}

impl ExtractedSubset {
    /// Returns the mask of the subset: its clipped part, or the `whole` window.
    fn window<'a>(&'a self, whole: &'a SubsetMask) -> &'a SubsetMask {
        if self.is_clipped { &self.clipped } else { whole }
    }
}

/// A reference and a target, with the subsets of a kept reference if there is one.
struct FramePair<'a> {
    reference: &'a PreparedFrame,
    target: &'a PreparedFrame,
    points: &'a [GridPoint],
    kept: Option<&'a KeptReference>,
}

impl<'a> FramePair<'a> {
    /// Pairs a kept reference with a target.
    fn from_kept(kept: &'a KeptReference, target: &'a PreparedFrame) -> Self {
        Self { reference: &kept.frame, target, points: &kept.points, kept: Some(kept) }
    }

    /// Returns the matcher of the subset with this index.
    fn matcher(
        &self,
        params: &'a CorrelationParams,
        window: &'a SubsetMask,
        subset: &'a ReferenceSubset,
        index: usize,
    ) -> SubsetMatcher<'a> {
        let Self { reference, target, points, .. } = *self;
        SubsetMatcher { params, window, subset, reference, target, at: points[index] }
    }
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
                peak_fit: PeakFit::Fitted,
            },
            region: None,
            predicted: PredictedUpdate::default(),
            pairs: count_pairs(&window),
            window,
            params: params.clone(),
            width_px,
            height_px,
            extracted: ExtractedSubset::default(),
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
        self.searches.peak_fit = PeakFit::Highest;
        self
    }

    /// Restricts correlation to reference pixels inside `region`; `None` uses all.
    ///
    /// Subsets are clipped at the edge of the region or of the image. With less than half of the pixels for which the
    /// region has room, or with the correlation-peak methods, a clipped subset is out of frame.
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
        let mut predicted = std::mem::take(&mut self.predicted);
        let starts = points.iter().map(|point| self.predicted_start(*point, start));
        predicted.resample(reference, target, points, &self.window, starts);
        self.predicted = predicted;
        let pair = FramePair { reference, target, points, kept: None };
        self.measure(&pair, |correlator, index| correlator.guess(points, index, start), field);
        self.median_test.mark(points, self.params.step_px, field);
    }

    /// Whether any subset of the last field was searched for, because it had no start or was not found there.
    pub fn has_searched(&self) -> bool {
        self.searches.pixel.is_used
    }

    /// Keeps a frame and its subsets for matching against many frames.
    ///
    /// # Panics
    ///
    /// If the size of the frame differs from the plan.
    pub fn keep_reference(&mut self, reference: PreparedFrame, points: &[GridPoint]) -> KeptReference {
        self.check_size(&reference);
        let keep_one = |point: &GridPoint| {
            let mut extracted = ExtractedSubset::default();
            self.extract(&reference, *point, &mut extracted).map(|()| extracted)
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
        self.predicted.clear();
        let guess = |correlator: &Self, index: usize| correlator.guess(&kept.points, index, start);
        self.measure(&FramePair::from_kept(kept, target), guess, field);
        self.median_test.mark(&kept.points, self.params.step_px, field);
    }

    /// Measures the displacements from a kept reference, with one start per subset and without the outlier test. A
    /// subset without a start, or without a match of [`TRUSTED_ZNCC`] from it, is searched for.
    ///
    /// # Panics
    ///
    /// If [`Self::correlate_kept`] would panic, or if there are fewer starts than subsets.
    pub(in crate::dic) fn correlate_from(
        &mut self,
        kept: &KeptReference,
        target: &PreparedFrame,
        starts: &[Option<Warp>],
        field: &mut Vec<FieldPoint>,
    ) {
        self.predicted.clear();
        let guess = |_: &Self, index: usize| Guess { warp: starts[index], min_zncc: TRUSTED_ZNCC };
        self.measure(&FramePair::from_kept(kept, target), guess, field);
    }

    /// Returns the warps of the last field, `None` for subsets without a valid match. Outliers keep theirs.
    pub(in crate::dic) fn warps(&self) -> impl Iterator<Item = Option<Warp>> {
        let valid = |solution: &&SubsetMatch| solution.status == PointStatus::Valid;
        self.solutions.iter().map(move |solution| Some(solution).filter(valid)?.found.map(|found| found.warp))
    }

    /// Matches every subset and writes the field. `guess` returns the initial guess of the subset with an index.
    ///
    /// The noise of the images is estimated from a few subsets spread over the field.
    fn measure(&mut self, pair: &FramePair<'_>, guess: impl Fn(&Self, usize) -> Guess, field: &mut Vec<FieldPoint>) {
        self.check_size(pair.reference);
        self.check_size(pair.target);
        self.solutions.clear();
        self.searches.pixel.is_used = false;
        let (mut predicted, mut memory) = (std::mem::take(&mut self.predicted), std::mem::take(&mut self.extracted));
        for index in 0..pair.points.len() {
            let whole = pair.matcher(&self.params, &self.window, &memory.subset, index);
            let solution = match predicted.solve(&whole, index) {
                Some(solution) => solution,
                None => match self.subset_at(pair, index, &mut memory) {
                    Err(status) => SubsetMatch::failed(status),
                    Ok(extracted) => {
                        let (window, guess) = (extracted.window(&self.window), guess(self, index));
                        let matcher = pair.matcher(&self.params, window, &extracted.subset, index);
                        matcher.solve(&mut self.searches, guess)
                    }
                },
            };
            self.solutions.push(solution);
        }
        let pooled = self.select_pooled();
        for index in pooled.iter().copied() {
            if predicted.is_found(index) {
                let matcher = pair.matcher(&self.params, &self.window, &memory.subset, index);
                predicted.add_to_pool(&matcher, index, &self.pairs, &mut self.pool);
            } else if let Ok(extracted) = self.subset_at(pair, index, &mut memory) {
                let window = extracted.window(&self.window);
                let matcher = pair.matcher(&self.params, window, &extracted.subset, index);
                matcher.add_to_pool(&self.solutions[index], &mut self.residual, &mut self.pool);
            }
        }
        (self.predicted, self.extracted, self.pooled) = (predicted, memory, pooled);
        self.write_field(pair.points, field);
    }

    /// Returns the subset of a kept reference, or extracts it into `memory`.
    ///
    /// # Errors
    ///
    /// The status of a subset that cannot be matched.
    fn subset_at<'a>(
        &self,
        pair: &FramePair<'a>,
        index: usize,
        memory: &'a mut ExtractedSubset,
    ) -> Result<&'a ExtractedSubset, PointStatus> {
        if let Some(kept) = pair.kept {
            return kept.subsets[index].as_ref().map_err(|status| *status);
        }
        self.extract(pair.reference, pair.points[index], memory)?;
        Ok(memory)
    }

    /// Returns the initial warp of a subset if its motion is predicted and one update may find it. `None` for clipped
    /// subsets, and for shape functions that one update does not cover.
    fn predicted_start(&self, point: GridPoint, start: Start) -> Option<Warp> {
        let shape = self.params.refined_shape();
        let is_free = self.is_inside(point)
            && self.region.as_ref().is_none_or(|region| region.contains_rectangle(self.window.bounds_about(point)));
        let turns = self.params.method == Method::IcGn && matches!(shape, Shape::Affine | Shape::Rigid);
        start.warp(point, shape).filter(|_| is_free && turns)
    }

    /// Panics unless a frame has the planned size.
    fn check_size(&self, frame: &PreparedFrame) {
        assert_eq!(
            (frame.width(), frame.height()),
            (self.width_px, self.height_px),
            "the frame size differs from the plan"
        );
    }

    /// Whether the window about a point lies wholly in the image.
    fn is_inside(&self, point: GridPoint) -> bool {
        let at = Pixel { x: point.x as i32, y: point.y as i32 };
        self.window.extent.fits(at, Size { width: self.width_px, height: self.height_px })
    }

    /// Extracts the subset at a point of the reference, clipped by the region and the edge of the image.
    ///
    /// # Errors
    ///
    /// The status of a subset that is clipped too much or cannot be matched.
    fn extract(
        &self,
        reference: &PreparedFrame,
        point: GridPoint,
        out: &mut ExtractedSubset,
    ) -> Result<(), PointStatus> {
        let (whole, region) = (self.is_inside(point), self.region.as_ref());
        let belongs = |dx: i32, dy: i32| {
            let (x, y) = (f64::from(point.x) + f64::from(dx), f64::from(point.y) + f64::from(dy));
            let inner = |at: f64, extent: usize| at >= EDGE_PX && at <= extent as f64 - 1.0 - EDGE_PX;
            (whole || (inner(x, self.width_px) && inner(y, self.height_px)))
                && region.is_none_or(|region| region.contains(x, y))
        };
        let is_inside = whole && region.is_none_or(|region| region.contains_rectangle(self.window.bounds_about(point)));
        out.is_clipped = !is_inside && self.window.clip(belongs, &mut out.clipped);
        let room = region.map_or(1.0, |region| region.room_fraction(self.params.subset_size_px));
        let too_few = (out.clipped.pixels as f64) < MIN_INSIDE_FRACTION * room * self.window.pixels as f64;
        if out.is_clipped && (too_few || self.params.method != Method::IcGn) {
            return Err(PointStatus::OutOfFrame);
        }
        let window = if out.is_clipped { &out.clipped } else { &self.window };
        out.subset.fill(reference, window, self.params.refined_shape(), point).map_err(Unusable::status)
    }

    /// Returns the initial guess of the subset with this index.
    ///
    /// With [`Start::Neighbor`] it is the last solution of the same row, extrapolated with its gradients.
    fn guess(&self, points: &[GridPoint], index: usize, start: Start) -> Guess {
        if start != Start::Neighbor {
            return Guess { warp: start.warp(points[index], self.params.refined_shape()), min_zncc: 0.0 };
        }
        let Some(before) = index.checked_sub(1) else { return Guess::default() };
        let (point, neighbor, solution) = (points[index], points[before], self.solutions[before]);
        let found = solution.found.filter(|_| solution.status == PointStatus::Valid && point.y == neighbor.y);
        let warp = found.map(|found| {
            let (dx, warp) = (f64::from(point.x) - f64::from(neighbor.x), found.warp);
            Warp { u: warp.u + warp.ux * dx, v: warp.v + warp.vx * dx, ..warp }
        });
        Guess { warp, min_zncc: TRUSTED_ZNCC }
    }

    /// Clears the noise pool and returns the indices of at most [`POOLED`] valid matches, spread over the field.
    ///
    /// The list has the memory of `pooled`, which gets it back afterwards.
    fn select_pooled(&mut self) -> Vec<usize> {
        let mut pooled = std::mem::take(&mut self.pooled);
        let valid = |index: &usize| self.solutions[*index].status == PointStatus::Valid;
        let count = (0..self.solutions.len()).filter(valid).count();
        pooled.clear();
        pooled.extend((0..self.solutions.len()).filter(valid).step_by(count.div_ceil(POOLED).max(1)));
        self.pool.clear();
        pooled
    }

    /// Writes the solutions to `field` with uncertainties from the noise pool.
    fn write_field(&mut self, points: &[GridPoint], field: &mut Vec<FieldPoint>) {
        let (factor, gain) = (self.pool.factor(), self.pool.gradient_gain());
        field.clear();
        field.extend(points.iter().zip(&self.solutions).map(|(point, solution)| {
            let (variance_u, variance_v) = factor.variances(solution.residual, solution.inverse.0, solution.inverse.1);
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

impl Start {
    /// Returns the initial warp of the subset at a point if the start is a known motion.
    fn warp(&self, point: GridPoint, shape: Shape) -> Option<Warp> {
        let Self::Motion { x_px, y_px, u_px, v_px, angle_deg } = *self else { return None };
        let motion = PlanarMotion { u_px, v_px, angle_deg };
        let offset = Point::new(f64::from(point.x) - x_px, f64::from(point.y) - y_px);
        let warp = motion.at_offset(offset).to_warp();
        Some(if shape == Shape::Translation { Warp::shift(warp.u, warp.v) } else { warp })
    }
}
