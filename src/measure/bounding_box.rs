//! Bounding boxes of bodies in a frame.

use crate::results::Circle;

/// The margin around matched pixels for interpolation and the warp, px.
const MARGIN_PX: f64 = 6.0;

/// A rectangle around some bodies, px; empty at first.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct BoundingBox {
    /// Left, top, right and bottom; the last two lie outside.
    bounds: Option<[f64; 4]>,
}

impl BoundingBox {
    /// Includes a body that is searched within `range_px` of this circle.
    pub(super) fn include_search(&mut self, circle: &Circle, range_px: f64) {
        self.include(circle, range_px + MARGIN_PX);
    }

    /// Includes everything within `range_px` of a circle.
    pub(super) fn include(&mut self, circle: &Circle, range_px: f64) {
        let reach = circle.radius_px + range_px;
        let [left, top, right, bottom] =
            [circle.x_px - reach, circle.y_px - reach, circle.x_px + reach + 1.0, circle.y_px + reach + 1.0];
        let old = self.bounds.unwrap_or([f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY]);
        self.bounds = Some([old[0].min(left), old[1].min(top), old[2].max(right), old[3].max(bottom)]);
    }

    /// Whether the box includes no body.
    pub(super) fn is_empty(&self) -> bool {
        self.bounds.is_none()
    }

    /// Whether another box lies within this one; an empty box lies within every box.
    pub(super) fn contains(&self, other: &Self) -> bool {
        match (self.rectangle(), other.rectangle()) {
            (_, [_, _, 0, 0]) => true,
            ([x, y, w, h], [ox, oy, ow, oh]) => ox >= x && oy >= y && ox + ow <= x + w && oy + oh <= y + h,
        }
    }

    /// Returns x, y, width and height in whole pixels, all 0 for an empty box.
    ///
    /// It is cut at the left and upper edges of the frame, and may exceed the others.
    pub(super) fn rectangle(&self) -> [u32; 4] {
        let Some([left, top, right, bottom]) = self.bounds else { return [0; 4] };
        // The conversion to integers saturates, so nothing wraps around, whatever the circle is.
        let (x, y) = (left.floor() as u32, top.floor() as u32);
        let (right, bottom) = (right.ceil() as u32, bottom.ceil() as u32);
        [x, y, right.saturating_sub(x), bottom.saturating_sub(y)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn circle(x_px: f64, y_px: f64, radius_px: f64) -> Circle {
        let (sigma_center_px, sigma_radius_px, visible_fraction) = (0.01, 0.01, 1.0);
        Circle { x_px, y_px, radius_px, sigma_center_px, sigma_radius_px, visible_fraction }
    }

    #[test]
    fn a_box_contains_every_body_with_its_range_and_is_cut_at_zero() {
        let mut frame = BoundingBox::default();
        assert!(frame.is_empty());
        assert_eq!(frame.rectangle(), [0, 0, 0, 0]);
        frame.include_search(&circle(100.5, 60.0, 20.0), 8.0);
        assert_eq!(frame.rectangle(), [66, 26, 70, 69]);
        frame.include_search(&circle(10.0, 60.0, 20.0), 8.0);
        assert_eq!(frame.rectangle(), [0, 26, 136, 69]);
    }

    #[test]
    fn a_box_contains_what_lies_in_it_and_nothing_more() {
        let (mut frame, mut inner, mut outer) =
            (BoundingBox::default(), BoundingBox::default(), BoundingBox::default());
        frame.include_search(&circle(100.0, 100.0, 20.0), 8.0);
        inner.include_search(&circle(103.0, 95.0, 20.0), 0.0);
        outer.include_search(&circle(110.0, 100.0, 20.0), 0.0);
        assert!(frame.contains(&inner) && frame.contains(&BoundingBox::default()) && !frame.contains(&outer));
        assert!(!BoundingBox::default().contains(&inner));
    }
}
