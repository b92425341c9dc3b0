//! The delivery time of frames that are copied or drawn instead of captured.

use std::time::{Duration, Instant};

/// Models the time at which a live camera would have delivered each frame.
///
/// Live cameras fill memory in the background. Replayed and simulated frames are written by the consumer's own thread,
/// which some machines interrupt for milliseconds (page faults under a hypervisor, a busy disk). That time belongs to
/// the camera, not to its consumer. So the transfer of a frame starts when the frame is due and the previous one is
/// complete, and takes the measured time.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct DeliveryLatency {
    /// When the transfer of the last frame was complete; `None` before the first frame.
    delivered: Option<Instant>,
}

impl DeliveryLatency {
    /// Records a frame that was due at `due` and took `duration` to write.
    ///
    /// It counts as delivered `duration` after the later of `due` and the delivery of the previous frame.
    pub fn record(&mut self, due: Instant, duration: Duration) {
        self.delivered = self.delivered.map_or(due, |last| last.max(due)).checked_add(duration);
    }

    /// Returns the time from the delivery of the last frame to `now`; zero before it and before the first frame.
    pub fn age(&self, now: Instant) -> Duration {
        self.delivered.map_or(Duration::ZERO, |delivered| now.saturating_duration_since(delivered))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[expect(clippy::disallowed_methods, reason = "an arbitrary start time")]
    fn writing_a_frame_does_not_count_towards_its_age_and_waiting_for_the_consumer_does() {
        let (start, ms) = (Instant::now(), Duration::from_millis);
        let mut delivery = DeliveryLatency::default();
        assert_eq!(delivery.age(start), Duration::ZERO);
        delivery.record(start + ms(10), ms(3));
        assert_eq!(delivery.age(start + ms(15)), ms(2));
        // Due while the previous one was still being written.
        delivery.record(start + ms(11), ms(1));
        assert_eq!(delivery.age(start + ms(20)), ms(6));
        delivery.record(start + ms(30), ms(1));
        assert_eq!(delivery.age(start + ms(30)), Duration::ZERO);
    }
}
