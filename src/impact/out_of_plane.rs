//! Corrections of a collision for motion out of the image plane: towards the camera, away from it, or rotation about an
//! axis in the plane.
//!
//! A body that is closer by some share is larger by that share in the image, and so is its path from the image centre.
//! Its apparent speed therefore contains the dilatation times the distance from the centre, and it changes although no
//! force acts.

use super::contact::Contact;
use super::interval::ImpactContext;
use super::solver::FLIGHT_FRAMES;
use super::trajectory::{ANGLE, NORMAL, SurfaceNode, TANGENTIAL, nodes_between};
use crate::motion::{Axes, OutlineDrift, SizeChange, shrink_insignificant};
use crate::results::{Estimate, Impact};

/// The maximum time that the force may last after the detected end, frames.
const EARLY_FRAMES: f64 = 4.0;
/// The time before the detected onset from which on the outline may be flattened, frames.
const ONSET_FRAMES: f64 = 1.0;
/// Share of its speed towards the camera that a contact may take from a body.
const APPROACH_LOSS: f64 = 0.3;
/// The residual apparent motion per unit of dilatation, as a share of the radius and in rad. A pattern with more edges
/// on one side appears to move to that side, and to rotate, as it grows.
const CROSSTALK: f64 = 0.005;
const CROSSTALK_RAD: f64 = 0.005;
/// The relative error of the contact time per unit of dilatation over the contact.
const DURATION_RESIDUAL: f64 = 0.05;

const RAD: f64 = std::f64::consts::PI / 180.0;
const NONE: Estimate = Estimate { value: 0.0, sigma: 0.0 };

/// The measured out-of-plane motion of a body.
#[derive(Debug, Clone, Copy)]
pub struct OutOfPlane<'a> {
    /// The change of its size.
    pub growth: &'a SizeChange,
    /// The drift of its outline relative to its poses.
    pub drift: &'a OutlineDrift,
    /// The axes of the surface.
    pub axes: Axes,
    /// The position of the poses' origin relative to the principal point, along normal and tangent, px.
    pub place_px: [f64; 2],
    /// The standard uncertainty of the principal point, px.
    pub middle_sigma_px: f64,
    /// The frames between two nodes, which are the unit of the contact's times.
    pub stride: u32,
}

impl OutOfPlane<'_> {
    /// Converts a time of the contact to frames.
    fn frames(&self, time: f64) -> f64 {
        time * f64::from(self.stride)
    }

    /// Converts the drift of the outline to normal and tangent, px, and the angle to rad, each per node.
    fn along_surface(&self, [x, y, turn]: [Estimate; 3]) -> [Estimate; 3] {
        let (value, sigma) = (self.axes.surface(x.value, y.value), self.axes.surface_sigma(x.sigma, y.sigma));
        let along = |value: f64, sigma: f64| Estimate { value, sigma };
        let drift = [along(value.normal, sigma.normal), along(value.tangential, sigma.tangential), multiply(turn, RAD)];
        drift.map(|drift| multiply(drift, self.stride.into()))
    }
}

/// The dilatation rate of a body before and after a contact, and its position then.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DilatationRates {
    /// The measured rates.
    measured: [Option<Estimate>; 2],
    /// The significant part of the rates with its uncertainty.
    rates: [Estimate; 2],
    /// Start and end of the contact.
    contact_frames: [f64; 2],
    /// Lengths of the flights.
    flight_frames: [f64; 2],
    /// The drift of a ball relative to its pose before and after, along normal and tangent, px per frame, and of its
    /// angle, rad per frame.
    drift: [[Estimate; 3]; 2],
    /// The position of the pose's origin relative to the principal point, along normal and tangent, px.
    place_px: [f64; 2],
    /// The standard uncertainty of the principal point, px.
    middle_sigma_px: f64,
}

impl DilatationRates {
    /// Estimates the rates for a contact that has ended, from data up to `known_to_frames`; `None` while it has not
    /// ended.
    pub fn estimate(motion: &OutOfPlane<'_>, contact: &Contact, known_to_frames: f64) -> Option<Self> {
        let (start, end) = (contact.start_frames, contact.end_frames?);
        let from = contact.flight_from_frames.max(start - FLIGHT_FRAMES);
        let to = known_to_frames.min(end + FLIGHT_FRAMES);
        let flights = [(from, contact.flight_to_frames), (end + EARLY_FRAMES, to)];
        let rate = |from, to| motion.growth.rate(motion.frames(from), motion.frames(to));
        let measured = flights.map(|(from, to)| Some(multiply(rate(from, to)?, motion.stride.into())));
        // Unlike a pose, the distance between pose and outline is not changed by the first small forces.
        let before = motion.drift.expected(motion.frames(from), motion.frames(start - ONSET_FRAMES));
        let after = motion.drift.significant(motion.frames(end + EARLY_FRAMES), motion.frames(to));
        let [before, after] = [before, after].map(|drift| drift.map(|drift| motion.along_surface(drift)));
        // The unobserved part of the flight after is bounded by the flight before.
        let before = before.unwrap_or([NONE; 3]);
        let after = after.unwrap_or(before.map(|drift| Estimate { sigma: drift.value.hypot(drift.sigma), ..drift }));
        Some(Self {
            measured,
            rates: approach_rates(measured),
            contact_frames: [start, end],
            flight_frames: [start - from, to - end],
            drift: [before, after],
            place_px: motion.place_px,
            middle_sigma_px: motion.middle_sigma_px,
        })
    }

    /// Returns the positions as if the body had kept its distance at first contact.
    pub fn at_constant_distance(&self, nodes: &[SurfaceNode]) -> Vec<SurfaceNode> {
        let corrected = |node: &SurfaceNode| {
            let larger = self.log_magnification(node.time_frames).exp();
            let mut value = node.value;
            value[ANGLE] += self.drift_since_contact(ANGLE, node.time_frames);
            for k in [NORMAL, TANGENTIAL] {
                let center_px = value[k] + self.drift_since_contact(k, node.time_frames);
                value[k] = (self.place_px[k] + center_px) / larger - self.place_px[k];
            }
            SurfaceNode { value, ..*node }
        };
        nodes.iter().map(corrected).collect()
    }

    /// Returns the logarithm of the magnification relative to first contact. The flattening of the ball is not
    /// included.
    fn log_magnification(&self, time_frames: f64) -> f64 {
        self.integrate_rates(self.rates.map(|rate| rate.value), time_frames)
    }

    /// Returns the drift of coordinate `k` of a ball relative to its pose since first contact, px or rad.
    fn drift_since_contact(&self, k: usize, time_frames: f64) -> f64 {
        self.integrate_rates(self.drift.map(|drift| drift[k].value), time_frames)
    }

    /// Integrates a quantity with these rates per frame before and after, from first contact to a time.
    ///
    /// During contact its rate is the mean of both.
    fn integrate_rates(&self, rates: [f64; 2], time_frames: f64) -> f64 {
        let [before, after] = rates;
        let [start, end] = self.contact_frames;
        let between = 0.5 * (before + after);
        match time_frames {
            t if t <= start => before * (t - start),
            t if t <= end => between * (t - start),
            t => between * (end - start) + after * (t - end),
        }
    }

    /// Returns the collision with the dilatation rates, and with their uncertainty included in every sigma.
    ///
    /// `nodes` are the uncorrected positions.
    pub fn correct(&self, mut impact: Impact, nodes: &[SurfaceNode], context: &ImpactContext) -> Impact {
        let touch = nodes_between(nodes, self.contact_frames[0], f64::INFINITY).first();
        let touch_px = touch.map_or([0.0; 3], |node| node.value);
        let per_second =
            |measured: Option<Estimate>| measured.map(|measured| multiply(measured, 1.0 / context.period_s));
        [impact.growth_before_per_s, impact.growth_after_per_s] = self.measured.map(per_second);
        let speed = context.metres_per_px.value / context.period_s;
        // One component before and after, px/frame.
        let uncertainty = |k: usize, side: usize, velocity: Option<Estimate>| {
            let Estimate { value, sigma } = self.rates[side];
            let distance_px = (self.place_px[k] + touch_px[k]).abs();
            let path_px = velocity.map_or(0.0, |v| (v.value / speed).abs()) * self.flight_frames[side];
            let middle_px =
                self.middle_sigma_px.hypot(CROSSTALK * context.radius_px.map_or(0.0, |radius| radius.value));
            (sigma * (distance_px + path_px)).hypot(value * middle_px).hypot(self.drift[side][k].sigma) * speed
        };
        let normal = [uncertainty(NORMAL, 0, impact.vn_before_m_s), uncertainty(NORMAL, 1, impact.vn_after_m_s)];
        let along = [uncertainty(TANGENTIAL, 0, impact.vt_before_m_s), uncertainty(TANGENTIAL, 1, impact.vt_after_m_s)];
        // A change of another spin component within the contact cannot be timed.
        let spun = 0.5 * (self.drift[1][NORMAL].value - self.drift[0][NORMAL].value).abs() * speed;
        let spins = [0, 1].map(|side| self.drift[side][ANGLE].sigma / context.period_s);
        widen_by_speed_errors(&mut impact, &SpeedErrors { normal, spun, along, spins }, context);
        for (side, spin) in [&mut impact.omega_before_rad_s, &mut impact.omega_after_rad_s].into_iter().enumerate() {
            widen_sigma(
                spin,
                (CROSSTALK_RAD * self.rates[side].value).hypot(self.drift[side][ANGLE].sigma) / context.period_s,
            );
        }
        let [start, end] = self.contact_frames;
        let magnification = 0.5 * (self.rates[0].value + self.rates[1].value) * (end - start);
        let duration_s = impact.contact_time_s.map_or(0.0, |duration| duration.value);
        widen_sigma(&mut impact.contact_time_s, DURATION_RESIDUAL * magnification * duration_s);
        impact
    }
}

/// Returns the assumed rates of approach before and after per frame, with uncertainties.
///
/// Both flights are combined. A dilatation that rotates with the body is no approach: the scale of the image varies
/// from place to place.
fn approach_rates(measured: [Option<Estimate>; 2]) -> [Estimate; 2] {
    let [before, after] = measured.map(|measured| measured.map_or(NONE, shrink_insignificant));
    if before.value * after.value < 0.0 {
        return [before, after].map(|rate| Estimate { value: 0.0, sigma: rate.value.hypot(rate.sigma) });
    }
    let both = |own: Option<Estimate>, other: Option<Estimate>| {
        let changed = |other: Estimate| Estimate { sigma: other.sigma.hypot(APPROACH_LOSS * other.value), ..other };
        match (own, other) {
            (Some(a), Some(b)) => {
                let (weight_a, weight_b) = (a.sigma.powi(-2), changed(b).sigma.powi(-2));
                let value = (weight_a * a.value + weight_b * b.value) / (weight_a + weight_b);
                shrink_insignificant(Estimate { value, sigma: (weight_a + weight_b).powf(-0.5) })
            }
            (Some(own), None) => shrink_insignificant(own),
            (None, other) => other.map_or(NONE, |other| changed(shrink_insignificant(other))),
        }
    };
    [both(measured[0], measured[1]), both(measured[1], measured[0])]
}

/// Errors of the speeds before and after, m/s and rad/s.
struct SpeedErrors {
    normal: [f64; 2],
    /// Normal velocity from a change of another spin component within the contact.
    spun: f64,
    along: [f64; 2],
    spins: [f64; 2],
}

/// Adds the uncertainty of the speeds before and after to everything that follows from them.
fn widen_by_speed_errors(impact: &mut Impact, errors: &SpeedErrors, context: &ImpactContext) {
    let SpeedErrors { normal, spun, along, spins } = *errors;
    let value = |number: Option<Estimate>| number.map_or(0.0, |number| number.value);
    let (vn, vt) = (
        [value(impact.vn_before_m_s), value(impact.vn_after_m_s)],
        [value(impact.vt_before_m_s), value(impact.vt_after_m_s)],
    );
    let rim = context.radius_px.map_or(0.0, |radius| radius.value * context.metres_per_px.value);
    let slide = vt[0] + value(impact.omega_before_rad_s) * rim;
    widen_sigma(&mut impact.vn_before_m_s, normal[0]);
    widen_sigma(&mut impact.vn_after_m_s, normal[1]);
    widen_sigma(&mut impact.vt_before_m_s, along[0]);
    widen_sigma(&mut impact.vt_after_m_s, along[1]);
    // Both sides err the same way, and the speed reverses: the errors add up.
    let restitution = value(impact.restitution).abs();
    widen_sigma(&mut impact.restitution, (normal[1] + restitution * normal[0]) / vn[0].abs());
    let tangential = value(impact.restitution_tangential).abs();
    let slides = [0, 1].map(|side| along[side].hypot(rim * spins[side]));
    widen_sigma(&mut impact.restitution_tangential, (slides[1] + tangential * slides[0]) / slide.abs());
    let ratio = value(impact.impulse_ratio).abs();
    let turned = along[0] + along[1] + ratio * (normal[0] + normal[1]);
    widen_sigma(&mut impact.impulse_ratio, turned / (vn[1] - vn[0]).abs());
    let lost = |v: [f64; 2], error: [f64; 2]| (v[0] * error[0]).abs() + (v[1] * error[1]).abs();
    widen_sigma(&mut impact.energy_lost_j, context.mass_kg.unwrap_or(0.0) * lost(vn, normal).hypot(lost(vt, along)));
    let within = normal[0].hypot(spun);
    let share = within / vn[0].abs();
    for number in [&mut impact.compression_max_mm, &mut impact.acceleration_max_m_s2, &mut impact.force_max_n] {
        widen_sigma(number, share * value(*number));
    }
    // An error of a speed moves its zero in time, and the flight leaves the contact elsewhere.
    let brake = (vn[1] - vn[0]) / value(impact.contact_time_s);
    widen_sigma(&mut impact.deepest_s, within / brake);
    let shift = share * value(impact.contact_time_s);
    for moment in [&mut impact.start_s, &mut impact.end_s, &mut impact.force_start_s, &mut impact.force_end_s] {
        widen_sigma(moment, shift);
    }
}

/// Adds an independent error to the sigma of a number, in quadrature; an error that is not finite is ignored.
fn widen_sigma(number: &mut Option<Estimate>, error: f64) {
    if let Some(number) = number
        && error.is_finite()
    {
        number.sigma = number.sigma.hypot(error);
    }
}

/// Returns an estimate multiplied by an exact factor.
fn multiply(number: Estimate, factor: f64) -> Estimate {
    Estimate { value: number.value * factor, sigma: number.sigma * factor.abs() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(value: f64) -> Option<Estimate> {
        Some(Estimate { value, sigma: 1e-6 })
    }

    #[test]
    fn what_both_flights_show_is_put_together_and_chance_is_left_out() {
        assert_eq!(approach_rates([measured(1.5e-6), measured(-1e-6)]), [NONE; 2]);
        assert_eq!(approach_rates([None, None]), [NONE; 2]);
        let [before, after] = approach_rates([measured(3e-5), measured(2.6e-5)]);
        assert!((before.value - 3e-5).abs() < 1e-6 && (after.value - 2.6e-5).abs() < 1e-6, "{before:?} {after:?}");
        // Not significant by itself, but with the flight after.
        let weak = Some(Estimate { value: 1.5e-5, sigma: 1e-5 });
        let [before, _] = approach_rates([weak, measured(3e-5)]);
        assert!((1.2e-5..3e-5).contains(&before.value) && before.sigma > 4e-6, "{before:?}");
        // Not measured yet.
        let [_, after] = approach_rates([measured(3e-5), None]);
        assert!((after.value - 3e-5).abs() < 1e-6 && after.sigma > 5e-6, "{after:?}");
    }

    #[test]
    fn growth_that_turns_with_the_body_widens_the_sigma() {
        let [before, after] = approach_rates([measured(3e-5), measured(-4e-5)]);
        assert!(before.value.abs() <= 0.0 && after.value.abs() <= 0.0);
        assert!((before.sigma - 3e-5).abs() < 1e-6 && (after.sigma - 4e-5).abs() < 1e-6);
    }

    #[test]
    fn positions_are_those_of_a_body_that_kept_its_distance() {
        let approach = DilatationRates {
            measured: [None; 2],
            rates: [Estimate { value: 1e-4, sigma: 0.0 }; 2],
            contact_frames: [20.0, 40.0],
            flight_frames: [20.0, 20.0],
            drift: [[NONE; 3]; 2],
            place_px: [-60.0, 90.0],
            middle_sigma_px: 0.0,
        };
        let node = |time_frames: f64, value: [f64; 3]| SurfaceNode {
            frame: time_frames as u64,
            time_frames,
            component: 0,
            turn: 0,
            value,
            sigma: [1e-3; 3],
            walk_share: [0.0; 3],
            turning_sigma: 0.0,
        };
        let nodes: Vec<_> = (0..60)
            .map(|k| {
                let larger = (1e-4 * (f64::from(k) - 20.0)).exp();
                let way = [-0.3 * f64::from(k), 0.1 * f64::from(k)];
                node(f64::from(k), [(way[0] - 60.0) * larger + 60.0, (way[1] + 90.0) * larger - 90.0, 0.2])
            })
            .collect();
        for (k, corrected) in approach.at_constant_distance(&nodes).iter().enumerate() {
            let off = [corrected.value[0] + 0.3 * k as f64, corrected.value[1] - 0.1 * k as f64];
            assert!(
                off[0].abs() < 1e-9 && off[1].abs() < 1e-9 && corrected.value[2].total_cmp(&0.2).is_eq(),
                "{k}: {off:?}"
            );
        }
    }

    #[test]
    fn places_and_angles_are_those_of_the_ball_not_of_its_pattern() {
        // Along normal and tangent, px, and the angle, rad, per frame: of the pattern, and relative to it.
        let (pattern, relative) = ([-0.3, 0.1, 0.02], [0.05, -0.02, 0.003]);
        let approach = DilatationRates {
            measured: [None; 2],
            rates: [NONE; 2],
            contact_frames: [20.0, 40.0],
            flight_frames: [20.0, 20.0],
            drift: [relative.map(|value| Estimate { value, sigma: 0.0 }); 2],
            place_px: [0.0; 2],
            middle_sigma_px: 0.0,
        };
        let node = |frame: u64| SurfaceNode {
            frame,
            time_frames: frame as f64,
            component: 0,
            turn: 0,
            value: pattern.map(|rate| rate * frame as f64),
            sigma: [1e-3; 3],
            walk_share: [0.0; 3],
            turning_sigma: 0.0,
        };
        let corrected = approach.at_constant_distance(&[node(5), node(30), node(55)]);
        for (from, to) in [(0, 1), (1, 2)] {
            for k in [NORMAL, TANGENTIAL, ANGLE] {
                let rate = (corrected[to].value[k] - corrected[from].value[k]) / 25.0;
                assert!((rate - pattern[k] - relative[k]).abs() < 1e-12, "{k}: {rate}");
            }
        }
    }
}
