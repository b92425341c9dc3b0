//! The edge of the surface in the background.

use super::movement::Movement;
use super::path::Bounce;

/// The maximum angle between the normal of the surface and the change of velocity, deg. Friction turns that by its
/// coefficient.
const MAX_TILT_DEG: f64 = 30.0;
const TILT_STEP_DEG: f64 = 0.5;
/// The range of distances of the edge from the centre of the deepest ball, in radii.
const DISTANCES: [f64; 2] = [0.7, 1.2];
/// Half of the length of the edge, in radii.
const HALF_LENGTH: f64 = 3.0;
/// The share of that length that has to lie in the image.
const MIN_INSIDE: f64 = 0.6;
/// The ratio of the contrast of the edge to the median of all lines from which it is an edge.
const MIN_CONTRAST_RATIO: f64 = 4.0;
/// The minimum contrast of the edge, standard deviations of noise.
const MIN_CONTRAST_SIGMAS: f64 = 2.0;

/// An edge that the ball touches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceEdge {
    /// The direction of its tangent, counter-clockwise from x with y up, deg; the ball is to the left of it.
    pub angle_deg: f64,
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
/// Among lines at about the radius from the centre, it is the one across which the grey level of the background changes
/// most. Returns `None` if no line stands out.
pub fn surface_edge(movement: &Movement, bounce: &Bounce, radius_px: f64) -> Option<SurfaceEdge> {
    let factor = movement.factor as f64;
    let reduced = |at: f64| (at + 0.5) / factor - 0.5;
    let (center, radius) = (bounce.center_px.map(reduced), radius_px / factor);
    let mut best: Option<(f64, Line, f64)> = None;
    let mut all = Vec::new();
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
            all.push(contrast);
            if best.is_none_or(|(highest, ..)| contrast > highest) {
                best = Some((contrast, line, tilt_deg));
            }
        }
    }
    let (contrast, line, _) = best?;
    all.sort_by(f64::total_cmp);
    let usual = all[all.len() / 2].max(MIN_CONTRAST_SIGMAS * f64::from(movement.noise_dn) / MIN_CONTRAST_RATIO);
    if contrast < MIN_CONTRAST_RATIO * usual {
        return None;
    }
    // The image's y points down. The tangent is the normal, turned clockwise by a quarter turn.
    let angle_deg = (-line.normal[1]).atan2(line.normal[0]).to_degrees() - 90.0;
    let full = |at: f64| (at + 0.5) * factor - 0.5;
    Some(SurfaceEdge {
        angle_deg: (angle_deg + 180.0).rem_euclid(360.0) - 180.0,
        ends_px: [-1.0, 1.0].map(|side| line.point(side * line.half_length, 0.0).map(full)),
    })
}

impl Line {
    /// Returns a point of it, moved along it and towards the ball.
    fn point(&self, along: f64, across: f64) -> [f64; 2] {
        let [x, y] = self.normal;
        [self.foot[0] - along * y + across * x, self.foot[1] + along * x + across * y]
    }

    /// Returns the mean change of the grey level across the line, DN; `None` if too little of it lies in the image.
    fn contrast(&self, movement: &Movement) -> Option<f64> {
        let steps = (2.0 * self.half_length).ceil().max(4.0) as i32;
        let (mut sum, mut count) = (0.0, 0);
        for k in 0..=steps {
            let along = self.half_length * (2.0 * f64::from(k) / f64::from(steps) - 1.0);
            let level = |across: f64| level(movement, self.point(along, across));
            if let (Some(near), Some(far)) = (level(1.0), level(-1.0)) {
                sum += near - far;
                count += 1;
            }
        }
        let is_inside = f64::from(count) >= MIN_INSIDE * f64::from(steps + 1);
        is_inside.then(|| (sum / f64::from(count)).abs())
    }
}

/// Interpolates the background linearly; `None` outside.
fn level(movement: &Movement, point: [f64; 2]) -> Option<f64> {
    let [x, y] = point;
    let image = &movement.background;
    if !(x >= 0.0 && y >= 0.0 && x < image.width as f64 - 1.0 && y < image.height as f64 - 1.0) {
        return None;
    }
    let (column, row) = (x.floor(), y.floor());
    let (right, low) = (x - column, y - row);
    let at =
        |dx: usize, dy: usize| f64::from(image.levels_dn[(row as usize + dy) * image.width + column as usize + dx]);
    let upper = at(0, 0) * (1.0 - right) + at(1, 0) * right;
    let lower = at(0, 1) * (1.0 - right) + at(1, 1) * right;
    Some(upper * (1.0 - low) + lower * low)
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
        for angle_deg in [0.0, 12.0, -7.5] {
            // The ball leaves 15 deg off the normal of a level surface.
            let direction = [0.2588, -0.9659];
            let bounce =
                Bounce { index: 9, t_s: 0.1, center_px: [100.0, 60.0], direction, velocities_px_s: [[0.0; 2]; 2] };
            let found = surface_edge(&movement(angle_deg), &bounce, 20.0).unwrap();
            assert!((found.angle_deg - angle_deg).abs() < 1.0, "{} for {angle_deg}", found.angle_deg);
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
        assert!(surface_edge(&movement, &bounce, 20.0).is_none());
    }
}
