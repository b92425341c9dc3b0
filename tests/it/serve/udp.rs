//! Velocities as UDP datagrams, received by the example in C.

use super::Server;
use crate::support::{Background, Rig, wait_until};
use ricochet::recording::Recording;
use std::collections::BTreeMap;
use std::net::UdpSocket;
use std::path::Path;
use std::process::Command;

/// Starts a rig that films 3000 frames at 1000 per second and sends its velocities to this port.
fn start(rig: &Rig, port: u16) -> Server {
    let film = rig.file("drift.toml", &super::small_drift(3000));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", film.display());
    let rest = format!(
        "[serve]\nhttp = \"127.0.0.1:0\"\nudp = \"127.0.0.1:{port}\"\n[scale]\nmm_per_px = 1\n[workers]\ncount = 1"
    );
    Server::start_rig(&rig.config(&camera, &rest))
}

/// A port that is free now.
pub fn free_port() -> u16 {
    UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// Compiles the example in C.
pub fn compile(rig: &Rig) -> std::path::PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let program = rig.path("listen");
    let mut compiler = Command::new("gcc");
    compiler.args(["-std=c11", "-Wall", "-Wextra", "-Werror", "-I"]).arg(root.join("include"));
    let output = compiler.arg(root.join("examples/listen.c")).arg("-o").arg(&program).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    program
}

#[test]
fn a_controller_in_c_receives_every_velocity_of_a_recording() {
    let rig = Rig::new();
    let port = free_port();
    let mut command = Command::new(compile(&rig));
    command.arg(port.to_string());
    let listener = Background::start(command);
    // Its output is read all the time, so that it never waits for its reader.
    let listener = std::thread::spawn(|| listener.end());
    let server = start(&rig, port);
    let (code, _, stderr) = server.process.end();
    assert!(matches!(code, Some(0 | 6)), "{stderr}");
    let (code, printed, counts) = listener.join().unwrap();
    assert_eq!(code, Some(0), "{counts}");
    let path = rig.recordings().remove(0);
    let samples = Recording::open(&path).unwrap().velocities().unwrap().map(Result::unwrap);
    let rows = samples.filter_map(|s| Some((s.frame, s.velocity?)));
    let rows: BTreeMap<u64, [f64; 3]> =
        rows.map(|(frame, v)| (frame, [v.vn_m_s, v.vt_m_s, v.omega_rad_s.unwrap()])).collect();
    let mut received = BTreeMap::new();
    for line in printed.lines() {
        let numbers: Vec<f64> = line.split(' ').skip(1).map(|word| word.parse().unwrap()).collect();
        let frame: u64 = line.split(' ').next().unwrap().parse().unwrap();
        assert!(received.insert(frame, numbers.clone()).is_none(), "frame {frame} came twice");
        assert_eq!(rows.get(&frame).map(|row| row.to_vec()), Some(numbers), "frame {frame}");
    }
    let first = *received.keys().next().unwrap();
    let missing: Vec<&u64> =
        rows.range(first..).map(|(frame, _)| frame).filter(|f| !received.contains_key(f)).collect();
    println!("{} of {} rows received, from frame {first} on; {}", received.len(), rows.len(), counts.trim());
    assert!(missing.is_empty(), "missing: {missing:?}");
    assert!(received.len() > rows.len() / 2, "the server has missed the start");
    assert!(counts.contains(" 0 lost on the way"), "{counts}");
}

#[test]
fn an_absent_controller_costs_nothing() {
    let rig = Rig::new();
    let server = start(&rig, free_port());
    let sent = wait_until("datagrams are sent", || {
        let udp = server.json("/api/status")["udp"].clone();
        udp["sent"].as_u64().filter(|sent| *sent > 1000).map(|_| udp)
    });
    assert_eq!(sent["unsent"], 0, "{sent}");
    server.process.signal(15);
    let (_, _, stderr) = server.process.end();
    assert!(!stderr.contains("datagram"), "{stderr}");
}
