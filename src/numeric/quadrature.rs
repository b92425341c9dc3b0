//! Numerical integration.

use std::f64::consts::PI;

/// A node of an integration from -1 to 1, with its weight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QuadratureNode {
    /// The position.
    pub at: f64,
    /// The weight of the function's value there.
    pub weight: f64,
}

/// Returns the Gauss-Legendre rule of `N` nodes on -1 to 1.
///
/// Finds the roots of the Legendre polynomial, the largest first, by Newton's method (W. H. Press et al., Numerical
/// Recipes, 3rd ed. (2007), section 4.6).
pub fn gauss_legendre<const N: usize>() -> [QuadratureNode; N] {
    std::array::from_fn(|index| {
        let count = N as f64;
        let mut at = (PI * (index as f64 + 0.75) / (count + 0.5)).cos();
        let mut derivative = 1.0;
        for _ in 0..60 {
            let (mut previous, mut value) = (1.0, at);
            for order in 2..=N {
                let order = order as f64;
                (previous, value) = (value, ((2.0 * order - 1.0) * at * value - (order - 1.0) * previous) / order);
            }
            derivative = count * (at * value - previous) / (at * at - 1.0);
            at -= value / derivative;
        }
        QuadratureNode { at, weight: 2.0 / ((1.0 - at * at) * derivative * derivative) }
    })
}
