//! What the rig as a whole is doing.

use crate::results::{Phase, VelocitySample};

/// A body falls when its speed towards the surface exceeds so many of its sigmas.
const FALL_SIGMAS: f64 = 5.0;
/// One that falls does so until its speed is below so many.
const STILL_FALLS_SIGMAS: f64 = 2.5;

/// What a rig is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum RigState {
    /// No stream, or one that nothing waits for.
    Idle,
    /// The camera is about to start.
    Preparing,
    /// Frames come and a trigger is waited for.
    Armed,
    /// A body moves towards the surface.
    Falling,
    /// A body touches the surface.
    Impact,
    /// A recording is being made.
    Writing,
    /// A recording was completed, or the stream has ended.
    Done,
}

impl RigState {
    /// The word used on `events`.
    pub fn word(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Preparing => "preparing",
            Self::Armed => "armed",
            Self::Falling => "falling",
            Self::Impact => "impact",
            Self::Writing => "writing",
            Self::Done => "done",
        }
    }
}

/// What a body is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Doing {
    Nothing,
    Falling,
    Touching,
}

/// Puts together what the processes of a rig tell into one state.
///
/// What a body does goes before what the recorder does: a shot whose ball is in
/// the air is `falling` although its frames are being written.
#[derive(Debug, Clone)]
pub struct States {
    prepared: bool,
    started: bool,
    ended: bool,
    armed: bool,
    writing: bool,
    recorded: bool,
    bodies: Vec<Doing>,
    told: RigState,
}

impl States {
    /// A rig of so many bodies that has not begun. It is `armed` when it waits for a trigger from the start, and
    /// `writing` when its whole stream is kept.
    pub fn new(bodies: usize, armed: bool, writing: bool) -> Self {
        Self {
            prepared: false,
            started: false,
            ended: false,
            armed,
            writing,
            recorded: false,
            bodies: vec![Doing::Nothing; bodies],
            told: RigState::Idle,
        }
    }

    /// The state told last.
    pub fn state(&self) -> RigState {
        self.told
    }

    /// A camera was opened; its first frame is yet to come.
    pub fn prepared(&mut self) {
        (self.prepared, self.started, self.ended, self.recorded) = (true, false, false, false);
        self.bodies.fill(Doing::Nothing);
    }

    /// The first frame has come.
    pub fn started(&mut self) {
        self.started = true;
    }

    /// The last frame has come.
    pub fn ended(&mut self) {
        self.ended = true;
        self.bodies.fill(Doing::Nothing);
    }

    /// The recorder waits for a trigger, or no longer does.
    pub fn armed(&mut self, armed: bool) {
        self.armed = armed;
        self.recorded = false;
    }

    /// A shot has begun.
    pub fn triggered(&mut self) {
        self.writing = true;
    }

    /// A camera that waits for its line is silent: nothing is seen of the bodies.
    pub fn silent(&mut self) {
        self.bodies.fill(Doing::Nothing);
    }

    /// A shot is complete, or had to be given up.
    pub fn recorded(&mut self) {
        (self.writing, self.recorded) = (false, true);
    }

    /// What was measured of a body in a frame.
    pub fn measured(&mut self, row: &VelocitySample) {
        let fell = self.bodies.get(row.body as usize) == Some(&Doing::Falling);
        let sigmas = if fell { STILL_FALLS_SIGMAS } else { FALL_SIGMAS };
        let falls = row.velocity.is_some_and(|velocity| velocity.vn_m_s < -sigmas * velocity.sigma_v_m_s);
        if let Some(doing) = self.bodies.get_mut(row.body as usize) {
            *doing = match row.phase {
                Phase::Contact => Doing::Touching,
                Phase::Flight | Phase::Rebound | Phase::Unknown if falls => Doing::Falling,
                _ => Doing::Nothing,
            };
        }
    }

    /// The state now, if it is another than the one told last; it then counts as told.
    pub fn changed(&mut self) -> Option<RigState> {
        let now = self.now();
        (std::mem::replace(&mut self.told, now) != now).then_some(now)
    }

    fn now(&self) -> RigState {
        let any = |doing| self.bodies.contains(&doing);
        match () {
            () if !self.prepared => RigState::Idle,
            () if !self.started && !self.ended => RigState::Preparing,
            () if any(Doing::Touching) => RigState::Impact,
            () if any(Doing::Falling) => RigState::Falling,
            () if self.writing => RigState::Writing,
            () if self.recorded || self.ended => RigState::Done,
            () if self.armed => RigState::Armed,
            () => RigState::Idle,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::{BodyVelocity, PointStatus};

    fn row(vn_m_s: f64, phase: Phase) -> VelocitySample {
        let velocity = BodyVelocity {
            vx_m_s: 0.0,
            vy_m_s: vn_m_s,
            vn_m_s,
            vt_m_s: 0.0,
            omega_rad_s: 0.0,
            sigma_v_m_s: 0.01,
            sigma_omega_rad_s: 0.0,
            window_frames: 9,
            order: 2,
        };
        VelocitySample {
            frame: 0,
            body: 0,
            stamp_ns: 0,
            center_x_px: None,
            center_y_px: None,
            radius_px: None,
            step: None,
            velocity: Some(velocity),
            visible_fraction: None,
            phase,
            status: PointStatus::Valid,
        }
    }

    #[test]
    fn a_shot_goes_from_idle_through_fall_and_impact_to_done_and_back_to_armed() {
        let mut states = States::new(1, true, false);
        let mut told = vec![states.state()];
        let mut step = |act: &dyn Fn(&mut States)| {
            act(&mut states);
            told.extend(states.changed());
        };
        step(&|states| states.prepared());
        step(&|states| states.started());
        step(&|states| states.measured(&row(0.0, Phase::Flight)));
        step(&|states| states.measured(&row(-1.7, Phase::Flight)));
        step(&|states| states.triggered());
        step(&|states| states.measured(&row(-1.2, Phase::Contact)));
        step(&|states| states.measured(&row(1.1, Phase::Rebound)));
        step(&|states| states.recorded());
        step(&|states| states.armed(true));
        step(&|states| states.ended());
        let words: Vec<&str> = told.iter().map(|state| state.word()).collect();
        assert_eq!(words, ["idle", "preparing", "armed", "falling", "impact", "writing", "done", "armed", "done"]);
    }

    #[test]
    fn a_slow_body_does_not_fall_and_a_stream_without_a_trigger_is_written_throughout() {
        let mut states = States::new(1, false, true);
        states.prepared();
        states.started();
        assert_eq!(states.changed(), Some(RigState::Writing));
        states.measured(&row(-0.04, Phase::Unknown));
        assert_eq!(states.changed(), None, "four sigmas are no fall");
        states.measured(&row(-0.06, Phase::Unknown));
        assert_eq!(states.changed(), Some(RigState::Falling));
    }

    #[test]
    fn a_disarmed_rig_is_idle_while_frames_come() {
        let mut states = States::new(1, true, false);
        states.prepared();
        states.started();
        assert_eq!(states.changed(), Some(RigState::Armed));
        states.armed(false);
        assert_eq!(states.changed(), Some(RigState::Idle));
    }
}
