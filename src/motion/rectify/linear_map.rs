//! Linear maps of the plane: 2 x 2 matrices, row by row.

/// Returns the determinant of a linear map.
pub(super) fn determinant(matrix: &[[f64; 2]; 2]) -> f64 {
    let [[a, b], [c, d]] = matrix;
    a * d - b * c
}

/// Returns the image of a vector under a linear map.
pub(super) fn multiply(matrix: &[[f64; 2]; 2], vector: [f64; 2]) -> [f64; 2] {
    matrix.map(|row| row[0] * vector[0] + row[1] * vector[1])
}

/// Solves `matrix` x = `right`. The result is not finite for a singular matrix.
pub(super) fn solve_linear(matrix: &[[f64; 2]; 2], right: [f64; 2]) -> [f64; 2] {
    let (det, [[a, b], [c, d]]) = (determinant(matrix), *matrix);
    [(d * right[0] - b * right[1]) / det, (a * right[1] - c * right[0]) / det]
}

/// Returns the minimum stretch of a linear map, its smaller singular value, and the mean one, the root of its
/// determinant.
pub(super) fn stretch(matrix: &[[f64; 2]; 2]) -> (f64, f64) {
    let squares: f64 = matrix.iter().flatten().map(|x| x * x).sum();
    let det = determinant(matrix).abs();
    let root = (0.25 * squares * squares - det * det).max(0.0).sqrt();
    ((0.5 * squares - root).max(0.0).sqrt(), det.sqrt())
}

/// Returns the rotation in a linear map that preserves handedness, counter-clockwise on the screen, rad.
pub(super) fn rotation_rad(matrix: &[[f64; 2]; 2]) -> f64 {
    let [[a, b], [c, d]] = matrix;
    (b - c).atan2(a + d)
}

/// Returns the inverse of the similarity nearest to a linear map: of its rotation, or reflection, and its `size`.
pub(super) fn inverse_similarity(matrix: &[[f64; 2]; 2], size: f64) -> [[f64; 2]; 2] {
    let [[a, b], [c, d]] = *matrix;
    // The nearest rotation, or the nearest reflection where the plane's axes have the other handedness.
    let sign = determinant(matrix).signum();
    let (cos, sin) = (a + sign * d, c - sign * b);
    let length = cos.hypot(sin);
    let (cos, sin) = (cos / length, sin / length);
    [[cos / size, sin / size], [-sign * sin / size, sign * cos / size]]
}

/// Returns the Jacobian of a map of the plane at a point, by central differences over `h` to both sides. Rows are the
/// outputs.
pub(super) fn numerical_jacobian(map: impl Fn([f64; 2]) -> [f64; 2], at: [f64; 2], h: f64) -> [[f64; 2]; 2] {
    let [x, y] = at;
    let (right, left, down, up) = (map([x + h, y]), map([x - h, y]), map([x, y + h]), map([x, y - h]));
    std::array::from_fn(|k| [(right[k] - left[k]) / (2.0 * h), (down[k] - up[k]) / (2.0 * h)])
}
