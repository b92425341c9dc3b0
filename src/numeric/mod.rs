//! Numerical ground: vectors of eight lanes, small transforms and solvers, order statistics, distributions, random
//! numbers. Every function but the Fourier transform rounds the same way on every machine.

mod exp_ln;
mod fft2d;
mod lanes;
mod normal;
mod order_statistics;
mod polynomial;
mod quadrature;
mod quantile;
mod random;
mod symmetric;
pub(crate) mod vector;

pub use exp_ln::{exp, ln};
pub use fft2d::{Complex32, Fft2d, circular_size, fast_size};
pub use lanes::{LANES, Lanes};
pub use normal::{normal, normal_cdf, normal_f64};
pub use order_statistics::{MAX_COUNT, nth_highest, nth_smallest};
pub use polynomial::{MAX_ORDER, Polynomial, Sample};
pub use quadrature::{QuadratureNode, gauss_legendre};
pub use quantile::{SIGMA_PER_MEDIAN, median, otsu, quantile};
pub use random::{GOLDEN_GAMMA, Stream, Xorshift, key, scramble};
pub use symmetric::{invert, map_eigenvalues};
pub(crate) use vector::vectorized;
pub use vector::{Portable, Vector, instruction_set};
