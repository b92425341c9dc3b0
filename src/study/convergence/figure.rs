//! The figure of the convergence study: logarithmic curves over the number of spline points.

use super::SPLINE_POINTS;
use crate::plot::{CurveStyle, Figure, LogAxis, LogChart, LogCurve, LogValue, Marker, PlotArea, draw_legend};
use maud::html;

/// Size of the figure and of its plots, px.
const WIDTH: f64 = 760.0;
const PLOT: f64 = 250.0;
const LEFT: f64 = 66.0;
const RIGHT: f64 = 24.0;
/// Height of the legend of a panel, px.
const LEGEND: f64 = 30.0;

/// Smaller lengths are rounding errors of single precision and are drawn as zero, px.
const ZERO_PX: f64 = 1e-7;

/// Blue discs, orange squares, a dashed black line and a dotted grey line.
pub(super) const DISCS: CurveStyle = CurveStyle { color: "#0072b2", dash: "", marker: Marker::Disc };
pub(super) const SQUARES: CurveStyle = CurveStyle { color: "#d55e00", dash: "", marker: Marker::Square };
pub(super) const DASHED: CurveStyle = CurveStyle { color: "#222", dash: "7 4", marker: Marker::Line };
pub(super) const DOTTED: CurveStyle = CurveStyle { color: "#888", dash: "2 3", marker: Marker::Line };

/// A curve and its legend entry.
#[derive(Debug, Clone)]
pub(super) struct Curve {
    pub(super) style: CurveStyle,
    pub(super) name: String,
    /// The lengths, one per number of spline points; `None` where there is none.
    pub(super) values_px: [Option<f64>; SPLINE_POINTS.len()],
    /// The index of the ringed point.
    pub(super) ring: Option<usize>,
}

/// A plot.
#[derive(Debug, Clone)]
pub(super) struct Panel {
    /// The title, which names the vertical axis with its unit.
    pub(super) title: String,
    pub(super) curves: Vec<Curve>,
}

/// Returns the text of the SVG file: the panels, one below the other, under heading and caption.
pub(super) fn draw(heading: &str, caption: &[String], panels: &[Panel]) -> String {
    let figure = Figure { heading, caption };
    let each = LEGEND + LogChart::TITLE + PLOT + LogChart::LABELS;
    let top = |index: usize| figure.content_top() + 20.0 + each * index as f64;
    let content = html! {
        @for (index, panel) in panels.iter().enumerate() {
            (draw_legend(top(index), &panel.curves.iter().map(|c| (c.style, c.name.clone())).collect::<Vec<_>>()))
            (panel.chart().draw(PlotArea {
                left: LEFT,
                top: top(index) + LEGEND + LogChart::TITLE - 16.0,
                width: WIDTH - LEFT - RIGHT,
            }))
        }
    };
    figure.draw(WIDTH, top(panels.len()), &content)
}

/// Returns the position of an index of [`SPLINE_POINTS`] along the horizontal axis, 0 to 1; positions are evenly
/// spaced.
fn axis_position(index: usize) -> f64 {
    (index as f64 + 0.5) / SPLINE_POINTS.len() as f64
}

impl Panel {
    /// Returns the chart of the panel.
    fn chart(&self) -> LogChart<'_> {
        let values = |curve: &Curve| {
            let value = |(index, y): (usize, &Option<f64>)| {
                y.map(|y| LogValue { x: axis_position(index), y, is_incomplete: false })
            };
            curve.values_px.iter().enumerate().map(value).collect()
        };
        let curve = |curve: &Curve| LogCurve { style: curve.style, values: values(curve), ring: curve.ring };
        LogChart {
            title: &self.title,
            x_label: "spline points between two pixels",
            x_ticks: SPLINE_POINTS
                .iter()
                .enumerate()
                .map(|(index, points)| (axis_position(index), points.to_string()))
                .collect(),
            axis: LogAxis::around(self.curves.iter().flat_map(|curve| curve.values_px).flatten(), PLOT, ZERO_PX),
            curves: self.curves.iter().map(curve).collect(),
        }
    }
}
