//! Triggers on measured motion: drops, and motions that are none.

mod rod;

use crate::support::{Background, NO_PAGE, Rig, kill, process, ricochet, status, wait_until};
use ricochet::bus::Bus;
use ricochet::camera::simulated::{meta, stream_format};
use ricochet::config::Config;
use ricochet::image::Frame;
use ricochet::measure::{Measurer, Share};
use ricochet::message::{Command, ReplyCode};
use ricochet::process::analysis_params;
use ricochet::recording::Recording;
use ricochet::synth::{MotionSetup, Scenario, SimulatedFilm};
use ricochet::track::ReorderBuffer;
use ricochet::trigger::Decision;
use std::io::{Read, Write};
use std::time::Duration;

/// Uniform random numbers from 0 to 1.
struct Dice(u64);

impl Dice {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        low + (high - low) * ((self.0 >> 11) as f64 / (1_u64 << 53) as f64)
    }
}

/// The decisions of the trigger over a whole film.
fn decide(world: &SimulatedFilm, config: &Config) -> Vec<Decision> {
    decide_on(world, config, |_| ())
}

/// The decisions over a film whose images are changed on the way.
fn decide_on(world: &SimulatedFilm, config: &Config, change: impl Fn(&mut Vec<u8>)) -> Vec<Decision> {
    let format = stream_format(world);
    let (measure, tracker) = analysis_params(config, &format);
    let mut measurer =
        Measurer::new(&measure, Share::ALL, format.width_px as usize, format.height_px as usize).unwrap();
    let mut order = ReorderBuffer::new(1, tracker.intervals_frames().collect(), u64::MAX);
    order.start_at(0);
    let mut trigger = config.measured_trigger(format.frame_rate_hz, format.exposure_us).unwrap();
    let (mut measured, mut bytes, mut decisions) = (Vec::new(), vec![0; world.frame_bytes()], Vec::new());
    for index in 0..world.frames() {
        world.render(index, &mut bytes);
        change(&mut bytes);
        measurer.push(&Frame { meta: meta(world, index), bytes: &bytes }, &mut measured).unwrap();
        if index + 1 == world.frames() {
            measurer.finish(&mut measured);
        }
        measured.drain(..).for_each(|measured| order.push(measured.step));
        decisions.extend(std::iter::from_fn(|| order.pop()).filter_map(|step| trigger.push(&step)));
    }
    decisions
}

fn rig(edge: [[f64; 2]; 2], angle_deg: f64, trigger: &str) -> Config {
    let text = format!(
        "[camera]\nsource = \"simulated\"\n[scale]\nmm_per_px = 0.5142\n[surface]\nangle_deg = {angle_deg}\nedge = {edge:?}\n\
         [[body]]\ndiameter_mm = 63.25\n[velocity]\ngravity_angle_deg = -71\n[trigger]\n{trigger}\n"
    );
    Config::parse(&text, "rig.toml").unwrap()
}

/// A drop on a level surface, with noise of 2 grey levels, under mains light.
fn drop_scenario(dice: &mut Dice, number: u64) -> Scenario {
    let mut scenario = Scenario::built_in("lacrosse").unwrap();
    scenario.seed = number;
    scenario.light.flicker = 0.08;
    scenario.light.flicker_hz = 120.0;
    let MotionSetup::Impact(impact) = &mut scenario.motion else { panic!("a drop") };
    impact.vn_m_s = -dice.between(0.8, 4.0);
    impact.vt_m_s = dice.between(-0.6, 0.6);
    impact.omega_rad_s = dice.between(-40.0, 40.0);
    // The ball is in the image from the first frame on.
    let fall_s = (0.0178 / -impact.vn_m_s).min(6.0e-3);
    impact.contact_start_s = fall_s * dice.between(0.8, 1.0);
    impact.contact_center_px = [dice.between(100.0, 150.0), dice.between(99.0, 104.0)];
    scenario.camera.frames = (impact.contact_start_s * scenario.camera.frame_rate_hz).ceil() as u64 + 30;
    scenario
}

/// The edge that the ball of a drop touches.
fn edge(scenario: &Scenario) -> [[f64; 2]; 2] {
    let MotionSetup::Impact(impact) = &scenario.motion else { panic!("a drop") };
    let y_px = impact.contact_center_px[1] + scenario.radius_px();
    [[0.0, y_px], [255.0, y_px]]
}

/// Measures one drop: the error of the predicted frame of contact, and how many frames in advance it was predicted.
fn drop_once(number: u64) -> (f64, i64) {
    let scenario = drop_scenario(&mut Dice((number + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15)), number);
    let MotionSetup::Impact(impact) = &scenario.motion else { panic!("a drop") };
    let seen_s = impact.contact_start_s - 0.5e-6 * scenario.camera.exposure_us;
    let config = rig(edge(&scenario), 0.0, "mode = \"predicted-contact\"");
    let decisions = decide(&SimulatedFilm::new(&scenario).unwrap(), &config);
    assert_eq!(decisions.len(), 1, "drop {number} at {} m/s: {decisions:#?}", impact.vn_m_s);
    let error = decisions[0].frame as f64 - seen_s * scenario.camera.frame_rate_hz;
    println!("drop {number}: {:.2} m/s, {} error {error:.2}", impact.vn_m_s, decisions[0].what);
    (error, decisions[0].frame as i64 - decisions[0].newest_frame as i64)
}

#[test]
fn predicted_contact_fires_within_two_frames_of_the_contact_in_a_hundred_drops() {
    let drops = std::thread::scope(|scope| {
        let share = |index: u64| scope.spawn(move || (index..100).step_by(2).map(drop_once).collect::<Vec<_>>());
        [0, 1].map(share).into_iter().flat_map(|thread| thread.join().unwrap()).collect::<Vec<_>>()
    });
    let worst = drops.iter().fold(0.0_f64, |worst, (error, _)| worst.max(error.abs()));
    let mut leads: Vec<i64> = drops.iter().map(|(_, lead)| *lead).collect();
    leads.sort_unstable();
    println!(
        "100 drops, worst {worst:.2} frames, predicted {} to {} frames in advance, median {}",
        leads[0], leads[99], leads[50]
    );
    assert!(drops.len() == 100 && worst <= 2.0, "{worst} frames");
    assert!(leads[50] >= 5, "most are predicted well in advance: median {}", leads[50]);
}

/// The ball of the drops, in uniform motion from `start_px` by `step_px` per frame, with nothing in its way.
fn even(start_px: [f64; 2], step_px: [f64; 2], frames: u64) -> SimulatedFilm {
    let mut scenario = Scenario::built_in("lacrosse").unwrap();
    (scenario.camera.width_px, scenario.camera.height_px, scenario.camera.frames) = (320, 288, frames);
    (scenario.light.flicker, scenario.light.flicker_hz) = (0.08, 120.0);
    scenario.occluder = None;
    scenario.motion =
        MotionSetup::Constant { vx_px_frame: step_px[0], vy_px_frame: step_px[1], omega_deg_frame: 0.2, start_px };
    SimulatedFilm::new(&scenario).unwrap()
}

#[test]
fn a_ball_that_does_not_touch_the_surface_predicts_no_contact() {
    let floor = [[0.0, 220.3], [319.0, 220.3]];
    let none = |what: &str, edge, world: &SimulatedFilm| {
        let decisions = decide(world, &rig(edge, 0.0, "mode = \"predicted-contact\""));
        assert_eq!(decisions, [], "{what}");
    };
    none("a ball at rest on the surface", floor, &even([150.0, 158.6], [0.0, 0.0], 60));
    none("a ball at rest above it", floor, &even([150.0, 100.0], [0.0, 0.0], 60));
    none("a ball that moves along it", floor, &even([80.0, 156.0], [1.5, 0.0], 60));
    none("a ball that rises from it", floor, &even([150.0, 158.0], [0.0, -0.8], 60));
    none("a ball that falls past its end", [[0.0, 220.3], [100.0, 220.3]], &even([180.0, 90.0], [0.0, 1.2], 70));
    let falls = even([150.0, 90.0], [0.0, 1.2], 70);
    assert_eq!(decide(&falls, &rig(floor, 0.0, "mode = \"predicted-contact\"")).len(), 1, "the same above it");
}

#[test]
fn contact_is_predicted_at_a_surface_of_any_angle() {
    // The ball moves right, towards a wall whose normal points left.
    let wall = [[250.0, 287.0], [250.0, 0.0]];
    let world = even([90.0, 140.0], [1.3, 0.0], 80);
    let decisions = decide(&world, &rig(wall, 90.0, "mode = \"predicted-contact\"\nlead_s = 0.001"));
    let touch = (250.0 - 90.0 - 0.5 * 63.25 / 0.5142) / 1.3;
    assert_eq!(decisions.len(), 1);
    assert!((decisions[0].frame as f64 - touch).abs() <= 1.0, "{touch}: {decisions:?}");
    assert!(decisions[0].frame - decisions[0].newest_frame <= 10, "at most 1 ms in advance: {decisions:?}");
}

#[test]
fn a_body_that_enters_fires_once_in_that_frame() {
    let edge = [[0.0, 280.0], [319.0, 280.0]];
    let trigger = "mode = \"enter\"\nroi_px = [160, 0, 100, 288]";
    // Its centre is at 100 + 1.5 n: inside from frame 40 to frame 106, then outside again.
    let decisions = decide(&even([100.0, 140.0], [1.5, 0.0], 110), &rig(edge, 0.0, trigger));
    assert_eq!(decisions.iter().map(|decision| decision.frame).collect::<Vec<_>>(), [40]);
    let inside = decide(&even([200.0, 140.0], [0.1, 0.0], 40), &rig(edge, 0.0, trigger));
    assert_eq!(inside, [], "a body that is inside from the start has not entered");
}

#[test]
fn speed_and_gap_triggers_fire_at_their_thresholds() {
    let edge = [[0.0, 250.3], [319.0, 250.3]];
    // 0.5142 mm a px at 10 kHz: 1.2 px a frame are 6.17 m/s.
    let falls = even([150.0, 90.0], [0.0, 1.2], 80);
    let speed = |m_s: f64| decide(&falls, &rig(edge, 0.0, &format!("mode = \"speed\"\nspeed_m_s = {m_s}"))).len();
    assert_eq!((speed(5.9), speed(6.5)), (1, 0));
    // The gap is 250.3 - 90 - 61.503 - 1.2 n = 98.797 - 1.2 n px; 10 mm are 19.448 px, from frame 66.1 on.
    let gap = decide(&falls, &rig(edge, 0.0, "mode = \"gap\"\ngap_mm = 10"));
    assert_eq!(gap.len(), 1, "{gap:?}");
    assert!((66..=68).contains(&gap[0].frame), "{gap:?}");
}

#[test]
fn after_a_short_flight_the_contact_is_reported_when_it_happens() {
    for (before_frames, vn_m_s) in [(5.2, -3.0), (6.7, -1.2), (13.8, -1.69)] {
        let mut scenario = Scenario::built_in("lacrosse").unwrap();
        let MotionSetup::Impact(impact) = &mut scenario.motion else { panic!("a drop") };
        (impact.contact_start_s, impact.vn_m_s) = (before_frames * 1e-4 + 1e-5, vn_m_s);
        scenario.camera.frames = 50;
        let decisions =
            decide(&SimulatedFilm::new(&scenario).unwrap(), &rig(edge(&scenario), 0.0, "mode = \"predicted-contact\""));
        assert_eq!(decisions.len(), 1, "{before_frames} frames: {decisions:#?}");
        let error = decisions[0].frame as f64 - before_frames;
        println!("{before_frames} frames before: {} error {error:.2}", decisions[0].what);
        assert!(error.abs() <= 2.0, "{before_frames} frames: {error}");
    }
}

#[test]
fn without_a_recorder_the_deciding_process_triggers_and_keeps_the_quiet_time() {
    let rig = Rig::new();
    let mut scenario = Scenario::translation(0.0, 0.0, 0.0);
    (scenario.camera.width_px, scenario.camera.height_px) = (160, 144);
    (scenario.camera.frames, scenario.camera.frame_rate_hz) = (200, 400.0);
    (scenario.light.flicker, scenario.light.flicker_hz) = (0.4, 50.0);
    scenario.body.diameter_mm = 36.0;
    scenario.motion =
        MotionSetup::Constant { vx_px_frame: 0.0, vy_px_frame: 0.0, omega_deg_frame: 0.0, start_px: [80.0, 72.0] };
    let film = rig.file("lamp.toml", &toml::to_string(&scenario).unwrap());
    let answer = rig.path("answer");
    let config = rig.file(
        "rig.toml",
        &format!(
            "[rig]\nname = \"{}\"\n[camera]\nsource = \"simulated\"\nscenario = \"{}\"\npaced = false\n[trigger]\n\
             mode = \"motion\"\nthreshold_dn = 9\nquiet_s = 0.3\ncommand = [\"/bin/sh\", \"-c\", \"echo x >> {}\"]\n\
             [workers]\ncount = 1\n{NO_PAGE}",
            rig.name,
            film.display(),
            answer.display()
        ),
    );
    let listener =
        Background::start(ricochet(["listen", "events", "--rig", rig.name.as_str(), "--json", "--wait", "60"]));
    let (code, _, complaints) = Background::start(ricochet(["run".as_ref(), config.as_os_str()])).end();
    assert_eq!(code, Some(0), "{complaints}");
    let events = events(&listener.end().1);
    let count = |kind: &str| events.iter().filter(|(k, _)| k == kind).count();
    assert!(count("decided") >= 10, "{events:#?}");
    // Half a second of film allows two triggers that are 0.3 s apart.
    assert_eq!((count("triggered"), count("action")), (2, 2), "{events:#?}");
    assert_eq!(std::fs::read_to_string(&answer).unwrap().lines().count(), 2);
    let decided = events.iter().find(|(kind, _)| kind == "decided").unwrap();
    assert!(
        decided.1.starts_with("motion; decided ") && decided.1.ends_with(" us after the frame came"),
        "{decided:?}"
    );
}

/// The events that a listener printed, as (kind, text).
fn events(printed: &str) -> Vec<(String, String)> {
    let word = |line: &serde_json::Value, key: &str| line[key].as_str().unwrap_or_default().to_owned();
    let lines = printed.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    lines.map(|line| (word(&line, "kind"), word(&line, "text"))).collect()
}

#[test]
fn a_drop_is_recorded_around_its_predicted_contact_and_starts_the_actions() {
    let rig = Rig::new();
    let mut scenario = drop_scenario(&mut Dice(3), 3);
    let MotionSetup::Impact(impact) = &mut scenario.motion else { panic!("a drop") };
    (impact.vn_m_s, impact.contact_start_s) = (-2.0, 8.0e-3);
    scenario.camera.frames = 260;
    let [[x0, y0], [x1, y1]] = edge(&scenario);
    let film = rig.file("drop.toml", &toml::to_string(&scenario).unwrap());
    let answer = rig.path("answer");
    let server = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = server.local_addr().unwrap();
    let request = std::thread::spawn(move || {
        let (mut stream, _) = server.accept().unwrap();
        let (mut text, mut bytes) = (String::new(), [0; 4096]);
        while !text.contains("stamp_ns") {
            let count = stream.read(&mut bytes).unwrap();
            text.push_str(std::str::from_utf8(&bytes[..count]).unwrap());
        }
        stream.write_all(b"HTTP/1.1 204 No Content\r\n\r\n").unwrap();
        text
    });
    let config = rig.config(
        &format!("source = \"simulated\"\nscenario = \"{}\"\npaced = false", film.display()),
        &format!(
            "[scale]\nmm_per_px = 0.5142\n[surface]\nedge = [[{x0}, {y0}], [{x1}, {y1}]]\n[[body]]\ndiameter_mm = 63.25\n\
             [trigger]\nmode = \"predicted-contact\"\npre_s = 0.003\npost_s = 0.004\nquiet_s = 10\nother_rig = \"no-such-rig\"\n\
             command = [\"/bin/sh\", \"-c\", \"echo $RICOCHET_FRAME > {}\"]\nurl = \"http://{address}/drop?x=1\"\n\
             [workers]\ncount = 1",
            answer.display()
        ),
    );
    let listener =
        Background::start(ricochet(["listen", "events", "--rig", rig.name.as_str(), "--json", "--wait", "60"]));
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    let (code, _, complaints) = service.end();
    assert_eq!(code, Some(0), "a failed action is no loss: {complaints}");
    let events = events(&listener.end().1);
    let texts =
        |kind: &str| events.iter().filter(|(k, _)| k == kind).map(|(_, text)| text.as_str()).collect::<Vec<_>>();

    let (decided, triggered) = (texts("decided"), texts("triggered"));
    assert_eq!((decided.len(), triggered.len()), (1, 1), "{events:#?}");
    assert!(decided[0].contains("contact at frame 79.") || decided[0].contains("contact at frame 80."), "{decided:?}");
    assert!(decided[0].contains("; decided ") && decided[0].contains(" us after frame "), "{decided:?}");
    let (contact, deepest) = (texts("contact"), texts("deepest"));
    let since: f64 = contact[0].split(' ').rev().nth(1).unwrap().parse().unwrap();
    assert!(contact.len() == 1 && (since - 8.0).abs() < 0.2, "{contact:?}");
    assert!(deepest.len() == 1 && deepest[0].starts_with("ball: deepest at "), "{deepest:?}");
    let mut states = texts("state").into_iter();
    for wanted in ["preparing", "armed", "falling", "impact", "done"] {
        assert!(states.any(|state| state == wanted), "{wanted} in order among {:?}", texts("state"));
    }

    let recording = Recording::open(&rig.recordings()[0]).unwrap();
    let trigger = recording.metadata()["trigger"].clone();
    assert!(trigger.starts_with("ball: contact at frame ") && trigger.ends_with(" at frame 80"), "{trigger}");
    let first = recording.first_frame().unwrap().sequence;
    let last = recording.last_frame().unwrap().sequence;
    assert_eq!((first, last), (0, 120), "3 ms before and 4 ms after, from the start of a block");

    let frame =
        wait_until("the command ran", || std::fs::read_to_string(&answer).ok().filter(|text| text.ends_with('\n')));
    assert_eq!(frame, "80\n");
    let request = request.join().unwrap();
    assert!(request.starts_with("POST /drop?x=1 HTTP/1.1\r\n"), "{request}");
    let body: serde_json::Value = serde_json::from_str(request.split("\r\n\r\n").nth(1).unwrap()).unwrap();
    assert_eq!((body["rig"].as_str(), body["frame"].as_u64()), (Some(rig.name.as_str()), Some(80)));
    let actions = texts("action");
    let is_reported = |start: &str| actions.iter().any(|text| text.starts_with(start));
    assert!(
        is_reported("command /bin/sh: ended with 0 after ")
            && is_reported(&format!("url http://{address}/drop?x=1: answered 204"))
    );
    assert!(is_reported("rig no-such-rig: "), "{actions:?}");
}

#[test]
fn requests_during_a_shot_are_answered_at_once_and_hold_after_it() {
    let rig = Rig::new();
    let film = rig.file("drift.toml", &crate::pipeline::drift(4000, 250.0));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", film.display());
    let trigger = "[trigger]\nmode = \"software\"\nrearm = false\npre_s = 0.1\npost_s = 1.0\n[workers]\ncount = 1";
    let config = rig.config(&camera, trigger);
    let name = rig.name.as_str();
    let listener = Background::start(ricochet(["listen", "events", "--rig", name, "--json", "--wait", "60"]));
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    let ask = |command: &str| ricochet([command, "--rig", name]).output().unwrap();
    wait_until("it films", || ask("trigger").status.success().then_some(()));
    assert!(ask("arm").status.success());
    wait_until("the first shot is written", || (rig.recordings().len() == 1).then_some(()));
    wait_until("the rig is armed, though it does not arm itself", || ask("trigger").status.success().then_some(()));
    assert!(ask("arm").status.success() && ask("disarm").status.success());
    wait_until("the second shot is written", || (rig.recordings().len() == 2).then_some(()));
    let refused = ask("trigger");
    let stderr = String::from_utf8(refused.stderr).unwrap();
    assert!(refused.status.code() == Some(2) && stderr.contains("the rig is disarmed"), "{stderr}");
    service.signal(2);
    let (code, _, stderr) = service.end();
    assert_eq!(code, Some(0), "{stderr}");
    let events = events(&listener.end().1);
    let texts = |kinds: &[&str]| -> Vec<String> {
        let chosen = events.iter().filter(|(kind, _)| kinds.contains(&kind.as_str()));
        chosen.map(|(kind, text)| if text.contains('/') { kind.clone() } else { text.clone() }).collect()
    };
    let states = ["preparing", "armed", "writing", "done", "armed", "writing", "done", "idle", "done"];
    assert_eq!(texts(&["state"]), states, "no shot goes without `writing`");
    let (armed, disarmed) = ("armed; a shot is being written", "disarmed; a shot is being written");
    let wanted = ["software", armed, "recorded", "armed", "software", armed, disarmed, "recorded", "disarmed"];
    assert_eq!(texts(&["triggered", "armed", "disarmed", "recorded"]), wanted);
}

#[test]
fn requests_that_wait_together_are_all_carried_out_in_their_order() {
    let rig = Rig::new();
    let film = rig.file("drift.toml", &crate::pipeline::drift(8000, 250.0));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", film.display());
    let trigger = "[trigger]\nmode = \"software\"\nrearm = false\npre_s = 0.1\npost_s = 0.2\n[workers]\ncount = 1";
    let config = rig.config(&camera, trigger);
    let name = rig.name.as_str();
    let listener = Background::start(ricochet(["listen", "events", "--rig", name, "--json", "--wait", "60"]));
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    wait_until("it films", || ricochet(["trigger", "--rig", name]).output().unwrap().status.success().then_some(()));
    wait_until("the first shot is written", || (rig.recordings().len() == 1).then_some(()));
    let bus = Bus::join(name, "test").unwrap();
    let client = bus.control_client().unwrap();
    let status = status(name).unwrap();
    let recorder = u32::try_from(process(&status, "record", 0).unwrap()["pid"].as_u64().unwrap()).unwrap();
    // Both wait in its queue while it is stopped.
    let send = |commands: [Command; 2]| {
        kill(recorder, 19);
        let pending = commands.map(|command| client.send(command).unwrap());
        kill(recorder, 18);
        pending.map(|reply| ReplyCode::from_number(reply.wait(Duration::from_secs(30)).unwrap().unwrap().code).unwrap())
    };
    assert_eq!(send([Command::Arm, Command::Trigger]), [ReplyCode::Accepted; 2]);
    wait_until("the second shot is written", || (rig.recordings().len() == 2).then_some(()));
    assert_eq!(send([Command::Arm, Command::Disarm]), [ReplyCode::Accepted; 2]);
    assert_eq!(send([Command::Trigger, Command::Arm]), [ReplyCode::NotArmed, ReplyCode::Accepted]);
    service.signal(2);
    let (code, _, stderr) = service.end();
    assert_eq!(code, Some(0), "{stderr}");
    let events = events(&listener.end().1);
    let kinds: Vec<&str> = events.iter().map(|(kind, _)| kind.as_str()).collect();
    let kinds: Vec<&str> = kinds.into_iter().filter(|kind| ["triggered", "armed", "disarmed"].contains(kind)).collect();
    let wanted = ["triggered", "disarmed", "armed", "triggered", "disarmed", "armed", "disarmed", "armed"];
    assert_eq!(kinds, wanted);
}

/// Answers a request with one byte per second for as long as it is read.
fn dripping() -> std::net::SocketAddr {
    let server = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = server.local_addr().unwrap();
    std::thread::spawn(move || {
        let (mut stream, _) = server.accept().unwrap();
        let answer = b"HTTP/1.1 200 OK\r\nServer: drips\r\n".iter().chain(std::iter::repeat(&b'a'));
        for byte in answer {
            if stream.write_all(&[*byte]).is_err() {
                return;
            }
            std::thread::sleep(std::time::Duration::from_secs(1));
        }
    });
    address
}

#[test]
fn a_web_service_that_answers_byte_by_byte_holds_an_action_for_a_bounded_time() {
    let rig = Rig::new();
    let film = rig.file("drift.toml", &crate::pipeline::drift(100_000, 100.0));
    let url = format!("http://{}/drop", dripping());
    let config = rig.config(
        &format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", film.display()),
        &format!("[trigger]\nmode = \"software\"\npre_s = 0.1\npost_s = 0.1\nurl = \"{url}\"\n[workers]\ncount = 1"),
    );
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    wait_until("the trigger is accepted", || {
        crate::support::run(["trigger", "--rig", rig.name.as_str()]).status.success().then_some(())
    });
    let listener =
        Background::start(ricochet(["listen", "events", "--rig", rig.name.as_str(), "--json", "--wait", "60"]));
    wait_until("the shot is recorded", || rig.recordings().pop());
    std::thread::sleep(std::time::Duration::from_secs(7));
    service.signal(2);
    assert_eq!(service.end().0, Some(0));
    let events = events(&listener.end().1);
    let action = events.iter().find(|(kind, _)| kind == "action").unwrap_or_else(|| panic!("{events:#?}"));
    let ms: u64 = action.1.split(" after ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!(action.1.contains("timeout") && (4000..7000).contains(&ms), "{action:?}");
}
