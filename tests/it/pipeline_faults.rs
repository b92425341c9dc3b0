//! The whole pipeline under faults: results stay functions of the frames, and losses are reported.

use crate::pipeline::drift;
use crate::support::{
    Background, Rig, complaints, csv, frames, kill, process, ricochet, run, status, succeed, wait_until,
};
use ricochet::image::{Frame, FrameMeta, PixelFormat};
use ricochet::recording::{Recording, RecordingInfo, RecordingWriter, WriterOptions};
use serde_json::Value;
use std::path::{Path, PathBuf};

const TABLES: [&str; 4] = ["velocity", "field", "track", "impact"];

pub fn tables(path: &Path) -> [String; 4] {
    TABLES.map(|topic| csv(path, topic))
}

/// Writes a rig file for a slow drift of 40 frames, with `camera` and `rest` added.
pub fn drifting(rig: &Rig, camera: &str, rest: &str) -> PathBuf {
    let scenario = rig.file("drift.toml", &drift(40, 1000.0));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\n{camera}", scenario.display());
    rig.config(&camera, &format!("[scale]\nmm_per_px = 0.5\n{rest}"))
}

/// Analyses a film with this many workers and returns the exit code and the tables.
pub fn analysis(rig: &Rig, film: &Path, workers: &str) -> (Option<i32>, [String; 4]) {
    let results = rig.path(&format!("analysis-{workers}-{}", film.file_name().unwrap().to_str().unwrap()));
    let arguments = ["analyze".as_ref(), film.as_os_str(), "--workers".as_ref(), workers.as_ref(), "-o".as_ref()];
    let output = run(arguments.into_iter().chain([results.as_os_str()]));
    (output.status.code(), tables(&results))
}

/// The mean of a column of `/velocity` over the valid rows of one body.
fn mean(table: &str, body: &str, column: &str) -> f64 {
    let mut reader = csv::Reader::from_reader(table.as_bytes());
    let at = |name: &str, header: &csv::StringRecord| header.iter().position(|cell| cell == name).unwrap();
    let header = reader.headers().unwrap().clone();
    let (column, of) = (at(column, &header), at("body", &header));
    let rows = reader.records().map(Result::unwrap).filter(|row| &row[of] == body);
    let numbers: Vec<f64> = rows.filter_map(|row| row[column].parse().ok()).collect();
    assert!(numbers.len() > 20, "{} numbers of {body}", numbers.len());
    numbers.iter().sum::<f64>() / numbers.len() as f64
}

#[test]
fn live_and_analysed_results_are_equal_for_every_interval_and_any_number_of_workers() {
    for (intervals, shortest) in [("2", 2), ("5", 5), ("[1, 4]", 1)] {
        let rig = Rig::new();
        let rest = format!("[correlation]\ninterval_frames = {intervals}\n[workers]\ncount = 3\nblock_frames = 8");
        let config = drifting(&rig, "paced = false", &rest);
        succeed(["run".as_ref(), config.as_os_str()]);
        let recording = &rig.recordings()[0];
        let live = tables(recording);
        for workers in ["1", "2", "5"] {
            let (code, analysed) = analysis(&rig, recording, workers);
            assert_eq!(code, Some(0));
            assert!(analysed == live, "intervals {intervals}, {workers} workers");
        }
        let speed = mean(&live[0], "ball", "dx_px");
        assert!((speed - 0.4).abs() < 0.01, "{speed} px per frame over {intervals} frames");
        let without = live[0].lines().filter(|row| row.split(',').nth(7) == Some("")).count();
        assert_eq!(without, shortest, "the last frames have no target");
    }
}

/// Writes frames as a recording with this rig file attached.
pub fn write(path: &Path, config: &Path, frames: &[(FrameMeta, Vec<u8>)]) {
    let metadata = [("frame_rate_hz".to_owned(), "1000".to_owned())].into();
    let config_toml = std::fs::read_to_string(config).unwrap();
    let info = RecordingInfo { config_toml, metadata, ..RecordingInfo::default() };
    let mut writer = RecordingWriter::create(path, &info, &WriterOptions::default()).unwrap();
    for (meta, bytes) in frames {
        writer.write_frame(&Frame { meta: *meta, bytes }).unwrap();
    }
    writer.finish().unwrap();
}

pub fn film(rig: &Rig) -> Vec<(FrameMeta, Vec<u8>)> {
    let path = rig.path("film.mcap");
    let scenario = rig.path("drift.toml");
    succeed(["simulate".as_ref(), scenario.as_os_str(), "-o".as_ref(), path.as_os_str()]);
    frames(&path)
}

#[test]
fn a_film_with_gaps_gives_the_same_results_with_any_number_of_workers() {
    for interval in ["1", "2", "5", "[1, 3]"] {
        let rig = Rig::new();
        let rest = format!("[correlation]\ninterval_frames = {interval}\n[workers]\nblock_frames = 8");
        let config = drifting(&rig, "", &rest);
        let mut frames = film(&rig);
        // Lost within a block, at its first frame, at its last, and two in a row.
        frames.retain(|(meta, _)| meta.sequence >= 3 && ![11, 16, 23, 29, 30].contains(&meta.sequence));
        let path = rig.path("gaps.mcap");
        write(&path, &config, &frames);
        let (code, one) = analysis(&rig, &path, "1");
        assert_eq!(code, Some(6), "five frames are missing");
        for workers in ["2", "3"] {
            assert!(analysis(&rig, &path, workers).1 == one, "interval {interval}, {workers} workers");
        }
        let replay = ["replay", path.to_str().unwrap(), "--rate", "max", "--workers", "2", "--rig", &rig.name];
        let output = run(replay.into_iter().chain(["-o", rig.path("shots").to_str().unwrap()]));
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(6), "{stderr}");
        // Each of the five frames counts once in each kind of loss.
        let rows = if interval == "[1, 3]" { 10 } else { 5 };
        let lost = format!("lost: 5 frames by the camera, {rows} rows not measured, 5 frames not recorded");
        assert!(stderr.trim_end().ends_with(&lost), "{stderr}");
        assert!(tables(&rig.recordings()[0]) == one, "replay with interval {interval}");
        let rows = one[0].lines().skip(1).filter(|row| row.contains(",lost")).count();
        assert_eq!((one[0].lines().count() - 1, rows), (37, 5), "one row per frame, missing ones included");
    }
}

#[test]
fn replay_and_analysis_agree_for_a_period_that_is_no_whole_nanosecond() {
    let rig = Rig::new();
    rig.file("drift.toml", &drift(40, 7000.0));
    film(&rig);
    let path = rig.path("film.mcap");
    let (code, analysed) = analysis(&rig, &path, "1");
    assert_eq!(code, Some(0));
    let shots = rig.path("shots");
    let replay = ["replay", path.to_str().unwrap(), "--rate", "max", "--rig", &rig.name];
    succeed(replay.into_iter().chain(["-o", shots.to_str().unwrap()]));
    assert!(tables(&rig.recordings()[0]) == analysed);
}

#[test]
fn a_given_rate_replaces_the_stamps() {
    let rig = Rig::new();
    let config = drifting(&rig, "", "");
    film(&rig);
    let path = rig.path("film.mcap");
    let speed = |name: &str, rate: &[&str]| {
        let results = rig.path(name);
        let arguments = ["analyze", path.to_str().unwrap(), "--config", config.to_str().unwrap(), "-o"];
        succeed(arguments.into_iter().chain([results.to_str().unwrap()]).chain(rate.iter().copied()));
        mean(&csv(&results, "velocity"), "ball", "vx_m_s")
    };
    // 0.4 px per frame at 0.5 mm per pixel.
    let own = speed("own.mcap", &[]);
    assert!((own - 0.2).abs() < 0.002, "{own} m/s at the stamps' 1000 Hz");
    let faster = speed("faster.mcap", &["--fps", "30000"]);
    assert!((faster - 30.0 * own).abs() < 0.01 * faster, "{faster} m/s at 30000 Hz");
}

#[test]
fn replay_and_analysis_of_a_part_agree_at_any_rate() {
    let rig = Rig::new();
    let config = drifting(&rig, "", "[workers]\nblock_frames = 8");
    let frames = film(&rig);
    let path = rig.path("whole.mcap");
    write(&path, &config, &frames);
    // From within a block to within another: frames 5 to 29.
    let part = rig.path("part.mcap");
    write(&part, &config, &frames[5..30]);
    let (code, cut) = analysis(&rig, &part, "1");
    assert_eq!((code, cut[0].lines().count()), (Some(0), 26));
    let span = ["--from", "0.005", "--to", "0.03"];
    let results = rig.path("span.mcap");
    let arguments = ["analyze", path.to_str().unwrap(), "--workers", "3", "-o", results.to_str().unwrap()];
    succeed(arguments.into_iter().chain(span));
    assert!(tables(&results) == cut, "analysis of the part");
    for rate in ["max", "0.25", "4"] {
        let shots = rig.path(&format!("shots-{rate}"));
        let replay = ["replay", path.to_str().unwrap(), "--rate", rate, "--workers", "2", "--rig", &rig.name];
        let printed = succeed(replay.into_iter().chain(span).chain(["-o", shots.to_str().unwrap()]));
        assert!(tables(Path::new(printed.trim())) == cut, "replay at {rate}");
    }
}

#[test]
fn a_film_played_twice_gives_the_same_results_twice() {
    let rig = Rig::new();
    let config = drifting(&rig, "", "");
    let path = rig.path("whole.mcap");
    write(&path, &config, &film(&rig));
    let replay = ["replay", path.to_str().unwrap(), "--rate", "max", "--loop=2", "--rig", &rig.name];
    let printed = succeed(replay.into_iter().chain(["-o", rig.path("shots").to_str().unwrap()]));
    let paths: Vec<&Path> = printed.lines().map(Path::new).collect();
    let (_, once) = analysis(&rig, &path, "1");
    assert_eq!(paths.len(), 2, "{printed}");
    assert!(paths.iter().all(|path| tables(path) == once));
}

#[test]
fn compressed_images_give_the_results_of_the_original() {
    use foxglove::Encode;
    use foxglove::messages::CompressedImage;
    let rig = Rig::new();
    // Recordings of this program hold the exposure time, those of others do not.
    let config = drifting(&rig, "exposure_us = 20", "");
    let frames = film(&rig);
    let path = rig.path("png.mcap");
    let mut writer = mcap::Writer::new(std::fs::File::create(&path).unwrap()).unwrap();
    let schema = CompressedImage::get_schema().unwrap();
    let schema = writer.add_schema(&schema.name, &schema.encoding, &schema.data).unwrap();
    let channel_id = writer.add_channel(schema, "/cam", "protobuf", &Default::default()).unwrap();
    for (meta, pixels) in &frames {
        let mut png = std::io::Cursor::new(Vec::new());
        let picture = image::GrayImage::from_raw(meta.width_px, meta.height_px, pixels.clone()).unwrap();
        picture.write_to(&mut png, image::ImageFormat::Png).unwrap();
        let message = CompressedImage { data: png.into_inner().into(), ..CompressedImage::default() };
        let (log_time, publish_time) = (meta.stamp_ns, meta.stamp_ns);
        let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time, publish_time };
        writer.write_to_known_channel(&header, &prost::Message::encode_to_vec(&message)).unwrap();
    }
    writer.finish().unwrap();
    let measured = |film: &Path, name: &str| {
        let results = rig.path(name);
        let arguments = ["analyze", film.to_str().unwrap(), "--config", config.to_str().unwrap(), "-o"];
        succeed(arguments.into_iter().chain([results.to_str().unwrap()]));
        tables(&results)
    };
    assert!(measured(&path, "png-results.mcap") == measured(&rig.path("film.mcap"), "film-results.mcap"));
}

#[test]
fn two_bodies_are_measured_side_by_side() {
    let rig = Rig::new();
    let bodies = "[[body]]\nname = \"left\"\nroi_px = [0, 0, 160, 144]\ndiameter_mm = 36\n\
        [[body]]\nname = \"right\"\nroi_px = [160, 0, 160, 144]\ndiameter_mm = 36\n";
    let config = drifting(&rig, "", bodies);
    let film = film(&rig);
    // The same ball on both sides, on the right with time reversed.
    let side_by_side = film.iter().zip(film.iter().rev()).map(|((meta, left), (_, right))| {
        let rows = left.chunks_exact(160).zip(right.chunks_exact(160));
        let bytes = rows.flat_map(|(left, right)| left.iter().chain(right).copied()).collect();
        (FrameMeta { width_px: 320, stride_bytes: 320, ..*meta }, bytes)
    });
    let path = rig.path("two.mcap");
    write(&path, &config, &side_by_side.collect::<Vec<_>>());
    let (code, one) = analysis(&rig, &path, "1");
    assert_eq!(code, Some(0));
    assert!(analysis(&rig, &path, "3").1 == one);
    let replay = ["replay", path.to_str().unwrap(), "--rate", "max", "--workers", "2", "--rig", &rig.name];
    succeed(replay.into_iter().chain(["-o", rig.path("shots").to_str().unwrap()]));
    assert!(tables(&rig.recordings()[0]) == one);
    let (left, right) = (mean(&one[0], "left", "dx_px"), mean(&one[0], "right", "dx_px"));
    assert!((left - 0.4).abs() < 0.01 && (right + 0.4).abs() < 0.01, "{left} and {right} px per frame");
    let (left, right) = (mean(&one[0], "left", "center_x_px"), mean(&one[0], "right", "center_x_px"));
    assert!((right - left - 160.0).abs() < 0.5, "{left} and {right}");
}

#[test]
fn twelve_bit_images_are_measured_from_camera_to_table() {
    let rig = Rig::new();
    let config = drifting(&rig, "paced = false\npixel_format = \"Mono12\"", "[workers]\ncount = 2");
    succeed(["run".as_ref(), config.as_os_str()]);
    let recording = &rig.recordings()[0];
    let frames = frames(recording);
    assert_eq!((frames.len(), frames[0].0.format), (40, PixelFormat::Mono12));
    let level = |pair: &[u8]| u16::from_le_bytes([pair[0], pair[1]]);
    let highest = frames[0].1.chunks_exact(2).map(level).max().unwrap();
    assert!((256..4096).contains(&highest), "{highest}");
    let live = tables(recording);
    let (code, analysed) = analysis(&rig, recording, "3");
    assert_eq!(code, Some(0));
    assert!(analysed == live);
    let speed = mean(&live[0], "ball", "dx_px");
    assert!((speed - 0.4).abs() < 0.01, "{speed}");
}

/// A rig that records a slow drift in real time for longer than any test needs.
fn filming(rig: &Rig, rate_hz: f64, rest: &str) -> PathBuf {
    let scenario = rig.file("long.toml", &drift(20_000, rate_hz));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", scenario.display());
    rig.config(&camera, &format!("[scale]\nmm_per_px = 0.5\n{rest}"))
}

fn number(status: &Value, name: &str, key: &str) -> u64 {
    process(status, name, 0).map_or(0, |process| process[key].as_u64().unwrap())
}

fn wait_for_frame(rig: &Rig, frame: u64) -> Value {
    wait_until("the rig measures", || {
        let status = status(&rig.name)?;
        (number(&status, "track", "sequence") > frame).then_some(status)
    })
}

#[test]
fn an_interrupted_rig_leaves_a_complete_recording_and_exits_with_0() {
    let rig = Rig::new();
    let config = filming(&rig, 60.0, "[workers]\ncount = 2");
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    wait_for_frame(&rig, 50);
    service.signal(2);
    let (code, printed, stderr) = service.end();
    assert_eq!((code, complaints(&stderr)), (Some(0), vec![]));
    let path = Path::new(printed.trim());
    assert_eq!(Recording::open(path).unwrap().truncated(), None);
    let sequences: Vec<u64> = frames(path).iter().map(|(meta, _)| meta.sequence).collect();
    assert!(sequences.len() > 50 && sequences == (0..sequences.len() as u64).collect::<Vec<_>>(), "{sequences:?}");
    let (code, analysed) = analysis(&rig, path, "1");
    assert_eq!(code, Some(0));
    assert!(analysed == tables(path));
}

#[test]
fn a_second_rig_of_the_same_name_is_refused_and_the_first_keeps_running() {
    let rig = Rig::new();
    let config = filming(&rig, 60.0, "[workers]\ncount = 1");
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    wait_for_frame(&rig, 30);
    for role in ["run", "acquire"] {
        let second = run([role.as_ref(), config.as_os_str()]);
        let stderr = String::from_utf8(second.stderr).unwrap();
        assert_eq!(second.status.code(), Some(4), "{stderr}");
        let wanted = format!(
            "ricochet: rig {:?} has a process `ricochet {role}` already; stop it, or choose another [rig] name\n",
            rig.name
        );
        assert_eq!(stderr, wanted);
    }
    let status = wait_for_frame(&rig, 60);
    assert_eq!(number(&status, "run", "restarts"), 0);
    service.signal(15);
    let (code, _, stderr) = service.end();
    assert_eq!((code, complaints(&stderr)), (Some(0), vec![]));
    assert_eq!(rig.recordings().len(), 1);
}

#[test]
fn a_listener_that_never_reads_slows_nothing_down() {
    let rig = Rig::new();
    let config = filming(&rig, 60.0, "[workers]\ncount = 2");
    let name = rig.name.as_str();
    let listen = |topic| Background::start(ricochet(["listen", topic, "--rig", name, "--wait", "60"]));
    let listeners = ["field", "velocity", "track", "status"].map(listen);
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    wait_for_frame(&rig, 10);
    listeners.iter().for_each(|listener| listener.signal(19));
    let status = wait_for_frame(&rig, 200);
    for process in status["processes"].as_array().unwrap() {
        assert_eq!((process["lost"].as_u64(), process["dropped"].as_u64()), (Some(0), Some(0)), "{process}");
    }
    service.signal(2);
    let (code, printed, stderr) = service.end();
    assert_eq!((code, complaints(&stderr)), (Some(0), vec![]));
    assert!(frames(Path::new(printed.trim())).len() > 200);
}

#[test]
fn a_hanging_recorder_loses_only_its_own_frames() {
    let rig = Rig::new();
    let config = filming(&rig, 120.0, "[workers]\ncount = 1");
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    let status = wait_for_frame(&rig, 50);
    let recorder = u32::try_from(number(&status, "record", "pid")).unwrap();
    kill(recorder, 19);
    // Longer than the ring and the queue of the recorder together.
    let status = wait_until("the ring has wrapped", || {
        let status = crate::support::status(&rig.name)?;
        (number(&status, "acquire", "sequence") > 800).then_some(status)
    });
    assert_eq!(number(&status, "acquire", "lost") + number(&status, "acquire", "dropped"), 0, "{status}");
    kill(recorder, 18);
    wait_until("the recorder records again", || {
        let status = crate::support::status(&rig.name)?;
        (number(&status, "record", "sequence") > 800).then_some(())
    });
    service.signal(2);
    let (code, _, stderr) = service.end();
    assert_eq!(code, Some(6), "{stderr}");
    let sequences: Vec<u64> = frames(&rig.recordings()[0]).iter().map(|(meta, _)| meta.sequence).collect();
    assert!(sequences.len() < *sequences.last().unwrap() as usize, "the gap shows in the file");
}

#[test]
fn a_worker_that_falls_behind_and_its_losses_are_reported_while_they_happen() {
    let rig = Rig::new();
    let config = filming(&rig, 500.0, "[workers]\ncount = 1");
    let events = Background::start(ricochet(["listen", "events", "--rig", &rig.name, "--json", "--wait", "60"]));
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    let worker = u32::try_from(number(&wait_for_frame(&rig, 50), "correlate", "pid")).unwrap();
    kill(worker, 19);
    let at = number(&crate::support::status(&rig.name).unwrap(), "acquire", "sequence");
    wait_until("more frames have come than the ring holds", || {
        let status = crate::support::status(&rig.name)?;
        (number(&status, "acquire", "sequence") > at + 800).then_some(())
    });
    kill(worker, 18);
    wait_until("the worker counts its losses", || {
        let status = crate::support::status(&rig.name)?;
        (number(&status, "correlate", "lost") > 0).then_some(())
    });
    service.signal(2);
    let (code, _, stderr) = service.end();
    assert_eq!(code, Some(6), "{stderr}");
    let (_, printed, _) = events.end();
    let rows: Vec<Value> = printed.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let texts = |kind: &str| -> Vec<&str> {
        rows.iter().filter(|row| row["kind"] == kind).map(|row| row["text"].as_str().unwrap()).collect()
    };
    let (behind, lost) = (texts("behind"), texts("lost"));
    assert!(behind.iter().any(|text| text.starts_with("correlate 0: 512 of at most 512 frames wait")), "{behind:?}");
    let lost = lost.iter().find(|text| text.starts_with("correlate 0 lost ")).unwrap();
    assert!(lost.ends_with(" frames before it could measure them"), "{lost}");
}

#[test]
fn a_hanging_worker_does_not_delay_a_shot_forever() {
    let rig = Rig::new();
    let trigger = "[trigger]\nmode = \"software\"\npre_s = 0.5\npost_s = 0.5\n[workers]\ncount = 2";
    let config = filming(&rig, 60.0, trigger);
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    let status = wait_for_frame(&rig, 100);
    let worker = process(&status, "correlate", 1).unwrap()["pid"].as_u64().unwrap();
    let worker = u32::try_from(worker).unwrap();
    kill(worker, 19);
    let at = number(&crate::support::status(&rig.name).unwrap(), "acquire", "sequence");
    wait_until("it has missed some blocks", || {
        let status = crate::support::status(&rig.name)?;
        (number(&status, "acquire", "sequence") > at + 64).then_some(())
    });
    succeed(["trigger", "--rig", rig.name.as_str()]);
    wait_until("the shot is written though its rows are missing", || (rig.recordings().len() == 1).then_some(()));
    kill(worker, 18);
    service.signal(2);
    let (code, _, stderr) = service.end();
    assert_eq!(code, Some(6), "{stderr}");
    let recording = Recording::open(&rig.recordings()[0]).unwrap();
    let rows: Vec<_> = recording.velocities().unwrap().map(Result::unwrap).collect();
    assert_eq!(rows.len() as u64, recording.frame_count(), "one row per frame");
    let lost = rows.iter().filter(|row| row.status == ricochet::results::PointStatus::Lost).count();
    assert!(lost > 0 && lost < rows.len(), "{lost} of {} rows", rows.len());
}

#[test]
fn after_a_killed_camera_process_the_recording_continues_with_a_new_epoch() {
    let rig = Rig::new();
    let config = filming(&rig, 120.0, "[workers]\ncount = 2");
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    let before = wait_for_frame(&rig, 100);
    kill(u32::try_from(number(&before, "acquire", "pid")).unwrap(), 9);
    let after = wait_until("the next run is measured", || {
        let status = status(&rig.name)?;
        let tracked = process(&status, "track", 0)?;
        let goes_on = tracked["run_id"] != process(&before, "track", 0)?["run_id"];
        (goes_on && number(&status, "track", "sequence") > number(&before, "acquire", "sequence") + 50)
            .then_some(status)
    });
    for role in ["correlate", "track", "record"] {
        assert_eq!(number(&after, role, "pid"), number(&before, role, "pid"), "{role} was not restarted");
    }
    service.signal(2);
    let (code, printed, stderr) = service.end();
    assert_eq!(code, Some(6), "{stderr}");
    assert_eq!(printed.lines().count(), 1, "{printed}");
    let path = Path::new(printed.trim());
    let film = frames(path);
    let gaps: Vec<_> = film.windows(2).filter(|pair| pair[1].0.sequence != pair[0].0.sequence + 1).collect();
    assert_eq!((film[0].0.sequence, gaps.len()), (0, 1));
    let [(last, _), (next, _)] = [&gaps[0][0], &gaps[0][1]];
    println!("{} frames missing, {} ns", next.sequence - last.sequence - 1, next.stamp_ns - last.stamp_ns);
    assert_eq!((last.epoch, next.epoch, next.sequence % 16), (0, 1, 0));
    assert!(next.stamp_ns - last.stamp_ns < 3_000_000_000, "the camera streams again within 3 s");
    let events = csv(path, "events");
    let restart = format!("frame {}: its process was restarted; epoch 1", next.sequence);
    assert!(events.contains(&restart) && events.contains("acquire 0 ended with signal: 9 (SIGKILL)"), "{events}");
    let (code, analysed) = analysis(&rig, path, "1");
    assert_eq!(code, Some(6));
    assert!(analysed == tables(path), "the frames around the gap are measured live as they are afterwards");
}

#[test]
fn a_listener_does_not_wait_for_a_dead_rig() {
    let rig = Rig::new();
    let config = filming(&rig, 60.0, "[workers]\ncount = 1");
    let listener = Background::start(ricochet(["listen", "track", "--rig", rig.name.as_str(), "--wait", "60"]));
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    wait_for_frame(&rig, 20);
    service.signal(9);
    let (code, printed, stderr) = listener.end();
    assert_eq!(code, Some(4), "{stderr}");
    assert!(printed.lines().count() > 10, "{printed}");
    assert!(stderr.contains("exited without closing its stream"), "{stderr}");
    service.end();
}
