//! The highest rate that a rig keeps up with.

use super::Plan;
use super::rig::Folder;
use super::trial::{self, Trial};
use crate::failure::Failure;
use crate::process::Stop;

/// The first rate that is tried, Hz.
const START_HZ: f64 = 1000.0;
/// The search ends when the next higher rate that failed is at most this much higher.
const RESOLUTION: f64 = 1.05;
/// The range of rates, Hz.
const RATES_HZ: std::ops::RangeInclusive<f64> = 10.0..=500_000.0;

/// Returns the run at the highest rate that the rig keeps up with, to 5 %; `None` if it keeps up with none, or was
/// stopped before.
///
/// Doubles or halves the rate until one that is kept up with lies below one that is not, then bisects. `report` gets
/// every run.
///
/// # Errors
///
/// When the rig cannot run.
pub(super) fn highest_rate(
    plan: &Plan,
    folder: &Folder,
    stop: &Stop,
    mut report: impl FnMut(&Trial),
) -> Result<Option<Trial>, Failure> {
    let (mut kept, mut too_high_hz): (Option<Trial>, Option<f64>) = (None, None);
    let mut rate_hz = START_HZ;
    while RATES_HZ.contains(&rate_hz) {
        let Some(trial) = trial::run(&Plan { rate_hz, ..plan.clone() }, folder, stop)? else { return Ok(None) };
        report(&trial);
        match trial.shortfalls().is_empty() {
            true => kept = Some(trial),
            false => too_high_hz = Some(rate_hz),
        }
        rate_hz = match (kept.as_ref().map(|trial| trial.plan.rate_hz), too_high_hz) {
            (Some(low_hz), Some(high_hz)) if high_hz <= RESOLUTION * low_hz => break,
            (Some(low_hz), Some(high_hz)) => (low_hz * high_hz).sqrt().round(),
            (Some(low_hz), None) => 2.0 * low_hz,
            (None, Some(high_hz)) => 0.5 * high_hz,
            (None, None) => break,
        };
    }
    Ok(kept)
}
