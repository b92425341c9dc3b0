//! Positions in images.

/// A position or an offset in an image, px.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Point {
    /// The x coordinate, px.
    pub x_px: f64,
    /// The y coordinate, px.
    pub y_px: f64,
}

impl Point {
    /// Returns the point at (`x_px`, `y_px`).
    pub fn new(x_px: f64, y_px: f64) -> Self {
        Self { x_px, y_px }
    }

    /// Returns the offset of this point from `origin`, px.
    pub(in crate::dic) fn relative_to(self, origin: Self) -> Self {
        Self::new(self.x_px - origin.x_px, self.y_px - origin.y_px)
    }
}

/// A pixel of the prepared part of a frame, or an offset by whole pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(in crate::dic) struct Pixel {
    pub(in crate::dic) x: i32,
    pub(in crate::dic) y: i32,
}

/// The size of an image, px.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(in crate::dic) struct Size {
    pub(in crate::dic) width: usize,
    pub(in crate::dic) height: usize,
}
