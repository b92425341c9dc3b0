//! Attacks on the server.

use super::socket::Socket;
use super::{SERVED, Server, drifting};
use crate::support::{Rig, ricochet, run, wait_until};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

const TOKEN: &str = "correct-horse-battery";

/// Sends bytes, and returns the status and the whole answer.
fn raw(address: &str, request: &str) -> (u16, String) {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = Vec::new();
    // A server that refuses a body closes the connection before it has read it.
    let _ = stream.read_to_end(&mut answer);
    let answer = String::from_utf8_lossy(&answer).into_owned();
    let status = answer.split(' ').nth(1).and_then(|status| status.parse().ok());
    (status.unwrap_or_else(|| panic!("no status: {answer:?}")), answer)
}

fn ask(server: &Server, method: &str, path: &str, headers: &str) -> (u16, String) {
    let address = &server.address;
    raw(address, &format!("{method} {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n{headers}\r\n"))
}

/// A server without a rig.
fn alone(rig: &Rig, rest: &str) -> Server {
    let config = rig.config("source = \"simulated\"", rest);
    Server::start(&config)
}

#[test]
fn a_request_without_the_token_or_with_a_wrong_one_is_refused_everywhere() {
    let rig = Rig::new();
    let file = rig.file("token", &format!("{TOKEN}\n"));
    let server = alone(&rig, &format!("[serve]\nhttp = \"127.0.0.1:0\"\ntoken_file = \"{}\"", file.display()));
    let reads =
        ["/", "/page.js", "/api/status", "/api/velocity", "/api/shots", "/shots/x.mcap", "/openapi.json", "/no"];
    for path in reads {
        assert_eq!(ask(&server, "GET", path, "").0, 401, "{path}");
        assert_eq!(ask(&server, "GET", path, "Authorization: Bearer correct-horse-batterx\r\n").0, 401, "{path}");
        assert_eq!(ask(&server, "GET", path, "Cookie: ricochet_token=\r\n").0, 401, "{path}");
    }
    for path in ["/api/arm", "/api/disarm", "/api/trigger", "/api/control", "/api/drawing"] {
        assert_eq!(ask(&server, "POST", path, "Content-Length: 0\r\n").0, 401, "{path}");
    }
    assert_eq!(Socket::open(&server.address, "/ws/velocity", "").err(), Some(401));
    assert_eq!(ask(&server, "GET", "/?token=wrong", "").0, 401);
    assert_eq!(ask(&server, "GET", "/api/status?token=correct-horse-battery", "").0, 401, "only the page takes it");
    let (status, answer) = ask(&server, "GET", &format!("/?token={TOKEN}"), "");
    assert_eq!(status, 303, "{answer}");
    let cookie = answer.lines().find_map(|line| line.strip_prefix("set-cookie: ")).unwrap();
    assert!(cookie.contains("HttpOnly") && cookie.contains("SameSite=Strict"), "{cookie}");
    let cookie = cookie.split(';').next().unwrap();
    assert_eq!(ask(&server, "GET", "/", &format!("Cookie: {cookie}\r\n")).0, 200);
    assert_eq!(ask(&server, "GET", "/api/status", &format!("Authorization: Bearer {TOKEN}\r\n")).0, 200);
    server.process.signal(15);
    let (code, printed, logged) = server.process.end();
    assert_eq!(code, Some(0));
    assert!(!printed.contains(TOKEN) && !logged.contains(TOKEN), "{printed}{logged}");
}

#[test]
fn an_address_that_other_computers_reach_needs_a_token() {
    let rig = Rig::new();
    let config = rig.config("source = \"simulated\"", "[serve]\nhttp = \"0.0.0.0:0\"");
    let output = run(["serve".as_ref(), config.as_os_str()]);
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(2) && message.contains("serve.token_file is missing"), "{message}");
    let short = rig.file("token", "short\n");
    let rest = format!("[serve]\nhttp = \"0.0.0.0:0\"\ntoken_file = \"{}\"", short.display());
    let config = rig.config("source = \"simulated\"", &rest);
    let output = run(["serve".as_ref(), config.as_os_str()]);
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(2) && message.contains("16 to 256"), "{message}");
}

#[test]
fn no_path_leaves_the_folder_of_the_recordings() {
    let rig = Rig::new();
    rig.file("secret.mcap", "secret");
    let server = alone(&rig, SERVED);
    let names = [
        "../secret.mcap",
        "..%2fsecret.mcap",
        "%2e%2e%2fsecret.mcap",
        "%2e%2e/secret.mcap",
        "..%5csecret.mcap",
        "%2fetc%2fpasswd",
        "/etc/passwd",
        "....//secret.mcap",
        "%00",
        "secret.mcap%00.mcap",
        "%ff%fe",
    ];
    for name in names {
        let below = ["", "/report", "/picture", "/velocity", "/frames/0"];
        for path in below.map(|below| format!("/shots/{name}{below}")) {
            let (status, answer) = ask(&server, "GET", &path, "");
            assert!((400..500).contains(&status) && !answer.contains("secret\n"), "{path}: {answer}");
        }
        let headers = "Content-Length: 14\r\n\r\n{\"reason\":\"x\"}";
        let (status, answer) = ask(&server, "POST", &format!("/api/shots/{name}/reject"), headers);
        assert!((400..500).contains(&status), "{name}: {answer}");
    }
    let left: Vec<_> = std::fs::read_dir(rig.path(".")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert!(left.iter().all(|name| !name.to_string_lossy().ends_with(".rejected")), "{left:?}");
}

#[test]
fn pages_of_other_sites_can_neither_command_nor_listen_nor_frame() {
    let rig = Rig::new();
    let server = alone(&rig, SERVED);
    let foreign = "Origin: http://evil.example\r\nContent-Length: 0\r\n";
    for path in ["/api/arm", "/api/disarm", "/api/trigger", "/api/control", "/api/drawing", "/api/shots/x/reject"] {
        assert_eq!(ask(&server, "POST", path, foreign).0, 403, "{path}");
    }
    for path in ["/ws/velocity", "/ws/impact", "/ws/events", "/ws/picture"] {
        assert_eq!(Socket::open(&server.address, path, "Origin: http://evil.example\r\n").err(), Some(403), "{path}");
    }
    let own = format!("Origin: http://{}\r\n", server.address);
    assert!(Socket::open(&server.address, "/ws/velocity", &own).is_ok());
    let rebound = "GET /api/status HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n";
    assert_eq!(raw(&server.address, rebound).0, 403);
    let (_, page) = ask(&server, "GET", "/", "");
    for header in
        ["x-frame-options: DENY", "frame-ancestors 'none'", "nosniff", "cross-origin-resource-policy: same-origin"]
    {
        assert!(page.contains(header), "{header} in {page}");
    }
    assert!(!page.to_lowercase().contains("access-control-allow-origin"), "{page}");
}

#[test]
fn huge_slow_and_malformed_requests_are_refused_and_cost_the_others_nothing() {
    let rig = Rig::new();
    let server = alone(&rig, SERVED);
    let huge = "x".repeat(5000);
    let (status, _) = ask(&server, "POST", "/api/arm", &format!("Content-Length: 5000\r\n\r\n{huge}"));
    assert_eq!(status, 413);
    let (status, _) = ask(&server, "POST", "/api/arm", "Content-Length: 9999999999999\r\n\r\nx");
    assert_eq!(status, 413);
    let (status, _) = ask(&server, "GET", &format!("/{}", "x".repeat(40_000)), "");
    assert!((400..500).contains(&status), "{status}");
    for garbage in [
        "\x16\x03\x01\x02\n\r\n\r\n",
        "GET\r\n\r\n",
        "GET / HTTP/9.9\r\n\r\n",
        "POST / HTTP/1.1\r\nContent-Length: -1\r\n\r\n",
    ] {
        let mut stream = TcpStream::connect(&server.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        stream.write_all(garbage.as_bytes()).unwrap();
        let mut answer = Vec::new();
        // The server may close the connection without an answer.
        let _ = stream.read_to_end(&mut answer);
        assert!(answer.is_empty() || answer.starts_with(b"HTTP/1.1 4"), "{garbage:?}: {answer:?}");
    }
    // A body that never comes ends within the limit, and a request meanwhile is answered at once.
    let began = Instant::now();
    let mut slow = TcpStream::connect(&server.address).unwrap();
    slow.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    let host = &server.address;
    slow.write_all(format!("POST /api/arm HTTP/1.1\r\nHost: {host}\r\nContent-Length: 10\r\n\r\nx").as_bytes())
        .unwrap();
    assert_eq!(server.get("/api/status").0, 200);
    assert!(began.elapsed() < Duration::from_secs(4), "{:?}", began.elapsed());
    let mut answer = [0; 12];
    slow.read_exact(&mut answer).unwrap();
    assert_eq!(&answer, b"HTTP/1.1 408");
}

#[test]
fn malformed_frames_end_their_websocket_alone() {
    let rig = Rig::new();
    let server = alone(&rig, SERVED);
    for frame in [&[0xff_u8; 40][..], &[0x81, 0x7f, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff], &[0x83, 0x00]] {
        let mut stream = TcpStream::connect(&server.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        let host = &server.address;
        let request = format!(
            "GET /ws/velocity HTTP/1.1\r\nHost: {host}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
             Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n\r\n"
        );
        stream.write_all(request.as_bytes()).unwrap();
        stream.write_all(frame).unwrap();
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        assert!(answer.starts_with(b"HTTP/1.1 101"), "{answer:?}");
    }
    assert_eq!(server.get("/api/status").0, 200);
}

#[test]
fn a_thousand_idle_connections_leave_room_for_the_operator() {
    let rig = Rig::new();
    let (config, running) = drifting(&rig, 3000, 400.0, "");
    let server = Server::start(&config);
    server.wait_for("READY");
    let idle: Vec<TcpStream> = (0..1000).filter_map(|_| TcpStream::connect(&server.address).ok()).collect();
    assert!(idle.len() > 500, "{} connections", idle.len());
    let began = Instant::now();
    assert_eq!(server.get("/api/status").0, 200);
    println!("answered after {:?} beside {} idle connections", began.elapsed(), idle.len());
    assert!(began.elapsed() < Duration::from_secs(5), "{:?}", began.elapsed());
    drop(idle);
    let (code, _, stderr) = running.end();
    assert_eq!(code, Some(0), "no frame is lost: {stderr}");
}

#[test]
fn a_second_server_on_an_address_names_it_and_how_to_change_it() {
    let rig = Rig::new();
    let server = alone(&rig, SERVED);
    let config = rig.config("source = \"simulated\"", &format!("[serve]\nhttp = \"{}\"", server.address));
    let output = ricochet(["serve".as_ref(), config.as_os_str()]).output().unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.contains(&server.address) && message.contains("[serve] http"), "{message}");
    let config = rig.config("source = \"simulated\"", "[serve]\nhttp = \"off\"");
    let output = run(["serve".as_ref(), config.as_os_str()]);
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn the_document_describes_requests_that_the_server_answers() {
    let rig = Rig::new();
    let server = alone(&rig, SERVED);
    let document = server.json("/openapi.json");
    let paths = document["paths"].as_object().unwrap();
    for (path, methods) in paths {
        for method in methods.as_object().unwrap().keys() {
            let path = path.replace("{name}", "none.mcap");
            let (status, answer) = wait_until("an answer", || {
                Some(match method.as_str() {
                    // A stream has no end: its head is enough.
                    "get" if path.starts_with("/api/") || path.starts_with("/ws/") => head(&server.address, &path),
                    "get" => ask(&server, "GET", &path, ""),
                    _ => ask(&server, "POST", &path, "Content-Length: 0\r\n"),
                })
            });
            assert!(status != 405 && (status != 404 || answer.contains("no recording")), "{method} {path}: {answer}");
        }
    }
    assert_eq!(ask(&server, "GET", "/none", "").0, 404);
    assert_eq!(ask(&server, "GET", "/api/arm", "").0, 405);
}

/// The status of an answer that may not end.
fn head(address: &str, path: &str) -> (u16, String) {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    stream.write_all(format!("GET {path} HTTP/1.1\r\nHost: {address}\r\n\r\n").as_bytes()).unwrap();
    let mut start = [0; 12];
    stream.read_exact(&mut start).unwrap();
    let start = String::from_utf8_lossy(&start).into_owned();
    (start[9..12].parse().unwrap(), start)
}

#[test]
fn a_rig_serves_its_page_and_the_page_ends_with_it() {
    let rig = Rig::new();
    let film = rig.file("drift.toml", &crate::pipeline::drift(100_000, 100.0));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", film.display());
    let config = rig.config(&camera, &format!("{SERVED}[workers]\ncount = 1"));
    let mut running = Server::start_rig(&config);
    running.wait_for("READY");
    for signal in [15, 9] {
        running.process.signal(signal);
        wait_until("the page is gone", || TcpStream::connect(&running.address).is_err().then_some(()));
        if signal == 15 {
            running = Server::start_rig(&config);
        }
    }
}
