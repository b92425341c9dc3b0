//! What a correlator is planned with.

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
    /// From reference to target, frames.
    pub interval_frames: u32,
    /// Matches under this are refused, 0 to 1.
    pub min_zncc: f64,
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
            interval_frames: 1,
            min_zncc: 0.7,
        }
    }
}
