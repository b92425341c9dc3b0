//! The background of the ball: ground, lamp, lens, and the occluding half-plane.

use super::flat::{Backdrop, Flat};
use super::scenario::{MotionSetup, Scenario};
use super::trajectory::surface_tangent;
use crate::numeric::normal_cdf;
use crate::numeric::{Stream, key};
use crate::synth::render::Rod;
use crate::synth::render::smooth_noise;
use crate::synth::render::total_sigma_px;
use crate::synth::render::{DiscOutline, EDGE_SIGMA, HalfPlane, Patch};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// The purposes of the random streams.
const GROUND: u64 = 2;
const OCCLUDER: u64 = 3;

/// Everything but the ball.
#[derive(Debug, Clone)]
pub(crate) struct Background {
    width: usize,
    sigma_px: f64,
    /// The illumination of the room, row-major.
    room: Vec<f32>,
    /// The light from behind the ball, DN, row-major.
    ground_dn: Vec<f32>,
    /// The ground and a static occluder without the ball, DN, row-major.
    still_dn: Vec<f32>,
    occluder: Option<OccludingEdge>,
    flat: Option<Flat>,
    /// The relative amplitude of the lamp's flicker, and its frequency.
    flicker: f64,
    flicker_hz: f64,
}

/// The moving objects in one exposure.
pub(crate) struct ExposedObjects<'a> {
    /// The occluder at each moment.
    pub(crate) occluders: &'a [Option<HalfPlane>],
    /// The bodies, from the back to the front.
    pub(crate) patches: &'a [Patch],
    /// The outlines of the balls in the middle of the exposure.
    pub(crate) balls: &'a [DiscOutline],
}

/// The half-plane in front of the ball.
#[derive(Debug, Clone, Copy)]
struct OccludingEdge {
    start: HalfPlane,
    speed_px_s: f64,
    shade_dn: f32,
}

impl Background {
    /// Renders the static parts of a scenario. `full_dn` is the maximum grey level, DN.
    pub(crate) fn new(scenario: &Scenario, full_dn: f32) -> Self {
        let room = room_illumination(scenario);
        let mut ground_dn = render_ground(scenario, full_dn, &room);
        let occluder = occluder_edge(scenario).zip(scenario.occluder.as_ref()).map(|(start, setup)| OccludingEdge {
            start,
            speed_px_s: setup.speed_px_frame * scenario.camera.frame_rate_hz,
            shade_dn: full_dn * setup.shade as f32,
        });
        let at_rest = occluder.filter(|occluder| !occluder.is_moving());
        let edge = at_rest.map(|occluder| occluder.start);
        if let (Some(edge), Some(setup)) = (edge, scenario.occluder.as_ref().filter(|setup| setup.behind_px > 0.0)) {
            let [x, y] = edge.point_px;
            let point_px = [x + setup.behind_px * edge.normal[0], y + setup.behind_px * edge.normal[1]];
            ground_dn = render_static(scenario, full_dn, &room, &ground_dn, Some(HalfPlane { point_px, ..edge }));
        }
        let still_dn = render_static(scenario, full_dn, &room, &ground_dn, edge);
        Self {
            width: scenario.camera.width_px as usize,
            sigma_px: total_sigma_px(scenario.camera.blur_px),
            room,
            ground_dn,
            still_dn,
            occluder,
            flat: edge.and_then(|edge| Flat::new(scenario, edge)),
            flicker: scenario.light.flicker,
            flicker_hz: scenario.light.flicker_hz,
        }
    }

    /// The number of pixels of the image.
    pub(crate) fn pixel_count(&self) -> usize {
        self.room.len()
    }

    /// Returns the occluder at `time_s` after the first frame's stamp; `None` without one.
    pub(crate) fn occluder_at(&self, time_s: f64) -> Option<HalfPlane> {
        self.occluder.map(|occluder| {
            let shift_px = occluder.speed_px_s * time_s;
            let HalfPlane { point_px, normal } = occluder.start;
            HalfPlane { point_px: [point_px[0] + shift_px * normal[0], point_px[1] + shift_px * normal[1]], normal }
        })
    }

    /// Returns the speed of the occluder's edge along its outward normal, px/s; 0 without an occluder.
    pub(crate) fn occluder_px_s(&self) -> f64 {
        self.occluder.map_or(0.0, |occluder| occluder.speed_px_s)
    }

    /// Returns the mean brightness of the flickering lamp over an exposure, relative to its mean over time.
    ///
    /// The amplitude of the flicker falls with sin(x) / x, x half its phase advance during the exposure.
    pub(crate) fn lamp_brightness(&self, start_s: f64, exposure_s: f64) -> f32 {
        let half_turn = PI * self.flicker_hz * exposure_s;
        let smear = if half_turn > 1e-9 { half_turn.sin() / half_turn } else { 1.0 };
        (1.0 + self.flicker * smear * (TAU * self.flicker_hz * (start_s + 0.5 * exposure_s)).sin()) as f32
    }

    /// Renders one row of the image into `light`, DN: static parts, a moving occluder, the bodies and their shadows
    /// and mirror images. The flicker of the lamp is not included.
    pub(crate) fn render_row(&self, exposed: &ExposedObjects<'_>, row: usize, light: &mut [f32]) {
        let start = row * self.width;
        light.copy_from_slice(&self.still_dn[start..start + self.width]);
        if let Some(occluder) = self.occluder.filter(OccludingEdge::is_moving) {
            self.add_occluder(&occluder, exposed.occluders, row, light);
        }
        let shadows = self.shadow_factors(exposed.balls, row);
        light.iter_mut().zip(&shadows).for_each(|(light, factor)| *light *= factor);
        for patch in exposed.patches {
            if row < patch.top || row >= patch.top + patch.height {
                continue;
            }
            let cells = (row - patch.top) * patch.width..(row - patch.top + 1) * patch.width;
            let place = start + patch.left..start + patch.left + patch.width;
            let ball = patch.coverage[cells.clone()].iter().zip(&patch.light_dn[cells.clone()]);
            let still = self.room[place.clone()].iter().zip(&self.ground_dn[place.clone()]);
            for ((light, (coverage, light_dn)), (room, ground_dn)) in
                light[patch.left..patch.left + patch.width].iter_mut().zip(ball).zip(still)
            {
                *light += light_dn * room - coverage * ground_dn;
            }
            // The darkened ground is covered, not the lit one.
            let lost = shadows.iter().skip(patch.left).zip(&patch.coverage[cells]).zip(&self.ground_dn[place]);
            for (light, ((factor, coverage), ground_dn)) in light.iter_mut().skip(patch.left).zip(lost) {
                *light += coverage * ground_dn * (1.0 - factor);
            }
        }
        if let Some(flat) = &self.flat {
            let backdrop = Backdrop { width: self.width, room: &self.room, ground_dn: &self.ground_dn };
            flat.add_mirrored(exposed.patches, &backdrop, row, light);
        }
    }

    /// Returns the fraction of light that the shadows of the balls leave on each pixel of a row, 0 to 1.
    ///
    /// Empty without a flat that shows shadows.
    fn shadow_factors(&self, balls: &[DiscOutline], row: usize) -> Vec<f32> {
        let Some(flat) = &self.flat else { return Vec::new() };
        (0..self.width).map(|column| flat.unshadowed_fraction(balls, column as f64, row as f64)).collect()
    }

    /// Blends a moving occluder over a row of light, DN: the mean over the moments of the exposure.
    fn add_occluder(&self, occluder: &OccludingEdge, moments: &[Option<HalfPlane>], row: usize, light: &mut [f32]) {
        let weight = 1.0 / moments.len() as f32;
        for (column, light) in light.iter_mut().enumerate() {
            let covered: f32 = moments
                .iter()
                .flatten()
                .map(|plane| {
                    let outside = plane.distance_px(column as f64, row as f64) / self.sigma_px;
                    match outside {
                        _ if outside > EDGE_SIGMA => 0.0,
                        _ if outside < -EDGE_SIGMA => 1.0,
                        _ => normal_cdf(-outside) as f32,
                    }
                })
                .sum();
            *light += weight * covered * (occluder.shade_dn * self.room[row * self.width + column] - *light);
        }
    }
}

impl OccludingEdge {
    fn is_moving(&self) -> bool {
        self.speed_px_s.abs() > 0.0
    }
}

/// Returns the edge of the occluder at the first stamp; `None` without an occluder.
///
/// The edge passes through the given point, or through the point of first contact. Without either it is `None` as well.
fn occluder_edge(scenario: &Scenario) -> Option<HalfPlane> {
    let occluder = scenario.occluder.as_ref()?;
    let angle_rad = occluder.normal_deg.map_or(scenario.surface.angle_deg.to_radians() + FRAC_PI_2, f64::to_radians);
    let normal = [angle_rad.cos(), -angle_rad.sin()];
    let contact_point = |center_px: [f64; 2]| {
        // The body touches at the point opposite to the surface's normal.
        let tangent = surface_tangent(scenario);
        let reach_px = scenario.body.rod.as_ref().map_or(scenario.radius_px(), Rod::mark_height_px);
        [center_px[0] + reach_px * tangent[1], center_px[1] + reach_px * tangent[0]]
    };
    let point_px = match (&occluder.point_px, &scenario.motion) {
        (Some(point_px), _) => *point_px,
        (None, MotionSetup::Impact(impact)) => contact_point(impact.contact_center_px),
        (None, MotionSetup::Constant { .. } | MotionSetup::Piecewise { .. }) => return None,
    };
    Some(HalfPlane { point_px, normal })
}

/// Computes the relative illumination at every pixel, row-major: a linear gradient times the vignetting of the lens.
fn room_illumination(scenario: &Scenario) -> Vec<f32> {
    let (width, height) = (scenario.camera.width_px, scenario.camera.height_px);
    let slope = [scenario.light.gradient_x / f64::from(width), scenario.light.gradient_y / f64::from(height)];
    let middle = [0.5 * f64::from(width - 1), 0.5 * f64::from(height - 1)];
    let vignette = scenario.light.vignette / (middle[0] * middle[0] + middle[1] * middle[1]);
    pixel_centers(width, height)
        .map(|(x, y)| {
            let (x, y) = (x - middle[0], y - middle[1]);
            ((1.0 + slope[0] * x + slope[1] * y) * (1.0 - vignette * (x * x + y * y))) as f32
        })
        .collect()
}

/// Renders the textured ground without any object, DN, row-major.
fn render_ground(scenario: &Scenario, full_dn: f32, room: &[f32]) -> Vec<f32> {
    let texture = random_texture(scenario, scenario.shade.ground_texture, [2.0, 2.0], GROUND);
    let shade = scenario.shade.ground as f32;
    room.iter().zip(texture).map(|(room, texture)| full_dn * room * (shade + texture).max(0.0)).collect()
}

/// Renders ground and static occluder, DN, row-major: the image without the ball.
fn render_static(
    scenario: &Scenario,
    full_dn: f32,
    room: &[f32],
    ground_dn: &[f32],
    occluder: Option<HalfPlane>,
) -> Vec<f32> {
    let (Some(plane), Some(setup)) = (occluder, &scenario.occluder) else { return ground_dn.to_vec() };
    let sigma_px = total_sigma_px(scenario.camera.blur_px);
    // A long grain, as that of wood.
    let texture = random_texture(scenario, setup.texture, [8.0, 1.2], OCCLUDER);
    pixel_centers(scenario.camera.width_px, scenario.camera.height_px)
        .zip(room.iter().zip(texture).zip(ground_dn))
        .map(|((x, y), ((room, texture), ground_dn))| {
            let uncovered = normal_cdf(plane.distance_px(x, y) / sigma_px) as f32;
            uncovered * ground_dn + (1.0 - uncovered) * full_dn * room * (setup.shade as f32 + texture).max(0.0)
        })
        .collect()
}

/// Returns a random texture of standard deviation `amplitude`, row-major, as a fraction of full scale.
///
/// `sigma_px` is the Gaussian smoothing along x and y; `purpose` selects the random stream.
fn random_texture(scenario: &Scenario, amplitude: f64, sigma_px: [f64; 2], purpose: u64) -> Vec<f32> {
    let (width, height) = (scenario.camera.width_px as usize, scenario.camera.height_px as usize);
    if amplitude <= 0.0 {
        return vec![0.0; width * height];
    }
    let values = smooth_noise(width, height, sigma_px, Stream::new(key(scenario.seed, purpose, 0)));
    values.into_iter().map(|value| value * amplitude as f32).collect()
}

/// Iterates over the positions (x, y) of the pixels, px, row by row.
fn pixel_centers(width: u32, height: u32) -> impl Iterator<Item = (f64, f64)> {
    (0..height).flat_map(move |y| (0..width).map(move |x| (f64::from(x), f64::from(y))))
}
