//! What a rod finder is planned with.

use crate::results::ROD_EDGES;

/// Narrowest rod whose edges can be told, px.
pub const LEAST_WIDTH_PX: f64 = 8.0;

/// Where and how wide a rod may be.
#[derive(Debug, Clone, PartialEq)]
pub struct RodParams {
    /// Narrowest and widest rod looked for, px.
    pub width_px: [f64; 2],
    /// Edges of tapes that are followed, from the top downwards: 2 to 4.
    pub edges: u32,
    /// Searched region: x, y, width, height, px; `None` is the whole image.
    pub roi_px: Option<[u32; 4]>,
}

impl RodParams {
    /// Rods of any width with this number of edges, anywhere in the image.
    pub fn new(edges: u32) -> Self {
        Self { width_px: [LEAST_WIDTH_PX, f64::from(u16::MAX)], edges, roi_px: None }
    }

    /// The searched region: x, y, width, height, px.
    pub(super) fn region(&self, width_px: usize, height_px: usize) -> [usize; 4] {
        self.roi_px.map_or([0, 0, width_px, height_px], |roi| roi.map(|number| number as usize))
    }

    /// Refuses what cannot be searched for in an image of this shape.
    pub(super) fn check(&self, width_px: usize, height_px: usize) -> Result<(), RodError> {
        let refuse = |key, value, range| Err(RodError::Range { key, value, range });
        if !(2..=ROD_EDGES as u32).contains(&self.edges) {
            return refuse("edges", self.edges.to_string(), format!("2 to {ROD_EDGES}"));
        }
        let [least, most] = self.width_px;
        if !(least >= LEAST_WIDTH_PX && most > least) {
            let range = format!("at least {LEAST_WIDTH_PX} px and the second larger");
            return refuse("width_px", format!("[{least}, {most}]"), range);
        }
        let [x, y, width, height] = self.region(width_px, height_px);
        if width == 0 || height == 0 || x + width > width_px || y + height > height_px {
            let range = format!("x, y, width, height inside the {width_px} x {height_px} px image, not empty");
            return refuse("roi_px", format!("[{x}, {y}, {width}, {height}]"), range);
        }
        Ok(())
    }
}

/// A rod finder cannot be planned.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RodError {
    /// A parameter is outside what is allowed.
    #[error("{key} = {value} is out of range: allowed is {range}")]
    Range {
        /// Name of the parameter.
        key: &'static str,
        /// What was given.
        value: String,
        /// What is allowed.
        range: String,
    },
}
