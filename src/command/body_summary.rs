//! One line per body: the number of measured frames, and why the others were not.

use crate::config::Config;
use crate::report::{MeasuredBody, Shot};
use crate::results::{BodyKind, FrequentStatus, MeasuredFrames, PointStatus, Reason, VelocitySample};
use serde_json::{Value, json};

/// The measured frames of one body.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct BodySummary {
    name: String,
    counted: MeasuredFrames,
    cause: Option<Cause>,
}

/// The most frequent reason why a body was not measured.
#[derive(Debug, Clone, PartialEq)]
struct Cause {
    frequent: FrequentStatus,
    reason: Reason,
    /// The number of its first frame, counted from the first one of the film.
    first_frame: u64,
    /// The keys that change it, each with its value.
    keys: Vec<Key>,
}

/// A key of the rig file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Key {
    /// The name with its table; `body.` stands for the table of the body.
    pub(super) name: &'static str,
    /// The value, or the default where the rig file leaves it out; `None` where that is unknown.
    pub(super) value: Option<String>,
}

/// The frames of a film.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FilmShape {
    /// The width and the height of the image, px, if known.
    pub(super) size_px: Option<[u32; 2]>,
    /// The sequence number of the first frame, from which frames are counted.
    pub(super) first_frame: u64,
}

/// Counts the velocity rows of each body, and finds the most frequent reason why it was not measured.
pub(super) fn summarize_rows<'a>(
    rows: impl Iterator<Item = &'a VelocitySample> + Clone,
    config: &Config,
    film: &FilmShape,
) -> Vec<BodySummary> {
    let summary = |(index, body): (u32, &crate::config::Body)| {
        let counted = MeasuredFrames::count(rows.clone().filter(|row| row.body == index));
        let cause = counted.reason.and_then(|frequent| {
            let reason = frequent.status.reason(body.kind)?;
            Some(Cause {
                frequent,
                reason,
                first_frame: frequent.frame.saturating_sub(film.first_frame),
                keys: reason
                    .keys
                    .iter()
                    .map(|name| Key { name, value: current_value(name, config, index, film.size_px) })
                    .collect(),
            })
        });
        BodySummary { name: body.name.clone(), counted, cause }
    };
    (0..).zip(&config.bodies).map(summary).collect()
}

/// Returns the line of each body of a shot, and whether it was measured in every frame. Missing frames do not count.
pub(super) fn summarize_shot(shot: &Shot, config: &Config) -> Vec<MeasuredBody> {
    let rows = shot.velocities().iter().filter(|row| !shot.is_missing(row.frame));
    let film = FilmShape { size_px: shot.size_px(), first_frame: shot.first_frame() };
    let body = |summary: &BodySummary| MeasuredBody { line: summary.describe(), is_complete: summary.is_complete() };
    summarize_rows(rows, config, &film).iter().map(body).collect()
}

/// Returns the value that a key has, or its default where the rig file leaves it out; `None` where that is unknown.
///
/// `body` is the index of the body, and `size_px` the width and height of the image, which default radii depend on.
///
/// # Panics
///
/// If there is no body of this index.
pub(super) fn current_value(key: &str, config: &Config, body: u32, size_px: Option<[u32; 2]>) -> Option<String> {
    let index = body as usize;
    let settings = &config.bodies[index];
    let ball = || {
        let [width, height] = size_px.filter(|_| settings.kind == BodyKind::Ball)?;
        Some(config.ball(index, width, height))
    };
    let radius = |radius_px: f64| format!("{radius_px:.1}").trim_end_matches(".0").to_owned();
    match key {
        "body.min_radius_px" => Some(radius(ball()?.min_radius_px)),
        "body.max_radius_px" => Some(radius(ball()?.max_radius_px)),
        "body.roi_px" => Some(settings.roi_px.map_or_else(|| "the whole image".into(), |roi| format!("{roi:?}"))),
        "body.edges" => Some(settings.edges.to_string()),
        "correlation.subset_size_px" => Some(config.correlation().subset_size_px.to_string()),
        "correlation.search_px" => Some(config.correlation().search_px.to_string()),
        "correlation.min_zncc" => Some(config.correlation().min_zncc.to_string()),
        _ => None,
    }
}

impl BodySummary {
    /// Whether the body was measured in no frame.
    pub(super) fn is_empty(&self) -> bool {
        self.counted.measured_frames == 0
    }

    /// Whether the body was measured in every frame.
    pub(super) fn is_complete(&self) -> bool {
        self.cause.is_none()
    }

    /// Returns the most frequent status of the frames in which the body was not measured; `None` if it was in all.
    pub(super) fn frequent_status(&self) -> Option<PointStatus> {
        Some(self.cause.as_ref()?.frequent.status)
    }

    /// Returns the reason behind that status, and the keys that change it with their values; `None` like the status.
    pub(super) fn reason(&self) -> Option<(Reason, &[Key])> {
        self.cause.as_ref().map(|cause| (cause.reason, cause.keys.as_slice()))
    }

    /// Returns the summary as one line.
    pub(super) fn describe(&self) -> String {
        let MeasuredFrames { total_frames, measured_frames, .. } = self.counted;
        let mut line = format!("{}: {measured_frames} of {total_frames} frames measured", self.name);
        if let Some(Cause { frequent, reason, first_frame, keys }) = &self.cause {
            let frames = if frequent.count_frames == 1 { "frame" } else { "frames" };
            line += &format!(
                "; most frequent reason: {} ({} {frames}), first at frame {first_frame}; set ",
                reason.text, frequent.count_frames
            );
            let shown = |key: &Key| match &key.value {
                Some(value) => format!("{} (now {value})", key.name),
                None => key.name.to_owned(),
            };
            line += &keys.iter().map(shown).collect::<Vec<_>>().join(" or ");
        }
        line
    }

    /// Returns the summary as a JSON object.
    pub(super) fn json(&self) -> Value {
        let MeasuredFrames { total_frames, measured_frames, .. } = self.counted;
        let cause = self.cause.as_ref();
        json!({
            "body": self.name,
            "frames": total_frames,
            "measured": measured_frames,
            "status": cause.map(|cause| cause.frequent.status.as_str()),
            "reason": cause.map(|cause| cause.reason.text),
            "reason_frames": cause.map(|cause| cause.frequent.count_frames),
            "first_frame": cause.map(|cause| cause.first_frame),
            "keys": cause.map(|cause| cause.keys.iter().map(|key| key.name).collect::<Vec<_>>()),
            "line": self.describe(),
        })
    }
}
