//! The state from which a restarted process continues.

use std::fmt;
use std::str::FromStr;

/// The last known state of a process that died.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Resume {
    /// Its last published frame; for a camera process, the frame that is due by now.
    pub sequence: u64,
    /// Stamp of that frame, ns since the Unix epoch.
    pub stamp_ns: u64,
    /// Number of times the camera was reopened, including this one.
    pub epoch: u32,
}

impl Resume {
    /// Advances the state by some seconds of a stream of this rate.
    #[must_use]
    pub fn after(self, seconds: f64, frame_rate_hz: f64) -> Self {
        // A conversion from a float saturates.
        let frames = (seconds * frame_rate_hz).ceil() as u64;
        let ns = (seconds * 1e9).round() as u64;
        let (sequence, stamp_ns) = (self.sequence.saturating_add(frames), self.stamp_ns.saturating_add(ns));
        Self { sequence, stamp_ns, ..self }
    }

    /// Returns the sequence number of the first frame after the restart, which has this stamp.
    ///
    /// Numbers count the frames that were missed meanwhile. The result begins a block, so that its measurement does
    /// not depend on the loss.
    pub fn first_frame(&self, stamp_ns: u64, frame_rate_hz: f64, block_frames: u32) -> u64 {
        let frames = stamp_ns.saturating_sub(self.stamp_ns) as f64 * 1e-9 * frame_rate_hz;
        let due = self.sequence.saturating_add(1).max(self.sequence.saturating_add(frames.round() as u64));
        due.next_multiple_of(u64::from(block_frames))
    }
}

impl fmt::Display for Resume {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}:{}:{}", self.sequence, self.stamp_ns, self.epoch)
    }
}

impl FromStr for Resume {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut numbers = text.split(':').map(str::parse::<u64>);
        let mut next = || numbers.next().and_then(Result::ok).ok_or_else(|| format!("{text:?} is not FRAME:NS:EPOCH"));
        let (sequence, stamp_ns, epoch) = (next()?, next()?, next()?);
        Ok(Self { sequence, stamp_ns, epoch: u32::try_from(epoch).unwrap_or(u32::MAX) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_state_survives_the_command_line() {
        let resume = Resume { sequence: 1234, stamp_ns: 1_767_225_600_000_000_007, epoch: 3 };
        assert_eq!(resume.to_string().parse(), Ok(resume));
        assert!("12:x:1".parse::<Resume>().is_err() && "12".parse::<Resume>().is_err());
    }

    #[test]
    fn numbers_continue_after_the_missed_frames_with_the_start_of_a_block() {
        let resume = Resume { sequence: 100, stamp_ns: 5_000_000_000, epoch: 1 }.after(0.1, 500.0);
        assert_eq!((resume.sequence, resume.stamp_ns), (150, 5_100_000_000));
        // 0.3 s later 150 more frames were due.
        assert_eq!(resume.first_frame(5_400_000_000, 500.0, 16), 304);
        assert_eq!(resume.first_frame(5_400_000_000, 500.0, 4), 300);
        // A stamp that stepped back, or a camera without a rate of its own, never repeats a number.
        assert_eq!(resume.first_frame(0, 500.0, 1), 151);
        assert_eq!(resume.first_frame(9_000_000_000, 0.0, 1), 151);
    }
}
