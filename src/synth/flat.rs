//! The light on the struck flat: the shadows of the balls, and their image where the flat is glossy.

use super::scenario::Scenario;
use crate::numeric::normal_cdf;
use crate::synth::render::{DiscOutline, HalfPlane, Patch, total_sigma_px};

/// The sine of the angle at which the camera looks down on the flat, which foreshortens its depth.
const FORESHORTENING: f64 = 0.25;
/// The angular radius of the lamp, rad, which softens the edge of a shadow.
const LAMP_RAD: f64 = 0.04;

/// The part of the image that shows the flat.
#[derive(Debug, Clone)]
pub(crate) struct Flat {
    edge: HalfPlane,
    behind_px: f64,
    sigma_px: f64,
    shadow: f64,
    /// The share of the light that comes from the lamp, and the direction to it along the tangent, along the normal and
    /// towards the camera.
    lamp: f64,
    to_lamp: [f64; 3],
    mirror: f32,
}

impl Flat {
    /// Prepares the flat of a scenario; `None` if nothing on it changes with the balls.
    pub(crate) fn new(scenario: &Scenario, edge: HalfPlane) -> Option<Self> {
        let setup = scenario.occluder.as_ref().filter(|setup| setup.shadow > 0.0 || setup.mirror > 0.0)?;
        let [x, y, z] = scenario.light.lamp_direction();
        let normal = [edge.normal[0], -edge.normal[1]];
        Some(Self {
            edge,
            behind_px: setup.behind_px,
            sigma_px: total_sigma_px(scenario.camera.blur_px),
            shadow: setup.shadow,
            lamp: scenario.light.lamp,
            to_lamp: [x * normal[1] - y * normal[0], x * normal[0] + y * normal[1], z],
            mirror: setup.mirror as f32,
        })
    }

    /// Returns the fraction of light that the balls leave on a pixel of the flat, 0 to 1; 1 where the flat is not
    /// visible.
    pub(crate) fn unshadowed_fraction(&self, balls: &[DiscOutline], x: f64, y: f64) -> f32 {
        let outside_px = self.edge.distance_px(x, y);
        let shown = normal_cdf((self.behind_px - outside_px) / self.sigma_px);
        if self.shadow <= 0.0 || shown <= 0.0 {
            return 1.0;
        }
        balls
            .iter()
            .map(|ball| (1.0 - shown * self.shadow * self.blocked_fraction(ball, [x, y], outside_px)) as f32)
            .product()
    }

    /// Returns the fraction of the light on a point of the flat that a ball blocks, 0 to 1.
    ///
    /// Ambient light loses the form factor of a sphere, R^2 h / d^3, with h the height of its centre over the flat
    /// and d its distance. The light of the lamp loses the cast shadow. `outside_px` is the distance of the point
    /// beyond the edge, px.
    fn blocked_fraction(&self, ball: &DiscOutline, at_px: [f64; 2], outside_px: f64) -> f64 {
        let tangent = [-self.edge.normal[1], self.edge.normal[0]];
        let [dx, dy] = [ball.center_px[0] - at_px[0], ball.center_px[1] - at_px[1]];
        let height = self.edge.distance_px(ball.center_px[0], ball.center_px[1]);
        // A point that appears above the line of contact lies behind it.
        let to_ball = [dx * tangent[0] + dy * tangent[1], height.max(0.0), outside_px / FORESHORTENING];
        let distance2: f64 = to_ball.iter().map(|part| part * part).sum();
        let sphere = (ball.radius_px * ball.radius_px * to_ball[1] / distance2.powf(1.5)).min(1.0);
        let towards: f64 = to_ball.iter().zip(self.to_lamp).map(|(part, lamp)| part * lamp).sum();
        let is_lit = self.to_lamp[1] > 0.0;
        let cast = if is_lit && towards > 0.0 {
            let away_px = (distance2 - towards * towards).max(0.0).sqrt();
            let soft_px = (LAMP_RAD * towards).max(self.sigma_px / FORESHORTENING);
            normal_cdf((ball.radius_px - away_px) / soft_px)
        } else {
            0.0
        };
        self.lamp * cast + (1.0 - self.lamp) * sphere
    }

    /// Adds the mirror image of the bodies in a glossy flat to a row of light, DN.
    pub(crate) fn add_mirrored(&self, patches: &[Patch], backdrop: &Backdrop<'_>, row: usize, light: &mut [f32]) {
        if self.mirror <= 0.0 {
            return;
        }
        for (column, light) in light.iter_mut().enumerate() {
            let (x, y) = (column as f64, row as f64);
            let outside_px = self.edge.distance_px(x, y);
            let front = normal_cdf(-outside_px / self.sigma_px) as f32;
            if front <= 0.0 {
                continue;
            }
            let [nx, ny] = self.edge.normal;
            let [mirror_x, mirror_y] = [x - 2.0 * outside_px * nx, y - 2.0 * outside_px * ny];
            let (room, ground_dn) = backdrop.nearest(mirror_x, mirror_y);
            for patch in patches {
                let (coverage, light_dn) = patch.interpolate(mirror_x, mirror_y);
                *light += self.mirror * front * (light_dn * room - coverage * ground_dn);
            }
        }
    }
}

/// The image without the bodies, row-major: the illumination of the room, and the light from behind the bodies, DN.
pub(crate) struct Backdrop<'a> {
    pub(crate) width: usize,
    pub(crate) room: &'a [f32],
    pub(crate) ground_dn: &'a [f32],
}

impl Backdrop<'_> {
    /// Returns relative illumination and light (DN) at the pixel of the image nearest to a position, px.
    fn nearest(&self, x: f64, y: f64) -> (f32, f32) {
        let height = self.room.len() / self.width;
        let nearest = |place: f64, count: usize| (place.round().max(0.0) as usize).min(count - 1);
        let index = nearest(y, height) * self.width + nearest(x, self.width);
        (self.room[index], self.ground_dn[index])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::{OccluderSetup, SimulatedFilm};

    /// A plain bright ball of 20 px radius whose lowest point is `gap_px` above a level flat at y = 120 px.
    fn film(gap_px: f64, edit: impl Fn(&mut Scenario)) -> SimulatedFilm {
        let mut scenario = Scenario::translation(0.0, 0.0, 0.0);
        (scenario.camera.width_px, scenario.camera.height_px, scenario.camera.frames) = (160, 160, 1);
        (scenario.body.diameter_mm, scenario.body.pattern.coverage) = (20.0, 0.0);
        scenario.motion = crate::synth::MotionSetup::Constant {
            vx_px_frame: 0.0,
            vy_px_frame: 0.0,
            omega_deg_frame: 0.0,
            start_px: [80.0, 100.0 - gap_px],
        };
        let (point_px, normal_deg) = (Some([80.0, 120.0]), Some(90.0));
        scenario.occluder = Some(OccluderSetup { shade: 0.6, point_px, normal_deg, ..OccluderSetup::default() });
        edit(&mut scenario);
        SimulatedFilm::new(&scenario).unwrap()
    }

    fn level(film: &SimulatedFilm, x: usize, y: usize) -> f32 {
        film.render_light(0).view().at(x, y).unwrap()
    }

    fn flat(scenario: &mut Scenario) -> &mut OccluderSetup {
        scenario.occluder.as_mut().unwrap()
    }

    #[test]
    fn light_from_all_sides_is_blocked_around_the_contact_and_less_the_higher_the_ball() {
        let dark = |gap_px: f64| {
            let film = film(gap_px, |scenario| flat(scenario).shadow = 1.0);
            level(&film, 80, 124) / (0.6 * 255.0)
        };
        let form_factor = |height: f64| 400.0 * height / (height * height + 256.0_f64).powf(1.5);
        for gap_px in [0.0, 12.0, 40.0] {
            let expected = 1.0 - form_factor(20.0 + gap_px);
            assert!((f64::from(dark(gap_px)) - expected).abs() < 2e-3, "{gap_px}: {} {expected}", dark(gap_px));
        }
    }

    #[test]
    fn a_lamp_on_the_left_casts_the_shadow_to_the_right() {
        let film = film(20.0, |scenario| {
            (scenario.light.lamp, scenario.light.side_angle_deg, scenario.light.lamp_elevation_deg) = (1.0, 135.0, 0.0);
            flat(scenario).shadow = 0.8;
        });
        // From a height of 40 px the shadow at 45 deg falls 40 px aside.
        let [lit, dark] = [60, 120].map(|x| level(&film, x, 123) / (0.6 * 255.0));
        assert!((lit - 1.0).abs() < 1e-3 && (dark - 0.2).abs() < 1e-2, "{lit} {dark}");
    }

    #[test]
    fn a_glossy_flat_shows_the_ball_upside_down() {
        let film = film(6.0, |scenario| flat(scenario).mirror = 0.3);
        let ball_dn = level(&film, 80, 94);
        let ground_dn = level(&film, 10, 10);
        let mirrored = level(&film, 80, 146);
        assert!((mirrored - 0.6 * 255.0 - 0.3 * (ball_dn - ground_dn)).abs() < 0.1, "{mirrored}");
        // The gap appears twice.
        assert!((level(&film, 80, 123) - 0.6 * 255.0).abs() < 0.5);
    }

    #[test]
    fn the_flat_is_seen_behind_the_ball_as_far_as_given() {
        let film = film(2.0, |scenario| flat(scenario).behind_px = 8.0);
        let [above, behind, front] = [109, 115, 130].map(|y| level(&film, 20, y));
        assert!((behind - front).abs() < 0.1 && (above - level(&film, 20, 20)).abs() < 0.5, "{above} {behind} {front}");
        // The ball is in front of it.
        assert!((level(&film, 80, 115) - level(&film, 80, 98)).abs() < 0.1);
    }
}
