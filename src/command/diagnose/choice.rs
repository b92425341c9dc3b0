//! The frames that a diagnosis shows.

use crate::results::{PointStatus, VelocitySample};
use std::collections::BTreeMap;

/// The reason why a frame is shown, and its status.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Choice {
    pub(super) reason: &'static str,
    pub(super) status: PointStatus,
}

/// Chooses the frames to show, by their sequence numbers.
///
/// These are the wanted ones, by their numbers from `first_frame`. Without any they are the first, the first of each
/// status, the middle and the last.
pub(super) fn choose_frames(rows: &[VelocitySample], first_frame: u64, wanted: &[u64]) -> BTreeMap<u64, Choice> {
    let mut chosen = BTreeMap::new();
    let mut add = |row: Option<&VelocitySample>, reason| {
        if let Some(row) = row {
            chosen.entry(row.frame).or_insert(Choice { reason, status: row.status });
        }
    };
    if !wanted.is_empty() {
        for number in wanted {
            add(rows.iter().find(|row| row.frame - first_frame == *number), "as asked for");
        }
        return chosen;
    }
    for status in PointStatus::ALL {
        let reason = if status == PointStatus::Valid { "first that was measured" } else { "first with this reason" };
        add(rows.iter().find(|row| row.status == status), reason);
    }
    add(rows.first(), "first of the film");
    add(rows.get(rows.len() / 2), "middle of the film");
    add(rows.last(), "last of the film");
    chosen
}
