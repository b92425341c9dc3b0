//! Collisions with a surface that is a body itself.

use crate::synth_physics::{Experiment, Noise, lacrosse, steps, tennis};
use ricochet::motion::{Form, MotionParams};
use ricochet::results::{BodyStep, Impact, Outline, OutlineShape, PointStatus};
use ricochet::track::{Tracker, TrackerParams, TrackerRows};

/// The noise of the patch on the surface.
const PATCH_SIGMA: (f64, f64, f64) = (0.004, 0.004, 40.0);

/// The last revision of the first impact of a ball on a surface that moves by `path` (px, y down) in each frame.
fn impact_on(experiment: &Experiment, path: impl Fn(f64) -> [f64; 2], turn_deg: f64, seed: u64) -> (Impact, f64) {
    let truth = Experiment { after_frames: 120, ..*experiment }.simulate(0.37);
    let mut noise = Noise::new(seed);
    let mut ball = truth.steps(1, &mut noise);
    let places: Vec<[f64; 3]> = (0..=ball.len())
        .map(|frame| path(frame as f64))
        .enumerate()
        .map(|(frame, [x, y])| [x, y, turn_deg * frame as f64])
        .collect();
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

/// A racket that turns moves faster at the point of contact than at its patch, and its numbers are not `valid`.
#[test]
fn an_impact_on_a_surface_that_turns_is_an_outlier() {
    for (turn_deg, status) in [(0.0, PointStatus::Valid), (0.02, PointStatus::Outlier)] {
        let (impact, _) = impact_on(&tennis(true), |t| [0.0, -0.1 * t], turn_deg, 3);
        assert_eq!(impact.status, status, "{turn_deg} deg per frame");
    }
}

#[test]
fn restitution_is_relative_to_a_surface_that_moves() {
    for experiment in [lacrosse(true), tennis(true)] {
        let px_per_frame = 1e3 / experiment.mm_per_px / experiment.frame_rate_hz;
        // Towards the ball and along the surface, m/s, and the growth of the first per frame.
        let cases = [
            ("at rest", [0.0, 0.0, 0.0]),
            ("up", [1.0, 0.3, 0.0]),
            ("down", [-0.5, -0.2, 0.0]),
            ("swung", [0.8, 0.0, 0.002]),
        ];
        for (name, [speed, along, growth]) in cases {
            let path = |t: f64| [along * px_per_frame * t, -px_per_frame * (speed * t + 0.5 * growth * t * t)];
            for seed in 0..4 {
                let (impact, truth) = impact_on(&experiment, path, 0.0, seed);
                let e = impact.restitution.expect("restitution");
                println!("{} {name} {seed}: {e:?}, truly {truth:.4}", experiment.name);
                assert!((e.value - truth).abs() < 4.0 * e.sigma && e.sigma < 0.02, "{name}: {e:?} truly {truth}");
                assert_eq!((impact.status, impact.gravity_m_s2), (PointStatus::Valid, None));
            }
        }
    }
}
