//! From image axes in pixels to the surface's axes in metres: the only place where y turns up.

use super::MotionParams;
use crate::results::{BodyVelocity, Estimate};

/// The scale, m/px, with its standard uncertainty.
pub type MetresPerPixel = Estimate;

/// The directions of the struck surface.
///
/// The tangent is the image's x axis rotated counter-clockwise by the surface angle. The normal is the tangent rotated
/// counter-clockwise by 90 deg, so it points up from a level floor, and a falling ball has a negative normal velocity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axes {
    cos: f64,
    sin: f64,
}

/// A vector along the surface's normal and tangent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// Along the outward normal.
    pub normal: f64,
    /// Along the tangent.
    pub tangential: f64,
}

impl Axes {
    /// Creates the axes of a surface at `surface_angle_deg`, counter-clockwise from x.
    pub fn new(surface_angle_deg: f64) -> Self {
        let (sin, cos) = surface_angle_deg.to_radians().sin_cos();
        Self { cos, sin }
    }

    /// Converts an image vector (x right, y down) to the surface's axes, same unit.
    pub fn surface(&self, x: f64, y_down: f64) -> Surface {
        let y_up = -y_down;
        Surface { normal: y_up * self.cos - x * self.sin, tangential: x * self.cos + y_up * self.sin }
    }

    /// Returns the standard uncertainties along normal and tangent of a vector with independent sigmas along x and y.
    pub fn surface_sigma(&self, sigma_x: f64, sigma_y: f64) -> Surface {
        Surface {
            normal: (sigma_y * self.cos).hypot(sigma_x * self.sin),
            tangential: (sigma_x * self.cos).hypot(sigma_y * self.sin),
        }
    }
}

/// Returns gravity in image axes (x right, y down), px/frame^2.
pub fn gravity_px(params: &MotionParams, metres_per_px: f64) -> [f64; 2] {
    let (sin, cos) = params.gravity_angle_deg.to_radians().sin_cos();
    let period_s = params.frame_period_ns * 1e-9;
    let strength = params.gravity_m_s2 * period_s * period_s / metres_per_px;
    [strength * cos, -strength * sin]
}

/// The rates of a body's three coordinates per nominal frame period, image axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelRates {
    /// Along x, px/frame.
    pub x: Estimate,
    /// Along y (down), px/frame.
    pub y: Estimate,
    /// Counter-clockwise, deg/frame.
    pub theta: Estimate,
    /// The number of frames of the fit.
    pub window_frames: u32,
    /// The order of the fit.
    pub order: u32,
}

impl PixelRates {
    /// Widens the sigmas along x and y by an uncertain centre, px: a point off the centre of a rotating body has
    /// another velocity.
    pub fn about(self, center_sigma_px: f64) -> Self {
        let whirl = self.theta.value.to_radians() * center_sigma_px;
        let widened = |rate: Estimate| Estimate { sigma: rate.sigma.hypot(whirl), ..rate };
        Self { x: widened(self.x), y: widened(self.y), ..self }
    }

    /// Adds further standard uncertainties in quadrature: x and y, px/frame, and the angle, deg/frame.
    pub fn widened_by(self, sigmas: [f64; 3]) -> Self {
        let [x, y, theta] = sigmas;
        let widened = |rate: Estimate, by: f64| Estimate { sigma: rate.sigma.hypot(by), ..rate };
        Self { x: widened(self.x, x), y: widened(self.y, y), theta: widened(self.theta, theta), ..self }
    }

    /// Widens the sigmas of rates that were fitted to outlines, each of which is uncertain by `sigma_px`.
    ///
    /// Light at the rim shifts the outlines of many frames alike, and no fit averages that out. It changes slowly, so the
    /// errors at both ends of the window count as independent.
    pub fn from_outlines(self, sigma_px: f64) -> Self {
        let rate = std::f64::consts::SQRT_2 * sigma_px / f64::from(self.window_frames.max(1));
        self.widened_by([rate, rate, 0.0])
    }

    /// Widens the sigmas for true rates that may be larger by a share of themselves.
    pub fn biased_by(self, share: f64) -> Self {
        let [x, y, theta] = [self.x, self.y, self.theta].map(|rate| rate.with_relative_error(share));
        Self { x, y, theta, ..self }
    }
}

/// The standard uncertainty from which a rotation is not known at all, deg/frame.
const MAX_SPIN_SIGMA_DEG: f64 = 90.0;

/// Converts rates per frame in image axes to velocities in m/s and rad/s, with y up, and along the surface's axes.
pub fn physical(rates: &PixelRates, scale: MetresPerPixel, params: &MotionParams) -> BodyVelocity {
    let period_s = params.frame_period_ns * 1e-9;
    let per_frame = scale.value / period_s;
    let along = Axes::new(params.surface_angle_deg).surface(rates.x.value, rates.y.value);
    let (vx, vy) = (rates.x.value * per_frame, -rates.y.value * per_frame);
    let noise = rates.x.sigma.hypot(rates.y.sigma) * std::f64::consts::FRAC_1_SQRT_2 * per_frame;
    let from_scale = vx.hypot(vy) * scale.sigma / scale.value;
    let spin = Some(rates.theta).filter(|theta| theta.sigma < MAX_SPIN_SIGMA_DEG);
    BodyVelocity {
        vx_m_s: vx,
        vy_m_s: vy,
        vn_m_s: along.normal * per_frame,
        vt_m_s: along.tangential * per_frame,
        omega_rad_s: spin.map(|theta| theta.value.to_radians() / period_s),
        sigma_v_m_s: noise.hypot(from_scale),
        sigma_omega_rad_s: spin.map(|theta| theta.sigma.to_radians() / period_s),
        window_frames: rates.window_frames,
        order: rates.order,
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Form, Intervals, RandomWalk, Scale, Shutter};
    use super::*;

    fn params(surface_angle_deg: f64) -> MotionParams {
        MotionParams {
            scale: Scale::MmPerPx(0.5),
            view: super::super::View::default(),
            rectifier: None,
            radius_px: None,
            surface_angle_deg,
            gravity_m_s2: 9.81,
            gravity_angle_deg: -90.0,
            window_frames: None,
            lag_frames: crate::motion::DEFAULT_LAG_FRAMES,
            order: 2,
            mass_kg: None,
            form: Form::Ball,
            interval_frames: 1,
            walk: RandomWalk::default(),
            spans: Intervals::default(),
            exposure_ns: 0.0,
            coding: crate::results::FrameCoding::default(),
            shutter: Shutter::default(),
            frame_period_ns: 100_000.0,
        }
    }

    fn rates(x: f64, y: f64, theta: f64) -> PixelRates {
        let e = |value| Estimate { value, sigma: 0.001 };
        PixelRates { x: e(x), y: e(y), theta: e(theta), window_frames: 9, order: 2 }
    }

    #[test]
    fn a_ball_that_falls_on_a_level_floor_has_a_negative_normal_velocity() {
        let v = physical(&rates(0.2, 0.4, 1.8), Estimate { value: 5e-4, sigma: 0.0 }, &params(0.0));
        assert!((v.vx_m_s - 1.0).abs() < 1e-12 && (v.vy_m_s + 2.0).abs() < 1e-12, "{v:?}");
        assert!((v.vn_m_s + 2.0).abs() < 1e-12 && (v.vt_m_s - 1.0).abs() < 1e-12);
        assert!((v.omega_rad_s.unwrap() - 314.159_265_358_979_3).abs() < 1e-9);
        assert!((v.sigma_v_m_s - 0.005).abs() < 1e-12);
    }

    #[test]
    fn a_tilted_surface_turns_normal_and_tangent() {
        // A surface rising to the right by 30 deg: a ball that moves straight up its slope has a tangential velocity
        // only.
        let (sin, cos) = 30.0_f64.to_radians().sin_cos();
        let along = Axes::new(30.0).surface(cos, -sin);
        assert!((along.tangential - 1.0).abs() < 1e-12 && along.normal.abs() < 1e-12);
        let up = Axes::new(30.0).surface(0.0, -1.0);
        assert!((up.normal - cos).abs() < 1e-12 && (up.tangential - sin).abs() < 1e-12);
        let wall = Axes::new(90.0).surface(-1.0, 0.0);
        assert!((wall.normal - 1.0).abs() < 1e-12, "a wall on the right has its normal to the left");
    }

    #[test]
    fn gravity_points_down_the_image() {
        let [x, y] = gravity_px(&params(0.0), 5e-4);
        assert!(x.abs() < 1e-15 && (y - 9.81e-8 / 5e-4).abs() < 1e-12);
    }

    #[test]
    fn an_uncertain_centre_widens_the_velocity_of_a_ball_that_turns() {
        let still = rates(0.3, 0.4, 0.0).about(0.02);
        let turning = rates(0.3, 0.4, 1.8).about(0.02);
        assert_eq!(still, rates(0.3, 0.4, 0.0));
        assert!((turning.x.sigma - 0.001_f64.hypot(0.02 * 1.8_f64.to_radians())).abs() < 1e-12);
        assert_eq!((turning.y.sigma, turning.theta), (turning.x.sigma, rates(0.3, 0.4, 1.8).theta));
    }

    #[test]
    fn an_uncertain_scale_widens_the_velocity() {
        let v = physical(&rates(0.3, 0.4, 0.0), Estimate { value: 5e-4, sigma: 5e-6 }, &params(0.0));
        assert!((v.sigma_v_m_s - 0.005_f64.hypot(0.025)).abs() < 1e-9);
    }
}
