//! `[serve]`: the operator's page and the streams.

use super::check::Table;
use super::error::ConfigError;
use super::raw::RawServe;
use std::fmt;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr};
use std::path::PathBuf;

/// The port of the page without a `[serve]` table.
const HTTP_PORT: u16 = 8080;
/// The word that serves nothing.
const OFF: &str = "off";

/// The allowed values of the address of an MQTT broker.
const MQTT_ALLOWED: &str = "\"off\", or the host and the port of a broker, such as \"broker.local:1883\"";
/// The allowed values of the address for datagrams.
const UDP_ALLOWED: &str = "\"off\", or an address and a port, such as \"192.168.1.20:5005\"";
/// The maximum length of the name of a host, characters (RFC 1035).
const MAX_HOST_LENGTH: usize = 253;
/// The allowed values of the address for Foxglove viewers.
const FOXGLOVE_ALLOWED: &str = "\"off\", or an address of this computer and a port, such as \"127.0.0.1:8765\"";

/// An MQTT broker, and the way in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Broker {
    /// The name or address of its host. An IPv6 address is in brackets.
    pub host: String,
    /// The port.
    pub port: u16,
    /// The name of the user; `None` if the broker asks for none.
    pub user: Option<String>,
    /// The file whose first line is the password of the user; only with a user.
    pub password_file: Option<PathBuf>,
    /// The file with the certificates that the broker's one is checked against. `None`: the connection is not encrypted.
    pub ca_file: Option<PathBuf>,
}

impl Broker {
    /// Reads `HOST:PORT`; `None` if it is something else.
    fn parse(text: &str) -> Option<Self> {
        let (host, port) = text.rsplit_once(':')?;
        let bare = host.strip_prefix('[').and_then(|host| host.strip_suffix(']'));
        let is_host = match bare {
            Some(address) => address.parse::<Ipv6Addr>().is_ok(),
            None => host.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-._".contains(&byte)),
        };
        let port = port.parse().ok().filter(|port| *port > 0)?;
        let is_sized = (1..=MAX_HOST_LENGTH).contains(&host.len());
        let host = host.to_owned();
        (is_host && is_sized).then_some(Self { host, port, user: None, password_file: None, ca_file: None })
    }
}

impl fmt::Display for Broker {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}:{}", self.host, self.port)
    }
}

/// `[serve]`: the operator's page and the streams of topics.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Serve {
    /// The address of page and streams, `ADDRESS:PORT` with a number as address, default `127.0.0.1:8080`. Port 0 takes a
    /// free one. `"off"` serves nothing, and is `None` here.
    pub http: Option<SocketAddr>,
    /// The address for Foxglove viewers, of this computer; `None` serves none.
    pub foxglove: Option<SocketAddr>,
    /// The MQTT broker that the topics are published at; `None` without one.
    pub mqtt: Option<Broker>,
    /// The address that velocities are sent to as datagrams; `None` without one.
    pub udp: Option<SocketAddr>,
    /// The file whose first line is the token that every request must carry, 16 to 256 printable characters without
    /// blanks. Required for an address that other computers reach. The token has a file of its own because the rig file is
    /// attached to every recording.
    pub token_file: Option<PathBuf>,
}

/// Checks the addresses. A page that other computers reach needs a token, and Foxglove viewers only a local address.
pub(super) fn check_serve(table: &Table<'_>, raw: Option<RawServe>) -> Result<Serve, ConfigError> {
    let mut raw = raw.unwrap_or_default();
    let http = match raw.http.as_deref() {
        None => Some(SocketAddr::from((Ipv4Addr::LOCALHOST, HTTP_PORT))),
        Some(OFF) => None,
        Some(address) => {
            let allowed = "\"off\", or an address and a port, such as \"127.0.0.1:8080\"";
            Some(address.parse().map_err(|_| table.refuse("http", allowed))?)
        }
    };
    let foxglove = match raw.foxglove.as_deref() {
        None | Some(OFF) => None,
        Some(address) => {
            // The protocol has no token, so no other computer may reach it.
            let address = address.parse().ok().filter(|address: &SocketAddr| address.ip().is_loopback());
            Some(address.ok_or_else(|| table.refuse("foxglove", FOXGLOVE_ALLOWED))?)
        }
    };
    let mqtt = check_broker(table, &mut raw)?;
    let udp = match raw.udp.as_deref() {
        None | Some(OFF) => None,
        Some(text) => {
            let address = text.parse().ok().filter(|address: &SocketAddr| address.port() > 0);
            Some(address.ok_or_else(|| table.refuse("udp", UDP_ALLOWED))?)
        }
    };
    // The process of the page sends all of them.
    for (key, is_used) in [("foxglove", foxglove.is_some()), ("mqtt", mqtt.is_some()), ("udp", udp.is_some())] {
        if is_used && http.is_none() {
            return Err(table.refuse(key, "\"off\" or left out, because serve.http is \"off\""));
        }
    }
    let token_file = table.single_line("token_file", raw.token_file)?.map(PathBuf::from);
    if token_file.is_none() && http.is_some_and(|address| !address.ip().is_loopback()) {
        let allowed = "the path of a file with a token, because other computers reach serve.http";
        return Err(table.refuse("token_file", allowed));
    }
    Ok(Serve { http, foxglove, mqtt, udp, token_file })
}

/// Checks the MQTT broker; without one, no key of it is accepted. A password needs a user.
fn check_broker(table: &Table<'_>, raw: &mut RawServe) -> Result<Option<Broker>, ConfigError> {
    let user = table.single_line("mqtt_user", raw.mqtt_user.take())?;
    let password_file = table.single_line("mqtt_password_file", raw.mqtt_password_file.take())?.map(PathBuf::from);
    let ca_file = table.single_line("mqtt_ca_file", raw.mqtt_ca_file.take())?.map(PathBuf::from);
    let broker = match raw.mqtt.as_deref() {
        None | Some(OFF) => {
            let given = [
                ("mqtt_user", user.is_some()),
                ("mqtt_password_file", password_file.is_some()),
                ("mqtt_ca_file", ca_file.is_some()),
            ];
            let first = given.iter().find(|(_, is_given)| *is_given);
            return first.map_or(Ok(None), |(key, _)| Err(table.refuse(key, "left out without serve.mqtt")));
        }
        Some(text) => Broker::parse(text).ok_or_else(|| table.refuse("mqtt", MQTT_ALLOWED))?,
    };
    if password_file.is_some() && user.is_none() {
        return Err(table.refuse("mqtt_password_file", "left out without serve.mqtt_user"));
    }
    Ok(Some(Broker { user, password_file, ca_file, ..broker }))
}
