//! Files that are refused as a whole, and values that contradict each other.

use super::{GENICAM, SIMULATED, parse, refusal, refused_on_a_simulated_rig};
use ricochet::config::{Config, Problem};

#[test]
fn regions_outside_the_image_are_refused() {
    let image = "width_px = 100\nheight_px = 50\n";
    let inside = "must be [x, y, width, height] inside the image of 100 x 50 px";
    for region in [
        "[0, 0, 101, 50]",
        "[1, 0, 100, 50]",
        "[0, 50, 1, 1]",
        "[-1, 0, 5, 5]",
        "[0, 0, 0, 5]",
        "[0, 0, 5]",
        "[9223372036854775807, 0, 1, 1]",
    ] {
        refused_on_a_simulated_rig(&[
            (&format!("{image}[[body]]\nroi_px = {region}"), &format!(", line 6: body[0].roi_px = {region}: {inside}")),
            (
                &format!("{image}[trigger]\nroi_px = {region}"),
                &format!(", line 6: trigger.roi_px = {region}: {inside}"),
            ),
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
    let rig = |bytes: u64| {
        format!(
            "{GENICAM}[trigger]\nmode = \"software\"\npre_s = 0.1\n[record]\ndirectory = \"a\"\nring_bytes_max = {bytes}\n"
        )
    };
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
    for (text, line) in [
        ("[camera\n", 1),
        ("a = 1\nb =\n", 2),
        ("a = 1\n\na = 2\n", 3),
        ("\u{1}", 1),
        ("[camera]\nsource = \"simulated", 2),
    ] {
        let message = refusal(text);
        assert!(message.starts_with(&format!("rig.toml, line {line}: not TOML: ")), "{message}");
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
        (binary.as_path(), "not a text file"),
    ] {
        let error = Config::load(path).unwrap_err();
        assert_eq!(error.to_string(), format!("cannot read {}: {reason}", path.display()));
        assert!(matches!(*error.problem, Problem::Unreadable(_)));
    }
}

#[test]
fn long_values_are_cut_in_messages() {
    let message = refusal(&format!("{SIMULATED}[rig]\nname = \"{}\"\n", "long ".repeat(100)));
    assert!(message.len() < 200 && message.contains("...: must be"), "{message}");
}

#[test]
fn damaged_files_are_accepted_or_refused_in_one_line_and_never_panic() {
    let text = super::accepted::FULL;
    let damage = |at: usize, put: &str| format!("{}{put}{}", &text[..at], text.get(at + 1..).unwrap_or_default());
    let mut refused = 0;
    for at in 0..text.len() {
        let variants =
            [text[..at].to_string(), damage(at, ""), damage(at, "-"), damage(at, "\u{e9}\""), damage(at, "\n[")];
        for variant in variants {
            if let Err(error) = Config::parse(&variant, "rig.toml") {
                let message = error.to_string();
                assert!(!message.contains('\n') && message.starts_with("rig.toml"), "{message:?} for:\n{variant}");
                refused += 1;
            }
        }
    }
    assert!(refused > text.len(), "only {refused} refusals");
}
