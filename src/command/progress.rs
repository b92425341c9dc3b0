//! Bars for work that takes a while; nothing when nobody looks.

use indicatif::{ProgressBar, ProgressStyle};

/// A bar over `total` frames on standard error, hidden when that is not a terminal.
pub fn frames(total: u64, what: &'static str) -> ProgressBar {
    bar(total, what, "{prefix:10} [{bar:40}] {pos}/{len} frames, {per_sec}, {eta} left")
}

/// A bar over `total` parts that do not all take the same time, so only their share is told.
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
