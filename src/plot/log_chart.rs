//! Charts with a logarithmic vertical axis.

use super::figure::{polyline, px};
use maud::{Markup, html};

/// Height of the strip for zeros, px.
const STRIP: f64 = 34.0;

/// A vertical logarithmic axis of whole decades.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LogAxis {
    /// Exponents of ten at both ends.
    low: i32,
    high: i32,
    /// Height of the plot, px.
    height: f64,
    /// Values below this one are drawn as zero, in a strip below the decades.
    zero: f64,
    /// Height of that strip, px; 0 without such values.
    strip: f64,
}

impl LogAxis {
    /// Returns an axis of whole decades around all values, `height` px high. Values below `zero` get a strip below the
    /// decades. Without any other positive value the decades are 0.001 to 1.
    pub fn around(values: impl IntoIterator<Item = f64>, height: f64, zero: f64) -> Self {
        let (mut low, mut high, mut strip) = (f64::INFINITY, f64::NEG_INFINITY, 0.0);
        for value in values {
            if value < zero {
                strip = STRIP;
            } else if value > 0.0 {
                (low, high) = (low.min(value.log10()), high.max(value.log10()));
            }
        }
        // The lowest value stays above the foot, the highest below the frame.
        let (low, high) = if low > high { (-3, 0) } else { ((low - 0.1).floor() as i32, (high + 0.02).ceil() as i32) };
        Self { low, high: high.max(low + 1), height, zero, strip }
    }

    /// Returns the distance of a value from the top of the plot, px. Values below the axis are at its foot, those below
    /// `zero` in the strip.
    pub fn y(&self, value: f64) -> f64 {
        if value < self.zero {
            return self.height - 0.5 * self.strip;
        }
        let share = (f64::from(self.high) - value.max(f64::MIN_POSITIVE).log10()) / f64::from(self.high - self.low);
        (self.height - self.strip) * share.clamp(0.0, 1.0)
    }

    /// Draws grid lines, labels and the frame of a plot.
    pub fn draw(&self, plot: PlotArea) -> Markup {
        let PlotArea { left, top, width } = plot;
        html! {
            @for power in self.low..=self.high {
                @let y = top + self.y(10_f64.powi(power));
                path class="grid" d={ "M" (left) " " (px(y)) "h" (width) } {}
                text class="tick" x=(px(left - 6.0)) y=(px(y + 4.0)) text-anchor="end" { (power_of_ten(power)) }
            }
            @if self.strip > 0.0 {
                text class="tick" x=(px(left - 6.0)) y=(px(top + self.y(0.0) + 4.0)) text-anchor="end" { "0" }
            }
            path class="axis" d={ "M" (left) " " (top) "v" (self.height) "h" (width) } {}
        }
    }
}

/// Formats ten to a power as the label of a tick: as a decimal from 0.0001 to 1000, in scientific notation otherwise.
fn power_of_ten(power: i32) -> String {
    match power {
        -4..=3 => format!("{:.*}", (-power).max(0) as usize, 10_f64.powi(power)),
        _ => format!("1e{power}"),
    }
}

/// The place of a plot in its figure, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlotArea {
    /// Left edge.
    pub left: f64,
    /// Upper edge.
    pub top: f64,
    /// Width.
    pub width: f64,
}

/// The marker of a curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Marker {
    /// None.
    Line,
    /// A disc.
    Disc,
    /// A square.
    Square,
}

/// The style of a curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CurveStyle {
    /// Colour of line and marker.
    pub color: &'static str,
    /// Dashes of the line; empty for a solid one.
    pub dash: &'static str,
    /// The marker.
    pub marker: Marker,
}

impl CurveStyle {
    /// Draws a marker centred at a place, px.
    fn draw_marker(&self, x: f64, y: f64, fill: &str) -> Markup {
        html! {
            @match self.marker {
                Marker::Line => {}
                Marker::Disc => circle class="mark" fill=(fill) stroke=(self.color) cx=(px(x)) cy=(px(y)) r="3.5" {},
                Marker::Square => {
                    rect class="mark" fill=(fill) stroke=(self.color) x=(px(x - 3.5)) y=(px(y - 3.5)) width="7"
                        height="7" {}
                }
            }
        }
    }
}

/// One value of a curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LogValue {
    /// Its place along the horizontal axis, 0 to 1.
    pub x: f64,
    /// The value.
    pub y: f64,
    /// Whether the point is incomplete, which a hollow marker shows.
    pub is_incomplete: bool,
}

/// A curve.
#[derive(Debug, Clone, PartialEq)]
pub struct LogCurve {
    /// Its style.
    pub style: CurveStyle,
    /// Its values; `None` leaves a gap.
    pub values: Vec<Option<LogValue>>,
    /// The index of the ringed value; `None` for no ring.
    pub ring: Option<usize>,
}

impl LogCurve {
    /// Draws the line, the markers and the ring of the curve.
    fn draw(&self, axis: &LogAxis, plot: PlotArea) -> Markup {
        let place = |value: &LogValue| (plot.left + plot.width * value.x, plot.top + axis.y(value.y));
        // No line leads to a zero: its length would be meaningless on a logarithmic axis.
        let line = polyline(self.values.iter().map(|value| value.as_ref().filter(|v| v.y >= axis.zero).map(place)));
        html! {
            path class="curve" stroke=(self.style.color) stroke-dasharray=[Some(self.style.dash).filter(|d| !d.is_empty())]
                d=(line) {}
            @for value in self.values.iter().flatten() {
                @let (x, y) = place(value);
                (self.style.draw_marker(x, y, if value.is_incomplete { "#fff" } else { self.style.color }))
            }
            @if let Some((x, y)) = self.ring.and_then(|index| self.values[index].as_ref()).map(place) {
                circle class="ring" cx=(px(x)) cy=(px(y)) r="9" {}
            }
        }
    }
}

/// A chart of curves over a common horizontal axis.
pub struct LogChart<'a> {
    /// The title, which names the vertical axis.
    pub title: &'a str,
    /// The label of the horizontal axis.
    pub x_label: &'a str,
    /// The labels along the horizontal axis with their places, 0 to 1.
    pub x_ticks: Vec<(f64, String)>,
    /// The vertical axis.
    pub axis: LogAxis,
    /// The curves.
    pub curves: Vec<LogCurve>,
}

impl LogChart<'_> {
    /// The height of the title above the plot, px.
    pub const TITLE: f64 = 28.0;
    /// The height of the labels below the plot, px.
    pub const LABELS: f64 = 46.0;

    /// Draws the chart with its title above and its labels below the plot.
    pub fn draw(&self, plot: PlotArea) -> Markup {
        let PlotArea { left, top, width } = plot;
        let foot = top + self.axis.height;
        html! {
            text class="title" x=(px(left - 52.0)) y=(px(top - 12.0)) { (self.title) }
            (self.axis.draw(plot))
            @for (x, label) in &self.x_ticks {
                text class="tick" x=(px(left + width * x)) y=(px(foot + 15.0)) text-anchor="middle" { (label) }
            }
            text class="tick" x=(px(left + 0.5 * width)) y=(px(foot + 33.0)) text-anchor="middle" { (self.x_label) }
            @for curve in &self.curves { (curve.draw(&self.axis, plot)) }
        }
    }
}

/// Draws a legend in one line whose markers are at height `top`, px: line, marker and label of each entry.
pub fn draw_legend(top: f64, entries: &[(CurveStyle, String)]) -> Markup {
    let mut left = 14.0;
    let placed = entries.iter().map(|(style, label)| {
        let from = left;
        left += 44.0 + 6.6 * label.chars().count() as f64;
        (from, style, label)
    });
    html! {
        @for (left, style, label) in placed {
            path class="curve" stroke=(style.color) stroke-dasharray=[Some(style.dash).filter(|d| !d.is_empty())]
                d={ "M" (px(left)) " " (px(top)) "h24" } {}
            (style.draw_marker(left + 12.0, top, style.color))
            text x=(px(left + 30.0)) y=(px(top + 4.0)) { (label) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLOT: PlotArea = PlotArea { left: 0.0, top: 0.0, width: 100.0 };

    fn curve(values: &[Option<f64>]) -> LogCurve {
        let value = |y: f64| LogValue { x: 0.5, y, is_incomplete: false };
        let style = CurveStyle { color: "#000", dash: "", marker: Marker::Disc };
        LogCurve { style, values: values.iter().map(|y| y.map(value)).collect(), ring: None }
    }

    #[test]
    fn a_decade_is_the_same_height_everywhere_and_higher_is_more() {
        let axis = LogAxis::around([0.004, 0.7, 0.0], 120.0, 0.0);
        assert_eq!((axis.low, axis.high, axis.strip), (-3, 0, 0.0));
        for value in [0.001, 0.002, 0.03] {
            assert!((axis.y(value) - axis.y(10.0 * value) - 40.0).abs() < 1e-9, "{value}");
        }
        assert!(axis.y(1.0).abs() < 1e-9);
        assert!((axis.y(0.0) - 120.0).abs() < 1e-9 && (axis.y(1e-9) - 120.0).abs() < 1e-9, "below is at the foot");
        let empty = LogAxis::around([], 120.0, 0.0);
        assert_eq!((empty.low, empty.high), (-3, 0));
    }

    #[test]
    fn a_missing_value_breaks_the_curve_and_a_zero_has_a_mark_without_a_line() {
        let drawn = |values: &[Option<f64>]| {
            let axis = LogAxis::around(values.iter().flatten().copied(), 250.0, 1e-7);
            let svg = curve(values).draw(&axis, PLOT).into_string();
            (svg.matches(['M', 'L']).count(), svg.matches('M').count(), svg.matches("<circle").count())
        };
        assert_eq!(drawn(&[Some(0.01); 9]), (9, 1, 9));
        let mut values = [Some(0.01); 9];
        values[3] = None;
        assert_eq!(drawn(&values), (8, 2, 8));
        values[3] = Some(0.0);
        assert_eq!(drawn(&values), (8, 2, 9));
        let axis = LogAxis::around(values.into_iter().flatten(), 250.0, 1e-7);
        assert!((axis.y(0.0) - (250.0 - 0.5 * STRIP)).abs() < 1e-9);
        assert_eq!(drawn(&[Some(0.0); 9]), (0, 0, 9));
        assert_eq!(drawn(&[None; 9]), (0, 0, 0));
    }

    #[test]
    fn powers_of_ten_are_short() {
        assert_eq!([-3, 1, -7].map(power_of_ten), ["0.001", "10", "1e-7"]);
    }
}
