//! Rigs that other hosts read and control by Zenoh.

use crate::pipeline_faults::drifting;
use crate::support::{Background, Listener, Rig, process, ricochet, run, status, succeed, wait_until};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

mod router;

/// Returns an endpoint of this host that is free.
fn free_endpoint() -> String {
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    format!("tcp/127.0.0.1:{port}")
}

/// Writes the file of a rig that films until it is stopped and waits for triggers, with a bridge at `endpoint`.
fn bridged(rig: &Rig, rate_hz: u32, endpoint: &str, control: bool) -> PathBuf {
    let rest = format!(
        "[trigger]\nmode = \"software\"\npre_s = 0.1\npost_s = 0.1\n[workers]\ncount = 1\n\
         [bridge]\nzenoh = \"{endpoint}\"\ncontrol = {control}\n"
    );
    drifting(rig, &format!("endless = true\nframe_rate_hz = {rate_hz}.0"), &rest)
}

/// The rows of `listen --json` by their frames.
fn by_frame(printed: &str) -> BTreeMap<u64, Value> {
    let rows = printed.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    rows.map(|row| (row["frame"].as_u64().unwrap(), row)).collect()
}

/// Starts a rig and its bridge, and waits until other hosts see it.
fn start(rig: &Rig, config: &Path, endpoint: &str) -> [Background; 2] {
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    let bridge = Background::start(ricochet(["bridge".as_ref(), config.as_os_str()]));
    wait_until("the rig is seen", || {
        run(["status", "--rig", &rig.name, "--via", endpoint]).status.success().then_some(())
    });
    [service, bridge]
}

#[test]
fn rows_state_and_control_of_a_rig_reach_another_host() {
    let (rig, endpoint) = (Rig::new(), free_endpoint());
    let config = bridged(&rig, 200, &endpoint, true);
    let [service, bridge] = start(&rig, &config, &endpoint);
    let listen = |via: &[&str]| {
        let line = ["listen", "velocity", "--rig", &rig.name, "--json", "--count", "300"];
        Background::start(ricochet(line.iter().chain(via).copied()))
    };
    let (near, far) = (listen(&[]), listen(&["--via", &endpoint]));
    let ((near_code, near, _), (far_code, far, complaint)) = (near.end(), far.end());
    assert_eq!((near_code, far_code), (Some(0), Some(0)), "{complaint}");
    let (near, far) = (by_frame(&near), by_frame(&far));
    let common = near.iter().filter(|(frame, row)| far.get(frame) == Some(row)).count();
    assert!(common > 150, "{common} rows are the same at both");
    assert!(far.keys().zip(far.keys().skip(2)).all(|(a, b)| b - a == 2), "no row between is missing");

    let status: Value =
        serde_json::from_str(&succeed(["status", "--rig", &rig.name, "--via", &endpoint, "--json"])).unwrap();
    assert!(status["processes"].as_array().unwrap().len() >= 4, "{status}");
    succeed(["disarm", "--rig", &rig.name, "--via", &endpoint]);
    let refused = run(["trigger", "--rig", &rig.name, "--via", &endpoint]);
    assert_eq!(refused.status.code(), Some(2), "{refused:?}");
    succeed(["arm", "--rig", &rig.name, "--via", &endpoint]);
    let recorded = succeed(["trigger", "--rig", &rig.name, "--via", &endpoint, "--wait"]);
    assert!(Path::new(recorded.trim()).exists(), "{recorded}");
    // A late reader gets the events before it came.
    let events = succeed(["listen", "events", "--rig", &rig.name, "--via", &endpoint, "--json", "--count", "3"]);
    assert!(events.contains("\"kind\":\"prepared\"") || events.contains("\"kind\":"), "{events}");
    bridge.signal(2);
    assert_eq!(bridge.end().0, Some(0));
    service.signal(2);
    assert_eq!(service.end().0, Some(0));
}

#[test]
fn whoever_is_not_reached_or_takes_no_commands_says_so() {
    let (rig, endpoint) = (Rig::new(), free_endpoint());
    let via = |command: &str, name: &str| run([command, "--rig", name, "--via", &endpoint]);
    let silent = via("trigger", &rig.name);
    assert_eq!(silent.status.code(), Some(4), "{silent:?}");
    let config = bridged(&rig, 200, &endpoint, false);
    let _running = start(&rig, &config, &endpoint);
    let unknown = via("status", "another");
    assert_eq!(unknown.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&unknown.stderr).contains("no bridge of rig \"another\" at tcp/"), "{unknown:?}");
    let closed = via("trigger", &rig.name);
    assert_eq!(closed.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&closed.stderr).contains("bridge.control is false"), "{closed:?}");
    let taken = run(["bridge".as_ref(), config.as_os_str()]);
    assert_eq!(taken.status.code(), Some(4), "{taken:?}");
    let plain = rig.config("source = \"simulated\"", "");
    let none = run(["bridge".as_ref(), plain.as_os_str()]);
    assert_eq!(none.status.code(), Some(2), "{none:?}");
}

#[test]
fn rows_that_a_killed_bridge_takes_along_are_counted() {
    let (rig, endpoint) = (Rig::new(), free_endpoint());
    let config = bridged(&rig, 200, &endpoint, false);
    let [service, bridge] = start(&rig, &config, &endpoint);
    let far = Listener::run(ricochet(["listen", "velocity", "--rig", &rig.name, "--json", "--via", &endpoint]));
    wait_until("rows arrive", || (far.rows() > 50).then_some(()));
    drop(bridge);
    let given = || process(&status(&rig.name)?, "track", 0)?["given"].as_u64();
    let (away, before) = (wait_until("the rig answers", given), far.rows());
    // Longer than the newest rows of the rig last, which the next bridge begins with.
    wait_until("the rig goes on", || (given()? > away + 100).then_some(()));
    let successor = Background::start(ricochet(["bridge".as_ref(), config.as_os_str()]));
    wait_until("rows arrive again", || (far.rows() > before + 50).then_some(()));
    service.signal(2);
    let (rows, code, complaint) = far.end_with_complaints();
    let frames: BTreeSet<u64> = rows.iter().filter_map(|(_, row)| row["frame"].as_u64()).collect();
    let (first, last) = (*frames.first().unwrap(), *frames.last().unwrap());
    let missing = last + 1 - first - frames.len() as u64;
    assert!(missing > 50, "{missing} frames came while there was no bridge");
    assert_eq!(code, Some(6), "{complaint}");
    assert!(complaint.contains(&format!("data were lost: {missing}; ")), "{missing}: {complaint}");
    successor.signal(2);
    assert_eq!(successor.end().0, Some(0));
}

/// A network namespace that is connected to this one by a pair of interfaces.
struct OtherHost;

impl OtherHost {
    const NAME: &'static str = "ricochet-far";
    const NEAR: &'static str = "10.219.77.1";

    fn new() -> Self {
        let near = format!("{}/30", Self::NEAR);
        for line in [
            format!("netns add {}", Self::NAME),
            "link add ric-near type veth peer name ric-far".into(),
            format!("link set ric-far netns {}", Self::NAME),
            format!("addr add {near} dev ric-near"),
            "link set ric-near up".into(),
            format!("-n {} addr add 10.219.77.2/30 dev ric-far", Self::NAME),
            format!("-n {} link set ric-far up", Self::NAME),
        ] {
            Self::ip(&line);
        }
        Self
    }

    fn ip(line: &str) {
        assert!(Command::new("ip").args(line.split(' ')).status().unwrap().success(), "ip {line}");
    }

    /// A command that runs there.
    fn run(line: &[&str]) -> Command {
        let mut command = Command::new("ip");
        command.args(["netns", "exec", Self::NAME, env!("CARGO_BIN_EXE_ricochet")]).args(line);
        command
    }
}

impl Drop for OtherHost {
    fn drop(&mut self) {
        // The pair of interfaces goes with it.
        let _ = Command::new("ip").args(["netns", "del", Self::NAME]).status();
    }
}

/// The bodies and frames of the rows of a listener.
fn by_body_and_frame(rows: &[(Instant, Value)]) -> BTreeSet<(u64, String)> {
    rows.iter().filter_map(|(_, row)| Some((row["frame"].as_u64()?, row["body"].to_string()))).collect()
}

/// The frames of the rows of a listener, with the times of their arrival.
fn arrivals(rows: &[(Instant, Value)]) -> BTreeMap<u64, Instant> {
    rows.iter().filter_map(|(at, row)| Some((row["frame"].as_u64()?, *at))).collect()
}

#[test]
#[ignore = "80 s as root: two network namespaces at 1000 rows/s for a minute, then the link is away for 5 s"]
fn a_thousand_rows_per_second_reach_another_host_and_an_outage_loses_none_unseen() {
    let (rig, host) = (Rig::new(), OtherHost::new());
    let endpoint = format!("tcp/{}:7447", OtherHost::NEAR);
    let config = bridged(&rig, 1000, &endpoint, false);
    let [service, bridge] = start(&rig, &config, &endpoint);
    let near = Listener::start("velocity", &rig.name);
    let far = Listener::run(OtherHost::run(&["listen", "velocity", "--rig", &rig.name, "--json", "--via", &endpoint]));
    std::thread::sleep(Duration::from_secs(61));
    let outage = Instant::now();
    OtherHost::ip("link set ric-near down");
    std::thread::sleep(Duration::from_secs(5));
    OtherHost::ip("link set ric-near up");
    std::thread::sleep(Duration::from_secs(12));
    service.signal(2);
    let (near, (far, code)) = (near.end(), far.end_with_code());
    bridge.signal(2);
    let (near, far) = (arrivals(&near), arrivals(&far));
    let (first, last) = (*far.keys().next().unwrap(), *near.keys().last().unwrap());
    let before: Vec<(u64, Instant)> =
        near.range(first..).map(|(frame, at)| (*frame, *at)).filter(|(_, at)| *at < outage).collect();
    let missing = before.iter().filter(|(frame, _)| !far.contains_key(frame)).count();
    let mut delays: Vec<f64> = before
        .iter()
        .filter_map(|(frame, at)| Some((*far.get(frame)?, *at)))
        .map(|(far, near)| {
            1e3 * (far.max(near) - far.min(near)).as_secs_f64().copysign(if far > near { 1.0 } else { -1.0 })
        })
        .collect();
    delays.sort_by(f64::total_cmp);
    let [median, p99] = [0.5, 0.99].map(|share| delays[(share * (delays.len() - 1) as f64) as usize]);
    let lost = near.range(first..).filter(|(frame, _)| !far.contains_key(frame)).count();
    println!(
        "{} rows in a minute, {missing} missing; later than on the rig's host by {median:.2} ms, 99 % {p99:.2} ms; \
         {lost} of {} lost with an outage of 5 s, exit code {code:?}",
        before.len(),
        last - first
    );
    assert!(before.len() > 55_000 && missing == 0, "{missing} of {}", before.len());
    assert!(median < 5.0, "{median} ms");
    assert_eq!(code, Some(if lost == 0 { 0 } else { 6 }));
    assert!(far.keys().last().unwrap() + 100 > last, "rows arrive after the outage");
    drop(host);
}
