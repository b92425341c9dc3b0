//! The minimum time between triggers.

/// Holds back triggers that follow the previous one too soon.
///
/// Times are the stamps of the frames, so the result does not depend on the clock of the process.
#[derive(Debug, Clone, Copy)]
pub struct Quiet {
    min_ns: u64,
    /// The stamp of the last trigger that passed.
    last_ns: Option<u64>,
}

impl Quiet {
    /// Requires at least `min_s` seconds between triggers.
    pub fn new(min_s: f64) -> Self {
        Self { min_ns: (1.0e9 * min_s).round() as u64, last_ns: None }
    }

    /// Returns whether a trigger at this stamp, ns since the Unix epoch, may pass, and if so counts it as the last one.
    ///
    /// An earlier stamp than the last one belongs to another run, or to a camera whose clock stepped back. It passes.
    pub fn passes(&mut self, stamp_ns: u64) -> bool {
        let too_soon =
            self.last_ns.and_then(|last_ns| stamp_ns.checked_sub(last_ns)).is_some_and(|ns| ns < self.min_ns);
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
