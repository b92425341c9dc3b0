//! The subpixel fit: from a circle accurate to a pixel to one accurate to a few hundredths.

mod acceptance;

use self::acceptance::{FEW_INLIERS, Support};
use super::RimKind;
use super::annulus::{Annulus, ClippedPixels, Outline, SLACK_PX};
use super::circle_fit::{CircleFit, Correction};
use super::edge_fit::{Edge, EdgeSearch, fit_edges};
use super::edge_selection::{CleanContrast, EdgeSelection};
use super::limb_darkening::{LimbDarkening, SECTORS, Shift, Step, VisibleRim, edge_shift};
use super::ransac::Candidate;
use super::side_light::SideLight;
use super::visible_fraction::{RimBin, fraction_in_image, unoccluded_fraction};
use crate::image::ImageView;
use crate::results::Circle;

/// The maximum number of rounds of gathering and fitting.
const MAX_ROUNDS: usize = 6;
/// The change of the circle at which the rounds have converged, px.
const CONVERGED_PX: f64 = 0.003;
/// The same near an accurate start, px.
///
/// The next round would move the circle a quarter as far; the noise of a circle is ten times that.
const NEAR_CONVERGED_PX: f64 = 0.01;
/// The distance within which the pixels gathered around another circle are as good, px.
const REGATHER_PX: f64 = 0.1;
/// The blur of a lens in focus, where the search for the blur starts, px.
const USUAL_BLUR_PX: f32 = 0.8;
const BLUR_RANGE_PX: std::ops::RangeInclusive<f32> = 0.35..=2.0;
/// The maximum shift from the start, px; an outline that moves farther was not the ball's.
pub(super) const MAX_SHIFT_PX: f64 = 4.0;
/// The inlier fraction from which no other place can be the ball.
pub(super) const CERTAIN_INLIERS: f64 = 0.3;
/// The factor from the covariance of the fit to the observed error, and its growth with the occluded fraction.
///
/// Bartlett's window misses a part of the correlation of neighbours. Texture and shading are correlated over longer
/// arcs, the more so the less of the rim is visible. The factors come from 3600 hard scenes: bright and dark, discs
/// and spheres, 0 to 40 % occluded.
const CENTER_FACTOR: f64 = 1.12;
const CENTER_FACTOR_OCCLUDED: f64 = 0.5;
const RADIUS_FACTOR: f64 = 0.95;
const RADIUS_FACTOR_OCCLUDED: f64 = 0.95;
/// The growth of the uncertainties of centre and radius with the outlier fraction, for edges selected by contrast.
///
/// The outliers are marks at a bright rim, all of which pull inwards.
const OUTLIER_FACTORS: [f64; 2] = [2.0, 4.5];
/// The factors of the uncertainties of centre and radius if speckles line the rim.
const SPECKLED_FACTORS: [f64; 2] = [1.12, 2.0];
/// The factors of the uncertainties of centre and radius if light and shade change the contrast along the rim, and what
/// they add, px: a limb that darkens pulls the edges of faint contrast in, all of a side together.
const SHADED_FACTORS: [f64; 2] = [2.0, 3.0];
const SHADED_SIGMA_PX: [f64; 2] = [0.15, 0.3];
/// The maximum uncertainty of the centre of such a rim, px; texture places a ball better than that.
const MAX_SHADED_SIGMA_PX: f64 = 0.25;
/// The minimum radius of a ball for such a rim, px; of a smaller one, the shade changes within the annulus.
const MIN_SHADED_RADIUS_PX: f32 = 18.0;
/// The uncertainty of the centre up to which the clean parts of a rim are enough, px.
const GOOD_SIGMA_PX: f64 = 0.04;
const MIN_CENTER_SIGMA_PX: f64 = 0.005;
const MIN_RADIUS_SIGMA_PX: f64 = 0.006;
/// The minimum fraction of a sector's rim that makes the sector visible.
const MIN_VISIBLE_RIM: f64 = 0.15;
/// The uncertainty of centre and radius per clipped fraction of the contrast, px.
///
/// If the brighter side of the rim exceeds the range of the pixels, the edges are known by their darker side only.
const CLIPPED_SIGMA_PX: [f64; 2] = [0.3, 1.3];
/// The maximum clipped fraction of the contrast.
const MAX_CLIPPED_FRACTION: f64 = 0.3;
/// The uncertainty of centre and radius if clipped pixels are used as they are, px.
///
/// An exposure up to four times too long moves edges away from clipped pixels by up to 1 px.
const INCLUDED_CLIPPED_SIGMA_PX: [f64; 2] = [0.15, 0.7];
/// The maximum uncertainty, before these factors, px.
const MAX_SIGMA_PX: f64 = 0.09;
/// The maximum uncertainty for few inliers, and for a mostly visible rim, px.
///
/// A ball with a mostly visible rim may not be round. At 0.09 px, 51 of 60 balls stretched by 1.2 %, as by a rolling
/// shutter, were refused.
const MAX_SIGMA_OF_FEW_PX: f64 = 0.07;
const MAX_SIGMA_VISIBLE_PX: f64 = 0.15;
const MOSTLY_VISIBLE: f64 = 0.75;

/// The scatter of the clean parts of a rim from which the rim may be lined with speckles, px.
///
/// Then all of the rim, in a narrower annulus, gives a better circle.
const MIN_SPECKLED_SCATTER_PX: f64 = 0.15;
/// The minimum fraction of a speckled rim with an edge of its sign.
const MIN_SPECKLED_EDGES: f64 = 0.5;
/// An accepted outline.
#[derive(Debug, Clone, Copy)]
pub(super) struct Measured {
    pub circle: Circle,
    /// The fraction of the rim inside the image that agrees with the circle, 0 to 1.
    pub inlier_fraction: f64,
    /// The robust scatter of the edges about the circle, px.
    pub scatter_px: f64,
}

impl Measured {
    /// Whether this outline has a more certain centre than the other, and more edges that agree.
    fn improves_on(&self, other: &Self) -> bool {
        self.circle.sigma_center_px < other.circle.sigma_center_px && self.inlier_fraction > other.inlier_fraction
    }
}

/// The effort of a fit.
#[derive(Debug, Clone, Copy)]
struct Effort {
    /// The steps of the edge fit and of the reweighting in the first round.
    first: (usize, usize),
    /// The same in each later round.
    later: (usize, usize),
    min_rounds: usize,
    /// The change of the outline at which later rounds have converged, px.
    converged_px: f64,
    /// The distance within which gathered pixels are kept, px.
    regather_px: f64,
    /// The maximum shift from the start, px.
    max_shift_px: f64,
    /// Whether the edges are close to their start.
    is_near: bool,
}

/// The effort near an accurate start.
const NEAR: Effort = Effort {
    first: (1, 4),
    later: (0, 4),
    min_rounds: 2,
    converged_px: NEAR_CONVERGED_PX,
    regather_px: REGATHER_PX,
    max_shift_px: MAX_SHIFT_PX,
    is_near: true,
};

/// The subpixel fit with its scratch memory.
#[derive(Debug, Default)]
pub(super) struct SubpixelFit {
    rim: Annulus,
    edges: Vec<Edge>,
    selection: EdgeSelection,
    fit: CircleFit,
    side_light: SideLight,
    limb: LimbDarkening,
    slope: Vec<f32>,
    rim_bins: Vec<RimBin>,
}

impl SubpixelFit {
    /// Fits the circle near a candidate; `None` if its rim does not determine one.
    pub fn fit_candidate(&mut self, image: ImageView<'_>, candidate: &Candidate) -> Option<Measured> {
        let effort = Effort {
            first: (4, 8),
            later: (2, 4),
            min_rounds: 4,
            converged_px: CONVERGED_PX,
            regather_px: 0.0,
            max_shift_px: MAX_SHIFT_PX,
            is_near: false,
        };
        self.fit_unclipped_or_all(image, candidate, effort)
    }

    /// Fits the circle near an accurate prediction, off by at most `limit_px`.
    pub fn fit_prediction(&mut self, image: ImageView<'_>, candidate: &Candidate, limit_px: f64) -> Option<Measured> {
        self.fit_unclipped_or_all(image, candidate, Effort { max_shift_px: limit_px, ..NEAR })
    }

    /// Fits the circle near an examined candidate, which may be off by more than the noise of an outline.
    pub fn fit_examined(&mut self, image: ImageView<'_>, candidate: &Candidate, max_shift_px: f64) -> Option<Measured> {
        self.fit_unclipped_or_all(
            image,
            candidate,
            Effort { max_shift_px, min_rounds: 3, converged_px: CONVERGED_PX, ..NEAR },
        )
    }

    /// Fits the pixels that are not clipped, and if they do not determine a circle, all pixels.
    fn fit_unclipped_or_all(
        &mut self,
        image: ImageView<'_>,
        candidate: &Candidate,
        effort: Effort,
    ) -> Option<Measured> {
        self.rim.set_clipped(ClippedPixels::Excluded);
        let measured = self.fit_clean_or_all(image, candidate, effort);
        if measured.is_some() || self.rim.white().is_infinite() {
            return measured;
        }
        self.rim.set_clipped(ClippedPixels::Included);
        self.fit_clean_or_all(image, candidate, effort)
    }

    /// Fits the clean parts of the rim, and if they are few or disagree, all of it.
    fn fit_clean_or_all(&mut self, image: ImageView<'_>, candidate: &Candidate, effort: Effort) -> Option<Measured> {
        self.set_rim_kind(RimKind::Clean);
        self.selection.same_sign = 0;
        let clean = self.fit_circle(image, candidate, effort);
        let same_sign = self.selection.same_sign as f64 / self.rim.bins().max(1) as f64;
        let is_clipped = self.rim.white().is_finite() && self.rim.clipped() == ClippedPixels::Excluded;
        let is_certain = clean.is_some_and(|clean| clean.circle.sigma_center_px <= GOOD_SIGMA_PX);
        if !is_certain && candidate.radius > MIN_SHADED_RADIUS_PX {
            self.set_rim_kind(RimKind::Shaded);
            let is_better = |shaded: &Measured| {
                shaded.circle.sigma_center_px < MAX_SHADED_SIGMA_PX
                    && clean.is_none_or(|clean| shaded.improves_on(&clean))
            };
            if let Some(shaded) = self.fit_circle(image, candidate, effort).filter(is_better) {
                return Some(shaded);
            }
        }
        if clean.is_some_and(|c| c.scatter_px < MIN_SPECKLED_SCATTER_PX) || same_sign < MIN_SPECKLED_EDGES || is_clipped
        {
            return clean;
        }
        self.set_rim_kind(RimKind::Speckled);
        let speckled = self.fit_circle(image, candidate, effort);
        speckled.or(clean)
    }

    /// Sets the kind of the rim for the gathering and for the fit.
    fn set_rim_kind(&mut self, kind: RimKind) {
        self.rim.set_kind(kind);
        self.fit.rim_kind = kind;
    }

    /// Fits the circle in rounds of gathering and fitting; `None` if it moves too far or is rejected.
    fn fit_circle(&mut self, image: ImageView<'_>, candidate: &Candidate, effort: Effort) -> Option<Measured> {
        let start = Outline { x: candidate.x.into(), y: candidate.y.into(), radius: candidate.radius.into() };
        let mut outline = start;
        let mut blur = USUAL_BLUR_PX;
        let mut gathered = start;
        self.edges.clear();
        self.slope.clear();
        self.gather(image, &start);
        for round in 0..MAX_ROUNDS {
            // The second gathering makes the bins independent of the start, if that was far off.
            let apart = outline.distance(&gathered);
            if (round == 2 && apart > effort.regather_px) || apart > SLACK_PX {
                self.gather(image, &outline);
                gathered = outline;
            } else if round > 0 {
                self.rim.update_distances(&outline);
            }
            let (steps, reweightings) = if round == 0 { effort.first } else { effort.later };
            fit_edges(
                &self.rim,
                EdgeSearch { blur, brightness_slope: &self.slope, steps, is_near: effort.is_near },
                &mut self.edges,
            );
            let is_same = effort.is_near && round > 0 && apart <= effort.regather_px;
            let clean = if is_same { CleanContrast::Reused } else { CleanContrast::Estimated };
            let noise = self.selection.select(&self.edges, candidate.polarity, self.fit.rim_kind, clean);
            let fitted = self.fit.fit(&self.rim, &self.edges, &self.selection.used, noise, reweightings)?;
            outline =
                Outline { x: outline.x + fitted.dx, y: outline.y + fitted.dy, radius: outline.radius + fitted.dr };
            // NaN fails the comparison.
            let near = outline.distance(&start) <= effort.max_shift_px;
            if !near {
                return None;
            }
            if round + 1 >= effort.min_rounds && fitted.dx.hypot(fitted.dy).max(fitted.dr.abs()) < effort.converged_px {
                break;
            }
            self.move_edges(&fitted);
            blur = self.refine_blur(blur);
            self.side_light.fit_slope(&self.rim, &self.edges, &self.selection.used, outline.radius, &mut self.slope);
        }
        self.accept_circle(image, outline, blur)
    }

    /// Gathers the pixels around `outline`; keeps edges and slopes if the bins stay the same.
    fn gather(&mut self, image: ImageView<'_>, outline: &Outline) {
        let bins = self.rim.bins();
        self.rim.gather(image, outline);
        if bins != self.rim.bins() || self.slope.len() != self.rim.bins() {
            self.edges.clear();
            self.slope.clear();
            self.slope.resize(self.rim.bins(), 0.0);
        }
    }

    /// Shifts the edges, which are relative to the outline, against its correction.
    fn move_edges(&mut self, fitted: &Correction) {
        for (bin, edge) in self.edges.iter_mut().enumerate() {
            let (cos, sin) = self.rim.direction(bin);
            let moved = edge.shift - (fitted.dx * cos + fitted.dy * sin + fitted.dr) as f32;
            // An edge this far out is another one, so the next fit starts at the outline.
            edge.shift = if moved.abs() < 1.5 { moved } else { 0.0 };
        }
    }

    /// Returns the blur, px, after a Gauss-Newton step towards the best fit of all used bins.
    fn refine_blur(&self, blur: f32) -> f32 {
        let (mut gradient, mut curvature) = (0.0_f32, 0.0_f32);
        for (bin, edge) in self.edges.iter().enumerate() {
            let robust_weight = self.fit.robust_weight[bin];
            if robust_weight > 0.0 {
                // Relative to the residuals of the bin, so that texture has little weight.
                let unit = robust_weight / (edge.rms * edge.rms + 0.1);
                gradient += unit * edge.blur_gradient;
                curvature += unit * edge.blur_curvature;
            }
        }
        if curvature <= 0.0 {
            return blur;
        }
        (blur + (gradient / curvature).clamp(-0.25, 0.25)).clamp(*BLUR_RANGE_PX.start(), *BLUR_RANGE_PX.end())
    }

    /// Returns the fitted circle with its corrections and uncertainties; `None` if it is rejected.
    ///
    /// It is rejected if too few edges agree, if they scatter too much, if many edges lie outside it, or if it is too
    /// uncertain. The radius is corrected for the shift of the edges from the rim, and the centre for that under side
    /// light. The uncertainties are those of the fit, increased for blur, occlusion, marks and clipped pixels.
    fn accept_circle(&mut self, image: ImageView<'_>, outline: Outline, blur: f32) -> Option<Measured> {
        let scatter_px = f64::from(self.fit.scatter_px()?);
        let support = self.support(blur);
        let Support { inliers, inlier_fraction, blur_factor, .. } = support;
        if !self.is_rim(&support, scatter_px) {
            return None;
        }
        let c = self.fit.covariance(&self.rim)?;
        let [center_sigma, radius_sigma] =
            [0.5 * (c[(0, 0)] + c[(1, 1)]), c[(2, 2)]].map(|variance| blur_factor * variance.sqrt());
        let visible_fraction = self.visible_fraction(image, outline);
        let max_sigma_px = match inliers {
            ..FEW_INLIERS => MAX_SIGMA_OF_FEW_PX,
            _ if visible_fraction > MOSTLY_VISIBLE => MAX_SIGMA_VISIBLE_PX,
            _ => MAX_SIGMA_PX,
        } * support.scatter_factor;
        if !(center_sigma < max_sigma_px && radius_sigma < max_sigma_px) {
            return None;
        }
        let clip = self.clipped_sigma_px()?;
        let shade = if self.fit.rim_kind == RimKind::Shaded { SHADED_SIGMA_PX } else { [0.0; 2] };
        let outlier_fraction = 1.0 - inliers as f64 / support.used as f64;
        let marks = match (self.fit.rim_kind, self.selection.excludes_speckle) {
            (RimKind::Shaded, _) => SHADED_FACTORS,
            (RimKind::Speckled, _) => SPECKLED_FACTORS,
            (RimKind::Clean, true) => OUTLIER_FACTORS.map(|factor| (factor * outlier_fraction).hypot(1.0)),
            (RimKind::Clean, false) => [1.0; 2],
        };
        // Speckle pulls a blurred rim over longer arcs, too.
        let [center, radius] = [
            (CENTER_FACTOR + CENTER_FACTOR_OCCLUDED * (1.0 - visible_fraction)) * marks[0],
            (RADIUS_FACTOR + RADIUS_FACTOR_OCCLUDED * (1.0 - visible_fraction)) * marks[1],
        ]
        .map(|factor| factor * blur_factor.sqrt());
        let shift = self.edge_shift(image, &outline, blur);
        // Under side light, the edges of the brighter limb are shifted more.
        let [amplitude_x, amplitude_y] = self.side_light.amplitude;
        let amplitude = amplitude_x.hypot(amplitude_y).max(f64::MIN_POSITIVE);
        let side = shift.center_correction(amplitude);
        let circle = Circle {
            x_px: outline.x + side.value * amplitude_x / amplitude,
            y_px: outline.y + side.value * amplitude_y / amplitude,
            radius_px: outline.radius + shift.rim.value,
            sigma_center_px: (center * center_sigma)
                .hypot(clip[0])
                .hypot(shade[0])
                .hypot(side.sigma)
                .hypot(MIN_CENTER_SIGMA_PX),
            sigma_radius_px: (radius * radius_sigma)
                .hypot(clip[1])
                .hypot(shade[1])
                .hypot(shift.rim.sigma)
                .hypot(MIN_RADIUS_SIGMA_PX),
            visible_fraction,
        };
        Some(Measured { circle, inlier_fraction, scatter_px })
    }

    /// Returns the uncertainty of centre and radius because of clipped pixels, px; `None` if it is too large.
    fn clipped_sigma_px(&self) -> Option<[f64; 2]> {
        let white = self.rim.white();
        if white.is_infinite() {
            return Some([0.0; 2]);
        }
        if self.rim.clipped() == ClippedPixels::Included {
            return Some(INCLUDED_CLIPPED_SIGMA_PX);
        }
        let (mut over, mut total) = (0.0, 0.0);
        for (edge, robust_weight) in
            self.edges.iter().zip(&self.fit.robust_weight).filter(|(_, robust_weight)| **robust_weight > 0.0)
        {
            let brighter = edge.inside.max(edge.inside - edge.contrast);
            over += robust_weight * (brighter - white).max(0.0) / edge.contrast.abs();
            total += robust_weight;
        }
        let over = f64::from(over / total);
        (over <= MAX_CLIPPED_FRACTION).then(|| CLIPPED_SIGMA_PX.map(|each| each * over))
    }

    /// Computes the distance of the rim of the ball from its fitted edges, px.
    fn edge_shift(&mut self, image: ImageView<'_>, outline: &Outline, blur: f32) -> Shift {
        let (bins, robust_weight) = (self.edges.len(), &self.fit.robust_weight[..self.edges.len()]);
        let mut trusted = [0.0; SECTORS];
        let (mut inside, mut contrast, mut signed, mut total) = (0.0, 0.0, 0.0, 0.0_f32);
        for (bin, (edge, robust_weight)) in self.edges.iter().zip(robust_weight).enumerate() {
            trusted[bin * SECTORS / bins] += if *robust_weight > 0.0 { (SECTORS as f64) / bins as f64 } else { 0.0 };
            inside += robust_weight * edge.inside;
            // The contrasts of a rim of both signs must not cancel.
            contrast += robust_weight * edge.contrast.abs();
            signed += robust_weight * edge.contrast;
            total += robust_weight;
        }
        let visible = VisibleRim { sectors: trusted.map(|share| share > MIN_VISIBLE_RIM), blur_px: blur.into() };
        let darkening = self.limb.darkening(image, outline, visible);
        let [inside, contrast] = [inside, contrast.copysign(signed)].map(|sum| f64::from(sum / total));
        edge_shift(darkening, outline.radius, Step { inside, contrast, blur_px: blur.into() })
    }

    /// Returns the visible fraction of the disc, 0 to 1: neither occluded nor outside the image.
    fn visible_fraction(&mut self, image: ImageView<'_>, outline: Outline) -> f64 {
        self.rim_bins.clear();
        // Where light and shade leave no contrast, nothing shows whether the rim is occluded.
        let is_known = |bin: usize| self.fit.rim_kind != RimKind::Shaded || self.selection.used[bin];
        for bin in 0..self.rim.bins() {
            let bin = match (self.rim.count(bin), self.fit.robust_weight[bin]) {
                (0..8, _) => RimBin::Outside,
                _ if !is_known(bin) => RimBin::Outside,
                (_, robust_weight) if robust_weight > 0.0 => RimBin::Visible,
                _ => RimBin::Missing,
            };
            self.rim_bins.push(bin);
        }
        let in_image = fraction_in_image(outline.x, outline.y, outline.radius, image.width(), image.height());
        (unoccluded_fraction(&self.rim_bins) + in_image - 1.0).clamp(0.0, 1.0)
    }
}
