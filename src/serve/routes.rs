//! The addresses of the server, in one table from which both the server and its OpenAPI document are built.

use super::app::App;
use super::{api, drawing, files, guard, replay, streams};
use crate::results::{Column, Impact, Kind, Sample, VelocitySample};
use axum::Router;
use axum::http::StatusCode;
use axum::middleware::from_fn_with_state;
use axum::response::Response;
use axum::routing::{MethodRouter, get, post};
use serde_json::{Map, Value, json};
use std::sync::Arc;

/// The content of an answer, for the document.
#[derive(Debug, Clone, Copy)]
enum Answer {
    /// A file of this media type.
    File(&'static str),
    /// Server-sent events, each with an object of this schema.
    Events(&'static str),
    /// A WebSocket whose messages are objects of this schema, or pictures.
    Socket(&'static str),
    /// A JSON object.
    Object,
}

/// A request that the server answers.
struct Route {
    path: &'static str,
    method: &'static str,
    summary: &'static str,
    answer: Answer,
    handler: fn() -> MethodRouter<Arc<App>>,
}

/// Returns a route for GET, which changes nothing.
const fn reading(
    path: &'static str,
    summary: &'static str,
    answer: Answer,
    handler: fn() -> MethodRouter<Arc<App>>,
) -> Route {
    Route { path, method: "get", summary, answer, handler }
}

/// Returns a route for POST, which changes something and answers with a JSON object.
const fn writing(path: &'static str, summary: &'static str, handler: fn() -> MethodRouter<Arc<App>>) -> Route {
    Route { path, method: "post", summary, answer: Answer::Object, handler }
}

/// All addresses of the server.
const TABLE: &[Route] = &[
    reading("/", "The operator's page.", Answer::File("text/html"), || get(api::page)),
    reading("/page.css", "The style of the page.", Answer::File("text/css"), || get(api::style)),
    reading("/page.js", "The script of the page.", Answer::File("text/javascript"), || get(api::script)),
    reading("/picture.js", "The script of the live picture.", Answer::File("text/javascript"), || {
        get(api::overlay_script)
    }),
    reading("/drawing.js", "The script for shapes on the live picture.", Answer::File("text/javascript"), || {
        get(api::drawing_script)
    }),
    reading("/replay.js", "The script for the frames of a shot.", Answer::File("text/javascript"), || {
        get(api::replay_script)
    }),
    reading("/openapi.json", "This document.", Answer::Object, || get(openapi)),
    reading("/api/status", "The state of the rig.", Answer::Object, || get(api::status)),
    reading(
        "/api/state",
        "The state of the rig at every change and four times per second.",
        Answer::Events("state"),
        || get(streams::state_events),
    ),
    reading("/api/velocity", "Velocities from now on.", Answer::Events("velocity"), || get(streams::velocity_events)),
    reading("/api/impact", "Collisions from now on.", Answer::Events("impact"), || get(streams::impact_events)),
    reading("/api/events", "Events from now on.", Answer::Events("events"), || get(streams::event_events)),
    reading("/ws/velocity", "Velocities from now on.", Answer::Socket("velocity"), || get(streams::velocity_socket)),
    reading("/ws/impact", "Collisions from now on.", Answer::Socket("impact"), || get(streams::impact_socket)),
    reading("/ws/events", "Events from now on.", Answer::Socket("events"), || get(streams::event_socket)),
    reading(
        "/ws/picture",
        "Pictures of the present: the length of a JSON header (32 bits, little-endian), the header, a JPEG file.",
        Answer::Socket("state"),
        || get(streams::picture_socket),
    ),
    reading("/api/picture", "A picture of the present.", Answer::File("image/jpeg"), || get(streams::picture)),
    writing("/api/arm", "Arm the rig.", || post(api::arm)),
    writing("/api/disarm", "Disarm the rig.", || post(api::disarm)),
    writing("/api/trigger", "Record a shot around this moment.", || post(api::trigger)),
    writing("/api/control", "Give control to the page of the header x-ricochet-page.", || post(api::take_control)),
    reading("/api/drawing", "The shapes in the rig file, and its revision.", Answer::Object, || get(drawing::shapes)),
    writing(
        "/api/drawing",
        "Write a shape to the rig file of this revision, if the file passes the checks with it.",
        || post(drawing::write_shape),
    ),
    reading("/api/shots", "The shots, the newest first, with mean and spread.", Answer::Object, || get(api::shots)),
    writing("/api/shots/{name}/reject", "Reject a shot; the body is {\"reason\": \"...\"}. Its file stays.", || {
        post(api::reject)
    }),
    writing("/api/shots/{name}/accept", "Accept a rejected shot again.", || post(api::accept)),
    reading("/shots/{name}", "Download a recording.", Answer::File("application/octet-stream"), || {
        get(files::download)
    }),
    reading("/shots/{name}/picture", "A frame in the middle of a recording.", Answer::File("image/jpeg"), || {
        get(files::thumbnail)
    }),
    reading("/shots/{name}/velocity", "Velocities over time in a recording.", Answer::Object, || get(replay::curves)),
    reading(
        "/shots/{name}/frames/{frame}",
        "A frame of a recording by its number.",
        Answer::File("image/jpeg"),
        || get(replay::frame),
    ),
    reading("/shots/{name}/report", "The report of a recording.", Answer::File("text/html"), || get(files::report)),
];

/// Returns the server of all addresses, with its access checks.
pub(super) fn router(app: Arc<App>) -> Router {
    let router = TABLE.iter().fold(Router::new(), |router, route| router.route(route.path, (route.handler)()));
    router.layer(from_fn_with_state(Arc::clone(&app), guard::guard)).with_state(app)
}

/// Answers with the OpenAPI document.
async fn openapi() -> Response {
    api::json_answer(StatusCode::OK, document().to_string())
}

/// Returns the OpenAPI document of all addresses (<https://spec.openapis.org/oas/v3.1.0>).
fn document() -> Value {
    let mut paths: Map<String, Value> = Map::new();
    for route in TABLE {
        paths.entry(route.path).or_insert_with(|| json!({}))[route.method] = operation(route);
    }
    let velocity = [("frame", "integer"), ("body", "string"), ("stamp_ns", "integer"), ("t_s", "number")];
    let impact = [("body", "string"), ("number", "integer"), ("revision", "integer"), ("origin_ns", "integer")];
    let events =
        [("frame", "integer"), ("stamp_ns", "integer"), ("t_s", "number"), ("kind", "string"), ("text", "string")];
    json!({
        "openapi": "3.1.0",
        "info": { "title": "ricochet", "version": env!("CARGO_PKG_VERSION") },
        "paths": paths,
        "components": { "schemas": {
            "velocity": schema(&velocity, VelocitySample::COLUMNS),
            "impact": schema(&impact, &Impact::json_columns()),
            "events": schema::<Impact>(&events, &[]),
            "state": { "type": "object" },
        } },
    })
}

/// Returns the OpenAPI description of one route.
fn operation(route: &Route) -> Value {
    let refer = |schema: &str| json!({ "$ref": format!("#/components/schemas/{schema}") });
    let content = match route.answer {
        Answer::File(media_type) => json!({ media_type: {} }),
        Answer::Events(schema) => json!({ "text/event-stream": { "itemSchema": refer(schema) } }),
        Answer::Socket(schema) => json!({ "application/json": { "schema": refer(schema) } }),
        Answer::Object => json!({ "application/json": { "schema": { "type": "object" } } }),
    };
    let code = if matches!(route.answer, Answer::Socket(_)) { "101" } else { "200" };
    let mut operation = json!({
        "summary": route.summary,
        "responses": { code: { "description": route.summary, "content": content } },
    });
    let kinds = [("name", "string"), ("frame", "integer")];
    let parameters = kinds.iter().filter(|(name, _)| route.path.contains(&format!("{{{name}}}")));
    let parameters: Vec<Value> = parameters
        .map(|(name, kind)| json!({ "name": name, "in": "path", "required": true, "schema": { "type": kind } }))
        .collect();
    if !parameters.is_empty() {
        operation["parameters"] = parameters.into();
    }
    operation
}

/// Returns the JSON schema of a row: the names and types that identify it, then the columns of its table.
fn schema<R>(place: &[(&str, &str)], columns: &[Column<R>]) -> Value {
    let kind = |kind| match kind {
        Kind::Integer | Kind::Stamp => json!({ "type": "integer" }),
        Kind::Double | Kind::Single => json!({ "type": ["number", "null"] }),
        Kind::Text => json!({ "type": "string" }),
    };
    let place = place.iter().map(|(name, kind)| ((*name).to_owned(), json!({ "type": kind })));
    let columns = columns.iter().map(|column| (column.heading.name.to_owned(), kind(column.heading.kind)));
    json!({ "type": "object", "properties": place.chain(columns).collect::<Map<_, _>>() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_document_has_every_address_once_and_the_columns_of_the_tables() {
        let document = document();
        let count: usize = document["paths"].as_object().unwrap().values().map(|p| p.as_object().unwrap().len()).sum();
        assert_eq!(count, TABLE.len());
        let columns = document["components"]["schemas"]["velocity"]["properties"].as_object().unwrap();
        for name in ["frame", "body", "vn_m_s", "sigma_omega_rad_s", "status"] {
            assert!(columns.contains_key(name), "{name}");
        }
    }
}
