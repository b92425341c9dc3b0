//! The scatter of a match between the sectors of a body.
//!
//! Noise is independent from pixel to pixel. A highlight, a reflection or a lamp that stands in the room is not: all pixels
//! of one part of the body then ask for another motion than those of the others. The sum of their votes is zero at the
//! match, and their scatter bounds its error, whatever its cause (cluster-robust variance: K.-Y. Liang, S. L. Zeger,
//! Biometrika 73 (1986) 13, <https://doi.org/10.1093/biomet/73.1.13>).

use super::median_residual::median_absolute;
use crate::dic::geometry::SubsetMask;
use crate::dic::subset::ReferenceSubset;
use crate::numeric::{LANES, Lanes, SIGMA_PER_MEDIAN};

/// The number of sectors: octants.
const SECTORS: usize = 8;
/// The number of parameters of a rigid match.
const PARAMETERS: usize = 3;

/// The ratio of the scatter between the sectors to the variance by noise that chance explains. It is 2 on average, since
/// interpolation correlates neighbouring pixels, and larger than this once in a thousand matches of speckle.
const CHANCE_RATIO: f64 = 8.0;

/// Returns the variances of a match, px^2, px^2 and rad^2, that noise does not explain; 0 where it explains all.
///
/// `mean_square` is that of the residual, DN^2. Highlights cover few pixels, so the median residual is that of noise.
pub(super) fn shared_variances(
    subset: &ReferenceSubset,
    window: &SubsetMask,
    residual: &[Lanes],
    mean_square: f64,
    inverse: &[[f64; 6]; 6],
) -> [f64; PARAMETERS] {
    let noise_dn = SIGMA_PER_MEDIAN * f64::from(median_absolute(residual, window.pixels, mean_square));
    let between_sectors = sector_variances(subset, window, residual, inverse);
    std::array::from_fn(|k| {
        let by_noise = noise_dn.powi(2) * inverse[k][k];
        if between_sectors[k] > CHANCE_RATIO * by_noise { between_sectors[k] - by_noise } else { 0.0 }
    })
}

/// Returns the variances of a match, px^2, px^2 and rad^2, from the scatter between the octants of the body.
///
/// `residual` is that of the match, DN, and `inverse` its inverse Hessian.
fn sector_variances(
    subset: &ReferenceSubset,
    window: &SubsetMask,
    residual: &[Lanes],
    inverse: &[[f64; 6]; 6],
) -> [f64; PARAMETERS] {
    let mut votes = [[0.0_f64; PARAMETERS]; SECTORS];
    for block in &window.blocks {
        let rows = block.start..block.start + block.rows;
        let gradients = subset.gradient_x[rows.clone()].iter().zip(&subset.gradient_y[rows.clone()]);
        for (dy, (residual, (gx, gy))) in (block.dy..).zip(residual[rows].iter().zip(gradients)) {
            for lane in 0..LANES {
                let dx = block.dx + lane as i32;
                let (r, x, y) = (residual.0[lane], gx.0[lane], gy.0[lane]);
                let turn = x * dy as f32 - y * dx as f32;
                let vote = &mut votes[octant(dx, dy)];
                for (sum, derivative) in vote.iter_mut().zip([x, y, turn]) {
                    *sum += f64::from(r * derivative);
                }
            }
        }
    }
    let free = SECTORS as f64 / (SECTORS - PARAMETERS) as f64;
    std::array::from_fn(|parameter| {
        let step = |vote: &[f64; PARAMETERS]| inverse[parameter].iter().zip(vote).map(|(a, b)| a * b).sum::<f64>();
        free * votes.iter().map(|vote| step(vote).powi(2)).sum::<f64>()
    })
}

/// Returns the largest share of the texture that one octant of a body holds, 0 to 1: of the squared derivatives by the
/// rotation.
pub(super) fn largest_share(subset: &ReferenceSubset, window: &SubsetMask) -> f64 {
    let mut energies = [0.0_f64; SECTORS];
    for block in &window.blocks {
        let rows = block.start..block.start + block.rows;
        let gradients = subset.gradient_x[rows.clone()].iter().zip(&subset.gradient_y[rows.clone()]);
        for ((dy, mask), (gx, gy)) in (block.dy..).zip(&window.mask[rows]).zip(gradients) {
            for lane in 0..LANES {
                let dx = block.dx + lane as i32;
                let turn = gx.0[lane] * dy as f32 - gy.0[lane] * dx as f32;
                energies[octant(dx, dy)] += f64::from(mask.0[lane] * turn * turn);
            }
        }
    }
    energies.iter().fold(0.0, |largest: f64, energy| largest.max(*energy)) / energies.iter().sum::<f64>().max(1e-9)
}

/// Returns the number of the octant of an offset from the centre.
fn octant(dx: i32, dy: i32) -> usize {
    usize::from(dx < 0) + 2 * usize::from(dy < 0) + 4 * usize::from(dx.abs() < dy.abs())
}

#[cfg(test)]
mod tests {
    use crate::dic::tests::{Speckle, prepared, record};
    use crate::dic::{BodyMotion, PlanarMotion, Point, Region, RigidBody};
    use crate::image::Image;

    const TURN_DEG: f64 = 4.0;

    /// An image of a faint pattern, with a highlight that stands in the room.
    fn glossy(image: &Image, height_dn: f32) -> Image {
        let mut image = image.clone();
        for (y, row) in image.rows_mut().enumerate() {
            for (x, level) in row.iter_mut().enumerate() {
                let (x, y) = (x as f32 - 95.0, y as f32 - 50.0);
                *level = 0.2 * *level + height_dn * (-(x * x + y * y) / 20.0).exp();
            }
        }
        image
    }

    fn found(height_dn: f32) -> BodyMotion {
        let speckle = Speckle::standard(47, 140.0);
        let moved = speckle.moved(|x, y| {
            let (dx, dy) = (x - 70.0, y - 66.0);
            let (sin, cos) = TURN_DEG.to_radians().sin_cos();
            (dx * cos + dy * sin - dx, dy * cos - dx * sin - dy)
        });
        let (first, second) = (glossy(&speckle.draw(140, 132), height_dn), glossy(&moved.draw(140, 132), height_dn));
        let (first, second) = (record(&first, 2.0, 1), record(&second, 2.0, 2));
        let region = Region::Disc { x_px: 70.0, y_px: 66.0, radius_px: 50.0 };
        let mut body = RigidBody::new(&prepared(&first), &region).unwrap();
        let near = PlanarMotion { u_px: 0.0, v_px: 0.0, angle_deg: TURN_DEG };
        body.find(&prepared(&second), Point::new(70.0, 66.0), near).unwrap()
    }

    #[test]
    fn a_highlight_that_holds_a_match_back_is_in_its_misfit() {
        let (matt, glossy) = (found(0.0), found(150.0));
        let error_deg = (glossy.motion.angle_deg - TURN_DEG).abs();
        assert!(error_deg > 8.0 * matt.motion.sigma_angle_deg, "held back by {error_deg} deg");
        assert!(glossy.misfit_deg > 0.4 * error_deg, "{} deg of {error_deg} deg", glossy.misfit_deg);
        assert!(glossy.misfit_px > 0.0 && matt.misfit_px <= 0.0, "{} and {} px", glossy.misfit_px, matt.misfit_px);
        assert!(matt.misfit_deg < matt.motion.sigma_angle_deg, "{} deg without it", matt.misfit_deg);
    }
}
