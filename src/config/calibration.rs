//! `[calibration]`: the camera's lens, and the plane of motion.

mod file;

use super::check::{Bounds, Table};
use super::error::ConfigError;
use super::raw::RawCalibration;
use crate::motion::{Calibration, Distortion, Lens, Rectifier};
use toml_edit::{DocumentMut, TableLike, Value, value};

/// The maximum number of coefficients of the Brown model.
const MAX_COEFFICIENTS: usize = 8;
const FOCAL: Bounds = Bounds::closed(1.0, 1.0e6, "px");

/// A model of lens distortion.
#[derive(Clone, Copy)]
enum Model {
    Brown,
    Equidistant,
}

/// The names of the models in OpenCV, ROS and Foxglove.
const MODELS: [(&str, Model); 5] = [
    ("plumb_bob", Model::Brown),
    ("rational_polynomial", Model::Brown),
    ("equidistant", Model::Equidistant),
    ("fisheye", Model::Equidistant),
    ("kannala_brandt", Model::Equidistant),
];

/// Replaces the calibration files that a rig file names by their numbers, so that its text needs no other file.
///
/// `read` returns the text of a file. `None` when the rig file names none, or is not TOML.
///
/// # Errors
///
/// The key, and the end of a sentence that begins with "must be".
pub(super) fn embed_files(
    text: &str,
    read: impl Fn(&str) -> Result<String, String>,
) -> Option<Result<String, (String, String)>> {
    let mut document = text.parse::<DocumentMut>().ok()?;
    let mut is_changed = false;
    let views = document.get("view").and_then(|views| views.as_table_like());
    let views: Vec<String> = views.into_iter().flat_map(|views| views.iter().map(|(key, _)| key.to_owned())).collect();
    for view in std::iter::once(None).chain(views.iter().map(Some)) {
        let within = match view {
            None => document.get_mut("calibration"),
            Some(view) => document.get_mut("view").and_then(|views| views.get_mut(view)?.get_mut("calibration")),
        };
        match within.and_then(|table| embed_file(table.as_table_like_mut()?, &read)) {
            None => {}
            Some(Ok(())) => is_changed = true,
            Some(Err(reason)) => {
                let key = view.map_or_else(String::new, |view| format!("view.{view}."));
                return Some(Err((format!("{key}calibration.file"), reason)));
            }
        }
    }
    is_changed.then(|| Ok(document.to_string()))
}

/// Replaces the key `file` of a table by the numbers of that file; `None` when it names none.
///
/// Other keys that the table has are kept, and take precedence.
fn embed_file(table: &mut dyn TableLike, read: &impl Fn(&str) -> Result<String, String>) -> Option<Result<(), String>> {
    let name = table.get("file")?.as_str()?.to_owned();
    let numbers = match read(&name).and_then(|content| file::parse_numbers(&content)) {
        Ok(numbers) => numbers,
        Err(reason) => {
            return Some(Err(format!(
                "a camera calibration (OpenCV YAML or JSON, ROS camera_info or foxglove.CameraCalibration): {reason}"
            )));
        }
    };
    table.remove("file");
    let list = |numbers: Vec<f64>| Value::Array(numbers.into_iter().collect());
    let size = |size: [u32; 2]| Value::Array(size.iter().map(|px| i64::from(*px)).collect());
    let values = [
        ("image_px", numbers.image_px.map(size)),
        ("camera_matrix", numbers.camera_matrix.map(list)),
        ("distortion", numbers.distortion.map(list)),
        ("homography_mm", numbers.homography_mm.map(list)),
        ("distortion_model", numbers.model.map(Value::from)),
    ];
    for (key, given) in values {
        if let (Some(given), false) = (given, table.contains_key(key)) {
            table.insert(key, value(given));
        }
    }
    Some(Ok(()))
}

/// Checks a calibration; `offset_px` is the corner of the camera's window, the default for the key of that name.
/// Without both it is [0, 0].
pub(super) fn check_calibration(
    table: &Table<'_>,
    raw: &RawCalibration,
    offset_px: Option<[u32; 2]>,
) -> Result<Rectifier, ConfigError> {
    if raw.file.is_some() {
        return Err(table.refuse("file", "left out here, because only a rig file on disk can name another file"));
    }
    let pair = |key: &str, given: &Option<Vec<i64>>, range: std::ops::RangeInclusive<i64>| {
        let Some(given) = given else { return Ok(None) };
        let numbers: Vec<u32> = given.iter().filter(|px| range.contains(px)).map(|px| *px as u32).collect();
        let allowed = || format!("[x, y], each {} to {} px", range.start(), range.end());
        <[u32; 2]>::try_from(numbers).map(Some).map_err(|_| table.refuse(key, allowed()))
    };
    let image_px = pair("image_px", &raw.image_px, 16..=65_535)?
        .ok_or_else(|| table.refuse("image_px", "[width, height] of the calibrated image in px"))?;
    let offset_px = pair("offset_px", &raw.offset_px, 0..=65_535)?.or(offset_px).unwrap_or_default();
    let lens = check_lens(table, raw)?;
    let homography = match &raw.homography_mm {
        None => None,
        Some(numbers) => Some(matrix_of_rows(numbers).ok_or_else(|| table.refuse("homography_mm", SQUARE))?),
    };
    let calibration = Calibration { image_px, offset_px, lens, homography };
    Rectifier::new(calibration).map_err(|error| {
        let key = if raw.homography_mm.is_some() { "homography_mm" } else { "camera_matrix" };
        table.refuse(key, format!("part of a usable calibration, but this one {error}"))
    })
}

/// The allowed values of a homography.
const SQUARE: &str = "3 x 3 finite numbers, row by row";

/// Returns nine finite numbers as the rows of a 3 x 3 matrix; `None` for others.
fn matrix_of_rows(numbers: &[f64]) -> Option<[[f64; 3]; 3]> {
    let is_square = numbers.len() == 9 && numbers.iter().all(|x| x.is_finite());
    is_square.then(|| std::array::from_fn(|row| std::array::from_fn(|column| numbers[3 * row + column])))
}

/// Checks the camera matrix and the distortion; `None` without a matrix.
///
/// Coefficients are in the order of OpenCV: k1, k2, p1, p2, k3, k4, k5, k6, or k1 to k4 of an equidistant model.
fn check_lens(table: &Table<'_>, raw: &RawCalibration) -> Result<Option<Lens>, ConfigError> {
    let model = table.choice("distortion_model", raw.distortion_model.as_deref(), &MODELS)?.unwrap_or(Model::Brown);
    let Some(numbers) = &raw.camera_matrix else {
        let given = [("distortion", raw.distortion.is_some()), ("distortion_model", raw.distortion_model.is_some())];
        return match given.iter().find(|(_, given)| *given) {
            Some((key, _)) => Err(table.refuse(key, "left out, because there is no camera_matrix")),
            None => Ok(None),
        };
    };
    let matrix = matrix_of_rows(numbers).filter(|[first, second, third]| {
        let is_pinhole = [first[1], second[0], third[0], third[1], third[2] - 1.0].iter().all(|x| x.abs() < 1e-12);
        is_pinhole && FOCAL.contains(first[0]) && FOCAL.contains(second[1])
    });
    let [[fx, _, cx], [_, fy, cy], _] = matrix.ok_or_else(|| {
        table.refuse("camera_matrix", "[fx, 0, cx, 0, fy, cy, 0, 0, 1] with focal lengths of 1 to 1000000 px")
    })?;
    let max = match model {
        Model::Brown => MAX_COEFFICIENTS,
        Model::Equidistant => 4,
    };
    let given = raw.distortion.as_deref().unwrap_or_default();
    // A longer list belongs to another model, unless the rest is 0.
    let (known, rest) = given.split_at(given.len().min(max));
    if rest.iter().any(|x| *x != 0.0) || known.iter().any(|x| !x.is_finite()) {
        let allowed = format!("at most {max} finite numbers; thin prisms and tilted sensors are not supported");
        return Err(table.refuse("distortion", allowed));
    }
    let coefficient = |k: usize| known.get(k).copied().unwrap_or(0.0);
    let distortion = match model {
        Model::Brown => Distortion::Brown(std::array::from_fn(coefficient)),
        Model::Equidistant => Distortion::Equidistant(std::array::from_fn(coefficient)),
    };
    Ok(Some(Lens { focal_px: [fx, fy], center_px: [cx, cy], distortion }))
}
