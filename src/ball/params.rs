//! Parameters of a ball finder.

use super::texture_disc::RadiusRange;
use crate::failure::{ExitCode, Fatal};
use crate::image::PixelRect;

/// The minimum radius for the edge fit, px. A smaller ball is found as a point, by what changes.
pub(super) const MIN_EDGE_RADIUS_PX: f64 = 6.0;
/// The distance of a radius from the allowed range that is still accepted, px.
pub(super) const RADIUS_ALLOWANCE_PX: f64 = 1.0;
/// The minimum radius, px.
const MIN_RADIUS_PX: f64 = 2.0;
/// The maximum radius, px, which bounds the memory of a finder.
pub(super) const MAX_RADIUS_PX: f64 = 2000.0;

/// The method for the outline of a ball.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OutlineMethod {
    /// Subpixel edges along the rim and a robust circle through them.
    #[default]
    Edges,
    /// The method of the paper (section 4.3): a boundary in whole pixels, a filtered ball, a Hough transform.
    Marked,
}

/// The certainty that a ball is at its predicted position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Presence {
    /// Something else may be there.
    Uncertain,
    /// The ball is known to be there, for example from a match of its pattern.
    Certain,
}

/// The region and the radii in which a ball is searched.
#[derive(Debug, Clone, PartialEq)]
pub struct BallParams {
    /// The minimum radius, px.
    pub min_radius_px: f64,
    /// The maximum radius, px.
    pub max_radius_px: f64,
    /// The radius to expect, px, if the scale and the diameter of the ball are known.
    pub expected_radius_px: Option<f64>,
    /// The searched region: x, y, width, height, px; `None` for the whole image.
    pub roi_px: Option<[u32; 4]>,
    /// The method for the outline.
    pub outline: OutlineMethod,
    /// The outward direction of the surface that may show a mirror image of the ball, a unit vector along x and y (down);
    /// `None` where several balls may be alike.
    pub outward: Option<[f64; 2]>,
}

impl BallParams {
    /// Creates parameters for balls of `min_radius_px` to `max_radius_px` anywhere in the image.
    pub fn new(min_radius_px: f64, max_radius_px: f64) -> Self {
        Self {
            min_radius_px,
            max_radius_px,
            expected_radius_px: None,
            roi_px: None,
            outline: OutlineMethod::default(),
            outward: None,
        }
    }

    /// Whether a ball may be large enough for its edges to be measured.
    pub(super) fn may_have_edges(&self) -> bool {
        self.expected_radius_px.unwrap_or(self.max_radius_px) >= MIN_EDGE_RADIUS_PX - RADIUS_ALLOWANCE_PX
    }

    /// Whether a ball may be too small for its edges to be measured.
    pub(super) fn may_be_point(&self) -> bool {
        self.expected_radius_px.unwrap_or(self.min_radius_px) < MIN_EDGE_RADIUS_PX
    }

    /// Returns the same parameters for balls with edges.
    pub(super) fn for_edges(&self) -> Self {
        let min_radius_px = self.min_radius_px.max(MIN_EDGE_RADIUS_PX);
        Self { min_radius_px, max_radius_px: self.max_radius_px.max(min_radius_px), ..self.clone() }
    }

    /// Returns the expected radius if it lies in a range, px.
    pub(super) fn expected_radius_within(&self, range: RadiusRange) -> Option<f64> {
        self.expected_radius_px.filter(|radius_px| (range.low..=range.high).contains(radius_px))
    }

    /// Returns the searched region of an image of this size.
    pub(super) fn region(&self, width_px: usize, height_px: usize) -> PixelRect {
        self.roi_px.map_or(PixelRect::whole(width_px as u32, height_px as u32), PixelRect::from)
    }

    /// Checks the parameters for images of this size.
    ///
    /// # Errors
    ///
    /// Returns [`BallError::Range`] for the first parameter out of its range.
    pub(super) fn check(&self, width_px: usize, height_px: usize) -> Result<(), BallError> {
        let (min, max) = (MIN_RADIUS_PX, MAX_RADIUS_PX);
        if !(min..=max).contains(&self.min_radius_px) {
            return Err(BallError::new("min_radius_px", self.min_radius_px, format!("{min} to {max}")));
        }
        if !(self.min_radius_px..=max).contains(&self.max_radius_px) {
            let range = format!("min_radius_px ({}) to {max}", self.min_radius_px);
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

/// The reason why a ball finder cannot be created.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum BallError {
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

impl Fatal for BallError {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Usage
    }
}

impl BallError {
    fn new(key: &'static str, value: impl ToString, range: String) -> Self {
        Self::Range { key, value: value.to_string(), range }
    }
}
