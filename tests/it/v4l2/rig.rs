//! The program itself with cameras of the kernel. Run in the virtual machine only.

use super::drivers::{Fault, LOOPBACK, VIVID, inject};
use crate::support::{Background, Rig, frames, ricochet, succeed, wait_until};
use serde_json::Value;

/// Of the pictures that the rig records.
const FRAME_BYTES: u64 = 320 * 180;

#[test]
#[ignore = "runs in the virtual machine"]
fn a_rig_goes_on_under_a_new_epoch_when_its_camera_was_unplugged_and_counts_the_loss() {
    let rig = Rig::new();
    // Two black pictures a second: the machine has one processor, which is imitated, for five processes.
    let source = format!(
        "source = \"v4l2\"\nid = \"{VIVID}\"\nwidth_px = 320\nheight_px = 180\nframe_rate_hz = 2\n\
         features = {{ test_pattern = \"100% Black\", osd_text_mode = \"None\" }}"
    );
    let rest = "compression = \"none\"\n[scale]\nmm_per_px = 0.5\n[workers]\ncount = 1\nblock_frames = 4";
    let config = rig.config(&source, rest);
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    // Asking for the status would cost the machine more than the rig does.
    let recorded = |least: u64| {
        wait_until("frames are recorded", || {
            let files = std::fs::read_dir(rig.path("shots")).into_iter().flatten().flatten();
            let bytes: u64 = files.filter_map(|file| Some(file.metadata().ok()?.len())).sum();
            Some(bytes / FRAME_BYTES).filter(|frames| *frames >= least)
        })
    };
    let before = recorded(5);
    inject(Fault::Disconnect, 1);
    recorded(before + 6);
    service.signal(15);
    let (code, _, told) = service.end();
    assert_eq!(code, Some(6), "a loss is told by the exit code: {told}");
    let recorded = frames(&rig.recordings()[0]);
    let metas: Vec<_> = recorded.iter().map(|(meta, _)| meta).collect();
    assert!(metas.is_sorted_by(|a, b| a.sequence < b.sequence && a.stamp_ns < b.stamp_ns && a.epoch <= b.epoch));
    let first = metas.iter().position(|meta| meta.epoch == 1).expect("frames of a new epoch");
    assert!(first >= 4 && metas.len() - first >= 4 && metas.last().unwrap().epoch == 1);
    assert!(metas[first].sequence > metas[first - 1].sequence + 1, "the frames between are missing");
}

#[test]
#[ignore = "runs in the virtual machine"]
fn the_program_lists_cameras_of_the_kernel_and_tells_what_one_can_be_set_to() {
    let listed: Value = serde_json::from_str(&succeed(["cameras", "--json"])).unwrap();
    let ids: Vec<_> = listed["cameras"].as_array().unwrap().iter().map(|camera| &camera["id"]).collect();
    assert!(ids.contains(&&Value::from(VIVID)), "{ids:?}");
    let text = succeed(["cameras"]);
    assert!(text.contains(&format!("{VIVID}\n  model    vivid, serial number none\n")), "{text}");
    assert!(text.contains("  format   GREY (8-bit Greyscale), Mono8\n    320x180 px: "), "{text}");
    for id in [VIVID, "vivid"] {
        let told = succeed(["cameras", "--features", id]);
        assert!(told.contains("  format   Y12 (12-bit Greyscale), Mono12\n    320x180 px: "), "{told}");
        assert!(told.contains("\nbrightness = "), "{told}");
        assert!(told.contains(" (integer: 0 to 255)\n"), "{told}");
        assert!(told.contains("\nmenu = Menu Item "), "{told}");
        assert!(told.contains(" (enumeration: Menu Item 1, Menu Item 3, Menu Item 4)\n"), "{told}");
    }
    let json: Value = serde_json::from_str(&succeed(["cameras", "--features", VIVID, "--json"])).unwrap();
    let features = json["features"].as_array().unwrap();
    assert!(features.iter().any(|line| line["name"] == "gain_automatic" && line["type"] == "boolean"));
    assert!(json["formats"].as_array().unwrap().iter().any(|format| format["code"] == "Y16"));
    assert_ne!(LOOPBACK, VIVID);
}

#[test]
#[ignore = "runs in the virtual machine"]
fn the_program_refuses_what_a_camera_cannot_with_the_range_and_the_exit_code_of_cameras() {
    let rig = Rig::new();
    let base = format!("source = \"v4l2\"\nid = \"{VIVID}\"\nwidth_px = 320\nheight_px = 180\nframe_rate_hz = ");
    for (rest, said) in [
        ("60\nfeatures = { brightness = 256 }", "set camera feature brightness to 256: allowed 0 to 255"),
        ("7", "set camera feature frame_rate_hz to 7: the camera keeps "),
    ] {
        let config = rig.config(&format!("{base}{rest}"), "");
        let output = crate::support::run(["acquire".as_ref(), config.as_os_str()]);
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(3), "{told}");
        assert!(told.contains(said), "{told}");
    }
}
