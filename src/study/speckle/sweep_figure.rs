//! Studies over one setting of the camera: errors of every method at every level.

use maud::html;
use serde_json::json;

use super::films_plan::SpeckleStudy;
use super::method_style::{self, LEGEND};
use super::methods::Method;
use super::row::Row;
use super::summary::{ErrorStatistics, statistics_cells, summary_cell, translation_error};
use super::workers::Job;
use crate::plot::{Figure, LogAxis, LogChart, LogCurve, LogValue, PlotArea};
use crate::study::output_files::{Cell, cross_table, rounded};

/// Width and height of a plot, and its left margin, px.
const WIDTH: f64 = 420.0;
const PLOT: f64 = 220.0;
const LEFT: f64 = 66.0;

/// The result of one method at one level, over all patterns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Point {
    pub(super) method: Method,
    pub(super) level: f64,
    pub(super) pairs: usize,
    pub(super) missing: usize,
    /// Errors along x and y, px/frame, and of the rotation, deg/frame.
    pub(super) errors: [Option<ErrorStatistics>; 3],
    /// Relative errors of the velocity and of the spin.
    pub(super) shares: [Option<ErrorStatistics>; 2],
}

impl Point {
    /// Computes the statistics of a method at a level. Rows with a missing error are only counted.
    fn compute(method: Method, level: f64, rows: &[&Row]) -> Self {
        let errors: Vec<[f64; 3]> = rows.iter().filter_map(|row| complete_error(row)).collect();
        let along = |axis: usize| ErrorStatistics::compute(&errors.iter().map(|error| error[axis]).collect::<Vec<_>>());
        let share = |of: fn(&Row, [f64; 3]) -> f64| {
            ErrorStatistics::compute(
                &rows.iter().filter_map(|row| Some(of(row, complete_error(row)?))).collect::<Vec<_>>(),
            )
        };
        Self {
            method,
            level,
            pairs: rows.len(),
            missing: rows.len() - errors.len(),
            errors: [along(0), along(1), along(2)],
            shares: [
                share(|row, [x, y, _]| x.hypot(y) / row.vx_px_frame.hypot(row.vy_px_frame)),
                share(|row, [_, _, turn]| turn / row.omega_deg_frame),
            ],
        }
    }

    /// Returns the row of the table over the levels.
    pub(super) fn cells(&self, study: SpeckleStudy) -> Vec<Cell> {
        let mut cells = vec![
            (study.level_column(), json!(self.level)),
            ("method", json!(self.method.as_str())),
            ("pairs", json!(self.pairs)),
            ("missing", json!(self.missing)),
        ];
        cells.extend((0..3).flat_map(|axis| statistics_cells(axis, self.errors[axis]).into_iter().take(2)));
        let mean = |error: Option<ErrorStatistics>| json!(error.map(|error| rounded(error.mean)));
        cells.extend([("velocity_error_share", mean(self.shares[0])), ("spin_error_share", mean(self.shares[1]))]);
        cells
    }

    /// Returns the mean errors of translation and rotation in the figure: px/frame and deg/frame, or relative errors in
    /// % for the frame rate.
    fn shown(&self, study: SpeckleStudy) -> [Option<f64>; 2] {
        match study {
            SpeckleStudy::Rate => self.shares.map(|share| share.map(|share| 100.0 * share.mean)),
            _ => [translation_error(&self.errors), self.errors[2].map(|error| error.mean)],
        }
    }
}

/// Returns the errors of a row along x, y (px) and of the rotation (deg); `None` if one is missing.
fn complete_error(row: &Row) -> Option<[f64; 3]> {
    let [x, y, turn] = row.error();
    Some([x?, y?, turn?])
}

/// Returns the errors of every method at every level over all patterns, sorted by method and level.
pub(super) fn points(job: &Job, rows: &[Row]) -> Vec<Point> {
    let point = |method: Method, level: f64| {
        let is_of =
            |row: &&Row| row.method == method.as_str() && row.level().is_some_and(|at| (at - level).abs() < 1e-9);
        Point::compute(method, level, &rows.iter().filter(is_of).collect::<Vec<_>>())
    };
    job.methods.iter().flat_map(|method| job.study.levels().iter().map(move |level| point(*method, *level))).collect()
}

/// Formats the errors of every method at every level for the terminal.
pub(super) fn printed_table(job: &Job, points: &[Point]) -> String {
    let levels: Vec<(String, f64)> = job.study.levels().iter().map(|level| (level.to_string(), *level)).collect();
    let methods: Vec<(String, Method)> =
        job.methods.iter().map(|method| (method.as_str().to_owned(), *method)).collect();
    cross_table(level_label(job.study), &levels, &methods, |level, method| {
        let is_at = |point: &&Point| point.method == *method && (point.level - level).abs() < 1e-9;
        points.iter().find(is_at).map_or_else(String::new, |point| summary_cell(&point.errors, point.missing))
    })
}

/// Returns the label of the varied setting.
fn level_label(study: SpeckleStudy) -> &'static str {
    match study {
        SpeckleStudy::Noise => "noise, grey levels of 255",
        SpeckleStudy::Blur => "lens blur, px",
        _ => "frame rate, times the slowest",
    }
}

/// Returns the text of the SVG file: a curve per method, translation on the left, rotation on the right.
pub(super) fn draw(job: &Job, points: &[Point], caption: &[String]) -> String {
    let figure = Figure { heading: job.study.heading(), caption };
    let top = figure.content_top() + LEGEND + LogChart::TITLE;
    let across = LEFT + WIDTH + 20.0;
    let titles = match job.study {
        SpeckleStudy::Rate => ["mean error of the velocity, % of the speed", "mean |error| of the spin, % of it"],
        _ => ["mean |error| along x and y, px/frame", "mean |error| of the rotation, deg/frame"],
    };
    let content = html! {
        (method_style::legend(figure.content_top() + 8.0, &job.methods))
        @for (panel, title) in titles.into_iter().enumerate() {
            @let plot = PlotArea { left: across * panel as f64 + LEFT, top, width: WIDTH };
            (error_chart(job, points, panel, title).draw(plot))
        }
    };
    figure.draw(2.0 * across, top + PLOT + LogChart::LABELS, &content)
}

/// Returns the chart of the mean error of translation (panel 0) or rotation (panel 1) over the levels.
fn error_chart<'a>(job: &Job, points: &[Point], panel: usize, title: &'a str) -> LogChart<'a> {
    let levels = job.study.levels();
    let x = |place: usize| (place as f64 + 0.5) / levels.len() as f64;
    let curve = |method: &Method| {
        let value = |(place, point): (usize, &Point)| {
            let y = point.shown(job.study)[panel]?;
            Some(LogValue { x: x(place), y, is_incomplete: point.missing > 0 })
        };
        let values = points.iter().filter(|point| point.method == *method).enumerate().map(value).collect();
        LogCurve { style: method_style::style(*method), values, ring: None }
    };
    LogChart {
        title,
        x_label: level_label(job.study),
        x_ticks: levels.iter().enumerate().map(|(place, level)| (x(place), level.to_string())).collect(),
        axis: LogAxis::around(points.iter().filter_map(|point| point.shown(job.study)[panel]), PLOT, 0.0),
        curves: job.methods.iter().map(curve).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::film::Filming;
    use super::super::films_plan::Speeds;
    use super::super::methods::{Answer, Windows};
    use super::*;
    use crate::results::PointStatus;

    fn job(study: SpeckleStudy) -> Job {
        Job {
            study,
            films: study.plan(&[13], &[Speeds::OffGrid]),
            methods: vec![Method::IcGn, Method::Rigid],
            windows: Windows { subset_size_px: 25, step_px: 40 },
            filming: Filming { frames: 2, noise_dn: 2.0, blur_px: 0.7, seed: 1 },
        }
    }

    /// Errors of 0.003 px along x, 0.004 px along y and 0.01 deg; the rigid method has no answer at the last level.
    fn rows(job: &Job) -> Vec<Row> {
        let row = |film: &super::super::films_plan::Film, method: Method| {
            let [x, y] = film.velocity.px_frame;
            let step = [x + 0.003, y - 0.004, film.velocity.deg_frame + 0.01];
            let step = Some(step).filter(|_| method == Method::IcGn || film.level + 1 < job.study.levels().len());
            let answer = Answer { step, sigma: None, points: 9, status: PointStatus::Valid };
            Row::new(job.study, film, 0, method, &answer)
        };
        job.films.iter().flat_map(|film| job.methods.iter().map(move |method| row(film, *method))).collect()
    }

    #[test]
    fn the_same_error_from_frame_to_frame_is_twice_the_error_of_the_velocity_at_twice_the_rate() {
        let job = job(SpeckleStudy::Rate);
        let points = points(&job, &rows(&job));
        assert_eq!(points.len(), 2 * 6);
        for pair in points[..6].windows(2) {
            let [slow, fast] = [pair[0], pair[1]].map(|point| point.shares.map(|share| share.unwrap().mean));
            for (slow, fast) in slow.into_iter().zip(fast) {
                assert!((fast / slow - 2.0).abs() < 0.01, "{slow} {fast}");
            }
        }
        let cells = points[0].cells(job.study);
        assert_eq!((&cells[0], &cells[4]), (&("rate", json!(1.0)), &("mean_x_px", json!(0.003))));
    }

    #[test]
    fn a_level_without_answers_is_a_gap_in_the_figure_and_a_mark_in_the_table() {
        let job = job(SpeckleStudy::Noise);
        let points = points(&job, &rows(&job));
        assert_eq!((points[11].pairs, points[11].missing, points[11].errors), (8, 8, [None; 3]));
        let svg = draw(&job, &points, &["caption".to_owned()]);
        assert_eq!(svg.matches("<circle").count(), 2 * (6 + 5) + 2, "marks of the curves and of the legend");
        assert!(!svg.contains("NaN") && svg.contains(">16</text>"));
        let last =
            printed_table(&job, &points).lines().last().unwrap().split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!(last, "16 0.0035 / 0.0100 - / -!");
    }
}
