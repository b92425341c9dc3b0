//! `ricochet field --start any-angle`: bodies with large rotations and displacements.

use crate::support::{Rig, run};
use ricochet::command::field::{Begin, FieldOptions};
use ricochet::console::{Outcome, Overwrite};
use ricochet::dic::rigid_fit;
use ricochet::dic::{CorrelationParams, Shape};
use ricochet::failure::Failure;
use ricochet::results::{Displacement, FieldPoint, PointStatus};
use ricochet::synth::{MotionSetup, Scenario, SimulatedFilm};
use std::path::{Path, PathBuf};

const SIZE_PX: (u32, u32) = (320, 240);
/// The centre of the ball in the reference, and the square that is measured.
const CENTER_PX: [f64; 2] = [84.4, 104.7];
const RADIUS_PX: f64 = 60.0;
const ROI_PX: [u32; 4] = [43, 63, 83, 83];

/// Draws a ball that moves and rotates by this much from frame to frame, without interpolation.
pub fn write_frames(rig: &Rig, shift_px: [f64; 2], angle_deg: f64, frames: u64) -> Vec<PathBuf> {
    let mut scenario = Scenario::translation(0.0, 0.0, 0.0);
    (scenario.camera.width_px, scenario.camera.height_px, scenario.camera.frames) = (SIZE_PX.0, SIZE_PX.1, frames);
    scenario.body.diameter_mm = 2.0 * RADIUS_PX * scenario.scale.mm_per_px;
    scenario.motion = MotionSetup::Constant {
        vx_px_frame: shift_px[0],
        vy_px_frame: shift_px[1],
        omega_deg_frame: angle_deg,
        start_px: CENTER_PX,
    };
    let world = SimulatedFilm::new(&scenario).unwrap();
    let mut bytes = vec![0; world.frame_bytes()];
    let mut save = |index: u64| {
        world.render(index, &mut bytes);
        let path = rig.path(&format!("turned-{index}.png"));
        image::GrayImage::from_raw(SIZE_PX.0, SIZE_PX.1, bytes.clone()).unwrap().save(&path).unwrap();
        path
    };
    (0..frames).map(&mut save).collect()
}

/// The images before and after a rotation.
fn write_pair(rig: &Rig, shift_px: [f64; 2], angle_deg: f64) -> (PathBuf, PathBuf) {
    let frames = write_frames(rig, shift_px, angle_deg, 2);
    (frames[0].clone(), frames[1].clone())
}

fn measure(options: &FieldOptions) -> Result<Outcome, Failure> {
    ricochet::command::field::run(options)
}

fn options(pair: &(PathBuf, PathBuf), output: &Path) -> FieldOptions {
    FieldOptions {
        reference: pair.0.clone(),
        target: pair.1.clone(),
        later: Vec::new(),
        params: CorrelationParams { subset_size_px: 25, step_px: 8, ..CorrelationParams::default() },
        roi_px: Some(ROI_PX),
        region: None,
        partial: false,
        output: Some(output.to_owned()),
        json: false,
        picture: None,
        map: None,
        begin: Begin::AnyAngle,
        overwrite: Overwrite::ALLOWED,
    }
}

pub fn rows(path: &Path) -> Vec<FieldPoint> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let row = |row: csv::StringRecord| {
        let number = |column: usize| row[column].parse::<f32>().ok();
        let displacement = number(2).map(|u_px| Displacement {
            u_px,
            v_px: number(3).unwrap(),
            sigma_u_px: number(4).unwrap(),
            sigma_v_px: number(5).unwrap(),
        });
        let status = PointStatus::ALL.into_iter().find(|status| status.as_str() == &row[8]).unwrap();
        let (x_px, y_px) = (number(0).unwrap(), number(1).unwrap());
        FieldPoint { x_px, y_px, displacement, zncc: number(6), peak_ratio: None, status }
    };
    reader.records().map(|record| row(record.unwrap())).collect()
}

/// The position of a point of the ball after the motion.
fn moved((x, y): (f64, f64), shift_px: [f64; 2], angle_deg: f64) -> (f64, f64) {
    let (sin, cos) = angle_deg.to_radians().sin_cos();
    let (dx, dy) = (x - CENTER_PX[0], y - CENTER_PX[1]);
    (CENTER_PX[0] + shift_px[0] + cos * dx + sin * dy, CENTER_PX[1] + shift_px[1] - sin * dx + cos * dy)
}

/// The largest distance of a displacement from the truth, px.
pub fn farthest(field: &[FieldPoint], shift_px: [f64; 2], angle_deg: f64) -> f64 {
    let error = |point: &FieldPoint| {
        let found = point.displacement?;
        let (x, y) = (f64::from(point.x_px), f64::from(point.y_px));
        let (to_x, to_y) = moved((x, y), shift_px, angle_deg);
        Some((x + f64::from(found.u_px) - to_x).hypot(y + f64::from(found.v_px) - to_y))
    };
    field.iter().filter_map(error).fold(0.0, f64::max)
}

#[test]
fn every_window_of_a_body_with_a_large_motion_is_found() {
    let rig = Rig::new();
    let output = rig.path("field.csv");
    let cases = [
        ([0.37, -0.64], 30.0, Shape::Affine),
        ([151.3, 20.6], 30.0, Shape::Rigid),
        ([0.22, 0.69], 90.0, Shape::Rigid),
        ([160.4, -30.3], 90.0, Shape::Affine),
        ([140.7, 60.1], 170.0, Shape::Affine),
        ([1.44, -20.3], 170.0, Shape::Rigid),
        ([120.2, 11.3], -120.0, Shape::Quadratic),
    ];
    for (shift_px, angle_deg, shape) in cases {
        let pair = write_pair(&rig, shift_px, angle_deg);
        let mut options = options(&pair, &output);
        options.params.shape = shape;
        measure(&options).unwrap();
        let mut field = rows(&output);
        assert!(field.len() >= 49, "{} windows", field.len());
        for point in &field {
            assert_eq!(point.status, PointStatus::Valid, "{angle_deg} deg, {shape:?}: {point:?}");
        }
        let farthest = farthest(&field, shift_px, angle_deg);
        let fitted = rigid_fit(&mut field, CENTER_PX[0], CENTER_PX[1], 25).unwrap();
        let error_deg = fitted.angle_deg - angle_deg;
        println!(
            "{shift_px:?} px, {angle_deg} deg, {shape:?}: {} windows, angle error {error_deg:.4} deg, displacement {:.4} {:.4} px, \
             farthest window {farthest:.3} px",
            fitted.points,
            fitted.u_px - shift_px[0],
            fitted.v_px - shift_px[1]
        );
        assert!(error_deg.abs() < 0.01, "{angle_deg} deg: error {error_deg} deg");
        assert!((fitted.u_px - shift_px[0]).hypot(fitted.v_px - shift_px[1]) < 0.01, "{fitted:?}");
        // Second-order windows of 25 px scatter most.
        assert!(farthest < 0.04, "{angle_deg} deg, {shape:?}: {farthest} px");
        // Without the rotation search they are found at these angles by chance only.
        measure(&FieldOptions { begin: Begin::Neighbor, ..options }).unwrap();
        let valid = rows(&output).iter().filter(|point| point.status == PointStatus::Valid).count();
        assert!(valid * 10 < field.len(), "{angle_deg} deg needs its start: {valid}");
    }
}

#[test]
fn windows_that_left_the_image_are_reported_and_all_others_are_found() {
    let rig = Rig::new();
    let output = rig.path("field.csv");
    let (shift_px, angle_deg) = ([205.4, -11.3], 90.0);
    let pair = write_pair(&rig, shift_px, angle_deg);
    measure(&options(&pair, &output)).unwrap();
    let field = rows(&output);
    let (mut stayed, mut left) = (0, 0);
    for point in &field {
        let corner = |(dx, dy): (f64, f64)| {
            let (x, _) = moved((f64::from(point.x_px) + dx, f64::from(point.y_px) + dy), shift_px, angle_deg);
            x
        };
        let right =
            [(-12.0, -12.0), (12.0, -12.0), (-12.0, 12.0), (12.0, 12.0)].map(corner).into_iter().fold(0.0, f64::max);
        let edge_px = f64::from(SIZE_PX.0) - 1.0;
        // Within 0.01 px of the edge either is right.
        if right < edge_px - 0.01 {
            stayed += 1;
            assert_eq!(point.status, PointStatus::Valid, "{point:?}");
        } else if right > edge_px + 0.01 {
            left += 1;
            assert_eq!(point.displacement, None, "{point:?}");
        }
    }
    println!("{stayed} windows stayed, {left} left the image");
    assert!(stayed >= 20 && left >= 7, "{stayed} stayed, {left} left");
    assert!(farthest(&field, shift_px, angle_deg) < 0.04);
}

#[test]
fn without_a_region_the_middle_of_the_image_is_searched_for() {
    let rig = Rig::new();
    let output = rig.path("field.csv");
    for angle_deg in [30.0, -90.0] {
        let pair = write_pair(&rig, [31.3, 9.6], angle_deg);
        measure(&FieldOptions { roi_px: None, ..options(&pair, &output) }).unwrap();
        let field = rows(&output);
        let on_ball = |point: &&FieldPoint| {
            let (dx, dy) = (f64::from(point.x_px) - CENTER_PX[0], f64::from(point.y_px) - CENTER_PX[1]);
            (dx.abs() + 13.0).hypot(dy.abs() + 13.0) < RADIUS_PX - 2.0
        };
        let inside: Vec<FieldPoint> = field.iter().filter(on_ball).copied().collect();
        assert!(inside.len() >= 40, "{}", inside.len());
        assert!(inside.iter().all(|point| point.status == PointStatus::Valid), "{angle_deg} deg");
        assert!(farthest(&inside, [31.3, 9.6], angle_deg) < 0.04);
    }
}

#[test]
fn an_impossible_start_is_refused_in_one_line() {
    let rig = Rig::new();
    let (reference, target) = write_pair(&rig, [0.0, 0.0], 30.0);
    let blank = rig.path("blank.png");
    let noise = |x: u32, y: u32| image::Luma([((x * 7919 + y * 104_729 + x * y * 31) % 251) as u8]);
    image::GrayImage::from_fn(SIZE_PX.0, SIZE_PX.1, noise).save(&blank).unwrap();
    let refused = |target: &Path, rest: &[&str], wanted: &str| {
        let start = ["field", reference.to_str().unwrap(), target.to_str().unwrap(), "--start", "any-angle"];
        let output = run(start.iter().chain(rest));
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        assert!(stderr.lines().count() == 1 && stderr.contains(wanted), "{stderr}");
        assert!(output.stdout.is_empty());
    };
    refused(&blank, &["--roi", "43,63,83,83"], "blank.png: low-correlation");
    refused(&target, &["--roi", "43,63,35,35"], "the region is smaller than 40 px");
    refused(&target, &["--shape", "translation"], "needs subsets that can rotate, but the shape is translation");
    refused(&target, &["--method", "spline-fft"], "needs subsets that can rotate, but the method is spline-fft");
}
