//! The rig file: what it says when something is wrong, and what it means when nothing is.

use ricochet::config::{Compression, Config, ConfigError, FeatureValue, Scale, Source, TriggerMode};
use ricochet::dic::{CorrelationParams, Method, Shape, WindowShape};
use ricochet::image::PixelFormat;
use std::path::{Path, PathBuf};

const SIMULATED: &str = "[camera]\nsource = \"simulated\"\n";
const GENICAM: &str = "[camera]\nsource = \"genicam\"\nid = \"10.0.0.2\"\nwidth_px = 512\nheight_px = 512\nframe_rate_hz = 1000\n";

fn parse(text: &str) -> Config {
    Config::parse(text, "rig.toml").unwrap_or_else(|error| panic!("refused:\n{text}\n{error}"))
}

/// What is said of `text`; a panic when it is accepted or more than one line is said.
fn refusal(text: &str) -> String {
    let message = match Config::parse(text, "rig.toml") {
        Ok(_) => panic!("accepted:\n{text}"),
        Err(error) => error.to_string(),
    };
    assert!(!message.contains('\n'), "more than one line: {message}");
    message
}

/// Each addition to a simulated rig is refused with this sentence after the file's name.
fn refused_on_a_simulated_rig(cases: &[(&str, &str)]) {
    for (addition, said) in cases {
        assert_eq!(refusal(&format!("{SIMULATED}{addition}\n")), format!("rig.toml{said}"), "for {addition}");
    }
}

#[test]
fn a_camera_alone_is_a_whole_rig_with_the_documented_defaults() {
    let config = parse(SIMULATED);
    assert_eq!(config.rig.name, "rig");
    assert_eq!((config.camera.source, config.camera.scenario.as_deref()), (Source::Simulated, Some("lacrosse")));
    assert_eq!((config.camera.paced, config.camera.looped), (true, false));
    assert_eq!((config.camera.image_px(), config.camera.pixel_format, config.camera.frame_rate_hz), (None, None, None));
    assert_eq!((config.scale, config.record.as_ref()), (None, None));
    assert_eq!((config.bodies.len(), config.bodies[0].name.as_str()), (1, "ball"));
    assert_eq!(config.correlation, CorrelationParams::default());
    assert_eq!((config.velocity.order, config.velocity.window_frames), (2, None));
    assert_eq!((config.velocity.gravity_m_s2, config.velocity.gravity_angle_deg), (9.806_65, -90.0));
    assert_eq!((config.trigger.mode, config.trigger.rearm), (TriggerMode::Off, true));
    assert_eq!((config.trigger.pre_s, config.trigger.post_s), (0.05, 0.1));
    assert!((1..=64).contains(&config.workers.count));
    assert_eq!(config.workers.block_frames, 16);
    assert_eq!((config.text.as_str(), config.origin.as_str()), (SIMULATED, "rig.toml"));
}

#[test]
fn every_key_arrives_where_it_belongs() {
    let config = parse(
        r#"
        rig = { name = "drop_1" }
        scale = { ball_diameter_mm = 40 }
        surface = { angle_deg = 19.5, edge = [[0, 300], [400, 160]] }
        correlation = { method = "peak-spline", shape = "rigid", window = "circle", subset_size_px = 9, step_px = 255, spline_points = 20, search_px = 1024, interval_frames = 255, min_zncc = 0 }
        rotation = { method = "ring", ring_inner_px = 3, ring_outer_px = 5.5 }
        velocity = { window_frames = 3, order = 1, gravity_m_s2 = 0, gravity_angle_deg = -71 }
        trigger = { mode = "motion", threshold_dn = 7, roi_px = [1, 2, 3, 4], pre_s = 0, post_s = 2, rearm = false }
        record = { directory = "a/b", compression = "zstd", raw_frames = false, ring_bytes_max = 1048576 }
        workers = { count = 64, block_frames = 256 }
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
        trigger_source = "Line1"
        packet_size_bytes = 9000
        features = { Flag = true, Count = -3, Gain = 1.5, Mode = "Off" }
        [[body]]
        name = "left"
        kind = "ball"
        diameter_mm = 63.25
        min_radius_px = 10
        max_radius_px = 20
        roi_px = [0, 0, 640, 320]
        [[body]]
        name = "right"
        "#,
    );
    assert_eq!(config.rig.name, "drop_1");
    let camera = &config.camera;
    assert_eq!((camera.source, camera.id.as_deref(), camera.image_px()), (Source::Genicam, Some("maker-1234"), Some((640, 320))));
    assert_eq!((camera.offset_x_px, camera.offset_y_px, camera.pixel_format), (Some(8), Some(4), Some(PixelFormat::Mono12)));
    assert_eq!((camera.frame_rate_hz, camera.exposure_us), (Some(1.0e6), Some(1.0)));
    assert_eq!((camera.trigger_source.as_deref(), camera.packet_size_bytes), (Some("Line1"), Some(9000)));
    assert_eq!(camera.features["Flag"], FeatureValue::Bool(true));
    assert_eq!(camera.features["Count"], FeatureValue::Integer(-3));
    assert_eq!(camera.features["Gain"], FeatureValue::Float(1.5));
    assert_eq!(camera.features["Mode"], FeatureValue::Text("Off".into()));
    assert_eq!(config.scale, Some(Scale::BallDiameterMm(40.0)));
    assert_eq!((config.surface.angle_deg, config.surface.edge_px), (19.5, Some([[0.0, 300.0], [400.0, 160.0]])));
    let names: Vec<&str> = config.bodies.iter().map(|body| body.name.as_str()).collect();
    assert_eq!((names, config.bodies[0].roi_px), (vec!["left", "right"], Some([0, 0, 640, 320])));
    let correlation = CorrelationParams {
        method: Method::PeakSpline,
        shape: Shape::Rigid,
        window: WindowShape::Circle,
        subset_size_px: 9,
        step_px: 255,
        spline_points: 20,
        search_px: 1024,
        interval_frames: 255,
        min_zncc: 0.0,
    };
    assert_eq!(config.correlation(), correlation);
    assert_eq!((config.rotation.ring_inner_px, config.rotation.ring_outer_px), (Some(3.0), Some(5.5)));
    assert_eq!((config.trigger.mode, config.trigger.threshold_dn), (TriggerMode::Motion, 7.0));
    assert_eq!((config.trigger.roi_px, config.trigger.post_s, config.trigger.rearm), (Some([1, 2, 3, 4]), 2.0, false));
    let record = config.record.as_ref().unwrap();
    assert_eq!((record.directory.as_path(), record.compression), (Path::new("a/b"), Compression::Zstd));
    assert_eq!((record.raw_frames, record.ring_bytes_max), (false, Some(1 << 20)));
    assert_eq!((config.workers.count, config.workers.block_frames), (64, 256));
}

#[test]
fn every_file_in_the_config_folder_loads() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("config");
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    assert!(files.len() >= 3, "only {files:?}");
    for file in files {
        let config = Config::load(&file).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(config.text, std::fs::read_to_string(&file).unwrap());
    }
}

#[test]
fn an_unknown_key_is_refused_and_the_nearest_known_one_named() {
    refused_on_a_simulated_rig(&[
        ("widht_px = 5", ", line 3: unknown key camera.widht_px; the nearest known key is camera.width_px"),
        ("[camrea]", ", line 3: unknown key camrea; the nearest known key is camera"),
        ("[[body]]\n[[body]]\nradius_px = 3", ", line 5: unknown key body[1].radius_px; the nearest known key is body[1].roi_px"),
        ("[rig]\nNAME = \"a\"", ", line 4: unknown key rig.NAME; the nearest known key is rig.name"),
        ("[bridge]\nzenho = 1", ", line 4: unknown key bridge.zenho; the nearest known key is bridge.zenoh"),
        ("fps = 3", ", line 3: unknown key camera.fps; the nearest known key is camera.id"),
    ]);
    assert_eq!(refusal("\n\nx = 1"), "rig.toml, line 3: unknown key x; the nearest known key is rig");
}

#[test]
fn a_value_of_the_wrong_type_is_refused_in_plain_words() {
    refused_on_a_simulated_rig(&[
        ("width_px = \"512\"", ", line 3: camera.width_px = \"512\": must be a whole number"),
        ("width_px = 512.5", ", line 3: camera.width_px = 512.5: must be a whole number"),
        ("frame_rate_hz = true", ", line 3: camera.frame_rate_hz = true: must be a number"),
        ("paced = 1", ", line 3: camera.paced = 1: must be true or false"),
        ("scenario = 3", ", line 3: camera.scenario = 3: must be a text in quotes"),
        ("[trigger]\nroi_px = [1, 2, \"3\", 4]", ", line 4: trigger.roi_px[2] = \"3\": must be a whole number"),
        ("[surface]\nedge = 4", ", line 4: surface.edge = 4: must be a list"),
        ("[workers]\ncount = 99999999999999999999", ", line 4: workers.count = 99999999999999999999: must be a whole number"),
    ]);
    assert_eq!(refusal("rig = \"a\""), "rig.toml, line 1: rig = \"a\": must be a table");
    assert_eq!(refusal("body = 3"), "rig.toml, line 1: body = 3: must be a list");
}

#[test]
fn numbers_out_of_range_are_refused_with_the_range_and_its_unit() {
    refused_on_a_simulated_rig(&[
        ("width_px = 15", ", line 3: camera.width_px = 15: must be 16 to 65535 px"),
        ("height_px = 65536", ", line 3: camera.height_px = 65536: must be 16 to 65535 px"),
        ("height_px = -512", ", line 3: camera.height_px = -512: must be 16 to 65535 px"),
        ("frame_rate_hz = 0", ", line 3: camera.frame_rate_hz = 0: must be above 0 and at most 1000000 Hz"),
        ("frame_rate_hz = 1000000.5", ", line 3: camera.frame_rate_hz = 1000000.5: must be above 0 and at most 1000000 Hz"),
        ("frame_rate_hz = nan", ", line 3: camera.frame_rate_hz = nan: must be above 0 and at most 1000000 Hz"),
        ("frame_rate_hz = inf", ", line 3: camera.frame_rate_hz = inf: must be above 0 and at most 1000000 Hz"),
        ("exposure_us = 0", ", line 3: camera.exposure_us = 0: must be above 0 and at most 10000000 us"),
        ("[scale]\nmm_per_px = 0", ", line 4: scale.mm_per_px = 0: must be 0.000001 to 1000 mm/px"),
        ("[scale]\nball_diameter_mm = -1", ", line 4: scale.ball_diameter_mm = -1: must be above 0 and at most 10000 mm"),
        ("[surface]\nangle_deg = -181", ", line 4: surface.angle_deg = -181: must be -180 to 180 deg"),
        ("[surface]\nangle_deg = 180.5", ", line 4: surface.angle_deg = 180.5: must be -180 to 180 deg"),
        ("[[body]]\ndiameter_mm = 10001", ", line 4: body[0].diameter_mm = 10001: must be above 0 and at most 10000 mm"),
        ("[[body]]\nmin_radius_px = 1", ", line 4: body[0].min_radius_px = 1: must be 2 to 32768 px"),
        ("[[body]]\nmax_radius_px = 40000", ", line 4: body[0].max_radius_px = 40000: must be 2 to 32768 px"),
        ("[correlation]\nsubset_size_px = 7", ", line 4: correlation.subset_size_px = 7: must be 9 to 255 px, odd"),
        ("[correlation]\nsubset_size_px = 257", ", line 4: correlation.subset_size_px = 257: must be 9 to 255 px, odd"),
        ("[correlation]\nstep_px = 0", ", line 4: correlation.step_px = 0: must be 1 to 255 px"),
        ("[correlation]\nspline_points = 21", ", line 4: correlation.spline_points = 21: must be 0 to 20"),
        ("[correlation]\nsearch_px = 0", ", line 4: correlation.search_px = 0: must be 1 to 1024 px"),
        ("[correlation]\ninterval_frames = 256", ", line 4: correlation.interval_frames = 256: must be 1 to 255 frames"),
        ("[correlation]\nmin_zncc = 1.01", ", line 4: correlation.min_zncc = 1.01: must be 0 to 1"),
        ("[rotation]\nring_inner_px = -1", ", line 4: rotation.ring_inner_px = -1: must be 0 to 32768 px"),
        ("[rotation]\nring_outer_px = 0", ", line 4: rotation.ring_outer_px = 0: must be above 0 and at most 32768 px"),
        ("[velocity]\nwindow_frames = 1", ", line 4: velocity.window_frames = 1: must be 3 to 1001 frames, odd"),
        ("[velocity]\norder = 5", ", line 4: velocity.order = 5: must be 1 to 4"),
        ("[velocity]\ngravity_m_s2 = -9.81", ", line 4: velocity.gravity_m_s2 = -9.81: must be 0 to 100 m/s^2"),
        ("[velocity]\ngravity_angle_deg = 200", ", line 4: velocity.gravity_angle_deg = 200: must be -180 to 180 deg"),
        ("[trigger]\nthreshold_dn = 0", ", line 4: trigger.threshold_dn = 0: must be above 0 and at most 65535 DN"),
        ("[trigger]\npre_s = -0.1", ", line 4: trigger.pre_s = -0.1: must be 0 to 60 s"),
        ("[trigger]\npost_s = 0", ", line 4: trigger.post_s = 0: must be above 0 and at most 3600 s"),
        ("[record]\ndirectory = \"a\"\nring_bytes_max = 5", ", line 5: record.ring_bytes_max = 5: must be 1048576 to 1099511627776 bytes"),
        ("[workers]\ncount = 0", ", line 4: workers.count = 0: must be 1 to 64"),
        ("[workers]\ncount = 65", ", line 4: workers.count = 65: must be 1 to 64"),
        ("[workers]\nblock_frames = 3", ", line 4: workers.block_frames = 3: must be 4 to 256 frames"),
        ("[workers]\nblock_frames = 257", ", line 4: workers.block_frames = 257: must be 4 to 256 frames"),
    ]);
    let packet = refusal(&format!("{GENICAM}packet_size_bytes = 575\n"));
    assert_eq!(packet, "rig.toml, line 7: camera.packet_size_bytes = 575: must be 576 to 65535 bytes");
    let offset = refusal(&format!("{GENICAM}offset_x_px = -1\n"));
    assert_eq!(offset, "rig.toml, line 7: camera.offset_x_px = -1: must be 0 to 65535 px");
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
fn words_that_mean_nothing_are_refused_with_the_ones_that_do() {
    refused_on_a_simulated_rig(&[
        ("pixel_format = \"mono8\"", ", line 3: camera.pixel_format = \"mono8\": must be \"Mono8\", \"Mono10\", \"Mono12\", \"Mono16\""),
        ("[correlation]\nmethod = \"icgn\"", ", line 4: correlation.method = \"icgn\": must be \"spline-fft\", \"peak-gaussian\", \"peak-spline\", \"ic-gn\""),
        ("[correlation]\nshape = \"cubic\"", ", line 4: correlation.shape = \"cubic\": must be \"translation\", \"rigid\", \"affine\", \"quadratic\""),
        ("[correlation]\nwindow = \"disc\"", ", line 4: correlation.window = \"disc\": must be \"square\", \"circle\", \"ring\""),
        ("[rotation]\nmethod = \"hough\"", ", line 4: rotation.method = \"hough\": must be \"field\", \"ring\", \"rigid\""),
        ("[trigger]\nmode = \"on\"", ", line 4: trigger.mode = \"on\": must be \"off\", \"software\", \"motion\""),
        ("[record]\ndirectory = \"a\"\ncompression = \"lz4\"", ", line 5: record.compression = \"lz4\": must be \"none\", \"zstd\""),
        ("[[body]]\nkind = \"cube\"", ", line 4: body[0].kind = \"cube\": must be \"ball\""),
    ]);
    let source = refusal("[camera]\nsource = \"usb\"\n");
    assert_eq!(source, "rig.toml, line 2: camera.source = \"usb\": must be \"simulated\", \"recording\", \"genicam\"");
}

#[test]
fn what_this_version_does_not_offer_is_refused_by_name() {
    let modes = "allowed: \"off\", \"software\", \"motion\"";
    refused_on_a_simulated_rig(&[
        ("[trigger]\nmode = \"hardware\"", &format!(", line 4: trigger.mode = \"hardware\" is not offered by this version; {modes}")),
        ("[trigger]\nmode = \"predicted-contact\"", &format!(", line 4: trigger.mode = \"predicted-contact\" is not offered by this version; {modes}")),
        ("[[body]]\nkind = \"rod\"", ", line 4: body[0].kind = \"rod\" is not offered by this version; allowed: \"ball\""),
        ("[[body]]\nkind = \"patch\"", ", line 4: body[0].kind = \"patch\" is not offered by this version; allowed: \"ball\""),
        ("[serve]\nhttp = \"127.0.0.1:8080\"", ", line 3: the table [serve] is not offered by this version; leave it out"),
        ("[bridge]\nzenoh = {}", ", line 3: the table [bridge] is not offered by this version; leave it out"),
    ]);
    let v4l2 = refusal("[camera]\nsource = \"v4l2\"\n");
    assert_eq!(v4l2, "rig.toml, line 2: camera.source = \"v4l2\" is not offered by this version; allowed: \"simulated\", \"recording\", \"genicam\"");
}

#[test]
fn keys_of_another_setting_are_refused_and_not_ignored() {
    refused_on_a_simulated_rig(&[
        ("id = \"a\"", ", line 3: camera.id = \"a\": does not go with source = \"simulated\"; it belongs to source = \"recording\", \"genicam\""),
        ("features = { Gain = 1 }", ", line 3: camera.features = { Gain = 1 }: does not go with source = \"simulated\"; it belongs to source = \"genicam\""),
        ("[[body]]\ncenter_px = [1, 2]", ", line 4: body[0].center_px = [1, 2]: does not go with kind = \"ball\"; it belongs to kind = \"patch\""),
    ]);
    let paced = refusal(&format!("{GENICAM}paced = false\n"));
    assert_eq!(paced, "rig.toml, line 7: camera.paced = false: does not go with source = \"genicam\"; it belongs to source = \"simulated\", \"recording\"");
    let width = refusal("[camera]\nsource = \"recording\"\nid = \"a.mcap\"\nwidth_px = 512\n");
    assert_eq!(width, "rig.toml, line 4: camera.width_px = 512: does not go with source = \"recording\"; it belongs to source = \"simulated\", \"genicam\"");
}

#[test]
fn missing_keys_are_named() {
    assert_eq!(refusal(""), "rig.toml: camera.source is missing: must be \"simulated\", \"recording\", \"genicam\"");
    let recording = refusal("[camera]\nsource = \"recording\"\n");
    assert_eq!(recording, "rig.toml: camera.id is missing: must be the path of an MCAP file for source = \"recording\"");
    for (key, said) in [
        ("id", "the address, serial number or name of a camera"),
        ("width_px", "16 to 65535 px"),
        ("height_px", "16 to 65535 px"),
        ("frame_rate_hz", "above 0 and at most 1000000 Hz"),
    ] {
        let without: String = GENICAM.lines().filter(|line| !line.starts_with(key)).map(|line| format!("{line}\n")).collect();
        assert_eq!(refusal(&without), format!("rig.toml: camera.{key} is missing: must be {said} for source = \"genicam\""));
    }
    refused_on_a_simulated_rig(&[
        ("[record]", ": record.directory is missing: must be the path of a folder"),
        ("[[body]]\nname = \"a\"\n[[body]]", ": body[1].name is missing: must be 1 to 32 of the characters a-z A-Z 0-9 _ -"),
    ]);
}

#[test]
fn values_at_odds_are_refused() {
    refused_on_a_simulated_rig(&[
        ("[correlation]\nsubset_size_px = 30", ", line 4: correlation.subset_size_px = 30: must be odd, 9 to 255 px"),
        ("[velocity]\nwindow_frames = 20", ", line 4: velocity.window_frames = 20: must be odd, 3 to 1001 frames"),
        ("[velocity]\nwindow_frames = 3\norder = 4", ", line 4: velocity.window_frames = 3: must be more than order = 4"),
        ("[[body]]\nmin_radius_px = 20\nmax_radius_px = 20", ", line 4: body[0].min_radius_px = 20: must be less than max_radius_px = 20 px"),
        ("[rotation]\nring_inner_px = 6\nring_outer_px = 5", ", line 4: rotation.ring_inner_px = 6: must be less than ring_outer_px = 5 px"),
        ("[scale]\nmm_per_px = 1\nball_diameter_mm = 3", ", line 5: scale.ball_diameter_mm = 3: must be left out, because mm_per_px is given too"),
        ("[[body]]\nname = \"a\"\n[[body]]\nname = \"a\"", ", line 6: body[1].name = \"a\": must be different from the names of the bodies before it"),
        ("frame_rate_hz = 10000\nexposure_us = 101", ", line 4: camera.exposure_us = 101: must be at most 100 us, as long as a frame at 10000 Hz lasts"),
        ("width_px = 32\nheight_px = 20", ": correlation.subset_size_px is 31 when left out: must be at most 20 px, the smaller side of the image"),
        ("[surface]\nedge = [[0, 0], [10, 10]]", ", line 4: surface.edge = [[0, 0], [10, 10]]: must be within 10 deg of angle_deg = 0 deg"),
        ("[surface]\nedge = [[5, 5], [5, 5]]", ", line 4: surface.edge = [[5, 5], [5, 5]]: must be two different points [[x, y], [x, y]], each number -65536 to 65536 px"),
        ("[rig]\nname = \"Drop 1\"", ", line 4: rig.name = \"Drop 1\": must be 1 to 32 of the characters a-z 0-9 _ -"),
        ("[rig]\nname = \"\"", ", line 4: rig.name = \"\": must be 1 to 32 of the characters a-z 0-9 _ -"),
        ("[record]\ndirectory = \" \"", ", line 4: record.directory = \" \": must be a text of one line that is not empty"),
    ]);
    let feature = refusal(&format!("{GENICAM}features = {{ A = [1] }}\n"));
    assert_eq!(feature, "rig.toml, line 7: camera.features.A = [1]: must be true or false, a finite number, or a text in quotes");
}

#[test]
fn regions_outside_the_image_are_refused() {
    let image = "width_px = 100\nheight_px = 50\n";
    let inside = "must be [x, y, width, height] inside the image of 100 x 50 px";
    for region in ["[0, 0, 101, 50]", "[1, 0, 100, 50]", "[0, 50, 1, 1]", "[-1, 0, 5, 5]", "[0, 0, 0, 5]", "[0, 0, 5]", "[9223372036854775807, 0, 1, 1]"] {
        refused_on_a_simulated_rig(&[
            (&format!("{image}[[body]]\nroi_px = {region}"), &format!(", line 6: body[0].roi_px = {region}: {inside}")),
            (&format!("{image}[trigger]\nroi_px = {region}"), &format!(", line 6: trigger.roi_px = {region}: {inside}")),
        ]);
    }
    parse(&format!("{SIMULATED}{image}[[body]]\nroi_px = [0, 0, 100, 50]\n"));
    refused_on_a_simulated_rig(&[(
        "[trigger]\nroi_px = [0, 0, 65535, 65536]",
        ", line 4: trigger.roi_px = [0, 0, 65535, 65536]: must be [x, y, width, height] inside an image of at most 65535 x 65535 px",
    )]);
}

#[test]
fn a_pre_trigger_time_that_the_ring_cannot_hold_is_refused() {
    let rig = |bytes: u64| format!("{GENICAM}[trigger]\nmode = \"software\"\npre_s = 0.1\n[record]\ndirectory = \"a\"\nring_bytes_max = {bytes}\n");
    // 100 frames of 512 x 512 bytes.
    let fitting = parse(&rig(26_214_400));
    assert_eq!(fitting.pre_trigger_frames(1000.0), 100);
    assert_eq!(
        refusal(&rig(26_214_399)),
        "rig.toml, line 12: record.ring_bytes_max = 26214399: must be at least 26214400 bytes to hold trigger.pre_s = 0.1 s at 1000 Hz"
    );
    assert!(fitting.check_ring(512 * 512 * 2, 1000.0).is_err(), "a camera of twice the bytes was let through");
    assert_eq!(parse(&rig(1 << 30).replace("software", "off")).pre_trigger_frames(1000.0), 0);
}

#[test]
fn text_that_is_not_toml_is_refused_with_its_line() {
    for (text, line) in [("[camera\n", 1), ("a = 1\nb =\n", 2), ("a = 1\n\na = 2\n", 3), ("\u{1}", 1), ("[camera]\nsource = \"simulated", 2)] {
        let said = refusal(text);
        assert!(said.starts_with(&format!("rig.toml, line {line}: not TOML: ")), "{said}");
    }
}

#[test]
fn files_that_cannot_be_read_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, content: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        path
    };
    let large = file("large.toml", &b"#".repeat((1 << 20) + 1));
    let binary = file("shot.mcap", b"\x89MCAP0\r\n\xff\xfe");
    let missing = folder.path().join("missing.toml");
    for (path, reason) in [
        (missing.as_path(), "No such file or directory (os error 2)"),
        (folder.path(), "Is a directory (os error 21)"),
        (large.as_path(), "larger than 1048576 bytes"),
        (binary.as_path(), "stream did not contain valid UTF-8"),
    ] {
        let error = Config::load(path).unwrap_err();
        assert_eq!(error.to_string(), format!("read configuration {}: {reason}", path.display()));
        assert!(matches!(error, ConfigError::Unreadable { .. }));
    }
}

#[test]
fn long_values_are_cut_in_messages() {
    let said = refusal(&format!("{SIMULATED}[rig]\nname = \"{}\"\n", "long ".repeat(100)));
    assert!(said.len() < 200 && said.contains("...: must be"), "{said}");
}

#[test]
fn radii_follow_from_diameter_and_scale_or_from_the_image() {
    let radii = |addition: &str| {
        let params = parse(&format!("{SIMULATED}{addition}\n")).ball(0, 512, 256);
        (params.min_radius_px, params.max_radius_px)
    };
    let near = |(low, high): (f64, f64), expected: (f64, f64)| {
        assert!((low - expected.0).abs() < 1e-9 && (high - expected.1).abs() < 1e-9, "{low} to {high}, not {expected:?}");
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
    assert_eq!(parse(SIMULATED).motion(0, 1000.0), None);
    let config = parse(&format!(
        "{SIMULATED}[scale]\nball_diameter_mm = 40\n[surface]\nangle_deg = 19\n[velocity]\ngravity_angle_deg = -71\nwindow_frames = 21\norder = 3\n[correlation]\ninterval_frames = 5\n[[body]]\nname = \"a\"\n[[body]]\nname = \"b\"\ndiameter_mm = 63.25\n"
    ));
    let params = config.motion(0, 10_000.0).unwrap();
    assert_eq!((params.scale, params.surface_angle_deg, params.gravity_angle_deg), (Scale::BallDiameterMm(40.0), 19.0, -71.0));
    assert_eq!((params.gravity_m_s2, params.window_frames, params.order), (9.806_65, Some(21), 3));
    assert_eq!((params.interval_frames, params.frame_period_ns), (5, 100_000.0));
    assert_eq!(config.motion(1, 10_000.0).unwrap().scale, Scale::BallDiameterMm(63.25));
}

#[test]
fn gravity_points_along_the_way_the_lacrosse_ball_comes_in() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/lacrosse.toml");
    let config = Config::load(file).unwrap();
    let (vn_m_s, vt_m_s): (f64, f64) = (-1.69, 0.57);
    let falling_deg = vn_m_s.atan2(vt_m_s).to_degrees() + config.surface.angle_deg;
    // The paper rounds its speeds to 0.01 m/s and its angle to 1 deg.
    assert!((falling_deg - config.velocity.gravity_angle_deg).abs() < 1.0, "the ball falls along {falling_deg} deg");
}
