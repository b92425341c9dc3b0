//! Each process, each signal, several moments of a shot.

use super::{armed, children, no_orphan_after_3_s, number, record_a_drop, running, start, trigger};
use crate::support::{Listener, Rig, kill, process, send_signal};
use std::collections::BTreeMap;
use std::time::Duration;

/// Kills, ends, stops each process at several moments: the next drop is recorded and equals its analysis, the exit code shows
/// the death, and nothing is left.
fn matrix(signals: &[i32], delays_ms: &[u64]) {
    for signal in signals {
        for delay_ms in delays_ms {
            for role in ["acquire", "correlate", "correlate-1", "track", "record", "run"] {
                one_cell(role, *signal, *delay_ms);
            }
        }
    }
}

fn one_cell(role: &str, signal: i32, delay_ms: u64) {
    let rig = Rig::new();
    let config = armed(&rig);
    let [velocities, tracks] = ["velocity", "track"].map(|topic| Listener::start(topic, &rig.name));
    let mut service = start(&config);
    let before = running(&rig, 40);
    assert!(trigger(&rig).status.success());
    std::thread::sleep(Duration::from_millis(delay_ms));
    let (name, index) = role.split_once('-').map_or((role, 0), |(name, index)| (name, index.parse().unwrap()));
    let victim = u32::try_from(process(&before, name, index).unwrap()["pid"].as_u64().unwrap()).unwrap();
    kill(victim, signal);
    if signal == 11 {
        // The first one only ends Rust's own handler, which looks for a stack overflow. Two that come before it has run are one.
        while std::fs::read_link(format!("/proc/{victim}/exe")).is_ok() {
            let _ = send_signal(victim, signal);
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    if signal == 19 {
        std::thread::sleep(Duration::from_secs(5));
        kill(victim, 18);
    }
    if role == "run" && signal != 19 {
        let (code, _, stderr) = service.end();
        assert_eq!(code.is_some_and(|code| code == 0), signal == 15, "{role} {signal} {delay_ms}: {stderr}");
        no_orphan_after_3_s(&rig);
        service = start(&config);
    }
    // The time before the next trigger, which its recording includes, is after the death.
    let back = number(&running(&rig, 40), "track", "sequence");
    running(&rig, back + 40);
    record_a_drop(&rig);
    service.signal(2);
    let (code, _, stderr) = service.end();
    let is_death = role != "run" && matches!(signal, 9 | 11);
    println!("{role} {signal} {delay_ms} ms: {code:?} {stderr}");
    // A process that was stopped for long has lost frames.
    let allowed: &[i32] = if is_death {
        &[6]
    } else if signal == 19 {
        &[0, 6]
    } else {
        &[0]
    };
    assert!(code.is_some_and(|code| allowed.contains(&code)), "{role} {signal} {delay_ms}: {code:?} {stderr}");
    assert!(children(&rig).is_empty(), "{role} {signal} {delay_ms}");
    // A second run has numbers of its own.
    if role != "run" || signal == 19 {
        let missing = missing_frames(&measured(velocities), &measured(tracks));
        assert_eq!(missing, reported(&stderr), "{role} {signal} {delay_ms}: {stderr}");
    }
}

/// The published frames, with whether each was measured.
fn measured(listener: Listener) -> BTreeMap<u64, bool> {
    let rows = listener.end().into_iter().map(|(_, row)| (row["frame"].as_u64().unwrap(), row["status"] != "lost"));
    let rows: Vec<_> = rows.collect();
    assert!(rows.len() > 40, "{rows:?}");
    assert!(rows.windows(2).all(|pair| pair[0].0 < pair[1].0), "numbers rise");
    rows.into_iter().collect()
}

/// The number of frames without a velocity or a position. A position comes some frames after its velocity.
fn missing_frames(velocities: &BTreeMap<u64, bool>, tracks: &BTreeMap<u64, bool>) -> u64 {
    let end = velocities.keys().chain(tracks.keys()).max().map_or(0, |last| last + 1);
    let is_measured = |frame: &u64| velocities.get(frame) == Some(&true) && tracks.contains_key(frame);
    end - (0..end).filter(is_measured).count() as u64
}

/// The losses of camera and tracker that a rig reports at its end. The tracker counts those of a camera that goes on again,
/// as the recorder does.
fn reported(stderr: &str) -> u64 {
    let lost = |name: &str| {
        let text = stderr.split(&format!("{name} 0 lost ")).nth(1).unwrap_or_default();
        text.split(|c: char| !c.is_ascii_digit()).next().and_then(|text| text.parse::<u64>().ok()).unwrap_or(0)
    };
    lost("acquire").max(lost("track"))
}

#[test]
fn each_process_may_die_during_a_shot() {
    matrix(&[9], &[150]);
}

#[test]
#[ignore = "120 rigs"]
fn each_process_may_get_any_signal_at_any_moment_of_a_shot() {
    matrix(&[9, 11, 15, 19], &[0, 100, 250, 450, 800]);
}
