//! The state of the rig as a whole.

use crate::results::{Phase, VelocitySample, named_enum};

/// The speed towards the surface from which a body counts as falling, sigmas.
const FALL_START_SIGMAS: f64 = 5.0;
/// The speed below which a falling body no longer counts as falling, sigmas.
const FALL_END_SIGMAS: f64 = 2.5;

named_enum! {
    /// The state of a rig; its name is the text of `state` events.
    RigState: "state" {
        /// No stream, or one that nothing waits for.
        Idle = 0 "idle",
        /// The camera is about to start.
        Preparing = 1 "preparing",
        /// Frames come and a trigger is waited for.
        Armed = 2 "armed",
        /// A body moves towards the surface.
        Falling = 3 "falling",
        /// A body touches the surface.
        Impact = 4 "impact",
        /// A recording is being made.
        Writing = 5 "writing",
        /// A recording was completed, or the stream has ended.
        Done = 6 "done",
    }
}

/// The state of a body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum BodyState {
    Idle,
    Falling,
    Touching,
}

/// Combines the events of the processes of a rig and the motion of its bodies into one state.
///
/// Bodies take precedence over the recorder: while a ball is in the air the state is `falling`, although its frames are
/// being written.
#[derive(Debug, Clone)]
pub struct States {
    prepared: bool,
    started: bool,
    ended: bool,
    armed: bool,
    writing: bool,
    recorded: bool,
    bodies: Vec<BodyState>,
    reported: RigState,
}

/// The recorder before the stream of a rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Recorder {
    /// It records nothing.
    Off,
    /// It waits for a trigger.
    Armed,
    /// It records the whole stream.
    Writing,
}

impl States {
    /// Creates the state of a rig with this number of bodies, before its stream.
    pub fn new(bodies: usize, recorder: Recorder) -> Self {
        Self {
            prepared: false,
            started: false,
            ended: false,
            armed: recorder == Recorder::Armed,
            writing: recorder == Recorder::Writing,
            recorded: false,
            bodies: vec![BodyState::Idle; bodies],
            reported: RigState::Idle,
        }
    }

    /// Returns the state that was reported last.
    pub fn state(&self) -> RigState {
        self.reported
    }

    /// Records that a camera was opened and has not delivered a frame yet. Earlier recordings and motions no longer
    /// count.
    pub fn note_prepared(&mut self) {
        (self.prepared, self.started, self.ended, self.recorded) = (true, false, false, false);
        self.bodies.fill(BodyState::Idle);
    }

    /// Records the first frame.
    pub fn note_started(&mut self) {
        self.started = true;
    }

    /// Records the end of the stream, after which no body is visible.
    pub fn note_ended(&mut self) {
        self.ended = true;
        self.bodies.fill(BodyState::Idle);
    }

    /// Records that the recorder waits for a trigger. A recording completed before no longer counts.
    pub fn note_armed(&mut self) {
        (self.armed, self.recorded) = (true, false);
    }

    /// Records that the recorder waits for no trigger. A recording completed before no longer counts.
    pub fn note_disarmed(&mut self) {
        (self.armed, self.recorded) = (false, false);
    }

    /// Records the start of a shot.
    pub fn note_triggered(&mut self) {
        self.writing = true;
    }

    /// Records that a camera with a hardware trigger is silent, so no body is visible.
    pub fn note_silence(&mut self) {
        self.bodies.fill(BodyState::Idle);
    }

    /// Records that a shot is complete or was given up.
    pub fn note_recorded(&mut self) {
        (self.writing, self.recorded) = (false, true);
    }

    /// Updates the state of a body by its velocity in the next frame. A row of an unknown body is ignored.
    ///
    /// A body in contact touches. Otherwise it begins to fall at a speed towards the surface of 5 standard
    /// uncertainties, and falls until the speed is below 2.5.
    pub fn add_velocity(&mut self, row: &VelocitySample) {
        let was_falling = self.bodies.get(row.body as usize) == Some(&BodyState::Falling);
        let sigmas = if was_falling { FALL_END_SIGMAS } else { FALL_START_SIGMAS };
        let is_falling = row.velocity.is_some_and(|velocity| velocity.vn_m_s < -sigmas * velocity.sigma_v_m_s);
        if let Some(state) = self.bodies.get_mut(row.body as usize) {
            *state = match row.phase {
                Phase::Contact => BodyState::Touching,
                Phase::Flight | Phase::Rebound | Phase::Unknown if is_falling => BodyState::Falling,
                _ => BodyState::Idle,
            };
        }
    }

    /// Returns the present state if it differs from the one reported last, and counts it as reported.
    pub fn take_change(&mut self) -> Option<RigState> {
        let present = self.present_state();
        (std::mem::replace(&mut self.reported, present) != present).then_some(present)
    }

    /// Combines all notes into the present state. Without a stream it is idle or preparing; then contact, fall and
    /// recording take precedence in this order.
    fn present_state(&self) -> RigState {
        let any = |state| self.bodies.contains(&state);
        match () {
            () if !self.prepared => RigState::Idle,
            () if !self.started && !self.ended => RigState::Preparing,
            () if any(BodyState::Touching) => RigState::Impact,
            () if any(BodyState::Falling) => RigState::Falling,
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
            omega_rad_s: Some(0.0),
            sigma_v_m_s: 0.01,
            sigma_omega_rad_s: Some(0.0),
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
            motion: None,
            velocity: Some(velocity),
            visible_fraction: None,
            phase,
            rotation_status: PointStatus::Valid,
            status: PointStatus::Valid,
        }
    }

    #[test]
    fn a_shot_goes_from_idle_through_fall_and_impact_to_done_and_back_to_armed() {
        let mut states = States::new(1, Recorder::Armed);
        let mut reported = vec![states.state()];
        let mut step = |act: &dyn Fn(&mut States)| {
            act(&mut states);
            reported.extend(states.take_change());
        };
        step(&|states| states.note_prepared());
        step(&|states| states.note_started());
        step(&|states| states.add_velocity(&row(0.0, Phase::Flight)));
        step(&|states| states.add_velocity(&row(-1.7, Phase::Flight)));
        step(&|states| states.note_triggered());
        step(&|states| states.add_velocity(&row(-1.2, Phase::Contact)));
        step(&|states| states.add_velocity(&row(1.1, Phase::Rebound)));
        step(&|states| states.note_recorded());
        step(&|states| states.note_armed());
        step(&|states| states.note_ended());
        let names: Vec<&str> = reported.iter().map(|state| state.as_str()).collect();
        assert_eq!(names, ["idle", "preparing", "armed", "falling", "impact", "writing", "done", "armed", "done"]);
    }

    #[test]
    fn a_slow_body_does_not_fall_and_a_stream_without_a_trigger_is_written_throughout() {
        let mut states = States::new(1, Recorder::Writing);
        states.note_prepared();
        states.note_started();
        assert_eq!(states.take_change(), Some(RigState::Writing));
        states.add_velocity(&row(-0.04, Phase::Unknown));
        assert_eq!(states.take_change(), None, "four sigmas are no fall");
        states.add_velocity(&row(-0.06, Phase::Unknown));
        assert_eq!(states.take_change(), Some(RigState::Falling));
    }

    #[test]
    fn a_disarmed_rig_is_idle_while_frames_come() {
        let mut states = States::new(1, Recorder::Armed);
        states.note_prepared();
        states.note_started();
        assert_eq!(states.take_change(), Some(RigState::Armed));
        states.note_disarmed();
        assert_eq!(states.take_change(), Some(RigState::Idle));
    }
}
