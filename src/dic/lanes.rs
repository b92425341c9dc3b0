//! Eight numbers side by side.
//!
//! Plain arrays: the compiler turns each operation into one or two vector
//! instructions of whatever the machine has. Products and sums stay separate
//! operations on purpose: they round the same way on every machine, so results
//! are equal to the last bit with and without AVX.

use std::ops::{Add, AddAssign, Mul, Sub};

/// Numbers side by side.
pub(super) const LANES: usize = 8;

/// Eight numbers on which arithmetic works element by element.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(32))]
pub(super) struct Lanes(pub(super) [f32; LANES]);

impl Lanes {
    /// The number of each lane.
    pub(super) const INDEX: Self = Self([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);

    /// The same number eight times.
    #[inline(always)]
    pub(super) fn splat(value: f32) -> Self {
        Self([value; LANES])
    }

    /// The first eight numbers of a slice.
    #[inline(always)]
    pub(super) fn load(values: &[f32]) -> Self {
        let mut lanes = [0.0; LANES];
        lanes.copy_from_slice(&values[..LANES]);
        Self(lanes)
    }

    /// The sum, in double precision.
    #[inline(always)]
    pub(super) fn sum(self) -> f64 {
        self.0.iter().map(|value| f64::from(*value)).sum()
    }

    /// The sum of each number times its place, 0 to 7, plus `first` times the plain sum.
    #[inline(always)]
    pub(super) fn moment(self, first: f64) -> f64 {
        self.0.iter().enumerate().map(|(lane, value)| (first + lane as f64) * f64::from(*value)).sum()
    }

    /// As [`Self::moment`] with the square of the place.
    #[inline(always)]
    pub(super) fn second_moment(self, first: f64) -> f64 {
        self.0.iter().enumerate().map(|(lane, value)| (first + lane as f64).powi(2) * f64::from(*value)).sum()
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
