//! A patch of a body: the pixels inside a polygon.

use super::region::Region;

/// A polygon drawn in one image.
#[derive(Debug, Clone, PartialEq)]
pub struct Patch {
    /// The corners in the reference image, px.
    pub outline_px: Vec<[f64; 2]>,
    /// The corners of its holes, px.
    pub holes_px: Vec<Vec<[f64; 2]>>,
    /// The point whose position and motion are reported, px in the reference image; the centroid if `None`.
    pub center_px: Option<[f64; 2]>,
}

impl Patch {
    /// Returns the region of its pixels.
    pub fn region(&self) -> Region {
        Region::Polygon { outline_px: self.outline_px.clone(), holes_px: self.holes_px.clone() }
    }

    /// Returns the area, px^2, and the centroid (x, y), px, of the outline less its holes.
    ///
    /// The centroid is NaN if the area is 0. Holes are assumed to lie inside, without overlap.
    pub fn area_and_centroid(&self) -> (f64, [f64; 2]) {
        let (area, [x, y]) = polygon_area_and_centroid(&self.outline_px);
        let (mut area, mut sums) = (area, [area * x, area * y]);
        for (hole, [x, y]) in self.holes_px.iter().map(|hole| polygon_area_and_centroid(hole)) {
            (area, sums) = (area - hole, [sums[0] - hole * x, sums[1] - hole * y]);
        }
        (area, sums.map(|sum| sum / area))
    }
}

/// Returns the area (px^2, positive in either direction) and the centroid (px) of a polygon by the shoelace formula.
///
/// The centroid of a polygon without area is its first corner; without corners both are 0. The sums are taken about
/// that corner to limit rounding.
fn polygon_area_and_centroid(corners: &[[f64; 2]]) -> (f64, [f64; 2]) {
    let Some(origin) = corners.first() else { return (0.0, [0.0; 2]) };
    let (mut twice, mut sums) = (0.0, [0.0; 2]);
    for (k, a) in corners.iter().enumerate() {
        let b = corners[(k + 1) % corners.len()];
        let (ax, ay, bx, by) = (a[0] - origin[0], a[1] - origin[1], b[0] - origin[0], b[1] - origin[1]);
        let cross = ax * by - bx * ay;
        twice += cross;
        sums = [sums[0] + cross * (ax + bx), sums[1] + cross * (ay + by)];
    }
    let center =
        if twice == 0.0 { *origin } else { [origin[0] + sums[0] / (3.0 * twice), origin[1] + sums[1] / (3.0 * twice)] };
    (0.5 * twice.abs(), center)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_patch_has_the_area_and_centroid_of_its_polygon_less_its_holes() {
        let square = |x: f64, y: f64, side: f64| vec![[x, y], [x + side, y], [x + side, y + side], [x, y + side]];
        let params = Patch { outline_px: square(10.0, 20.0, 30.0), holes_px: vec![], center_px: None };
        assert_eq!(params.area_and_centroid(), (900.0, [25.0, 35.0]));
        let hole = Patch { holes_px: vec![square(10.0, 20.0, 10.0)], ..params };
        let (area, [x, y]) = hole.area_and_centroid();
        assert!((area - 800.0).abs() < 1e-9 && (x - 26.25).abs() < 1e-9 && (y - 36.25).abs() < 1e-9);
        let mut backwards = hole;
        backwards.outline_px.reverse();
        assert!((backwards.area_and_centroid().0 - 800.0).abs() < 1e-9);
    }
}
