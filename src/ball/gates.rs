//! Which bins of a rim show the rim, and not speckle or an occluder.

use super::Polarity;
use super::edge::Edge;

/// Least contrast of an edge, in units of the picture's noise.
const LEAST_CONTRAST: f32 = 8.0;
/// An edge farther from the outline than this belongs to something else, px.
const FARTHEST_PX: f32 = 2.5;
/// Bins among which contrasts are compared.
const NEIGHBOURS: usize = 41;
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
}

impl Gates {
    /// Marks the bins to use; returns the picture's noise, grey levels.
    pub fn choose(&mut self, edges: &[Edge], polarity: Polarity) -> f32 {
        let noise = self.noise(edges);
        let sign = match polarity {
            Polarity::Brighter => 1.0,
            Polarity::Darker => -1.0,
        };
        self.contrast.clear();
        self.contrast.extend(edges.iter().map(|e| sign * e.contrast));
        self.used.clear();
        let contrast = &self.contrast;
        self.used.extend(
            edges.iter().zip(contrast).map(|(e, &c)| c > LEAST_CONTRAST * noise && e.shift.abs() < FARTHEST_PX),
        );
        // On a darker ball speckle and paint are both darker than the ground and both good edges;
        // on a brighter one the dark speckle has the wrong contrast or little of it.
        if polarity == Polarity::Brighter {
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
        self.sorted.select_nth_unstable_by(rank, f32::total_cmp).1.max(0.3)
    }

    fn drop_speckle(&mut self) {
        let bins = self.used.len();
        let reach = NEIGHBOURS.min(bins) / 2;
        let stride = 4;
        let mut clean = Vec::with_capacity(bins.div_ceil(stride));
        for middle in (0..bins).step_by(stride) {
            self.sorted.clear();
            for step in 0..=2 * reach {
                let bin = (middle + bins + step - reach) % bins;
                if self.used[bin] {
                    self.sorted.push(self.contrast[bin]);
                }
            }
            if self.sorted.is_empty() {
                clean.push(0.0);
                continue;
            }
            let rank = ((self.sorted.len() - 1) as f32 * CLEAN_RANK).round() as usize;
            clean.push(*self.sorted.select_nth_unstable_by(rank, f32::total_cmp).1);
        }
        for bin in 0..bins {
            let nearest = ((bin + stride / 2) / stride) % clean.len();
            self.used[bin] &= self.contrast[bin] > CLEAN_SHARE * clean[nearest];
        }
    }
}
