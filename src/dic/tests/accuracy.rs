//! Accuracy of the correlator on rendered images whose displacement is known exactly.

use super::speckle_image::{Speckle, record};
use crate::dic::geometry::grid::rectangle;
use crate::dic::*;
use crate::image::Image;
use crate::results::{FieldPoint, PointStatus};

/// Shifts off every 1/n grid.
const SHIFTS: [(f64, f64); 5] = [(0.13, -0.065), (0.37, -0.185), (0.77, -0.385), (1.23, -0.615), (1.9, -0.95)];

fn params() -> CorrelationParams {
    CorrelationParams { step_px: 16, ..CorrelationParams::default() }
}

/// The errors of a set of displacements.
#[derive(Debug, Default)]
struct Errors {
    u: Vec<f64>,
    v: Vec<f64>,
    /// Reported variances.
    variances: Vec<f64>,
}

impl Errors {
    fn add(&mut self, field: &[FieldPoint], truth: impl Fn(f64, f64) -> (f64, f64)) {
        for point in field {
            assert_eq!(point.status, PointStatus::Valid, "{point:?}");
            let displacement = point.displacement.unwrap();
            let (u, v) = truth(f64::from(point.x_px), f64::from(point.y_px));
            self.u.push(f64::from(displacement.u_px) - u);
            self.v.push(f64::from(displacement.v_px) - v);
            self.variances.push(f64::from(displacement.sigma_u_px).powi(2));
            self.variances.push(f64::from(displacement.sigma_v_px).powi(2));
        }
    }

    fn bias(&self) -> f64 {
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        mean(&self.u).abs().max(mean(&self.v).abs())
    }

    fn rms(&self) -> f64 {
        let squares: f64 = self.u.iter().chain(&self.v).map(|e| e * e).sum();
        (squares / (self.u.len() + self.v.len()) as f64).sqrt()
    }

    fn max(&self) -> f64 {
        self.u.iter().chain(&self.v).fold(0.0, |high, e| high.max(e.abs()))
    }

    /// The ratio of the reported to the actual standard deviation.
    fn honesty(&self) -> f64 {
        (self.variances.iter().sum::<f64>() / self.variances.len() as f64).sqrt() / self.rms()
    }
}

/// Returns the displacement field between two recordings of a pattern.
fn field_of(params: &CorrelationParams, reference: &Image, target: &Image, start: Start) -> Vec<FieldPoint> {
    let (width, height) = (reference.view().width(), reference.view().height());
    let mut correlator = Correlator::new(params, width, height).unwrap();
    let points = rectangle([24, 24, width as u32 - 48, height as u32 - 48], params.step_px, params.subset_size_px);
    let (reference, target) = (correlator.prepare(reference.view()), correlator.prepare(target.view()));
    let mut field = Vec::new();
    correlator.correlate(&reference, &target, &points, start, &mut field);
    field
}

/// Returns the errors over all shifts and the largest bias of one shift, at one noise level.
fn translation_errors(speckle: &Speckle, params: &CorrelationParams, sigma: f64) -> (Errors, f64) {
    let reference = speckle.draw(320, 320);
    let (mut all, mut bias) = (Errors::default(), 0.0_f64);
    for (case, (u, v)) in SHIFTS.into_iter().enumerate() {
        let target = speckle.moved(|_, _| (u, v)).draw(320, 320);
        let seed = 10 * case as u64 + 1;
        let field =
            field_of(params, &record(&reference, sigma, seed), &record(&target, sigma, seed + 1), Start::Search);
        let mut errors = Errors::default();
        errors.add(&field, |_, _| (u, v));
        bias = bias.max(errors.bias());
        all.add(&field, |_, _| (u, v));
    }
    (all, bias)
}

#[test]
fn the_standard_pattern_has_the_contrast_that_the_figures_refer_to() {
    let image = Speckle::standard(1, 320.0).draw(320, 320);
    let view = image.view();
    let mut sum = 0.0;
    for y in 0..320 {
        let row = view.row(y);
        sum += (1..319).map(|x| f64::from(row[x + 1] - row[x - 1]).powi(2) / 4.0).sum::<f64>();
    }
    let gradient = (sum / (320.0 * 318.0)).sqrt();
    eprintln!("rms gradient {gradient:.1} DN/px");
    assert!((25.0..40.0).contains(&gradient), "{gradient}");
}

#[test]
fn translations_are_found_at_the_noise_bound_with_honest_uncertainties() {
    let speckle = Speckle::standard(1, 320.0);
    // RMS bounds: the accuracy target for a 31 x 31 subset, px.
    for (sigma, limit) in [(0.0, 0.0005), (1.0, 0.0015), (2.0, 0.0029)] {
        let (errors, bias) = translation_errors(&speckle, &params(), sigma);
        let (rms, max, honesty) = (errors.rms(), errors.max(), errors.honesty());
        eprintln!("sigma {sigma}: bias {bias:.5} rms {rms:.5} max {max:.5} reported/actual {honesty:.3}");
        assert!(rms <= limit, "sigma {sigma}: rms {rms}");
        assert!(max <= 6.0 * limit, "sigma {sigma}: max {max}");
        if sigma < 0.5 {
            assert!(bias <= 0.0003, "bias {bias}");
        } else {
            assert!((0.9..1.15).contains(&honesty), "sigma {sigma}: reported/actual {honesty}");
        }
    }
}
