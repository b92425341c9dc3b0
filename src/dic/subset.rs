//! A reference subset with everything of it that does not change while the
//! target is searched.

use super::Shape;
use super::lanes::{LANES, Lanes};
use super::prepared::Prepared;
use super::solve::invert;
use super::window::Window;

/// Why a reference subset cannot be followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unusable {
    /// It reaches over the edge of the image.
    OutOfFrame,
    /// It has no texture, texture along one direction only, or is saturated.
    LowContrast,
}

/// Standard deviation under which a subset holds nothing but rounding, DN.
const LEAST_CONTRAST: f64 = 0.5;

/// Share of saturated pixels from which on a subset is refused.
const MOST_SATURATED: f64 = 0.5;

/// Reference pixels, packed like [`Window::mask`], and their sums.
///
/// The Jacobian of the affine warp is J = (gx, gx dx, gx dy, gy, gy dx, gy dy).
#[derive(Debug, Clone, Default)]
pub(super) struct Subset {
    /// Grey levels less their mean; 0 off the mask.
    pub(super) levels: Vec<Lanes>,
    /// Gradient along x; 0 off the mask.
    pub(super) gradient_x: Vec<Lanes>,
    /// Gradient along y; 0 off the mask.
    pub(super) gradient_y: Vec<Lanes>,
    /// Mean grey level, the frame's offset taken off.
    pub(super) mean: f32,
    /// Sum of `levels` squared.
    pub(super) energy: f64,
    /// Sum of J.
    pub(super) jacobian_sum: [f64; 6],
    /// Sum of J times `levels`.
    pub(super) jacobian_levels: [f64; 6],
    /// Inverse of the sum of J J^T, for the parameters of the shape.
    pub(super) inverse: [[f64; 6]; 6],
    /// Share of the gradient energy that the weaker direction has, 0 to 0.5.
    pub(super) isotropy: f64,
    /// Gradient energy over the energy of the grey levels: 0.9 for white noise, far less for speckle.
    pub(super) roughness: f64,
    /// Gradient energy per pixel in the weaker direction, DN^2/px^2.
    pub(super) weak_gradient: f64,
}

impl Subset {
    /// Takes the subset at (x, y) out of `reference`.
    pub(super) fn fill(
        &mut self,
        reference: &Prepared,
        window: &Window,
        shape: Shape,
        at: (u32, u32),
    ) -> Result<(), Unusable> {
        let (x, y) = (at.0 as isize, at.1 as isize);
        let half = window.half as isize;
        let (width, height) = (reference.width() as isize, reference.height() as isize);
        if x < half || y < half || x + half >= width || y + half >= height {
            return Err(Unusable::OutOfFrame);
        }
        self.fill_levels(reference, window, (x, y))?;
        let hessian = self.fill_gradients(reference, window, (x, y));
        let (projected, count) = project_matrix(shape, &hessian);
        self.inverse = invert(&projected, count).ok_or(Unusable::LowContrast)?;
        let (xx, xy, yy) = (hessian[0][0], hessian[0][3], hessian[3][3]);
        let weaker = 0.5 * (xx + yy) - (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
        self.isotropy = weaker / (xx + yy);
        self.roughness = 0.5 * (xx + yy) / self.energy;
        self.weak_gradient = weaker / window.pixels as f64;
        Ok(())
    }

    /// Grey levels, their mean and energy.
    fn fill_levels(&mut self, reference: &Prepared, window: &Window, at: (isize, isize)) -> Result<(), Unusable> {
        let plane = &reference.levels;
        let (data, stride) = (plane.data(), plane.stride());
        let saturation = reference.saturation - 0.5;
        self.levels.clear();
        let (mut sum, mut saturated) = (0.0, 0.0);
        for block in &window.blocks {
            let first = plane.index(at.0 + block.dx as isize, at.1 + block.dy as isize);
            let mut total = Lanes::splat(0.0);
            for row in 0..block.rows {
                let mask = window.mask[block.start + row];
                let levels = Lanes::load(&data[first + row * stride..]) * mask;
                total += levels;
                if saturation.is_finite() {
                    let over = levels.0.iter().zip(mask.0).filter(|(level, m)| **level >= saturation && *m > 0.5);
                    saturated += over.count() as f64;
                }
                self.levels.push(levels);
            }
            sum += total.sum();
        }
        let pixels = window.pixels as f64;
        self.mean = (sum / pixels) as f32;
        self.energy = 0.0;
        for (block, rows) in window.blocks.iter().map(|block| (block, block.start..block.start + block.rows)) {
            let mut energy = Lanes::splat(0.0);
            for (levels, mask) in self.levels[rows.clone()].iter_mut().zip(&window.mask[rows]) {
                *levels = *levels - Lanes::splat(self.mean) * *mask;
                energy += *levels * *levels;
            }
            debug_assert!(block.rows > 0);
            self.energy += energy.sum();
        }
        let contrast = (self.energy / pixels).sqrt();
        // Written so that NaN is refused.
        if !(contrast >= LEAST_CONTRAST && saturated <= MOST_SATURATED * pixels) {
            return Err(Unusable::LowContrast);
        }
        Ok(())
    }

    /// Gradients and the sums over J; gives the sum of J J^T.
    fn fill_gradients(&mut self, reference: &Prepared, window: &Window, at: (isize, isize)) -> [[f64; 6]; 6] {
        let (plane_x, plane_y) = (&reference.gradient_x, &reference.gradient_y);
        let stride = plane_x.stride();
        self.gradient_x.clear();
        self.gradient_y.clear();
        self.jacobian_sum = [0.0; 6];
        self.jacobian_levels = [0.0; 6];
        let mut moments = [[0.0; 6]; 3];
        for block in &window.blocks {
            let first = plane_x.index(at.0 + block.dx as isize, at.1 + block.dy as isize);
            for row in 0..block.rows {
                let mask = window.mask[block.start + row];
                self.gradient_x.push(Lanes::load(&plane_x.data()[first + row * stride..]) * mask);
                self.gradient_y.push(Lanes::load(&plane_y.data()[first + row * stride..]) * mask);
            }
            let rows = block.start..block.start + block.rows;
            let (gx, gy) = (&self.gradient_x[rows.clone()], &self.gradient_y[rows.clone()]);
            for (moments, (a, b)) in moments.iter_mut().zip([(gx, gx), (gx, gy), (gy, gy)]) {
                add_second_moments(moments, a, b, (block.dx, block.dy));
            }
            for (half, gradient) in [gx, gy].into_iter().enumerate() {
                let at = (block.dx, block.dy);
                add_first_moments(&mut self.jacobian_sum[3 * half..], gradient, None, at);
                add_first_moments(
                    &mut self.jacobian_levels[3 * half..],
                    gradient,
                    Some(&self.levels[rows.clone()]),
                    at,
                );
            }
        }
        hessian_from_moments(&moments)
    }
}

/// Adds the sums of a, a dx, a dy (times `factor` where there is one).
fn add_first_moments(sums: &mut [f64], a: &[Lanes], factor: Option<&[Lanes]>, first: (i32, i32)) {
    let (mut plain, mut with_dy) = (Lanes::splat(0.0), Lanes::splat(0.0));
    for (row, value) in a.iter().enumerate() {
        let product = factor.map_or(*value, |factor| *value * factor[row]);
        plain += product;
        with_dy += product * Lanes::splat((first.1 + row as i32) as f32);
    }
    sums[0] += plain.sum();
    sums[1] += plain.moment(f64::from(first.0));
    sums[2] += with_dy.sum();
}

/// Adds the sums of a b times 1, dx, dy, dx^2, dx dy, dy^2.
fn add_second_moments(sums: &mut [f64; 6], a: &[Lanes], b: &[Lanes], first: (i32, i32)) {
    let mut powers = [Lanes::splat(0.0); 3];
    for (row, (a, b)) in a.iter().zip(b).enumerate() {
        let dy = Lanes::splat((first.1 + row as i32) as f32);
        let product = *a * *b;
        let with_dy = product * dy;
        powers[0] += product;
        powers[1] += with_dy;
        powers[2] += with_dy * dy;
    }
    let dx = f64::from(first.0);
    sums[0] += powers[0].sum();
    sums[1] += powers[0].moment(dx);
    sums[2] += powers[1].sum();
    sums[3] += powers[0].second_moment(dx);
    sums[4] += powers[1].moment(dx);
    sums[5] += powers[2].sum();
}

/// Puts the moments of gx gx, gx gy, gy gy in their places in the sum of J J^T.
fn hessian_from_moments(moments: &[[f64; 6]; 3]) -> [[f64; 6]; 6] {
    // Which moment (1, dx, dy, dx^2, dx dy, dy^2) each pair of (1, dx, dy) gives.
    const PLACE: [[usize; 3]; 3] = [[0, 1, 2], [1, 3, 4], [2, 4, 5]];
    let mut hessian = [[0.0; 6]; 6];
    for (row, line) in hessian.iter_mut().enumerate() {
        for (column, value) in line.iter_mut().enumerate() {
            *value = moments[row / 3 + column / 3][PLACE[row % 3][column % 3]];
        }
    }
    hessian
}

/// Turns sums over the affine J into those of the shape's own parameters.
pub(super) fn project(shape: Shape, affine: &[f64; 6]) -> ([f64; 6], usize) {
    match shape {
        Shape::Translation => ([affine[0], affine[3], 0.0, 0.0, 0.0, 0.0], 2),
        // A turn counter-clockwise moves (dx, dy) by (dy, -dx).
        Shape::Rigid => ([affine[0], affine[3], affine[2] - affine[4], 0.0, 0.0, 0.0], 3),
        Shape::Affine | Shape::Quadratic => (*affine, 6),
    }
}

/// [`project`] on both sides of a matrix.
fn project_matrix(shape: Shape, affine: &[[f64; 6]; 6]) -> ([[f64; 6]; 6], usize) {
    let mut rows = [[0.0; 6]; 6];
    for (row, line) in affine.iter().enumerate() {
        rows[row] = project(shape, line).0;
    }
    let mut projected = [[0.0; 6]; 6];
    let mut count = 6;
    for column in 0..6 {
        let line = std::array::from_fn(|row| rows[row][column]);
        let (values, parameters) = project(shape, &line);
        count = parameters;
        for (row, value) in values.into_iter().enumerate() {
            projected[row][column] = value;
        }
    }
    (projected, count)
}

/// Pixels of a row that a block may cover beyond the window: they are masked but read.
const _: () = assert!(LANES <= super::plane::MARGIN);
