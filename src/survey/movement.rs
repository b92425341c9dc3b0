//! Movement in a film: the difference of each sample from the background.

use super::components::{Component, Mask};
use super::sampler::{ReducedImage, SampledFrame, Sampler, reduce_image};
use crate::image::ImageView;
use crate::numeric::median;

/// The number of standard deviations of noise from which a difference is a motion.
const SIGNIFICANT_SIGMAS: f32 = 6.0;
/// The minimum difference that is a motion, as a fraction of the range of grey levels in the background. Compressed
/// films have less noise than this between their key frames, and more at them.
const MIN_CONTRAST: f32 = 0.03;
/// The minimum area of a region that may be a body, reduced pixels.
const MIN_REGION_PIXELS: usize = 6;
/// Half of the maximum distance of marked pixels that belong together, reduced pixels. A speckled body differs in
/// patches.
const JOIN_REACH: usize = 2;
/// The share of the image above which everything moves: the camera does, or the light.
const EVERYWHERE_FRACTION: f64 = 0.5;
/// The minimum number of samples in which a mover differs from the background.
const MIN_APPEARANCES: usize = 3;
/// The maximum number of movers, the largest first.
const MAX_MOVERS: usize = 4;

/// The things that move in a film.
#[derive(Debug, Clone)]
pub struct Movement {
    /// The median of the samples in time.
    pub background: ReducedImage,
    /// The number of pixels that a reduced one averages, along each side.
    pub factor: usize,
    /// The standard deviation of the difference between two samples where nothing moves, DN.
    pub noise_dn: f32,
    /// The difference from the background from which a pixel moves, DN.
    pub threshold_dn: f32,
    /// The pixels of the background over which something moves, row-major.
    pub swept: Vec<bool>,
    /// The share of the image over which something moves.
    pub swept_fraction: f64,
    /// Whether the camera or the light moves rather than a body.
    pub is_everywhere: bool,
    /// The things that move, the one that sweeps the largest area first.
    pub movers: Vec<Mover>,
}

/// Something that moves.
#[derive(Debug, Clone, PartialEq)]
pub struct Mover {
    /// The region that it sweeps: x, y, width, height, px.
    pub bounds_px: [u32; 4],
    /// The frames in which it differs from the background, in the order of the film.
    pub appearances: Vec<Appearance>,
}

/// The difference of one frame from the background.
#[derive(Debug, Clone, PartialEq)]
pub struct Appearance {
    /// The number of the frame in the film, from 0.
    pub index: u64,
    /// The region: x, y, width, height, px.
    pub bounds_px: [u32; 4],
    /// The area that differs, px^2.
    pub area_px2: f64,
    /// The largest connected part of that area, as the corners of its convex hull, px.
    pub hull_px: Vec<[f64; 2]>,
}

impl Mover {
    /// Returns this mover merged with another: the region of both and all their appearances.
    #[must_use]
    pub fn merged_with(&self, other: &Self) -> Self {
        let [a, b] = [self.bounds_px, other.bounds_px];
        let (left, top) = (a[0].min(b[0]), a[1].min(b[1]));
        let (right, bottom) = ((a[0] + a[2]).max(b[0] + b[2]), (a[1] + a[3]).max(b[1] + b[3]));
        let mut appearances = [self.appearances.clone(), other.appearances.clone()].concat();
        appearances.sort_by_key(|appearance| appearance.index);
        Self { bounds_px: [left, top, right - left, bottom - top], appearances }
    }
}

impl Movement {
    /// Returns whether each reduced pixel of a frame differs from the background by more than the threshold, row-major.
    pub fn moving_pixels(&self, image: ImageView<'_>) -> Vec<bool> {
        let difference = absolute_difference(&reduce_image(image, self.factor), &self.background);
        difference.iter().map(|difference| *difference > self.threshold_dn).collect()
    }
}

impl Sampler {
    /// Detects what moves, by the difference of each sample from the median of all; `None` for fewer than three
    /// samples.
    pub fn detect_movement(&self) -> Option<Movement> {
        if self.frames.len() < 3 {
            return None;
        }
        let background = median_in_time(&self.frames);
        let differences: Vec<Vec<f32>> =
            self.frames.iter().map(|frame| absolute_difference(&frame.image, &background)).collect();
        let noise_dn = noise_dn(&differences);
        let threshold_dn = motion_threshold_dn(&background, noise_dn);
        let (width, height) = (background.width, background.height);
        let masks: Vec<Mask> = differences
            .iter()
            .map(|difference| Mask { marked: difference.iter().map(|d| *d > threshold_dn).collect(), width, height })
            .map(|mask| remove_small_regions(&mask.closed(JOIN_REACH)))
            .collect();
        let swept = union(&masks);
        let swept_fraction = swept.marked.iter().filter(|swept| **swept).count() as f64 / swept.marked.len() as f64;
        let regions = group_regions(swept.closed(JOIN_REACH).components(), &masks);
        let movers = regions.iter().take(MAX_MOVERS).map(|region| self.mover(region, &masks)).collect();
        Some(Movement {
            background,
            factor: self.factor(),
            noise_dn,
            threshold_dn,
            swept: swept.marked,
            swept_fraction,
            is_everywhere: swept_fraction > EVERYWHERE_FRACTION,
            movers,
        })
    }

    /// Returns the mover within a swept region: the samples in which something there differs from the background.
    ///
    /// `masks` has the pixels that differ, one mask per sample.
    fn mover(&self, region: &Component, masks: &[Mask]) -> Mover {
        let mut is_inside = vec![false; masks[0].marked.len()];
        region.pixels.iter().for_each(|at| is_inside[*at] = true);
        let appearance = |(frame, mask): (&SampledFrame, &Mask)| {
            let marked = mask.marked.iter().zip(&is_inside).map(|(marked, inside)| *marked && *inside).collect();
            let parts = Mask { marked, ..*mask }.components();
            let largest = parts.first()?;
            let bounds = parts.iter().map(|part| part.bounds).reduce(united_bounds)?;
            let area = parts.iter().map(|part| part.pixels.len()).sum::<usize>();
            Some(Appearance {
                index: frame.index,
                bounds_px: self.to_full_px(bounds),
                area_px2: (area * self.factor() * self.factor()) as f64,
                hull_px: self.hull_px(largest, mask.width),
            })
        };
        let appearances = self.frames.iter().zip(masks).filter_map(appearance).collect();
        Mover { bounds_px: self.to_full_px(region.bounds), appearances }
    }

    /// Converts bounds in a reduced image (left, top, and one past right and bottom) to x, y, width, height in the
    /// frame, px.
    fn to_full_px(&self, bounds: [usize; 4]) -> [u32; 4] {
        let [left, top, right, bottom] = bounds;
        let factor = self.factor();
        let [width, height] = self.size_px();
        let (x, y) = (left * factor, top * factor);
        let (right, bottom) = ((right * factor).min(width), (bottom * factor).min(height));
        [x, y, right - x, bottom - y].map(|number| number as u32)
    }

    /// Returns the convex hull of the centres of a region's reduced pixels, in px of the frame. `width` is that of the
    /// reduced image.
    ///
    /// It is A. M. Andrew's monotone chain (1979, doi:10.1016/0020-0190(79)90072-3).
    fn hull_px(&self, region: &Component, width: usize) -> Vec<[f64; 2]> {
        let factor = self.factor() as f64;
        let place = |at: &usize| [(at % width) as f64, (at / width) as f64];
        let mut points: Vec<[f64; 2]> = region.pixels.iter().map(place).collect();
        points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        let turns_left =
            |o: [f64; 2], a: [f64; 2], b: [f64; 2]| (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]) > 0.0;
        let chain = |points: &mut dyn Iterator<Item = [f64; 2]>| {
            let mut chain: Vec<[f64; 2]> = Vec::new();
            for point in points {
                while chain.len() >= 2 && !turns_left(chain[chain.len() - 2], chain[chain.len() - 1], point) {
                    chain.pop();
                }
                chain.push(point);
            }
            chain.pop();
            chain
        };
        let mut hull = chain(&mut points.iter().copied());
        hull.extend(chain(&mut points.iter().rev().copied()));
        hull.iter().map(|[x, y]| [(x + 0.5) * factor - 0.5, (y + 0.5) * factor - 0.5]).collect()
    }
}

/// Returns the difference from the background from which a pixel moves, DN, at this noise, DN.
fn motion_threshold_dn(background: &ReducedImage, noise_dn: f32) -> f32 {
    let low = background.levels_dn.iter().copied().fold(f32::INFINITY, f32::min);
    let high = background.levels_dn.iter().copied().fold(0.0, f32::max);
    (SIGNIFICANT_SIGMAS * noise_dn).max(MIN_CONTRAST * (high - low)).max(1.0)
}

/// Returns the mask of the pixels that any of the masks marks. Panics without a mask.
fn union(masks: &[Mask]) -> Mask {
    let mut marked = vec![false; masks[0].marked.len()];
    for mask in masks {
        marked.iter_mut().zip(&mask.marked).for_each(|(marked, other)| *marked |= other);
    }
    Mask { marked, ..masks[0] }
}

/// Returns the bounds of two regions together: left, top, and one past right and bottom.
fn united_bounds(a: [usize; 4], b: [usize; 4]) -> [usize; 4] {
    [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]
}

/// Groups swept regions into movers and returns them, the largest first. `masks` has the pixels that differ, one mask
/// per sample.
///
/// A region that differs in fewer than [`MIN_APPEARANCES`] samples is one station of something fast. All of them belong
/// to one mover. Without that many samples together they are artefacts of compression.
fn group_regions(regions: Vec<Component>, masks: &[Mask]) -> Vec<Component> {
    let mut region_of = vec![usize::MAX; masks[0].marked.len()];
    for (number, region) in regions.iter().enumerate() {
        region.pixels.iter().for_each(|at| region_of[*at] = number);
    }
    let mut seen = vec![Vec::new(); regions.len()];
    for (sample, mask) in masks.iter().enumerate() {
        let marked = region_of.iter().zip(&mask.marked).filter(|(_, marked)| **marked);
        for (region, _) in marked.filter(|(region, _)| **region != usize::MAX) {
            let samples: &mut Vec<usize> = &mut seen[*region];
            if samples.last() != Some(&sample) {
                samples.push(sample);
            }
        }
    }
    let (mut movers, mut stations, mut visited) = (Vec::new(), Vec::new(), Vec::new());
    for (region, samples) in regions.into_iter().zip(seen) {
        if samples.len() >= MIN_APPEARANCES {
            movers.push(region);
        } else {
            stations.push(region);
            visited.extend(samples);
        }
    }
    visited.sort_unstable();
    visited.dedup();
    let bounds = stations.iter().map(|station| station.bounds).reduce(united_bounds);
    if let Some(bounds) = bounds.filter(|_| visited.len() >= MIN_APPEARANCES) {
        let mut pixels: Vec<usize> = stations.into_iter().flat_map(|station| station.pixels).collect();
        pixels.sort_unstable();
        movers.push(Component { pixels, bounds });
    }
    movers.sort_by_key(|mover| std::cmp::Reverse(mover.pixels.len()));
    movers
}

/// Returns a mask without the regions of fewer than [`MIN_REGION_PIXELS`] pixels, which are too small to be a body.
fn remove_small_regions(mask: &Mask) -> Mask {
    let mut marked = vec![false; mask.marked.len()];
    let components = mask.components();
    let kept = components.iter().filter(|component| component.pixels.len() >= MIN_REGION_PIXELS);
    kept.flat_map(|component| &component.pixels).for_each(|at| marked[*at] = true);
    Mask { marked, ..*mask }
}

/// Returns the median of each pixel over the samples, DN. Panics without a sample.
fn median_in_time(frames: &[SampledFrame]) -> ReducedImage {
    let first = &frames[0].image;
    let mut values = vec![0.0; frames.len()];
    let median = |at: usize| {
        values.iter_mut().zip(frames).for_each(|(value, frame)| *value = frame.image.levels_dn[at]);
        median(&mut values).unwrap_or(0.0)
    };
    ReducedImage { levels_dn: (0..first.levels_dn.len()).map(median).collect(), ..*first }
}

/// Returns the absolute difference of each pixel from the background, DN, after the median difference is removed.
fn absolute_difference(image: &ReducedImage, background: &ReducedImage) -> Vec<f32> {
    let pairs = || image.levels_dn.iter().zip(&background.levels_dn);
    let offset_dn = median(&mut pairs().map(|(level, still)| level - still).collect::<Vec<f32>>()).unwrap_or(0.0);
    pairs().map(|(level, still)| (level - still - offset_dn).abs()).collect()
}

/// Estimates the standard deviation of normally distributed noise in the differences, DN, from the median over the
/// samples of their medians over the pixels. Moving bodies do not affect it.
fn noise_dn(differences: &[Vec<f32>]) -> f32 {
    // The median of the absolute values of a normal distribution, in standard deviations.
    const MEDIAN_SIGMAS: f32 = 0.6745;
    let mut medians: Vec<f32> = differences.iter().filter_map(|difference| median(&mut difference.clone())).collect();
    median(&mut medians).unwrap_or(0.0) / MEDIAN_SIGMAS
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::ImageView;

    /// Samples a dark image with noise in which a bright square moves by 3 px per frame.
    fn sampled(side: usize, count: u64) -> Sampler {
        let mut sampler = Sampler::new(100, 60, count);
        for index in 0..count {
            let noise = |at: usize| (crate::numeric::scramble(at as u64 + 6000 * index) % 5) as f32;
            let mut data: Vec<f32> = (0..6000).map(|at| 20.0 + noise(at)).collect();
            let left = 5 + 3 * index as usize;
            (30..30 + side).for_each(|y| data[y * 100 + left..y * 100 + left + side].fill(150.0));
            sampler.push(index, ImageView::new(&data, 100, 60).unwrap());
        }
        sampler
    }

    #[test]
    fn a_moving_square_is_found_in_every_frame_and_its_way_is_swept() {
        let movement = sampled(8, 21).detect_movement().unwrap();
        assert!(!movement.is_everywhere && movement.noise_dn < 3.0, "{}", movement.noise_dn);
        assert_eq!(movement.movers.len(), 1);
        let mover = &movement.movers[0];
        assert_eq!((mover.bounds_px, mover.appearances.len()), ([5, 30, 68, 8], 21));
        let third = &mover.appearances[3];
        assert_eq!((third.index, third.bounds_px, third.area_px2), (3, [14, 30, 8, 8], 64.0));
        assert_eq!(third.hull_px, [[14.0, 30.0], [21.0, 30.0], [21.0, 37.0], [14.0, 37.0]]);
    }

    #[test]
    fn stations_of_something_fast_are_one_mover_and_a_single_flash_is_none() {
        let mut sampler = Sampler::new(200, 60, 12);
        for index in 0..12 {
            let mut data = vec![20.0; 12_000];
            // Twice as far apart as it is wide.
            let left = 5 + 16 * index as usize;
            (30..38).for_each(|y| data[y * 200 + left..y * 200 + left + 8].fill(150.0));
            sampler.push(index, ImageView::new(&data, 200, 60).unwrap());
        }
        let movement = sampler.detect_movement().unwrap();
        let movers: Vec<_> = movement.movers.iter().map(|mover| (mover.bounds_px, mover.appearances.len())).collect();
        assert_eq!(movers, [([5, 30, 184, 8], 12)]);
        let mut flash = Sampler::new(64, 64, 9);
        for index in 0..9 {
            let level = if index == 0 { 90.0 } else { 20.0 };
            let data: Vec<f32> = (0..4096).map(|at| if at % 64 < 8 { level } else { 20.0 }).collect();
            flash.push(index, ImageView::new(&data, 64, 64).unwrap());
        }
        assert!(flash.detect_movement().unwrap().movers.is_empty());
    }

    #[test]
    fn nothing_moves_in_noise() {
        let movement = sampled(0, 20).detect_movement().unwrap();
        assert_eq!((movement.movers.len(), movement.swept_fraction), (0, 0.0));
        assert!(sampled(0, 2).detect_movement().is_none());
    }
}
