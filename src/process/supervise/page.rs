//! The operator's page of a rig. Its process is started, watched and replaced like the others, but loses no frames.

use super::child::{Child, Page};
use super::{Supervisor, frame_of};
use crate::config::Config;
use crate::failure::{ExitCode, Failure};
use crate::message::{EventKind, Role};
use std::process::ExitStatus;

/// The exit code of a process whose settings are refused, such as an address that is taken.
const REFUSED: i32 = ExitCode::Usage as i32;

/// Returns the process that serves the page of the rig; `None` if the supervisor serves none or the rig file turns it
/// off.
pub(super) fn page_process(config: &Config, page: Page) -> Option<Child> {
    let is_wanted = page == Page::Served && config.serve.http.is_some();
    is_wanted.then(|| Child::first(Role::Serve))
}

impl Supervisor<'_> {
    /// Replaces the process of the page after its death. The rig also runs without a page, and has lost nothing.
    pub(super) fn replace_page(&mut self, child: Child, status: ExitStatus) -> Result<(), Failure> {
        let last = self.statuses.remove(&child).unwrap_or_default();
        let Some(running) = self.children.get_mut(&child) else { return Ok(()) };
        // It has printed the reason of a refusal.
        if status.code() == Some(REFUSED) || !running.deaths.count_death() {
            running.code = status.code().or(Some(1));
            log::warn!("the page ended with {status}; the rig runs without it");
            return Ok(());
        }
        let text = format!("{} ended with {status} and was restarted", self.name(child));
        log::warn!("{text}");
        if let Some(running) = self.children.get_mut(&child) {
            running.waits_for_memory = true;
        }
        self.restarts += 1;
        self.reporter.publish_event(EventKind::Restarted, frame_of(&last), &text)?;
        self.restart_waiting()
    }
}
