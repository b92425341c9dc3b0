//! The moment at which the contact point stops slipping.

use super::law_fit::Data;
use super::trajectory::{ANGLE, SurfaceNode, TANGENTIAL, nodes_between};
use crate::numeric::{Polynomial, Sample};
use crate::results::Estimate;

/// The minimum sliding speed that counts as sliding, sigmas.
const SLIDING_SIGMAS: f64 = 3.0;
/// Backward motion after the stop: the number of consecutive nodes and their minimum distance, sigmas.
const BACKWARD: (usize, f64) = (3, 2.0);
/// The maximum difference between fits of two widths that noise explains, sigmas.
const CHANCE_SIGMAS: f64 = 2.0;
/// The minimum half width of the local fits, frames.
const MIN_HALF_FRAMES: f64 = 4.0;
/// The order of the local fits.
const ORDER: usize = 3;
/// The step of the search for the kink, frames.
const STEP_FRAMES: f64 = 0.125;
/// The number of parameters of the kink: its moment, the slope before it and the friction.
const PARAMETERS: usize = 3;
/// The step of the fine search, frames.
const FINE_FRAMES: f64 = STEP_FRAMES / 8.0;

/// The contact as known before its slip is analysed; times in frames.
#[derive(Debug, Clone, Copy)]
pub struct Sliding {
    /// The onset of the force.
    pub start: f64,
    /// The end of the force.
    pub end: f64,
    /// Speed of the contact point before, px/frame.
    pub before: Estimate,
    /// Speed of the contact point after, px/frame.
    pub after: Estimate,
    /// Radius of the body, px.
    pub radius: f64,
}

/// Finds the moment at which the contact point stops, frames. Returns `None` where it did not slide before, or slid
/// through the whole contact, or where the contact is shorter than eight frames.
///
/// A contact point that reverses has a zero of its speed, found by local cubic fits. One that rolls from then on has a
/// kink: its displacement follows offset + slope t - friction x (the displacement caused by the normal force, `pushed`)
/// up to the stop and is constant afterwards.
pub fn find_slip_end(
    nodes: &[SurfaceNode],
    sliding: &Sliding,
    pushed: impl Fn(&SurfaceNode) -> f64,
) -> Option<Estimate> {
    let Sliding { start, end, before, after, radius } = *sliding;
    let side = before.value.signum();
    let slid_on = after.value * side > SLIDING_SIGMAS * after.sigma;
    // A contact shorter than the window of its local fits shows no more than the flights before and after it.
    let is_resolved = end - start >= 2.0 * MIN_HALF_FRAMES;
    if !is_resolved || before.value.abs() <= SLIDING_SIGMAS * before.sigma || slid_on {
        return None;
    }
    let point = |n: &SurfaceNode| Sample {
        time_frames: n.time_frames,
        // Every gap in the positions is one in the rotation, too.
        component: n.turn,
        value: side * (n.value[TANGENTIAL] + radius * n.value[ANGLE]),
        sigma: n.sigma[TANGENTIAL].hypot(radius * n.sigma[ANGLE]),
        walk: (n.walk_share[TANGENTIAL] * n.sigma[TANGENTIAL]).hypot(n.walk_share[ANGLE] * radius * n.sigma[ANGLE]),
    };
    let half = ((end - start) / 7.0).clamp(MIN_HALF_FRAMES, 12.0);
    let around = nodes_between(nodes, start - half, end + half);
    let points: Vec<Sample> = around.iter().map(point).collect();
    let speeds = contact_point_speeds(&points, start, end, half);
    let crossing = speeds.windows(2).position(|w| w[0].1.value > 0.0 && w[1].1.value <= 0.0)?;
    let beyond = &speeds[crossing + 1..];
    let is_back = |s: &(f64, Estimate)| s.1.value < -BACKWARD.1 * s.1.sigma;
    if beyond.windows(BACKWARD.0).any(|w| w.iter().all(is_back)) {
        let smooth = line_zero(speeds[crossing], speeds[crossing + 1]);
        return Some(refine_zero(&points, smooth, half).unwrap_or(smooth));
    }
    let until = (speeds[crossing].0 + half).min(end + half);
    let count = points.partition_point(|p| p.time_frames <= until);
    let push: Vec<f64> = around[..count].iter().map(pushed).collect();
    find_kink(&points[..count], &push, start)
}

/// Returns the zero of the line through two speeds, each with its time, frames.
fn line_zero(before: (f64, Estimate), after: (f64, Estimate)) -> Estimate {
    let ((t0, s0), (t1, s1)) = (before, after);
    let slope = (s0.value - s1.value) / (t1 - t0);
    Estimate { value: t0 + s0.value / slope, sigma: (s0.sigma / slope).abs().max(STEP_FRAMES / 2.0) }
}

/// Refines a zero by fits of half the width; `None` if these have none. The zero nearest to the wider fit counts.
///
/// Friction that ends at the stop leaves a kink, which wide fits round off. The difference beyond what noise explains
/// is part of the uncertainty.
fn refine_zero(points: &[Sample], smooth: Estimate, half: f64) -> Option<Estimate> {
    let narrow = contact_point_speeds(points, smooth.value - half, smooth.value + half, half / 2.0);
    let crossings = narrow.windows(2).filter(|w| w[0].1.value > 0.0 && w[1].1.value <= 0.0);
    let zeros = crossings.map(|w| line_zero(w[0], w[1]));
    let nearest = zeros.min_by(|a, b| (a.value - smooth.value).abs().total_cmp(&(b.value - smooth.value).abs()))?;
    // Both fits share the nodes of the narrow one; errors of these move it more.
    let noise = (nearest.sigma.powi(2) - smooth.sigma.powi(2)).max(0.0).sqrt();
    let beyond = ((nearest.value - smooth.value).abs() - CHANCE_SIGMAS * noise).max(0.0);
    Some(Estimate { value: nearest.value, sigma: nearest.sigma.hypot(beyond) })
}

/// Returns time (frames) and speed of the contact point (px/frame) at every node in contact.
///
/// The speeds are slopes of cubic fits to the nodes within `half` frames.
fn contact_point_speeds(points: &[Sample], start: f64, end: f64, half: f64) -> Vec<(f64, Estimate)> {
    points
        .iter()
        .filter(|p| p.time_frames >= start && p.time_frames <= end)
        .filter_map(|p| {
            let at = p.time_frames;
            let first = points.partition_point(|q| q.time_frames < at - half);
            let last = points.partition_point(|q| q.time_frames <= at + half);
            Some((at, Polynomial::fit(&points[first..last], at, ORDER, 0.0)?.rate(at)))
        })
        .collect()
}

/// Finds the stop after which the displacement is constant, frames, by a scan; sigma is where chi2 has risen by one.
///
/// Where the points scatter more than they should, chi2 must rise by its mean instead. Without a minimum within the scan,
/// the stop is not known.
fn find_kink(points: &[Sample], pushed: &[f64], start: f64) -> Option<Estimate> {
    let data = Data::new(points);
    let measured = data.whiten(points.iter().map(|p| p.value).collect());
    let chi2 = |stop: f64| {
        let share = |at: usize| -> f64 {
            // The last node before the stop and the slope after it.
            let next = points.partition_point(|p| p.time_frames < stop).clamp(1, points.len() - 1);
            let (a, b) = (&points[next - 1], &points[next]);
            let u = ((stop - a.time_frames) / (b.time_frames - a.time_frames)).clamp(0.0, 1.0);
            if points[at].time_frames < stop {
                pushed[at]
            } else {
                pushed[next - 1] + u * (pushed[next] - pushed[next - 1])
            }
        };
        let time = data.whiten(points.iter().map(|p| p.time_frames.min(stop) - start).collect());
        let push = data.whiten((0..points.len()).map(share).collect());
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        let (tt, tp, pp) = (dot(&time, &time), dot(&time, &push), dot(&push, &push));
        let (ts, ps) = (dot(&time, &measured), dot(&push, &measured));
        let determinant = tt * pp - tp * tp;
        let (slope, friction) = ((ts * pp - ps * tp) / determinant, (ps * tt - ts * tp) / determinant);
        (determinant > 0.0).then(|| {
            let rest = |i: usize| measured[i] - slope * time[i] - friction * push[i];
            (0..measured.len()).map(|i| rest(i).powi(2)).sum::<f64>()
        })
    };
    let (first, last) = (start + 2.0, points.last()?.time_frames - 1.0);
    let steps = ((last - first) / STEP_FRAMES).floor().max(0.0) as usize;
    let scan = |from: f64, steps: usize, step: f64| -> Vec<(f64, f64)> {
        (0..=steps).map(|i| from + i as f64 * step).filter_map(|stop| Some((stop, chi2(stop)?))).collect()
    };
    let minimum = |scan: &[(f64, f64)]| scan.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1));
    let coarse = scan(first, steps, STEP_FRAMES);
    let best = minimum(&coarse)?;
    let freedom = points.len().saturating_sub(PARAMETERS).max(1) as f64;
    let rise = (best.1 / freedom).max(1.0);
    let near = coarse.iter().filter(|s| s.1 <= best.1 + rise).map(|s| s.0);
    let (low, high) = near.fold((best.0, best.0), |(low, high), at| (low.min(at), high.max(at)));
    if low <= coarse.first()?.0 || high >= coarse.last()?.0 {
        return None;
    }
    // A second, finer scan around the minimum.
    let from = (low - STEP_FRAMES).max(first);
    let fine = scan(from, ((high + STEP_FRAMES - from) / FINE_FRAMES).round() as usize, FINE_FRAMES);
    let best = minimum(&fine)?;
    let inside = || fine.iter().filter(|s| s.1 <= best.1 + rise).map(|s| s.0);
    let width = inside().next_back()? - inside().next()?;
    Some(Estimate { value: best.0, sigma: (width / 2.0).max(FINE_FRAMES) })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the end of the slip of a ball that slides at 1 px/frame until the middle of a contact of `frames`.
    fn slip_end(frames: f64) -> Option<Estimate> {
        let (start, end, sigma) = (20.3, 20.3 + frames, 2e-3);
        let stop = start + 0.5 * frames;
        let node = |frame: u64| {
            let t = frame as f64;
            let slid = t.min(stop) - 0.5 * (t.min(stop) - start).max(0.0).powi(2) / (stop - start);
            let noise = sigma * ((frame * 37 % 17) as f64 - 8.0) / 5.0;
            SurfaceNode {
                frame,
                time_frames: t,
                component: 0,
                turn: 0,
                value: std::array::from_fn(|k| if k == TANGENTIAL { slid + noise } else { 0.0 }),
                sigma: [sigma; 3],
                walk_share: [0.0; 3],
                turning_sigma: 0.0,
            }
        };
        let nodes: Vec<_> = (0..60).map(node).collect();
        let speed = |value: f64| Estimate { value, sigma: 1e-3 };
        let sliding = Sliding { start, end, before: speed(1.0), after: speed(0.0), radius: 50.0 };
        find_slip_end(&nodes, &sliding, |node| (node.time_frames - start).max(0.0).powi(2))
    }

    #[test]
    fn a_contact_of_a_few_frames_does_not_show_where_the_slip_ends() {
        assert!(slip_end(24.0).is_some());
        assert!(slip_end(5.0).is_none());
    }
}
