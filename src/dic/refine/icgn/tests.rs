//! Tests of the refinement against the statistical correlation.

use super::*;
use crate::dic::geometry::{GridPoint, Pixel};
use crate::dic::image::PreparedFrame;
use crate::dic::tests::{Speckle, record};
use crate::dic::{Interpolation, WindowShape, zncc};
use crate::image::{Image, ImageView};
use crate::numeric::Portable;

fn pair() -> (Image, PreparedFrame, PreparedFrame) {
    let speckle = Speckle::standard(71, 90.0);
    let turn = Warp::rigid(0.63, -0.31, 0.03);
    let moved = speckle.moved(|x, y| {
        let (tx, ty) = turn.apply(x - 45.0, y - 45.0);
        (tx - (x - 45.0), ty - (y - 45.0))
    });
    let reference = record(&speckle.draw(90, 90), 1.0, 1);
    let (mut a, mut b) = (PreparedFrame::default(), PreparedFrame::default());
    a.fill(reference.view(), Interpolation::Optimised);
    b.fill(record(&moved.draw(90, 90), 1.0, 2).view(), Interpolation::Optimised);
    (reference, a, b)
}

/// The reference implementation: the statistical correlation of the reference subset with the resampled target.
#[test]
fn the_answer_is_where_the_statistical_correlation_is_highest() {
    let (image, reference, target) = pair();
    let window = SubsetMask::new(WindowShape::Square, 31);
    let mut subset = ReferenceSubset::default();
    let at = GridPoint { x: 45, y: 44 };
    subset.fill(&reference, &window, Shape::Affine, at).unwrap();
    let refiner = Refiner {
        subset: &subset,
        window: &window,
        shape: Shape::Affine,
        target: &target.interpolated,
        at: target.local(at),
    };
    let found = refiner.refine(Warp::shift(1.0, 0.0)).unwrap();
    let offsets: Vec<(i32, i32)> = (0..31 * 31).map(|k| (k % 31 - 15, k / 31 - 15)).collect();
    let pixel = |(dx, dy): &(i32, i32)| image.view().at((45 + dx) as usize, (44 + dy) as usize).unwrap();
    let f: Vec<f32> = offsets.iter().map(pixel).collect();
    let slow = |warp: &Warp| {
        let sample = |(dx, dy): &(i32, i32)| {
            let (x, y) = warp.apply(f64::from(*dx), f64::from(*dy));
            target.interpolated.value_at(45.0 + x, 44.0 + y)
        };
        let g: Vec<f32> = offsets.iter().map(sample).collect();
        zncc(ImageView::new(&f, 31, 31).unwrap(), ImageView::new(&g, 31, 31).unwrap()).unwrap()
    };
    let highest = slow(&found.warp);
    assert!((highest - found.zncc).abs() < 1e-5, "{highest} {}", found.zncc);
    let w = found.warp;
    for (name, other) in [
        ("u", Warp { u: w.u + 0.02, ..w }),
        ("u", Warp { u: w.u - 0.02, ..w }),
        ("v", Warp { v: w.v + 0.02, ..w }),
        ("v", Warp { v: w.v - 0.02, ..w }),
        ("ux", Warp { ux: w.ux + 0.003, ..w }),
        ("vy", Warp { vy: w.vy - 0.003, ..w }),
        ("uy", Warp { uy: w.uy + 0.003, ..w }),
        ("vx", Warp { vx: w.vx - 0.003, ..w }),
    ] {
        assert!(slow(&other) < highest, "{name} is not at its best");
    }
}

#[test]
fn sums_are_equal_to_the_last_bit_with_and_without_vector_instructions() {
    let (_, reference, target) = pair();
    for shape in [WindowShape::Square, WindowShape::Circle] {
        let window = SubsetMask::new(shape, 27);
        let mut subset = ReferenceSubset::default();
        subset.fill(&reference, &window, Shape::Affine, GridPoint { x: 45, y: 44 }).unwrap();
        let target = &target.interpolated;
        let refiner =
            Refiner { subset: &subset, window: &window, shape: Shape::Affine, target, at: Pixel { x: 45, y: 44 } };
        let warps = [Warp::shift(0.3, -1.7), Warp::rigid(0.6, -0.3, 0.03), Warp::rigid(0.6, -0.3, 0.3)];
        let exact =
            warps.map(|warp| (sums_of(&refiner, &warp, &mut []), sums_with::<Portable>(&refiner, &warp, &mut [])));
        let tiled = warps.map(|warp| (tiled_sums_of(&refiner, &warp), tiled_sums_with::<Portable>(&refiner, &warp)));
        for (fast, plain) in exact.into_iter().chain(tiled) {
            assert_eq!(fast.levels.to_bits(), plain.levels.to_bits());
            assert_eq!(fast.energy.to_bits(), plain.energy.to_bits());
            assert_eq!(fast.product.to_bits(), plain.product.to_bits());
            assert_eq!(fast.jacobian.map(f64::to_bits), plain.jacobian.map(f64::to_bits));
        }
    }
}
