//! The grey levels and the lamp of a scenario.

use serde::{Deserialize, Serialize};

/// Grey levels as fractions of full scale, 0 to 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShadeSetup {
    /// The ball between its speckles.
    pub ball: f64,
    /// The speckles.
    pub speckle: f64,
    /// The background.
    pub ground: f64,
    /// Texture of the background, standard deviation as a fraction of full scale, 0 to 0.2.
    #[serde(default)]
    pub ground_texture: f64,
}

/// A lamp fixed in the room; fractions are 0 to 0.9 in size where no range is given.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LightSetup {
    /// Relative change of brightness from the left edge of the image to the right.
    pub gradient_x: f64,
    /// Relative change of brightness from the top edge of the image to the bottom.
    pub gradient_y: f64,
    /// Relative brightness of the ball's side towards the lamp; the other is darker. It moves with the ball without
    /// rotating.
    pub side: f64,
    /// Direction of the lamp, counter-clockwise from x, deg.
    pub side_angle_deg: f64,
    /// Elevation of the lamp from the image plane towards the camera, 0 to 90 deg; default 45. With 0 the lamp is beside
    /// the body, with 90 at the camera.
    pub lamp_elevation_deg: f64,
    /// Share of the light that comes from the lamp and falls on a round body by Lambert's cosine law, 0 to 1. The rest
    /// comes from all sides.
    pub lamp: f64,
    /// Light that the struck surface reflects onto the lower side of a ball, relative to all other light.
    pub bounce: f64,
    /// Light in the middle of the lamp's reflection on a glossy body, as a fraction of full scale, 0 to 10. It stays where
    /// the lamp is mirrored while the body turns.
    pub highlight: f64,
    /// Width of the reflection: the standard deviation over the tilt of the surface, 1 to 45 deg; default 5.
    pub highlight_deg: f64,
    /// Relative darkening of the ball's rim.
    pub limb: f64,
    /// Relative darkening of the image corners (lens).
    pub vignette: f64,
    /// Relative amplitude of the lamp's flicker.
    pub flicker: f64,
    /// Frequency of the flicker, 0 to 1 million Hz: 100 or 120 on the mains.
    pub flicker_hz: f64,
}

impl Default for ShadeSetup {
    fn default() -> Self {
        Self { ball: 0.75, speckle: 0.2, ground: 0.12, ground_texture: 0.0 }
    }
}

impl Default for LightSetup {
    fn default() -> Self {
        Self {
            gradient_x: 0.0,
            gradient_y: 0.0,
            side: 0.0,
            side_angle_deg: 0.0,
            lamp_elevation_deg: 45.0,
            lamp: 0.0,
            bounce: 0.0,
            highlight: 0.0,
            highlight_deg: 5.0,
            limb: 0.0,
            vignette: 0.0,
            flicker: 0.0,
            flicker_hz: 0.0,
        }
    }
}

impl LightSetup {
    /// Whether a part of the light depends on the direction of a round surface.
    pub(crate) fn is_directed(&self) -> bool {
        self.lamp > 0.0 || self.bounce > 0.0 || self.highlight > 0.0
    }

    /// Returns the unit vector towards the lamp: x right, y up, z towards the camera.
    pub(crate) fn lamp_direction(&self) -> [f64; 3] {
        let (sin, cos) = self.side_angle_deg.to_radians().sin_cos();
        let (up, flat) = self.lamp_elevation_deg.to_radians().sin_cos();
        [flat * cos, flat * sin, up]
    }
}
