//! Tests of whole correlations: accuracy on drawn speckle, peak methods, invalid input.

mod accuracy;
mod invalid_input;
mod patterns;
mod peak_methods;
mod speckle_image;

pub(in crate::dic) use speckle_image::{Disc, Sequence, Speckle, prepared, record};
