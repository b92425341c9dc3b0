//! Velocities and tracks against simulated truth.

use ricochet::motion::{MotionParams, Scale};
use ricochet::results::{BodyStep, MotionSample, Phase, PointStatus, VelocitySample};
use ricochet::track::{Tracker, TrackerParams, TrackerRows};

use crate::impact::track;
use crate::synth_physics::{Experiment, Noise, Truth, lacrosse, rod, steps, tennis};

fn params() -> MotionParams {
    MotionParams { gravity_m_s2: 0.0, ..lacrosse(true).params() }
}

/// A body in uniform motion, without noise.
fn uniform(n: usize, frames: usize, rate: [f64; 3]) -> Vec<BodyStep> {
    let pose = |i: usize| std::array::from_fn(|k| 100.0 + rate[k] * i as f64);
    let poses: Vec<_> = (0..frames).map(pose).collect();
    let mut steps = steps(&poses, n, 1e5, (0.0, 0.0, 50.0), &mut Noise::new(3));
    for step in &mut steps {
        if let Some(s) = &mut step.motion {
            (s.sigma_dx_px, s.sigma_dy_px, s.sigma_dtheta_deg) = (0.0015, 0.0015, 0.002);
        }
    }
    steps
}

fn assert_uniform(rows: &TrackerRows, rate: [f64; 3], frames: usize) {
    assert_eq!((rows.velocities.len(), rows.tracks.len()), (frames, frames));
    assert!(rows.impacts.is_empty());
    for row in &rows.velocities {
        let v = row.velocity.unwrap_or_else(|| panic!("frame {} has no velocity", row.frame));
        let px = 0.5142e-3 * 1e4;
        assert!((v.vx_m_s - rate[0] * px).abs() < 1e-9, "frame {}: {v:?}", row.frame);
        assert!((v.vy_m_s + rate[1] * px).abs() < 1e-9, "frame {}: {v:?}", row.frame);
        assert!((v.omega_rad_s.unwrap() - rate[2].to_radians() * 1e4).abs() < 1e-6, "frame {}: {v:?}", row.frame);
        assert!(v.sigma_v_m_s > 0.0 && v.sigma_omega_rad_s.unwrap() > 0.0);
    }
}

#[test]
fn uniform_motion_is_exact_for_every_frame_interval_and_window() {
    let rate = [0.37, -0.2, 0.35];
    for n in [1, 2, 5] {
        for window_frames in [None, Some(9), Some(21)] {
            for order in [1, 2, 4] {
                let p = MotionParams { window_frames, order, interval_frames: n as u32, ..params() };
                assert_uniform(&track(&uniform(n, 60, rate), &p), rate, 60);
            }
        }
    }
}

#[test]
fn a_gap_does_not_change_uniform_motion() {
    let rate = [0.37, -0.2, 0.35];
    let mut steps = uniform(1, 60, rate);
    for step in &mut steps[20..24] {
        (step.motion, step.outline, step.status) = (None, None, PointStatus::Lost);
    }
    let rows = track(&steps, &params());
    for (row, track) in rows.velocities.iter().zip(&rows.tracks) {
        let lost = (20..24).contains(&row.frame);
        assert_eq!(row.velocity.is_none(), lost, "frame {}", row.frame);
        assert_eq!(row.status == PointStatus::Lost, lost);
        assert_eq!(track.center_x_px.is_none() && track.angle_deg.is_none(), lost);
        if let (Some(v), Some(angle)) = (row.velocity, track.angle_deg) {
            assert!((v.vx_m_s - rate[0] * 5.142).abs() < 1e-9, "frame {}", row.frame);
            assert!((angle - rate[2] * row.frame as f64).abs() < 1e-9, "frame {}", row.frame);
        }
    }
    let before = rows.tracks[19].sigma_angle_deg.unwrap();
    assert!(rows.tracks[24].sigma_angle_deg.unwrap() > 2.0 * before, "the gap is not known exactly");
}

#[test]
fn true_stamps_count_not_frame_numbers() {
    // Frame times jitter by 20 %, and the motion is uniform in time.
    let mut noise = Noise::new(5);
    let times: Vec<f64> = (0..60).map(|i| f64::from(i) + 0.4 * (noise.uniform() - 0.5)).collect();
    let poses: Vec<_> = times.iter().map(|t| [0.3 * t, 0.1 * t, 0.02 * t]).collect();
    let mut steps = steps(&poses, 1, 1e5, (0.0, 0.0, 50.0), &mut noise);
    for (step, t) in steps.iter_mut().zip(&times) {
        step.stamp_ns = 1_000_000_000 + ((t + 1.0) * 1e5).round() as u64;
        if let Some(s) = &mut step.motion {
            (s.sigma_dx_px, s.sigma_dy_px, s.sigma_dtheta_deg) = (0.0015, 0.0015, 0.002);
        }
    }
    for row in track(&steps, &params()).velocities {
        let v = row.velocity.unwrap();
        assert!((v.vx_m_s - 0.3 * 5.142).abs() < 1e-4, "frame {}: {v:?}", row.frame);
    }
}

#[test]
fn the_scale_of_a_ball_comes_from_its_outline() {
    let mut p = params();
    p.scale = Scale::BallDiameterMm(63.25);
    let rows = track(&uniform(1, 40, [0.3, 0.0, 0.0]), &p);
    let v = rows.velocities[20].velocity.unwrap();
    assert!((v.vx_m_s - 0.3 * 63.25e-3 / 100.0 * 1e4).abs() < 1e-9, "{v:?}");
    assert!(v.sigma_v_m_s > v.vx_m_s * 0.02 / 50.0, "the scale is not exact");
}

#[test]
fn the_centre_moves_like_the_steps_and_lies_where_the_outlines_are() {
    let truth = lacrosse(true).simulate(0.3);
    let rows = track(&truth.steps(1, &mut Noise::new(9)), &truth.experiment.params());
    let image = truth.image_poses();
    let errors: Vec<[f64; 2]> = rows
        .tracks
        .iter()
        .zip(&image)
        .map(|(t, p)| [t.center_x_px.unwrap() - p[0], t.center_y_px.unwrap() - p[1]])
        .collect();
    for (e, t) in errors.iter().zip(&rows.tracks) {
        assert!(e[0].abs() < 0.03 && e[1].abs() < 0.03, "{e:?}");
        assert!(t.sigma_center_px.unwrap() < 0.025);
    }
    // One outline scatters by 0.02 px, the filtered centre ten times less from frame to frame.
    let changes: f64 = errors.windows(2).map(|w| (w[1][1] - w[0][1]).powi(2)).sum::<f64>() / 80.0;
    assert!(changes.sqrt() < 0.004, "{}", changes.sqrt());
}

fn rms(rows: &[VelocitySample], truth: &Truth, want: impl Fn(f64) -> bool) -> (f64, f64, f64) {
    let e = &truth.experiment;
    let (mut sum, mut pulls, mut count) = (0.0, 0.0, 0.0);
    for (row, rate) in rows.iter().zip(&truth.rates).filter(|(row, _)| want(row.frame as f64)) {
        let v = row.velocity.unwrap_or_else(|| panic!("frame {}", row.frame));
        let error = v.vn_m_s - rate[0];
        sum += (error / e.vn_m_s).powi(2);
        pulls += f64::from(u8::from(error.abs() <= v.sigma_v_m_s));
        count += 1.0;
    }
    (sum, pulls, count)
}

fn velocity_error(experiment: &Experiment, seeds: u64) -> [f64; 4] {
    let mut sums = [(0.0, 0.0, 0.0); 2];
    for seed in 0..seeds {
        let mut noise = Noise::new(1_000 + seed);
        let truth = experiment.simulate(noise.uniform());
        let rows = track(&truth.steps(1, &mut noise), &experiment.params()).velocities;
        let inside = |f: f64| f >= truth.start && f <= truth.end;
        for (sum, one) in sums.iter_mut().zip([rms(&rows, &truth, inside), rms(&rows, &truth, |f| !inside(f))]) {
            *sum = (sum.0 + one.0, sum.1 + one.1, sum.2 + one.2);
        }
    }
    let [contact, flight] =
        sums.map(|(sum, pulls, count): (f64, f64, f64)| (100.0 * (sum / count).sqrt(), pulls / count));
    eprintln!(
        "{}: velocity rms {:.3} % in contact (covered {:.2}), {:.3} % in flight ({:.2})",
        experiment.name, contact.0, contact.1, flight.0, flight.1
    );
    [contact.0, contact.1, flight.0, flight.1]
}

#[test]
fn the_three_experiments_have_their_velocity() {
    for hunt_crossley in [false, true] {
        for (experiment, limits) in [
            (lacrosse(hunt_crossley), (0.15, 0.1)),
            (tennis(hunt_crossley), (0.15, 0.1)),
            (rod(hunt_crossley), (0.5, 0.15)),
        ] {
            let [contact, _, flight, _] = velocity_error(&experiment, 20);
            assert!(contact <= limits.0, "{}: {contact} % in contact", experiment.name);
            assert!(flight <= limits.1, "{}: {flight} % in flight", experiment.name);
        }
    }
}

#[test]
fn phases_follow_the_collision() {
    let truth = tennis(true).simulate(0.5);
    let rows = track(&truth.steps(1, &mut Noise::new(4)), &truth.experiment.params());
    for row in &rows.velocities {
        let f = row.frame as f64;
        let near = (f - truth.start).abs() < 4.0 || (f - truth.end).abs() < 8.0;
        let expected = match f {
            f if f < truth.start => Phase::Flight,
            f if f < truth.end => Phase::Contact,
            _ => Phase::Rebound,
        };
        assert!(near || row.phase == expected, "frame {f}: {:?}", row.phase);
    }
}

#[test]
fn rows_come_in_order_with_the_stated_lag_and_depend_on_nothing_newer() {
    let truth = lacrosse(false).simulate(0.7);
    let steps = truth.steps(1, &mut Noise::new(8));
    let motion = truth.experiment.params();
    let mut tracker = Tracker::new(&TrackerParams {
        motion: vec![motion.clone()],
        longer_frames: vec![],
        contact: true,
        surface_body: None,
    });
    let lag = u64::from(tracker.lag_frames());
    let (mut all, mut rows) = (TrackerRows::default(), TrackerRows::default());
    for step in &steps {
        tracker.push(step, &mut rows);
        assert!(rows.velocities.last().is_none_or(|r| r.frame + lag == step.frame));
        all.tracks.append(&mut rows.tracks);
        all.velocities.append(&mut rows.velocities);
        all.impacts.append(&mut rows.impacts);
        all.alarms.append(&mut rows.alarms);
    }
    tracker.finish(&mut all);
    assert_eq!(all, track(&steps, &motion), "drained or not");
    let moved = |step: MotionSample| [Some(step.dx_px), Some(step.dy_px), step.dtheta_deg];
    let is_of = |row: &VelocitySample, step: &BodyStep| {
        row.frame == step.frame && row.motion.map(moved) == step.motion.map(|step| moved(step.into()))
    };
    assert!(all.velocities.iter().zip(&steps).all(|(row, step)| is_of(row, step)));
    // Rows that were published do not depend on later steps.
    let cut = 50;
    let mut head = TrackerRows::default();
    let mut tracker =
        Tracker::new(&TrackerParams { motion: vec![motion], longer_frames: vec![], contact: true, surface_body: None });
    for step in &steps[..cut] {
        tracker.push(step, &mut head);
    }
    let given = cut - lag as usize;
    assert_eq!(head.velocities, all.velocities[..given]);
    assert_eq!(head.tracks, all.tracks[..given]);
}

/// Tracks one body, with a surface that it may touch or without one.
fn track_with_surface(steps: &[BodyStep], params: &MotionParams, contact: bool) -> TrackerRows {
    let motion = vec![params.clone()];
    let mut tracker = Tracker::new(&TrackerParams { motion, longer_frames: vec![], contact, surface_body: None });
    let mut rows = TrackerRows::default();
    steps.iter().for_each(|step| tracker.push(step, &mut rows));
    tracker.finish(&mut rows);
    rows
}

#[test]
fn early_rows_are_less_certain_and_say_so() {
    for lag_frames in [0, 1, 2] {
        let (mut rows, mut wrong) = (0_u32, Vec::new());
        for experiment in [lacrosse, tennis, rod].iter().flat_map(|make| [make(false), make(true)]) {
            for (seed, contact) in (0..10).flat_map(|seed| [(seed, false), (seed, true)]) {
                let mut noise = Noise::new(2_000 + seed);
                let truth = experiment.simulate(noise.uniform());
                let params = MotionParams { lag_frames, ..experiment.params() };
                let steps = truth.steps(1, &mut noise);
                let rows_of_film = track_with_surface(&steps, &params, contact).velocities;
                for (row, rate) in rows_of_film.iter().zip(&truth.rates) {
                    let Some(velocity) = row.velocity else { continue };
                    let error = (velocity.vn_m_s - rate[0]).abs();
                    let pull = error / velocity.sigma_v_m_s;
                    rows += 1;
                    if pull > 5.0 {
                        wrong.push(format!("{} {seed} {contact} frame {}: {pull:.1}", experiment.name, row.frame));
                    }
                }
            }
        }
        eprintln!("lag {lag_frames}: {} of {rows} wrong: {wrong:?}", wrong.len());
        assert!(wrong.len() * 1000 <= rows as usize, "lag {lag_frames}: {wrong:?}");
    }
}

#[test]
fn two_bodies_do_not_affect_each_other() {
    let truths = [lacrosse(false).simulate(0.2), lacrosse(true).simulate(0.9)];
    let steps: Vec<_> = truths.iter().zip([21, 22]).map(|(t, seed)| t.steps(1, &mut Noise::new(seed))).collect();
    let alone: Vec<_> = steps.iter().zip(&truths).map(|(s, t)| track(s, &t.experiment.params())).collect();
    let motion = truths.iter().map(|t| t.experiment.params()).collect();
    let mut tracker = Tracker::new(&TrackerParams { motion, longer_frames: vec![], contact: true, surface_body: None });
    let mut rows = TrackerRows::default();
    for (a, b) in steps[0].iter().zip(&steps[1]) {
        tracker.push(a, &mut rows);
        tracker.push(&BodyStep { body: 1, ..*b }, &mut rows);
    }
    tracker.finish(&mut rows);
    for body in 0..2_u32 {
        let velocities: Vec<_> = rows.velocities.iter().filter(|r| r.body == body).map(|r| r.velocity).collect();
        let expected: Vec<_> = alone[body as usize].velocities.iter().map(|r| r.velocity).collect();
        assert_eq!(velocities[..70], expected[..70]);
        assert!(rows.impacts.iter().any(|i| i.body == body));
    }
}

/// A body that is lost when its contact begins, and found again only at its end. The last velocities before the gap
/// were those of the flight, off by up to 78 sigma.
#[test]
fn velocity_uncertainties_hold_when_a_body_is_lost_at_contact() {
    for experiment in [lacrosse(true), tennis(false), rod(true)] {
        let (mut square, mut count, mut worst) = (0.0, 0.0, 0.0_f64);
        for seed in 0..40 {
            let mut noise = Noise::new(4_000 + seed);
            let truth = experiment.simulate(noise.uniform());
            let mut steps = truth.steps(1, &mut noise);
            let first = truth.start as usize + 1 + (seed % 4) as usize;
            let last = (truth.end as usize - 1).max(first + 4);
            // The step of the frame before leads into a frame without the body.
            steps[first - 1].motion = None;
            for step in &mut steps[first..last] {
                (step.motion, step.outline, step.status) = (None, None, PointStatus::Lost);
            }
            let rows = track(&steps, &experiment.params());
            for at in (first - 4..first).chain(last..last + 4) {
                let (Some(measured), rate) = (rows.velocities[at].velocity, &truth.rates[at]) else { continue };
                let pull = (measured.vn_m_s - rate[0]).abs() / measured.sigma_v_m_s;
                (square, count, worst) = (square + pull * pull, count + 1.0, worst.max(pull));
            }
        }
        println!("{}: {:.2} sigmas rms, worst {worst:.1}", experiment.name, f64::sqrt(square / count));
        assert!(worst < 4.0 && square / count < 1.5, "{}", experiment.name);
    }
}
