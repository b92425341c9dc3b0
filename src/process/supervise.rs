//! Starts the processes of a rig, monitors them, restarts those that die, and stops them in order.

mod camera_group;
mod child;
mod heartbeat;
mod idle_readers;
mod page;
mod restarts;
mod service_manager;
mod shot_lines;

use super::clock::{PeriodicTimer, Timeout};
use super::frame_stamp::FrameStamp;
use super::rig_losses::{ProcessLosses, RigLosses};
use super::setup::{expected_format, limits};
use super::status_reporter::StatusReporter;
use super::stepping::{self, StepControl};
use super::stop::Stop;
use super::storage::prepare_directory;
use super::summary::Summary;
use super::supervisor_pipe::SupervisorPipe;
use crate::bus::{self, Bus, Subscriber};
use crate::config::{Config, TriggerMode};
use crate::failure::{ExitCode, Failure};
use crate::message::{Event, EventKind, Role, StatusMessage};
use camera_group::CameraGroup;
pub use child::{Child, Page};
use child::{ChildFailure, Running, Start};
use heartbeat::{Heartbeat, process_state};
use service_manager::ServiceManager;
use shot_lines::ShotLines;
use std::collections::BTreeMap;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Command, ExitStatus, Stdio};
use std::sync::mpsc::Sender;
use std::time::Duration;

/// Interval of polling the processes.
const POLL_PERIOD: Duration = Duration::from_millis(20);
/// Interval of cleaning up after dead processes.
const CLEAN_UP_PERIOD: Duration = Duration::from_millis(250);
/// Time for the processes to finish after the stream ended by itself.
const DRAIN_TIMEOUT: Duration = Duration::from_secs(60);
/// Time for the processes to finish after a stop was requested.
const STOP_DRAIN_TIMEOUT: Duration = Duration::from_secs(20);
/// Time for a process to end after it was asked to.
const STOP_TIMEOUT: Duration = Duration::from_secs(3);

/// The supervisor of a rig.
pub struct Supervisor<'a> {
    program: PathBuf,
    children: BTreeMap<Child, Running>,
    events: Subscriber<Event>,
    lines: Option<ShotLines>,
    /// The latest status of each process.
    statuses: BTreeMap<Child, StatusMessage>,
    reporter: StatusReporter,
    clean_up: PeriodicTimer,
    summary: Summary,
    /// The losses of each process and its predecessors that have ended.
    losses: BTreeMap<Child, ProcessLosses>,
    restarts: u64,
    /// Time for the processes to finish, once the camera stopped.
    draining: Option<Timeout>,
    leader: Option<Sender<StepControl>>,
    manager: ServiceManager,
    /// One per camera, the main one first. Dropped last, since everything else is open on its bus.
    groups: Vec<CameraGroup<'a>>,
}

/// The extras of a supervised rig; by default there are none.
#[derive(Debug, Default)]
pub struct Extras {
    /// Controls a stepped camera; without it, standard input does.
    pub leader: Option<Sender<StepControl>>,
    /// Whether the page is served.
    pub page: Page,
    /// Prints one line for each change of state and each shot.
    pub print: Option<fn(&str)>,
}

/// Runs every process of a rig until its stream ends or it is asked to stop.
///
/// `watch` is called every few milliseconds with the latest status of every process, and a last time when all have
/// ended. A stop that is abandoned kills the processes instead of waiting for their results.
///
/// # Errors
///
/// If a process cannot be started, or dies too often.
pub fn run(
    config: &Config,
    stop: &Stop,
    extras: Extras,
    mut watch: impl FnMut(&BTreeMap<Child, StatusMessage>),
) -> Result<Summary, Failure> {
    let mut supervisor = Supervisor::start(config, extras)?;
    let outcome = supervisor.run_until_end(stop, &mut watch);
    if stop.is_abandoned() {
        supervisor.kill_processes(|_| true);
    }
    supervisor.stop_all();
    supervisor.receive()?;
    watch(&supervisor.statuses);
    outcome?;
    Ok(Summary { by_kind: RigLosses::of(supervisor.losses.into_values()), ..supervisor.summary })
}

impl<'a> Supervisor<'a> {
    /// Starts all processes.
    ///
    /// # Errors
    ///
    /// If a process cannot be started, or shared memory cannot be used.
    pub fn start(config: &'a Config, extras: Extras) -> Result<Self, Failure> {
        if let Some(record) = &config.record {
            prepare_directory(record)?;
        }
        let bus = Bus::join_as_supervisor(&config.rig.name, Role::Supervise.as_str(), None)?;
        let limits = limits(config, &expected_format(config)?);
        let mut groups = vec![CameraGroup::open("", config, bus)?];
        for view in &config.views {
            let bus = Bus::join_as_supervisor(&view.config.rig.name, Role::Supervise.as_str(), Some(&groups[0].bus))?;
            groups.push(CameraGroup::open(&view.name, &view.config, bus)?);
        }
        let bus = &groups[0].bus;
        let mut supervisor = Self {
            program: std::env::current_exe()?,
            children: BTreeMap::new(),
            events: bus.subscriber(&limits)?,
            lines: extras.print.map(|print| ShotLines::new(bus, config, &limits, print)).transpose()?,
            statuses: BTreeMap::new(),
            reporter: StatusReporter::new(bus, &limits, Role::Supervise, 0)?,
            groups,
            clean_up: PeriodicTimer::new(CLEAN_UP_PERIOD),
            summary: Summary::default(),
            losses: BTreeMap::new(),
            restarts: 0,
            draining: None,
            leader: extras.leader,
            manager: ServiceManager::connect(),
        };
        let recorder = config.record.iter().map(|_| Child::first(Role::Record));
        let cameras = (0..).zip(&supervisor.groups).flat_map(|(camera, group)| group.children(camera));
        let children: Vec<Child> = recorder.chain(cameras).chain(page::page_process(config, extras.page)).collect();
        let rings = supervisor.groups.iter().map(|group| group.ring_bytes);
        bus::check_room(rings.sum(), children.len())?;
        for child in children {
            supervisor.children.insert(child, Running::default());
            supervisor.spawn(child, Start::First)?;
        }
        Ok(supervisor)
    }

    /// The bus of the main camera.
    fn bus(&self) -> &Bus {
        &self.groups[0].bus
    }

    /// Starts one process.
    fn spawn(&mut self, child: Child, start: Start) -> Result<(), Failure> {
        let group = &self.groups[child.camera as usize];
        let config = group.config;
        let mut command = Command::new(&self.program);
        command.arg(child.role.as_str()).arg("-").args(["--origin", &config.origin]);
        command.arg("--domain").arg(group.bus.domain().folder());
        if child.role == Role::Correlate {
            command.args(["--worker", &child.index.to_string()]);
        }
        if start == Start::Again {
            command.arg("--restarted");
        }
        // Its own process group: an interrupt from the terminal reaches only the supervisor, which stops the rig in
        // order.
        let is_stepped = child.role == Role::Acquire && config.camera.stepped;
        let stdout = match &self.leader {
            _ if !is_stepped => Stdio::null(),
            Some(_) => Stdio::piped(),
            None => Stdio::inherit(),
        };
        command.env_remove(service_manager::ADDRESS).stdin(Stdio::piped()).stdout(stdout).process_group(0);
        let free_bytes = bus::free_bytes();
        let mut process = command.spawn()?;
        let pipe = process.stdin.take().map(|stdin| SupervisorPipe::open(stdin, &config.text));
        if let (true, Some(pipe)) = (is_stepped, &pipe) {
            stepping::connect(pipe, process.stdout.take(), self.leader.as_ref());
        }
        if let Some(running) = self.children.get_mut(&child) {
            running.heartbeat = Heartbeat::default();
            running.free_at_start_bytes = free_bytes;
            (running.process, running.pipe, running.waits_for_memory) = (Some(process), pipe, false);
        }
        Ok(())
    }

    /// Monitors the processes until the stream ends, or until they have finished after a requested stop.
    fn run_until_end(
        &mut self,
        stop: &Stop,
        watch: &mut dyn FnMut(&BTreeMap<Child, StatusMessage>),
    ) -> Result<(), Failure> {
        while self.is_filming() && !stop.is_abandoned() {
            self.receive()?;
            watch(&self.statuses);
            if self.clean_up.restart_if_due() {
                self.bus().clean_up_dead();
            }
            if stop.requested() && self.draining.is_none() {
                if !self.kill_before_first_frame()? {
                    self.end_processes(|child| child.role == Role::Acquire);
                }
                self.draining = Some(Timeout::new(STOP_DRAIN_TIMEOUT));
                self.manager.report_stopping();
            }
            if self.draining.is_none() && self.have_cameras_ended() {
                self.draining = Some(Timeout::new(DRAIN_TIMEOUT));
            }
            self.reap()?;
            if self.draining.as_ref().is_some_and(Timeout::has_expired) {
                self.record_unfinished();
                return Ok(());
            }
            self.watch_heartbeats()?;
            self.restart_waiting()?;
            self.publish_status()?;
            std::thread::sleep(POLL_PERIOD);
        }
        Ok(())
    }

    /// Returns the number of processes that are alive.
    fn running_count(&self) -> usize {
        self.children.values().filter(|running| running.is_alive()).count()
    }

    /// Whether a process other than the page is alive.
    fn is_filming(&self) -> bool {
        self.children.iter().any(|(child, running)| child.role != Role::Serve && running.is_alive())
    }

    /// Records the processes that did not finish in time, and the number of frames that they are behind, in the
    /// summary.
    fn record_unfinished(&mut self) {
        let is_unfinished = |(child, running): &(&Child, &Running)| child.role != Role::Serve && running.is_alive();
        let unfinished = || self.children.iter().filter(is_unfinished).map(|(child, _)| *child);
        let sequence = |child: &Child| self.statuses.get(child).map(|status| status.sequence);
        let behind = |child: Child| {
            let newest = sequence(&Child { role: Role::Acquire, index: 0, ..child })?;
            // A recorder that waits for a trigger is never behind.
            let follows = child.role != Role::Record || self.groups[0].config.trigger.mode == TriggerMode::Off;
            follows.then(|| newest.saturating_sub(sequence(&child).unwrap_or(0)))
        };
        let farthest = unfinished().filter_map(|child| Some((behind(child)?, child))).max();
        let behind = farthest.map_or(0, |(behind, _)| behind);
        let names: Vec<String> = unfinished().map(|child| self.name(child)).collect();
        if let Some((lost, child)) = farthest {
            self.add_losses(child, lost, 0);
        }
        self.summary.causes.push(format!("{} did not finish in time, {behind} frames behind", names.join(", ")));
        self.summary.faults += 1;
    }

    /// Kills processes that hang, so that they are restarted; during the end of the stream none.
    fn watch_heartbeats(&mut self) -> Result<(), Failure> {
        if self.draining.is_some() {
            return Ok(());
        }
        let mut hung = Vec::new();
        for (child, running) in &mut self.children {
            let Some(process) = &mut running.process else { continue };
            if running.heartbeat.count_poll(process_state(process.id())) {
                running.heartbeat = Heartbeat::default();
                // An error means that it has just ended.
                let _ = process.kill();
                hung.push(*child);
            }
        }
        for child in hung {
            let text = format!("{} shows no sign of life and is killed", self.name(child));
            log::warn!("{text}");
            let frame = self.statuses.get(&child).map(frame_of).unwrap_or_default();
            self.reporter.publish_event(EventKind::Hung, frame, &text)?;
        }
        Ok(())
    }

    /// Whether the processes of all cameras have ended.
    fn have_cameras_ended(&self) -> bool {
        let mut cameras = self.children.iter().filter(|(child, _)| child.role == Role::Acquire);
        cameras.all(|(_, running)| running.code.is_some())
    }

    /// Reads new status messages, collisions and events; prints the lines of events and collects recordings.
    fn receive(&mut self) -> Result<(), Failure> {
        for (camera, group) in (0..).zip(&self.groups) {
            while let Some(status) = group.status.take()? {
                if let Some(role) = Role::from_number(status.role) {
                    let child = Child { camera, role, index: status.index };
                    // The last status of a predecessor is no sign of life.
                    if let Some(running) = self.children.get_mut(&child).filter(|it| it.is_process(status.pid)) {
                        running.heartbeat.record();
                    }
                    self.statuses.insert(child, status);
                }
            }
        }
        if let Some(lines) = &mut self.lines {
            lines.note_impacts()?;
        }
        while let Some(event) = self.events.take()? {
            if let Some(lines) = &mut self.lines {
                lines.print(&event);
            }
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
                Some(code) if code == 0 || ExitCode::from_number(code) == ExitCode::DataLost => {
                    running.code = Some(code);
                    self.count_losses(child, code);
                    self.end_idle_readers()?;
                }
                _ if child.role == Role::Serve => self.replace_page(child, status)?,
                code => self.handle_death(child, code, status)?,
            }
        }
        Ok(())
    }

    /// Counts the losses of a process that has ended, at least one, if this exit code reports lost data.
    fn count_losses(&mut self, child: Child, code: i32) {
        if ExitCode::from_number(code) != ExitCode::DataLost {
            return;
        }
        let [lost, dropped] = self.statuses.get(&child).map_or([0; 2], |status| [status.lost, status.dropped]);
        let lost = lost.max(u64::from(dropped == 0));
        self.add_losses(child, lost, dropped);
        self.summary.causes.push(format!("{} lost {}", self.name(child), lost + dropped));
    }

    /// Adds the losses of a process to those of its predecessors.
    fn add_losses(&mut self, child: Child, lost: u64, dropped: u64) {
        let losses = self.losses.entry(child).or_insert_with(|| losses_of(child, &StatusMessage::default()));
        losses.lost += lost;
        losses.dropped += dropped;
    }

    /// Counts a death and restarts the process. A dead camera process is not restarted during the end of the stream.
    ///
    /// # Errors
    ///
    /// [`ChildFailure`] if a restart cannot help or the process has died too often.
    fn handle_death(&mut self, child: Child, code: Option<i32>, status: ExitStatus) -> Result<(), Failure> {
        let role = child.role.as_str();
        // Its last words may have come since.
        self.receive()?;
        let last = self.statuses.remove(&child).unwrap_or_default();
        let Some(running) = self.children.get_mut(&child) else { return Ok(()) };
        let is_memory = running.check_lack_of_memory(status);
        let memory_text = match is_memory {
            true => format!(" for want of shared memory ({} bytes are free in /dev/shm)", bus::free_bytes()),
            false => String::new(),
        };
        let name = self.name(child);
        let counted = last.lost + last.dropped;
        let losses = if counted > 0 { format!(" after it had lost {counted}") } else { String::new() };
        self.summary.faults += 1;
        self.add_losses(child, last.lost, last.dropped);
        self.summary.causes.push(format!("{name} ended with {status}{memory_text}{losses}"));
        self.bus().clean_up_dead();
        let Some(running) = self.children.get_mut(&child) else { return Ok(()) };
        // A refused configuration, a missing camera or an unreadable film will not get better by a restart.
        let is_reported = match code.map(ExitCode::from_number) {
            Some(ExitCode::Usage | ExitCode::Camera) => true,
            Some(ExitCode::Recording) => child.role == Role::Acquire,
            _ => false,
        };
        if is_reported || !(is_memory || running.deaths.count_death()) {
            return Err(ChildFailure { role, code: code.unwrap_or(1), is_reported }.into());
        }
        if self.draining.is_some() && child.role == Role::Acquire {
            // The dead process will not announce the end of the stream.
            self.end_processes(|_| true);
            return Ok(());
        }
        let text = format!("{name} ended with {status}{memory_text} and was restarted");
        log::warn!("{text}");
        running.waits_for_memory = true;
        self.restarts += 1;
        self.reporter.publish_event(EventKind::Restarted, frame_of(&last), &text)?;
        self.restart_waiting()
    }

    /// Restarts the processes that died, once there is room for them.
    fn restart_waiting(&mut self) -> Result<(), Failure> {
        let waiting: Vec<Child> =
            self.children.iter().filter(|(_, running)| running.has_room()).map(|(child, _)| *child).collect();
        waiting.into_iter().try_for_each(|child| self.spawn(child, Start::Again))
    }

    /// Returns the name of a process for messages.
    fn name(&self, child: Child) -> String {
        let name = format!("{} {}", child.role.as_str(), child.index);
        match self.groups[child.camera as usize].name {
            "" => name,
            camera => format!("{name} of {camera}"),
        }
    }

    /// Reports the state of the rig to the service manager and on the bus.
    fn publish_status(&mut self) -> Result<(), Failure> {
        let newest = self.statuses.values().map(frame_of).max().unwrap_or_default();
        let has_reported =
            |(child, running): (&Child, &Running)| running.code.is_some() || self.statuses.contains_key(child);
        let is_ready = self.children.iter().all(has_reported);
        let (statuses, restarts) = (&self.statuses, self.restarts);
        self.manager.report(is_ready, || {
            let cameras = statuses.iter().filter(|(child, _)| child.role == Role::Acquire);
            let rates: Vec<String> = cameras.map(|(_, status)| format!("{:.0}", status.rate_hz)).collect();
            let counted = statuses.iter().map(|(child, status)| losses_of(*child, status));
            let lost = RigLosses::of(counted).largest();
            format!(
                "{} frames per second, frame {}, {lost} lost, {restarts} restarts",
                rates.join(" and "),
                newest.sequence
            )
        });
        self.reporter.set_state(self.running_count() as u32);
        self.reporter.set_restarts(self.restarts);
        Ok(self.reporter.publish_status_if_due(&self.summary, newest)?)
    }

    /// Asks the selected processes to end regularly.
    fn end_processes(&self, is_selected: impl Fn(&Child) -> bool) {
        let selected = self.children.iter().filter(|(child, _)| is_selected(child));
        selected.filter_map(|(_, running)| running.pipe.as_ref()).for_each(SupervisorPipe::end);
    }

    /// Kills the selected processes that still run.
    fn kill_processes(&mut self, is_selected: impl Fn(&Child) -> bool) {
        let selected = self.children.iter_mut().filter(|(child, _)| is_selected(child));
        for mut process in selected.filter_map(|(_, running)| running.process.take()) {
            // An error means that it has just ended.
            let _ = process.kill();
            let _ = process.wait();
        }
    }

    /// Ends every process that still runs. The page stays until the others have ended.
    fn stop_all(&mut self) {
        self.children.values_mut().for_each(|running| running.waits_for_memory = false);
        self.stop_processes(|child| child.role != Role::Serve);
        self.stop_processes(|_| true);
        self.bus().clean_up_dead();
    }

    /// Asks the selected processes to end, and kills those that still run after [`STOP_TIMEOUT`].
    fn stop_processes(&mut self, is_selected: impl Fn(&Child) -> bool) {
        self.end_processes(&is_selected);
        let timeout = Timeout::new(STOP_TIMEOUT);
        let is_left = |(child, running): (&Child, &Running)| is_selected(child) && running.is_alive();
        while self.children.iter().any(is_left) && !timeout.has_expired() {
            let mut ended = Vec::new();
            for (child, running) in self.children.iter_mut().filter(|(child, _)| is_selected(child)) {
                let Some(process) = &mut running.process else { continue };
                match process.try_wait() {
                    Ok(None) => continue,
                    Ok(Some(status)) => ended.push((*child, status.code().unwrap_or(1))),
                    Err(_) => {}
                }
                running.process = None;
            }
            ended.iter().for_each(|(child, code)| self.count_losses(*child, *code));
            std::thread::sleep(POLL_PERIOD);
        }
        self.kill_processes(is_selected);
    }
}

/// Returns the losses that a process has reported.
fn losses_of(child: Child, status: &StatusMessage) -> ProcessLosses {
    ProcessLosses { camera: child.camera, role: child.role, lost: status.lost, dropped: status.dropped }
}

/// Returns the newest frame that a process has reported.
fn frame_of(status: &StatusMessage) -> FrameStamp {
    FrameStamp { sequence: status.sequence, stamp_ns: status.stamp_ns }
}
