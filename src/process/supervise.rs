//! Starting the processes of a rig, watching them, starting again what dies, stopping them in order.

use super::clock::{Every, Patience};
use super::reference;
use super::reins::{self, END_OF_CONFIG, Reins};
use super::report::Reporter;
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
use std::time::Duration;

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
    /// Its role.
    pub role: Role,
    /// Which of several, from 0.
    pub index: u32,
}

struct Running {
    process: Option<Process>,
    deaths: u32,
    /// Exit code of its last, regular end.
    code: Option<i32>,
}

/// The processes of a rig.
pub struct Fleet<'a> {
    config: &'a Config,
    program: PathBuf,
    children: BTreeMap<Child, Running>,
    status: Subscriber<StatusMessage>,
    events: Subscriber<Event>,
    told: BTreeMap<Child, StatusMessage>,
    reporter: Reporter,
    bus: Bus,
    clean: Every,
    summary: Summary,
    restarts: u64,
    leader: Option<Sender<Reins>>,
    _services: Vec<Box<dyn Any>>,
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
        let format = expected_format(config)?;
        config.check_calibration(format.width_px, format.height_px)?;
        if let Some(record) = &config.record {
            prepare_directory(record)?;
            config.check_ring(format.slot_bytes(), format.frame_rate_hz)?;
        }
        let limits = limits(config, &format);
        let bus = Bus::take_part(&config.rig.name, Role::Supervise.word(), Duration::ZERO)?;
        bus.clean_up_dead();
        let services = bus.hold(&limits)?;
        let workers = (0..config.workers.count).map(|index| Child { role: Role::Correlate, index });
        let recorder = config.record.iter().map(|_| Child { role: Role::Record, index: 0 });
        let others = [Role::Track, Role::Acquire].map(|role| Child { role, index: 0 });
        let mut fleet = Self {
            config,
            program: std::env::current_exe()?,
            children: BTreeMap::new(),
            status: bus.subscriber(&limits)?,
            events: bus.subscriber(&limits)?,
            told: BTreeMap::new(),
            reporter: Reporter::new(&bus, &limits, Role::Supervise, 0)?,
            bus,
            clean: Every::new(CLEAN),
            summary: Summary::default(),
            restarts: 0,
            leader,
            _services: services,
        };
        for child in workers.chain(recorder).chain(others) {
            let process = fleet.spawn(child, None)?;
            fleet.children.insert(child, Running { process: Some(process), deaths: 0, code: None });
        }
        Ok(fleet)
    }

    /// Starts one process; `resume` is the newest frame that its dead predecessor told of.
    fn spawn(&self, child: Child, resume: Option<u64>) -> anyhow::Result<Process> {
        let mut command = Command::new(&self.program);
        command.arg(child.role.word()).arg("-").args(["--origin", &self.config.origin]);
        if child.role == Role::Correlate {
            command.args(["--worker", &child.index.to_string()]);
        }
        if child.role != Role::Acquire
            && let Some(sequence) = resume
        {
            command.args(["--resume", &sequence.to_string()]);
        }
        // A group of its own: an interrupt from the terminal reaches the supervisor, which stops the rig in order.
        let is_stepped = child.role == Role::Acquire && self.config.camera.stepped;
        let stdout = match &self.leader {
            _ if !is_stepped => Stdio::null(),
            Some(_) => Stdio::piped(),
            None => Stdio::inherit(),
        };
        command.arg("--supervised").stdin(Stdio::piped()).stdout(stdout).process_group(0);
        let mut process = command.spawn()?;
        if let Some(mut stdin) = process.stdin.take() {
            stdin.write_all(self.config.text.as_bytes())?;
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
        self.children.iter().any(|(child, running)| child.role == Role::Acquire && running.code.is_some())
    }

    fn listen(&mut self) -> anyhow::Result<()> {
        while let Some(status) = self.status.take()? {
            if let Some(role) = Role::from_number(status.role) {
                self.told.insert(Child { role, index: status.index }, status);
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
            self.summary.causes.push(format!("{} {} lost {}", child.role.word(), child.index, told.max(1)));
        }
    }

    fn died(&mut self, child: Child, code: Option<i32>, status: ExitStatus, draining: bool) -> anyhow::Result<()> {
        let role = child.role.word();
        let told = self.told.get(&child).copied();
        self.summary.lost += 1;
        self.summary.causes.push(format!("{role} {} ended with {status}", child.index));
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
        log::warn!("{role} {} ended with {status}; starting it again", child.index);
        let sequence = told.map_or(0, |status| status.sequence);
        let stamp_ns = told.map_or(0, |status| status.stamp_ns);
        let process = self.spawn(child, Some(sequence))?;
        if let Some(running) = self.children.get_mut(&child) {
            running.process = Some(process);
        }
        self.restarts += 1;
        let text = format!("{role} {} ended with {status} and was started again", child.index);
        Ok(self.reporter.event(EventKind::Restarted, sequence, stamp_ns, &text)?)
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
        reference::forget(self.config);
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
