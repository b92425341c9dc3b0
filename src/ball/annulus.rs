//! The annulus: the pixels along a rim, sorted into bins by angle.

use super::RimKind;
use crate::image::{ImageView, is_saturated};

/// The number of bins processed at a time by vector instructions.
pub(super) const LANES: usize = 16;
/// The minimum number of bins, for the smallest balls.
const MIN_BINS: usize = 8;
/// The maximum number of pixels kept per bin.
pub(super) const SLOTS: usize = 24;
/// The length of the rim per bin, px: short, so that some bins fit between speckles.
pub(super) const BIN_PX: f64 = 1.7;
/// The reach of the annulus outside the rim, px.
pub(super) const BAND_PX: f64 = 3.0;
/// The reach of the annulus inside the rim, px: less, because of speckle and shading.
pub(super) const INNER_BAND_PX: f64 = 2.5;

/// The reach inside a rim that is lined with speckles, px.
const SPECKLED_BAND_PX: f64 = 1.5;

/// The distance that the circle may move before its pixels have to be gathered again, px.
pub(super) const SLACK_PX: f64 = 0.5;

/// A circle that is being refined.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Outline {
    pub x: f64,
    pub y: f64,
    pub radius: f64,
}

impl Outline {
    /// Returns the distance from another circle, px: the larger of the differences of centre and radius.
    pub fn distance(&self, other: &Self) -> f64 {
        (self.x - other.x).hypot(self.y - other.y).max((self.radius - other.radius).abs())
    }
}

/// One pixel of every bin of a block.
pub(super) type Lane = [f32; LANES];

/// The directions of the bins along a rim, padded to a multiple of [`LANES`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Directions<'a> {
    pub cos: &'a [f32],
    pub sin: &'a [f32],
}

/// The use of clipped pixels in the edge fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum ClippedPixels {
    #[default]
    Excluded,
    /// Used as they are.
    Included,
}

/// The pixels near a circle, binned by angle.
#[derive(Debug, Default)]
pub(super) struct Annulus {
    bins: usize,
    /// The circle that the pixels were gathered around.
    middle: Outline,
    x: Vec<Lane>,
    y: Vec<Lane>,
    grey: Vec<Lane>,
    distance: Vec<Lane>,
    weight: Vec<Lane>,
    count: Vec<u32>,
    cos: Vec<f64>,
    sin: Vec<f64>,
    /// Cosines and sines in single precision, for vector instructions.
    unit: [Vec<f32>; 2],
    places: Vec<f32>,
    /// The saturation level; infinite if no pixel is saturated.
    white: f32,
    clipped: ClippedPixels,
    kind: RimKind,
}

/// The pixels of a block, relative to the gathered circle, and their grey levels.
#[derive(Clone, Copy)]
struct Pixels<'a> {
    x: &'a [Lane],
    y: &'a [Lane],
    grey: &'a [Lane],
}

/// The circle that distances are measured from, and the limits of the annulus.
#[derive(Clone, Copy)]
struct Band {
    x: f32,
    y: f32,
    radius: f32,
    /// Pixels of this level and brighter are left out.
    white: f32,
    /// The reach inside the circle, px.
    inner: f32,
}

/// Computes the distances of pixels from a circle and selects those in the annulus.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn measure_block(pixels: Pixels<'_>, counts: &Lane, band: Band, distance: &mut [Lane], weight: &mut [Lane]) {
    let pixels = pixels.x.iter().zip(pixels.y).zip(pixels.grey).zip(distance.iter_mut().zip(weight)).enumerate();
    for (slot, (((x, y), grey), (distance, weight))) in pixels {
        for i in 0..LANES {
            let (dx, dy) = (x[i] - band.x, y[i] - band.y);
            let d = (dx * dx + dy * dy).sqrt() - band.radius;
            // Slots without a pixel hold old values. `&` evaluates all: branches would prevent vectorization.
            let filled = ((slot as f32) < counts[i]) & (grey[i] < band.white);
            let near = (d < BAND_PX as f32) & (d > -band.inner) & filled;
            weight[i] = if near { 1.0 } else { 0.0 };
            distance[i] = if near { d } else { 0.0 };
        }
    }
}

/// Returns the maximum of some values.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
pub(super) fn maximum(values: &[f32]) -> f32 {
    let mut maximum = [f32::NEG_INFINITY; LANES];
    let (chunks, rest) = values.as_chunks::<LANES>();
    for chunk in chunks {
        for lane in 0..LANES {
            maximum[lane] = if chunk[lane] > maximum[lane] { chunk[lane] } else { maximum[lane] };
        }
    }
    maximum.iter().chain(rest).copied().fold(f32::NEG_INFINITY, f32::max)
}

impl Annulus {
    /// Sets the use of clipped pixels.
    pub fn set_clipped(&mut self, clipped: ClippedPixels) {
        self.clipped = clipped;
    }

    /// Sets the kind of rim; the annulus reaches less far inside a speckled one.
    pub fn set_kind(&mut self, kind: RimKind) {
        self.kind = kind;
    }

    /// The use of clipped pixels.
    pub fn clipped(&self) -> ClippedPixels {
        self.clipped
    }

    /// The level from which gathered pixels are clipped; infinite if none is.
    pub fn white(&self) -> f32 {
        self.white
    }

    /// The number of bins along the rim.
    pub fn bins(&self) -> usize {
        self.bins
    }

    /// Returns the unit vector from the centre to the middle of a bin.
    pub fn direction(&self, bin: usize) -> (f64, f64) {
        (self.cos[bin], self.sin[bin])
    }

    /// Returns cosines and sines of the directions of all bins, padded to a multiple of [`LANES`].
    pub fn directions(&self) -> Directions<'_> {
        Directions { cos: &self.unit[0], sin: &self.unit[1] }
    }

    /// Returns the number of pixels in a bin.
    pub fn count(&self, bin: usize) -> u32 {
        self.count[bin]
    }

    /// Returns distance, grey level and weight (0 for no pixel) of the bins from `16 block`.
    pub fn block(&self, block: usize) -> (&[Lane], &[Lane], &[Lane]) {
        let range = self.slot_range(block);
        (&self.distance[range.clone()], &self.grey[range.clone()], &self.weight[range])
    }

    /// Sorts the pixels of the annulus around `outline` into bins.
    pub fn gather(&mut self, image: ImageView<'_>, outline: &Outline) {
        self.reset(outline.radius);
        self.middle = *outline;
        let outer = outline.radius + BAND_PX + SLACK_PX;
        let inner = (outline.radius - INNER_BAND_PX - SLACK_PX).max(0.0);
        let rows = pixel_range(outline.y - outer, outline.y + outer, image.height());
        for y in rows {
            let dy = y as f64 - outline.y;
            let reach = (outer * outer - dy * dy).max(0.0).sqrt();
            let hole = (inner * inner - dy * dy).max(0.0).sqrt();
            let row = image.row(y);
            let left = pixel_range(outline.x - reach, outline.x - hole, row.len());
            let right = pixel_range(outline.x + hole, outline.x + reach, row.len());
            let right = right.start.max(left.end)..right.end;
            for run in [left, right] {
                let first = (run.start as f64 - outline.x) as f32;
                self.sort_run(&row[run], first, dy as f32);
            }
        }
        let highest = maximum(self.grey.as_flattened());
        self.white = if is_saturated(highest) { highest - 0.5 } else { f32::INFINITY };
        self.update_distances(outline);
    }

    /// Updates the distances and weights for `outline`, which must be within [`SLACK_PX`] of the gathered circle.
    pub fn update_distances(&mut self, outline: &Outline) {
        let band = Band {
            x: (outline.x - self.middle.x) as f32,
            y: (outline.y - self.middle.y) as f32,
            radius: outline.radius as f32,
            white: if self.clipped == ClippedPixels::Included { f32::INFINITY } else { self.white },
            inner: if self.kind == RimKind::Clean { INNER_BAND_PX } else { SPECKLED_BAND_PX } as f32,
        };
        for block in 0..self.count.len() / LANES {
            let range = self.slot_range(block);
            let [x, y, grey] = [&self.x, &self.y, &self.grey].map(|list| &list[range.clone()]);
            let counts = std::array::from_fn(|lane| self.count[block * LANES + lane] as f32);
            let (distance, weight) = (&mut self.distance[range.clone()], &mut self.weight[range]);
            measure_block(Pixels { x, y, grey }, &counts, band, distance, weight);
        }
    }

    /// Returns the range of filled slots of a block in the lists.
    fn slot_range(&self, block: usize) -> std::ops::Range<usize> {
        let bins = &self.count[block * LANES..(block + 1) * LANES];
        let max_count = bins.iter().copied().max().unwrap_or(0) as usize;
        block * SLOTS..block * SLOTS + max_count
    }

    /// Sets the number of bins for a radius, px, and empties them.
    fn reset(&mut self, radius: f64) {
        let bins = ((std::f64::consts::TAU * radius / BIN_PX).round() as usize).max(MIN_BINS);
        let padded = bins.next_multiple_of(LANES);
        if bins != self.bins {
            self.bins = bins;
            let angle = |i: usize| (i as f64 + 0.5) * std::f64::consts::TAU / bins as f64;
            self.cos = (0..bins).map(|i| angle(i).cos()).collect();
            self.sin = (0..bins).map(|i| angle(i).sin()).collect();
            let padded = |list: &[f64]| list.iter().map(|v| *v as f32).chain(vec![0.0; padded - bins]).collect();
            self.unit = [padded(&self.cos), padded(&self.sin)];
        }
        let lanes = padded / LANES * SLOTS;
        // The counts mark the filled slots, except for the grey levels, whose maximum covers all slots.
        self.grey.clear();
        for list in [&mut self.x, &mut self.y, &mut self.grey, &mut self.distance, &mut self.weight] {
            list.resize(lanes, [0.0; LANES]);
        }
        self.count.clear();
        self.count.resize(padded, 0);
    }

    /// Sorts a run of pixels of one row into bins, the first at (`first`, `dy`) from the centre, px.
    fn sort_run(&mut self, pixels: &[f32], first: f32, dy: f32) {
        self.places.resize(pixels.len(), 0.0);
        bin_coordinates(first, dy, self.bins as f32 / std::f32::consts::TAU, &mut self.places);
        for (k, (&place, &grey)) in self.places.iter().zip(pixels).enumerate() {
            let bin = (place as i32 as usize).min(self.bins - 1);
            let slot = self.count[bin] as usize;
            if slot < SLOTS {
                let (index, lane) = (bin / LANES * SLOTS + slot, bin % LANES);
                self.x[index][lane] = first + k as f32;
                self.y[index][lane] = dy;
                self.grey[index][lane] = grey;
                self.count[bin] += 1;
            }
        }
    }
}

/// Computes the bin coordinates of a run of pixels, the first at (`first`, `dy`) from the centre, px.
///
/// `per_radian` is the number of bins per radian.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn bin_coordinates(first: f32, dy: f32, per_radian: f32, out: &mut [f32]) {
    for (k, out) in out.iter_mut().enumerate() {
        *out = approximate_angle(first + k as i32 as f32, dy) * per_radian;
    }
}

/// Returns the range of whole pixels from `low` to `high` within an image of this length.
fn pixel_range(low: f64, high: f64, length: usize) -> std::ops::Range<usize> {
    let start = low.ceil().max(0.0) as usize;
    let end = if high < 0.0 { 0 } else { (high.floor() as usize + 1).min(length) };
    start.min(end)..end
}

/// Returns the angle of (`x`, `y`), 0 to 2 pi, within 1e-4 rad, which suffices to choose a bin.
///
/// M. Abramowitz and I. A. Stegun, Handbook of Mathematical Functions (1964), formula 4.4.49.
#[inline(always)]
fn approximate_angle(x: f32, y: f32) -> f32 {
    let (ax, ay) = (x.abs(), y.abs());
    let (small, large) = if ax < ay { (ax, ay) } else { (ay, ax) };
    let t = small / large.max(1e-12);
    let t2 = t * t;
    let series = t * (0.999_866 + t2 * (-0.330_299_5 + t2 * (0.180_141 + t2 * (-0.085_133 + t2 * 0.020_835_1))));
    let octant = if ay > ax { std::f32::consts::FRAC_PI_2 - series } else { series };
    let half = if x < 0.0 { std::f32::consts::PI - octant } else { octant };
    if y < 0.0 { std::f32::consts::TAU - half } else { half }
}
