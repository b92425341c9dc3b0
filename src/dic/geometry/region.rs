//! Regions of interest: the pixels that belong to a body.

/// A region of an image; a pixel belongs if its centre does.
#[derive(Debug, Clone, PartialEq)]
pub enum Region {
    /// A disc.
    Disc {
        /// The x coordinate of the centre, px.
        x_px: f64,
        /// The y coordinate of the centre, px.
        y_px: f64,
        /// The radius, px.
        radius_px: f64,
    },
    /// A disc without its centre part.
    Ring {
        /// The x coordinate of the centre, px.
        x_px: f64,
        /// The y coordinate of the centre, px.
        y_px: f64,
        /// The inner radius, px.
        inner_px: f64,
        /// The outer radius, px.
        outer_px: f64,
    },
    /// The inside of a polygon without its holes.
    Polygon {
        /// The corners (x, y) in px, in either direction.
        outline_px: Vec<[f64; 2]>,
        /// The corners of each hole, px.
        holes_px: Vec<Vec<[f64; 2]>>,
    },
}

impl Region {
    /// Whether the point (x, y), in px, belongs.
    #[inline]
    pub fn contains(&self, x: f64, y: f64) -> bool {
        match self {
            Self::Disc { x_px, y_px, radius_px } => {
                *radius_px >= 0.0 && squared_length(x - x_px, y - y_px) <= radius_px * radius_px
            }
            Self::Ring { x_px, y_px, inner_px, outer_px } => {
                let reach = squared_length(x - x_px, y - y_px);
                *outer_px >= 0.0 && reach <= outer_px * outer_px && !(*inner_px > 0.0 && reach < inner_px * inner_px)
            }
            Self::Polygon { outline_px, holes_px } => {
                encloses(outline_px, x, y) && !holes_px.iter().any(|hole| encloses(hole, x, y))
            }
        }
    }

    /// Whether every point of the rectangle left, top, right, bottom, in px, is known to belong.
    ///
    /// Always false for shapes other than a disc: callers then test each pixel.
    pub fn contains_rectangle(&self, [left, top, right, bottom]: [f64; 4]) -> bool {
        // A disc is convex. For other shapes the corners are not sufficient.
        let corners = [(left, top), (right, top), (left, bottom), (right, bottom)];
        matches!(self, Self::Disc { .. }) && corners.into_iter().all(|(x, y)| self.contains(x, y))
    }

    /// Returns the fraction of a square of `size_px` for which the region has room; less than 1 if it is narrower.
    pub fn room_fraction(&self, size_px: u32) -> f64 {
        let part = |length: f64| (length / f64::from(size_px)).min(1.0);
        self.bounds_px().map_or(1.0, |[left, top, right, bottom]| part(right - left) * part(bottom - top))
    }

    /// Returns the bounding box: left, top, right and bottom, px; `None` for an empty region or one that is not finite.
    pub fn bounds_px(&self) -> Option<[f64; 4]> {
        let bounds = match self {
            Self::Disc { x_px, y_px, radius_px: r } | Self::Ring { x_px, y_px, outer_px: r, .. } => {
                [x_px - r, y_px - r, x_px + r, y_px + r]
            }
            Self::Polygon { outline_px, .. } => {
                let start = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
                outline_px.iter().fold(start, |b, [x, y]| [b[0].min(*x), b[1].min(*y), b[2].max(*x), b[3].max(*y)])
            }
        };
        let sound = bounds.iter().all(|bound| bound.is_finite()) && bounds[0] <= bounds[2] && bounds[1] <= bounds[3];
        sound.then_some(bounds)
    }
}

/// Returns the squared length of a vector.
fn squared_length(x: f64, y: f64) -> f64 {
    x * x + y * y
}

/// Whether a closed polygon encloses the point (x, y): a ray to the right crosses it an odd number of times.
///
/// `corners` follow each other in either direction. A polygon without corners encloses nothing.
fn encloses(corners: &[[f64; 2]], x: f64, y: f64) -> bool {
    let mut inside = false;
    let Some(mut before) = corners.last() else { return false };
    for corner in corners {
        let (a, b) = (before, corner);
        if (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) {
            inside = !inside;
        }
        before = corner;
    }
    inside
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_polygon_ends_at_its_outline_and_at_its_holes() {
        let square = |low: f64, high: f64| vec![[low, low], [high, low], [high, high], [low, high]];
        let region = Region::Polygon { outline_px: square(0.0, 10.0), holes_px: vec![square(4.0, 6.0)] };
        assert!(region.contains(1.0, 9.0) && region.contains(3.9, 5.0));
        assert!(!region.contains(5.0, 5.0) && !region.contains(10.5, 5.0) && !region.contains(5.0, -0.1));
        assert_eq!(region.bounds_px(), Some([0.0, 0.0, 10.0, 10.0]));
        assert_eq!(Region::Polygon { outline_px: vec![], holes_px: vec![] }.bounds_px(), None);
    }

    #[test]
    fn a_disc_holds_what_its_corners_lie_in() {
        let disc = Region::Disc { x_px: 5.0, y_px: 5.0, radius_px: 5.0 };
        assert!(disc.contains_rectangle([2.0, 1.0, 8.0, 9.0]) && !disc.contains_rectangle([2.0, 0.9, 8.0, 9.0]));
        let ring = Region::Ring { x_px: 5.0, y_px: 5.0, inner_px: 1.0, outer_px: 5.0 };
        assert!(!ring.contains_rectangle([2.0, 1.0, 8.0, 9.0]));
    }

    #[test]
    fn a_ring_has_no_middle() {
        let ring = Region::Ring { x_px: 5.0, y_px: 5.0, inner_px: 2.0, outer_px: 4.0 };
        assert!(ring.contains(8.0, 5.0) && !ring.contains(5.0, 6.0) && !ring.contains(9.5, 5.0));
    }
}
