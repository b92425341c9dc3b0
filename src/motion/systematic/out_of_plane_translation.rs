//! How the size of a body in the picture changes.

use crate::motion::{PixelRates, Regime, Sums};
use crate::numeric::{Polynomial, Sample};
use crate::results::{BodyStep, Estimate};

/// Fewest frames whose word is taken.
const LEAST_SEEN: usize = 8;
/// Growth of fewer sigmas may be chance.
const CHANCE_SIGMAS: f64 = 2.0;
/// So many frames before and after a moment tell the growth there, in flight.
const BACK: u64 = 40;
const AHEAD: u64 = 14;

/// The size of a body, as the logarithm of what it was first, carried from frame to frame by its steps.
#[derive(Debug, Clone, Default)]
pub struct Growth {
    sizes: Sums<1>,
}

impl Growth {
    /// Takes the next step in frame order, the shortest of its frame, at its time in nominal frame periods.
    pub fn push(&mut self, step: &BodyStep, time_frames: f64) {
        self.sizes.push(step, time_frames, step.growth_fraction.map(|grown| [grown]));
    }

    /// How much larger it is than when it was first seen; `None` where its steps do not lead there.
    fn since_first(&self, time_frames: f64) -> Option<Estimate> {
        let seen = self.sizes.seen();
        let [first] = *seen.first()?;
        let at = seen.partition_point(|[size]| size.time_frames < time_frames);
        let [here] = *seen.get(at).filter(|[here]| here.component == first.component)?;
        let walked = here.walk * (at as f64).sqrt();
        Some(Estimate { value: here.value - first.value, sigma: here.sigma.hypot(first.sigma).hypot(walked) })
    }

    /// By which share it has surely grown since it was first seen: 0 or more.
    pub fn whole(&self) -> f64 {
        let seen = self.sizes.seen();
        let (Some([first]), Some([last])) = (seen.first(), seen.last()) else { return 0.0 };
        let rate = self.rate(first.time_frames, last.time_frames).map(surely);
        rate.map_or(0.0, |rate| (rate.value * (last.time_frames - first.time_frames)).abs())
    }

    /// By which share a frame it grows between two times, both included; `None` where too little is seen.
    pub fn rate(&self, from_frames: f64, to_frames: f64) -> Option<Estimate> {
        let seen: Vec<Sample> = self.sizes.between(from_frames, to_frames).iter().map(|[size]| *size).collect();
        if seen.len() < LEAST_SEEN {
            return None;
        }
        let middle = 0.5 * (seen[0].time_frames + seen[seen.len() - 1].time_frames);
        let fit = Polynomial::fit(&seen, middle, 1, 0.0)?;
        let rate = fit.rate(middle);
        Some(Estimate { value: rate.value, sigma: rate.sigma * fit.excess() })
    }
}

/// Where a body is seen at a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Its frame.
    pub frame: u64,
    /// Its time, nominal frame periods.
    pub time_frames: f64,
    /// From where the camera looks straight ahead, px.
    pub place_px: [f64; 2],
    /// How well that is known, px.
    pub sigma_px: f64,
}

impl Growth {
    /// The rates across the view of a body that comes nearer, or goes away; what is not known of that is in their sigmas.
    ///
    /// A place p in the picture moves by the growth times p as well. How large the picture's scale is where the body is now
    /// is known no better than it has changed since the body was first seen.
    pub fn across(&self, rates: PixelRates, regime: Regime, seen: Seen) -> PixelRates {
        let (from, to) = match regime {
            Regime::Flight { from, to } => (from.max(seen.frame.saturating_sub(BACK)), to.min(seen.frame + AHEAD)),
            // Flattened, it seems to grow.
            Regime::Contact { from, .. } => (from.saturating_sub(BACK + AHEAD), from.saturating_sub(1)),
            Regime::Unknown => (seen.frame.saturating_sub(BACK), seen.frame + AHEAD),
        };
        let time = |frame: u64| seen.time_frames + frame as f64 - seen.frame as f64;
        let told = self.rate(time(from) - 0.5, time(to) + 0.5).map(surely);
        // A flight that has just begun says too little: what was before tells how much there may be of it.
        let before = || {
            let from = seen.frame.saturating_sub(AHEAD);
            let before = self.rate(time(from) - 0.5, time(to) + 0.5).map(surely)?;
            Some(Estimate { value: 0.0, sigma: before.value.hypot(before.sigma) })
        };
        let Some(told) = told.or_else(before) else { return rates };
        let since = self.sizes.seen().first().map_or(0.0, |[first]| seen.time_frames - first.time_frames);
        let already = self.since_first(seen.time_frames).map_or(0.0, |size| surely(size).value);
        let across = |rate: Estimate, place_px: f64| {
            let value = rate.value - told.value * place_px;
            let place = (told.sigma * place_px).hypot(told.value * seen.sigma_px);
            let larger = (told.value.hypot(told.sigma) * since.max((BACK + AHEAD) as f64)).hypot(already);
            Estimate { value, sigma: rate.sigma.hypot(place).hypot(larger * rate.value) }
        };
        let [x, y] = seen.place_px;
        PixelRates { x: across(rates.x, x), y: across(rates.y, y), ..rates }
    }
}

/// Growth as far as it is more than chance, and how well that is known: none within twice its sigma, and ever more of what
/// is seen beyond. Bodies mostly keep their distance, and what is not surely seen is not taken out.
pub fn surely(seen: Estimate) -> Estimate {
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
    use crate::results::{PointStatus, RigidStep};

    fn step(frame: u64, interval_frames: u32, growth: Option<f64>) -> BodyStep {
        BodyStep {
            is_whole: true,
            rim_fraction: None,
            fixed_fraction: None,
            growth_fraction: growth.map(|value| Estimate { value, sigma: 4e-5 / f64::from(interval_frames) }),
            is_carried: false,
            drift: None,
            frame,
            stamp_ns: frame,
            body: 0,
            interval_frames,
            circle: None,
            rod: None,
            step: Some(RigidStep::STILL),
            status: PointStatus::Valid,
        }
    }

    /// Of what is seen of frames whose sizes scatter: the noise of a frame is in the step to it and in that from it.
    fn grown(interval_frames: u32, missing: &[u64]) -> Growth {
        let noise = |frame: u64| 2.8e-5 * ((frame * 37 % 17) as f64 - 8.0) / 5.0;
        let mut growth = Growth::default();
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
        let told = grown(1, &[]).rate(0.0, 59.0).map(surely).unwrap();
        assert!((told.value - 3e-5).abs() < 2e-6, "{told:?}");
    }

    #[test]
    fn what_may_be_chance_is_left_out() {
        let told = |value: f64| surely(Estimate { value, sigma: 1.0 });
        assert!(told(1.9).value.abs() <= 0.0 && told(-2.0).sigma.abs() <= 0.0 && told(0.0).value.abs() <= 0.0);
        assert!((1.0..4.0).contains(&-told(-4.0).value) && (told(50.0).value - 50.0).abs() < 0.1);
        assert!((told(50.0).sigma - 1.0).abs() < 0.01);
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
        let seen = Seen { frame: 30, time_frames: 30.0, place_px: [200.0, -90.0], sigma_px: 5.0 };
        let across = growth.across(rates, Regime::Flight { from: 0, to: u64::MAX }, seen);
        assert!(
            across.x.value.abs() < 3.0 * across.x.sigma && across.y.value.abs() < 3.0 * across.y.sigma,
            "{across:?}"
        );
        assert!(across.x.value.abs() < 5e-4 && across.x.sigma < 1e-3 && across.x.sigma > 1e-4, "{across:?}");
        assert_eq!((across.theta, across.order), (rates.theta, rates.order));
        let steady = Growth::default().across(rates, Regime::Unknown, seen);
        assert_eq!(steady, rates, "nothing is known of its size");
    }
}
