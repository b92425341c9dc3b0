//! The counts of a finished loop.

use super::rig_losses::RigLosses;

/// Counts of one process from start to end.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Summary {
    /// Frames (or rows) received.
    pub taken: u64,
    /// Frames (or rows) published.
    pub given: u64,
    /// Lost before arrival: gaps in the camera's count, overrun queues.
    pub lost: u64,
    /// Lost in this process: no free slot, incomplete frames, late rows.
    pub dropped: u64,
    /// The losses of the processes of a rig; none in one process.
    pub by_kind: RigLosses,
    /// Number of processes that died or did not finish.
    pub faults: u64,
    /// The losses of each process of a rig, as text.
    pub causes: Vec<String>,
    /// Files written.
    pub recordings: Vec<std::path::PathBuf>,
}

impl Summary {
    /// Returns the losses of a process, or the largest number of any kind of loss of a rig.
    pub fn losses(&self) -> u64 {
        (self.lost + self.dropped).max(self.by_kind.largest())
    }
}
