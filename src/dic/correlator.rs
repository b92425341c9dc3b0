//! The correlator: planned once, then one field a call.

use super::GridPoint;
use super::error::CorrelationError;
use super::fft::{Found, Search};
use super::fine::FineSearch;
use super::lanes::Lanes;
use super::params::{CorrelationParams, Method, Shape};
use super::peak::Peak;
use super::prepared::Prepared;
use super::refine::{Lost, Match, Refiner};
use super::sigma::{POOLED, Pool};
use super::subset::{Subset, Unusable};
use super::validate::MedianTest;
use super::warp::Warp;
use super::window::Window;
use crate::image::ImageView;
use crate::results::{Displacement, FieldPoint, PointStatus};

/// Height of the second peak of the quick search, relative to the first, up to which the first is clear.
const CLEAR: f64 = 0.7;

/// ZNCC from which on the quick search's answer is taken without a look at a larger area.
const SURE: f64 = 0.9;

/// Height of the second peak, relative to the first, from which on both are refined and compared.
const RIVAL: f64 = 0.75;

/// Height of a second peak that cannot be refined, relative to the first, from which on it counts as equal.
const RIVAL_HEIGHT: f64 = 0.9;

/// Matches are ambiguous when the second lacks at most this much more than the first does.
const RIVAL_DEFECT: f64 = 0.02;

/// Share of the gradient energy in the weaker direction under which a subset may be a mere stripe.
const STRIPE: f64 = 0.05;

/// Gradient energy per pixel that white noise of unit variance shows to the fourth-order difference.
const NOISE_GRADIENT: f64 = 0.903;

/// Share of gradient energy in the contrast above which a subset looks like white noise, not speckle.
const NOISE_TEXTURE: f64 = 0.7;

/// Where the search for each subset begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Start {
    /// Anywhere within `search_px`, by FFT correlation.
    Search,
    /// Near a known rigid motion; subsets not found there are searched for.
    Motion {
        /// The point whose displacement is given, px.
        x_px: f64,
        /// The point whose displacement is given, px.
        y_px: f64,
        /// Displacement of that point along x, px.
        u_px: f64,
        /// Displacement of that point along y, px.
        v_px: f64,
        /// Rotation, counter-clockwise on the screen, deg.
        angle_deg: f64,
    },
}

/// Measures displacement fields; planned for one image size and set of parameters.
///
/// All memory is allocated by [`Correlator::new`]; the fields depend on nothing
/// but the arguments of [`Correlator::correlate`], never on earlier calls.
pub struct Correlator {
    params: CorrelationParams,
    width_px: usize,
    height_px: usize,
    window: Window,
    search: Search,
    /// For `spline-fft` only.
    fine: Option<FineSearch>,
    peak_fit: bool,
    subset: Subset,
    solutions: Vec<Solution>,
    residual: Vec<Lanes>,
    pool: Pool,
    median_test: MedianTest,
}

/// What became of one subset before the field is looked at as a whole.
#[derive(Debug, Clone, Copy)]
struct Solution {
    status: PointStatus,
    found: Option<Match>,
    peak_ratio: Option<f64>,
    /// Variance of the residual, DN^2.
    residual: f64,
    /// Diagonal of the inverse Hessian for u and v.
    inverse: (f64, f64),
    /// Variance of u and v besides the noise, px^2: what a peak fit leaves.
    doubt: (f64, f64),
}

impl Solution {
    fn failed(status: PointStatus) -> Self {
        Self { status, found: None, peak_ratio: None, residual: 0.0, inverse: (0.0, 0.0), doubt: (0.0, 0.0) }
    }
}

impl Correlator {
    /// Plans correlations of images of the given size.
    ///
    /// # Errors
    ///
    /// [`CorrelationError`] naming the parameter that is out of range, or when
    /// the image has no room for one subset.
    pub fn new(params: &CorrelationParams, width_px: usize, height_px: usize) -> Result<Self, CorrelationError> {
        params.check()?;
        let size = params.subset_size_px;
        if width_px < size as usize || height_px < size as usize {
            return Err(CorrelationError::SubsetLargerThanImage { subset_size_px: size, width_px, height_px });
        }
        let window = Window::new(params.window, size);
        let points = params.spline_points as usize;
        Ok(Self {
            fine: (params.method == Method::SplineFft).then(|| FineSearch::new(&window, points)),
            peak_fit: true,
            window,
            search: Search::new(size as usize, params.search_px as usize),
            params: params.clone(),
            width_px,
            height_px,
            subset: Subset::default(),
            solutions: Vec::new(),
            residual: Vec::new(),
            pool: Pool::default(),
            median_test: MedianTest::default(),
        })
    }

    /// Leaves the fit of the correlation peak out of `spline-fft`: the answer is its highest grid point.
    ///
    /// For studies of what that does; not for measurements.
    pub fn without_peak_fit(self) -> Self {
        Self { peak_fit: false, ..self }
    }

    /// The parameters it was planned with.
    pub fn params(&self) -> &CorrelationParams {
        &self.params
    }

    /// Makes a frame ready, in new memory.
    ///
    /// # Panics
    ///
    /// If the image has another size than planned.
    pub fn prepare(&self, image: ImageView<'_>) -> Prepared {
        let mut prepared = Prepared::default();
        self.prepare_into(image, &mut prepared);
        prepared
    }

    /// Makes a frame ready in memory used before; allocates only the first time.
    ///
    /// # Panics
    ///
    /// If the image has another size than planned.
    pub fn prepare_into(&self, image: ImageView<'_>, prepared: &mut Prepared) {
        assert_eq!((image.width(), image.height()), (self.width_px, self.height_px), "planned for another size");
        prepared.fill(image);
    }

    /// Measures how far each subset moved from `reference` to `target`.
    ///
    /// `field` is cleared first and then holds one point per grid point, in the
    /// same order; a feature at x in the reference is at x + u in the target.
    ///
    /// # Panics
    ///
    /// If a frame has another size than planned.
    ///
    /// # Cost
    ///
    /// No allocation once `field` and the memory inside have grown to the number of points.
    pub fn correlate(
        &mut self,
        reference: &Prepared,
        target: &Prepared,
        points: &[GridPoint],
        start: Start,
        field: &mut Vec<FieldPoint>,
    ) {
        for frame in [reference, target] {
            assert_eq!((frame.width(), frame.height()), (self.width_px, self.height_px), "planned for another size");
        }
        self.solutions.clear();
        for point in points {
            let mut solution = self.solve(reference, target, *point, start);
            if self.shape() == Shape::Quadratic && solution.status == PointStatus::Valid {
                solution = self.bend(target, (point.x, point.y), solution);
            }
            self.solutions.push(solution);
        }
        self.pool_residuals(reference, target, points);
        self.write(points, field);
        self.median_test.mark(points, self.params.step_px, field);
    }

    /// Finds one subset.
    fn solve(&mut self, reference: &Prepared, target: &Prepared, point: GridPoint, start: Start) -> Solution {
        let at = (point.x, point.y);
        match self.subset.fill(reference, &self.window, self.shape(), at) {
            Err(Unusable::OutOfFrame) => return Solution::failed(PointStatus::OutOfFrame),
            Err(Unusable::LowContrast) => return Solution::failed(PointStatus::LowContrast),
            Ok(()) => {}
        }
        let guess = start.warp(point, self.shape());
        if self.params.method != Method::IcGn {
            return self.solve_peak((reference, target), at, guess.as_ref());
        }
        if let Some(warp) = guess
            && let Ok(found) = self.refiner(target, at).refine(warp)
            && found.zncc >= self.params.min_zncc
        {
            return self.judge(found, None);
        }
        if guess.is_none()
            && let Some(peaks) = self.search.find_near(&self.subset, &self.window, &target.levels, at)
            && peaks.second.is_none_or(|second| second.height < CLEAR * peaks.best.height)
            && let Ok(found) = self.refine_peak(target, at, &peaks, &peaks.best)
            && found.zncc >= SURE.max(self.params.min_zncc)
        {
            return self.judge(found, peaks.ratio());
        }
        let around = guess.map_or((0, 0), |warp| self.search_center(&warp));
        let Some(peaks) = self.search.find(&self.subset, &self.window, &target.levels, at, around) else {
            return Solution::failed(PointStatus::OutOfFrame);
        };
        let solution = self.refine_peaks(target, at, &peaks);
        if peaks.clipped && solution.status == PointStatus::Valid && self.repeats_itself(reference, at) {
            return solution.with_status(PointStatus::Ambiguous);
        }
        solution
    }

    /// Whether the subset has a double in the reference itself.
    ///
    /// Near the edge of the image the true match may have left it; then one of a
    /// regular pattern's repetitions would pass for it.
    fn repeats_itself(&mut self, reference: &Prepared, at: (u32, u32)) -> bool {
        let own = self.search.find(&self.subset, &self.window, &reference.levels, at, (0, 0));
        own.is_some_and(|own| own.second.is_some_and(|second| second.height > RIVAL_HEIGHT * own.best.height))
    }

    /// The deformation allowed; correlation peaks know shifts only.
    fn shape(&self) -> Shape {
        if self.params.method == Method::IcGn { self.params.shape } else { Shape::Translation }
    }

    /// Finds one subset by a correlation peak alone.
    fn solve_peak(
        &mut self,
        (reference, target): (&Prepared, &Prepared),
        at: (u32, u32),
        guess: Option<&Warp>,
    ) -> Solution {
        let around = guess.map_or((0, 0), |warp| (warp.u.round() as i32, warp.v.round() as i32));
        let Some(peaks) = self.search.find(&self.subset, &self.window, &target.levels, at, around) else {
            return Solution::failed(PointStatus::OutOfFrame);
        };
        let displacement = match (self.params.method, &mut self.fine) {
            (Method::SplineFft, Some(fine)) => {
                let near = peaks.whole();
                fine.find((&reference.coefficients, &target.coefficients), &self.window, at, near, self.peak_fit)
            }
            (Method::PeakSpline, _) => Some(peaks.offset(self.search.spline_top(&peaks))),
            _ => Some(peaks.offset(self.search.gaussian_top(&peaks))),
        };
        let Some((u, v)) = displacement else { return Solution::failed(PointStatus::LowContrast) };
        let ratio = peaks.ratio();
        let warp = Warp::shift(u, v);
        // One step of the refinement, not taken, tells how far off the peak is.
        match self.refiner(target, at).step(&warp) {
            Err(lost) => self.settle(Err(lost), &peaks, ratio),
            Ok((_, zncc)) if zncc < self.params.min_zncc => {
                let found = Match { warp, second: [[0.0; 3]; 2], zncc, iterations: 0 };
                Solution { found: Some(found), peak_ratio: ratio, ..Solution::failed(self.unlike()) }
            }
            Ok((step, zncc)) => {
                let solution = self.judge(Match { warp, second: [[0.0; 3]; 2], zncc, iterations: 0 }, ratio);
                let doubt = (step.u * step.u, step.v * step.v);
                let alike = peaks.second.is_some_and(|second| second.height > RIVAL_HEIGHT * peaks.best.height);
                let repeated = peaks.clipped && self.repeats_itself(reference, at);
                let status = if alike || repeated { PointStatus::Ambiguous } else { solution.status };
                Solution { doubt, ..solution }.with_status(status)
            }
        }
    }

    /// The second-order answer from a valid first-order one.
    fn bend(&self, target: &Prepared, at: (u32, u32), solution: Solution) -> Solution {
        let Some(found) = solution.found else { return solution };
        match self.refiner(target, at).refine_quadratic(&found) {
            Ok(bent) if bent.found.zncc >= self.params.min_zncc => {
                let judged = self.judge(bent.found, solution.peak_ratio);
                Solution { inverse: bent.inverse, ..judged }
            }
            Ok(_) | Err(Lost::NotConverged) => solution.without_answer(PointStatus::LowCorrelation),
            Err(Lost::OutOfFrame) => solution.without_answer(PointStatus::OutOfFrame),
        }
    }

    /// Whole-pixel displacement to search around: zero, or the guess where it is out of range of zero.
    fn search_center(&self, warp: &Warp) -> (i32, i32) {
        let range = f64::from(self.params.search_px);
        if warp.u.abs() <= range && warp.v.abs() <= range {
            return (0, 0);
        }
        let whole = |value: f64| value.round().clamp(-1e6, 1e6) as i32;
        (whole(warp.u), whole(warp.v))
    }

    fn refiner<'a>(&'a self, target: &'a Prepared, at: (u32, u32)) -> Refiner<'a> {
        Refiner { subset: &self.subset, window: &self.window, shape: self.shape(), target: &target.coefficients, at }
    }

    /// Refines one peak.
    fn refine_peak(&self, target: &Prepared, at: (u32, u32), peaks: &Found, peak: &Peak) -> Result<Match, Lost> {
        let (u, v) = peaks.displacement(peak);
        self.refiner(target, at).refine(Warp::shift(u, v))
    }

    /// Refines the best peak, and its rival where there is one; decides between them.
    fn refine_peaks(&self, target: &Prepared, at: (u32, u32), peaks: &Found) -> Solution {
        let refine = |peak: &Peak| self.refine_peak(target, at, peaks, peak);
        let first = refine(&peaks.best);
        let ratio = peaks.ratio();
        let sound = first.is_ok_and(|found| found.zncc >= self.params.min_zncc);
        let rival = peaks.second.filter(|second| !sound || second.height > RIVAL * peaks.best.height);
        let Some(second) = rival else {
            return self.settle(first, peaks, ratio);
        };
        let other = refine(&second);
        let (Ok(a), Ok(b)) = (first, other) else {
            let settled = self.settle(first.or(other).or(first), peaks, ratio);
            // A rival that cannot be refined because it leaves the image is judged by its peak.
            let alike = first.is_ok()
                && other == Err(Lost::OutOfFrame)
                && settled.status == PointStatus::Valid
                && second.height > RIVAL_HEIGHT * peaks.best.height;
            return if alike { settled.with_status(PointStatus::Ambiguous) } else { settled };
        };
        if (a.warp.u - b.warp.u).hypot(a.warp.v - b.warp.v) < 1.0 {
            return self.settle(first, peaks, ratio);
        }
        let (best, other) = if a.zncc >= b.zncc { (a, b) } else { (b, a) };
        let ratio = (other.zncc > 0.0).then(|| best.zncc / other.zncc);
        let alike = 1.0 - other.zncc < 3.0 * (1.0 - best.zncc) + RIVAL_DEFECT;
        if alike && other.zncc >= self.params.min_zncc {
            return self.judge(best, ratio).with_status(PointStatus::Ambiguous);
        }
        self.settle(Ok(best), peaks, ratio)
    }

    /// The answer of one refinement.
    fn settle(&self, found: Result<Match, Lost>, peaks: &Found, peak_ratio: Option<f64>) -> Solution {
        match found {
            Ok(found) if found.zncc >= self.params.min_zncc => self.judge(found, peak_ratio),
            Ok(found) => Solution { found: Some(found), peak_ratio, ..Solution::failed(self.unlike()) },
            Err(Lost::OutOfFrame) if peaks.best.height > 0.7 * self.params.min_zncc => {
                Solution { peak_ratio, ..Solution::failed(PointStatus::OutOfFrame) }
            }
            Err(_) => Solution { peak_ratio, ..Solution::failed(self.unlike()) },
        }
    }

    /// Why nothing similar was found: noise without texture has nothing to be similar to.
    fn unlike(&self) -> PointStatus {
        if self.subset.roughness > NOISE_TEXTURE { PointStatus::LowContrast } else { PointStatus::LowCorrelation }
    }

    /// A good match: its residual, and whether the texture supports it in both directions.
    fn judge(&self, found: Match, peak_ratio: Option<f64>) -> Solution {
        let subset = &self.subset;
        let (pixels, parameters) = (self.window.pixels as f64, self.shape().parameters());
        let free = (pixels - parameters as f64 - 2.0).max(1.0);
        let residual = 2.0 * subset.energy * (1.0 - found.zncc) / free;
        let noise = NOISE_GRADIENT * 0.5 * residual.max(super::sigma::ROUNDING);
        let stripe = subset.isotropy < STRIPE && subset.weak_gradient < 2.0 * noise;
        let along_v = if parameters >= 6 { 3 } else { 1 };
        Solution {
            status: if stripe { PointStatus::LowContrast } else { PointStatus::Valid },
            found: Some(found),
            peak_ratio,
            residual,
            inverse: (subset.inverse[0][0], subset.inverse[along_v][along_v]),
            doubt: (0.0, 0.0),
        }
    }

    /// Gathers how the residuals of some dozens of good matches correlate from pixel to pixel.
    fn pool_residuals(&mut self, reference: &Prepared, target: &Prepared, points: &[GridPoint]) {
        self.pool.clear();
        let valid = self.solutions.iter().filter(|solution| solution.status == PointStatus::Valid).count();
        let every = valid.div_ceil(POOLED).max(1);
        let mut seen = 0;
        for (index, point) in points.iter().enumerate() {
            let Solution { status: PointStatus::Valid, found: Some(found), .. } = self.solutions[index] else {
                continue;
            };
            seen += 1;
            let at = (point.x, point.y);
            if (seen - 1) % every != 0 || self.subset.fill(reference, &self.window, self.shape(), at).is_err() {
                continue;
            }
            let mut residual = std::mem::take(&mut self.residual);
            match self.shape() {
                Shape::Quadratic => self.refiner(target, at).quadratic_residual(&found, &mut residual),
                _ => self.refiner(target, at).residual(&found.warp, &mut residual),
            }
            if !residual.is_empty() {
                self.pool.add(&self.subset, &self.window, &residual);
            }
            self.residual = residual;
        }
    }

    /// Writes the solutions as field points.
    fn write(&self, points: &[GridPoint], field: &mut Vec<FieldPoint>) {
        let factor = self.pool.factor();
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
                    sigma_u_px: (variance_u + solution.doubt.0).sqrt() as f32,
                    sigma_v_px: (variance_v + solution.doubt.1).sqrt() as f32,
                }),
                zncc: solution.found.map(|found| found.zncc as f32),
                peak_ratio: solution.peak_ratio.map(|ratio| ratio as f32),
                status: solution.status,
            }
        }));
    }
}

impl Solution {
    fn without_answer(self, status: PointStatus) -> Self {
        Self { found: None, status, ..self }
    }

    fn with_status(self, status: PointStatus) -> Self {
        Self { status, ..self }
    }
}

impl Start {
    /// The warp to begin with, if one is known.
    fn warp(&self, point: GridPoint, shape: Shape) -> Option<Warp> {
        let Self::Motion { x_px, y_px, u_px, v_px, angle_deg } = *self else { return None };
        let turn = Warp::rigid(u_px, v_px, angle_deg.to_radians());
        let (dx, dy) = (f64::from(point.x) - x_px, f64::from(point.y) - y_px);
        let (x, y) = turn.apply(dx, dy);
        let (u, v) = (x - dx, y - dy);
        Some(if shape == Shape::Translation { Warp::shift(u, v) } else { Warp { u, v, ..turn } })
    }
}
