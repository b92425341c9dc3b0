//! Patches whose image looks the same again after a part of a turn.

/// The maximum gap over which the last rotation predicts an angle, frames.
const MAX_GAP_FRAMES: u64 = 8;
/// The smallest part of a turn after which a patch may look the same again, deg: an image with more parts is a blur.
const MIN_REPEAT_DEG: f64 = 3.0;
/// The number of standard uncertainties from which the angle of a patch contradicts its last step.
const CONTRADICTION_SIGMAS: f64 = 8.0;

/// The part of a turn by which the angle of a patch was taken wrong, because it looks the same again after that part.
///
/// A block searches the angle from the start. The step into it, which was followed from frame to frame, decides.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PatchRepeat {
    offset_deg: f64,
    pub(super) variance_deg2: f64,
    /// The component of the angle. Where steps are missing, an image that has repeated itself begins another.
    pub(super) turn: u32,
    /// The angle to which the last step leads.
    pub(super) expected: Option<ExpectedAngle>,
}

/// The angle to which a step leads.
#[derive(Debug, Clone, Copy)]
pub(super) struct ExpectedAngle {
    pub(super) frame: u64,
    pub(super) angle_deg: f64,
    pub(super) variance_deg2: f64,
    /// The rotation per frame of the step, and its variance.
    pub(super) rate_deg: f64,
    pub(super) rate_variance_deg2: f64,
}

impl ExpectedAngle {
    /// Returns the shortest rotation from an angle found in a later frame to the expected one, deg, and its variance.
    fn minus(&self, frame: u64, found_deg: f64, sigma_deg: f64) -> (f64, f64) {
        let gap = (frame - self.frame) as f64;
        let apart_deg = self.angle_deg + gap * self.rate_deg - found_deg;
        let variance = self.variance_deg2 + gap * gap * self.rate_variance_deg2 + sigma_deg.powi(2);
        (apart_deg - 360.0 * (apart_deg / 360.0).round(), variance)
    }
}

impl PatchRepeat {
    /// Returns the angle found in a frame, deg, turned on to where the last step leads.
    pub(super) fn continued(&mut self, frame: u64, angle_deg: f64, sigma_deg: f64) -> f64 {
        let found_deg = angle_deg + self.offset_deg;
        let last = self.expected.filter(|last| (last.frame..=last.frame + MAX_GAP_FRAMES).contains(&frame));
        let apart = last.map(|last| (last, last.minus(frame, found_deg, sigma_deg)));
        let is_repeated = |apart_deg: f64, variance: f64| {
            apart_deg.abs() >= MIN_REPEAT_DEG && apart_deg.abs() >= CONTRADICTION_SIGMAS * variance.sqrt()
        };
        let (apart_deg, variance) = match apart {
            Some((last, (apart_deg, variance))) if last.frame == frame => (apart_deg, variance),
            across => {
                let is_elsewhere = across.is_some_and(|(_, (apart_deg, variance))| is_repeated(apart_deg, variance));
                if self.offset_deg.abs() > 0.0 || is_elsewhere {
                    (self.turn, self.variance_deg2) = (self.turn + 1, f64::INFINITY);
                }
                return found_deg;
            }
        };
        if !is_repeated(apart_deg, variance) {
            return found_deg;
        }
        self.offset_deg += apart_deg;
        self.variance_deg2 += variance;
        found_deg + apart_deg
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_that_repeats_itself_across_a_gap_begins_another_turn() {
        for (found_deg, turn) in [(-20.0, 0), (25.0, 1)] {
            let last = ExpectedAngle {
                frame: 5,
                angle_deg: -5.0,
                variance_deg2: 1e-4,
                rate_deg: -5.0,
                rate_variance_deg2: 1e-4,
            };
            let mut repeat = PatchRepeat { expected: Some(last), ..PatchRepeat::default() };
            assert!((repeat.continued(8, found_deg, 0.01) - found_deg).abs() < 1e-12);
            assert_eq!((repeat.turn, repeat.variance_deg2.is_infinite()), (turn, turn == 1));
        }
    }
}
