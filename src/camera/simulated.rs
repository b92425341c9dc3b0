//! A simulated camera.

use super::delivery_latency::DeliveryLatency;
use super::{Camera, CameraError, CameraIdentity, Next, Pace, Slot, StreamFormat};
use crate::config::Pulse;
use crate::image::FrameMeta;
use crate::results::{FrameCoding, Impact, VelocitySample};
use crate::synth::{Scenario, ScenarioError, SimulatedFilm};
use std::collections::VecDeque;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Maximum memory of a film that is rendered in advance.
const MAX_FILM_BYTES: u64 = 1 << 30;
/// Slots of a camera that runs in real time, so that a late consumer does not lose frames at once.
const PACED_SLOTS: usize = 64;
/// Maximum share of the frame period that rendering may take; a slower film is rendered in advance.
const MAX_RENDER_SHARE: f64 = 0.5;

/// Loads the built-in scenario of this name, or the scenario file at this path.
///
/// # Errors
///
/// If there is neither, or the file is not a valid scenario.
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

/// Returns the stream format of a simulated film.
pub fn stream_format(world: &SimulatedFilm) -> StreamFormat {
    StreamFormat {
        width_px: world.width_px(),
        height_px: world.height_px(),
        format: world.format(),
        frame_rate_hz: world.frame_rate_hz(),
        exposure_us: world.scenario().camera.exposure_us,
        coding: FrameCoding::default(),
    }
}

/// Returns the metadata of the frame with this index, from 0, in a simulated film without pauses.
///
/// The device clock is 0 ns at the first frame.
pub fn meta(world: &SimulatedFilm, index: u64) -> FrameMeta {
    let stamp_ns = world.stamp_ns(index);
    stream_format(world).frame_meta(index, stamp_ns, stamp_ns - world.stamp_ns(0))
}

/// A simulated camera. Its frames are a pure function of the scenario.
///
/// On demand it renders as fast as frames are taken and loses none. In real time, frames come at the scenario's rate,
/// and a frame that finds no slot when its exposure starts is lost: its sequence number is skipped. Stamps come from
/// the scenario in both cases, never from a clock. An endless camera, by contrast, plays a film of the present.
#[derive(Debug)]
pub struct SimulatedCamera {
    world: SimulatedFilm,
    pace: Pace,
    passes: Passes,
    /// The pulses of the simulated hardware trigger line.
    pulse: Option<Pulse>,
    /// All frames, if they are rendered in advance.
    film: Option<Vec<u8>>,
    started: Option<Instant>,
    /// The delivery times, in real time.
    delivery: DeliveryLatency,
    /// The time in the film at which playing starts, after frames were skipped.
    passed: Duration,
    /// Each slot with the first frame that it can take.
    slots: VecDeque<(Slot, u64)>,
    /// The next frame.
    index: u64,
}

impl SimulatedCamera {
    /// Prepares a scenario, to be played at this pace.
    ///
    /// # Errors
    ///
    /// [`CameraError::Setting`] if the scenario cannot be simulated, or can be rendered neither at its rate nor in
    /// advance.
    pub fn open(scenario: Scenario, pace: Pace) -> Result<Self, CameraError> {
        let world = SimulatedFilm::new(&scenario).map_err(|error| CameraError::Setting {
            feature: "scenario".to_owned(),
            value: scenario.name.clone(),
            reason: error.to_string(),
        })?;
        Self::film(world, pace)
    }

    /// Prepares a film that is already simulated, to be played at this pace.
    ///
    /// # Errors
    ///
    /// [`CameraError::Setting`] if it can be rendered neither at its rate nor in advance.
    pub fn film(world: SimulatedFilm, pace: Pace) -> Result<Self, CameraError> {
        let film = if pace == Pace::Live { render_if_slow(&world)? } else { None };
        Ok(Self::new(world, pace, film))
    }

    /// Renders a film in advance, to be played in real time, forwards and backwards in turn and without an end.
    ///
    /// The stamps are those of the host's clock. Nothing jumps if the bodies rest in the first and in the last frame,
    /// which are each shown twice.
    ///
    /// # Errors
    ///
    /// [`CameraError::Setting`] if the film needs more than 1 GiB.
    pub fn endless(world: SimulatedFilm) -> Result<Self, CameraError> {
        let film = render_in_advance(&world).ok_or_else(|| CameraError::Setting {
            feature: "camera.endless".to_owned(),
            value: "true".to_owned(),
            reason: format!(
                "{} frames of {} bytes exceed the {MAX_FILM_BYTES} bytes that may be rendered in advance: give the \
                 scenario fewer frames",
                world.frames(),
                world.frame_bytes(),
            ),
        })?;
        Ok(Self { passes: Passes::Endless { start_ns: 0 }, ..Self::new(world, Pace::Live, Some(film)) })
    }

    /// Returns a camera that has not started, with the frames that were rendered in advance.
    fn new(world: SimulatedFilm, pace: Pace, film: Option<Vec<u8>>) -> Self {
        Self {
            world,
            pace,
            passes: Passes::One,
            pulse: None,
            film,
            started: None,
            delivery: DeliveryLatency::default(),
            passed: Duration::ZERO,
            slots: VecDeque::new(),
            index: 0,
        }
    }

    /// Returns the number of frames until the end; practically unlimited for an endless camera.
    fn frames(&self) -> u64 {
        match self.passes {
            Passes::One => self.world.frames(),
            Passes::Endless { .. } => u64::MAX,
        }
    }

    /// Returns the metadata of the frame with this index.
    fn meta(&self, index: u64) -> FrameMeta {
        match self.passes {
            Passes::One => {
                let film = meta(&self.world, index);
                let silent_ns = (self.exposure_start(index).silent_s * 1e9).round() as u64;
                let (stamp_ns, device_ns) = (film.stamp_ns + silent_ns, film.device_ns + silent_ns);
                FrameMeta { stamp_ns, device_ns, ..film }
            }
            Passes::Endless { start_ns } => {
                let device_ns = (1e9 * self.exposure_start(index).since_start_s).round() as u64;
                stream_format(&self.world).frame_meta(index, start_ns + device_ns, device_ns)
            }
        }
    }

    /// Exposes the frames in bursts, one at each pulse of a simulated trigger line; `None` for one film without pauses.
    ///
    /// No frame of the film is left out: the pauses move the later ones.
    ///
    /// # Errors
    ///
    /// [`CameraError::Setting`] if a pulse comes before the previous burst is over.
    pub fn pulsed(self, pulse: Option<Pulse>) -> Result<Self, CameraError> {
        if let Some(Pulse { period_s, burst_frames: frames }) = pulse {
            let min_s = f64::from(frames) / self.world.frame_rate_hz();
            if period_s < min_s {
                let (feature, value) = ("camera.pulse_period_s".to_owned(), period_s.to_string());
                let reason = format!("at least {min_s} s, the duration of {frames} frames");
                return Err(CameraError::Setting { feature, value, reason });
            }
        }
        Ok(Self { pulse, ..self })
    }

    /// Returns when the exposure of the frame with this index begins, and the silence of the trigger line before it.
    fn exposure_start(&self, index: u64) -> ExposureStart {
        let period_s = 1.0 / self.world.frame_rate_hz();
        let film_s = index as f64 * period_s;
        let silent_s = self.pulse.map_or(0.0, |pulse| {
            let (pulses, frames) = (index / u64::from(pulse.burst_frames), f64::from(pulse.burst_frames));
            pulses as f64 * (pulse.period_s - frames * period_s)
        });
        ExposureStart { since_start_s: film_s + silent_s, silent_s }
    }

    /// Returns the simulated film.
    pub fn world(&self) -> &SimulatedFilm {
        &self.world
    }

    /// Returns the true values of the collision, if there is one.
    pub fn impact(&self) -> Option<Impact> {
        self.world.impact()
    }

    /// Returns the present time in the film; zero before the start. Without pulses, frame `n` is exposed at `n`
    /// periods.
    #[expect(clippy::disallowed_methods, reason = "a simulated live camera runs on the wall clock")]
    fn elapsed(&self) -> Duration {
        self.started.map_or(Duration::ZERO, |started| self.passed + Instant::now().duration_since(started))
    }

    /// Returns the first frame whose exposure has not begun; 0 on demand and before the start.
    fn next_exposed(&self) -> u64 {
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

    /// Returns when the frame with this index is completely exposed and read out, as time from the start of the film.
    fn due(&self, index: u64) -> Duration {
        let camera = &self.world.scenario().camera;
        let rows_s = 1e-6 * camera.row_time_us.abs() * f64::from(camera.height_px - 1);
        Duration::from_secs_f64(self.exposure_start(index).since_start_s + 1e-6 * camera.exposure_us + rows_s)
    }

    /// Waits at most `timeout` until the frame with this index is due, and returns whether it is.
    ///
    /// On demand every frame is due at once.
    fn wait_until_due(&self, index: u64, timeout: Duration) -> bool {
        if self.pace == Pace::OnDemand {
            return true;
        }
        let missing = self.due(index).saturating_sub(self.elapsed());
        std::thread::sleep(missing.min(timeout));
        missing <= timeout
    }

    /// Records the delivery of a frame whose writing began at the film time `begin`, if the camera is live.
    fn record_delivery(&mut self, index: u64, begin: Duration) {
        if let Some(started) = self.started.filter(|_| self.pace == Pace::Live) {
            let duration = self.elapsed().saturating_sub(begin);
            self.delivery.record(started + self.due(index), duration);
        }
    }

    /// Writes a frame into a slot: copied from the film if it was rendered in advance, else rendered now.
    ///
    /// # Panics
    ///
    /// If the slot is smaller than a frame, or the film has no frame of this index.
    fn fill(&self, index: u64, slot: &mut Slot) {
        let bytes = self.world.frame_bytes();
        let target = &mut slot.bytes_mut()[..bytes];
        let index = self.passes.frame_of_film(index, self.world.frames());
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
        let first = self.next_exposed();
        self.slots.push_back((slot, first));
    }

    #[expect(clippy::disallowed_methods, reason = "a simulated live camera runs on the wall clock")]
    fn start(&mut self) -> Result<(), CameraError> {
        if let Passes::Endless { start_ns } = &mut self.passes {
            let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
            *start_ns = u64::try_from(since.saturating_sub(self.passed).as_nanos()).unwrap_or(u64::MAX);
        }
        self.started = Some(Instant::now());
        Ok(())
    }

    /// # Panics
    ///
    /// If the slot is smaller than a frame.
    fn next(&mut self, timeout: Duration) -> Result<Next, CameraError> {
        if self.index >= self.frames() {
            return Ok(Next::End);
        }
        let Some((_, first)) = self.slots.front() else { return Ok(Next::Timeout) };
        let index = self.index.max(*first);
        if index >= self.frames() {
            self.index = index;
            return Ok(Next::End);
        }
        if self.started.is_none() || !self.wait_until_due(index, timeout) {
            return Ok(Next::Timeout);
        }
        let Some((mut slot, _)) = self.slots.pop_front() else { return Ok(Next::Timeout) };
        let begin = self.elapsed();
        self.fill(index, &mut slot);
        self.record_delivery(index, begin);
        self.index = index + 1;
        Ok(Next::Frame(slot, self.meta(index)))
    }

    fn seek(&mut self, sequence: u64) -> bool {
        self.index = sequence;
        self.passed = Duration::from_secs_f64(self.exposure_start(sequence).since_start_s);
        true
    }

    fn frame_age(&self) -> Duration {
        self.started.map_or(Duration::ZERO, |started| self.delivery.age(started + self.elapsed()))
    }

    fn truth(&self, sequence: u64) -> Vec<VelocitySample> {
        match self.passes {
            Passes::One if sequence < self.world.frames() => self.world.truths(sequence),
            _ => Vec::new(),
        }
    }
}

/// The passes of a film.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Passes {
    /// The film is played once.
    One,
    /// It is played forwards and backwards in turn, from this time on, ns since the Unix epoch.
    Endless { start_ns: u64 },
}

impl Passes {
    /// Returns the frame of the film to show as frame `index`; `frames` is the length of the film.
    fn frame_of_film(self, index: u64, frames: u64) -> u64 {
        let within = index % (2 * frames);
        match self {
            Self::One => index,
            Self::Endless { .. } => within.min(2 * frames - 1 - within),
        }
    }
}

/// The start of a frame's exposure.
struct ExposureStart {
    /// Time from the start of the film, s.
    since_start_s: f64,
    /// The part of it during which the trigger line was silent, s.
    silent_s: f64,
}

/// Renders the whole film if a frame takes [`MAX_RENDER_SHARE`] of the frame period or more; `None` if it takes less.
///
/// That time is the shortest of three renderings of the first frame.
///
/// # Errors
///
/// [`CameraError::Setting`] if such a film needs more than [`MAX_FILM_BYTES`].
fn render_if_slow(world: &SimulatedFilm) -> Result<Option<Vec<u8>>, CameraError> {
    let bytes = world.frame_bytes();
    let mut frame = vec![0; bytes];
    let render_s = (0..3).map(|_| measure_s(|| world.render(0, &mut frame))).fold(f64::INFINITY, f64::min);
    if render_s * world.frame_rate_hz() < MAX_RENDER_SHARE {
        return Ok(None);
    }
    let film = render_in_advance(world).ok_or_else(|| CameraError::Setting {
        feature: "camera.frame_rate_hz".to_owned(),
        value: world.frame_rate_hz().to_string(),
        reason: format!(
            "a frame takes {:.2} ms to render, and {} frames of {bytes} bytes exceed the {MAX_FILM_BYTES} bytes that \
             may be rendered in advance: lower the rate or the number of frames, or set paced = false",
            render_s * 1e3,
            world.frames(),
        ),
    })?;
    Ok(Some(film))
}

/// Renders the whole film, one frame after another, without padding; `None` if it needs more than [`MAX_FILM_BYTES`].
fn render_in_advance(world: &SimulatedFilm) -> Option<Vec<u8>> {
    let bytes = world.frame_bytes();
    let film_bytes = (bytes as u64).checked_mul(world.frames()).filter(|bytes| *bytes <= MAX_FILM_BYTES)?;
    let mut film = vec![0; film_bytes as usize];
    for (index, frame) in film.chunks_exact_mut(bytes).enumerate() {
        world.render(index as u64, frame);
    }
    Some(film)
}

/// Returns the time that a piece of work takes, s.
#[expect(clippy::disallowed_methods, reason = "measures the rendering time on this machine")]
fn measure_s(work: impl FnOnce()) -> f64 {
    let started = Instant::now();
    work();
    started.elapsed().as_secs_f64()
}
