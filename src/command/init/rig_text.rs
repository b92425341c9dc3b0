//! The rig file of the answers, each key with its meaning as a comment.

use super::Answers;
use crate::config::{BodyKind, Entry, Source, find};
use crate::console::wrapped;
use std::fmt::Write;

/// The size of a proposed patch as a part of the image.
const PATCH_PART: f64 = 0.5;
/// The size of an image of unknown size, px.
const SIZE_PX: [u32; 2] = [512, 512];

/// Returns the text of a rig file with the answers; keys with their defaults are left out.
pub(super) fn rig_text(answers: &Answers) -> String {
    let mut text = String::from(
        "# A rig file, written by `ricochet init`. Keys that are not here have their defaults:\n#\n\
         #     ricochet config explain\n",
    );
    write_camera(&mut text, answers);
    write_scale(&mut text, answers);
    text += "\n[surface]\n";
    write_key(&mut text, "surface.angle_deg", &float(answers.surface_deg));
    write_body(&mut text, answers);
    write_record(&mut text, answers);
    text
}

/// Writes the `[camera]` table.
fn write_camera(text: &mut String, answers: &Answers) {
    *text += "\n[camera]\n";
    write_key(text, "camera.source", &quoted(answers.source.as_str()));
    if let Some(id) = &answers.id {
        write_key(text, "camera.id", &quoted(id));
    }
    if let Some([width, height]) = answers.size_px {
        let _ = write!(text, "width_px = {width}\nheight_px = {height}\n");
    }
    if let Some(rate_hz) = answers.frame_rate_hz {
        write_key(text, "camera.frame_rate_hz", &float(rate_hz));
    }
    if answers.source == Source::Simulated {
        write_key(text, "camera.scenario", &quoted("lacrosse"));
    }
}

/// Writes the `[scale]` table, with a comment where the scale is unknown.
fn write_scale(text: &mut String, answers: &Answers) {
    *text += "\n[scale]\n";
    match (answers.body, answers.diameter_mm, answers.mm_per_px) {
        (BodyKind::Ball, Some(mm), _) => write_key(text, "scale.ball_diameter_mm", &float(mm)),
        (_, _, Some(mm_per_px)) => write_key(text, "scale.mm_per_px", &float(mm_per_px)),
        (BodyKind::Ball, ..) => *text += "# Unknown, so results are in pixels only.\n# ball_diameter_mm = \n",
        _ => *text += "# Unknown, so results are in pixels only.\n# mm_per_px = \n",
    }
}

/// Writes the `[[body]]` table; that of a patch has a rectangle in the middle of the image.
fn write_body(text: &mut String, answers: &Answers) {
    *text += "\n[[body]]\n";
    write_key(text, "body.kind", &quoted(answers.body.as_str()));
    if answers.body == BodyKind::Patch {
        let [width, height] = answers.size_px.unwrap_or(SIZE_PX).map(f64::from);
        let ends = |side: f64| [(0.5 - 0.5 * PATCH_PART) * side, (0.5 + 0.5 * PATCH_PART) * side].map(f64::round);
        let ([left, right], [top, bottom]) = (ends(width), ends(height));
        let corners = format!("[[{left}, {top}], [{right}, {top}], [{right}, {bottom}], [{left}, {bottom}]]");
        *text += "# The middle of the image. Change it to the body:\n";
        write_key(text, "body.polygon_px", &corners);
    }
}

/// Writes the `[record]` table if anything is recorded, and for a device the `[trigger]` table.
fn write_record(text: &mut String, answers: &Answers) {
    let Some(directory) = &answers.directory else { return };
    *text += "\n[record]\n";
    write_key(text, "record.directory", &quoted(directory));
    if answers.source.is_device() {
        *text += "\n[trigger]\n";
        write_key(text, "trigger.mode", &quoted("software"));
        write_key(text, "trigger.pre_s", "0.05");
        write_key(text, "trigger.post_s", "0.1");
    }
}

/// Writes a key below its meaning and its range as a comment; nothing for a path that is not in the reference.
fn write_key(text: &mut String, path: &str, value: &str) {
    if let Ok(Entry::Key(_, key)) = find(path) {
        let comment = wrapped(&format!("{} Must be {}.", key.meaning(), key.allowed), 2);
        comment.lines().for_each(|line| *text += &format!("#{}\n", &line[1..]));
        let _ = writeln!(text, "{} = {value}", key.name);
    }
}

/// Returns a text as TOML.
fn quoted(text: &str) -> String {
    toml::Value::from(text).to_string()
}

/// Returns a number as TOML.
fn float(x: f64) -> String {
    toml::Value::from(x).to_string()
}
