//! A camera of a rig and its shared memory, as the supervisor sees them.

use super::child::Child;
use crate::bus::{Bus, Subscriber};
use crate::config::Config;
use crate::failure::Failure;
use crate::message::{Role, StatusMessage};
use crate::process::setup::{expected_format, limits};
use std::any::Any;

/// One camera of the rig, which has its own rig name on the bus.
pub(super) struct CameraGroup<'a> {
    /// Name of the view; empty for the main camera.
    pub(super) name: &'a str,
    pub(super) config: &'a Config,
    /// Size of its frames in shared memory.
    pub(super) ring_bytes: u64,
    pub(super) status: Subscriber<StatusMessage>,
    pub(super) bus: Bus,
    _services: Vec<Box<dyn Any>>,
}

impl<'a> CameraGroup<'a> {
    /// Creates the shared memory of a camera, except its frames.
    pub(super) fn open(name: &'a str, config: &'a Config, bus: Bus) -> Result<Self, Failure> {
        let format = expected_format(config)?;
        config.check_calibration(format.width_px, format.height_px)?;
        config.check_ring(format.slot_bytes(), format.frame_rate_hz)?;
        let limits = limits(config, &format);
        let services = bus.open_services(&limits)?;
        let status = bus.subscriber(&limits)?;
        bus.reserve()?;
        let ring_bytes = limits.ring_bytes(format.slot_bytes());
        Ok(Self { name, config, ring_bytes, status, bus, _services: services })
    }

    /// Returns its processes, readers before the camera. The recorder is shared by all cameras.
    pub(super) fn children(&self, camera: u32) -> Vec<Child> {
        let workers = (0..self.config.workers.count).map(|index| Child { camera, role: Role::Correlate, index });
        let tracker = workers.clone().next().map(|first| Child { role: Role::Track, ..first });
        workers.chain(tracker).chain([Child { camera, role: Role::Acquire, index: 0 }]).collect()
    }
}
