//! Calibration files of other programs: OpenCV's storage, ROS' `camera_info`, `foxglove.CameraCalibration`.
//!
//! A general YAML parser refuses OpenCV's files, because of their first line and the tags of their matrices. Only a few
//! named lists of numbers matter in such a file.

use serde_json::Value;

/// The maximum length of a list.
const MAX_NUMBERS: usize = 64;

/// The numbers of a calibration file.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Numbers {
    pub image_px: Option<[u32; 2]>,
    pub camera_matrix: Option<Vec<f64>>,
    pub distortion: Option<Vec<f64>>,
    pub model: Option<String>,
    pub homography_mm: Option<Vec<f64>>,
}

const WIDTH: &[&str] = &["image_width", "image_Width", "width"];
const HEIGHT: &[&str] = &["image_height", "image_Height", "height"];
const MATRIX: &[&str] = &["camera_matrix", "Camera_Matrix", "cameraMatrix", "K", "k"];
const DISTORTION: &[&str] =
    &["distortion_coefficients", "Distortion_Coefficients", "dist_coeffs", "distCoeffs", "D", "d"];
const MODEL: &[&str] = &["distortion_model"];
const HOMOGRAPHY: &[&str] = &["homography_mm", "homography", "H"];

/// Reads the numbers from the text of a file.
///
/// # Errors
///
/// The reason in a few words.
pub(super) fn parse_numbers(text: &str) -> Result<Numbers, String> {
    let found = if text.trim_start().starts_with('{') {
        let value: Value = serde_json::from_str(text).map_err(|error| format!("not JSON: {error}"))?;
        collect_numbers(&value)
    } else {
        collect_numbers(&text)
    }?;
    if found.camera_matrix.is_none() && found.homography_mm.is_none() {
        return Err("it has neither camera_matrix (K) nor homography".to_owned());
    }
    Ok(found)
}

/// A file of named values.
trait Named {
    /// Returns a single number or word; `None` without this name.
    fn scalar(&self, name: &str) -> Option<String>;
    /// Returns at most [`MAX_NUMBERS`] numbers of a list, also one within a matrix; `None` without this name.
    ///
    /// # Errors
    ///
    /// The reason why it is no list of numbers.
    fn list(&self, name: &str) -> Result<Option<Vec<f64>>, String>;
}

/// Collects the numbers under the names that programs use for them.
fn collect_numbers(file: &impl Named) -> Result<Numbers, String> {
    let scalar = |names: &[&str]| names.iter().find_map(|name| file.scalar(name));
    let list = |names: &[&str]| -> Result<Option<Vec<f64>>, String> {
        for name in names {
            if let Some(list) = file.list(name)? {
                return Ok(Some(list));
            }
        }
        Ok(None)
    };
    let size = |names: &[&str]| scalar(names).and_then(|number| number.parse::<u32>().ok());
    Ok(Numbers {
        image_px: size(WIDTH).zip(size(HEIGHT)).map(|(width, height)| [width, height]),
        camera_matrix: list(MATRIX)?,
        distortion: list(DISTORTION)?,
        model: scalar(MODEL).filter(|model| !model.is_empty()),
        homography_mm: list(HOMOGRAPHY)?,
    })
}

impl Named for Value {
    fn scalar(&self, name: &str) -> Option<String> {
        match self.get(name)? {
            Value::String(word) => Some(word.clone()),
            Value::Number(number) => Some(number.to_string()),
            _ => None,
        }
    }

    fn list(&self, name: &str) -> Result<Option<Vec<f64>>, String> {
        let Some(found) = self.get(name) else { return Ok(None) };
        let Some(list) = found.as_array().or_else(|| found.get("data")?.as_array()) else {
            return Err(format!("{name} is not a list of numbers"));
        };
        // A matrix may be a list of rows.
        let flat = list.iter().flat_map(|item| item.as_array().map_or(std::slice::from_ref(item), Vec::as_slice));
        let numbers: Option<Vec<f64>> = flat.take(MAX_NUMBERS).map(Value::as_f64).collect();
        numbers.map(Some).ok_or_else(|| format!("{name} is not a list of numbers"))
    }
}

impl Named for &str {
    fn scalar(&self, name: &str) -> Option<String> {
        let (_, rest) = self.lines().filter_map(|line| line.split_once(':')).find(|(key, _)| *key == name)?;
        Some(rest.split('#').next()?.trim().trim_matches(['"', '\'']).to_owned())
    }

    fn list(&self, name: &str) -> Result<Option<Vec<f64>>, String> {
        // The list continues until a line begins another value.
        let mut lines = self.lines().skip_while(|line| line.split_once(':').is_none_or(|(key, _)| key != name));
        let Some(first) = lines.next() else { return Ok(None) };
        let inner = lines.take_while(|line| line.starts_with([' ', '\t', '-', '[', ']', '}', '#']) || line.is_empty());
        let section: String =
            std::iter::once(first).chain(inner).map(|line| line.split('#').next().unwrap_or("")).collect();
        let section = section.split_once("data:").map_or(section.as_str(), |(_, data)| data);
        let bad = || format!("{name} is not a list of numbers");
        let (_, open) = section.split_once('[').ok_or_else(bad)?;
        let (list, _) = open.split_once(']').ok_or_else(bad)?;
        let items = list.split(',').map(str::trim).filter(|item| !item.is_empty()).take(MAX_NUMBERS);
        items.map(|item| item.parse::<f64>().ok()).collect::<Option<_>>().map(Some).ok_or_else(bad)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opencv_yaml_is_read_with_its_first_line_and_tags() {
        let text = "%YAML:1.0\n---\ncalibration_time: \"Sat\"\nimage_width: 1280\nimage_height: 1024\n\
            camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 1.4e+03, 0., 6.4e+02, 0.,\n       \
            1.41e+03, 5.1e+02, 0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   \
            data: [ -1.5e-01, 2.0e-02, 1.0e-04, -2.0e-04, 0. ]\nhomography: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   \
            data: [ 0.1, 0., -60., 0., 0.1, -50., 0., 1.0e-05, 1. ]\n";
        let found = parse_numbers(text).unwrap();
        assert_eq!(found.image_px, Some([1280, 1024]));
        assert_eq!(found.camera_matrix.unwrap()[..6], [1400.0, 0.0, 640.0, 0.0, 1410.0, 510.0]);
        assert_eq!(found.distortion.unwrap(), [-0.15, 0.02, 1e-4, -2e-4, 0.0]);
        assert_eq!(found.homography_mm.unwrap()[6..], [0.0, 1e-5, 1.0]);
        assert_eq!(found.model, None);
    }

    #[test]
    fn camera_info_of_ros_and_foxglove_is_read() {
        let ros = "image_width: 640\nimage_height: 480\ncamera_name: left\ncamera_matrix:\n  rows: 3\n  cols: 3\n  \
            data: [800, 0, 320, 0, 801, 240, 0, 0, 1]\ndistortion_model: rational_polynomial\n\
            distortion_coefficients:\n  rows: 1\n  cols: 8\n  data: [1, 2, 3, 4, 5, 6, 7, 8]\n";
        let found = parse_numbers(ros).unwrap();
        assert_eq!((found.image_px, found.model.as_deref()), (Some([640, 480]), Some("rational_polynomial")));
        assert_eq!(found.distortion.unwrap().len(), 8);
        let foxglove = r#"{"frame_id":"a","width":640,"height":480,"distortion_model":"plumb_bob",
            "D":[-0.1,0.01,0,0,0],"K":[800,0,320,0,801,240,0,0,1],"R":[],"P":[]}"#;
        let found = parse_numbers(foxglove).unwrap();
        assert_eq!((found.image_px, found.model.as_deref()), (Some([640, 480]), Some("plumb_bob")));
        assert_eq!(found.camera_matrix.unwrap()[3..5], [0.0, 801.0]);
        let opencv = r#"{"image_width": 64, "image_height": 48,
            "camera_matrix": {"type_id": "opencv-matrix", "rows": 3, "cols": 3, "dt": "d", "data": [8.0, 0, 3, 0, 8, 2, 0, 0, 1]}}"#;
        assert_eq!(parse_numbers(opencv).unwrap().camera_matrix.unwrap()[..2], [8.0, 0.0]);
    }

    #[test]
    fn files_without_numbers_are_refused_in_a_few_words() {
        let wrong = [
            ("", "neither"),
            ("image_width: 3\n", "neither"),
            ("camera_matrix: !!opencv-matrix\n  data: [ 1, x ]\n", "camera_matrix is not a list"),
            ("camera_matrix: 3\nother: [1, 2]\n", "camera_matrix is not a list"),
            ("{\"K\": 3}", "K is not a list"),
            ("{\"K\": [", "not JSON"),
            (&"[".repeat(100_000), "neither"),
            (&format!("{{\"K\":{}", "[".repeat(100_000)), "not JSON"),
        ];
        for (text, reason) in wrong {
            let error = parse_numbers(text).unwrap_err();
            assert!(error.contains(reason) && !error.contains('\n'), "{error}");
        }
    }
}
