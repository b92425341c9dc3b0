//! Collisions with a surface that is a body itself.

use crate::synth_physics::{Experiment, Noise, lacrosse, steps, tennis};
use ricochet::motion::{Form, MotionParams};
use ricochet::results::{BodyStep, Impact, Outline, OutlineShape, PointStatus};
use ricochet::track::{Tracker, TrackerParams, TrackerRows};

/// The noise of the patch on the surface.
const PATCH_SIGMA: (f64, f64, f64) = (0.004, 0.004, 40.0);

/// The last revision of the first impact of a ball on a surface that moves by `path` (px, y down) in each frame.
fn impact_on(experiment: &Experiment, path: impl Fn(f64) -> [f64; 2], seed: u64) -> (Impact, f64) {
    let truth = Experiment { after_frames: 120, ..*experiment }.simulate(0.37);
    let mut noise = Noise::new(seed);
    let mut ball = truth.steps(1, &mut noise);
    let places: Vec<[f64; 3]> = (0..=ball.len()).map(|frame| path(frame as f64)).map(|[x, y]| [x, y, 0.0]).collect();
    let patch = steps(&places, 1, 1e9 / experiment.frame_rate_hz, PATCH_SIGMA, &mut noise);
    for (frame, step) in ball.iter_mut().enumerate() {
        let [here, next] = [places[frame], places[frame + 1]];
        if let Some(moved) = &mut step.motion {
            moved.dx_px += next[0] - here[0];
            moved.dy_px += next[1] - here[1];
        }
        if let Some(Outline { shape: OutlineShape::Circle(circle), .. }) = &mut step.outline {
            circle.x_px += here[0];
            circle.y_px += here[1];
        }
    }
    let params = experiment.params();
    let surface = MotionParams { form: Form::Patch, mass_kg: None, ..params.clone() };
    let mut tracker = Tracker::new(&TrackerParams {
        motion: vec![params, surface],
        longer_frames: vec![],
        contact: true,
        surface_body: Some(1),
    });
    let mut rows = TrackerRows::default();
    for (ball, patch) in ball.iter().zip(&patch) {
        tracker.push(ball, &mut rows);
        tracker.push(&BodyStep { body: 1, ..*patch }, &mut rows);
    }
    tracker.finish(&mut rows);
    assert!(rows.impacts.iter().all(|impact| impact.body == 0), "nothing strikes the ball");
    let first = rows.impacts.iter().rfind(|impact| impact.number == 0);
    (*first.expect("an impact"), -truth.after[0] / truth.before[0])
}

#[test]
fn restitution_is_relative_to_a_surface_that_moves() {
    for experiment in [lacrosse(true), tennis(true)] {
        let px_per_frame = 1e3 / experiment.mm_per_px / experiment.frame_rate_hz;
        // Against the ball, with it, and swung, each with a part along the surface, m/s.
        let up = |speed: f64, along: f64| move |t: f64| [along * px_per_frame * t, -speed * px_per_frame * t];
        let swung = |t: f64| [0.0, -px_per_frame * (0.8 * t + 0.001 * t * t)];
        let cases: [(&str, Box<dyn Fn(f64) -> [f64; 2]>); 4] = [
            ("at rest", Box::new(up(0.0, 0.0))),
            ("up", Box::new(up(1.0, 0.3))),
            ("down", Box::new(up(-0.5, -0.2))),
            ("swung", Box::new(swung)),
        ];
        for (name, path) in cases {
            for seed in 0..4 {
                let (impact, truth) = impact_on(&experiment, &path, seed);
                let e = impact.restitution.expect("restitution");
                println!("{} {name} {seed}: {e:?}, truly {truth:.4}", experiment.name);
                assert!((e.value - truth).abs() < 4.0 * e.sigma && e.sigma < 0.02, "{name}: {e:?} truly {truth}");
                assert_eq!((impact.status, impact.gravity_m_s2), (PointStatus::Valid, None));
            }
        }
    }
}
