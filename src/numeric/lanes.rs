//! Eight `f32` values with element-wise arithmetic.
//!
//! The compiler turns each operation on the plain arrays into one or two vector instructions. Products and sums stay
//! separate operations, because they round the same way on every machine. Results are equal to the last bit with and
//! without AVX.

use std::ops::{Add, AddAssign, Mul, Sub};

/// The number of lanes.
pub const LANES: usize = 8;

/// Eight numbers with element-wise arithmetic.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[repr(align(32))]
pub struct Lanes(pub [f32; LANES]);

impl Lanes {
    /// The index of each lane.
    pub const INDEX: Self = Self([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);

    /// Fills all lanes with one value.
    #[inline(always)]
    pub fn splat(value: f32) -> Self {
        Self([value; LANES])
    }

    /// Returns the sum of the lanes in double precision.
    #[inline(always)]
    pub fn sum(self) -> f64 {
        self.0.iter().map(|value| f64::from(*value)).sum()
    }

    /// Returns the sums of the values times (`first` + lane) to the power 0, 1 and 2.
    #[inline(always)]
    pub fn moments(self, first: f64) -> [f64; 3] {
        let mut sums = [0.0; 3];
        for (lane, value) in self.0.iter().enumerate() {
            let (value, place) = (f64::from(*value), first + lane as f64);
            sums[0] += value;
            sums[1] += value * place;
            sums[2] += value * place * place;
        }
        sums
    }
}

impl Add for Lanes {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(std::array::from_fn(|lane| self.0[lane] + other.0[lane]))
    }
}

impl Sub for Lanes {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(std::array::from_fn(|lane| self.0[lane] - other.0[lane]))
    }
}

impl Mul for Lanes {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(std::array::from_fn(|lane| self.0[lane] * other.0[lane]))
    }
}

impl AddAssign for Lanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}
