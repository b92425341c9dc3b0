//! The meaning of rig files.

use super::{SIMULATED, parse};
use ricochet::config::{Compression, Config, FeatureValue, Scale, Source, Surface, TriggerMode};
use ricochet::dic::{CorrelationParams, Interpolation, Method, Shape, WindowShape};
use ricochet::image::PixelFormat;
use std::path::{Path, PathBuf};

#[test]
fn a_camera_alone_is_a_rig_with_the_documented_defaults() {
    let config = parse(SIMULATED);
    assert_eq!(config.rig.name, "rig");
    assert_eq!((config.camera.source, config.camera.scenario.as_deref()), (Some(Source::Simulated), Some("lacrosse")));
    assert_eq!((config.camera.paced, config.camera.playback_rate), (true, 1.0));
    assert_eq!((config.camera.from_s, config.camera.to_s), (0.0, None));
    assert_eq!((config.camera.image_px(), config.camera.pixel_format, config.camera.frame_rate_hz), (None, None, None));
    assert_eq!((config.scale, config.record.as_ref()), (None, None));
    assert_eq!((config.bodies.len(), config.bodies[0].name.as_str()), (1, "ball"));
    assert_eq!(config.correlation, CorrelationParams::default());
    assert_eq!((config.velocity.order, config.velocity.window_frames), (2, None));
    assert_eq!((config.velocity.gravity_m_s2, config.velocity.gravity_angle_deg), (9.806_65, -90.0));
    assert_eq!((config.trigger.mode, config.trigger.rearm), (TriggerMode::Off, true));
    assert_eq!((config.trigger.pre_s, config.trigger.post_s), (0.05, 0.1));
    assert!((1..=64).contains(&config.workers.count));
    assert_eq!(config.workers.block_frames, 64);
    assert_eq!((config.text.as_str(), config.origin.as_str()), (SIMULATED, "rig.toml"));
}

/// Every key, none with its default value.
pub const FULL: &str = r#"rig = { name = "drop_1" }
scale = { ball_diameter_mm = 40 }
surface = { angle_deg = 19.5 }
correlation = { method = "peak-spline", shape = "rigid", window = "circle", subset_size_px = 9, step_px = 255, spline_points = 20, search_px = 1024, interval_frames = [2, 255], min_zncc = 0, interpolation = "bicubic" }
rotation = { method = "field" }
velocity = { window_frames = 3, order = 1, gravity_m_s2 = 0, gravity_angle_deg = -71 }
trigger = { mode = "motion", threshold_dn = 7, roi_px = [1, 2, 3, 4], pre_s = 0, post_s = 2, rearm = false }
record = { directory = "a/b", compression = "zstd", raw_frames = false, ring_bytes_max = 1048576, keep_last = 3, max_bytes = 1048576, split_bytes = 1048576 }
workers = { count = 64, block_frames = 256 }
serve = { http = "[::]:0", token_file = "secret/token" }
[camera]
source = "genicam"
id = "maker-1234"
width_px = 640
height_px = 320
offset_x_px = 8
offset_y_px = 4
pixel_format = "Mono12"
frame_rate_hz = 1e6
exposure_us = 1
gamma = 0.45
row_time_us = -0.003
defective_px = [[3, 4], [639, 319]]
trigger_source = "Line1"
packet_size_bytes = 9000
features = { Flag = true, Count = -3, Gain = 1.5, Mode = "Off" }
[[body]]
name = "left"
kind = "ball"
diameter_mm = 63.25
min_radius_px = 10
max_radius_px = 20
outline = "marked"
roi_px = [0, 0, 640, 320]
[[body]]
name = "right"
"#;

#[test]
fn every_key_of_the_camera_is_used() {
    let config = parse(FULL);
    assert_eq!(config.rig.name, "drop_1");
    let camera = &config.camera;
    assert_eq!(
        (camera.source, camera.id.as_deref(), camera.image_px()),
        (Some(Source::Genicam), Some("maker-1234"), Some((640, 320)))
    );
    assert_eq!(
        (camera.offset_x_px, camera.offset_y_px, camera.pixel_format),
        (Some(8), Some(4), Some(PixelFormat::Mono12))
    );
    assert_eq!((camera.frame_rate_hz, camera.exposure_us), (Some(1.0e6), Some(1.0)));
    assert_eq!((camera.gamma, camera.row_time_us), (0.45, Some(-0.003)));
    assert_eq!(camera.defective_px, [[3, 4], [639, 319]]);
    assert_eq!((camera.trigger_source.as_deref(), camera.packet_size_bytes), (Some("Line1"), Some(9000)));
    assert_eq!(camera.features["Flag"], FeatureValue::Bool(true));
    assert_eq!(camera.features["Count"], FeatureValue::Integer(-3));
    assert_eq!(camera.features["Gain"], FeatureValue::Float(1.5));
    assert_eq!(camera.features["Mode"], FeatureValue::Text("Off".into()));
    assert_eq!(config.scale, Some(Scale::BallDiameterMm(40.0)));
    assert_eq!(config.surface, Surface { angle_deg: 19.5, edge: None, body: None });
}

#[test]
fn every_key_of_the_measurement_is_used() {
    let config = parse(FULL);
    let names: Vec<&str> = config.bodies.iter().map(|body| body.name.as_str()).collect();
    assert_eq!((names, config.bodies[0].roi_px), (vec!["left", "right"], Some([0, 0, 640, 320])));
    assert_eq!(config.ball(0, 640, 320).outline, ricochet::ball::OutlineMethod::Marked);
    let correlation = CorrelationParams {
        method: Method::PeakSpline,
        shape: Shape::Rigid,
        window: WindowShape::Circle,
        subset_size_px: 9,
        step_px: 255,
        spline_points: 20,
        search_px: 1024,
        min_zncc: 0.0,
        interpolation: Interpolation::Bicubic,
    };
    assert_eq!((config.correlation(), config.intervals_frames.as_slice()), (correlation, [2, 255].as_slice()));
    assert_eq!((config.trigger.mode, config.trigger.threshold_dn), (TriggerMode::Motion, 7.0));
    assert_eq!((config.trigger.roi_px, config.trigger.post_s, config.trigger.rearm), (Some([1, 2, 3, 4]), 2.0, false));
    let record = config.record.as_ref().unwrap();
    assert_eq!((record.directory.as_path(), record.compression), (Path::new("a/b"), Compression::Zstd));
    assert_eq!((record.raw_frames, record.ring_bytes_max), (false, Some(1 << 20)));
    assert_eq!((record.keep_last, record.max_bytes, record.split_bytes), (Some(3), Some(1 << 20), Some(1 << 20)));
    assert_eq!((config.workers.count, config.workers.block_frames), (64, 256));
    assert_eq!(config.serve.http.unwrap().to_string(), "[::]:0");
    assert_eq!(config.serve.token_file.as_deref(), Some(Path::new("secret/token")));
}

#[test]
fn the_page_is_served_on_loopback_unless_the_file_turns_it_off() {
    let served = |rest: &str| parse(&format!("{SIMULATED}{rest}")).serve.http.map(|address| address.to_string());
    assert_eq!(served("").as_deref(), Some("127.0.0.1:8080"));
    assert_eq!(served("[serve]\nhttp = \"[::1]:81\"\n").as_deref(), Some("[::1]:81"));
    assert_eq!(served("[serve]\nhttp = \"off\"\n"), None);
    assert_eq!(served("[serve]\n").as_deref(), Some("127.0.0.1:8080"));
}

#[test]
fn broker_and_controller_are_off_unless_the_file_names_them() {
    let served = |rest: &str| {
        let serve = parse(&format!("{SIMULATED}[serve]\n{rest}")).serve;
        (serve.mqtt.map(|broker| broker.to_string()), serve.udp.map(|address| address.to_string()))
    };
    assert_eq!(served(""), (None, None));
    assert_eq!(served("mqtt = \"off\"\nudp = \"off\"\nhttp = \"off\"\n"), (None, None));
    let named = served("mqtt = \"[::1]:1883\"\nudp = \"239.1.2.3:5005\"\n");
    assert_eq!((named.0.as_deref(), named.1.as_deref()), (Some("[::1]:1883"), Some("239.1.2.3:5005")));
    assert_eq!(served("mqtt = \"broker.local:1883\"\n").0.as_deref(), Some("broker.local:1883"));
    let login =
        "mqtt = \"b:8883\"\nmqtt_user = \"rig\"\nmqtt_password_file = \"password\"\nmqtt_ca_file = \"ca.crt\"\n";
    let broker = parse(&format!("{SIMULATED}[serve]\n{login}")).serve.mqtt.unwrap();
    assert_eq!((broker.user.as_deref(), broker.port), (Some("rig"), 8883));
    assert_eq!(
        [broker.password_file, broker.ca_file].map(|file| file.unwrap()),
        ["password", "ca.crt"].map(std::path::PathBuf::from)
    );
}

#[test]
fn an_edge_gives_the_angle_and_the_trigger_modes_on_it_differ() {
    let config = parse(&format!(
        "{SIMULATED}[scale]\nmm_per_px = 0.5\n[surface]\nedge = [[0, 100], [100, 0]]\n[trigger]\n\
         mode = \"predicted-contact\"\nbody = \"ball\"\nlead_s = 0.5\nquiet_s = 3\ncommand = [\"a\", \"b\"]\n\
         url = \"http://host:81/x\"\nother_rig = \"side\"\n"
    ));
    assert_eq!(config.surface, Surface { angle_deg: 45.0, edge: Some([[0.0, 100.0], [100.0, 0.0]]), body: None });
    let trigger = &config.trigger;
    assert_eq!((trigger.mode, trigger.lead_s, trigger.quiet_s), (TriggerMode::PredictedContact, 0.5, 3.0));
    assert_eq!((trigger.body.as_deref(), trigger.other_rig.as_deref()), (Some("ball"), Some("side")));
    assert_eq!(
        (trigger.command.as_slice(), trigger.url.as_deref()),
        (["a", "b"].map(String::from).as_slice(), Some("http://host:81/x"))
    );
}

#[test]
fn properties_of_a_cameras_frames_apply_to_their_recording() {
    let camera = parse(FULL).with_recording("film.mcap".as_ref(), &[]).unwrap().camera;
    assert_eq!((camera.source, camera.exposure_us), (Some(Source::Recording), Some(1.0)));
    assert_eq!((camera.gamma, camera.row_time_us), (0.45, Some(-0.003)));
    assert_eq!(camera.defective_px, [[3, 4], [639, 319]]);
    let camera = parse(SIMULATED).with_recording("film.mcap".as_ref(), &[]).unwrap().camera;
    assert_eq!((camera.exposure_us, camera.gamma, camera.row_time_us), (None, 1.0, None));
    assert!(camera.defective_px.is_empty());
}

#[test]
fn a_view_is_a_separate_rig_that_inherits_nothing_from_the_first_camera() {
    let text = "[rig]\nname = \"drop\"\n[camera]\nsource = \"simulated\"\n[scale]\nmm_per_px = 0.5\n[velocity]\norder = 3\n\
                [trigger]\nmode = \"motion\"\npre_s = 0.2\n[record]\ndirectory = \"a\"\n[workers]\ncount = 3\nblock_frames = 8\n\
                [view.top.camera]\nsource = \"genicam\"\nid = \"x\"\nwidth_px = 64\nheight_px = 64\nframe_rate_hz = 9\n\
                [view.top.camera.features]\nGain = 1\n\
                [view.side.camera]\nsource = \"simulated\"\n[[view.side.body]]\nname = \"disc\"\n";
    let config = Config::parse(text, "rig.toml").unwrap();
    let names: Vec<_> = config.views.iter().map(|view| (view.name.as_str(), view.config.rig.name.as_str())).collect();
    assert_eq!(names, [("side", "drop-side"), ("top", "drop-top")]);
    let [side, top] = [&config.views[0].config, &config.views[1].config];
    assert_eq!((side.scale, side.velocity.order, side.bodies[0].name.as_str()), (None, 2, "disc"));
    assert_eq!((side.workers.count, top.workers.count), (3, 0), "without bodies nothing is measured");
    assert_eq!((top.workers.block_frames, top.trigger.mode, top.trigger.pre_s), (8, TriggerMode::Software, 0.2));
    assert_eq!((top.camera.id.as_deref(), top.camera.features.len(), top.record.is_some()), (Some("x"), 1, true));
    // The text that its processes get parses to the same configuration.
    assert_eq!(Config::parse(&top.text, &top.origin).unwrap(), *top);
    assert!(side.views.is_empty() && config.with_recording("film.mcap".as_ref(), &[]).unwrap().views.is_empty());
}

#[test]
fn every_file_in_the_config_folder_loads() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("config");
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|file| file.extension().is_some_and(|ending| ending == "toml"));
    files.sort();
    assert!(files.len() >= 3, "only {files:?}");
    for file in files {
        let config = Config::load(&file).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(config.text, std::fs::read_to_string(&file).unwrap());
    }
}

#[test]
fn ends_of_the_ranges_are_allowed() {
    for addition in [
        "width_px = 16\nheight_px = 65535\n[correlation]\nsubset_size_px = 9",
        "frame_rate_hz = 1000000\n[correlation]\nsubset_size_px = 255\nstep_px = 255\nmin_zncc = 1",
        "[scale]\nmm_per_px = 1000",
        "[velocity]\nwindow_frames = 1001\norder = 4\ngravity_angle_deg = 180",
        "[workers]\ncount = 1\nblock_frames = 4",
        "[trigger]\npre_s = 60\npost_s = 3600",
        "[rig]\nname = \"abcdefghijklmnopqrstuvwxyz_-0123\"",
    ] {
        parse(&format!("{SIMULATED}{addition}\n"));
    }
}

#[test]
fn radii_follow_from_diameter_and_scale_or_from_the_image() {
    let radii = |addition: &str| {
        let params = parse(&format!("{SIMULATED}{addition}\n")).ball(0, 512, 256);
        (params.min_radius_px, params.max_radius_px)
    };
    let near = |(low, high): (f64, f64), expected: (f64, f64)| {
        assert!(
            (low - expected.0).abs() < 1e-9 && (high - expected.1).abs() < 1e-9,
            "{low} to {high}, not {expected:?}"
        );
    };
    near(radii(""), (0.04 * 256.0, 0.45 * 256.0));
    near(radii("[scale]\nmm_per_px = 0.5\n[[body]]\ndiameter_mm = 60"), (48.0, 75.0));
    near(radii("[scale]\nball_diameter_mm = 60\n[[body]]\ndiameter_mm = 60"), (0.04 * 256.0, 0.45 * 256.0));
    near(radii("[[body]]\nmin_radius_px = 20\nmax_radius_px = 30"), (20.0, 30.0));
    near(radii("[[body]]\nmin_radius_px = 200"), (200.0, 300.0));
    near(radii("[[body]]\nmax_radius_px = 6"), (4.0, 6.0));
}

#[test]
fn motion_is_planned_from_the_file_and_needs_a_scale() {
    assert_eq!(parse(SIMULATED).motion(0, 1000.0, 0.0).scale, Scale::Unknown);
    let config = parse(&format!(
        "{SIMULATED}[scale]\nball_diameter_mm = 40\n[surface]\nangle_deg = 19\n[velocity]\ngravity_angle_deg = -71\nwindow_frames = 21\norder = 3\n[correlation]\ninterval_frames = 5\n[[body]]\nname = \"a\"\n[[body]]\nname = \"b\"\ndiameter_mm = 63.25\n"
    ));
    let params = config.motion(0, 10_000.0, 20.0);
    assert_eq!(
        (params.scale, params.surface_angle_deg, params.gravity_angle_deg),
        (Scale::BallDiameterMm(40.0), 19.0, -71.0)
    );
    assert_eq!((params.gravity_m_s2, params.window_frames, params.order), (9.806_65, Some(21), 3));
    assert_eq!((params.interval_frames, params.frame_period_ns), (5, 100_000.0));
    assert_eq!(params.exposure_ns, 20_000.0, "the camera's own, as the file gives none");
    assert_eq!(config.motion(1, 10_000.0, 0.0).scale, Scale::BallDiameterMm(63.25));
}

#[test]
fn gravity_points_along_the_path_of_the_falling_lacrosse_ball() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/lacrosse.toml");
    let config = Config::load(file).unwrap();
    let (vn_m_s, vt_m_s): (f64, f64) = (-1.69, 0.57);
    let falling_deg = vn_m_s.atan2(vt_m_s).to_degrees() + config.surface.angle_deg;
    // The paper rounds its velocities to 0.01 m/s and its angle to 1 deg.
    assert!((falling_deg - config.velocity.gravity_angle_deg).abs() < 1.0, "the ball falls along {falling_deg} deg");
}

#[test]
fn a_film_can_be_described_without_a_camera() {
    let config = parse("[scale]\nball_diameter_mm = 40\n");
    assert_eq!((config.camera.source, config.bodies[0].name.as_str()), (None, "ball"));
    let taken = parse("[camera]\nexposure_us = 20\ngamma = 0.45\nrow_time_us = 5\ndefective_px = [[3, 4]]\n").camera;
    assert_eq!((taken.exposure_us, taken.gamma, taken.row_time_us), (Some(20.0), 0.45, Some(5.0)));
    let error = config.check_sources().unwrap_err().to_string();
    let sources = "\"simulated\", \"recording\", \"genicam\", \"v4l2\"";
    assert_eq!(error, format!("rig.toml: camera.source is missing: must be {sources} for a rig that runs"));
    assert!(parse("[camera]\nsource = \"simulated\"\n").check_sources().is_ok());
    let view = parse("[camera]\nsource = \"simulated\"\n[view.side.scale]\nmm_per_px = 1\n");
    let error = view.check_sources().unwrap_err().to_string();
    assert_eq!(error, format!("rig.toml [view.side]: camera.source is missing: must be {sources} for a rig that runs"));
}
