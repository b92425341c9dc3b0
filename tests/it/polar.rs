//! Rotations from rings against known truth: pairwise, partly occluded, and of balls that rotate far from frame to
//! frame.

use ricochet::synth::{MotionSetup, OccluderSetup, Scenario, SimulatedFilm};
use ricochet::track::TrackerRows;

use crate::measured_world::{level_rig, rows_of};

/// A ball of 114 px that rotates and hardly moves, in side light, on a textured background.
fn film(seed: u64, (vx, vy, spin_deg): (f64, f64, f64)) -> Scenario {
    let mut scenario = Scenario::translation(vx, vy, spin_deg);
    scenario.seed = seed;
    (scenario.camera.frames, scenario.camera.width_px, scenario.camera.height_px) = (24, 230, 230);
    scenario.body.diameter_mm = 114.0 * scenario.scale.mm_per_px;
    (scenario.light.side, scenario.light.limb) = (0.1, 0.1);
    if let MotionSetup::Constant { start_px, .. } = &mut scenario.motion {
        *start_px = [110.3, 112.7];
    }
    scenario
}

/// The root mean square errors of the rotation from frame to frame, in deg and in sigmas, and the number of steps.
fn judge(rows: &TrackerRows, spin_deg: f64) -> (f64, f64, usize) {
    let steps: Vec<_> = rows.velocities.iter().filter_map(|row| row.motion).collect();
    let rms = |of: &dyn Fn(&ricochet::results::MotionSample) -> f64| {
        (steps.iter().map(|step| of(step).powi(2)).sum::<f64>() / steps.len() as f64).sqrt()
    };
    let error = |step: &ricochet::results::MotionSample| step.dtheta_deg.unwrap() - spin_deg;
    (rms(&error), rms(&|step| error(step) / step.sigma_dtheta_deg.unwrap()), steps.len())
}

fn rig(scenario: &Scenario, rotation: &str) -> String {
    format!("{}[rotation]\n{rotation}\n", level_rig(scenario.scale.mm_per_px))
}

#[test]
fn the_ring_method_gives_the_spin_of_a_visible_ball_within_0_01_deg() {
    let cases = [
        ("", 0.005),
        ("ring_inner_px = 30\nring_outer_px = 50", 0.005),
        ("ring_inner_px = 20\nring_outer_px = 26", 0.01),
    ];
    for (limits, most_deg) in cases {
        for (seed, motion) in [(1, (0.13, 0.31, 0.35)), (2, (0.77, -0.53, 1.7)), (3, (-0.4, 0.23, 2.9))] {
            let scenario = film(seed, motion);
            let rows = rows_of(
                &SimulatedFilm::new(&scenario).unwrap(),
                &rig(&scenario, &format!("method = \"ring\"\n{limits}")),
            );
            let (rms, pull, count) = judge(&rows, motion.2);
            println!("ring {limits:?}, {} deg/frame: rms {rms:.5} deg, pull {pull:.2}, {count} steps", motion.2);
            assert!(rms <= most_deg && count == 23, "{limits:?} {motion:?}: {rms} {count}");
            assert!((0.6..1.5).contains(&pull), "{limits:?} {motion:?}: {pull}");
        }
    }
}

#[test]
fn the_ring_shrinks_in_front_of_an_occluder() {
    for occluded in [0.2, 0.35] {
        let mut scenario = film(1, (0.13, 0.31, 0.91));
        // The occluder comes in from the right, at first 2 px next to the ball.
        let point_px = Some([110.3 + 59.0, 112.7]);
        let speed_px_frame = (114.0 * occluded + 2.0) / 24.0;
        scenario.occluder = Some(OccluderSetup {
            shade: 0.1,
            texture: 0.0,
            point_px,
            normal_deg: Some(180.0),
            speed_px_frame,
            ..OccluderSetup::default()
        });
        let rows = rows_of(
            &SimulatedFilm::new(&scenario).unwrap(),
            &rig(&scenario, "method = \"ring\"\n[workers]\nblock_frames = 64"),
        );
        let (rms, pull, count) = judge(&rows, 0.91);
        let statuses: Vec<_> = rows.velocities.iter().map(|row| row.status).collect();
        println!("{occluded} occluded: rms {rms:.5} deg, pull {pull:.2}, {count} steps");
        assert!(rms <= 0.02 && count >= 20 && pull < 2.0, "{occluded}: {rms} {pull} {count} {statuses:?}");
    }
}

#[test]
fn a_ball_that_rotates_by_tens_of_degrees_per_frame_is_followed_by_every_method() {
    for (seed, spin_deg) in [(1, 12.7), (2, -31.3), (3, 97.1)] {
        for method in ["rigid", "field", "center", "ring"] {
            let scenario = film(seed, (0.61, -0.37, spin_deg));
            let rows =
                rows_of(&SimulatedFilm::new(&scenario).unwrap(), &rig(&scenario, &format!("method = \"{method}\"")));
            let (rms, pull, count) = judge(&rows, spin_deg);
            println!("{spin_deg} deg/frame by {method}: rms {rms:.5} deg, pull {pull:.2}, {count} steps");
            assert!(rms <= 0.02 && count == 23, "{spin_deg} {method}: {rms} {count}");
            assert!(pull < 2.0, "{spin_deg} {method}: {pull}");
        }
    }
}
