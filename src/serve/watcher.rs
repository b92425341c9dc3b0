//! The thread that follows the state of the rig, its events and its collisions.

use super::clock::now;
use super::control::Control;
use super::feed::{Feed, MAX_BATCH_ROWS};
use super::heartbeat::{Heartbeat, TurnCounter};
use super::outlets::Outlets;
use super::rig_state::PageState;
use super::rows::{self, RowContext};
use super::shots::Shots;
use super::snapshot::{StateText, States, snapshot};
use super::topics::Link;
use crate::bus::{Bus, BusError, Subscriber, Topic};
use crate::config::Config;
use crate::message::{Event, ImpactMessage, StatusMessage};
use serde_json::{Map, Value};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Interval of reading the topics.
const PERIOD: Duration = Duration::from_millis(10);
/// Interval of looking at the reports of processes. Events and collisions are published at once.
const STATUS_PERIOD: Duration = Duration::from_millis(100);
/// Interval of publishing a state that has not changed, so that a page notices within a second that the server is gone.
const REPEAT: Duration = Duration::from_millis(250);
/// Interval of checking whether a process of the rig is alive.
const ALIVE_PERIOD: Duration = Duration::from_millis(250);

/// The outputs of the watcher.
pub(super) struct Outputs {
    pub(super) impact: Feed,
    pub(super) events: Feed,
    pub(super) state: States,
    pub(super) outlets: Arc<Outlets>,
    /// Wakes the reader of the recordings.
    pub(super) recorded: std::sync::mpsc::SyncSender<()>,
    /// The turns of the server, for the supervisor of this process.
    pub(super) turns: Option<TurnCounter>,
}

/// The topics of a running rig.
struct Topics {
    // Drop order: the topics go before the bus that they were opened on.
    events: Subscriber<Event>,
    impacts: Subscriber<ImpactMessage>,
    statuses: Subscriber<StatusMessage>,
    heartbeat: Option<Heartbeat>,
    bus: Bus,
}

impl Topics {
    /// Opens the topics of a rig; `None` when it does not run.
    fn open(rig: &str, turns: Option<&TurnCounter>) -> Result<Option<Self>, BusError> {
        if !Bus::is_running(rig) {
            return Ok(None);
        }
        let bus = Bus::join(rig, "serve")?;
        let (events, impacts, statuses) = (bus.listen()?, bus.listen()?, bus.listen()?);
        let heartbeat = turns.map(|turns| Heartbeat::new(&bus, turns.clone())).transpose()?;
        Ok(Some(Self { events, impacts, statuses, heartbeat, bus }))
    }
}

/// Follows the rig.
pub(super) struct Watcher<'a> {
    config: &'a Config,
    link: &'a Link,
    shots: &'a Shots,
    control: &'a Control,
    outputs: Outputs,
    context: RowContext,
    rig: PageState,
    /// The start of the watcher, from which the page's clock counts.
    began: Instant,
}

impl<'a> Watcher<'a> {
    pub(super) fn new(
        config: &'a Arc<Config>,
        link: &'a Link,
        shots: &'a Shots,
        control: &'a Control,
        outputs: Outputs,
    ) -> Self {
        let bodies = config.bodies.iter().map(|body| body.name.clone()).collect();
        let context = RowContext { bodies, origin_ns: None };
        Self { link, shots, control, outputs, context, rig: PageState::new(Arc::clone(config)), began: now(), config }
    }

    /// Returns the time since the start of the watcher, s.
    fn now_s(&self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }

    /// Follows the rig and publishes its state, events and collisions until a stop is requested.
    pub(super) fn run(mut self) {
        let mut topics = None;
        let (mut checked, mut looked, mut published) = (None::<Instant>, None::<Instant>, None::<Instant>);
        let mut last = String::new();
        while !self.link.stop.requested() {
            let is_due = |at: Option<Instant>, period| at.is_none_or(|at: Instant| at.elapsed() >= period);
            if is_due(checked, ALIVE_PERIOD) {
                checked = Some(now());
                self.open_or_close(&mut topics);
            }
            let news = topics.as_mut().map_or(Ok(false), |open| self.read_topics(open)).unwrap_or_else(|error| {
                log::warn!("{error}; trying again");
                topics = None;
                true
            });
            self.link.set_origin(self.rig.origin_ns);
            if news || is_due(looked, STATUS_PERIOD) {
                looked = Some(now());
                let text = self.snapshot_text();
                if text != last || is_due(published, REPEAT) {
                    published = Some(now());
                    self.outputs.state.send_replace(StateText::new(&text));
                    last = text;
                }
            }
            std::thread::sleep(PERIOD);
        }
    }

    /// Opens the topics of a rig that was started, and closes those of one that is gone.
    ///
    /// Nothing of a rig that is gone is held open, so that its successor can have other limits.
    fn open_or_close(&mut self, topics: &mut Option<Topics>) {
        if topics.as_ref().is_some_and(|open| !open.bus.is_alive()) {
            *topics = None;
            self.rig.reset();
        }
        let is_new = topics.is_none();
        if is_new {
            *topics = Topics::open(&self.config.rig.name, self.outputs.turns.as_ref()).unwrap_or_else(|error| {
                // The processes may be about to create them.
                log::debug!("{error}; trying again");
                None
            });
        }
        self.rig.is_running = topics.is_some();
        match topics {
            Some(_) if is_new => self.link.begin_run(),
            Some(_) => {}
            None => self.link.end_run(),
        }
    }

    /// Reads all topics, updates the state and sends events and collisions to the clients; returns whether there was an
    /// event or a collision.
    fn read_topics(&mut self, topics: &mut Topics) -> Result<bool, BusError> {
        if let Some(heartbeat) = &mut topics.heartbeat {
            heartbeat.publish_if_due()?;
        }
        let now_s = self.now_s();
        for status in take_all(&topics.statuses)? {
            self.rig.add_status(&status, now_s);
        }
        let events = take_all(&topics.events)?;
        for event in &events {
            let (shots, recorded) = (self.shots, &self.outputs.recorded);
            let number = || {
                // The reader may be at work already, and then finds the new recording too.
                let _ = recorded.try_send(());
                shots.list()
            };
            self.rig.add_event(event, number, now_s);
        }
        let impacts = take_all(&topics.impacts)?;
        impacts.iter().filter_map(ImpactMessage::impact).for_each(|impact| self.rig.add_impact(impact));
        self.context.origin_ns = self.rig.origin_ns;
        send_in_batches(&self.outputs.events, events.iter().filter_map(|event| rows::event_row(event, &self.context)));
        send_in_batches(
            &self.outputs.impact,
            impacts.iter().filter_map(|impact| rows::impact_row(impact, &self.context)),
        );
        Ok(!events.is_empty() || !impacts.is_empty())
    }

    /// Returns the present state of the rig as JSON text.
    fn snapshot_text(&self) -> String {
        let now_s = self.now_s();
        let mut snapshot = snapshot(self.config, &self.rig, self.shots, self.control, now_s);
        snapshot["udp"] = self.outputs.outlets.udp_json(&self.config.serve);
        snapshot["mqtt"] = self.outputs.outlets.mqtt_json(&self.config.serve);
        snapshot.to_string()
    }
}

/// Takes all unread messages of a topic, the oldest first.
fn take_all<T: Topic>(topic: &Subscriber<T>) -> Result<Vec<T>, BusError> {
    let mut all = Vec::new();
    while let Some(message) = topic.take()? {
        all.push(message);
    }
    Ok(all)
}

/// Sends rows to the clients of a topic, at most [`MAX_BATCH_ROWS`] at a time.
fn send_in_batches(feed: &Feed, rows: impl Iterator<Item = Map<String, Value>>) {
    let rows: Vec<_> = rows.collect();
    rows.chunks(MAX_BATCH_ROWS).for_each(|batch| feed.send(batch));
}
