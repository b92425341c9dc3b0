//! The measurement of a whole film by several threads.

use super::reference_picture;
use super::setup::analysis_params;
use super::shot::{FrameRange, Shot};
use crate::camera::StreamFormat;
use crate::config::{Compression, Config, Record};
use crate::failure::{ExitCode, Failure, Fatal};
use crate::image::{Frame, FrameMeta, FrameRuns, Image};
use crate::measure::{MeasureError, MeasureParams, Measured, Measurer, Share};
use crate::recording::{RecordingInfo, part_path};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};

/// The length of each worker's queue, frames.
const QUEUE_FRAMES: usize = 16;

/// The description of a film that is to be measured.
#[derive(Debug)]
pub struct FilmToMeasure<'a> {
    /// The configuration to measure with. It has at least one worker.
    pub config: &'a Config,
    /// Size, pixel format and frame rate.
    pub format: StreamFormat,
    /// The image in which the patches were drawn, if there are any.
    pub reference: Option<Image>,
}

/// A measured film.
#[derive(Debug)]
pub struct MeasuredFilm {
    /// The results file.
    pub path: PathBuf,
    /// The number of missing frames.
    pub missing: u64,
    /// The frames of the film.
    pub runs: FrameRuns,
}

/// Returns the settings of a results file, which has no frames.
pub fn results_record() -> Record {
    Record {
        directory: PathBuf::from("."),
        compression: Compression::None,
        raw_frames: false,
        ring_bytes_max: None,
        keep_last: None,
        max_bytes: None,
        split_bytes: None,
    }
}

/// The error of a film without frames.
#[derive(Debug, thiserror::Error)]
#[error("cannot measure a film of 0 frames; --from and --to are seconds from its first frame")]
pub struct EmptyFilm;

impl Fatal for EmptyFilm {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Usage
    }
}

/// A frame for all workers.
type Job = Arc<(FrameMeta, Vec<u8>)>;
/// The steps and fields that a worker has measured after a frame.
type Answer = Result<Vec<Measured>, MeasureError>;

/// Measures every frame of a film into a results file with this description.
///
/// # Errors
///
/// When there is no frame, a frame cannot be read, or the results cannot be written. No partial results file remains.
pub fn measure_film(
    film: FilmToMeasure<'_>,
    frames: impl Iterator<Item = Result<(FrameMeta, Vec<u8>), Failure>>,
    mut info: RecordingInfo,
    output: &Path,
) -> Result<MeasuredFilm, Failure> {
    let FilmToMeasure { config, format, reference } = film;
    config.check_calibration(format.width_px, format.height_px)?;
    let (measure_params, tracker_params) = analysis_params(config, &format);
    info.attachments.extend(reference.as_ref().and_then(reference_picture::attachment));
    let mut frames = frames.peekable();
    let meta = match frames.peek() {
        Some(Ok((meta, _))) => *meta,
        _ => {
            return Err(frames.next().and_then(Result::err).unwrap_or_else(|| EmptyFilm.into()));
        }
    };
    let (first, stamp_ns) = (meta.sequence, meta.stamp_ns);
    info.metadata.insert("first_frame".into(), first.to_string());
    info.metadata.insert("first_stamp_ns".into(), stamp_ns.to_string());
    let range = FrameRange { first, last: None, max_delay_frames: u64::MAX };
    let mut shot = Shot::create(output, config, &info)?;
    shot.begin(0, Some(&tracker_params), range);
    let mut runs = FrameRuns::default();
    let whole = std::thread::scope(|scope| -> Result<(), Failure> {
        let (answers, results) = channel();
        let mut workers = Vec::new();
        for index in 0..config.workers.count {
            let (jobs, todo) = sync_channel(QUEUE_FRAMES);
            let mut measurer = plan_measurer(&measure_params, index, config.workers.count, &format)?;
            reference.iter().try_for_each(|picture| measurer.set_reference(picture))?;
            let answers = answers.clone();
            scope.spawn(move || run_worker(measurer, &todo, &answers));
            workers.push(jobs);
        }
        drop(answers);
        for frame in frames {
            let (meta, bytes) = frame?;
            runs.push(meta.sequence);
            shot.write_frame(0, &Frame { meta, bytes: &bytes })?;
            send_to_all(&workers, &Arc::new((meta, bytes)));
            results.try_iter().try_for_each(|answer| write_measured(&mut shot, answer))?;
        }
        drop(workers);
        results.iter().try_for_each(|answer| write_measured(&mut shot, answer))
    });
    if let Err(error) = whole {
        // A partial results file could be mistaken for the whole result.
        drop(shot);
        let _ = std::fs::remove_file(part_path(output));
        return Err(error);
    }
    let (missing, end) = (shot.lost(0), shot.next_frame(0));
    let (finished, _) = shot.finish(&[end])?;
    Ok(MeasuredFilm { path: finished.path, missing, runs })
}

/// Plans the measurer of worker `index`, from 0, of `of` workers.
fn plan_measurer(params: &MeasureParams, index: u32, of: u32, format: &StreamFormat) -> Result<Measurer, MeasureError> {
    Measurer::new(params, Share { index, of }, format.width_px as usize, format.height_px as usize)
}

/// Sends a frame to every worker, and waits where a queue is full.
fn send_to_all(workers: &[SyncSender<Job>], job: &Job) {
    for worker in workers {
        // A worker that has ended has sent its error.
        let _ = worker.send(Arc::clone(job));
    }
}

/// Measures the frames of a queue until it closes or one cannot be measured, and sends the results of each.
fn run_worker(mut measurer: Measurer, todo: &Receiver<Job>, answers: &Sender<Answer>) {
    for job in todo {
        let (meta, bytes) = job.as_ref();
        let mut measured = Vec::new();
        let answer = measurer.push(&Frame { meta: *meta, bytes }, &mut measured).map(|()| measured);
        let failed = answer.is_err();
        if answers.send(answer).is_err() || failed {
            return;
        }
    }
    let mut measured = Vec::new();
    measurer.finish(&mut measured);
    let _ = answers.send(Ok(measured));
}

/// Adds the results of a worker to the results file.
fn write_measured(shot: &mut Shot, answer: Answer) -> Result<(), Failure> {
    for measured in answer? {
        shot.write_step(0, measured.step, measured.field)?;
    }
    Ok(())
}
