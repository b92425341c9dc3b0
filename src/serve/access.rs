//! Access to the server: the token, and the checks of a request.

use axum::http::header::{self, HeaderMap, HeaderName};
use axum::http::{Method, StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use std::hint::black_box;
use std::net::IpAddr;
use std::path::Path;

/// The allowed lengths of a token, characters.
const TOKEN_LENGTHS: std::ops::RangeInclusive<usize> = 16..=256;
/// The name of the cookie that carries the token.
const COOKIE: &str = "ricochet_token";

/// A file that has no usable token.
#[derive(Debug, thiserror::Error)]
#[error("cannot use serve.token_file {path}: {reason}")]
pub struct TokenError {
    path: String,
    reason: String,
}

impl crate::failure::Fatal for TokenError {
    fn exit_code(&self) -> crate::failure::ExitCode {
        crate::failure::ExitCode::Usage
    }
}

/// The secret that requests must carry. It is never printed.
pub(super) struct Token(String);

impl Token {
    /// Reads the token, which is the first line of a file.
    ///
    /// # Errors
    ///
    /// [`TokenError`] when the file cannot be read, or its first line is no token.
    pub(super) fn read(path: &Path) -> Result<Self, TokenError> {
        let fail = |reason: String| TokenError { path: path.display().to_string(), reason };
        let text = std::fs::read_to_string(path).map_err(|error| fail(error.to_string()))?;
        let token = text.lines().next().unwrap_or_default();
        let is_plain = token.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-_.~".contains(&byte));
        if !is_plain || !TOKEN_LENGTHS.contains(&token.len()) {
            let (low, high) = (TOKEN_LENGTHS.start(), TOKEN_LENGTHS.end());
            return Err(fail(format!("its first line must be {low} to {high} of the characters a-z A-Z 0-9 - _ . ~")));
        }
        Ok(Self(token.to_owned()))
    }

    /// Whether a text is the token. The time does not depend on the position of the first difference.
    pub(super) fn matches(&self, text: &str) -> bool {
        let difference = self.0.bytes().zip(text.bytes()).fold(0, |all, (a, b)| all | (a ^ b));
        text.len() == self.0.len() && black_box(difference) == 0
    }

    /// Returns the value of a `Set-Cookie` header, by which a browser sends the token with each later request.
    pub(super) fn cookie(&self) -> String {
        format!("{COOKIE}={}; Path=/; HttpOnly; SameSite=Strict; Max-Age=31536000", self.0)
    }

    /// Whether a request carries the token, as a bearer token or as the cookie that the page was given.
    fn is_in(&self, headers: &HeaderMap) -> bool {
        let text = |name: HeaderName| headers.get_all(name).into_iter().filter_map(|value| value.to_str().ok());
        let bearer = text(header::AUTHORIZATION).filter_map(|text| text.strip_prefix("Bearer "));
        let cookies = text(header::COOKIE).flat_map(|text| text.split(';'));
        let cookie = cookies.filter_map(|cookie| cookie.trim().strip_prefix(COOKIE)?.strip_prefix('='));
        bearer.chain(cookie).any(|text| self.matches(text))
    }
}

/// A request that is refused, with the reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Refusal(StatusCode, &'static str);

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        (self.0, format!("{}\n", self.1)).into_response()
    }
}

/// The head of a request, by which it is accepted or refused.
pub(super) struct RequestHead<'a> {
    pub(super) method: &'a Method,
    pub(super) uri: &'a Uri,
    pub(super) headers: &'a HeaderMap,
}

impl RequestHead<'_> {
    /// Returns the first value of a header; `None` if it is missing or no text.
    fn header(&self, name: HeaderName) -> Option<&str> {
        self.headers.get(name).and_then(|value| value.to_str().ok())
    }

    /// Whether the request has a method other than GET or HEAD, so that it may change something, or asks for an upgrade
    /// to a channel that a page of another site could read.
    fn is_sensitive(&self) -> bool {
        let is_reading = matches!(*self.method, Method::GET | Method::HEAD);
        !is_reading || self.headers.contains_key(header::UPGRADE)
    }

    /// Checks that a request with an `Origin` header, as browsers send it, comes from our own page at this host.
    ///
    /// # Errors
    ///
    /// A refusal if it comes from another one.
    fn check_origin(&self, host: &str) -> Result<(), Refusal> {
        let refusal = Err(Refusal(StatusCode::FORBIDDEN, "refused: the request comes from the page of another site"));
        let Some(origin) = self.headers.get(header::ORIGIN) else { return Ok(()) };
        let authority = origin.to_str().ok().and_then(|origin| origin.split_once("://")).map(|(_, rest)| rest);
        if authority == Some(host) { Ok(()) } else { refusal }
    }

    /// Returns the host and port that the client has addressed: the `Host` header, or else those in the address.
    ///
    /// # Errors
    ///
    /// A refusal if the request has neither.
    fn host(&self) -> Result<&str, Refusal> {
        let host = self.header(header::HOST).or(self.uri.authority().map(axum::http::uri::Authority::as_str));
        host.ok_or(Refusal(StatusCode::BAD_REQUEST, "refused: the request has no Host header"))
    }
}

/// Whether an address is a number or `localhost`, and not a name that another site could let point here.
fn is_own_address(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    };
    name == "localhost" || name.trim_matches(['[', ']']).parse::<IpAddr>().is_ok()
}

/// Checks that a request carries the token, and that a sensitive one does not come from the page of another site.
/// Without a token, the addressed host must be a number or `localhost`.
///
/// # Errors
///
/// The status and the reason of a refusal.
pub(super) fn check(token: Option<&Token>, head: &RequestHead<'_>) -> Result<(), Refusal> {
    let host = head.host()?;
    match token {
        None if !is_own_address(host) => {
            return Err(Refusal(StatusCode::FORBIDDEN, "refused: use the number of the address, or localhost"));
        }
        Some(token) if !token.is_in(head.headers) => {
            let cure = "refused: send the token as `Authorization: Bearer TOKEN`, or open /?token=TOKEN in a browser";
            return Err(Refusal(StatusCode::UNAUTHORIZED, cure));
        }
        _ => {}
    }
    if head.is_sensitive() { head.check_origin(host) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;

    const TOKEN: &str = "0123456789abcdef";

    fn asked(method: &Method, headers: &[(&'static str, &str)], token: Option<&Token>) -> u16 {
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            map.append(*name, HeaderValue::from_str(value).unwrap());
        }
        let asked = RequestHead { method, uri: &Uri::from_static("/api/status"), headers: &map };
        check(token, &asked).map_or_else(|refusal| refusal.0.as_u16(), |()| 200)
    }

    #[test]
    fn a_foreign_page_can_neither_command_nor_listen() {
        let host = ("host", "127.0.0.1:8080");
        let upgrade = ("upgrade", "websocket");
        let (own, foreign) = (("origin", "http://127.0.0.1:8080"), ("origin", "http://evil.example"));
        let get = |headers: &[(&'static str, &str)]| asked(&Method::GET, headers, None);
        let post = |headers: &[(&'static str, &str)]| asked(&Method::POST, headers, None);
        assert_eq!((post(&[host]), post(&[host, own]), post(&[host, foreign])), (200, 200, 403));
        assert_eq!((get(&[host, upgrade, own]), get(&[host, upgrade, foreign])), (200, 403));
        assert_eq!(post(&[host, ("origin", "null")]), 403);
        assert_eq!(post(&[host, ("origin", "http://127.0.0.1:8081")]), 403);
        // A name of the attacker that points to this computer.
        assert_eq!(get(&[("host", "evil.example:8080")]), 403);
        assert_eq!(post(&[("host", "evil.example"), ("origin", "http://evil.example")]), 403);
        for name in ["localhost", "localhost:8080", "[::1]:8080", "192.168.0.7", "[::1]"] {
            assert_eq!(get(&[("host", name)]), 200, "{name}");
        }
        assert_eq!(get(&[]), 400);
    }

    #[test]
    fn with_a_token_every_request_must_carry_it() {
        let token = Token(TOKEN.into());
        let host = ("host", "rig.lab:8080");
        let get = |headers: &[(&'static str, &str)]| asked(&Method::GET, headers, Some(&token));
        assert_eq!(get(&[host]), 401);
        for wrong in ["Bearer 0123456789abcdeg", "Bearer 0123456789abcde", "Bearer ", "0123456789abcdef", "Basic x"] {
            assert_eq!(get(&[host, ("authorization", wrong)]), 401, "{wrong}");
        }
        assert_eq!(get(&[host, ("authorization", "Bearer 0123456789abcdef")]), 200);
        assert_eq!(get(&[host, ("cookie", "a=b; ricochet_token=0123456789abcdef")]), 200);
        assert_eq!(get(&[host, ("cookie", "ricochet_token=0123456789abcdefg")]), 401);
        let foreign = [host, ("cookie", "ricochet_token=0123456789abcdef"), ("origin", "http://evil.example")];
        assert_eq!(asked(&Method::POST, &foreign, Some(&token)), 403);
    }

    #[test]
    fn a_token_has_a_file_of_its_own_and_a_minimum_length() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("token");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            Token::read(&path).map(|token| token.0).map_err(|error| error.reason)
        };
        assert_eq!(read("0123456789abcdef\nnotes\n").unwrap(), TOKEN);
        assert!(read("short\n").unwrap_err().contains("16 to 256"));
        assert!(read("0123456789abc def\n").is_err());
    }
}
