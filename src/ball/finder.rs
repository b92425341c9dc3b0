//! Finds a ball's outline, from nothing or near where it should be.

use super::Polarity;
use super::coarse::{Coarse, Marks, Place};
use super::marked::Marked;
use super::params::{BallError, BallParams, OutlineMethod};
use super::rays::{Guess, Look, Rays};
use super::refine::{CERTAIN_AGREEING, FARTHEST_PX, Measured, Refine};
use super::rim::{BAND_PX, INNER_BAND_PX};
use crate::image::ImageView;
use crate::results::Circle;

/// Less of the rim than this is not worth measuring.
const LEAST_SUPPORT: f32 = 0.22;
/// Circles nearer to one another than this are the same one, px.
const SAME_PX: f32 = 3.0;
/// Places that are looked at closely.
const FINALISTS: usize = 8;
/// How much larger a circle is looked for around the best finalists as well: speckle near the rim can make a
/// smaller one win.
const GROWN_BY_PX: f32 = 5.0;
/// With so many times the support of any other a guess is ahead.
const AHEAD: f32 = 1.3;
/// With so many it is far ahead ...
const FAR_AHEAD: f32 = 1.8;
/// ... and this share of its rim in agreement leaves no doubt.
const LEAST_AGREEING_WHEN_AHEAD: f64 = 0.2;
/// With this support a guess is right to a pixel or two.
const NEAR_SUPPORT: f32 = 0.5;
/// Finalists among which the ball mostly is.
const LIKELY: usize = 2;
/// Places whose rim is looked at with small marks painted out.
const WHOLE_RIMS: usize = 8;
/// A place is off by less than this, px.
const REACH_PX: f32 = 7.0;
/// A prediction is off by less than this, px.
const FOLLOW_REACH_PX: f32 = 5.0;

/// An outline this near to where it was foretold needs no search, px.
const FORETOLD_PX: f64 = 1.0;

const CLOSE: Look = Look { reach_px: 4.0, tolerance_px: 0.6, draws: 120, rays: 120 };

/// How many places of the coarse search are looked at, and how well.
#[derive(Debug, Clone, Copy)]
struct Effort {
    /// Places for one range of radii, and for several.
    places: (usize, usize),
    tolerance_px: f32,
    draws: usize,
    rays: usize,
    /// Finalists around which a larger circle is looked for.
    grown: usize,
    /// Whether circles are also looked for with small marks painted out.
    whole_rims: bool,
}

/// The ball is among the first 5 places in 96 of 100 hard scenes, among the first 20 when the radius is unknown.
const QUICK: Effort = Effort { places: (8, 18), tolerance_px: 1.0, draws: 30, rays: 60, grown: 3, whole_rims: false };
/// Before that: mostly the ball is among these.
const FIRST: Effort = Effort { places: (3, 6), ..QUICK };
/// When the quick look found nothing.
const THOROUGH: Effort =
    Effort { places: (24, 48), tolerance_px: 0.7, draws: 60, rays: 120, grown: 8, whole_rims: true };

/// Finds one ball per image: its outline to a few hundredths of a pixel.
///
/// A pure function of the image: nothing is remembered but scratch.
///
/// Gradients vote for centres on a reduced picture, with and without small
/// dark marks (a Hough transform with direction and polarity); circles are
/// ranked by how much rim of one sign they have; the best one is refined by
/// fitting a blurred step to the raw pixels of every few pixels of rim and a
/// robust circle to those steps. A ball with too little rim is refused.
#[derive(Debug)]
pub struct BallFinder {
    params: BallParams,
    shape: (usize, usize),
    coarse: Coarse,
    places: Vec<Place>,
    guesses: Vec<Guess>,
    rays: Rays,
    refine: Refine,
    marked: Marked,
}

impl BallFinder {
    /// How far outside of the circle that a ball is followed from [`follow`](Self::follow) looks, px.
    ///
    /// The search and the refinement each move the centre and the radius by so much at most, and look a band farther.
    pub const FOLLOW_RANGE_PX: f64 = 2.0 * (FOLLOW_REACH_PX as f64 + FARTHEST_PX) + 2.0 * BAND_PX + 4.0;

    /// How far outside of the circle that a ball is foretold at [`follow_closely`](Self::follow_closely) looks, px.
    pub const CLOSE_RANGE_PX: f64 = 2.0 * FORETOLD_PX + BAND_PX + 2.0;

    /// Plans a finder for images of `width_px` x `height_px` pixels.
    ///
    /// # Errors
    ///
    /// [`BallError::Range`] when a parameter is out of its range; it names the
    /// parameter, the value and the range.
    pub fn new(params: &BallParams, width_px: usize, height_px: usize) -> Result<Self, BallError> {
        params.check(width_px, height_px)?;
        Ok(Self {
            params: params.clone(),
            shape: (width_px, height_px),
            coarse: Coarse::new(params, width_px, height_px),
            places: Vec::new(),
            guesses: Vec::new(),
            rays: Rays::default(),
            refine: Refine::default(),
            marked: Marked::default(),
        })
    }

    /// Finds the ball anywhere in the searched region.
    ///
    /// `None` when there is no ball, or none that can be measured.
    ///
    /// # Panics
    ///
    /// If `image` has another shape than the finder was planned for.
    pub fn find(&mut self, image: ImageView<'_>) -> Option<Circle> {
        self.check_shape(image);
        if image.width() < 8 || image.height() < 8 {
            return None;
        }
        let circle = self.edges_anywhere(image)?;
        self.told(image, circle)
    }

    /// The outline by its edges, wherever it is.
    fn edges_anywhere(&mut self, image: ImageView<'_>) -> Option<Circle> {
        self.coarse.reduce(image);
        self.places.clear();
        self.coarse.plain(&mut self.places);
        // Mostly marks need not be painted out, and one of the first places is the ball.
        if let Some(circle) = self.at_first_sight(image) {
            return Some(circle);
        }
        self.rank(image, QUICK);
        let least = if self.is_ahead(FAR_AHEAD) { LEAST_AGREEING_WHEN_AHEAD } else { CERTAIN_AGREEING };
        self.guesses.truncate(LIKELY);
        if let Some(circle) = self.beyond_doubt(image, least) {
            return Some(circle);
        }
        self.coarse.without_marks(Marks::Dark, &mut self.places);
        if let Some(circle) = self.best_of_places(image, QUICK) {
            return Some(circle);
        }
        if let Some(circle) = self.best_of_places(image, THOROUGH) {
            return Some(circle);
        }
        self.places.clear();
        self.coarse.without_marks(Marks::Bright, &mut self.places);
        self.best_of_places(image, QUICK)
    }

    /// Finds the ball near `near`: a prediction within a few pixels, its radius known.
    ///
    /// Much faster than [`find`](Self::find). `None` when it is not there; then look for it from nothing.
    ///
    /// # Panics
    ///
    /// If `image` has another shape than the finder was planned for.
    pub fn follow(&mut self, image: ImageView<'_>, near: &Circle) -> Option<Circle> {
        self.follow_closely(image, near, false).or_else(|| self.search_near(image, near))
    }

    /// As [`follow`](Self::follow), only where the ball must be to within a pixel, and only if its edges leave no doubt:
    /// with `is_there`, that of what they hold a circle of, else that there is no better one beside.
    ///
    /// # Panics
    ///
    /// If `image` has another shape than the finder was planned for.
    pub fn follow_closely(&mut self, image: ImageView<'_>, near: &Circle, is_there: bool) -> Option<Circle> {
        let near = self.sane(image, near)?;
        let circle = self.edges_at(image, near, if is_there { 0.0 } else { CERTAIN_AGREEING })?;
        self.told(image, circle)
    }

    /// What [`follow`](Self::follow) does where [`follow_closely`](Self::follow_closely) finds nothing.
    ///
    /// # Panics
    ///
    /// If `image` has another shape than the finder was planned for.
    pub fn search_near(&mut self, image: ImageView<'_>, near: &Circle) -> Option<Circle> {
        let near = self.sane(image, near)?;
        let circle = self.edges_near(image, near)?;
        self.told(image, circle)
    }

    /// Where a ball is followed from, if anything can be looked for there.
    fn sane(&self, image: ImageView<'_>, near: &Circle) -> Option<(f32, f32, f32)> {
        self.check_shape(image);
        let near = (near.x_px as f32, near.y_px as f32, near.radius_px as f32);
        let sane = near.0.is_finite() && near.1.is_finite() && near.2.is_finite();
        (image.width() >= 8 && image.height() >= 8 && sane && near.2 >= 3.0).then_some(near)
    }

    /// The outline by its edges, near a prediction.
    fn edges_near(&mut self, image: ImageView<'_>, near: (f32, f32, f32)) -> Option<Circle> {
        let look = Look { reach_px: FOLLOW_REACH_PX, tolerance_px: 0.7, draws: 60, rays: 120 };
        let guess = self.rays.look(image, near, look)?;
        if let Some(measured) = self.measure(image, &guess) {
            return Some(measured.circle);
        }
        // Where speckle outnumbers the rim the prediction itself may be the better guess.
        [Polarity::Brighter, Polarity::Darker].into_iter().find_map(|polarity| {
            let guess = Guess { x: near.0, y: near.1, radius: near.2, support: 1.0, polarity };
            self.measure(image, &guess).map(|m| m.circle)
        })
    }

    /// The outline right where it was foretold, if more than this share of its rim agrees.
    fn edges_at(&mut self, image: ImageView<'_>, (x, y, radius): (f32, f32, f32), least: f64) -> Option<Circle> {
        let polarity = polarity(image, (x, y, radius))?;
        let guess = Guess { x, y, radius, support: 1.0, polarity };
        let measured = self.refine.circle_at(image, &guess, FORETOLD_PX)?;
        self.certain(measured, least)
    }

    /// The outline about where a guess is, if its edges leave no doubt.
    fn certain_about(&mut self, image: ImageView<'_>, guess: &Guess, least: f64) -> Option<Circle> {
        if guess.support < LEAST_SUPPORT {
            return None;
        }
        let measured = self.refine.circle_about(image, guess, FORETOLD_PX)?;
        self.certain(measured, least)
    }

    fn certain(&self, measured: Measured, least: f64) -> Option<Circle> {
        (measured.agreeing > least && self.is_sized(&measured.circle)).then_some(measured.circle)
    }

    /// What is told of an outline found by its edges.
    fn told(&mut self, image: ImageView<'_>, circle: Circle) -> Option<Circle> {
        match self.params.outline {
            OutlineMethod::Edges => Some(circle),
            OutlineMethod::Marked => self.marked.circle(image, &circle),
        }
    }

    fn check_shape(&self, image: ImageView<'_>) {
        assert_eq!((image.width(), image.height()), self.shape, "the finder was planned for another image shape");
    }

    /// Ranks the places by their rim.
    fn rank(&mut self, image: ImageView<'_>, effort: Effort) {
        self.guesses.clear();
        self.places.sort_by(|a, b| b.score.total_cmp(&a.score));
        let places = if self.coarse.bands() > 1 { effort.places.1 } else { effort.places.0 };
        for place in self.places.iter().take(places) {
            let reach_px = (place.spread + 3.0).max(REACH_PX);
            let look = Look { reach_px, tolerance_px: effort.tolerance_px, draws: effort.draws, rays: effort.rays };
            self.guesses.extend(self.rays.look(image, (place.x, place.y, place.radius), look));
        }
        self.keep_finalists();
    }

    /// Whether the first guess has so many times the support of any other.
    fn is_ahead(&self, times: f32) -> bool {
        let support = |guess: usize| self.guesses.get(guess).map_or(0.0, |guess| guess.support);
        support(0) > times * support(1).max(LEAST_SUPPORT)
    }

    /// The ball, if it is ahead among the first places and its edges leave no doubt.
    fn at_first_sight(&mut self, image: ImageView<'_>) -> Option<Circle> {
        self.rank(image, FIRST);
        // Places that were not looked at may hold another guess, unless their scores are far behind, too.
        let looked = if self.coarse.bands() > 1 { FIRST.places.1 } else { FIRST.places.0 };
        let score = |place: usize| self.places.get(place).map_or(0.0, |place| place.score);
        let is_alone = self.is_ahead(FAR_AHEAD) && score(0) > FAR_AHEAD * score(looked);
        let guess = self.guesses.first().copied().filter(|_| self.is_ahead(AHEAD))?;
        let guess = self.closer(image, guess);
        self.certain_about(image, &guess, if is_alone { LEAST_AGREEING_WHEN_AHEAD } else { CERTAIN_AGREEING })
    }

    /// Looks closer at the guesses; mostly one of the first is the ball, and then nothing else needs a look.
    ///
    /// `least` is the share of the rim that must agree with it.
    fn beyond_doubt(&mut self, image: ImageView<'_>, least: f64) -> Option<Circle> {
        for i in 0..self.guesses.len() {
            self.guesses[i] = self.closer(image, self.guesses[i]);
            if i < LIKELY
                && let Some(measured) = self.measure(image, &self.guesses[i].clone())
                && measured.agreeing > least
            {
                return Some(measured.circle);
            }
        }
        None
    }

    /// Ranks the places by their rim and measures the best.
    fn best_of_places(&mut self, image: ImageView<'_>, effort: Effort) -> Option<Circle> {
        self.rank(image, effort);
        if let Some(circle) = self.beyond_doubt(image, CERTAIN_AGREEING) {
            return Some(circle);
        }
        if effort.whole_rims {
            self.guess_from_whole_rims(image);
        }
        self.keep_finalists();
        for i in 0..self.guesses.len().min(effort.grown) {
            let guess = self.guesses[i];
            let grown = Guess { radius: guess.radius + GROWN_BY_PX, ..guess };
            let look = Look { reach_px: GROWN_BY_PX, tolerance_px: 0.7, draws: 60, rays: 120 };
            let Some(grown) = self.rays.look_again(image, &grown, look) else { continue };
            self.guesses.extend(self.rays.look_again(image, &grown, CLOSE));
        }
        self.keep_finalists();
        let mut best: Option<Measured> = None;
        for i in 0..self.guesses.len() {
            let guess = self.guesses[i];
            let Some(measured) = self.measure(image, &guess) else { continue };
            if best.is_none_or(|b| measured.agreeing > b.agreeing) {
                best = Some(measured);
            }
            if measured.agreeing > CERTAIN_AGREEING {
                break;
            }
        }
        best.map(|b| b.circle)
    }

    /// The guess once more with all rays; without support when there is nothing.
    fn closer(&mut self, image: ImageView<'_>, guess: Guess) -> Guess {
        let wide = Look { reach_px: REACH_PX, tolerance_px: 0.7, ..CLOSE };
        let is_near = guess.support > NEAR_SUPPORT;
        let better = if is_near { guess } else { self.rays.look_again(image, &guess, wide).unwrap_or(guess) };
        self.rays.look_again(image, &better, CLOSE).unwrap_or(Guess { support: 0.0, ..guess })
    }

    /// Adds circles through rims made whole by painting out small marks.
    ///
    /// Where more than half of a rim is speckle, steps inside the ball outnumber those of the rim.
    fn guess_from_whole_rims(&mut self, image: ImageView<'_>) {
        for place in self.places.iter().take(WHOLE_RIMS) {
            let (grey, scale) = self.coarse.without_marks_around(place);
            let Ok(view) = ImageView::new(&grey.data, grey.width, grey.height) else { continue };
            let (x, y) = self.coarse.reduced(place.band, place.x, place.y);
            let reach_px = (place.spread / scale + 2.0).max(3.0);
            let look = Look { reach_px, tolerance_px: 0.5, draws: 120, rays: 120 };
            let Some(whole) = self.rays.look(view, (x, y, place.radius / scale), look) else { continue };
            let (x, y) = self.coarse.full(place.band, whole.x, whole.y);
            let whole = Guess { x, y, radius: whole.radius * scale, ..whole };
            let near = Look { reach_px: 2.5, tolerance_px: 0.6, draws: 120, rays: 120 };
            self.guesses.extend(self.rays.look_again(image, &whole, near));
        }
    }

    /// Keeps the best distinct guesses, best first.
    fn keep_finalists(&mut self) {
        self.guesses.sort_by(|a, b| b.support.total_cmp(&a.support));
        let mut kept: usize = 0;
        for i in 0..self.guesses.len() {
            let guess = self.guesses[i];
            let same = |g: &Guess| {
                let apart = [g.x - guess.x, g.y - guess.y, g.radius - guess.radius];
                g.polarity == guess.polarity && apart.iter().all(|d| d.abs() < SAME_PX)
            };
            if kept < FINALISTS && !self.guesses[..kept].iter().any(same) {
                self.guesses[kept] = guess;
                kept += 1;
            }
        }
        self.guesses.truncate(kept);
    }

    fn measure(&mut self, image: ImageView<'_>, guess: &Guess) -> Option<Measured> {
        if guess.support < LEAST_SUPPORT {
            return None;
        }
        self.refine.circle(image, guess).filter(|measured| self.is_sized(&measured.circle))
    }

    /// Whether a circle is as large as the ball may be.
    fn is_sized(&self, circle: &Circle) -> bool {
        let range = self.params.min_radius_px - 1.0..=self.params.max_radius_px + 1.0;
        range.contains(&circle.radius_px)
    }
}

/// Whether the inside of a circle's rim is brighter than the outside; `None` when hardly any of the rim is in sight.
fn polarity(image: ImageView<'_>, (x, y, radius): (f32, f32, f32)) -> Option<Polarity> {
    const DIRECTIONS: usize = 48;
    let (mut difference, mut count) = (0.0, 0);
    for k in 0..DIRECTIONS {
        let (sin, cos) = (k as f32 * std::f32::consts::TAU / DIRECTIONS as f32).sin_cos();
        let level = |reach: f32| {
            let (x, y) = ((x + reach * cos).round(), (y + reach * sin).round());
            if x < 0.0 || y < 0.0 { None } else { image.at(x as usize, y as usize) }
        };
        if let (Some(inside), Some(outside)) = (level(radius - INNER_BAND_PX as f32), level(radius + BAND_PX as f32)) {
            difference += inside - outside;
            count += 1;
        }
    }
    let sign = if difference > 0.0 { Polarity::Brighter } else { Polarity::Darker };
    (4 * count > DIRECTIONS).then_some(sign)
}
