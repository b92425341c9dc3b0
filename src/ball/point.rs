//! A ball of a few pixels, by the centroid of what has changed.
//!
//! Such a ball has no rim that a circle could be fitted to: its edges are as wide as itself. What is known is the place that
//! differs from the background, whatever the shape of the blur.

use super::changed_disc::WantedRadius;
use super::foreground::ChangedPart;
use super::visible_fraction::fraction_in_image;
use crate::image::ImageView;
use crate::results::Circle;

/// The fraction of the highest difference from which a pixel counts fully: a ball before a mottled ground differs from it
/// by more on one side.
const FULL_HEIGHT: f32 = 0.5;
/// The reach of the centroid outside the ball, px: blur and smear.
const REACH_PX: f64 = 2.0;
/// The rounds in which the centroid is computed about the last one.
const ROUNDS: usize = 3;
/// The uncertainty of the centre, in radii: sides of the ball that look like the ground do not count.
const CENTER_ERROR: f64 = 0.05;
/// The relative uncertainty of a radius by its area: blur and smear enlarge it.
const RADIUS_ERROR: f64 = 0.25;
/// The minimum ratio of the change of the ball to that of any other part: its shadow moves as well.
const MIN_RATIO: f64 = 1.5;

/// The distance to which a ball stands alone, relative to the reach of its centroid, and the maximum change there relative to
/// its own. A piece of a larger ball has others around it.
const ALONE_REACH: f64 = 2.0;
const MAX_CHANGE_AROUND: f64 = 0.45;

/// A changed part, and how much it has changed.
#[derive(Debug, Clone, Copy)]
struct Point {
    circle: Circle,
    /// The sum of the differences, DN.
    change: f64,
}

/// Returns the ball among the changed parts of its size: the one that changed most.
///
/// `sizes` are the absolute differences from the background, DN. `None` if another part has changed about as much.
pub(super) fn find_point(sizes: ImageView<'_>, parts: &[ChangedPart], wanted: WantedRadius) -> Option<Circle> {
    let mut points: Vec<Point> = parts.iter().filter_map(|part| measure_point(sizes, part, wanted)).collect();
    points.sort_by(|a, b| b.change.total_cmp(&a.change));
    match points[..] {
        [point] => Some(point.circle),
        [point, other, ..] if point.change > MIN_RATIO * other.change => Some(point.circle),
        _ => None,
    }
}

/// Measures the centroid of a changed part; `None` if it does not stand alone, and at the border of the image, where a part
/// of it is missing.
fn measure_point(sizes: ImageView<'_>, part: &ChangedPart, wanted: WantedRadius) -> Option<Point> {
    let radius_px = wanted.expected.unwrap_or(part.circle.radius.into());
    let reach_px = radius_px.max(part.circle.radius.into()) + REACH_PX;
    let (mut x_px, mut y_px) = (f64::from(part.circle.x), f64::from(part.circle.y));
    if fraction_in_image(x_px, y_px, reach_px, sizes.width(), sizes.height()) < 1.0 {
        return None;
    }
    let mut spread = None;
    for _ in 0..ROUNDS {
        let found = Centroid::about(sizes, [x_px, y_px], reach_px, part.noise_dn)?;
        [x_px, y_px] = found.at_px;
        spread = Some(found);
    }
    let Centroid { sigma_px, change, .. } = spread?;
    let around = Centroid::about(sizes, [x_px, y_px], ALONE_REACH * reach_px, part.noise_dn)?;
    if around.change - change > MAX_CHANGE_AROUND * change {
        return None;
    }
    let sigma_radius_px = RADIUS_ERROR * radius_px;
    let sigma_center_px = (CENTER_ERROR * radius_px).hypot(sigma_px);
    let circle = Circle { x_px, y_px, radius_px, sigma_center_px, sigma_radius_px, visible_fraction: 1.0 };
    Some(Point { circle, change })
}

/// The centroid of the differences around a place.
#[derive(Debug, Clone, Copy)]
struct Centroid {
    at_px: [f64; 2],
    /// The standard uncertainty, px: by noise, and the distance to the centroid in which each difference counts in full.
    sigma_px: f64,
    /// The sum of the differences, DN.
    change: f64,
}

impl Centroid {
    /// Computes the centroid within `reach_px` of a place; `None` without a difference above the noise, DN.
    fn about(sizes: ImageView<'_>, at_px: [f64; 2], reach_px: f64, noise_dn: f32) -> Option<Self> {
        let range = |center: f64, side: usize| {
            let first = (center - reach_px).ceil().max(0.0) as usize;
            first..((center + reach_px).floor().max(0.0) as usize + 1).min(side)
        };
        let [columns, rows] = [range(at_px[0], sizes.width()), range(at_px[1], sizes.height())];
        let pixels = || rows.clone().flat_map(|y| columns.clone().map(move |x| (x, y)));
        let distance_px = |x: usize, y: usize| (x as f64 - at_px[0]).hypot(y as f64 - at_px[1]);
        let size = |x: usize, y: usize| sizes.at(x, y).filter(|_| distance_px(x, y) <= reach_px).unwrap_or(0.0);
        let highest = pixels().map(|(x, y)| size(x, y)).fold(0.0, f32::max);
        let full_dn = FULL_HEIGHT * highest;
        let (mut sum, mut moment, mut change, mut squares) = (0.0, [0.0; 2], 0.0, 0.0);
        let mut full_moment = [0.0; 2];
        for (x, y) in pixels() {
            // Noise alone is no change, whatever its sign.
            let above_dn = (size(x, y) - 2.0 * noise_dn).max(0.0);
            let weight = f64::from(above_dn.min(full_dn));
            sum += weight;
            moment[0] += weight * x as f64;
            moment[1] += weight * y as f64;
            change += f64::from(above_dn);
            full_moment[0] += f64::from(above_dn) * x as f64;
            full_moment[1] += f64::from(above_dn) * y as f64;
            squares += distance_px(x, y).powi(2) * f64::from(u8::from(above_dn > 0.0));
        }
        let at_px = moment.map(|moment| moment / sum);
        let apart_px = (full_moment[0] / change - at_px[0]).hypot(full_moment[1] / change - at_px[1]);
        let sigma_px = (f64::from(noise_dn) * squares.sqrt() / sum).hypot(apart_px);
        (sum > 0.0).then_some(Self { at_px, sigma_px, change })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ball::foreground::Foreground;
    use crate::ball::texture_disc::RadiusRange;
    use crate::image::{Image, PixelRect};
    use crate::numeric::Stream;

    const RADII: RadiusRange = RadiusRange { low: 2.0, high: 6.0 };

    /// The difference of a ball of one level from a mottled ground, smeared along x, with noise.
    fn difference(at_px: [f64; 2], radius_px: f64, smear_px: f64, noise_dn: f32, seed: u64) -> Image {
        let mut random = Stream::new(seed);
        let mut image = Image::new(72, 60);
        for (y, row) in image.rows_mut().enumerate() {
            for (x, level) in row.iter_mut().enumerate() {
                let covered = (0..9).map(|k| {
                    let dx = x as f64 - at_px[0] - smear_px * (f64::from(k) - 4.0) / 8.0;
                    (radius_px + 0.5 - dx.hypot(y as f64 - at_px[1])).clamp(0.0, 1.0)
                });
                let ground = 60.0 + 20.0 * (0.7 * x as f64).sin() * (0.5 * y as f64).cos();
                *level = (covered.sum::<f64>() / 9.0 * (200.0 - ground)) as f32 + noise_dn * random.normal() as f32;
            }
        }
        image
    }

    fn found(difference: &Image, expected: Option<f64>) -> Option<Circle> {
        let mut foreground = Foreground::default();
        let parts = foreground.search(difference.view(), PixelRect::whole(72, 60), RADII);
        let sizes = ImageView::new(foreground.sizes(), 72, 60).unwrap();
        find_point(sizes, &parts, WantedRadius { range: RADII, expected })
    }

    #[test]
    fn a_ball_of_a_few_pixels_is_found_within_its_uncertainty() {
        let (mut squares, mut worst) = (0.0, 0.0_f64);
        for case in 0..60_u32 {
            let k = f64::from(case);
            let (at_px, radius_px) = ([31.0 + 0.237 * k, 24.0 + 0.171 * k], 2.5 + 3.0 * k / 59.0);
            let image = difference(at_px, radius_px, 0.1 * k, 3.0, case.into());
            let circle = found(&image, (case % 2 == 0).then_some(radius_px)).unwrap();
            let errors = [circle.x_px - at_px[0], circle.y_px - at_px[1]].map(|error| error / circle.sigma_center_px);
            squares += errors[0].powi(2) + errors[1].powi(2);
            worst = errors.iter().fold(worst, |worst, error| worst.max(error.abs()));
        }
        let rms = (squares / 120.0_f64).sqrt();
        eprintln!("errors rms {rms}, worst {worst} sigmas");
        assert!((0.1..1.0).contains(&rms) && worst < 3.5, "rms {rms}, worst {worst} sigmas");
    }

    #[test]
    fn a_piece_of_a_larger_ball_is_no_point() {
        let mut image = difference([30.3, 28.1], 4.0, 0.0, 1.0, 3);
        assert!(found(&image, None).is_some());
        let other = difference([41.9, 30.1], 4.0, 0.0, 0.0, 4);
        image.data_mut().iter_mut().zip(other.view().data()).for_each(|(level, other)| *level += 0.6 * other);
        assert_eq!(found(&image, None), None);
    }

    #[test]
    fn of_two_alike_none_is_the_ball() {
        let mut image = difference([20.3, 20.1], 4.0, 0.0, 1.0, 1);
        let other = difference([50.2, 40.4], 4.0, 0.0, 0.0, 2);
        image.data_mut().iter_mut().zip(other.view().data()).for_each(|(level, other)| *level += other);
        assert_eq!(found(&image, Some(4.0)), None);
    }
}
