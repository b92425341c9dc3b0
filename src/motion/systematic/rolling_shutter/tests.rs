//! Discs and rods imaged row after row, by the definition alone.

use super::*;
use crate::results::{PointStatus, ROD_EDGES, RodEdge};

const RADIUS_PX: f64 = 57.0;

/// A disc filmed by a rolling shutter, by the definition alone: the slow twin.
struct Film {
    row_time_frames: f64,
    /// Its speed at frame 0 and its change per frame, px.
    speed_px: [f64; 2],
    gain_px: [f64; 2],
    turn_rad: f64,
}

impl Film {
    fn center_px(&self, time: f64) -> [f64; 2] {
        [0, 1].map(|axis| [120.0, 90.0][axis] + time * (self.speed_px[axis] + 0.5 * time * self.gain_px[axis]))
    }

    fn turned([x, y]: [f64; 2], angle_rad: f64) -> [f64; 2] {
        let (sin, cos) = angle_rad.sin_cos();
        [cos * x + sin * y, cos * y - sin * x]
    }

    /// The position and time at which a frame shows a point of the disc.
    fn shown(&self, frame: u64, point_px: [f64; 2]) -> ([f64; 2], f64) {
        let mut time = frame as f64;
        let mut at = [0.0; 2];
        for _ in 0..60 {
            let (center, aside) = (self.center_px(time), Self::turned(point_px, self.turn_rad * time));
            at = [center[0] + aside[0], center[1] + aside[1]];
            time = frame as f64 + self.row_time_frames * at[1];
        }
        (at, time)
    }

    /// The point of the disc that a frame shows at a position.
    fn point_px(&self, frame: u64, at: [f64; 2]) -> [f64; 2] {
        let time = frame as f64 + self.row_time_frames * at[1];
        let center = self.center_px(time);
        Self::turned([at[0] - center[0], at[1] - center[1]], -self.turn_rad * time)
    }

    /// The outline and subsets from one frame to the next.
    fn step(&self, frame: u64) -> BodyStep {
        let (center, _) = self.shown(frame, [0.0; 2]);
        let rim = (0..360).map(|k| {
            let (sin, cos) = f64::from(k).to_radians().sin_cos();
            let (at, _) = self.shown(frame, [RADIUS_PX * cos, RADIUS_PX * sin]);
            (at[0] - center[0]).hypot(at[1] - center[1])
        });
        let radius_px = rim.sum::<f64>() / 360.0;
        let (mut moved, mut whirl, mut square, mut count) = ([0.0; 2], 0.0, 0.0, 0.0);
        for k in 0..2500 {
            let aside = [f64::from(k % 50) - 24.5, f64::from(k / 50) - 24.5].map(|px| px * RADIUS_PX / 25.0);
            if aside[0].hypot(aside[1]) > 0.88 * RADIUS_PX {
                continue;
            }
            let at = [center[0] + aside[0], center[1] + aside[1]];
            let (to, _) = self.shown(frame + 1, self.point_px(frame, at));
            let [u, v] = [to[0] - at[0], to[1] - at[1]];
            moved = [moved[0] + u, moved[1] + v];
            whirl += u * aside[1] - v * aside[0];
            square += aside[0].powi(2) + aside[1].powi(2);
            count += 1.0;
        }
        let step = RigidStep {
            dx_px: moved[0] / count,
            dy_px: moved[1] / count,
            dtheta_deg: (whirl / square).to_degrees(),
            ..RigidStep::STILL
        };
        let [x_px, y_px] = center;
        let (sigma_center_px, sigma_radius_px) = (0.0, 0.0);
        let circle = Circle { x_px, y_px, radius_px, sigma_center_px, sigma_radius_px, visible_fraction: 1.0 };
        BodyStep { frame, interval_frames: 1, outline: Some(circle.into()), motion: Some(step), ..BodyStep::default() }
    }
}

fn rolling(row_time_frames: f64) -> RollingShutter {
    RollingShutter::new(Shutter { row_time_frames, ..Shutter::default() }, Form::Ball)
}

fn node(angle_deg: f64) -> Pose {
    Pose {
        frame: 0,
        time_frames: 0.0,
        component: 0,
        turn: 0,
        pose: [0.0, 0.0, angle_deg],
        sigma: [0.0; 3],
        bridged: [0.0; 3],
        walk_share: [0.0; 3],
        kept: None,
    }
}

#[test]
fn a_ball_is_as_large_as_it_is_at_the_moment_its_centre_was_exposed() {
    for row_time_frames in [0.005, -0.005, 0.0] {
        for speed_px in [[3.0, 4.0], [-2.0, -6.0], [8.0, 0.0]] {
            let film = Film { row_time_frames, speed_px, gain_px: [0.0; 2], turn_rad: 0.0 };
            let mut rolling = rolling(row_time_frames);
            for frame in 0..6 {
                let step = film.step(frame);
                let later = rolling.push(&step);
                let straight = rolling.as_global_shutter(&step);
                let (seen, measured) = (step.circle().unwrap(), straight.circle().unwrap());
                let (_, time) = film.shown(frame, [0.0; 2]);
                assert!((frame as f64 + later - time).abs() < 1e-6, "{later} at {frame}, truly {time}");
                let (was, is) = (seen.radius_px - RADIUS_PX, measured.radius_px - RADIUS_PX);
                assert!(
                    is.abs() <= measured.sigma_radius_px + 1e-9 && measured.sigma_radius_px < 1.5,
                    "{was} {is} {measured:?}"
                );
                let by = row_time_frames * speed_px[1];
                assert!((was - 0.5 * by * RADIUS_PX).abs() < 0.1, "{was} px at {by}");
                // Periods between images make a step a speed.
                let measured_px = straight.motion.unwrap().dy_px / rolling.image_interval_periods();
                assert!((measured_px - speed_px[1]).abs() < 1e-6, "{measured_px} for {speed_px:?}");
            }
        }
    }
}

#[test]
fn a_ball_that_turns_does_not_sink() {
    for (row_time_frames, turn_rad) in [(0.005, 0.03), (0.005, -0.03), (-0.004, 0.06)] {
        let film = Film { row_time_frames, speed_px: [2.0, 3.0], gain_px: [0.0; 2], turn_rad };
        let mut rolling = rolling(row_time_frames);
        for frame in 0..4 {
            let step = film.step(frame);
            rolling.push(&step);
            let straight = rolling.as_global_shutter(&step);
            let truth = film.shown(frame + 1, [0.0; 2]).0[1] - film.shown(frame, [0.0; 2]).0[1];
            let (seen, measured) = (step.motion.unwrap().dy_px - truth, straight.motion.unwrap());
            let off = measured.dy_px - truth;
            assert!(seen * row_time_frames > 0.0, "downwards with the rows: {seen}");
            assert!(
                off.abs() < 0.25 * seen.abs() && off.abs() < 2.0 * measured.sigma_dy_px,
                "{off} of {seen}, {measured:?}"
            );
            assert!(
                (measured.dtheta_deg.to_radians() / turn_rad / rolling.image_interval_periods() - 1.0).abs() < 2e-3,
                "{measured:?}"
            );
        }
    }
}

#[test]
fn a_ball_that_is_pushed_aside_is_not_turned_by_it() {
    let film = Film { row_time_frames: 0.005, speed_px: [-3.0, 2.0], gain_px: [0.5, 0.0], turn_rad: 0.01 };
    let (mut rolling, mut angle_deg) = (rolling(0.005), 0.0);
    let (mut worst, mut seen) = (0.0_f64, 0.0_f64);
    let (_, first) = film.shown(0, [0.0; 2]);
    for frame in 0..12 {
        let step = film.step(frame);
        rolling.push(&step);
        let measured_deg = rolling.without_shear(node(angle_deg)).pose[2];
        let truth_deg = (film.turn_rad * (film.shown(frame, [0.0; 2]).1 - first)).to_degrees();
        // The first frame has no step before it.
        let off = measured_deg - truth_deg;
        worst = worst.max(if frame == 0 { 0.0 } else { off.abs() });
        seen = seen.max((angle_deg - truth_deg).abs());
        angle_deg += step.motion.unwrap().dtheta_deg;
    }
    assert!(seen > 0.5 && worst < 0.06, "{seen} {worst}");
}

#[test]
fn a_rod_has_its_edges_and_its_tilt_of_one_moment() {
    let (row_time_frames, speed_px, tilt_deg) = (0.004, [1.5, 5.0], 2.0_f64);
    // A disc represents the rod's centre line.
    let film = Film { row_time_frames, speed_px, gain_px: [0.0; 2], turn_rad: 0.0 };
    let slope = tilt_deg.to_radians().tan();
    let along = [-40.0, -10.0, 15.0, 50.0];
    let mut rolling = rolling(row_time_frames);
    for frame in 0..4 {
        let at = |along: f64| film.shown(frame, [along * slope, along]).0;
        let (middle, below) = (at(0.0), at(1.0));
        let sure = |value: f64| Estimate { value, sigma: 0.01 };
        let edge = |along: f64| Some(RodEdge { y_px: Some(sure(at(along)[1])), status: PointStatus::Valid });
        let edges: [Option<RodEdge>; ROD_EDGES] = along.map(edge);
        let rod = Rod {
            x_px: sure(middle[0]),
            // Another point represents it from the second frame on.
            y_px: sure(middle[1]),
            half_width_px: sure(12.0),
            tilt_deg: sure((below[0] - middle[0]).atan2(below[1] - middle[1]).to_degrees()),
            edges,
        };
        let next = film.shown(frame + 1, [0.0; 2]).0;
        let moved = RigidStep { dx_px: next[0] - middle[0], dy_px: next[1] - middle[1], ..RigidStep::STILL };
        let step = BodyStep {
            frame,
            interval_frames: 1,
            outline: Some(rod.into()),
            motion: Some(moved),
            ..BodyStep::default()
        };
        let later = rolling.push(&step);
        assert!((later - row_time_frames * middle[1]).abs() < 1e-9);
        let measured = rolling.as_global_shutter(&step).rod().unwrap();
        assert!((rod.tilt_deg.value - tilt_deg).abs() > 0.2, "{rod:?}");
        assert!((measured.tilt_deg.value - tilt_deg).abs() < 1e-6, "{measured:?}");
        for (edge, along) in measured.edges.iter().flatten().zip(along) {
            let off = edge.y_px.unwrap().value - middle[1] - along;
            assert!(off.abs() < 1e-6, "{along}: {off}");
        }
    }
}

#[test]
fn a_rod_represented_by_another_point_is_seen_when_it_was() {
    let mut rolling = rolling(0.004);
    let sure = |value: f64| Estimate { value, sigma: 0.01 };
    for frame in 0..6 {
        let point_px = 80.0 + 5.0 * frame as f64 + if frame >= 3 { 30.0 } else { 0.0 };
        let rod = Rod {
            x_px: sure(60.0),
            y_px: sure(point_px),
            half_width_px: sure(12.0),
            tilt_deg: sure(0.0),
            edges: [None; ROD_EDGES],
        };
        let moved = RigidStep { dy_px: 5.0, ..RigidStep::STILL };
        let later = rolling.push(&BodyStep {
            frame,
            interval_frames: 1,
            outline: Some(rod.into()),
            motion: Some(moved),
            ..BodyStep::default()
        });
        assert!((later - 0.004 * (80.0 + 5.0 * frame as f64)).abs() < 1e-9, "{frame}: {later}");
    }
}

#[test]
fn rows_that_are_exposed_at_once_change_nothing() {
    let film = Film { row_time_frames: 0.0, speed_px: [3.0, 4.0], gain_px: [0.2, -0.3], turn_rad: 0.02 };
    let mut rolling = RollingShutter::new(Shutter::default().over([640, 480]), Form::Ball);
    for frame in 0..3 {
        let step = film.step(frame);
        assert!(rolling.push(&step).abs() <= 0.0);
        assert_eq!(rolling.as_global_shutter(&step), step);
        assert_eq!(rolling.without_shear(node(1.5)), node(1.5));
    }
    let upwards = Shutter { row_time_frames: -0.001, ..Shutter::default() }.over([640, 480]);
    let later = RollingShutter::new(upwards, Form::Ball).push(&film.step(0));
    assert!((later - 0.001 * (479.0 - 90.0)).abs() < 1e-12, "the last row comes first: {later}");
}
