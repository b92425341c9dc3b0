//! Matching of one subset, and the tests that accept its result.

use crate::dic::geometry::{GridPoint, Pixel, Shape, SubsetMask, Warp};
use crate::dic::image::PreparedFrame;
use crate::dic::params::{CorrelationParams, Method};
use crate::dic::refine::{Match, MatchError, Refiner};
use crate::dic::search::{IntegerSearch, Peak, PeakFit, SearchResult, Subset, UpsampledSearch};
use crate::dic::subset::ReferenceSubset;
use crate::dic::uncertainty::{GradientGain, NoisePool, ROUNDING};
use crate::numeric::Lanes;
use crate::results::PointStatus;

/// The maximum ratio of the second to the first peak of the quick search for which the first is accepted.
const MAX_SECOND_PEAK: f64 = 0.7;

/// The ZNCC above which the quick search is accepted without the full search.
const MIN_QUICK_ZNCC: f64 = 0.9;

/// The ratio of the second to the first peak above which both are refined and compared.
const RIVAL_PEAK: f64 = 0.75;

/// The ratio of the second to the first peak above which a second peak that cannot be refined counts as equal.
const EQUAL_PEAK: f64 = 0.9;

/// The constant part of the tolerance on 1 - ZNCC within which a second match makes the first ambiguous.
const AMBIGUOUS_DEFECT: f64 = 0.02;

/// The minimum fraction of the gradient energy in the weaker direction. Below, a subset may be a mere stripe.
const MIN_ISOTROPY: f64 = 0.05;

/// The gradient energy per pixel of white noise of unit variance by fourth-order differences.
const NOISE_GRADIENT: f64 = 0.903;

/// The ratio of gradient energy to grey-level energy above which a subset is noise rather than speckle.
const MAX_ROUGHNESS: f64 = 0.7;

/// The result of one subset before the outlier test of the field.
#[derive(Debug, Clone, Copy)]
pub(in crate::dic) struct SubsetMatch {
    pub(in crate::dic) status: PointStatus,
    pub(in crate::dic) found: Option<Match>,
    pub(in crate::dic) peak_ratio: Option<f64>,
    /// The variance of the residual, DN^2.
    pub(in crate::dic) residual: f64,
    /// The diagonal of the inverse Hessian for u and v.
    pub(in crate::dic) inverse: (f64, f64),
    /// The additional variance of u and v from the peak fit, px^2.
    pub(in crate::dic) peak_variance: (f64, f64),
}

impl SubsetMatch {
    /// Returns the result of a subset without a match.
    pub(in crate::dic) fn failed(status: PointStatus) -> Self {
        Self { status, found: None, peak_ratio: None, residual: 0.0, inverse: (0.0, 0.0), peak_variance: (0.0, 0.0) }
    }

    /// Returns the result with this status, without its match.
    fn without_match(self, status: PointStatus) -> Self {
        Self { found: None, status, ..self }
    }

    /// Returns the result with this status; its match is kept.
    fn with_status(self, status: PointStatus) -> Self {
        Self { status, ..self }
    }
}

/// An initial guess of a subset.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::dic) struct Guess {
    /// The initial warp, if one is known.
    pub(in crate::dic) warp: Option<Warp>,
    /// The minimum ZNCC of a match from the warp; below, the subset is searched.
    pub(in crate::dic) min_zncc: f64,
}

/// The planned searches of a correlator.
pub(in crate::dic) struct Searches {
    pub(in crate::dic) pixel: IntegerSearch,
    /// For `spline-fft` only.
    pub(in crate::dic) fine: Option<UpsampledSearch>,
    /// The estimator of the upsampled peak.
    pub(in crate::dic) peak_fit: PeakFit,
}

/// One subset of a pair of frames.
#[derive(Clone, Copy)]
pub(in crate::dic) struct SubsetMatcher<'a> {
    pub(in crate::dic) params: &'a CorrelationParams,
    pub(in crate::dic) window: &'a SubsetMask,
    pub(in crate::dic) subset: &'a ReferenceSubset,
    pub(in crate::dic) reference: &'a PreparedFrame,
    pub(in crate::dic) target: &'a PreparedFrame,
    /// The centre in the reference, px.
    pub(in crate::dic) at: GridPoint,
}

impl SubsetMatcher<'_> {
    /// Finds the subset in the target by the configured method, starting from the guess.
    pub(in crate::dic) fn solve(&self, searches: &mut Searches, guess: Guess) -> SubsetMatch {
        if self.params.method != Method::IcGn {
            return self.solve_peak(searches, guess.warp.as_ref());
        }
        let solution = self.solve_first_order(&mut searches.pixel, guess);
        if self.params.shape == Shape::Quadratic && solution.status == PointStatus::Valid {
            return self.refine_second_order(solution);
        }
        solution
    }

    /// Finds the first-order match; out of frame if the guess leads out of the image and nothing else matches.
    fn solve_first_order(&self, search: &mut IntegerSearch, guess: Guess) -> SubsetMatch {
        let solution = self.match_or_search(search, guess);
        let has_left_image = solution.status == PointStatus::LowCorrelation
            && guess.warp.is_some_and(|warp| !self.refiner().is_inside(&warp));
        if has_left_image { solution.without_match(PointStatus::OutOfFrame) } else { solution }
    }

    /// Refines the guess. If its ZNCC is too low, refines a peak of the quick search, then the peaks of the full
    /// search.
    ///
    /// The quick search covers displacements around zero, so it is skipped if the guess lies beyond the search range.
    /// Its peak is accepted only if it is distinct, and either its ZNCC is high or it agrees with the refined guess. A
    /// match of the full search is ambiguous if the image's edge limits the search range and the subset repeats itself.
    fn match_or_search(&self, search: &mut IntegerSearch, guess: Guess) -> SubsetMatch {
        let guessed = guess.warp.and_then(|warp| self.refiner().refine(warp).ok());
        if let Some(found) = guessed.filter(|found| found.zncc >= guess.min_zncc.max(self.params.min_zncc)) {
            return self.accept(found, None);
        }
        let around = guess.warp.map_or(Pixel::default(), |warp| self.search_center(&warp));
        if around == Pixel::default()
            && let Some(peaks) =
                search.find_near(self.subset, self.window, &self.target.levels, self.target.local(self.at))
            && peaks.second.is_none_or(|second| second.height < MAX_SECOND_PEAK * peaks.best.height)
            && let Ok(found) = self.refine_peak(&peaks, &peaks.best)
            && (found.zncc >= MIN_QUICK_ZNCC || guessed.is_some_and(|guessed| guessed.is_near(&found)))
            && found.zncc >= self.params.min_zncc
        {
            return self.accept(found, peaks.peak_ratio());
        }
        let Some(peaks) =
            search.find(self.subset, self.window, &self.target.levels, self.target.local(self.at), around)
        else {
            return SubsetMatch::failed(PointStatus::OutOfFrame);
        };
        let solution = self.refine_peaks(&peaks);
        if peaks.clipped && solution.status == PointStatus::Valid && self.repeats_itself(search) {
            return solution.with_status(PointStatus::Ambiguous);
        }
        solution
    }

    /// Whether the subset occurs twice in the reference itself, within the search range.
    ///
    /// The second peak must be more than [`EQUAL_PEAK`] times as high as the first. Replaces the surface of `search`.
    ///
    /// Near the edge of the image the true match may have left. A repetition of a regular pattern would then be
    /// accepted instead.
    fn repeats_itself(&self, search: &mut IntegerSearch) -> bool {
        let at = self.reference.local(self.at);
        let own = search.find(self.subset, self.window, &self.reference.levels, at, Pixel::default());
        own.is_some_and(|own| own.second.is_some_and(|second| second.height > EQUAL_PEAK * own.best.height))
    }

    /// Finds the subset by its correlation peak alone: the methods `spline-fft`, `peak-gaussian` and `peak-spline`.
    ///
    /// The search is centred at the integer displacement of `guess`, zero without one.
    fn solve_peak(&self, searches: &mut Searches, guess: Option<&Warp>) -> SubsetMatch {
        let Searches { pixel: search, fine, peak_fit } = searches;
        let whole = |warp: &Warp| Pixel { x: warp.u.round() as i32, y: warp.v.round() as i32 };
        let around = guess.map_or(Pixel::default(), whole);
        let Some(peaks) =
            search.find(self.subset, self.window, &self.target.levels, self.target.local(self.at), around)
        else {
            return SubsetMatch::failed(PointStatus::OutOfFrame);
        };
        let displacement = match (self.params.method, fine) {
            (Method::SplineFft, Some(fine)) => {
                let [from, to] = [self.reference, self.target]
                    .map(|frame| Subset { image: &frame.interpolated, at: frame.local(self.at) });
                fine.find(from, to, self.window, peaks.integer_displacement(), *peak_fit)
            }
            (Method::PeakSpline, _) => Some(peaks.displacement(&search.last_surface().fit_spline(&peaks.best))),
            _ => Some(peaks.displacement(&search.last_surface().fit_gaussian(&peaks.best))),
        };
        let Some((u, v)) = displacement else { return SubsetMatch::failed(PointStatus::LowContrast) };
        let ratio = peaks.peak_ratio();
        let warp = Warp::shift(u, v);
        // The first Gauss-Newton step, which is not applied, estimates the error of the peak.
        match self.refiner().gauss_newton_step(&warp) {
            Err(lost) => self.judge_refinement(Err(lost), &peaks, ratio),
            Ok((_, zncc)) if zncc < self.params.min_zncc => {
                let found = Match { warp, second: [[0.0; 3]; 2], zncc, iterations: 0 };
                SubsetMatch { found: Some(found), peak_ratio: ratio, ..SubsetMatch::failed(self.failure_status()) }
            }
            Ok((step, zncc)) => {
                let solution = self.accept(Match { warp, second: [[0.0; 3]; 2], zncc, iterations: 0 }, ratio);
                let peak_variance = (step.u * step.u, step.v * step.v);
                let alike = peaks.second.is_some_and(|second| second.height > EQUAL_PEAK * peaks.best.height);
                let repeated = peaks.clipped && self.repeats_itself(search);
                let status = if alike || repeated { PointStatus::Ambiguous } else { solution.status };
                SubsetMatch { peak_variance, ..solution }.with_status(status)
            }
        }
    }

    /// Refines a valid first-order result with the second-order shape function. If that fails, the match is dropped.
    fn refine_second_order(&self, solution: SubsetMatch) -> SubsetMatch {
        let Some(found) = solution.found else { return solution };
        match self.refiner().refine_quadratic(&found) {
            Ok(bent) if bent.found.zncc >= self.params.min_zncc => {
                let judged = self.accept(bent.found, solution.peak_ratio);
                SubsetMatch { inverse: bent.inverse, ..judged }
            }
            Ok(_) | Err(MatchError::NotConverged) => solution.without_match(PointStatus::LowCorrelation),
            Err(MatchError::OutOfFrame) => solution.without_match(PointStatus::OutOfFrame),
        }
    }

    /// Returns the integer displacement to search around: zero, or the guess if it exceeds the search range.
    fn search_center(&self, warp: &Warp) -> Pixel {
        let range = f64::from(self.params.search_px);
        if warp.u.abs() <= range && warp.v.abs() <= range {
            return Pixel::default();
        }
        let whole = |value: f64| value.round().clamp(-1e6, 1e6) as i32;
        Pixel { x: whole(warp.u), y: whole(warp.v) }
    }

    /// Returns the refiner of this subset.
    pub(in crate::dic) fn refiner(&self) -> Refiner<'_> {
        let (subset, window, shape) = (self.subset, self.window, self.params.refined_shape());
        Refiner { subset, window, shape, target: &self.target.interpolated, at: self.target.local(self.at) }
    }

    /// Refines the displacement of one correlation peak to a match.
    fn refine_peak(&self, peaks: &SearchResult, peak: &Peak) -> Result<Match, MatchError> {
        let (u, v) = peaks.displacement(peak);
        self.refiner().refine(Warp::shift(u, v))
    }

    /// Refines the best peak and its rival, if there is one, and decides between them.
    ///
    /// The rival is the second peak if it is higher than [`RIVAL_PEAK`] times the first, or if the first does not
    /// match. Two matches 1 px or more apart are ambiguous if the ZNCC of the worse is nearly as close to 1.
    fn refine_peaks(&self, peaks: &SearchResult) -> SubsetMatch {
        let refine = |peak: &Peak| self.refine_peak(peaks, peak);
        let first = refine(&peaks.best);
        let ratio = peaks.peak_ratio();
        let sound = first.is_ok_and(|found| found.zncc >= self.params.min_zncc);
        let rival = peaks.second.filter(|second| !sound || second.height > RIVAL_PEAK * peaks.best.height);
        let Some(second) = rival else {
            return self.judge_refinement(first, peaks, ratio);
        };
        let other = refine(&second);
        let (Ok(a), Ok(b)) = (first, other) else {
            let concluded = self.judge_refinement(first.or(other).or(first), peaks, ratio);
            // A rival that cannot be refined because it leaves the image is judged by its peak.
            let alike = first.is_ok()
                && other == Err(MatchError::OutOfFrame)
                && concluded.status == PointStatus::Valid
                && second.height > EQUAL_PEAK * peaks.best.height;
            return if alike { concluded.with_status(PointStatus::Ambiguous) } else { concluded };
        };
        if (a.warp.u - b.warp.u).hypot(a.warp.v - b.warp.v) < 1.0 {
            return self.judge_refinement(first, peaks, ratio);
        }
        let (best, other) = if a.zncc >= b.zncc { (a, b) } else { (b, a) };
        let ratio = (other.zncc > 0.0).then(|| best.zncc / other.zncc);
        let alike = 1.0 - other.zncc < 3.0 * (1.0 - best.zncc) + AMBIGUOUS_DEFECT;
        if alike && other.zncc >= self.params.min_zncc {
            return self.accept(best, ratio).with_status(PointStatus::Ambiguous);
        }
        self.judge_refinement(Ok(best), peaks, ratio)
    }

    /// Converts a refinement to the result of the subset.
    ///
    /// A refinement that left the image is out of frame if the peak was high enough for a match. Other failures have
    /// the status of [`Self::failure_status`].
    fn judge_refinement(
        &self,
        found: Result<Match, MatchError>,
        peaks: &SearchResult,
        peak_ratio: Option<f64>,
    ) -> SubsetMatch {
        match found {
            Ok(found) if found.zncc >= self.params.min_zncc => self.accept(found, peak_ratio),
            Ok(found) => SubsetMatch { found: Some(found), peak_ratio, ..SubsetMatch::failed(self.failure_status()) },
            Err(MatchError::OutOfFrame) if peaks.best.height > 0.7 * self.params.min_zncc => {
                SubsetMatch { peak_ratio, ..SubsetMatch::failed(PointStatus::OutOfFrame) }
            }
            Err(_) => SubsetMatch { peak_ratio, ..SubsetMatch::failed(self.failure_status()) },
        }
    }

    /// Returns the status of a failed match: a subset without texture has low contrast, others low correlation.
    fn failure_status(&self) -> PointStatus {
        if self.subset.roughness > MAX_ROUGHNESS { PointStatus::LowContrast } else { PointStatus::LowCorrelation }
    }

    /// Converts a match with a sufficient ZNCC to the result of the subset, with the variance of its residual.
    ///
    /// The status is low contrast, and the match is kept, if the subset has texture along one direction only.
    pub(in crate::dic) fn accept(&self, found: Match, peak_ratio: Option<f64>) -> SubsetMatch {
        let subset = self.subset;
        let (pixels, parameters) = (self.window.pixels as f64, self.params.refined_shape().parameter_count());
        let free = (pixels - parameters as f64 - 2.0).max(1.0);
        let residual = 2.0 * subset.energy * (1.0 - found.zncc) / free;
        let noise = NOISE_GRADIENT * 0.5 * residual.max(ROUNDING);
        let stripe = subset.isotropy < MIN_ISOTROPY && subset.weak_gradient < 2.0 * noise;
        let along_v = if parameters >= 6 { 3 } else { 1 };
        SubsetMatch {
            status: if stripe { PointStatus::LowContrast } else { PointStatus::Valid },
            found: Some(found),
            peak_ratio,
            residual,
            inverse: (subset.inverse[0][0], subset.inverse[along_v][along_v]),
            peak_variance: (0.0, 0.0),
        }
    }

    /// Adds the texture, the residual and the gradient gain of a match to the noise pool. `residual` is scratch memory.
    ///
    /// Does nothing without a match or a residual.
    pub(in crate::dic) fn add_to_pool(&self, solution: &SubsetMatch, residual: &mut Vec<Lanes>, pool: &mut NoisePool) {
        let Some(found) = solution.found else { return };
        match self.params.refined_shape() {
            Shape::Quadratic => self.refiner().quadratic_residual(&found, residual),
            _ => self.refiner().residual(&found.warp, residual),
        }
        if !residual.is_empty() {
            pool.add_window(self.subset, self.window, residual);
            pool.add_gradient_gain(GradientGain::from_subset(self.reference, self.window, self.at));
        }
    }
}
