//! `ricochet cameras`: lists the available cameras and their features.

use crate::camera::genicam::{CameraDetails, CameraListing, describe, features, list};
use crate::camera::{CameraError, FeatureKind, FeatureLine, v4l2};
use crate::console::{Outcome, print_line};
use crate::failure::Failure;
use serde_json::{Value, json};

/// The options of `ricochet cameras`.
#[derive(Debug, Clone, PartialEq, Eq, Default, clap::Args)]
pub struct CamerasOptions {
    /// List the features of the camera with this address, name or device file.
    #[arg(long, value_name = "ID")]
    pub features: Option<String>,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// Prints the available cameras, or the features of one.
///
/// Without the GenICam library the V4L2 cameras are still listed.
///
/// # Errors
///
/// [`CameraError`] when there is no camera and the GenICam library is missing, or the selected camera does not reply.
pub fn run(options: &CamerasOptions) -> Result<Outcome, Failure> {
    if let Some(id) = &options.features {
        print_features(id, options)?;
        return Ok(Outcome::Clean);
    }
    let kernel_cameras = v4l2::list();
    let genicam = match list() {
        Ok(cameras) => cameras,
        Err(error) if kernel_cameras.is_empty() => return Err(error.into()),
        Err(error) => {
            log::warn!("cannot list GenICam cameras: {error}");
            Vec::new()
        }
    };
    let genicam: Vec<_> = genicam.into_iter().map(|camera| (describe(&camera), camera)).collect();
    if options.json {
        let cameras = genicam.iter().map(|(details, camera)| camera_as_json(camera, details));
        let cameras: Vec<_> = cameras.chain(kernel_cameras.iter().map(kernel_camera_as_json)).collect();
        print_line(&json!({ "cameras": cameras }).to_string());
    } else if genicam.is_empty() && kernel_cameras.is_empty() {
        print_line("no camera found on any network interface or USB port, and no V4L2 device");
    } else {
        genicam.iter().for_each(|(details, camera)| print_line(&camera_as_text(camera, details)));
        kernel_cameras.iter().for_each(|camera| print_line(&kernel_camera_as_text(camera)));
    }
    Ok(Outcome::Clean)
}

/// A camera that a rig can use.
pub(super) struct FoundCamera {
    /// The value of `camera.id`.
    pub id: String,
    /// The id with the model.
    pub description: String,
}

/// Finds the cameras that can be used now: GenICam ones, if the library is installed, and the available V4L2 ones.
pub(super) fn find_cameras() -> Vec<FoundCamera> {
    let genicam = list().unwrap_or_default().into_iter().map(|camera| FoundCamera {
        description: format!("{} ({} {}, {})", camera.id, camera.vendor, camera.model, camera.protocol),
        id: camera.id,
    });
    let kernel_cameras = v4l2::list().into_iter().filter(|camera| camera.unavailable.is_none()).map(|camera| {
        let id = camera.path.display().to_string();
        FoundCamera { description: format!("{id} ({})", camera.capability.card), id }
    });
    genicam.chain(kernel_cameras).collect()
}

/// Prints the features of one camera; of a V4L2 camera also its formats, sizes and rates.
fn print_features(id: &str, options: &CamerasOptions) -> Result<(), Failure> {
    let (camera, lines) = match v4l2::is_v4l2_id(id) {
        true => v4l2::features(id).map(|(camera, lines)| (Some(camera), lines))?,
        false => (None, features(id)?),
    };
    if options.json {
        let lines: Vec<Value> = lines.iter().map(feature_as_json).collect();
        let report = match camera {
            None => Value::from(lines),
            Some(camera) => {
                let mut report = kernel_camera_as_json(&camera);
                report["features"] = lines.into();
                report
            }
        };
        print_line(&report.to_string());
        return Ok(());
    }
    camera.iter().for_each(|camera| print_line(&kernel_camera_as_text(camera)));
    lines.iter().for_each(|line| print_line(&feature_as_text(line)));
    Ok(())
}

/// Formats a V4L2 camera as text; the id for the configuration comes first.
fn kernel_camera_as_text(camera: &v4l2::CameraListing) -> String {
    let serial = if camera.serial.is_empty() { "none" } else { &camera.serial };
    let mut lines = vec![
        camera.path.display().to_string(),
        format!("  model    {}, serial number {serial}", camera.capability.card),
    ];
    if let Some(reason) = &camera.unavailable {
        lines.push(format!("  {reason}"));
        return lines.join("\n");
    }
    lines.push(format!("  address  {} (V4L2, driver {})", camera.capability.bus, camera.capability.driver));
    for format in &camera.formats {
        let becomes = format.ring_format.map_or("not supported", |format| format.as_str());
        lines.push(format!("  format   {} ({}), {becomes}", format.code, format.description));
        if format.ring_format.is_some() {
            if let v4l2::Sizes::Range { .. } = format.sizes {
                lines.push(format!("    {} px", format.sizes));
            }
            lines.extend(format.rates.iter().map(|(size, rates)| format!("    {size} px: {rates} Hz")));
        }
    }
    lines.join("\n")
}

/// Returns a V4L2 camera as JSON, with its formats, sizes in px and rates in Hz.
fn kernel_camera_as_json(camera: &v4l2::CameraListing) -> Value {
    let size = |size: &v4l2::FrameSize| json!([size.width_px, size.height_px]);
    let sizes = |sizes: &v4l2::Sizes| match sizes {
        v4l2::Sizes::List(sizes) => sizes.iter().map(size).collect(),
        v4l2::Sizes::Range { min, max, step } => json!({ "least": size(min), "most": size(max), "step": size(step) }),
    };
    let rates = |(frame_size, rates): &(v4l2::FrameSize, v4l2::Rates)| {
        let rates = match rates {
            v4l2::Rates::List(rates) => json!(rates),
            v4l2::Rates::Range(least, most) => json!({ "least": least, "most": most }),
        };
        json!({ "size_px": size(frame_size), "rates_hz": rates })
    };
    let format = |format: &v4l2::FormatListing| {
        json!({
            "code": format.code, "description": format.description,
            "becomes": format.ring_format.map(|format| format.as_str()),
            "sizes_px": sizes(&format.sizes), "modes": format.rates.iter().map(rates).collect::<Vec<_>>(),
        })
    };
    let mut value = json!({
        "id": camera.path.display().to_string(), "vendor": camera.capability.driver, "model": camera.capability.card,
        "serial": camera.serial, "address": camera.capability.bus, "protocol": "V4L2",
        "formats": camera.formats.iter().map(format).collect::<Vec<_>>(),
    });
    if let Some(reason) = &camera.unavailable {
        value["error"] = json!(reason);
    }
    value
}

/// Formats a GenICam camera as text; the id for the configuration comes first.
fn camera_as_text(camera: &CameraListing, details: &Result<CameraDetails, CameraError>) -> String {
    let mut lines = vec![
        camera.id.clone(),
        format!("  model    {} {}, serial number {}", camera.vendor, camera.model, camera.serial),
        format!("  address  {} ({})", camera.address, camera.protocol),
    ];
    match details {
        Ok(details) => {
            let (width_px, height_px) = details.size_px;
            lines.push(format!("  size     {width_px} x {height_px} px"));
            lines.push(format!("  formats  {}", details.formats.join(", ")));
            if let Some(range) = details.rate_hz {
                lines.push(format!("  rates    {:.3} to {:.3} Hz as it is set now", range.min, range.max));
            }
            lines.push(format!("  triggers {}", details.triggers.join(", ")));
            if details.taken {
                lines.push("  another program controls it".into());
            }
        }
        Err(error) => lines.push(format!("  {error}")),
    }
    lines.join("\n")
}

/// Returns a GenICam camera as JSON, with an error in place of its details if it did not reply.
fn camera_as_json(camera: &CameraListing, details: &Result<CameraDetails, CameraError>) -> Value {
    let mut value = json!({
        "id": camera.id, "vendor": camera.vendor, "model": camera.model, "serial": camera.serial,
        "address": camera.address, "protocol": camera.protocol,
    });
    match details {
        Ok(details) => {
            value["size_px"] = json!([details.size_px.0, details.size_px.1]);
            value["formats"] = json!(details.formats);
            value["rate_hz"] = json!(details.rate_hz.map(|range| [range.min, range.max]));
            value["triggers"] = json!(details.triggers);
            value["taken"] = json!(details.taken);
        }
        Err(error) => value["error"] = json!(error.to_string()),
    }
    value
}

/// Formats a feature as one line, indented by its depth.
fn feature_as_text(line: &FeatureLine) -> String {
    let indent = "  ".repeat(line.depth);
    if line.kind == FeatureKind::Category {
        return format!("{indent}{}", line.name);
    }
    let value = match line.value.as_deref() {
        Some("") => " = \"\"".into(),
        Some(value) => format!(" = {value}"),
        None => String::new(),
    };
    let unit = if line.unit.is_empty() { String::new() } else { format!(" {}", line.unit) };
    let allowed = if line.allowed.is_empty() { String::new() } else { format!(": {}", line.allowed) };
    let access = if line.writable { "" } else { ", read only" };
    format!("{indent}{}{value}{unit} ({}{access}{allowed})", line.name, line.kind.as_str())
}

/// Returns a feature as JSON.
fn feature_as_json(line: &FeatureLine) -> Value {
    json!({
        "depth": line.depth, "name": line.name, "type": line.kind.as_str(), "value": line.value,
        "allowed": line.allowed, "unit": line.unit, "writable": line.writable,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(kind: FeatureKind, value: Option<&str>, allowed: &str, writable: bool) -> FeatureLine {
        let value = value.map(str::to_owned);
        FeatureLine {
            depth: 1,
            name: "Width".into(),
            kind,
            value,
            allowed: allowed.into(),
            unit: "px".into(),
            writable,
        }
    }

    #[test]
    fn a_feature_is_one_line_with_value_unit_type_and_range() {
        let wide = line(FeatureKind::Integer, Some("512"), "16 to 2048 in steps of 16", true);
        assert_eq!(feature_as_text(&wide), "  Width = 512 px (integer: 16 to 2048 in steps of 16)");
        assert_eq!(feature_as_text(&line(FeatureKind::Category, None, "", false)), "  Width");
        assert_eq!(
            feature_as_text(&line(FeatureKind::Integer, Some("5"), "", false)),
            "  Width = 5 px (integer, read only)"
        );
    }

    #[test]
    fn a_camera_that_does_not_answer_is_still_listed_with_the_reason() {
        let text = |word: &str| word.to_owned();
        let camera = CameraListing {
            id: text("Maker-1"),
            vendor: text("Maker"),
            model: text("Fast"),
            serial: text("1"),
            address: text("10.0.0.1"),
            protocol: text("GigEVision"),
        };
        let gone = Err(CameraError::NotFound { id: text("10.0.0.1"), reason: text("silence") });
        assert!(camera_as_text(&camera, &gone).ends_with("  cannot open camera \"10.0.0.1\": silence"));
        assert_eq!(camera_as_json(&camera, &gone)["error"], "cannot open camera \"10.0.0.1\": silence");
    }

    const VGA: v4l2::FrameSize = v4l2::FrameSize { width_px: 640, height_px: 480 };

    fn webcam() -> v4l2::CameraListing {
        let rates = vec![(VGA, v4l2::Rates::List(vec![30.0, 15.0]))];
        let format = |code: &str, ring_format, rates| v4l2::FormatListing {
            code: code.into(),
            description: "words".into(),
            ring_format,
            sizes: v4l2::Sizes::List(vec![VGA]),
            rates,
        };
        let capability = v4l2::Capability {
            driver: "uvcvideo".into(),
            card: "Webcam".into(),
            bus: "usb-1".into(),
            ..v4l2::Capability::default()
        };
        let formats =
            vec![format("YUYV", Some(crate::image::PixelFormat::Mono8), rates), format("H264", None, Vec::new())];
        v4l2::CameraListing {
            path: "/dev/video0".into(),
            capability,
            serial: String::new(),
            formats,
            unavailable: None,
        }
    }

    #[test]
    fn a_camera_of_the_kernel_is_listed_with_the_conversion_of_each_format() {
        assert_eq!(
            kernel_camera_as_text(&webcam()),
            "/dev/video0\n  model    Webcam, serial number none\n  address  usb-1 (V4L2, driver uvcvideo)\n  \
             format   YUYV (words), Mono8\n    640x480 px: 30, 15 Hz\n  format   H264 (words), not supported"
        );
        let json = kernel_camera_as_json(&webcam());
        assert_eq!(json["formats"][0]["modes"][0], json!({ "size_px": [640, 480], "rates_hz": [30.0, 15.0] }));
        assert_eq!(json.get("error"), None);
    }

    #[test]
    fn a_camera_of_the_kernel_that_may_not_be_opened_is_listed_with_the_reason() {
        let closed = v4l2::CameraListing { unavailable: Some("Permission denied".into()), ..webcam() };
        let text = kernel_camera_as_text(&closed);
        assert_eq!(text, "/dev/video0\n  model    Webcam, serial number none\n  Permission denied");
        assert_eq!(kernel_camera_as_json(&closed)["error"], "Permission denied");
    }
}
