//! The end of a contact: the nodes on which no force acts.

use super::trajectory::{NORMAL, SurfaceNode, samples};
use crate::numeric::{Polynomial, Sample};
use crate::results::Estimate;

/// The maximum deviation of the acceleration from gravity after a contact, as a share of the peak acceleration.
const MAX_RESIDUAL_FORCE_SHARE: f64 = 0.02;
/// The maximum number of nodes that the end of a contact is tested by.
const MAX_TESTED_NODES: usize = 40;
/// The number of nodes after a possible contact that decide whether a force acts, where
/// [`MAX_RESIDUAL_FORCE_SHARE`] cannot be resolved.
const FORCE_FREE_NODES: usize = 16;
/// The minimum force that counts as present, sigmas.
const FORCE_SIGMAS: f64 = 3.0;

/// Fits the acceleration of the nodes by a parabola, px/frame^2; `None` if they do not determine one.
pub fn fit_acceleration(nodes: &[Sample]) -> Option<Estimate> {
    let middle = 0.5 * (nodes.first()?.time_frames + nodes.last()?.time_frames);
    let fit = Polynomial::fit(nodes, middle, 2, 0.0)?;
    let a = fit.curvature();
    Some(Estimate { value: a.value, sigma: a.sigma * fit.excess() })
}

/// The flight after a contact, as far as the newest nodes show it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FreeFlight {
    /// Its start, frames.
    pub start_frames: f64,
    /// Its velocity along the normal, px/frame.
    pub rate: Estimate,
}

/// Whether the force of a contact has ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum EndOfForce {
    /// The nodes do not decide.
    Undecided,
    /// A force still acts.
    Acting,
    /// The newest nodes are free of force.
    Ended(FreeFlight),
}

/// Tests whether a force acts on the newest nodes.
///
/// `acceleration_max` is the peak acceleration so far, px/frame^2.
pub fn test_force_free(since: &[Sample], gravity: f64, acceleration_max: f64) -> EndOfForce {
    for width in 5..=MAX_TESTED_NODES.min(since.len()) {
        let newest = &since[since.len() - width..];
        let limit = MAX_RESIDUAL_FORCE_SHARE * acceleration_max;
        let Some(a) = fit_acceleration(newest).filter(|a| a.sigma <= limit) else { continue };
        let Some(flight) = free_flight(newest, gravity) else { return EndOfForce::Undecided };
        let is_free = (a.value - gravity).abs() <= limit + 2.0 * a.sigma;
        return if is_free { EndOfForce::Ended(flight) } else { EndOfForce::Acting };
    }
    EndOfForce::Undecided
}

/// Returns the flight of nodes that are consistent with no force; `None` if one acts.
///
/// An impact between two frames, or poses that drift, may look like the onset of a contact.
pub fn find_force_free(since: &[SurfaceNode], gravity: f64) -> Option<FreeFlight> {
    let newest = samples(&since[since.len().saturating_sub(MAX_TESTED_NODES)..], NORMAL);
    if newest.len() < FORCE_FREE_NODES {
        return None;
    }
    let acceleration = fit_acceleration(&newest)?;
    let flight = free_flight(&newest, gravity)?;
    (acceleration.value - gravity <= FORCE_SIGMAS * acceleration.sigma).then_some(flight)
}

/// Fits the flight of nodes on which gravity alone acts; `None` for too few.
fn free_flight(nodes: &[Sample], gravity: f64) -> Option<FreeFlight> {
    let (first, last) = (nodes.first()?.time_frames, nodes.last()?.time_frames);
    let middle = 0.5 * (first + last);
    let rate = Polynomial::fit(nodes, middle, 1, gravity)?.rate(middle);
    Some(FreeFlight { start_frames: first, rate })
}
