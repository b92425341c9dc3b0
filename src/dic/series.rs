//! A series of pictures against one reference, kept as long as it serves.

use super::GridPoint;
use super::correlator::{Correlator, KeptReference};
use super::prepared::Prepared;
use super::validate::MedianTest;
use super::warp::Warp;
use crate::image::ImageView;
use crate::results::{Displacement, FieldPoint, PointStatus};

/// Turn against the reference from which on it is renewed, deg.
///
/// Beyond, eight neighbouring pixels of a subset no longer lie in neighbouring
/// cells for long, and out-of-plane effects begin to tell.
const RENEW_DEG: f64 = 3.0;

/// Median ZNCC below which the reference is renewed.
const RENEW_ZNCC: f64 = 0.9;

/// Share of the points still followed that a picture must show for it to say where they are looked for next.
const LEAST_FOUND: f64 = 0.5;

/// Share of a match's variance that a renewal leaves for good.
///
/// The noise of the picture that becomes the reference enters before and after with opposite signs and nearly
/// cancels; what stays was measured on rendered patterns turned by 90 deg in steps of 5 deg.
const RENEWAL_SHARE: f64 = 0.07;

/// Where the material of one grid point was when the reference was taken.
#[derive(Debug, Clone, Copy)]
struct Carried {
    /// Displacement from the first picture to the reference, px.
    moved: (f64, f64),
    /// What the renewals up to then have added to the variance, px^2.
    variance: (f64, f64),
    /// From the whole pixel that the reference's subset is centred on, px.
    offset: (f64, f64),
}

/// Follows the points of a first picture through later ones.
///
/// Every picture is compared with a reference that is kept: errors do not add
/// up from picture to picture. It is renewed by the newest picture when that has
/// turned by more than 3 deg against it, or correlates with a median ZNCC under
/// 0.9, and shows at least half of the points; displacements are then added, with the fraction of a pixel between the
/// material's place and the new subset's centre carried by the subset's own
/// gradients. Subsets are looked for from where they were found in the picture
/// before.
pub struct Series {
    correlator: Correlator,
    grid: Vec<GridPoint>,
    kept: KeptReference,
    /// Per grid point; `None` once its material was lost.
    carried: Vec<Option<Carried>>,
    /// Which subset of the kept reference belongs to each grid point.
    places: Vec<Option<usize>>,
    starts: Vec<Option<Warp>>,
    incremental: Vec<FieldPoint>,
    median_test: MedianTest,
    renewals: u32,
    /// Memory for the newest picture, and for where its subsets were found.
    target: Prepared,
    warps: Vec<Option<Warp>>,
    sorted: Vec<f64>,
}

impl Series {
    /// Begins with a first picture.
    ///
    /// # Panics
    ///
    /// If the picture has another size than the correlator was planned for.
    pub fn new(mut correlator: Correlator, first: ImageView<'_>, points: &[GridPoint]) -> Self {
        let prepared = correlator.prepare(first);
        let kept = correlator.keep(prepared, points);
        let still = Carried { moved: (0.0, 0.0), variance: (0.0, 0.0), offset: (0.0, 0.0) };
        Self {
            correlator,
            kept,
            grid: points.to_vec(),
            carried: vec![Some(still); points.len()],
            places: (0..points.len()).map(Some).collect(),
            starts: vec![None; points.len()],
            incremental: Vec::new(),
            median_test: MedianTest::default(),
            renewals: 0,
            target: Prepared::default(),
            warps: Vec::new(),
            sorted: Vec::new(),
        }
    }

    /// How often the reference was renewed.
    pub fn renewals(&self) -> u32 {
        self.renewals
    }

    /// Displacements from the first picture to this one, one point per grid point, in the first picture's places.
    ///
    /// `field` is cleared first. Points whose material was not found when the reference was renewed are lost for good.
    ///
    /// # Panics
    ///
    /// If the picture has another size than planned.
    ///
    /// # Cost
    ///
    /// Allocates for the first picture, and when the reference is renewed.
    pub fn push(&mut self, picture: ImageView<'_>, field: &mut Vec<FieldPoint>) {
        let Self { correlator, kept, starts, incremental, target, warps, .. } = self;
        correlator.prepare_into(picture, target);
        correlator.correlate_from(kept, target, starts, incremental);
        warps.clear();
        warps.extend(correlator.warps());
        field.clear();
        field.extend((0..self.grid.len()).map(|index| self.total(index)));
        self.median_test.mark(&self.grid, self.correlator.params().step_px, field);
        let followed = self.carried.iter().flatten().count() as f64;
        let found = field.iter().filter(|point| point.displacement.is_some()).count() as f64;
        if found < LEAST_FOUND * followed {
            // A picture of something else, or too dark: the next one is compared as if this had not been.
        } else if self.is_worn_out() {
            self.renew(field);
        } else {
            // A subset that was not found begins where it was found last.
            self.starts.iter_mut().zip(&self.warps).for_each(|(start, warp)| *start = warp.or(*start));
        }
    }

    /// What has become of one point since the first picture.
    fn total(&self, index: usize) -> FieldPoint {
        let (x_px, y_px) = (self.grid[index].x as f32, self.grid[index].y as f32);
        let (Some(carried), Some(place)) = (self.carried[index], self.places[index]) else {
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
            let (dx, dy) = carried.offset;
            let sigma = |variance: f64, sigma: f32| (variance + f64::from(sigma).powi(2)).sqrt() as f32;
            Displacement {
                u_px: (carried.moved.0 + warp.u + warp.ux * dx + warp.uy * dy) as f32,
                v_px: (carried.moved.1 + warp.v + warp.vx * dx + warp.vy * dy) as f32,
                sigma_u_px: sigma(carried.variance.0, step.sigma_u_px),
                sigma_v_px: sigma(carried.variance.1, step.sigma_v_px),
            }
        });
        FieldPoint { x_px, y_px, displacement, ..*found }
    }

    /// Whether the reference no longer serves.
    fn is_worn_out(&mut self) -> bool {
        let turn = |warp: &Warp| (0.5 * (warp.uy - warp.vx)).atan().abs().to_degrees();
        let turns = self.warps.iter().flatten().map(turn);
        let is_turned = median(turns, &mut self.sorted).is_some_and(|turn| turn > RENEW_DEG);
        let znccs = self.incremental.iter().filter_map(|point| point.zncc.map(f64::from));
        is_turned || median(znccs, &mut self.sorted).is_some_and(|zncc| zncc < RENEW_ZNCC)
    }

    /// Takes the newest picture as the reference, with subsets where the material is now.
    fn renew(&mut self, field: &[FieldPoint]) {
        let mut points = Vec::new();
        for (index, point) in field.iter().enumerate() {
            self.carried[index] = point.displacement.and_then(|step| {
                let (u, v) = (f64::from(step.u_px), f64::from(step.v_px));
                let (x, y) = (f64::from(self.grid[index].x) + u, f64::from(self.grid[index].y) + v);
                let at = GridPoint { x: whole(x)?, y: whole(y)? };
                points.push(at);
                let before = self.carried[index].map_or((0.0, 0.0), |carried| carried.variance);
                let added = |before: f64, sigma: f32| before + RENEWAL_SHARE * (f64::from(sigma).powi(2) - before);
                let variance = (added(before.0, step.sigma_u_px), added(before.1, step.sigma_v_px));
                Some(Carried { moved: (u, v), variance, offset: (x - f64::from(at.x), y - f64::from(at.y)) })
            });
            self.places[index] = self.carried[index].map(|_| points.len() - 1);
        }
        let picture = std::mem::take(&mut self.target);
        self.kept = self.correlator.keep(picture, &points);
        self.starts = vec![Some(Warp::default()); points.len()];
        self.renewals += 1;
    }
}

/// The nearest whole pixel, if there is one.
fn whole(place: f64) -> Option<u32> {
    (place >= 0.0 && place < f64::from(u32::MAX)).then(|| place.round() as u32)
}

/// The middle one of some values, put in order in `sorted`.
fn median(values: impl Iterator<Item = f64>, sorted: &mut Vec<f64>) -> Option<f64> {
    sorted.clear();
    sorted.extend(values);
    let middle = sorted.len() / 2;
    (!sorted.is_empty()).then(|| *sorted.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dic::speckle::{Speckle, record};
    use crate::dic::{CorrelationParams, grid};

    const SIDE: usize = 200;

    /// Every point of `frames` pictures moved by `motion(frame)`: worst error, root mean square of the errors over
    /// their sigmas, points lost, renewals.
    fn follow(frames: u64, roi_px: [u32; 4], motion: impl Fn(u64) -> Warp) -> (f64, f64, usize, u32) {
        let speckle = Speckle::standard(5, SIDE as f64);
        let params = CorrelationParams { step_px: 16, ..CorrelationParams::default() };
        let points = grid::rectangle(roi_px, params.step_px, params.subset_size_px);
        let picture = |frame: u64| {
            let warp = motion(frame);
            let moved = speckle.moved(|x, y| {
                let (dx, dy) = (x - 100.0, y - 100.0);
                let (tx, ty) = warp.apply(dx, dy);
                (tx - dx, ty - dy)
            });
            record(&moved.draw(SIDE, SIDE), 1.0, 100 + frame)
        };
        let mut series = Series::new(Correlator::new(&params, SIDE, SIDE).unwrap(), picture(0).view(), &points);
        let (mut worst, mut pulls, mut count, mut lost) = (0.0_f64, 0.0, 0, 0);
        let mut field = Vec::new();
        for frame in 1..=frames {
            series.push(picture(frame).view(), &mut field);
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
        assert_eq!(renewals, 19, "at every second picture, 4.74 deg");
    }

    #[test]
    fn a_shift_far_beyond_the_search_range_keeps_its_first_reference() {
        let shift = |frame: u64| Warp::shift(3.1 * frame as f64, -1.3 * frame as f64);
        let (worst, pulls, lost, renewals) = follow(20, [20, 100, 80, 80], shift);
        assert!(worst < 0.01 && (0.8..1.2).contains(&pulls) && lost == 0, "{worst} {pulls} {lost}");
        assert_eq!(renewals, 0);
    }

    #[test]
    fn a_picture_of_something_else_is_passed_over() {
        let params = CorrelationParams { step_px: 16, ..CorrelationParams::default() };
        let points = grid::rectangle([60, 60, 80, 80], params.step_px, params.subset_size_px);
        let own = |x: f64| Speckle::standard(5, SIDE as f64).moved(|_, _| (x, 0.0)).draw(SIDE, SIDE);
        let other = Speckle::standard(6, SIDE as f64).draw(SIDE, SIDE);
        let mut series = Series::new(Correlator::new(&params, SIDE, SIDE).unwrap(), own(0.0).view(), &points);
        for (picture, moved) in [(own(0.4), Some(0.4)), (other, None), (own(1.1), Some(1.1))] {
            let mut found = Vec::new();
            series.push(record(&picture, 1.0, 9).view(), &mut found);
            let valid: Vec<f32> = found.iter().filter_map(|point| point.displacement).map(|d| d.u_px).collect();
            match moved {
                Some(moved) => assert!(valid.len() == points.len() && valid.iter().all(|u| (u - moved).abs() < 0.02)),
                None => assert!(valid.len() * 4 < points.len(), "{} of {}", valid.len(), points.len()),
            }
        }
        assert_eq!(series.renewals(), 0);
    }

    #[test]
    fn material_that_leaves_the_picture_is_lost_and_the_rest_goes_on() {
        let motion = |frame: u64| Warp::rigid(-6.0 * frame as f64, 0.0, (3.2 * frame as f64).to_radians());
        let (worst, pulls, lost, renewals) = follow(10, [20, 20, 160, 160], motion);
        assert!(worst < 0.02 && pulls < 1.2 && lost > 20, "{worst} {pulls} {lost}");
        assert_eq!(renewals, 10);
    }
}
