//! First-order warps of a subset.

use super::point::Point;
use super::shape::Shape;

/// The first-order warp of a subset: an offset (dx, dy) from its centre moves to (u + (1 + ux) dx + uy dy, v + vx dx +
/// (1 + vy) dy).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(in crate::dic) struct Warp {
    pub(in crate::dic) u: f64,
    pub(in crate::dic) ux: f64,
    pub(in crate::dic) uy: f64,
    pub(in crate::dic) v: f64,
    pub(in crate::dic) vx: f64,
    pub(in crate::dic) vy: f64,
}

/// A rigid motion in the image plane.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PlanarMotion {
    /// The displacement of a point along x, px.
    pub u_px: f64,
    /// The displacement of the point along y, px.
    pub v_px: f64,
    /// The rotation, counter-clockwise on the screen, deg.
    pub angle_deg: f64,
}

impl PlanarMotion {
    /// Returns the motion of the point at `offset`, px, from the one that this motion refers to. The rotation is the
    /// same.
    pub(in crate::dic) fn at_offset(self, offset: Point) -> Self {
        let (dx, dy) = (offset.x_px, offset.y_px);
        let (x, y) = self.to_warp().apply(dx, dy);
        Self { u_px: x - dx, v_px: y - dy, ..self }
    }

    /// Converts the motion to the warp of a subset centred at the point that it refers to.
    pub(in crate::dic) fn to_warp(self) -> Warp {
        Warp::rigid(self.u_px, self.v_px, self.angle_deg.to_radians())
    }
}

/// The second-order part of a warp: coefficients of dx^2, dx dy, dy^2 for u and for v.
pub(in crate::dic) type Second = [[f64; 3]; 2];

impl Warp {
    /// Returns a translation by (u, v), px.
    pub(in crate::dic) fn shift(u: f64, v: f64) -> Self {
        Self { u, v, ..Self::default() }
    }

    /// Returns a translation by (u, v), px, with a rotation about the centre, counter-clockwise on the screen, rad.
    pub(in crate::dic) fn rigid(u: f64, v: f64, angle_rad: f64) -> Self {
        let (sin, cos) = angle_rad.sin_cos();
        Self { u, v, ux: cos - 1.0, uy: sin, vx: -sin, vy: cos - 1.0 }
    }

    /// Converts the parameters of a shape function, in px, rad and px/px, to a warp.
    ///
    /// They are (u, v) for a translation, (u, v, angle) for a rigid motion, else (u, ux, uy, v, vx, vy).
    pub(in crate::dic) fn from_step(shape: Shape, step: &[f64; 6]) -> Self {
        match shape {
            Shape::Translation => Self::shift(step[0], step[1]),
            Shape::Rigid => Self::rigid(step[0], step[1], step[2]),
            Shape::Affine | Shape::Quadratic => {
                Self { u: step[0], ux: step[1], uy: step[2], v: step[3], vx: step[4], vy: step[5] }
            }
        }
    }

    /// Returns the warped offset (dx, dy), relative to the subset's centre.
    pub(in crate::dic) fn apply(&self, dx: f64, dy: f64) -> (f64, f64) {
        (self.u + dx + self.ux * dx + self.uy * dy, self.v + dy + self.vx * dx + self.vy * dy)
    }

    /// Composes this warp with the inverse of `step`: the inverse compositional update of S. Baker, I. Matthews, Int.
    /// J. Comput. Vis. 56 (2004) 221, <https://doi.org/10.1023/B:VISI.0000011205.11775.fd>.
    ///
    /// `None` if `step` cannot be inverted, that is if its determinant is below 0.1.
    pub(in crate::dic) fn after_inverse(&self, step: &Self) -> Option<Self> {
        let determinant = (1.0 + step.ux) * (1.0 + step.vy) - step.uy * step.vx;
        if !determinant.is_finite() || determinant < 0.1 {
            return None;
        }
        // The inverse of the linear part, and the remaining offset.
        let (a, b) = ((1.0 + step.vy) / determinant, -step.uy / determinant);
        let (c, d) = (-step.vx / determinant, (1.0 + step.ux) / determinant);
        let (dx, dy) = (-(a * step.u + b * step.v), -(c * step.u + d * step.v));
        let (u, v) = self.apply(dx, dy);
        Some(Self {
            u,
            v,
            ux: (1.0 + self.ux) * a + self.uy * c - 1.0,
            uy: (1.0 + self.ux) * b + self.uy * d,
            vx: self.vx * a + (1.0 + self.vy) * c,
            vy: self.vx * b + (1.0 + self.vy) * d - 1.0,
        })
    }

    /// Whether no displacement gradient is larger than `limit` in size.
    pub(in crate::dic) fn is_within(&self, limit: f64) -> bool {
        [self.ux, self.uy, self.vx, self.vy].into_iter().all(|gradient| gradient.abs() <= limit)
    }

    /// Returns the component of this step along the step `before`, in units of its length. Negative if they are
    /// opposite.
    ///
    /// The scalar product weights displacement gradients with `half`, the distance from the centre in px. NaN or
    /// infinite if `before` has no length.
    pub(in crate::dic) fn projection_ratio(&self, before: &Self, half: f64) -> f64 {
        let product = |a: &Self, b: &Self| {
            let gradients = a.ux * b.ux + a.uy * b.uy + a.vx * b.vx + a.vy * b.vy;
            a.u * b.u + a.v * b.v + half * half * gradients
        };
        product(self, before) / product(before, before)
    }

    /// Returns the step with displacement and gradients multiplied by a factor.
    pub(in crate::dic) fn scaled(&self, factor: f64) -> Self {
        let Self { u, ux, uy, v, vx, vy } = *self;
        Self { u: u * factor, ux: ux * factor, uy: uy * factor, v: v * factor, vx: vx * factor, vy: vy * factor }
    }

    /// Returns the length of a step, px: the largest of |u|, |v| and the displacements that the gradients cause at
    /// `half` px from the centre.
    pub(in crate::dic) fn length(&self, half: f64) -> f64 {
        let gradients = [self.ux, self.uy, self.vx, self.vy].into_iter().fold(0.0, |high: f64, g| high.max(g.abs()));
        self.u.abs().max(self.v.abs()).max(half * gradients)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn undoing_a_step_restores_the_point() {
        let warp = Warp { u: 1.3, ux: 0.02, uy: -0.1, v: -0.7, vx: 0.05, vy: -0.03 };
        let step = Warp { u: 0.2, ux: -0.01, uy: 0.03, v: 0.4, vx: 0.02, vy: 0.01 };
        let updated = warp.after_inverse(&step).unwrap();
        // updated(step(p)) == warp(p)
        let (x, y) = step.apply(5.0, -3.0);
        let (found, expected) = (updated.apply(x, y), warp.apply(5.0, -3.0));
        assert!((found.0 - expected.0).abs() < 1e-12 && (found.1 - expected.1).abs() < 1e-12);
    }

    #[test]
    fn a_quarter_turn_counter_clockwise_takes_right_to_up() {
        let (x, y) = Warp::rigid(0.0, 0.0, std::f64::consts::FRAC_PI_2).apply(1.0, 0.0);
        assert!(x.abs() < 1e-12 && (y + 1.0).abs() < 1e-12, "{x} {y}");
    }
}
