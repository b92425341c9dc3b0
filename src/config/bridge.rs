//! `[bridge]`: the topics for other hosts.

use super::check::Table;
use super::error::ConfigError;
use super::raw::RawBridge;

/// The word for no bridge.
const OFF: &str = "off";
/// The endings of a file of Zenoh's configuration.
const FILE_ENDINGS: [&str; 2] = [".json5", ".json"];
/// The allowed values of the place.
const ALLOWED: &str = "\"off\", an endpoint such as \"tcp/127.0.0.1:7447\", or a path that ends in .json5";

/// `[bridge]`: the topics for other hosts.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Bridge {
    /// The Zenoh endpoint to listen at, or the path of a file of Zenoh's configuration; `None` without a bridge.
    pub zenoh: Option<String>,
    /// Whether other hosts may arm, disarm and trigger the rig, default false.
    pub control: bool,
}

/// Checks the place of the bridge.
pub(super) fn check_bridge(table: &Table<'_>, raw: RawBridge) -> Result<Bridge, ConfigError> {
    let zenoh = raw.zenoh.filter(|place| place != OFF);
    let is_file = |place: &str| FILE_ENDINGS.iter().any(|ending| place.ends_with(ending));
    // Zenoh itself checks the address, whose form depends on the protocol.
    let is_endpoint = |place: &str| {
        let parts = place.split_once('/');
        parts.is_some_and(|(protocol, address)| !protocol.is_empty() && address.contains(':'))
            && !place.chars().any(char::is_control)
    };
    if zenoh.as_deref().is_some_and(|place| !is_file(place) && !is_endpoint(place)) {
        return Err(table.refuse("zenoh", ALLOWED));
    }
    Ok(Bridge { zenoh, control: raw.control.unwrap_or(false) })
}
