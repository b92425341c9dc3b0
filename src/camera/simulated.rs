//! A camera that films a simulated world.

use super::delivery::Delivery;
use super::{Camera, CameraError, CameraIdentity, Next, Pace, Slot, StreamFormat};
use crate::config::Pulse;
use crate::image::FrameMeta;
use crate::results::{Impact, VelocitySample};
use crate::synth::{Scenario, ScenarioError, World};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// A film drawn in advance may take this much memory.
const FILM_MAX_BYTES: u64 = 1 << 30;
/// Slots a paced camera asks for, so that a late taker does not lose frames at once.
const PACED_SLOTS: usize = 64;
/// Drawing may take this share of the time between two frames, or the film is drawn in advance.
const DRAWING_SHARE: f64 = 0.5;

/// The built-in scenario of this name, or the one in the file of this path.
///
/// # Errors
///
/// When there is neither, or the file is not a valid scenario.
pub fn load_scenario(name: &str) -> Result<Scenario, ScenarioError> {
    if let Some(scenario) = Scenario::built_in(name) {
        return Ok(scenario);
    }
    let text = std::fs::read_to_string(name).map_err(|error| ScenarioError::Unreadable {
        name: name.to_owned(),
        known: format!("{}, pattern-a-I to pattern-f-II", Scenario::BUILT_IN.join(", ")),
        reason: error.to_string(),
    })?;
    Scenario::from_toml(&text)
}

/// Shape and rate of a world's frames.
pub fn stream_format(world: &World) -> StreamFormat {
    StreamFormat {
        width_px: world.width_px(),
        height_px: world.height_px(),
        format: world.format(),
        frame_rate_hz: world.frame_rate_hz(),
        exposure_us: world.scenario().camera.exposure_us,
    }
}

/// What is known of a world's frame besides its pixels.
pub fn meta(world: &World, index: u64) -> FrameMeta {
    let bytes_per_pixel = world.format().bytes_per_pixel();
    FrameMeta {
        sequence: index,
        epoch: 0,
        stamp_ns: world.stamp_ns(index),
        device_ns: world.stamp_ns(index) - world.stamp_ns(0),
        width_px: world.width_px(),
        height_px: world.height_px(),
        stride_bytes: world.width_px() * u32::try_from(bytes_per_pixel).unwrap_or(1),
        format: world.format(),
    }
}

/// A simulated camera; its frames are a pure function of the scenario.
///
/// On demand it draws as fast as frames are taken and loses none. Paced, frames
/// come at the scenario's rate by the wall clock, and one that finds no slot when
/// its exposure starts is lost: its sequence number is skipped. Stamps come from
/// the scenario in both cases, never from a clock.
#[derive(Debug)]
pub struct SimulatedCamera {
    world: World,
    pace: Pace,
    /// The line it waits for.
    pulse: Option<Pulse>,
    /// All frames, when drawing is too slow for the pace.
    film: Option<Vec<u8>>,
    started: Option<Instant>,
    /// When frames were there, at a pace of its own.
    delivery: Delivery,
    /// How much of the film had passed by when it was started.
    passed: Duration,
    /// Each slot with the first frame that it can take.
    slots: VecDeque<(Slot, u64)>,
    index: u64,
}

impl SimulatedCamera {
    /// Prepares the scenario; `paced` by the wall clock or on demand.
    ///
    /// # Errors
    ///
    /// [`CameraError::Setting`] when the scenario cannot be filmed, or can be drawn
    /// neither at its rate nor in advance.
    pub fn open(scenario: Scenario, paced: bool) -> Result<Self, CameraError> {
        let world = World::new(&scenario).map_err(|error| CameraError::Setting {
            feature: "scenario".to_owned(),
            value: scenario.name.clone(),
            reason: error.to_string(),
        })?;
        Self::film(world, paced)
    }

    /// Films this world; `paced` by the wall clock or on demand.
    ///
    /// # Errors
    ///
    /// [`CameraError::Setting`] when it can be drawn neither at its rate nor in advance.
    pub fn film(world: World, paced: bool) -> Result<Self, CameraError> {
        let film = if paced { film_if_slow(&world)? } else { None };
        let pace = if paced { Pace::Live } else { Pace::OnDemand };
        Ok(Self {
            world,
            pace,
            pulse: None,
            film,
            started: None,
            delivery: Delivery::default(),
            passed: Duration::ZERO,
            slots: VecDeque::new(),
            index: 0,
        })
    }

    /// The same, with frames only when the imitated line has a pulse.
    ///
    /// # Errors
    ///
    /// [`CameraError::Setting`] when a pulse comes before the frames of the one before are over.
    pub fn pulsed(self, pulse: Option<Pulse>) -> Result<Self, CameraError> {
        if let Some(Pulse { period_s, burst_frames: frames }) = pulse {
            let least_s = f64::from(frames) / self.world.frame_rate_hz();
            if period_s < least_s {
                let (feature, value) = ("camera.pulse_period_s".to_owned(), period_s.to_string());
                let reason = format!("at least {least_s} s, as long as {frames} frames last");
                return Err(CameraError::Setting { feature, value, reason });
            }
        }
        Ok(Self { pulse, ..self })
    }

    /// When the exposure of a frame begins, s after the start, and how much of that the line was silent.
    fn begins_s(&self, index: u64) -> (f64, f64) {
        let period_s = 1.0 / self.world.frame_rate_hz();
        let film_s = index as f64 * period_s;
        let silent_s = self.pulse.map_or(0.0, |pulse| {
            let (pulses, frames) = (index / u64::from(pulse.burst_frames), f64::from(pulse.burst_frames));
            pulses as f64 * (pulse.period_s - frames * period_s)
        });
        (film_s + silent_s, silent_s)
    }

    /// The world it films.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The true numbers of the collision, if there is one.
    pub fn impact(&self) -> Option<Impact> {
        self.world.impact()
    }

    /// Time since the start; frame `n` is exposed at `n` periods.
    #[expect(clippy::disallowed_methods, reason = "the pace of a simulated camera is the wall clock's")]
    fn elapsed(&self) -> Duration {
        self.started.map_or(Duration::ZERO, |started| self.passed + Instant::now().duration_since(started))
    }

    /// The first frame whose exposure has not begun.
    fn first_to_come(&self) -> u64 {
        match (self.pace, self.started) {
            (Pace::Live, Some(_)) => {
                let (elapsed_s, rate_hz) = (self.elapsed().as_secs_f64(), self.world.frame_rate_hz());
                let Some(pulse) = self.pulse else { return (elapsed_s * rate_hz).ceil() as u64 };
                let pulses = (elapsed_s / pulse.period_s).floor();
                let since = ((elapsed_s - pulses * pulse.period_s) * rate_hz).ceil() as u64;
                pulses as u64 * u64::from(pulse.burst_frames) + since.min(u64::from(pulse.burst_frames))
            }
            _ => 0,
        }
    }

    /// When a frame has been read out, after the start.
    fn due(&self, index: u64) -> Duration {
        let camera = &self.world.scenario().camera;
        let rows_s = 1e-6 * camera.row_time_us.abs() * f64::from(camera.height_px - 1);
        Duration::from_secs_f64(self.begins_s(index).0 + 1e-6 * camera.exposure_us + rows_s)
    }

    /// Waits for a frame; whether it came within `timeout`.
    fn wait(&self, index: u64, timeout: Duration) -> bool {
        if self.pace == Pace::OnDemand {
            return true;
        }
        let missing = self.due(index).saturating_sub(self.elapsed());
        std::thread::sleep(missing.min(timeout));
        missing <= timeout
    }

    /// A frame was brought into its slot since `begun`.
    fn delivered(&mut self, index: u64, begun: Duration) {
        if let Some(started) = self.started.filter(|_| self.pace == Pace::Live) {
            let took = self.elapsed().saturating_sub(begun);
            self.delivery.add(started + self.due(index), took);
        }
    }

    fn fill(&self, index: u64, slot: &mut Slot) {
        let bytes = self.world.frame_bytes();
        let target = &mut slot.bytes_mut()[..bytes];
        match &self.film {
            Some(film) => target.copy_from_slice(&film[index as usize * bytes..(index as usize + 1) * bytes]),
            None => self.world.render(index, target),
        }
    }
}

impl Camera for SimulatedCamera {
    fn format(&self) -> StreamFormat {
        stream_format(&self.world)
    }

    fn identity(&self) -> CameraIdentity {
        CameraIdentity { model: "ricochet simulated".to_owned(), serial: self.world.scenario().name.clone() }
    }

    fn pace(&self) -> Pace {
        self.pace
    }

    fn slots(&self) -> usize {
        match self.pace {
            Pace::OnDemand => 1,
            Pace::Live => PACED_SLOTS,
        }
    }

    fn queue(&mut self, slot: Slot) {
        let first = self.first_to_come();
        self.slots.push_back((slot, first));
    }

    #[expect(clippy::disallowed_methods, reason = "the pace of a simulated camera is the wall clock's")]
    fn start(&mut self) -> Result<(), CameraError> {
        self.started = Some(Instant::now());
        Ok(())
    }

    /// # Panics
    ///
    /// If the slot is smaller than a frame.
    fn next(&mut self, timeout: Duration) -> Result<Next, CameraError> {
        if self.index >= self.world.frames() {
            return Ok(Next::End);
        }
        let Some((_, first)) = self.slots.front() else { return Ok(Next::Nothing) };
        let index = self.index.max(*first);
        if index >= self.world.frames() {
            self.index = index;
            return Ok(Next::End);
        }
        if self.started.is_none() || !self.wait(index, timeout) {
            return Ok(Next::Nothing);
        }
        let Some((mut slot, _)) = self.slots.pop_front() else { return Ok(Next::Nothing) };
        let begun = self.elapsed();
        self.fill(index, &mut slot);
        self.delivered(index, begun);
        self.index = index + 1;
        let mut meta = meta(&self.world, index);
        let silent_ns = (self.begins_s(index).1 * 1e9).round() as u64;
        (meta.stamp_ns, meta.device_ns) = (meta.stamp_ns + silent_ns, meta.device_ns + silent_ns);
        Ok(Next::Frame(slot, meta))
    }

    fn go_to(&mut self, sequence: u64) -> bool {
        self.index = sequence;
        self.passed = Duration::from_secs_f64(self.begins_s(sequence).0);
        true
    }

    fn waited(&self) -> Duration {
        self.started.map_or(Duration::ZERO, |started| self.delivery.waited(started + self.elapsed()))
    }

    fn truth(&self, sequence: u64) -> Vec<VelocitySample> {
        if sequence < self.world.frames() { self.world.truths(sequence) } else { Vec::new() }
    }
}

/// Draws the whole film if drawing cannot keep up with its rate.
fn film_if_slow(world: &World) -> Result<Option<Vec<u8>>, CameraError> {
    let bytes = world.frame_bytes();
    let mut frame = vec![0; bytes];
    let drawing_s = (0..3).map(|_| seconds(|| world.render(0, &mut frame))).fold(f64::INFINITY, f64::min);
    if drawing_s * world.frame_rate_hz() < DRAWING_SHARE {
        return Ok(None);
    }
    let film_bytes = bytes as u64 * world.frames();
    if film_bytes > FILM_MAX_BYTES {
        return Err(CameraError::Setting {
            feature: "camera.frame_rate_hz".to_owned(),
            value: world.frame_rate_hz().to_string(),
            reason: format!(
                "a frame takes {:.2} ms to draw, and {} frames of {bytes} bytes are more than the {FILM_MAX_BYTES} \
                 bytes that may be drawn in advance: lower the rate or the number of frames, or film on demand",
                drawing_s * 1e3,
                world.frames(),
            ),
        });
    }
    let mut film = vec![0; film_bytes as usize];
    for (index, frame) in film.chunks_exact_mut(bytes).enumerate() {
        world.render(index as u64, frame);
    }
    Ok(Some(film))
}

#[expect(clippy::disallowed_methods, reason = "measures how long this machine takes to draw")]
fn seconds(work: impl FnOnce()) -> f64 {
    let started = Instant::now();
    work();
    started.elapsed().as_secs_f64()
}
