//! The start of a process of a rig: alone, or by a supervisor.

use crate::bus::Domain;
use std::sync::mpsc::Receiver;

/// The start of a process; the default is one that is started alone.
#[derive(Debug, Default)]
pub struct Launch {
    /// The domain of the supervisor.
    pub domain: Option<Domain>,
    /// Whether the process replaces one that died.
    pub is_restart: bool,
    /// The steps of a stepped camera.
    pub steps: Option<Receiver<()>>,
}
