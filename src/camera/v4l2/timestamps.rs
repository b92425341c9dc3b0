//! Conversion of the driver's frame counts and timestamps to those of the ring.

use super::sys;
use rustix::time::{ClockId, clock_gettime};

/// The driver's description of a dequeued buffer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct BufferInfo {
    /// The driver's count of frames, which wraps.
    pub sequence: u32,
    /// `V4L2_BUF_FLAG_...`.
    pub flags: u32,
    /// The driver's timestamp, ns on the clock given by `flags`; 0 if it has none.
    pub stamp_ns: u64,
    /// Number of bytes that the driver has written.
    pub bytes: usize,
    /// The reason why the pixels could not be extracted.
    pub damage: Option<String>,
}

/// Converts the driver's 32-bit count to a sequence that starts at 0 with the first frame and never wraps.
///
/// A gap in the driver's count is the same gap in the sequence.
#[derive(Debug, Default)]
pub(super) struct Sequences {
    /// The driver's count and the sequence number of the newest frame.
    last: Option<(u32, u64)>,
}

impl Sequences {
    /// Returns the sequence number of a frame with this count of the driver.
    ///
    /// `None` if it is not later than the previous one; half of the range or more ahead counts as earlier.
    pub fn sequence_of(&mut self, count: u32) -> Option<u64> {
        let sequence = match self.last {
            None => 0,
            Some((last, sequence)) => {
                let ahead = count.wrapping_sub(last);
                // The farther half of the circle is the past.
                if ahead == 0 || ahead > u32::MAX / 2 {
                    return None;
                }
                sequence + u64::from(ahead)
            }
        };
        self.last = Some((count, sequence));
        Some(sequence)
    }
}

/// Converts the kernel's monotonic clock to ns since the Unix epoch.
///
/// The offset of the two clocks is measured once: both run at the same speed, and a step of the wall clock during a
/// stream must not step the timestamps.
#[derive(Debug)]
pub(super) struct HostClock {
    /// Host time at zero of the monotonic clock, ns since the Unix epoch.
    epoch_of_monotonic_ns: u64,
    /// Frame period, ns; 0 if unknown.
    frame_ns: u64,
}

/// The time of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Stamps {
    /// Start of the frame, ns since the Unix epoch.
    pub stamp_ns: u64,
    /// The driver's own timestamp, ns on the kernel's monotonic clock; 0 if it has none.
    pub device_ns: u64,
}

impl HostClock {
    /// Measures the offset of the two clocks. `frame_rate_hz` is 0 if unknown.
    pub fn new(frame_rate_hz: f64) -> Self {
        let offset = || {
            let (before, epoch, after) =
                (clock_ns(ClockId::Monotonic), clock_ns(ClockId::Realtime), clock_ns(ClockId::Monotonic));
            (after - before, epoch.saturating_sub(before.midpoint(after)))
        };
        // The quickest of several readings was not interrupted.
        let (_, epoch_of_monotonic_ns) = (0..16).map(|_| offset()).min().unwrap_or_default();
        let frame_ns = if frame_rate_hz > 0.0 { (1e9 / frame_rate_hz).round() as u64 } else { 0 };
        Self { epoch_of_monotonic_ns, frame_ns }
    }

    /// Returns the stamps of a frame that arrived at `arrival_ns` on the monotonic clock.
    ///
    /// A timestamp of the frame's end is set back by one frame period, which is the start of a continuously read
    /// sensor's frame. A timestamp of another clock, or none, is replaced by the arrival.
    pub fn stamps(&self, info: &BufferInfo, arrival_ns: u64) -> Stamps {
        if !has_stamp(info) {
            return Stamps { stamp_ns: self.epoch_of_monotonic_ns + arrival_ns, device_ns: 0 };
        }
        let start_ns =
            if is_stamped_at_start(info) { info.stamp_ns } else { info.stamp_ns.saturating_sub(self.frame_ns) };
        Stamps { stamp_ns: self.epoch_of_monotonic_ns.saturating_add(start_ns), device_ns: info.stamp_ns }
    }

    /// Returns when a frame was complete, ns on the kernel's monotonic clock; `None` if the driver does not
    /// report it.
    ///
    /// A frame stamped at its start is complete one frame period later.
    pub fn completed_ns(&self, info: &BufferInfo) -> Option<u64> {
        let after_ns = if is_stamped_at_start(info) { self.frame_ns } else { 0 };
        has_stamp(info).then(|| info.stamp_ns.saturating_add(after_ns))
    }
}

/// Maximum age of a timestamp of unknown clock that may be of the monotonic one.
const MAX_UNKNOWN_AGE_NS: u64 = 10_000_000_000;

/// Whether a frame was captured before the stream started at `start_ns` on the kernel's monotonic clock.
///
/// A timestamp of unknown clock counts if it is earlier by less than [`MAX_UNKNOWN_AGE_NS`].
///
/// A driver that several programs share (v4l2loopback) delivers such a frame first, with count 0 and a timestamp of an
/// unspecified clock.
pub(super) fn is_stale(info: &BufferInfo, start_ns: u64) -> bool {
    let clock = info.flags & sys::V4L2_BUF_FLAG_TIMESTAMP_MASK;
    let is_before = info.stamp_ns > 0 && info.stamp_ns < start_ns;
    let is_near = start_ns.saturating_sub(info.stamp_ns) < MAX_UNKNOWN_AGE_NS;
    is_before && (has_stamp(info) || (clock == sys::V4L2_BUF_FLAG_TIMESTAMP_UNKNOWN && is_near))
}

/// Whether a buffer has a timestamp of the kernel's monotonic clock.
fn has_stamp(info: &BufferInfo) -> bool {
    let clock = info.flags & sys::V4L2_BUF_FLAG_TIMESTAMP_MASK;
    clock == sys::V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC && info.stamp_ns > 0
}

/// Whether a buffer's flags declare its timestamp as that of the frame's start, not of its end.
fn is_stamped_at_start(info: &BufferInfo) -> bool {
    info.flags & sys::V4L2_BUF_FLAG_TSTAMP_SRC_MASK == sys::V4L2_BUF_FLAG_TSTAMP_SRC_SOE
}

/// Returns the time on the kernel's monotonic clock, which never steps and which all processes share, ns.
pub fn monotonic_ns() -> u64 {
    clock_ns(ClockId::Monotonic)
}

/// Reads a clock of the kernel, ns; 0 if it is negative.
fn clock_ns(clock: ClockId) -> u64 {
    let time = clock_gettime(clock);
    u64::try_from(time.tv_sec * 1_000_000_000 + time.tv_nsec).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CLOCK: HostClock = HostClock { epoch_of_monotonic_ns: 1_700_000_000_000_000_000, frame_ns: 1_000_000 };

    fn info(flags: u32, stamp_ns: u64) -> BufferInfo {
        BufferInfo { sequence: 0, flags, stamp_ns, bytes: 0, damage: None }
    }

    #[test]
    fn the_count_continues_over_the_wrap_and_keeps_its_gaps() {
        let mut sequences = Sequences::default();
        let counts = [u32::MAX - 1, u32::MAX, 0, 1, 5, 4, 5, 6];
        let counted: Vec<_> = counts.iter().map(|count| sequences.sequence_of(*count)).collect();
        assert_eq!(counted, [Some(0), Some(1), Some(2), Some(3), Some(7), None, None, Some(8)]);
    }

    #[test]
    fn a_stamp_of_the_start_is_taken_as_it_is_and_one_of_the_end_set_back_by_a_frame() {
        let monotonic = sys::V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
        let start = CLOCK.stamps(&info(monotonic | sys::V4L2_BUF_FLAG_TSTAMP_SRC_SOE, 5_000_000), 9_000_000);
        assert_eq!(start, Stamps { stamp_ns: 1_700_000_000_005_000_000, device_ns: 5_000_000 });
        let completed = |source| CLOCK.completed_ns(&info(monotonic | source, 5_000_000));
        assert_eq!(completed(sys::V4L2_BUF_FLAG_TSTAMP_SRC_SOE), Some(6_000_000));
        assert_eq!(completed(sys::V4L2_BUF_FLAG_TSTAMP_SRC_EOF), Some(5_000_000));
        assert_eq!(CLOCK.completed_ns(&info(sys::V4L2_BUF_FLAG_TIMESTAMP_COPY, 5_000_000)), None);
        let end = CLOCK.stamps(&info(monotonic | sys::V4L2_BUF_FLAG_TSTAMP_SRC_EOF, 5_000_000), 9_000_000);
        assert_eq!(end, Stamps { stamp_ns: 1_700_000_000_004_000_000, device_ns: 5_000_000 });
    }

    #[test]
    fn frames_from_before_the_start_are_detected_by_any_stamp_that_may_be_of_the_kernels_clock() {
        let (monotonic, unknown) = (sys::V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC, sys::V4L2_BUF_FLAG_TIMESTAMP_UNKNOWN);
        let start_ns = 100_000_000_000;
        for (flags, stamp_ns, is) in [
            (monotonic, 1, true),
            (monotonic, start_ns - 1, true),
            (monotonic, start_ns, false),
            (unknown, start_ns - 1, true),
            // A clock of its own.
            (unknown, 1, false),
            (unknown, 0, false),
            (unknown, 1_700_000_000_000_000_000, false),
            (sys::V4L2_BUF_FLAG_TIMESTAMP_COPY, start_ns - 1, false),
        ] {
            assert_eq!(is_stale(&info(flags, stamp_ns), start_ns), is, "{flags:#x}, {stamp_ns}");
        }
    }

    #[test]
    fn a_stamp_of_an_unknown_clock_is_replaced_by_the_arrival() {
        for flags in [sys::V4L2_BUF_FLAG_TIMESTAMP_UNKNOWN, sys::V4L2_BUF_FLAG_TIMESTAMP_COPY] {
            let arrived = CLOCK.stamps(&info(flags, 5_000_000), 9_000_000);
            assert_eq!(arrived, Stamps { stamp_ns: 1_700_000_000_009_000_000, device_ns: 0 });
        }
    }

    #[test]
    fn the_monotonic_clock_now_is_the_calendar_now() {
        let clock = HostClock::new(0.0);
        let mapped = clock.stamps(&info(0, 0), monotonic_ns()).stamp_ns;
        // The realtime clock may be stepped, but not in the microseconds between.
        assert!(clock_ns(ClockId::Realtime).abs_diff(mapped) < 1_000_000_000);
    }
}
