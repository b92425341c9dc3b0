//! A plain ball that is not seen for a while: its rows are predicted, and no collision is measured from them.

use crate::measured_world::rows_of_pictures;
use ricochet::results::PointStatus;
use ricochet::synth::{MotionSetup, Scenario, SimulatedFilm};
use ricochet::track::TrackerRows;

const SIDE_PX: usize = 256;
const RADIUS_PX: f64 = 40.0;
const FRAMES: usize = 48;
/// The frame of the bounce, and the speed before and after it, px per frame.
const BOUNCE: f64 = 23.5;
const SPEEDS_PX: [f64; 2] = [2.6, -1.9];

const RIG: &str = r#"
[rig]
name = "plain"
[camera]
source = "simulated"
[scale]
mm_per_px = 1.0
[surface]
angle_deg = 0
[[body]]
name = "ball"
kind = "ball"
min_radius_px = 32
max_radius_px = 48
[velocity]
gravity_m_s2 = 0
"#;

fn center_px(frame: usize) -> [f64; 2] {
    let since = frame as f64 - BOUNCE;
    let speed_px = if since < 0.0 { SPEEDS_PX[0] } else { SPEEDS_PX[1] };
    [90.3 + 1.1 * frame as f64, 170.6 + speed_px * since]
}

/// Draws a lit ball before an even ground, with noise; outside `seen` only the ground.
fn picture(frame: usize, seen: &dyn Fn(usize) -> bool) -> Vec<u8> {
    let [x, y] = center_px(frame);
    let mut random = 7 + frame as u64;
    let pixel = |at: usize| {
        let [dx, dy] = [(at % SIDE_PX) as f64 - x, (at / SIDE_PX) as f64 - y];
        let covered = if seen(frame) { (RADIUS_PX - dx.hypot(dy) + 0.5).clamp(0.0, 1.0) } else { 0.0 };
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let noise = (random >> 40) as f64 / f64::from(1 << 24) - 0.5;
        let ball = 170.0 - 0.3 * dx - 0.5 * dy;
        (covered * ball + (1.0 - covered) * 45.0 + 5.0 * noise).round() as u8
    };
    (0..SIDE_PX * SIDE_PX).map(pixel).collect()
}

fn measure(seen: &dyn Fn(usize) -> bool) -> TrackerRows {
    let mut like = Scenario::translation(1.0, 1.0, 0.0);
    (like.camera.frames, like.camera.width_px, like.camera.height_px) = (FRAMES as u64, 256, 256);
    let [vx_px_frame, vy_px_frame, omega_deg_frame] = [1.0, 1.0, 0.0];
    like.motion = MotionSetup::Constant { vx_px_frame, vy_px_frame, omega_deg_frame, start_px: [128.0, 128.0] };
    let world = SimulatedFilm::new(&like).unwrap();
    rows_of_pictures((0..FRAMES).map(|frame| picture(frame, seen)), &world, RIG)
}

#[test]
fn a_position_without_an_outline_is_predicted_and_never_valid() {
    let is_hidden = |frame: usize| (19..31).contains(&frame);
    let rows = measure(&|frame| !is_hidden(frame));
    let mut predicted = 0;
    for (frame, (row, track)) in rows.velocities.iter().zip(&rows.tracks).enumerate() {
        let expected = match frame {
            19..27 => PointStatus::Predicted,
            27..31 => PointStatus::Lost,
            _ => PointStatus::Valid,
        };
        // The next block starts after the gap; until then nothing is known of the ball.
        let is_free = frame == 31;
        assert!(is_free || (row.status == expected && track.status == expected), "{frame}: {:?}", row.status);
        if row.status == PointStatus::Predicted {
            predicted += 1;
            assert!(row.motion.is_none() && row.velocity.is_none(), "{frame}: {row:?}");
            let [x, y] = center_px(frame);
            let (found, sigma) = (track.center_x_px.zip(track.center_y_px), track.sigma_center_px.unwrap());
            let (found_x, found_y) = found.unwrap();
            assert!((found_x - x).hypot(found_y - y) < 5.0 * sigma, "{frame}: {track:?}, truth {x} {y}");
        }
    }
    assert_eq!(predicted, 8);
}

#[test]
fn a_bounce_that_was_not_seen_is_measured_from_the_flights_and_not_from_predicted_positions() {
    let rows = measure(&|frame| !(20..28).contains(&frame));
    assert!(rows.velocities.iter().any(|row| row.status == PointStatus::Predicted));
    let last = rows.impacts.iter().max_by_key(|impact| impact.revision).expect("the ball bounced");
    let restitution = last.restitution.unwrap();
    let exact = -SPEEDS_PX[1] / SPEEDS_PX[0];
    println!("restitution {:.4} +- {:.4}, truth {exact:.4}", restitution.value, restitution.sigma);
    assert!((restitution.value - exact).abs() < 3.0 * restitution.sigma && restitution.sigma < 0.02);
}
