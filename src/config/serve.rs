//! `[serve]`: the operator's page and the streams.

use super::check::Table;
use super::error::ConfigError;
use super::raw::RawServe;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;

/// The port of the page without a `[serve]` table.
const HTTP_PORT: u16 = 8080;
/// The word that serves nothing.
const OFF: &str = "off";

/// The allowed values of the address for Foxglove viewers.
const FOXGLOVE_ALLOWED: &str = "\"off\", or an address of this computer and a port, such as \"127.0.0.1:8765\"";

/// `[serve]`: the operator's page and the streams of topics.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Serve {
    /// The address of page and streams, `ADDRESS:PORT` with a number as address, default `127.0.0.1:8080`. Port 0 takes a
    /// free one. `"off"` serves nothing, and is `None` here.
    pub http: Option<SocketAddr>,
    /// The address for Foxglove viewers, of this computer; `None` serves none.
    pub foxglove: Option<SocketAddr>,
    /// The file whose first line is the token that every request must carry, 16 to 256 printable characters without
    /// blanks. Required for an address that other computers reach. The token has a file of its own because the rig file is
    /// attached to every recording.
    pub token_file: Option<PathBuf>,
}

/// Checks the addresses. A page that other computers reach needs a token, and Foxglove viewers only a local address.
pub(super) fn check_serve(table: &Table<'_>, raw: Option<RawServe>) -> Result<Serve, ConfigError> {
    let raw = raw.unwrap_or_default();
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
    let token_file = table.single_line("token_file", raw.token_file)?.map(PathBuf::from);
    if token_file.is_none() && http.is_some_and(|address| !address.ip().is_loopback()) {
        let allowed = "the path of a file with a token, because other computers reach serve.http";
        return Err(table.refuse("token_file", allowed));
    }
    Ok(Serve { http, foxglove, token_file })
}
