//! Zenoh sessions and keys.

use super::error::BridgeError;
use std::path::Path;
use zenoh::{Config, Session, Wait};

/// The last part of the key that requests are sent to.
pub(super) const CONTROL: &str = "control";
/// The maximum time to connect to an endpoint, ms.
const CONNECT_MS: u32 = 3000;

/// The side of a connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    /// The host of the rig, which listens at the endpoint.
    Rig,
    /// Another host, which connects to it.
    Remote,
}

/// Returns the key of a topic of a rig.
pub(super) fn key(rig: &str, topic: &str) -> String {
    format!("ricochet/{rig}/{topic}")
}

/// Opens a session at an endpoint, or with a file of Zenoh's configuration (`.json5` or `.json`), which has routers, TLS and
/// users.
///
/// # Errors
///
/// [`BridgeError`] when the endpoint is taken, not reached or no endpoint, or the file cannot be used.
pub(super) fn open(place: &str, side: Side) -> Result<Session, BridgeError> {
    let action = match side {
        Side::Rig => "listen",
        Side::Remote => "connect",
    };
    let config = if is_file(place) { Config::from_file(place) } else { endpoint_config(place, side) };
    let config = config.map_err(|error| BridgeError::new(action, place, &error))?;
    zenoh::open(config).wait().map_err(|error| BridgeError::new(action, place, &error))
}

/// Whether a place is a file of Zenoh's configuration.
fn is_file(place: &str) -> bool {
    Path::new(place).extension().is_some_and(|ending| ending == "json5" || ending == "json")
}

/// Returns the configuration of a session with one endpoint, which asks nobody else in the network.
fn endpoint_config(endpoint: &str, side: Side) -> zenoh::Result<Config> {
    let endpoints = serde_json::json!([endpoint]).to_string();
    let (listen, connect) = match side {
        Side::Rig => (endpoints.as_str(), "[]"),
        Side::Remote => ("[]", endpoints.as_str()),
    };
    let mut config = Config::default();
    for (name, value) in [
        ("mode", "\"peer\""),
        ("listen/endpoints", listen),
        ("connect/endpoints", connect),
        ("connect/timeout_ms", &CONNECT_MS.to_string()),
        ("connect/exit_on_failure", "true"),
        ("scouting/multicast/enabled", "false"),
    ] {
        config.insert_json5(name, value)?;
    }
    Ok(config)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_paths_of_configurations_are_files() {
        assert!(is_file("zenoh.json5") && is_file("/etc/zenoh/a.json"));
        assert!(!is_file("tcp/127.0.0.1:7447") && !is_file("tcp/rig.local:7447"));
    }

    #[test]
    fn an_endpoint_that_is_none_is_refused_and_a_silent_one_after_a_while() {
        let error = open("here", Side::Rig).unwrap_err().to_string();
        assert!(error.starts_with("cannot listen by Zenoh at here: "), "{error}");
        let error = open("tcp/127.0.0.1:1", Side::Remote).unwrap_err().to_string();
        assert!(error.starts_with("cannot connect by Zenoh at tcp/127.0.0.1:1: "), "{error}");
    }
}
