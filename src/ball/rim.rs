//! The pixels of a rim, sorted into bins along it.

use crate::image::{ImageView, is_saturated};

/// Bins worked on at a time, for vector instructions.
pub(super) const LANES: usize = 16;
/// Fewest bins, of the smallest balls.
const LEAST_BINS: usize = 8;
/// Most pixels remembered of a bin.
pub(super) const SLOTS: usize = 24;
/// Rim covered by one bin, px: short, so that some bins fit between speckles.
pub(super) const BIN_PX: f64 = 1.7;
/// The band of pixels reaches this far out from the rim, px.
pub(super) const BAND_PX: f64 = 3.0;
/// The band reaches this far in, px: less, because speckle and shade begin there.
pub(super) const INNER_BAND_PX: f64 = 2.5;

/// As far in where marks line the rim, px.
const LINED_BAND_PX: f64 = 1.5;

/// The outline may move this far before its pixels have to be gathered again, px.
pub(super) const SLACK_PX: f64 = 0.5;

/// A circle that is being refined.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Outline {
    pub x: f64,
    pub y: f64,
    pub radius: f64,
}

/// One pixel of every bin of a block.
pub(super) type Lane = [f32; LANES];

/// Pixels near a circle, binned by angle.
#[derive(Debug, Default)]
pub(super) struct Rim {
    bins: usize,
    /// The outline the pixels were gathered around.
    middle: Outline,
    x: Vec<Lane>,
    y: Vec<Lane>,
    grey: Vec<Lane>,
    distance: Vec<Lane>,
    weight: Vec<Lane>,
    count: Vec<u32>,
    cos: Vec<f64>,
    sin: Vec<f64>,
    /// Cosines and sines once more, for vector instructions.
    unit: [Vec<f32>; 2],
    places: Vec<f32>,
    /// Pixels this bright are as bright as any can be; infinite where none is.
    white: f32,
    takes_clipped: bool,
    is_lined: bool,
}

/// Distances of pixels from a circle, and which of them lie in the band.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn measure_block(
    [x, y, grey]: [&[Lane]; 3],
    counts: &Lane,
    (shift, radius): ((f32, f32), f32),
    (white, inner): (f32, f32),
    (distance, weight): (&mut [Lane], &mut [Lane]),
) {
    let pixels = x.iter().zip(y).zip(grey).zip(distance.iter_mut().zip(weight)).enumerate();
    for (slot, (((x, y), grey), (distance, weight))) in pixels {
        for i in 0..LANES {
            let (dx, dy) = (x[i] - shift.0, y[i] - shift.1);
            let d = (dx * dx + dy * dy).sqrt() - radius;
            // Slots without a pixel hold what was there before. All are looked at: branches would stop the lanes.
            let filled = ((slot as f32) < counts[i]) & (grey[i] < white);
            let near = (d < BAND_PX as f32) & (d > -inner) & filled;
            weight[i] = if near { 1.0 } else { 0.0 };
            distance[i] = if near { d } else { 0.0 };
        }
    }
}

/// The highest of all grey levels.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn highest(grey: &[Lane]) -> f32 {
    let mut highest = [f32::NEG_INFINITY; LANES];
    for grey in grey {
        for i in 0..LANES {
            highest[i] = if grey[i] > highest[i] { grey[i] } else { highest[i] };
        }
    }
    highest.into_iter().fold(f32::NEG_INFINITY, f32::max)
}

impl Rim {
    /// Whether pixels as bright as any can be count as what they look like; they are left out else.
    pub fn take_clipped(&mut self, takes_clipped: bool) {
        self.takes_clipped = takes_clipped;
    }

    /// Whether marks line the rim, as they do at that of a sphere: then less of what is inside of it counts.
    pub fn take_lined(&mut self, is_lined: bool) {
        self.is_lined = is_lined;
    }

    /// As told to [`Self::take_clipped`].
    pub fn takes_clipped(&self) -> bool {
        self.takes_clipped
    }

    /// The level from which on pixels gathered last are clipped; infinite where none is.
    pub fn white(&self) -> f32 {
        self.white
    }

    /// Bins along the rim.
    pub fn bins(&self) -> usize {
        self.bins
    }

    /// Unit vector from the centre to the middle of a bin.
    pub fn direction(&self, bin: usize) -> (f64, f64) {
        (self.cos[bin], self.sin[bin])
    }

    /// Cosines and sines of the directions of all bins, and on to a multiple of [`LANES`].
    pub fn directions(&self) -> [&[f32]; 2] {
        [&self.unit[0], &self.unit[1]]
    }

    /// Pixels in a bin.
    pub fn count(&self, bin: usize) -> u32 {
        self.count[bin]
    }

    /// The pixels of bins `16 block ..`: distance, grey level, weight (0 where there is none).
    pub fn block(&self, block: usize) -> (&[Lane], &[Lane], &[Lane]) {
        let range = self.slots(block);
        (&self.distance[range.clone()], &self.grey[range.clone()], &self.weight[range])
    }

    /// Sorts the pixels of the band around `outline` into bins.
    pub fn gather(&mut self, image: ImageView<'_>, outline: &Outline) {
        self.clear(outline.radius);
        self.middle = *outline;
        let outer = outline.radius + BAND_PX + SLACK_PX;
        let inner = (outline.radius - INNER_BAND_PX - SLACK_PX).max(0.0);
        let rows = clip(outline.y - outer, outline.y + outer, image.height());
        for y in rows {
            let dy = y as f64 - outline.y;
            let reach = (outer * outer - dy * dy).max(0.0).sqrt();
            let hole = (inner * inner - dy * dy).max(0.0).sqrt();
            let row = image.row(y);
            let left = clip(outline.x - reach, outline.x - hole, row.len());
            let right = clip(outline.x + hole, outline.x + reach, row.len());
            let right = right.start.max(left.end)..right.end;
            for part in [left, right] {
                let first = (part.start as f64 - outline.x) as f32;
                self.push(&row[part], first, dy as f32);
            }
        }
        let highest = highest(&self.grey);
        self.white = if is_saturated(highest) { highest - 0.5 } else { f32::INFINITY };
        self.measure(outline);
    }

    /// Takes the distances from `outline` anew; it must be within half a pixel of where the pixels were gathered.
    pub fn measure(&mut self, outline: &Outline) {
        let shift = ((outline.x - self.middle.x) as f32, (outline.y - self.middle.y) as f32);
        let radius = outline.radius as f32;
        let white = if self.takes_clipped { f32::INFINITY } else { self.white };
        let inner = if self.is_lined { LINED_BAND_PX } else { INNER_BAND_PX } as f32;
        for block in 0..self.count.len() / LANES {
            let range = self.slots(block);
            let pixels = [&self.x, &self.y, &self.grey].map(|list| &list[range.clone()]);
            let counts = std::array::from_fn(|lane| self.count[block * LANES + lane] as f32);
            let out = (&mut self.distance[range.clone()], &mut self.weight[range]);
            measure_block(pixels, &counts, (shift, radius), (white, inner), out);
        }
    }

    fn slots(&self, block: usize) -> std::ops::Range<usize> {
        let bins = &self.count[block * LANES..(block + 1) * LANES];
        let most = bins.iter().copied().max().unwrap_or(0) as usize;
        block * SLOTS..block * SLOTS + most
    }

    fn clear(&mut self, radius: f64) {
        let bins = ((std::f64::consts::TAU * radius / BIN_PX).round() as usize).max(LEAST_BINS);
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
        // What slots without a pixel hold is told by the counts, but for the grey levels, whose mean is taken over all.
        self.grey.clear();
        for list in [&mut self.x, &mut self.y, &mut self.grey, &mut self.distance, &mut self.weight] {
            list.resize(lanes, [0.0; LANES]);
        }
        self.count.clear();
        self.count.resize(padded, 0);
    }

    /// Sorts a run of pixels in, the first one at (`first`, `dy`) from the centre.
    fn push(&mut self, pixels: &[f32], first: f32, dy: f32) {
        self.places.resize(pixels.len(), 0.0);
        angles(first, dy, self.bins as f32 / std::f32::consts::TAU, &mut self.places);
        for (k, (&place, &grey)) in self.places.iter().zip(pixels).enumerate() {
            let bin = (place as i32 as usize).min(self.bins - 1);
            let slot = self.count[bin] as usize;
            if slot < SLOTS {
                let (at, lane) = (bin / LANES * SLOTS + slot, bin % LANES);
                self.x[at][lane] = first + k as f32;
                self.y[at][lane] = dy;
                self.grey[at][lane] = grey;
                self.count[bin] += 1;
            }
        }
    }
}

/// The angles of a run of pixels, the first one at (`first`, `dy`) from the centre, in units of so many a radian.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn angles(first: f32, dy: f32, per_radian: f32, out: &mut [f32]) {
    for (k, out) in out.iter_mut().enumerate() {
        *out = angle(first + k as i32 as f32, dy) * per_radian;
    }
}

/// The whole pixels from `low` to `high` that lie in an image of this length.
fn clip(low: f64, high: f64, length: usize) -> std::ops::Range<usize> {
    let start = low.ceil().max(0.0) as usize;
    let end = if high < 0.0 { 0 } else { (high.floor() as usize + 1).min(length) };
    start.min(end)..end
}

/// Angle of (`x`, `y`), 0 to 2 pi, to 1e-4 rad: good enough to choose a bin.
#[inline(always)]
fn angle(x: f32, y: f32) -> f32 {
    let (ax, ay) = (x.abs(), y.abs());
    let (small, large) = if ax < ay { (ax, ay) } else { (ay, ax) };
    let t = small / large.max(1e-12);
    let t2 = t * t;
    let series = t * (0.999_866 + t2 * (-0.330_299_5 + t2 * (0.180_141 + t2 * (-0.085_133 + t2 * 0.020_835_1))));
    let octant = if ay > ax { std::f32::consts::FRAC_PI_2 - series } else { series };
    let half = if x < 0.0 { std::f32::consts::PI - octant } else { octant };
    if y < 0.0 { std::f32::consts::TAU - half } else { half }
}
