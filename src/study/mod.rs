//! `ricochet study`: convergence of `spline-fft` with its settings (`convergence`), accuracy of patterns and methods
//! on rendered films (`speckle`), and the predicted uncertainty of a rig (`design`).

pub mod convergence;
pub mod design;
mod output_files;
pub mod speckle;

pub use convergence::ConvergenceOptions;
pub use design::DesignOptions;
pub use speckle::SpeckleOptions;
