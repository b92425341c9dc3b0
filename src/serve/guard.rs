//! The layer in front of every answer: checks before it, headers for browsers behind it.

use super::access::{RequestHead, Token, check};
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

/// Returns the text after `token=` in the address of a first visit, a GET of `/`; `None` for other requests.
fn token_in_address<'a>(head: &RequestHead<'a>) -> Option<&'a str> {
    let query = head.uri.query().filter(|_| head.uri.path() == "/" && *head.method == Method::GET)?;
    query.split('&').find_map(|part| part.strip_prefix(QUERY))
}

/// Answers a first visit: puts the token into a cookie, and redirects to the page without it in the address.
fn redirect_with_cookie(token: &Token) -> Response {
    let headers = [(header::SET_COOKIE, token.cookie()), (header::LOCATION, "/".to_owned())];
    (StatusCode::SEE_OTHER, headers).into_response()
}

/// Answers a first visit with the cookie, a request that passes the checks with `next`, and any other with its refusal.
/// Completes the headers of each answer.
pub(super) async fn guard(State(app): State<Arc<App>>, request: Request<Body>, next: Next) -> Response {
    let head = RequestHead { method: request.method(), uri: request.uri(), headers: request.headers() };
    let token = app.token.as_ref();
    let mut response = match (token, token_in_address(&head)) {
        (Some(token), Some(text)) if token.matches(text) => redirect_with_cookie(token),
        _ => match check(token, &head) {
            Ok(()) => next.run(request).await,
            Err(refusal) => refusal.into_response(),
        },
    };
    add_security_headers(response.headers_mut());
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

/// Adds those of [`HEADERS`] that an answer does not set itself.
fn add_security_headers(headers: &mut HeaderMap) {
    for (name, value) in HEADERS {
        headers.entry(name).or_insert(HeaderValue::from_static(value));
    }
}
