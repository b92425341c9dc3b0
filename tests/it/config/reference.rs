//! The reference of the rig file against the file's checks.

use super::{GENICAM, SIMULATED, refusal};
use crate::support::succeed;
use ricochet::config::{Config, Key, Section, find, reference, schema, to_markdown};

/// Returns a rig in which a key of this table is used, without the key, and the header before the key.
fn rig_for(section: &Section, key: &Key) -> String {
    let camera = |source: &str| match source {
        "recording" => "[camera]\nsource = \"recording\"\nid = \"x.mcap\"\n".to_owned(),
        "genicam" => GENICAM.to_owned(),
        _ => SIMULATED.to_owned(),
    };
    let of_recording = ["playback_rate", "from_s", "to_s", "parts", "view", "shift_ns", "stepped"];
    let of_device = ["id", "offset_x_px", "offset_y_px", "trigger_source", "packet_size_bytes", "features"];
    let source = match key.name {
        name if of_recording.contains(&name) => "recording",
        name if of_device.contains(&name) => "genicam",
        _ => "simulated",
    };
    let owner = match (section.path, key.name) {
        ("camera", "pulse_frames") => "pulse_period_s = 1\n",
        ("calibration", "offset_px" | "distortion_model" | "camera_matrix" | "homography_mm") => {
            "image_px = [64, 64]\n"
        }
        ("calibration", "distortion") => "image_px = [64, 64]\ncamera_matrix = [99, 0, 9, 0, 99, 9, 0, 0, 1]\n",
        ("body", "edges" | "end_mm") => "kind = \"rod\"\n",
        ("body", "polygon_px") => "kind = \"patch\"\n",
        ("body", "holes_px" | "center_px") => "kind = \"patch\"\npolygon_px = [[9, 9], [99, 9], [99, 99], [9, 99]]\n",
        ("rotation", "ring_inner_px" | "ring_outer_px") => "method = \"ring\"\n",
        ("trigger", "body") => "mode = \"enter\"\n",
        ("trigger", "speed_m_s") => "mode = \"speed\"\n",
        ("trigger", "gap_mm") => "mode = \"gap\"\n",
        ("trigger", "lead_s") => "mode = \"predicted-contact\"\n",
        ("trigger", "silence_s") => "mode = \"hardware\"\n",
        ("record", name) if name != "directory" => "directory = \"shots\"\n",
        _ => "",
    };
    let camera = camera(source);
    if section.path == "camera" { format!("{camera}{owner}") } else { format!("{camera}{}\n{owner}", section.header()) }
}

/// Returns the file with this value of the key, in place of one that the file already has.
fn with(section: &Section, key: &Key, value: &str) -> String {
    let rig = rig_for(section, key);
    let is_other = |line: &&str| !line.starts_with(&format!("{} = ", key.name));
    let rest: Vec<&str> = rig.lines().filter(is_other).collect();
    format!("{}\n{} = {value}\n", rest.join("\n"), key.name)
}

/// Returns a value of the right type that no key allows.
fn wrong(key: &Key) -> Option<&'static str> {
    Some(match key.value {
        "number" => "-1e300",
        "whole number" if key.name == "shift_ns" => return None,
        "whole number" => "-9000000000000000000",
        "text" | "whole number or list" if key.name == "interval_frames" => "0",
        "text" => "\"\"",
        "list of texts" if key.name == "command" => "[]",
        "list of whole numbers" => "[-1]",
        "list of numbers" if key.name == "distortion" => "[1, 2, 3, 4, 5, 6, 7, 8, 9]",
        "list of numbers" => "[1e99]",
        "list of pairs" => "[[-1]]",
        "list of points" => "[[-1e9]]",
        "list of lists of points" => "[[[-1]]]",
        "yes or no" | "list of texts" | "table" => return None,
        other => panic!("{} has a value of a new type, {other}", key.name),
    })
}

fn keys() -> impl Iterator<Item = (&'static Section, &'static Key)> {
    reference().iter().flat_map(|section| section.keys.iter().map(move |key| (section, key)))
}

#[test]
fn each_key_allows_the_values_that_the_reference_states() {
    for (section, key) in keys() {
        let path = format!("{}.{}", section.path, key.name);
        let Some(wrong) = wrong(key) else { continue };
        let message = refusal(&with(section, key, wrong));
        let stated = match path.as_str() {
            // Only files on disk are replaced by their numbers.
            "calibration.file" => continue,
            "trigger.body" => "a text of one line that is not empty",
            "serve.token_file" | "record.directory" => "a text of one line that is not empty",
            "calibration.distortion" => "at most 8 finite numbers; thin prisms and tilted sensors are not supported",
            _ => key.allowed,
        };
        assert!(message.ends_with(&format!(": must be {stated}")), "{path} must be {stated:?}\n{message}");
        assert!(message.contains(key.name), "{path}: {message}");
    }
}

#[test]
fn the_ends_of_each_range_are_allowed_and_the_next_numbers_are_not() {
    let mut tried = 0;
    for (section, key) in keys() {
        let Some(range) = key.range() else { continue };
        let show = |x: f64| if key.value == "number" { format!("{x:e}") } else { format!("{x:.0}") };
        let refuses = |x: f64| {
            let text = with(section, key, &show(x));
            let error = Config::parse(&text, "rig.toml").err().map(|error| error.to_string());
            error.is_some_and(|error| error.ends_with(key.allowed))
        };
        let step = if key.value == "number" { 1e-6 * (range.max - range.min) } else { 1.0 };
        let (lowest, below) =
            if range.min_is_allowed { (range.min, range.min - step) } else { (range.min + step, range.min) };
        let found = [below, lowest, range.max, range.max + step].map(refuses);
        assert_eq!(found, [true, false, false, true], "{}.{} {}", section.path, key.name, key.allowed);
        tried += 1;
    }
    assert!(tried > 40, "{tried} ranges");
}

#[test]
fn each_word_is_known() {
    let mut tried = 0;
    for (section, key) in keys() {
        for word in key.words() {
            let text = with(section, key, &format!("{word:?}"));
            let error = Config::parse(&text, "rig.toml").err().map(|error| error.to_string()).unwrap_or_default();
            assert!(!error.ends_with(&format!("must be {}", key.allowed)), "{text}{error}");
            tried += 1;
        }
    }
    assert!(tried > 30, "{tried} words");
}

#[test]
fn the_page_is_that_of_the_program() {
    let page = include_str!("../../../docs/configuration.md");
    assert_eq!(
        page.trim_end(),
        to_markdown().trim_end(),
        "run: ricochet config explain --markdown > docs/configuration.md"
    );
}

#[test]
fn entries_are_found_by_every_name() {
    for name in ["body", "[[body]]", "body.diameter_mm", "view.left.body.diameter_mm", "diameter_mm"] {
        assert!(find(name).is_ok(), "{name}");
    }
    assert_eq!(find("body.diametre_mm").unwrap_err(), "body.diameter_mm");
    assert!(find("roi_px").is_err(), "two tables have it");
    let shown = succeed(["config", "explain", "body.diameter_mm"]);
    assert!(shown.contains("Must be above 0 and at most 10000 mm."), "{shown}");
}

#[test]
fn the_schema_has_each_key_with_its_range() {
    let schema = schema();
    let diameter = &schema["properties"]["body"]["items"]["properties"]["diameter_mm"];
    assert_eq!((&diameter["exclusiveMinimum"], &diameter["maximum"]), (&0.0.into(), &10_000.0.into()));
    let kinds =
        &schema["properties"]["view"]["additionalProperties"]["properties"]["body"]["items"]["properties"]["kind"];
    assert_eq!(kinds["enum"], serde_json::json!(["ball", "rod", "patch"]));
}
