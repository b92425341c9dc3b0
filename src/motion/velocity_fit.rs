//! The velocity at one frame: a local fit to the integrated poses.

use super::{MotionParams, PixelRates, Pose};
use crate::numeric::{MAX_ORDER, Polynomial, Sample, exp};
use crate::results::{Estimate, RigidStep};

/// The default lag of rates, frames: the reach ahead of every fit that the regime selects.
pub const DEFAULT_LAG_FRAMES: u64 = 20;
/// Window and order of the fit while the regime is unknown.
const DEFAULT: (u32, usize) = (9, 2);
/// The same for rows with a shorter lag than the default, whose frame lies at the end of the window.
///
/// There, the error of order 2 at the onset of a force is larger than the difference between two orders shows.
const EARLY: (u32, usize) = (11, 3);
/// The reach ahead of the fit in free flight, frames; an undetected contact lies further ahead.
const FLIGHT_AHEAD: u64 = 14;
/// The reach back of the fit in free flight, frames.
const FLIGHT_BACK: u64 = 40;
/// The order of the fit during contact.
const CONTACT_ORDER: usize = 4;
/// The maximum difference between a measured and a known acceleration that are taken as equal, sigmas.
const SAME_ACCELERATION: f64 = 3.5;
/// The prior odds that a body falls with the configured gravity. A camera above a table sees another acceleration.
const GRAVITY_ODDS: f64 = 20.0;
/// The ratio of a contact's fifth derivative to that of half a sine: contacts begin and end more sharply.
const SHARPNESS: f64 = 10.0;

/// The minimum significant difference between the rates of two orders, sigmas.
const SIGNIFICANT_SIGMAS: f64 = 2.0;
/// The offsets in nodes at which an impact between frames is searched, and the share of it that is left there.
const IMPACT_OFFSETS: [(isize, f64); 5] = [(0, 1.0), (-1, 0.7), (1, 0.7), (-2, 0.4), (2, 0.4)];
/// The maximum ratio of the scatter about a line to the samples' sigmas that counts as unmodelled noise.
const MAX_EXCESS: f64 = 4.0;
/// The half width of the fit across the moment at which a force sets in or ends, frames.
const ACROSS_FRAMES: u64 = 8;
/// The decay length of the error of the order-4 window inside a contact, frames.
const INSIDE_FRAMES: f64 = 6.0;
/// The minimum error of the velocity where a force sets in or ends, as a multiple of the peak acceleration, frames.
const MIN_TRANSITION_ERROR: f64 = 0.02;
/// The error of the flight before a contact as a share of the difference, and its decay length, frames.
///
/// It is short, because the onset of a force is detected at once.
const BEFORE: (f64, f64) = (0.4, 1.5);
/// The error of the flight after a contact as a share of the difference, and its decay length, frames.
///
/// It is longer, because the end of a force is detected late.
const AFTER: (f64, f64) = (0.6, 3.0);

/// The maximum change of the rates by an undetected force in the last frames before a gap, in units of a step's noise.
///
/// The first is that of the frame next to the gap. The same holds for the first frames after it.
const MAX_UNOBSERVED_CHANGE: [f64; GAP_FRAMES] = [2.5, 1.5, 0.7, 0.3];
/// The number of frames on either side of a gap whose rates may miss a force.
const GAP_FRAMES: usize = 4;

/// The minimum number of measured rotations from frame to frame behind a spin.
const MIN_TURNING_STEPS: usize = 2;

/// The known motion of a body around a frame.
#[derive(Debug, Clone, Copy)]
pub struct KnownMotion<'a> {
    /// Its nodes in order of frames.
    pub nodes: &'a [Pose],
    /// The newest frame that was measured; without a node before it the body was not visible.
    pub to_frame: u64,
    /// Gravity in the image, px/frame^2.
    pub gravity: Option<[f64; 2]>,
}

/// The known regime of the motion around a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Regime {
    /// Unknown.
    Unknown,
    /// Free of the surface from one frame to another, both included.
    Flight {
        /// First frame.
        from: u64,
        /// Last frame.
        to: u64,
    },
    /// In contact with the surface.
    Contact {
        /// Approach speed, px/frame.
        speed_px: f64,
        /// Peak acceleration so far, px/frame^2.
        acceleration_px: f64,
        /// First frame.
        from: u64,
        /// First frame after it; `None` while that is not known.
        to: Option<u64>,
    },
}

/// Returns the samples of one coordinate of the nodes: x (0), y (1) or the angle (2).
fn axis_samples(nodes: &[Pose], axis: usize) -> Vec<Sample> {
    let sample = |n: &Pose| Sample {
        time_frames: n.time_frames,
        component: if axis == 2 { n.turn } else { n.component },
        value: n.pose[axis],
        sigma: n.sigma[axis],
        walk: n.walk_share[axis] * n.sigma[axis],
    };
    nodes.iter().map(sample).collect()
}

/// Whether the rotation between enough of the nodes was measured for a rate.
fn has_rotation(nodes: &[Pose]) -> bool {
    // Steps over n frames make n interleaved components.
    let mut turns: Vec<u32> = nodes.iter().map(|node| node.turn).collect();
    turns.sort_unstable();
    turns.windows(2).filter(|pair| pair[0] == pair[1]).count() >= MIN_TURNING_STEPS
}

/// Fits one polynomial of `order` per coordinate to all `nodes`, about `at_frames`, and returns the rates there.
///
/// A Savitzky-Golay fit generalised to true times, gaps and interleaved components. Every component has its own free
/// offset, and the other coefficients are shared (Savitzky & Golay 1964, doi:10.1021/ac60214a047). Where the nodes do
/// not determine the order it is lowered; `None` where they determine no rate. The sigmas are propagated from the
/// nodes', and widened where the scatter about the fit is significantly larger. `gravity` is a known acceleration along x
/// and y, px/frame^2.
pub(super) fn fit_rates(nodes: &[Pose], at_frames: f64, order: usize, gravity: [f64; 2]) -> Option<PixelRates> {
    let acceleration = [gravity[0], gravity[1], 0.0];
    let mut order = order;
    let is_turning = has_rotation(nodes);
    let fits = loop {
        let fit = |axis: usize| Polynomial::fit(&axis_samples(nodes, axis), at_frames, order, acceleration[axis]);
        let theta = if is_turning { fit(2) } else { None };
        match (fit(0), fit(1), theta) {
            (Some(x), Some(y), theta) if theta.is_some() || !is_turning => break (x, y, theta),
            _ if order > 1 => order -= 1,
            _ => return None,
        }
    };
    let rate = |fit: &Polynomial| {
        let rate = fit.rate(at_frames);
        Estimate { value: rate.value, sigma: rate.sigma * fit.excess() }
    };
    let (x, y) = (rate(&fits.0), rate(&fits.1));
    let theta = fits.2.as_ref().map_or(Estimate { value: 0.0, sigma: RigidStep::ANY_ROTATION_DEG }, rate);
    let span = nodes.last()?.frame - nodes.first()?.frame + 1;
    Some(PixelRates { x, y, theta, window_frames: u32::try_from(span).ok()?, order: u32::try_from(order).ok()? })
}

/// Fits like [`fit_rates`] without an acceleration, and includes the truncation error in the sigmas.
///
/// The truncation error is the difference from the rates of the next order that changes them, beyond their noise.
fn fit_with_truncation_error(nodes: &[Pose], at_frames: f64, order: usize) -> Option<PixelRates> {
    let rates = fit_rates(nodes, at_frames, order, [0.0; 2])?;
    // In the middle of a window, an even order has the rates of the odd one below.
    let finer = fit_rates(nodes, at_frames, ((order + 1) | 1).min(MAX_ORDER), [0.0; 2])?;
    if finer.order <= rates.order {
        return Some(rates);
    }
    let truncation = |rate: Estimate, finer: Estimate| {
        let noise = (finer.sigma.powi(2) - rate.sigma.powi(2)).max(0.0);
        ((finer.value - rate.value).powi(2) - SIGNIFICANT_SIGMAS.powi(2) * noise).max(0.0).sqrt()
    };
    let rates = rates.widened_by([
        truncation(rates.x, finer.x),
        truncation(rates.y, finer.y),
        truncation(rates.theta, finer.theta),
    ]);
    Some(rates.widened_by(velocity_jump_error(nodes, at_frames, order)))
}

/// Returns the error of the rates because of a velocity jump near `at_frames`: half of the jump beyond its noise.
///
/// In px/frame and deg/frame; 0 where a polynomial of `order` fits. An impact between two frames does not curve the
/// track, so a higher order does not reveal it.
fn velocity_jump_error(nodes: &[Pose], at_frames: f64, order: usize) -> [f64; 3] {
    let fits = |axis: usize| {
        Polynomial::fit(&axis_samples(nodes, axis), at_frames, order, 0.0).is_none_or(|f| f.excess() <= 1.0)
    };
    if (0..3).all(fits) {
        return [0.0; 3];
    }
    let middle = nodes.partition_point(|node| node.time_frames < at_frames);
    let mut largest = [0.0_f64; 3];
    for (offset, share) in IMPACT_OFFSETS {
        let Some(split) = middle.checked_add_signed(offset).filter(|split| *split < nodes.len()) else { continue };
        let at_frames = nodes[split].time_frames;
        let sides = [&nodes[..=split], &nodes[split..]].map(|side| fit_rates(side, at_frames, order, [0.0; 2]));
        let [Some(before), Some(after)] = sides else { continue };
        let axes = [(before.x, after.x), (before.y, after.y), (before.theta, after.theta)];
        for (largest, (before, after)) in largest.iter_mut().zip(axes) {
            let noise = SIGNIFICANT_SIGMAS * before.sigma.hypot(after.sigma);
            let change = ((after.value - before.value).powi(2) - noise * noise).max(0.0).sqrt();
            *largest = largest.max(0.5 * share * change);
        }
    }
    largest
}

/// Returns the nodes of the frames `from` to `to`, both included.
pub(super) fn nodes_between(nodes: &[Pose], from: u64, to: u64) -> &[Pose] {
    let first = nodes.partition_point(|n| n.frame < from);
    let end = nodes.partition_point(|n| n.frame <= to);
    &nodes[first..end.max(first)]
}

/// Returns the nodes in a window of `width` frames about `frame`.
///
/// The window is moved inwards at the ends of the nodes, but never extends past `frame + ahead`.
pub(super) fn fit_window(nodes: &[Pose], frame: u64, width: u64, ahead: u64) -> &[Pose] {
    let (Some(first), Some(last)) = (nodes.first(), nodes.last()) else { return nodes };
    let last = last.frame.min(frame + ahead);
    let width = width.max(2);
    let from = frame.saturating_sub(width / 2).max(first.frame);
    let to = (from + width - 1).min(last);
    nodes_between(nodes, (to + 1).saturating_sub(width).max(first.frame), to)
}

/// Estimates the rates at the node of `frame`, from nodes no newer than `frame + params.lag_frames`.
///
/// With a window in `params`, it is the plain local fit of that window and order, and the sigmas include the difference
/// from a higher order. Otherwise the regime selects both:
///
/// - in flight, a straight line with known gravity over up to 55 frames of the same flight, after testing that the
///   acceleration there is gravity's (or none);
/// - in contact, order 4 over the window with the smallest noise^2 + bias^2. For a window of 2 h + 1 frames, noise =
///   3.06 sigma / h^1.5 and bias = |5th derivative| h^4 / 504, with the derivative estimated from the approach speed
///   and the peak acceleration;
/// - otherwise order 2 over 9 frames.
///
/// Where the force sets in or ends, neither fit is right: the sigmas of frames near there include the difference
/// between the two. With a lag below the default, the course of a force is not known yet, and all rows but those of free
/// flight are fitted with order 3 over 11 frames. The sigmas near a frame in which a body is lost, or detected again, include the unobserved force, as
/// do all with a lag so short that a force is not detected yet.
pub fn smooth(known: KnownMotion<'_>, frame: u64, regime: Regime, params: &MotionParams) -> Option<PixelRates> {
    let KnownMotion { nodes, gravity, .. } = known;
    let at = nodes[nodes.binary_search_by_key(&frame, |n| n.frame).ok()?];
    let n = u64::from(params.interval_frames.max(1));
    let lag = params.lag_frames;
    let plain = |width: u64, order: usize| {
        fit_with_truncation_error(fit_window(nodes, frame, width, lag), at.time_frames, order)
    };
    if let Some(width) = params.window_frames {
        return plain(u64::from(width), params.order as usize);
    }
    let is_early = lag < DEFAULT_LAG_FRAMES;
    let (width, order) = if is_early { EARLY } else { DEFAULT };
    let fallback = || plain(u64::from(width) + n - 1, order);
    let edges = force_edges(frame, regime);
    let has_force = matches!(regime, Regime::Contact { .. }) || edges.iter().any(Option::is_some);
    if is_early && has_force {
        // The course of a force is known only once it has ended.
        return fallback();
    }
    let rates = match regime {
        Regime::Unknown => return fallback(),
        Regime::Flight { from, to } => {
            let (back, ahead) = (from.max(frame.saturating_sub(FLIGHT_BACK)), to.min(frame + FLIGHT_AHEAD.min(lag)));
            let rates = fit_flight(nodes_between(nodes, back, ahead), at.time_frames, gravity).or_else(fallback)?;
            rates.widened_by(unobserved_force_error(known, frame, lag, n))
        }
        Regime::Contact { speed_px, acceleration_px, .. } => {
            let sigma = (at.sigma[0] + at.sigma[1]) / 2.0;
            let half = contact_half_width(sigma, speed_px, acceleration_px);
            let across = fit_window(nodes, frame, 2 * half + n, lag);
            let rates = fit_rates(across, at.time_frames, CONTACT_ORDER, [0.0; 2])?;
            let bias_px = contact_bias(half, speed_px, acceleration_px);
            let [_, _, jump] = velocity_jump_error(across, at.time_frames, CONTACT_ORDER);
            rates.widened_by([bias_px, bias_px, jump])
        }
    };
    let nodes = nodes_between(nodes, 0, frame + lag);
    let widened = |rates: PixelRates, edge: &Edge| {
        let difference = edge.difference(nodes, gravity).unwrap_or_default();
        rates.widened_by(std::array::from_fn(|k| edge.share * difference[k].hypot(edge.min_error[k])))
    };
    Some(edges.iter().flatten().fold(rates, widened))
}

/// A moment near a frame at which a force sets in or ends.
struct Edge {
    /// The first frame after it.
    frame: u64,
    /// First and last frame of the flight next to it.
    flight: (u64, u64),
    /// The share of the difference that remains in the given frame.
    share: f64,
    /// The minimum error, added in quadrature: x and y, px/frame, and the angle, deg/frame.
    min_error: [f64; 3],
}

/// Returns the moments near a frame at which a force sets in or ends: before it and after it.
fn force_edges(frame: u64, regime: Regime) -> [Option<Edge>; 2] {
    let before = |edge: u64, from: u64| (edge.saturating_sub(FLIGHT_BACK).max(from), edge.saturating_sub(1));
    let after = |edge: u64, to: u64| (edge, to.min(edge.saturating_add(FLIGHT_AHEAD)));
    let both = match regime {
        Regime::Unknown => [None, None],
        Regime::Flight { from, to } => {
            let share = |(share, decay): (f64, f64), frames: u64| share * (1.0 - frames as f64 / decay);
            let edge = |frame: u64, flight: (u64, u64), share: f64| Edge { frame, flight, share, min_error: [0.0; 3] };
            let ends = to
                .checked_add(1)
                .map(|edge_at| edge(edge_at, before(edge_at, from), share(BEFORE, to.abs_diff(frame))));
            [ends, (from > 0).then(|| edge(from, after(from, to), share(AFTER, frame.abs_diff(from))))]
        }
        Regime::Contact { acceleration_px, from, to, .. } => {
            let error_px = MIN_TRANSITION_ERROR * acceleration_px;
            let min_error = [error_px, error_px, 0.0];
            let share = |frames: u64| 1.0 - frames as f64 / INSIDE_FRAMES;
            let edge = |frame: u64, flight: (u64, u64), share: f64| Edge { frame, flight, share, min_error };
            let ends = to.map(|to| edge(to, after(to, u64::MAX), share(to.abs_diff(frame))));
            [Some(edge(from, before(from, 0), share(frame.abs_diff(from)))), ends]
        }
    };
    both.map(|edge| edge.filter(|edge| edge.share > 0.0))
}

impl Edge {
    /// Returns the difference between the rates of the flight and of a fit across the moment: x and y, px/frame, and
    /// the angle, deg/frame.
    ///
    /// The flight omits the force, and the fit spreads it over its window; the truth lies between them.
    fn difference(&self, nodes: &[Pose], gravity: Option<[f64; 2]>) -> Option<[f64; 3]> {
        let at_frames = nodes[nodes.binary_search_by_key(&self.frame, |n| n.frame).ok()?].time_frames;
        let flight = fit_flight(nodes_between(nodes, self.flight.0, self.flight.1), at_frames, gravity)?;
        let across = fit_window(nodes, self.frame, 2 * ACROSS_FRAMES + 1, ACROSS_FRAMES);
        let across = fit_rates(across, at_frames, CONTACT_ORDER, [0.0; 2])?;
        let difference = |a: Estimate, b: Estimate| (a.value - b.value).abs();
        Some([difference(flight.x, across.x), difference(flight.y, across.y), difference(flight.theta, across.theta)])
    }
}

/// Returns the possible effect of an unobserved force on the rates next to a gap, per frame.
///
/// A body that is lost as a contact begins has hardly been decelerated before, and the flight does not reveal it. The
/// bound is what its last steps leave open. The same holds for a body whose next frames are beyond the lag.
fn unobserved_force_error(known: KnownMotion<'_>, frame: u64, lag: u64, interval: u64) -> [f64; 3] {
    let nodes = nodes_between(known.nodes, 0, known.to_frame.min(frame + lag));
    let to_frame = if lag < GAP_FRAMES as u64 { u64::MAX } else { known.to_frame.min(frame + lag) };
    let Ok(own) = nodes.binary_search_by_key(&frame, |node| node.frame) else { return [0.0; 3] };
    let is_gap = |pair: &[Pose]| pair[1].frame > pair[0].frame + 1;
    let later = nodes[own..].windows(2).take(GAP_FRAMES).position(is_gap);
    let ends = || nodes.len() - 1 - own < GAP_FRAMES && nodes.last().is_some_and(|last| last.frame < to_frame);
    let later = later.or_else(|| ends().then(|| nodes.len() - 1 - own));
    let earlier = nodes[..=own].windows(2).rev().take(GAP_FRAMES).position(is_gap);
    let Some(distance) = later.into_iter().chain(earlier).min() else { return [0.0; 3] };
    let noise = |axis: usize| nodes[own].sigma[axis] * f64::sqrt(2.0) / interval as f64;
    std::array::from_fn(|axis| MAX_UNOBSERVED_CHANGE[distance] * noise(axis))
}

/// Fits a line with known gravity, px/frame^2, or with none, where the measured acceleration agrees with it.
///
/// If it agrees with both, the nodes and [`GRAVITY_ODDS`] decide, and what they leave open is part of the uncertainty.
/// `None` if it agrees with neither, or if the nodes scatter more than noise.
fn fit_flight(nodes: &[Pose], at_frames: f64, gravity: Option<[f64; 2]>) -> Option<PixelRates> {
    let (first, last) = (nodes.first()?, nodes.last()?);
    let middle = 0.5 * (first.time_frames + last.time_frames);
    let free = [0, 1].map(|axis| Polynomial::fit(&axis_samples(nodes, axis), middle, 2, 0.0));
    if free.iter().flatten().any(|fit| fit.excess() > MAX_EXCESS) {
        return None;
    }
    let distances = |known: [f64; 2]| {
        [0, 1].map(|axis| {
            free[axis].as_ref().map_or(0.0, |fit| {
                let a = fit.curvature();
                (a.value - known[axis]).abs() / (a.sigma * fit.excess())
            })
        })
    };
    let agrees = |distances: [f64; 2]| distances.iter().all(|distance| *distance <= SAME_ACCELERATION);
    let falls = gravity.map(|gravity| (gravity, distances(gravity))).filter(|(_, distances)| agrees(*distances));
    let none = Some(distances([0.0; 2])).filter(|distances| agrees(*distances));
    let line = |known: [f64; 2]| fit_rates(nodes, at_frames, 1, known);
    let (gravity, falling, resting) = match (falls, none) {
        (Some((gravity, falling)), Some(resting)) => (gravity, falling, resting),
        (Some((gravity, _)), None) => return line(gravity),
        (None, Some(_)) => return line([0.0; 2]),
        (None, None) => return None,
    };
    let chi2 = |distances: [f64; 2]| distances.iter().map(|distance| distance.powi(2)).sum::<f64>();
    let odds = GRAVITY_ODDS * exp(0.5 * (chi2(resting) - chi2(falling)));
    let share = odds / (1.0 + odds);
    let (falling, resting) = (line(gravity)?, line([0.0; 2])?);
    let doubt = (share * (1.0 - share)).sqrt();
    let apart = [(falling.x, resting.x), (falling.y, resting.y)].map(|(a, b)| doubt * (a.value - b.value).abs());
    let likelier = if odds >= 1.0 { falling } else { resting };
    Some(likelier.widened_by([apart[0], apart[1], 0.0]))
}

/// Returns the half width, frames, of the order-4 window with the smallest noise^2 + bias^2: see [`smooth`].
fn contact_half_width(sigma: f64, speed_px: f64, acceleration_px: f64) -> u64 {
    let cost = |half: u64| {
        9.375 * sigma * sigma / (half as f64).powi(3) + contact_bias(half, speed_px, acceleration_px).powi(2)
    };
    (4..=12).min_by(|a, b| cost(*a).total_cmp(&cost(*b))).unwrap_or(6)
}

/// Returns the truncation error of the order-4 window of this half width inside a contact, px/frame: see [`smooth`].
///
/// The contact is taken as half a sine with this approach speed, px/frame, and peak acceleration, px/frame^2.
fn contact_bias(half: u64, speed_px: f64, acceleration_px: f64) -> f64 {
    let omega = (acceleration_px / speed_px.max(1e-9)).clamp(0.0, 1.0);
    let fifth = SHARPNESS * speed_px * omega.powi(4) * std::f64::consts::FRAC_1_SQRT_2;
    fifth * (half as f64).powi(4) / 504.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The nodes of a body along y with this acceleration, px/frame^2, and a scatter of 0.2 px.
    fn nodes(acceleration: f64) -> Vec<Pose> {
        let node = |frame: u64| {
            let (t, noise) = (frame as f64, 0.2 * ((frame * 37 % 17) as f64 - 8.0) / 5.0);
            Pose {
                frame,
                time_frames: t,
                component: 0,
                turn: 0,
                pose: [0.3 * t, 1.4 * t + 0.5 * acceleration * t * t + noise, 0.0],
                sigma: [0.2; 3],
                bridged: [0.0; 3],
                walk_share: [0.0; 3],
                kept: None,
            }
        };
        (0..15).map(node).collect()
    }

    #[test]
    fn a_flight_too_short_to_show_gravity_is_uncertain_by_it() {
        let gravity_px = 0.02;
        for acceleration in [0.0, gravity_px] {
            let rates = fit_flight(&nodes(acceleration), 0.0, Some([0.0, gravity_px])).unwrap();
            assert!((rates.y.value - 1.4).abs() < 5.0 * rates.y.sigma, "{acceleration}: {rates:?}");
        }
        // Where the motion shows it, nothing is left open.
        let (fast, exact) =
            (fit_flight(&nodes(2.0), 0.0, Some([0.0, 2.0])), fit_rates(&nodes(2.0), 0.0, 1, [0.0, 2.0]));
        assert_eq!(fast, exact);
    }
}
