//! Regular patterns: stripes, sectors, dots and panels, painted on a disc or on a sphere.
//!
//! Each pattern is a function on the body, positive inside the paint. Divided by its gradient in the image it is the
//! distance from the nearest edge, which the blur turns into a coverage. The shape of a narrow part is approximate. Its
//! motion is exact, because the function moves with the body.

use crate::numeric::{Stream, normal_cdf};
use crate::synth::orientation::Orientation;
use crate::synth::scenario::{Layout, PatternSetup, Shape};
use crate::synth::trajectory::Pose;
use std::f64::consts::{PI, TAU};

/// The radius of the ring of dots, relative to the ball.
const RING_RADIUS: f64 = 0.6;
/// The distance over which the gradient is taken, px.
const STEP_PX: f64 = 0.5;

/// A regular pattern on a ball.
#[derive(Debug, Clone)]
pub(crate) struct RegularPaint {
    layout: Layout,
    shape: Shape,
    repeats: f64,
    coverage: f64,
    radius_px: f64,
    sigma_px: f64,
    /// The radius of a dot, relative to the ball.
    dot: f64,
    /// The middles of the panels.
    panels: Vec<[f64; 3]>,
}

impl RegularPaint {
    /// Prepares a pattern; `None` if its speckles are placed at random.
    pub(crate) fn new(
        setup: &PatternSetup,
        shape: Shape,
        radius_px: f64,
        sigma_px: f64,
        stream: Stream,
    ) -> Option<Self> {
        (setup.layout != Layout::Random).then(|| Self {
            layout: setup.layout,
            shape,
            repeats: f64::from(setup.repeats),
            coverage: setup.coverage,
            radius_px,
            sigma_px,
            dot: (setup.area_max_px2 / PI).sqrt() / radius_px,
            panels: if setup.layout == Layout::Football { icosahedron_vertices(stream) } else { Vec::new() },
        })
    }

    /// Returns the pattern magnified by `zoom`. The blur of its edges stays as wide in pixels.
    pub(crate) fn zoomed(&self, zoom: f64) -> Self {
        Self { radius_px: zoom * self.radius_px, ..self.clone() }
    }

    /// Returns the painted fraction of a pixel, 0 to 1, at a position from the centre (px, y down).
    ///
    /// Divides the level-set function by its gradient, which gives the distance from the edge, and blurs it.
    pub(crate) fn coverage_at(&self, pose: &Pose, dx: f64, dy: f64) -> f64 {
        let level_set = |x: f64, y: f64| self.level_set(self.body_point(pose, x, y));
        let slope = [
            level_set(dx + STEP_PX, dy) - level_set(dx - STEP_PX, dy),
            level_set(dx, dy + STEP_PX) - level_set(dx, dy - STEP_PX),
        ];
        let steepest = slope[0].hypot(slope[1]) / (2.0 * STEP_PX);
        normal_cdf(level_set(dx, dy) / (steepest * self.sigma_px).max(1e-9))
    }

    /// Returns 1 at a painted point and 0 elsewhere: the coverage without blur.
    #[cfg(test)]
    pub(crate) fn sharp_coverage_at(&self, pose: &Pose, dx: f64, dy: f64) -> f64 {
        f64::from(u8::from(self.level_set(self.body_point(pose, dx, dy)) > 0.0))
    }

    /// Returns the visible point of the body at a position from the centre, in the axes of the body (x right, y up, z
    /// to the camera), in radii.
    fn body_point(&self, pose: &Pose, dx: f64, dy: f64) -> [f64; 3] {
        let (x, y) = (dx / self.radius_px, -dy / self.radius_px);
        if self.shape != Shape::Sphere {
            let (sin, cos) = pose.angle_rad.sin_cos();
            return [x * cos + y * sin, y * cos - x * sin, 1.0];
        }
        let flat = x.hypot(y).max(1.0);
        let (x, y) = (x / flat, y / flat);
        pose.orientation.inverse_rotate([x, y, (1.0 - x * x - y * y).max(0.0).sqrt()])
    }

    /// Returns the level-set function of the pattern at a point of the body, in radii; positive inside the paint.
    fn level_set(&self, point: [f64; 3]) -> f64 {
        let [x, y, z] = point;
        let edge = (PI * self.coverage).cos();
        match self.layout {
            Layout::Random => -1.0,
            Layout::Stripes => (PI * self.repeats * x).cos() - edge,
            Layout::Sectors => (self.repeats * y.atan2(x)).cos() - edge,
            Layout::Dots => {
                let part = TAU / self.repeats;
                let (sin, cos) = ((y.atan2(x) / part).round() * part).sin_cos();
                let depth = if self.shape == Shape::Sphere { (1.0 - RING_RADIUS * RING_RADIUS).sqrt() } else { 1.0 };
                let away = [x - RING_RADIUS * cos, y - RING_RADIUS * sin, z.abs() - depth];
                self.dot - away.iter().map(|part| part * part).sum::<f64>().sqrt()
            }
            Layout::Football => {
                let nearest = self.panels.iter().map(|panel| x * panel[0] + y * panel[1] + z * panel[2]);
                // Twelve caps of this height cover the share.
                nearest.fold(-1.0, f64::max) - (1.0 - self.coverage / 6.0)
            }
        }
    }
}

/// Returns unit vectors to the vertices of an icosahedron in a random orientation.
fn icosahedron_vertices(mut stream: Stream) -> Vec<[f64; 3]> {
    let rotation = Orientation::from_rotation_vector([0; 3].map(|_| stream.between(-PI, PI)));
    let golden = 0.5 * (1.0 + 5_f64.sqrt());
    let length = 1_f64.hypot(golden);
    let (short, long) = (1.0 / length, golden / length);
    let signs = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)];
    signs
        .iter()
        .flat_map(|(a, b)| [[0.0, a * short, b * long], [a * short, b * long, 0.0], [b * long, 0.0, a * short]])
        .map(|corner| rotation.rotate(corner))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(turn: Orientation, angle_rad: f64) -> Pose {
        Pose { center_px: [0.0; 2], angle_rad, orientation: turn, velocity_m_s: [0.0; 2], omega_rad_s: 0.0 }
    }

    fn paint(layout: Layout, shape: Shape, repeats: u32) -> RegularPaint {
        let setup = PatternSetup { coverage: 0.4, layout, repeats, ..PatternSetup::default() };
        RegularPaint::new(&setup, shape, 40.0, 0.8, Stream::new(3)).unwrap()
    }

    /// The share of the disc within 0.95 of the radius, so that the rim of a sphere does not matter.
    fn share(paint: &RegularPaint, pose: &Pose) -> f64 {
        let places = (-38..=38).flat_map(|y| (-38..=38).map(move |x| [f64::from(x), f64::from(y)]));
        let inside: Vec<f64> =
            places.filter(|[x, y]| x.hypot(*y) < 38.0).map(|[x, y]| paint.coverage_at(pose, x, y)).collect();
        inside.iter().sum::<f64>() / inside.len() as f64
    }

    #[test]
    fn a_regular_pattern_covers_its_share_and_repeats_itself() {
        for shape in [Shape::Disc, Shape::Sphere] {
            for (layout, repeats) in [(Layout::Stripes, 5), (Layout::Sectors, 7)] {
                let (paint, still) = (paint(layout, shape, repeats), pose(Orientation::in_plane(0.0), 0.0));
                let covered = share(&paint, &still);
                assert!((covered - 0.4).abs() < 0.06, "{layout:?} {shape:?}: {covered}");
                let part = if layout == Layout::Stripes { PI } else { TAU / f64::from(repeats) };
                let turned = pose(Orientation::in_plane(part), part);
                let half = pose(Orientation::in_plane(0.5 * part), 0.5 * part);
                let differs =
                    |other: &Pose| (paint.coverage_at(&still, 13.0, 8.0) - paint.coverage_at(other, 13.0, 8.0)).abs();
                assert!(differs(&turned) < 1e-9, "{layout:?} {shape:?}");
                let places = (-30..30).map(|x| {
                    (paint.coverage_at(&still, f64::from(x), 5.0) - paint.coverage_at(&half, f64::from(x), 5.0)).abs()
                });
                assert!(places.fold(0.0, f64::max) > 0.5, "{layout:?} {shape:?}");
            }
        }
    }

    #[test]
    fn dots_have_their_area_and_panels_turn_with_the_ball() {
        let setup = PatternSetup { area_max_px2: 60.0, layout: Layout::Dots, repeats: 9, ..PatternSetup::default() };
        let dots = RegularPaint::new(&setup, Shape::Disc, 40.0, 0.8, Stream::new(3)).unwrap();
        let still = pose(Orientation::in_plane(0.0), 0.0);
        let area = share(&dots, &still) * PI * 38.0 * 38.0;
        // The blur of a round edge adds pi sigma^2 to each dot.
        assert!((area / 558.1 - 1.0).abs() < 0.02, "{area}");
        let football = paint(Layout::Football, Shape::Sphere, 1);
        let turned = pose(Orientation::in_plane(0.5 * PI), 0.5 * PI);
        for (x, y) in [(10.0, 3.0), (-22.0, 17.0), (4.0, -31.0)] {
            // Counter-clockwise on the screen: the point on the right comes to the top.
            assert!((football.coverage_at(&still, x, y) - football.coverage_at(&turned, y, -x)).abs() < 1e-9);
        }
    }
}
