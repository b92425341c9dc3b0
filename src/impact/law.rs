//! Contact laws and the motion they make.

/// A family of contact laws, from stiff to free.
///
/// All are cases of F/m = A (s(y) (y/y0)^n + c r(y) (v/v0) (y/y0)^m) with the depth y, its rate v,
/// fixed units y0 and v0, and a stiffness factor s = 1 + b1 T1 + ... + bd Td (Chebyshev) of 2 y/y0 - 1.
/// The damping is a share of the spring's force, r = s, or a dashpot of its own, r = 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Family {
    /// n = 1, m = 0.
    KelvinVoigt,
    /// n = m = 3/2 (Hunt & Crossley 1975, doi:10.1115/1.3423596).
    HuntCrossley,
    /// m = n, n free.
    Power,
    /// n and m free.
    TwoExponents,
    /// n, m and s free.
    Stiffness {
        /// Degree of s, at most 7.
        degree: usize,
        /// Whether the damping is a dashpot of its own, m = 0.
        dashpot: bool,
    },
}

/// Most parameters a law has: start, speed, ln A, c, n, m, b1 to b7.
pub const MOST_PARAMETERS: usize = 13;

/// Parameters in the order of [`MOST_PARAMETERS`]; the first [`Family::count`] are free, the rest follow.
pub type Parameters = [f64; MOST_PARAMETERS];

/// Steps of the integration a time unit T is cut into.
const STEPS: f64 = 64.0;
/// Longest contact, time units.
const LONGEST: f64 = 6.0;

impl Family {
    /// How many parameters are free.
    pub fn count(self) -> usize {
        match self {
            Self::KelvinVoigt | Self::HuntCrossley => 4,
            Self::Power => 5,
            Self::TwoExponents => 6,
            Self::Stiffness { degree, .. } => 6 + degree.min(MOST_PARAMETERS - 6),
        }
    }

    /// Sets what is not free.
    pub fn complete(self, p: &Parameters) -> Parameters {
        let mut p = *p;
        match self {
            Self::KelvinVoigt => (p[4], p[5]) = (1.0, 0.0),
            Self::HuntCrossley => (p[4], p[5]) = (1.5, 1.5),
            Self::Power => p[5] = p[4],
            Self::Stiffness { dashpot: true, .. } => p[5] = 0.0,
            Self::TwoExponents | Self::Stiffness { .. } => {}
        }
        p[self.count().max(6)..].fill(0.0);
        p
    }
}

/// Units the parameters are measured in, and the free fall along the depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Units {
    /// Depth, px.
    pub depth: f64,
    /// Speed, px/frame.
    pub speed: f64,
    /// Acceleration into the surface, px/frame^2.
    pub gravity: f64,
}

#[derive(Debug, Clone, Copy)]
struct State {
    time: f64,
    depth: f64,
    speed: f64,
    force: f64,
}

/// A law with its numbers.
#[derive(Debug, Clone, Copy)]
struct Law {
    /// A in place of its logarithm.
    p: Parameters,
    units: Units,
    /// Whether the damping is a dashpot of its own.
    dashpot: bool,
}

/// The motion through one contact; times since its start, depths along the inward normal.
#[derive(Debug, Clone)]
pub struct Passage {
    law: Law,
    states: Vec<State>,
    step: f64,
}

/// What a law says of a contact: start, deepest, end, 2 % start, 2 % end (frames), speed before and after
/// (px/frame, inwards positive), greatest depth (px), greatest acceleration outwards (px/frame^2), duration (frames).
///
/// The duration stands for itself, since the errors of start and end are not independent.
pub type Findings = [f64; 10];

impl Passage {
    /// Integrates y'' = gravity - F/m from the first touch until the force is back to zero (Runge-Kutta of order 4,
    /// 64 steps a `units.depth / units.speed * pi / 2`). `None` where it does not come back.
    pub fn new(family: Family, p: &Parameters, units: &Units) -> Option<Self> {
        let law = Law::new(family, p, units);
        let step = std::f64::consts::FRAC_PI_2 * units.depth / units.speed / STEPS;
        let mut state = State { time: 0.0, depth: 0.0, speed: p[1], force: law.force(0.0, p[1]) };
        let mut states = vec![state];
        loop {
            let next = law.advance(state, step);
            if !(next.depth.is_finite() && next.speed.is_finite()) || next.time > LONGEST * STEPS * step {
                return None;
            }
            if next.speed < 0.0 && is_over(&next) {
                let last = law.last_moment(state, step);
                states.push(last);
                // A contact that comes and goes within a step is none that these steps could follow.
                return (last.time > state.time).then_some(Self { law, states, step });
            }
            if next.depth < 0.0 {
                return None;
            }
            states.push(next);
            state = next;
        }
    }

    fn end(&self) -> State {
        self.states[self.states.len() - 1]
    }

    /// Depth at a time since the start.
    pub fn depth(&self, time: f64) -> f64 {
        let fall = |from: &State| {
            let dt = time - from.time;
            from.depth + from.speed * dt + 0.5 * self.law.units.gravity * dt * dt
        };
        let end = self.end();
        if time <= 0.0 {
            return fall(&self.states[0]);
        }
        if time >= end.time {
            return fall(&end);
        }
        let i = ((time / self.step).floor().max(0.0) as usize).min(self.states.len() - 2);
        let (a, b) = (self.states[i], self.states[i + 1]);
        let h = b.time - a.time;
        let u = ((time - a.time) / h).clamp(0.0, 1.0);
        let (u2, u3) = (u * u, u * u * u);
        a.depth * (2.0 * u3 - 3.0 * u2 + 1.0)
            + h * a.speed * (u3 - 2.0 * u2 + u)
            + b.depth * (3.0 * u2 - 2.0 * u3)
            + h * b.speed * (u3 - u2)
    }

    /// What happened, `start` being the time of the first touch.
    pub fn findings(&self, start: f64) -> Findings {
        let end = self.end();
        let strongest = self.states.iter().map(|s| s.force).fold(0.0, f64::max);
        let turn = self.turn();
        let faint = 0.02 * strongest;
        let pairs = || self.states.windows(2);
        let rise = if self.states[0].force >= faint {
            0.0
        } else {
            pairs().find(|w| w[1].force >= faint).map_or(0.0, |w| self.passes(faint, &w[0], &w[1]))
        };
        let fall = pairs().rev().find(|w| w[0].force >= faint).map_or(end.time, |w| self.passes(faint, &w[0], &w[1]));
        let acceleration = self.strongest() - self.law.units.gravity;
        [
            start,
            start + turn.time,
            start + end.time,
            start + rise,
            start + fall,
            self.states[0].speed,
            end.speed,
            turn.depth,
            acceleration,
            end.time,
        ]
    }

    /// Where the speed is zero (Newton, from the line between the states about it).
    fn turn(&self) -> State {
        let turn = self.states.partition_point(|s| s.speed > 0.0).clamp(1, self.states.len() - 1);
        let (a, b) = (self.states[turn - 1], self.states[turn]);
        let mut state = self.law.advance(a, (b.time - a.time) * a.speed / (a.speed - b.speed));
        for _ in 0..2 {
            let at = state.time + state.speed / (state.force - self.law.units.gravity);
            state = self.law.advance(a, at.clamp(a.time, b.time) - a.time);
        }
        state
    }

    /// When the force is `level`, between two neighbouring states (false position; forces bend strongly near nothing).
    fn passes(&self, level: f64, a: &State, b: &State) -> f64 {
        let (mut low, mut high) = ((a.time, a.force - level), (b.time, b.force - level));
        for _ in 0..6 {
            let at = low.0 - low.1 * (high.0 - low.0) / (high.1 - low.1);
            if !at.is_finite() {
                break;
            }
            let value = self.law.advance(*a, at - a.time).force - level;
            if (value < 0.0) == (low.1 < 0.0) { low = (at, value) } else { high = (at, value) }
        }
        if low.1.abs() < high.1.abs() { low.0 } else { high.0 }
    }

    /// The greatest force, by a parabola through the three states about it.
    fn strongest(&self) -> f64 {
        let peak = (0..self.states.len()).max_by(|a, b| self.states[*a].force.total_cmp(&self.states[*b].force));
        let peak = peak.unwrap_or(0);
        let f = |i: usize| self.states[i].force;
        if peak == 0 || peak + 2 >= self.states.len() {
            return f(peak);
        }
        let (slope, bend) = (0.5 * (f(peak + 1) - f(peak - 1)), f(peak + 1) - 2.0 * f(peak) + f(peak - 1));
        if bend < 0.0 { f(peak) - 0.5 * slope * slope / bend } else { f(peak) }
    }
}

fn is_over(s: &State) -> bool {
    s.force <= 0.0 || s.depth <= 0.0
}

impl Law {
    fn new(family: Family, p: &Parameters, units: &Units) -> Self {
        let mut p = *p;
        p[2] = p[2].exp();
        Self { p, units: *units, dashpot: matches!(family, Family::Stiffness { dashpot: true, .. }) }
    }

    fn force(&self, depth: f64, speed: f64) -> f64 {
        let y = (depth / self.units.depth).max(0.0);
        let [_, _, size, damping, n, m, ..] = self.p;
        let (spring, dash) = if (n - 1.5).abs() < 1e-12 && (m - 1.5).abs() < 1e-12 {
            let y15 = y * y.sqrt();
            (y15, y15)
        } else if (n - 1.0).abs() < 1e-12 && m.abs() < 1e-12 {
            (y, 1.0)
        } else {
            let ln = y.max(1e-300).ln();
            let spring = (n * ln).exp();
            (spring, if (m - n).abs() < 1e-12 { spring } else { (m * ln).exp() })
        };
        let x = 2.0 * y - 1.0;
        let (mut stiffness, mut lower, mut here) = (1.0, 1.0, x);
        for b in &self.p[6..] {
            stiffness += b * here;
            (lower, here) = (here, 2.0 * x * here - lower);
        }
        let damped = if self.dashpot { 1.0 } else { stiffness };
        size * (stiffness * spring + damped * damping * dash * speed / self.units.speed)
    }

    fn advance(&self, s: State, h: f64) -> State {
        let gravity = self.units.gravity;
        let pull = |depth: f64, speed: f64| gravity - self.force(depth, speed);
        let (v1, a1) = (s.speed, gravity - s.force);
        let (v2, a2) = (s.speed + 0.5 * h * a1, pull(s.depth + 0.5 * h * v1, s.speed + 0.5 * h * a1));
        let (v3, a3) = (s.speed + 0.5 * h * a2, pull(s.depth + 0.5 * h * v2, s.speed + 0.5 * h * a2));
        let (v4, a4) = (s.speed + h * a3, pull(s.depth + h * v3, s.speed + h * a3));
        let depth = s.depth + h / 6.0 * (v1 + 2.0 * v2 + 2.0 * v3 + v4);
        let speed = s.speed + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
        State { time: s.time + h, depth, speed, force: self.force(depth, speed) }
    }

    /// The moment within one step at which the force, or the depth, reaches zero (Illinois false position).
    fn last_moment(&self, from: State, step: f64) -> State {
        let whole = self.advance(from, step);
        // Without depth there is no force, and its zero would be flat.
        let left = |s: &State| if whole.force < 0.0 { s.force } else { s.depth };
        let (mut low, mut high) = ((0.0, left(&from)), (step, left(&whole)));
        let mut best = whole;
        for _ in 0..30 {
            let share = low.1 / (low.1 - high.1);
            if !share.is_finite() || high.0 - low.0 < 1e-12 * step {
                break;
            }
            let at = low.0 + share * (high.0 - low.0);
            best = self.advance(from, at);
            let value = left(&best);
            if value.abs() < 1e-13 * left(&from) {
                break;
            }
            if value > 0.0 {
                low = (at, value);
                high.1 *= 0.5;
            } else {
                high = (at, value);
                low.1 *= 0.5;
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_contact_shorter_than_a_step_is_refused() {
        let units = Units { depth: 5.0, speed: 0.5, gravity: 0.0 };
        for size in (0..400).map(|k| 0.02 * 1.05_f64.powi(k)) {
            for damping in [-3.0, -0.5, 0.0, 0.3, 2.0] {
                let p = [0.0, 0.5, size.ln(), damping, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
                for family in [Family::KelvinVoigt, Family::Power] {
                    let Some(passage) = Passage::new(family, &family.complete(&p), &units) else { continue };
                    let [start, deepest, end, ..] = passage.findings(7.0);
                    assert!(start <= deepest && deepest <= end, "{size} {damping}: {start} {deepest} {end}");
                }
            }
        }
    }

    #[test]
    fn an_undamped_spring_takes_half_a_period() {
        // F/m = w^2 y with w = 0.1 a frame, written with y0 = v0/w.
        let units = Units { depth: 5.0, speed: 0.5, gravity: 0.0 };
        let p = [0.0, 0.5, 0.05_f64.ln(), 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let [start, deepest, end, _, _, before, after, depth, acceleration, _] =
            Passage::new(Family::KelvinVoigt, &p, &units).unwrap().findings(7.0);
        let half = std::f64::consts::PI / 0.1;
        assert!((start - 7.0).abs() < 1e-12 && (end - 7.0 - half).abs() < 1e-5, "{end}");
        assert!((deepest - 7.0 - half / 2.0).abs() < 1e-4, "{deepest}");
        assert!((before - 0.5).abs() < 1e-12 && (after + 0.5).abs() < 1e-7);
        assert!((depth - 5.0).abs() < 1e-6 && (acceleration - 0.05).abs() < 1e-6);
    }

    #[test]
    fn a_damped_spring_gives_the_textbook_restitution_and_ends_inside() {
        // Kelvin-Voigt with damping ratio z: force zero at e = exp(-z t/sqrt(1-z^2)) type restitution, still compressed.
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
        let passage = Passage::new(Family::KelvinVoigt, &p, &units).unwrap();
        let found = passage.findings(0.0);
        let root = (1.0 - z * z).sqrt();
        let expected = (-z / root * (root * 2.0 * z).atan2(2.0 * z * z - 1.0)).exp();
        // The turn is where w0 sin(wd t) slows to nothing: tan(wd t) = sqrt(1 - z^2)/z.
        let turn = (root / z).atan() / (w * root);
        assert!((found[1] - turn).abs() < 1e-6, "{} against {turn}", found[1]);
        assert!((-found[6] / found[5] - expected).abs() < 1e-6, "{} against {expected}", -found[6] / found[5]);
        assert!(passage.depth(found[2]) > 0.1 * found[7]);
    }

    #[test]
    fn a_hertz_contact_lasts_2_94_depths_over_speed() {
        let units = Units { depth: 4.0, speed: 0.3, gravity: 0.0 };
        // v^2/2 = A y0/(5/2) at y = y0.
        let p = [0.0, 0.3, (1.25 * 0.09 / 4.0_f64).ln(), 0.0, 1.5, 1.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let found = Passage::new(Family::HuntCrossley, &p, &units).unwrap().findings(0.0);
        assert!((found[7] - 4.0).abs() < 1e-5, "{}", found[7]);
        assert!((found[2] / (4.0 / 0.3) - 2.943_3).abs() < 1e-3, "{}", found[2] / (4.0 / 0.3));
    }
}
