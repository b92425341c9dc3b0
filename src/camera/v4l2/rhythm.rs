//! Whether frames come at the rate that was set, and as evenly as their stamps say; told once.

/// Frames that are looked at together.
const FRAMES: usize = 150;
/// A rate that is off by more than this, relative, is told.
const RATE_OFF: f64 = 0.02;
/// Stamps that scatter about an even pace by more than this share of a frame (1 sigma) are told.
const SCATTER: f64 = 0.02;

/// Watches numbers and stamps of frames.
#[derive(Debug)]
pub(super) struct Rhythm {
    /// What was set; 0 when nothing was.
    rate_hz: f64,
    /// Frames after the first one of this window, and ns after it.
    seen: Vec<(f64, f64)>,
    first: Option<(u64, u64)>,
    told_rate: bool,
    told_scatter: bool,
}

impl Rhythm {
    pub fn new(rate_hz: f64) -> Self {
        Self { rate_hz, seen: Vec::with_capacity(FRAMES), first: None, told_rate: false, told_scatter: false }
    }

    /// Takes the next frame; what there is to say of the last ones.
    pub fn see(&mut self, sequence: u64, stamp_ns: u64) -> Vec<String> {
        let (first, start_ns) = *self.first.get_or_insert((sequence, stamp_ns));
        self.seen.push((sequence.abs_diff(first) as f64, stamp_ns.abs_diff(start_ns) as f64));
        if self.seen.len() < FRAMES {
            return Vec::new();
        }
        let (period_ns, scatter_ns) = line(&self.seen);
        self.seen.clear();
        self.first = None;
        self.judge(period_ns, scatter_ns)
    }

    fn judge(&mut self, period_ns: f64, scatter_ns: f64) -> Vec<String> {
        let mut said = Vec::new();
        let (rate_hz, wanted_hz) = (1e9 / period_ns, self.rate_hz);
        if wanted_hz > 0.0 && (rate_hz / wanted_hz - 1.0).abs() > RATE_OFF && !self.told_rate {
            self.told_rate = true;
            said.push(format!(
                "frames come at {rate_hz:.2} Hz, not at {wanted_hz:.2} Hz: a camera that exposes by itself takes longer \
                 frames in the dark; set exposure_us, and bring more light"
            ));
        }
        if scatter_ns > SCATTER * period_ns && !self.told_scatter {
            self.told_scatter = true;
            said.push(format!(
                "stamps scatter by {:.2} ms about an even pace, {:.0} % of a frame, and speeds from frame to frame by as \
                 much: the driver stamps frames when they reach the computer, or their pace changes",
                scatter_ns * 1e-6,
                100.0 * scatter_ns / period_ns
            ));
        }
        said
    }
}

/// Slope of the line through these points, and how much they scatter about it (1 sigma).
fn line(points: &[(f64, f64)]) -> (f64, f64) {
    let count = points.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / count;
    let (middle, height) = (mean(|point| point.0), mean(|point| point.1));
    let sum = |of: &dyn Fn(f64, f64) -> f64| points.iter().map(|(x, y)| of(x - middle, y - height)).sum::<f64>();
    let slope = sum(&|x, y| x * y) / sum(&|x, _| x * x);
    let square = sum(&|x, y| (y - slope * x).powi(2));
    (slope, (square / (count - 2.0)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    const START_NS: u64 = 1_700_000_000_000_000_000;
    const PERIOD_NS: u64 = 33_333_333;

    /// What is said of a camera set to 30 Hz whose frame `n` is stamped at `at(n)` ns.
    fn said(frames: u64, at: impl Fn(u64) -> u64) -> Vec<String> {
        let mut rhythm = Rhythm::new(30.0);
        (0..frames).filter(|n| n % 7 != 3).flat_map(|n| rhythm.see(n, START_NS + at(n))).collect()
    }

    /// 0 to 7 ms, the same in each run.
    fn late_ns(n: u64) -> u64 {
        (n.wrapping_mul(6_364_136_223_846_793_005) >> 40) % 7_000_000
    }

    #[test]
    fn an_even_pace_is_nothing_to_speak_of_lost_frames_or_not() {
        assert_eq!(said(2000, |n| n * PERIOD_NS), [""; 0]);
        assert_eq!(said(2000, |n| n * PERIOD_NS + late_ns(n) / 10), [""; 0]);
    }

    #[test]
    fn a_rate_that_was_not_kept_is_told_once() {
        let said = said(2000, |n| 2 * n * PERIOD_NS);
        assert_eq!(said.len(), 1, "{said:?}");
        assert!(said[0].starts_with("frames come at 15.00 Hz, not at 30.00 Hz: "), "{said:?}");
    }

    #[test]
    fn stamps_that_scatter_are_told_once_with_how_much() {
        let said = said(2000, |n| n * PERIOD_NS + late_ns(n));
        assert_eq!(said.len(), 1, "{said:?}");
        // Even between 0 and 7 ms: 7 ms / sqrt(12) = 2.02 ms.
        assert!(said[0].starts_with("stamps scatter by 2.0") && said[0].contains(", 6 % of a frame"), "{said:?}");
    }

    #[test]
    fn without_a_rate_none_can_be_missed() {
        let mut rhythm = Rhythm::new(0.0);
        assert!((0..1000).all(|n| rhythm.see(n, START_NS + 2 * n * PERIOD_NS).is_empty()));
    }
}
