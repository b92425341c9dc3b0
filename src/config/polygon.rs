//! The geometry of polygons that are drawn on a frame.

/// A point of a frame, (x, y) in px.
pub(super) type Point = [f64; 2];

/// Returns the sides of a polygon.
fn sides(corners: &[Point]) -> impl Iterator<Item = [Point; 2]> + Clone {
    corners.iter().zip(corners.iter().cycle().skip(1)).map(|(from, to)| [*from, *to])
}

/// Whether two sides of a polygon that are no neighbours cross or touch.
pub(super) fn is_self_intersecting(corners: &[Point]) -> bool {
    let count = corners.len();
    let mut pairs = sides(corners).enumerate().flat_map(|(k, side)| {
        sides(corners)
            .enumerate()
            .skip(k + 2)
            .filter(move |(l, _)| (l + 1) % count != k)
            .map(move |(_, other)| [side, other])
    });
    pairs.any(|[one, other]| segments_touch(one, other))
}

/// Twice the area of the triangle of three points, px^2, negative in one direction of rotation.
fn twice_area([a, b]: [Point; 2], c: Point) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Whether two sides have a point in common.
fn segments_touch(one: [Point; 2], other: [Point; 2]) -> bool {
    let is_apart = |axis: usize| {
        let range = |side: [Point; 2]| [side[0][axis].min(side[1][axis]), side[0][axis].max(side[1][axis])];
        let ([low, high], [other_low, other_high]) = (range(one), range(other));
        high < other_low || other_high < low
    };
    let is_divided = |line: [Point; 2], side: [Point; 2]| twice_area(line, side[0]) * twice_area(line, side[1]) <= 0.0;
    !is_apart(0) && !is_apart(1) && is_divided(one, other) && is_divided(other, one)
}

/// Whether a point is inside a polygon or on one of its sides.
pub(super) fn is_in_polygon(point: Point, corners: &[Point]) -> bool {
    if sides(corners).any(|side| segments_touch(side, [point, point])) {
        return true;
    }
    // A ray to the left crosses the sides of a polygon around the point an odd number of times.
    let is_crossed = |[from, to]: [Point; 2]| {
        let is_across = (from[1] > point[1]) != (to[1] > point[1]);
        is_across && from[0] + (point[1] - from[1]) * (to[0] - from[0]) / (to[1] - from[1]) < point[0]
    };
    sides(corners).filter(|side| is_crossed(*side)).count() % 2 == 1
}
