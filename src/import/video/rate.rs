//! The rate of a film: that of its frames' times, of playback, or of capture.

use super::super::rate::Rate;
use super::super::timeline::{FrameTimes, Timeline};
use super::super::{ImportError, RateSource};
use super::capture::CaptureRate;
use super::stream::Stream;
use super::times::Ticks;
use crate::numeric::quantile;
use std::path::Path;

/// Relative difference of two rates that contradict each other.
const MAX_RATE_DEVIATION: f64 = 0.01;
/// Ratio of the rates of capture and playback from which on a film is slow motion, or time lapse. Below it, a tag gives
/// the nominal rate of a camera that lowered it in the dark, and the times of the frames are real.
const MIN_SLOW_MOTION_RATIO: f64 = 1.5;

/// A timeline with warnings.
type Timed = (Timeline, Vec<String>);

/// Numbers and times the frames of a film.
///
/// `fps` is the rate of capture that the user gives. Else a tag of the file may state it. Without either the rate is
/// that of playback, with a warning.
///
/// # Errors
///
/// [`ImportError::FrameRate`] when nothing states a rate; [`ImportError::Io`] when the file cannot be read.
pub(super) fn timeline(
    path: &Path,
    stream: &Stream,
    ticks: &Ticks,
    fps: Option<f64>,
    warnings: &mut Vec<String>,
) -> Result<Timeline, ImportError> {
    let times = ticks.frame_times();
    let captured = CaptureRate::find(path, &stream.tags)?;
    let (played, contradictions) = match times.timeline(stated_rate(stream, &times), None) {
        Some(timed) => timed,
        // The other rate is ffmpeg's guess from the times.
        None => coarse_timeline(path, rate_property(stream, "avg_frame_rate"), &times, fps)?,
    };
    warnings.extend(contradictions);
    let playback_hz = played.rate_hz;
    let at_rate = |hz: f64| match times.timeline(stated_rate(stream, &times), Some(hz)) {
        Some((timeline, _)) => timeline,
        None => Timeline { rate_hz: hz, ..played.clone() },
    };
    if let Some(hz) = fps {
        return Ok(Timeline { source: RateSource::Option, ..at_rate(hz) });
    }
    let [first, rest @ ..] = &captured[..] else {
        warnings.push(format!(
            "the file plays at {playback_hz} frames/s; if it was filmed at another rate, pass that as --fps"
        ));
        return Ok(Timeline { source: RateSource::Playback, ..played });
    };
    warnings.extend(rest.iter().filter(|other| differ(other.hz, first.hz)).map(|other| {
        let (CaptureRate { hz, tag }, other_hz, other_tag) = (first, other.hz, &other.tag);
        format!("{tag} says {hz} frames/s, but {other_tag} says {other_hz}; pass the right one as --fps")
    }));
    let (CaptureRate { hz, tag }, slowness) = (first, first.hz / playback_hz);
    if slowness.max(1.0 / slowness) >= MIN_SLOW_MOTION_RATIO {
        return Ok(Timeline { source: RateSource::Header(tag.clone()), ..at_rate(*hz) });
    }
    if differ(*hz, playback_hz) {
        warnings.push(format!("{tag} says {hz} frames/s, but the frames were taken at {playback_hz:.3} frames/s"));
    }
    // The tag confirms that the times are those of the scene.
    Ok(Timeline { source: RateSource::FrameTimes, ..played })
}

/// Whether two rates differ by at least [`MAX_RATE_DEVIATION`] of the second.
fn differ(one_hz: f64, other_hz: f64) -> bool {
    (one_hz / other_hz - 1.0).abs() >= MAX_RATE_DEVIATION
}

/// Returns the stated rate that is nearest to that of the frames, by the logarithm of their ratio; `None` without any.
///
/// `r_frame_rate` is ffmpeg's guess of a usual rate, `avg_frame_rate` a mean over gaps, or what the file states.
fn stated_rate(stream: &Stream, times: &FrameTimes) -> Option<Rate> {
    let stated = ["avg_frame_rate", "r_frame_rate"].into_iter().filter_map(|key| rate_property(stream, key));
    let interval_ns = median_interval_ns(times);
    let distance = |rate: &Rate| (rate.hz * interval_ns / 1e9).ln().abs();
    stated.min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// Returns the rate that a property of the stream states; `None` if it is missing or cannot be a rate.
fn rate_property(stream: &Stream, key: &str) -> Option<Rate> {
    Rate::from_header(stream.ratio(key)?.value(), key)
}

/// Returns the timeline of frames whose times are too coarse to separate them, with warnings.
///
/// They follow each other at the stated rate, or else at their mean rate. `fps`, the rate of the user, counts only
/// where there is neither.
fn coarse_timeline(
    path: &Path,
    stated: Option<Rate>,
    times: &FrameTimes,
    fps: Option<f64>,
) -> Result<Timed, ImportError> {
    let Some(mean_hz) = mean_rate_hz(times) else {
        let by_user = fps.map(|hz| Rate { hz, source: RateSource::Option });
        return Ok((Timeline::consecutive(Rate::known(path, None, stated.or(by_user))?), Vec::new()));
    };
    let rate = stated.unwrap_or(Rate { hz: mean_hz, source: RateSource::FrameTimes });
    let (hz, tick_ms) = (rate.hz, times.resolution_ns / 1e6);
    let mut warnings = vec![format!(
        "the file stores times in steps of {tick_ms} ms, too coarse for gaps at {hz} frames/s to be found"
    )];
    let off_s = (times.times_ns.len() as f64 - 1.0) * (1.0 / hz - 1.0 / mean_hz);
    if differ(hz, mean_hz) && off_s.abs() * 1e9 > 2.0 * times.resolution_ns {
        warnings.push(format!(
            "the file states {hz} frames/s, but by their times its frames come at {mean_hz:.3} frames/s on average: \
             frames may be missing"
        ));
    }
    Ok((Timeline::consecutive(rate), warnings))
}

/// Returns the median interval between frames, ns, of two in the middle the longer one; 0 for a single frame.
fn median_interval_ns(times: &FrameTimes) -> f64 {
    let mut steps: Vec<f64> = times.times_ns.windows(2).map(|pair| (pair[1] - pair[0]) as f64).collect();
    quantile(&mut steps, 0.5).unwrap_or(0.0)
}

/// Returns the rate of the frames on average, Hz; `None` where they have no duration.
fn mean_rate_hz(times: &FrameTimes) -> Option<f64> {
    let (first, last) = (times.times_ns.first()?, times.times_ns.last()?);
    let hz = (times.times_ns.len() - 1) as f64 / (last - first) as f64 * 1e9;
    (hz.is_finite() && hz > 0.0).then_some(hz)
}
