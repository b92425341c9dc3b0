//! The state of the bodies while their blocks are measured.

use super::bounding_box::BoundingBox;
use super::consistency::{DetectedBall, OutlineMotion};
use super::outline::Outline;
use super::pending_frame::BodyKey;
use super::rigid_match::{MAX_PREDICTION_ERROR_PX, RigidMatcher};
use super::rotation_support::Neighbour;
use super::surface::Surface;
use crate::dic::CorrelationParams;
use crate::results::{PointStatus, RigidStep};

/// The number of frames after which a body whose results contradicted each other is searched again.
const DOUBT_FRAMES: u64 = 4;

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
    /// The status of that step; valid at first.
    pub(super) last_status: PointStatus,
    /// Whether the motion to the next frame to be published leads to another object.
    pub(super) is_led_away: bool,
    /// Whether its outline was found in the frame before the next one to be published; `None` at the start of the block.
    pub(super) was_found: Option<bool>,
    /// The newest frame in which the rotation was confirmed by that of its ring.
    pub(super) rotation_checked: Option<u64>,
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
    /// The frame in which its results contradicted each other for the last time, unless it was searched again since.
    pub(super) contradicted: Option<u64>,
    /// Whether a patch was searched.
    pub(super) was_searched: bool,
}

impl BlockState {
    /// Returns the state before the first frame.
    fn new(key: BodyKey) -> Self {
        Self {
            key,
            outline: None,
            detected_frame: None,
            motion: None,
            center_motion: None,
            surface: None,
            last_turn: Neighbour::Absent,
            last_status: PointStatus::Valid,
            was_found: None,
            is_led_away: false,
            rotation_checked: None,
            doubts: 0,
            first_ball: None,
            outline_motion: None,
            doubted_motion: None,
            is_ambiguous: false,
            contradicted: None,
            was_searched: false,
        }
    }

    /// Forgets a contradiction after [`DOUBT_FRAMES`], so that the body is searched again, as in a new block.
    pub(super) fn renew_if_due(&mut self, frame: u64) {
        if self.contradicted.is_some_and(|contradicted| frame >= contradicted + DOUBT_FRAMES) {
            let Self { last_turn, last_status, was_found, is_led_away, was_searched, .. } = *self;
            *self = Self { last_turn, last_status, was_found, is_led_away, was_searched, ..Self::new(self.key) };
        }
    }
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
            self.states.push(BlockState::new(key));
            self.states.len() - 1
        });
        &mut self.states[index]
    }

    /// Returns the last published step of one body within one block.
    pub(super) fn last_turn(&self, key: BodyKey) -> Neighbour {
        let state = self.states.iter().find(|state| state.key == key);
        state.map_or(Neighbour::Absent, |state| state.last_turn)
    }

    /// Whether the outline of a body was found in the last published frame of a block; `None` before its first one.
    pub(super) fn was_found(&self, key: BodyKey) -> Option<bool> {
        self.states.iter().find(|state| state.key == key).and_then(|state| state.was_found)
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
