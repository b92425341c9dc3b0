//! Small symmetric systems.

/// The inverse of the leading `n` x `n` part of a positive definite matrix,
/// or `None` when it is singular to working precision.
///
/// Scaled to a unit diagonal first, so that the test for singularity does not
/// depend on units.
pub(super) fn invert<const M: usize>(matrix: &[[f64; M]; M], n: usize) -> Option<[[f64; M]; M]> {
    // Loops of a known length are several times faster.
    if n == M { invert_leading(matrix, M) } else { invert_leading(matrix, n) }
}

#[inline(always)]
fn invert_leading<const M: usize>(matrix: &[[f64; M]; M], n: usize) -> Option<[[f64; M]; M]> {
    let mut scale = [0.0; M];
    for k in 0..n {
        if !matrix[k][k].is_finite() || matrix[k][k] <= 0.0 {
            return None;
        }
        scale[k] = 1.0 / matrix[k][k].sqrt();
    }
    let mut work = [[0.0; M]; M];
    let mut inverse = [[0.0; M]; M];
    for row in 0..n {
        for column in 0..n {
            work[row][column] = matrix[row][column] * scale[row] * scale[column];
        }
        inverse[row][row] = 1.0;
    }
    for pivot in 0..n {
        // The pivots of a positive definite matrix of unit diagonal lie in 0..=1.
        let size = work[pivot][pivot];
        if size.is_nan() || size < 1e-7 {
            return None;
        }
        // Divisions take many times as long.
        let share = 1.0 / size;
        for column in 0..n {
            work[pivot][column] *= share;
            inverse[pivot][column] *= share;
        }
        let (own, other) = (work[pivot], inverse[pivot]);
        for row in (0..n).filter(|row| *row != pivot) {
            let factor = work[row][pivot];
            for column in 0..n {
                work[row][column] -= factor * own[column];
                inverse[row][column] -= factor * other[column];
            }
        }
    }
    for row in 0..n {
        for column in 0..n {
            inverse[row][column] *= scale[row] * scale[column];
        }
    }
    Some(inverse)
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
    fn singular_matrices_have_no_inverse() {
        assert!(invert(&[[1.0, 1.0], [1.0, 1.0]], 2).is_none());
        assert!(invert(&[[0.0, 0.0], [0.0, 1.0]], 2).is_none());
        assert!(invert(&[[f64::NAN, 0.0], [0.0, 1.0]], 2).is_none());
    }
}
