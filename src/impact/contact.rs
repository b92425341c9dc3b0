//! A contact as it is detected.

use crate::results::Estimate;

/// A detected contact before any law is fitted. Times are in node periods since the stream's first frame: a long contact is measured in every `stride`-th frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// The start of the known flight before the contact.
    pub flight_from_frames: f64,
    /// The end of what is certainly flight.
    pub flight_to_frames: f64,
    /// The onset of the force, by the hinge fit.
    pub start_frames: f64,
    /// The first node off the flight's curve.
    pub departed_frames: f64,
    /// The normal velocity before contact, px/node.
    pub approach: Estimate,
    /// The peak normal acceleration so far, px/node^2.
    pub acceleration_max: f64,
    /// The start of the flight after the contact; `None` while the contact lasts.
    pub end_frames: Option<f64>,
    /// The frames between two nodes, which are the unit of its times and rates.
    pub stride: u32,
}

impl Contact {
    /// Returns the time from the end of the contact to a frame, in node periods; 0 while it lasts.
    pub fn nodes_since_end(&self, time_frames: f64) -> f64 {
        self.end_frames.map_or(0.0, |end| time_frames / f64::from(self.stride) - end)
    }
}
