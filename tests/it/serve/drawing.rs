//! Shapes drawn on the live picture, in a real browser and by a program, and the rig file that holds them afterwards.

use super::chromium::Chromium;
use super::{SERVED, Server};
use crate::support::{Rig, wait_until};
use serde_json::{Value, json};
use std::path::PathBuf;

/// The lines of the rig file that drawings change, with the comments that must stay.
const DRAWN: &str = "# What starts a shot.\n[trigger]\nmode = \"motion\" # no hand near it\nthreshold_dn = 200\n\
    # Above the hand.\nroi_px = [1, 2, 30, 40] # too small\n\n[surface] # the plate\n\n[scale]\nmm_per_px = 0.5\n\n\
    [[body]]\nname = \"target\"\nkind = \"patch\"\npolygon_px = [[40, 44], [80, 44], [80, 84], [40, 84]] # by hand\n";

/// Writes a rig file with a trigger on motion and a patch on a drifting disc of 160 x 144 px.
fn rig_file(rig: &Rig) -> PathBuf {
    let film = rig.file("drift.toml", &crate::pipeline::drift(30_000, 100.0));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", film.display());
    let served = SERVED.split("[trigger]").next().unwrap();
    rig.config(&camera, &format!("{served}[workers]\ncount = 1\n{DRAWN}"))
}

/// Opens the tools on a page, and chooses a shape by its label.
fn choose(browser: &mut Chromium, label: &str) {
    wait_until("drawing is possible", || {
        let is_ready = "!document.getElementById('drawing-start').disabled \
                        && document.getElementById('picture').dataset.frameWidth === '160'";
        browser.evaluate(is_ready).as_bool().filter(|is| *is)
    });
    browser.click("#drawing-start");
    let chosen = wait_until("the shape can be chosen", || {
        let choose = format!(
            "(() => {{ const choice = document.getElementById('drawing-choice');\
             const option = [...choice.options].find(option => option.text === {label:?});\
             if (!option || document.getElementById('drawing-tools').hidden) return false;\
             choice.value = option.value; choice.dispatchEvent(new Event('change')); return true; }})()"
        );
        browser.evaluate(&choose).as_bool().filter(|is| *is)
    });
    assert!(chosen);
}

/// Returns the place of a pixel of the frame in the window, from the pixels of the picture alone.
fn place(browser: &mut Chromium, [x, y]: [f64; 2]) -> [f64; 2] {
    let place = browser.evaluate(&format!(
        "(() => {{ const canvas = document.getElementById('picture'), box = canvas.getBoundingClientRect();\
         const zoom = Math.min(box.width / canvas.width, box.height / canvas.height);\
         const [left, top] = [box.left + (box.width - zoom * canvas.width) / 2, box.top + (box.height - zoom * canvas.height) / 2];\
         const perPx = zoom * canvas.width / 160;\
         return [left + ({x} + 0.5) * perPx, top + ({y} + 0.5) * perPx]; }})()"
    ));
    [0, 1].map(|axis| place[axis].as_f64().unwrap())
}

fn drag(browser: &mut Chromium, points: [[f64; 2]; 2]) {
    let [from, to] = points.map(|point| place(browser, point));
    browser.mouse("mousePressed", from);
    browser.mouse("mouseMoved", [0, 1].map(|axis| 0.5 * (from[axis] + to[axis])));
    browser.mouse("mouseMoved", to);
    browser.mouse("mouseReleased", to);
}

fn click(browser: &mut Chromium, points: &[[f64; 2]]) {
    for point in points {
        let at = place(browser, *point);
        browser.mouse("mousePressed", at);
        browser.mouse("mouseReleased", at);
    }
}

/// Types a name for the new patch in place of the one before.
fn name(browser: &mut Chromium, text: &str) {
    browser.evaluate(&format!("document.getElementById('drawing-name').value = {text:?}"));
}

/// Writes the shape, and waits for a note with these words.
fn save(browser: &mut Chromium, words: &str) {
    browser.click("#drawing-save");
    wait_until(words, || browser.text("#drawing-note").contains(words).then_some(()));
}

#[test]
fn shapes_drawn_in_a_browser_are_in_the_rig_file_and_its_comments_stay() {
    let Some(mut browser) = Chromium::start() else { return };
    let rig = Rig::new();
    let path = rig_file(&rig);
    let read = || std::fs::read_to_string(&path).unwrap();
    let mut expected = read();
    let server = Server::start_rig(&path);
    browser.resize([1920, 1080], "light");
    browser.open(&server.url("/"));
    choose(&mut browser, "Trigger region");
    drag(&mut browser, [[100.2, 90.1], [20.1, 29.9]]);
    save(&mut browser, "the rig uses it from its next start");
    expected = expected.replace("[1, 2, 30, 40]", "[20, 30, 81, 61]");
    assert_eq!(read(), expected);

    choose(&mut browser, "Patch target");
    browser.click("#drawing-clear");
    click(&mut browser, &[[50.0, 50.0], [90.0, 50.0], [50.0, 90.0], [90.0, 90.0]]);
    std::fs::write(std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("page-drawing.png"), browser.screenshot())
        .unwrap();
    save(&mut browser, "two sides of the polygon cross each other");
    assert_eq!(read(), expected, "a refused shape changes nothing");
    // The last two corners change places: one is dragged away and the other after it, then a key moves a corner.
    drag(&mut browser, [[50.0, 90.0], [90.0, 100.0]]);
    drag(&mut browser, [[90.0, 90.0], [50.0, 90.0]]);
    browser.evaluate("document.querySelector('#drawing-layer circle[data-index=\"0\"]').focus()");
    browser.press_named("ArrowRight");
    browser.press_named("ArrowDown");
    save(&mut browser, "passes the checks");
    let old = "[[40, 44], [80, 44], [80, 84], [40, 84]]";
    expected = expected.replace(old, "[[51.0, 51.0], [90.0, 50.0], [90.0, 100.0], [50.0, 90.0]]");
    assert_eq!(read(), expected);

    choose(&mut browser, "Edge of the surface (new)");
    let ends = [[5.0, 130.0], [150.0, 131.0]].map(|point| place(&mut browser, point));
    browser.touch("touchStart", &[ends[0]]);
    browser.touch("touchMove", &[ends[1]]);
    browser.touch("touchEnd", &[]);
    save(&mut browser, "surface.edge is written");
    expected =
        expected.replace("[surface] # the plate\n", "[surface] # the plate\nedge = [[5.0, 130.0], [150.0, 131.0]]\n");
    assert_eq!(read(), expected);

    choose(&mut browser, "Mask 1 in target (new)");
    browser.click("#drawing-middle");
    save(&mut browser, "the mask reaches beyond its patch");
    browser.click("#drawing-clear");
    click(&mut browser, &[[60.0, 60.0], [70.0, 60.0], [70.0, 70.0]]);
    save(&mut browser, "holes_px of body");
    let mask = "# by hand\nholes_px = [[[60.0, 60.0], [70.0, 60.0], [70.0, 70.0]]]\n";
    expected = expected.replace("# by hand\n", mask);
    assert_eq!(read(), expected);

    choose(&mut browser, "New patch");
    assert_eq!(browser.evaluate("document.getElementById('drawing-name').value"), "patch");
    click(&mut browser, &[[100.0, 20.0], [140.0, 20.0], [140.0, 60.0], [100.0, 60.0]]);
    name(&mut browser, "a wall");
    save(&mut browser, "1 to 32 of the characters");
    name(&mut browser, "target");
    save(&mut browser, "different from the names of the bodies before it");
    assert_eq!(read(), expected, "a refused patch changes nothing");
    name(&mut browser, "wall");
    save(&mut browser, "the new patch \"wall\" is written");
    let corners = "[[100.0, 20.0], [140.0, 20.0], [140.0, 60.0], [100.0, 60.0]]";
    let table = format!("\n[[body]]\nname = \"wall\"\nkind = \"patch\"\npolygon_px = {corners}\n");
    expected = expected.replace(mask, &format!("{mask}{table}"));
    assert_eq!(read(), expected);
    choose(&mut browser, "Patch wall");
    server.process.signal(15);
    server.process.end();
}

/// The answer of a program that draws a region, as a page of this name or without one.
fn draw(server: &Server, page: Option<&str>, body: &Value) -> (u16, Value) {
    server.post_as(page, "/api/drawing", &body.to_string())
}

#[test]
fn only_the_holder_of_control_draws_into_the_file_that_it_has_read() {
    let rig = Rig::new();
    let path = rig_file(&rig);
    let before = std::fs::read_to_string(&path).unwrap();
    let server = Server::start(&path);
    let drawn = server.json("/api/drawing");
    let revision = &drawn["revision"];
    assert_eq!(
        drawn["shapes"][0],
        json!({
            "shape": "trigger-region", "body": null, "place": null, "points_px": [[1.0, 2.0], [30.0, 41.0]]
        })
    );
    let region = |revision: &Value| json!({ "revision": revision, "shape": "trigger-region", "points_px": [[10, 20], [50, 60]] });
    server.post_as(Some("first"), "/api/control", "");
    let (status, answer) = draw(&server, Some("second"), &region(revision));
    assert_eq!((status, &answer["answer"]), (409, &"another page holds control; take control first".into()));
    let wrong =
        json!({ "revision": revision, "shape": "polygon", "body": "no", "points_px": [[1, 1], [9, 1], [9, 9]] });
    let (status, answer) = draw(&server, Some("first"), &wrong);
    assert_eq!((status, &answer["answer"]), (422, &"no body of the rig is named \"no\"".into()));
    for form in [
        json!({}),
        json!({ "shape": "edge" }),
        json!({ "revision": revision, "shape": "edge", "points_px": [["a", 1]] }),
    ] {
        assert_eq!(draw(&server, None, &form).0, 400, "{form}");
    }
    let far = json!({ "revision": revision, "shape": "edge", "points_px": [[0, 70_000], [100, 70_000]] });
    assert_eq!(draw(&server, None, &far).0, 422);
    assert_eq!(std::fs::read_to_string(&path).unwrap(), before, "nothing was written");

    std::fs::write(&path, format!("{before}# a later thought\n")).unwrap();
    let (status, answer) = draw(&server, Some("first"), &region(revision));
    assert_eq!(status, 409, "{answer}");
    assert!(answer["answer"].as_str().unwrap().contains("has changed since the shape was drawn"), "{answer}");
    let revision = &server.json("/api/drawing")["revision"];
    let (status, answer) = draw(&server, Some("first"), &region(revision));
    assert_eq!((status, &answer["accepted"]), (200, &true.into()), "{answer}");
    let after = format!("{before}# a later thought\n").replace("[1, 2, 30, 40]", "[10, 20, 41, 41]");
    assert_eq!(std::fs::read_to_string(&path).unwrap(), after);
}

#[test]
fn a_rig_whose_file_has_changed_since_its_start_has_none_to_draw_into() {
    let rig = Rig::new();
    let path = rig_file(&rig);
    let text = std::fs::read_to_string(&path).unwrap();
    // The server reads its rig from standard input, as from a supervisor, and finds another text under the name.
    let mut command = crate::support::ricochet(["serve", "-", "--origin"]);
    command.arg(&path).stdin(std::process::Stdio::piped());
    std::fs::write(&path, text.replace("too small", "wider")).unwrap();
    let mut server = Server::from_process(crate::support::Background::start(command));
    std::io::Write::write_all(&mut server.process.0.stdin.take().unwrap(), text.as_bytes()).unwrap();
    server.address = server.printed("page: http://");
    let (status, answer) = server.get("/api/drawing");
    assert!(status == 404 && answer.contains("no rig file to write to"), "{answer}");
    assert_eq!(
        server.post("/api/drawing", "{\"revision\":\"0\",\"shape\":\"edge\",\"points_px\":[[0,0],[9,0]]}").0,
        404
    );
}
