//! Studies over one setting of the camera: errors of every method at every level.

use std::fmt::Write as _;

use serde::Serialize;

use super::films_plan::SpeckleStudy;
use super::log_axis;
use super::log_axis::{HEADING, LINE, LogAxis};
use super::methods::Way;
use super::row::Row;
use super::summary::Spread;
use super::workers::Job;
use crate::study::convergence::text;

/// Width and height of a plot, and its margins, px.
const WIDTH: f64 = 420.0;
const PLOT: f64 = 220.0;
const LEFT: f64 = 66.0;
const ABOVE: f64 = 28.0;
const BELOW: f64 = 46.0;

/// Explanation above the printed table.
pub(super) const READING: &str =
    "mean absolute error: px/frame (mean of x and y) / deg/frame; ! where answers are missing";

/// The result of one method at one level, over all patterns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Point {
    pub(super) way: Way,
    pub(super) level: f64,
    pub(super) pairs: usize,
    pub(super) missing: usize,
    /// Errors along x and y, px/frame, and of the rotation, deg/frame.
    pub(super) errors: [Option<Spread>; 3],
    /// Relative errors of the velocity and of the spin.
    pub(super) shares: [Option<Spread>; 2],
}

/// A row of the table over the levels.
#[derive(Debug, Serialize)]
pub(super) struct Line {
    #[serde(skip_serializing_if = "Option::is_none")]
    noise_dn: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    blur_px: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    rate: Option<f64>,
    method: &'static str,
    pairs: usize,
    missing: usize,
    mean_x_px: Option<f64>,
    spread_x_px: Option<f64>,
    mean_y_px: Option<f64>,
    spread_y_px: Option<f64>,
    mean_deg: Option<f64>,
    spread_deg: Option<f64>,
    velocity_error_share: Option<f64>,
    spin_error_share: Option<f64>,
}

impl Point {
    /// Computes the statistics of a method at a level.
    fn of(way: Way, level: f64, rows: &[&Row]) -> Self {
        let errors: Vec<[f64; 3]> = rows.iter().filter_map(|row| known(row)).collect();
        let along = |axis: usize| Spread::of(&errors.iter().map(|error| error[axis]).collect::<Vec<_>>());
        let share = |of: fn(&Row, [f64; 3]) -> f64| {
            Spread::of(&rows.iter().filter_map(|row| Some(of(row, known(row)?))).collect::<Vec<_>>())
        };
        Self {
            way,
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

    pub(super) fn line(&self, study: SpeckleStudy) -> Line {
        let round = |value: f64| (value * 1e7).round() / 1e7 + 0.0;
        let mean = |error: Option<Spread>| error.map(|error| round(error.mean));
        let spread = |error: Option<Spread>| error.and_then(|error| error.spread).map(round);
        let level = |of: SpeckleStudy| (study == of).then_some(self.level);
        let [x, y, turn] = self.errors;
        Line {
            noise_dn: level(SpeckleStudy::Noise),
            blur_px: level(SpeckleStudy::Blur),
            rate: level(SpeckleStudy::Rate),
            method: self.way.as_str(),
            pairs: self.pairs,
            missing: self.missing,
            mean_x_px: mean(x),
            spread_x_px: spread(x),
            mean_y_px: mean(y),
            spread_y_px: spread(y),
            mean_deg: mean(turn),
            spread_deg: spread(turn),
            velocity_error_share: mean(self.shares[0]),
            spin_error_share: mean(self.shares[1]),
        }
    }

    /// Returns the values in the figure: px/frame and deg/frame, or relative errors in % for the frame rate.
    fn shown(&self, study: SpeckleStudy) -> [Option<f64>; 2] {
        let [x, y, turn] = self.errors.map(|error| error.map(|error| error.mean));
        match study {
            SpeckleStudy::Rate => self.shares.map(|share| share.map(|share| 100.0 * share.mean)),
            _ => [x.zip(y).map(|(x, y)| 0.5 * (x + y)), turn],
        }
    }
}

fn known(row: &Row) -> Option<[f64; 3]> {
    let [x, y, turn] = row.error();
    Some([x?, y?, turn?])
}

/// Returns every method at every level, sorted by method and level.
pub(super) fn points(job: &Job, rows: &[Row]) -> Vec<Point> {
    let point = |way: Way, level: f64| {
        let is_of = |row: &&Row| row.method == way.as_str() && row.level().is_some_and(|at| (at - level).abs() < 1e-9);
        Point::of(way, level, &rows.iter().filter(is_of).collect::<Vec<_>>())
    };
    job.ways.iter().flat_map(|way| job.study.levels().iter().map(move |level| point(*way, *level))).collect()
}

/// Returns the printed table.
pub(super) fn cells(job: &Job, points: &[Point]) -> Vec<Vec<String>> {
    let head = std::iter::once(label(job.study).to_owned()).chain(job.ways.iter().map(|way| way.as_str().to_owned()));
    let mut lines = vec![head.collect::<Vec<_>>()];
    for level in job.study.levels() {
        let mut line = vec![level.to_string()];
        for point in points.iter().filter(|point| (point.level - level).abs() < 1e-9) {
            let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.4}"));
            let [x, y, turn] = point.errors.map(|error| error.map(|error| error.mean));
            let px = number(x.zip(y).map(|(x, y)| 0.5 * (x + y)));
            line.push(format!("{px} / {}{}", number(turn), if point.missing > 0 { "!" } else { "" }));
        }
        lines.push(line);
    }
    lines
}

/// Returns the label of the varied setting.
fn label(study: SpeckleStudy) -> &'static str {
    match study {
        SpeckleStudy::Noise => "noise, grey levels of 255",
        SpeckleStudy::Blur => "lens blur, px",
        _ => "frame rate, times the slowest",
    }
}

/// Draws the figure: a curve per method, translation on the left, rotation on the right.
pub(super) fn draw(job: &Job, points: &[Point], caption: &[String]) -> String {
    let top = HEADING + LINE * caption.len() as f64 + 34.0;
    let across = LEFT + WIDTH + 20.0;
    let mut svg = log_axis::begin((2.0 * across, top + ABOVE + PLOT + BELOW), job.study.heading(), caption);
    let entries: Vec<(Way, String)> = job.ways.iter().map(|way| (*way, way.title().to_owned())).collect();
    log_axis::legend(&mut svg, top - 26.0, &entries);
    let titles = match job.study {
        SpeckleStudy::Rate => ["mean error of the velocity, % of the speed", "mean |error| of the spin, % of it"],
        _ => ["mean |error| along x and y, px/frame", "mean |error| of the rotation, deg/frame"],
    };
    let apart = WIDTH / job.study.levels().len() as f64;
    for (panel, title) in titles.into_iter().enumerate() {
        let (left, top) = (across * panel as f64 + LEFT, top + ABOVE);
        let axis = LogAxis::around(points.iter().filter_map(|point| point.shown(job.study)[panel]), PLOT);
        text(&mut svg, (left - LEFT + 14.0, top - 12.0), "class=\"title\"", title);
        axis.draw(&mut svg, (left, top), WIDTH);
        let x = |place: usize| left + apart * (place as f64 + 0.5);
        for (place, level) in job.study.levels().iter().enumerate() {
            text(&mut svg, (x(place), top + PLOT + 15.0), "text-anchor=\"middle\"", &level.to_string());
        }
        text(&mut svg, (left + 0.5 * WIDTH, top + PLOT + 33.0), "text-anchor=\"middle\"", label(job.study));
        for way in &job.ways {
            let (mut path, mut joined, mut marks) = (String::new(), false, String::new());
            for (place, point) in points.iter().filter(|point| point.way == *way).enumerate() {
                let Some(value) = point.shown(job.study)[panel] else {
                    joined = false;
                    continue;
                };
                let (x, y) = (x(place), top + axis.y(value));
                let _ = write!(path, "{}{x:.1} {y:.1}", if joined { 'L' } else { 'M' });
                log_axis::mark(&mut marks, *way, (x, y), point.missing);
                joined = true;
            }
            let _ = writeln!(svg, "<path class=\"curve\" stroke=\"{}\" d=\"{path}\"/>", log_axis::colour(*way));
            svg.push_str(&marks);
        }
    }
    svg.push_str("</svg>\n");
    svg
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
            ways: vec![Way::IcGn, Way::Rigid],
            windows: Windows { subset_size_px: 25, step_px: 40 },
            filming: Filming { frames: 2, noise_dn: 2.0, blur_px: 0.7, seed: 1 },
        }
    }

    /// Errors of 0.003 px along x, 0.004 px along y and 0.01 deg; the rigid method has no answer at the last level.
    fn rows(job: &Job) -> Vec<Row> {
        let row = |film: &super::super::films_plan::Film, way: Way| {
            let [x, y] = film.velocity.px_frame;
            let step = [x + 0.003, y - 0.004, film.velocity.deg_frame + 0.01];
            let step = Some(step).filter(|_| way == Way::IcGn || film.level + 1 < job.study.levels().len());
            let answer = Answer { step, sigma: None, points: 9, status: PointStatus::Valid };
            Row::new((job.study, film), 0, way, &answer)
        };
        job.films.iter().flat_map(|film| job.ways.iter().map(move |way| row(film, *way))).collect()
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
        let line = points[0].line(job.study);
        assert_eq!((line.rate, line.noise_dn, line.mean_x_px), (Some(1.0), None, Some(0.003)));
    }

    #[test]
    fn a_level_without_answers_is_a_gap_in_the_figure_and_a_mark_in_the_table() {
        let job = job(SpeckleStudy::Noise);
        let points = points(&job, &rows(&job));
        assert_eq!((points[11].pairs, points[11].missing, points[11].errors), (8, 8, [None; 3]));
        let svg = draw(&job, &points, &["caption".to_owned()]);
        assert_eq!(svg.matches("<circle").count(), 2 * (6 + 5));
        assert!(!svg.contains("NaN") && svg.contains(">16</text>"));
        let cells = cells(&job, &points);
        assert_eq!(cells[6], ["16", "0.0035 / 0.0100", "- / -!"]);
    }
}
