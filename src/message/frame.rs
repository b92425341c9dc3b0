//! The header of a frame in the ring; the payload is its pixels.

use super::layout::described;
use crate::image::{FrameMeta, PixelFormat};
use iceoryx2::prelude::ZeroCopySend;

described! {
    "ricochet.FrameHeader.v1"
    /// The header in front of the pixels of each frame: 64 bytes, aligned to 64.
    ///
    /// # Examples
    ///
    /// ```
    /// use ricochet::message::FrameHeader;
    /// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
    ///
    /// let meta = recording.first_frame()?;
    /// let header = FrameHeader::new(&meta, 0, 20.0);
    /// assert_eq!(header.exposure_ns, 20_000);
    /// // `None` for a pixel format that this version does not know.
    /// assert_eq!(header.meta(), Some(meta));
    /// assert_eq!(FrameHeader { pixel_format: 0, ..header }.meta(), None);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ZeroCopySend)]
    #[repr(C)]
    #[repr(align(64))]
    pub struct FrameHeader {
        /// Counts the camera's frames, lost ones included; a jump is a loss.
        pub sequence: u64,
        /// The start of the exposure, ns since the Unix epoch.
        pub stamp_ns: u64,
        /// The camera's own clock at the start of the exposure, ns; 0 when it has none.
        pub device_ns: u64,
        /// The start of the acquire process that this frame belongs to.
        pub run_id: u64,
        /// The number of pixels per row.
        pub width_px: u32,
        /// The number of rows.
        pub height_px: u32,
        /// The number of bytes from one row to the next.
        pub stride_bytes: u32,
        /// The GenICam code of the pixel format.
        pub pixel_format: u32,
        /// Raised each time the camera is opened again.
        pub epoch: u32,
        /// The exposure time, ns; 0 when it is unknown. Longer times are clipped to the maximum.
        pub exposure_ns: u32,
        /// The shot of a camera with a hardware trigger, counted from 1; 0 for other cameras. Nothing is measured from one shot to
        /// the next.
        pub shot: u32,
        /// Zero.
        pub reserved: u32,
    }
}

const _: () = assert!(size_of::<FrameHeader>() == 64 && align_of::<FrameHeader>() == 64);

impl FrameHeader {
    /// Creates the header of a frame of this run, of no shot (0).
    ///
    /// `exposure_us` is the exposure time, us; 0 if it is unknown.
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

    /// Returns the metadata of the frame; `None` when the pixel format is unknown.
    pub fn meta(&self) -> Option<FrameMeta> {
        Some(FrameMeta {
            sequence: self.sequence,
            epoch: self.epoch,
            stamp_ns: self.stamp_ns,
            device_ns: self.device_ns,
            width_px: self.width_px,
            height_px: self.height_px,
            stride_bytes: self.stride_bytes,
            format: PixelFormat::from_number(self.pixel_format)?,
        })
    }
}
