//! The frames in which a body was measured, and the most frequent status where it was not.

use super::{PointStatus, VelocitySample};
use std::collections::BTreeMap;

/// The most frequent status of the frames in which a body was not measured.
///
/// # Examples
///
/// ```
/// use ricochet::results::{MeasuredFrames, PointStatus};
/// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
///
/// let mut rows = recording.truth()?.collect::<Result<Vec<_>, _>>()?;
/// rows[10..13].iter_mut().for_each(|row| row.status = PointStatus::Occluded);
/// let reason = MeasuredFrames::count(rows.iter()).reason.unwrap();
/// assert_eq!((reason.status, reason.count_frames, reason.frame), (PointStatus::Occluded, 3, 10));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrequentStatus {
    /// The status.
    pub status: PointStatus,
    /// The number of frames that have it.
    pub count_frames: u64,
    /// The sequence number of the first of them.
    pub frame: u64,
}

/// The frames of one body, counted.
///
/// # Examples
///
/// ```
/// use ricochet::results::MeasuredFrames;
/// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
///
/// let rows = recording.truth()?.collect::<Result<Vec<_>, _>>()?;
/// let frames = MeasuredFrames::count(rows.iter().filter(|row| row.body == 0));
/// assert_eq!((frames.measured_frames, frames.total_frames), (100, 100));
/// // The ball was measured in every frame, so there is no reason why not.
/// assert_eq!(frames.reason, None);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MeasuredFrames {
    /// The number of frames.
    pub total_frames: u64,
    /// The number of frames in which the body was measured.
    pub measured_frames: u64,
    /// The most frequent status of the others, the earliest of equally frequent ones.
    pub reason: Option<FrequentStatus>,
}

impl MeasuredFrames {
    /// Counts the velocity rows of one body, one per frame.
    ///
    /// A row counts as measured if its status is valid. The last rows of a stream need no motion to be valid. If other
    /// rows failed and no row has a motion or a velocity, the body was therefore not measured at all: the count is 0.
    pub fn count<'a>(rows: impl Iterator<Item = &'a VelocitySample>) -> Self {
        let (mut total, mut valid, mut moved) = (0, 0, 0);
        let mut failed: BTreeMap<PointStatus, FrequentStatus> = BTreeMap::new();
        for row in rows {
            total += 1;
            moved += u64::from(row.motion.is_some() || row.velocity.is_some());
            if row.status == PointStatus::Valid {
                valid += 1;
                continue;
            }
            let none = FrequentStatus { status: row.status, count_frames: 0, frame: row.frame };
            let entry = failed.entry(row.status).or_insert(none);
            entry.count_frames += 1;
            entry.frame = entry.frame.min(row.frame);
        }
        let rank = |status: &FrequentStatus| (status.count_frames, std::cmp::Reverse(status.frame));
        let reason = failed.into_values().max_by_key(rank);
        let measured_frames = if reason.is_some() && moved == 0 { 0 } else { valid };
        Self { total_frames: total, measured_frames, reason }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::{Phase, RigidStep};

    fn rows(statuses: &[PointStatus], moved: Option<RigidStep>) -> Vec<VelocitySample> {
        let row = |(frame, status): (u64, &PointStatus)| VelocitySample {
            frame,
            body: 0,
            stamp_ns: 0,
            center_x_px: None,
            center_y_px: None,
            radius_px: None,
            motion: moved.filter(|_| *status == PointStatus::Valid).map(Into::into),
            velocity: None,
            visible_fraction: None,
            phase: Phase::Unknown,
            rotation_status: PointStatus::Valid,
            status: *status,
        };
        (5..).zip(statuses).map(row).collect()
    }

    #[test]
    fn the_most_frequent_status_comes_with_its_first_frame() {
        use PointStatus::{Lost, LowContrast, Valid};
        let rows = rows(&[Valid, Lost, LowContrast, Lost, LowContrast, Valid], Some(RigidStep::STILL));
        let counted = MeasuredFrames::count(rows.iter());
        assert_eq!((counted.measured_frames, counted.total_frames), (2, 6));
        assert_eq!(counted.reason, Some(FrequentStatus { status: Lost, count_frames: 2, frame: 6 }));
    }

    #[test]
    fn a_last_row_without_motion_is_no_measurement_when_all_others_failed() {
        use PointStatus::{OutOfFrame, Valid};
        let counted = MeasuredFrames::count(rows(&[OutOfFrame, OutOfFrame, Valid], None).iter());
        assert_eq!((counted.measured_frames, counted.total_frames), (0, 3));
        let still = MeasuredFrames::count(rows(&[Valid], None).iter());
        assert_eq!((still.measured_frames, still.reason), (1, None), "a film of one frame has a position");
    }
}
