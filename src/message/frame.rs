//! Header of a frame in the ring; the payload is its bytes.

use crate::image::{FrameMeta, PixelFormat};
use iceoryx2::prelude::ZeroCopySend;

/// What stands before the pixels of every frame: 64 bytes, aligned to 64.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ZeroCopySend)]
#[type_name("ricochet.FrameHeader.v1")]
#[repr(C)]
#[repr(align(64))]
pub struct FrameHeader {
    /// Counts the camera's frames, lost ones included; a jump is a loss.
    pub sequence: u64,
    /// Exposure start, ns since the Unix epoch.
    pub stamp_ns: u64,
    /// The camera's own clock at exposure start, ns; 0 when it has none.
    pub device_ns: u64,
    /// Which start of the acquire process this frame belongs to.
    pub run_id: u64,
    /// Pixels a row.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Bytes from one row to the next.
    pub stride_bytes: u32,
    /// GenICam pixel format code.
    pub pixel_format: u32,
    /// Raised each time the camera is opened anew.
    pub epoch: u32,
    /// How long the frame was exposed, ns; 0 when the camera does not tell. The largest value stands for more.
    pub exposure_ns: u32,
    /// Which shot of a camera that waits for its line, counted from 1; 0 of others. Nothing is measured from a shot to
    /// the next.
    pub shot: u32,
    /// Zero.
    pub reserved: u32,
}

const _: () = assert!(size_of::<FrameHeader>() == 64 && align_of::<FrameHeader>() == 64);

impl FrameHeader {
    /// The header of a frame of this run, exposed for so long (0: not known).
    pub fn new(meta: &FrameMeta, run_id: u64, exposure_us: f64) -> Self {
        Self {
            sequence: meta.sequence,
            stamp_ns: meta.stamp_ns,
            device_ns: meta.device_ns,
            run_id,
            width_px: meta.width_px,
            height_px: meta.height_px,
            stride_bytes: meta.stride_bytes,
            pixel_format: meta.format as u32,
            epoch: meta.epoch,
            // A conversion from a float saturates.
            exposure_ns: (1.0e3 * exposure_us).round() as u32,
            shot: 0,
            reserved: 0,
        }
    }

    /// What it says of the frame; `None` when the pixel format is not one of ours.
    pub fn meta(&self) -> Option<FrameMeta> {
        Some(FrameMeta {
            sequence: self.sequence,
            epoch: self.epoch,
            stamp_ns: self.stamp_ns,
            device_ns: self.device_ns,
            width_px: self.width_px,
            height_px: self.height_px,
            stride_bytes: self.stride_bytes,
            format: PixelFormat::from_code(self.pixel_format)?,
        })
    }
}
