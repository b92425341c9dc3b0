//! The bus: delivery, visible losses, and processes that never wait for each other.

use ricochet::bus::{Bus, BusError, Limits};
use ricochet::image::FrameMeta;
use ricochet::message::{Command, Event, EventKind, FrameHeader, Reply, ReplyCode, VelocityMessage};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

static RIGS: AtomicU32 = AtomicU32::new(0);

fn rig_name() -> String {
    format!("test-bus-{}-{}", std::process::id(), RIGS.fetch_add(1, Ordering::Relaxed))
}

const LIMITS: Limits = Limits { workers: 2, fields: 1, ring_frames: 32, held_frames: 16, field_points: 64 };

fn meta(sequence: u64) -> FrameMeta {
    FrameMeta {
        sequence,
        width_px: 16,
        height_px: 4,
        stride_bytes: 16,
        stamp_ns: 1000 * sequence,
        ..FrameMeta::default()
    }
}

#[test]
fn frames_arrive_bit_exact_in_order_and_aligned() {
    let bus = Bus::join(&rig_name(), "test").unwrap();
    let mut ring = bus.frame_publisher(&LIMITS, 64).unwrap();
    let reader = bus.frame_subscriber(&LIMITS).unwrap();
    ring.touch().unwrap();
    ring.update_connections();
    for sequence in 0..20_u64 {
        let mut slot = ring.lend().unwrap().unwrap();
        slot.bytes_mut().iter_mut().enumerate().for_each(|(index, byte)| *byte = (index as u64 * 7 + sequence) as u8);
        ring.send(slot, FrameHeader::new(&meta(sequence), 1, 20.0)).unwrap();
    }
    for sequence in 0..20_u64 {
        let sample = reader.take().unwrap().unwrap();
        assert_eq!(sample.header().meta().unwrap(), meta(sequence));
        assert_eq!(sample.bytes().as_ptr() as usize % 64, 0, "pixels start on a cache line");
        let expected: Vec<u8> = (0..64).map(|index| (index * 7 + sequence) as u8).collect();
        assert_eq!(sample.bytes(), expected);
    }
    assert!(reader.take().unwrap().is_none());
}

#[test]
fn a_sleeping_reader_keeps_the_newest_and_never_stops_the_writer() {
    let bus = Bus::join(&rig_name(), "test").unwrap();
    let mut ring = bus.frame_publisher(&LIMITS, 64).unwrap();
    let reader = bus.frame_subscriber(&LIMITS).unwrap();
    for sequence in 0..1000 {
        let slot = ring.lend().unwrap().unwrap();
        ring.send(slot, FrameHeader::new(&meta(sequence), 1, 20.0)).unwrap();
    }
    let mut seen = Vec::new();
    while let Some(sample) = reader.take().unwrap() {
        seen.push(sample.header().sequence);
    }
    assert_eq!(seen, (1000 - LIMITS.ring_frames as u64..1000).collect::<Vec<_>>());
}

#[test]
fn a_reader_that_holds_every_frame_costs_slots_and_no_time() {
    let bus = Bus::join(&rig_name(), "test").unwrap();
    let mut ring = bus.frame_publisher(&LIMITS, 64).unwrap();
    let reader = bus.frame_subscriber(&LIMITS).unwrap();
    let mut held = Vec::new();
    let mut refused = 0;
    for sequence in 0..1000 {
        match ring.lend().unwrap() {
            Some(slot) => ring.send(slot, FrameHeader::new(&meta(sequence), 1, 20.0)).unwrap(),
            None => refused += 1,
        }
        if held.len() < LIMITS.ring_frames + LIMITS.held_frames - 1 {
            held.extend(reader.take().unwrap());
        }
    }
    let kept: Vec<u64> = held.iter().map(|sample| sample.header().sequence).collect();
    assert_eq!(kept, (0..kept.len() as u64).collect::<Vec<_>>(), "what is held is never overwritten");
    assert_eq!(refused, 0, "the ring is sized for a recorder that holds as much as it may");
}

#[test]
fn a_late_reader_gets_the_newest_events_at_once() {
    let bus = Bus::join(&rig_name(), "test").unwrap();
    let events = bus.publisher::<Event>(&LIMITS).unwrap();
    events.send(&Event::new(EventKind::Prepared, 5, 0, 0, "ready")).unwrap();
    let late = bus.listen::<Event>().unwrap();
    events.update_connections();
    let event = late.take().unwrap().unwrap();
    assert_eq!((event.kind(), event.run_id, event.text()), (Some(EventKind::Prepared), 5, "ready".to_owned()));
}

#[test]
fn a_listener_waits_for_the_rig_that_was_started_again() {
    let name = rig_name();
    let guest = Bus::join(&name, "test").unwrap();
    let first = guest.domain();
    let restarted = Bus::join_as_supervisor(&name, "supervisor", None).unwrap();
    assert_ne!(first, restarted.domain());
    // A process of a rig stays in the domain of its run.
    guest.notification_subscriber("velocity").unwrap();
    assert_eq!(guest.domain(), first);
    guest.listener("velocity").unwrap();
    assert_eq!(guest.domain(), restarted.domain());
}

#[test]
fn a_missing_rig_is_reported() {
    let name = rig_name();
    let bus = Bus::join(&name, "test").unwrap();
    let error = bus.listen::<VelocityMessage>().unwrap_err();
    assert!(matches!(&error, BusError::NoRig { rig, .. } if *rig == name), "{error}");
    assert!(matches!(bus.control_client().unwrap_err(), BusError::NoRig { .. }));
}

#[test]
fn a_request_is_answered_and_an_absent_server_is_noticed() {
    let bus = Bus::join(&rig_name(), "test").unwrap();
    let server = bus.control_server().unwrap();
    let client = bus.control_client().unwrap();
    assert_eq!(client.ask(Command::Status, Duration::from_millis(20)).unwrap(), None);
    let answer = std::thread::scope(|scope| {
        let rig = bus.rig().to_owned();
        let asked = scope.spawn(move || {
            let bus = Bus::join(&rig, "asker").unwrap();
            bus.control_client().unwrap().ask(Command::Trigger, Duration::from_secs(10)).unwrap()
        });
        while !asked.is_finished() {
            if let Some(request) = server.take().unwrap() {
                let is_trigger = request.command() == Some(Command::Trigger);
                let code = if is_trigger { ReplyCode::Busy } else { ReplyCode::Accepted } as u32;
                request.answer(Reply { code, ..Reply::default() });
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        asked.join().unwrap()
    });
    assert_eq!(answer.map(|reply| reply.code), Some(ReplyCode::Busy as u32));
}

#[test]
fn a_ring_larger_than_memory_is_refused_with_both_sizes() {
    let bus = Bus::join(&rig_name(), "test").unwrap();
    let limits = Limits { ring_frames: 1 << 20, ..LIMITS };
    let error = bus.frame_publisher(&limits, 64 << 20).err().unwrap();
    assert!(matches!(error, BusError::Memory { needed_bytes, free_bytes } if needed_bytes > free_bytes), "{error}");
}
