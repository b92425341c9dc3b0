//! A body that comes nearer to the camera, or goes away from it, or turns about an axis in the picture's plane, while it
//! strikes.
//!
//! What is `nearer` by a share is larger by that share in the picture, and so is its way from the picture's middle. The
//! speed in the picture is then not that across the view: it has in it the growth times the way from the middle, and it
//! changes although no force acts.

use super::contact_detector::Contact;
use super::solver::{FLIGHT_FRAMES, World};
use super::trajectory::{ANGLE, NORMAL, SurfaceNode, TANGENTIAL, between};
use crate::motion::{Axes, Drift, Growth, surely};
use crate::results::{Estimate, Impact};

/// Behind the noticed end the force may last for so many frames.
const EARLY_FRAMES: f64 = 4.0;
/// Share of its speed towards the camera that a contact may take from a body.
const TAKEN: f64 = 0.3;
/// What has more edges on one side seems to move to that side, and to turn, as it grows. What is left of that: a share of
/// the radius, and so many rad, a growth of 1.
const UNEVEN: f64 = 0.005;
const UNEVEN_RAD: f64 = 0.005;
/// What is left of the growth over a contact in its duration, as a share of it.
const LEFT: f64 = 0.05;

const RAD: f64 = std::f64::consts::PI / 180.0;
const NONE: Estimate = Estimate { value: 0.0, sigma: 0.0 };

/// What is seen of a body beside its poses.
#[derive(Debug, Clone, Copy)]
pub struct Beside<'a> {
    /// How its size changes.
    pub growth: &'a Growth,
    /// How its outline leaves its poses.
    pub drift: &'a Drift,
    /// Of the surface.
    pub axes: Axes,
    /// Of the poses' origin from where the camera looks straight ahead, along normal and tangent, px.
    pub place_px: [f64; 2],
    /// How well that is known, px.
    pub middle_sigma_px: f64,
}

/// By which share a frame a body grows before and after a contact, and where it is then.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Approach {
    /// As it was seen.
    seen: [Option<Estimate>; 2],
    /// As far as it is more than chance, and how far off that may be.
    told: [Estimate; 2],
    /// Start and end of the contact.
    contact_frames: [f64; 2],
    /// Length of the flights.
    flight_frames: [f64; 2],
    /// By how much a frame a ball leaves the pose before and after, along normal and tangent, px, and its angle, rad.
    drift: [[Estimate; 3]; 2],
    /// Of the pose's origin from where the camera looks straight ahead, along normal and tangent, px.
    place_px: [f64; 2],
    /// How well it is known where the camera looks, px.
    middle_sigma_px: f64,
}

impl Approach {
    /// Of a contact that has ended, from what is seen up to `known_to_frames`; `None` while it has not ended.
    pub fn of(beside: &Beside<'_>, contact: &Contact, known_to_frames: f64) -> Option<Self> {
        let (start, end) = (contact.start_frames, contact.end_frames?);
        let from = contact.flight_from_frames.max(start - FLIGHT_FRAMES);
        let to = known_to_frames.min(end + FLIGHT_FRAMES);
        let flights = [(from, contact.flight_to_frames), (end + EARLY_FRAMES, to)];
        let seen = flights.map(|(from, to)| beside.growth.rate(from, to));
        let drifts =
            [beside.drift.supposed(flights[0].0, flights[0].1), beside.drift.surely(flights[1].0, flights[1].1)];
        let drift = drifts.map(|drift| {
            let [x, y, turn] = drift?;
            let (value, sigma) = (beside.axes.surface(x.value, y.value), beside.axes.surface_sigma(x.sigma, y.sigma));
            let along = |value: f64, sigma: f64| Estimate { value, sigma };
            Some([along(value.normal, sigma.normal), along(value.tangential, sigma.tangential), times(turn, RAD)])
        });
        // What is not seen yet of the flight after is what it was before, or anything up to that.
        let [before, after] = drift;
        let before = before.unwrap_or([NONE; 3]);
        let after = after.unwrap_or(before.map(|drift| Estimate { sigma: drift.value.hypot(drift.sigma), ..drift }));
        Some(Self {
            seen,
            told: told(seen),
            contact_frames: [start, end],
            flight_frames: [start - from, to - end],
            drift: [before, after],
            place_px: beside.place_px,
            middle_sigma_px: beside.middle_sigma_px,
        })
    }

    /// The positions of a body that kept the distance it has at first touch.
    pub fn evened(&self, nodes: &[SurfaceNode]) -> Vec<SurfaceNode> {
        let even = |node: &SurfaceNode| {
            let larger = self.grown(node.time_frames).exp();
            let mut value = node.value;
            value[ANGLE] += self.left(ANGLE, node.time_frames);
            for k in [NORMAL, TANGENTIAL] {
                let center_px = value[k] + self.left(k, node.time_frames);
                value[k] = (self.place_px[k] + center_px) / larger - self.place_px[k];
            }
            SurfaceNode { value, ..*node }
        };
        nodes.iter().map(even).collect()
    }

    /// How much larger than at first touch it is, as a logarithm. What it is flattened by is not in it.
    fn grown(&self, time_frames: f64) -> f64 {
        self.summed(self.told.map(|told| told.value), time_frames)
    }

    /// How far a ball is beside the pose, beside what it was at first touch, px, px and rad.
    fn left(&self, k: usize, time_frames: f64) -> f64 {
        self.summed(self.drift.map(|drift| drift[k].value), time_frames)
    }

    /// The sum since first touch of what is so much a frame before and after.
    fn summed(&self, [before, after]: [f64; 2], time_frames: f64) -> f64 {
        let [start, end] = self.contact_frames;
        let between = 0.5 * (before + after);
        match time_frames {
            t if t <= start => before * (t - start),
            t if t <= end => between * (t - start),
            t => between * (end - start) + after * (t - end),
        }
    }

    /// The collision with what is not known of the growth in its sigmas, and with the growth.
    ///
    /// `nodes` are the positions as they were seen.
    pub fn told(&self, mut impact: Impact, nodes: &[SurfaceNode], world: &World) -> Impact {
        let touch = between(nodes, self.contact_frames[0], f64::INFINITY).first();
        let touch_px = touch.map_or([0.0; 3], |node| node.value);
        let per_second = |seen: Option<Estimate>| seen.map(|seen| times(seen, 1.0 / world.period_s));
        [impact.growth_before_per_s, impact.growth_after_per_s] = self.seen.map(per_second);
        let speed = world.metres_per_px.value / world.period_s;
        // Of a component before and after, px/frame.
        let doubt = |k: usize, side: usize, told: Option<Estimate>| {
            let Estimate { value, sigma } = self.told[side];
            let far_px = (self.place_px[k] + touch_px[k]).abs();
            let way_px = told.map_or(0.0, |v| (v.value / speed).abs()) * self.flight_frames[side];
            let middle_px = self.middle_sigma_px.hypot(UNEVEN * world.radius_px.map_or(0.0, |radius| radius.value));
            (sigma * (far_px + way_px)).hypot(value * middle_px).hypot(self.drift[side][k].sigma) * speed
        };
        let normal = [doubt(NORMAL, 0, impact.vn_before_m_s), doubt(NORMAL, 1, impact.vn_after_m_s)];
        let along = [doubt(TANGENTIAL, 0, impact.vt_before_m_s), doubt(TANGENTIAL, 1, impact.vt_after_m_s)];
        // When a spin about another axis changes within the contact is not seen.
        let spun = 0.5 * (self.drift[1][NORMAL].value - self.drift[0][NORMAL].value).abs() * speed;
        let spins = [0, 1].map(|side| self.drift[side][ANGLE].sigma / world.period_s);
        widen(&mut impact, (normal, spun), (along, spins), world);
        for (side, spin) in [&mut impact.omega_before_rad_s, &mut impact.omega_after_rad_s].into_iter().enumerate() {
            by(spin, (UNEVEN_RAD * self.told[side].value).hypot(self.drift[side][ANGLE].sigma) / world.period_s);
        }
        let [start, end] = self.contact_frames;
        let grown = 0.5 * (self.told[0].value + self.told[1].value) * (end - start);
        let duration_s = impact.contact_time_s.map_or(0.0, |duration| duration.value);
        by(&mut impact.contact_time_s, LEFT * grown * duration_s);
        impact
    }
}

/// What is taken for an approach before and after, and how well it is known.
///
/// What both flights say is put together. Growth that turns with the body is no approach: the picture's scale differs from
/// place to place.
fn told(seen: [Option<Estimate>; 2]) -> [Estimate; 2] {
    let [before, after] = seen.map(|seen| seen.map_or(NONE, surely));
    if before.value * after.value < 0.0 {
        return [before, after].map(|told| Estimate { value: 0.0, sigma: told.value.hypot(told.sigma) });
    }
    let both = |own: Option<Estimate>, other: Option<Estimate>| {
        let changed = |other: Estimate| Estimate { sigma: other.sigma.hypot(TAKEN * other.value), ..other };
        match (own, other) {
            (Some(a), Some(b)) => {
                let (of_a, of_b) = (a.sigma.powi(-2), changed(b).sigma.powi(-2));
                let value = (of_a * a.value + of_b * b.value) / (of_a + of_b);
                surely(Estimate { value, sigma: (of_a + of_b).powf(-0.5) })
            }
            (Some(own), None) => surely(own),
            (None, other) => other.map_or(NONE, |other| changed(surely(other))),
        }
    };
    [both(seen[0], seen[1]), both(seen[1], seen[0])]
}

/// Adds what the speeds before and after may be off by to all that follows from them.
fn widen(impact: &mut Impact, (normal, spun): ([f64; 2], f64), (along, spins): ([f64; 2], [f64; 2]), world: &World) {
    let value = |number: Option<Estimate>| number.map_or(0.0, |number| number.value);
    let (vn, vt) = (
        [value(impact.vn_before_m_s), value(impact.vn_after_m_s)],
        [value(impact.vt_before_m_s), value(impact.vt_after_m_s)],
    );
    let rim = world.radius_px.map_or(0.0, |radius| radius.value * world.metres_per_px.value);
    let slide = vt[0] + value(impact.omega_before_rad_s) * rim;
    by(&mut impact.vn_before_m_s, normal[0]);
    by(&mut impact.vn_after_m_s, normal[1]);
    by(&mut impact.vt_before_m_s, along[0]);
    by(&mut impact.vt_after_m_s, along[1]);
    // Both sides err the same way, and the speed turns: what they are off by adds up.
    let restitution = value(impact.restitution).abs();
    by(&mut impact.restitution, (normal[1] + restitution * normal[0]) / vn[0].abs());
    let tangential = value(impact.restitution_tangential).abs();
    let slides = [0, 1].map(|side| along[side].hypot(rim * spins[side]));
    by(&mut impact.restitution_tangential, (slides[1] + tangential * slides[0]) / slide.abs());
    let ratio = value(impact.impulse_ratio).abs();
    let turned = along[0] + along[1] + ratio * (normal[0] + normal[1]);
    by(&mut impact.impulse_ratio, turned / (vn[1] - vn[0]).abs());
    let lost = |v: [f64; 2], doubt: [f64; 2]| (v[0] * doubt[0]).abs() + (v[1] * doubt[1]).abs();
    by(&mut impact.energy_lost_j, world.mass_kg.unwrap_or(0.0) * lost(vn, normal).hypot(lost(vt, along)));
    let within = normal[0].hypot(spun);
    let share = within / vn[0].abs();
    for number in [&mut impact.compression_max_mm, &mut impact.acceleration_max_m_s2, &mut impact.force_max_n] {
        by(number, share * value(*number));
    }
    // A speed that is off by something is zero at another time, and a flight leaves the contact elsewhere.
    let brake = (vn[1] - vn[0]) / value(impact.contact_time_s);
    by(&mut impact.deepest_s, within / brake);
    let shift = share * value(impact.contact_time_s);
    for moment in [&mut impact.start_s, &mut impact.end_s, &mut impact.force_start_s, &mut impact.force_end_s] {
        by(moment, shift);
    }
}

/// Adds to the sigma of a number.
fn by(number: &mut Option<Estimate>, doubt: f64) {
    if let Some(number) = number
        && doubt.is_finite()
    {
        number.sigma = number.sigma.hypot(doubt);
    }
}

fn times(number: Estimate, factor: f64) -> Estimate {
    Estimate { value: number.value * factor, sigma: number.sigma * factor.abs() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(value: f64) -> Option<Estimate> {
        Some(Estimate { value, sigma: 1e-6 })
    }

    #[test]
    fn what_both_flights_show_is_put_together_and_chance_is_left_out() {
        assert_eq!(told([seen(1.5e-6), seen(-1e-6)]), [NONE; 2]);
        assert_eq!(told([None, None]), [NONE; 2]);
        let [before, after] = told([seen(3e-5), seen(2.6e-5)]);
        assert!((before.value - 3e-5).abs() < 1e-6 && (after.value - 2.6e-5).abs() < 1e-6, "{before:?} {after:?}");
        // Not sure by itself, but with what comes after.
        let weak = Some(Estimate { value: 1.5e-5, sigma: 1e-5 });
        let [before, _] = told([weak, seen(3e-5)]);
        assert!((1.2e-5..3e-5).contains(&before.value) && before.sigma > 4e-6, "{before:?}");
        // Not seen yet.
        let [_, after] = told([seen(3e-5), None]);
        assert!((after.value - 3e-5).abs() < 1e-6 && after.sigma > 5e-6, "{after:?}");
    }

    #[test]
    fn growth_that_turns_with_the_body_is_told_as_doubt() {
        let [before, after] = told([seen(3e-5), seen(-4e-5)]);
        assert!(before.value.abs() <= 0.0 && after.value.abs() <= 0.0);
        assert!((before.sigma - 3e-5).abs() < 1e-6 && (after.sigma - 4e-5).abs() < 1e-6);
    }

    #[test]
    fn positions_are_those_of_a_body_that_kept_its_distance() {
        let approach = Approach {
            seen: [None; 2],
            told: [Estimate { value: 1e-4, sigma: 0.0 }; 2],
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
            value,
            sigma: [1e-3; 3],
            walk_share: [0.0; 3],
        };
        let nodes: Vec<_> = (0..60)
            .map(|k| {
                let larger = (1e-4 * (f64::from(k) - 20.0)).exp();
                let way = [-0.3 * f64::from(k), 0.1 * f64::from(k)];
                node(f64::from(k), [(way[0] - 60.0) * larger + 60.0, (way[1] + 90.0) * larger - 90.0, 0.2])
            })
            .collect();
        for (k, even) in approach.evened(&nodes).iter().enumerate() {
            let off = [even.value[0] + 0.3 * k as f64, even.value[1] - 0.1 * k as f64];
            assert!(
                off[0].abs() < 1e-9 && off[1].abs() < 1e-9 && even.value[2].total_cmp(&0.2).is_eq(),
                "{k}: {off:?}"
            );
        }
    }

    #[test]
    fn places_and_angles_are_those_of_the_ball_not_of_its_pattern() {
        // Along normal and tangent, px, and the angle, rad, a frame: by the pattern, and what is beside it.
        let (pattern, beside) = ([-0.3, 0.1, 0.02], [0.05, -0.02, 0.003]);
        let approach = Approach {
            seen: [None; 2],
            told: [NONE; 2],
            contact_frames: [20.0, 40.0],
            flight_frames: [20.0, 20.0],
            drift: [beside.map(|value| Estimate { value, sigma: 0.0 }); 2],
            place_px: [0.0; 2],
            middle_sigma_px: 0.0,
        };
        let node = |frame: u64| SurfaceNode {
            frame,
            time_frames: frame as f64,
            component: 0,
            value: pattern.map(|rate| rate * frame as f64),
            sigma: [1e-3; 3],
            walk_share: [0.0; 3],
        };
        let even = approach.evened(&[node(5), node(30), node(55)]);
        for (from, to) in [(0, 1), (1, 2)] {
            for k in [NORMAL, TANGENTIAL, ANGLE] {
                let rate = (even[to].value[k] - even[from].value[k]) / 25.0;
                assert!((rate - pattern[k] - beside[k]).abs() < 1e-12, "{k}: {rate}");
            }
        }
    }
}
