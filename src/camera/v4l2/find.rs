//! V4L2 cameras in reach, and opening one of them.

use super::device::{Capability, Device};
use super::kernel::Node;
use super::layout::{LAYOUTS, word};
use super::offer::{Rates, Sizes};
use crate::camera::genicam::FeatureLine;
use crate::camera::{CameraError, CameraIdentity};
use crate::image::PixelFormat;
use std::path::{Path, PathBuf};

/// Where the kernel lists its video devices.
const CLASS: &str = "/sys/class/video4linux";
/// The serial number of the USB device behind a node, from there.
const SERIAL: &str = "device/../serial";

/// One camera of the kernel.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraListing {
    /// Device file, which can be written as `id`.
    pub path: PathBuf,
    /// Driver, name and place.
    pub capability: Capability,
    /// Serial number; empty when it has none.
    pub serial: String,
    /// What it delivers.
    pub formats: Vec<FormatOffer>,
    /// Why nothing more than its name is known of it, if so.
    pub closed: Option<String>,
}

/// One pixel format of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct FormatOffer {
    /// The kernel's four letters.
    pub code: String,
    /// The driver's words.
    pub description: String,
    /// What it becomes in the ring; none for what cannot be read.
    pub becomes: Option<PixelFormat>,
    /// Sizes of the pictures.
    pub sizes: Sizes,
    /// Rates at each of these (width, height), px, or at both ends of a range.
    pub rates: Vec<((u32, u32), Rates)>,
}

/// The cameras of this machine's kernel, by the number of their device file.
///
/// Devices that take no pictures are left out; one that cannot be opened is told with the reason.
pub fn list() -> Vec<CameraListing> {
    nodes().into_iter().filter_map(describe).collect()
}

fn describe(path: PathBuf) -> Option<CameraListing> {
    let node = match Node::open(&path) {
        Ok(node) => node,
        // Unplugged in the meantime.
        Err(error) if matches!(error.raw_os_error(), Some(libc::ENODEV | libc::ENXIO | libc::ENOENT)) => return None,
        Err(error) => {
            let card = attribute(&path, "name");
            let (capability, serial) = (Capability { card, ..Capability::default() }, attribute(&path, SERIAL));
            return Some(CameraListing { path, capability, serial, formats: Vec::new(), closed: Some(words(&error)) });
        }
    };
    let device = Device { kernel: Box::new(node), id: path.display().to_string(), path: path.clone() };
    let capability = device.capability().ok().filter(|capability| capability.refusal().is_none())?;
    let formats = device.formats().into_iter().map(|(fourcc, description)| offer(&device, fourcc, description));
    Some(CameraListing { serial: attribute(&path, SERIAL), capability, formats: formats.collect(), closed: None, path })
}

/// The camera that is meant by an `id`, as [`list`] tells it, and its controls.
///
/// # Errors
///
/// [`CameraError::NotFound`] when there is none, several are called so, or it cannot be opened.
pub fn features(id: &str) -> Result<(CameraListing, Vec<FeatureLine>), CameraError> {
    let path = path_of(id)?;
    let lines = Device::open(&path)?.feature_lines();
    let gone = || CameraError::NotFound { id: id.into(), reason: "it was unplugged".into() };
    Ok((describe(path).ok_or_else(gone)?, lines))
}

/// Whether an `id` means a camera of the kernel: a device file, or what one of them is called.
pub fn is_ours(id: &str) -> bool {
    let is_file = id.starts_with('/') || id.strip_prefix("video").is_some_and(|number| number.parse::<u32>().is_ok());
    is_file || !id.is_empty() && choose(&list(), id).is_ok()
}

fn offer(device: &Device, fourcc: u32, description: String) -> FormatOffer {
    let sizes = device.sizes(fourcc);
    let becomes = LAYOUTS.iter().find(|layout| layout.fourcc == fourcc).map(|layout| layout.format);
    let told = if becomes.is_some() { sizes.told() } else { Vec::new() };
    let rates = told.into_iter().map(|size| (size, device.rates(fourcc, size))).collect();
    FormatOffer { code: word(fourcc), description, becomes, sizes, rates }
}

/// What the kernel says of an error on opening a device, with what to do about it.
pub(super) fn words(error: &std::io::Error) -> String {
    match error.raw_os_error() {
        Some(libc::EACCES) => format!("{error}; members of the file's group, mostly `video`, may open it"),
        Some(libc::EBUSY) => "another program uses it".into(),
        _ => error.to_string(),
    }
}

/// Device files of video devices, in the order of their numbers.
fn nodes() -> Vec<PathBuf> {
    let entries = std::fs::read_dir(CLASS).into_iter().flatten().flatten();
    let number = |name: &str| name.strip_prefix("video")?.parse::<u32>().ok();
    let mut numbers: Vec<u32> = entries.filter_map(|entry| number(entry.file_name().to_str()?)).collect();
    numbers.sort_unstable();
    numbers.into_iter().map(|number| PathBuf::from(format!("/dev/video{number}"))).collect()
}

/// What the kernel tells of a node besides its file; empty where it tells nothing.
fn attribute(path: &Path, name: &str) -> String {
    let node = path.canonicalize().ok().and_then(|path| Some(path.file_name()?.to_owned())).unwrap_or_default();
    let told = std::fs::read_to_string(Path::new(CLASS).join(node).join(name));
    told.map(|text| text.trim().to_owned()).unwrap_or_default()
}

/// The device file of the camera that a rig file means.
fn path_of(id: &str) -> Result<PathBuf, CameraError> {
    if id.starts_with('/') {
        return Ok(PathBuf::from(id));
    }
    choose(&list(), id).map_err(|reason| CameraError::NotFound { id: id.into(), reason })
}

impl Device {
    /// Opens the camera that a rig file means: a device file, or the place, serial number or name of a camera.
    ///
    /// # Errors
    ///
    /// [`CameraError::NotFound`] when there is none, or several are called so.
    pub(super) fn find(id: &str) -> Result<Self, CameraError> {
        let device = Self::open(&path_of(id)?)?;
        Ok(Self { id: id.into(), ..device })
    }

    /// Name and serial number; its place on the bus where it has none.
    pub(super) fn identity(&self) -> CameraIdentity {
        let capability = self.capability().unwrap_or_default();
        let serial = Some(attribute(&self.path, SERIAL)).filter(|serial| !serial.is_empty()).unwrap_or(capability.bus);
        CameraIdentity { model: capability.card, serial }
    }
}

fn choose(cameras: &[CameraListing], id: &str) -> Result<PathBuf, String> {
    let names = |camera: &CameraListing| {
        let file = camera.path.file_name().and_then(|name| name.to_str()).unwrap_or_default().to_owned();
        [file, camera.capability.bus.clone(), camera.serial.clone(), camera.capability.card.clone()]
    };
    let told = |cameras: &[&CameraListing]| {
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
    let meant: Vec<_> = all.iter().copied().filter(|camera| names(camera).iter().any(|name| name == id)).collect();
    match meant.as_slice() {
        [camera] => Ok(camera.path.clone()),
        [] => Err(format!("the kernel's cameras are {}", told(&all))),
        _ => Err(format!("several cameras are called so: {}", told(&meant))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(path: &str, card: &str, bus: &str, serial: &str) -> CameraListing {
        let capability = Capability { driver: "d".into(), card: card.into(), bus: bus.into(), flags: 0 };
        CameraListing { path: path.into(), capability, serial: serial.into(), formats: Vec::new(), closed: None }
    }

    #[test]
    fn a_camera_is_meant_by_file_place_serial_or_name() {
        let cameras = [camera("/dev/video0", "Left", "usb-1", "A1"), camera("/dev/video2", "Right", "usb-2", "A2")];
        for id in ["video2", "usb-2", "A2", "Right"] {
            assert_eq!(choose(&cameras, id).unwrap(), Path::new("/dev/video2"));
        }
        assert_eq!(choose(&cameras, "").unwrap(), Path::new("/dev/video0"));
        assert_eq!(
            choose(&cameras, "Middle").unwrap_err(),
            "the kernel's cameras are /dev/video0 (Left, usb-1), /dev/video2 (Right, usb-2)"
        );
    }

    #[test]
    fn a_name_of_two_cameras_is_refused() {
        let cameras = [camera("/dev/video0", "Cam", "usb-1", ""), camera("/dev/video2", "Cam", "usb-2", "")];
        assert!(choose(&cameras, "Cam").unwrap_err().starts_with("several cameras are called so: /dev/video0"));
        assert!(choose(&[], "Cam").unwrap_err().starts_with("the kernel has no camera"));
    }

    #[test]
    fn a_camera_that_may_not_be_opened_is_told_with_what_to_do() {
        let denied = words(&std::io::Error::from_raw_os_error(libc::EACCES));
        assert_eq!(denied, "Permission denied (os error 13); members of the file's group, mostly `video`, may open it");
    }

    #[test]
    fn a_device_file_is_told_from_an_address_or_a_serial_number() {
        for (id, is) in [("/dev/video0", true), ("video12", true), ("192.168.1.10", false), ("video-7A", false)] {
            assert_eq!(is_ours(id), is, "{id}");
        }
    }

    #[test]
    fn a_file_that_is_no_camera_is_told_with_its_reason() {
        for (id, word) in [("/dev/null", "no video device"), ("/dev/video-nowhere", "No such file")] {
            let error = Device::find(id).unwrap_err().to_string();
            assert!(error.contains(id) && error.contains(word), "{error}");
        }
    }
}
