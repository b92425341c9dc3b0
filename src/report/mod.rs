//! Reports: one HTML page about a shot, about the repeatability of several, or about a rig check.
//!
//! A page is a single HTML file. Style sheet, curves (SVG) and pictures (PNG) are inside it, so it asks nothing of the
//! network. It follows the light or dark setting of the reader and prints on white.
//!
//! The curves are our own SVG rather than the output of a plotting crate: their colours come from the style sheet of
//! the page, so one drawing serves the light, the dark and the printed page.

mod check;
mod curves;
mod diagnosis;
mod page;
mod paper_figures;
mod picture;
mod quantities;
mod repeat;
mod shot;
mod snapshot;
mod spread;

pub use check::{CheckPicture, CheckRow, check_page};
pub use diagnosis::{BodyDiagnosis, Change, Diagnosis, FrameDiagnosis, Panel, diagnosis_page};
pub use page::date;
pub use paper_figures::{Comparison, Experiment, Figure, figures};
pub use shot::{MeasuredBody, Shot, last_revisions};
pub use spread::Spread;

/// Returns the page of one shot, or of the repeatability of several.
pub fn page(shots: &[Shot]) -> String {
    match shots {
        [shot] => page::shot_page(shot),
        _ => repeat::repeatability_page(shots),
    }
}
