//! The correlator: plans a region, matches every subset of a frame pair, follows series of frames.

mod benchmark;
mod correlator;
mod predicted;
mod series;
mod subset_match;

pub use benchmark::KernelBenchmark;
pub use correlator::{Correlator, KeptReference, Start};
pub use series::Series;
