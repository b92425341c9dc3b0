//! What is known of the bodies while their blocks are measured.

use super::outline::Outline;
use crate::results::RigidStep;

/// What is known of one body within one block.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known {
    pub(super) body: usize,
    pub(super) block: u64,
    /// The newest outline and its frame.
    pub(super) outline: Option<(u64, Outline)>,
    /// The last motion measured.
    pub(super) motion: Option<RigidStep>,
    /// Whether what was measured contradicted itself: something else is in the picture, and may be taken for the body.
    pub(super) confused: bool,
    /// Whether a patch was looked for at every angle.
    pub(super) searched: bool,
}

/// All that is known, of the blocks at hand.
#[derive(Debug, Default)]
pub(super) struct Memory {
    known: Vec<Known>,
}

impl Memory {
    /// Of one body within one block; nothing at first.
    pub(super) fn of(&mut self, body: usize, block: u64) -> &mut Known {
        let place = self.known.iter().position(|known| (known.body, known.block) == (body, block));
        let place = place.unwrap_or_else(|| {
            self.known.push(Known { body, block, outline: None, motion: None, confused: false, searched: false });
            self.known.len() - 1
        });
        &mut self.known[place]
    }

    /// Of all bodies within one block.
    pub(super) fn of_block(&self, block: u64) -> impl Iterator<Item = &Known> {
        self.known.iter().filter(move |known| known.block == block)
    }

    /// Forgets the blocks before this one.
    pub(super) fn forget_before(&mut self, block: u64) {
        self.known.retain(|known| known.block >= block);
    }

    /// Forgets everything.
    pub(super) fn clear(&mut self) {
        self.known.clear();
    }
}
