//! Parameters of a correlator.

use super::error::CorrelationError;
use super::geometry::{Shape, WindowShape};
use super::image::Interpolation;

/// The method that measures the displacement of a subset.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// The paper's method: subsets interpolated between the pixels, FFT cross-correlation and a peak fit.
    SplineFft,
    /// FFT cross-correlation and a Gaussian through the peak.
    PeakGaussian,
    /// FFT cross-correlation and a spline through the peak.
    PeakSpline,
    /// FFT cross-correlation, then inverse-compositional Gauss-Newton (IC-GN) on an interpolated target.
    IcGn,
}

/// The parameters that a correlator is planned with.
#[derive(Debug, Clone, PartialEq)]
pub struct CorrelationParams {
    /// The method.
    pub method: Method,
    /// The shape function (`ic-gn` only).
    pub shape: Shape,
    /// The outline of a subset.
    pub window: WindowShape,
    /// The full width of a subset, odd, px: 9 to 255.
    pub subset_size_px: u32,
    /// The distance between subset centres, px: 1 to 255.
    pub step_px: u32,
    /// The number of spline points between two pixels (`spline-fft` only): 0 to 20.
    pub spline_points: u32,
    /// The largest displacement searched for without an initial guess, px.
    pub search_px: u32,
    /// The minimum ZNCC of an accepted match, 0 to 1.
    pub min_zncc: f64,
    /// The interpolation of the target.
    pub interpolation: Interpolation,
}

impl Default for CorrelationParams {
    fn default() -> Self {
        Self {
            method: Method::IcGn,
            shape: Shape::Affine,
            window: WindowShape::Square,
            subset_size_px: 31,
            step_px: 10,
            spline_points: 2,
            search_px: 16,
            min_zncc: 0.7,
            interpolation: Interpolation::Optimised,
        }
    }
}

impl Method {
    /// The names in configurations and on the command line.
    pub const WORDS: [(&str, Self); 4] = [
        ("spline-fft", Self::SplineFft),
        ("peak-gaussian", Self::PeakGaussian),
        ("peak-spline", Self::PeakSpline),
        ("ic-gn", Self::IcGn),
    ];
}

impl CorrelationParams {
    /// Returns the shape function of the refinement: the configured one for `ic-gn`, a translation for the
    /// correlation-peak methods.
    pub(super) fn refined_shape(&self) -> Shape {
        if self.method == Method::IcGn { self.shape } else { Shape::Translation }
    }

    /// Checks the ranges of all parameters.
    ///
    /// # Errors
    ///
    /// [`CorrelationError::Parameter`] naming the first key that is out of range.
    pub(super) fn check(&self) -> Result<(), CorrelationError> {
        let refuse = |key: &'static str, value: String, range: &str| {
            Err(CorrelationError::Parameter { key, value, range: range.to_owned() })
        };
        if !(9..=255).contains(&self.subset_size_px) || self.subset_size_px.is_multiple_of(2) {
            return refuse("subset_size_px", self.subset_size_px.to_string(), "odd, 9 to 255");
        }
        if !(1..=255).contains(&self.step_px) {
            return refuse("step_px", self.step_px.to_string(), "1 to 255");
        }
        if !(1..=1024).contains(&self.search_px) {
            return refuse("search_px", self.search_px.to_string(), "1 to 1024");
        }
        if self.spline_points > 20 {
            return refuse("spline_points", self.spline_points.to_string(), "0 to 20");
        }
        if !(0.0..=1.0).contains(&self.min_zncc) {
            return refuse("min_zncc", self.min_zncc.to_string(), "0 to 1");
        }
        Ok(())
    }
}
