//! The rim of a ball: sharp, or covered with felt.

use super::blurred_edge::BlurredDisc;
use crate::numeric::Stream;
use std::f64::consts::TAU;

/// The shortest and the longest distance of tufts along the rim, px.
const TUFT_PX: [f64; 2] = [4.0, 16.0];
/// The minimum number of tufts around the rim. Fewer would move its centre or stretch it.
const MIN_TUFTS: f64 = 5.0;
/// The parts of the felt that are a transparent edge and tufts; the sum of their squares is 1.
const SOFT_EDGE_SHARE: f64 = 0.9;
const TUFT_SHARE: f64 = 0.436;
/// The number of waves that make up the tufts.
const WAVES: usize = 24;

/// The coverage of pixels by a ball.
#[derive(Debug, Clone)]
pub(crate) struct Rim {
    disc: BlurredDisc,
    radius_px: f64,
    sigma_px: f64,
    fuzz_px: f64,
    /// The number of periods around the rim and the phase of each wave of the tufts.
    waves: Vec<(f64, f64)>,
}

impl Rim {
    /// Prepares a rim with felt of `fuzz_px` (0: sharp). `stream` draws the tufts.
    pub(crate) fn new(radius_px: f64, sigma_px: f64, fuzz_px: f64, mut stream: Stream) -> Self {
        let mut wave = || {
            let [short, long] = TUFT_PX.map(|px| TAU * radius_px / px);
            (stream.between(long, short).round().max(MIN_TUFTS), stream.between(0.0, TAU))
        };
        let waves: Vec<_> = if fuzz_px > 0.0 { (0..WAVES).map(|_| wave()).collect() } else { Vec::new() };
        Self::from_waves(radius_px, sigma_px, fuzz_px, waves)
    }

    /// Tabulates the rim. The felt is a softer edge, shifted by the waves of its tufts; without waves the rim is sharp.
    fn from_waves(radius_px: f64, sigma_px: f64, fuzz_px: f64, waves: Vec<(f64, f64)>) -> Self {
        let soft_px = if fuzz_px > 0.0 { sigma_px.hypot(SOFT_EDGE_SHARE * fuzz_px) } else { sigma_px };
        Self { disc: BlurredDisc::new(radius_px, soft_px), radius_px, sigma_px, fuzz_px, waves }
    }

    /// Returns the rim magnified by `zoom`. The blur and the felt (`fuzz_px`) stay as wide in pixels.
    pub(crate) fn zoomed(&self, zoom: f64) -> Self {
        Self::from_waves(zoom * self.radius_px, self.sigma_px, self.fuzz_px, self.waves.clone())
    }

    /// Whether the rim is covered with felt.
    pub(crate) fn is_fuzzy(&self) -> bool {
        !self.waves.is_empty()
    }

    /// The distance from the centre beyond which the ball is neglected, px.
    pub(crate) fn reach_px(&self) -> f64 {
        self.disc.reach_px() + 3.0 * self.fuzz_px
    }

    /// Returns the coverage at a squared distance from the centre and a direction from it, 0 to 1.
    ///
    /// The direction is counter-clockwise from the axis of the ball that pointed to the right before it turned, rad.
    #[inline]
    pub(crate) fn coverage_at(&self, distance_px2: f32, around_rad: impl FnOnce() -> f64) -> f32 {
        if self.waves.is_empty() {
            self.disc.coverage_at(distance_px2)
        } else {
            self.fuzzy_coverage(distance_px2, around_rad)
        }
    }

    /// Returns the coverage by a ball with felt, 0 to 1; see [`coverage_at`](Self::coverage_at).
    fn fuzzy_coverage(&self, distance_px2: f32, around_rad: impl FnOnce() -> f64) -> f32 {
        let distance = f64::from(distance_px2).sqrt();
        if distance < self.radius_px - 4.5 * self.sigma_px.hypot(self.fuzz_px) - 3.0 * self.fuzz_px {
            return 1.0;
        }
        let around = around_rad();
        let waves: f64 = self.waves.iter().map(|(periods, phase)| (periods * around + phase).cos()).sum();
        let tuft_px = TUFT_SHARE * self.fuzz_px * waves * (2.0 / WAVES as f64).sqrt();
        let inside = (distance - tuft_px).max(0.0) as f32;
        self.disc.coverage_at(inside * inside)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(rim: &Rim, place: [f32; 2], angle_rad: f64) -> f32 {
        let [x, y] = place;
        rim.coverage_at(x * x + y * y, || f64::from(-y).atan2(f64::from(x)) - angle_rad)
    }

    #[test]
    fn felt_keeps_centre_and_area_and_turns_with_the_ball() {
        let (sharp, fuzzy) = (Rim::new(30.0, 0.76, 0.0, Stream::new(5)), Rim::new(30.0, 0.76, 1.2, Stream::new(5)));
        let sums = |rim: &Rim, angle_rad: f64| {
            let mut sums = [0.0; 3];
            for y in -40..=40_i16 {
                for x in -40..=40_i16 {
                    let covered = f64::from(at(rim, [f32::from(x), f32::from(y)], angle_rad));
                    let parts = [covered, covered * f64::from(x), covered * f64::from(y)];
                    sums.iter_mut().zip(parts).for_each(|(sum, part)| *sum += part);
                }
            }
            sums
        };
        let (round, felt) = (sums(&sharp, 0.0), sums(&fuzzy, 0.3));
        assert!((felt[0] / round[0] - 1.0).abs() < 5e-3, "{felt:?} {round:?}");
        assert!((felt[1] / felt[0]).hypot(felt[2] / felt[0]) < 0.03, "{felt:?}");
        let quarter = 0.25 * TAU;
        for [x, y] in [[29.5, 3.0], [-20.0, 22.0], [4.0, -30.0]] {
            assert!((at(&fuzzy, [x, y], 0.0) - at(&fuzzy, [y, -x], quarter)).abs() < 1e-5);
        }
        let around: Vec<f32> = (0..60_u8)
            .map(|k| f32::from(k) * 0.1047)
            .map(|a| at(&fuzzy, [30.0 * a.cos(), 30.0 * a.sin()], 0.0))
            .collect();
        let spread = around.iter().fold(0.0_f32, |most, at| most.max((at - around[0]).abs()));
        assert!(spread > 0.1, "{spread}");
    }
}
