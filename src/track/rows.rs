//! Rows that the tracker emits.

use crate::results::{Alarm, Impact, TrackSample, VelocitySample};

/// Emitted rows in the order of their emission. The tracker appends, the caller takes them out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TrackerRows {
    /// One track row per step, in the order of the steps.
    pub tracks: Vec<TrackSample>,
    /// One velocity row per step, in the order of the steps.
    pub velocities: Vec<VelocitySample>,
    /// One or several impacts per collision; the highest `revision` per `body` and `number` is valid.
    pub impacts: Vec<Impact>,
    /// The events of a collision before it is over.
    pub alarms: Vec<Alarm>,
}
