//! Rotation by polar correlation: rings around the centres of a body in two images, correlated along the angle.
//!
//! A rotation about the centre is a shift along the angle at every radius. A Fourier transform along the angle finds
//! any rotation without an initial guess. The ring ends where the body is occluded. (B. S. Reddy, B. N. Chatterji, IEEE
//! Trans. Image Process. 5 (1996) 1266, <https://doi.org/10.1109/83.506761>.)

use std::f64::consts::{PI, TAU};

use realfft::num_complex::Complex;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use std::sync::Arc;

use crate::dic::image::PreparedFrame;
use crate::numeric::fast_size;
use crate::results::PointStatus;

/// The lowest harmonic that is compared. Illumination, which does not rotate with the body, is in those below.
const MIN_HARMONIC: usize = 3;

/// The minimum number of radii of a ring.
const MIN_ROWS: usize = 4;

/// The size of the cells that are tested for occlusion: rows, and length along the angle in px.
const CELL: (usize, f64) = (3, 8.0);

/// The ratio of a cell's mean square residual to the median above which it is occluded.
const MAX_CELL_RATIO: f64 = 9.0;

/// The minimum root mean square residual of a visible cell, DN, for frames without noise.
const MIN_RESIDUAL_DN: f64 = 0.5;

/// The size of the sectors whose errors count as independent: rows, and length along the angle in px.
const SECTOR: (usize, f64) = (8, 12.0);

/// The minimum ZNCC of an accepted ring.
const MIN_ZNCC: f64 = 0.5;

/// The ratio of the second to the first correlation peak above which the rotation is ambiguous.
const MAX_RIVAL: f64 = 0.9;

/// The maximum number of times that the ring is shortened.
const MAX_ROUNDS: usize = 4;

/// The rotation between two frames, from a ring.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RingRotation {
    /// The rotation, counter-clockwise on the screen, -180 to 180 deg.
    pub angle_deg: f64,
    /// The standard uncertainty of the rotation, deg.
    pub sigma_deg: f64,
    /// The zero-mean normalised cross-correlation of the rings, -1 to 1.
    pub zncc: f64,
    /// The outer radius of the ring: the requested radius, or where occlusion or the edge of the image begins, px.
    pub outer_px: f64,
}

/// Measures rotations; keeps its memory and its FFT plans.
#[derive(Default)]
pub struct PolarCorrelator {
    planner: Option<RealFftPlanner<f32>>,
    from: PolarImage,
    to: PolarImage,
    aligned: PolarImage,
    slope: PolarImage,
}

/// Grey levels around a centre, one row per radius, and their harmonics.
#[derive(Default)]
struct PolarImage {
    levels: Vec<f32>,
    spectrum: Vec<Complex<f32>>,
}

/// The radii and angles of a ring.
#[derive(Debug, Clone, Copy)]
struct Grid {
    inner_px: f64,
    rows: usize,
    /// The samples per row; even.
    columns: usize,
}

impl PolarCorrelator {
    /// Measures the rotation of a body whose centre is at `from` in `reference` and at `to` in `target`, px, from the
    /// pixels between two radii, px.
    ///
    /// With `near`, deg, only rotations within 20 deg of it are accepted. Otherwise all are, and a pattern that repeats
    /// at two angles is ambiguous.
    ///
    /// # Errors
    ///
    /// - [`PointStatus::OutOfFrame`] if too little of the ring lies in the images.
    /// - [`PointStatus::Occluded`] if too little of it is visible.
    /// - [`PointStatus::LowContrast`], [`PointStatus::LowCorrelation`] or [`PointStatus::Ambiguous`].
    pub fn rotation(
        &mut self,
        (reference, from): (&PreparedFrame, (f64, f64)),
        (target, to): (&PreparedFrame, (f64, f64)),
        (inner_px, outer_px): (f64, f64),
        near: Option<f64>,
    ) -> Result<RingRotation, PointStatus> {
        let outer_px = outer_px.min(room(reference, from)).min(room(target, to));
        let mut grid = Grid::new(inner_px, outer_px).ok_or(PointStatus::OutOfFrame)?;
        let (forward, backward) = self.plans(grid.columns);
        self.from.sample(reference, from, grid, forward.as_ref());
        self.to.sample(target, to, grid, forward.as_ref());
        self.from.filter(grid, backward.as_ref());
        for _ in 0..MAX_ROUNDS {
            let (angle, zncc) = self.peak(grid, near.map(f64::to_radians), backward.as_ref())?;
            let gain = self.align(grid, angle, backward.as_ref());
            let rows = self.visible_rows(grid, gain);
            if rows == grid.rows {
                if zncc < MIN_ZNCC {
                    return Err(PointStatus::LowCorrelation);
                }
                let sigma_deg = self.sigma(grid, gain).to_degrees();
                let outer_px = grid.inner_px + grid.rows as f64;
                return Ok(RingRotation { angle_deg: angle.to_degrees(), sigma_deg, zncc, outer_px });
            }
            if rows < MIN_ROWS {
                return Err(PointStatus::Occluded);
            }
            grid.rows = rows;
        }
        Err(PointStatus::Occluded)
    }

    fn plans(&mut self, columns: usize) -> (Arc<dyn RealToComplex<f32>>, Arc<dyn ComplexToReal<f32>>) {
        let planner = self.planner.get_or_insert_with(RealFftPlanner::new);
        (planner.plan_fft_forward(columns), planner.plan_fft_inverse(columns))
    }

    /// Returns the rotation of the highest correlation, rad, and its ZNCC.
    fn peak(
        &self,
        grid: Grid,
        near: Option<f64>,
        backward: &dyn ComplexToReal<f32>,
    ) -> Result<(f64, f64), PointStatus> {
        let harmonics = grid.harmonics();
        let mut cross = vec![Complex::<f64>::default(); harmonics];
        let mut energies = [0.0_f64; 2];
        for row in 0..grid.rows {
            let (weight, span) = (grid.weight(row), row * harmonics..(row + 1) * harmonics);
            for ((cross, a), b) in cross.iter_mut().zip(&self.from.spectrum[span.clone()]).zip(&self.to.spectrum[span])
            {
                let (a, b) = (wide(*a), wide(*b));
                *cross += a.conj() * b * weight;
                energies[0] += 2.0 * weight * a.norm_sqr();
                energies[1] += 2.0 * weight * b.norm_sqr();
            }
        }
        let energy = (energies[0] * energies[1]).sqrt();
        let samples = grid.columns as f64 * (0..grid.rows).map(|row| grid.weight(row)).sum::<f64>();
        if energies.iter().any(|energy| *energy < samples * grid.columns as f64 * MIN_RESIDUAL_DN * MIN_RESIDUAL_DN) {
            return Err(PointStatus::LowContrast);
        }
        let mut input: Vec<_> =
            cross.iter().map(|c| Complex::new((c.re / energy) as f32, (c.im / energy) as f32)).collect();
        let mut correlation = vec![0.0_f32; grid.columns];
        if backward.process(&mut input, &mut correlation).is_err() {
            return Err(PointStatus::LowCorrelation);
        }
        let start = best(&correlation, near).ok_or(PointStatus::LowCorrelation)??;
        let angle = maximize(&cross, start).ok_or(PointStatus::LowCorrelation)?;
        let product: f64 = cross.iter().enumerate().map(|(k, c)| 2.0 * (c * rotation_factor(k, angle)).re).sum();
        Ok((angle, product / energy))
    }

    /// Rotates the target back by `angle` and returns the gain that matches it to the reference.
    fn align(&mut self, grid: Grid, angle: f64, backward: &dyn ComplexToReal<f32>) -> f64 {
        let harmonics = grid.harmonics();
        for polar in [&mut self.aligned, &mut self.slope] {
            polar.spectrum.clear();
            polar.levels.resize(grid.rows * grid.columns, 0.0);
        }
        for (k, value) in self.to.spectrum[..grid.rows * harmonics].iter().enumerate() {
            let k = k % harmonics;
            let back = wide(*value) * rotation_factor(k, angle) / grid.columns as f64;
            let slope = back * Complex::new(0.0, k as f64);
            self.aligned.spectrum.push(Complex::new(back.re as f32, back.im as f32));
            self.slope.spectrum.push(Complex::new(slope.re as f32, slope.im as f32));
        }
        self.aligned.invert(grid, backward);
        self.slope.invert(grid, backward);
        let (mut product, mut energy) = (0.0, 0.0);
        for row in 0..grid.rows {
            let span = grid.span(row);
            for (a, b) in self.from.levels[span.clone()].iter().zip(&self.aligned.levels[span]) {
                product += grid.weight(row) * f64::from(a * b);
                energy += grid.weight(row) * f64::from(b * b);
            }
        }
        product / energy
    }

    /// Returns the residual of a sample of the aligned rings.
    fn residual(&self, grid: Grid, gain: f64, row: usize, column: usize) -> f64 {
        let place = row * grid.columns + column;
        gain * f64::from(self.aligned.levels[place]) - f64::from(self.from.levels[place])
    }

    /// Returns the number of rows inside the first occluded one.
    fn visible_rows(&self, grid: Grid, gain: f64) -> usize {
        let bands = grid.rows.div_ceil(CELL.0);
        let mut cells = Vec::new();
        for band in 0..bands {
            let rows = band * CELL.0..((band + 1) * CELL.0).min(grid.rows);
            let count = ((TAU * grid.radius(rows.start) / CELL.1) as usize).clamp(4, grid.columns);
            for cell in 0..count {
                let columns = cell * grid.columns / count..(cell + 1) * grid.columns / count;
                let of_row = |row: usize| -> f64 {
                    columns.clone().map(|column| self.residual(grid, gain, row, column).powi(2)).sum()
                };
                let sum: f64 = rows.clone().map(of_row).sum();
                cells.push((band, sum / (rows.len() * columns.len()) as f64));
            }
        }
        let mut sorted: Vec<f64> = cells.iter().map(|cell| cell.1).collect();
        let middle = sorted.len() / 2;
        let median = *sorted.select_nth_unstable_by(middle, f64::total_cmp).1;
        let limit = MAX_CELL_RATIO * median.max(MIN_RESIDUAL_DN * MIN_RESIDUAL_DN);
        // One odd cell may be a scratch; occluders are wider.
        let is_occluded = |band: usize| cells.iter().filter(|cell| cell.0 == band && cell.1 > limit).count() > 1;
        let first = (0..bands).find(|band| is_occluded(*band));
        first.map_or(grid.rows, |band| band * CELL.0)
    }

    /// Returns the standard uncertainty of the angle, rad, from the scatter between sectors of the ring.
    fn sigma(&self, grid: Grid, gain: f64) -> f64 {
        let middle_px = grid.inner_px + 0.5 * grid.rows as f64;
        let sectors = ((TAU * middle_px / SECTOR.1) as usize).clamp(8, grid.columns);
        let bands = grid.rows.div_ceil(SECTOR.0);
        let (mut information, mut scores) = (0.0, vec![0.0_f64; sectors * bands]);
        for row in 0..grid.rows {
            for column in 0..grid.columns {
                let slope = gain * f64::from(self.slope.levels[row * grid.columns + column]);
                information += grid.weight(row) * slope * slope;
                scores[row / SECTOR.0 * sectors + column * sectors / grid.columns] +=
                    grid.weight(row) * slope * self.residual(grid, gain, row, column);
            }
        }
        let count = scores.len() as f64;
        let variance = scores.iter().map(|score| score * score).sum::<f64>() * count / (count - 1.0);
        variance.sqrt() / information
    }
}

impl PolarImage {
    /// Samples rows and harmonics from a frame.
    fn sample(&mut self, frame: &PreparedFrame, (x, y): (f64, f64), grid: Grid, forward: &dyn RealToComplex<f32>) {
        let (left, top) = frame.local((0, 0));
        let (x, y) = (x + f64::from(left), y + f64::from(top));
        self.levels.clear();
        self.spectrum.clear();
        let directions: Vec<_> = (0..grid.columns).map(|k| (TAU * k as f64 / grid.columns as f64).sin_cos()).collect();
        let mut line = vec![0.0; grid.columns];
        let mut harmonics = vec![Complex::default(); grid.harmonics()];
        for row in 0..grid.rows {
            let radius = grid.radius(row);
            for (level, (sin, cos)) in line.iter_mut().zip(&directions) {
                *level = frame.interpolated.at(x + radius * cos, y - radius * sin);
            }
            // The lengths match the plan, so this cannot fail.
            let _ = forward.process(&mut line, &mut harmonics);
            harmonics[..MIN_HARMONIC].fill(Complex::default());
            // The highest harmonic has no phase.
            harmonics[grid.harmonics() - 1] = Complex::default();
            self.spectrum.extend_from_slice(&harmonics);
        }
    }

    /// Computes the rows from the compared harmonics, which are kept.
    fn filter(&mut self, grid: Grid, backward: &dyn ComplexToReal<f32>) {
        let kept = self.spectrum.clone();
        self.levels.resize(grid.rows * grid.columns, 0.0);
        self.spectrum.iter_mut().for_each(|c| *c /= grid.columns as f32);
        self.invert(grid, backward);
        self.spectrum = kept;
    }

    /// Computes the rows from the harmonics, which are overwritten.
    fn invert(&mut self, grid: Grid, backward: &dyn ComplexToReal<f32>) {
        let harmonics = self.spectrum.chunks_exact_mut(grid.harmonics());
        for (harmonics, row) in harmonics.zip(self.levels.chunks_exact_mut(grid.columns)) {
            let _ = backward.process(harmonics, row);
        }
    }
}

impl Grid {
    fn new(inner_px: f64, outer_px: f64) -> Option<Self> {
        let sound = inner_px >= 1.0 && outer_px <= 1e4 && outer_px - inner_px >= MIN_ROWS as f64;
        sound.then(|| {
            let samples = fast_size((0.5 * TAU * outer_px).ceil() as usize);
            Self { inner_px, rows: (outer_px - inner_px) as usize, columns: 2 * samples }
        })
    }

    fn harmonics(&self) -> usize {
        self.columns / 2 + 1
    }

    fn radius(&self, row: usize) -> f64 {
        self.inner_px + row as f64 + 0.5
    }

    /// Returns the pixels per sample of a row.
    fn weight(&self, row: usize) -> f64 {
        TAU * self.radius(row) / self.columns as f64
    }

    fn span(&self, row: usize) -> std::ops::Range<usize> {
        row * self.columns..(row + 1) * self.columns
    }
}

/// Returns the radius of the largest circle around a position inside the prepared part of a frame, px.
fn room(frame: &PreparedFrame, (x, y): (f64, f64)) -> f64 {
    let (left, top) = frame.local((0, 0));
    let (x, y) = (x + f64::from(left), y + f64::from(top));
    if x.is_nan() || y.is_nan() {
        return f64::NEG_INFINITY;
    }
    let (right, bottom) = (frame.levels.width() as f64 - 1.0 - x, frame.levels.height() as f64 - 1.0 - y);
    x.min(y).min(right).min(bottom)
}

fn wide(c: Complex<f32>) -> Complex<f64> {
    Complex::new(f64::from(c.re), f64::from(c.im))
}

/// Returns the factor that rotates a harmonic back by an angle.
fn rotation_factor(harmonic: usize, angle: f64) -> Complex<f64> {
    let (sin, cos) = (harmonic as f64 * angle).sin_cos();
    Complex::new(cos, sin)
}

/// The range of accepted rotations around `near`, rad.
const NEAR_RAD: f64 = PI / 9.0;

/// Returns the angle of the highest sample, rad; ambiguous if another peak is about as high.
fn best(correlation: &[f32], near: Option<f64>) -> Option<Result<f64, PointStatus>> {
    let count = correlation.len();
    let angle = |k: usize| {
        let angle = TAU * k as f64 / count as f64;
        if angle > PI { angle - TAU } else { angle }
    };
    let apart = |a: f64, b: f64| ((a - b + PI).rem_euclid(TAU) - PI).abs();
    let allowed = |k: &usize| near.is_none_or(|near| apart(angle(*k), near) < NEAR_RAD);
    let is_peak = |k: &usize| {
        correlation[*k] >= correlation[(k + 1) % count] && correlation[*k] > correlation[(k + count - 1) % count]
    };
    let mut peaks: Vec<usize> = (0..count).filter(is_peak).filter(allowed).collect();
    peaks.sort_by(|a, b| correlation[*b].total_cmp(&correlation[*a]));
    let first = *peaks.first()?;
    let is_rival =
        peaks.get(1).is_some_and(|second| f64::from(correlation[*second]) > MAX_RIVAL * f64::from(correlation[first]));
    Some(if is_rival { Err(PointStatus::Ambiguous) } else { Ok(angle(first)) })
}

/// Returns the maximum of a sum of harmonics near an angle, rad, by Newton's method.
fn maximize(cross: &[Complex<f64>], start: f64) -> Option<f64> {
    let step = PI / cross.len() as f64;
    let mut angle = start;
    for _ in 0..20 {
        let (mut slope, mut bend) = (0.0, 0.0);
        for (k, c) in cross.iter().enumerate() {
            let (z, k) = (c * rotation_factor(k, angle), k as f64);
            slope -= k * z.im;
            bend -= k * k * z.re;
        }
        if bend >= 0.0 {
            return None;
        }
        let move_by = -slope / bend;
        angle += move_by;
        if (angle - start).abs() > 3.0 * step {
            return None;
        }
        if move_by.abs() < 1e-10 {
            return Some(angle);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dic::geometry::Warp;
    use crate::dic::tests::{Sequence, Speckle, prepared, record};
    use crate::image::Image;

    /// A pattern rotated about (70, 66) and shifted.
    fn rotated_by(speckle: &Speckle, (u, v, angle_deg): (f64, f64, f64)) -> Image {
        let turn = Warp::rigid(u, v, angle_deg.to_radians());
        let motion = |x: f64, y: f64| {
            let (dx, dy) = (x - 70.0, y - 66.0);
            let (tx, ty) = turn.apply(dx, dy);
            (tx - dx, ty - dy)
        };
        speckle.moved(motion).draw(140, 132)
    }

    const CENTER: (f64, f64) = (70.0, 66.0);
    #[test]
    fn any_rotation_is_found_without_a_start_to_a_hundredth_with_honest_uncertainty() {
        let speckle = Speckle::standard(41, 140.0);
        let reference = speckle.draw(140, 132);
        let mut ring = PolarCorrelator::default();
        for (limits, most_rms) in [((30.0, 50.0), 0.0035), ((20.0, 26.0), 0.012), ((8.0, 52.0), 0.003)] {
            let (mut square, mut reported, mut worst, mut count) = (0.0, 0.0, 0.0_f64, 0.0);
            for (case, angle_deg) in [0.07, -0.61, 2.93, 17.31, -90.4, 171.7].into_iter().enumerate() {
                let (u, v) = (1.37, -0.82);
                let target = rotated_by(&speckle, (u, v, angle_deg));
                for round in 0..6 {
                    let seed = 300 + 20 * case as u64 + 2 * round;
                    let (a, b) = (prepared(&record(&reference, 2.0, seed)), prepared(&record(&target, 2.0, seed + 1)));
                    let to = (CENTER.0 + u, CENTER.1 + v);
                    let found = ring.rotation((&a, CENTER), (&b, to), limits, None).unwrap();
                    let error = found.angle_deg - angle_deg;
                    (square, reported) = (square + error * error, reported + found.sigma_deg.powi(2));
                    (worst, count) = (worst.max(error.abs()), count + 1.0);
                }
            }
            let (rms, ratio) = ((square / count).sqrt(), (reported / square).sqrt());
            eprintln!("ring {limits:?}: rms {rms:.5} deg, worst {worst:.5}, reported/actual {ratio:.2}");
            assert!(rms < most_rms && worst < 4.0 * most_rms, "{limits:?}: {rms} {worst}");
            assert!((0.7..1.4).contains(&ratio), "{limits:?}: {ratio}");
        }
    }

    #[test]
    fn the_ring_ends_at_the_edge_of_an_occluder() {
        let speckle = Speckle::standard(42, 140.0);
        let reference = prepared(&record(&speckle.draw(140, 132), 2.0, 1));
        let mut random = Sequence::new(3);
        for (edge_px, angle_deg) in [(44.0, 0.71), (30.0, -1.33), (22.0, 0.4)] {
            let mut image = record(&rotated_by(&speckle, (0.0, 0.0, angle_deg)), 2.0, 2);
            for (y, row) in image.rows_mut().enumerate() {
                for (x, level) in row.iter_mut().enumerate() {
                    if x as f64 > CENTER.0 + edge_px {
                        *level = (60.0 + 20.0 * random.normal() + (0.3 * (x + 2 * y) as f64).sin() * 30.0) as f32;
                    }
                }
            }
            let target = prepared(&image);
            let found = PolarCorrelator::default()
                .rotation((&reference, CENTER), (&target, CENTER), (12.0, 50.0), Some(0.0))
                .unwrap();
            eprintln!("edge at {edge_px}: {found:?}");
            assert!((edge_px - 7.0..=edge_px + 1.0).contains(&found.outer_px), "{edge_px}: {found:?}");
            assert!((found.angle_deg - angle_deg).abs() < 5.0 * found.sigma_deg, "{edge_px}: {found:?}");
        }
        let hidden = prepared(&Image::new(140, 132));
        let lost = PolarCorrelator::default().rotation((&reference, CENTER), (&hidden, CENTER), (12.0, 50.0), None);
        assert_eq!(lost.err(), Some(PointStatus::LowContrast));
    }

    #[test]
    fn other_patterns_are_refused_and_repeating_ones_are_ambiguous() {
        let frame = |seed: u64| prepared(&record(&Speckle::standard(seed, 140.0).draw(140, 132), 2.0, seed));
        let mut ring = PolarCorrelator::default();
        let other = ring.rotation((&frame(1), CENTER), (&frame(2), CENTER), (12.0, 50.0), None);
        assert!(
            matches!(other, Err(PointStatus::LowCorrelation | PointStatus::Ambiguous | PointStatus::Occluded)),
            "{other:?}"
        );
        let star = |angle_deg: f64| {
            let mut image = Image::new(140, 132);
            for (y, row) in image.rows_mut().enumerate() {
                for (x, level) in row.iter_mut().enumerate() {
                    let angle = (CENTER.1 - y as f64).atan2(x as f64 - CENTER.0) - angle_deg.to_radians();
                    *level = (100.0 + 60.0 * (6.0 * angle).cos()) as f32;
                }
            }
            prepared(&record(&image, 1.0, 9))
        };
        let (a, b) = (star(0.0), star(2.5));
        assert_eq!(ring.rotation((&a, CENTER), (&b, CENTER), (12.0, 50.0), None).err(), Some(PointStatus::Ambiguous));
        let near = ring.rotation((&a, CENTER), (&b, CENTER), (12.0, 50.0), Some(0.0)).unwrap();
        assert!((near.angle_deg - 2.5).abs() < 0.05, "{near:?}");
    }

    #[test]
    fn rings_outside_the_image_are_refused() {
        let frame = prepared(&Speckle::standard(1, 140.0).draw(140, 132));
        for center in [(5.0, 60.0), (f64::NAN, 60.0), (60.0, 1e9)] {
            let found = PolarCorrelator::default().rotation((&frame, center), (&frame, center), (12.0, 50.0), None);
            assert_eq!(found.err(), Some(PointStatus::OutOfFrame), "{center:?}");
        }
        let near_edge = PolarCorrelator::default()
            .rotation((&frame, (30.0, 60.0)), (&frame, (30.0, 60.0)), (12.0, 50.0), None)
            .unwrap();
        assert!(near_edge.outer_px <= 30.0 && near_edge.angle_deg.abs() < 1e-4, "{near_edge:?}");
    }
}
