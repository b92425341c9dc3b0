//! The bounce of a ball, and its acceleration in free flight.

use super::follower::TrackPoint;
use super::path_fit::PathFit;

/// The number of points on either side of a bounce from which velocities are fitted.
const SIDE_POINTS: std::ops::RangeInclusive<usize> = 3..=24;
/// The share of a track that these points make up on either side.
const SIDE_SHARE: usize = 6;
/// The minimum ratio of the residuals of one parabola through the whole track to those of its parts at a bounce.
const MIN_MISFIT: f64 = 4.0;
/// The systematic error of the centres along a flight, px. Outlines depend on the speckles at the rim and on the light.
const CENTER_ERROR_PX: f64 = 0.1;
/// The minimum number of points of a flight whose acceleration is fitted.
const FLIGHT_POINTS: usize = 6;

/// A sudden change of the velocity: the ball strikes something.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounce {
    /// The number of the frame in the film, from 0.
    pub index: u64,
    /// The time since the first frame, s.
    pub t_s: f64,
    /// The centre, px.
    pub center_px: [f64; 2],
    /// The direction of the change of velocity, in image axes (y down), of length 1.
    pub direction: [f64; 2],
    /// The velocity before and after, px/s.
    pub velocities_px_s: [[f64; 2]; 2],
}

/// The change of velocity between the points on either side of a moment.
struct Change {
    /// The number of the point in the track.
    at: usize,
    velocities_px_s: [[f64; 2]; 2],
    change_px_s: [f64; 2],
    /// The rms residual of both sides.
    rms_px: f64,
}

/// The acceleration in free flight, px/s^2, in image axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Acceleration {
    /// Along x and along y (down), px/s^2.
    pub value_px_s2: [f64; 2],
    /// The standard uncertainty of each component, px/s^2.
    pub sigma_px_s2: f64,
}

/// The motion of a ball in a film.
#[derive(Debug, Clone, PartialEq)]
pub struct Path {
    /// The track.
    pub track: Vec<TrackPoint>,
    /// The bounce with the largest change of velocity.
    pub bounce: Option<Bounce>,
    /// The acceleration before and after the bounce, or in the whole track.
    pub acceleration: Option<Acceleration>,
    /// The maximum speed, px/frame.
    pub speed_px_frame: f64,
}

impl Path {
    /// Evaluates a track: its bounce, its acceleration and its maximum speed.
    pub fn from_track(track: Vec<TrackPoint>) -> Self {
        let side = (track.len() / SIDE_SHARE).clamp(*SIDE_POINTS.start(), *SIDE_POINTS.end());
        let bounce = find_bounce(&track, side);
        let flights: Vec<&[TrackPoint]> = match &bounce {
            None => vec![&track],
            Some(bounce) => {
                let at = track.partition_point(|point| point.index < bounce.index);
                // Not the contact, which may last long.
                vec![&track[..at.saturating_sub(side / 2)], &track[(at + side / 2 + 1).min(track.len())..]]
            }
        };
        let acceleration = mean_acceleration(&flights);
        let speed = |pair: &[TrackPoint]| {
            let frames = (pair[1].index - pair[0].index).max(1) as f64;
            let [from, to] = [&pair[0].circle, &pair[1].circle];
            (to.x_px - from.x_px).hypot(to.y_px - from.y_px) / frames
        };
        let speed_px_frame = track.windows(2).map(speed).fold(0.0, f64::max);
        Self { bounce, acceleration, speed_px_frame, track }
    }
}

/// Finds the bounce with the largest change of velocity between lines through `side` points before and after.
///
/// `None` if the track is too short, one parabola explains it, or the ball does not reverse along the change.
fn find_bounce(track: &[TrackPoint], side: usize) -> Option<Bounce> {
    if track.len() < 2 * side + 1 {
        return None;
    }
    let change = |at: usize| {
        let (before, after) = (PathFit::fit(&track[at - side..at], 1)?, PathFit::fit(&track[at..at + side], 1)?);
        let velocities_px_s = [&before, &after].map(|side| side.velocity(track[at].t_s));
        let [[x0, y0], [x1, y1]] = velocities_px_s;
        let change_px_s = [x1 - x0, y1 - y0];
        Some(Change { at, velocities_px_s, change_px_s, rms_px: before.rms_px.hypot(after.rms_px) })
    };
    let changes: Vec<_> = (side..=track.len() - side).filter(|at| *at < track.len()).filter_map(change).collect();
    let size_px_s = |change: &Change| change.change_px_s[0].hypot(change.change_px_s[1]);
    let largest = changes.iter().max_by(|a, b| size_px_s(a).total_cmp(&size_px_s(b)))?;
    let mut noise: Vec<f64> = changes.iter().map(|change| change.rms_px).collect();
    noise.sort_by(f64::total_cmp);
    let whole = PathFit::fit(track, 2)?;
    if whole.rms_px < MIN_MISFIT * noise[noise.len() / 4].max(0.02) {
        return None;
    }
    let Change { at, velocities_px_s, change_px_s: [x, y], .. } = *largest;
    let size = size_px_s(largest);
    let direction = [x / size, y / size];
    let approach = velocities_px_s[0][0] * direction[0] + velocities_px_s[0][1] * direction[1];
    if approach >= 0.0 {
        return None;
    }
    // It is deepest where it is farthest against this direction.
    let depth = |point: &TrackPoint| point.circle.x_px * direction[0] + point.circle.y_px * direction[1];
    let near = &track[at.saturating_sub(side)..(at + side).min(track.len())];
    let deepest = near.iter().min_by(|a, b| depth(a).total_cmp(&depth(b)))?;
    Some(Bounce {
        index: deepest.index,
        t_s: deepest.t_s,
        center_px: [deepest.circle.x_px, deepest.circle.y_px],
        direction,
        velocities_px_s,
    })
}

/// Returns the mean acceleration of flights, px/s^2, weighted by their inverse variances; `None` if all have fewer than
/// [`FLIGHT_POINTS`] points.
fn mean_acceleration(flights: &[&[TrackPoint]]) -> Option<Acceleration> {
    let mut sums = [0.0; 3];
    for flight in flights.iter().filter(|flight| flight.len() >= FLIGHT_POINTS) {
        let Some(fit) = PathFit::fit(flight, 2) else { continue };
        let [x, y] = fit.acceleration();
        let span_s = flight[flight.len() - 1].t_s - flight[0].t_s;
        // A parabola of this acceleration rises by an eighth of it times span^2 above its chord.
        let sigma = x.sigma.hypot(8.0 * CENTER_ERROR_PX / (span_s * span_s));
        let weight = 1.0 / (sigma * sigma).max(f64::MIN_POSITIVE);
        sums = [sums[0] + weight * x.value, sums[1] + weight * y.value, sums[2] + weight];
    }
    let [x, y, weight] = sums;
    (weight > 0.0).then(|| Acceleration { value_px_s2: [x / weight, y / weight], sigma_px_s2: weight.sqrt().recip() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::Circle;

    /// A ball that falls with 2000 px/s^2 from 100 px/s and bounces after 0.1 s with 0.8 of its speed.
    fn track(bounces: bool) -> Vec<TrackPoint> {
        let point = |index: u64| {
            let t_s = index as f64 / 240.0;
            let noise = ((crate::numeric::scramble(index + 7) % 1000) as f64 / 1000.0 - 0.5) * 0.1;
            let fall = |t: f64| 100.0 * t + 1000.0 * t * t;
            let since = t_s - 0.1;
            let y_px =
                if bounces && since > 0.0 { fall(0.1) - 240.0 * since + 1000.0 * since * since } else { fall(t_s) };
            let circle = Circle {
                x_px: 50.0 + 30.0 * t_s + noise,
                y_px: y_px + noise,
                radius_px: 20.0,
                sigma_center_px: 0.05,
                sigma_radius_px: 0.05,
                visible_fraction: 1.0,
            };
            TrackPoint { index, t_s, circle }
        };
        (0..48).map(point).collect()
    }

    #[test]
    fn a_bounce_is_found_with_its_direction_and_gravity_on_both_sides() {
        let path = Path::from_track(track(true));
        let bounce = path.bounce.unwrap();
        assert_eq!(bounce.index, 24);
        assert!(bounce.direction[1] < -0.99, "{:?}", bounce.direction);
        let acceleration = path.acceleration.unwrap();
        let off = (acceleration.value_px_s2[1] - 2000.0) / acceleration.sigma_px_s2;
        assert!(off.abs() < 4.0 && acceleration.sigma_px_s2 < 150.0, "{acceleration:?}");
        assert!((path.speed_px_frame - 1.25).abs() < 0.2, "{}", path.speed_px_frame);
    }

    #[test]
    fn a_fall_is_no_bounce() {
        let path = Path::from_track(track(false));
        assert!(path.bounce.is_none());
        let acceleration = path.acceleration.unwrap();
        assert!((acceleration.value_px_s2[1] - 2000.0).abs() < 4.0 * acceleration.sigma_px_s2, "{acceleration:?}");
        assert!(Path::from_track(track(true)[..5].to_vec()).bounce.is_none());
    }
}
