//! The `track` row: where a body is.

use super::Rod;
use super::columns::sample_row;

/// Passes the columns of the `track` row to a macro, each with its number in the protobuf message.
macro_rules! track_row {
    ($derive:ident) => {
        $derive! {
            /// A row of the `track` table: the position of one body in one frame.
            ///
            /// # Examples
            ///
            /// ```
            /// use ricochet::message::TrackMessage;
            /// use ricochet::results::{PointStatus, TrackSample};
            ///
            /// let sample = TrackSample {
            ///     frame: 12,
            ///     body: 0,
            ///     stamp_ns: 1_700_000_000_001_200_000,
            ///     center_x_px: Some(122.8),
            ///     // y points down, from the centre of the top-left pixel.
            ///     center_y_px: Some(96.0),
            ///     // Nothing on this body turns visibly.
            ///     angle_deg: None,
            ///     radius_px: Some(61.5),
            ///     sigma_center_px: Some(0.01),
            ///     sigma_angle_deg: None,
            ///     visible_fraction: Some(1.0),
            ///     rod: None,
            ///     status: PointStatus::Valid,
            /// };
            /// // A running rig publishes it as a message with the same content.
            /// assert_eq!(TrackMessage::new(&sample, 0).sample(), Some(sample));
            /// ```
            TrackSample(TrackMessage, "ricochet.Track.v2", Track) {
                numbers {
                    /// The centre along x, px.
                    center_x_px = 4,
                    /// The centre along y (down), px.
                    center_y_px = 5,
                    /// The rotation since the body's first frame, counter-clockwise on the screen, deg.
                    angle_deg = 6,
                    /// The radius, px.
                    radius_px = 7,
                    /// The standard uncertainty of each centre coordinate, px.
                    sigma_center_px = 8,
                    /// The standard uncertainty of the rotation, deg.
                    sigma_angle_deg = 9,
                    /// The visible share of the body, 0 to 1.
                    visible_fraction = 10,
                }
                groups {}
                numbers {}
                names {}
                status = 11,
                reasons {}
                nested {
                    /// The rod, if the body is one.
                    rod: Rod, RodMessage = 12,
                }
            }
        }
    };
}
pub(crate) use track_row;

track_row!(sample_row);
