//! The surface of a ball: marks that turn with it, or light only.

use crate::dic::{BallDisc, PreparedFrame, has_texture};
use crate::results::Circle;

/// The surface of a ball.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Surface {
    /// Marks turn with the ball.
    Textured,
    /// Nothing but light: shading, highlights, reflections.
    Plain,
}

impl Surface {
    /// Classifies the surface of a ball in a prepared frame.
    pub(super) fn classify(prepared: &PreparedFrame, circle: &Circle) -> Self {
        let Circle { x_px, y_px, radius_px, .. } = *circle;
        match has_texture(prepared, BallDisc { x_px, y_px, radius_px }) {
            true => Self::Textured,
            false => Self::Plain,
        }
    }
}
