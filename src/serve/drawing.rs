//! Shapes that are drawn on the live picture and written to the rig file.

use super::api::{check_control, json_answer, read_body, refuse};
use super::app::App;
use super::rig_file::{RigFile, RigFileError};
use crate::config::{Shape, ShapeKey};
use axum::extract::{Request, State};
use axum::http::StatusCode;
use axum::response::Response;
use serde_json::{Value, json};
use std::sync::Arc;

/// The refusal of a rig that runs without a rig file, or whose file is another one by now.
const NO_FILE: &str =
    "this rig has no rig file to write to: it has none, or the file has changed since the rig was started";

/// The words for the kinds of shapes in requests and answers.
mod words {
    pub const TRIGGER_REGION: &str = "trigger-region";
    pub const SEARCH_REGION: &str = "search-region";
    pub const POLYGON: &str = "polygon";
    pub const MASK: &str = "mask";
    pub const NEW_PATCH: &str = "new-patch";
    pub const EDGE: &str = "edge";
}

/// Answers with the shapes in the rig file and those that can be added, and with the revision of the file.
pub(super) async fn shapes(State(app): State<Arc<App>>) -> Response {
    let read = move || app.rig_file.as_ref().map(RigFile::shapes);
    match tokio::task::spawn_blocking(read).await {
        Ok(Some(Ok(drawn))) => {
            let shapes: Vec<Value> = drawn.shapes.iter().map(shape_json).collect();
            json_answer(StatusCode::OK, json!({ "revision": drawn.revision, "shapes": shapes }).to_string())
        }
        Ok(Some(Err(error))) => refuse_drawing(&error),
        Ok(None) => refuse(StatusCode::NOT_FOUND, NO_FILE),
        Err(error) => refuse(StatusCode::INTERNAL_SERVER_ERROR, &error.to_string()),
    }
}

/// Answers `POST /api/drawing`: writes the shape in the request to the rig file.
///
/// Refuses if another page holds control, the file has changed since `revision`, or the file with the shape fails the
/// checks.
pub(super) async fn write_shape(State(app): State<Arc<App>>, request: Request) -> Response {
    let (parts, body) = request.into_parts();
    let body = match read_body(body).await.and_then(|body| check_control(&app, &parts.headers).map(|()| body)) {
        Ok(body) => body,
        Err(refusal) => return *refusal,
    };
    let request_json = serde_json::from_slice::<Value>(&body).ok();
    let Some((revision, shape)) = request_json.as_ref().and_then(parse_request) else {
        let form = "the body is {\"revision\": \"...\", \"shape\": \"trigger-region, search-region, polygon, mask, \
                    new-patch or edge\", \"body\": \"NAME\", \"place\": 0, \"points_px\": [[x, y], ...]}";
        return refuse(StatusCode::BAD_REQUEST, form);
    };
    let frame_px = frame_size(&app);
    let write = move || app.rig_file.as_ref().map(|file| file.write_shape(&revision, &shape, frame_px));
    match tokio::task::spawn_blocking(write).await {
        Ok(Some(Ok(written))) => {
            let answer = format!(
                "{} is written to {}, which passes the checks; the rig uses it from its next start",
                written.path, written.file
            );
            let answer = json!({ "accepted": true, "answer": answer, "revision": written.revision });
            json_answer(StatusCode::OK, answer.to_string())
        }
        Ok(Some(Err(error))) => refuse_drawing(&error),
        Ok(None) => refuse(StatusCode::NOT_FOUND, NO_FILE),
        Err(error) => refuse(StatusCode::INTERNAL_SERVER_ERROR, &error.to_string()),
    }
}

/// Returns width and height of the newest picture's frame, px; `None` before the first one.
fn frame_size(app: &App) -> Option<(u32, u32)> {
    let picture = app.pictures.borrow().clone()?;
    let side = |key: &str| picture.header[key].as_u64().and_then(|side| u32::try_from(side).ok());
    side("width_px").zip(side("height_px"))
}

/// Returns the answer to a shape that is not written.
fn refuse_drawing(error: &RigFileError) -> Response {
    let status = match error {
        RigFileError::Changed { .. } => StatusCode::CONFLICT,
        RigFileError::Drawing(_) => StatusCode::UNPROCESSABLE_ENTITY,
        RigFileError::Io { .. } => StatusCode::INTERNAL_SERVER_ERROR,
    };
    refuse(status, &error.to_string())
}

/// Describes a shape: its kind, the name of its body, the place of a mask in its list, and its points.
fn shape_json(shape: &Shape) -> Value {
    let (word, body, place) = match &shape.key {
        ShapeKey::TriggerRegion => (words::TRIGGER_REGION, None, None),
        ShapeKey::SearchRegion(body) => (words::SEARCH_REGION, Some(body), None),
        ShapeKey::Polygon(body) => (words::POLYGON, Some(body), None),
        ShapeKey::Mask(body, place) => (words::MASK, Some(body), Some(place)),
        ShapeKey::NewPatch(body) => (words::NEW_PATCH, Some(body), None),
        ShapeKey::Edge => (words::EDGE, None, None),
    };
    json!({ "shape": word, "body": body, "place": place, "points_px": shape.points_px })
}

/// Reads a request: the revision of the file that the shape was drawn for, and the shape; `None` if it has another form.
fn parse_request(asked: &Value) -> Option<(String, Shape)> {
    let body = || asked["body"].as_str().map(str::to_owned);
    let place = asked["place"].as_u64().and_then(|place| usize::try_from(place).ok());
    let key = match asked["shape"].as_str()? {
        words::TRIGGER_REGION => ShapeKey::TriggerRegion,
        words::SEARCH_REGION => ShapeKey::SearchRegion(body()?),
        words::POLYGON => ShapeKey::Polygon(body()?),
        words::MASK => ShapeKey::Mask(body()?, place?),
        words::NEW_PATCH => ShapeKey::NewPatch(body()?),
        words::EDGE => ShapeKey::Edge,
        _ => return None,
    };
    let point = |point: &Value| match point.as_array()?.as_slice() {
        [x, y] => Some([x.as_f64()?, y.as_f64()?]),
        _ => None,
    };
    let points_px = asked["points_px"].as_array()?.iter().map(point).collect::<Option<Vec<_>>>()?;
    Some((asked["revision"].as_str()?.to_owned(), Shape { key, points_px }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shape_survives_the_way_to_the_page_and_back() {
        let keys = [
            ShapeKey::TriggerRegion,
            ShapeKey::SearchRegion("a".into()),
            ShapeKey::Polygon("b".into()),
            ShapeKey::Mask("b".into(), 2),
            ShapeKey::NewPatch("c".into()),
            ShapeKey::Edge,
        ];
        for key in keys {
            let shape = Shape { key, points_px: vec![[1.5, 2.0], [3.0, -4.0]] };
            let mut asked = shape_json(&shape);
            assert_eq!(parse_request(&asked), None, "without a revision");
            asked["revision"] = json!("7");
            assert_eq!(parse_request(&asked), Some(("7".to_owned(), shape)));
        }
        for form in [json!({}), json!([1]), json!({ "revision": "7", "shape": "circle", "points_px": [] })] {
            assert_eq!(parse_request(&form), None);
        }
        assert_eq!(parse_request(&json!({ "revision": "7", "shape": "edge", "points_px": [[1, 2, 3]] })), None);
    }
}
