//! What is known of the bodies while their blocks are measured.

use super::outline::Outline;
use super::part::Part;
use super::whole::Wholes;
use crate::dic::CorrelationParams;
use crate::results::RigidStep;

/// A body that goes on as it moved is off by less than this where it is foretold, px.
pub(super) const FORETOLD_PX: f64 = 2.0;

/// What is known of one body within one block.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known {
    pub(super) body: usize,
    pub(super) block: u64,
    /// The newest outline and its frame.
    pub(super) outline: Option<(u64, Outline)>,
    /// The newest frame in which it was looked for and seen.
    pub(super) seen: Option<u64>,
    /// The last motion measured.
    pub(super) motion: Option<RigidStep>,
    /// The motion of its centre, where that is another.
    pub(super) center: Option<RigidStep>,
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
            self.known.push(Known {
                body,
                block,
                outline: None,
                seen: None,
                motion: None,
                center: None,
                confused: false,
                searched: false,
            });
            self.known.len() - 1
        });
        &mut self.known[place]
    }

    /// Where the bodies of a block may be in a frame, and what is looked for around them.
    pub(super) fn part(&self, block: u64, sequence: u64, params: &CorrelationParams) -> Part {
        let mut part = Part::default();
        for (seen, outline, known) in self.seen_in(block) {
            let range = f64::from(params.search_px);
            part.add(&outline.around(params.subset_size_px), range);
            if let Some(motion) = &known.motion {
                let moved = outline.carried(Some(motion), (sequence - seen) as f64).0;
                part.add(&moved.around(params.subset_size_px), range);
            }
        }
        part
    }

    /// Where the bodies of a block are in a frame if they go on as they moved, and are matched as wholes; else `None`.
    pub(super) fn narrow_part(
        &self,
        block: u64,
        sequence: u64,
        params: &CorrelationParams,
        wholes: &Wholes,
    ) -> Option<Part> {
        let mut part = Part::default();
        for (seen, outline, known) in self.seen_in(block) {
            let motion = known.motion.as_ref().filter(|_| wholes.knows(known.body, block))?;
            let moved = outline.carried(Some(motion), (sequence - seen) as f64).0;
            part.add(&moved.around(params.subset_size_px), FORETOLD_PX);
        }
        (!part.is_empty()).then_some(part)
    }

    /// The bodies of a block whose outline is known, with the frame in which it was and the outline.
    fn seen_in(&self, block: u64) -> impl Iterator<Item = (u64, Outline, &Known)> {
        let known = self.known.iter().filter(move |known| known.block == block);
        known.filter_map(|known| known.outline.map(|(seen, outline)| (seen, outline, known)))
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
