//! Foxglove viewers: the WebSocket protocol `foxglove.sdk.v1`, spoken by a client of our own.

use super::socket::Socket;
use super::{Server, run_alone};
use crate::support::{Background, Rig, wait_until};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::TcpStream;

const PROTOCOL: &str = "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n";

/// A rig with a drifting disc in real time, and its server with an address for viewers.
fn served(rig: &Rig, frames: u64, rate_hz: f64) -> (Background, Server, String) {
    served_with(rig, frames, rate_hz, "")
}

/// The same with further tables in the rig file.
fn served_with(rig: &Rig, frames: u64, rate_hz: f64, tables: &str) -> (Background, Server, String) {
    let film = rig.file("drift.toml", &crate::pipeline::drift(frames, rate_hz));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", film.display());
    let rest = "[serve]\nhttp = \"127.0.0.1:0\"\nfoxglove = \"127.0.0.1:0\"\n[trigger]\nmode = \"software\"\n\
                [scale]\nmm_per_px = 0.5\n[workers]\ncount = 1";
    let config = rig.config(&camera, &format!("{rest}\n{tables}"));
    // The page is served by hand.
    let alone = std::fs::read_to_string(&config).unwrap().replace("foxglove = \"127.0.0.1:0\"\n", "");
    let run = run_alone(rig, &rig.file("alone.toml", &alone));
    let mut server = Server::start(&config);
    let viewers = server.printed("foxglove: ws://");
    server.wait_for("READY");
    (run, server, viewers)
}

/// A viewer that has read what the server offers.
struct Viewer {
    socket: Socket,
    channels: BTreeMap<String, Value>,
    services: BTreeMap<String, Value>,
}

impl Viewer {
    fn open(address: &str) -> Self {
        let socket = Socket::open(address, "/", PROTOCOL).unwrap();
        let mut viewer = Self { socket, channels: BTreeMap::new(), services: BTreeMap::new() };
        while viewer.channels.len() < 7 || viewer.services.len() < 3 {
            let message = viewer.socket.json();
            let named = |list: &Value, key: &str| -> Vec<(String, Value)> {
                let list = list.as_array().unwrap().iter();
                list.map(|entry| (entry[key].as_str().unwrap().to_owned(), entry.clone())).collect()
            };
            match message["op"].as_str().unwrap() {
                "advertise" => viewer.channels.extend(named(&message["channels"], "topic")),
                "advertiseServices" => viewer.services.extend(named(&message["services"], "name")),
                _ => {}
            }
        }
        viewer
    }

    /// Subscribes to topics, in which the number of a subscription is its place in the list.
    fn subscribe(&mut self, topics: &[&str]) {
        let list: Vec<Value> = (0..)
            .zip(topics)
            .map(|(id, topic)| json!({ "id": id, "channelId": self.channels[*topic]["id"] }))
            .collect();
        self.socket.send(&json!({ "op": "subscribe", "subscriptions": list }).to_string());
    }

    /// Receives the next message of a subscription: its number and payload.
    fn message(&mut self) -> (u32, Vec<u8>) {
        loop {
            let bytes = self.socket.receive();
            if bytes[0] == 1 {
                return (u32::from_le_bytes(bytes[1..5].try_into().unwrap()), bytes[13..].to_vec());
            }
        }
    }

    /// Sends a request about parameters and returns the next values of parameters, by name.
    fn parameters(&mut self, request: &Value) -> BTreeMap<String, Value> {
        self.socket.send(&request.to_string());
        loop {
            let bytes = self.socket.receive();
            let Ok(message) = serde_json::from_slice::<Value>(&bytes) else { continue };
            if message["op"] == "parameterValues" {
                let list = message["parameters"].as_array().unwrap().iter();
                return list
                    .map(|entry| (entry["name"].as_str().unwrap().to_owned(), entry["value"].clone()))
                    .collect();
            }
        }
    }

    /// Calls a service and returns its answer.
    fn call(&mut self, name: &str) -> Value {
        let service = self.services[name]["id"].as_u64().unwrap() as u32;
        let mut request = vec![2];
        request.extend(service.to_le_bytes());
        request.extend(7_u32.to_le_bytes());
        request.extend(4_u32.to_le_bytes());
        request.extend(b"json{}");
        self.socket.send_bytes(&request);
        loop {
            let bytes = self.socket.receive();
            if bytes[0] == 3 {
                let length = u32::from_le_bytes(bytes[9..13].try_into().unwrap()) as usize;
                return serde_json::from_slice(&bytes[13 + length..]).unwrap();
            }
        }
    }
}

#[test]
fn a_viewer_receives_picture_annotations_and_velocity_and_arms_the_rig() {
    let rig = Rig::new();
    let (_run, server, address) = served(&rig, 4000, 400.0);
    let mut viewer = Viewer::open(&address);
    viewer.subscribe(&["/camera/image", "/camera/annotations", "/velocity"]);
    let (mut counts, mut last) = ([0; 3], BTreeMap::new());
    while counts.iter().any(|count| *count < 3) {
        let (id, payload) = viewer.message();
        counts[id as usize] += 1;
        last.insert(id, payload);
    }
    let row: Value = serde_json::from_slice(&last[&2]).unwrap();
    assert_eq!((&row["body"], &row["status"]), (&"ball".into(), &"valid".into()));
    let jpeg = last[&0].windows(3).position(|bytes| bytes == [0xff, 0xd8, 0xff]);
    assert!(jpeg.is_some(), "the picture is a JPEG file within the message");
    assert!(last[&1].len() > 60, "annotations have an outline: {} bytes", last[&1].len());
    assert_eq!(viewer.call("/disarm")["accepted"], true);
    server.wait_for("DISARMED");
    assert_eq!(viewer.call("/arm")["accepted"], true);
    server.wait_for("READY");
}

#[test]
fn a_viewer_receives_the_fields_and_the_log_and_reads_the_settings() {
    let rig = Rig::new();
    let (_run, server, address) = served_with(&rig, 8000, 200.0, "[rotation]\nmethod = \"field\"");
    let mut viewer = Viewer::open(&address);
    let all = viewer.parameters(&json!({ "op": "getParameters", "parameterNames": [], "id": "1" }));
    assert_eq!((&all["rig.name"], &all["armed"]), (&rig.name.as_str().into(), &true.into()), "{all:?}");
    assert_eq!((&all["scale.mm_per_px"], &all["camera.paced"]), (&0.5.into(), &true.into()));
    let wanted = json!({ "name": "scale.mm_per_px", "value": 3.0 });
    let set = viewer.parameters(&json!({ "op": "setParameters", "parameters": [wanted], "id": "2" }));
    assert_eq!(set["scale.mm_per_px"], 0.5, "a setting cannot be changed: {set:?}");
    viewer.subscribe(&["/field", "/log"]);
    let mut field = Value::Null;
    while field.is_null() {
        let (id, payload) = viewer.message();
        if id == 0 {
            field = serde_json::from_slice(&payload).unwrap();
        }
    }
    let points = field["points"].as_array().unwrap();
    let valid: Vec<&Value> = points.iter().filter(|point| point["status"] == "valid").collect();
    assert!(valid.len() >= 5 && field["body"] == "ball", "{field}");
    // 16 px in 8000 frames.
    let frames = field["target_frame"].as_f64().unwrap() - field["frame"].as_f64().unwrap();
    let mean = valid.iter().map(|point| point["u_px"].as_f64().unwrap()).sum::<f64>() / valid.len() as f64;
    assert!((mean - frames * 16.0 / 8000.0).abs() < 0.05, "{mean} px in {frames} frames");
    let mut other = Viewer::open(&address);
    assert_eq!(other.call("/disarm")["accepted"], true);
    server.wait_for("DISARMED");
    let is_entry = |payload: &[u8]| payload.windows(8).any(|bytes| bytes == b"disarmed");
    let mut log = std::iter::repeat_with(|| viewer.message()).filter(|(id, _)| *id == 1);
    assert!(log.by_ref().take(20).any(|(_, payload)| is_entry(&payload)), "the log has the event");
    let armed = wait_until("the parameter follows", || {
        let armed = other.parameters(&json!({ "op": "getParameters", "parameterNames": ["armed"], "id": "3" }));
        (armed["armed"] == false).then_some(armed)
    });
    assert_eq!(armed.len(), 1, "{armed:?}");
}

/// The types of panels in the layout, as Foxglove and Lichtblick name them in their files.
const PANELS: [&str; 6] = ["CallService", "Image", "Parameters", "Plot", "RawMessages", "RosOut"];

#[test]
fn the_layout_shows_topics_and_services_that_the_server_has() {
    let layout: Value = serde_json::from_str(include_str!("../../../config/foxglove.json")).unwrap();
    let rig = Rig::new();
    let (_run, _server, address) = served(&rig, 2000, 200.0);
    let viewer = Viewer::open(&address);
    let mut named = Vec::new();
    collect_names(&layout["configById"], &mut named);
    for name in &named {
        let topic = name.split('.').next().unwrap();
        assert!(viewer.channels.contains_key(topic) || viewer.services.contains_key(topic), "{name}");
    }
    assert!(named.len() >= 8, "{named:?}");
    for (panel, settings) in layout["configById"].as_object().unwrap() {
        assert!(PANELS.contains(&panel.split('!').next().unwrap()), "{panel}");
        for path in settings["paths"].as_array().into_iter().flatten() {
            let (topic, column) = path["value"].as_str().unwrap().split_once('.').unwrap();
            let schema: Value = serde_json::from_str(viewer.channels[topic]["schema"].as_str().unwrap()).unwrap();
            assert_eq!(schema["properties"][column]["type"], "number", "{path}");
            // Rows have no `header.stamp`, and a viewer draws nothing for a message without it.
            assert!(schema["properties"]["header"].is_null() && path["timestampMethod"] == "receiveTime", "{path}");
        }
    }
    // Each panel of the layout has its settings, and the other way round.
    let mut panels = Vec::new();
    collect_panels(&layout["layout"], &mut panels);
    let mut configured: Vec<&str> = layout["configById"].as_object().unwrap().keys().map(String::as_str).collect();
    panels.sort_unstable();
    configured.sort_unstable();
    assert_eq!(panels, configured);
}

/// Collects every text that names a topic or a service: it begins with a slash.
fn collect_names<'a>(value: &'a Value, names: &mut Vec<&'a str>) {
    match value {
        Value::String(text) if text.starts_with('/') => names.push(text),
        Value::Array(list) => list.iter().for_each(|entry| collect_names(entry, names)),
        Value::Object(map) => {
            names.extend(map.keys().map(String::as_str).filter(|key| key.starts_with('/')));
            map.values().for_each(|entry| collect_names(entry, names));
        }
        _ => {}
    }
}

/// Collects the panels of a layout, which is a panel or a split into two.
fn collect_panels<'a>(layout: &'a Value, panels: &mut Vec<&'a str>) {
    match layout {
        Value::String(panel) => panels.push(panel),
        split => ["first", "second"].iter().for_each(|half| collect_panels(&split[*half], panels)),
    }
}

/// The resident memory of a process without what it shares with others, such as the rig's, bytes.
fn memory(pid: u32) -> u64 {
    let text = std::fs::read_to_string(format!("/proc/{pid}/statm")).unwrap();
    let pages: Vec<u64> = text.split(' ').skip(1).take(2).map(|number| number.parse().unwrap()).collect();
    (pages[0] - pages[1]) * 4096
}

#[test]
fn a_stalled_viewer_costs_little_memory_and_delays_nobody() {
    let rig = Rig::new();
    let (_run, server, address) = served(&rig, 8000, 400.0);
    let pid = server.process.0.id();
    let mut viewer = Viewer::open(&address);
    viewer.subscribe(&["/camera/image", "/velocity"]);
    viewer.message();
    let before = memory(pid);
    let mut stalled = Viewer::open(&address);
    stalled.subscribe(&["/camera/image", "/velocity", "/camera/annotations"]);
    let mut rows = Vec::new();
    while rows.len() < 2000 {
        let (id, payload) = viewer.message();
        if id == 1 {
            let row: Value = serde_json::from_slice(&payload).unwrap();
            rows.push(row["frame"].as_u64().unwrap());
        }
    }
    let grown = memory(pid).saturating_sub(before);
    println!("a stalled viewer costs {grown} bytes");
    assert!(grown < 16 << 20, "{grown} bytes");
    assert!(rows.windows(2).all(|pair| pair[1] == pair[0] + 1), "the other viewer has every row");
    assert_eq!(server.json("/api/status")["lost"]["frames"].as_u64().unwrap_or(0), 0);
}

#[test]
fn other_protocols_are_refused() {
    let rig = Rig::new();
    let (_run, _server, address) = served(&rig, 2000, 400.0);
    assert!(Socket::open(&address, "/", "Sec-WebSocket-Protocol: chat\r\n").is_err());
    let mut stream = TcpStream::connect(&address).unwrap();
    stream.write_all(b"nonsense\r\n\r\n").unwrap();
    let mut answer = String::new();
    // The server ends the connection, with or without an answer.
    let _ = stream.read_to_string(&mut answer);
    wait_until("another viewer", || Some(Viewer::open(&address)));
}
