//! Eight numbers in a register: the innermost arithmetic, for AVX2 and for any machine.
//!
//! With arrays alone the compiler uses half registers, or none once the taps are unrolled. Both implementations round
//! in the same places and add in the same order, so their results are equal to the last bit.

use super::lanes::{LANES, Lanes};

/// Arithmetic on eight numbers at once.
pub trait Vector: Copy {
    /// Fills all lanes with one value.
    fn splat(value: f32) -> Self;
    /// Loads the first eight values of a slice.
    ///
    /// # Panics
    ///
    /// If there are fewer.
    fn load(values: &[f32]) -> Self;
    /// Stores into the first eight places of a slice.
    ///
    /// # Panics
    ///
    /// If there are fewer.
    fn store(self, values: &mut [f32]);
    /// Loads eight lanes.
    fn from_lanes(lanes: &Lanes) -> Self;
    /// Transposes eight vectors: lane i of vector k becomes lane k of vector i.
    fn transpose(rows: [Self; LANES]) -> [Self; LANES];
    /// Returns the sum of the lanes of each of eight vectors, added as ((a + b) + (c + d)) + ((e + f) + (g + h)).
    fn sums(rows: &[Self; LANES]) -> Lanes;
    /// Converts to lanes.
    fn to_lanes(self) -> Lanes;
    /// Returns `self` + `other`.
    fn add(self, other: Self) -> Self;
    /// Returns `self` - `other`.
    fn sub(self, other: Self) -> Self;
    /// Returns `self` times `other`.
    fn mul(self, other: Self) -> Self;
    /// Returns `self` + `a` `b`, rounded once.
    fn plus_product(self, a: Self, b: Self) -> Self;
    /// Returns a mask: all bits set where `self >= other`, else none; for [`Self::select`] and [`Self::and`] only.
    fn at_least(self, other: Self) -> Self;
    /// Returns `self` where the mask is set, else zero.
    fn and(self, mask: Self) -> Self;
    /// Returns `high` where the mask is set, `low` elsewhere.
    fn select(mask: Self, high: Self, low: Self) -> Self;
}

/// Eight numbers on any machine.
#[derive(Clone, Copy)]
pub struct Portable([f32; LANES]);

impl Portable {
    /// Applies an operation to the lanes of `self` and `other`, pair by pair.
    #[inline(always)]
    fn map_pairs(self, other: Self, operation: impl Fn(f32, f32) -> f32) -> Self {
        let mut out = self.0;
        for (out, other) in out.iter_mut().zip(other.0) {
            *out = operation(*out, other);
        }
        Self(out)
    }
}

impl Vector for Portable {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; LANES])
    }

    #[inline(always)]
    fn load(values: &[f32]) -> Self {
        let mut out = [0.0; LANES];
        out.copy_from_slice(&values[..LANES]);
        Self(out)
    }

    #[inline(always)]
    fn store(self, values: &mut [f32]) {
        values[..LANES].copy_from_slice(&self.0);
    }

    #[inline(always)]
    fn from_lanes(lanes: &Lanes) -> Self {
        Self(lanes.0)
    }

    #[inline(always)]
    fn transpose(rows: [Self; LANES]) -> [Self; LANES] {
        let mut columns = rows;
        for (row, line) in rows.iter().enumerate() {
            for (column, value) in columns.iter_mut().zip(line.0) {
                column.0[row] = value;
            }
        }
        columns
    }

    #[inline(always)]
    fn sums(rows: &[Self; LANES]) -> Lanes {
        Lanes(rows.map(|Self([a, b, c, d, e, f, g, h])| ((a + b) + (c + d)) + ((e + f) + (g + h))))
    }

    #[inline(always)]
    fn to_lanes(self) -> Lanes {
        Lanes(self.0)
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.map_pairs(other, |a, b| a + b)
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.map_pairs(other, |a, b| a - b)
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.map_pairs(other, |a, b| a * b)
    }

    // Without an instruction for it this is long: inlined at every tap it would take minutes to compile.
    #[cfg_attr(any(target_arch = "aarch64", target_feature = "fma"), inline(always))]
    #[cfg_attr(not(any(target_arch = "aarch64", target_feature = "fma")), inline(never))]
    fn plus_product(self, a: Self, b: Self) -> Self {
        let mut out = self.0;
        for (out, (a, b)) in out.iter_mut().zip(a.0.into_iter().zip(b.0)) {
            *out = fused(a, b, *out);
        }
        Self(out)
    }

    #[inline(always)]
    fn at_least(self, other: Self) -> Self {
        self.map_pairs(other, |a, b| f32::from_bits(if a >= b { u32::MAX } else { 0 }))
    }

    #[inline(always)]
    fn and(self, mask: Self) -> Self {
        self.map_pairs(mask, |a, m| f32::from_bits(a.to_bits() & m.to_bits()))
    }

    #[inline(always)]
    fn select(mask: Self, high: Self, low: Self) -> Self {
        let mut out = low.0;
        for (out, (mask, high)) in out.iter_mut().zip(mask.0.into_iter().zip(high.0)) {
            *out = if mask.to_bits() != 0 { high } else { *out };
        }
        Self(out)
    }
}

/// Returns a b + c, rounded once, on machines without an instruction for it.
///
/// The product of two singles is exact in double precision. Its sum with `c` is rounded to odd, so that the second
/// rounding to single precision gives the correctly rounded result (S. Boldo, G. Melquiond, IEEE Trans. Comput. 57
/// (2008) 462, <https://doi.org/10.1109/TC.2007.70819>).
#[inline(always)]
#[cfg(not(any(target_arch = "aarch64", target_feature = "fma")))]
fn fused(a: f32, b: f32, c: f32) -> f32 {
    let (product, c) = (f64::from(a) * f64::from(b), f64::from(c));
    let sum = product + c;
    // The rounding error of the sum (D. Knuth's two-sum).
    let part = sum - product;
    let lost = (product - (sum - part)) + (c - part);
    let bits = sum.to_bits();
    let away = (lost > 0.0) == (sum > 0.0);
    let odd = if away { bits | 1 } else { (bits.wrapping_sub(1)) | 1 };
    let is_even = bits & 1 == 0;
    f64::from_bits(if lost != 0.0 && is_even { odd } else { bits }) as f32
}

/// Returns a b + c, rounded once.
#[inline(always)]
#[cfg(any(target_arch = "aarch64", target_feature = "fma"))]
fn fused(a: f32, b: f32, c: f32) -> f32 {
    a.mul_add(b, c)
}

/// Whether this machine has AVX2 and fused multiply-add, as every one with AVX2 does.
#[cfg(target_arch = "x86_64")]
pub fn has_avx2() -> bool {
    std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma")
}

/// Whether this machine has AVX2 and the AVX-512 forms of its instructions, with twice as many registers.
///
/// The vectors stay eight wide, and every result is the same to the last bit. The passes are bound by registers:
/// sixteen do not hold the weights of the taps.
#[cfg(target_arch = "x86_64")]
pub fn has_avx512() -> bool {
    std::arch::is_x86_feature_detected!("avx512f")
        && std::arch::is_x86_feature_detected!("avx512vl")
        && std::arch::is_x86_feature_detected!("avx512dq")
        && has_avx2()
}

/// Returns the name of the instruction set that the hot passes use on this machine, as shown to users.
pub fn instruction_set() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    {
        match (has_avx512(), has_avx2()) {
            (true, _) => "AVX-512VL",
            (_, true) => "AVX2",
            _ => "SSE2",
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        if cfg!(target_arch = "aarch64") { "NEON" } else { "portable" }
    }
}

#[cfg(target_arch = "x86_64")]
pub use avx2::Avx2;

/// Defines a function that runs a generic one over [`Vector`] with the best implementation for this machine.
macro_rules! vectorized {
    ($(#[$meta:meta])* $vis:vis fn $name:ident($($arg:ident: $type:ty),* $(,)?) $(-> $result:ty)? = $generic:ident) => {
        $(#[$meta])*
        $vis fn $name($($arg: $type),*) $(-> $result)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2,fma")]
                fn compiled($($arg: $type),*) $(-> $result)? {
                    $generic::<$crate::numeric::vector::Avx2>($($arg),*)
                }
                #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,fma")]
                fn compiled_for_more_registers($($arg: $type),*) $(-> $result)? {
                    $generic::<$crate::numeric::vector::Avx2>($($arg),*)
                }
                if $crate::numeric::vector::has_avx512() {
                    #[expect(unsafe_code, reason = "the way into a function compiled for AVX-512")]
                    // SAFETY: this machine has AVX-512F, VL and DQ, by the line above.
                    return unsafe { compiled_for_more_registers($($arg),*) };
                }
                if $crate::numeric::vector::has_avx2() {
                    #[expect(unsafe_code, reason = "the way into a function compiled for AVX2")]
                    // SAFETY: this machine has AVX2, by the line above.
                    return unsafe { compiled($($arg),*) };
                }
            }
            $generic::<$crate::numeric::vector::Portable>($($arg),*)
        }
    };
}

pub(crate) use vectorized;

#[cfg(target_arch = "x86_64")]
mod avx2 {
    #![expect(unsafe_code, reason = "vector instructions are unsafe to name outside functions compiled for them")]

    use std::arch::x86_64::{
        __m256, _CMP_GE_OQ, _mm256_add_ps, _mm256_and_ps, _mm256_blendv_ps, _mm256_cmp_ps, _mm256_fmadd_ps,
        _mm256_loadu_ps, _mm256_mul_ps, _mm256_permute2f128_ps, _mm256_set1_ps, _mm256_shuffle_ps, _mm256_storeu_ps,
        _mm256_sub_ps, _mm256_unpackhi_ps, _mm256_unpacklo_ps,
    };

    use super::{LANES, Lanes, Vector};

    /// Eight numbers in an AVX register.
    ///
    /// Only named by functions compiled for AVX2, which are only called after [`has_avx2`](super::has_avx2) returned
    /// true.
    #[derive(Clone, Copy)]
    pub struct Avx2(__m256);

    /// Returns the sums of both halves of four rows.
    ///
    /// The first four lanes are the sums over lanes 0 to 3 of `a`, `b`, `c` and `d`, the last four those over lanes 4
    /// to 7.
    #[inline(always)]
    fn sums_of_halves(a: __m256, b: __m256, c: __m256, d: __m256) -> __m256 {
        // SAFETY: as of every block below.
        unsafe {
            let (ab, ab_high) = (_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
            let (cd, cd_high) = (_mm256_unpacklo_ps(c, d), _mm256_unpackhi_ps(c, d));
            let first = (_mm256_shuffle_ps::<0x44>(ab, cd), _mm256_shuffle_ps::<0xEE>(ab, cd));
            let second = (_mm256_shuffle_ps::<0x44>(ab_high, cd_high), _mm256_shuffle_ps::<0xEE>(ab_high, cd_high));
            _mm256_add_ps(_mm256_add_ps(first.0, first.1), _mm256_add_ps(second.0, second.1))
        }
    }

    // SAFETY of every block below: this type is only used inside functions compiled for AVX2 that
    // run after detection; loads and stores are bounded by the slice or array they go through.
    impl Vector for Avx2 {
        #[inline(always)]
        fn splat(value: f32) -> Self {
            // SAFETY: see above.
            Self(unsafe { _mm256_set1_ps(value) })
        }

        #[inline(always)]
        fn load(values: &[f32]) -> Self {
            let values = &values[..LANES];
            // SAFETY: eight numbers, by the line above.
            Self(unsafe { _mm256_loadu_ps(values.as_ptr()) })
        }

        #[inline(always)]
        fn store(self, values: &mut [f32]) {
            let values = &mut values[..LANES];
            // SAFETY: eight numbers, by the line above.
            unsafe { _mm256_storeu_ps(values.as_mut_ptr(), self.0) };
        }

        #[inline(always)]
        fn from_lanes(lanes: &Lanes) -> Self {
            Self::load(&lanes.0)
        }

        #[inline(always)]
        fn transpose(rows: [Self; LANES]) -> [Self; LANES] {
            let [Self(a), Self(b), Self(c), Self(d), Self(e), Self(f), Self(g), Self(h)] = rows;
            // SAFETY: see above.
            unsafe {
                // Pairs of rows, then fours, then the halves of the registers.
                let (ab, ab_high) = (_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
                let (cd, cd_high) = (_mm256_unpacklo_ps(c, d), _mm256_unpackhi_ps(c, d));
                let (ef, ef_high) = (_mm256_unpacklo_ps(e, f), _mm256_unpackhi_ps(e, f));
                let (gh, gh_high) = (_mm256_unpacklo_ps(g, h), _mm256_unpackhi_ps(g, h));
                let low = [
                    _mm256_shuffle_ps::<0x44>(ab, cd),
                    _mm256_shuffle_ps::<0xEE>(ab, cd),
                    _mm256_shuffle_ps::<0x44>(ab_high, cd_high),
                    _mm256_shuffle_ps::<0xEE>(ab_high, cd_high),
                ];
                let high = [
                    _mm256_shuffle_ps::<0x44>(ef, gh),
                    _mm256_shuffle_ps::<0xEE>(ef, gh),
                    _mm256_shuffle_ps::<0x44>(ef_high, gh_high),
                    _mm256_shuffle_ps::<0xEE>(ef_high, gh_high),
                ];
                [
                    Self(_mm256_permute2f128_ps::<0x20>(low[0], high[0])),
                    Self(_mm256_permute2f128_ps::<0x20>(low[1], high[1])),
                    Self(_mm256_permute2f128_ps::<0x20>(low[2], high[2])),
                    Self(_mm256_permute2f128_ps::<0x20>(low[3], high[3])),
                    Self(_mm256_permute2f128_ps::<0x31>(low[0], high[0])),
                    Self(_mm256_permute2f128_ps::<0x31>(low[1], high[1])),
                    Self(_mm256_permute2f128_ps::<0x31>(low[2], high[2])),
                    Self(_mm256_permute2f128_ps::<0x31>(low[3], high[3])),
                ]
            }
        }

        #[inline(always)]
        fn sums(rows: &[Self; LANES]) -> Lanes {
            let [Self(a), Self(b), Self(c), Self(d), Self(e), Self(f), Self(g), Self(h)] = *rows;
            let (low, high) = (sums_of_halves(a, b, c, d), sums_of_halves(e, f, g, h));
            // SAFETY: see above.
            let sums = unsafe {
                let firsts = _mm256_permute2f128_ps::<0x20>(low, high);
                let seconds = _mm256_permute2f128_ps::<0x31>(low, high);
                _mm256_add_ps(firsts, seconds)
            };
            Self(sums).to_lanes()
        }

        #[inline(always)]
        fn to_lanes(self) -> Lanes {
            let mut lanes = Lanes([0.0; LANES]);
            self.store(&mut lanes.0);
            lanes
        }

        #[inline(always)]
        fn add(self, other: Self) -> Self {
            // SAFETY: see above.
            Self(unsafe { _mm256_add_ps(self.0, other.0) })
        }

        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            // SAFETY: see above.
            Self(unsafe { _mm256_sub_ps(self.0, other.0) })
        }

        #[inline(always)]
        fn mul(self, other: Self) -> Self {
            // SAFETY: see above.
            Self(unsafe { _mm256_mul_ps(self.0, other.0) })
        }

        #[inline(always)]
        fn plus_product(self, a: Self, b: Self) -> Self {
            // SAFETY: see above.
            Self(unsafe { _mm256_fmadd_ps(a.0, b.0, self.0) })
        }

        #[inline(always)]
        fn at_least(self, other: Self) -> Self {
            // SAFETY: see above.
            Self(unsafe { _mm256_cmp_ps::<_CMP_GE_OQ>(self.0, other.0) })
        }

        #[inline(always)]
        fn and(self, mask: Self) -> Self {
            // SAFETY: see above.
            Self(unsafe { _mm256_and_ps(self.0, mask.0) })
        }

        #[inline(always)]
        fn select(mask: Self, high: Self, low: Self) -> Self {
            // SAFETY: see above.
            Self(unsafe { _mm256_blendv_ps(low.0, high.0, mask.0) })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::fused;

    /// Includes sums halfway between two singles, and complete cancellation.
    #[test]
    fn a_product_and_a_sum_are_rounded_once() {
        let mut state = 1_u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let scale = 2_f32.powi((state >> 27) as i32 - 16);
            ((state >> 3) as f32 / 2e8 - 1.0) * scale
        };
        for _ in 0..200_000 {
            let (a, b, c) = (random(), random(), random());
            assert_eq!(fused(a, b, c).to_bits(), a.mul_add(b, c).to_bits(), "{a} {b} {c}");
            assert_eq!(fused(a, b, -a * b).to_bits(), a.mul_add(b, -a * b).to_bits(), "{a} {b}");
        }
        let tie = 1.0 + f32::EPSILON;
        for (a, b, c) in [(tie, tie, 1e-20), (tie, tie, -1e-20), (tie, -tie, 1e-20), (0.0, 1.0, -0.0), (1.0, 2.0, -2.0)]
        {
            assert_eq!(fused(a, b, c).to_bits(), a.mul_add(b, c).to_bits(), "{a} {b} {c}");
        }
    }
}
