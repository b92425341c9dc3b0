//! Sub-pixel refinement by the inverse-compositional Gauss-Newton method (IC-GN), of first and second order.

mod icgn;
mod residual;
mod second_order;
mod warped_rows;

pub(in crate::dic) use icgn::{GaussNewtonStep, Match, MatchError, Refiner};
