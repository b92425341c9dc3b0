//! What a correlator refuses.

/// Why a correlator cannot be planned.
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
        /// Full width of the subset, px.
        subset_size_px: u32,
        /// Width of the image, px.
        width_px: usize,
        /// Height of the image, px.
        height_px: usize,
    },
}
