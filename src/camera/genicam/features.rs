//! Descriptions of a camera: its formats and rates, and the tree of all its features.

use super::device::{Access, Device};
use super::discovery::CameraListing;
use super::handle::text;
use crate::camera::feature_setting::FloatRange;
use crate::camera::{CameraError, FeatureKind, FeatureLine};
use std::collections::BTreeSet;
use std::ffi::c_char;

/// The formats, rates and triggers of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraDetails {
    /// Maximum width and height, px; 0 if the camera does not report them.
    pub size_px: (i64, i64),
    /// Names of the pixel formats.
    pub formats: Vec<String>,
    /// Minimum and maximum frame rate at the present settings, Hz, if the camera has any.
    pub rate_hz: Option<FloatRange>,
    /// Trigger sources.
    pub triggers: Vec<String>,
    /// Whether another program controls it.
    pub taken: bool,
}

/// Maximum depth of the tree: descriptions come from vendors and may contain cycles.
const MAX_DEPTH: usize = 12;

/// Opens a camera for reading and returns its size, formats, rates and triggers.
///
/// Values that it does not report are empty, `None` or 0.
///
/// # Errors
///
/// [`CameraError::NotFound`] if it does not answer, [`CameraError::LibraryMissing`] without Aravis.
pub fn describe(camera: &CameraListing) -> Result<CameraDetails, CameraError> {
    let device = Device::open_read_only(if camera.address.contains('.') { &camera.address } else { &camera.id })?;
    let first_of = |names: [&str; 2]| {
        names.into_iter().filter(|name| device.has(name)).find_map(|name| device.integer(name).ok()).unwrap_or(0)
    };
    let rate_hz = device
        .call(device.aravis.arv_camera_is_frame_rate_available)
        .is_ok_and(|available| available != 0)
        .then(|| device.rate_range_hz().ok())
        .flatten();
    Ok(CameraDetails {
        size_px: (first_of(["SensorWidth", "WidthMax"]), first_of(["SensorHeight", "HeightMax"])),
        formats: device.enum_entries("PixelFormat").unwrap_or_default(),
        rate_hz,
        triggers: device.enum_entries("TriggerSource").unwrap_or_default(),
        taken: device.is_gige() && !device.is_controlled(),
    })
}

/// Returns the categories of a camera and its available features, in the order of its description.
///
/// # Errors
///
/// [`CameraError::NotFound`] if it does not answer, [`CameraError::LibraryMissing`] without Aravis.
pub fn features(id: &str) -> Result<Vec<FeatureLine>, CameraError> {
    let device = Device::open_read_only(id)?;
    let mut lines = Vec::new();
    let mut seen = BTreeSet::new();
    device.collect_features("Root", 0, &mut seen, &mut lines);
    Ok(lines)
}

impl Device {
    /// Adds a line for each category below a category and for each available feature, each feature once.
    ///
    /// `depth` is that of the lines added; below [`MAX_DEPTH`] the tree is cut. `seen` has the names of the features
    /// added and of the categories searched so far.
    fn collect_features(
        &self,
        category: &str,
        depth: usize,
        seen: &mut BTreeSet<String>,
        lines: &mut Vec<FeatureLine>,
    ) {
        if depth > MAX_DEPTH || !seen.insert(category.to_owned()) {
            return;
        }
        for name in self.category_members(category) {
            let Some(kind) = self.kind(&name) else { continue };
            if kind == FeatureKind::Category {
                lines.push(FeatureLine {
                    depth,
                    name: name.clone(),
                    kind,
                    value: None,
                    allowed: String::new(),
                    unit: String::new(),
                    writable: false,
                });
                self.collect_features(&name, depth + 1, seen, lines);
            } else if self.has(&name) && seen.insert(name.clone()) {
                lines.push(self.feature_line(depth, name, kind));
            }
        }
    }

    /// Returns the line of one feature, with its present value if it can be read and its range if it can be written.
    fn feature_line(&self, depth: usize, name: String, kind: FeatureKind) -> FeatureLine {
        let access = self.access(&name);
        let value = match (access, kind) {
            (Some(Access::Write), _) | (_, FeatureKind::Command | FeatureKind::Category) => None,
            (_, FeatureKind::Boolean) => self.boolean(&name).ok().map(|value| value.to_string()),
            (_, FeatureKind::Integer) => self.integer(&name).ok().map(|value| value.to_string()),
            (_, FeatureKind::Float) => self.float(&name).ok().map(|value| value.to_string()),
            (_, FeatureKind::Enumeration | FeatureKind::Text) => self.text(&name).ok(),
        };
        let writable = access != Some(Access::Read);
        let allowed = if writable { self.allowed_values(&name, kind) } else { String::new() };
        FeatureLine { depth, unit: self.unit(&name, kind), kind, value, allowed, writable, name }
    }

    /// Returns the names of the features and categories in a category; empty if it is none.
    fn category_members(&self, category: &str) -> Vec<String> {
        let node = self.node(category);
        if self.kind_of(node) != Some(FeatureKind::Category) {
            return Vec::new();
        }
        let mut names = Vec::new();
        // SAFETY: the node is a category, and its list of terminated names lives as long as the device.
        unsafe {
            let mut entry = self.aravis.arv_gc_category_get_features(node.cast());
            while !entry.is_null() {
                names.extend(text((*entry).data.cast::<c_char>()));
                entry = (*entry).next;
            }
        }
        names
    }

    /// Returns the unit of an integer or a real number; empty if it has none, and for other types.
    fn unit(&self, name: &str, kind: FeatureKind) -> String {
        let node = self.node(name);
        // SAFETY: the node is of the type that the function takes; it returns null or a terminated string.
        let unit = unsafe {
            match kind {
                FeatureKind::Integer => text(self.aravis.arv_gc_integer_get_unit(node.cast())),
                FeatureKind::Float => text(self.aravis.arv_gc_float_get_unit(node.cast())),
                _ => None,
            }
        };
        unit.unwrap_or_default()
    }
}
