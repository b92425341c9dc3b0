//! Half-planes, which occlude the ball.

/// A half-plane in front of the ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct HalfPlane {
    /// A point of the edge, px.
    pub(crate) point_px: [f64; 2],
    /// The outward unit vector, image axes (y down).
    pub(crate) normal: [f64; 2],
}

impl HalfPlane {
    /// Returns the distance of a point outside the edge, negative inside, px.
    pub(crate) fn distance_px(&self, x_px: f64, y_px: f64) -> f64 {
        (x_px - self.point_px[0]) * self.normal[0] + (y_px - self.point_px[1]) * self.normal[1]
    }

    /// Returns the fraction of the area of a disc that the half-plane leaves visible, 0 to 1.
    pub(crate) fn visible_fraction(&self, center_px: [f64; 2], radius_px: f64) -> f64 {
        let part = (self.distance_px(center_px[0], center_px[1]) / radius_px).clamp(-1.0, 1.0);
        1.0 - (part.acos() - part * (1.0 - part * part).sqrt()) / std::f64::consts::PI
    }
}
