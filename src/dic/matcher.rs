//! How one subset is found, and how far its answer can be believed.

use super::Shape;
use super::fft::{Found, Search};
use super::fine::FineSearch;
use super::params::{CorrelationParams, Method};
use super::peak::Peak;
use super::prepared::Prepared;
use super::refine::{Lost, Match, Refiner};
use super::sigma::ROUNDING;
use super::subset::Subset;
use super::warp::Warp;
use super::window::Window;
use crate::results::PointStatus;

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

/// What became of one subset before the field is looked at as a whole.
#[derive(Debug, Clone, Copy)]
pub(super) struct Solution {
    pub(super) status: PointStatus,
    pub(super) found: Option<Match>,
    pub(super) peak_ratio: Option<f64>,
    /// Variance of the residual, DN^2.
    pub(super) residual: f64,
    /// Diagonal of the inverse Hessian for u and v.
    pub(super) inverse: (f64, f64),
    /// Variance of u and v besides the noise, px^2: what a peak fit leaves.
    pub(super) doubt: (f64, f64),
}

impl Solution {
    pub(super) fn failed(status: PointStatus) -> Self {
        Self { status, found: None, peak_ratio: None, residual: 0.0, inverse: (0.0, 0.0), doubt: (0.0, 0.0) }
    }

    fn without_answer(self, status: PointStatus) -> Self {
        Self { found: None, status, ..self }
    }

    fn with_status(self, status: PointStatus) -> Self {
        Self { status, ..self }
    }
}

/// The searches a correlator has planned.
pub(super) struct Searches {
    pub(super) pixel: Search,
    /// For `spline-fft` only.
    pub(super) fine: Option<FineSearch>,
    /// Whether the fine peak is fitted.
    pub(super) peak_fit: bool,
}

/// One subset of one pair of frames.
#[derive(Clone, Copy)]
pub(super) struct Matcher<'a> {
    pub(super) params: &'a CorrelationParams,
    pub(super) window: &'a Window,
    pub(super) subset: &'a Subset,
    pub(super) reference: &'a Prepared,
    pub(super) target: &'a Prepared,
    /// Centre in the reference, px.
    pub(super) at: (u32, u32),
}

impl Matcher<'_> {
    /// Finds the subset, near `guess` if there is one.
    pub(super) fn solve(&self, searches: &mut Searches, guess: Option<Warp>, least: f64) -> Solution {
        if self.params.method != Method::IcGn {
            return self.solve_peak(searches, guess.as_ref());
        }
        let solution = self.solve_first_order(&mut searches.pixel, guess, least);
        if self.params.shape == Shape::Quadratic && solution.status == PointStatus::Valid {
            return self.bend(solution);
        }
        solution
    }

    /// By the guess if it leads to a ZNCC of `least`, else by search.
    fn solve_first_order(&self, search: &mut Search, guess: Option<Warp>, least: f64) -> Solution {
        let solution = self.solve_anew(search, guess, least);
        // What should lie outside and is found nowhere else has left.
        let left =
            solution.status == PointStatus::LowCorrelation && guess.is_some_and(|warp| !self.refiner().inside(&warp));
        if left { solution.without_answer(PointStatus::OutOfFrame) } else { solution }
    }

    /// By the guess, else by the quick search, else by the full one.
    fn solve_anew(&self, search: &mut Search, guess: Option<Warp>, least: f64) -> Solution {
        let guessed = guess.and_then(|warp| self.refiner().refine(warp).ok());
        if let Some(found) = guessed.filter(|found| found.zncc >= least.max(self.params.min_zncc)) {
            return self.judge(found, None);
        }
        let around = guess.map_or((0, 0), |warp| self.search_center(&warp));
        if around == (0, 0)
            && let Some(peaks) =
                search.find_near(self.subset, self.window, &self.target.levels, self.target.local(self.at))
            && peaks.second.is_none_or(|second| second.height < CLEAR * peaks.best.height)
            && let Ok(found) = self.refine_peak(&peaks, &peaks.best)
            && (found.zncc >= SURE || guessed.is_some_and(|guessed| guessed.is_near(&found)))
            && found.zncc >= self.params.min_zncc
        {
            return self.judge(found, peaks.ratio());
        }
        let Some(peaks) =
            search.find(self.subset, self.window, &self.target.levels, self.target.local(self.at), around)
        else {
            return Solution::failed(PointStatus::OutOfFrame);
        };
        let solution = self.refine_peaks(&peaks);
        if peaks.clipped && solution.status == PointStatus::Valid && self.repeats_itself(search) {
            return solution.with_status(PointStatus::Ambiguous);
        }
        solution
    }

    /// Whether the subset has a double in the reference itself.
    ///
    /// Near the edge of the image the true match may have left it; then one of a
    /// regular pattern's repetitions would pass for it.
    fn repeats_itself(&self, search: &mut Search) -> bool {
        let at = self.reference.local(self.at);
        let own = search.find(self.subset, self.window, &self.reference.levels, at, (0, 0));
        own.is_some_and(|own| own.second.is_some_and(|second| second.height > RIVAL_HEIGHT * own.best.height))
    }

    /// Finds one subset by a correlation peak alone.
    fn solve_peak(&self, searches: &mut Searches, guess: Option<&Warp>) -> Solution {
        let Searches { pixel: search, fine, peak_fit } = searches;
        let around = guess.map_or((0, 0), |warp| (warp.u.round() as i32, warp.v.round() as i32));
        let Some(peaks) =
            search.find(self.subset, self.window, &self.target.levels, self.target.local(self.at), around)
        else {
            return Solution::failed(PointStatus::OutOfFrame);
        };
        let displacement = match (self.params.method, fine) {
            (Method::SplineFft, Some(fine)) => {
                let frames = (&self.reference.splined, &self.target.splined);
                let at = (self.reference.local(self.at), self.target.local(self.at));
                fine.find(frames, self.window, at, peaks.whole(), *peak_fit)
            }
            (Method::PeakSpline, _) => Some(peaks.offset(search.spline_top(&peaks))),
            _ => Some(peaks.offset(search.gaussian_top(&peaks))),
        };
        let Some((u, v)) = displacement else { return Solution::failed(PointStatus::LowContrast) };
        let ratio = peaks.ratio();
        let warp = Warp::shift(u, v);
        // One step of the refinement, not taken, tells how far off the peak is.
        match self.refiner().step(&warp) {
            Err(lost) => self.settle(Err(lost), &peaks, ratio),
            Ok((_, zncc)) if zncc < self.params.min_zncc => {
                let found = Match { warp, second: [[0.0; 3]; 2], zncc, iterations: 0 };
                Solution { found: Some(found), peak_ratio: ratio, ..Solution::failed(self.unlike()) }
            }
            Ok((step, zncc)) => {
                let solution = self.judge(Match { warp, second: [[0.0; 3]; 2], zncc, iterations: 0 }, ratio);
                let doubt = (step.u * step.u, step.v * step.v);
                let alike = peaks.second.is_some_and(|second| second.height > RIVAL_HEIGHT * peaks.best.height);
                let repeated = peaks.clipped && self.repeats_itself(search);
                let status = if alike || repeated { PointStatus::Ambiguous } else { solution.status };
                Solution { doubt, ..solution }.with_status(status)
            }
        }
    }

    /// The second-order answer from a valid first-order one.
    fn bend(&self, solution: Solution) -> Solution {
        let Some(found) = solution.found else { return solution };
        match self.refiner().refine_quadratic(&found) {
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

    /// The refinement of this subset.
    pub(super) fn refiner(&self) -> Refiner<'_> {
        let (subset, window, shape) = (self.subset, self.window, self.params.refined_shape());
        Refiner { subset, window, shape, target: &self.target.splined, at: self.target.local(self.at) }
    }

    /// Refines one peak.
    fn refine_peak(&self, peaks: &Found, peak: &Peak) -> Result<Match, Lost> {
        let (u, v) = peaks.displacement(peak);
        self.refiner().refine(Warp::shift(u, v))
    }

    /// Refines the best peak, and its rival where there is one; decides between them.
    fn refine_peaks(&self, peaks: &Found) -> Solution {
        let refine = |peak: &Peak| self.refine_peak(peaks, peak);
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
    pub(super) fn judge(&self, found: Match, peak_ratio: Option<f64>) -> Solution {
        let subset = self.subset;
        let (pixels, parameters) = (self.window.pixels as f64, self.params.refined_shape().parameters());
        let free = (pixels - parameters as f64 - 2.0).max(1.0);
        let residual = 2.0 * subset.energy * (1.0 - found.zncc) / free;
        let noise = NOISE_GRADIENT * 0.5 * residual.max(ROUNDING);
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
}
