//! `ricochet study`: convergence of `spline-fft` with its settings (`convergence`), accuracy of patterns and methods
//! on rendered films (`speckle`), and the predicted uncertainty of a rig (`design`).

pub mod convergence;
pub mod design;
mod figure;
mod output;
mod pairs;
mod settle;
pub mod speckle;
mod tell;
