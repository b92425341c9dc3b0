//! A rod without lens distortion and perspective: its centre line, and the edges of its tapes on it.

use super::linear_map::{determinant, multiply, stretch};
use super::rectifier::Rectifier;
use crate::results::{Estimate, Rod, RodEdge};

impl Rectifier {
    /// Returns a rod in rectified pixels; `None` beyond the calibration.
    ///
    /// Its centre line is taken as straight over its length in the recorded image. The sigmas assume a map that is
    /// uniform about the rod.
    pub(in crate::motion) fn rod(&self, rod: &Rod) -> Option<Rod> {
        let (sin, cos) = rod.tilt_deg.value.to_radians().sin_cos();
        let recorded = [rod.x_px.value, rod.y_px.value];
        let [x, y] = self.rectify_point(recorded)?;
        let jacobian = self.jacobian(recorded)?;
        let [right, down] = multiply(&jacobian, [sin, cos]);
        let (min_stretch, mean) = stretch(&jacobian);
        // A rod's width is not foreshortened with the plane.
        let across = if self.mm_per_px().is_some() { min_stretch } else { mean };
        let [down_x, down_y] = jacobian[1];
        let place = |at: Estimate| {
            let [_, y] = self.rectify_point([recorded[0] + (at.value - recorded[1]) * sin / cos, at.value])?;
            // The centre line is displaced sideways by its own sigma.
            Some(Estimate { value: y, sigma: (down_x * rod.x_px.sigma).hypot(down_y * at.sigma) })
        };
        let mut edges = rod.edges;
        for RodEdge { y_px, .. } in edges.iter_mut().flatten() {
            *y_px = match *y_px {
                Some(at) => Some(place(at)?),
                None => None,
            };
        }
        let turns = determinant(&jacobian) / (right * right + down * down);
        Some(Rod {
            x_px: Estimate { value: x, sigma: mean * rod.x_px.sigma },
            y_px: Estimate { value: y, sigma: mean * rod.y_px.sigma },
            half_width_px: Estimate {
                value: across * rod.half_width_px.value,
                sigma: across * rod.half_width_px.sigma,
            },
            tilt_deg: Estimate { value: right.atan2(down).to_degrees(), sigma: turns * rod.tilt_deg.sigma },
            edges,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::{Calibration, Distortion, Lens};
    use crate::results::PointStatus;

    /// A plane tilted back by a third over the image and rotated by 20 deg, seen through a lens.
    fn rectifier() -> Rectifier {
        let (sin, cos) = 20.0_f64.to_radians().sin_cos();
        let lens = Lens {
            focal_px: [900.0, 900.0],
            center_px: [200.0, 210.0],
            distortion: Distortion::Brown([-0.08, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        };
        let homography = Some([[0.3 * cos, -0.3 * sin, -20.0], [0.3 * sin, 0.3 * cos, -60.0], [2e-4, 6e-4, 1.0]]);
        Rectifier::new(Calibration { image_px: [400, 400], offset_px: [0, 0], lens: Some(lens), homography }).unwrap()
    }

    #[test]
    fn edges_and_tilt_of_a_rod_in_the_plane_come_back_as_they_were() {
        let rectifier = rectifier();
        let (top, tilt_deg) = ([190.0, 130.0], -4.0_f64);
        let (sin, cos) = tilt_deg.to_radians().sin_cos();
        let down = |along: f64| [top[0] + along * sin, top[1] + along * cos];
        let pixel = |along: f64| rectifier.pixel(down(along)).unwrap();
        let sure = |value: f64| Estimate { value, sigma: 0.01 };
        let along = [0.0, 40.0, 90.0, 120.0];
        let (middle, above, below) = (pixel(20.0), pixel(15.0), pixel(25.0));
        let edge = |at: f64| Some(RodEdge { y_px: Some(sure(pixel(at)[1])), status: PointStatus::Valid });
        let mut edges = along.map(edge);
        edges[2] = Some(RodEdge { y_px: None, status: PointStatus::OutOfFrame });
        let rod = Rod {
            x_px: sure(middle[0]),
            y_px: sure(middle[1]),
            half_width_px: sure(15.0),
            tilt_deg: sure((below[0] - above[0]).atan2(below[1] - above[1]).to_degrees()),
            edges,
        };
        let measured = rectifier.rod(&rod).unwrap();
        assert!((rod.tilt_deg.value - tilt_deg).abs() > 0.5, "the picture shows another one: {:?}", rod.tilt_deg);
        assert!((measured.tilt_deg.value - tilt_deg).abs() < 0.01, "{:?}", measured.tilt_deg);
        assert!(
            (measured.y_px.value - down(20.0)[1]).abs() < 1e-6 && (measured.x_px.value - down(20.0)[0]).abs() < 1e-6
        );
        for (k, along) in along.into_iter().enumerate().filter(|(k, _)| *k != 2) {
            let seen = measured.edges[k].and_then(|edge| edge.y_px).unwrap();
            assert!((seen.value - down(along)[1]).abs() < 0.02, "{k}: {seen:?}, {:?}", down(along));
            assert!((0.005..0.02).contains(&seen.sigma), "{seen:?}");
        }
        assert_eq!(measured.edges[2], edges[2]);
    }
}
