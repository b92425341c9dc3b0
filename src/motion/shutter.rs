//! The timing of a camera's shutter.

/// The timing of a frame's rows.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Shutter {
    /// The delay of each row after the one above it, frame periods: 0 for a global shutter, negative where it rolls
    /// upwards.
    pub row_time_frames: f64,
    /// The row that is exposed at the frame's stamp.
    pub first_row_px: f64,
    /// The last column and row of the image, where they are known, px.
    pub last_px: Option<[f64; 2]>,
}

impl Shutter {
    /// Returns the shutter for images of this size; one that rolls upwards begins with the last row.
    ///
    /// Rows above that the camera leaves out shift all moments alike, and nothing else.
    #[must_use]
    pub fn over(self, size_px: [u32; 2]) -> Self {
        let last_px = size_px.map(|length_px| f64::from(length_px.saturating_sub(1)));
        let first_row_px = if self.row_time_frames < 0.0 { last_px[1] } else { 0.0 };
        Self { first_row_px, last_px: Some(last_px), ..self }
    }
}
