//! A slow reference renderer: sharp shapes on a 16 times finer grid, convolved with the lens's Gaussian and averaged
//! over each pixel.

use crate::numeric::Stream;
use crate::numeric::normal_cdf;
use crate::synth::orientation::Orientation;
use crate::synth::render::DiscOutline;
use crate::synth::render::total_sigma_px;
use crate::synth::render::{Ball, HalfPlane, Moment, Surface};
use crate::synth::render::{Pattern, SpeckleRegion};
use crate::synth::render::{RegularPaint, SpeckledSphere};
use crate::synth::scenario::{BodySetup, Layout, PatternSetup, ScaleSetup, Scenario, Shape};
use crate::synth::trajectory::Pose;

const FINE: usize = 16;
const SIDE: usize = 64;
const GROUND_DN: f64 = 30.0;
const BALL_DN: f64 = 191.25;
const SPECKLE_DN: f64 = 51.0;
const FLAT_DN: f64 = 97.0;
/// A plain ball in front.
const FRONT_DN: f64 = 140.25;

/// Returns a ball of radius 23 px with speckles of 2 to 40 px^2.
fn scenario() -> Scenario {
    let pattern = PatternSetup { area_min_px2: 2.0, area_max_px2: 40.0, coverage: 0.4, ..PatternSetup::default() };
    Scenario {
        scale: ScaleSetup { mm_per_px: 1.0, nearer_per_s: 0.0 },
        body: BodySetup { diameter_mm: 46.0, shape: Shape::Disc, pattern, fuzz_px: 0.0, rod: None },
        ..Scenario::translation(0.0, 0.0, 0.0)
    }
}

fn pattern(scenario: &Scenario) -> Surface {
    let sigma_px = total_sigma_px(scenario.camera.blur_px);
    Surface::Flat(
        Pattern::scatter(&scenario.body.pattern, SpeckleRegion::Disc(scenario.radius_px()), sigma_px, Stream::new(5))
            .unwrap(),
    )
}

fn sphere(scenario: &Scenario) -> Surface {
    let sigma_px = total_sigma_px(scenario.camera.blur_px);
    Surface::Sphere(
        SpeckledSphere::scatter(&scenario.body.pattern, scenario.radius_px(), sigma_px, Stream::new(5)).unwrap(),
    )
}

fn pose(x: f64, y: f64, angle_deg: f64) -> Pose {
    let angle_rad = angle_deg.to_radians();
    let orientation = Orientation::in_plane(angle_rad);
    Pose { center_px: [x, y], angle_rad, orientation, velocity_m_s: [0.0; 2], omega_rad_s: 0.0 }
}

fn alone(pose: Pose) -> Moment {
    Moment { pose, occluder: None, front: None }
}

/// Renders the image with the renderer under test, DN, row-major: ground, occluding flat, ball and front ball.
fn render_image(scenario: &Scenario, surface: &Surface, moment: &Moment) -> Vec<f64> {
    let sigma_px = total_sigma_px(scenario.camera.blur_px);
    let mut picture: Vec<f64> = (0..SIDE * SIDE)
        .map(|index| {
            let (x, y) = ((index % SIDE) as f64, (index / SIDE) as f64);
            let free = moment.occluder.map_or(1.0, |flat| normal_cdf(flat.distance_px(x, y) / sigma_px));
            free * GROUND_DN + (1.0 - free) * FLAT_DN
        })
        .collect();
    let mut patches = vec![Ball::new(scenario, surface.clone(), 255.0).draw(&[*moment], SIDE, 0..SIDE)];
    if let Some(front) = moment.front {
        let mut scenario = scenario.clone();
        scenario.body.diameter_mm = 2.0 * front.radius_px;
        scenario.body.pattern.coverage = 0.0;
        scenario.shade.ball = FRONT_DN / 255.0;
        let [x, y] = front.center_px;
        let before = Moment { pose: pose(x, y, 0.0), occluder: moment.occluder, front: None };
        patches.push(Ball::new(&scenario, pattern(&scenario), 255.0).draw(&[before], SIDE, 0..SIDE));
    }
    for patch in &patches {
        for row in 0..patch.height {
            for column in 0..patch.width {
                let cell = row * patch.width + column;
                picture[(patch.top + row) * SIDE + patch.left + column] +=
                    f64::from(patch.light_dn[cell]) - f64::from(patch.coverage[cell]) * GROUND_DN;
            }
        }
    }
    picture
}

/// Returns the fraction of a fine cell inside an edge that passes it at this distance.
fn inside_fraction(distance_px: f64) -> f64 {
    (0.5 + distance_px * FINE as f64).clamp(0.0, 1.0)
}

const PAD: usize = 4;
const FINE_SIDE: usize = (SIDE + 2 * PAD) * FINE;

/// Returns the middle of the fine cell with this index along an axis, px of the image.
fn cell_middle_px(index: usize) -> f64 {
    (index as f64 + 0.5) / FINE as f64 - 0.5 - PAD as f64
}

/// Returns the indices of the fine cells within `reach` of a position along an axis, px, and a few more.
fn cells_around(middle: f64, reach: f64) -> std::ops::Range<usize> {
    let cell = |place: f64| ((place + 0.5 + PAD as f64) * FINE as f64).max(0.0) as usize;
    cell(middle - reach).saturating_sub(2)..(cell(middle + reach) + 3).min(FINE_SIDE)
}

/// Returns the coverage of every fine cell by a flat pattern.
fn flat_ink(pattern: &Pattern, pose: &Pose) -> Vec<f64> {
    let (sin, cos) = pose.angle_rad.sin_cos();
    let turn = |[x, y]: [f64; 2]| [x * cos + y * sin, y * cos - x * sin];
    let mut ink = vec![0.0f64; FINE_SIDE * FINE_SIDE];
    for speckle in &pattern.speckles {
        let [dx, dy] = turn([speckle.x_px, speckle.y_px]);
        let ([x, y], radius) = ([pose.center_px[0] + dx, pose.center_px[1] + dy], pattern.radii_px[speckle.size]);
        for row in cells_around(y, radius) {
            for column in cells_around(x, radius) {
                ink[row * FINE_SIDE + column] +=
                    inside_fraction(radius - (cell_middle_px(column) - x).hypot(cell_middle_px(row) - y));
            }
        }
    }
    for line in &pattern.lines {
        let middle = turn(line.middle_px);
        let along = turn(line.along);
        for (index, ink) in ink.iter_mut().enumerate() {
            let (dx, dy) = (
                cell_middle_px(index % FINE_SIDE) - pose.center_px[0] - middle[0],
                cell_middle_px(index / FINE_SIDE) - pose.center_px[1] - middle[1],
            );
            let far = (dx * along[0] + dy * along[1]).abs();
            let wide = (dx * along[1] - dy * along[0]).abs();
            *ink += inside_fraction(line.half_length_px - far) * inside_fraction(line.half_width_px - wide);
        }
    }
    ink
}

/// Returns the coverage of every fine cell by the front of a speckled sphere, from 16 points projected onto the sphere.
fn sphere_ink(sphere: &SpeckledSphere, ball_px: f64, pose: &Pose) -> Vec<f64> {
    const POINTS: [f64; 4] = [-0.375, -0.125, 0.125, 0.375];
    let mut ink = vec![0.0f64; FINE_SIDE * FINE_SIDE];
    for spot in &sphere.spots {
        let [nx, ny, nz] = pose.orientation.rotate(spot.direction);
        let radius = sphere.tables[spot.size].cap().radius_px;
        let plane = (ball_px * ball_px - radius * radius).sqrt();
        let [x, y] = [pose.center_px[0] + ball_px * nx, pose.center_px[1] - ball_px * ny];
        let is_covered = |column: f64, row: f64| {
            let (dx, up) = (column - pose.center_px[0], pose.center_px[1] - row);
            let depth = ball_px * ball_px - dx * dx - up * up;
            depth >= 0.0 && dx * nx + up * ny + depth.sqrt() * nz >= plane
        };
        for row in cells_around(y, radius + 0.5) {
            for column in cells_around(x, radius + 0.5) {
                let points = POINTS.iter().flat_map(|down| POINTS.iter().map(move |right| (right, down)));
                let fine = FINE as f64;
                let covered = points.filter(|(right, down)| {
                    is_covered(cell_middle_px(column) + *right / fine, cell_middle_px(row) + *down / fine)
                });
                ink[row * FINE_SIDE + column] += covered.count() as f64 / 16.0;
            }
        }
    }
    ink
}

/// Renders the reference image, DN, row-major: sharp shapes on the fine grid, then lens and pixels.
fn render_reference(scenario: &Scenario, surface: &Surface, moment: &Moment) -> Vec<f64> {
    let pose = &moment.pose;
    let ink = match surface {
        Surface::Flat(pattern) => flat_ink(pattern, pose),
        Surface::Sphere(sphere) => sphere_ink(sphere, scenario.radius_px(), pose),
        Surface::Regular(paint) => {
            let at = |index: usize| {
                let place = [cell_middle_px(index % FINE_SIDE), cell_middle_px(index / FINE_SIDE)];
                paint.sharp_coverage_at(pose, place[0] - pose.center_px[0], place[1] - pose.center_px[1])
            };
            (0..FINE_SIDE * FINE_SIDE).map(at).collect()
        }
    };
    let within = |round: &DiscOutline, x: f64, y: f64| {
        inside_fraction(round.radius_px - (x - round.center_px[0]).hypot(y - round.center_px[1]))
    };
    let outline = DiscOutline { center_px: pose.center_px, radius_px: scenario.radius_px() };
    let sharp: Vec<f64> = (0..FINE_SIDE * FINE_SIDE)
        .map(|index| {
            let (x, y) = (cell_middle_px(index % FINE_SIDE), cell_middle_px(index / FINE_SIDE));
            let ball = within(&outline, x, y);
            let free = moment.occluder.map_or(1.0, |flat| inside_fraction(flat.distance_px(x, y)));
            let ink = match surface {
                Surface::Flat(_) | Surface::Regular(_) => ball * ink[index].min(1.0),
                Surface::Sphere(_) => ink[index],
            };
            let light = ball * BALL_DN + (SPECKLE_DN - BALL_DN) * ink + (1.0 - ball) * GROUND_DN;
            let front = moment.front.map_or(0.0, |front| within(&front, x, y));
            free * (front * FRONT_DN + (1.0 - front) * light) + (1.0 - free) * FLAT_DN
        })
        .collect();
    let weights = kernel(scenario.camera.blur_px);
    let rows = convolve_rows(&sharp, &weights);
    let columns = convolve_rows(&transpose(&rows, SIDE, FINE_SIDE), &weights);
    transpose(&columns, SIDE, SIDE)
}

/// Returns the Gaussian of the lens convolved with the pixel's box, on the fine grid, with sum 1.
fn kernel(blur_px: f64) -> Vec<f64> {
    let sigma = blur_px * FINE as f64;
    let reach = (PAD * FINE) as i32;
    let weights: Vec<f64> = (-reach..reach)
        .map(|step| {
            let middle = f64::from(step) + 0.5;
            let half = 0.5 * FINE as f64;
            // The part of a fine cell in the pixel, after the lens.
            normal_cdf((middle + half) / sigma) - normal_cdf((middle - half) / sigma)
        })
        .collect();
    let sum: f64 = weights.iter().sum();
    weights.into_iter().map(|weight| weight / sum).collect()
}

/// Convolves every row of the fine grid with `weights` and keeps one value per pixel of the image.
fn convolve_rows(values: &[f64], weights: &[f64]) -> Vec<f64> {
    let rows = values.len() / FINE_SIDE;
    (0..rows * SIDE)
        .map(|index| {
            let (row, pixel) = (index / SIDE, index % SIDE);
            // The middle of the pixel lies between two fine cells.
            let first = row * FINE_SIDE + (pixel + PAD) * FINE + FINE / 2 - weights.len() / 2;
            values[first..first + weights.len()].iter().zip(weights).map(|(value, weight)| value * weight).sum()
        })
        .collect()
}

/// Transposes a row-major matrix of `width` columns and `height` rows.
fn transpose(values: &[f64], width: usize, height: usize) -> Vec<f64> {
    (0..width * height).map(|index| values[(index % height) * width + index / height]).collect()
}

/// Estimates the shift along x and y of `picture` relative to `reference`, px, by least squares over the gradients of
/// the reference.
fn shift_px(picture: &[f64], reference: &[f64]) -> [f64; 2] {
    let mut sums = [0.0; 5];
    for row in 1..SIDE - 1 {
        for column in 1..SIDE - 1 {
            let index = row * SIDE + column;
            let gx = 0.5 * (reference[index + 1] - reference[index - 1]);
            let gy = 0.5 * (reference[index + SIDE] - reference[index - SIDE]);
            let change = picture[index] - reference[index];
            for (sum, term) in sums.iter_mut().zip([gx * gx, gx * gy, gy * gy, gx * change, gy * change]) {
                *sum += term;
            }
        }
    }
    let [xx, xy, yy, x, y] = sums;
    let determinant = xx * yy - xy * xy;
    [-(yy * x - xy * y) / determinant, -(xx * y - xy * x) / determinant]
}

/// Returns the largest absolute difference of two images, DN, and the index of its pixel.
fn largest_difference(picture: &[f64], reference: &[f64]) -> (f64, usize) {
    let differences = picture.iter().zip(reference).map(|(left, right)| (left - right).abs()).enumerate();
    differences.fold((0.0, 0), |best, (index, value)| if value > best.0 { (value, index) } else { best })
}

/// Renders both images and asserts that they differ by at most half a grey level; returns the shift between them.
fn assert_agreement(scenario: &Scenario, surface: &Surface, moment: &Moment, what: &str) -> [f64; 2] {
    let (worst_dn, shift) = compare_with_reference(scenario, surface, moment, what);
    assert!(worst_dn <= 0.5, "{what}: {worst_dn} DN");
    shift
}

/// Renders both images; returns their largest difference, DN, and the shift between them, px.
fn compare_with_reference(scenario: &Scenario, surface: &Surface, moment: &Moment, what: &str) -> (f64, [f64; 2]) {
    let (picture, reference) = (render_image(scenario, surface, moment), render_reference(scenario, surface, moment));
    let (worst_dn, index) = largest_difference(&picture, &reference);
    let shift = shift_px(&picture, &reference);
    let place = (index % SIDE, index / SIDE);
    eprintln!("{what}: {worst_dn:.3} DN at {place:?}, shift {shift:.6?} px");
    (worst_dn, shift)
}

const POSES: [(f64, f64, f64); 4] =
    [(31.5, 31.5, 0.0), (31.63, 31.88, 17.0), (32.02, 31.25, 63.0), (31.9, 32.4, -140.0)];

#[test]
fn a_ball_at_another_distance_is_drawn_within_half_a_grey_level_and_not_shifted() {
    let mut far = scenario();
    far.body.pattern.lines = 1;
    let Surface::Flat(pattern) = pattern(&far) else { panic!("a disc") };
    for zoom in [0.8, 1.1] {
        let near = Scenario {
            body: BodySetup { diameter_mm: zoom * far.body.diameter_mm, ..far.body.clone() },
            ..far.clone()
        };
        let sigma_px = total_sigma_px(near.camera.blur_px);
        let surface = Surface::Flat(pattern.zoomed(zoom, near.radius_px(), sigma_px));
        let moment = alone(pose(31.63, 31.88, 17.0));
        let shift = assert_agreement(&near, &surface, &moment, &format!("{zoom} times as large"));
        assert!(shift.iter().all(|part| part.abs() < 2e-4), "{shift:?}");
        let zoomed = Ball::new(&far, Surface::Flat(pattern.clone()), 255.0).zoomed(zoom).draw(&[moment], SIDE, 0..SIDE);
        let own = Ball::new(&near, surface, 255.0).draw(&[moment], SIDE, 0..SIDE);
        assert_eq!((zoomed.width, zoomed.coverage), (own.width, own.coverage));
        let apart = zoomed.light_dn.iter().zip(&own.light_dn).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(apart < 1e-3, "{apart} DN");
    }
}

#[test]
fn lines_are_drawn_within_half_a_grey_level() {
    let mut scenario = scenario();
    (scenario.body.pattern.lines, scenario.body.pattern.coverage) = (2, 0.25);
    assert_agreement(&scenario, &pattern(&scenario), &alone(pose(31.63, 31.88, 17.0)), "lines");
}

#[test]
fn a_speckled_ball_is_drawn_within_half_a_grey_level_and_not_shifted() {
    let scenario = scenario();
    let pattern = pattern(&scenario);
    for (x, y, angle_deg) in POSES {
        let what = format!("({x}, {y}), {angle_deg} deg");
        let shift = assert_agreement(&scenario, &pattern, &alone(pose(x, y, angle_deg)), &what);
        assert!(shift.iter().all(|part| part.abs() < 2e-4), "{shift:?}");
    }
}

#[test]
fn a_speckled_sphere_is_drawn_within_half_a_grey_level_and_not_shifted_at_any_orientation() {
    for (area_min_px2, area_max_px2, coverage) in [(2.0, 40.0, 0.4), (80.0, 80.0, 0.3)] {
        let mut scenario = scenario();
        scenario.body.pattern = PatternSetup { area_min_px2, area_max_px2, coverage, ..scenario.body.pattern };
        let sphere = sphere(&scenario);
        for (x, y, angle_deg) in POSES {
            for tilt in [[0.0, 0.0], [0.3, 0.0], [-0.7, 1.1]] {
                let mut pose = pose(x, y, angle_deg);
                pose.orientation = Orientation::from_rotation_vector([tilt[0], tilt[1], pose.angle_rad]);
                let what = format!("{area_max_px2} px^2 at ({x}, {y}), {angle_deg} deg, tilt {tilt:?}");
                let shift = assert_agreement(&scenario, &sphere, &alone(pose), &what);
                assert!(shift.iter().all(|part| part.abs() < 2e-4), "{shift:?}");
            }
        }
    }
}

#[test]
fn an_occluding_edge_in_front_of_the_ball_is_drawn_within_half_a_grey_level() {
    for coverage in [0.0, 0.4] {
        let mut scenario = scenario();
        scenario.body.pattern.coverage = coverage;
        for surface in [pattern(&scenario), sphere(&scenario)] {
            for (gap_px, tilt_deg) in [(3.0, 0.0f64), (0.0, 0.0), (-1.3, 12.0), (-4.3, 0.0), (-15.0, 40.0)] {
                let (sin, cos) = tilt_deg.to_radians().sin_cos();
                let normal = [-sin, -cos];
                let foot = scenario.radius_px() + gap_px;
                let flat = HalfPlane { point_px: [31.63 - foot * normal[0], 31.88 - foot * normal[1]], normal };
                let moment = Moment { occluder: Some(flat), ..alone(pose(31.63, 31.88, 25.0)) };
                assert_agreement(
                    &scenario,
                    &surface,
                    &moment,
                    &format!("coverage {coverage}, gap {gap_px} px, {tilt_deg} deg"),
                );
            }
        }
    }
}

#[test]
fn another_ball_in_front_is_drawn_within_half_a_grey_level() {
    let scenario = scenario();
    for surface in [pattern(&scenario), sphere(&scenario)] {
        for (radius_px, center_px) in [
            (17.0, [70.0, 31.0]),
            (17.0, [52.3, 12.7]),
            (20.0, [44.6, 36.1]),
            (12.0, [20.4, 40.8]),
            (30.0, [33.0, 31.0]),
        ] {
            let front = Some(DiscOutline { center_px, radius_px });
            let moment = Moment { front, ..alone(pose(31.63, 31.88, 25.0)) };
            assert_agreement(&scenario, &surface, &moment, &format!("front {radius_px} px at {center_px:?}"));
        }
    }
}

/// The ends of a narrow part are rounder than they should be, and so are panels at the rim and the middle of sectors. They
/// move with it.
#[test]
fn a_regular_pattern_is_drawn_where_it_is() {
    let both = &[Shape::Disc, Shape::Sphere][..];
    for (layout, repeats, shapes, max_dn, max_px) in [
        (Layout::Stripes, 4, both, 40.0, 2e-3),
        (Layout::Dots, 6, both, 15.0, 2e-3),
        (Layout::Football, 6, &both[1..], 40.0, 0.05),
        (Layout::Sectors, 5, both, 80.0, 0.02),
    ] {
        for shape in shapes.iter().copied() {
            let mut scenario = scenario();
            scenario.body.shape = shape;
            scenario.body.pattern = PatternSetup { coverage: 0.3, layout, repeats, ..scenario.body.pattern };
            let sigma_px = total_sigma_px(scenario.camera.blur_px);
            let paint =
                RegularPaint::new(&scenario.body.pattern, shape, scenario.radius_px(), sigma_px, Stream::new(5));
            let (surface, moment) = (Surface::Regular(paint.unwrap()), alone(pose(31.63, 31.88, 17.0)));
            let (worst_dn, shift) =
                compare_with_reference(&scenario, &surface, &moment, &format!("{layout:?} on {shape:?}"));
            let is_near = worst_dn < max_dn && shift.iter().all(|part| part.abs() < max_px);
            assert!(is_near, "{layout:?} on {shape:?}: {worst_dn} DN, {shift:?} px");
        }
    }
}
