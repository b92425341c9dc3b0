//! The page in a real browser, next to a rig that plays a recorded drop.

use super::chromium::Chromium;
use super::replay::check_replay;
use super::{SERVED, Server, drifting, run_alone};
use crate::support::{Rig, wait_until};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

const WALL_PX: [u32; 2] = [1920, 1080];
const PHONE_PX: [u32; 2] = [390, 844];

const BODY: &str = "ball-1";
/// A reason that would run a script if it were taken for markup.
const REASON: &str = "<img src=x onerror=document.title=`run`>";

/// A rig file that plays the recorded drop 1000 times slower than it was: 10 s, with contact from 1.4 s to 5.9 s.
fn drop_of_a_ball(rig: &Rig) -> PathBuf {
    let film = Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings/lacrosse.mcap");
    let camera = format!("source = \"recording\"\nid = \"{}\"\nplayback_rate = 0.001", film.display());
    let rest = format!(
        "{SERVED}pre_s = 0.002\npost_s = 0.005\n[scale]\nmm_per_px = 0.5142\n[velocity]\ngravity_angle_deg = -71\n\
         [[body]]\nname = \"{BODY}\"\ndiameter_mm = 63.25\nmass_kg = 0.14566\n"
    );
    rig.config(&camera, &rest)
}

fn wait_for_word(browser: &mut Chromium, word: &str) {
    wait_until(word, || browser.text("#word").starts_with(word).then_some(()));
}

/// Saves a picture of the page for a person to look at.
fn picture(browser: &mut Chromium, name: &str) {
    std::fs::write(Path::new(env!("CARGO_TARGET_TMPDIR")).join(name), browser.screenshot()).unwrap();
}

/// Checks that the page fits into a window, and how large what matters is.
fn check_sizes(browser: &mut Chromium, size_px: [u32; 2]) {
    let number = |browser: &mut Chromium, expression: &str| browser.evaluate(expression).as_f64().unwrap();
    let width = number(browser, "document.documentElement.scrollWidth");
    assert!(width <= f64::from(size_px[0]), "{width} px wide in a window of {size_px:?}");
    let visible =
        "[...document.querySelectorAll('[data-command]')].filter(e => !e.hidden).map(e => e.getBoundingClientRect())";
    let least = number(browser, &format!("Math.min(...{visible}.flatMap(r => [r.width, r.height]))"));
    assert!(least >= 20.0 * 96.0 / 25.4, "a button of {least} px is smaller than 20 mm");
    if size_px == WALL_PX {
        let letters = number(browser, "parseFloat(getComputedStyle(document.getElementById('word')).fontSize)");
        let height = number(browser, "document.documentElement.scrollHeight");
        assert!(letters >= 95.0 && height <= 1080.0, "letters of {letters} px, {height} px high");
    }
}

/// Whether every number of the page equals that of the topic's last revision.
fn agrees(browser: &mut Chromium, impact: &Value) -> bool {
    let shown = browser.evaluate(
        "Object.fromEntries([...document.querySelectorAll('dd')].map(e => [e.dataset.column, [e.dataset.value, e.dataset.sigma]]))",
    );
    let shown = shown.as_object().unwrap();
    let is_equal = |text: &Value, number: &Value| match number.as_f64() {
        Some(number) => text.as_str().unwrap().parse::<f64>().is_ok_and(|shown| shown.total_cmp(&number).is_eq()),
        None => text == "null",
    };
    shown.len() >= 8
        && shown.iter().all(|(column, numbers)| {
            is_equal(&numbers[0], &impact[column]) && is_equal(&numbers[1], &impact[format!("sigma_{column}")])
        })
}

#[test]
fn an_operator_takes_a_shot_reads_its_numbers_and_rejects_it() {
    let Some(mut browser) = Chromium::start() else { return };
    let rig = Rig::new();
    let config = drop_of_a_ball(&rig);
    let server = Server::start(&config);
    browser.resize(WALL_PX, "light");
    browser.open(&server.url("/"));
    wait_for_word(&mut browser, "FAULT");
    let run = run_alone(&rig, &config);
    wait_for_word(&mut browser, "FILLING");
    let mut socket = super::socket::Socket::open(&server.address, "/ws/impact", "").unwrap();
    browser.press("d");
    wait_for_word(&mut browser, "DISARMED");
    assert!(browser.evaluate("document.getElementById('trigger').hidden").as_bool().unwrap());
    browser.press("a");
    wait_for_word(&mut browser, "READY");
    check_sizes(&mut browser, WALL_PX);
    browser.press("t");
    wait_for_word(&mut browser, "TRIGGERED");
    picture(&mut browser, "page-triggered.png");
    second_page_does_not_hold_control(&server);
    let mut impact = socket.json();
    wait_for_word(&mut browser, "SAVED shot 1");
    wait_until("the shot is in the strip", || {
        (!browser.text("tr[data-name] .outlier, tr[data-name] td:nth-child(3)").is_empty()).then_some(())
    });
    wait_until("the shot has its picture", || {
        browser
            .evaluate("document.querySelector('tr[data-name] img.thumb')?.naturalWidth > 20")
            .as_bool()
            .filter(|is| *is)
    });
    picture(&mut browser, "page-saved.png");
    let status = server.json("/api/status");
    while impact["revision"] != status["last"]["revision"] {
        impact = socket.json();
    }
    wait_until("the page shows the numbers of the topic", || agrees(&mut browser, &impact).then_some(()));
    let restitution = impact["restitution"].as_f64().unwrap();
    assert!((0.5..1.0).contains(&restitution), "{impact}");
    assert!(browser.text("#last-place").contains(BODY), "{}", browser.text("#last-place"));
    run.end();
    let recording = rig.recordings().remove(0);
    let bytes = browser.evaluate(
        "fetch(document.querySelector('a[download]').href).then(r => r.arrayBuffer()).then(b => b.byteLength)",
    );
    assert_eq!(bytes.as_u64().unwrap(), recording.metadata().unwrap().len());
    let report = browser.evaluate("fetch(document.querySelector('tr[data-name] a').href).then(r => r.text())");
    assert!(report.as_str().unwrap().contains("<h2>Collision"), "the report has the collision");
    check_replay(&mut browser, &server, &recording);
    reject(&mut browser, &recording);
    assert!(!browser.evaluate("document.title").as_str().unwrap().contains("run"), "a reason was taken for markup");
    for scheme in ["light", "dark"] {
        for (size_px, name) in [(WALL_PX, "wall"), (PHONE_PX, "phone")] {
            browser.resize(size_px, scheme);
            std::thread::sleep(Duration::from_millis(300));
            picture(&mut browser, &format!("page-{name}-{scheme}.png"));
            let width = browser.evaluate("document.documentElement.scrollWidth").as_f64().unwrap();
            assert!(width <= f64::from(size_px[0]), "{width} px wide on the {name}");
            let wide = "[...document.querySelectorAll('#numbers > div')].filter(e => [...e.children].some(c => \
                        c.scrollWidth > e.clientWidth)).map(e => e.innerText).join('; ')";
            assert_eq!(browser.evaluate(wide), "", "numbers that overflow their cards on the {name}");
        }
    }
    notices_the_end(browser, server);
}

#[test]
fn the_live_picture_shows_displacements_and_sharpness() {
    let Some(mut browser) = Chromium::start() else { return };
    let rig = Rig::new();
    let (config, run) = drifting(&rig, 12_000, 200.0, "[rotation]\nmethod = \"field\"");
    let server = Server::start(&config);
    server.wait_for("READY");
    browser.resize(WALL_PX, "light");
    browser.open(&server.url("/"));
    wait_until("the live picture has displacements", || {
        let is_drawn = "Number(document.getElementById('picture').dataset.vectors) >= 5";
        browser.evaluate(is_drawn).as_bool().filter(|is| *is)
    });
    assert!(browser.text("#picture-note").contains("displacements x "), "{}", browser.text("#picture-note"));
    wait_until("the uncertainty of a speed now", || {
        let now = browser.text("#picture-now");
        (now.starts_with("Now ball: speed ± ") && now.contains(" m/s")).then_some(())
    });
    let sharpness = browser.evaluate("document.getElementById('focus').value").as_f64().unwrap();
    assert!(sharpness > 0.5 && sharpness <= 1.0, "{sharpness}");
    picture(&mut browser, "page-live.png");
    run.signal(15);
    run.end();
}

fn second_page_does_not_hold_control(server: &Server) {
    let mut other = Chromium::start().unwrap();
    other.resize(PHONE_PX, "dark");
    other.open(&server.url("/"));
    wait_until("the other page is connected", || (!other.text("#holder").is_empty()).then_some(()));
    assert_eq!(other.text("#holder"), "Another page holds control.");
    assert!(other.evaluate("[...document.querySelectorAll('[data-command]')].every(e => e.hidden)").as_bool().unwrap());
    picture(&mut other, "page-second.png");
    other.click("#take");
    wait_until("the other page has control", || other.text("#holder").is_empty().then_some(()));
    wait_until("the other page has a command", || {
        other.evaluate("!document.getElementById('disarm').hidden").as_bool()
    });
    check_sizes(&mut other, PHONE_PX);
}

fn reject(browser: &mut Chromium, recording: &Path) {
    browser.evaluate(
        "[...document.querySelectorAll('tr[data-name] button')].find(e => e.textContent === 'Reject').click()",
    );
    browser.evaluate(&format!("document.getElementById('reason').value = '{REASON}'"));
    browser.click("#reject button[value=reject]");
    let text = wait_until("the shot is rejected", || Some(browser.text("tr.rejected")).filter(|text| !text.is_empty()));
    assert!(text.contains(&format!("rejected: {REASON}")), "{text}");
    let beside = recording.with_file_name(format!("{}.rejected", recording.file_name().unwrap().to_str().unwrap()));
    assert_eq!(std::fs::read_to_string(beside).unwrap(), format!("{REASON}\n"));
    assert!(recording.exists());
}

fn notices_the_end(mut browser: Chromium, server: Server) {
    server.process.signal(9);
    let killed = Instant::now();
    wait_for_word(&mut browser, "NOT CONNECTED");
    println!("not connected after {:?}", killed.elapsed());
    assert!(killed.elapsed() < Duration::from_secs(1), "{:?}", killed.elapsed());
    picture(&mut browser, "page-offline.png");
}
