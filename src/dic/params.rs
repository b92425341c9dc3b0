//! What a correlator is planned with.

use super::error::CorrelationError;

/// How the displacement of a subset is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Subsets splined with points between the pixels, FFT cross-correlation, then a peak fit (the paper's).
    SplineFft,
    /// FFT cross-correlation and a Gaussian through the peak.
    PeakGaussian,
    /// FFT cross-correlation and a spline through the peak.
    PeakSpline,
    /// FFT start, then inverse-compositional Gauss-Newton on a splined target.
    IcGn,
}

/// How a target is interpolated between its pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interpolation {
    /// Quintic prefilter and a six-tap kernel fitted to speckle; at most 0.0003 px of bias.
    Optimised,
    /// A cubic B-spline through 4 x 4 pixels, as OpenCorr interpolates: some thousandths of a pixel of bias on
    /// sharp speckle. For results to be compared with its own.
    Bicubic,
}

/// How a subset may deform between reference and target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// Shift only (2 parameters).
    Translation,
    /// Shift and rotation (3).
    Rigid,
    /// Shift and linear deformation (6).
    Affine,
    /// Shift and second-order deformation (12).
    Quadratic,
}

/// Outline of a subset.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WindowShape {
    /// The whole square.
    Square,
    /// The disc inside it.
    Circle,
    /// A ring: the disc without its middle.
    Ring,
}

/// Everything a correlator is planned with.
#[derive(Debug, Clone, PartialEq)]
pub struct CorrelationParams {
    /// How displacements are found.
    pub method: Method,
    /// How subsets may deform (`ic-gn` only).
    pub shape: Shape,
    /// Outline of the subset.
    pub window: WindowShape,
    /// Full width of a subset, odd, px: 9 to 255.
    pub subset_size_px: u32,
    /// From one subset centre to the next, px: 1 to 255.
    pub step_px: u32,
    /// Spline points between two pixels (`spline-fft` only): 0 to 20.
    pub spline_points: u32,
    /// Largest displacement looked for without a start value, px.
    pub search_px: u32,
    /// Matches under this are refused, 0 to 1.
    pub min_zncc: f64,
    /// How the target is interpolated.
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
    /// What each is called in configurations and on the command line.
    pub const WORDS: [(&str, Self); 4] = [
        ("spline-fft", Self::SplineFft),
        ("peak-gaussian", Self::PeakGaussian),
        ("peak-spline", Self::PeakSpline),
        ("ic-gn", Self::IcGn),
    ];
}

impl Interpolation {
    /// What each is called in configurations and on the command line.
    pub const WORDS: [(&str, Self); 2] = [("optimised", Self::Optimised), ("bicubic", Self::Bicubic)];
}

impl WindowShape {
    /// What each is called in configurations and on the command line.
    pub const WORDS: [(&str, Self); 3] = [("square", Self::Square), ("circle", Self::Circle), ("ring", Self::Ring)];
}

impl CorrelationParams {
    /// The deformation a subset may have; correlation peaks know shifts only.
    pub(super) fn refined_shape(&self) -> Shape {
        if self.method == Method::IcGn { self.shape } else { Shape::Translation }
    }

    /// Refuses parameters out of range.
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

impl Shape {
    /// What each is called in configurations and on the command line.
    pub const WORDS: [(&str, Self); 4] = [
        ("translation", Self::Translation),
        ("rigid", Self::Rigid),
        ("affine", Self::Affine),
        ("quadratic", Self::Quadratic),
    ];

    /// How many parameters it has.
    pub(super) fn parameters(self) -> usize {
        match self {
            Self::Translation => 2,
            Self::Rigid => 3,
            Self::Affine => 6,
            Self::Quadratic => super::quadratic::PARAMETERS,
        }
    }
}
