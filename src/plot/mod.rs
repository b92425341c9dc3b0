//! Charts and pictures: numbers as text, curves over time, colour maps, arrows and letters in images.

pub(crate) mod arrows;
pub mod color_map;
pub(crate) mod number;
pub(crate) mod pixel_font;
pub(crate) mod time_chart;
