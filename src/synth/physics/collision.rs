//! One collision, integrated in small steps and stored as a dense function of time.

use super::law::{Friction, NormalLaw, PatchState};

/// The step of the integration. The fastest mode, that of the patch, has a period of about 4 ms.
const STEP_S: f64 = 5e-8;
/// The number of steps from one stored knot to the next (1 us).
const STEPS_PER_KNOT: u64 = 20;
/// The maximum contact time of a bounce.
const MAX_CONTACT_S: f64 = 0.1;

// Indices of the state vector; J is the impulse of the contact force.
const X: usize = 0;
const Y: usize = 1;
const ANGLE: usize = 2;
const VX: usize = 3;
const VY: usize = 4;
const OMEGA: usize = 5;
const STRETCH: usize = 6;
const JX: usize = 7;
const JY: usize = 8;
type State = [f64; 9];

/// A ball at first contact with a surface. Axes: x along the tangent, y along the outward normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CollisionSetup {
    /// The mass, kg.
    pub mass_kg: f64,
    /// The radius, m.
    pub radius_m: f64,
    /// The moment of inertia over m R^2, dimensionless: 0.4 for a solid ball.
    pub inertia_factor: f64,
    /// The law of normal contact.
    pub law: NormalLaw,
    /// The law of tangential contact; `None` for a frictionless surface.
    pub friction: Option<Friction>,
    /// The velocity at first contact (tangential, normal), m/s; the normal one is negative.
    pub velocity_m_s: [f64; 2],
    /// The spin at first contact, counter-clockwise positive, rad/s.
    pub omega_rad_s: f64,
    /// The gravity (tangential, normal), m/s^2.
    pub gravity_m_s2: [f64; 2],
}

/// The reason why there is no collision.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PhysicsError {
    /// The ball moves away from the surface or along it.
    #[error("the ball never touches the flat: its normal velocity is {vn_m_s} m/s, it must be negative")]
    NoApproach {
        /// The normal velocity at first contact.
        vn_m_s: f64,
    },
    /// The ball stays on the surface.
    #[error("the ball does not leave the flat within {limit_s} s: less damping, or a faster ball, is needed")]
    NoRebound {
        /// The maximum contact time.
        limit_s: f64,
    },
}

/// The motion of the ball, relative to first contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// The centre (tangential, normal), m.
    pub position_m: [f64; 2],
    /// The rotation since first contact, counter-clockwise, rad.
    pub angle_rad: f64,
    /// The velocity (tangential, normal), m/s.
    pub velocity_m_s: [f64; 2],
    /// The spin, rad/s.
    pub omega_rad_s: f64,
}

/// The results of a collision; times count from first contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    /// The time when the normal velocity crosses zero.
    pub deepest_s: f64,
    /// The time when the force returns to zero.
    pub end_s: f64,
    /// The time when the contact point first stops; `None` if it never does, or never moved.
    pub slip_end_s: Option<f64>,
    /// The maximum depth of the centre below first contact, m.
    pub compression_max_m: f64,
    /// The maximum normal force, N.
    pub force_max_n: f64,
    /// The maximum normal acceleration, gravity included, m/s^2.
    pub acceleration_max_m_s2: f64,
    /// The times when the force passes 2 % of its peak, rising and falling.
    pub force_times_s: [f64; 2],
    /// The impulse of the contact force (tangential, normal), N s.
    pub impulse_n_s: [f64; 2],
    /// The motion at the end of contact.
    pub after: Motion,
}

/// The state and its derivative at one moment, for interpolation.
#[derive(Debug, Clone, Copy)]
struct Knot {
    time_s: f64,
    state: State,
    rate: State,
}

/// A solved collision: the motion at any time before, during and after contact.
#[derive(Debug, Clone)]
pub struct Collision {
    setup: CollisionSetup,
    knots: Vec<Knot>,
    outcome: Outcome,
}

impl Collision {
    /// Integrates the contact (Runge-Kutta of order 4, 0.05 us steps, the end located within its step).
    ///
    /// # Errors
    ///
    /// Returns [`PhysicsError`] if the ball does not approach, or does not leave.
    pub fn solve(setup: CollisionSetup) -> Result<Self, PhysicsError> {
        if setup.velocity_m_s[1].is_nan() || setup.velocity_m_s[1] >= 0.0 {
            return Err(PhysicsError::NoApproach { vn_m_s: setup.velocity_m_s[1] });
        }
        Integration::new(setup).integrate()
    }

    /// The results of the collision.
    pub fn outcome(&self) -> Outcome {
        self.outcome
    }

    /// Returns the motion of the ball at `time_s` after first contact (negative: before). Free flight outside contact.
    pub fn motion_at(&self, time_s: f64) -> Motion {
        if time_s <= 0.0 {
            return free_flight(&motion_from_state(&self.knots[0].state), self.setup.gravity_m_s2, time_s);
        }
        if time_s >= self.outcome.end_s {
            return free_flight(&self.outcome.after, self.setup.gravity_m_s2, time_s - self.outcome.end_s);
        }
        let right = self.knots.partition_point(|knot| knot.time_s <= time_s).min(self.knots.len() - 1);
        motion_from_state(&interpolate_hermite(&self.knots[right - 1], &self.knots[right], time_s))
    }

    /// Returns the time of a second contact, s after the first; `None` if gravity does not bring the ball back.
    pub fn second_contact_s(&self) -> Option<f64> {
        let [height, speed] = [self.outcome.after.position_m[1], self.outcome.after.velocity_m_s[1]];
        let pull = -self.setup.gravity_m_s2[1];
        let inside = speed * speed + 2.0 * pull * height;
        (pull > 0.0 && inside >= 0.0).then(|| self.outcome.end_s + (speed + inside.sqrt()) / pull)
    }
}

/// An integration in progress.
struct Integration {
    setup: CollisionSetup,
    steps: u64,
    state: State,
    patch_state: PatchState,
    knots: Vec<Knot>,
    deepest: Option<(f64, f64)>,
    slip_end_s: Option<f64>,
    force_max_n: f64,
}

impl Integration {
    fn new(setup: CollisionSetup) -> Self {
        let mut state = [0.0; 9];
        [state[VX], state[VY]] = setup.velocity_m_s;
        state[OMEGA] = setup.omega_rad_s;
        Self {
            setup,
            steps: 0,
            state,
            patch_state: PatchState::Grip,
            knots: Vec::new(),
            deepest: None,
            slip_end_s: None,
            force_max_n: 0.0,
        }
    }

    /// Integrates until the contact ends. Returns [`PhysicsError::NoRebound`] after the maximum contact time.
    fn integrate(mut self) -> Result<Collision, PhysicsError> {
        while self.time_s() < MAX_CONTACT_S {
            self.update_patch_state();
            if self.steps.is_multiple_of(STEPS_PER_KNOT) {
                self.store_knot(self.time_s());
            }
            let next = self.runge_kutta_step(STEP_S);
            if next[Y] >= 0.0 || self.force_n(&next) <= 0.0 {
                return Ok(self.finish());
            }
            self.record_events(&next);
            self.state = next;
            self.steps += 1;
        }
        Err(PhysicsError::NoRebound { limit_s: MAX_CONTACT_S })
    }

    fn time_s(&self) -> f64 {
        self.steps as f64 * STEP_S
    }

    /// Returns the normal force on the ball in a state, N; negative if the surface would have to pull.
    fn force_n(&self, state: &State) -> f64 {
        self.setup.law.force_n(-state[Y], -state[VY])
    }

    /// Returns the velocity of the contact point along the tangent, m/s.
    fn slide_m_s(&self, state: &State) -> f64 {
        state[VX] + state[OMEGA] * self.setup.radius_m
    }

    /// Updates whether the contact patch grips or slides in the current state.
    fn update_patch_state(&mut self) {
        if let Some(friction) = self.setup.friction {
            let (slide, normal) = (self.slide_m_s(&self.state), self.force_n(&self.state).max(0.0));
            self.patch_state = friction.patch_state(self.state[STRETCH], slide, normal);
        }
    }

    /// Records the times within the step to `next` at which the ball reverses and its contact point stops, and the
    /// maximum force.
    fn record_events(&mut self, next: &State) {
        if self.deepest.is_none() && next[VY] >= 0.0 {
            let step_s = self.crossing_time_s(|state| state[VY]);
            self.deepest = Some((self.time_s() + step_s, -self.runge_kutta_step(step_s)[Y]));
        }
        let slide = self.slide_m_s(&self.state);
        if self.slip_end_s.is_none() && slide * self.slide_m_s(next) < 0.0 {
            self.slip_end_s = Some(self.time_s() + self.crossing_time_s(|state| -slide * self.slide_m_s(state)));
        }
        self.force_max_n = self.force_max_n.max(self.force_n(next));
    }

    /// Returns the derivative of a state for a patch that keeps gripping or sliding.
    fn rate(&self, state: &State) -> State {
        let setup = &self.setup;
        let normal_n = self.force_n(state).max(0.0);
        let slide = self.slide_m_s(state);
        let (tangential_n, stretching) = setup.friction.map_or((0.0, 0.0), |friction| {
            friction.force_and_stretch_rate(self.patch_state, state[STRETCH], slide, normal_n)
        });
        let inertia = setup.inertia_factor * setup.mass_kg * setup.radius_m * setup.radius_m;
        let mut rate = [0.0; 9];
        [rate[X], rate[Y], rate[ANGLE]] = [state[VX], state[VY], state[OMEGA]];
        rate[VX] = tangential_n / setup.mass_kg + setup.gravity_m_s2[0];
        rate[VY] = normal_n / setup.mass_kg + setup.gravity_m_s2[1];
        // The force acts at (0, -R): a force to the right rotates the ball counter-clockwise.
        rate[OMEGA] = tangential_n * setup.radius_m / inertia;
        rate[STRETCH] = stretching;
        [rate[JX], rate[JY]] = [tangential_n, normal_n];
        rate
    }

    /// Returns the state after a step, by the classical Runge-Kutta method of fourth order.
    fn runge_kutta_step(&self, step_s: f64) -> State {
        let first = self.rate(&self.state);
        let second = self.rate(&euler_step(&self.state, &first, 0.5 * step_s));
        let third = self.rate(&euler_step(&self.state, &second, 0.5 * step_s));
        let fourth = self.rate(&euler_step(&self.state, &third, step_s));
        std::array::from_fn(|place| {
            let slope = first[place] + 2.0 * (second[place] + third[place]) + fourth[place];
            self.state[place] + step_s / 6.0 * slope
        })
    }

    /// Returns the time within the next step after which `value` is no longer negative, s, by 40 bisections.
    fn crossing_time_s(&self, value: impl Fn(&State) -> f64) -> f64 {
        let (mut low, mut high) = (0.0, STEP_S);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if value(&self.runge_kutta_step(middle)) < 0.0 { low = middle } else { high = middle }
        }
        high
    }

    /// Stores the current state and its derivative as a knot at `time_s`.
    fn store_knot(&mut self, time_s: f64) {
        let rate = self.rate(&self.state);
        self.knots.push(Knot { time_s, state: self.state, rate });
    }

    /// Returns the times at which the force passes 2 % of its peak, rising and falling, s, linear between knots.
    fn force_times_s(&self) -> [f64; 2] {
        let threshold = 0.02 * self.force_max_n;
        let knots: Vec<[f64; 2]> = self.knots.iter().map(|knot| [knot.time_s, self.force_n(&knot.state)]).collect();
        let crossed = |a: &[f64; 2], b: &[f64; 2]| a[0] + (threshold - a[1]) / (b[1] - a[1]) * (b[0] - a[0]);
        let rises = |pair: &&[[f64; 2]]| pair[0][1] < threshold && pair[1][1] >= threshold;
        let falls = |pair: &&[[f64; 2]]| pair[0][1] >= threshold && pair[1][1] < threshold;
        let (first, last) = (knots[0], knots[knots.len() - 1]);
        let rise = knots.windows(2).find(rises).filter(|_| first[1] < threshold);
        let fall = knots.windows(2).rev().find(falls);
        [
            rise.map_or(first[0], |pair| crossed(&pair[0], &pair[1])),
            fall.map_or(last[0], |pair| crossed(&pair[0], &pair[1])),
        ]
    }

    /// Ends the contact within the next step, when the normal force returns to zero, and composes the collision.
    ///
    /// The moment is found by bisection. It is also the end if the ball leaves the surface first.
    fn finish(mut self) -> Collision {
        let step_s = self.crossing_time_s(|state| if state[Y] >= 0.0 { 1.0 } else { -self.force_n(state) });
        let end_s = self.time_s() + step_s;
        self.state = self.runge_kutta_step(step_s);
        self.store_knot(end_s);
        let (deepest_s, compression_max_m) = self.deepest.unwrap_or((end_s, -self.state[Y]));
        let outcome = Outcome {
            deepest_s,
            end_s,
            slip_end_s: self.slip_end_s,
            compression_max_m,
            force_max_n: self.force_max_n,
            acceleration_max_m_s2: self.force_max_n / self.setup.mass_kg + self.setup.gravity_m_s2[1],
            force_times_s: self.force_times_s(),
            impulse_n_s: [self.state[JX], self.state[JY]],
            after: motion_from_state(&self.state),
        };
        Collision { setup: self.setup, knots: self.knots, outcome }
    }
}

/// Returns the state after a step at a constant rate.
fn euler_step(state: &State, rate: &State, step_s: f64) -> State {
    std::array::from_fn(|place| state[place] + step_s * rate[place])
}

fn motion_from_state(state: &State) -> Motion {
    Motion {
        position_m: [state[X], state[Y]],
        angle_rad: state[ANGLE],
        velocity_m_s: [state[VX], state[VY]],
        omega_rad_s: state[OMEGA],
    }
}

/// Returns the motion at `time_s` after `start` under constant gravity.
fn free_flight(start: &Motion, gravity_m_s2: [f64; 2], time_s: f64) -> Motion {
    let axis = |index: usize| {
        let (speed, pull) = (start.velocity_m_s[index], gravity_m_s2[index]);
        (start.position_m[index] + time_s * (speed + 0.5 * pull * time_s), speed + pull * time_s)
    };
    let ((x, vx), (y, vy)) = (axis(0), axis(1));
    Motion {
        position_m: [x, y],
        angle_rad: start.angle_rad + start.omega_rad_s * time_s,
        velocity_m_s: [vx, vy],
        omega_rad_s: start.omega_rad_s,
    }
}

/// Interpolates the state between two knots from values and derivatives (cubic Hermite).
fn interpolate_hermite(left: &Knot, right: &Knot, time_s: f64) -> State {
    let span = right.time_s - left.time_s;
    let part = (time_s - left.time_s) / span;
    let (squared, cubed) = (part * part, part * part * part);
    let to_right = 3.0 * squared - 2.0 * cubed;
    std::array::from_fn(|place| {
        left.state[place] * (1.0 - to_right)
            + right.state[place] * to_right
            + span * (part - 2.0 * squared + cubed) * left.rate[place]
            + span * (cubed - squared) * right.rate[place]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(super) fn ball(law: NormalLaw, mass_kg: f64, vn_m_s: f64) -> CollisionSetup {
        CollisionSetup {
            mass_kg,
            radius_m: 0.031_625,
            inertia_factor: 0.4,
            law,
            friction: None,
            velocity_m_s: [0.0, vn_m_s],
            omega_rad_s: 0.0,
            gravity_m_s2: [0.0, 0.0],
        }
    }

    fn lacrosse() -> CollisionSetup {
        let law = NormalLaw::KelvinVoigt { stiffness_n_m: 6.772e4, damping_n_s_m: 14.87 };
        CollisionSetup {
            friction: Some(Friction { stiffness_n_m: 1e5, damping_n_s_m: 20.0, coefficient: 0.070 }),
            velocity_m_s: [0.57, -1.69],
            ..ball(law, 0.145_66, -1.69)
        }
    }

    fn assert_close(name: &str, value: f64, expected: f64, tolerance: f64) {
        assert!((value / expected - 1.0).abs() < tolerance, "{name}: {value}, expected {expected}");
    }

    #[test]
    fn fitted_laws_give_the_measured_contacts_within_1_percent() {
        let kv = |k, c| NormalLaw::KelvinVoigt { stiffness_n_m: k, damping_n_s_m: c };
        let hc = |k, c| NormalLaw::HuntCrossley { stiffness_n_m15: k, damping_s_m: c };
        // law, mass, speed, then contact ms, restitution, compression mm, force N (0: not tabulated).
        let table = [
            ("rod kv", kv(1.063e6, 166.0), 0.255, -1.084, 1.400, 0.634, 0.423, 473.0),
            ("tennis kv", kv(1.042e4, 3.615), 0.0567, -3.2, 7.00, 0.800, 6.68, 70.0),
            ("lacrosse kv", kv(6.772e4, 14.87), 0.145_66, -1.69, 4.400, 0.799, 2.22, 152.0),
            ("rod hc", hc(7.40e7, 0.783), 0.255, -1.084, 1.396, 0.634, 0.405, 705.0),
            ("tennis hc", hc(1.35e5, 0.113), 0.0567, -3.2, 7.36, 0.805, 7.2, 0.0),
            ("lacrosse hc", hc(1.743e6, 0.2224), 0.145_66, -1.69, 4.400, 0.799, 2.25, 194.0),
        ];
        for (name, law, mass, speed, contact_ms, restitution, compression_mm, force_n) in table {
            let outcome = Collision::solve(ball(law, mass, speed)).unwrap().outcome();
            assert_close(name, outcome.end_s * 1e3, contact_ms, 0.01);
            assert_close(name, -outcome.after.velocity_m_s[1] / speed, restitution, 0.01);
            assert_close(name, outcome.compression_max_m * 1e3, compression_mm, 0.01);
            if force_n > 0.0 {
                assert_close(name, outcome.force_max_n, force_n, 0.01);
            }
        }
    }

    #[test]
    fn an_undamped_spring_gives_half_a_period_and_all_the_speed() {
        let law = NormalLaw::KelvinVoigt { stiffness_n_m: 5e4, damping_n_s_m: 0.0 };
        let outcome = Collision::solve(ball(law, 0.1, -2.0)).unwrap().outcome();
        let half_period_s = std::f64::consts::PI * (0.1f64 / 5e4).sqrt();
        assert!((outcome.end_s - half_period_s).abs() < 1e-11, "{}", outcome.end_s - half_period_s);
        assert!((outcome.deepest_s - 0.5 * half_period_s).abs() < 1e-11);
        assert!((outcome.after.velocity_m_s[1] - 2.0).abs() < 1e-9);
        assert!((outcome.compression_max_m - 2.0 * (0.1f64 / 5e4).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn a_lacrosse_ball_slips_grips_and_slips_back() {
        let collision = Collision::solve(lacrosse()).unwrap();
        let outcome = collision.outcome();
        assert!((outcome.slip_end_s.unwrap() - 2.86e-3).abs() < 0.02e-3, "{:?}", outcome.slip_end_s);
        let spins: Vec<f64> = (0..440).map(|step| collision.motion_at(f64::from(step) * 1e-5).omega_rad_s).collect();
        let fastest = spins.iter().copied().fold(0.0, f64::min);
        assert!((fastest / -15.3 - 1.0).abs() < 0.01, "{fastest}");
        assert!((outcome.after.omega_rad_s / -14.9 - 1.0).abs() < 0.01, "{}", outcome.after.omega_rad_s);
        let slowest =
            (0..440).map(|step| collision.motion_at(f64::from(step) * 1e-5).velocity_m_s[0]).fold(1.0, f64::min);
        assert!((slowest / 0.376 - 1.0).abs() < 0.01, "{slowest}");
        assert!((outcome.after.velocity_m_s[0] / 0.381 - 1.0).abs() < 0.01, "{}", outcome.after.velocity_m_s[0]);
    }

    /// Returns the mechanical energy: kinetic, elastic and in gravity, J.
    fn energy_j(setup: &CollisionSetup, state: &State) -> f64 {
        let inertia = setup.inertia_factor * setup.mass_kg * setup.radius_m * setup.radius_m;
        let moving = setup.mass_kg * (state[VX] * state[VX] + state[VY] * state[VY]);
        let turning = inertia * state[OMEGA] * state[OMEGA];
        let falling = -setup.mass_kg * (setup.gravity_m_s2[0] * state[X] + setup.gravity_m_s2[1] * state[Y]);
        let patch = setup.friction.map_or(0.0, |friction| friction.stiffness_n_m * state[STRETCH] * state[STRETCH]);
        let elastic = match setup.law {
            NormalLaw::KelvinVoigt { stiffness_n_m, .. } => 0.5 * stiffness_n_m * state[Y] * state[Y],
            NormalLaw::HuntCrossley { stiffness_n_m15, .. } => 0.4 * stiffness_n_m15 * (-state[Y]).max(0.0).powf(2.5),
        };
        0.5 * (moving + turning + patch) + falling + elastic
    }

    #[test]
    fn energy_never_grows() {
        let tilted = CollisionSetup { gravity_m_s2: [3.19, -9.28], ..lacrosse() };
        let spinning = CollisionSetup { omega_rad_s: -60.0, ..tilted };
        let hunt = NormalLaw::HuntCrossley { stiffness_n_m15: 1.743e6, damping_s_m: 0.2224 };
        for setup in [lacrosse(), tilted, spinning, CollisionSetup { law: hunt, ..tilted }] {
            let collision = Collision::solve(setup).unwrap();
            let energies: Vec<f64> = collision.knots.iter().map(|knot| energy_j(&setup, &knot.state)).collect();
            assert!(energies.len() > 4000);
            for pair in energies.windows(2) {
                assert!(pair[1] <= pair[0] * (1.0 + 1e-12), "{} -> {}", pair[0], pair[1]);
            }
        }
    }

    #[test]
    fn velocity_is_the_derivative_of_position_all_the_way() {
        let collision = Collision::solve(CollisionSetup { gravity_m_s2: [3.19, -9.28], ..lacrosse() }).unwrap();
        for step in -100..600 {
            let time_s = f64::from(step) * 1e-5 + 3.3e-6;
            let (before, here, after) =
                (collision.motion_at(time_s - 1e-7), collision.motion_at(time_s), collision.motion_at(time_s + 1e-7));
            for axis in 0..2 {
                let slope = (after.position_m[axis] - before.position_m[axis]) / 2e-7;
                assert!((slope - here.velocity_m_s[axis]).abs() < 2e-5, "{time_s}: {slope} {here:?}");
            }
            let turning = (after.angle_rad - before.angle_rad) / 2e-7;
            assert!((turning - here.omega_rad_s).abs() < 1e-3, "{time_s}: {turning}");
        }
    }

    #[test]
    fn a_ball_that_leaves_or_sticks_is_refused() {
        let kv = |damping| NormalLaw::KelvinVoigt { stiffness_n_m: 6.772e4, damping_n_s_m: damping };
        let leaving = Collision::solve(ball(kv(14.87), 0.145_66, 0.2));
        assert_eq!(leaving.unwrap_err(), PhysicsError::NoApproach { vn_m_s: 0.2 });
        let resting = CollisionSetup { gravity_m_s2: [0.0, -9.81], ..ball(kv(1e3), 0.145_66, -0.01) };
        assert!(matches!(Collision::solve(resting), Err(PhysicsError::NoRebound { .. })));
    }
}
