//! Several cameras in one rig.

use crate::pipeline::drift;
use crate::support::{Background, Rig, csv, frames, kill, process, ricochet, status, succeed, wait_until};
use ricochet::image::FrameMeta;
use ricochet::recording::Recording;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// A second view with another pattern and another motion.
fn side_film(frames: u64, rate_hz: f64) -> String {
    let film = drift(frames, rate_hz);
    let mut scenario = ricochet::synth::Scenario::from_toml(&film).unwrap();
    scenario.seed += 17;
    if let ricochet::synth::MotionSetup::Constant { start_px, vy_px_frame, .. } = &mut scenario.motion {
        (*start_px, *vy_px_frame) = ([84.0, 60.0], 12.0 / frames as f64);
    }
    toml::to_string(&scenario).unwrap()
}

fn source(film: &Path, paced: bool) -> String {
    format!("source = \"simulated\"\nscenario = \"{}\"\npaced = {paced}", film.display())
}

/// A rig file of two cameras. The second is measured if it has a body.
fn two(rig: &Rig, films: [&Path; 2], paced: bool, body: &str, rest: &str) -> PathBuf {
    let [first, side] = films.map(|film| source(film, paced));
    let view = format!("[view.side.camera]\n{side}\n[view.side.scale]\nmm_per_px = 0.25\n{body}");
    rig.config(&first, &format!("[scale]\nmm_per_px = 0.5\n{view}\n{rest}"))
}

const BODY: &str = "[[view.side.body]]\nname = \"disc\"";

fn table(recording: &Path, camera: Option<&str>, topic: &str) -> String {
    let file = recording.to_str().unwrap();
    let camera = camera.map_or(Vec::new(), |camera| vec!["--camera", camera]);
    succeed([["export", file, "--topic", topic].as_slice(), &camera].concat())
}

fn of_side(recording: &Path) -> Vec<FrameMeta> {
    let view = Recording::open(recording).unwrap().view("side").unwrap();
    view.frames().unwrap().map(|frame| frame.unwrap().0).collect()
}

fn number(status: &Value, name: &str, key: &str) -> u64 {
    process(status, name, 0).map_or(0, |process| process[key].as_u64().unwrap())
}

#[test]
fn each_of_two_cameras_is_measured_as_if_it_were_alone() {
    let rig = Rig::new();
    let films = [rig.file("first.toml", &drift(60, 500.0)), rig.file("side.toml", &side_film(60, 500.0))];
    let config = two(&rig, [&films[0], &films[1]], false, BODY, "[workers]\ncount = 2");
    let (code, printed, stderr) = Background::start(ricochet(["run".as_ref(), config.as_os_str()])).end();
    assert_eq!(code, Some(0), "{stderr}");
    assert_eq!(printed.lines().count(), 1, "one recording: {printed}");
    let recording = PathBuf::from(printed.trim());

    for (camera, film, scale, body) in
        [(None, &films[0], 0.5, ""), (Some("side"), &films[1], 0.25, "[[body]]\nname = \"disc\"\n")]
    {
        let alone = Rig::new();
        let config =
            alone.config(&source(film, false), &format!("[scale]\nmm_per_px = {scale}\n{body}[workers]\ncount = 1"));
        let path = PathBuf::from(succeed(["run".as_ref(), config.as_os_str()]).trim());
        for topic in ["velocity", "track", "field", "impact", "truth"] {
            assert!(table(&recording, camera, topic) == csv(&path, topic), "{topic} of {camera:?}");
        }
        assert!(table(&recording, camera, "velocity").lines().filter(|row| row.ends_with(",valid")).count() > 40);
        let results = rig.path(&format!("{}.mcap", camera.unwrap_or("first")));
        let mut arguments = vec!["analyze", recording.to_str().unwrap(), "-o", results.to_str().unwrap()];
        arguments.extend(camera.iter().flat_map(|camera| ["--camera", camera]));
        succeed(arguments);
        for topic in ["velocity", "track", "field"] {
            assert!(csv(&results, topic) == table(&recording, camera, topic), "{topic} of {camera:?} analysed");
        }
    }
    assert_eq!((frames(&recording).len(), of_side(&recording).len()), (60, 60));
}

#[test]
fn every_command_handles_the_second_camera() {
    let rig = Rig::new();
    let films = [rig.file("first.toml", &drift(48, 500.0)), rig.file("side.toml", &side_film(48, 500.0))];
    let config = two(&rig, [&films[0], &films[1]], false, BODY, "[workers]\ncount = 1");
    let text = std::fs::read_to_string(&config).unwrap();
    std::fs::write(&config, text.replacen("[scale]", "split_bytes = 1048576\n[scale]", 1)).unwrap();
    let recording = PathBuf::from(succeed(["run".as_ref(), config.as_os_str()]).trim());
    let file = recording.to_str().unwrap();
    let report: Value = serde_json::from_str(&succeed(["info", file, "--json"])).unwrap();
    let side = &report["cameras"][0];
    assert_eq!((side["name"].as_str(), side["frames"]["count"].as_u64()), (Some("side"), Some(48)), "{report:#}");
    assert_eq!((side["matching"]["matched"].as_u64(), side["matching"]["worst_ns"].as_u64()), (Some(48), Some(0)));
    assert_eq!(side["bodies"][0], "disc");
    assert!(report["later_files"].as_array().unwrap().len() > 1, "the recording is split: {report:#}");
    let words = succeed(["info", file]);
    assert!(words.contains("48 of 48 frames match one of the first camera, 0.000 us later"), "{words}");
    let events = csv(&recording, "events");
    assert!(events.contains("side: 48 of 48 frames match"), "{events}");

    let pictures = rig.path("pictures");
    let out = pictures.to_str().unwrap();
    succeed(["export", file, "--camera", "side", "--topic", "track", "--format", "png", "-o", out]);
    assert_eq!(std::fs::read_dir(&pictures).unwrap().count(), 48);
    let page = rig.path("side.html");
    succeed(["report", file, "--camera", "side", "-o", page.to_str().unwrap()]);
    assert!(std::fs::read_to_string(&page).unwrap().contains("disc"));
    let refused = crate::support::run(["export", file, "--camera", "top", "--topic", "velocity"]);
    assert_eq!(refused.status.code(), Some(5));
    let stderr = String::from_utf8(refused.stderr).unwrap();
    assert!(stderr.contains("no additional camera named \"top\": it has [\"side\"]"), "{stderr}");

    let shots = rig.path("replayed");
    let replay = ["replay", file, "--rate", "max", "-o", shots.to_str().unwrap(), "--rig", &rig.name];
    let printed = succeed(replay);
    let replayed: Vec<&Path> = printed.lines().map(Path::new).collect();
    assert_eq!(replayed.len(), 2, "a rig for each camera: {printed}");
    for topic in ["velocity", "field"] {
        let mut again = replayed.iter().map(|path| csv(path, topic)).collect::<Vec<_>>();
        let mut wanted = vec![table(&recording, None, topic), table(&recording, Some("side"), topic)];
        again.sort();
        wanted.sort();
        assert!(again == wanted, "{topic}");
    }

    let results = rig.path("results.mcap");
    succeed(["export", file, "--topic", "results", "--format", "mcap", "-o", results.to_str().unwrap()]);
    assert!(table(&results, Some("side"), "velocity") == table(&recording, Some("side"), "velocity"));
    assert_eq!(Recording::open(&results).unwrap().view("side").unwrap().frame_count(), 0);
}

#[test]
fn a_trigger_keeps_the_same_time_span_of_cameras_with_different_rates() {
    let rig = Rig::new();
    let films = [rig.file("first.toml", &drift(3000, 250.0)), rig.file("side.toml", &side_film(1800, 150.0))];
    let rest = "[trigger]\nmode = \"software\"\npre_s = 0.3\npost_s = 0.2\n[workers]\ncount = 1\nblock_frames = 16";
    let config = two(&rig, [&films[0], &films[1]], true, BODY, rest);
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    wait_until("both film", || {
        let both = [rig.name.clone(), format!("{}-side", rig.name)].map(|name| status(&name));
        both.iter()
            .all(|stderr| stderr.as_ref().is_some_and(|stderr| number(stderr, "acquire", "sequence") > 150))
            .then_some(())
    });
    succeed(["trigger", "--rig", rig.name.as_str()]);
    wait_until("the shot is written", || (rig.recordings().len() == 1).then_some(()));
    service.signal(2);
    let (code, _, stderr) = service.end();
    assert_eq!(code, Some(0), "{stderr}");
    let recording = rig.recordings().remove(0);
    let first: Vec<FrameMeta> = frames(&recording).into_iter().map(|(meta, _)| meta).collect();
    let side = of_side(&recording);
    let is_whole = |film: &[FrameMeta]| film.windows(2).all(|pair| pair[1].sequence == pair[0].sequence + 1);
    assert!(is_whole(&first) && is_whole(&side));
    let (from_ns, to_ns) = (first[0].stamp_ns, first.last().unwrap().stamp_ns);
    let period_ns = 1_000_000_000 / 150;
    println!("{} frames, {} of side", first.len(), side.len());
    assert!(side[0].stamp_ns <= from_ns + period_ns && side.last().unwrap().stamp_ns + period_ns > to_ns);
    assert!(side[0].stamp_ns + 17 * period_ns > from_ns && side.last().unwrap().stamp_ns <= to_ns + period_ns);
    let report: Value = serde_json::from_str(&succeed(["info", recording.to_str().unwrap(), "--json"])).unwrap();
    let matching = &report["cameras"][0]["matching"];
    // Frames at 250 Hz are 4 ms apart. Frames at 150 Hz lie 0 or 1.33 ms from the nearest of them.
    assert!(matching["matched"].as_u64().unwrap() as usize + 17 >= side.len(), "{matching}");
    assert!((matching["worst_ns"].as_f64().unwrap() - 1.33e6).abs() < 1e4, "{matching}");
    let results = rig.path("results.mcap");
    for camera in [None, Some("side")] {
        let mut arguments = vec!["analyze", recording.to_str().unwrap(), "-o", results.to_str().unwrap()];
        arguments.extend(camera.iter().flat_map(|camera| ["--camera", camera]));
        succeed(arguments);
        for topic in ["velocity", "field"] {
            let (again, live) = (csv(&results, topic), table(&recording, camera, topic));
            let differ = again.lines().zip(live.lines()).find(|(again, live)| again != live);
            assert!(again == live, "{topic} of {camera:?}: {differ:?}");
        }
        std::fs::remove_file(&results).unwrap();
    }
}

#[test]
fn a_killed_camera_process_leaves_a_gap_in_its_own_camera_only() {
    let rig = Rig::new();
    let films = [rig.file("first.toml", &drift(6000, 250.0)), rig.file("side.toml", &side_film(6000, 250.0))];
    let config = two(&rig, [&films[0], &films[1]], true, BODY, "[workers]\ncount = 1\nblock_frames = 16");
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    let side = format!("{}-side", rig.name);
    let filming = |name: &str, frame: u64| {
        wait_until("both cameras are measured", || {
            let status = status(name)?;
            let is_far = |who: &str| number(&status, who, "sequence") > frame;
            let are_all_reported = ["correlate", "record"].iter().all(|role| number(&status, role, "pid") > 0);
            (is_far("acquire") && is_far("track") && are_all_reported).then_some(status)
        })
    };
    let (first_before, before) = (filming(&rig.name, 100), filming(&side, 100));
    kill(u32::try_from(number(&before, "acquire", "pid")).unwrap(), 9);
    wait_until("the camera streams again", || {
        let status = status(&side)?;
        (number(&status, "acquire", "pid") != number(&before, "acquire", "pid")).then_some(())
    });
    let at = number(&status(&side).unwrap(), "acquire", "sequence");
    let (first_after, after) = (filming(&rig.name, at + 150), filming(&side, at + 150));
    for role in ["correlate", "track", "record"] {
        assert_eq!(number(&after, role, "pid"), number(&before, role, "pid"), "{role} was not restarted");
    }
    for role in ["acquire", "correlate", "track", "record"] {
        assert_eq!(number(&first_after, role, "pid"), number(&first_before, role, "pid"), "{role} was not restarted");
    }
    service.signal(2);
    let (code, printed, stderr) = service.end();
    assert_eq!(code, Some(6), "{stderr}");
    assert!(stderr.contains("acquire 0 of side ended with signal: 9"), "{stderr}");
    assert_eq!(printed.lines().count(), 1, "{printed}");
    let recording = PathBuf::from(printed.trim());
    let first: Vec<u64> = frames(&recording).iter().map(|(meta, _)| meta.sequence).collect();
    assert_eq!(first, (0..first.len() as u64).collect::<Vec<_>>(), "the other camera lost nothing");
    let side = of_side(&recording);
    let gaps: Vec<_> = side.windows(2).filter(|pair| pair[1].sequence != pair[0].sequence + 1).collect();
    assert_eq!(gaps.len(), 1);
    let [last, next] = [gaps[0][0], gaps[0][1]];
    println!("{} frames, {} missing of side", first.len(), next.sequence - last.sequence - 1);
    assert_eq!((last.epoch, next.epoch, next.sequence % 16), (0, 1, 0));
    assert!(next.stamp_ns - last.stamp_ns < 3_000_000_000, "it was away for {} ns", next.stamp_ns - last.stamp_ns);
    let events = csv(&recording, "events");
    assert!(events.contains("acquire 0 of side ended with signal: 9 (SIGKILL) and was restarted"), "{events}");
    assert!(events.contains(&format!("side: frame {}: its process was restarted; epoch 1", next.sequence)), "{events}");
    let results = rig.path("results.mcap");
    let arguments = ["analyze", recording.to_str().unwrap(), "--camera", "side", "-o", results.to_str().unwrap()];
    assert_eq!(crate::support::run(arguments).status.code(), Some(6));
    for topic in ["velocity", "field"] {
        assert!(csv(&results, topic) == table(&recording, Some("side"), topic), "{topic}");
    }
}

#[test]
fn a_camera_without_bodies_is_recorded_and_not_measured() {
    let rig = Rig::new();
    let films = [rig.file("first.toml", &drift(40, 500.0)), rig.file("side.toml", &side_film(40, 500.0))];
    let config = two(&rig, [&films[0], &films[1]], false, "", "[workers]\ncount = 1");
    let recording = PathBuf::from(succeed(["run".as_ref(), config.as_os_str()]).trim());
    assert_eq!(of_side(&recording).len(), 40);
    assert_eq!(table(&recording, Some("side"), "velocity").lines().count(), 1, "the header alone");
    assert_eq!(table(&recording, None, "velocity").lines().count(), 41);
    let refused = crate::support::run(["analyze", recording.to_str().unwrap(), "--camera", "side"]);
    assert_eq!(refused.status.code(), Some(2));
    let stderr = String::from_utf8(refused.stderr).unwrap();
    assert!(stderr.contains("nothing to measure with") && stderr.contains("0 workers or no bodies"), "{stderr}");
    let by_hand = crate::support::run(["track", config.to_str().unwrap(), "--camera", "side"]);
    assert_eq!(by_hand.status.code(), Some(2), "{by_hand:?}");
}
