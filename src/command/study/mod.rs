//! `ricochet study`: what the method's settings do to its answers (`convergence`), and how well patterns and methods do
//! on films whose motion is known (`speckle`); what a rig is going to be off by (`design`).

pub mod convergence;
pub mod design;
mod figure;
mod output;
mod pairs;
mod settle;
pub mod speckle;
mod tell;
