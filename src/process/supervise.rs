//! Starts the processes of a rig, monitors them, restarts those that die, and stops them in order.

use super::clock::{PeriodicTimer, Timeout, now};
use super::frame_stamp::FrameStamp;
use super::reference_picture;
use super::resume::Resume;
use super::setup::{expected_format, limits};
use super::status_reporter::StatusReporter;
use super::stepping;
use super::stepping::{END_OF_CONFIG, StepControl};
use super::stop::Stop;
use super::storage::prepare_directory;
use super::summary::Summary;
use crate::bus::{Bus, Subscriber};
use crate::config::Config;
use crate::failure::{ExitCode, Failure, Fatal};
use crate::message::{Event, EventKind, Role, StatusMessage};
use rustix::process::Signal;
use std::any::Any;
use std::collections::BTreeMap;
use std::io::Write;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child as Process, Command, ExitStatus, Stdio};
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

/// Interval of polling the processes.
const POLL_PERIOD: Duration = Duration::from_millis(20);
/// Interval of cleaning up after dead processes.
const CLEAN_UP_PERIOD: Duration = Duration::from_millis(250);
/// Deaths of one process after which the rig gives up.
const MAX_DEATHS: u32 = 5;
/// Time for the processes to finish after the camera stopped.
const DRAIN_TIMEOUT: Duration = Duration::from_secs(60);
/// Time for a process to end after a termination signal.
const STOP_TIMEOUT: Duration = Duration::from_secs(3);

/// A process of a rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Child {
    /// Index of its camera: 0 the main one, then the views in their order.
    pub camera: u32,
    /// Its role.
    pub role: Role,
    /// Index among processes of the same role.
    pub index: u32,
}

impl Child {
    /// Returns the only, or first, process of this role for the main camera.
    pub const fn first(role: Role) -> Self {
        Self { camera: 0, role, index: 0 }
    }
}

/// One camera of the rig, which has its own rig name on the bus.
struct CameraGroup<'a> {
    /// Name of the view; empty for the main camera.
    name: &'a str,
    config: &'a Config,
    frame_rate_hz: f64,
    status: Subscriber<StatusMessage>,
    _bus: Bus,
    _services: Vec<Box<dyn Any>>,
}

impl<'a> CameraGroup<'a> {
    fn open(name: &'a str, config: &'a Config, bus: Bus) -> Result<Self, Failure> {
        let format = expected_format(config)?;
        config.check_calibration(format.width_px, format.height_px)?;
        config.check_ring(format.slot_bytes(), format.frame_rate_hz)?;
        let limits = limits(config, &format);
        let services = bus.hold(&limits)?;
        let (frame_rate_hz, status) = (format.frame_rate_hz, bus.subscriber(&limits)?);
        Ok(Self { name, config, frame_rate_hz, status, _bus: bus, _services: services })
    }

    /// Returns its processes, readers before the camera. The recorder is shared by all cameras.
    fn children(&self, camera: u32) -> Vec<Child> {
        let workers = (0..self.config.workers.count).map(|index| Child { camera, role: Role::Correlate, index });
        let tracker = workers.clone().next().map(|first| Child { role: Role::Track, ..first });
        workers.chain(tracker).chain([Child { camera, role: Role::Acquire, index: 0 }]).collect()
    }
}

struct Running {
    process: Option<Process>,
    deaths: u32,
    /// Exit code of its last regular end.
    code: Option<i32>,
}

/// The supervisor of a rig.
pub struct Supervisor<'a> {
    program: PathBuf,
    children: BTreeMap<Child, Running>,
    /// One per camera.
    groups: Vec<CameraGroup<'a>>,
    events: Subscriber<Event>,
    /// The latest status of each process, and when it arrived.
    statuses: BTreeMap<Child, StatusMessage>,
    status_times: BTreeMap<Child, Instant>,
    reporter: StatusReporter,
    bus: Bus,
    clean_up: PeriodicTimer,
    summary: Summary,
    restarts: u64,
    /// Time for the processes to finish, once the camera stopped.
    draining: Option<Timeout>,
    leader: Option<Sender<StepControl>>,
}

/// Runs every process of a rig until its stream ends or it is asked to stop.
///
/// `watch` is called every few milliseconds with the latest status of every process.
///
/// # Errors
///
/// If a process cannot be started, or dies too often.
pub fn run(
    config: &Config,
    stop: &Stop,
    watch: impl FnMut(&BTreeMap<Child, StatusMessage>),
) -> Result<Summary, Failure> {
    run_stepped(config, stop, None, watch)
}

/// Like [`run`], but a stepped camera is controlled through `leader`; without one, through standard input.
///
/// # Errors
///
/// See [`run`].
pub fn run_stepped(
    config: &Config,
    stop: &Stop,
    leader: Option<Sender<StepControl>>,
    mut watch: impl FnMut(&BTreeMap<Child, StatusMessage>),
) -> Result<Summary, Failure> {
    let mut supervisor = Supervisor::start(config, leader)?;
    let outcome = supervisor.watch(stop, &mut watch);
    supervisor.stop_all();
    supervisor.receive()?;
    outcome?;
    Ok(supervisor.summary)
}

/// A process of the rig failed, and the rig cannot continue.
#[derive(Debug, thiserror::Error)]
#[error("`ricochet {role}` ended with exit code {code}")]
struct ChildFailure {
    /// Its subcommand.
    role: &'static str,
    code: i32,
    /// Whether the process itself has printed the reason.
    is_reported: bool,
}

impl Fatal for ChildFailure {
    fn exit_code(&self) -> ExitCode {
        ExitCode::from_number(self.code)
    }

    fn is_reported(&self) -> bool {
        self.is_reported
    }
}

impl<'a> Supervisor<'a> {
    /// Starts all processes.
    ///
    /// # Errors
    ///
    /// If a process cannot be started, or shared memory cannot be used.
    pub fn start(config: &'a Config, leader: Option<Sender<StepControl>>) -> Result<Self, Failure> {
        if let Some(record) = &config.record {
            prepare_directory(record)?;
        }
        let bus = Bus::join_as(&config.rig.name, Role::Supervise.as_str(), Duration::ZERO)?;
        bus.clean_up_dead();
        let limits = limits(config, &expected_format(config)?);
        let mut groups = vec![CameraGroup::open("", config, Bus::join(&config.rig.name, Role::Supervise.as_str())?)?];
        for view in &config.views {
            let bus = Bus::join_as(&view.config.rig.name, Role::Supervise.as_str(), Duration::ZERO)?;
            groups.push(CameraGroup::open(&view.name, &view.config, bus)?);
        }
        let mut supervisor = Self {
            program: std::env::current_exe()?,
            children: BTreeMap::new(),
            groups,
            events: bus.subscriber(&limits)?,
            statuses: BTreeMap::new(),
            status_times: BTreeMap::new(),
            reporter: StatusReporter::new(&bus, &limits, Role::Supervise, 0)?,
            bus,
            clean_up: PeriodicTimer::new(CLEAN_UP_PERIOD),
            summary: Summary::default(),
            restarts: 0,
            draining: None,
            leader,
        };
        let recorder = config.record.iter().map(|_| Child::first(Role::Record));
        let cameras = (0..).zip(&supervisor.groups).flat_map(|(camera, group)| group.children(camera));
        let children: Vec<Child> = recorder.chain(cameras).collect();
        for child in children {
            let process = supervisor.spawn(child, None)?;
            supervisor.children.insert(child, Running { process: Some(process), deaths: 0, code: None });
        }
        Ok(supervisor)
    }

    /// Starts one process; `resume` is the last known state of its dead predecessor.
    fn spawn(&self, child: Child, resume: Option<Resume>) -> Result<Process, Failure> {
        let config = self.groups[child.camera as usize].config;
        let mut command = Command::new(&self.program);
        command.arg(child.role.as_str()).arg("-").args(["--origin", &config.origin]);
        if child.role == Role::Correlate {
            command.args(["--worker", &child.index.to_string()]);
        }
        if let Some(resume) = resume {
            command.args(["--resume", &resume.to_string()]);
        }
        // Its own process group: an interrupt from the terminal reaches only the supervisor, which stops the rig in
        // order.
        let is_stepped = child.role == Role::Acquire && config.camera.stepped;
        let stdout = match &self.leader {
            _ if !is_stepped => Stdio::null(),
            Some(_) => Stdio::piped(),
            None => Stdio::inherit(),
        };
        command.arg("--supervised").stdin(Stdio::piped()).stdout(stdout).process_group(0);
        let mut process = command.spawn()?;
        if let Some(mut stdin) = process.stdin.take() {
            stdin.write_all(config.text.as_bytes())?;
            if is_stepped {
                stdin.write_all(&[END_OF_CONFIG])?;
                stepping::connect(stdin, process.stdout.take(), self.leader.as_ref());
            }
        }
        Ok(process)
    }

    fn watch(&mut self, stop: &Stop, watch: &mut dyn FnMut(&BTreeMap<Child, StatusMessage>)) -> Result<(), Failure> {
        while self.running_count() > 0 {
            self.receive()?;
            watch(&self.statuses);
            if self.clean_up.due() {
                self.bus.clean_up_dead();
            }
            if stop.requested() && self.draining.is_none() {
                self.signal(Role::Acquire, Signal::TERM);
                self.draining = Some(Timeout::new(DRAIN_TIMEOUT));
            }
            if self.draining.is_none() && self.ended_by_itself() {
                self.draining = Some(Timeout::new(DRAIN_TIMEOUT));
            }
            self.reap()?;
            if self.draining.as_ref().is_some_and(Timeout::has_expired) {
                return Err(Failure::internal(format!("{} processes did not end in time", self.running_count())));
            }
            self.publish_status()?;
            std::thread::sleep(POLL_PERIOD);
        }
        Ok(())
    }

    fn running_count(&self) -> usize {
        self.children.values().filter(|running| running.process.is_some()).count()
    }

    fn ended_by_itself(&self) -> bool {
        let mut cameras = self.children.iter().filter(|(child, _)| child.role == Role::Acquire);
        cameras.all(|(_, running)| running.code.is_some())
    }

    fn receive(&mut self) -> Result<(), Failure> {
        for (camera, group) in (0..).zip(&self.groups) {
            while let Some(status) = group.status.take()? {
                if let Some(role) = Role::from_number(status.role) {
                    let child = Child { camera, role, index: status.index };
                    self.statuses.insert(child, status);
                    self.status_times.insert(child, now());
                }
            }
        }
        while let Some(event) = self.events.take()? {
            if event.kind() == Some(EventKind::Recorded) {
                self.summary.recordings.push(PathBuf::from(event.text()));
            }
        }
        Ok(())
    }

    /// Collects processes that ended, and restarts those that died.
    fn reap(&mut self) -> Result<(), Failure> {
        let children: Vec<Child> = self.children.keys().copied().collect();
        for child in children {
            let Some(running) = self.children.get_mut(&child) else { continue };
            let Some(process) = &mut running.process else { continue };
            let Some(status) = process.try_wait()? else { continue };
            running.process = None;
            match status.code() {
                Some(code @ (0 | 6)) => {
                    running.code = Some(code);
                    self.count_losses(child, code);
                }
                code => self.handle_death(child, code, status)?,
            }
        }
        Ok(())
    }

    fn count_losses(&mut self, child: Child, code: i32) {
        let losses = self.statuses.get(&child).map_or(0, |status| status.lost + status.dropped).max(1);
        if code == 6 {
            self.summary.lost += losses;
            self.summary.causes.push(format!("{} lost {losses}", self.name(child)));
        }
    }

    fn handle_death(&mut self, child: Child, code: Option<i32>, status: ExitStatus) -> Result<(), Failure> {
        let role = child.role.as_str();
        let last = self.statuses.get(&child).copied().unwrap_or_default();
        self.summary.lost += 1;
        self.summary.causes.push(format!("{} ended with {status}", self.name(child)));
        self.bus.clean_up_dead();
        let Some(running) = self.children.get_mut(&child) else { return Ok(()) };
        running.deaths += 1;
        // A refused configuration or a missing camera will not get better by a restart.
        let is_reported = matches!(code, Some(2..=3));
        if is_reported || running.deaths > MAX_DEATHS {
            return Err(ChildFailure { role, code: code.unwrap_or(1), is_reported }.into());
        }
        if self.draining.is_some() && child.role == Role::Acquire {
            // The dead process will not announce the end of the stream.
            self.signal_all(Signal::TERM);
            return Ok(());
        }
        log::warn!("{} ended with {status}; restarting it", self.name(child));
        let process = self.spawn(child, self.resume(child))?;
        if let Some(running) = self.children.get_mut(&child) {
            running.process = Some(process);
        }
        self.restarts += 1;
        let text = format!("{} ended with {status} and was restarted", self.name(child));
        Ok(self.reporter.event(EventKind::Restarted, frame_of(&last), &text)?)
    }

    /// Returns the name of a process for messages.
    fn name(&self, child: Child) -> String {
        let name = format!("{} {}", child.role.as_str(), child.index);
        match self.groups[child.camera as usize].name {
            "" => name,
            camera => format!("{name} of {camera}"),
        }
    }

    /// Returns the state from which the successor of a dead process continues.
    fn resume(&self, child: Child) -> Option<Resume> {
        // A camera process that never published a frame left nothing to continue from.
        let status = self.statuses.get(&child).filter(|status| child.role != Role::Acquire || status.taken > 0);
        let FrameStamp { sequence, stamp_ns } = status.map_or_else(FrameStamp::default, frame_of);
        if child.role != Role::Acquire {
            return Some(Resume { sequence, stamp_ns, epoch: 0 });
        }
        let group = &self.groups[child.camera as usize];
        let since_s = self.status_times.get(&child).map_or(0.0, |time| time.elapsed().as_secs_f64());
        let resume = Resume { sequence, stamp_ns, epoch: status?.state + 1 };
        Some(resume.after(since_s * group.config.camera.playback_rate, group.frame_rate_hz))
    }

    fn publish_status(&mut self) -> Result<(), Failure> {
        let newest = self.statuses.values().map(frame_of).max().unwrap_or_default();
        self.reporter.set_state(self.running_count() as u32);
        self.reporter.set_restarts(self.restarts);
        Ok(self.reporter.status(&self.summary, newest)?)
    }

    fn signal_all(&self, signal: Signal) {
        self.children.values().filter_map(|running| running.process.as_ref()).for_each(|process| send(process, signal));
    }

    fn signal(&self, role: Role, signal: Signal) {
        for (child, running) in &self.children {
            if let (true, Some(process)) = (child.role == role, &running.process) {
                send(process, signal);
            }
        }
    }

    /// Ends every process that still runs: first by a termination signal, then by force.
    fn stop_all(&mut self) {
        self.signal_all(Signal::TERM);
        let patience = Timeout::new(STOP_TIMEOUT);
        while self.running_count() > 0 && !patience.has_expired() {
            for running in self.children.values_mut() {
                if let Some(process) = &mut running.process
                    && !matches!(process.try_wait(), Ok(None))
                {
                    running.process = None;
                }
            }
            std::thread::sleep(POLL_PERIOD);
        }
        for process in self.children.values_mut().filter_map(|running| running.process.as_mut()) {
            let _ = process.kill();
            let _ = process.wait();
        }
        self.bus.clean_up_dead();
        self.groups.iter().for_each(|group| reference_picture::remove(group.config));
    }
}

/// Returns the newest frame of a process.
fn frame_of(status: &StatusMessage) -> FrameStamp {
    FrameStamp { sequence: status.sequence, stamp_ns: status.stamp_ns }
}

/// Sends a signal; the standard library can only send SIGKILL.
fn send(process: &Process, signal: Signal) {
    let pid = i32::try_from(process.id()).ok().and_then(rustix::process::Pid::from_raw);
    if let Some(pid) = pid {
        // The process was not waited for yet, so the id cannot belong to another one. If it just ended, no signal is
        // needed.
        let _ = rustix::process::kill_process(pid, signal);
    }
}
