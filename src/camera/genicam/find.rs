//! Cameras in reach, and opening one of them.

use super::device::Device;
use super::handle::{Library, Object, c_text, checked, text};
use super::library::{library, one_at_a_time};
use super::sys::{ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER, guint};
use crate::camera::{CameraError, CameraIdentity};
use std::ffi::c_char;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::Duration;

/// One camera in reach.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CameraListing {
    /// What to write as `id` when nothing else is unique.
    pub id: String,
    /// Maker.
    pub vendor: String,
    /// Model.
    pub model: String,
    /// Serial number.
    pub serial: String,
    /// IPv4 address, or place on the USB.
    pub address: String,
    /// `GigEVision` or `USB3Vision`.
    pub protocol: String,
}

/// Asks every network card and USB port for cameras; takes about a second.
///
/// # Errors
///
/// [`CameraError::LibraryMissing`] when Aravis is not installed.
pub fn list() -> Result<Vec<CameraListing>, CameraError> {
    let aravis = Library(library()?);
    // The strings of the list live until the next discovery.
    let _turn = one_at_a_time();
    // SAFETY: no arguments, and nobody else is in here.
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
    /// An IPv4 address is asked directly; any other id is looked for among the
    /// cameras in reach, by device id, address or serial number; an empty one means
    /// the first of them.
    ///
    /// # Errors
    ///
    /// [`CameraError::NotFound`] within seconds when none answers, several have this
    /// serial number, or another program controls it.
    pub fn open(id: &str) -> Result<Self, CameraError> {
        let device = Self::open_to_read(id)?;
        if device.is_gige() && !device.is_controlled() {
            let reason = "another program controls it".into();
            return Err(CameraError::NotFound { id: id.into(), reason });
        }
        Ok(device)
    }

    /// Opens a camera, which may stay under the control of another program.
    ///
    /// # Errors
    ///
    /// As [`open`](Self::open).
    pub fn open_to_read(id: &str) -> Result<Self, CameraError> {
        let not_found = |reason: String| CameraError::NotFound { id: id.into(), reason };
        let aravis = Library(library()?);
        let name = match id.parse::<Ipv4Addr>() {
            Ok(address) => {
                probe(address).map_err(not_found)?;
                id.to_owned()
            }
            Err(_) => choose(&list()?, id).map_err(not_found)?,
        };
        let name = c_text(&name).map_err(not_found)?;
        let turn = one_at_a_time();
        // SAFETY: a terminated name; a returned camera is ours.
        let camera =
            checked(aravis, |error| unsafe { aravis.arv_camera_new(name.as_ptr(), error) }).map_err(not_found)?;
        drop(turn);
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

    /// Whether it speaks GigE Vision.
    pub fn is_gige(&self) -> bool {
        // SAFETY: an open camera.
        unsafe { self.aravis.arv_camera_is_gv_device(self.camera.as_ptr()) != 0 }
    }

    /// Whether we may write to this GigE Vision camera.
    pub fn is_controlled(&self) -> bool {
        // SAFETY: an open device; the library checks its type and answers false for others.
        unsafe { self.aravis.arv_gv_device_is_controller(self.as_ptr().cast()) != 0 }
    }

    /// Maker, model and serial number.
    pub fn identity(&self) -> CameraIdentity {
        let word = |function| {
            // SAFETY: the library answers null or a terminated string that lives until the next call.
            self.ask(function).ok().and_then(|word| unsafe { text(word) }).unwrap_or_default()
        };
        let (vendor, model) =
            (word(self.aravis.arv_camera_get_vendor_name), word(self.aravis.arv_camera_get_model_name));
        let serial = [self.aravis.arv_camera_get_device_serial_number, self.aravis.arv_camera_get_device_id];
        CameraIdentity {
            model: format!("{vendor} {model}").trim().to_owned(),
            serial: serial.into_iter().map(word).find(|word| !word.is_empty()).unwrap_or_default(),
        }
    }
}

/// The library's name for the camera meant by `id`.
fn choose(cameras: &[CameraListing], id: &str) -> Result<String, String> {
    // By its address rather than its name: a name may lead over another network card.
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
    let meant: Vec<_> = cameras
        .iter()
        .filter(|camera| [&camera.id, &camera.address, &camera.serial].iter().any(|own| *own == id))
        .collect();
    match meant.as_slice() {
        [camera] => Ok(name(camera)),
        [] if cameras.is_empty() => Err("no GenICam camera answers on any network card or USB port".into()),
        [] => {
            let ids: Vec<_> = cameras.iter().map(|camera| camera.id.as_str()).collect();
            Err(format!("the cameras in reach are {}", ids.join(", ")))
        }
        _ => {
            let ids: Vec<_> = meant.iter().map(|camera| format!("{} at {}", camera.id, camera.address)).collect();
            Err(format!("several cameras are called so: {}", ids.join(", ")))
        }
    }
}

/// Port of the GigE Vision control protocol (GVCP).
const GVCP_PORT: u16 = 3956;

/// Asks an address whether a camera is there; the library alone takes many seconds to give up.
fn probe(address: Ipv4Addr) -> Result<(), String> {
    const TRIES: u32 = 4;
    // Key, flags (answer wanted), command (read register), length 4, request 1; then the register's address, that of
    // the protocol's version, which everybody may read. All big-endian.
    const READ_VERSION: [u8; 12] = [0x42, 0x01, 0x00, 0x80, 0x00, 0x04, 0x00, 0x01, 0x00, 0x00, 0x00, 0x00];
    let ask = || -> std::io::Result<bool> {
        let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
        socket.set_read_timeout(Some(Duration::from_millis(300)))?;
        let mut answer = [0; 1024];
        for _ in 0..TRIES {
            // Not connected: a refusal must not end the wait of a camera that is only starting.
            socket.send_to(&READ_VERSION, SocketAddr::from((address, GVCP_PORT)))?;
            match socket.recv_from(&mut answer) {
                Ok((size, from)) if size >= 8 && from.ip() == address => return Ok(true),
                _ => {}
            }
        }
        Ok(false)
    };
    match ask() {
        Ok(true) => Ok(()),
        Ok(false) => Err(format!("no GigE Vision camera answers at {address}, UDP port {GVCP_PORT}")),
        Err(error) => Err(format!("ask {address}, UDP port {GVCP_PORT}: {error}")),
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
    fn a_camera_is_meant_by_id_serial_or_address_and_opened_by_address() {
        let cameras = [camera("Aravis-1", "A1", "10.0.0.1"), camera("Aravis-2", "A2", "10.0.0.2")];
        for id in ["Aravis-2", "A2", "10.0.0.2"] {
            assert_eq!(choose(&cameras, id).unwrap(), "10.0.0.2");
        }
        assert_eq!(choose(&cameras, "").unwrap(), "10.0.0.1");
        assert_eq!(choose(&cameras, "A3").unwrap_err(), "the cameras in reach are Aravis-1, Aravis-2");
    }

    #[test]
    fn a_usb_camera_is_opened_by_its_id() {
        assert_eq!(choose(&[camera("Maker-7", "7", "USB3")], "7").unwrap(), "Maker-7");
    }

    #[test]
    fn a_serial_number_of_two_cameras_is_refused() {
        let cameras = [camera("Aravis-1", "A", "10.0.0.1"), camera("Other-1", "A", "10.0.0.2")];
        assert_eq!(
            choose(&cameras, "A").unwrap_err(),
            "several cameras are called so: Aravis-1 at 10.0.0.1, Other-1 at 10.0.0.2"
        );
    }

    #[test]
    fn no_camera_at_all_is_said() {
        for id in ["", "A"] {
            assert!(choose(&[], id).unwrap_err().starts_with("no GenICam camera answers"));
        }
    }
}
