//! The rows of a topic that were overwritten before the bridge read them.

/// Detects that a full queue lost its oldest rows, by the numbers of their frames.
#[derive(Debug)]
pub(super) struct Overflow {
    /// The number of rows that the queue can hold.
    capacity: usize,
    /// The newest frame of the rows read before this look.
    before: Option<u64>,
    /// The first and the newest frame of this look.
    frames: Option<[u64; 2]>,
    /// The number of rows of this look.
    count: usize,
}

impl Overflow {
    /// Creates the count for an empty queue of `capacity` rows.
    pub(super) fn new(capacity: usize) -> Self {
        Self { capacity, before: None, frames: None, count: 0 }
    }

    /// Adds a row of this look, with its frame if the topic has frames.
    pub(super) fn add(&mut self, frame: Option<u64>) {
        self.count += 1;
        let Some(frame) = frame else { return };
        self.frames = Some(self.frames.map_or([frame; 2], |[first, newest]| [first, newest.max(frame)]));
    }

    /// Ends a look, after which the queue is empty. Returns the number of frames whose rows were overwritten.
    ///
    /// Without frames it is not known, and 1 if the queue was full. The numbers of frames may also jump without a loss,
    /// but not while the queue is full.
    pub(super) fn end_look(&mut self) -> u64 {
        let is_full = std::mem::take(&mut self.count) >= self.capacity;
        let frames = self.frames.take();
        let before = self.before;
        self.before = frames.map(|[_, newest]| newest).or(before);
        match (frames, before) {
            _ if !is_full => 0,
            (Some([first, _]), Some(before)) => first.saturating_sub(before + 1),
            (Some(_), None) => 0,
            (None, _) => 1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Looks at a queue that holds the rows of these frames.
    fn look(overflow: &mut Overflow, frames: impl Iterator<Item = u64>) -> u64 {
        frames.for_each(|frame| overflow.add(Some(frame)));
        overflow.end_look()
    }

    #[test]
    fn only_a_full_queue_loses_rows() {
        let mut overflow = Overflow::new(8);
        assert_eq!(look(&mut overflow, 0..5), 0);
        assert_eq!(look(&mut overflow, 9..12), 0, "the camera lost frames");
        assert_eq!(look(&mut overflow, 12..20), 0, "full, but nothing was overwritten");
        assert_eq!(look(&mut overflow, 27..35), 7);
        assert_eq!(look(&mut overflow, 35..40), 0);
        let mut events = Overflow::new(4);
        (0..4).for_each(|_| events.add(None));
        assert_eq!(events.end_look(), 1);
        assert_eq!(events.end_look(), 0);
    }
}
