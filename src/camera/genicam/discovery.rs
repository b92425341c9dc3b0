//! Discovery of cameras, and opening one of them.

use super::device::Device;
use super::handle::{Library, Object, c_text, checked, text};
use super::library::{discovery_lock, library};
use super::sys::{ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER, guint};
use crate::camera::{CameraError, CameraIdentity};
use std::ffi::c_char;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::Duration;

/// A discovered camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CameraListing {
    /// The device id, which can be used as `camera.id`.
    pub id: String,
    /// Vendor.
    pub vendor: String,
    /// Model.
    pub model: String,
    /// Serial number.
    pub serial: String,
    /// IPv4 address, or USB address.
    pub address: String,
    /// `GigEVision` or `USB3Vision`.
    pub protocol: String,
}

/// Discovers the cameras on every network card and USB port, sorted by id and address; takes about a second.
///
/// # Errors
///
/// [`CameraError::LibraryMissing`] if Aravis is not installed.
pub fn list() -> Result<Vec<CameraListing>, CameraError> {
    let aravis = Library(library()?);
    // The strings of the list live until the next discovery.
    let _guard = discovery_lock();
    // SAFETY: no arguments; the lock keeps other threads out.
    let count = unsafe {
        aravis.arv_update_device_list();
        aravis.arv_get_n_devices()
    };
    let field = |function: unsafe extern "C" fn(guint) -> *const c_char, index: guint| {
        // SAFETY: the index is below the count, and the list does not change while the lock is held.
        unsafe { text(function(index)) }.unwrap_or_default()
    };
    let mut cameras: Vec<_> = (0..count)
        .map(|index| CameraListing {
            id: field(aravis.arv_get_device_id, index),
            vendor: field(aravis.arv_get_device_vendor, index),
            model: field(aravis.arv_get_device_model, index),
            serial: field(aravis.arv_get_device_serial_nbr, index),
            address: field(aravis.arv_get_device_address, index),
            protocol: field(aravis.arv_get_device_protocol, index),
        })
        .collect();
    cameras.sort_by(|a, b| (&a.id, &a.address).cmp(&(&b.id, &b.address)));
    cameras.dedup();
    Ok(cameras)
}

impl Device {
    /// Opens a camera and takes control of it.
    ///
    /// An IPv4 address is contacted directly. Any other id is searched among the discovered cameras by device id,
    /// address or serial number. An empty id selects the first camera.
    ///
    /// # Errors
    ///
    /// [`CameraError::LibraryMissing`] without Aravis. [`CameraError::NotFound`] within seconds if no camera answers,
    /// several cameras have this serial number, or another program controls it.
    pub fn open(id: &str) -> Result<Self, CameraError> {
        let device = Self::open_read_only(id)?;
        if device.is_gige() && !device.is_controlled() {
            let reason = "another program controls it".into();
            return Err(CameraError::NotFound { id: id.into(), reason });
        }
        Ok(device)
    }

    /// Opens a camera to read its features; another program may control it. The id is as in [`open`](Self::open).
    ///
    /// The library takes control of a camera that is free, and leaves the packet size as it is.
    ///
    /// # Errors
    ///
    /// [`CameraError::LibraryMissing`] without Aravis, [`CameraError::NotFound`] if no camera answers within seconds or
    /// several cameras have this serial number.
    pub fn open_read_only(id: &str) -> Result<Self, CameraError> {
        let not_found = |reason: String| CameraError::NotFound { id: id.into(), reason };
        let aravis = Library(library()?);
        let name = match id.parse::<Ipv4Addr>() {
            Ok(address) => {
                probe(address).map_err(not_found)?;
                id.to_owned()
            }
            Err(_) => select(&list()?, id).map_err(not_found)?,
        };
        let name = c_text(&name).map_err(not_found)?;
        let guard = discovery_lock();
        // SAFETY: a terminated name; a returned camera is ours.
        let camera =
            checked(aravis, |error| unsafe { aravis.arv_camera_new(name.as_ptr(), error) }).map_err(not_found)?;
        drop(guard);
        // SAFETY: the library made it for us.
        let camera = unsafe { Object::owned(aravis, camera) }.ok_or_else(|| not_found("no camera".into()))?;
        let device = Self { aravis, camera };
        if device.is_gige() {
            // SAFETY: an open GigE Vision camera and a constant of the library.
            unsafe {
                aravis.arv_camera_gv_set_packet_size_adjustment(
                    device.camera.as_ptr(),
                    ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER,
                );
            }
        }
        Ok(device)
    }

    /// Whether the camera is a GigE Vision camera.
    pub fn is_gige(&self) -> bool {
        // SAFETY: an open camera.
        unsafe { self.aravis.arv_camera_is_gv_device(self.camera.as_ptr()) != 0 }
    }

    /// Whether this program controls this GigE Vision camera; `false` for other cameras.
    pub fn is_controlled(&self) -> bool {
        // SAFETY: an open device; the library checks its type and answers false for others.
        unsafe { self.aravis.arv_gv_device_is_controller(self.as_ptr().cast()) != 0 }
    }

    /// Returns vendor, model and serial number, or the device id of a camera without a serial number.
    pub fn identity(&self) -> CameraIdentity {
        let string = |function| {
            // SAFETY: the library answers null or a terminated string that lives until the next call.
            self.call(function).ok().and_then(|value| unsafe { text(value) }).unwrap_or_default()
        };
        let (vendor, model) =
            (string(self.aravis.arv_camera_get_vendor_name), string(self.aravis.arv_camera_get_model_name));
        let serial = [self.aravis.arv_camera_get_device_serial_number, self.aravis.arv_camera_get_device_id];
        CameraIdentity {
            model: format!("{vendor} {model}").trim().to_owned(),
            serial: serial.into_iter().map(string).find(|value| !value.is_empty()).unwrap_or_default(),
        }
    }
}

/// Returns the name under which the library opens the camera with this device id, address or serial number.
///
/// An empty `id` selects the first camera. The name is the address of a camera in a network, else the device id.
///
/// # Errors
///
/// The discovered cameras if none matches, or those that match if several do.
fn select(cameras: &[CameraListing], id: &str) -> Result<String, String> {
    // The address rather than the name: the library may reach a name through another network card.
    let name = |camera: &CameraListing| match camera.address.parse::<Ipv4Addr>() {
        Ok(_) => camera.address.clone(),
        Err(_) => camera.id.clone(),
    };
    if id.is_empty() {
        return cameras
            .first()
            .map(name)
            .ok_or_else(|| "no GenICam camera answers on any network card or USB port".into());
    }
    let matches: Vec<_> = cameras
        .iter()
        .filter(|camera| [&camera.id, &camera.address, &camera.serial].iter().any(|own| *own == id))
        .collect();
    match matches.as_slice() {
        [camera] => Ok(name(camera)),
        [] if cameras.is_empty() => Err("no GenICam camera answers on any network card or USB port".into()),
        [] => {
            let ids: Vec<_> = cameras.iter().map(|camera| camera.id.as_str()).collect();
            Err(format!("the discovered cameras are {}", ids.join(", ")))
        }
        _ => {
            let ids: Vec<_> = matches.iter().map(|camera| format!("{} at {}", camera.id, camera.address)).collect();
            Err(format!("several cameras match: {}; use the address", ids.join(", ")))
        }
    }
}

/// Port of the GigE Vision control protocol (GVCP).
const GVCP_PORT: u16 = 3956;

/// Checks that a camera answers at this address. The library alone takes many seconds to give up.
///
/// # Errors
///
/// The reason, if no camera answers within about a second.
fn probe(address: Ipv4Addr) -> Result<(), String> {
    const TRIES: u32 = 4;
    // GVCP read-register request, big-endian: key, flags (acknowledge), command, length 4, request id 1, address 0
    // (the protocol version, which every client may read).
    const READ_VERSION: [u8; 12] = [0x42, 0x01, 0x00, 0x80, 0x00, 0x04, 0x00, 0x01, 0x00, 0x00, 0x00, 0x00];
    let answers = || -> std::io::Result<bool> {
        let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
        socket.set_read_timeout(Some(Duration::from_millis(300)))?;
        let mut answer = [0; 1024];
        for _ in 0..TRIES {
            // Not connected: an ICMP refusal must not end the wait for a camera that is still starting.
            socket.send_to(&READ_VERSION, SocketAddr::from((address, GVCP_PORT)))?;
            match socket.recv_from(&mut answer) {
                Ok((size, from)) if size >= 8 && from.ip() == address => return Ok(true),
                _ => {}
            }
        }
        Ok(false)
    };
    match answers() {
        Ok(true) => Ok(()),
        Ok(false) => Err(format!("no GigE Vision camera answers at {address}, UDP port {GVCP_PORT}")),
        Err(error) => Err(format!("cannot send to {address}, UDP port {GVCP_PORT}: {error}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(id: &str, serial: &str, address: &str) -> CameraListing {
        let (vendor, model, protocol) = ("Aravis".into(), "Fake".into(), "GigEVision".into());
        CameraListing { id: id.into(), vendor, model, serial: serial.into(), address: address.into(), protocol }
    }

    #[test]
    fn a_camera_is_selected_by_id_serial_or_address_and_opened_by_address() {
        let cameras = [camera("Aravis-1", "A1", "10.0.0.1"), camera("Aravis-2", "A2", "10.0.0.2")];
        for id in ["Aravis-2", "A2", "10.0.0.2"] {
            assert_eq!(select(&cameras, id).unwrap(), "10.0.0.2");
        }
        assert_eq!(select(&cameras, "").unwrap(), "10.0.0.1");
        assert_eq!(select(&cameras, "A3").unwrap_err(), "the discovered cameras are Aravis-1, Aravis-2");
    }

    #[test]
    fn a_usb_camera_is_opened_by_its_id() {
        assert_eq!(select(&[camera("Maker-7", "7", "USB3")], "7").unwrap(), "Maker-7");
    }

    #[test]
    fn a_serial_number_of_two_cameras_is_refused() {
        let cameras = [camera("Aravis-1", "A", "10.0.0.1"), camera("Other-1", "A", "10.0.0.2")];
        assert_eq!(
            select(&cameras, "A").unwrap_err(),
            "several cameras match: Aravis-1 at 10.0.0.1, Other-1 at 10.0.0.2; use the address"
        );
    }

    #[test]
    fn no_camera_at_all_is_reported() {
        for id in ["", "A"] {
            assert!(select(&[], id).unwrap_err().starts_with("no GenICam camera answers"));
        }
    }
}
