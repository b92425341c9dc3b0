//! Progress bars on standard error, hidden when that is not a terminal.

use indicatif::{ProgressBar, ProgressStyle};

/// Returns a bar over `total` frames with a label of at most 10 characters in front.
pub fn frame_bar(total: u64, label: &'static str) -> ProgressBar {
    bar(total, label, "{prefix:10} [{bar:40}] {pos}/{len} frames, {per_sec}, {eta} left")
}

/// Returns a bar over `total` parts of unequal duration; it shows a percentage only.
pub fn part_bar(total: u64, label: &'static str) -> ProgressBar {
    bar(total, label, "{prefix:10} [{bar:40}] {percent} %, {elapsed} so far")
}

/// Returns a bar with a label in front, drawn by a template of indicatif.
fn bar(total: u64, label: &'static str, template: &str) -> ProgressBar {
    let bar = ProgressBar::new(total);
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.with_prefix(label)
}
