//! Routers of Zenoh between a bridge and its readers, which are killed and started again.

use super::{Background, Rig, bridged, by_body_and_frame, free_endpoint, start};
use crate::support::{Listener, ricochet, status, wait_until};
use serde_json::json;
use std::collections::BTreeSet;
use std::net::TcpStream;
use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;
use zenoh::Wait;

/// The variable with the endpoint of the router that a process of this program is.
const ROUTER: &str = "RICOCHET_ROUTER";
/// The number of rows of a topic that a bridge keeps.
const CACHED_ROWS: usize = 16_384;

#[test]
#[ignore = "a router, which other tests start and kill"]
fn router_until_it_is_killed() {
    let Ok(endpoint) = std::env::var(ROUTER) else { return };
    let mut config = zenoh::Config::default();
    let endpoints = json!([endpoint]).to_string();
    for (name, value) in
        [("mode", "\"router\""), ("listen/endpoints", &endpoints), ("scouting/multicast/enabled", "false")]
    {
        config.insert_json5(name, value).unwrap();
    }
    let _session = zenoh::open(config).wait().unwrap();
    loop {
        std::thread::park();
    }
}

/// A router in a process of its own, killed by SIGKILL when it is dropped.
struct Router(#[expect(dead_code, reason = "its drop kills the process")] Background);

impl Router {
    /// Starts a router, and waits until it takes connections.
    fn start(endpoint: &str) -> Self {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command
            .args(["--exact", "bridge::router::router_until_it_is_killed", "--ignored", "--nocapture"])
            .env(ROUTER, endpoint);
        let router = Background::start(command);
        let address = endpoint.trim_start_matches("tcp/");
        wait_until("the router listens", || TcpStream::connect(address).ok());
        Self(router)
    }

    /// Writes a configuration of Zenoh for whoever connects to a router.
    fn client(rig: &Rig, endpoint: &str) -> PathBuf {
        let config = json!({
            "mode": "client",
            "connect": { "endpoints": [endpoint] },
            "scouting": { "multicast": { "enabled": false } },
        });
        rig.file("client.json5", &config.to_string())
    }
}

/// The rows of a reader whose router was away, compared with those of a reader on the rig's host.
struct Outage {
    /// The number of rows from the first one that the other host has.
    rows: usize,
    /// The number of these rows that the other host does not have.
    missing: usize,
    /// The number of rows that it reported as lost.
    reported: usize,
    /// The number of rows during and after the outage that it has.
    after: usize,
    code: Option<i32>,
}

/// The moment at which the rig is stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stop {
    /// While the router is away.
    Meanwhile,
    /// Once the reader has rows of the time after.
    Afterwards,
}

/// Kills the router between a rig with rows at this rate and a reader, starts it again after a while, and waits until the
/// reader ends with the rig.
fn outage(rate_hz: u32, away: Duration, stop: Stop) -> Outage {
    let (rig, endpoint) = (Rig::new(), free_endpoint());
    let router = Router::start(&endpoint);
    let client = Router::client(&rig, &endpoint);
    let client = client.to_str().unwrap();
    let config = bridged(&rig, rate_hz, client, false);
    let [service, bridge] = start(&rig, &config, client);
    let near = Listener::start("velocity", &rig.name);
    let far = Listener::run(ricochet(["listen", "velocity", "--rig", &rig.name, "--json", "--via", client]));
    wait_until("rows arrive at both", || (near.rows() > 1000 && far.rows() > 1000).then_some(()));
    drop(router);
    std::thread::sleep(Duration::from_millis(200));
    let before = far.rows();
    std::thread::sleep(away);
    if stop == Stop::Meanwhile {
        service.signal(2);
        wait_until("the rig has ended", || status(&rig.name).is_none().then_some(()));
    }
    let _router = Router::start(&endpoint);
    if stop == Stop::Afterwards {
        wait_until("rows arrive again", || (far.rows() > before + 2000).then_some(()));
        service.signal(2);
    }
    let near = near.end();
    let (far, code, complaints) = far.end_with_complaints();
    bridge.signal(2);
    assert_eq!(bridge.end().0, Some(0));
    let after = far.len() - before;
    let (near, far) = (by_body_and_frame(&near), by_body_and_frame(&far));
    let among: BTreeSet<_> = near.range(far.first().unwrap()..).collect();
    let missing = among.iter().filter(|row| !far.contains(**row)).count();
    let reported = complaints.lines().filter_map(|line| line.strip_suffix(" rows were lost on the way"));
    let reported = reported.map(|line| line.rsplit(' ').next().unwrap().parse::<usize>().unwrap()).sum();
    println!(
        "{} rows at {rate_hz} Hz, router away for {away:?}: {missing} missing, {reported} reported, exit code {code:?}",
        among.len()
    );
    Outage { rows: among.len(), missing, reported, after, code }
}

#[test]
fn rows_that_a_reader_missed_while_its_router_was_away_are_fetched() {
    let outage = outage(500, Duration::from_secs(5), Stop::Afterwards);
    assert_eq!((outage.missing, outage.reported, outage.code), (0, 0, Some(0)));
    // The rows of the outage among them.
    assert!(outage.after > 2500, "{} of {} rows after it", outage.after, outage.rows);
}

#[test]
fn a_reader_ends_with_a_rig_that_ended_while_the_router_was_away() {
    let outage = outage(500, Duration::from_secs(3), Stop::Meanwhile);
    assert_eq!((outage.missing, outage.reported, outage.code), (0, 0, Some(0)));
    assert!(outage.after > 1000, "{} rows after it", outage.after);
}

#[test]
fn rows_that_no_cache_has_any_more_are_counted_exactly() {
    let outage = outage(4000, Duration::from_secs(8), Stop::Afterwards);
    assert_eq!((outage.missing, outage.code), (outage.reported, Some(6)));
    assert!(outage.missing > 4000, "{} missing", outage.missing);
    assert!(outage.after > CACHED_ROWS, "{} rows fetched or received, those of the cache among them", outage.after);
}
