//! One page that tells a shot to someone who was not there.
//!
//! A single HTML file: style, curves (SVG) and pictures (PNG) are inside it, nothing is asked of the network. It
//! follows the reader's light or dark setting and prints on white. Several recordings give a page on how well
//! their numbers repeat.
//!
//! The curves are written as SVG here rather than by a plotting crate: their colours come from the page's style
//! sheet, so one drawing serves the light, the dark and the printed page.

mod base64;
mod chart;
mod check;
mod curves;
mod figure;
mod number;
mod page;
mod picture;
mod repeat;
mod shot;
mod snapshot;
mod spread;

pub use check::{CheckPicture, CheckRow, check_page};
pub use figure::{Beside, Experiment, Figure, figures};
pub use shot::{Shot, last_revisions};

/// The page of these recordings: the story of one, or how well several repeat.
pub fn page(shots: &[Shot]) -> String {
    match shots {
        [shot] => page::of_one(shot),
        _ => repeat::of_several(shots),
    }
}
