//! `ricochet cameras`: the cameras in reach and what they can do.

use super::say;
use crate::camera::CameraError;
use crate::camera::genicam::{CameraDetails, CameraListing, FeatureLine, Kind, describe, features, list};
use serde_json::{Value, json};

/// What to tell.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct CamerasOptions {
    /// One JSON document instead of text.
    pub json: bool,
    /// Id, address or serial number of the camera whose features are told instead of the list.
    pub features_of: Option<String>,
}

/// Prints the cameras in reach, or the features of one.
///
/// # Errors
///
/// [`CameraError`] when the camera library is missing or the camera does not answer.
pub fn run(options: &CamerasOptions) -> anyhow::Result<()> {
    if let Some(id) = &options.features_of {
        let lines = features(id)?;
        match options.json {
            true => say(&Value::from(lines.iter().map(feature_as_json).collect::<Vec<_>>()).to_string()),
            false => lines.iter().for_each(|line| say(&feature_as_text(line))),
        }
        return Ok(());
    }
    let cameras: Vec<_> = list()?.into_iter().map(|camera| (describe(&camera), camera)).collect();
    if options.json {
        let cameras: Vec<_> = cameras.iter().map(|(details, camera)| camera_as_json(camera, details)).collect();
        say(&json!({ "cameras": cameras }).to_string());
    } else if cameras.is_empty() {
        say("no camera answers on any network card or USB port");
    } else {
        cameras.iter().for_each(|(details, camera)| say(&camera_as_text(camera, details)));
    }
    Ok(())
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
    let value = line.value.as_ref().map(|value| format!(" = {value}")).unwrap_or_default();
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
}
