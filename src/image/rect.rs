//! Rectangles of whole pixels.

use std::ops::Range;

/// A rectangle of pixels; `right` and `bottom` lie outside.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PixelRect {
    /// The first column.
    pub left: u32,
    /// The first row.
    pub top: u32,
    /// The column behind the last.
    pub right: u32,
    /// The row behind the last.
    pub bottom: u32,
}

impl PixelRect {
    /// Returns the rectangle of a complete image, px.
    pub fn whole(width: u32, height: u32) -> Self {
        Self { left: 0, top: 0, right: width, bottom: height }
    }

    /// Returns its columns.
    pub fn columns(self) -> Range<usize> {
        self.left as usize..self.right as usize
    }

    /// Returns its rows.
    pub fn rows(self) -> Range<usize> {
        self.top as usize..self.bottom as usize
    }

    /// Whether the rectangle has no pixel.
    pub fn is_empty(self) -> bool {
        self.left >= self.right || self.top >= self.bottom
    }

    /// Whether `other` lies within this rectangle.
    pub fn contains(self, other: Self) -> bool {
        self.left <= other.left && self.top <= other.top && self.right >= other.right && self.bottom >= other.bottom
    }

    /// Moves each edge outwards by `px`, but not beyond 0.
    pub fn grown(self, px: u32) -> Self {
        Self {
            left: self.left.saturating_sub(px),
            top: self.top.saturating_sub(px),
            right: self.right.saturating_add(px),
            bottom: self.bottom.saturating_add(px),
        }
    }

    /// Returns the common part of both rectangles, an empty rectangle if they have none.
    pub fn clipped(self, other: Self) -> Self {
        let (right, bottom) = (self.right.min(other.right), self.bottom.min(other.bottom));
        Self { left: self.left.max(other.left).min(right), top: self.top.max(other.top).min(bottom), right, bottom }
    }

    /// Returns the smallest rectangle around both. An empty one counts with its edges.
    pub fn union(self, other: Self) -> Self {
        Self {
            left: self.left.min(other.left),
            top: self.top.min(other.top),
            right: self.right.max(other.right),
            bottom: self.bottom.max(other.bottom),
        }
    }
}

impl From<[u32; 4]> for PixelRect {
    /// Reads x, y, width and height, as rig files give them.
    fn from([left, top, width, height]: [u32; 4]) -> Self {
        Self { left, top, right: left.saturating_add(width), bottom: top.saturating_add(height) }
    }
}
