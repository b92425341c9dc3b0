//! Invalid input: images and parameters that must end in a status or an error.

use super::speckle_image::{Disc, Sequence, Speckle, record};
use crate::dic::geometry::grid::rectangle;
use crate::dic::geometry::{GridPoint, SubsetMask, Warp};
use crate::dic::image::PreparedFrame;
use crate::dic::refine::Refiner;
use crate::dic::subset::ReferenceSubset;
use crate::dic::*;
use crate::image::Image;
use crate::numeric::Lanes;
use crate::results::{FieldPoint, PointStatus};

fn correlate(reference: &Image, target: &Image, params: &CorrelationParams) -> Vec<FieldPoint> {
    let (width, height) = (reference.view().width(), reference.view().height());
    let mut correlator = Correlator::new(params, width, height).unwrap();
    let points = rectangle([0, 0, width as u32, height as u32], params.step_px, params.subset_size_px);
    let (reference, target) = (correlator.prepare(reference.view()), correlator.prepare(target.view()));
    let mut field = vec![];
    correlator.correlate(&reference, &target, &points, Start::Search, &mut field);
    assert_eq!(field.len(), points.len());
    assert!(field.iter().all(|p| p.displacement.is_some() == (p.status == PointStatus::Valid)));
    field
}

fn filled(level: f32) -> Image {
    Image::from_vec(vec![level; 100 * 100], 100, 100).unwrap()
}

fn speckled(seed: u64) -> Image {
    record(&Speckle::standard(seed, 100.0).draw(100, 100), 1.0, seed)
}

#[test]
fn one_pixel_images_and_oversized_subsets_are_refused_with_both_sizes() {
    let error = Correlator::new(&CorrelationParams::default(), 1, 1).err().unwrap().to_string();
    assert_eq!(error, "correlation.subset_size_px is 31, larger than the image of 1 x 1 px");
    assert!(Correlator::new(&CorrelationParams::default(), 31, 31).is_ok());
}

#[test]
fn parameters_out_of_range_are_named_with_value_and_range() {
    let wrong = CorrelationParams { subset_size_px: 30, ..CorrelationParams::default() };
    let error = Correlator::new(&wrong, 100, 100).err().unwrap().to_string();
    assert_eq!(error, "correlation.subset_size_px is 30, allowed: odd, 9 to 255");
    let wrong = CorrelationParams { min_zncc: f64::NAN, ..CorrelationParams::default() };
    assert!(Correlator::new(&wrong, 100, 100).err().unwrap().to_string().contains("min_zncc is NaN"));
}

#[test]
fn images_without_texture_have_low_contrast_on_either_side() {
    for (reference, target) in [(filled(0.0), filled(0.0)), (filled(255.0), filled(255.0)), (filled(7.0), speckled(1))]
    {
        let field = correlate(&reference, &target, &CorrelationParams::default());
        assert!(!field.is_empty() && field.iter().all(|p| p.status == PointStatus::LowContrast));
    }
    let field = correlate(&speckled(1), &filled(0.0), &CorrelationParams::default());
    assert!(field.iter().all(|p| p.status == PointStatus::LowCorrelation));
}

#[test]
fn noise_alone_is_never_a_displacement() {
    let grey = filled(100.0);
    let field = correlate(&record(&grey, 3.0, 5), &record(&grey, 3.0, 6), &CorrelationParams::default());
    assert!(field.iter().all(|p| p.status == PointStatus::LowContrast), "{:?}", field[0]);
}

#[test]
fn saturated_subsets_have_low_contrast() {
    let bright = |seed: u64| {
        let mut image = speckled(seed);
        image.data_mut().iter_mut().for_each(|level| *level = (*level * 5.0).min(255.0));
        image
    };
    let field = correlate(&bright(3), &bright(3), &CorrelationParams::default());
    assert!(field.iter().all(|p| p.status == PointStatus::LowContrast));
}

#[test]
fn stripes_have_low_contrast_along_themselves() {
    let mut image = Image::new(100, 100);
    let mut sequence = Sequence::new(4);
    let levels: Vec<f32> = (0..100).map(|_| (40.0 + 150.0 * sequence.uniform()) as f32).collect();
    image.rows_mut().for_each(|row| row.copy_from_slice(&levels));
    for sigma in [0.0, 2.0] {
        let field = correlate(&record(&image, sigma, 1), &record(&image, sigma, 2), &CorrelationParams::default());
        assert!(field.iter().all(|p| p.displacement.is_none()), "{:?}", field[4]);
    }
}

#[test]
fn a_regular_grid_is_ambiguous() {
    for (pitch, shift) in [(8.0, 0.3), (9.7, 0.0), (7.3, 2.4)] {
        let disc = |k: i32| Disc {
            x: f64::from(k % 20) * pitch - 10.0,
            y: f64::from(k / 20) * pitch - 10.0,
            radius: 0.3 * pitch,
        };
        let pattern = Speckle { discs: (0..400).map(disc).collect(), edge: 0.6, contrast: 200.0 };
        let reference = record(&pattern.draw(100, 100), 2.0, 1);
        let target = record(&pattern.moved(|_, _| (shift, -shift)).draw(100, 100), 2.0, 2);
        let field = correlate(&reference, &target, &CorrelationParams::default());
        assert!(field.iter().all(|p| p.status == PointStatus::Ambiguous), "pitch {pitch}: {:?}", field[0]);
    }
}

#[test]
fn another_image_is_low_correlation_and_a_subset_that_left_is_out_of_frame() {
    let field = correlate(&speckled(1), &speckled(2), &CorrelationParams::default());
    assert!(field.iter().all(|p| p.status == PointStatus::LowCorrelation), "{field:?}");
    let speckle = Speckle::standard(1, 140.0);
    let moved = speckle.moved(|_, _| (-30.0, 0.0));
    let params = CorrelationParams { search_px: 40, ..CorrelationParams::default() };
    let field = correlate(&record(&speckle.draw(100, 100), 1.0, 1), &record(&moved.draw(100, 100), 1.0, 2), &params);
    for point in &field {
        let touches = [point.x_px - 30.0, point.y_px].iter().any(|center| *center <= 15.0 || *center >= 84.0);
        let expected = match point.x_px {
            x if x < 45.0 => PointStatus::LowCorrelation,
            _ if touches => PointStatus::OutOfFrame,
            _ => PointStatus::Valid,
        };
        // A subset exactly on the edge may get either status.
        let either = touches && point.status == PointStatus::Valid;
        assert!(point.status == expected || either, "{point:?}");
    }
}

#[test]
fn a_subset_that_a_known_motion_leads_out_of_the_image_is_out_of_frame() {
    let speckle = Speckle::standard(1, 140.0);
    let moved = speckle.moved(|_, _| (-30.0, 0.0));
    let params = CorrelationParams::default();
    let mut correlator = Correlator::new(&params, 100, 100).unwrap();
    let points = rectangle([0, 10, 100, 80], params.step_px, params.subset_size_px);
    let reference = correlator.prepare(record(&speckle.draw(100, 100), 1.0, 1).view());
    let target = correlator.prepare(record(&moved.draw(100, 100), 1.0, 2).view());
    let start = Start::Motion { x_px: 50.0, y_px: 50.0, u_px: -30.1, v_px: 0.1, angle_deg: 0.0 };
    let mut field = Vec::new();
    correlator.correlate(&reference, &target, &points, start, &mut field);
    assert!(field.iter().any(|point| point.x_px < 45.0) && field.iter().any(|point| point.x_px > 46.0));
    for point in &field {
        let expected = if point.x_px < 45.0 { PointStatus::OutOfFrame } else { PointStatus::Valid };
        assert!(point.status == expected || (45.0..46.0).contains(&point.x_px), "{point:?}");
    }
}

#[test]
fn sixteen_bit_images_and_any_gain_give_the_same_field() {
    let speckle = Speckle::standard(1, 100.0);
    let a = record(&speckle.draw(100, 100), 1.0, 1);
    let b = record(&speckle.moved(|_, _| (0.4, 0.7)).draw(100, 100), 1.0, 2);
    let scaled = |image: &Image, gain: f32, offset: f32| {
        let mut image = image.clone();
        image.data_mut().iter_mut().for_each(|level| *level = *level * gain + offset);
        image
    };
    let plain = correlate(&a, &b, &CorrelationParams::default());
    let bright = correlate(&scaled(&a, 250.0, 900.0), &scaled(&b, 180.0, 3000.0), &CorrelationParams::default());
    for (p, q) in plain.iter().zip(&bright) {
        let (p, q) = (p.displacement.unwrap(), q.displacement.unwrap());
        assert!((p.u_px - q.u_px).abs() < 1e-4 && (p.v_px - q.v_px).abs() < 1e-4);
        assert!((p.sigma_u_px / q.sigma_u_px - 1.0).abs() < 0.05, "{p:?} {q:?}");
    }
}

#[test]
fn fields_do_not_depend_on_earlier_calls() {
    let speckle = Speckle::standard(1, 100.0);
    let a = record(&speckle.draw(100, 100), 1.0, 1);
    let b = record(&speckle.moved(|_, _| (0.4, 0.7)).draw(100, 100), 1.0, 2);
    let params = CorrelationParams::default();
    let points = rectangle([0, 0, 100, 100], 10, 31);
    let fresh = correlate(&a, &b, &params);
    let mut correlator = Correlator::new(&params, 100, 100).unwrap();
    let (mut ready_a, mut ready_b) = (correlator.prepare(speckled(9).view()), correlator.prepare(filled(3.0).view()));
    let mut field = Vec::new();
    correlator.correlate(&ready_a, &ready_b, &points[2..5], Start::Search, &mut field);
    let away = Start::Motion { x_px: 50.0, y_px: 50.0, u_px: 30.0, v_px: f64::NAN, angle_deg: 90.0 };
    correlator.correlate(&ready_a, &ready_a, &points, away, &mut field);
    correlator.prepare_into(a.view(), &mut ready_a);
    correlator.prepare_into(b.view(), &mut ready_b);
    correlator.correlate(&ready_a, &ready_b, &points, Start::Search, &mut field);
    assert_eq!(field, fresh);
}

#[test]
fn kept_references_and_starts_from_neighbours_give_the_same_field() {
    let speckle = Speckle::standard(1, 160.0);
    let turn = |x: f64, y: f64| (0.4 + 0.03 * (y - 80.0), 0.7 - 0.03 * (x - 80.0));
    let a = record(&speckle.draw(160, 160), 1.0, 1);
    let b = record(&speckle.moved(turn).draw(160, 160), 1.0, 2);
    let params = CorrelationParams::default();
    let points = rectangle([8, 8, 144, 144], 10, 31);
    let mut correlator = Correlator::new(&params, 160, 160).unwrap();
    let (a, b) = (correlator.prepare(a.view()), correlator.prepare(b.view()));
    let (mut searched, mut kept_field, mut neighbors) = (Vec::new(), Vec::new(), Vec::new());
    correlator.correlate(&a, &b, &points, Start::Search, &mut searched);
    assert!(searched.iter().all(|point| point.status == PointStatus::Valid));
    let kept = correlator.keep_reference(a.clone(), &points);
    correlator.correlate_kept(&kept, &b, Start::Search, &mut kept_field);
    assert_eq!(kept_field, searched);
    correlator.correlate(&a, &b, &points, Start::Neighbor, &mut neighbors);
    for (p, q) in searched.iter().zip(&neighbors) {
        let (d, e) = (p.displacement.unwrap(), q.displacement.unwrap());
        assert!((d.u_px - e.u_px).hypot(d.v_px - e.v_px) < 0.001, "{p:?} {q:?}");
    }
}

#[test]
fn a_neighbour_across_an_edge_of_motion_does_not_mislead() {
    let speckle = Speckle::standard(3, 160.0);
    let a = record(&speckle.draw(160, 100), 1.0, 1);
    let b = record(&speckle.moved(|x, _| if x < 80.0 { (0.0, 3.0) } else { (5.0, -4.0) }).draw(160, 100), 1.0, 2);
    let params = CorrelationParams { step_px: 8, subset_size_px: 21, ..CorrelationParams::default() };
    let mut correlator = Correlator::new(&params, 160, 100).unwrap();
    let (a, b) = (correlator.prepare(a.view()), correlator.prepare(b.view()));
    let mut field = Vec::new();
    correlator.correlate(&a, &b, &rectangle([5, 10, 150, 80], 8, 21), Start::Neighbor, &mut field);
    for point in field.iter().filter(|point| (point.x_px - 80.0).abs() > 16.0) {
        let expected = if point.x_px < 80.0 { (0.0, 3.0) } else { (5.0, -4.0) };
        let found = point.displacement.unwrap();
        assert!((found.u_px - expected.0).abs() < 0.05 && (found.v_px - expected.1).abs() < 0.05, "{point:?}");
    }
}

/// A still background around a moving body biases whole subsets at its rim, but not clipped ones.
#[test]
fn subsets_are_cut_at_the_edge_of_a_region() {
    let speckle = Speckle::standard(4, 160.0);
    let inside = |x: f64, y: f64| (x - 80.0).hypot(y - 80.0) < 50.0;
    let moved = speckle.moved(|x, y| if inside(x, y) { (1.4, -0.6) } else { (0.0, 0.0) });
    let params = CorrelationParams { shape: Shape::Translation, ..CorrelationParams::default() };
    let mut correlator = Correlator::new(&params, 160, 160).unwrap();
    let a = correlator.prepare(record(&speckle.draw(160, 160), 1.0, 1).view());
    let b = correlator.prepare(record(&moved.draw(160, 160), 1.0, 2).view());
    // Discs reach a few pixels over the edge between the two motions.
    let region = Region::Disc { x_px: 80.0, y_px: 80.0, radius_px: 45.0 };
    let points = [GridPoint { x: 80, y: 80 }, GridPoint { x: 120, y: 80 }, GridPoint { x: 80, y: 42 }];
    let mut field = Vec::new();
    correlator.correlate(&a, &b, &points, Start::Search, &mut field);
    let error = |point: &FieldPoint| point.displacement.map(|d| (d.u_px - 1.4).hypot(d.v_px + 0.6));
    assert!(error(&field[1]).is_none_or(|error| error > 0.02), "a whole subset at the rim is spoiled: {:?}", field[1]);
    correlator.set_region(Some(region));
    correlator.correlate(&a, &b, &points, Start::Search, &mut field);
    for point in &field {
        assert!(error(point).is_some_and(|error| error < 0.02), "{point:?}");
    }
    correlator.correlate(&a, &b, &[GridPoint { x: 130, y: 80 }], Start::Search, &mut field);
    assert_eq!(field[0].status, PointStatus::OutOfFrame);
}

#[test]
fn subsets_with_texture_in_one_corner_have_low_contrast() {
    let mut speckle = Speckle::standard(8, 100.0);
    speckle.discs.retain(|disc| disc.x < 36.0 && disc.y < 36.0);
    let moved = speckle.moved(|_, _| (0.3, 0.4));
    let mut correlator = Correlator::new(&CorrelationParams::default(), 100, 100).unwrap();
    let a = correlator.prepare(record(&speckle.draw(100, 100), 2.0, 1).view());
    let b = correlator.prepare(record(&moved.draw(100, 100), 2.0, 2).view());
    let mut field = Vec::new();
    correlator.correlate(&a, &b, &[GridPoint { x: 45, y: 45 }, GridPoint { x: 20, y: 20 }], Start::Search, &mut field);
    assert_eq!(field[0].status, PointStatus::LowContrast);
    assert_eq!(field[1].status, PointStatus::Valid);
}

/// Poor matches produce extreme warps. Any warp must be sampled within the image or refused.
#[test]
fn any_warp_of_any_window_anywhere_is_sampled_or_refused() {
    let (mut reference, mut target) = (PreparedFrame::default(), PreparedFrame::default());
    reference.fill(speckled(1).view(), Interpolation::Optimised);
    target.fill(speckled(2).view(), Interpolation::Optimised);
    let mut random = Sequence::new(5);
    let (mut sampled, mut residual) = (0, Vec::new());
    for case in 0..6000 {
        let shape = [WindowShape::Square, WindowShape::Circle, WindowShape::Ring][case % 3];
        let whole = SubsetMask::new(shape, [15, 31, 45][case / 3 % 3]);
        let (a, b) = (random.normal(), random.normal());
        let (mut window, mut subset) = (whole.clone(), ReferenceSubset::default());
        if case % 4 > 1 {
            let belongs = |dx: i32, dy: i32| f64::from(dx) * a + f64::from(dy) * b < 6.0;
            if case % 4 == 2 {
                whole.clip(belongs, &mut window);
            } else {
                let kept: Vec<Lanes> =
                    whole.mask.iter().map(|row| *row * Lanes::splat(random.normal() as f32)).collect();
                let kept: Vec<Lanes> =
                    kept.iter().map(|row| Lanes(row.0.map(|v| f32::from(u8::from(v > 0.8))))).collect();
                whole.restrict(&kept, &mut window);
            }
        }
        let mut place = || (45.0 + 25.0 * random.normal()).clamp(0.0, 89.0) as u32;
        let at = GridPoint { x: place(), y: place() };
        if subset.fill(&reference, &window, Shape::Affine, at).is_err() {
            continue;
        }
        let mut bend = || 0.4 * random.normal();
        let [ux, uy, vx, vy] = [bend(), bend(), bend(), bend()];
        let warp = Warp { u: 25.0 * bend(), v: 25.0 * bend(), ux, uy, vx, vy };
        let at = target.local(at);
        let refiner =
            Refiner { subset: &subset, window: &window, shape: Shape::Affine, target: &target.interpolated, at };
        for warp in [warp, Warp::shift(warp.u, warp.v), Warp::rigid(warp.u, warp.v, 3.0 * ux)] {
            sampled += i32::from(refiner.gauss_newton_step(&warp).is_ok());
            let _ = refiner.refine(warp);
            refiner.residual(&warp, &mut residual);
            assert!(residual.iter().all(|row| row.0.iter().all(|value| value.is_finite())));
        }
    }
    assert!(sampled > 1000, "{sampled} were sampled");
}
