//! Films of every container, made by ffmpeg and changed by hand: times, geometry, grey levels, repeats.

mod geometry;
mod hostile;
mod levels;
mod maker;
mod matrix;
mod repeats;
pub mod scene;
mod times;

pub use maker::{Film, has_ffmpeg, patched_matrix};
