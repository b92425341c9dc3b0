//! The columns of a rod in the `track` table.

use crate::results::{PointStatus, ROD_EDGES, Rod, RodEdge};

/// The columns of the edges.
const EDGES: [&str; ROD_EDGES] = ["edge_1_px", "edge_2_px", "edge_3_px", "edge_4_px"];
/// The columns of their standard uncertainties.
const SIGMAS: [&str; ROD_EDGES] = ["sigma_edge_1_px", "sigma_edge_2_px", "sigma_edge_3_px", "sigma_edge_4_px"];
/// The columns of their statuses.
const STATUSES: [&str; ROD_EDGES] = ["edge_1_status", "edge_2_status", "edge_3_status", "edge_4_status"];

/// Returns the numbers of a rod by column, the edges first; `None` for those that were not measured.
pub(super) fn number_cells(rod: Option<&Rod>) -> Vec<(&'static str, Option<f64>)> {
    let place = |index: usize| rod.and_then(|rod| rod.edges[index]).and_then(|edge| edge.y_px);
    let edges = (0..ROD_EDGES).map(|index| (EDGES[index], place(index).map(|y| y.value)));
    let sigmas = (0..ROD_EDGES).map(|index| (SIGMAS[index], place(index).map(|y| y.sigma)));
    let shape = [
        ("tilt_deg", rod.map(|rod| rod.tilt_deg.value)),
        ("sigma_tilt_deg", rod.map(|rod| rod.tilt_deg.sigma)),
        ("half_width_px", rod.map(|rod| rod.half_width_px.value)),
        ("sigma_half_width_px", rod.map(|rod| rod.half_width_px.sigma)),
    ];
    edges.chain(sigmas).chain(shape).collect()
}

/// Returns the status of each edge of a rod by column; `None` for those that are not followed.
pub(super) fn status_cells(rod: Option<&Rod>) -> Vec<(&'static str, Option<PointStatus>)> {
    let status = |edge: RodEdge| edge.status;
    (0..ROD_EDGES).map(|index| (STATUSES[index], rod.and_then(|rod| rod.edges[index]).map(status))).collect()
}
