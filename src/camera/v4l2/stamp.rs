//! Frame counts and time stamps of a driver, as those of the ring.

use super::queue::Info;
use super::sys;

/// Turns the driver's 32-bit count into one that starts at 0 with the first frame seen and never wraps.
///
/// A gap in the driver's count is the same gap in the sequence.
#[derive(Debug, Default)]
pub(super) struct Sequences {
    last: Option<(u32, u64)>,
}

impl Sequences {
    /// The place of a frame; nothing when it is not later than the one before.
    pub fn unwrap_count(&mut self, count: u32) -> Option<u64> {
        let place = match self.last {
            None => 0,
            Some((last, place)) => {
                let ahead = count.wrapping_sub(last);
                // The farther half of the circle is the past.
                if ahead == 0 || ahead > u32::MAX / 2 {
                    return None;
                }
                place + u64::from(ahead)
            }
        };
        self.last = Some((count, place));
        Some(place)
    }
}

/// Maps the kernel's monotonic clock to ns since the Unix epoch.
///
/// The distance of the two clocks is taken once: both run at the same speed, and a
/// step of the calendar in the middle of a stream must not step the frames.
#[derive(Debug)]
pub(super) struct HostClock {
    epoch_of_monotonic_ns: u64,
    frame_ns: u64,
}

/// Time of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Stamps {
    /// Start of the frame, ns since the Unix epoch.
    pub stamp_ns: u64,
    /// The driver's own stamp, ns on the kernel's monotonic clock; 0 when it has none.
    pub device_ns: u64,
}

impl HostClock {
    /// Looks at both clocks; `frame_rate_hz` 0 when it is not known.
    pub fn new(frame_rate_hz: f64) -> Self {
        let distance = || {
            let (before, epoch, after) =
                (clock_ns(libc::CLOCK_MONOTONIC), clock_ns(libc::CLOCK_REALTIME), clock_ns(libc::CLOCK_MONOTONIC));
            (after - before, epoch.saturating_sub(before.midpoint(after)))
        };
        // The quickest of a few looks is the one that was not interrupted.
        let (_, epoch_of_monotonic_ns) = (0..16).map(|_| distance()).min().unwrap_or_default();
        let frame_ns = if frame_rate_hz > 0.0 { (1e9 / frame_rate_hz).round() as u64 } else { 0 };
        Self { epoch_of_monotonic_ns, frame_ns }
    }

    /// The stamps of a frame that came out at `arrival_ns` of the monotonic clock.
    ///
    /// A stamp of the frame's end is set back by the length of a frame, which is when
    /// it began where the sensor is read out all the time. A stamp of another clock,
    /// or none, is replaced by the arrival.
    pub fn stamps(&self, info: &Info, arrival_ns: u64) -> Stamps {
        if !has_stamp(info) {
            return Stamps { stamp_ns: self.epoch_of_monotonic_ns + arrival_ns, device_ns: 0 };
        }
        let start_ns = if is_of_start(info) { info.stamp_ns } else { info.stamp_ns.saturating_sub(self.frame_ns) };
        Stamps { stamp_ns: self.epoch_of_monotonic_ns.saturating_add(start_ns), device_ns: info.stamp_ns }
    }

    /// When a frame was whole, ns on the kernel's monotonic clock; nothing where the driver does not tell.
    ///
    /// A frame stamped at its start was whole one frame's length later.
    pub fn whole_ns(&self, info: &Info) -> Option<u64> {
        let after_ns = if is_of_start(info) { self.frame_ns } else { 0 };
        has_stamp(info).then(|| info.stamp_ns.saturating_add(after_ns))
    }
}

/// Stamps that do not say their clock may be of the monotonic one when they are this near to it.
const NEAR_NS: u64 = 10_000_000_000;

/// Whether a frame was there before the stream was started at `began_ns`.
///
/// A driver that several programs share (v4l2loopback) hands such a one out first,
/// with a count that it set to 0 and a stamp whose clock it does not tell.
pub(super) fn is_stale(info: &Info, began_ns: u64) -> bool {
    let clock = info.flags & sys::V4L2_BUF_FLAG_TIMESTAMP_MASK;
    let is_before = info.stamp_ns > 0 && info.stamp_ns < began_ns;
    let is_near = began_ns.saturating_sub(info.stamp_ns) < NEAR_NS;
    is_before && (has_stamp(info) || (clock == sys::V4L2_BUF_FLAG_TIMESTAMP_UNKNOWN && is_near))
}

/// Whether a buffer is stamped, and by the kernel's monotonic clock.
fn has_stamp(info: &Info) -> bool {
    let clock = info.flags & sys::V4L2_BUF_FLAG_TIMESTAMP_MASK;
    clock == sys::V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC && info.stamp_ns > 0
}

/// Whether a buffer's stamp is that of the frame's start, not of its end.
fn is_of_start(info: &Info) -> bool {
    info.flags & sys::V4L2_BUF_FLAG_TSTAMP_SRC_MASK == sys::V4L2_BUF_FLAG_TSTAMP_SRC_SOE
}

/// Now on the kernel's monotonic clock, ns.
pub(super) fn monotonic_ns() -> u64 {
    clock_ns(libc::CLOCK_MONOTONIC)
}

fn clock_ns(clock: libc::clockid_t) -> u64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: a structure of ours; both clocks exist on every Linux.
    unsafe { libc::clock_gettime(clock, &raw mut time) };
    u64::try_from(time.tv_sec * 1_000_000_000 + time.tv_nsec).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CLOCK: HostClock = HostClock { epoch_of_monotonic_ns: 1_700_000_000_000_000_000, frame_ns: 1_000_000 };

    fn info(flags: u32, stamp_ns: u64) -> Info {
        Info { sequence: 0, flags, stamp_ns, bytes: 0, damage: None }
    }

    #[test]
    fn the_count_goes_on_over_the_wrap_and_keeps_its_gaps() {
        let mut sequences = Sequences::default();
        let counts = [u32::MAX - 1, u32::MAX, 0, 1, 5, 4, 5, 6];
        let places: Vec<_> = counts.iter().map(|count| sequences.unwrap_count(*count)).collect();
        assert_eq!(places, [Some(0), Some(1), Some(2), Some(3), Some(7), None, None, Some(8)]);
    }

    #[test]
    fn a_stamp_of_the_start_is_taken_as_it_is_and_one_of_the_end_set_back_by_a_frame() {
        let monotonic = sys::V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
        let start = CLOCK.stamps(&info(monotonic | sys::V4L2_BUF_FLAG_TSTAMP_SRC_SOE, 5_000_000), 9_000_000);
        assert_eq!(start, Stamps { stamp_ns: 1_700_000_000_005_000_000, device_ns: 5_000_000 });
        let whole = |source| CLOCK.whole_ns(&info(monotonic | source, 5_000_000));
        assert_eq!(whole(sys::V4L2_BUF_FLAG_TSTAMP_SRC_SOE), Some(6_000_000));
        assert_eq!(whole(sys::V4L2_BUF_FLAG_TSTAMP_SRC_EOF), Some(5_000_000));
        assert_eq!(CLOCK.whole_ns(&info(sys::V4L2_BUF_FLAG_TIMESTAMP_COPY, 5_000_000)), None);
        let end = CLOCK.stamps(&info(monotonic | sys::V4L2_BUF_FLAG_TSTAMP_SRC_EOF, 5_000_000), 9_000_000);
        assert_eq!(end, Stamps { stamp_ns: 1_700_000_000_004_000_000, device_ns: 5_000_000 });
    }

    #[test]
    fn what_was_there_before_the_start_is_told_by_any_stamp_that_may_be_of_the_kernels_clock() {
        let (monotonic, unknown) = (sys::V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC, sys::V4L2_BUF_FLAG_TIMESTAMP_UNKNOWN);
        let began_ns = 100_000_000_000;
        for (flags, stamp_ns, is) in [
            (monotonic, 1, true),
            (monotonic, began_ns - 1, true),
            (monotonic, began_ns, false),
            (unknown, began_ns - 1, true),
            // A clock of its own.
            (unknown, 1, false),
            (unknown, 0, false),
            (unknown, 1_700_000_000_000_000_000, false),
            (sys::V4L2_BUF_FLAG_TIMESTAMP_COPY, began_ns - 1, false),
        ] {
            assert_eq!(is_stale(&info(flags, stamp_ns), began_ns), is, "{flags:#x}, {stamp_ns}");
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
        // The clock tests run on may be stepped, but not in the microseconds between.
        assert!(clock_ns(libc::CLOCK_REALTIME).abs_diff(mapped) < 1_000_000_000);
    }
}
