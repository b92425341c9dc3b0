//! Searches for a rigid body at any rotation and anywhere in the image.
//!
//! The subsampled template is rotated in equal steps over the full circle. At each step it is located in the whole
//! target by masked normalised cross-correlation (D. Padfield, IEEE Trans. Image Process. 21 (2012) 2706,
//! <https://doi.org/10.1109/TIP.2011.2181402>; only the template is masked here). The best candidates are refined on
//! the subsampled images, and the best match of these on the full images.

use super::motion::BodyMotion;
use super::rigid_body::RigidBody;
use crate::dic::geometry::{PlanarMotion, Point, Region, Warp};
use crate::dic::image::{Interpolation, PaddedImage, PreparedFrame};
use crate::dic::refine::Match;
use crate::image::Image;
use crate::numeric::{Complex32, Fft2d, fast_size};
use crate::results::PointStatus;

/// The largest side of the subsampled images, px.
const COARSE_SIDE: usize = 256;

/// The smallest radius of a body in the subsampled images, px.
const COARSE_RADIUS: f64 = 12.0;

/// The displacement of the rim from one rotation to the next, subsampled px.
const RIM_STEP: f64 = 1.5;

/// The maximum number of candidates that are refined.
const MAX_CANDIDATES: usize = 5;

/// The minimum ZNCC of an accepted match.
const MIN_ZNCC: f64 = 0.5;

/// The best position at one rotation.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    score: f32,
    angle_rad: f64,
    /// The position of the body's centre in the subsampled target, px.
    center: Point,
}

impl Candidate {
    /// Returns the motion that moves `center`, the body's in the subsampled reference, to this position.
    fn motion_of(&self, center: Point) -> PlanarMotion {
        let offset = self.center.relative_to(center);
        PlanarMotion { u_px: offset.x_px, v_px: offset.y_px, angle_deg: self.angle_rad.to_degrees() }
    }
}

/// Finds the motion of `region` from `reference` to `target`, at any rotation and anywhere in the image.
///
/// The displacement returned is that of `point` in the reference.
///
/// # Errors
///
/// - [`PointStatus::LowCorrelation`] if the region is not found.
/// - [`PointStatus::Ambiguous`] if two different motions explain the images about equally well.
/// - The errors of [`RigidBody::new`].
///
/// # Panics
///
/// If only a part of either frame was prepared.
///
/// # Cost
///
/// Some tenths of a second. Intended for the first frame and for lost bodies. Allocates.
pub fn find_at_any_angle(
    reference: &PreparedFrame,
    target: &PreparedFrame,
    region: &Region,
    point: Point,
) -> Result<BodyMotion, PointStatus> {
    let mut body = RigidBody::new(reference, region)?;
    let coarse = SubsampledPair::new(reference, target, region, &body)?;
    let candidates = search_angles(&coarse.body, &coarse.reference, &coarse.target, std::f64::consts::PI);
    let matches = refine_candidates(&coarse.body, &coarse.target, &candidates);
    let best = matches.first().filter(|found| found.zncc >= MIN_ZNCC).ok_or(PointStatus::LowCorrelation)?;
    let rival = matches.iter().find(|other| are_different(best, other));
    if rival.is_some_and(|other| 1.0 - other.zncc < 2.0 * (1.0 - best.zncc) + 0.02) {
        return Err(PointStatus::Ambiguous);
    }
    let center = body.center();
    let found = body.find(target, center, coarse.full_motion(&best.warp, center))?;
    body.find(target, point, found.motion.planar().at_offset(point.relative_to(center)))
}

/// Finds the motion of a partly occluded body among rotations of at most `max_deg` either way.
///
/// Works like [`find_at_any_angle`] and returns the match with the largest product of visible fraction and ZNCC. The
/// cost is proportional to the range of rotations.
///
/// # Errors
///
/// The errors of [`find_at_any_angle`].
///
/// # Panics
///
/// If only a part of either frame was prepared.
pub fn find_occluded_within_angle(
    reference: &PreparedFrame,
    target: &PreparedFrame,
    region: &Region,
    point: Point,
    max_deg: f64,
) -> Result<BodyMotion, PointStatus> {
    let mut body = RigidBody::new(reference, region)?;
    let mut coarse = SubsampledPair::new(reference, target, region, &body)?;
    let (center, coarse_center) = (body.center(), coarse.body.center());
    let mut found: Vec<BodyMotion> = Vec::new();
    for candidate in search_angles(&coarse.body, &coarse.reference, &coarse.target, max_deg.to_radians()) {
        let near = candidate.motion_of(coarse_center);
        let Ok(rough) = coarse.body.find_visible(&coarse.target, coarse_center, near) else { continue };
        let near = coarse.full_motion(&rough.motion.planar().to_warp(), center).at_offset(point.relative_to(center));
        found.extend(body.find_visible(target, point, near));
    }
    let weight = |motion: &BodyMotion| motion.visible_fraction * motion.zncc;
    found.sort_by(|a, b| weight(b).total_cmp(&weight(a)));
    let best = *found.first().filter(|best| best.zncc >= MIN_ZNCC).ok_or(PointStatus::LowCorrelation)?;
    let apart = |other: &BodyMotion| {
        let (a, b) = (best.motion, other.motion);
        (a.u_px - b.u_px).hypot(a.v_px - b.v_px) > 2.0 || (a.angle_deg - b.angle_deg).abs() > 5.0
    };
    let is_ambiguous = found.iter().any(|other| apart(other) && weight(other) > 0.7 * weight(&best));
    if is_ambiguous { Err(PointStatus::Ambiguous) } else { Ok(best) }
}

/// The subsampled frames and the body in them.
struct SubsampledPair {
    factor: usize,
    reference: PreparedFrame,
    target: PreparedFrame,
    body: RigidBody,
}

impl SubsampledPair {
    /// Subsamples two whole frames and extracts the body in the first.
    ///
    /// # Errors
    ///
    /// The errors of [`RigidBody::new`].
    ///
    /// # Panics
    ///
    /// If only a part of either frame was prepared.
    fn new(
        reference: &PreparedFrame,
        target: &PreparedFrame,
        region: &Region,
        body: &RigidBody,
    ) -> Result<Self, PointStatus> {
        assert!(reference.is_whole() && target.is_whole(), "the rotation search needs whole frames");
        let factor = coarse_factor(reference, body);
        let coarse = |frame: &PreparedFrame| {
            let mut prepared = PreparedFrame::default();
            prepared.fill(subsample(&frame.levels, factor).view(), Interpolation::Optimised);
            prepared
        };
        let (reference, target) = (coarse(reference), coarse(target));
        let body = RigidBody::new(&reference, &subsampled_region(region, factor))?;
        Ok(Self { factor, reference, target, body })
    }

    /// Converts a warp of the subsampled body to the motion of the full body's `center`, px.
    fn full_motion(&self, warp: &Warp, center: Point) -> PlanarMotion {
        let scale = self.factor as f64;
        let full = |coarse: f64| coarse * scale + 0.5 * (scale - 1.0);
        let coarse = self.body.center();
        let (dx, dy) = (center.x_px - full(coarse.x_px), center.y_px - full(coarse.y_px));
        let (tx, ty) = Warp { u: 0.0, v: 0.0, ..*warp }.apply(dx, dy);
        let angle_deg = warp.uy.atan2(1.0 + warp.ux).to_degrees();
        PlanarMotion { u_px: warp.u * scale + tx - dx, v_px: warp.v * scale + ty - dy, angle_deg }
    }
}

/// Returns the subsampling factor along each axis, at least 1.
///
/// The image gets [`COARSE_SIDE`] pixels along its longer side, unless the body would become smaller than
/// [`COARSE_RADIUS`].
fn coarse_factor(frame: &PreparedFrame, body: &RigidBody) -> usize {
    let radius = (body.pixels() as f64 / std::f64::consts::PI).sqrt();
    let side = frame.width().max(frame.height());
    let wanted = side.div_ceil(COARSE_SIDE);
    let allowed = (radius / COARSE_RADIUS).floor().max(1.0) as usize;
    wanted.clamp(1, allowed)
}

/// Returns the image of the means over squares of `factor` x `factor` pixels.
fn subsample(levels: &PaddedImage, factor: usize) -> Image {
    let (width, height) = (levels.width() / factor, levels.height() / factor);
    let mut image = Image::new(width, height);
    let scale = 1.0 / (factor * factor) as f32;
    for (y, line) in image.rows_mut().enumerate() {
        for row in (y * factor..(y + 1) * factor).map(|row| levels.row(row)) {
            for (value, square) in line.iter_mut().zip(row.chunks_exact(factor)) {
                *value += scale * square.iter().sum::<f32>();
            }
        }
    }
    image
}

/// Converts a region in pixels to one in subsampled pixels.
fn subsampled_region(region: &Region, factor: usize) -> Region {
    let scale = factor as f64;
    let place = |full: f64| (full - 0.5 * (scale - 1.0)) / scale;
    let line = |corners: &[[f64; 2]]| corners.iter().map(|[x, y]| [place(*x), place(*y)]).collect();
    match region {
        Region::Disc { x_px, y_px, radius_px } => {
            Region::Disc { x_px: place(*x_px), y_px: place(*y_px), radius_px: radius_px / scale }
        }
        Region::Ring { x_px, y_px, inner_px, outer_px } => Region::Ring {
            x_px: place(*x_px),
            y_px: place(*y_px),
            inner_px: inner_px / scale,
            outer_px: outer_px / scale,
        },
        Region::Polygon { outline_px, holes_px } => {
            Region::Polygon { outline_px: line(outline_px), holes_px: holes_px.iter().map(|hole| line(hole)).collect() }
        }
    }
}

/// Returns the best position at each rotation up to `max_rad` either way that scores higher than the rotations next to
/// it: at most [`MAX_CANDIDATES`], best first.
fn search_angles(body: &RigidBody, reference: &PreparedFrame, target: &PreparedFrame, max_rad: f64) -> Vec<Candidate> {
    let radius = f64::from(body.window().half);
    let count = ((std::f64::consts::TAU * radius / RIM_STEP).ceil() as usize).clamp(12, 720);
    let mut search = MaskedSearch::new(target);
    let angle = |k: usize| std::f64::consts::TAU * k as f64 / count as f64;
    let is_tried = |k: &usize| angle(*k).min(std::f64::consts::TAU - angle(*k)) <= max_rad;
    let search = |k: usize| Some(k).filter(is_tried).and_then(|k| search.best_position(body, reference, angle(k)));
    let found: Vec<Option<Candidate>> = (0..count).map(search).collect();
    let score = |k: usize| found[k % count].map_or(f32::NEG_INFINITY, |candidate| candidate.score);
    let peaks = (0..count).filter(|k| score(*k) >= score(k + 1) && score(*k) > score(k + count - 1));
    let mut candidates: Vec<Candidate> = peaks.filter_map(|k| found[k]).collect();
    candidates.sort_by(|a, b| b.score.total_cmp(&a.score));
    candidates.truncate(MAX_CANDIDATES);
    candidates
}

/// Refines the candidates to sub-pixel precision and sorts them by ZNCC, best first. Drops those that fail.
fn refine_candidates(body: &RigidBody, target: &PreparedFrame, candidates: &[Candidate]) -> Vec<Match> {
    let center = body.center();
    let refined = |candidate: &Candidate| {
        let offset = candidate.center.relative_to(center);
        body.refine(target, Warp::rigid(offset.x_px, offset.y_px, candidate.angle_rad)).ok()
    };
    let mut matches: Vec<Match> = candidates.iter().filter_map(refined).collect();
    matches.sort_by(|a, b| b.zncc.total_cmp(&a.zncc));
    matches
}

/// Whether two matches are different motions rather than one motion found twice: more than 2 px or some 6 deg apart.
fn are_different(a: &Match, b: &Match) -> bool {
    let (a, b) = (a.warp, b.warp);
    let turned = (a.ux - b.ux).hypot(a.uy - b.uy);
    (a.u - b.u).hypot(a.v - b.v) > 2.0 || turned > 0.1
}

/// Masked normalised cross-correlation of rotated templates with one target.
struct MaskedSearch {
    fft: Fft2d,
    width: usize,
    height: usize,
    /// The spectrum of the target.
    levels: Vec<Complex32>,
    /// The spectrum of target + i target squared.
    squares: Vec<Complex32>,
    /// The template in the real parts and its mask in the imaginary parts, then their spectrum.
    template: Vec<Complex32>,
    /// The correlation of the target with the template.
    product: Vec<Complex32>,
    /// The correlation of target + i target squared with the mask.
    sums: Vec<Complex32>,
}

impl MaskedSearch {
    /// Computes the spectra of a whole target and of its squares.
    fn new(target: &PreparedFrame) -> Self {
        let (width, height) = (target.width(), target.height());
        let mut fft = Fft2d::new(fast_size(width.max(height)));
        let (mut levels, mut squares) = (fft.memory(), fft.memory());
        for y in 0..height {
            for (x, level) in target.levels.row(y).iter().enumerate() {
                levels[y * fft.size() + x] = Complex32::new(*level, 0.0);
                squares[y * fft.size() + x] = Complex32::new(*level, level * level);
            }
        }
        fft.forward(&mut levels);
        fft.forward(&mut squares);
        let (template, product, sums) = (fft.memory(), fft.memory(), fft.memory());
        Self { fft, width, height, levels, squares, template, product, sums }
    }

    /// Returns the position of the highest correlation of the body rotated by an angle; `None` if it fits nowhere.
    fn best_position(&mut self, body: &RigidBody, reference: &PreparedFrame, angle_rad: f64) -> Option<Candidate> {
        let template = Template::rotated(body, reference, angle_rad);
        let size = self.fft.size();
        if template.reach.0 * 2 >= self.width || template.reach.1 * 2 >= self.height {
            return None;
        }
        // The centre lies at the origin.
        self.template.fill(Complex32::default());
        for (dx, dy, level) in &template.pixels {
            let (x, y) = (dx.rem_euclid(size as i32) as usize, dy.rem_euclid(size as i32) as usize);
            self.template[y * size + x] = Complex32::new(*level, 1.0);
        }
        self.fft.forward(&mut self.template);
        self.multiply_spectra();
        self.fft.inverse(&mut self.product);
        self.fft.inverse(&mut self.sums);
        let scale = 1.0 / (size * size) as f32;
        let count = template.pixels.len() as f32;
        let mut best = Candidate { score: f32::NEG_INFINITY, angle_rad, center: Point::default() };
        for y in template.reach.1..self.height - template.reach.1 {
            for x in template.reach.0..self.width - template.reach.0 {
                let sums = self.sums[y * size + x] * scale;
                let contrast = sums.im - sums.re * sums.re / count;
                let product = self.product[y * size + x].re * scale;
                if product > 0.0 && contrast > 0.05 * count {
                    let score = product / (contrast * template.energy).sqrt();
                    if score > best.score {
                        best = Candidate { score, center: Point::new(x as f64, y as f64), ..best };
                    }
                }
            }
        }
        best.score.is_finite().then_some(best)
    }

    /// Computes the cross spectra: target and template into `product`, target + i squares and mask into `sums`.
    fn multiply_spectra(&mut self) {
        let size = self.fft.size();
        for k in 0..size * size {
            let opposite = (size - k / size) % size * size + (size - k % size) % size;
            let (own, opposite) = (self.template[k], self.template[opposite].conj());
            self.product[k] = self.levels[k] * (0.5 * (own + opposite)).conj();
            // The mask is the imaginary part, so its spectrum is that of the difference over i.
            self.sums[k] = self.squares[k] * (Complex32::new(0.0, -0.5) * (own - opposite)).conj();
        }
    }
}

/// The pixels of a body rotated about its centre.
struct Template {
    /// The offset from the centre, px, and the grey level minus the mean.
    pixels: Vec<(i32, i32, f32)>,
    energy: f32,
    /// The largest offset along x and y, px.
    reach: (usize, usize),
}

impl Template {
    /// Samples the body of the reference, rotated counter-clockwise by an angle about its centre.
    fn rotated(body: &RigidBody, reference: &PreparedFrame, angle_rad: f64) -> Self {
        let window = body.window();
        let reach = (f64::from(window.half) * std::f64::consts::SQRT_2).ceil() as i32;
        let back = Warp::rigid(0.0, 0.0, -angle_rad);
        let Point { x_px: cx, y_px: cy } = body.center();
        let mut pixels = Vec::new();
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let (x, y) = back.apply(f64::from(dx), f64::from(dy));
                if window.contains(x.round() as i32, y.round() as i32) {
                    pixels.push((dx, dy, reference.interpolated.value_at(cx + x, cy + y)));
                }
            }
        }
        let mean = pixels.iter().map(|pixel| pixel.2).sum::<f32>() / pixels.len().max(1) as f32;
        pixels.iter_mut().for_each(|pixel| pixel.2 -= mean);
        let energy = pixels.iter().map(|pixel| pixel.2 * pixel.2).sum();
        let extent = |pick: fn(&(i32, i32, f32)) -> i32| {
            pixels.iter().map(|pixel| pick(pixel).unsigned_abs() as usize).max().unwrap_or(0)
        };
        Self { energy, reach: (extent(|p| p.0), extent(|p| p.1)), pixels }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dic::field::rigid_fit;
    use crate::dic::geometry::grid;
    use crate::dic::tests::{Speckle, prepared, record};
    use crate::dic::{CorrelationParams, Correlator, Start};

    #[test]
    fn a_ball_is_found_at_any_angle_and_half_an_image_away() {
        let speckle = Speckle::standard(31, 300.0);
        let region = Region::Disc { x_px: 90.0, y_px: 100.0, radius_px: 50.0 };
        let reference = prepared(&record(&speckle.draw(300, 240), 2.0, 1));
        for (case, (u, v, angle_deg)) in
            [(12.3, -7.7, 30.0), (118.4, 31.6, 90.0), (100.2, 28.9, 170.0), (-20.6, 60.3, -101.3)]
                .into_iter()
                .enumerate()
        {
            let turn = Warp::rigid(u, v, f64::to_radians(angle_deg));
            let moved = speckle.moved(|x, y| {
                let (tx, ty) = turn.apply(x - 90.0, y - 100.0);
                (tx - (x - 90.0), ty - (y - 100.0))
            });
            let target = prepared(&record(&moved.draw(300, 240), 2.0, 2 + case as u64));
            let found = find_at_any_angle(&reference, &target, &region, Point::new(90.0, 100.0)).unwrap().motion;
            let error = [found.u_px - u, found.v_px - v, found.angle_deg - angle_deg];
            eprintln!("{angle_deg} deg: errors {error:?}");
            assert!(error.iter().all(|error| error.abs() < 0.01), "{angle_deg} deg: {error:?}");
            let mut correlator = Correlator::new(&CorrelationParams::default(), 300, 240).unwrap();
            let (x_px, y_px, u_px, v_px) = (90.0, 100.0, found.u_px, found.v_px);
            let start = Start::Motion { x_px, y_px, u_px, v_px, angle_deg: found.angle_deg };
            let points = grid::disc(90.0, 100.0, 50.0, 10, 31, 300, 240);
            let mut field = Vec::new();
            correlator.correlate(&reference, &target, &points, start, &mut field);
            assert!(field.iter().all(|point| point.status == PointStatus::Valid), "{angle_deg} deg");
            let fitted = rigid_fit(&mut field, 90.0, 100.0, 31).unwrap();
            assert!((fitted.angle_deg - angle_deg).abs() < 0.01, "{angle_deg} deg: {fitted:?}");
        }
    }

    #[test]
    fn another_pattern_is_not_found_and_a_regular_one_is_ambiguous() {
        let region = Region::Disc { x_px: 60.0, y_px: 60.0, radius_px: 40.0 };
        let frame = |seed: u64| prepared(&record(&Speckle::standard(seed, 130.0).draw(130, 130), 1.0, seed));
        let lost = find_at_any_angle(&frame(1), &frame(2), &region, Point::new(60.0, 60.0));
        assert_eq!(lost.err(), Some(PointStatus::LowCorrelation));
        let disc =
            |k: i32| crate::dic::tests::Disc { x: f64::from(k % 14) * 10.0, y: f64::from(k / 14) * 10.0, radius: 3.0 };
        let grid = Speckle { discs: (0..196).map(disc).collect(), edge: 0.6, contrast: 200.0 };
        let grid = |seed: u64| prepared(&record(&grid.draw(130, 130), 1.0, seed));
        let unclear = find_at_any_angle(&grid(1), &grid(2), &region, Point::new(60.0, 60.0));
        assert_eq!(unclear.err(), Some(PointStatus::Ambiguous));
    }
}
