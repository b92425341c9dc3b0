//! The motion under a contact law.

use std::f64::consts::FRAC_PI_2;

use super::contact_law::{Family, Findings, Law, Parameters, Row, SETS, States, Units};

/// Integration steps per time unit.
const STEPS_PER_UNIT: f64 = 64.0;
/// The maximum duration of a contact, time units.
const MAX_UNITS: f64 = 6.0;

/// The motions through one contact for up to `SETS` parameter sets of one law; times since its start, depths along the
/// inward normal.
#[derive(Debug, Clone)]
pub struct LawMotions {
    law: Law,
    /// The states at every step, until every set has rebounded.
    states: Vec<States>,
    end: States,
    /// The number of states before the end of each set; 0 where it does not rebound.
    counts: [usize; SETS],
    step: f64,
}

impl LawMotions {
    /// Integrates y'' = gravity - F/m from the first contact until the force is back to zero, by fourth-order
    /// Runge-Kutta with 64 steps per `units.depth / units.speed * pi / 2`.
    ///
    /// # Panics
    ///
    /// If `sets` is empty or holds more than `SETS`.
    pub fn new(family: Family, sets: &[Parameters], units: &Units) -> Self {
        assert!((1..=SETS).contains(&sets.len()), "{} sets of parameters", sets.len());
        let law = Law::new(family, sets, units);
        let step = FRAC_PI_2 * units.depth / units.speed / STEPS_PER_UNIT;
        let first = law.initial_states();
        let mut own = Self { law, states: vec![first], end: first, counts: [0; SETS], step };
        own.integrate();
        own.locate_end();
        own
    }

    /// Integrates all sets in equal steps until each has rebounded, sinks for good or lasts too long.
    fn integrate(&mut self) {
        let (steps, longest) = ([self.step; SETS], MAX_UNITS * STEPS_PER_UNIT * self.step);
        let mut open = [true; SETS];
        let mut next = self.end;
        while open.contains(&true) {
            let count = self.states.len();
            self.law.advance(&self.states[count - 1], &steps, &mut next);
            if next.time[0] > longest {
                return;
            }
            if !is_in_contact(&next) {
                for (set, open) in open.iter_mut().enumerate() {
                    let (depth, speed) = (next.depth[set], next.speed[set]);
                    let is_over = speed < 0.0 && (next.force[set] <= 0.0 || depth <= 0.0);
                    if *open && is_over && depth.is_finite() {
                        self.counts[set] = count;
                    }
                    *open &= depth >= 0.0 && speed.is_finite() && !is_over;
                }
            }
            self.states.push(next);
        }
    }

    /// Locates the moment within one step at which the force, or the depth, reaches zero, by the Illinois method.
    ///
    /// M. Dowell and P. Jarratt, BIT 11 (1971) 168, <https://doi.org/10.1007/BF01934364>.
    fn locate_end(&mut self) {
        let (from, steps) = (self.gather(|own, set| own.counts[set].max(1) - 1), [self.step; SETS]);
        let whole = self.stepped_from(&from, &steps);
        // Without depth there is no force, and its zero would be flat.
        let remainder = |s: &States, set: usize| if whole.force[set] < 0.0 { s.force[set] } else { s.depth[set] };
        let mut low: [_; SETS] = std::array::from_fn(|set| (0.0, remainder(&from, set)));
        let mut high: [_; SETS] = std::array::from_fn(|set| (self.step, remainder(&whole, set)));
        let (mut best, mut open) = (whole, self.counts.map(|count| count > 0));
        let mut times = steps;
        for _ in 0..30 {
            for set in 0..SETS {
                let share = low[set].1 / (low[set].1 - high[set].1);
                open[set] &= share.is_finite() && high[set].0 - low[set].0 >= 1e-12 * self.step;
                if open[set] {
                    times[set] = low[set].0 + share * (high[set].0 - low[set].0);
                }
            }
            if !open.contains(&true) {
                break;
            }
            best = self.stepped_from(&from, &times);
            for set in 0..SETS {
                if !open[set] {
                    continue;
                }
                let value = remainder(&best, set);
                open[set] = value.abs() >= 1e-13 * remainder(&from, set);
                let (near, far) = if value > 0.0 { (&mut low, &mut high) } else { (&mut high, &mut low) };
                near[set] = (times[set], value);
                far[set].1 *= 0.5;
            }
        }
        for set in 0..SETS {
            // A contact shorter than one step cannot be resolved by these steps.
            if best.time[set].is_nan() || best.time[set] <= from.time[set] {
                self.counts[set] = 0;
            }
        }
        self.end = best;
    }

    /// Returns the states one step after others; each set has its own step, frames.
    fn stepped_from(&self, from: &States, step: &Row) -> States {
        let mut to = *from;
        self.law.advance(from, step, &mut to);
        to
    }

    /// Returns the state of each set at an index of its own; see [`state_at`](Self::state_at).
    fn gather(&self, place: impl Fn(&Self, usize) -> usize) -> States {
        let mut out = self.end;
        for set in 0..SETS {
            let from = self.state_at(place(self, set), set);
            out.time[set] = from.time[set];
            out.depth[set] = from.depth[set];
            out.speed[set] = from.speed[set];
            out.force[set] = from.force[set];
        }
        out
    }

    /// Returns the state of a set at an index; from its last one on, the end of its contact.
    fn state_at(&self, place: usize, set: usize) -> &States {
        if place < self.counts[set].max(1) { &self.states[place] } else { &self.end }
    }

    /// Whether the force of a set returns to zero.
    pub fn rebounds(&self, set: usize) -> bool {
        self.counts[set] > 0
    }

    /// Returns the depth of each set at its own time since the start (frames), px. Free fall before and after the
    /// contact.
    pub fn depths(&self, times: &[f64; SETS]) -> [f64; SETS] {
        let fall = |from: &States, set: usize| {
            let dt = times[set] - from.time[set];
            from.depth[set] + from.speed[set] * dt + 0.5 * self.law.units.gravity * dt * dt
        };
        let place = |set: usize| ((times[set] / self.step).floor().max(0.0) as usize).min(self.counts[set].max(1) - 1);
        let mut out = [0.0; SETS];
        for set in 0..SETS {
            out[set] = if times[set] <= 0.0 {
                fall(&self.states[0], set)
            } else if times[set] >= self.end.time[set] {
                fall(&self.end, set)
            } else {
                let place = place(set);
                interpolate_depth(&self.states[place], self.state_at(place + 1, set), set, times[set])
            };
        }
        out
    }

    /// Returns the predicted quantities of each set; `starts` are the times of first contact.
    pub fn findings(&self, starts: &[f64; SETS]) -> [Findings; SETS] {
        let (deepest, peak_force) = (self.deepest(), self.peak_force());
        let levels = peak_force.map(|(max, _)| 0.02 * max);
        let (rise, fall) = self.level_times(&levels);
        std::array::from_fn(|set| {
            let start = starts[set];
            [
                start,
                start + deepest.time[set],
                start + self.end.time[set],
                start + rise[set],
                start + fall[set],
                self.states[0].speed[set],
                self.end.speed[set],
                deepest.depth[set],
                peak_force[set].1 - self.law.units.gravity,
                self.end.time[set],
            ]
        })
    }

    /// Finds the deepest state, where the speed is zero, by Newton's method from the line between the neighbouring
    /// states.
    fn deepest(&self) -> States {
        let indices: [usize; SETS] = std::array::from_fn(|set| {
            let count = self.counts[set].max(1);
            self.states[..count].partition_point(|s| s.speed[set] > 0.0).clamp(1, count)
        });
        let (a, b) = (self.gather(|_, set| indices[set] - 1), self.gather(|_, set| indices[set]));
        let step = |set: usize| (b.time[set] - a.time[set]) * a.speed[set] / (a.speed[set] - b.speed[set]);
        let mut state = self.stepped_from(&a, &std::array::from_fn(step));
        for _ in 0..2 {
            let step = |set: usize| {
                let at = state.time[set] + state.speed[set] / (state.force[set] - self.law.units.gravity);
                at.max(a.time[set]).min(b.time[set]) - a.time[set]
            };
            state = self.stepped_from(&a, &std::array::from_fn(step));
        }
        state
    }

    /// Returns the first and the last time at which the force of each set has its level, frames.
    fn level_times(&self, levels: &Row) -> (Row, Row) {
        let mut rises = [0; SETS];
        let mut falls = [0; SETS];
        for set in 0..SETS {
            let states = &self.states[..self.counts[set].max(1)];
            let is_felt = |s: &States| s.force[set] >= levels[set];
            rises[set] = states.iter().position(is_felt).unwrap_or(0);
            falls[set] = states.iter().rposition(is_felt).unwrap_or(0);
        }
        let at = |places: &[usize; SETS]| self.gather(|_, set| places[set]);
        let after = |places: &[usize; SETS]| self.gather(|_, set| places[set] + 1);
        let before = rises.map(|rise| rise.max(1) - 1);
        let mut rise = self.level_crossing(levels, &at(&before), &after(&before));
        let fall = self.level_crossing(levels, &at(&falls), &after(&falls));
        for set in 0..SETS {
            if rises[set] == 0 {
                rise[set] = 0.0;
            }
        }
        (rise, fall)
    }

    /// Finds the time at which the force of each set crosses its level between two neighbouring states, frames.
    ///
    /// Uses false position, because forces curve strongly near zero.
    fn level_crossing(&self, levels: &Row, a: &States, b: &States) -> Row {
        let ends =
            |s: &States| -> [(f64, f64); SETS] { std::array::from_fn(|set| (s.time[set], s.force[set] - levels[set])) };
        let (mut low, mut high) = (ends(a), ends(b));
        for _ in 0..6 {
            let at: Row = std::array::from_fn(|set| {
                let ((t0, f0), (t1, f1)) = (low[set], high[set]);
                t0 - f0 * (t1 - t0) / (f1 - f0)
            });
            let there = self.stepped_from(a, &std::array::from_fn(|set| at[set] - a.time[set]));
            for set in (0..SETS).filter(|set| at[*set].is_finite()) {
                let found = (at[set], there.force[set] - levels[set]);
                let is_low = (found.1 < 0.0) == (low[set].1 < 0.0);
                *(if is_low { &mut low[set] } else { &mut high[set] }) = found;
            }
        }
        std::array::from_fn(|set| if low[set].1.abs() < high[set].1.abs() { low[set].0 } else { high[set].0 })
    }

    /// Returns the largest force of the states, and the peak of the parabola through the three states around it,
    /// px/frame^2.
    fn peak_force(&self) -> [(f64, f64); SETS] {
        std::array::from_fn(|set| {
            let count = self.counts[set].max(1);
            let f = |place: usize| self.state_at(place, set).force[set];
            let peak = (0..=count).max_by(|a, b| f(*a).total_cmp(&f(*b))).unwrap_or(0);
            let max = f(peak).max(0.0);
            if peak == 0 || peak + 1 >= count {
                return (max, f(peak));
            }
            let (slope, bend) = (0.5 * (f(peak + 1) - f(peak - 1)), f(peak + 1) - 2.0 * f(peak) + f(peak - 1));
            (max, if bend < 0.0 { f(peak) - 0.5 * slope * slope / bend } else { f(peak) })
        })
    }
}

/// Whether all states are finite and no set has rebounded.
fn is_in_contact(s: &States) -> bool {
    let mut all = true;
    for set in 0..SETS {
        all &= s.depth[set] > 0.0 && s.depth[set] < f64::MAX && (s.speed[set] >= 0.0 || s.force[set] > 0.0);
    }
    all
}

/// Interpolates the depth of a set between two of its states by a cubic Hermite polynomial, px.
#[inline(always)]
fn interpolate_depth(a: &States, b: &States, set: usize, time: f64) -> f64 {
    let h = b.time[set] - a.time[set];
    let u = ((time - a.time[set]) / h).clamp(0.0, 1.0);
    let (u2, u3) = (u * u, u * u * u);
    a.depth[set] * (2.0 * u3 - 3.0 * u2 + 1.0)
        + h * a.speed[set] * (u3 - 2.0 * u2 + u)
        + b.depth[set] * (3.0 * u2 - 2.0 * u3)
        + h * b.speed[set] * (u3 - u2)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The predicted quantities of one set, in the last lane.
    fn findings(family: Family, p: &Parameters, units: &Units, start: f64) -> Option<(Findings, LawMotions)> {
        let other = Parameters::from(*p).map(|x| 1.01 * x);
        let passages = LawMotions::new(family, &[family.complete(&other), *p], units);
        passages.rebounds(1).then(|| (passages.findings(&[start; SETS])[1], passages))
    }

    #[test]
    fn a_contact_shorter_than_a_step_is_refused() {
        let units = Units { depth: 5.0, speed: 0.5, gravity: 0.0 };
        for size in (0..400).map(|k| 0.02 * 1.05_f64.powi(k)) {
            for damping in [-3.0, -0.5, 0.0, 0.3, 2.0] {
                let p = [0.0, 0.5, size.ln(), damping, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
                for family in [Family::KelvinVoigt, Family::Power] {
                    let Some((found, _)) = findings(family, &family.complete(&p), &units, 7.0) else { continue };
                    let [start, deepest, end, ..] = found;
                    assert!(start <= deepest && deepest <= end, "{size} {damping}: {start} {deepest} {end}");
                }
            }
        }
    }

    #[test]
    fn an_undamped_spring_takes_half_a_period() {
        // F/m = w^2 y with w = 0.1 per frame, written with y0 = v0/w.
        let units = Units { depth: 5.0, speed: 0.5, gravity: 0.0 };
        let p = [0.0, 0.5, 0.05_f64.ln(), 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let (found, _) = findings(Family::KelvinVoigt, &p, &units, 7.0).unwrap();
        let [start, deepest, end, _, _, before, after, depth, acceleration, _] = found;
        let half = std::f64::consts::PI / 0.1;
        assert!((start - 7.0).abs() < 1e-12 && (end - 7.0 - half).abs() < 1e-5, "{end}");
        assert!((deepest - 7.0 - half / 2.0).abs() < 1e-4, "{deepest}");
        assert!((before - 0.5).abs() < 1e-12 && (after + 0.5).abs() < 1e-7);
        assert!((depth - 5.0).abs() < 1e-6 && (acceleration - 0.05).abs() < 1e-6);
    }

    #[test]
    fn a_damped_spring_gives_the_textbook_restitution_and_ends_inside() {
        // Kelvin-Voigt with damping ratio z: the force vanishes while the spring is still compressed.
        let (w, z): (f64, f64) = (0.1, 0.1);
        let units = Units { depth: 5.0, speed: 0.5, gravity: 0.0 };
        let p = [
            0.0,
            0.5,
            (w * w * 5.0_f64).ln(),
            2.0 * z * w * 0.5 / (w * w * 5.0),
            1.0,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
        ];
        let (found, passages) = findings(Family::KelvinVoigt, &p, &units, 0.0).unwrap();
        let root = (1.0 - z * z).sqrt();
        let expected = (-z / root * (root * 2.0 * z).atan2(2.0 * z * z - 1.0)).exp();
        // At the turning point the speed vanishes: tan(wd t) = sqrt(1 - z^2)/z.
        let turn = (root / z).atan() / (w * root);
        assert!((found[1] - turn).abs() < 1e-6, "{} against {turn}", found[1]);
        assert!((-found[6] / found[5] - expected).abs() < 1e-6, "{} against {expected}", -found[6] / found[5]);
        assert!(passages.depths(&[found[2]; SETS])[1] > 0.1 * found[7]);
    }

    #[test]
    fn a_hertz_contact_lasts_2_94_depths_over_speed() {
        let units = Units { depth: 4.0, speed: 0.3, gravity: 0.0 };
        // v^2/2 = A y0/(5/2) at y = y0.
        let p = [0.0, 0.3, (1.25 * 0.09 / 4.0_f64).ln(), 0.0, 1.5, 1.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let (found, _) = findings(Family::HuntCrossley, &p, &units, 0.0).unwrap();
        assert!((found[7] - 4.0).abs() < 1e-5, "{}", found[7]);
        assert!((found[2] / (4.0 / 0.3) - 2.943_3).abs() < 1e-3, "{}", found[2] / (4.0 / 0.3));
    }
}
