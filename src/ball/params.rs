//! What a ball finder is planned with.

/// Smallest radius the edge fit can work with, px.
pub(super) const LEAST_RADIUS_PX: f64 = 6.0;
/// Largest radius accepted, px; bounds the memory a finder plans.
pub(super) const MOST_RADIUS_PX: f64 = 2000.0;

/// How the outline of a ball is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OutlineMethod {
    /// Edges along the rim to a fraction of a pixel, and a circle through them that outliers do not move.
    #[default]
    Edges,
    /// The paper's (section 4.3): the boundary marked in whole pixels, the ball filtered, a Hough transform.
    Marked,
}

/// Where and how large a ball may be.
#[derive(Debug, Clone, PartialEq)]
pub struct BallParams {
    /// Smallest radius looked for, px.
    pub min_radius_px: f64,
    /// Largest radius looked for, px.
    pub max_radius_px: f64,
    /// Searched region: x, y, width, height, px; `None` is the whole image.
    pub roi_px: Option<[u32; 4]>,
    /// How its outline is measured once it is found.
    pub outline: OutlineMethod,
}

impl BallParams {
    /// Balls of `min_radius_px` to `max_radius_px` anywhere in the image.
    pub fn new(min_radius_px: f64, max_radius_px: f64) -> Self {
        Self { min_radius_px, max_radius_px, roi_px: None, outline: OutlineMethod::default() }
    }

    /// Refuses what cannot be searched for in an image of this shape.
    pub(super) fn check(&self, width_px: usize, height_px: usize) -> Result<(), BallError> {
        let (least, most) = (LEAST_RADIUS_PX, MOST_RADIUS_PX);
        if !(least..=most).contains(&self.min_radius_px) {
            return Err(BallError::new("min_radius_px", self.min_radius_px, format!("{least} to {most}")));
        }
        if !(self.min_radius_px..=most).contains(&self.max_radius_px) {
            let range = format!("min_radius_px ({}) to {most}", self.min_radius_px);
            return Err(BallError::new("max_radius_px", self.max_radius_px, range));
        }
        let Some([x, y, width, height]) = self.roi_px else { return Ok(()) };
        let fits = |start: u32, length: u32, total: usize| length > 0 && (start as usize + length as usize) <= total;
        if !fits(x, width, width_px) || !fits(y, height, height_px) {
            let value = format!("[{x}, {y}, {width}, {height}]");
            let range = format!("x, y, width, height inside the {width_px} x {height_px} px image, not empty");
            return Err(BallError::new("roi_px", value, range));
        }
        Ok(())
    }
}

/// A ball finder cannot be planned.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum BallError {
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

impl BallError {
    fn new(key: &'static str, value: impl ToString, range: String) -> Self {
        Self::Range { key, value: value.to_string(), range }
    }
}
