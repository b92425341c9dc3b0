//! Where balls may be: a Hough transform that knows the gradient's direction
//! and sign, on a reduced picture.

use super::params::BallParams;
use super::shrink::{Grey, blur, close_dark, halve, open_bright};
use crate::image::ImageView;

/// A place worth a closer look: centre and radius in pixels of the full image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    pub x: f32,
    pub y: f32,
    pub radius: f32,
    /// How far the radius may be off, px.
    pub spread: f32,
    /// How much of one sign the radial gradient is around it; tells the ball from most other places.
    pub score: f32,
    /// The range of radii it was found in.
    pub band: usize,
}

/// Which small marks are painted out before the second look.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Marks {
    Dark,
    Bright,
}

/// Least radius in the reduced picture, px: below it the rim is too short to stand out.
const LEAST_REDUCED_RADIUS: f32 = 7.5;
/// Largest ratio of the radii that share one accumulator.
const BAND_RATIO: f32 = 1.8;
/// A radius range narrower than this on either side is handed on whole, px.
const NARROW_PX: f32 = 7.0;
/// Share of the searched pixels whose gradient votes.
const EDGE_SHARE: f32 = 0.15;
/// Peaks kept of each accumulator.
const PEAKS: usize = 4;
/// Directions in which a peak's radius is looked for.
const SPOKES: usize = 48;

/// One range of radii with the reduction it is searched at.
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

/// The planned search with its scratch.
#[derive(Debug)]
pub(super) struct Coarse {
    bands: Vec<Band>,
    roi: [usize; 4],
    levels: Vec<Grey>,
    /// The picture without small marks, for every range of radii.
    closed: Vec<Grey>,
    spare: Grey,
    smooth: Grey,
    gx: Vec<f32>,
    gy: Vec<f32>,
    size: Vec<f32>,
    sample: Vec<f32>,
    edges: Vec<Edge>,
    lighter: Vec<f32>,
    darker: Vec<f32>,
    box_sum: Vec<f32>,
    box_rows: Vec<f32>,
    peaks: Vec<(f32, f32, f32)>,
    score: Vec<f32>,
    sums: Vec<f32>,
    spokes: Vec<(f32, f32)>,
}

impl Coarse {
    pub fn new(params: &BallParams, width: usize, height: usize) -> Self {
        let roi = params.roi_px.map_or([0, 0, width, height], |r| r.map(|v| v as usize));
        let bands = bands(params.min_radius_px as f32, params.max_radius_px as f32);
        let deepest = bands.iter().map(|b| b.level).max().unwrap_or(0);
        Self {
            roi,
            levels: vec![Grey::default(); deepest + 1],
            closed: vec![Grey::default(); bands.len()],
            bands,
            spare: Grey::default(),
            smooth: Grey::default(),
            gx: Vec::new(),
            gy: Vec::new(),
            size: Vec::new(),
            sample: Vec::new(),
            edges: Vec::new(),
            lighter: Vec::new(),
            darker: Vec::new(),
            box_sum: Vec::new(),
            box_rows: Vec::new(),
            peaks: Vec::new(),
            score: Vec::new(),
            sums: Vec::new(),
            spokes: (0..SPOKES).map(|i| (i as f32 * std::f32::consts::TAU / SPOKES as f32).sin_cos()).collect(),
        }
    }

    /// Ranges of radii searched one after the other.
    pub fn bands(&self) -> usize {
        self.bands.len()
    }

    /// Reduces the picture; the first step of every search.
    pub fn reduce(&mut self, image: ImageView<'_>) {
        let [x0, y0, width, height] = self.roi;
        let needs_full = self.bands.iter().any(|b| b.level == 0);
        if needs_full || self.levels.len() == 1 {
            self.levels[0].take(image, x0, y0, width, height);
        }
        for level in 1..self.levels.len() {
            if level == 1 {
                self.levels[1].halve_view(image, x0, y0, width, height);
            } else {
                let (fine, coarse) = self.levels.split_at_mut(level);
                halve(&fine[level - 1], &mut coarse[0]);
            }
        }
    }

    /// Adds to `places` where a ball may be, from the reduced picture as it is.
    pub fn plain(&mut self, places: &mut Vec<Place>) {
        for band in 0..self.bands.len() {
            blur(&self.levels[self.bands[band].level], &mut self.spare, &mut self.smooth);
            self.vote(band, places);
        }
    }

    /// Adds to `places` where a ball may be once small marks are painted out.
    pub fn without_marks(&mut self, marks: Marks, places: &mut Vec<Place>) {
        for band in 0..self.bands.len() {
            let level = &self.levels[self.bands[band].level];
            let closed = &mut self.closed[band];
            match marks {
                Marks::Dark => close_dark(level, &mut self.spare, closed),
                Marks::Bright => open_bright(level, &mut self.spare, closed),
            }
            blur(closed, &mut self.spare, &mut self.smooth);
            self.vote(band, places);
        }
    }

    /// The picture without small marks in which `place` was found, and the size of its pixels, px.
    pub fn without_marks_around(&self, place: &Place) -> (&Grey, f32) {
        (&self.closed[place.band], (1 << self.bands[place.band].level) as f32)
    }

    /// A point of a range's reduced picture, in pixels of the full image.
    pub fn full(&self, band: usize, x: f32, y: f32) -> (f32, f32) {
        let scale = (1 << self.bands[band].level) as f32;
        let full = |v: f32, origin: usize| origin as f32 + (v + 0.5) * scale - 0.5;
        (full(x, self.roi[0]), full(y, self.roi[1]))
    }

    /// A point of the full image, in pixels of a range's reduced picture.
    pub fn reduced(&self, band: usize, x: f32, y: f32) -> (f32, f32) {
        let scale = (1 << self.bands[band].level) as f32;
        let reduced = |v: f32, origin: usize| (v - origin as f32 + 0.5) / scale - 0.5;
        (reduced(x, self.roi[0]), reduced(y, self.roi[1]))
    }

    fn vote(&mut self, band: usize, places: &mut Vec<Place>) {
        if self.smooth.width < 5 || self.smooth.height < 5 {
            return;
        }
        self.gradients();
        self.cast(self.bands[band]);
        self.peaks.clear();
        let (width, height) = (self.smooth.width, self.smooth.height);
        for which in 0..3 {
            if which == 2 {
                self.lighter.iter_mut().zip(&self.darker).for_each(|(votes, more)| *votes += more);
            }
            let votes = if which == 1 { &self.darker } else { &self.lighter };
            sum_3x3(votes, width, height, &mut self.box_rows, &mut self.box_sum);
            pick_peaks(&self.box_sum, width, height, &mut self.peaks);
        }
        let peaks = std::mem::take(&mut self.peaks);
        for &(x, y, _) in &peaks {
            self.place(band, x, y, places);
        }
        self.peaks = peaks;
    }

    /// Gradients of the smoothed picture, and the pixels among them that vote.
    fn gradients(&mut self) {
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
            differences([above, here, below], gx, gy, size);
        }
        self.sample.clear();
        self.sample.extend(self.size.iter().step_by(if width * height > 4096 { 5 } else { 1 }));
        let rank = ((self.sample.len() as f32) * (1.0 - EDGE_SHARE)) as usize;
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

    /// Every edge votes for the centres that would put a rim there.
    fn cast(&mut self, band: Band) {
        let (width, height) = (self.smooth.width, self.smooth.height);
        for list in [&mut self.lighter, &mut self.darker] {
            list.clear();
            list.resize(width * height, 0.0);
        }
        let scale = (1 << band.level) as f32;
        let (low, high) = ((band.low / scale).floor(), (band.high / scale).ceil());
        let steps = (high - low) as usize + 1;
        // 16 bits after the point: stepping in whole numbers is cheaper than rounding every vote.
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

    /// Hands one peak on, with the radii that its surroundings suggest.
    fn place(&mut self, number: usize, x: f32, y: f32, places: &mut Vec<Place>) {
        let band = self.bands[number];
        let scale = (1 << band.level) as f32;
        let (full_x, full_y) = self.full(number, x, y);
        let half = 0.5 * (band.high - band.low);
        let (low, high) = ((band.low / scale).floor() as usize, (band.high / scale).ceil() as usize);
        self.radial_score(x, y, low, high);
        for _ in 0..2 {
            let Some((best, &score)) = self.score.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)) else { return };
            if score <= 0.0 {
                return;
            }
            if half <= NARROW_PX {
                add(
                    places,
                    Place {
                        x: full_x,
                        y: full_y,
                        radius: 0.5 * (band.low + band.high),
                        spread: half,
                        score,
                        band: number,
                    },
                );
                return;
            }
            let radius = ((low + best) as f32 * scale).clamp(band.low, band.high);
            add(places, Place { x: full_x, y: full_y, radius, spread: 2.0 * scale, score, band: number });
            let clear = best.saturating_sub(2)..(best + 3).min(self.score.len());
            self.score[clear].fill(0.0);
        }
    }

    /// How much of one sign the radial gradient is at every distance from (`x`, `y`), mean over the directions.
    fn radial_score(&mut self, x: f32, y: f32, low: usize, high: usize) {
        let (width, height) = (self.smooth.width as i32, self.smooth.height as i32);
        self.sums.clear();
        self.sums.resize(high - low + 3, 0.0);
        let first = low as f32 - 1.0;
        for &(cos, sin) in &self.spokes {
            let (mut px, mut py) = (x + 0.5 + first * cos, y + 0.5 + first * sin);
            for sum in &mut self.sums {
                // Cutting off towards zero lets the row and the column before the first one in; they repeat it.
                let (column, row) = (px as i32, py as i32);
                if (0..width).contains(&column) && (0..height).contains(&row) {
                    let i = (row * width + column) as usize;
                    let along = self.gx[i] * cos + self.gy[i] * sin;
                    // The direction counts, not the strength: one bright fleck must not outweigh the rim.
                    *sum += along / (self.size[i] + 1e-3);
                }
                px += cos;
                py += sin;
            }
        }
        self.score.clear();
        let share = 1.0 / SPOKES as f32;
        self.score.extend(self.sums.windows(3).map(|w| (w[0] + w[1] + w[2]).abs() * share));
    }
}

/// Splits the radii into ranges that one accumulator can tell from noise.
fn bands(low: f32, high: f32) -> Vec<Band> {
    let count = ((high / low).ln() / BAND_RATIO.ln()).ceil().max(1.0);
    let ratio = (high / low).powf(1.0 / count);
    (0..count as usize)
        .map(|i| {
            let low = low * ratio.powi(i as i32);
            let level = (low / LEAST_REDUCED_RADIUS).log2().floor().clamp(0.0, 6.0) as usize;
            Band { level, low, high: low * ratio }
        })
        .collect()
}

fn add(places: &mut Vec<Place>, place: Place) {
    let near = |other: &Place| {
        let (dx, dy, dr) = (other.x - place.x, other.y - place.y, other.radius - place.radius);
        dx * dx + dy * dy < 12.0 && dr.abs() < 4.0
    };
    match places.iter_mut().find(|p| near(p)) {
        Some(known) if known.score < place.score => *known = place,
        Some(_) => {}
        None => places.push(place),
    }
}

fn sum_3x3(votes: &[f32], width: usize, height: usize, rows: &mut Vec<f32>, sums: &mut Vec<f32>) {
    rows.clear();
    rows.resize(width * height, 0.0);
    sums.clear();
    sums.resize(width * height, 0.0);
    for (row, out) in votes.chunks_exact(width).zip(rows.chunks_exact_mut(width)) {
        add_three([row, &row[1..], &row[2..]], &mut out[1..width - 1]);
    }
    // Rows lie behind one another, so all of them are one.
    let inner = &mut sums[width..(height - 1) * width];
    add_three([rows, &rows[width..], &rows[2 * width..]], inner);
}

/// Central differences along a row and across it, and their size.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn differences([above, here, below]: [&[f32]; 3], gx: &mut [f32], gy: &mut [f32], size: &mut [f32]) {
    let inner = here.len() - 2;
    let (left, right, above, below) = (&here[..inner], &here[2..], &above[1..][..inner], &below[1..][..inner]);
    let (gx, gy, size) = (&mut gx[1..][..inner], &mut gy[1..][..inner], &mut size[1..][..inner]);
    for x in 0..inner {
        let (dx, dy) = (right[x] - left[x], below[x] - above[x]);
        (gx[x], gy[x], size[x]) = (dx, dy, (dx * dx + dy * dy).sqrt());
    }
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn add_three([a, b, c]: [&[f32]; 3], out: &mut [f32]) {
    for (((out, a), b), c) in out.iter_mut().zip(a).zip(b).zip(c) {
        *out = a + b + c;
    }
}

/// The highest of some values, none of which is negative.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn highest(values: &[f32]) -> f32 {
    const LANES: usize = 16;
    let mut highest = [0.0_f32; LANES];
    let (chunks, rest) = values.as_chunks::<LANES>();
    for chunk in chunks {
        for lane in 0..LANES {
            highest[lane] = if chunk[lane] > highest[lane] { chunk[lane] } else { highest[lane] };
        }
    }
    highest.iter().chain(rest).fold(0.0, |a, &b| if b > a { b } else { a })
}

/// Adds the highest peaks of `sums`, at least three cells from one another, as (x, y, height).
fn pick_peaks(sums: &[f32], width: usize, height: usize, peaks: &mut Vec<(f32, f32, f32)>) {
    let first = peaks.len();
    // Votes of a ball may be fewer than those of an occluder's edge, but not by far.
    let floor = 0.3 * highest(sums);
    for y in 1..height - 1 {
        let row = y * width;
        // Most rows have no peak.
        if highest(&sums[row..row + width]) <= floor {
            continue;
        }
        for x in 1..width - 1 {
            let here = sums[row + x];
            let full = peaks.len() - first >= PEAKS;
            if here <= floor || (full && here <= peaks[peaks.len() - 1].2) {
                continue;
            }
            let around = [row + x - 1, row + x + 1, row + x - width, row + x + width];
            if around.iter().any(|&i| sums[i] > here) {
                continue;
            }
            insert_peak(peaks, first, (x as f32, y as f32, here));
        }
    }
}

/// Keeps `peaks[first..]` sorted, distinct and no longer than [`PEAKS`].
fn insert_peak(peaks: &mut Vec<(f32, f32, f32)>, first: usize, peak: (f32, f32, f32)) {
    let near = |p: &(f32, f32, f32)| (p.0 - peak.0).abs() < 3.0 && (p.1 - peak.1).abs() < 3.0;
    if let Some(i) = peaks[first..].iter().position(near) {
        if peaks[first + i].2 >= peak.2 {
            return;
        }
        peaks.remove(first + i);
    }
    let at = peaks[first..].iter().position(|p| p.2 < peak.2).map_or(peaks.len(), |i| first + i);
    peaks.insert(at, peak);
    peaks.truncate(first + PEAKS);
}
