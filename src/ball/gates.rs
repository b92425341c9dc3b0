//! Which bins of a rim show the rim, and not speckle or an occluder.

use super::Polarity;
use super::edge::Edge;

/// Least contrast of an edge, in units of the picture's noise.
const LEAST_CONTRAST: f32 = 8.0;
/// An edge farther from the outline than this belongs to something else, px.
const FARTHEST_PX: f32 = 2.5;
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
    clean: Vec<f32>,
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
        let stride = STRIDE;
        self.clean.clear();
        for middle in (0..bins).step_by(stride) {
            self.sorted.clear();
            let mut bin = (middle + bins - reach) % bins;
            for _ in 0..=2 * reach {
                if self.used[bin] {
                    self.sorted.push(self.contrast[bin]);
                }
                bin = if bin + 1 < bins { bin + 1 } else { 0 };
            }
            let rank = (self.sorted.len().saturating_sub(1) as f32 * CLEAN_RANK).round() as usize;
            self.clean.push(nth_highest(&self.sorted, self.sorted.len() - rank.min(self.sorted.len())));
        }
        for bin in 0..bins {
            let nearest = ((bin + stride / 2) / stride) % self.clean.len();
            self.used[bin] &= self.contrast[bin] > CLEAN_SHARE * self.clean[nearest];
        }
    }
}

/// The `rank`th highest of at most [`NEIGHBOURS`] values, from 1; 0 of none.
///
/// With so few of them the highest are soonest kept in order while they come.
fn nth_highest(values: &[f32], rank: usize) -> f32 {
    let mut highest = [f32::NEG_INFINITY; NEIGHBOURS];
    let highest = &mut highest[..rank.min(NEIGHBOURS)];
    for value in values {
        // Most are not among the highest.
        if highest.last().is_none_or(|least| value <= least) {
            continue;
        }
        let mut value = *value;
        // Every place keeps the higher of two and hands the other on.
        for kept in highest.iter_mut() {
            let (high, low) = if *kept < value { (value, *kept) } else { (*kept, value) };
            (*kept, value) = (high, low);
        }
    }
    highest.last().copied().filter(|_| !values.is_empty()).unwrap_or(0.0)
}
