//! Frames that may repeat the one before, under a compression that hides it.

use super::numbers::FrameNumbers;

/// Frames whose change is too small for the motion around them and too large for a repeat.
///
/// A strong compression stores a slow motion in jumps, and changes a repeated frame as much as that. Which of the two a
/// frame shows cannot be decided then.
#[derive(Debug, Default)]
pub(super) struct DoubtfulFrames(FrameNumbers);

impl DoubtfulFrames {
    /// Adds the number of a frame.
    pub(super) fn push(&mut self, number: u64) {
        self.0.push(number);
    }

    /// Returns the warning of a film with such frames.
    pub(super) fn warning(&self) -> String {
        let Self(numbers) = self;
        let (subject, owner) = match numbers.count {
            1 => ("frame changes", "its"),
            _ => ("frames change", "their"),
        };
        format!(
            "{} {subject} by less than half as much as {owner} neighbours ({numbers}): the film is compressed so strongly that \
             a frame which repeats the one before cannot be excluded, and speeds may be wrong there; measure the \
             original, or a copy of a higher quality",
            numbers.count
        )
    }
}
