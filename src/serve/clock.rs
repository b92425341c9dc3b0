//! The clock of the page. It decides when states are shown, never what is measured.

use std::time::Instant;

/// Returns the present time.
#[expect(clippy::disallowed_methods, reason = "decides when the page is updated, never what is measured")]
pub(super) fn now() -> Instant {
    Instant::now()
}
