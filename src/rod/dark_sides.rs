//! The sides of a rod at its dark parts.
//!
//! Light that comes from one side fades across a light tape, which may end in the grey of the ground. Dark paint is dark on
//! both sides.

use super::axis::Axis;
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
    let differs = (ours.value - theirs.value).abs() > CHANCE_SIGMAS * ours.sigma.hypot(theirs.sigma);
    differs.then_some(found)
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
