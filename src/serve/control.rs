//! Control of the rig: requests to it, and the one page among several that may make them.

use crate::bus::{Bus, BusError};
use crate::message::{Command, Reply};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Time for the rig to answer.
const REPLY_TIMEOUT: Duration = Duration::from_secs(2);

/// Returns the name that a page has given itself; `None` unless it has 1 to 32 of `a-z 0-9`.
pub(super) fn parse_page_name(name: &str) -> Option<&str> {
    let is_plain = name.bytes().all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit());
    (is_plain && (1..=32).contains(&name.len())).then_some(name)
}

/// The pages that are open, and the one that holds control.
#[derive(Debug, Default)]
struct Pages {
    /// The page that holds control.
    holder: Option<String>,
    /// The number of connections of each page.
    open: BTreeMap<String, u32>,
}

/// The right to control the rig. The first page has it, and any page can take it over.
///
/// Programs without the name of a page are not limited by it, as `ricochet arm` is not.
#[derive(Debug, Clone, Default)]
pub(super) struct Control(Arc<Mutex<Pages>>);

/// An open connection of a page; the page is gone when its last one is dropped.
#[derive(Debug)]
pub(super) struct OpenPage {
    control: Control,
    page: String,
}

impl Control {
    /// Locks the list of pages.
    fn lock_pages(&self) -> MutexGuard<'_, Pages> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the name of the page that holds control, if any does.
    pub(super) fn holder(&self) -> Option<String> {
        self.lock_pages().holder.clone()
    }

    /// Adds a connection of a page, which takes control if no page has it.
    pub(super) fn open(&self, page: &str) -> OpenPage {
        let mut pages = self.lock_pages();
        *pages.open.entry(page.to_owned()).or_insert(0) += 1;
        pages.holder.get_or_insert_with(|| page.to_owned());
        OpenPage { control: self.clone(), page: page.to_owned() }
    }

    /// Gives control to a page, also if another one has it.
    pub(super) fn give_control(&self, page: &str) {
        self.lock_pages().holder = Some(page.to_owned());
    }

    /// Takes control for a page unless another one has it. Returns whether the page has control now.
    pub(super) fn take_control_if_free(&self, page: &str) -> bool {
        self.lock_pages().holder.get_or_insert_with(|| page.to_owned()) == page
    }
}

impl Drop for OpenPage {
    fn drop(&mut self) {
        let mut pages = self.control.lock_pages();
        let remaining = pages.open.get_mut(&self.page).map(|count| {
            *count -= 1;
            *count
        });
        if remaining == Some(0) {
            pages.open.remove(&self.page);
            pages.holder.take_if(|holder| *holder == self.page);
        }
    }
}

/// Sends a request to the rig; `None` if it does not answer. It blocks for up to two seconds.
///
/// # Errors
///
/// [`BusError::NoRig`] when the rig does not run, another [`BusError`] when shared memory cannot be used.
pub(super) fn ask(rig: &str, command: Command) -> Result<Option<Reply>, BusError> {
    Bus::join(rig, "serve")?.control_client()?.ask(command, REPLY_TIMEOUT)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_page_holds_control_until_it_is_gone_or_another_takes_it() {
        let control = Control::default();
        let first = control.open("a");
        let again = control.open("a");
        let second = control.open("b");
        assert_eq!((control.take_control_if_free("a"), control.take_control_if_free("b")), (true, false));
        control.give_control("b");
        assert_eq!((control.take_control_if_free("a"), control.take_control_if_free("b")), (false, true));
        drop(second);
        assert_eq!(control.holder(), None);
        assert!(control.take_control_if_free("a"));
        drop(first);
        assert_eq!(control.holder().as_deref(), Some("a"), "one connection is left");
        drop(again);
        assert_eq!(control.holder(), None);
    }
}
