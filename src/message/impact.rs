//! The `impact` topic.

use crate::results::{Estimate, IMPACT_NUMBERS, Impact};
use iceoryx2::prelude::ZeroCopySend;

/// A number that may be missing, with its standard uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
#[type_name("ricochet.Estimate.v1")]
#[repr(C)]
pub struct EstimateMessage {
    /// The number; 0 and meaningless unless `known` is 1.
    pub value: f64,
    /// Its standard uncertainty.
    pub sigma: f64,
    /// 1 when measured, 0 when missing.
    pub known: u64,
}

impl From<Option<Estimate>> for EstimateMessage {
    fn from(estimate: Option<Estimate>) -> Self {
        estimate.map_or_else(Self::default, |Estimate { value, sigma }| Self { value, sigma, known: 1 })
    }
}

/// One collision of one body; told again with a higher revision when it is known better.
#[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
#[type_name("ricochet.Impact.v4")]
#[repr(C)]
pub struct ImpactMessage {
    /// Which start of the acquire process the frames belong to.
    pub run_id: u64,
    /// The moment the `_s` times count from, ns since the Unix epoch.
    pub origin_ns: u64,
    /// Index of the body in the rig's configuration.
    pub body: u32,
    /// Counts the collisions of this body from 0.
    pub number: u32,
    /// Counts up each time the same collision is told again.
    pub revision: u32,
    /// Number of the `ForceLaw`.
    pub force_law: u32,
    /// Number of the `PointStatus`.
    pub status: u32,
    /// How probable that law is among those that follow the motion, 0 to 1; 0 where none was fitted.
    pub force_law_probability: f32,
    /// In this order: start, deepest, end (s), normal speed before, after, tangential before, after (m/s),
    /// spin before, after (rad/s), restitution, tangential restitution, impulse ratio, contact time (s),
    /// peak compression (mm), peak acceleration (m/s^2), end of slip (s), force at 2 % of its peak, rising and falling
    /// (s), peak force (N), energy lost (J), gravity as seen in flight (m/s^2), growth in the picture before and
    /// after (1/s).
    pub numbers: [EstimateMessage; IMPACT_NUMBERS],
}

impl ImpactMessage {
    /// The message of a collision of this run.
    pub fn new(impact: &Impact, run_id: u64) -> Self {
        Self {
            run_id,
            origin_ns: impact.origin_ns,
            body: impact.body,
            number: impact.number,
            revision: impact.revision,
            force_law: impact.force_law as u32,
            status: impact.status as u32,
            force_law_probability: impact.force_law_probability.unwrap_or_default() as f32,
            numbers: impact.numbers().map(|(_, estimate)| estimate.into()),
        }
    }
}
