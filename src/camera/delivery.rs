//! When frames of a film are there.

use std::time::{Duration, Instant};

/// The clock of a camera that is played: what brings a frame into its slot is the camera's work, not its taker's.
///
/// Cameras that film fill memory beside their taker. Films are copied by the taker itself, and on some machines that
/// stands still for milliseconds (memory that a hypervisor maps anew, a disk). So a frame counts as there when a camera
/// that works by itself would have had it: it begins when the frame is due and the one before is through, and takes as
/// long as it took.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Delivery {
    at: Option<Instant>,
}

impl Delivery {
    /// A frame that was due at `due` took `took` to bring.
    pub fn add(&mut self, due: Instant, took: Duration) {
        self.at = self.at.map_or(due, |last| last.max(due)).checked_add(took);
    }

    /// How long before `now` the last frame was there.
    pub fn waited(&self, now: Instant) -> Duration {
        self.at.map_or(Duration::ZERO, |at| now.saturating_duration_since(at))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[expect(clippy::disallowed_methods, reason = "some moment to count from")]
    fn what_a_frame_takes_to_bring_does_not_count_and_what_its_taker_does_meanwhile_does() {
        let (start, ms) = (Instant::now(), Duration::from_millis);
        let mut delivery = Delivery::default();
        assert_eq!(delivery.waited(start), Duration::ZERO);
        delivery.add(start + ms(10), ms(3));
        assert_eq!(delivery.waited(start + ms(15)), ms(2));
        // Due while the one before was still being brought.
        delivery.add(start + ms(11), ms(1));
        assert_eq!(delivery.waited(start + ms(20)), ms(6));
        delivery.add(start + ms(30), ms(1));
        assert_eq!(delivery.waited(start + ms(30)), Duration::ZERO);
    }
}
