//! The `track` topic.

use super::{Number, RodMessage};
use crate::results::TrackSample;
use iceoryx2::prelude::ZeroCopySend;

/// One body's place in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
#[type_name("ricochet.Track.v2")]
#[repr(C)]
pub struct TrackMessage {
    /// Which start of the acquire process the frame belongs to.
    pub run_id: u64,
    /// Sequence number of the frame.
    pub sequence: u64,
    /// Exposure start, ns since the Unix epoch.
    pub stamp_ns: u64,
    /// Index of the body in the rig's configuration.
    pub body: u32,
    /// Number of the `PointStatus`.
    pub status: u32,
    /// Centre, px.
    pub center_x_px: Number,
    /// Centre, px (down).
    pub center_y_px: Number,
    /// Turned since the body's first frame, counter-clockwise on the screen, deg.
    pub angle_deg: Number,
    /// Radius, px.
    pub radius_px: Number,
    /// Standard uncertainty of each centre coordinate, px.
    pub sigma_center_px: Number,
    /// Standard uncertainty of the angle, deg.
    pub sigma_angle_deg: Number,
    /// Share of the body that is not hidden.
    pub visible_fraction: Number,
    /// The rod, where the body is one.
    pub rod: RodMessage,
}

impl TrackMessage {
    /// The message of a sample of this run.
    pub fn new(sample: &TrackSample, run_id: u64) -> Self {
        Self {
            run_id,
            sequence: sample.frame,
            stamp_ns: sample.stamp_ns,
            body: sample.body,
            status: sample.status as u32,
            center_x_px: sample.center_x_px.into(),
            center_y_px: sample.center_y_px.into(),
            angle_deg: sample.angle_deg.into(),
            radius_px: sample.radius_px.into(),
            sigma_center_px: sample.sigma_center_px.into(),
            sigma_angle_deg: sample.sigma_angle_deg.into(),
            visible_fraction: sample.visible_fraction.into(),
            rod: sample.rod.into(),
        }
    }
}
