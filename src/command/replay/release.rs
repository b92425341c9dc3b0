//! Releases the frames of several rigs in time order, or of one rig step by step.

use super::{Rate, ReplayRig, Tempo};
use crate::camera::replay::TimeRange;
use crate::failure::Failure;
use crate::image::FrameMeta;
use crate::process::{self, Extras, StepControl, Stop, Summary};
use crate::recording::{Frames, RecordingError};
use std::io::{BufRead, Write};
use std::sync::mpsc::{self, Receiver};
use std::thread;
use std::time::{Duration, Instant};

/// Maximum sleep between two checks for a stop.
const MAX_SLEEP: Duration = Duration::from_millis(50);
/// Maximum wait for the thread that releases frames after all rigs have ended.
const RELEASER_TIMEOUT: Duration = Duration::from_secs(2);

/// Runs a rig per stream and releases the frames in time order; also returns whether the user ended the replay.
///
/// # Errors
///
/// When a recording cannot be read or a rig cannot run. Then the other rigs are stopped.
pub(super) fn play_in_order(rigs: &[ReplayRig], tempo: Tempo, stop: &Stop) -> Result<(Vec<Summary>, bool), Failure> {
    let mut runs = Vec::new();
    let mut streams = Vec::new();
    for rig in rigs {
        let (leader, control) = mpsc::channel();
        streams.push(RigFrames::new(rig, control)?);
        let (config, stop) = (rig.config.clone(), stop.clone());
        runs.push(thread::spawn(move || {
            let extras = Extras { leader: Some(leader), ..Extras::default() };
            let summary = process::supervise(&config, &stop, extras, |_| ());
            if summary.is_err() {
                stop.request();
            }
            summary
        }));
    }
    let (done, outcome) = mpsc::channel();
    let stopped = stop.clone();
    // Not joined: the thread may be blocked on standard input.
    thread::spawn(move || {
        let ended = FrameReleaser { tempo, granted: 0, origin: None }.release_all(streams, &stopped);
        done.send(ended)
    });
    let mut summaries = Vec::new();
    for run in runs {
        summaries.push(run.join().map_err(|_| Failure::internal("a supervisor panicked"))??);
    }
    // The releasing thread notices the end before the rigs do, unless it still waits for input.
    let patience = if stop.requested() { Duration::ZERO } else { RELEASER_TIMEOUT };
    Ok((summaries, outcome.recv_timeout(patience).unwrap_or(Ok(true))?))
}

/// The frames of a rig that have not been published yet.
struct RigFrames {
    name: String,
    frames: Frames,
    span: TimeRange,
    first_ns: u64,
    control: Receiver<StepControl>,
}

impl RigFrames {
    /// Opens the frames of a stream. `control` delivers the control of its rig once it is ready.
    fn new(rig: &ReplayRig, control: Receiver<StepControl>) -> Result<Self, RecordingError> {
        Ok(Self {
            name: rig.config.rig.name.clone(),
            frames: rig.recording.frames()?,
            span: rig.span,
            first_ns: rig.recording.first_frame()?.stamp_ns,
            control,
        })
    }

    /// Returns the header of the next frame within the interval; `None` after its end.
    fn next_frame(&mut self) -> Result<Option<FrameMeta>, RecordingError> {
        while let Some(frame) = self.frames.next_shared() {
            let (meta, _) = frame?;
            let place = self.span.locate(self.first_ns, meta.stamp_ns);
            if !place.is_lt() {
                return Ok(place.is_eq().then_some(meta));
            }
        }
        Ok(None)
    }
}

/// A rig that is ready, and its next frame.
struct ReadyRig {
    frames: RigFrames,
    control: StepControl,
    next: FrameMeta,
}

/// Releases the frames of all rigs in time order.
struct FrameReleaser {
    tempo: Tempo,
    /// Number of frames that may still be released before the next prompt.
    granted: u64,
    /// The time when the first frame was released, and its stamp.
    origin: Option<(Instant, u64)>,
}

impl FrameReleaser {
    /// Releases all frames of the rigs that become ready, the earliest first; returns `true` if it was ended before the
    /// last.
    fn release_all(mut self, streams: Vec<RigFrames>, stop: &Stop) -> Result<bool, RecordingError> {
        let mut rigs = Vec::new();
        for mut frames in streams {
            let Ok(mut control) = frames.control.recv() else { continue };
            if let (true, Some(next)) = (control.wait_until_ready(), frames.next_frame()?) {
                rigs.push(ReadyRig { frames, control, next });
            }
        }
        let first_ns = rigs.iter().map(|rig| rig.next.stamp_ns).min().unwrap_or(0);
        // The earliest frame; of several at one time the first rig.
        while let Some(at) = (0..rigs.len()).min_by_key(|at| rigs[*at].next.stamp_ns) {
            let rig = &mut rigs[at];
            if !self.wait_for_release(rig, first_ns, stop) {
                return Ok(true);
            }
            let next = if rig.control.step() { rig.frames.next_frame()? } else { None };
            match next {
                Some(next) => rig.next = next,
                None => drop(rigs.remove(at)),
            }
        }
        Ok(false)
    }

    /// Waits until the next frame of a rig may be released; returns `false` to end the replay.
    ///
    /// `first_ns` is the stamp of the first frame of all rigs, from which a prompt counts the time.
    fn wait_for_release(&mut self, rig: &ReadyRig, first_ns: u64, stop: &Stop) -> bool {
        match self.tempo {
            Tempo::Rate(Rate::Max) => {}
            Tempo::Rate(Rate::Times(times)) => self.wait_for_time(rig.next.stamp_ns, times, stop),
            Tempo::Step if self.granted > 0 => {}
            Tempo::Step => match ask_count(rig, first_ns) {
                Some(count) => self.granted = count,
                None => return false,
            },
        }
        self.granted = self.granted.saturating_sub(1);
        !stop.requested()
    }

    /// Waits until a frame with this stamp, ns, is due, or a stop is requested. It is played at `times` real time since
    /// the first one.
    #[expect(clippy::disallowed_methods, reason = "playing at a given pace is what a clock is for")]
    fn wait_for_time(&mut self, stamp_ns: u64, times: f64, stop: &Stop) {
        let (start, first_ns) = *self.origin.get_or_insert((Instant::now(), stamp_ns));
        let ahead_s = stamp_ns.saturating_sub(first_ns) as f64 * 1e-9 / times;
        let due = Duration::try_from_secs_f64(ahead_s).unwrap_or(Duration::MAX);
        while !stop.requested() {
            let left = due.saturating_sub(start.elapsed());
            if left.is_zero() {
                break;
            }
            thread::sleep(left.min(MAX_SLEEP));
        }
    }
}

/// Prompts for the number of frames to release; returns `None` to end, also at the end of standard input.
fn ask_count(rig: &ReadyRig, first_ns: u64) -> Option<u64> {
    let at_s = rig.next.stamp_ns.saturating_sub(first_ns) as f64 * 1e-9;
    let mut stderr = std::io::stderr();
    loop {
        let (name, sequence) = (&rig.frames.name, rig.next.sequence);
        let _ = write!(
            stderr,
            "{name}: frame {sequence} at {at_s:.6} s; Enter plays it, a number plays that many, q ends: "
        );
        let mut line = String::new();
        let read = std::io::stdin().lock().read_line(&mut line);
        match line.trim() {
            _ if !read.is_ok_and(|bytes| bytes > 0) => return None,
            "" => return Some(1),
            "q" => return None,
            text => match text.parse::<u64>().ok().filter(|count| *count > 0) {
                Some(count) => return Some(count),
                None => {
                    let _ = writeln!(stderr, "{text:?}: expected Enter, a number of at least 1, or q");
                }
            },
        }
    }
}
