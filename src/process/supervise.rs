//! Starting the processes of a rig, watching them, starting again what dies, stopping them in order.

use super::clock::{Every, Patience, now};
use super::reference;
use super::reins::{self, END_OF_CONFIG, Reins};
use super::report::Reporter;
use super::resume::Resume;
use super::rig::{expected_format, limits};
use super::stop::Stop;
use super::storage::prepare_directory;
use super::summary::Summary;
use crate::bus::{Bus, Subscriber};
use crate::config::Config;
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

const WATCH: Duration = Duration::from_millis(20);
/// How often what the dead left behind is cleaned up.
const CLEAN: Duration = Duration::from_millis(250);
/// Deaths of one process after which the rig gives up.
const MOST_DEATHS: u32 = 5;
/// How long the processes may take to end by themselves after the camera stopped.
const DRAIN: Duration = Duration::from_secs(60);
/// How long a process may take to end after it was told to.
const END: Duration = Duration::from_secs(3);

/// One process of a rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Child {
    /// Which camera it works for: 0 the first, then those of the views in their order.
    pub camera: u32,
    /// Its role.
    pub role: Role,
    /// Which of several, from 0.
    pub index: u32,
}

impl Child {
    /// The only, or first, of this role for the first camera.
    pub const fn first(role: Role) -> Self {
        Self { camera: 0, role, index: 0 }
    }
}

/// What is watched of one camera: its part of the rig has a name of its own.
struct Side<'a> {
    /// What the camera is called; empty for the first.
    name: &'a str,
    config: &'a Config,
    frame_rate_hz: f64,
    status: Subscriber<StatusMessage>,
    _bus: Bus,
    _services: Vec<Box<dyn Any>>,
}

impl<'a> Side<'a> {
    fn open(name: &'a str, config: &'a Config, bus: Bus) -> anyhow::Result<Self> {
        let format = expected_format(config)?;
        config.check_calibration(format.width_px, format.height_px)?;
        config.check_ring(format.slot_bytes(), format.frame_rate_hz)?;
        let limits = limits(config, &format);
        let services = bus.hold(&limits)?;
        let (frame_rate_hz, status) = (format.frame_rate_hz, bus.subscriber(&limits)?);
        Ok(Self { name, config, frame_rate_hz, status, _bus: bus, _services: services })
    }

    /// Its processes, readers before the camera; the recorder is the whole rig's.
    fn children(&self, camera: u32) -> Vec<Child> {
        let workers = (0..self.config.workers.count).map(|index| Child { camera, role: Role::Correlate, index });
        let tracker = workers.clone().next().map(|first| Child { role: Role::Track, ..first });
        workers.chain(tracker).chain([Child { camera, role: Role::Acquire, index: 0 }]).collect()
    }
}

struct Running {
    process: Option<Process>,
    deaths: u32,
    /// Exit code of its last, regular end.
    code: Option<i32>,
}

/// The processes of a rig.
pub struct Fleet<'a> {
    program: PathBuf,
    children: BTreeMap<Child, Running>,
    /// One a camera.
    sides: Vec<Side<'a>>,
    events: Subscriber<Event>,
    /// The newest status of each, and when it came.
    told: BTreeMap<Child, StatusMessage>,
    heard: BTreeMap<Child, Instant>,
    reporter: Reporter,
    bus: Bus,
    clean: Every,
    summary: Summary,
    restarts: u64,
    leader: Option<Sender<Reins>>,
}

/// Runs every process of a rig until its stream ends or it is asked to stop.
///
/// `watch` is called every few milliseconds with the newest status of every process.
///
/// # Errors
///
/// When a process cannot be started, or dies again and again.
pub fn run(
    config: &Config,
    stop: &Stop,
    watch: impl FnMut(&BTreeMap<Child, StatusMessage>),
) -> anyhow::Result<Summary> {
    run_led(config, stop, None, watch)
}

/// As [`run`]; the reins of a stepped camera go to `leader`, standard input leads it when there is none.
///
/// # Errors
///
/// As [`run`].
pub fn run_led(
    config: &Config,
    stop: &Stop,
    leader: Option<Sender<Reins>>,
    mut watch: impl FnMut(&BTreeMap<Child, StatusMessage>),
) -> anyhow::Result<Summary> {
    let mut fleet = Fleet::start(config, leader)?;
    let outcome = fleet.watch(stop, &mut watch);
    fleet.stop_all();
    fleet.listen()?;
    outcome?;
    Ok(fleet.summary)
}

/// A process of the rig ended with an error; the rig cannot go on.
#[derive(Debug, thiserror::Error)]
#[error("`ricochet {role}` ended with exit code {code}")]
pub struct ChildFailure {
    /// Its subcommand.
    pub role: &'static str,
    /// Its exit code.
    pub code: i32,
    /// Whether it has said itself, in one line, why it cannot work.
    pub is_told: bool,
}

impl<'a> Fleet<'a> {
    /// Starts them all.
    ///
    /// # Errors
    ///
    /// When a process cannot be started, or shared memory cannot be used.
    pub fn start(config: &'a Config, leader: Option<Sender<Reins>>) -> anyhow::Result<Self> {
        if let Some(record) = &config.record {
            prepare_directory(record)?;
        }
        let bus = Bus::take_part(&config.rig.name, Role::Supervise.word(), Duration::ZERO)?;
        bus.clean_up_dead();
        let limits = limits(config, &expected_format(config)?);
        let mut sides = vec![Side::open("", config, Bus::join(&config.rig.name, Role::Supervise.word())?)?];
        for view in &config.views {
            let bus = Bus::take_part(&view.config.rig.name, Role::Supervise.word(), Duration::ZERO)?;
            sides.push(Side::open(&view.name, &view.config, bus)?);
        }
        let mut fleet = Self {
            program: std::env::current_exe()?,
            children: BTreeMap::new(),
            sides,
            events: bus.subscriber(&limits)?,
            told: BTreeMap::new(),
            heard: BTreeMap::new(),
            reporter: Reporter::new(&bus, &limits, Role::Supervise, 0)?,
            bus,
            clean: Every::new(CLEAN),
            summary: Summary::default(),
            restarts: 0,
            leader,
        };
        let recorder = config.record.iter().map(|_| Child::first(Role::Record));
        let cameras = (0..).zip(&fleet.sides).flat_map(|(camera, side)| side.children(camera));
        let children: Vec<Child> = recorder.chain(cameras).collect();
        for child in children {
            let process = fleet.spawn(child, None)?;
            fleet.children.insert(child, Running { process: Some(process), deaths: 0, code: None });
        }
        Ok(fleet)
    }

    /// Starts one process; `resume` is what its dead predecessor told of.
    fn spawn(&self, child: Child, resume: Option<Resume>) -> anyhow::Result<Process> {
        let config = self.sides[child.camera as usize].config;
        let mut command = Command::new(&self.program);
        command.arg(child.role.word()).arg("-").args(["--origin", &config.origin]);
        if child.role == Role::Correlate {
            command.args(["--worker", &child.index.to_string()]);
        }
        if let Some(resume) = resume {
            command.args(["--resume", &resume.to_string()]);
        }
        // A group of its own: an interrupt from the terminal reaches the supervisor, which stops the rig in order.
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
                reins::hand_over(stdin, process.stdout.take(), self.leader.as_ref());
            }
        }
        Ok(process)
    }

    fn watch(&mut self, stop: &Stop, watch: &mut dyn FnMut(&BTreeMap<Child, StatusMessage>)) -> anyhow::Result<()> {
        let mut draining: Option<Patience> = None;
        while self.alive() > 0 {
            self.listen()?;
            watch(&self.told);
            if self.clean.due() {
                self.bus.clean_up_dead();
            }
            if stop.requested() && draining.is_none() {
                self.signal(Role::Acquire, Signal::TERM);
                draining = Some(Patience::new(DRAIN));
            }
            if draining.is_none() && self.ended_by_itself() {
                draining = Some(Patience::new(DRAIN));
            }
            self.reap(draining.is_some())?;
            if draining.as_ref().is_some_and(Patience::is_over) {
                anyhow::bail!("{} processes did not end in time", self.alive());
            }
            self.tell()?;
            std::thread::sleep(WATCH);
        }
        Ok(())
    }

    fn alive(&self) -> usize {
        self.children.values().filter(|running| running.process.is_some()).count()
    }

    fn ended_by_itself(&self) -> bool {
        let mut cameras = self.children.iter().filter(|(child, _)| child.role == Role::Acquire);
        cameras.all(|(_, running)| running.code.is_some())
    }

    fn listen(&mut self) -> anyhow::Result<()> {
        for (camera, side) in (0..).zip(&self.sides) {
            while let Some(status) = side.status.take()? {
                if let Some(role) = Role::from_number(status.role) {
                    let child = Child { camera, role, index: status.index };
                    self.told.insert(child, status);
                    self.heard.insert(child, now());
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

    /// Sees who ended, and starts again who should not have.
    fn reap(&mut self, draining: bool) -> anyhow::Result<()> {
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
                code => self.died(child, code, status, draining)?,
            }
        }
        Ok(())
    }

    fn count_losses(&mut self, child: Child, code: i32) {
        let told = self.told.get(&child).map_or(0, |status| status.lost + status.dropped);
        if code == 6 {
            self.summary.lost += told.max(1);
            self.summary.causes.push(format!("{} lost {}", self.name(child), told.max(1)));
        }
    }

    fn died(&mut self, child: Child, code: Option<i32>, status: ExitStatus, draining: bool) -> anyhow::Result<()> {
        let role = child.role.word();
        let told = self.told.get(&child).copied();
        self.summary.lost += 1;
        self.summary.causes.push(format!("{} ended with {status}", self.name(child)));
        self.bus.clean_up_dead();
        let Some(running) = self.children.get_mut(&child) else { return Ok(()) };
        running.deaths += 1;
        // A refused configuration or an absent camera will not get better by asking again.
        let is_told = matches!(code, Some(2..=3));
        if is_told || running.deaths > MOST_DEATHS {
            return Err(ChildFailure { role, code: code.unwrap_or(1), is_told }.into());
        }
        if draining && child.role == Role::Acquire {
            // The end of the stream will not be told any more.
            self.signal_all(Signal::TERM);
            return Ok(());
        }
        log::warn!("{} ended with {status}; starting it again", self.name(child));
        let sequence = told.map_or(0, |status| status.sequence);
        let stamp_ns = told.map_or(0, |status| status.stamp_ns);
        let process = self.spawn(child, self.resume(child))?;
        if let Some(running) = self.children.get_mut(&child) {
            running.process = Some(process);
        }
        self.restarts += 1;
        let text = format!("{} ended with {status} and was started again", self.name(child));
        Ok(self.reporter.event(EventKind::Restarted, sequence, stamp_ns, &text)?)
    }

    /// What a process is called.
    fn name(&self, child: Child) -> String {
        let name = format!("{} {}", child.role.word(), child.index);
        match self.sides[child.camera as usize].name {
            "" => name,
            camera => format!("{name} of {camera}"),
        }
    }

    /// Where the successor of a process that died goes on.
    fn resume(&self, child: Child) -> Option<Resume> {
        // A camera's process that never told of a frame left nothing to go on from.
        let told = self.told.get(&child).filter(|told| child.role != Role::Acquire || told.taken > 0);
        let (sequence, stamp_ns) = told.map_or((0, 0), |told| (told.sequence, told.stamp_ns));
        if child.role != Role::Acquire {
            return Some(Resume { sequence, stamp_ns, epoch: 0 });
        }
        let side = &self.sides[child.camera as usize];
        let since_s = self.heard.get(&child).map_or(0.0, |heard| heard.elapsed().as_secs_f64());
        let resume = Resume { sequence, stamp_ns, epoch: told?.state + 1 };
        Some(resume.after(since_s * side.config.camera.playback_rate, side.frame_rate_hz))
    }

    fn tell(&mut self) -> anyhow::Result<()> {
        let newest = self.told.values().map(|status| (status.sequence, status.stamp_ns)).max().unwrap_or((0, 0));
        self.reporter.set_state(self.alive() as u32);
        self.reporter.set_restarts(self.restarts);
        Ok(self.reporter.status(&self.summary, newest.0, newest.1)?)
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

    /// Ends whoever still runs: first by asking, then by force.
    fn stop_all(&mut self) {
        self.signal_all(Signal::TERM);
        let patience = Patience::new(END);
        while self.alive() > 0 && !patience.is_over() {
            for running in self.children.values_mut() {
                if let Some(process) = &mut running.process
                    && !matches!(process.try_wait(), Ok(None))
                {
                    running.process = None;
                }
            }
            std::thread::sleep(WATCH);
        }
        for process in self.children.values_mut().filter_map(|running| running.process.as_mut()) {
            let _ = process.kill();
            let _ = process.wait();
        }
        self.bus.clean_up_dead();
        self.sides.iter().for_each(|side| reference::forget(side.config));
    }
}

/// The standard library can only send SIGKILL.
fn send(process: &Process, signal: Signal) {
    let pid = i32::try_from(process.id()).ok().and_then(rustix::process::Pid::from_raw);
    if let Some(pid) = pid {
        // Not waited for yet, so the number cannot be another's; one that just ended needs no signal.
        let _ = rustix::process::kill_process(pid, signal);
    }
}
