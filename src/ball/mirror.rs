//! Mirror images: a glossy surface shows a ball once more, upside down, and often before a quieter ground.
//!
//! The ball is the one on the outer side of the surface.

use super::ransac::RoughCircle;
use crate::image::ImageView;
use crate::results::Circle;

/// The part of the image that is compared, in radii, and the distance of its samples in the search and in the decision.
const PATCH_RADII: f64 = 1.25;
const SEARCH_RADII: f64 = 0.3;
const SAMPLE_RADII: f64 = 0.15;
/// The minimum distance of a ball from its mirror image, in radii. They touch at two.
const MIN_APART_RADII: f64 = 1.7;
/// The steps of the search along the normal, in radii and px, and its shifts along the surface, in radii.
const STEP_RADII: f64 = 0.08;
const MIN_STEP_PX: f64 = 0.5;
const SHIFTS_RADII: [f64; 3] = [0.0, -0.08, 0.08];
/// The minimum fraction of the samples inside the image.
const MIN_INSIDE: f64 = 0.6;
/// The minimum correlation of a ball with its mirror image, in the search and in the decision.
const SEARCH_CORRELATION: f64 = 0.4;
const MIN_CORRELATION: f64 = 0.65;
/// The maximum difference of the radius and of the place along the surface, in radii and px.
const SAME_RADII: f64 = 0.1;
const SAME_PX: f64 = 1.0;

/// A direction in the image, a unit vector along x and y (down).
type Direction = [f64; 2];

/// Returns the place farther along `outward` at which the image shows a circle upside down; `None` without such a place.
pub(super) fn find_original(image: ImageView<'_>, circle: &Circle, outward: Direction) -> Option<RoughCircle> {
    let coarse = Patch::new(image, circle, outward, SEARCH_RADII)?;
    let step_px = (STEP_RADII * circle.radius_px).max(MIN_STEP_PX);
    let reach_px = (image.width() as f64).hypot(image.height() as f64);
    let first_px = MIN_APART_RADII * circle.radius_px;
    let steps = ((reach_px - first_px) / step_px).max(0.0) as u32;
    let best = |patch: &Patch, places: &mut dyn Iterator<Item = [f64; 2]>| {
        let compared = places.filter_map(|place| Some((patch.correlation(image, place)?, place)));
        compared.max_by(|a, b| a.0.total_cmp(&b.0))
    };
    let mut along = (0..steps).map(|k| [first_px + step_px * f64::from(k), 0.0]);
    let (_, [near_px, _]) = best(&coarse, &mut along).filter(|(found, _)| *found > SEARCH_CORRELATION)?;
    let patch = Patch::new(image, circle, outward, SAMPLE_RADII)?;
    let shifts = SHIFTS_RADII.map(|shift| shift * circle.radius_px);
    let mut places = (-1..=1).flat_map(|k| shifts.map(|shift_px| [near_px + step_px * f64::from(k), shift_px]));
    let (_, [apart_px, shift_px]) = best(&patch, &mut places).filter(|(found, _)| *found > MIN_CORRELATION)?;
    let [x, y] = patch.point(apart_px, shift_px);
    Some(RoughCircle { x: x as f32, y: y as f32, radius: circle.radius_px as f32 })
}

/// Whether two circles may be a ball and its mirror image: of one size, and at one place along the surface.
pub(super) fn is_mirrored(circle: &Circle, original: &Circle, outward: Direction) -> bool {
    let [x, y] = [original.x_px - circle.x_px, original.y_px - circle.y_px];
    let (apart_px, aside_px) = (x * outward[0] + y * outward[1], y * outward[0] - x * outward[1]);
    let tolerance_px = SAME_PX + SAME_RADII * circle.radius_px;
    let is_same_size = (original.radius_px - circle.radius_px).abs() < tolerance_px;
    is_same_size && aside_px.abs() < tolerance_px && apart_px > MIN_APART_RADII * circle.radius_px - tolerance_px
}

/// The samples of a circle and its surroundings.
struct Patch {
    center_px: [f64; 2],
    outward: Direction,
    /// Offsets from the centre along the normal and along the surface, px, and the grey level there.
    samples: Vec<([f64; 2], f64)>,
}

impl Patch {
    /// Samples a circle at a distance of `sample_radii`; `None` if too little of it is in the image.
    fn new(image: ImageView<'_>, circle: &Circle, outward: Direction, sample_radii: f64) -> Option<Self> {
        let mut patch = Self { center_px: [circle.x_px, circle.y_px], outward, samples: Vec::new() };
        let side = (PATCH_RADII / sample_radii) as i32;
        let (mut all, unit_px) = (0, sample_radii * circle.radius_px);
        for (row, column) in (-side..=side).flat_map(|row| (-side..=side).map(move |column| (row, column))) {
            let [normal, tangential] = [row, column].map(|k| unit_px * f64::from(k));
            if normal.hypot(tangential) > PATCH_RADII * circle.radius_px {
                continue;
            }
            all += 1;
            let [x, y] = patch.point(normal, tangential);
            patch.samples.extend(image.interpolate(x, y).map(|grey| ([normal, tangential], f64::from(grey))));
        }
        (patch.samples.len() as f64 >= MIN_INSIDE * f64::from(all)).then_some(patch)
    }

    /// Returns the point of the image at an offset along the normal and along the surface, px.
    fn point(&self, normal: f64, tangential: f64) -> [f64; 2] {
        let ([x, y], [nx, ny]) = (self.center_px, self.outward);
        [x + normal * nx - tangential * ny, y + normal * ny + tangential * nx]
    }

    /// Returns the correlation of the patch with its mirror image at a place; `None` where too little is in the image.
    fn correlation(&self, image: ImageView<'_>, [apart_px, shift_px]: [f64; 2]) -> Option<f64> {
        let mut sums = [0.0_f64; 6];
        for ([normal, tangential], a) in &self.samples {
            let [x, y] = self.point(apart_px - normal, shift_px + tangential);
            let Some(b) = image.interpolate(x, y).map(f64::from) else { continue };
            for (sum, term) in sums.iter_mut().zip([1.0, *a, b, a * a, a * b, b * b]) {
                *sum += term;
            }
        }
        let [n, a, b, aa, ab, bb] = sums;
        if n < MIN_INSIDE * self.samples.len() as f64 {
            return None;
        }
        let correlation = (ab - a * b / n) / ((aa - a * a / n) * (bb - b * b / n)).sqrt();
        correlation.is_finite().then_some(correlation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;

    const BALL: Circle = Circle {
        x_px: 60.0,
        y_px: 40.0,
        radius_px: 12.0,
        sigma_center_px: 0.02,
        sigma_radius_px: 0.02,
        visible_fraction: 1.0,
    };

    /// A marked ball, and its mirror image below the surface at y = 70 px.
    fn scene() -> Image {
        let mut image = Image::new(120, 120);
        for (y, row) in image.rows_mut().enumerate() {
            for (x, level) in row.iter_mut().enumerate() {
                let (x, y) = (x as f64, y as f64);
                let is_below = y > 70.0;
                let (dx, dy) = (x - BALL.x_px, if is_below { 140.0 - y } else { y } - BALL.y_px);
                let is_mark = (2.0 * dy.atan2(dx) + 0.3 * dx).sin() > 0.2;
                let ball = if is_mark { 60.0 } else { 190.0 };
                let grey = if dx.hypot(dy) < BALL.radius_px { ball } else { 170.0 };
                *level = if is_below { 30.0 + 0.4 * grey } else { grey } as f32;
            }
        }
        image
    }

    #[test]
    fn the_ball_of_a_mirror_image_is_above_it() {
        let image = scene();
        let mirrored = Circle { y_px: 100.0, ..BALL };
        let found = find_original(image.view(), &mirrored, [0.0, -1.0]).unwrap();
        assert!((found.x - 60.0).abs() < 1.0 && (found.y - 40.0).abs() < 1.0, "{} {}", found.x, found.y);
        assert!(is_mirrored(&mirrored, &BALL, [0.0, -1.0]) && !is_mirrored(&BALL, &mirrored, [0.0, -1.0]));
        assert!(find_original(image.view(), &BALL, [0.0, -1.0]).is_none(), "nothing is above the ball");
    }
}
