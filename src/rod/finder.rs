//! The rod finder: searches a rod by projections, then to a fraction of a pixel.

use super::axis::{Axis, Side, compose_rod};
use super::dark_sides::fit_better_axis;
use super::edge_fit::{Edge, fit_step_edge};
use super::edge_lines::select_edges;
use super::edge_offsets::{mean_of_predictions, mean_position, offset_px};
use super::observation::{INSET_PX, MARGIN_PX, RodObservation};
use super::paint_shading::clean_paint_at;
use super::params::{RodError, RodParams};
use super::profiles::{CleanPaint, Direction, ExpectedEdge};
use super::projections::{BinaryImage, Line, find_extrema};
use super::shading::{CLOSE_PX, ExpectedRod, ShadedRod};
use super::tape_light::TapeLight;
use super::texture::{mean_square_gradient, noise_dn};
use crate::image::{ImageView, PixelRect};
use crate::results::{Estimate, PointStatus, ROD_EDGES};
use std::ops::Range;

/// The minimum contrast of black and white, in standard deviations of the noise.
const MIN_CONTRAST_SIGMAS: f32 = 6.0;
/// The minimum distance of two lines, px.
const MIN_DISTANCE_PX: usize = 4;
/// The number of lines that are tried as sides.
const SIDES_TRIED: usize = 12;
/// The uncertainty of a side beyond the scatter of its rows, px.
const SIDE_SIGMA_PX: f64 = 0.015;
/// The tolerance of the width, px: sides are first known to whole pixels.
const SIDE_TOLERANCE_PX: f64 = 2.0;
/// The uncertainty of an edge by a threshold, px. Speckles shift it: in 30 random scenes the errors were 0.45 rms.
const THRESHOLD_SIGMA_PX: f64 = 0.5;
/// The minimum net number of rows over which a side changes from black to white.
const MIN_SIDE_ROWS: i32 = 8;
/// The minimum width of the bright part of a shaded rod, as a fraction of the minimum width.
const BRIGHT_FRACTION: f64 = 0.6;
/// The maximum distance of a side outside the bright part of a shaded rod, as a fraction of its width.
const OUTWARD_FRACTION: f64 = 0.35;
/// The minimum fraction of columns between the sides that an edge changes.
const MIN_EDGE_FRACTION: f64 = 0.3;
/// The relative strength of a line's continuation next to the rod from which it does not belong to the rod.
const CONTINUATION_RATIO: f64 = 0.5;
/// The reach of profiles from an edge, and their distance from the next edge, px.
const EDGE_REACH_PX: f64 = 24.0;
const EDGE_MARGIN_PX: f64 = 3.0;
/// The same where the light varies across the rod, and so along it.
const SHADED_REACH_PX: f64 = 12.0;
/// The number of times that the edges of a shaded rod are fitted.
const SHADED_PASSES: usize = 2;
/// The reach of profiles from a side, px.
const SIDE_REACH_PX: usize = 8;
/// The distance of an edge from the ends of the region at which its profiles stay inside, px.
const EDGE_ROOM_PX: f64 = 8.0;
/// The margin of rows to the edges in the search for texture, px.
const TEXTURE_MARGIN_PX: f64 = 3.0;
/// The minimum height of a section for a subset, px.
const MIN_SECTION_PX: f64 = 9.0;

/// Finds one upright rod per image, the edges of its tapes and its sides.
///
/// A pure function of the image and of the predicted position.
#[derive(Debug, Clone)]
pub struct RodFinder {
    params: RodParams,
    shape: (usize, usize),
    /// The searched region.
    region: PixelRect,
}

/// The expected positions of edges and sides.
struct Prediction {
    sides_px: [f64; 2],
    side_signs: [f64; 2],
    edges_px: Vec<f64>,
    signs: [f64; ROD_EDGES],
    /// The row to which the positions of the sides belong.
    at_row: f64,
    /// The tilt, columns per row.
    tilt: f64,
    /// The maximum distance of a side outside its expected position, px.
    outward_px: f64,
}

impl Prediction {
    /// Returns the column between the sides, px.
    fn middle(&self) -> f64 {
        0.5 * (self.sides_px[0] + self.sides_px[1])
    }
}

/// A rod whose sides are fitted, before its edges are.
struct FittedRod<'a> {
    prediction: &'a Prediction,
    axis: &'a Axis,
    /// The light next to each edge, if it varies across the rod.
    lights: &'a [Option<TapeLight>; ROD_EDGES],
}

impl RodFinder {
    /// Plans a finder for images of `width_px` x `height_px` pixels.
    ///
    /// # Errors
    ///
    /// Returns [`RodError::Range`] if a parameter is out of its range.
    pub fn new(params: &RodParams, width_px: usize, height_px: usize) -> Result<Self, RodError> {
        params.check(width_px, height_px)?;
        let region = params.region(width_px, height_px);
        Ok(Self { params: params.clone(), shape: (width_px, height_px), region })
    }

    /// Finds the rod anywhere in the searched region, upright to about 5 deg.
    ///
    /// # Errors
    ///
    /// [`PointStatus::LowContrast`] if nothing stands out from the noise, [`PointStatus::Lost`] without two sides or
    /// with too few edges, [`PointStatus::Ambiguous`] with too many edges, and the status of the edges if none can be
    /// fitted.
    ///
    /// # Panics
    ///
    /// If the size of `image` differs from the planned size.
    pub fn find(&self, image: ImageView<'_>) -> Result<RodObservation, PointStatus> {
        self.check_shape(image);
        let mut prediction = self.find_by_projections(image)?;
        let (axis, edges) = self.fit_rod(image, &mut prediction)?;
        let section = self.find_speckled_section(image, &prediction).ok_or(PointStatus::Lost)?;
        let anchors: [bool; ROD_EDGES] = std::array::from_fn(|index| match section {
            Section::Between(upper) => index == upper || index == upper + 1,
            Section::Above | Section::Below => index < edges.len(),
        });
        if edges.iter().all(Result::is_err) {
            return Err(edges.iter().find_map(|edge| edge.err()).unwrap_or(PointStatus::Lost));
        }
        let (top, bottom) = (f64::from(self.region.top), f64::from(self.region.bottom));
        // Only neighbours that are too close leave no paint next to an edge inside the region: one of them is no edge.
        let is_inside = |y: f64| (top + EDGE_ROOM_PX..bottom - EDGE_ROOM_PX).contains(&y);
        let is_crowded =
            |index: usize| edges[index] == Err(PointStatus::OutOfFrame) && is_inside(prediction.edges_px[index]);
        if (0..edges.len()).any(|index| anchors[index] && is_crowded(index)) {
            return Err(PointStatus::Lost);
        }
        // An edge that cannot be fitted is still known by the threshold.
        let places: Vec<Estimate> = (0..edges.len())
            .map(|index| {
                let coarse = Estimate { value: prediction.edges_px[index], sigma: THRESHOLD_SIGMA_PX };
                edges[index].map_or(coarse, |edge| edge.at)
            })
            .collect();
        let anchored = places.iter().zip(anchors).filter(|(_, counts)| *counts).map(|(place, _)| *place);
        let y = mean_position(anchored);
        let place = |index: usize| places[index].value;
        let span = match section {
            Section::Between(upper) => [place(upper), place(upper + 1)],
            Section::Above => [top + MARGIN_PX, place(0)],
            Section::Below => [place(edges.len() - 1), bottom - 1.0 - MARGIN_PX],
        };
        let mut offsets_px = [Estimate { value: 0.0, sigma: f64::INFINITY }; ROD_EDGES];
        offsets_px.iter_mut().zip(&places).for_each(|(offset, place)| *offset = offset_px(*place, y));
        let span_px = span.map(|end| end - y.value);
        let rod = compose_rod(&axis, &edges, y);
        let (signs, side_signs) = (prediction.signs, prediction.side_signs);
        Ok(RodObservation { rod, span_px, offsets_px, anchors, signs, side_signs })
    }

    /// Finds the rod near its predicted position, within about 2 px, even if not all of its edges are visible.
    ///
    /// # Errors
    ///
    /// The status of the edges if none is found, or that of the sides.
    ///
    /// # Panics
    ///
    /// If the size of `image` differs from the planned size.
    pub fn follow(&self, image: ImageView<'_>, near: &RodObservation) -> Result<RodObservation, PointStatus> {
        self.check_shape(image);
        let (x, y, half) = (near.rod.x_px.value, near.rod.y_px.value, near.rod.half_width_px.value);
        let mut prediction = Prediction {
            sides_px: [x - half, x + half],
            side_signs: near.side_signs,
            edges_px: (0..self.params.edges as usize).map(|index| y + near.offsets_px[index].value).collect(),
            signs: near.signs,
            at_row: y,
            tilt: near.rod.tilt_deg.value.to_radians().tan(),
            outward_px: CLOSE_PX,
        };
        let (axis, edges) = self.fit_rod(image, &mut prediction)?;
        let places: Vec<(usize, Estimate)> =
            edges.iter().enumerate().filter_map(|(index, edge)| Some((index, edge.ok()?.at))).collect();
        if places.is_empty() {
            return Err(edges.iter().find_map(|edge| edge.err()).unwrap_or(PointStatus::Lost));
        }
        // Each edge predicts the reported point; edges that contribute to it must agree.
        let anchored = edges.iter().zip(near.anchors).filter(|(_, counts)| *counts);
        let anchored: Result<Vec<Estimate>, _> = anchored.map(|(edge, _)| edge.map(|edge| edge.at)).collect();
        let mut offsets_px = near.offsets_px;
        let y = match anchored {
            Ok(anchored) => {
                let y = mean_position(anchored.into_iter());
                for (offset, place) in places.iter().map(|(index, place)| (*index, offset_px(*place, y))) {
                    if place.sigma < offsets_px[offset].sigma {
                        offsets_px[offset] = place;
                    }
                }
                y
            }
            Err(_) => mean_of_predictions(&places, &near.offsets_px),
        };
        Ok(RodObservation { rod: compose_rod(&axis, &edges, y), offsets_px, ..*near })
    }

    /// Checks that an image has the planned size.
    ///
    /// # Panics
    ///
    /// If it has another size.
    fn check_shape(&self, image: ImageView<'_>) {
        assert_eq!((image.width(), image.height()), self.shape, "planned for another size");
    }

    /// Finds sides and edges to whole pixels, from the sums of a binary image along columns and rows.
    ///
    /// # Errors
    ///
    /// [`PointStatus::LowContrast`] if nothing stands out from the noise, [`PointStatus::Lost`] without two sides, and
    /// the errors of [`Self::find_edges`].
    fn find_by_projections(&self, image: ImageView<'_>) -> Result<Prediction, PointStatus> {
        let binary = BinaryImage::new(image, self.region).ok_or(PointStatus::LowContrast)?;
        let [black, white] = binary.means_dn;
        if white - black < MIN_CONTRAST_SIGMAS * noise_dn(image, self.region) {
            return Err(PointStatus::LowContrast);
        }
        let [left, right] = self.find_sides(&binary).ok_or(PointStatus::Lost)?;
        let inside = left.at + 1 + INSET_PX as usize..(right.at + 1).saturating_sub(INSET_PX as usize);
        let edges = self.find_edges(&binary, inside, [left.at, right.at])?;
        // Entry k of the sums is the line between k and k + 1.
        let line_px = |at: usize, from: usize| (at + from) as f64 + 0.5;
        let mut signs = [0.0; ROD_EDGES];
        signs.iter_mut().zip(&edges).for_each(|(sign, edge)| *sign = f64::from(edge.strength.signum()));
        Ok(Prediction {
            sides_px: [left.at, right.at].map(|at| line_px(at, binary.left)),
            side_signs: [left, right].map(|side| f64::from(side.strength.signum())),
            edges_px: edges.iter().map(|edge| line_px(edge.at, binary.top)).collect(),
            signs,
            at_row: 0.0,
            tilt: 0.0,
            // A threshold places a side that fades into the ground too far inside.
            outward_px: CLOSE_PX.max(OUTWARD_FRACTION * (right.at - left.at) as f64),
        })
    }

    /// Returns the left and the right side, in columns of the region; `None` without two sides.
    ///
    /// The sides are lines of opposite sign within the allowed width. The pair whose weaker line is the strongest is chosen.
    /// Each line must change over at least [`MIN_SIDE_ROWS`] rows. If no pair is wide enough, the bright part of a shaded
    /// rod may be.
    fn find_sides(&self, binary: &BinaryImage) -> Option<[Line; 2]> {
        let mut tried = find_extrema(&binary.column_steps(), MIN_DISTANCE_PX);
        tried.truncate(SIDES_TRIED);
        let [min, max] = self.params.width_px;
        let strongest = |min: f64| {
            let mut best: Option<(i32, [Line; 2])> = None;
            for left in &tried {
                for right in &tried {
                    let width_px = right.at as f64 - left.at as f64;
                    let weaker = left.strength.abs().min(right.strength.abs());
                    let are_opposite = left.strength.signum() != right.strength.signum();
                    let is_candidate = (min..=max).contains(&width_px) && are_opposite && weaker >= MIN_SIDE_ROWS;
                    if is_candidate && best.is_none_or(|(strength, _)| weaker > strength) {
                        best = Some((weaker, [*left, *right]));
                    }
                }
            }
            best.map(|(_, pair)| pair)
        };
        strongest(min).or_else(|| strongest(BRIGHT_FRACTION * min))
    }

    /// Returns the followed edges, from the top downwards, in rows of the region. `inside` are the columns between the
    /// `sides`, columns of the region as well.
    ///
    /// # Errors
    ///
    /// [`PointStatus::Lost`] for too few edges, [`PointStatus::Ambiguous`] for too many or if they do not alternate.
    fn find_edges(
        &self,
        binary: &BinaryImage,
        inside: Range<usize>,
        sides: [usize; 2],
    ) -> Result<Vec<Line>, PointStatus> {
        let width = inside.len() as f64;
        let outer = [0..sides[0].saturating_sub(2), (sides[1] + 3).min(binary.width)..binary.width];
        let outside: Vec<(f64, Vec<i32>)> = outer
            .into_iter()
            .filter(|columns| columns.len() >= MIN_DISTANCE_PX)
            .map(|columns| (columns.len() as f64, binary.row_steps(columns)))
            .collect();
        let continues_outside = |line: &Line| {
            let fraction = f64::from(line.strength) / width;
            outside.iter().any(|(columns, sums)| {
                let near = sums[line.at.saturating_sub(1)..(line.at + 2).min(sums.len())].iter().sum::<i32>();
                f64::from(near) / columns / fraction >= CONTINUATION_RATIO
            })
        };
        let white = binary.white_fraction(inside.clone());
        let mut all = find_extrema(&binary.row_steps(inside), MIN_DISTANCE_PX);
        all.retain(|line| f64::from(line.strength.abs()) >= MIN_EDGE_FRACTION * width && !continues_outside(line));
        select_edges(&white, &all, self.params.edges as usize)
    }

    /// Fits both sides and all edges near their expected positions, and moves the expected sides to those found.
    ///
    /// # Errors
    ///
    /// The error of a side that cannot be fitted.
    fn fit_rod(
        &self,
        image: ImageView<'_>,
        prediction: &mut Prediction,
    ) -> Result<(Axis, Vec<Result<Edge, PointStatus>>), PointStatus> {
        let expected = ExpectedRod {
            edges_px: &prediction.edges_px,
            signs: &prediction.signs,
            sides_px: prediction.sides_px,
            at_row: prediction.at_row,
            tilt: prediction.tilt,
            width_px: self.params.width_px,
            outward_px: prediction.outward_px,
            region: self.region,
        };
        let shaded = ShadedRod::fit(image, &expected);
        let stepped = self.fit_axis(image, prediction);
        let Some(shaded) = shaded.and_then(|shaded| shaded.unless_stepped(stepped.as_ref().ok())) else {
            let axis = stepped?;
            let [left, right] = axis.sides.map(|side| side.at.value);
            if right - left < self.params.width_px[0] - SIDE_TOLERANCE_PX {
                return Err(PointStatus::Lost);
            }
            let edges = self.fit_edges(image, &FittedRod { prediction, axis: &axis, lights: &[None; ROD_EDGES] });
            return Ok((axis, edges));
        };
        let better = fit_better_axis(image, &expected, &shaded.axis);
        let shaded = match better {
            Some(axis) => shaded.with_axis(axis),
            None => shaded,
        };
        let axis = shaded.axis;
        (prediction.at_row, prediction.tilt) = (axis.middle, axis.tilt());
        prediction.sides_px = axis.sides.map(|side| side.at.value);
        // Where light fades along a tape, a threshold places its edge too far inside. Levels next to the edge that was
        // fitted show its light better.
        let mut edges = Vec::new();
        for _ in 0..SHADED_PASSES {
            let lights = shaded.lights(image, &prediction.edges_px, &prediction.signs);
            edges = self.fit_edges(image, &FittedRod { prediction, axis: &axis, lights: &lights });
            for (place, edge) in prediction.edges_px.iter_mut().zip(&edges) {
                *place = edge.map_or(*place, |edge| edge.at.value);
            }
        }
        Ok((axis, edges))
    }

    /// Fits all edges, first separately. Speckled ones, and failed ones inside the image, are fitted again with blur
    /// and paint of the clean ones.
    fn fit_edges(&self, image: ImageView<'_>, rod: &FittedRod<'_>) -> Vec<Result<Edge, PointStatus>> {
        let places = &rod.prediction.edges_px;
        let separate: Vec<Result<Edge, PointStatus>> =
            (0..places.len()).map(|index| self.fit_edge(image, rod, index, None)).collect();
        let clean: Vec<&Edge> = separate.iter().flatten().filter(|edge| !edge.is_speckled).collect();
        let refit = |index: usize| match &separate[index] {
            Ok(edge) if clean.is_empty() || !edge.is_speckled => Ok(*edge),
            Err(PointStatus::OutOfFrame) => Err(PointStatus::OutOfFrame),
            _ => self.fit_edge(image, rod, index, clean_paint_at(&clean, places[index])),
        };
        (0..separate.len()).map(refit).collect()
    }

    /// Fits the edge with this index and returns it with its position on the axis. `clean` is known of other edges.
    ///
    /// # Errors
    ///
    /// The errors of [`fit_step_edge`].
    fn fit_edge(
        &self,
        image: ImageView<'_>,
        rod: &FittedRod<'_>,
        index: usize,
        clean: Option<CleanPaint>,
    ) -> Result<Edge, PointStatus> {
        let FittedRod { prediction, axis, lights } = rod;
        let [from, to] = prediction.sides_px;
        let along = [(from + INSET_PX).ceil().max(0.0) as usize, (to - INSET_PX).floor().max(0.0) as usize + 1];
        let places = &prediction.edges_px;
        let middle = prediction.middle();
        let gap = |other: Option<&f64>| other.map_or(f64::INFINITY, |other| (other - places[index]).abs());
        let gaps = [gap(index.checked_sub(1).and_then(|above| places.get(above))), gap(places.get(index + 1))];
        let light = lights[index].as_ref();
        let reach_px = if light.is_some() { SHADED_REACH_PX } else { EDGE_REACH_PX };
        let expected = ExpectedEdge {
            direction: Direction::Rows,
            along,
            middle,
            near: places[index],
            slope: -axis.tilt(),
            depth: gaps.map(|gap| (gap - EDGE_MARGIN_PX).clamp(0.0, reach_px) as usize),
            room: [self.region.rows().start, self.region.rows().end - 1],
            sign: prediction.signs[index],
            clean,
            light,
        };
        let edge = fit_step_edge(image, &expected)?;
        Ok(Edge { at: Estimate { value: axis.y_at_edge(&edge, middle), ..edge.at }, ..edge })
    }

    /// Returns the section with the most texture, the speckled tape; `None` if none is high enough.
    fn find_speckled_section(&self, image: ImageView<'_>, prediction: &Prediction) -> Option<Section> {
        let places = &prediction.edges_px;
        let mut sections: Vec<(Section, [f64; 2])> =
            places.windows(2).enumerate().map(|(upper, pair)| (Section::Between(upper), [pair[0], pair[1]])).collect();
        if places.len() % 2 == 1 {
            // One tape shows a single edge: it lies above the first or below the last.
            let [top, bottom] = [self.region.top, self.region.bottom].map(f64::from);
            sections.push((Section::Above, [top, places[0]]));
            sections.push((Section::Below, [places[places.len() - 1], bottom - 1.0]));
        }
        let [left, right] = prediction.sides_px.map(|side| side.max(0.0) as usize);
        let columns = left + INSET_PX as usize + 1..right.saturating_sub(INSET_PX as usize);
        let texture = |[from, to]: [f64; 2]| {
            let rows = (from + TEXTURE_MARGIN_PX).ceil() as usize..((to - TEXTURE_MARGIN_PX).floor().max(0.0)) as usize;
            mean_square_gradient(image, columns.clone(), rows)
        };
        let candidates = sections.into_iter().filter(|(_, [from, to])| to - from >= MIN_SECTION_PX);
        candidates.map(|(section, rows)| (section, texture(rows))).max_by(|a, b| a.1.total_cmp(&b.1)).map(|best| best.0)
    }

    /// Fits both sides over the rows with tapes. For an odd number of edges these are all rows of the region.
    ///
    /// # Errors
    ///
    /// The error of a side that cannot be fitted.
    fn fit_axis(&self, image: ImageView<'_>, prediction: &Prediction) -> Result<Axis, PointStatus> {
        let [top, bottom] = [self.region.top, self.region.bottom].map(f64::from);
        let places = &prediction.edges_px;
        let (first, last) = match places.len() % 2 {
            // A tape extends beyond the outermost edge on one side.
            1 => (top, bottom),
            _ => (places[0], places[places.len() - 1] + 1.0),
        };
        let rows = [first, last].map(|row| row.clamp(top, bottom) as usize);
        let middle = 0.5 * (rows[0] + rows[1]) as f64;
        let side = |index: usize| {
            let expected = ExpectedEdge {
                direction: Direction::Columns,
                along: rows,
                middle,
                near: prediction.sides_px[index] + prediction.tilt * (middle - prediction.at_row),
                slope: prediction.tilt,
                depth: [SIDE_REACH_PX, SIDE_REACH_PX],
                room: [self.region.columns().start, self.region.columns().end - 1],
                sign: prediction.side_signs[index],
                clean: None,
                light: None,
            };
            fit_step_edge(image, &expected)
        };
        // The background is less uniform than the paint of the rod, and common to all rows.
        let with_side_sigma = |side: Edge| Side {
            at: Estimate { sigma: side.at.sigma.hypot(SIDE_SIGMA_PX), ..side.at },
            slope: side.slope,
        };
        Ok(Axis { sides: [with_side_sigma(side(0)?), with_side_sigma(side(1)?)], middle })
    }
}

/// The position of the speckled tape.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Section {
    /// Between this edge and the next.
    Between(usize),
    /// Above the first edge.
    Above,
    /// Below the last.
    Below,
}
