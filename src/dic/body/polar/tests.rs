//! Tests of the rotation of rings.

use super::*;
use crate::dic::geometry::Warp;
use crate::dic::tests::{Sequence, Speckle, prepared, record};
use crate::image::Image;

/// A pattern rotated about (70, 66) and shifted.
fn rotated_by(speckle: &Speckle, (u, v, angle_deg): (f64, f64, f64)) -> Image {
    let turn = Warp::rigid(u, v, angle_deg.to_radians());
    let motion = |x: f64, y: f64| {
        let (dx, dy) = (x - 70.0, y - 66.0);
        let (tx, ty) = turn.apply(dx, dy);
        (tx - dx, ty - dy)
    };
    speckle.moved(motion).draw(140, 132)
}

const CENTER: Point = Point { x_px: 70.0, y_px: 66.0 };

/// Measures the rotation between bodies at [`CENTER`].
fn rotation(
    reference: &PreparedFrame,
    target: &PreparedFrame,
    radii: Radii,
    near: Option<f64>,
) -> Result<RingRotation, PointStatus> {
    let at = |frame| CenteredFrame { frame, center: CENTER };
    PolarCorrelator::default().rotation(at(reference), at(target), radii, near)
}

const RADII: Radii = Radii { inner_px: 12.0, outer_px: 50.0 };

#[test]
fn any_rotation_is_found_without_a_start_to_a_hundredth_with_honest_uncertainty() {
    let speckle = Speckle::standard(41, 140.0);
    let reference = speckle.draw(140, 132);
    let mut ring = PolarCorrelator::default();
    for ([inner_px, outer_px], most_rms) in [([30.0, 50.0], 0.0035), ([20.0, 26.0], 0.012), ([8.0, 52.0], 0.003)] {
        let limits = Radii { inner_px, outer_px };
        let (mut square, mut reported, mut worst, mut count) = (0.0, 0.0, 0.0_f64, 0.0);
        for (case, angle_deg) in [0.07, -0.61, 2.93, 17.31, -90.4, 171.7].into_iter().enumerate() {
            let (u, v) = (1.37, -0.82);
            let target = rotated_by(&speckle, (u, v, angle_deg));
            for round in 0..6 {
                let seed = 300 + 20 * case as u64 + 2 * round;
                let (a, b) = (prepared(&record(&reference, 2.0, seed)), prepared(&record(&target, 2.0, seed + 1)));
                let from = CenteredFrame { frame: &a, center: CENTER };
                let to = CenteredFrame { frame: &b, center: Point::new(CENTER.x_px + u, CENTER.y_px + v) };
                let found = ring.rotation(from, to, limits, None).unwrap();
                let error = found.angle_deg - angle_deg;
                (square, reported) = (square + error * error, reported + found.sigma_deg.powi(2));
                (worst, count) = (worst.max(error.abs()), count + 1.0);
            }
        }
        let (rms, ratio) = ((square / count).sqrt(), (reported / square).sqrt());
        eprintln!("ring {limits:?}: rms {rms:.5} deg, worst {worst:.5}, reported/actual {ratio:.2}");
        assert!(rms < most_rms && worst < 4.0 * most_rms, "{limits:?}: {rms} {worst}");
        assert!((0.7..1.4).contains(&ratio), "{limits:?}: {ratio}");
    }
}

#[test]
fn the_ring_ends_at_the_edge_of_an_occluder() {
    let speckle = Speckle::standard(42, 140.0);
    let reference = prepared(&record(&speckle.draw(140, 132), 2.0, 1));
    let mut random = Sequence::new(3);
    for (edge_px, angle_deg) in [(44.0, 0.71), (30.0, -1.33), (22.0, 0.4)] {
        let mut image = record(&rotated_by(&speckle, (0.0, 0.0, angle_deg)), 2.0, 2);
        for (y, row) in image.rows_mut().enumerate() {
            for (x, level) in row.iter_mut().enumerate() {
                if x as f64 > CENTER.x_px + edge_px {
                    *level = (60.0 + 20.0 * random.normal() + (0.3 * (x + 2 * y) as f64).sin() * 30.0) as f32;
                }
            }
        }
        let target = prepared(&image);
        let found = rotation(&reference, &target, RADII, Some(0.0)).unwrap();
        eprintln!("edge at {edge_px}: {found:?}");
        assert!((edge_px - 7.0..=edge_px + 1.0).contains(&found.outer_px), "{edge_px}: {found:?}");
        assert!((found.angle_deg - angle_deg).abs() < 5.0 * found.sigma_deg, "{edge_px}: {found:?}");
    }
    let hidden = prepared(&Image::new(140, 132));
    let lost = rotation(&reference, &hidden, RADII, None);
    assert_eq!(lost.err(), Some(PointStatus::LowContrast));
}

#[test]
fn other_patterns_are_refused_and_repeating_ones_are_ambiguous() {
    let frame = |seed: u64| prepared(&record(&Speckle::standard(seed, 140.0).draw(140, 132), 2.0, seed));
    let other = rotation(&frame(1), &frame(2), RADII, None);
    assert!(
        matches!(other, Err(PointStatus::LowCorrelation | PointStatus::Ambiguous | PointStatus::Occluded)),
        "{other:?}"
    );
    let star = |angle_deg: f64| {
        let mut image = Image::new(140, 132);
        for (y, row) in image.rows_mut().enumerate() {
            for (x, level) in row.iter_mut().enumerate() {
                let angle = (CENTER.y_px - y as f64).atan2(x as f64 - CENTER.x_px) - angle_deg.to_radians();
                *level = (100.0 + 60.0 * (6.0 * angle).cos()) as f32;
            }
        }
        prepared(&record(&image, 1.0, 9))
    };
    let (a, b) = (star(0.0), star(2.5));
    assert_eq!(rotation(&a, &b, RADII, None).err(), Some(PointStatus::Ambiguous));
    let near = rotation(&a, &b, RADII, Some(0.0)).unwrap();
    assert!((near.angle_deg - 2.5).abs() < 0.05, "{near:?}");
}

#[test]
fn rings_outside_the_image_are_refused() {
    let frame = prepared(&Speckle::standard(1, 140.0).draw(140, 132));
    let unmoved = |x_px: f64, y_px: f64| {
        let body = CenteredFrame { frame: &frame, center: Point { x_px, y_px } };
        PolarCorrelator::default().rotation(body, body, RADII, None)
    };
    for (x_px, y_px) in [(5.0, 60.0), (f64::NAN, 60.0), (60.0, 1e9)] {
        assert_eq!(unmoved(x_px, y_px).err(), Some(PointStatus::OutOfFrame), "{x_px} {y_px}");
    }
    let near_edge = unmoved(30.0, 60.0).unwrap();
    assert!(near_edge.outer_px <= 30.0 && near_edge.angle_deg.abs() < 1e-4, "{near_edge:?}");
}
