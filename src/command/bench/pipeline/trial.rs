//! One run of the rig, and its figures.

use super::rig::{self, Folder};
use super::usage::Usage;
use super::{Plan, memory};
use crate::config::Workers;
use crate::console::progress;
use crate::failure::Failure;
use crate::message::{Role, StatusMessage};
use crate::process::{self, Child, Extras, Stop, Summary};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// The part of the filming time by which the last row may be late. At a rate that is too high by more, it is later.
const MAX_BEHIND: f64 = 0.02;

/// The minimum time between two readings of the resources of a process.
const READING_PERIOD: Duration = Duration::from_millis(200);

/// The figures of one run.
#[derive(Debug)]
pub(super) struct Trial {
    pub(super) plan: Plan,
    /// The frames of the ring, as the rig has it.
    pub(super) ring_frames: u64,
    /// The number of correlation workers, and of frames that one measures together.
    pub(super) workers: u32,
    pub(super) block_frames: u32,
    /// Frames that the camera took.
    pub(super) frames: u64,
    /// Rows on `velocity`, one for each frame.
    pub(super) rows: u64,
    /// Frames that the camera lost.
    pub(super) lost: u64,
    /// Frames without a row, or whose row shows that the frame or its result was lost.
    pub(super) not_measured: u64,
    /// The losses, deaths and causes of the rig.
    pub(super) summary: Summary,
    /// Latencies from the stamp of a frame to its row.
    pub(super) latency: Latency,
    /// Time from the last frame to its row, s.
    pub(super) behind_s: f64,
    /// The bytes that one core copied per second right after it (`memcpy`).
    pub(super) copied_bytes_per_s: f64,
    /// The processes, in the order in which a frame passes them.
    pub(super) processes: Vec<ProcessFigures>,
}

/// Latencies from the stamp of a frame to the publication of its row, s.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Latency {
    pub(super) median_s: f64,
    pub(super) p99_s: f64,
    pub(super) p999_s: f64,
    pub(super) max_s: f64,
    pub(super) deviation_s: f64,
}

/// The figures of one process.
#[derive(Debug)]
pub(super) struct ProcessFigures {
    pub(super) child: Child,
    /// Its last report.
    pub(super) status: StatusMessage,
    /// The frames that the following resources were used for.
    pub(super) measured_frames: u64,
    /// The time in which they were used, s.
    pub(super) measured_s: f64,
    pub(super) used: Usage,
}

impl ProcessFigures {
    /// Returns the processor time per frame, us; `None` if no frame came while it was monitored.
    pub(super) fn cpu_us_per_frame(&self) -> Option<f64> {
        (self.measured_frames > 0).then(|| 1e-3 * self.used.cpu_ns as f64 / self.measured_frames as f64)
    }

    /// Returns a count as a number per second; 0 if the process was not monitored.
    pub(super) fn per_s(&self, count: u64) -> f64 {
        if self.measured_s > 0.0 { count as f64 / self.measured_s } else { 0.0 }
    }
}

impl Trial {
    /// Returns the reasons why the rig did not keep up; none if it did.
    pub(super) fn shortfalls(&self) -> Vec<String> {
        let mut reasons = Vec::new();
        if self.lost > 0 {
            reasons.push(format!("the camera lost {} frames", self.lost));
        }
        if self.not_measured > 0 {
            reasons.push(format!("{} of {} frames not measured", self.not_measured, self.frames));
        }
        if self.summary.losses() > 0 || self.summary.faults > 0 {
            reasons.push(self.summary.causes.join(", "));
        } else if self.behind_s > self.max_behind_s() {
            let frames = self.behind_s * self.plan.rate_hz;
            reasons.push(format!("{frames:.0} frames behind at the end ({:.2} s)", self.behind_s));
        }
        reasons
    }

    /// Returns the time by which the last row may be late, s.
    fn max_behind_s(&self) -> f64 {
        MAX_BEHIND * self.frames as f64 / self.plan.rate_hz
    }

    /// Returns the bytes of frames that the camera took per second.
    pub(super) fn frame_bytes_per_s(&self) -> f64 {
        self.plan.scene.frame_bytes() as f64 * self.plan.rate_hz
    }

    /// Returns the processor time of all processes per frame, us.
    pub(super) fn cpu_us_per_frame(&self) -> f64 {
        self.processes.iter().filter_map(ProcessFigures::cpu_us_per_frame).sum()
    }
}

/// Runs the rig for the time of the plan; `None` if it was stopped before.
///
/// # Errors
///
/// When the rig cannot be started, or one of its processes cannot continue.
pub(super) fn run(plan: &Plan, folder: &Folder, stop: &Stop) -> Result<Option<Trial>, Failure> {
    let config = rig::build(plan, folder)?;
    let bar = progress::bar((plan.rate_hz * plan.seconds) as u64, "bench");
    let rig_stop = Stop::default();
    let mut monitor = ProcessMonitor::default();
    let summary = process::supervise(&config, &rig_stop, Extras::default(), |statuses| {
        monitor.update(statuses);
        bar.set_position(monitor.tracker_report().given);
        if stop.requested() {
            rig_stop.abandon();
        } else if monitor.filming_s() >= plan.seconds {
            rig_stop.request();
        }
    });
    bar.finish_and_clear();
    if stop.requested() {
        return Ok(None);
    }
    Ok(Some(monitor.into_trial(plan, &config.workers, summary?)))
}

/// The processes of a rig while it runs.
#[derive(Debug, Default)]
struct ProcessMonitor {
    /// When the first frame was reported.
    began: Option<Instant>,
    processes: BTreeMap<Child, MonitoredProcess>,
}

/// A process while the rig runs.
#[derive(Debug)]
struct MonitoredProcess {
    status: StatusMessage,
    /// From the first report of the camera that it films.
    first: Option<Reading>,
    last: Option<Reading>,
}

/// The resources of a process when it reported.
#[derive(Debug, Clone, Copy)]
struct Reading {
    at: Instant,
    taken: u64,
    usage: Usage,
}

impl ProcessMonitor {
    /// Updates the reports, and reads the resources of the processes that sent them.
    fn update(&mut self, statuses: &BTreeMap<Child, StatusMessage>) {
        if self.began.is_none() && statuses.get(&Child::first(Role::Acquire)).is_some_and(|camera| camera.taken > 0) {
            self.began = Some(now());
        }
        for (child, status) in statuses {
            let process =
                self.processes.entry(*child).or_insert(MonitoredProcess { status: *status, first: None, last: None });
            // A process without frames reports nothing new.
            let is_new = *status != process.status || status.taken == 0;
            let is_due = process.last.is_none_or(|last| now().duration_since(last.at) >= READING_PERIOD);
            process.status = *status;
            if !(is_new && is_due) || self.began.is_none() {
                continue;
            }
            let Some(usage) = Usage::read(status.pid) else { continue };
            let reading = Reading { at: now(), taken: status.taken, usage };
            process.first.get_or_insert(reading);
            process.last = Some(reading);
        }
    }

    /// Returns the time since the first frame was reported, s; 0 before.
    fn filming_s(&self) -> f64 {
        self.began.map_or(0.0, |began| now().duration_since(began).as_secs_f64())
    }

    /// Returns the last report of the first process of this role; an empty one before the first.
    fn report(&self, role: Role) -> StatusMessage {
        self.processes.get(&Child::first(role)).map(|process| process.status).unwrap_or_default()
    }

    /// Returns the last report of the tracker.
    fn tracker_report(&self) -> StatusMessage {
        self.report(Role::Track)
    }

    /// Returns the figures of the run that has ended.
    fn into_trial(self, plan: &Plan, workers: &Workers, summary: Summary) -> Trial {
        let (tracker, camera) = (self.tracker_report(), self.report(Role::Acquire));
        let filmed = self.processes.get(&Child::first(Role::Acquire)).map_or(0, MonitoredProcess::frames);
        let figures = |(child, process): (&Child, &MonitoredProcess)| {
            let own = process.frames();
            let readings = process.first.zip(process.last);
            ProcessFigures {
                child: *child,
                status: process.status,
                // A recorder that waits takes none.
                measured_frames: if own > 0 { own } else { filmed },
                measured_s: readings.map_or(0.0, |(first, last)| last.at.duration_since(first.at).as_secs_f64()),
                used: readings.map(|(first, last)| last.usage.since(&first.usage)).unwrap_or_default(),
            }
        };
        Trial {
            plan: plan.clone(),
            ring_frames: self.report(Role::Correlate).capacity,
            workers: workers.count,
            block_frames: workers.block_frames,
            frames: camera.given,
            rows: tracker.given,
            lost: camera.lost + camera.dropped,
            not_measured: tracker.lost + camera.given.saturating_sub(tracker.given),
            summary,
            latency: Latency {
                median_s: tracker.row_latency_median_s,
                p99_s: tracker.row_latency_p99_s,
                p999_s: tracker.row_latency_p999_s,
                max_s: tracker.row_latency_max_s,
                deviation_s: tracker.row_latency_deviation_s,
            },
            behind_s: tracker.latency_s,
            copied_bytes_per_s: memory::copied_bytes_per_s(plan.scene.frame_bytes()),
            processes: self.processes.iter().map(figures).collect(),
        }
    }
}

impl MonitoredProcess {
    /// Returns the frames that it took between the first and the last reading of its resources.
    fn frames(&self) -> u64 {
        self.first.zip(self.last).map_or(0, |(first, last)| last.taken - first.taken)
    }
}

/// Reads the clock.
#[expect(clippy::disallowed_methods, reason = "a benchmark reads the clock")]
fn now() -> Instant {
    Instant::now()
}
