//! The end of a rig that was stopped before its first frame.

use super::Supervisor;
use crate::failure::Failure;
use crate::message::Role;
use crate::process::resume::NewestFrameFile;

impl Supervisor<'_> {
    /// Ends the readers of a rig that was stopped before its first frame. They may not have been ready to receive the end
    /// of the stream.
    pub(super) fn end_idle_readers(&self) -> Result<(), Failure> {
        if self.draining.is_none() || !self.have_cameras_ended() {
            return Ok(());
        }
        for group in &self.groups {
            let (_, newest) = NewestFrameFile::open(&group.bus.private_file(Role::Acquire.as_str()))?;
            if newest.is_some() {
                return Ok(());
            }
        }
        self.end_processes(|_| true);
        Ok(())
    }
}
