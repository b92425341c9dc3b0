//! Progress bars on standard error, hidden when that is not a terminal.

use indicatif::{ProgressBar, ProgressStyle};

/// Returns a bar over `total` frames.
pub fn frames(total: u64, what: &'static str) -> ProgressBar {
    bar(total, what, "{prefix:10} [{bar:40}] {pos}/{len} frames, {per_sec}, {eta} left")
}

/// Returns a bar over `total` parts of unequal duration; it shows a percentage only.
pub fn parts(total: u64, what: &'static str) -> ProgressBar {
    bar(total, what, "{prefix:10} [{bar:40}] {percent} %, {elapsed} so far")
}

fn bar(total: u64, what: &'static str, template: &str) -> ProgressBar {
    let bar = ProgressBar::new(total);
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.with_prefix(what)
}
