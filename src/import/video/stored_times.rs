//! Films that store a time for some of their frames only.
//!
//! An MPEG program stream packs several small frames into one packet, which has one time. A player shows the others at
//! the rate of the film. If frames are missing within such a packet, it is unknown which.

use super::super::ImportError;
use super::program::{Program, file_url, spawn_line_reader, spawn_text_reader};
use super::stream::{Ratio, Stream};
use std::path::Path;

/// The MPEG program stream, as ffprobe names it.
const CONTAINER: &str = "mpeg";
/// The maximum distance of a stored time from the time that the number of frames predicts, periods. Beyond it, frames
/// are missing.
const MAX_OFFSET_PERIODS: f64 = 0.5;
/// The minimum number of intervals of which the median is the rate of the film.
///
/// Most of fewer intervals may hold a gap. The stated rate counts then.
const MIN_INTERVALS: usize = 4;

/// A frame whose time the file stores.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct StoredTime {
    /// The index of the frame in the order of decoding.
    index: usize,
    /// The time of decoding, ticks: it rises with the index, unlike the time of presentation.
    ticks: i64,
}

/// Checks that the frames without a time of their own follow each other without gaps, and warns that they have none.
/// Films in other containers than the MPEG program stream pass.
///
/// # Errors
///
/// Returns [`ImportError::Invalid`] if frames are missing among those without a time, or the file has more frames than
/// bytes.
pub(super) fn check_stored_times(
    path: &Path,
    stream: &Stream,
    file_bytes: u64,
    warnings: &mut Vec<String>,
) -> Result<(), ImportError> {
    if stream.container != CONTAINER {
        return Ok(());
    }
    let (stored, frames) = read_stored_times(path, file_bytes)?;
    if stored.len() == frames {
        return Ok(());
    }
    let tick_s = stream.ratio("time_base").map_or(0.0, Ratio::value);
    let stated = stream.ratio("avg_frame_rate").map(|rate| 1.0 / (rate.value() * tick_s));
    if let Some(gap) = first_gap(&stored, stated) {
        let Gap { from, to, periods } = gap;
        return Err(ImportError::invalid(
            path,
            format!(
                "the file stores a time for {} of its {frames} frames, and between frames {from} and {to} pass \
                 {periods:.1} periods in place of {}: frames are missing there, and which is unknown. Use a film of \
                 the source in another container (MP4, MKV, AVI), or one without gaps",
                stored.len(),
                to - from
            ),
        ));
    }
    let last = stored.last().map_or(0, |last| frames - 1 - last.index);
    warnings.push(format!(
        "the file stores a time for {} of its {frames} frames; the others follow at its rate, and frames missing among \
         the last {last} would not show",
        stored.len()
    ));
    Ok(())
}

/// A place where frames do not follow at the rate of the film.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Gap {
    /// The index of the last frame before it.
    from: usize,
    /// The index of the first frame after it.
    to: usize,
    /// The time between the two, periods.
    periods: f64,
}

/// Returns the first place among frames without a time where the time does not agree with the number of frames.
///
/// `stated` is the period that the file states, ticks. `None` if there is no gap.
fn first_gap(stored: &[StoredTime], stated: Option<f64>) -> Option<Gap> {
    let spans = || stored.windows(2).map(|pair| (pair[0], pair[1]));
    let periods = spans().map(|(from, to)| (to.ticks - from.ticks) as f64 / (to.index - from.index) as f64);
    let mut periods: Vec<f64> = periods.collect();
    periods.sort_unstable_by(f64::total_cmp);
    // Missing frames make a span longer, never shorter.
    let median = *periods.get(periods.len().saturating_sub(1) / 2)?;
    let period = stated.filter(|_| periods.len() < MIN_INTERVALS).unwrap_or(median);
    // Between two neighbours that both have a time, a gap is where it seems to be.
    spans().filter(|(from, to)| to.index - from.index > 1).find_map(|(from, to)| {
        let gap = Gap { from: from.index, to: to.index, periods: (to.ticks - from.ticks) as f64 / period };
        let is_off = (gap.periods - (to.index - from.index) as f64).abs() > MAX_OFFSET_PERIODS;
        is_off.then_some(gap)
    })
}

/// Reads the times of decoding that the file stores, and its number of frames, with ffprobe.
///
/// # Errors
///
/// Returns [`ImportError`] if ffprobe fails or lists more frames than the file has bytes.
fn read_stored_times(path: &Path, file_bytes: u64) -> Result<(Vec<StoredTime>, usize), ImportError> {
    let options = "-v error -protocol_whitelist file -fflags +nofillin -select_streams V:0 -show_entries packet=dts \
        -of csv=print_section=0";
    let mut ffprobe = Program::start("ffprobe", options, &[file_url(path)], path)?;
    let _messages = ffprobe.stderr().map(|pipe| spawn_text_reader(pipe, 0));
    let (mut stored, mut frames) = (Vec::new(), 0);
    let Some(output) = ffprobe.stdout().map(spawn_line_reader) else { return Ok((stored, frames)) };
    while let Some(line) = ffprobe.receive(&output)? {
        let time = line.trim_end_matches(',').parse();
        stored.extend(time.ok().map(|ticks| StoredTime { index: frames, ticks }));
        frames += 1;
        if frames as u64 > file_bytes {
            return Err(ImportError::invalid(path, "the file lists more frames than it has bytes"));
        }
    }
    Ok((stored, frames))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gap(times: &[(usize, i64)]) -> Option<(usize, usize)> {
        let stored: Vec<_> = times.iter().map(|(index, ticks)| StoredTime { index: *index, ticks: *ticks }).collect();
        first_gap(&stored, Some(1800.0)).map(|gap| (gap.from, gap.to))
    }

    #[test]
    fn a_gap_is_found_among_frames_without_a_time() {
        assert_eq!(gap(&[]), None);
        assert_eq!(gap(&[(0, 0), (10, 18_000), (21, 37_800)]), None);
        assert_eq!(gap(&[(0, 0), (10, 21_600)]), Some((0, 10)));
        // The stated rate is that of playback; the frames come at half of it.
        let half: Vec<_> = (0..8).map(|k| (10 * k, 36_000 * k as i64)).collect();
        assert_eq!(gap(&half), None);
        assert_eq!(gap(&[&half[..4], &[(40, 151_200), (50, 187_200)]].concat()), Some((30, 40)));
        // Between neighbours it is known.
        assert_eq!(gap(&[(0, 0), (10, 18_000), (11, 23_400), (20, 39_600), (30, 57_600), (40, 75_600)]), None);
    }
}
