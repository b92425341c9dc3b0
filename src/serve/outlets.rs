//! The counts of what the server sends to others unasked: to an MQTT broker, and as UDP datagrams.

use crate::config::Serve;
use serde_json::{Value, json};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// The state of the outlets, which the status of the rig shows.
#[derive(Debug, Default)]
pub(super) struct Outlets {
    /// Whether the MQTT broker is connected.
    is_connected: AtomicBool,
    /// The number of rows that never reached the broker.
    lost: AtomicU64,
    /// The number of datagrams sent.
    datagrams: AtomicU64,
    /// The number of datagrams that the system did not take.
    unsent: AtomicU64,
}

impl Outlets {
    /// Records that the MQTT broker is connected.
    pub(super) fn connect(&self) {
        self.is_connected.store(true, Ordering::Relaxed);
    }

    /// Records that the MQTT broker is away.
    pub(super) fn disconnect(&self) {
        self.is_connected.store(false, Ordering::Relaxed);
    }

    /// Counts rows that will never reach the broker.
    pub(super) fn add_lost(&self, rows: u64) {
        self.lost.fetch_add(rows, Ordering::Relaxed);
    }

    /// Returns the number of rows that never reached the broker.
    #[cfg(test)]
    pub(super) fn lost(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }

    /// Counts a datagram that was sent.
    pub(super) fn add_datagram(&self) {
        self.datagrams.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts a datagram that the system did not take, and returns the number of those before it.
    pub(super) fn add_unsent(&self) -> u64 {
        self.unsent.fetch_add(1, Ordering::Relaxed)
    }

    /// Returns the counts of the datagrams as JSON; null if none are configured.
    pub(super) fn udp_json(&self, serve: &Serve) -> Value {
        match serve.udp {
            None => Value::Null,
            Some(address) => json!({
                "address": address.to_string(),
                "sent": self.datagrams.load(Ordering::Relaxed),
                "unsent": self.unsent.load(Ordering::Relaxed),
            }),
        }
    }

    /// Returns the state of the connection to the MQTT broker as JSON; null if none is configured.
    pub(super) fn mqtt_json(&self, serve: &Serve) -> Value {
        match &serve.mqtt {
            None => Value::Null,
            Some(broker) => json!({
                "broker": broker.to_string(),
                "connected": self.is_connected.load(Ordering::Relaxed),
                "lost": self.lost.load(Ordering::Relaxed),
            }),
        }
    }
}
