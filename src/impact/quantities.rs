//! The physical quantities of a collision, from its interval, its flights and its contact law.

use super::contact_law::ContactEstimates;
use super::interval::{Flights, ImpactContext, Interval, MAX_SPIN_SIGMA_RAD, scaled};
use super::model_selection::ForceLawPosterior;
use super::slip_end::{Sliding, find_slip_end};
use super::trajectory::{ANGLE, NORMAL, SurfaceNode, TANGENTIAL, nodes_between};
use crate::motion::PlanarRates;
use crate::numeric::Polynomial;
use crate::results::{Estimate, ForceLaw, Impact, PointStatus};

/// The motion on one side of a contact, at its start or at its end.
struct Side {
    /// The velocities along normal and tangent, px/frame, and the spin, rad/frame.
    rates: [Estimate; 3],
    /// The fraction by which they may be underestimated.
    underestimate: f64,
    /// Their relative error of either sign.
    interpolation_error: f64,
}

impl Side {
    fn new(flight: &[Polynomial; 3], shift_sigma: f64, at: Estimate, context: &ImpactContext) -> Self {
        let rates = rates_at(flight, shift_sigma, at, context);
        let per_frame = |k: usize| rates[k].value / f64::from(context.stride);
        let [normal, tangential, angle] = [NORMAL, TANGENTIAL, ANGLE].map(per_frame);
        let planar = PlanarRates { first_px: tangential, second_px: normal, angle_deg: angle.to_degrees() };
        let bias = &context.speed_bias;
        Self { rates, underestimate: bias.underestimate(planar), interpolation_error: bias.interpolation_error(planar) }
    }

    /// Returns the relative error of its rates.
    fn relative_error(&self) -> f64 {
        self.underestimate.hypot(self.interpolation_error)
    }

    /// Returns a velocity, m/s.
    fn speed(&self, axis: usize, context: &ImpactContext) -> Estimate {
        let metres_per_px = context.metres_per_px;
        scaled(self.rates[axis], metres_per_px.value / context.period_s, metres_per_px.sigma / metres_per_px.value)
            .with_relative_error(self.relative_error())
    }

    /// Returns the spin, rad/s; `None` if it is not known at all.
    fn spin(&self, context: &ImpactContext) -> Option<Estimate> {
        let spin = self.rates[ANGLE].with_relative_error(context.light_fraction);
        (spin.sigma < MAX_SPIN_SIGMA_RAD)
            .then(|| scaled(spin, 1.0 / context.period_s, 0.0).with_relative_error(self.relative_error()))
    }
}

/// Converts the interval, the flights and the laws to the quantities of a collision, without slip, gravity and
/// status.
pub(super) fn assemble_impact(
    interval: &Interval,
    flights: &Flights,
    posterior: Option<&ForceLawPosterior>,
    context: &ImpactContext,
) -> Impact {
    let before = Side::new(&flights.before, flights.shift_sigmas[0], interval.start, context);
    let after = Side::new(&flights.after, flights.shift_sigmas[1], interval.end, context);
    let contact = posterior.map(|posterior| &posterior.contact);
    let seconds = |x: Estimate| scaled(x, context.period_s, 0.0);
    let duration = contact.map_or_else(|| difference(interval.end, interval.start), |contact| contact.duration);
    // A point off the centre of a rotating body moves up and down with it.
    let mean_spin = 0.5 * (before.rates[ANGLE].value + after.rates[ANGLE].value);
    let mean_brake = (after.rates[NORMAL].value - before.rates[NORMAL].value) / duration.value;
    let brake = contact.map_or(mean_brake, |contact| contact.acceleration_max.value);
    let turning = mean_spin * context.center_sigma_px / brake;
    let [vn_before, vt_before] = [NORMAL, TANGENTIAL].map(|axis| before.speed(axis, context));
    let [vn_after, vt_after] = [NORMAL, TANGENTIAL].map(|axis| after.speed(axis, context));
    let relative = context.metres_per_px.sigma / context.metres_per_px.value;
    let speeds = [[vn_before, vn_after], [vt_before, vt_after]];
    let mut impact = Impact {
        start_s: Some(seconds(interval.start)),
        deepest_s: interval.deepest.map(|at| seconds(Estimate { sigma: at.sigma.hypot(turning), ..at })),
        end_s: Some(seconds(interval.end)),
        vn_before_m_s: Some(vn_before),
        vn_after_m_s: Some(vn_after),
        vt_before_m_s: Some(vt_before),
        vt_after_m_s: Some(vt_after),
        omega_before_rad_s: before.spin(context),
        omega_after_rad_s: after.spin(context),
        contact_time_s: Some(seconds(duration)),
        energy_lost_j: context.mass_kg.map(|mass_kg| energy_lost(mass_kg, &speeds, relative)),
        force_law: posterior.map_or(ForceLaw::None, ForceLawPosterior::law),
        force_law_probability: posterior.map(ForceLawPosterior::probability),
        status: PointStatus::Valid,
        ..Impact::unknown(0, 0, 0)
    };
    write_quotients(
        &mut impact,
        [&before, &after],
        duration,
        contact_point_speeds(interval, flights, context),
        context,
    );
    if let Some(contact) = contact {
        write_contact(&mut impact, contact, before.relative_error(), context);
    }
    impact
}

/// Writes restitution and impulse ratio, in which a part of the errors cancels.
fn write_quotients(
    impact: &mut Impact,
    [before, after]: [&Side; 2],
    duration: Estimate,
    contact_point: Option<[Estimate; 2]>,
    context: &ImpactContext,
) {
    // The common part of both underestimates cancels in a quotient.
    let differ = after.underestimate - before.underestimate;
    let either = before.interpolation_error.hypot(after.interpolation_error);
    let differing = |x: Estimate| x.with_relative_error(differ).with_relative_error(either);
    let negative = |x: Estimate| Estimate { value: -x.value, ..x };
    let impulse = |axis: usize| {
        let gravity_px = context.gravity_px[axis];
        let fall = Estimate { value: gravity_px * duration.value, sigma: gravity_px * duration.sigma };
        difference(difference(after.rates[axis], before.rates[axis]), fall)
    };
    impact.restitution = ratio(after.rates[NORMAL], before.rates[NORMAL]).map(negative).map(differing);
    impact.restitution_tangential =
        contact_point.and_then(|[first, last]| ratio(last, first)).map(negative).map(differing);
    impact.impulse_ratio = ratio(impulse(TANGENTIAL), impulse(NORMAL)).map(differing);
}

/// Writes what only a contact law gives: compression, acceleration and force. `relative_error` is that of the speed before.
fn write_contact(impact: &mut Impact, contact: &ContactEstimates, relative_error: f64, context: &ImpactContext) {
    let metres_per_px = context.metres_per_px;
    let relative = metres_per_px.sigma / metres_per_px.value;
    let seconds = |x: Estimate| scaled(x, context.period_s, 0.0);
    let acceleration = contact.acceleration_max;
    // The surface carries the weight as well.
    let push = Estimate { value: acceleration.value - context.gravity_px[NORMAL], ..acceleration };
    let push = context.acceleration(push);
    let depth_mm = scaled(contact.depth_max, metres_per_px.value * 1e3, relative);
    impact.compression_max_mm = Some(depth_mm.with_relative_error(relative_error));
    impact.acceleration_max_m_s2 = Some(context.acceleration(acceleration).with_relative_error(relative_error));
    impact.force_start_s = Some(seconds(contact.force_start));
    impact.force_end_s = Some(seconds(contact.force_end));
    impact.force_max_n = context.mass_kg.map(|mass_kg| scaled(push, mass_kg, relative_error));
}

/// Returns the loss of kinetic energy of the centre, J, from the speeds of each component before and after, m/s.
///
/// Their sigmas contain that of the scale, of relative size `relative`.
fn energy_lost(mass_kg: f64, components: &[[Estimate; 2]; 2], relative: f64) -> Estimate {
    let (mut value, mut variance) = (0.0, 0.0);
    for [before, after] in components {
        value += 0.5 * mass_kg * (before.value.powi(2) - after.value.powi(2));
        // All speeds share one scale: its uncertainty enters once, for the difference.
        let own = |v: &Estimate| (v.sigma.powi(2) - (v.value * relative).powi(2)).max(0.0);
        variance += mass_kg.powi(2) * (before.value.powi(2) * own(before) + after.value.powi(2) * own(after));
    }
    Estimate { value, sigma: variance.sqrt().hypot(2.0 * value * relative) }
}

/// Returns the velocities along normal and tangent (px/frame) and the spin (rad/frame) of a flight at an uncertain
/// moment.
///
/// The uncertainty of the centre is included, and that of outlines (`shift_sigma`, px/frame).
fn rates_at(flight: &[Polynomial; 3], shift_sigma: f64, at: Estimate, context: &ImpactContext) -> [Estimate; 3] {
    let rates = [NORMAL, TANGENTIAL, ANGLE].map(|k| rate_at(&flight[k], at));
    let center_sigma = shift_sigma.hypot(rates[ANGLE].value * context.center_sigma_px);
    let widened = |rate: Estimate| Estimate { sigma: rate.sigma.hypot(center_sigma), ..rate };
    [widened(rates[NORMAL]), widened(rates[TANGENTIAL]), rates[ANGLE]]
}

/// Returns the rate of a fitted coordinate at an uncertain moment, including the scatter about the fit.
pub(super) fn rate_at(flight: &Polynomial, at: Estimate) -> Estimate {
    let rate = flight.rate(at.value);
    Estimate { value: rate.value, sigma: (rate.sigma * flight.excess()).hypot(flight.curvature().value * at.sigma) }
}

/// Returns the speed of the contact point before and after, px/frame; `None` for a body without a radius.
///
/// The point is c - R n of a body that rotates counter-clockwise by omega, so its tangential speed is vt + omega R.
/// It is zero for a ball that rolls along the tangent, which rotates it clockwise.
fn contact_point_speeds(interval: &Interval, flights: &Flights, context: &ImpactContext) -> Option<[Estimate; 2]> {
    let radius = context.radius_px?;
    let speed = |flight: &[Polynomial; 3], at: Estimate| {
        let (v, omega) = (rate_at(&flight[TANGENTIAL], at), rate_at(&flight[ANGLE], at));
        let turn = (omega.sigma * radius.value).hypot(omega.value * radius.sigma.hypot(context.center_sigma_px));
        Estimate { value: v.value + omega.value * radius.value, sigma: v.sigma.hypot(turn) }
    };
    Some([speed(&flights.before, interval.start), speed(&flights.after, interval.end)])
}

/// Returns the moment within the contact at which the contact point stops, frames; see [`find_slip_end`].
pub(super) fn slip_end(
    nodes: &[SurfaceNode],
    interval: &Interval,
    flights: &Flights,
    context: &ImpactContext,
) -> Option<Estimate> {
    let [before, after] = contact_point_speeds(interval, flights, context)?;
    let radius = context.radius_px?.value;
    let (start, end) = (interval.start.value, interval.end.value);
    let origin = nodes_between(nodes, start, end).first()?;
    let pushed = |n: &SurfaceNode| {
        let free = flights.before[NORMAL].advance(origin.time_frames, n.time_frames).value;
        n.value[NORMAL] - origin.value[NORMAL] - free
    };
    let found = find_slip_end(nodes, &Sliding { start, end, before, after, radius }, pushed)?;
    // A stop outside the contact is none.
    (found.value >= start && found.value <= end).then_some(found)
}

/// Returns a quotient with its uncertainty; `None` if the denominator may be zero.
fn ratio(numerator: Estimate, denominator: Estimate) -> Option<Estimate> {
    if denominator.value.abs() <= 3.0 * denominator.sigma {
        return None;
    }
    let value = numerator.value / denominator.value;
    let sigma = (numerator.sigma / denominator.value).hypot(value * denominator.sigma / denominator.value);
    Some(Estimate { value, sigma })
}

/// Returns a difference of two independent estimates.
fn difference(a: Estimate, b: Estimate) -> Estimate {
    Estimate { value: a.value - b.value, sigma: a.sigma.hypot(b.sigma) }
}
