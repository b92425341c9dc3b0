//! The frames of a shot along its velocities.

use super::Server;
use super::chromium::Chromium;
use crate::support::wait_until;
use ricochet::image::{Frame, Image};
use ricochet::recording::Recording;
use serde_json::Value;
use std::path::Path;

/// Replays the newest shot on the page: the cursor on the curve chooses the frame, by pointer and by key.
pub fn check_replay(browser: &mut Chromium, server: &Server, recording: &Path) {
    let shot = Recording::open(recording).unwrap();
    let (first, last) = (shot.first_frame().unwrap().sequence, shot.last_frame().unwrap().sequence);
    browser.evaluate(
        "[...document.querySelectorAll('tr[data-name] button')].find(e => e.textContent === 'Replay').click()",
    );
    wait_for_frame(browser, first);
    let middle = browser.evaluate(
        "(() => { const box = document.getElementById('replay-chart').getBoundingClientRect();\
         return [box.left + box.width * (64 + 644 / 2) / 720, box.top + box.height / 2]; })()",
    );
    browser.mouse("mouseMoved", [0, 1].map(|axis| middle[axis].as_f64().unwrap()));
    let frame = wait_until("the frame under the cursor", || {
        let shown = browser.evaluate("Number(document.getElementById('replay-picture').dataset.frame)").as_u64()?;
        (shown.abs_diff(first.midpoint(last)) <= 2).then_some(shown)
    });
    let text = browser.text("#replay-text");
    assert!(text.starts_with(&format!("frame {frame}, ")) && text.contains("normal"), "{text}");
    let velocity = server.json(&format!("/shots/{}/velocity", name(recording)));
    let row = velocity["bodies"][0]["rows"].as_array().unwrap().iter().find(|row| row[0] == frame).unwrap();
    assert!(text.contains(&format!("normal {:.3} m/s", row[1].as_f64().unwrap())), "{text} {row}");
    std::fs::write(Path::new(env!("CARGO_TARGET_TMPDIR")).join("page-replay.png"), browser.screenshot()).unwrap();
    browser.evaluate("document.getElementById('replay-frame').focus()");
    browser.press_named("ArrowRight");
    wait_for_frame(browser, frame + 1);
    assert!(browser.evaluate("document.querySelectorAll('#replay-chart .normal').length").as_u64() == Some(1));
    check_frames(server, &shot, &name(recording));
    browser.evaluate("document.getElementById('replay').close()");
}

fn name(recording: &Path) -> String {
    recording.file_name().unwrap().to_str().unwrap().to_owned()
}

fn wait_for_frame(browser: &mut Chromium, frame: u64) {
    let is_shown = format!(
        "(picture => picture.dataset.frame === '{frame}' && picture.naturalWidth > 20)(document.getElementById('replay-picture'))"
    );
    wait_until("the frame is shown", || browser.evaluate(&is_shown).as_bool().filter(|is| *is));
}

/// Compares frames of the server with those of the file, and asks for some that are none.
fn check_frames(server: &Server, shot: &Recording, name: &str) {
    let mut image = Image::default();
    let frames: Vec<_> = shot.frames().unwrap().map(Result::unwrap).collect();
    for (meta, bytes) in frames.iter().step_by(frames.len() / 4) {
        let (status, jpeg) = server.get_bytes(&format!("/shots/{name}/frames/{}", meta.sequence));
        assert_eq!(status, 200);
        Frame { meta: *meta, bytes }.unpack(&mut image).unwrap();
        let (view, shown) = (image.view(), image::load_from_memory(&jpeg).unwrap().to_luma8());
        assert_eq!((shown.width() as usize, shown.height() as usize), (view.width(), view.height()));
        let full = f64::from((1_u32 << meta.format.bits()) - 1);
        let difference = |(x, y, pixel): (u32, u32, &image::Luma<u8>)| {
            (f64::from(view.row(y as usize)[x as usize]) * 235.0 / full - f64::from(pixel.0[0])).abs()
        };
        let sum: f64 = shown.enumerate_pixels().map(difference).sum();
        let mean = sum / f64::from(shown.width() * shown.height());
        assert!(mean < 4.0, "frame {} differs by {mean} grey levels", meta.sequence);
    }
    let last = frames[frames.len() - 1].0.sequence;
    for (path, expected) in [
        (format!("/shots/{name}/frames/{}", last + 1), 404),
        (format!("/shots/{name}/frames/18446744073709551615"), 404),
        (format!("/shots/{name}/frames/-1"), 400),
        (format!("/shots/{name}/frames/one"), 400),
        ("/shots/none.mcap/frames/0".to_owned(), 404),
        ("/shots/none.mcap/velocity".to_owned(), 404),
    ] {
        assert_eq!(server.get(&path).0, expected, "{path}");
    }
    let document: Value = server.json("/openapi.json");
    let parameters = &document["paths"]["/shots/{name}/frames/{frame}"]["get"]["parameters"];
    assert_eq!(parameters.as_array().unwrap().len(), 2);
}
