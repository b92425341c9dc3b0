//! `ricochet study`: what the method's settings do to its answers, one file a study.

pub mod convergence;
mod figure;
mod output;
mod pairs;
mod settle;
mod tell;
