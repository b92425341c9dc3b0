//! One Gauss-Newton update for all subsets whose motion is predicted.
//!
//! After a whole-body match, the remaining displacement of a subset is some hundredths of a pixel, and one IC-GN update
//! finds it. Subsets overlap and start from the same motion. The target is therefore resampled once into the geometry
//! of the reference, and the sums of every subset are taken from that image. A subset whose update is too long is
//! refined like any other.

use super::subset_match::{SubsetMatch, SubsetMatcher};
use crate::dic::geometry::{GridPoint, Pixel, Size, SubsetMask, Warp};
use crate::dic::image::{InterpolatedImage, PaddedImage, PreparedFrame, ShiftedRows, sample_lanes};
use crate::dic::refine::{GaussNewtonStep, Match};
use crate::dic::subset::{ColumnSums, Layers, Moments, ReferenceSubset, Strip};
use crate::dic::uncertainty::{GradientGain, GreyLevelFit, Lags, NoisePool};
use crate::numeric::{LANES, Lanes, Vector, vectorized};

/// The maximum length of a first step that leaves an error below a thousandth of a pixel, px.
const MAX_UPDATE_PX: f64 = 0.03;

/// The largest displacement gradient for which the target is resampled. Above, every subset is refined on its own.
const MAX_GRADIENT: f64 = 0.12;

/// The largest displacement gradient for which the target is resampled in tiles, with errors of position below 0.05 px.
const MAX_TILED_GRADIENT: f64 = 0.01;

/// The target of a pair of frames, resampled into the geometry of the reference.
#[derive(Default)]
pub(in crate::dic) struct PredictedUpdate {
    /// The resampled target, in the pixel grid of the reference.
    plane: PaddedImage,
    /// The first and last column of the strips in each row of the reference.
    spans: Vec<(i32, i32)>,
    columns: ColumnSums,
    /// The column sums of one subset that is not square.
    sums: Vec<f32>,
    /// The initial warp of each subset for which the target is resampled.
    starts: Vec<Option<Warp>>,
    /// The centre of each subset in the reference, px.
    centers: Vec<Pixel>,
    /// The grey-level fit of each subset found by one update.
    fits: Vec<Option<GreyLevelFit>>,
    subset: ReferenceSubset,
    /// The gradient gain of the texture: the factor that corrects one Gauss-Newton step.
    gradient_gain: f64,
}

impl PredictedUpdate {
    /// Resamples the target for the subsets that `starts` has warps for. All warps must belong to one rigid motion.
    ///
    /// `starts` follows the order of `points`. Subsets that leave a frame, deform too much or are half saturated lose
    /// their start.
    pub(in crate::dic) fn resample(
        &mut self,
        reference: &PreparedFrame,
        target: &PreparedFrame,
        points: &[GridPoint],
        window: &SubsetMask,
        starts: impl Iterator<Item = Option<Warp>>,
    ) {
        let size = reference.levels.size();
        self.starts.clear();
        self.starts.extend(points.iter().zip(starts).map(|(point, warp)| {
            let (at, to) = (reference.local(*point), target.local(*point));
            let is_sane =
                |warp: &Warp| warp.is_within(MAX_GRADIENT) && window.fits_warped(warp, to, target.interpolated.size());
            let is_usable = || window.extent.fits(at, size) && !is_half_saturated(reference, window, at);
            warp.filter(|warp| is_sane(warp) && is_usable())
        }));
        self.centers.clear();
        self.centers.extend(points.iter().map(|point| reference.local(*point)));
        self.fits.clear();
        self.fits.resize(points.len(), None);
        self.plane.reshape(size.width, size.height);
        let predicted = self.centers.iter().zip(&self.starts).filter_map(|(at, start)| start.map(|_| *at));
        self.columns.plan(window, predicted);
        let first = points.iter().zip(&self.starts).find_map(|(point, warp)| Some((*point, (*warp)?)));
        let Some((point, warp)) = first else { return };
        let (at, to) = (reference.local(point), target.local(point));
        let (dx, dy) = warp.apply(-f64::from(at.x), -f64::from(at.y));
        let motion = UniformWarp { x: f64::from(to.x) + dx, y: f64::from(to.y) + dy, warp };
        let strips = self.columns.strips();
        if warp.is_within(MAX_TILED_GRADIENT) {
            resample_tiles(reference, target, strips, &motion, &mut self.plane);
        } else {
            resample_rows(&target.interpolated, strips, &motion, &mut self.plane);
        }
        fill_row_spans(strips, size, &mut self.spans);
        self.gradient_gain = GradientGain::from_spans(reference, &self.spans).gain();
    }

    /// Returns the match of the subset with this index after one update.
    ///
    /// `None` if it has no start, no texture or too low a ZNCC, or if the update is longer than [`MAX_UPDATE_PX`].
    pub(in crate::dic) fn solve(&mut self, matcher: &SubsetMatcher<'_>, index: usize) -> Option<SubsetMatch> {
        let warp = (*self.starts.get(index)?)?;
        let (reference, window) = (matcher.reference, matcher.window);
        let at = self.centers[index];
        let layers = layers(reference, &self.plane);
        let moments = if window.is_square() {
            self.columns.moments(layers, window, at)
        } else {
            Moments::sum(layers, window, at, &mut self.sums)
        };
        self.subset.fill_from_moments(&moments, window.pixels, matcher.params.refined_shape()).ok()?;
        let matcher = SubsetMatcher { subset: &self.subset, ..*matcher };
        let update = matcher.refiner().solve_step(moments.target_sums(window.pixels)).ok()?;
        let GaussNewtonStep { step, zncc, zncc_gain } = update;
        let is_near = step.length(f64::from(window.half)) <= MAX_UPDATE_PX;
        let found = Match {
            warp: warp.after_inverse(&step.scaled(self.gradient_gain))?,
            second: [[0.0; 3]; 2],
            zncc: (zncc + zncc_gain).min(1.0),
            iterations: 1,
        };
        if !is_near || found.zncc < matcher.params.min_zncc {
            return None;
        }
        let pixels = window.pixels as f64;
        let means = ((moments.reference / pixels) as f32, (moments.target / pixels) as f32);
        let energy = moments.products[1] - moments.target * moments.target / pixels;
        self.fits[index] = Some(GreyLevelFit { means, gain: (self.subset.energy / energy).sqrt() as f32 });
        Some(matcher.accept(found, None))
    }

    /// Clears the prediction, so that no subset is found by one update.
    pub(in crate::dic) fn clear(&mut self) {
        self.starts.clear();
        self.fits.clear();
    }

    /// Whether the subset with this index was found by one update.
    pub(in crate::dic) fn is_found(&self, index: usize) -> bool {
        self.fits.get(index).is_some_and(Option::is_some)
    }

    /// Adds the texture, the residual and the gradient gain of a subset found by one update to the noise pool.
    ///
    /// Does nothing for another subset.
    ///
    /// `pairs` are those of [`count_pairs`](crate::dic::uncertainty::count_pairs) for the whole window.
    pub(in crate::dic) fn add_to_pool(
        &mut self,
        matcher: &SubsetMatcher<'_>,
        index: usize,
        pairs: &Lags,
        pool: &mut NoisePool,
    ) {
        let Some(fit) = self.fits[index] else { return };
        let layers = layers(matcher.reference, &self.plane);
        pool.add_layers(layers, matcher.window, pairs, self.centers[index], fit);
        pool.add_gradient_gain(GradientGain::from_subset(matcher.reference, matcher.window, matcher.at));
    }
}

/// Returns the layers of a reference and a resampled target.
fn layers<'a>(reference: &'a PreparedFrame, target: &'a PaddedImage) -> Layers<'a> {
    let PreparedFrame { levels, gradient_x, gradient_y, .. } = reference;
    Layers { reference: levels, gradient_x, gradient_y, target }
}

/// Computes the first and last column of the strips in each row of an image of the given size.
///
/// In rows without a strip the first column is larger than the last.
fn fill_row_spans(strips: &[Strip], size: Size, spans: &mut Vec<(i32, i32)>) {
    spans.clear();
    spans.resize(size.height, (i32::MAX, i32::MIN));
    for strip in strips {
        let end = (strip.left + LANES as i32).min(size.width as i32);
        for (left, right) in &mut spans[strip.top as usize..strip.end as usize] {
            (*left, *right) = ((*left).min(strip.left), (*right).max(end - 1));
        }
    }
}

/// Whether the rectangle of a subset holds more saturated pixels than half of the subset's.
///
/// Such a subset is extracted, which decides.
fn is_half_saturated(reference: &PreparedFrame, window: &SubsetMask, at: Pixel) -> bool {
    if !reference.saturation.is_finite() {
        return false;
    }
    let limit = reference.saturation - 0.5;
    let extent = window.extent;
    let (left, right) = ((at.x + extent.left) as usize, (at.x + extent.right) as usize);
    let count = |row: i32| reference.levels.row(row as usize)[left..=right].iter().filter(|v| **v >= limit).count();
    let over: usize = (at.y + extent.top..=at.y + extent.bottom).map(count).sum();
    2 * over > window.pixels
}

/// A warp of the whole reference.
struct UniformWarp {
    /// The position in the target of the first pixel of the reference, px.
    x: f64,
    y: f64,
    warp: Warp,
}

vectorized! {
    /// Resamples the target at the warped positions of the strips' pixels, row by row, into `out`.
    fn resample_rows(target: &InterpolatedImage, strips: &[Strip], motion: &UniformWarp, out: &mut PaddedImage) =
        resample_rows_with
}

/// Implements [`resample_rows`] on vectors of type `V`.
#[inline(always)]
fn resample_rows_with<V: Vector>(
    target: &InterpolatedImage,
    strips: &[Strip],
    motion: &UniformWarp,
    out: &mut PaddedImage,
) {
    let UniformWarp { x, y, warp } = motion;
    for (left, row) in strips.iter().flat_map(|strip| (strip.top..strip.end).map(|row| (strip.left, row))) {
        let (dx, dy) = (f64::from(left), f64::from(row));
        let (x, y) = (x + dx + warp.ux * dx + warp.uy * dy, y + dy + warp.vx * dx + warp.vy * dy);
        let values = match target.tap_count() {
            4 => sample_lanes::<V, 4, 5>(target, x, y, warp.ux, warp.vx),
            _ => sample_lanes::<V, 6, 7>(target, x, y, warp.ux, warp.vx),
        };
        let first = out.index(left as isize, row as isize);
        values.store(&mut out.data_mut()[first..]);
    }
}

vectorized! {
    /// Resamples like [`resample_rows`], in tiles that are only shifted. The reference gradients times the gain correct
    /// the displacement of each pixel relative to its tile.
    fn resample_tiles(
        reference: &PreparedFrame,
        target: &PreparedFrame,
        strips: &[Strip],
        motion: &UniformWarp,
        out: &mut PaddedImage,
    ) = resample_tiles_with
}

/// Implements [`resample_tiles`] on vectors of type `V`.
#[inline(always)]
fn resample_tiles_with<V: Vector>(
    reference: &PreparedFrame,
    target: &PreparedFrame,
    strips: &[Strip],
    motion: &UniformWarp,
    out: &mut PaddedImage,
) {
    for strip in strips {
        for top in (strip.top..strip.end).step_by(LANES) {
            let tile = Strip { left: strip.left, top, end: strip.end.min(top + LANES as i32) };
            match target.interpolated.tap_count() {
                4 => resample_tile::<V, 4>(reference, target, &tile, motion, out),
                _ => resample_tile::<V, 6>(reference, target, &tile, motion, out),
            }
        }
    }
}

/// Resamples one tile of at most eight rows for [`resample_tiles`]. For a kernel of `N` taps.
#[inline(always)]
fn resample_tile<V: Vector, const N: usize>(
    reference: &PreparedFrame,
    target: &PreparedFrame,
    tile: &Strip,
    motion: &UniformWarp,
    out: &mut PaddedImage,
) {
    let (warp, gain, rows) = (motion.warp, reference.gain_to(target), (tile.end - tile.top) as usize);
    let middle = (0.5 * (LANES as f64 - 1.0), 0.5 * (rows as f64 - 1.0));
    let (dx, dy) = warp.apply(f64::from(tile.left) + middle.0, f64::from(tile.top) + middle.1);
    // The position of the first pixel includes the shift of the warp.
    let (x, y) = (motion.x + dx - warp.u - middle.0, motion.y + dy - warp.v - middle.1);
    let mut column = ShiftedRows::<V, N>::new(&target.interpolated, x, y);
    let across = V::from_lanes(&Lanes::INDEX).sub(V::splat(middle.0 as f32));
    let apart = (across.mul(V::splat(gain * warp.ux as f32)), across.mul(V::splat(gain * warp.vx as f32)));
    let (first, stride) = (out.index(tile.left as isize, tile.top as isize), out.stride());
    for row in 0..rows {
        let down = row as f64 - middle.1;
        let (dx, dy) = (V::splat(gain * (warp.uy * down) as f32), V::splat(gain * (warp.vy * down) as f32));
        let place = first + row * stride;
        let load = |plane: &PaddedImage| V::load(&plane.data()[place..]);
        let (gx, gy) = (load(&reference.gradient_x), load(&reference.gradient_y));
        let value = column.next_row().plus_product(gx, apart.0.add(dx)).plus_product(gy, apart.1.add(dy));
        value.store(&mut out.data_mut()[place..]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dic::geometry::grid;
    use crate::dic::tests::{Speckle, record};
    use crate::dic::{CorrelationParams, Correlator, Interpolation, Start};
    use crate::image::Image;
    use crate::numeric::Portable;
    use crate::results::{FieldPoint, PointStatus};

    const CENTER: (f64, f64) = (70.0, 66.0);

    /// A pattern, and the same rotated about its centre, with an extra shift of its lower part.
    fn pair(motion: (f64, f64, f64), lower: f64) -> (Image, Image) {
        let speckle = Speckle::standard(31, 140.0);
        let turn = Warp::rigid(motion.0, motion.1, motion.2.to_radians());
        let moved = speckle.moved(|x, y| {
            let (dx, dy) = (x - CENTER.0, y - CENTER.1);
            let (tx, ty) = turn.apply(dx, dy);
            (tx - dx + if dy > 20.0 { lower } else { 0.0 }, ty - dy)
        });
        (speckle.draw(140, 132), moved.draw(140, 132))
    }

    fn fields(images: &(Image, Image), motion: (f64, f64, f64), seed: u64) -> [Vec<FieldPoint>; 2] {
        let params = CorrelationParams { step_px: 9, ..CorrelationParams::default() };
        let mut correlator = Correlator::new(&params, 140, 132).unwrap();
        let points = grid::disc(CENTER.0, CENTER.1, 56.0, 9, 31, 140, 132);
        let reference = correlator.prepare(record(&images.0, 2.0, seed).view());
        let target = correlator.prepare(record(&images.1, 2.0, seed + 1).view());
        let (x_px, y_px) = CENTER;
        let near = Start::Motion { x_px, y_px, u_px: motion.0 + 0.002, v_px: motion.1 - 0.001, angle_deg: motion.2 };
        [Start::Search, near].map(|start| {
            let mut field = Vec::new();
            correlator.correlate(&reference, &target, &points, start, &mut field);
            field
        })
    }

    /// The root mean square of u and v about a motion.
    fn scatter(field: &[FieldPoint], motion: (f64, f64, f64)) -> f64 {
        let turn = Warp::rigid(motion.0, motion.1, motion.2.to_radians());
        let square = |point: &FieldPoint| {
            let (dx, dy) = (f64::from(point.x_px) - CENTER.0, f64::from(point.y_px) - CENTER.1);
            let ((x, y), found) = (turn.apply(dx, dy), point.displacement.unwrap());
            (f64::from(found.u_px) - (x - dx)).powi(2) + (f64::from(found.v_px) - (y - dy)).powi(2)
        };
        (field.iter().map(square).sum::<f64>() / (2 * field.len()) as f64).sqrt()
    }

    #[test]
    fn one_update_is_as_accurate_as_a_search_with_equal_uncertainties() {
        for motion in [(0.37, -0.21, 0.13), (-0.45, 0.73, -0.4), (1.3, 0.2, 1.7)] {
            let images = pair(motion, 0.0);
            let (mut sums, mut sigmas) = ([0.0; 2], [0.0; 2]);
            for seed in 0..6 {
                let fields = fields(&images, motion, 10 * seed);
                for (k, field) in fields.iter().enumerate() {
                    assert!(field.iter().all(|point| point.status == PointStatus::Valid));
                    sums[k] += scatter(field, motion) / 6.0;
                    let sigma = |point: &FieldPoint| f64::from(point.displacement.unwrap().sigma_u_px);
                    sigmas[k] += field.iter().map(sigma).sum::<f64>() / (6 * field.len()) as f64;
                }
            }
            eprintln!(
                "{motion:?}: scatter {:.5} px after a search, {:.5} after one update; reported {sigmas:.5?}",
                sums[0], sums[1]
            );
            assert!(sums[1] < 1.03 * sums[0], "{motion:?}: {sums:?}");
            assert!((sigmas[1] / sigmas[0] - 1.0).abs() < 0.05, "{motion:?}: {sigmas:?}");
        }
    }

    #[test]
    fn subsets_that_do_not_follow_the_prediction_are_still_found() {
        let motion = (0.37, -0.21, 0.13);
        let [searched, carried] = fields(&pair(motion, 0.6), motion, 3);
        for (a, b) in searched.iter().zip(&carried) {
            let (a, b) = (a.displacement.unwrap(), b.displacement.unwrap());
            assert!((a.u_px - b.u_px).abs() < 0.004 && (a.v_px - b.v_px).abs() < 0.004, "{a:?} {b:?}");
        }
        let moved = searched.iter().filter(|point| point.displacement.unwrap().u_px > 0.8).count();
        assert!(moved > 5, "{moved}");
    }

    #[test]
    fn tiles_and_pixels_resample_alike_on_any_machine() {
        let (reference, target) = pair((0.0, 0.0, 0.0), 0.0);
        let (mut a, mut b) = (PreparedFrame::default(), PreparedFrame::default());
        a.fill(reference.view(), Interpolation::Optimised);
        b.fill(target.view(), Interpolation::Optimised);
        // About a third of a degree.
        let warp = Warp::rigid(0.4, -0.3, 0.006);
        let motion = UniformWarp { x: -0.3, y: 0.7, warp };
        let strips: Vec<_> = (20..100).step_by(LANES).map(|left| Strip { left, top: 0, end: 110 }).collect();
        let mut planes =
            [PaddedImage::default(), PaddedImage::default(), PaddedImage::default(), PaddedImage::default()];
        planes.iter_mut().for_each(|plane| plane.reshape(140, 132));
        let [rows, tiles, plain_rows, plain_tiles] = &mut planes;
        resample_rows(&b.interpolated, &strips, &motion, rows);
        resample_tiles(&b, &b, &strips, &motion, tiles);
        resample_rows_with::<Portable>(&b.interpolated, &strips, &motion, plain_rows);
        resample_tiles_with::<Portable>(&b, &b, &strips, &motion, plain_tiles);
        assert!(*rows == *plain_rows && *tiles == *plain_tiles);
        let apart = |y: usize| rows.row(y)[20..100].iter().zip(&tiles.row(y)[20..100]).map(|(a, b)| (a - b).powi(2));
        let square: f32 = (4..106).flat_map(apart).sum::<f32>() / (80.0 * 102.0);
        // The gradients belong to places up to 0.7 px away here, unlike those of a subset.
        assert!(square.sqrt() < 1.0, "rms {} DN", square.sqrt());
    }
}
