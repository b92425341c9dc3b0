//! The exponential and the logarithm without branches. Loops over several numbers become vector instructions, and
//! results are equal to the last bit on every machine.

use std::f64::consts::{FRAC_1_SQRT_2, LOG2_E, SQRT_2};

/// The first 32 bits of the logarithm of 2, and the rest.
const LN_2: [f64; 2] = [f64::from_bits(0x3FE6_2E42_FEE0_0000), 1.908_214_929_270_587_7e-10];
/// A constant that rounds a number below 2^51 to the nearest integer, which is left in the last bits.
const ROUND: f64 = 6_755_399_441_055_744.0;
/// 2^52, whose last bits hold an integer.
const INTEGER_BITS: f64 = 4_503_599_627_370_496.0;
const BIAS: u64 = 1023;
const MANTISSA_BITS: u32 = 52;
/// The limit beyond which the exponential of a double underflows or overflows.
const MAX_EXPONENT: f64 = 700.0;

/// Returns e to the power of `x`, within a relative error of 5e-16. NaN for NaN.
///
/// `x` is clamped to -700 to 700. The result is a Taylor series within half of ln 2 times a power of 2.
#[inline(always)]
pub fn exp(x: f64) -> f64 {
    let x = if x > MAX_EXPONENT { MAX_EXPONENT } else { x };
    let x = if x < -MAX_EXPONENT { -MAX_EXPONENT } else { x };
    let shifted = x * LOG2_E + ROUND;
    let whole = shifted - ROUND;
    let r = (x - whole * LN_2[0]) - whole * LN_2[1];
    // The Taylor series within half of ln 2, in independent pairs of terms.
    let (r2, r4) = (r * r, (r * r) * (r * r));
    let p01 = 1.0 + r;
    let p23 = 1.0 / 2.0 + r * (1.0 / 6.0);
    let p45 = 1.0 / 24.0 + r * (1.0 / 120.0);
    let p67 = 1.0 / 720.0 + r * (1.0 / 5_040.0);
    let p89 = 1.0 / 40_320.0 + r * (1.0 / 362_880.0);
    let p1011 = 1.0 / 3_628_800.0 + r * (1.0 / 39_916_800.0);
    let p1213 = 1.0 / 479_001_600.0 + r * (1.0 / 6_227_020_800.0);
    let (low, middle, high) = (p01 + r2 * p23, p45 + r2 * p67, p89 + r2 * p1011);
    let series = low + r4 * (middle + r4 * (high + r4 * p1213));
    let scale = f64::from_bits((shifted.to_bits() << MANTISSA_BITS).wrapping_add(BIAS << MANTISSA_BITS));
    series * scale
}

/// Returns the natural logarithm of a positive, finite number that is not subnormal, within a few units of 2^-53.
///
/// The result is unspecified for zero, negative, infinite and subnormal numbers.
#[inline(always)]
pub fn ln(x: f64) -> f64 {
    let bits = x.to_bits();
    let exponent = f64::from_bits((bits >> MANTISSA_BITS) | INTEGER_BITS.to_bits()) - INTEGER_BITS - BIAS as f64;
    let mantissa = f64::from_bits((bits & ((1 << MANTISSA_BITS) - 1)) | (BIAS << MANTISSA_BITS));
    // Between the roots of one half and of 2.
    let is_high = mantissa > SQRT_2;
    let mantissa = if is_high { 0.5 * mantissa } else { mantissa };
    let exponent = if is_high { exponent + 1.0 } else { exponent };
    debug_assert!((FRAC_1_SQRT_2 - 1e-15..=SQRT_2 + 1e-15).contains(&mantissa) || x.is_nan());
    // ln m = 2 artanh f.
    let f = (mantissa - 1.0) / (mantissa + 1.0);
    let (s, s2) = (f * f, (f * f) * (f * f));
    let s4 = s2 * s2;
    let p12 = 2.0 / 3.0 + s * (2.0 / 5.0);
    let p34 = 2.0 / 7.0 + s * (2.0 / 9.0);
    let p56 = 2.0 / 11.0 + s * (2.0 / 13.0);
    let p78 = 2.0 / 15.0 + s * (2.0 / 17.0);
    let p910 = 2.0 / 19.0 + s * (2.0 / 21.0);
    let series = s * ((p12 + s2 * p34) + s4 * ((p56 + s2 * p78) + s4 * p910));
    exponent * LN_2[0] + (2.0 * f + (f * series + exponent * LN_2[1]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_are_those_of_the_standard_library_to_the_last_bits() {
        let mut state = 1_u64;
        let mut worst = [0.0_f64; 2];
        for _ in 0..200_000 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let x = ((state >> 11) as f64 / 2_f64.powi(53) - 0.5) * 200.0;
            worst[0] = worst[0].max((exp(x) / x.exp() - 1.0).abs());
            let y = (0.3 * x).exp();
            worst[1] = worst[1].max((ln(y) - y.ln()).abs() / y.ln().abs().max(1.0));
        }
        assert!(worst.iter().all(|worst| *worst < 5e-16), "{worst:?}");
        assert!(exp(-1e4) < 1e-300 && exp(f64::NAN).is_nan() && (exp(0.0), ln(1.0)) == (1.0, 0.0));
        assert!((ln(1e-300) - 1e-300_f64.ln()).abs() < 1e-12);
    }
}
