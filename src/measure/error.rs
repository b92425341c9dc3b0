//! Errors of a measurement.

use crate::ball::BallError;
use crate::dic::CorrelationError;
use crate::failure::{ExitCode, Fatal};
use crate::image::{DefectError, ShapeError};
use crate::rod::RodError;

/// The reason why frames cannot be measured.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MeasureError {
    /// The settings of the correlator are refused.
    #[error(transparent)]
    Correlation(#[from] CorrelationError),
    /// The settings of the ball finder are refused.
    #[error(transparent)]
    Ball(#[from] BallError),
    /// The settings of the rod finder are refused.
    #[error(transparent)]
    Rod(#[from] RodError),
    /// A defective pixel cannot be filled in.
    #[error("camera.defective_px: {0}")]
    Defect(#[from] DefectError),
    /// A frame has fewer bytes than its header says.
    #[error("frame {sequence}: {source}")]
    Frame {
        /// The sequence number of the frame.
        sequence: u64,
        /// The mismatch.
        source: ShapeError,
    },
    /// The size of a frame differs from that of the stream.
    #[error(
        "frame {sequence} is {width_px} x {height_px} px in a stream of {expected_width_px} x {expected_height_px}"
    )]
    Size {
        /// The sequence number of the frame.
        sequence: u64,
        /// The width of the frame.
        width_px: u32,
        /// The height of the frame.
        height_px: u32,
        /// The width of the stream.
        expected_width_px: usize,
        /// The height of the stream.
        expected_height_px: usize,
    },
}

impl Fatal for MeasureError {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Usage
    }
}
