//! Reference subsets: pixels, gradients and precomputed sums.

use super::illumination::{IlluminationPlane, add_powers};
use super::normal_equations::Moments;
use crate::dic::geometry::{GridPoint, Pixel, Shape, SubsetMask};
use crate::dic::image::{PaddedImage, PreparedFrame};
use crate::numeric::{LANES, Lanes, Vector, invert, vectorized};
use crate::results::PointStatus;

/// The reason why a reference subset cannot be matched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::dic) enum Unusable {
    /// It extends over the edge of the image.
    OutOfFrame,
    /// It has no texture, texture along one direction or in one corner only, or is saturated.
    LowContrast,
}

impl Unusable {
    /// Converts the reason to the status of a point.
    pub(in crate::dic) fn status(self) -> PointStatus {
        match self {
            Self::OutOfFrame => PointStatus::OutOfFrame,
            Self::LowContrast => PointStatus::LowContrast,
        }
    }
}

/// The illumination across a subset.
#[derive(Clone, Copy, PartialEq)]
enum Illumination {
    Uniform,
    /// A plane, which is removed.
    Gradient,
}

/// The standard deviation below which a subset holds nothing but rounding, DN.
const MIN_CONTRAST_DN: f64 = 0.5;

/// The maximum ratio of the displacement variances with unknown and with known deformation.
///
/// Evenly textured subsets have 1.0 to 1.5, half-empty ones 4. Above, the texture lies in a corner and the displacement
/// of the centre is an extrapolation, which any misfit makes wrong.
const MAX_EXTRAPOLATION: f64 = 5.0;

/// The maximum fraction of saturated pixels.
const MAX_SATURATED_FRACTION: f64 = 0.5;

/// Reference pixels, packed like [`SubsetMask::mask`], and their sums.
///
/// The Jacobian of the affine warp is J = (gx, gx dx, gx dy, gy, gy dx, gy dy).
#[derive(Debug, Clone, Default)]
pub(in crate::dic) struct ReferenceSubset {
    /// The grey levels minus their mean; 0 off the mask.
    pub(in crate::dic) levels: Vec<Lanes>,
    /// The gradient along x; 0 off the mask.
    pub(in crate::dic) gradient_x: Vec<Lanes>,
    /// The gradient along y; 0 off the mask.
    pub(in crate::dic) gradient_y: Vec<Lanes>,
    /// The mean grey level minus the frame's offset.
    pub(in crate::dic) mean: f32,
    /// The root mean square of the levels of its frame, DN.
    pub(in crate::dic) contrast: f32,
    /// The sum of `levels` squared.
    pub(in crate::dic) energy: f64,
    /// The sum of J.
    pub(in crate::dic) jacobian_sum: [f64; 6],
    /// The sum of J times `levels`.
    pub(in crate::dic) jacobian_levels: [f64; 6],
    /// The inverse of the sum of J J^T, for the parameters of the shape function.
    pub(in crate::dic) inverse: [[f64; 6]; 6],
    /// The error of u, v (px) and rotation (rad) of a rigid match per unit dilatation, caused by edges that lie more to
    /// one side.
    pub(in crate::dic) lever: [f64; 3],
    /// The fraction of the gradient energy in the weaker direction, 0 to 0.5.
    pub(in crate::dic) isotropy: f64,
    /// The ratio of gradient energy to grey-level energy: 0.9 for white noise, far less for speckle.
    pub(in crate::dic) roughness: f64,
    /// The gradient energy per pixel in the weaker direction, DN^2/px^2.
    pub(in crate::dic) weak_gradient: f64,
    /// The illumination plane, if it is removed. `energy`, `jacobian_levels` and `inverse` are then without it.
    pub(in crate::dic) light: Option<IlluminationPlane>,
}

impl ReferenceSubset {
    /// Extracts the subset centred at `at` in `reference`, reusing memory.
    ///
    /// # Errors
    ///
    /// [`Unusable`] if the subset extends over the edge or its texture cannot be matched.
    pub(in crate::dic) fn fill(
        &mut self,
        reference: &PreparedFrame,
        window: &SubsetMask,
        shape: Shape,
        at: GridPoint,
    ) -> Result<(), Unusable> {
        self.load_levels(reference, window, at)?;
        self.compute_sums(window, shape, Illumination::Uniform)
    }

    /// Extracts a whole rigid body and removes its illumination plane, unless its pixels span none.
    ///
    /// # Errors
    ///
    /// See [`Self::fill`].
    pub(in crate::dic) fn fill_body(
        &mut self,
        reference: &PreparedFrame,
        window: &SubsetMask,
        at: GridPoint,
    ) -> Result<(), Unusable> {
        self.load_levels(reference, window, at)?;
        self.compute_sums(window, Shape::Rigid, Illumination::Gradient)
    }

    /// Restricts `whole` to the pixels of `window`, which must have the same blocks.
    ///
    /// If the illumination plane of `whole` was removed, that of the part is removed too.
    ///
    /// # Errors
    ///
    /// [`Unusable::LowContrast`] if the texture of these pixels cannot be matched.
    pub(in crate::dic) fn restrict(&mut self, whole: &Self, window: &SubsetMask, shape: Shape) -> Result<(), Unusable> {
        for (out, from) in [
            (&mut self.levels, &whole.levels),
            (&mut self.gradient_x, &whole.gradient_x),
            (&mut self.gradient_y, &whole.gradient_y),
        ] {
            out.clear();
            out.extend(from.iter().zip(&window.mask).map(|(value, mask)| *value * *mask));
        }
        self.contrast = whole.contrast;
        // `whole` has zero mean, so this sum gives the difference between the two means.
        let sum: f64 = self.levels.iter().map(|row| row.sum()).sum();
        let difference = (sum / window.pixels.max(1) as f64) as f32;
        self.mean = whole.mean + difference;
        self.subtract_mean(window, difference);
        self.compute_sums(
            window,
            shape,
            if whole.light.is_some() { Illumination::Gradient } else { Illumination::Uniform },
        )
    }

    /// Computes the sums from grey levels and gradients. With [`Illumination::Gradient`] they are without the plane.
    ///
    /// The stored levels and gradients keep the plane.
    ///
    /// # Errors
    ///
    /// [`Unusable::LowContrast`] if the texture cannot be matched.
    fn compute_sums(&mut self, window: &SubsetMask, shape: Shape, illumination: Illumination) -> Result<(), Unusable> {
        self.check_contrast(window.pixels)?;
        let mut hessian = self.sum_gradients(window);
        self.light = (illumination == Illumination::Gradient)
            .then(|| IlluminationPlane::fit(&self.levels, [&self.gradient_x, &self.gradient_y], window))
            .flatten();
        if let Some(light) = &self.light {
            light.remove_from_hessian(&self.jacobian_sum, window.pixels, &mut hessian);
            let slopes = light.slopes;
            self.energy -= light.energy(slopes);
            for (k, sum) in self.jacobian_levels.iter_mut().enumerate() {
                *sum -= light.jacobian_product(slopes, k);
            }
            self.check_contrast(window.pixels)?;
        }
        self.analyse_texture(&hessian, window.pixels, shape)
    }

    /// Computes the sums for one Gauss-Newton step from `moments` over `pixels` pixels.
    ///
    /// The pixels are not stored. `contrast` and `light` stay as they were.
    ///
    /// # Errors
    ///
    /// [`Unusable::LowContrast`] if the texture cannot be matched.
    pub(in crate::dic) fn fill_from_moments(
        &mut self,
        moments: &Moments,
        pixels: usize,
        shape: Shape,
    ) -> Result<(), Unusable> {
        let mean = moments.reference / pixels as f64;
        self.mean = mean as f32;
        self.energy = moments.products[0] - moments.reference * mean;
        self.jacobian_sum = moments.jacobian[0];
        self.jacobian_levels = std::array::from_fn(|k| moments.jacobian[1][k] - mean * moments.jacobian[0][k]);
        self.check_contrast(pixels)?;
        self.analyse_texture(&hessian_from_moments(&moments.second), pixels, shape)
    }

    /// Checks that the standard deviation of the levels is at least [`MIN_CONTRAST_DN`].
    ///
    /// # Errors
    ///
    /// [`Unusable::LowContrast`] otherwise.
    fn check_contrast(&self, pixels: usize) -> Result<(), Unusable> {
        let contrast = (self.energy / pixels as f64).sqrt();
        // Written so that NaN is refused.
        if contrast >= MIN_CONTRAST_DN { Ok(()) } else { Err(Unusable::LowContrast) }
    }

    /// Computes the quantities that follow from the Hessian, over `pixels` pixels: inverse, lever, isotropy, roughness
    /// and weak gradient.
    ///
    /// # Errors
    ///
    /// [`Unusable::LowContrast`] if the Hessian is singular, or the texture lies in a corner ([`MAX_EXTRAPOLATION`]).
    fn analyse_texture(&mut self, hessian: &[[f64; 6]; 6], pixels: usize, shape: Shape) -> Result<(), Unusable> {
        let (projected, count) = project_matrix(shape, hessian);
        let Some(inverse) = invert(&projected, count) else { return Err(Unusable::LowContrast) };
        self.inverse = inverse;
        let (xx, xy, yy) = (hessian[0][0], hessian[0][3], hessian[3][3]);
        if count == 6 {
            // The variances of u and v with known deformation.
            let determinant = xx * yy - xy * xy;
            let (known_u, known_v) = (yy / determinant, xx / determinant);
            if self.inverse[0][0] > MAX_EXTRAPOLATION * known_u || self.inverse[3][3] > MAX_EXTRAPOLATION * known_v {
                return Err(Unusable::LowContrast);
            }
        }
        if let Shape::Rigid = shape {
            let (grown, _) = project(shape, &std::array::from_fn(|k| hessian[k][1] + hessian[k][5]));
            self.lever = std::array::from_fn(|k| (0..3).map(|j| self.inverse[k][j] * grown[j]).sum());
        }
        let weaker = 0.5 * (xx + yy) - (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
        self.isotropy = weaker / (xx + yy);
        self.roughness = 0.5 * (xx + yy) / self.energy;
        self.weak_gradient = weaker / pixels as f64;
        Ok(())
    }

    /// Loads the grey levels of the subset at `at`, relative to their mean, and their gradients.
    ///
    /// # Errors
    ///
    /// Returns `OutOfFrame` if the subset leaves the image, and `LowContrast` if too many of its pixels are
    /// saturated.
    fn load_levels(&mut self, reference: &PreparedFrame, window: &SubsetMask, at: GridPoint) -> Result<(), Unusable> {
        let at = reference.local(at);
        if !window.extent.fits(at, reference.levels.size()) {
            return Err(Unusable::OutOfFrame);
        }
        self.contrast = reference.contrast;
        let pixels = window.pixels as f64;
        let sum = copy_window(&reference.levels, window, at, &mut self.levels);
        if reference.saturation.is_finite() {
            let saturation = reference.saturation - 0.5;
            let over = |(levels, mask): (&Lanes, &Lanes)| {
                levels.0.iter().zip(mask.0).filter(|(level, mask)| **level >= saturation && *mask > 0.5).count()
            };
            let saturated: usize = self.levels.iter().zip(&window.mask).map(over).sum();
            if saturated as f64 > MAX_SATURATED_FRACTION * pixels {
                return Err(Unusable::LowContrast);
            }
        }
        self.mean = (sum / pixels) as f32;
        self.subtract_mean(window, self.mean);
        copy_window(&reference.gradient_x, window, at, &mut self.gradient_x);
        copy_window(&reference.gradient_y, window, at, &mut self.gradient_y);
        Ok(())
    }

    /// Subtracts `mean` from the grey levels on the mask and sets `energy` to the sum of their squares.
    fn subtract_mean(&mut self, window: &SubsetMask, mean: f32) {
        self.energy = 0.0;
        for block in &window.blocks {
            let rows = block.start..block.start + block.rows;
            self.energy += subtract_mean_on_mask(&mut self.levels[rows.clone()], &window.mask[rows], mean);
        }
    }

    /// Computes the sums of J and of J times the levels, and returns the sum of J J^T, the Hessian.
    fn sum_gradients(&mut self, window: &SubsetMask) -> [[f64; 6]; 6] {
        self.jacobian_sum = [0.0; 6];
        self.jacobian_levels = [0.0; 6];
        let mut moments = [[0.0; 6]; 3];
        for block in &window.blocks {
            let rows = block.start..block.start + block.rows;
            let (gx, gy) = (&self.gradient_x[rows.clone()], &self.gradient_y[rows.clone()]);
            let mut sums = GradientSums::default();
            second_moments(gx, gy, block.dy, &mut sums);
            first_moments(gx, gy, &self.levels[rows], block.dy, &mut sums);
            sums.add_lanes_to(f64::from(block.dx), &mut moments, &mut self.jacobian_sum, &mut self.jacobian_levels);
        }
        hessian_from_moments(&moments)
    }
}

/// Copies the pixels of a window centred at `at` from a plane, 0 off the mask, and returns their sum.
fn copy_window(plane: &PaddedImage, window: &SubsetMask, at: Pixel, out: &mut Vec<Lanes>) -> f64 {
    out.resize(window.mask.len(), Lanes::splat(0.0));
    let mut sum = 0.0;
    for block in &window.blocks {
        let first = plane.index((at.x + block.dx) as isize, (at.y + block.dy) as isize);
        let rows = block.start..block.start + block.rows;
        sum += pack_block(&plane.data()[first..], plane.stride(), &window.mask[rows.clone()], &mut out[rows]);
    }
    sum
}

/// The sums over the rows of one block, lane by lane.
#[derive(Default)]
struct GradientSums {
    /// The sums of gx gx, gx gy and gy gy, each times 1, dy, dy^2.
    second: [[Lanes; 3]; 3],
    /// The sums of gx and gy, each times 1, dy.
    plain: [[Lanes; 2]; 2],
    /// The same times the grey level.
    levels: [[Lanes; 2]; 2],
}

impl GradientSums {
    /// Adds the sums of the lanes to the sums of the subset. `dx` is the offset of the first column from the centre.
    ///
    /// `moments` are those of [`Moments::second`], `plain` is the sum of J, and `levels` the sum of J times the level.
    fn add_lanes_to(&self, dx: f64, moments: &mut [[f64; 6]; 3], plain: &mut [f64; 6], levels: &mut [f64; 6]) {
        for (moments, powers) in moments.iter_mut().zip(&self.second) {
            let products = powers[0].moments(dx);
            let mixed = powers[1].moments(dx);
            moments[0] += products[0];
            moments[1] += products[1];
            moments[2] += mixed[0];
            moments[3] += products[2];
            moments[4] += mixed[1];
            moments[5] += powers[2].sum();
        }
        for (sums, parts) in [(plain, &self.plain), (levels, &self.levels)] {
            for (half, [plain, lever]) in parts.iter().enumerate() {
                let moments = plain.moments(dx);
                sums[3 * half] += moments[0];
                sums[3 * half + 1] += moments[1];
                sums[3 * half + 2] += lever.sum();
            }
        }
    }
}

vectorized! {
    /// Copies a block of eight columns from a plane, 0 off the mask, and returns the sum of its values.
    fn pack_block(source: &[f32], stride: usize, mask: &[Lanes], out: &mut [Lanes]) -> f64 = pack_block_with
}

/// Implements [`pack_block`] on vectors of type `V`.
#[inline(always)]
fn pack_block_with<V: Vector>(source: &[f32], stride: usize, mask: &[Lanes], out: &mut [Lanes]) -> f64 {
    let mut total = V::splat(0.0);
    for (row, (mask, out)) in mask.iter().zip(out).enumerate() {
        let value = V::load(&source[row * stride..]).mul(V::from_lanes(mask));
        total = total.add(value);
        *out = value.to_lanes();
    }
    total.to_lanes().sum()
}

vectorized! {
    /// Subtracts `mean` from the levels on the mask and returns the sum of their squares.
    fn subtract_mean_on_mask(levels: &mut [Lanes], mask: &[Lanes], mean: f32) -> f64 = subtract_mean_on_mask_with
}

/// Implements [`subtract_mean_on_mask`] on vectors of type `V`.
#[inline(always)]
fn subtract_mean_on_mask_with<V: Vector>(levels: &mut [Lanes], mask: &[Lanes], mean: f32) -> f64 {
    let (mut energy, mean) = (V::splat(0.0), V::splat(mean));
    for (levels, mask) in levels.iter_mut().zip(mask) {
        let value = V::from_lanes(levels).sub(mean.mul(V::from_lanes(mask)));
        energy = energy.add(value.mul(value));
        *levels = value.to_lanes();
    }
    energy.to_lanes().sum()
}

vectorized! {
    /// Sums the products of the gradients, times 1, dy and dy^2, lane by lane. `dy` is the offset of the first row.
    fn second_moments(gx: &[Lanes], gy: &[Lanes], dy: i32, sums: &mut GradientSums) = second_moments_with
}

/// Implements [`second_moments`] on vectors of type `V`.
#[inline(always)]
fn second_moments_with<V: Vector>(gx: &[Lanes], gy: &[Lanes], dy: i32, sums: &mut GradientSums) {
    let zero = V::splat(0.0);
    let (mut xx, mut xy, mut yy) = ([zero; 3], [zero; 3], [zero; 3]);
    for (dy, (gx, gy)) in (dy..).zip(gx.iter().zip(gy)) {
        let (gx, gy, dy) = (V::from_lanes(gx), V::from_lanes(gy), V::splat(dy as f32));
        add_powers(&mut xx, gx.mul(gx), dy);
        add_powers(&mut xy, gx.mul(gy), dy);
        add_powers(&mut yy, gy.mul(gy), dy);
    }
    for (to, from) in sums.second.iter_mut().zip([xx, xy, yy]) {
        *to = [from[0].to_lanes(), from[1].to_lanes(), from[2].to_lanes()];
    }
}

vectorized! {
    /// Sums the gradients, and the gradients times the grey level, times 1 and dy, lane by lane. `dy` is the offset of
    /// the first row.
    fn first_moments(gx: &[Lanes], gy: &[Lanes], levels: &[Lanes], dy: i32, sums: &mut GradientSums) =
        first_moments_with
}

/// Implements [`first_moments`] on vectors of type `V`.
#[inline(always)]
fn first_moments_with<V: Vector>(gx: &[Lanes], gy: &[Lanes], levels: &[Lanes], dy: i32, sums: &mut GradientSums) {
    let zero = V::splat(0.0);
    let (mut plain, mut lever, mut with_levels, mut lever_levels) = ([zero; 2], [zero; 2], [zero; 2], [zero; 2]);
    for (dy, ((gx, gy), level)) in (dy..).zip(gx.iter().zip(gy).zip(levels)) {
        let (level, dy) = (V::from_lanes(level), V::splat(dy as f32));
        let gradient = [V::from_lanes(gx), V::from_lanes(gy)];
        for half in 0..2 {
            let product = gradient[half].mul(level);
            plain[half] = plain[half].add(gradient[half]);
            lever[half] = lever[half].add(gradient[half].mul(dy));
            with_levels[half] = with_levels[half].add(product);
            lever_levels[half] = lever_levels[half].add(product.mul(dy));
        }
    }
    for half in 0..2 {
        sums.plain[half] = [plain[half].to_lanes(), lever[half].to_lanes()];
        sums.levels[half] = [with_levels[half].to_lanes(), lever_levels[half].to_lanes()];
    }
}

/// Returns the sum of J J^T from the moments of gx gx, gx gy and gy gy: see [`Moments::second`].
fn hessian_from_moments(moments: &[[f64; 6]; 3]) -> [[f64; 6]; 6] {
    // The moment (1, dx, dy, dx^2, dx dy, dy^2) of each pair of (1, dx, dy).
    const PLACE: [[usize; 3]; 3] = [[0, 1, 2], [1, 3, 4], [2, 4, 5]];
    let mut hessian = [[0.0; 6]; 6];
    for (row, line) in hessian.iter_mut().enumerate() {
        for (column, value) in line.iter_mut().enumerate() {
            *value = moments[row / 3 + column / 3][PLACE[row % 3][column % 3]];
        }
    }
    hessian
}

/// Converts sums over the affine J to those for the parameters of the shape function, and returns their number.
///
/// The values beyond that number are 0. A quadratic shape function has the sums of the affine one.
pub(in crate::dic) fn project(shape: Shape, affine: &[f64; 6]) -> ([f64; 6], usize) {
    match shape {
        Shape::Translation => ([affine[0], affine[3], 0.0, 0.0, 0.0, 0.0], 2),
        // A counter-clockwise rotation moves (dx, dy) by (dy, -dx).
        Shape::Rigid => ([affine[0], affine[3], affine[2] - affine[4], 0.0, 0.0, 0.0], 3),
        Shape::Affine | Shape::Quadratic => (*affine, 6),
    }
}

/// Applies [`project`] to the rows and the columns of a matrix, and returns the number of parameters.
fn project_matrix(shape: Shape, affine: &[[f64; 6]; 6]) -> ([[f64; 6]; 6], usize) {
    if matches!(shape, Shape::Affine | Shape::Quadratic) {
        return (*affine, 6);
    }
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

/// A block may extend this far beyond the window: the pixels are masked but read.
const _: () = assert!(LANES <= crate::dic::image::MARGIN);
