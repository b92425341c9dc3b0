//! The renderer's slow, obvious twin: sharp shapes on a 16 times finer grid,
//! folded with the lens's Gaussian and averaged over each pixel.

use super::blur::{normal_cdf, seen_sigma_px};
use super::draw::{Ball, HalfPlane, Moment};
use super::motion::Pose;
use super::random::Stream;
use super::scenario::{BodySetup, PatternSetup, ScaleSetup, Scenario};
use super::speckle::{Field, Pattern};

const FINE: usize = 16;
const SIDE: usize = 64;
const GROUND_DN: f64 = 30.0;
const BALL_DN: f64 = 191.25;
const SPECKLE_DN: f64 = 51.0;
const FLAT_DN: f64 = 97.0;

/// A ball of radius 23 px with speckles of 2 to 40 px^2.
fn scenario() -> Scenario {
    let pattern = PatternSetup { area_min_px2: 2.0, area_max_px2: 40.0, coverage: 0.4, lines: 0, line_width_px: 2.0 };
    Scenario {
        scale: ScaleSetup { mm_per_px: 1.0 },
        body: BodySetup { diameter_mm: 46.0, pattern, rod: None },
        ..Scenario::translation(0.0, 0.0, 0.0)
    }
}

fn pattern(scenario: &Scenario) -> Pattern {
    let sigma_px = seen_sigma_px(scenario.camera.blur_px);
    Pattern::strew(&scenario.body.pattern, Field::Disc(scenario.radius_px()), sigma_px, Stream::new(5)).unwrap()
}

fn pose(x: f64, y: f64, angle_deg: f64) -> Pose {
    Pose { center_px: [x, y], angle_rad: angle_deg.to_radians(), velocity_m_s: [0.0; 2], omega_rad_s: 0.0 }
}

/// The product's picture.
fn drawn(scenario: &Scenario, pattern: &Pattern, pose: &Pose, flat: Option<HalfPlane>) -> Vec<f64> {
    let sigma_px = seen_sigma_px(scenario.camera.blur_px);
    let ball = Ball::new(scenario, pattern.clone(), 255.0);
    let patch = ball.draw(&[Moment { pose: *pose, occluder: flat }], SIDE, SIDE);
    let mut picture: Vec<f64> = (0..SIDE * SIDE)
        .map(|index| {
            let (x, y) = ((index % SIDE) as f64, (index / SIDE) as f64);
            let free = flat.map_or(1.0, |flat| normal_cdf(flat.distance_px(x, y) / sigma_px));
            free * GROUND_DN + (1.0 - free) * FLAT_DN
        })
        .collect();
    for row in 0..patch.height {
        for column in 0..patch.width {
            let cell = row * patch.width + column;
            picture[(patch.top + row) * SIDE + patch.left + column] +=
                f64::from(patch.light_dn[cell]) - f64::from(patch.share[cell]) * GROUND_DN;
        }
    }
    picture
}

/// The twin's picture.
fn sampled(scenario: &Scenario, pattern: &Pattern, pose: &Pose, flat: Option<HalfPlane>) -> Vec<f64> {
    let pad = 4;
    let side = (SIDE + 2 * pad) * FINE;
    let place = |index: usize| (index as f64 + 0.5) / FINE as f64 - 0.5 - pad as f64;
    let (sin, cos) = pose.angle_rad.sin_cos();
    let turn = |[x, y]: [f64; 2]| [x * cos + y * sin, y * cos - x * sin];
    let discs: Vec<(f64, f64, f64)> = pattern
        .speckles
        .iter()
        .map(|speckle| {
            let x = pose.center_px[0] + speckle.x_px * cos + speckle.y_px * sin;
            let y = pose.center_px[1] - speckle.x_px * sin + speckle.y_px * cos;
            (x, y, pattern.radii_px[speckle.size])
        })
        .collect();
    // Share of a fine cell inside an edge that passes it at this distance.
    let inside = |distance_px: f64| (0.5 + distance_px * FINE as f64).clamp(0.0, 1.0);
    let mut ink = vec![0.0f64; side * side];
    for (x, y, radius) in discs {
        let span = |middle: f64| {
            let first = ((middle - radius + 0.5 + pad as f64) * FINE as f64).floor() as usize;
            first.saturating_sub(2)..(first + (2.0 * radius * FINE as f64) as usize + 4).min(side)
        };
        for row in span(y) {
            for column in span(x) {
                ink[row * side + column] += inside(radius - (place(column) - x).hypot(place(row) - y));
            }
        }
    }
    for line in &pattern.lines {
        let middle = turn(line.middle_px);
        let along = turn(line.along);
        for (index, ink) in ink.iter_mut().enumerate() {
            let (dx, dy) = (
                place(index % side) - pose.center_px[0] - middle[0],
                place(index / side) - pose.center_px[1] - middle[1],
            );
            let far = (dx * along[0] + dy * along[1]).abs();
            let wide = (dx * along[1] - dy * along[0]).abs();
            *ink += inside(line.half_length_px - far) * inside(line.half_width_px - wide);
        }
    }
    let sharp: Vec<f64> = (0..side * side)
        .map(|index| {
            let (x, y) = (place(index % side), place(index / side));
            let ball = inside(scenario.radius_px() - (x - pose.center_px[0]).hypot(y - pose.center_px[1]));
            let free = flat.map_or(1.0, |flat| inside(flat.distance_px(x, y)));
            let seen = ball * (BALL_DN + (SPECKLE_DN - BALL_DN) * ink[index].min(1.0)) + (1.0 - ball) * GROUND_DN;
            free * seen + (1.0 - free) * FLAT_DN
        })
        .collect();
    let weights = kernel(scenario.camera.blur_px);
    let rows = folded(&sharp, side, pad, &weights);
    let columns = folded(&turned(&rows, SIDE, side), side, pad, &weights);
    turned(&columns, SIDE, SIDE)
}

/// Gaussian of the lens folded with the pixel's box, on the fine grid.
fn kernel(blur_px: f64) -> Vec<f64> {
    let sigma = blur_px * FINE as f64;
    let reach = (pad_reach() * FINE) as i32;
    let weights: Vec<f64> = (-reach..reach)
        .map(|step| {
            let middle = f64::from(step) + 0.5;
            let half = 0.5 * FINE as f64;
            // A fine cell's share of the pixel, after the lens.
            normal_cdf((middle + half) / sigma) - normal_cdf((middle - half) / sigma)
        })
        .collect();
    let sum: f64 = weights.iter().sum();
    weights.into_iter().map(|weight| weight / sum).collect()
}

fn pad_reach() -> usize {
    4
}

/// Folds every row and keeps one value for each pixel.
fn folded(values: &[f64], side: usize, pad: usize, weights: &[f64]) -> Vec<f64> {
    let rows = values.len() / side;
    (0..rows * SIDE)
        .map(|index| {
            let (row, pixel) = (index / SIDE, index % SIDE);
            // The pixel's middle lies between two fine cells.
            let first = row * side + (pixel + pad) * FINE + FINE / 2 - weights.len() / 2;
            values[first..first + weights.len()].iter().zip(weights).map(|(value, weight)| value * weight).sum()
        })
        .collect()
}

/// Rows become columns.
fn turned(values: &[f64], width: usize, height: usize) -> Vec<f64> {
    (0..width * height).map(|index| values[(index % height) * width + index / height]).collect()
}

/// Shift along x and y that best explains `picture` as a moved `twin`, px.
fn shift_px(picture: &[f64], twin: &[f64]) -> [f64; 2] {
    let mut sums = [0.0; 5];
    for row in 1..SIDE - 1 {
        for column in 1..SIDE - 1 {
            let index = row * SIDE + column;
            let gx = 0.5 * (twin[index + 1] - twin[index - 1]);
            let gy = 0.5 * (twin[index + SIDE] - twin[index - SIDE]);
            let change = picture[index] - twin[index];
            for (sum, term) in sums.iter_mut().zip([gx * gx, gx * gy, gy * gy, gx * change, gy * change]) {
                *sum += term;
            }
        }
    }
    let [xx, xy, yy, x, y] = sums;
    let determinant = xx * yy - xy * xy;
    [-(yy * x - xy * y) / determinant, -(xx * y - xy * x) / determinant]
}

fn largest(picture: &[f64], twin: &[f64]) -> (f64, usize) {
    let differences = picture.iter().zip(twin).map(|(left, right)| (left - right).abs()).enumerate();
    differences.fold((0.0, 0), |best, (index, value)| if value > best.0 { (value, index) } else { best })
}

#[test]
fn lines_are_drawn_within_half_a_grey_level() {
    let mut scenario = scenario();
    (scenario.body.pattern.lines, scenario.body.pattern.coverage) = (2, 0.25);
    let pattern = pattern(&scenario);
    let pose = pose(31.63, 31.88, 17.0);
    let (picture, twin) = (drawn(&scenario, &pattern, &pose, None), sampled(&scenario, &pattern, &pose, None));
    let (worst_dn, index) = largest(&picture, &twin);
    assert!(worst_dn <= 0.5, "{worst_dn} DN at {} {}", index % SIDE, index / SIDE);
}

#[test]
fn a_speckled_ball_is_drawn_within_half_a_grey_level_and_not_shifted() {
    let scenario = scenario();
    let pattern = pattern(&scenario);
    let mut shifts = Vec::new();
    for (x, y, angle_deg) in [(31.5, 31.5, 0.0), (31.63, 31.88, 17.0), (32.02, 31.25, 63.0), (31.9, 32.4, -140.0)] {
        let pose = pose(x, y, angle_deg);
        let (picture, twin) = (drawn(&scenario, &pattern, &pose, None), sampled(&scenario, &pattern, &pose, None));
        let (worst_dn, index) = largest(&picture, &twin);
        let shift = shift_px(&picture, &twin);
        eprintln!(
            "({x}, {y}), {angle_deg} deg: {worst_dn:.3} DN at {} {}, shift {shift:.6?} px",
            index % SIDE,
            index / SIDE
        );
        assert!(worst_dn <= 0.5, "{worst_dn} DN at {} {}", index % SIDE, index / SIDE);
        shifts.push(shift);
    }
    for shift in shifts {
        assert!(shift.iter().all(|part| part.abs() < 2e-4), "{shift:?}");
    }
}

#[test]
fn the_flat_in_front_of_the_ball_is_drawn_within_half_a_grey_level() {
    for coverage in [0.0, 0.4] {
        let mut scenario = scenario();
        scenario.body.pattern.coverage = coverage;
        let pattern = pattern(&scenario);
        for (gap_px, tilt_deg) in [(3.0, 0.0f64), (0.0, 0.0), (-1.3, 12.0), (-4.3, 0.0), (-15.0, 40.0)] {
            let (sin, cos) = tilt_deg.to_radians().sin_cos();
            let normal = [-sin, -cos];
            let foot = scenario.radius_px() + gap_px;
            let flat = HalfPlane { point_px: [31.63 - foot * normal[0], 31.88 - foot * normal[1]], normal };
            let pose = pose(31.63, 31.88, 25.0);
            let picture = drawn(&scenario, &pattern, &pose, Some(flat));
            let twin = sampled(&scenario, &pattern, &pose, Some(flat));
            let (worst_dn, index) = largest(&picture, &twin);
            let place = (index % SIDE, index / SIDE);
            eprintln!("coverage {coverage}, gap {gap_px} px, {tilt_deg} deg: {worst_dn:.3} DN at {place:?}");
            assert!(worst_dn <= 0.5, "gap {gap_px}: {worst_dn} DN at {place:?}");
        }
    }
}
