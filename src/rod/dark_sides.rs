//! The sides of a rod at its dark parts.
//!
//! Light that comes from one side fades across a light tape, which may end in the grey of the ground. Dark paint is dark on
//! both sides.

use super::axis::{Axis, Side};
use super::cylinder::TapeSides;
use super::edge_fit::fit_step_edge;
use super::profiles::{Direction, ExpectedEdge};
use super::shading::{ExpectedRod, fit_axis};
use crate::image::ImageView;
use crate::results::Estimate;

/// The reach of profiles from a side, px.
const REACH_PX: usize = 8;
/// The uncertainty of a side beyond the scatter of its rows, px: the ground is not even.
const SIDE_SIGMA_PX: f64 = 0.03;
/// The difference of two axes that chance explains, sigmas.
const CHANCE_SIGMAS: f64 = 3.0;

/// Returns the axis by the sides at the dark parts, near the axis `near`, if it contradicts that.
///
/// `None` where it agrees, or where the dark parts do not stand out from a lighter ground.
pub(super) fn fit_contradicting_axis(image: ImageView<'_>, expected: &ExpectedRod<'_>, near: &Axis) -> Option<Axis> {
    let parts = expected.dark_parts();
    let sides: Vec<TapeSides> = parts.iter().filter_map(|rows| fit_part(image, *rows, expected, near)).collect();
    let found = fit_axis(&sides, near.tilt())?;
    let middle = |axis: &Axis| {
        let [left, right] = axis.sides.map(|side| side.at);
        let value = 0.5 * (left.value + right.value) + axis.tilt() * (near.middle - axis.middle);
        Estimate { value, sigma: 0.5 * left.sigma.hypot(right.sigma) }
    };
    let (ours, theirs) = (middle(&found), middle(near));
    let apart_px = (ours.value - theirs.value).abs();
    (apart_px > CHANCE_SIGMAS * ours.sigma.hypot(theirs.sigma)).then(|| {
        // One of two methods that contradict each other is wrong, and it may be this one.
        let widened =
            |side: Side| Side { at: Estimate { sigma: side.at.sigma.hypot(0.5 * apart_px), ..side.at }, ..side };
        Axis { sides: found.sides.map(widened), ..found }
    })
}

/// Fits both sides of a dark part; `None` if one is not found, or their distance is not that of the rod.
fn fit_part(image: ImageView<'_>, rows: [usize; 2], expected: &ExpectedRod<'_>, near: &Axis) -> Option<TapeSides> {
    let row = 0.5 * (rows[0] + rows[1]) as f64 - 0.5;
    let side = |index: usize| {
        let profiles = ExpectedEdge {
            direction: Direction::Columns,
            along: rows,
            middle: row,
            near: near.sides[index].at.value + near.tilt() * (row - near.middle),
            slope: near.tilt(),
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
    (min..=max).contains(&width_px).then_some(TapeSides { row, sides_px, middle_sigma_px })
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

    /// The axis whose sides are off by `shift_px`, as certain as 0.1 px.
    fn shifted(shift_px: f64) -> Axis {
        let side = |at: f64| Side {
            at: Estimate { value: at + shift_px, sigma: 0.1 },
            slope: Estimate { value: 0.0, sigma: 0.01 },
        };
        Axis { sides: SIDES_PX.map(side), middle: 30.0 }
    }

    #[test]
    fn dark_parts_contradict_a_shifted_axis_and_no_other() {
        let image = image();
        let expected = ExpectedRod {
            edges_px: &[40.0, 55.0],
            signs: &[1.0, -1.0],
            sides_px: SIDES_PX,
            at_row: 30.0,
            tilt: 0.0,
            width_px: [20.0, 32.0],
            outward_px: 2.0,
            region: PixelRect::whole(70, 60),
        };
        for shift_px in [-0.1, 0.0, 0.1] {
            assert!(fit_contradicting_axis(image.view(), &expected, &shifted(shift_px)).is_none(), "{shift_px}");
        }
        for shift_px in [-1.0, -0.7, 0.7, 1.0] {
            let found = fit_contradicting_axis(image.view(), &expected, &shifted(shift_px));
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
