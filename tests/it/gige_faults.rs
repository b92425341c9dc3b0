//! Faults around a rig with a network camera.

use crate::fake_gige::{ADDRESS, FakeGige, Wiring};
use crate::genicam::{draw, settings};
use crate::support::{Background, Rig, frames, kill, process, ricochet, run, status, wait_until};
use ricochet::camera::genicam::GenicamCamera;
use serde_json::Value;

fn number(status: &Value, name: &str, key: &str) -> u64 {
    process(status, name, 0).map_or(0, |process| process[key].as_u64().unwrap())
}

fn rig_file(rig: &Rig) -> std::path::PathBuf {
    let source = format!(
        "source = \"genicam\"\nid = \"{ADDRESS}\"\nwidth_px = 512\nheight_px = 512\npixel_format = \"Mono8\"\n\
         frame_rate_hz = 50\nexposure_us = 100"
    );
    rig.config(&source, "[workers]\ncount = 0")
}

#[test]
fn a_camera_that_another_program_controls_is_refused_in_one_line() {
    let Some(_gige) = FakeGige::plug_in(Wiring::Software, u64::MAX, draw) else { return };
    let _holder = GenicamCamera::open(&settings(50.0)).unwrap();
    let rig = Rig::new();
    let config = rig_file(&rig);
    for command in ["run", "acquire", "check"] {
        let output = run([command.as_ref(), config.as_os_str()]);
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!((output.status.code(), stderr.lines().count()), (Some(3), 1), "{command}: {stderr}");
        assert!(stderr.contains(ADDRESS) && stderr.contains("control"), "{stderr}");
    }
}

#[test]
fn a_restarted_camera_process_takes_over_the_camera_and_continues_the_count() {
    let Some(gige) = FakeGige::plug_in(Wiring::Software, u64::MAX, draw) else { return };
    let rig = Rig::new();
    let config = rig_file(&rig);
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    let filmed = |what: &str, epoch: u64, frame: u64| {
        wait_until(what, || {
            let status = status(&rig.name)?;
            let is_there =
                number(&status, "acquire", "state") == epoch && number(&status, "record", "sequence") > frame;
            is_there.then_some(status)
        })
    };
    let before = filmed("frames arrive", 0, 30);
    kill(u32::try_from(number(&before, "acquire", "pid")).unwrap(), 9);
    let at = number(&before, "record", "sequence");
    let after = filmed("frames arrive again", 1, at + 40);
    assert_eq!(number(&after, "record", "pid"), number(&before, "record", "pid"), "nothing else was started again");
    assert_eq!(number(&after, "run", "restarts"), 1);
    service.signal(2);
    let (code, printed, stderr) = service.end();
    assert_eq!(code, Some(6), "{stderr}");
    assert_eq!(printed.lines().count(), 1, "{printed}");
    let film = frames(std::path::Path::new(printed.trim()));
    let jumps: Vec<_> = film.windows(2).filter(|pair| pair[1].0.epoch != pair[0].0.epoch).collect();
    assert_eq!(jumps.len(), 1);
    let [(last, _), (next, bytes)] = [&jumps[0][0], &jumps[0][1]];
    let away_s = (next.stamp_ns - last.stamp_ns) as f64 * 1e-9;
    let missed = next.sequence - last.sequence;
    println!("away for {away_s:.2} s, {missed} numbers further");
    // The camera releases a dead program after 3 s, and starting again takes no longer than that.
    assert!(away_s < 6.5, "{away_s} s");
    // The numbers count the frames that were due, and start a block.
    let due = away_s * 50.0;
    assert!(missed as f64 >= due - 2.0 && missed as f64 <= due + 66.0, "{missed} of {due}");
    assert_eq!((last.epoch, next.epoch, next.sequence % 64), (0, 1, 0));
    let index = u64::from_le_bytes(bytes[..8].try_into().unwrap());
    assert!(index < gige.sent() && film.iter().all(|(meta, _)| meta.width_px == 512));
}
