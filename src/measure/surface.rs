//! The surface of a ball: marks that turn with it, or light only.

use super::ring_rotation::RingCorrelator;
use crate::dic::{BallDisc, PreparedFrame, has_texture, min_ring_contrast_dn};
use crate::results::{Circle, PointStatus};

/// The surface of a ball.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Surface {
    /// Marks turn with the ball.
    Textured,
    /// Marks turn with the ball, but look the same again after a rotation that may pass between two frames.
    Repeating,
    /// Marks were matched where the outline is not.
    Misleading,
    /// Nothing but light: shading, highlights, reflections.
    Plain,
}

impl Surface {
    /// Classifies the surface of a ball in a prepared frame.
    pub(super) fn classify(prepared: &PreparedFrame, circle: &Circle, ring: &mut RingCorrelator) -> Self {
        let Circle { x_px, y_px, radius_px, .. } = *circle;
        let disc = BallDisc { x_px, y_px, radius_px };
        if !has_texture(prepared, disc) {
            return Self::Plain;
        }
        let (pattern, min_dn) = (ring.examine(prepared, circle), min_ring_contrast_dn(prepared, disc));
        match pattern.zip(min_dn) {
            Some((pattern, min_dn)) if pattern.contrast_dn < min_dn => Self::Plain,
            Some((pattern, _)) if pattern.is_repeating => Self::Repeating,
            _ => Self::Textured,
        }
    }

    /// Whether a surface is not known yet. Marks may come into view later in its block.
    pub(super) fn is_open(surface: Option<Self>) -> bool {
        matches!(surface, None | Some(Self::Plain))
    }

    /// Returns the reason why the rotation of a ball is not measured; `None` if its marks show it.
    pub(super) fn rotation_status(self) -> Option<PointStatus> {
        match self {
            Self::Textured => None,
            Self::Repeating | Self::Misleading => Some(PointStatus::Ambiguous),
            Self::Plain => Some(PointStatus::LowContrast),
        }
    }
}
