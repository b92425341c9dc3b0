//! The edge of the surface in the background.

use super::movement::Movement;
use super::path::Bounce;
use crate::numeric::{Polynomial, Sample, median, quantile};

/// The maximum angle between the normal of the surface and the change of velocity, deg.
///
/// Friction turns the change of velocity by at most the arctangent of its coefficient.
const MAX_TILT_DEG: f64 = 30.0;
/// The step of the search for the angle, deg.
const TILT_STEP_DEG: f64 = 0.5;
/// The range of distances of the edge from the centre of the deepest ball, in radii.
const DISTANCES: [f64; 2] = [0.7, 1.2];
/// Half of the length of the edge, in radii.
const HALF_LENGTH: f64 = 3.0;
/// The share of that length that has to lie in the image.
const MIN_INSIDE_FRACTION: f64 = 0.6;
/// The ratio of the contrast of the edge to the median of all lines from which it is an edge.
const MIN_CONTRAST_RATIO: f64 = 4.0;
/// The minimum contrast of the edge, standard deviations of noise.
const MIN_CONTRAST_SIGMAS: f64 = 2.0;
/// The distance up to which the edge is searched on either side of the best line, reduced pixels.
const REACH_PX: f64 = 2.5;
/// The minimum number of points of the edge.
const MIN_POINTS: usize = 8;
/// The distance of a point from the edge, in median distances, from which it lies on something else.
const OUTLIER_RATIO: f64 = 4.0;

/// An edge that the ball touches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceEdge {
    /// The direction of its tangent, counter-clockwise from x with y up, deg; the ball is to the left of it.
    pub angle_deg: f64,
    /// The standard uncertainty of the direction, from the scatter of the points of the edge, deg.
    pub sigma_deg: f64,
    /// Two points of it, px.
    pub ends_px: [[f64; 2]; 2],
}

/// A straight line in the reduced background.
#[derive(Debug, Clone, Copy)]
struct Line {
    /// Its point next to the ball.
    foot: [f64; 2],
    /// The direction from it to the ball.
    normal: [f64; 2],
    half_length: f64,
}

/// Finds the edge that a ball of this radius, px, touches where it bounces.
///
/// The candidates are lines at about the radius from the centre of the ball, whose normals are within 30 deg of its
/// change of velocity. The edge is the one across which the grey level of the background changes most. Returns `None`
/// if no line stands out.
pub fn find_surface_edge(movement: &Movement, bounce: &Bounce, radius_px: f64) -> Option<SurfaceEdge> {
    let factor = movement.factor as f64;
    let reduced = |at: f64| (at + 0.5) / factor - 0.5;
    let (center, radius) = (bounce.center_px.map(reduced), radius_px / factor);
    let mut best: Option<(f64, Line)> = None;
    let mut contrasts = Vec::new();
    let steps = (MAX_TILT_DEG / TILT_STEP_DEG) as i32;
    for tilt_deg in (-steps..=steps).map(|k| f64::from(k) * TILT_STEP_DEG) {
        let (sin, cos) = tilt_deg.to_radians().sin_cos();
        let [x, y] = bounce.direction;
        let normal = [x * cos - y * sin, x * sin + y * cos];
        let distances = (0..).map(|k| DISTANCES[0] * radius + 0.25 * f64::from(k));
        for distance in distances.take_while(|distance| *distance <= DISTANCES[1] * radius + 1.0) {
            let foot = [center[0] - distance * normal[0], center[1] - distance * normal[1]];
            let line = Line { foot, normal, half_length: HALF_LENGTH * radius };
            let Some(contrast) = line.contrast(movement) else { continue };
            contrasts.push(contrast);
            if best.is_none_or(|(highest, _)| contrast > highest) {
                best = Some((contrast, line));
            }
        }
    }
    let (contrast, line) = best?;
    let background =
        quantile(&mut contrasts, 0.5)?.max(MIN_CONTRAST_SIGMAS * f64::from(movement.noise_dn) / MIN_CONTRAST_RATIO);
    if contrast < MIN_CONTRAST_RATIO * background {
        return None;
    }
    let (line, sigma) = line.refine(movement).unwrap_or((line, TILT_STEP_DEG.to_radians()));
    // The y of the image points down. The tangent is the normal, turned clockwise by a quarter.
    let angle_deg = (-line.normal[1]).atan2(line.normal[0]).to_degrees() - 90.0;
    let full = |at: f64| (at + 0.5) * factor - 0.5;
    Some(SurfaceEdge {
        angle_deg: (angle_deg + 180.0).rem_euclid(360.0) - 180.0,
        sigma_deg: sigma.to_degrees(),
        ends_px: [-1.0, 1.0].map(|side| line.point_at(side * line.half_length, 0.0).map(full)),
    })
}

impl Line {
    /// Returns the point `along` the line from its foot and `across` towards the ball, reduced pixels.
    fn point_at(&self, along: f64, across: f64) -> [f64; 2] {
        let [x, y] = self.normal;
        [self.foot[0] - along * y + across * x, self.foot[1] + along * x + across * y]
    }

    /// Fits the line to the points of the edge near it, each where the grey level changes most.
    ///
    /// Returns the line with the standard uncertainty of its direction, rad; `None` for too few points.
    fn refine(self, movement: &Movement) -> Option<(Self, f64)> {
        let steps = (2.0 * self.half_length).ceil() as i32;
        let places = (0..=steps).map(|k| self.half_length * (2.0 * f64::from(k) / f64::from(steps) - 1.0));
        let point = |along: f64| {
            let value = self.edge_across(movement, along)?;
            Some(Sample { time_frames: along, component: 0, value, sigma: 1.0, walk: 0.0 })
        };
        let mut points: Vec<Sample> = places.filter_map(point).collect();
        for _ in 0..2 {
            let fitted = fit_edge(&points)?;
            let deviation = |point: &Sample| fitted.residual(point).map_or(f64::INFINITY, |(value, _)| value.abs());
            let limit = OUTLIER_RATIO * median(&mut points.iter().map(deviation).collect::<Vec<_>>())?;
            points.retain(|point| deviation(point) <= limit);
        }
        let fitted = fit_edge(&points)?;
        let (slope, offset) = (fitted.rate(0.0), fitted.predict(0.0, 0)?.value);
        let (sin, cos) = slope.value.atan().sin_cos();
        let [x, y] = self.normal;
        let line = Self { foot: self.point_at(0.0, offset), normal: [x * cos + y * sin, y * cos - x * sin], ..self };
        // The points have no uncertainty of their own: their scatter gives it.
        Some((line, slope.sigma * (fitted.chi2() / fitted.freedom() as f64).sqrt()))
    }

    /// Returns the distance of the edge from the line towards the ball, `along` the line, reduced pixels.
    ///
    /// It is the mean weighted by the squared changes of the grey level; `None` outside the image or where nothing
    /// changes.
    fn edge_across(&self, movement: &Movement, along: f64) -> Option<f64> {
        let steps = (REACH_PX / 0.25) as i32;
        let (mut weights, mut sum) = (0.0, 0.0);
        for across in (-steps..=steps).map(|k| 0.25 * f64::from(k)) {
            let level = |across: f64| movement.background.interpolate(self.point_at(along, across));
            let change = level(across + 0.5)? - level(across - 0.5)?;
            weights += change * change;
            sum += across * change * change;
        }
        let noise = f64::from(movement.noise_dn) * MIN_CONTRAST_SIGMAS;
        (weights > noise * noise).then(|| sum / weights)
    }

    /// Returns the mean change of the grey level across the line, over two reduced pixels, DN, without its sign. `None`
    /// if too little of the line lies in the image.
    fn contrast(&self, movement: &Movement) -> Option<f64> {
        let steps = (2.0 * self.half_length).ceil().max(4.0) as i32;
        let (mut sum, mut count) = (0.0, 0);
        for k in 0..=steps {
            let along = self.half_length * (2.0 * f64::from(k) / f64::from(steps) - 1.0);
            let level = |across: f64| movement.background.interpolate(self.point_at(along, across));
            if let (Some(near), Some(far)) = (level(1.0), level(-1.0)) {
                sum += near - far;
                count += 1;
            }
        }
        let is_inside = f64::from(count) >= MIN_INSIDE_FRACTION * f64::from(steps + 1);
        is_inside.then(|| (sum / f64::from(count)).abs())
    }
}

/// Fits a straight line of the distances across over those along; `None` for too few points.
fn fit_edge(points: &[Sample]) -> Option<Polynomial> {
    if points.len() < MIN_POINTS { None } else { Polynomial::fit(points, 0.0, 1, 0.0) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::survey::ReducedImage;

    /// A background that is lighter below a line through (100, 80) at this angle.
    fn movement(angle_deg: f64) -> Movement {
        let (width, height) = (200, 140);
        let slope = angle_deg.to_radians().tan();
        let level = |at: usize| {
            let (x, y) = ((at % width) as f64, (at / width) as f64);
            let below = y - 80.0 + slope * (x - 100.0);
            (40.0 + 60.0 * below.clamp(-0.5, 0.5)) as f32
        };
        let background = ReducedImage { levels_dn: (0..width * height).map(level).collect(), width, height };
        Movement {
            background,
            factor: 1,
            noise_dn: 0.5,
            threshold_dn: 3.0,
            swept: Vec::new(),
            swept_fraction: 0.1,
            is_everywhere: false,
            movers: Vec::new(),
        }
    }

    #[test]
    fn the_edge_of_the_background_gives_the_angle_that_friction_hides() {
        for angle_deg in [0.0, 1.3, 2.6, -3.4, 12.0, -7.5] {
            // The ball leaves 15 deg off the normal of a level surface.
            let direction = [0.2588, -0.9659];
            let bounce =
                Bounce { index: 9, t_s: 0.1, center_px: [100.0, 60.0], direction, velocities_px_s: [[0.0; 2]; 2] };
            let found = find_surface_edge(&movement(angle_deg), &bounce, 20.0).unwrap();
            let off_deg = (found.angle_deg - angle_deg).abs();
            assert!(off_deg < 0.2 && found.sigma_deg < 0.2, "{found:?} for {angle_deg}");
        }
    }

    #[test]
    fn a_plain_background_has_no_edge() {
        let mut movement = movement(0.0);
        movement.background.levels_dn.fill(40.0);
        let bounce = Bounce {
            index: 9,
            t_s: 0.1,
            center_px: [100.0, 60.0],
            direction: [0.0, -1.0],
            velocities_px_s: [[0.0; 2]; 2],
        };
        assert!(find_surface_edge(&movement, &bounce, 20.0).is_none());
    }
}
