//! Rotation by polar correlation: rings around the centres of a body in two images, correlated along the angle.
//!
//! A rotation about the centre is a shift along the angle at every radius. A Fourier transform along the angle finds
//! any rotation without an initial guess. The ring ends where the body is occluded. (B. S. Reddy, B. N. Chatterji, IEEE
//! Trans. Image Process. 5 (1996) 1266, <https://doi.org/10.1109/83.506761>.)

mod grid;

use std::f64::consts::{PI, TAU};

use realfft::num_complex::Complex;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use std::sync::Arc;

use crate::dic::geometry::{GridPoint, Pixel, Point, Size};
use crate::dic::image::{PreparedFrame, sample_points};
use crate::numeric::quantile;
use crate::results::PointStatus;
use grid::{Grid, MIN_ROWS};

/// The lowest harmonic that is compared. Illumination, which does not rotate with the body, is in those below.
const MIN_HARMONIC: usize = 3;

/// The number of rows of a cell that is tested for occlusion.
const CELL_ROWS: usize = 3;
/// The length of a cell along the angle, px.
const CELL_PX: f64 = 8.0;

/// The ratio of a cell's mean square residual to the median above which it is occluded.
const MAX_CELL_RATIO: f64 = 9.0;

/// The minimum root mean square residual of a visible cell, DN, for frames without noise.
const MIN_RESIDUAL_DN: f64 = 0.5;

/// The number of rows of a sector. The errors of different sectors count as independent.
const SECTOR_ROWS: usize = 8;
/// The length of a sector along the angle, px.
const SECTOR_PX: f64 = 12.0;

/// The minimum ZNCC of an accepted ring.
const MIN_ZNCC: f64 = 0.5;

/// The ratio of the second to the first correlation peak above which the rotation is ambiguous.
const MAX_RIVAL: f64 = 0.9;

/// The correlation of a ring with itself, rotated, above which its pattern repeats.
const MIN_REPEAT: f32 = 0.7;

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

/// A frame in which the centre of a body is known.
#[derive(Clone, Copy)]
pub struct CenteredFrame<'a> {
    /// The frame, prepared around the body.
    pub frame: &'a PreparedFrame,
    /// The centre of the body in the frame.
    pub center: Point,
}

/// The radii between which the pixels of a body are compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Radii {
    /// The inner radius, px.
    pub inner_px: f64,
    /// The outer radius, px.
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

/// The pattern of a ring.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RingPattern {
    /// The standard deviation of its grey levels along the angle, without the illumination, DN.
    pub contrast_dn: f64,
    /// Whether it looks the same after a small rotation.
    pub is_repeating: bool,
}

/// The correlation of two rings.
struct Correlation {
    /// The cross spectrum.
    cross: Vec<Complex<f64>>,
    /// The geometric mean of the energies of both rings.
    energy: f64,
    /// The ZNCC at each rotation of a full turn.
    values: Vec<f32>,
}

impl PolarCorrelator {
    /// Measures the rotation of a body from `reference` to `target`, from the pixels between two radii.
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
        reference: CenteredFrame<'_>,
        target: CenteredFrame<'_>,
        radii: Radii,
        near: Option<f64>,
    ) -> Result<RingRotation, PointStatus> {
        let outer_px = radii.outer_px.min(reference.inscribed_radius()).min(target.inscribed_radius());
        let mut grid = Grid::new(radii.inner_px, outer_px).ok_or(PointStatus::OutOfFrame)?;
        let (forward, backward) = self.plans(grid.columns);
        self.from.sample(reference, grid, forward.as_ref());
        self.to.sample(target, grid, forward.as_ref());
        self.from.band_pass(grid, backward.as_ref());
        for _ in 0..MAX_ROUNDS {
            let (angle, zncc) = self.peak(grid, near.map(f64::to_radians), backward.as_ref())?;
            let gain = self.align(grid, angle, backward.as_ref());
            let rows = self.visible_rows(grid, gain);
            if rows == grid.rows {
                if zncc < MIN_ZNCC {
                    return Err(PointStatus::LowCorrelation);
                }
                let sigma_deg = self.angle_sigma(grid, gain).to_degrees();
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

    /// Returns the rotation from `reference` to `target` to about a degree, whatever its size, deg.
    ///
    /// # Errors
    ///
    /// Those of [`Self::rotation`], but for an occlusion.
    pub fn coarse_rotation(
        &mut self,
        reference: CenteredFrame<'_>,
        target: CenteredFrame<'_>,
        radii: Radii,
    ) -> Result<f64, PointStatus> {
        let outer_px = radii.outer_px.min(reference.inscribed_radius()).min(target.inscribed_radius());
        let grid = Grid::new(radii.inner_px, outer_px).ok_or(PointStatus::OutOfFrame)?.coarse();
        let (forward, backward) = self.plans(grid.columns);
        self.from.sample(reference, grid, forward.as_ref());
        self.to.sample(target, grid, forward.as_ref());
        let (angle, zncc) = self.peak(grid, None, backward.as_ref())?;
        if zncc < MIN_ZNCC { Err(PointStatus::LowCorrelation) } else { Ok(angle.to_degrees()) }
    }

    /// Examines the pattern between two radii: its contrast, and whether it looks the same after a rotation by less than
    /// `max_deg`.
    ///
    /// `None` if too little of the ring lies in the image.
    pub fn examine(&mut self, body: CenteredFrame<'_>, radii: Radii, max_deg: f64) -> Option<RingPattern> {
        let outer_px = radii.outer_px.min(body.inscribed_radius());
        let grid = Grid::new(radii.inner_px, outer_px)?.coarse();
        let (forward, backward) = self.plans(grid.columns);
        self.from.sample(body, grid, forward.as_ref());
        self.to.spectrum.clone_from(&self.from.spectrum);
        let Ok(Correlation { energy, values, .. }) = self.correlate(grid, backward.as_ref()) else {
            return Some(RingPattern { contrast_dn: 0.0, is_repeating: false });
        };
        let samples = grid.columns as f64 * (0..grid.rows).map(|row| grid.weight(row)).sum::<f64>();
        let last = (max_deg / 360.0 * grid.columns as f64) as usize;
        let is_peak = |k: usize| values[k] > values[k - 1] && values[k] >= values[k + 1];
        let is_repeating = (1..last.min(grid.columns - 1)).any(|k| is_peak(k) && values[k] > MIN_REPEAT);
        Some(RingPattern { contrast_dn: (energy / (samples * grid.columns as f64)).sqrt(), is_repeating })
    }

    /// Returns the plans of the forward and the inverse transform of one row.
    fn plans(&mut self, columns: usize) -> (Arc<dyn RealToComplex<f32>>, Arc<dyn ComplexToReal<f32>>) {
        let planner = self.planner.get_or_insert_with(RealFftPlanner::new);
        (planner.plan_fft_forward(columns), planner.plan_fft_inverse(columns))
    }

    /// Returns the rotation of the highest correlation, counter-clockwise, rad, and its ZNCC.
    ///
    /// # Errors
    ///
    /// The status of a ring without contrast, without a peak or with two.
    fn peak(
        &self,
        grid: Grid,
        near: Option<f64>,
        backward: &dyn ComplexToReal<f32>,
    ) -> Result<(f64, f64), PointStatus> {
        let Correlation { cross, energy, values } = self.correlate(grid, backward)?;
        let start = highest_peak(&values, near).ok_or(PointStatus::LowCorrelation)??;
        let angle = refine_peak(&cross, start).ok_or(PointStatus::LowCorrelation)?;
        let product: f64 = cross.iter().enumerate().map(|(k, c)| 2.0 * (c * rotation_factor(k, angle)).re).sum();
        Ok((angle, product / energy))
    }

    /// Correlates the rings of both images over all rotations.
    ///
    /// # Errors
    ///
    /// [`PointStatus::LowContrast`], or [`PointStatus::LowCorrelation`] if the spectrum has no correlation.
    fn correlate(&self, grid: Grid, backward: &dyn ComplexToReal<f32>) -> Result<Correlation, PointStatus> {
        let harmonics = grid.harmonics();
        let mut cross = vec![Complex::<f64>::default(); harmonics];
        let mut energies = [0.0_f64; 2];
        for row in 0..grid.rows {
            let (weight, span) = (grid.weight(row), row * harmonics..(row + 1) * harmonics);
            for ((cross, a), b) in cross.iter_mut().zip(&self.from.spectrum[span.clone()]).zip(&self.to.spectrum[span])
            {
                let (a, b) = (to_f64(*a), to_f64(*b));
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
        let mut values = vec![0.0_f32; grid.columns];
        if backward.process(&mut input, &mut values).is_err() {
            return Err(PointStatus::LowCorrelation);
        }
        Ok(Correlation { cross, energy, values })
    }

    /// Rotates the target back by `angle`, rad, into `aligned`, with its derivative by the angle in `slope`.
    ///
    /// Returns the gain that matches it to the reference.
    fn align(&mut self, grid: Grid, angle: f64, backward: &dyn ComplexToReal<f32>) -> f64 {
        let harmonics = grid.harmonics();
        for polar in [&mut self.aligned, &mut self.slope] {
            polar.spectrum.clear();
            polar.levels.resize(grid.rows * grid.columns, 0.0);
        }
        for (k, value) in self.to.spectrum[..grid.rows * harmonics].iter().enumerate() {
            let k = k % harmonics;
            let back = to_f64(*value) * rotation_factor(k, angle) / grid.columns as f64;
            let slope = back * Complex::new(0.0, k as f64);
            self.aligned.spectrum.push(Complex::new(back.re as f32, back.im as f32));
            self.slope.spectrum.push(Complex::new(slope.re as f32, slope.im as f32));
        }
        self.aligned.inverse_transform(grid, backward);
        self.slope.inverse_transform(grid, backward);
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

    /// Returns the residual of a sample of the aligned rings: target times gain minus reference, DN.
    fn residual(&self, grid: Grid, gain: f64, row: usize, column: usize) -> f64 {
        let place = row * grid.columns + column;
        gain * f64::from(self.aligned.levels[place]) - f64::from(self.from.levels[place])
    }

    /// Returns the number of rows from the inner radius to the first occluded band of [`CELL_ROWS`] rows.
    ///
    /// A band is occluded if the residual of more than one of its cells is too large ([`MAX_CELL_RATIO`]).
    fn visible_rows(&self, grid: Grid, gain: f64) -> usize {
        let bands = grid.rows.div_ceil(CELL_ROWS);
        let mut cells = Vec::new();
        for band in 0..bands {
            let rows = band * CELL_ROWS..((band + 1) * CELL_ROWS).min(grid.rows);
            let count = ((TAU * grid.radius(rows.start) / CELL_PX) as usize).clamp(4, grid.columns);
            for cell in 0..count {
                let columns = cell * grid.columns / count..(cell + 1) * grid.columns / count;
                let sum_of_row = |row: usize| -> f64 {
                    columns.clone().map(|column| self.residual(grid, gain, row, column).powi(2)).sum()
                };
                let sum: f64 = rows.clone().map(sum_of_row).sum();
                cells.push((band, sum / (rows.len() * columns.len()) as f64));
            }
        }
        let mut squares: Vec<f64> = cells.iter().map(|cell| cell.1).collect();
        let limit = MAX_CELL_RATIO * quantile(&mut squares, 0.5).unwrap_or(0.0).max(MIN_RESIDUAL_DN * MIN_RESIDUAL_DN);
        // One odd cell may be a scratch; occluders are wider.
        let is_occluded = |band: usize| cells.iter().filter(|cell| cell.0 == band && cell.1 > limit).count() > 1;
        let first = (0..bands).find(|band| is_occluded(*band));
        first.map_or(grid.rows, |band| band * CELL_ROWS)
    }

    /// Returns the standard uncertainty of the angle, rad, from the scatter between sectors of the ring.
    ///
    /// A cluster-robust (sandwich) estimate, because neighbouring residuals are correlated (K.-Y. Liang, S. L. Zeger,
    /// Biometrika 73 (1986) 13, <https://doi.org/10.1093/biomet/73.1.13>).
    fn angle_sigma(&self, grid: Grid, gain: f64) -> f64 {
        let middle_px = grid.inner_px + 0.5 * grid.rows as f64;
        let sectors = ((TAU * middle_px / SECTOR_PX) as usize).clamp(8, grid.columns);
        let bands = grid.rows.div_ceil(SECTOR_ROWS);
        let (mut information, mut scores) = (0.0, vec![0.0_f64; sectors * bands]);
        for row in 0..grid.rows {
            for column in 0..grid.columns {
                let slope = gain * f64::from(self.slope.levels[row * grid.columns + column]);
                information += grid.weight(row) * slope * slope;
                scores[row / SECTOR_ROWS * sectors + column * sectors / grid.columns] +=
                    grid.weight(row) * slope * self.residual(grid, gain, row, column);
            }
        }
        let count = scores.len() as f64;
        let variance = scores.iter().map(|score| score * score).sum::<f64>() * count / (count - 1.0);
        variance.sqrt() / information
    }
}

impl PolarImage {
    /// Samples the rings about the body's centre from a frame and computes their harmonics.
    fn sample(&mut self, body: CenteredFrame<'_>, grid: Grid, forward: &dyn RealToComplex<f32>) {
        let Point { x_px: x, y_px: y } = body.local_center();
        self.levels.clear();
        self.spectrum.clear();
        let directions: Vec<_> = (0..grid.columns).map(|k| (TAU * k as f64 / grid.columns as f64).sin_cos()).collect();
        let (mut points, mut line) = (Vec::with_capacity(grid.columns), vec![0.0; grid.columns]);
        let mut harmonics = vec![Complex::default(); grid.harmonics()];
        for row in 0..grid.rows {
            let radius = grid.radius(row);
            points.clear();
            points.extend(directions.iter().map(|(sin, cos)| Point::new(x + radius * cos, y - radius * sin)));
            sample_points(&body.frame.interpolated, &points, &mut line);
            // The lengths match the plan, so this cannot fail.
            let _ = forward.process(&mut line, &mut harmonics);
            harmonics[..MIN_HARMONIC].fill(Complex::default());
            // The highest harmonic has no phase.
            harmonics[grid.harmonics() - 1] = Complex::default();
            self.spectrum.extend_from_slice(&harmonics);
        }
    }

    /// Computes the rows from the compared harmonics only. The spectrum is kept.
    fn band_pass(&mut self, grid: Grid, backward: &dyn ComplexToReal<f32>) {
        let kept = self.spectrum.clone();
        self.levels.resize(grid.rows * grid.columns, 0.0);
        self.spectrum.iter_mut().for_each(|c| *c /= grid.columns as f32);
        self.inverse_transform(grid, backward);
        self.spectrum = kept;
    }

    /// Computes the rows from the harmonics. The spectrum is overwritten.
    fn inverse_transform(&mut self, grid: Grid, backward: &dyn ComplexToReal<f32>) {
        let harmonics = self.spectrum.chunks_exact_mut(grid.harmonics());
        for (harmonics, row) in harmonics.zip(self.levels.chunks_exact_mut(grid.columns)) {
            let _ = backward.process(harmonics, row);
        }
    }
}

impl CenteredFrame<'_> {
    /// Returns the centre relative to the corner of the prepared part of the frame, px.
    fn local_center(&self) -> Point {
        let Pixel { x, y } = self.frame.local(GridPoint { x: 0, y: 0 });
        Point::new(self.center.x_px + f64::from(x), self.center.y_px + f64::from(y))
    }

    /// Returns the radius of the largest circle around the centre inside the prepared part of the frame, px.
    ///
    /// Negative if the centre lies outside, minus infinity if it is NaN.
    fn inscribed_radius(&self) -> f64 {
        let Point { x_px: x, y_px: y } = self.local_center();
        if x.is_nan() || y.is_nan() {
            return f64::NEG_INFINITY;
        }
        let Size { width, height } = self.frame.levels.size();
        x.min(y).min(width as f64 - 1.0 - x).min(height as f64 - 1.0 - y)
    }
}

/// Converts a complex number to double precision.
fn to_f64(c: Complex<f32>) -> Complex<f64> {
    Complex::new(f64::from(c.re), f64::from(c.im))
}

/// Returns the factor that rotates a harmonic back by an angle, rad.
fn rotation_factor(harmonic: usize, angle: f64) -> Complex<f64> {
    let (sin, cos) = (harmonic as f64 * angle).sin_cos();
    Complex::new(cos, sin)
}

/// The range of accepted rotations around `near`, rad.
const NEAR_RAD: f64 = PI / 9.0;

/// Returns the angle of the highest peak among the samples of a full turn, -pi to pi rad.
///
/// `None` without a peak within [`NEAR_RAD`] of `near`, [`PointStatus::Ambiguous`] if another is about as high.
fn highest_peak(correlation: &[f32], near: Option<f64>) -> Option<Result<f64, PointStatus>> {
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

/// Returns the angle of the maximum of a sum of harmonics near `start`, rad, by Newton's method; `None` if it is not
/// found within three samples.
fn refine_peak(cross: &[Complex<f64>], start: f64) -> Option<f64> {
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
mod tests;
