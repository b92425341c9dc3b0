//! Checks of the frame rate and of the regularity of timestamps; each warning is given once.

/// Number of frames per check.
const WINDOW_FRAMES: usize = 150;
/// Maximum relative deviation of the frame rate from its setting.
const MAX_RATE_DEVIATION: f64 = 0.02;
/// Maximum jitter of the timestamps (1 sigma) as a share of the frame period.
const MAX_JITTER: f64 = 0.02;

/// Observes sequence numbers and timestamps of frames.
#[derive(Debug)]
pub(super) struct FrameTiming {
    /// The configured rate; 0 if none.
    rate_hz: f64,
    /// Frames of this window, relative to its first.
    points: Vec<Point>,
    /// Sequence number and timestamp (ns) of the first frame of this window.
    first: Option<(u64, u64)>,
    warned_rate: bool,
    warned_jitter: bool,
}

/// A frame relative to the first frame of a window.
#[derive(Debug, Clone, Copy)]
struct Point {
    frames: f64,
    time_ns: f64,
}

impl FrameTiming {
    /// Starts the first window. `rate_hz` is the configured frame rate; 0, if unknown, is not compared.
    pub fn new(rate_hz: f64) -> Self {
        Self {
            rate_hz,
            points: Vec::with_capacity(WINDOW_FRAMES),
            first: None,
            warned_rate: false,
            warned_jitter: false,
        }
    }

    /// Adds a frame with its timestamp, ns. If it completes a window, returns the warnings not given before.
    pub fn observe(&mut self, sequence: u64, stamp_ns: u64) -> Vec<String> {
        let (first, start_ns) = *self.first.get_or_insert((sequence, stamp_ns));
        self.points
            .push(Point { frames: sequence.abs_diff(first) as f64, time_ns: stamp_ns.abs_diff(start_ns) as f64 });
        if self.points.len() < WINDOW_FRAMES {
            return Vec::new();
        }
        let LineFit { slope: period_ns, residual_sigma: jitter_ns } = fit_line(&self.points);
        self.points.clear();
        self.first = None;
        self.check(period_ns, jitter_ns)
    }

    /// Compares a window's mean frame period and jitter of the timestamps (1 sigma) with their limits, ns.
    ///
    /// Returns a warning for each that exceeds its limit for the first time.
    fn check(&mut self, period_ns: f64, jitter_ns: f64) -> Vec<String> {
        let mut warnings = Vec::new();
        let (rate_hz, wanted_hz) = (1e9 / period_ns, self.rate_hz);
        if wanted_hz > 0.0 && (rate_hz / wanted_hz - 1.0).abs() > MAX_RATE_DEVIATION && !self.warned_rate {
            self.warned_rate = true;
            warnings.push(format!(
                "frames arrive at {rate_hz:.2} Hz instead of {wanted_hz:.2} Hz: automatic exposure lengthens frames in \
                 the dark; set exposure_us, and add light"
            ));
        }
        if jitter_ns > MAX_JITTER * period_ns && !self.warned_jitter {
            self.warned_jitter = true;
            warnings.push(format!(
                "timestamps have a jitter of {:.2} ms (1 sigma), {:.0} % of a frame period, which velocities from frame \
                 to frame inherit: the driver stamps frames on arrival, or the frame rate varies",
                jitter_ns * 1e-6,
                100.0 * jitter_ns / period_ns
            ));
        }
        warnings
    }
}

/// A line through the timestamps of a window.
struct LineFit {
    /// The mean frame period, ns/frame.
    slope: f64,
    /// The standard deviation of the timestamps from the line, ns.
    residual_sigma: f64,
}

/// Fits time as a line over frames through at least three points of different frames, by least squares.
fn fit_line(points: &[Point]) -> LineFit {
    let count = points.len() as f64;
    let mean = |value: fn(&Point) -> f64| points.iter().map(value).sum::<f64>() / count;
    let (mean_frames, mean_ns) = (mean(|point| point.frames), mean(|point| point.time_ns));
    let sum = |term: &dyn Fn(f64, f64) -> f64| {
        points.iter().map(|point| term(point.frames - mean_frames, point.time_ns - mean_ns)).sum::<f64>()
    };
    let slope = sum(&|x, y| x * y) / sum(&|x, _| x * x);
    let square_sum = sum(&|x, y| (y - slope * x).powi(2));
    LineFit { slope, residual_sigma: (square_sum / (count - 2.0)).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;

    const START_NS: u64 = 1_700_000_000_000_000_000;
    const PERIOD_NS: u64 = 33_333_333;

    /// Returns the warnings for a camera set to 30 Hz that loses every seventh of this number of frames.
    ///
    /// Frame `index` is stamped `stamp_ns(index)` after the start.
    fn warnings(frames: u64, stamp_ns: impl Fn(u64) -> u64) -> Vec<String> {
        let mut timing = FrameTiming::new(30.0);
        (0..frames)
            .filter(|index| index % 7 != 3)
            .flat_map(|index| timing.observe(index, START_NS + stamp_ns(index)))
            .collect()
    }

    /// Returns a pseudo-random delay from 0 to 7 ms for the frame of this index, the same in each run.
    fn delay_ns(index: u64) -> u64 {
        (index.wrapping_mul(6_364_136_223_846_793_005) >> 40) % 7_000_000
    }

    #[test]
    fn a_regular_rate_gives_no_warning_even_with_lost_frames() {
        assert_eq!(warnings(2000, |n| n * PERIOD_NS), [""; 0]);
        assert_eq!(warnings(2000, |n| n * PERIOD_NS + delay_ns(n) / 10), [""; 0]);
    }

    #[test]
    fn a_rate_that_is_not_kept_is_reported_once() {
        let warnings = warnings(2000, |n| 2 * n * PERIOD_NS);
        assert_eq!(warnings.len(), 1, "{warnings:?}");
        assert!(warnings[0].starts_with("frames arrive at 15.00 Hz instead of 30.00 Hz: "), "{warnings:?}");
    }

    #[test]
    fn jitter_is_reported_once_with_its_amount() {
        let warnings = warnings(2000, |n| n * PERIOD_NS + delay_ns(n));
        assert_eq!(warnings.len(), 1, "{warnings:?}");
        // Uniform between 0 and 7 ms: 7 ms / sqrt(12) = 2.02 ms.
        assert!(warnings[0].starts_with("timestamps have a jitter of 2.0"), "{warnings:?}");
        assert!(warnings[0].contains(", 6 % of a frame period"), "{warnings:?}");
    }

    #[test]
    fn without_a_configured_rate_no_deviation_is_reported() {
        let mut timing = FrameTiming::new(0.0);
        assert!((0..1000).all(|n| timing.observe(n, START_NS + 2 * n * PERIOD_NS).is_empty()));
    }
}
