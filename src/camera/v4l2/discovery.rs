//! Discovery of V4L2 cameras, and opening one of them.

use super::device::{Capability, Device};
use super::kernel::{Node, open_failure};
use super::modes::{FrameSize, Rates, Sizes};
use super::pixel_layout::{LAYOUTS, fourcc_text};
use crate::camera::{CameraError, CameraIdentity, FeatureLine};
use crate::image::PixelFormat;
use std::path::{Path, PathBuf};

/// The kernel's list of video devices.
const CLASS: &str = "/sys/class/video4linux";
/// The file with the USB serial number, relative to a device in that list.
const SERIAL: &str = "device/../serial";

/// A V4L2 camera.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraListing {
    /// Device file, which can be used as `camera.id`.
    pub path: PathBuf,
    /// Driver, name and bus address.
    pub capability: Capability,
    /// Serial number; empty if it has none.
    pub serial: String,
    /// Pixel formats.
    pub formats: Vec<FormatListing>,
    /// The reason why nothing but its name is known, if the device cannot be opened.
    pub unavailable: Option<String>,
}

/// A pixel format of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct FormatListing {
    /// Four-character code.
    pub code: String,
    /// The driver's description.
    pub description: String,
    /// The pixel format in the ring; `None` if this format is not supported.
    pub ring_format: Option<PixelFormat>,
    /// Frame sizes.
    pub sizes: Sizes,
    /// Frame rates for each size, or for both ends of a range of sizes.
    pub rates: Vec<(FrameSize, Rates)>,
}

/// Lists this machine's V4L2 cameras in the order of the numbers of their device files.
///
/// Devices that do not capture are left out. One that cannot be opened is listed with the reason.
pub fn list() -> Vec<CameraListing> {
    nodes().into_iter().filter_map(describe).collect()
}

/// Describes the camera behind a device file; `None` if it is gone or no camera.
fn describe(path: PathBuf) -> Option<CameraListing> {
    let node = match Node::open(&path) {
        Ok(node) => node,
        // Unplugged in the meantime.
        Err(error) if matches!(error.raw_os_error(), Some(libc::ENODEV | libc::ENXIO | libc::ENOENT)) => return None,
        Err(error) => {
            let card = attribute(&path, "name");
            let (capability, serial) = (Capability { card, ..Capability::default() }, attribute(&path, SERIAL));
            let unavailable = Some(open_failure(&error));
            return Some(CameraListing { path, capability, serial, formats: Vec::new(), unavailable });
        }
    };
    let device = Device { kernel: Box::new(node), id: path.display().to_string(), path: path.clone() };
    let capability = device.capability().ok().filter(|capability| capability.refusal().is_none())?;
    let formats =
        device.formats().into_iter().map(|(fourcc, description)| format_listing(&device, fourcc, description));
    let serial = attribute(&path, SERIAL);
    Some(CameraListing { serial, capability, formats: formats.collect(), unavailable: None, path })
}

/// Returns the camera selected by an `id`, and its controls.
///
/// # Errors
///
/// [`CameraError::NotFound`] if there is none, several match, or it cannot be opened.
pub fn features(id: &str) -> Result<(CameraListing, Vec<FeatureLine>), CameraError> {
    let path = path_of(id)?;
    let lines = Device::open(&path)?.feature_lines();
    let gone = || CameraError::NotFound { id: id.into(), reason: "it was unplugged".into() };
    Ok((describe(path).ok_or_else(gone)?, lines))
}

/// Whether an `id` selects a V4L2 camera: a device file, or the bus address, serial number or name of just one.
///
/// A device file (`/...` or `videoN`) need not exist. An empty `id` selects none here.
pub fn is_v4l2_id(id: &str) -> bool {
    let is_file = id.starts_with('/') || id.strip_prefix("video").is_some_and(|number| number.parse::<u32>().is_ok());
    is_file || !id.is_empty() && select(&list(), id).is_ok()
}

/// Describes a pixel format with its sizes, and with their rates if the format is supported.
fn format_listing(device: &Device, fourcc: u32, description: String) -> FormatListing {
    let sizes = device.sizes(fourcc);
    let ring_format = LAYOUTS.iter().find(|layout| layout.fourcc == fourcc).map(|layout| layout.format);
    let listed = if ring_format.is_some() { sizes.listed() } else { Vec::new() };
    let rates = listed.into_iter().map(|size| (size, device.rates(fourcc, size))).collect();
    FormatListing { code: fourcc_text(fourcc), description, ring_format, sizes, rates }
}

/// Returns the device files of all video devices, in the order of their numbers.
fn nodes() -> Vec<PathBuf> {
    let entries = std::fs::read_dir(CLASS).into_iter().flatten().flatten();
    let number = |name: &str| name.strip_prefix("video")?.parse::<u32>().ok();
    let mut numbers: Vec<u32> = entries.filter_map(|entry| number(entry.file_name().to_str()?)).collect();
    numbers.sort_unstable();
    numbers.into_iter().map(|number| PathBuf::from(format!("/dev/video{number}"))).collect()
}

/// Reads the attribute `name` of the device with the file `path` from the kernel's list; empty if there is none.
fn attribute(path: &Path, name: &str) -> String {
    let node = path.canonicalize().ok().and_then(|path| Some(path.file_name()?.to_owned())).unwrap_or_default();
    let text = std::fs::read_to_string(Path::new(CLASS).join(node).join(name));
    text.map(|text| text.trim().to_owned()).unwrap_or_default()
}

/// Returns the device file of the camera with this id: the id itself if it is a path, that of the first camera if it is
/// empty.
///
/// # Errors
///
/// [`CameraError::NotFound`] if no camera or several match; a path is not checked.
fn path_of(id: &str) -> Result<PathBuf, CameraError> {
    if id.starts_with('/') {
        return Ok(PathBuf::from(id));
    }
    select(&list(), id).map_err(|reason| CameraError::NotFound { id: id.into(), reason })
}

impl Device {
    /// Opens the camera with this id: a device file, or the bus address, serial number or name of a camera.
    ///
    /// An empty id opens the first camera.
    ///
    /// # Errors
    ///
    /// [`CameraError::NotFound`] if there is none, several match, or it cannot be used as a camera.
    pub(super) fn find(id: &str) -> Result<Self, CameraError> {
        let device = Self::open(&path_of(id)?)?;
        Ok(Self { id: id.into(), ..device })
    }

    /// Returns the name and serial number; the bus address if it has no serial number.
    pub(super) fn identity(&self) -> CameraIdentity {
        let capability = self.capability().unwrap_or_default();
        let serial = Some(attribute(&self.path, SERIAL)).filter(|serial| !serial.is_empty()).unwrap_or(capability.bus);
        CameraIdentity { model: capability.card, serial }
    }
}

/// Returns the device file of the camera with this id among those listed, the first one for an empty id.
///
/// The id is the name of a device file, a bus address, a serial number or a name.
///
/// # Errors
///
/// The listed cameras, if none matches or several do.
fn select(cameras: &[CameraListing], id: &str) -> Result<PathBuf, String> {
    let names = |camera: &CameraListing| {
        let file = camera.path.file_name().and_then(|name| name.to_str()).unwrap_or_default().to_owned();
        [file, camera.capability.bus.clone(), camera.serial.clone(), camera.capability.card.clone()]
    };
    let names_of = |cameras: &[&CameraListing]| {
        let one = |camera: &&CameraListing| {
            format!("{} ({}, {})", camera.path.display(), camera.capability.card, camera.capability.bus)
        };
        cameras.iter().map(one).collect::<Vec<_>>().join(", ")
    };
    let all: Vec<_> = cameras.iter().collect();
    if all.is_empty() {
        return Err("the kernel has no camera that can be opened".into());
    }
    if id.is_empty() {
        return Ok(all[0].path.clone());
    }
    let matches: Vec<_> = all.iter().copied().filter(|camera| names(camera).iter().any(|name| name == id)).collect();
    match matches.as_slice() {
        [camera] => Ok(camera.path.clone()),
        [] => Err(format!("the kernel's cameras are {}", names_of(&all))),
        _ => Err(format!("several cameras match: {}; use the device file", names_of(&matches))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(path: &str, card: &str, bus: &str, serial: &str) -> CameraListing {
        let capability = Capability { driver: "d".into(), card: card.into(), bus: bus.into(), flags: 0 };
        CameraListing { path: path.into(), capability, serial: serial.into(), formats: Vec::new(), unavailable: None }
    }

    #[test]
    fn a_camera_is_selected_by_file_bus_serial_or_name() {
        let cameras = [camera("/dev/video0", "Left", "usb-1", "A1"), camera("/dev/video2", "Right", "usb-2", "A2")];
        for id in ["video2", "usb-2", "A2", "Right"] {
            assert_eq!(select(&cameras, id).unwrap(), Path::new("/dev/video2"));
        }
        assert_eq!(select(&cameras, "").unwrap(), Path::new("/dev/video0"));
        assert_eq!(
            select(&cameras, "Middle").unwrap_err(),
            "the kernel's cameras are /dev/video0 (Left, usb-1), /dev/video2 (Right, usb-2)"
        );
    }

    #[test]
    fn a_name_of_two_cameras_is_refused() {
        let cameras = [camera("/dev/video0", "Cam", "usb-1", ""), camera("/dev/video2", "Cam", "usb-2", "")];
        assert!(select(&cameras, "Cam").unwrap_err().starts_with("several cameras match: /dev/video0"));
        assert!(select(&[], "Cam").unwrap_err().starts_with("the kernel has no camera"));
    }

    #[test]
    fn a_camera_that_may_not_be_opened_is_reported_with_its_cure() {
        let denied = open_failure(&std::io::Error::from_raw_os_error(libc::EACCES));
        assert_eq!(denied, "Permission denied (os error 13); add the user to the file's group, usually `video`");
    }

    #[test]
    fn a_device_file_is_distinguished_from_an_address_or_a_serial_number() {
        for (id, is) in [("/dev/video0", true), ("video12", true), ("192.168.1.10", false), ("video-7A", false)] {
            assert_eq!(is_v4l2_id(id), is, "{id}");
        }
    }

    #[test]
    fn a_file_that_is_no_camera_is_reported_with_its_reason() {
        for (id, word) in [("/dev/null", "no video device"), ("/dev/video-nowhere", "No such file")] {
            let error = Device::find(id).unwrap_err().to_string();
            assert!(error.contains(id) && error.contains(word), "{error}");
        }
    }
}
