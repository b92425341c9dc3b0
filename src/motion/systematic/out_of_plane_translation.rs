//! The change of a body's size in the image, caused by motion towards the camera or away from it.

use super::cumulative::partition_point;
use crate::motion::{CumulativeSums, PixelRates, Regime};
use crate::numeric::{Polynomial, Sample};
use crate::results::{BodyStep, Estimate};

/// The minimum number of frames of an estimate.
const MIN_SAMPLES: usize = 8;
/// The minimum significance of a dilatation, sigmas.
const CHANCE_SIGMAS: f64 = 2.0;
/// The half width of the window for the dilatation in flight, frames.
const BACK: u64 = 40;
const AHEAD: u64 = 14;

/// The size of a body as a logarithm relative to its first size, integrated from its steps.
#[derive(Debug, Clone, Default)]
pub struct SizeChange {
    sizes: CumulativeSums<1>,
}

impl SizeChange {
    /// Adds the next step in frame order, the shortest of its frame, at its time in nominal frame periods.
    pub fn push(&mut self, step: &BodyStep, time_frames: f64) {
        self.sizes.push(step, time_frames, step.growth_fraction.map(|grown| [grown]));
    }

    /// Returns the dilatation between the first frame and a time, as a logarithm; `None` where steps do not lead there.
    fn since_first(&self, time_frames: f64) -> Option<Estimate> {
        let sizes = self.sizes.sums();
        let [first] = *sizes.first()?;
        let index = partition_point(sizes, |[size]| size.time_frames < time_frames);
        let [last] = *sizes.get(index).filter(|[last]| last.component == first.component)?;
        let walk = last.walk * (index as f64).sqrt();
        Some(Estimate { value: last.value - first.value, sigma: last.sigma.hypot(first.sigma).hypot(walk) })
    }

    /// Returns the size of the significant dilatation since the first frame, as a logarithm, at least 0.
    pub fn total_dilatation(&self) -> f64 {
        let sizes = self.sizes.sums();
        let (Some([first]), Some([last])) = (sizes.first(), sizes.last()) else { return 0.0 };
        let rate = self.rate(first.time_frames, last.time_frames).map(shrink_insignificant);
        rate.map_or(0.0, |rate| (rate.value * (last.time_frames - first.time_frames)).abs())
    }

    /// Returns the dilatation per frame between two times, both included; `None` where there are too few data.
    pub fn rate(&self, from_frames: f64, to_frames: f64) -> Option<Estimate> {
        let sizes: Vec<Sample> = self.sizes.between(from_frames, to_frames).iter().map(|[size]| *size).collect();
        if sizes.len() < MIN_SAMPLES {
            return None;
        }
        let middle = 0.5 * (sizes[0].time_frames + sizes[sizes.len() - 1].time_frames);
        let fit = Polynomial::fit(&sizes, middle, 1, 0.0)?;
        let rate = fit.rate(middle);
        Some(Estimate { value: rate.value, sigma: rate.sigma * fit.excess() })
    }
}

/// The position of a body at a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewPosition {
    /// Its frame.
    pub frame: u64,
    /// Its time, nominal frame periods.
    pub time_frames: f64,
    /// Position relative to the principal point, px.
    pub place_px: [f64; 2],
    /// Its standard uncertainty, px.
    pub sigma_px: f64,
}

impl SizeChange {
    /// Returns the rates across the view of a body that moves towards the camera or away; the unknown part enters their
    /// sigmas.
    ///
    /// A position p in the image also moves by the dilatation times p. The scale at the body's present distance is no
    /// better known than it has changed since the first frame.
    pub fn across(&self, rates: PixelRates, regime: Regime, seen: ViewPosition) -> PixelRates {
        let (from, to) = match regime {
            Regime::Flight { from, to } => (from.max(seen.frame.saturating_sub(BACK)), to.min(seen.frame + AHEAD)),
            // A flattened ball appears to grow.
            Regime::Contact { from, .. } => (from.saturating_sub(BACK + AHEAD), from.saturating_sub(1)),
            Regime::Unknown => (seen.frame.saturating_sub(BACK), seen.frame + AHEAD),
        };
        let time = |frame: u64| seen.time_frames + frame as f64 - seen.frame as f64;
        let dilatation = self.rate(time(from) - 0.5, time(to) + 0.5).map(shrink_insignificant);
        // A flight that has just begun constrains it too little; the flight before bounds it.
        let before = || {
            let from = seen.frame.saturating_sub(AHEAD);
            let before = self.rate(time(from) - 0.5, time(to) + 0.5).map(shrink_insignificant)?;
            Some(Estimate { value: 0.0, sigma: before.value.hypot(before.sigma) })
        };
        let Some(dilatation) = dilatation.or_else(before) else { return rates };
        let since = self.sizes.sums().first().map_or(0.0, |[first]| seen.time_frames - first.time_frames);
        let already = self.since_first(seen.time_frames).map_or(0.0, |size| shrink_insignificant(size).value);
        let across = |rate: Estimate, place_px: f64| {
            let value = rate.value - dilatation.value * place_px;
            let place = (dilatation.sigma * place_px).hypot(dilatation.value * seen.sigma_px);
            let larger = (dilatation.value.hypot(dilatation.sigma) * since.max((BACK + AHEAD) as f64)).hypot(already);
            Estimate { value, sigma: rate.sigma.hypot(place).hypot(larger * rate.value) }
        };
        let [x, y] = seen.place_px;
        PixelRates { x: across(rates.x, x), y: across(rates.y, y), ..rates }
    }
}

/// Returns the significant part of a dilatation with its uncertainty: zero within twice the sigma, and an increasing
/// part beyond.
///
/// Bodies mostly keep their distance, so an insignificant dilatation is not corrected.
pub fn shrink_insignificant(seen: Estimate) -> Estimate {
    let share = 1.0 - (CHANCE_SIGMAS * seen.sigma / seen.value).powi(2);
    if share > 0.0 {
        Estimate { value: share * seen.value, sigma: share.sqrt() * seen.sigma }
    } else {
        Estimate { value: 0.0, sigma: 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::{MotionMethod, RigidStep};

    fn step(frame: u64, interval_frames: u32, growth: Option<f64>) -> BodyStep {
        BodyStep {
            frame,
            stamp_ns: frame,
            interval_frames,
            motion: Some(RigidStep::STILL),
            method: MotionMethod::WholeBody,
            growth_fraction: growth.map(|value| Estimate { value, sigma: 4e-5 / f64::from(interval_frames) }),
            ..BodyStep::default()
        }
    }

    /// The dilatation measured in frames whose sizes scatter: the noise of a frame is in the step to it and in the step
    /// from it.
    fn grown(interval_frames: u32, missing: &[u64]) -> SizeChange {
        let noise = |frame: u64| 2.8e-5 * ((frame * 37 % 17) as f64 - 8.0) / 5.0;
        let mut growth = SizeChange::default();
        for frame in 0..60 {
            let value = 3e-5 + (noise(frame + u64::from(interval_frames)) - noise(frame)) / f64::from(interval_frames);
            growth.push(&step(frame, interval_frames, (!missing.contains(&frame)).then_some(value)), frame as f64);
        }
        growth
    }

    #[test]
    fn the_noise_of_many_steps_is_that_of_one() {
        for (growth, most) in [(grown(1, &[]), 8e-7), (grown(3, &[]), 8e-7), (grown(1, &[20, 21, 40]), 1.6e-6)] {
            let rate = growth.rate(0.0, 59.0).unwrap();
            assert!((rate.value - 3e-5).abs() < 2.0 * rate.sigma && rate.sigma < 2.0 * most, "{rate:?}");
        }
        assert_eq!(grown(1, &[]).rate(10.0, 14.0), None, "too few");
        let dilatation = grown(1, &[]).rate(0.0, 59.0).map(shrink_insignificant).unwrap();
        assert!((dilatation.value - 3e-5).abs() < 2e-6, "{dilatation:?}");
    }

    #[test]
    fn what_may_be_chance_is_left_out() {
        let dilatation = |value: f64| shrink_insignificant(Estimate { value, sigma: 1.0 });
        assert!(
            dilatation(1.9).value.abs() <= 0.0
                && dilatation(-2.0).sigma.abs() <= 0.0
                && dilatation(0.0).value.abs() <= 0.0
        );
        assert!((1.0..4.0).contains(&-dilatation(-4.0).value) && (dilatation(50.0).value - 50.0).abs() < 0.1);
        assert!((dilatation(50.0).sigma - 1.0).abs() < 0.01);
    }

    #[test]
    fn a_place_that_moves_outwards_by_growth_alone_does_not_move_across_the_view() {
        let growth = grown(1, &[]);
        let still = |value: f64| Estimate { value, sigma: 1e-5 };
        let rates = PixelRates {
            x: still(3e-5 * 200.0),
            y: still(-3e-5 * 90.0),
            theta: still(0.1),
            window_frames: 41,
            order: 1,
        };
        let seen = ViewPosition { frame: 30, time_frames: 30.0, place_px: [200.0, -90.0], sigma_px: 5.0 };
        let across = growth.across(rates, Regime::Flight { from: 0, to: u64::MAX }, seen);
        assert!(
            across.x.value.abs() < 3.0 * across.x.sigma && across.y.value.abs() < 3.0 * across.y.sigma,
            "{across:?}"
        );
        assert!(across.x.value.abs() < 5e-4 && across.x.sigma < 1e-3 && across.x.sigma > 1e-4, "{across:?}");
        assert_eq!((across.theta, across.order), (rates.theta, rates.order));
        let steady = SizeChange::default().across(rates, Regime::Unknown, seen);
        assert_eq!(steady, rates, "nothing is known of its size");
    }
}
