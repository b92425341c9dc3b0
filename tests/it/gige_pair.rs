//! Two network cameras in one rig: real packets to two addresses.

use crate::fake_gige::{FakeGige, aravis_or_leave_out};
use crate::genicam::draw;
use crate::support::{Background, Rig, ricochet, run, wait_until};
use ricochet::image::FrameMeta;
use ricochet::recording::Recording;
use serde_json::Value;
use std::path::Path;
use std::process::Command;

const FRAMES: u64 = 60;
const ADDRESSES: [&str; 2] = ["127.0.0.1", "127.0.0.2"];
/// The first index of the second camera's frames.
const OTHERS: u64 = 1000;

/// The frames of one camera with the indices in their pixels, each compared bit by bit.
fn indices(recording: &Recording) -> Vec<(FrameMeta, u64)> {
    let mut wanted = Vec::new();
    let indexed = |frame: Result<(FrameMeta, Vec<u8>), _>| {
        let (meta, bytes) = frame.unwrap();
        let index = u64::from_le_bytes(bytes[..8].try_into().unwrap());
        wanted.resize(bytes.len(), 0);
        draw(index, &mut wanted);
        assert!(bytes == wanted, "frame {} is not what was sent", meta.sequence);
        (meta, index)
    };
    recording.frames().unwrap().map(indexed).collect()
}

/// Runs in its own network, which the test below makes.
#[test]
#[ignore = "needs a second local address; the test below adds it"]
fn two_network_cameras_are_recorded_side_by_side() {
    let first = FakeGige::plug_in_at(ADDRESSES[0], FRAMES, draw).unwrap();
    let side = FakeGige::plug_in_at(ADDRESSES[1], FRAMES, |index, bytes| draw(OTHERS + index, bytes)).unwrap();
    let rig = Rig::new();
    let [source, view] = ADDRESSES.map(|address| {
        format!(
            "source = \"genicam\"\nid = \"{address}\"\nwidth_px = 256\nheight_px = 256\npixel_format = \"Mono8\"\n\
             frame_rate_hz = 25\nexposure_us = 100\npacket_size_bytes = 1440"
        )
    });
    let config = rig.config(&source, &format!("[view.side.camera]\n{view}\n[workers]\ncount = 0"));
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    wait_until("both sent all frames", || (first.sent() == FRAMES && side.sent() == FRAMES).then_some(()));
    service.signal(15);
    let (code, printed, stderr) = service.end();
    assert!(matches!(code, Some(0 | 6)), "{stderr}");
    let recording = Recording::open(Path::new(printed.trim())).unwrap();
    let both = [indices(&recording), indices(&recording.view("side").unwrap())];
    let lost = both.iter().map(|film| FRAMES - film.len() as u64).sum::<u64>();
    assert_eq!(code, Some(if lost == 0 { 0 } else { 6 }), "{stderr}");
    println!("{lost} of {} frames lost", 2 * FRAMES);
    for (film, from) in both.iter().zip([0, OTHERS]) {
        assert!(film.len() as u64 > FRAMES / 2 && film.iter().all(|(meta, index)| *index == meta.sequence + from));
    }
    let info: Value = serde_json::from_slice(&run(["info", printed.trim(), "--json"]).stdout).unwrap();
    let matching = &info["cameras"][0]["matching"];
    println!("{matching}");
    // Both cameras run freely at 25 Hz, so no frame is farther than half of 40 ms from the nearest of the other camera.
    assert!(matching["matched"].as_u64().unwrap() > FRAMES / 2 && matching["worst_ns"].as_u64().unwrap() <= 21_000_000);
    assert_eq!(info["cameras"][0]["name"], "side");
}

#[test]
fn two_network_cameras_on_two_addresses_make_one_recording() {
    if aravis_or_leave_out().is_none() {
        return;
    }
    let network = "ip link set lo up && ip addr add 127.0.0.2/8 dev lo";
    let made = Command::new("unshare").args(["-rn", "sh", "-c", network]).output();
    if !made.is_ok_and(|output| output.status.success()) {
        eprintln!("left out: this user may not make a network of its own");
        return;
    }
    let name = "gige_pair::two_network_cameras_are_recorded_side_by_side";
    let inside = format!("{network} && exec \"$0\" --exact {name} --ignored --nocapture");
    let program = std::env::current_exe().unwrap();
    let output = Command::new("unshare").args(["-rn", "sh", "-c", &inside]).arg(program).output().unwrap();
    let printed = String::from_utf8_lossy(&output.stdout);
    println!("{printed}");
    assert!(
        output.status.success() && printed.contains("1 passed"),
        "{printed}{}",
        String::from_utf8_lossy(&output.stderr)
    );
}
