//! The integer-pixel search: cross-correlation by FFT, its peak, and the peak of the upsampled surface.

mod cross_correlation;
mod integer_search;
mod peak;
mod upsampled;

pub(in crate::dic) use integer_search::{IntegerSearch, SearchResult};
pub(in crate::dic) use peak::Peak;
pub(in crate::dic) use upsampled::{PeakFit, Subset, UpsampledSearch};
