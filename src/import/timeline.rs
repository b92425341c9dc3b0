//! The number and the time of each stored frame.
//!
//! If a file stores the time of each frame, these times decide: a gap between them is a number of missing frames, and a
//! rate of the header that they contradict is named in a warning and not used. Where it stores none, frames follow each
//! other at the rate of the header or of the user.

use super::rate::{Rate, RateSource};
use crate::numeric::quantile;

/// Relative difference of two rates that contradict each other.
const MAX_RATE_DEVIATION: f64 = 0.01;
/// Distance of a frame's time from the grid of a constant rate, in periods, at which it is off the grid: half way to
/// where it might count as its neighbour.
const MAX_GRID_DISTANCE_PERIODS: f64 = 0.25;
/// Share of frames off the grid above which there is no grid, and no number of missing frames.
const MAX_OFF_GRID_SHARE: f64 = 0.1;
/// Distance from the grid, in median distances, at which a frame does not belong to it.
const MAX_MEDIAN_DISTANCES: f64 = 4.0;
/// Number of equal long intervals in a row that is another rate, and no gaps.
const MIN_EQUAL_INTERVALS: usize = 4;

/// Frames that are missing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Gaps {
    /// Number of missing frames.
    pub(super) missing: u64,
    /// Number of places.
    pub(super) places: u64,
}

/// A frame's number, with missing ones counted, and its time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Slot {
    pub(super) number: u64,
    /// ns since the Unix epoch, or since the first frame where the file has no date.
    pub(super) stamp_ns: u64,
}

/// The number and the time of each stored frame.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Timeline {
    /// Nominal rate, frames per second.
    pub(super) rate_hz: f64,
    /// Source of the rate.
    pub(super) source: RateSource,
    /// Time of frame 0, ns.
    pub(super) first_ns: u64,
    pub(super) slots: Slots,
}

/// The numbers and the times of frames.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Slots {
    /// One after the other at a constant rate.
    Consecutive,
    /// At a constant rate, with these numbers.
    Numbered(Vec<u64>),
    /// With these numbers and times since the first, ns.
    Timed(Vec<(u64, u64)>),
}

impl Timeline {
    /// Returns the timeline of frames that follow each other without gaps, from 0 ns on.
    pub(super) fn consecutive(rate: Rate) -> Self {
        Self { rate_hz: rate.hz, source: rate.source, first_ns: 0, slots: Slots::Consecutive }
    }

    /// Returns the timeline of frames with rising numbers at a constant rate.
    pub(super) fn numbered(rate: Rate, numbers: Vec<u64>) -> Self {
        Self { slots: Slots::Numbered(numbers), ..Self::consecutive(rate) }
    }

    /// Returns the same frames with frame 0 at a known time, ns since the Unix epoch; a negative time counts as 0.
    pub(super) fn starting_at(self, first_ns: i64) -> Self {
        Self { first_ns: first_ns.max(0) as u64, ..self }
    }

    /// Returns the number and the time of the stored frame `index`, from 0. Frames beyond the last known one follow it
    /// at the nominal rate.
    pub(super) fn slot(&self, index: u64) -> Slot {
        let period_ns = 1e9 / self.rate_hz;
        let beyond = |length: usize| index.saturating_sub(length as u64 - 1);
        let at = |slots: usize| (index as usize).min(slots - 1);
        let (number, since_ns) = match &self.slots {
            Slots::Numbered(numbers) if !numbers.is_empty() => {
                let number = numbers[at(numbers.len())] + beyond(numbers.len());
                (number, number as f64 * period_ns)
            }
            Slots::Timed(slots) if !slots.is_empty() => {
                let (number, since_ns) = slots[at(slots.len())];
                (number + beyond(slots.len()), since_ns as f64 + beyond(slots.len()) as f64 * period_ns)
            }
            _ => (index, index as f64 * period_ns),
        };
        Slot { number, stamp_ns: self.first_ns.saturating_add(since_ns.round() as u64) }
    }

    /// Counts the missing frames between the stored ones, and the places where they are missing.
    pub(super) fn gaps(&self) -> Gaps {
        let numbers: Vec<u64> = match &self.slots {
            Slots::Consecutive => return Gaps::default(),
            Slots::Numbered(numbers) => numbers.clone(),
            Slots::Timed(slots) => slots.iter().map(|(number, _)| *number).collect(),
        };
        let missing = numbers.windows(2).map(|pair| pair[1].saturating_sub(pair[0]).saturating_sub(1));
        missing
            .filter(|missing| *missing > 0)
            .fold(Gaps::default(), |gaps, missing| Gaps { missing: gaps.missing + missing, places: gaps.places + 1 })
    }
}

/// The times that a file stores with its frames.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FrameTimes {
    /// Time of each stored frame, ns, in the order of the frames.
    pub(super) times_ns: Vec<i64>,
    /// Resolution of the times, ns.
    pub(super) resolution_ns: f64,
}

/// The grid of a constant rate that the times of frames lie on.
struct Grid {
    period_ns: f64,
    /// Time of number 0, ns after the first frame.
    start_ns: f64,
    /// Number of each frame; rising.
    numbers: Vec<u64>,
}

impl Grid {
    /// Whether frames follow each other in several equal steps of more than one period. Gaps are not that regular.
    fn changes_rate(&self) -> bool {
        let steps: Vec<u64> = self.numbers.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps.windows(MIN_EQUAL_INTERVALS).any(|run| run[0] > 1 && run.iter().all(|step| *step == run[0]))
    }
}

impl FrameTimes {
    /// Returns the times in another order of the frames, given by their present indices.
    pub(super) fn reordered(&self, order: &[usize]) -> Self {
        Self { times_ns: order.iter().map(|index| self.times_ns[*index]).collect(), ..self.clone() }
    }

    /// Returns the times of the frames played backwards, from the same first time on.
    pub(super) fn reversed(self) -> Self {
        let last = self.times_ns.last().copied().unwrap_or_default();
        let first = self.times_ns.first().copied().unwrap_or_default();
        let times_ns = self.times_ns.iter().rev().map(|time| first.saturating_add(last.saturating_sub(*time)));
        Self { times_ns: times_ns.collect(), ..self }
    }

    /// Numbers the frames by their times, with missing ones counted.
    ///
    /// `header` is the rate that the file states elsewhere, `fps` that of the user, which stretches the times: a film
    /// in slow motion stores the times of playback. Returns the timeline and warnings; `None` where the times do not
    /// rise, or are too coarse to separate frames.
    pub(super) fn timeline(&self, header: Option<Rate>, fps: Option<f64>) -> Option<(Timeline, Vec<String>)> {
        let grid = self.fit_grid()?;
        let mut warnings = Vec::new();
        let header = header.filter(|header| self.agrees_with(&grid, header, &mut warnings));
        let rate_of_times = Rate { hz: 1e9 / grid.period_ns, source: RateSource::FrameTimes };
        // A rate that fits the times as well as their resolution can show is exact where theirs is rounded.
        let rate = header.filter(|header| self.fits(&grid, header.hz)).unwrap_or(rate_of_times);
        let stretch = fps.map_or(1.0, |fps| rate.hz / fps);
        warnings.extend(fps.filter(|fps| (fps / rate.hz - 1.0).abs() > MAX_RATE_DEVIATION).map(|fps| {
            format!("by their own times the frames come at {:.6} frames/s; --fps {fps} stretches these times", rate.hz)
        }));
        let rate = fps.map_or(rate, |hz| Rate { hz, source: RateSource::Option });
        Some((self.place_frames(grid, rate, stretch, &mut warnings), warnings))
    }

    /// Times every frame by itself, with consecutive numbers: the rate is known to change.
    ///
    /// `fps` is the rate of the user at the median interval. `None` where the times do not rise.
    pub(super) fn irregular(&self, fps: Option<f64>) -> Option<(Timeline, Vec<String>)> {
        let median_hz = 1e9 / self.median_ns()?;
        let source = fps.map_or(RateSource::FrameTimes, |_| RateSource::Option);
        let rate = Rate { hz: fps.unwrap_or(median_hz), source };
        let stretch = median_hz / rate.hz;
        let slots = self.since_first_ns().into_iter().enumerate();
        let slots = slots.map(|(index, time)| (index as u64, (time * stretch).round() as u64)).collect();
        Some((Timeline { slots: Slots::Timed(slots), ..Timeline::consecutive(rate) }, Vec::new()))
    }

    /// Returns the intervals between consecutive frames, ns.
    fn steps(&self) -> Vec<i64> {
        self.times_ns.windows(2).map(|pair| pair[1].saturating_sub(pair[0])).collect()
    }

    /// Returns the median interval, ns; `None` where the times do not rise, or are too coarse to separate frames.
    fn median_ns(&self) -> Option<f64> {
        let mut sorted = self.steps();
        sorted.sort_unstable();
        // Gaps make intervals longer, never shorter: of two in the middle, the shorter one counts.
        let median_ns = *sorted.get(sorted.len().saturating_sub(1) / 2)? as f64;
        let is_rising = sorted.first().is_none_or(|least| *least > 0);
        (is_rising && median_ns >= 2.0 * self.resolution_ns).then_some(median_ns)
    }

    /// Fits the grid of a constant rate, from the median interval and by least squares without outliers. `None` where
    /// the times do not rise, or are too coarse.
    fn fit_grid(&self) -> Option<Grid> {
        let (median_ns, steps) = (self.median_ns()?, self.steps());
        let mut numbers = vec![0];
        for step in steps {
            let frames = (step as f64 / median_ns).round().max(1.0) as u64;
            numbers.push(numbers.last()? + frames);
        }
        let times = self.since_first_ns();
        let (mut period_ns, mut start_ns) = fit_line(&numbers, &times)?;
        // Frames off the grid, such as an odd first one, bend the line: it is fitted again without them.
        for _ in 0..2 {
            let off_ns = |index: usize| (times[index] - start_ns - numbers[index] as f64 * period_ns).abs();
            let usual_ns = quantile(&mut (0..times.len()).map(off_ns).collect::<Vec<f64>>(), 0.5)?;
            let limit_ns = (MAX_MEDIAN_DISTANCES * usual_ns).max(1.0);
            let on_grid = (0..times.len()).filter(|index| off_ns(*index) <= limit_ns);
            let (on_numbers, on_times): (Vec<u64>, Vec<f64>) =
                on_grid.map(|index| (numbers[index], times[index])).unzip();
            (period_ns, start_ns) = fit_line(&on_numbers, &on_times).unwrap_or((period_ns, start_ns));
        }
        Some(Grid { period_ns, start_ns, numbers })
    }

    /// Returns the times since the first frame, ns.
    fn since_first_ns(&self) -> Vec<f64> {
        let first = self.times_ns.first().copied().unwrap_or_default();
        self.times_ns.iter().map(|time| time.saturating_sub(first) as f64).collect()
    }

    /// Returns whether a stated rate agrees with that of the grid within [`MAX_RATE_DEVIATION`]. A contradiction with a
    /// header is added to the warnings.
    fn agrees_with(&self, grid: &Grid, header: &Rate, warnings: &mut Vec<String>) -> bool {
        let hz = 1e9 / grid.period_ns;
        let agrees = (header.hz / hz - 1.0).abs() < MAX_RATE_DEVIATION;
        if !agrees {
            let RateSource::Header(field) = &header.source else { return false };
            warnings.push(format!(
                "{field} says {} frames/s, but the frames are {:.3} us apart: {hz:.3} frames/s by their own times is used",
                header.hz,
                grid.period_ns / 1e3,
            ));
        }
        agrees
    }

    /// Whether a rate, Hz, places every frame of the grid within the resolution of the times, or within 1 ns.
    fn fits(&self, grid: &Grid, hz: f64) -> bool {
        let last = grid.numbers.last().copied().unwrap_or_default() as f64;
        (last * (1e9 / hz - grid.period_ns)).abs() <= self.resolution_ns.max(1.0)
    }

    /// Places the frames: at a constant rate if they lie on the grid, with their own times otherwise.
    ///
    /// `stretch` multiplies the times. Frames of an irregular film have consecutive numbers.
    fn place_frames(&self, grid: Grid, rate: Rate, stretch: f64, warnings: &mut Vec<String>) -> Timeline {
        let times = self.since_first_ns();
        let off_ns = |index: usize| times[index] - grid.start_ns - grid.numbers[index] as f64 * grid.period_ns;
        let worst_ns = (0..times.len()).map(|index| off_ns(index).abs()).fold(0.0, f64::max);
        let off_grid =
            (0..times.len()).filter(|index| off_ns(*index).abs() > MAX_GRID_DISTANCE_PERIODS * grid.period_ns).count();
        let consecutive = Timeline::consecutive(rate.clone());
        if worst_ns <= self.resolution_ns.max(1.0) && !grid.changes_rate() {
            return match grid.numbers.last().is_some_and(|last| *last + 1 == times.len() as u64) {
                true => consecutive,
                false => Timeline::numbered(rate, grid.numbers),
            };
        }
        let is_irregular = off_grid as f64 > MAX_OFF_GRID_SHARE * times.len() as f64 || grid.changes_rate();
        if off_grid > 0 || grid.changes_rate() {
            let all = times.len();
            warnings.push(format!(
                "the rate varies: {off_grid} of {all} frames lie off a constant rate; each keeps its own time"
            ));
        }
        let number = |index: usize| if is_irregular { index as u64 } else { grid.numbers[index] };
        // Times that are on the grid within their resolution are exact there.
        let time_ns = |index: usize| match off_ns(index).abs() <= self.resolution_ns {
            true => (times[index] - off_ns(index)).max(0.0),
            false => times[index],
        };
        let slots = (0..times.len()).map(|index| (number(index), (time_ns(index) * stretch).round() as u64));
        Timeline { slots: Slots::Timed(slots.collect()), ..consecutive }
    }
}

/// Fits a line through times (ns) over numbers by least squares; returns its slope and its value at 0.
///
/// The slope is in ns per number, the value in ns. `None` when the slope is not positive and finite.
fn fit_line(numbers: &[u64], times: &[f64]) -> Option<(f64, f64)> {
    let count = numbers.len() as f64;
    let mean_number = numbers.iter().map(|number| *number as f64).sum::<f64>() / count;
    let mean_time = times.iter().sum::<f64>() / count;
    let offsets = || numbers.iter().map(|number| *number as f64 - mean_number);
    let spread: f64 = offsets().map(|offset| offset * offset).sum();
    let slope = offsets().zip(times).map(|(offset, time)| offset * (time - mean_time)).sum::<f64>() / spread;
    (slope.is_finite() && slope > 0.0).then_some((slope, mean_time - slope * mean_number))
}
