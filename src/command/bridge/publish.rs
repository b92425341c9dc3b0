//! The threads that publish the topics of a rig, one per topic, because shared memory is read by plain threads.

use super::super::listen::{event_row, impact_row, status_row, track_row, velocity_row};
use super::overflow::Overflow;
use super::session::key;
use crate::bus::{Bus, BusError, Limits, Topic};
use crate::process::Stop;
use serde_json::{Map, Value};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;
use zenoh::bytes::Encoding;
use zenoh::qos::CongestionControl;
use zenoh::{Session, Wait};
use zenoh_ext::{AdvancedPublisher, AdvancedPublisherBuilderExt, CacheConfig, MissDetectionConfig};

/// The number of rows of each frame that are kept for readers whose link was away: 16 s at 1000 rows per second.
const FRAME_ROWS: usize = 16_384;
/// The number of other rows that are kept, also for late readers.
pub(super) const OTHER_ROWS: usize = 256;
/// Interval of the number of the last row, by which readers detect that they missed it.
const HEARTBEAT: Duration = Duration::from_millis(100);
/// Interval of looking for rows.
const PAUSE: Duration = Duration::from_millis(1);
/// Interval of looking for a rig that does not run.
const RETRY: Duration = Duration::from_millis(200);
/// The number of looks in vain between two checks that the rig is alive, half a second.
const CHECKED_LOOKS: u32 = 500;

/// A thread that publishes a topic.
struct TopicThread<'a> {
    session: &'a Session,
    rig: &'a str,
    stop: &'a Stop,
    /// The number of frames whose rows were overwritten before they were read.
    overwritten: &'a Arc<AtomicU64>,
}

/// Starts a thread per topic; they end when a stop is requested. Frames whose rows come too late for them are counted.
///
/// # Errors
///
/// That of Zenoh when a key cannot be declared.
pub(super) fn start(
    session: &Session,
    rig: &str,
    stop: &Stop,
    overwritten: &Arc<AtomicU64>,
) -> zenoh::Result<Vec<JoinHandle<()>>> {
    let thread = TopicThread { session, rig, stop, overwritten };
    Ok(vec![
        thread.start(FRAME_ROWS, velocity_row)?,
        thread.start(FRAME_ROWS, track_row)?,
        thread.start(OTHER_ROWS, impact_row)?,
        thread.start(OTHER_ROWS, status_row)?,
        thread.start(OTHER_ROWS, event_row)?,
    ])
}

impl TopicThread<'_> {
    /// Starts the thread of a topic, with a cache of `cached_rows` rows.
    fn start<T: Topic>(
        &self,
        cached_rows: usize,
        row: fn(&T) -> Option<Map<String, Value>>,
    ) -> zenoh::Result<JoinHandle<()>> {
        let publisher = self
            .session
            .declare_publisher(key(self.rig, T::NAME))
            .encoding(Encoding::APPLICATION_JSON)
            // A full link must not hold up the topic. Readers fetch what was dropped from the cache.
            .congestion_control(CongestionControl::Drop)
            .cache(CacheConfig::default().max_samples(cached_rows))
            .sample_miss_detection(MissDetectionConfig::default().heartbeat(HEARTBEAT))
            .publisher_detection()
            .wait()?;
        let (rig, stop, overwritten) = (self.rig.to_owned(), self.stop.clone(), Arc::clone(self.overwritten));
        let output = TopicOutput { publisher, row, overwritten };
        Ok(std::thread::spawn(move || {
            while !stop.requested() {
                match publish_run(&rig, &output, &stop) {
                    Ok(()) | Err(BusError::NoRig { .. }) => {}
                    Err(error) => log::warn!("{error}; trying again"),
                }
                std::thread::sleep(RETRY);
            }
        }))
    }
}

/// The output of a topic.
struct TopicOutput<T> {
    publisher: AdvancedPublisher<'static>,
    row: fn(&T) -> Option<Map<String, Value>>,
    overwritten: Arc<AtomicU64>,
}

impl<T: Topic> TopicOutput<T> {
    /// Publishes a message and returns its frame, if it has one.
    fn publish(&self, message: &T) -> Option<u64> {
        let row = (self.row)(message)?;
        let frame = row.get("frame").and_then(Value::as_u64);
        if let Err(error) = self.publisher.put(Value::Object(row).to_string()).wait() {
            log::warn!("a row of {} was not published: {error}", T::NAME);
        }
        frame
    }

    /// Counts and reports frames whose rows were overwritten before they were read.
    fn count_overwritten(&self, frames: u64) {
        if frames > 0 {
            self.overwritten.fetch_add(frames, Ordering::Relaxed);
            log::warn!("the bridge was too slow: rows of {} of {frames} frames were overwritten", T::NAME);
        }
    }
}

/// Publishes the rows of one run of the rig until it ends or a stop is requested.
///
/// # Errors
///
/// [`BusError::NoRig`] while the rig does not run.
fn publish_run<T: Topic>(rig: &str, output: &TopicOutput<T>, stop: &Stop) -> Result<(), BusError> {
    if !Bus::is_running(rig) {
        return Ok(());
    }
    let bus = Bus::join(rig, "bridge")?;
    let topic = bus.listen::<T>()?;
    let mut overflow = Overflow::new(Limits::small_depth());
    let mut looks = 0;
    while !stop.requested() {
        while let Some(message) = topic.take()? {
            looks = 0;
            overflow.add(output.publish(&message));
        }
        output.count_overwritten(overflow.end_look());
        looks += 1;
        if looks > CHECKED_LOOKS {
            looks = 0;
            if !bus.is_alive() {
                return Ok(());
            }
        }
        std::thread::sleep(PAUSE);
    }
    Ok(())
}
