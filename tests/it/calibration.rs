//! Lens distortion and oblique views, removed from the measured quantities.

use ricochet::config::{Config, ConfigError};
use ricochet::motion::Rectifier;
use ricochet::synth::{MotionSetup, Scenario, SimulatedFilm};
use std::path::Path;

use crate::measured_world::{level_rig, rows_of_pictures, through};
use crate::support::{Background, Rig, ricochet, run};

const SIDE: usize = 420;

/// Images of 256 x 192 px.
const CAMERA: &str = "source = \"simulated\"\nscenario = \"lacrosse\"\npaced = true";

const LENS: &str = "image_px = [420, 420]\ncamera_matrix = [560, 0, 214, 0, 560, 205, 0, 0, 1]\n\
    distortion = [-0.12, 0.03, 0.0005, -0.0003]\n";

/// 0.5142 mm per pixel in the middle, and much less to the right.
const PLANE: &str = "homography_mm = [0.5, 0, -100, 0, 0.5, -100, -8e-5, 0, 1]\n";

fn rectifier(table: &str) -> Rectifier {
    Config::parse(&format!("{}[calibration]\n{table}", bare_rig()), "rig.toml").unwrap().calibration.unwrap()
}

fn bare_rig() -> String {
    level_rig(0.5142).replace("[scale]\nmm_per_px = 0.5142\n", "")
}

/// A ball that crosses the image from the lower left to the upper right and rotates.
fn world() -> SimulatedFilm {
    let mut scenario = Scenario::translation(3.17, -2.41, 1.3);
    scenario.scale.mm_per_px = 0.5142;
    (scenario.camera.frames, scenario.camera.width_px, scenario.camera.height_px) = (64, SIDE as u32, SIDE as u32);
    scenario.body.diameter_mm = 114.0 * scenario.scale.mm_per_px;
    scenario.camera.noise_dn = 1.0;
    if let MotionSetup::Constant { start_px, .. } = &mut scenario.motion {
        *start_px = [110.0, 290.0];
    }
    SimulatedFilm::new(&scenario).unwrap()
}

/// The largest error of the velocity relative to the speed, the largest relative error of the spin, the number of
/// velocities, and the largest error of the velocity in sigmas.
fn judge(world: &SimulatedFilm, seen_through: &Rectifier, rig: &str, mm_per_px: f64) -> (f64, f64, usize, f64) {
    let picture = |index| {
        let mut bytes = vec![0; world.frame_bytes()];
        world.render(index, &mut bytes);
        through(seen_through, &bytes, [SIDE; 2])
    };
    let rows = rows_of_pictures((0..world.frames()).map(picture), world, rig);
    let metres = mm_per_px * 1e-3 * 1e4;
    let truth = [3.17 * metres, 2.41 * metres, 1.3_f64.to_radians() * 1e4];
    let velocities: Vec<_> = rows.velocities.iter().filter_map(|row| row.velocity).collect();
    let speed = truth[0].hypot(truth[1]);
    let worst = |of: &dyn Fn(&ricochet::results::BodyVelocity) -> f64| velocities.iter().map(of).fold(0.0, f64::max);
    let off = |v: &ricochet::results::BodyVelocity| (v.vx_m_s - truth[0]).hypot(v.vy_m_s - truth[1]);
    let pull = worst(&|v| off(v) / v.sigma_v_m_s);
    let of_speed = worst(&|v| off(v) / speed);
    let of_spin = worst(&|v| (v.omega_rad_s.unwrap() / truth[2] - 1.0).abs());
    println!(
        "{} velocities, worst {of_speed:.4} of the speed, {pull:.1} sigmas, {of_spin:.4} of the spin",
        velocities.len()
    );
    (of_speed, of_spin, velocities.len(), pull)
}

#[test]
fn lens_distortion_of_some_percent_is_removed_from_velocities() {
    let (world, lens) = (world(), rectifier(LENS));
    let plain = judge(&world, &lens, &level_rig(0.5142), 0.5142);
    let calibrated = judge(&world, &lens, &format!("{}[calibration]\n{LENS}", level_rig(0.5142)), 0.5142);
    println!("lens: without {plain:?}, with {calibrated:?}");
    // Outlines that the lens distorts are refused or get a large sigma, so that velocities are not far off even without
    // the calibration.
    assert!(plain.0 > 1.5 * calibrated.0 && calibrated.0 < 0.003 && calibrated.1 < 0.005, "{plain:?} {calibrated:?}");
    assert!(calibrated.3 < 2.5, "{calibrated:?}");
    assert!(calibrated.2 >= 60);
    // The uncalibrated lens changes the size of the ball across the image, so the uncertainties include its effect.
    assert!(plain.3 < 2.5, "{plain:?}");
}

#[test]
fn a_homography_gives_the_scale_and_removes_perspective() {
    let table = format!("image_px = [420, 420]\n{PLANE}");
    let (world, both) = (world(), rectifier(&table));
    let mm_per_px = both.mm_per_px().unwrap();
    let plain = judge(&world, &both, &level_rig(mm_per_px), mm_per_px);
    let calibrated = judge(&world, &both, &format!("{}[calibration]\n{table}", bare_rig()), mm_per_px);
    println!("plane: without {plain:?}, with {calibrated:?}, {mm_per_px} mm/px");
    assert!(
        plain.0 > 0.004 && calibrated.0 < 0.003 && calibrated.1 < 0.02 && calibrated.2 >= 60,
        "{plain:?} {calibrated:?}"
    );
    assert!(plain.3 < 2.5, "{plain:?}");
}

/// An empty directory for one test.
fn directory(name: &str) -> std::path::PathBuf {
    let directory = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&directory);
    std::fs::create_dir_all(&directory).unwrap();
    directory
}

#[test]
fn a_calibration_file_is_written_as_numbers_into_the_attached_configuration() {
    let directory = directory("calibration");
    let (lens, rig) = (directory.join("lens.yaml"), directory.join("rig.toml"));
    let matrix = |name: &str, data: &str| {
        format!("{name}: !!opencv-matrix\n   rows: 1\n   cols: 9\n   dt: d\n   data: [ {data} ]\n")
    };
    let yaml = format!(
        "%YAML:1.0\n---\nimage_width: 420\nimage_height: 420\n{}{}",
        matrix("camera_matrix", "560., 0., 214., 0., 560., 205., 0., 0., 1."),
        matrix("distortion_coefficients", "-0.12, 0.03, 0.0005,\n      -0.0003")
    );
    std::fs::write(&lens, &yaml).unwrap();
    std::fs::write(&rig, format!("{}[calibration]\nfile = {:?}\n", level_rig(0.5), lens)).unwrap();
    let config = Config::load(&rig).unwrap();
    assert_eq!(config.calibration, Some(rectifier(LENS)));
    std::fs::remove_file(&lens).unwrap();
    let again = Config::parse(&config.text, "recording").unwrap();
    assert_eq!(again.calibration, config.calibration);
    assert!(!config.text.contains("lens.yaml"));
    // A key of the rig file takes precedence over the same one of the calibration file.
    let own = format!("{}[calibration]\nfile = {lens:?}\nimage_px = [420, 400]\n", level_rig(0.5));
    std::fs::write(&rig, own).unwrap();
    std::fs::write(&lens, yaml).unwrap();
    assert!(Config::load(&rig).unwrap().text.contains("[420, 400]"));
    std::fs::remove_file(&lens).unwrap();
    let missing = Config::load(&rig).unwrap_err().to_string();
    assert!(missing.contains("calibration.file = ") && missing.contains("No such file"), "{missing}");
}

#[test]
fn impossible_calibrations_are_refused_by_name() {
    let refused =
        |table: &str| Config::parse(&format!("{}[calibration]\n{table}", level_rig(0.5)), "rig.toml").unwrap_err();
    let cases = [
        ("camera_matrix = [560, 0, 214, 0, 560, 205, 0, 0, 1]", "calibration.image_px"),
        ("image_px = [420, 420]", "calibration.camera_matrix"),
        ("image_px = [420, 420]\ncamera_matrix = [560, 0, 214]", "calibration.camera_matrix"),
        ("image_px = [420, 420]\ncamera_matrix = [560, 0.1, 214, 0, 560, 205, 0, 0, 1]", "calibration.camera_matrix"),
        ("image_px = [420, 420]\ndistortion = [0.1]", "calibration.distortion"),
        (&format!("{LENS}distortion_model = \"thin\""), "calibration.distortion_model"),
        (&LENS.replace("-0.12,", "-9.0,"), "calibration.camera_matrix"),
        (&LENS.replace("-0.0003]", "0, 0, 0, 0, 0, 0.1]"), "calibration.distortion"),
        (&format!("{LENS}{PLANE}"), "scale.mm_per_px"),
        ("file = \"lens.yaml\"", "calibration.file"),
    ];
    for (table, key) in cases {
        let error = refused(table).to_string();
        assert!(error.contains(key) && !error.contains('\n'), "{table}: {error}");
    }
}

#[test]
fn a_calibration_for_another_image_size_is_refused_without_an_offset() {
    let config =
        |more: &str| Config::parse(&format!("{}[calibration]\n{LENS}{more}", level_rig(0.5)), "rig.toml").unwrap();
    let check = |more: &str, width_px, height_px| -> Result<(), ConfigError> {
        config(more).check_calibration(width_px, height_px)
    };
    assert!(check("", 420, 420).is_ok());
    assert!(check("", 400, 420).unwrap_err().to_string().contains("calibration.image_px"));
    assert!(check("offset_px = [10, 20]\n", 400, 400).is_ok());
    assert!(check("offset_px = [10, 30]\n", 400, 400).is_err());
}

#[test]
fn roles_started_by_hand_refuse_a_calibration_for_another_image_size() {
    let rig = Rig::new();
    let good = rig.config(CAMERA, "[scale]\nmm_per_px = 0.5\n");
    let bad = rig.file("bad.toml", &format!("{}[calibration]\n{LENS}", std::fs::read_to_string(&good).unwrap()));
    let refuses = |role: &str| {
        let output = run([role.as_ref(), bad.as_os_str()]);
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{role}: {stderr}");
        assert!(
            stderr.contains("calibration.image_px") && stderr.contains("256") && stderr.lines().count() == 1,
            "{stderr}"
        );
    };
    refuses("run");
    refuses("acquire");
    // The other roles get the image size from the camera.
    let camera = Background::start(ricochet(["acquire".as_ref(), good.as_os_str()]));
    ["correlate", "track", "record"].into_iter().for_each(refuses);
    camera.signal(15);
    camera.end();
}
