//! The correlator on several patterns, compared with the noise bound of its own subsets.

use super::speckle_image::{Speckle, record};
use crate::dic::geometry::grid::rectangle;
use crate::dic::geometry::{GridPoint, SubsetMask, Warp};
use crate::dic::subset::ReferenceSubset;
use crate::dic::*;
use crate::image::Image;
use crate::results::{FieldPoint, PointStatus};

const SIDE: usize = 256;

fn patterns() -> [(&'static str, Speckle); 4] {
    let size = SIDE as f64;
    [
        ("standard", Speckle::standard(61, size)),
        ("coarse", Speckle::new(62, size, (3.0, 5.5), 0.6)),
        ("soft", Speckle::new(63, size, (1.8, 3.2), 1.1)),
        ("large and soft", Speckle::new(64, size, (2.2, 4.0), 0.85)),
    ]
}

fn points() -> Vec<GridPoint> {
    rectangle([24, 24, SIDE as u32 - 48, SIDE as u32 - 48], 16, 31)
}

/// The motion (u, v, angle in deg) about the centre.
fn motion((u, v, angle_deg): (f64, f64, f64)) -> impl Fn(f64, f64) -> (f64, f64) {
    let turn = Warp::rigid(u, v, angle_deg.to_radians());
    let middle = 0.5 * SIDE as f64;
    move |x, y| {
        let (dx, dy) = (x - middle, y - middle);
        let (tx, ty) = turn.apply(dx, dy);
        (tx - dx, ty - dy)
    }
}

/// The squared errors of u and v, their sums and the reported variances.
#[derive(Default)]
struct Tally {
    count: f64,
    sum: (f64, f64),
    squares: f64,
    reported: f64,
    lost: usize,
}

impl Tally {
    fn add(&mut self, field: &[FieldPoint], truth: impl Fn(f64, f64) -> (f64, f64)) {
        for point in field {
            let (u, v) = truth(f64::from(point.x_px), f64::from(point.y_px));
            let Some(d) = point.displacement.filter(|_| point.status == PointStatus::Valid) else {
                self.lost += 1;
                continue;
            };
            let (eu, ev) = (f64::from(d.u_px) - u, f64::from(d.v_px) - v);
            self.lost += usize::from(eu.hypot(ev) > 0.1);
            self.count += 1.0;
            self.sum = (self.sum.0 + eu, self.sum.1 + ev);
            self.squares += 0.5 * (eu * eu + ev * ev);
            self.reported += 0.5 * f64::from(d.sigma_u_px.powi(2) + d.sigma_v_px.powi(2));
        }
    }

    fn bias(&self) -> f64 {
        (self.sum.0 / self.count).abs().max((self.sum.1 / self.count).abs())
    }

    fn rms(&self) -> f64 {
        (self.squares / self.count).sqrt()
    }
}

fn correlate(clean: (&Image, &Image), sigma: f64, seed: u64) -> Vec<FieldPoint> {
    let mut correlator =
        Correlator::new(&CorrelationParams { step_px: 16, ..CorrelationParams::default() }, SIDE, SIDE).unwrap();
    let a = correlator.prepare(record(clean.0, sigma, 2 * seed).view());
    let b = correlator.prepare(record(clean.1, sigma, 2 * seed + 1).view());
    let mut field = Vec::new();
    correlator.correlate(&a, &b, &points(), Start::Search, &mut field);
    field
}

/// Returns the Cramer-Rao bound of an affine 31 x 31 subset, rms over the grid, at unit noise in each frame, px.
///
/// Computed from the fourth-order gradient of the noise-free image.
fn unit_bound(clean: &Image) -> f64 {
    let mut frame = PreparedFrame::default();
    frame.fill(clean.view(), Interpolation::Optimised);
    let (mut subset, window) = (ReferenceSubset::default(), SubsetMask::new(WindowShape::Square, 31));
    let mut sum = 0.0;
    for point in points() {
        subset.fill(&frame, &window, Shape::Affine, point).unwrap();
        sum += subset.inverse[0][0] + subset.inverse[3][3];
    }
    (sum / points().len() as f64).sqrt()
}

#[test]
fn every_well_sampled_pattern_is_unbiased_and_no_subset_is_lost_up_to_three_degrees_and_fifteen_pixels() {
    for (name, speckle) in patterns() {
        let reference = speckle.draw(SIDE, SIDE);
        let bound = unit_bound(&reference);
        let (mut bias, mut floor) = (0.0_f64, Tally::default());
        let motions = [
            (0.13, -0.065, 0.0),
            (0.37, -0.77, 0.0),
            (1.23, 1.9, 0.0),
            (-9.4, 14.6, 0.0),
            (0.3, 0.8, 1.0),
            (4.2, -3.3, 3.0),
        ];
        let mut noisy = [Tally::default(), Tally::default(), Tally::default()];
        for (case, parameters) in motions.into_iter().enumerate() {
            let target = speckle.moved(motion(parameters)).draw(SIDE, SIDE);
            let mut clean = Tally::default();
            clean.add(&correlate((&reference, &target), 0.0, case as u64), motion(parameters));
            bias = bias.max(clean.bias());
            floor.add(&correlate((&reference, &target), 0.0, case as u64), motion(parameters));
            for (level, tally) in [1.0, 2.0, 4.0].into_iter().zip(&mut noisy) {
                tally.add(&correlate((&reference, &target), level, 100 + case as u64), motion(parameters));
            }
        }
        let expected = |sigma: f64| bound * (sigma * sigma + 1.0 / 12.0).sqrt();
        let ratio = |k: usize| noisy[k].rms() / expected([1.0, 2.0, 4.0][k]);
        let honesty = |k: usize| (noisy[k].reported / noisy[k].squares).sqrt();
        let lost = floor.lost + noisy.iter().map(|tally| tally.lost).sum::<usize>();
        eprintln!(
            "{name}: bias {bias:.5} px, rms {:.5} at 0 ({:.2} of the bound), {:.5} {:.5} {:.5} at 1 2 4 ({:.3} {:.3} {:.3} \
             of the bound), reported/actual {:.3} {:.3} {:.3}, lost {lost}",
            floor.rms(),
            floor.rms() / expected(0.0),
            noisy[0].rms(),
            noisy[1].rms(),
            noisy[2].rms(),
            ratio(0),
            ratio(1),
            ratio(2),
            honesty(0),
            honesty(1),
            honesty(2)
        );
        assert_eq!(lost, 0, "{name}");
        // The mean over 169 overlapping subsets is uncertain by a tenth of their scatter.
        assert!(bias <= 0.0003 + 0.1 * floor.rms(), "{name}: {bias}");
        for k in 0..3 {
            // 1.03 is the target. The scatter of some hundred independent subsets is known to 3 %.
            assert!(ratio(k) <= 1.03 * 1.05, "{name}: {} of the bound", ratio(k));
            assert!((0.9..1.15).contains(&honesty(k)), "{name}: reported/actual {}", honesty(k));
        }
    }
}
