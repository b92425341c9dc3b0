//! Charts and pictures: numbers as text, SVG charts and figures, colour maps and vectors over images.

mod arrows;
mod canvas;
mod color_map;
mod figure;
mod log_chart;
mod number;
mod pixel_font;
mod time_chart;

pub use arrows::{ArrowScale, draw_vectors};
pub use canvas::{Canvas, Color, stretched_levels};
pub use color_map::{ColorMap, Quantity, draw_map};
pub use figure::{Figure, px};
pub use log_chart::{CurveStyle, LogAxis, LogChart, LogCurve, LogValue, Marker, PlotArea, draw_legend};
pub use number::{EstimateText, ImpactQuantity, fixed, format_estimate, three_digits};
pub use time_chart::{TimeChart, TimeCurve, TimePoint, Timeline};
