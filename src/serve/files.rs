//! Recordings and their reports as answers.

use super::app::App;
use super::picture::PictureEncoder;
use crate::image::Frame;
use crate::recording::{Recording, RecordingError};
use crate::report;
use axum::body::{Body, Bytes};
use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use futures_util::stream;
use std::io::Read;
use std::sync::Arc;
use tokio::sync::mpsc::{Sender, channel};

/// The size of the pieces in which a recording is sent, bytes.
const PIECE_BYTES: usize = 256 << 10;
/// The number of pieces that are read ahead.
const PIECES: usize = 2;

/// The maximum side of the picture of a shot, px: twice its size on the page.
const THUMBNAIL_PX: usize = 128;
/// A report carries its own style and its pictures, and nothing that runs.
const REPORT_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'";

/// Returns the answer 404, for a name that no recording of the rig has.
pub(super) fn not_found() -> Response {
    (StatusCode::NOT_FOUND, "no recording of this name\n").into_response()
}

/// Answers with the first file of a recording, in pieces.
pub(super) async fn download(State(app): State<Arc<App>>, Path(name): Path<String>) -> Response {
    let Ok(path) = app.shots.path(&name) else { return not_found() };
    let opened = std::fs::File::open(&path).and_then(|file| Ok((file.metadata()?.len(), file)));
    let Ok((bytes, file)) = opened else { return not_found() };
    let (sender, receiver) = channel(PIECES);
    tokio::task::spawn_blocking(move || send_pieces(file, &sender));
    let body = Body::from_stream(stream::unfold(receiver, |mut receiver| async move {
        receiver.recv().await.map(|piece| (piece, receiver))
    }));
    let headers = [
        (header::CONTENT_TYPE, "application/octet-stream".to_owned()),
        (header::CONTENT_LENGTH, bytes.to_string()),
        // A name that the recorder gave has no quotes.
        (header::CONTENT_DISPOSITION, format!("attachment; filename=\"{}\"", sanitize(&name))),
    ];
    (headers, body).into_response()
}

/// Replaces all characters but letters and digits of ASCII, `-`, `_` and `.` by `_`, so that no header or shell
/// misreads the name.
fn sanitize(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' }).collect()
}

/// Reads a file to its end and sends it in pieces. Stops at an error, which is sent too, or once the client is gone.
fn send_pieces(mut file: std::fs::File, pieces: &Sender<std::io::Result<Bytes>>) {
    loop {
        let mut piece = Vec::with_capacity(PIECE_BYTES);
        let read = file.by_ref().take(PIECE_BYTES as u64).read_to_end(&mut piece);
        let is_last = !matches!(read, Ok(count) if count > 0);
        let item = match read {
            Ok(0) => return,
            Ok(_) => Ok(piece.into()),
            Err(error) => Err(error),
        };
        // A client that is gone takes no more pieces.
        if pieces.blocking_send(item).is_err() || is_last {
            return;
        }
    }
}

/// Answers with the report of a recording, made on request, one report at a time.
pub(super) async fn report(State(app): State<Arc<App>>, Path(name): Path<String>) -> Response {
    let Ok(path) = app.shots.path(&name) else { return not_found() };
    let Ok(_turn) = app.reports.acquire().await else { return not_found() };
    match tokio::task::spawn_blocking(move || build_report(&path)).await {
        Ok(Ok(page)) => {
            let headers =
                [(header::CONTENT_TYPE, "text/html; charset=utf-8"), (header::CONTENT_SECURITY_POLICY, REPORT_POLICY)];
            (headers, page).into_response()
        }
        Ok(Err(error)) => (StatusCode::INTERNAL_SERVER_ERROR, format!("{error}\n")).into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, format!("{error}\n")).into_response(),
    }
}

/// Answers with a frame in the middle of a recording as a JPEG file, one recording at a time.
pub(super) async fn thumbnail(State(app): State<Arc<App>>, Path(name): Path<String>) -> Response {
    let Ok(path) = app.shots.path(&name) else { return not_found() };
    let Ok(_turn) = app.reports.acquire().await else { return not_found() };
    match tokio::task::spawn_blocking(move || read_picture(&path)).await {
        Ok(Some(jpeg)) => {
            ([(header::CONTENT_TYPE, "image/jpeg"), (header::CACHE_CONTROL, "private, max-age=60")], jpeg)
                .into_response()
        }
        Ok(None) | Err(_) => (StatusCode::NOT_FOUND, "this recording has no frame to show\n").into_response(),
    }
}

/// Reads a frame in the middle of a recording's main camera; `None` if it has none that can be read.
fn read_picture(path: &std::path::Path) -> Option<Vec<u8>> {
    let recording = Recording::open(path).ok()?.select_view(None).ok()?;
    let mut frames = recording.frames().ok()?;
    frames.skip_frames(recording.frame_count() / 2);
    let (meta, bytes) = frames.next()?.ok()?;
    let encoder = &mut PictureEncoder::new(THUMBNAIL_PX);
    encoder.encode(&Frame { meta, bytes: &bytes }).map(|encoded| encoded.jpeg)
}

/// Reads the main camera of a recording and returns its report as a page of HTML.
fn build_report(path: &std::path::Path) -> Result<String, RecordingError> {
    let shot = report::Shot::read(&Recording::open(path)?.select_view(None)?)?;
    Ok(report::page(&[shot]))
}
