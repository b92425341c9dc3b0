//! Small symmetric positive definite systems.

use nalgebra::Matrix3;

/// The minimum ratio of a pivot to its diagonal element. Below, a matrix is singular to working precision.
const MIN_PIVOT: f64 = 1e-7;

/// Returns the inverse of the leading `n` x `n` part of a symmetric positive definite matrix, 0 outside that part.
///
/// The half of `matrix` below the diagonal is not read. Returns `None` if the matrix is singular to working precision,
/// independent of units.
pub fn invert<const M: usize>(matrix: &[[f64; M]; M], n: usize) -> Option<[[f64; M]; M]> {
    // Loops of constant length are several times faster.
    if n == M { invert_leading(matrix, M) } else { invert_leading(matrix, n) }
}

/// Inverts like [`invert`] by sweeping one pivot after the other (J. H. Goodnight, Am. Stat. 33 (1979) 149,
/// <https://doi.org/10.1080/00031305.1979.10482685>).
///
/// `n` is at most `M`.
#[inline(always)]
fn invert_leading<const M: usize>(matrix: &[[f64; M]; M], n: usize) -> Option<[[f64; M]; M]> {
    let mut work = *matrix;
    for pivot in 0..n {
        let size = work[pivot][pivot];
        // Written so that NaN is refused.
        let is_sound = size > 0.0 && size.is_finite() && size >= MIN_PIVOT * matrix[pivot][pivot];
        if !is_sound {
            return None;
        }
        // A division takes many times as long as a product.
        let reciprocal = 1.0 / size;
        // The pivot's row; only the upper half is kept.
        let mut own = [0.0; M];
        for k in 0..n {
            own[k] = work[k.min(pivot)][k.max(pivot)];
        }
        // Includes the lower half and the pivot's own row and column: a test per element would be slower.
        for row in 0..n {
            let factor = reciprocal * own[row];
            for column in 0..n {
                work[row][column] -= factor * own[column];
            }
        }
        for row in 0..n {
            work[row.min(pivot)][row.max(pivot)] = reciprocal * own[row];
        }
        work[pivot][pivot] = -reciprocal;
    }
    // The swept matrix is the negative inverse.
    let mut inverse = [[0.0; M]; M];
    for row in 0..n {
        for column in row..n {
            (inverse[row][column], inverse[column][row]) = (-work[row][column], -work[row][column]);
        }
    }
    Some(inverse)
}

/// Returns a function of a symmetric 3 x 3 matrix: the matrix of the same eigenvectors with the changed eigenvalues.
pub fn map_eigenvalues(matrix: &[[f64; 3]; 3], change: impl Fn(f64) -> f64) -> [[f64; 3]; 3] {
    let mut eigen = Matrix3::from_fn(|row, column| matrix[row][column]).symmetric_eigen();
    eigen.eigenvalues.apply(|value| *value = change(*value));
    let changed = eigen.recompose();
    std::array::from_fn(|row| std::array::from_fn(|column| changed[(row, column)]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_times_the_matrix_is_one_whatever_the_units() {
        let matrix = [[4e6, 1e3, 0.2], [1e3, 3.0, 1e-4], [0.2, 1e-4, 2e-6]];
        let inverse = invert(&matrix, 3).unwrap();
        for row in 0..3 {
            for column in 0..3 {
                let sum: f64 = (0..3).map(|k| matrix[row][k] * inverse[k][column]).sum();
                let expected = if row == column { 1.0 } else { 0.0 };
                let unit = (matrix[row][row] / matrix[column][column]).sqrt();
                assert!((sum - expected).abs() < 1e-9 * unit.max(1.0), "{row} {column}: {sum}");
            }
        }
    }

    #[test]
    fn only_the_upper_half_of_the_leading_part_is_read() {
        let nan = f64::NAN;
        let larger = [[4.0, 1.0, 0.5, nan], [nan, 3.0, -1.0, nan], [nan, nan, 2.0, nan], [nan; 4]];
        let inverse = invert(&larger, 3).unwrap();
        let whole = invert(&[[4.0, 1.0, 0.5], [1.0, 3.0, -1.0], [0.5, -1.0, 2.0]], 3).unwrap();
        let expected = whole.map(|[a, b, c]| [a, b, c, 0.0]);
        let bits = |rows: &[[f64; 4]]| rows.as_flattened().iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&inverse[..3]), bits(&expected));
        assert_eq!(bits(&inverse[3..]), [0; 4]);
    }

    #[test]
    fn the_reciprocals_of_the_eigenvalues_give_the_inverse() {
        let matrix = [[4.0, 1.0, 0.5], [1.0, 3.0, -1.0], [0.5, -1.0, 2.0]];
        let (found, expected) = (map_eigenvalues(&matrix, |value| 1.0 / value), invert(&matrix, 3).unwrap());
        for (found, expected) in found.as_flattened().iter().zip(expected.as_flattened()) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
    }

    #[test]
    fn singular_matrices_have_no_inverse() {
        assert!(invert(&[[1.0, 1.0], [1.0, 1.0]], 2).is_none());
        assert!(invert(&[[0.0, 0.0], [0.0, 1.0]], 2).is_none());
        assert!(invert(&[[f64::NAN, 0.0], [0.0, 1.0]], 2).is_none());
    }
}
