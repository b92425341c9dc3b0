//! Centres that leave their poses, by made-up steps and outlines.

use super::*;
use crate::results::MotionMethod;

const FLIGHT: Regime = Regime::Flight { from: 0, to: u64::MAX };

fn node(frame: u64) -> Pose {
    Pose {
        frame,
        time_frames: frame as f64,
        component: 0,
        turn: 0,
        pose: [1.5 * frame as f64, 0.0, 0.0],
        sigma: [1e-3; 3],
        bridged: [0.0; 3],
        walk_share: [0.0; 3],
        kept: None,
    }
}

fn circle(frame: u64, [x, y]: [f64; 2]) -> Circle {
    let (x_px, y_px) = (90.0 + 1.5 * frame as f64 + x, 80.0 + y);
    Circle { x_px, y_px, radius_px: 57.0, sigma_center_px: 0.03, sigma_radius_px: 0.03, visible_fraction: 1.0 }
}

fn step(frame: u64, [x, y]: [f64; 2]) -> BodyStep {
    let along = |value: f64, sigma: f64| Estimate { value, sigma };
    BodyStep {
        frame,
        stamp_ns: frame,
        interval_frames: 1,
        motion: Some(RigidStep { dx_px: 1.5, ..RigidStep::STILL }),
        method: MotionMethod::WholeBody,
        drift: Some([along(x, 0.01), along(y, 0.01), along(0.0, 0.005)]),
        ..BodyStep::default()
    }
}

/// Zero-mean scatter, up to 1.
fn scatter(frame: u64) -> f64 {
    ((frame * 37 % 17) as f64 - 8.0) / 8.0
}

fn steps(drift_px: [f64; 2]) -> OutlineDrift {
    let mut drift = OutlineDrift::default();
    for frame in 0..100 {
        drift.push_step(frame as f64, &step(frame, drift_px.map(|px| px + 0.015 * scatter(frame))));
    }
    drift
}

fn outlines(drift_px: [f64; 2], frames: u64) -> OutlineDrift {
    let mut drift = OutlineDrift::default();
    for frame in 0..frames {
        let place = drift_px.map(|px| px * frame as f64 + 0.04 * scatter(frame));
        drift.push(&node(frame), &circle(frame, place));
    }
    drift
}

#[test]
fn steps_and_outlines_both_show_how_a_centre_leaves_its_poses() {
    for drift in [steps([-0.21, 0.05]), outlines([-0.21, 0.05], 100)] {
        let [x, y, _] = drift.significant(0.0, 99.0).unwrap();
        assert!((x.value + 0.21).abs() < 3.0 * x.sigma && x.sigma < 5e-3, "{x:?}");
        assert!((y.value - 0.05).abs() < 3.0 * y.sigma && y.sigma < 5e-3, "{y:?}");
    }
    assert_eq!(OutlineDrift::default().significant(0.0, 99.0), None, "nothing is seen");
}

#[test]
fn a_ball_whose_drift_nobody_sees_is_as_unsure_as_balls_turn() {
    let mut drift = OutlineDrift::default();
    drift.push(&node(0), &circle(0, [0.0; 2]));
    for frame in 0..40 {
        let outline = Some(circle(frame, [0.0; 2]).into());
        drift.push_step(frame as f64, &BodyStep { drift: None, outline, ..step(frame, [0.0; 2]) });
    }
    assert_eq!(drift.significant(0.0, 39.0), None);
    let [x, _, _] = drift.expected(0.0, 39.0).unwrap();
    assert!(x.value.abs() <= 0.0 && (x.sigma - ROTATING_SHARE.sqrt() * 1.5).abs() < 1e-9, "{x:?}");
    let center_uncertainty_px = drift.center_uncertainty_px(&node(20), &drift.local_drift(&node(20), FLIGHT));
    assert!((center_uncertainty_px - 20.0 * x.sigma).abs() < 1e-9, "{center_uncertainty_px}");
}

#[test]
fn what_may_be_chance_is_left_out() {
    for drift in [steps([0.002, -0.001]), outlines([1e-4, -2e-4], 100)] {
        let measured = drift.significant(0.0, 99.0).unwrap();
        assert!(measured.iter().all(|drift| drift.value.abs() <= 0.0 && drift.sigma.abs() < 1e-5), "{measured:?}");
        assert_eq!(drift.center(&node(50), &drift.local_drift(&node(50), FLIGHT)), None);
    }
}

#[test]
fn outlines_that_err_alike_for_a_while_count_less() {
    let mut drift = OutlineDrift::default();
    for frame in 0..100 {
        let slow = 0.05 * (frame as f64 / 30.0).sin();
        drift.push(&node(frame), &circle(frame, [slow, slow]));
    }
    let measured = drift.significant(0.0, 40.0).unwrap();
    assert!(measured.iter().all(|drift| drift.value.abs() < 1e-3), "{measured:?}");
}

#[test]
fn a_centre_is_where_its_outlines_are_when_a_blow_makes_it_leave_its_poses() {
    let mut drift = OutlineDrift::default();
    let since = |frame: u64| frame.saturating_sub(30) as f64;
    for frame in 0..100 {
        let rate = if frame < 30 { [0.0; 2] } else { [0.09, 0.37] };
        drift.push_step(frame as f64, &step(frame, rate));
        if frame % 4 == 0 {
            drift.push(&node(frame), &circle(frame, [0.09 * since(frame), 0.37 * since(frame)]));
        }
    }
    for frame in 0..100 {
        let Some(center) = drift.center(&node(frame), &drift.local_drift(&node(frame), FLIGHT)) else { continue };
        let off = [
            center.x_px - (90.0 + 1.5 * frame as f64 + 0.09 * since(frame)),
            center.y_px - (80.0 + 0.37 * since(frame)),
        ];
        let sigma = center.sigma_px;
        assert!(off.iter().all(|off| off.abs() < 3.0 * sigma) && sigma < 1.0, "{frame}: off {off:?}, {sigma}");
        assert!(frame.abs_diff(30) < 8 || off[1].abs() < 0.2, "{frame}: off {off:?}");
    }
    assert!(drift.center(&node(80), &drift.local_drift(&node(80), FLIGHT)).is_some());
    for frame in 0..100 {
        let true_px = if frame < 30 { [0.0; 2] } else { [0.09, 0.37] };
        let moved = OutlineDrift::apply_to_step(
            RigidStep { dx_px: 1.5, ..RigidStep::STILL },
            None,
            &drift.local_drift(&node(frame), FLIGHT),
        );
        let off = [moved.dx_px - 1.5 - true_px[0], moved.dy_px - true_px[1]];
        let sigma = [moved.sigma_dx_px, moved.sigma_dy_px];
        assert!((0..2).all(|k| off[k].abs() <= 3.0 * sigma[k] + 1e-9), "{frame}: off {off:?}, {sigma:?}");
        assert!(frame.abs_diff(30) < 12 || sigma[1] < 0.03, "{frame}: {sigma:?}");
    }
}

#[test]
fn a_centre_goes_on_where_its_outline_is_not_seen() {
    let mut drift = outlines([-0.2, 0.0], 40);
    for frame in 0..100 {
        drift.push_step(frame as f64, &step(frame, [-0.2, 0.0]));
    }
    for frame in [20, 60, 90] {
        let center = drift.center(&node(frame), &drift.local_drift(&node(frame), FLIGHT)).unwrap();
        let off = center.x_px - (90.0 + 1.3 * frame as f64);
        assert!(off.abs() < 3.0 * center.sigma_px && center.sigma_px < 0.3, "{frame}: off {off}, {center:?}");
    }
    let contact = Regime::Contact { from: 60, to: Some(80), acceleration_px: 0.0, speed_px: 1.5 };
    let still = |value: f64| Estimate { value, sigma: 1e-3 };
    let rates = PixelRates { x: still(1.5), y: still(0.0), theta: still(0.1), window_frames: 9, order: 2 };
    let (flies, touches) = (
        OutlineDrift::apply_to_rates(rates, &drift.local_drift(&node(50), FLIGHT)),
        OutlineDrift::apply_to_rates(rates, &drift.local_drift(&node(70), contact)),
    );
    assert!((flies.x.value - 1.3).abs() < 3.0 * flies.x.sigma && flies.x.sigma < 0.01, "{flies:?}");
    assert!((touches.x.value - 1.3).abs() < 0.01 && touches.x.sigma > 0.09, "a contact turns it: {touches:?}");
    let moved = OutlineDrift::apply_to_step(
        RigidStep { dx_px: 1.5, ..RigidStep::STILL },
        None,
        &drift.local_drift(&node(50), FLIGHT),
    );
    assert!((moved.dx_px - 1.3).abs() < 3.0 * moved.sigma_dx_px && moved.sigma_dx_px < 0.01, "{moved:?}");
}

#[test]
fn the_noise_of_steps_that_share_a_frame_takes_itself_back() {
    let mut drift = OutlineDrift::default();
    for frame in 0..40 {
        // The error of a frame is in the step to it and, with the opposite sign, in the step from it.
        let noise = 0.007 * (scatter(frame + 1) - scatter(frame));
        drift.push_step(frame as f64, &step(frame, [0.012 + noise, noise]));
    }
    let [x, y, turn] = drift.significant(0.0, 39.0).unwrap();
    assert!((x.value - 0.012).abs() < 3.0 * x.sigma && x.sigma < 2e-3, "{x:?}");
    assert!(y.value.abs() < 3.0 * y.sigma && turn.value.abs() < 3.0 * turn.sigma, "{y:?} {turn:?}");
}

/// The drift of a ball whose steps rotate by an additional 0.03 deg per frame.
fn turning(drift_px: f64) -> OutlineDrift {
    let mut drift = OutlineDrift::default();
    for frame in 0..40 {
        let mut step = step(frame, [drift_px, 0.0]);
        step.drift.as_mut().unwrap()[2].value = 0.03;
        drift.push_step(frame as f64, &step);
    }
    drift
}

#[test]
fn what_turns_beside_its_steps_is_taken_out_where_it_surely_tumbles() {
    let measured = |drift_px: f64| {
        let drift = turning(drift_px);
        let rates = PixelRates { x: NO_DRIFT, y: NO_DRIFT, theta: NO_DRIFT, window_frames: 9, order: 2 };
        OutlineDrift::apply_to_rates(rates, &drift.local_drift(&node(20), FLIGHT)).theta
    };
    let (tumbles, flat) = (measured(0.2), measured(0.0));
    assert!((tumbles.value - 0.03).abs() < 3.0 * tumbles.sigma && tumbles.sigma < 3e-3, "{tumbles:?}");
    assert!(flat.value.abs() < 1e-9, "{flat:?}");
}

#[test]
fn a_step_that_an_impact_falls_into_has_its_own_drift() {
    let drift = steps([0.2, 0.0]);
    let moved = RigidStep { dx_px: 1.5, ..RigidStep::STILL };
    let own = step(50, [0.45, 0.0]).drift;
    let [even, struck] =
        [None, own].map(|own| OutlineDrift::apply_to_step(moved, own, &drift.local_drift(&node(50), FLIGHT)).dx_px);
    assert!((even - 1.7).abs() < 0.01 && (struck - 1.95).abs() < 1e-9, "{even} {struck}");
}

#[test]
fn an_angle_says_what_its_steps_turn_beside_it() {
    let [tumbles, flat] = [0.2, 0.0].map(|drift_px| {
        let drift = turning(drift_px);
        drift.angle_uncertainty_deg(&node(30), &drift.local_drift(&node(30), FLIGHT))
    });
    assert!((tumbles - 0.9).abs() < 0.01 && flat.abs() < 1e-9, "{tumbles} {flat}");
}
