//! `ricochet study`: what the method's settings do to its answers (`convergence`), and how well patterns and methods do
//! on films whose motion is known (`speckle`).

pub mod convergence;
mod figure;
mod output;
mod pairs;
mod settle;
pub mod speckle;
mod tell;
