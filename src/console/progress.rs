//! Progress bars on standard error, hidden when that is not a terminal.

pub use indicatif::ProgressBar as Bar;
use indicatif::{ProgressBar, ProgressFinish, ProgressStyle};
use std::io::IsTerminal;

/// The line of a bar: label, bar, share and the time that is left. It fills the terminal, and fits 40 columns.
const TEMPLATE: &str = "{prefix:10} [{wide_bar}] {percent:>3} % {eta_precise} left";

/// Returns a bar over `total` frames or parts, with a label of at most 10 characters in front. It goes when it is dropped.
pub fn bar(total: u64, label: &'static str) -> ProgressBar {
    let bar = ProgressBar::new(total).with_finish(ProgressFinish::AndClear);
    if let Ok(style) = ProgressStyle::with_template(TEMPLATE) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.with_prefix(label)
}

/// Returns a bar as [`bar`] for work whose result goes to standard output. It is hidden when that is a terminal, so that the
/// two do not mix.
pub fn bar_of_output(total: u64, label: &'static str) -> ProgressBar {
    if std::io::stdout().is_terminal() { hidden() } else { bar(total, label) }
}

/// Returns a bar that is never drawn.
pub fn hidden() -> ProgressBar {
    ProgressBar::hidden()
}
