//! Whether the body that was seen can be the one seen before.

use crate::results::{BodyStep, PointStatus};

/// An outline is not further from where the last motion leads than this, px.
const MOST_APART_PX: f64 = 1.5;

/// Nor than so many of its uncertainties.
const MOST_SIGMAS: f64 = 8.0;

/// While nothing is measured a body may get away from its course by this much a frame, px ...
const GAINED_PX: f64 = 1.0;

/// ... and by so many times its speed: it may be thrown back.
const GAINED_SPEEDS: f64 = 2.0;

/// While something else is taken for it, by this much a frame only, px: rather no number than another ball's.
const GAINED_CONFUSED_PX: f64 = 0.1;

/// A body that was gone for so many frames may come back anywhere.
const ABSENT_FRAMES: u32 = 8;

/// One that is seen elsewhere for so many frames on end is the body from now on.
const DOUBTED_FRAMES: u32 = 64;

/// Where a body was believed to be.
#[derive(Debug, Clone, Copy)]
struct Place {
    frame: u64,
    at_px: [f64; 2],
    sigma_px: f64,
    /// Its last motion, px/frame.
    rate_px: [f64; 2],
    /// Whether that motion began in this very frame.
    is_led: bool,
}

/// Doubts balls that appear where the one that is followed cannot be.
///
/// Every block of frames is searched from nothing, and a second ball may be the one that is found.
#[derive(Debug, Clone, Default)]
pub(super) struct Belief {
    last: Option<Place>,
    absent: u32,
    doubted: u32,
    doubted_frame: Option<u64>,
    /// Whether something else was taken for it since it was believed last.
    confused: bool,
}

impl Belief {
    /// The step as it may be believed: without numbers and ambiguous where the ball cannot be where it was seen.
    pub(super) fn vet(&mut self, step: &BodyStep) -> BodyStep {
        let Some(circle) = step.circle else {
            let gone = matches!(step.status, PointStatus::Lost | PointStatus::Occluded | PointStatus::OutOfFrame);
            self.absent += u32::from(gone);
            self.confused |= step.status == PointStatus::Ambiguous;
            if self.absent >= ABSENT_FRAMES {
                *self = Self { absent: ABSENT_FRAMES, ..Self::default() };
            }
            return *step;
        };
        self.absent = 0;
        let (at_px, sigma_px) = ([circle.x_px, circle.y_px], circle.sigma_center_px);
        if self.last.is_some_and(|last| !last.leads_to(step.frame, at_px, sigma_px, self.confused)) {
            self.doubted += 1;
            self.confused = true;
            if self.doubted < DOUBTED_FRAMES {
                self.doubted_frame = Some(step.frame);
                return BodyStep { circle: None, step: None, status: PointStatus::Ambiguous, ..*step };
            }
        }
        (self.doubted, self.confused) = (0, false);
        let measured = step.center_step().map(|step| [step.dx_px, step.dy_px]);
        let rate_px = measured.or(self.last.map(|last| last.rate_px)).unwrap_or_default();
        self.last = Some(Place { frame: step.frame, at_px, sigma_px, rate_px, is_led: measured.is_some() });
        *step
    }

    /// Whether the ball of a frame was doubted; of the newest frame only.
    pub(super) fn doubts(&self, frame: u64) -> bool {
        self.doubted_frame == Some(frame)
    }
}

impl Place {
    /// Whether a ball that was here can be there.
    fn leads_to(&self, frame: u64, at_px: [f64; 2], sigma_px: f64, confused: bool) -> bool {
        let frames = frame.saturating_sub(self.frame) as f64;
        let apart: [f64; 2] = std::array::from_fn(|k| at_px[k] - self.at_px[k] - frames * self.rate_px[k]);
        let speed_px = self.rate_px[0].hypot(self.rate_px[1]);
        let unmeasured = if self.is_led { frames - 1.0 } else { frames };
        let gained_px = unmeasured * if confused { GAINED_CONFUSED_PX } else { GAINED_PX + GAINED_SPEEDS * speed_px };
        apart[0].hypot(apart[1]) <= MOST_APART_PX.max(MOST_SIGMAS * sigma_px.hypot(self.sigma_px)) + gained_px
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::{Circle, RigidStep};

    fn seen(frame: u64, x_px: f64, dx_px: f64) -> BodyStep {
        let circle = Circle {
            x_px,
            y_px: 90.0,
            radius_px: 60.0,
            sigma_center_px: 0.03,
            sigma_radius_px: 0.03,
            visible_fraction: 1.0,
        };
        let step = RigidStep {
            dx_px,
            dy_px: 0.0,
            dtheta_deg: 0.0,
            sigma_dx_px: 0.001,
            sigma_dy_px: 0.001,
            sigma_dtheta_deg: 0.001,
            points: 30,
        };
        let status = PointStatus::Valid;
        let (circle, step) = (Some(circle), Some(step));
        BodyStep {
            is_whole: true,
            rim_fraction: None,
            fixed_fraction: None,
            growth_fraction: None,
            is_carried: false,
            drift: None,
            frame,
            stamp_ns: frame,
            body: 0,
            interval_frames: 1,
            circle,
            rod: None,
            step,
            status,
        }
    }

    fn gone(frame: u64) -> BodyStep {
        BodyStep { circle: None, step: None, status: PointStatus::Lost, ..seen(frame, 0.0, 0.0) }
    }

    /// How many of the steps are believed.
    fn believed(steps: impl IntoIterator<Item = BodyStep>) -> usize {
        let mut belief = Belief::default();
        steps.into_iter().filter(|step| belief.vet(step).step.is_some()).count()
    }

    #[test]
    fn a_ball_that_is_thrown_back_within_a_frame_is_believed() {
        let there = (0..10).map(|k| seen(k, 100.0 + 7.0 * k as f64, if k < 9 { 7.0 } else { -6.0 }));
        let back = (10..20).map(|k| seen(k, 163.0 - 6.0 * (k - 9) as f64, -6.0));
        assert_eq!(believed(there.chain(back)), 20);
    }

    #[test]
    fn another_ball_is_not_believed_until_the_first_is_long_gone() {
        let first = |from: u64, to: u64| (from..to).map(|k| seen(k, 100.0 + 0.6 * k as f64, 0.6));
        let second = |from: u64, to: u64| (from..to).map(|k| seen(k, 60.0 + 7.0 * k as f64, 7.0));
        assert_eq!(believed(first(0, 20).chain(second(20, 30)).chain(first(30, 40))), 30);
        assert_eq!(believed(first(0, 20).chain((20..30).map(gone)).chain(second(30, 40))), 30);
        assert_eq!(believed(first(0, 20).chain(second(20, 100))), 20 + 80 - (DOUBTED_FRAMES as usize - 1));
    }

    #[test]
    fn what_was_not_measured_for_some_frames_may_have_been_hit() {
        let before = (0..10).map(|k| seen(k, 100.0 + 2.0 * k as f64, 2.0));
        let hidden = (10..14).map(gone);
        let after = (14..20).map(|k| seen(k, 110.0 - 2.0 * (k - 14) as f64, -2.0));
        assert_eq!(believed(before.chain(hidden).chain(after)), 16);
    }
}
