//! The frames of a shot along its velocities.

use super::api::json_answer;
use super::app::App;
use super::files::not_found;
use super::picture::{LIVE_SIDE_PX, PictureEncoder};
use crate::image::{Frame, FrameMeta};
use crate::recording::{Recording, RecordingError};
use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};
use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::path::Path as FilePath;
use std::sync::Arc;

/// The maximum number of velocities of a body, more than a screen has columns. Of more, every few frames one is left.
const MAX_ROWS: u64 = 2000;

/// Answers with a frame of a recording by its number as a JPEG file, one recording at a time.
pub(super) async fn frame(State(app): State<Arc<App>>, Path((name, number)): Path<(String, u64)>) -> Response {
    let Ok(path) = app.shots.path(&name) else { return not_found() };
    let Ok(_turn) = app.reports.acquire().await else { return not_found() };
    match tokio::task::spawn_blocking(move || read_picture(&path, number)).await {
        Ok(Ok(Some(jpeg))) => {
            let headers = [(header::CONTENT_TYPE, "image/jpeg"), (header::CACHE_CONTROL, "private, max-age=600")];
            (headers, jpeg).into_response()
        }
        Ok(Ok(None)) => (StatusCode::NOT_FOUND, "this recording has no such frame\n").into_response(),
        Ok(Err(error)) => (StatusCode::NOT_FOUND, format!("{error}\n")).into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, format!("{error}\n")).into_response(),
    }
}

/// Answers with the velocities in a recording as JSON, one recording at a time.
pub(super) async fn curves(State(app): State<Arc<App>>, Path(name): Path<String>) -> Response {
    let Ok(path) = app.shots.path(&name) else { return not_found() };
    let Ok(_turn) = app.reports.acquire().await else { return not_found() };
    match tokio::task::spawn_blocking(move || read_curves(&path)).await {
        Ok(Ok(curves)) => json_answer(StatusCode::OK, curves.to_string()),
        Ok(Err(error)) => (StatusCode::NOT_FOUND, format!("{error}\n")).into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, format!("{error}\n")).into_response(),
    }
}

/// Reads the frame of the main camera with this number as a JPEG file; `None` if the recording does not have it.
fn read_picture(path: &FilePath, number: u64) -> Result<Option<Vec<u8>>, RecordingError> {
    let recording = Recording::open(path)?.select_view(None)?;
    let Some((meta, bytes)) = find_frame(&recording, number)? else { return Ok(None) };
    let encoded = PictureEncoder::new(LIVE_SIDE_PX).encode(&Frame { meta, bytes: &bytes });
    Ok(encoded.map(|encoded| encoded.jpeg))
}

/// Finds a frame by its number. Numbers rise, with gaps where frames were lost, so that the place of a frame is at most its
/// number less the first one. From there the search is binary.
fn find_frame(recording: &Recording, number: u64) -> Result<Option<(FrameMeta, Vec<u8>)>, RecordingError> {
    let (mut low, mut high) = (0, recording.frame_count());
    let Some(mut place) = number.checked_sub(recording.first_frame()?.sequence) else { return Ok(None) };
    while low < high {
        place = place.clamp(low, high - 1);
        let mut frames = recording.frames()?;
        frames.skip_frames(place);
        let Some((meta, bytes)) = frames.next().transpose()? else { return Ok(None) };
        match meta.sequence.cmp(&number) {
            Ordering::Equal => return Ok(Some((meta, bytes))),
            Ordering::Less => low = place + 1,
            Ordering::Greater => high = place,
        }
        place = low + (high - low) / 2;
    }
    Ok(None)
}

/// Reads the velocities of the main camera: for each body rows of frame, normal and tangential velocity, m/s. At most
/// [`MAX_ROWS`] per body, at frames that are `row_frames` apart.
fn read_curves(path: &FilePath) -> Result<Value, RecordingError> {
    let recording = Recording::open(path)?.select_view(None)?;
    let (first, last) = (recording.first_frame()?, recording.last_frame()?);
    let row_frames = (last.sequence.saturating_sub(first.sequence) / MAX_ROWS).max(1);
    let mut rows: BTreeMap<u32, Vec<Value>> = BTreeMap::new();
    for row in recording.velocities()? {
        let row = row?;
        if row.frame.is_multiple_of(row_frames) {
            let speeds = row.velocity.as_ref();
            let (vn_m_s, vt_m_s) = (speeds.map(|speeds| speeds.vn_m_s), speeds.map(|speeds| speeds.vt_m_s));
            rows.entry(row.body).or_default().push(json!([row.frame, vn_m_s, vt_m_s]));
        }
    }
    let bodies = rows.into_iter().map(|(body, rows)| json!({ "name": recording.body_name(body), "rows": rows }));
    Ok(json!({
        "first_frame": first.sequence, "last_frame": last.sequence,
        "duration_s": last.stamp_ns.saturating_sub(first.stamp_ns) as f64 / 1e9,
        "row_frames": row_frames, "bodies": bodies.collect::<Vec<_>>(),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lacrosse() -> std::path::PathBuf {
        FilePath::new(env!("CARGO_MANIFEST_DIR")).join("recordings/lacrosse.mcap")
    }

    #[test]
    fn every_frame_is_found_by_its_number_and_no_other() {
        let recording = Recording::open(&lacrosse()).unwrap();
        let stamps: Vec<(u64, u64)> = recording
            .frames()
            .unwrap()
            .map(|frame| frame.unwrap().0)
            .map(|meta| (meta.sequence, meta.stamp_ns))
            .collect();
        for (number, stamp_ns) in &stamps {
            let found = find_frame(&recording, *number).unwrap().unwrap().0;
            assert_eq!((found.sequence, found.stamp_ns), (*number, *stamp_ns));
        }
        let (first, last) = (stamps[0].0, stamps[stamps.len() - 1].0);
        for number in [first.wrapping_sub(1), last + 1, u64::MAX] {
            assert!(find_frame(&recording, number).unwrap().is_none(), "{number}");
        }
        let picture = read_picture(&lacrosse(), first).unwrap().unwrap();
        assert!(image::load_from_memory(&picture).unwrap().width() <= LIVE_SIDE_PX as u32);
    }
}
