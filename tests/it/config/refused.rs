//! Keys and values that are refused, and the message for each.

use super::{GENICAM, SIMULATED, refusal, refused_on_a_simulated_rig};

#[test]
fn an_unknown_key_is_refused_and_the_nearest_known_one_named() {
    refused_on_a_simulated_rig(&[
        ("widht_px = 5", ", line 3: unknown key camera.widht_px; the nearest known key is camera.width_px"),
        ("[camrea]", ", line 3: unknown key camrea; the nearest known key is camera"),
        (
            "[[body]]\n[[body]]\nradius_px = 3",
            ", line 5: unknown key body[1].radius_px; the nearest known key is body[1].min_radius_px",
        ),
        ("[rig]\nNAME = \"a\"", ", line 4: unknown key rig.NAME; the nearest known key is rig.name"),
        ("[bridge]\nzenho = 1", ", line 4: unknown key bridge.zenho; the nearest known key is bridge.zenoh"),
        ("fps = 3", ", line 3: unknown key camera.fps; the nearest known key is camera.id"),
    ]);
    let odd = refusal("[rig]\n\"a.b\\nna`me\" = 1");
    assert_eq!(odd, "rig.toml, line 2: unknown key rig.\"a.b\\nna`me\"; the nearest known key is rig.name");
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
        (
            "[workers]\ncount = 99999999999999999999",
            ", line 4: workers.count = 99999999999999999999: must be a whole number",
        ),
    ]);
    assert_eq!(refusal("rig = \"a\""), "rig.toml, line 1: rig = \"a\": must be a table");
    assert_eq!(refusal("body = 3"), "rig.toml, line 1: body = 3: must be a list");
}

#[test]
fn bounds_of_recordings_out_of_range_are_refused() {
    refused_on_a_simulated_rig(&[
        (
            "[record]\ndirectory = \"a\"\nring_bytes_max = 5",
            ", line 5: record.ring_bytes_max = 5: must be 1048576 to 1099511627776 bytes",
        ),
        (
            "[record]\ndirectory = \"a\"\nkeep_last = 0",
            ", line 5: record.keep_last = 0: must be 1 to 1000000 recordings",
        ),
        (
            "[record]\ndirectory = \"a\"\nmax_bytes = 1000",
            ", line 5: record.max_bytes = 1000: must be 1048576 to 1125899906842624 bytes",
        ),
    ]);
}

#[test]
fn numbers_out_of_range_are_refused_with_the_range_and_its_unit() {
    refused_on_a_simulated_rig(&[
        ("width_px = 15", ", line 3: camera.width_px = 15: must be 16 to 65535 px"),
        ("height_px = 65536", ", line 3: camera.height_px = 65536: must be 16 to 65535 px"),
        ("height_px = -512", ", line 3: camera.height_px = -512: must be 16 to 65535 px"),
        ("frame_rate_hz = 0", ", line 3: camera.frame_rate_hz = 0: must be above 0 and at most 1000000 Hz"),
        (
            "frame_rate_hz = 1000000.5",
            ", line 3: camera.frame_rate_hz = 1000000.5: must be above 0 and at most 1000000 Hz",
        ),
        ("frame_rate_hz = nan", ", line 3: camera.frame_rate_hz = nan: must be above 0 and at most 1000000 Hz"),
        ("frame_rate_hz = inf", ", line 3: camera.frame_rate_hz = inf: must be above 0 and at most 1000000 Hz"),
        ("exposure_us = 0", ", line 3: camera.exposure_us = 0: must be above 0 and at most 10000000 us"),
        ("row_time_us = -1001", ", line 3: camera.row_time_us = -1001: must be -1000 to 1000 us"),
        (
            "defective_px = [[3, 4], [5]]",
            ", line 3: camera.defective_px = [[3, 4], [5]]: must be at most 10000 pairs of column and row, each 0 to 65534",
        ),
        (
            "defective_px = [[3, 65535]]",
            ", line 3: camera.defective_px = [[3, 65535]]: must be at most 10000 pairs of column and row, each 0 to 65534",
        ),
        ("gamma = 0.1", ", line 3: camera.gamma = 0.1: must be 0.2 to 5"),
        ("[scale]\nmm_per_px = 0", ", line 4: scale.mm_per_px = 0: must be 0.000001 to 1000 mm/px"),
        (
            "[scale]\nball_diameter_mm = -1",
            ", line 4: scale.ball_diameter_mm = -1: must be above 0 and at most 10000 mm",
        ),
        ("[surface]\nangle_deg = -181", ", line 4: surface.angle_deg = -181: must be -180 to 180 deg"),
        ("[surface]\nangle_deg = 180.5", ", line 4: surface.angle_deg = 180.5: must be -180 to 180 deg"),
        (
            "[[body]]\ndiameter_mm = 10001",
            ", line 4: body[0].diameter_mm = 10001: must be above 0 and at most 10000 mm",
        ),
        ("[[body]]\nmin_radius_px = 1", ", line 4: body[0].min_radius_px = 1: must be 2 to 32768 px"),
        ("[[body]]\nmax_radius_px = 40000", ", line 4: body[0].max_radius_px = 40000: must be 2 to 32768 px"),
        ("[correlation]\nsubset_size_px = 7", ", line 4: correlation.subset_size_px = 7: must be 9 to 255 px, odd"),
        ("[correlation]\nsubset_size_px = 257", ", line 4: correlation.subset_size_px = 257: must be 9 to 255 px, odd"),
        ("[correlation]\nstep_px = 0", ", line 4: correlation.step_px = 0: must be 1 to 255 px"),
        ("[correlation]\nspline_points = 21", ", line 4: correlation.spline_points = 21: must be 0 to 20"),
        ("[correlation]\nsearch_px = 0", ", line 4: correlation.search_px = 0: must be 1 to 1024 px"),
        (
            "[correlation]\ninterval_frames = 256",
            ", line 4: correlation.interval_frames = 256: must be 1 to 255 frames, or a rising list of at most 4 such numbers",
        ),
        (
            "[correlation]\ninterval_frames = [4, 1]",
            ", line 4: correlation.interval_frames = [4, 1]: must be 1 to 255 frames, or a rising list of at most 4 such numbers",
        ),
        (
            "[correlation]\ninterval_frames = []",
            ", line 4: correlation.interval_frames = []: must be 1 to 255 frames, or a rising list of at most 4 such numbers",
        ),
        ("[correlation]\nmin_zncc = 1.01", ", line 4: correlation.min_zncc = 1.01: must be 0 to 1"),
        ("[velocity]\nwindow_frames = 1", ", line 4: velocity.window_frames = 1: must be 3 to 1001 frames, odd"),
        ("[velocity]\norder = 5", ", line 4: velocity.order = 5: must be 1 to 4"),
        ("[velocity]\ngravity_m_s2 = -9.81", ", line 4: velocity.gravity_m_s2 = -9.81: must be 0 to 100 m/s^2"),
        ("[velocity]\ngravity_angle_deg = 200", ", line 4: velocity.gravity_angle_deg = 200: must be -180 to 180 deg"),
        ("[trigger]\nthreshold_dn = 0", ", line 4: trigger.threshold_dn = 0: must be above 0 and at most 65535 DN"),
        ("[trigger]\npre_s = -0.1", ", line 4: trigger.pre_s = -0.1: must be 0 to 60 s"),
        ("[trigger]\npost_s = 0", ", line 4: trigger.post_s = 0: must be above 0 and at most 3600 s"),
        ("[workers]\ncount = -1", ", line 4: workers.count = -1: must be 0 to 64"),
        ("[workers]\ncount = 65", ", line 4: workers.count = 65: must be 0 to 64"),
        ("[workers]\nblock_frames = 3", ", line 4: workers.block_frames = 3: must be 4 to 256 frames"),
        ("[workers]\nblock_frames = 257", ", line 4: workers.block_frames = 257: must be 4 to 256 frames"),
    ]);
    let packet = refusal(&format!("{GENICAM}packet_size_bytes = 575\n"));
    assert_eq!(packet, "rig.toml, line 7: camera.packet_size_bytes = 575: must be 576 to 65535 bytes");
    let offset = refusal(&format!("{GENICAM}offset_x_px = -1\n"));
    assert_eq!(offset, "rig.toml, line 7: camera.offset_x_px = -1: must be 0 to 65535 px");
}

#[test]
fn unknown_words_are_refused_with_the_known_ones() {
    refused_on_a_simulated_rig(&[
        (
            "pixel_format = \"mono8\"",
            ", line 3: camera.pixel_format = \"mono8\": must be \"Mono8\", \"Mono10\", \"Mono12\", \"Mono16\"",
        ),
        (
            "[correlation]\nmethod = \"icgn\"",
            ", line 4: correlation.method = \"icgn\": must be \"spline-fft\", \"peak-gaussian\", \"peak-spline\", \"ic-gn\"",
        ),
        (
            "[correlation]\nshape = \"cubic\"",
            ", line 4: correlation.shape = \"cubic\": must be \"translation\", \"rigid\", \"affine\", \"quadratic\"",
        ),
        (
            "[correlation]\nwindow = \"disc\"",
            ", line 4: correlation.window = \"disc\": must be \"square\", \"circle\", \"ring\"",
        ),
        (
            "[rotation]\nmethod = \"hough\"",
            ", line 4: rotation.method = \"hough\": must be \"rigid\", \"field\", \"center\", \"ring\"",
        ),
        (
            "[trigger]\nmode = \"on\"",
            ", line 4: trigger.mode = \"on\": must be \"off\", \"software\", \"hardware\", \"motion\", \"enter\", \"speed\", \"gap\", \"predicted-contact\"",
        ),
        (
            "[record]\ndirectory = \"a\"\ncompression = \"lz4\"",
            ", line 5: record.compression = \"lz4\": must be \"none\", \"zstd\"",
        ),
        ("[[body]]\noutline = \"painted\"", ", line 4: body[0].outline = \"painted\": must be \"edges\", \"marked\""),
        ("[[body]]\nkind = \"cube\"", ", line 4: body[0].kind = \"cube\": must be \"ball\", \"rod\", \"patch\""),
    ]);
    let source = refusal("[camera]\nsource = \"usb\"\n");
    assert_eq!(
        source,
        "rig.toml, line 2: camera.source = \"usb\": must be \"simulated\", \"recording\", \"genicam\", \"v4l2\""
    );
}

#[test]
fn a_trigger_without_its_inputs_is_refused() {
    let edge = "[scale]\nmm_per_px = 0.5\n[surface]\nedge = [[0, 10], [9, 10]]\n";
    let missing = |addition: &str, wanted: &str| {
        assert_eq!(refusal(&format!("{SIMULATED}{addition}\n")), format!("rig.toml{wanted}"));
    };
    missing(
        "[trigger]\nmode = \"speed\"\nspeed_m_s = 1",
        ": scale.mm_per_px is missing: must be given, or ball_diameter_mm instead, for mode = \"speed\"",
    );
    missing(
        &format!("{edge}[trigger]\nmode = \"speed\""),
        ": trigger.speed_m_s is missing: must be above 0 and at most 100000 m/s for mode = \"speed\"",
    );
    missing(
        &format!("{edge}[trigger]\nmode = \"gap\""),
        ": trigger.gap_mm is missing: must be 0 to 100000 mm for mode = \"gap\"",
    );
    missing(
        "[scale]\nmm_per_px = 0.5\n[trigger]\nmode = \"predicted-contact\"",
        ": surface.edge is missing: must be two points of the edge, [[x, y], [x, y]] in px, for mode = \"predicted-contact\"",
    );
    missing(
        &format!("{edge}[[body]]\nkind = \"rod\"\n[trigger]\nmode = \"predicted-contact\""),
        ": body[0].end_mm is missing: must be 0 to 10000 mm from its lowest edge to its end for mode = \"predicted-contact\"",
    );
    missing(
        "[scale]\nball_diameter_mm = 9\n[surface]\nedge = [[0, 10], [9, 10]]\n[[body]]\nkind = \"rod\"\nend_mm = 5\n\
         [trigger]\nmode = \"predicted-contact\"",
        ": scale.mm_per_px is missing: must be given, for the end of a rod, for mode = \"predicted-contact\"",
    );
    missing(
        "[scale]\nball_diameter_mm = 9\n[surface]\nedge = [[0, 10], [9, 10]]\n[[body]]\nname = \"a\"\nkind = \"rod\"\n\
         [[body]]\nname = \"b\"\nkind = \"rod\"\nend_mm = 5\n[trigger]\nmode = \"predicted-contact\"",
        ": scale.mm_per_px is missing: must be given, for the end of a rod, for mode = \"predicted-contact\"",
    );
    missing(
        &format!("{edge}[[body]]\nend_mm = 5"),
        ", line 8: body[0].end_mm = 5: does not go with kind = \"ball\"; it belongs to kind = \"rod\"",
    );
    missing(
        "[trigger]\nmode = \"enter\"\nbody = \"bal\"",
        ", line 5: trigger.body = \"bal\": must be the name of a body: \"ball\"",
    );
    missing(
        "[trigger]\nmode = \"motion\"\nlead_s = 0.1",
        ", line 5: trigger.lead_s = 0.1: does not go with mode = \"motion\"; it belongs to mode = \"predicted-contact\"",
    );
    missing(
        "[trigger]\nurl = \"ftp://a/b\"",
        ", line 4: trigger.url = \"ftp://a/b\": must be http[s]://host[:port][/path]",
    );
    missing(
        "[trigger]\ncommand = []",
        ", line 4: trigger.command = []: must be a program and its arguments, 1 to 64 texts",
    );
    missing(
        "[trigger]\nother_rig = \"rig\"",
        ", line 4: trigger.other_rig = \"rig\": must be the name of another rig than this one",
    );
    missing(
        "[surface]\nangle_deg = 10\nedge = [[0, 10], [9, 10]]",
        ", line 5: surface.edge = [[0, 10], [9, 10]]: must be within 2 deg of surface.angle_deg = 10, but is at -0.0 deg",
    );
    missing(
        "[surface]\nedge = [[0, 10], [0.5, 10]]",
        ", line 4: surface.edge = [[0, 10], [0.5, 10]]: must be two points [[x, y], [x, y]] in px, -65535 to 65535, at least 1 px apart",
    );
}

#[test]
fn an_incomplete_line_trigger_or_view_is_refused_with_its_line() {
    let missing = |addition: &str, wanted: &str| {
        assert_eq!(refusal(&format!("{SIMULATED}{addition}\n")), format!("rig.toml{wanted}"));
    };
    missing(
        "[trigger]\nmode = \"hardware\"",
        ": camera.trigger_source is missing: must be the line that the camera waits for (camera.pulse_period_s for a simulated one) for mode = \"hardware\"",
    );
    missing(
        "[trigger]\nmode = \"hardware\"\npre_s = 0.1",
        ", line 5: trigger.pre_s = 0.1: does not go with mode = \"hardware\"; it belongs to mode = \"software\", \"motion\", \"enter\", \"speed\", \"gap\", \"predicted-contact\"",
    );
    missing(
        "[view.side.camera]\nsource = \"simulated\"\nid = \"a\"",
        ", line 5: view.side.camera.id = \"a\": does not go with source = \"simulated\"; it belongs to source = \"recording\", \"genicam\", \"v4l2\"",
    );
    missing(
        "[view.side.camera]\nsource = \"simulated\"\n[view.side.scale]\nmm_per_px = -1",
        ", line 6: view.side.scale.mm_per_px = -1: must be 0.000001 to 1000 mm/px",
    );
    missing(
        "[view.Side.camera]\nsource = \"simulated\"",
        ", line 3: view.Side = Side: must be named with 1 to 16 of the characters a-z 0-9 _ -, and at most 32 together with rig.name",
    );
}

#[test]
fn tables_that_this_version_does_not_offer_are_refused_by_name() {
    refused_on_a_simulated_rig(&[
        (
            "[serve]\nfoxglove = \"0.0.0.0:8765\"",
            ", line 4: serve.foxglove = \"0.0.0.0:8765\": must be \"off\", or an address of this computer and a port, such as \
             \"127.0.0.1:8765\"",
        ),
        (
            "[serve]\nmqtt = \"1883\"",
            ", line 4: serve.mqtt = \"1883\": must be \"off\", or the host and the port of a broker, such as \
             \"broker.local:1883\"",
        ),
        (
            "[serve]\nmqtt = \"::1:1883\"",
            ", line 4: serve.mqtt = \"::1:1883\": must be \"off\", or the host and the port of a broker, such as \
             \"broker.local:1883\"",
        ),
        ("[serve]\nmqtt_user = \"rig\"", ", line 4: serve.mqtt_user = \"rig\": must be left out without serve.mqtt"),
        (
            "[serve]\nmqtt = \"broker.local:1883\"\nmqtt_password_file = \"password\"",
            ", line 5: serve.mqtt_password_file = \"password\": must be left out without serve.mqtt_user",
        ),
        (
            "[serve]\nudp = \"plc:5005\"",
            ", line 4: serve.udp = \"plc:5005\": must be \"off\", or an address and a port, such as \"192.168.1.20:5005\"",
        ),
        (
            "[serve]\nhttp = \"off\"\nudp = \"127.0.0.1:5005\"",
            ", line 5: serve.udp = \"127.0.0.1:5005\": must be \"off\" or left out, because serve.http is \"off\"",
        ),
        (
            "[bridge]\nzenoh = \"here\"",
            ", line 4: bridge.zenoh = \"here\": must be \"off\", an endpoint such as \"tcp/127.0.0.1:7447\", or a path that \
             ends in .json5",
        ),
    ]);
}

#[test]
fn an_address_of_the_page_is_a_number_with_a_port_and_needs_a_token_where_others_reach_it() {
    let allowed = "must be \"off\", or an address and a port, such as \"127.0.0.1:8080\"";
    let token = "must be the path of a file with a token, because other computers reach serve.http";
    for address in ["", "8080", "127.0.0.1", "localhost:8080", "http://127.0.0.1:8080", "127.0.0.1:99999"] {
        let message = format!(", line 4: serve.http = \"{address}\": {allowed}");
        refused_on_a_simulated_rig(&[(&format!("[serve]\nhttp = \"{address}\""), &message)]);
    }
    for address in ["0.0.0.0:8080", "192.168.0.7:80", "[::]:8080"] {
        let message = format!(": serve.token_file is missing: {token}");
        refused_on_a_simulated_rig(&[(&format!("[serve]\nhttp = \"{address}\""), &message)]);
    }
}

#[test]
fn keys_that_do_not_apply_are_refused_and_not_ignored() {
    refused_on_a_simulated_rig(&[
        (
            "id = \"a\"",
            ", line 3: camera.id = \"a\": does not go with source = \"simulated\"; it belongs to source = \"recording\", \"genicam\", \"v4l2\"",
        ),
        (
            "features = { Gain = 1 }",
            ", line 3: camera.features = { Gain = 1 }: does not go with source = \"simulated\"; it belongs to source = \"genicam\", \"v4l2\"",
        ),
        (
            "[rotation]\nring_inner_px = 6",
            ", line 4: rotation.ring_inner_px = 6: does not go with method = \"rigid\"; it belongs to method = \"ring\"",
        ),
        (
            "[rotation]\nmethod = \"ring\"\nring_inner_px = 20\nring_outer_px = 23",
            ", line 6: rotation.ring_outer_px = 23: must be at least 4 px more than ring_inner_px = 20",
        ),
        (
            "[[body]]\nkind = \"rod\"\n[rotation]\nmethod = \"rigid\"",
            ", line 6: rotation.method = \"rigid\": does not go with kind = \"rod\"; it belongs to kind = \"ball\"",
        ),
        (
            "[[body]]\nedges = 3",
            ", line 4: body[0].edges = 3: does not go with kind = \"ball\"; it belongs to kind = \"rod\"",
        ),
        (
            "[[body]]\nkind = \"rod\"\nmin_radius_px = 9",
            ", line 5: body[0].min_radius_px = 9: does not go with kind = \"rod\"; it belongs to kind = \"ball\"",
        ),
        (
            "[[body]]\nkind = \"rod\"\noutline = \"marked\"",
            ", line 5: body[0].outline = \"marked\": does not go with kind = \"rod\"; it belongs to kind = \"ball\"",
        ),
        ("[[body]]\nkind = \"rod\"\nedges = 5", ", line 5: body[0].edges = 5: must be 2 to 4"),
        (
            "[[body]]\ncenter_px = [1, 2]",
            ", line 4: body[0].center_px = [1, 2]: does not go with kind = \"ball\"; it belongs to kind = \"patch\"",
        ),
    ]);
    let paced = refusal(&format!("{GENICAM}paced = false\n"));
    assert_eq!(
        paced,
        "rig.toml, line 7: camera.paced = false: does not go with source = \"genicam\"; it belongs to source = \"simulated\", \"recording\""
    );
    for (given, why) in [
        ("paced = false", "paced = false; it belongs to paced = true"),
        ("pulse_period_s = 1", "pulse_period_s; it belongs to a camera that runs freely"),
    ] {
        let endless = refusal(&format!("{SIMULATED}endless = true\n{given}\n"));
        assert!(endless.contains("camera.endless = true: does not go with ") && endless.contains(why), "{endless}");
    }
    let width = refusal("[camera]\nsource = \"recording\"\nid = \"a.mcap\"\nwidth_px = 512\n");
    assert_eq!(
        width,
        "rig.toml, line 4: camera.width_px = 512: does not go with source = \"recording\"; it belongs to source = \"simulated\", \"genicam\", \"v4l2\""
    );
}

#[test]
fn keys_of_network_cameras_are_refused_for_v4l2() {
    let v4l2 = "[camera]\nsource = \"v4l2\"\nid = \"video0\"\nwidth_px = 640\nheight_px = 480\nframe_rate_hz = 60\n";
    for key in ["offset_x_px = 1", "offset_y_px = 1", "trigger_source = \"Line1\"", "packet_size_bytes = 1500"] {
        let name = key.split(' ').next().unwrap();
        assert_eq!(
            refusal(&format!("{v4l2}{key}\n")),
            format!(
                "rig.toml, line 7: camera.{key}: does not go with source = \"v4l2\"; it belongs to source = \"genicam\""
            ),
            "{name}"
        );
    }
    let nameless = v4l2.replace("id = \"video0\"\n", "");
    assert_eq!(
        refusal(&nameless),
        "rig.toml: camera.id is missing: must be the device file, place, serial number or name of a camera for source = \"v4l2\""
    );
}

#[test]
fn missing_keys_are_named() {
    assert_eq!(
        refusal("[camera]\nwidth_px = 640\n"),
        "rig.toml: camera.source is missing: must be \"simulated\", \"recording\", \"genicam\", \"v4l2\" with camera.width_px"
    );
    let recording = refusal("[camera]\nsource = \"recording\"\n");
    assert_eq!(
        recording,
        "rig.toml: camera.id is missing: must be the path of an MCAP file for source = \"recording\""
    );
    for (key, requirement) in [
        ("id", "the address, serial number or name of a camera"),
        ("width_px", "16 to 65535 px"),
        ("height_px", "16 to 65535 px"),
        ("frame_rate_hz", "above 0 and at most 1000000 Hz"),
    ] {
        let without: String =
            GENICAM.lines().filter(|line| !line.starts_with(key)).map(|line| format!("{line}\n")).collect();
        assert_eq!(
            refusal(&without),
            format!("rig.toml: camera.{key} is missing: must be {requirement} for source = \"genicam\"")
        );
    }
    refused_on_a_simulated_rig(&[
        ("[record]", ": record.directory is missing: must be the path of a folder"),
        (
            "[[body]]\nname = \"a\"\n[[body]]",
            ": body[1].name is missing: must be 1 to 32 of the characters a-z A-Z 0-9 _ -",
        ),
    ]);
}

#[test]
fn contradictory_values_are_refused() {
    refused_on_a_simulated_rig(&[
        ("[correlation]\nsubset_size_px = 30", ", line 4: correlation.subset_size_px = 30: must be odd, 9 to 255 px"),
        ("[velocity]\nwindow_frames = 20", ", line 4: velocity.window_frames = 20: must be odd, 3 to 1001 frames"),
        (
            "[velocity]\nwindow_frames = 3\norder = 4",
            ", line 4: velocity.window_frames = 3: must be more than order = 4",
        ),
        (
            "[[body]]\nmin_radius_px = 20\nmax_radius_px = 20",
            ", line 4: body[0].min_radius_px = 20: must be less than max_radius_px = 20 px",
        ),
        (
            "[scale]\nmm_per_px = 1\nball_diameter_mm = 3",
            ", line 5: scale.ball_diameter_mm = 3: must be left out, because mm_per_px is given",
        ),
        (
            "[[body]]\nname = \"a\"\n[[body]]\nname = \"a\"",
            ", line 6: body[1].name = \"a\": must be different from the names of the bodies before it",
        ),
        (
            "frame_rate_hz = 10000\nexposure_us = 101",
            ", line 4: camera.exposure_us = 101: must be at most 100 us, the duration of a frame at 10000 Hz",
        ),
        (
            "height_px = 100\nframe_rate_hz = 1000\nrow_time_us = -11",
            ", line 5: camera.row_time_us = -11: must be -10.000 to 10.000 us, so that 100 rows take at most the duration of a frame at 1000 Hz",
        ),
        (
            "width_px = 32\nheight_px = 20",
            ": correlation.subset_size_px is missing: must be at most 20 px, the smaller side of the image; the default is 31",
        ),
        ("[rig]\nname = \"Drop 1\"", ", line 4: rig.name = \"Drop 1\": must be 1 to 32 of the characters a-z 0-9 _ -"),
        ("[rig]\nname = \"\"", ", line 4: rig.name = \"\": must be 1 to 32 of the characters a-z 0-9 _ -"),
        (
            "[record]\ndirectory = \" \"",
            ", line 4: record.directory = \" \": must be a text of one line that is not empty",
        ),
    ]);
    let quoted = refusal(&format!("{GENICAM}features = {{ \"A[B=C]\" = nan }}\n"));
    assert!(quoted.starts_with("rig.toml, line 7: camera.features.\"A[B=C]\" = nan: must be "), "{quoted}");
    let feature = refusal(&format!("{GENICAM}features = {{ A = [1] }}\n"));
    assert_eq!(
        feature,
        "rig.toml, line 7: camera.features.A = [1]: must be true or false, a finite number, or a text in quotes"
    );
}
