//! Fig. 7: splined windows against splined peaks over the speed, and their cost.

use std::fmt::Write as _;
use std::time::Instant;

use serde::Serialize;

use super::film::{self, SIDE_PX};
use super::films_plan::Speeds;
use super::log_axis;
use super::log_axis::{HEADING, LINE, LogAxis};
use super::methods::{Bench, Way};
use super::row::Row;
use super::summary::Spread;
use super::workers::Job;
use crate::failure::Failure;
use crate::image::Image;
use crate::study::convergence::text;

/// Width and height of a plot, and its margins, px.
const WIDTH: f64 = 440.0;
const PLOT: f64 = 240.0;
const LEFT: f64 = 66.0;
const ABOVE: f64 = 28.0;
const BELOW: f64 = 46.0;

/// Number of timings per method; the minimum is reported, since other load only adds time.
const TURNS: usize = 9;

/// Maximum speed on the axis, px/frame.
const MAX_PX: f64 = 2.1;

/// The result of one method at one speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Point {
    pub(super) speeds: Speeds,
    pub(super) way: Way,
    pub(super) speed_px_frame: f64,
    pub(super) pairs: usize,
    pub(super) missing: usize,
    /// Errors along x, px.
    pub(super) error: Option<Spread>,
}

/// A row of the table over the speed.
#[derive(Debug, Serialize)]
pub(super) struct Line {
    speeds: &'static str,
    method: &'static str,
    vx_px_frame: f64,
    pairs: usize,
    missing: usize,
    mean_x_px: Option<f64>,
    spread_x_px: Option<f64>,
    max_x_px: Option<f64>,
    bias_x_px: Option<f64>,
}

/// The cost of a method.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Cost {
    pub(super) method: &'static str,
    /// Time per subset on one thread, us.
    pub(super) us_per_window: f64,
}

impl Point {
    pub(super) fn line(&self) -> Line {
        let part = |part: fn(&Spread) -> Option<f64>| {
            self.error.as_ref().and_then(part).map(|value| (value * 1e7).round() / 1e7 + 0.0)
        };
        Line {
            speeds: self.speeds.as_str(),
            method: self.way.as_str(),
            vx_px_frame: self.speed_px_frame,
            pairs: self.pairs,
            missing: self.missing,
            mean_x_px: part(|error| Some(error.mean)),
            spread_x_px: part(|error| error.spread),
            max_x_px: part(|error| Some(error.max)),
            bias_x_px: part(|error| Some(error.bias)),
        }
    }
}

/// Returns every method at every speed over all patterns, sorted by speeds, method and speed.
pub(super) fn points(job: &Job, rows: &[Row]) -> Vec<Point> {
    let mut points = Vec::new();
    for speeds in Speeds::ALL {
        let films = || job.films.iter().filter(move |film| film.speeds == speeds);
        let mut steps: Vec<f64> = films().map(|film| film.velocity.px_frame[0]).collect();
        steps.sort_by(f64::total_cmp);
        steps.dedup();
        for way in &job.ways {
            for speed in &steps {
                let of = |row: &&Row| {
                    let apart = row.vx_px_frame - speed;
                    row.speeds == speeds.as_str() && row.method == way.as_str() && apart.abs() < 1e-9
                };
                let errors: Vec<Option<f64>> = rows.iter().filter(of).map(|row| row.error()[0]).collect();
                let known: Vec<f64> = errors.iter().copied().flatten().collect();
                points.push(Point {
                    speeds,
                    way: *way,
                    speed_px_frame: *speed,
                    pairs: errors.len(),
                    missing: errors.len() - known.len(),
                    error: Spread::of(&known),
                });
            }
        }
    }
    points
}

/// Measures the cost of every method on one film, alternating the methods.
///
/// # Errors
///
/// When the film cannot be rendered.
#[expect(clippy::disallowed_methods, reason = "a study of cost reads the clock")]
pub(super) fn costs(job: &Job) -> Result<Vec<Cost>, Failure> {
    let Some(plan) = job.films.first() else { return Ok(Vec::new()) };
    let reel = film::film(&film::ball(plan.pattern, &job.filming)?, plan, &job.filming)?;
    let (mut bytes, mut before, mut after) = (Vec::new(), Image::default(), Image::default());
    reel.draw(0, &mut bytes, &mut before)?;
    reel.draw(1, &mut bytes, &mut after)?;
    let mut bench = Bench::new(&job.ways, job.windows, SIDE_PX)?;
    bench.measure(before.view(), after.view());
    let mut times = vec![Vec::new(); job.ways.len()];
    for _ in 0..TURNS {
        for (place, times) in times.iter_mut().enumerate() {
            let began = Instant::now();
            let windows = bench.correlate_again(place, (before.view(), after.view()));
            times.push(1e6 * began.elapsed().as_secs_f64() / windows.max(1) as f64);
        }
    }
    let cost = |(way, mut times): (&Way, Vec<f64>)| {
        times.sort_by(f64::total_cmp);
        Cost { method: way.as_str(), us_per_window: (100.0 * times[0]).round() / 100.0 }
    };
    Ok(job.ways.iter().zip(times).map(cost).collect())
}

/// Draws the figure.
pub(super) fn draw(job: &Job, points: &[Point], costs: &[Cost], caption: &[String]) -> String {
    let top = HEADING + LINE * caption.len() as f64 + 34.0;
    let shown: Vec<Speeds> =
        Speeds::ALL.into_iter().filter(|speeds| points.iter().any(|point| point.speeds == *speeds)).collect();
    let across = LEFT + WIDTH + 20.0;
    let legend_lines = job.ways.len().div_ceil(3) as f64;
    let below = top + 20.0 * (legend_lines - 1.0);
    let size = ((across * shown.len() as f64).max(760.0), below + ABOVE + PLOT + BELOW);
    let mut svg = log_axis::begin(size, job.study.heading(), caption);
    let entry = |(way, cost): (&Way, &Cost)| (*way, format!("{} ({:.0} us a window)", way.title(), cost.us_per_window));
    let entries: Vec<(Way, String)> = job.ways.iter().zip(costs).map(entry).collect();
    for (number, entries) in entries.chunks(3).enumerate() {
        log_axis::legend(&mut svg, top - 26.0 + 20.0 * number as f64, entries);
    }
    let means = points.iter().filter_map(|point| point.error).map(|error| error.mean);
    let axis = LogAxis::around(means, PLOT);
    for (column, speeds) in shown.iter().enumerate() {
        let (left, top) = (across * column as f64 + LEFT, below + ABOVE);
        let title = format!("mean |error| along x, px/frame; {} speeds", speeds.as_str());
        text(&mut svg, (left - LEFT + 14.0, top - 12.0), "class=\"title\"", &title);
        axis.draw(&mut svg, (left, top), WIDTH);
        for tenth in (0..=20).step_by(2) {
            let x = left + WIDTH * 0.1 * f64::from(tenth) / MAX_PX;
            text(&mut svg, (x, top + PLOT + 15.0), "text-anchor=\"middle\"", &format!("{:.1}", 0.1 * f64::from(tenth)));
        }
        let middle = left + 0.5 * WIDTH;
        text(&mut svg, (middle, top + PLOT + 33.0), "text-anchor=\"middle\"", "speed along x, px/frame");
        for way in &job.ways {
            let of = points.iter().filter(|point| (point.speeds, point.way) == (*speeds, *way));
            curve(&mut svg, (left, top), axis, *way, of);
        }
    }
    svg.push_str("</svg>\n");
    svg
}

/// Draws the curve of one method, with a gap where there is no answer.
fn curve<'a>(
    svg: &mut String,
    (left, top): (f64, f64),
    axis: LogAxis,
    way: Way,
    points: impl Iterator<Item = &'a Point>,
) {
    let (mut path, mut joined, mut marks) = (String::new(), false, String::new());
    for point in points {
        let Some(error) = point.error else {
            joined = false;
            continue;
        };
        let (x, y) = (left + WIDTH * point.speed_px_frame / MAX_PX, top + axis.y(error.mean));
        let _ = write!(path, "{}{x:.1} {y:.1}", if joined { 'L' } else { 'M' });
        log_axis::mark(&mut marks, way, (x, y), point.missing);
        joined = true;
    }
    let _ = writeln!(svg, "<path class=\"curve\" stroke=\"{}\" d=\"{path}\"/>", log_axis::colour(way));
    svg.push_str(&marks);
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
            ways: vec![Way::Paper, Way::PeakSpline],
            windows: Windows { subset_size_px: 25, step_px: 40 },
            filming: Filming { frames: 2, noise_dn: 2.0, blur_px: 0.7, seed: 1 },
        }
    }

    /// A row per film and method with an error of 1 % of the speed, or missing.
    fn rows(job: &Job, is_missing: impl Fn(&Film, Way) -> bool) -> Vec<Row> {
        let row = |film: &Film, way: Way| {
            let speed = film.velocity.px_frame[0];
            let step = (!is_missing(film, way)).then_some([1.01 * speed, 0.0, 0.0]);
            Row::new(
                (SpeckleStudy::Peak, film),
                0,
                way,
                &Answer { step, sigma: None, points: 9, status: PointStatus::Valid },
            )
        };
        job.films.iter().flat_map(|film| job.ways.iter().map(move |way| row(film, *way))).collect()
    }

    #[test]
    fn every_speed_has_the_mean_of_its_films_and_a_gap_breaks_the_curve() {
        let job = job();
        let rows = rows(&job, |film, way| way == Way::Paper && (film.velocity.px_frame[0] - 0.5).abs() < 1e-9);
        let points = points(&job, &rows);
        assert_eq!(points.len(), 2 * 2 * 20);
        for point in &points {
            assert_eq!(point.pairs, 8);
            match point.error {
                Some(error) => assert!((error.mean - 0.01 * point.speed_px_frame).abs() < 1e-6, "{point:?}"),
                None => assert_eq!((point.way, point.missing), (Way::Paper, 8)),
            }
        }
        assert_eq!(points.iter().filter(|point| point.error.is_none()).count(), 1);
        let costs = job.ways.iter().map(|way| Cost { method: way.as_str(), us_per_window: 7.0 }).collect::<Vec<_>>();
        let figure = draw(&job, &points, &costs, &["caption <of> it".to_owned()]);
        assert!(figure.contains("caption &lt;of&gt; it") && figure.contains("(7 us a window)"));
        let curves: Vec<&str> = figure.lines().filter(|line| line.contains("class=\"curve\"")).collect();
        let starts: Vec<usize> = curves.iter().map(|curve| curve.matches('M').count()).collect();
        assert_eq!(starts, [2, 1, 1, 1], "only the first has a gap");
    }
}
