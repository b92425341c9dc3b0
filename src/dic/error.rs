//! Errors of planning a correlator.

use crate::failure::{ExitCode, Fatal};

/// The reason why a correlator cannot be planned.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CorrelationError {
    /// A parameter lies outside its range.
    #[error("correlation.{key} is {value}, allowed: {range}")]
    Parameter {
        /// The key of the configuration.
        key: &'static str,
        /// The value given.
        value: String,
        /// The values allowed.
        range: String,
    },
    /// The image has no room for one subset.
    #[error("correlation.subset_size_px is {subset_size_px}, larger than the image of {width_px} x {height_px} px")]
    SubsetLargerThanImage {
        /// The full width of the subset, px.
        subset_size_px: u32,
        /// The width of the image, px.
        width_px: usize,
        /// The height of the image, px.
        height_px: usize,
    },
}

impl Fatal for CorrelationError {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Usage
    }
}
