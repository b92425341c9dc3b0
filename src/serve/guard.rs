//! The layer in front of every answer: checks before it, headers for browsers behind it.

use super::access::{Asked, Token, check};
use super::app::App;
use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::header::{self, HeaderMap, HeaderName, HeaderValue};
use axum::http::{Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::sync::Arc;

/// The part of an address that carries the token for the first visit of a browser.
const QUERY: &str = "token=";

/// Returns the token in the address of a first visit.
fn offered<'a>(asked: &Asked<'a>) -> Option<&'a str> {
    let query = asked.uri.query().filter(|_| asked.uri.path() == "/" && *asked.method == Method::GET)?;
    query.split('&').find_map(|part| part.strip_prefix(QUERY))
}

/// Puts the token of a first visit into a cookie, and leads to the page without it in the address.
fn welcome(token: &Token) -> Response {
    let headers = [(header::SET_COOKIE, token.cookie()), (header::LOCATION, "/".to_owned())];
    (StatusCode::SEE_OTHER, headers).into_response()
}

/// Checks every request before it is answered, and completes the headers of the answer.
pub(super) async fn guard(State(app): State<Arc<App>>, request: Request<Body>, next: Next) -> Response {
    let asked = Asked { method: request.method(), uri: request.uri(), headers: request.headers() };
    let token = app.token.as_ref();
    let mut response = match (token, offered(&asked)) {
        (Some(token), Some(text)) if token.is(text) => welcome(token),
        _ => match check(token, &asked) {
            Ok(()) => next.run(request).await,
            Err(refusal) => refusal.into_response(),
        },
    };
    complete(response.headers_mut());
    response
}

/// Headers that keep other sites from framing the page, reading its answers or running code in it.
const HEADERS: [(HeaderName, &str); 7] = [
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; \
         base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    (header::X_FRAME_OPTIONS, "DENY"),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::CACHE_CONTROL, "no-store"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
];

fn complete(headers: &mut HeaderMap) {
    for (name, value) in HEADERS {
        headers.entry(name).or_insert(HeaderValue::from_static(value));
    }
}
