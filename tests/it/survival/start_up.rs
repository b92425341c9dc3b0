//! Supervisors that are killed, and processes that are killed before they have begun.

use super::{armed, children, no_orphan_after_3_s, record_a_drop, running, start, trigger};
use crate::recording::recover::xorshift;
use crate::support::{Rig, complaints, kill, wait_until};
use std::collections::BTreeSet;
use std::time::Duration;

#[test]
fn a_rig_that_is_started_right_after_its_supervisor_was_killed_records_the_next_drop() {
    let rig = Rig::new();
    let config = armed(&rig);
    for round in 0..3 {
        let service = start(&config);
        running(&rig, 40 + 20 * round);
        service.signal(9);
        let next = start(&config);
        running(&rig, 40);
        record_a_drop(&rig);
        next.signal(2);
        let (code, _, stderr) = next.end();
        assert_eq!((code, complaints(&stderr)), (Some(0), vec![]), "round {round}");
        assert!(children(&rig).is_empty());
    }
}

#[test]
fn a_supervisor_killed_while_it_starts_leaves_no_process() {
    supervisors_killed_while_starting(5);
}

#[test]
#[ignore = "30 starts"]
fn thirty_supervisors_killed_while_they_start_leave_no_process() {
    supervisors_killed_while_starting(30);
}

fn supervisors_killed_while_starting(rounds: u64) {
    let rig = Rig::new();
    let config = armed(&rig);
    for round in 0..rounds {
        let service = start(&config);
        std::thread::sleep(Duration::from_millis(7 + 400 * round / rounds));
        service.signal(9);
        drop(service);
        no_orphan_after_3_s(&rig);
    }
    let service = start(&config);
    running(&rig, 40);
    record_a_drop(&rig);
    service.signal(15);
    assert_eq!(service.end().0, Some(0));
}

#[test]
#[ignore = "30 rigs"]
fn thirty_supervisors_killed_at_random_moments_leave_no_process_and_the_next_drop_is_recorded() {
    let rig = Rig::new();
    let config = armed(&rig);
    let mut random = xorshift(0x5eed_0000_0000_0001);
    let mut service = start(&config);
    for round in 0..30 {
        // Some die in start-up, some while they film, some in a shot.
        std::thread::sleep(Duration::from_millis(random(2500) as u64));
        if random(2) == 0 && trigger(&rig).status.success() {
            std::thread::sleep(Duration::from_millis(random(900) as u64));
        }
        service.signal(9);
        drop(service);
        no_orphan_after_3_s(&rig);
        service = start(&config);
        if round % 3 == 2 {
            running(&rig, 40);
            record_a_drop(&rig);
        }
    }
    running(&rig, 40);
    record_a_drop(&rig);
    service.signal(2);
    let (code, _, stderr) = service.end();
    assert_eq!((code, complaints(&stderr)), (Some(0), vec![]));
    assert!(children(&rig).is_empty());
}

#[test]
fn a_process_killed_before_it_has_read_its_configuration_is_replaced() {
    let rig = Rig::new();
    let config = armed(&rig);
    let service = start(&config);
    // The first five processes at the moment when they appear: most are still the copy of their supervisor.
    let (mut killed, own) = (BTreeSet::new(), service.0.id());
    wait_until("the first processes are killed", || {
        let list = std::fs::read_to_string(format!("/proc/{own}/task/{own}/children")).ok()?;
        for pid in list.split_whitespace().map(|pid| pid.parse().unwrap()) {
            if killed.len() < 4 && killed.insert(pid) {
                kill(pid, 9);
            }
        }
        (killed.len() == 4).then_some(())
    });
    running(&rig, 40);
    record_a_drop(&rig);
    service.signal(2);
    let (code, _, stderr) = service.end();
    assert_eq!(code, Some(6), "{stderr}");
    assert!(stderr.contains("restart") && !stderr.contains("Broken pipe"), "{stderr}");
    assert!(children(&rig).is_empty());
}
