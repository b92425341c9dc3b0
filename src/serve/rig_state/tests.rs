//! Tests of the states.

use super::*;

const SECOND_NS: u64 = 1_000_000_000;

fn state_of(rest: &str) -> PageState {
    let text = format!("[camera]\nsource = \"simulated\"\n[record]\ndirectory = \"shots\"\n{rest}");
    let mut state = PageState::new(Arc::new(Config::parse(&text, "rig.toml").unwrap()));
    state.is_running = true;
    state
}

fn event(kind: EventKind, stamp_s: f64) -> Event {
    Event::new(kind, 1, 0, SECOND_NS + (stamp_s * 1e9) as u64, "text")
}

fn camera(stamp_s: f64) -> StatusMessage {
    let (taken, stamp_ns) = ((1e3 * stamp_s) as u64, SECOND_NS + (stamp_s * 1e9) as u64);
    StatusMessage { role: Role::Acquire as u32, taken, stamp_ns, ..StatusMessage::default() }
}

fn recorder(state: u32) -> StatusMessage {
    StatusMessage { role: Role::Record as u32, state, ..StatusMessage::default() }
}

#[test]
fn a_drop_goes_from_starting_to_saved_and_back_to_ready() {
    let mut rig = state_of("[trigger]\nmode = \"motion\"\npre_s = 0.5\npost_s = 0.2\n");
    let mut states = Vec::new();
    let mut note =
        |rig: &PageState, now_s: f64| states.push((rig.state(now_s).state.as_str(), rig.actions().join(" ")));
    note(&rig, 0.0);
    rig.add_event(&event(EventKind::Started, 0.0), || 0, 0.0);
    note(&rig, 0.0);
    rig.add_status(&recorder(1), 0.1);
    rig.add_status(&camera(0.25), 0.1);
    assert!((rig.ring_fraction() - 0.5).abs() < 1e-9);
    note(&rig, 0.1);
    rig.add_status(&camera(0.6), 0.6);
    note(&rig, 0.6);
    rig.add_event(&event(EventKind::Triggered, 0.7), || 0, 0.7);
    note(&rig, 0.7);
    rig.add_status(&camera(1.0), 1.0);
    note(&rig, 1.0);
    rig.add_event(&event(EventKind::Recorded, 0.9), || 17, 1.1);
    note(&rig, 1.1);
    assert_eq!(rig.shot.unwrap().saved.unwrap().number, 17);
    rig.add_status(&camera(7.0), 7.0);
    note(&rig, 7.0);
    rig.add_event(&event(EventKind::Disarmed, 8.0), || 0, 8.0);
    note(&rig, 8.0);
    let expected = [
        ("STARTING", "arm"),
        ("DISARMED", "arm"),
        ("FILLING", "disarm trigger"),
        ("READY", "disarm trigger"),
        ("TRIGGERED", "disarm"),
        ("MEASURING", "disarm"),
        ("SAVED", "disarm trigger"),
        ("READY", "disarm trigger"),
        ("DISARMED", "arm"),
    ];
    assert_eq!(states, expected.map(|(state, actions)| (state, actions.to_owned())));
}

#[test]
fn a_rig_that_does_not_rearm_shows_the_saved_shot_until_it_is_armed() {
    let mut rig = state_of("[trigger]\nmode = \"motion\"\nrearm = false\npre_s = 0\n");
    rig.add_event(&event(EventKind::Started, 0.0), || 0, 0.0);
    rig.add_event(&event(EventKind::Triggered, 0.0), || 0, 0.0);
    rig.add_event(&event(EventKind::Recorded, 0.1), || 3, 1.0);
    rig.add_event(&event(EventKind::Disarmed, 0.1), || 0, 1.001);
    assert_eq!(rig.state(60.0).state, RigState::Saved);
    rig.add_event(&event(EventKind::Armed, 0.1), || 0, 61.0);
    assert_eq!(rig.state(61.0).state, RigState::Ready);
}

#[test]
fn faults_are_named_and_end_by_themselves() {
    let mut rig = state_of("");
    let fault = |rig: &PageState, now_s: f64| {
        let ExplainedState { state, detail } = rig.state(now_s);
        (state == RigState::Fault).then_some(detail)
    };
    rig.add_event(&event(EventKind::Started, 0.0), || 0, 0.0);
    rig.add_status(&camera(0.1), 0.1);
    assert_eq!(fault(&rig, 0.2), None);
    assert_eq!(fault(&rig, 5.0).unwrap(), "the camera process does not report");
    rig.add_event(&event(EventKind::Camera, 0.1), || 0, 0.2);
    assert_eq!(fault(&rig, 0.2).unwrap(), "camera: text");
    rig.add_status(&camera(0.3), 0.3);
    assert_eq!(fault(&rig, 0.3), None);
    rig.add_event(&event(EventKind::Storage, 0.3), || 0, 0.3);
    rig.add_status(&recorder(2), 0.3);
    assert_eq!(fault(&rig, 0.3).unwrap(), "text");
    rig.add_status(&recorder(0), 0.4);
    assert_eq!(fault(&rig, 0.4), None);
    rig.is_running = false;
    assert_eq!(fault(&rig, 0.4).unwrap(), "rig rig is not running");
}

#[test]
fn the_last_collision_is_that_of_the_last_shot_in_its_latest_revision() {
    let mut rig = state_of("[trigger]\nmode = \"software\"\npre_s = 1\npost_s = 1\n");
    let impact = |number, revision, start_s| Impact {
        revision,
        start_s: Some(Estimate { value: start_s, sigma: 0.0 }),
        ..Impact::unknown(0, number, SECOND_NS)
    };
    rig.add_event(&event(EventKind::Started, 0.0), || 0, 0.0);
    rig.add_impact(impact(0, 0, 0.5));
    rig.add_impact(impact(1, 0, 9.5));
    rig.add_impact(impact(1, 1, 9.5));
    assert_eq!(rig.last_impact().map(|impact| (impact.number, impact.revision)), Some((1, 1)));
    rig.add_event(&event(EventKind::Triggered, 1.2), || 0, 1.2);
    assert_eq!(rig.last_impact().map(|impact| impact.number), Some(0));
    rig.add_event(&event(EventKind::Triggered, 5.0), || 0, 5.0);
    assert_eq!(rig.last_impact().map(|impact| impact.number), None);
}
