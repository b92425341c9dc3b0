//! The page of a rig under its supervisor.

use super::{armed, children, no_orphan_after_3_s, record_a_drop, running, start};
use crate::serve::{Server, next_line};
use crate::support::{Background, NO_PAGE, Rig, complaints, kill, process, ricochet, status, succeed, wait_until};
use std::net::TcpListener;
use std::path::{Path, PathBuf};

fn served(rig: &Rig, address: &str) -> PathBuf {
    let text = text(&armed(rig)).replace(NO_PAGE, &format!("[serve]\nhttp = \"{address}\"\n"));
    rig.file("rig.toml", &text)
}

fn page_pid(rig: &Rig) -> Option<u32> {
    u32::try_from(process(&status(&rig.name)?, "serve", 0)?["pid"].as_u64()?).ok()
}

/// An address that is free now.
fn free_address() -> String {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string()
}

#[test]
fn a_page_that_dies_or_hangs_is_replaced_and_the_rig_goes_on() {
    let rig = Rig::new();
    let config = served(&rig, &free_address());
    let server = Server::start_rig(&config);
    server.wait_for("READY");
    for signal in [9, 19] {
        let old = wait_until("the page reports", || page_pid(&rig));
        kill(old, signal);
        wait_until("the page is replaced", || page_pid(&rig).filter(|pid| *pid != old));
        server.wait_for("READY");
    }
    record_a_drop(&rig);
    let before = status(&rig.name).unwrap();
    assert_eq!(process(&before, "run", 0).unwrap()["restarts"], 2);
    server.process.signal(2);
    let (code, _, stderr) = server.process.end();
    assert_eq!(code, Some(0), "a page loses no data: {stderr}");
    assert!(stderr.contains("serve 0 ended with signal: 9") && stderr.contains("serve 0 shows no sign"), "{stderr}");
    assert!(children(&rig).is_empty());
}

#[test]
fn a_rig_whose_address_is_taken_runs_without_its_page() {
    let rig = Rig::new();
    let other = TcpListener::bind("127.0.0.1:0").unwrap();
    let config = served(&rig, &other.local_addr().unwrap().to_string());
    let service = start(&config);
    running(&rig, 40);
    record_a_drop(&rig);
    wait_until("the page gives up", || (children(&rig).len() == 5).then_some(()));
    service.signal(2);
    let (code, _, stderr) = service.end();
    assert_eq!(code, Some(0), "{stderr}");
    let complaints = complaints(&stderr);
    let [warning] = complaints.as_slice() else { panic!("not one line: {stderr}") };
    assert!(warning.starts_with("warning: cannot serve the page at 127.0.0.1:"), "{warning}");
    assert!(warning.ends_with("; the rig runs without it"), "{warning}");
    assert!(stderr.ends_with(&format!("stopped: rig {}, on request\n", rig.name)), "{stderr}");
}

#[test]
fn a_rig_without_a_serve_table_offers_its_page_on_loopback() {
    let rig = Rig::new();
    let config = rig.file("rig.toml", &text(&armed(&rig)).replace(NO_PAGE, ""));
    let mut service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    let stderr = service.0.stderr.as_mut().unwrap();
    let line = wait_until("the page is served or refused", || {
        Some(next_line(stderr)).filter(|line| line.starts_with("page: ") || line.starts_with("warning: "))
    });
    let address = "127.0.0.1:8080";
    if line.starts_with("warning: ") {
        // Another program of this computer has the address.
        assert!(line.starts_with(&format!("warning: cannot serve the page at {address}: ")), "{line}");
        return;
    }
    assert_eq!(line, format!("page: http://{address}/\n"));
    let server = Server { process: service, address: address.to_owned() };
    assert_eq!(server.wait_for("READY")["rig"], rig.name.as_str());
    let path = record_a_drop(&rig).display().to_string();
    server.process.signal(2);
    let (code, stdout, stderr) = server.process.end();
    assert_eq!((code, stdout.trim()), (Some(0), path.as_str()), "standard output has the recordings alone");
    assert!(stderr.contains(&format!("shot 1: {path}")), "{stderr}");
}

#[test]
fn the_page_of_a_dead_run_makes_room_for_that_of_the_next() {
    let rig = Rig::new();
    let config = served(&rig, &free_address());
    let first = Server::start_rig(&config);
    first.wait_for("READY");
    first.process.signal(9);
    let second = Server::start_rig(&config);
    second.wait_for("READY");
    drop(first);
    let pages = || children(&rig).into_iter().filter(|pid| is_page(*pid)).count();
    wait_until("one page is left", || (pages() == 1).then_some(()));
    record_a_drop(&rig);
    let shots = wait_until("the page lists the drop", || {
        Some(second.json("/api/shots")).filter(|shots| !shots["shots"].as_array().is_none_or(Vec::is_empty))
    });
    println!("{shots}");
    second.process.signal(9);
    drop(second);
    no_orphan_after_3_s(&rig);
}

#[test]
fn a_server_of_its_own_follows_one_run_after_the_other() {
    let rig = Rig::new();
    let config = armed(&rig);
    let page = rig.file("page.toml", &text(&config).replace("http = \"off\"", "http = \"127.0.0.1:0\""));
    let server = Server::start(&page);
    for _ in 0..2 {
        let service = start(&config);
        let pid = process(&running(&rig, 40), "run", 0).unwrap()["pid"].clone();
        wait_until("the page shows this run", || {
            let state = server.json("/api/status");
            let of_run = state["processes"].as_array()?.iter().any(|process| process["pid"] == pid);
            (of_run && state["state"] == "READY").then_some(())
        });
        let velocities = succeed(["status", "--rig", rig.name.as_str()]);
        assert!(!velocities.contains("serve"), "it is no process of the rig: {velocities}");
        // Killed, so that the next run begins while processes of this one still end.
        service.signal(9);
        drop(service);
    }
    no_orphan_after_3_s(&rig);
}

fn text(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap()
}

fn is_page(pid: u32) -> bool {
    let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    line.split(|byte| *byte == 0).nth(1) == Some(b"serve")
}
