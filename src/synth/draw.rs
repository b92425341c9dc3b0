//! Draws the ball into a picture that holds what stands still.

use super::blur::{BlurredDisc, EdgedDisc, REACH_SIGMA, bivariate_cdf, gauss_legendre, normal_cdf, seen_sigma_px};
use super::cover::{Axes, Cover, Round, disc_chord, share, visible_chords};
use super::motion::Pose;
use super::scenario::{LightSetup, Scenario};
use super::speckle::{Line, Pattern, Speckle};
use super::sphere::Globe;
use std::ops::Range;

/// Farther than this many standard deviations from its edge a half-plane is whole or nothing.
pub(crate) const EDGE_SIGMA: f64 = 4.5;

/// A half-plane in front of the ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct HalfPlane {
    /// A point of the edge, px.
    pub(crate) point_px: [f64; 2],
    /// Unit vector out of it, px axes (y down).
    pub(crate) normal: [f64; 2],
}

impl HalfPlane {
    /// Distance outside the edge, negative inside, px.
    pub(crate) fn distance_px(&self, x_px: f64, y_px: f64) -> f64 {
        (x_px - self.point_px[0]) * self.normal[0] + (y_px - self.point_px[1]) * self.normal[1]
    }

    /// Share of a disc that it leaves visible.
    pub(crate) fn visible_fraction(&self, center_px: [f64; 2], radius_px: f64) -> f64 {
        let part = (self.distance_px(center_px[0], center_px[1]) / radius_px).clamp(-1.0, 1.0);
        1.0 - (part.acos() - part * (1.0 - part * part).sqrt()) / std::f64::consts::PI
    }
}

/// Where everything that moves is at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Moment {
    pub(crate) pose: Pose,
    pub(crate) occluder: Option<HalfPlane>,
    /// Another ball in front of this one.
    pub(crate) front: Option<Round>,
}

impl Moment {
    /// What is in front of the ball, for places that count from a corner.
    fn covers(&self, corner_px: [f64; 2]) -> Vec<Cover> {
        let covers = self.occluder.map(Cover::Edge).into_iter().chain(self.front.map(Cover::Ball));
        covers.map(|cover| cover.seen_from(corner_px)).collect()
    }
}

/// What a ball carries.
#[derive(Debug, Clone)]
pub(crate) enum Coat {
    /// Speckles and lines on a flat disc.
    Flat(Pattern),
    /// Speckles on a sphere.
    Round(Globe),
}

/// Everything about the ball that does not change from frame to frame.
#[derive(Debug, Clone)]
pub(crate) struct Ball {
    radius_px: f64,
    sigma_px: f64,
    rim: BlurredDisc,
    coat: Coat,
    ball_dn: f32,
    /// Share of the ball's light that a speckle takes; negative when it is brighter.
    ink: f32,
    light: BallLight,
    rule: [(f64, f64); 16],
    /// For shapes with a corner inside.
    fine_rule: [(f64, f64); 40],
}

/// Light on the ball: fixed in the room, carried along, never turned.
#[derive(Debug, Clone, Copy)]
struct BallLight {
    /// Relative change a pixel along x and y.
    slope: [f32; 2],
    limb: f32,
    per_radius2: f32,
}

impl BallLight {
    fn new(setup: &LightSetup, radius_px: f64) -> Self {
        let (sin, cos) = setup.side_angle_deg.to_radians().sin_cos();
        let slope = setup.side / radius_px;
        Self {
            slope: [(slope * cos) as f32, (-slope * sin) as f32],
            limb: setup.limb as f32,
            per_radius2: (1.0 / (radius_px * radius_px)) as f32,
        }
    }

    #[inline]
    fn at(&self, dx: f32, dy: f32) -> f32 {
        let depth = (1.0 - (dx * dx + dy * dy) * self.per_radius2).max(0.0).sqrt();
        (1.0 + self.slope[0] * dx + self.slope[1] * dy) * (1.0 - self.limb * (1.0 - depth))
    }
}

/// What the ball adds to the still picture, on the rectangle around it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Patch {
    /// First column and row of the picture.
    pub(crate) left: usize,
    pub(crate) top: usize,
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Share of the pixel that shows the ball, row-major.
    pub(crate) share: Vec<f32>,
    /// Light from the ball before the room's, DN, row-major.
    pub(crate) light_dn: Vec<f32>,
}

impl Ball {
    pub(crate) fn new(scenario: &Scenario, coat: Coat, full_dn: f32) -> Self {
        let radius_px = scenario.radius_px();
        let sigma_px = seen_sigma_px(scenario.camera.blur_px);
        let shade = &scenario.shade;
        Self {
            radius_px,
            sigma_px,
            rim: BlurredDisc::new(radius_px, sigma_px),
            coat,
            ball_dn: full_dn * shade.ball as f32,
            ink: if shade.ball > 0.0 { (1.0 - shade.speckle / shade.ball) as f32 } else { 0.0 },
            light: BallLight::new(&scenario.light, radius_px),
            rule: gauss_legendre(),
            fine_rule: gauss_legendre(),
        }
    }

    /// The same in a picture of another scale; speckles on a sphere keep their size.
    pub(crate) fn zoomed(&self, zoom: f64) -> Self {
        let radius_px = zoom * self.radius_px;
        let coat = match &self.coat {
            Coat::Flat(pattern) => Coat::Flat(pattern.zoomed(zoom, radius_px, self.sigma_px)),
            Coat::Round(globe) => Coat::Round(globe.clone()),
        };
        let light = BallLight {
            slope: self.light.slope.map(|slope| slope / zoom as f32),
            per_radius2: self.light.per_radius2 / (zoom * zoom) as f32,
            ..self.light
        };
        Self { radius_px, rim: BlurredDisc::new(radius_px, self.sigma_px), coat, light, ..self.clone() }
    }

    /// Draws the mean over several moments of equal weight, as far as it lies in these rows of a picture so wide.
    pub(crate) fn draw(&self, moments: &[Moment], width: usize, rows: Range<usize>) -> Patch {
        let mut patch = self.frame(moments, width, rows);
        let weight = 1.0 / moments.len() as f32;
        let mut ink = vec![0.0; patch.share.len()];
        for moment in moments {
            ink.fill(0.0);
            self.strew(moment, &patch, &mut ink);
            self.light(&moment.pose, &ink, weight, &mut patch);
            let covers = moment.covers([0.0; 2]);
            if !covers.is_empty() {
                self.hide(&moment.pose, &covers, weight, &mut patch);
            }
        }
        patch
    }

    /// The empty rectangle around the ball at all moments.
    fn frame(&self, moments: &[Moment], width: usize, rows: Range<usize>) -> Patch {
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
        Patch { left, top, width: columns, height: rows, share: vec![0.0; size], light_dn: vec![0.0; size] }
    }

    /// Adds up the share of each pixel that speckles and lines cover.
    fn strew(&self, moment: &Moment, patch: &Patch, ink: &mut [f32]) {
        let pose = &moment.pose;
        let corner = [patch.left as f64, patch.top as f64];
        let center = [pose.center_px[0] - corner[0], pose.center_px[1] - corner[1]];
        let covers = moment.covers(corner);
        let pattern = match &self.coat {
            Coat::Flat(pattern) => pattern,
            Coat::Round(globe) => return globe.strew_ink(&pose.attitude, center, &covers, (patch, ink)),
        };
        let (sin, cos) = pose.angle_rad.sin_cos();
        // Counter-clockwise on the screen, with y down.
        let turned = |[x, y]: [f64; 2]| [x * cos + y * sin, y * cos - x * sin];
        for speckle in &pattern.speckles {
            let [x, y] = turned([speckle.x_px, speckle.y_px]);
            self.stamp((pattern, speckle), [center[0] + x, center[1] + y], center, &covers, (patch, ink));
        }
        for line in &pattern.lines {
            let [x, y] = turned(line.middle_px);
            let line = Line { middle_px: [center[0] + x, center[1] + y], along: turned(line.along), ..*line };
            self.rule(&line, &covers, patch, ink);
        }
    }

    /// Adds the visible part of one line to the ink; where an edge cuts it, both are taken as crossing squarely.
    fn rule(&self, line: &Line, covers: &[Cover], patch: &Patch, ink: &mut [f32]) {
        let strip = |distance: f64, half: f64| {
            if distance.abs() < half - EDGE_SIGMA * self.sigma_px {
                return 1.0;
            }
            normal_cdf((half - distance) / self.sigma_px) - normal_cdf((-half - distance) / self.sigma_px)
        };
        let wide = line.half_width_px + REACH_SIGMA * self.sigma_px;
        let [x, y] = line.middle_px;
        spread(line.middle_px, line.half_length_px + wide, patch, ink, |dx, dy| {
            let (dx, dy) = (f64::from(dx), f64::from(dy));
            let across = dx * line.along[1] - dy * line.along[0];
            if across.abs() > wide {
                return 0.0;
            }
            let along = dx * line.along[0] + dy * line.along[1];
            let free = covers.iter().map(|cover| normal_cdf(cover.outside(x + dx, y + dy).0 / self.sigma_px));
            let free = free.product::<f64>();
            (strip(across, line.half_width_px) * strip(along, line.half_length_px) * free) as f32
        });
    }

    /// Adds the visible part of one speckle to the ink; places count from the patch's corner.
    fn stamp(
        &self,
        (pattern, speckle): (&Pattern, &Speckle),
        place_px: [f64; 2],
        center_px: [f64; 2],
        covers: &[Cover],
        (patch, ink): (&Patch, &mut [f32]),
    ) {
        let radius_px = pattern.radii_px[speckle.size];
        let outside_px = |cover: &Cover| cover.outside(place_px[0], place_px[1]).0;
        if covers.iter().any(|cover| outside_px(cover) <= -radius_px) {
            return;
        }
        // A speckle that no edge reaches is seen whole, however close it is.
        let cuts: Vec<Cover> = covers.iter().filter(|cover| outside_px(cover) < radius_px).copied().collect();
        let to_center = [center_px[0] - place_px[0], center_px[1] - place_px[1]];
        let reach = radius_px + REACH_SIGMA * self.sigma_px;
        if let [Cover::Edge(edge)] = &cuts[..] {
            let turned =
                |[x, y]: [f64; 2]| [x * edge.normal[0] + y * edge.normal[1], x * edge.normal[1] - y * edge.normal[0]];
            let outside_px = edge.distance_px(place_px[0], place_px[1]);
            let disc =
                EdgedDisc { radius_px, edge_px: -outside_px, rim_center_px: turned(to_center), rim_px: self.radius_px };
            let rule = if speckle.crosses_rim { &self.fine_rule[..] } else { &self.rule };
            spread(place_px, reach, patch, ink, |dx, dy| {
                disc.share(turned([f64::from(dx), f64::from(dy)]), self.sigma_px, rule) as f32
            });
        } else if !cuts.is_empty() {
            let axes = Axes::new(place_px, [1.0, 0.0]);
            let left = visible_chords(radius_px, self.sigma_px, &axes, &cuts, |across| {
                let [left, right] = disc_chord(radius_px, across);
                let rim = disc_chord(self.radius_px, across - to_center[1]).map(|end| end + to_center[0]);
                Some(if speckle.crosses_rim { [left.max(rim[0]), right.min(rim[1])] } else { [left, right] })
            });
            spread(place_px, reach, patch, ink, |dx, dy| {
                share(&left, f64::from(dx), f64::from(dy), self.sigma_px) as f32
            });
        } else if let (true, Some(disc)) = (speckle.crosses_rim, &pattern.cut_discs[speckle.size]) {
            let distance = to_center[0].hypot(to_center[1]);
            let [ex, ey] = to_center.map(|part| (-part / distance) as f32);
            spread(place_px, disc.reach_px(), patch, ink, |dx, dy| disc.at(dx * ex + dy * ey, dy * ex - dx * ey));
        } else {
            let disc = &pattern.discs[speckle.size];
            spread(place_px, disc.reach_px(), patch, ink, |dx, dy| disc.at(dx * dx + dy * dy));
        }
    }

    /// Adds the ball's light, as far as it is seen, to the patch.
    fn light(&self, pose: &Pose, ink: &[f32], weight: f32, patch: &mut Patch) {
        let [x0, y0] = [patch.left as f64 - pose.center_px[0], patch.top as f64 - pose.center_px[1]];
        let width = patch.width;
        for row in 0..patch.height {
            let dy = (y0 + row as f64) as f32;
            let cells = row * width..(row + 1) * width;
            let target = patch.share[cells.clone()].iter_mut().zip(&mut patch.light_dn[cells.clone()]);
            for (column, ((share, light_dn), ink)) in target.zip(&ink[cells]).enumerate() {
                let dx = x0 as f32 + column as f32;
                let seen = self.rim.at(dx * dx + dy * dy);
                *share += weight * seen;
                *light_dn += weight * self.ball_dn * (seen - self.ink * ink) * self.light.at(dx, dy);
            }
        }
    }

    /// Takes back what the covers hide of the plain ball.
    fn hide(&self, pose: &Pose, covers: &[Cover], weight: f32, patch: &mut Patch) {
        let edge_px = EDGE_SIGMA * self.sigma_px;
        let axes = Axes::new(pose.center_px, [1.0, 0.0]);
        // A straight edge and a rim cross so plainly that their angle says all.
        let is_straight = matches!(covers, [Cover::Edge(_)]);
        let ends = |across: f64| Some(disc_chord(self.radius_px, across));
        let chords =
            if is_straight { Vec::new() } else { visible_chords(self.radius_px, self.sigma_px, &axes, covers, ends) };
        for index in 0..patch.share.len() {
            let (x, y) = ((patch.left + index % patch.width) as f64, (patch.top + index / patch.width) as f64);
            let (dx, dy) = (x - pose.center_px[0], y - pose.center_px[1]);
            let mut near = covers.iter().filter(|cover| cover.outside(x, y).0 <= edge_px);
            let Some(cover) = near.next() else { continue };
            let seen = self.rim.at((dx * dx + dy * dy) as f32);
            if seen <= 0.0 {
                continue;
            }
            let (outside_px, normal) = cover.outside(x, y);
            let many = near.next().is_some() || self.radius_px - dx.hypot(dy) < edge_px + 1.0;
            let left = match () {
                () if covers.iter().any(|cover| cover.outside(x, y).0 < -edge_px) => 0.0,
                () if many && !is_straight => share(&chords, dx, dy, self.sigma_px).clamp(0.0, f64::from(seen)),
                () => self.seen_beside(dx, dy, outside_px + cover.bend_px(self.sigma_px), normal),
            };
            let hidden = weight * (seen - left as f32);
            patch.share[index] -= hidden;
            patch.light_dn[index] -= hidden * self.ball_dn * self.light.at(dx as f32, dy as f32);
        }
    }

    /// Share of a pixel that shows the ball near an edge in front: the blurred overlap of disc and free half-plane.
    fn seen_beside(&self, dx: f64, dy: f64, outside_px: f64, normal: [f64; 2]) -> f64 {
        let free = outside_px / self.sigma_px;
        let distance = dx.hypot(dy).max(1e-9);
        // The rim's curvature takes this much from a straight edge.
        let inside = (self.radius_px - distance) / self.sigma_px - 0.5 * self.sigma_px / self.radius_px;
        if inside > EDGE_SIGMA {
            return normal_cdf(free);
        }
        let cosine = -(dx * normal[0] + dy * normal[1]) / distance;
        bivariate_cdf(inside, free, cosine, &self.rule)
    }
}

/// Adds a share to every cell within `reach` of a place (from the patch's corner); it is asked relative to the place, px.
pub(crate) fn spread(place_px: [f64; 2], reach: f64, patch: &Patch, ink: &mut [f32], share: impl Fn(f32, f32) -> f32) {
    let [x, y] = place_px;
    let first_row = (y - reach).ceil().max(0.0) as usize;
    let end_row = ((y + reach).floor() + 1.0).clamp(0.0, patch.height as f64) as usize;
    for row in first_row..end_row {
        let dy = row as f64 - y;
        let half = (reach * reach - dy * dy).max(0.0).sqrt();
        let first = (x - half).ceil().max(0.0) as usize;
        let end = ((x + half).floor() + 1.0).clamp(0.0, patch.width as f64) as usize;
        if first >= end {
            continue;
        }
        let (mut dx, dy) = ((first as f64 - x) as f32, dy as f32);
        for cell in &mut ink[row * patch.width + first..row * patch.width + end] {
            *cell += share(dx, dy);
            dx += 1.0;
        }
    }
}
