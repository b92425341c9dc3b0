//! Fig. 7: splined windows against splined peaks over the speed, and their cost.

use crate::failure::Failure;
use std::time::Instant;

use maud::html;
use serde_json::json;

use super::film::{self, FramePair, SIDE_PX};
use super::films_plan::Speeds;
use super::method_style::{self, LEGEND};
use super::methods::{Evaluator, Method};
use super::row::Row;
use super::summary::{ErrorStatistics, statistics_cells};
use super::workers::Job;
use crate::image::Image;
use crate::plot::{CurveStyle, Figure, LogAxis, LogChart, LogCurve, LogValue, PlotArea, draw_legend};
use crate::study::output_files::Cell;

/// Width and height of a plot, and its left margin, px.
const WIDTH: f64 = 440.0;
const PLOT: f64 = 240.0;
const LEFT: f64 = 66.0;

/// Number of timings per method, of which the minimum is reported, since other load only adds time.
const TIMINGS: usize = 9;

/// Maximum speed on the axis, px/frame.
const MAX_PX: f64 = 2.1;

/// The result of one method at one speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Point {
    pub(super) speeds: Speeds,
    pub(super) method: Method,
    pub(super) speed_px_frame: f64,
    pub(super) pairs: usize,
    pub(super) missing: usize,
    /// Errors along x, px.
    pub(super) error: Option<ErrorStatistics>,
}

/// The cost of a method.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cost {
    pub(super) method: &'static str,
    /// Time per subset on one thread, us.
    pub(super) us_per_window: f64,
}

impl Point {
    /// Returns the row of the table over the speed.
    pub(super) fn cells(&self) -> Vec<Cell> {
        let mut cells = vec![
            ("speeds", json!(self.speeds.as_str())),
            ("method", json!(self.method.as_str())),
            ("vx_px_frame", json!(self.speed_px_frame)),
            ("pairs", json!(self.pairs)),
            ("missing", json!(self.missing)),
        ];
        cells.extend(statistics_cells(0, self.error));
        cells
    }
}

impl Cost {
    /// Returns the row of the table of costs.
    pub(super) fn cells(&self) -> Vec<Cell> {
        vec![("method", json!(self.method)), ("us_per_window", json!(self.us_per_window))]
    }
}

/// Returns the errors of every method at every speed over all patterns, sorted by set of speeds, method and speed.
pub(super) fn points(job: &Job, rows: &[Row]) -> Vec<Point> {
    let mut points = Vec::new();
    for speeds in Speeds::ALL {
        let films = || job.films.iter().filter(move |film| film.speeds == speeds);
        let mut steps: Vec<f64> = films().map(|film| film.velocity.px_frame[0]).collect();
        steps.sort_by(f64::total_cmp);
        steps.dedup();
        for method in &job.methods {
            for speed in &steps {
                let of = |row: &&Row| {
                    let apart = row.vx_px_frame - speed;
                    row.speeds == speeds.as_str() && row.method == method.as_str() && apart.abs() < 1e-9
                };
                let errors: Vec<Option<f64>> = rows.iter().filter(of).map(|row| row.error()[0]).collect();
                let known: Vec<f64> = errors.iter().copied().flatten().collect();
                points.push(Point {
                    speeds,
                    method: *method,
                    speed_px_frame: *speed,
                    pairs: errors.len(),
                    missing: errors.len() - known.len(),
                    error: ErrorStatistics::compute(&known),
                });
            }
        }
    }
    points
}

/// Measures the cost of every method on the first two frames of the first film, alternating the methods.
///
/// The cost is the minimum of [`TIMINGS`] timings of the correlation per window. Preparation is not counted.
///
/// # Errors
///
/// When the film cannot be rendered.
#[expect(clippy::disallowed_methods, reason = "a study of cost reads the clock")]
pub(super) fn measure_costs(job: &Job) -> Result<Vec<Cost>, Failure> {
    let Some(plan) = job.films.first() else { return Ok(Vec::new()) };
    let rendered = film::moving_ball(&film::static_ball(plan.pattern, &job.filming)?, plan, &job.filming)?;
    let (mut bytes, mut before, mut after) = (Vec::new(), Image::default(), Image::default());
    rendered.draw(0, &mut bytes, &mut before)?;
    rendered.draw(1, &mut bytes, &mut after)?;
    let mut evaluator = Evaluator::new(&job.methods, job.windows, SIDE_PX)?;
    let pair = FramePair { before: before.view(), after: after.view() };
    evaluator.measure(pair);
    let mut times = vec![Vec::new(); job.methods.len()];
    for _ in 0..TIMINGS {
        for (method, times) in times.iter_mut().enumerate() {
            let began = Instant::now();
            let windows = evaluator.correlate_again(method, pair);
            times.push(1e6 * began.elapsed().as_secs_f64() / windows.max(1) as f64);
        }
    }
    let cost = |(method, mut times): (&Method, Vec<f64>)| {
        times.sort_by(f64::total_cmp);
        Cost { method: method.as_str(), us_per_window: (100.0 * times[0]).round() / 100.0 }
    };
    Ok(job.methods.iter().zip(times).map(cost).collect())
}

/// Returns the text of the SVG file: a chart per set of speeds, with the costs of the methods in the legend.
pub(super) fn draw(job: &Job, points: &[Point], costs: &[Cost], caption: &[String]) -> String {
    let figure = Figure { heading: job.study.heading(), caption };
    let shown: Vec<Speeds> =
        Speeds::ALL.into_iter().filter(|speeds| points.iter().any(|point| point.speeds == *speeds)).collect();
    let entry = |(method, cost): (&Method, &Cost)| {
        (method_style::style(*method), format!("{} ({:.0} us a window)", method.title(), cost.us_per_window))
    };
    let entries: Vec<(CurveStyle, String)> = job.methods.iter().zip(costs).map(entry).collect();
    let legend_lines = entries.chunks(3).len() as f64;
    let top = figure.content_top() + LEGEND * legend_lines + LogChart::TITLE;
    let across = LEFT + WIDTH + 20.0;
    let content = html! {
        @for (line, entries) in entries.chunks(3).enumerate() {
            (draw_legend(figure.content_top() + 8.0 + LEGEND * line as f64, entries))
        }
        @for (column, speeds) in shown.iter().enumerate() {
            @let title = format!("mean |error| along x, px/frame; {} speeds", speeds.as_str());
            @let plot = PlotArea { left: across * column as f64 + LEFT, top, width: WIDTH };
            (error_chart(job, points, *speeds, &title).draw(plot))
        }
    };
    figure.draw((across * shown.len() as f64).max(760.0), top + PLOT + LogChart::LABELS, &content)
}

/// Returns the chart of the mean error along x over the speed, for one set of speeds.
fn error_chart<'a>(job: &Job, points: &[Point], speeds: Speeds, title: &'a str) -> LogChart<'a> {
    let tick = |tenth: i32| (0.1 * f64::from(tenth) / MAX_PX, format!("{:.1}", 0.1 * f64::from(tenth)));
    let curve = |method: &Method| {
        let value = |point: &Point| {
            let y = point.error?.mean;
            Some(LogValue { x: point.speed_px_frame / MAX_PX, y, is_incomplete: point.missing > 0 })
        };
        let is_shown = |point: &&Point| (point.speeds, point.method) == (speeds, *method);
        let values = points.iter().filter(is_shown).map(value).collect();
        LogCurve { style: method_style::style(*method), values, ring: None }
    };
    LogChart {
        title,
        x_label: "speed along x, px/frame",
        x_ticks: (0..=20).step_by(2).map(tick).collect(),
        axis: LogAxis::around(points.iter().filter_map(|point| point.error).map(|error| error.mean), PLOT, 0.0),
        curves: job.methods.iter().map(curve).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::film::Filming;
    use super::super::films_plan::{Film, SpeckleStudy};
    use super::super::methods::{Answer, Windows};
    use super::*;
    use crate::results::PointStatus;

    fn job() -> Job {
        Job {
            study: SpeckleStudy::Peak,
            films: SpeckleStudy::Peak.plan(&[13], &Speeds::ALL),
            methods: vec![Method::Paper, Method::PeakSpline],
            windows: Windows { subset_size_px: 25, step_px: 40 },
            filming: Filming { frames: 2, noise_dn: 2.0, blur_px: 0.7, seed: 1 },
        }
    }

    /// A row per film and method with an error of 1 % of the speed, or missing.
    fn rows(job: &Job, is_missing: impl Fn(&Film, Method) -> bool) -> Vec<Row> {
        let row = |film: &Film, method: Method| {
            let speed = film.velocity.px_frame[0];
            let step = (!is_missing(film, method)).then_some([1.01 * speed, 0.0, 0.0]);
            Row::new(
                SpeckleStudy::Peak,
                film,
                0,
                method,
                &Answer { step, sigma: None, points: 9, status: PointStatus::Valid },
            )
        };
        job.films.iter().flat_map(|film| job.methods.iter().map(move |method| row(film, *method))).collect()
    }

    #[test]
    fn every_speed_has_the_mean_of_its_films_and_a_gap_breaks_the_curve() {
        let job = job();
        let rows = rows(&job, |film, method| method == Method::Paper && (film.velocity.px_frame[0] - 0.5).abs() < 1e-9);
        let points = points(&job, &rows);
        assert_eq!(points.len(), 2 * 2 * 20);
        for point in &points {
            assert_eq!(point.pairs, 8);
            match point.error {
                Some(error) => assert!((error.mean - 0.01 * point.speed_px_frame).abs() < 1e-6, "{point:?}"),
                None => assert_eq!((point.method, point.missing), (Method::Paper, 8)),
            }
        }
        assert_eq!(points.iter().filter(|point| point.error.is_none()).count(), 1);
        let costs =
            job.methods.iter().map(|method| Cost { method: method.as_str(), us_per_window: 7.0 }).collect::<Vec<_>>();
        let figure = draw(&job, &points, &costs, &["caption <of> it".to_owned()]);
        assert!(figure.contains("caption &lt;of&gt; it") && figure.contains("(7 us a window)"));
        let curves = figure.split('<').filter(|tag| tag.starts_with("path class=\"curve\"") && tag.contains('L'));
        let starts: Vec<usize> = curves.map(|curve| curve.matches('M').count()).collect();
        assert_eq!(starts, [2, 1, 1, 1], "only the first has a gap");
    }
}
