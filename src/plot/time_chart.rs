//! Curves over time as SVG, coloured by the style sheet of the page.

use super::figure::{polyline, px};
use super::number::fixed;
use maud::{Markup, html};

/// Width of a chart in its own units; the page scales it.
const WIDTH: f64 = 900.0;
/// Free space around the plot, in the same units.
const LEFT: f64 = 62.0;
const RIGHT: f64 = 92.0;
const TOP: f64 = 10.0;
/// Height of the time axis with its numbers.
const AXIS: f64 = 34.0;

/// Maximum number of points drawn as they are. More are decimated to the extremes of each column.
const MAX_POINTS: usize = 1600;

/// One point of a curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimePoint {
    /// Time, ms.
    pub x: f64,
    /// The value.
    pub y: f64,
    /// Its standard uncertainty; 0 draws no band.
    pub sigma: f64,
}

/// A curve with its label.
#[derive(Debug, Clone)]
pub struct TimeCurve {
    /// Class of the style sheet: `a`, `b`, `c` or `truth`.
    pub class: &'static str,
    /// Text at its end; empty for none.
    pub label: &'static str,
    /// Unbroken stretches; nothing was measured between one and the next.
    pub stretches: Vec<Vec<TimePoint>>,
}

/// The time axis that all charts of a body share.
#[derive(Debug, Clone, Default)]
pub struct Timeline {
    /// First and last time, ms.
    pub span: [f64; 2],
    /// Contacts: start, deepest, end, ms.
    pub contacts: Vec<[Option<f64>; 3]>,
}

/// A chart.
#[derive(Debug, Clone)]
pub struct TimeChart {
    /// Description for readers who cannot see it.
    pub title: String,
    /// The curves, back to front.
    pub curves: Vec<TimeCurve>,
    /// Height of the plot alone.
    pub height: f64,
    /// Whether the time axis has numbers.
    pub has_axis: bool,
}

/// The mapping from times (`x`, ms) and values (`y`) to places in the chart.
struct Scale {
    x: [f64; 2],
    y: [f64; 2],
    height: f64,
}

impl Scale {
    /// Returns the horizontal place of a time (ms), in the chart's own units.
    fn x(&self, x: f64) -> f64 {
        LEFT + (x - self.x[0]) / (self.x[1] - self.x[0]) * (WIDTH - LEFT - RIGHT)
    }

    /// Returns the vertical place of a value, from the top downwards, in the chart's own units.
    fn y(&self, y: f64) -> f64 {
        TOP + (self.y[1] - y) / (self.y[1] - self.y[0]) * self.height
    }
}

impl TimeChart {
    /// Draws the chart; `None` when there is no point to draw.
    pub fn draw(&self, time: &Timeline) -> Option<Markup> {
        let y = value_range(&self.curves)?;
        let x = if time.span[1] > time.span[0] { time.span } else { [time.span[0] - 0.5, time.span[0] + 0.5] };
        let scale = Scale { x, y, height: self.height };
        let total = TOP + self.height + if self.has_axis { AXIS } else { 6.0 };
        Some(html! {
            svg class="chart" viewBox={ "0 0 " (WIDTH) " " (total) } role="img" aria-label=(self.title) {
                @for contact in &time.contacts { (draw_contact(&scale, contact)) }
                (draw_grid(&scale))
                @if self.has_axis { (draw_time_axis(&scale)) }
                @for curve in &self.curves {
                    @for stretch in &curve.stretches {
                        @let stretch = decimated(stretch, &scale);
                        (draw_band(&scale, curve.class, &stretch))
                        (draw_line(&scale, curve.class, &stretch))
                    }
                }
                (draw_labels(&scale, &self.curves))
            }
        })
    }
}

/// Returns the range of all values with their bands of two standard uncertainties, and a margin; `None` without values.
fn value_range(curves: &[TimeCurve]) -> Option<[f64; 2]> {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for point in curves.iter().flat_map(|curve| curve.stretches.iter().flatten()) {
        low = low.min(point.y - 2.0 * point.sigma);
        high = high.max(point.y + 2.0 * point.sigma);
    }
    if !(low.is_finite() && high.is_finite()) {
        return None;
    }
    let margin = ((high - low) * 0.08).max(high.abs().max(low.abs()) * 1e-6).max(1e-9);
    Some([low - margin, high + margin])
}

/// Returns round numbers from `span[0]` to `span[1]` in steps of 1, 2 or 5 times a power of ten, about `count` of them.
///
/// Also returns the decimals that they need.
fn ticks(span: [f64; 2], count: f64) -> (Vec<f64>, usize) {
    let rough = (span[1] - span[0]) / count;
    let power = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|k| k * power).find(|step| *step >= rough).unwrap_or(rough);
    let decimals = (-(step * 1.000_001).log10().floor()).clamp(0.0, 9.0) as usize;
    // An end that is a whole step is a tick, whichever way its quotient is rounded.
    let (first, last) = ((span[0] / step - 1e-6).ceil() as i64, (span[1] / step + 1e-6).floor() as i64);
    ((first..=last).map(|k| k as f64 * step).collect(), decimals)
}

/// Shades a contact from start to end and marks its three moments.
fn draw_contact(scale: &Scale, contact: &[Option<f64>; 3]) -> Markup {
    let [start, deepest, end] = *contact;
    let shade = start.zip(end).map(|(start, end)| (scale.x(start.max(scale.x[0])), scale.x(end.min(scale.x[1]))));
    let is_inside = |moment: &f64| *moment >= scale.x[0] && *moment <= scale.x[1];
    let marks = [(start, "edge"), (deepest, "deepest"), (end, "edge")];
    html! {
        @if let Some((left, right)) = shade.filter(|(left, right)| right > left) {
            rect class="contact" x=(px(left)) y=(TOP) width=(px(right - left)) height=(scale.height) {}
        }
        @for (moment, class) in marks {
            @if let Some(moment) = moment.filter(is_inside) {
                path class=(class) d={ "M" (px(scale.x(moment))) " " (TOP) "V" (TOP + scale.height) } {}
            }
        }
    }
}

/// Draws the horizontal grid lines with their values.
fn draw_grid(scale: &Scale) -> Markup {
    let (levels, decimals) = ticks(scale.y, (scale.height / 34.0).max(3.0));
    html! {
        @for level in levels {
            @let y = scale.y(level);
            path class=(if level.abs() < 1e-12 { "zero" } else { "grid" })
                d={ "M" (LEFT) " " (px(y)) "H" (WIDTH - RIGHT) } {}
            text class="tick" x=(px(LEFT - 8.0)) y=(px(y + 4.0)) text-anchor="end" { (fixed(level, decimals)) }
        }
    }
}

/// Draws the time axis with its ticks, ms.
fn draw_time_axis(scale: &Scale) -> Markup {
    let (right, low) = (WIDTH - RIGHT, TOP + scale.height);
    let (moments, decimals) = ticks(scale.x, 10.0);
    html! {
        path class="axis" d={ "M" (LEFT) " " (low) "H" (right) } {}
        @for moment in moments {
            @let x = px(scale.x(moment));
            path class="axis" d={ "M" (x) " " (low) "v5" } {}
            text class="tick" x=(x) y=(px(low + 19.0)) text-anchor="middle" { (fixed(moment, decimals)) }
        }
        text class="tick unit" x=(right + 10.0) y=(px(low + 19.0)) { "ms" }
    }
}

/// Returns the points of a stretch. Of more than [`MAX_POINTS`], it returns the lowest and the highest of each column,
/// which is as wide as the chart's own unit.
fn decimated(stretch: &[TimePoint], scale: &Scale) -> Vec<TimePoint> {
    if stretch.len() <= MAX_POINTS {
        return stretch.to_vec();
    }
    let mut kept: Vec<TimePoint> = Vec::with_capacity(MAX_POINTS + 2);
    let column = |point: &TimePoint| scale.x(point.x).floor() as i64;
    for points in stretch.chunk_by(|a, b| column(a) == column(b)) {
        let lowest = (0..points.len()).min_by(|a, b| points[*a].y.total_cmp(&points[*b].y)).unwrap_or(0);
        let highest = (0..points.len()).max_by(|a, b| points[*a].y.total_cmp(&points[*b].y)).unwrap_or(0);
        kept.push(points[lowest.min(highest)]);
        if lowest != highest {
            kept.push(points[lowest.max(highest)]);
        }
    }
    kept
}

/// Returns the SVG path through points of time (ms) and value.
fn svg_path(scale: &Scale, points: impl Iterator<Item = (f64, f64)>) -> String {
    polyline(points.map(|(x, y)| Some((scale.x(x), scale.y(y)))))
}

/// Draws a band of two standard uncertainties to either side, if any point has one.
fn draw_band(scale: &Scale, class: &str, points: &[TimePoint]) -> Markup {
    let has_band = points.len() > 1 && points.iter().any(|point| point.sigma > 0.0);
    let above = points.iter().map(|p| (p.x, p.y + 2.0 * p.sigma));
    let below = points.iter().rev().map(|p| (p.x, p.y - 2.0 * p.sigma));
    html! { @if has_band { path class={ "band " (class) } d={ (svg_path(scale, above.chain(below))) "Z" } {} } }
}

/// Draws the line through a stretch of points; a single point is a dot.
fn draw_line(scale: &Scale, class: &str, points: &[TimePoint]) -> Markup {
    html! {
        @match points {
            [] => {}
            [alone] => circle class={ "dot " (class) } cx=(px(scale.x(alone.x))) cy=(px(scale.y(alone.y))) r="1.6" {},
            _ => path class={ "line " (class) } d=(svg_path(scale, points.iter().map(|p| (p.x, p.y)))) {}
        }
    }
}

/// Writes the label of each curve at its end, moved apart where two would overlap.
fn draw_labels(scale: &Scale, curves: &[TimeCurve]) -> Markup {
    let labelled = curves.iter().filter(|curve| !curve.label.is_empty());
    let mut ends: Vec<(f64, &TimeCurve)> =
        labelled.filter_map(|curve| Some((scale.y(curve.stretches.iter().flatten().last()?.y), curve))).collect();
    ends.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut free = TOP;
    for (y, _) in &mut ends {
        *y = y.max(free).min(TOP + scale.height);
        free = *y + 15.0;
    }
    html! {
        @for (y, curve) in ends {
            text class={ "label " (curve.class) } x=(WIDTH - RIGHT + 8.0) y=(px(y + 4.0)) { (curve.label) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(points: Vec<TimePoint>) -> TimeChart {
        let curves = vec![TimeCurve { class: "a", label: "vn", stretches: vec![points] }];
        TimeChart { title: "t".into(), curves, height: 100.0, has_axis: true }
    }

    #[test]
    fn ticks_are_round_and_inside() {
        let (ticks, decimals) = ticks([-0.34, 1.72], 4.0);
        assert_eq!((ticks.len(), decimals), (2, 0), "{ticks:?}");
        let (ticks, decimals) = super::ticks([0.0, 9.9], 10.0);
        assert_eq!((ticks, decimals), ((0..10).map(f64::from).collect(), 0));
        let (ticks, decimals) = super::ticks([61.5, 61.6], 4.0);
        assert_eq!((ticks.len(), decimals), (3, 2), "{ticks:?}");
    }

    #[test]
    fn an_empty_chart_draws_nothing() {
        assert!(chart(Vec::new()).draw(&Timeline { span: [0.0, 1.0], contacts: Vec::new() }).is_none());
    }

    #[test]
    fn thinning_keeps_a_single_peak() {
        let mut points: Vec<TimePoint> =
            (0..100_000).map(|k| TimePoint { x: f64::from(k), y: 0.0, sigma: 0.0 }).collect();
        points[54_321].y = 1.0;
        let scale = Scale { x: [0.0, 99_999.0], y: [0.0, 1.0], height: 100.0 };
        let thin = decimated(&points, &scale);
        assert!(thin.len() <= 2 * WIDTH as usize, "{}", thin.len());
        assert!(thin.contains(&points[54_321]));
        assert!(thin.is_sorted_by(|a, b| a.x <= b.x));
    }

    #[test]
    fn a_contact_is_shaded_where_it_lies_in_the_picture() {
        let points = vec![TimePoint { x: 0.0, y: 0.0, sigma: 0.1 }, TimePoint { x: 10.0, y: 1.0, sigma: 0.1 }];
        let time = Timeline { span: [0.0, 10.0], contacts: vec![[Some(5.0), Some(6.0), Some(20.0)]] };
        let svg = chart(points).draw(&time).unwrap().into_string();
        assert!(svg.contains("<rect class=\"contact\" x=\"435.0\" y=\"10\" width=\"373.0\""), "{svg}");
        assert_eq!((svg.matches("class=\"edge\"").count(), svg.matches("class=\"deepest\"").count()), (1, 1));
        assert!(svg.contains("band a") && !svg.contains("NaN"));
    }
}
