//! The acceleration in free flight, which checks the scale.

use super::trajectory::{NORMAL, SurfaceNode, TANGENTIAL, samples, turning_sigma};
use crate::numeric::Polynomial;
use crate::results::Estimate;

/// Estimates the acceleration along gravity in several flights, px/frame^2, as the weighted mean of their fits.
///
/// `None` where gravity is switched off or no flight is long enough to curve. A relative error of the scale appears
/// as the same relative error of gravity. While the body turns, an error of its centre adds to the velocity. How that
/// error changes during a flight is unknown: the acceleration is as uncertain as if it were random along the flight,
/// whose root mean square distance from its middle is its length / sqrt(12).
pub fn free_fall_acceleration(flights: &[&[SurfaceNode]], gravity_px: [f64; 2]) -> Option<Estimate> {
    let strength = gravity_px[NORMAL].hypot(gravity_px[TANGENTIAL]);
    if strength <= 0.0 {
        return None;
    }
    let (mut sum, mut weight) = (0.0, 0.0);
    for flight in flights {
        let Some(acceleration) = acceleration_along(flight, gravity_px.map(|part| part / strength)) else {
            continue;
        };
        sum += acceleration.value / acceleration.sigma.powi(2);
        weight += acceleration.sigma.powi(-2);
    }
    (weight > 0.0).then(|| Estimate { value: sum / weight, sigma: weight.powf(-0.5) })
}

/// Estimates the acceleration of one flight along a direction given by its normal and tangential components.
fn acceleration_along(flight: &[SurfaceNode], direction: [f64; 2]) -> Option<Estimate> {
    let middle = 0.5 * (flight.first()?.time_frames + flight.last()?.time_frames);
    let (mut value, mut variance) = (0.0, 0.0_f64);
    for (k, part) in [NORMAL, TANGENTIAL].into_iter().zip(direction) {
        let fit = Polynomial::fit(&samples(flight, k), middle, 2, 0.0)?;
        let acceleration = fit.curvature();
        value += part * acceleration.value;
        variance += (part * acceleration.sigma * fit.excess()).powi(2);
    }
    let length_frames = flight.last()?.time_frames - flight.first()?.time_frames;
    let drift = f64::sqrt(12.0) * turning_sigma(flight) / length_frames;
    (variance > 0.0).then(|| Estimate { value, sigma: variance.sqrt().hypot(drift) })
}
