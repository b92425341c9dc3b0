//! Cumulative sums of additional quantities of steps.

use std::collections::BTreeMap;
use std::f64::consts::FRAC_1_SQRT_2;

use crate::motion::random_walk::subset_walk;
use crate::numeric::Sample;
use crate::results::{BodyStep, Estimate};

/// The number of frames that are always kept: the longest contact that is followed, and the flights around it.
const KEPT: usize = 4608;

/// The sums of N quantities that change with each step, relative to their first value.
///
/// As with poses, the noise of successive steps is that of the frames they share. A sum therefore scatters no more
/// after many steps than after one, except for its random walk. Steps over n frames make n interleaved components.
#[derive(Debug, Clone)]
pub struct CumulativeSums<const N: usize> {
    seen: Vec<[Sample; N]>,
    /// The sums at the ends of steps, by frame.
    arrivals: BTreeMap<u64, [Sample; N]>,
    components: u32,
}

impl<const N: usize> Default for CumulativeSums<N> {
    fn default() -> Self {
        Self { seen: Vec::new(), arrivals: BTreeMap::new(), components: 0 }
    }
}

impl<const N: usize> CumulativeSums<N> {
    /// Adds the next step in frame order, the shortest of its frame: its time in nominal frame periods and the change
    /// of each quantity per frame.
    pub fn push(&mut self, step: &BodyStep, time_frames: f64, change: Option<[Estimate; N]>) {
        self.arrivals = self.arrivals.split_off(&step.frame);
        let arrived = self.arrivals.remove(&step.frame);
        let is_sound = |change: &Estimate| change.value.is_finite() && change.sigma > 0.0 && change.sigma.is_finite();
        let change = change.filter(|change| change.iter().all(is_sound));
        let n = f64::from(step.interval_frames.max(1));
        let sigmas = change.map(|change| change.map(|change| change.sigma * n * FRAC_1_SQRT_2));
        let here = match (arrived, sigmas) {
            (None, None) => return,
            (Some(arrived), _) => arrived.map(|sum| Sample { time_frames, ..sum }),
            (None, Some(sigmas)) => {
                self.components += 1;
                let component = self.components;
                sigmas.map(|sigma| Sample { time_frames, component, value: 0.0, sigma, walk: 0.0 })
            }
        };
        push_bounded(&mut self.seen, here);
        if let (Some(change), Some(sigmas), Some(moved)) = (change, sigmas, &step.motion) {
            let [_, _, left] = subset_walk([n * moved.dx_px, n * moved.dy_px, n * moved.dtheta_deg]);
            let there = |k: usize| Sample {
                value: here[k].value + n * change[k].value,
                sigma: sigmas[k],
                walk: left * sigmas[k],
                ..here[k]
            };
            self.arrivals.insert(step.frame + u64::from(step.interval_frames.max(1)), std::array::from_fn(there));
        }
    }

    /// Returns the sums of all kept frames in order of time.
    pub fn sums(&self) -> &[[Sample; N]] {
        &self.seen
    }

    /// Returns the sums between two times, both included.
    pub fn between(&self, from_frames: f64, to_frames: f64) -> &[[Sample; N]] {
        within(&self.seen, from_frames, to_frames, |sums| sums[0].time_frames)
    }
}

/// Appends to a list in order of time, and drops its oldest half once it holds twice [`KEPT`] elements.
pub(super) fn push_bounded<T>(list: &mut Vec<T>, new: T) {
    if list.len() >= 2 * KEPT {
        list.drain(..KEPT);
    }
    list.push(new);
}

/// Returns the elements of a list in order of time between two times, both included, frames.
pub(super) fn within<T>(list: &[T], from_frames: f64, to_frames: f64, time_frames: impl Fn(&T) -> f64) -> &[T] {
    let first = partition_point(list, |element| time_frames(element) < from_frames);
    let end = partition_point(list, |element| time_frames(element) <= to_frames);
    list.get(first..end).unwrap_or_default()
}

/// Returns the index of the first element of a sorted list that is not `before`, like that of slices.
///
/// The search starts at the end, near which most of these moments are: the lists are longer than the caches.
pub(super) fn partition_point<T>(list: &[T], before: impl Fn(&T) -> bool) -> usize {
    let mut reach = 16;
    while reach < list.len() && !before(&list[list.len() - reach]) {
        reach *= 2;
    }
    let first = list.len().saturating_sub(reach);
    first + list[first..].partition_point(before)
}
