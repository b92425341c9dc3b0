//! The acceleration in free flight, which checks the scale, and the errors that change slowly along a flight.

use super::trajectory::{ANGLE, NORMAL, SurfaceNode, TANGENTIAL, has_measured_rotation, samples, turning_sigma};
use crate::numeric::Polynomial;
use crate::results::Estimate;

/// The change of a slow error of the centre from one end of a flight to the other, in its standard uncertainties.
const SHIFT_SIGMAS: f64 = 2.0;

/// Returns the standard uncertainty of the velocity of a flight that outlines alone place, px/frame; 0 for others.
///
/// The light and the ground that a rim passes shift neighbouring outlines alike. Such an error may change by a few of its
/// standard uncertainties along the flight, which no scatter about its curve shows. `center_sigma_px` is that of the centre.
pub fn shift_sigma(flight: &[SurfaceNode], center_sigma_px: f64) -> f64 {
    let length_frames = length_frames(flight);
    if length_frames <= 0.0 || has_measured_rotation(flight) {
        return 0.0;
    }
    SHIFT_SIGMAS * center_sigma_px / length_frames
}

/// Returns the time from the first node of a flight to its last, frames.
fn length_frames(flight: &[SurfaceNode]) -> f64 {
    let time = |node: Option<&SurfaceNode>| node.map_or(0.0, |node| node.time_frames);
    time(flight.last()) - time(flight.first())
}

/// Estimates the acceleration along gravity in several flights, px/frame^2, as the weighted mean of their fits.
///
/// `None` where gravity is switched off or no flight is long enough to curve. A relative error of the scale appears
/// as the same relative error of gravity. While the body turns, an error of its centre adds to the velocity. How that
/// error changes during a flight is unknown: the acceleration is as uncertain as if it were random along the flight,
/// whose root mean square distance from its middle is its length / sqrt(12). `center_sigma_px` is that of the centre,
/// which may be far larger than that of each outline.
pub fn free_fall_acceleration(
    flights: &[&[SurfaceNode]],
    gravity_px: [f64; 2],
    center_sigma_px: f64,
) -> Option<Estimate> {
    let strength = gravity_px[NORMAL].hypot(gravity_px[TANGENTIAL]);
    if strength <= 0.0 {
        return None;
    }
    let (mut sum, mut weight) = (0.0, 0.0);
    for flight in flights {
        let direction = gravity_px.map(|part| part / strength);
        let Some(acceleration) = acceleration_along(flight, direction, center_sigma_px) else { continue };
        sum += acceleration.value / acceleration.sigma.powi(2);
        weight += acceleration.sigma.powi(-2);
    }
    (weight > 0.0).then(|| Estimate { value: sum / weight, sigma: weight.powf(-0.5) })
}

/// Estimates the acceleration of one flight along a direction given by its normal and tangential components.
fn acceleration_along(flight: &[SurfaceNode], direction: [f64; 2], center_sigma_px: f64) -> Option<Estimate> {
    let middle = 0.5 * (flight.first()?.time_frames + flight.last()?.time_frames);
    let (mut value, mut variance) = (0.0, 0.0_f64);
    for (k, part) in [NORMAL, TANGENTIAL].into_iter().zip(direction) {
        let fit = Polynomial::fit(&samples(flight, k), middle, 2, 0.0)?;
        let acceleration = fit.curvature();
        value += part * acceleration.value;
        variance += (part * acceleration.sigma * fit.excess()).powi(2);
    }
    let length_frames = length_frames(flight);
    let turning = turning_sigma(flight).max(center_sigma_px * mean_spin(flight).abs());
    let drift = f64::sqrt(12.0) * turning.hypot(shift_sigma(flight, center_sigma_px)) / length_frames;
    (variance > 0.0).then(|| Estimate { value, sigma: variance.sqrt().hypot(drift) })
}

/// Returns the mean spin of a flight, rad/frame; 0 if its rotation was not measured throughout.
fn mean_spin(flight: &[SurfaceNode]) -> f64 {
    let (Some(first), Some(last)) = (flight.first(), flight.last()) else { return 0.0 };
    let turned = last.value[ANGLE] - first.value[ANGLE];
    if first.turn == last.turn && length_frames(flight) > 0.0 { turned / length_frames(flight) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRAVITY_PX: f64 = 0.015;
    const FRAMES: u32 = 36;

    /// Returns a flight whose centre is off by `error_px` along the normal, as a function of the frame.
    fn flight(spin: f64, links_rotations: bool, error_px: impl Fn(f64) -> f64) -> Vec<SurfaceNode> {
        let node = |frame: u32| {
            let time = f64::from(frame);
            let chance = 0.02 * (7.3 * time).sin();
            SurfaceNode {
                frame: frame.into(),
                time_frames: time,
                component: 0,
                turn: if links_rotations { 0 } else { frame },
                value: [
                    -0.5 * GRAVITY_PX * time * time - 3.0 * time + error_px(time) + chance,
                    0.4 * time,
                    spin * time,
                ],
                sigma: [0.02, 0.02, 1e-3],
                walk_share: [0.0; 3],
                turning_sigma: 0.0,
            }
        };
        (0..FRAMES).map(node).collect()
    }

    /// Returns the error of gravity in standard uncertainties.
    fn pull(flight: &[SurfaceNode], center_sigma_px: f64) -> f64 {
        let found = free_fall_acceleration(&[flight], [-GRAVITY_PX, 0.0], center_sigma_px).unwrap();
        (found.value - GRAVITY_PX) / found.sigma
    }

    #[test]
    fn outlines_that_shift_slowly_leave_gravity_and_speed_uncertain() {
        let half = 0.5 * f64::from(FRAMES - 1);
        let bow = flight(0.0, false, |time| 0.7 * ((time - half) / half).powi(2));
        assert!(pull(&bow, 0.7).abs() < 2.0, "{}", pull(&bow, 0.7));
        // The last position is off by 0.7 px, the first by as much to the other side.
        assert!((shift_sigma(&bow, 0.7) - 0.04).abs() < 1e-9, "{}", shift_sigma(&bow, 0.7));
        let certain = flight(0.0, false, |_| 0.0);
        assert!(pull(&certain, 0.0).abs() < 4.0, "{}", pull(&certain, 0.0));
    }

    #[test]
    fn a_wrong_centre_of_a_turning_ball_leaves_gravity_uncertain() {
        let turning = flight(0.087, true, |time| 1.1 * (0.087 * time).sin());
        assert!(pull(&turning, 1.1).abs() < 2.0, "{}", pull(&turning, 1.1));
        assert!(shift_sigma(&turning, 1.1).abs() < 1e-12);
    }
}
