//! A series of images, correlated with one reference that is renewed when necessary.

use super::correlator::{Correlator, KeptReference};
use crate::dic::field::MedianTest;
use crate::dic::geometry::{GridPoint, Warp};
use crate::dic::image::PreparedFrame;
use crate::image::ImageView;
use crate::numeric::quantile;
use crate::results::{Displacement, FieldPoint, PointStatus};

/// The rotation relative to the reference above which it is renewed, deg.
///
/// Above, eight neighbouring pixels of a subset no longer lie in neighbouring cells, and out-of-plane effects become
/// significant.
const RENEW_DEG: f64 = 3.0;

/// The median ZNCC below which the reference is renewed.
const RENEW_ZNCC: f64 = 0.9;

/// The minimum fraction of the tracked points that an image must show to update the starts.
const MIN_FOUND_FRACTION: f64 = 0.5;

/// The fraction of a match's variance that a renewal adds permanently.
///
/// The noise of the new reference enters before and after the renewal with opposite signs and nearly cancels. The
/// remainder was measured on rendered patterns rotated by 90 deg in steps of 5 deg.
const RENEWAL_FRACTION: f64 = 0.07;

/// The position of the material of one grid point when the reference was taken.
#[derive(Debug, Clone, Copy)]
struct Material {
    /// The displacement from the first image to the reference, px.
    moved: (f64, f64),
    /// The variance added by the renewals so far, px^2.
    variance: (f64, f64),
    /// The offset from the integer centre of the reference's subset, px.
    offset: (f64, f64),
}

/// Tracks the points of a first image through later ones.
///
/// Every image is compared with a kept reference, so errors do not accumulate from image to image. The newest image
/// becomes the reference if it rotated by more than 3 deg, or if its median ZNCC is below 0.9, and if it shows at least
/// half of the points. Displacements are then added. The subset's own gradients carry the fraction of a pixel between
/// the material's position and the new subset's centre. Subsets are searched for from their position in the previous
/// image.
pub struct Series {
    correlator: Correlator,
    grid: Vec<GridPoint>,
    kept: KeptReference,
    /// The material of each grid point; `None` once it was lost.
    material: Vec<Option<Material>>,
    /// The index of each grid point's subset in the kept reference.
    places: Vec<Option<usize>>,
    starts: Vec<Option<Warp>>,
    incremental: Vec<FieldPoint>,
    median_test: MedianTest,
    renewals: u32,
    /// Memory for the newest image and the warps of its subsets.
    target: PreparedFrame,
    warps: Vec<Option<Warp>>,
}

impl Series {
    /// Starts with a first image.
    ///
    /// # Panics
    ///
    /// If the size of the image differs from the correlator's plan.
    pub fn new(mut correlator: Correlator, first: ImageView<'_>, points: &[GridPoint]) -> Self {
        let prepared = correlator.prepare(first);
        let kept = correlator.keep_reference(prepared, points);
        let still = Material { moved: (0.0, 0.0), variance: (0.0, 0.0), offset: (0.0, 0.0) };
        Self {
            correlator,
            kept,
            grid: points.to_vec(),
            material: vec![Some(still); points.len()],
            places: (0..points.len()).map(Some).collect(),
            starts: vec![None; points.len()],
            incremental: Vec::new(),
            median_test: MedianTest::default(),
            renewals: 0,
            target: PreparedFrame::default(),
            warps: Vec::new(),
        }
    }

    /// The number of renewals of the reference.
    pub fn renewals(&self) -> u32 {
        self.renewals
    }

    /// Computes the displacements from the first image to this one, one per grid point, at the positions in the first
    /// image.
    ///
    /// `field` is cleared first. Points whose material was not found when the reference was renewed are lost
    /// permanently.
    ///
    /// # Panics
    ///
    /// If the size of the image differs from the plan.
    ///
    /// # Cost
    ///
    /// Allocates for the first image, and when the reference is renewed.
    pub fn push(&mut self, image: ImageView<'_>, field: &mut Vec<FieldPoint>) {
        let Self { correlator, kept, starts, incremental, target, warps, .. } = self;
        correlator.prepare_into(image, target);
        correlator.correlate_from(kept, target, starts, incremental);
        warps.clear();
        warps.extend(correlator.warps());
        field.clear();
        field.extend((0..self.grid.len()).map(|index| self.total_displacement(index)));
        self.median_test.mark(&self.grid, self.correlator.params().step_px, field);
        let followed = self.material.iter().flatten().count() as f64;
        let found = field.iter().filter(|point| point.displacement.is_some()).count() as f64;
        if found < MIN_FOUND_FRACTION * followed {
            // A foreign or dark image: the next one is processed as if this one had not been.
        } else if self.needs_renewal() {
            self.renew(field);
        } else {
            // A subset that was not found starts from its last position.
            self.starts.iter_mut().zip(&self.warps).for_each(|(start, warp)| *start = warp.or(*start));
        }
    }

    /// Returns the total displacement since the first image of the grid point with this index.
    ///
    /// It is the displacement up to the reference, plus that of the newest match at the material's position. The status
    /// is [`PointStatus::Lost`] without a subset in the reference.
    fn total_displacement(&self, index: usize) -> FieldPoint {
        let (x_px, y_px) = (self.grid[index].x as f32, self.grid[index].y as f32);
        let (Some(material), Some(place)) = (self.material[index], self.places[index]) else {
            return FieldPoint {
                x_px,
                y_px,
                displacement: None,
                zncc: None,
                peak_ratio: None,
                status: PointStatus::Lost,
            };
        };
        let found = &self.incremental[place];
        let displacement = self.warps[place].zip(found.displacement).map(|(warp, step)| {
            let (dx, dy) = material.offset;
            let sigma = |variance: f64, sigma: f32| (variance + f64::from(sigma).powi(2)).sqrt() as f32;
            Displacement {
                u_px: (material.moved.0 + warp.u + warp.ux * dx + warp.uy * dy) as f32,
                v_px: (material.moved.1 + warp.v + warp.vx * dx + warp.vy * dy) as f32,
                sigma_u_px: sigma(material.variance.0, step.sigma_u_px),
                sigma_v_px: sigma(material.variance.1, step.sigma_v_px),
            }
        });
        FieldPoint { x_px, y_px, displacement, ..*found }
    }

    /// Whether the reference must be renewed: the median rotation is above [`RENEW_DEG`], or the median ZNCC below
    /// [`RENEW_ZNCC`].
    fn needs_renewal(&self) -> bool {
        let turn = |warp: &Warp| (0.5 * (warp.uy - warp.vx)).atan().abs().to_degrees();
        let mut turns: Vec<f64> = self.warps.iter().flatten().map(turn).collect();
        let mut znccs: Vec<f64> = self.incremental.iter().filter_map(|point| point.zncc.map(f64::from)).collect();
        quantile(&mut turns, 0.5).is_some_and(|turn| turn > RENEW_DEG)
            || quantile(&mut znccs, 0.5).is_some_and(|zncc| zncc < RENEW_ZNCC)
    }

    /// Makes the newest image the reference, with subsets at the current positions of the material.
    ///
    /// `field` has the total displacements in this image. The material of points without one is lost.
    fn renew(&mut self, field: &[FieldPoint]) {
        let mut points = Vec::new();
        for (index, point) in field.iter().enumerate() {
            self.material[index] = point.displacement.and_then(|step| {
                let (u, v) = (f64::from(step.u_px), f64::from(step.v_px));
                let (x, y) = (f64::from(self.grid[index].x) + u, f64::from(self.grid[index].y) + v);
                let at = GridPoint { x: nearest_pixel(x)?, y: nearest_pixel(y)? };
                points.push(at);
                let before = self.material[index].map_or((0.0, 0.0), |material| material.variance);
                let added = |before: f64, sigma: f32| before + RENEWAL_FRACTION * (f64::from(sigma).powi(2) - before);
                let variance = (added(before.0, step.sigma_u_px), added(before.1, step.sigma_v_px));
                Some(Material { moved: (u, v), variance, offset: (x - f64::from(at.x), y - f64::from(at.y)) })
            });
            self.places[index] = self.material[index].map(|_| points.len() - 1);
        }
        let image = std::mem::take(&mut self.target);
        self.kept = self.correlator.keep_reference(image, &points);
        self.starts = vec![Some(Warp::default()); points.len()];
        self.renewals += 1;
    }
}

/// Returns the pixel nearest to a coordinate, px; `None` if it is negative, NaN or beyond the range of `u32`.
fn nearest_pixel(coordinate: f64) -> Option<u32> {
    (coordinate >= 0.0 && coordinate < f64::from(u32::MAX)).then(|| coordinate.round() as u32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dic::CorrelationParams;
    use crate::dic::geometry::grid;
    use crate::dic::tests::{Speckle, record};

    const SIDE: usize = 200;

    /// Tracks every point of `frames` images moved by `motion(frame)`. Returns the largest error, the root mean square
    /// of errors over sigmas, the points lost and the renewals.
    fn follow(frames: u64, roi_px: [u32; 4], motion: impl Fn(u64) -> Warp) -> (f64, f64, usize, u32) {
        let speckle = Speckle::standard(5, SIDE as f64);
        let params = CorrelationParams { step_px: 16, ..CorrelationParams::default() };
        let points = grid::rectangle(roi_px, params.step_px, params.subset_size_px);
        let image = |frame: u64| {
            let warp = motion(frame);
            let moved = speckle.moved(|x, y| {
                let (dx, dy) = (x - 100.0, y - 100.0);
                let (tx, ty) = warp.apply(dx, dy);
                (tx - dx, ty - dy)
            });
            record(&moved.draw(SIDE, SIDE), 1.0, 100 + frame)
        };
        let mut series = Series::new(Correlator::new(&params, SIDE, SIDE).unwrap(), image(0).view(), &points);
        let (mut worst, mut pulls, mut count, mut lost) = (0.0_f64, 0.0, 0, 0);
        let mut field = Vec::new();
        for frame in 1..=frames {
            series.push(image(frame).view(), &mut field);
            for (point, found) in points.iter().zip(&field) {
                let Some(found) = found.displacement else {
                    lost += 1;
                    continue;
                };
                let (dx, dy) = (f64::from(point.x) - 100.0, f64::from(point.y) - 100.0);
                let (x, y) = motion(frame).apply(dx, dy);
                let errors = [f64::from(found.u_px) - (x - dx), f64::from(found.v_px) - (y - dy)];
                for (error, sigma) in errors.into_iter().zip([found.sigma_u_px, found.sigma_v_px]) {
                    worst = worst.max(error.abs());
                    pulls += (error / f64::from(sigma)).powi(2);
                    count += 1;
                }
            }
        }
        let pulls = (pulls / f64::from(count)).sqrt();
        eprintln!("worst {worst:.4} px, pulls {pulls:.2}, {lost} lost, {} renewals", series.renewals());
        (worst, pulls, lost, series.renewals())
    }

    #[test]
    fn a_quarter_turn_is_followed_by_renewing_the_reference() {
        let turn = |frame: u64| Warp::rigid(0.0, 0.0, (2.37 * frame as f64).to_radians());
        let (worst, pulls, lost, renewals) = follow(38, [60, 60, 80, 80], turn);
        assert!(worst < 0.02 && (0.8..1.2).contains(&pulls) && lost == 0, "{worst} {pulls} {lost}");
        assert_eq!(renewals, 19, "at every second image, 4.74 deg");
    }

    #[test]
    fn a_shift_far_beyond_the_search_range_keeps_its_first_reference() {
        let shift = |frame: u64| Warp::shift(3.1 * frame as f64, -1.3 * frame as f64);
        let (worst, pulls, lost, renewals) = follow(20, [20, 100, 80, 80], shift);
        assert!(worst < 0.01 && (0.8..1.2).contains(&pulls) && lost == 0, "{worst} {pulls} {lost}");
        assert_eq!(renewals, 0);
    }

    #[test]
    fn a_foreign_image_is_skipped() {
        let params = CorrelationParams { step_px: 16, ..CorrelationParams::default() };
        let points = grid::rectangle([60, 60, 80, 80], params.step_px, params.subset_size_px);
        let own = |x: f64| Speckle::standard(5, SIDE as f64).moved(|_, _| (x, 0.0)).draw(SIDE, SIDE);
        let other = Speckle::standard(6, SIDE as f64).draw(SIDE, SIDE);
        let mut series = Series::new(Correlator::new(&params, SIDE, SIDE).unwrap(), own(0.0).view(), &points);
        for (image, moved) in [(own(0.4), Some(0.4)), (other, None), (own(1.1), Some(1.1))] {
            let mut found = Vec::new();
            series.push(record(&image, 1.0, 9).view(), &mut found);
            let valid: Vec<f32> = found.iter().filter_map(|point| point.displacement).map(|d| d.u_px).collect();
            match moved {
                Some(moved) => assert!(valid.len() == points.len() && valid.iter().all(|u| (u - moved).abs() < 0.02)),
                None => assert!(valid.len() * 4 < points.len(), "{} of {}", valid.len(), points.len()),
            }
        }
        assert_eq!(series.renewals(), 0);
    }

    #[test]
    fn material_that_leaves_the_image_is_lost_and_the_rest_is_tracked() {
        let motion = |frame: u64| Warp::rigid(-6.0 * frame as f64, 0.0, (3.2 * frame as f64).to_radians());
        let (worst, pulls, lost, renewals) = follow(10, [20, 20, 160, 160], motion);
        assert!(worst < 0.02 && pulls < 1.2 && lost > 20, "{worst} {pulls} {lost}");
        assert_eq!(renewals, 10);
    }
}
