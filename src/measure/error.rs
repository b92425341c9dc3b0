//! Why frames cannot be measured.

use crate::ball::BallError;
use crate::dic::CorrelationError;
use crate::image::{DefectError, ShapeError};
use crate::rod::RodError;

/// Why frames cannot be measured.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MeasureError {
    /// The correlator refuses its settings.
    #[error(transparent)]
    Correlation(#[from] CorrelationError),
    /// The ball finder refuses its settings.
    #[error(transparent)]
    Ball(#[from] BallError),
    /// The rod finder refuses its settings.
    #[error(transparent)]
    Rod(#[from] RodError),
    /// A pixel that does not see cannot be filled in.
    #[error("camera.defective_px: {0}")]
    Defect(#[from] DefectError),
    /// A frame has fewer bytes than its header says.
    #[error("frame {sequence}: {source}")]
    Frame {
        /// The frame.
        sequence: u64,
        /// What is wrong with it.
        source: ShapeError,
    },
    /// A frame has another size than the stream.
    #[error(
        "frame {sequence} is {width_px} x {height_px} px in a stream of {expected_width_px} x {expected_height_px}"
    )]
    Size {
        /// The frame.
        sequence: u64,
        /// Its width.
        width_px: u32,
        /// Its height.
        height_px: u32,
        /// The stream's width.
        expected_width_px: usize,
        /// The stream's height.
        expected_height_px: usize,
    },
}
