//! Partly occluded subsets of a ball.

use ricochet::config::Config;
use ricochet::image::Frame;
use ricochet::measure::{Measurer, Share};
use ricochet::results::PointStatus;
use ricochet::synth::{MotionSetup, OccluderSetup, PartSetup, Scenario, SimulatedFilm};

use crate::measured_world::level_rig;

const NORMAL_DEG: f64 = 35.0;
const EDGE_PX: [f64; 2] = [120.0, 128.0];
const SUBSET_PX: i32 = 31;

const START_PX: [f64; 2] = [137.3, 124.6];
const SPEED_PX: [f64; 2] = [-0.9, 0.35];
const OMEGA_DEG: f64 = 2.0;

/// A ball that moves behind an edge and rotates by 2 deg per frame, so that its reference is soon far from the frame.
fn world() -> SimulatedFilm {
    let mut scenario = Scenario { seed: 11, ..Scenario::built_in("lacrosse").unwrap() };
    (scenario.camera.frames, scenario.camera.width_px, scenario.camera.height_px) = (24, 256, 256);
    let (shade, texture, speed_px_frame) = (0.4, 0.03, 0.0);
    let (point_px, normal_deg) = (Some(EDGE_PX), Some(NORMAL_DEG));
    scenario.occluder =
        Some(OccluderSetup { shade, texture, point_px, normal_deg, speed_px_frame, ..OccluderSetup::default() });
    let tilt_deg_frame = [0.0; 2];
    let part = PartSetup {
        frames: 24.0,
        vx_px_frame: SPEED_PX[0],
        vy_px_frame: SPEED_PX[1],
        omega_deg_frame: OMEGA_DEG,
        tilt_deg_frame,
    };
    scenario.motion = MotionSetup::Piecewise { start_px: START_PX, parts: vec![part] };
    SimulatedFilm::new(&scenario).unwrap()
}

/// The displacement of a point of the ball from a frame to the next, px.
fn moved_px(frame: u64, [x, y]: [f64; 2]) -> [f64; 2] {
    let center = [0, 1].map(|axis| START_PX[axis] + frame as f64 * SPEED_PX[axis]);
    let ((sin, cos), [x, y]) = (OMEGA_DEG.to_radians().sin_cos(), [x - center[0], y - center[1]]);
    [SPEED_PX[0] + x * (cos - 1.0) + y * sin, SPEED_PX[1] - x * sin + y * (cos - 1.0)]
}

/// The share of the pixels around a point that lie behind the edge.
fn behind([x, y]: [f64; 2]) -> f64 {
    let (sin, cos) = NORMAL_DEG.to_radians().sin_cos();
    let half = SUBSET_PX / 2;
    let is_behind = |dx: i32, dy: i32| {
        let (x, y) = (x + f64::from(dx) - EDGE_PX[0], y + f64::from(dy) - EDGE_PX[1]);
        x * cos - y * sin < 0.0
    };
    let all = (-half..=half).flat_map(|dx| (-half..=half).map(move |dy| (dx, dy)));
    all.filter(|(dx, dy)| is_behind(*dx, *dy)).count() as f64 / f64::from(SUBSET_PX * SUBSET_PX)
}

/// With the significance test alone, subsets that lay one third behind the edge were accepted.
#[test]
fn occluded_subsets_are_left_out_and_no_others() {
    let world = world();
    let (width, height) = (world.width_px() as usize, world.height_px() as usize);
    for method in ["rigid", "field"] {
        let rig = format!("{}[rotation]\nmethod = \"{method}\"\n", level_rig(world.scenario().scale.mm_per_px));
        let config = Config::parse(&rig, "film.toml").unwrap();
        let format = ricochet::camera::simulated::stream_format(&world);
        let (params, _) = ricochet::process::analysis_params(&config, &format);
        let mut measurer = Measurer::new(&params, Share::ALL, width, height).unwrap();
        let (mut measured, mut bytes) = (Vec::new(), vec![0; world.frame_bytes()]);
        for index in 0..world.frames() {
            world.render(index, &mut bytes);
            let meta = ricochet::camera::simulated::meta(&world, index);
            measurer.push(&Frame { meta, bytes: &bytes }, &mut measured).unwrap();
        }
        measurer.finish(&mut measured);
        let (mut farthest, mut occluded, mut behind_edge, mut valid, mut wrong, mut clear) = (0.0_f64, 0, 0, 0, 0, 0);
        let fields = measured.iter().filter_map(|row| Some((row.step.frame, row.field.as_ref()?)));
        for (frame, point) in fields.flat_map(|(frame, field)| field.points.iter().map(move |point| (frame, point))) {
            let place = [point.x_px, point.y_px].map(f64::from);
            occluded += usize::from(point.status == PointStatus::Occluded);
            if let Some(moved) = point.displacement.filter(|_| point.status == PointStatus::Valid) {
                let [u, v] = moved_px(frame, place);
                let off = (f64::from(moved.u_px) - u).hypot(f64::from(moved.v_px) - v);
                farthest = farthest.max(off / f64::from(moved.sigma_u_px.hypot(moved.sigma_v_px)));
                valid += 1;
                behind_edge += usize::from(behind(place).max(behind([place[0] + u, place[1] + v])) > 0.1);
            }
            // Clear of the edge by more than its blur and the displacement to the next frame.
            if behind([place[0] - 3.0, place[1] - 3.0]).max(behind([place[0] - 4.0, place[1] + 3.0])) <= 0.0 {
                clear += 1;
                wrong += usize::from(point.status == PointStatus::Occluded);
            }
        }
        println!(
            "{method}: {occluded} subsets occluded; {behind_edge} of {valid} valid ones are more than a tenth behind the edge, \
             with errors up to {farthest:.1} sigma; {wrong} of {clear} clear ones left out"
        );
        assert!(occluded > 200 && 100 * behind_edge < valid && farthest < 4.0, "{method}");
        assert!(clear > 200 && 50 * wrong < clear, "{method}");
    }
}
