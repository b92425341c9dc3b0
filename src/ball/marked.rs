//! The outline as the paper finds it: the boundary marked, the ball filtered, then a Hough transform.
//!
//! H. Ghaednia et al., Int. J. Mech. Sci. 131-132 (2017), section 4.3. The boundary is where the picture changes most
//! across the rim of a ball of one grey level; whole pixels there are marked, and vote for every circle through them.

use super::rays::within;
use crate::image::ImageView;
use crate::results::Circle;

/// The boundary lies this near to where the ball was seen, px.
const REACH_PX: f64 = 3.0;
/// Inside by more than this the ball is filtered: one grey level in place of its speckle, px.
const FILTERED_PX: f64 = 1.5;
/// From one circle tried to the next, along x, y and the radius, px.
const CELL_PX: f64 = 0.25;
/// From one place on a ray to the next, px.
const STRIDE_PX: f64 = 0.5;
/// A boundary has at least this share of the contrast of ball and ground.
const LEAST_SHARE: f32 = 0.25;
/// Where the ball beside its rim is off its filtered level by more than this share of that contrast, speckle is there.
const MOST_OFF_SHARE: f32 = 0.4;
/// Circles with at least this share of the most votes are averaged.
const NEAR_BEST: f64 = 0.8;
/// Least share of the rim that must be marked on the circle.
const LEAST_MARKED: f64 = 0.25;
/// Least share of the marks that must be on it.
const LEAST_AGREEING: f64 = 0.6;
/// What a marked pixel is off by: whole pixels, and speckle beside the rim, px.
const MARK_PX: f64 = 0.5;
/// Neighbouring marks that are off together: speckle beside the rim moves a run of them.
const ALIKE_MARKS: f64 = 20.0;

/// Scratch of the transform.
#[derive(Debug, Default)]
pub(super) struct Marked {
    /// Marked pixels, from the middle of the ball as it was seen.
    marks: Vec<(f64, f64)>,
    levels: Vec<f32>,
    radii: Vec<u32>,
    cells: Vec<Cell>,
}

/// A circle tried, about where the ball was seen, with its votes.
#[derive(Debug, Clone, Copy)]
struct Cell {
    x: f64,
    y: f64,
    radius: f64,
    votes: f64,
}

impl Marked {
    /// The circle that most of the boundary votes for; `None` where too little of it is marked, or lies elsewhere.
    pub(super) fn circle(&mut self, image: ImageView<'_>, seen: &Circle) -> Option<Circle> {
        let rays = (std::f64::consts::TAU * seen.radius_px).ceil();
        self.mark(image, seen, rays as usize);
        let best = self.transform(seen.radius_px)?;
        let on = |(x, y): &&(f64, f64)| ((x - best.x).hypot(y - best.y) - best.radius).abs() < 1.0;
        let marked = self.marks.iter().filter(on).count() as f64;
        if marked < LEAST_MARKED * rays || marked < LEAST_AGREEING * self.marks.len() as f64 {
            return None;
        }
        // Where many marks are off the circle, those on it are less sure, too.
        let astray = self.marks.len() as f64 / marked;
        let sigma_px = (CELL_PX / f64::sqrt(12.0)).hypot(MARK_PX * (2.0 * ALIKE_MARKS / marked).sqrt() * astray);
        Some(Circle {
            x_px: seen.x_px + best.x,
            y_px: seen.y_px + best.y,
            radius_px: best.radius,
            sigma_center_px: sigma_px,
            sigma_radius_px: sigma_px,
            ..*seen
        })
    }

    /// Marks the boundary pixel of every ray that has one.
    fn mark(&mut self, image: ImageView<'_>, seen: &Circle, rays: usize) {
        self.marks.clear();
        let Some(ball) = self.level(image, seen) else { return };
        let steps = (2.0 * REACH_PX / STRIDE_PX) as usize + 1;
        for ray in 0..rays {
            let (sin, cos) = (ray as f64 * std::f64::consts::TAU / rays as f64).sin_cos();
            self.levels.clear();
            let inner = seen.radius_px - FILTERED_PX;
            let Some(beside) = bilinear(image, seen.x_px + inner * cos, seen.y_px + inner * sin) else { continue };
            for step in 0..steps {
                let along = seen.radius_px - REACH_PX + STRIDE_PX * step as f64;
                let level = match along < inner {
                    true => Some(ball),
                    false => bilinear(image, seen.x_px + along * cos, seen.y_px + along * sin),
                };
                self.levels.extend(level);
            }
            if self.levels.len() < steps {
                continue;
            }
            if let Some(at) = boundary(&self.levels, ball, beside) {
                let along = seen.radius_px - REACH_PX + STRIDE_PX * at as f64;
                let pixel = |middle: f64, part: f64| (middle + along * part).round() - middle;
                let mark = (pixel(seen.x_px, cos), pixel(seen.y_px, sin));
                if self.marks.last() != Some(&mark) {
                    self.marks.push(mark);
                }
            }
        }
    }

    /// The grey level of the filtered ball: the median of what lies well inside.
    fn level(&mut self, image: ImageView<'_>, seen: &Circle) -> Option<f32> {
        self.levels.clear();
        let inside = seen.radius_px - FILTERED_PX;
        let rows = (seen.y_px - inside).max(0.0) as usize..((seen.y_px + inside).max(0.0) as usize).min(image.height());
        for y in rows.step_by(2) {
            let reach = (inside * inside - (y as f64 - seen.y_px).powi(2)).max(0.0).sqrt();
            let row = image.row(y);
            let end = ((seen.x_px + reach).max(0.0) as usize).min(row.len());
            let start = ((seen.x_px - reach).max(0.0) as usize).min(end);
            self.levels.extend(row[start..end].iter().step_by(2));
        }
        let middle = self.levels.len() / 2;
        (!self.levels.is_empty()).then(|| *self.levels.select_nth_unstable_by(middle, f32::total_cmp).1)
    }

    /// The Hough transform: each mark votes, for every centre near the one seen, for the radius that leads through it.
    fn transform(&mut self, radius_px: f64) -> Option<Cell> {
        let side = (REACH_PX / CELL_PX) as i32;
        let bins = 2 * side as usize + 1;
        self.cells.clear();
        for (row, column) in (-side..=side).flat_map(|row| (-side..=side).map(move |column| (row, column))) {
            let (x, y) = (f64::from(column) * CELL_PX, f64::from(row) * CELL_PX);
            self.radii.clear();
            self.radii.resize(bins, 0);
            for mark in &self.marks {
                let radius = ((mark.0 - x).powi(2) + (mark.1 - y).powi(2)).sqrt();
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
        let most = self.cells.iter().map(|cell| cell.votes).fold(0.0, f64::max);
        let (mut sum, mut mean) = (0.0, Cell { x: 0.0, y: 0.0, radius: 0.0, votes: most });
        for cell in self.cells.iter().filter(|cell| cell.votes > NEAR_BEST * most) {
            let weight = cell.votes - NEAR_BEST * most;
            sum += weight;
            mean.x += weight * cell.x;
            mean.y += weight * cell.y;
            mean.radius += weight * cell.radius;
        }
        (sum > 0.0).then(|| Cell { x: mean.x / sum, y: mean.y / sum, radius: mean.radius / sum, votes: most })
    }
}

/// Where a ray from a ball of this level outwards changes most towards the ground's, if it does.
fn boundary(levels: &[f32], ball: f32, beside: f32) -> Option<usize> {
    let ground = levels.last()? - ball;
    if (beside - ball).abs() > MOST_OFF_SHARE * ground.abs() {
        return None;
    }
    let change = |at: usize| (levels[at + 1] - levels[at - 1]) * ground.signum();
    let at = (1..levels.len() - 1).max_by(|a, b| change(*a).total_cmp(&change(*b)))?;
    (change(at) > LEAST_SHARE * ground.abs() && ground.abs() > 1.0).then_some(at)
}

fn bilinear(image: ImageView<'_>, x: f64, y: f64) -> Option<f32> {
    if !within(image, x as f32, y as f32) {
        return None;
    }
    let (column, row) = (x as usize, y as usize);
    let (fx, fy) = ((x - column as f64) as f32, (y - row as f64) as f32);
    let (upper, lower) = (image.row(row), image.row((row + 1).min(image.height() - 1)));
    let next = (column + 1).min(image.width() - 1);
    let along = |row: &[f32]| row[column] + fx * (row[next] - row[column]);
    Some(along(upper) + fy * (along(lower) - along(upper)))
}
