//! Fixed-pattern bias: the effect of differences between sensor pixels on small displacements.

use std::ops::Range;

use multiversion::multiversion;

use crate::dic::geometry::{GridPoint, Pixel};
use crate::dic::image::PreparedFrame;
use crate::numeric::LANES;

/// The weights of eighth differences, taken along x and y.
///
/// They suppress the speckles of a sharp image more than noise does. Speckles that have not moved look like a pattern
/// that biases steps by at most 0.02 % (0.12 % with fourth differences).
const EIGHTH: [f32; 9] = [1.0, -8.0, 28.0, -56.0, 70.0, -56.0, 28.0, -8.0, 1.0];
const REACH: isize = EIGHTH.len() as isize / 2;
/// The noise gain of the eighth difference: the sum of its squared weights along either axis, once for both.
const NOISE_GAIN: f64 = 12870.0;
/// The weight of the pattern in the normal equations for zero motion, per squared pixel difference.
///
/// It is the slope of the pattern by fourth-order differences, as in the reference, times that of the interpolated
/// target, (-1)^n / n for a pixel n further.
const PATTERN_WEIGHT: f64 = 2.0 * (8.0 / 12.0 + 1.0 / 24.0);
/// The minimum number of pixels of a body in both frames.
const MIN_PIXELS: usize = 256;

/// Estimates the fixed-pattern bias from two frames of a moving body.
///
/// Gains and offsets of single pixels stay in place while the body moves. In a match of two frames they pull the result
/// towards zero motion, with the square of their slope. Speckles pull towards the true motion with the square of
/// theirs, so steps below one pixel come out short by the ratio. Differences of neighbouring pixels suppress the
/// illumination. Noise is independent between frames, and each pixel sees other speckles in each frame. The correlation
/// of eighth differences at the same pixels is therefore the pattern.
#[derive(Debug, Clone, Default)]
pub struct FixedPattern {
    /// The rows of the body in the first frame, downwards.
    strips: Vec<Strip>,
    /// Their eighth differences, strip by strip.
    values: Vec<f32>,
    /// The mean square of the grey-level slope along x and y there, DN^2/px^2.
    slope_squared: f64,
    memory: [Vec<f32>; 2],
}

/// A row of a body.
#[derive(Debug, Clone)]
struct Strip {
    y: u32,
    columns: Range<u32>,
    /// The index of its first value.
    from: usize,
}

impl FixedPattern {
    /// Stores the eighth differences and the mean square slope of the body in the first frame.
    ///
    /// `body` covers its pixels as rectangles of x, y, width and height, px, one below the other.
    pub fn begin(&mut self, first: &PreparedFrame, body: &[[u32; 4]]) {
        self.strips.clear();
        self.values.clear();
        let mut squares = 0.0;
        for (y, columns) in clipped_rows(first, body) {
            let strip = Strip { y, columns: columns.clone(), from: self.values.len() };
            self.strips.push(strip);
            self.values.extend_from_slice(eighth_differences(first, y, &columns, &mut self.memory));
            let Pixel { x: left, y: row } = first.local(GridPoint { x: columns.start, y });
            let slopes = [&first.gradient_x, &first.gradient_y]
                .map(|plane| &plane.row(row as usize)[left as usize..left as usize + columns.len()]);
            squares += slopes.map(|slope| dot(slope, slope)).iter().sum::<f64>();
        }
        self.slope_squared = 0.5 * squares / self.values.len().max(1) as f64;
    }

    /// Returns the fraction by which steps far below one pixel come out short, estimated from a later frame.
    ///
    /// `body` covers the body in that frame, as in [`Self::begin`]. The estimate scatters about its mean and may be
    /// negative. Returns `None` if fewer than 256 pixels belong to the body in both frames, or if they have
    /// no slope.
    pub fn bias_fraction(&mut self, later: &PreparedFrame, body: &[[u32; 4]]) -> Option<f64> {
        let (mut sum, mut pixels) = (0.0, 0);
        for (y, columns) in clipped_rows(later, body) {
            let strip = self.strips.binary_search_by_key(&y, |strip| strip.y).ok().map(|place| &self.strips[place]);
            let Some(strip) = strip else { continue };
            let both = columns.start.max(strip.columns.start)..columns.end.min(strip.columns.end);
            if both.is_empty() {
                continue;
            }
            let from = strip.from + (both.start - strip.columns.start) as usize;
            let first = &self.values[from..from + both.len()];
            sum += dot(first, eighth_differences(later, y, &both, &mut self.memory));
            pixels += both.len();
        }
        let share = PATTERN_WEIGHT * sum / (NOISE_GAIN * NOISE_GAIN * pixels as f64 * self.slope_squared);
        (pixels >= MIN_PIXELS && share.is_finite()).then_some(share)
    }
}

/// Returns row and columns of each row of the rectangles (x, y, width, height, px), clipped to the prepared part of a
/// frame.
fn clipped_rows(frame: &PreparedFrame, rectangles: &[[u32; 4]]) -> impl Iterator<Item = (u32, Range<u32>)> {
    let Pixel { x: left, y: top } = frame.local(GridPoint { x: 0, y: 0 });
    let within = |from: u32, length: u32, before: i32, ready: usize| {
        let first = before.unsigned_abs();
        from.max(first)..from.saturating_add(length).min(first + ready as u32)
    };
    let (width, height) = (frame.levels.width(), frame.levels.height());
    rectangles.iter().flat_map(move |[x, y, columns, rows]| {
        let columns = within(*x, *columns, left, width);
        let rows = if columns.is_empty() { 0..0 } else { within(*y, *rows, top, height) };
        rows.map(move |y| (y, columns.clone()))
    })
}

/// Returns the eighth differences along x and y at some columns of row `y` of a frame, DN. `memory` is scratch memory.
fn eighth_differences<'a>(
    frame: &PreparedFrame,
    y: u32,
    columns: &Range<u32>,
    memory: &'a mut [Vec<f32>; 2],
) -> &'a [f32] {
    let [down, across] = memory;
    let Pixel { x: left, y: row } = frame.local(GridPoint { x: columns.start, y });
    let wide = columns.len() + 2 * REACH as usize;
    down.resize(wide, 0.0);
    across.resize(columns.len(), 0.0);
    let near = |k: usize| {
        let from = frame.levels.index(left as isize - REACH, row as isize + k as isize - REACH);
        &frame.levels.data()[from..from + wide]
    };
    eighth_difference(std::array::from_fn(near), down);
    eighth_difference(std::array::from_fn(|k| &down[k..k + columns.len()]), across);
    across
}

/// Computes the eighth difference across nine rows, at least as long as `out`, with the weights [`EIGHTH`].
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn eighth_difference(rows: [&[f32]; EIGHTH.len()], out: &mut [f32]) {
    let rows = rows.map(|row| &row[..out.len()]);
    for x in 0..out.len() {
        let both = |k: usize| EIGHTH[k] * (rows[k][x] + rows[EIGHTH.len() - 1 - k][x]);
        out[x] = (both(0) + both(1)) + (both(2) + both(3)) + EIGHTH[4] * rows[4][x];
    }
}

/// Returns the dot product of two rows in double precision.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn dot(a: &[f32], b: &[f32]) -> f64 {
    let mut sums = [0.0_f64; LANES];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    for (a, b) in a.iter().zip(b) {
        for lane in 0..LANES {
            sums[lane] += f64::from(a[lane]) * f64::from(b[lane]);
        }
    }
    let rest = a_rest.iter().zip(b_rest).map(|(a, b)| f64::from(*a) * f64::from(*b));
    sums.iter().sum::<f64>() + rest.sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dic::geometry::grid::rectangle;
    use crate::dic::tests::{Sequence, Speckle, record};
    use crate::dic::{CorrelationParams, Correlator, Start};
    use crate::image::Image;

    const SIDE: usize = 240;
    const BODY: [u32; 4] = [40, 40, 160, 160];

    /// Images of a pattern that moves over a sensor whose pixels differ.
    struct Sensor {
        speckle: Speckle,
        offsets: Vec<f64>,
    }

    impl Sensor {
        fn new(spread_dn: f64) -> Self {
            let mut sequence = Sequence::new(77);
            let offsets = (0..SIDE * SIDE).map(|_| spread_dn * sequence.normal()).collect();
            Self { speckle: Speckle::standard(5, SIDE as f64), offsets }
        }

        fn frame(&self, moved: (f64, f64), seed: u64) -> Image {
            let clean = self.speckle.moved(|_, _| moved).draw(SIDE, SIDE);
            let uneven = clean.view().data().iter().zip(&self.offsets).map(|(light, off)| light + *off as f32);
            record(&Image::from_vec(uneven.collect(), SIDE, SIDE).unwrap(), 2.0, seed)
        }

        /// Returns the mean estimate over frames that have moved by more than a pixel each.
        fn share(&self) -> f64 {
            let correlator = Correlator::new(&CorrelationParams::default(), SIDE, SIDE).unwrap();
            let frame =
                |k: u32| correlator.prepare(self.frame((1.3 * f64::from(k), 0.4 * f64::from(k)), k.into()).view());
            let mut pattern = FixedPattern::default();
            pattern.begin(&frame(0), &[BODY]);
            (1..9).map(|k| pattern.bias_fraction(&frame(k), &[BODY]).unwrap()).sum::<f64>() / 8.0
        }

        /// Returns the fraction by which the mean of all subsets comes short of a step.
        fn short(&self, (u, v): (f64, f64)) -> f64 {
            let mut correlator = Correlator::new(&CorrelationParams::default(), SIDE, SIDE).unwrap();
            let points = rectangle(BODY, 8, 31);
            let mut sums = [0.0; 2];
            for seed in 0..8 {
                let place = (0.37 * seed as f64, -0.21 * seed as f64);
                let [first, last] = [(place, 100 + seed), ((place.0 + u, place.1 + v), 200 + seed)]
                    .map(|(moved, seed)| correlator.prepare(self.frame(moved, seed).view()));
                let mut field = Vec::new();
                correlator.correlate(&first, &last, &points, Start::Search, &mut field);
                for motion in field.iter().map(|point| point.displacement.unwrap()) {
                    sums[0] += f64::from(motion.u_px) * u + f64::from(motion.v_px) * v;
                    sums[1] += u * u + v * v;
                }
            }
            1.0 - sums[0] / sums[1]
        }
    }

    #[test]
    fn the_estimate_equals_the_bias_of_short_steps() {
        let sensor = Sensor::new(3.0);
        let (share, short) = (sensor.share(), sensor.short((0.12, 0.05)));
        eprintln!("estimated {share:.5}, actual {short:.5}");
        assert!(short > 2e-3 && (share / short - 1.0).abs() < 0.2, "estimated {share}, actual {short}");
        let far = sensor.short((1.6, 0.7));
        assert!(far.abs() < 0.1 * short, "over more than a pixel {far}");
    }

    #[test]
    fn equal_pixels_show_no_bias() {
        let share = Sensor::new(0.0).share();
        assert!(share.abs() < 2e-4, "{share}");
    }

    #[test]
    fn frames_with_too_little_overlap_give_no_estimate() {
        let mut frame = PreparedFrame::default();
        frame.fill(Image::new(64, 64).view(), crate::dic::Interpolation::Optimised);
        let mut pattern = FixedPattern::default();
        pattern.begin(&frame, &[[0, 0, 20, 20]]);
        assert_eq!(pattern.bias_fraction(&frame, &[[10, 10, 20, 20]]), None, "a hundred pixels");
        assert_eq!(pattern.bias_fraction(&frame, &[[0, 0, 20, 20]]), None, "without any slope");
        assert_eq!(pattern.bias_fraction(&frame, &[[60, 60, u32::MAX, 9]]), None);
    }
}
