//! The measurement of recorded shots with missing rows, after the shot.
//!
//! A worker that is too slow leaves out blocks, but the recording has their frames. They are measured here on a thread of
//! low priority, shot by shot in the order of their recording.

use crate::camera::{CameraIdentity, StreamFormat};
use crate::config::Config;
use crate::failure::Failure;
use crate::image::FrameMeta;
use crate::process::analysis::{FilmToMeasure, measure_film, results_record};
use crate::process::clock::Timeout;
use crate::process::reference_picture;
use crate::process::shot::recording_info;
use crate::process::stop::Stop;
use crate::recording::{Recording, results_path};
use rustix::process::nice;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::thread::JoinHandle;
use std::time::Duration;

/// The amount by which the priority of the thread is lower than that of the rig. Beside workers that are always busy it gets a
/// quarter of a processor.
const NICENESS: i32 = 5;
/// Maximum time at the end of the rig for the shot that is being measured.
const END_TIMEOUT: Duration = Duration::from_secs(15);
/// Interval of looking for its end.
const POLL_PERIOD: Duration = Duration::from_millis(20);

/// A shot whose frames are to be measured.
#[derive(Debug, Clone)]
pub(super) struct Incomplete {
    /// The recording.
    pub(super) path: PathBuf,
    /// The name of the view; empty for the main camera.
    pub(super) view: String,
    /// The configuration of the camera.
    pub(super) config: Config,
    pub(super) format: StreamFormat,
}

/// The outcome of a measurement.
#[derive(Debug)]
pub(super) struct Remeasured {
    /// The results, or the reason why there are none, in words.
    pub(super) text: String,
    pub(super) has_failed: bool,
}

/// The queue of the shots that are to be measured.
#[derive(Debug, Default)]
pub(super) struct Remeasurer {
    waiting: VecDeque<Incomplete>,
    running: Option<JoinHandle<Remeasured>>,
    stop: Stop,
}

impl Remeasurer {
    /// Adds a shot to the queue.
    pub(super) fn add(&mut self, shot: Incomplete) {
        self.waiting.push_back(shot);
    }

    /// Starts the next measurement if none runs, and returns the outcome of one that has ended.
    pub(super) fn advance(&mut self) -> Option<Remeasured> {
        if let Some(running) = self.running.take_if(|running| running.is_finished()) {
            let ended = running.join();
            let panicked = || Remeasured { text: "its frames could not be measured".into(), has_failed: true };
            return Some(ended.unwrap_or_else(|_| panicked()));
        }
        if self.running.is_none()
            && let Some(shot) = self.waiting.pop_front()
        {
            let (stop, path) = (self.stop.clone(), shot.path.clone());
            let work = move || shot.measure(&stop);
            match std::thread::Builder::new().name("remeasure".into()).spawn(work) {
                Ok(running) => self.running = Some(running),
                Err(error) => {
                    let text = format!("{}: cannot start a thread: {error}", path.display());
                    return Some(Remeasured { text, has_failed: true });
                }
            }
        }
        None
    }

    /// Waits at most [`END_TIMEOUT`] for the shots that are not measured yet, and calls `wait` again and again meanwhile.
    /// Returns the outcomes, of those that were given up too.
    pub(super) fn finish(&mut self, mut wait: impl FnMut() -> Result<(), Failure>) -> Result<Vec<Remeasured>, Failure> {
        let (timeout, mut outcomes) = (Timeout::new(END_TIMEOUT), Vec::new());
        while self.running.is_some() || !self.waiting.is_empty() {
            if timeout.has_expired() {
                self.stop.request();
                let given_up = self.waiting.drain(..).map(|shot| shot.given_up());
                outcomes.extend(given_up);
            }
            outcomes.extend(self.advance());
            wait()?;
            std::thread::sleep(POLL_PERIOD);
        }
        Ok(outcomes)
    }
}

impl Incomplete {
    /// Measures all frames of the recording into a file of results next to it.
    fn measure(&self, stop: &Stop) -> Remeasured {
        // At its present priority it would only be slower to end.
        let _ = nice(NICENESS);
        match self.try_measure(stop) {
            _ if stop.requested() => self.given_up(),
            Ok(results) => Remeasured { text: results.display().to_string(), has_failed: false },
            Err(error) => Remeasured { text: format!("{}: {error}", self.path.display()), has_failed: true },
        }
    }

    /// The outcome of a shot that there was no time for.
    fn given_up(&self) -> Remeasured {
        let path = self.path.display();
        Remeasured { text: format!("{path}: the rig ended first; run `ricochet analyze {path}`"), has_failed: true }
    }

    fn try_measure(&self, stop: &Stop) -> Result<PathBuf, Failure> {
        let view = (!self.view.is_empty()).then_some(self.view.as_str());
        let recording = Recording::open(&self.path)?.select_view(view)?;
        let mut config = self.config.clone();
        config.workers.count = 1;
        config.record = Some(results_record());
        let (config, format) = (&config, self.format);
        let reference = reference_picture::from_recording(&recording, config)?;
        let mut info = recording_info(config, &format, &CameraIdentity::default(), "none: measured after the shot");
        for key in ["camera", "serial", "host", "date", "trigger"] {
            if let Some(value) = recording.metadata().get(key) {
                info.metadata.insert(key.to_owned(), value.clone());
            }
        }
        let frames = recording.frames()?.map(|frame| -> Result<(FrameMeta, Vec<u8>), Failure> {
            if stop.requested() {
                return Err(Failure::internal("the rig ended"));
            }
            Ok(frame?)
        });
        let output = results_path(&self.path, view, 1);
        Ok(measure_film(FilmToMeasure { config, format, reference }, frames, info, &output)?.path)
    }
}
