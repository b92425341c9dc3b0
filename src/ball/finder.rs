//! The ball finder: searches the outline of a ball from scratch or near a prediction.

use super::Polarity;
use super::annulus::BAND_PX;
use super::change_search::ChangeSearch;
use super::effort::{Effort, FIRST, QUICK, THOROUGH};
use super::hough::{HoughPeak, HoughSearch, Marks};
use super::mirror::{find_original, is_mirrored};
use super::paper_hough::PaperHough;
use super::params::{BallError, BallParams, MIN_EDGE_RADIUS_PX, OutlineMethod, Presence, RADIUS_ALLOWANCE_PX};
use super::ransac::{Candidate, Ransac, RansacParams, RoughCircle, rim_polarity};
use super::subpixel_fit::{CERTAIN_INLIERS, MAX_SHIFT_PX, Measured, SubpixelFit};
use super::texture_disc::RadiusRange;
use super::textured::TexturedSearch;
use crate::image::{ImageView, PixelRect};
use crate::results::Circle;

/// The minimum support of a circle that is measured.
const MIN_SUPPORT: f32 = 0.22;
/// The distance below which two circles count as one, px.
const DISTINCT_PX: f32 = 3.0;
/// The number of candidates that are examined closely.
const FINALISTS: usize = 8;
/// The increase of the radius in a second search around the best candidates, px.
///
/// Speckle near the rim can make a smaller circle win.
const ENLARGED_BY_PX: f32 = 5.0;
/// The search for an outline outside a candidate's rim.
const ENLARGED: RansacParams = RansacParams { reach_px: ENLARGED_BY_PX, tolerance_px: 0.7, draws: 60, rays: 120 };
/// The minimum ratio of the support of a ball to that of any other candidate.
const MIN_SUPPORT_RATIO: f32 = 1.3;
/// The ratio of supports from which no other candidate can be the ball.
const CLEAR_SUPPORT_RATIO: f32 = 1.8;
/// The inlier fraction that makes a clear leader certain.
const MIN_CLEAR_INLIERS: f64 = 0.2;
/// The support from which a candidate is accurate to a pixel or two.
const GOOD_SUPPORT: f32 = 0.5;
/// The number of candidates that mostly include the ball.
const LIKELY_CANDIDATES: usize = 2;
/// The number of peaks whose rim is searched in the filtered image.
const FILTERED_PEAKS: usize = 8;
/// The maximum error of a Hough peak, px.
const REACH_PX: f32 = 7.0;
/// The maximum error of a prediction in a search, px.
const FOLLOW_REACH_PX: f32 = 5.0;
/// The uncertainty of the centre from which an outline was found by its texture, px. That by edges is far smaller.
const MIN_TEXTURED_SIGMA_PX: f64 = 0.15;
/// The maximum error of a prediction that needs no search, px.
const PREDICTION_REACH_PX: f64 = 1.0;

const CLOSE: RansacParams = RansacParams { reach_px: 4.0, tolerance_px: 0.6, draws: 120, rays: 120 };

/// Finds one ball per image: its outline to a few hundredths of a pixel.
///
/// The result is a pure function of the image; only scratch memory is kept. The steps are:
/// 1. Gradients vote for centres on a reduced image (a Hough transform with direction and polarity). If needed, small
///    marks are removed first.
/// 2. RANSAC ranks circles by their rim of one sign.
/// 3. A blurred step is fitted to the raw pixels of every bin of the rim, and a robust circle to these steps.
/// 4. If no sign prevails along the rim, the ball is searched by its difference from a plain ground, then by its texture, and
///    the outline by the boundary of that.
///
/// A ball with too little visible rim is refused.
#[derive(Debug)]
pub struct BallFinder {
    params: BallParams,
    shape: (usize, usize),
    hough: HoughSearch,
    peaks: Vec<HoughPeak>,
    candidates: Vec<Candidate>,
    ransac: Ransac,
    fit: SubpixelFit,
    textured: TexturedSearch,
    changes: ChangeSearch,
    paper_hough: PaperHough,
}

impl BallFinder {
    /// The distance outside the predicted circle that [`follow`](Self::follow) reads, px.
    ///
    /// The search and the subpixel fit each move the centre and the radius by at most their reach. They read pixels
    /// up to the width of the annulus beyond.
    pub const FOLLOW_RANGE_PX: f64 = 2.0 * (FOLLOW_REACH_PX as f64 + MAX_SHIFT_PX) + 2.0 * BAND_PX + 4.0;

    /// The distance outside the predicted circle that [`follow_closely`](Self::follow_closely) reads, px.
    pub const CLOSE_RANGE_PX: f64 = 2.0 * PREDICTION_REACH_PX + BAND_PX + 2.0;

    /// Plans a finder for images of `width_px` x `height_px` pixels.
    ///
    /// # Errors
    ///
    /// Returns [`BallError::Range`] with the name, the value and the range of a parameter out of its range.
    pub fn new(params: &BallParams, width_px: usize, height_px: usize) -> Result<Self, BallError> {
        params.check(width_px, height_px)?;
        Ok(Self {
            params: params.clone(),
            shape: (width_px, height_px),
            hough: HoughSearch::new(&params.for_edges(), width_px, height_px),
            peaks: Vec::new(),
            candidates: Vec::new(),
            ransac: Ransac::default(),
            fit: SubpixelFit::default(),
            textured: TexturedSearch::default(),
            changes: ChangeSearch::default(),
            paper_hough: PaperHough::default(),
        })
    }

    /// Finds the ball anywhere in the searched region.
    ///
    /// Returns `None` if there is no ball, or none that can be measured.
    ///
    /// # Panics
    ///
    /// If the size of `image` differs from the planned size.
    pub fn find(&mut self, image: ImageView<'_>) -> Option<Circle> {
        self.check_shape(image);
        if image.width() < 8 || image.height() < 8 || !self.params.may_have_edges() {
            return None;
        }
        let circle = self.search_everywhere(image)?;
        let circle = self.original_of(image, circle)?;
        self.apply_method(image, circle)
    }

    /// Returns the ball that was found, or whose mirror image was found; `None` if that cannot be measured.
    fn original_of(&mut self, image: ImageView<'_>, circle: Circle) -> Option<Circle> {
        let Some(outward) = self.params.outward else { return Some(circle) };
        let Some(place) = find_original(image, &circle, outward) else { return Some(circle) };
        let original = self.search_around(image, place)?;
        is_mirrored(&circle, &original, outward).then_some(original)
    }

    /// Searches the outline in the whole region by its edges, with increasing effort, and finally by ground and texture.
    fn search_everywhere(&mut self, image: ImageView<'_>) -> Option<Circle> {
        self.hough.reduce(image);
        self.peaks.clear();
        self.hough.search(&mut self.peaks);
        // Mostly marks need not be removed, and one of the first peaks is the ball.
        if let Some(circle) = self.find_in_first_pass(image) {
            return Some(circle);
        }
        self.rank_peaks(image, QUICK);
        let min_inliers = if self.exceeds_others_by(CLEAR_SUPPORT_RATIO) { MIN_CLEAR_INLIERS } else { CERTAIN_INLIERS };
        self.candidates.truncate(LIKELY_CANDIDATES);
        if let Some(circle) = self.first_certain(image, min_inliers) {
            return Some(circle);
        }
        self.hough.search_without_marks(Marks::Dark, &mut self.peaks);
        if let Some(circle) = self.find_best_candidate(image, QUICK) {
            return Some(circle);
        }
        if let Some(circle) = self.find_best_candidate(image, THOROUGH) {
            return Some(circle);
        }
        self.peaks.clear();
        self.hough.search_without_marks(Marks::Bright, &mut self.peaks);
        let found =
            self.find_best_candidate(image, QUICK).or_else(|| self.changes.find_on_plain_ground(image, &self.params));
        found.or_else(|| self.search_textured(image))
    }

    /// Finds the ball in the difference of an image from its background, DN, by what has changed.
    ///
    /// A ball too small for its outline is found as a point. Returns `None` if nothing of the size of the ball has changed,
    /// or if its rim does not determine a circle.
    ///
    /// # Panics
    ///
    /// If the size of `difference` differs from the planned size.
    pub fn find_changed(&mut self, difference: ImageView<'_>) -> Option<Circle> {
        self.check_shape(difference);
        if difference.width() < 8 || difference.height() < 8 {
            return None;
        }
        self.changes.find(difference, &self.params)
    }

    /// Returns the region in which the ball is searched.
    fn searched_region(&self, image: ImageView<'_>) -> PixelRect {
        self.params.region(image.width(), image.height())
    }

    /// Searches the ball by its texture, and the outline by the boundary of that texture.
    fn search_textured(&mut self, image: ImageView<'_>) -> Option<Circle> {
        let circle = self.textured.find(image, self.searched_region(image), &self.radius_ranges())?;
        self.has_allowed_radius(&circle).then_some(circle)
    }

    /// Returns the ranges of radii for the search by texture, the most likely first.
    fn radius_ranges(&self) -> Vec<RadiusRange> {
        let (low, high) = (self.params.min_radius_px, self.params.max_radius_px);
        let expected = self.params.expected_radius_within(RadiusRange { low, high });
        let narrow = expected.map(|radius| {
            let about = RadiusRange::about(radius);
            RadiusRange { low: about.low.max(low), high: about.high.min(high) }
        });
        narrow.into_iter().chain(self.hough.radius_ranges()).collect()
    }

    /// Finds the ball near `near`: a prediction within a few pixels, with the known radius.
    ///
    /// Much faster than [`find`](Self::find). Returns `None` if it is not there; then search from scratch.
    ///
    /// # Panics
    ///
    /// If the size of `image` differs from the planned size.
    pub fn follow(&mut self, image: ImageView<'_>, near: &Circle) -> Option<Circle> {
        self.follow_closely(image, near, Presence::Uncertain).or_else(|| self.search_near(image, near))
    }

    /// Finds the ball only within a pixel of `near`, and only if the result is certain.
    ///
    /// If its presence there is certain, any circle that its edges determine is accepted. Otherwise enough of the rim must agree to
    /// exclude a better circle elsewhere.
    ///
    /// # Panics
    ///
    /// If the size of `image` differs from the planned size.
    pub fn follow_closely(&mut self, image: ImageView<'_>, near: &Circle, presence: Presence) -> Option<Circle> {
        let near = self.valid_prediction(image, near)?;
        let min_inliers = match presence {
            Presence::Certain => 0.0,
            Presence::Uncertain => CERTAIN_INLIERS,
        };
        let circle = self.fit_prediction(image, near, min_inliers)?;
        self.apply_method(image, circle)
    }

    /// Searches the ball near `near` after [`follow_closely`](Self::follow_closely) failed.
    ///
    /// # Panics
    ///
    /// If the size of `image` differs from the planned size.
    pub fn search_near(&mut self, image: ImageView<'_>, near: &Circle) -> Option<Circle> {
        let is_by_texture = near.sigma_center_px > MIN_TEXTURED_SIGMA_PX;
        let near = self.valid_prediction(image, near)?;
        let circle = self.search_around(image, near).or_else(|| {
            // Where the edges of a ball were found before, something has changed if they are not.
            let near = Some(near).filter(|_| is_by_texture)?;
            let circle = self.textured.follow(image, near)?;
            self.has_allowed_radius(&circle).then_some(circle)
        })?;
        self.apply_method(image, circle)
    }

    /// Returns the predicted circle if it can be searched.
    fn valid_prediction(&self, image: ImageView<'_>, near: &Circle) -> Option<RoughCircle> {
        self.check_shape(image);
        let near = RoughCircle { x: near.x_px as f32, y: near.y_px as f32, radius: near.radius_px as f32 };
        let is_finite = near.x.is_finite() && near.y.is_finite() && near.radius.is_finite();
        let has_edges =
            self.params.may_have_edges() && f64::from(near.radius) >= MIN_EDGE_RADIUS_PX - RADIUS_ALLOWANCE_PX;
        (image.width() >= 8 && image.height() >= 8 && is_finite && has_edges).then_some(near)
    }

    /// Searches the outline near a prediction by its edges.
    fn search_around(&mut self, image: ImageView<'_>, near: RoughCircle) -> Option<Circle> {
        let params = RansacParams { reach_px: FOLLOW_REACH_PX, tolerance_px: 0.7, draws: 60, rays: 120 };
        let candidate = self.ransac.search(image, near, params)?;
        if let Some(measured) = self.measure_candidate(image, &candidate) {
            return Some(measured.circle);
        }
        // If speckle outnumbers the rim, the prediction itself may be the better candidate.
        [Polarity::Brighter, Polarity::Darker].into_iter().find_map(|polarity| {
            let candidate = Candidate::at(near, polarity);
            self.measure_candidate(image, &candidate).map(|m| m.circle)
        })
    }

    /// Fits the outline at its prediction; accepts it above an inlier fraction of `min_inliers`.
    fn fit_prediction(&mut self, image: ImageView<'_>, near: RoughCircle, min_inliers: f64) -> Option<Circle> {
        let candidate = Candidate::at(near, rim_polarity(image, near)?);
        let measured = self.fit.fit_prediction(image, &candidate, PREDICTION_REACH_PX)?;
        self.accept_measured(measured, min_inliers)
    }

    /// Fits the outline at an examined candidate; accepts it above an inlier fraction of `min_inliers`.
    fn fit_examined(&mut self, image: ImageView<'_>, candidate: &Candidate, min_inliers: f64) -> Option<Circle> {
        if candidate.support < MIN_SUPPORT {
            return None;
        }
        let measured = self.fit.fit_examined(image, candidate, PREDICTION_REACH_PX)?;
        self.accept_measured(measured, min_inliers)
    }

    /// Returns a measured circle with more than `min_inliers` of inliers (a fraction) and an allowed radius.
    fn accept_measured(&self, measured: Measured, min_inliers: f64) -> Option<Circle> {
        (measured.inlier_fraction > min_inliers && self.has_allowed_radius(&measured.circle)).then_some(measured.circle)
    }

    /// Applies the outline method to a circle found by its edges.
    fn apply_method(&mut self, image: ImageView<'_>, circle: Circle) -> Option<Circle> {
        match self.params.outline {
            OutlineMethod::Edges => Some(circle),
            OutlineMethod::Marked => self.paper_hough.find_circle(image, &circle),
        }
    }

    /// Checks the size of an image.
    ///
    /// # Panics
    ///
    /// If it differs from the planned size.
    fn check_shape(&self, image: ImageView<'_>) {
        assert_eq!((image.width(), image.height()), self.shape, "the finder was planned for another image shape");
    }

    /// Returns the number of Hough peaks that a pass examines.
    fn peak_count(&self, effort: Effort) -> usize {
        if self.hough.band_count() > 1 { effort.peaks_of_bands } else { effort.peaks }
    }

    /// Replaces the candidates by the best circles near the peaks, ranked by their rim.
    fn rank_peaks(&mut self, image: ImageView<'_>, effort: Effort) {
        self.candidates.clear();
        self.peaks.sort_by(|a, b| b.score.total_cmp(&a.score));
        for peak in self.peaks.iter().take(self.peak_count(effort)) {
            let reach_px = (peak.spread + 3.0).max(REACH_PX);
            let params =
                RansacParams { reach_px, tolerance_px: effort.tolerance_px, draws: effort.draws, rays: effort.rays };
            let rough = RoughCircle { x: peak.x, y: peak.y, radius: peak.radius };
            self.candidates.extend(self.ransac.search(image, rough, params));
        }
        self.keep_finalists();
    }

    /// Whether the first candidate has more than `factor` times the support of any other.
    fn exceeds_others_by(&self, factor: f32) -> bool {
        let support = |index: usize| self.candidates.get(index).map_or(0.0, |candidate| candidate.support);
        support(0) > factor * support(1).max(MIN_SUPPORT)
    }

    /// Searches the ball in the first pass only.
    ///
    /// `None` if no candidate has far more support than the others, or too few of its edges are inliers.
    fn find_in_first_pass(&mut self, image: ImageView<'_>) -> Option<Circle> {
        self.rank_peaks(image, FIRST);
        // Other peaks may hold another candidate, unless their scores are far lower, too.
        let examined = self.peak_count(FIRST);
        let score = |index: usize| self.peaks.get(index).map_or(0.0, |peak| peak.score);
        let is_alone = self.exceeds_others_by(CLEAR_SUPPORT_RATIO) && score(0) > CLEAR_SUPPORT_RATIO * score(examined);
        let candidate = self.candidates.first().copied().filter(|_| self.exceeds_others_by(MIN_SUPPORT_RATIO))?;
        let candidate = self.examine(image, candidate);
        self.fit_examined(image, &candidate, if is_alone { MIN_CLEAR_INLIERS } else { CERTAIN_INLIERS })
    }

    /// Examines the candidates closely and returns the first certain one, which mostly is among the first.
    ///
    /// `min_inliers` is the required inlier fraction.
    fn first_certain(&mut self, image: ImageView<'_>, min_inliers: f64) -> Option<Circle> {
        for i in 0..self.candidates.len() {
            self.candidates[i] = self.examine(image, self.candidates[i]);
            if i < LIKELY_CANDIDATES
                && let Some(measured) = self.measure_candidate(image, &self.candidates[i].clone())
                && measured.inlier_fraction > min_inliers
            {
                return Some(measured.circle);
            }
        }
        None
    }

    /// Finds the ball among the Hough peaks.
    ///
    /// Returns the first certain candidate. Otherwise candidates from filtered rims and with enlarged radii are added,
    /// and the circle with the highest inlier fraction is returned; `None` if no candidate can be measured.
    fn find_best_candidate(&mut self, image: ImageView<'_>, effort: Effort) -> Option<Circle> {
        self.rank_peaks(image, effort);
        if let Some(circle) = self.first_certain(image, CERTAIN_INLIERS) {
            return Some(circle);
        }
        if effort.filtered_rims {
            self.search_filtered_rims(image);
        }
        self.keep_finalists();
        self.search_enlarged(image, effort.enlarged_candidates);
        self.keep_finalists();
        self.measure_finalists(image)
    }

    /// Adds candidates from outside the rims of the best `count`, which may be rings on the ball.
    fn search_enlarged(&mut self, image: ImageView<'_>, count: usize) {
        for i in 0..self.candidates.len().min(count) {
            let candidate = self.candidates[i];
            let outer = Candidate { radius: candidate.radius + ENLARGED_BY_PX, ..candidate };
            let Some(found) = self.ransac.search_again(image, &outer, ENLARGED) else { continue };
            self.candidates.extend(self.ransac.search_again(image, &found, CLOSE));
        }
    }

    /// Measures all candidates up to the first certain one, and returns the circle with the highest inlier fraction.
    fn measure_finalists(&mut self, image: ImageView<'_>) -> Option<Circle> {
        let mut best: Option<Measured> = None;
        for i in 0..self.candidates.len() {
            let candidate = self.candidates[i];
            let Some(measured) = self.measure_candidate(image, &candidate) else { continue };
            if best.is_none_or(|b| measured.inlier_fraction > b.inlier_fraction) {
                best = Some(measured);
            }
            if measured.inlier_fraction > CERTAIN_INLIERS {
                break;
            }
        }
        best.map(|b| b.circle)
    }

    /// Searches a candidate again with all rays. Returns it with zero support if no circle is found.
    fn examine(&mut self, image: ImageView<'_>, candidate: Candidate) -> Candidate {
        let wide = RansacParams { reach_px: REACH_PX, tolerance_px: 0.7, ..CLOSE };
        let is_near = candidate.support > GOOD_SUPPORT;
        let candidate =
            if is_near { candidate } else { self.ransac.search_again(image, &candidate, wide).unwrap_or(candidate) };
        self.ransac.search_again(image, &candidate, CLOSE).unwrap_or(Candidate { support: 0.0, ..candidate })
    }

    /// Adds candidates from the rims of the image without small marks.
    ///
    /// If more than half of a rim is speckle, steps inside the ball outnumber those of the rim.
    fn search_filtered_rims(&mut self, image: ImageView<'_>) {
        for peak in self.peaks.iter().take(FILTERED_PEAKS) {
            let (grey, scale) = self.hough.filtered_image(peak);
            let Some(view) = grey.view() else { continue };
            let (x, y) = self.hough.to_reduced(peak.band, peak.x, peak.y);
            let reach_px = (peak.spread / scale + 2.0).max(3.0);
            let params = RansacParams { reach_px, tolerance_px: 0.5, draws: 120, rays: 120 };
            let rough = RoughCircle { x, y, radius: peak.radius / scale };
            let Some(reduced) = self.ransac.search(view, rough, params) else { continue };
            let (x, y) = self.hough.to_full(peak.band, reduced.x, reduced.y);
            let full = Candidate { x, y, radius: reduced.radius * scale, ..reduced };
            let near = RansacParams { reach_px: 2.5, tolerance_px: 0.6, draws: 120, rays: 120 };
            self.candidates.extend(self.ransac.search_again(image, &full, near));
        }
    }

    /// Keeps the best distinct candidates, best first.
    fn keep_finalists(&mut self) {
        self.candidates.sort_by(|a, b| b.support.total_cmp(&a.support));
        let mut kept: usize = 0;
        for i in 0..self.candidates.len() {
            let candidate = self.candidates[i];
            let same = |g: &Candidate| {
                let apart = [g.x - candidate.x, g.y - candidate.y, g.radius - candidate.radius];
                g.polarity == candidate.polarity && apart.iter().all(|d| d.abs() < DISTINCT_PX)
            };
            if kept < FINALISTS && !self.candidates[..kept].iter().any(same) {
                self.candidates[kept] = candidate;
                kept += 1;
            }
        }
        self.candidates.truncate(kept);
    }

    /// Measures the circle of a candidate; `None` if its support is too low or its rim does not determine a circle.
    fn measure_candidate(&mut self, image: ImageView<'_>, candidate: &Candidate) -> Option<Measured> {
        if candidate.support < MIN_SUPPORT {
            return None;
        }
        self.fit.fit_candidate(image, candidate).filter(|measured| self.has_allowed_radius(&measured.circle))
    }

    /// Whether the radius of a circle lies in the searched range.
    fn has_allowed_radius(&self, circle: &Circle) -> bool {
        let low = self.params.min_radius_px.max(MIN_EDGE_RADIUS_PX) - RADIUS_ALLOWANCE_PX;
        (low..=self.params.max_radius_px + RADIUS_ALLOWANCE_PX).contains(&circle.radius_px)
    }
}
