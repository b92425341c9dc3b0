//! Recordings of cameras with a rolling shutter.

use ricochet::camera::simulated::{meta, stream_format};
use ricochet::config::Config;
use ricochet::image::Frame;
use ricochet::measure::{Measurer, Share};
use ricochet::process::analysis_params;
use ricochet::synth::{MotionSetup, Scenario, SimulatedFilm};
use ricochet::track::TrackerRows;

use crate::measured_world::{level_rig, rows_of_pictures};

const LACROSSE: &str = include_str!("../../config/lacrosse.toml");
const TENNIS: &str = include_str!("../../config/tennis.toml");
const ROD: &str = include_str!("../../config/rod.toml");

/// A recording whose rows are read within `share` of a frame's time; upwards if negative.
struct Recording {
    world: SimulatedFilm,
    pictures: Vec<Vec<u8>>,
    row_time_us: f64,
}

impl Recording {
    fn new(scenario: Scenario, share: f64) -> Self {
        let mut scenario = scenario;
        let camera = &mut scenario.camera;
        camera.row_time_us = share * 1e6 / camera.frame_rate_hz / f64::from(camera.height_px);
        let row_time_us = camera.row_time_us;
        let world = SimulatedFilm::new(&scenario).unwrap();
        let picture = |index| {
            let mut bytes = vec![0; world.frame_bytes()];
            world.render(index, &mut bytes);
            bytes
        };
        let pictures = (0..world.frames()).map(picture).collect();
        Self { world, pictures, row_time_us }
    }

    fn built_in(name: &str, share: f64) -> Self {
        Self::new(Scenario { seed: 71, ..Scenario::built_in(name).unwrap() }, share)
    }

    fn uncorrected(&self, rig: &str) -> Errors {
        Errors::of(&self.world, &rows_of_pictures(self.pictures.iter().cloned(), &self.world, rig))
    }

    fn corrected(&self, rig: &str) -> Errors {
        self.uncorrected(&self.with_row_time(rig))
    }

    fn with_row_time(&self, rig: &str) -> String {
        rig.replacen("[camera]", &format!("[camera]\nrow_time_us = {}", self.row_time_us), 1)
    }
}

/// Errors of the rows of a recording, in their sigmas unless the name says otherwise.
#[derive(Debug, Default)]
struct Errors {
    /// Velocities: root mean square and maximum.
    rms: f64,
    worst: f64,
    /// Spins.
    spin_rms: f64,
    spin_worst: f64,
    /// Centres.
    center_worst: f64,
    /// Mean of the radii, px.
    radius_px: f64,
    /// Numbers of the impact: maximum, and the name of that number.
    impact: f64,
    name: String,
    /// Number of velocities.
    count: usize,
}

impl Errors {
    fn of(world: &SimulatedFilm, rows: &TrackerRows) -> Self {
        let (mut off, mut spins, mut radii, mut seen) = (Self::default(), 0, 0.0, 0.0);
        for (row, track) in rows.velocities.iter().zip(&rows.tracks) {
            let truth = world.truths(row.frame)[row.body as usize];
            if let (Some(measured), Some(truth)) = (row.velocity, truth.velocity) {
                let pulls = [measured.vx_m_s - truth.vx_m_s, measured.vy_m_s - truth.vy_m_s]
                    .map(|off| off / measured.sigma_v_m_s);
                off.rms += 0.5 * pulls.iter().map(|pull| pull * pull).sum::<f64>();
                off.worst = pulls.iter().fold(off.worst, |worst, pull| worst.max(pull.abs()));
                off.count += 1;
                if truth.omega_rad_s.unwrap().abs() > 0.0 || world.truth(0).radius_px.is_some() {
                    let pull = ((measured.omega_rad_s.unwrap() - truth.omega_rad_s.unwrap())
                        / measured.sigma_omega_rad_s.unwrap())
                    .abs();
                    off.spin_rms += pull * pull;
                    off.spin_worst = off.spin_worst.max(pull);
                    spins += 1;
                }
            }
            if let (Some(measured), Some(sigma), Some(truth)) =
                (track.center_y_px, track.sigma_center_px, truth.center_y_px)
            {
                off.center_worst = off.center_worst.max(((measured - truth) / sigma).abs());
            }
            if let (Some(measured), Some(truth)) = (track.radius_px, truth.radius_px) {
                radii += measured - truth;
                seen += 1.0;
            }
        }
        off.rms = (off.rms / off.count.max(1) as f64).sqrt();
        off.spin_rms = (off.spin_rms / f64::from(spins.max(1))).sqrt();
        off.radius_px = radii / f64::max(seen, 1.0);
        let truth = world.impact().map(|impact| impact.numbers());
        let measured = rows.impacts.last().map(|impact| impact.numbers());
        for ((name, measured), (_, truth)) in measured.into_iter().flatten().zip(truth.into_iter().flatten()) {
            let Some(pull) =
                measured.zip(truth).map(|(measured, truth)| (measured.value - truth.value) / measured.sigma)
            else {
                continue;
            };
            if pull.abs() > off.impact {
                (off.impact, off.name) = (pull.abs(), name.to_string());
            }
        }
        off
    }

    fn print(&self, what: &str) {
        println!(
            "{what}: {} velocities, errors {:.2} sigma rms, {:.1} max; spins {:.2}, {:.1}; centres {:.1} max; \
             radius {:+.3} px; impact {:.1} ({})",
            self.count,
            self.rms,
            self.worst,
            self.spin_rms,
            self.spin_worst,
            self.center_worst,
            self.radius_px,
            self.impact,
            self.name
        );
    }

    /// Whether the sigmas cover the errors.
    fn are_covered_by_sigmas(&self) -> bool {
        self.rms < 1.3 && self.worst < 4.5 && self.spin_rms < 1.5 && self.center_worst < 4.0 && self.impact < 4.0
    }
}

/// Without the row time, velocities were off by up to 114 sigma and contact times by up to 570.
#[test]
fn the_effect_of_a_rolling_shutter_on_impacts_is_removed_when_the_row_time_is_known() {
    for (name, rig, share) in [
        ("lacrosse", LACROSSE, 0.1),
        ("lacrosse", LACROSSE, 0.95),
        ("lacrosse", LACROSSE, -0.6),
        ("tennis", TENNIS, 0.3),
        ("tennis", TENNIS, 0.95),
    ] {
        let film = Recording::built_in(name, share);
        let corrected = film.corrected(rig);
        corrected.print(&format!("{name}, rows read in {share} of a frame, corrected"));
        assert!(corrected.are_covered_by_sigmas() && corrected.count == film.pictures.len(), "{corrected:?}");
        assert!(corrected.radius_px.abs() < 0.03, "{corrected:?}");
        if share > 0.9 {
            let uncorrected = film.uncorrected(rig);
            uncorrected.print("uncorrected");
            assert!(uncorrected.worst > 10.0, "{uncorrected:?}");
        }
    }
}

#[test]
fn a_rod_is_as_fast_as_if_all_rows_were_exposed_at_once() {
    let still = Recording::built_in("rod", 0.0).uncorrected(ROD);
    still.print("rod, rows read at once");
    let film = Recording::built_in("rod", 0.95);
    let (corrected, uncorrected) = (film.corrected(ROD), film.uncorrected(ROD));
    corrected.print("rod, rows read in 0.95 of a frame, corrected");
    uncorrected.print("uncorrected");
    assert!(corrected.rms < 1.3 && corrected.worst < still.worst.max(4.0) && corrected.impact < 4.0, "{corrected:?}");
    assert!(uncorrected.rms > 1.4 * corrected.rms && uncorrected.impact > 15.0, "{uncorrected:?}");
}

#[test]
fn each_of_two_balls_is_timed_by_its_own_rows() {
    let rig = "[camera]\nsource = \"simulated\"\n[scale]\nmm_per_px = 1.0\n[[body]]\nname = \"left\"\ndiameter_mm = 63.25\n\
               roi_px = [0, 0, 140, 192]\n[[body]]\nname = \"right\"\ndiameter_mm = 63.25\nroi_px = [110, 0, 146, 192]\n\
               [velocity]\ngravity_m_s2 = 0\n";
    let still = Recording::built_in("pair", 0.0).uncorrected(rig);
    still.print("two balls, rows read at once");
    let film = Recording::built_in("pair", -0.9);
    let (corrected, uncorrected) = (film.corrected(rig), film.uncorrected(rig));
    corrected.print("two balls, rows read upwards in 0.9 of a frame, corrected");
    uncorrected.print("uncorrected");
    // The rows of the frame in which they are kicked show both sides of the kick, which the fit cannot know: 5 sigma,
    // once.
    assert!(corrected.rms < still.rms.max(1.0) && corrected.worst < 6.0, "{corrected:?} {still:?}");
    assert!(corrected.count >= still.count && uncorrected.rms > 4.0 * corrected.rms, "{corrected:?} {uncorrected:?}");
}

/// A rig without gravity.
fn free_rig() -> String {
    level_rig(0.5) + "[velocity]\ngravity_m_s2 = 0\n"
}

/// A ball that crosses the image, rotates, and leaves.
fn spun(speed_px: [f64; 2], omega_deg_frame: f64, start_px: [f64; 2], frames: u64) -> Scenario {
    let mut scenario = Scenario::translation(speed_px[0], speed_px[1], omega_deg_frame);
    (scenario.camera.frames, scenario.camera.width_px, scenario.camera.height_px) = (frames, 280, 280);
    scenario.seed = 5;
    if let MotionSetup::Constant { start_px: start, .. } = &mut scenario.motion {
        *start = start_px;
    }
    scenario
}

#[test]
fn each_row_is_drawn_at_its_own_time() {
    let speed_px = [1.3, 4.1];
    for share in [0.8, -0.8] {
        let rolled = |start_px| {
            let mut scenario = spun(speed_px, 0.0, start_px, 3);
            scenario.camera.row_time_us = share * 100.0 / 280.0;
            SimulatedFilm::new(&scenario).unwrap().render_light(1)
        };
        let picture = rolled([140.0, 110.0]);
        for row in [60, 110, 150] {
            // A row that is exposed later equals that row of a frame taken then.
            let later = share / 280.0 * (row as f64 - if share < 0.0 { 279.0 } else { 0.0 });
            let start_px = [140.0 + later * speed_px[0], 110.0 + later * speed_px[1]];
            let at_once = SimulatedFilm::new(&spun(speed_px, 0.0, start_px, 3)).unwrap().render_light(1);
            let apart = |image: &ricochet::image::Image| {
                let of = |x| (image.view().at(x, row).unwrap() - picture.view().at(x, row).unwrap()).abs();
                (0..280).map(of).fold(0.0, f32::max)
            };
            let still = SimulatedFilm::new(&spun(speed_px, 0.0, [140.0, 110.0], 3)).unwrap().render_light(1);
            assert!(apart(&at_once) < 0.05 && apart(&still) > 5.0, "{row}: {} {}", apart(&at_once), apart(&still));
        }
    }
}

#[test]
fn a_ball_that_spins_fast_and_leaves_neither_sinks_nor_slows_down() {
    let film = Recording::new(spun([1.3, 4.1], 3.0, [110.0, 75.0], 44), 0.9);
    let rig = free_rig();
    let (corrected, uncorrected) = (film.corrected(&rig), film.uncorrected(&rig));
    corrected.print("spins and leaves, corrected");
    uncorrected.print("uncorrected");
    // Several intervals together.
    let several = film.corrected(&format!("{rig}[correlation]\ninterval_frames = [1, 3]\n"));
    several.print("over one and three frames, corrected");
    // The shear of an uncorrected ball contradicts a rigid motion, which widens its sigmas.
    assert!(uncorrected.rms > 3.0 * corrected.rms, "{uncorrected:?} {corrected:?}");
    for corrected in [corrected, several] {
        assert!(corrected.are_covered_by_sigmas() && corrected.count > 36, "{corrected:?}");
    }
}

/// A calibration that turns the image leaves each row at the time at which it was read.
#[test]
fn an_image_turned_by_its_calibration_keeps_the_times_of_its_rows() {
    let film = Recording::new(spun([-2.3, 3.7], 0.7, [170.0, 80.0], 30), 0.9);
    let table = "[calibration]\nimage_px = [280, 280]\nhomography_mm = [-0.5, 0, 139.5, 0, -0.5, 139.5, 0, 0, 1]\n";
    let rig = free_rig().replace("[scale]\nmm_per_px = 0.5\n", "") + table;
    let rows = rows_of_pictures(film.pictures.iter().cloned(), &film.world, &film.with_row_time(&rig));
    let mut pulls = Vec::new();
    for row in &rows.velocities {
        let (Some(measured), Some(truth)) = (row.velocity, film.world.truth(row.frame).velocity) else { continue };
        pulls.extend(
            [measured.vx_m_s - truth.vx_m_s, measured.vy_m_s - truth.vy_m_s]
                .map(|off| (off / measured.sigma_v_m_s).abs()),
        );
    }
    let worst = pulls.iter().copied().fold(0.0, f64::max);
    println!("turned upside down: {} velocities, {worst:.1} sigma max", pulls.len() / 2);
    assert!(pulls.len() > 50 && worst < 4.5, "{pulls:?}");
}

#[test]
fn a_speed_trigger_corrects_for_the_rolling_shutter() {
    let film = Recording::new(spun([0.2, 2.5], 0.1, [140.3, 75.2], 20), 0.9);
    let rig = free_rig() + "[trigger]\nmode = \"speed\"\nspeed_m_s = 10\n";
    let format = stream_format(&film.world);
    let speed_of = |rig: &str| {
        let config = Config::parse(rig, "rig.toml").unwrap();
        let mut measurer = Measurer::new(&analysis_params(&config, &format).0, Share::ALL, 280, 280).unwrap();
        let mut trigger = config.measured_trigger(format.frame_rate_hz, format.exposure_us).unwrap();
        let mut steps = Vec::new();
        for (index, bytes) in (0..).zip(&film.pictures) {
            measurer.push(&Frame { meta: meta(&film.world, index), bytes }, &mut steps).unwrap();
        }
        measurer.finish(&mut steps);
        let what = steps.iter().find_map(|row| trigger.push(&row.step)).unwrap().what;
        println!("{what}");
        let numbers: Vec<f64> = what.split([' ', ':']).filter_map(|word| word.parse().ok()).collect();
        (numbers[0], numbers[1])
    };
    let truth = 0.2_f64.hypot(2.5) * 5.0;
    let ((speed, sigma), (uncorrected, _)) = (speed_of(&film.with_row_time(&rig)), speed_of(&rig));
    assert!((speed - truth).abs() < 4.0 * sigma.max(0.002), "{speed} for {truth}");
    assert!(uncorrected - truth > 0.006 * truth, "{uncorrected} for {truth}");
}
