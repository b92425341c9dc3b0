//! Random speckles on the disc of the ball.

use super::blurred_edge::{BlurredDisc, CutDisc};
use crate::numeric::Stream;
use crate::synth::scenario::{PatternSetup, ScenarioError};
use std::f64::consts::{PI, TAU};

/// The number of speckle sizes; a table of blurred coverage is kept for each.
const SPECKLE_SIZES: usize = 24;
/// The maximum number of positions tried for one speckle.
pub(crate) const MAX_TRIALS: usize = 3000;

/// The region that carries the speckles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum SpeckleRegion {
    /// A disc of this radius, px.
    Disc(f64),
    /// A rectangle with these half sides, px; no speckle crosses its edges.
    Rectangle([f64; 2]),
}

impl SpeckleRegion {
    /// Returns the area of the region, px^2.
    fn area_px2(self) -> f64 {
        match self {
            Self::Disc(radius) => PI * radius * radius,
            Self::Rectangle([x, y]) => 4.0 * x * y,
        }
    }

    /// Returns the radius of the smallest disc around the region, px.
    fn enclosing_radius_px(self) -> f64 {
        match self {
            Self::Disc(radius) => radius,
            Self::Rectangle([x, y]) => x.hypot(y),
        }
    }
}

/// One speckle, in the axes of the ball (px, y down, at angle 0).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Speckle {
    pub(crate) x_px: f64,
    pub(crate) y_px: f64,
    /// The index of its size.
    pub(crate) size: usize,
    /// Whether it crosses the rim of the disc, at a right angle, or lies fully inside.
    pub(crate) crosses_rim: bool,
}

/// One straight line of the pattern: a rectangle fully inside the disc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Line {
    /// The middle, in the axes of the ball (px, y down, at angle 0).
    pub(crate) middle_px: [f64; 2],
    /// The unit vector along it.
    pub(crate) along: [f64; 2],
    pub(crate) half_length_px: f64,
    pub(crate) half_width_px: f64,
}

impl Line {
    /// Returns the distance of a point from the centre line, px.
    fn distance_px(&self, x_px: f64, y_px: f64) -> f64 {
        let (dx, dy) = (x_px - self.middle_px[0], y_px - self.middle_px[1]);
        let along = dx * self.along[0] + dy * self.along[1];
        let across = dx * self.along[1] - dy * self.along[0];
        across.hypot((along.abs() - self.half_length_px).max(0.0))
    }

    /// Returns an end of the centre line, or a point between both ends: `side` is -1 to 1.
    fn endpoint(&self, side: f64) -> [f64; 2] {
        let reach = side * self.half_length_px;
        [self.middle_px[0] + reach * self.along[0], self.middle_px[1] + reach * self.along[1]]
    }

    /// Whether both lines come closer than a pixel at one of 41 points of either, or intersect.
    fn is_near(&self, other: &Self) -> bool {
        let apart = self.half_width_px + other.half_width_px + 1.0;
        (-20..=20).any(|part| {
            let [x, y] = self.endpoint(f64::from(part) / 20.0);
            let [u, v] = other.endpoint(f64::from(part) / 20.0);
            other.distance_px(x, y) < apart || self.distance_px(u, v) < apart
        }) || self.intersects(other)
    }

    /// Whether the centre lines intersect.
    fn intersects(&self, other: &Self) -> bool {
        let side = |line: &Self, [x, y]: [f64; 2]| {
            (x - line.middle_px[0]) * line.along[1] - (y - line.middle_px[1]) * line.along[0]
        };
        side(self, other.endpoint(-1.0)) * side(self, other.endpoint(1.0)) < 0.0
            && side(other, self.endpoint(-1.0)) * side(other, self.endpoint(1.0)) < 0.0
    }
}

/// The speckles and lines of the ball.
///
/// None overlap, so their blurred coverages add up exactly. A speckle is either fully inside the disc or crosses its
/// rim at a right angle, so that its visible part is known in closed form.
#[derive(Debug, Clone)]
pub(crate) struct Pattern {
    pub(crate) speckles: Vec<Speckle>,
    pub(crate) lines: Vec<Line>,
    pub(crate) discs: Vec<BlurredDisc>,
    /// The table of each size cut by the rim, if a speckle of it crosses the rim.
    pub(crate) cut_discs: Vec<Option<CutDisc>>,
    /// The radius of each size, px.
    pub(crate) radii_px: Vec<f64>,
}

impl Pattern {
    /// Places random speckles in a region until they reach the coverage. `sigma_px` is the blur of their tables.
    ///
    /// # Errors
    ///
    /// Returns [`ScenarioError`] if the lines or the speckles do not fit.
    pub(crate) fn scatter(
        setup: &PatternSetup,
        region: SpeckleRegion,
        sigma_px: f64,
        mut stream: Stream,
    ) -> Result<Self, ScenarioError> {
        let areas = size_areas_px2(setup);
        let sizes = areas.len();
        let radii_px: Vec<f64> = areas.iter().map(|area| (area / PI).sqrt()).collect();
        let mut placement = Placement::new(region, radii_px.clone(), setup.coverage);
        placement.place_lines(setup, &mut stream)?;
        let wanted = setup.coverage * region.area_px2();
        // Larger sizes no longer find a place.
        let mut usable = sizes;
        while placement.covered_px2 < wanted {
            if usable == 0 {
                let reached = placement.covered_px2 / region.area_px2();
                return Err(ScenarioError::TooDense { wanted: setup.coverage, reached });
            }
            let mut batch = draw_sizes(&areas[..usable], wanted - placement.covered_px2, &mut stream);
            // Large ones first, since small ones still fit between them.
            batch.sort_unstable_by(|left, right| right.cmp(left));
            for size in batch {
                if size < usable && !placement.place_speckle(size, &mut stream) {
                    usable = size;
                }
            }
        }
        let discs = radii_px.iter().map(|radius| BlurredDisc::new(*radius, sigma_px)).collect();
        let crossing =
            |size: usize| placement.speckles.iter().any(|speckle| speckle.size == size && speckle.crosses_rim);
        let cut_discs = (0..sizes)
            .map(|size| crossing(size).then(|| CutDisc::new(radii_px[size], region.enclosing_radius_px(), sigma_px)))
            .collect();
        Ok(Self { speckles: placement.speckles, lines: placement.lines, discs, cut_discs, radii_px })
    }

    /// Returns the pattern magnified by `zoom`, on a disc of radius `rim_px`. `sigma_px` is the blur of its tables.
    pub(crate) fn zoomed(&self, zoom: f64, rim_px: f64, sigma_px: f64) -> Self {
        let radii_px: Vec<f64> = self.radii_px.iter().map(|radius| zoom * radius).collect();
        let speckle = |speckle: &Speckle| Speckle { x_px: zoom * speckle.x_px, y_px: zoom * speckle.y_px, ..*speckle };
        let line = |line: &Line| Line {
            middle_px: line.middle_px.map(|at| zoom * at),
            half_length_px: zoom * line.half_length_px,
            half_width_px: zoom * line.half_width_px,
            ..*line
        };
        let cut =
            |(radius, cut): (&f64, &Option<CutDisc>)| cut.as_ref().map(|_| CutDisc::new(*radius, rim_px, sigma_px));
        Self {
            speckles: self.speckles.iter().map(speckle).collect(),
            lines: self.lines.iter().map(line).collect(),
            discs: radii_px.iter().map(|radius| BlurredDisc::new(*radius, sigma_px)).collect(),
            cut_discs: radii_px.iter().zip(&self.cut_discs).map(cut).collect(),
            radii_px,
        }
    }
}

/// Returns the areas of the speckle sizes, smallest first, px^2. Their logarithms are equally spaced.
pub(crate) fn size_areas_px2(setup: &PatternSetup) -> Vec<f64> {
    let sizes = if setup.area_max_px2 > setup.area_min_px2 { SPECKLE_SIZES } else { 1 };
    let ratio = setup.area_max_px2 / setup.area_min_px2;
    (0..sizes).map(|size| setup.area_min_px2 * ratio.powf((size as f64 + 0.5) / sizes as f64)).collect()
}

/// Draws indices into the `areas` (px^2, smallest first), uniform in area, that together cover at least `wanted_px2`.
pub(crate) fn draw_sizes(areas: &[f64], wanted_px2: f64, stream: &mut Stream) -> Vec<usize> {
    let (low, high) = (areas[0], areas[areas.len() - 1]);
    let mut sizes = Vec::new();
    let mut sum = 0.0;
    while sum < wanted_px2 {
        let area = stream.between(low, high);
        let size = areas.partition_point(|limit| *limit < area).min(areas.len() - 1);
        sum += areas[size];
        sizes.push(size);
    }
    sizes
}

/// A region that is being covered, with a cell list to find neighbours.
struct Placement {
    region: SpeckleRegion,
    /// The radius of the disc, or of one around the rectangle.
    radius_px: f64,
    radii_px: Vec<f64>,
    cell_px: f64,
    cells_wide: usize,
    cells: Vec<Vec<usize>>,
    speckles: Vec<Speckle>,
    lines: Vec<Line>,
    covered_px2: f64,
    /// The length of rim that may still be covered: the same fraction as of the disc.
    rim_left_px: f64,
}

impl Placement {
    /// Prepares an empty region with the cells of its neighbour search.
    ///
    /// `radii_px` are those of the sizes, smallest first, and `coverage` is the fraction to cover.
    fn new(region: SpeckleRegion, radii_px: Vec<f64>, coverage: f64) -> Self {
        let radius_px = region.enclosing_radius_px();
        let largest = radii_px[radii_px.len() - 1];
        let cell_px = 2.0 * largest;
        let cells_wide = (2.0 * (radius_px + 2.0 * largest) / cell_px).ceil() as usize + 2;
        let cells = vec![Vec::new(); cells_wide * cells_wide];
        Self {
            region,
            radius_px,
            radii_px,
            cell_px,
            cells_wide,
            cells,
            speckles: Vec::new(),
            lines: Vec::new(),
            covered_px2: 0.0,
            rim_left_px: coverage * TAU * radius_px,
        }
    }

    /// Places the lines at random; none crosses another or the rim.
    ///
    /// # Errors
    ///
    /// Returns [`ScenarioError::TooManyLines`] if too many positions were tried.
    fn place_lines(&mut self, setup: &PatternSetup, stream: &mut Stream) -> Result<(), ScenarioError> {
        let half_width_px = 0.5 * setup.line_width_px;
        let inside_px = self.radius_px - half_width_px - 1.0;
        let mut trials = MAX_TRIALS;
        while self.lines.len() < setup.lines as usize {
            if trials == 0 {
                return Err(ScenarioError::TooManyLines { wanted: setup.lines, reached: self.lines.len() });
            }
            trials -= 1;
            let (angle, distance) = (stream.between(0.0, PI), stream.between(-0.8, 0.8) * inside_px);
            let along = [angle.cos(), angle.sin()];
            let half_chord = (inside_px * inside_px - distance * distance).sqrt();
            let half_length_px = half_chord * stream.between(0.4, 1.0);
            let slide = stream.between(-1.0, 1.0) * (half_chord - half_length_px);
            let middle_px = [slide * along[0] - distance * along[1], slide * along[1] + distance * along[0]];
            let line = Line { middle_px, along, half_length_px, half_width_px };
            if !self.lines.iter().any(|other| line.is_near(other)) {
                self.covered_px2 += 4.0 * half_length_px * half_width_px;
                self.lines.push(line);
            }
        }
        Ok(())
    }

    /// Places a speckle of this size at a random free position. Returns whether one was found.
    fn place_speckle(&mut self, size: usize, stream: &mut Stream) -> bool {
        let small = self.radii_px[size];
        for _ in 0..MAX_TRIALS {
            let tried = match self.region {
                SpeckleRegion::Disc(_) => self.draw_in_disc(size, stream),
                SpeckleRegion::Rectangle([x, y]) => {
                    let place = |half: f64, stream: &mut Stream| stream.between(-1.0, 1.0) * (half - small);
                    let (x_px, y_px) = (place(x, stream), place(y, stream));
                    (x.min(y) > small).then_some((Speckle { x_px, y_px, size, crosses_rim: false }, PI * small * small))
                }
            };
            let Some((speckle, covered_px2)) = tried.filter(|(speckle, _)| self.is_free(speckle)) else { continue };
            self.rim_left_px -= if speckle.crosses_rim { 2.0 * small } else { 0.0 };
            self.covered_px2 += covered_px2;
            let cell = self.cell_index(speckle.y_px) * self.cells_wide + self.cell_index(speckle.x_px);
            self.cells[cell].push(self.speckles.len());
            self.speckles.push(speckle);
            return true;
        }
        false
    }

    /// Draws a position in the disc or across its rim; also returns the area that it would cover, px^2.
    ///
    /// `None` if the rim is already covered.
    fn draw_in_disc(&self, size: usize, stream: &mut Stream) -> Option<(Speckle, f64)> {
        let small = self.radii_px[size];
        let reach = self.radius_px + small;
        let angle = stream.between(0.0, TAU);
        let mut distance = reach * stream.uniform().sqrt();
        let crosses_rim = distance > self.radius_px - small;
        if crosses_rim && self.rim_left_px < 2.0 * small {
            return None;
        }
        if crosses_rim {
            // At this distance both circles intersect at a right angle.
            distance = (self.radius_px * self.radius_px + small * small).sqrt();
        }
        let speckle = Speckle { x_px: distance * angle.cos(), y_px: distance * angle.sin(), size, crosses_rim };
        Some((speckle, overlap_px2(self.radius_px, small, distance)))
    }

    /// Returns the row or column of the cell of a coordinate.
    fn cell_index(&self, place_px: f64) -> usize {
        (place_px / self.cell_px + 0.5 * self.cells_wide as f64) as usize
    }

    /// Whether a speckle overlaps no line and no other speckle.
    fn is_free(&self, speckle: &Speckle) -> bool {
        let small = self.radii_px[speckle.size];
        if self.lines.iter().any(|line| line.distance_px(speckle.x_px, speckle.y_px) < small + line.half_width_px) {
            return false;
        }
        let (column, row) = (self.cell_index(speckle.x_px), self.cell_index(speckle.y_px));
        (row - 1..=row + 1).flat_map(|row| (column - 1..=column + 1).map(move |column| (row, column))).all(
            |(row, column)| {
                self.cells[row * self.cells_wide + column].iter().all(|index| {
                    let other = &self.speckles[*index];
                    let apart = self.radii_px[speckle.size] + self.radii_px[other.size];
                    (speckle.x_px - other.x_px).powi(2) + (speckle.y_px - other.y_px).powi(2) >= apart * apart
                })
            },
        )
    }
}

/// Returns the area that two discs share, px^2: the sum of two circular segments. The second disc is not larger than
/// the first.
fn overlap_px2(large: f64, small: f64, distance: f64) -> f64 {
    if distance <= large - small {
        return PI * small * small;
    }
    if distance >= large + small {
        return 0.0;
    }
    let slice = |radius: f64, other: f64| {
        let foot = (distance * distance + radius * radius - other * other) / (2.0 * distance);
        radius * radius * (foot / radius).clamp(-1.0, 1.0).acos()
            - foot * (radius * radius - foot * foot).max(0.0).sqrt()
    };
    slice(large, small) + slice(small, large)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scattered(area_min_px2: f64, area_max_px2: f64, coverage: f64) -> Result<Pattern, ScenarioError> {
        let setup = PatternSetup { area_min_px2, area_max_px2, coverage, ..PatternSetup::default() };
        Pattern::scatter(&setup, SpeckleRegion::Disc(60.0), 0.76, Stream::new(7))
    }

    #[test]
    fn speckles_reach_the_coverage_and_never_overlap() {
        for (low, high, coverage) in [(4.0, 4.0, 0.24), (10.0, 10.0, 0.31), (250.0, 250.0, 0.43), (4.0, 80.0, 0.54)] {
            let pattern = scattered(low, high, coverage).unwrap();
            let covered: f64 = pattern
                .speckles
                .iter()
                .map(|speckle| overlap_px2(60.0, pattern.radii_px[speckle.size], speckle.x_px.hypot(speckle.y_px)))
                .sum();
            let coverage_reached = covered / (PI * 3600.0);
            assert!((coverage..coverage + 0.025).contains(&coverage_reached), "{low}-{high}: {coverage_reached}");
            for (index, left) in pattern.speckles.iter().enumerate() {
                for right in &pattern.speckles[..index] {
                    let apart = (left.x_px - right.x_px).hypot(left.y_px - right.y_px);
                    assert!(apart >= pattern.radii_px[left.size] + pattern.radii_px[right.size] - 1e-9);
                }
            }
        }
    }

    #[test]
    fn lines_keep_clear_of_each_other_of_the_rim_and_of_speckles() {
        let setup =
            PatternSetup { area_min_px2: 4.0, area_max_px2: 20.0, coverage: 0.27, lines: 5, ..PatternSetup::default() };
        let pattern = Pattern::scatter(&setup, SpeckleRegion::Disc(60.0), 0.76, Stream::new(7)).unwrap();
        assert_eq!(pattern.lines.len(), 5);
        for (index, line) in pattern.lines.iter().enumerate() {
            for side in [-1.0, 1.0] {
                let [x, y] = line.endpoint(side);
                assert!(x.hypot(y) < 59.0);
            }
            for speckle in &pattern.speckles {
                let apart = line.distance_px(speckle.x_px, speckle.y_px);
                assert!(apart >= pattern.radii_px[speckle.size] + 1.0);
            }
            assert!(pattern.lines[..index].iter().all(|other| !line.intersects(other)));
        }
        let crowded =
            Pattern::scatter(&PatternSetup { lines: 200, ..setup }, SpeckleRegion::Disc(60.0), 0.76, Stream::new(7));
        assert!(matches!(crowded, Err(ScenarioError::TooManyLines { wanted: 200, .. })));
    }

    #[test]
    fn a_coverage_that_cannot_be_packed_is_refused() {
        let error = scattered(250.0, 250.0, 0.6).unwrap_err();
        assert!(matches!(error, ScenarioError::TooDense { reached, .. } if reached > 0.4), "{error}");
    }
}
