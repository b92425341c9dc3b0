//! What a loop did.

/// Counts of one process from start to end.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Summary {
    /// Frames (or rows) taken in.
    pub taken: u64,
    /// Frames (or rows) given out.
    pub given: u64,
    /// Lost before they arrived: gaps in the camera's count, overrun queues.
    pub lost: u64,
    /// Lost here: no free slot, torn frames, late rows.
    pub dropped: u64,
    /// Who lost how much, in words; of a whole rig.
    pub causes: Vec<String>,
    /// Files written.
    pub recordings: Vec<std::path::PathBuf>,
}

impl Summary {
    /// Everything that was lost on the way.
    pub fn losses(&self) -> u64 {
        self.lost + self.dropped
    }
}
