//! Whole-body matching: one rigid IC-GN match of all visible pixels of a body.
//!
//! A rigid motion fitted to the displacements of subsets loses the pixels between and outside the subsets. One match of
//! all pixels is closer to the Cramer-Rao bound, and cheaper.

use super::light_field::LightField;
use super::motion::{BodyMotion, motion, status_of, variance_factors};
use super::occlusion::OcclusionSearch;
use super::occlusion_map::OcclusionMap;
use crate::dic::geometry::{GridPoint, PlanarMotion, Point, Region, Shape, SubsetMask, Warp};
use crate::dic::image::PreparedFrame;
use crate::dic::refine::{Match, MatchError, Refiner};
use crate::dic::subset::{ReferenceSubset, Unusable};
use crate::dic::uncertainty::{GradientGain, NoisePool};
use crate::numeric::Lanes;
use crate::results::PointStatus;

/// The minimum number of pixels of a rigid match.
const MIN_PIXELS: usize = 81;

/// A rigid body in its reference frame.
///
/// It holds a copy of the reference pixels, so the frame itself may be dropped. Any number of later frames can be
/// matched against it.
#[derive(Debug, Clone, Default)]
pub struct RigidBody {
    subset: ReferenceSubset,
    window: SubsetMask,
    at: GridPoint,
    residual: Vec<Lanes>,
    pool: NoisePool,
    occlusion: OcclusionSearch,
    /// The gradient gain of the texture: the factor that corrects one Gauss-Newton step.
    gradient_gain: f64,
    /// Smooth light on the body, where its pixels separate light from motion.
    light: Option<Box<LightField>>,
}

impl RigidBody {
    /// Extracts the pixels of `region` from a frame.
    ///
    /// # Errors
    ///
    /// [`PointStatus::OutOfFrame`] if the region extends over the edge of the prepared part or holds fewer than 81
    /// pixels, [`PointStatus::LowContrast`] if it has no texture or is mostly saturated.
    pub fn new(reference: &PreparedFrame, region: &Region) -> Result<Self, PointStatus> {
        let mut body = Self::default();
        body.renew(reference, region)?;
        Ok(body)
    }

    /// Replaces the body, reusing its memory. See [`Self::new`].
    ///
    /// # Errors
    ///
    /// The errors of [`Self::new`]. After one, the body must not be used.
    pub fn renew(&mut self, reference: &PreparedFrame, region: &Region) -> Result<(), PointStatus> {
        let [left, top, right, bottom] = region.bounds_px().ok_or(PointStatus::OutOfFrame)?;
        let (x, y) = (0.5 * (left + right), 0.5 * (top + bottom));
        let half = (0.5 * (right - left).max(bottom - top)).ceil();
        let inside = x >= 0.0 && y >= 0.0 && x < 1e6 && y < 1e6 && half < 1e4;
        if !inside {
            return Err(PointStatus::OutOfFrame);
        }
        let at = GridPoint { x: x.round() as u32, y: y.round() as u32 };
        let (x, y) = (f64::from(at.x), f64::from(at.y));
        let window =
            SubsetMask::from_test(half as u32 + 1, |dx, dy| region.contains(x + f64::from(dx), y + f64::from(dy)));
        if window.pixels < MIN_PIXELS {
            return Err(PointStatus::OutOfFrame);
        }
        (self.at, self.window) = (at, window);
        let Self { subset, window, pool, occlusion, .. } = self;
        subset.fill_body(reference, window, at).map_err(Unusable::status)?;
        pool.clear();
        pool.add_texture(subset, window);
        occlusion.plan(window);
        let spans = window.row_spans(reference.local(at), reference.levels.height());
        self.light = LightField::new(subset, window).map(Box::new);
        self.gradient_gain = GradientGain::from_spans(reference, &spans).gain();
        Ok(())
    }

    /// The number of pixels of the body.
    pub fn pixels(&self) -> usize {
        self.window.pixels
    }

    /// The centre of the reference pixels, px.
    pub fn center(&self) -> Point {
        Point::new(f64::from(self.at.x), f64::from(self.at.y))
    }

    /// Returns the expected standard uncertainty of a match: displacement of a point along x and y, px, and rotation,
    /// deg.
    ///
    /// `noise_dn` is the standard deviation of the white noise of each frame, DN. This is the least-squares bound for
    /// small rotations, sqrt(2) noise over the root of the gradient energy (Pan et al. 2008,
    /// <https://doi.org/10.1364/OE.16.007037>), corrected by the gradient gain. The uncertainty that a match reports is
    /// computed from its residual instead.
    pub fn expected_sigma(&self, point: Point, noise_dn: f64) -> [f64; 3] {
        let variances = variance_factors(&self.subset.inverse, 0.0, point.relative_to(self.center()));
        let [u, v, angle] = variances.map(|spread| (2.0 * spread).sqrt() * noise_dn * self.gradient_gain);
        [u, v, angle.to_degrees()]
    }

    /// Returns the error of a whole-body match per unit dilatation: displacement along x and y, px, and rotation, deg.
    ///
    /// A body with more edges on one side seems to move to that side when it is magnified.
    pub fn dilatation_error(&self) -> [f64; 3] {
        let [u_px, v_px, angle] = self.subset.lever;
        [u_px, v_px, angle.to_degrees()]
    }

    /// The mask of its pixels, relative to [`Self::center`].
    pub(in crate::dic) fn window(&self) -> &SubsetMask {
        &self.window
    }

    /// Finds the body in a later frame, starting from the motion `near`.
    ///
    /// The displacements in `near` and in the result are those of a point of the reference. The match converges from
    /// about 2 px and 3 deg away.
    ///
    /// # Errors
    ///
    /// [`PointStatus::OutOfFrame`] or [`PointStatus::LowCorrelation`].
    pub fn find(
        &mut self,
        target: &PreparedFrame,
        point: Point,
        near: PlanarMotion,
    ) -> Result<BodyMotion, PointStatus> {
        let (start, offset) = self.initial_warp(point, near);
        let mut residual = std::mem::take(&mut self.residual);
        let found = self.refiner(target).refine_with_residual(start, &mut residual);
        let found = with_contrast(found, &residual);
        let measured = found.map(|found| self.body_motion(target, &found, offset, &residual));
        self.residual = residual;
        measured
    }

    /// Finds the body from its visible pixels only. See [`Self::find`].
    ///
    /// The occluder may be unknown, bright and moving. An occluder that is already in the reference and moves with the
    /// body counts as part of the body.
    ///
    /// # Errors
    ///
    /// The errors of [`Self::find`], [`PointStatus::Occluded`] if less than 15 % of the body is visible, or
    /// [`PointStatus::LowContrast`] if that part has no texture.
    pub fn find_visible(
        &mut self,
        target: &PreparedFrame,
        point: Point,
        near: PlanarMotion,
    ) -> Result<BodyMotion, PointStatus> {
        let (start, offset) = self.initial_warp(point, near);
        let (mut occlusion, mut residual) = (std::mem::take(&mut self.occlusion), std::mem::take(&mut self.residual));
        occlusion.clear_occlusion();
        let plain = self.refiner(target).refine_near(start, self.gradient_gain, &mut residual);
        let plain = with_contrast(plain, &residual);
        let found = match plain {
            Ok(found) if occlusion.is_unoccluded(&self.refiner(target), &found, &residual) => {
                Ok(self.body_motion(target, &found, offset, &residual))
            }
            _ => {
                let refiner = self.refiner(target);
                // An occluder that covers half of the body may have biased the plain match.
                let searched = match plain {
                    Ok(found) => {
                        let matched = occlusion.find(&refiner, found.warp, found.zncc, &residual);
                        matched.or_else(|_| occlusion.find(&refiner, start, 0.0, &[]))
                    }
                    Err(_) => occlusion.find(&refiner, start, 0.0, &[]),
                };
                searched.and_then(|found| {
                    let visible = occlusion.body_motion(&self.refiner(target), &found, offset)?;
                    // The visible pixels are a part of the body's.
                    Ok(visible.with_scaled_sigmas(self.gradient_gain))
                })
            }
        };
        (self.occlusion, self.residual) = (occlusion, residual);
        found
    }

    /// Returns the occluded pixels, relative to [`Self::center`], of the last [`Self::find_visible`]; `None` if
    /// there were none.
    pub fn occlusion_map(&self) -> Option<OcclusionMap> {
        self.occlusion.occlusion_map(&self.window)
    }

    /// Returns the initial warp for a motion of a point, and the offset of the point from the centre.
    fn initial_warp(&self, point: Point, near: PlanarMotion) -> (Warp, Point) {
        let center = self.center();
        (near.at_offset(center.relative_to(point)).to_warp(), point.relative_to(center))
    }

    /// Computes the motion of the point at `offset`, px from the centre, and its uncertainty, from a match of all
    /// pixels and its residual.
    fn body_motion(&mut self, target: &PreparedFrame, found: &Match, offset: Point, residual: &[Lanes]) -> BodyMotion {
        let Self { subset, window, at, pool, light, .. } = self;
        let light = light.as_ref().and_then(|light| light.correction(window, residual));
        let refiner =
            Refiner { subset, window, shape: Shape::Rigid, target: &target.interpolated, at: target.local(*at) };
        motion(&refiner, found, offset, pool, residual, light).with_scaled_sigmas(self.gradient_gain)
    }

    /// Runs the match of all pixels from an initial warp.
    ///
    /// # Errors
    ///
    /// See [`Self::find`].
    pub(in crate::dic) fn refine(&self, target: &PreparedFrame, start: Warp) -> Result<Match, PointStatus> {
        self.refiner(target).refine(start).map_err(status_of)
    }

    /// Returns the refiner of all pixels in a target.
    fn refiner<'a>(&'a self, target: &'a PreparedFrame) -> Refiner<'a> {
        Refiner {
            subset: &self.subset,
            window: &self.window,
            shape: Shape::Rigid,
            target: &target.interpolated,
            at: target.local(self.at),
        }
    }
}

/// Returns a match if the target has the contrast that a residual needs.
///
/// # Errors
///
/// The status of a failed match, or [`PointStatus::LowContrast`] without a residual.
fn with_contrast(found: Result<Match, MatchError>, residual: &[Lanes]) -> Result<Match, PointStatus> {
    let found = found.map_err(status_of)?;
    if residual.is_empty() { Err(PointStatus::LowContrast) } else { Ok(found) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dic::tests::{Speckle, prepared, record};
    use crate::image::Image;

    const CENTER: Point = Point { x_px: 70.0, y_px: 66.0 };

    /// A pattern rotated about the centre and shifted.
    fn turned(speckle: &Speckle, (u, v, angle_deg): (f64, f64, f64)) -> Image {
        let turn = Warp::rigid(u, v, angle_deg.to_radians());
        let motion = |x: f64, y: f64| {
            let (dx, dy) = (x - 70.0, y - 66.0);
            let (tx, ty) = turn.apply(dx, dy);
            (tx - dx, ty - dy)
        };
        speckle.moved(motion).draw(140, 132)
    }

    #[test]
    fn a_ball_of_8800_pixels_is_followed_to_a_thousandth_with_honest_uncertainty() {
        let speckle = Speckle::standard(21, 140.0);
        let reference = speckle.draw(140, 132);
        let region = Region::Disc { x_px: 70.0, y_px: 66.0, radius_px: 53.0 };
        let (mut errors, mut reported, mut count) = ([0.0; 3], [0.0; 3], 0.0);
        // Rounding to whole grey levels adds to the noise.
        let noise_dn = (2.0_f64.powi(2) + 1.0 / 12.0).sqrt();
        let expected = RigidBody::new(&prepared(&reference), &region).unwrap().expected_sigma(CENTER, noise_dn);
        for (case, truth) in [(0.13, -0.37, 0.07), (0.77, 0.21, -0.6), (1.23, -1.9, 2.9)].into_iter().enumerate() {
            let target = turned(&speckle, truth);
            for round in 0..8 {
                let seed = 100 * case as u64 + 2 * round;
                let mut body = RigidBody::new(&prepared(&record(&reference, 2.0, seed)), &region).unwrap();
                let frame = prepared(&record(&target, 2.0, seed + 1));
                let near = PlanarMotion { u_px: truth.0.round(), v_px: truth.1.round(), angle_deg: 0.0 };
                let found = body.find(&frame, CENTER, near).unwrap();
                let motion = found.motion;
                let error = [motion.u_px - truth.0, motion.v_px - truth.1, motion.angle_deg - truth.2];
                let sigma = [motion.sigma_u_px, motion.sigma_v_px, motion.sigma_angle_deg];
                count += 1.0;
                for k in 0..3 {
                    errors[k] += error[k] * error[k];
                    reported[k] += sigma[k] * sigma[k];
                }
            }
        }
        let rms = errors.map(|sum| (sum / count).sqrt());
        let ratio: [f64; 3] = std::array::from_fn(|k| (reported[k] / errors[k]).sqrt());
        eprintln!("rms {rms:?} px, px, deg; reported/actual {ratio:?}");
        assert!(rms[0] < 0.0014 && rms[1] < 0.0014 && rms[2] < 0.0022, "{rms:?}");
        // 24 matches: the scatter itself is uncertain by 15 %.
        assert!(ratio.iter().all(|ratio| (0.7..1.5).contains(ratio)), "{ratio:?}");
        let predicted: [f64; 3] = std::array::from_fn(|k| expected[k] / rms[k]);
        eprintln!("predicted/actual {predicted:?}");
        assert!(predicted.iter().all(|ratio| (0.75..1.33).contains(ratio)), "{predicted:?}");
    }

    #[test]
    fn the_displacement_belongs_to_the_point_asked_for() {
        let speckle = Speckle::standard(22, 140.0);
        let truth = (0.5, 0.25, 2.0);
        let outline_px = vec![[40.0, 40.0], [100.0, 44.0], [96.0, 90.0], [44.0, 88.0]];
        let region = Region::Polygon { outline_px, holes_px: vec![] };
        let mut body = RigidBody::new(&prepared(&speckle.draw(140, 132)), &region).unwrap();
        let frame = prepared(&turned(&speckle, truth));
        let near = PlanarMotion::default();
        let at_center = body.find(&frame, CENTER, near).unwrap().motion;
        assert!((at_center.u_px - 0.5).abs() < 0.002 && (at_center.v_px - 0.25).abs() < 0.002, "{at_center:?}");
        // 10 px to the right of the centre the rotation lifts the point by 10 sin 2 deg.
        let right = body.find(&frame, Point::new(80.0, 66.0), near).unwrap().motion;
        assert!((right.v_px - (0.25 - 10.0 * 2.0_f64.to_radians().sin())).abs() < 0.002, "{right:?}");
        assert!(right.sigma_v_px >= at_center.sigma_v_px);
    }

    #[test]
    fn bodies_off_the_image_or_without_texture_are_refused() {
        let frame = prepared(&Speckle::standard(23, 100.0).draw(100, 100));
        let disc = |x_px: f64| Region::Disc { x_px, y_px: 50.0, radius_px: 30.0 };
        assert_eq!(RigidBody::new(&frame, &disc(20.0)).err(), Some(PointStatus::OutOfFrame));
        assert_eq!(RigidBody::new(&frame, &disc(f64::NAN)).err(), Some(PointStatus::OutOfFrame));
        let grey = prepared(&Image::new(100, 100));
        assert_eq!(RigidBody::new(&grey, &disc(50.0)).err(), Some(PointStatus::LowContrast));
        let mut body = RigidBody::new(&frame, &disc(50.0)).unwrap();
        let (center, far) = (Point::new(50.0, 50.0), PlanarMotion { u_px: 40.0, ..PlanarMotion::default() });
        assert_eq!(body.find(&grey, center, PlanarMotion::default()).err(), Some(PointStatus::LowCorrelation));
        assert_eq!(body.find(&frame, center, far).err(), Some(PointStatus::OutOfFrame));
    }
}
