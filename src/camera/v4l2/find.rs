//! V4L2 cameras in reach, and opening one of them.

use super::device::{Capability, Device};
use super::layout::{LAYOUTS, word};
use super::offer::{Rates, Sizes};
use crate::camera::genicam::FeatureLine;
use crate::camera::{CameraError, CameraIdentity};
use crate::image::PixelFormat;
use std::path::{Path, PathBuf};

/// Where the kernel lists its video devices.
const CLASS: &str = "/sys/class/video4linux";

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
    /// Rates at the first of these sizes, or at the largest of a range.
    pub rates: Rates,
}

/// The cameras of this machine's kernel, by the number of their device file.
///
/// Devices that cannot be opened, or take no pictures, are left out.
pub fn list() -> Vec<CameraListing> {
    let describe = |path: PathBuf| {
        let device = Device::open(&path).ok()?;
        let capability = device.capability().ok()?;
        let formats = device.formats().into_iter().map(|(fourcc, description)| offer(&device, fourcc, description));
        Some(CameraListing { serial: serial_of(&path), capability, formats: formats.collect(), path })
    };
    nodes().into_iter().filter_map(describe).collect()
}

/// The controls of a camera.
///
/// # Errors
///
/// [`CameraError::NotFound`] when it cannot be opened.
pub fn features(id: &str) -> Result<Vec<FeatureLine>, CameraError> {
    Ok(Device::find(id)?.feature_lines())
}

fn offer(device: &Device, fourcc: u32, description: String) -> FormatOffer {
    let sizes = device.sizes(fourcc);
    let rates = sizes.any().map_or_else(|| Rates::List(Vec::new()), |size| device.rates(fourcc, size));
    let becomes = LAYOUTS.iter().find(|layout| layout.fourcc == fourcc).map(|layout| layout.format);
    FormatOffer { code: word(fourcc), description, becomes, sizes, rates }
}

/// Device files of video devices, in the order of their numbers.
fn nodes() -> Vec<PathBuf> {
    let entries = std::fs::read_dir(CLASS).into_iter().flatten().flatten();
    let number = |name: &str| name.strip_prefix("video")?.parse::<u32>().ok();
    let mut numbers: Vec<u32> = entries.filter_map(|entry| number(entry.file_name().to_str()?)).collect();
    numbers.sort_unstable();
    numbers.into_iter().map(|number| PathBuf::from(format!("/dev/video{number}"))).collect()
}

/// The serial number of the USB device behind a node, if it is one.
fn serial_of(path: &Path) -> String {
    let name = path.canonicalize().ok().and_then(|path| Some(path.file_name()?.to_owned())).unwrap_or_default();
    let serial = Path::new(CLASS).join(name).join("device/../serial");
    std::fs::read_to_string(serial).map(|text| text.trim().to_owned()).unwrap_or_default()
}

impl Device {
    /// Opens the camera that a rig file means: a device file, or the place, serial number or name of a camera.
    ///
    /// # Errors
    ///
    /// [`CameraError::NotFound`] when there is none, or several are called so.
    pub(super) fn find(id: &str) -> Result<Self, CameraError> {
        if id.starts_with('/') {
            return Self::open(Path::new(id));
        }
        let path = choose(&list(), id).map_err(|reason| CameraError::NotFound { id: id.into(), reason })?;
        let device = Self::open(&path)?;
        Ok(Self { id: id.into(), ..device })
    }

    /// Name and serial number; its place on the bus where it has none.
    pub(super) fn identity(&self, path: Option<&Path>) -> CameraIdentity {
        let capability = self.capability().unwrap_or_default();
        let serial = path.map(serial_of).filter(|serial| !serial.is_empty()).unwrap_or(capability.bus);
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
        CameraListing { path: path.into(), capability, serial: serial.into(), formats: Vec::new() }
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
    fn a_file_that_is_no_camera_is_told_with_its_reason() {
        for (id, word) in [("/dev/null", "no video device"), ("/dev/video-nowhere", "No such file")] {
            let error = Device::find(id).unwrap_err().to_string();
            assert!(error.contains(id) && error.contains(word), "{error}");
        }
    }
}
