//! The track of a ball through all frames of a film.

use super::identify::{ExaminedFrame, Identified, RADIUS_TOLERANCE, with_margin};
use super::movement::Mover;
use crate::ball::{BallError, BallFinder, BallParams};
use crate::results::Circle;

/// The range of radii that is searched, relative to that of the ball.
pub(super) const RADIUS_RANGE: [f64; 2] = [0.8, 1.25];
/// The maximum number of frames in a row without the ball; beyond it, the ball is searched in every fourth frame only.
const MAX_MISSES: u32 = 8;

/// A ball in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackPoint {
    /// The number of the frame in the film, from 0.
    pub index: u64,
    /// The time since the first frame, s.
    pub t_s: f64,
    /// The outline.
    pub circle: Circle,
}

/// Follows a ball from frame to frame.
#[derive(Debug)]
pub struct Follower {
    finder: BallFinder,
    track: Vec<TrackPoint>,
    misses: u32,
}

impl Follower {
    /// Plans to follow a ball of this radius, px, within the region that `mover` sweeps in frames of this width and
    /// height, px.
    ///
    /// # Errors
    ///
    /// [`BallError`] when the radius is out of the range of the finder.
    pub fn new(mover: &Mover, radius_px: f64, size_px: [usize; 2]) -> Result<Self, BallError> {
        let [low, high] = RADIUS_RANGE.map(|share| share * radius_px);
        let roi_px = Some(with_margin(mover.bounds_px, size_px));
        let params = BallParams { roi_px, ..BallParams::new(low.max(super::identify::MIN_RADIUS_PX), high) };
        Ok(Self { finder: BallFinder::new(&params, size_px[0], size_px[1])?, track: Vec::new(), misses: 0 })
    }

    /// Finds the ball in the next frame, at its time since the first one, s, and adds it to the track.
    ///
    /// After eight frames without the ball, only every fourth frame is searched.
    pub fn push(&mut self, frame: ExaminedFrame<'_>, t_s: f64) {
        let predicted = self.predict_circle(t_s).filter(|_| self.misses == 0);
        let followed = predicted.and_then(|near| self.finder.follow(frame.image, &near));
        let is_searched = self.misses < MAX_MISSES || frame.index.is_multiple_of(4);
        let found = followed.or_else(|| if is_searched { self.finder.find(frame.image) } else { None });
        match found {
            Some(circle) => {
                self.misses = 0;
                self.track.push(TrackPoint { index: frame.index, t_s, circle });
            }
            None => self.misses = self.misses.saturating_add(1),
        }
    }

    /// Predicts the circle at a time, s, by the velocity between the last two; `None` before the first.
    ///
    /// A single circle is taken to stay where it is.
    fn predict_circle(&self, t_s: f64) -> Option<Circle> {
        let last = self.track.last()?;
        let before = self.track.len().checked_sub(2).map(|place| self.track[place]);
        let Some(before) = before.filter(|before| last.t_s > before.t_s) else { return Some(last.circle) };
        let share = (t_s - last.t_s) / (last.t_s - before.t_s);
        let ahead = |from: f64, to: f64| to + share * (to - from);
        Some(Circle {
            x_px: ahead(before.circle.x_px, last.circle.x_px),
            y_px: ahead(before.circle.y_px, last.circle.y_px),
            ..last.circle
        })
    }

    /// Returns the track, without circles that the ball cannot have reached.
    ///
    /// The speeds to and from such a circle are both above four times the upper quartile of all. The first and the last
    /// circle are kept.
    pub fn finish(self) -> Vec<TrackPoint> {
        let track = self.track;
        let speed = |a: &TrackPoint, b: &TrackPoint| {
            (a.circle.x_px - b.circle.x_px).hypot(a.circle.y_px - b.circle.y_px) / (a.t_s - b.t_s).abs().max(1e-12)
        };
        let mut speeds: Vec<f64> = track.windows(2).map(|pair| speed(&pair[0], &pair[1])).collect();
        speeds.sort_by(f64::total_cmp);
        // In three quarters of the frames it is the ball.
        let Some(usual) = speeds.get(3 * speeds.len() / 4) else { return track };
        let limit = 4.0 * usual;
        let is_near = |place: usize, other: Option<usize>| {
            other.and_then(|other| track.get(other)).is_none_or(|other| speed(&track[place], other) <= limit)
        };
        let kept = |place: &usize| is_near(*place, place.checked_sub(1)) || is_near(*place, Some(place + 1));
        (0..track.len()).filter(kept).map(|place| track[place]).collect()
    }
}

impl Identified {
    /// Whether both are balls whose radii differ by less than 12 %.
    pub fn is_same_ball(&self, other: &Self) -> bool {
        let radii = self.ball_radius_px().zip(other.ball_radius_px());
        radii.is_some_and(|(a, b)| (a / b - 1.0).abs() < RADIUS_TOLERANCE)
    }

    /// Returns the number of examined frames in which the ball was found; 0 for other kinds.
    pub fn found_frames(&self) -> usize {
        match self {
            Self::Ball { circles, .. } => circles.len(),
            _ => 0,
        }
    }

    /// Returns the median radius of a ball, px; `None` for other kinds.
    pub fn ball_radius_px(&self) -> Option<f64> {
        match self {
            Self::Ball { radius_px, .. } => Some(*radius_px),
            _ => None,
        }
    }
}
