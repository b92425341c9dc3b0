//! The end of a rig that was stopped before its first frame.

use super::Supervisor;
use crate::config::Source;
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
        if !self.has_filmed()? {
            self.end_processes(|_| true);
        }
        Ok(())
    }

    /// Kills the processes of a rig that was stopped before its first frame, if it has no camera that must be closed in
    /// order; returns whether it did. They have nothing to finish, and their start can take seconds on a busy machine.
    pub(super) fn kill_before_first_frame(&mut self) -> Result<bool, Failure> {
        let has_device = self.groups.iter().any(|group| group.config.camera.source.is_some_and(Source::is_device));
        if has_device || self.has_filmed()? {
            return Ok(false);
        }
        // The sources first: one that has just begun to film leaves frames that the others finish.
        self.kill_processes(|child| child.role == Role::Acquire);
        if self.has_filmed()? {
            self.end_processes(|child| child.role != Role::Serve);
        } else {
            self.kill_processes(|child| child.role != Role::Serve);
        }
        Ok(true)
    }

    /// Whether a camera of the rig has taken a frame.
    fn has_filmed(&self) -> Result<bool, Failure> {
        for group in &self.groups {
            let (_, newest) = NewestFrameFile::open(&group.bus.private_file(Role::Acquire.as_str()))?;
            if newest.is_some() {
                return Ok(true);
            }
        }
        Ok(false)
    }
}
