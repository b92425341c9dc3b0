//! The background of the ball: ground, lamp, lens, and the occluding half-plane.

use super::flat::{Behind, Flat};
use super::scenario::{MotionSetup, Scenario};
use super::trajectory::tangent;
use crate::numeric::normal_cdf;
use crate::numeric::{Stream, key};
use crate::synth::render::Rod;
use crate::synth::render::smooth;
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
pub(crate) struct Exposed<'a> {
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
    pub(crate) fn new(scenario: &Scenario, full_dn: f32) -> Self {
        let room = room(scenario);
        let mut ground_dn = ground(scenario, full_dn, &room);
        let occluder = half_plane(scenario).zip(scenario.occluder.as_ref()).map(|(start, setup)| OccludingEdge {
            start,
            speed_px_s: setup.speed_px_frame * scenario.camera.frame_rate_hz,
            shade_dn: full_dn * setup.shade as f32,
        });
        let at_rest = occluder.filter(|occluder| !occluder.moves());
        let edge = at_rest.map(|occluder| occluder.start);
        if let (Some(edge), Some(setup)) = (edge, scenario.occluder.as_ref().filter(|setup| setup.behind_px > 0.0)) {
            let [x, y] = edge.point_px;
            let point_px = [x + setup.behind_px * edge.normal[0], y + setup.behind_px * edge.normal[1]];
            ground_dn = still(scenario, full_dn, &room, &ground_dn, Some(HalfPlane { point_px, ..edge }));
        }
        let still_dn = still(scenario, full_dn, &room, &ground_dn, edge);
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
    pub(crate) fn pixels(&self) -> usize {
        self.room.len()
    }

    /// Returns the occluder at a time after the first frame's stamp.
    pub(crate) fn occluder_at(&self, time_s: f64) -> Option<HalfPlane> {
        self.occluder.map(|occluder| {
            let shift_px = occluder.speed_px_s * time_s;
            let HalfPlane { point_px, normal } = occluder.start;
            HalfPlane { point_px: [point_px[0] + shift_px * normal[0], point_px[1] + shift_px * normal[1]], normal }
        })
    }

    /// Returns the speed of the occluder's edge, px/s.
    pub(crate) fn occluder_px_s(&self) -> f64 {
        self.occluder.map_or(0.0, |occluder| occluder.speed_px_s)
    }

    /// Returns the mean brightness of the lamp over an exposure.
    pub(crate) fn lamp(&self, start_s: f64, exposure_s: f64) -> f32 {
        let half_turn = PI * self.flicker_hz * exposure_s;
        let smear = if half_turn > 1e-9 { half_turn.sin() / half_turn } else { 1.0 };
        (1.0 + self.flicker * smear * (TAU * self.flicker_hz * (start_s + 0.5 * exposure_s)).sin()) as f32
    }

    /// Renders one row of the image: static parts, a moving occluder and the balls, DN.
    pub(crate) fn row(&self, exposed: &Exposed<'_>, row: usize, light: &mut [f32]) {
        let start = row * self.width;
        light.copy_from_slice(&self.still_dn[start..start + self.width]);
        if let Some(occluder) = self.occluder.filter(OccludingEdge::moves) {
            self.add_occluder(&occluder, exposed.occluders, row, light);
        }
        let shadows = self.shadows(exposed.balls, row);
        light.iter_mut().zip(&shadows).for_each(|(light, left)| *light *= left);
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
            for (light, ((left, coverage), ground_dn)) in light.iter_mut().skip(patch.left).zip(lost) {
                *light += coverage * ground_dn * (1.0 - left);
            }
        }
        if let Some(flat) = &self.flat {
            let behind = Behind { width: self.width, room: &self.room, ground_dn: &self.ground_dn };
            flat.add_mirrored(exposed.patches, &behind, row, light);
        }
    }

    /// Returns the light that the balls leave on each pixel of a row; empty if there are no shadows.
    fn shadows(&self, balls: &[DiscOutline], row: usize) -> Vec<f32> {
        let Some(flat) = &self.flat else { return Vec::new() };
        (0..self.width).map(|column| flat.unshadowed(balls, column as f64, row as f64)).collect()
    }

    /// Adds a moving occluder: the mean over the moments of the exposure.
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
    fn moves(&self) -> bool {
        self.speed_px_s.abs() > 0.0
    }
}

/// Returns the edge of the occluder in the image.
fn half_plane(scenario: &Scenario) -> Option<HalfPlane> {
    let occluder = scenario.occluder.as_ref()?;
    let angle_rad = occluder.normal_deg.map_or(scenario.surface.angle_deg.to_radians() + FRAC_PI_2, f64::to_radians);
    let normal = [angle_rad.cos(), -angle_rad.sin()];
    let touch = |center_px: [f64; 2]| {
        // The body touches at the point opposite to the surface's normal.
        let tangent = tangent(scenario);
        let reach_px = scenario.body.rod.as_ref().map_or(scenario.radius_px(), Rod::mark_px);
        [center_px[0] + reach_px * tangent[1], center_px[1] + reach_px * tangent[0]]
    };
    let point_px = match (&occluder.point_px, &scenario.motion) {
        (Some(point_px), _) => *point_px,
        (None, MotionSetup::Impact(impact)) => touch(impact.contact_center_px),
        (None, MotionSetup::Constant { .. } | MotionSetup::Piecewise { .. }) => return None,
    };
    Some(HalfPlane { point_px, normal })
}

/// Computes the illumination of the room at every pixel.
fn room(scenario: &Scenario) -> Vec<f32> {
    let (width, height) = (scenario.camera.width_px, scenario.camera.height_px);
    let slope = [scenario.light.gradient_x / f64::from(width), scenario.light.gradient_y / f64::from(height)];
    let middle = [0.5 * f64::from(width - 1), 0.5 * f64::from(height - 1)];
    let darker = scenario.light.vignette / (middle[0] * middle[0] + middle[1] * middle[1]);
    pixels(width, height)
        .map(|(x, y)| {
            let (x, y) = (x - middle[0], y - middle[1]);
            ((1.0 + slope[0] * x + slope[1] * y) * (1.0 - darker * (x * x + y * y))) as f32
        })
        .collect()
}

fn ground(scenario: &Scenario, full_dn: f32, room: &[f32]) -> Vec<f32> {
    let rough = roughness(scenario, scenario.shade.ground_texture, [2.0, 2.0], GROUND);
    let shade = scenario.shade.ground as f32;
    room.iter().zip(rough).map(|(room, rough)| full_dn * room * (shade + rough).max(0.0)).collect()
}

/// Renders ground and occluder: the image without the ball.
fn still(scenario: &Scenario, full_dn: f32, room: &[f32], ground_dn: &[f32], occluder: Option<HalfPlane>) -> Vec<f32> {
    let (Some(plane), Some(setup)) = (occluder, &scenario.occluder) else { return ground_dn.to_vec() };
    let sigma_px = total_sigma_px(scenario.camera.blur_px);
    // A long grain, as that of wood.
    let rough = roughness(scenario, setup.texture, [8.0, 1.2], OCCLUDER);
    pixels(scenario.camera.width_px, scenario.camera.height_px)
        .zip(room.iter().zip(rough).zip(ground_dn))
        .map(|((x, y), ((room, rough), ground_dn))| {
            let free = normal_cdf(plane.distance_px(x, y) / sigma_px) as f32;
            free * ground_dn + (1.0 - free) * full_dn * room * (setup.shade as f32 + rough).max(0.0)
        })
        .collect()
}

fn roughness(scenario: &Scenario, amplitude: f64, sigma_px: [f64; 2], purpose: u64) -> Vec<f32> {
    let (width, height) = (scenario.camera.width_px as usize, scenario.camera.height_px as usize);
    if amplitude <= 0.0 {
        return vec![0.0; width * height];
    }
    let values = smooth(width, height, sigma_px, Stream::new(key(scenario.seed, purpose, 0)));
    values.into_iter().map(|value| value * amplitude as f32).collect()
}

/// Iterates over the pixels, row by row.
fn pixels(width: u32, height: u32) -> impl Iterator<Item = (f64, f64)> {
    (0..height).flat_map(move |y| (0..width).map(move |x| (f64::from(x), f64::from(y))))
}
