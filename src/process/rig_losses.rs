//! The losses of a rig by kind.

use crate::message::Role;
use std::collections::BTreeMap;
use std::fmt;

/// The data that a rig lost, by kind.
///
/// Several processes notice the same lost frame. Each of them counts a kind of its own, and kinds are never added.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RigLosses {
    /// Frames that the camera lost, or that no process took from it.
    pub camera_frames: u64,
    /// Rows without a measurement, with those of frames that the camera lost, or that are missing in recordings.
    pub unmeasured_rows: u64,
    /// Frames that are missing in recordings, with those that the camera lost.
    pub unrecorded_frames: u64,
    /// Messages that the server did not send.
    pub unsent_messages: u64,
}

/// The losses that a process and its predecessors in the same role counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ProcessLosses {
    /// Index of its camera.
    pub(super) camera: u32,
    pub(super) role: Role,
    /// Lost before they arrived.
    pub(super) lost: u64,
    /// Lost in the process.
    pub(super) dropped: u64,
}

impl RigLosses {
    /// Sorts the losses that the processes of a rig counted by their kinds.
    pub(super) fn of(processes: impl IntoIterator<Item = ProcessLosses>) -> Self {
        let mut losses = Self::default();
        // Rows by the tracker of a camera, and frames by the worker that missed most of them.
        let mut unmeasured: BTreeMap<u32, [u64; 2]> = BTreeMap::new();
        let mut missing_rows = 0;
        for ProcessLosses { camera, role, lost, dropped } in processes {
            let [rows, frames] = unmeasured.entry(camera).or_default();
            match role {
                Role::Acquire => losses.camera_frames += lost + dropped,
                // Every worker counts every frame that it missed, whether it was to measure it or not.
                Role::Correlate => *frames = (lost + dropped).max(*frames),
                // A row that comes too late was given up before.
                Role::Track => *rows += lost.max(dropped),
                Role::Record => {
                    losses.unrecorded_frames += lost;
                    missing_rows += dropped;
                }
                _ => losses.unsent_messages += lost + dropped,
            }
        }
        // A tracker that was killed could not report what the workers had missed. The recorder misses the same rows.
        let unmeasured: u64 = unmeasured.values().map(|[rows, frames]| rows.max(frames)).sum();
        losses.unmeasured_rows = unmeasured.max(missing_rows);
        losses
    }

    /// Returns the largest number of any kind; 0 if nothing was lost.
    pub fn largest(&self) -> u64 {
        self.kinds().iter().map(|(count, _)| *count).max().unwrap_or(0)
    }

    /// Adds the losses of another rig or run.
    pub fn add(&mut self, other: &Self) {
        self.camera_frames += other.camera_frames;
        self.unmeasured_rows += other.unmeasured_rows;
        self.unrecorded_frames += other.unrecorded_frames;
        self.unsent_messages += other.unsent_messages;
    }

    /// Returns the number of each kind with its unit and name.
    fn kinds(&self) -> [(u64, &'static str); 4] {
        [
            (self.camera_frames, "frames by the camera"),
            (self.unmeasured_rows, "rows not measured"),
            (self.unrecorded_frames, "frames not recorded"),
            (self.unsent_messages, "messages not sent"),
        ]
    }
}

impl fmt::Display for RigLosses {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kinds = self.kinds().into_iter().filter(|(count, _)| *count > 0);
        let texts: Vec<String> = kinds.map(|(count, kind)| format!("{count} {kind}")).collect();
        f.write_str(&texts.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_that_several_processes_miss_is_one_of_each_kind() {
        let counted = |role, lost, dropped| ProcessLosses { camera: 0, role, lost, dropped };
        let mut processes = vec![
            counted(Role::Acquire, 5, 0),
            counted(Role::Correlate, 5, 0),
            counted(Role::Correlate, 7, 0),
            counted(Role::Record, 5, 6),
            counted(Role::Track, 7, 2),
        ];
        let losses = RigLosses::of(processes.clone());
        assert_eq!(losses.to_string(), "5 frames by the camera, 7 rows not measured, 5 frames not recorded");
        assert_eq!(losses.largest(), 7);
        // The tracker was killed before it could count.
        processes.pop();
        assert_eq!(RigLosses::of(processes).unmeasured_rows, 7);
    }
}
