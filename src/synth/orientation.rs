//! The orientation of a ball in space.

/// A rotation; axes x right, y up, z towards the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Orientation([[f64; 3]; 3]);

impl Orientation {
    /// Creates a rotation in the image plane, counter-clockwise on the screen.
    pub(crate) fn in_plane(angle_rad: f64) -> Self {
        let (sin, cos) = angle_rad.sin_cos();
        Self([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    }

    /// Creates a rotation from a rotation vector, its axis times its angle, rad; counter-clockwise seen from its tip.
    ///
    /// O. Rodrigues, J. Math. Pures Appl. 5 (1840) 380.
    pub(crate) fn from_rotation_vector(axis_rad: [f64; 3]) -> Self {
        let [x, y, z] = axis_rad;
        if x.abs() + y.abs() <= 0.0 {
            // Exact, so that a rotation in the image plane keeps distances from the centre.
            return Self::in_plane(z);
        }
        let angle = (x * x + y * y + z * z).sqrt();
        let (sin, cos) = angle.sin_cos();
        let [x, y, z] = [x / angle, y / angle, z / angle];
        let rest = 1.0 - cos;
        Self([
            [cos + rest * x * x, rest * x * y - sin * z, rest * x * z + sin * y],
            [rest * x * y + sin * z, cos + rest * y * y, rest * y * z - sin * x],
            [rest * x * z - sin * y, rest * y * z + sin * x, cos + rest * z * z],
        ])
    }

    /// Returns the rotation that applies `first` and then this one.
    pub(crate) fn after(&self, first: &Self) -> Self {
        let column = |index: usize| self.rotate([first.0[0][index], first.0[1][index], first.0[2][index]]);
        let [x, y, z] = [column(0), column(1), column(2)];
        Self([0, 1, 2].map(|row| [x[row], y[row], z[row]]))
    }

    /// Rotates a direction given in the axes of the ball into those of the camera.
    pub(crate) fn rotate(&self, direction: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = direction;
        self.0.map(|row| row[0] * x + row[1] * y + row[2] * z)
    }

    /// Applies the inverse rotation: from the axes of the camera into those of the ball.
    pub(crate) fn inverse_rotate(&self, direction: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|column| (0..3).map(|row| self.0[row][column] * direction[row]).sum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(left: [f64; 3], right: [f64; 3]) -> bool {
        left.iter().zip(&right).all(|(left, right)| (left - right).abs() < 1e-12)
    }

    #[test]
    fn a_quarter_turn_about_each_axis_takes_the_next_axis_to_the_one_after() {
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        for axis in 0..3 {
            let turn = Orientation::from_rotation_vector(axes[axis].map(|part| part * std::f64::consts::FRAC_PI_2));
            assert!(close(turn.rotate(axes[(axis + 1) % 3]), axes[(axis + 2) % 3]), "axis {axis}");
            assert!(close(turn.rotate(axes[axis]), axes[axis]), "axis {axis}");
        }
    }

    #[test]
    fn many_small_turns_about_one_axis_are_a_large_one() {
        let step = Orientation::from_rotation_vector([0.01, -0.02, 0.03]);
        let total = (0..50).fold(Orientation::in_plane(0.0), |turn, _| step.after(&turn));
        let expected = Orientation::from_rotation_vector([0.5, -1.0, 1.5]);
        assert!(close(total.rotate([0.3, 0.4, -0.5]), expected.rotate([0.3, 0.4, -0.5])));
    }
}
