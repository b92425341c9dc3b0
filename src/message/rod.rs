//! A rod, as part of the messages on `field` and `track`.

use super::layout::described;
use crate::results::{Estimate, PointStatus, ROD_EDGES, Rod, RodEdge};
use iceoryx2::prelude::ZeroCopySend;

described! {
    "ricochet.Rod.v1"
    /// A rod in one frame.
    ///
    /// # Examples
    ///
    /// ```
    /// use ricochet::message::RodMessage;
    /// use ricochet::results::Rod;
    ///
    /// let message = RodMessage { known: 1, edges: 2, x_px: 128.0, sigma_x_px: 0.02, ..RodMessage::default() };
    /// let rod = Option::<Rod>::from(message).unwrap();
    /// assert_eq!((rod.x_px.value, rod.edges.iter().flatten().count()), (128.0, 2));
    /// // A position of an edge that is not known is missing, never 0.
    /// assert!(rod.edges.iter().flatten().all(|edge| edge.y_px.is_none()));
    /// assert_eq!(Option::<Rod>::from(RodMessage::default()), None);
    /// ```
    #[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
    #[repr(C)]
    pub struct RodMessage {
        /// 1 when there is a rod; otherwise the fields below have no meaning.
        pub known: u32,
        /// The number of tracked edges, from the top downwards; entries of the arrays beyond them are zero.
        pub edges: u32,
        /// For each edge, the number of its `PointStatus`.
        pub edge_status: [u32; ROD_EDGES],
        /// For each edge, 1 when its position was measured.
        pub edge_known: [u32; ROD_EDGES],
        /// The position where each edge crosses the middle of the rod, px (down).
        pub edge_px: [f64; ROD_EDGES],
        /// The standard uncertainty of each, px.
        pub sigma_edge_px: [f64; ROD_EDGES],
        /// The middle between the sides, px.
        pub x_px: f64,
        /// The standard uncertainty of `x_px`.
        pub sigma_x_px: f64,
        /// The point that moves with it, px (down).
        pub y_px: f64,
        /// The standard uncertainty of `y_px`.
        pub sigma_y_px: f64,
        /// Half of the distance between the sides, px.
        pub half_width_px: f64,
        /// The standard uncertainty of `half_width_px`.
        pub sigma_half_width_px: f64,
        /// The tilt from upright, counter-clockwise on the screen, deg.
        pub tilt_deg: f64,
        /// The standard uncertainty of `tilt_deg`.
        pub sigma_tilt_deg: f64,
    }
}

impl From<Option<Rod>> for RodMessage {
    /// Returns the message of a rod, all zeros without one. The tracked edges come first.
    fn from(rod: Option<Rod>) -> Self {
        let Some(rod) = rod else { return Self::default() };
        let edge_px = |index: usize| rod.edges[index].and_then(|edge| edge.y_px);
        Self {
            known: 1,
            edges: rod.edges.iter().flatten().count() as u32,
            edge_status: rod.edges.map(|edge| edge.map_or(0, |edge| edge.status as u32)),
            edge_known: std::array::from_fn(|index| u32::from(edge_px(index).is_some())),
            edge_px: std::array::from_fn(|index| edge_px(index).map_or(0.0, |y| y.value)),
            sigma_edge_px: std::array::from_fn(|index| edge_px(index).map_or(0.0, |y| y.sigma)),
            x_px: rod.x_px.value,
            sigma_x_px: rod.x_px.sigma,
            y_px: rod.y_px.value,
            sigma_y_px: rod.y_px.sigma,
            half_width_px: rod.half_width_px.value,
            sigma_half_width_px: rod.half_width_px.sigma,
            tilt_deg: rod.tilt_deg.value,
            sigma_tilt_deg: rod.tilt_deg.sigma,
        }
    }
}

impl From<RodMessage> for Option<Rod> {
    /// Returns the rod of a message; an edge is lost if the number of its status is unknown.
    fn from(message: RodMessage) -> Self {
        let estimate = |value, sigma| Estimate { value, sigma };
        let edge = |index: usize| RodEdge {
            y_px: (message.edge_known[index] == 1)
                .then(|| estimate(message.edge_px[index], message.sigma_edge_px[index])),
            status: PointStatus::from_number(message.edge_status[index]).unwrap_or(PointStatus::Lost),
        };
        (message.known == 1).then(|| Rod {
            x_px: estimate(message.x_px, message.sigma_x_px),
            y_px: estimate(message.y_px, message.sigma_y_px),
            half_width_px: estimate(message.half_width_px, message.sigma_half_width_px),
            tilt_deg: estimate(message.tilt_deg, message.sigma_tilt_deg),
            edges: std::array::from_fn(|index| (index < message.edges as usize).then(|| edge(index))),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rod_survives_the_bus() {
        let estimate = |value| Estimate { value, sigma: 0.01 * value };
        let edge = |y_px, status| Some(RodEdge { y_px, status });
        let rod = Rod {
            x_px: estimate(31.4),
            y_px: estimate(56.25),
            half_width_px: estimate(15.0),
            tilt_deg: estimate(-0.5),
            edges: [
                edge(Some(estimate(31.25)), PointStatus::Valid),
                edge(None, PointStatus::OutOfFrame),
                edge(Some(estimate(101.5)), PointStatus::Valid),
                None,
            ],
        };
        assert_eq!(Option::from(RodMessage::from(Some(rod))), Some(rod));
        assert_eq!(Option::<Rod>::from(RodMessage::from(None)), None);
    }
}
