//! How a body falls in free flight, which checks the scale.

use super::trajectory::{NORMAL, SurfaceNode, TANGENTIAL, samples};
use crate::numeric::Polynomial;
use crate::results::Estimate;

/// Acceleration along gravity in some flights, px/frame^2, with no other acceleration assumed; `None` where gravity is
/// switched off or no flight is long enough to bend.
///
/// A scale wrong by a share shows as gravity wrong by the same share.
pub fn fall(flights: &[&[SurfaceNode]], gravity_px: [f64; 2]) -> Option<Estimate> {
    let strength = gravity_px[NORMAL].hypot(gravity_px[TANGENTIAL]);
    if strength <= 0.0 {
        return None;
    }
    let (mut sum, mut weight) = (0.0, 0.0);
    for flight in flights {
        let Some(bend) = bend(flight, gravity_px.map(|part| part / strength)) else { continue };
        sum += bend.value / bend.sigma.powi(2);
        weight += bend.sigma.powi(-2);
    }
    (weight > 0.0).then(|| Estimate { value: sum / weight, sigma: weight.powf(-0.5) })
}

/// Acceleration of one flight along a direction given as its parts along normal and tangent.
fn bend(flight: &[SurfaceNode], direction: [f64; 2]) -> Option<Estimate> {
    let middle = 0.5 * (flight.first()?.time_frames + flight.last()?.time_frames);
    let (mut value, mut variance) = (0.0, 0.0_f64);
    for (k, part) in [NORMAL, TANGENTIAL].into_iter().zip(direction) {
        let fit = Polynomial::fit(&samples(flight, k), middle, 2, 0.0)?;
        let bend = fit.curvature();
        value += part * bend.value;
        variance += (part * bend.sigma * fit.excess()).powi(2);
    }
    (variance > 0.0).then(|| Estimate { value, sigma: variance.sqrt() })
}
