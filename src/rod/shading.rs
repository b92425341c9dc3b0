//! A rod under light that varies across it: its axis and the light on its tapes.

use super::axis::{Axis, Side, weighted_mean};
use super::cylinder::{Room, TapeProfile, TapeSides, fit_tapes};
use super::observation::INSET_PX;
use super::tape_light::{TapeLight, TapePlace};
use crate::image::{ImageView, PixelRect};
use crate::results::{Estimate, ROD_EDGES};

/// The ratio of the darkest to the brightest light across a tape below which it counts as shaded.
///
/// Above it, a line across the paint and a parabola along an edge describe the light.
const MAX_EVENNESS: f64 = 0.8;
/// The ratio above which the light is even. Below it, light that falls towards the sides may move their steps inwards.
const EVEN: f64 = 0.93;
/// The margin of rows to the edges of a tape, and the minimum number of rows between them, px.
const EDGE_MARGIN_PX: f64 = 3.0;
const MIN_ROWS: usize = 5;
/// The rows next to an edge that show its light: their margin to the edge and their reach, px.
const LIGHT_MARGIN_PX: f64 = 2.5;
const LIGHT_REACH_PX: f64 = 10.5;
/// The reach beyond the outermost edge of a section that ends there only, px.
const OUTER_REACH_PX: f64 = 24.0;
/// The uncertainty of the tilt if a single tape shows it, columns per row.
const TILT_SIGMA: f64 = 0.02;
/// The distance of a side outside its expected position if that was fitted, px.
pub(super) const CLOSE_PX: f64 = 2.0;
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
    /// The maximum distance of a side outside its expected position, px.
    pub(super) outward_px: f64,
    /// The searched region.
    pub(super) region: PixelRect,
}

/// A rod whose light varies across it.
pub(super) struct ShadedRod {
    pub(super) axis: Axis,
    place: Place,
    height_px: usize,
    /// The ratio of the darkest to the brightest light across the tape with the most even light.
    evenness: f64,
}

/// Returns the rows between two edges and clear of them, px, first and one past the last.
fn inner_rows([from, to]: [f64; 2]) -> [usize; 2] {
    [(from + EDGE_MARGIN_PX).ceil().max(0.0) as usize, (to - EDGE_MARGIN_PX).floor().max(-1.0) as usize + 1]
}

impl ExpectedRod<'_> {
    /// Returns the rows of the light parts of the rod that are high enough, from the top downwards.
    fn light_parts(&self) -> Vec<[usize; 2]> {
        let (top, bottom) = (f64::from(self.region.top), f64::from(self.region.bottom) - 1.0);
        let count = self.edges_px.len();
        let part = |below: usize| {
            let (above, below) = (below.checked_sub(1), (below < count).then_some(below));
            let is_light = above.map_or_else(|| self.signs[0] < 0.0, |edge| self.signs[edge] > 0.0);
            let upper = above.map_or(self.edges_px[0] - OUTER_REACH_PX, |edge| self.edges_px[edge]);
            let lower = below.map_or(self.edges_px[count - 1] + OUTER_REACH_PX, |edge| self.edges_px[edge]);
            let rows = inner_rows([upper.max(top), lower.min(bottom)]);
            (is_light && rows[1] >= rows[0] + MIN_ROWS).then_some(rows)
        };
        (0..=count).filter_map(part).collect()
    }

    /// Returns the rows of the dark parts above the edges that are high enough, from the top downwards.
    pub(super) fn dark_parts(&self) -> Vec<[usize; 2]> {
        let top = f64::from(self.region.top);
        let part = |index: usize| {
            let (edge, sign) = (self.edges_px[index], self.signs[index]);
            let above = index.checked_sub(1).map_or(edge - OUTER_REACH_PX, |above| self.edges_px[above]);
            let rows = inner_rows([above.max(top), edge]);
            (sign > 0.0 && rows[1] >= rows[0] + MIN_ROWS).then_some(rows)
        };
        (0..self.edges_px.len()).filter_map(part).collect()
    }

    /// Returns the profile of some rows across a rod at this place.
    fn profile(&self, image: ImageView<'_>, rows: [usize; 2], place: &Place) -> Option<TapeProfile> {
        let row = 0.5 * (rows[0] + rows[1]) as f64 - 0.5;
        let room =
            Room { columns: [self.region.columns().start, self.region.columns().end - 1], outward_px: self.outward_px };
        TapeProfile::read(image, rows, place.sides_at(row), place.tilt, room)
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
        let mut parts = expected.light_parts();
        // The lowest part is read fastest, and a single one with even light ends the search.
        parts.sort_by_key(|rows| rows[1] - rows[0]);
        let mut place = Place { sides_px: expected.sides_px, at_row: expected.at_row, tilt: expected.tilt };
        let (mut axis, mut outward_px, mut evenness) = (None, expected.outward_px, 0.0);
        for _ in 0..PASSES {
            let mut profiles = Vec::with_capacity(parts.len());
            evenness = 0.0;
            for profile in parts.iter().filter_map(|rows| expected.profile(image, *rows, &place)) {
                // Speckles look like shading, a clean tape does not.
                evenness = profile.evenness(place.sides_at(profile.row)).max(evenness);
                if evenness >= EVEN {
                    return None;
                }
                profiles.push(profile);
            }
            profiles.sort_by(|a, b| a.row.total_cmp(&b.row));
            let near: Vec<[f64; 2]> = profiles.iter().map(|profile| place.sides_at(profile.row)).collect();
            let sides = fit_tapes(&profiles, &near, expected.width_px, outward_px)?;
            let found = fit_axis(&sides, place.tilt)?;
            // The next pass starts from these sides.
            outward_px = CLOSE_PX;
            place = Place {
                sides_px: found.sides.map(|side| side.at.value),
                at_row: found.middle,
                tilt: found.sides[0].slope.value,
            };
            axis = Some(found);
        }
        Some(Self { axis: axis?, place, height_px: image.height(), evenness })
    }

    /// Returns the rod unless its light is nearly even and its sides are the steps of `stepped`.
    ///
    /// Sides that contradict the steps are as uncertain as half of their distance from them, since one of the two models
    /// of the light is wrong.
    pub(super) fn unless_stepped(self, stepped: Option<&Axis>) -> Option<Self> {
        let Some(stepped) = stepped else { return Some(self) };
        if self.axis.agrees_with(stepped) {
            return (self.evenness < MAX_EVENNESS).then_some(self);
        }
        Some(Self { axis: self.axis.widened_towards(stepped), ..self })
    }

    /// Returns the rod with another axis.
    pub(super) fn with_axis(self, axis: Axis) -> Self {
        let place = Place {
            sides_px: axis.sides.map(|side| side.at.value),
            at_row: axis.middle,
            tilt: axis.sides[0].slope.value,
        };
        Self { axis, place, ..self }
    }

    /// Fits the light next to each edge, on its lighter side; `signs` are 1 for edges below which it is lighter.
    pub(super) fn lights(
        &self,
        image: ImageView<'_>,
        edges_px: &[f64],
        signs: &[f64],
    ) -> [Option<TapeLight>; ROD_EDGES] {
        let light = |index: usize| {
            let (edge, sign) = (*edges_px.get(index)?, signs[index]);
            let neighbor = match sign > 0.0 {
                true => edges_px.get(index + 1),
                false => index.checked_sub(1).and_then(|above| edges_px.get(above)),
            };
            let height = neighbor.map_or(LIGHT_REACH_PX, |neighbor| (neighbor - edge).abs() - LIGHT_MARGIN_PX);
            let reach = sign * LIGHT_REACH_PX.min(height);
            let margin = sign * LIGHT_MARGIN_PX;
            let [from, to] = if sign > 0.0 { [edge + margin, edge + reach] } else { [edge + reach, edge + margin] };
            let rows = [from.ceil().max(0.0) as usize, (to.floor().max(-1.0) as usize + 1).min(self.height_px)];
            (rows[1] > rows[0]).then_some(())?;
            let row = 0.5 * (rows[0] + rows[1]) as f64 - 0.5;
            let [left, right] = self.place.sides_at(row);
            let columns =
                [(left + INSET_PX).ceil().max(0.0) as usize, (right - INSET_PX).floor().max(-1.0) as usize + 1];
            let place = TapePlace {
                middle_px: [0.5 * (left + right), row],
                half_width_px: 0.5 * (right - left),
                tilt: self.place.tilt,
                columns,
                rows,
            };
            TapeLight::fit(image, place)
        };
        std::array::from_fn(light)
    }
}

/// Fits the axis to the sides at each tape. A single tape keeps the `tilt`.
pub(super) fn fit_axis(tapes: &[TapeSides], tilt: f64) -> Option<Axis> {
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
            sigma: tapes.iter().map(|tape| ((tape.row - row) * tape.middle_sigma_px).powi(2)).sum::<f64>().sqrt()
                / spread,
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
