//! Parameters of a rod finder.

use crate::image::PixelRect;
use crate::results::ROD_EDGES;

/// The minimum width of a rod, px.
pub const MIN_WIDTH_PX: f64 = 8.0;

/// The region and the widths in which a rod is searched.
#[derive(Debug, Clone, PartialEq)]
pub struct RodParams {
    /// The minimum and the maximum width, px.
    pub width_px: [f64; 2],
    /// The number of followed tape edges, from the top downwards: 2 to 4.
    pub edges: u32,
    /// The searched region: x, y, width, height, px; `None` for the whole image.
    pub roi_px: Option<[u32; 4]>,
}

impl RodParams {
    /// Creates parameters for rods of any width with this number of edges, anywhere in the image.
    pub fn new(edges: u32) -> Self {
        Self { width_px: [MIN_WIDTH_PX, f64::from(u16::MAX)], edges, roi_px: None }
    }

    /// Returns the searched region of an image of this size.
    pub(super) fn region(&self, width_px: usize, height_px: usize) -> PixelRect {
        self.roi_px.map_or(PixelRect::whole(width_px as u32, height_px as u32), PixelRect::from)
    }

    /// Checks the parameters for images of this size.
    ///
    /// # Errors
    ///
    /// [`RodError::Range`] for the first parameter that is out of its range.
    pub(super) fn check(&self, width_px: usize, height_px: usize) -> Result<(), RodError> {
        let refuse = |key, value, range| Err(RodError::Range { key, value, range });
        if !(2..=ROD_EDGES as u32).contains(&self.edges) {
            return refuse("edges", self.edges.to_string(), format!("2 to {ROD_EDGES}"));
        }
        let [min, max] = self.width_px;
        if !(min >= MIN_WIDTH_PX && max > min) {
            let range = format!("at least {MIN_WIDTH_PX} px and the second larger");
            return refuse("width_px", format!("[{min}, {max}]"), range);
        }
        let Some([x, y, width, height]) = self.roi_px else { return Ok(()) };
        let region = self.region(width_px, height_px);
        if region.is_empty() || !PixelRect::whole(width_px as u32, height_px as u32).contains(region) {
            let range = format!("x, y, width, height inside the {width_px} x {height_px} px image, not empty");
            return refuse("roi_px", format!("[{x}, {y}, {width}, {height}]"), range);
        }
        Ok(())
    }
}

/// The reason why a rod finder cannot be created.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RodError {
    /// A parameter is out of its range.
    #[error("{key} = {value} is out of range: allowed is {range}")]
    Range {
        /// The name of the parameter.
        key: &'static str,
        /// The given value.
        value: String,
        /// The allowed range.
        range: String,
    },
}

impl crate::failure::Fatal for RodError {}
