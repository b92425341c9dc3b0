//! The outline method of the paper: mark the boundary, filter the ball, then a Hough transform.
//!
//! H. Ghaednia et al., Int. J. Mech. Sci. 131-132 (2017), section 4.3. The boundary lies at the strongest change across
//! the rim of a ball of one grey level. Whole pixels there are marked and vote for every circle through them.

use crate::image::ImageView;
use crate::numeric::quantile;
use crate::results::Circle;

/// The maximum distance of the boundary from the detected circle, px.
const REACH_PX: f64 = 3.0;
/// The depth from which the ball is filtered, i.e. replaced by one grey level, px.
const FILTER_DEPTH_PX: f64 = 1.5;
/// The resolution of the accumulator along x, y and the radius, px.
const CELL_PX: f64 = 0.25;
/// The distance between samples along a ray, px.
const STRIDE_PX: f64 = 0.5;
/// The minimum contrast of a boundary, as a fraction of the contrast of ball and background.
const MIN_CONTRAST_FRACTION: f32 = 0.25;
/// The maximum difference from the filtered level next to the rim, as a fraction of that contrast; more is speckle.
const MAX_SPECKLE_FRACTION: f32 = 0.4;
/// The fraction of the maximum votes from which circles are averaged.
const VOTE_FRACTION: f64 = 0.8;
/// The minimum fraction of the rim that is marked.
const MIN_MARKED_FRACTION: f64 = 0.25;
/// The minimum fraction of the marks that lie on the circle.
const MIN_INLIER_FRACTION: f64 = 0.6;
/// The standard deviation of a mark because of whole pixels and speckle next to the rim, px.
const MARK_SIGMA_PX: f64 = 0.5;
/// The number of neighbouring marks with a common error, because speckle moves a run of them.
const CORRELATED_MARKS: f64 = 20.0;

/// The transform with its scratch memory.
#[derive(Debug, Default)]
pub(super) struct PaperHough {
    marks: Vec<Mark>,
    levels: Vec<f32>,
    radii: Vec<u32>,
    cells: Vec<Cell>,
}

/// A marked pixel relative to the centre of the detected circle, px.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Mark {
    x_px: f64,
    y_px: f64,
}

/// A circle of the accumulator, relative to the detected centre, with its votes.
#[derive(Debug, Clone, Copy)]
struct Cell {
    x: f64,
    y: f64,
    radius: f64,
    votes: f64,
}

impl PaperHough {
    /// Returns the circle with the most votes; `None` if too little of it is marked, or too many marks lie elsewhere.
    pub(super) fn find_circle(&mut self, image: ImageView<'_>, detected: &Circle) -> Option<Circle> {
        let rays = (std::f64::consts::TAU * detected.radius_px).ceil();
        self.mark_boundary(image, detected, rays as usize);
        self.accumulate_votes(detected.radius_px);
        let best = self.mean_of_peak()?;
        let is_on_circle = |mark: &&Mark| ((mark.x_px - best.x).hypot(mark.y_px - best.y) - best.radius).abs() < 1.0;
        let marked = self.marks.iter().filter(is_on_circle).count() as f64;
        if marked < MIN_MARKED_FRACTION * rays || marked < MIN_INLIER_FRACTION * self.marks.len() as f64 {
            return None;
        }
        // If many marks are off the circle, those on it are less certain, too.
        let outlier_factor = self.marks.len() as f64 / marked;
        let sigma_px = (CELL_PX / f64::sqrt(12.0))
            .hypot(MARK_SIGMA_PX * (2.0 * CORRELATED_MARKS / marked).sqrt() * outlier_factor);
        Some(Circle {
            x_px: detected.x_px + best.x,
            y_px: detected.y_px + best.y,
            radius_px: best.radius,
            sigma_center_px: sigma_px,
            sigma_radius_px: sigma_px,
            ..*detected
        })
    }

    /// Marks the boundary pixel of every ray that has one.
    fn mark_boundary(&mut self, image: ImageView<'_>, detected: &Circle, rays: usize) {
        self.marks.clear();
        let Some(ball) = self.ball_level(image, detected) else { return };
        let steps = (2.0 * REACH_PX / STRIDE_PX) as usize + 1;
        for ray in 0..rays {
            let (sin, cos) = (ray as f64 * std::f64::consts::TAU / rays as f64).sin_cos();
            self.levels.clear();
            let inner = detected.radius_px - FILTER_DEPTH_PX;
            let Some(inside) = image.interpolate(detected.x_px + inner * cos, detected.y_px + inner * sin) else {
                continue;
            };
            for step in 0..steps {
                let along = detected.radius_px - REACH_PX + STRIDE_PX * step as f64;
                let level = match along < inner {
                    true => Some(ball),
                    false => image.interpolate(detected.x_px + along * cos, detected.y_px + along * sin),
                };
                self.levels.extend(level);
            }
            if self.levels.len() < steps {
                continue;
            }
            if let Some(at) = boundary_sample(&self.levels, ball, inside) {
                let along = detected.radius_px - REACH_PX + STRIDE_PX * at as f64;
                let pixel = |middle: f64, part: f64| (middle + along * part).round() - middle;
                let mark = Mark { x_px: pixel(detected.x_px, cos), y_px: pixel(detected.y_px, sin) };
                if self.marks.last() != Some(&mark) {
                    self.marks.push(mark);
                }
            }
        }
    }

    /// Returns the grey level of the filtered ball, the median well inside; `None` if no pixel lies there.
    fn ball_level(&mut self, image: ImageView<'_>, detected: &Circle) -> Option<f32> {
        self.levels.clear();
        let depth = detected.radius_px - FILTER_DEPTH_PX;
        let rows =
            (detected.y_px - depth).max(0.0) as usize..((detected.y_px + depth).max(0.0) as usize).min(image.height());
        for y in rows.step_by(2) {
            let reach = (depth * depth - (y as f64 - detected.y_px).powi(2)).max(0.0).sqrt();
            let row = image.row(y);
            let end = ((detected.x_px + reach).max(0.0) as usize).min(row.len());
            let start = ((detected.x_px - reach).max(0.0) as usize).min(end);
            self.levels.extend(row[start..end].iter().step_by(2));
        }
        quantile(&mut self.levels, 0.5)
    }

    /// Fills the accumulator: each mark votes, for every centre within [`REACH_PX`], for the radius of the circle through
    /// it.
    ///
    /// `radius_px` is the radius of the detected circle, about which radii are tried.
    fn accumulate_votes(&mut self, radius_px: f64) {
        let side = (REACH_PX / CELL_PX) as i32;
        let bins = 2 * side as usize + 1;
        self.cells.clear();
        for (row, column) in (-side..=side).flat_map(|row| (-side..=side).map(move |column| (row, column))) {
            let (x, y) = (f64::from(column) * CELL_PX, f64::from(row) * CELL_PX);
            self.radii.clear();
            self.radii.resize(bins, 0);
            for mark in &self.marks {
                let radius = ((mark.x_px - x).powi(2) + (mark.y_px - y).powi(2)).sqrt();
                let bin = ((radius - radius_px) / CELL_PX).round() + f64::from(side);
                if let Some(votes) = self.radii.get_mut(bin as usize).filter(|_| bin >= 0.0) {
                    *votes += 1;
                }
            }
            // Whole pixels spread the radii of one circle over a pixel.
            let spread = [1.0, 2.0, 3.0, 2.0, 1.0];
            let votes = |bins: &[u32]| bins.iter().zip(spread).map(|(votes, share)| f64::from(*votes) * share).sum();
            self.cells.extend(self.radii.windows(spread.len()).zip(2 - side..).map(|(near, bin)| Cell {
                x,
                y,
                radius: radius_px + f64::from(bin) * CELL_PX,
                votes: votes(near),
            }));
        }
    }

    /// Returns the mean of the circles with at least [`VOTE_FRACTION`] of the maximum votes, weighted by their excess;
    /// `None` without marks.
    fn mean_of_peak(&self) -> Option<Cell> {
        let max_votes = self.cells.iter().map(|cell| cell.votes).fold(0.0, f64::max);
        let (mut sum, mut mean) = (0.0, Cell { x: 0.0, y: 0.0, radius: 0.0, votes: max_votes });
        for cell in self.cells.iter().filter(|cell| cell.votes > VOTE_FRACTION * max_votes) {
            let weight = cell.votes - VOTE_FRACTION * max_votes;
            sum += weight;
            mean.x += weight * cell.x;
            mean.y += weight * cell.y;
            mean.radius += weight * cell.radius;
        }
        (sum > 0.0).then(|| Cell { x: mean.x / sum, y: mean.y / sum, radius: mean.radius / sum, votes: max_votes })
    }
}

/// Returns the index of the strongest change towards the background along a ray, if there is one.
///
/// `ball` is the filtered level and `inside` the level next to the rim.
fn boundary_sample(levels: &[f32], ball: f32, inside: f32) -> Option<usize> {
    let ground = levels.last()? - ball;
    if (inside - ball).abs() > MAX_SPECKLE_FRACTION * ground.abs() {
        return None;
    }
    let change = |at: usize| (levels[at + 1] - levels[at - 1]) * ground.signum();
    let at = (1..levels.len() - 1).max_by(|a, b| change(*a).total_cmp(&change(*b)))?;
    (change(at) > MIN_CONTRAST_FRACTION * ground.abs() && ground.abs() > 1.0).then_some(at)
}
