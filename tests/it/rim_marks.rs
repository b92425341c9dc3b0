//! Speckled spheres, whose marks become narrow towards the rim and leave hardly any of it clean.

#![expect(clippy::unwrap_used, clippy::print_stdout, reason = "a test fails by unwrapping and prints what it measured")]

use ricochet::ball::{BallFinder, BallParams};
use ricochet::image::ImageView;
use ricochet::results::Circle;
use ricochet::synth::{LightSetup, MotionSetup, PatternSetup, Scenario, ShadeSetup, Shape, SimulatedFilm};

use crate::measured_world::rows_of;

fn sphere(seed: u64) -> SimulatedFilm {
    SimulatedFilm::new(&Scenario { seed, ..Scenario::built_in("lacrosse-sphere").unwrap() }).unwrap()
}

fn found(world: &SimulatedFilm, frame: u64, [low, high]: [f64; 2]) -> Option<Circle> {
    let (width, height) = (world.width_px() as usize, world.height_px() as usize);
    let mut finder = BallFinder::new(&BallParams::new(low, high), width, height).unwrap();
    let mut bytes = vec![0; world.frame_bytes()];
    world.render(frame, &mut bytes);
    let grey: Vec<f32> = bytes.into_iter().map(f32::from).collect();
    finder.find(ImageView::new(&grey, width, height).unwrap())
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
}

fn within(pulls: &[f64], sigmas: f64) -> f64 {
    pulls.iter().filter(|pull| pull.abs() < sigmas).count() as f64 / pulls.len() as f64
}

/// From its clean parts alone, 75 of 140 such balls were not found, and the radius of the others was 0.12 px too small.
#[test]
fn a_speckled_sphere_is_found_with_an_unbiased_radius() {
    let (mut off, mut pulls, mut of_radius, mut of_radius_pulls) = (vec![], vec![], vec![], vec![]);
    for seed in 60..80 {
        let world = sphere(seed);
        for frame in (0..world.frames()).step_by(16) {
            let truth = world.truth(frame);
            let radius_px = truth.radius_px.unwrap();
            let circle = found(&world, frame, [0.9 * radius_px, 1.1 * radius_px]);
            let circle = circle.unwrap_or_else(|| panic!("seed {seed}, frame {frame}: no ball"));
            let center = [circle.x_px - truth.center_x_px.unwrap(), circle.y_px - truth.center_y_px.unwrap()];
            off.extend(center);
            pulls.extend(center.map(|off| off / circle.sigma_center_px));
            of_radius.push(circle.radius_px - radius_px);
            of_radius_pulls.push((circle.radius_px - radius_px) / circle.sigma_radius_px);
        }
    }
    let mean = of_radius.iter().sum::<f64>() / of_radius.len() as f64;
    let covered = [&pulls, &of_radius_pulls].map(|pulls| [1.0, 2.0].map(|sigmas| within(pulls, sigmas)));
    println!("centre {:.4} px rms, radius {:.4} rms, {mean:+.4} px; within {covered:.2?}", rms(&off), rms(&of_radius));
    assert!(rms(&off) < 0.04 && rms(&of_radius) < 0.04 && mean.abs() < 0.01, "{mean}");
    assert!(covered.iter().all(|[one, two]| *one > 0.6 && *two > 0.9), "{covered:?}");
}

/// A circle in speckled paint, too, has steps of one sign along more of it than chance explains.
#[test]
fn no_ball_is_found_in_speckled_paint() {
    for seed in 0..12 {
        let mut scenario = Scenario { seed, ..Scenario::translation(0.0, 0.0, 0.0) };
        let vary = |least: f64, most: f64, turn: u64| least + (most - least) * (seed * turn % 12) as f64 / 11.0;
        (scenario.camera.frames, scenario.camera.width_px, scenario.camera.height_px) = (1, 256, 224);
        scenario.camera.blur_px = vary(0.5, 1.6, 5);
        scenario.body.shape = Shape::Plane;
        scenario.body.diameter_mm = 400.0 * scenario.scale.mm_per_px;
        let area = vary(3.0, 60.0, 1);
        scenario.body.pattern = PatternSetup {
            area_min_px2: area / 3.0,
            area_max_px2: area,
            coverage: vary(0.2, 0.5, 7),
            ..scenario.body.pattern
        };
        scenario.shade = ShadeSetup { ball: 0.7, speckle: 0.15, ground: 0.1, ground_texture: 0.0 };
        scenario.light = LightSetup::default();
        scenario.motion = MotionSetup::Constant {
            vx_px_frame: 0.0,
            vy_px_frame: 0.0,
            omega_deg_frame: 0.0,
            start_px: [128.0, 112.0],
        };
        let world = SimulatedFilm::new(&scenario).unwrap();
        for radii in [[20.0, 28.0], [28.0, 40.0], [40.0, 65.0]] {
            let circle = found(&world, 0, radii);
            assert!(circle.is_none(), "seed {seed}, {radii:?}: {circle:?}");
        }
    }
}

/// In the first and the last two of these films, the ball was lost when contact began, and the last speed before it was
/// off by 42 and 39 sigma.
#[test]
fn a_speckled_sphere_is_followed_through_its_collision() {
    for seed in [63, 67, 71] {
        let world = sphere(seed);
        let rows = rows_of(&world, include_str!("../../config/lacrosse.toml"));
        let mut pulls = Vec::new();
        for row in &rows.velocities {
            let velocity = row.velocity.unwrap_or_else(|| panic!("seed {seed}, frame {}: no velocity", row.frame));
            let truth = world.truth(row.frame).velocity.unwrap();
            pulls.extend(
                [velocity.vn_m_s - truth.vn_m_s, velocity.vt_m_s - truth.vt_m_s].map(|off| off / velocity.sigma_v_m_s),
            );
        }
        let worst = pulls.iter().fold(0.0_f64, |most, pull| most.max(pull.abs()));
        let impact = rows.impacts.last().unwrap();
        println!("seed {seed}: {:.2} sigmas rms, worst {worst:.1}, law {:?}", rms(&pulls), impact.force_law);
        assert!(rms(&pulls) < 1.5 && worst < 4.0, "seed {seed}");
        assert_eq!(impact.force_law, world.impact().unwrap().force_law, "seed {seed}");
    }
}
