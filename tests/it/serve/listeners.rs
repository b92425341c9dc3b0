//! Every way out of a rig at full rate: how many of its velocities arrive, and how old they are.

use super::socket::Socket;
use super::{Server, small_drift_at, udp};
use crate::support::{Background, Rig, ricochet};
use serde_json::Value;
use std::net::UdpSocket;
use std::process::Command;
use std::time::{SystemTime, UNIX_EPOCH};

/// Prints the frame and the age, ns, of a number of velocities.
const PYTHON: &str = "import itertools, sys, time, ricochet\n\
                      rows = ricochet.listen('velocity', rig=sys.argv[1], wait_s=60)\n\
                      for row in itertools.islice(rows, int(sys.argv[2])):\n\
                      \tprint(row['frame'], time.time_ns() - row['stamp_ns'])";
/// The places of the sequence number and the stamp in a datagram, bytes.
const SEQUENCE: std::ops::Range<usize> = 24..32;
const STAMP_NS: std::ops::Range<usize> = 32..40;

/// A row that a listener received: its frame and its age, ns.
type Row = (u64, i64);

/// Returns the number of frames between the first and the last row of which no row came.
fn missing(rows: &[Row]) -> u64 {
    rows[rows.len() - 1].0 + 1 - rows[0].0 - rows.len() as u64
}

fn median_age_ms(rows: &[Row]) -> f64 {
    let mut ages: Vec<i64> = rows.iter().map(|row| row.1).collect();
    ages.sort_unstable();
    ages[ages.len() / 2] as f64 * 1e-6
}

/// Returns the time since a stamp of the present, ns.
fn age_ns(stamp_ns: u64) -> i64 {
    let now_ns = SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_nanos();
    now_ns as i64 - stamp_ns as i64
}

/// Starts a rig that films a small disc at this rate until it is stopped, and sends datagrams to this port.
fn start(rig: &Rig, rate_hz: f64, port: u16) -> Server {
    let film = rig.file("drift.toml", &small_drift_at(256, rate_hz));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true\nendless = true", film.display());
    let serve = format!("[serve]\nhttp = \"127.0.0.1:0\"\nudp = \"127.0.0.1:{port}\"\n[trigger]\nmode = \"software\"");
    let server = Server::start_rig(&rig.config(&camera, &format!("{serve}\n[scale]\nmm_per_px = 1")));
    server.wait_for("READY");
    server
}

/// Starts the listener of the Python package.
fn python(rig: &Rig, count: usize) -> Background {
    let mut command = Command::new("python3");
    let package = concat!(env!("CARGO_MANIFEST_DIR"), "/python/src");
    command.env("PYTHONPATH", package).args(["-c", PYTHON, &rig.name, &count.to_string()]);
    Background::start(command)
}

/// Returns what the listener of the Python package received.
fn from_python(listener: Background) -> Vec<Row> {
    let (code, printed, stderr) = listener.end();
    assert_eq!(code, Some(0), "{stderr}");
    let row = |line: &str| line.split_once(' ').map(|(frame, age)| (frame.parse().unwrap(), age.parse().unwrap()));
    printed.lines().filter_map(row).collect()
}

/// Reads velocities from a WebSocket.
fn from_socket(address: &str, count: usize) -> Vec<Row> {
    let mut socket = Socket::open(address, "/ws/velocity", "").unwrap();
    let rows = std::iter::repeat_with(|| socket.json()).take(count);
    rows.map(|row: Value| (row["frame"].as_u64().unwrap(), age_ns(row["stamp_ns"].as_u64().unwrap()))).collect()
}

/// Reads velocities from datagrams.
fn from_datagrams(receiver: &UdpSocket, count: usize) -> Vec<Row> {
    let next = || {
        let mut bytes = [0; 128];
        receiver.recv(&mut bytes).unwrap();
        let number = |place: std::ops::Range<usize>| u64::from_le_bytes(bytes[place].try_into().unwrap());
        (number(SEQUENCE), age_ns(number(STAMP_NS)))
    };
    std::iter::repeat_with(next).take(count).collect()
}

/// Returns the median time from a frame to its velocity where the tracker publishes it, ms.
fn published_ms(rig: &Rig) -> f64 {
    let output = ricochet(["status", "--rig", &rig.name, "--json"]).output().unwrap();
    let status: Value = serde_json::from_slice(&output.stdout).unwrap();
    let processes = status["processes"].as_array().unwrap();
    let tracker = processes.iter().find(|process| process["process"] == "track").unwrap();
    1e3 * tracker["row_latency_median_s"].as_f64().unwrap()
}

#[test]
#[ignore = "10 s at 5000 frames per second, on a machine that does nothing else"]
fn python_c_and_websocket_receive_every_velocity_of_5000_frames_per_second() {
    let (rig, port, count) = (Rig::new(), udp::free_port(), 50_000);
    let mut controller = Command::new(udp::compile(&rig));
    controller.arg(port.to_string());
    let controller = Background::start(controller);
    let controller = std::thread::spawn(|| controller.end());
    let server = start(&rig, 5000.0, port);
    let package = python(&rig, count);
    let package = std::thread::spawn(|| from_python(package));
    let from_socket = from_socket(&server.address, count);
    let from_python = package.join().unwrap();
    server.process.signal(15);
    let (code, _, stderr) = server.process.end();
    assert_eq!(code, Some(0), "{stderr}");
    let (_, _, counts) = controller.join().unwrap();
    println!(
        "Python: {} missing of {count}; WebSocket: {} missing; C: {counts}",
        missing(&from_python),
        missing(&from_socket)
    );
    assert_eq!((missing(&from_python), missing(&from_socket)), (0, 0));
    assert!(counts.contains(" 0 lost on the way"), "{counts}");
}

#[test]
#[ignore = "10 s at 1000 frames per second, on a machine that does nothing else"]
fn a_velocity_is_with_its_listeners_within_a_millisecond() {
    let (rig, count) = (Rig::new(), 8000);
    let receiver = UdpSocket::bind("127.0.0.1:0").unwrap();
    let server = start(&rig, 1000.0, receiver.local_addr().unwrap().port());
    let package = python(&rig, count);
    let package = std::thread::spawn(|| from_python(package));
    let datagrams = std::thread::spawn(move || from_datagrams(&receiver, count));
    let socket = from_socket(&server.address, count);
    let published_ms = published_ms(&rig);
    let received = [("Python", package.join().unwrap()), ("UDP", datagrams.join().unwrap()), ("WebSocket", socket)];
    server.process.signal(15);
    let (code, _, stderr) = server.process.end();
    assert_eq!(code, Some(0), "{stderr}");
    for (kind, rows) in received {
        let age_ms = median_age_ms(&rows) - published_ms;
        println!("{kind}: {} missing of {count}, {age_ms:.3} ms after the tracker", missing(&rows));
        assert!(missing(&rows) == 0 && age_ms < 1.0, "{kind}: {age_ms} ms");
    }
}
