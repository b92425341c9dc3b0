//! The program itself with V4L2 cameras. Run in the virtual machine only.

use super::drivers::{Fault, LOOPBACK, VIVID, inject};
use crate::support::{Background, Rig, frames, ricochet, succeed, wait_until};
use serde_json::Value;

/// The size of the recorded frames.
const FRAME_BYTES: u64 = 320 * 180;

#[test]
#[ignore = "runs in the virtual machine"]
fn after_an_unplugged_camera_the_rig_continues_with_a_new_epoch_and_counts_the_loss() {
    let rig = Rig::new();
    // Two black frames per second, because the machine has one emulated processor for five processes.
    let source = format!(
        "source = \"v4l2\"\nid = \"{VIVID}\"\nwidth_px = 320\nheight_px = 180\nframe_rate_hz = 2\n\
         features = {{ test_pattern = \"100% Black\", osd_text_mode = \"None\" }}"
    );
    let rest = "compression = \"none\"\n[scale]\nmm_per_px = 0.5\n[workers]\ncount = 1\nblock_frames = 4";
    let config = rig.config(&source, rest);
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    // Asking for the status costs this machine more than the rig does.
    let recorded = |count: u64| {
        wait_until("frames are recorded", || {
            let files = std::fs::read_dir(rig.path("shots")).into_iter().flatten().flatten();
            let bytes: u64 = files.filter_map(|file| Some(file.metadata().ok()?.len())).sum();
            Some(bytes / FRAME_BYTES).filter(|frames| *frames >= count)
        })
    };
    let before = recorded(5);
    inject(Fault::Disconnect, 1);
    recorded(before + 6);
    service.signal(15);
    let (code, _, output) = service.end();
    assert_eq!(code, Some(6), "the exit code reports the loss: {output}");
    let recorded = frames(&rig.recordings()[0]);
    let metas: Vec<_> = recorded.iter().map(|(meta, _)| meta).collect();
    assert!(metas.is_sorted_by(|a, b| a.sequence < b.sequence && a.stamp_ns < b.stamp_ns && a.epoch <= b.epoch));
    let first = metas.iter().position(|meta| meta.epoch == 1).expect("frames of a new epoch");
    assert!(first >= 4 && metas.len() - first >= 4 && metas.last().unwrap().epoch == 1);
    assert!(metas[first].sequence > metas[first - 1].sequence + 1, "the frames between are missing");
}

#[test]
#[ignore = "runs in the virtual machine"]
fn v4l2_cameras_are_listed_with_their_controls() {
    let listed: Value = serde_json::from_str(&succeed(["cameras", "--json"])).unwrap();
    let ids: Vec<_> = listed["cameras"].as_array().unwrap().iter().map(|camera| &camera["id"]).collect();
    assert!(ids.contains(&&Value::from(VIVID)), "{ids:?}");
    let text = succeed(["cameras"]);
    assert!(text.contains(&format!("{VIVID}\n  model    vivid, serial number none\n")), "{text}");
    assert!(text.contains("  format   GREY (8-bit Greyscale), Mono8\n    320x180 px: "), "{text}");
    for id in [VIVID, "vivid"] {
        let output = succeed(["cameras", "--features", id]);
        assert!(output.contains("  format   Y12 (12-bit Greyscale), Mono12\n    320x180 px: "), "{output}");
        assert!(output.contains("\nbrightness = "), "{output}");
        assert!(output.contains(" (integer: 0 to 255)\n"), "{output}");
        assert!(output.contains("\nmenu = Menu Item "), "{output}");
        assert!(output.contains(" (enumeration: Menu Item 1, Menu Item 3, Menu Item 4)\n"), "{output}");
    }
    let json: Value = serde_json::from_str(&succeed(["cameras", "--features", VIVID, "--json"])).unwrap();
    let features = json["features"].as_array().unwrap();
    assert!(features.iter().any(|line| line["name"] == "gain_automatic" && line["type"] == "boolean"));
    assert!(json["formats"].as_array().unwrap().iter().any(|format| format["code"] == "Y16"));
    assert_ne!(LOOPBACK, VIVID);
}

#[test]
#[ignore = "runs in the virtual machine"]
fn settings_that_a_camera_lacks_are_refused_with_the_range_and_exit_code_3() {
    let rig = Rig::new();
    let base = format!("source = \"v4l2\"\nid = \"{VIVID}\"\nwidth_px = 320\nheight_px = 180\nframe_rate_hz = ");
    for (rest, wanted) in [
        ("60\nfeatures = { brightness = 256 }", "cannot set camera feature brightness to 256: allowed 0 to 255"),
        ("7", "cannot set camera feature frame_rate_hz to 7: the camera keeps "),
    ] {
        let config = rig.config(&format!("{base}{rest}"), "");
        let output = crate::support::run(["acquire".as_ref(), config.as_os_str()]);
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(3), "{stderr}");
        assert!(stderr.contains(wanted), "{stderr}");
    }
}
