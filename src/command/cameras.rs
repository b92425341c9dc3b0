//! `ricochet cameras`: the cameras in reach and what they can do.

use super::say;
use crate::camera::genicam::{CameraDetails, CameraListing, FeatureLine, Kind, describe, features, list};
use crate::camera::{CameraError, v4l2};
use serde_json::{Value, json};

/// What to tell.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct CamerasOptions {
    /// One JSON document instead of text.
    pub json: bool,
    /// Id, address, serial number or device file of the camera whose features are told instead of the list.
    pub features_of: Option<String>,
}

/// Prints the cameras in reach, or the features of one.
///
/// Without the GenICam library the kernel's cameras are told all the same.
///
/// # Errors
///
/// [`CameraError`] when there is no camera and the GenICam library is missing, or the one meant does not answer.
pub fn run(options: &CamerasOptions) -> anyhow::Result<()> {
    if let Some(id) = &options.features_of {
        let lines = if is_device_file(id) { v4l2::features(id)? } else { features(id)? };
        match options.json {
            true => say(&Value::from(lines.iter().map(feature_as_json).collect::<Vec<_>>()).to_string()),
            false => lines.iter().for_each(|line| say(&feature_as_text(line))),
        }
        return Ok(());
    }
    let kernels = v4l2::list();
    let genicam = match list() {
        Ok(cameras) => cameras,
        Err(error) if kernels.is_empty() => return Err(error.into()),
        Err(error) => {
            log::warn!("GenICam cameras are left out: {error}");
            Vec::new()
        }
    };
    let genicam: Vec<_> = genicam.into_iter().map(|camera| (describe(&camera), camera)).collect();
    if options.json {
        let cameras = genicam.iter().map(|(details, camera)| camera_as_json(camera, details));
        let cameras: Vec<_> = cameras.chain(kernels.iter().map(kernel_camera_as_json)).collect();
        say(&json!({ "cameras": cameras }).to_string());
    } else if genicam.is_empty() && kernels.is_empty() {
        say("no camera answers on any network card or USB port, and the kernel has none");
    } else {
        genicam.iter().for_each(|(details, camera)| say(&camera_as_text(camera, details)));
        kernels.iter().for_each(|camera| say(&kernel_camera_as_text(camera)));
    }
    Ok(())
}

/// Whether this is how a camera of the kernel is called, rather than one on the network.
fn is_device_file(id: &str) -> bool {
    id.starts_with('/') || id.strip_prefix("video").is_some_and(|number| number.parse::<u32>().is_ok())
}

/// A camera of the kernel in a few lines, what to write in a configuration first.
fn kernel_camera_as_text(camera: &v4l2::CameraListing) -> String {
    let serial = if camera.serial.is_empty() { "none" } else { &camera.serial };
    let mut lines = vec![
        camera.path.display().to_string(),
        format!("  model    {}, serial number {serial}", camera.capability.card),
        format!("  address  {} (V4L2, driver {})", camera.capability.bus, camera.capability.driver),
    ];
    for format in &camera.formats {
        let becomes = format.becomes.map_or("cannot be read", |format| format.word());
        lines.push(format!("  format   {} ({}), {becomes}", format.code, format.description));
        if format.becomes.is_some() {
            lines.push(format!("    sizes  {} px", format.sizes));
            lines.push(format!("    rates  {} Hz", format.rates));
        }
    }
    lines.join("\n")
}

fn kernel_camera_as_json(camera: &v4l2::CameraListing) -> Value {
    let sizes = |sizes: &v4l2::Sizes| match sizes {
        v4l2::Sizes::List(sizes) => json!(sizes),
        v4l2::Sizes::Range([least, most, step]) => json!({ "least": least, "most": most, "step": step }),
    };
    let rates = |rates: &v4l2::Rates| match rates {
        v4l2::Rates::List(rates) => json!(rates),
        v4l2::Rates::Range(least, most) => json!({ "least": least, "most": most }),
    };
    let format = |format: &v4l2::FormatOffer| {
        json!({
            "code": format.code, "description": format.description,
            "becomes": format.becomes.map(|format| format.word()),
            "sizes_px": sizes(&format.sizes), "rates_hz": rates(&format.rates),
        })
    };
    json!({
        "id": camera.path.display().to_string(), "vendor": camera.capability.driver, "model": camera.capability.card,
        "serial": camera.serial, "address": camera.capability.bus, "protocol": "V4L2",
        "formats": camera.formats.iter().map(format).collect::<Vec<_>>(),
    })
}

/// A camera in a few lines, what to write in a configuration first.
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
            if let Some((least, most)) = details.rate_hz {
                lines.push(format!("  rates    {least:.3} to {most:.3} Hz as it is set now"));
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

fn camera_as_json(camera: &CameraListing, details: &Result<CameraDetails, CameraError>) -> Value {
    let mut value = json!({
        "id": camera.id, "vendor": camera.vendor, "model": camera.model, "serial": camera.serial,
        "address": camera.address, "protocol": camera.protocol,
    });
    match details {
        Ok(details) => {
            value["size_px"] = json!([details.size_px.0, details.size_px.1]);
            value["formats"] = json!(details.formats);
            value["rate_hz"] = json!(details.rate_hz.map(|(least, most)| [least, most]));
            value["triggers"] = json!(details.triggers);
            value["taken"] = json!(details.taken);
        }
        Err(error) => value["error"] = json!(error.to_string()),
    }
    value
}

/// A feature in a line, indented by its depth.
fn feature_as_text(line: &FeatureLine) -> String {
    let indent = "  ".repeat(line.depth);
    if line.kind == Kind::Category {
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
    format!("{indent}{}{value}{unit} ({}{access}{allowed})", line.name, line.kind.word())
}

fn feature_as_json(line: &FeatureLine) -> Value {
    json!({
        "depth": line.depth, "name": line.name, "type": line.kind.word(), "value": line.value,
        "allowed": line.allowed, "unit": line.unit, "writable": line.writable,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(kind: Kind, value: Option<&str>, allowed: &str, writable: bool) -> FeatureLine {
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
        let wide = line(Kind::Integer, Some("512"), "16 to 2048 in steps of 16", true);
        assert_eq!(feature_as_text(&wide), "  Width = 512 px (integer: 16 to 2048 in steps of 16)");
        assert_eq!(feature_as_text(&line(Kind::Category, None, "", false)), "  Width");
        assert_eq!(feature_as_text(&line(Kind::Integer, Some("5"), "", false)), "  Width = 5 px (integer, read only)");
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
        assert!(camera_as_text(&camera, &gone).ends_with("  open camera \"10.0.0.1\": silence"));
        assert_eq!(camera_as_json(&camera, &gone)["error"], "open camera \"10.0.0.1\": silence");
    }

    #[test]
    fn a_camera_of_the_kernel_is_told_with_what_each_format_becomes() {
        let format = |code: &str, becomes| v4l2::FormatOffer {
            code: code.into(),
            description: "words".into(),
            becomes,
            sizes: v4l2::Sizes::List(vec![(640, 480)]),
            rates: v4l2::Rates::Range(1.0, 60.0),
        };
        let capability = v4l2::Capability {
            driver: "uvcvideo".into(),
            card: "Webcam".into(),
            bus: "usb-1".into(),
            ..v4l2::Capability::default()
        };
        let formats = vec![format("YUYV", Some(crate::image::PixelFormat::Mono8)), format("MJPG", None)];
        let camera = v4l2::CameraListing { path: "/dev/video0".into(), capability, serial: String::new(), formats };
        assert_eq!(
            kernel_camera_as_text(&camera),
            "/dev/video0\n  model    Webcam, serial number none\n  address  usb-1 (V4L2, driver uvcvideo)\n  \
             format   YUYV (words), Mono8\n    sizes  640x480 px\n    rates  1 to 60 Hz\n  \
             format   MJPG (words), cannot be read"
        );
        assert_eq!(kernel_camera_as_json(&camera)["formats"][0]["rates_hz"]["most"], 60.0);
    }

    #[test]
    fn a_device_file_is_told_from_an_address_or_a_serial_number() {
        for (id, is) in [("/dev/video0", true), ("video12", true), ("192.168.1.10", false), ("video-7A", false)] {
            assert_eq!(is_device_file(id), is, "{id}");
        }
    }
}
