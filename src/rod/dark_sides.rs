//! The sides of a rod at its dark parts.
//!
//! Light that comes from one side fades across a light tape, which may end in the grey of the ground. Dark paint is dark on
//! both sides.

use super::axis::{Axis, CHANCE_SIGMAS, Side};
use super::cylinder::TapeSides;
use super::edge_fit::fit_step_edge;
use super::profiles::{Direction, ExpectedEdge};
use super::shading::{ExpectedRod, fit_axis};
use crate::image::ImageView;
use crate::results::Estimate;

/// The reach of profiles from a side, px.
const REACH_PX: usize = 8;
/// The uncertainty of a side beyond the scatter of its rows, px.
///
/// The ground is not even, and dark paint darkens towards its sides, which moves them outwards by up to 0.1 px.
const SIDE_SIGMA_PX: f64 = 0.06;

/// Returns the axis by the sides at the dark parts if it contradicts the axis `near`, or is far more certain.
///
/// `None` where it agrees, or where the dark parts do not stand out from a lighter ground.
pub(super) fn fit_better_axis(image: ImageView<'_>, expected: &ExpectedRod<'_>, near: &Axis) -> Option<Axis> {
    let parts = expected.dark_parts();
    let side_at = |side: &Side, row: f64| side.at.value + near.tilt() * (row - near.middle);
    let fit = |rows: &[usize; 2]| {
        let part = DarkPart { rows: *rows, row: 0.5 * (rows[0] + rows[1]) as f64 - 0.5, tilt: near.tilt() };
        let close = part.fit(image, expected, [0, 1].map(|k| side_at(&near.sides[k], part.row)));
        // The axis may be so far off that the steps are out of reach.
        close.or_else(|| part.fit(image, expected, part.find_steps(image, expected)?))
    };
    let sides: Vec<TapeSides> = parts.iter().filter_map(fit).collect();
    let found = fit_axis(&sides, near.tilt())?;
    let middle = |axis: &Axis| {
        let [left, right] = axis.sides.map(|side| side.at);
        let value = 0.5 * (left.value + right.value) + axis.tilt() * (near.middle - axis.middle);
        Estimate { value, sigma: 0.5 * left.sigma.hypot(right.sigma) }
    };
    let (ours, theirs) = (middle(&found), middle(near));
    let apart_px = (ours.value - theirs.value).abs();
    let is_contradiction = apart_px > CHANCE_SIGMAS * ours.sigma.hypot(theirs.sigma);
    let is_far_better = CHANCE_SIGMAS * ours.sigma < theirs.sigma;
    (is_contradiction || is_far_better).then(|| {
        // One of two methods that contradict each other is wrong, and it may be this one.
        let widened =
            |side: Side| Side { at: Estimate { sigma: side.at.sigma.hypot(0.5 * apart_px), ..side.at }, ..side };
        Axis { sides: found.sides.map(widened), ..found }
    })
}

/// A dark part of the rod.
struct DarkPart {
    /// The rows, first and one past the last, and their middle.
    rows: [usize; 2],
    row: f64,
    /// The tilt of the rod, columns per row.
    tilt: f64,
}

impl DarkPart {
    /// Fits both sides near their expected positions at the middle row, px; `None` if one is not found, or their distance
    /// is not that of the rod.
    fn fit(&self, image: ImageView<'_>, expected: &ExpectedRod<'_>, near_px: [f64; 2]) -> Option<TapeSides> {
        let side = |index: usize| {
            let profiles = ExpectedEdge {
                direction: Direction::Columns,
                along: self.rows,
                middle: self.row,
                near: near_px[index],
                slope: self.tilt,
                depth: [REACH_PX, REACH_PX],
                room: [expected.region.columns().start, expected.region.columns().end - 1],
                // The ground is lighter.
                sign: if index == 0 { -1.0 } else { 1.0 },
                clean: None,
                light: None,
            };
            let edge = fit_step_edge(image, &profiles).ok()?;
            Some(Estimate { sigma: edge.at.sigma.hypot(SIDE_SIGMA_PX), ..edge.at })
        };
        let sides_px = [side(0)?, side(1)?];
        let width_px = sides_px[1].value - sides_px[0].value;
        let middle_sigma_px = 0.5 * sides_px[0].sigma.hypot(sides_px[1].sigma);
        let [min, max] = expected.width_px;
        (min..=max).contains(&width_px).then_some(TapeSides { row: self.row, sides_px, middle_sigma_px })
    }

    /// Finds the steps from the ground to the rod and back to whole pixels, within the widths of the rod.
    ///
    /// It is the pair whose weaker step is the strongest.
    fn find_steps(&self, image: ImageView<'_>, expected: &ExpectedRod<'_>) -> Option<[f64; 2]> {
        let columns = expected.region.columns();
        let first = columns.start as f64 + 1.5;
        let level = |x: usize| (self.rows[0]..self.rows[1]).map(|y| f64::from(image.row(y)[x])).sum::<f64>();
        let levels: Vec<f64> = columns.map(level).collect();
        let steps: Vec<f64> = levels.windows(4).map(|near| near[2] + near[3] - near[0] - near[1]).collect();
        let [min, max] = expected.width_px;
        let mut best: Option<(f64, [usize; 2])> = None;
        for (left, fall) in steps.iter().enumerate() {
            for (right, rise) in steps.iter().enumerate().skip(left + min as usize).take((max - min) as usize + 1) {
                let weaker = rise.min(-fall);
                if weaker > best.map_or(0.0, |(strongest, _)| strongest) {
                    best = Some((weaker, [left, right]));
                }
            }
        }
        best.map(|(_, steps)| steps.map(|step| first + step as f64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{Image, PixelRect};
    use crate::numeric::{Xorshift, normal_cdf};

    const SIDES_PX: [f64; 2] = [21.3, 46.8];
    const BLUR_PX: f64 = 0.9;

    /// A dark rod before lighter ground, with noise.
    fn image() -> Image {
        let mut image = Image::new(70, 60);
        let mut random = Xorshift::default();
        for row in image.rows_mut() {
            for (x, level) in row.iter_mut().enumerate() {
                let blurred = |inside_px: f64| normal_cdf(inside_px / BLUR_PX);
                let inside = blurred(x as f64 - SIDES_PX[0]) * blurred(SIDES_PX[1] - x as f64);
                let noise = (0..12).map(|_| random.below(1000) as f64 / 1000.0).sum::<f64>() - 6.0;
                *level = (70.0 - 45.0 * inside + noise) as f32;
            }
        }
        image
    }

    fn expected() -> ExpectedRod<'static> {
        ExpectedRod {
            edges_px: &[40.0, 55.0],
            signs: &[1.0, -1.0],
            sides_px: SIDES_PX,
            at_row: 30.0,
            tilt: 0.0,
            width_px: [20.0, 32.0],
            outward_px: 2.0,
            region: PixelRect::whole(70, 60),
        }
    }

    /// The axis whose sides are off by `shift_px`.
    fn shifted(shift_px: f64, sigma_px: f64) -> Axis {
        let side = |at: f64| Side {
            at: Estimate { value: at + shift_px, sigma: sigma_px },
            slope: Estimate { value: 0.0, sigma: 0.01 },
        };
        Axis { sides: SIDES_PX.map(side), middle: 30.0 }
    }

    #[test]
    fn far_more_certain_sides_replace_an_axis_that_agrees_with_them() {
        let image = image();
        let found = fit_better_axis(image.view(), &expected(), &shifted(0.6, 0.9)).unwrap();
        for (side, truth) in found.sides.iter().zip(SIDES_PX) {
            assert!((side.at.value - truth).abs() < 0.1 && (0.25..0.5).contains(&side.at.sigma), "{:?}", side.at);
        }
    }

    #[test]
    fn dark_parts_contradict_a_shifted_axis_and_no_other() {
        let image = image();
        let expected = expected();
        for shift_px in [-0.1, 0.0, 0.1] {
            assert!(fit_better_axis(image.view(), &expected, &shifted(shift_px, 0.1)).is_none(), "{shift_px}");
        }
        // The last ones are out of reach of the fit.
        for shift_px in [-1.0, -0.7, 0.7, 1.0, -6.0, 6.0] {
            let found = fit_better_axis(image.view(), &expected, &shifted(shift_px, 0.1));
            let found = found.unwrap_or_else(|| panic!("no other axis at {shift_px}"));
            for (side, truth) in found.sides.iter().zip(SIDES_PX) {
                let error = (side.at.value - truth).abs();
                assert!(
                    error < 0.1 && side.at.sigma > 0.4 * f64::abs(shift_px),
                    "{shift_px}: {error} {}",
                    side.at.sigma
                );
            }
        }
    }
}
