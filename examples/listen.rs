//! Prints the velocities of a running rig as they are measured:
//! `cargo run --release --example listen -- RIG`
//!
//! Reading does not slow the rig down. A reader that is too slow loses its oldest messages and notices that in the
//! frame numbers.
#![allow(clippy::print_stdout, reason = "an example that prints")]

use ricochet::bus::{Bus, BusError, Subscriber, Topic};
use ricochet::message::{Event, EventKind, VelocityMessage};
use std::time::Duration;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let rig = std::env::args().nth(1).ok_or("usage: listen RIG")?;
    let bus = Bus::join(&rig, "example")?;
    let velocities = wait_for::<VelocityMessage>(&bus)?;
    let events = wait_for::<Event>(&bus)?;
    let mut over = false;
    while !over {
        // Read before the velocities, so that none published before the end is missed.
        while let Some(event) = events.take()? {
            over = event.kind() == Some(EventKind::Tracked);
        }
        while let Some(message) = velocities.take()? {
            let Some(sample) = message.sample() else { continue };
            if let Some(velocity) = sample.velocity {
                let spin = velocity.omega_rad_s.map_or_else(|| "-".into(), |omega| omega.to_string());
                println!("{} {} {} {spin}", sample.frame, velocity.vn_m_s, velocity.vt_m_s);
            }
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    Ok(())
}

/// Opens a topic once the rig runs.
fn wait_for<T: Topic>(bus: &Bus) -> Result<Subscriber<T>, BusError> {
    loop {
        match bus.listen() {
            Err(BusError::NoRig { .. }) => std::thread::sleep(Duration::from_millis(10)),
            answer => return answer,
        }
    }
}
