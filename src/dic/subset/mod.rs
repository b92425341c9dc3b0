//! The reference subset and the sums over its pixels: normal equations, illumination, column sums.

mod column_sums;
mod illumination;
pub(in crate::dic) mod normal_equations;
mod reference_subset;

pub(in crate::dic) use column_sums::{ColumnSums, Strip};
pub(in crate::dic) use illumination::plane_row;
pub(in crate::dic) use normal_equations::{Layers, Moments, Sums};
pub(in crate::dic) use reference_subset::{ReferenceSubset, Unusable, project};
