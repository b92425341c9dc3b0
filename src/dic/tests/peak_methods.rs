//! The correlation-peak methods: the effect of the peak fit.

use super::speckle_image::{Speckle, record};
use crate::dic::*;
use crate::results::PointStatus;

/// Shifts off every 1/n grid, each along both axes.
const SHIFTS: [f64; 6] = [0.05, 0.13, 0.37, 0.77, 1.23, 1.9];

/// Returns the mean of u at each shift, px, over all subsets of a disc of rendered speckle at a noise of 2 DN.
fn mean_displacements(method: Method, spline_points: u32, fit: bool) -> Vec<f64> {
    let params = CorrelationParams {
        method,
        spline_points,
        subset_size_px: 25,
        step_px: 12,
        search_px: 6,
        ..CorrelationParams::default()
    };
    let speckle = Speckle::standard(41, 130.0);
    let reference = speckle.draw(130, 130);
    let mut correlator = Correlator::new(&params, 130, 130).unwrap();
    if !fit {
        correlator = correlator.without_peak_fit();
    }
    let points = grid::disc(65.0, 65.0, 57.0, 12, 25, 130, 130);
    let mut field = Vec::new();
    let mut mean_at = |(case, shift): (usize, f64)| {
        let target = speckle.moved(|_, _| (shift, -0.5 * shift)).draw(130, 130);
        let a = correlator.prepare(record(&reference, 2.0, 2 * case as u64).view());
        let b = correlator.prepare(record(&target, 2.0, 2 * case as u64 + 1).view());
        correlator.correlate(&a, &b, &points, Start::Search, &mut field);
        assert!(field.iter().all(|point| point.status == PointStatus::Valid), "{method:?} at {shift}");
        field.iter().filter_map(|point| point.displacement).map(|d| f64::from(d.u_px)).sum::<f64>() / field.len() as f64
    };
    SHIFTS.into_iter().enumerate().map(&mut mean_at).collect()
}

/// Returns the mean absolute error of [`mean_displacements`] over the shifts, px, with the peak fit.
fn mean_error(method: Method, spline_points: u32) -> f64 {
    let means = mean_displacements(method, spline_points, true);
    means.iter().zip(SHIFTS).map(|(mean, shift)| (mean - shift).abs()).sum::<f64>() / SHIFTS.len() as f64
}

#[test]
fn splined_windows_with_a_peak_fit_err_by_at_most_0_002_px_on_average() {
    for points in [1, 2, 5] {
        let error = mean_error(Method::SplineFft, points);
        eprintln!("spline-fft, {points} points: mean error {error:.5} px");
        assert!(error <= 0.002, "{points} points: {error}");
    }
}

#[test]
fn peak_fits_on_plain_windows_err_by_a_hundredth() {
    for (method, limit) in [(Method::PeakGaussian, 0.03), (Method::PeakSpline, 0.01)] {
        let error = mean_error(method, 0);
        eprintln!("{method:?}: mean error {error:.5} px");
        assert!(error <= limit, "{method:?}: {error}");
    }
}

/// Without a fit the result is a grid point, and slow motion reads zero. A test at multiples of the grid would not
/// notice.
#[test]
fn without_a_peak_fit_slow_motion_reads_zero() {
    let means = mean_displacements(Method::SplineFft, 5, false);
    eprintln!("spline-fft, 5 points, no fit: {means:?}");
    assert!(means[0].abs() < 0.005, "0.05 px reads {}", means[0]);
    let errors: Vec<f64> = means.iter().zip(SHIFTS).map(|(mean, shift)| (mean - shift).abs()).collect();
    assert!(errors.iter().sum::<f64>() / errors.len() as f64 > 0.02, "{errors:?}");
}
