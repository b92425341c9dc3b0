//! The state of the bodies while their blocks are measured.

use super::bounding_box::BoundingBox;
use super::consistency::{DetectedBall, OutlineMotion};
use super::outline::Outline;
use super::pending_frame::BodyKey;
use super::rigid_match::{MAX_PREDICTION_ERROR_PX, RigidMatcher};
use super::rotation_support::Neighbour;
use super::surface::Surface;
use crate::dic::CorrelationParams;
use crate::results::RigidStep;

/// The state of one body within one block.
#[derive(Debug, Clone, Copy)]
pub(super) struct BlockState {
    pub(super) key: BodyKey,
    /// The newest outline and its frame.
    pub(super) outline: Option<(u64, Outline)>,
    /// The newest frame in which it was searched and detected.
    pub(super) detected_frame: Option<u64>,
    /// The last measured motion.
    pub(super) motion: Option<RigidStep>,
    /// The motion of its centre, if that differs.
    pub(super) center_motion: Option<RigidStep>,
    /// The surface of a ball, classified again in each frame of the block until it shows marks.
    pub(super) surface: Option<Surface>,
    /// The step before the next one to be published, as it was published.
    pub(super) last_turn: Neighbour,
    /// Whether a rotation in the block was confirmed by that of its ring.
    pub(super) is_rotation_checked: bool,
    /// The number of contradictions between its motion and its outlines since the last confirmed motion.
    pub(super) doubts: u32,
    /// The first detected outline of a ball.
    pub(super) first_ball: Option<DetectedBall>,
    /// The motion from there to the last detected outline.
    pub(super) outline_motion: Option<OutlineMotion>,
    /// The motion of its outlines at the last contradiction.
    pub(super) doubted_motion: Option<OutlineMotion>,
    /// Whether results contradicted each other, since another object may be taken for the body.
    pub(super) is_ambiguous: bool,
    /// Whether a patch was searched at every angle.
    pub(super) was_searched: bool,
}

/// The states of all bodies in the current blocks.
#[derive(Debug, Default)]
pub(super) struct BlockStates {
    states: Vec<BlockState>,
}

impl BlockStates {
    /// Returns the state of one body within one block, empty at first.
    pub(super) fn state_mut(&mut self, key: BodyKey) -> &mut BlockState {
        let index = self.states.iter().position(|state| state.key == key);
        let index = index.unwrap_or_else(|| {
            self.states.push(BlockState {
                key,
                outline: None,
                detected_frame: None,
                motion: None,
                center_motion: None,
                surface: None,
                last_turn: Neighbour::Absent,
                is_rotation_checked: false,
                doubts: 0,
                first_ball: None,
                outline_motion: None,
                doubted_motion: None,
                is_ambiguous: false,
                was_searched: false,
            });
            self.states.len() - 1
        });
        &mut self.states[index]
    }

    /// Returns the last published step of one body within one block.
    pub(super) fn last_turn(&self, key: BodyKey) -> Neighbour {
        let state = self.states.iter().find(|state| state.key == key);
        state.map_or(Neighbour::Absent, |state| state.last_turn)
    }

    /// Returns the box that holds the bodies of a block in a frame, with the search range around them.
    pub(super) fn search_box(&self, block: u64, sequence: u64, params: &CorrelationParams) -> BoundingBox {
        let mut bounds = BoundingBox::default();
        for (frame, outline, state) in self.outlines_in(block) {
            let range = f64::from(params.search_px);
            bounds.include_search(&outline.enclosing_circle(params.subset_size_px), range);
            if let Some(motion) = &state.motion {
                let moved = outline.predicted(Some(motion), (sequence - frame) as f64).0;
                bounds.include_search(&moved.enclosing_circle(params.subset_size_px), range);
            }
        }
        bounds
    }

    /// Returns the box around the predicted bodies of a block.
    ///
    /// `None` without bodies, or unless all of them have a measured motion and a reference for rigid matches.
    pub(super) fn predicted_box(
        &self,
        block: u64,
        sequence: u64,
        params: &CorrelationParams,
        rigid_matcher: &RigidMatcher,
    ) -> Option<BoundingBox> {
        let mut bounds = BoundingBox::default();
        for (frame, outline, state) in self.outlines_in(block) {
            let motion = state.motion.as_ref().filter(|_| rigid_matcher.has_reference(state.key))?;
            let moved = outline.predicted(Some(motion), (sequence - frame) as f64).0;
            bounds.include_search(&moved.enclosing_circle(params.subset_size_px), MAX_PREDICTION_ERROR_PX);
        }
        (!bounds.is_empty()).then_some(bounds)
    }

    /// Returns the newest outline of each body of a block, with its frame.
    fn outlines_in(&self, block: u64) -> impl Iterator<Item = (u64, Outline, &BlockState)> {
        let states = self.states.iter().filter(move |state| state.key.block == block);
        states.filter_map(|state| state.outline.map(|(frame, outline)| (frame, outline, state)))
    }

    /// Discards the blocks before this one.
    pub(super) fn forget_before(&mut self, block: u64) {
        self.states.retain(|state| state.key.block >= block);
    }

    /// Discards everything.
    pub(super) fn clear(&mut self) {
        self.states.clear();
    }
}
