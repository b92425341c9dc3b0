//! Mean absolute errors and their standard deviation, as in the paper's figures.

use serde_json::json;

use super::films_plan::{Case, Film, Speeds};
use super::methods::Method;
use super::row::Row;
use crate::study::output_files::{Cell, rounded};
use crate::synth::PatternSetup;

/// Statistics of the absolute errors along one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ErrorStatistics {
    /// Number of frame pairs with an answer.
    pub(super) count: usize,
    /// Mean absolute error.
    pub(super) mean: f64,
    /// Standard deviation of the absolute errors, like the error bars of the paper; `None` for a single one.
    pub(super) spread: Option<f64>,
    /// Maximum absolute error.
    pub(super) max: f64,
    /// Mean signed error.
    pub(super) bias: f64,
}

impl ErrorStatistics {
    /// Computes the statistics of errors; `None` without any.
    pub(super) fn compute(errors: &[f64]) -> Option<Self> {
        let count = errors.len() as f64;
        let mean = errors.iter().map(|error| error.abs()).sum::<f64>() / count;
        let squares: f64 = errors.iter().map(|error| (error.abs() - mean).powi(2)).sum();
        (!errors.is_empty()).then(|| Self {
            count: errors.len(),
            mean,
            spread: (errors.len() > 1).then(|| (squares / (count - 1.0)).sqrt()),
            max: errors.iter().fold(0.0, |max, error| max.max(error.abs())),
            bias: errors.iter().sum::<f64>() / count,
        })
    }
}

/// One method on all films of one pattern, set of speeds and case.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Group {
    pub(super) pattern: usize,
    pub(super) speeds: Speeds,
    pub(super) case: Case,
    pub(super) method: Method,
    pub(super) films: usize,
    /// Number of frame pairs.
    pub(super) pairs: usize,
    /// Number of frame pairs without an answer.
    pub(super) missing: usize,
    /// Errors along x and y, px/frame, and of the rotation, deg/frame.
    ///
    /// In the one-axis cases only films that move along the axis count.
    pub(super) errors: [Option<ErrorStatistics>; 3],
}

/// Columns of the statistics along x, along y and of the rotation.
const STATISTICS: [[&str; 4]; 3] = [
    ["mean_x_px", "spread_x_px", "max_x_px", "bias_x_px"],
    ["mean_y_px", "spread_y_px", "max_y_px", "bias_y_px"],
    ["mean_deg", "spread_deg", "max_deg", "bias_deg"],
];

/// Returns the statistics of an axis (0 is x, 1 is y, 2 the rotation) as cells: mean, standard deviation, maximum and
/// bias.
pub(super) fn statistics_cells(axis: usize, error: Option<ErrorStatistics>) -> [Cell; 4] {
    let values = [
        error.map(|error| error.mean),
        error.and_then(|error| error.spread),
        error.map(|error| error.max),
        error.map(|error| error.bias),
    ];
    std::array::from_fn(|k| (STATISTICS[axis][k], json!(values[k].map(rounded))))
}

/// Formats a number with 4 decimals, or a dash.
pub(super) fn format_error(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.4}"))
}

/// Explanation above a table of [`summary_cell`]s.
pub(super) const EXPLANATION: &str =
    "mean absolute error: px/frame (mean of x and y) / deg/frame; ! where answers are missing";

/// Returns the mean of the mean absolute errors along x and y, px/frame; `None` if either is missing.
pub(super) fn translation_error(errors: &[Option<ErrorStatistics>; 3]) -> Option<f64> {
    let [x, y, _] = errors.map(|error| error.map(|error| error.mean));
    x.zip(y).map(|(x, y)| 0.5 * (x + y))
}

/// Formats the errors of translation and rotation, marked if answers are missing.
pub(super) fn summary_cell(errors: &[Option<ErrorStatistics>; 3], missing: usize) -> String {
    let (px, deg) = (format_error(translation_error(errors)), format_error(errors[2].map(|error| error.mean)));
    format!("{px} / {deg}{}", if missing > 0 { "!" } else { "" })
}

impl Group {
    /// Returns the row of the summary table.
    pub(super) fn cells(&self) -> Vec<Cell> {
        let mut cells = vec![
            ("pattern", json!(PatternSetup::PAPER[self.pattern])),
            ("speeds", json!(self.speeds.as_str())),
            ("case", json!(self.case.as_str())),
            ("method", json!(self.method.as_str())),
            ("films", json!(self.films)),
            ("pairs", json!(self.pairs)),
            ("missing", json!(self.missing)),
        ];
        cells.extend((0..3).flat_map(|axis| statistics_cells(axis, self.errors[axis])));
        cells
    }
}

/// Groups the rows of a study by pattern, speeds, case and method, in the order of the films.
///
/// `rows` are those of all films in order, the same number for each, with the `methods` alternating.
pub(super) fn groups(films: &[Film], methods: &[Method], rows: &[Row]) -> Vec<Group> {
    let each = rows.len() / films.len().max(1);
    let mut groups: Vec<(Group, [Vec<f64>; 3])> = Vec::new();
    let mut begin = 0;
    for (index, (film, rows)) in films.iter().zip(rows.chunks(each.max(1))).enumerate() {
        let before = index.checked_sub(1).map(|before| films[before]);
        if before.is_none_or(|before| (before.pattern, before.speeds) != (film.pattern, film.speeds)) {
            begin = groups.len();
        }
        let place = groups[begin..].iter().position(|(group, _)| group.case == film.case).map(|place| begin + place);
        let place = place.unwrap_or_else(|| {
            groups.extend(methods.iter().map(|method| (empty_group(film, *method), Default::default())));
            groups.len() - methods.len()
        });
        for (number, (group, errors)) in groups[place..place + methods.len()].iter_mut().enumerate() {
            group.films += 1;
            rows.iter().skip(number).step_by(methods.len()).for_each(|row| add_row(group, errors, row));
        }
    }
    let finish = |(group, errors): (Group, [Vec<f64>; 3])| Group {
        errors: errors.map(|e| ErrorStatistics::compute(&e)),
        ..group
    };
    groups.into_iter().map(finish).collect()
}

/// Returns the group of a film and a method without any row.
fn empty_group(film: &Film, method: Method) -> Group {
    let Film { pattern, speeds, case, .. } = *film;
    Group { pattern, speeds, case, method, films: 0, pairs: 0, missing: 0, errors: [None; 3] }
}

/// Adds a row to a group, and its errors to those along x, y and of the rotation.
///
/// In the one-axis cases the axis without motion is skipped.
fn add_row(group: &mut Group, errors: &mut [Vec<f64>; 3], row: &Row) {
    group.pairs += 1;
    let is_across = |speed: f64| matches!(group.case, Case::OneAxis | Case::OneAxisSpin) && speed <= 0.0;
    let skipped = [is_across(row.vx_px_frame), is_across(row.vy_px_frame), false];
    let [x, y, turn] = row.error();
    if x.is_none() {
        group.missing += 1;
    }
    for ((errors, error), skipped) in errors.iter_mut().zip([x, y, turn]).zip(skipped) {
        errors.extend(error.filter(|_| !skipped));
    }
}

#[cfg(test)]
mod tests {
    use super::super::films_plan::SpeckleStudy;
    use super::super::methods::Answer;
    use super::*;
    use crate::results::PointStatus;

    /// Rows of a study with errors of `error(film, method, pair)`.
    fn rows(films: &[Film], methods: &[Method], error: impl Fn(&Film, Method, u64) -> Option<[f64; 3]>) -> Vec<Row> {
        let mut rows = Vec::new();
        for film in films {
            for frame in 0..2 {
                for method in methods {
                    let step = error(film, *method, frame).map(|[x, y, turn]| {
                        let [vx, vy] = film.velocity.px_frame;
                        [vx + x, vy + y, film.velocity.deg_frame + turn]
                    });
                    let answer = Answer { step, sigma: None, points: 9, status: PointStatus::Valid };
                    rows.push(Row::new(SpeckleStudy::General, film, frame, *method, &answer));
                }
            }
        }
        rows
    }

    #[test]
    fn statistics_are_grouped_by_pattern_method_and_case() {
        let films = SpeckleStudy::Translation.plan(&[2, 5], &[Speeds::Paper]);
        let methods = [Method::Paper, Method::Rigid];
        let rows = rows(&films, &methods, |film, method, frame| {
            let sign = if frame == 0 { 1.0 } else { -3.0 };
            let size = if method == Method::Rigid { 0.001 } else { 0.02 } * (film.pattern as f64);
            Some([sign * size, 2.0 * sign * size, 0.5 * sign * size])
        });
        let groups = groups(&films, &methods, &rows);
        assert_eq!(groups.len(), 2 * 2 * 2, "two patterns, at rest and along an axis, two methods");
        let of = |pattern: usize, case: Case, method: Method| {
            let mut found = groups.iter().filter(|g| (g.pattern, g.case, g.method) == (pattern, case, method));
            let group = found.next().unwrap();
            assert!(found.next().is_none());
            group
        };
        let group = of(5, Case::OneAxis, Method::Rigid);
        assert_eq!((group.films, group.pairs, group.missing), (10, 20, 0));
        let [x, y, turn] = group.errors.map(Option::unwrap);
        // Five films move along x, two pairs each: errors of 0.005 and -0.015 px.
        assert_eq!((x.count, turn.count), (10, 20));
        assert!(
            (x.mean - 0.010).abs() < 1e-6 && (x.max - 0.015).abs() < 1e-6 && (x.bias + 0.005).abs() < 1e-6,
            "{x:?}"
        );
        assert!((x.spread.unwrap() - 0.005 * (10.0_f64 / 9.0).sqrt()).abs() < 1e-6, "{x:?}");
        assert!((y.mean - 0.020).abs() < 1e-6 && (turn.mean - 0.005).abs() < 1e-6, "{y:?} {turn:?}");
        let coarse = of(2, Case::OneAxis, Method::Paper).errors[0].unwrap();
        assert!((coarse.mean - 0.08).abs() < 1e-6, "{coarse:?}");
        assert_eq!(of(2, Case::Rest, Method::Paper).errors[0].unwrap().count, 2);
    }

    #[test]
    fn an_answer_that_is_missing_is_counted_and_is_not_a_zero() {
        let films = SpeckleStudy::Rotation.plan(&[9], &[Speeds::OffGrid]);
        let rows = rows(&films, &[Method::IcGn], |film, _, frame| (film.number != 2 || frame > 0).then_some([0.3; 3]));
        let groups = groups(&films, &[Method::IcGn], &rows);
        assert_eq!((groups[0].pairs, groups[0].missing), (6, 1));
        let error = groups[0].errors[0].unwrap();
        assert!(error.count == 5 && (error.mean - 0.3).abs() < 1e-6, "{error:?}");
        let none = super::groups(&films, &[Method::IcGn], &super::tests::rows(&films, &[Method::IcGn], |_, _, _| None));
        assert_eq!(none[0].errors, [None; 3]);
        assert_eq!(none[0].missing, 6);
    }
}
