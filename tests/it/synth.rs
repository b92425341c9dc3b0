//! The simulated world through its public interface.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use ricochet::results::{ForceLaw, Phase, PointStatus};
use ricochet::synth::{MotionSetup, PatternSetup, Scenario, Shape, SimulatedFilm};

fn world(scenario: &Scenario) -> SimulatedFilm {
    SimulatedFilm::new(scenario).unwrap()
}

fn lacrosse() -> Scenario {
    Scenario::built_in("lacrosse").unwrap()
}

fn frame(world: &SimulatedFilm, index: u64) -> Vec<u8> {
    let mut bytes = vec![0xaa; world.frame_bytes()];
    world.render(index, &mut bytes);
    bytes
}

/// FNV-1a.
fn checksum(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |sum, byte| (sum ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}

#[test]
fn the_lacrosse_film_has_its_checksum() {
    let world = world(&lacrosse());
    let sums: Vec<u64> = [0, 37, 99].map(|index| checksum(&frame(&world, index))).to_vec();
    assert_eq!(sums, [0x31e5_7fde_4fa3_3f96, 0xb986_21fd_84c3_e1cd, 0xb917_4400_693a_9cf7], "{sums:#x?}");
}

#[test]
fn frames_do_not_depend_on_their_order_or_on_the_world_object() {
    let (one, other) = (world(&lacrosse()), world(&lacrosse()));
    let forwards: Vec<Vec<u8>> = (0..5).map(|index| frame(&one, index)).collect();
    std::thread::scope(|scope| {
        for index in (0..5).rev() {
            let (other, expected) = (&other, &forwards[index as usize]);
            scope.spawn(move || assert_eq!(&frame(other, index), expected, "frame {index}"));
        }
    });
    assert_ne!(forwards[0], forwards[1]);
}

#[test]
fn another_seed_is_another_ball_and_other_noise() {
    let one = world(&lacrosse());
    let other = world(&Scenario { seed: 2, ..lacrosse() });
    assert_ne!(one.render_light(0), other.render_light(0));
    assert_eq!(one.truth(20), other.truth(20));
}

#[test]
fn the_lacrosse_ball_stays_in_the_image_above_a_visible_flat() {
    let world = world(&lacrosse());
    for index in 0..world.frames() {
        let truth = world.truth(index);
        let (x, y, r) = (truth.center_x_px.unwrap(), truth.center_y_px.unwrap(), truth.radius_px.unwrap());
        let (right, bottom) = (f64::from(world.width_px()) - 1.0, f64::from(world.height_px()) - 1.0);
        let margin = [x - r, y - r, right - x - r, bottom - y - r].into_iter().fold(f64::INFINITY, f64::min);
        assert!(margin >= 12.0, "frame {index}: {margin} px");
        assert_eq!(truth.status, PointStatus::Valid);
    }
    let picture = world.render_light(0);
    let bottom = picture.view().row(190).iter().sum::<f32>() / 256.0;
    let ground = picture.view().row(4).iter().sum::<f32>() / 256.0;
    assert!(bottom > ground + 40.0, "flat {bottom}, ground {ground}");
}

#[test]
fn the_tennis_ball_leaves_with_the_spins_of_the_paper() {
    for (name, spin_rad_s, tolerance) in [("tennis", -4.99, 0.05 * 4.99), ("tennis-physical", -62.0, 3.0)] {
        let world = world(&Scenario::built_in(name).unwrap());
        let impact = world.impact().unwrap();
        let value = |estimate: Option<ricochet::results::Estimate>| estimate.unwrap().value;
        assert!((value(impact.omega_after_rad_s) - spin_rad_s).abs() < tolerance, "{:?}", impact.omega_after_rad_s);
        assert!((value(impact.contact_time_s) - 7e-3).abs() < 0.07e-3, "{:?}", impact.contact_time_s);
        assert!((value(impact.restitution) - 0.8).abs() < 0.008, "{:?}", impact.restitution);
        let before = world.truth(0).velocity.unwrap();
        assert!(before.vx_m_s.abs() < 1e-9 && before.vy_m_s < -4.48, "it falls straight: {before:?}");
        assert!((before.vn_m_s - before.vy_m_s * 0.5f64.sqrt()).abs() < 1e-9);
        for index in 0..world.frames() {
            let truth = world.truth(index);
            let (x, y, r) = (truth.center_x_px.unwrap(), truth.center_y_px.unwrap(), truth.radius_px.unwrap());
            let margin = [x - r, y - r, 255.0 - x - r, 255.0 - y - r].into_iter().fold(f64::INFINITY, f64::min);
            assert!(margin >= 6.0, "{name}, frame {index}: {margin} px, ({x}, {y})");
            assert!(truth.visible_fraction.unwrap() > 0.85);
        }
    }
}

#[test]
fn the_rod_bounces_as_in_the_paper_with_its_tape_at_the_true_position() {
    let world = world(&Scenario::built_in("rod").unwrap());
    let impact = world.impact().unwrap();
    let value = |estimate: Option<ricochet::results::Estimate>| estimate.unwrap().value;
    for (name, number, expected) in [
        ("contact", value(impact.contact_time_s), 1.4e-3),
        ("restitution", value(impact.restitution), 0.634),
        ("compression", value(impact.compression_max_mm), 0.423),
        ("after", value(impact.vn_after_m_s), 0.6873),
    ] {
        assert!((number / expected - 1.0).abs() < 0.01, "{name}: {number}, expected {expected}");
    }
    for index in [0, 100, 120, 239] {
        let truth = world.truth(index);
        assert_eq!((truth.status, truth.radius_px, truth.visible_fraction), (PointStatus::Valid, None, Some(1.0)));
        let picture = world.render_light(index);
        let (rod_dn, tape_dn) = (255.0 * 0.08, 255.0 * 0.7);
        // The clean tape lies 20 to 40 px above the end of the rod, which lies 85 px below the mark.
        let middle_px = truth.center_y_px.unwrap() + 55.0;
        let (mut sum, mut moment) = (0.0, 0.0);
        for row in (middle_px - 15.0) as usize..(middle_px + 16.0) as usize {
            let share = (f64::from(picture.view().at(31, row).unwrap()) - rod_dn) / (tape_dn - rod_dn);
            sum += share;
            moment += share * row as f64;
        }
        assert!((sum - 20.0).abs() < 1e-3, "frame {index}: tape of {sum} px");
        assert!((moment / sum - middle_px).abs() < 1e-3, "frame {index}: {} {middle_px}", moment / sum);
    }
}

#[test]
fn a_ringing_rod_oscillates_about_a_rigid_one() {
    let (still, ringing) =
        (world(&Scenario::built_in("rod").unwrap()), world(&Scenario::built_in("rod-ringing").unwrap()));
    let speed = |world: &SimulatedFilm, index: u64| world.truth(index).velocity.unwrap().vy_m_s;
    assert!((speed(&still, 90) - speed(&ringing, 90)).abs() < 1e-12, "before first touch nothing rings");
    let swings: Vec<f64> = (99..239).map(|index| speed(&ringing, index) - speed(&still, index)).collect();
    let crossings = swings.windows(2).filter(|pair| pair[0] * pair[1] < 0.0).count();
    // 140 frames at 40 kHz are 3.5 ms: 8.5 kHz cross zero 59 times in them.
    assert!((58..=60).contains(&crossings), "{crossings}");
    let still_y: f64 = still.truth(238).center_y_px.unwrap();
    assert!((still_y - ringing.truth(238).center_y_px.unwrap()).abs() < 0.01);
}

#[test]
fn a_rod_refuses_the_keys_of_a_ball() {
    let mut spinning = Scenario::built_in("rod").unwrap();
    if let MotionSetup::Impact(impact) = &mut spinning.motion {
        impact.omega_rad_s = 1.0;
    }
    let error = SimulatedFilm::new(&spinning).unwrap_err().to_string();
    assert_eq!(error, "body.rod stands upright and does not turn: its spin must be 0");
    let mut bell = lacrosse();
    if let (MotionSetup::Impact(impact), MotionSetup::Impact(rod)) =
        (&mut bell.motion, Scenario::built_in("rod-ringing").unwrap().motion)
    {
        impact.ringing = rod.ringing;
    }
    assert!(SimulatedFilm::new(&bell).unwrap_err().to_string().ends_with("motion.ringing needs one"));
}

#[test]
fn every_pattern_of_the_study_can_be_drawn() {
    for name in PatternSetup::PAPER {
        let scenario = Scenario::built_in(&format!("pattern-{name}")).unwrap();
        assert_eq!(scenario.body.pattern, PatternSetup::paper(name).unwrap());
        let world = world(&scenario);
        let dark = frame(&world, 0).iter().filter(|pixel| **pixel > 120).count() as f64;
        let bright_share = dark / (std::f64::consts::PI * 3600.0);
        let expected = 1.0 - scenario.body.pattern.coverage;
        // Blur removes part of small speckles, so the share of bright pixels is near the cover and not equal.
        assert!((bright_share - expected).abs() < 0.1, "{name}: {bright_share} bright, expected {expected}");
    }
    assert!(Scenario::built_in("pattern-g-I").is_none() && Scenario::built_in("squash").is_none());
}

#[test]
fn truth_is_consistent_with_its_own_differences() {
    let world = world(&lacrosse());
    let rate_hz = world.frame_rate_hz();
    let m_per_px = world.scenario().scale.mm_per_px * 1e-3;
    for index in 1..world.frames() - 1 {
        let (before, here, after) = (world.truth(index - 1), world.truth(index), world.truth(index + 1));
        let step = before.motion.unwrap();
        assert!((here.center_x_px.unwrap() - before.center_x_px.unwrap() - step.dx_px).abs() < 1e-12);
        assert!((here.center_y_px.unwrap() - before.center_y_px.unwrap() - step.dy_px).abs() < 1e-12);
        let turned = world.angle_deg(index) - world.angle_deg(index - 1);
        assert!((turned - step.dtheta_deg.unwrap()).abs() < 1e-12);
        let velocity = here.velocity.unwrap();
        let vx = (after.center_x_px.unwrap() - before.center_x_px.unwrap()) * 0.5 * rate_hz * m_per_px;
        let vy = -(after.center_y_px.unwrap() - before.center_y_px.unwrap()) * 0.5 * rate_hz * m_per_px;
        // At the beginning and end of contact the acceleration jumps by up to 170 m/s^2 within 0.2 ms.
        assert!((vx - velocity.vx_m_s).abs() < 0.01 && (vy - velocity.vy_m_s).abs() < 0.01, "{index}: {vx} {vy}");
        assert!((velocity.vn_m_s - velocity.vy_m_s).abs() < 1e-12 && (velocity.vt_m_s - velocity.vx_m_s).abs() < 1e-12);
    }
    assert_eq!(world.truth(world.frames() - 1).motion, None);
}

#[test]
fn the_lacrosse_impact_is_the_paper_s() {
    let world = world(&lacrosse());
    let impact = world.impact().unwrap();
    let value = |name: &str| impact.numbers().into_iter().find(|(key, _)| *key == name).unwrap().1.unwrap().value;
    for (name, expected, tolerance) in [
        ("start_s", 1.4e-3, 1e-12),
        ("deepest_s", 3.65e-3, 0.06e-3),
        ("end_s", 5.8e-3, 0.05e-3),
        ("vn_before_m_s", -1.69, 1e-12),
        ("vn_after_m_s", 1.35, 0.01),
        ("vt_before_m_s", 0.57, 1e-12),
        ("vt_after_m_s", 0.385, 0.01),
        ("omega_after_rad_s", -15.0, 0.5),
        ("restitution", 0.799, 0.008),
        ("contact_time_s", 4.4e-3, 0.044e-3),
        ("compression_max_mm", 2.22, 0.03),
        ("acceleration_max_m_s2", 1040.0, 15.0),
        ("slip_end_s", 4.3e-3, 0.05e-3),
    ] {
        assert!((value(name) - expected).abs() <= tolerance, "{name}: {}, expected {expected}", value(name));
    }
    assert_eq!(impact.force_law, ForceLaw::KelvinVoigt);
    assert_eq!(impact.origin_ns, world.stamp_ns(0));
    let phases: Vec<Phase> = [0, 13, 14, 58, 59].map(|index| world.truth(index).phase).to_vec();
    assert_eq!(phases, [Phase::Flight, Phase::Flight, Phase::Contact, Phase::Contact, Phase::Rebound]);
}

#[test]
fn stamps_are_a_pure_function_of_the_frame() {
    let mut scenario = lacrosse();
    scenario.camera.frame_rate_hz = 30_000.0;
    let world = world(&scenario);
    let start = scenario.camera.start_ns;
    assert_eq!([0, 1, 2, 3].map(|index| world.stamp_ns(index) - start), [0, 33_333, 66_667, 100_000]);
}

/// A ball in even light without noise, in the middle of the image.
fn plain(vx_px_frame: f64, omega_deg_frame: f64) -> Scenario {
    let mut scenario = Scenario::translation(0.0, 0.0, 0.0);
    (scenario.camera.width_px, scenario.camera.height_px) = (161, 161);
    scenario.camera.noise_dn = 0.0;
    let start_px = [80.0, 80.0];
    scenario.motion = MotionSetup::Constant { vx_px_frame, vy_px_frame: 0.0, omega_deg_frame, start_px };
    scenario
}

#[test]
fn a_positive_spin_rotates_the_image_counter_clockwise() {
    let world = world(&plain(0.0, 90.0));
    let (before, after) = (world.render_light(0), world.render_light(1));
    let mut worst = 0f32;
    for y in 0..161 {
        for x in 0..161 {
            // The point at (dx, dy) from the middle goes to (dy, -dx).
            let there = after.view().at(y, 160 - x).unwrap();
            worst = worst.max((before.view().at(x, y).unwrap() - there).abs());
        }
    }
    assert!(worst < 0.05, "{worst} DN");
}

#[test]
fn motion_by_a_whole_pixel_shifts_the_image_by_a_whole_pixel() {
    let world = world(&plain(3.0, 0.0));
    let (before, after) = (world.render_light(0), world.render_light(1));
    for y in 0..161 {
        for x in 0..158 {
            let (here, there) = (before.view().at(x, y).unwrap(), after.view().at(x + 3, y).unwrap());
            assert!((here - there).abs() < 0.01, "({x}, {y}): {here} {there}");
        }
    }
}

#[test]
fn a_long_exposure_is_the_mean_of_short_ones() {
    let mut long = plain(2.0, 0.0);
    long.camera.exposure_us = 1e6 / long.camera.frame_rate_hz;
    let mut short = plain(2.0 / 64.0, 0.0);
    short.camera.frames = 64;
    let MotionSetup::Constant { start_px, .. } = &mut short.motion else { unreachable!() };
    // The long exposure shows the ball at its position in the middle of the exposure.
    start_px[0] -= 31.5 * 2.0 / 64.0;
    let (long, short) = (world(&long), world(&short));
    let mut mean = vec![0f32; 161 * 161];
    for index in 0..64 {
        let picture = short.render_light(index);
        mean.iter_mut().zip(picture.view().data()).for_each(|(sum, value)| *sum += value / 64.0);
    }
    let blurred = long.render_light(0);
    let worst =
        blurred.view().data().iter().zip(&mean).fold(0f32, |worst, (here, there)| worst.max((here - there).abs()));
    assert!(worst < 0.1, "{worst} DN");
    let still = world(&plain(0.0, 0.0)).render_light(0);
    let blur = blurred.view().data().iter().zip(still.view().data()).fold(0f32, |most, (a, b)| most.max((a - b).abs()));
    assert!(blur > 10.0, "the exposure must be seen: {blur} DN");
}

#[test]
fn deep_cameras_use_their_whole_range() {
    for (bits, bytes) in [(8, 1), (10, 2), (12, 2), (16, 2)] {
        let mut scenario = plain(0.37, 0.0);
        scenario.camera.bits = bits;
        let world = world(&scenario);
        assert_eq!(world.frame_bytes(), 161 * 161 * bytes);
        let pixels = frame(&world, 0);
        let brightest = match bytes {
            1 => u32::from(*pixels.iter().max().unwrap()),
            _ => pixels.chunks_exact(2).map(|pair| u32::from(u16::from_le_bytes([pair[0], pair[1]]))).max().unwrap(),
        };
        let expected = f64::from((1u32 << bits) - 1) * 0.75;
        assert!((f64::from(brightest) / expected - 1.0).abs() < 0.01, "{bits} bits: {brightest}");
    }
}

#[test]
fn a_ball_that_leaves_the_image_is_flagged_and_still_drawn() {
    let mut scenario = plain(20.0, 0.0);
    scenario.camera.frames = 12;
    let world = world(&scenario);
    let statuses: Vec<PointStatus> = [0, 1, 4, 11].map(|index| world.truth(index).status).to_vec();
    assert_eq!(statuses, [PointStatus::Valid, PointStatus::Valid, PointStatus::OutOfFrame, PointStatus::OutOfFrame]);
    frame(&world, 4);
    assert!(frame(&world, 11).iter().all(|pixel| *pixel == 31), "only ground is left");
}

#[test]
fn a_scenario_survives_toml() {
    let built_in = Scenario::BUILT_IN.map(|name| Scenario::built_in(name).unwrap());
    for scenario in built_in.into_iter().chain([Scenario::translation(0.37, -0.13, 0.35)]) {
        let text = toml::to_string(&scenario).unwrap();
        assert_eq!(Scenario::from_toml(&text).unwrap(), scenario);
    }
}

/// The error for a lacrosse scenario in which one line is replaced.
fn refused(old: &str, new: &str) -> String {
    let text = toml::to_string(&lacrosse()).unwrap();
    assert!(text.contains(old), "{old:?} is not in\n{text}");
    match Scenario::from_toml(&text.replacen(old, new, 1)).and_then(|scenario| SimulatedFilm::new(&scenario)) {
        Ok(_) => panic!("{new:?} was accepted"),
        Err(error) => error.to_string(),
    }
}

#[test]
fn bad_scenarios_get_one_clear_line_each() {
    for (old, new, message) in [
        (
            "diameter_mm = 63.25",
            "diameter_mm = 163.25",
            "body.diameter_mm = 163.25 is a ball of 317.5 px at scale.mm_per_px = 0.5142: larger than the picture of \
             256 x 192 px",
        ),
        (
            "diameter_mm = 63.25",
            "diameter_mm = -1.0",
            "body.diameter_mm = -1 is out of range: allowed is at least 8 px",
        ),
        (
            "diameter_mm = 63.25",
            "diameter_mm = nan",
            "body.diameter_mm = NaN is out of range: allowed is at least 8 px",
        ),
        ("width_px = 256", "width_px = 0", "camera.width_px = 0 is out of range: allowed is 16 to 8192"),
        ("width_px = 256", "width_px = -1", "camera.width_px = -1 is out of range: allowed is 16 to 8192"),
        ("frames = 100", "frames = -3", "camera.frames = -3 is out of range: allowed is 1 to 100000000"),
        ("height_px = 192", "height_px = 5000000000", "camera.height_px = 5000000000 is out of range: allowed is 16"),
        ("noise_dn = 2.0", "noise_dn = -2.0", "camera.noise_dn = -2 is out of range: allowed is 0 to 64"),
        (
            "frame_rate_hz = 10000.0",
            "frame_rate_hz = 0.0",
            "camera.frame_rate_hz = 0 is out of range: allowed is 0.001 to 10000000",
        ),
        ("exposure_us = 20.0", "exposure_us = 101.0", "camera.exposure_us = 101 is out of range: allowed is 0 to 100"),
        ("frames = 100", "frames = 0", "camera.frames = 0 is out of range: allowed is 1 to 100000000"),
        ("bits = 8", "bits = 9", "camera.bits = 9 is out of range: allowed is 8, 10, 12 or 16"),
        (
            "mm_per_px = 0.5142",
            "mm_per_px = -0.5",
            "scale.mm_per_px = -0.5 is out of range: allowed is 0.000001 to 1000",
        ),
        ("coverage = 0.45", "coverage = 0.9", "body.pattern.coverage = 0.9 is out of range: allowed is 0 to 0.6"),
        (
            "area_max_px2 = 40.0",
            "area_max_px2 = 1.0",
            "body.pattern.area_max_px2 = 1 is out of range: allowed is 2 to 594",
        ),
        ("vn_m_s = -1.69", "vn_m_s = 1.69", "motion.vn_m_s = 1.69 is out of range: allowed is -1000 to -0.001"),
        ("frames = 100", "frames = 4000", "camera.frames = 4000 lasts 0.4000 s, but the ball touches again at 0.2"),
        (
            "damping_n_s_m = 14.87",
            "damping_n_s_m = 90000.0",
            "motion: the ball does not leave the flat within 0.1 s: less damping, or a faster ball, is needed",
        ),
        ("speckle = 0.2", "speckles = 0.2", "unknown field `speckles`, expected one of `ball`, `speckle`"),
        ("vn_m_s = -1.69", "vn_m_s = -1.69\nvz_m_s = 1.0", "unknown field `vz_m_s`"),
        (
            "kind = \"impact\"",
            "kind = \"bounce\"",
            "unknown variant `bounce`, expected one of `constant`, `piecewise`, `impact`",
        ),
        ("bits = 8", "bits = \"many\"", "invalid type: string \"many\", expected u32"),
    ] {
        let error = refused(old, new);
        assert!(error.contains(message), "{new:?}:\n  got      {error}\n  expected {message}");
    }
}

#[test]
fn an_occluder_needs_a_position() {
    let mut scenario = plain(0.0, 0.0);
    scenario.occluder = lacrosse().occluder;
    let error = SimulatedFilm::new(&scenario).unwrap_err().to_string();
    assert!(error.starts_with("occluder.point_px is missing"), "{error}");
}

#[test]
fn a_half_occluded_ball_is_half_visible() {
    let mut scenario = plain(0.0, 0.0);
    scenario.occluder = lacrosse().occluder;
    if let Some(occluder) = &mut scenario.occluder {
        (occluder.point_px, occluder.normal_deg) = (Some([80.0, 80.0]), Some(180.0));
    }
    let world = world(&scenario);
    assert!((world.truth(0).visible_fraction.unwrap() - 0.5).abs() < 1e-12);
    let picture = world.render_light(0);
    let flat_dn = 255.0 * 0.38;
    // Everything to the right of x = 80 is the occluder, whose texture is 3 % of full scale.
    assert!((60..100).all(|y| (picture.view().at(110, y).unwrap() - flat_dn).abs() < 45.0));
    let left: f32 = (60..100).map(|y| picture.view().at(50, y).unwrap()).sum::<f32>() / 40.0;
    assert!(left > 90.0, "{left}");
}
#[test]
#[ignore = "a speed is only worth asserting on a quiet machine"]
#[expect(clippy::disallowed_methods, reason = "measures how long drawing takes")]
fn at_least_300_frames_of_512_x_512_are_drawn_in_a_second_on_one_core() {
    for shape in [Shape::Disc, Shape::Sphere] {
        let mut scenario = Scenario::translation(0.37, 0.13, 0.35);
        scenario.body.shape = shape;
        let world = world(&scenario);
        let mut bytes = vec![0; world.frame_bytes()];
        let mut times_s: Vec<f64> = (0..100)
            .map(|part| {
                let started = std::time::Instant::now();
                world.render(part * world.frames() / 100, &mut bytes);
                started.elapsed().as_secs_f64()
            })
            .collect();
        times_s.sort_by(f64::total_cmp);
        let [best, median, worst] = [0, 50, 99].map(|at| 1.0 / times_s[at]);
        eprintln!("{shape:?}: {median:.0} frames/s in the median, {best:.0} at best, {worst:.0} at worst");
        // The best of several turns excludes other load of the machine.
        assert!(best > 300.0, "{shape:?}: {best:.0} frames/s");
    }
}

#[test]
fn mains_flicker_has_the_requested_amplitude() {
    let mut scenario = plain(0.0, 0.0);
    scenario.camera.frames = 100;
    (scenario.light.flicker, scenario.light.flicker_hz) = (0.05, 100.0);
    let world = world(&scenario);
    let total = |index: u64| world.render_light(index).view().data().iter().copied().map(f64::from).sum::<f64>();
    // At 10 000 frames per second a quarter of a period is 25 frames.
    for (index, share) in [(0, 1.0), (25, 1.05), (50, 1.0), (75, 0.95)] {
        assert!((total(index) / total(0) - share).abs() < 1e-4, "frame {index}");
    }
}

#[test]
fn a_lens_darkens_the_corners() {
    let mut scenario = plain(0.0, 0.0);
    scenario.light.vignette = 0.4;
    let picture = world(&scenario).render_light(0);
    let ground_dn = 255.0 * 0.12;
    assert!((picture.view().at(0, 0).unwrap() / ground_dn - 0.6).abs() < 1e-4);
    assert!((picture.view().at(160, 80).unwrap() / ground_dn - 0.8).abs() < 1e-4);
}

#[test]
fn a_moving_edge_occludes_more_and_more_of_the_ball() {
    let mut scenario = plain(0.0, 0.0);
    scenario.camera.exposure_us = 50.0;
    scenario.occluder = lacrosse().occluder;
    if let Some(occluder) = &mut scenario.occluder {
        (occluder.point_px, occluder.normal_deg) = (Some([5.0, 80.0]), Some(0.0));
        (occluder.speed_px_frame, occluder.texture) = (12.5, 0.0);
    }
    let world = world(&scenario);
    let visible: Vec<f64> = (0..7).map(|index| world.truth(index).visible_fraction.unwrap()).collect();
    assert!(visible[0] > 0.999 && visible.windows(2).all(|pair| pair[1] <= pair[0]), "{visible:?}");
    // Frame 6 shows the middle of its exposure, when the edge is at 5 + 12.5 x 6.25 px.
    let edge_px = 5.0 + 12.5 * 6.25;
    assert!((visible[6] - (1.0 - half_disc_share((edge_px - 80.0) / 60.0))).abs() < 1e-9, "{visible:?}");
    let picture = world.render_light(6);
    let row = picture.view().row(2);
    let (flat_dn, ground_dn) = (255.0 * 0.38, 255.0 * 0.12);
    // The light of this row gives the number of pixels that the occluder covers.
    let taken: f64 = row.iter().map(|light| (f64::from(*light) - ground_dn) / (flat_dn - ground_dn)).sum();
    assert!((taken - (edge_px + 0.5)).abs() < 0.01, "{taken} px of {}", edge_px + 0.5);
}

/// The share of a unit disc to the left of a line at `place`.
fn half_disc_share(place: f64) -> f64 {
    0.5 + (place.asin() + place * (1.0 - place * place).sqrt()) / std::f64::consts::PI
}
