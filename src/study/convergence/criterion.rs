//! The convergence criterion: the change between successive results.

use crate::numeric::quantile;

/// The displacement of every subset of every pair in a fixed order; `None` if it is not valid.
pub(super) type Displacements = Vec<Option<[f64; 2]>>;

/// The difference between two results, over subsets valid in both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Change {
    /// Number of subsets valid in both.
    pub(super) compared: usize,
    /// Median of |du| and of |dv|, px.
    pub(super) median_px: [f64; 2],
    /// The 99 % quantile of |du| and of |dv|, px.
    pub(super) p99_px: [f64; 2],
}

/// The error of displacements against the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Deviation {
    /// Maximum absolute mean error of one pair along one axis, px: the bias due to the fraction of the displacement.
    pub(super) bias_px: f64,
    /// Root mean square error over both axes, px.
    pub(super) rms_px: f64,
    /// Maximum absolute error along one axis, px.
    pub(super) max_px: f64,
}

/// Compares two results in the same order; returns `None` if no subset is valid in both.
pub(super) fn change(before: &Displacements, after: &Displacements) -> Option<Change> {
    let both: Vec<_> = before.iter().zip(after).filter_map(|(a, b)| a.zip(*b)).collect();
    let apart = |axis: usize| both.iter().map(|(a, b)| (a[axis] - b[axis]).abs()).collect::<Vec<f64>>();
    let (mut du, mut dv) = (apart(0), apart(1));
    Some(Change {
        compared: both.len(),
        median_px: [quantile(&mut du, 0.5)?, quantile(&mut dv, 0.5)?],
        p99_px: [quantile(&mut du, 0.99)?, quantile(&mut dv, 0.99)?],
    })
}

/// Compares displacements with the truth of their pair; returns `None` if there are no displacements.
///
/// All pairs have the same number of displacements, stored one pair after the other. `truth_px` has one per pair.
pub(super) fn deviation(displacements: &Displacements, truth_px: &[[f64; 2]]) -> Option<Deviation> {
    let each = displacements.len().checked_div(truth_px.len())?.max(1);
    let (mut bias_px, mut squares, mut max_px, mut count) = (0.0_f64, 0.0, 0.0_f64, 0_usize);
    for (displacements, truth) in displacements.chunks(each).zip(truth_px) {
        for axis in 0..2 {
            let errors: Vec<f64> =
                displacements.iter().flatten().map(|displacement| displacement[axis] - truth[axis]).collect();
            if !errors.is_empty() {
                bias_px = bias_px.max((errors.iter().sum::<f64>() / errors.len() as f64).abs());
            }
            squares += errors.iter().map(|error| error * error).sum::<f64>();
            max_px = errors.iter().fold(max_px, |max, error| max.max(error.abs()));
            count += errors.len();
        }
    }
    (count > 0).then(|| Deviation { bias_px, rms_px: (squares / count as f64).sqrt(), max_px })
}

/// Returns the mean of all displacements; `None` if there are none.
pub(super) fn mean_displacement(displacements: &Displacements) -> Option<[f64; 2]> {
    let found: Vec<_> = displacements.iter().flatten().collect();
    let along = |axis: usize| found.iter().map(|displacement| displacement[axis]).sum::<f64>() / found.len() as f64;
    (!found.is_empty()).then(|| [along(0), along(1)])
}

/// The result for one number of spline points.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stage {
    pub(super) spline_points: u32,
    /// Number of subsets with a valid displacement.
    pub(super) valid: usize,
    /// Change against the previous stage.
    pub(super) change: Option<Change>,
    /// Whether displacements are multiples of 1 / (points + 1) px.
    pub(super) on_grid: bool,
}

impl Stage {
    /// Whether 99 % of the displacements agree with those of the previous stage within the tolerance, px.
    ///
    /// At least half of the valid displacements must be comparable.
    ///
    /// An displacement on a grid is only known to half a grid step. Two grids that agree more closely than that agree as
    /// grids, not as measurements: a shift too small for either reads 0 on both.
    fn agrees(&self, tolerance_px: f64) -> bool {
        let resolved = !self.on_grid || 0.5 / f64::from(self.spline_points + 1) <= tolerance_px;
        resolved
            && self.change.is_some_and(|change| {
                let [du, dv] = change.p99_px;
                du < tolerance_px && dv < tolerance_px && 2 * change.compared >= self.valid
            })
    }
}

/// Returns the number of spline points from which on 99 % of the displacements change by less than the tolerance; `None` if
/// the last stage still changes.
pub(super) fn converged_points(stages: &[Stage], tolerance_px: f64) -> Option<u32> {
    let last = stages.iter().rposition(|stage| !stage.agrees(tolerance_px));
    stages.get(last.map_or(0, |last| last + 1)).map(|stage| stage.spline_points)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stage(spline_points: u32, change_px: f64) -> Stage {
        let change = Change { compared: 10, median_px: [0.0; 2], p99_px: [0.5 * change_px, change_px] };
        Stage { spline_points, valid: 10, change: Some(change), on_grid: false }
    }

    fn first() -> Stage {
        Stage { change: None, ..stage(0, 0.0) }
    }

    #[test]
    fn the_first_stage_after_which_nothing_changes_has_converged() {
        let stages = [first(), stage(1, 0.01), stage(2, 0.0009), stage(3, 0.0004)];
        assert_eq!(converged_points(&stages, 0.001), Some(2));
        assert_eq!(converged_points(&stages, 0.02), Some(1));
        let relapse = [first(), stage(1, 0.0001), stage(2, 0.002), stage(3, 0.0004)];
        assert_eq!(converged_points(&relapse, 0.001), Some(3));
        assert_eq!(converged_points(&[first(), stage(1, 0.0001), stage(2, 0.002)], 0.001), None);
        assert_eq!(converged_points(&[first()], 0.001), None, "one stage has nothing to agree with");
        assert_eq!(converged_points(&[], 0.001), None);
    }

    #[test]
    fn grids_that_agree_on_zero_have_not_converged() {
        let still = |points: u32| Stage { on_grid: true, ..stage(points, 0.0) };
        let stages = [first(), still(1), still(5), still(20)];
        assert_eq!(converged_points(&stages, 0.001), None);
        // Half a step of 1/21 px is 0.0238 px.
        assert_eq!(converged_points(&stages, 0.025), Some(20));
    }

    #[test]
    fn agreement_of_a_few_subsets_is_not_convergence() {
        let few = Stage { valid: 21, ..stage(2, 0.0001) };
        assert_eq!(converged_points(&[first(), few], 0.001), None);
    }

    #[test]
    fn a_change_counts_subsets_with_both_answers_only() {
        let before: Displacements = (0..100).map(|k| (k != 7).then_some([1.0, 2.0])).collect();
        let after: Displacements =
            (0..100).map(|k| (k != 8).then_some([1.0 + 0.001 * f64::from(k), 2.0 - 0.002 * f64::from(k)])).collect();
        let change = change(&before, &after).unwrap();
        assert_eq!(change.compared, 98);
        // In 0..99 without 7 and 8 the 50th is 51, the upper of the two in the middle, and the 97th (96 of 97 steps)
        // 98.
        assert!((change.median_px[0] - 0.051).abs() < 1e-9 && (change.median_px[1] - 0.102).abs() < 1e-9, "{change:?}");
        assert!((change.p99_px[0] - 0.098).abs() < 1e-9 && (change.p99_px[1] - 0.196).abs() < 1e-9, "{change:?}");
        assert_eq!(super::change(&vec![None], &vec![Some([0.0; 2])]), None);
    }

    #[test]
    fn opposite_errors_of_two_pairs_do_not_cancel_in_the_bias() {
        let displacements = vec![Some([1.02, 0.0]), Some([1.04, 0.0]), Some([1.97, 0.0]), None];
        let deviation = deviation(&displacements, &[[1.0, 0.0], [2.0, 0.0]]).unwrap();
        assert!((deviation.bias_px - 0.03).abs() < 1e-12 && (deviation.max_px - 0.04).abs() < 1e-12, "{deviation:?}");
        let squares: f64 = 0.02 * 0.02 + 0.04 * 0.04 + 0.03 * 0.03;
        assert!((deviation.rms_px - (squares / 6.0).sqrt()).abs() < 1e-12, "{deviation:?}");
        assert_eq!(super::deviation(&vec![None, None], &[[0.0; 2]]), None);
        assert_eq!(mean_displacement(&vec![Some([1.0, 2.0]), None, Some([3.0, 6.0])]), Some([2.0, 4.0]));
    }
}
