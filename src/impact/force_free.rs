//! The end of a contact: the stretch of nodes on which no force acts.

use super::trajectory::{NORMAL, SurfaceNode, samples};
use crate::numeric::{Polynomial, Sample};
use crate::results::Estimate;

/// The maximum deviation of the acceleration from gravity after a contact, as a share of the peak acceleration.
const QUIET_SHARE: f64 = 0.02;
/// The maximum number of nodes that the end of a contact is tested by.
const QUIET_NODES: usize = 40;
/// The number of nodes after a possible contact that decide whether a force acts, where [`QUIET_SHARE`] cannot be
/// resolved.
const FORCELESS_NODES: usize = 16;
/// The minimum force that counts as present, sigmas.
const FORCE_SIGMAS: f64 = 3.0;

/// Fits the acceleration of the nodes by a parabola, px/frame^2; `None` if they do not determine one.
pub fn fit_acceleration(nodes: &[Sample]) -> Option<Estimate> {
    let middle = 0.5 * (nodes.first()?.time_frames + nodes.last()?.time_frames);
    let fit = Polynomial::fit(nodes, middle, 2, 0.0)?;
    let a = fit.curvature();
    Some(Estimate { value: a.value, sigma: a.sigma * fit.excess() })
}

/// Returns the start of the force-free stretch of the newest nodes (frames) and its velocity (px/frame).
///
/// `Some(None)` if a force still acts, `None` where the data cannot decide. `acceleration_max` is the peak
/// acceleration so far, px/frame^2.
pub fn find_quiet_stretch(since: &[Sample], gravity: f64, acceleration_max: f64) -> Option<Option<(f64, Estimate)>> {
    let mut width = 5;
    while width <= QUIET_NODES.min(since.len()) {
        let newest = &since[since.len() - width..];
        let acceleration = fit_acceleration(newest).filter(|a| a.sigma <= QUIET_SHARE * acceleration_max);
        if let Some(a) = acceleration {
            let still = (a.value - gravity).abs() <= QUIET_SHARE * acceleration_max + 2.0 * a.sigma;
            let middle = 0.5 * (newest[0].time_frames + newest[width - 1].time_frames);
            let fit = Polynomial::fit(newest, middle, 1, gravity)?;
            let rate = fit.rate(middle);
            return Some(still.then_some((newest[0].time_frames, rate)));
        }
        width += 1;
    }
    None
}

/// Returns the start (frames) and the velocity (px/frame) of nodes that are consistent with no force; `None` if one
/// acts.
///
/// An impact between two frames, or poses that drift, may look like the onset of a contact.
pub fn find_forceless_stretch(since: &[SurfaceNode], gravity: f64) -> Option<(f64, Estimate)> {
    let newest = samples(&since[since.len().saturating_sub(QUIET_NODES)..], NORMAL);
    if newest.len() < FORCELESS_NODES {
        return None;
    }
    let acceleration = fit_acceleration(&newest)?;
    let middle = 0.5 * (newest[0].time_frames + newest[newest.len() - 1].time_frames);
    let rate = Polynomial::fit(&newest, middle, 1, gravity)?.rate(middle);
    (acceleration.value - gravity <= FORCE_SIGMAS * acceleration.sigma).then_some((newest[0].time_frames, rate))
}
