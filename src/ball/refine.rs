//! From a circle good to a pixel to one good to a few hundredths.

use super::chance::evidence;
use super::circle::{CircleFit, Correction};
use super::edge::{Edge, Search, fit_edges};
use super::gates::{self, Gates};
use super::light::SideLight;
use super::limb::{InSight, Limb, SECTORS, Shift, Step, shift_px};
use super::rank::nth_smallest;
use super::rays::Guess;
use super::rim::{Outline, Rim, SLACK_PX};
use super::visible::{Sight, share_in_image, unhidden_share};
use crate::image::ImageView;
use crate::results::Circle;

/// Most rounds of gathering and fitting.
const ROUNDS: usize = 6;
/// A round that moves the outline less than this is the last, px.
const STILL_PX: f64 = 0.003;
/// The same near a guess that is hardly off; the next round would move it a quarter as far, an outline's noise is ten
/// times that.
const NEARLY_STILL_PX: f64 = 0.01;
/// Bins around an outline this near are as good as around the outline itself, px.
const NEARLY_PX: f64 = 0.1;
/// Blur of a lens in focus, where the search for the blur starts, px.
const USUAL_BLUR_PX: f32 = 0.8;
const BLUR_RANGE_PX: std::ops::RangeInclusive<f32> = 0.35..=2.0;
/// Up to this blur speckle beside the rim pulls edges by no more than the limits below allow for; beyond it by as much
/// more as the picture is blurred more, px.
const SHARP_BLUR_PX: f32 = 0.9;
/// Share of the rim that must agree before a blurred one may scatter more: blotched ground is blurred, too.
const LEAST_AGREEING_WHEN_SOFT: f64 = 0.15;
/// An outline that moves farther than this was not the ball's, px.
pub(super) const FARTHEST_PX: f64 = 4.0;
/// An edge this near to the circle agrees with it, px.
const AGREEING_PX: f32 = 0.25;
/// Least number of bins that must agree with the circle, and the share of the rim inside the image on top.
///
/// These limits were set on 420 circles of balls in hard scenes and 2300 around texture, speckle and occluders
/// of all sizes: they let 98 % of the former pass and none of the latter.
const FEWEST_AGREEING: f64 = 15.0;
const LEAST_AGREEING: f64 = 0.055;
/// Least share of the usable edges that must agree, and the share that will do when many agree.
const LEAST_AGREEING_OF_USED: f64 = 0.55;
const LEAST_AGREEING_OF_USED_WHEN_MANY: f64 = 0.45;
const MANY_AGREEING: usize = 30;
/// In 21 000 searches for balls of 6 to 20 px in speckled paint and texture no false ball had as many; where fewer agree, the
/// evidence that they do by more than chance is at least this, nats: marks pull three or four neighbouring edges alike, in
/// blurred pictures more, and the best of many circles is looked for. The three best of those had 31.0, 30.2 and 28.1.
const FEW_AGREEING: usize = 26;
const LEAST_EVIDENCE: f64 = 31.0;
/// Marks at a rim pull its edges inwards. Where more than this share of as many as agree lie so many px farther out, they
/// are the rim, and the circle lies inside of the ball: of 15 000 circles in hard scenes such ones were off by up to 8 px
/// (80 sigmas), and 1 in 250 of discs and 1 in 60 of spheres that were not had as many.
const BEYOND: (f32, f64) = (0.4, 0.14);
const BEYOND_OF_FEW: (f32, f64) = (0.4, 0.08);
const BEYOND_LINED: (f32, f64) = (1.0, 0.2);
/// Where fewer agree it takes fewer of those.
const FEW_TO_BE_OUTERMOST: usize = 40;
/// Largest robust scatter of the usable edges about the circle, px.
const MOST_SCATTER_PX: f64 = 0.28;
/// With this share of the rim in agreement no other place can be the ball ...
pub(super) const CERTAIN_AGREEING: f64 = 0.3;
/// ... and speckle at the rest of it may scatter by so many times as much.
const CERTAIN_SCATTER: f64 = 1.5;
/// The covariance of the fit against the error seen: Bartlett's window misses a part of the likeness of neighbours, and
/// texture and light are alike over longer arcs, the more so the less of the rim there is. Seen in 3600 hard scenes,
/// bright and dark, discs and spheres, 0 to 40 % hidden.
const CENTER_FACTOR: f64 = 1.12;
const CENTER_FACTOR_HIDDEN: f64 = 0.5;
const RADIUS_FACTOR: f64 = 0.95;
const RADIUS_FACTOR_HIDDEN: f64 = 0.95;
/// Where bins are chosen by their contrast, those that disagree are marks at a bright rim, all of which pull inwards: centre
/// and radius are unsure by so many times their sigmas for the share of them.
const FACTORS_OFF: [f64; 2] = [2.0, 4.5];
/// The same where marks line the rim and every bin has some.
const FACTORS_LINED: [f64; 2] = [1.12, 2.0];
const CENTER_FLOOR_PX: f64 = 0.005;
const RADIUS_FLOOR_PX: f64 = 0.006;
/// A sector of a ball is in sight when this share of its rim is.
const LEAST_SEEN: f64 = 0.15;
/// Where the brighter side of a rim is beyond what a pixel can tell, by a share of the contrast, its edges are known by
/// their other side: so many px of uncertainty of the centre and of the radius for each such share.
const OVER_PX: [f64; 2] = [0.3, 1.3];
/// Beyond this share the other side tells too little.
const MOST_OVER: f64 = 0.3;
/// What centre and radius are unsure by where clipped pixels are taken for what they look like: up to four times too
/// long an exposure moves edges outwards from what is clipped by up to 1 px, px.
const CLIPPED_PX: [f64; 2] = [0.15, 0.7];
/// An answer less certain than this, before these factors, is none, px ...
const MOST_SIGMA_PX: f64 = 0.09;
/// ... and less where few bins agree; where most of the rim is in sight it may be a ball that is not round: at 0.09 px 51 of
/// 60 balls stretched by 1.2 %, as by a shutter that rolls, had none.
const MOST_SIGMA_OF_FEW_PX: f64 = 0.07;
const MOST_SIGMA_IN_SIGHT_PX: f64 = 0.15;
const IN_SIGHT: f64 = 0.75;

/// Clean parts of a rim that scatter by less than this are clean; beyond it marks line the rim, and all of it, less deep,
/// tells more, px.
const LEAST_LINED_PX: f64 = 0.15;
/// Such a rim scatters by less than this, px.
const MOST_LINED_PX: f64 = 0.5;
/// Share of it where something must lie as the rim does.
const LEAST_ALIKE: f64 = 0.5;
/// Bins that must agree.
const FEWEST_LINED: usize = 45;
/// What is outside of it differs along it by less than this share of its contrast, between quartiles: circles in speckled
/// paint have speckles outside, too.
const MOST_UNEVEN: f32 = 0.2;

/// An accepted outline.
#[derive(Debug, Clone, Copy)]
pub(super) struct Measured {
    pub circle: Circle,
    /// Share of the rim inside the image that agrees with it, 0 to 1.
    pub agreeing: f64,
    /// How much the edges scatter about it, px.
    pub scatter_px: f64,
}

/// How much is done for a circle.
#[derive(Debug, Clone, Copy)]
struct Effort {
    /// Steps of the edges and reweightings in the first round.
    first: (usize, usize),
    /// In each later one.
    later: (usize, usize),
    least_rounds: usize,
    /// A later round that moves the outline less than this is the last, px.
    still_px: f64,
    /// Pixels gathered around an outline this near are not gathered again, px.
    nearly_px: f64,
    /// An outline that moves farther than this was not the ball's, px.
    farthest_px: f64,
    /// Whether edges are where they are looked for.
    is_near: bool,
}

/// Around a guess that is hardly off.
const NEAR: Effort = Effort {
    first: (1, 4),
    later: (0, 4),
    least_rounds: 2,
    still_px: NEARLY_STILL_PX,
    nearly_px: NEARLY_PX,
    farthest_px: FARTHEST_PX,
    is_near: true,
};

fn distance(a: &Outline, b: &Outline) -> f64 {
    (a.x - b.x).hypot(a.y - b.y).max((a.radius - b.radius).abs())
}

/// Scratch of the refinement.
#[derive(Debug, Default)]
pub(super) struct Refine {
    rim: Rim,
    edges: Vec<Edge>,
    gates: Gates,
    fit: CircleFit,
    light: SideLight,
    limb: Limb,
    slope: Vec<f32>,
    sights: Vec<Sight>,
}

impl Refine {
    /// The circle near `guess`, or `None` when its rim does not hold one.
    pub fn circle(&mut self, image: ImageView<'_>, guess: &Guess) -> Option<Measured> {
        let effort = Effort {
            first: (4, 8),
            later: (2, 4),
            least_rounds: 4,
            still_px: STILL_PX,
            nearly_px: 0.0,
            farthest_px: FARTHEST_PX,
            is_near: false,
        };
        self.circle_with(image, guess, effort)
    }

    /// As [`Self::circle`], near a guess that is hardly off: by no more than `farthest_px`.
    pub fn circle_at(&mut self, image: ImageView<'_>, guess: &Guess, farthest_px: f64) -> Option<Measured> {
        self.circle_with(image, guess, Effort { farthest_px, ..NEAR })
    }

    /// As [`Self::circle_at`], near a guess that may be off by more than an outline's noise.
    pub fn circle_about(&mut self, image: ImageView<'_>, guess: &Guess, farthest_px: f64) -> Option<Measured> {
        self.circle_with(image, guess, Effort { farthest_px, least_rounds: 3, still_px: STILL_PX, ..NEAR })
    }

    /// By the pixels that are not clipped, and if they do not hold a circle, by all.
    fn circle_with(&mut self, image: ImageView<'_>, guess: &Guess, effort: Effort) -> Option<Measured> {
        self.rim.take_clipped(false);
        let measured = self.attempts(image, guess, effort);
        if measured.is_some() || self.rim.white().is_infinite() {
            return measured;
        }
        self.rim.take_clipped(true);
        self.attempts(image, guess, effort)
    }

    /// By the clean parts of the rim, and if they disagree, by all of it.
    fn attempts(&mut self, image: ImageView<'_>, guess: &Guess, effort: Effort) -> Option<Measured> {
        self.take_lined(false);
        self.gates.alike = 0;
        let clean = self.attempt(image, guess, effort);
        let alike = self.gates.alike as f64 / self.rim.bins().max(1) as f64;
        let is_clipped = self.rim.white().is_finite() && !self.rim.takes_clipped();
        if clean.is_some_and(|c| c.scatter_px < LEAST_LINED_PX) || alike < LEAST_ALIKE || is_clipped {
            return clean;
        }
        self.take_lined(true);
        let lined = self.attempt(image, guess, effort);
        lined.or(clean)
    }

    fn take_lined(&mut self, is_lined: bool) {
        self.rim.take_lined(is_lined);
        self.fit.is_lined = is_lined;
    }

    fn attempt(&mut self, image: ImageView<'_>, guess: &Guess, effort: Effort) -> Option<Measured> {
        let start = Outline { x: guess.x.into(), y: guess.y.into(), radius: guess.radius.into() };
        let mut outline = start;
        let mut blur = USUAL_BLUR_PX;
        let mut gathered = start;
        self.edges.clear();
        self.slope.clear();
        self.restart(image, &start);
        for round in 0..ROUNDS {
            // The second gathering makes the bins independent of where the search came from, if that was far off.
            let apart = distance(&outline, &gathered);
            if (round == 2 && apart > effort.nearly_px) || apart > SLACK_PX {
                self.restart(image, &outline);
                gathered = outline;
            } else if round > 0 {
                self.rim.measure(&outline);
            }
            let (steps, reweightings) = if round == 0 { effort.first } else { effort.later };
            fit_edges(&self.rim, Search { blur, light: &self.slope, steps, is_near: effort.is_near }, &mut self.edges);
            let again = effort.is_near && round > 0 && apart <= effort.nearly_px;
            let noise = self.gates.choose(&self.edges, guess.polarity, (again, self.fit.is_lined));
            let fitted = self.fit.fit(&self.rim, &self.edges, &self.gates.used, noise, reweightings)?;
            outline =
                Outline { x: outline.x + fitted.dx, y: outline.y + fitted.dy, radius: outline.radius + fitted.dr };
            // NaN fails the comparison.
            let near = distance(&outline, &start) <= effort.farthest_px;
            if !near {
                return None;
            }
            if round + 1 >= effort.least_rounds && fitted.dx.hypot(fitted.dy).max(fitted.dr.abs()) < effort.still_px {
                break;
            }
            self.move_edges(&fitted);
            blur = self.better_blur(blur);
            self.light.slope(&self.rim, &self.edges, &self.gates.used, outline.radius, &mut self.slope);
        }
        self.judge(image, outline, blur)
    }

    /// Gathers the pixels around `outline`; edges and light are kept when the bins stay the same.
    fn restart(&mut self, image: ImageView<'_>, outline: &Outline) {
        let bins = self.rim.bins();
        self.rim.gather(image, outline);
        if bins != self.rim.bins() || self.slope.len() != self.rim.bins() {
            self.edges.clear();
            self.slope.clear();
            self.slope.resize(self.rim.bins(), 0.0);
        }
    }

    /// Edges are told from the outline, so they move against it.
    fn move_edges(&mut self, fitted: &Correction) {
        for (bin, edge) in self.edges.iter_mut().enumerate() {
            let (cos, sin) = self.rim.direction(bin);
            let moved = edge.shift - (fitted.dx * cos + fitted.dy * sin + fitted.dr) as f32;
            // An edge this far out is another one; look again from the outline.
            edge.shift = if moved.abs() < 1.5 { moved } else { 0.0 };
        }
    }

    /// One step towards the blur that explains all used bins best.
    fn better_blur(&self, blur: f32) -> f32 {
        let (mut pull, mut weight) = (0.0_f32, 0.0_f32);
        for (bin, edge) in self.edges.iter().enumerate() {
            let trust = self.fit.trust[bin];
            if trust > 0.0 {
                // In units of the bin's own residual, so that texture does not speak for the lens.
                let unit = trust / (edge.rms * edge.rms + 0.1);
                pull += unit * edge.blur_pull;
                weight += unit * edge.blur_weight;
            }
        }
        if weight <= 0.0 {
            return blur;
        }
        (blur + (pull / weight).clamp(-0.25, 0.25)).clamp(*BLUR_RANGE_PX.start(), *BLUR_RANGE_PX.end())
    }

    /// Accepts the fit, or not.
    fn judge(&mut self, image: ImageView<'_>, outline: Outline, blur: f32) -> Option<Measured> {
        let agreeing = self.fit.close(AGREEING_PX);
        let inside = (0..self.rim.bins()).filter(|&bin| self.rim.count(bin) > 0).count().max(1) as f64;
        let share = agreeing as f64 / inside;
        let used = self.gates.used.iter().filter(|used| **used).count();
        let many = agreeing >= MANY_AGREEING;
        let soft = f64::from(blur / SHARP_BLUR_PX).max(1.0);
        let may_scatter = if many && share >= LEAST_AGREEING_WHEN_SOFT { soft } else { 1.0 };
        let scatter_px = f64::from(self.fit.scatter_px()?);
        let is_rim = if self.fit.is_lined {
            let is_alike = used as f64 > LEAST_ALIKE * inside;
            is_alike && agreeing >= FEWEST_LINED && scatter_px < MOST_LINED_PX && self.is_even()
        } else {
            let may_scatter = if share > CERTAIN_AGREEING { CERTAIN_SCATTER } else { 1.0 } * may_scatter;
            scatter_px <= MOST_SCATTER_PX * may_scatter && self.is_beyond_chance(agreeing, inside, soft)
        };
        if !(is_rim && self.is_outermost(agreeing)) {
            return None;
        }
        let c = self.fit.covariance(&self.rim)?;
        let [of_center, of_radius] = [0.5 * (c[(0, 0)] + c[(1, 1)]), c[(2, 2)]].map(|variance| soft * variance.sqrt());
        let visible_fraction = self.visible_fraction(image, outline);
        let most_px = match agreeing {
            ..FEW_AGREEING => MOST_SIGMA_OF_FEW_PX,
            _ if visible_fraction > IN_SIGHT => MOST_SIGMA_IN_SIGHT_PX,
            _ => MOST_SIGMA_PX,
        } * may_scatter;
        if !(of_center < most_px && of_radius < most_px) {
            return None;
        }
        let clipped = self.unsure_of_clipped()?;
        let off = 1.0 - agreeing as f64 / used as f64;
        let marks = match (self.fit.is_lined, self.gates.picks) {
            (true, _) => FACTORS_LINED,
            (false, true) => FACTORS_OFF.map(|factor| (factor * off).hypot(1.0)),
            (false, false) => [1.0; 2],
        };
        // Speckle pulls a blurred rim over longer arcs, too.
        let [center, radius] = [
            (CENTER_FACTOR + CENTER_FACTOR_HIDDEN * (1.0 - visible_fraction)) * marks[0],
            (RADIUS_FACTOR + RADIUS_FACTOR_HIDDEN * (1.0 - visible_fraction)) * marks[1],
        ]
        .map(|factor| factor * soft.sqrt());
        let shift = self.shift(image, &outline, blur);
        // Lit from a side, the edges lie off by more where the limb is brighter.
        let [across_x, across_y] = self.light.across;
        let across = across_x.hypot(across_y).max(f64::MIN_POSITIVE);
        let lit = shift.center(across);
        let circle = Circle {
            x_px: outline.x + lit.value * across_x / across,
            y_px: outline.y + lit.value * across_y / across,
            radius_px: outline.radius + shift.rim.value,
            sigma_center_px: (center * of_center).hypot(clipped[0]).hypot(lit.sigma).hypot(CENTER_FLOOR_PX),
            sigma_radius_px: (radius * of_radius).hypot(clipped[1]).hypot(shift.rim.sigma).hypot(RADIUS_FLOOR_PX),
            visible_fraction,
        };
        Some(Measured { circle, agreeing: share, scatter_px })
    }

    /// Whether so many edges agree with the circle that it is no circle in texture; `soft` tells how blurred they are.
    fn is_beyond_chance(&self, agreeing: usize, inside: f64, soft: f64) -> bool {
        let used = self.gates.used.iter().filter(|used| **used).count();
        let many = agreeing >= MANY_AGREEING;
        let of_used = if many { LEAST_AGREEING_OF_USED_WHEN_MANY } else { LEAST_AGREEING_OF_USED };
        let enough =
            agreeing as f64 >= FEWEST_AGREEING + LEAST_AGREEING * inside && agreeing as f64 > of_used * used as f64;
        // An edge of the other sign might as well have agreed.
        let told = || evidence(used + self.gates.against, gates::FARTHEST_PX, |within_px| self.fit.close(within_px));
        enough && (agreeing >= FEW_AGREEING || told() > LEAST_EVIDENCE * soft)
    }

    /// Whether hardly any edge lies outside of the circle.
    fn is_outermost(&self, agreeing: usize) -> bool {
        let (beyond_px, most) = match agreeing {
            _ if self.fit.is_lined => BEYOND_LINED,
            ..FEW_TO_BE_OUTERMOST => BEYOND_OF_FEW,
            _ => BEYOND,
        };
        self.fit.beyond(beyond_px) as f64 <= most * agreeing as f64
    }

    /// Whether what surrounds the rim is much the same all along it.
    fn is_even(&self) -> bool {
        let trusted =
            || self.edges.iter().zip(&self.fit.trust).filter(|(_, trust)| **trust > 0.0).map(|(edge, _)| edge);
        let mut outside: Vec<f32> = trusted().map(|edge| edge.inside - edge.contrast).collect();
        let mut contrast: Vec<f32> = trusted().map(|edge| edge.contrast.abs()).collect();
        let Some(last) = outside.len().checked_sub(1) else { return false };
        let [low, high] = [last / 4, last * 3 / 4].map(|rank| nth_smallest(&mut outside, rank));
        (high - low) < MOST_UNEVEN * nth_smallest(&mut contrast, last / 2)
    }

    /// What clipped pixels leave unsure of centre and radius, px; `None` where the others tell too little.
    fn unsure_of_clipped(&self) -> Option<[f64; 2]> {
        let white = self.rim.white();
        if white.is_infinite() {
            return Some([0.0; 2]);
        }
        if self.rim.takes_clipped() {
            return Some(CLIPPED_PX);
        }
        let (mut over, mut total) = (0.0, 0.0);
        for (edge, trust) in self.edges.iter().zip(&self.fit.trust).filter(|(_, trust)| **trust > 0.0) {
            let brighter = edge.inside.max(edge.inside - edge.contrast);
            over += trust * (brighter - white).max(0.0) / edge.contrast.abs();
            total += trust;
        }
        let over = f64::from(over / total);
        (over <= MOST_OVER).then(|| OVER_PX.map(|each| each * over))
    }

    /// By how much the ball's rim lies farther out than its edges tell.
    fn shift(&mut self, image: ImageView<'_>, outline: &Outline, blur: f32) -> Shift {
        let (bins, trust) = (self.edges.len(), &self.fit.trust[..self.edges.len()]);
        let mut trusted = [0.0; SECTORS];
        let (mut inside, mut contrast, mut total) = (0.0, 0.0, 0.0);
        for (bin, (edge, trust)) in self.edges.iter().zip(trust).enumerate() {
            trusted[bin * SECTORS / bins] += if *trust > 0.0 { (SECTORS as f64) / bins as f64 } else { 0.0 };
            inside += trust * edge.inside;
            contrast += trust * edge.contrast;
            total += trust;
        }
        let sight = InSight { sectors: trusted.map(|share| share > LEAST_SEEN), blur_px: blur.into() };
        let darkening = self.limb.darkening(image, outline, sight);
        let [inside, contrast] = [inside, contrast].map(|sum| f64::from(sum / total));
        shift_px(darkening, outline.radius, Step { inside, contrast, blur_px: blur.into() })
    }

    fn visible_fraction(&mut self, image: ImageView<'_>, outline: Outline) -> f64 {
        self.sights.clear();
        for bin in 0..self.rim.bins() {
            let sight = match (self.rim.count(bin), self.fit.trust[bin]) {
                (0..8, _) => Sight::Outside,
                (_, trust) if trust > 0.0 => Sight::Rim,
                _ => Sight::Missing,
            };
            self.sights.push(sight);
        }
        let shown = share_in_image(outline.x, outline.y, outline.radius, image.width(), image.height());
        (unhidden_share(&self.sights) + shown - 1.0).clamp(0.0, 1.0)
    }
}
