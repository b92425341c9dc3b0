//! The least time from one trigger to the next.

/// Lets a trigger pass only when enough time has gone by since the one before.
///
/// Times are the frames' stamps, so that the answer does not depend on when it is asked for.
#[derive(Debug, Clone, Copy)]
pub struct Quiet {
    least_ns: u64,
    last_ns: Option<u64>,
}

impl Quiet {
    /// At least `least_s` seconds from a trigger to the next.
    pub fn new(least_s: f64) -> Self {
        Self { least_ns: (1.0e9 * least_s).round() as u64, last_ns: None }
    }

    /// Whether a trigger at this stamp may pass. It then counts as the last one.
    ///
    /// A stamp before the last one's is that of another run or of a camera whose clock stepped back: it passes.
    pub fn passes(&mut self, stamp_ns: u64) -> bool {
        let too_soon =
            self.last_ns.and_then(|last_ns| stamp_ns.checked_sub(last_ns)).is_some_and(|ns| ns < self.least_ns);
        if !too_soon {
            self.last_ns = Some(stamp_ns);
        }
        !too_soon
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trigger_too_soon_is_held_back_and_does_not_put_off_the_next() {
        let mut quiet = Quiet::new(0.5);
        let stamps_ms = [1000, 1100, 1400, 1499, 1500, 1999, 2000];
        let passed: Vec<bool> = stamps_ms.iter().map(|ms| quiet.passes(ms * 1_000_000)).collect();
        assert_eq!(passed, [true, false, false, false, true, false, true]);
    }

    #[test]
    fn without_a_quiet_time_every_trigger_passes_and_a_clock_that_stepped_back_holds_nothing() {
        let mut quiet = Quiet::new(0.0);
        assert!(quiet.passes(5) && quiet.passes(5));
        let mut quiet = Quiet::new(10.0);
        assert!(quiet.passes(1_000_000_000_000) && quiet.passes(5));
    }
}
