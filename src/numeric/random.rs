//! Random numbers: from a counter, so that each can be computed without the previous ones, and by xorshift.

/// Mixes 64 bits (the finaliser of SplitMix64, <https://doi.org/10.1145/2714064.2660195>).
#[inline]
pub fn scramble(value: u64) -> u64 {
    let value = (value ^ (value >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let value = (value ^ (value >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    value ^ (value >> 31)
}

/// The increment of the counter: the bits of the golden ratio.
pub const GOLDEN_GAMMA: u64 = 0x9e37_79b9_7f4a_7c15;

/// Returns the key of a stream. Different seeds, purposes and items give independent streams.
///
/// `purpose` is a constant of the caller. `item` counts the streams of one purpose, such as the frames of a film.
pub fn key(seed: u64, purpose: u64, item: u64) -> u64 {
    scramble(
        scramble(scramble(seed.wrapping_add(GOLDEN_GAMMA)) ^ purpose.wrapping_mul(GOLDEN_GAMMA))
            ^ item.wrapping_mul(GOLDEN_GAMMA),
    )
}

/// A stream of random numbers.
#[derive(Debug, Clone)]
pub struct Stream {
    state: u64,
}

impl Stream {
    /// Starts the stream of this key.
    pub fn new(key: u64) -> Self {
        Self { state: key }
    }

    /// Returns the next 64 random bits.
    fn next(&mut self) -> u64 {
        self.state = self.state.wrapping_add(GOLDEN_GAMMA);
        scramble(self.state)
    }

    /// Returns a uniform number from 0 to 1, 1 excluded.
    pub fn uniform(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Returns a uniform number from `low` to `high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Returns a normal number of mean 0 and standard deviation 1 (G. E. P. Box, M. E. Muller, Ann. Math. Stat. 29
    /// (1958) 610, <https://doi.org/10.1214/aoms/1177706645>).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

/// The generator xorshift64* (S. Vigna, ACM Trans. Math. Softw. 42 (2016) 30, <https://doi.org/10.1145/2845077>), which
/// takes less time per number than a [`Stream`]. It always starts at the same state.
#[derive(Debug, Clone)]
pub struct Xorshift {
    state: u64,
}

impl Default for Xorshift {
    fn default() -> Self {
        Self { state: GOLDEN_GAMMA }
    }
}

impl Xorshift {
    /// Returns the next number below `count`.
    ///
    /// # Panics
    ///
    /// If `count` is 0.
    pub fn below(&mut self, count: usize) -> usize {
        self.state ^= self.state >> 12;
        self.state ^= self.state << 25;
        self.state ^= self.state >> 27;
        ((self.state.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) % count as u64) as usize
    }
}
