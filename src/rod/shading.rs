//! A rod under light that varies across it: its axis and the light on its tapes.

use super::axis::{Axis, Side, weighted_mean};
use super::cylinder::{TapeProfile, TapeSides};
use super::observation::INSET_PX;
use super::tape_light::{TapeLight, TapeShape};
use crate::image::ImageView;
use crate::results::{Estimate, ROD_EDGES};

/// The ratio of the darkest to the brightest light across a tape below which it counts as shaded.
///
/// Above it, a line across the paint and a parabola along an edge describe the light.
const MAX_EVENNESS: f64 = 0.8;
/// The margin of rows to the edges of a tape, and the minimum number of rows between them, px.
const EDGE_MARGIN_PX: f64 = 3.0;
const MIN_ROWS: usize = 5;
/// The reach beyond the outermost edge of a section that ends there only, px.
const OUTER_REACH_PX: f64 = 24.0;
/// The uncertainty of the tilt if a single tape shows it, columns per row.
const TILT_SIGMA: f64 = 0.02;
/// The number of passes: the tilt of the first improves the second.
const PASSES: usize = 2;

/// The expected place of a rod.
pub(super) struct ExpectedRod<'a> {
    pub(super) edges_px: &'a [f64],
    /// 1 for an edge below which it is lighter, -1 for one below which it is darker.
    pub(super) signs: &'a [f64],
    /// The sides at the row `at_row`, px.
    pub(super) sides_px: [f64; 2],
    pub(super) at_row: f64,
    /// Columns per row.
    pub(super) tilt: f64,
    /// The minimum and the maximum width, px.
    pub(super) width_px: [f64; 2],
    /// Left, top, width, height.
    pub(super) region: [usize; 4],
}

/// A rod whose light varies across it.
pub(super) struct ShadedRod {
    pub(super) axis: Axis,
    /// The light next to each edge.
    pub(super) lights: [Option<TapeLight>; ROD_EDGES],
}

/// The rows of a light part of the rod, between these edges.
struct LightPart {
    rows: [f64; 2],
    edges: [Option<usize>; 2],
}

impl LightPart {
    /// Returns the rows clear of its edges, first and one past the last.
    fn inner_rows(&self) -> [usize; 2] {
        [(self.rows[0] + EDGE_MARGIN_PX).ceil().max(0.0) as usize, (self.rows[1] - EDGE_MARGIN_PX).floor() as usize + 1]
    }
}

impl ExpectedRod<'_> {
    /// Returns the light parts of the rod that are high enough, from the top downwards.
    fn light_parts(&self) -> Vec<LightPart> {
        let [_, top, _, height] = self.region;
        let (top, bottom) = (top as f64, (top + height) as f64 - 1.0);
        let count = self.edges_px.len();
        let part = |below: usize| {
            let (above, below) = (below.checked_sub(1), (below < count).then_some(below));
            let is_light = above.map_or_else(|| self.signs[0] < 0.0, |edge| self.signs[edge] > 0.0);
            let upper = above.map_or(self.edges_px[0] - OUTER_REACH_PX, |edge| self.edges_px[edge]);
            let lower = below.map_or(self.edges_px[count - 1] + OUTER_REACH_PX, |edge| self.edges_px[edge]);
            let part = LightPart { rows: [upper.max(top), lower.min(bottom)], edges: [above, below] };
            let [from, to] = part.inner_rows();
            (is_light && to >= from + MIN_ROWS).then_some(part)
        };
        (0..=count).filter_map(part).collect()
    }

    /// Returns the profile of a light part across a rod with these sides and this tilt at the row `at_row`.
    fn profile(&self, image: ImageView<'_>, part: &LightPart, place: &Place) -> Option<TapeProfile> {
        let [left, _, width, _] = self.region;
        let rows = part.inner_rows();
        let row = 0.5 * (rows[0] + rows[1]) as f64 - 0.5;
        TapeProfile::read(image, rows, place.sides_at(row), place.tilt, [left, left + width - 1])
    }
}

/// Two sides and their tilt.
#[derive(Clone, Copy)]
struct Place {
    sides_px: [f64; 2],
    at_row: f64,
    tilt: f64,
}

impl Place {
    fn sides_at(&self, row: f64) -> [f64; 2] {
        self.sides_px.map(|side| side + self.tilt * (row - self.at_row))
    }
}

impl ShadedRod {
    /// Fits axis and light near an expected rod; `None` if it is lit evenly or not determined.
    pub(super) fn fit(image: ImageView<'_>, expected: &ExpectedRod<'_>) -> Option<Self> {
        let parts = expected.light_parts();
        let mut place =
            Place { sides_px: expected.sides_px, at_row: expected.at_row, tilt: expected.tilt };
        let mut axis = None;
        for _ in 0..PASSES {
            let profiles: Vec<TapeProfile> =
                parts.iter().filter_map(|part| expected.profile(image, part, &place)).collect();
            // Speckles look like shading, a clean tape does not.
            let evenness = profiles.iter().map(|profile| profile.evenness(place.sides_at(profile.row)));
            if evenness.fold(0.0, f64::max) >= MAX_EVENNESS {
                return None;
            }
            let sides: Vec<TapeSides> = profiles
                .iter()
                .filter_map(|profile| profile.fit_sides(place.sides_at(profile.row), expected.width_px))
                .collect();
            let found = fit_axis(&sides, place.tilt)?;
            place = Place {
                sides_px: found.sides.map(|side| side.at.value),
                at_row: found.middle,
                tilt: found.sides[0].slope.value,
            };
            axis = Some((found, sides));
        }
        let (axis, sides) = axis?;
        let mut lights = [None; ROD_EDGES];
        for part in &parts {
            let light = fit_light(image, part, &place, &sides);
            part.edges.into_iter().flatten().for_each(|edge| lights[edge] = light);
        }
        Some(Self { axis, lights })
    }
}

/// Fits the light on a part of a rod.
fn fit_light(image: ImageView<'_>, part: &LightPart, place: &Place, sides: &[TapeSides]) -> Option<TapeLight> {
    let rows = part.inner_rows();
    let row = 0.5 * (rows[0] + rows[1]) as f64 - 0.5;
    let across = sides.iter().find(|sides| (sides.row - row).abs() < 0.5)?;
    let [left, right] = place.sides_at(row);
    let shape = TapeShape {
        middle_px: [0.5 * (left + right), row],
        half_width_px: 0.5 * (right - left),
        half_height_px: 0.5 * (part.rows[1] - part.rows[0]),
        tilt: place.tilt,
    };
    let columns = [(left + INSET_PX).ceil().max(0.0) as usize, (right - INSET_PX).floor().max(0.0) as usize + 1];
    TapeLight::fit(image, shape, columns, rows, across.light_dn)
}

/// Fits the axis to the sides at each tape. A single tape keeps the `tilt`.
fn fit_axis(tapes: &[TapeSides], tilt: f64) -> Option<Axis> {
    let count = tapes.len() as f64;
    let half = |tape: &TapeSides| {
        let [a, b] = tape.sides_px;
        Estimate { value: 0.5 * (b.value - a.value), sigma: 0.5 * a.sigma.hypot(b.sigma) }
    };
    let middle = |tape: &TapeSides| Estimate {
        value: 0.5 * (tape.sides_px[0].value + tape.sides_px[1].value),
        sigma: tape.middle_sigma_px,
    };
    (!tapes.is_empty()).then_some(())?;
    let row = tapes.iter().map(|tape| tape.row).sum::<f64>() / count;
    let spread: f64 = tapes.iter().map(|tape| (tape.row - row).powi(2)).sum();
    let slope = match tapes.len() {
        1 => Estimate { value: tilt, sigma: TILT_SIGMA },
        _ => Estimate {
            value: tapes.iter().map(|tape| (tape.row - row) * middle(tape).value).sum::<f64>() / spread,
            sigma: tapes.iter().map(|tape| ((tape.row - row) * tape.middle_sigma_px).powi(2)).sum::<f64>().sqrt() / spread,
        },
    };
    let level = |tape: &TapeSides| {
        let middle = middle(tape);
        Estimate { value: middle.value - slope.value * (tape.row - row), ..middle }
    };
    let (middle, half) = (weighted_mean(tapes.iter().map(level)), weighted_mean(tapes.iter().map(half)));
    // Both sides are uncertain by the middle and by the width.
    let sigma = middle.sigma.max(half.sigma) * std::f64::consts::SQRT_2;
    let side = |value: f64| Side { at: Estimate { value, sigma }, slope };
    Some(Axis { sides: [side(middle.value - half.value), side(middle.value + half.value)], middle: row })
}
