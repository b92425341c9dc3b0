//! The light on a round body: fixed in the room, moving with the body without rotating.

use crate::synth::scenario::{LightSetup, Scenario};

/// The light on a ball, or on a rod.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BodyLight {
    /// The relative change per pixel along x and y.
    slope: [f32; 2],
    limb: f32,
    per_radius2: f32,
    lamp: Option<Lamp>,
}

/// A lamp, the light that the surface reflects, and the reflection of the lamp. Axes: x right, y up, z to the camera.
#[derive(Debug, Clone, Copy)]
struct Lamp {
    /// The share of the light that comes from the lamp.
    share: f32,
    direction: [f32; 3],
    /// The light from downward, relative to all other, and the direction that it comes from.
    bounce: f32,
    down: [f32; 2],
    peak_dn: f32,
    /// The direction of a surface that mirrors the lamp into the camera.
    mirror: [f32; 3],
    /// 1 over the square of the reflection's width, rad^-2.
    per_width2: f32,
}

impl BodyLight {
    /// Prepares the light on the body of a scenario. `full_dn` is the maximum grey level.
    pub(crate) fn new(scenario: &Scenario, full_dn: f32) -> Self {
        let (setup, radius_px) = (&scenario.light, scenario.radius_px());
        let (sin, cos) = setup.side_angle_deg.to_radians().sin_cos();
        let slope = setup.side / radius_px;
        Self {
            slope: [(slope * cos) as f32, (-slope * sin) as f32],
            limb: setup.limb as f32,
            per_radius2: (1.0 / (radius_px * radius_px)) as f32,
            lamp: setup.is_directed().then(|| Lamp::new(setup, scenario.surface.angle_deg, full_dn)),
        }
    }

    /// Returns the light on a body magnified by `zoom`.
    pub(crate) fn zoomed(&self, zoom: f64) -> Self {
        Self {
            slope: self.slope.map(|slope| slope / zoom as f32),
            per_radius2: self.per_radius2 / (zoom * zoom) as f32,
            ..*self
        }
    }

    /// Returns the diffuse light at a position from the centre (px, y down), relative to even light.
    #[inline]
    pub(crate) fn diffuse_at(&self, dx: f32, dy: f32) -> f32 {
        let depth = (1.0 - (dx * dx + dy * dy) * self.per_radius2).max(0.0).sqrt();
        let light = (1.0 + self.slope[0] * dx + self.slope[1] * dy) * (1.0 - self.limb * (1.0 - depth));
        self.lamp.as_ref().map_or(light, |lamp| light * lamp.diffuse_light(self.surface_normal(dx, dy)))
    }

    /// Returns the reflection of the lamp at a position from the centre (px, y down), DN.
    #[inline]
    pub(crate) fn gloss_dn(&self, dx: f32, dy: f32) -> f32 {
        self.lamp.as_ref().map_or(0.0, |lamp| lamp.gloss_dn(self.surface_normal(dx, dy)))
    }

    /// Returns the unit normal of the sphere (x right, y up, z to the camera) at a position from the centre (px, y
    /// down); beyond the rim, that of the rim.
    fn surface_normal(&self, dx: f32, dy: f32) -> [f32; 3] {
        let radius2 = (dx * dx + dy * dy) * self.per_radius2;
        let scale = (self.per_radius2 / radius2.max(1.0)).sqrt();
        [dx * scale, -dy * scale, (1.0 - radius2).max(0.0).sqrt()]
    }
}

impl Lamp {
    /// Prepares the lamp and the light from below.
    ///
    /// `surface_deg` is the tangent of the struck surface, counter-clockwise from x, `full_dn` the maximum grey level.
    fn new(setup: &LightSetup, surface_deg: f64, full_dn: f32) -> Self {
        let [x, y, z] = setup.lamp_direction();
        let (sin, cos) = surface_deg.to_radians().sin_cos();
        // Halfway between the lamp and the camera. J. F. Blinn, SIGGRAPH 1977, 10.1145/563858.563893.
        let length = (2.0 + 2.0 * z).sqrt();
        Self {
            share: setup.lamp as f32,
            direction: [x, y, z].map(|part| part as f32),
            bounce: setup.bounce as f32,
            down: [sin as f32, -cos as f32],
            peak_dn: full_dn * setup.highlight as f32,
            mirror: [x / length, y / length, (1.0 + z) / length].map(|part| part as f32),
            per_width2: setup.highlight_deg.to_radians().powi(-2) as f32,
        }
    }

    /// Returns the diffuse light on a surface with this normal, relative to even light.
    ///
    /// The light of the lamp follows Lambert's cosine law, the light from below the form factor (1 + cos) / 2.
    fn diffuse_light(&self, normal: [f32; 3]) -> f32 {
        let downward = normal[0] * self.down[0] + normal[1] * self.down[1];
        1.0 - self.share + self.share * dot(normal, self.direction).max(0.0) + self.bounce * 0.5 * (1.0 + downward)
    }

    /// Returns the reflection of the lamp by a surface with this normal, DN: a Gaussian over the tilt from the
    /// mirroring direction.
    fn gloss_dn(&self, normal: [f32; 3]) -> f32 {
        // For small angles the square of the angle; smooth everywhere.
        let tilt2 = 2.0 * (1.0 - dot(normal, self.mirror));
        self.peak_dn * (-0.5 * tilt2 * self.per_width2).exp()
    }
}

fn dot(left: [f32; 3], right: [f32; 3]) -> f32 {
    left[0] * right[0] + left[1] * right[1] + left[2] * right[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::Shape;

    fn lit(light: LightSetup) -> BodyLight {
        let mut scenario = Scenario::translation(0.0, 0.0, 0.0);
        (scenario.light, scenario.body.shape) = (light, Shape::Sphere);
        BodyLight::new(&scenario, 255.0)
    }

    /// The ball has a radius of 60 px.
    #[test]
    fn a_lamp_lights_by_the_cosine_and_leaves_the_other_side_to_the_rest_of_the_light() {
        let light = lit(LightSetup { lamp: 0.7, side_angle_deg: 90.0, lamp_elevation_deg: 30.0, ..Default::default() });
        let half = 0.5_f32;
        for (place, expected) in [
            // Towards the lamp, to the camera, away from it.
            ([0.0, -60.0 * half.sqrt() * 1.5_f32.sqrt()], 1.0),
            ([0.0, 0.0], 0.3 + 0.7 * half),
            ([0.0, 60.0], 0.3),
        ] {
            let found = light.diffuse_at(place[0], place[1]);
            assert!((found - expected).abs() < 1e-5, "{place:?}: {found}");
        }
        assert!(light.gloss_dn(0.0, -30.0).abs() < 1e-9);
    }

    #[test]
    fn light_from_the_surface_is_strongest_below() {
        let light = lit(LightSetup { bounce: 0.4, ..Default::default() });
        let [above, middle, downward] = [-60.0, 0.0, 60.0].map(|dy| light.diffuse_at(0.0, dy));
        assert!((above - 1.0).abs() < 1e-6 && (middle - 1.2).abs() < 1e-6 && (downward - 1.4).abs() < 1e-6);
    }

    #[test]
    fn the_reflection_of_the_lamp_lies_halfway_to_it_and_has_its_width() {
        let setup = LightSetup { highlight: 0.5, side_angle_deg: 0.0, lamp_elevation_deg: 0.0, ..Default::default() };
        let light = lit(LightSetup { highlight_deg: 4.0, ..setup });
        let at = |tilt_deg: f32| light.gloss_dn(60.0 * tilt_deg.to_radians().sin(), 0.0);
        assert!((at(45.0) - 127.5).abs() < 1e-3, "{}", at(45.0));
        let wide = 127.5 * (-0.5_f32).exp();
        assert!((at(41.0) - wide).abs() < 0.1 && (at(49.0) - wide).abs() < 0.1, "{} {}", at(41.0), at(49.0));
    }
}
