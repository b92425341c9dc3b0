//! Topics as server-sent events and WebSockets, and their cost to the rig.

use super::socket::Socket;
use super::{Server, drifting};
use crate::pretrigger::cpu_s;
use crate::support::{Rig, ricochet, wait_until};
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

/// Opens server-sent events; the thread ends with the server.
fn events(address: &str, path: &str) -> Receiver<Value> {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.write_all(format!("GET {path} HTTP/1.1\r\nHost: {address}\r\n\r\n").as_bytes()).unwrap();
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        let mut is_lost = false;
        for line in BufReader::new(stream).lines().map_while(Result::ok) {
            is_lost |= line == "event: lost";
            if let Some(data) = line.strip_prefix("data: ") {
                let mut row: Value = serde_json::from_str(data).unwrap();
                row["is_lost"] = std::mem::take(&mut is_lost).into();
                // The test may have ended.
                let _ = sender.send(row);
            }
        }
    });
    receiver
}

/// A stream that is opened and never read.
fn stalled(address: &str, path: &str) -> TcpStream {
    let mut stream = TcpStream::connect(address).unwrap();
    rustix::net::sockopt::set_socket_recv_buffer_size(&stream, 4096).unwrap();
    stream.write_all(format!("GET {path} HTTP/1.1\r\nHost: {address}\r\n\r\n").as_bytes()).unwrap();
    stream
}

/// The frames of rows that must follow each other without a gap, except for those that were reported lost.
fn check_without_gap(rows: &[Value]) -> u64 {
    let mut next = None;
    let mut lost = 0;
    for row in rows {
        if row["is_lost"] == true {
            lost += row["lost"].as_u64().unwrap();
            next = next.map(|next: u64| next + row["lost"].as_u64().unwrap());
            continue;
        }
        let frame = row["frame"].as_u64().unwrap();
        assert_eq!(frame, next.unwrap_or(frame), "a row is missing that was not reported lost");
        next = Some(frame + 1);
    }
    lost
}

#[test]
fn every_velocity_reaches_event_and_websocket_clients_with_the_columns_of_the_table() {
    let rig = Rig::new();
    let frames = 1000;
    let (config, run) = drifting(&rig, frames, 400.0, "");
    let server = Server::start(&config);
    server.wait_for("READY");
    let rows = events(&server.address, "/api/velocity");
    let kinds = events(&server.address, "/api/events");
    let mut socket = Socket::open(&server.address, "/ws/velocity", "").unwrap();
    let listened = ricochet(["listen", "velocity", "--rig", &rig.name, "--json", "--count", "300"]).output().unwrap();
    assert!(listened.status.success());
    let listened: Vec<Value> =
        listened.stdout.split(|b| *b == b'\n').filter_map(|line| serde_json::from_slice(line).ok()).collect();
    let from_socket: Vec<Value> = (0..300).map(|_| socket.json()).collect();
    let from_events: Vec<Value> = (0..300).map(|_| rows.recv_timeout(Duration::from_secs(60)).unwrap()).collect();
    assert_eq!((check_without_gap(&from_events), check_without_gap(&from_socket)), (0, 0));
    let mut compared = 0;
    for row in &listened {
        for others in [&from_socket, &from_events] {
            let Some(other) = others.iter().find(|other| other["frame"] == row["frame"]) else { continue };
            compared += 1;
            for (name, value) in row.as_object().unwrap().iter().filter(|(name, _)| *name != "body") {
                assert_eq!(&other[name], value, "{name} of frame {}", row["frame"]);
            }
            assert_eq!(other["body"], "ball");
            assert!(other["t_s"].as_f64().unwrap() > 0.0);
        }
    }
    assert!(compared > 200, "{compared} rows in common");
    server.post("/api/trigger", "");
    let kind = std::iter::repeat_with(|| kinds.recv_timeout(Duration::from_secs(60)).unwrap()["kind"].clone());
    assert!(kind.take(50).any(|kind| kind == "recorded"));
    run.signal(15);
    run.end();
}

#[test]
fn ten_clients_of_which_one_is_stalled_cost_the_rig_no_frame() {
    let rig = Rig::new();
    let (rate_hz, frames) = (400.0, 3200);
    let (config, run) = drifting(&rig, frames, rate_hz, "");
    let server = Server::start(&config);
    let stalled = stalled(&server.address, "/api/velocity");
    let readers: Vec<_> = (0..9).map(|_| events(&server.address, "/api/velocity")).collect();
    let states: Vec<_> = (0..9).map(|k| events(&server.address, &format!("/api/state?page=page{k}"))).collect();
    let mut pictures = Socket::open(&server.address, "/ws/picture", "").unwrap();
    server.wait_for("READY");
    let pid = u64::from(server.process.0.id());
    let (cpu, began) = (cpu_s(pid).unwrap(), Instant::now());
    let mut seen = 0_u32;
    while began.elapsed() < Duration::from_secs(5) {
        pictures.receive();
        seen += 1;
    }
    let (cpu, elapsed_s) = (cpu_s(pid).unwrap() - cpu, began.elapsed().as_secs_f64());
    println!(
        "pictures: {:.1} per second, serve: {:.1} % of a core",
        f64::from(seen) / elapsed_s,
        100.0 * cpu / elapsed_s
    );
    let (code, _, stderr) = run.end();
    assert_eq!(code, Some(0), "no frame is lost: {stderr}");
    drop(stalled);
    for reader in readers {
        let mut rows: Vec<Value> = reader.try_iter().collect();
        while let Ok(row) = reader.recv_timeout(Duration::from_millis(500)) {
            rows.push(row);
        }
        check_without_gap(&rows);
        assert!(rows.len() as u64 > frames / 2, "{} rows", rows.len());
    }
    assert!(states.iter().all(|states| states.try_iter().count() > 10));
    assert!(f64::from(seen) / elapsed_s >= 5.0, "{seen} pictures");
}

#[test]
fn the_picture_shows_the_newest_frame_with_the_outline_measured_in_it() {
    let rig = Rig::new();
    let frames = 12_000;
    let (config, run) = drifting(&rig, frames, 200.0, "[rotation]\nmethod = \"field\"");
    let server = Server::start(&config);
    server.wait_for("READY");
    let mut socket = Socket::open(&server.address, "/ws/picture", "").unwrap();
    let header = wait_until("a picture has the outline", || {
        let message = socket.receive();
        let length = u32::from_le_bytes(message[..4].try_into().unwrap()) as usize;
        let header: Value = serde_json::from_slice(&message[4..4 + length]).unwrap();
        let picture = image::load_from_memory(&message[4 + length..]).unwrap();
        assert_eq!((picture.width(), picture.height()), (160, 144));
        header["bodies"][0]["x_px"].is_number().then_some(header)
    });
    let body = &header["bodies"][0];
    let (frame, x_px) = (header["frame"].as_f64().unwrap(), body["x_px"].as_f64().unwrap());
    assert!((x_px - (60.0 + frame * 16.0 / frames as f64)).abs() < 0.5, "{header}");
    assert!((body["radius_px"].as_f64().unwrap() - 36.0).abs() < 0.5, "{header}");
    let vectors = header["vectors"].as_array().unwrap();
    assert!((5..=64).contains(&vectors.len()), "{header}");
    for vector in vectors {
        let [x, y, u, v] = [0, 1, 2, 3].map(|k| vector[k].as_f64().unwrap());
        let center = [body["x_px"].as_f64().unwrap(), body["y_px"].as_f64().unwrap()];
        assert!((x - center[0]).hypot(y - center[1]) < 40.0, "on the disc: {vector}");
        // 16 px in all frames, over an interval of frames.
        assert!((0.0..1.0).contains(&(u + 0.2)) && v.abs() < 0.2, "{vector}");
    }
    assert!(header["sharpness"].as_f64().unwrap() > 0.0, "{header}");
    // The velocity comes some frames after the position.
    let now = wait_until("a picture has the uncertainty of a speed now", || {
        let message = socket.receive();
        let length = u32::from_le_bytes(message[..4].try_into().unwrap()) as usize;
        let header: Value = serde_json::from_slice(&message[4..4 + length]).unwrap();
        header["now"].get(0).cloned()
    });
    let sigma_m_s = now["sigma_v_m_s"].as_f64().unwrap();
    assert!(now["name"] == "ball" && (0.0..0.1).contains(&sigma_m_s), "{now}");
    assert_eq!((&header["mm_per_px"], &header["scale"]), (&0.5.into(), &1.into()));
    let (status, _) = server.get("/api/picture");
    assert_eq!(status, 200);
    run.signal(15);
    run.end();
}

#[test]
fn a_server_waits_for_its_rig_and_finds_the_next_one() {
    let rig = Rig::new();
    let (config, run) = drifting(&rig, 100_000, 100.0, "");
    let server = Server::start(&config);
    server.wait_for("READY");
    run.signal(15);
    run.end();
    let status = server.wait_for("FAULT");
    assert_eq!(status["detail"], format!("rig {} is not running", rig.name));
    let (status, answer) = server.post("/api/arm", "");
    assert_eq!((status, &answer["accepted"]), (503, &false.into()), "{answer}");
    // The successor has a larger ring.
    let (_, run) = drifting(&rig, 100_000, 100.0, "pre_s = 20");
    server.wait_for("READY");
    run.signal(15);
    assert_eq!(run.end().0, Some(0));
}
