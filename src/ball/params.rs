//! What a ball finder is planned with.

/// Where and how large a ball may be.
#[derive(Debug, Clone, PartialEq)]
pub struct BallParams {
    /// Smallest radius looked for, px.
    pub min_radius_px: f64,
    /// Largest radius looked for, px.
    pub max_radius_px: f64,
    /// Searched region: x, y, width, height, px; `None` is the whole image.
    pub roi_px: Option<[u32; 4]>,
}
