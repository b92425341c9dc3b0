//! Rendering of the ball over a static image.

use super::blurred_edge::{EdgedDisc, REACH_SIGMA, bivariate_cdf, total_sigma_px};
use super::body_light::BodyLight;
use super::fuzzy_rim::Rim;
use super::half_plane::HalfPlane;
use super::occluder::{Axes, DiscOutline, Occluder, chord_coverage, disc_chord, visible_chords};
use super::patch::{Canvas, Patch, splat};
use super::regular_paint::RegularPaint;
use super::speckle_pattern::{Line, Pattern, Speckle};
use super::speckled_sphere::SpeckledSphere;
use crate::numeric::{QuadratureNode, Stream, gauss_legendre, key, normal_cdf};
use crate::synth::scenario::Scenario;
use crate::synth::trajectory::Pose;
use std::ops::Range;

/// The purpose of the random stream of the felt.
const FELT: u64 = 7;
/// The distance beyond which a half-plane occludes a pixel fully or not at all, in standard deviations.
pub(crate) const EDGE_SIGMA: f64 = 4.5;

/// The positions of all moving objects at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Moment {
    pub(crate) pose: Pose,
    pub(crate) occluder: Option<HalfPlane>,
    /// Another ball in front of this one.
    pub(crate) front: Option<DiscOutline>,
}

impl Moment {
    /// Returns the occluders of the ball, the half-plane first, with positions relative to a corner.
    fn occluders(&self, corner_px: [f64; 2]) -> Vec<Occluder> {
        let occluders = self.occluder.map(Occluder::Edge).into_iter().chain(self.front.map(Occluder::Ball));
        occluders.map(|occluder| occluder.relative_to(corner_px)).collect()
    }
}

/// The surface that carries the speckles of a ball.
#[derive(Debug, Clone)]
pub(crate) enum Surface {
    /// Speckles and lines on a flat disc.
    Flat(Pattern),
    /// Speckles on a sphere.
    Sphere(SpeckledSphere),
    /// A regular pattern on either.
    Regular(RegularPaint),
}

/// The properties of the ball that do not change from frame to frame.
#[derive(Debug, Clone)]
pub(crate) struct Ball {
    radius_px: f64,
    sigma_px: f64,
    rim: Rim,
    surface: Surface,
    ball_dn: f32,
    /// The fraction of the ball's light that a speckle absorbs; negative if it is brighter.
    ink: f32,
    light: BodyLight,
    rule: [QuadratureNode; 16],
    /// For shapes with a corner inside.
    fine_rule: [QuadratureNode; 40],
}

impl Ball {
    /// Prepares the drawing of a ball with this surface. `full_dn` is the maximum grey level.
    pub(crate) fn new(scenario: &Scenario, surface: Surface, full_dn: f32) -> Self {
        let radius_px = scenario.radius_px();
        let sigma_px = total_sigma_px(scenario.camera.blur_px);
        let shade = &scenario.shade;
        Self {
            radius_px,
            sigma_px,
            rim: Rim::new(radius_px, sigma_px, scenario.body.fuzz_px, Stream::new(key(scenario.seed, FELT, 0))),
            surface,
            ball_dn: full_dn * shade.ball as f32,
            ink: if shade.ball > 0.0 { (1.0 - shade.speckle / shade.ball) as f32 } else { 0.0 },
            light: BodyLight::new(scenario, full_dn),
            rule: gauss_legendre(),
            fine_rule: gauss_legendre(),
        }
    }

    /// Returns the ball magnified by `zoom`. Speckles on a sphere keep their size.
    pub(crate) fn zoomed(&self, zoom: f64) -> Self {
        let radius_px = zoom * self.radius_px;
        let surface = match &self.surface {
            Surface::Flat(pattern) => Surface::Flat(pattern.zoomed(zoom, radius_px, self.sigma_px)),
            Surface::Sphere(sphere) => Surface::Sphere(sphere.clone()),
            Surface::Regular(paint) => Surface::Regular(paint.zoomed(zoom)),
        };
        Self { radius_px, rim: self.rim.zoomed(zoom), surface, light: self.light.zoomed(zoom), ..self.clone() }
    }

    /// Draws the mean over several moments of equal weight, within these rows of an image of this width.
    pub(crate) fn draw(&self, moments: &[Moment], width: usize, rows: Range<usize>) -> Patch {
        let mut patch = self.bounding_patch(moments, width, rows);
        let weight = 1.0 / moments.len() as f32;
        let mut ink = vec![0.0; patch.coverage.len()];
        for moment in moments {
            ink.fill(0.0);
            self.draw_pattern(moment, &mut Canvas { patch: &patch, ink: &mut ink });
            if self.rim.is_fuzzy() {
                self.fade_paint_at_rim(&moment.pose, &mut Canvas { patch: &patch, ink: &mut ink });
            }
            self.add_light(&moment.pose, &ink, weight, &mut patch);
            let occluders = moment.occluders([0.0; 2]);
            if !occluders.is_empty() {
                self.subtract_occluded(&moment.pose, &occluders, weight, &mut patch);
            }
        }
        patch
    }

    /// Returns the empty rectangle around the ball at all moments, within these rows of an image of this width.
    fn bounding_patch(&self, moments: &[Moment], width: usize, rows: Range<usize>) -> Patch {
        let reach = self.rim.reach_px();
        let span = |axis: usize, within: Range<usize>| {
            let low = moments.iter().map(|moment| moment.pose.center_px[axis]).fold(f64::INFINITY, f64::min) - reach;
            let high =
                moments.iter().map(|moment| moment.pose.center_px[axis]).fold(f64::NEG_INFINITY, f64::max) + reach;
            let first = (low.floor().max(0.0) as usize).clamp(within.start, within.end);
            let end = ((high.ceil() + 1.0).max(0.0) as usize).min(within.end);
            (first, end.saturating_sub(first))
        };
        let ((left, columns), (top, rows)) = (span(0, 0..width), span(1, rows));
        let size = columns * rows;
        Patch { left, top, width: columns, height: rows, coverage: vec![0.0; size], light_dn: vec![0.0; size] }
    }

    /// Adds the coverage of each pixel by the visible part of the pattern to the ink of the canvas.
    fn draw_pattern(&self, moment: &Moment, canvas: &mut Canvas<'_>) {
        let pose = &moment.pose;
        let corner = [canvas.patch.left as f64, canvas.patch.top as f64];
        let center = [pose.center_px[0] - corner[0], pose.center_px[1] - corner[1]];
        let occluders = moment.occluders(corner);
        let pattern = match &self.surface {
            Surface::Flat(pattern) => pattern,
            Surface::Sphere(sphere) => return sphere.draw(&pose.orientation, center, &occluders, canvas),
            Surface::Regular(paint) => return self.draw_regular(paint, moment, canvas),
        };
        let (sin, cos) = pose.angle_rad.sin_cos();
        // Counter-clockwise on the screen, with y down.
        let rotated = |[x, y]: [f64; 2]| [x * cos + y * sin, y * cos - x * sin];
        for speckle in &pattern.speckles {
            let [x, y] = rotated([speckle.x_px, speckle.y_px]);
            let placed =
                PlacedSpeckle { pattern, speckle, place_px: [center[0] + x, center[1] + y], center_px: center };
            self.draw_speckle(&placed, &occluders, canvas);
        }
        for line in &pattern.lines {
            let [x, y] = rotated(line.middle_px);
            let line = Line { middle_px: [center[0] + x, center[1] + y], along: rotated(line.along), ..*line };
            self.draw_line(&line, &occluders, canvas);
        }
    }

    /// Draws the visible part of a regular pattern into ink without any. An edge that cuts it is assumed to be
    /// perpendicular, so that coverages multiply.
    fn draw_regular(&self, paint: &RegularPaint, moment: &Moment, canvas: &mut Canvas<'_>) {
        let [x0, y0] = moment.pose.center_px;
        let occluders = moment.occluders([0.0; 2]);
        for (index, ink) in canvas.ink.iter_mut().enumerate() {
            let x = (canvas.patch.left + index % canvas.patch.width) as f64;
            let y = (canvas.patch.top + index / canvas.patch.width) as f64;
            let (dx, dy) = (x - x0, y - y0);
            // Felt fades all paint alike afterwards.
            let inside =
                if self.rim.is_fuzzy() { 1.0 } else { self.rim.coverage_at((dx * dx + dy * dy) as f32, || 0.0) };
            let uncovered =
                occluders.iter().map(|occluder| normal_cdf(occluder.distance_and_normal(x, y).0 / self.sigma_px));
            let uncovered = uncovered.product::<f64>();
            if inside > 0.0 && uncovered > 0.0 {
                *ink = inside * (uncovered * paint.coverage_at(&moment.pose, dx, dy)) as f32;
            }
        }
    }

    /// Multiplies the ink by the coverage of the rim, so that the paint ends with the felt that carries it.
    fn fade_paint_at_rim(&self, pose: &Pose, canvas: &mut Canvas<'_>) {
        for (index, ink) in canvas.ink.iter_mut().enumerate() {
            let dx = (canvas.patch.left + index % canvas.patch.width) as f64 - pose.center_px[0];
            let dy = (canvas.patch.top + index / canvas.patch.width) as f64 - pose.center_px[1];
            *ink *= self.rim.coverage_at((dx * dx + dy * dy) as f32, || (-dy).atan2(dx) - pose.angle_rad);
        }
    }

    /// Adds the visible part of one line. An edge that cuts it is assumed to be perpendicular, so that coverages
    /// multiply.
    fn draw_line(&self, line: &Line, occluders: &[Occluder], canvas: &mut Canvas<'_>) {
        let strip = |distance: f64, half: f64| {
            if distance.abs() < half - EDGE_SIGMA * self.sigma_px {
                return 1.0;
            }
            normal_cdf((half - distance) / self.sigma_px) - normal_cdf((-half - distance) / self.sigma_px)
        };
        let half_reach = line.half_width_px + REACH_SIGMA * self.sigma_px;
        let [x, y] = line.middle_px;
        splat(line.middle_px, line.half_length_px + half_reach, canvas, |dx, dy| {
            let (dx, dy) = (f64::from(dx), f64::from(dy));
            let across = dx * line.along[1] - dy * line.along[0];
            if across.abs() > half_reach {
                return 0.0;
            }
            let along = dx * line.along[0] + dy * line.along[1];
            let uncovered = occluders
                .iter()
                .map(|occluder| normal_cdf(occluder.distance_and_normal(x + dx, y + dy).0 / self.sigma_px));
            let uncovered = uncovered.product::<f64>();
            (strip(across, line.half_width_px) * strip(along, line.half_length_px) * uncovered) as f32
        });
    }

    /// Adds the visible part of one speckle. Positions are relative to the corner of the patch, px.
    fn draw_speckle(&self, placed: &PlacedSpeckle<'_>, occluders: &[Occluder], canvas: &mut Canvas<'_>) {
        let PlacedSpeckle { pattern, speckle, place_px, center_px } = *placed;
        let radius_px = pattern.radii_px[speckle.size];
        let outside_px = |occluder: &Occluder| occluder.distance_and_normal(place_px[0], place_px[1]).0;
        if occluders.iter().any(|occluder| outside_px(occluder) <= -radius_px) {
            return;
        }
        // A speckle that no edge reaches is fully visible, however close it is.
        let cuts: Vec<Occluder> =
            occluders.iter().filter(|occluder| outside_px(occluder) < radius_px).copied().collect();
        let to_center = [center_px[0] - place_px[0], center_px[1] - place_px[1]];
        let reach = radius_px + REACH_SIGMA * self.sigma_px;
        if let [Occluder::Edge(edge)] = &cuts[..] {
            let rotated =
                |[x, y]: [f64; 2]| [x * edge.normal[0] + y * edge.normal[1], x * edge.normal[1] - y * edge.normal[0]];
            let outside_px = edge.distance_px(place_px[0], place_px[1]);
            let disc = EdgedDisc {
                radius_px,
                edge_px: -outside_px,
                rim_center_px: rotated(to_center),
                rim_px: self.radius_px,
            };
            let rule = if speckle.crosses_rim { &self.fine_rule[..] } else { &self.rule };
            splat(place_px, reach, canvas, |dx, dy| {
                disc.coverage(rotated([f64::from(dx), f64::from(dy)]), self.sigma_px, rule) as f32
            });
        } else if !cuts.is_empty() {
            let axes = Axes::new(place_px, [1.0, 0.0]);
            let chords = visible_chords(radius_px, self.sigma_px, &axes, &cuts, |across| {
                let [left, right] = disc_chord(radius_px, across);
                let rim = disc_chord(self.radius_px, across - to_center[1]).map(|end| end + to_center[0]);
                Some(if speckle.crosses_rim { [left.max(rim[0]), right.min(rim[1])] } else { [left, right] })
            });
            splat(place_px, reach, canvas, |dx, dy| {
                chord_coverage(&chords, f64::from(dx), f64::from(dy), self.sigma_px) as f32
            });
        } else if let (true, Some(disc)) = (speckle.crosses_rim, &pattern.cut_discs[speckle.size]) {
            let distance = to_center[0].hypot(to_center[1]);
            let [ex, ey] = to_center.map(|part| (-part / distance) as f32);
            splat(place_px, disc.reach_px(), canvas, |dx, dy| disc.coverage_at(dx * ex + dy * ey, dy * ex - dx * ey));
        } else {
            let disc = &pattern.discs[speckle.size];
            splat(place_px, disc.reach_px(), canvas, |dx, dy| disc.coverage_at(dx * dx + dy * dy));
        }
    }

    /// Adds coverage and light of the unoccluded ball to the patch, both multiplied by `weight`.
    fn add_light(&self, pose: &Pose, ink: &[f32], weight: f32, patch: &mut Patch) {
        let [x0, y0] = [patch.left as f64 - pose.center_px[0], patch.top as f64 - pose.center_px[1]];
        let width = patch.width;
        for row in 0..patch.height {
            let dy = (y0 + row as f64) as f32;
            let cells = row * width..(row + 1) * width;
            let target = patch.coverage[cells.clone()].iter_mut().zip(&mut patch.light_dn[cells.clone()]);
            for (column, ((coverage, light_dn), ink)) in target.zip(&ink[cells]).enumerate() {
                let dx = x0 as f32 + column as f32;
                let ball =
                    self.rim.coverage_at(dx * dx + dy * dy, || f64::from(-dy).atan2(f64::from(dx)) - pose.angle_rad);
                *coverage += weight * ball;
                *light_dn += weight * self.ball_dn * (ball - self.ink * ink) * self.light.diffuse_at(dx, dy);
                *light_dn += weight * ball * self.light.gloss_dn(dx, dy);
            }
        }
    }

    /// Subtracts the occluded part of the plain ball from coverage and light of the patch.
    fn subtract_occluded(&self, pose: &Pose, occluders: &[Occluder], weight: f32, patch: &mut Patch) {
        let edge_px = EDGE_SIGMA * self.sigma_px;
        let axes = Axes::new(pose.center_px, [1.0, 0.0]);
        // The intersection of a straight edge and a rim is determined by their angle.
        let is_straight = matches!(occluders, [Occluder::Edge(_)]);
        let ends = |across: f64| Some(disc_chord(self.radius_px, across));
        let chords = if is_straight {
            Vec::new()
        } else {
            visible_chords(self.radius_px, self.sigma_px, &axes, occluders, ends)
        };
        for index in 0..patch.coverage.len() {
            let (x, y) = ((patch.left + index % patch.width) as f64, (patch.top + index / patch.width) as f64);
            let (dx, dy) = (x - pose.center_px[0], y - pose.center_px[1]);
            let mut near = occluders.iter().filter(|occluder| occluder.distance_and_normal(x, y).0 <= edge_px);
            let Some(occluder) = near.next() else { continue };
            let ball = self.rim.coverage_at((dx * dx + dy * dy) as f32, || (-dy).atan2(dx) - pose.angle_rad);
            if ball <= 0.0 {
                continue;
            }
            let (outside_px, normal) = occluder.distance_and_normal(x, y);
            let is_corner = near.next().is_some() || self.radius_px - dx.hypot(dy) < edge_px + 1.0;
            let visible = match () {
                () if occluders.iter().any(|occluder| occluder.distance_and_normal(x, y).0 < -edge_px) => 0.0,
                () if self.rim.is_fuzzy() => {
                    let uncovered =
                        occluders.iter().map(|other| normal_cdf(other.distance_and_normal(x, y).0 / self.sigma_px));
                    f64::from(ball) * uncovered.product::<f64>()
                }
                () if is_corner && !is_straight => {
                    chord_coverage(&chords, dx, dy, self.sigma_px).clamp(0.0, f64::from(ball))
                }
                () => self.visible_coverage_at_edge(
                    dx,
                    dy,
                    outside_px + occluder.curvature_shift_px(self.sigma_px),
                    normal,
                ),
            };
            let occluded = weight * (ball - visible as f32);
            patch.coverage[index] -= occluded;
            let (dx, dy) = (dx as f32, dy as f32);
            patch.light_dn[index] -= occluded * self.ball_dn * self.light.diffuse_at(dx, dy);
            patch.light_dn[index] -= occluded * self.light.gloss_dn(dx, dy);
        }
    }

    /// Returns the coverage by the ball near an occluding edge, 0 to 1: the blurred overlap of disc and uncovered
    /// half-plane.
    ///
    /// `dx` and `dy` are from the centre of the ball, px. `outside_px` is the distance from the edge along its
    /// outward `normal`.
    fn visible_coverage_at_edge(&self, dx: f64, dy: f64, outside_px: f64, normal: [f64; 2]) -> f64 {
        let uncovered = outside_px / self.sigma_px;
        let distance = dx.hypot(dy).max(1e-9);
        // The correction for the curvature of the rim.
        let inside = (self.radius_px - distance) / self.sigma_px - 0.5 * self.sigma_px / self.radius_px;
        if inside > EDGE_SIGMA {
            return normal_cdf(uncovered);
        }
        let cosine = -(dx * normal[0] + dy * normal[1]) / distance;
        bivariate_cdf(inside, uncovered, cosine, &self.rule)
    }
}

/// A speckle of a pattern, with its position and that of the ball's centre from the patch's corner, px.
struct PlacedSpeckle<'a> {
    pattern: &'a Pattern,
    speckle: &'a Speckle,
    place_px: [f64; 2],
    center_px: [f64; 2],
}
