//! The acceleration of a ball in a film, compared with gravity.

use crate::survey::Acceleration;

/// Standard gravity, m/s^2.
const GRAVITY_M_S2: f64 = 9.806_65;
/// The uncertainty from which a film is too short to show gravity, m/s^2.
const MAX_SIGMA_M_S2: f64 = 3.0;
/// The uncertainty up to which a film can show that there is another acceleration than gravity, or none, m/s^2.
const MAX_ABSENT_SIGMA_M_S2: f64 = 0.5;
/// The deviation from gravity within which it is gravity, as a fraction. The scale is a few per cent wrong where the ball is
/// nearer to the camera than the plane, and air slows it.
const TOLERANCE: f64 = 0.25;
/// The direction within which the camera is level, deg.
const LEVEL_DEG: f64 = 8.0;
/// The number of standard uncertainties from which a difference is significant.
const SIGNIFICANT_SIGMAS: f64 = 4.0;

/// The gravity that the film shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Gravity {
    /// The film is too short, or has no scale.
    Unclear,
    /// The ball falls as expected: the measured acceleration and its uncertainty, m/s^2.
    Fits { value_m_s2: f64, sigma_m_s2: f64 },
    /// It falls in another direction, deg counter-clockwise from x with y up: the camera is tilted.
    Tilted { value_m_s2: f64, angle_deg: f64 },
    /// It does not fall: it is filmed from above, or held.
    Absent { sigma_m_s2: f64 },
    /// It falls at another rate: the frame rate by which it would fit, as a multiple of the assumed one.
    Contradicts { value_m_s2: f64, rate_factor: f64 },
}

impl Gravity {
    /// Compares an acceleration, whose y points down, at a scale in mm/px with gravity.
    pub(super) fn classify(acceleration: Option<Acceleration>, mm_per_px: Option<f64>) -> Self {
        let Some((acceleration, mm_per_px)) = acceleration.zip(mm_per_px) else { return Self::Unclear };
        let m_s2 = |px_s2: f64| px_s2 * mm_per_px * 1e-3;
        // World axes: y up.
        let [x, y] = [m_s2(acceleration.value_px_s2[0]), -m_s2(acceleration.value_px_s2[1])];
        let (value_m_s2, sigma_m_s2) = (x.hypot(y), m_s2(acceleration.sigma_px_s2));
        if sigma_m_s2 > MAX_SIGMA_M_S2 {
            return Self::Unclear;
        }
        let is_near = |value: f64| (value - GRAVITY_M_S2).abs() < (TOLERANCE * GRAVITY_M_S2).max(2.0 * sigma_m_s2);
        let angle_deg = y.atan2(x).to_degrees();
        if is_near(-y) && x.abs() < (GRAVITY_M_S2 * LEVEL_DEG.to_radians().sin()).max(SIGNIFICANT_SIGMAS * sigma_m_s2) {
            Self::Fits { value_m_s2, sigma_m_s2 }
        } else if is_near(value_m_s2) {
            Self::Tilted { value_m_s2, angle_deg }
        } else if sigma_m_s2 > MAX_ABSENT_SIGMA_M_S2 {
            Self::Unclear
        } else if value_m_s2 < SIGNIFICANT_SIGMAS * sigma_m_s2 {
            Self::Absent { sigma_m_s2 }
        } else {
            Self::Contradicts { value_m_s2, rate_factor: (GRAVITY_M_S2 / value_m_s2).sqrt() }
        }
    }

    /// Returns the keys of `[velocity]` with their comments; nothing where the defaults hold.
    pub(super) fn keys(self) -> String {
        match self {
            Self::Unclear | Self::Fits { .. } | Self::Contradicts { .. } => String::new(),
            Self::Tilted { angle_deg, .. } => {
                format!(
                    "# The direction in which the ball falls, counter-clockwise from x, deg.\ngravity_angle_deg = {angle_deg:.0}\n"
                )
            }
            Self::Absent { .. } => "# The ball does not fall in this view.\ngravity_m_s2 = 0\n".into(),
        }
    }

    /// Describes the gravity that the film shows in one line; `frame_rate_hz` is the assumed rate of the film, Hz.
    pub(super) fn describe(self, frame_rate_hz: f64) -> String {
        match self {
            Self::Unclear => "not visible in this film; 9.81 m/s^2 downwards is assumed".into(),
            Self::Fits { value_m_s2, sigma_m_s2 } => {
                format!("{value_m_s2:.1} +- {:.1} m/s^2 downwards, as it should be", sigma_m_s2.max(0.1))
            }
            Self::Tilted { value_m_s2, angle_deg } => {
                format!("{value_m_s2:.1} m/s^2 towards {angle_deg:.0} deg: the camera is tilted")
            }
            Self::Absent { sigma_m_s2 } => format!("0 +- {sigma_m_s2:.1} m/s^2: the ball does not fall in this view"),
            Self::Contradicts { value_m_s2, rate_factor } => {
                format!("{value_m_s2:.2} m/s^2; 9.81 m/s^2 would need {:.0} frames/s", frame_rate_hz * rate_factor)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gravity(x: f64, y: f64) -> Gravity {
        Gravity::classify(Some(Acceleration { value_px_s2: [x, y], sigma_px_s2: 200.0 }), Some(1.0))
    }

    #[test]
    fn the_frame_rate_that_gravity_needs_is_named() {
        // A film of 240 frames/s that plays at 30.
        let line = gravity(0.0, 9806.65 / 64.0 + 1000.0).describe(30.0);
        assert!(matches!(gravity(0.0, 1000.0), Gravity::Contradicts { .. }), "{line}");
        let slow = Acceleration { value_px_s2: [0.0, 9806.65 / 64.0], sigma_px_s2: 2.0 };
        let line = Gravity::classify(Some(slow), Some(1.0)).describe(30.0);
        assert_eq!(line, "0.15 m/s^2; 9.81 m/s^2 would need 240 frames/s");
    }

    #[test]
    fn a_level_a_tilted_and_a_downward_camera_differ() {
        assert!(matches!(gravity(100.0, 9700.0), Gravity::Fits { .. }));
        let Gravity::Tilted { angle_deg, .. } = gravity(3192.0, 9272.0) else {
            panic!("{:?}", gravity(3192.0, 9272.0))
        };
        assert!((angle_deg + 71.0).abs() < 0.1, "{angle_deg}");
        assert!(matches!(gravity(100.0, -300.0), Gravity::Absent { .. }));
        assert_eq!(Gravity::classify(None, Some(1.0)), Gravity::Unclear);
    }
}
