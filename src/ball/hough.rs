//! The coarse search: a Hough transform with gradient direction and sign on a reduced image.

use super::annulus::maximum;
use super::params::BallParams;
use super::pyramid::{GreyImage, blur, remove_bright_marks, remove_dark_marks};
use super::texture_disc::RadiusRange;
use crate::image::{ImageView, PixelRect};

/// A peak of the Hough transform: centre and radius in pixels of the full image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct HoughPeak {
    pub x: f32,
    pub y: f32,
    pub radius: f32,
    /// The uncertainty of the radius, px.
    pub spread: f32,
    /// The consistency of the sign of the radial gradient, which separates the ball from most other peaks.
    pub score: f32,
    /// The index of the radius range.
    pub band: usize,
}

/// The small marks that a morphological filter removes before the second pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Marks {
    Dark,
    Bright,
}

/// The minimum radius in the reduced image, px; a shorter rim does not stand out.
const MIN_REDUCED_RADIUS_PX: f32 = 7.5;
/// The maximum ratio of the radii that share one accumulator.
const BAND_RATIO: f32 = 1.8;
/// The half width below which a radius range is passed on as a whole, px.
const NARROW_RANGE_PX: f32 = 7.0;
/// The fraction of the searched pixels whose gradient votes.
const EDGE_FRACTION: f32 = 0.15;
/// The number of peaks kept of each accumulator.
const PEAKS: usize = 4;
/// The number of directions in which the radius of a peak is searched.
const SPOKES: usize = 48;

/// A range of radii with the pyramid level it is searched at.
#[derive(Debug, Clone, Copy)]
struct Band {
    level: usize,
    low: f32,
    high: f32,
}

/// A pixel with a strong gradient and its unit direction.
#[derive(Debug, Clone, Copy)]
struct Edge {
    x: f32,
    y: f32,
    ux: f32,
    uy: f32,
}

/// A cell of an accumulator.
#[derive(Debug, Clone, Copy)]
struct Votes {
    x: f32,
    y: f32,
    count: f32,
}

/// The planned search with its scratch memory.
#[derive(Debug, Default)]
pub(super) struct HoughSearch {
    bands: Vec<Band>,
    region: PixelRect,
    levels: Vec<GreyImage>,
    /// The image without small marks, for every range of radii.
    filtered: Vec<GreyImage>,
    scratch: GreyImage,
    smooth: GreyImage,
    gx: Vec<f32>,
    gy: Vec<f32>,
    size: Vec<f32>,
    sample: Vec<f32>,
    edges: Vec<Edge>,
    lighter: Vec<f32>,
    darker: Vec<f32>,
    box_sum: Vec<f32>,
    box_rows: Vec<f32>,
    peaks: Vec<Votes>,
    score: Vec<f32>,
    sums: Vec<f32>,
    spokes: Vec<(f32, f32)>,
}

impl HoughSearch {
    /// Plans the search in images of `width` x `height` pixels.
    pub fn new(params: &BallParams, width: usize, height: usize) -> Self {
        let bands = split_radii(params.min_radius_px as f32, params.max_radius_px as f32);
        let deepest = bands.iter().map(|b| b.level).max().unwrap_or(0);
        Self {
            region: params.region(width, height),
            levels: vec![GreyImage::default(); deepest + 1],
            filtered: vec![GreyImage::default(); bands.len()],
            bands,
            spokes: (0..SPOKES).map(|i| (i as f32 * std::f32::consts::TAU / SPOKES as f32).sin_cos()).collect(),
            ..Self::default()
        }
    }

    /// The number of radius ranges, which are searched one after the other.
    pub fn band_count(&self) -> usize {
        self.bands.len()
    }

    /// Returns the radius ranges, px.
    pub fn radius_ranges(&self) -> impl Iterator<Item = RadiusRange> {
        self.bands.iter().map(|band| RadiusRange { low: band.low.into(), high: band.high.into() })
    }

    /// Builds the image pyramid; the first step of every search.
    pub fn reduce(&mut self, image: ImageView<'_>) {
        let needs_full = self.bands.iter().any(|b| b.level == 0);
        if needs_full || self.levels.len() == 1 {
            self.levels[0].copy_region(image, self.region);
        }
        for level in 1..self.levels.len() {
            let (fine, coarse) = self.levels.split_at_mut(level);
            let fine = &fine[level - 1];
            match fine.view() {
                Some(view) if level > 1 => {
                    coarse[0].copy_halved(view, PixelRect::whole(fine.width as u32, fine.height as u32))
                }
                _ => coarse[0].copy_halved(image, self.region),
            }
        }
    }

    /// Appends the peaks of the reduced image.
    pub fn search(&mut self, found: &mut Vec<HoughPeak>) {
        for band in 0..self.bands.len() {
            blur(&self.levels[self.bands[band].level], &mut self.scratch, &mut self.smooth);
            self.find_centers(band, found);
        }
    }

    /// Appends the peaks of the reduced image without small marks.
    pub fn search_without_marks(&mut self, marks: Marks, found: &mut Vec<HoughPeak>) {
        for band in 0..self.bands.len() {
            let level = &self.levels[self.bands[band].level];
            let filtered = &mut self.filtered[band];
            match marks {
                Marks::Dark => remove_dark_marks(level, &mut self.scratch, filtered),
                Marks::Bright => remove_bright_marks(level, &mut self.scratch, filtered),
            }
            blur(filtered, &mut self.scratch, &mut self.smooth);
            self.find_centers(band, found);
        }
    }

    /// Returns the filtered image in which `peak` was found, and the size of its pixels, px.
    pub fn filtered_image(&self, peak: &HoughPeak) -> (&GreyImage, f32) {
        (&self.filtered[peak.band], (1 << self.bands[peak.band].level) as f32)
    }

    /// Converts a point of a range's reduced image to pixels of the full image.
    pub fn to_full(&self, band: usize, x: f32, y: f32) -> (f32, f32) {
        let scale = (1 << self.bands[band].level) as f32;
        let full = |v: f32, origin: u32| origin as f32 + (v + 0.5) * scale - 0.5;
        (full(x, self.region.left), full(y, self.region.top))
    }

    /// Converts a point of the full image to pixels of a range's reduced image.
    pub fn to_reduced(&self, band: usize, x: f32, y: f32) -> (f32, f32) {
        let scale = (1 << self.bands[band].level) as f32;
        let reduced = |v: f32, origin: u32| (v - origin as f32 + 0.5) / scale - 0.5;
        (reduced(x, self.region.left), reduced(y, self.region.top))
    }

    /// Appends the peaks of one radius range in the smoothed image.
    ///
    /// The votes of brighter and of darker balls are searched separately and together.
    fn find_centers(&mut self, band: usize, found: &mut Vec<HoughPeak>) {
        if self.smooth.width < 5 || self.smooth.height < 5 {
            return;
        }
        self.select_edges();
        self.cast_votes(self.bands[band]);
        self.peaks.clear();
        let (width, height) = (self.smooth.width, self.smooth.height);
        for pass in 0..3 {
            if pass == 2 {
                self.lighter.iter_mut().zip(&self.darker).for_each(|(votes, more)| *votes += more);
            }
            let votes = if pass == 1 { &self.darker } else { &self.lighter };
            sum_3x3(votes, width, height, &mut self.box_rows, &mut self.box_sum);
            pick_peaks(&self.box_sum, width, height, &mut self.peaks);
        }
        let peaks = std::mem::take(&mut self.peaks);
        for &Votes { x, y, .. } in &peaks {
            self.add_peak(band, x, y, found);
        }
        self.peaks = peaks;
    }

    /// Computes the gradients of the smoothed image and selects the pixels that vote.
    fn select_edges(&mut self) {
        let (width, height) = (self.smooth.width, self.smooth.height);
        let grey = &self.smooth.data;
        for list in [&mut self.gx, &mut self.gy, &mut self.size] {
            list.clear();
            list.resize(width * height, 0.0);
        }
        for y in 1..height - 1 {
            let row = y * width;
            let (above, here, below) =
                (&grey[row - width..row], &grey[row..row + width], &grey[row + width..row + 2 * width]);
            let (gx, gy, size) =
                (&mut self.gx[row..row + width], &mut self.gy[row..row + width], &mut self.size[row..row + width]);
            differences(above, here, below, gx, gy, size);
        }
        self.sample.clear();
        self.sample.extend(self.size.iter().step_by(if width * height > 4096 { 5 } else { 1 }));
        let rank = ((self.sample.len() as f32) * (1.0 - EDGE_FRACTION)) as usize;
        let rank = rank.min(self.sample.len() - 1);
        let (_, &mut floor, _) = self.sample.select_nth_unstable_by(rank, f32::total_cmp);
        self.edges.clear();
        for y in 1..height - 1 {
            for x in 1..width - 1 {
                let i = y * width + x;
                if self.size[i] > floor {
                    let scale = 1.0 / self.size[i];
                    self.edges.push(Edge { x: x as f32, y: y as f32, ux: self.gx[i] * scale, uy: self.gy[i] * scale });
                }
            }
        }
    }

    /// Adds the votes of every edge for the centres of circles through it, on both sides.
    fn cast_votes(&mut self, band: Band) {
        let (width, height) = (self.smooth.width, self.smooth.height);
        for list in [&mut self.lighter, &mut self.darker] {
            list.clear();
            list.resize(width * height, 0.0);
        }
        let scale = (1 << band.level) as f32;
        let (low, high) = ((band.low / scale).floor(), (band.high / scale).ceil());
        let steps = (high - low) as usize + 1;
        // Fixed point with 16 fractional bits: stepping in integers is cheaper than rounding every vote.
        const ONE: f32 = 65536.0;
        for edge in &self.edges {
            for (votes, sign) in [(&mut self.lighter, ONE), (&mut self.darker, -ONE)] {
                let (dx, dy) = ((sign * edge.ux) as i32, (sign * edge.uy) as i32);
                let start = |v: f32| ((v + 0.5) * ONE) as i32;
                let (mut x, mut y) = (start(edge.x) + low as i32 * dx, start(edge.y) + low as i32 * dy);
                for _ in 0..steps {
                    // Negative coordinates become huge ones.
                    let (column, row) = ((x >> 16) as usize, (y >> 16) as usize);
                    if column < width && row < height {
                        votes[row * width + column] += 1.0;
                    }
                    x += dx;
                    y += dy;
                }
            }
        }
    }

    /// Appends one peak with the radii that its surroundings suggest.
    fn add_peak(&mut self, band_index: usize, x: f32, y: f32, found: &mut Vec<HoughPeak>) {
        let band = self.bands[band_index];
        let scale = (1 << band.level) as f32;
        let (full_x, full_y) = self.to_full(band_index, x, y);
        let half = 0.5 * (band.high - band.low);
        let (low, high) = ((band.low / scale).floor() as usize, (band.high / scale).ceil() as usize);
        self.radial_score(x, y, low, high);
        for _ in 0..2 {
            let Some((best, &score)) = self.score.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)) else { return };
            if score <= 0.0 {
                return;
            }
            if half <= NARROW_RANGE_PX {
                add_distinct(
                    found,
                    HoughPeak {
                        x: full_x,
                        y: full_y,
                        radius: 0.5 * (band.low + band.high),
                        spread: half,
                        score,
                        band: band_index,
                    },
                );
                return;
            }
            let radius = ((low + best) as f32 * scale).clamp(band.low, band.high);
            add_distinct(
                found,
                HoughPeak { x: full_x, y: full_y, radius, spread: 2.0 * scale, score, band: band_index },
            );
            let clear = best.saturating_sub(2)..(best + 3).min(self.score.len());
            self.score[clear].fill(0.0);
        }
    }

    /// Computes the consistency of the sign of the radial gradient, 0 to 1, at the distances `low` to `high` from
    /// (`x`, `y`).
    ///
    /// All lengths are in pixels of the reduced image.
    fn radial_score(&mut self, x: f32, y: f32, low: usize, high: usize) {
        let (width, height) = (self.smooth.width as i32, self.smooth.height as i32);
        self.sums.clear();
        self.sums.resize(high - low + 3, 0.0);
        let first = low as f32 - 1.0;
        for &(cos, sin) in &self.spokes {
            let (mut px, mut py) = (x + 0.5 + first * cos, y + 0.5 + first * sin);
            for sum in &mut self.sums {
                // Truncation towards zero includes the row and column before the first, which repeat it.
                let (column, row) = (px as i32, py as i32);
                if (0..width).contains(&column) && (0..height).contains(&row) {
                    let i = (row * width + column) as usize;
                    let along = self.gx[i] * cos + self.gy[i] * sin;
                    // The direction counts, not the strength: one bright spot must not outweigh the rim.
                    *sum += along / (self.size[i] + 1e-3);
                }
                px += cos;
                py += sin;
            }
        }
        self.score.clear();
        let scale = 1.0 / SPOKES as f32;
        self.score.extend(self.sums.windows(3).map(|w| (w[0] + w[1] + w[2]).abs() * scale));
    }
}

/// Splits the radii, px, into ranges that one accumulator resolves from noise.
fn split_radii(low: f32, high: f32) -> Vec<Band> {
    let count = ((high / low).ln() / BAND_RATIO.ln()).ceil().max(1.0);
    let ratio = (high / low).powf(1.0 / count);
    (0..count as usize)
        .map(|i| {
            let low = low * ratio.powi(i as i32);
            let level = (low / MIN_REDUCED_RADIUS_PX).log2().floor().clamp(0.0, 6.0) as usize;
            Band { level, low, high: low * ratio }
        })
        .collect()
}

/// Adds a peak, or replaces one of nearly the same circle if its score is higher.
fn add_distinct(found: &mut Vec<HoughPeak>, peak: HoughPeak) {
    let near = |other: &HoughPeak| {
        let (dx, dy, dr) = (other.x - peak.x, other.y - peak.y, other.radius - peak.radius);
        dx * dx + dy * dy < 12.0 && dr.abs() < 4.0
    };
    match found.iter_mut().find(|p| near(p)) {
        Some(known) if known.score < peak.score => *known = peak,
        Some(_) => {}
        None => found.push(peak),
    }
}

/// Sums the votes over 3 x 3 cells; zero at the border.
fn sum_3x3(votes: &[f32], width: usize, height: usize, rows: &mut Vec<f32>, sums: &mut Vec<f32>) {
    rows.clear();
    rows.resize(width * height, 0.0);
    sums.clear();
    sums.resize(width * height, 0.0);
    for (row, out) in votes.chunks_exact(width).zip(rows.chunks_exact_mut(width)) {
        add_three(row, &row[1..], &row[2..], &mut out[1..width - 1]);
    }
    // The rows are contiguous, so they are added as one.
    let inner = &mut sums[width..(height - 1) * width];
    add_three(rows, &rows[width..], &rows[2 * width..], inner);
}

/// Computes central differences along a row and across it, and their magnitude.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn differences(above: &[f32], here: &[f32], below: &[f32], gx: &mut [f32], gy: &mut [f32], size: &mut [f32]) {
    let inner = here.len() - 2;
    let (left, right, above, below) = (&here[..inner], &here[2..], &above[1..][..inner], &below[1..][..inner]);
    let (gx, gy, size) = (&mut gx[1..][..inner], &mut gy[1..][..inner], &mut size[1..][..inner]);
    for x in 0..inner {
        let (dx, dy) = (right[x] - left[x], below[x] - above[x]);
        (gx[x], gy[x], size[x]) = (dx, dy, (dx * dx + dy * dy).sqrt());
    }
}

/// Adds three lists.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn add_three(a: &[f32], b: &[f32], c: &[f32], out: &mut [f32]) {
    for (((out, a), b), c) in out.iter_mut().zip(a).zip(b).zip(c) {
        *out = a + b + c;
    }
}

/// Appends the highest peaks of `sums`, at least three cells apart.
fn pick_peaks(sums: &[f32], width: usize, height: usize, peaks: &mut Vec<Votes>) {
    let first = peaks.len();
    // A ball may have fewer votes than the edge of an occluder, but not far fewer.
    let floor = 0.3 * maximum(sums);
    for y in 1..height - 1 {
        let row = y * width;
        // Most rows have no peak.
        if maximum(&sums[row..row + width]) <= floor {
            continue;
        }
        for x in 1..width - 1 {
            let here = sums[row + x];
            let full = peaks.len() - first >= PEAKS;
            if here <= floor || (full && here <= peaks[peaks.len() - 1].count) {
                continue;
            }
            let around = [row + x - 1, row + x + 1, row + x - width, row + x + width];
            if around.iter().any(|&i| sums[i] > here) {
                continue;
            }
            insert_peak(peaks, first, Votes { x: x as f32, y: y as f32, count: here });
        }
    }
}

/// Inserts a peak; keeps `peaks[first..]` sorted, distinct and no longer than [`PEAKS`].
fn insert_peak(peaks: &mut Vec<Votes>, first: usize, peak: Votes) {
    let near = |other: &Votes| (other.x - peak.x).abs() < 3.0 && (other.y - peak.y).abs() < 3.0;
    if let Some(i) = peaks[first..].iter().position(near) {
        if peaks[first + i].count >= peak.count {
            return;
        }
        peaks.remove(first + i);
    }
    let at = peaks[first..].iter().position(|other| other.count < peak.count).map_or(peaks.len(), |i| first + i);
    peaks.insert(at, peak);
    peaks.truncate(first + PEAKS);
}
