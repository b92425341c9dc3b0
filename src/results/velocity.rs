//! The `velocity` row: how fast a body moves and turns.

use super::Phase;
use super::columns::sample_row;

/// Passes the columns of the `velocity` row to a macro, each with its number in the protobuf message.
macro_rules! velocity_row {
    ($derive:ident) => {
        $derive! {
            /// A row of the `velocity` table: one body in one frame.
            ///
            /// # Examples
            ///
            /// ```
            /// use ricochet::message::VelocityMessage;
            /// use ricochet::results::{Phase, PointStatus};
            /// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
            ///
            /// // The true velocities of a simulated shot; `velocities` reads the measured ones.
            /// let sample = recording.truth()?.nth(30).unwrap()?;
            /// assert_eq!((sample.frame, sample.phase, sample.status), (30, Phase::Contact, PointStatus::Valid));
            /// // `None` where the velocity was not measured; `status` holds the reason.
            /// let velocity = sample.velocity.unwrap();
            /// assert!(velocity.vn_m_s < 0.0, "towards the surface");
            /// // A running rig publishes it as a message with the same content.
            /// assert_eq!(VelocityMessage::new(&sample, 0).sample(), Some(sample));
            /// # Ok::<(), Box<dyn std::error::Error>>(())
            /// ```
            VelocitySample(VelocityMessage, "ricochet.Velocity.v2", Velocity) {
                numbers {
                    /// The centre along x, px.
                    center_x_px = 4,
                    /// The centre along y (down), px.
                    center_y_px = 5,
                    /// The radius, px.
                    radius_px = 6,
                }
                groups {
                    /// The unsmoothed motion of a body from one frame to the next.
                    ///
                    /// It is measured over `interval_frames` and divided by it, so it is always per frame.
                    ///
                    /// # Examples
                    ///
                    /// ```
                    /// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
                    /// let sample = recording.truth()?.next().unwrap()?;
                    /// let (motion, velocity) = (sample.motion.unwrap(), sample.velocity.unwrap());
                    /// // Image axes: y points down, so a falling ball moves along positive y, in px/frame.
                    /// assert!(motion.dy_px > 0.0 && velocity.vy_m_s < 0.0);
                    /// // The rate and the scale of the film, 0.5142 mm/px, lead from one to the other.
                    /// let rate_hz = recording.frame_rate_hz()?.unwrap();
                    /// let vy_m_s = -motion.dy_px * 0.5142e-3 * rate_hz;
                    /// assert!((vy_m_s - velocity.vy_m_s).abs() < 0.001);
                    /// # Ok::<(), Box<dyn std::error::Error>>(())
                    /// ```
                    motion: MotionSample {
                        numbers {
                            /// The motion of the body's centre along x, px/frame.
                            dx_px: f64 = 7,
                            /// The motion of the body's centre along y (down), px/frame.
                            dy_px: f64 = 8,
                            /// The rotation, counter-clockwise as seen on the screen, deg/frame. `None` where only the outline moves, and
                            /// nothing on it turns visibly.
                            dtheta_deg: Option<f64> = 9,
                            /// The standard uncertainty of `dx_px`, px/frame.
                            sigma_dx_px: f64 = 10,
                            /// The standard uncertainty of `dy_px`, px/frame.
                            sigma_dy_px: f64 = 11,
                            /// The standard uncertainty of `dtheta_deg`, deg/frame.
                            sigma_dtheta_deg: Option<f64> = 12,
                        }
                        counts {
                            /// The number of subsets it rests on.
                            points = 13,
                        }
                    }
                    /// The smoothed physical velocity of a body.
                    ///
                    /// # Examples
                    ///
                    /// ```
                    /// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
                    /// let velocity = recording.truth()?.last().unwrap()?.velocity.unwrap();
                    /// // World axes: y points up, so a ball that leaves the floor has a positive velocity, in m/s.
                    /// assert!(velocity.vy_m_s > 1.3);
                    /// // The spin is `None` where nothing on the body turns visibly, which is not the same as 0.
                    /// let spin = velocity.omega_rad_s.map_or("unknown".into(), |omega| format!("{omega:.1} rad/s"));
                    /// assert_eq!(spin, "-15.3 rad/s");
                    /// # Ok::<(), Box<dyn std::error::Error>>(())
                    /// ```
                    velocity: BodyVelocity {
                        numbers {
                            /// The velocity along x (right), m/s.
                            vx_m_s: f64 = 14,
                            /// The velocity along y (**up**), m/s.
                            vy_m_s: f64 = 15,
                            /// The velocity along the outward normal of the struck surface, m/s.
                            vn_m_s: f64 = 16,
                            /// The velocity along the surface's tangent, m/s.
                            vt_m_s: f64 = 17,
                            /// The spin, counter-clockwise positive, rad/s. `None` where it cannot be seen.
                            omega_rad_s: Option<f64> = 18,
                            /// The standard uncertainty of each velocity component, m/s.
                            sigma_v_m_s: f64 = 19,
                            /// The standard uncertainty of the spin, rad/s.
                            sigma_omega_rad_s: Option<f64> = 20,
                        }
                        counts {
                            /// The number of frames the local fit spans.
                            window_frames = 21,
                            /// The order of the polynomial fitted to the positions.
                            order = 22,
                        }
                    }
                }
                numbers {
                    /// The visible share of the body, 0 to 1.
                    visible_fraction = 23,
                }
                names {
                    /// The phase of the collision, as known when the sample was published.
                    phase: Phase = 24,
                }
                status = 25,
                reasons {
                    /// The reason why rotation and spin are missing in a row with a velocity: `low-contrast` if nothing on
                    /// the body turns visibly.
                    rotation_status = 27,
                }
                nested {}
            }
        }
    };
}
pub(crate) use velocity_row;

velocity_row!(sample_row);
