//! The readers of the frames and their progress, as acquisition and the tracker see them.

use super::clock::Timeout;
use super::stop::Stop;
use crate::bus::{Bus, BusError, Limits, Subscriber};
use crate::config::{Config, TriggerMode};
use crate::message::{Progress, Role};
use std::collections::BTreeMap;
use std::ops::Range;
use std::time::Duration;

/// Time that an on-demand source waits for readers that make no progress.
const STALL_TIMEOUT: Duration = Duration::from_secs(10);

/// The readers of the frames and their progress.
pub(super) struct Readers {
    progress: Subscriber<Progress>,
    expected: Vec<Reader>,
    /// Readers that take frames all the time; an armed recorder does so only after a trigger.
    paced_by: Vec<Reader>,
    /// The latest progress of each reader.
    latest: BTreeMap<Reader, Progress>,
    /// Maximum number of frames that an on-demand source is ahead of its slowest reader.
    window: u64,
}

/// A reader by its role number and index.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Reader {
    role: u32,
    index: u32,
}

impl Readers {
    pub(super) fn new(bus: &Bus, limits: &Limits, config: &Config) -> Result<Self, BusError> {
        let reader = |role: Role, index| Reader { role: role as u32, index };
        let workers = (0..limits.workers).map(|index| reader(Role::Correlate, index));
        let recorder = config.record.iter().map(|_| reader(Role::Record, 0));
        let streaming = config.trigger.mode == TriggerMode::Off;
        let paced_by = workers.clone().chain(recorder.clone().filter(|_| streaming)).collect();
        let tracker = (limits.workers > 0).then_some(reader(Role::Track, 0));
        let expected = workers.chain(recorder).chain(tracker).collect();
        // A quarter of the ring in flight keeps every reader busy and every queue far from overflow.
        let window = (limits.ring_frames as u64 / 4).max(8);
        Ok(Self { progress: bus.subscriber(limits)?, expected, paced_by, latest: BTreeMap::new(), window })
    }

    /// Follows the workers alone.
    pub(super) fn workers(bus: &Bus, limits: &Limits) -> Result<Self, BusError> {
        let expected = (0..limits.workers).map(|index| Reader { role: Role::Correlate as u32, index }).collect();
        let progress = bus.subscriber(limits)?;
        Ok(Self { progress, expected, paced_by: Vec::new(), latest: BTreeMap::new(), window: 0 })
    }

    /// Reads new progress messages; returns whether there were any.
    fn update(&mut self) -> Result<bool, BusError> {
        let mut news = false;
        while let Some(progress) = self.progress.take()? {
            self.latest.insert(Reader { role: progress.role, index: progress.index }, progress);
            news = true;
        }
        Ok(news)
    }

    /// Reads new progress and returns whether every reader has attached to this run.
    pub(super) fn all_attached(&mut self, run_id: u64) -> Result<bool, BusError> {
        self.update()?;
        Ok(self.expected.iter().all(|reader| self.latest.get(reader).is_some_and(|progress| progress.run_id == run_id)))
    }

    /// Returns the names of the readers that have not attached to this run, separated by commas.
    pub(super) fn missing(&self, run_id: u64) -> String {
        let is_absent = |reader: &&Reader| self.latest.get(reader).is_none_or(|progress| progress.run_id != run_id);
        let names = self.expected.iter().filter(is_absent).map(|reader| {
            let name = Role::from_number(reader.role).map_or("", Role::as_str);
            format!("{name} {}", reader.index)
        });
        names.collect::<Vec<_>>().join(", ")
    }

    /// Reads new progress and returns whether every reader is done with this run.
    pub(super) fn all_done(&mut self, run_id: u64) -> Result<bool, BusError> {
        self.update()?;
        let is_done = |progress: &Progress| progress.run_id == run_id && progress.done == 1;
        Ok(self.expected.iter().all(|reader| self.latest.get(reader).is_some_and(is_done)))
    }

    /// Waits until the slowest reader has room for one more frame, or for a stop. `published` are the sequence numbers
    /// of the published frames.
    ///
    /// A reader without progress for [`STALL_TIMEOUT`] is dead or hangs, and the stream continues without it.
    pub(super) fn wait_for_room(&mut self, run_id: u64, published: Range<u64>, stop: &Stop) -> Result<(), BusError> {
        let mut timeout = Timeout::new(STALL_TIMEOUT);
        while !stop.requested() && !timeout.has_expired() {
            if self.update()? {
                timeout.renew();
            }
            let is_behind = |reader| {
                self.latest.get(reader).is_some_and(|progress: &Progress| {
                    let reached = progress.next_sequence.max(published.start);
                    progress.run_id == run_id && reached.saturating_add(self.window) <= published.end
                })
            };
            if !self.paced_by.iter().any(is_behind) {
                break;
            }
            std::thread::sleep(Duration::from_micros(200));
        }
        Ok(())
    }
}
