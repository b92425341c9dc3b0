//! `ricochet bench`: the measuring and recording speed of this machine.

mod live;
mod record;
mod windows;

use std::time::{Duration, Instant};

pub use live::{LiveOptions, live};
pub use record::{RecordOptions, record};
pub use windows::{WindowsOptions, windows};

/// Returns the sum of the calls' results per second over a duration.
#[expect(clippy::disallowed_methods, reason = "a benchmark reads the clock")]
fn rate(duration: Duration, mut round: impl FnMut() -> usize) -> f64 {
    let (start, mut points) = (Instant::now(), 0);
    while start.elapsed() < duration {
        points += round();
    }
    points as f64 / start.elapsed().as_secs_f64()
}

/// Returns the result of a call and its duration, s.
#[expect(clippy::disallowed_methods, reason = "a benchmark reads the clock")]
fn timed<T>(call: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = call();
    (result, start.elapsed().as_secs_f64())
}
