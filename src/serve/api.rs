//! Answers to single requests: the state, commands to the rig, the list of shots.

use super::app::App;
use super::control::{ask, parse_page_name};
use super::page::page_html;
use super::shots::ShotError;
use crate::bus::BusError;
use crate::message::{Command, Reply, ReplyCode};
use axum::body::{Body, Bytes, HttpBody, to_bytes};
use axum::extract::{Path, Request, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::Duration;

/// The maximum size of the body of a request, bytes.
const MAX_BODY_BYTES: usize = 4096;
/// Time for the body of a request to arrive.
const BODY_TIMEOUT: Duration = Duration::from_secs(5);
/// The header with the name of the page that makes a request.
const PAGE: &str = "x-ricochet-page";

/// Returns an answer with a JSON text as its body.
pub(super) fn json_answer(status: StatusCode, text: impl Into<Body>) -> Response {
    (status, [(header::CONTENT_TYPE, "application/json")], text.into()).into_response()
}

/// Returns the answer to a request that is not carried out, with the reason as a sentence.
pub(super) fn refuse(status: StatusCode, answer: &str) -> Response {
    json_answer(status, json!({ "accepted": false, "answer": answer }).to_string())
}

/// Returns a file of the page, which is part of the program.
fn asset(media_type: &'static str, text: &'static str) -> Response {
    ([(header::CONTENT_TYPE, media_type)], text).into_response()
}

/// Answers with the operator's page.
pub(super) async fn page(State(app): State<Arc<App>>) -> Response {
    ([(header::CONTENT_TYPE, "text/html; charset=utf-8")], page_html(&app.config.rig.name)).into_response()
}

/// Answers with the style of the page.
pub(super) async fn style() -> Response {
    asset("text/css; charset=utf-8", include_str!("page.css"))
}

/// Answers with the script of the page.
pub(super) async fn script() -> Response {
    asset("text/javascript; charset=utf-8", include_str!("page.js"))
}

/// Answers with the script of the live picture.
pub(super) async fn overlay_script() -> Response {
    asset("text/javascript; charset=utf-8", include_str!("picture.js"))
}

/// Answers with the script that draws shapes on the live picture.
pub(super) async fn drawing_script() -> Response {
    asset("text/javascript; charset=utf-8", include_str!("drawing.js"))
}

/// Answers with the script that shows the frames of a shot along its curves.
pub(super) async fn replay_script() -> Response {
    asset("text/javascript; charset=utf-8", include_str!("replay.js"))
}

/// Answers with the state of the rig.
pub(super) async fn status(State(app): State<Arc<App>>) -> Response {
    json_answer(StatusCode::OK, app.state.borrow().json())
}

/// Answers with the shots, their mean and their spread.
pub(super) async fn shots(State(app): State<Arc<App>>) -> Response {
    json_answer(StatusCode::OK, app.shots.as_json().to_string())
}

/// Reads the body of a request: at most [`MAX_BODY_BYTES`], within [`BODY_TIMEOUT`].
///
/// # Errors
///
/// The answer to the client.
pub(super) async fn read_body(body: Body) -> Result<Bytes, Box<Response>> {
    let refusal = |status, reason: &str| Box::new(refuse(status, reason));
    let announced = HttpBody::size_hint(&body).lower();
    if announced > MAX_BODY_BYTES as u64 {
        return Err(refusal(StatusCode::PAYLOAD_TOO_LARGE, "the body has more than 4096 bytes"));
    }
    match tokio::time::timeout(BODY_TIMEOUT, to_bytes(body, MAX_BODY_BYTES)).await {
        Ok(Ok(bytes)) => Ok(bytes),
        Ok(Err(_)) => Err(refusal(StatusCode::PAYLOAD_TOO_LARGE, "the body has more than 4096 bytes, or was cut off")),
        Err(_) => Err(refusal(StatusCode::REQUEST_TIMEOUT, "the body did not come in time")),
    }
}

/// Checks that the page of a request holds control, or takes free control for it. Requests without the name of a page
/// pass.
///
/// # Errors
///
/// The answer to the client, if another page holds control or the name is no page name.
pub(super) fn check_control(app: &App, headers: &HeaderMap) -> Result<(), Box<Response>> {
    let Some(page) = headers.get(PAGE) else { return Ok(()) };
    match page.to_str().ok().and_then(parse_page_name) {
        Some(page) if app.control.take_control_if_free(page) => Ok(()),
        _ => Err(Box::new(refuse(StatusCode::CONFLICT, "another page holds control; take control first"))),
    }
}

/// Sends a command to the rig, if the request may command it, and answers with the reply of the recorder or the reason
/// why there is none. Commands go one at a time.
async fn send_command(app: Arc<App>, request: Request, command: Command) -> Response {
    let (parts, body) = request.into_parts();
    let checked = read_body(body).await.and_then(|_| check_control(&app, &parts.headers));
    if let Err(refusal) = checked {
        return *refusal;
    }
    let Ok(_turn) = app.requests.acquire().await else {
        return refuse(StatusCode::SERVICE_UNAVAILABLE, "the server ends");
    };
    let rig = app.config.rig.name.clone();
    match tokio::task::spawn_blocking(move || ask(&rig, command)).await {
        Ok(Ok(Some(reply))) => reply_answer(&reply),
        Ok(Ok(None)) => refuse(StatusCode::SERVICE_UNAVAILABLE, "no recorder of the rig answers"),
        Ok(Err(error @ BusError::NoRig { .. })) => refuse(StatusCode::SERVICE_UNAVAILABLE, &error.to_string()),
        Ok(Err(error)) => refuse(StatusCode::INTERNAL_SERVER_ERROR, &error.to_string()),
        Err(error) => refuse(StatusCode::INTERNAL_SERVER_ERROR, &error.to_string()),
    }
}

/// Returns the recorder's reply as an answer; its status is 200 if the recorder accepted the command, else 409.
fn reply_answer(reply: &Reply) -> Response {
    let code = ReplyCode::from_number(reply.code).unwrap_or(ReplyCode::Unknown);
    let is_accepted = code == ReplyCode::Accepted;
    let answer = json!({
        "accepted": is_accepted, "answer": code.as_str(), "armed": reply.armed == 1,
        "recordings": reply.recordings, "sequence": reply.sequence,
    });
    json_answer(if is_accepted { StatusCode::OK } else { StatusCode::CONFLICT }, answer.to_string())
}

/// Arms the rig.
pub(super) async fn arm(State(app): State<Arc<App>>, request: Request) -> Response {
    send_command(app, request, Command::Arm).await
}

/// Disarms the rig.
pub(super) async fn disarm(State(app): State<Arc<App>>, request: Request) -> Response {
    send_command(app, request, Command::Disarm).await
}

/// Records a shot around this moment.
pub(super) async fn trigger(State(app): State<Arc<App>>, request: Request) -> Response {
    send_command(app, request, Command::Trigger).await
}

/// Gives control to the page of the request, whichever page holds it.
pub(super) async fn take_control(State(app): State<Arc<App>>, headers: HeaderMap) -> Response {
    match headers.get(PAGE).and_then(|page| page.to_str().ok()).and_then(parse_page_name) {
        Some(page) => {
            app.control.give_control(page);
            json_answer(StatusCode::OK, json!({ "accepted": true, "answer": "this page holds control" }).to_string())
        }
        None => refuse(StatusCode::BAD_REQUEST, "the header x-ricochet-page must have 1 to 32 of a-z 0-9"),
    }
}

/// Returns the outcome of a request about a shot as an answer.
fn shot_answer(done: Result<(), ShotError>) -> Response {
    let status = match &done {
        Ok(()) => return json_answer(StatusCode::OK, json!({ "accepted": true, "answer": "done" }).to_string()),
        Err(ShotError::Unknown) => StatusCode::NOT_FOUND,
        Err(ShotError::Reason) => StatusCode::BAD_REQUEST,
        Err(ShotError::Io(_)) => StatusCode::INTERNAL_SERVER_ERROR,
    };
    refuse(status, &done.err().map(|error| error.to_string()).unwrap_or_default())
}

/// Rejects a shot, if the request may command the rig; the body is `{"reason": "..."}`.
pub(super) async fn reject(State(app): State<Arc<App>>, Path(name): Path<String>, request: Request) -> Response {
    let (parts, body) = request.into_parts();
    let bytes = match read_body(body).await.and_then(|bytes| check_control(&app, &parts.headers).map(|()| bytes)) {
        Ok(bytes) => bytes,
        Err(refusal) => return *refusal,
    };
    let reason = serde_json::from_slice::<Value>(&bytes).ok();
    let reason = reason.as_ref().and_then(|reason| reason["reason"].as_str()).unwrap_or_default();
    shot_answer(app.shots.reject(&name, reason))
}

/// Accepts a rejected shot again, if the request may command the rig.
pub(super) async fn accept(State(app): State<Arc<App>>, Path(name): Path<String>, request: Request) -> Response {
    let (parts, body) = request.into_parts();
    match read_body(body).await.and_then(|_| check_control(&app, &parts.headers)) {
        Ok(()) => shot_answer(app.shots.accept(&name)),
        Err(refusal) => *refusal,
    }
}
