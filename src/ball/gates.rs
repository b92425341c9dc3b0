//! Which bins of a rim show the rim, and not speckle or an occluder.

use super::Polarity;
use super::edge::Edge;
use super::rank::{MOST, nth_highest, nth_smallest};

/// Least contrast of an edge, in units of the picture's noise.
const LEAST_CONTRAST: f32 = 8.0;
/// An edge farther from the outline than this belongs to something else, px.
pub(super) const FARTHEST_PX: f32 = 2.5;
/// Bins among which contrasts are compared.
const NEIGHBOURS: usize = 41;
/// Bins from one place where they are compared to the next.
const STRIDE: usize = 4;
/// Rank of the contrast that stands for clean rim among them.
const CLEAN_RANK: f32 = 0.85;
/// Share of the clean contrast that an edge of a brighter ball must reach.
const CLEAN_SHARE: f32 = 0.8;

/// Scratch of the choice.
#[derive(Debug, Default)]
pub(super) struct Gates {
    /// Whether the bin shows the rim.
    pub used: Vec<bool>,
    contrast: Vec<f32>,
    sorted: Vec<f32>,
    /// The contrasts once more, from before the first bin to after the last.
    around: Vec<f32>,
    clean: Vec<f32>,
    /// Bins in which something lies as the rim does.
    pub alike: usize,
    /// Bins in which something lies as a rim of the other sign does.
    pub against: usize,
    /// Whether bins were left out for their contrast.
    pub picks: bool,
}

impl Gates {
    /// Marks the bins to use; returns the picture's noise, grey levels.
    ///
    /// With `again`, what stands for clean rim is what it was when the same bins were looked at last.
    pub fn choose(&mut self, edges: &[Edge], polarity: Polarity, (again, is_lined): (bool, bool)) -> f32 {
        let noise = self.noise(edges);
        let sign = match polarity {
            Polarity::Brighter => 1.0,
            Polarity::Darker => -1.0,
        };
        self.contrast.clear();
        self.contrast.extend(edges.iter().map(|e| sign * e.contrast));
        self.used.clear();
        let contrast = &self.contrast;
        let least = LEAST_CONTRAST * noise;
        let near = || edges.iter().zip(contrast).map(|(e, &c)| (c, e.shift.abs() < FARTHEST_PX));
        self.used.extend(near().map(|(c, is_near)| c > least && is_near));
        self.against = near().map(|(c, is_near)| usize::from(c < -least && is_near)).sum();
        // On a darker ball speckle and paint are both darker than the ground and both good edges;
        // on a brighter one the dark speckle has the wrong contrast or little of it.
        self.alike = self.used.iter().filter(|used| **used).count();
        self.picks = polarity == Polarity::Brighter && !is_lined;
        if self.picks {
            if !again || self.clean.len() != self.used.len().div_ceil(STRIDE) {
                self.look_for_clean_rim();
            }
            self.drop_speckle();
        }
        noise
    }

    /// The lower quartile of what the steps leave unexplained: bins without texture see noise alone.
    fn noise(&mut self, edges: &[Edge]) -> f32 {
        self.sorted.clear();
        self.sorted.extend(edges.iter().filter(|e| e.contrast.abs() > 0.0).map(|e| e.rms));
        if self.sorted.is_empty() {
            return f32::INFINITY;
        }
        let rank = self.sorted.len() / 4;
        // Rounding to whole grey levels is noise, too.
        nth_smallest(&mut self.sorted, rank).max(0.3)
    }

    /// The contrast of clean rim all around.
    fn look_for_clean_rim(&mut self) {
        let bins = self.used.len();
        let reach = NEIGHBOURS.min(bins) / 2;
        // What is not used is lower than all that is.
        self.around.clear();
        self.around.extend(
            (0..bins + 2 * reach)
                .map(|place| (place + bins - reach) % bins)
                .map(|bin| if self.used[bin] { self.contrast[bin] } else { f32::NEG_INFINITY }),
        );
        self.clean.clear();
        for first in (0..bins).step_by(STRIDE) {
            let mut near = [f32::NEG_INFINITY; MOST];
            near[..=2 * reach].copy_from_slice(&self.around[first..=first + 2 * reach]);
            let count = near.iter().filter(|contrast| **contrast > f32::NEG_INFINITY).count();
            let rank = (count.saturating_sub(1) as f32 * CLEAN_RANK).round() as usize;
            self.clean.push(if count > 0 { nth_highest(&near, (count - rank) as u32) } else { 0.0 });
        }
    }

    fn drop_speckle(&mut self) {
        for bin in 0..self.used.len() {
            let nearest = ((bin + STRIDE / 2) / STRIDE) % self.clean.len();
            self.used[bin] &= self.contrast[bin] > CLEAN_SHARE * self.clean[nearest];
        }
    }
}

const _: () = assert!(NEIGHBOURS <= MOST);
