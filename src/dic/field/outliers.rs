//! Outlier detection: vectors that are inconsistent with their neighbours.
//!
//! The universal median test of J. Westerweel and F. Scarano, Exp. Fluids 39 (2005) 1096,
//! <https://doi.org/10.1007/s00348-005-0016-6>, applied to predictions instead of the neighbours' values: means of
//! opposite neighbours and linear extrapolations of two in a row. Both are exact in a linear field, so a rotation of
//! the body by some degrees raises no false alarm, not even at the border.

use crate::dic::geometry::GridPoint;
use crate::numeric::median;
use crate::results::{FieldPoint, PointStatus};

/// The tolerated difference in the absence of any scatter, px.
const FLOOR_PX: f32 = 0.1;

/// The tolerated multiple of the predictions' median scatter.
const THRESHOLD: f32 = 2.0;

/// The minimum number of predictions of the test.
const MIN_PREDICTIONS: usize = 3;

/// The minimum ZNCC of a vector without enough valid neighbours, most of them having failed.
const MIN_LONE_ZNCC: f32 = 0.9;

/// The eight directions to neighbours; the first four are the opposites of the last four.
const DIRECTIONS: [(isize, isize); 8] = [(1, 0), (0, 1), (1, 1), (1, -1), (-1, 0), (0, -1), (-1, -1), (-1, 1)];

/// The width of the empty border of the lattice: neighbours of neighbours need no bounds test.
const BORDER: usize = 2;

/// Memory of the median test.
#[derive(Debug, Clone, Default)]
pub(in crate::dic) struct MedianTest {
    /// The index of the point in each cell.
    lattice: Vec<u32>,
    columns: usize,
    /// The cell of each point on the lattice.
    cells: Vec<Option<usize>>,
    outliers: Vec<usize>,
}

/// The index of an empty cell.
const NO_POINT: u32 = u32::MAX;

impl MedianTest {
    /// Marks outliers among the points of a field that have a displacement, and removes it.
    ///
    /// `field` has one point per grid point, in the order of `points`. All points are judged before any is removed.
    pub(in crate::dic) fn mark(&mut self, points: &[GridPoint], step_px: u32, field: &mut [FieldPoint]) {
        self.build_lattice(points, step_px);
        self.outliers.clear();
        for index in 0..points.len() {
            if field[index].displacement.is_some() && self.is_inconsistent(index, field) {
                self.outliers.push(index);
            }
        }
        for index in &self.outliers {
            field[*index].displacement = None;
            field[*index].status = PointStatus::Outlier;
        }
    }

    /// Maps the points to a lattice of cells one step wide. Points off the lattice have no neighbours.
    fn build_lattice(&mut self, points: &[GridPoint], step_px: u32) {
        self.lattice.clear();
        self.cells.clear();
        let Some(first) = points.first() else { return };
        let low = |pick: fn(&GridPoint) -> u32| points.iter().map(pick).min().unwrap_or(0);
        let high = |pick: fn(&GridPoint) -> u32| points.iter().map(pick).max().unwrap_or(0);
        let step = step_px.max(1);
        let ((left, right), (top, bottom)) = ((low(|p| p.x), high(|p| p.x)), (low(|p| p.y), high(|p| p.y)));
        // The lattice passes through the first point.
        let origin = (left + (first.x - left) % step, top + (first.y - top) % step);
        let extent = |high: u32, origin: u32| (high.saturating_sub(origin) / step + 1) as usize + 2 * BORDER;
        let (columns, rows) = (extent(right, origin.0), extent(bottom, origin.1));
        self.columns = columns;
        self.lattice.resize(columns * rows, NO_POINT);
        self.cells.extend(points.iter().map(|point| {
            let (x, y) = (point.x.checked_sub(origin.0)?, point.y.checked_sub(origin.1)?);
            let (column, row) = ((x / step) as usize + BORDER, (y / step) as usize + BORDER);
            (x % step == 0 && y % step == 0).then_some(row * columns + column)
        }));
        for (index, cell) in self.cells.iter().enumerate() {
            if let Some(cell) = cell {
                self.lattice[*cell] = index as u32;
            }
        }
    }

    /// Whether the point with this index is inconsistent with the predictions from its neighbours.
    ///
    /// With fewer than [`MIN_PREDICTIONS`], whether more than half of its neighbours failed and its ZNCC is below
    /// [`MIN_LONE_ZNCC`].
    fn is_inconsistent(&self, index: usize, field: &[FieldPoint]) -> bool {
        let columns = self.columns as isize;
        let at = |(dx, dy): (isize, isize), times: isize| {
            let cell = self.cells[index]?.wrapping_add_signed(times * (dy * columns + dx));
            field.get(self.lattice[cell] as usize)
        };
        let tried = DIRECTIONS.into_iter().filter_map(|direction| at(direction, 1)).count();
        let at = |direction, times| {
            let displacement = at(direction, times)?.displacement?;
            Some((displacement.u_px, displacement.v_px))
        };
        let Some(own) = field[index].displacement else { return false };
        let (mut us, mut vs) = ([0.0_f32; 12], [0.0_f32; 12]);
        let mut count = 0;
        let mut predict = |u: f32, v: f32| {
            (us[count], vs[count]) = (u, v);
            count += 1;
        };
        for (k, direction) in DIRECTIONS.into_iter().enumerate() {
            let Some(near) = at(direction, 1) else { continue };
            if let Some(far) = at(direction, 2) {
                predict(2.0 * near.0 - far.0, 2.0 * near.1 - far.1);
            }
            if k >= 4 {
                continue;
            }
            if let Some(opposite) = at(DIRECTIONS[k + 4], 1) {
                predict(0.5 * (near.0 + opposite.0), 0.5 * (near.1 + opposite.1));
            }
        }
        if count >= MIN_PREDICTIONS {
            return exceeds_scatter(own.u_px, &mut us[..count]) || exceeds_scatter(own.v_px, &mut vs[..count]);
        }
        let found = DIRECTIONS.into_iter().filter(|direction| at(*direction, 1).is_some()).count();
        2 * found < tried && field[index].zncc.is_some_and(|zncc| zncc < MIN_LONE_ZNCC)
    }
}

/// Whether `own`, px, is further from the median of the predictions, px, than their scatter explains. Overwrites them.
///
/// The scatter is the median distance of the predictions from their median, plus [`FLOOR_PX`]; [`THRESHOLD`] times it
/// is tolerated.
fn exceeds_scatter(own: f32, predictions: &mut [f32]) -> bool {
    // The median is no further off than the farthest prediction. Most vectors need no sorting.
    if predictions.iter().all(|prediction| (own - prediction).abs() <= THRESHOLD * FLOOR_PX) {
        return false;
    }
    let Some(center) = median(predictions) else { return false };
    predictions.iter_mut().for_each(|value| *value = (*value - center).abs());
    median(predictions).is_some_and(|scatter| (own - center).abs() > THRESHOLD * (scatter + FLOOR_PX))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dic::geometry::grid::rectangle;
    use crate::results::Displacement;

    /// A body rotated by 3 degrees and stretched, without noise.
    fn turned(points: &[GridPoint]) -> Vec<FieldPoint> {
        let displacement = |p: &GridPoint| {
            let (x, y) = (p.x as f32, p.y as f32);
            Displacement { u_px: 0.05 * y + 0.01 * x, v_px: -0.05 * x, sigma_u_px: 0.01, sigma_v_px: 0.01 }
        };
        let point = |p: &GridPoint| FieldPoint {
            x_px: p.x as f32,
            y_px: p.y as f32,
            displacement: Some(displacement(p)),
            zncc: Some(0.99),
            peak_ratio: None,
            status: PointStatus::Valid,
        };
        points.iter().map(point).collect()
    }

    #[test]
    fn a_poor_vector_among_failures_is_an_outlier_and_a_good_one_is_not() {
        for (zncc, status) in [(0.75, PointStatus::Outlier), (0.97, PointStatus::Valid)] {
            let points = rectangle([0, 0, 120, 120], 10, 31);
            let mut field = turned(&points);
            let alone = points.len() / 2;
            for (index, point) in field.iter_mut().enumerate().filter(|(index, _)| *index != alone) {
                assert_ne!(index, alone);
                (point.displacement, point.status) = (None, PointStatus::LowCorrelation);
            }
            field[alone].zncc = Some(zncc);
            MedianTest::default().mark(&points, 10, &mut field);
            assert_eq!(field[alone].status, status, "ZNCC {zncc}");
            assert_eq!(field[alone].displacement.is_some(), status == PointStatus::Valid);
        }
    }

    #[test]
    fn a_turn_of_three_degrees_holds_no_outlier() {
        let points = rectangle([0, 0, 200, 160], 16, 31);
        let mut field = turned(&points);
        MedianTest::default().mark(&points, 16, &mut field);
        assert!(field.iter().all(|point| point.status == PointStatus::Valid));
    }

    #[test]
    fn exactly_the_false_vectors_are_marked_with_dirty_memory() {
        let points = rectangle([3, 5, 260, 260], 16, 31);
        let mut field = turned(&points);
        let mut test = MedianTest::default();
        test.mark(&rectangle([0, 0, 100, 400], 7, 21), 7, &mut turned(&rectangle([0, 0, 100, 400], 7, 21)));
        let spoiled = [0, 40, 87, 100, points.len() - 1];
        for index in spoiled {
            if let Some(displacement) = &mut field[index].displacement {
                displacement.u_px += 0.7;
            }
        }
        test.mark(&points, 16, &mut field);
        let marked: Vec<usize> = (0..field.len()).filter(|i| field[*i].status == PointStatus::Outlier).collect();
        assert_eq!(marked, spoiled);
        assert!(spoiled.iter().all(|i| field[*i].displacement.is_none()));
    }
}
